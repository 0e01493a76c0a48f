"""Find pieces: sets of triangles that are connected at their corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64


def pieces(corners: Float64) -> NDArray[np.int64]:
    """Return (T,) index of each triangle's piece. Triangles that share a corner belong to the same piece.

    corners : (T, 3, n), equal in all n values for a shared corner
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _, which = np.unique(corners.reshape(-1, corners.shape[2]), axis=0, return_inverse=True)
    which = which.reshape(-1, 3)
    count = int(which.max()) + 1
    ends = np.concatenate([which[:, :2], which[:, 1:]])
    graph = coo_array((np.ones(len(ends), np.int8), tuple(ends.T)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1][which[:, 0]], np.int64)
