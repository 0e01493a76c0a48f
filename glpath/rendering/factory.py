"""Factory of engines for an integrator, its options and a scene; only this module knows each engine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from glpath.errors import SceneError, TimeLimitError, argument, warn
from glpath.film.aovs import guides_denoiser
from glpath.film.bias import BIAS_OBSTACLE, REJECTED_GATHER
from glpath.film.choices import TIME_LIMIT
from glpath.film.film import Film
from glpath.gl.context import Context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.engine import Engine
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.interleaved import Interleaved
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.ray_paths import CEILING, RayPathEngine
from glpath.integrators.settings import IntegratorSettings
from glpath.integrators.solution_lookup import device_radiosity, solution_digest
from glpath.integrators.whitted_settings import WhittedSettings
from glpath.scene import Scene, path_traceable
from glpath.scene.instances import instanced
from glpath.scene.proxy import Proxies, with_proxies
from glpath.scene.triangulate import check_resident, check_simplifiable, check_streamable, check_unmirrored
from glpath.sensors.sensor import CameraSensor, Sensor
from glpath.system.time_limit import named_work, part_of_time

if TYPE_CHECKING:
    from glpath.integrators.whitted import WhittedTracer
    from glpath.radiosity.solution import RadiositySolution
    from glpath.radiosity.solvers.solve import RadiosityProgress

Window = tuple[int, int, int, int]
Say = Callable[[str], None]

# Memory in bytes for each triangle when instances are expanded (5.9 GiB measured for 7.7 million triangles).
_BYTES_PER_TRIANGLE = 820
# Minimum number of triangles for which memory is checked.
_MANY_TRIANGLES = 1_000_000

_Shared = TypeVar("_Shared", PathBufferSettings, GatherSettings)

# Minimum number of pixels per triangle for interleaved images. Their four engines each do all work per triangle.
_PIXELS_PER_TRIANGLE = 16

# Minimum area of the proxies, as a fraction of the streamed triangles' area. With less, their solution would be
# that of a different scene.
_LOST = 0.5

# If more than this fraction of rays is lost, a warning says that the image is noisier than its path sets suggest.
_CROWDED = 0.25

#: Key in a film's statistics. It shows that the paths have no guides, because the time limit left no time for a
#: solution.
UNGUIDED = "unguided_by_time_limit"

#: Number of patches of a radiosity solution made for a gather. Few suffice: each pixel is a
#: mean over hundreds of elements, which hides the noise of the solution.
GATHER_PATCHES = 500
#: Minimum number of particles of a solution made for a gather. Compared with eight million particles, these few
#: change an image's relMSE by 7e-6 (`cornell-box-36`) and 2e-5 (`room`). For the same error, progressive refinement
#: takes three times as long there, and ten times in `office`.
_MIN_PARTICLES = 1 << 16
#: Maximum number of particles of a solution made for a gather.
_MAX_PARTICLES = 1 << 20
#: Number of particles for each triangle, between the minimum and the maximum.
_PARTICLES_PER_TRIANGLE = 8
# Factor on the number of particles if the scene has a sky or `lights`; the solver adds more if these are too few.
# Most particles that start all over a scene leave it at once, and few enter through a window. In a room of 4 x 5
# beside a ground of 80 x 80, the room's mean varies by 0.5 % between seeds.
_STARTING_EVERYWHERE = 4
#: Difference between parts of an element above which the element is split, as a fraction of the local irradiance.
_THRESHOLD = 0.25
#: Value of `_THRESHOLD` for a refined solution.
_REFINED_THRESHOLD = 0.09
#: Factor on the number of patches for a refined solution.
_MORE_PATCHES = 4
#: Factor on the number of particles for a refined solution.
_MORE_PARTICLES = 8
_COARSE_PIXELS = 1 << 16  # maximum number of pixels of an image for which GATHER_PATCHES suffice


def solve_for_gather(
    scene: Scene, on_progress: Callable[[RadiosityProgress], None] | None = None, *, refined: bool = False
) -> RadiositySolution:
    """Solve the radiosity coarsely by particles, to guide paths, or for a gather that was given no solution.

    A larger image gets more elements, because finer guides are worth their cost in a larger image.

    refined : True for more and finer elements, if the bias with the usual ones is too large
    """
    from glpath.radiosity.solvers.solve import solve_radiosity  # late, because the import is slow

    width, height = scene.camera.resolution
    finer = max(1.0, (width * height / _COARSE_PIXELS) ** 0.5)
    wanted = max(_PARTICLES_PER_TRIANGLE * len(scene.triangles), round(_MIN_PARTICLES * finer))
    if scene.sky is not None or scene.lights:
        wanted *= _STARTING_EVERYWHERE
    more_patches, more_particles = (_MORE_PATCHES, _MORE_PARTICLES) if refined else (1, 1)
    return solve_radiosity(
        scene,
        method="monte-carlo",
        patches=more_patches * round(GATHER_PATCHES * finer),
        particles=min(more_particles * wanted, _MAX_PARTICLES),
        threshold=_REFINED_THRESHOLD if refined else _THRESHOLD,
        for_camera=True,
        on_progress=on_progress,
    )


class Counts(Protocol):
    """Part of an engine's interface that is needed for a film's metadata."""

    def statistics(self) -> dict[str, object]:
        """Return the engine's counts so far, for `FilmMetadata.statistics`."""


@dataclass(frozen=True)
class Plan(ABC):
    """Integrator with its options, for any scene. Default implementations of the methods suit most integrators."""

    settings: IntegratorSettings

    def recorded(self) -> dict[str, Any]:
        """Return the settings that determine the image besides the scene, as in a film's metadata."""
        return self.settings.recorded()

    def warnings(self, scene: Scene) -> list[str]:
        """Return warnings about features of a scene that this integrator does not render as intended."""
        return []

    @abstractmethod
    def traceable(self, scene: Scene) -> Scene:
        """Return the scene in the form that the engine traces, with coordinates relative to `Scene.origin`.

        Raises SceneError.
        """

    def prepared(self, scene: Scene, say: Say) -> Plan:
        """Return the plan with the results that need no OpenGL context, such as a radiosity solution.

        scene : result of `traceable`
        say   : function called at intervals with a description of the work
        """
        return self

    @abstractmethod
    def engine(
        self,
        context: Context,
        scene: Scene,
        sensor: Sensor,
        window: Window,
        timings: bool,
        device: DeviceScene | None = None,
    ) -> Engine:
        """Return an engine for a traceable scene with the sensor's camera. The plan is prepared; the engine is not.

        device : scene on the device, from another engine of the same plan
        sensor : sensor relative to the scene's origin, like all later sensors of the engine; see `sensor_in`
        """

    def bias_probe(
        self, engine: Engine, context: Context, scene: Scene, sensor: Sensor
    ) -> tuple[PathSetEngine, PathSetEngine] | None:
        """Return an engine with the plan's bias and one without, which trace the same paths; neither is prepared.

        Returns None if the plan has no bias that can be measured.

        engine : engine of the plan, whose data on the device are shared
        sensor : sensor whose whole image both engines render
        """
        return None

    def refined(self, scene: Scene, say: Say) -> Plan | None:
        """Return the prepared plan with a finer radiosity solution; None if it has no finer one."""
        return None

    def without_bias(self) -> Plan | None:
        """Return the prepared plan of an unbiased integrator; None if the job fixes the integrator."""
        return None

    def resumed(self, film: Film | None) -> Plan:
        """Return the plan that began a film, in which integrator and solution may have been replaced."""
        return self

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        """Switch an engine to another traceable scene with its own camera. Raises SceneError."""
        _move_camera(engine, scene)

    def remarks(self, film: Film) -> list[str]:
        """Return warnings about a finished film."""
        return []

    def solution_error(self) -> float | None:
        """Return `FilmMetadata.solution_error` of a prepared plan for the camera's image; None without bias."""
        return None


def sensor_in(traced: Scene, sensor: Sensor, scene: Scene) -> Sensor:
    """Return a sensor relative to the origin of the traceable scene."""
    return sensor.moved(traced.origin - scene.origin)


def plan_of(settings: IntegratorSettings) -> Plan:
    """Return the object that prepares and makes the engine of the integrator with these settings."""
    return PLANS[settings.integrator](settings)


@dataclass(frozen=True)
class _Paths(Plan):
    """Plan of "path".

    solution : radiosity solution of the prepared plan if paths are guided. It is not recorded, because images made
               with different solutions can be merged: paths are unbiased
    is_refined : True if the solution is the fine one of a rejected gather
    is_resumed : True if the film was begun with guides, so it cannot be continued without them
    """

    settings: PathSettings
    solution: RadiositySolution | None = None
    is_refined: bool = False
    is_resumed: bool = False

    def traceable(self, scene: Scene) -> Scene:
        if self.settings.needs_solution:
            _check_expandable(scene)
        return path_traceable(_posed(scene))

    def prepared(self, scene: Scene, say: Say) -> Plan:
        if not self.settings.guided or self.solution is not None:
            return self
        # The solution may be unfinished, and may ignore motion, because it only guides paths, which stay unbiased.
        if self.is_resumed:
            return replace(self, solution=_solved(scene.still(), say, refined=self.is_refined))
        solution = _solved_in_time(scene.still(), say, refined=self.is_refined)
        return self.unguided() if solution is None else replace(self, solution=solution)

    def unguided(self) -> _Paths:
        """Return the plan of paths without guides."""
        return replace(self, settings=replace(self.settings, guide="cosine"))

    def resumed(self, film: Film | None) -> _Paths:
        if film is None or not film.path_sets:
            return self
        if UNGUIDED in film.metadata.statistics:
            return self.unguided()
        return replace(self, is_resumed=True)

    def engine(
        self,
        context: Context,
        scene: Scene,
        sensor: Sensor,
        window: Window,
        timings: bool,
        device: DeviceScene | None = None,
    ) -> Engine:
        return _engine_with_solution(self, context, scene, sensor, window, timings, device)

    def remarks(self, film: Film) -> list[str]:
        return _cut(film)


@dataclass(frozen=True)
class _PathBuffer(Plan):
    """Plan of "path-buffer"."""

    settings: PathBufferSettings

    def warnings(self, scene: Scene) -> list[str]:
        return _without_ground(scene)

    def traceable(self, scene: Scene) -> Scene:
        _check_expandable(scene)
        scene = _posed(scene)
        if self.settings.bounce_lod is not None:
            check_simplifiable(scene)
        return path_traceable(scene, streams=True)

    def prepared(self, scene: Scene, say: Say) -> Plan:
        return replace(self, settings=_interleaved(self.settings, scene))

    def engine(
        self,
        context: Context,
        scene: Scene,
        sensor: Sensor,
        window: Window,
        timings: bool,
        device: DeviceScene | None = None,
    ) -> Engine:
        make = partial(Interleaved, make=path_engine) if self.settings.interleaved else path_engine
        return make(
            context.gl,
            DeviceScene(context.gl, scene, geometry_budget=self.settings.geometry_budget),
            self.settings,
            window,
            sensor=sensor,
            timings=timings,
        )

    def remarks(self, film: Film) -> list[str]:
        return _crowding(film)


def _interleaved(settings: _Shared, scene: Scene) -> _Shared:
    """Return the settings with `interleave` decided.

    An interleaved image is rendered as four parts, each with every second pixel of every second row.
    """
    if settings.interleave is not None or not settings.by_path_buffer:
        return settings
    width, height = scene.camera.resolution
    pays = not scene.shapes.streams and _PIXELS_PER_TRIANGLE * len(scene.triangles) <= width * height
    denoised = guides_denoiser(settings.aovs)
    return replace(settings, interleave="always" if denoised and pays else "never")


def _engine_with_solution(
    plan: _Paths | _Gathering,
    context: Context,
    scene: Scene,
    sensor: Sensor,
    window: Window,
    timings: bool,
    device: DeviceScene | None,
) -> Engine:
    """Return the engine of a plan, with its radiosity solution if it has one."""
    solution, settings = plan.solution, plan.settings
    # Instances are expanded to triangles only if there is a solution, or if the sensor is not a camera.
    parted = instanced(scene) if solution is None and isinstance(sensor, CameraSensor) else None
    if parted is None:
        _check_expandable(scene)
    proxies = plan.proxies if isinstance(plan, _Gathering) else None
    radiosity = (
        None if solution is None else device_radiosity(context.gl, scene, solution, settings, sensor, proxies)
    )
    each = partial(path_engine, radiosity=radiosity)
    make = partial(Interleaved, make=each) if settings.interleaved else each
    budget = settings.geometry_budget if isinstance(settings, GatherSettings) else None
    device = device or DeviceScene(context.gl, parted or scene, geometry_budget=budget)
    return make(context.gl, device, settings, window, sensor=sensor, timings=timings)


def _check_expandable(scene: Scene) -> None:
    """Raise SceneError if the triangles of all instances, which an engine needs, do not fit into memory."""
    total, kept = scene.shapes.total("triangle"), sum(len(mesh.faces) for mesh in scene.shapes.meshes)
    if total < _MANY_TRIANGLES or total < 2 * kept:
        return
    from glpath.radiosity.memory import available_bytes  # late, because the import is slow

    need, available = _BYTES_PER_TRIANGLE * total, available_bytes()
    if need > available:
        raise SceneError(
            f"{scene.source or scene.name}: {total:,} triangles of all instances of {kept:,} would take about "
            f"{need / 2**30:,.1f} GiB; there are {available / 2**30:,.1f}.",
            f"Render it with {argument('integrator', 'path')} and {argument('guide', 'cosine')}, which keeps each "
            "mesh once.",
        )


def _posed(scene: Scene) -> Scene:
    """Return the scene with only the motion that happens while the shutter is open."""
    return scene if scene.moving_shapes else scene.still()


def _proxies(scene: Scene, say: Say) -> Proxies:
    """Return the scene with meshes instead of streams. Raises SceneError if too little of their area is left."""
    doing = "simplifying streamed triangles"
    say(doing)
    with named_work(doing):
        proxies = with_proxies(scene)
    if proxies.area < _LOST:
        raise SceneError(
            f"{scene.source or scene.name}: the gather solves a simpler mesh instead of streamed triangles, but "
            f"that has {proxies.area:.0%} of their area: they are too small and scattered.",
            f"Render it with {argument('integrator', 'path-buffer')}.",
        )
    return proxies


def _solved(scene: Scene, say: Say, *, refined: bool = False) -> RadiositySolution:
    def report(progress: RadiosityProgress) -> None:
        unshot = "" if progress.unshot is None else f", {float(f'{100 * progress.unshot:.1g}'):g} % unshot"
        say(f"solving radiosity: {progress.stage}{unshot}" if progress.elements else progress.stage)

    say("solving radiosity")
    return solve_for_gather(scene, report, refined=refined) if refined else solve_for_gather(scene, report)


def _solved_in_time(scene: Scene, say: Say, *, refined: bool = False) -> RadiositySolution | None:
    """Return the solution, which the time limit may cut short; None if there was no time for any."""
    try:
        with part_of_time():
            return _solved(scene, say, refined=refined)
    except TimeLimitError:
        return None


def _is_cut_short(solution: RadiositySolution) -> bool:
    return solution.statistics.get("stop_rule") == TIME_LIMIT


def _move_camera(engine: Engine, scene: Scene) -> None:
    """Switch an engine to the camera of a scene that is otherwise the same."""
    if scene.digest(camera=False) != engine.scene.given.digest(camera=False):
        raise SceneError(
            f"{scene.source or scene.name}: a frame differs from the first one in more than its camera.",
            'Only "t-buffer" and "classic" continue with another scene; with the others, render it alone.',
        )
    engine.look_from(CameraSensor.of(scene.camera))


def _crowding(film: Film) -> list[str]:
    statistics = film.metadata.statistics
    share = statistics.get("paths_lost", 0) / max(1, statistics["paths_cast"])
    if share <= _CROWDED:
        return []
    return [
        f"{film.metadata.scene}: {share:.0%} of the rays lost the roulette of their cell; the image is right "
        "on average, but noisy. Far surfaces stretch the view until the paths crowd: make the ground smaller, "
        "or render more path sets."
    ]


def _without_ground(scene: Scene) -> list[str]:
    """Return a warning if the scene has a ground, which catches no shadow in path-buffer scans."""
    if scene.background is None or scene.background.ground is None or scene.sky is None:
        return []
    return [
        "The ground below the model catches no shadow where a path-buffer casts the rays; "
        f"{argument('integrator', 'path')} shows it."
    ]


def _biased(film: Film) -> list[str]:
    """Return a warning if the bias of a gather may be too large, or if it could not be measured."""
    bias, obstacle = film.bias(), film.metadata.statistics.get(BIAS_OBSTACLE)
    if bias is None:
        text = obstacle
    elif bias.is_small():
        text = None
    else:
        found = "is" if bias.is_large() else "may be too large: it is"
        text = f"the bias of the gather {found} {bias}. Its radiosity solution may be too coarse for this scene"
    return [] if text is None else [f"{film.metadata.scene}: {text}; {argument('integrator', 'path')} has no bias."]


def _cut(film: Film) -> list[str]:
    cut = film.metadata.statistics.get("paths_cut", 0)
    if not cut:
        return []
    return [
        f"{film.metadata.scene}: {cut:,} paths were cut after {CEILING:,} vertices, which chance should have ended "
        "before: hardly any light is absorbed there, and some of it is missing. Give closed surfaces a reflectance "
        "below 0.999."
    ]


@dataclass(frozen=True)
class _Gathering(Plan):
    """Plan of "gather", which looks up a radiosity solution.

    solution : solution of the prepared plan: the given one, from its file, or made for the scene
    proxies  : meshes that replace the streamed triangles in the radiosity solution; None if the plan is not
               prepared or the scene has no streams
    is_resumed : True if the plan resumes a film that was begun with a complete solution. It then needs a complete
                 solution again
    """

    settings: GatherSettings
    solution: RadiositySolution | None = None
    proxies: Proxies | None = None
    is_resumed: bool = False

    def recorded(self) -> dict[str, Any]:
        lookup = self.settings.radiosity_lookup
        digest = "" if self.solution is None else solution_digest(self.solution, lookup)
        return self.settings.recorded() | {"radiosity": digest}

    def warnings(self, scene: Scene) -> list[str]:
        missing = _without_ground(scene) if self.settings.by_path_buffer else []
        if not np.any(scene.ambient > 0):
            return missing
        return [
            *missing,
            "The scene's ambient light stands for bounces that are not traced; a gather has them all from its "
            f"solution, and leaves it out. {argument('integrator', 'path')} adds it beyond the last vertex.",
        ]

    def traceable(self, scene: Scene) -> Scene:
        if scene.moving_shapes:
            names = [scene.shapes[i].name for i in scene.moving_shapes]
            listed = f"{', '.join(names[:3])}{', ...' if len(names) > 3 else ''}"
            raise SceneError(
                f"{scene.source or scene.name}: {listed} move{'s' * (len(names) == 1)} while the shutter is open, "
                "but a radiosity solution, which a gather looks up, is of one moment.",
                f"Render it with {argument('integrator', 'path')}; or give the shutter one moment, for a gather of "
                "that. (The camera may move.)",
            )
        _check_expandable(scene)
        return path_traceable(_posed(scene), streams=self.settings.by_path_buffer)

    def prepared(self, scene: Scene, say: Say) -> Plan:
        from glpath.radiosity.solution import RadiositySolution  # late, because the import is slow

        if self.solution is not None:
            return self
        given, proxies = self.settings.radiosity, _proxies(scene, say) if scene.shapes.streams else None
        solved = scene if proxies is None else proxies.scene
        if given is None:
            return self._solved_in_time(scene, solved, proxies, say)
        if isinstance(given, Path):
            solution = RadiositySolution.load(given)
        else:
            assert isinstance(given, RadiositySolution), f"an option that was not checked: {given!r}"
            solution = given
        solution.check_scene(solved)
        return replace(self, settings=_interleaved(self.settings, scene), solution=solution, proxies=proxies)

    def _solved_in_time(self, scene: Scene, solved: Scene, proxies: Proxies | None, say: Say) -> Plan:
        """Return the prepared plan; a plan of paths if time is too short for a solution and the job allows it.

        Raises TimeLimitError if a resumed film or the job needs a solution and the time does not suffice.
        """
        refined = self.settings.refined
        can_be_paths = self.settings.or_path and not self.is_resumed
        if can_be_paths:
            solution = _solved_in_time(solved, say, refined=refined)
        else:
            with nullcontext() if self.is_resumed else part_of_time(required=True):
                solution = _solved(solved, say, refined=refined)
        if solution is not None and not _is_cut_short(solution):
            return replace(self, settings=_interleaved(self.settings, scene), solution=solution, proxies=proxies)
        paths = replace(self, solution=solution).without_bias() if can_be_paths else None
        if isinstance(paths, _Paths):
            return paths if solution is not None else paths.unguided()
        assert solution is not None, "an error of the solver"
        if self.is_resumed:
            raise TimeLimitError("the time limit was over before the solution of the resumed film was there.")
        particles = solution.statistics.get("particles", 0)
        warn(
            f"{scene.source or scene.name}: the time limit cut the radiosity solution short, after {particles:,} "
            f"particles: the gather has their noise as a bias. {argument('integrator', 'path')} has none.",
            late=True,
        )
        return replace(self, settings=_interleaved(self.settings, scene), solution=solution, proxies=proxies)

    def engine(
        self,
        context: Context,
        scene: Scene,
        sensor: Sensor,
        window: Window,
        timings: bool,
        device: DeviceScene | None = None,
    ) -> Engine:
        assert self.solution is not None, "the plan is not prepared"
        return _engine_with_solution(self, context, scene, sensor, window, timings, device)

    def bias_probe(
        self, engine: Engine, context: Context, scene: Scene, sensor: Sensor
    ) -> tuple[PathSetEngine, PathSetEngine] | None:
        solution = self.solution
        if solution is None or self.proxies is not None:
            return None  # the probe's BVH cannot contain streamed triangles
        width, height = sensor.resolution
        gather = GatherSettings(
            lookup_depth=self.settings.lookup_depth,
            lookup_distance=self.settings.lookup_distance,
            radiosity_lookup=self.settings.radiosity_lookup,
            direct_light=self.settings.direct_light,
        )
        path = PathSettings(guide="solution").completed(lambda: True)
        known = engine.radiosity if isinstance(engine, RayPathEngine) else None
        # The probe shares the engine's solution on the device, unless an option makes the engine look it up
        # differently.
        usual = (
            self.settings.guided and gather.direct_light == "traced" and gather.radiosity_lookup == "interpolated"
        )
        shared = known if usual else None

        def made(settings: GatherSettings | PathSettings) -> PathSetEngine:
            radiosity = shared or device_radiosity(context.gl, scene, solution, settings, sensor)
            window = (0, 0, width, height)
            return path_engine(context.gl, engine.scene, settings, window, sensor=sensor, radiosity=radiosity)

        return made(gather), made(path)

    def refined(self, scene: Scene, say: Say) -> Plan | None:
        fixed = self.is_resumed or self.settings.refined or self.settings.radiosity is not None
        if fixed or self.proxies is not None:
            return None
        solution = _solved_in_time(scene, say, refined=True)
        if solution is None or _is_cut_short(solution):
            return None
        return replace(self, settings=replace(self.settings, refined=True), solution=solution)

    def without_bias(self) -> Plan | None:
        settings = self.settings
        if self.is_resumed or not settings.or_path:
            return None
        path = PathSettings(
            seed=settings.seed, aovs=settings.aovs, sampling=settings.sampling, guide=settings.guide
        ).completed(lambda: True)
        return _Paths(path, self.solution, settings.refined)

    def resumed(self, film: Film | None) -> Plan:
        if film is None:
            return self
        resumed = replace(self, is_resumed=film.path_sets > 0)
        refined = replace(resumed, settings=replace(self.settings, refined=True))
        if REJECTED_GATHER in film.metadata.statistics:
            paths = replace(self, settings=refined.settings).without_bias()
            return refined if paths is None else paths.resumed(film)
        if film.metadata.integrator == PathSettings.integrator:
            paths = self.without_bias()
            return resumed if paths is None else paths.resumed(film)
        return refined if film.metadata.settings.get("refined") else resumed

    def remarks(self, film: Film) -> list[str]:
        return _biased(film) + _crowding(film)

    def solution_error(self) -> float | None:
        if self.settings.radiosity is not None or self.solution is None:
            return None  # a given solution was made for another camera, or for none
        found = self.solution.statistics.get("view_error")
        return None if found is None else float(found)


@dataclass(frozen=True)
class _Whitted(Plan):
    """Plan of the ray tracers "classic" and "t-buffer"."""

    settings: WhittedSettings

    def warnings(self, scene: Scene) -> list[str]:
        if scene.lights or np.any(scene.ambient > 0):
            return []
        endless = [shape.name for shape in scene.shapes if shape.emits and shape.primitive == "plane"]
        return [
            f'The plane "{name}" emits: it is seen, but no point of an endless plane can be sampled, so it '
            "lights nothing. Make it a quad."
            for name in endless
        ]

    def traceable(self, scene: Scene) -> Scene:
        if self.settings.stream_budget is None:
            check_resident(scene)
        else:
            check_streamable(scene)
            check_unmirrored(scene, self.settings.max_depth)
        _check_expandable(scene)
        used = [scene.materials[index] for index in sorted({shape.material for shape in scene.shapes})]
        translucent = [m.name for m in used if m.roughness is not None and m.diffuse_transmission > 0]
        if translucent:
            raise SceneError(
                f"{scene.source or scene.name}: has a diffuse transmission ({', '.join(translucent[:3])}), "
                "which this ray tracer does not have.",
                f"Render it with {argument('integrator', 'path', 'gather')}.",
            )
        glass = [material.name for material in used if material.roughness is not None and material.transmission > 0]
        if glass:
            names = f"{', '.join(glass[:3])}{', ...' if len(glass) > 3 else ''}"
            raise SceneError(
                f"{scene.source or scene.name}: has glass ({names}), but a ray of this ray tracer is mirrored "
                "and does not part.",
                f"Render it with {argument('integrator', 'path', 'gather')}.",
            )
        camera = scene.camera
        if self.settings.primary == "t-buffer" and camera.projection == "panorama":
            raise SceneError(
                f"{scene.source or scene.name}: has a camera of type panorama; a T-buffer bounds "
                "objects as they are seen on a plane.",
                f"Render it with {argument('integrator', 'classic')}, which shoots every ray, or with "
                f"{argument('integrator', 'path', 'gather')}.",
            )
        return _posed(scene).centred

    def engine(
        self,
        context: Context,
        scene: Scene,
        sensor: Sensor,
        window: Window,
        timings: bool,
        device: DeviceScene | None = None,
    ) -> WhittedTracer:
        from glpath.integrators.whitted import WhittedTracer  # late, because numba is slow to import

        return WhittedTracer(
            context.gl,
            DeviceScene(context.gl, scene.still(), self.settings.stream_budget),
            self.settings,
            window,
            moving=scene if scene.moving_shapes else None,
            timings=timings,
        )

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        from glpath.integrators.whitted import WhittedTracer

        assert isinstance(engine, WhittedTracer), f"an engine of another plan: {engine!r}"
        engine.change_scene(scene)


#: Plan class of each integrator by name.
PLANS: Mapping[str, Callable[[Any], Plan]] = {
    "path": _Paths,
    "path-buffer": _PathBuffer,
    "gather": _Gathering,
    "classic": _Whitted,
    "t-buffer": _Whitted,
}
