"""Motion of a rigid object: keys, with rotation, stretch and shift interpolated between them.

The polar decomposition splits a key's map into a rotation and a stretch. The rotation takes the shorter arc about
one axis at constant speed; stretch and position change linearly. So a wheel needs more than two keys per
revolution.

Source: Shoemake & Duff 1992, Matrix Animation and Polar Decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glpath.system.arguments import checked_fields

Float64 = NDArray[np.float64]

# Minimum ratio of the shortest to the longest axis of a map's ellipsoid; a flatter map has no rotation.
_FLAT = 1e-7


@checked_fields
@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a shape's instances: the affine map of the motion is applied after the maps `placed`.

    times  : (K,) float64 in seconds, increasing; the pose is constant before the first and after the last
    maps   : (K, 3, 4) float64, affine, last column the translation
    placed : (N, 3, 4) float64, map of each instance that is applied before the motion
    """

    times: Float64
    maps: Float64
    placed: Float64

    def at(self, time: float) -> Float64:
        """Return the (N, 3, 4) float64 affine maps from object to world at a time in seconds."""
        return followed_by(self.placed, self.map_at(time))

    def map_at(self, time: float) -> Float64:
        """Return the (3, 4) float64 affine map of the motion at a time in seconds; all instances share it.

        Before the first key it is that of the first key, after the last key that of the last.
        """
        last = len(self.times) - 1
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(last - 1, 0)))
        if last == 0 or time <= self.times[0]:
            return np.array(self.maps[0])
        if time >= self.times[last]:
            return np.array(self.maps[last])
        share = float((time - self.times[i]) / (self.times[i + 1] - self.times[i]))
        rotations, stretches, turns = self._parts
        linear = _rotation(share * turns[i]) @ rotations[i]
        linear = linear @ ((1 - share) * stretches[i] + share * stretches[i + 1])
        shift = (1 - share) * self.maps[i, :, 3] + share * self.maps[i + 1, :, 3]
        return np.column_stack([linear, shift])

    def moves_within(self, begin: float, end: float) -> bool:
        """Return True if the object moves between two times."""
        if end <= self.times[0] or begin >= self.times[-1] or begin >= end:
            return False
        first = max(0, int(np.searchsorted(self.times, begin, side="right")) - 1)
        last = int(np.searchsorted(self.times, end, side="left"))
        return bool(np.any(self.maps[first + 1 : last + 1] != self.maps[first]))

    @cached_property
    def _parts(self) -> tuple[Float64, Float64, Float64]:
        """Rotations and stretches (K, 3, 3) of the keys, and rotation vectors (K - 1, 3) from key to key."""
        u, sizes, v = np.linalg.svd(self.maps[:, :, :3])
        rotations = u @ v
        stretches = np.swapaxes(v, 1, 2) @ (sizes[:, :, None] * v)
        # A flat map has no unique rotation, and no rotation leads to a mirrored map. Such a key takes the rotation
        # of the regular key before it, or of the first regular key; its stretch is then not symmetric.
        regular, handedness = sizes[:, 2] > _FLAT * sizes[:, 0], np.linalg.det(rotations)
        first = int(np.argmax(regular))
        regular &= handedness * handedness[first] > 0
        if regular.any() and not regular.all():
            before = np.maximum.accumulate(np.where(regular, np.arange(len(regular)), first))[~regular]
            rotations[~regular] = rotations[before]
            stretches[~regular] = np.swapaxes(rotations[before], 1, 2) @ self.maps[~regular, :, :3]
        turns = [_turn(b @ a.T) for a, b in pairwise(rotations)]
        return rotations, stretches, np.array(turns).reshape(-1, 3)


def followed_by(world_from_object: Float64, motion: Float64) -> Float64:
    """Return affine maps (N, 3, 4) followed by `motion` (3, 4); the same array if `motion` is the identity."""
    if np.array_equal(motion, np.eye(3, 4)):
        return world_from_object
    moved = motion[:, :3] @ world_from_object
    moved[:, :, 3] += motion[:, 3]
    return np.asarray(moved)


def moved_plane(frame: Float64, motion: Float64) -> Float64:
    """Return the frame (3, 4) of a plane after an affine map `motion` (3, 4).

    The columns of a frame are u, v, the unit normal and a point, right-handed. A map that is not rigid changes the
    lengths of u and v, and the normal remains a unit vector perpendicular to both.
    """
    linear = motion[:, :3]
    u, v, normal, point = np.ascontiguousarray(frame.T)
    normal = np.linalg.inv(linear).T @ normal
    normal /= np.linalg.norm(normal)
    u, v = linear @ u, linear @ v
    u -= (u @ normal) * normal  # removes rounding errors
    v_length = np.linalg.norm(v - (v @ u) / (u @ u) * u)
    v = v_length * np.cross(normal, u / np.linalg.norm(u))
    return np.column_stack([u, v, normal, linear @ point + motion[:, 3]])


def _turn(rotation: Float64) -> Float64:
    """Return the (3,) rotation vector of a rotation (3, 3): its axis, times the angle in radians."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-6:
        return np.asarray(skew * (angle / sine))
    if cosine > 0:
        return np.asarray(skew)
    # Rotation by 180 degrees in either direction: R + I is twice the axis' outer product with itself.
    columns = 0.5 * (rotation + np.eye(3))
    axis = columns[:, int(np.argmax(np.diag(columns)))]
    return np.asarray(axis / np.linalg.norm(axis) * angle)


def _rotation(turn: Float64) -> Float64:
    """Return the (3, 3) rotation of a rotation vector [Rodrigues]."""
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))
