"""Options for the computation of a film, not for its content: device, stop rule, film to resume, reports.

A `RenderJob` defines the content of a film, and `RunOptions` define its computation. Run options are keyword
arguments of `render`, `render_frames`, `run`, `irradiance`, `lightmap` and `probes` (`RunKeywords`). The command
line converts its own options to run options (`glpath.cli.run_request`), and a cluster's workers receive them. A new
run option needs a field in `RunKeywords` and in `RunOptions`, an option of the command line, and the code that uses
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

from glpath.errors import UsageError
from glpath.sampling import MAX_SPP
from glpath.system.arguments import short_repr
from glpath.system.interactive import in_notebook
from glpath.system.machine import limit_threads
from glpath.system.reporting import Mode
from glpath.system.time_limit import check_time_limit

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.gl.context import Context
    from glpath.rendering.progress import Progress
    from glpath.scene import Scene


class Workers(Protocol):
    """Interface of workers that render a job instead of this process: `glpath.jobs.cluster.Cluster`."""

    def render(self, job: Any, scene: Scene, options: RunOptions) -> Film:
        """Return the film of a `RenderJob`. `scene` is the job's loaded scene, and `options.cluster` is None."""


class RunKeywords(TypedDict, total=False):
    """Fields of `RunOptions` as keyword arguments."""

    backend: str
    device: int | None
    require_gpu: bool
    threads: int | None
    time_limit: float | None
    noise: float | None
    clean: float | None
    film: Film | None
    on_step: Callable[[Film], None] | None
    timings: bool
    progress: bool | Mode
    on_progress: Callable[[Progress], None] | None
    cluster: Workers | None
    strict: bool


@dataclass(frozen=True)
class RunOptions:
    """Options for the computation of a film: device, time limit, stop rule, film to resume, reports.

    backend, device, require_gpu : see `glpath.gl.context.open_context`
    threads        : maximum number of threads of this process from now on; default: one per core. A software
                     renderer keeps the number of the first render
    time_limit     : maximum time from the call, seconds, including the time already spent on `film`. If the first
                     path set cannot begin within a second after the limit, TimeLimitError is raised
    noise          : end when the relative error of the image, sqrt(mean(e² / (mean² + 0.01))) over pixels and
                     channels, is below this value with 95 % confidence; see `Film.error_bound`. 0.02 is a fair
                     image, 0.005 a clean one. `film.metadata.stop_rule` names the rule that ended the render. With
                     any rule, the film is bit-identical to a render whose `spp` is the same number of path sets.
                     Poor at rare, bright events, which the error misses until one is sampled
    clean          : end when the denoised image looks clean: its relative error, estimated from two halves that are
                     denoised separately (`Film.denoised_noise`), is below this value. 0.05 looks clean. The film
                     needs the AOVs "albedo" and "normal", and at least 16 path sets. Excludes `noise`
    film           : unfinished film of the same render, to resume from. Its path sets are not rendered again. The
                     film is modified and returned
    on_step        : function called with the film after each step, such as a `glpath.jobs.checkpoint.Checkpoint`. A
                     step takes up to half a second, or is one path set
    timings        : True to time each stage (`film.metadata.statistics["stage_ms"]`), which slows the render
    progress       : True to show the progress, in a notebook as the converging image, otherwise on stderr; or a
                     format: "bar", "lines" or "json"
    on_progress    : function called about twice a second with a `Progress`
    cluster        : `glpath.jobs.cluster.Cluster`, whose workers share the path sets
    strict         : True to raise StrictError for a `SceneWarning`. Before rendering, the error is raised at once.
                     For later warnings it is raised at the end, with the result in its field `result`. So is a
                     `SceneWarning` that a filter of `warnings` raises
    """

    backend: str = "auto"
    device: int | None = None
    require_gpu: bool = False
    threads: int | None = None
    time_limit: float | None = None
    noise: float | None = None
    clean: float | None = None
    film: Film | None = None
    on_step: Callable[[Film], None] | None = None
    timings: bool = False
    progress: bool | Mode = False
    on_progress: Callable[[Progress], None] | None = None
    cluster: Workers | None = None
    strict: bool = False

    def __post_init__(self) -> None:
        check_time_limit(self.time_limit)
        for name, value in (("noise", self.noise), ("clean", self.clean)):
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and not (is_number and 0 < value < math.inf):
                raise UsageError(f"{name}: {short_repr(value)} where a number above 0 is needed")
        if self.noise is not None and self.clean is not None:
            raise UsageError("clean beside noise: each ends the render by another error.", "Leave one out.")
        if self.threads is not None and not (isinstance(self.threads, int) and self.threads >= 1):
            raise UsageError(f"threads: {short_repr(self.threads)} where a whole number from 1 is needed")

    @classmethod
    def taken_from(cls, keywords: Mapping[str, Any]) -> tuple[RunOptions, dict[str, Any]]:
        """Return the run options among keyword arguments, and the other arguments. Raises UsageError."""
        names = {field.name for field in fields(cls)}
        others = {name: value for name, value in keywords.items() if name not in names}
        return cls(**{name: value for name, value in keywords.items() if name in names}), others

    def context(self) -> Context:
        """Open the device, with the limit of threads applied. Raises ContextError."""
        from glpath.gl.context import open_context  # imported here, because asking for options must not load OpenGL

        if self.threads is not None:
            limit_threads(self.threads)
        return open_context(self.backend, self.device, self.require_gpu, probe_first=in_notebook())

    def for_workers(self) -> RunOptions:
        """Return the options for a worker that renders a part: without time limit, stop rules, film and reports."""
        here = ("time_limit", "noise", "clean", "film", "on_step", "progress", "on_progress", "cluster")
        return RunOptions(**{name: value for name, value in vars(self).items() if name not in here})

    def spp(self, asked: int | None) -> int | None:
        """Return the number of path sets: `asked`, or the maximum if it is None and a rule ends the render.

        Returns None for the default of the integrator.
        """
        ends_by_rule = not (self.time_limit is None and self.noise is None and self.clean is None)
        return MAX_SPP if asked is None and ends_by_rule else asked
