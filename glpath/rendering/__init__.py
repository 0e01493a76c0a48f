"""Rendering: a job describes a render, an engine traces it, and a loop fills a film.

    options     parameters, help and checks, derived from the integrators' settings
    run_options options of a run: device, end, film to resume, reports
    job         one render as a value: plain data, written as JSON, which can be split
    factory     engine for an integrator, its options and a scene
    tiles       parts of an image that fit on a device
    interrupts  handling of Ctrl-C, which keeps finished path sets
    loop        path sets into a film, in steps
    session     engine that is kept while jobs pass through it
    calls       `render`, `render_frames` and `run`, which combine these
    elements    error of an image due to the elements of a radiosity solution

Each name is imported when it is first used, so asking for options loads no OpenGL.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glpath.rendering.calls import render, render_frames, run
    from glpath.rendering.elements import ElementError, element_error
    from glpath.rendering.interrupts import RenderInterrupted
    from glpath.rendering.job import RenderJob
    from glpath.rendering.progress import Progress

_HOME = {
    "ElementError": "glpath.rendering.elements",
    "Progress": "glpath.rendering.progress",
    "RenderInterrupted": "glpath.rendering.interrupts",
    "RenderJob": "glpath.rendering.job",
    "element_error": "glpath.rendering.elements",
    "render": "glpath.rendering.calls",
    "render_frames": "glpath.rendering.calls",
    "run": "glpath.rendering.calls",
}

__all__ = [
    "ElementError",
    "Progress",
    "RenderInterrupted",
    "RenderJob",
    "element_error",
    "render",
    "render_frames",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(_HOME[name]), name)
    return globals()[name]
