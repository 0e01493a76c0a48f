"""The largest kernels, compiled by processes beside this one, which meanwhile compiles the others.

Numba compiles under Python's lock, one kernel after the other: on a new machine half of the first solution's time
is that of the ray caster, `casting.cast_groups`. Before several kernels are compiled, other processes
begin with it, and with the largest kernel that it calls. All keep what they compile in one cache, where each finds
what it needs, or waits for it (`kernel_cache`). Nothing depends on these processes: where they cannot run, this one
compiles all.

They solve two facing squares with plain Python instead of all other kernels. So a kernel gets arguments of
the same types as elsewhere, and no list of types has to be kept.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.spawn import get_executable
from typing import Any

from glpath.system.kernels import cache_folder, waiting
from glpath.system.machine import core_count

#: Each with those that it calls behind it.
LARGEST = ("cast_groups", "shaft_list")
#: Fewer kernels besides take less time than the other processes to start.
_WORTH_A_PROCESS = 3

# The path of modules is this process's; without it a file beside the user's script could stand in for a module.
_CODE = """
import sys
names, *sys.path = sys.argv[1:]
from glpath.system import kernels
kernels.only = frozenset(names.split())
from glpath.radiosity.solvers import smallest
smallest.solve_smallest()
"""


def compile_ahead(needed: Sequence[Any]) -> None:
    """Begin to compile the largest of the kernels needed, where that is worth a process."""
    largest = [k for k in needed if k.__name__ in LARGEST]
    others = [k for k in needed if k.__name__ not in LARGEST]
    if not waiting(largest) or len(waiting(others)) < _WORTH_A_PROCESS:
        return
    if core_count() == 1 or cache_folder(largest[0]) is None:
        return
    for i in range(len(LARGEST)):
        with suppress(OSError, RuntimeError):  # no program to be started, or too many of them or of threads
            process = subprocess.Popen(
                [os.fsdecode(get_executable()), "-c", _CODE, " ".join(LARGEST[i:]), *sys.path],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            # Somebody has to ask for its end, or it stays in the table of processes.
            threading.Thread(target=process.wait, daemon=True, name="kernels compiled ahead").start()
