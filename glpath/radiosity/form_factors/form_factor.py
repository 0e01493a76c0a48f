"""Form factors by casting rays from points of the receivers to samples of an emitter (Wallace et al. 1989).

F_ij, from receiver i to emitter j, is the fraction of light leaving i that reaches j. It is also the fraction of
j's radiosity that becomes irradiance of i. It is the mean over points of the receiver, without points buried in a
solid such as a box on the floor. The form factor of each point is, by `kind`,

    "polygon"  Lambert's form factor of the whole emitting triangle, times the visible fraction of its samples
    "disc"     the sum over visible samples of cos cos / (pi r^2 + A / n) * A / n, Wallace's discs

In a closed room without occluders, each row of the matrix sums to 1: within rounding for "polygon", approximately
for "disc". An emitter is divided into 1 to 25 equal parts, with one sample each. The number of parts is such that
the distance is at least five times the size of a part, if 25 parts suffice for that.

J. Wallace, K. Elmquist, E. Haines, "A ray tracing algorithm for progressive radiosity", 1989.

Cost:     a ray per receiver point and emitter sample, but none if the shaft between them contains no occluder.
Poor at:  receivers that touch an emitter, and the penumbra of a lamp for which 25 samples are too few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh.mesh import Elements, Int64, occluder_of_triangle
from glpath.radiosity.mesh.sides import Sides, Solids, sub_triangles
from glpath.radiosity.shafts.ends import Emitter, Receivers
from glpath.radiosity.shafts.options import Statistics
from glpath.radiosity.shafts.visibility import Prepared, Visibility
from glpath.scene import Scene
from glpath.scene.model import Float64, Int32
from glpath.system.heartbeat import heartbeat
from glpath.system.kernels import inner_kernel, kernel
from glpath.system.threads import worker_threads
from glpath.system.time_limit import check_time

Kind = Literal["polygon", "disc"]
KINDS: tuple[Kind, ...] = ("polygon", "disc")
_DOING = "finding form factors"

#: Minimum distance from a receiver point to an emitter, as a multiple of the size of the emitter's parts. Closer
#: emitters get more and smaller parts.
FIVE_TIMES = 5.0
#: If more than this fraction of the points needs rays, rays go to all points, because all share prepared shafts.
_MAX_SHARE = 0.4
#: Minimum height of a point above the emitter's plane, and of the emitter above the point's plane, as a fraction of
#: the emitter's size. Pairs below it exchange no light.
_LEVEL = 1e-9


class FormFactors:
    """Columns of the form factor matrix, from all receivers to one emitter or to a batch of emitters.

    Neighbouring emitters on one polygon form a batch; their rays share shafts and the cost of a call.

    scene      : triangulated scene
    visibility : visibility test, built from `Occluders.of_scene(scene)`
    emitters   : elements that emit
    shooting   : the sides of these elements that emit; columns follow their order
    kind       : "polygon" or "disc", see the module
    max_samples       : maximum number of samples of an emitter: 1, 4, 9, 16 or 25
    points     : number of points per receiver: 1, 4, 9, ...
    together   : maximum number of emitters in a batch
    """

    def __init__(
        self,
        scene: Scene,
        visibility: Visibility,
        emitters: Elements,
        shooting: Sides,
        *,
        kind: Kind = "polygon",
        max_samples: int = 25,
        points: int = 4,
        together: int = 1,
    ) -> None:
        self.scene = scene
        self.visibility = visibility
        self.kind = kind
        self.points = points
        side = round(max_samples**0.5)
        self._tiers = np.array(sorted({1, (1 + side) // 2, side}), np.int64)
        self._samples = {int(k): sub_triangles(int(k)) for k in self._tiers}
        self._polygon = occluder_of_triangle(visibility.occluders.parallelogram)
        self._corners = np.ascontiguousarray(emitters.points(scene, np.eye(3))[shooting.element])
        self._normals = shooting.normal
        edges = np.roll(self._corners, -1, axis=1) - self._corners
        self._size = np.linalg.norm(edges, axis=2).max(axis=1)
        self._areas = (scene.areas[emitters.triangle] / emitters.n**2)[shooting.element]
        self._own = self._polygon[emitters.triangle[shooting.element]]
        self.batches = _batches(self._corners.mean(axis=1), 2 * self._own + shooting.back, together)
        self.batch_of = np.empty(len(shooting), np.int64)
        for i, batch in enumerate(self.batches):
            self.batch_of[batch] = i

    def receivers(self, elements: Elements, sides: Sides) -> ReceiverPoints:
        """Return the points that represent the sides of elements, in the form that `of_batch` takes."""
        solid = self.visibility.occluders.solid[self._polygon]
        points, is_open = Solids.of(self.scene, solid).open_points(elements, sides, self.points)
        check_time()
        each = points.shape[1]
        polygon = np.repeat(self._polygon[elements.triangle[sides.element]], each)
        # Shafts treat each side of a polygon as one receiver.
        key = 2 * polygon + np.repeat(sides.back, each)
        order = np.argsort(key, kind="stable")
        check_time()
        normals = np.ascontiguousarray(np.repeat(sides.normal, each, axis=0)[order])
        receivers = Receivers(points.reshape(-1, 3)[order], key[order].astype(np.int32), normals, polygon[order])
        check_time()
        prepared = self.visibility.prepare(receivers) if len(order) else None
        check_time()
        number = np.repeat(np.arange(len(sides)), each)[order]
        return ReceiverPoints(receivers, prepared, _Lit(receivers.points, normals, number), is_open, each)

    def of_batch(self, batch: int, at: ReceiverPoints) -> tuple[NDArray[np.float32], Statistics]:
        """Return (B, R) float32, form factors from every receiver to each emitter of a batch, and statistics."""
        which = self.batches[batch]
        emitters = _Emitters(self._corners[which], self._normals[which[0]], self._size[which], self._areas[which])
        tier = np.empty((len(at.lit.points), len(which)), np.int8)
        _tiers(at.lit, emitters, self._tiers, tier)
        factors = np.zeros((len(which), len(at.open)))
        took = Statistics()
        for t, k in enumerate(self._tiers):
            wanted = tier == t
            some = np.flatnonzero(wanted.any(axis=1))
            if not len(some):
                continue
            samples = np.einsum("sc,bcx->bsx", self._samples[int(k)], emitters.corners)
            source = Emitter(samples.reshape(-1, 3), emitters.normal, int(self._own[which[0]]))
            if len(some) > _MAX_SHARE * len(tier) and at.prepared is not None:
                some = np.arange(len(tier))
                visible, counts = self.visibility.step(source, at.prepared)
            else:
                visible, counts = self.visibility.step(source, at.some(some))
            took += counts
            exact = self.kind == "polygon"
            _factors(at.lit, emitters, some, wanted, samples, visible, exact, factors)
        heartbeat.beat()
        return (factors / at.each).astype(np.float32), took

    def of_batches(
        self, batches: Sequence[int], at: ReceiverPoints
    ) -> list[tuple[NDArray[np.float32], Statistics]]:
        """Return `of_batch` of several batches, computed in threads. Raises TimeLimitError."""
        found = []
        with worker_threads(self.visibility.stop, doing=_DOING) as pool:
            for one in pool.map(lambda batch: self.of_batch(batch, at), batches):
                found.append(one)
                check_time(_DOING)  # checked here, because worker threads have no time limit
        return found


def _batches(middles: Float64, group: Int64, max_samples: int) -> list[Int64]:
    """Split points (N, 3) into batches of neighbours of the same group (N,); return the indices in each batch.

    max_samples : maximum number of points in a batch
    """
    order = np.argsort(group, kind="stable")
    pending = np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(order) else []
    done = []
    while pending:
        check_time()
        part = pending.pop()
        if len(part) <= max_samples:
            done.append(part)
            continue
        axis = np.argmax(np.ptp(middles[part], axis=0))
        part = part[np.argsort(middles[part, axis], kind="stable")]
        half = len(part) // 2
        pending += [part[half:], part[:half]]
    return done


class _Lit(NamedTuple):
    """Receiver points for the kernels: positions (P, 3), normals (P, 3), and the index (P,) of their receiver."""

    points: Float64
    normals: Float64
    number: Int64


class _Emitters(NamedTuple):
    """Emitters of a batch: triangles (B, 3, 3) in one plane, its normal (3,), longest edges (B,) and areas (B,)."""

    corners: Float64
    normal: Float64
    sizes: Float64
    areas: Float64


@dataclass(frozen=True)
class ReceiverPoints:
    """Points that represent receivers, sorted by polygon and side.

    receivers : points for `Visibility`
    prepared  : the same points, prepared for shafts; None without points
    lit       : the same points, with the index of the receiver of each
    open      : (R,) fraction of each receiver's area that is not buried in a solid
    each      : number of points of a receiver
    """

    receivers: Receivers
    prepared: Prepared | None
    lit: _Lit
    open: Float64
    each: int

    def some(self, which: Int64) -> Receivers:
        r = self.receivers
        assert r.normals is not None
        assert r.polygons is not None
        polygons: Int32 = r.polygons[which]
        return Receivers(r.points[which], r.receiver[which], r.normals[which], polygons)


@kernel
def _tiers(lit, emitters, tiers, tier):  # type: ignore[no-untyped-def]
    """Fill `tier` (P, B) with the index into `tiers` for each point and emitter; -1 if no light can arrive.

    tiers : ascending numbers of samples along an emitter's side; the first that suffices is chosen
    """
    points, normals, _ = lit
    corners, normal, sizes, _ = emitters
    last = len(tiers) - 1
    for p in range(len(points)):
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        for b in range(len(corners)):
            c = corners[b]
            tier[p, b] = -1
            before = (px - c[0, 0]) * normal[0] + (py - c[0, 1]) * normal[1] + (pz - c[0, 2]) * normal[2]
            if before <= _LEVEL * sizes[b]:
                continue
            above = -1.0
            for k in range(3):
                above = max(above, (c[k, 0] - px) * nx + (c[k, 1] - py) * ny + (c[k, 2] - pz) * nz)
            if above <= _LEVEL * sizes[b]:
                continue
            x = px - (c[0, 0] + c[1, 0] + c[2, 0]) / 3
            y = py - (c[0, 1] + c[1, 1] + c[2, 1]) / 3
            z = pz - (c[0, 2] + c[1, 2] + c[2, 2]) / 3
            distance = np.sqrt(x * x + y * y + z * z)
            tier[p, b] = last
            for k in range(last):
                if distance * tiers[k] >= FIVE_TIMES * sizes[b]:
                    tier[p, b] = k
                    break


@kernel
def _factors(lit, emitters, some, wanted, samples, visible, polygon, factors):  # type: ignore[no-untyped-def]
    """Add the form factors of points to the sums `factors` (B, R) of their receivers.

    some    : indices of the points
    wanted  : (P, B) True for the pairs of point and emitter to compute
    samples : (B, S, 3) positions on the emitters
    visible : (len(some), B * S) True if the point sees the sample
    """
    points, normals, number = lit
    corners, normal, _, areas = emitters
    count = samples.shape[1]
    for w in range(len(some)):
        p = some[w]
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        for b in range(len(corners)):
            if not wanted[p, b]:
                continue
            part = areas[b] / count
            total, seen = 0.0, 0.0
            for s in range(count):
                dx, dy, dz = samples[b, s, 0] - px, samples[b, s, 1] - py, samples[b, s, 2] - pz
                here = dx * nx + dy * ny + dz * nz
                there = -(dx * normal[0] + dy * normal[1] + dz * normal[2])
                if here <= 0 or there <= 0:
                    continue
                square = dx * dx + dy * dy + dz * dz
                disc = here * there / square / (np.pi * square + part) * part
                total += disc
                seen += disc * visible[w, b * count + s]
            if not polygon:
                factors[b, number[p]] += seen
            elif seen > 0 or total == 0:
                # If only a part without samples rises above the horizon, this part counts as visible.
                share = seen / total if total > 0 else 1.0
                factors[b, number[p]] += share * triangle_factor(px, py, pz, nx, ny, nz, corners[b])


@inner_kernel
def triangle_factor(px, py, pz, nx, ny, nz, corners):  # type: ignore[no-untyped-def]
    """Return the unoccluded form factor from a small element at p to a triangle (3, 3), seen from either side.

    n is the element's normal. The formula is Lambert's, 1 / (2 pi) sum theta (v_i x v_i+1) / |v_i x v_i+1| . n. It
    is applied to the part of the triangle above the element's plane.
    """
    total = 0.0
    n = (nx, ny, nz)
    into = out = (0.0, 0.0, 0.0)
    clipped = False
    a = (corners[0, 0] - px, corners[0, 1] - py, corners[0, 2] - pz)
    ha = a[0] * nx + a[1] * ny + a[2] * nz
    for k in range(3):
        j = (k + 1) % 3
        b = (corners[j, 0] - px, corners[j, 1] - py, corners[j, 2] - pz)
        hb = b[0] * nx + b[1] * ny + b[2] * nz
        if ha > 0 or hb > 0:
            start, end = a, b
            if ha <= 0 or hb <= 0:
                clipped = True
                t = ha / (ha - hb)
                c = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]))
                if ha <= 0:
                    start = into = c
                else:
                    end = out = c
            total += _edge(start, end, n)
        a, ha = b, hb
    if clipped:
        total += _edge(out, into, n)
    return abs(total) / (2 * np.pi)


@inner_kernel
def _edge(a, b, n):  # type: ignore[no-untyped-def]
    """Return the angle between the vectors a and b, times the cosine between n and the normal of their plane."""
    cx, cy, cz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    sine = np.sqrt(cx * cx + cy * cy + cz * cz)
    if sine == 0:
        return 0.0
    along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return np.arctan2(sine, along) * (cx * n[0] + cy * n[1] + cz * n[2]) / sine
