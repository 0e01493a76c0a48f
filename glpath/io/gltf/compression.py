"""Decompression of buffers, meshes and textures.

It needs meshopt and DracoPy (`glpath[gltf]`) and opengl_basisu (`glpath[ktx2]`). If a file also holds the
uncompressed data, they are read instead, and no package is needed.

Source: EXT_meshopt_compression, KHR_draco_mesh_compression, KHR_texture_basisu; Draco Bitstream Specification 2.2.
"""

from __future__ import annotations

import importlib
import io
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError
from glpath.io.gltf.table import Table
from glpath.scene.source_location import SourceLocation
from glpath.system.time_limit import check_time

#: Names of the meshopt extension and of its successor. One decoder reads both.
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
BASISU = "KHR_texture_basisu"
# Draco: flag of a header that metadata follow; maximum number of bits of a count.
_DRACO_METADATA, _DRACO_COUNT_BITS = 0x8000, 32
# Draco: number of types of attributes, of their numbers, and of their encodings; maximum number in a list.
_DRACO_TYPES, _DRACO_DATA_TYPES, _DRACO_ENCODINGS, _DRACO_LONGEST = 9, 11, 4, 64
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


def draco_counts(data: memoryview, location: SourceLocation, on_search: Callable[[], None]) -> tuple[int, int, int]:
    """Return the maximum numbers of faces, points and vectors of a point of a Draco mesh, before it is decoded.

    on_search : called before each position is searched for a list of attributes; it may raise an error
    """
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
        if version < (2, 0):
            raise ValueError(f"its bitstream is of version {head[5]}.{head[6]}, before 2.0")
        is_variable = version >= (2, 2) or not is_sequential

        def count() -> int:
            return _draco_varint(stream) if is_variable else int.from_bytes(stream.read(4), "little")

        vectors = _draco_vectors(data, 0 if is_sequential else 3, on_search)
        if is_sequential:
            return count(), count(), vectors
        stream.read(1)  # the order of traversal
        if version < (2, 2):
            count()  # vertices that the encoder has split
        vertices, faces = count(), count()
    except GlpathError:
        raise
    except Exception as error:  # a header that is cut off gives an IndexError, deep metadata a RecursionError
        raise _broken(location, error) from error
    # Seams of attributes split vertices, so each corner may be a point of its own.
    return faces, max(vertices, 3 * faces), vectors


def _draco_vectors(data: memoryview, decoder_bytes: int, on_search: Callable[[], None]) -> int:
    """Return the maximum number of vectors of up to four numbers that a point of a Draco mesh has.

    The lists of attributes follow faces of unknown size, so the longest lists of any position are taken. They are
    the number of lists, `decoder_bytes` for each, and then the lists. Raises OverflowError for a very long list.
    """
    stream, max_vectors = io.BytesIO(data), 1

    @cache
    def list_at(start: int) -> tuple[int, int] | None:
        on_search()
        stream.seek(start)
        try:
            return _draco_list(stream), stream.tell()
        except (ValueError, IndexError):
            return None

    values, counts = np.frombuffer(data, np.uint8), np.arange(1, 256)
    is_attribute = (values[:-2] < _DRACO_TYPES) & (values[1:-1] - 1 < _DRACO_DATA_TYPES) & (values[2:] > 0)
    for attribute in map(int, np.flatnonzero(is_attribute)):
        check_time()
        # The count before the first attribute has up to five bytes, of which all but the last are above 127.
        for start in range(attribute - 1, max(attribute - 6, 0), -1):
            if data[start] < 128 and start < attribute - 1:
                break
            if list_at(start) is None:
                continue
            before = values[np.maximum(start - 1 - decoder_bytes * counts, 0)]
            announced = set(counts[before == counts].tolist())
            at, vectors = start, 0
            for lists in range(1, max(announced, default=0) + 1):
                found = list_at(at)
                if found is None:
                    break
                vectors, at = vectors + found[0], found[1]
                if lists in announced:
                    max_vectors = max(max_vectors, vectors)
    return max_vectors


def _draco_list(stream: io.BytesIO) -> int:
    """Return the number of vectors of a list of attributes. Raises ValueError or IndexError if it is no list."""
    count, vectors = _draco_varint(stream), 0
    for _ in range(min(count, _DRACO_LONGEST + 1)):
        kind, data_type, width, _ = stream.read(4)
        if kind >= _DRACO_TYPES or not 1 <= data_type <= _DRACO_DATA_TYPES or width == 0:
            raise ValueError
        _draco_varint(stream)  # the attribute's unique id
        vectors += -(-width // 4)
    if count > _DRACO_LONGEST:
        raise OverflowError(f"it has a list of {count:,} attributes; at most {_DRACO_LONGEST} are read")
    encodings = stream.read(count)
    if len(encodings) < max(count, 1) or max(encodings) >= _DRACO_ENCODINGS:
        raise ValueError
    return vectors


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
