"""`figure models`: every file has its line, its picture or the reason why there is none."""

from __future__ import annotations

import importlib.util
import json
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.figures import models as figure
from benchmarks.figures.models import Shown
from benchmarks.peers import other_python
from glpath.errors import GlpathError, UsageError
from tests.support.figure_reports import holds_by_its_rule
from tests.support.gltf_files import Gltf
from tests.support.models import gltf, obj


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two models, one that is cut off, and one that has nothing to show."""
    below = tmp_path / "strangers" / "deep"
    below.mkdir(parents=True)
    gltf(below / "box.gltf")
    obj(below / "box.obj")
    (below / "cut.glb").write_bytes(b"glTF" + bytes(30))
    (tmp_path / "empty").mkdir()
    Gltf().write(tmp_path / "empty", "empty.gltf")
    monkeypatch.setenv(figure.FOLDERS, f"{tmp_path / 'strangers'}{os.pathsep}{tmp_path / 'empty'}")
    return tmp_path


def test_each_model_is_rendered_or_refused_with_its_reason(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figure, "_peers", lambda: ((), ["without mitsuba: gone"]))
    result = CliRunner().invoke(app, ["figure", "models", "--scale", "0.05", "-o", str(folder / "out")])
    assert result.exit_code == 0, result.output
    report = json.loads((folder / "out" / "models.json").read_text())
    assert report["holds"] is True is holds_by_its_rule(report)
    assert report["notes"] == ["without mitsuba: gone"]
    rows = {Path(row["file"]).name: row for row in report["rows"]}
    assert set(rows) == {"box.gltf", "box.obj", "cut.glb", "empty.gltf"}
    for name in ("box.gltf", "box.obj"):
        row = rows[name]
        assert (row["status"], row["triangles"]) == ("rendered", 12)
        assert "no light, so a white sky" in row["notes"]
        assert min(row["load_seconds"], row["render_seconds"]) > 0
        assert 50 < row["peak_mib"] < 4000
    assert "cut.glb" in rows["cut.glb"]["message"]
    assert "no triangles" in rows["empty.gltf"]["message"]
    assert {rows[name]["status"] for name in ("cut.glb", "empty.gltf")} == {"refused"}
    assert (report["measured"]["models"], report["measured"]["without_message"]) == (4, 0)


def test_a_model_that_ends_its_process_is_no_refusal() -> None:
    crashed = figure._run(["python3", "-c", "import os, sys; sys.stdin.read(); os.abort()"], {})
    assert crashed["status"] == "crashed"
    measured = figure._measured([Shown({"status": "refused", "message": "why"}), Shown(crashed)])
    assert (measured["refused"], measured["without_message"]) == (1, 1)


def test_a_difference_is_one_of_blocks_not_of_noise() -> None:
    rng = np.random.default_rng(1)
    one = np.full((32, 32, 3), 2.0)
    differs, ratio = figure.difference(one, one + rng.normal(0, 0.1, one.shape))
    assert differs < 0.01
    assert ratio == pytest.approx(1, abs=0.01)
    half = one.copy()
    half[:, 16:] = 0
    assert figure.difference(half, one) == (0.5, 0.5)


@pytest.mark.parametrize("named", ["", "/nowhere/at/all"])
def test_it_says_how_to_name_models(named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(figure.FOLDERS, named)
    monkeypatch.setattr(figure, "DEBIAN", tmp_path / "none")
    with pytest.raises(UsageError, match=r"GLPATH_MODELS.*assimp-testmodels"):
        figure.found()
    monkeypatch.setenv(figure.FOLDERS, str(tmp_path))
    with pytest.raises(UsageError, match="no models in"):
        figure.found()


@pytest.mark.evidence
@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="needs the extra reference")
def test_mitsuba_and_blender_show_the_same_box(folder: Path) -> None:
    peers = {"mitsuba"}
    try:
        other_python.find_package("bpy", other_python.python())
        peers.add("blender")
    except GlpathError:
        pass
    (folder / "here").mkdir()
    asked = {"side": 64, "spp": 128, "max_depth": 5, "folder": str(folder / "here")}
    shown = figure._shown(folder / "strangers" / "deep" / "box.gltf", asked, sorted(peers))
    assert set(shown.pictures) == {"glpath", *peers}, shown.row
    for name in peers:
        # Mitsuba's and Blender's bases under microfacets are other ones than glTF's.
        assert shown.row[f"{name}_differs"] < 0.03
