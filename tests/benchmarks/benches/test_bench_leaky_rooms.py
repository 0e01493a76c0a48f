"""`bench leaky-rooms`: its estimates, its rule, and a small run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.benches import leaky_rooms
from benchmarks.benches.leaky_rooms import Estimate, bench_leaky_rooms, blocks, compared
from glpath.errors import UsageError


def test_blocks_are_16_pixels_wide_and_high() -> None:
    grid = blocks(128, 96).reshape(96, 128)
    assert grid.max() == 47
    assert (np.bincount(grid.ravel()) == 256).all()
    assert (grid[:16, :16] == 0).all()
    assert grid[16, 0] == 8


def test_a_dark_block_is_compared_with_2_percent_of_the_mean() -> None:
    reference = Estimate(np.array([1.0, 0.001]), np.array([0.0, 0.0]), 1.0, 0.0)
    found = Estimate(np.array([1.1, 0.005]), np.array([0.01, 0.0]), 1.1, 0.0)
    row = compared(found, reference)
    assert row["mean"] == pytest.approx(0.1)
    assert row["worst"] == pytest.approx(0.004 / 0.02)
    assert row["worst_beyond"] == pytest.approx(0.2)


def test_a_small_run_finds_the_leak_of_a_lamp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(leaky_rooms, "RESOLUTION", (32, 32))
    monkeypatch.setattr(leaky_rooms, "mitsuba_mean", lambda scene: (float("nan"), float("nan")))
    report = bench_leaky_rooms(("pictures",), 0.008, rooms=("lamp-1cm",))
    assert [row["product"] for row in report.rows] == ["auto", "gather"]
    assert report.measured.keys() >= {"auto_mean_off", "auto_worst_off", "gather_mean_off"}
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    assert bench_leaky_rooms(("pictures",), 0.008, rooms=("lamp-1cm",)).rows[0]["mean"] == report.rows[0]["mean"]


def test_an_unknown_part_is_refused() -> None:
    with pytest.raises(UsageError, match="'sky'; allowed are pictures, lookups, solution, lightmap, probes"):
        bench_leaky_rooms(("sky",))
