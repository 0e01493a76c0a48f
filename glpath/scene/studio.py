"""A neutral studio: the light of pictures of models that bring none.

An environment map of large, soft lights in a grey room, all white: a key from the upper left, a fill from the
right, and two rims from behind, before a backdrop that glass shows nearly as bright as the background is. A white,
level ground has the radiance 1 in it, a white wall to the front nearly as much.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.sky import Environment

Float64 = NDArray[np.float64]

_HEIGHT, _WIDTH = 64, 128
# Radiance of the room straight below, at the horizon and straight above, beside that of the lights.
_FLOOR, _HORIZON, _ZENITH = 0.55, 0.24, 0.4
# In diagonals of a model, how far below it the ground is.
_BELOW = 1e-4
# Of the edge of a light, in degrees, in which it fades.
_SOFT = 8.0


class _Softbox(NamedTuple):
    """azimuth, elevation : degrees, of its middle; azimuth 0 is where the front of a model looks to, +z, 90 is +x
    wide, high : degrees
    """

    azimuth: float
    elevation: float
    wide: float
    high: float
    radiance: float


_LIGHTS = (
    _Softbox(180.0, 0.0, 130.0, 70.0, 1.8),  # backdrop
    _Softbox(-36.0, 36.0, 48.0, 40.0, 12.0),  # key
    _Softbox(56.0, 18.0, 44.0, 56.0, 2.0),  # fill
    _Softbox(150.0, 44.0, 36.0, 50.0, 4.5),  # rim
    _Softbox(-132.0, 30.0, 20.0, 60.0, 4.0),  # rim
)


def nearest_axis(up: Float64) -> Float64:
    """Return the (3,) unit vector along the axis nearest to `up`."""
    index = int(np.argmax(np.abs(up)))
    axis = np.zeros(3)
    axis[index] = np.sign(up[index])
    return axis


def ground_below(lower: Float64, upper: Float64, axis: Float64) -> Float64:
    """Return a (3,) point of the ground below a box, `axis` up: further below than rounding."""
    ground = np.where(axis > 0, lower, np.where(axis < 0, upper, 0.0))
    return np.asarray(ground - axis * _BELOW * float(np.linalg.norm(upper - lower)))


def studio(up: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> Environment:
    """The environment map; `assumed`, as it stands in for light that a file does not have.

    up : an axis. What faces the eye is the front of models, as of `glpath.scene.camera.upright_from_world`
    """
    return _studio(up)


@functools.cache
def _studio(up: tuple[float, float, float]) -> Environment:
    # With y up the middle of the map is +z, and what is left of it +x: see `Environment`.
    theta = (np.arange(_HEIGHT) + 0.5)[:, None] * (np.pi / _HEIGHT)
    phi = (0.5 - (np.arange(_WIDTH) + 0.5) / _WIDTH)[None, :] * (2 * np.pi)
    elevation = 90.0 - np.degrees(theta) + np.zeros_like(phi)
    azimuth = np.degrees(phi) + np.zeros_like(theta)
    height = np.sin(np.radians(elevation))
    light = np.where(
        height < 0,
        _HORIZON + (_FLOOR - _HORIZON) * _smooth(-height),
        _HORIZON + (_ZENITH - _HORIZON) * _smooth(height),
    )
    for box in _LIGHTS:
        # Degrees across are as wide at any elevation.
        across = ((azimuth - box.azimuth + 180.0) % 360.0 - 180.0) * np.cos(np.radians(elevation))
        inside = _edge(np.abs(across), 0.5 * box.wide) * _edge(np.abs(elevation - box.elevation), 0.5 * box.high)
        light = light + inside * (box.radiance - light)
    area = np.sin(theta) * (np.pi / _HEIGHT) * (2 * np.pi / _WIDTH)
    white = float((light * np.maximum(height, 0.0) * area).sum()) / np.pi
    image = np.repeat((light / white)[..., None], 3, axis=2).astype(np.float32)
    # The middle of a map is along +x where z is up.
    return Environment(image, np.array(up), rotation=-90.0 if abs(up[2]) > 0 else 0.0, assumed=True)


def _smooth(t: Float64) -> Float64:
    return np.asarray(t * t * (3 - 2 * t))


def _edge(apart: Float64, half: float) -> Float64:
    """1 within, 0 beyond `half` degrees, smooth between."""
    return _smooth(np.clip((half - apart) / _SOFT + 0.5, 0.0, 1.0))
