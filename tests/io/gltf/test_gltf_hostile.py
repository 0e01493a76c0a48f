"""glTF files that are broken or mean harm: each is refused by name, at once, and as a scene's error."""

from __future__ import annotations

import copy
import cProfile
import json
import os
import re
import struct
import time
import tracemalloc
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.io.gltf import accessors, compression, load
from glpath.io.gltf.compression import draco_counts
from glpath.io.gltf.document import read_document
from glpath.io.gltf.load import read_gltf
from glpath.io.gltf.table import Table
from glpath.scene.source_location import SourceLocation
from tests.support.damaged import write_jpeg_of_scans
from tests.support.gltf_files import Gltf, glb, ktx2_of_solid_blocks

#: Maximum number of Python calls per material of a file of many materials.
MAX_CALLS = 650

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
    """The error of a file, which names it and comes soon: by CPU time, as machines are shared."""
    begun = time.process_time()
    with pytest.raises(SceneError) as caught:
        read_gltf(path, time=0.5)
    assert time.process_time() - begun < 4.0
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


def test_pictures_that_unfold_to_much_together_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 4 * 512 * 512)
    file = Gltf()
    textures = [file.texture(np.zeros((512, 512, 3), np.uint8)) for _ in range(3)]
    materials = [file.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": i}}) for i in textures]
    for material in materials:
        file.node(mesh=file.mesh(TEXCOORD_0=[[0, 0], [1, 0], [0, 1]], material=material))
    (tmp_path / "model.gltf").write_text(json.dumps(file.whole()))
    assert re.search(r"images\[1\] .* no more than 256 times", str(refused(tmp_path / "model.gltf")))


def test_a_very_deep_chain_of_nodes_is_refused(tmp_path: Path) -> None:
    def chain(document: dict[str, Any]) -> None:
        count = len(document["nodes"])
        document["nodes"] += [{"children": [count + i + 1]} for i in range(20_000)] + [{}]

    assert "more than 10,000 deep" in str(refused(changed(tmp_path, chain)))


def test_jpeg_of_many_scans_is_refused(tmp_path: Path) -> None:
    write_jpeg_of_scans(tmp_path / "many.jpg", 100)
    error = refused(changed(tmp_path, set_at("images", 0, value={"uri": "many.jpg"})))
    assert "it is a JPEG of more than 100 scans" in str(error)


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


def test_names_cannot_command_a_terminal(tmp_path: Path) -> None:
    told = "\x1b[31mred\u202e\n"
    for change in (
        set_at("extensionsRequired", value=[told]),
        set_at("buffers", 0, "uri", value="../" + told),
    ):
        assert "\x1b" not in str(refused(changed(tmp_path, change)))
    path = changed(tmp_path, set_at("meshes", 0, "name", value=told))
    assert read_gltf(path).shapes[0].name == "[31mred"
    for change in (set_at("extensionsUsed", value=[told]), set_at("images", 0, value={"uri": "../" + told})):
        notes = read_gltf(changed(tmp_path, change)).notes
        assert notes
        assert all(note.isprintable() for note in notes)


@pytest.mark.parametrize("digits", [20, 400, 5000])
def test_numbers_of_many_digits_are_refused(digits: int, tmp_path: Path) -> None:
    path = changed(tmp_path, set_at("nodes", 0, "translation", value=[0, 0, "many"]))
    path.write_text(path.read_text().replace('"many"', "9" * digits))
    refused(path)


def test_a_small_file_does_not_unfold_to_gigabytes(tmp_path: Path) -> None:
    file = Gltf()
    for count in range(4_000_000, 4_000_064):
        zeros = file.add("accessors", componentType=5126, count=count, type="VEC3")
        file.node(mesh=file.add("meshes", primitives=[{"attributes": {"POSITION": zeros}}]))
    assert "may unfold" in str(refused(file.write(tmp_path)))


def test_a_file_of_several_buffers_is_read_and_counted_once(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes(1000))
    (tmp_path / "link.bin").symlink_to("a.bin")
    file = Gltf()
    for uri in ("a.bin", "a.bin", "%61.bin", "./a.bin", "link.bin"):
        file.add("buffers", uri=uri, byteLength=1000)
    document = read_document(file.write(tmp_path))
    first, *others = (document.buffer(index) for index in range(5))
    assert all(other is first for other in others)
    assert document.resolve("a.bin", document.location, is_picture=True) is first
    assert document.stored == (tmp_path / "model.gltf").stat().st_size + 1000


@pytest.mark.parametrize("is_one_node", [False, True], ids=["nodes", "gpu-instances"])
def test_instances_of_a_small_file_do_not_unfold_without_limit(
    is_one_node: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_TRIANGLES", 999)
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_TRIANGLES_RATIO", 0)
    file = Gltf()
    mesh = file.mesh(indices=[0, 1, 2] * 10)
    if is_one_node:
        zeros = file.add("accessors", componentType=5126, count=100, type="VEC3")
        extensions = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": zeros}}}
        nodes = [file.node(mesh=mesh, extensions=extensions)]
    else:
        nodes = [file.node(mesh=mesh) for _ in range(100)]
    file.add("scenes", nodes=nodes)
    error = str(refused(file.write(tmp_path)))
    assert f"nodes[{nodes[-1]}] brings the model, with all instances, to 1,000 triangles" in error
    assert "bytes may have 999." in error


def test_primitives_of_a_small_file_have_a_limited_number_of_instances(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Gltf()
    mesh = file.mesh()
    file.json["meshes"][mesh]["primitives"] *= 10
    nodes = [file.node(mesh=mesh) for _ in range(10)]
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_INSTANCES_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_INSTANCES", 100)
    assert sum(shape.count for shape in read_gltf(path).shapes) == 100
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_INSTANCES", 99)
    assert f"nodes[{nodes[-1]}] brings the model to 100 instances of primitives" in str(refused(path))


@pytest.mark.parametrize("kind", ["skin", "weights", "animated weights"])
def test_primitives_that_nodes_deform_are_limited(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Gltf()
    joints = file.accessor(np.zeros((3, 4)), "uint16")
    mesh = file.mesh(WEIGHTS_0=[[1.0, 0, 0, 0]] * 3)
    primitive = file.json["meshes"][mesh]["primitives"][0]
    primitive["attributes"]["JOINTS_0"] = joints
    file.json["meshes"][mesh]["primitives"] *= 10
    if kind != "skin":
        primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
        nodes = [file.node(mesh=mesh, **({"weights": [i]} if kind == "weights" else {})) for i in range(5)]
    if kind == "animated weights":
        samplers = [{"input": file.accessor([0.0]), "output": file.accessor([float(i)])} for i in range(5)]
        channels = [{"sampler": i, "target": {"node": nodes[i], "path": "weights"}} for i in range(5)]
        file.add("animations", samplers=samplers, channels=channels)
    if kind == "skin":
        file.json["skins"] = [{"joints": [0]} for _ in range(10)]
        nodes = [file.node(mesh=mesh, skin=i) for i in range(10)]
    file.add("scenes", nodes=nodes)
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.limits.BYTES_PER_DEFORMED", 2**40)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DEFORMED", 100)
    read_gltf(path, time=0.5)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DEFORMED", 99)
    assert f"nodes[{nodes[-1]}] brings the model to 100 primitives and morph targets" in str(refused(path))


def test_morph_targets_that_share_an_accessor_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """1,000 targets that move 1,000 vertices by three numbers of eight bytes compute 24 MB."""
    file, checks = Gltf(), []
    zeros = file.add("accessors", componentType=5126, count=1000, type="VEC3")
    primitive = {"attributes": {"POSITION": zeros}, "targets": [{"POSITION": zeros}] * 1000}
    file.node(mesh=file.add("meshes", primitives=[primitive], weights=[1.0] * 1000))
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.primitives.check_time", lambda: checks.append(True))
    read_gltf(path)
    assert len(checks) >= 1000
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DECODED_BYTES", 24_000_000)
    assert re.search(r"targets\[99\d\].POSITION needs 24,000 bytes", str(refused(path)))


def test_primitives_that_are_not_drawn_search_a_shared_accessor_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, searches = Gltf(), []
    zeros = file.add("accessors", componentType=5126, count=1000, type="VEC3")
    file.node(
        mesh=file.add("meshes", primitives=[{"attributes": {"NORMAL": zeros, f"_{i}": 0}} for i in range(50)])
    )
    search = accessors.finite_rows
    monkeypatch.setattr(accessors, "finite_rows", lambda *given: searches.append(True) or search(*given))
    assert not read_gltf(file.write(tmp_path)).shapes
    assert len(searches) == 1


def test_a_file_of_many_materials_is_read_with_few_calls(tmp_path: Path) -> None:
    """The number of Python calls per material is constant, and does not depend on the load of the machine."""
    count, file = 300, Gltf()
    mesh = file.mesh()
    primitive = file.json["meshes"][mesh]["primitives"][0]
    factors = {"baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0}
    for _ in range(count):
        file.add("materials", pbrMetallicRoughness=factors)
    file.json["meshes"][mesh]["primitives"] = [{**primitive, "material": i} for i in range(count)]
    file.add("scenes", nodes=[file.node(mesh=mesh)])
    path = file.write(tmp_path)
    read_gltf(path)
    profile = cProfile.Profile()
    profile.runcall(read_gltf, path)
    calls = sum(entry.callcount for entry in profile.getstats())
    assert calls < MAX_CALLS * count


def boxes_around_cameras(count: int, spread: float) -> Gltf:
    """Tetrahedra at one place, and cameras in their bounding box, but outside of them."""
    file = Gltf()
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    mesh = file.mesh(corners, [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
    camera = file.add("cameras", type="perspective", perspective={"yfov": 0.7, "znear": 0.1})
    for i in range(count):
        file.node(mesh=mesh)
        file.node(camera=camera, translation=[0.8 + spread * i / count, 0.8, 0.8])
    return file


def test_tests_of_what_encloses_a_camera_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    test = load.winding_number
    monkeypatch.setattr(load, "winding_number", lambda *given: calls.append(given) or test(*given))
    path = boxes_around_cameras(20, 0.1).write(tmp_path)
    (material,) = read_gltf(path).materials
    assert (material.culled, len(calls)) == (False, 20 * 20)
    calls.clear()
    monkeypatch.setattr(load, "_LONG_TESTS", 100 * (load._FACES_PER_TEST + 4))
    (material,) = read_gltf(path).materials
    assert (material.culled, 80 <= len(calls) <= 100) == (True, True)
    calls.clear()
    (material,) = read_gltf(boxes_around_cameras(20, 0.0).write(tmp_path)).materials
    assert (material.culled, len(calls)) == (False, 20)  # all cameras are at one place


def test_the_alpha_of_a_texture_is_searched_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    search = load._min_alpha
    monkeypatch.setattr(load, "_min_alpha", lambda texture: calls.append(texture) or search(texture))
    file = Gltf()
    texture = {"index": file.texture([[[9, 9, 9, 0]]])}
    material = file.add("materials", alphaMode="MASK", pbrMetallicRoughness={"baseColorTexture": texture})
    for shift in range(10):
        corners = [[shift, 0, 0], [10, 0, 0], [9, 1, 0]]
        file.node(mesh=file.mesh(corners, TEXCOORD_0=[[0, 0]] * 3, material=material))
    assert len(read_gltf(file.write(tmp_path)).shapes) == 10
    assert len(calls) == 1


@pytest.mark.parametrize("fields", [{"extensions": {}}, {"extensions": {"instances": True}}, {"skin": 0}], ids=str)
def test_weights_of_a_mesh_are_read_once(
    fields: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its nodes have: nothing of their own, several instances, or a skin."""
    file = Gltf()
    mesh = file.mesh(WEIGHTS_0=[[1.0, 0, 0, 0]] * 3)
    file.json["meshes"][mesh]["weights"] = [0.5] * 10
    attributes = file.json["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = file.accessor(np.zeros((3, 4)), "uint16")
    if "instances" in fields.get("extensions", {}):
        shifts = {"attributes": {"TRANSLATION": file.accessor([[0, 0, 0], [1, 0, 0]])}}
        fields = {"extensions": {"EXT_mesh_gpu_instancing": shifts}}
    file.json["skins"] = [{"joints": [0]}]
    for _ in range(20):
        file.node(mesh=mesh, **fields)
    names = []
    numbers = Table.any_numbers
    monkeypatch.setattr(Table, "any_numbers", lambda self, name: names.append(name) or numbers(self, name))
    read_gltf(file.write(tmp_path))
    assert names == ["weights"]


def test_the_keys_of_animations_are_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = Gltf()
    mesh = file.mesh()
    sampler = {
        "input": file.accessor(np.arange(1000.0)),
        "output": file.accessor(np.outer(np.arange(1000.0), [1, 0, 0])),
    }
    targets = [{"node": file.node(mesh=mesh), "path": "translation"} for _ in range(10)]
    channels = [{"sampler": i, "target": target} for i, target in enumerate(targets)]
    file.add("animations", samplers=[sampler] * 10, channels=channels)
    sizes = []
    difference = np.diff
    monkeypatch.setattr(np, "diff", lambda given, **rest: sizes.append(len(given)) or difference(given, **rest))
    model = read_gltf(file.write(tmp_path), time=2.5, shutter=0.25)
    assert sizes.count(1000) == 1
    motion = model.shapes[0].motion
    assert motion is not None
    assert motion.at(2.625)[0, 0, 3] == pytest.approx(2.625)


def test_pixels_are_counted_before_they_are_converted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Images of 64 x 64 pixels: 16-bit grey becomes floats, and a cube map has six faces, here all of one image."""
    grey = np.full((64, 64), 700, np.uint16)
    file = Gltf()
    path = file.one_triangle(normalTexture={"index": file.texture(grey)}).write(tmp_path)
    limit = "glpath.io.gltf.limits.ALWAYS_DECODED_BYTES"
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr(limit, 64 * 64 * (4 + 2 + 12) - 1)  # as counted by its size, stored and as float32
    assert "images[0] needs 49,152 bytes" in str(refused(path))
    file = Gltf().one_triangle()
    light = {"specularImages": [[file.image(np.zeros((64, 64, 3)))] * 6]}
    file.json["extensions"] = {"EXT_lights_image_based": {"lights": [light]}}
    file.json["scenes"] = [{"nodes": [0], "extensions": {"EXT_lights_image_based": {"light": 0}}}]
    path = file.write(tmp_path)
    monkeypatch.setattr(limit, 6 * 64 * 64 * 16)
    assert "specularImages[0] needs 393,216 bytes" in str(refused(path))
    monkeypatch.setattr(limit, 2**20)
    sky = read_gltf(path).sky
    assert sky is not None


def peak_of(work: Callable[[], object]) -> int:
    """Return the maximum memory in bytes that is allocated during a function."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def animated_weights(nodes: int, targets: int, weights: int) -> Gltf:
    """Nodes with one mesh, whose morph weights an accessor of zeros animates from 0 s to 1 s."""
    file = Gltf()
    mesh = file.mesh()
    primitive = file.json["meshes"][mesh]["primitives"][0]
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}] * targets
    zeros = file.add("accessors", componentType=5121, count=2 * weights, type="SCALAR")
    channels = [{"sampler": 0, "target": {"node": file.node(mesh=mesh), "path": "weights"}} for _ in range(nodes)]
    samplers = [{"input": file.accessor([0.0, 1.0]), "output": zeros}]
    file.add("animations", samplers=samplers, channels=channels)
    return file


def test_animated_weights_without_a_morph_target_take_no_memory(tmp_path: Path) -> None:
    """A zero takes one byte as stored, eight as a number and three in a check of the numbers."""
    weights = 100_000
    path = animated_weights(nodes=20, targets=1, weights=weights).write(tmp_path)
    assert peak_of(lambda: read_gltf(path, time=0.5, shutter=0.1)) < 2 * weights * 13


def test_animated_weights_of_many_nodes_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Accessors: 2 x 1,000 weights and 2 times, stored and as float64; then 1,000 float64 for each node."""
    path = animated_weights(nodes=10, targets=1000, weights=1000).write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DECODED_BYTES", 2000 * 9 + 2 * 12 + 10 * 8000 - 1)
    assert "animations[0].samplers[0].output needs 8,000 bytes" in str(refused(path))


def test_transforms_of_nodes_while_the_shutter_is_open_are_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """16 float64 for each node and each of 17 times."""
    size, file = 17 * 1000 * 16 * 8, Gltf()
    for _ in range(1000):
        file.node()
    sampler = {"input": file.accessor([0.0]), "output": file.accessor([[0, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    file.add("animations", samplers=[sampler], channels=[channel])
    path = file.write(tmp_path)
    assert peak_of(lambda: read_gltf(path, time=0.5, shutter=0.1)) < 1.9 * size
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DECODED_BYTES", size)
    read_gltf(path, time=0.5)
    with pytest.raises(SceneError, match=f"nodes needs {size:,} bytes"):
        read_gltf(path, time=0.5, shutter=0.1)


@pytest.mark.parametrize("component", [5120, 5121])
def test_normalised_integers_become_numbers_within_the_memory_that_is_counted(
    component: int, tmp_path: Path
) -> None:
    """A check of the numbers takes three truth values for each."""
    file = Gltf()
    file.add("accessors", componentType=component, normalized=True, count=2**14, type="MAT4")
    document = read_document(file.write(tmp_path))
    values = accessors.Accessors(document)
    peak = peak_of(lambda: values.floats(0, (16,), document.location))
    assert document.decoded == 2**18 * 9
    assert peak < 2**18 * (9 + 4)


def test_a_skin_of_many_vertices_takes_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Transforms and their intermediate results take a kilobyte for each vertex of a part."""
    count, file = 60_000, Gltf()
    kinds = {"POSITION": (5126, "VEC3"), "WEIGHTS_0": (5126, "VEC4"), "JOINTS_0": (5121, "VEC4")}
    attributes = {
        name: file.add("accessors", componentType=kind, count=count, type=form)
        for name, (kind, form) in kinds.items()
    }
    mesh = file.add("meshes", primitives=[{"attributes": attributes}])
    file.add("skins", joints=[file.node(mesh=mesh, skin=0)])
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.primitives._TOGETHER", 1000)
    assert peak_of(lambda: read_gltf(path)) < 400 * count


#: Offsets of numbers in the header of a KTX 2 texture, by their names in messages.
KTX2 = {
    "layers": 32,
    "faces": 36,
    "levels": 40,
    "as its supercompressionScheme": 44,
    "uncompressed bytes in level 0": 96,
}


@pytest.mark.parametrize("words", KTX2)
def test_headers_of_ktx2_are_checked_before_the_library_opens_them(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = bytearray(ktx2_of_solid_blocks(np.full((2, 2, 4), 9, np.uint8)))
    compression._check_ktx2(bytes(content))
    content[KTX2[words] : KTX2[words] + 4] = (10**8).to_bytes(4, "little")
    monkeypatch.setattr(compression, "_library", lambda *given: None)
    file = plain()
    file.json["images"][0] = {"bufferView": file.view(bytes(content))}
    error = str(refused(file.write(tmp_path)))
    assert f"cannot be decompressed: ValueError: its header has 100,000,000 {words}; at most" in error


def test_errors_list_only_the_first_of_many_names(tmp_path: Path) -> None:
    file = Gltf()
    file.json["extensionsRequired"] = [f"X_{i}" for i in range(5_000)]
    error = str(refused(file.write(tmp_path)))
    assert "names X_0, X_1," in error
    assert "X_19, ... (4,980 more), not known here." in error
    file = Gltf().one_triangle()
    for _ in range(500):
        file.node(camera=file.add("cameras", type="perspective", perspective={"yfov": 0.7, "znear": 0.1}))
    with pytest.raises(UsageError, match=r"\(480 more\)") as caught:
        read_gltf(file.write(tmp_path), camera="none such")
    assert len(str(caught.value)) < 2_000


@pytest.mark.parametrize(("mode", "triangles"), [(0, 2 * 80 * 9), (3, 2 * 80 * 9 + 2 * 16 * 8)])
def test_points_and_lines_of_a_small_file_are_counted_before_they_are_drawn(
    mode: int, triangles: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Gltf()
    for shift in (0, 100):
        file.node(mesh=file.mesh([[i + shift, 0, 0] for i in range(9)], mode=mode))
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_TRIANGLES_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_STROKE_TRIANGLES", triangles)
    with pytest.warns(SceneWarning, match="balls and rods"):
        assert sum(len(shape.geometry.faces) for shape in read_gltf(path).shapes) == triangles
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_STROKE_TRIANGLES", triangles - 1)
    error = str(refused(path))
    assert (
        f"meshes[1].primitives[0] brings the points and lines, drawn as balls and rods, to {triangles:,}" in error
    )


def test_points_that_a_file_does_not_store_are_limited(tmp_path: Path) -> None:
    file = Gltf()
    zeros = file.add("accessors", componentType=5126, count=400_000, type="VEC3")
    file.node(mesh=file.add("meshes", primitives=[{"attributes": {"POSITION": zeros}, "mode": 0}]))
    assert "to 3,200,000 triangles" in str(refused(file.write(tmp_path)))


@pytest.mark.parametrize("module", ["meshopt", "DracoPy", "opengl_basisu"])
def test_broken_compressed_data_are_refused(module: str, tmp_path: Path) -> None:
    pytest.importorskip(module, reason="needs the extras gltf and ktx2")
    file = plain()
    if module == "DracoPy":
        extension = {"bufferView": file.view(b"DRACO\2\2\1\1\0\0" + b"\xff" * 40), "attributes": {"POSITION": 0}}
        file.json["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": extension}
        position = file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
        del file.json["accessors"][position]["bufferView"]
    elif module == "meshopt":
        packed = {"buffer": 0, "byteLength": 9, "byteStride": 12, "count": 10**6, "mode": "ATTRIBUTES"}
        position = file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
        view = {"buffer": 1, "byteLength": 36, "extensions": {"EXT_meshopt_compression": packed}}
        file.json["bufferViews"][file.json["accessors"][position]["bufferView"]] = view
        file.whole()
        file.json["buffers"].append({"byteLength": 36})
    else:
        header = struct.pack("<12s5I", b"\xabKTX 20\xbb\r\n\x1a\n", 0, 1, 64, 64, 0)
        file.json["images"][0] = {"bufferView": file.view(header + b"\xff" * 200)}
        extensions = {"KHR_texture_basisu": {"source": 0}}
        file.json["textures"][0] = {"extensions": extensions}
    assert "cannot be decompressed" in str(refused(file.write(tmp_path)))


def draco_header(method: bytes, counts: bytes, metadata: bytes | None = None) -> bytes:
    flags = b"\0\0" if metadata is None else b"\0\x80" + metadata
    return b"DRACO\2\2\1" + method + flags + counts + bytes(40)


MANY = b"\xff\xff\xff\x0f"  # 2^25 - 1 as a number of variable length


@pytest.mark.parametrize(
    ("data", "words"),
    [
        pytest.param(draco_header(b"\0", b"\1" + MANY), "may unfold to", id="points"),
        pytest.param(draco_header(b"\0", MANY + b"\3"), "may unfold to", id="faces"),
        pytest.param(draco_header(b"\1", b"\0\3" + MANY), "may unfold to", id="edgebreaker"),
        pytest.param(
            draco_header(b"\0", b"\1" + MANY, b"\1\7\1\2ab\3xyz\0" + b"\0\1\1s\0\0"), "may unfold to", id="metadata"
        ),
        pytest.param(b"DRACO\2\3\0\1\0\0" + bytes(40), "not a mesh", id="point cloud"),
        pytest.param(draco_header(b"\0", b"\xff" * 9), "of more than 32 bits", id="count"),
        pytest.param(draco_header(b"\0", b"", b"\0" + b"\0\1\0" * 5000), "cannot be decompressed", id="nested"),
        pytest.param(b"DRA", "not a mesh", id="cut off"),
    ],
)
def test_draco_data_are_limited_by_their_header(
    data: bytes, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    monkeypatch.setattr(draco, "decode", None)
    file = plain()
    primitive = file.json["meshes"][0]["primitives"][0]
    extension = {"bufferView": file.view(data), "attributes": {"POSITION": 0}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    del file.json["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]
    assert words in str(refused(file.write(tmp_path)))


@pytest.mark.parametrize("in_order", [True, False])
def test_draco_headers_give_the_most_faces_and_points(in_order: bool) -> None:
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    i = np.arange(300)
    faces = np.stack([i[:-2], i[1:-1], i[2:]], axis=1)
    points = np.stack([i, i % 2, 0 * i], axis=1).astype(np.float32)
    data = draco.encode(points, faces, preserve_order=in_order)
    found = draco_counts(memoryview(data), SourceLocation("a.glb"), lambda: None)
    assert found == ((298, 300, 1) if in_order else (298, 894, 1))
    with pytest.raises(SceneError, match="cannot be decompressed"):
        draco_counts(memoryview(data)[:11], SourceLocation("a.glb"), lambda: None)


@pytest.mark.parametrize("in_order", [True, False])
def test_all_attributes_of_draco_data_are_counted_before_they_are_decoded(
    in_order: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The decoder unpacks attributes that the JSON does not name, too: here 60, and 9 numbers are 3 vectors."""
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    i = np.arange(300)
    more = {n: np.zeros((300, 9 if n == 1 else 4), np.uint32) for n in range(1, 61)}
    data = draco.encode(
        np.stack([i, i % 2, 0 * i], axis=1).astype(np.float32),
        np.stack([i[:-2], i[1:-1], i[2:]], axis=1),
        preserve_order=in_order,
        generic_attributes=more,
    )
    faces, points, vectors = draco_counts(memoryview(data), SourceLocation("a.glb"), lambda: None)
    widths = [np.shape(a["data"])[1] for a in draco.decode(data).attributes]
    assert vectors == sum(-(-width // 4) for width in widths) == 63
    file = plain()
    primitive = file.json["meshes"][0]["primitives"][0]
    extension = {"bufferView": file.view(data), "attributes": {"POSITION": 0}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    del file.json["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]
    monkeypatch.setattr(draco, "decode", None)
    monkeypatch.setattr("glpath.io.gltf.limits.MAX_DECODED_RATIO", 0)
    monkeypatch.setattr("glpath.io.gltf.limits.ALWAYS_DECODED_BYTES", 48 * 63 * points - 1)
    assert f"needs {72 * faces + 48 * 63 * points:,} bytes of memory" in str(refused(file.write(tmp_path)))


def test_a_list_of_very_many_draco_attributes_is_refused() -> None:
    content = draco_header(b"\0", b"\1\3") + b"\1\x41" + b"\4\5\4\0\1" * 65 + bytes(65)
    with pytest.raises(SceneError, match="a list of 65 attributes; at most 64 are read"):
        draco_counts(memoryview(content), SourceLocation("a.glb"), lambda: None)


def test_meshopt_data_are_decoded_without_a_copy() -> None:
    meshopt = pytest.importorskip("meshopt", reason="needs the extra gltf")
    count = 1 << 19
    data = meshopt.encode_gltf_buffer(np.zeros((count, 4), np.uint8), "ATTRIBUTES", 1)
    table = Table({"mode": "ATTRIBUTES", "count": count, "byteStride": 4}, SourceLocation("a.glb"))
    tracemalloc.start()
    found = compression.meshopt(table, memoryview(data), "EXT_meshopt_compression")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.readonly
    assert bytes(found) == bytes(4 * count)
    assert peak < 1.5 * 4 * count


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


def everything() -> Gltf:
    """As `plain`, with sparse values, a morph target, a skin, instances and the layers of materials."""
    file = plain()
    primitive = file.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": file.accessor([[0, 0, 1]] * 3)}]
    file.json["meshes"][0]["weights"] = [0.5]
    file.json["accessors"][primitive["attributes"]["POSITION"]]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": file.view(b"\1"), "componentType": 5121},
        "values": {"bufferView": file.view(np.array([2, 0, 0], np.float32).tobytes())},
    }
    attributes = {
        "TRANSLATION": file.accessor([[1, 0, 0], [2, 0, 0]]),
        "ROTATION": file.accessor([[0, 0, 0, 1], [0, 1, 0, 0]]),
    }
    file.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    skinned = file.mesh(WEIGHTS_0=[[1, 0, 0, 0]] * 3, COLOR_0=[[1, 1, 1, 1]] * 3)
    joints = file.accessor([[0, 1, 0, 0]] * 3, "uint8")
    file.json["meshes"][skinned]["primitives"][0]["attributes"]["JOINTS_0"] = joints
    bound = file.accessor(np.tile(np.eye(4).ravel(), (2, 1)))
    skin = file.add("skins", joints=[1, 2], inverseBindMatrices=bound)
    file.json["scenes"][0]["nodes"].append(file.node(mesh=skinned, skin=skin, matrix=np.eye(4).ravel().tolist()))
    texture = {
        "index": 0,
        "extensions": {"KHR_texture_transform": {"offset": [0.1, 0], "rotation": 1, "texCoord": 0}},
    }
    file.json["materials"][0] |= {
        "normalTexture": {**texture, "scale": 2},
        "emissiveFactor": [1, 1, 1],
        "extensions": {
            "KHR_materials_ior": {"ior": 1.4},
            "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": texture},
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationColor": [1, 0, 1], "attenuationDistance": 2},
            "KHR_materials_emissive_strength": {"emissiveStrength": 4},
        },
    }
    return file


DOCUMENT = everything().whole()
BINARY = everything().glb()
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


def test_what_is_mutated_can_be_read(tmp_path: Path) -> None:
    model = read_gltf(everything().write(tmp_path), time=0.5)
    assert [len(shape.world_from_object) for shape in model.shapes] == [2, 1]


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


def test_draco_data_are_searched_once_and_not_endlessly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The decoder ignores bytes after the mesh, each of which may look like a list of attributes."""
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    data = draco.encode(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]])) + bytes(20) + b"\3" * 2000
    file = plain()
    primitives = file.json["meshes"][0]["primitives"]
    extension = {"bufferView": file.view(data), "attributes": {"POSITION": 0}}
    primitives[0]["extensions"] = {"KHR_draco_mesh_compression": extension}
    del file.json["accessors"][primitives[0]["attributes"]["POSITION"]]["bufferView"]
    primitives += [{**primitives[0], "x": i} for i in range(20)]
    path = file.write(tmp_path)
    monkeypatch.setattr("glpath.io.gltf.primitives._MAX_DRACO_SEARCHES", 4000)
    assert sum(shape.count for shape in read_gltf(path).shapes) == 21
    monkeypatch.setattr("glpath.io.gltf.primitives._MAX_DRACO_SEARCHES", 1000)
    assert "look like lists of attributes" in str(refused(path))
