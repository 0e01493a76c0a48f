"""`python -m benchmarks khronos`: a page of sample models, each with its mark, also where Cycles is absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.khronos import beside_cycles
from benchmarks.khronos.beside_cycles import Beside, differences
from benchmarks.khronos.models import Mark, find_models, mark_of
from benchmarks.khronos.page import write_page
from benchmarks.khronos.verdict import report_of
from benchmarks.peers import other_python
from glpath.errors import GlpathError, UsageError
from tests.support.gltf_files import Gltf
from tests.support.sample_models import write_models


def test_models_are_found_in_the_layout_of_khronos(tmp_path: Path) -> None:
    write_models(tmp_path, ["Sheen", "ClearCoat"])
    binary = tmp_path / "Models" / "Sheen" / "glTF-Binary"
    binary.mkdir()
    (binary / "Sheen.glb").write_bytes(b"")
    (tmp_path / "Models" / "README.md").write_text("")
    for folder in (tmp_path, tmp_path / "Models"):
        found = find_models(folder)
        assert [(model.name, model.file.suffix) for model in found] == [("ClearCoat", ".gltf"), ("Sheen", ".glb")]
    assert [model.name for model in find_models(tmp_path, ["Sheen"])] == ["Sheen"]
    with pytest.raises(UsageError, match="no model Duck"):
        find_models(tmp_path, ["Duck"])
    with pytest.raises(UsageError, match="no models"):
        find_models(binary)
    with pytest.raises(UsageError, match="not a folder"):
        find_models(tmp_path / "none")


@pytest.mark.parametrize(
    ("material", "limit"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}, 1.5),
        ({"extensions": {"KHR_materials_emissive_strength": {}, "ACME_glitter": {}}, "name": "x"}, 2.5),
        ({"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_sheen": {}}}, 3.0),
        (
            {
                "pbrMetallicRoughness": {"metallicFactor": 0},
                "extensions": {"KHR_materials_specular": {}, "KHR_materials_clearcoat": {}},
            },
            3.0,
        ),
        ({"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_specular": {}}}, 2.5),
        ({"extensions": {"KHR_materials_sheen": {}, "KHR_materials_iridescence": {}}}, None),
    ],
)
def test_a_mark_is_that_of_the_materials(tmp_path: Path, material: dict[str, Any], limit: float | None) -> None:
    file = Gltf().one_triangle(**material)
    assert mark_of(file.write(tmp_path)).limit == limit
    (tmp_path / "a.glb").write_bytes(file.glb())
    assert mark_of(tmp_path / "a.glb") == mark_of(tmp_path / "model.gltf")


def test_what_an_animation_poses_has_no_mark(tmp_path: Path) -> None:
    file = Gltf().one_triangle()
    file.add("skins", joints=[0])
    assert mark_of(file.write(tmp_path)).limit is not None
    file.add("animations", channels=[], samplers=[])
    assert mark_of(file.write(tmp_path)).limit is None


def test_a_difference_is_the_mean_of_eight_bit_values() -> None:
    one = np.full((20, 10, 3), 100, np.uint8)
    other = one.copy()
    other[0] = 120
    found = differences(one, other, Mark(("plain",), 0.9))
    assert found == {"difference": 1.0, "worst_tenth": 10.0, "holds": False}
    assert differences(one, one, Mark((), None))["holds"] is None


def test_a_page_shows_what_fails_and_links_its_pictures(tmp_path: Path) -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    row = {"model": "A<B", "status": "rendered", "limit": 1.5, "difference": 2.0, "holds": False, "notes": "a & b"}
    found = [
        Beside(row | {"processor_seconds": 17.0}, {"glpath": picture, "cycles": picture + 4}),
        Beside({"model": "Gone", "status": "refused", "message": "why"}),
    ]
    text = write_page(found, tmp_path / "page", "words").read_text()
    assert text.count('class="fails"') == 1
    assert "A&lt;B" in text
    assert "a &amp; b" in text
    assert "why" in text
    assert {path.name for path in (tmp_path / "page").glob("*.png")} == {
        f"A<B-{kind}.png" for kind in ("glpath", "cycles", "difference")
    }
    report = report_of(found, 8, [])
    assert report.holds is False
    assert (report.measured["missed_marks"], report.measured["not_rendered"]) == (1, 1)
    assert report.measured["slower_than_the_aim"] == 1


def test_without_cycles_the_pictures_are_glpaths_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(package: str, interpreter: str) -> tuple[str, str]:
        raise GlpathError("no bpy")

    monkeypatch.setattr(beside_cycles.other_python, "find_package", absent)
    write_models(tmp_path, ["VertexColor"])
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["khronos", str(tmp_path), "-o", str(out), "--side", "16"])
    assert result.exit_code == 0, result.output
    report = json.loads((out / "khronos.json").read_text())
    assert report["holds"] is None
    assert report["notes"] == ["without Cycles: no bpy"]
    (row,) = report["rows"]
    assert row["status"] == "rendered"
    assert 0 < row["processor_seconds"] < 60
    assert (out / "VertexColor-glpath.png").stat().st_size > 100
    assert "VertexColor" in (out / "index.html").read_text()


@pytest.mark.parametrize("arguments", [[], ["nowhere"], ["FOLDER", "--side", "8"]])
def test_wrong_usage_is_explained(arguments: list[str], tmp_path: Path) -> None:
    write_models(tmp_path, ["VertexColor"])
    arguments = [str(tmp_path) if each == "FOLDER" else each for each in arguments]
    result = CliRunner().invoke(app, ["khronos", *arguments, "-o", str(tmp_path / "out")])
    assert result.exit_code != 0
    assert not (tmp_path / "out").exists()


@pytest.mark.evidence
def test_plain_metal_is_cycles(tmp_path: Path) -> None:
    try:
        other_python.find_package("bpy", other_python.python())
    except GlpathError as error:
        pytest.skip(str(error))
    write_models(tmp_path, ["WhiteMetal", "Sheen"])
    found, _ = beside_cycles.compare_models(find_models(tmp_path), 96, lambda text: None)
    for each in found:
        assert each.row["holds"], each.row
