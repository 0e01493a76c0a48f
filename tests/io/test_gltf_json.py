"""The container of glTF files that are written: padding, a file without a buffer, and its limit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glpath.errors import ImageError
from glpath.io.export import gltf_json
from tests.support.gltf_files import ReadGlb

ROOT_NODE = gltf_json.Node(name="root")


def document(name: str = "", **fields: object) -> gltf_json.Document:
    asset = gltf_json.Asset(version="2.0", generator="glpath")
    return gltf_json.Document(asset=asset, scene=0, scenes=[gltf_json.Scene(name=name, nodes=[0])], **fields)


@pytest.mark.parametrize("count", range(4))
def test_chunks_end_at_multiples_of_four(count: int, tmp_path: Path) -> None:
    binary = bytes(range(1, 5 + count))
    made = document("n" * count, nodes=[ROOT_NODE], buffers=[gltf_json.Buffer(byte_length=len(binary))])
    gltf_json.write_glb(made, binary, tmp_path / "a.glb")
    read = ReadGlb.of(tmp_path / "a.glb")  # which asserts it
    assert read.binary == binary + bytes(-count % 4)
    assert read.json["buffers"] == [{"byteLength": 4 + count}]


def test_a_file_without_arrays_has_no_second_chunk(tmp_path: Path) -> None:
    gltf_json.write_glb(document(nodes=[ROOT_NODE]), b"", tmp_path / "a.glb")
    read = ReadGlb.of(tmp_path / "a.glb")
    assert read.binary == b""
    assert read.json.keys() == {"asset", "scene", "scenes", "nodes"}, "lists without entries are not allowed"


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    extras = {"double": np.float64(0.1), "single": np.float32(0.5), "whole": np.int64(3), "yes": np.bool_(True)}
    gltf_json.write_glb(document(nodes=[ROOT_NODE], extras=extras), b"", tmp_path / "a.glb")
    assert ReadGlb.of(tmp_path / "a.glb").json["extras"] == {"double": 0.1, "single": 0.5, "whole": 3, "yes": True}


def test_what_the_header_cannot_count_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_json, "_MAX_BYTES", 1000)
    with pytest.raises(ImageError, match=r"at most 1,000[\s\S]*Split the scene"):
        gltf_json.write_glb(document(nodes=[ROOT_NODE]), bytes(1000), tmp_path / "a.glb")
    assert not (tmp_path / "a.glb").exists()
