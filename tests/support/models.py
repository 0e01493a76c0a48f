"""Models for tests, written byte by byte: a box as glTF and as OBJ with MTL."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from glpath.scene.tessellate import box

VERTICES, FACES = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
#: Colours of the box's two halves in both files.
PAINT, GOLD = [0.75, 0.25, 0.125], [0.875, 0.75, 0.25]


def gltf(path: Path, **changes: Any) -> Path:
    """Write the box as .gltf: six triangles of "Paint", six of "Gold"; `changes` replace lists of its JSON."""
    faces = np.ascontiguousarray(FACES, "<u4").tobytes()
    data = faces + np.ascontiguousarray(VERTICES, "<f4").tobytes()
    root = {
        "asset": {"version": "2.0"},
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(faces)},
            {"buffer": 0, "byteOffset": len(faces), "byteLength": len(data) - len(faces)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": 18, "type": "SCALAR"},
            {"bufferView": 0, "byteOffset": 72, "componentType": 5125, "count": 18, "type": "SCALAR"},
            {
                "bufferView": 1,
                "componentType": 5126,
                "count": len(VERTICES),
                "type": "VEC3",
                "min": [-0.5] * 3,
                "max": [0.5] * 3,
            },
        ],
        "materials": [
            {
                "name": "Paint",
                "doubleSided": True,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*PAINT, 1],
                    "metallicFactor": 0,
                    "roughnessFactor": 0.5,
                },
            },
            {
                "name": "Gold",
                "doubleSided": True,
                "pbrMetallicRoughness": {"baseColorFactor": [*GOLD, 1], "roughnessFactor": 0.25},
            },
        ],
        "meshes": [
            {
                "name": "Box",
                "primitives": [
                    {"attributes": {"POSITION": 2}, "indices": half, "material": half} for half in (0, 1)
                ],
            }
        ],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    } | changes
    path.write_text(json.dumps(root))
    return path


MTL = """
newmtl Paint
Kd 0.75 0.25 0.125
Pr 0.5
Pm 0
newmtl Gold
Kd 0.875 0.75 0.25
Pr 0.25
Pm 1
"""


def obj(path: Path, mtl: str = MTL, uv: bool = False) -> Path:
    """Write the same box as .obj, with a library "box.mtl" beside it.

    uv : write texture coordinates
    """
    path.with_name("box.mtl").write_text(mtl)
    lines = ["mtllib box.mtl", *(f"v {x} {y} {z}" for x, y, z in VERTICES)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"] if uv else []
    for half, name in ((0, "Paint"), (6, "Gold")):
        lines.append(f"usemtl {name}")
        for face in FACES[half : half + 6]:
            corners = (f"{v + 1}/{k + 1}" if uv else f"{v + 1}" for k, v in enumerate(face))
            lines.append("f " + " ".join(corners))
    path.write_text("\n".join(lines))
    return path
