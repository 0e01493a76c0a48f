"""Starts renders in separate processes and kills them, for tests of checkpoints."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from glpath.film.film import Film
from glpath.system.signals import ENDING

#: A small scene for "path": about a millisecond per path set.
SMALL = ("cornell-box-36", "--resolution", "24x16", "--max-depth", "2")
RENDER = ("render", *SMALL)


def default_signals() -> None:
    """Undo what the parent ignores, such as SIGHUP under nohup. Call it in a child before its program starts."""
    for number in ENDING:
        signal.signal(number, signal.SIG_DFL)


def start(*arguments: object, command: Sequence[str] = RENDER) -> subprocess.Popen[str]:
    """Start a command of glpath with progress as JSON."""
    command = [sys.executable, "-m", "glpath", *command, *map(str, arguments), "--progress", "json"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=default_signals)


def until_rendering(process: subprocess.Popen[str]) -> str:
    """Read all lines up to the first that reports path sets which this process has done."""
    read = []
    assert process.stderr is not None
    for line in process.stderr:
        read.append(line)
        if line.startswith("{") and json.loads(line)["stage"] == "rendering":
            break
    return "".join(read)


def struck(number: int, *arguments: object, command: Sequence[str] = RENDER) -> tuple[int, str]:
    """Send a signal to a render while it renders; return the exit code and the output."""
    with start(*arguments, command=command) as process:
        told = until_rendering(process)
        process.send_signal(number)
        assert process.stderr is not None
        told += process.stderr.read()
    return process.returncode, told


def kill_again_and_again(
    out: Path, times: int, seed: int, command: Sequence[str] = RENDER, checkpoint: Path | None = None
) -> list[int]:
    """Kill a render repeatedly at random moments; each continues from the checkpoint of the last path set.

    Half of the moments are before the first path set, or close to it. Returns the path sets in the checkpoint after
    each kill; asserts that they are never fewer than before, nor than the render had reported.

    checkpoint : path of the checkpoint, if it is not `out`
    """
    checkpoint = out if checkpoint is None else checkpoint
    choice = random.Random(seed)
    kept = [0]
    for i in range(times):
        with start("-o", out, "--spp", 10**6, "--checkpoint", "1i", "--resume", command=command) as process:
            told = "" if i % 2 else until_rendering(process)
            time.sleep(choice.uniform(0, 1.2 if i % 2 else 0.3))
            process.send_signal(signal.SIGKILL)
            assert process.stderr is not None
            told += process.stderr.read()
        assert process.returncode == -signal.SIGKILL, told
        events = [json.loads(line) for line in told.splitlines() if line.startswith("{") and line.endswith("}")]
        reported = max((event["done"] for event in events), default=0)
        film = Film.load(checkpoint) if checkpoint.exists() else None
        kept.append(0 if film is None else film.path_sets)
        assert kept[-1] >= max(kept[-2], reported)
        assert film is None or film.ranges == ((0, film.path_sets),)
    return kept[1:]
