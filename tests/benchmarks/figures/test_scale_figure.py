"""`figure scale`: its scenes, its fits, its files; and that its claim does not hold of other costs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.figures import scale as figure
from benchmarks.figures.scale import FINENESS, balls, crossing, exponent, scenes
from benchmarks.peers import mitsuba as mitsuba_peer
from glpath.errors import GlpathError
from tests.support.figure_reports import holds_by_its_rule


@pytest.mark.parametrize("fineness", [0, 3])
def test_the_balls_are_as_many_triangles_as_it_says_and_show_about_the_same(fineness: int) -> None:
    scene = balls(fineness, 32)
    assert len(scene.triangles) == 12 + 15 * 20 * 4**fineness
    low, high = scene.bounds
    assert np.all(low >= -1.01)
    assert np.all(high <= 1.01)
    centres = scene.shapes[-1].world_from_object[:, :, 3]
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) + 9 * np.eye(len(centres))
    assert apart.min() > 2 * 0.22
    ball = scene.areas[12:].sum() / 15
    assert ball == pytest.approx(4 * np.pi * 0.22**2, rel=0.25 if fineness == 0 else 0.02)


def test_the_family_goes_from_36_to_five_million() -> None:
    assert 12 + 15 * 20 * 4 ** FINENESS[-1] == 4_915_212
    assert len(scenes(1.0)) == 1 + len(FINENESS)
    assert [len(make().triangles) for make in scenes(0.003)] == [36, 312, 1212, 4812]


def test_an_exponent_is_that_of_the_large_scenes() -> None:
    rows = [{"triangles": n, "s": 5.0 if n < 1000 else 1e-3 * n**0.75} for n in (36, 300, 1200, 4800, 20_000)]
    assert exponent(rows, "s") == pytest.approx(0.75)
    assert math.isnan(exponent(rows[:3], "s"))
    assert exponent([*rows, {"triangles": 80_000, "s": None}], "s") == pytest.approx(0.75)


def test_own_rays_are_ahead_from_where_they_stay_so() -> None:
    rows = [
        {"triangles": n, "path_s": 1.0, "scans_s": s} for n, s in ((36, 2.0), (300, 0.5), (1200, 3.0), (4800, 9.0))
    ]
    assert crossing(rows) == 1200
    assert crossing(rows[:2]) == math.inf
    assert crossing([*rows, {"triangles": 20_000, "path_s": 1.0, "scans_s": None}]) == 1200


@pytest.fixture
def without_mitsuba(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(*_):
        raise GlpathError("Mitsuba 3 cannot be imported.", "pip install")

    monkeypatch.setattr(mitsuba_peer, "load_mitsuba", absent)


@pytest.mark.usefixtures("without_mitsuba")
def test_a_small_figure_has_its_files_and_a_verdict_by_its_rule(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["figure", "scale", "--scale", "0.003", "-o", str(tmp_path)])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "scale.json").read_text())
    assert report["holds"] is holds_by_its_rule(report)
    assert "Mitsuba 3 cannot be imported" in report["notes"][0]
    assert [row["triangles"] for row in report["rows"]] == [36, 312, 1212, 4812]
    for row in report["rows"]:
        assert min(row["path_s"], row["scans_s"], row["path_setup_s"]) > 0
        assert 0 < row["seen_by_eye"] <= min(row["triangles"], 32 * 32)
        assert row["mitsuba_s"] is None
    assert report["measured"]["scans_mean_off"] < 0.1


def measured_rows(own: float, scans: float, mean: float = 1.0):
    """Rows of engines whose times go with these powers of the number of triangles."""

    def row(scene, with_scans, with_mitsuba):
        n = len(scene.triangles)
        names = ("path", "scans", "mitsuba")
        row = {"triangles": n, "seen_by_eye": 36, "path_s": 0.05 * n**own, "scans_s": 0.01 * n**scans}
        row |= {"mitsuba_s": None, "mitsuba_mean": None, "path_mean": 1.0, "scans_mean": mean}
        return row | {f"{name}_setup_s": None if name == "mitsuba" else 1.0 for name in names}

    return row


@pytest.mark.usefixtures("without_mitsuba")
@pytest.mark.parametrize(
    ("own", "scans", "mean", "holds"),
    [(0.1, 0.9, 1.0, True), (0.5, 0.9, 1.0, False), (0.1, 0.3, 1.0, False), (0.1, 0.9, 0.8, False)],
)
def test_the_claim_holds_of_no_other_cost_and_no_other_picture(own, scans, mean, holds, monkeypatch) -> None:
    monkeypatch.setattr(figure, "_row", measured_rows(own, scans, mean))
    monkeypatch.setattr(figure, "plot", lambda *_, **__: np.zeros((1, 1, 3), np.uint8))
    assert figure.figure_scale(0.003, lambda text: None).report.holds is holds


@pytest.mark.evidence  # needs the reference extra
def test_a_small_figure_has_mitsuba_beside_it() -> None:
    report = figure.figure_scale(0.003, lambda text: None).report
    # Nine samples of 32 x 32 pixels: 1 % of noise, and the worst of four scenes counts.
    assert report.measured["mitsuba_mean_off"] < 0.05
    assert all(row["mitsuba_s"] > 0 for row in report.rows)
