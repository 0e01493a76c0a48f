"""Fences that llvmpipe must not free too early: a workaround for a use after free in Mesa.

In llvmpipe, a scene is all drawing to one framebuffer until another is bound. Each scene gets a fence, and
llvmpipe's threads signal it: lock, count, broadcast, unlock. The drawing thread reads the count without the lock
(lp_fence_signalled) and may free the fence before the unlock. The unlock then writes into freed memory, and the
process crashes seconds or hours later. A GL sync object holds a reference to the fence of the scene that it closes.
One sync object per draw, deleted many draws later, keeps the fence until the threads have finished.

Costs:    each draw becomes a scene of its own; no measurable time on the Cornell box at 256 x 256.
Poor at:  a draw that fills several scenes (a hundred thousand triangles): only the fence of the last is held.
Source:   Mesa 22.3.6, src/gallium/drivers/llvmpipe/lp_fence.c, lp_setup.c, lp_scene.c; tests/llvmpipe_fence has the
          reproduction and the report.
"""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Callable

from glpath.system.numerals import unsigned

_SYNC_GPU_COMMANDS_COMPLETE = 0x9117

#: Number of draws after which a fence is deleted. llvmpipe has at most 64 unfinished scenes.
HELD = 80


def asks_for_one_thread(threads: str | None) -> bool:
    """Return True if a value of LP_NUM_THREADS requests one thread.

    With 0 instead, the drawing thread itself does all work, which is as fast and needs no fence.
    """
    return threads is not None and unsigned(threads.strip()) == 1


class HeldFences:
    """Fences of the last `HELD` draws, which llvmpipe therefore does not free.

    address_of : function that returns the address of a GL function by its name
    """

    def __init__(self, address_of: Callable[[str], int]) -> None:
        pointer = ctypes.c_void_p
        self._fence = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, ctypes.c_uint)(address_of("glFenceSync"))
        self._delete = ctypes.CFUNCTYPE(None, pointer)(address_of("glDeleteSync"))
        self._held: deque[int] = deque()

    def hold(self) -> None:
        """Hold the fence of the last draw; called after every draw."""
        self._held.append(self._fence(_SYNC_GPU_COMMANDS_COMPLETE, 0))
        if len(self._held) > HELD:
            self._delete(self._held.popleft())
