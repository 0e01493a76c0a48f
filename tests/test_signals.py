"""A signal at a bad moment: the program ends as it says, and does not crash."""

from __future__ import annotations

import subprocess
import sys

import pytest

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


def test_a_signal_waits_until_a_program_is_compiled() -> None:
    """moderngl's C code crashes where a function of Python that it calls is broken off."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_the_exit_code_is_ours_wherever_the_signal_came(name: str) -> None:
    """Python has its own where a KeyboardInterrupt went through code from text, as dataclasses make it."""
    done = subprocess.run(
        [sys.executable, "-c", IN_CODE_FROM_TEXT.format(name=name)], capture_output=True, text=True
    )
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr
