"""Objects that move while the shutter is open: where they are at the time of a path set, on the device.

A path set has one time [PB 3.3], so that a scene that stands still is all that scans and rays need to know. Between
two sets the vertices, normals and planes of what moves are written again, and the BVH keeps its tree: of the nodes
above what moves the boxes are made anew, from the leaves up (refitting), in the grid of all that is moved through.

Cost:     a path set more work on the CPU, about in proportion to the triangles that move.
Poor at:  objects that end far from where they were in the middle of the time, to which the tree is built.
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

# Times at which it is looked where everything is; between two nothing goes further than from one to the other.
_TIMES = 65
# A lamp's surface may grow by so much, of rounding.
_RIGID = 1e-9


class MovingScene:
    """A scene of triangles in which shapes move while the shutter is open.

    scene  : as it was given
    shapes : indices of the shapes that move
    middle : the scene as it stands in the middle of the time, with its camera
    bounds : (3,) lower and (3,) upper corner of the box around all that the triangles pass through
    lamps  : do any of them shine?
    pose   : those that move, one after the other, as they stand at the time of `move_to`
    vertices, triangles : numbers of theirs among all, in the order of `pose`

    Raises SceneError for a lamp that grows or shrinks.
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
        """The scene as it stands at a time, with the camera as it is."""
        shapes = list(self.middle.shapes)
        for i in self.shapes:
            shapes[i] = self.scene.shapes[i].at(time)
        return replace(self.middle, shapes=Shapes(shapes))

    def move_to(self, time: float) -> None:
        """Move to another time, seconds."""
        self.pose = Shapes(self.scene.shapes[i].at(time) for i in self.shapes)

    def corners(self) -> Float64:
        """(T, 3, 3), all triangles as the device has them now; the next call writes to the same array."""
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
    """The range of vertices of each shape of triangles, in all its instances."""
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
    """The nodes of a tree that have to be made anew when some of its items move.

    tree  : binary, an item a leaf: lower and upper corners of boxes (M, 3), which are changed
    moved : (N,) bool, of the items
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
        # The subtrees that a node lies in: all that have begun, less those that have ended.
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
        """Boxes of `leaves` (L, 3), and of all nodes above them."""
        self.lower[self.leaves], self.upper[self.leaves] = lower, upper
        for inner in self._levels:
            left = inner + 1
            right = self._skip[left]
            self.lower[inner] = np.minimum(self.lower[left], self.lower[right])
            self.upper[inner] = np.maximum(self.upper[left], self.upper[right])
