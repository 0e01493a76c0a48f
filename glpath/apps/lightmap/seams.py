"""Seams: edges of a smooth surface at which two charts meet. Look-ups on both sides are made equal there.

A step is the difference between the bilinear look-ups on both charts at a point of the edge. Least squares make
steps too small to be seen, while texels change as little as possible. [Iwanicki 2013; Rakhteenko 2018]

Cost:     a sparse system of the texels beside seams, factored about thirty times per channel, mostly for the few
          texels beside remaining steps: 2 s for 7,000 points of seams, 12 s for 27,000.
Poor at:  a terminator as sharp as a texel across a seam. Two lattices of texels cannot both contain its kink, so it
          moves by up to a texel. Noise near a seam is spread.

[Iwanicki 2013] M. Iwanicki, "Lighting technology of The Last of Us", SIGGRAPH 2013 talks.
[Rakhteenko 2018] A. Rakhteenko, "Baking artifact-free lightmaps on the GPU",
https://ndotl.wordpress.com/2018/08/29/baking-artifact-free-lightmaps
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.atlas import Atlas
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.colour import luminance

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Cosine between the normals on both sides above which a surface is smooth.
_SMOOTH = 0.995
#: Number of points on a seam for each texel along it.
_DENSITY = 3.0
#: Maximum remaining step at a seam, as a fraction of the mean value of both sides.
LIMIT = 0.018
#: Lower bound of that mean value, relative to the mean light of the pages, so that dark steps may be larger.
DARK = 0.01
#: Weight of a step in the first round, relative to the weight of a texel's change.
_FIRST = 10.0
#: Weight of the change of a gutter's texel, relative to the weight of a baked texel's change.
_GUTTER = 0.02
#: The change of a texel is weighed relative to the light around it plus this multiple of the mean light. With a
#: smaller multiple, the bright side of a terminator would become as dark as the dark side.
_FAINT = 1.0
#: Maximum number of rounds.
_ROUNDS = 30
#: Maximum number of iterations, per round and channel, that find the texels to hold at zero.
_HOLDS = 12
#: Number of rings of neighbouring texels around a remaining step that the next rounds still change.
_RINGS = 16
#: Maximum number of faces that share an edge; edges of more faces get no seams.
_MEETING = 6


@dataclass(frozen=True, eq=False)
class Seams:
    """K points of seams, each with a position on both charts.

    page : (2, K) page indices
    uv   : (2, K, 2) positions on the pages, texels
    """

    page: Int64
    uv: Float64

    def __len__(self) -> int:
        return int(self.page.shape[1])

    @classmethod
    def of(cls, scene: Scene, atlas: Atlas) -> Seams:
        """Return the seams of all charts."""
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
        """Return (2, K, 3) bilinear look-ups of pages (P, h, w, 3) on both sides of the seams."""
        index, weights = self._texels(pages.shape)
        flat = pages.reshape(-1, pages.shape[-1])
        return np.asarray(np.einsum("skt,sktc->skc", weights, flat[index].astype(np.float64)))

    def stitched(self, pages: Float32, baked: Bools, lit: Bools | None = None) -> Float32:
        """Return pages (P, h, w, 3) changed as little as possible so that all steps are below `LIMIT`.

        Steps weigh little at first, and steps above the limit weigh more in each further round. Texels that would
        become negative are held at zero.

        baked : (P, h, w) bool, True for texels with computed light, False for gutters
        lit   : (P, h, w) bool, True if the rendered light is above zero; None if `pages` is the rendered light
        """
        from scipy.sparse import coo_array, diags_array

        if not len(self):
            return pages
        index, weights = self._texels(pages.shape)
        used, number = np.unique(index, return_inverse=True)
        number = number.reshape(index.shape)
        rows = np.broadcast_to(np.arange(len(self))[None, :, None], index.shape)
        before = pages.reshape(-1, 3)[used].astype(np.float64)
        with_light = np.asarray((pages > 0).any(axis=-1)) if lit is None else lit
        lit_values = pages[lit_texels(with_light, baked)].astype(np.float64)
        mean = max(float(lit_values.mean()), 1e-12)
        dark = DARK * max(float(luminance(lit_values).mean()), 1e-12)

        def per_texel(values: Float64) -> Any:
            return coo_array((values.ravel(), (rows.ravel(), number.ravel())), shape=(len(self), len(used))).tocsr()

        both, jump = per_texel(weights / 2), per_texel(weights * np.array([1.0, -1.0])[:, None, None])
        # Changes are weighed relative to the light around a texel, because its own light is noisy.
        about = (both.T @ (both @ before.mean(axis=1))) / np.maximum(both.T @ np.ones(len(self)), 1e-12)
        keep = np.where(baked.ravel()[used], 1.0, _GUTTER) / (about + _FAINT * mean) ** 2
        weight = np.full(len(self), _FIRST)
        x, held, near = before.copy(), np.zeros(before.shape, np.bool_), np.ones(len(used), np.bool_)
        for _ in range(_ROUNDS):
            over = 1.0 / np.maximum(both @ x.mean(axis=1), DARK * mean)
            system = (diags_array(keep) + jump.T @ diags_array(weight * over**2) @ jump).tocsr()
            x, held = _minimise(system, keep[:, None] * before, x, held, near)
            # Maximum of the steps of the colour channels, then also of the step of luminance.
            step = over * np.abs(jump @ x).max(axis=1)
            light = luminance(x)
            step = np.maximum(step, np.abs(jump @ light) / np.maximum(both @ light, dark))
            if (step <= LIMIT).all():
                break
            weight *= np.clip(1.5 * step / LIMIT, 1.0, 10.0)
            # Only texels near remaining steps change in the next round.
            near = both.T @ (step > LIMIT) > 0
            for _ in range(_RINGS):
                near = both.T @ (both @ near) > 0
        made = pages.copy()
        made.reshape(-1, 3)[used] = x
        return made

    def _texels(self, shape: tuple[int, ...]) -> tuple[Int64, Float64]:
        """Return (2, K, 4) indices of the texels of each look-up, and their weights."""
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


def lit_texels(lit: Bools, baked: Bools) -> Bools:
    """Return (P, h, w) bool: True for texels that statistics use.

    These are baked texels with light, or all baked texels if none has light.

    Surfaces without light, such as undersides of floors, would make the mean depend on their area.

    lit : (P, h, w) bool, True if the rendered light is above zero, before a denoiser spreads light to dark texels
    """
    counted = baked & lit
    return np.asarray(counted if counted.any() else baked)


def _minimise(
    system: Any, right: Float64, given: Float64, held: NDArray[np.bool_], near: NDArray[np.bool_]
) -> tuple[Float64, NDArray[np.bool_]]:
    """Solve a symmetric linear system for C right sides of length N, so that no solution is negative.

    Returns the solutions, and (N, C) bool, True for solutions that are held at zero. Negative solutions are held,
    and held solutions that the system pulls above zero are released.

    given : (N, C) solutions to keep for texels that are not `near`
    held  : (N, C) bool, True for solutions held at zero at first
    near  : (N,) bool, True for texels that may change
    """
    from scipy.sparse.linalg import splu

    made, held = given.copy(), held.copy()
    factored: dict[bytes, Any] = {}  # channels that hold the same texels at zero share a factorization
    for c in range(right.shape[1]):
        for turn in range(_HOLDS):
            free = np.flatnonzero(near & ~held[:, c])
            x = np.where(near, 0.0, given[:, c])
            if len(free):
                rows, key = system[free], free.tobytes()
                if key not in factored:
                    factored.clear()  # keeps one factorization, because it may be large
                    factored[key] = splu(rows[:, free].tocsc(), permc_spec="MMD_AT_PLUS_A")
                x[free] = factored[key].solve(right[free, c] - rows @ x)
            pulled = system @ x < right[:, c]
            # In the second half of the iterations, no texel is released from zero, so that the loop converges.
            pushed = np.where(near, (x < 0) | (held[:, c] & ~(pulled & (turn < _HOLDS // 2))), held[:, c])
            settled = np.array_equal(pushed, held[:, c])
            held[:, c] = pushed
            if settled:
                break
        made[:, c] = np.maximum(x, 0.0)
    return made, held


def _edges(scene: Scene, atlas: Atlas) -> tuple[Int64, Float64]:
    """Return (E, 2) pairs of faces at a seam, and (E, 2, 2, 2) the ends of their common edge.

    The ends are in texels on the page of each face, in the same order for both faces.
    """
    count = len(atlas.triangle)
    corners = scene.triangles[atlas.triangle]
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    normals = atlas.corner_normals(scene)
    i, j = np.array([0, 1, 2]), np.array([1, 2, 0])
    start, end = vertex[:, i].ravel(), vertex[:, j].ravel()
    face = np.repeat(np.arange(count), 3)
    corner = np.stack([np.tile(i, count), np.tile(j, count)], axis=1)
    corner[start > end] = corner[start > end][:, ::-1]
    key = np.minimum(start, end) * (int(vertex.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    uses = np.repeat(np.diff(np.append(first, len(order))), np.diff(np.append(first, len(order))))
    pairs = []
    for step in range(1, _MEETING):
        same = np.flatnonzero((key[order[step:]] == key[order[:-step]]) & (uses[step:] <= _MEETING))
        pairs.append(np.stack([order[same], order[same + step]]))
    a, b = np.concatenate(pairs, axis=1)
    if not len(a):
        return np.zeros((0, 2), np.int64), np.zeros((0, 2, 2, 2))
    fa, fb = face[a], face[b]
    uv = np.stack([atlas.uv[fa[:, None], corner[a]], atlas.uv[fb[:, None], corner[b]]], axis=1)
    na, nb = normals[fa[:, None], corner[a]], normals[fb[:, None], corner[b]]
    smooth = (np.einsum("ecx,ecx->ec", na, nb) > _SMOOTH).all(axis=1)
    apart = (atlas.page[fa] != atlas.page[fb]) | (np.abs(uv[:, 0] - uv[:, 1]).max(axis=(1, 2)) > 1e-3)
    some = atlas.areas > 0  # a face that is a point on its page has no edges
    wanted = smooth & apart & some[fa] & some[fb]
    return np.stack([fa, fb], axis=1)[wanted], uv[wanted]
