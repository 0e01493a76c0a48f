"""Available memory, and a check that refuses a computation before it begins if it needs more."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from glpath.errors import GlpathError, UsageError
from glpath.system.machine import resource, status_bytes


def available_bytes() -> int:
    """Return the available memory in bytes, limited by the machine, its container and `ulimit`."""
    free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                free = int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass  # not Linux: the installed memory is the best estimate
    group = Path("/sys/fs/cgroup")
    try:
        limit = (group / "memory.max").read_text().strip()
        if limit != "max":
            free = min(free, int(limit) - int((group / "memory.current").read_text()))
    except (OSError, ValueError):
        pass  # no limit by a container
    if resource is not None:
        for kind, used in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
            limit_bytes, _ = resource.getrlimit(kind)  # set by `ulimit -v` and `ulimit -d`
            if limit_bytes != resource.RLIM_INFINITY:
                free = min(free, limit_bytes - status_bytes(used))
    return max(free, 0)


def require_memory(need: float, what: str, remedy: str) -> None:
    """Raise UsageError if fewer than `need` bytes are available."""
    available = available_bytes()
    if need > available:
        raise UsageError(f"{what} would need about {_size(need)} of memory; there are {_size(available)}.", remedy)


@contextmanager
def enough_memory(what: str, remedy: str) -> Iterator[None]:
    """Context that turns a MemoryError into a GlpathError, for memory that cannot be estimated before."""
    try:
        yield
    except MemoryError as error:
        raise GlpathError(f"{what}: there is not enough memory. {error}".rstrip(), remedy) from error


def _size(count: float) -> str:
    if count >= 1e15:
        return f"{count / 1e9:.3g} GB"
    return f"{count / 1e9:,.1f} GB" if count >= 1e9 else f"{count / 1e6:,.1f} MB"
