"""Options of a run, each declared once; a command names the options that it has.

`with_options` of `glpath.cli.options` passes the typed values as a `RunRequest` to the command, and
`RunRequest.options` converts them for the renderer.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from glpath.cli.completion import words
from glpath.cli.help import OUTPUT_PANEL
from glpath.cli.signals import resume_later
from glpath.cli.values import check_choice, interval, seconds
from glpath.errors import UsageError, current_warnings
from glpath.rendering.run_options import RunOptions
from glpath.system.files import check_writable
from glpath.system.log import compilations
from glpath.system.machine import limit_threads
from glpath.system.reporting import MODES
from glpath.system.signals import TERMINATING_TEXT

#: Relative error at which a denoised picture looks clean.
_CLEAN = 0.05
#: Relative error at which a picture without denoising looks clean.
_FAIR = 0.02
_MACHINE, _LONG = "Machine", "Long renders"

if TYPE_CHECKING:
    from glpath.cli.picture import Picture

_BACKENDS = ("auto", "egl", "osmesa")


@dataclass(frozen=True)
class RunRequest:
    """Typed values of the options of a run; an option that a command lacks has its default."""

    backend: Annotated[
        str,
        typer.Option(
            metavar="|".join(_BACKENDS),
            help="How OpenGL is reached.",
            rich_help_panel=_MACHINE,
            autocompletion=words(_BACKENDS),
        ),
    ] = "auto"
    device: Annotated[
        int | None, typer.Option(metavar="N", help="A device of `glpath devices`.", rich_help_panel=_MACHINE)
    ] = None
    require_gpu: Annotated[
        bool,
        typer.Option("--require-gpu", help="Fail rather than render in software.", rich_help_panel=_MACHINE),
    ] = False
    threads: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Compute with so many threads at most, in software on the processor; default one for each core.",
            rich_help_panel=_MACHINE,
        ),
    ] = None
    checkpoint: Annotated[
        str | None,
        typer.Option(
            metavar="60s|5m|100i",
            help="So often, by time or steps (path sets, or a solver's), write what is done to "
            "a.checkpoint.npz beside a.png, or to the first film of -o, a.npz; it is removed when all is done.",
            rich_help_panel=_LONG,
        ),
    ] = None
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Resume from the checkpoint, a.checkpoint.npz beside a.png, bit-identical; begin where there is "
            "none. One of another scene, setting or version is refused.",
            rich_help_panel=_LONG,
        ),
    ] = False
    time_limit: Annotated[
        str | None,
        typer.Option(
            metavar="90s|10m|2h",
            help="End so long after the start of the command, with what there is; runs before --resume count, too. "
            "Denoising and writing follow. Without --spp there is no other end.",
            rich_help_panel=_LONG,
        ),
    ] = None
    noise: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            help="End when the relative error of the image is below X with 95 % confidence: 0.02 is a fair "
            "picture, 0.005 a clean one; without --spp there is no other end.",
            rich_help_panel=_LONG,
        ),
    ] = None
    clean: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            help="End when the denoised picture's relative error, estimated from two halves, is below X; 0.05 is "
            "clean to the eye. The default of pictures that are denoised, up to a number of path sets.",
            rich_help_panel=_LONG,
        ),
    ] = None
    stats: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write times by stage (whose measuring costs some), memory, device and counts as JSON.",
            rich_help_panel=_LONG,
        ),
    ] = None
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="local:N|tls://HOST:PORT",
            help="Share the path sets out to N processes here, or to the workers of a Dask scheduler; the same "
            "bits (pip install 'glpath[cluster]').",
            rich_help_panel=_LONG,
        ),
    ] = None
    hang_limit: Annotated[
        str,
        typer.Option(
            metavar="300s|10m|0",
            help="End the process (exit code 134) when for so long nothing was done; 0: wait for ever.",
            rich_help_panel=_LONG,
        ),
    ] = "300s"
    progress: Annotated[
        str,
        typer.Option(
            metavar="|".join(MODES),
            help="Progress on stderr.",
            rich_help_panel=OUTPUT_PANEL,
            autocompletion=words(MODES),
        ),
    ] = "auto"
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Only errors and warnings.", rich_help_panel=OUTPUT_PANEL)
    ] = False
    verbose: Annotated[
        bool,
        typer.Option(
            "-v",
            "--verbose",
            help="Also the log, settings and time by stage, which costs some.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = False

    def begin(self) -> None:
        """Check the options and apply those that hold for the whole process. Raises UsageError."""
        check_choice("--progress", self.progress, MODES)
        if self.quiet and self.verbose:
            raise UsageError("-q and -v contradict each other.", "Give one of them.")
        if self.device is not None and self.device < 0:
            raise UsageError(f"--device {self.device}: must be at least 0.")
        if self.noise is not None and not 0 < self.noise < math.inf:
            raise UsageError(f"--noise {self.noise:g}: must be above 0; 0.02 is a relative error of 2 %.")
        if self.clean is not None and not 0 < self.clean < math.inf:
            raise UsageError(f"--clean {self.clean:g}: must be above 0; 0.05 is a relative error of 5 %.")
        _ = self.interval, self.silence, self.options()
        if self.threads is not None:
            limit_threads(self.threads)
        if self.stats is not None:
            check_writable(self.stats)
        if self.keeps:
            resume_later()
        if self.quiet:
            compilations.setLevel(logging.ERROR)
        if self.verbose:
            logging.getLogger("glpath").setLevel(logging.INFO)

    @property
    def keeps(self) -> bool:
        """True if the run has a checkpoint."""
        return self.checkpoint is not None or self.resume

    @property
    def interval(self) -> tuple[float | None, int | None]:
        """Interval of checkpoints as (seconds, steps), one of which is None; both None without --checkpoint."""
        return (None, None) if self.checkpoint is None else interval("--checkpoint", self.checkpoint)

    @property
    def silence(self) -> float:
        """Seconds without progress after which the watchdog ends the run; 0: never."""
        return seconds("--hang-limit", self.hang_limit, allow_zero=True)

    @property
    def mode(self) -> str:
        """Mode of the progress display."""
        return "none" if self.quiet and self.progress == "auto" else self.progress

    @property
    def talks(self) -> bool:
        """True if lines for people are printed."""
        return not self.quiet and self.progress != "json"

    @property
    def seconds(self) -> float | None:
        """Time limit in seconds; None: no limit."""
        return None if self.time_limit is None else seconds("--time-limit", self.time_limit)

    @property
    def ends_by_rule(self) -> bool:
        """True if a rule other than the number of path sets ends the render."""
        return self.time_limit is not None or self.noise is not None or self.clean is not None

    def until_clean(self, noisy: bool, picture: Picture) -> RunRequest:
        """Return the request with a rule that ends the render when the picture looks clean.

        A picture that is denoised gets the rule `clean`. One that lacks only the denoiser gets the rule `noise`.
        Otherwise, the request is returned unchanged.
        """
        if not noisy or not (picture.denoise or picture.missing):
            return self
        return replace(self, clean=_CLEAN) if picture.denoise else replace(self, noise=_FAIR)

    def options(self, **more: Any) -> RunOptions:
        """Return the options for the renderer; `more` sets further fields."""
        return RunOptions(
            backend=self.backend,
            device=self.device,
            require_gpu=self.require_gpu,
            threads=self.threads,
            time_limit=self.seconds,
            noise=self.noise,
            clean=self.clean,
            timings=self.verbose or self.stats is not None,
            strict=current_warnings().strict,
            **more,
        )


#: Options of commands that render pictures.
OF_RENDERS = tuple(field.name for field in fields(RunRequest))
#: Options of commands that render films without pictures.
OF_FILMS = tuple(name for name in OF_RENDERS if name not in ("verbose", "clean"))
#: Exit codes of commands that render, for their help.
EXIT_CODES = (
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done but the last checkpoint could not be written or "
    f"removed, 75 ended by a signal ({TERMINATING_TEXT}) with its checkpoint written (start it again with "
    "--resume), 130 interrupted (what there is, is written)"
)
# Options that need a device or a film.
_OF_DEVICES = ("backend", "device", "require_gpu", "noise", "stats", "cluster")
#: Options of the radiosity solver, which needs no device.
OF_SOLVERS = tuple(name for name in OF_FILMS if name not in _OF_DEVICES)
#: Options of `viewfactors`; it chooses the interval between saves itself, so it has no --checkpoint.
OF_MATRICES = tuple(name for name in OF_SOLVERS if name not in ("checkpoint", "hang_limit", "time_limit"))
#: Options of `daylight`, which needs a device.
OF_DAYLIGHT = ("backend", "device", "require_gpu", "cluster", *OF_MATRICES)


def declared(name: str) -> tuple[Any, Any]:
    """Return the annotation of an option for Typer, and its default."""
    return _declarations()[name]


@cache
def _declarations() -> dict[str, tuple[Any, Any]]:
    # Evaluated once, because every command asks for about twenty options.
    hints = get_type_hints(RunRequest, include_extras=True)
    return {field.name: (hints[field.name], field.default) for field in fields(RunRequest)}
