"""Find samples of texels inside of or below other geometry, and replace them by other samples of the same texel.

Cost:     one or two rays for each texel, about a dozen next to hidden texels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.atlas import Atlas
from glpath.apps.lightmap.texels import AtlasTexels
from glpath.rendering.below_stream import Covered
from glpath.rendering.sides import Sides
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Distance from a wall, in texels, up to which points behind it count as inside.
_NEAR = 2.0
#: Height above the surface, in texel sizes, of rays that look for a wall between samples of a texel.
_ABOVE = 0.1
#: Number of texels whose rays are traced in one batch.
_TOGETHER = 1 << 16


def outside(
    scene: Scene, atlas: Atlas, texels: AtlasTexels, sides: Sides, covered: Covered | None
) -> tuple[AtlasTexels, Bools]:
    """Return texels with all samples outside of other geometry, and a mask (N,) of texels without such samples.

    The central sample of each texel is tested; if it or a neighbour's is inside, all samples are tested. Samples
    behind a wall without thickness, seen from the central one, are replaced, too.

    covered : test for points covered by streamed triangles, which count as other geometry
    """
    samples, count = texels.face.shape
    middle = samples // 2
    of = _Samples(scene, atlas, texels, sides, covered)
    found = of.inside([middle], np.arange(count))[0]
    near = np.zeros((atlas.pages, atlas.size[1] + 2, atlas.size[0] + 2), np.bool_)
    page, row, column = texels.index
    hit = page[found], row[found] + 1, column[found] + 1
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            near[hit[0], hit[1] + down, hit[2] + right] = True
    asked = np.flatnonzero(near[page, row + 1, column + 1])
    wrong = np.zeros((samples, count), np.bool_)
    if len(asked):
        wrong[:, asked] = of.inside(list(range(samples)), asked)
    buried = np.asarray(wrong.all(axis=0))
    if sides.lit.all(axis=1).any():
        wrong |= ~wrong[middle] & of.apart(middle)
    if not wrong.any():
        return texels, buried
    # A sample inside or behind a wall is replaced by the next valid sample of its texel.
    source = np.broadcast_to(np.arange(samples)[:, None], wrong.shape).copy()
    for step in range(1, samples):
        still = np.take_along_axis(wrong, source, axis=0)
        source = np.where(still, (np.arange(samples)[:, None] + step) % samples, source)
    return texels.with_samples_of(source), buried


@dataclass(frozen=True)
class _Samples:
    """Tests of samples; see `outside` for the fields."""

    scene: Scene
    atlas: Atlas
    texels: AtlasTexels
    sides: Sides
    covered: Covered | None

    def inside(self, samples: list[int], which: Int64) -> Bools:
        """Return (S, N) bool, True for samples inside of other geometry or covered by streamed triangles.

        samples, which : indices of S samples and of N texels
        """
        found = np.zeros((len(samples), len(which)), np.bool_)
        for row, sample in zip(found, samples, strict=True):
            near = _NEAR * self.texels.sizes(self.scene, self.atlas, sample)[which]
            triangle, side, points = self._at(sample, which)
            # Points are tested in batches, because each needs a dozen temporary numbers.
            for at in (slice(first, first + _TOGETHER) for first in range(0, len(which), _TOGETHER)):
                check_time("looking for texels inside of geometry")
                row[at] = self.sides.inside(triangle[at], side[at], points[at], near[at], at.start)
        if self.covered is not None:
            # All samples are tested in one call, because each call reads the streams again.
            columns = zip(*(self._at(sample, which) for sample in samples), strict=True)
            found |= self.covered(*(np.concatenate(column) for column in columns)).reshape(found.shape)
        return found

    def apart(self, middle: int) -> Bools:
        """Return (S, N) bool, True for samples that a wall without thickness separates from the central sample.

        middle : index of the central sample
        """
        scene, atlas, texels = self.scene, self.atlas, self.texels
        size = texels.sizes(scene, atlas, middle)[:, None]
        above = [
            texels.positions(scene, atlas, s) + _ABOVE * size * texels.normals(scene, atlas, s, smooth=False)
            for s in range(len(texels.face))
        ]
        own = atlas.triangle[texels.face[middle]]
        found = []
        for each in above:
            check_time("looking for texels behind walls")
            found.append(self.sides.apart(own, above[middle], each))
        return np.stack(found)

    def _at(self, sample: int, which: Int64) -> tuple[Int64, Int64, Float64]:
        """Return triangle, side and position of a sample of texels (N,)."""
        face = self.texels.face[sample, which]
        points = self.texels.positions(self.scene, self.atlas, sample)[which]
        return self.atlas.triangle[face], self.atlas.side[face], points
