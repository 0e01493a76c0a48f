"""Fences that llvmpipe must not free yet: a remedy for a use after free in Mesa.

For each of its scenes, which is what a framebuffer is drawn until the next one, llvmpipe makes a fence, and its
threads signal it: lock, count, broadcast, unlock. The drawing thread looks at the count without the lock
(lp_fence_signalled) and may free the fence before the unlock, which then writes into freed memory; the process
crashes seconds or hours later. A GL sync object holds a reference to the fence of the scene that it closes: one for
each draw, deleted many draws later, keeps it until its threads are through.

Costs:    a draw is a scene of its own; on the Cornell box, 256 x 256, nothing that could be measured.
Poor at:  a draw that fills more than one scene (a hundred thousand triangles): of these only the last is held.
Source:   Mesa 22.3.6, src/gallium/drivers/llvmpipe/lp_fence.c, lp_setup.c, lp_scene.c; tests/llvmpipe_fence has the
          reproduction and the report.
"""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Callable

_SYNC_GPU_COMMANDS_COMPLETE = 0x9117

#: Draws until a fence may go. llvmpipe has at most 64 unfinished scenes.
HELD = 80


def asks_for_one_thread(threads: str | None) -> bool:
    """Does a value of LP_NUM_THREADS ask for one thread?

    With 0 the drawing thread does all of it, which is as quick, and needs no fence.
    """
    return threads is not None and threads.strip().isdigit() and int(threads) == 1


class HeldFences:
    """The fences of the last draws.

    address_of : of a GL function, by its name
    """

    def __init__(self, address_of: Callable[[str], int]) -> None:
        pointer = ctypes.c_void_p
        self._fence = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, ctypes.c_uint)(address_of("glFenceSync"))
        self._delete = ctypes.CFUNCTYPE(None, pointer)(address_of("glDeleteSync"))
        self._held: deque[int] = deque()

    def hold(self) -> None:
        """Hold the fence of what was drawn last; to be called after every draw."""
        self._held.append(self._fence(_SYNC_GPU_COMMANDS_COMPLETE, 0))
        if len(self._held) > HELD:
            self._delete(self._held.popleft())
