"""Seams: edges of a smooth surface that two charts share, where look-ups on either side are to agree.

Values along such an edge are made alike by least squares: texels change as little as they may while bilinear
look-ups at points of the edge, on both charts, come together. [Iwanicki 2013; Rakhteenko 2018]

Cost:     a sparse system of the texels beside seams, solved by conjugate gradients: a second for 100,000.
Poor at:  noise, which near a seam is spread by it.

[Iwanicki 2013] M. Iwanicki, "Lighting technology of The Last of Us", SIGGRAPH 2013 talks.
[Rakhteenko 2018] A. Rakhteenko, "Baking artifact-free lightmaps on the GPU",
https://ndotl.wordpress.com/2018/08/29/baking-artifact-free-lightmaps
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from glpath.bake.atlas import Atlas
from glpath.scene import Scene
from glpath.scene.model import Float64

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

#: Cosine between the normals on both sides above which a surface goes on smoothly.
_SMOOTH = 0.995
#: Points of a seam for each texel along it.
_DENSITY = 3.0
#: What a step weighs beside a change of a texel, and what a change of one that only fills a gutter does.
_STEP, _GUTTER = 1000.0, 0.02
#: Both count by their share of the value there, or of this share of the mean where that is darker.
DARK = 0.05


@dataclass(frozen=True, eq=False)
class Seams:
    """K points, twice each on the pages.

    page : (2, K);  uv : (2, K, 2), texels
    """

    page: Int64
    uv: Float64

    def __len__(self) -> int:
        return int(self.page.shape[1])

    @classmethod
    def of(cls, scene: Scene, atlas: Atlas) -> Seams:
        """Of all charts."""
        ends = _edges(scene, atlas)
        if not len(ends[0]):
            return cls(np.zeros((2, 0), np.int64), np.zeros((2, 0, 2)))
        faces, uv = ends
        length = np.linalg.norm(uv[:, :, 1] - uv[:, :, 0], axis=2).max(axis=1)
        count = np.ceil(_DENSITY * length).astype(np.int64) + 1
        which = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        t = ((step + 0.5) / count[which])[:, None, None]
        at = (1 - t) * uv[which][:, :, 0] + t * uv[which][:, :, 1]
        return cls(atlas.page[faces[which]].T, at.transpose(1, 0, 2))

    def values(self, pages: Float32) -> Float64:
        """(2, K, 3): bilinear look-ups of pages (P, h, w, 3) on both sides."""
        index, weights = self._texels(pages.shape)
        flat = pages.reshape(-1, pages.shape[-1])
        return np.asarray(np.einsum("skt,sktc->skc", weights, flat[index].astype(np.float64)))

    def stitched(self, pages: Float32, baked: NDArray[np.bool_]) -> Float32:
        """The pages (P, h, w, 3) without steps.

        baked : (P, h, w), where light was computed, not only continued
        """
        from scipy.sparse import coo_array, diags_array
        from scipy.sparse.linalg import cg

        if not len(self):
            return pages
        index, weights = self._texels(pages.shape)
        used, number = np.unique(index, return_inverse=True)
        number = number.reshape(index.shape)
        rows = np.broadcast_to(np.arange(len(self))[None, :, None], index.shape)
        signed = weights * np.array([1.0, -1.0])[:, None, None]
        before = pages.reshape(-1, 3)[used].astype(np.float64)
        light = before.mean(axis=1)
        dark = max(DARK * float(light.mean()), 1e-12)
        at = np.einsum("skt,skt->k", weights, light[number]) / 2
        signed /= (at + dark)[None, :, None]
        jumps = coo_array((signed.ravel(), (rows.ravel(), number.ravel())), shape=(len(self), len(used))).tocsr()
        keep = np.where(baked.ravel()[used], 1.0, _GUTTER) / (light + dark) ** 2
        system = (diags_array(keep) + _STEP * (jumps.T @ jumps)).tocsr()
        scale = diags_array(1.0 / system.diagonal())
        made = pages.copy()
        for channel in range(3):
            x, _ = cg(system, keep * before[:, channel], x0=before[:, channel], rtol=1e-6, maxiter=2000, M=scale)
            made.reshape(-1, 3)[used, channel] = np.maximum(x, 0.0)
        return made

    def _texels(self, shape: tuple[int, ...]) -> tuple[Int64, Float64]:
        """(2, K, 4) numbers of texels and their weights."""
        _, height, width = shape[:3]
        x, y = self.uv[..., 0] - 0.5, self.uv[..., 1] - 0.5
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = x - column, y - row
        index, weights = [], []
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            r, c = np.clip(row + down, 0, height - 1), np.clip(column + right, 0, width - 1)
            index.append((self.page * height + r) * width + c)
            weights.append((fy if down else 1 - fy) * (fx if right else 1 - fx))
        return np.stack(index, axis=-1), np.stack(weights, axis=-1)


def _edges(scene: Scene, atlas: Atlas) -> tuple[Int64, Float64]:
    """Pairs of faces (E, 2) and the ends (E, 2, 2, 2) of their common edge on either's page, in one order."""
    count = len(atlas.triangle)
    corners = scene.triangles[atlas.triangle]
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    normals = _corner_normals(scene, atlas)
    i, j = np.array([0, 1, 2]), np.array([1, 2, 0])
    start, end = vertex[:, i].ravel(), vertex[:, j].ravel()
    face = np.repeat(np.arange(count), 3)
    corner = np.stack([np.tile(i, count), np.tile(j, count)], axis=1)
    corner[start > end] = corner[start > end][:, ::-1]
    key = np.minimum(start, end) * (int(vertex.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    borders = np.flatnonzero(np.diff(key[order])) + 1
    groups = np.split(order, borders)
    pairs = [pair for group in groups if 1 < len(group) <= 6 for pair in combinations(group, 2)]
    if not pairs:
        return np.zeros((0, 2), np.int64), np.zeros((0, 2, 2, 2))
    a, b = np.array(pairs, np.int64).T
    fa, fb = face[a], face[b]
    uv = np.stack([atlas.uv[fa[:, None], corner[a]], atlas.uv[fb[:, None], corner[b]]], axis=1)
    na, nb = normals[fa[:, None], corner[a]], normals[fb[:, None], corner[b]]
    smooth = (np.einsum("ecx,ecx->ec", na, nb) > _SMOOTH).all(axis=1)
    apart = (atlas.page[fa] != atlas.page[fb]) | (np.abs(uv[:, 0] - uv[:, 1]).max(axis=(1, 2)) > 1e-3)
    wanted = smooth & apart
    return np.stack([fa, fb], axis=1)[wanted], uv[wanted]


def _corner_normals(scene: Scene, atlas: Atlas) -> Float64:
    """(F, 3, 3): the smooth normal of each corner, or the face's, out of the side that is baked."""
    shapes = scene.shapes
    smooth = shapes.vertex_normals[shapes.faces[atlas.triangle]]
    has = np.abs(smooth).sum(axis=2, keepdims=True) > 0
    normals = np.where(has, smooth, scene.normals[atlas.triangle][:, None])
    return np.asarray(normals * (1 - 2 * atlas.side)[:, None, None])
