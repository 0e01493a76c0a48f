"""Which meshes of a scene are kept once, with a list of where their instances stand, and which become triangles.

A scene has each mesh once already (`glpath.scene.geometry`). An engine that knows instances gets the scene parted:
`resident` triangles, among them each such mesh a single time in a space of its own, and the instances. All others
get triangles of all instances, as for few of these the second level of a BVH costs more than it saves.

Cost:     some microseconds an instance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.scene.geometry import Mesh, Shape, Shapes, instance_boxes
from glpath.scene.model import Float64, Int32, Scene

#: Triangles that a scene must have less of than with all instances as triangles. Each takes some 500 bytes while an
#: engine is made.
MIN_SAVED = 500_000
#: Triangles of a mesh that is kept once, at least: a box around a few of them is little more than they are.
MIN_TRIANGLES = 64
# A map that flattens more loses digits that rays need.
_FLATTEST = 1e-4


@dataclass(frozen=True, eq=False)
class InstancedScene:
    """A scene of which some meshes are there once.

    given     : the whole scene
    resident  : the same with as many shapes. Those with instances have none, but the first one of a mesh and a
                material has the mesh, about the origin and of a size from 1/2 to 1, not where it is seen
    mesh_shape : (M,) int, for each mesh the shape of `resident` that has it
    mesh      : (I,) int, of each instance, the number of its mesh
    shape     : (I,) int, and of its shape, in the order of the shapes
    world_from_mesh : (I, 3, 4) float64, of the mesh as it is in `resident`
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
        """(M,) the triangles of each mesh among those of `resident`."""
        return tuple(self.resident.shapes.ranges[shape] for shape in self.mesh_shape)

    @cached_property
    def mesh_of_triangle(self) -> Int32:
        """(T,) int32, of `resident`: 0 for a triangle that is seen where it is, else 1 and its mesh's number."""
        found = np.zeros(self.resident.shapes.total("triangle"), np.int32)
        for number, part in enumerate(self.ranges):
            found[part] = 1 + number
        return found

    @cached_property
    def boxes(self) -> tuple[Float64, Float64]:
        """(I, 3) lower and upper corners of the boxes around the instances."""
        lower, upper = np.empty((len(self), 3)), np.empty((len(self), 3))
        for number, shape in enumerate(self.mesh_shape):
            geometry, of_mesh = self.resident.shapes[shape].geometry, self.mesh == number
            assert isinstance(geometry, Mesh), "a shape with a mesh"
            lower[of_mesh], upper[of_mesh] = instance_boxes(geometry, self.world_from_mesh[of_mesh])
        return lower, upper


def instanced(scene: Scene) -> InstancedScene | None:
    """The scene with its instances parted; None where that does not pay.

    Left as triangles are meshes with few, single ones, what emits, as light samples are drawn from triangles, and
    maps that flatten; and of a scene in which shapes move, all.
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
    """Shapes by mesh and material, those that have several instances."""
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
    """How many triangles."""
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
    """The mesh about the origin, of a size from 1/2 to 1, and the (3, 4) map from that to itself."""
    lower, upper = mesh.used_vertices.min(axis=0), mesh.used_vertices.max(axis=0)
    scale = 2.0 ** np.ceil(np.log2(float((upper - lower).max())))
    middle = 0.5 * (lower + upper)
    return replace(mesh, vertices=(mesh.vertices - middle) / scale), np.column_stack([scale * np.eye(3), middle])


def _after(maps: Float64, first: Float64) -> Float64:
    """(N, 3, 4): `first`, then each of the maps."""
    found = maps[:, :, :3] @ first
    found[:, :, 3] += maps[:, :, 3]
    return np.asarray(found)
