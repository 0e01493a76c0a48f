"""Make the table of irradiance that a gather looks up, from a radiosity solution.

Indirect light alone is looked up where the gather traces direct light itself. Close to a lamp it does not: there
a light sample's 1/r^2 has no bound, and where all paths of a set share the light sample, it would be a bright spot
in the picture. So a point has a share of direct light in its table, from 0 to 1 over half a lamp's width; the rest
is traced.

An element holds a mean. A path that comes from nearer than the element is wide sees only a part of it, and where
irradiance changes within an element even a distant path may see only its dark or its bright part. Such paths
continue instead (`min_distance`). Between elements that differ much, interpolation would spread light around
edges, so they are looked up as they are (`constant`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.solution import DIRECT, INDIRECT, Lookup, RadiositySolution
from glpath.sampling.points import owen_scrambled
from glpath.sampling.sobol import sobol_points
from glpath.scene.model import Float64, Scene
from glpath.system.kernels import kernel

# What a light sample sends to a point, in units of what a surface gets under a sky of the lamp's radiance: from the
# first on the table has some direct light, from the second on all of it.
_FIRST, _ALL = 0.5, 1.5
_LIGHT_SAMPLES = 512
# Irradiance is abrupt if it differs between neighbouring elements by more than this share of the larger one.
_ABRUPT = 0.6
#: Minimum distance of a look-up that no path has.
NEVER = 1e30


class LookupTable(NamedTuple):
    """Values for the lattices of a scene's triangles, one after the other.

    values       : (2, N, 3) float64, irradiance W m^-2 of fronts and backs, at vertices or of elements
    direct_share : (N,) float64, how much of the direct light is in them, 0 to 1
    starts       : (T,) int64, number of each triangle's first value
    all_light    : as `values`, with all of the direct light in them
    min_distance : (2, E) float64, distance in scene units from which on an element's front and back may be looked
                   up, in the order of the lattices: the width of the solver's element, or `NEVER`
    constant     : (2, E) bool, values are not interpolated in the element's front and back
    elements     : (2, E, 3) float64, as `values`, of the elements
    element_share : (E,) float64, as `direct_share`, of the elements
    """

    values: Float64
    direct_share: Float64
    starts: NDArray[np.int64]
    all_light: Float64
    min_distance: Float64
    constant: NDArray[np.bool_]
    elements: Float64
    element_share: Float64


def lookup_table(scene: Scene, solution: RadiositySolution, lookup: Lookup, *, traced: bool) -> LookupTable:
    """The table of a scene in triangles; traced: direct light is, but near lamps, else the table has all of it."""
    interpolated = lookup == "interpolated"
    parts = solution.vertices if interpolated else solution.elements
    count = lattice.vertex_count if interpolated else lattice.element_count
    share = np.ones(parts.shape[2])
    if traced:
        share = near_lamps(Lighting.of(scene), _lattice_points(scene, solution.divisions, interpolated))
    direct = parts[DIRECT].astype(np.float64)
    values = parts[INDIRECT] + share[:, None] * direct
    starts = lattice.starts(count(solution.divisions))[:-1]
    all_light = parts[INDIRECT] + direct
    distance = np.where(solution.unresolved, NEVER, _widths(scene, solution))
    elements, of_elements, constant = values, share, np.zeros(values.shape[:2], np.bool_)
    if interpolated:
        corners = _vertices_of_elements(solution.divisions.astype(np.int64))
        of_elements = share[corners].mean(axis=1)
        elements = solution.elements[INDIRECT] + of_elements[:, None] * solution.elements[DIRECT]
        constant = _in_whole_leaves(solution, _abrupt(elements.mean(axis=2), corners, values.shape[1]))
    return LookupTable(values, share, starts, all_light, np.stack([distance] * 2), constant, elements, of_elements)


def _widths(scene: Scene, solution: RadiositySolution) -> Float64:
    """(E,) the side of a square that two of the solver's elements would fill, for each element of the lattices."""
    count = solution.divisions.astype(np.int64) ** 2
    return np.asarray(np.repeat(np.sqrt(2.0 * scene.areas / count), count) * solution.leaf_size)


def _abrupt(light: Float64, corners: NDArray[np.int64], vertices: int) -> NDArray[np.bool_]:
    """(2, E): whether light differs much between an element and those that it shares a vertex with.

    light   : (2, E) of the fronts and backs of elements
    corners : (E, 3) their vertices
    """
    lowest, highest = (np.full((2, vertices), fill) for fill in (np.inf, -np.inf))
    for corner in corners.T:
        for side in range(2):
            np.minimum.at(lowest[side], corner, light[side])
            np.maximum.at(highest[side], corner, light[side])
    lower, upper = lowest[:, corners].min(axis=2), highest[:, corners].max(axis=2)
    return np.asarray(upper - lower > _ABRUPT * upper)


def _in_whole_leaves(solution: RadiositySolution, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(2, E): True for each element of the lattices whose solver's element has a part in `some` (2, E).

    All parts of a solver's element are interpolated between the same values, at its corners.
    """
    parts = np.flatnonzero(solution.leaf_size > 1)
    elements = Elements.of_lattices(solution.divisions.astype(np.int64))[parts]
    i, j, upper, size = elements.i, elements.j, elements.upper, solution.leaf_size[parts].astype(np.int64)
    key = elements.triangle * 16 + np.log2(size).astype(np.int64)
    while np.any(smaller := size > 1):
        upper = np.where(smaller, (i & 1) + (j & 1) + upper >= 2, upper)
        i, j, size = np.where(smaller, i >> 1, i), np.where(smaller, j >> 1, j), np.where(smaller, size >> 1, size)
    _, leaf = np.unique(((key << 15 | i) << 15 | j) << 1 | upper, return_inverse=True)
    found = some.copy()
    for side in range(2):
        found[side, parts] = np.bincount(leaf, some[side, parts])[leaf] > 0
    return found


def _vertices_of_elements(divisions: NDArray[np.int64]) -> NDArray[np.int64]:
    """(E, 3): numbers of the vertices of all elements of the lattices."""
    first = lattice.starts(lattice.vertex_count(divisions))
    found = [lattice.element_vertices(int(n)) + start for n, start in zip(divisions, first[:-1], strict=True)]
    return np.concatenate(found) if found else np.zeros((0, 3), np.int64)


def near_lamps(lighting: Lighting, receivers: Float64) -> Float64:
    """(N,) from 0 to 1: how near points (N, 3) are to shapes that emit, compared with their size."""
    closeness = np.zeros(len(receivers))
    if not lighting.sides:
        return closeness
    u = owen_scrambled(sobol_points(0, _LIGHT_SAMPLES, 3), np.arange(3, dtype=np.uint32))
    samples = lighting.samples(u)
    on_shapes = samples.kind == LIGHT_KINDS.index("area")
    points, scale = samples.position[on_shapes], np.pi * samples.density[on_shapes]
    if not len(points):
        return closeness
    # Not as a product of matrices: the threads of a BLAS keep the processor for a while after it.
    _closest(np.ascontiguousarray(receivers), np.ascontiguousarray(points), 1.0 / scale, closeness)
    return np.clip((closeness - _FIRST) / (_ALL - _FIRST), 0.0, 1.0)


@kernel
def _closest(receivers, points, weight, closeness):  # type: ignore[no-untyped-def]
    """Fill closeness (N,) with the largest of weight (P,) over the squared distance of points (P, 3)."""
    for r in range(len(receivers)):
        x, y, z = receivers[r, 0], receivers[r, 1], receivers[r, 2]
        found = 0.0
        for p in range(len(points)):
            dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
            found = max(found, weight[p] / max(dx * dx + dy * dy + dz * dz, 1e-18))
        closeness[r] = found


def _lattice_points(scene: Scene, divisions: NDArray[np.int32], interpolated: bool) -> Float64:
    """(N, 3): the vertices of all triangles' lattices, or the middles of the elements."""
    if not interpolated:
        return Elements.of_lattices(divisions.astype(np.int64)).points(scene, np.full((1, 3), 1 / 3))[:, 0]
    n = divisions.astype(np.int64)
    triangle = np.repeat(np.arange(len(n)), lattice.vertex_count(n))
    b = np.concatenate([lattice.vertex_barycentrics(int(k)) for k in n]) if len(n) else np.zeros((0, 2))
    corners = scene.triangles[triangle]
    edges = corners[:, 1:] - corners[:, :1]
    return np.asarray(corners[:, 0] + np.einsum("nx,nxd->nd", b, edges))
