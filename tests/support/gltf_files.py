"""Writes small glTF files for tests, and reads written files."""

from __future__ import annotations

import base64
import io
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

#: A triangle in the plane z = 0, front towards +z.
TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


class Gltf:
    """A document to extend: `json` is the JSON to write, `binary` its only buffer."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}}

    def add(self, kind: str, /, **fields: Any) -> int:
        """Append an object to one of the lists; return its number."""
        self.json.setdefault(kind, []).append(fields)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **fields: Any) -> int:
        self.binary += bytes(-len(self.binary) % 4)
        offset = len(self.binary)
        self.binary += data
        return self.add("bufferViews", buffer=0, byteOffset=offset, byteLength=len(data), **fields)

    def accessor(self, values: ArrayLike, dtype: str = "float32", **fields: Any) -> int:
        array = np.asarray(values, dtype)
        width = 1 if array.ndim == 1 else array.shape[1]
        return self.add(
            "accessors",
            bufferView=self.view(array.tobytes()),
            componentType=COMPONENTS[dtype],
            count=len(array),
            type=TYPES[width],
            **fields,
        )

    def mesh(self, positions: ArrayLike = TRIANGLE, indices: ArrayLike | None = None, **attributes: Any) -> int:
        """Add a mesh of one primitive. attributes: arrays; those in lower case are fields of the primitive."""
        fields = {name: value for name, value in attributes.items() if name.islower()}
        arrays = {name: self.accessor(value) for name, value in attributes.items() if not name.islower()}
        if indices is not None:
            fields["indices"] = self.accessor(indices, "uint16")
        return self.add(
            "meshes", primitives=[{"attributes": {"POSITION": self.accessor(positions), **arrays}, **fields}]
        )

    def node(self, **fields: Any) -> int:
        return self.add("nodes", **fields)

    def image(self, pixels: ArrayLike, kind: str = "PNG", **options: Any) -> int:
        return self.add("images", bufferView=self.view(encoded(pixels, kind, **options)), mimeType="image/png")

    def texture(self, pixels: ArrayLike, **sampler: Any) -> int:
        fields: dict[str, Any] = {"source": self.image(pixels)}
        if sampler:
            fields["sampler"] = self.add("samplers", **sampler)
        return self.add("textures", **fields)

    def one_triangle(self, **material: Any) -> Gltf:
        """Add a triangle with texture coordinates and this material."""
        number = self.add("materials", **material)
        self.node(mesh=self.mesh(TEXCOORD_0=[[0, 0], [1, 0], [0, 1]], material=number))
        return self

    def whole(self) -> dict[str, Any]:
        if self.binary:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
            self.json.setdefault("buffers", [{"byteLength": len(self.binary), "uri": uri}])
        return self.json

    def write(self, folder: Path, name: str = "model.gltf") -> Path:
        path = folder / name
        path.write_text(json.dumps(self.whole()))
        return path

    def glb(self) -> bytes:
        document = {**self.json, "buffers": [{"byteLength": len(self.binary)}]} if self.binary else self.json
        return glb(json.dumps(document).encode(), bytes(self.binary))


def glb(text: bytes, binary: bytes) -> bytes:
    """Return a .glb of the JSON and the binary chunk."""
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@dataclass(frozen=True)
class ReadGlb:
    """A .glb, parsed after the specification's section 4: its JSON, and the arrays and images of its buffer."""

    json: dict[str, Any]
    binary: bytes

    @classmethod
    def of(cls, path: str | Path) -> ReadGlb:
        content = Path(path).read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        chunks, at = [], 12
        while at < length:
            size, kind = struct.unpack_from("<I4s", content, at)
            assert size % 4 == 0
            chunks.append((kind, content[at + 8 : at + 8 + size]))
            at += 8 + size
        assert [kind for kind, _ in chunks] in ([b"JSON"], [b"JSON", b"BIN\0"])
        return cls(json.loads(chunks[0][1]), chunks[-1][1] if len(chunks) == 2 else b"")

    def view(self, number: int) -> bytes:
        view = self.json["bufferViews"][number]
        start = view.get("byteOffset", 0)
        return self.binary[start : start + view["byteLength"]]

    def values(self, number: int) -> np.ndarray:
        """Return the values of an accessor: (N,) or (N, 2 to 4)."""
        accessor = self.json["accessors"][number]
        kind = {code: name for name, code in COMPONENTS.items()}[accessor["componentType"]]
        width = {name: width for width, name in TYPES.items()}[accessor["type"]]
        flat = np.frombuffer(self.view(accessor["bufferView"]), kind, accessor["count"] * width)
        return flat if width == 1 else flat.reshape(-1, width)

    def image(self, number: int) -> bytes:
        return self.view(self.json["images"][number]["bufferView"])


def encoded(pixels: ArrayLike, kind: str = "PNG", **options: Any) -> bytes:
    """Return an image file of pixels (h, w), (h, w, 3) or (h, w, 4)."""
    array = np.asarray(pixels)
    stream = io.BytesIO()
    Image.fromarray(array if array.dtype == np.uint16 else array.astype(np.uint8)).save(stream, kind, **options)
    return stream.getvalue()


def ktx2_of_solid_blocks(colours: ArrayLike) -> bytes:
    """Return a KTX 2 texture of uniform UASTC blocks of 4 x 4 texels; colours (h / 4, w / 4, 4) uint8."""
    array = np.asarray(colours, np.uint8)
    rows, columns = array.shape[:2]
    # Mode 8: a five-bit code, then eight bits each of red, green, blue and alpha.
    blocks = b"".join(
        (0x17 | r << 5 | g << 13 | b << 21 | a << 29).to_bytes(16, "little")
        for r, g, b, a in array.reshape(-1, 4).tolist()
    )
    # Khronos' basic data format descriptor: UASTC, sRGB, one sample of red, green, blue and alpha.
    descriptor = struct.pack("<IIHH4B4B8B", 44, 0, 2, 40, 166, 1, 2, 0, 3, 3, 0, 0, 16, *[0] * 7)
    descriptor += struct.pack("<HBBIII", 0, 127, 3, 0, 0, 0xFFFFFFFF)
    start = 80 + 24
    data = -(-(start + len(descriptor)) // 16) * 16
    header = struct.pack("<12s9I", b"\xabKTX 20\xbb\r\n\x1a\n", 0, 1, 4 * columns, 4 * rows, 0, 0, 1, 1, 0)
    header += struct.pack("<4I2Q3Q", start, len(descriptor), 0, 0, 0, 0, data, len(blocks), len(blocks))
    return (header + descriptor).ljust(data, b"\0") + blocks
