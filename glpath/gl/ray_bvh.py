"""BVH on the device for the rays of paths, which have arbitrary directions and hit only triangles.

The tree has up to four children a node. Boxes are in 16-bit steps of the scene's box. Each node stores the order in
which rays of each octant of directions visit its children. A leaf holds one item: a triangle, or two that form a
parallelogram. Nodes and items lie in slots of the same size. The children of a node are four adjacent slots, called
a group. A ray therefore stores only a group's number and a bit for each unvisited child.

Cost:     some 100 bytes a triangle. Building takes half a second for 20,000 triangles; for many, compiled code
          takes a second for two million on two cores.
Source:   Wald, Benthin & Boulos 2008, Getting rid of packets; Ylitie, Karras & Laine 2017, Efficient incoherent ray
          traversal on GPUs through compressed wide BVHs; Moeller & Trumbore 1997.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh
from glpath.accel.sweep import SWEPT, sweep_bvh
from glpath.accel.wide import WIDTH, WideBvh, collapse
from glpath.gl.bvh_grid import ITEM_ALPHA, ITEM_THIN_DIELECTRIC, Grid, triangle_flags
from glpath.gl.device_scene import DeviceScene
from glpath.gl.moving import Refitting
from glpath.gl.texel_store import UINTS, Rows, StoreRows, make_store, store_glsl
from glpath.gl.texel_store import WIDTH as STORE_WIDTH
from glpath.gl.variants import defined
from glpath.system.time_limit import check_time, named_work

#: Contents of a slot. All values are integers; coordinates of corners are the bits of floats.
LAYOUT: dict[str, dict[str, str]] = {
    "ray_slot": {
        "X": "of a node: by child the lower bound in the low 16 bits, the upper in the high ones; of an item: a "
        "corner; w: number of its triangle",
        "Y": "of an item: to the second corner; w: number of the triangle opposite, NO_TRIANGLE for none",
        "Z": "of an item: to the third; w: ITEM_ALPHA where a triangle has an opacity, ITEM_THIN_DIELECTRIC where "
        "it is one",
        "LINK": "of a node: x: 256 times the number of its children's group, 16 times a bit for each that is an "
        "item, and a bit for each that is a node; y, z: for each octant of directions 8 bits, the children in the "
        "order in which a ray meets them",
    },
}
_NO_TRIANGLE = np.uint32(0xFFFFFFFF)
# Number of groups that one 32-bit word of a ray can address, beside the bits of the children and their order.
_NEAR_GROUPS = 1 << 20
# Minimum number of triangles for which compiled code builds the tree; its first use takes some seconds of
# compiling.
_MANY = 200_000
# Stack sizes are rounded up to multiples of this, so that trees of similar depth share programs.
_STACKS = 4


def ray_bvh_glsl(stack: int) -> str:
    """Return the layout as GLSL, for `#include <RAY_BVH>`. stack: maximum number of groups on a ray's stack."""
    return (
        f"const uint NO_TRIANGLE = {int(_NO_TRIANGLE)}u;\nconst int RAY_STACK = {stack};\n"
        + f"const uint ITEM_ALPHA = {ITEM_ALPHA}u;\nconst uint ITEM_THIN_DIELECTRIC = {ITEM_THIN_DIELECTRIC}u;\n"
        + store_glsl("ray_bvh", UINTS, LAYOUT)
        + _SLOT_AT
    )


# GLSL function that returns the position of the first of a slot's four texels. These lie in one row of the texture.
_SLOT_AT = f"""ivec2 ray_slot_at(int slot)
{{
    int i = 4 * slot;
    return ivec2(i & {STORE_WIDTH - 1}, i >> {STORE_WIDTH.bit_length() - 1});
}}
"""


class RayBvh:
    """BVH over the triangles of a `DeviceScene` that has no other primitives.

    textures, uniforms, generated, defines : inputs of programs that include ray_bvh.glsl
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene) -> None:
        moving: _Built | None = None
        table: Rows
        of_meshes: dict[str, object] = {}
        if scene.instances is not None:
            from glpath.gl.instance_bvh import InstanceBvh  # late, because numba is slow to import

            trees = InstanceBvh.of(scene.instances)
            grid, table, stack, of_meshes = trees.grid, trees.table, trees.stack, trees.uniforms
            del trees
        else:
            build = _compiled if len(scene.scene.shapes.faces) >= _MANY else _interpreted
            with named_work("building the BVH"):
                built = build(scene, _paths(scene))
            grid, table, stack = built.grid, built.table, built.wide.stack
            moving = built if scene.moving is not None else None
            del built  # frees a hundred bytes a triangle before the slots are written
        texture = self._put(gl, grid, table, stack, scene.scene.source or scene.scene.name)
        self.uniforms |= of_meshes
        if moving is not None:
            self._moving = _MovingItems(texture, scene, moving)

    def _put(self, gl: moderngl.Context, grid: Grid, table: Rows, stack: int, source: str) -> moderngl.Texture:
        self.generated = {"RAY_BVH": ray_bvh_glsl(max(_STACKS, -(-stack // _STACKS) * _STACKS))}
        self.defines = defined(HAS_FAR_NODES=table.shape[0] // WIDTH - 1 >= _NEAR_GROUPS)
        texture, bases = make_store(gl, UINTS, LAYOUT, {"ray_slot": table}, source)
        self.textures = {"ray_bvh": texture}
        self.uniforms: dict[str, object] = {
            "ray_lower": tuple(map(float, grid.lower)),
            "ray_step": tuple(map(float, grid.step)),
            **bases,
        }
        return texture

    def move_to(self, triangles: NDArray[np.float64]) -> None:
        """Move the triangles to their corners (T, 3, 3) at another time; see `glpath.gl.moving`."""
        self._moving.move(triangles)


class PartBvh(RayBvh):
    """BVH over part of the streamed triangles, which no `DeviceScene` contains; they are opaque and static.

    corners  : (T, 3, 3) float32
    chunk    : (T,) number of each triangle's chunk. Triangles of two chunks never form an item, so that hits do not
               depend on the chunks in the part
    far      : maximum absolute coordinate of a ray's start
    compiled : True to build with compiled code
    source   : scene name for error messages
    """

    def __init__(
        self,
        gl: moderngl.Context,
        corners: NDArray[np.float32],
        chunk: NDArray[np.int64],
        far: float,
        compiled: bool,
        source: str,
    ) -> None:
        flags = np.zeros(len(corners), np.uint8)
        table: Rows
        if compiled:
            from glpath.gl.ray_bvh_kernels import CompiledSlots, compiled_items, compiled_tree

            vertices = corners.reshape(-1, 3)
            faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
            items = compiled_items(vertices, faces, chunk)
            wide = compiled_tree(vertices, faces, items)
        else:
            triangles = corners.astype(np.float64)
            of_pairs = _items(triangles, chunk)
            wide = collapse(_tree(triangles, of_pairs))
        lower, upper = (corner.astype(np.float64) for corner in (wide.tree.lower[0], wide.tree.upper[0]))
        grid = Grid.around(lower, upper, far)
        if compiled:
            table = CompiledSlots(wide, grid, (vertices, faces, items), flags)
        else:
            slots = _item_table(triangles, of_pairs, flags)
            table = Slots.of(wide).table(grid.steps(wide.tree.lower, wide.tree.upper), slots)
        self._put(gl, grid, table, wide.stack, source)


def _interpreted(scene: DeviceScene, paths: NDArray[np.int64]) -> _Built:
    """Build the tree with numpy, which takes less time for small scenes than importing numba."""
    # Corners are rounded as on the device; otherwise neighbours far from the origin would not share an edge.
    triangles = scene.scene.triangles.astype(np.float32).astype(np.float64)
    items = _items(triangles, paths)
    check_time()
    tree = _tree(triangles, items)
    check_time()
    wide = collapse(tree)
    grid = _grid(wide.tree, scene)
    check_time()
    slots = Slots.of(wide)
    check_time()
    table = _item_table(triangles, items, triangle_flags(scene.scene))
    return _Built(items, wide, grid, slots.table(grid.steps(wide.tree.lower, wide.tree.upper), table))


def _compiled(scene: DeviceScene, paths: NDArray[np.int64]) -> _Built:
    from glpath.gl.ray_bvh_kernels import CompiledSlots, compiled_items, compiled_tree

    shapes = scene.scene.shapes
    vertices, faces = shapes.vertices.astype(np.float32), np.ascontiguousarray(shapes.faces, np.int32)
    check_time()
    items = compiled_items(vertices, faces, paths)
    check_time()
    wide = compiled_tree(vertices, faces, items)
    grid = _grid(wide.tree, scene)
    return _Built(
        items, wide, grid, CompiledSlots(wide, grid, (vertices, faces, items), triangle_flags(scene.scene))
    )


class _Built(NamedTuple):
    """Tree that was built on the CPU, and the slots that hold its nodes and items on the device.

    items : (N, 3) triangles of the leaves, as returned by `_items`
    wide  : tree with up to four children a node
    grid  : grid of the boxes' integer coordinates
    table : contents of the slots, see `LAYOUT`
    """

    items: NDArray[Any]
    wide: WideBvh
    grid: Grid
    table: Rows


@dataclass(frozen=True)
class Slots:
    """Slots of a tree's nodes and items.

    The root has slot 0 of the first group, whose other slots are empty. A group of children follows for each wide
    node.

    of_node : (W,) slots of the wide nodes
    of_item : (N,) slots of the items
    """

    wide: WideBvh
    of_node: NDArray[np.int64]
    of_item: NDArray[np.int64]

    @classmethod
    def of(cls, wide: WideBvh) -> Slots:
        """Assign slots to the nodes and items of a tree."""
        tree = wide.tree
        slot = WIDTH * (np.arange(len(wide))[:, None] + 1) + np.arange(WIDTH)
        of_node, of_item = np.zeros(len(wide), np.int64), np.zeros(len(tree.order), np.int64)
        of_node[wide.number[wide.children[wide.is_inner]]] = slot[wide.is_inner]
        of_item[tree.order[tree.first[wide.children[wide.is_leaf]]]] = slot[wide.is_leaf]
        return cls(wide, of_node, of_item)

    def table(self, boxes: NDArray[np.uint32], items: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return (4 (W + 1), 4, 4) slots, from boxes (M, 3) of the binary tree and items (N, 3, 4)."""
        table = np.zeros((WIDTH * (len(self.wide) + 1), 4, 4), np.uint32)
        if len(self.wide):
            table[self.of_node, :3] = self.children_boxes(boxes, np.arange(len(self.wide)))
            table[self.of_node, 3] = self._links()
            table[self.of_item, :3] = items
        return table

    def children_boxes(self, boxes: NDArray[np.uint32], nodes: NDArray[np.int64]) -> NDArray[np.uint32]:
        """Return (n, 3, 4) packed bounds of the children's boxes of wide nodes, for each axis."""
        children = self.wide.children[nodes]
        found = np.where(children[:, :, None] >= 0, boxes[children], np.uint32(0))
        return np.asarray(found.transpose(0, 2, 1))

    def _links(self) -> NDArray[np.uint32]:
        wide, bits = self.wide, 1 << np.arange(WIDTH)
        links = np.zeros((len(wide), 4), np.uint32)
        links[:, 0] = 256 * (np.arange(len(wide)) + 1) + (wide.is_leaf * 16 * bits).sum(axis=1)
        links[:, 0] += (wide.is_inner * bits).sum(axis=1).astype(np.uint32)
        for octant in range(8):
            check_time()
            order = (wide.order(octant) << (2 * np.arange(WIDTH))).sum(axis=1).astype(np.uint32)
            links[:, 1 + octant // 4] |= order << np.uint32(8 * (octant % 4))
        return links


class _MovingItems:
    """Updates of the texture's rows that change when triangles move."""

    def __init__(
        self,
        texture: moderngl.Texture,
        scene: DeviceScene,
        built: _Built,
    ) -> None:
        items, wide = built.items, built.wide
        self._rows = StoreRows(texture, UINTS)
        self._grid, self._items, self._flags = built.grid, items, triangle_flags(scene.scene)
        self._slots, tree = Slots.of(wide), wide.tree
        moved = _paths(scene) > 0
        leaf_item = np.where(tree.count > 0, tree.order[np.minimum(tree.first, len(items) - 1)], -1).astype(
            np.int64
        )
        self._fit = Refitting(tree.lower, tree.upper, tree.skip, leaf_item, moved[items[:, 0]])
        changed = np.zeros(len(tree), np.bool_)
        changed[self._fit.nodes] = True
        self._nodes = np.flatnonzero((changed[wide.children] & wide.present).any(axis=1))

    def move(self, triangles: NDArray[np.float64]) -> None:
        fit, which = self._fit, self._fit.items
        fit.refit(*_item_boxes(triangles, self._items[which]))
        boxes = self._grid.steps(fit.lower, fit.upper)
        table = _item_table(triangles, self._items[which], self._flags)
        self._put(self._slots.of_node[self._nodes], self._slots.children_boxes(boxes, self._nodes))
        self._put(self._slots.of_item[which], table)
        self._rows.write()

    def _put(self, slots: NDArray[np.int64], texels: NDArray[np.uint32]) -> None:
        """Put the first three texels (n, 3, 4) of slots."""
        self._rows.put((4 * slots[:, None] + np.arange(3)).ravel(), texels)


def _paths(scene: DeviceScene) -> NDArray[np.int64]:
    """Return (T,): 0 for a static triangle, otherwise 1 + the number of the shape that it moves with."""
    of_shape = np.zeros(len(scene.scene.shapes), np.int64)
    if scene.moving is not None:
        moving = list(scene.moving.shapes)
        of_shape[moving] = np.array(moving) + 1
    return of_shape[scene.scene.triangle_shape]


def _grid(tree: Bvh, scene: DeviceScene) -> Grid:
    """Return the grid over the items of a scene and their whole motion."""
    if not len(tree):
        return Grid(np.zeros(3), np.ones(3), np.zeros(3))
    lower, upper = tree.lower[0].astype(np.float64), tree.upper[0].astype(np.float64)
    if scene.moving is not None:
        low, high = scene.moving.bounds
        lower, upper = np.minimum(lower, low), np.maximum(upper, high)
    return Grid.around(lower, upper, float(np.abs([lower, upper]).max()))


def _item_table(
    triangles: NDArray[np.float64], items: NDArray[Any], flags: NDArray[np.uint8]
) -> NDArray[np.uint32]:
    """Return (N, 3, 4) texels of items. flags: (T,) flags of the triangles."""
    first, opposite, k = items.T
    # Start at the corner that the other triangle of the pair lacks, if the item is a pair.
    corner, b, c = (triangles[first, (k + i) % 3] for i in range(3))
    table = np.zeros((len(items), 3, 4), np.uint32)
    table[:, :, :3] = np.stack([corner, b - corner, c - corner], axis=1).astype(np.float32).view(np.uint32)
    table[:, 0, 3], table[:, 1, 3] = first, np.where(opposite < 0, _NO_TRIANGLE, opposite)
    table[:, 2, 3] = flags[first] | np.where(opposite < 0, 0, flags[opposite])
    return table


def _items(triangles: NDArray[np.float64], paths: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """Return (N, 3) items: a triangle, its partner, and the corner of the triangle that the partner lacks.

    The partner is the next triangle if both form a parallelogram; otherwise it is -1 and the corner 0. Quads and
    boxes consist of such pairs. As pairs they need half as many boxes and tests. Triangles with different motions,
    whose `paths` (T,) differ, form no pair.
    """
    count = len(triangles)
    lacks = np.full(count, -1)  # corner that the next triangle lacks, if both form a parallelogram
    if not count:
        return np.zeros((0, 3), np.int64)
    if count > 1:
        a, b = triangles[:-1], triangles[1:]
        size = np.ptp(a, axis=1).max(axis=1)[:, None, None]
        for k in range(3):
            check_time()
            p, s1, s2 = a[:, k], a[:, (k + 1) % 3], a[:, (k + 2) % 3]
            # The other triangle must have the corners s1 and s2, and the corner that completes the parallelogram.
            wanted = np.stack([s1, s2, s1 + s2 - p], axis=1)
            near = np.abs(wanted[:, :, None] - b[:, None]).max(axis=3) <= 1e-6 * size
            lacks[:-1][near.any(axis=2).all(axis=1) & near.any(axis=1).all(axis=1)] = k
        if paths is not None:
            lacks[:-1][paths[:-1] != paths[1:]] = -1
    pairs = lacks >= 0
    # In a run of triangles that each form a parallelogram with the next, every other one starts a pair.
    run = np.arange(count) - np.maximum.accumulate(np.where(pairs, -1, np.arange(count)))
    begins = pairs & (run % 2 == 1)
    ends = np.concatenate([[False], begins[:-1]])
    first = np.flatnonzero(~ends)
    return np.stack(
        [first, np.where(begins[first], first + 1, -1), np.where(begins[first], lacks[first], 0)], axis=1
    )


def _item_boxes(
    triangles: NDArray[np.float64], items: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lower, upper = triangles.min(axis=1), triangles.max(axis=1)
    first, second = items[:, 0], np.where(items[:, 1] < 0, items[:, 0], items[:, 1])
    return np.minimum(lower[first], lower[second]), np.maximum(upper[first], upper[second])


def _tree(triangles: NDArray[np.float64], items: NDArray[np.int64]) -> Bvh:
    lower, upper = _item_boxes(triangles, items)
    if len(items) <= SWEPT:
        return sweep_bvh(lower, upper)
    from glpath.accel.bvh import build_bvh  # late, because numba is slow to import

    return build_bvh(lower, upper, leaf_size=1)
