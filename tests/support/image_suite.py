"""Suites of image tests that pytester runs: fixtures of the pytest plugin's tests.

PYTEST_DONT_REWRITE, because test modules import it and name it as their plugin.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

# Load these here once, because pytester unloads the modules that its run has loaded.
import glpath.apps.image_tests.report
import glpath.rendering.calls  # noqa: F401
from glpath.accel.bvh import build_bvh

Run = Callable[..., pytest.RunResult]

# Disable nbmake, which takes a second to load, and faulthandler, because at its end a run would disable that of the
# testing process. If glpath is installed, pytest finds the plugin itself.
LOADED = ("-p", "no:nbmake", "-p", "no:faulthandler")
if not any(e.value == "glpath.apps.image_tests" for e in entry_points(group="pytest11")):
    LOADED += ("-p", "glpath.apps.image_tests")

_CRASHING = ("mitsuba", "drjit")

GREY = """
import numpy as np

def test_grey(render_regression):
    render_regression(np.full((8, 8, 3), {level}))
"""


@pytest.fixture(scope="session")
def _numba_is_loaded() -> None:
    """Load the parts of numba that it loads late, because they cannot be loaded twice."""
    build_bvh(np.zeros((2, 3)), np.ones((2, 3)))


@pytest.fixture
def run(_numba_is_loaded: None, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs the suite in pytester's folder, by default not as in CI."""
    monkeypatch.delenv("CI", raising=False)
    pytester.makeini("[pytest]")

    def run_with(*options: str | Path) -> pytest.RunResult:
        # To show a failing test, pytest asks all modules for their files, which crashes for one of Mitsuba's.
        hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] in _CRASHING}
        try:
            return pytester.runpytest_inprocess(*LOADED, *map(str, options))
        finally:
            sys.modules.update(hidden)

    return run_with


@pytest.fixture
def suite(pytester: pytest.Pytester) -> Callable[[str], Path]:
    """Return a function that writes test_a.py."""

    def write(text: str) -> Path:
        (pytester.path / "test_a.py").write_text(text)
        shutil.rmtree(pytester.path / "__pycache__", ignore_errors=True)
        return pytester.path / "baseline" / "test_a"

    return write
