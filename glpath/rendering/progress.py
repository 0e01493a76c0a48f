"""How far a render is: an image that converges in a notebook, a bar on a terminal, lines elsewhere, or JSON.

Each is a context manager that yields what `rendering.render` calls as `on_progress`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TextIO

from glpath.film.film import Film
from glpath.system.interactive import in_notebook, running_cell
from glpath.system.terminal import clean, clean_console

#: Of the command line; in a notebook "auto" is an image.
MODES = ("auto", "bar", "lines", "json", "none")

# Seconds between two lines: five at first, then a twentieth of the time that went by, so that neither a short nor a
# long render fills the log, and at most two minutes, as continuous integration ends what is silent for long.
_SOONEST, _SHARE, _LATEST = 5.0, 0.05, 120.0

# Seconds between two JSON objects.
_JSON_INTERVAL = 0.1


@dataclass(frozen=True)
class Progress:
    """How far a render is; what `on_progress` is called with.

    done, total : path sets
    elapsed_s   : seconds since the call of `render`
    error       : estimate of the relative error so far (see `Film.relative_error`), None while it can't be known
    film        : what there is; it grows, so copy what is to be kept
    stage       : what is being done: "solving radiosity ...", "compiling shaders" or "rendering"
    renderer    : name of the device
    """

    done: int
    total: int
    elapsed_s: float
    error: float | None
    film: Film
    stage: str
    renderer: str


Report = Callable[[Progress], None]


def reporting(mode: str, stream: TextIO) -> AbstractContextManager[Report]:
    """The reporter of a mode out of `MODES`; auto is an image in a notebook, a bar on a terminal, else lines."""
    if mode == "auto" and in_notebook():
        return _image()
    if mode == "auto":
        mode = "bar" if clean_console(stream).is_terminal else "lines"
    return {"bar": _bar, "lines": _lines, "json": _json, "none": _none}[mode](stream)


@contextmanager
def _none(stream: TextIO) -> Iterator[Report]:
    yield lambda progress: None


@contextmanager
def _bar(stream: TextIO) -> Iterator[Report]:
    from rich import progress as rich_progress

    console = clean_console(stream, highlight=False)
    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(bar_width=None),
        rich_progress.TextColumn("{task.fields[sets]}", markup=False),
        rich_progress.TimeElapsedColumn(),
        rich_progress.TextColumn("{task.fields[detail]}", markup=False),
    )
    with rich_progress.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None, sets="", detail="")
        renderer = ""
        pace = _Pace()

        def report(progress: Progress) -> None:
            nonlocal renderer
            rate = pace.rate(progress)
            if progress.renderer != renderer:
                renderer = progress.renderer
                console.print(f"rendering on {renderer}", markup=False)
            started = progress.done > 0
            bar.update(
                task,
                description=progress.stage,
                completed=progress.done,
                total=progress.total if started else None,  # without a total the bar pulses
                sets=f"{progress.done}/{progress.total} path sets",
                detail=", ".join(_details(progress, rate)) if started else "",
            )

        yield report


@contextmanager
def _lines(stream: TextIO) -> Iterator[Report]:
    renderer = stage = ""
    next_line = 0.0
    pace = _Pace()

    def report(progress: Progress) -> None:
        nonlocal renderer, stage, next_line
        now, rate = progress.elapsed_s, pace.rate(progress)
        if progress.renderer != renderer:
            renderer = progress.renderer
            print(clean(f"rendering on {renderer}"), file=stream, flush=True)
        if progress.stage == stage and now < next_line and progress.done < progress.total:
            return
        if progress.stage != stage and progress.done == 0:
            print(clean(progress.stage), file=stream, flush=True)
        else:
            details = "".join(f", {text}" for text in _details(progress, rate))
            share = 100 * progress.done / max(progress.total, 1)
            count = f"{progress.done}/{progress.total} path sets ({share:.0f} %)"
            print(clean(f"{count} after {duration(now)}{details}"), file=stream, flush=True)
        stage = progress.stage
        next_line = now + min(max(_SOONEST, _SHARE * now), _LATEST)

    yield report


@contextmanager
def _json(stream: TextIO) -> Iterator[Report]:
    stage = ""
    next_object = 0.0
    pace = _Pace()

    def report(progress: Progress) -> None:
        nonlocal stage, next_object
        rate = pace.rate(progress)
        if progress.stage == stage and progress.elapsed_s < next_object and progress.done < progress.total:
            return
        stage, next_object = progress.stage, progress.elapsed_s + _JSON_INTERVAL
        event = {
            "event": "progress",
            "stage": progress.stage,
            "done": progress.done,
            "total": progress.total,
            "elapsed_s": round(progress.elapsed_s, 3),
            "left_s": None if rate is None else round((progress.total - progress.done) / rate, 3),
            "error": progress.error,
            "renderer": progress.renderer,
        }
        print(json.dumps(event), file=stream, flush=True)

    yield report


@contextmanager
def _image() -> Iterator[Report]:
    """The film as it converges, and a line below it, each replaced in place."""
    from IPython.display import display

    handles: dict[str, Any] = {}
    pace = _Pace()
    cell = running_cell()
    latest: Progress | None = None

    def show(name: str, bundle: dict[str, object]) -> None:
        if name in handles:
            handles[name].update(bundle, raw=True)
        else:
            handles[name] = display(bundle, raw=True, display_id=True)  # type: ignore[no-untyped-call]

    def make_way() -> None:
        """The cell shows the film itself: once is enough."""
        if cell is not None and running_cell() == cell:
            show("picture", {"text/plain": ""})

    def report(progress: Progress) -> None:
        nonlocal latest
        latest = progress
        rate = pace.rate(progress)
        if not progress.done:
            line = f"{progress.stage} on {progress.renderer}"
        elif progress.done < progress.total:
            line = ", ".join([f"{progress.done}/{progress.total} path sets", *_details(progress, rate)])
        else:
            # No longer how quick it is: the output stays in the notebook.
            error = "" if progress.error is None else f", error about {percent(progress.error)}"
            line = f"{progress.done} path sets in {duration(progress.elapsed_s)}{error}, {progress.renderer}"
        bundle: dict[str, object] = progress.film.shown() if progress.done else {"text/plain": ""}
        if progress.done < progress.total:
            bundle.pop("image/png", None)  # the HTML has it, and the next one comes soon
        show("picture", bundle)
        show("line", {"text/plain": line})

    try:
        yield report
    except BaseException as error:
        if latest is not None:
            # No longer what was to come: the output stays in the notebook.
            film, ended = latest.film, "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
            show("picture", film.shown() if film.path_sets else {"text/plain": ""})
            show("line", {"text/plain": f"{ended} after {film.path_sets} path sets, {latest.renderer}"})
        raise
    if latest is not None:
        latest.film.before_shown = make_way


class _Pace:
    """Path sets per second since the first of them was reported: the time before went into compiling shaders."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None

    def rate(self, progress: Progress) -> float | None:
        if progress.done == 0:
            return None
        if self._first is None:
            self._first = progress.done, progress.elapsed_s
        done, seconds = progress.done - self._first[0], progress.elapsed_s - self._first[1]
        return done / seconds if done > 0 and seconds > 0 else None


def _details(progress: Progress, rate: float | None) -> Iterator[str]:
    """Rate, time left and error, as far as they are known."""
    if rate is not None:
        yield f"{rate:.3g} sets/s"
        if progress.done < progress.total:
            yield f"{duration((progress.total - progress.done) / rate)} left"
    if progress.error is not None:
        yield f"error {percent(progress.error)}"


def duration(seconds: float) -> str:
    """Seconds as people say them: 7.3 s, 42 s, 3 min 05 s, 2 h 10 min."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


def percent(share: float) -> str:
    """A share of 1 in percent, with two digits that count."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"
