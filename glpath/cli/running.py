"""Rendering of films for commands: from a scene or a job file, in this process or on a cluster, new or resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from glpath.cli.outcome import Outcome
from glpath.cli.run_request import OF_RENDERS
from glpath.cli.signals import by_scheduler, hold, interrupted, result_of
from glpath.cli.typed import typed_parameters
from glpath.cli.unattended import keep_after_failure, left_in, watched
from glpath.cli.values import check_inside
from glpath.errors import GlpathError, UsageError
from glpath.film.aovs import with_guides
from glpath.film.choices import INTERRUPTED_RULE, RULES
from glpath.system.log import log
from glpath.system.outputs import check_no_input
from glpath.system.time_limit import lift_limit, without_limit_if_resumed

if TYPE_CHECKING:
    from glpath.cli.run_request import RunRequest
    from glpath.film.film import Film
    from glpath.jobs.checkpoint import Checkpoint
    from glpath.jobs.cluster import Cluster
    from glpath.rendering.interrupts import RenderInterrupted
    from glpath.rendering.job import RenderJob
    from glpath.rendering.progress import Progress
    from glpath.rendering.run_options import RunOptions
    from glpath.scene import Scene


# Function that renders a film with the given options of a run.
Start = Callable[["RunOptions"], "Film"]

# Options allowed with --job: outputs, device and reporting.
_BESIDE_A_JOB = ("job", "out", "exposure", "tonemap", "denoise", "strict", *OF_RENDERS)


def refuse_beside_a_job(context: typer.Context) -> None:
    """Raise UsageError for options that contradict a job file, which defines the whole image."""
    for parameter in typed_parameters(context):
        if parameter.name in _BESIDE_A_JOB:
            continue
        shown = "SCENE" if parameter.name == "scene" else parameter.opts[0]
        raise UsageError(
            f"{shown} beside --job: the job says what is rendered.", "Leave it out, or make another job."
        )


def job_of_scene(scene: Scene, crop: tuple[int, int, int, int] | None, options: dict[str, Any]) -> RenderJob:
    """Return the job of a scene with the options of the command line."""
    from glpath.rendering.job import describe

    if crop is not None:
        check_inside(crop, scene.camera.resolution)
    return describe(scene, crop=crop, **options)[0]


def of_scene(job: RenderJob, scene: Scene) -> Start:
    """Return the function that renders a job whose scene is loaded."""
    from glpath.rendering.calls import run_job

    return lambda run: run_job(job, scene, run)


def of_file(job: RenderJob, out: Sequence[Path]) -> Start:
    """Return the function that renders a job from a file.

    out : outputs, which must not be files that the job's scene reads
    """
    from glpath.rendering.calls import run_job
    from glpath.rendering.options import with_late_warnings

    def film(run: RunOptions) -> Film:
        scene = job.seen()
        for path in out:
            check_no_input("-o", path)
        return run_job(job, scene, run)

    return lambda run: with_late_warnings(lambda: film(run), job.strict)


def denoisable(job: RenderJob) -> RenderJob:
    """Return the job with the AOVs that the denoiser needs."""
    return replace(job, integrator=replace(job.integrator, aovs=with_guides(job.integrator.aovs)))


@contextmanager
def workers_of(address: str | None) -> Iterator[Cluster | None]:
    """Yield the cluster of --cluster; None if this process renders."""
    if address is None:
        yield None
        return
    from glpath.jobs.cluster import Cluster

    with without_limit_if_resumed():
        cluster = Cluster(address)
    with cluster:
        yield cluster


def outcome_of(start: Start, run: RunRequest, checkpoint: Checkpoint | None, begun: Film | None) -> Outcome:
    """Render and return the outcome; the film is partial if a signal ends the render or workers fail.

    The time limit ends with the render, also for a partial film.

    start      : renders the film with given options
    checkpoint : checkpoint of the render; None if there is none
    begun      : film to resume, loaded from the checkpoint; None for a new render

    Raises KeyboardInterrupt if a signal comes before there is a film.
    """
    before = 0 if begun is None else begun.path_sets
    if checkpoint is not None and begun is not None:
        log.info("resuming from %s path sets of %s", before, checkpoint.path)
    film, failure = _film_of(start, run, checkpoint, begun)
    lift_limit()
    return Outcome(film, failure, run, checkpoint, before)


def _film_of(
    start: Start, run: RunRequest, checkpoint: Checkpoint | None, begun: Film | None
) -> tuple[Film, GlpathError | None]:
    from glpath.jobs.chunks import ChunksFailedError
    from glpath.rendering import RenderInterrupted
    from glpath.rendering.resume import AnotherRenderError

    films: list[Film] = []

    def watch(progress: Progress) -> None:
        films[:] = [progress.film]
        if progress.done == progress.total:
            hold()

    try:
        try:
            with (
                watched(run.silence, left_in(checkpoint.path if checkpoint is not None else None)),
                workers_of(run.cluster) as workers,
            ):
                options = run.options(
                    film=begun, on_step=checkpoint, progress=run.mode, on_progress=watch, cluster=workers
                )
                try:
                    return result_of(lambda: start(options)), None
                except RenderInterrupted as stop:
                    films[:] = [stop.film]
                    _handle_interruption(stop, None if workers is None else checkpoint)
        except ChunksFailedError as error:
            hold()
            return error.film, error
        except AnotherRenderError as error:
            assert checkpoint is not None, "only a checkpoint is resumed"
            raise UsageError(
                f"{checkpoint.path}: cannot be resumed: {error.reason}.",
                "Ask for what it was made with; or remove it, and the render begins anew.",
            ) from error
        except Exception as error:
            keep_after_failure(checkpoint, error)
            raise
    except KeyboardInterrupt:  # Ctrl-C came while the render was not handling signals
        if not films:
            raise
        if films[0].metadata.stop_rule not in RULES:
            films[0].metadata = replace(films[0].metadata, stop_rule=INTERRUPTED_RULE)
    return films[0], None


def _handle_interruption(stop: RenderInterrupted, checkpoint: Checkpoint | None) -> None:
    """Record the signal that ended a render. If it came from a scheduler, write the checkpoint of a cluster's film.

    A cluster takes seconds to close, and schedulers do not wait for the checkpoint that is written afterwards.
    """
    interrupted(stop.number)
    film = stop.film
    if checkpoint is not None and by_scheduler() and film.path_sets and film.metadata.stop_rule not in RULES:
        checkpoint.write(film)
