"""`glpath render`: an image, of a scene or of a job file.

Everything that can be wrong with the options, the scene and the outputs is found before the render begins.
"""

from __future__ import annotations

import json
import logging
import math
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from glpath.cli import completion
from glpath.cli.completion import words
from glpath.cli.frames import Frames, films_of, left_to_do, render_to_files, write_movie
from glpath.cli.options import (
    FOR_ALL,
    OUTPUT,
    ProgressOption,
    QuietOption,
    option_values,
    with_integrator_options,
)
from glpath.cli.scene import HELP, parameters_option, read_scene, seen
from glpath.cli.signals import (
    INTERRUPTED,
    arrived,
    by_scheduler,
    exit_code,
    forget,
    go_on_later,
    hold,
    interrupted,
    result_of,
)
from glpath.cli.unattended import (
    WITHOUT_CHECKPOINT,
    CheckpointOption,
    ClusterOption,
    HangLimitOption,
    NoiseOption,
    RangeOption,
    ResumeOption,
    StatsOption,
    TimeLimitOption,
    keep_after_failure,
    leave,
    prepared,
    seconds,
    write_stats,
)
from glpath.cli.unattended import sample_range as read_range
from glpath.cli.values import check_choice, check_inside, vector
from glpath.cli.values import crop as read_crop
from glpath.cli.values import exposure as read_exposure
from glpath.cli.values import resolution as read_resolution
from glpath.cli.values import shutter as read_shutter
from glpath.denoise import require_denoiser
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.files import Save, check_writable, save_all
from glpath.film_metadata import DENOISER_AOVS, INTERRUPTED_RULE, NOISE, RULES, TIME_LIMIT
from glpath.image import TONEMAPS
from glpath.integrators.settings import INTEGRATORS, PathSetSettings
from glpath.progress import MODES, Progress, duration, percent, reporting
from glpath.rendering.options import MAX_SPP, default_spp_text
from glpath.scene.camera import Projection
from glpath.terminal import say, say_json

if TYPE_CHECKING:
    from glpath.film import Film
    from glpath.jobs.checkpoint import Checkpoint
    from glpath.rendering import RenderJob
    from glpath.scene import Scene

log = logging.getLogger("glpath")

# What rays are shot for, as `film.metadata.statistics` calls it.
_TESTS = {
    "primary": "from the eye",
    "shadow_buffer": "to fill shadow-buffers",
    "shadow": "shadow rays",
    "secondary": "reflections",
}

_EXIT_CODES = (
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done but the last checkpoint could not be written, 75 ended by "
    "SIGTERM or SIGUSR1 with its checkpoint written (start it again with --resume), 130 interrupted (what there "
    "is, is written), 134 ended by --hang-limit."
)

_IMAGE, _CAMERA, _MACHINE = "Image", "Camera", "Machine"
_SAMPLING = FOR_ALL


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(epilog=_EXIT_CODES)(with_integrator_options(render))


def render(
    context: typer.Context,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            help="Write .png, .exr (radiance) or .npz (the whole film); - for a PNG to stdout; may be repeated.",
            rich_help_panel=_IMAGE,
        ),
    ],
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help=HELP, autocompletion=completion.scenes)
    ] = None,
    job: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Render what a job file says (`RenderJob.save`) in place of SCENE and all options of the image.",
            rich_help_panel=_IMAGE,
        ),
    ] = None,
    spp: Annotated[
        int | None,
        typer.Option(
            help=f"Path sets: samples per pixel; default {default_spp_text()}.",
            show_default=False,
            rich_help_panel=_SAMPLING,
        ),
    ] = None,
    resolution: Annotated[
        str | None, typer.Option(metavar="WxH", help="Instead of the scene's.", rich_help_panel=_IMAGE)
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="Only these pixels, from the top left.", rich_help_panel=_IMAGE),
    ] = None,
    exposure: Annotated[
        str | None,
        typer.Option(
            metavar="STOPS|auto",
            help="Brightness of a .png: 1 doubles it; default as the scene says, or else auto: log-average "
            "luminance to middle grey.",
            show_default=False,
            rich_help_panel=_IMAGE,
        ),
    ] = None,
    tonemap: Annotated[
        str,
        typer.Option(
            metavar="|".join(TONEMAPS),
            help="Tone curve of a .png.",
            rich_help_panel=_IMAGE,
            autocompletion=words(TONEMAPS),
        ),
    ] = "srgb",
    denoise: Annotated[
        bool,
        typer.Option(
            "--denoise",
            help="Denoise .png and .exr by Open Image Denoise (pip install 'glpath[denoise]'), with the AOVs "
            "albedo and normal. An .exr has the picture before it as the layer noisy, an .npz holds that alone.",
            rich_help_panel=_IMAGE,
        ),
    ] = False,
    camera_position: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Where it stands.", rich_help_panel=_CAMERA)
    ] = None,
    camera_target: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="What it looks at.", rich_help_panel=_CAMERA)
    ] = None,
    camera_up: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="What is up in the image.", rich_help_panel=_CAMERA)
    ] = None,
    camera_fov: Annotated[
        float | None, typer.Option(metavar="DEGREES", help="Vertical field of view.", rich_help_panel=_CAMERA)
    ] = None,
    camera_type: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(get_args(Projection)),
            autocompletion=words(get_args(Projection)),
            help="How it projects.",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(metavar="UNITS", help="Of the whole image, if orthographic.", rich_help_panel=_CAMERA),
    ] = None,
    camera_aperture_radius: Annotated[
        float | None,
        typer.Option(metavar="UNITS", help="Radius of its lens; 0 is a pinhole.", rich_help_panel=_CAMERA),
    ] = None,
    camera_focus_distance: Annotated[
        float | None,
        typer.Option(metavar="UNITS", help="Where it is sharp; by itself, at the target.", rich_help_panel=_CAMERA),
    ] = None,
    camera_shutter: Annotated[
        str | None,
        typer.Option(metavar="T,T", help="When it opens and closes, seconds.", rich_help_panel=_CAMERA),
    ] = None,
    parameters: Annotated[list[str] | None, parameters_option(_IMAGE)] = None,
    integrator: Annotated[
        str,
        typer.Option(
            metavar="|".join(INTEGRATORS),
            autocompletion=words(INTEGRATORS),
            help="Global illumination, by paths alone or from a radiosity solution; or ray tracing with point "
            "lights and mirrors, by T-buffer or ray by ray.",
            rich_help_panel=_SAMPLING,
        ),
    ] = "path",
    turntable: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="N images from around the camera's target, about its up: a.png is a-0.png and so on, with the "
            "exposure of the first.",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Images of frames A to B - 1 of what moves: frame_{:04}.png says where the number goes. --resume "
            "renders those that are missing; -o a.mp4 besides makes a movie of the .png (glpath[video]).",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    fps: Annotated[
        float, typer.Option(metavar="N", help="Frames a second of --frames.", rich_help_panel=_CAMERA)
    ] = 24.0,
    backend: Annotated[
        str,
        typer.Option(
            metavar="auto|egl|osmesa",
            help="How OpenGL is reached.",
            rich_help_panel=_MACHINE,
            autocompletion=words(("auto", "egl", "osmesa")),
        ),
    ] = "auto",
    device: Annotated[
        int | None,
        typer.Option(metavar="N", help="A device of `glpath devices`.", rich_help_panel=_MACHINE),
    ] = None,
    require_gpu: Annotated[
        bool, typer.Option("--require-gpu", help="Fail rather than render in software.", rich_help_panel=_MACHINE)
    ] = False,
    checkpoint: CheckpointOption = None,
    resume: ResumeOption = False,
    time_limit: TimeLimitOption = None,
    noise: NoiseOption = None,
    sample_range: RangeOption = None,
    stats: StatsOption = None,
    cluster: ClusterOption = None,
    hang_limit: HangLimitOption = "300s",
    progress: ProgressOption = "auto",
    quiet: QuietOption = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "-v",
            "--verbose",
            help="Also the log, settings and time by stage, which costs some.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    **options: Any,
) -> None:
    """Render a scene to one or more files.

    Ctrl-C ends the render after the running path set and writes what there is; so do SIGTERM and SIGUSR1 as cluster
    schedulers send them, or with --checkpoint or --resume they write the checkpoint alone. Files appear whole or
    not at all; missing folders are made.
    """
    from glpath.film import check_suffix

    if job is not None:
        _refuse_beside_a_job(context)
    elif scene is None:
        raise UsageError("render: no SCENE and no --job.", "Name a scene file or a shipped scene; `glpath scenes`.")
    if quiet and verbose:
        raise UsageError("-q and -v contradict each other.", "Give one of them.")
    if checkpoint is not None or resume:
        go_on_later()
    if verbose:
        logging.getLogger("glpath").setLevel(logging.INFO)
    many = _frames(turntable, frames, fps)
    movies: list[Path] = []
    if many is not None:
        out, movies = many.split(out)
    for path in out:
        check_suffix(path)
    for option, found, allowed in (
        ("--tonemap", tonemap, tuple(TONEMAPS)),
        ("--integrator", integrator, tuple(INTEGRATORS)),
        ("--progress", progress, MODES),
    ):
        check_choice(option, found, allowed)
    for option, count, low in (("--spp", spp, 1), ("--device", device, 0)):
        if count is not None and count < low:
            raise UsageError(f"{option} {count}: must be at least {low}.")
    unattended = {
        "--checkpoint": checkpoint,
        "--resume": resume or None,
        "--time-limit": time_limit,
        "--noise": noise,
        "--sample-range": sample_range,
        "--stats": stats,
        "--cluster": cluster,
    }
    if noise is not None and not 0 < noise < math.inf:
        raise UsageError(f"--noise {noise:g}: must be above 0; 0.02 is a relative error of 2 %.")
    rules = {
        "time_limit": None if time_limit is None else seconds("--time-limit", time_limit),
        "noise": noise,
    }
    rules = {name: value for name, value in rules.items() if value is not None}
    silence = seconds("--hang-limit", hang_limit, allow_zero=True)
    first = {}
    if sample_range is not None:
        if spp is not None:
            raise UsageError("--spp beside --sample-range: the range says how many.", "Leave one out.")
        first["first_path_set"], spp = read_range(sample_range)
    if denoise:
        require_denoiser()
        if job is None and not issubclass(INTEGRATORS[integrator], PathSetSettings):
            raise UsageError(
                f"--denoise with --integrator {integrator}: it has no grain for a denoiser to take away.",
                "Render more path sets, or take --integrator path or gather.",
            )
        options["aovs"] = [*(options["aovs"] or ()), *DENOISER_AOVS]
    options = option_values(integrator, options)
    stops = read_exposure(exposure)
    machine = {
        "backend": backend,
        "device": device,
        "require_gpu": require_gpu,
        "timings": verbose or stats is not None,
    }
    if many is not None:
        kept = {name: value for name, value in unattended.items() if name not in ("--resume", "--cluster")}
        many.check(out, {"--crop": crop, "--job": job, **kept})
    if job is None:
        assert scene is not None, "asked for above"
        size = None if resolution is None else read_resolution(resolution)
        camera = {
            "position": vector("--camera-position", camera_position),
            "target": vector("--camera-target", camera_target),
            "up": vector("--camera-up", camera_up),
            "fov": camera_fov,
            "type": camera_type,
            "height": camera_height,
            "aperture_radius": camera_aperture_radius,
            "focus_distance": camera_focus_distance,
            "shutter": None if camera_shutter is None else read_shutter(camera_shutter),
        }
        scenes = _Scenes(scene, parameters or [], size, camera, fps)
        loaded = scenes.at(many.first) if frames is not None and many is not None else scenes.at()
        options = {"integrator": integrator, "spp": spp, **first, **options}
        start, spp = _described(loaded, None if crop is None else read_crop(crop), options, bool(rules))
    else:
        start, spp = _of_file(job, denoise)
    for path in out if many is None else []:
        check_writable(path)
        if str(path) == "-" and sys.stdout.isatty():
            raise UsageError("-o -: a PNG is no text for a terminal.", "Send it on, e.g. -o - > a.png.")

    if quiet and progress == "auto":
        progress = "none"
    if many is not None:
        todo = left_to_do(many, out, resume)
        cameras = loaded.camera.turntable(turntable) if turntable is not None else None
        tell = None if progress == "none" else lambda line: say(line, err=True)
        with _watched(silence, "The frames before it are written."), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "There is motion")  # a frame is a still of it
            ended_early = render_to_files(
                many,
                todo,
                films_of(
                    loaded,
                    (scenes.at(i) if cameras is None else cameras[i] for i in todo),
                    {**options, **machine},
                    cluster,
                ),
                out,
                lambda film, path, stops: film.save(path, exposure=stops, tonemap=tonemap, denoise=denoise),
                stops,
                tell,
                progress == "json",
            )
        if ended_early:
            raise typer.Exit(exit_code())
        pictures = next((path for path in out if path.suffix.lower() == ".png"), None)
        for movie in movies:
            assert pictures is not None, "asked for by Frames.split"
            write_movie(movie, [many.path(pictures, i) for i in range(many.first, many.stop)], fps)
            if tell is not None:
                tell(json.dumps({"event": "movie", "file": str(movie)}) if progress == "json" else f"wrote {movie}")
        return
    if stats is not None:
        check_writable(stats)
    keeper, begun = prepared(out, checkpoint, resume)
    before = 0 if begun is None else begun.path_sets
    if begun is not None and keeper is not None:
        log.info("going on with %s path sets of %s", before, keeper.path)
    going_on = {"film": begun, "on_step": keeper} if keeper is not None else {}
    film, failure = _film(start, {**machine, **rules, **going_on, "cluster": cluster}, progress, keeper, silence)
    complete = film.metadata.stop_rule in RULES
    if keeper is not None and by_scheduler() and not complete:
        end = leave(keeper, film)
        if stats is not None:
            write_stats(stats, film, keeper, before, [])
        raise end
    written: list[Path] = []
    if film.path_sets:
        stops = film.exposure_stops(stops)
        saves: dict[Path, Save] = {
            path: lambda at: film.save(at, exposure=stops, tonemap=tonemap, denoise=denoise) for path in out
        }
        written, unsaved = save_all(
            saves, {"film.npz": film.save}, "The film is kept in {}; glpath.Film.load reads it, save writes it."
        )
        failure = failure or unsaved
    if keeper is not None and complete and by_scheduler() and failure is None:
        forget()
    ended_early = arrived()
    if keeper is not None and keeper.path not in written and film.path_sets:
        if complete and failure is None:
            keeper.remove()
        else:
            keeper.write(film)
    if stats is not None and film.path_sets:
        try:
            write_stats(stats, film, keeper, before, written)
        except ImageError as error:
            failure = failure or error

    if progress == "json":
        say_json(_as_event(film, written, ended_early, denoise), err=True)
    elif not quiet:
        if before and before == film.path_sets and complete:
            say(f"all {before} path sets were in {keeper.path if keeper else 'the film'} already", err=True)
        for line in _summary(film, written, stops, verbose, denoise):
            say(line, err=True)
    if failure is not None:
        raise failure
    if ended_early:
        _say_interrupted(film, spp, written, keeper)
        raise typer.Exit(INTERRUPTED)
    if keeper is not None and keeper.failure is not None and keeper.path not in written:
        say(f"glpath: done, but the last checkpoint was not written: {keeper.failure}", err=True)
        raise typer.Exit(WITHOUT_CHECKPOINT)


def _film(
    start: Start, options: dict[str, Any], progress: str, keeper: Checkpoint | None, hang_limit: float
) -> tuple[Film, GlpathError | None]:
    """The film, or what there is of it when a signal ends the render, or workers fail, and why; KeyboardInterrupt
    before there is one."""
    from glpath.jobs.chunks import ChunksFailedError
    from glpath.rendering import RenderInterrupted
    from glpath.rendering.going_on import AnotherRenderError

    left = "There was no --checkpoint, so nothing is kept."
    if keeper is not None:
        left = f"The last checkpoint is {keeper.path}, where one was written; --resume goes on with it."

    films: list[Film] = []

    def watch(progress: Progress) -> None:
        films[:] = [progress.film]
        if progress.done == progress.total:
            hold()
        report(progress)

    try:
        try:
            with _watched(hang_limit, left), reporting(progress, sys.stderr) as report:
                return result_of(lambda: start({**options, "on_progress": watch})), None
        except ChunksFailedError as error:
            return error.film, error
        except RenderInterrupted as stop:
            films[:] = [stop.film]
            interrupted(stop.number)
        except AnotherRenderError as error:
            assert keeper is not None, "only a checkpoint is gone on with"
            raise UsageError(
                f"{keeper.path}: cannot be gone on with: {error.reason}.",
                "Ask for what it was made with; or remove it, and the render begins anew.",
            ) from error
        except Exception as error:
            keep_after_failure(keeper, error)
            raise
    except KeyboardInterrupt:  # on the way here from the render
        if not films:
            raise
    return films[0], None


@dataclass(frozen=True)
class _Scenes:
    """The scene of the command line, at the time of any frame.

    camera : what to replace of its camera; None is not given
    """

    scene: str
    parameters: Sequence[str]
    resolution: tuple[int, int] | None
    camera: dict[str, Any]
    fps: float

    def at(self, frame: int | None = None) -> Scene:
        """Raises and warns as `read_scene`, of further frames no more; frame: None without --frames."""
        if frame is None:
            return seen(read_scene(self.scene, self.parameters), self.resolution, self.camera)
        others = [text for text in self.parameters if text.partition("=")[0].strip() != "time"]
        begun = [text.partition("=")[2] for text in self.parameters if text not in others]
        try:
            time = frame / self.fps + (float(begun[-1]) if begun else 0.0)
        except ValueError:
            raise UsageError(f"-D time={begun[-1]} beside --frames: expected seconds, as in -D time=1.5.") from None
        camera = self.camera
        if camera["shutter"] is not None:
            camera = camera | {"shutter": tuple(moment + frame / self.fps for moment in camera["shutter"])}
        return seen(read_scene(self.scene, [*others, f"time={time!r}"]), self.resolution, camera)


def _frames(turntable: int | None, frames: str | None, fps: float) -> Frames | None:
    if turntable is not None and frames is not None:
        raise UsageError("--frames beside --turntable: each says which images there are.", "Leave one out.")
    if not 0 < fps < math.inf:
        raise UsageError(f"--fps {fps:g}: must be above 0.")
    if turntable is not None:
        return Frames.around(turntable)
    return None if frames is None else Frames.of_range(frames)


def _watched(hang_limit: float, left: str) -> AbstractContextManager[object]:
    """A watchdog over what hangs; `left` says what there is then."""
    from glpath.jobs.watchdog import Watchdog

    return Watchdog(hang_limit, left) if hang_limit else nullcontext()


# Renders, when it is called with the options of the device and of progress.
Start = Callable[[dict[str, Any]], "Film"]

# What may stand beside --job: where the image goes, what renders it, what is told.
_BESIDE_A_JOB = (
    "job",
    "out",
    "exposure",
    "tonemap",
    "denoise",
    "backend",
    "device",
    "require_gpu",
    "checkpoint",
    "resume",
    "time_limit",
    "noise",
    "stats",
    "cluster",
    "hang_limit",
    "progress",
    "quiet",
    "verbose",
)


def _refuse_beside_a_job(context: typer.Context) -> None:
    """A job says all of the image; whatever else is given contradicts it."""
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        # By its name: typer may have a copy of click with an enumeration of its own.
        if name in _BESIDE_A_JOB or source is None or source.name != "COMMANDLINE":
            continue
        shown = "SCENE" if name == "scene" else parameter.opts[0]
        raise UsageError(
            f"{shown} beside --job: the job says what is rendered.", "Leave it out, or make another job."
        )


def _described(
    scene: Scene, crop: tuple[int, int, int, int] | None, options: dict[str, Any], rules: bool
) -> tuple[Start, int | None]:
    """The render of a scene with the options of the command line, and its path sets; None where others end it."""
    from glpath import rendering
    from glpath.rendering.job import describe

    if crop is not None:
        check_inside(crop, scene.camera.resolution)

    def start(more: dict[str, Any]) -> Film:
        if (address := more.pop("cluster")) is None:
            return rendering.render(scene, crop=crop, **options, **more)
        asked = {**options, "spp": options["spp"] or (MAX_SPP if rules else None)}
        job, loaded = describe(scene, crop=crop, **asked)
        return _by_cluster(address, job, {**more, "scene": loaded})

    default = None if rules else INTEGRATORS[options["integrator"]].default_spp
    return start, options["spp"] or default


def _of_file(path: Path, denoise: bool) -> tuple[Start, int]:
    """The render of a job file, and its path sets. Raises UsageError for one whose film cannot be denoised."""
    from glpath import rendering

    job = rendering.RenderJob.load(path)
    if denoise and not set(DENOISER_AOVS) <= set(job.integrator.aovs):
        raise UsageError(
            f"--denoise beside --job: {path} asks for no AOVs albedo and normal, by which pictures are denoised.",
            f"Make the job with aovs={DENOISER_AOVS!r}.",
        )

    def start(more: dict[str, Any]) -> Film:
        from glpath.gl.context import open_context

        if (address := more.pop("cluster")) is not None:
            return _by_cluster(address, job, more)
        device = {name: more.pop(name) for name in ("backend", "device", "require_gpu")}
        return rendering.run(job, open_context(**device), **more)

    return start, job.spp


def _by_cluster(address: str, job: RenderJob, options: dict[str, Any]) -> Film:
    from glpath.jobs.cluster import Cluster, render_on

    with Cluster(address) as cluster:
        return render_on(cluster, job, **options)


def _say_interrupted(film: Film, spp: int | None, written: Sequence[Path], keeper: Checkpoint | None) -> None:
    if written:
        of = "" if spp is None else f" of {spp}"
        text = f"{film.path_sets}{of} path sets are in {', '.join(map(str, written))}"
    else:
        text = "before the first path set was done; nothing is written"
    say(f"glpath: interrupted: {text}", err=True)
    films = [path for path in written if path.suffix.lower() == ".npz"]
    if keeper is not None and keeper.failure is None and film.path_sets:
        films = [keeper.path]
    if films and film.metadata.stop_rule == INTERRUPTED_RULE:
        say(f"  the same command with --resume goes on with {films[0]}", err=True)


def _summary(film: Film, written: Sequence[Path], stops: object, verbose: bool, denoise: bool) -> Iterator[str]:
    """What was rendered, on what, how fast and how well; stops: of exposure of a .png."""
    if not film.path_sets:
        return
    m = film.metadata
    _, _, width, height = m.window
    error = film.relative_error()
    noise = "" if error is None else f", error about {percent(error)}"
    if m.stop_rule in (NOISE, TIME_LIMIT):
        bound = "" if m.error_bound is None else f"; at 95 % confidence it is below {percent(m.error_bound)}"
        noise += f"{bound}; ended by --{m.stop_rule.replace(' ', '-')}"
    yield f"{film.path_sets} path sets of {width} x {height} in {duration(m.elapsed_s)}{noise}"
    solved = m.statistics.get("radiosity_s", 0.0)
    tracing = m.elapsed_s - solved
    speed = f": {_million(film.path_sets * width * height / tracing)} paths/s" if tracing > 0 else ""
    yield f"  on {m.device or 'an unnamed device'}{speed}"
    if solved > 0:
        yield f"  of that, {duration(solved)} for the radiosity solution"
    if denoise:
        error = film.relative_error(denoised=True)
        yield "  denoised by Open Image Denoise" + ("" if error is None else f", then error about {percent(error)}")
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
        shown = f", exposure {stops:+g} stops" if path.suffix.lower() == ".png" else ""
        yield f"wrote {path}{shown}"


def _as_event(film: Film, written: Sequence[Path], interrupted: bool, denoise: bool) -> dict[str, Any]:
    """The last object of `--progress json`."""
    m = film.metadata
    return {
        "event": "interrupted" if interrupted else "done",
        "path_sets": film.path_sets,
        "elapsed_s": round(m.elapsed_s, 3),
        "error": film.relative_error(),
        "stop_rule": m.stop_rule,
        "error_bound": m.error_bound,
        **({"denoised_error": film.relative_error(denoised=True)} if denoise else {}),
        "renderer": m.device,
        "statistics": m.statistics,
        "files": [str(path) for path in written],
    }


def _million(count: float) -> str:
    return f"{count / 1e6:.3g} million" if count >= 1e6 else f"{count:,.0f}"
