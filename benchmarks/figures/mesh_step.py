"""How much of a radiosity mesh can be seen in a picture."""

from __future__ import annotations

import numpy as np

from benchmarks.figures.eye_hits import ShownHits
from glpath.film.image import luminance
from glpath.radiosity import RadiositySolution
from glpath.scene.model import Float64


def mesh_step(picture: Float64, hits: ShownHits, solution: RadiositySolution) -> float:
    """By how much more a picture changes from pixel to pixel where an element ends than within elements.

    The mean of |difference| / sum of luminance over pixels two apart on one plane of one shape: of those with an
    element's edge between them, less that of those within one element. A mesh shows as steps; light without one
    does not know of its edges, and gives next to nothing.
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
