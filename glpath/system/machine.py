"""Memory and cores that the system gives this process."""

from __future__ import annotations

import contextlib
import ctypes
import os
from importlib import import_module
from pathlib import Path
from typing import Any

# Of this process, where it is limited.
_max_threads: int | None = None


def posix_module(name: str) -> Any:
    """A module of the standard library that Windows does not have; None there."""
    try:
        return import_module(name)
    except ImportError:
        return None


resource = posix_module("resource")


def status_bytes(name: str) -> int:
    """Return a size of this process by its name in /proc/self/status; 0 if the system does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
    except (OSError, ValueError, IndexError):
        return 0  # no Linux, or a /proc that is hidden or an emulator's


def peak_resident_bytes() -> int:
    """The most memory that this process had at once, llvmpipe's with it; 0 where the system does not say."""
    # Not by getrusage, whose number begins with that of the process which has started this one.
    peak = status_bytes("VmHWM")
    if peak or resource is None:
        return peak
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def core_count() -> int:
    """Cores that this process may use: what it may run on, or fewer, see `limit_threads`."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores if _max_threads is None else min(cores, _max_threads)


def limit_threads(count: int) -> None:
    """From now on this process computes with so many threads at most: solvers, llvmpipe, Open Image Denoise.

    llvmpipe reads the number when it is loaded, so a process that has a context keeps the threads of that. One
    thread is 0 for llvmpipe, the calling one: with a thread of its own it has a race that crashes.
    """
    global _max_threads
    _max_threads = count
    os.environ["LP_NUM_THREADS"] = str(count if count > 1 else 0)
    os.environ["OIDN_NUM_THREADS"] = str(count)


def return_memory() -> None:
    """Give the system back what was freed: glibc keeps it for this process, and pages of it lie between others.

    Some milliseconds; nothing where the C library is another.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
