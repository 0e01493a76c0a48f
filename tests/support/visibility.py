"""Visibility of pairs of points by all polygons: slow and obvious."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.shafts.occluders import Float64, Int32, Polygons, Segment, hits
from glpath.system.kernels import kernel


def visible_by_all(
    polygons: Polygons, points_a: Float64, points_b: Float64, own_a: Int32, own_b: Int32
) -> NDArray[np.bool_]:
    """(A, B) bool by testing every pair of points against every polygon.

    own_a, own_b : (A,) and (B,) int32, the polygon that a point lies on, which never blocks it; -1 for none
    """
    visible = np.ones((len(points_a), len(points_b)), np.bool_)
    _visible_by_all(polygons, points_a, points_b, own_a, own_b, visible)
    return visible


@kernel
def _visible_by_all(polygons, points_a, points_b, own_a, own_b, visible):  # type: ignore[no-untyped-def]
    for i in range(len(points_a)):
        for j in range(len(points_b)):
            a, b = points_a[i], points_b[j]
            segment = Segment(a[0], a[1], a[2], b[0], b[1], b[2], own_a[i], own_b[j])
            for x in range(len(polygons.forms)):
                if x != own_a[i] and x != own_b[j] and hits(x, segment, polygons):
                    visible[i, j] = False
                    break
