"""Functions that numba compiles: the first use says that it takes a while, later ones load from numba's cache.

Numba takes a function for unchanged while its own file is, whatever became of those that it calls. Here all of
its room has to be, a folder of the package with the folders in it; and an index that cannot be read (it names
classes that are gone) counts as none.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import event
from numba.core.caching import IndexDataCacheFile

_njit: Any = numba.njit  # whose types know neither of all options
log = logging.getLogger("glpath")


def kernel(function: Callable[..., Any]) -> Any:
    """Compile for the CPU on first use, cached on disk, without Python's lock, so that threads run side by side."""
    return _watched(_njit(cache=True, nogil=True, error_model="numpy")(function))


def inner_kernel(function: Callable[..., Any]) -> Any:
    """As `kernel`, for what makes no arrays and returns none: it counts no references to those it is given.

    For functions called in inner loops, where that counting, which is atomic, takes longer than what they do.
    """
    return _watched(_njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function))


class _Index(IndexDataCacheFile):
    """Of what is in the cache of one function."""

    def _load_index(self) -> dict[Any, str]:
        try:
            return dict(super()._load_index())  # type: ignore[no-untyped-call]
        except Exception:  # whatever unpickling may raise
            return {}


def folder_stamp(file: Path) -> tuple[tuple[str, int, int], ...]:
    """Path, time and size of the Python files that kernels in `file` can depend on: those of its room.

    A room is the outermost package around it, below `glpath` itself. In the package's own folder, where nothing but
    a kernel's file concerns it, that one alone.
    """
    house = Path(__file__).parent
    room = file.parent
    while room.parent != house and (room.parent / "__init__.py").exists():
        room = room.parent
    files = [file] if file.parent == house else sorted(room.rglob("*.py"))
    status = [(path.relative_to(room).as_posix(), path.stat()) for path in files]
    return tuple((name, s.st_mtime_ns, s.st_size) for name, s in status)


def _watched(dispatcher: Any) -> Any:
    """The function, with a cache that knows of the files around it, where this numba keeps one as we know it."""
    cache: Any = getattr(dispatcher, "_cache", None)
    if isinstance(getattr(cache, "_cache_file", None), IndexDataCacheFile):
        stamp = folder_stamp(Path(dispatcher.py_func.__code__.co_filename))
        cache._cache_file = _Index(cache._cache_path, cache._impl.filename_base, stamp)  # type: ignore[no-untyped-call]
    return dispatcher


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
