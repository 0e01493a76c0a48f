"""Compile the largest kernels in other processes, while this process compiles the others.

Numba compiles under Python's lock, one kernel after the other. On a new machine, compiling the ray caster
`casting.cast_groups` takes half of the first solution's time. Before this process compiles several kernels, it
starts other processes, which compile the ray caster and the largest kernel that it calls. All processes store
compiled code in one cache, and each finds there what it needs, or waits for it (`kernel_cache`). If the others
cannot run, this process compiles all kernels.

Each process solves a scene of two facing squares, and runs all other kernels as plain Python. A kernel thus gets
arguments of the same types as elsewhere, and no list of types has to be maintained.
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

#: Each kernel, followed by the kernels that it calls.
LARGEST = ("cast_groups", "shaft_list")
#: Minimum number of other kernels; fewer compile faster than a process starts.
_WORTH_A_PROCESS = 3

# The module path is passed on, because a file beside the user's script could otherwise shadow a module.
# The process ends with its parent, because nobody expects work after the end of a command.
_CODE = """
import os, sys, threading, time
parent, names, *sys.path = sys.argv[1:]
def watch():
    while os.getppid() == int(parent):
        time.sleep(0.5)
    os._exit(0)
threading.Thread(target=watch, daemon=True).start()
from glpath.system import kernels
kernels.only = frozenset(names.split())
from glpath.radiosity.solvers import smallest
smallest.solve_smallest()
"""


def compile_ahead(needed: Sequence[Any]) -> None:
    """Start processes that compile the largest of the needed kernels, if enough others must be compiled too."""
    largest = [k for k in needed if k.__name__ in LARGEST]
    others = [k for k in needed if k.__name__ not in LARGEST]
    if not waiting(largest) or len(waiting(others)) < _WORTH_A_PROCESS:
        return
    if core_count() == 1 or cache_folder(largest[0]) is None:
        return
    for i in range(len(LARGEST)):
        with suppress(OSError, RuntimeError):  # no program can be started, or too many processes or threads
            process = subprocess.Popen(
                [os.fsdecode(get_executable()), "-c", _CODE, str(os.getpid()), " ".join(LARGEST[i:]), *sys.path],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            # A thread waits for the process, which would otherwise stay in the process table as a zombie.
            threading.Thread(target=process.wait, daemon=True, name="kernels compiled ahead").start()
