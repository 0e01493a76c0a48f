"""OBJ files in the plain form that trimesh reads, from all that the format allows and that exporters write.

Statements are indented, separated by tabs, continued on the next line after a backslash, followed by comments; the
text is UTF-8, UTF-16 or, in old files, Latin-1. Indices count from 1, or backwards from the vertex before.

Source: Wavefront's Advanced Visualizer manual, appendix B1 (Object Files).
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator

from glpath.scene.place import Place

# Numbers of a vertex, texture coordinate and normal that are used; a vertex may have a weight or a colour behind.
_USED = {"v": 3, "vt": 2, "vn": 3}
_NAMES = {"v": "vertex", "vt": "texture coordinate", "vn": "normal"}
_PLURALS = {"v": "vertices", "vt": "texture coordinates", "vn": "normals"}
# What trimesh is given; it knows no other statement, or is asked not to look.
_KEPT = ("o", "g", "usemtl")


def plain(content: bytes, source: str) -> tuple[bytes, list[str]]:
    """The file with one statement a line, separated by blanks, and indices that count from 1; and what it drops.

    source : the file, for errors

    Raises SceneError for an index that names nothing, and ValueError for what is no number.
    """
    statements = [(number, words) for number, line in _lines(decoded(content)) if (words := line.split())]
    totals = {kind: sum(words[0] == kind for _, words in statements) for kind in _USED}
    seen = dict.fromkeys(_USED, 0)
    known: dict[str, str] = {}  # corners that mean the same on every line
    lines, dropped = [], set()
    for number, words in statements:
        kind, values = words[0], words[1:]
        if kind in _USED:
            seen[kind] += 1
            if kind == "v" and len(values) >= 6:
                dropped.add("vertex colours")
            # A texture of one dimension has no v.
            values = [*values, "0"] if kind == "vt" and len(values) == 1 else values[: _USED[kind]]
        elif kind == "f":
            for value in values:
                if value not in known or "-" in value:
                    known[value] = _corner(value, seen, totals, source, number)
            values = [known[value] for value in values]
        elif kind in ("mtllib", "usemtl"):
            dropped.add("materials")
        if kind not in ("f", *_USED, *_KEPT):
            continue
        lines.append(" ".join([kind, *values]))
    return "\n".join(lines).encode(), sorted(dropped)


def decoded(content: bytes) -> str:
    """The text, whose geometry is ASCII in any case."""
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    if b"\0" in content[:2]:
        return content.decode("utf-16-be" if content[:1] == b"\0" else "utf-16-le", errors="replace")
    return content.decode("latin-1")


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Statements without comments, and the number of the line on which each begins, from 1."""
    begun, before = 0, ""
    # Not splitlines, which knows ends of lines that are letters in Latin-1.
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        line = line.partition("#")[0].rstrip()
        begun = begun or number
        if line.endswith("\\"):
            before += line[:-1] + " "
            continue
        yield begun, before + line
        begun, before = 0, ""
    if before:
        yield begun, before


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
            raise Place(source, f"line {line}").error(
                f"names {_NAMES[kind]} {written}, but the file has {total} {_PLURALS[kind]} (1 to {total}).",
                "Vertex indices of OBJ files count from 1.",
            )
        indices.append(str(index))
    return "/".join(indices).rstrip("/")
