"""glTF files that are broken or mean harm: each is refused by name, at once, and as a scene's error."""

from __future__ import annotations

import copy
import json
import os
import struct
import time
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from gltf_files import Gltf, glb
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from glpath.errors import SceneError
from glpath.scene.formats.gltf.load import read_gltf

Change = Callable[[dict[str, Any]], None]


def plain() -> Gltf:
    """A textured triangle with indices, a camera, a light and an animation."""
    file = Gltf()
    texture = file.texture([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], wrapS=33071)
    material = file.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": texture}})
    mesh = file.mesh(indices=[0, 1, 2], TEXCOORD_0=[[0, 0], [1, 0], [0, 1]], material=material)
    node = file.node(mesh=mesh, translation=[0, 0, 1])
    camera = file.add("cameras", type="perspective", perspective={"yfov": 0.7, "znear": 0.1})
    seen = file.node(camera=camera, translation=[0, 0, 5])
    lamp = file.node(extensions={"KHR_lights_punctual": {"light": 0}})
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 3}]}}
    file.json["extensionsUsed"] = ["KHR_lights_punctual"]
    times, moved = file.accessor([0.0, 1.0]), file.accessor([[0, 0, 0], [1, 0, 0]])
    file.add(
        "animations",
        channels=[{"sampler": 0, "target": {"node": node, "path": "translation"}}],
        samplers=[{"input": times, "output": moved}],
    )
    file.add("scenes", nodes=[node, seen, lamp])
    file.json["scene"] = 0
    return file


def refused(path: Path) -> SceneError:
    """The error of a file, which comes within a second and has a remedy or a place."""
    begun = time.perf_counter()
    with pytest.raises(SceneError) as caught:
        read_gltf(path, time=0.5)
    assert time.perf_counter() - begun < 2.0
    assert path.name in str(caught.value)
    return caught.value


def changed(folder: Path, change: Change) -> Path:
    file = plain()
    document = file.whole()
    change(document)
    path = folder / "model.gltf"
    path.write_text(json.dumps(document))
    return path


def set_at(*keys: str | int, value: Any) -> Change:
    def change(document: dict[str, Any]) -> None:
        part: Any = document
        for key in keys[:-1]:
            part = part[key]
        part[keys[-1]] = value

    return change


def nested(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth):
        value = [value]
    return value


HOSTILE: dict[str, tuple[Change, str]] = {
    "a buffer outside the folder": (set_at("buffers", 0, "uri", value="../secret.bin"), "outside|folder"),
    "an absolute path": (set_at("buffers", 0, "uri", value="/etc/passwd"), "outside|folder|absolute"),
    "an escape in percents": (set_at("buffers", 0, "uri", value="%2e%2e%2fsecret.bin"), "outside|folder"),
    "another scheme": (set_at("buffers", 0, "uri", value="http://localhost/x.bin"), "scheme|http"),
    "a file scheme": (set_at("buffers", 0, "uri", value="file:///etc/passwd"), "scheme|file"),
    "a NUL in a path": (set_at("buffers", 0, "uri", value="a\0b"), "buffers"),
    "a very long path": (set_at("buffers", 0, "uri", value="a" * 5000), "buffers"),
    "an image outside": (set_at("images", 0, value={"uri": "../x.png"}), "outside|folder"),
    "a longer buffer than there is": (set_at("buffers", 0, "byteLength", value=10**9), "byte"),
    "a negative length": (set_at("bufferViews", 0, "byteLength", value=-4), "byteLength"),
    "a view beyond the buffer": (set_at("bufferViews", 2, "byteOffset", value=10**6), "bufferViews"),
    "a view of an absurd offset": (set_at("bufferViews", 2, "byteOffset", value=2**63), "bufferViews"),
    "a stride of zero": (set_at("bufferViews", 2, "byteStride", value=0), "byteStride"),
    "a stride that leads out": (set_at("bufferViews", 1, "byteStride", value=252), "accessors|bufferViews"),
    "billions of elements": (set_at("accessors", 0, "count", value=2**40), "count|accessors"),
    "billions of zeros": (
        set_at("accessors", 1, value={"componentType": 5126, "count": 2**33, "type": "VEC3"}),
        "count|zeros|accessors",
    ),
    "an index beyond the vertices": (
        set_at("meshes", 0, "primitives", 0, "indices", value=99),
        "indices|accessors",
    ),
    "an unknown component type": (set_at("accessors", 0, "componentType", value=5), "componentType"),
    "an unknown type": (set_at("accessors", 0, "type", value="VEC9"), "type"),
    "a node in itself": (set_at("nodes", 0, "children", value=[0]), "nodes"),
    "nodes in a circle": (
        lambda d: (d["nodes"][0].update(children=[1]), d["nodes"][1].update(children=[0]))[0],
        "nodes",
    ),
    "a node with two parents": (
        lambda d: (d["nodes"][0].update(children=[2]), d["nodes"][1].update(children=[2]))[0],
        "nodes",
    ),
    "a node that is not there": (set_at("scenes", 0, "nodes", value=[77]), "nodes"),
    "a mesh that is not there": (set_at("nodes", 0, "mesh", value=7), "mesh"),
    "a material that is not there": (set_at("meshes", 0, "primitives", 0, "material", value=7), "material"),
    "a matrix of huge numbers": (set_at("nodes", 0, value={"mesh": 0, "matrix": [1e300] * 16}), "matrix|nodes"),
    "a matrix of fifteen": (set_at("nodes", 0, value={"mesh": 0, "matrix": [1] * 15}), "matrix"),
    "a rotation of zeros": (set_at("nodes", 0, "rotation", value=[0, 0, 0, 0]), "rotation"),
    "a text for a number": (set_at("nodes", 0, "mesh", value="0"), "mesh"),
    "a table for a list": (set_at("nodes", value={"0": {}}), "nodes"),
    "a list for a table": (set_at("meshes", 0, value=[]), "meshes"),
    "a number for a text": (set_at("materials", 0, "alphaMode", value=3), "alphaMode"),
    "true for a number": (set_at("accessors", 0, "count", value=True), "count"),
    "no asset": (lambda d: d.pop("asset") and None, "asset"),
    "another version": (set_at("asset", "version", value="3.0"), "version"),
    "a fov of half a turn": (set_at("cameras", 0, "perspective", "yfov", value=4.0), "yfov"),
    "a light of another kind": (
        set_at("extensions", "KHR_lights_punctual", "lights", 0, "type", value="laser"),
        "type",
    ),
    "a light below zero": (
        set_at("extensions", "KHR_lights_punctual", "lights", 0, "intensity", value=-1),
        "intensity",
    ),
    "an extension that must be known": (set_at("extensionsRequired", value=["ACME_magic"]), "ACME_magic"),
    "animation times that go back": (set_at("accessors", -2, "count", value=3), "accessors|animations"),
    "a JSON a hundred deep": (set_at("extras", value=nested(100)), "deep|nested"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_at_its_place(name: str, tmp_path: Path) -> None:
    change, place = HOSTILE[name]
    error = refused(changed(tmp_path, change))
    assert any(part in str(error) for part in place.split("|")), str(error)


def test_the_file_that_they_are_made_of_is_read(tmp_path: Path) -> None:
    model = read_gltf(changed(tmp_path, lambda _: None), time=0.5)
    assert (len(model.shapes), len(model.lights), len(model.cameras), len(model.textures)) == (1, 1, 1, 1)


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "data.bin").write_bytes(bytes(10_000))
    inside = tmp_path / "inside"
    inside.mkdir()
    os.symlink(outside / "data.bin", inside / "data.bin")
    error = refused(changed(inside, set_at("buffers", 0, "uri", value="data.bin")))
    assert "folder" in str(error)


def test_a_picture_of_a_billion_pixels_is_refused_by_its_header(tmp_path: Path) -> None:
    header = struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    data = b"IDAT" + zlib.compress(bytes(100))
    png += struct.pack(">I", len(data) - 4) + data + struct.pack(">I", zlib.crc32(data))
    (tmp_path / "large.png").write_bytes(png)
    error = refused(changed(tmp_path, set_at("images", 0, value={"uri": "large.png"})))
    assert "40,000" in str(error)


@pytest.mark.parametrize("length", [0, 3, 4, 11, 12, 15, 19, 20, 60, 400])
def test_a_truncated_glb_is_refused(length: int, tmp_path: Path) -> None:
    path = tmp_path / "model.glb"
    path.write_bytes(plain().glb()[:length])
    refused(path)


@pytest.mark.parametrize("text", [b"", b"null", b"[]", b"{", b'{"asset": {"version": "2.0"}', b"\xff\xfe{}"])
def test_what_is_no_document_is_refused(text: bytes, tmp_path: Path) -> None:
    for name, content in (("model.gltf", text), ("model.glb", glb(text, b""))):
        path = tmp_path / name
        path.write_bytes(content)
        refused(path)


VALUES: list[Any] = [
    None,
    True,
    -1,
    0,
    1,
    3,
    2**31,
    2**64,
    0.5,
    -1e30,
    1e300,
    "",
    "MASK",
    "x" * 300,
    [],
    [0],
    [0, 0, 0],
    [1e300] * 16,
    {},
    {"index": 9},
]


def places(value: Any, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Of all values in a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, each in items for place in ((*here, key), *places(each, (*here, key)))]


DOCUMENT = plain().whole()
BINARY = plain().glb()
PLACES = places(DOCUMENT)


def read_or_refused(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            read_gltf(path, time=0.25)
            told = path.name
        except SceneError as error:
            told = str(error)
    assert path.name in told


@settings(
    max_examples=150,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    changes=st.lists(st.tuples(st.integers(0, len(PLACES) - 1), st.sampled_from(VALUES)), min_size=1, max_size=3)
)
def test_any_value_anywhere_is_read_or_refused(changes: list[tuple[int, Any]], tmp_path: Path) -> None:
    document = copy.deepcopy(DOCUMENT)
    for place, value in changes:
        try:
            set_at(*PLACES[place], value=copy.deepcopy(value))(document)
        except (KeyError, IndexError, TypeError):
            continue  # another change has taken the place away
    path = tmp_path / "model.gltf"
    path.write_text(json.dumps(document))
    read_or_refused(path)


@settings(
    max_examples=150,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    changes=st.lists(st.tuples(st.integers(0, len(BINARY) - 1), st.integers(0, 255)), min_size=1, max_size=4),
    end=st.integers(0, len(BINARY)),
    cut=st.booleans(),
)
def test_any_bytes_are_read_or_refused(changes: list[tuple[int, int]], end: int, cut: bool, tmp_path: Path) -> None:
    content = bytearray(BINARY)
    for place, value in changes:
        content[place] = value
    path = tmp_path / "model.glb"
    path.write_bytes(content[:end] if cut else content)
    read_or_refused(path)


def strangers() -> list[Path]:
    """glTF files of Debian's assimp-testmodels."""
    folder = Path("/usr/share/assimp/models")
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in (".gltf", ".glb"))


@pytest.mark.evidence
def test_strangers_files_are_read_or_refused() -> None:
    """Those of glTF 2.0; broken ones lie in folders of their own."""
    files = strangers()
    if not files:
        pytest.skip("assimp-testmodels is not installed")
    read = 0
    for path in files:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                read_gltf(path)
                read += 1
            except SceneError as error:
                told = str(error)
                assert path.name in told, told
    assert read >= len(files) // 2
