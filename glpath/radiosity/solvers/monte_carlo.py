"""Monte Carlo radiosity: particles leave the lights, and leave their energy where they hit (stochastic shooting).

The solver behind the pictures of the path-buffer paper [PB 4]. A particle starts on an emitter, by its power, and
goes on from every surface in a direction by the cosine, with the reflectance for its chance of survival (Pattanaik
& Mudur 1992). No form factors and no matrix: the only error is noise, by the root of the number of particles.

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

from glpath.radiosity.form_factors.lights import BINS, DirectLight, directions_in_bins, drawn_bins, guides_of
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.glass import Glass, at_glass
from glpath.radiosity.mesh.mesh import (
    Elements,
    Int64,
    Mesh,
    divisions_of_size,
    occluder_of_triangle,
    size_for_count,
)
from glpath.radiosity.mesh.sides import Sides, open_points
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.rays import Rays, nearest, rays_of
from glpath.radiosity.solution import DIRECT, INDIRECT
from glpath.sampling.points import uniform_sphere
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.model import Camera, Float64
from glpath.system.kernels import inner_kernel, kernel, kernel_part
from glpath.system.machine import core_count

#: Particles of a batch: between two, others can be heard. Each batch has random numbers of its own.
BATCH = 1 << 14
#: Surfaces of glass that a particle passes or is mirrored by, one behind the other.
_MOST_THROUGH = 64
#: Rays to the sky from where a particle starts.
_START_RAYS = 4
#: Cells that reflected light starts in, where a camera says how many start in which, and rays to the sky from each
#: of four points of a cell.
_CELLS, _CELL_RAYS, _FAR_RAYS = 4096, 16, 4
#: So many sides of cells that matter most have so many: a window may be small.
_CLOSER, _CLOSE_RAYS = 2048, 100
#: Of the visits by a camera, this share goes to all of a surface; of what light is usual, to where none was met.
_SPREAD, _UNMET = 0.25, 0.2
#: Batches of paths from a camera that say so.
_CAMERA_BATCHES = 12
#: And of those that say how much of the picture is from where.
_VIEW_BATCHES = 1
_ENDLESS = 1 << 62


class _Surfaces(NamedTuple):
    """What a particle meets: normals, reflectance (2, T, 3), opacity (T,), glass, and lattices, from `begin` on.

    reflectance : of glass without that of its surface, which mirrors
    """

    normals: Float64
    reflectance: Float64
    opacity: Float64
    is_glass: NDArray[np.bool_]
    glass: Glass
    divisions: Int64
    begin: Int64

    @classmethod
    def of(cls, scene: Scene, divisions: Int64) -> _Surfaces:
        glass = Glass.of_scene(scene)
        return cls(
            scene.normals,
            _beside_glass(scene.side_reflectance, glass),
            Appearance(scene).mean_opacity(),
            np.asarray(glass.clear.any(axis=1)),
            glass,
            divisions,
            lattice.starts(lattice.element_count(divisions)),
        )


class _Lamps(NamedTuple):
    """Where particles start, the sums of the chances of that, and the energy of a particle from each.

    corners  : (L, 9), corner 0 and the edges to corners 1 and 2
    triangle : (L,) of the scene; `back` the side of it
    """

    corners: Float64
    triangle: Int64
    back: Int64
    cdf: Float64
    energy: Float64


class _Lit(NamedTuple):
    """Sides of elements where particles start that carry reflected light of punctual lights and the sky.

    corners  : (L, 9), corner 0 and the edges to corners 1 and 2
    triangle : (L,) of the scene; `back` the side of it
    chance   : (L,) of a particle to start there
    scale    : (L, 3) its energy per irradiance at its start: reflectance times area over chance
    to_sky, to_camera : (L, BINS) guides to where the sky is seen, and to where a camera may see what leaves, of
               starts that a camera decides; else none
    """

    corners: Float64
    triangle: Int64
    back: Int64
    chance: Float64
    scale: Float64
    to_sky: Float64 | None
    to_camera: Float64 | None


class _Starts(NamedTuple):
    """Particles that start elsewhere than on a lamp: position (K, 3), energy (K, 3), triangle and side (K,).

    triangle, of those that come from an eye, is -1
    direction : (K, 3) unit; 0 of those that a surface sends by the cosine
    """

    position: Float64
    energy: Float64
    triangle: Int64
    back: Int64
    direction: Float64


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
    open_share : (2, E) of what is not buried in solids, of both sides; and `open_areas`, which are never 0
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
        self.open_share, self.lit = _open_and_lit(self.mesh, self._light)
        # All of an element that light cannot reach: nothing arrives there.
        self.open_areas = np.where(self.open_share > 0, self.open_share, 1.0) * self.mesh.areas
        self._surfaces = _Surfaces.of(scene, divisions)
        self._lamps, self._lit, self._lit_count = self._find_lamps(sides)
        self.flux = np.zeros((2, 2, len(self.mesh.elements), 3))
        self.square = np.zeros(self.flux.shape[1:])
        self.view = np.zeros(2)
        self._gathered: Float64 | None = None
        if self.for_camera:
            gathered = gathered_by_camera(scene, self._rays, self.mesh.elements, self.seed)
            self._gathered = gathered / self.open_areas[..., None]
        self.whole = True

    def _find_lamps(self, sides: Sides) -> tuple[_Lamps, _Lit, int]:
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
        lamps = _Lamps(
            corners=self._rays.corners[of],
            triangle=of,
            back=sides.back[emitting],
            cdf=np.cumsum(chance),
            energy=power / chance[:, None] * (BATCH / max(BATCH - count, 1)),
        )
        return lamps, lit._replace(scale=lit.scale * (BATCH / max(count, 1))), count

    def _find_lit(self) -> tuple[_Lit, float]:
        """Where reflected light starts, and about its power.

        What an element gets is known from few rays. It decides how many particles start there and not what they
        carry, which each finds out where it starts: so neither the size of elements nor a lamp that was missed
        changes what the particles bring in the mean.
        """
        scene, elements, lit, areas = self.mesh.scene, self.mesh.elements, self.lit, self.open_areas
        reflectance = scene.side_reflectance[:, elements.triangle]
        power = (reflectance * lit).mean(axis=2) * areas
        total = float(power.sum())
        to_sky = to_camera = None
        if total and self.for_camera:
            elements = self._start_cells()
            came = np.zeros((2, len(elements), BINS))
            visits = visits_from_camera(scene, self._rays, elements, self.seed, came)
            visits = self._spread_visits(elements, visits)
            power, to_sky = self._contribution(elements, visits)
            reflectance = scene.side_reflectance[:, elements.triangle]
            to_camera = came
        back, element = np.nonzero(reflectance.any(axis=2) if self._light else np.zeros(power.shape, bool))
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
            to_sky=None if to_sky is None else guides_of(to_sky[back, element]),
            to_camera=None if to_camera is None else guides_of(to_camera[back, element]),
        )
        return starts, total

    def _start_cells(self) -> Elements:
        """Those of `start_cells`, and smaller ones where elements are small: where the camera looks."""
        cells = start_cells(self.mesh.scene, self.mesh.surface)
        if len(self.mesh.elements) > _CELLS // 2:
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

    def _contribution(self, cells: Elements, visits: Float64) -> tuple[Float64, Float64]:
        """(2, C): the light that sides of cells reflect, times how much of that a camera sees, about.

        And where in the sky it comes from: (2, C, BINS).
        """
        scene = self.mesh.scene
        reflectance = scene.side_reflectance[:, cells.triangle].mean(axis=2)
        lit, from_sky = np.zeros(visits.shape), np.zeros((*visits.shape, BINS))
        worth = visits * reflectance
        random = np.random.default_rng([self.seed, 1])
        least = np.sort(worth, axis=None)[-_CLOSER] if worth.size > _CLOSER else 0.0
        close, there = worth > least, worth > 0
        for some, rays in ((close, _CLOSE_RAYS), (there & ~close, _CELL_RAYS), (~there, _FAR_RAYS)):
            back, cell = np.nonzero(some & (reflectance > 0))
            triangle, each = cells.triangle[cell], 4
            u = np.sort(random.random((len(cell), each, 2)), axis=2)
            b = np.stack([u[..., 0], u[..., 1] - u[..., 0], 1.0 - u[..., 1]], axis=2)
            points = np.einsum("cek,ckd->ced", b, cells[cell].points(scene, np.eye(3))).reshape(-1, 3)
            normals = np.repeat(scene.normals[triangle] * (1 - 2 * back[:, None]), each, axis=0)
            of = np.repeat(triangle, each)
            irradiance, bins = self._light.estimate_in_bins(points, normals, of, random, rays)
            lit[back, cell] = irradiance.reshape(-1, each).mean(axis=1)
            from_sky[back, cell] = bins.reshape(-1, each, BINS).mean(axis=1)
        # A window, a lamp or a way to the camera may have been missed by all of a few rays: what has a small chance
        # to start comes with much energy, and a single particle of it would be a large error.
        usual = float((visits * lit).sum() / max(visits.sum(), 1.0))
        return np.asarray(reflectance * visits * (lit + _UNMET * usual)), from_sky

    def _starts(self, number: int) -> _Starts:
        """Those of a batch: how many start on an element is even, as far as its chance allows."""
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
        energy = lit.scale[which] * self._light.estimate(position, normals, triangle, random, _START_RAYS, guides)
        direction = np.zeros((count, 3))
        if lit.to_camera is not None:
            bins, share = drawn_bins(lit.to_camera[which], random, 1)
            direction = directions_in_bins(normals, bins[:, 0], random)
            energy /= BINS * share
        return _Starts(position, energy, triangle, back, direction)

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
        """Go on from a state of the same scene and settings. Raises ValueError for one of another mesh."""
        for name in ("flux", "square", "view"):
            if state[name].shape != getattr(self, name).shape:
                raise ValueError(
                    f"`{name}` is of another mesh: {state[name].shape}, {getattr(self, name).shape} here"
                )
            setattr(self, name, np.array(state[name]))
        self.particles, self.hits = map(int, state["counts"])

    def _batch(self, number: int) -> tuple[Float64, int]:
        flux = np.zeros_like(self.flux)
        work, starts = np.empty((4, 3)), self._starts(number)
        nowhere = np.zeros((2, 0, BINS))
        hits = _shoot(
            number, self.seed, self._rays, self._surfaces, self._lamps, starts, _ENDLESS, work, flux, nowhere
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


def start_cells(scene: Scene, surface: Int64) -> Elements:
    """Parts of the scene's triangles, all about as large: the cells that reflected light starts in."""
    size = size_for_count(scene, surface, _CELLS, by_size=True)
    return Elements.of_lattices(divisions_of_size(scene, surface, size))


def divisions_for_camera(scene: Scene, surface: Int64, size: float, count: int, seed: int) -> Int64:
    """(T,) parts of each triangle's edges: those of `size`, and more where a surface matters more than its area.

    Of `count` elements each smooth surface gets as many as light from there matters to what the camera sees.
    """
    cells = start_cells(scene, surface)
    visits = visits_from_camera(scene, rays_of(scene), cells, seed).sum(axis=0)
    of = np.bincount(surface[cells.triangle], visits, minlength=surface.max(initial=-1) + 1)
    area = np.bincount(surface, scene.areas, minlength=len(of))
    # As long as the longest edge of half a square of that area.
    longest = 2.0 * np.sqrt(area / np.maximum(count * of / max(float(of.sum()), 1e-300), 1e-300))
    return divisions_of_size(scene, surface, np.minimum(longest, size)[surface])


def visits_from_camera(
    scene: Scene, rays: Rays, cells: Elements, seed: int, came: Float64 | None = None
) -> Float64:
    """(2, C): importance of the sides of cells, how much of the light that they send a camera sees, about.

    Paths leave the camera, half of them in its view and half all around, as it may turn, and go on as particles do
    (Pattanaik & Mudur 1993, Adjoint equations and random walks for illumination computation). What is counted is
    where they arrive after the surface that the eye sees.

    came : (2, C, BINS), if given, is added the same by the bins of directions back along these paths
    """
    return np.asarray(_from_camera(scene, rays, cells, seed, _CAMERA_BATCHES, 0.5, _ENDLESS, came).mean(axis=2))


def gathered_by_camera(scene: Scene, rays: Rays, elements: Elements, seed: int) -> Float64:
    """(2, E, 3), sr^-1: the mean radiance of a camera's picture, by irradiance of sides that the eye sees by one
    reflection: what a gather looks up."""
    found = _from_camera(scene, rays, elements, seed, _VIEW_BATCHES, 1.0, 1, None) / (_VIEW_BATCHES * BATCH)
    return np.asarray(found * scene.side_reflectance[:, elements.triangle] / np.pi)


def _from_camera(
    scene: Scene,
    rays: Rays,
    cells: Elements,
    seed: int,
    batches: int,
    in_view: float,
    most: int,
    came: Float64 | None,
) -> Float64:
    """(2, C, 3): what paths from a camera bring to sides of cells after the surface that the eye sees."""
    divisions = np.ones(len(scene.triangles), np.int64)
    np.maximum.at(divisions, cells.triangle, cells.n)
    surfaces, camera = _Surfaces.of(scene, divisions), scene.camera.at()
    nothing = np.zeros(0, np.int64)
    lamps = _Lamps(np.zeros((0, 9)), nothing, nothing, np.zeros(0), np.zeros((0, 3)))
    flux = np.zeros((2, 2, len(cells), 3))
    none = np.zeros(BATCH, np.int64)
    bins = np.zeros((2, 0, BINS)) if came is None else came
    for i in range(batches):
        random = np.random.default_rng([seed, i, 0])
        origin, direction = _camera_rays(camera, random.random((BATCH, 2)), in_view)
        starts = _Starts(origin, np.ones((BATCH, 3)), none - 1, none, direction)
        _shoot(1 << 40 | i, seed, rays, surfaces, lamps, starts, most, np.empty((4, 3)), flux, bins)
    return np.asarray(flux[INDIRECT])


def _camera_rays(camera: Camera, u: Float64, in_view: float) -> tuple[Float64, Float64]:
    """Origins and unit directions (N, 3) for u (N, 2): a share in a camera's view, then the others all around."""
    direction = uniform_sphere(u)
    origin = np.repeat(np.asarray(camera.position, np.float64)[None], len(u), axis=0)
    if camera.projection != "panorama":
        half = round(in_view * len(u))
        right, up, forward = camera.frame()
        width, height = camera.resolution
        at = (2 * u[:half] - 1) * [width / height, 1.0]
        if camera.projection == "orthographic":
            origin[:half] += 0.5 * camera.height * (at[:, :1] * right + at[:, 1:] * up)
            direction[:half] = forward
        else:
            at = at * np.tan(np.radians(camera.fov) / 2)
            seen = forward + at[:, :1] * right + at[:, 1:] * up
            direction[:half] = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    return origin, direction


def _beside_glass(reflectance: Float64, glass: Glass) -> Float64:
    """(2, T, 3) reflectance without the part of glass that its surface mirrors."""
    f0, f90, layered, coat = glass.layer.T
    coat = coat * (0.04 + 0.96 / 21.0)
    mirrored = coat + (1.0 - coat) * layered * (f0 + (f90 - f0) / 21.0)
    return np.asarray(np.maximum(reflectance - np.where(glass.clear.any(axis=1), mirrored, 0.0)[:, None], 0.0))


def _open_and_lit(mesh: Mesh, light: DirectLight) -> tuple[Float64, Float64]:
    """`Shooting.open_share` and `Shooting.lit`."""
    occluders = Occluders.of_scene(mesh.scene)
    sides = Sides.of(mesh.scene, mesh.elements)
    solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
    points, is_open = open_points(mesh.scene, solid, mesh.elements, sides, 4)
    share = np.ones((2, len(mesh.elements)))
    share[sides.back, sides.element] = is_open
    lit = np.zeros((2, len(mesh.elements), 3))
    each = points.shape[1]
    lit[sides.back, sides.element] = light.of_sides(
        sides,
        mesh.elements.triangle[sides.element],
        points.reshape(-1, 3),
        np.repeat(np.arange(len(sides)), each),
        each,
    )
    return share, lit


@inner_kernel
def _random(state):  # type: ignore[no-untyped-def]
    """The next of a sequence of numbers in [0, 1): splitmix64 (Steele et al. 2014). Returns state and number."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return state, float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def _shoot(number, seed, rays, surfaces, lamps, starts, most, work, flux, came):  # type: ignore[no-untyped-def]
    """One batch of particles; adds to flux (2, 2, E, 3) and returns the number of hits. work: (4, 3).

    most : reflections after which a particle ends where it arrives
    came : (2, E, BINS), or (2, 0, BINS); adds what arrives after being reflected, by the bin that it came from
    """
    corners, normals, reflectance, glass = lamps.corners, surfaces.normals, surfaces.reflectance, surfaces.glass
    hits = 0
    if len(lamps.cdf) == 0 and len(starts.triangle) == 0:
        return hits
    o, d, w, found = work[0], work[1], work[2], work[3]
    state, _ = _random(np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(number))
    state, _ = _random(state ^ (np.uint64(number) << np.uint64(32)))
    for particle in range(BATCH):
        if particle < len(starts.triangle):
            triangle, back = starts.triangle[particle], starts.back[particle]
            for k in range(3):
                o[k], w[k], d[k] = (
                    starts.position[particle, k],
                    starts.energy[particle, k],
                    starts.direction[particle, k],
                )
            if max(w[0], w[1], w[2]) <= 0:
                continue  # in the shadow
            part = 0 if triangle < 0 else 1
            leaves = d[0] == 0 and d[1] == 0 and d[2] == 0
        else:
            state, u = _random(state)
            which = min(_above(lamps.cdf, u), len(lamps.cdf) - 1)
            triangle, back, part = lamps.triangle[which], lamps.back[which], 0  # direct, until it is reflected
            state, u = _random(state)
            state, v = _random(state)
            root = np.sqrt(u)
            for k in range(3):
                o[k] = corners[which, k] + root * ((1 - v) * corners[which, 3 + k] + v * corners[which, 6 + k])
                w[k] = lamps.energy[which, k]
            leaves = True
        passed, reflections = 0, 0
        while True:
            if leaves:
                state = _leave(state, normals[triangle], back, d)
            hit = nearest(rays, o, d, triangle, found)
            if hit < 0:
                break
            hits += 1
            triangle = hit
            along = 0.0
            for k in range(3):
                along += normals[triangle, k] * d[k]
                o[k] += found[0] * d[k]
            back = 1 if along > 0 else 0
            is_glass = surfaces.is_glass[triangle]
            if is_glass and back == 1 and glass.ior[triangle] > 0:
                for k in range(3):
                    w[k] *= np.exp(-glass.attenuation[triangle, k] * found[0])
            n = surfaces.divisions[triangle]
            x, y = n * found[1], n * found[2]
            i = min(int(x), n - 1)
            j = max(0, min(int(y), n - 1 - i))
            upper = 1 if (x - i + y - j > 1 and i + j < n - 1) else 0
            at = surfaces.begin[triangle] + j * (2 * n - j) + 2 * i + upper
            if part == 1 and came.shape[1] > 0:
                came[back, at, _bin(normals[triangle], d)] += (w[0] + w[1] + w[2]) / 3
            survival = 0.0
            for k in range(3):
                flux[part, back, at, k] += w[k]
                survival = max(survival, reflectance[back, triangle, k])
            state, u = _random(state)
            chance, met = survival, u < surfaces.opacity[triangle]
            if is_glass and met:
                # As a path of the shaders: mirrored, through, or met by what of the base is dull.
                inside = back == 1 and glass.ior[triangle] > 0
                mirrored, left = at_glass(glass, triangle, abs(along), inside)
                clear = max(glass.clear[triangle, 0], glass.clear[triangle, 1], glass.clear[triangle, 2])
                through = clear * left
                state, u = _random(state)
                if u < mirrored + through:
                    passed += 1
                    if passed > _MOST_THROUGH:
                        break
                    leaves = False
                    scale, bends = 1.0, -2 * along
                    if u >= mirrored:
                        bends = 0.0
                        index = glass.ior[triangle]
                        if index > 0:
                            scale = index if inside else 1 / index
                            far = np.sqrt(max(0.0, 1 - scale * scale * (1 - along * along)))
                            bends = (far if along > 0 else -far) - scale * along
                        for k in range(3):
                            w[k] *= glass.clear[triangle, k] / clear
                    if u < mirrored or not glass.pane[triangle]:
                        part = 1  # which rays to a light do not find
                    for k in range(3):
                        d[k] = scale * d[k] + bends * normals[triangle, k]
                    length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                    for k in range(3):
                        d[k] /= length
                    continue
                rest = max(1 - mirrored - through, 1e-9)
                u = (u - mirrored - through) / rest
                chance = survival / (rest * surfaces.opacity[triangle])
            passed = 0
            leaves = u < chance
            if leaves:
                reflections += 1
                if reflections > most:
                    break
                part = 1
                for k in range(3):
                    w[k] *= reflectance[back, triangle, k] / survival
            elif met:
                break  # absorbed; what it does not meet, it passes through, as it is
    return hits


@kernel_part
def _above(cdf, u):  # type: ignore[no-untyped-def]
    """The first of rising numbers that is above u; as many as there are where none is."""
    low, high = 0, len(cdf)
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@kernel_part
def _bin(normal, d):  # type: ignore[no-untyped-def]
    """The bin of the direction back along d, which arrives: of the point about the normal's tip, as in `_leave`."""
    c = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]
    sign = -1.0 if c > 0 else 1.0
    x = 2 * abs(c) * -d[0] - sign * normal[0]
    y = 2 * abs(c) * -d[1] - sign * normal[1]
    z = 2 * abs(c) * -d[2] - sign * normal[2]
    turn = np.arctan2(y, x) / (2 * np.pi)
    side = int(np.sqrt(BINS))
    i = min(max(int((1 - z) / 2 * side), 0), side - 1)
    j = min(max(int((turn + (1 if turn < 0 else 0)) * side), 0), side - 1)
    return i * side + j


@kernel_part
def _leave(state, normal, back, d):  # type: ignore[no-untyped-def]
    """Fill d with a direction by the cosine about a side's normal: a point of the unit sphere about its tip."""
    state, u = _random(state)
    state, v = _random(state)
    z = 1 - 2 * u
    r = np.sqrt(max(0.0, 1 - z * z))
    sign = -1.0 if back else 1.0
    d[0] = sign * normal[0] + r * np.cos(2 * np.pi * v)
    d[1] = sign * normal[1] + r * np.sin(2 * np.pi * v)
    d[2] = sign * normal[2] + z
    length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for k in range(3):
        d[k] = d[k] / length if length > 1e-9 else sign * normal[k]
    return state
