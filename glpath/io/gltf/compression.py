"""Decompression of buffers, meshes and textures.

It needs meshopt and DracoPy (`glpath[gltf]`) and opengl_basisu (`glpath[ktx2]`). If a file also holds the
uncompressed data, they are read instead, and no package is needed.

Source: EXT_meshopt_compression, KHR_draco_mesh_compression, KHR_texture_basisu; Draco Bitstream Specification 2.2.
"""

from __future__ import annotations

import importlib
import io
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf.table import Table
from glpath.scene.source_location import SourceLocation

#: Names of the meshopt extension and of its successor. One decoder reads both.
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
BASISU = "KHR_texture_basisu"
# Draco: flag of a header that metadata follow; maximum number of bits of a count.
_DRACO_METADATA, _DRACO_COUNT_BITS = 0x8000, 32
# KTX 2: maximum number of bytes of a pixel, of which Basis Universal has one, and of blocks at the edges.
_KTX2_PIXEL, _KTX2_BLOCKS = 2, 1 << 20


def meshopt(table: Table, data: memoryview, extension: str) -> memoryview:
    """Return the decompressed bytes of a buffer view; `table` is its meshopt extension object."""
    decoder = _library("meshopt", "gltf", extension, table.location)
    mode = table.required_choice("mode", {name: name for name in ("ATTRIBUTES", "TRIANGLES", "INDICES")})
    filters = {name: name for name in ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")}
    chosen = table.choice("filter", filters, "NONE")
    count, stride = table.required("count", 1), table.required("byteStride", 1, 256)
    try:
        rows = decoder.decode_gltf_buffer(bytes(data), count, stride, mode, chosen)
    except Exception as error:  # the library raises all kinds of exceptions
        raise _broken(table.location, error) from error
    flat: Any = np.ascontiguousarray(rows).reshape(-1).view(np.uint8)
    return memoryview(flat).toreadonly()  # without a copy


def draco(data: memoryview, location: SourceLocation) -> tuple[NDArray[np.int64], dict[int, NDArray[Any]]]:
    """Return the indices (F, 3) of a Draco mesh, and its attributes (V, k) by their unique ids."""
    library = _library("DracoPy", "gltf", DRACO, location)
    try:
        mesh = library.decode(bytes(data))
        faces = np.array(mesh.faces, np.int64).reshape(-1, 3)
        return faces, {int(a["unique_id"]): np.asarray(a["data"]) for a in mesh.attributes}
    except Exception as error:  # the library raises all kinds of exceptions
        raise _broken(location, error) from error


def draco_counts(data: memoryview, location: SourceLocation) -> tuple[int, int]:
    """Return the maximum numbers of faces and points of a Draco mesh from its header, before it is decoded."""
    stream = io.BytesIO(data)
    try:
        head = stream.read(9)
        if head[:5] != b"DRACO" or head[7] != 1:
            raise ValueError("it is not a mesh of Draco")
        version, is_sequential = (head[5], head[6]), head[8] == 0
        if int.from_bytes(stream.read(2), "little") & _DRACO_METADATA:
            for _ in range(_draco_varint(stream)):
                _draco_varint(stream)  # the attribute's unique id
                _skip_draco_metadata(stream)
            _skip_draco_metadata(stream)
        is_variable = version >= ((2, 2) if is_sequential else (2, 0))

        def count() -> int:
            return _draco_varint(stream) if is_variable else int.from_bytes(stream.read(4), "little")

        if is_sequential:
            return count(), count()
        stream.read(1)  # the order of traversal
        if version < (2, 2):
            count()  # vertices that the encoder has split
        vertices, faces = count(), count()
    except Exception as error:  # a header that is cut off gives an IndexError, deep metadata a RecursionError
        raise _broken(location, error) from error
    # Seams of attributes split vertices, so each corner may be a point of its own.
    return faces, max(vertices, 3 * faces)


def _draco_varint(stream: io.BytesIO) -> int:
    value = 0
    for shift in range(0, _DRACO_COUNT_BITS + 3, 7):
        byte = stream.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
    raise ValueError(f"it has a count of more than {_DRACO_COUNT_BITS} bits")


def _skip_draco_metadata(stream: io.BytesIO) -> None:
    """Skip named values, and metadata nested in them."""
    for _ in range(_draco_varint(stream)):
        stream.seek(stream.read(1)[0], io.SEEK_CUR)
        stream.seek(_draco_varint(stream), io.SEEK_CUR)
    for _ in range(_draco_varint(stream)):
        stream.seek(stream.read(1)[0], io.SEEK_CUR)
        _skip_draco_metadata(stream)


def ktx2(data: bytes, location: SourceLocation) -> NDArray[np.uint8]:
    """Return the largest mipmap level of a KTX 2 texture, (h, w, 3) or (h, w, 4) uint8, row 0 at the top."""
    library = _library("opengl_basisu", "ktx2", BASISU, location)
    try:
        _check_ktx2(data)
        texture = library.open(data)
        pixels = np.array(texture.transcode("rgba8").data, np.uint8)
    except Exception as error:  # the library raises all kinds of exceptions
        if type(error).__name__ == "UnsupportedError":
            raise location.error(
                f"is a texture that {BASISU} does not allow: {error}",
                "Write it anew as Basis Universal (toktx --encode uastc), or as PNG or JPEG.",
            ) from error
        raise _broken(location, error) from error
    return pixels if texture.has_alpha else pixels[..., :3]


def _check_ktx2(data: bytes) -> None:
    """Raise ValueError if the header of a KTX 2 texture announces more than one image, or too many bytes."""
    width, height, _, layers, faces, levels, scheme = struct.unpack_from("<7I", data, 20)
    (size,) = struct.unpack_from("<Q", data, 96)
    for name, value, limit in (
        ("layers", layers, 1),
        ("faces", faces, 1),
        ("levels", levels, max(width, height).bit_length()),
        ("as its supercompressionScheme", scheme, 2),
        ("uncompressed bytes in level 0", size, _KTX2_PIXEL * width * height + _KTX2_BLOCKS),
    ):
        if value > limit:
            raise ValueError(f"its header has {value:,} {name}; at most {limit:,} is allowed")


def available(module: str) -> bool:
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


def _library(module: str, extra: str, extension: str, location: SourceLocation) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise location.error(
            f"is compressed ({extension}), which needs the package {module}.",
            f'Install it: pip install "glpath[{extra}]". Or export the file without compression.',
        ) from error


def _broken(location: SourceLocation, error: Exception) -> Exception:
    return location.error(
        f"cannot be decompressed: {type(error).__name__}: {error}.", "The file is cut off, or was written wrongly."
    )
