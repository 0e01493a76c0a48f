"""Find which sides of surfaces get texels, and which points on those sides lie inside other geometry.

All sides that can be seen get texels: every front, and the back of a two-sided material. The inside of a closed
solid gets none, because `solids` proves that it is never seen. A side is dark if no chain of rays leads from it to
a lamp, to the sky or to a punctual light. Dark sides still get a few texels, because samples may have
missed a lamp. A point is inside other geometry if all its rays meet dark sides, such as the floor under a box.

Cost:     a few hundred thousand rays on the CPU for the sides; a ray or two for each point.
Poor at:  light through a hole that none of some thousand rays from a surface finds. Texels of that surface are
          large.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import light_shines
from glpath.radiosity.shafts.rays import Rays, nearest, rays_of
from glpath.rendering.solids import inside_solids
from glpath.scene import Scene
from glpath.scene.model import Float64, Light
from glpath.scene.pieces import pieces
from glpath.system.kernels import kernel
from glpath.system.threads import in_threads
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Number of random walks from a side of a piece in each round. Rounds continue until the side counts as lit.
_ROUNDS = (16, 64, 256, 1024)
#: Maximum number of walks from all sides in a round, but each side has at least one.
_RAYS = 1 << 17
#: Fraction of a side's walks that reach light, from which the side counts as lit after any round.
_SURELY = 0.02
#: Value of `_SURELY` after the last round. It is above zero, because a few walks slip through edges.
_SLIPS = 1e-3
#: Texels per length on a dark side, relative to a lit side.
_DARK = 0.25
#: Distance of the start of rays from a surface, as a fraction of the scene's diagonal.
_BEFORE = 1e-6
#: Number of rays from a point. The point is inside other geometry if all of them meet dark sides.
_LOOKS = 16
#: Fraction of a point's rays. If at least this fraction meets dark sides within two texels, it is inside, too.
_BESIDE = 0.25
#: Number of attempts to connect a point to lamps, and maximum number of punctual lights of an attempt. If a scene
#: has more, each point tries random ones.
_JOINS = 8
#: Number of rays that a thread traces in one batch.
_TOGETHER = 1 << 14
#: Maximum number of bounces of a random walk that looks for light.
_BOUNCES = 8


class Backs(NamedTuple):
    """Normals (T, 3) of triangles, and (T,) bool, True for triangles with a culled back."""

    normals: Float64
    culled: Bools


@kernel
def _cast(rays, backs, origins, directions, own, hits, distances, work):  # type: ignore[no-untyped-def]
    """Fill the first hit and its distance for each ray. Rays pass through culled backs.

    work : (2, 3) memory for temporary values
    """
    o, found = work[0], work[1]
    for i in range(len(origins)):
        skipped, distances[i] = own[i], 0.0
        for k in range(3):
            o[k] = origins[i, k]
        while True:
            hit = nearest(rays, o, directions[i], skipped, found)
            if hit < 0:
                distances[i] = np.inf
                break
            distances[i] += found[0]
            along = 0.0
            for k in range(3):
                along += backs.normals[hit, k] * directions[i, k]
                o[k] += found[0] * directions[i, k]
            if not (backs.culled[hit] and along > 0):
                break
            skipped = hit
        hits[i] = hit


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of a scene's triangles: 0 is the front, 1 the back.

    shown   : (T, 2) bool, True for sides that get texels; each triangle has at least one such side
    hidden  : (T, 2) bool, True for sides without texels because they are the inside of a closed solid
    lit     : (T, 2) bool, True for shown sides that emit light, or that light was found to reach
    beyond  : True if rays that leave the scene count as reaching light
    """

    scene: Scene
    shown: Bools
    hidden: Bools
    lit: Bools
    rays: Rays
    surfaces: _Surfaces
    beyond: bool

    @classmethod
    def of(cls, scene: Scene, seed: int = 0, streamed: bool = False) -> Sides:
        """Return the sides of a triangulated scene.

        seed     : seed of the rays that look for light; `shown` does not depend on it
        streamed : True if the scene has streamed triangles around it. They reflect light, so rays that leave the
                   scene then count as reaching light
        """
        check_time()
        beyond = _shines_from_everywhere(scene) or streamed
        rays = rays_of(scene)
        check_time()
        surfaces = _Surfaces.of(scene)
        hidden = np.zeros(surfaces.sends.shape, np.bool_)
        if surfaces.sends.all(axis=1).any():
            hidden = surfaces.sends & inside_solids(scene, rays, ~surfaces.passes, surfaces.shines)
            # A side counts as hidden only if both sides of its triangle reflect or emit light.
            hidden[~np.asarray(surfaces.sends.all(axis=1))] = False
        check_time()
        shown = surfaces.sends & ~hidden
        lit = _lit(scene, rays, surfaces, shown, seed, beyond)
        return cls(scene, shown, hidden, lit, rays, surfaces, beyond)

    @property
    def density(self) -> Float64:
        """Texels per length (T, 2) on each side, relative to a lit side; 0 for sides that get no texels."""
        return np.where(self.shown, np.where(self.lit, 1.0, _DARK), 0.0)

    def inside(self, triangle: Int64, side: Int64, points: Float64, near: Float64, first: int = 0) -> Bools:
        """Return (N,) bool: True for points (N, 3) of triangle sides that are inside or behind other geometry.

        near  : (N,) distance from dark sides up to which points behind a thin wall count as inside, scene units
        first : index of the first point among the points of several calls; each index has its own ray directions
        """
        normals, origins = points_before(self, triangle, side, points)
        count = len(points)
        dark, close = np.zeros(count), np.zeros(count)
        left = np.arange(count)
        for look in range(_LOOKS):
            directions = hemisphere(normals[left], first + left, look, _LOOKS)
            hit, back, distance = _hit(self.surfaces, self.rays, origins[left], directions, triangle[left])
            lit = np.where(hit >= 0, self.lit[hit, back], self.beyond)
            dark[left] += (hit >= 0) & ~lit
            close[left] += (hit >= 0) & ~lit & (distance < near[left])
            left = left[~lit]
            if not len(left):
                break
        left = left[(dark[left] == _LOOKS) | (close[left] >= _BESIDE * _LOOKS)]
        left = left[~self._joined(origins[left], normals[left], triangle[left])]
        found = np.zeros(count, np.bool_)
        found[left] = True
        return found

    def cast(self, origins: Float64, directions: Float64, own: Int64) -> tuple[Int64, Int64, Float64]:
        """Return the first hits of rays with this scene, as `cast` does."""
        return _hit(self.surfaces, self.rays, origins, directions, own)

    def apart(self, triangle: Int64, points: Float64, others: Float64) -> Bools:
        """Return (N,) bool: True if a wall without thickness, lit on both sides, separates two points.

        triangle       : (N,) triangles that `points` are on, which do not count as walls
        points, others : (N, 3)
        """
        thin = np.asarray(self.lit.all(axis=1))
        found = np.zeros(len(points), np.bool_)
        if thin.any():
            towards, length = _unit(others - points)
            some = np.flatnonzero(length > 0)
            hit, _, distance = _hit(self.surfaces, self.rays, points[some], towards[some], triangle[some])
            found[some] = (hit >= 0) & (distance < length[some]) & thin[hit]
        return found

    def _joined(self, origins: Float64, normals: Float64, own: Int64) -> Bools:
        """Return bool: True for origins that see a light without a bounce."""
        found = np.zeros(len(origins), np.bool_)
        surfaces, random = self.surfaces, np.random.default_rng(1)
        if not len(origins):
            return found
        lamps = (ray for _ in range(_JOINS) for ray in _to_lamps(self.scene, surfaces, origins, random))
        for towards, length, target in chain(_to_lights(surfaces, origins, random, _JOINS**2), lamps):
            check_time()
            facing = np.einsum("ij,ij->i", towards, normals) > 0
            hit, _, distance = _hit(self.surfaces, self.rays, origins, towards, own)
            found |= facing & _reaches(hit, distance, length, target)
        return found


def points_before(sides: Sides, triangle: Int64, side: Int64, points: Float64) -> tuple[Float64, Float64]:
    """Return normals (N, 3) of triangle sides, and origins (N, 3) of rays that leave these sides at points (N, 3).

    An origin is its point, moved off the surface by `_BEFORE` times the scene's diagonal along the normal.
    """
    normals = sides.surfaces.normals[triangle] * (1 - 2 * side)[:, None]
    return normals, points + _BEFORE * _size(sides.scene) * normals


def _lit(scene: Scene, rays: Rays, surfaces: _Surfaces, shown: Bools, seed: int, beyond: bool) -> Bools:
    """Return (T, 2) bool, True for lit sides.

    Random walks start on each side of each connected piece of a mesh. All triangles of a piece have the same result
    on the same side. A walk reaches light if it hits a light, or if one of its points sees a light. If few walks
    from a side reach light, more walks start in the next round, because small lamps and far windows are seldom hit.
    """
    # A piece consists of the triangles of a shape that are connected by shared corners.
    shape = np.broadcast_to(scene.triangle_shape[:, None, None], (len(scene.triangles), 3, 1))
    piece = pieces(np.concatenate([scene.triangles, shape], axis=2))
    count = int(piece.max()) + 1
    order = np.argsort(piece, kind="stable")
    first = np.searchsorted(piece[order], np.arange(count + 1))
    # The index of a side of a piece is 2 * piece + side.
    exists = np.zeros(2 * count, np.bool_)
    for side in range(2):
        exists[2 * piece[shown[:, side]] + side] = True
    walks, ended, lit = np.zeros(2 * count), np.zeros(2 * count), np.zeros(2 * count, np.bool_)
    random = np.random.default_rng(seed)
    for number in _ROUNDS:
        asked = np.flatnonzero(exists & ~lit)
        if not len(asked):
            break
        some = np.repeat(asked, max(min(number, _RAYS // len(asked)), 1))
        start, size = first[some // 2], np.diff(first)[some // 2]
        triangle = order[start + (random.random(len(some)) * size).astype(np.int64)]
        points = _on(scene.triangles[triangle], random.random((len(some), 2)))
        bright = _walk(scene, rays, surfaces, triangle, some % 2, points, random, beyond)
        walks += np.bincount(some, minlength=2 * count)
        ended += np.bincount(some, bright, 2 * count)
        lit = (ended > 1) & (ended >= _SURELY * walks)
    lit |= (ended > 1) & (ended >= _SLIPS * walks)
    of_piece = lit.reshape(-1, 2)[piece]
    return np.asarray((of_piece & shown) | (surfaces.shines & shown))


@dataclass(frozen=True, eq=False)
class _Surfaces:
    """Optical properties of a scene's triangles.

    shines  : (T, 2) bool, True for sides that emit light
    sends   : (T, 2) bool, True for sides that reflect or emit light: all fronts, and some backs
    passes  : (T,) bool, True for triangles that light can pass
    culled  : (T,) bool, True for triangles with a culled back
    normals : (T, 3) float64, normals of the scene
    lamps   : (L,) triangles that emit light
    chance  : (L,) probability of the choice of each lamp, proportional to its area
    lights  : punctual lights that shine
    """

    shines: Bools
    sends: Bools
    passes: Bools
    culled: Bools
    normals: Float64
    lamps: Int64
    chance: Float64
    lights: tuple[Light, ...]

    @classmethod
    def of(cls, scene: Scene) -> _Surfaces:
        shape_of = scene.triangle_shape
        materials = [scene.materials[shape.material] for shape in scene.shapes]
        two_sided = np.array([material.two_sided for material in materials], np.bool_)[shape_of]
        passes = np.array(
            [m.clear > 0 or m.diffuse_transmission > 0 or m.alpha != "opaque" for m in materials], np.bool_
        )[shape_of]
        culled = np.array([material.culled for material in materials], np.bool_)[shape_of]
        emits = np.array([shape.emits for shape in scene.shapes], np.bool_)[shape_of]
        both = np.array([shape.emission_two_sided for shape in scene.shapes], np.bool_)[shape_of]
        shines = np.stack([emits, emits & both], axis=1)
        sends = np.stack([np.ones_like(emits), two_sided | passes | shines[:, 1]], axis=1)
        lamps = np.flatnonzero(emits)
        area = scene.areas[lamps]
        chance = area / area.sum() if len(lamps) else area
        lights = tuple(light for light in scene.lights if light_shines(light))
        return cls(shines, sends, passes, culled, scene.normals, lamps, chance, lights)


def _walk(
    scene: Scene,
    rays: Rays,
    surfaces: _Surfaces,
    triangle: Int64,
    side: Int64,
    points: Float64,
    random: np.random.Generator,
    beyond: bool,
) -> Bools:
    """Return (N,) bool: True if a random walk from a point of a triangle side reaches light."""
    found = surfaces.shines[triangle, side].copy()
    left = np.flatnonzero(~found)
    triangle, side, points = triangle[left], side[left], points[left]
    for _ in range(_BOUNCES):
        check_time()
        if not len(left):
            break
        normals = surfaces.normals[triangle] * (1 - 2 * side)[:, None]
        origins = points + _BEFORE * _size(scene) * normals
        seen = np.zeros(len(left), np.bool_)
        to_lamps = _to_lamps(scene, surfaces, origins, random)
        for towards, length, target in chain(_to_lights(surfaces, origins, random, _JOINS), to_lamps):
            facing = np.einsum("ij,ij->i", towards, normals) > 0
            hit, _, distance = _hit(surfaces, rays, origins, towards, triangle)
            seen |= facing & _reaches(hit, distance, length, target)
        directions = around(normals, random.random((len(left), 2)))
        hit, back, distance = _hit(surfaces, rays, origins, directions, triangle)
        seen |= np.where(hit < 0, beyond, surfaces.shines[hit, back])
        found[left[seen]] = True
        on = ~seen & (hit >= 0) & surfaces.sends[hit, back]
        points = origins[on] + distance[on, None] * directions[on]
        through = surfaces.passes[hit[on]] & (random.random(on.sum()) < 0.5)
        left, triangle, side = left[on], hit[on], np.where(through, 1 - back[on], back[on])
    return found


#: Rays from origins to lights: unit directions (N, 3), distances (N,), and the lamps' triangles (N,), -1 for
#: punctual lights. The distance is infinite for directional lights. For points on a dark side of a lamp, it is
#: infinite to mark the ray as blocked.
_LightRays = tuple[Float64, Float64, Int64]


def _to_lights(
    surfaces: _Surfaces, origins: Float64, random: np.random.Generator, count: int
) -> Iterator[_LightRays]:
    """Yield rays from origins (N, 3) to all punctual lights, or to `count` random ones if there are more."""
    lights = surfaces.lights
    position, direction = (np.reshape([getattr(x, k) for x in lights], (-1, 3)) for k in ("position", "direction"))
    distant = np.array([light.kind == "directional" for light in lights], np.bool_)
    for k in range(min(count, len(lights))):
        one = k if len(lights) <= count else random.integers(len(lights), size=len(origins))
        towards, length = _unit(position[one] - origins)
        parallel = np.broadcast_to(distant[one], len(origins))
        towards = np.where(parallel[:, None], -direction[one], towards)
        yield towards, np.where(parallel, np.inf, length), np.full(len(origins), -1)


def _to_lamps(
    scene: Scene, surfaces: _Surfaces, origins: Float64, random: np.random.Generator
) -> Iterator[_LightRays]:
    """Yield a ray from each origin (N, 3) to a random point of a random lamp, if the scene has lamps."""
    if len(surfaces.lamps):
        lamp = random.choice(surfaces.lamps, len(origins), p=surfaces.chance)
        towards, length = _unit(_on(scene.triangles[lamp], random.random((len(origins), 2))) - origins)
        back = np.einsum("ij,ij->i", surfaces.normals[lamp], towards) > 0
        # A point behind a lamp that emits only from its front gets an infinite distance, so it is not connected.
        yield towards, np.where(surfaces.shines[lamp, back.astype(np.int64)], length, np.inf), lamp


def _reaches(hit: Int64, distance: Float64, length: Float64, target: Int64) -> Bools:
    """Return (N,) bool: True if a ray of `_LightRays` reaches its light, and not a lamp's dark back."""
    behind = (target >= 0) & ~np.isfinite(length)
    return np.asarray(~behind & ((hit < 0) | (hit == target) | (distance > length)))


def cast(
    scene: Scene, rays: Rays, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """Return first hits of rays (N, 3): triangle (N,), -1 for none, side (N,), and distance (N,).

    own : (N,) triangle that a ray cannot hit; -1 for none
    """
    return _hit(_Surfaces.of(scene), rays, origins, directions, own)


def _hit(
    surfaces: _Surfaces, rays: Rays, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """Return first hits as `cast` does."""
    return first_hits(rays, Backs(surfaces.normals, surfaces.culled), origins, directions, own)


def first_hits(
    rays: Rays, backs: Backs, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """Return first hits of rays as `cast` does, traced by several threads."""
    hits, distances = np.empty(len(origins), np.int64), np.empty(len(origins))
    arrays = (
        np.ascontiguousarray(origins),
        np.ascontiguousarray(directions),
        np.ascontiguousarray(own, np.int64),
        hits,
        distances,
    )

    def part(begin: int, end: int) -> None:
        _cast(rays, backs, *(array[begin:end] for array in arrays), np.empty((2, 3)))

    in_threads(len(origins), _TOGETHER, part, rays.stop)
    back = np.einsum("ij,ij->i", backs.normals[hits], directions) > 0
    return hits, back.astype(np.int64), distances


def _shines_from_everywhere(scene: Scene) -> bool:
    return scene.sky is not None or bool(np.any(scene.ambient > 0))


def _size(scene: Scene) -> float:
    low, high = scene.bounds
    return float(np.linalg.norm(high - low))


def _unit(vectors: Float64) -> tuple[Float64, Float64]:
    length = np.linalg.norm(vectors, axis=1)
    return vectors / np.maximum(length, np.finfo(float).tiny)[:, None], length


def _on(triangles: Float64, uv: Float64) -> Float64:
    """Return a point (N, 3) of each triangle (N, 3, 3), with uniform density for uniform uv (N, 2) in [0, 1)."""
    root = np.sqrt(uv[:, :1])
    b1, b2 = root * (1 - uv[:, 1:]), root * uv[:, 1:]
    return np.asarray(triangles[:, 0] * (1 - b1 - b2) + triangles[:, 1] * b1 + triangles[:, 2] * b2)


def hemisphere(normals: Float64, number: Int64, look: int, looks: int) -> Float64:
    """Return (N, 3) directions about normals (N, 3), cosine-distributed over all `looks`.

    look   : index of the direction, below `looks`; direction 0 is along the normal
    number : (N,) integer that determines the rotation about the normal
    """
    phi = (0.6180339887498949 * look + 0.7548776662466927 * number) % 1.0
    return around(normals, np.stack([np.full(len(number), look / looks), phi], axis=1))


def around(normals: Float64, uv: Float64) -> Float64:
    """Return (N, 3) unit directions about unit normals, cosine-distributed for points (N, 2) of the unit square."""
    r, phi = np.sqrt(uv[:, :1]), 2 * np.pi * uv[:, 1:]
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)  # source: Duff et al. 2017, Building an Orthonormal Basis, Revisited
    a = -1.0 / (sign + z)
    s = np.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x], axis=1)
    t = np.stack([x * y * a, sign + y * y * a, -y], axis=1)
    return np.asarray(r * np.cos(phi) * s + r * np.sin(phi) * t + np.sqrt(1 - r * r) * normals)
