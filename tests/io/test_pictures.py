"""Pictures that models name wrongly: found in another case or folder; if they are missing, a warning."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image

from glpath import load_scene
from glpath.errors import SceneError
from glpath.film.image import decode_srgb
from glpath.io.completed import aside
from glpath.scene.model import Scene

BROWN = (120, 80, 40)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
UV = np.array([[0, 0], [1, 0], [0, 1]], "<f4")


def obj(folder: Path, name: str) -> Path:
    (folder / "a.obj").write_text(
        "mtllib A.MTL\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {name}\n")
    return folder / "a.obj"


def gltf(folder: Path, name: str, **material: object) -> Path:
    (folder / "a.bin").write_bytes(TRIANGLE.tobytes() + UV.tobytes())
    pbr = {"baseColorTexture": {"index": 0}, "metallicFactor": 0}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": pbr, **material}],
        "textures": [{"source": 0}],
        "images": [{"uri": name}],
        "buffers": [{"uri": "A.bin", "byteLength": 60}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 24},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            },
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }
    (folder / "a.gltf").write_text(json.dumps(document))
    return folder / "a.gltf"


FORMATS = {"obj": obj, "gltf": gltf}


def read(path: Path) -> tuple[Scene, list[str]]:
    with warnings.catch_warnings(record=True) as caught, aside("camera", "light"):
        warnings.simplefilter("always")
        scene = load_scene(path)
    return scene, [str(each.message) for each in caught]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("stored", "name", "is_moved"),
    [
        ("wood.png", "wood.png", False),
        ("wood.png", "Wood.PNG", False),
        ("Tex/wood.png", "tex/Wood.png", False),
        ("tex/wood.png", "tex\\wood.png", False),
        ("wood.png", "tex/wood.png", True),
        ("wood.png", "/home/somebody/tex/wood.png", True),
        ("wood.png", "C:\\models\\tex\\Wood.png", True),
        ("wood.png", "../textures/wood.png", True),
        ("maps/wood.png", "wood.png", True),
        ("50% oak.png", "50% oak.png", False),
        ("50% oak.png", "C:\\models\\50% Oak.png", True),
    ],
)
def test_a_picture_is_found_in_another_case_or_folder(
    tmp_path: Path, form: str, stored: str, name: str, is_moved: bool
) -> None:
    (tmp_path / stored).parent.mkdir(exist_ok=True)
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / stored)
    scene, messages = read(FORMATS[form](tmp_path, quote(name) if form == "gltf" else name))
    assert [texture.image[0, 0, :3].tolist() for texture in scene.textures] == [list(BROWN)]
    assert len(messages) == is_moved
    assert all("Folders that names of files have or lack" in message for message in messages)


@pytest.mark.parametrize("form", FORMATS)
def test_a_missing_picture_is_a_warning(tmp_path: Path, form: str) -> None:
    scene, messages = read(FORMATS[form](tmp_path, "gone.png"))
    assert scene.textures == ()
    assert [message.partition("not used: ")[2] for message in messages] == [
        'The texture "gone.png", which does not exist.'
    ]


def test_a_surface_does_not_glow_for_a_missing_map_of_its_light(tmp_path: Path) -> None:
    path = gltf(tmp_path, "gone.png", emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0})
    scene, _ = read(path)
    assert not scene.shapes[0].emission.any()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("suffix", ["bmp", "gif", "tif", "png", "webp"])
def test_formats_of_pillow_are_read(tmp_path: Path, form: str, suffix: str) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / f"wood.{suffix}", lossless=True)
    scene, messages = read(FORMATS[form](tmp_path, f"wood.{suffix}"))
    assert [texture.image[0, 0, :3].tolist() for texture in scene.textures] == [list(BROWN)]
    assert messages == []


def test_a_mesh_of_no_vertices_is_left_out(tmp_path: Path) -> None:
    path = gltf(tmp_path, "wood.png")
    document = json.loads(path.read_text())
    document["accessors"].append({"componentType": 5126, "count": 0, "type": "VEC3"})
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 2}})
    path.write_text(json.dumps(document))
    scene, _ = read(path)
    assert scene.areas.sum() == 0.5


def test_no_file_outside_of_the_folder_is_read(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "secret.png")
    (tmp_path / "model").mkdir()
    with pytest.raises(SceneError, match="outside the folder"):
        read(gltf(tmp_path / "model", "../secret.png"))
    assert "outside the folder" in read(obj(tmp_path / "model", "../secret.png"))[1][0]


def mitsuba(folder: Path, name: str) -> Path:
    texture = f'<texture name="reflectance" type="bitmap"><string name="filename" value="{name}"/></texture>'
    shape = f'<shape type="rectangle"><bsdf type="diffuse">{texture}</bsdf></shape>'
    (folder / "a.xml").write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{shape}</scene>')
    return folder / "a.xml"


@pytest.mark.parametrize("name", ["Wood.BMP", "tex/wood.bmp", "/home/somebody/wood.bmp"])
def test_mitsuba_finds_pictures_as_models_do(tmp_path: Path, name: str) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "wood.bmp")
    scene, _ = read(mitsuba(tmp_path, name))
    assert scene.textures[0].image[0, 0, :3].tolist() == list(BROWN)


def test_mitsuba_warns_of_a_missing_picture(tmp_path: Path) -> None:
    scene, messages = read(mitsuba(tmp_path, "gone.png"))
    assert [message for message in messages if "gone.png, which does not exist: grey" in message] == messages[:1]
    assert decode_srgb(scene.textures[0].image[0, 0] / 255) == pytest.approx([0.5] * 3, abs=0.005)
