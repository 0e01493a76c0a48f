"""Level of detail: a scene with fewer triangles, for indirectly visible surfaces [PB 6.1].

Meshes are simplified by quadric error metrics (Garland & Heckbert 1997, by the library fast-simplification).
Emitting shapes are not simplified, because light samples are drawn on them. Shapes with textures, vertex colours or
transparency are not, because their textures and colours could not be mapped to the simpler surface. A mesh keeps
enough triangles that 99 of 100 of its vertices are within a thousandth of the scene's diameter from the simpler
surface.

Cost:     about 3 µs a triangle, once.
Poor at:  leaves, grass and nets, whose area changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from glpath.errors import UsageError
from glpath.scene.appearance import has_colours
from glpath.scene.geometry import Float64, Mesh, Shape, Shapes
from glpath.scene.model import Scene

#: Minimum number of triangles of a simplified mesh.
MIN_FACES = 64
# Maximum deviation of a mesh, as a fraction of the scene's diameter.
_MAX_DEVIATION = 1e-3
# Aggressiveness of the library, 0 to 10: readiness to change the shape for fewer triangles; its default is 7.
_AGGRESSION = 2
# Maximum number of a mesh's vertices whose deviation is measured.
_ASKED = 20_000
# Number of sample points spread over the simpler surface to measure the deviation.
_POINTS = 1 << 16
# Number of sample points nearest to a vertex. Its deviation is the distance from the nearest of their triangles.
_NEAR = 12


@dataclass(frozen=True)
class Simplified:
    """Simplified scene.

    scene     : scene with the same shapes in the same order
    deviations : for each shape, a distance in scene units: 99 of 100 original vertices are within it from the
                 simpler surface
    """

    scene: Scene
    deviations: tuple[float, ...]

    @property
    def deviation(self) -> float:
        """Largest deviation."""
        return max(self.deviations)


def simplified(scene: Scene, share: float) -> Simplified:
    """Return the scene with meshes that have about a fraction `share`, in (0, 1], of their triangles.

    A mesh keeps more triangles if it would deviate too much. Raises UsageError if the library is missing.
    """
    made: dict[tuple[Mesh, float], tuple[Mesh, float]] = {}
    shapes, deviations = [], []
    low, high = scene.bounds
    max_deviation = _MAX_DEVIATION * float(np.linalg.norm(high - low))
    for shape in scene.shapes:
        mesh = shape.geometry
        if not isinstance(mesh, Mesh) or not _can_be_simpler(scene, shape, mesh):
            shapes.append(shape)
            deviations.append(0.0)
            continue
        largest = float(np.linalg.norm(shape.world_from_object[:, :, :3], ord=2, axis=(1, 2)).max())
        if (mesh, largest) not in made:
            made[mesh, largest] = _near_enough(mesh, share, max_deviation / largest)
        simpler, apart = made[mesh, largest]
        deviations.append(apart * largest)
        shapes.append(replace(shape, geometry=simpler))
    return Simplified(replace(scene, shapes=Shapes(shapes)), tuple(deviations))


def _can_be_simpler(scene: Scene, shape: Shape, mesh: Mesh) -> bool:
    material = scene.materials[shape.material]
    plain = not (material.needs_uv or has_colours(shape) or material.lets_light_through)
    return plain and not shape.emits and len(mesh.faces) > MIN_FACES


def _near_enough(mesh: Mesh, share: float, max_deviation: float) -> tuple[Mesh, float]:
    """Return the mesh with a fraction of its triangles, and its deviation.

    The fraction is doubled until the deviation is small enough.
    """
    while share < 1:
        simpler, deviation = _simpler(mesh, share)
        if deviation <= max_deviation:
            return simpler, deviation
        share *= 2
    return mesh, 0.0


def _simpler(mesh: Mesh, share: float) -> tuple[Mesh, float]:
    """Return the mesh with fewer triangles, or the same mesh, and its deviation."""
    simplify = _library()
    whole = Mesh(mesh.vertices, mesh.faces).welded()
    centre = whole.vertices.mean(axis=0)
    size = float(np.ptp(whole.vertices, axis=0).max())
    wanted = max(share, MIN_FACES / len(whole.faces))
    if wanted >= 1:
        return mesh, 0.0
    points, faces = simplify(
        ((whole.vertices - centre) / size).astype(np.float32),
        whole.faces.astype(np.int32),
        1.0 - wanted,
        agg=_AGGRESSION,
    )
    simpler = Mesh(points.astype(np.float64) * size + centre, np.asarray(faces, np.int32))
    corners = simpler.vertices[simpler.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    simpler = simpler.without_faces(area <= 1e-12 * size * size)
    if not 0 < len(simpler.faces) < len(mesh.faces):
        return mesh, 0.0
    if mesh.normals is not None:
        simpler = replace(simpler, normals=_vertex_normals(simpler))
    return simpler, _deviation(whole.vertices, simpler)


def _library() -> Any:
    try:
        from fast_simplification import simplify
    except ImportError as error:
        raise UsageError(
            "bounce_lod: the library fast-simplification, which simplifies meshes, is not installed.",
            'pip install "glpath[lod]"',
        ) from error
    return simplify


def _vertex_normals(mesh: Mesh) -> Float64:
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    sums = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(sums, mesh.faces[:, corner], normal)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(sums / np.where(length > 0, length, 1.0))


def _deviation(points: Float64, mesh: Mesh) -> float:
    """Return the distance from the mesh within which 99 % of points (N, 3) lie.

    If there are many points, only some are tested. A point is compared with triangles that have sample points
    nearby, so its true distance may be smaller. The samples are spread evenly over all triangles.
    """
    from scipy.spatial import cKDTree  # late, because the import is slow

    points = points[:: -(-len(points) // _ASKED)]
    triangles = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    at = (np.arange(_POINTS) + 0.5) / _POINTS
    of = np.concatenate([np.searchsorted(np.cumsum(area) / area.sum(), at), np.arange(len(triangles))])
    u, v = np.modf(np.outer(np.arange(len(of)), [0.7548776662466927, 0.5698402909980532]))[0].T  # R2 [Roberts 2018]
    b = np.where((u + v > 1)[:, None], np.column_stack([1 - u, 1 - v]), np.column_stack([u, v]))
    a, ab, ac = triangles[of, 0], triangles[of, 1] - triangles[of, 0], triangles[of, 2] - triangles[of, 0]
    _, which = cKDTree(a + b[:, :1] * ab + b[:, 1:] * ac).query(points, k=_NEAR)
    found = np.full(len(points), np.inf)
    for k in range(_NEAR):
        found = np.minimum(found, _distance(points, triangles[np.minimum(of[which[:, k]], len(triangles) - 1)]))
    return float(np.quantile(found, 0.99))


def _distance(points: Float64, triangles: Float64) -> Float64:
    """Return the (N,) distance of each point (N, 3) from the triangle (N, 3, 3) in the same row."""
    best = np.full(len(points), np.inf)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inside = np.ones(len(points), np.bool_)
    for k in range(3):
        start, edge = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        away = points - start
        along = np.clip(np.sum(away * edge, axis=1) / np.maximum(np.sum(edge * edge, axis=1), 1e-300), 0, 1)
        best = np.minimum(best, np.linalg.norm(away - along[:, None] * edge, axis=1))
        inside &= np.sum(np.cross(edge, away) * normal, axis=1) >= 0
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    height = np.abs(np.sum((points - triangles[:, 0]) * normal, axis=1)) / length
    return np.where(inside, height, best)


def density_of(full: Scene, simpler: Scene, density: Float64) -> Float64:
    """Return (T,) light sample densities for the simpler scene's triangles, copied from the full scene's."""
    found = np.zeros(len(simpler.triangles))
    for shape, before, after in zip(full.shapes, full.shapes.ranges, simpler.shapes.ranges, strict=True):
        if shape.emits and shape.primitive == "triangle":
            found[after] = density[before]
    return found
