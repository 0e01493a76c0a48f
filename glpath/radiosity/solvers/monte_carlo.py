"""Monte Carlo radiosity: particles leave the lights, and leave their energy where they hit (stochastic shooting).

The solver behind the pictures of the path-buffer paper [PB 4]. A particle starts on an emitter, by its power, and
continues from every surface in a direction by the cosine; it survives with the probability of the reflectance
(Pattanaik & Mudur 1992). No form factors and no matrix: the only error is noise, by the root of their number.

S. Pattanaik, S. Mudur, "Computation of global illumination by Monte Carlo simulation of the particle model of
light", 1992.

Cost:     a ray per bounce of a particle; memory for the elements alone.
Poor at:  smooth pictures of fine meshes: an element with a hundred hits is off by a tenth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.form_factors.light_choice import Chosen, LightChoice
from glpath.radiosity.form_factors.lights import BINS, DirectLight, directions_in_bins, drawn_bins, guides_of
from glpath.radiosity.mesh.mesh import Elements, Int64, Mesh, occluder_of_triangle
from glpath.radiosity.mesh.sides import Sides, open_points
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.rays import rays_of
from glpath.radiosity.solution import DIRECT, INDIRECT
from glpath.radiosity.solvers.importance import CELLS, gathered_by_camera, start_cells, visits_from_camera
from glpath.radiosity.solvers.particles import BATCH, ENDLESS, Arrivals, Lamps, Starts, Surfaces, shoot_batch
from glpath.scene.model import Float64
from glpath.system.machine import core_count

#: Rays to the sky from where a particle starts.
_START_RAYS = 4
#: Rays to the sky from each of four points of a cell that a camera's paths visit, and of one that none has visited.
_CELL_RAYS, _FAR_RAYS = 16, 4
#: So many of the most important sides of cells have so many: a window may be small.
_CLOSER, _CLOSE_RAYS = 2048, 100
#: Of the visits by a camera, this share goes to all of a surface; of what light is usual, to where none was hit.
_SPREAD, _UNHIT = 0.25, 0.2


class _Lit(NamedTuple):
    """Sides of elements where particles start that carry reflected light of punctual lights and the sky.

    corners  : (L, 9), corner 0 and the edges to corners 1 and 2
    triangle : (L,) of the scene; `back` the side of it
    chance   : (L,) of a particle to start there
    scale    : (L, 3) its energy per irradiance at its start: reflectance times area over chance
    through  : (L, 3) the same by transmittance, of one that leaves from the other side
    across   : (L,) the chance of that
    to_sky, to_camera : (L, BINS) guides to where the sky is seen, and to where a camera may see what leaves, of
               starts that a camera decides; else none
    choice   : of punctual lights, where there are many, and the row of it (L,) for each side
    """

    corners: Float64
    triangle: Int64
    back: Int64
    chance: Float64
    scale: Float64
    through: Float64
    across: Float64
    to_sky: Float64 | None
    to_camera: Float64 | None
    choice: LightChoice | None
    row: Int64


@dataclass
class Shooting:
    """Energy that has arrived, in batches of particles.

    mesh      : each patch one element
    seed      : another seed is another, independent solution
    for_camera: reflected light of punctual lights and the sky starts where it matters to what the camera sees
    particles : that were shot
    flux      : (2, 2, E, 3) energy that arrived, W times `particles`: [0] straight from a lamp, [1] after being
                reflected; at the elements' fronts and backs
    hits      : of particles on surfaces
    open_areas : (2, E) of what is not buried in solids, of both sides; all of an element that light cannot reach
    lit        : (2, E, 3) irradiance by lights that are no patches, which no particle brings
    view       : (2,) sums over batches of the mean radiance that their light adds to the camera's picture by a
                 gather, times `BATCH`, and of its square; of a solution for a camera
    whole      : false while sums change; a signal may end that in the middle
    """

    mesh: Mesh
    seed: int = 0
    for_camera: bool = False
    particles: int = 0
    hits: int = 0
    flux: Float64 = field(init=False)
    square: Float64 = field(init=False)

    def __post_init__(self) -> None:
        scene = self.mesh.scene
        count = len(scene.triangles)
        ones = np.ones(count, np.int64)
        sides = Sides.of(scene, Elements.of_lattices(ones))
        used = np.zeros((2, count), bool)
        used[sides.back, sides.element] = True
        self._used = used[:, self.mesh.elements.triangle]
        divisions = ones.copy()
        np.maximum.at(divisions, self.mesh.elements.triangle, self.mesh.elements.n)
        self._rays = rays_of(scene)
        self._light = DirectLight(scene)
        self.open_areas, self.lit = _open_and_lit(self.mesh, self._light)
        self._surfaces = Surfaces.of(scene, self._rays, divisions)
        self._lamps, self._lit, self._lit_count = self._find_lamps(sides)
        self.flux = np.zeros((2, 2, len(self.mesh.elements), 3))
        self.square = np.zeros(self.flux.shape[1:])
        self.view = np.zeros(2)
        self._gathered: Float64 | None = None
        if self.for_camera:
            gathered = gathered_by_camera(scene, self._rays, self.mesh.elements, self.seed)
            self._gathered = gathered / self.open_areas[..., None]
        self.whole = True

    def _find_lamps(self, sides: Sides) -> tuple[Lamps, _Lit, int]:
        """Triangles that emit; sides that reflect the light of what is no patch; particles of a batch for these."""
        scene = self.mesh.scene
        emitting = np.flatnonzero(sides.emission.any(axis=1))
        of = sides.element[emitting]
        power = sides.emission[emitting] * scene.areas[of, None]
        # By their power; the mean of the channels, so that no coloured light is starved.
        emitted = float(power.mean(axis=1).sum())
        chance = power.mean(axis=1) / max(emitted, np.finfo(float).tiny)
        lit, reflected = self._find_lit()
        count = round(BATCH * reflected / (reflected + emitted)) if reflected else 0
        if count and emitted:
            count = min(max(count, 1), BATCH - 1)
        lamps = Lamps(
            corners=self._rays.corners[of],
            triangle=of,
            back=sides.back[emitting],
            cdf=np.cumsum(chance),
            energy=power / chance[:, None] * (BATCH / max(BATCH - count, 1)),
        )
        each = BATCH / max(count, 1)
        return lamps, lit._replace(scale=lit.scale * each, through=lit.through * each), count

    def _find_lit(self) -> tuple[_Lit, float]:
        """Where reflected light starts, and about its power.

        What an element gets is known from few rays. It decides how many particles start there and not what they
        carry, which each finds out where it starts: so neither the size of elements nor a lamp that was missed
        changes what the particles bring in the mean.
        """
        scene, elements, lit, areas = self.mesh.scene, self.mesh.elements, self.lit, self.open_areas
        reflectance = scene.side_reflectance[:, elements.triangle]
        through = self._surfaces.transmittance[:, elements.triangle]
        power = ((reflectance + through) * lit).mean(axis=2) * areas
        total = float(power.sum())
        to_sky = to_camera = None
        by_camera = bool(total and self.for_camera)
        if by_camera:
            elements = self._start_cells()
        choice = self._choice(elements) if self._light else None
        if by_camera:
            came = np.zeros((2, len(elements), BINS))
            visits = visits_from_camera(scene, self._rays, elements, self.seed, came)
            visits = self._spread_visits(elements, visits)
            power, to_sky = self._contribution(elements, visits, choice)
            reflectance = scene.side_reflectance[:, elements.triangle]
            through = self._surfaces.transmittance[:, elements.triangle]
            to_camera = came
        sends = reflectance.any(axis=2) | through.any(axis=2)
        back, element = np.nonzero(sends if self._light else np.zeros(power.shape, bool))
        whole = scene.areas[elements.triangle[element]] / elements.n[element] ** 2
        chance = power[back, element]
        chance = chance / max(float(chance.sum()), np.finfo(float).tiny)
        if len(element):
            others = 0.5 * (whole / whole.sum() + 1.0 / len(element))
            chance = 0.9 * chance + (1.0 - 0.9 * chance.sum()) * others
        points = elements[element].points(scene, np.eye(3))
        edges = (points[:, 1:] - points[:, :1]).reshape(-1, 6)
        starts = _Lit(
            corners=np.concatenate([points[:, 0], edges], axis=1),
            triangle=elements.triangle[element],
            back=back,
            chance=chance,
            scale=reflectance[back, element] * (whole / np.maximum(chance, np.finfo(float).tiny))[:, None],
            through=through[back, element] * (whole / np.maximum(chance, np.finfo(float).tiny))[:, None],
            across=through[back, element].max(axis=1)
            / np.maximum((reflectance[back, element] + through[back, element]).max(axis=1), np.finfo(float).tiny),
            to_sky=None if to_sky is None else guides_of(to_sky[back, element]),
            to_camera=None if to_camera is None else guides_of(to_camera[back, element]),
            choice=choice,
            row=back * len(elements) + element,
        )
        return starts, total

    def _choice(self, cells: Elements) -> LightChoice | None:
        """Of punctual lights, at the middles of all fronts, then of all backs."""
        scene = self.mesh.scene
        middles, normals = cells.points(scene, np.full((1, 3), 1 / 3))[:, 0], scene.normals[cells.triangle]
        return self._light.choice(
            np.concatenate([middles, middles]),
            np.concatenate([normals, -normals]),
            np.concatenate([cells.triangle, cells.triangle]),
            np.tile(np.sqrt(scene.areas[cells.triangle]) / cells.n, 2),
        )

    def _start_cells(self) -> Elements:
        """The cells of `start_cells`, and smaller ones where the camera looks, as elements are."""
        cells = start_cells(self.mesh.scene, self.mesh.surface)
        if len(self.mesh.elements) > CELLS // 2:
            return cells
        divisions = np.ones(len(self.mesh.scene.triangles), np.int64)
        for elements, parts in ((cells, 1), (self.mesh.elements, 2)):
            np.maximum.at(divisions, elements.triangle, parts * elements.n)
        return Elements.of_lattices(divisions)

    def _spread_visits(self, cells: Elements, visits: Float64) -> Float64:
        """(2, C): a share of what a surface is visited goes to all of it, as chance may pass a small cell by."""
        surface, areas = self.mesh.surface[cells.triangle], self.mesh.scene.areas[cells.triangle] / cells.n**2
        of = np.stack([np.bincount(surface, side) for side in visits]) / np.bincount(surface, areas)
        return np.asarray((1.0 - _SPREAD) * visits + _SPREAD * of[:, surface] * areas)

    def _contribution(
        self, cells: Elements, visits: Float64, choice: LightChoice | None
    ) -> tuple[Float64, Float64]:
        """(2, C): the light that sides of cells reflect, times how much of that a camera sees, about.

        And where in the sky it comes from: (2, C, BINS).
        """
        scene = self.mesh.scene
        reflectance = scene.side_reflectance[:, cells.triangle].mean(axis=2)
        through = self._surfaces.transmittance[:, cells.triangle].mean(axis=2)
        lit, from_sky = np.zeros(visits.shape), np.zeros((*visits.shape, BINS))
        worth = visits * reflectance + visits[::-1] * through
        random = np.random.default_rng([self.seed, 1])
        threshold = np.sort(worth, axis=None)[-_CLOSER] if worth.size > _CLOSER else 0.0
        close, there = worth > threshold, worth > 0
        for some, rays in ((close, _CLOSE_RAYS), (there & ~close, _CELL_RAYS), (~there, _FAR_RAYS)):
            back, cell = np.nonzero(some & (reflectance + through > 0))
            triangle, each = cells.triangle[cell], 4
            u = np.sort(random.random((len(cell), each, 2)), axis=2)
            b = np.stack([u[..., 0], u[..., 1] - u[..., 0], 1.0 - u[..., 1]], axis=2)
            points = np.einsum("cek,ckd->ced", b, cells[cell].points(scene, np.eye(3))).reshape(-1, 3)
            normals = np.repeat(scene.normals[triangle] * (1 - 2 * back[:, None]), each, axis=0)
            of = np.repeat(triangle, each)
            chosen = None if choice is None else Chosen(choice, np.repeat(back * len(cells) + cell, each))
            irradiance, bins = self._light.estimate_in_bins(points, normals, of, random, rays, chosen)
            lit[back, cell] = irradiance.reshape(-1, each).mean(axis=1)
            from_sky[back, cell] = bins.reshape(-1, each, BINS).mean(axis=1)
        # A window, a lamp or a path to the camera may have been missed by all of a few rays: what seldom
        # starts comes with much energy, and a single particle of it would be a large error.
        usual = float((visits * lit).sum() / max(visits.sum(), 1.0))
        return np.asarray(worth * (lit + _UNHIT * usual)), from_sky

    def _starts(self, number: int) -> Starts:
        """The starts of a batch: even over elements, as far as their probabilities allow."""
        lit, count = self._lit, self._lit_count
        random = np.random.default_rng([self.seed, number])
        at = (np.arange(count) + random.random()) / max(count, 1)
        which = np.minimum(np.searchsorted(np.cumsum(lit.chance), at, side="right"), len(lit.chance) - 1)
        root, v = np.sqrt(random.random((count, 1))), random.random((count, 1))
        corners = lit.corners[which]
        position = corners[:, :3] + root * ((1 - v) * corners[:, 3:6] + v * corners[:, 6:])
        triangle, back = lit.triangle[which], lit.back[which]
        normals = self._surfaces.normals[triangle] * (1 - 2 * back[:, None])
        guides = None if lit.to_sky is None else lit.to_sky[which]
        chosen = None if lit.choice is None else Chosen(lit.choice, lit.row[which])
        irradiance = self._light.estimate(position, normals, triangle, random, _START_RAYS, guides, chosen)
        energy = lit.scale[which] * irradiance
        direction = np.zeros((count, 3))
        if lit.to_camera is not None:
            bins, share = drawn_bins(lit.to_camera[which], random, 1)
            direction = directions_in_bins(normals, bins[:, 0], random)
            energy /= BINS * share
        across = lit.across[which]
        if across.any():
            other = random.random(count) < across
            energy /= np.where(other, 1.0, 1.0 - across)[:, None]
            energy[other] = (lit.through[which] * irradiance / np.maximum(across, 1e-300)[:, None])[other]
            direction[other] = 0.0  # by the cosine
            back = np.where(other, 1 - back, back)
        return Starts(position, energy, triangle, back, direction)

    def shoot(self, batches: int, on_batch: Callable[[], None]) -> None:
        """So many batches more, shared between threads; sums come in order, so that they are always the same."""
        first = self.particles // BATCH
        threads = core_count()
        with ThreadPoolExecutor(threads) as pool:
            for start in range(first, first + batches, threads):
                numbers = range(start, min(start + threads, first + batches))
                for flux, hits in pool.map(self._batch, numbers):
                    self.whole = False
                    self.flux += flux
                    self.square += flux.sum(axis=0) ** 2
                    if self._gathered is not None:
                        # Direct light is found by other means where it is seen.
                        seen = float((self._gathered * flux[INDIRECT]).sum()) / 3
                        self.view += seen, seen * seen
                    self.hits += hits
                    self.particles += BATCH
                    self.whole = True
                on_batch()

    def state(self) -> dict[str, NDArray[Any]]:
        """All that the solution depends on, for `restore`."""
        counts = np.array([self.particles, self.hits], np.int64)
        return {"flux": self.flux, "square": self.square, "view": self.view, "counts": counts}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state of the same scene and settings. Raises ValueError for one of another mesh."""
        for name in ("flux", "square", "view"):
            if state[name].shape != getattr(self, name).shape:
                raise ValueError(
                    f"`{name}` is of another mesh: {state[name].shape}, {getattr(self, name).shape} here"
                )
            setattr(self, name, np.array(state[name]))
        self.particles, self.hits = map(int, state["counts"])

    def _batch(self, number: int) -> tuple[Float64, int]:
        flux = np.zeros_like(self.flux)
        starts, arrivals = self._starts(number), Arrivals(flux, np.zeros((2, 0, BINS)))
        hits = shoot_batch(
            number, self.seed, self._surfaces, self._lamps, starts, ENDLESS, arrivals, np.empty((4, 3))
        )
        return flux, int(hits)

    def irradiance(self) -> Float64:
        """(2, 2, E, 3) W m^-2, the estimate so far: direct and indirect, as `flux`."""
        found = self.flux / max(self.particles, 1) / self.open_areas[..., None]
        found[DIRECT] += self.lit
        return np.asarray(found)

    def standard_error(self) -> Float64:
        """(2, E, 3) of both parts of `irradiance` together, from how the batches differ; infinite while there are
        less than two."""
        batches = self.particles // BATCH
        if batches < 2:
            return np.full_like(self.square, np.inf)
        mean = self.flux.sum(axis=0) / batches
        variance = np.maximum(self.square / batches - mean**2, 0.0) / (batches - 1)
        return np.asarray(np.sqrt(variance) / BATCH / self.open_areas[..., None])

    def view_error(self) -> tuple[float, float] | None:
        """Mean radiance, of the channels, that a gather of the camera's picture has of the solution, and its error.

        W sr^-1 m^-2; a standard error, from how the batches differ. None of less than two, or without a camera.
        """
        batches = self.particles // BATCH
        if self._gathered is None or batches < 2:
            return None
        mean, square = self.view / batches
        return float(mean) / BATCH, float(np.sqrt(max(square - mean * mean, 0.0) / (batches - 1))) / BATCH

    def result(self) -> Float64:
        """(2, 2, E, 3): irradiance of the elements; 0 where a side neither reflects nor emits."""
        return np.asarray(self.irradiance() * self._used[..., None])


def _open_and_lit(mesh: Mesh, light: DirectLight) -> tuple[Float64, Float64]:
    occluders = Occluders.of_scene(mesh.scene)
    sides = Sides.of(mesh.scene, mesh.elements)
    solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
    points, is_open = open_points(mesh.scene, solid, mesh.elements, sides, 4)
    share = np.ones((2, len(mesh.elements)))
    share[sides.back, sides.element] = np.where(is_open > 0, is_open, 1.0)
    lit = np.zeros((2, len(mesh.elements), 3))
    each = points.shape[1]
    lit[sides.back, sides.element] = light.of_sides(
        sides,
        mesh.elements.triangle[sides.element],
        points.reshape(-1, 3),
        np.repeat(np.arange(len(sides)), each),
        each,
    )
    return share * mesh.areas, lit
