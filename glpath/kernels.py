"""Functions that numba compiles: the first use says that it takes a while, later ones load from numba's cache.

The cache knows when a function's own file has changed, not one that it calls from another file: after such an edit,
remove __pycache__ (make clean).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numba
from numba.core import event

_njit: Any = numba.njit  # whose types know neither of all options
log = logging.getLogger("glpath")


def kernel(function: Callable[..., Any]) -> Any:
    """Compile for the CPU on first use, cached on disk, without Python's lock, so that threads run side by side."""
    return _njit(cache=True, nogil=True, error_model="numpy")(function)


def inner_kernel(function: Callable[..., Any]) -> Any:
    """As `kernel`, for what makes no arrays and returns none: it counts no references to those it is given.

    For functions called in inner loops, where that counting, which is atomic, takes longer than what they do.
    """
    return _njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function)


class _Announcement(event.Listener):
    """Says once that something of ours is compiled. A function found in the cache is not compiled."""

    said = False

    def on_start(self, event: Any) -> None:
        function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
        if not self.said and getattr(function, "__module__", "").startswith("glpath."):
            self.said = True
            # A warning, since that is what logging shows where nobody has set it up.
            log.warning("compiling for this CPU, once; later runs find it in numba's cache")

    def on_end(self, event: Any) -> None:
        """Nothing to do: the announcement is about the beginning."""


event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]
