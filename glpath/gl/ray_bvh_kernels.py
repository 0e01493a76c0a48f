"""Compiled version (numba) of `glpath.gl.ray_bvh` with identical results, for large numbers of triangles.

The slots are never all in main memory: they are computed in ranges, as they are written to the device.

Cost:     building takes a second for two million triangles on two cores; 150 bytes a triangle during the build.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import build_in_threads
from glpath.accel.wide import WIDTH, WideBvh
from glpath.accel.wide_kernels import Nodes, collapse_compiled, octant_orders
from glpath.system.kernels import inner_kernel, kernel
from glpath.system.threads import in_threads

if TYPE_CHECKING:
    from glpath.gl.bvh_grid import Grid

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

# Constant cost of a node, added to the area of its box, as a multiple of the median area of an item's box. It saves
# a tenth of the memory; rays visit at most 0.5 % more nodes.
_FILLING = 2.0
# Number of items in the sample for the median box area.
_ASKED = 1 << 16
# Number of triangles that a thread takes at a time.
_CHUNK = 1 << 16


def compiled_items(vertices: Float32, faces: Int32, paths: NDArray[np.int64] | None) -> Int32:
    """Return (N, 3) items like `ray_bvh._items`, for faces (T, 3) of vertices (V, 3)."""
    lacks = np.empty(len(faces), np.int8)
    moves = np.zeros(0, np.int64) if paths is None else paths
    in_threads(len(faces), _CHUNK, lambda begin, end: _lacking(vertices, faces, moves, begin, end, lacks))
    items = np.empty((len(faces), 3), np.int32)
    return items[: _items(lacks, items)]


def compiled_tree(vertices: Float32, faces: Int32, items: Int32) -> WideBvh:
    """Build the tree over items, with 32-bit boxes, which are exact for 32-bit corners."""
    return tree_over(item_boxes(vertices, faces, items))


def item_boxes(vertices: Float32, faces: Int32, items: Int32) -> Float32:
    """Return (N, 6) lower and upper corners of the boxes around items."""
    boxes = np.empty((len(items), 6), np.float32)
    in_threads(len(items), _CHUNK, lambda begin, end: _item_boxes(vertices, faces, items, begin, end, boxes))
    return boxes


def tree_over(boxes: Float32) -> WideBvh:
    """Build the tree over boxes (N, 6), lower and upper corners. Reorders the array of boxes."""
    tree = build_in_threads(boxes)
    x, y, z = (boxes[:: max(1, len(boxes) // _ASKED), 3:] - boxes[:: max(1, len(boxes) // _ASKED), :3]).T
    return collapse_compiled(tree, _FILLING * float(np.median(x * y + y * z + z * x)))


class _WideNodes(NamedTuple):
    """Data of a `WideBvh` for the kernels: its children, `number`, and orders (W, 8) of `octant_orders`."""

    children: NDArray[Any]
    number: Int32
    orders: NDArray[np.uint8]


class _Geometry(NamedTuple):
    """Geometry for the kernels: vertices (V, 3), faces (T, 3), items (N, 3) and flags (T,) of the triangles."""

    vertices: Float32
    faces: Int32
    items: Int32
    flags: NDArray[np.uint8]


class CompiledSlots:
    """Slots of a tree like those of `ray_bvh.Slots.table`, computed on request in ranges.

    nodes : (W, 4, 4) uint32, slots of the wide nodes
    lanes : (W, 4) children of the wide nodes: a node's number, -2 - an item's number, -1 for none

    geometry : vertices (V, 3), faces (T, 3), items (N, 3)
    flags    : (T,) uint8, flags of the triangles

    The tree itself is not stored.
    """

    def __init__(
        self, wide: WideBvh, grid: Grid, geometry: tuple[Float32, Int32, Int32], flags: NDArray[np.uint8]
    ) -> None:
        self._geometry = _Geometry(*geometry, flags)
        self.nodes, self.lanes = np.zeros((len(wide), 4, 4), np.uint32), np.empty((len(wide), WIDTH), np.int32)
        tree, steps = wide.tree, np.stack([grid.lower, grid.step, grid.pad])
        nodes = Nodes.of(tree), _WideNodes(wide.children, wide.number, octant_orders(wide))
        in_threads(
            len(wide), _CHUNK, lambda begin, end: _fill_nodes(*nodes, steps, self.nodes, self.lanes, begin, end)
        )
        self.shape = (WIDTH * (len(wide) + 1), 4, 4)

    def __getitem__(self, which: slice) -> NDArray[np.uint32]:
        """Return the slots in a range of whole groups."""
        begin, end, step = which.indices(self.shape[0])
        assert (step, begin % WIDTH, end % WIDTH) == (1, 0, 0), "whole groups"
        slots = np.zeros((max(end - begin, 0), 4, 4), np.uint32)
        _fill(self.nodes, self.lanes, self._geometry, slots, slots.view(np.float32), begin // WIDTH)
        return slots


@kernel
def _lacking(vertices, faces, paths, begin, end, lacks):  # type: ignore[no-untyped-def]
    """For triangles `begin` to `end`: if one forms a parallelogram with the next, its corner that the next lacks.

    Otherwise the corner is -1.
    """
    for i in range(begin, end):
        lacks[i] = -1
        if i + 1 == len(faces) or (len(paths) and paths[i] != paths[i + 1]):
            continue
        size = 0.0
        for axis in range(3):
            a, b, c = (
                np.float64(vertices[faces[i, 0], axis]),
                np.float64(vertices[faces[i, 1], axis]),
                np.float64(vertices[faces[i, 2], axis]),
            )
            size = max(size, max(a, b, c) - min(a, b, c))
        for k in range(3):
            p, s1, s2 = faces[i, k], faces[i, (k + 1) % 3], faces[i, (k + 2) % 3]
            # The next triangle must have the corners s1, s2 and the parallelogram's fourth corner. `wanted` has a
            # bit for each of these that the next triangle has, `own` a bit for each of its corners that is among
            # these.
            wanted, own = 0, 0
            for corner in range(3):
                q = faces[i + 1, corner]
                first = second = fourth = True
                for axis in range(3):
                    x, y = np.float64(vertices[s1, axis]), np.float64(vertices[s2, axis])
                    at = np.float64(vertices[q, axis])
                    first = first and bool(abs(x - at) <= 1e-6 * size)
                    second = second and bool(abs(y - at) <= 1e-6 * size)
                    fourth = fourth and bool(abs(x + y - vertices[p, axis] - at) <= 1e-6 * size)
                wanted |= first | second << 1 | fourth << 2
                own |= (first or second or fourth) << corner
            if wanted == 7 and own == 7:
                lacks[i] = k


@kernel
def _items(lacks, items):  # type: ignore[no-untyped-def]
    """Fill the items and return their number. In a run of overlapping pairs, every other pair is taken."""
    count, i = 0, 0
    while i < len(lacks):
        pair = lacks[i] >= 0
        items[count, 0], items[count, 1], items[count, 2] = i, i + 1 if pair else -1, lacks[i] if pair else 0
        i += 2 if pair else 1
        count += 1
    return count


@kernel
def _item_boxes(vertices, faces, items, begin, end, boxes):  # type: ignore[no-untyped-def]
    for i in range(begin, end):
        for axis in range(3):
            boxes[i, axis], boxes[i, axis + 3] = np.inf, -np.inf
        for half in range(2):
            triangle = items[i, half]
            if triangle < 0:
                continue
            for corner in range(3):
                for axis in range(3):
                    x = vertices[faces[triangle, corner], axis]
                    boxes[i, axis], boxes[i, axis + 3] = min(boxes[i, axis], x), max(boxes[i, axis + 3], x)


@kernel
def _fill_nodes(tree, wide_nodes, steps, nodes, lanes, begin, end):  # type: ignore[no-untyped-def]
    """Fill nodes and lanes `begin` to `end`. steps: lower corner, step and pad of the grid."""
    lower, upper, first, count, order = tree.lower, tree.upper, tree.first, tree.items, tree.order
    children, number, orders = wide_nodes.children, wide_nodes.number, wide_nodes.orders
    for wide in range(begin, end):
        bits = 0
        for lane in range(WIDTH):
            child = children[wide, lane]
            if child < 0:
                lanes[wide, lane] = -1
                continue
            if count[child]:
                bits |= 16 << lane
                lanes[wide, lane] = -2 - order[first[child]]
            else:
                bits |= 1 << lane
                lanes[wide, lane] = number[child]
            for axis in range(3):
                low = np.floor((lower[child, axis] - steps[0, axis]) / steps[1, axis] - steps[2, axis])
                high = np.ceil((upper[child, axis] - steps[0, axis]) / steps[1, axis] + steps[2, axis])
                low, high = min(max(low, 0.0), 65535.0), min(max(high, 0.0), 65535.0)
                nodes[wide, axis, lane] = int(low) | int(high) << 16
        nodes[wide, 3, 0] = 256 * (wide + 1) + bits
        for half in range(2):
            word = 0
            for i in range(4):
                word |= orders[wide, 4 * half + i] << (8 * i)
            nodes[wide, 3, 1 + half] = word


@kernel
def _fill(nodes, lanes, geometry, slots, floats, group):  # type: ignore[no-untyped-def]
    """Fill slots, starting with the first slot of a group. `floats` is a float view of the same memory."""
    for at in range(len(slots)):
        # Group 0 has only the root, in its first slot. Group g has the children of wide node g - 1.
        parent = group + at // WIDTH - 1
        child = lanes[parent, at % WIDTH] if parent >= 0 else (0 if at == 0 else -1)
        if child >= 0:
            for i in range(4):
                for j in range(4):
                    slots[at, i, j] = nodes[child, i, j]
        elif child < -1:
            _fill_item(geometry, -2 - child, at, slots, floats)


@inner_kernel
def _fill_item(geometry, item, at, slots, floats):  # type: ignore[no-untyped-def]
    vertices, faces, items, flags = geometry.vertices, geometry.faces, geometry.items, geometry.flags
    one, other, k = items[item, 0], items[item, 1], items[item, 2]
    a, b, c = faces[one, k], faces[one, (k + 1) % 3], faces[one, (k + 2) % 3]
    for axis in range(3):
        corner = np.float64(vertices[a, axis])
        floats[at, 0, axis] = corner
        floats[at, 1, axis] = vertices[b, axis] - corner
        floats[at, 2, axis] = vertices[c, axis] - corner
    slots[at, 0, 3] = one
    slots[at, 1, 3] = np.uint32(0xFFFFFFFF) if other < 0 else np.uint32(other)
    slots[at, 2, 3] = flags[one] | (flags[other] if other >= 0 else np.uint8(0))
