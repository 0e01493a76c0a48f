"""Watchdog: a second process that notices a hanging device or solver, and ends this process.

During a driver call that never returns, no Python thread runs, because the call holds Python's lock. Therefore each
finished piece of work (`glpath.system.heartbeat`) is reported to a small separate process, the watchdog, through a
pipe. If no report comes for too long, the watchdog prints a line and aborts this process (SIGABRT, exit code 134 in
a shell). This process then prints its stack and ends. Data in memory are lost, but a checkpoint file remains.

The watchdog counts only time in which it ran itself, so a suspended render (Ctrl-Z) does not count as hanging. It
also excludes time in which this process alone was stopped (SIGSTOP, a debugger), and time for which its threads
waited for a processor, as reported by the operating system. If such time counted, compilation of a kernel on a busy
machine could exceed the limit. While a checkpoint or the file of a frame is written, the watchdog pauses. It ends
when the pipe closes, for any reason.

Cost:     start of a Python process without packages, 20 ms of another core; then not measurable.
Poor at:  path sets or solver steps that take longer than the limit on slow machines, which need a higher limit.
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
# Minimum interval between two bytes through the pipe, seconds.
_INTERVAL = 0.5

_CODE = """
import os, select, signal, sys, time
watched, limit, message, proc = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3], sys.argv[4]
for number in sys.argv[5:]:
    signal.signal(int(number), signal.SIG_IGN)
tick = min(1.0, limit / 4)
silent = 0.0

def waits():
    # Return the seconds for which each thread has waited for a processor; empty if the kernel does not count them.
    found = {}
    try:
        for thread in os.listdir(f"{proc}/{watched}/task"):
            with open(f"{proc}/{watched}/task/{thread}/schedstat") as file:
                found[thread] = int(file.read().split()[1]) / 1e9
    except (OSError, IndexError, ValueError):
        pass
    return found

def is_stopped():
    # True if a signal or a debugger has stopped the process; False where the kernel does not report it.
    try:
        with open(f"{proc}/{watched}/stat", errors="replace") as file:
            return file.read().rpartition(")")[2].split()[0] in ("T", "t")
    except (OSError, IndexError):
        return False

before, paused = waits(), False
while silent < limit:
    if select.select([0], [], [], None if paused else tick)[0]:
        received = os.read(0, 4096)
        paused = received.endswith(b"p")
        if not received:
            sys.exit()
        silent = 0.0
    else:
        now = waits()
        starved = max((now[each] - before.get(each, now[each]) for each in now), default=0.0)
        if not is_stopped():
            silent += max(0.0, tick - starved)
        before = now
try:
    if select.select([], [2], [], 1.0)[1]:  # a write to a full pipe would block
        os.write(2, message.encode(errors="replace"))
except OSError:  # stderr is full, closed or disconnected; the hung render is killed all the same
    pass
for number in (signal.SIGABRT, signal.SIGABRT, signal.SIGKILL):  # the first may block while its trace is printed
    os.kill(watched, number)
    until = time.monotonic() + 5
    while time.monotonic() < until:
        if select.select([0], [], [], 1.0)[0] and not os.read(0, 4096):
            sys.exit()
"""


class Watchdog:
    """Watchdog that is active during a `with` block.

    limit    : seconds without a finished piece of work after which this process is ended
    where    : message about the data that remain after the process is ended
    suspects : possible causes, for the message
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
        with contextlib.suppress(OSError):  # if no process can be started, there is no watchdog
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _CODE, *arguments], stdin=subprocess.PIPE, bufsize=0
            )
            assert self._process.stdin is not None, "a pipe was asked for"
            os.set_blocking(self._process.stdin.fileno(), False)
            heartbeat.listener = self._beat
            self._say_where_it_hangs()
        return self

    def _say_where_it_hangs(self) -> None:
        """Make Python print its stack at SIGABRT, and suppress the core file of gigabytes."""
        if faulthandler.is_enabled():
            return
        # Standard error may be closed or not a file.
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

    def _beat(self, pauses: bool) -> None:
        now = time.monotonic()
        too_soon = now < self._last + _INTERVAL and not pauses
        if too_soon or self._process is None or self._process.stdin is None:
            return
        self._last = -_INTERVAL if pauses else now  # the beat after a pause is never too soon
        with contextlib.suppress(OSError):  # the watchdog has ended, or the pipe is full
            os.write(self._process.stdin.fileno(), b"p" if pauses else b".")
