"""Geometry, names and notes of differences, for reading and writing files of other programs.

Other programs have triangles, a normal at every corner of smoothly shaded meshes, and v downwards in images.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.scene.geometry import Float64, Int32, Mesh, Shape, Shapes
from glpath.scene.model import Scene
from glpath.scene.sight import sees_nearer
from glpath.scene.triangulate import path_traceable

#: Half side of the square that replaces an infinite plane, in diagonals of the box around the scene and its camera.
_HORIZON = 100.0
# Minimum distance of a near plane, as a fraction of its distance in a scene without near shapes.
_NEAREST = 1e-3


class Notes:
    """Differences between a file and the scene, without duplicates, in the order found."""

    def __init__(self) -> None:
        self._subjects: dict[tuple[str, str], dict[str, None]] = {}

    def add(self, text: str, kind: str = "", name: str = "") -> None:
        """Add a difference between the scene and its file.

        kind, name : kind and name of what differs: "material", "light" or "shape"; empty if it is the whole scene
        """
        self._subjects.setdefault((kind, text), {})[name] = None

    @property
    def texts(self) -> tuple[str, ...]:
        """The differences as sentences without a full stop."""
        return tuple(
            f"{kind}{'s' * (len(names) > 1)} {listed(list(names))}: {text}" if kind else text
            for (kind, text), names in self._subjects.items()
        )


class UniqueNames:
    """Names of which no two are equal: a name that is in use already gets a number."""

    def __init__(self, *reserved: str) -> None:
        self._used = set(reserved)
        self._numbers: dict[str, int] = {}

    def of(self, name: str) -> str:
        """Return `name`, or NAME-2, NAME-3 and so on if it is in use."""
        # The search starts at the last number of the name, because it would take quadratic time from 2 on.
        unique, number = name, self._numbers.get(name, 1)
        while unique in self._used:
            number += 1
            unique = f"{name}-{number}"
        self._numbers[name] = number
        self._used.add(unique)
        return unique


def listed(names: list[str]) -> str:
    """Return a text with the first three names, in quotation marks and separated by commas."""
    return ", ".join(f'"{name}"' for name in names[:3]) + (", ..." if len(names) > 3 else "")


def at_opening(scene: Scene, notes: Notes) -> Scene:
    """Return the scene at shutter open. Add a note if anything moves."""
    if scene.camera.moves or scene.moving_shapes:
        notes.add("nothing moves: everything is where it is when the shutter opens")
    return scene.at()


def in_triangles(scene: Scene, notes: Notes) -> Scene:
    """Return the scene as the triangles that path tracing renders; infinite planes become squares, with a note."""
    planes = [shape.name for shape in scene.shapes if shape.primitive == "plane"]
    if planes:
        notes.add(f"endless planes ({listed(planes)}) are squares of {2 * _HORIZON:g} times the scene's diagonal")
        shapes = (_square(scene, shape) if shape.primitive == "plane" else shape for shape in scene.shapes)
        scene = replace(scene, shapes=Shapes(shapes))
    return path_traceable(scene)


def scene_size(scene: Scene) -> float:
    """Return the diagonal of the scene's bounds, without infinite planes.

    If the scene is one point, the result is the distance of the camera to this point, or 1.
    """
    low, high = scene.bounds
    return float(np.linalg.norm(high - low)) or float(np.linalg.norm(scene.camera.position - low)) or 1.0


def near_plane(scene: Scene, distance: float) -> float:
    """Return `distance`, divided by ten until a near plane at this distance hides nothing, at most three times.

    A panorama becomes a perspective camera of 90 degrees. Parallel rays may start within a shape, so they get the
    smallest distance.
    """
    camera, smallest = scene.camera, _NEAREST * distance
    if camera.projection == "orthographic":
        return smallest
    if camera.projection == "panorama":
        scene = replace(scene, camera=replace(camera, projection="perspective", fov=90.0))
    while distance > smallest and sees_nearer(scene, distance):
        distance = max(0.1 * distance, smallest)
    return distance


def in_world(shape: Shape) -> Mesh:
    """Return all instances of a shape as one mesh in world space."""
    mesh, alone = shape.geometry, Shapes((shape,))
    assert isinstance(mesh, Mesh)
    return Mesh(
        alone.vertices,
        alone.faces,
        None if mesh.uv is None else alone.vertex_uv,
        None if mesh.normals is None else alone.vertex_normals,
        None if mesh.uv1 is None else alone.vertex_uv1,
        None if mesh.colours is None else alone.vertex_colours,
    )


def mirrors(world_from_object: Float64) -> bool:
    """Return True if an affine map (3, 4) mirrors.

    A mirroring map exchanges the fronts and backs of a mesh in glpath, but not in other programs.
    """
    return bool(np.linalg.det(world_from_object[:, :3]) < 0)


def with_all_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with face normals at vertices whose normals are zero; the same mesh if no normal is zero."""
    if mesh.normals is None or np.all(np.any(mesh.normals != 0, axis=1)):
        return mesh
    if not np.any(mesh.normals):
        return replace(mesh, normals=None)
    apart = mesh.unshared()
    assert apart.normals is not None
    flat = ~np.any(apart.normals != 0, axis=1, keepdims=True)
    return replace(apart, normals=np.where(flat, np.repeat(face_normals(mesh), 3, axis=0), apart.normals)).welded()


def face_normals(mesh: Mesh) -> Float64:
    """Return the (F, 3) float64 unit normals, out of the front."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.maximum(length, np.finfo(float).tiny))


def v_downwards(uv: Float64) -> Float64:
    """Return (V, 2) texture coordinates for programs in which the first row of an image is at v = 0."""
    return uv * [1.0, -1.0] + [0.0, 1.0]


def map_downwards(uv_transform: Float64, scale: tuple[float, float]) -> Float64:
    """Return the (3, 3) affine map of a texture slot, for coordinates with v downwards.

    It includes the repeats of the slot's texture.
    """
    matrix, over = np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
    matrix[:2] = uv_transform * np.array(scale)[:, None]
    return np.asarray(over @ matrix @ over)


def uv_handedness(uv: Float64, faces: Int32) -> tuple[float, bool]:
    """Return the handedness of texture coordinates, and True if it differs within the mesh.

    It is 1 if u, v and the normal out of the front are a right-handed frame on at least half of the faces, else -1.
    """
    sides = uv[faces[:, 1:]] - uv[faces[:, :1]]
    turns = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    right, left = int(np.count_nonzero(turns > 0)), int(np.count_nonzero(turns < 0))
    return 1.0 if right >= left else -1.0, min(right, left) > 0


def tangent_axes(uv_transform: Float64, uv_lengths: tuple[float, float] = (1.0, 1.0)) -> Float64:
    """Return the axes (2, 2) in which glpath reads a normal map's red and green, as rows of parts along u and v.

    Red points along u of the transformed texture coordinates; green is perpendicular to it, on the side of their v.

    uv_transform : (2, 3) affine map from the coordinates of the mesh to those of the lookup
    uv_lengths   : scene units of one u and one v of the mesh
    """
    linear = uv_transform[:, :2]
    if abs(np.linalg.det(linear)) < 1e-18:
        return np.eye(2)
    along, side = (np.diag(uv_lengths) @ np.linalg.inv(linear)).T
    t = along / np.linalg.norm(along)
    b = np.array([-t[1], t[0]])
    # The sum makes zeros positive; rounding makes axes along u and v exact.
    return np.round(np.stack([t, b if b @ side >= 0 else -b]), 12) + 0.0


def _square(scene: Scene, plane: Shape) -> Shape:
    """Return squares instead of infinite planes, each centred on the plane's point nearest to the scene centre."""
    low, high = scene.bounds
    low, high = np.minimum(low, scene.camera.position), np.maximum(high, scene.camera.position)
    half = _HORIZON * float(np.linalg.norm(high - low))
    meshes: list[tuple[Float64, Float64]] = []
    for matrix in plane.world_from_object:
        u, v, normal, point = matrix.T
        middle = np.array([axis @ (0.5 * (low + high) - point) / (axis @ axis) for axis in (u, v)])
        sides = half / np.array([np.linalg.norm(u), np.linalg.norm(v)])
        uv = middle + sides * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        turned = np.cross(u, v) @ normal < 0
        order = [3, 2, 1, 0] if turned else [0, 1, 2, 3]
        uv = np.asarray(uv[order])
        meshes.append((point + uv[:, :1] * u + uv[:, 1:] * v, uv))
    vertices, uvs = (np.concatenate(parts) for parts in zip(*meshes, strict=True))
    first = 4 * np.arange(len(meshes), dtype=np.int32)[:, None, None]
    faces = (first + np.array([(0, 1, 2), (0, 2, 3)], np.int32)).reshape(-1, 3)
    return Shape(
        plane.name,
        Mesh(vertices, faces, uv=uvs),
        plane.material,
        emission=plane.emission,
        emission_two_sided=plane.emission_two_sided,
    )


def behind(scene: Scene) -> float:
    """Return the offset, in scene units, of a surface's back from its front if the back has its own triangles.

    Without an offset, path tracers, which do not cull back faces, would hit front or back at random. A depth buffer
    resolves the offset, and it is too small to be visible.
    """
    return 2e-5 * float(np.linalg.norm(np.ptp(np.stack(scene.bounds), axis=0)))
