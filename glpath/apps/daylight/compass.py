"""Orientation of a scene: up, north, and directions of the sky in scene coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.scene import Scene
from glpath.sky.sky import NORTH
from glpath.system.arguments import short_repr

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Compass:
    """Perpendicular unit vectors `up` and `north` of a scene."""

    up: tuple[float, float, float]
    north: tuple[float, float, float]

    @classmethod
    def of(cls, scene: Scene, up: ArrayLike | None = None, north: ArrayLike | None = None) -> Compass:
        """Return the compass of a scene.

        up    : (3,); None: the sky's up direction, rounded to the nearest axis. The camera's up direction replaces
                it if the scene has no sky, or a sky that was added for lack of lights
        north : (3,), of which only the horizontal part is used; None: the sky's if the sky's up direction is less
                than 60 degrees from `up`, otherwise that of `NORTH`

        Raises UsageError for invalid vectors, and for a north that is vertical.
        """
        if up is None:
            stands_in = scene.sky is None or scene.sky.assumed
            given = np.asarray(scene.camera.up if scene.sky is None or stands_in else scene.sky.up, np.float64)
            axis = int(np.argmax(np.abs(given)))
            upward = np.zeros(3)
            upward[axis] = np.sign(given[axis])
        else:
            upward = _unit("up", up)
        given_north = north
        # An axis is at most 54.7 degrees from the vectors that are nearest to it, so None as `up` agrees.
        if north is None and scene.sky is not None and 2 * (upward @ _unit("up", scene.sky.up)) > 1:
            given_north = getattr(scene.sky, "north", None)
        if given_north is None:
            given_north = NORTH[int(np.argmax(np.abs(upward)))]
        level = _unit("north", given_north)
        level = level - (level @ upward) * upward
        if np.linalg.norm(level) < 1e-6:
            raise UsageError(
                f"north: {given_north} is along up, {tuple(upward.tolist())}.", "Give a direction that is level."
            )
        level /= np.linalg.norm(level)
        return cls(_triple(upward), _triple(level))

    @property
    def world_from_sky(self) -> Float64:
        """Matrix (3, 3) with the columns east, north and up."""
        up, north = np.array(self.up), np.array(self.north)
        return np.stack([np.cross(north, up), north, up], axis=1)

    def directions(self, azimuth: ArrayLike, sin_altitude: ArrayLike) -> Float64:
        """Return unit vectors (..., 3) in the scene's coordinates.

        azimuth      : angles from north over east, radians
        sin_altitude : sines of the altitudes above the horizon
        """
        sine = np.asarray(sin_altitude, np.float64)
        level = np.sqrt(np.maximum(0.0, 1.0 - sine**2))
        around = np.asarray(azimuth, np.float64)
        sky = np.stack(np.broadcast_arrays(level * np.sin(around), level * np.cos(around), sine), axis=-1)
        return np.asarray(sky @ self.world_from_sky.T)


def _unit(name: str, vector: ArrayLike) -> Float64:
    found = np.asarray(vector, np.float64)
    if found.shape != (3,) or not np.isfinite(found).all() or not found.any():
        raise UsageError(f"{name}: {short_repr(vector)} where three finite numbers are needed, not all zero")
    return np.asarray(found / np.linalg.norm(found))


def _triple(vector: Float64) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
