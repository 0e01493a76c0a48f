"""`glpath render`: a picture.

Everything that can be wrong with the options, the scene and the outputs is found before the render begins.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

import typer

from glpath.errors import UsageError
from glpath.image import TONEMAPS, check_writable
from glpath.progress import MODES, duration, percent, reporting

if TYPE_CHECKING:
    from glpath.film import Film

INTEGRATORS = ("path", "gather", "t-buffer", "classic")
INTERRUPTED = 130

Vector = tuple[float, float, float]

# What rays are shot for, as `film.metadata.statistics` calls it.
_TESTS = {
    "primary": "from the eye",
    "shadow_buffer": "to fill shadow-buffers",
    "shadow": "shadow rays",
    "secondary": "reflections",
}

_PICTURE, _CAMERA, _SAMPLING, _MACHINE, _OUTPUT = "Picture", "Camera", "Sampling", "Machine", "What is printed"
_PATHS, _PATH = "Paths (--integrator path or gather)", "Path tracing (--integrator path)"
_GATHER, _RAYS = "Gather (--integrator gather)", "Ray tracing (--integrator t-buffer or classic)"


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(epilog="Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted (what there is, is written).")(
        render
    )


def render(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A TOML file or the name of a shipped scene.")],
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            help="Write .png, .exr (radiance) or .npz (the whole film); may be repeated.",
            rich_help_panel=_PICTURE,
        ),
    ],
    spp: Annotated[
        int | None,
        typer.Option(
            help="Path sets: samples per pixel; by default 256, of a ray tracer 16.",
            show_default=False,
            rich_help_panel=_SAMPLING,
        ),
    ] = None,
    max_depth: Annotated[
        int | None,
        typer.Option(
            help="1 is direct light only, 3 two bounces; by default 5. Of a gather, the vertex that looks up the "
            "solution; by default 2.",
            show_default=False,
            rich_help_panel=_SAMPLING,
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Another seed is an independent render.", rich_help_panel=_SAMPLING)
    ] = 0,
    resolution: Annotated[
        str | None, typer.Option(metavar="WxH", help="Instead of the scene's.", rich_help_panel=_PICTURE)
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="Only these pixels, from the top left.", rich_help_panel=_PICTURE),
    ] = None,
    exposure: Annotated[
        float, typer.Option(metavar="STOPS", help="Brightness of a .png: 1 doubles it.", rich_help_panel=_PICTURE)
    ] = 0.0,
    tonemap: Annotated[
        str, typer.Option(metavar="|".join(TONEMAPS), help="Tone curve of a .png.", rich_help_panel=_PICTURE)
    ] = "srgb",
    camera_position: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Where it stands.", rich_help_panel=_CAMERA)
    ] = None,
    camera_target: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="What it looks at.", rich_help_panel=_CAMERA)
    ] = None,
    camera_up: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="What is up in the picture.", rich_help_panel=_CAMERA)
    ] = None,
    camera_fov: Annotated[
        float | None, typer.Option(metavar="DEGREES", help="Vertical field of view.", rich_help_panel=_CAMERA)
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option(
            "-D",
            metavar="KEY=VALUE",
            help="A parameter of a generated scene; may be repeated.",
            rich_help_panel=_PICTURE,
        ),
    ] = None,
    integrator: Annotated[
        str,
        typer.Option(
            metavar="|".join(INTEGRATORS),
            help="Global illumination, by paths alone or from a radiosity solution; or ray tracing with point "
            "lights and mirrors, by T-buffer or ray by ray.",
            rich_help_panel=_SAMPLING,
        ),
    ] = "path",
    sampling: Annotated[
        str | None,
        typer.Option(
            metavar="sobol|random",
            help="Where random numbers come from; random is the paper's. [default: sobol]",
            rich_help_panel=_PATHS,
        ),
    ] = None,
    directions: Annotated[
        str | None,
        typer.Option(
            metavar="pair|hemisphere|sphere",
            help="The shared directions of a bounce; sphere is the paper's. [default: pair]",
            rich_help_panel=_PATHS,
        ),
    ] = None,
    ambient: Annotated[
        str | None,
        typer.Option(
            metavar="R,G,B",
            help="Radiance assumed beyond the last vertex; one number is grey. [default: 0]",
            rich_help_panel=_PATH,
        ),
    ] = None,
    roulette: Annotated[
        int | None,
        typer.Option(metavar="DEPTH", help="From here on paths end by chance.", rich_help_panel=_PATH),
    ] = None,
    radiosity: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A solution of `glpath radiosity`, of this scene. [default: the scene is solved first]",
            rich_help_panel=_GATHER,
        ),
    ] = None,
    radiosity_lookup: Annotated[
        str | None,
        typer.Option(
            metavar="interpolated|constant",
            help="Between an element's vertices, or one value for all of it. [default: interpolated]",
            rich_help_panel=_GATHER,
        ),
    ] = None,
    shadows: Annotated[
        str | None,
        typer.Option(
            metavar="rays|sphere|cube",
            help="Shadow rays, or shadow-buffers: the paper's, or of six faces. [default: rays]",
            rich_help_panel=_RAYS,
        ),
    ] = None,
    shadow_resolution: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Rows of a sphere's shadow-buffer, texels along a cube's side. [default: 1024]",
            rich_help_panel=_RAYS,
        ),
    ] = None,
    shadow_test: Annotated[
        str | None,
        typer.Option(
            metavar="distance|identity",
            help="A shadow-buffer's rule; identity is the paper's. [default: distance]",
            rich_help_panel=_RAYS,
        ),
    ] = None,
    shadow_filter: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Cells across that a lookup asks, for smooth edges; 1: no filter. [default: 2]",
            rich_help_panel=_RAYS,
        ),
    ] = None,
    secondary: Annotated[
        str | None,
        typer.Option(
            metavar="hierarchy|classic",
            help="Reflections and shadow rays by a hierarchy of boxes, or against every object. "
            "[default: hierarchy with t-buffer]",
            rich_help_panel=_RAYS,
        ),
    ] = None,
    count_tests: Annotated[
        bool,
        typer.Option("--count-tests", help="Count intersection tests; slower.", rich_help_panel=_RAYS),
    ] = False,
    backend: Annotated[
        str, typer.Option(metavar="auto|egl|osmesa", help="How OpenGL is reached.", rich_help_panel=_MACHINE)
    ] = "auto",
    device: Annotated[
        int | None,
        typer.Option(metavar="N", help="A device of `glpath devices`.", rich_help_panel=_MACHINE),
    ] = None,
    require_gpu: Annotated[
        bool, typer.Option("--require-gpu", help="Fail rather than render in software.", rich_help_panel=_MACHINE)
    ] = False,
    progress: Annotated[
        str, typer.Option(metavar="|".join(MODES), help="Progress on stderr.", rich_help_panel=_OUTPUT)
    ] = "auto",
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Only errors and warnings.", rich_help_panel=_OUTPUT)
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "-v", "--verbose", help="Also settings and time by stage, which costs some.", rich_help_panel=_OUTPUT
        ),
    ] = False,
) -> None:
    """Render a scene to one or more files.

    Ctrl-C, or SIGTERM as cluster schedulers send it, ends the render after the running path set and writes what
    there is. Files appear whole or not at all; missing folders are made.
    """
    from glpath import rendering
    from glpath.buffers.shadow_buffer import ShadowTest
    from glpath.film import check_suffix
    from glpath.integrators.gather import Lookup
    from glpath.integrators.path_stages import Directions
    from glpath.integrators.whitted import Secondary, Shadows
    from glpath.rendering.factory import DEFAULT_SPP, Integrator
    from glpath.sampling import Sampling
    from glpath.scene import load_scene, parameters_from_options

    if quiet and verbose:
        raise UsageError("-q and -v contradict each other.", "Give one of them.")
    for path in out:
        check_suffix(path)
    for option, found, allowed in (
        ("--tonemap", tonemap, tuple(TONEMAPS)),
        ("--integrator", integrator, INTEGRATORS),
        ("--sampling", sampling, get_args(Sampling)),
        ("--directions", directions, get_args(Directions)),
        ("--radiosity-lookup", radiosity_lookup, get_args(Lookup)),
        ("--shadows", shadows, get_args(Shadows)),
        ("--shadow-test", shadow_test, get_args(ShadowTest)),
        ("--secondary", secondary, get_args(Secondary)),
        ("--progress", progress, MODES),
    ):
        if found is not None:
            _check_choice(option, found, allowed)
    for option, count, least in (
        ("--spp", spp, 1),
        ("--max-depth", max_depth, 2 if integrator == "gather" else 1),
        ("--seed", seed, 0),
        ("--roulette", roulette, 1),
        ("--shadow-resolution", shadow_resolution, 1),
        ("--shadow-filter", shadow_filter, 1),
        ("--device", device, 0),
    ):
        if count is not None and count < least:
            raise UsageError(f"{option} {count}: must be at least {least}.")
    if not abs(exposure) <= 100:
        raise UsageError(f"--exposure {exposure}: must be a number of stops from -100 to 100.")
    camera: dict[str, Any] = {
        "position": _vector("--camera-position", camera_position),
        "target": _vector("--camera-target", camera_target),
        "up": _vector("--camera-up", camera_up),
        "fov": camera_fov,
    }
    ambient_rgb = None if ambient is None else _colour("--ambient", ambient)
    size = None if resolution is None else _resolution(resolution)
    window = None if crop is None else _crop(crop)

    loaded = load_scene(scene, parameters_from_options(parameters or []))
    if window is not None:
        _check_inside(window, size or loaded.camera.resolution)
    for path in out:
        check_writable(path)

    if quiet and progress == "auto":
        progress = "none"
    interrupted = False
    with sigterm_as_interrupt():
        try:
            with reporting(progress, sys.stderr) as report:
                film = rendering.render(
                    loaded,
                    integrator=cast("Integrator", integrator),
                    spp=spp,
                    max_depth=max_depth,
                    seed=seed,
                    resolution=size,
                    crop=window,
                    camera={key: value for key, value in camera.items() if value is not None} or None,
                    sampling=cast("Sampling | None", sampling),
                    directions=cast("Directions | None", directions),
                    ambient=ambient_rgb,
                    roulette=roulette,
                    radiosity=radiosity,
                    radiosity_lookup=cast("Lookup | None", radiosity_lookup),
                    shadows=cast("Shadows | None", shadows),
                    shadow_resolution=shadow_resolution,
                    shadow_test=cast("ShadowTest | None", shadow_test),
                    shadow_filter=shadow_filter,
                    secondary=cast("Secondary | None", secondary),
                    count_tests=count_tests,
                    backend=backend,
                    device=device,
                    require_gpu=require_gpu,
                    timings=verbose,
                    on_progress=report,
                )
        except rendering.RenderInterrupted as stop:
            film, interrupted = stop.film, True
        written = out if film.path_sets else []
        for path in written:
            film.save(path, exposure=exposure, tonemap=tonemap)

    if progress == "json":
        typer.echo(json.dumps(_as_event(film, written, interrupted)), err=True)
    elif not quiet:
        for line in _summary(film, written, verbose):
            typer.echo(line, err=True)
    if interrupted:
        _say_interrupted(film, spp or DEFAULT_SPP[integrator], written)
        raise typer.Exit(INTERRUPTED)


@contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """SIGTERM does what Ctrl-C does. Only the main thread may set this up; elsewhere SIGTERM stays as it is."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        # The handler of SIGINT is called, not SIGINT raised: a shell starts background jobs with it ignored.
        on_interrupt = signal.getsignal(signal.SIGINT)
        if not callable(on_interrupt):
            raise KeyboardInterrupt
        on_interrupt(number, frame)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _say_interrupted(film: Film, spp: int, written: Sequence[Path]) -> None:
    if written:
        text = f"{film.path_sets} of {spp} path sets are in {', '.join(map(str, written))}"
    else:
        text = "before the first path set was done; nothing is written"
    typer.echo(f"glpath: interrupted: {text}", err=True)


def _summary(film: Film, written: Sequence[Path], verbose: bool) -> Iterator[str]:
    """What was rendered, on what, how fast and how well."""
    if not film.path_sets:
        return
    m = film.metadata
    _, _, width, height = m.window
    error = film.relative_error()
    noise = "" if error is None else f", error about {percent(error)}"
    yield f"{film.path_sets} path sets of {width} x {height} in {duration(m.elapsed_s)}{noise}"
    solved = m.statistics.get("radiosity_s", 0.0)
    tracing = m.elapsed_s - solved
    speed = f": {_million(film.path_sets * width * height / tracing)} paths/s" if tracing > 0 else ""
    yield f"  on {m.device or 'an unnamed device'}{speed}"
    if solved > 0:
        yield f"  of that, {duration(solved)} for the radiosity solution"
    cast, lost = m.statistics.get("paths_cast", 0), m.statistics.get("paths_lost", 0)
    if cast:
        yield f"  {percent(lost / cast)} of the rays lost to others in their cell (weighed up, no bias)"
    for purpose, count in m.statistics.get("intersection_tests", {}).items():
        yield f"  {_TESTS[purpose]}: {_million(count)} intersection tests"
    dropped = m.statistics.get("dropped_samples", 0)
    if dropped:
        yield f"  {dropped} samples were NaN or infinite and count as 0"
    if verbose:
        for key, value in {"seed": m.seed, "max_depth": m.max_depth, **m.settings, **m.versions}.items():
            yield f"  {key}: {value}"
        yield f"  scene hash: {m.scene_hash}"
        for stage, milliseconds in m.statistics.get("stage_ms", {}).items():
            yield f"  {stage}: {milliseconds / film.path_sets:.3g} ms per path set"
    for path in written:
        yield f"wrote {path}"


def _as_event(film: Film, written: Sequence[Path], interrupted: bool) -> dict[str, Any]:
    """The last object of `--progress json`."""
    m = film.metadata
    return {
        "event": "interrupted" if interrupted else "done",
        "path_sets": film.path_sets,
        "elapsed_s": round(m.elapsed_s, 3),
        "error": film.relative_error(),
        "renderer": m.device,
        "statistics": m.statistics,
        "files": [str(path) for path in written],
    }


def _million(count: float) -> str:
    return f"{count / 1e6:.3g} million" if count >= 1e6 else f"{count:,.0f}"


def _check_choice(option: str, found: str, allowed: Sequence[str]) -> None:
    if found not in allowed:
        raise UsageError(f"{option} {found}: there is no such choice. Allowed: {', '.join(allowed)}.")


def _numbers(
    option: str, text: str, form: str, counts: Sequence[int], kind: Callable[[str], float], separator: str = ","
) -> list[Any]:
    """The numbers of a text, which must be one of `counts` many; else a UsageError that shows `form`."""
    try:
        numbers = [kind(part) for part in text.split(separator)]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise UsageError(f"{option} {text}: expected {form} in finite numbers.")
    return numbers


def _vector(option: str, text: str | None) -> Vector | None:
    if text is None:
        return None
    x, y, z = _numbers(option, text, "X,Y,Z", [3], float)
    return x, y, z


def _colour(option: str, text: str) -> Vector:
    numbers = _numbers(option, text, "R,G,B or one number,", [1, 3], float)
    if min(numbers) < 0:
        raise UsageError(f"{option} {text}: radiance cannot be negative.")
    r, g, b = numbers if len(numbers) == 3 else numbers * 3
    return r, g, b


def _resolution(text: str) -> tuple[int, int]:
    width, height = _numbers("--resolution", text.lower(), "WxH", [2], int, "x")
    if width < 1 or height < 1:
        raise UsageError(f"--resolution {text}: both sides must be at least 1 pixel.")
    return width, height


def _crop(text: str) -> tuple[int, int, int, int]:
    x, y, width, height = _numbers("--crop", text, "X,Y,W,H", [4], int)
    if width < 1 or height < 1:
        raise UsageError(f"--crop {text}: both sides must be at least 1 pixel.")
    return x, y, width, height


def _check_inside(window: tuple[int, int, int, int], resolution: tuple[int, int]) -> None:
    x, y, width, height = window
    full_width, full_height = resolution
    if x < 0 or y < 0 or x + width > full_width or y + height > full_height:
        raise UsageError(
            f"--crop {x},{y},{width},{height}: reaches out of the picture of {full_width} x {full_height}.",
            "X and Y are the top left pixel, W and H the size, all in pixels of the whole picture.",
        )
