"""The BVH on the device for the rays of paths, which go in all directions and meet triangles alone.

One item a leaf, a triangle or two that are a parallelogram; one texel a node: its box in 16-bit steps of the
scene's, and either the node after its subtree or the leaf's item. The tree lies there eight times, for the eight
signs of a direction, the nearer child first, so that a ray finds its hit early and passes the rest by, without a
stack. Above `_MANY` triangles it lies there once.

Cost:     304 bytes a triangle, 80 above `_MANY`; building it, a second for 20,000 triangles.
Source:   Hachisuka 2015, Implementing a photorealistic rendering system using GLSL (multiple-threaded BVH);
          Moeller & Trumbore 1997.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh
from glpath.accel.sweep import SWEPT, sweep_bvh
from glpath.gl.device_scene import DeviceScene
from glpath.gl.moving import Refitting
from glpath.gl.texel_store import UINTS, StoreRows, make_store, store_glsl
from glpath.scene.model import Scene

#: The contents of a node's texel, and an item's. All are integers, coordinates as the bits of floats.
LAYOUT: dict[str, dict[str, str]] = {
    "ray_node": {
        "BOX": "x, y, z: lower corner in the low 16 bits, upper in the high ones; w: the node after its subtree, "
        "or LEAF_BIT and an item's number"
    },
    "ray_item": {
        "CORNER": "a corner; w: number of its triangle",
        "AB": "to the second corner; w: number of the triangle opposite, NO_TRIANGLE for none",
        "AC": "to the third; w: ITEM_ALPHA where a triangle has an opacity, ITEM_THIN_DIELECTRIC where it is one",
    },
}
_LEAF_BIT = np.uint32(1 << 31)
_NO_TRIANGLE = np.uint32(0xFFFFFFFF)
_ALPHA, _THIN_DIELECTRIC = 1, 2
_STEPS = 65535
# More in all the eight orders would be 64 MiB of nodes.
_MANY = 250_000


def ray_bvh_glsl() -> str:
    """The layout as GLSL, for `#include <RAY_BVH>`."""
    return (
        f"const uint LEAF_BIT = {int(_LEAF_BIT)}u;\nconst uint NO_TRIANGLE = {int(_NO_TRIANGLE)}u;\n"
        + f"const uint ITEM_ALPHA = {_ALPHA}u;\nconst uint ITEM_THIN_DIELECTRIC = {_THIN_DIELECTRIC}u;\n"
        + store_glsl("ray_bvh", UINTS, LAYOUT)
    )


class RayBvh:
    """The BVH over the triangles of a `DeviceScene`, which has nothing else.

    textures, uniforms, generated, defines : for programs that include ray_bvh.glsl
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene) -> None:
        # As the device has their corners, or neighbours far from the origin would not meet at an edge.
        triangles = scene.scene.triangles.astype(np.float32).astype(np.float64)
        paths = _paths(scene)
        items = _items(triangles, paths)
        tree = _tree(triangles, items)
        octants = 1 if len(triangles) > _MANY else 8
        grid = _Grid.of(tree, scene.moving.bounds if scene.moving else None)
        boxes = grid.steps(tree.lower, tree.upper)
        item_table = _item_table(triangles, items)
        flags = np.append(_flags(scene.scene), np.uint32(0))
        item_table[:, 2, 3] = flags[items[:, 0]] | flags[items[:, 1]]
        tables = {"ray_node": _node_table(tree, boxes, octants), "ray_item": item_table}
        texture, bases = make_store(gl, UINTS, LAYOUT, tables, scene.scene.source or scene.scene.name)
        self.textures = {"ray_bvh": texture}
        self.generated = {"RAY_BVH": ray_bvh_glsl()}
        self.defines: dict[str, object] = {}
        self.uniforms: dict[str, object] = {
            "ray_node_count": len(tree),
            "ray_octants": octants == 8,
            "ray_lower": tuple(map(float, grid.lower)),
            "ray_step": tuple(map(float, grid.step)),
            **bases,
        }
        if scene.moving is not None:
            self._moving = _MovingItems(texture, bases, tree, items, item_table, grid, octants, paths > 0)

    def move_to(self, triangles: NDArray[np.float64]) -> None:
        """Move the triangles (T, 3, 3) to another time; see `glpath.gl.moving`."""
        self._moving.move(triangles)


class _MovingItems:
    """The rows of the texture that change when triangles move."""

    def __init__(
        self,
        texture: moderngl.Texture,
        bases: dict[str, object],
        tree: Bvh,
        items: NDArray[np.int64],
        item_table: NDArray[np.uint32],
        grid: _Grid,
        octants: int,
        moved: NDArray[np.bool_],
    ) -> None:
        self._rows = StoreRows(texture, UINTS)
        self._grid, self._items, self._table = grid, items, item_table
        leaf_item = np.where(tree.count > 0, tree.order[np.minimum(tree.first, len(items) - 1)], -1).astype(
            np.int64
        )
        self._fit = Refitting(tree.lower, tree.upper, tree.skip, leaf_item, moved[items[:, 0]])
        base = int(bases["ray_node_base"])  # type: ignore[call-overload]
        nodes = self._fit.nodes
        self._row_numbers = [
            base + octant * len(tree) + _row_numbers(tree, octant)[nodes] for octant in range(octants)
        ]
        links = _node_table(tree, np.zeros((len(tree), 3), np.uint32), octants).reshape(-1, 4)
        self._links = [links[rows - base, 3] for rows in self._row_numbers]
        self._item_base = int(bases["ray_item_base"])  # type: ignore[call-overload]

    def move(self, triangles: NDArray[np.float64]) -> None:
        fit, which = self._fit, self._fit.items
        fit.refit(*_item_boxes(triangles, self._items[which]))
        boxes = self._grid.steps(fit.lower[fit.nodes], fit.upper[fit.nodes])
        for rows, links in zip(self._row_numbers, self._links, strict=True):
            self._rows.put(rows, np.column_stack([boxes, links]))
        table = _item_table(triangles, self._items[which])
        table[:, 2, 3] = self._table[which, 2, 3]
        numbers = self._item_base + 3 * which[:, None] + np.arange(3)
        self._rows.put(numbers.ravel(), table)
        self._rows.write()


def _paths(scene: DeviceScene) -> NDArray[np.int64]:
    """(T,): 0 for a triangle that stands still, else 1 and the number of the shape that it moves with."""
    of_shape = np.zeros(len(scene.scene.shapes), np.int64)
    if scene.moving is not None:
        moving = list(scene.moving.shapes)
        of_shape[moving] = np.array(moving) + 1
    return of_shape[scene.scene.triangle_shape]


@dataclass(frozen=True)
class _Grid:
    """The boxes' own space: origin and step (3,); boxes are so many steps larger than they are, for rounding."""

    lower: NDArray[np.float64]
    step: NDArray[np.float64]
    pad: NDArray[np.float64]

    @classmethod
    def of(cls, tree: Bvh, bounds: tuple[NDArray[np.float64], NDArray[np.float64]] | None) -> _Grid:
        """The grid of a tree, and of all that its items are moved through."""
        if not len(tree):
            return cls(np.zeros(3), np.ones(3), np.zeros(3))
        lower, upper = tree.lower[0], tree.upper[0]
        if bounds is not None:
            lower, upper = np.minimum(lower, bounds[0]), np.maximum(upper, bounds[1])
        far = max(float(np.abs([lower, upper]).max()), 1e-30)
        extent = np.maximum(upper - lower, max(1e-6 * float((upper - lower).max()), 1e-9 * far))
        # A ray's start is a float, which far from the origin is worth more than a step.
        pad = 1.0 + np.minimum(np.ceil(4 * 2.0**-24 * far * _STEPS / extent), _STEPS // 8)
        step = extent / (_STEPS - 2 * pad - 2)
        return cls(lower - (pad + 1) * step, step, pad)

    def steps(self, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.uint32]:
        """(M, 3) boxes, rounded outwards: the lower corner in the low 16 bits, the upper in the high ones."""
        low = np.clip(np.floor((lower - self.lower) / self.step - self.pad), 0, _STEPS).astype(np.uint32)
        high = np.clip(np.ceil((upper - self.lower) / self.step + self.pad), 0, _STEPS).astype(np.uint32)
        return np.asarray(low | high << np.uint32(16))


def _node_table(tree: Bvh, boxes: NDArray[np.uint32], octants: int) -> NDArray[np.uint32]:
    """(octants * M, 1, 4), the tree in as many orders."""
    count = len(tree)
    table = np.zeros((octants * count, 1, 4), np.uint32)
    leaf = tree.count > 0
    size = tree.skip - np.arange(count)
    for octant in range(octants):
        row = octant * count + _row_numbers(tree, octant)
        table[row, 0, :3] = boxes
        table[row, 0, 3] = row + size
        table[row[leaf], 0, 3] = _LEAF_BIT | tree.order[tree.first[leaf]].astype(np.uint32)
    return table


def _flags(scene: Scene) -> NDArray[np.uint32]:
    """(T,) uint32: of what lets light through."""
    materials = [scene.materials[shape.material] for shape in scene.shapes]
    of_shape = [_ALPHA * (m.alpha != "opaque") + _THIN_DIELECTRIC * m.is_thin_dielectric for m in materials]
    return np.array(of_shape, np.uint32)[scene.triangle_shape]


def _item_table(triangles: NDArray[np.float64], items: NDArray[np.int64]) -> NDArray[np.uint32]:
    """(N, 3, 4)."""
    first, opposite, k = items.T
    # From the corner that the other triangle lacks, where there is one.
    corner, b, c = (triangles[first, (k + i) % 3] for i in range(3))
    table = np.zeros((len(items), 3, 4), np.uint32)
    table[:, :, :3] = np.stack([corner, b - corner, c - corner], axis=1).astype(np.float32).view(np.uint32)
    table[:, 0, 3], table[:, 1, 3] = first, np.where(opposite < 0, _NO_TRIANGLE, opposite)
    return table


def _items(triangles: NDArray[np.float64], paths: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """(N, 3): a triangle; the one after it where both are a parallelogram, else -1; and which corner of the first
    the second lacks, else 0.

    Quads and boxes come as such pairs. Tested as one, they are half as many boxes and tests. Two that move
    apart are none: `paths` (T,) differ.
    """
    count = len(triangles)
    lacks = np.full(count, -1)  # of a triangle that is a parallelogram with the one after it
    if not count:
        return np.zeros((0, 3), np.int64)
    if count > 1:
        a, b = triangles[:-1], triangles[1:]
        size = np.ptp(a, axis=1).max(axis=1)[:, None, None]
        for k in range(3):
            p, s1, s2 = a[:, k], a[:, (k + 1) % 3], a[:, (k + 2) % 3]
            # The other has both corners opposite, and the one that completes the parallelogram.
            wanted = np.stack([s1, s2, s1 + s2 - p], axis=1)
            near = np.abs(wanted[:, :, None] - b[:, None]).max(axis=3) <= 1e-6 * size
            lacks[:-1][near.any(axis=2).all(axis=1) & near.any(axis=1).all(axis=1)] = k
        if paths is not None:
            lacks[:-1][paths[:-1] != paths[1:]] = -1
    pairs = lacks >= 0
    # In a run of triangles that are each a parallelogram with the next one, every other begins one.
    run = np.arange(count) - np.maximum.accumulate(np.where(pairs, -1, np.arange(count)))
    begins = pairs & (run % 2 == 1)
    ends = np.concatenate([[False], begins[:-1]])
    first = np.flatnonzero(~ends)
    return np.stack(
        [first, np.where(begins[first], first + 1, -1), np.where(begins[first], lacks[first], 0)], axis=1
    )


def _item_boxes(
    triangles: NDArray[np.float64], items: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lower, upper = triangles.min(axis=1), triangles.max(axis=1)
    first, second = items[:, 0], np.where(items[:, 1] < 0, items[:, 0], items[:, 1])
    return np.minimum(lower[first], lower[second]), np.maximum(upper[first], upper[second])


def _tree(triangles: NDArray[np.float64], items: NDArray[np.int64]) -> Bvh:
    lower, upper = _item_boxes(triangles, items)
    if len(items) <= SWEPT:
        return sweep_bvh(lower, upper)
    from glpath.accel.bvh import build_bvh  # with numba, which is slow to import

    return build_bvh(lower, upper, leaf_size=1)


def _row_numbers(tree: Bvh, octant: int) -> NDArray[np.int64]:
    """(M,): where nodes lie when of two children the one comes first that a direction of these signs meets first.

    octant : bit k set: component k of the direction is negative
    """
    count = len(tree)
    row = np.zeros(count, np.int64)
    size = tree.skip.astype(np.int64) - np.arange(count)
    sign = np.array([-1.0 if octant >> k & 1 else 1.0 for k in range(3)])
    middle = 0.5 * (tree.lower + tree.upper)
    level = np.flatnonzero(tree.count[:1] == 0)
    while len(level):
        left = level + 1
        right = tree.skip[left].astype(np.int64)
        apart = middle[right] - middle[left]
        # By the axis along which they lie furthest apart.
        axis = np.argmax(np.abs(apart), axis=1)
        swapped = np.take_along_axis(apart * sign, axis[:, None], axis=1)[:, 0] < 0
        first, second = np.where(swapped, right, left), np.where(swapped, left, right)
        row[first] = row[level] + 1
        row[second] = row[first] + size[first]
        children = np.concatenate([left, right])
        level = children[tree.count[children] == 0]
    return row
