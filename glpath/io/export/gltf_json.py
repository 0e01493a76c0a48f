"""JSON of a glTF 2.0 file as typed data [msgspec], with the fields that are written.

Fields have the names and meaning of the specification, in snake case here and in camel case in the file. A field
with its default value is left out, because the specification has the same default.

Source: Khronos Group, glTF 2.0 specification, 5 (properties) and 4 (the GLB container).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from glpath.errors import ImageError
from glpath.system.arguments import short_repr

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
UNSIGNED_INT, FLOAT = 5125, 5126
NEAREST, LINEAR, LINEAR_MIPMAP_LINEAR = 9728, 9729, 9987
REPEAT, CLAMP_TO_EDGE, MIRRORED_REPEAT = 10497, 33071, 33648

#: Extensions or extras by name.
Extensions = dict[str, Any]

# Maximum file size: the header of the container counts bytes in 32 bits.
_MAX_BYTES = 2**32 - 1
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")


class _Object(msgspec.Struct, kw_only=True, omit_defaults=True, rename="camel"):
    """Fields that all objects may have."""

    name: str = ""
    extensions: Extensions = {}
    extras: Extensions = {}


class Accessor(_Object):
    buffer_view: int
    component_type: int
    count: int
    type: str
    min: Sequence[float] | None = None
    max: Sequence[float] | None = None


class BufferView(_Object):
    buffer: int
    byte_length: int
    byte_offset: int = 0
    target: int | None = None


class Buffer(_Object):
    byte_length: int


class Image(_Object):
    mime_type: str
    buffer_view: int


class Sampler(_Object):
    mag_filter: int
    min_filter: int
    wrap_s: int = REPEAT
    wrap_t: int = REPEAT


class Texture(_Object):
    sampler: int
    source: int


class TextureInfo(_Object):
    index: int
    tex_coord: int = 0


class NormalTextureInfo(TextureInfo):
    scale: float = 1.0


class PbrMetallicRoughness(_Object):
    base_color_factor: Sequence[float] = (1.0, 1.0, 1.0, 1.0)
    metallic_factor: float = 1.0
    roughness_factor: float = 1.0
    base_color_texture: TextureInfo | None = None
    metallic_roughness_texture: TextureInfo | None = None


class Material(_Object):
    pbr_metallic_roughness: PbrMetallicRoughness | None = None
    normal_texture: NormalTextureInfo | None = None
    emissive_texture: TextureInfo | None = None
    emissive_factor: Sequence[float] = (0.0, 0.0, 0.0)
    alpha_mode: str = "OPAQUE"
    alpha_cutoff: float | None = None  # for alpha_mode MASK only
    double_sided: bool = False


class Primitive(_Object):
    attributes: dict[str, int]
    indices: int
    material: int


class Mesh(_Object):
    primitives: list[Primitive]


class Orthographic(_Object):
    xmag: float
    ymag: float
    znear: float
    zfar: float


class Perspective(_Object):
    yfov: float
    aspect_ratio: float
    znear: float


class Camera(_Object):
    type: str
    orthographic: Orthographic | None = None
    perspective: Perspective | None = None


class Node(_Object):
    children: list[int] = []
    mesh: int | None = None
    camera: int | None = None
    matrix: Sequence[float] | None = None
    rotation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    translation: Sequence[float] = (0.0, 0.0, 0.0)


class Scene(_Object):
    nodes: list[int]


class Asset(_Object):
    version: str
    generator: str


class Document(_Object):
    """Root object. `scene` is the index of the shown scene."""

    asset: Asset
    scene: int
    scenes: list[Scene]
    nodes: list[Node]
    meshes: list[Mesh] = []
    cameras: list[Camera] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    samplers: list[Sampler] = []
    images: list[Image] = []
    accessors: list[Accessor] = []
    buffer_views: list[BufferView] = []
    buffers: list[Buffer] = []
    extensions_used: list[str] = []


def write_glb(document: Document, binary: bytes | bytearray, path: Path) -> None:
    """Write the container directly to `path`. Raises ImageError if it is too large for its header.

    Also raises ImageError for names that UTF-8 cannot encode.
    """
    try:
        text = msgspec.json.encode(document, enc_hook=_plain)
    except UnicodeEncodeError as error:
        raise ImageError(
            f".glb: a name in it is {short_repr(error.object)}, which UTF-8 cannot encode.", "Take another name."
        ) from error
    chunks = [(b"JSON", text, b" "), (b"BIN\0", binary, b"\0")]
    # Chunks are padded to multiples of four bytes, JSON with spaces and binary data with zeros.
    padded = [(kind, data, padding * (-len(data) % 4)) for kind, data, padding in chunks if data]
    length = _HEADER.size + sum(_CHUNK.size + len(data) + len(padding) for _, data, padding in padded)
    if length > _MAX_BYTES:
        raise ImageError(
            f"{path}: the file would have {length:,} bytes; a .glb has at most {_MAX_BYTES:,}.",
            "Split the scene, or write fewer texels or elements.",
        )
    with path.open("wb") as file:
        file.write(_HEADER.pack(b"glTF", 2, length))
        for kind, data, padding in padded:
            file.write(_CHUNK.pack(len(data) + len(padding), kind))
            file.write(data)
            file.write(padding)


def _plain(value: Any) -> Any:
    """Return a number of numpy as a Python number."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} is of {type(value).__name__}, which glTF's JSON does not have")
