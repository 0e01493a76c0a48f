"""How much memory there is, so that what needs more is refused before it begins."""

from __future__ import annotations

import os
from pathlib import Path

from glpath.errors import UsageError
from glpath.system.machine import resource, status_bytes


def available_bytes() -> int:
    """Memory that can still be had: the machine's, or what a container leaves of it."""
    free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                free = int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass  # not Linux: what is installed is the best that is known
    group = Path("/sys/fs/cgroup")
    try:
        limit = (group / "memory.max").read_text().strip()
        if limit != "max":
            free = min(free, int(limit) - int((group / "memory.current").read_text()))
    except (OSError, ValueError):
        pass  # without a limit
    if resource is not None:
        for kind, used in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
            limit_bytes, _ = resource.getrlimit(kind)  # of `ulimit -v` and `ulimit -d`
            if limit_bytes != resource.RLIM_INFINITY:
                free = min(free, limit_bytes - status_bytes(used))
    return max(free, 0)


def require_memory(need: float, what: str, remedy: str) -> None:
    """Raises UsageError if there are not so many bytes."""
    available = available_bytes()
    if need > available:
        raise UsageError(f"{what} would need about {_size(need)} of memory; there are {_size(available)}.", remedy)


def _size(count: float) -> str:
    if count >= 1e15:
        return f"{count / 1e9:.3g} GB"
    return f"{count / 1e9:,.1f} GB" if count >= 1e9 else f"{count / 1e6:,.1f} MB"
