"""What is seen behind all surfaces: environment maps by scipy's interpolation, and skies of two colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from glpath.scene.model import Environment, Scene

Float64 = NDArray[np.float64]


def sky_radiance(scene: Scene, directions: Float64) -> Float64:
    """(N, 3) from unit directions (N, 3): of a blend, of a map, or black."""
    sky = scene.sky
    if sky is None:
        return np.zeros_like(directions)
    if isinstance(sky, Environment):
        return environment_radiance(sky, directions)
    height = np.clip(directions @ sky.up, 0, 1)[:, None]
    return np.asarray((1 - height) * sky.horizon + height * sky.zenith)


def environment_radiance(sky: Environment, directions: Float64) -> Float64:
    """The same of a map whose `up` is an axis: it is cycled to y, and the map turned back about it."""
    axis = int(np.argmax(sky.up))
    assert np.array_equal(sky.up, np.eye(3)[axis]), "up is an axis"
    # The axis that follows up takes the place of z.
    d = np.roll(directions, 1 - axis, axis=1)
    d = Rotation.from_euler("y", sky.rotation, degrees=True).inv().apply(d)
    height, width = sky.image.shape[:2]
    # Mitsuba's: 0 along -z, a quarter along x.
    u, v = np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi) % 1.0, np.arccos(np.clip(d[:, 1], -1, 1)) / np.pi
    padded = np.pad(np.pad(sky.image, ((0, 0), (1, 1), (0, 0)), mode="wrap"), ((1, 1), (0, 0), (0, 0)), mode="edge")
    at = [v * height + 0.5, u * width + 0.5]
    channels = [map_coordinates(padded[..., i].astype(float), at, order=1) for i in range(3)]
    return np.asarray(sky.scale * np.stack(channels, axis=1))
