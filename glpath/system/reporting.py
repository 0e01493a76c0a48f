"""Progress reports of any work on a stream: a bar on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import IO, Any, Literal, TypeVar, get_args

from glpath.system.terminal import clean, clean_console, report_stream

_Progress = TypeVar("_Progress")

Mode = Literal["auto", "bar", "lines", "json", "none"]
#: Modes of the command line; a notebook may display "auto" differently.
MODES: tuple[str, ...] = get_args(Mode)

# Minimum interval between two lines, seconds. Short work then does not fill a log.
_SOONEST = 5.0
# Interval between two lines as a fraction of the elapsed time, so that long work does not fill a log.
_SHARE = 0.05
# Maximum interval between two lines, seconds. Continuous integration, which ends silent jobs, then gets output.
_LATEST = 120.0

# Interval between two JSON objects, seconds.
_JSON_INTERVAL = 0.1


@dataclass(frozen=True)
class ProgressEvent:
    """Report of progress within a stage of work.

    done, total : amounts of the stage, for a bar, which pulses if total is None
    count       : `done` and `total` as text, beside the bar
    detail      : further information, beside the bar
    line        : beginning of a line; "" if only the stage is to be printed
    line_detail : end of the line, after the time
    values      : the same information as numbers
    renderer    : name of the device that renders, if it is reported
    """

    stage: str
    elapsed_s: float
    done: float
    total: float | None
    values: dict[str, Any]
    count: str = ""
    detail: str = ""
    line: str = ""
    line_detail: str = ""
    renderer: str = ""

    @property
    def ended(self) -> bool:
        """True if the stage is done."""
        return self.total is not None and self.done >= self.total


def reporting(
    mode: str, stream: IO[str] | None, event_of: Callable[[_Progress], ProgressEvent]
) -> AbstractContextManager[Callable[[_Progress], None] | None]:
    """Return a context that yields a function that reports progress; None for the mode "none".

    mode     : one of `MODES`; "auto" is a bar on a terminal, and lines elsewhere
    stream   : reports are dropped, and do not end the work, if it is full, closed or None
    event_of : function that makes the event of a report from the progress of the work
    """
    stream = report_stream(stream)
    if mode == "auto":
        mode = "bar" if clean_console(stream).is_terminal else "lines"
    if mode == "none":
        return nullcontext()
    return _reporting({"bar": _bar, "lines": _lines, "json": _json}[mode](stream), event_of)


@contextmanager
def _reporting(
    shown: AbstractContextManager[Callable[[ProgressEvent], None]], event_of: Callable[[_Progress], ProgressEvent]
) -> Iterator[Callable[[_Progress], None]]:
    with shown as show:
        yield lambda progress: show(event_of(progress))


@contextmanager
def _bar(stream: IO[str]) -> Iterator[Callable[[ProgressEvent], None]]:
    from rich import progress as rich_progress

    console = clean_console(stream, highlight=False)
    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(bar_width=None),
        rich_progress.TextColumn("{task.fields[count]}", markup=False),
        rich_progress.TimeElapsedColumn(),
        rich_progress.TextColumn("{task.fields[detail]}", markup=False),
    )
    with rich_progress.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None, count="", detail="")
        renderer = ""

        def show(event: ProgressEvent) -> None:
            nonlocal renderer
            if event.renderer != renderer:
                renderer = event.renderer
                console.print(f"rendering on {renderer}", markup=False)
            bar.update(
                task,
                description=event.stage,
                completed=event.done,
                total=event.total,
                count=event.count,
                detail=event.detail,
            )

        yield show


@contextmanager
def _lines(stream: IO[str]) -> Iterator[Callable[[ProgressEvent], None]]:
    """Yield a function that prints a line when a stage begins or ends, and at intervals."""
    renderer = stage = ""
    after, ended = 0.0, False

    def show(event: ProgressEvent) -> None:
        nonlocal renderer, stage, after, ended
        now = event.elapsed_s
        if event.renderer != renderer:
            renderer = event.renderer
            print(clean(f"rendering on {renderer}"), file=stream, flush=True)
        new = event.stage != stage
        if not new and (ended if event.ended else now < after):
            return
        ended = event.ended
        text = event.line or ("" if new else event.stage)
        text = f"{text} after {duration(now)}{event.line_detail}" if text else event.stage
        print(clean(text), file=stream, flush=True)
        stage, after = event.stage, now + min(max(_SOONEST, _SHARE * now), _LATEST)

    yield show


@contextmanager
def _json(stream: IO[str]) -> Iterator[Callable[[ProgressEvent], None]]:
    stage, after, ended = "", 0.0, False

    def show(event: ProgressEvent) -> None:
        nonlocal stage, after, ended
        if event.stage == stage and (ended if event.ended else event.elapsed_s < after):
            return
        ended = event.ended
        stage, after = event.stage, event.elapsed_s + _JSON_INTERVAL
        record = {"event": "progress", "stage": stage, **event.values, "elapsed_s": round(event.elapsed_s, 3)}
        print(json.dumps(record), file=stream, flush=True)

    yield show


def duration(seconds: float) -> str:
    """Return a readable duration: 7.3 s, 42 s, 3 min 05 s, 2 h 10 min."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


def percent(share: float) -> str:
    """Return a fraction in percent with two significant digits."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"
