"""The entry point of the command, before its modules are loaded."""

from __future__ import annotations

import subprocess
import sys

INTERRUPTED_WHILE_LOADING = """
import runpy, sys

class Interrupts:
    def find_spec(self, name, *rest):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupts())
sys.argv = ["glpath", "--version"]
runpy.run_module("glpath", run_name="__main__")
"""


def test_an_interrupt_while_modules_load_shows_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_WHILE_LOADING], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "Interrupted.\n")
