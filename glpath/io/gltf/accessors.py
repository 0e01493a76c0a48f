"""Accessors: typed arrays in buffers, decoded with numpy.

Source: glTF 2.0, 3.6.2 (strides, padding of matrices, sparse values) and 3.11 (normalised integers as numbers).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf import limits
from glpath.io.gltf.document import Document
from glpath.io.gltf.table import Table
from glpath.io.values import LARGEST, as_float64, finite_rows
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation

_COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"), 5121: np.dtype("<u1"), 5122: np.dtype("<i2"), 5123: np.dtype("<u2"),
    5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
#: Optional vertex attributes, with their names in messages.
OPTIONAL_ATTRIBUTES = {
    "NORMAL": "normals",
    **dict.fromkeys(("TEXCOORD_0", "TEXCOORD_1"), "texture coordinates"),
    "COLOR_0": "colours",
}
_INDICES = {kind: _COMPONENTS[kind] for kind in (5121, 5123, 5125)}
#: Rows and columns of each type; columns of matrices begin at multiples of four bytes.
_TYPES = {
    "SCALAR": (1, 1), "VEC2": (2, 1), "VEC3": (3, 1), "VEC4": (4, 1), "MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)
}  # fmt: skip


@dataclass
class Accessors:
    """Accessors of a document, each decoded once.

    left_out : number of rows set to zero because a value was not finite, by kind of attribute
    """

    document: Document
    left_out: Counter[str] = field(default_factory=Counter)
    _stored: dict[int, NDArray[Any]] = field(default_factory=dict)
    _floats: dict[int, Float64] = field(default_factory=dict)
    _finite: set[int] = field(default_factory=set)
    _ascending: set[int] = field(default_factory=set)

    def floats(self, index: int, widths: tuple[int, ...], location: SourceLocation) -> Float64:
        """Return the (N, k) float64 values of an accessor, all finite; read-only.

        Normalised integers become numbers in [-1, 1] or [0, 1]. A matrix has its columns one after the other.

        widths   : allowed values of k
        location : location of the use, for error messages
        """
        values = self._converted(index)
        self._check_width(values, widths, index, location)
        if index not in self._finite:
            # A comparison needs no copy of the numbers. `_converted` has counted their memory once.
            allowed = (values >= -LARGEST) & (values <= LARGEST)
            if not allowed.all():
                row, column = np.unravel_index(np.argmin(allowed), allowed.shape)
                raise (
                    location.item(int(row))
                    .item(int(column))
                    .wrong(float(values[row, column]), f"a finite number between -{LARGEST:g} and {LARGEST:g}")
                )
            self._finite.add(index)
        return values

    def keys(self, index: int, location: SourceLocation) -> Float64:
        """Return the (N,) times of keyframes, which do not descend. Raises SceneError if they do."""
        times = self.floats(index, (1,), location)[:, 0]
        if index not in self._ascending:
            early = np.diff(times) < 0
            if early.any():
                raise location.item(int(np.argmax(early)) + 1).error(
                    "is before the key before it.", "Keys are in order."
                )
            self._ascending.add(index)
        return times

    def attribute(self, name: str, index: int, widths: tuple[int, ...], location: SourceLocation) -> Float64:
        """Return the values of an attribute like `floats`, with zeros for bad rows of an optional attribute.

        A row is bad if it has a value that is not finite.

        name : name of the attribute, such as NORMAL
        """
        if name in OPTIONAL_ATTRIBUTES and index not in self._finite:
            self._floats[index] = self.repaired(name, self._converted(index))
        return self.floats(index, widths, location)

    def repaired(self, name: str, values: Float64) -> Float64:
        """Return values (N, k) of an optional attribute with zeros for rows that are not finite.

        `left_out` counts these rows.
        """
        counts: dict[str, int] = {}
        values = finite_rows(values, OPTIONAL_ATTRIBUTES[name], counts)
        self.left_out.update(counts)
        return values

    def _converted(self, index: int) -> Float64:
        """Return (N, k) float64; integers are normalised if the accessor has that flag."""
        if index not in self._floats:
            table = self.document.all("accessors")[index]
            stored = self._array(index)
            self.document.take(8 * stored.size, table.location)
            values = as_float64(stored)
            if table.flag("normalized") and stored.dtype.kind != "f":
                values /= np.iinfo(stored.dtype).max
                np.maximum(values, -1.0, out=values)
            values.flags.writeable = False
            self._floats[index] = values
        return self._floats[index]

    def integers(self, index: int, width: int, location: SourceLocation) -> NDArray[np.int64]:
        """Return an accessor of unsigned integers as (N, width) int64."""
        stored = self._array(index)
        if stored.dtype.kind != "u":
            raise location.error(
                f"names accessors[{index}] of {stored.dtype.name} values, but must be unsigned integers.",
                "Export the file anew.",
            )
        self._check_width(stored, (width,), index, location)
        self.document.take(8 * stored.size, location)
        return stored.astype(np.int64)

    def _check_width(
        self, values: NDArray[Any], widths: tuple[int, ...], index: int, location: SourceLocation
    ) -> None:
        if values.shape[1] not in widths:
            raise location.error(
                f"names accessors[{index}] with {values.shape[1]} numbers an element, but must have "
                f"{' or '.join(str(width) for width in widths)}.",
                "Export the file anew.",
            )

    def _array(self, index: int) -> NDArray[Any]:
        """Return the (N, k) values in their stored type."""
        if index not in self._stored:
            self._stored[index] = self._read(self.document.all("accessors")[index])
        return self._stored[index]

    def _read(self, table: Table) -> NDArray[Any]:
        kind: np.dtype[Any] = table.required_choice("componentType", _COMPONENTS)
        rows, columns = table.required_choice("type", _TYPES)
        count = table.required("count", 0)
        views = self.document.all("bufferViews")
        view = table.index("bufferView", views, "buffer views")
        sparse = table.table("sparse") if "sparse" in table else None
        if view is None:
            if count > limits.MAX_ZEROS:
                raise table.location.field("count").error(
                    f"is {count:,}, but an accessor without a buffer view has at most {limits.MAX_ZEROS:,} zeros.",
                    "The file was written wrongly, or to take up memory.",
                )
            self.document.take(count * rows * columns * kind.itemsize, table.location)
            values = np.zeros((count, rows * columns), kind)
        else:
            values = self._elements(table, views[view], view, count, kind, rows, columns)
        return values if sparse is None else self._with_sparse(values, sparse, rows, columns)

    def _elements(
        self, table: Table, view: Table, index: int, count: int, kind: np.dtype[Any], rows: int, columns: int
    ) -> NDArray[Any]:
        """Return a copy of the elements in a buffer view, (count, rows * columns)."""
        data = self.document.view(index)
        offset = table.integer("byteOffset", 0)
        column = rows * kind.itemsize if columns == 1 else -(-rows * kind.itemsize // 4) * 4
        size = column * columns if columns == 1 else column * (columns - 1) + rows * kind.itemsize
        stride = view.integer("byteStride", column * columns, 1, 2**16)
        if stride < size:
            raise view.location.field("byteStride").error(
                f"is {stride}, but an element of {table.location.path} has {size} bytes.", "Export the file anew."
            )
        if count == 0:
            return np.zeros((0, rows * columns), kind)
        end = offset + stride * (count - 1) + size
        if end > len(data):
            raise table.location.field("count").error(
                f"is {count:,}, and so reaches to byte {end:,}, but bufferViews[{index}] has {len(data):,}.",
                "The file is cut off, or was written wrongly.",
            )
        self.document.take(count * rows * columns * kind.itemsize, table.location)
        # Offset and strides are in bytes. The offset may be odd, because numpy reads unaligned numbers.
        strided = np.ndarray((count, columns, rows), kind, data, offset, (stride, column, kind.itemsize))
        return np.array(strided).reshape(count, rows * columns)

    def _with_sparse(self, values: NDArray[Any], sparse: Table, rows: int, columns: int) -> NDArray[Any]:
        """Replace in place the elements of `values` that `sparse` lists; return `values`."""
        count = sparse.required("count", 1, len(values))
        views = self.document.all("bufferViews")
        of_indices, of_values = sparse.table("indices"), sparse.table("values")
        kind = of_indices.required_choice("componentType", _INDICES)
        where, what = (
            self._elements(each, Table({}, each.location), each.required_index("bufferView", views, "buffer views"),
                           count, dtype, high, wide)
            for each, dtype, high, wide in ((of_indices, kind, 1, 1), (of_values, values.dtype, rows, columns))
        )  # fmt: skip
        numbers = where[:, 0].astype(np.int64)
        if numbers.max() >= len(values):
            bad = int(np.argmax(numbers >= len(values)))
            raise of_indices.location.item(bad).error(
                f"is {numbers[bad]}, but the accessor has {len(values):,} elements.", "Export the file anew."
            )
        values[numbers] = what
        return values
