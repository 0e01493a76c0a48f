"""Find pieces: sets of triangles that are connected at their corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64
from glpath.system.time_limit import check_time


def pieces(corners: Float64) -> NDArray[np.int64]:
    """Return (T,) index of each triangle's piece. Triangles that share a corner belong to the same piece.

    corners : (T, 3, n), equal in all n values for a shared corner
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    check_time()
    rows = corners.reshape(-1, corners.shape[2])
    order = np.lexsort(rows.T[::-1])  # np.unique(axis=0) numbers the rows alike in three times the time
    check_time()
    differs = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.empty(len(rows), np.int64)
    number[order] = np.concatenate([[0], np.cumsum(differs)])
    which, count = number.reshape(-1, 3), int(number.max()) + 1
    check_time()
    ends = np.concatenate([which[:, :2], which[:, 1:]])
    graph = coo_array((np.ones(len(ends), np.int8), tuple(ends.T)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1][which[:, 0]], np.int64)
