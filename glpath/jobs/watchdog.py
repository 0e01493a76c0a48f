"""A device or a solver that hangs is noticed, and the process ended, by another process.

Within a call of a driver that never returns no line of Python runs, in no thread: the call holds Python's lock. So
a small process of its own hears of each piece of work that is done (`glpath.system.heartbeat`) through a pipe. When
nothing came for too long it prints a line, and aborts this one (SIGABRT, exit code 134 in a shell), which prints
where it hung. What was in memory is lost; a checkpoint is not.

The other process counts seconds in which it ran itself, so that a render that was suspended (Ctrl-Z) is not taken
for one that hangs. Nor does it count what the kernel says that a thread of this one waited for a processor: on a
busy machine a kernel's compilation, which takes seconds, took longer than the limit. It ends when the pipe closes,
however this process ended.

Cost:     a Python process without packages, 20 ms of another core; then nothing to be measured.
Poor at:  path sets, or steps of a solver, that take longer than the limit, on slow machines: raise it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import subprocess
import sys
import time

from glpath.system.heartbeat import heartbeat
from glpath.system.machine import resource
from glpath.system.signals import ENDING

_PROC = "/proc"
# Between two bytes through the pipe.
_INTERVAL = 0.5

_CODE = """
import os, select, signal, sys, time
watched, limit, message, proc = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3], sys.argv[4]
for number in sys.argv[5:]:
    signal.signal(int(number), signal.SIG_IGN)
tick = min(1.0, limit / 4)
silent = 0.0

def waits():
    # Seconds for which each thread could have run, but had no processor; nothing where the kernel does not count.
    found = {}
    try:
        for thread in os.listdir(f"{proc}/{watched}/task"):
            with open(f"{proc}/{watched}/task/{thread}/schedstat") as file:
                found[thread] = int(file.read().split()[1]) / 1e9
    except (OSError, IndexError, ValueError):
        pass
    return found

before = waits()
while silent < limit:
    if select.select([0], [], [], tick)[0]:
        if not os.read(0, 4096):
            sys.exit()
        silent = 0.0
    else:
        now = waits()
        starved = max((now[each] - before.get(each, now[each]) for each in now), default=0.0)
        silent += max(0.0, tick - starved)
        before = now
try:
    os.write(2, message.encode(errors="replace"))
except OSError:  # full, closed or disconnected: the render hangs nevertheless
    pass
os.kill(watched, signal.SIGABRT)
until = time.monotonic() + 10
while time.monotonic() < until:
    if select.select([0], [], [], 1.0)[0] and not os.read(0, 4096):
        sys.exit()
os.kill(watched, signal.SIGKILL)
"""


class Watchdog:
    """Watches from the beginning to the end of a `with` block.

    limit    : seconds without any sign of work
    where    : the sentence that says what is left when it ends the process
    suspects : what may be the cause
    """

    def __init__(self, limit: float, where: str, suspects: str) -> None:
        self._limit = limit
        self._message = f"glpath: error: nothing was done for {limit:g} s: {suspects} (--hang-limit).\n  {where}\n"
        self._process: subprocess.Popen[bytes] | None = None
        self._last = -_INTERVAL
        self._core_limit: tuple[int, int] | None = None

    def __enter__(self) -> Watchdog:
        arguments = [
            str(os.getpid()),
            str(self._limit),
            self._message,
            _PROC,
            *(str(int(number)) for number in ENDING),
        ]
        with contextlib.suppress(OSError):  # no process to be had: nobody watches
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _CODE, *arguments], stdin=subprocess.PIPE, bufsize=0
            )
            assert self._process.stdin is not None, "a pipe was asked for"
            os.set_blocking(self._process.stdin.fileno(), False)
            heartbeat.listener = self._beat
            self._say_where_it_hangs()
        return self

    def _say_where_it_hangs(self) -> None:
        """At SIGABRT Python writes its stack; without a core file, whose gigabytes nobody asked for."""
        if faulthandler.is_enabled():
            return
        # Standard error may be closed, or no file.
        with contextlib.suppress(ValueError, OSError, AttributeError, RuntimeError):
            faulthandler.enable()
            if resource is not None:
                self._core_limit = resource.getrlimit(resource.RLIMIT_CORE)
                resource.setrlimit(resource.RLIMIT_CORE, (0, self._core_limit[1]))

    def __exit__(self, *exception: object) -> None:
        heartbeat.listener = None
        if self._core_limit is not None:
            faulthandler.disable()
            resource.setrlimit(resource.RLIMIT_CORE, self._core_limit)
        if self._process is not None:
            assert self._process.stdin is not None, "a pipe was asked for"
            self._process.stdin.close()
            self._process.wait()

    def _beat(self) -> None:
        now = time.monotonic()
        if now < self._last + _INTERVAL or self._process is None or self._process.stdin is None:
            return
        self._last = now
        with contextlib.suppress(OSError):  # it has ended, or has much to read
            os.write(self._process.stdin.fileno(), b".")
