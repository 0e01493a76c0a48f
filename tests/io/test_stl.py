"""STL files whose counts and ends are wrong: the whole facets are read, with a warning that has both numbers."""

from __future__ import annotations

import cProfile
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from glpath import load_scene
from glpath.errors import SceneError, SceneWarning
from glpath.io import text as text_module
from glpath.io.completed import aside
from glpath.io.stl import read_stl
from glpath.scene.model import Scene

BOX = trimesh.creation.box((2, 2, 2))
BINARY: bytes = BOX.export(file_type="stl")
ASCII: str = BOX.export(file_type="stl_ascii")
FACETS = [BINARY[start : start + 50] for start in range(84, len(BINARY), 50)]
#: Two triangles of each side of the box, of an area of 2 each.
FACET_AREA = 2.0


def counted(count: int, facets: bytes) -> bytes:
    return BINARY[:80] + count.to_bytes(4, "little") + facets


def with_vertex(number: float, facet: bytes) -> bytes:
    return facet[:12] + np.float32(number).tobytes() + facet[16:]


def read(folder: Path, content: bytes) -> tuple[Scene, list[str]]:
    (folder / "a.stl").write_bytes(content)
    with warnings.catch_warnings(record=True) as caught, aside("camera", "light"):
        warnings.simplefilter("always")
        scene = load_scene(folder / "a.stl")
    return scene, [str(each.message).partition("a.stl: ")[2] for each in caught]


ALL = b"".join(FACETS)
DAMAGED = {
    "whole": (BINARY, 12, ""),
    "count 0": (counted(0, ALL), 12, "its header announces 0 facets, but 12 whole ones are read."),
    "count too high": (counted(13, ALL), 12, "its header announces 13 facets, but 12 whole ones are read."),
    "count far too high": (counted(2**32 - 1, ALL), 12, "announces 4,294,967,295 facets, but 12 whole"),
    "count too low": (counted(7, ALL), 12, "its header announces 7 facets, but 12 whole ones are read."),
    "one byte behind": (BINARY + b"\n", 12, "12 whole ones are read, and 1 bytes behind them are not."),
    "text behind": (
        BINARY + b"made by nobody in particular, 2026".ljust(50),
        12,
        "and 50 bytes behind them are not.",
    ),
    "cut in the last facet": (BINARY[:-20], 11, "announces 12 facets, but 11 whole ones are read, and 30 bytes"),
    "payload": (
        counted(12, b"".join(facet[:48] + b"\x06\x00abcdef" for facet in FACETS)),
        12,
        "72 bytes of attributes behind its 12 facets are not used.",
    ),
    "nan": (
        counted(12, ALL[:-50] + with_vertex(np.nan, FACETS[-1])),
        11,
        "left out: vertices that are not finite (1), faces with such a vertex (1).",
    ),
    "header that begins with solid": (b"solid facet".ljust(80, b"\0") + BINARY[80:] + b"\0", 12, "1 bytes behind"),
    "ascii": (ASCII.encode(), 12, ""),
    "ascii without endsolid": (ASCII.replace("endsolid", "").encode(), 12, "without endsolid: 12 whole facets are"),
    "ascii cut off": (
        ASCII[: ASCII.rindex("vertex") + 9].encode(),
        11,
        "ends without endsolid: 11 whole facets are read, and 3 corners of one that is not whole are left out.",
    ),
    "ascii, all on one line": (" ".join(ASCII.split()).encode(), 12, ""),
    "ascii, old Mac": (ASCII.replace("\n", "\r").encode(), 12, ""),
    "ascii in capitals": (ASCII.upper().encode(), 12, ""),
    "ascii with a name of the format's words": (ASCII.replace("solid", "solid vertex facet", 1).encode(), 12, ""),
    "ascii with a name of two words of the format": (
        ASCII.replace("solid ", "solid facet vertex demo ").encode(),
        12,
        "",
    ),
    "ascii in UTF-16": (ASCII.encode("utf-16"), 12, ""),
    "ascii in UTF-16 without a mark": (ASCII.encode("utf-16-le"), 12, ""),
    "ascii of DOS": (ASCII.encode() + b"\x1a", 12, ""),
    "ascii nan": (
        ASCII.replace("vertex 1.0", "vertex -nan(ind)", 1).encode(),
        11,
        "left out: vertices that are not finite (1), faces with such a vertex (1).",
    ),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_whole_facets_are_read_and_both_numbers_are_told(tmp_path: Path, name: str) -> None:
    content, facets, message = DAMAGED[name]
    scene, messages = read(tmp_path, content)
    assert scene.areas.sum() == pytest.approx(FACET_AREA * facets)
    assert len(messages) == bool(message)
    assert message in "".join(messages)


def test_solids_of_an_ascii_file_are_shapes(tmp_path: Path) -> None:
    scene, messages = read(tmp_path, (ASCII + ASCII.replace("endsolid", "")).encode())
    assert [len(shape.geometry.faces) for shape in scene.shapes] == [12, 12]  # type: ignore[union-attr]
    assert "24 whole facets" in messages[0]


def test_a_facet_of_four_corners_is_two_triangles(tmp_path: Path) -> None:
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    loop = "".join(f"vertex {x} {y} 0\n" for x, y in corners)
    text = f"solid a\nfacet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\nendsolid a\n"
    scene, messages = read(tmp_path, text.encode())
    assert (scene.areas.sum(), messages) == (1.0, [])


@pytest.mark.parametrize("content", [b"", b"solid a\nendsolid a\n", bytes(84), BINARY[:60], BINARY[:100]])
def test_a_file_without_a_whole_facet_is_an_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.stl").write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(SceneError, match=r"a\.stl: (has no triangles|cannot be read)"):
            load_scene(tmp_path / "a.stl")


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off"])
def test_a_wrong_number_in_a_long_file_is_found_by_bisection(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 3000
    rows = [*(f"{i} 0 {i % 2}" for i in range(count - 1)), "0 0 1_0"]
    vertices = "\n".join(rows) + "\n"
    ply = f"ply\nformat ascii 1.0\nelement vertex {count}\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    text, line = {
        "stl": ("solid a\nfacet\nouter loop\n" + "".join(f"vertex {v}\n" for v in rows), count + 3),
        "ply": (f"{ply}element face 0\nproperty list uchar int vertex_indices\nend_header\n{vertices}", count + 9),
        "obj": ("".join(f"v {v}\n" for v in rows) + "f 1 2 3\n", count),
        "off": (f"OFF\n{count} 1 0\n{vertices}3 0 1 2\n", count + 2),
    }[suffix]
    calls = []
    parse = text_module._parse_piece
    monkeypatch.setattr(text_module, "_parse_piece", lambda words: calls.append(words) or parse(words))
    (tmp_path / f"a.{suffix}").write_text(text)
    with pytest.raises(SceneError, match=f'line {line} has "1_0", which is not a number'):
        load_scene(tmp_path / f"a.{suffix}")
    assert len(calls) < 50


def test_the_first_short_vertex_of_an_ascii_file_is_told(tmp_path: Path) -> None:
    lines = ["solid a", "facet", "outer loop", "vertex 0 0 0", "vertex 1 0", "vertex 0 x 0", "endloop", "endfacet"]
    (tmp_path / "a.stl").write_text("\n".join(lines))
    with pytest.raises(SceneError, match="line 5 has 2 numbers, but a vertex has 3"):
        load_scene(tmp_path / "a.stl")
    lines[3] = "vertex y 0 0"
    (tmp_path / "a.stl").write_text("\n".join(lines))
    with pytest.raises(SceneError, match='line 4 has "y", which is not a number'):
        load_scene(tmp_path / "a.stl")


def test_many_solids_of_an_ascii_file_are_split_in_linear_time() -> None:
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\nendloop\nendfacet\n"
    text = "".join(f"solid s\n{facet.format(i, i + 1) * (1 + i % 3)}endsolid s\n" for i in range(10_000))
    start = time.process_time()
    solids = read_stl(text.encode(), "a.stl")
    assert time.process_time() - start < 5
    assert [len(each.corners) for each in solids] == [1 + i % 3 for i in range(10_000)]
    assert all((each.corners[:, 0, 0] == i).all() for i, each in enumerate(solids))


def test_solids_without_a_facet_are_left_out_with_few_calls() -> None:
    """Fewer than ten calls for each solid, however long a call takes on a busy machine."""
    profile = cProfile.Profile()
    with pytest.warns(SceneWarning, match="2,000 corners"):
        solids = profile.runcall(read_stl, b"solid\n" * 2000 + b"solid\nvertex 0 0 0\n" * 2000, "a.stl")
    assert solids == []
    assert sum(row.callcount for row in profile.getstats()) < 10 * 4000
