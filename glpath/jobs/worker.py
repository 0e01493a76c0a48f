"""Code of a cluster's worker process: it renders path sets of one render, with an engine kept between chunks.

A worker has one context and one render at a time; its threads take turns. Other work that uses shared data frees
the engine first (`held`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Protocol

from glpath.errors import UsageError, collected_warnings
from glpath.film.film import Film
from glpath.rendering.factory import Plan
from glpath.rendering.job import RenderJob
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import Session
from glpath.scene import Scene
from glpath.system.versions import versions


class Sharable(Protocol):
    """Data sent once to each worker, which many tasks then use.

    token : unique identifier by which tasks refer to the data
    """

    @property
    def token(self) -> str: ...


@dataclass(frozen=True)
class Shared:
    """Data that all chunks of a render need, sent to a worker once.

    token : identifier of the render
    job   : whole job
    scene : scene with the job's camera
    plan  : prepared plan; the client makes the radiosity solution, which is the same for all workers
    options : result of `RunOptions.for_workers`
    version : version of glpath, which must equal the worker's
    """

    token: str
    job: RenderJob
    scene: Scene
    plan: Plan
    options: RunOptions
    version: str


@dataclass
class Part:
    """Film of a chunk of path sets.

    seconds  : time of tracing, without the preparations of a first chunk
    warnings : texts of warnings during the work, for the client
    """

    film: Film
    seconds: float
    warnings: tuple[str, ...] = ()


# State of this worker: shared data by token, lock of the threads that take turns, and engine of the current render.
_shared: dict[str, Sharable] = {}
_turn = threading.Lock()
_session: tuple[str, Session] | None = None


def this_version() -> str:
    """Return the installed version of glpath."""
    return versions("glpath").get("glpath", "")


def hold(shared: Sharable) -> None:
    """Store shared data until `let_go`."""
    _shared[shared.token] = shared


def let_go(token: str) -> None:
    """Delete the shared data of a token, and free its engine."""
    _shared.pop(token, None)
    with _turn:
        if _session is not None and _session[0] == token:
            forget()


@contextmanager
def held(token: str) -> Iterator[Sharable]:
    """Context with the shared data of a token, for work other than a render. It first frees a render's engine."""
    with _turn:
        forget()
        yield _shared[token]


def check_version(version: str) -> None:
    """Raise UsageError if the client has another version of glpath than this worker."""
    if version != this_version():
        raise UsageError(
            f"cluster: a worker has glpath {this_version()}, who asks has {version}.",
            "Install one version everywhere.",
        )


def render_part(token: str, path_sets: tuple[int, int]) -> Part:
    """Render path sets (start, stop) of the job of a token, and return their film.

    Raises the errors of `Session`, and UsageError if the client has another version of glpath.
    """
    global _session
    shared = _shared[token]
    assert isinstance(shared, Shared), "whose path sets are asked for"
    check_version(shared.version)
    with _turn, collected_warnings() as texts:
        if _session is None or _session[0] != shared.token:
            forget()
            _session = shared.token, Session(shared.job, shared.scene, shared.options, plan=shared.plan)
        steps: list[tuple[float, int]] = []
        job = replace(shared.job, path_sets=path_sets)
        options = replace(shared.options, on_step=lambda film: steps.append((time.perf_counter(), film.path_sets)))
        try:
            film = _session[1].render(job, shared.scene, options)
        except BaseException:
            forget()  # the next render makes a new engine
            raise
    return Part(film, _seconds(steps, film), tuple(texts))


def _seconds(steps: list[tuple[float, int]], film: Film) -> float:
    """Return the time of tracing all path sets, without preparations in the first step if there are more."""
    (first, before), (last, _) = steps[0], steps[-1]
    after = film.path_sets - before
    return (last - first) * film.path_sets / after if after else film.metadata.elapsed_s


def forget() -> None:
    """Free the engine's data on the device."""
    global _session
    if _session is not None:
        _session[1].close()
    _session = None
