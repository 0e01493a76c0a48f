"""How a rigid object moves: keys, between which it is turned, stretched and shifted evenly.

A map between two keys is parted into a rotation and a stretch, by the polar decomposition; the rotation goes the
shorter arc about one axis at one speed, stretch and position change linearly. So a wheel needs
more than two keys a turn.

Source: Shoemake & Duff 1992, Matrix Animation and Polar Decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the instances of a shape are at a time: a map follows the ones of `placed`.

    times  : (K,) float64, seconds, each later than the one before; held before the first and after the last
    maps   : (K, 3, 4) float64, affine, last column the translation; none of them mirrors or flattens
    placed : (N, 3, 4) float64, of each instance, what the maps follow
    """

    times: Float64
    maps: Float64
    placed: Float64

    def at(self, time: float) -> Float64:
        """(N, 3, 4) float64, world from object at a time, seconds."""
        return followed_by(self.placed, self.map_at(time))

    def map_at(self, time: float) -> Float64:
        """(3, 4) float64, that of all instances at a time."""
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
        """Does it move between two times?"""
        if end <= self.times[0] or begin >= self.times[-1] or begin >= end:
            return False
        first = max(0, int(np.searchsorted(self.times, begin, side="right")) - 1)
        last = int(np.searchsorted(self.times, end, side="left"))
        return bool(np.any(self.maps[first + 1 : last + 1] != self.maps[first]))

    @cached_property
    def _parts(self) -> tuple[Float64, Float64, Float64]:
        """(K, 3, 3) rotations and stretches of the keys, (K - 1, 3) the turn from each to the next one."""
        u, sizes, v = np.linalg.svd(self.maps[:, :, :3])
        rotations = u @ v
        stretches = np.swapaxes(v, 1, 2) @ (sizes[:, :, None] * v)
        turns = [_turn(b @ a.T) for a, b in pairwise(rotations)]
        return rotations, stretches, np.array(turns).reshape(-1, 3)


def followed_by(world_from_object: Float64, motion: Float64) -> Float64:
    """(N, 3, 4) maps, and then one (3, 4) more; themselves where that is the identity."""
    if np.array_equal(motion, np.eye(3, 4)):
        return world_from_object
    moved = motion[:, :3] @ world_from_object
    moved[:, :, 3] += motion[:, 3]
    return np.asarray(moved)


def _turn(rotation: Float64) -> Float64:
    """(3,) an axis, as long as the angle about it in radians, of a rotation (3, 3)."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-6:
        return np.asarray(skew * (angle / sine))
    if cosine > 0:
        return np.asarray(skew)
    # Half a turn, of either sense: R + I is twice the product of the axis with itself.
    columns = 0.5 * (rotation + np.eye(3))
    axis = columns[:, int(np.argmax(np.diag(columns)))]
    return np.asarray(axis / np.linalg.norm(axis) * angle)


def _rotation(turn: Float64) -> Float64:
    """(3, 3) of an axis as long as the angle [Rodrigues]."""
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))
