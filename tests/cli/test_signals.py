"""A signal at a bad moment: the program ends as it says, and does not crash."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from glpath.rendering import interrupts
from glpath.rendering.interrupts import interrupt_as_flag
from glpath.system.signals import REPEATED
from tests.support.killing import default_signals

INTERRUPTED = """
import os, signal, _moderngl
make = _moderngl.make_uniform
def broken_off(*given):
    os.kill(os.getpid(), signal.SIGINT)
    return make(*given)
_moderngl.make_uniform = broken_off
import glpath
try:
    glpath.render("cornell-box-36", resolution=(8, 8), spp=1)
except KeyboardInterrupt:
    print("interrupted")
"""

IN_CODE_FROM_TEXT = """
import sys
from glpath.cli import main, scenes
text = "import os, signal; os.kill(os.getpid(), signal.{name}); [None for _ in range(1000)]"
scenes.shipped_scenes = lambda: exec(text)
sys.argv = ["glpath", "scenes"]
main.run()
"""

WITH_A_RESULT = """
import os, signal, sys
from glpath.cli import main, scenes
from glpath.cli.signals import hold
def scenes_and_signals():
    hold()
    for _ in range(5):
        os.kill(os.getpid(), signal.{name})
    return {{}}
scenes.shipped_scenes = scenes_and_signals
sys.argv = ["glpath", "scenes"]
main.run()
"""


def test_a_signal_waits_until_a_program_is_compiled() -> None:
    """moderngl's C code crashes where a function of Python that it calls is broken off."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_the_exit_code_is_ours_wherever_the_signal_came(name: str, tmp_path: Path) -> None:
    """That of `python -m` is Python's where a KeyboardInterrupt went through code from text, as of dataclasses."""
    (tmp_path / "broken_off.py").write_text(IN_CODE_FROM_TEXT.format(name=name))
    done = subprocess.run(
        [sys.executable, "-m", "broken_off"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        preexec_fn=default_signals,
    )
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("SIGHUP", "interrupted: all was done and is written"),  # of the kernel, and of the shell
        ("SIGXCPU", "interrupted: all was done and is written"),  # once a second
        ("SIGTERM", "interrupted"),
    ],
)
def test_signals_that_repeat_by_themselves_do_not_give_up_the_result(name: str, end: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_RESULT.format(name=name)],
        capture_output=True,
        text=True,
        preexec_fn=default_signals,
    )
    assert (done.returncode, done.stderr.splitlines()[-1]) == (130, f"glpath: {end}")


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT])
def test_signal_that_the_parent_ignores_stays_ignored(number: signal.Signals) -> None:
    """As nohup and a shell's background jobs rely on it."""
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_RESULT.format(name=number.name)],
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_IGN),
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


@pytest.mark.parametrize("number", REPEATED)
def test_second_hangup_does_not_break_into_a_path_set(number: signal.Signals) -> None:
    before = signal.signal(number, signal.default_int_handler)
    try:
        with interrupt_as_flag() as flag:
            for _ in range(3):
                signal.raise_signal(number)
            assert (bool(flag), flag.signal) == (True, number)
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", REPEATED)
def test_path_set_that_takes_long_is_left_after_a_hangup(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interrupts, "_GRACE", 0.1)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            wait_through(number)
    finally:
        signal.signal(number, before)


def wait_through(number: signal.Signals) -> None:
    with interrupt_as_flag():
        signal.raise_signal(number)
        time.sleep(20)
