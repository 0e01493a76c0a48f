"""Make the table of irradiance that a gather looks up, from a radiosity solution.

The gather traces direct light, and looks up only indirect light. Near a lamp the factor 1/r^2 of a light sample is
unbounded, and a sample that all pixels share would show as a bright spot. Near lamps the table therefore also holds
a fraction of the direct light, and the rest is traced. This fraction rises from 0 to 1 over half a lamp's width.

An element holds the mean irradiance of its area. A path from a point nearer than the element's width sees only a
part of that area. Where light changes abruptly, even a distant path may see only the dark or the bright part. Such
paths are continued instead of looked up (`min_distance`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.interpolation import abrupt, interpolate, vertices_of_elements
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.solution import DIRECT, INDIRECT, Lookup, RadiositySolution
from glpath.sampling.points import owen_scrambled
from glpath.sampling.sobol import sobol_points
from glpath.scene.model import Float64, Scene
from glpath.system.kernels import kernel

# Closeness to a lamp above which the table holds a part of the direct light. Closeness is the irradiance by a light
# sample, divided by the irradiance by a whole sky of the lamp's radiance.
_FIRST = 0.5
# Closeness above which the table holds all direct light.
_ALL = 1.5
_LIGHT_SAMPLES = 512
#: Value of `min_distance`, in scene units, for elements that are never looked up.
NEVER = 1e30


class LookupTable(NamedTuple):
    """Irradiance that a gather looks up, for the elements of a scene's lattices, triangle after triangle.

    corners      : (2, E, 3, 4) float64, irradiance W m^-2 at the corners of fronts and backs, and the fraction of
                   direct light that it includes, 0 to 1
    all_light    : (2, E, 3) float64, irradiance of elements including all direct light
    min_distance : (2, E) float64, minimum distance in scene units for a look-up of an element's front or back: the
                   width of the solver's element, or `NEVER`
    """

    corners: Float64
    all_light: Float64
    min_distance: Float64


def lookup_table(
    scene: Scene, solution: RadiositySolution, lookup: Lookup, *, traced: bool, in_gaps: bool = False
) -> LookupTable:
    """Return the lookup table of a triangulated scene.

    traced  : True to leave out direct light where the gather traces it, which is everywhere but near lamps
    in_gaps : True if paths may start in gaps that no camera sees, such as below a rug. Elements beside much
              brighter or darker ones are then never looked up, because light may change abruptly within them. This
              is done even if `in_gaps` is False for solutions whose elements all have the lattice's own size
    """
    interpolated = lookup == "interpolated"
    divisions = solution.divisions.astype(np.int64)
    count = len(solution.vertices[0, 0]) if interpolated else solution.element_count
    share = np.ones(count)
    if traced:
        share = near_lamps(Lighting.of(scene), _lattice_points(scene, divisions, interpolated))
    vertices_of = vertices_of_elements(divisions)
    share_of_elements = share[vertices_of].mean(axis=1) if interpolated else share
    elements = _with_share(solution.elements, share_of_elements)
    distance = np.stack([_widths(scene, solution)] * 2)
    if interpolated:
        vertices = _with_share(solution.vertices, share)
        corners = interpolate(vertices_of, solution.leaf, vertices, elements)
    else:
        corners = np.repeat(elements[:, :, None], 3, axis=2)
    if in_gaps or solution.leaf_size.max(initial=1) == 1:
        distance[abrupt(vertices_of, solution.leaf, elements[..., :3].mean(axis=2))] = NEVER
    return LookupTable(corners, solution.elements.sum(axis=0, dtype=np.float64), distance)


def _with_share(parts: NDArray[np.float32], share: Float64) -> Float64:
    """Return (2, N, 4): indirect plus `share` (N,) times direct light of `parts` (2, 2, N, 3), then the share."""
    light = parts[INDIRECT] + share[:, None] * parts[DIRECT].astype(np.float64)
    return np.concatenate([light, np.broadcast_to(share[:, None], (2, len(share), 1))], axis=2)


def _widths(scene: Scene, solution: RadiositySolution) -> Float64:
    """Return the width (E,) of the solver's element that contains each lattice element.

    The width is the side of a square with twice the area of the solver's element.
    """
    count = solution.divisions.astype(np.int64) ** 2
    return np.asarray(np.repeat(np.sqrt(2.0 * scene.areas / count), count) * solution.leaf_size)


def near_lamps(lighting: Lighting, receivers: Float64) -> Float64:
    """Return the fraction (N,) of direct light that the table holds at points (N, 3): 0 far from lamps, 1 near."""
    closeness = np.zeros(len(receivers))
    if not lighting.sides:
        return closeness
    u = owen_scrambled(sobol_points(0, _LIGHT_SAMPLES, 3), np.arange(3, dtype=np.uint32))
    samples = lighting.samples(u)
    on_shapes = samples.kind == LIGHT_KINDS.index("area")
    points, scale = samples.position[on_shapes], np.pi * samples.density[on_shapes]
    if not len(points):
        return closeness
    # A matrix product is avoided, because BLAS threads keep the processor busy for a while after it.
    closeness.fill(_FIRST)
    _closest(np.ascontiguousarray(receivers), np.ascontiguousarray(points), 1.0 / scale, closeness)
    return np.clip((closeness - _FIRST) / (_ALL - _FIRST), 0.0, 1.0)


@kernel
def _closest(receivers, points, weight, closeness):  # type: ignore[no-untyped-def]
    """Raise the `closeness` (N,) of receivers (N, 3) to the maximum of weight / squared distance over lamp points.

    points, weight : (P, 3) and (P,), positions on lamps and their weights
    """
    for r in range(len(receivers)):
        x, y, z = receivers[r, 0], receivers[r, 1], receivers[r, 2]
        found = closeness[r]
        for p in range(len(points)):
            dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
            square = max(dx * dx + dy * dy + dz * dz, 1e-18)
            if weight[p] > found * square:  # rarely true, so divisions are rare too
                found = weight[p] / square
        closeness[r] = found


def _lattice_points(scene: Scene, n: NDArray[np.int64], interpolated: bool) -> Float64:
    """Return (N, 3): if `interpolated`, the vertices of all triangles' lattices, otherwise their elements' centres.

    n : (T,) divisions of each triangle's lattice
    """
    if not interpolated:
        return Elements.of_lattices(n).points(scene, np.full((1, 3), 1 / 3))[:, 0]
    triangle = np.repeat(np.arange(len(n)), lattice.vertex_count(n))
    b = lattice.of_all(n, lattice.vertex_barycentrics)
    corners = scene.triangles[triangle]
    edges = corners[:, 1:] - corners[:, :1]
    return np.asarray(corners[:, 0] + np.einsum("nx,nxd->nd", b, edges))
