"""Neutral studio: light for images of models that bring no light.

The studio is an environment map of large, soft, white lights in a grey room. It has a key light from the upper
left, a fill light from the right, and two rim lights from behind. The brightness of the backdrop is chosen so that
glass in front of it appears nearly as bright as the background. A white, level ground has radiance 1, and a white
wall facing the front nearly as much.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.sky.sky import Environment

Float64 = NDArray[np.float64]

_HEIGHT, _WIDTH = 64, 128
# Radiance of the room straight down, in the unit of `_Softbox.radiance`.
_FLOOR = 0.55
# Radiance of the room at the horizon, in the same unit.
_HORIZON = 0.24
# Radiance of the room straight up, in the same unit.
_ZENITH = 0.4
# Distance of the ground below a model, in diagonals of the model.
_BELOW = 1e-4
# Width in degrees of a light's fading edge.
_SOFT = 8.0


class _Softbox(NamedTuple):
    """Rectangular soft light of the studio.

    azimuth, elevation : centre in degrees; azimuth 0 is +z, where the front of a model faces, and 90 is +x
    wide, high : size in degrees
    radiance : radiance before the environment map is scaled, so that a white, level ground has radiance 1
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
    """Return the (3,) unit vector along the coordinate axis nearest to `up`."""
    index = int(np.argmax(np.abs(up)))
    axis = np.zeros(3)
    axis[index] = np.sign(up[index])
    return axis


def ground_below(lower: Float64, upper: Float64, axis: Float64) -> Float64:
    """Return a (3,) point of the ground below a box, with `axis` up.

    The distance to the box is larger than rounding errors.
    """
    ground = np.where(axis > 0, lower, np.where(axis < 0, upper, 0.0))
    return np.asarray(ground - axis * _BELOW * float(np.linalg.norm(upper - lower)))


def studio(up: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> Environment:
    """Return the environment map of the studio, marked as `assumed`, because it substitutes for missing light.

    up : unit vector along a coordinate axis. The front of models is that of
         `glpath.scene.camera.upright_from_world`
    """
    return _studio(up)


@functools.cache
def _studio(up: tuple[float, float, float]) -> Environment:
    # With y up, the centre of the environment map is +z, and +x is to its left, see `Environment`.
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
        # Horizontal degrees are scaled, so that their width is the same at any elevation.
        across = ((azimuth - box.azimuth + 180.0) % 360.0 - 180.0) * np.cos(np.radians(elevation))
        inside = _edge(np.abs(across), 0.5 * box.wide) * _edge(np.abs(elevation - box.elevation), 0.5 * box.high)
        light = light + inside * (box.radiance - light)
    area = np.sin(theta) * (np.pi / _HEIGHT) * (2 * np.pi / _WIDTH)
    white = float((light * np.maximum(height, 0.0) * area).sum()) / np.pi
    image = np.repeat((light / white)[..., None], 3, axis=2).astype(np.float32)
    # The centre of an environment map is along +x if z is up.
    return Environment(image, np.array(up), rotation=-90.0 if abs(up[2]) > 0 else 0.0, assumed=True)


def _smooth(t: Float64) -> Float64:
    return np.asarray(t * t * (3 - 2 * t))


def _edge(apart: Float64, half: float) -> Float64:
    """Return 1 inside `half` degrees and 0 outside, with a smooth transition."""
    return _smooth(np.clip((half - apart) / _SOFT + 0.5, 0.0, 1.0))
