"""Interpolate irradiance within elements so that each element keeps its mean and no light leaks around edges.

A vertex has the mean value of its adjacent elements, so interpolation alone moves light from bright elements to
dark ones. The values at an element's corners are therefore shifted so that their mean equals the element's value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.mesh import Elements
from glpath.scene.model import Float64

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Difference between neighbouring elements, as a fraction of the brighter one, above which it counts as abrupt.
_ABRUPT = 0.7


def interpolate(vertices_of: Int64, leaf: Int64, vertices: Float64, elements: Float64) -> Float64:
    """Return values (2, E, 3, C) at each element's corners, for linear interpolation within the element.

    The vertex values are shifted so that their mean over the solver's element equals the element's value.

    vertices_of : (E, 3) indices from `vertices_of_elements`
    leaf        : (E,) index of the solver's element that each element is part of
    vertices    : (2, V, C) values of C channels, for fronts and backs
    elements    : (2, E, C) means over the elements
    """
    corners = vertices[:, vertices_of]
    mean, lowest = corners.mean(axis=2), corners.min(axis=2)
    if int(leaf.max(initial=-1)) + 1 < len(leaf):
        order = np.argsort(leaf, kind="stable")
        first = np.searchsorted(leaf[order], np.arange(leaf.max() + 1))
        parts = np.bincount(leaf)[:, None]
        mean = (np.add.reduceat(mean[:, order], first, axis=1) / parts)[:, leaf]
        lowest = np.minimum.reduceat(lowest[:, order], first, axis=1)[:, leaf]
    # A dark element gets a small slope, so that no corner is below zero.
    falls = np.maximum(mean - lowest, 1e-300)
    slope = (elements / falls).min(axis=2, initial=1.0)
    corners -= mean[:, :, None]
    corners *= slope[..., None, None]
    corners += elements[:, :, None]
    return corners


def abrupt(vertices_of: Int64, leaf: Int64, light: Float64) -> Bools:
    """Return (2, E): True if light differs abruptly among an element and its neighbours on the same triangle.

    light : (2, E) irradiance of fronts and backs; for other parameters, see `interpolate`
    """
    lowest, highest = (np.full((2, int(vertices_of.max(initial=-1)) + 1), fill) for fill in (np.inf, -np.inf))
    for corner in vertices_of.T:
        for side in range(2):
            np.minimum.at(lowest[side], corner, light[side])
            np.maximum.at(highest[side], corner, light[side])
    lower, upper = lowest[:, vertices_of].min(axis=2), highest[:, vertices_of].max(axis=2)
    differs = upper - lower > _ABRUPT * upper
    return np.stack([np.bincount(leaf, side)[leaf] > 0 for side in differs])


def vertices_of_elements(divisions: Int64) -> Int64:
    """Return (E, 3), vertex indices of all elements. Each triangle is a lattice of elements with its own vertices.

    divisions : (T,) number of parts of each triangle's edges
    """
    first = lattice.starts(lattice.vertex_count(divisions))[:-1]
    own = lattice.of_all(divisions, lattice.element_vertices)
    return np.asarray(own + np.repeat(first, lattice.element_count(divisions))[:, None])


def leaves(divisions: Int64, leaf_size: NDArray[np.uint16]) -> Int64:
    """Return (E,), index of the solver's element that contains each element of the lattices.

    Solver elements are numbered in lattice order. If each consists of one lattice element, the indices are equal.

    leaf_size : (E,) edge of the solver's element, in elements of the lattice; a power of two
    """
    elements = Elements.of_lattices(divisions)
    i, j, upper, size = elements.i, elements.j, elements.upper, leaf_size.astype(np.int64)
    key = elements.triangle * 16 + np.log2(size).astype(np.int64)
    while np.any(smaller := size > 1):
        upper = np.where(smaller, (i & 1) + (j & 1) + upper >= 2, upper)
        i, j, size = np.where(smaller, i >> 1, i), np.where(smaller, j >> 1, j), np.where(smaller, size >> 1, size)
    _, first, leaf = np.unique(((key << 15 | i) << 15 | j) << 1 | upper, return_index=True, return_inverse=True)
    number = np.empty_like(first)
    number[np.argsort(first)] = np.arange(len(first))
    return np.asarray(number[leaf])
