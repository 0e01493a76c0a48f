"""Resample one irradiance per element to the lattices of each triangle's smallest elements, and to vertices.

Each vertex gets the mean of the elements around it on its surface. It is then corrected by the remaining error at
these elements' centres, so that gradients reach the border of a surface. A vertex in the middle of a longer edge (a
T-vertex) gets the mean of the edge's ends, so that brightness is continuous there. Values are linear within an
element.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.mesh import Elements, Int64, Mesh, weld
from glpath.scene.model import Float64

#: Number of iterations that correct the vertex values, so that their means approach the elements' values.
_CORRECTIONS = 2
#: Maximum length of a chain of T-vertices, in which each is in the middle of an edge that ends at the next one.
_LONGEST_CHAIN = 64


def at_corners(mesh: Mesh, values: Float64) -> Float64:
    """Return values (S, E, 3, 3) at the elements' corners, [side, element, corner, channel].

    values : (S, E, 3) values of the elements, [side, element, channel]
    """
    nodes = _Nodes(mesh)
    return np.stack([nodes.values(side)[nodes.of] for side in values])


class Resampled(NamedTuple):
    """Values of a mesh on the lattices of its finest elements.

    divisions : (T,) divisions of each triangle's lattice
    elements  : (..., E', 3) values of the lattices' elements
    vertices  : (..., V, 3) values of the lattices' vertices, interpolated within each element of the mesh
    leaf      : (E',) index of the mesh's element that each lattice element is part of
    """

    divisions: Int64
    elements: Float64
    vertices: Float64
    leaf: Int64


def resample(mesh: Mesh, values: Float64, buried: NDArray[np.bool_] | None = None) -> Resampled:
    """Resample values (..., 2, E, 3) of the sides of a mesh's elements to one regular lattice per triangle.

    buried : (2, E) True for sides that no light can reach, because a solid covers them. They get the mean of their
             neighbours, so that they do not darken their neighbours
    """
    nodes = _Nodes(mesh)
    known = np.ones((2, len(mesh.elements)), np.bool_) if buried is None else ~buried
    given = values.reshape(-1, *values.shape[-2:])
    filled = [nodes.filled(side, known[number % 2]) for number, side in enumerate(given)]
    sides = np.stack([elements for elements, _ in filled])
    corner_values = np.stack([at_nodes[nodes.of] for _, at_nodes in filled])
    count = len(mesh.scene.triangles)
    divisions = np.ones(count, np.int64)
    np.maximum.at(divisions, mesh.elements.triangle, mesh.elements.n)

    fine, leaf = mesh.elements, np.arange(len(mesh.elements))
    while np.any(coarse := fine.n < divisions[fine.triangle]):
        fine, leaf = (
            fine[~coarse] + fine[coarse].split(),
            np.concatenate([leaf[~coarse], np.repeat(leaf[coarse], 4)]),
        )
    first_element = lattice.starts(lattice.element_count(divisions))
    first_vertex = lattice.starts(lattice.vertex_count(divisions))
    elements = np.zeros((len(sides), first_element[-1], 3))
    number = first_element[fine.triangle] + fine.index()
    elements[:, number] = sides[:, leaf]
    leaf_of = np.zeros(elements.shape[1], np.int64)
    leaf_of[number] = leaf

    corners = fine.corners()
    weights = _weights(corners, fine.n, mesh.elements[leaf])
    at = first_vertex[fine.triangle][:, None] + lattice.vertex_index(
        fine.n[:, None], corners[..., 0], corners[..., 1]
    )
    vertices = np.zeros((len(sides), first_vertex[-1], 3))
    for side in range(len(sides)):
        if sides[side].any():
            vertices[side, at] = np.einsum("evc,ecx->evx", weights, corner_values[side, leaf])
    before = values.shape[:-2]
    return Resampled(divisions, elements.reshape(*before, -1, 3), vertices.reshape(*before, -1, 3), leaf_of)


def _weights(corners: Int64, n: Int64, leaf: Elements) -> Float64:
    """Return barycentric coordinates (E, 3, 3) of lattice elements' corners within the mesh's elements.

    corners : (E, 3, 2) lattice coordinates of each lattice element's corners
    n       : (E,) divisions of that lattice
    leaf    : the mesh's element that contains each lattice element
    """
    ratio = (n // leaf.n)[:, None, None]
    origin = leaf.corners()[:, :1] * ratio
    # From its first corner, a lower element extends along the positive axes, an upper one along the negative axes.
    sign = np.where(leaf.upper, -1, 1)[:, None, None]
    x, y = np.moveaxis((corners - origin) * sign / ratio, 2, 0)
    return np.stack([1 - x - y, x, y], axis=2)


class _Nodes:
    """Nodes of a mesh: all elements' corners at one position of one surface are the same node.

    of      : (E, 3), index of the node at each corner of an element
    size    : number of nodes
    hanging : (h, 3), indices of a node in the middle of an edge and of that edge's ends
    """

    def __init__(self, mesh: Mesh) -> None:
        corners_of = mesh.elements.points(mesh.scene, np.eye(3))
        surface = mesh.surface[mesh.elements.triangle]
        points, of_surface, ends = _edges_with_middles(corners_of, surface)
        number = weld(mesh.scene, points, of_surface)
        count = 3 * len(corners_of)
        used = np.zeros(number.max(initial=-1) + 1, np.bool_)
        used[number[:count]] = True
        self.size = int(np.count_nonzero(used))
        node = np.where(used, np.cumsum(used) - 1, -1)[number]
        self.of = node[:count].reshape(-1, 3)
        found = np.column_stack([node[count:], node[ends]])
        exists = (found >= 0).all(axis=1)
        # Edges are sorted longest first. Edges that share a midpoint are equivalent, so one of them is kept.
        start, stop = np.moveaxis(points[ends[exists]], 1, 0)
        order = np.argsort(-np.linalg.norm(stop - start, axis=1), kind="stable")
        found = found[exists][order]
        self.hanging = found[np.sort(np.unique(found[:, 0], return_index=True)[1])]

    def values(self, elements: Float64) -> Float64:
        """Return (N, 3) values at the nodes, from the values (E, 3) of the elements of one side."""
        return self.filled(elements, np.ones(len(elements), np.bool_))[1]

    def filled(self, elements: Float64, known: NDArray[np.bool_]) -> tuple[Float64, Float64]:
        """Return values (E, 3) of the elements of one side, and values (N, 3) at the nodes.

        known : (E,) False for elements without a value of their own, which get the mean of their nodes
        """
        if not elements.any():
            return elements, np.zeros((self.size, 3))  # for example the backs of a closed room
        shares = np.maximum(np.bincount(self.of.ravel(), np.repeat(known, 3), self.size), 1.0)[:, None]
        found = self._spread(elements) / shares
        for _ in range(_CORRECTIONS):
            self._hang(found)
            lacking = (elements - found[self.of].mean(axis=1)) * known[:, None]
            found = np.maximum(found + self._spread(lacking) / shares, 0.0)
        self._hang(found)
        return np.where(known[:, None], elements, found[self.of].mean(axis=1)), found

    def _spread(self, values: Float64) -> Float64:
        """Return (N, 3), the sum at each node of the values (E, 3) of the elements around it."""
        of = self.of.ravel()
        return np.stack(
            [np.bincount(of, np.repeat(values[:, c], 3), minlength=self.size) for c in range(3)], axis=1
        )

    def _hang(self, values: Float64) -> None:
        """Set each hanging node to the mean of its edge's ends; repeat until stable, as ends may hang as well."""
        for _ in range(_LONGEST_CHAIN):
            wanted = values[self.hanging[:, 1:]].mean(axis=1)
            if np.array_equal(values[self.hanging[:, 0]], wanted):
                return
            values[self.hanging[:, 0]] = wanted


def _edges_with_middles(corners_of: Float64, surface: Int64) -> tuple[Float64, Int64, Int64]:
    """Return points (P, 3), their surfaces (P,), and the ends (m, 2) of edges that may have a vertex in the middle.

    The points are the corners of all elements, then the midpoints of these edges. Ends are indices of points. Edges
    are halved repeatedly, down to the shortest edge of their surface, and their halves are included.

    corners_of : (E, 3, 3) positions of the elements' corners
    surface    : (E,) index of each element's surface
    """
    corner = np.arange(3 * len(corners_of)).reshape(-1, 3)
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    start = corners_of.reshape(-1, 3)
    stop = start[ends[:, 1]]
    of = np.repeat(surface, 3)
    length = np.linalg.norm(stop - start, axis=1)
    shortest = np.full(surface.max(initial=-1) + 1, np.inf)
    np.minimum.at(shortest, of, length)
    points, groups, edges, count = [start], [of], [np.zeros((0, 2), np.int64)], len(start)
    while np.any(long := length > 1.9 * shortest[of]):
        start, stop, ends, of, length = start[long], stop[long], ends[long], of[long], 0.5 * length[long]
        middle = 0.5 * (start + stop)
        points.append(middle)
        groups.append(of)
        edges.append(ends)
        number = count + np.arange(len(ends))
        count += len(ends)
        ends = np.concatenate([np.stack([ends[:, 0], number], axis=1), np.stack([number, ends[:, 1]], axis=1)])
        start, stop = np.concatenate([start, middle]), np.concatenate([middle, stop])
        of, length = np.tile(of, 2), np.tile(length, 2)
    return np.concatenate(points), np.concatenate(groups), np.concatenate(edges)
