"""Visibility of a radiosity mesh in a picture."""

from __future__ import annotations

import numpy as np

from benchmarks.figures.eye_hits import ShownHits
from glpath.radiosity import RadiositySolution
from glpath.scene.model import Float64
from glpath.system.colour import luminance


def mesh_step(picture: Float64, hits: ShownHits, solution: RadiositySolution) -> float:
    """Return how much more a picture changes between pixels across an element's edge than within elements.

    For two pixels of a plane of one shape with one pixel between them, take |difference| / sum of their luminances.
    The result is its mean over pairs across an edge, minus its mean over pairs within an element. A visible mesh
    makes steps; light that does not depend on the mesh gives almost 0.
    """
    scene = hits.scene
    seen = luminance(picture)
    element = hits.element(solution)
    t = hits.triangle[..., 0]
    planes = np.column_stack([scene.normals, np.sum(scene.normals * scene.triangles[:, 0], axis=1)])
    shape = scene.triangle_shape
    across, within = [np.zeros(0)], [np.zeros(0)]
    for axis in (0, 1):
        a, b = ([slice(None)] * axis + [part] for part in (slice(None, -2), slice(2, None)))
        (ta, ea, la), (tb, eb, lb) = ([each[tuple(side)] for each in (t, element, seen)] for side in (a, b))
        fit = (ea >= 0) & (eb >= 0) & (la + lb > 0)
        fit &= (shape[ta] == shape[tb]) & (np.abs(planes[ta] - planes[tb]).max(axis=-1) < 1e-6)
        change = np.abs(la - lb) / np.where(fit, la + lb, 1)
        across.append(change[fit & (ea != eb)])
        within.append(change[fit & (ea == eb)])
    edges, inside = np.concatenate(across), np.concatenate(within)
    return float(edges.mean() - inside.mean()) if len(edges) and len(inside) else np.nan
