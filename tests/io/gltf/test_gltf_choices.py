"""Animations and variants of materials: one is chosen by name or number."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from glpath import SceneWarning, UsageError, load_scene
from glpath.cli.main import app
from glpath.io import scene_animations, scene_variants
from glpath.scene import Scene
from tests.support.gltf_files import Gltf

pytestmark = pytest.mark.filterwarnings("ignore::glpath.SceneWarning")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A red triangle, green in the variant "Meadow", which "Walk" moves along x and "Jump" along y."""
    made = Gltf().one_triangle(pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 1]})
    green = made.add("materials", pbrMetallicRoughness={"baseColorFactor": [0, 1, 0, 1]})
    for name, seconds, to in (("Walk", 2.0, [4, 0, 0]), ("Jump", 1.0, [0, 3, 0])):
        sampler = {"input": made.accessor([0.0, seconds]), "output": made.accessor([[0, 0, 0], to])}
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        made.add("animations", name=name, samplers=[sampler], channels=[channel])
    made.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "Desert"}, {"name": "Meadow"}]}}
    made.json["extensionsUsed"] = ["KHR_materials_variants"]
    (primitive,) = made.json["meshes"][0]["primitives"]
    primitive["extensions"] = {"KHR_materials_variants": {"mappings": [{"material": green, "variants": [1]}]}}
    return made.write(tmp_path)


def corner(scene: Scene) -> list[float]:
    return [float(x) for x in scene.bounds[0]]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, [0, 0, 0]),
        ({"animation": "Walk", "time": 1.0}, [2, 0, 0]),
        ({"animation": "1", "time": "0.5"}, [0, 1.5, 0]),
        ({"animation": "Jump"}, [0, 0, 0]),
        ({"time": 1.0}, [2, 0, 0]),
        ({"animation": "all", "time": 1.0}, [0, 3, 0]),  # the later one has the node
    ],
)
def test_the_first_animation_runs_or_one_or_all(path: Path, given: dict[str, object], expected: list[float]):
    assert corner(load_scene(path, given)) == pytest.approx(expected)


def test_animations_that_do_not_run_are_named(path: Path):
    with pytest.warns(
        SceneWarning, match=r'not used: Animations after the first, "Walk": the parameter animation runs another'
    ):
        load_scene(path, {"time": 1.0})
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*not used")
        load_scene(path, {"time": 1.0, "animation": "Walk"})


def test_a_chosen_animation_alone_moves_what_a_shutter_sees(path: Path):
    scene = load_scene(path, {"animation": "Walk", "time": 0.0, "shutter": 1.0})
    assert corner(scene.still(1.0)) == pytest.approx([2, 0, 0])


@pytest.mark.parametrize(
    ("given", "colour"),
    [
        ({}, [1, 0, 0]),
        ({"variant": "Meadow"}, [0, 1, 0]),
        ({"variant": "1"}, [0, 1, 0]),
        ({"variant": "Desert"}, [1, 0, 0]),
    ],
)
def test_a_variant_has_its_materials_and_else_the_files(path: Path, given: dict[str, object], colour: list[int]):
    scene = load_scene(path, given)
    (shape,) = scene.shapes
    material = scene.materials[shape.material]
    assert np.allclose(scene.mean_reflectance(material) > 0.5, colour)


def test_what_is_not_there_names_the_nearest(path: Path):
    with pytest.raises(UsageError, match=r'animation "walk" .* 0 "Walk", 1 "Jump"') as error:
        load_scene(path, {"animation": "walk"})
    assert error.value.remedy == 'Did you mean "Walk"?'
    with pytest.raises(UsageError, match=r'variant "7" .* 0 "Desert", 1 "Meadow"'):
        load_scene(path, {"variant": "7"})
    none = Gltf().one_triangle().write(path.parent, "none.gltf")
    with pytest.raises(UsageError, match="its variants are: none"):
        load_scene(none, {"variant": "Meadow"})


def test_info_lists_them_and_options_choose_them(path: Path):
    assert scene_animations(str(path)) == (("Walk", 2.0), ("Jump", 1.0))
    assert scene_variants(str(path)) == ("Desert", "Meadow")
    result = CliRunner().invoke(app, ["info", str(path), "--animation", "Walk", "--time", "1", "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["animations"] == [{"name": "Walk", "seconds": 2.0}, {"name": "Jump", "seconds": 1.0}]
    assert found["variants"] == ["Desert", "Meadow"]
    assert found["bounds"]["min"] == [2, 0, 0]
    table = CliRunner().invoke(app, ["info", str(path)])
    assert "animations: 0 Walk (2 s), 1 Jump (1 s)" in " ".join(table.output.split())
    twice = CliRunner().invoke(app, ["info", str(path), "--variant", "Meadow", "-D", "variant=Desert"])
    assert twice.exit_code == 2
    assert "--variant beside -D variant=Desert" in twice.output
