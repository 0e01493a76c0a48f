"""Options of what nobody watches: checkpoints, stop rules, ranges, statistics, the watchdog."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glpath.errors import GlpathError, UsageError
from glpath.system.files import check_writable

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.jobs.checkpoint import Checkpoint

_LONG = "Long renders"

#: What may be the matter where nothing is done any more: see `watched`.
RENDERING = "the device or its driver hangs, or a path set takes longer"
SOLVING = "the solver hangs, or a step of it, or compiling one of its kernels, takes longer"


def _checkpoint(where: str) -> Any:
    return typer.Option(
        "--checkpoint",
        metavar="60s|5m|100i",
        help=f"So often, by time or path sets, write the film to {where}, which is removed when all is done.",
        rich_help_panel=_LONG,
    )


CheckpointOption = Annotated[
    str | None, _checkpoint("the first .npz of -o; without one to a.checkpoint.npz beside a.png")
]
#: Of commands that write no films.
CheckpointBesideOption = Annotated[str | None, _checkpoint("a.checkpoint.npz beside a.csv")]
ResumeOption = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Go on with that file, to the same bits; begin where there is none. Of another scene, setting or "
        "version, it is refused.",
        rich_help_panel=_LONG,
    ),
]
TimeLimitOption = Annotated[
    str | None,
    typer.Option(
        metavar="90s|10m|2h",
        help="End after this time, that before --resume included; without --spp there is no other end.",
        rich_help_panel=_LONG,
    ),
]
NoiseOption = Annotated[
    float | None,
    typer.Option(
        metavar="X",
        help="End when the relative error of the image is below X with 95 % confidence: 0.02 is a fair picture, "
        "0.005 a clean one; without --spp there is no other end.",
        rich_help_panel=_LONG,
    ),
]
RangeOption = Annotated[
    str | None,
    typer.Option(
        metavar="A:B",
        help="Path sets A to B - 1 alone, in place of --spp: a shard, which `glpath merge` adds to others.",
        rich_help_panel=_LONG,
    ),
]
StatsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Write times by stage (whose measuring costs some), memory, device and counts as JSON.",
        rich_help_panel=_LONG,
    ),
]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        metavar="local:N|tls://HOST:PORT",
        help="Share the path sets out to N processes here, or to the workers of a Dask scheduler; the same bits "
        "(pip install 'glpath[cluster]').",
        rich_help_panel=_LONG,
    ),
]
HangLimitOption = Annotated[
    str,
    typer.Option(
        metavar="300s|10m|0",
        help="End the process (exit code 134) when for so long nothing was done; 0: wait for ever.",
        rich_help_panel=_LONG,
    ),
]
DEFAULT_HANG_LIMIT = "300s"

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


def seconds(option: str, text: str, allow_zero: bool = False) -> float:
    """90, 90s, 10m, 2h, 1.5h or 1d. Raises UsageError."""
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*([a-z]*)", text.strip().lower())
    value = float(match[1]) * _UNITS[match[2]] if match and match[2] in _UNITS else -1.0
    if not (value > 0 or (allow_zero and value == 0)) or value > 1e9:
        raise UsageError(f"{option} {text}: expected a time above 0 such as 90s, 10m, 2h or 1d.")
    return value


def interval(text: str) -> tuple[float | None, int | None]:
    """Seconds or path sets of --checkpoint: 60s, 5m, 100i. Raises UsageError."""
    if match := re.fullmatch(r"(\d+)i", text.strip().lower()):
        if int(match[1]) < 1:
            raise UsageError(f"--checkpoint {text}: must be at least one path set, 1i.")
        return None, int(match[1])
    try:
        return seconds("--checkpoint", text), None
    except UsageError:
        raise UsageError(
            f"--checkpoint {text}: expected a time such as 60s or 5m, or path sets such as 100i."
        ) from None


def sample_range(text: str) -> tuple[int, int]:
    """First path set and how many of --sample-range. Raises UsageError."""
    match = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if not match or int(match[1]) >= int(match[2]):
        raise UsageError(f"--sample-range {text}: expected A:B, whole numbers of which B is greater, e.g. 0:64.")
    return int(match[1]), int(match[2]) - int(match[1])


@contextmanager
def checkpointed(
    out: Sequence[Path], every: str | None, resume: bool, films: bool = True
) -> Iterator[tuple[Checkpoint | None, Film | None]]:
    """The checkpoint that was asked for, which no other process has meanwhile, and the film to go on with.

    films : outputs that end in .npz are films, of which the first is the checkpoint

    Raises GlpathError.
    """
    from glpath.jobs.checkpoint import Checkpoint, checkpoint_path

    if every is None and not resume:
        yield None, None
        return
    by_time, by_sets = (None, None) if every is None else interval(every)
    path = checkpoint_path(out, films)
    check_writable(path)
    with Checkpoint(path, by_time, by_sets) as checkpoint:
        if not resume:
            check_absent(path)
        yield checkpoint, checkpoint.load() if resume else None


def check_absent(checkpoint: Path) -> None:
    """Raise UsageError for a checkpoint that is there and was not asked to be gone on with."""
    if checkpoint.exists():
        raise UsageError(
            f"{checkpoint}: is there already, and the checkpoint would replace it.",
            "--resume goes on with it. To begin anew, remove it.",
        )


def keep_after_failure(checkpoint: Checkpoint | None, error: Exception) -> None:
    """What was rendered before something failed goes into the checkpoint, too."""
    film = None if checkpoint is None else checkpoint.film
    if checkpoint is None or film is None or not film.path_sets:
        return
    if checkpoint.write(film) and isinstance(error, GlpathError):
        kept = f"{film.path_sets} path sets are in {checkpoint.path}; the same command with --resume goes on."
        error.remedy = f"{error.remedy}\n{kept}".strip()


def stop_rules(time_limit: str | None, noise: float | None) -> dict[str, float]:
    """What ends a render beside its path sets, as `glpath.render` takes it. Raises UsageError."""
    if noise is not None and not 0 < noise < math.inf:
        raise UsageError(f"--noise {noise:g}: must be above 0; 0.02 is a relative error of 2 %.")
    rules = {
        "time_limit": None if time_limit is None else seconds("--time-limit", time_limit),
        "noise": noise,
    }
    return {name: value for name, value in rules.items() if value is not None}


def watched(hang_limit: float, left: str, suspects: str = RENDERING) -> AbstractContextManager[object]:
    """A watchdog over what hangs.

    hang_limit : seconds; 0: none
    left       : the sentence that says what there is then
    suspects   : what may be the matter
    """
    from glpath.jobs.watchdog import Watchdog

    return Watchdog(hang_limit, left, suspects) if hang_limit else nullcontext()


def left_in(checkpoint: Path | None) -> str:
    """What there is of what hangs."""
    if checkpoint is None:
        return "There was no --checkpoint, so nothing is kept."
    return f"The last checkpoint is {checkpoint}, where one was written; --resume goes on with it."
