"""Quads, boxes and spheres as meshes, and texture coordinates for meshes that have none.

`(vertices, faces)` are (V, 3) float64 and (F, 3) int32, counter-clockwise seen from the front. Vertices are shared,
so that adjacent triangles touch without a gap.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import warn_at
from glpath.scene.model import Float64, Int32, Mesh, placed
from glpath.scene.source_location import SourceLocation
from glpath.system.time_limit import check_time

# Ratio of height to longest edge up to which a triangle counts as having no area, because the GPU stores corners as
# 32-bit floats.
FLAT = 1e-7

# Faces of a cube by corner number; bits 0, 1 and 2 of a corner number select the upper end of x, y and z.
_CUBE_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def quad(corners: ArrayLike) -> tuple[Float64, Int32]:
    """Return two triangles for the corners (4, 3), scene units."""
    return np.array(corners, np.float64), _halves([(0, 1, 2, 3)])


def box(lower: ArrayLike, upper: ArrayLike) -> tuple[Float64, Int32]:
    """Return twelve triangles of a box, fronts outward; `lower` and `upper` are (3,), scene units."""
    corner = np.arange(8)
    at_upper = np.stack([corner & 1, corner >> 1 & 1, corner >> 2 & 1], axis=1)
    vertices = np.where(at_upper == 1, np.asarray(upper, np.float64), np.asarray(lower, np.float64))
    return vertices, _halves(_CUBE_FACES)


def _halves(quads: ArrayLike) -> Int32:
    """Return the (2 N, 3) triangles of convex quads (N, 4)."""
    return np.array(quads, np.int32)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def quad_mesh(corners: ArrayLike) -> Mesh:
    """Return `quad` as a mesh with texture coordinates (0, 0), (1, 0), (1, 1) and (0, 1) at its corners."""
    return Mesh(*quad(corners), uv=np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64))


def box_mesh(lower: ArrayLike, upper: ArrayLike) -> Mesh:
    """Return `box` as a mesh with texture coordinates, and therefore four vertices for each face."""
    vertices, faces = box(lower, upper)
    return Mesh.of_triangles(vertices[faces], box_uv()).welded()


@cache
def box_uv() -> Float64:
    """Return the (12, 3, 2) texture coordinates of `box`, 0 to 1 on every face. Read-only.

    Seen from the front, u goes to the right and v up; on the four sides v goes along y. The top and bottom faces
    are oriented as if the box were tilted about the x axis until they are visible.
    """
    at_upper, faces = box((0, 0, 0), (1, 1, 1))
    # Directions of u and v for each face of _CUBE_FACES.
    directions = (("-x", "y"), ("x", "y"), ("x", "z"), ("x", "-z"), ("z", "y"), ("-z", "y"))
    uv = np.empty((6, 2, 3, 2))
    corners = at_upper[faces].reshape(6, 2, 3, 3)
    for face, axes in enumerate(directions):
        for i, axis in enumerate(axes):
            along = corners[face, :, :, "xyz".index(axis[-1])]
            uv[face, :, :, i] = 1 - along if axis[0] == "-" else along
    return uv.reshape(12, 3, 2)


def projected_uv(corners: Float64) -> Float64:
    """Return (T, 3, 2) texture coordinates for triangles (T, 3, 3) that have none.

    Each triangle is projected along the axis nearest to its normal, with u and v along the other two axes, as on a
    box. The box around all triangles starts at 0, and its longest side is 1.
    """
    if not len(corners):
        return np.zeros((0, 3, 2))
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    location = (corners - lower) / max(float((upper - lower).max()), np.finfo(float).tiny)
    along = np.argmax(np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])), axis=1)
    axes = np.array([(2, 1), (0, 2), (0, 1)])[along]
    return np.take_along_axis(location, axes[:, None, :], axis=2)


def subdivide(vertices: Float64, faces: Int32) -> tuple[Float64, Int32]:
    """Return the mesh with each triangle split in four at its edges' midpoints, which adjacent triangles share."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, which = np.unique(edges, axis=0, return_inverse=True)
    middle = len(vertices) + which.reshape(-1, 3).astype(np.int32)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    split = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), split


def sphere(center: ArrayLike, radius: float, subdivisions: int) -> tuple[Float64, Int32]:
    """Return an icosphere of 20 * 4^subdivisions triangles, with vertices on the sphere and fronts outward.

    The triangles lie inside the sphere. With 4 subdivisions, their area is 0.12 % too small, and their volume 0.22
    %.
    """
    unit = unit_sphere(subdivisions)
    return np.asarray(center, np.float64) + radius * unit.vertices, unit.faces


@lru_cache(maxsize=4)
def unit_sphere(subdivisions: int, with_uv: bool = False) -> Mesh:
    """Return the icosphere of radius 1 around the origin, with the sphere's normals. All callers share one mesh.

    with_uv : True to add the texture coordinates of `Scene.spheres`. Its triangles then share no vertices, because
              u jumps by 1 along a meridian
    """
    golden = (1 + np.sqrt(5)) / 2
    rectangle = np.array([(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([np.roll(rectangle, turn, axis=1) for turn in range(3)])
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    faces = _icosahedron_faces(vertices)
    for _ in range(subdivisions):
        vertices, faces = subdivide(vertices, faces)
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    vertices.flags.writeable = faces.flags.writeable = False
    mesh = Mesh(vertices, faces, normals=vertices)
    if not with_uv:
        return mesh
    return replace(mesh.unshared(), uv=_sphere_uv(vertices[faces]).reshape(-1, 2))


def _sphere_uv(corners: Float64) -> Float64:
    """Return (T, 3, 2) texture coordinates of triangles (T, 3, 3) of the unit sphere.

    No triangle has a jump of u in its interior.
    """
    u = np.arctan2(corners[..., 1], corners[..., 0]) / (2 * np.pi) % 1.0
    # A pole lies on every meridian; use the meridian of the rest of its triangle.
    pole = np.hypot(corners[..., 0], corners[..., 1]) < 1e-9
    u -= np.round(u - np.where(pole[:, 0], u[:, 1], u[:, 0])[:, None])
    others = np.where(pole, np.nan, u)
    u = np.where(pole, np.nanmean(others, axis=1, keepdims=True), u)
    return np.stack([u, 0.5 + np.arcsin(np.clip(corners[..., 2], -1, 1)) / np.pi], axis=-1)


def _icosahedron_faces(vertices: Float64) -> Int32:
    """Return the 20 triples of mutually nearest vertices, facing outward; vertices are (12, 3), unit length."""
    near = vertices @ vertices.T > 0.4  # cosine 0.447 for adjacent vertices, -0.447 for the next nearest
    triples = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    faces = np.array(triples, np.int32)
    inward = np.linalg.det(vertices[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def with_projected_uv(mesh: Mesh) -> Mesh:
    """Return `mesh` with the texture coordinates of `projected_uv`; vertices are split where these differ."""
    apart = mesh.unshared()
    uv = projected_uv(mesh.vertices[mesh.faces])
    return replace(apart, uv=uv.reshape(-1, 2)).welded()


def with_area(mesh: Mesh, world_from_mesh: Float64, name: str, location: SourceLocation) -> Mesh:
    """Return `mesh` without triangles that have no area in the world. A SceneWarning reports their number.

    world_from_mesh : map to the world, or (N, 3, 4) maps of N instances; triangles stay that have an area in one

    Raises SceneError if no triangle has an area. `name` and `location` are those of the shape.
    """
    check_time()
    flat = np.ones(len(mesh.faces), np.bool_)
    for each in world_from_mesh if world_from_mesh.ndim == 3 else [world_from_mesh]:
        flat &= without_area(placed(mesh.vertices, each)[mesh.faces])
    if not flat.any():
        return mesh
    if flat.all():
        raise location.error(
            f'("{name}") has {len(flat)} triangles, none of which has an area.',
            "The corners of each coincide or lie on one line: check the coordinates and the transform.",
        )
    listed = np.flatnonzero(flat)
    warn_at(
        f'{location} ("{name}")',
        {"triangles without area were dropped": len(listed)},
        f'{location} ("{name}"): dropped {len(listed)} of {len(flat)} triangles, which have no area: '
        f"{', '.join(str(i) for i in listed[:8])}{', ...' if len(listed) > 8 else ''} (counted from 0).",
    )
    return mesh.without_faces(flat)


def without_area(corners: Float64) -> NDArray[np.bool_]:
    """Return (T,) bool: True for triangles (T, 3, 3) without an area."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= FLAT * longest**2)
