"""Final steps of a render command: outputs, statistics, printed summary and exit code."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from glpath.cli.picture import EIGHT_BIT, NO_DENOISER, Picture
from glpath.cli.signals import INTERRUPTED, RESUME_LATER, arrived, by_scheduler, forget
from glpath.cli.unattended import done_but, remove_checkpoint
from glpath.errors import GlpathError, ImageError
from glpath.film.choices import CLEAN, INTERRUPTED_RULE, NOISE, RULES, TIME_LIMIT
from glpath.system.files import without_waiting, write_bytes
from glpath.system.log import log
from glpath.system.machine import peak_resident_bytes
from glpath.system.outputs import save_all
from glpath.system.reporting import duration, percent
from glpath.system.terminal import say, say_json

if TYPE_CHECKING:
    from glpath.cli.records import EndRecord, RenderStats
    from glpath.cli.run_request import RunRequest
    from glpath.film.film import Film
    from glpath.film.metadata import FilmMetadata
    from glpath.jobs.checkpoint import Checkpoint

_RESUME = "  the same command with --resume continues from {}"

# Printed labels of the counts in `film.metadata.statistics["intersection_tests"]`.
_TESTS = {
    "primary": "from the eye",
    "shadow_buffer": "to fill shadow-buffers",
    "shadow": "shadow rays",
    "secondary": "reflections",
}


@dataclass(frozen=True)
class Outcome:
    """Film of a render that has ended, complete or not.

    failure     : error that ended the render; None if it is complete
    checkpoint  : checkpoint of the render; None if there is none
    before      : number of path sets that a resumed film started with
    """

    film: Film
    failure: GlpathError | None
    run: RunRequest
    checkpoint: Checkpoint | None
    before: int

    def leave(
        self,
        write: Callable[[], tuple[list[Path], GlpathError | None]],
        lines: Callable[[list[Path]], Iterable[str]],
        there: Callable[[list[Path]], str],
        event: Callable[[], dict[str, Any]] = dict,
    ) -> None:
        """Write and report all results. Return only if the render is complete and written.

        write : writes the outputs; returns the written paths, and the error if an output could not be written
        lines : makes the printed lines from the written paths
        there : makes the text on the results of an interrupted render from the written paths
        event : makes further values for the last object of `--progress json`

        Raises `failure`, ImageError for outputs that cannot be written, and `typer.Exit` with the exit code.
        """
        film, checkpoint, failure = self.film, self.checkpoint, self.failure
        complete = film.metadata.stop_rule in RULES
        if checkpoint is not None and by_scheduler() and not complete:
            end = leave_for_later(checkpoint, film)
            try:
                with without_waiting():
                    self._write_stats([])
            except ImageError as error:  # does not change the exit code, because the checkpoint is written
                log.warning("--stats: %s", error.message)
            raise end
        written: list[Path] = []
        if film.path_sets:
            if checkpoint is not None and not checkpoint.is_output:
                # A signal or too little memory may end the process while it denoises.
                checkpoint.write_missing(film)
            written, unsaved = write()
            failure = failure or unsaved
        if checkpoint is not None and complete and by_scheduler() and failure is None:
            forget()
        ended_early = arrived()
        fault = ""
        if checkpoint is not None and checkpoint.path not in written and film.path_sets:
            fault = settle(checkpoint, film, failure)
        try:
            self._write_stats(written)
        except ImageError as error:
            failure = failure or error
        if self.run.progress == "json":
            say_json({**_as_event(film, written, ended_early), **event()}, err=True)
        elif not self.run.quiet and film.path_sets:
            if self.before == film.path_sets and complete:
                say(
                    f"all {self.before} path sets were in {checkpoint.path if checkpoint else 'the film'} already",
                    err=True,
                )
            for line in lines(written):
                say(line, err=True)
        if failure is not None:
            raise failure
        if ended_early:
            self._say_interrupted(
                there(written) if written else "before the first path set was done; nothing is written"
            )
            raise typer.Exit(INTERRUPTED)
        if fault:
            raise done_but(fault)

    def _write_stats(self, files: Sequence[Path]) -> None:
        if self.run.stats is not None and self.film.path_sets:
            write_stats(self.run.stats, self.film, self.checkpoint, self.before, files)

    def _say_interrupted(self, there: str) -> None:
        say(f"glpath: interrupted: {there}", err=True)
        checkpoint, film = self.checkpoint, self.film
        if (
            film.path_sets
            and film.metadata.stop_rule == INTERRUPTED_RULE
            and checkpoint
            and checkpoint.failure is None
        ):
            say(_RESUME.format(checkpoint.path), err=True)


def leave_picture(outcome: Outcome, out: Sequence[Path], picture: Picture, spp: int | None) -> None:
    """Write the film to the output files, and report the render.

    spp : requested number of path sets; None if another rule ends the render
    """
    film = outcome.film
    stops = film.exposure_stops(picture.exposure) if film.path_sets else 0.0
    kept = "The film is kept in {}; glpath.Film.load reads it, save writes it."
    of = "" if spp is None else f" of {spp}"

    def there(written: list[Path]) -> str:
        films = [path for path in written if path.suffix.lower() == ".npz"]
        text = f"{film.path_sets}{of} path sets are in {', '.join(map(str, written))}"
        checkpoint, interrupted = outcome.checkpoint, film.metadata.stop_rule == INTERRUPTED_RULE
        resumable = films and interrupted and (checkpoint is None or checkpoint.failure is not None)
        return f"{text}\n{_RESUME.format(films[0])}" if resumable else text

    def event() -> dict[str, Any]:
        return {"denoised_error": film.relative_error(denoised=True)} if picture.denoise else {}

    outcome.leave(
        lambda: save_all(picture.saves(film, out, stops), {"film.npz": film.save}, kept),
        lambda written: _summary(film, written, stops, outcome.run.verbose, picture),
        there,
        event,
    )


def settle(checkpoint: Checkpoint, film: Film, failure: GlpathError | None) -> str:
    """Remove the checkpoint of a complete render and forget signals; otherwise save the film in the checkpoint.

    Return "", or a fault: the checkpoint was not removed, or could not be written the last time.
    """
    fault = ""
    if film.metadata.stop_rule in RULES and failure is None:
        fault = remove_checkpoint(checkpoint)
        if by_scheduler():
            forget()
    else:
        checkpoint.write_missing(film)
    if not fault and checkpoint.failure is not None:
        return f"the last checkpoint was not written: {checkpoint.failure}"
    return fault


def leave_for_later(checkpoint: Checkpoint, film: Film) -> typer.Exit:
    """Save the film in the checkpoint because a scheduler ends the process. Raises ImageError if that fails."""
    if not film.path_sets:
        say("glpath: ended by a signal before the first path set was done; start it again", err=True)
        return typer.Exit(RESUME_LATER)
    kept = "The film is kept in {}; as the checkpoint's file, --resume continues it."
    _, failure = save_all({checkpoint.path: film.save}, {"film.npz": film.save}, kept)
    if failure is not None:
        raise failure
    say(
        f"glpath: ended by a signal: {film.path_sets} path sets are in {checkpoint.path}; "
        "the same command with --resume continues",
        err=True,
    )
    return typer.Exit(RESUME_LATER)


def _summary(film: Film, written: Sequence[Path], stops: float, verbose: bool, picture: Picture) -> Iterator[str]:
    """Yield lines on the size, device, speed and noise of a film; stops: exposure of 8-bit pictures."""
    m = film.metadata
    _, _, width, height = m.window
    error = film.relative_error()
    noise = "" if error is None else f", error about {percent(error)}"
    if m.stop_rule in (NOISE, TIME_LIMIT):
        bound = "" if m.error_bound is None else f"; at 95 % confidence it is below {percent(m.error_bound)}"
        noise += bound + ("; so it ended" if m.stop_rule == NOISE else "; ended by --time-limit")
    yield f"{film.path_sets} path sets of {width} x {height} in {duration(m.elapsed_s)}{noise}"
    solved = m.statistics.get("radiosity_s", 0.0)
    tracing = m.elapsed_s - solved
    speed = f": {_million(film.path_sets * width * height / tracing)} paths/s" if tracing > 0 else ""
    yield f"  on {m.device or 'an unnamed device'}{speed}"
    if solved > 0:
        yield f"  of that, {duration(solved)} for the radiosity solution"
    if error is not None and m.integrator == "gather":
        of_solution = film.solution_error()
        if of_solution is None:
            yield "  the error of the radiosity solution, which is not known, is not in the error"
        else:
            yield f"  of that error, {percent(of_solution)} is the radiosity solution's, whatever the path sets"
    yield from bias_lines(film)
    if picture.denoise:
        error = film.relative_error(denoised=True)
        bias = film.bias()
        clean = ", which is clean" if m.stop_rule == CLEAN and (bias is None or bias.is_small()) else ""
        then = "" if error is None else f", then error about {percent(error)}{clean}"
        yield f"  denoised by Open Image Denoise{then}"
    elif picture.missing:
        yield f"  {NO_DENOISER}"
    cast, lost = m.statistics.get("paths_cast", 0), m.statistics.get("paths_lost")
    if cast and lost is not None:
        yield f"  {percent(lost / cast)} of the rays lost to others in their cell (weighed up, no bias)"
    for purpose, count in m.statistics.get("intersection_tests", {}).items():
        yield f"  {_TESTS.get(purpose, purpose)}: {_million(count)} intersection tests"
    verdict = picture.verdict(film, stops)
    if verdict is not None:
        yield f"  {verdict}"
    if verbose:
        for key, value in {**_settings(m), **m.versions}.items():
            yield f"  {key}: {value}"
        yield f"  scene hash: {m.scene_hash}"
        for stage, milliseconds in m.statistics.get("stage_ms", {}).items():
            yield f"  {stage}: {milliseconds / film.path_sets:.3g} ms per path set"
    for path in written:
        shown = f", exposure {stops:+g} stops" if path.suffix.lower() in EIGHT_BIT else ""
        yield f"wrote {path}{shown}"


def bias_lines(film: Film) -> Iterator[str]:
    """Yield a line on the bias of the gather, or on why it was not measured.

    If the bias was too large, yield a line that "path" replaced the gather.
    """
    from glpath.film.bias import BIAS_OBSTACLE

    bias, rejected = film.bias(), film.rejected_bias()
    obstacle = film.metadata.statistics.get(BIAS_OBSTACLE)
    if bias is not None:
        large = "" if bias.is_small() else ", which is too large; --integrator path has none"
        yield f"  bias of the gather: {bias}{large}"
    elif obstacle is not None:
        yield f"  {obstacle}; --integrator path has none"
    if rejected is not None:
        yield f"  by path: the bias of the gather would be {rejected}"


def _as_event(film: Film, written: Sequence[Path], interrupted: bool) -> EndRecord:
    """Return the last object of `--progress json`."""
    m = film.metadata
    return {
        "event": "interrupted" if interrupted else "done",
        "path_sets": film.path_sets,
        "elapsed_s": round(m.elapsed_s, 3),
        "error": film.relative_error(),
        "stop_rule": m.stop_rule,
        "error_bound": m.error_bound,
        "bias": bias_as_json(film),
        "renderer": m.device,
        "statistics": m.statistics,
        "files": [str(path) for path in written],
    }


def bias_as_json(film: Film) -> dict[str, float] | None:
    """Return the fields of the film's `Bias` as a dictionary; None if the film has no bias estimate."""
    bias = film.bias()
    return None if bias is None else vars(bias)


def _million(count: float) -> str:
    return f"{count / 1e6:.3g} million" if count >= 1e6 else f"{count:,.0f}"


def write_stats(path: Path, film: Film, checkpoint: Checkpoint | None, before: int, files: Sequence[Path]) -> None:
    """Write time, memory and settings of a render as JSON. Raises ImageError.

    before : number of path sets that a resumed film started with
    """
    m = film.metadata
    statistics = dict(m.statistics)
    found: RenderStats = {
        "scene": m.scene,
        "scene_hash": m.scene_hash,
        "integrator": m.integrator,
        "settings": _settings(m),
        "window": m.window,
        "path_sets": film.path_sets,
        "path_sets_before": before,
        "ranges": film.ranges,
        "stop_rule": m.stop_rule,
        "relative_error": film.relative_error(),
        "error_bound": m.error_bound,
        "bias": bias_as_json(film),
        "elapsed_s": round(m.elapsed_s, 4),
        "stage_ms": statistics.pop("stage_ms", {}),
        "counts": statistics,
        "memory": {
            "peak_resident_bytes": peak_resident_bytes(),
            "film_bytes": film.nbytes,
        },
        "device": m.device,
        "versions": m.versions,
        "checkpoint": None
        if checkpoint is None
        else {"path": str(checkpoint.path), "written": checkpoint.written, "failure": checkpoint.failure},
        "files": [str(file) for file in files],
    }
    write_bytes((json.dumps(found, indent=2) + "\n").encode(), path)


def _settings(m: FilmMetadata) -> dict[str, Any]:
    """Return all settings that determine the image, except scene and crop."""
    depth = {} if m.max_depth is None else {"max_depth": m.max_depth}
    return {"seed": m.seed, **depth, **m.settings}
