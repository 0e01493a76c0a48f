"""Clearing of framebuffers with integer attachments.

moderngl clears by glClear, whose result is undefined for integers (GL 4.3, 17.4.3); glClearBuffer is defined for
all formats.
"""

from __future__ import annotations

import ctypes

import moderngl

from glpath.gl.context import context_of

_COLOR, _DEPTH = 0x1800, 0x1801


def holds_integers(target: moderngl.Framebuffer) -> bool:
    """Return True if the first colour attachment has an integer format."""
    attachments = target.color_attachments
    return bool(attachments) and attachments[0].dtype[0] in "iu"


def clear_integers(target: moderngl.Framebuffer, area: tuple[int, int, int, int]) -> None:
    """Set all colours of an area (x, y, width, height) to 0 and its depth to 1. Leaves the target bound."""
    context = context_of(target.ctx)
    unsigned = context.function("glClearBufferuiv", ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_uint))
    floats = context.function("glClearBufferfv", ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_float))
    target.scissor = area
    target.use()
    for i in range(len(target.color_attachments)):
        unsigned(_COLOR, i, (ctypes.c_uint * 4)())
    if target.depth_attachment is not None:
        target.depth_mask = True
        floats(_DEPTH, 0, ctypes.byref(ctypes.c_float(1.0)))
    target.scissor = None  # type: ignore[assignment]
    target.use()
