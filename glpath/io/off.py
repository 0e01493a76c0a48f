"""OFF files as arrays: vertices, then faces of any number of corners, with colours behind them in some.

Source: Geomview manual, section 4.2.5 (OFF); also with the number of vertices behind the keyword, as in ModelNet.
"""

from __future__ import annotations

import re
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from glpath.io.polygons import split_finite
from glpath.io.text import decoded, parse_numbers, with_plain_nan
from glpath.scene.geometry import Float64
from glpath.scene.source_location import SourceLocation

Int64 = NDArray[np.int64]

# ST, C and N announce texture coordinates, colours and normals of vertices, which follow the position.
_KEYWORD = re.compile(r"(ST)?(C)?(N)?OFF(\d*)", re.IGNORECASE)


def read_off(content: bytes, source: str) -> tuple[Float64, Int64, bool]:
    """Return positions (V, 3), triangles (T, 3), and True if vertices or faces have colours, which are not read.

    Warns of faces that are left out; vertices without faces are not returned. Raises ValueError, and SceneError for
    a face with a vertex that does not exist.

    source : the file, for errors and warnings
    """
    text = with_plain_nan(decoded(content))
    lines = [words for line in text.splitlines() if (words := line.partition("#")[0].split())]
    keyword = _KEYWORD.fullmatch(lines[0][0]) if lines else None
    if keyword is None:
        raise ValueError("it does not begin with OFF, COFF, NOFF or STOFF")
    # The number of vertices may follow the keyword without a space.
    lines[0] = [keyword[4], *lines[0][1:]] if keyword[4] else lines[0][1:]
    counts, *lines = lines if lines[0] else lines[1:]
    vertices, faces = int(counts[0]), int(counts[1])
    rows, outlines = lines[:vertices], lines[vertices:][:faces]
    if len(outlines) < faces:
        raise ValueError(f"it announces {vertices} vertices and {faces} faces, and has {len(lines)} lines for them")
    positions = parse_numbers(" ".join(" ".join(row[:3]) for row in rows)).reshape(-1, 3)
    sizes = np.array([int(words[0]) for words in outlines], np.int64)
    listed = [words[1 : 1 + size] for words, size in zip(outlines, sizes.tolist(), strict=True)]
    corners = np.array(list(map(int, chain.from_iterable(listed))), np.int64)
    if len(corners) != sizes.sum():
        face = next(i for i, (words, size) in enumerate(zip(listed, sizes, strict=True)) if len(words) != size)
        raise ValueError(f"face {face} announces {sizes[face]} corners and has {len(listed[face])}")
    if (wrong := (corners < 0) | (corners >= len(positions))).any():
        corner = int(np.argmax(wrong))
        location = SourceLocation(source, f"face {np.searchsorted(np.cumsum(sizes), corner, 'right')}")
        raise location.error(
            f"names vertex {corners[corner]}, but the file has {len(positions)} vertices "
            f"(0 to {len(positions) - 1}).",
            "Vertex indices of OFF files count from 0.",
        )
    split = split_finite(source, positions, corners, sizes)
    has_colours = bool(keyword[2]) or any(len(words) > 1 + int(words[0]) for words in outlines)
    used, triangles = np.unique(corners[split.triangles], return_inverse=True)
    return positions[used], triangles.reshape(-1, 3), has_colours
