"""Streams of triangles: a .npy file that is read piece by piece, or a Python object that makes chunks.

The file is read and not memory-mapped, because mapped pages count as memory of the process.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.io.values import LARGEST, nearby_files
from glpath.scene.geometry import Float64, placed
from glpath.scene.source_location import SourceLocation
from glpath.scene.stream import Stream
from glpath.scene.tessellate import without_area
from glpath.system.files import absence_of, open_file

#: Number of triangles that are read from a file at once: 2 MB, and about 20 MB while they are processed.
CHUNK = 1 << 15


class Chunks(Protocol):
    """Source of triangles in pieces that fit into memory; every call returns the same pieces.

    `chunk(i)` is the corners (F, 3, 3) of piece i, or vertices (V, 3) and faces (F, 3) that share them, as numpy
    arrays, in object space; counter-clockwise seen from the front.
    """

    def __len__(self) -> int:
        """Return the number of chunks."""

    def chunk(self, index: int) -> Any:
        """Return the triangles of one chunk."""


@dataclass(frozen=True)
class NpyTriangles:
    """Triangles of a .npy file with an array (T, 3, 3), read on request and not kept in memory.

    path  : path of the file
    dtype : type of the numbers in the file
    count : T
    start : offset of the array in the file, bytes
    """

    path: Path
    dtype: np.dtype[Any]
    count: int
    start: int

    @classmethod
    def open(cls, path: Path, location: SourceLocation) -> NpyTriangles:
        """Return the triangles of a file. Raises SceneError if it does not hold such an array."""
        if path.suffix.lower() != ".npy":
            raise location.wrong(
                path.name, "a .npy file", "`numpy.save` writes one; other formats are shapes of the type mesh."
            )
        if not os.path.isfile(path):
            raise location.error(
                f"names {path}: {absence_of(path, 'no such file')}.", nearby_files("Files", path, (".npy",))
            )
        try:
            with open_file(path) as file:
                version = np.lib.format.read_magic(file)
                read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                shape, fortran, dtype = read[version](file)
                start = file.tell()
        except OSError as error:
            raise location.error(f"names {path}, which cannot be read: {error.strerror}.") from error
        except Exception as error:  # numpy evaluates the header as Python, which may raise any error
            raise location.error(f"names {path}, which is no .npy file of numpy's.") from error
        right = len(shape) == 3 and shape[1:] == (3, 3) and shape[0] > 0 and dtype.kind == "f" and not fortran
        if not right or dtype.itemsize not in (4, 8):
            order = ", in Fortran's order" if fortran else ""
            raise location.error(
                f"names {path}, an array of shape {shape} and type {dtype}{order}, but must be one of shape "
                "(T, 3, 3) and type float32 or float64: the three corners of T triangles.",
                "numpy.save(path, np.ascontiguousarray(vertices[faces], np.float32))",
            )
        needed = start + shape[0] * 9 * dtype.itemsize
        found = os.path.getsize(path)
        if found < needed:
            raise location.error(f"names {path}, which ends after {found:,} of {needed:,} bytes.", "Copy it again.")
        return cls(path, dtype, shape[0], start)

    def __len__(self) -> int:
        return -(-self.count // CHUNK)

    def chunk(self, index: int) -> NDArray[Any]:
        first = index * CHUNK
        count = min(CHUNK, self.count - first)
        offset = self.start + first * 9 * self.dtype.itemsize
        try:
            found = np.fromfile(self.path, self.dtype, 9 * count, offset=offset)
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be read any more: {error.strerror}.") from error
        if len(found) != 9 * count:
            raise SceneError(f"{self.path}: ends within triangle {first + len(found) // 9:,}.", "Was it changed?")
        return found.reshape(-1, 3, 3)


@dataclass(frozen=True)
class _Placed:
    """Chunks in world space, checked, without triangles that have no area."""

    chunks: Chunks
    world_from_object: Float64
    reverse: bool
    location: SourceLocation

    def chunk(self, index: int) -> Float64:
        here = self.location.field("chunk").item(index)
        given = self.chunks.chunk(index)
        triangles = _corners(given, here)
        bad = np.argwhere(~(np.abs(triangles) <= LARGEST))
        if len(bad):
            raise here.item(int(bad[0, 0])).error(
                f"has a coordinate that is not finite or beyond {LARGEST:g} scene units.",
                "Check what makes the triangles.",
            )
        world = placed(triangles.astype(np.float64), self.world_from_object)
        if self.reverse:
            world = world[:, ::-1]
        flat = without_area(world)
        return world[~flat] if flat.any() else world


def stream_of(chunks: Chunks, world_from_object: Float64, reverse: bool, location: SourceLocation) -> Stream:
    """Return the stream of chunks under a transform (3, 4). Raises SceneError.

    reverse  : True swaps front and back of all triangles
    location : location of the shape, for errors

    Cost: reads all chunks once, for their bounding boxes and the digest.
    """
    try:
        number = len(chunks)
    except TypeError:
        number = 0
    if not callable(getattr(chunks, "chunk", None)) or not number:
        raise location.field("stream").error(
            f"is a {type(chunks).__name__}, but must have chunk(i), and len() of at least 1.",
            "class Terrain: __len__ says how many chunks; chunk(i) gives corners (F, 3, 3), or vertices and faces.",
        )
    made = _Placed(chunks, world_from_object, reverse, location)
    digest = hashlib.sha256()
    counts, lower, upper = [], [], []
    for index in range(number):
        triangles = made.chunk(index)
        digest.update(np.ascontiguousarray(triangles, "<f8").tobytes())
        if not len(triangles):
            raise location.field("chunk").item(index).error("has no triangles with an area.", "Leave it out.")
        counts.append(len(triangles))
        lower.append(triangles.min(axis=(0, 1)))
        upper.append(triangles.max(axis=(0, 1)))
    return Stream(
        made.chunk, np.array(counts, np.int64), np.array(lower), np.array(upper), digest.hexdigest(), str(location)
    )


def _corners(given: Any, location: SourceLocation) -> NDArray[Any]:
    """Return the corners (F, 3, 3) of a chunk. Raises SceneError."""
    if isinstance(given, tuple) and len(given) == 2:
        vertices, faces = np.asarray(given[0]), np.asarray(given[1])
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise location.error(
                f"is arrays of shape {vertices.shape} and {faces.shape}, but must be vertices (V, 3) and faces "
                "(F, 3)."
            )
        if faces.dtype.kind not in "iu" or (len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices)):
            raise location.error(
                f"has faces that are no numbers of its {len(vertices)} vertices.",
                "They count from 0, in each chunk.",
            )
        given = vertices[faces]
    corners = np.asarray(given)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3) or corners.dtype.kind not in "fiu":
        raise location.error(
            f"is an array of shape {corners.shape} and type {corners.dtype}, but must be corners (F, 3, 3)."
        )
    return corners
