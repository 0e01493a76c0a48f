"""Direct light at points from lights that are not patches: point, spot and directional lights, and the sky.

Rays find how much of this light arrives at the points. The solvers then start from the light that surfaces reflect.
A triangle transmits 1 minus its mean opacity, and thin dielectrics transmit without bending the ray.

Cost:     a ray from each point to each punctual light that it faces, and `SKY_RAYS` if there is a sky. An
          environment map takes twice as many: half cosine-weighted, half distributed by the map's radiance, in
          directions that points share. Any other sky takes 16 to 256 more rays. Half of these are aimed at
          directions in which rays of the same element have reached the sky.
Poor at:  an environment map seen through small openings, which few of a point's rays pass; solid and rough
          transmission, behind which this light is missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.lights.mixed import MixedLights
from glpath.lights.samples import Incident, incident
from glpath.radiosity.form_factors.light_choice import MANY, Chosen, LightChoice, shares_row
from glpath.radiosity.mesh.glass import Glass, at_glass
from glpath.radiosity.mesh.sides import Sides
from glpath.radiosity.shafts.rays import Rays, nearest, rays_of
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.model import Environment, Float64, Light
from glpath.system.heartbeat import heartbeat
from glpath.system.kernels import kernel
from glpath.system.threads import Stop, StoppedError, worker_threads
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

#: Number of rays from a point to the sky, a square number. The unit square is mapped to the hemisphere, and divided
#: into this number of cells with one ray each.
SKY_RAYS = 64
#: Number of bins of directions about a normal, a square number. Bins are cells of the same unit square. Guided rays
#: choose a bin by its probability.
BINS = 64
_GUIDED = 0.5  # fraction of guided rays; the others are cosine-weighted, which limits the weight of a ray to 2
#: Target number of guided rays from all points together; the more points there are, the fewer rays each casts.
_AIMED_RAYS = 1 << 20
#: Minimum number of guided rays from each point.
_MIN_AIMED = 16
#: Maximum number of guided rays from each point.
_MAX_AIMED = 256
#: Maximum number of points in a task that casts guided rays.
_AIMED_TOGETHER = 1024
#: Maximum number of points in any other task, so that the rays of a task fit into memory.
_TOGETHER = 4096
#: Maximum number of pairs of a point and a light whose maximum irradiance is computed at a time.
_BOUNDS_TOGETHER = 1 << 17
#: Number of directions, distributed by an environment map's radiance, that many points share.
_DRAWN = 1 << 14
#: Occluders closer to a light than this fraction of the ray's length are ignored, because lights may lie on
#: surfaces.
_NEAR_LIGHT = 1e-9
_DOING = "finding the direct light"


class DirectLight:
    """Lights of a triangulated scene that are not patches."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.lighting = Lighting.of(scene)
        self._surfaces = _Surfaces.of(scene) if self else None
        self._mixed = MixedLights.of(self.lighting.punctual)

    def __bool__(self) -> bool:
        return bool(self.lighting.punctual) or self.lighting.sky is not None

    def of_sides(self, sides: Sides, triangle: Int64, points: Float64, number: Int64, each: int) -> Float64:
        """Return (R, 3), irradiance of elements' sides in W m^-2, each the mean over the points of the side.

        triangle : (R,) index of the scene's triangle that each side is part of
        points   : (P, 3) positions
        number   : (P,) index of the side of each point
        each     : number of points of a side
        """
        if not self:
            return np.zeros((len(sides), 3))
        if self.lighting.sky is None or isinstance(self.lighting.sky, Environment):
            found = self.at(points, sides.normal[number], triangle[number])
        else:
            found = self._at_aimed(points, sides, triangle, number)
        sums = [np.bincount(number, found[:, c], minlength=len(sides)) for c in range(3)]
        return np.stack(sums, axis=1) / each

    def _at_aimed(self, points: Float64, sides: Sides, triangle: Int64, number: Int64) -> Float64:
        """Return irradiance as `at` does, under a sky that may be visible only through a small window.

        A first set of rays finds where the sky is visible. Its radiance guides a second set, but does not enter
        the estimate, so the estimate is unbiased.
        """
        rays = int(np.clip(_AIMED_RAYS // max(len(points), 1), _MIN_AIMED, _MAX_AIMED))
        parts = [slice(i, i + _AIMED_TOGETHER) for i in range(0, len(points), _AIMED_TOGETHER)]
        bins, found = np.zeros((len(sides), BINS)), np.zeros((len(points), 3))

        def look(i: int) -> Float64:
            at = parts[i]
            random, of = np.random.default_rng([i, 0]), number[at]
            return self.estimate_in_bins(points[at], sides.normal[of], triangle[of], random, SKY_RAYS)[1]

        def aim(i: int) -> None:
            at = parts[i]
            random, of = np.random.default_rng([i, 1]), number[at]
            guides = guides_of(bins[of])
            found[at] = self.estimate(points[at], sides.normal[of], triangle[of], random, rays, guides)

        with worker_threads(*self.stops, doing=_DOING) as pool:
            for part, seen in zip(parts, pool.map(look, range(len(parts))), strict=True):
                check_time(_DOING)  # checked here, because worker threads have no time limit
                np.add.at(bins, number[part], seen)
            for _ in pool.map(aim, range(len(parts))):
                check_time(_DOING)
        return found

    def at(self, points: Float64, normals: Float64, triangle: Int64) -> Float64:
        """Return (P, 3), irradiance at points (P, 3) of triangles (P,), on the side of unit normals (P, 3)."""
        parts = [slice(i, i + _TOGETHER) for i in range(0, len(points), _TOGETHER)]

        def part(i: int) -> Float64:
            at = parts[i]
            return self.estimate(points[at], normals[at], triangle[at], np.random.default_rng(i))

        found = np.zeros((len(points), 3))
        with worker_threads(*self.stops, doing=_DOING) as pool:
            for at, light in zip(parts, pool.map(part, range(len(parts))), strict=True):
                check_time(_DOING)  # checked here, because worker threads have no time limit
                found[at] = light
        return found

    def estimate(
        self,
        points: Float64,
        normals: Float64,
        triangle: Int64,
        random: np.random.Generator,
        sky_rays: int = SKY_RAYS,
        guides: Float64 | None = None,
        chosen: Chosen | None = None,
    ) -> Float64:
        """Return irradiance (P, 3) as `at` does, but computed in the calling thread.

        sky_rays : number of rays from each point to the sky, a square number
        guides   : (P, BINS) cumulative probabilities of rays from each point to a sky without a map; None for
                   cosine-weighted rays
        chosen   : unbiased choice of a few of many punctual lights; None for all lights
        """
        total = self._punctual(points, normals, triangle, chosen, random)
        sky = self.lighting.sky
        if isinstance(sky, Environment):
            total += self._of_map(sky, points, normals, triangle, random, sky_rays)
        elif sky is not None and guides is not None:
            bins, chance = drawn_bins(guides, random, sky_rays)
            wi = directions_in_bins(normals[:, None], bins, random)
            seen = self._from_sky(points, triangle, wi) / (BINS * chance[..., None])
            total += np.pi * seen.mean(axis=1)
        elif sky is not None:
            wi = _about(normals[:, None], _stratified(len(points), random, sky_rays))
            total += np.pi * self._from_sky(points, triangle, wi).mean(axis=1)
        return total

    def estimate_in_bins(
        self,
        points: Float64,
        normals: Float64,
        triangle: Int64,
        random: np.random.Generator,
        sky_rays: int,
        chosen: Chosen | None = None,
    ) -> tuple[Float64, Float64]:
        """Return the mean over channels (P,) of `estimate`, and the part (P, BINS) of it from each bin of the sky.

        The bins are 0 if there is no sky, or an environment map.
        """
        bins = np.zeros((len(points), BINS))
        sky = self.lighting.sky
        if sky is None or isinstance(sky, Environment):
            return self.estimate(points, normals, triangle, random, sky_rays, chosen=chosen).mean(axis=1), bins
        u = _stratified(len(points), random, sky_rays)
        seen = self._from_sky(points, triangle, _about(normals[:, None], u)).mean(axis=2)
        side = round(BINS**0.5)
        at = (u * side).astype(np.int64) @ [side, 1]
        np.add.at(bins, (np.arange(len(points))[:, None], at), np.pi / u.shape[1] * seen)
        return self._punctual(points, normals, triangle, chosen, random).mean(axis=1) + bins.sum(axis=1), bins

    def choice(self, points: Float64, normals: Float64, triangle: Int64, radius: Float64) -> LightChoice | None:
        """Return the choice of punctual lights for points (P, 3), one row each; None for fewer lights than `MANY`.

        radius : (P,) distance from each point; a light's maximum irradiance within it raises its probability
        """
        lights = self.lighting.punctual
        if len(lights) < MANY:
            return None
        shared = shares_row(len(points), len(lights))
        parts = [slice(i, i + _TOGETHER) for i in range(0, len(points), _TOGETHER)]
        size = max(1, _BOUNDS_TOGETHER // len(lights))

        def total(rows: Float64) -> Float64:
            return rows.sum(axis=0, keepdims=True) if shared else rows

        def part(at: slice) -> tuple[Float64, Float64]:
            p, n, own, near = points[at], normals[at], triangle[at], radius[at]
            brings = [total(each.mean(axis=1)) for each in self._of_each_light(p, n, own)]
            blocks = [slice(i, i + size) for i in range(0, len(p), size)]
            may_bring = []
            for some in blocks:
                self._check_stop()
                may_bring.append(total(self._mixed.bounds(p[some], n[some], near[some])))
            return np.stack(brings, axis=1), total(np.concatenate(may_bring))

        found = [(np.zeros((0, len(lights))),) * 2]
        doing = "finding the light of each lamp"
        with worker_threads(*self.stops, doing=doing) as pool:
            for each in pool.map(part, parts):
                check_time(doing)
                found.append(each)
        brings, may_bring = (total(np.concatenate(each)) for each in zip(*found, strict=True))
        return LightChoice.of(brings, may_bring)

    def _punctual(
        self,
        points: Float64,
        normals: Float64,
        triangle: Int64,
        chosen: Chosen | None,
        random: np.random.Generator,
    ) -> Float64:
        """Return (P, 3), irradiance by point, spot and directional lights."""
        total = np.zeros((len(points), 3))
        if chosen is None:
            for found in self._of_each_light(points, normals, triangle):
                total += found
            return total
        drawn, counts = chosen.choice.draw(chosen.rows, random)
        each = drawn.shape[1]
        at = np.repeat(np.arange(len(points)), each)
        there = self._mixed.incident(drawn.ravel(), points[at])
        found = self._arriving(there, points[at], normals[at], triangle[at])
        return np.asarray((counts[..., None] * found.reshape(-1, each, 3)).sum(axis=1))

    def _of_each_light(self, points: Float64, normals: Float64, triangle: Int64) -> Iterator[Float64]:
        """Yield (P, 3), irradiance by each light. Raises StoppedError."""
        for light in self.lighting.punctual:
            self._check_stop()
            yield self._of_light(light, points, normals, triangle)

    def _of_light(self, light: Light, points: Float64, normals: Float64, triangle: Int64) -> Float64:
        """Return (P, 3), irradiance by one light."""
        return self._arriving(incident(light, points), points, normals, triangle)

    @property
    def stops(self) -> tuple[Stop, ...]:
        """Flags of `worker_threads` that end this work; none without lights."""
        return () if self._surfaces is None else (self._surfaces.rays.stop,)

    def _check_stop(self) -> None:
        """Raise StoppedError if `worker_threads` ends the work. Loops over lights call it, as there may be many."""
        if any(stop[0] for stop in self.stops):
            raise StoppedError

    def _arriving(self, there: Incident, points: Float64, normals: Float64, triangle: Int64) -> Float64:
        """Return (P, 3), irradiance by the incident light at each point."""
        found = np.zeros((len(points), 3))
        cosine = np.einsum("pi,pi->p", normals, there.wi)
        lit = np.flatnonzero((cosine > 0) & there.irradiance.any(axis=1))
        free = self._free(points[lit], triangle[lit], there.wi[lit, None], there.distance[lit])[:, 0]
        found[lit] = free * cosine[lit, None] * there.irradiance[lit]
        return found

    def _of_map(
        self,
        sky: Environment,
        points: Float64,
        normals: Float64,
        triangle: Int64,
        random: np.random.Generator,
        rays: int,
    ) -> Float64:
        """Return (P, 3), irradiance by an environment map, by multiple importance sampling with 2 * `rays` rays.

        Half of the rays are cosine-weighted, half are distributed by the map's radiance.
        """
        by_cosine = _about(normals[:, None], _stratified(len(points), random, rays))
        wi = np.concatenate([by_cosine, _by_the_radiance(sky, len(points), random, rays)], axis=1)
        cosine = np.einsum("pkc,pc->pk", wi, normals)
        point, ray = np.nonzero(cosine > 0)
        free = self._free(points[point], triangle[point], wi[point, ray, None], np.full(len(point), np.inf))[:, 0]
        # Only rays that reach the sky look up the map: in a room they are few, and a look-up is slower than a ray.
        arrive = np.flatnonzero(free.any(axis=1))
        point, ray = point[arrive], ray[arrive]
        radiance = sky.radiance(wi[point, ray])
        density = cosine[point, ray] / np.pi + radiance.mean(axis=1) / sky.mean_integral
        each = (cosine[point, ray] / density)[:, None] * free[arrive] * radiance / rays
        return np.stack([np.bincount(point, each[:, c], minlength=len(points)) for c in range(3)], axis=1)

    def _from_sky(self, points: Float64, triangle: Int64, wi: Float64) -> Float64:
        """Return (P, K, 3), radiance of the sky that arrives from directions wi (P, K, 3)."""
        assert self.lighting.sky is not None
        free = self._free(points, triangle, wi, np.full(len(points), np.inf))
        return np.asarray(free * self.lighting.sky.radiance(wi))

    def _free(self, points: Float64, triangle: Int64, wi: Float64, distance: Float64) -> Float64:
        """Return (P, K, 3), the fraction of light that arrives along rays wi (P, K, 3).

        It is 0 or 1 unless surfaces transmit a part of the light.

        distance : (P,) length of each point's rays
        """
        end = distance * (1 - _NEAR_LIGHT)
        free = np.empty(wi.shape)
        _free(self._surfaces, points, triangle, np.ascontiguousarray(wi), end, np.empty((2, 3)), free)
        heartbeat.beat()
        return free


def _about(normals: Float64, u: Float64) -> Float64:
    """Return (..., 3), cosine-weighted directions about unit normals, from u (..., 2) in [0, 1).

    u selects a point on the unit sphere around the normal's tip. The direction leads to that point.
    """
    z = 1 - 2 * u[..., 0]
    r, phi = np.sqrt(np.maximum(1 - z * z, 0.0)), 2 * np.pi * u[..., 1]
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1) + normals
    length = np.linalg.norm(wi, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 1e-9, wi / np.maximum(length, 1e-9), normals))


def guides_of(weights: Float64) -> Float64:
    """Return (P, BINS), cumulative probabilities of the bins, from weights (P, BINS) estimated with few rays.

    Rays may miss parts of the sky. Weights are therefore spread to neighbouring bins, and half of all rays stay
    cosine-weighted.
    """
    side = round(BINS**0.5)
    grid = weights.reshape(-1, side, side)
    # A row of bins is a ring of directions at one height above the surface, so its first and last bins touch.
    grid = grid + 0.5 * (np.roll(grid, 1, axis=2) + np.roll(grid, -1, axis=2))
    above = np.concatenate([grid[:, :1], grid[:, :-1]], axis=1)
    below = np.concatenate([grid[:, 1:], grid[:, -1:]], axis=1)
    grid = (grid + 0.5 * (above + below)).reshape(-1, BINS)
    total = grid.sum(axis=1, keepdims=True)
    share = np.where(total > 0, grid / np.maximum(total, np.finfo(float).tiny), 1.0 / BINS)
    found = np.cumsum(_GUIDED * share + (1.0 - _GUIDED) / BINS, axis=1)
    return np.asarray(found / found[:, -1:])


def drawn_bins(guides: Float64, random: np.random.Generator, rays: int) -> tuple[Int64, Float64]:
    """Draw stratified bins from cumulative probabilities (P, BINS); return bins and chances, both (P, rays)."""
    at = (np.arange(rays) + random.random((len(guides), rays))) / rays
    bins = np.minimum((guides[:, None] <= at[..., None]).sum(axis=2), BINS - 1)
    row = np.arange(len(guides))[:, None]
    return bins, guides[row, bins] - np.where(bins > 0, guides[row, bins - 1], 0.0)


def directions_in_bins(normals: Float64, bins: Int64, random: np.random.Generator) -> Float64:
    """Return (..., 3), unit directions about normals, cosine-weighted within each bin."""
    side = round(BINS**0.5)
    u = (np.stack([bins // side, bins % side], axis=-1) + random.random((*bins.shape, 2))) / side
    return _about(normals, u)


def _by_the_radiance(sky: Environment, count: int, random: np.random.Generator, rays: int) -> Float64:
    """Return (count, rays, 3), unit directions for each point, stratified by the environment map's radiance.

    Drawing a direction costs more than casting a ray. Many points therefore share `_DRAWN` directions, and each
    point picks one at random from each cell, so the estimate stays unbiased. The shared directions are stratified
    within cells too, because all points share their error.
    """
    cells, finer = round(rays**0.5), round((_DRAWN / rays) ** 0.5)
    if count <= finer * finer:
        return _directions(sky, _stratified(count, random, rays), random)
    u = _stratified(1, random, (cells * finer) ** 2).reshape(cells, finer, cells, finer, 2)
    wi = _directions(sky, u.swapaxes(1, 2).reshape(cells * cells, -1, 2), random)
    cell = np.arange(cells * cells)
    return np.asarray(wi[cell, random.integers(finer * finer, size=(count, len(cell)))])


def _directions(sky: Environment, u: Float64, random: np.random.Generator) -> Float64:
    """Return (..., 3), directions distributed by an environment map's radiance.

    u : (..., 2) in [0, 1); the numbers select the row of the map and the texel in it
    """
    numbers = np.stack([u[..., 0], random.random(u.shape[:-1]), u[..., 1]], axis=-1)
    return sky.directions(numbers.reshape(-1, 3)).reshape(*u.shape[:-1], 3)


def _stratified(count: int, random: np.random.Generator, rays: int) -> Float64:
    """Return (count, rays, 2) random points in the unit square, one in each of `rays` square cells."""
    cells = round(rays**0.5)
    at = np.stack(np.meshgrid(np.arange(cells), np.arange(cells)), axis=-1).reshape(-1, 2)
    return np.asarray((at + random.random((count, cells * cells, 2))) / cells)


class _Surfaces(NamedTuple):
    """Triangles that rays cross: ray queries, normals (T, 3), opacity (T,), culled backs (T,) bool, and glass."""

    rays: Rays
    normals: Float64
    opacity: Float64
    culled: NDArray[np.bool_]
    glass: Glass

    @classmethod
    def of(cls, scene: Scene) -> _Surfaces:
        look = Appearance(scene)
        return cls(rays_of(scene), scene.normals, look.mean_opacity(), look.culled, Glass.of_scene(scene))


@kernel
def _free(surfaces, points, triangle, wi, end, work, free):  # type: ignore[no-untyped-def]
    """Fill `free` (P, K, 3), the fraction of light that remains along rays wi (P, K, 3) from points on triangles.

    end  : (P,) length of each point's rays; occluders beyond it are ignored
    work : (2, 3) working memory
    """
    rays, normals, opacity, culled, glass = surfaces
    o, found = work[0], work[1]
    for p in range(len(points)):
        for k in range(wi.shape[1]):
            share, own, remaining = free[p, k], triangle[p], end[p]
            for c in range(3):
                o[c] = points[p, c]
                share[c] = 1.0
            while max(share[0], share[1], share[2]) > 0:
                hit = nearest(rays, o, wi[p, k], own, found)
                if hit < 0 or found[0] >= remaining:
                    break
                passes = 1.0 - opacity[hit]
                left, cosine = 0.0, 0.0
                if culled[hit] or glass.thin[hit]:
                    for c in range(3):
                        cosine += normals[hit, c] * wi[p, k, c]
                if culled[hit] and cosine > 0:
                    passes = 1.0
                elif glass.thin[hit]:
                    _, left = at_glass(glass, hit, abs(cosine), False)
                for c in range(3):
                    share[c] *= passes + opacity[hit] * left * glass.clear[hit, c]
                own = hit
                remaining -= found[0]
                for c in range(3):
                    o[c] += found[0] * wi[p, k, c]
