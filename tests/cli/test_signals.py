"""A signal at a bad moment: the program ends as it says, and does not crash."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
def test_the_exit_code_is_ours_wherever_the_signal_came(name: str, tmp_path: Path) -> None:
    """That of `python -m` is Python's where a KeyboardInterrupt went through code from text, as of dataclasses."""
    (tmp_path / "broken_off.py").write_text(IN_CODE_FROM_TEXT.format(name=name))
    done = subprocess.run([sys.executable, "-m", "broken_off"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr
