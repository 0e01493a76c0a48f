"""Polygons and points with values, for ParaView and PyVista: VTK's XML, written without VTK.

    found.to_vtk("cornell-box").save("room.vtp")

Cost:   a copy of the arrays in base64.
Source: Kitware, VTK XML file formats, PolyData (.vtp) and UnstructuredGrid (.vtu), inline base64.
"""

from __future__ import annotations

import base64
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.system.arguments import is_numbers, short_repr
from glpath.system.files import whole_file
from glpath.system.frames import package

_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
# VTK's cell types by number of corners: vertex, triangle and quadrilateral.
_CELLS = {1: 1, 3: 5, 4: 9}
# VTK's cell type of other polygons.
_POLYGON = 7
# Characters that XML 1.0 does not allow, and other control characters.
_NOT_IN_XML = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


@dataclass(frozen=True, eq=False)
class VtkMesh:
    """Polygons, or points alone, with values.

    points      : (V, 3) float64
    polygons    : indices of the points of each cell; a cell of a point alone has one index
    cell_data   : values on cells by name, (C,) or (C, k) each
    point_data  : values on points by name, (V,) or (V, k) each

    Raises UsageError for polygons of other points, and for values that are not real numbers or of another length.
    """

    points: NDArray[np.float64]
    polygons: Sequence[Sequence[int]]
    cell_data: Mapping[str, Any] = field(default_factory=dict)
    point_data: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        try:
            self._check_polygons(*self.connectivity)
        except (TypeError, ValueError, OverflowError, NotImplementedError):
            needed = "lists of numbers of points are needed, such as [[0, 1, 2], [2, 3, 0]]"
            raise UsageError(f"polygons: {short_repr(self.polygons)} where {needed}") from None
        for what, data, count in (
            ("cell", self.cell_data, len(self.polygons)),
            ("point", self.point_data, len(self.points)),
        ):
            for name, values in data.items():
                if not isinstance(name, str) or _NOT_IN_XML.search(name):
                    raise UsageError(
                        f"{short_repr(name)}: is no name of values: it is no text, or has control characters.",
                        "Name the values otherwise.",
                    )
                if not is_numbers(values):
                    raise UsageError(f"{name}: {short_repr(values)} where an array of real numbers is needed.")
                if np.ndim(values) not in (1, 2) or len(values) != count:
                    raise UsageError(
                        f"{name}: values of shape {np.shape(values)}, but there are {count:,} {what}s.",
                        f"Give one value, or one row of values, for each {what}.",
                    )

    @cached_property
    def connectivity(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices of the points of all cells in one array, and the end of each cell in it."""
        ends = np.cumsum([len(polygon) for polygon in self.polygons], dtype=np.int64)
        numbers = np.fromiter(chain.from_iterable(self.polygons), np.float64, int(ends[-1]) if len(ends) else 0)
        if not ((np.abs(numbers) <= 1 << 53) & (numbers == np.rint(numbers))).all():
            raise ValueError("numbers of points are not whole")
        return numbers.astype(np.int64), ends

    def _check_polygons(self, flat: NDArray[np.int64], ends: NDArray[np.int64]) -> None:
        """Raise UsageError for a polygon without points, and for one of points that do not exist."""
        wrong = (flat < 0) | (flat >= len(self.points))
        if wrong.any():
            at = int(np.argmax(wrong))
            raise UsageError(
                f"polygons[{np.searchsorted(ends, at, side='right')}]: names point {flat[at]}, but there are "
                f"{len(self.points):,} points.",
                "Points are counted from 0.",
            )
        if (np.diff(ends, prepend=0) == 0).any():
            raise UsageError("polygons: one has no points.", "Leave it out.")

    def save(self, path: str | Path) -> None:
        """Write a .vtp (PolyData) or .vtu (UnstructuredGrid) file atomically.

        Raises UsageError for another suffix, and ImageError if the file cannot be written.
        """
        target = Path(path)
        suffix = target.suffix.lower()
        if suffix not in (".vtp", ".vtu"):
            raise UsageError(f"{path}: values on faces are written as .vtp or .vtu.", "For example room.vtp.")
        with whole_file(target) as temporary:
            temporary.write_text(self._xml(suffix == ".vtu"), encoding="utf-8")

    def to_pyvista(self) -> Any:
        """Return a `pyvista.PolyData`. Raises GlpathError if PyVista is missing."""
        pyvista = package("pyvista")
        flat, ends = self.connectivity
        begins = np.concatenate([[0], ends[:-1]])
        cells = np.insert(flat, begins, np.diff(ends, prepend=0))  # the count precedes the indices of each cell
        alone = all(len(polygon) == 1 for polygon in self.polygons)
        mesh = pyvista.PolyData(self.points, **{"verts" if alone else "faces": cells})
        for data, own in ((self.cell_data, mesh.cell_data), (self.point_data, mesh.point_data)):
            for name, values in data.items():
                own[name] = np.asarray(values)
        return mesh

    def _xml(self, unstructured: bool) -> str:
        flat, ends = self.connectivity
        count, total = len(self.points), len(self.polygons)
        points = _section("Points", [_array("Points", self.points)])
        data = [_section("PointData", _arrays(self.point_data)), _section("CellData", _arrays(self.cell_data))]
        lists = [_array("connectivity", flat), _array("offsets", ends)]
        if unstructured:
            kinds = np.array([_CELLS.get(len(polygon), _POLYGON) for polygon in self.polygons], np.uint8)
            cells = _section("Cells", [*lists, _array("types", kinds)])
            kind, sizes = "UnstructuredGrid", f'NumberOfPoints="{count}" NumberOfCells="{total}"'
        else:
            alone = all(len(polygon) == 1 for polygon in self.polygons)
            cells = _section("Verts" if alone else "Polys", lists)
            vertices, faces = (total, 0) if alone else (0, total)
            kind = "PolyData"
            sizes = f'NumberOfPoints="{count}" NumberOfVerts="{vertices}" NumberOfPolys="{faces}"'
        body = "".join([*data, points, cells])
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
            f"<{kind}><Piece {sizes}>\n{body}</Piece></{kind}>\n</VTKFile>\n"
        )


def points_with_values(points: Any, values: Mapping[str, Any]) -> VtkMesh:
    """Return a mesh of points (N, 3), each of them a cell, with values by name, (N,) or (N, k) each."""
    at = np.asarray(points, np.float64)
    if at.ndim != 2 or at.shape[1:] != (3,):
        raise UsageError(f"points: of shape {at.shape}, but must be (N, 3).")
    return VtkMesh(at, [[i] for i in range(len(at))], point_data=values)


def _section(tag: str, arrays: Sequence[str]) -> str:
    return f"<{tag}>\n{''.join(arrays)}</{tag}>\n"


def _arrays(data: Mapping[str, Any]) -> list[str]:
    return [_array(name, np.asarray(values)) for name, values in data.items()]


def _array(name: str, values: NDArray[Any]) -> str:
    """Return a DataArray element: base64 of its size in bytes and of its values."""
    kind = values.dtype.str[1:] if values.dtype.str[1:] in _TYPES else "f8"
    content = np.ascontiguousarray(values, f"<{kind}").tobytes()
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    text = base64.b64encode(struct.pack("<Q", len(content)) + content).decode()
    return f'<DataArray type="{_TYPES[kind]}" Name={quoteattr(name)}{columns} format="binary">{text}</DataArray>\n'
