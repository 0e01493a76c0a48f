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

from glpath.accel import bvh
from glpath.lights.lighting import Lighting
from glpath.radiosity import lookup
from glpath.radiosity.form_factors import form_factor, lights
from glpath.radiosity.mesh import sides
from glpath.radiosity.shafts import casting, occluders, points, search
from glpath.radiosity.solvers import particles, progressive
from glpath.scene import Scene
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


_ALWAYS = (occluders._parallelograms, bvh._build)


_FORM_FACTORS = (
    points._groups, form_factor._tiers, search._upwards, search.find_emitter_list, casting.cast_groups,
    form_factor._factors,
)  # fmt: skip


_OF_METHOD: dict[str, tuple[Any, ...]] = {
    "progressive": (*_FORM_FACTORS, progressive._energy, progressive._shoot),
    "matrix": _FORM_FACTORS,
    "monte-carlo": (particles.shoot_batch,),
}


def kernels_of(scene: Scene, lighting: Lighting, method: str, near_lamps: bool) -> tuple[Any, ...]:
    """Return the kernels of a method.

    near_lamps : True if the solver computes how near elements are to emitting shapes
    """
    needed = [*_ALWAYS, *_OF_METHOD[method]]
    if lighting.punctual or lighting.sky is not None:
        needed.append(lights._free)
    if near_lamps and lighting.sides:
        needed.append(lookup._closest)
    # The test for closed surfaces takes long in a large scene, so a kernel that is already compiled is not tested.
    if waiting([sides._in_the_open]) and sides.has_solids(scene):
        needed.append(sides._in_the_open)
    return tuple(needed)
