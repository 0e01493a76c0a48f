"""Checkpoint and watchdog of a computation that runs unattended."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from glpath.errors import GlpathError, ImageError, UsageError
from glpath.system.files import check_writable, recorded_inputs
from glpath.system.outputs import check_no_input, check_separate
from glpath.system.terminal import say
from glpath.system.time_limit import mark_resumed

if TYPE_CHECKING:
    from glpath.cli.run_request import RunRequest
    from glpath.film.film import Film
    from glpath.jobs.checkpoint import Checkpoint
    from glpath.system.checkpoint import CheckpointFile

#: Exit code if all outputs are written, but the last checkpoint could not be written or removed.
DONE_BUT_CHECKPOINT = 3
#: Possible causes if a render makes no progress, see `watched`.
RENDERING = "the device or its driver hangs, or a path set takes longer"
#: Possible causes if a solver makes no progress.
SOLVING = "the solver hangs, or a step of it, or compiling one of its kernels, takes longer"


@contextmanager
def checkpointed(
    out: Sequence[Path], run: RunRequest, films: bool = True
) -> Iterator[tuple[Checkpoint | None, Film | None]]:
    """Yield the requested checkpoint, locked against other processes, and the film to resume from it.

    Both are None without a checkpoint; the film is None without --resume.

    films : True if outputs that end in .npz are films; the first of them is then the checkpoint

    Raises GlpathError if the checkpoint cannot be used, or if two outputs have the same path.
    """
    from glpath.jobs.checkpoint import Checkpoint, checkpoint_path

    path = checkpoint_path(out, films) if run.keeps else None
    if run.stats is not None:
        check_separate("--stats", run.stats, out if path is None else [*out, path])
        check_no_input("--stats", run.stats)
    if path is None:
        yield None, None
        return
    check_writable(path)
    check_separate("--checkpoint", path, [output for output in out if output != path])
    with Checkpoint(path, *run.interval, is_output=path in out) as checkpoint:
        if not run.resume:
            check_absent(path)
        with recorded_inputs():  # a record of its own, because the checkpoint may be an output
            film = checkpoint.load() if run.resume else None
        if film is not None and film.path_sets:
            mark_resumed()
        yield checkpoint, film


def check_absent(checkpoint: Path) -> None:
    """Raise UsageError if the checkpoint exists, because it must not be replaced without --resume."""
    if os.path.exists(checkpoint):
        raise UsageError(
            f"{checkpoint}: is there already, and the checkpoint would replace it.",
            "--resume continues it. To begin anew, remove it.",
        )


def keep_after_failure(checkpoint: Checkpoint | None, error: Exception) -> None:
    """Write the rendered path sets to the checkpoint after a failure, and mention it in the error's remedy."""
    film = None if checkpoint is None else checkpoint.film
    if checkpoint is None or film is None or not film.path_sets:
        return
    if checkpoint.write(film, last=True) and isinstance(error, GlpathError):
        kept = f"{film.path_sets} path sets are in {checkpoint.path}; the same command with --resume continues."
        error.remedy = f"{error.remedy}\n{kept}".strip()


def remove_checkpoint(checkpoint: CheckpointFile) -> str:
    """Remove the checkpoint of finished work. Return "", or the reason why it was not removed."""
    try:
        checkpoint.remove()
    except ImageError as error:
        return f"the checkpoint was not removed: {error.message}"
    return ""


def done_but(fault: str) -> typer.Exit:
    """Print a fault of the checkpoint after all outputs are written, and return the exit of the command."""
    say(f"glpath: done, but {fault}", err=True)
    return typer.Exit(DONE_BUT_CHECKPOINT)


def watched(hang_limit: float, left: str, suspects: str = RENDERING) -> AbstractContextManager[object]:
    """Return a watchdog that ends the process if it makes no progress.

    hang_limit : time without progress, seconds; 0 for no watchdog
    left       : sentence of the message on saved results
    suspects   : possible causes, for the message
    """
    from glpath.jobs.watchdog import Watchdog

    return Watchdog(hang_limit, left, suspects) if hang_limit else nullcontext()


def left_in(checkpoint: Path | None) -> str:
    """Return the sentence on saved results for the message about a process that hangs."""
    if checkpoint is None:
        return "There was no --checkpoint, so nothing is kept."
    return f"The last checkpoint is {checkpoint}, where one was written; --resume continues from it."
