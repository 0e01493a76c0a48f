"""A render: a job that describes it, the engine that it asks for, and the loop that fills a film.

    options     parameters, help and checks, derived from the integrators' settings
    run_options how a job is run: device, end, what it resumes, who hears of it
    job         one render as a value: plain data, JSON, to be split
    factory     an integrator with its options, as an engine for a scene
    tiles       the parts of an image that a device holds at once
    interrupts  Ctrl-C keeps what is done
    loop        path sets into a film, in steps
    session     an engine that stays while jobs pass through it
    calls       `render`, `render_frames` and `run`, which put these in order
    elements    what a radiosity solution's elements do to a picture

Each name loads what it needs when it is first used: asking for options alone loads no OpenGL.
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
