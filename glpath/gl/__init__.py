"""OpenGL layer: the context, programs, passes and scenes on the device."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glpath.gl.context import get_context, open_context
    from glpath.gl.device_scene import DeviceScene

_HOME = {"DeviceScene": "device_scene", "get_context": "context", "open_context": "context"}

__all__ = ["DeviceScene", "get_context", "open_context"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f"glpath.gl.{_HOME[name]}"), name)
    return globals()[name]
