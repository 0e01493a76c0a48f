"""Data structures of the papers (T-buffer, shadow-buffers, path-buffer), each usable alone.

Their constructors take the OpenGL context (`glpath.gl.get_context`) and a scene on the device
(`glpath.gl.DeviceScene`). A class is imported at its first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glpath.buffers.path_buffer import Cells, Hits, PathBuffer
    from glpath.buffers.shadow_buffer import CubeShadowBuffer, Entries, SphereShadowBuffer
    from glpath.buffers.t_buffer import ClassicEye, TBuffer

_HOME = {
    "Cells": "path_buffer",
    "ClassicEye": "t_buffer",
    "CubeShadowBuffer": "shadow_buffer",
    "Entries": "shadow_buffer",
    "Hits": "path_buffer",
    "PathBuffer": "path_buffer",
    "SphereShadowBuffer": "shadow_buffer",
    "TBuffer": "t_buffer",
}

__all__ = [
    "Cells",
    "ClassicEye",
    "CubeShadowBuffer",
    "Entries",
    "Hits",
    "PathBuffer",
    "SphereShadowBuffer",
    "TBuffer",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f"glpath.buffers.{_HOME[name]}"), name)
    return globals()[name]
