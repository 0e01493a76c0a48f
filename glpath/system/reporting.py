"""Progress of what is computed in stages: a bar on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any, TextIO, TypeVar

from glpath.rendering.progress import duration
from glpath.system.terminal import clean, clean_console

_Progress = TypeVar("_Progress")
# Seconds between two lines.
_LINE_INTERVAL = 5.0


@dataclass(frozen=True)
class Told:
    """What is said of a progress.

    done, total : of the stage, for a bar, which pulses where total is None
    detail      : beside the bar; and, after `head`, in a line
    event       : the same as numbers
    """

    stage: str
    elapsed_s: float
    done: float
    total: float | None
    detail: str
    head: str
    event: dict[str, Any]


def reporting(
    mode: str, stream: TextIO, tell: Callable[[_Progress], Told]
) -> AbstractContextManager[Callable[[_Progress], None] | None]:
    """The reporter of a mode out of `glpath.rendering.progress.MODES`; auto is a bar on a terminal, else lines."""
    if mode == "auto":
        mode = "bar" if clean_console(stream).is_terminal else "lines"
    if mode == "none":
        return nullcontext()
    shown = {"bar": _bar, "lines": _lines, "json": _json}[mode](stream)
    return _telling(shown, tell)


@contextmanager
def _telling(
    shown: AbstractContextManager[Callable[[Told], None]], tell: Callable[[_Progress], Told]
) -> Iterator[Callable[[_Progress], None]]:
    with shown as show:
        yield lambda progress: show(tell(progress))


@contextmanager
def _bar(stream: TextIO) -> Iterator[Callable[[Told], None]]:
    from rich import progress as rich_progress

    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(bar_width=None),
        rich_progress.TimeElapsedColumn(),
        rich_progress.TextColumn("{task.fields[detail]}", markup=False),
    )
    with rich_progress.Progress(*columns, console=clean_console(stream, highlight=False), transient=True) as bar:
        task = bar.add_task("starting", total=None, detail="")

        def show(told: Told) -> None:
            bar.update(task, description=told.stage, completed=told.done, total=told.total, detail=told.detail)

        yield show


@contextmanager
def _lines(stream: TextIO) -> Iterator[Callable[[Told], None]]:
    """One when a stage begins, and every few seconds."""
    stage, after = "", 0.0

    def show(told: Told) -> None:
        nonlocal stage, after
        if told.stage == stage and told.elapsed_s < after:
            return
        stage, after = told.stage, told.elapsed_s + _LINE_INTERVAL
        text = f"{told.head}{told.detail} after {duration(told.elapsed_s)}" if told.detail else told.stage
        print(clean(text), file=stream, flush=True)

    yield show


@contextmanager
def _json(stream: TextIO) -> Iterator[Callable[[Told], None]]:
    def show(told: Told) -> None:
        event = {
            "event": "progress",
            "stage": told.stage,
            **told.event,
            "elapsed_s": round(told.elapsed_s, 3),
        }
        print(json.dumps(event), file=stream, flush=True)

    yield show
