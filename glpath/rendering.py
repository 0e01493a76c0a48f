"""One render: a scene, an engine and a film, from the first path set to the last.

(`rendering`, not `render`: a module of that name would take the place of the function `glpath.render`.)
"""

from __future__ import annotations

import math
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.buffers.path_buffer import MAX_PATHS
from glpath.errors import SceneWarning, UsageError
from glpath.film import BLOCK, Film, FilmMetadata, blocks
from glpath.gl.context import Context, get_context
from glpath.gl.gpu_scene import GpuScene
from glpath.integrators.path_trace import Directions, PathTracer, PathTraceSettings
from glpath.sampling import Sampling
from glpath.scene import Scene, check_camera, check_scene, load_scene, path_traceable
from glpath.versions import versions

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


def render(
    scene: str | Path | Scene,
    *,
    spp: int = 256,
    first_path_set: int = 0,
    max_depth: int = 5,
    seed: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | None = None,
    parameters: Mapping[str, object] | None = None,
    sampling: Sampling = "sobol",
    directions: Directions = "pair",
    ambient: float | Sequence[float] = 0.0,
    roulette: int | None = None,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> Film:
    """Render a scene by path tracing with the path-buffer.

    Parameters
    ----------
    scene          : a file, the name of a shipped scene, or a `Scene`
    spp            : path sets, that is paths per pixel
    first_path_set : number of the first one; a render of 32 from 32 on merges with one of 32 from 0 on, and is then
                     bit for bit the render of 64
    max_depth      : vertices of a path: 1 is direct light only, 3 two bounces
    seed           : another seed is another, independent render
    resolution     : (width, height) in pixels instead of the scene's
    crop           : (x, y, width, height): only these pixels of the whole picture, y from the top
    camera         : what to replace of the camera: position, target, up, fov (vertical, degrees)
    parameters     : of a generated scene
    sampling       : "sobol", or "random" as in the paper
    directions     : "pair", each path the better of two; "hemisphere", one, quicker for meshes of very many
                     triangles; "sphere", as in the paper
    ambient        : radiance, W sr^-1 m^-2, assumed beyond the last vertex; a number or (r, g, b)
    roulette       : from this vertex on, paths end by chance, without bias
    backend, device, require_gpu : see `glpath.gl.context.get_context`
    timings        : time each stage (`film.metadata.statistics["stage_ms"]`); slows the render down
    on_progress    : called about twice a second

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered
    RenderInterrupted : on Ctrl-C, with the film so far

    Warns `SceneWarning` for a scene that can be rendered, but hardly as it is meant.

    Poor at: mirrors and caustics (all paths share their directions).

    Example
    -------
    >>> film = glpath.render("cornell-box", spp=64)  # doctest: +SKIP
    >>> film.save("cornell-box.png")  # doctest: +SKIP
    """
    _check_options(spp, first_path_set, max_depth, seed, sampling, directions, roulette)
    loaded = _with_overrides(load_scene(scene, parameters), resolution, camera)
    window = _window(loaded, crop)
    for text in check_scene(loaded):
        warnings.warn(text, SceneWarning, stacklevel=2)
    settings = PathTraceSettings(
        max_depth=max_depth,
        seed=seed,
        sampling=sampling,
        directions=directions,
        ambient=_colour(ambient),
        roulette=roulette,
    )
    context = get_context(backend, device, require_gpu)
    film = Film.empty(_metadata(loaded, settings, window, context))
    job = _Job(film, spp, context.info.renderer, on_progress)
    job.report("compiling shaders")
    gpu_scene = GpuScene(context.gl, path_traceable(loaded))
    tiles = _tiles(window, context.gl.info["GL_MAX_TEXTURE_SIZE"])
    tracer = PathTracer(
        context.gl, gpu_scene, settings, tiles[0].window, hardware=context.info.hardware, timings=timings
    )
    with _interrupt_as_flag() as interrupted:
        try:
            for start, stop in blocks(first_path_set, first_path_set + spp):
                while start < stop and not interrupted:
                    count = _step(tracer, tiles, film, start, min(stop - start, job.step), interrupted)
                    start += count
                    job.stepped(count)
                if interrupted:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            # The flag's, or a second Ctrl-C that broke into a step: the film holds the steps before it.
            raise RenderInterrupted(job.finish(tracer)) from None
    job.finish(tracer)
    _warn_of_crowding(film)
    return film


# From this share of lost rays on, the picture is noisier than its path sets let expect.
_CROWDED = 0.25


def _warn_of_crowding(film: Film) -> None:
    statistics = film.metadata.statistics
    share = statistics["paths_lost"] / max(1, statistics["paths_cast"])
    if share > _CROWDED:
        warnings.warn(
            f"{film.metadata.scene}: {share:.0%} of the rays lost the roulette of their cell; the picture is right "
            "on average, but noisy. Far surfaces stretch the view until the paths crowd: make the ground smaller, "
            "or render more path sets.",
            SceneWarning,
            stacklevel=3,
        )


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

    def finish(self, tracer: PathTracer) -> Film:
        """The film with its statistics, which are known only now."""
        elapsed = time.perf_counter() - self.started
        self.film.metadata = replace(self.film.metadata, elapsed_s=elapsed, statistics=tracer.statistics())
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


def _step(tracer: PathTracer, tiles: list[_Tile], film: Film, start: int, count: int, interrupted: _Flag) -> int:
    """Trace path sets start..start + count in every tile and add them to the film. Returns how many it were.

    When interrupted in the first tile, the others follow as far as that one came.
    """
    total = np.zeros(film.radiance_sums.shape[1:])
    for tile in tiles:
        tracer.look_at(tile.window)
        traced = 0
        while traced < count:
            tracer.trace_path_set(start + traced)
            traced += 1
            if interrupted and tile is tiles[0]:
                break
        count = traced
        total[tile.place] = tracer.take()[tile.keep]
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


def _check_options(
    spp: int, first: int, max_depth: int, seed: int, sampling: str, directions: str, roulette: int | None
) -> None:
    for name, value, least, most in (
        # A Sobol sequence of 30 bits ends at 2**30.
        ("spp", spp, 1, 2**29 - 256),
        ("first_path_set", first, 0, 2**29),
        ("max_depth", max_depth, 1, DEEPEST),
        ("seed", seed, 0, 2**63),
        ("roulette", 1 if roulette is None else roulette, 1, DEEPEST),
    ):
        if not isinstance(value, int | np.integer) or not least <= value <= most:
            raise UsageError(f"{name}: {value!r} where a whole number from {least} to {most} is needed")
    for name, word, allowed in (
        ("sampling", sampling, get_args(Sampling)),
        ("directions", directions, get_args(Directions)),
    ):
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
    scene: Scene, settings: PathTraceSettings, window: tuple[int, int, int, int], context: Context
) -> FilmMetadata:
    others: dict[str, Any] = settings.as_dict()
    return FilmMetadata(
        scene=scene.name,
        scene_hash=scene.digest(),
        integrator="path",
        seed=int(others.pop("seed")),
        max_depth=int(others.pop("max_depth")),
        settings=others,
        full_resolution=scene.camera.resolution,
        window=window,
        device=context.info.renderer,
        versions=versions("glpath", "moderngl", "numpy", "scipy") | {"driver": context.info.driver},
    )
