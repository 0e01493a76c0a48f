"""Memory and cores available to this process."""

from __future__ import annotations

import contextlib
import ctypes
import os
from importlib import import_module
from pathlib import Path
from typing import Any

# Maximum number of threads of this process; None: no limit.
_max_threads: int | None = None


def posix_module(name: str) -> Any:
    """Import a standard library module that Windows does not have; return None there."""
    try:
        return import_module(name)
    except ImportError:
        return None


resource = posix_module("resource")


def status_bytes(name: str) -> int:
    """Return the size, in bytes, that /proc/self/status gives under a name; 0 if the system does not report it."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
    except (OSError, ValueError, IndexError):
        return 0  # not Linux, or /proc is hidden or emulated


def peak_resident_bytes() -> int:
    """Return the peak memory of this process in bytes, including llvmpipe's; 0 if the system does not report it."""
    # getrusage is only a fallback, because its value starts from that of the parent process.
    peak = status_bytes("VmHWM")
    if peak or resource is None:
        return peak
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def core_count() -> int:
    """Return the number of cores that this process may use; `limit_threads` may reduce it."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores if _max_threads is None else min(cores, _max_threads)


def limit_threads(count: int) -> None:
    """Limit the threads of solvers, llvmpipe and Open Image Denoise in this process from now on.

    llvmpipe reads the number when it is loaded, so an existing context keeps its threads. One thread is passed to
    llvmpipe as 0, which means the calling thread: with one thread of its own, a race makes it crash.
    """
    global _max_threads
    _max_threads = count
    os.environ["LP_NUM_THREADS"] = str(count if count > 1 else 0)
    os.environ["OIDN_NUM_THREADS"] = str(count)


def return_memory() -> None:
    """Return freed memory to the system; glibc otherwise keeps it for this process.

    Takes some milliseconds. Does nothing with another C library.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
