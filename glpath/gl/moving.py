"""Moving objects while the shutter is open: their positions on the device at the time of a path set.

A path set has one time [PB 3.3], so scans of the path-buffer and rays always see a still scene. Between two sets
the vertices, normals and planes of moving shapes are written again. The BVH keeps its tree: the boxes of nodes
above moving triangles are recomputed from the leaves up (refitting). Their grid contains the whole motion.

Cost:     CPU work for each path set, about proportional to the number of moving triangles.
Poor at:  objects that end far from their position at the middle of the time, for which the tree is built.
Source:   Haeberli & Akeley 1990, The Accumulation Buffer; van den Bergen 1997, Efficient Collision Detection of
          Complex Deformable Models using AABB Trees, for refitting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.scene.model import Float64, Mesh, Scene, Shape, Shapes

# Number of times at which motion is sampled for the bounds. Between two samples, no point is taken to move farther
# than the longest step between samples.
_TIMES = 65
# Relative tolerance within which a moving emitter keeps its size, for rounding.
_RIGID = 1e-9


class MovingScene:
    """Scene of triangles with shapes that move while the shutter is open.

    scene  : the scene as given
    shapes : indices of the moving shapes
    middle : the scene at the middle of the shutter time, with its camera
    bounds : (3,) lower and (3,) upper corner of the box around the whole motion
    lamps  : True if a moving shape emits
    pose   : moving shapes, one after the other, at the time of `move_to`
    vertices, triangles : indices of the moving vertices and triangles, in the order of `pose`

    Raises SceneError if a moving emitter grows or shrinks.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.shapes = scene.moving_shapes
        opened, closed = scene.camera.shutter
        self.middle = scene.still(0.5 * (opened + closed))
        self.bounds = self._swept(np.linspace(opened, closed, _TIMES))
        moving = [scene.shapes[i] for i in self.shapes]
        self.lamps = any(shape.emits for shape in moving)
        self.pose = Shapes(())
        self.vertices = _numbers(_vertex_ranges(scene.shapes), self.shapes)
        self.triangles = _numbers(self.middle.shapes.ranges, self.shapes)
        self._corners = _rounded(self.middle.triangles)
        for shape in moving:
            if shape.emits and not _is_rigid(shape):
                raise SceneError(
                    f'{scene.source or scene.name}: the shape "{shape.name}" emits, and changes its size or form '
                    "as it moves; a lamp may only turn and go elsewhere.",
                    "Leave the scale out of its motion.",
                )

    def at(self, time: float) -> Scene:
        """Return the scene at a time, with an unchanged camera."""
        shapes = list(self.middle.shapes)
        for i in self.shapes:
            shapes[i] = self.scene.shapes[i].at(time)
        return replace(self.middle, shapes=Shapes(shapes))

    def move_to(self, time: float) -> None:
        """Move to another time, seconds."""
        self.pose = Shapes(self.scene.shapes[i].at(time) for i in self.shapes)

    def corners(self) -> Float64:
        """Return the corners (T, 3, 3) of all triangles at the time of `move_to`, rounded as on the device.

        The next call overwrites the same array.
        """
        self._corners[self.triangles] = _rounded(self.pose.triangles)
        return self._corners

    def _swept(self, times: Float64) -> tuple[Float64, Float64]:
        low, high = self.middle.bounds
        for shape in (self.scene.shapes[i] for i in self.shapes):
            assert isinstance(shape.geometry, Mesh), "a scene of triangles"
            assert shape.motion is not None, "of those that move"
            vertices = shape.geometry.vertices
            box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
            corners = box[np.arange(8)[:, None] >> np.arange(3) & 1, np.arange(3)]
            maps = np.array([shape.motion.at(time) for time in times])
            positions = np.einsum("tnij,kj->tnki", maps[..., :3], corners) + maps[:, :, None, :, 3]
            steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(initial=0.0)
            low = np.minimum(low, positions.min(axis=(0, 1, 2)) - steps)
            high = np.maximum(high, positions.max(axis=(0, 1, 2)) + steps)
        return low, high


def _vertex_ranges(shapes: Shapes) -> list[slice]:
    """Return the range of vertices of each triangle shape, over all its instances."""
    counts = [
        len(s.world_from_object) * len(s.geometry.vertices) if isinstance(s.geometry, Mesh) else 0 for s in shapes
    ]
    ends = np.cumsum(counts).tolist()
    return [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]


def _numbers(ranges: Sequence[slice], which: Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([np.arange(ranges[i].start, ranges[i].stop) for i in which])


def _rounded(triangles: Float64) -> Float64:
    return triangles.astype(np.float32).astype(np.float64)


def _is_rigid(shape: Shape) -> bool:
    assert shape.motion is not None
    linear = shape.motion.maps[:, :, :3]
    gram = np.einsum("kij,kil->kjl", linear, linear)
    return bool(np.abs(gram - gram[0]).max() <= _RIGID * np.abs(gram).max())


class Refitting:
    """Nodes of a tree whose boxes must be recomputed if some of its items move.

    tree  : binary tree with one item a leaf: lower and upper corners of boxes (M, 3), which are changed
    moved : (N,) bool, True for items that move
    """

    def __init__(
        self,
        lower: Float64,
        upper: Float64,
        skip: NDArray[np.int32],
        leaf_item: NDArray[np.int64],
        moved: NDArray[np.bool_],
    ) -> None:
        count = len(skip)
        self.lower, self.upper = lower.copy(), upper.copy()
        self._skip = skip.astype(np.int64)
        leaf = leaf_item >= 0
        changed = np.zeros(count, np.bool_)
        changed[leaf] = moved[leaf_item[leaf]]
        self.leaves = np.flatnonzero(changed)
        self.items = leaf_item[self.leaves]
        # Depth of a node: the number of subtrees that have begun, minus those that have ended.
        ended = np.cumsum(np.bincount(skip, minlength=count + 1)[:count])
        depth = np.arange(1, count + 1) - ended
        self._levels: list[NDArray[np.int64]] = []
        for level in range(int(depth.max(initial=0)), 0, -1):
            inner = np.flatnonzero((depth == level) & ~leaf)
            inner = inner[changed[inner + 1] | changed[self._skip[inner + 1]]]
            changed[inner] = True
            self._levels.append(inner)
        self.nodes = np.flatnonzero(changed)

    def refit(self, lower: Float64, upper: Float64) -> None:
        """Set the boxes of `leaves` (L, 3) and recompute those of all nodes above them."""
        self.lower[self.leaves], self.upper[self.leaves] = lower, upper
        for inner in self._levels:
            left = inner + 1
            right = self._skip[left]
            self.lower[inner] = np.minimum(self.lower[left], self.lower[right])
            self.upper[inner] = np.maximum(self.upper[left], self.upper[right])
