"""Texels of an atlas: several samples per texel, each with its triangle and barycentric coordinates.

Every texel that a chart touches counts (conservative rasterisation). Its samples form a lattice; samples outside of
the chart are moved to its nearest point.

Cost:     about 5 ns for each sample, triangle and texel that overlap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.atlas import Atlas
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.kernels import kernel
from glpath.system.time_limit import check_time

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

#: Pairs (maximum total area of the faces in texels^2, samples per texel). The first pair whose maximum is not
#: exceeded applies.
SAMPLES = ((1 << 18, 13), (1 << 20, 7), (1 << 62, 5))
#: Generator of the sample lattice for each number of samples.
_GENERATORS = {13: 5, 7: 3, 5: 2}
# Number of page rows per batch; only the texels that charts touch are kept from each batch.
_BAND = 64
#: Minimum distance of samples from chart edges, texels, so that none lies inside an adjoining wall.
_INSET = 0.04


@dataclass(frozen=True, eq=False)
class AtlasTexels:
    """N texels with S samples each.

    page, row, column : (N,)
    face    : (S, N) index of a face of the atlas
    b       : (S, N, 2) float32 barycentric coordinates b1, b2 in the triangle of that face
    """

    page: Int64
    row: Int64
    column: Int64
    face: Int32
    b: Float32

    @property
    def index(self) -> tuple[Int64, Int64, Int64]:
        """Indices of the texels in arrays (pages, h, w)."""
        return self.page, self.row, self.column

    def positions(self, scene: Scene, atlas: Atlas, sample: int) -> Float64:
        """Return world positions (N, 3) of one sample of each texel."""
        return self._mixed(scene.triangles[atlas.triangle], sample)

    def normals(self, scene: Scene, atlas: Atlas, sample: int, smooth: bool = True) -> Float64:
        """Return (N, 3) unit normals out of the baked side: smooth shading normals, or those of the faces."""
        plain = atlas.normals(scene)
        if not smooth:
            return np.asarray(plain[self.face[sample]])
        mixed = self._mixed(atlas.corner_normals(scene), sample)
        length = np.sqrt(np.einsum("ij,ij->i", mixed, mixed))[:, None]
        gone = length[:, 0] <= 1e-9
        mixed /= np.maximum(length, 1e-9)
        mixed[gone] = plain[self.face[sample, gone]]
        return mixed

    def _mixed(self, corners: Float64, sample: int) -> Float64:
        """Interpolate corner values (F, 3, 3) of faces at a sample of each texel; (N, 3)."""
        mixed = np.empty((self.face.shape[1], 3))
        _mix(np.ascontiguousarray(corners), self.face[sample], self.b[sample], mixed)
        return mixed

    def sizes(self, scene: Scene, atlas: Atlas, sample: int) -> Float64:
        """Return the side (N,) of each texel's square on the surface, scene units."""
        face = self.face[sample]
        return np.asarray(np.sqrt(scene.areas[atlas.triangle] / np.maximum(atlas.areas, 1e-12))[face])

    def with_samples_of(self, source: Int64) -> AtlasTexels:
        """Return texels whose sample s is replaced by sample source[s] of the same texel; source: (S, N)."""
        texel = np.arange(source.shape[1])
        return replace(self, face=self.face[source, texel], b=self.b[source, texel])


def rasterised(atlas: Atlas) -> AtlasTexels:
    """Return all texels of an atlas, in the order of its pages and rows."""
    width, height = atlas.size
    count = next(samples for limit, samples in SAMPLES if atlas.areas.sum() <= limit)
    offsets = lattice(count)
    made = []
    for page in range(atlas.pages):
        faces = np.flatnonzero((atlas.page == page) & (atlas.areas > 0)).astype(np.int32)
        uv = np.ascontiguousarray(atlas.uv[faces])
        for first in range(0, height, _BAND):
            check_time("rasterising the atlas")
            rows = min(_BAND, height - first)
            best = np.full((rows, width, count), np.inf, np.float32)
            face = np.zeros((rows, width, count), np.int32)
            b = np.zeros((rows, width, count, 2), np.float32)
            _fill(uv, offsets, first, best, face, b)
            row, column = np.nonzero(np.isfinite(best[..., 0]))
            made.append((np.full(len(row), page), first + row, column, faces[face[row, column]], b[row, column]))
    page_of, row, column = (np.concatenate([part[i] for part in made]) for i in range(3))
    face, b = np.empty((count, len(row)), np.int32), np.empty((count, len(row), 2), np.float32)
    done = 0
    for part in made:
        some = slice(done, done + len(part[0]))
        face[:, some], b[:, some] = part[3].T, part[4].transpose(1, 0, 2)
        done = some.stop
    _inset(atlas.uv, face, b)
    return AtlasTexels(page_of, row, column, face, b)


def lattice(count: int) -> Float64:
    """Return (S, 2) points in the unit square, one in each row and column of S x S cells, far from each other."""
    i = np.arange(count)
    return np.stack([(i + 0.5) / count, (i * _GENERATORS[count] % count + 0.5) / count], axis=1)


@kernel
def _mix(corners, face, b, mixed):  # type: ignore[no-untyped-def]
    for i in range(len(face)):
        f, b1, b2 = face[i], np.float64(b[i, 0]), np.float64(b[i, 1])
        for k in range(3):
            first = corners[f, 0, k]
            mixed[i, k] = first + b1 * (corners[f, 1, k] - first) + b2 * (corners[f, 2, k] - first)


@kernel
def _inset(uv, face, b):  # type: ignore[no-untyped-def]
    """Move barycentric coordinates (S, N, 2), in faces (S, N) of uv (F, 3, 2), away from edges by `_INSET`."""
    for s in range(face.shape[0]):
        for i in range(face.shape[1]):
            f = face[s, i]
            x1, y1 = uv[f, 1, 0] - uv[f, 0, 0], uv[f, 1, 1] - uv[f, 0, 1]
            x2, y2 = uv[f, 2, 0] - uv[f, 0, 0], uv[f, 2, 1] - uv[f, 0, 1]
            doubled = max(abs(x1 * y2 - y1 * x2), 1e-12)
            min0 = min(_INSET * np.hypot(x2 - x1, y2 - y1) / doubled, 0.3)
            min1 = min(_INSET * np.hypot(x2, y2) / doubled, 0.3)
            min2 = min(_INSET * np.hypot(x1, y1) / doubled, 0.3)
            b1, b2 = np.float64(b[s, i, 0]), np.float64(b[s, i, 1])
            b0 = 1 - b1 - b2
            if b0 >= min0 and b1 >= min1 and b2 >= min2:
                continue
            # Raise coordinates that are too small to their minimum. Scale the excess of the others so that the sum
            # stays 1.
            above0, above1, above2 = max(b0 - min0, 0.0), max(b1 - min1, 0.0), max(b2 - min2, 0.0)
            free = (1 - min0 - min1 - min2) / max(above0 + above1 + above2, 1e-12)
            b[s, i, 0], b[s, i, 1] = min1 + free * above1, min2 + free * above2


@kernel
def _fill(uv, offsets, first_row, best, face, barycentrics):  # type: ignore[no-untyped-def]
    """Find the nearest face and the point in it for all samples of the texels that faces (F, 3, 2) touch.

    best : (h, w, S) squared distance in texels, for rows from `first_row` on; initially infinite
    """
    height, width, count = best.shape
    for f in range(len(uv)):
        x0, y0, x1, y1, x2, y2 = uv[f, 0, 0], uv[f, 0, 1], uv[f, 1, 0], uv[f, 1, 1], uv[f, 2, 0], uv[f, 2, 1]
        doubled = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if doubled == 0:
            continue
        sign = 1.0 if doubled > 0 else -1.0
        left = max(int(np.floor(min(x0, x1, x2))), 0)
        right = min(int(np.ceil(max(x0, x1, x2))), width)
        top = max(int(np.floor(min(y0, y1, y2))), first_row)
        bottom = min(int(np.ceil(max(y0, y1, y2))), first_row + height)
        # Edge i is opposite to corner i; its function is positive inside.
        ax0, ay0 = sign * (y1 - y2), sign * (x2 - x1)
        ax1, ay1 = sign * (y2 - y0), sign * (x0 - x2)
        ax2, ay2 = sign * (y0 - y1), sign * (x1 - x0)
        margin0, margin1, margin2 = (
            0.5 * (abs(ax0) + abs(ay0)),
            0.5 * (abs(ax1) + abs(ay1)),
            0.5 * (abs(ax2) + abs(ay2)),
        )
        for y in range(top, bottom):
            row = y - first_row
            for column in range(left, right):
                cx, cy = column + 0.5, y + 0.5
                if (
                    ax0 * (cx - x1) + ay0 * (cy - y1) + margin0 <= 0
                    or ax1 * (cx - x2) + ay1 * (cy - y2) + margin1 <= 0
                    or ax2 * (cx - x0) + ay2 * (cy - y0) + margin2 <= 0
                ):
                    continue
                for s in range(count):
                    px, py = column + offsets[s, 0], y + offsets[s, 1]
                    e0 = (ax0 * (px - x1) + ay0 * (py - y1)) / (sign * doubled)
                    e1 = (ax1 * (px - x2) + ay1 * (py - y2)) / (sign * doubled)
                    e2 = (ax2 * (px - x0) + ay2 * (py - y0)) / (sign * doubled)
                    if e0 >= 0 and e1 >= 0 and e2 >= 0:
                        best[row, column, s] = 0.0
                        face[row, column, s] = f
                        barycentrics[row, column, s, 0], barycentrics[row, column, s, 1] = e1, e2
                        continue
                    for i in range(3):
                        j, k = (i + 1) % 3, (i + 2) % 3
                        dx, dy = uv[f, k, 0] - uv[f, j, 0], uv[f, k, 1] - uv[f, j, 1]
                        length = dx * dx + dy * dy
                        t = ((px - uv[f, j, 0]) * dx + (py - uv[f, j, 1]) * dy) / length if length > 0 else 0.0
                        t = min(max(t, 0.0), 1.0)
                        qx, qy = uv[f, j, 0] + t * dx - px, uv[f, j, 1] + t * dy - py
                        distance = qx * qx + qy * qy
                        if distance < best[row, column, s]:
                            best[row, column, s] = distance
                            face[row, column, s] = f
                            # Corner i has the weight 0, j has 1 - t, k has t.
                            barycentrics[row, column, s, 0] = 0.0 if i == 1 else (t if k == 1 else 1 - t)
                            barycentrics[row, column, s, 1] = 0.0 if i == 2 else (t if k == 2 else 1 - t)
