"""What runs in a worker process of a cluster: path sets of one render, by an engine that stays.

A worker has one context, and one render at a time on it; threads of one worker take turns. Other work that shares
something out frees that engine first (`held`).
"""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Protocol

from glpath.errors import SceneWarning, UsageError
from glpath.film.film import Film
from glpath.rendering.factory import Plan
from glpath.rendering.job import RenderJob
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import Session
from glpath.scene import Scene
from glpath.system.versions import versions


class Sharable(Protocol):
    """What goes to a worker once, and what is computed there refers to. token : identifies it among others"""

    @property
    def token(self) -> str: ...


@dataclass(frozen=True)
class Shared:
    """What all chunks of a render need; goes to a worker once.

    token : identifies this render among others
    job   : all of it
    scene : with the job's camera
    plan  : prepared: a radiosity solution is made before, by who asks, and is the same for all
    options : `RunOptions.for_workers`
    version : of glpath, which has to be the worker's
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

    seconds  : time of tracing, without that for which a first chunk waits
    warnings : texts of the warnings that came meanwhile, for the process that has asked
    """

    film: Film
    seconds: float
    warnings: tuple[str, ...] = ()


# Of this process: what was shared, by token; the engine of the render that it works for, and whose turn it is.
_shared: dict[str, Sharable] = {}
_turn = threading.Lock()
_session: tuple[str, Session] | None = None


def this_version() -> str:
    """Of glpath, as it is installed here."""
    return versions("glpath").get("glpath", "")


def hold(shared: Sharable) -> None:
    """Keep what was shared, until `let_go`."""
    _shared[shared.token] = shared


def let_go(token: str) -> None:
    """It is over."""
    _shared.pop(token, None)
    with _turn:
        if _session is not None and _session[0] == token:
            forget()


@contextmanager
def held(token: str) -> Iterator[Sharable]:
    """What was shared by that token, for work of another kind, with the device to itself."""
    with _turn:
        forget()
        yield _shared[token]


def check_version(version: str) -> None:
    """Raise UsageError where who asks has another version of glpath than this worker."""
    if version != this_version():
        raise UsageError(
            f"cluster: a worker has glpath {this_version()}, who asks has {version}.",
            "Install one version everywhere.",
        )


@contextmanager
def warnings_for_caller() -> Iterator[list[str]]:
    """Collect the texts of scene warnings, for the process that asks; other warnings are shown here at the end."""
    texts: list[str] = []
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", SceneWarning)
            yield texts
    finally:
        for each in caught:
            if not issubclass(each.category, SceneWarning):
                warnings.showwarning(each.message, each.category, each.filename, each.lineno)
            elif str(each.message) not in texts:
                texts.append(str(each.message))


def render_part(token: str, path_sets: tuple[int, int]) -> Part:
    """The film of path sets (start, stop) of the job of a token. Raises what `Session` raises, and UsageError for a
    worker with another version of glpath."""
    global _session
    shared = _shared[token]
    assert isinstance(shared, Shared), "whose path sets are asked for"
    check_version(shared.version)
    with _turn, warnings_for_caller() as texts:
        if _session is None or _session[0] != shared.token:
            forget()
            _session = shared.token, Session(shared.job, shared.scene, shared.options, plan=shared.plan)
        steps: list[tuple[float, int]] = []
        job = replace(shared.job, path_sets=path_sets)
        options = replace(shared.options, on_step=lambda film: steps.append((time.perf_counter(), film.path_sets)))
        try:
            film = _session[1].render(job, shared.scene, options)
        except BaseException:
            forget()  # the next one begins with a new engine
            raise
    return Part(film, _seconds(steps, film), tuple(texts))


def _seconds(steps: list[tuple[float, int]], film: Film) -> float:
    """Of tracing all: from the first step on, which may have waited for shaders, unless it was the only one."""
    (first, before), (last, _) = steps[0], steps[-1]
    after = film.path_sets - before
    return (last - first) * film.path_sets / after if after else film.metadata.elapsed_s


def forget() -> None:
    """Free what is on the device."""
    global _session
    if _session is not None:
        _session[1].close()
    _session = None
