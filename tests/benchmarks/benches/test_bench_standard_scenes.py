"""The bench `standard-scenes`: on scenes of our own export, and what it says of a folder that has none."""

from __future__ import annotations

from pathlib import Path

import pytest

import glpath
from benchmarks.benches.standard_scenes import bench_standard_scenes
from glpath.errors import GlpathError


def test_a_folder_without_scenes_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    with pytest.raises(GlpathError, match="has no scenes"):
        bench_standard_scenes(tmp_path)


@pytest.mark.evidence
def test_an_exported_box_has_the_picture_that_mitsuba_makes_of_it(tmp_path: Path) -> None:
    """And a file that is refused is named."""
    pytest.importorskip("mitsuba")
    (tmp_path / "box").mkdir()
    glpath.export("cornell-box", tmp_path / "box" / "scene.xml")
    (tmp_path / "curves.xml").write_text('<scene version="3.0.0"><shape type="linearcurve"/></scene>')
    report = bench_standard_scenes(tmp_path, seeds=2, scale=0.5)
    assert (report.measured["scenes"], report.measured["refused"]) == (1, 1)
    assert report.measured["worst_mean_off"] < 0.02
    assert report.holds is False  # of five that are asked for there is one
    assert any("curves.xml" in note and "linearcurve" in note for note in report.notes)
    (row,) = report.rows
    assert row["scene"] == "box/scene.xml"
    assert row["glpath_s"] > 0
    assert row["mitsuba_s"] > 0
