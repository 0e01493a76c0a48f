"""What a render is asked for: the options of each integrator, checked, and the engine that they make.

Everything that can be wrong with the options is found here, before a context is made or a shader compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.buffers.shadow_buffer import MAX_TAPS, ShadowTest
from glpath.errors import SceneError, UsageError
from glpath.film import Film
from glpath.gl.context import Context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.gather import GatherSettings, GatherTracer, Lookup, device_radiosity, solution_digest
from glpath.integrators.path_stages import Directions, PathSetSettings, PathStages
from glpath.integrators.path_trace import PathTracer, PathTraceSettings
from glpath.integrators.whitted import Secondary, Shadows, WhittedSettings, WhittedTracer
from glpath.rendering.options import Window, check_count, check_word, colour
from glpath.sampling import Sampling
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Camera

if TYPE_CHECKING:
    from glpath.radiosity.solution import RadiositySolution

Integrator = Literal["path", "gather", "classic", "t-buffer"]
Say = Callable[[str], None]

#: Path sets where it is not said how many. A ray tracer's differ only in their place in the pixel.
DEFAULT_SPP: dict[str, int] = {"path": 256, "gather": 256, "classic": 16, "t-buffer": 16}

#: Vertices of a path where it is not said how many. A gather's end at the radiosity solution.
DEFAULT_DEPTH: dict[str, int] = {"path": 5, "gather": 2, "classic": 5, "t-buffer": 5}

#: A path counts its casts in ten bits.
DEEPEST = 1000

_RAYS = ("shadows", "shadow_resolution", "shadow_test", "shadow_filter", "secondary", "count_tests")
# Which options an integrator has, besides those that all have.
_OPTIONS: dict[str, tuple[str, ...]] = {
    "path": ("sampling", "directions", "ambient", "roulette"),
    "gather": ("sampling", "directions", "radiosity", "radiosity_lookup"),
    "classic": _RAYS,
    "t-buffer": _RAYS,
}

# From this share of lost rays on, the picture is noisier than its path sets let expect.
_CROWDED = 0.25

# Each triangle is a patch at least. With so many, particles are sooner done than patches have shot.
_MANY_PATCHES = 4000


class Engine(Protocol):
    """What a render asks of an integrator. A window is (x, y, width, height) in pixels, y from the top."""

    def look_at(self, window: Window) -> None:
        """Go on with another window of the same size."""

    def trace_path_set(self, index: int) -> None:
        """Add one sample to every pixel; which, the index says alone."""

    def take(self) -> NDArray[np.float64]:
        """The sum (h, w, 3) since the last call, row 0 at the top, in multiples of one power of two."""

    def statistics(self) -> dict[str, object]:
        """What was counted so far."""

    def forget_statistics(self) -> None:
        """Begin to count anew."""

    def move_camera(self, camera: Camera) -> None:
        """Go on with another camera of the same resolution."""


class Plan(Protocol):
    """An integrator with its options, for any scene."""

    @property
    def settings(self) -> PathSetSettings | WhittedSettings:
        """What decides the picture besides the scene."""

    def warnings(self, scene: Scene) -> list[str]:
        """What a scene has that this integrator hardly renders as it is meant."""

    def traceable(self, scene: Scene) -> Scene:
        """The scene as the engine knows it. Raises SceneError for what it does not know."""

    def prepared(self, scene: Scene, say: Say) -> Plan:
        """The plan with all that takes the traceable scene and no context: a radiosity solution.

        say : called now and then with what is done
        """

    def engine(self, context: Context, scene: Scene, window: Window, timings: bool) -> Engine:
        """The engine for a traceable scene; the plan is prepared."""

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        """Go on with another scene, traceable and with a camera of its own. Raises SceneError."""

    def remarks(self, film: Film) -> list[str]:
        """What is to be said of a film that is done."""


def plan(integrator: str, max_depth: int | None, seed: int, options: Mapping[str, Any]) -> Plan:
    """The plan of a render.

    options : of all integrators, None where not given

    Raises UsageError for what is out of range, and for options that another integrator has.
    """
    check_word("integrator", integrator, get_args(Integrator))
    least = 2 if integrator == "gather" else 1
    depth = DEFAULT_DEPTH[integrator] if max_depth is None else max_depth
    check_count("max_depth", depth, least, DEEPEST)
    check_count("seed", seed, 0, 2**63)
    given = {name: value for name, value in options.items() if value is not None}
    for name, value in given.items():
        if name not in _OPTIONS[integrator]:
            owners = " and ".join(f'"{other}"' for other, names in _OPTIONS.items() if name in names) or "none"
            found = str(value) if isinstance(value, Path) else repr(value)
            raise UsageError(f'{name}: {found} with the integrator "{integrator}"; it is an option of {owners}')
    if integrator in ("path", "gather"):
        check_word("sampling", given.get("sampling", "sobol"), get_args(Sampling))
        check_word("directions", given.get("directions", "pair"), get_args(Directions))
    if integrator == "path":
        return _path_tracing(depth, seed, given)
    if integrator == "gather":
        return _gathering(depth, seed, given)
    return _whitted(integrator, depth, seed, given)


@dataclass(frozen=True)
class _PathTracing:
    """What is particular to the path tracer."""

    settings: PathTraceSettings

    def warnings(self, scene: Scene) -> list[str]:
        return []

    def traceable(self, scene: Scene) -> Scene:
        return path_traceable(scene)

    def prepared(self, scene: Scene, say: Say) -> Plan:
        return self

    def engine(self, context: Context, scene: Scene, window: Window, timings: bool) -> PathTracer:
        device_scene = DeviceScene(context.gl, scene)
        return PathTracer(
            context.gl, device_scene, self.settings, window, hardware=context.info.hardware, timings=timings
        )

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        _move_camera(engine, scene)

    def remarks(self, film: Film) -> list[str]:
        return _crowding(film)


def _path_tracing(depth: int, seed: int, given: dict[str, Any]) -> _PathTracing:
    if "roulette" in given:
        check_count("roulette", given["roulette"], 1, DEEPEST)
    if "ambient" in given:
        given["ambient"] = colour(given["ambient"])
    return _PathTracing(PathTraceSettings(max_depth=depth, seed=seed, **given))


def _move_camera(engine: Engine, scene: Scene) -> None:
    """Go on with the camera of a scene that is otherwise the same."""
    assert isinstance(engine, PathStages), f"an engine of another plan: {engine!r}"
    if scene.digest(camera=False) != engine.scene.scene.digest(camera=False):
        raise SceneError(
            f"{scene.source or scene.name}: a frame differs from the first one in more than its camera.",
            'Only "t-buffer" and "classic" go on with another scene; with "path" and "gather", render it alone.',
        )
    engine.move_camera(scene.camera)


def _crowding(film: Film) -> list[str]:
    statistics = film.metadata.statistics
    share = statistics["paths_lost"] / max(1, statistics["paths_cast"])
    if share <= _CROWDED:
        return []
    return [
        f"{film.metadata.scene}: {share:.0%} of the rays lost the roulette of their cell; the picture is right "
        "on average, but noisy. Far surfaces stretch the view until the paths crowd: make the ground smaller, "
        "or render more path sets."
    ]


@dataclass(frozen=True)
class _Gathering:
    """What is particular to the gather from a radiosity solution.

    given    : the solution, its file, or None: the scene is solved when the plan is prepared
    solution : of the prepared plan
    """

    settings: GatherSettings
    lookup: Lookup
    given: RadiositySolution | Path | None
    solution: RadiositySolution | None = None

    def warnings(self, scene: Scene) -> list[str]:
        return []

    def traceable(self, scene: Scene) -> Scene:
        return path_traceable(scene)

    def prepared(self, scene: Scene, say: Say) -> Plan:
        # All of radiosity is slow to import.
        from glpath.radiosity.solution import RadiositySolution
        from glpath.radiosity.solve import Method, RadiosityProgress, solve_radiosity

        def report(progress: RadiosityProgress) -> None:
            unshot = "" if progress.unshot is None else f", {float(f'{100 * progress.unshot:.1g}'):g} % unshot"
            say(f"solving radiosity: {progress.stage}{unshot}")

        solution = self.given
        if solution is None:
            say("solving radiosity")
            method: Method = "monte-carlo" if len(scene.triangles) > _MANY_PATCHES else "progressive"
            solution = solve_radiosity(scene, method=method, on_progress=report)
        elif isinstance(solution, Path):
            solution = RadiositySolution.load(solution)
        solution.check_scene(scene)
        settings = replace(self.settings, radiosity=solution_digest(solution, self.lookup))
        return replace(self, settings=settings, solution=solution)

    def engine(self, context: Context, scene: Scene, window: Window, timings: bool) -> GatherTracer:
        assert self.solution is not None, "the plan is not prepared"
        return GatherTracer(
            context.gl,
            DeviceScene(context.gl, scene),
            device_radiosity(context.gl, scene, self.solution, self.lookup),
            self.settings,
            window,
            hardware=context.info.hardware,
            timings=timings,
        )

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        _move_camera(engine, scene)

    def remarks(self, film: Film) -> list[str]:
        return _crowding(film)


def _gathering(depth: int, seed: int, given: dict[str, Any]) -> _Gathering:
    lookup = given.pop("radiosity_lookup", "interpolated")
    check_word("radiosity_lookup", lookup, get_args(Lookup))
    radiosity = given.pop("radiosity", None)
    if isinstance(radiosity, str):
        radiosity = Path(radiosity)
    if radiosity is not None and not isinstance(radiosity, Path):
        from glpath.radiosity.solution import RadiositySolution

        if not isinstance(radiosity, RadiositySolution):
            raise UsageError(
                f"radiosity: {radiosity!r} where a RadiositySolution or the file of one is needed",
                "glpath.solve_radiosity makes one; without it, the scene is solved before it is rendered.",
            )
    return _Gathering(GatherSettings(max_depth=depth, seed=seed, **given), lookup, radiosity)


@dataclass(frozen=True)
class _Whitted:
    """What is particular to the ray tracers."""

    settings: WhittedSettings
    count_tests: bool

    def warnings(self, scene: Scene) -> list[str]:
        if scene.lights or np.any(scene.ambient > 0) or not any(shape.emits for shape in scene.shapes):
            return []
        return [
            "Only shapes with an emission give light here, and a ray tracer sees them but is not lit by them: "
            'add [[lights]] or ambient light, or take integrator = "path".'
        ]

    def traceable(self, scene: Scene) -> Scene:
        return scene

    def prepared(self, scene: Scene, say: Say) -> Plan:
        return self

    def engine(self, context: Context, scene: Scene, window: Window, timings: bool) -> WhittedTracer:
        return WhittedTracer(
            context.gl,
            DeviceScene(context.gl, scene),
            self.settings,
            window,
            hardware=context.info.hardware,
            timings=timings,
            count_tests=self.count_tests,
        )

    def change_scene(self, engine: Engine, scene: Scene) -> None:
        assert isinstance(engine, WhittedTracer), f"an engine of another plan: {engine!r}"
        engine.change_scene(scene)

    def remarks(self, film: Film) -> list[str]:
        return []


def _whitted(integrator: str, depth: int, seed: int, given: dict[str, Any]) -> _Whitted:
    count_tests = given.pop("count_tests", False)
    check_word("shadows", given.get("shadows", "rays"), get_args(Shadows))
    check_word("secondary", given.get("secondary", "classic"), get_args(Secondary))
    check_word("shadow_test", given.get("shadow_test", "distance"), get_args(ShadowTest))
    for name, most in (("shadow_resolution", 1 << 15), ("shadow_filter", MAX_TAPS)):
        if name in given:
            check_count(name, given[name], 1, most)
    if given.get("shadows", "rays") == "rays":
        for name in ("shadow_resolution", "shadow_test", "shadow_filter"):
            if name in given:
                raise UsageError(
                    f"{name}: {given[name]!r} with shadow rays; it is an option of shadow-buffers",
                    'Take shadows "sphere" or "cube".',
                )
    given.setdefault("secondary", "hierarchy" if integrator == "t-buffer" else "classic")
    primary: Any = integrator
    return _Whitted(WhittedSettings(max_depth=depth, seed=seed, primary=primary, **given), count_tests)
