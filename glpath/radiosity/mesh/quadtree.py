"""Quadtrees over the lattices of a scene's triangles: elements are small where the light changes, large elsewhere.

Particles are counted on a fine lattice. Four elements stay separate if their irradiance differs by more than its
noise; otherwise they are merged into their parent. A finer lattice therefore does not make the result noisier.

Poor at:  changes in dark regions, which few particles show.
Source:   Heckbert 1990, Adaptive radiosity textures for bidirectional ray tracing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.mesh import Elements, Int64, Mesh
from glpath.scene.model import Float64

Bools = NDArray[np.bool_]

#: An element is split only if one of its four parts differs from their mean by more than this many standard errors.
_SIGNIFICANT = 4.0
#: Fraction of the scene's mean irradiance that is added to the local irradiance, to which differences are compared.
#: Dark regions are therefore split less.
_DARK = 0.1


@dataclass(frozen=True)
class Quadtree:
    """Nested lattices. Level 0 is the coarsest; each further level halves the edges, down to a triangle's depth.

    coarse : (T,) divisions of each triangle at level 0
    depth  : (T,) number of times that each triangle's lattice is halved
    """

    coarse: Int64
    depth: Int64

    @property
    def height(self) -> int:
        """Maximum of `depth` over all triangles."""
        return int(self.depth.max(initial=0))

    def divisions(self, level: int) -> Int64:
        """Return (T,) divisions of each triangle at a level."""
        return np.asarray(self.coarse << np.minimum(self.depth, level))

    @property
    def finest(self) -> Int64:
        """Divisions (T,) of each triangle at its own depth."""
        return self.divisions(self.height)

    @cached_property
    def levels(self) -> list[Elements]:
        """List of all elements of each level, in the order of `glpath.radiosity.mesh.lattice`."""
        return [Elements.of_lattices(self.divisions(level)) for level in range(self.height + 1)]

    @cached_property
    def parents(self) -> list[Int64]:
        """List for the levels from 1 on: (E,) index of each element's parent in the next coarser level."""
        found = []
        for level in range(1, self.height + 1):
            fine, divisions = self.levels[level], self.divisions(level - 1)
            halved = (fine.n > divisions[fine.triangle]).astype(np.int64)
            i, j = fine.i >> halved, fine.j >> halved
            upper = np.where(halved, (fine.i & 1) + (fine.j & 1) + fine.upper >= 2, fine.upper)
            first = lattice.starts(lattice.element_count(divisions))
            parent = lattice.element_index(divisions[fine.triangle], i, j, upper)
            found.append(np.asarray(first[fine.triangle] + parent, np.int64))
        return found

    def sums(self, values: Float64) -> list[Float64]:
        """Return the sums over each element of every level, from the values (..., E, C) of the finest level."""
        found = [values]
        for level in range(self.height, 0, -1):
            rows = found[0].reshape(-1, *found[0].shape[-2:])
            parent, count = self.parents[level - 1], len(self.levels[level - 1])
            summed = [np.stack([np.bincount(parent, c, count) for c in row.T], axis=1) for row in rows]
            found.insert(0, np.asarray(np.stack(summed).reshape(*values.shape[:-2], count, -1), np.float64))
        return found

    def of_coarse(self, values: Float64) -> Float64:
        """Return (S, E'), for each element of the finest level the value of the level 0 element that contains it.

        values : (S, E) values of S sides at level 0
        """
        number = np.arange(values.shape[1])
        for parent in self.parents:
            number = number[parent]
        return np.asarray(values[:, number])


@dataclass(frozen=True)
class Detail:
    """Elements across which the light varies by more than noise.

    tree       : quadtree of the lattices
    split      : for each level, (E,) bool, True if the element has to be divided
    misplaced  : (T,) variation of light on each triangle's finest elements, as a fraction of the scene's energy. It
                 is the sum of all significant deviations of an element's four parts from their mean energy
    """

    tree: Quadtree
    split: list[Bools]
    misplaced: Float64

    @classmethod
    def of(cls, tree: Quadtree, flux: Float64, square: Float64, areas: Float64, threshold: float) -> Detail:
        """Find the elements whose four parts differ.

        flux      : (S, E, 3) energy that arrived at the sides of the finest elements
        square    : (S, E) sums over arrivals of the squared energy, where energy is the mean of the channels
        areas     : (T,) areas of the triangles
        threshold : fraction of the local irradiance by which a part has to differ from the mean of the four
        """
        arrived = tree.sums(flux.mean(axis=2)[..., None])
        squares = tree.sums(square[..., None])
        mean = float(arrived[0].sum()) / max(float(areas.sum()), np.finfo(float).tiny)
        split = [np.zeros(len(level), bool) for level in tree.levels]
        misplaced = np.zeros(len(areas))
        for level in range(tree.height - 1, -1, -1):
            elements, parent = tree.levels[level], tree.parents[level]
            area = areas[elements.triangle] / elements.n**2
            density = arrived[level][..., 0] / area
            fine = tree.levels[level + 1]
            parts = arrived[level + 1][..., 0] / (areas[fine.triangle] / fine.n**2)
            difference = np.abs(parts - density[:, parent])
            # Standard error of the density of one of the four parts, if each receives a quarter of the arrivals.
            noise = 2.0 * np.sqrt(squares[level][..., 0]) / area
            enough = np.maximum(threshold * (density + _DARK * mean), _SIGNIFICANT * noise)
            differs = (difference > enough[:, parent]).any(axis=0)
            np.logical_or.at(split[level], parent, differs)
            deepest = split[level] & (tree.depth[elements.triangle] == level + 1)
            wrong = (difference * (areas[fine.triangle] / fine.n**2)).sum(axis=0) * deepest[parent]
            misplaced += np.bincount(fine.triangle, wrong, len(areas))
            deeper = split[level + 1] & (fine.n > elements.n[parent])
            np.logical_or.at(split[level], parent, deeper)
        return cls(tree, split, misplaced / max(float(arrived[0].sum()), np.finfo(float).tiny))

    @cached_property
    def leaves(self) -> list[Bools]:
        """List for each level: (E,) bool, True if the element exists and is not divided."""
        found = []
        exists = np.ones(len(self.tree.levels[0]), bool)
        for level, elements in enumerate(self.tree.levels):
            last = self.tree.depth[elements.triangle] <= level
            found.append(exists & (last | ~self.split[level]))
            if level < self.tree.height:
                exists = (exists & ~found[-1])[self.tree.parents[level]]
        return found

    def mesh(self, base: Mesh) -> Mesh:
        """Return the mesh of all leaves, level by level, with the patches of `base`.

        If no element is divided, `base` itself is returned.
        """
        if not any(split.any() for split in self.split):
            return base
        elements, patches = self.tree.levels[0][self.leaves[0]], [np.flatnonzero(self.leaves[0])]
        patch = np.arange(len(self.tree.levels[0]))
        for level, leaf in enumerate(self.leaves[1:], 1):
            patch = patch[self.tree.parents[level - 1]]
            elements = elements + self.tree.levels[level][leaf]
            patches.append(patch[leaf])
        return Mesh(base.scene, base.surface, base.patches, elements, np.concatenate(patches))
