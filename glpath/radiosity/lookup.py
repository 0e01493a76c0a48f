"""A solution for a gather's look-ups: a table of irradiance for the points of its lattice.

Indirect light alone is looked up where the gather traces direct light itself. Close to a lamp it does not: there
a light sample's 1/r^2 has no bound, and where all paths of a set share the light sample, it would be a bright spot
in the picture. So a point has a share of direct light in its table, from 0 to 1 over half a lamp's width; the rest
is traced.
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

# What a light sample sends to a point, in units of what a surface gets under a sky of the lamp's radiance: from the
# first on the table has some direct light, from the second on all of it.
_FIRST, _ALL = 0.5, 1.5
_LIGHT_SAMPLES = 512
_CHUNK = 4096  # of points at once, 16 MB


class LookupTable(NamedTuple):
    """Values for the lattices of a scene's triangles, one after the other.

    values       : (2, N, 3) float64, irradiance W m^-2 of fronts and backs, at vertices or of elements
    direct_share : (N,) float64, how much of the direct light is in them, 0 to 1
    starts       : (T,) int64, number of each triangle's first value
    all_light    : as `values`, with all of the direct light in them
    """

    values: Float64
    direct_share: Float64
    starts: NDArray[np.int64]
    all_light: Float64


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
    return LookupTable(values, share, lattice.starts(count(solution.divisions))[:-1], parts[INDIRECT] + direct)


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
    # |r - p|^2 as a product of matrices, which is quicker; from the middle of the lamps, for its last digits.
    middle = points.mean(axis=0)
    p, r = points - middle, receivers - middle
    of_points = np.concatenate([-2.0 * p, np.einsum("pi,pi->p", p, p)[:, None], np.ones((len(p), 1))], axis=1)
    of_points *= scale[:, None]
    of_receivers = np.concatenate([r, np.ones((len(r), 1)), np.einsum("ni,ni->n", r, r)[:, None]], axis=1)
    for start in range(0, len(receivers), _CHUNK):
        square = (of_receivers[start : start + _CHUNK] @ of_points.T).min(axis=1)
        closeness[start : start + _CHUNK] = 1.0 / np.maximum(square, 1e-9)
    return np.clip((closeness - _FIRST) / (_ALL - _FIRST), 0.0, 1.0)


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
