"""The entry point of the command, before its modules are loaded."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.killing import default_signals

INTERRUPTED_WHILE_LOADING = """
import runpy, sys

class Interrupts:
    def find_spec(self, name, *rest):
        if name == wanted:
            raise KeyboardInterrupt

wanted = sys.argv[1]
sys.meta_path.insert(0, Interrupts())
sys.argv = ["glpath", "--version"]
runpy.run_module("glpath", run_name="__main__")
"""


@pytest.mark.parametrize("module", ["glpath.cli.signals", "typer"])
def test_an_interrupt_while_modules_load_shows_no_traceback(module: str) -> None:
    command = [sys.executable, "-c", INTERRUPTED_WHILE_LOADING, module]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "Interrupted.\n")


def test_the_entry_point_imports_nothing_before_it_handles_interrupts() -> None:
    code = "import sys; before = {*sys.modules}; import glpath.__main__; print(*{*sys.modules} - before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert set(done.stdout.split()) <= {"__future__", "glpath", "glpath.__main__"}


REMOVED_FOLDER = "import os, sys; os.rmdir(os.getcwd()); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"


def test_a_removed_current_folder_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "removed"
    folder.mkdir()
    code = (
        "import os; from glpath.system.files import absolute_path; print(absolute_path('/a')); absolute_path('a')"
    )
    done = subprocess.run(
        [sys.executable, "-c", REMOVED_FOLDER, "-c", code], cwd=folder, capture_output=True, text=True
    )
    assert done.stdout == "/a\n"
    assert "GlpathError: the current folder does not exist any more" in done.stderr


@pytest.mark.parametrize(
    "variables", [{}, {"COMP_WORDS": "glpath inf"}, {"COMP_WORDS": "a", "COMP_CWORD": "9" * 99}]
)
def test_completion_without_the_variables_of_the_shell_is_an_error(variables: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "glpath", "info"],
        env=os.environ | {"_GLPATH_COMPLETE": "complete_bash"} | variables,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("glpath: error: _GLPATH_COMPLETE: needs COMP_WORDS and COMP_CWORD"), done.stderr


STRUCK_WHILE_LOADING = """
import os, runpy, signal, sys

class Strikes:
    def find_spec(self, name, *rest):
        if name == wanted:
            os.kill(os.getpid(), signal.SIGTERM)

wanted = sys.argv.pop(1)
sys.meta_path.insert(0, Strikes())
runpy.run_module("glpath", run_name="__main__")
"""


@pytest.mark.parametrize("module", ["typer", "glpath.cli.viewfactors"])
@pytest.mark.parametrize(
    ("option", "code"), [("--resume", 75), ("--checkpoint=1h", 75), ("--quiet", -signal.SIGTERM)]
)
def test_scheduler_s_signal_while_modules_load_has_its_exit_code(module: str, option: str, code: int) -> None:
    command = [sys.executable, "-c", STRUCK_WHILE_LOADING, module, "viewfactors", "cornell-box-36", option]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=default_signals)
    if module != "typer" and code < 0:
        code = 130  # the handlers of commands are there
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert ("start it again" in done.stderr) == (code == 75 and module == "typer"), done.stderr
