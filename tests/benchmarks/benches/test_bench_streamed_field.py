"""`bench streamed-field`: its triangles, and a small run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.benches import streamed_field
from benchmarks.benches.height_field import hills
from benchmarks.benches.streamed_field import TILE, bench_streamed_field, predicted, write_tiles
from benchmarks.verdict import judge


def test_tiles_are_the_triangles_of_the_field(tmp_path: Path) -> None:
    field = hills(2 * TILE + 1)
    write_tiles(field, 2, tmp_path / "field.npy")
    found = np.load(tmp_path / "field.npy")
    vertices, faces = field.triangles()
    expected = vertices[faces].astype(np.float32)
    assert np.array_equal(np.unique(found.reshape(-1, 9), axis=0), np.unique(expected.reshape(-1, 9), axis=0))
    assert np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2].min() > 0


def test_the_law_is_a_power_of_the_triangles_for_rays_and_their_number_for_trees() -> None:
    rows = [{"triangles": t, "build_s": 2e-6 * t, "core_s": 2e-6 * t + 3 * (t / 1e6) ** 0.25} for t in (1e6, 4e6)]
    assert predicted(rows, 16_000_000) == pytest.approx(32 + 3 * 2)


def test_rays_that_took_no_time_have_no_law_and_fail_the_claim() -> None:
    rows = [{"triangles": t, "build_s": b, "core_s": c} for t, b, c in ((1e4, 0.2, 0.3), (1e5, 1.02, 0.98))]
    law = predicted(rows, 1_000_000)
    assert np.isnan(law)
    numbers = {"law_off": 1.0 / law, "seconds": 1.0, "budget_share": 0.5, "off_memory": 0.0, "resumed": 1.0}
    assert not judge(streamed_field.CLAIM, streamed_field.RULE, numbers)[1]


def test_a_small_bench_measures_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streamed_field, "SMALL_TILES", (1, 2, 3))
    said: list[str] = []
    report = bench_streamed_field(0.001, said.append)
    assert said == ["32,768 triangles", "131,072 triangles", "294,912 triangles"]
    assert report.measured["points"] == 1000
    assert report.measured["off_memory"] < 1e-4
    assert report.measured["resumed"] == 1
    assert report.measured["core_s"] > 0
