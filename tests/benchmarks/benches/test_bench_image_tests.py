"""The bench `image-tests`: what glpath finds in its project, and how it is judged beside pytest-mpl."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from benchmarks.benches import image_tests
from benchmarks.benches.image_tests import bench_image_tests
from benchmarks.image_suite import figures

SEEN = [change for change in figures.CHANGES if change not in figures.UNSEEN]


def test_all_changes_of_the_project_are_seen_in_its_figures() -> None:
    """But for those that nobody sees."""
    numpy = pytest.importorskip("numpy")
    plt = pytest.importorskip("matplotlib.pyplot")

    def pixels(change: str) -> object:
        figure = figures.figure_of(change, 0)
        figure.canvas.draw()
        drawn = numpy.asarray(figure.canvas.buffer_rgba()).astype(int)
        plt.close(figure)
        return drawn

    with pytest.MonkeyPatch.context() as patch, plt.style.context("classic"):
        before = pixels("nothing")
        patch.setenv(figures.CHANGED, "yes")
        assert (pixels("nothing") == before).all()
        for change in SEEN:
            after = pixels(change)
            assert after.shape != before.shape or abs(after - before).max() >= 5, change
        assert abs(pixels("background-by-one-level") - before).max() == 1


def test_the_verdict_is_by_what_both_find(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of runs that are played: pytest-mpl finds what glpath misses, and glpath more."""
    every = {f"{change}-{copy}" for change, copy in figures.CASES}
    seen = {case for case in every if not case.startswith(figures.UNSEEN)}
    found = {"pytest_mpl": seen - {"title-0"}, "glpath": seen - {"size-0", "size-1"} | {"nothing-0"}}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)

    def failing(folder: Path, program: str, told: dict[str, set[str]]) -> float:
        told[program] = found[program]
        return 1.0

    monkeypatch.setattr(image_tests, "_failing_s", failing)
    monkeypatch.setattr(image_tests, "_run", lambda *a, **k: image_tests.subprocess.CompletedProcess([], 0))
    report = bench_image_tests(rounds=1)
    measured = report.measured
    assert (measured["glpath_missed"], measured["pytest_mpl_missed"], measured["glpath_false"]) == (2, 1, 1)
    assert report.holds is False
    row = next(row for row in report.rows if row["change"] == "size")
    assert row == {"change": "size", "glpath": "0 of 2", "pytest_mpl": "2 of 2"}
    found["glpath"] = seen
    assert bench_image_tests(rounds=1).holds is True


@pytest.mark.evidence
def test_glpath_finds_each_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """In its own run, without the other; where pytest-mpl is installed, too, what that finds."""
    report = bench_image_tests(rounds=1)
    assert report.measured["glpath_found"] == report.measured["changed"] == figures.COPIES * len(SEEN)
    assert report.measured["glpath_false"] == 0
    assert report.holds is (True if importlib.util.find_spec("pytest_mpl") else None)
