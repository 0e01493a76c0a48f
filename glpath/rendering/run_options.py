"""How a job is run, whatever it renders: on what device, when it ends, what it resumes, who hears of it.

A `RenderJob` says what a film holds, `RunOptions` how it comes about. They are keyword arguments of `render`,
`render_frames`, `run`, `irradiance`, `lightmap` and `probes` (`RunKeywords`), the command line makes them of its
options (`glpath.cli.run_request`), and a cluster's workers get them. A new one is a field of both classes here, an
option there, and the code that heeds it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

from glpath.errors import UsageError
from glpath.sampling import MAX_SPP
from glpath.system.interactive import in_notebook
from glpath.system.machine import limit_threads
from glpath.system.time_limit import check_time_limit

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.gl.context import Context
    from glpath.rendering.job import RenderJob
    from glpath.rendering.progress import Progress
    from glpath.scene import Scene
    from glpath.system.reporting import Mode


class Workers(Protocol):
    """Who renders a job instead of this process: `glpath.jobs.cluster.Cluster`."""

    def render(self, job: RenderJob, scene: Scene, options: RunOptions) -> Film:
        """The film of the job, whose scene is loaded; options: without `cluster`."""


class RunKeywords(TypedDict, total=False):
    """The fields of `RunOptions` as keyword arguments."""

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
    """Options of a run.

    backend, device, require_gpu : see `glpath.gl.context.open_context`
    threads        : that this process computes with at most, from now on: one for each core. What renders in
                     software has those of the first render
    time_limit     : end after so many seconds from the call, those of `film` included. Nothing is rendered if they
                     are over more than a second before the first path set: see `TimeLimitError`
    noise          : end when the relative error of the image, sqrt(mean(e² / (mean² + 0.01))) over pixels and
                     channels, is below this with 95 % confidence: see `Film.error_bound`. 0.02 is a fair picture,
                     0.005 a clean one. `film.metadata.stop_rule` says what ended the render; by any rule the film
                     has the bits of one of that `spp`. Poor at rare, bright events: nobody misses what was never
                     seen
    clean          : end when the denoised picture looks clean: its relative error, estimated from two halves that
                     are denoised apart (`Film.denoised_noise`), is below this. 0.05 is clean to the eye. The film
                     needs the AOVs "albedo" and "normal", and 16 path sets at least. Not beside `noise`
    film           : a film that this render had begun, to resume from: path sets that it holds are not rendered
                     again. It is changed, and returned
    on_step        : called with the film after each step, of up to half a second or one path set: a
                     `glpath.jobs.checkpoint.Checkpoint`, say
    timings        : time each stage (`film.metadata.statistics["stage_ms"]`); slows the render down
    progress       : show how far it is: in a notebook the image itself as it converges, else a line on stderr; or
                     how, "bar", "lines" or "json"
    on_progress    : called about twice a second, with a `Progress`
    cluster        : a `glpath.jobs.cluster.Cluster`, whose workers share the path sets
    strict         : raise StrictError for a `SceneWarning`: at once before rendering; afterwards when all is done,
                     with the result in the error's `result`
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
                raise UsageError(f"{name}: {value!r} where a number above 0 is needed")
        if self.noise is not None and self.clean is not None:
            raise UsageError("clean beside noise: each ends the render by another error.", "Leave one out.")
        if self.threads is not None and not (isinstance(self.threads, int) and self.threads >= 1):
            raise UsageError(f"threads: {self.threads!r} where a whole number from 1 is needed")

    @classmethod
    def taken_from(cls, keywords: Mapping[str, Any]) -> tuple[RunOptions, dict[str, Any]]:
        """The options among keyword arguments, and the other arguments. Raises UsageError."""
        names = {field.name for field in fields(cls)}
        others = {name: value for name, value in keywords.items() if name not in names}
        return cls(**{name: value for name, value in keywords.items() if name in names}), others

    def context(self) -> Context:
        """The device, for as many threads. Raises ContextError."""
        from glpath.gl.context import open_context  # asking for options alone loads no OpenGL

        if self.threads is not None:
            limit_threads(self.threads)
        return open_context(self.backend, self.device, self.require_gpu, probe_first=in_notebook())

    def for_workers(self) -> RunOptions:
        """What holds for a part of a render elsewhere: all but what its end, its film and its reports are."""
        here = ("time_limit", "noise", "clean", "film", "on_step", "progress", "on_progress", "cluster")
        return RunOptions(**{name: value for name, value in vars(self).items() if name not in here})

    def spp(self, asked: int | None) -> int | None:
        """Path sets of a job that is run so: as asked; without an end where a rule ends it; None: by default."""
        ends_by_rule = not (self.time_limit is None and self.noise is None and self.clean is None)
        return MAX_SPP if asked is None and ends_by_rule else asked
