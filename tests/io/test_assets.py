"""[[assets]]: models placed in a scene, with their own materials or the scene's."""

from __future__ import annotations

import base64
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath import load_scene
from glpath.cli.main import app
from glpath.errors import SceneError, SceneWarning
from glpath.io import scene_schema
from glpath.io.completed import aside
from glpath.io.description import scene_schema as described
from glpath.io.gltf import read_gltf
from glpath.io.gltf.load import OpenFile
from glpath.rendering.job import with_overrides
from glpath.scene import Scene, tessellate
from glpath.scene.model import Mesh
from glpath.scene.source_location import SourceLocation
from tests.support.gltf_files import Gltf
from tests.support.lit_models import CAMERA_AND_LIGHT
from tests.support.models import gltf, obj

HEAD = """
camera = { position = [2, 2, 6], target = [0, 0, 0] }
sky = { zenith = 1 }
[materials.red]
reflectance = [0.8, 0.1, 0.1]
[materials.squares]
texture = "checker"
[textures.checker]
type = "checker"
"""


def written(folder: Path, *assets: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(HEAD + "".join(f"[[assets]]\n{asset}\n" for asset in assets))
    return path


def scene_with(folder: Path, *assets: str) -> Scene:
    return load_scene(written(folder, *assets))


def test_an_asset_is_what_the_file_alone_is(tmp_path: Path) -> None:
    gltf(tmp_path / "box.gltf")
    obj(tmp_path / "box.obj")
    with aside("picture"), pytest.warns(SceneWarning, match="no camera"):
        alone = load_scene(tmp_path / "box.gltf")
    films = []
    for name in ("box.gltf", "box.obj"):
        scene = scene_with(tmp_path, f'file = "{name}"')
        assert np.array_equal(scene.triangles, alone.triangles)
        names = [scene.materials[shape.material].name for shape in scene.shapes]
        assert names == ["box/Paint", "box/Gold"]
        films.append(glpath.render(scene.with_camera(resolution=(24, 16)), spp=4).mean)
    alone = alone.with_camera(resolution=(24, 16), position=scene.camera.position, target=np.zeros(3), fov=40.0)
    films.append(glpath.render(alone, spp=4).mean)
    assert np.array_equal(films[0], films[1])
    assert np.array_equal(films[0], films[2])


def test_a_file_is_read_once_and_its_meshes_are_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from glpath.io import assets as module

    calls = []
    read = module.read_model
    monkeypatch.setattr(module, "read_model", lambda *given: calls.append(given[0]) or read(*given))
    gltf(tmp_path / "box.gltf")
    steps = [f"transform = [{{ translate = [{x}, 0, 0] }}]" for x in range(5)]
    scene = scene_with(tmp_path, *(f'file = "box.gltf"\nname = "box {i}"\n{step}' for i, step in enumerate(steps)))
    assert len(calls) == 1
    assert len(scene.shapes) == 10
    assert len(scene.shapes.meshes) == 2
    assert [material.name for material in scene.materials] == ["red", "squares", "box/Paint", "box/Gold"]
    assert scene.shapes[8].name.startswith("box 4/")
    assert np.allclose(scene.triangles[48:60], scene.triangles[:12] + np.array([4, 0, 0]))


def test_transforms_are_those_of_shapes_and_mirrored_fronts_stay_outside(tmp_path: Path) -> None:
    gltf(tmp_path / "box.gltf", nodes=[{"mesh": 0, "translation": [1, 2, 3], "scale": [1, 2, 1]}])
    steps = "transform = [{ scale = [-2, 1, 1] }, { rotate = { axis = [0, 1, 0], angle = 90 } }]"
    scene = scene_with(tmp_path, f'file = "box.gltf"\n{steps}')
    lower, upper = scene.bounds
    assert np.allclose(lower, [2.5, 1, 1])  # x = -3..-1 goes to z, z = 2.5..3.5 to x
    assert np.allclose(upper, [3.5, 3, 3])
    t = scene.triangles
    assert np.sum(np.cross(t[:, 0], t[:, 1]) * t[:, 2]) / 6 == pytest.approx(4)


def test_materials_of_the_scene_stand_in_for_the_model_s(tmp_path: Path) -> None:
    lit = [
        {"name": "Paint", "emissiveFactor": [1, 1, 1], "doubleSided": True},
        {"name": "Gold", "doubleSided": True},
    ]
    gltf(tmp_path / "box.gltf", materials=lit)
    own, other = 'file = "box.gltf"', 'file = "box.gltf"\nmaterials = { Paint = "red" }'
    scene = scene_with(tmp_path, own, other)
    names = [scene.materials[shape.material].name for shape in scene.shapes]
    assert names == ["box/Paint", "box/Gold", "red", "box/Gold"]
    assert [shape.emits for shape in scene.shapes] == [True, False, False, False]


def test_a_texture_of_the_scene_s_lies_on_a_model_as_on_a_shape(tmp_path: Path) -> None:
    obj(tmp_path / "box.obj")
    asset = 'file = "box.obj"\nmaterials = { Paint = "squares", Gold = "squares" }'
    scene = scene_with(tmp_path, asset, asset)
    path = written(tmp_path)
    path.write_text(HEAD + '[[shapes]]\ntype = "mesh"\nfile = "box.obj"\nmaterial = "squares"\n')
    with pytest.warns(SceneWarning, match="materials in it are not used"):
        shape = load_scene(path)
    assert np.array_equal(np.sort(scene.triangle_uv[:12], axis=0), np.sort(shape.triangle_uv, axis=0))
    assert len(scene.shapes.meshes) == 2


def test_lights_come_along_and_are_placed(tmp_path: Path) -> None:
    gltf(tmp_path / "a.gltf", **CAMERA_AND_LIGHT)
    steps = "transform = [{ scale = 2 }, { translate = [1, 0, 0] }]"
    scene = scene_with(tmp_path, f'file = "a.gltf"\n{steps}', 'file = "a.gltf"\nlights = false')
    (lamp,) = scene.lights
    assert (lamp.name, lamp.position.tolist()) == ("a/Lamp", [1, 6, 0])
    np.testing.assert_allclose(lamp.intensity, np.array([6, 3, 1.5]) / 179)  # candela, in a scene in watts
    assert scene.camera.position.tolist() == [2, 2, 6]  # the scene's, not the model's


def test_an_asset_is_shown_at_a_time(tmp_path: Path) -> None:
    path = gltf(tmp_path / "a.gltf")
    root = json.loads(path.read_text())
    times = np.array([0, 1, 0, 0, 0, 2, 0, 0], "<f4").tobytes()
    root["buffers"].append(
        {"byteLength": 32, "uri": "data:application/octet-stream;base64," + base64.b64encode(times).decode()}
    )
    root["bufferViews"] += [
        {"buffer": 1, "byteLength": 8},
        {"buffer": 1, "byteOffset": 8, "byteLength": 24},
    ]
    root["accessors"] += [
        {"bufferView": 2, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]},
        {"bufferView": 3, "componentType": 5126, "count": 2, "type": "VEC3"},
    ]
    root["animations"] = [
        {
            "samplers": [{"input": 3, "output": 4}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
        }
    ]
    path.write_text(json.dumps(root))
    with pytest.warns(SceneWarning, match="Animations") as caught:
        scene = scene_with(tmp_path, 'file = "a.gltf"', 'file = "a.gltf"\ntime = 0.5')
    assert len(caught) == 1
    assert np.allclose(scene.triangles[12:], scene.triangles[:12] + np.array([1, 0, 0]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        moved = load_scene(path, {"time": 0.5})
    assert np.array_equal(moved.triangles, scene.triangles[12:])


def _sliding_triangle(folder: Path) -> Path:
    """Return a scene file that shows the animation of a triangle, which slides along x by one unit a second."""
    file = Gltf()
    file.one_triangle(doubleSided=True)
    sampler = {"input": file.accessor([0.0, 9.0]), "output": file.accessor([[0, 0, 0], [9, 0, 0]])}
    file.add(
        "animations", samplers=[sampler], channels=[{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    )
    file.write(folder)
    path = folder / "moving.toml"
    asset = 'file = "model.gltf"\ntime = 0'
    path.write_text(
        HEAD.replace("target = [0, 0, 0]", "target = [0, 0, 0], shutter = [1, 2]") + f"[[assets]]\n{asset}"
    )
    return path


@pytest.mark.parametrize("change", ["override", "with_camera", "at"])
def test_a_shutter_beyond_the_one_an_animation_was_read_for_is_told(change: str, tmp_path: Path) -> None:
    scene = load_scene(_sliding_triangle(tmp_path))
    assert scene.animation_times == (1, 2)
    changed = {
        "override": lambda times: with_overrides(scene, None, {"shutter": times}),
        "with_camera": lambda times: scene.with_camera(shutter=times),
        "at": lambda times: scene.at(times[1]),
    }[change]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert changed((1.0, 1.5)).at().triangles[0, 0, 0] == pytest.approx(1.5 if change == "at" else 1.0)
    with pytest.warns(SceneWarning, match="animations of glTF models were read from 1 to 2 s"):
        changed((1.5, 3.0))


def test_a_file_at_several_times_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from glpath.io.gltf import images

    calls = []
    read = images._read_image
    monkeypatch.setattr(images, "_read_image", lambda *given: calls.append(given) or read(*given))
    file = Gltf()
    texture = {"index": file.texture(np.full((2, 2, 3), 9))}
    file.one_triangle(doubleSided=True, pbrMetallicRoughness={"baseColorTexture": texture})
    sampler = {"input": file.accessor([0.0, 9.0]), "output": file.accessor([[0, 0, 0], [9, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    file.add("animations", samplers=[sampler], channels=[channel])
    file.write(tmp_path)
    scene = scene_with(tmp_path, *(f'file = "model.gltf"\ntime = {time}' for time in (1, 2, 4)))
    assert scene.triangles[:, 0, 0].tolist() == [1, 2, 4]
    assert len(calls) == len(scene.shapes.meshes) == 1


def test_decoded_bytes_are_summed_over_the_files_of_a_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"{i}.gltf" for i in range(5)]
    for name in names:
        gltf(tmp_path / name)
    open_files: dict[Path, OpenFile] = {}
    read_gltf(tmp_path / names[0], open_files=open_files)
    each = open_files[tmp_path / names[0]].document.decoded
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DECODED_BYTES", 2 * each)
    scene_with(tmp_path, *(f'file = "{name}"' for name in [*names[:4], *names[:4]]))
    with pytest.raises(SceneError, match=rf"assets\[4\]\.file brings the models .* to {5 * each:,} bytes"):
        scene_with(tmp_path, *(f'file = "{name}"' for name in names))


WRONG = {
    "gone": ('file = "gone.glb"', "assets[1].file names {folder}/gone.glb, which does not exist.\n  Models in"),
    "toml": ('file = "scene.toml"', 'assets[1].file is "scene.toml", but must be a model file that ends in .gltf,'),
    "its material": (
        'file = "box.gltf"\nmaterials = { Pain = "red" }',
        'assets[1].materials.Pain is for a material that box.gltf does not have. It has "Paint", "Gold".\n'
        '  Did you mean "Paint"?',
    ),
    "ours": (
        'file = "box.gltf"\nmaterials = { Paint = "blue" }',
        'assets[1].materials.Paint names the material "blue", but the file defines red, squares.',
    ),
    "no name": (
        'file = "box.gltf"\nmaterials = { Paint = 3 }',
        "assets[1].materials.Paint is 3, but must be a text",
    ),
    "time": (
        'file = "box.obj"\ntime = 1',
        "assets[1].time is for animations of glTF files, but the file is box.obj",
    ),
    "far": ('file = "box.obj"\ntransform = [{ scale = 1e15 }, { scale = 9 }]', "assets[1] reaches beyond 1e+15"),
    "flat": (
        'file = "box.gltf"\ntransform = [{ scale = 1e-200 }, { scale = 1e-200 }]',
        "assets[1].transform flattens the shape: its steps together stretch by [0, 0, 0]",
    ),
    "line": (
        'file = "box.obj"\ntransform = [{ scale = [1, 3e-8, 2e-15] }]',
        'assets[1] ("box/Paint") has 6 triangles, none of which has an area.',
    ),
    "step": ('file = "box.obj"\ntransform = [{}]', "assets[1].transform[0] has nothing, but a step is one of"),
    "field": ('file = "box.obj"\nmaterial = "red"', "assets[1].material is not a field of"),
    "empty": ('file = "empty.gltf"', "assets[1].file names {folder}/empty.gltf, which has no triangles."),
    "broken": ('file = "broken.ply"', "assets[1].file names {folder}/broken.ply, which cannot be read as PLY"),
}


def test_a_triangle_stays_that_has_an_area_in_one_of_several_instances() -> None:
    triangle = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]], np.int32))
    flat, whole = np.diag([1, 0.0, 1, 0])[:3], np.eye(3, 4)
    location = SourceLocation("a")
    assert len(tessellate.with_area(triangle, np.stack([flat, whole]), "a", location).faces) == 1
    with pytest.raises(SceneError, match="none of which has an area"):
        tessellate.with_area(triangle, np.stack([flat, flat]), "a", location)


@pytest.mark.parametrize("case", WRONG)
def test_mistakes_are_told_with_their_place(tmp_path: Path, case: str) -> None:
    gltf(tmp_path / "box.gltf")
    gltf(tmp_path / "empty.gltf", nodes=[{}])
    obj(tmp_path / "box.obj")
    (tmp_path / "broken.ply").write_text("ply\nformat")
    given, message = WRONG[case]
    with pytest.raises(SceneError) as error:
        scene_with(tmp_path, 'file = "box.gltf"', given)
    assert str(error.value).startswith(f"{tmp_path / 'scene.toml'}: {message.format(folder=tmp_path)}")


def test_what_a_file_holds_and_is_not_used_is_said_once(tmp_path: Path) -> None:
    obj(tmp_path / "box.obj", "newmtl Paint\nmap_Kd gone.png\nnewmtl Gold\nKd 1 0 0\n")
    with pytest.warns(SceneWarning, match=r'box.obj: not used: The texture "gone.png"') as caught:
        scene_with(tmp_path, 'file = "box.obj"', 'file = "box.obj"', 'file = "./box.obj"')
    assert len(caught) == 1


def test_schema_and_command_line_know_assets(tmp_path: Path) -> None:
    gltf(tmp_path / "box.gltf")
    assert scene_schema is described
    asset = scene_schema()["$defs"]["Asset"]["properties"]
    assert set(asset) == {"file", "name", "transform", "motion", "materials", "lights", "time", "unit", "up"}
    assert all("description" in field for field in asset.values())
    told = CliRunner().invoke(app, ["validate", str(written(tmp_path, 'file = "box.gltf"'))])
    assert (told.exit_code, told.output[:2]) == (0, "ok"), told.output
