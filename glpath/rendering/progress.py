"""Progress of a render: a converging image in a notebook, otherwise a report of `glpath.system.reporting`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import IO, Any

from glpath.film.film import Film
from glpath.system.interactive import in_notebook, running_cell
from glpath.system.reporting import ProgressEvent, duration, percent
from glpath.system.reporting import reporting as system_reporting


@dataclass(frozen=True)
class Progress:
    """Progress of a render, the argument of `on_progress`.

    done, total : path sets
    elapsed_s   : time since the call of `render`, seconds
    error       : estimate of the relative error so far (see `Film.relative_error`); None while it is unknown
    film        : film so far; it changes, so copy it to keep it
    stage       : current work: "solving radiosity ...", "compiling shaders" or "rendering"
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


def reporting(mode: str, stream: IO[str] | None) -> AbstractContextManager[Report | None]:
    """Return a context with the reporter for a mode of `MODES`; in a notebook, "auto" shows the image."""
    if mode == "auto" and in_notebook():
        return _image()
    pace = _Pace()
    return system_reporting(mode, stream, lambda progress: _event(progress, pace.rate(progress)))


def _event(progress: Progress, rate: float | None) -> ProgressEvent:
    done, total, started = progress.done, progress.total, progress.done > 0
    details = list(_details(progress, rate))
    count = f"{done}/{total} path sets"
    return ProgressEvent(
        stage=progress.stage,
        elapsed_s=progress.elapsed_s,
        done=done,
        total=total if started else None,
        count=count,
        detail=", ".join(details) if started else "",
        line=f"{count} ({100 * done / max(total, 1):.0f} %)" if started else "",
        line_detail="".join(f", {text}" for text in details),
        values={
            "done": done,
            "total": total,
            "left_s": None if rate is None else round((total - done) / rate, 3),
            "error": progress.error,
            "renderer": progress.renderer,
        },
        renderer=progress.renderer,
    )


@contextmanager
def _image() -> Iterator[Report]:
    """Context with a reporter that shows the converging film and a line below it, both updated in the cell."""
    from IPython.display import display

    handles: dict[str, Any] = {}
    pace = _Pace()
    cell = running_cell()
    latest: Progress | None = None

    def show(name: str, bundle: dict[str, object]) -> None:
        with suppress(Exception):  # a front end that cannot show progress must not end the render
            if name in handles:
                handles[name].update(bundle, raw=True)
            else:
                handles[name] = display(bundle, raw=True, display_id=True)  # type: ignore[no-untyped-call]

    def show_film(film: Film, is_last: bool) -> None:
        """Show the film's image, which is denoised first; nothing if that fails, for example for lack of memory."""
        with suppress(Exception):
            bundle: dict[str, object] = film.shown() if film.path_sets else {"text/plain": ""}
            if not is_last:
                bundle.pop("image/png", None)  # the HTML contains the image, and the next update follows soon
            show("picture", bundle)

    def remove_picture() -> None:
        """Remove the image from the output, because the cell shows the film itself."""
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
            # The final line is saved with the notebook, where the speed no longer matters, so it is left out.
            error = "" if progress.error is None else f", error about {percent(progress.error)}"
            line = f"{progress.done} path sets in {duration(progress.elapsed_s)}{error}, {progress.renderer}"
        show_film(progress.film, is_last=progress.done >= progress.total)
        show("line", {"text/plain": line})

    try:
        yield report
    except BaseException as error:
        if latest is not None:
            # The output stays in the notebook, so the final line has no forecast.
            film, ended = latest.film, "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
            # A second Ctrl-C while the image is denoised must not replace the error, which has the film.
            with suppress(KeyboardInterrupt):
                show_film(film, is_last=True)
            show("line", {"text/plain": f"{ended} after {film.path_sets} path sets, {latest.renderer}"})
        raise
    if latest is not None:
        latest.film.before_shown = remove_picture


class _Pace:
    """Path sets (sample passes) per second since the first report. Earlier time was spent compiling shaders."""

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
    """Yield rate, remaining time and error, if they are known."""
    if rate is not None:
        yield f"{rate:.3g} sets/s"
        if progress.done < progress.total:
            yield f"{duration((progress.total - progress.done) / rate)} left"
    if progress.error is not None:
        yield f"error {percent(progress.error)}"
