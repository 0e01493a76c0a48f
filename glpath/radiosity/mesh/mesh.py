"""Divide a scene's triangles into patches, which shoot, and elements, which receive (Cohen et al. 1986).

Patches are the elements of a triangle's lattice. Elements are the leaves of quadtrees in the patches; a split makes
four triangles of one. Both have one size all over the scene until `Mesh.refine` splits elements.

M. Cohen, D. Greenberg, D. Immel, P. Brock, "An efficient radiosity approach for realistic image synthesis", 1986.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh import lattice
from glpath.scene import Scene
from glpath.scene.model import Float64, Int32
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

#: Cosine of the largest angle between the normals of two neighbouring triangles of one surface: 30 degrees.
_SMOOTH = float(np.cos(np.radians(30)))
#: Distance below which points of one surface are merged, as a fraction of the scene's extent.
_WELD = 0.7236e-6
# Number of elements whose points are computed at a time.
_TOGETHER = 1 << 15


@dataclass(frozen=True)
class Elements:
    """Elements of triangles' lattices, as arrays (E,) int64.

    triangle : index of the scene's triangle
    n        : number of parts of that triangle's edges in the element's lattice
    i, j     : indices of the element's cell
    upper    : 1 for the upper element of the cell, 0 for the lower, see `lattice`
    """

    triangle: Int64
    n: Int64
    i: Int64
    j: Int64
    upper: Int64

    def __len__(self) -> int:
        return len(self.triangle)

    def __getitem__(self, which: NDArray[np.bool_] | Int64 | slice) -> Elements:
        return Elements(*(a[which] for a in (self.triangle, self.n, self.i, self.j, self.upper)))

    def __add__(self, other: Elements) -> Elements:
        ours = (self.triangle, self.n, self.i, self.j, self.upper)
        theirs = (other.triangle, other.n, other.i, other.j, other.upper)
        return Elements(*(np.concatenate(pair) for pair in zip(ours, theirs, strict=True)))

    @classmethod
    def of_lattices(cls, divisions: Int64) -> Elements:
        """Return all elements of the triangles' lattices, in the order of `lattice`."""
        triangle = np.repeat(np.arange(len(divisions)), lattice.element_count(divisions))
        i, j, upper = lattice.of_all(divisions, _cells).T
        return cls(triangle, divisions[triangle], i, j, upper)

    def split(self) -> Elements:
        """Split each element into four of half its size; return (4 E,), the four of an element in sequence."""
        up = self.upper[:, None]
        i, j = 2 * self.i[:, None], 2 * self.j[:, None]
        # The middle element comes last and is rotated by 180 degrees.
        di = np.where(up, [[1, 0, 1, 1]], [[0, 1, 0, 0]])
        dj = np.where(up, [[1, 1, 0, 1]], [[0, 0, 1, 0]])
        upper = np.where([[0, 0, 0, 1]], 1 - up, up)
        triangle, n = np.repeat(self.triangle, 4), np.repeat(2 * self.n, 4)
        return Elements(triangle, n, (i + di).ravel(), (j + dj).ravel(), upper.ravel())

    def corners(self) -> Int64:
        """Return (E, 3, 2), lattice coordinates of the vertices, counter-clockwise like the triangle."""
        up = self.upper
        i = np.stack([self.i + up, self.i + 1 - up, self.i + up], axis=1)
        j = np.stack([self.j + up, self.j + up, self.j + 1 - up], axis=1)
        return np.stack([i, j], axis=2)

    def index(self) -> Int64:
        """Return (E,), indices of the elements in their triangles' lattices."""
        return lattice.element_index(self.n, self.i, self.j, self.upper)

    def points(self, scene: Scene, barycentric: Float64) -> Float64:
        """Return the points (E, k, 3) at barycentric coordinates in each element.

        barycentric : (k, 3), the same for all elements, or (E, k, 3)
        """
        subscripts = "kc,ecx->ekx" if barycentric.ndim == 2 else "ekc,ecx->ekx"
        found = np.empty((len(self), barycentric.shape[-2], 3))
        for begin in range(0, len(self), _TOGETHER):
            check_time()
            part = slice(begin, begin + _TOGETHER)
            some = self[part]
            at = barycentric if barycentric.ndim == 2 else barycentric[part]
            b = np.einsum(subscripts, at, some.corners() / some.n[:, None, None])
            triangles = scene.triangles[some.triangle]
            edges = triangles[:, 1:] - triangles[:, :1]
            found[part] = triangles[:, :1] + np.einsum("ekx,exd->ekd", b, edges)
        return found


@lru_cache(maxsize=64)
def _cells(n: int) -> Int64:
    """Return (n * n, 3): i, j and upper of a lattice's elements, in order."""
    length = 2 * (n - np.arange(n)) - 1  # number of elements in each row
    j = np.repeat(np.arange(n), length)
    in_row = np.arange(n * n) - np.repeat(np.cumsum(length) - length, length)
    return np.stack([in_row // 2, j, in_row % 2], axis=1)


@dataclass(frozen=True)
class Mesh:
    """Patches and elements of a triangulated scene.

    scene    : scene of triangles only
    surface  : (T,) int64, index of the smooth surface that each triangle belongs to, see `surfaces`
    patches  : all elements of the triangles' lattices
    elements : leaves of the quadtrees in the patches
    patch    : (E,) index of the patch that each element is part of
    """

    scene: Scene
    surface: Int64
    patches: Elements
    elements: Elements
    patch: Int64

    @classmethod
    def uniform(cls, scene: Scene, divisions: Int64, surface: Int64, splits: int = 0) -> Mesh:
        """Return a mesh whose patches have 4^splits elements each."""
        patches = elements = Elements.of_lattices(divisions)
        for _ in range(splits):
            elements = elements.split()
        return cls(scene, surface, patches, elements, np.repeat(np.arange(len(patches)), 4**splits))

    def refine(self, which: NDArray[np.bool_]) -> Mesh:
        """Return a mesh with the elements `which` (E,) split in four; unsplit elements come before the new ones."""
        split = self.elements[which].split()
        patch = np.concatenate([self.patch[~which], np.repeat(self.patch[which], 4)])
        return Mesh(self.scene, self.surface, self.patches, self.elements[~which] + split, patch)

    @cached_property
    def areas(self) -> Float64:
        """Areas (E,) of the elements, in scene units squared."""
        return np.asarray(self.scene.areas[self.elements.triangle] / self.elements.n**2)


def divisions_of_size(scene: Scene, surface: Int64, size: float | Float64) -> Int64:
    """Return (T,) for each triangle the number of parts of its edges, so that no part is longer than `size`.

    size : one length for all triangles, or (T,)

    If the numbers differ within a surface, they are powers of two, so that vertices on shared edges coincide. The
    finer of two neighbouring triangles then divides each edge of a coarse element into halves, quarters, and so on.
    """
    return _divisions(_longest(scene), surface, size)


def _divisions(longest: Float64, surface: Int64, size: float | Float64) -> Int64:
    """Return the result of `divisions_of_size`. longest: (T,) length of each triangle's longest edge."""
    parts = np.maximum(np.ceil(longest / size - 1e-9), 1)
    min_parts = np.full(surface.max(initial=-1) + 1, np.inf)
    max_parts = np.zeros_like(min_parts)
    np.minimum.at(min_parts, surface, parts)
    np.maximum.at(max_parts, surface, parts)
    uneven = (min_parts != max_parts)[surface]
    return np.asarray(np.where(uneven, 2 ** np.ceil(np.log2(parts)), parts), np.int64)


def size_for_count(scene: Scene, surface: Int64, count: int, *, by_size: bool = False) -> float:
    """Return the element size that gives the most patches up to `count`; each triangle has at least one patch.

    by_size : True to count a triangle smaller than a patch as a fraction of a patch. An object of many small
              triangles then leaves as many patches to large walls as an object of few triangles
    """
    longest = _longest(scene)
    largest, even = float(longest.max()), float(np.sqrt((longest**2).sum() / max(count, 1)))
    fine, coarse = even / 4, largest
    if by_size:
        coarse = max(coarse, even)
    elif count <= len(longest):
        return largest
    for _ in range(40):
        check_time()
        middle = np.sqrt(fine * coarse)
        patches = _divisions(longest, surface, middle).astype(float) ** 2
        if by_size:
            patches *= np.minimum(longest / middle, 1.0) ** 2
        if float(patches.sum()) > count:
            fine = middle
        else:
            coarse = middle
    return float(coarse)


def surfaces(scene: Scene) -> Int64:
    """Return (T,) int64 surface indices: triangles of a shape that meet at less than 30 degrees share a surface."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    check_time()
    count = len(scene.triangles)
    shape = scene.triangle_shape.astype(np.int64)
    node = weld(scene, scene.triangles.reshape(-1, 3), np.repeat(shape, 3)).reshape(-1, 3)
    edges = np.sort(np.stack([node, np.roll(node, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    check_time()
    order = np.lexsort(edges.T)
    same = np.all(edges[order[1:]] == edges[order[:-1]], axis=1)
    a, b = order[:-1][same] // 3, order[1:][same] // 3
    check_time()
    normals = scene.normals
    smooth = np.einsum("ij,ij->i", normals[a], normals[b]) > _SMOOTH
    links = coo_array((np.ones(smooth.sum()), (a[smooth], b[smooth])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def weld(scene: Scene, points: Float64, group: Int64) -> Int64:
    """Return (N,) int64 vertex indices; points (N, 3) at the same position and of the same group (N,) share one."""
    lower, upper = scene.bounds
    step = _WELD * max(float(np.max(upper - lower)), np.finfo(float).tiny)
    x, y, z = np.round((points - lower) / step).astype(np.int64).T  # 0 to 2^21, so that 63 bits hold all three
    # Sorting twice by one integer key is faster than sorting once by several keys.
    check_time()
    position = np.unique((x << 21 | y) << 21 | z, return_inverse=True)[1]
    check_time()
    return np.asarray(np.unique(position << 32 | group, return_inverse=True)[1])


def occluder_of_triangle(parallelogram: NDArray[np.bool_]) -> Int32:
    """Return (T,) int32, index of each triangle's occluder in `Occluders.of_scene`.

    parallelogram : bool for each occluder, True if it merges two successive triangles
    """
    return np.repeat(np.arange(len(parallelogram), dtype=np.int32), np.where(parallelogram, 2, 1))


def _longest(scene: Scene) -> Float64:
    """Return (T,) lengths of the longest edge of each triangle."""
    edges = np.roll(scene.triangles, -1, axis=1) - scene.triangles
    return np.asarray(np.linalg.norm(edges, axis=2).max(axis=1))
