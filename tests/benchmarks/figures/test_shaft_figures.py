"""The figures of SC, each made small, and the polyhedra that they are drawn with."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.figures import shaft, style
from benchmarks.office_table import OFFICES
from glpath.notebook import shaft_scene
from glpath.radiosity import Containment, Shaft

DRAWN = list(shaft.FIGURES)


def made(name: str, folder: Path) -> tuple[dict, list[dict[str, str]]]:
    result = CliRunner().invoke(app, ["figure", name, "--scale", "0.02", "-o", str(folder)])
    assert result.exit_code == 0, result.output
    picture = iio.imread(folder / f"{name}.png")
    assert picture.shape[1] >= 480
    assert np.any(picture < 100)
    assert np.all(picture[:, -6:] == 255), "something runs over the edge"
    rows = list(csv.DictReader((folder / f"{name}.csv").read_text().splitlines()))
    report = json.loads((folder / f"{name}.json").read_text())
    assert len(rows) == len(report["rows"]) >= 3
    assert all(isinstance(value, float) for value in report["measured"].values())
    return report, rows


@pytest.mark.parametrize("name", DRAWN)
def test_what_is_drawn_is_what_the_paper_says(name: str, tmp_path: Path) -> None:
    report, rows = made(name, tmp_path)
    assert report["holds"] is True, report["measured"]
    assert {"hi.z", "n.x", "distance"} <= set(rows[0])


def test_figure_3_follows_from_the_shaft(monkeypatch: pytest.MonkeyPatch) -> None:
    # With object 5 outside as well, a single one is left of B, which replaces it.
    moved = shaft.OBJECTS.copy()
    moved[4] = moved[5]
    monkeypatch.setattr(shaft, "OBJECTS", moved)
    outcome = shaft.figure_3(1.0, lambda _: None)
    assert outcome.report.holds is False
    by_node = {row["what"]: row for row in outcome.report.rows}
    assert by_node["B"]["on the list of"] == "keep closed"
    assert by_node["4"]["on the list of"] == "always open, overlap open, ratio open 0.4"


def test_table_1_has_all_rows_and_both_savings(tmp_path: Path) -> None:
    report, rows = made("shaft-table-1", tmp_path)
    assert [row["scene"] for row in rows] == [OFFICES[0]] * 8 + [OFFICES[1]] * 8
    assert float(rows[0]["paper tests/ray"]) == 44.6
    measured = report["measured"]
    assert measured["closed_tests_gain_office"] > 1.2
    assert 0.02 < measured["emitter_list_saves_premesh"] < 0.4
    best = min(float(row["tests/ray"]) for row in rows[4:8])
    assert measured["tests_gain_office"] == pytest.approx(float(rows[0]["tests/ray"]) / best)
    assert report["notes"] == ["at scale 0.02, receiver points 2 m apart and 1 of 10 lights"]


# Polyhedra


def test_a_box_has_six_faces_and_its_volume() -> None:
    planes = shaft_scene.box_planes([1, 2, 3, 2, 4, 6])
    assert [len(f) for f in shaft_scene.faces(planes)] == [4] * 6
    assert shaft.volume(planes) == pytest.approx(1 * 2 * 3)
    # A tetrahedron of legs 0.5 off the far corner.
    cut = np.concatenate([planes, [[1.0, 1.0, 1.0, -11.5]]])
    assert shaft.volume(cut) == pytest.approx(6 - 0.5**3 / 6)
    assert [len(f) for f in shaft_scene.faces(cut)] == [4, 4, 4, 5, 5, 5, 3]


def test_a_plane_that_only_touches_has_no_face() -> None:
    planes = np.concatenate([shaft_scene.box_planes([0, 0, 0, 1, 1, 1]), [[1, 1, 0, -2.0]]])
    assert [len(f) for f in shaft_scene.faces(planes)] == [4] * 6 + [0]


def test_the_gap_to_a_hull_is_never_too_large_and_nearly_exact() -> None:
    corners = shaft_scene.box_corners([0, 0, 0, 1, 1, 1])
    points = np.random.default_rng(3).uniform(-1, 2, (200, 3))
    exact = np.linalg.norm(points - points.clip(0, 1), axis=1)
    gap = shaft.farthest_gap(corners, points)
    assert np.all(gap <= exact + 1e-12)
    assert np.all(gap >= 0.98 * exact - 0.02)


def test_figure_4s_count_finds_only_spheres_that_are_outside() -> None:
    box = [0, 0, 0, 1, 1, 1]
    shaft_of_one = Shaft.between(box, box)  # a box: Arvo's test is exact
    false, called = shaft._false_spheres(shaft_of_one, 300)
    assert (false, called > 50) == (0, True)
    assert Containment.OVERLAPPING in shaft_of_one.classify_spheres([[1.2, 0.5, 0.5]], [0.3])


def test_a_table_keeps_within_its_page() -> None:
    page = style.table("Title", "Caption", [("a", 300), ("b\nc", 200)], [["A heading"], ["x", "1.0"]])
    assert page.shape[1] == 532
    assert np.all(page[:, -6:] == 255)
    assert np.any(page < 100)
