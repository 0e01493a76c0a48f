"""Monte Carlo radiosity: particles leave the lights, and deposit energy at their hits (stochastic shooting).

This method made the images of the path-buffer paper [PB 4]. A particle starts on an emitter, chosen by power, and
continues from every surface in a cosine-weighted direction. Its probability of survival at a surface equals the
reflectance (Pattanaik & Mudur 1992). There are no form factors and no matrix. The only error is noise, which is
inversely proportional to the square root of the number of particles.

S. Pattanaik, S. Mudur, "Computation of global illumination by Monte Carlo simulation of the particle model of
light", 1992.

With `adaptive`, particles are counted on a finer lattice, and elements are small where the light changes there
(`mesh.quadtree`).

Cost:     a ray per bounce of a particle; memory for the elements only.
Poor at:  smooth images of fine meshes; an element with a hundred hits has an error of a tenth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.form_factors.light_choice import Chosen, LightChoice
from glpath.radiosity.form_factors.lights import BINS, DirectLight, directions_in_bins, drawn_bins, guides_of
from glpath.radiosity.lookup import near_lamps
from glpath.radiosity.mesh.mesh import (
    Elements,
    Int64,
    Mesh,
    divisions_of_size,
    occluder_of_triangle,
    size_for_count,
)
from glpath.radiosity.mesh.quadtree import Detail, Quadtree
from glpath.radiosity.mesh.sides import Sides, Solids
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.rays import rays_of
from glpath.radiosity.solution import DIRECT, INDIRECT
from glpath.radiosity.solvers.importance import CELLS, gathered_by_camera, start_cells, visits_from_camera
from glpath.radiosity.solvers.particles import (
    BATCH,
    ENDLESS,
    Arrivals,
    Lamps,
    ParticleSurfaces,
    Starts,
    shoot_batch,
)
from glpath.scene.model import Float64
from glpath.system.machine import core_count
from glpath.system.threads import Stop, worker_threads
from glpath.system.time_limit import check_time

#: Number of rays to the sky from the start of a particle.
_START_RAYS = 4
#: Number of rays to the sky from each of the four points of a cell that camera paths visit.
_CELL_RAYS = 16
#: Number of rays to the sky from each of the four points of a cell that no camera path visits.
_FAR_RAYS = 4
#: Number of the most important sides of cells, which get more rays, because a window may be small.
_CLOSER = 2048
#: Number of rays to the sky from each of the four sample points of a cell, on its most important sides.
_CLOSE_RAYS = 100
#: Number of quadtree levels in the first pass; each level halves the edges.
_FIRST_DEPTH = 2
#: Number of quadtree levels that each further pass adds.
_DEEPER = 2
#: Maximum number of elements in all lattices in the first pass.
_FIRST_ELEMENTS = 1 << 14
#: Maximum number of elements in all lattices in the last pass.
_MAX_ELEMENTS = 1 << 18
#: Lattices are refined if the sum of `Detail.misplaced` over all triangles, divided by the squared `threshold` of
#: the call, is at least this.
_MISPLACED = 0.32
#: Value of `Detail.misplaced` of a triangle, divided by the square of the threshold, above which its lattice is
#: refined.
_MISPLACED_IN_ONE = 0.016
#: Fraction of camera visits that is spread evenly over each surface.
_SPREAD = 0.25
#: Fraction of the mean irradiance that is added to each cell's estimate, because its few rays may miss light.
_UNHIT = 0.2
# Name of the work before the first particle, for the error message of a time limit.
_STARTING = "finding where particles start"


class _Lit(NamedTuple):
    """Sides of elements from which particles start with reflected light of punctual lights and the sky.

    corners  : (L, 9), corner 0 and the edges to corners 1 and 2
    triangle : (L,) index of the scene's triangle
    back     : (L,) 1 if the side is the triangle's back, otherwise 0
    chance   : (L,) probability that a particle starts on this side
    scale    : (L, 3) energy of a particle per irradiance at its start: reflectance times area over chance
    through  : (L, 3) `scale` with transmittance instead of reflectance, for a particle that leaves from the other
               side
    across   : (L,) probability that a particle leaves from the other side
    to_sky, to_camera : (L, BINS) guides to directions of visible sky, and to directions that a camera may see;
               None unless a camera decides the starts
    choice   : choice of punctual lights, if there are many; `row` (L,) is its row for each side
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
    """Run of particles: sums of the energy that they deposit on elements, batch by batch.

    mesh      : coarse elements; each patch is one element
    seed      : random seed; another seed gives an independent solution
    for_camera: True if reflected light of punctual lights and the sky starts by its importance for the camera
    adaptive  : maximum number of times that an element is split in four
    threshold : fraction of the local irradiance by which parts of an element have to differ for it to be split
    particles : number of particles shot
    goal      : number of batches after which the solver decides whether to refine lattices or to end; 0: not set
    tree      : nested lattices; particles are counted on the finest
    flux      : (2, 2, E, 3) energy that arrived at the fronts and backs of the tree's finest elements, W times
                `particles`; [0] straight from a lamp, [1] after a reflection
    square    : (2, E) sums of the squared energy of each arrival, mean of the channels
    hits      : number of hits of particles on surfaces
    open_areas : (2, E) area of the mesh's elements outside solids, for both sides; the full area if all of it is
                 buried
    buried     : (2, E) bool, True if no part of an element's side is outside solids
    lit        : (2, E, 3) irradiance of the mesh's elements by lights that are not patches, without particles
    view       : (2,) sums over batches of x and of x^2; 0 without a camera. x is `BATCH` times the mean radiance
                 that a gather adds to the camera's image
    """

    mesh: Mesh
    seed: int = 0
    for_camera: bool = False
    adaptive: int = 0
    threshold: float = 0.25
    particles: int = 0
    goal: int = 0
    hits: int = 0
    tree: Quadtree = field(init=False)
    flux: Float64 = field(init=False)
    square: Float64 = field(init=False)
    view: Float64 = field(init=False)
    _seen: Float64 | None = field(init=False)

    def __post_init__(self) -> None:
        scene = self.mesh.scene
        count = len(scene.triangles)
        ones = np.ones(count, np.int64)
        sides = Sides.of(scene, Elements.of_lattices(ones))
        used = np.zeros((2, count), bool)
        used[sides.back, sides.element] = True
        self._used = used
        divisions = ones.copy()
        np.maximum.at(divisions, self.mesh.elements.triangle, self.mesh.elements.n)
        check_time(_STARTING)
        self._rays = rays_of(scene)
        self._light = DirectLight(scene)
        occluders = Occluders.of_scene(scene)
        closed = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
        self._solids = Solids.of(scene, closed, self._rays)
        check_time(_STARTING)
        self.open_areas, self.buried, self.lit = self._open_and_lit(self.mesh.elements)
        check_time(_STARTING)
        self._surfaces = ParticleSurfaces.of(scene, self._rays, divisions)
        self._lamps, self._lit, self._lit_count = self._find_lamps(sides)
        check_time(_STARTING)
        self._gathered: Float64 | None = None
        if self.for_camera:
            gathered = gathered_by_camera(scene, self._rays, self.mesh.elements, self.seed)
            self._gathered = gathered / self.open_areas[..., None]
        self._nearness = np.ones(len(self.mesh.elements))
        if self.for_camera and self.adaptive:
            middles = self.mesh.elements.points(scene, np.full((1, 3), 1 / 3))[:, 0]
            self._nearness = near_lamps(self._light.lighting, middles)
        self._count_on(Quadtree(divisions, self._first_depth(divisions)))

    def _first_depth(self, divisions: Int64) -> Int64:
        """Return (T,), number of halvings of the first pass's lattices, so that all elements have similar sizes."""
        depth = np.zeros_like(divisions)
        if self.adaptive:
            scene, surface = self.mesh.scene, self.mesh.surface
            size = size_for_count(scene, surface, _FIRST_ELEMENTS, by_size=True)
            finer = divisions_of_size(scene, surface, size) / divisions
            depth = np.asarray(np.ceil(np.log2(np.maximum(finer, 1.0))), np.int64)
        return np.minimum(depth, min(self.adaptive, _FIRST_DEPTH))

    def _count_on(self, tree: Quadtree, goal: int = 0) -> None:
        """Start anew, with the lattices of `tree`, no particles and another goal."""
        divisions = tree.finest
        flux = np.zeros((2, 2, int((divisions**2).sum()), 3))
        seen = None
        if self._gathered is not None:
            seen = np.stack([tree.of_coarse(self._gathered[..., c]) for c in range(3)], axis=2)
        # One call sets all fields, so that a signal handler never interrupts between two of them.
        vars(self).update(
            tree=tree,
            _surfaces=self._surfaces.on_lattices(divisions),
            flux=flux,
            square=np.zeros(flux.shape[1:3]),
            view=np.zeros(2),
            particles=0,
            goal=goal,
            hits=0,
            _seen=seen,
        )

    def detail(self) -> Detail:
        """Return the elements within which the light found so far changes by more than the threshold.

        For a camera, direct light counts only near lamps, where a gather reads it from the solution. Elsewhere the
        gather traces shadow rays instead.
        """
        direct = self.tree.of_coarse(np.stack([self._nearness] * 2))[..., None]
        light = self.flux[INDIRECT] + direct * self.flux[DIRECT]
        return Detail.of(self.tree, light, self.square, self.mesh.scene.areas, self.threshold)

    def deepen(self, detail: Detail, goal: int) -> bool:
        """Refine lattices if the light changes within their finest elements, and start anew without particles.

        `goal` is the number of batches for the refined lattices.

        Returns False if no lattice needs a refinement, or none is allowed.
        """
        depth = self.tree.depth.copy()
        misplaced = detail.misplaced / self.threshold**2
        if misplaced.sum() < _MISPLACED:
            return False
        size = (self.tree.coarse << depth) ** 2
        room = max(_MAX_ELEMENTS, 2 * len(self.mesh.elements)) - int(size.sum())
        largest_first = np.argsort(-misplaced, kind="stable")
        for triangle in largest_first[: np.count_nonzero(misplaced > _MISPLACED_IN_ONE)]:
            steps = min(_DEEPER, self.adaptive - int(depth[triangle]))
            while steps > 0 and int(size[triangle]) * (4**steps - 1) > room:
                steps -= 1
            room -= int(size[triangle]) * (4**steps - 1)
            depth[triangle] += steps
        if np.array_equal(depth, self.tree.depth):
            return False
        self._count_on(Quadtree(self.tree.coarse, depth), goal)
        return True

    def _find_lamps(self, sides: Sides) -> tuple[Lamps, _Lit, int]:
        """Return lamps, sides that reflect light of other sources, and the particles per batch for these sides."""
        scene = self.mesh.scene
        emitting = np.flatnonzero(sides.emission.any(axis=1))
        of = sides.element[emitting]
        power = sides.emission[emitting] * scene.areas[of, None]
        # Lamps are chosen by power, the mean of the channels, so that coloured lamps get enough particles.
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
        """Return the starts of reflected light, and its approximate power.

        An element's irradiance is estimated by few rays. The estimate determines the number of particles that start
        on the element, but not their energy, which is computed at each start. The mean is therefore unbiased,
        whatever the element size, even if rays missed a lamp.
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
        """Return the choice of punctual lights: a row for the centre of each front, then one for each back."""
        scene = self.mesh.scene
        middles, normals = cells.points(scene, np.full((1, 3), 1 / 3))[:, 0], scene.normals[cells.triangle]
        return self._light.choice(
            np.concatenate([middles, middles]),
            np.concatenate([normals, -normals]),
            np.concatenate([cells.triangle, cells.triangle]),
            np.tile(np.sqrt(scene.areas[cells.triangle]) / cells.n, 2),
        )

    def _start_cells(self) -> Elements:
        """Return the cells of `start_cells`, made smaller where the mesh has small elements for the camera."""
        cells = start_cells(self.mesh.scene, self.mesh.surface)
        if len(self.mesh.elements) > CELLS // 2:
            return cells
        divisions = np.ones(len(self.mesh.scene.triangles), np.int64)
        for elements, parts in ((cells, 1), (self.mesh.elements, 2)):
            np.maximum.at(divisions, elements.triangle, parts * elements.n)
        return Elements.of_lattices(divisions)

    def _spread_visits(self, cells: Elements, visits: Float64) -> Float64:
        """Return `visits` (2, C) with a fraction of them spread evenly over each surface.

        Small cells that all paths missed then get particles, too.
        """
        surface, areas = self.mesh.surface[cells.triangle], self.mesh.scene.areas[cells.triangle] / cells.n**2
        of = np.stack([np.bincount(surface, side) for side in visits]) / np.bincount(surface, areas)
        return np.asarray((1.0 - _SPREAD) * visits + _SPREAD * of[:, surface] * areas)

    def _contribution(
        self, cells: Elements, visits: Float64, choice: LightChoice | None
    ) -> tuple[Float64, Float64]:
        """Estimate (2, C), the light that each side of a cell reflects and transmits, times the light's importance.

        Return also the part of the side's irradiance from each bin of the sky, (2, C, BINS).
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
            check_time(_STARTING)
            with worker_threads(*self._light.stops, doing=_STARTING) as pool:
                task = pool.submit(self._light.estimate_in_bins, points, normals, of, random, rays, chosen)
                irradiance, bins = task.result()
            lit[back, cell] = irradiance.reshape(-1, each).mean(axis=1)
            from_sky[back, cell] = bins.reshape(-1, each, BINS).mean(axis=1)
        # A few rays can miss a window, a lamp or a path to the camera. Without a floor, such a start would have a
        # tiny probability, and a single particle from there would cause a large error.
        usual = float((visits * lit).sum() / max(visits.sum(), 1.0))
        return np.asarray(worth * (lit + _UNHIT * usual)), from_sky

    def _starts(self, number: int) -> Starts:
        """Return the starts of reflected light in a batch, stratified over elements by their probabilities."""
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
            direction[other] = 0.0  # stands for a cosine-weighted direction
            back = np.where(other, 1 - back, back)
        return Starts(position, energy, triangle, back, direction)

    def shoot(self, batches: int, on_batch: Callable[[], None]) -> None:
        """Shoot more batches in threads. Results are added in order, so that sums are reproducible."""
        first = self.particles // BATCH
        threads = core_count()
        # A step of particles is not cut short, because its sums would be wrong.
        with worker_threads(*self._stops, timed=False) as pool:
            for start in range(first, first + batches, threads):
                numbers = range(start, min(start + threads, first + batches))
                for arrivals, hits in pool.map(self._batch, numbers):
                    # Signals interrupt only the main thread. So the sums are added in another thread, which ends
                    # before this block is left.
                    pool.submit(self._add, arrivals, hits).result()
                on_batch()

    @property
    def _stops(self) -> tuple[Stop, ...]:
        return self._surfaces.rays.stop, *self._light.stops

    def _add(self, arrivals: Arrivals, hits: int) -> None:
        """Add a batch to the sums."""
        self.flux += arrivals.flux
        self.square += arrivals.square
        if self._seen is not None:
            # Only indirect light counts, because a gather traces direct light itself.
            seen = float((self._seen * arrivals.flux[INDIRECT]).sum()) / 3
            self.view += seen, seen * seen
        self.hits += hits
        self.particles += BATCH

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all data that the solution depends on, for `restore`."""
        counts = np.array([self.particles, self.hits, self.goal], np.int64)
        return {
            "flux": self.flux,
            "square": self.square,
            "view": self.view,
            "counts": counts,
            "depth": self.tree.depth,
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state of the same scene and settings. Raises ValueError for a state of another mesh."""
        if state["depth"].shape == self.tree.depth.shape:
            self._count_on(Quadtree(self.tree.coarse, np.array(state["depth"], np.int64)))
        for name in ("flux", "square", "view"):
            if state[name].shape != getattr(self, name).shape:
                raise ValueError(
                    f"`{name}` is of another mesh: {state[name].shape}, {getattr(self, name).shape} here"
                )
            setattr(self, name, np.array(state[name]))
        if state["counts"].shape != (3,) or int(state["counts"].min()) < 0:
            raise ValueError("`counts` is expected to have three numbers from 0 on")
        self.particles, self.hits, self.goal = map(int, state["counts"])

    def _batch(self, number: int) -> tuple[Arrivals, int]:
        arrivals = Arrivals(np.zeros_like(self.flux), np.zeros_like(self.square), np.zeros((2, 0, BINS)))
        starts = self._starts(number)
        hits = shoot_batch(
            number, self.seed, self._surfaces, self._lamps, starts, ENDLESS, arrivals, np.empty((4, 3))
        )
        return arrivals, int(hits)

    def error_of_mean(self) -> float | None:
        """Return the relative standard error of the power that arrives at all surfaces; None if none arrived."""
        power = (self.lit.mean(axis=2) * self.open_areas).sum()
        power += self.flux.mean(axis=3).sum() / max(self.particles, 1)
        if not (self.particles and power > 0):
            return None
        return float(np.sqrt(self.square.sum()) / self.particles / power)

    def view_error(self) -> tuple[float, float] | None:
        """Return mean radiance that a gather adds to the camera's image, and its standard error, W sr^-1 m^-2.

        Both are means of the channels. The error is estimated from the differences between batches. None if there
        are fewer than two batches, or no camera.
        """
        batches = self.particles // BATCH
        if self._gathered is None or batches < 2:
            return None
        mean, square = self.view / batches
        return float(mean) / BATCH, float(np.sqrt(max(square - mean * mean, 0.0) / (batches - 1))) / BATCH

    def _open_and_lit(self, elements: Elements) -> tuple[Float64, NDArray[np.bool_], Float64]:
        """Return `open_areas`, `buried` and `lit` of elements of the scene."""
        scene = self.mesh.scene
        sides = Sides.of(scene, elements)
        points, is_open = self._solids.open_points(elements, sides, 4)
        areas = np.stack([scene.areas[elements.triangle] / elements.n**2] * 2)
        areas[sides.back, sides.element] *= np.where(is_open > 0, is_open, 1.0)
        buried = np.zeros(areas.shape, np.bool_)
        buried[sides.back, sides.element] = is_open == 0
        lit = np.zeros((2, len(elements), 3))
        each = points.shape[1]
        lit[sides.back, sides.element] = self._light.of_sides(
            sides,
            elements.triangle[sides.element],
            points.reshape(-1, 3),
            np.repeat(np.arange(len(sides)), each),
            each,
        )
        return areas, buried, lit

    def result(self, detail: Detail) -> tuple[Mesh, Float64, NDArray[np.bool_]]:
        """Return the mesh, split where the light changes, its irradiance, and flags of sides buried in solids.

        irradiance : (2, 2, E, 3), W m^-2, [direct or indirect, side, element, channel]; 0 if a side neither
                     reflects nor emits
        buried     : (2, E) bool
        """
        mesh = detail.mesh(self.mesh)
        whole = detail.leaves[0]
        open_areas, buried, lit = self.open_areas[:, whole], self.buried[:, whole], self.lit[:, whole]
        if mesh is not self.mesh:
            of = np.arange(int(whole.sum()), len(mesh.elements))
            open_parts, buried_parts, lit_parts = self._open_and_lit(mesh.elements[of])
            open_areas = np.concatenate([open_areas, open_parts], axis=1)
            buried = np.concatenate([buried, buried_parts], axis=1)
            lit = np.concatenate([lit, lit_parts], axis=1)
        levels = zip(self.tree.sums(self.flux), detail.leaves, strict=True)
        flux = np.concatenate([sums[:, :, leaf] for sums, leaf in levels], axis=2)
        found = flux / max(self.particles, 1) / open_areas[..., None]
        found[DIRECT] += lit
        used = self._used[:, mesh.elements.triangle]
        return mesh, np.asarray(found * used[..., None]), buried & used
