"""Which sides of a scene's surfaces get texels, and which points of them are inside other geometry.

All that can be seen get some: every front, and the back of a material with two sides, but for the inside of a
closed solid, which is proved (`solids`). Sides that no chain of rays leads from to a lamp, to the sky or to a
punctual light are dark. They get fewer texels and never none, as this is sampled. A point from which one
sees nothing but dark sides is inside something, as the floor is under a box that stands on it.

Cost:     a few hundred thousand rays on the CPU for the sides; a ray or two for each point.
Poor at:  light that gets in by a hole which none of some thousand rays from a surface finds: its texels are large.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.bake.pieces import pieces
from glpath.bake.solids import inside_solids
from glpath.radiosity.shafts.rays import Rays, nearest, rays_of
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.kernels import kernel
from glpath.system.machine import core_count

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Walks from a side of a piece, round by round until it is found to be lit, and of all in a round; at least one.
_ROUNDS, _RAYS = (16, 64, 256, 1024), 1 << 17
#: Share of walks from which on a side is lit before the last round, and after it: a few slip through edges.
_SURELY, _SLIPS = 0.02, 1e-3
#: Texels along a dark side for one along a lit one.
_DARK = 0.25
#: Rays start so far before a surface, in the size of the scene.
_BEFORE = 1e-6
#: Rays of a point before it counts as inside.
_LOOKS = 16
#: Or beside a dark side: this share of its rays meets some within two texels.
_BESIDE = 0.25
#: Times that a point in the dark is joined with lamps, and the most punctual lights that are asked.
_JOINS = 8
#: Rays that a thread takes at a time.
_TOGETHER = 1 << 14
#: Bounces of a walk from a side that looks for light.
_BOUNCES = 8


class Backs(NamedTuple):
    """(T, 3) normals, and (T,) whether the back is not there."""

    normals: Float64
    culled: Bools


@kernel
def _cast(rays, backs, origins, directions, own, hits, distances, work):  # type: ignore[no-untyped-def]
    """What rays meet first, backs that are not there left out. work: (2, 3)."""
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
    """The sides of a scene's triangles: 0 is the front, 1 the back.

    shown   : (T, 2) bool, it gets texels; of each triangle at least one side
    hidden  : (T, 2) bool, it would be shown, were it not the inside of a closed solid
    lit     : (T, 2) bool, light was found to get there, and is sent on or shown
    beyond  : whether what leaves the scene counts as coming to light
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
        """The sides of a scene in triangles.

        seed     : of the rays that find light; `shown` does not use it
        streamed : streamed triangles are around it, which send light on: what leaves the scene comes to some
        """
        beyond = _shines_from_everywhere(scene) or streamed
        rays = rays_of(scene)
        surfaces = _Surfaces.of(scene)
        hidden = np.zeros(surfaces.sends.shape, np.bool_)
        if surfaces.sends.all(axis=1).any():
            hidden = surfaces.sends & inside_solids(scene, rays, ~surfaces.passes, surfaces.shines)
            hidden[~np.asarray(surfaces.sends.all(axis=1))] = False  # where the other side is not there
        shown = surfaces.sends & ~hidden
        lit = _lit(scene, rays, surfaces, shown, seed, beyond)
        return cls(scene, shown, hidden, lit, rays, surfaces, beyond)

    @property
    def density(self) -> Float64:
        """(T, 2): texels along a side for one along a lit one; 0 of what is not shown."""
        return np.where(self.shown, np.where(self.lit, 1.0, _DARK), 0.0)

    def inside(self, triangle: Int64, side: Int64, points: Float64, near: Float64, first: int = 0) -> Bools:
        """(N,): whether points (N, 3) of sides of triangles are inside other geometry, or behind it.

        near  : (N,) scene units, as far as what is behind a thin wall counts as behind it
        first : number of the first point, of more that are asked in parts: each looks in directions of its own
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
        """As `cast`, of the same scene."""
        return _hit(self.surfaces, self.rays, origins, directions, own)

    def apart(self, triangle: Int64, points: Float64, others: Float64) -> Bools:
        """(N,): whether a wall without thickness, lit on both sides, is between points (N, 3) and others.

        triangle : (N,) that the points are on, which is no wall between them
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
        """Whether something that shines is seen straight on."""
        found = np.zeros(len(origins), np.bool_)
        surfaces, random = self.surfaces, np.random.default_rng(1)
        for _ in range(_JOINS if len(origins) else 0):
            for towards, length, target in _shining_points(self.scene, surfaces, origins, random):
                facing = np.einsum("ij,ij->i", towards, normals) > 0
                hit, _, distance = _hit(self.surfaces, self.rays, origins, towards, own)
                found |= facing & _reaches(hit, distance, length, target)
        return found


def points_before(sides: Sides, triangle: Int64, side: Int64, points: Float64) -> tuple[Float64, Float64]:
    """(N, 3) normals of sides of triangles, and (N, 3) where rays from points (N, 3) on them start."""
    normals = sides.surfaces.normals[triangle] * (1 - 2 * side)[:, None]
    return normals, points + _BEFORE * _size(sides.scene) * normals


def _lit(scene: Scene, rays: Rays, surfaces: _Surfaces, shown: Bools, seed: int, beyond: bool) -> Bools:
    """(T, 2): by random walks from all over each connected piece of a mesh, both of whose sides are alike all over.

    A walk ends where something that shines is hit, or seen from there. Pieces of which few walks do are asked again
    with more of them, as small lamps and far windows are seldom hit.
    """
    # What of a shape shares corners is one piece.
    shape = np.broadcast_to(scene.triangle_shape[:, None, None], (len(scene.triangles), 3, 1))
    piece = pieces(np.concatenate([scene.triangles, shape], axis=2))
    count = int(piece.max()) + 1
    order = np.argsort(piece, kind="stable")
    first = np.searchsorted(piece[order], np.arange(count + 1))
    # Either side of a piece is one: 2 piece + side.
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
    """(T, 2) bool of each triangle's sides: whether it shines, and whether it sends light on at all.

    passes : (T,) whether light goes through
    culled : (T,) whether its back is not there
    normals : (T, 3) float64, the scene's
    lamps, chance : triangles that shine and how often each is taken, by area
    """

    shines: Bools
    sends: Bools
    passes: Bools
    culled: Bools
    normals: Float64
    lamps: Int64
    chance: Float64

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
        return cls(shines, sends, passes, culled, scene.normals, lamps, area / area.sum() if len(lamps) else area)


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
    """(N,): whether a random walk from points of sides of triangles comes to light."""
    found = surfaces.shines[triangle, side].copy()
    left = np.flatnonzero(~found)
    triangle, side, points = triangle[left], side[left], points[left]
    for _ in range(_BOUNCES):
        if not len(left):
            break
        normals = surfaces.normals[triangle] * (1 - 2 * side)[:, None]
        origins = points + _BEFORE * _size(scene) * normals
        seen = np.zeros(len(left), np.bool_)
        for towards, length, target in _shining_points(scene, surfaces, origins, random):
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


def _shining_points(
    scene: Scene, surfaces: _Surfaces, origins: Float64, random: np.random.Generator
) -> list[tuple[Float64, Float64, Int64]]:
    """From each origin (N, 3) towards a point of some lamp, and to the punctual lights.

    Of each the unit direction, the distance, infinite of a lamp that is seen from behind, and the triangle that is
    there, -1 for none.
    """
    none = np.full(len(origins), -1)
    made = []
    for light in scene.lights[:_JOINS]:
        if light.kind == "directional":
            made.append((np.tile(-light.direction, (len(origins), 1)), np.full(len(origins), np.inf), none))
        else:
            made.append((*_unit(light.position - origins), none))
    if len(surfaces.lamps):
        lamp = random.choice(surfaces.lamps, len(origins), p=surfaces.chance)
        towards, length = _unit(_on(scene.triangles[lamp], random.random((len(origins), 2))) - origins)
        back = np.einsum("ij,ij->i", surfaces.normals[lamp], towards) > 0
        # A point behind a lamp that shines from its front alone is joined with nothing.
        made.append((towards, np.where(surfaces.shines[lamp, back.astype(np.int64)], length, np.inf), lamp))
    return made


def _reaches(hit: Int64, distance: Float64, length: Float64, target: Int64) -> Bools:
    """(N,): whether rays that meet `hit` get to what `_shining_points` says; never to a lamp's back."""
    behind = (target >= 0) & ~np.isfinite(length)
    return np.asarray(~behind & ((hit < 0) | (hit == target) | (distance > length)))


def cast(
    scene: Scene, rays: Rays, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """(N,) triangle hit by rays (N, 3), but for `own` (-1: none), its side, and the distance."""
    return _hit(_Surfaces.of(scene), rays, origins, directions, own)


def _hit(
    surfaces: _Surfaces, rays: Rays, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """(N,) triangle (-1: none), the side that is hit, and the distance."""
    return first_hits(rays, Backs(surfaces.normals, surfaces.culled), origins, directions, own)


def first_hits(
    rays: Rays, backs: Backs, origins: Float64, directions: Float64, own: Int64
) -> tuple[Int64, Int64, Float64]:
    """(N,) triangle (-1: none) that rays (N, 3) hit, but for `own`, the side that is hit, and the distance."""
    hits, distances = np.empty(len(origins), np.int64), np.empty(len(origins))
    arrays = (
        np.ascontiguousarray(origins),
        np.ascontiguousarray(directions),
        np.ascontiguousarray(own, np.int64),
        hits,
        distances,
    )

    def part(first: int) -> None:
        some = (array[first : first + _TOGETHER] for array in arrays)
        _cast(rays, backs, *some, np.empty((2, 3)))

    with ThreadPoolExecutor(core_count()) as pool:
        list(pool.map(part, range(0, len(origins), _TOGETHER)))
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
    """(N, 3): a point of each triangle (N, 3, 3), evenly."""
    root = np.sqrt(uv[:, :1])
    b1, b2 = root * (1 - uv[:, 1:]), root * uv[:, 1:]
    return np.asarray(triangles[:, 0] * (1 - b1 - b2) + triangles[:, 1] * b1 + triangles[:, 2] * b2)


def hemisphere(normals: Float64, number: Int64, look: int, looks: int) -> Float64:
    """(N, 3): the direction of a look by the cosine about the normals, the first along them; turned by number."""
    phi = (0.6180339887498949 * look + 0.7548776662466927 * number) % 1.0
    return around(normals, np.stack([np.full(len(number), look / looks), phi], axis=1))


def around(normals: Float64, uv: Float64) -> Float64:
    """(N, 3) unit directions about unit normals, by the cosine, of points (N, 2) of the unit square."""
    r, phi = np.sqrt(uv[:, :1]), 2 * np.pi * uv[:, 1:]
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)  # Duff et al. 2017, "Building an orthonormal basis, revisited"
    a = -1.0 / (sign + z)
    s = np.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x], axis=1)
    t = np.stack([x * y * a, sign + y * y * a, -y], axis=1)
    return np.asarray(r * np.cos(phi) * s + r * np.sin(phi) * t + np.sqrt(1 - r * r) * normals)
