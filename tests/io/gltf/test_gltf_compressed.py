"""A compressed model looks as it does uncompressed: Draco, meshopt, WebP, by libraries and by others' programs."""

from __future__ import annotations

import io
import json
import os
import shutil
import struct
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import glpath
from glpath.errors import SceneWarning
from glpath.io import load_scene
from glpath.scene import Scene
from glpath.scene.model import Float64
from tests.support.gltf_files import glb

pytestmark = pytest.mark.evidence

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
DTYPES = {5125: np.uint32, 5126: np.float32}
# Texture coordinates and normals finer than by default.
FINE_DRACO = ("gltf-transform", "draco", "--quantize-normal", "14", "--quantize-texcoord", "16")


class Packed:
    """A .glb taken apart, whose buffer is written anew."""

    def __init__(self, path: Path) -> None:
        content = path.read_bytes()
        size = struct.unpack_from("<I", content, 12)[0]
        self.json: dict[str, Any] = json.loads(content[20 : 20 + size])
        self.binary = content[28 + size :]
        self.views: list[dict[str, Any]] = []
        self.made = bytearray()

    def bytes_of(self, view: int) -> bytes:
        table = self.json["bufferViews"][view]
        return self.binary[table.get("byteOffset", 0) :][: table["byteLength"]]

    def array(self, accessor: int) -> Any:
        table = self.json["accessors"][accessor]
        found = np.frombuffer(self.bytes_of(table["bufferView"]), DTYPES[table["componentType"]])
        return found.reshape(table["count"], WIDTHS[table["type"]])

    def view(self, data: bytes, **fields: Any) -> int:
        self.made += bytes(-len(self.made) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.made), "byteLength": len(data), **fields})
        self.made += data
        return len(self.views) - 1

    def keep_images(self) -> None:
        for image in self.json["images"]:
            image["bufferView"] = self.view(self.bytes_of(image["bufferView"]))

    def write(self, path: Path, extension: str, *, required: bool = True) -> Path:
        document = self.json | {"bufferViews": self.views}
        document["buffers"] = [{"byteLength": len(self.made)}, *self.json["buffers"][1:]]
        document["extensionsUsed"] = [*document.get("extensionsUsed", []), extension]
        if required:
            document["extensionsRequired"] = [extension]
        path.write_bytes(glb(json.dumps(document).encode(), bytes(self.made)))
        return path


def with_draco(model: Path, to: Path) -> Path:
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    file = Packed(model)
    file.keep_images()
    for mesh in file.json["meshes"]:
        for primitive in mesh["primitives"]:
            arrays = {name: file.array(number).astype(float) for name, number in primitive["attributes"].items()}
            packed = draco.encode(
                arrays["POSITION"],
                file.array(primitive["indices"]).reshape(-1, 3),
                quantization_bits=16,
                tex_coord=arrays.get("TEXCOORD_0"),
                normals=arrays.get("NORMAL"),
            )
            kinds = {0: "POSITION", 1: "NORMAL", 3: "TEXCOORD_0"}  # of Draco's attributes
            ids = {kinds[a["attribute_type"]]: a["unique_id"] for a in draco.decode(packed).attributes}
            assert set(ids) == set(arrays)
            primitive["extensions"] = {
                "KHR_draco_mesh_compression": {"bufferView": file.view(packed), "attributes": ids}
            }
    for accessor in file.json["accessors"]:
        del accessor["bufferView"]
    return file.write(to / "draco.glb", "KHR_draco_mesh_compression")


def with_meshopt(model: Path, to: Path) -> Path:
    meshopt = pytest.importorskip("meshopt", reason="needs the extra gltf")
    file = Packed(model)
    file.keep_images()
    room = 0
    for i, accessor in enumerate(file.json["accessors"]):
        array = file.array(i)
        mode = "TRIANGLES" if accessor["type"] == "SCALAR" else "ATTRIBUTES"
        packed = meshopt.encode_gltf_buffer(array.ravel() if mode == "TRIANGLES" else array, mode)
        where = file.view(packed)
        stored = file.views.pop(where)
        stored |= {"mode": mode, "count": len(array), "byteStride": array.strides[0]}
        # The view is one of a second buffer, which is not there.
        file.views.append(
            {"buffer": 1, "byteOffset": room, "byteLength": array.nbytes,
             "extensions": {"EXT_meshopt_compression": stored}}
        )  # fmt: skip
        room += array.nbytes
        accessor["bufferView"] = where
    fallback = {"byteLength": room, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    file.json["buffers"].append(fallback)
    return file.write(to / "meshopt.glb", "EXT_meshopt_compression")


def with_webp(model: Path, to: Path) -> Path:
    file = Packed(model)
    for image in file.json["images"]:
        stream = io.BytesIO()
        Image.open(io.BytesIO(file.bytes_of(image["bufferView"]))).save(stream, "WEBP", lossless=True)
        image |= {"bufferView": file.view(stream.getvalue()), "mimeType": "image/webp"}
    for texture in file.json["textures"]:
        texture["extensions"] = {"EXT_texture_webp": {"source": texture.pop("source")}}
    numbers = [file.view(file.bytes_of(accessor["bufferView"])) for accessor in file.json["accessors"]]
    for accessor, number in zip(file.json["accessors"], numbers, strict=True):
        accessor["bufferView"] = number
    return file.write(to / "webp.glb", "EXT_texture_webp")


def by_program(*command: str) -> Callable[[Path, Path], Path]:
    """What a program makes of a model that is named before what it writes."""

    def made(model: Path, to: Path) -> Path:
        # `make evidence` installs npm's programs beside Python.
        folders = os.pathsep.join([str(Path(sys.prefix, "bin")), os.environ.get("PATH", os.defpath)])
        program = shutil.which(command[0], path=folders)
        if program is None:
            where = {"gltfpack": "Debian's gltfpack", "gltf-transform": "npm's @gltf-transform/cli"}[command[0]]
            pytest.skip(f"needs {command[0]}, {where}")
        if "webp" not in command:
            pytest.importorskip("DracoPy" if "draco" in command else "meshopt", reason="needs the extra gltf")
        path = to / "packed.glb"
        ends = ["-i", str(model), "-o", str(path)] if command[0] == "gltfpack" else [str(model), str(path)]
        # gltf-transform has its files before its options.
        words = [*command[1:2], *ends, *command[2:]] if command[0] == "gltf-transform" else [*command[1:], *ends]
        subprocess.run([program, *words], check=True, capture_output=True, timeout=300)
        return path

    return made


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room") / "parlour.glb"
    glpath.export("parlour", path)
    return path


def quiet(path: Path) -> Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return load_scene(path).with_camera(resolution=(96, 72))


def blocks(image: Float64) -> Float64:
    """Means of 8 x 8 pixels in W sr^-1 m^-2, of what is not the window, which outshines all."""
    return np.minimum(image / 179, 1.0).reshape(9, 8, 12, 8, 3).mean(axis=(1, 3))


@pytest.mark.parametrize(
    "pack",
    [
        pytest.param(with_draco, id="draco"),
        pytest.param(with_meshopt, id="meshopt"),
        pytest.param(with_webp, id="webp"),
        pytest.param(by_program("gltfpack", "-noq", "-c"), id="gltfpack"),
        pytest.param(by_program("gltfpack", "-cc", "-vp", "16", "-vt", "16"), id="gltfpack-filters"),
        pytest.param(
            by_program(*FINE_DRACO),
            id="gltf-transform-draco",
        ),
        pytest.param(by_program("gltf-transform", "meshopt"), id="gltf-transform-meshopt"),
        pytest.param(by_program("gltf-transform", "webp", "--lossless", "true"), id="gltf-transform-webp"),
    ],
)
def test_a_compressed_room_looks_as_it_does_uncompressed(
    room: Path, tmp_path: Path, pack: Callable[[Path, Path], Path]
) -> None:
    packed = pack(room, tmp_path)
    assert packed.stat().st_size < 0.95 * room.stat().st_size
    one, other = quiet(room), quiet(packed)
    assert other.shapes.total("triangle") == one.shapes.total("triangle")
    size = np.linalg.norm(one.bounds[1] - one.bounds[0])
    np.testing.assert_allclose(other.bounds, one.bounds, atol=1e-4 * size)
    assert len(other.materials) == len(one.materials)
    assert len(other.textures) == len(one.textures)
    a, b = (glpath.render(each, spp=32, max_depth=4, aovs=("albedo", "normal")) for each in (one, other))
    # The same places in pixels, so that what is seen first differs by rounding alone. Not so what lights it: Draco
    # puts triangles in another order, by which other points of lamps are sampled.
    for name in ("albedo", "normal"):
        x, y = a.aov(name), b.aov(name)
        assert np.abs(x - y).mean() < 0.01 * np.abs(x).mean(), name
    assert blocks(b.mean).mean() == pytest.approx(blocks(a.mean).mean(), rel=0.02)
    assert np.abs(blocks(a.mean) - blocks(b.mean)).mean() < 0.08 * blocks(a.mean).mean()
