"""OBJ files in the plain form that trimesh reads, from all that the format allows and that exporters write.

Indices count from 1, or backwards from the vertex before; for what else there is see `text`. The materials that
faces name are numbered, as trimesh takes a name for one word.

Source: Wavefront's Advanced Visualizer manual, appendix B1 (Object Files).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glpath.io.text import decoded, statements
from glpath.scene.source_location import SourceLocation

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Numbers of a vertex, texture coordinate and normal that are used; a vertex may have a weight or a colour behind.
_USED = {"v": 3, "vt": 2, "vn": 3}
_NAMES = {"v": "vertex", "vt": "texture coordinate", "vn": "normal"}
_PLURALS = {"v": "vertices", "vt": "texture coordinates", "vn": "normals"}
# Statements for trimesh beside vertices and faces.
_KEPT = ("o", "g", "usemtl")


@dataclass(frozen=True)
class Plain:
    """An OBJ file with one statement a line, separated by blanks, and indices that count from 1.

    materials : names of those that faces have: `usemtl 3` is materials[3]
    libraries : the MTL files that it names
    coloured  : vertices have colours, or some of them, which then are left out
    lines     : (L, 2) indices, from 0, of the vertices between which lines are
    """

    text: bytes
    materials: tuple[str, ...]
    libraries: tuple[str, ...]
    coloured: bool
    lines: Int64

    def vertices(self) -> tuple[Float64, Float64 | None]:
        """(N, 3) of all vertices, and (N, 3) their colours in [0, 1] where all have one. Raises ValueError."""
        rows = [line.split()[1:] for line in self.text.decode().splitlines() if line.startswith("v ")]
        numbers = np.array(rows or np.zeros((0, 3)), np.float64)
        return numbers[:, :3], numbers[:, 3:] if numbers.shape[1] == 6 else None


def plain(content: bytes, source: str) -> Plain:
    """The file in plain form.

    source : the file, for errors

    Raises SceneError for an index that names nothing, and ValueError for what is no number.
    """
    written = list(statements(decoded(content)))
    totals = {kind: sum(words[0] == kind for _, words in written) for kind in _USED}
    seen = dict.fromkeys(_USED, 0)
    known: dict[str, str] = {}  # corners that mean the same on every line
    lines = []
    drawn: list[tuple[int, int]] = []
    widths = [len(words) - 1 for _, words in written if words[0] == "v"]
    # trimesh needs colours for all vertices or for none.
    all_coloured = bool(widths) and min(widths) >= 6
    column = _colour_column([words[1:] for _, words in written if words[0] == "v"]) if all_coloured else 3
    materials: dict[str, int] = {}
    libraries: dict[str, None] = {}
    for number, words in written:
        kind, values = words[0], words[1:]
        if kind in _USED:
            seen[kind] += 1
            if kind == "v" and all_coloured:
                values = [*values[:3], *values[column:][:3]]
            else:
                # A texture of one dimension has no v.
                values = [*values, "0"] if kind == "vt" and len(values) == 1 else values[: _USED[kind]]
        elif kind == "f":
            for value in values:
                if value not in known or "-" in value:
                    known[value] = _corner(value, seen, totals, source, number)
            values = [known[value] for value in values]
        elif kind == "l":
            corners = [int(_corner(value, seen, totals, source, number).partition("/")[0]) for value in values]
            drawn += pairwise(corners)
        elif kind == "usemtl":
            values = [str(materials.setdefault(" ".join(values), len(materials)))]
        elif kind == "mtllib":
            libraries[" ".join(values)] = None
        if kind not in ("f", *_USED, *_KEPT):
            continue
        lines.append(" ".join([kind, *values]))
    if materials:
        lines.insert(0, "mtllib all")
    return Plain(
        "\n".join(lines).encode(),
        tuple(materials),
        tuple(libraries),
        max(widths, default=0) >= 6,
        np.array(drawn, np.int64).reshape(-1, 2) - 1,
    )


def _colour_column(vertices: list[list[str]]) -> int:
    """Return the index of the first colour: 3 after x y z (r g b, then perhaps alpha), or 4 after x y z weight.

    Seven numbers are x y z r g b a, unless only the fourth is 1 for all vertices.
    """
    if min(map(len, vertices)) < 7:
        return 3
    weight, alpha = ([float(values[i]) for values in vertices] for i in (3, 6))
    return 4 if set(weight) == {1.0} and set(alpha) != {1.0} else 3


class NamesOnly:
    """A resolver for trimesh's material libraries: the numbers of `Plain.materials`, so that it keeps them apart.

    With it trimesh opens no file, whatever the OBJ names.
    """

    def __init__(self, count: int) -> None:
        self._text = "".join(f"newmtl {number}\nKd 1 1 1\n" for number in range(count))

    def get(self, name: str) -> bytes:
        return self._text.encode()

    __getitem__ = get


def _corner(text: str, seen: dict[str, int], totals: dict[str, int], source: str, line: int) -> str:
    """`v`, `v/vt`, `v//vn` or `v/vt/vn` with indices from 1."""
    indices = []
    for kind, written in zip(_USED, text.split("/"), strict=False):
        if kind != "v" and not (written and totals[kind]):  # some exporters number what they leave out
            indices.append("")
            continue
        index = int(written)
        if index < 0:
            index += seen[kind] + 1
        # trimesh takes 0 for the last without a word.
        if not 1 <= index <= totals[kind]:
            total = totals[kind]
            raise SourceLocation(source, f"line {line}").error(
                f"names {_NAMES[kind]} {written}, but the file has {total} {_PLURALS[kind]} (1 to {total}).",
                "Vertex indices of OBJ files count from 1.",
            )
        indices.append(str(index))
    return "/".join(indices).rstrip("/")
