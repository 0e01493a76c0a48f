"""pyrr is imported without a warning, as on a Python that has not compiled it yet."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.repository import ROOT


def test_no_warning_comes_of_pyrr(tmp_path: Path) -> None:
    """Compiled anew: a folder for bytecode of its own, which is empty."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", "from glpath.system.pyrr_matrices import matrix33"],
        env={"PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_nothing_else_imports_pyrr() -> None:
    users = [path for path in (ROOT / "glpath").rglob("*.py") if "from pyrr" in path.read_text("utf-8")]
    assert [path.name for path in users] == ["pyrr_matrices.py"]
