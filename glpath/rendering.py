"""One render: a scene, an engine and a film, from the first path set to the last.

(`rendering`, not `render`: a module of that name would take the place of the function `glpath.render`.)
"""

from __future__ import annotations

import math
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.buffers.path_buffer import MAX_PATHS
from glpath.buffers.shadow_buffer import MAX_TAPS, ShadowTest
from glpath.errors import SceneWarning, UsageError
from glpath.film import BLOCK, Film, FilmMetadata, blocks
from glpath.gl.context import Context, get_context
from glpath.gl.gpu_objects import GpuObjects
from glpath.gl.gpu_scene import GpuScene
from glpath.integrators.path_stages import Directions
from glpath.integrators.path_trace import PathTracer, PathTraceSettings
from glpath.integrators.whitted import Secondary, Shadows, WhittedSettings, WhittedTracer
from glpath.sampling import Sampling
from glpath.scene import Camera, Scene, check_camera, check_scene, load_scene, path_traceable
from glpath.versions import versions

Integrator = Literal["path", "classic", "t-buffer"]

#: Path sets where it is not said how many. A ray tracer's differ only in their place in the pixel.
DEFAULT_SPP: dict[str, int] = {"path": 256, "classic": 16, "t-buffer": 16}

#: A path counts its casts in ten bits.
DEEPEST = 1000

# How long one step may take: Ctrl-C and the progress wait for its end.
_STEP_SECONDS = 0.5


@dataclass(frozen=True)
class Progress:
    """How far a render is; what `on_progress` is called with.

    done, total : path sets
    error       : estimate of the relative error so far (see `Film.relative_error`), None while it can't be known
    film        : what there is; it grows, so copy what is to be kept
    stage       : "compiling shaders" or "rendering"
    renderer    : name of the device
    """

    done: int
    total: int
    elapsed_s: float
    error: float | None
    film: Film
    stage: str
    renderer: str


class RenderInterrupted(KeyboardInterrupt):
    """Ctrl-C came during a render. `film` holds all whole path sets done until then."""

    def __init__(self, film: Film) -> None:
        super().__init__(f"interrupted after {film.path_sets} path sets")
        self.film = film


class Engine(Protocol):
    """What a render asks of an integrator. A window is (x, y, width, height) in pixels, y from the top."""

    def look_at(self, window: tuple[int, int, int, int]) -> None:
        """Go on with another window of the same size."""

    def trace_path_set(self, index: int) -> None:
        """Add one sample to every pixel; which, the index says alone."""

    def take(self) -> NDArray[np.float64]:
        """The sum (h, w, 3) since the last call, row 0 at the top, in multiples of one power of two."""

    def statistics(self) -> dict[str, object]:
        """What was counted so far."""


def render(
    scene: str | Path | Scene,
    *,
    integrator: Integrator = "path",
    spp: int | None = None,
    first_path_set: int = 0,
    max_depth: int = 5,
    seed: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | None = None,
    parameters: Mapping[str, object] | None = None,
    sampling: Sampling | None = None,
    directions: Directions | None = None,
    ambient: float | Sequence[float] | None = None,
    roulette: int | None = None,
    shadows: Shadows | None = None,
    shadow_resolution: int | None = None,
    shadow_test: ShadowTest | None = None,
    shadow_filter: int | None = None,
    secondary: Secondary | None = None,
    count_tests: bool = False,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> Film:
    """Render a scene: by path tracing with the path-buffer, or by ray tracing with lights without extent.

    Parameters
    ----------
    scene          : a file, the name of a shipped scene, or a `Scene`
    integrator     : "path", global illumination by shapes that emit light; "t-buffer", Whitted's ray tracing with
                     the T-buffer, for spheres, planes, point lights, textures and mirrors; "classic", the same
                     picture by the classical algorithm, every ray against every object
    spp            : path sets, that is samples per pixel; by default 256, and 16 of a ray tracer, whose samples
                     differ only in their place in the pixel: a single one goes through its centre
    first_path_set : number of the first one; a render of 32 from 32 on merges with one of 32 from 0 on, and is then
                     bit for bit the render of 64
    max_depth      : vertices of a path: 1 is direct light only, 3 two bounces (of a ray tracer: reflections)
    seed           : another seed is another, independent render
    resolution     : (width, height) in pixels instead of the scene's
    crop           : (x, y, width, height): only these pixels of the whole picture, y from the top
    camera         : what to replace of the camera: position, target, up, fov (vertical, degrees)
    parameters     : of a generated scene
    backend, device, require_gpu : see `glpath.gl.context.get_context`
    timings        : time each stage (`film.metadata.statistics["stage_ms"]`); slows the render down
    on_progress    : called about twice a second

    Of "path" only:

    sampling       : "sobol", or "random" as in the paper
    directions     : "pair", each path the better of two; "hemisphere", one, quicker for meshes of very many
                     triangles; "sphere", as in the paper
    ambient        : radiance, W sr^-1 m^-2, assumed beyond the last vertex; a number or (r, g, b)
    roulette       : from this vertex on, paths end by chance, without bias

    Of "t-buffer" and "classic" only:

    shadows        : "rays", exact; "sphere" or "cube", looked up in shadow-buffers, of the paper or on six faces
    shadow_resolution : of these: rows of a sphere's (twice as many columns), texels along a cube's side; 1024
    shadow_test    : "distance", or "identity" as in the paper, wrong where an object shadows itself shadow_filter
    : cells across that a lookup asks, for smooth edges; 2, and 1 for the nearest alone, as in the paper secondary
    : reflections and shadow rays: by a "hierarchy" of boxes (of "t-buffer"), or every object in turn,
                     "classic", as in the paper (of "classic")
    count_tests    : count intersection tests (`film.metadata.statistics["intersection_tests"]`); slower

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered
    RenderInterrupted : on Ctrl-C, with the film so far

    Warns `SceneWarning` for a scene that can be rendered, but hardly as it is meant.

    Poor at: mirrors and caustics by "path" (all paths share their directions); indirect light by the others.

    Example
    -------
    >>> film = glpath.render("cornell-box", spp=64)  # doctest: +SKIP
    >>> film.save("cornell-box.png")  # doctest: +SKIP
    """
    of_path = {"sampling": sampling, "directions": directions, "ambient": ambient, "roulette": roulette}
    of_rays = {
        "shadows": shadows,
        "shadow_resolution": shadow_resolution,
        "shadow_test": shadow_test,
        "shadow_filter": shadow_filter,
        "secondary": secondary,
        "count_tests": count_tests or None,
    }
    plan = _plan(integrator, max_depth, seed, of_path, of_rays)
    spp = DEFAULT_SPP[integrator] if spp is None else spp
    _check_count("spp", spp, 1, 2**29 - 256)  # a Sobol sequence of 30 bits ends at 2**30
    _check_count("first_path_set", first_path_set, 0, 2**29)
    loaded = _with_overrides(load_scene(scene, parameters), resolution, camera)
    window = _window(loaded, crop)
    for text in check_scene(loaded) + plan.warnings(loaded):
        warnings.warn(text, SceneWarning, stacklevel=2)
    traced = plan.traceable(loaded)
    context = get_context(backend, device, require_gpu)
    film = Film.empty(_metadata(loaded, integrator, plan.settings, window, context))
    job = _Job(film, spp, context.info.renderer, on_progress)
    job.report("compiling shaders")
    tiles = _tiles(window, context.gl.info["GL_MAX_TEXTURE_SIZE"])
    engine = plan.engine(context, traced, tiles[0].window, timings)
    _trace(engine, tiles, job, first_path_set)
    for text in plan.remarks(film):
        warnings.warn(text, SceneWarning, stacklevel=2)
    return film


def render_frames(
    scene: str | Path | Scene,
    frames: Iterable[Mapping[str, Any] | Camera | Scene],
    *,
    integrator: Literal["classic", "t-buffer"] = "t-buffer",
    spp: int | None = None,
    max_depth: int = 5,
    seed: int = 0,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    shadows: Shadows | None = None,
    shadow_resolution: int | None = None,
    shadow_test: ShadowTest | None = None,
    shadow_filter: int | None = None,
    secondary: Secondary | None = None,
    count_tests: bool = False,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
) -> Iterator[Film]:
    """Render a film of films: one scene from several cameras, or as its lights and objects move.

    Shaders, objects and shadow-buffers stay on the device from frame to frame; a shadow-buffer is filled again only
    where its light or an object has moved [TB III.D].

    frames : of each, what to replace of the scene's camera, as a mapping as in `render` or a `Camera`; or a whole
             `Scene` with a camera of its own. All have the resolution of the first

    The other parameters are those of `render`. Yields a `Film` a frame, with its own time and counts.

    Raises what `render` raises.
    """
    of_rays = {
        "shadows": shadows,
        "shadow_resolution": shadow_resolution,
        "shadow_test": shadow_test,
        "shadow_filter": shadow_filter,
        "secondary": secondary,
        "count_tests": count_tests or None,
    }
    _check_word("integrator", integrator, ("classic", "t-buffer"))
    plan = _plan(integrator, max_depth, seed, {}, of_rays)
    assert isinstance(plan, _Whitted), "the path tracer was refused"
    spp = DEFAULT_SPP[integrator] if spp is None else spp
    _check_count("spp", spp, 1, 2**29 - 256)
    base = _with_overrides(load_scene(scene, parameters), resolution, None)
    context = get_context(backend, device, require_gpu)
    engine: WhittedTracer | None = None
    for frame in frames:
        started = time.perf_counter()
        shown = _frame_scene(base, frame)
        window = _window(shown, None)
        tiles = _tiles(window, context.gl.info["GL_MAX_TEXTURE_SIZE"])
        if engine is None:
            for text in check_scene(shown) + plan.warnings(shown):
                warnings.warn(text, SceneWarning, stacklevel=2)
            engine = plan.engine(context, shown, tiles[0].window, timings)
        elif shown.camera.resolution != engine.camera.resolution:
            raise UsageError(
                f"render_frames: a frame of {shown.camera.resolution} pixels after {engine.camera.resolution}",
                "All frames have one resolution.",
            )
        elif isinstance(frame, Scene):
            engine.change_scene(shown)
        else:
            engine.move_camera(shown.camera)
        engine.forget_statistics()
        film = Film.empty(_metadata(shown, integrator, plan.settings, window, context))
        job = _Job(film, spp, context.info.renderer, None, started=started)
        _trace(engine, tiles, job, 0)
        yield film


def _frame_scene(base: Scene, frame: Mapping[str, Any] | Camera | Scene) -> Scene:
    if isinstance(frame, Scene):
        return frame
    if isinstance(frame, Camera):
        check_camera(frame, base.source or base.name)
        return replace(base, camera=frame)
    return _with_overrides(base, None, frame)


def _trace(engine: Engine, tiles: list[_Tile], job: _Job, first: int) -> None:
    """Fill the job's film with its path sets, in steps. Raises RenderInterrupted."""
    film = job.film
    with _interrupt_as_flag() as interrupted:
        try:
            for start, stop in blocks(first, first + job.total):
                while start < stop and not interrupted:
                    count = _step(engine, tiles, film, start, min(stop - start, job.step), interrupted)
                    start += count
                    job.stepped(count)
                if interrupted:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            # The flag's, or a second Ctrl-C that broke into a step: the film holds the steps before it.
            raise RenderInterrupted(job.finish(engine)) from None
    job.finish(engine)


@dataclass(frozen=True)
class _PathTracing:
    """What is particular to the path tracer."""

    settings: PathTraceSettings

    def warnings(self, scene: Scene) -> list[str]:
        return []

    def traceable(self, scene: Scene) -> Scene:
        return path_traceable(scene)

    def engine(
        self, context: Context, scene: Scene, window: tuple[int, int, int, int], timings: bool
    ) -> PathTracer:
        gpu_scene = GpuScene(context.gl, scene)
        return PathTracer(
            context.gl, gpu_scene, self.settings, window, hardware=context.info.hardware, timings=timings
        )

    def remarks(self, film: Film) -> list[str]:
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

    def engine(
        self, context: Context, scene: Scene, window: tuple[int, int, int, int], timings: bool
    ) -> WhittedTracer:
        return WhittedTracer(
            context.gl,
            GpuObjects(context.gl, scene),
            self.settings,
            window,
            hardware=context.info.hardware,
            timings=timings,
            count_tests=self.count_tests,
        )

    def remarks(self, film: Film) -> list[str]:
        return []


def _plan(
    integrator: str, max_depth: int, seed: int, of_path: Mapping[str, Any], of_rays: Mapping[str, Any]
) -> _PathTracing | _Whitted:
    """The engine's settings. of_path, of_rays: options of one kind of engine, None where not given."""
    _check_word("integrator", integrator, get_args(Integrator))
    _check_count("max_depth", max_depth, 1, DEEPEST)
    _check_count("seed", seed, 0, 2**63)
    by_path = integrator == "path"
    for name, value in (of_rays if by_path else of_path).items():
        if value is not None:
            raise UsageError(
                f'{name}: {value!r} with the integrator "{integrator}"; it is an option of '
                + ('"classic" and "t-buffer"' if by_path else '"path"')
            )
    given = {name: value for name, value in (of_path if by_path else of_rays).items() if value is not None}
    if by_path:
        _check_word("sampling", given.get("sampling", "sobol"), get_args(Sampling))
        _check_word("directions", given.get("directions", "pair"), get_args(Directions))
        if "roulette" in given:
            _check_count("roulette", given["roulette"], 1, DEEPEST)
        if "ambient" in given:
            given["ambient"] = _colour(given["ambient"])
        return _PathTracing(PathTraceSettings(max_depth=max_depth, seed=seed, **given))
    count_tests = given.pop("count_tests", False)
    _check_word("shadows", given.get("shadows", "rays"), get_args(Shadows))
    _check_word("secondary", given.get("secondary", "classic"), get_args(Secondary))
    _check_word("shadow_test", given.get("shadow_test", "distance"), get_args(ShadowTest))
    for name, most in (("shadow_resolution", 1 << 15), ("shadow_filter", MAX_TAPS)):
        if name in given:
            _check_count(name, given[name], 1, most)
    if given.get("shadows", "rays") == "rays":
        for name in ("shadow_resolution", "shadow_test", "shadow_filter"):
            if name in given:
                raise UsageError(
                    f"{name}: {given[name]!r} with shadow rays; it is an option of shadow-buffers",
                    'Take shadows "sphere" or "cube".',
                )
    given.setdefault("secondary", "hierarchy" if integrator == "t-buffer" else "classic")
    primary: Any = integrator
    return _Whitted(WhittedSettings(max_depth=max_depth, seed=seed, primary=primary, **given), count_tests)


# From this share of lost rays on, the picture is noisier than its path sets let expect.
_CROWDED = 0.25


@dataclass
class _Job:
    """The clock of one render: how long a step may be, and when to report."""

    film: Film
    total: int
    renderer: str
    on_progress: Callable[[Progress], None] | None
    step: int = 1
    started: float = field(default_factory=time.perf_counter)
    _last_step: float = field(default_factory=time.perf_counter)
    _last_report: float = -math.inf
    _error: float | None = None

    def report(self, stage: str) -> None:
        if self.on_progress is None:
            return
        done, now = self.film.path_sets, time.perf_counter()
        last = done == self.total
        if not last and now - self._last_report < _STEP_SECONDS:
            return
        if done:
            self._error = self.film.relative_error()
        # The estimate reads the whole film; that must not be what the time goes into.
        self._last_report = now + 5 * (time.perf_counter() - now)
        self.on_progress(
            Progress(done, self.total, now - self.started, self._error, self.film, stage, self.renderer)
        )

    def stepped(self, count: int) -> None:
        """A step of so many path sets is done; the next is as long as fits into the time for one."""
        now = time.perf_counter()
        each = (now - self._last_step) / count
        self.step = max(1, min(BLOCK, int(_STEP_SECONDS / max(each, 1e-9))))
        self._last_step = now
        self.report("rendering")

    def finish(self, engine: Engine) -> Film:
        """The film with its statistics, which are known only now."""
        elapsed = time.perf_counter() - self.started
        self.film.metadata = replace(self.film.metadata, elapsed_s=elapsed, statistics=engine.statistics())
        return self.film


@dataclass(frozen=True)
class _Tile:
    """A part of the picture that is traced at once.

    window : (x, y, width, height) of what is traced, pixels of the whole picture; every tile has the same size
    keep   : rows and columns of it that belong to the film, and where in the film
    """

    window: tuple[int, int, int, int]
    keep: tuple[slice, slice]
    place: tuple[slice, slice]


def _tiles(window: tuple[int, int, int, int], limit: int) -> list[_Tile]:
    """Tiles of one size that cover the window; the last of a row or column overlaps the one before."""
    x0, y0, width, height = window
    side = min(limit, math.isqrt(MAX_PATHS))
    # A flat picture may be as wide as the device allows.
    across = -(-width // side) if height > side else -(-width // min(limit, MAX_PATHS // height))
    w = -(-width // across)
    down = -(-height // min(limit, MAX_PATHS // w))
    h = -(-height // down)
    tiles = []
    for i in range(down):
        for j in range(across):
            x, y = min(j * w, width - w), min(i * h, height - h)
            # Columns x..j * w were the neighbour's.
            keep = slice(i * h - y, h), slice(j * w - x, w)
            place = slice(i * h, y + h), slice(j * w, x + w)
            tiles.append(_Tile((x0 + x, y0 + y, w, h), keep, place))
    return tiles


def _step(engine: Engine, tiles: list[_Tile], film: Film, start: int, count: int, interrupted: _Flag) -> int:
    """Trace path sets start..start + count in every tile and add them to the film. Returns how many it were.

    When interrupted in the first tile, the others follow as far as that one came.
    """
    total = np.zeros(film.radiance_sums.shape[1:])
    for tile in tiles:
        engine.look_at(tile.window)
        traced = 0
        while traced < count:
            engine.trace_path_set(start + traced)
            traced += 1
            if interrupted and tile is tiles[0]:
                break
        count = traced
        total[tile.place] = engine.take()[tile.keep]
    film.add(start, start + count, total)
    return count


class _Flag:
    """Truth that a signal handler can set."""

    def __init__(self) -> None:
        self.set = False

    def __bool__(self) -> bool:
        return self.set


@contextmanager
def _interrupt_as_flag() -> Iterator[_Flag]:
    """Ctrl-C sets a flag instead of breaking into the middle of a path set; a second one breaks in.

    The same holds for SIGTERM where somebody handles it in Python, as the command line does; a shell starts
    background jobs with SIGINT ignored, so neither stands for the other. Only the main thread gets signals,
    elsewhere this does nothing.
    """
    flag = _Flag()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    if threading.current_thread() is not threading.main_thread():
        before = {}

    def stop(number: int, frame: FrameType | None) -> None:
        earlier = before[signal.Signals(number)]
        if flag and callable(earlier):
            earlier(number, frame)
        flag.set = True

    handled = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handled:
        signal.signal(number, stop)
    try:
        yield flag
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)


def _check_count(name: str, value: object, least: int, most: int) -> None:
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not least <= value <= most:
        raise UsageError(f"{name}: {value!r} where a whole number from {least} to {most} is needed")


def _check_word(name: str, word: object, allowed: Sequence[str]) -> None:
    if word not in allowed:
        raise UsageError(f"{name}: {word!r}; allowed are {', '.join(allowed)}")


def _colour(value: float | Sequence[float]) -> tuple[float, float, float]:
    r, g, b = _numbers("ambient", [value] * 3 if isinstance(value, int | float) else value, 3)
    if min(r, g, b) < 0:
        raise UsageError(f"ambient: {value!r} where radiance, one or three numbers >= 0, is needed")
    return float(r), float(g), float(b)


def _numbers(name: str, value: Any, count: int) -> NDArray[np.float64]:
    """So many finite numbers, or a UsageError that names the argument."""
    try:
        numbers = np.atleast_1d(np.asarray(value, np.float64))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.all(np.isfinite(numbers)) or isinstance(value, str):
        needed = "a finite number is" if count == 1 else f"{count} finite numbers are"
        raise UsageError(f"{name}: {value!r} where {needed} needed")
    return numbers


def _whole_numbers(name: str, value: Any, count: int) -> list[int]:
    numbers = _numbers(name, value, count)
    if np.any(numbers != np.floor(numbers)):
        raise UsageError(f"{name}: {value!r} where {count} whole numbers of pixels are needed")
    return [int(n) for n in numbers]


def _with_overrides(scene: Scene, resolution: tuple[int, int] | None, camera: Mapping[str, Any] | None) -> Scene:
    changes: dict[str, Any] = {}
    for name, value in (camera or {}).items():
        if name not in ("position", "target", "up", "fov"):
            raise UsageError(f"camera: no field is named {name!r}; allowed are position, target, up, fov")
        numbers = _numbers(f"camera {name}", value, 1 if name == "fov" else 3)
        changes[name] = float(numbers[0]) if name == "fov" else numbers
    if resolution is not None:
        width, height = _whole_numbers("resolution", resolution, 2)
        changes["resolution"] = (width, height)
    if not changes:
        return scene
    changed = scene.with_camera(**changes)
    check_camera(changed.camera, scene.source or scene.name)
    return changed


def _window(scene: Scene, crop: tuple[int, int, int, int] | None) -> tuple[int, int, int, int]:
    width, height = scene.camera.resolution
    if crop is None:
        return 0, 0, width, height
    x, y, w, h = _whole_numbers("crop", crop, 4)
    if w < 1 or h < 1 or x < 0 or y < 0 or x + w > width or y + h > height:
        raise UsageError(
            f"crop: {w} x {h} pixels from ({x}, {y}) of a picture of {width} x {height}",
            "The crop is x, y, width, height in pixels, from the top left, and lies inside the picture.",
        )
    return x, y, w, h


def _metadata(
    scene: Scene,
    integrator: str,
    settings: PathTraceSettings | WhittedSettings,
    window: tuple[int, int, int, int],
    context: Context,
) -> FilmMetadata:
    others: dict[str, Any] = settings.as_dict()
    return FilmMetadata(
        scene=scene.name,
        scene_hash=scene.digest(),
        integrator=integrator,
        seed=int(others.pop("seed")),
        max_depth=int(others.pop("max_depth")),
        settings=others,
        full_resolution=scene.camera.resolution,
        window=window,
        device=context.info.renderer,
        versions=versions("glpath", "moderngl", "numpy", "scipy") | {"driver": context.info.driver},
    )
