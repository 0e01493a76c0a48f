"""Light of glTF assets beside an environment map and beside lights in watts."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import glpath
from glpath.film.exr import write_exr
from glpath.scene.model import Scene
from glpath.system.units import EFFICACY
from tests.support.gltf_files import Gltf

CAMERA = "camera = { position = [0, 0, 4], target = [0, 0, 0] }\n"
ASSET = '[[assets]]\nfile = "lamp.gltf"\n'
MAP = '[sky]\nfile = "one.exr"\n'
LAMP = '[[lights]]\ntype = "point"\nposition = [0, 0, 3]\nintensity = 1\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A triangle that emits 1, and an environment map of 1 everywhere."""
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 1.0}}
    Gltf().one_triangle(emissiveFactor=[1, 1, 1], extensions=strong).write(tmp_path, "lamp.gltf")
    write_exr(tmp_path / "one.exr", np.ones((4, 8, 3), np.float32))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def loaded(text: str, **parameters: Any) -> tuple[Scene, str]:
    Path("a.toml").write_text(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = glpath.load_scene(Path("a.toml"), parameters)
    return scene, "\n".join(str(each.message) for each in caught)


def ratio(scene: Scene) -> float:
    """Emission of the triangle over the radiance of the map."""
    assert scene.sky is not None
    (shape,) = scene.shapes
    return float(shape.emission[0] / scene.sky.radiance(np.array([[0.0, 0, 1]]))[0, 0])


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("text", "parameters"),
    [
        (CAMERA + ASSET + MAP, {}),
        (CAMERA + ASSET, {"environment": "one.exr"}),
        ('unit = "photometric"\n' + CAMERA + ASSET + MAP, {}),
    ],
    ids=["sky", "environment", "photometric"],
)
def test_one_in_a_map_and_one_in_gltf_are_the_same_radiance(text: str, parameters: dict[str, Any]) -> None:
    """As in Blender, three.js and model-viewer, and as a glTF file alone is with `--environment`."""
    scene, said = loaded(text, **parameters)
    assert ratio(scene) == pytest.approx(1)
    assert "two units" not in said
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert ratio(glpath.load_scene("lamp.gltf", {"environment": "one.exr"})) == pytest.approx(1)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "text",
    [
        'unit = "radiometric"\n' + CAMERA + ASSET + MAP,
        CAMERA + ASSET + 'unit = "photometric"\n' + MAP,
        CAMERA + ASSET + MAP + 'unit = "radiometric"\n',
    ],
    ids=["of the file", "of the asset", "of the sky"],
)
def test_a_unit_that_is_named_holds(text: str) -> None:
    scene, _ = loaded(text)
    assert ratio(scene) == pytest.approx(1 / EFFICACY)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("more", ["", MAP])
def test_light_in_two_units_is_warned_of_once(more: str) -> None:
    _, said = loaded(CAMERA + ASSET + ASSET + LAMP + more)
    assert said.count("light is in two units. The numbers of lamp.gltf are taken") == 1
    for text in (
        'unit = "radiometric"\n' + CAMERA + ASSET + LAMP,
        CAMERA + ASSET + 'unit = "photometric"\n' + LAMP,
        CAMERA + ASSET + LAMP + 'unit = "radiometric"\n',
        CAMERA + ASSET,
    ):
        assert "two units" not in loaded(text)[1]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("unit", "expected"), [({}, 1.0), ({"unit": "radiometric"}, 1 / EFFICACY)])
def test_meshes_of_trimesh_are_as_assets_beside_a_map(unit: dict[str, str], expected: float) -> None:
    mesh = trimesh.creation.box()
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((len(mesh.vertices), 2)),
        material=trimesh.visual.material.PBRMaterial(emissiveFactor=[1.0, 1.0, 1.0]),
    )
    data = {
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
        "sky": {"file": "one.exr"},
        "shapes": [{"mesh": mesh}],
    }
    assert ratio(glpath.load_scene({**data, **unit})) == pytest.approx(expected)
