"""Two-level BVH of a scene with instances: a tree for each instanced mesh, and one over instances and triangles.

All trees have the format of `ray_bvh`, in one table of slots, the world's tree first. In the world's tree, an
instance has a slot among the nodes. The slot holds the transform to the mesh's space and the root group of the
mesh's tree. A ray recognises it because it has no children. The trees of meshes share one grid of steps, because
all meshes have about the same size in their spaces (`glpath.scene.instances`). Compiled code builds the trees.

Cost:     64 bytes an instance, in addition to the trees.
Poor at:  instances whose boxes overlap, because a ray enters all of these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.accel.wide import WIDTH
from glpath.gl.bvh_grid import Grid, triangle_flags
from glpath.gl.instance_numbers import InstanceNumbers
from glpath.gl.ray_bvh_kernels import CompiledSlots, compiled_items, item_boxes, tree_over
from glpath.scene.instances import InstancedScene

Float64 = NDArray[np.float64]
Uint32 = NDArray[np.uint32]

# Half the size of a mesh in its own space.
_HALF = 0.5
# Number of stack entries that a ray needs when it enters an instance: one for the rest of the current group, and
# one that marks where the ray returns to world space.
_ENTERING = 2


@dataclass(frozen=True)
class InstanceBvh:
    """Two-level BVH in the form for the device.

    grid     : grid of the world's boxes
    table    : slots of all trees
    stack    : maximum number of groups on a ray's stack
    uniforms : uniforms of the grid of the meshes' boxes
    """

    grid: Grid
    table: _Slots
    stack: int
    uniforms: dict[str, object]

    @classmethod
    def of(cls, numbers: InstanceNumbers) -> InstanceBvh:
        """Build the trees of a scene."""
        instances, resident = numbers.instances, numbers.instances.resident
        shapes, flags = resident.shapes, triangle_flags(resident)
        vertices, faces = shapes.vertices.astype(np.float32), np.ascontiguousarray(shapes.faces, np.int32)
        of_triangle = instances.mesh_of_triangle
        items = compiled_items(vertices, faces, of_triangle.astype(np.int64))
        mesh_of_item = of_triangle[items[:, 0]]
        inverse = np.asarray(np.linalg.inv(instances.world_from_mesh[:, :, :3]), np.float64)
        mesh_grid = _mesh_grid(inverse, instances)

        loose = np.ascontiguousarray(items[mesh_of_item == 0])
        # Boxes of instances have 32 bits, rounded outwards so that they become no smaller.
        lower, upper = (corner.astype(np.float32) for corner in instances.boxes)
        boxes = np.column_stack([np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)])
        wide = tree_over(np.concatenate([item_boxes(vertices, faces, loose), boxes.astype(np.float32)]))
        low, high = wide.tree.lower[0].astype(np.float64), wide.tree.upper[0].astype(np.float64)
        grid = Grid.around(low, high, float(np.abs([low, high]).max()))
        world = CompiledSlots(wide, grid, (vertices, faces, loose), flags)

        parts, stacks, groups = [world], [], [0, world.shape[0] // WIDTH]
        for number in range(len(instances.mesh_shape)):
            of_mesh = np.ascontiguousarray(items[mesh_of_item == 1 + number])
            tree = tree_over(item_boxes(vertices, faces, of_mesh))
            parts.append(CompiledSlots(tree, mesh_grid, (vertices, faces, of_mesh), flags))
            stacks.append(tree.stack)
            groups.append(groups[-1] + parts[-1].shape[0] // WIDTH)
        entries = _instance_slots(instances, inverse, np.array(groups[1:-1])[instances.mesh], numbers.more)
        at = _taken_by_instances(world, len(loose))
        return cls(
            grid,
            _Slots(parts, np.array(groups), *_in_order(at, entries)),
            wide.stack + _ENTERING + max(stacks),
            {"mesh_grid": (float(mesh_grid.lower[0]), float(mesh_grid.step[0]))},
        )


def _mesh_grid(inverse: Float64, instances: InstancedScene) -> Grid:
    """Return the grid of all meshes, padded for distant rays, whose starts have a large rounding error there."""
    lower, upper = instances.given.bounds
    stretch = float(np.linalg.norm(inverse, ord=2, axis=(1, 2)).max())
    half = np.full(3, _HALF)
    return Grid.around(-half, half, 2.0 * stretch * float(np.linalg.norm(upper - lower)))


def _instance_slots(
    instances: InstancedScene, inverse: Float64, root: NDArray[np.int64], more: NDArray[np.int64]
) -> Uint32:
    """Return (I, 4, 4) contents of the instances' slots. root: (I,) root group of each instance's tree."""
    rows = np.zeros((len(instances), 4, 4), np.float32)
    rows[:, :3, :3] = inverse
    rows[:, :3, 3] = instances.world_from_mesh[:, :, 3]
    slots = rows.view(np.uint32)
    slots[:, 3, 0] = 256 * root
    slots[:, 3, 1] = more.astype(np.uint32)
    return slots


def _taken_by_instances(world: CompiledSlots, items: int) -> NDArray[np.int64]:
    """Return the (I,) slots of instances, and mark these slots as nodes.

    Instances are the tree's items from index `items` on.
    """
    taken = world.lanes <= -2 - items
    slots = np.empty(int(taken.sum()), np.int64)
    for lane in range(WIDTH):
        wide = np.flatnonzero(taken[:, lane])
        slots[-2 - items - world.lanes[wide, lane]] = WIDTH * (wide + 1) + lane
        world.nodes[wide, 3, 0] ^= np.uint32(1 << lane | 16 << lane)
    world.lanes[taken] = -1
    return slots


def _in_order(at: NDArray[np.int64], entries: Uint32) -> tuple[NDArray[np.int64], Uint32]:
    order = np.argsort(at)
    return at[order], entries[order]


@dataclass(frozen=True)
class _Slots:
    """Slots of several trees, one after the other, computed as they are written to the device.

    groups  : (trees + 1,) first group of each tree, and the end
    at      : (I,) slots of instances, ascending
    entries : (I, 4, 4) contents of these slots
    """

    parts: list[CompiledSlots]
    groups: NDArray[np.int64]
    at: NDArray[np.int64]
    entries: Uint32

    @property
    def shape(self) -> tuple[int, ...]:
        return WIDTH * int(self.groups[-1]), 4, 4

    def __getitem__(self, which: slice) -> Uint32:
        begin, end, _ = which.indices(self.shape[0])
        found = []
        for part, start, stop in zip(self.parts, WIDTH * self.groups[:-1], WIDTH * self.groups[1:], strict=True):
            if start < end and stop > begin:
                slots = part[max(begin - start, 0) : min(end, stop) - start]
                # Nodes hold group numbers relative to their tree; items hold none.
                slots[:, 3, 0] += np.where(slots[:, 3, 0] > 0, 256 * (start // WIDTH), 0).astype(np.uint32)
                found.append(slots)
        slots = np.concatenate(found)
        first, last = np.searchsorted(self.at, [begin, end])
        slots[self.at[first:last] - begin] = self.entries[first:last]
        return slots
