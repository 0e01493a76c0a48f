"""Division of a scene into meshes that are stored once, with a list of their instances, and single triangles.

A scene stores each mesh once already (`glpath.scene.geometry`). An engine that supports instances gets the divided
scene. Its `resident` triangles contain each instanced mesh once, in the mesh's own space. All other meshes are
expanded to the triangles of all their instances, because a second BVH level costs more than it saves for few
triangles.

Cost:     some microseconds an instance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.scene.geometry import Mesh, Shape, Shapes, instance_boxes
from glpath.scene.model import Float64, Int32, Scene

#: Minimum number of triangles that instancing must save; otherwise all meshes are expanded. A triangle takes some
#: 500 bytes while an engine is created.
MIN_SAVED = 500_000
#: Minimum number of triangles of an instanced mesh. A smaller mesh is expanded, because a test of its box is hardly
#: cheaper than tests of its triangles.
MIN_TRIANGLES = 64
# Minimum ratio of the smallest to the largest scale of an instance's affine map. A mesh with a flatter instance is
# expanded, because rays in its space would lose digits.
_FLATTEST = 1e-4


@dataclass(frozen=True, eq=False)
class InstancedScene:
    """Scene whose instanced meshes are stored once.

    given     : the undivided scene
    resident  : scene with the same shapes, but without the instances. Of the shapes with the same mesh and
                material, only the first keeps the mesh. That mesh is centred on the origin and scaled to a size
                from 1/2 to 1, so it is not at a visible position
    mesh_shape : (M,) int, for each mesh, index of the shape of `resident` that contains it
    mesh : (I,) int, index of each instance's mesh
    shape     : (I,) int, shape of each instance, in the order of the shapes
    world_from_mesh : (I, 3, 4) float64, maps from the mesh in `resident` to the world
    """

    given: Scene
    resident: Scene
    mesh_shape: NDArray[np.intp]
    mesh: NDArray[np.intp]
    shape: NDArray[np.intp]
    world_from_mesh: Float64

    def __len__(self) -> int:
        return len(self.mesh)

    @cached_property
    def ranges(self) -> tuple[slice, ...]:
        """Triangle range of each of the M meshes in `resident`."""
        return tuple(self.resident.shapes.ranges[shape] for shape in self.mesh_shape)

    @cached_property
    def mesh_of_triangle(self) -> Int32:
        """Index (T,) int32 of the mesh of each triangle in `resident`, plus 1; 0 if not instanced."""
        found = np.zeros(self.resident.shapes.total("triangle"), np.int32)
        for number, part in enumerate(self.ranges):
            found[part] = 1 + number
        return found

    @cached_property
    def boxes(self) -> tuple[Float64, Float64]:
        """Lower and upper corners, (I, 3) each, of the boxes around the instances."""
        lower, upper = np.empty((len(self), 3)), np.empty((len(self), 3))
        for number, shape in enumerate(self.mesh_shape):
            geometry, of_mesh = self.resident.shapes[shape].geometry, self.mesh == number
            assert isinstance(geometry, Mesh), "a shape with a mesh"
            lower[of_mesh], upper[of_mesh] = instance_boxes(geometry, self.world_from_mesh[of_mesh])
        return lower, upper


def instanced(scene: Scene) -> InstancedScene | None:
    """Return the scene with its instances separated, or None if that saves too little.

    A mesh is expanded to triangles if it is small, has a single instance, has a flattening map, or emits. Emitting
    meshes are expanded because light samples are drawn from triangles. If shapes move, all meshes are expanded.
    """
    if scene.moving_shapes:
        return None
    placed = [i for i, shape in enumerate(scene.shapes) if _is_mesh_to_keep(shape)]
    if _saved(scene, _by_mesh(scene, placed)) < MIN_SAVED:
        return None
    of_mesh = _by_mesh(scene, [i for i in placed if not _flattens(scene.shapes[i])])
    return _parted(scene, of_mesh) if _saved(scene, of_mesh) >= MIN_SAVED else None


def _is_mesh_to_keep(shape: Shape) -> bool:
    big = isinstance(shape.geometry, Mesh) and len(shape.geometry.faces) >= MIN_TRIANGLES
    return big and shape.count > 0 and not shape.emits


def _flattens(shape: Shape) -> bool:
    sizes = np.linalg.svd(shape.world_from_object[:, :, :3], compute_uv=False)
    return bool(np.any(sizes[:, 2] <= _FLATTEST * sizes[:, 0]))


def _by_mesh(scene: Scene, which: list[int]) -> dict[tuple[Mesh, int], list[int]]:
    """Return shape indices by mesh and material, for meshes with several instances."""
    found: dict[tuple[Mesh, int], list[int]] = {}
    counts: dict[tuple[Mesh, int], int] = {}
    for index in which:
        shape = scene.shapes[index]
        assert isinstance(shape.geometry, Mesh), "meshes alone"
        key = (shape.geometry, shape.material)
        found.setdefault(key, []).append(index)
        counts[key] = counts.get(key, 0) + len(shape.world_from_object)
    return {key: of_mesh for key, of_mesh in found.items() if counts[key] > 1}


def _saved(scene: Scene, of_mesh: dict[tuple[Mesh, int], list[int]]) -> int:
    """Return the number of triangles that instancing saves."""
    return sum(
        sum(scene.shapes[index].count for index in which) - len(mesh.faces) for (mesh, _), which in of_mesh.items()
    )


def _parted(scene: Scene, of_mesh: dict[tuple[Mesh, int], list[int]]) -> InstancedScene:
    shapes = list(scene.shapes)
    mesh, shape_of, maps = [], [], []
    for number, ((geometry, _), which) in enumerate(of_mesh.items()):
        about, mesh_from_about = _about_origin(geometry)
        for index in which:
            placed = scene.shapes[index].world_from_object
            mesh.append(np.full(len(placed), number))
            shape_of.append(np.full(len(placed), index))
            maps.append(_after(placed, mesh_from_about))
            shapes[index] = replace(scene.shapes[index], geometry=about, world_from_object=np.zeros((0, 3, 4)))
        shapes[which[0]] = replace(shapes[which[0]], world_from_object=np.eye(3, 4)[None])
    order = np.argsort(np.concatenate(shape_of), kind="stable")
    return InstancedScene(
        scene,
        replace(scene, shapes=Shapes(shapes), centred_by=scene.origin),
        np.array([which[0] for which in of_mesh.values()]),
        np.concatenate(mesh)[order],
        np.concatenate(shape_of)[order],
        np.concatenate(maps)[order],
    )


def _about_origin(mesh: Mesh) -> tuple[Mesh, Float64]:
    """Return the mesh centred on the origin, of a size from 1/2 to 1, and the affine map (3, 4) back."""
    lower, upper = mesh.used_vertices.min(axis=0), mesh.used_vertices.max(axis=0)
    scale = 2.0 ** np.ceil(np.log2(float((upper - lower).max())))
    middle = 0.5 * (lower + upper)
    return replace(mesh, vertices=(mesh.vertices - middle) / scale), np.column_stack([scale * np.eye(3), middle])


def _after(maps: Float64, first: Float64) -> Float64:
    """Return affine maps (N, 3, 4) that apply `first`, then each of `maps`."""
    found = maps[:, :, :3] @ first
    found[:, :, 3] += maps[:, :, 3]
    return np.asarray(found)
