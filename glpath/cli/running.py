"""How `glpath render` gets its film: of a scene or a job file, by this process or a cluster, begun or anew."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from glpath.cli.signals import hold, interrupted, result_of
from glpath.cli.unattended import keep_after_failure, left_in, watched
from glpath.cli.values import check_inside
from glpath.errors import GlpathError, UsageError
from glpath.film.aovs import DENOISER_AOVS
from glpath.integrators.settings import INTEGRATORS
from glpath.rendering.options import MAX_SPP
from glpath.rendering.progress import Progress, reporting

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.jobs.checkpoint import Checkpoint
    from glpath.rendering import RenderJob
    from glpath.scene import Scene

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


def refuse_beside_a_job(context: typer.Context) -> None:
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


def described(
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


def of_file(path: Path, denoise: bool) -> tuple[Start, int]:
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
    from glpath.jobs.cluster import render_on
    from glpath.jobs.connection import Cluster

    with Cluster(address) as cluster:
        return render_on(cluster, job, **options)


def film_of(
    start: Start, options: dict[str, Any], progress: str, keeper: Checkpoint | None, hang_limit: float
) -> tuple[Film, GlpathError | None]:
    """The film, or what there is of it when a signal ends the render, or workers fail, and why; KeyboardInterrupt
    before there is one."""
    from glpath.jobs.chunks import ChunksFailedError
    from glpath.rendering import RenderInterrupted
    from glpath.rendering.going_on import AnotherRenderError

    films: list[Film] = []

    def watch(progress: Progress) -> None:
        films[:] = [progress.film]
        if progress.done == progress.total:
            hold()
        report(progress)

    try:
        try:
            with (
                watched(hang_limit, left_in(keeper.path if keeper is not None else None)),
                reporting(progress, sys.stderr) as report,
            ):
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
