"""A driver that never returns is noticed from outside, and the process ended with word of what is left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from glpath.film.film import Film
from glpath.jobs import watchdog
from glpath.jobs.watchdog import Watchdog
from glpath.system.checkpoint import CheckpointFile
from glpath.system.heartbeat import heartbeat

# Holds Python's lock while it sleeps, as a driver does that hangs: no thread of this process can do anything.
HANGING = """
import ctypes, sys, time
from glpath.jobs import watchdog
from glpath.jobs.watchdog import Watchdog
from glpath.system.checkpoint import CheckpointFile
from glpath.system.heartbeat import heartbeat

def hang_in_the_driver():
    ctypes.PyDLL(None).sleep(60)

with Watchdog(1.0, "The last checkpoint is a.npz.", "the device or its driver hangs"):
    until = time.monotonic() + float(sys.argv[1])
    while time.monotonic() < until:
        heartbeat.beat()
        time.sleep(0.05)
    print("done", flush=True)
    if sys.argv[2] == "hang":
        hang_in_the_driver()
"""


def test_what_hangs_in_a_call_is_ended_and_says_where() -> None:
    started = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", HANGING, "2.5", "hang"], capture_output=True, text=True, timeout=50
    )
    assert time.monotonic() - started < 30
    assert (done.returncode, done.stdout) == (-signal.SIGABRT, "done\n"), done.stderr
    assert "glpath: error: nothing was done for 1 s: the device or its driver hangs" in done.stderr
    assert "The last checkpoint is a.npz." in done.stderr
    assert "in hang_in_the_driver" in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_hung_process_is_ended_though_its_log_is_full() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-c", HANGING, "0.1", "hang"], stderr=full, timeout=50)
    assert done.returncode == -signal.SIGABRT


def test_hung_process_is_ended_though_nobody_reads_its_log(unread_stream: int) -> None:
    done = subprocess.run([sys.executable, "-c", HANGING, "0.1", "hang"], stderr=unread_stream, timeout=50)
    assert done.returncode == -signal.SIGABRT


def test_what_works_or_was_suspended_is_left_alone() -> None:
    command = [sys.executable, "-c", HANGING, "3", "go on"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        time.sleep(0.7)
        os.killpg(process.pid, signal.SIGSTOP)  # Ctrl-Z
        time.sleep(2.5)
        os.killpg(process.pid, signal.SIGCONT)
        assert process.communicate(timeout=30)[0] == "done\n"
    assert process.returncode == 0


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="Linux reports stopped processes")
@pytest.mark.parametrize(("then", "code"), [("go on", 0), ("hang", -signal.SIGABRT)])
def test_stopped_process_hangs_only_after_it_continues(then: str, code: int) -> None:
    command = [sys.executable, "-c", HANGING, "1.5", then]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        time.sleep(0.7)
        process.send_signal(signal.SIGSTOP)  # to this process alone, not to its watchdog
        time.sleep(4.0)
        assert process.poll() is None
        process.send_signal(signal.SIGCONT)
        assert process.communicate(timeout=30)[0] == "done\n"
    assert process.returncode == code


STARVED = """
import os, sys, threading, time
from pathlib import Path
from types import SimpleNamespace
from glpath.jobs import watchdog
stat = Path(sys.argv[1], str(os.getpid()), "task", "1", "schedstat")
stat.parent.mkdir(parents=True)
started = time.monotonic()
def wait_for_a_processor():
    while True:
        waited = (time.monotonic() - started) * float(sys.argv[2])
        part = stat.with_suffix(".part")
        part.write_text(f"1000 {int(1e9 * waited)} 7")
        os.replace(part, stat)
        time.sleep(0.02)
threading.Thread(target=wait_for_a_processor, daemon=True).start()
watchdog._PROC = sys.argv[1]
time.sleep(0.1)
with watchdog.Watchdog(1.0, "Nothing is left.", "the solver hangs"):
    time.sleep(4.0)
print("done")
"""


@pytest.mark.parametrize(("share", "code"), [(1.0, 0), (0.1, -signal.SIGABRT)])
def test_what_waits_for_a_processor_does_not_hang(share: float, code: int, tmp_path: Path) -> None:
    """As the kernel counts it: all the time, and a tenth of it."""
    done = subprocess.run(
        [sys.executable, "-c", STARVED, str(tmp_path), str(share)], capture_output=True, text=True, timeout=50
    )
    assert done.returncode == code, done.stderr


def test_the_watcher_ends_with_the_block() -> None:
    with Watchdog(60.0, "", "") as watching:
        process = watching._process
        assert process is not None
        assert process.poll() is None
        heartbeat.beat()
    assert process.poll() == 0
    assert heartbeat.listener is None


# A render of which no path set ends after the eighth.
STUCK = """
import ctypes
from glpath.cli.main import run
from glpath.rendering import loop

step = loop._step
def stuck(engine, context, tiles, film, *more):
    if film.path_sets >= 8:
        ctypes.PyDLL(None).sleep(60)
    return step(engine, context, tiles, film, *more)
loop._step = stuck
run()
"""


def test_a_render_that_hangs_keeps_its_last_checkpoint(tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    options = ["--spp", "64", "--resolution", "16x16", "--max-depth", "1", "--checkpoint", "1i"]
    command = [sys.executable, "-c", STUCK, "render", "cornell-box-36", "-o", str(out), *options]
    done = subprocess.run([*command, "--hang-limit", "2s"], capture_output=True, text=True, timeout=100)
    assert done.returncode == -signal.SIGABRT, done.stderr
    assert f"The last checkpoint is {out}, where one was written; --resume continues from it." in done.stderr
    assert "in stuck" in done.stderr
    assert Film.load(out).path_sets == 8


# A solver of which no step ends after the eighth; its kernels are there.
STUCK_SOLVER = """
import ctypes
import glpath
from glpath.cli.main import run
from glpath.radiosity.solvers.progressive import Refinement

glpath.solve_radiosity("cornell-box-36", patches=60, receiver_points=1)
step = Refinement.step
def stuck(solver, *energy):
    if solver.steps >= 8:
        ctypes.PyDLL(None).sleep(60)
    return step(solver, *energy)
Refinement.step = stuck
run()
"""


def test_a_solver_that_hangs_keeps_its_last_checkpoint(tmp_path: Path) -> None:
    out, checkpoint = tmp_path / "s.npz", tmp_path / "s.checkpoint.npz"
    options = ["--patches", "60", "--receiver-points", "1", "--checkpoint", "0.0001s", "--hang-limit", "4s"]
    command = [sys.executable, "-c", STUCK_SOLVER, "radiosity", "cornell-box-36", "-o", str(out), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert done.returncode == -signal.SIGABRT, done.stderr
    assert "nothing was done for 4 s: the solver hangs, or a step of it, " in done.stderr
    assert f"The last checkpoint is {checkpoint}, where one was written; --resume continues from it." in done.stderr
    assert "in stuck" in done.stderr
    with np.load(checkpoint) as state:
        assert int(state["steps"]) == 8
    assert not out.exists()


def test_work_that_is_announced_as_long_does_not_hang() -> None:
    """As a checkpoint on a slow disk; after it, silence counts again."""
    command = [sys.executable, "-I", "-S", "-c", watchdog._CODE]
    with (
        subprocess.Popen(["sh", "-c", "ulimit -c 0; exec sleep 20"]) as watched,
        subprocess.Popen([*command, str(watched.pid), "0.1", "hung", "/proc"], stdin=subprocess.PIPE) as watching,
    ):
        assert watching.stdin is not None
        watching.stdin.write(b".p")
        watching.stdin.flush()
        time.sleep(0.4)
        assert watched.poll() is None
        watching.stdin.write(b".")
        watching.stdin.flush()
        assert watched.wait(timeout=30) == -signal.SIGABRT
        watching.stdin.close()


def test_watchdog_pauses_while_a_checkpoint_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[bytes] = []
    dog = Watchdog(60.0, "", "")
    monkeypatch.setattr(dog, "_process", SimpleNamespace(stdin=SimpleNamespace(fileno=lambda: 99)))
    monkeypatch.setattr(watchdog.os, "write", lambda _, text: sent.append(text))
    monkeypatch.setattr(heartbeat, "listener", dog._beat)
    heartbeat.beat()
    heartbeat.beat()  # too soon after the first
    CheckpointFile(tmp_path / "a.npz").written_by(lambda path: sent.append(b"saved"), 1)
    assert sent == [b".", b"p", b"saved", b"."]
