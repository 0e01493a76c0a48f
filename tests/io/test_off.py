"""OFF files: meshes as trimesh writes them; a warning for colours, an error with its line for broken files."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

import glpath
from glpath.errors import SceneError, SceneWarning

pytestmark = pytest.mark.filterwarnings("ignore:.*has no camera")

PYRAMID = """# a comment
OFF
5 5 0
0 0 0
1 0 0
1 1 0
0 1 0
0.5 0.5 0.75   # the top
4 0 3 2 1
3 0 1 4
3 1 2 4
3 2 3 4
3 3 0 4
"""


def test_a_mesh_is_that_of_an_stl(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(2, 1.5)
    for name in ("a.off", "a.stl"):
        mesh.export(tmp_path / name)
    off, stl = (glpath.load_scene(tmp_path / name).triangles for name in ("a.off", "a.stl"))
    assert off.shape == stl.shape
    assert off == pytest.approx(stl, abs=1e-6)


def test_quads_and_comments(tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_text(PYRAMID)
    scene = glpath.load_scene(tmp_path / "pyramid.off")
    corners = scene.triangles
    assert len(corners) == 6
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slanted = 4 * 0.5 * np.hypot(0.5, 0.75)
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(1 + slanted)
    # All normals point outwards.
    assert (np.einsum("nx,nx->n", normals, corners.mean(axis=1) - [0.5, 0.5, 0.2]) > 0).all()


@pytest.mark.filterwarnings("ignore:.*no light")
def test_a_shape_of_a_scene_file(tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_text(PYRAMID)
    shape = {"name": "it", "type": "mesh", "file": str(tmp_path / "pyramid.off"), "material": "grey"}
    materials = {"grey": {"reflectance": 0.5}}
    scene = glpath.load_scene({"materials": materials, "shapes": [shape]})
    assert len(scene.triangles) == 6


@pytest.mark.parametrize(
    "text",
    [
        PYRAMID.replace("OFF", "COFF").replace("0 0 0\n", "0 0 0 255 0 0 255\n"),
        PYRAMID.replace("3 3 0 4\n", "3 3 0 4 255 0 0\n"),
    ],
    ids=["vertices", "faces"],
)
def test_colours_are_not_lost_in_silence(text: str, tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_text(text)
    with pytest.warns(SceneWarning, match="Colours"):
        scene = glpath.load_scene(tmp_path / "pyramid.off")
    assert len(scene.triangles) == 6


def test_the_number_of_vertices_may_follow_the_keyword_without_a_space(tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_text(PYRAMID.replace("OFF\n", "OFF", 1))
    assert len(glpath.load_scene(tmp_path / "pyramid.off").triangles) == 6


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "cannot be read as OFF"),
        ("OFF\n", "cannot be read as OFF"),
        ("OFF\n0 0 0\n", "no triangles"),
        (PYRAMID.replace("3 3 0 4", "3 3 0 9"), "line 13 names vertex 9, but the file has 5 vertices (0 to 4)"),
        (PYRAMID.replace("0.75", "high"), 'line 8 has "high", which is not a number'),
        (PYRAMID.replace("3 3 0 4", "3 3 0"), "line 13 announces 3 corners and has 2 numbers"),
        (PYRAMID.replace("3 3 0 4", "-3 3 0 4"), "line 13 announces -3 corners"),
        (PYRAMID.replace("3 3 0 4", "3 3 0.5 4"), "line 13 has 0.5, but counts of corners and vertices are whole"),
        (PYRAMID.replace("1 1 0", "1 1"), "line 6 has 2 numbers, but a vertex of OFF has at least 3"),
        (PYRAMID.replace("OFF", "NOFF"), "line 4 has 3 numbers, but a vertex of NOFF has at least 6"),
        (PYRAMID.replace("5 5 0", "5 five"), 'line 3 has "5 five", but must have the numbers of vertices, faces'),
        (PYRAMID.replace("5 5 0", "5"), 'line 3 has "5", but must have the numbers of vertices, faces'),
        (PYRAMID.replace("5 5 0", "-5 5 0"), 'line 3 has "-5 5 0", but must have the numbers'),
        (PYRAMID.replace("OFF", "4OFF"), 'it begins with "4OFF", but must begin with OFF, COFF, NOFF or STOFF'),
        (PYRAMID.replace("OFF", "nOFF\n3"), 'it begins with "nOFF", but must begin with OFF'),
        (PYRAMID.replace("OFF", "OFF BINARY"), "it is a binary OFF file, but only those of text are read"),
        (PYRAMID[:60], "cannot be read as OFF"),
    ],
)
def test_what_is_broken_is_refused_by_name(text: str, found: str, tmp_path: Path) -> None:
    (tmp_path / "broken.off").write_text(text)
    with pytest.raises(SceneError, match=r"broken\.off") as caught:
        glpath.load_scene(tmp_path / "broken.off")
    assert found in str(caught.value)


@pytest.mark.parametrize("number", ["nan", "-nan(ind)", "1.#QNAN", "-1.#IND00", "inf", "1.#INF"])
def test_faces_with_a_vertex_that_is_not_finite_are_left_out_with_a_count(number: str, tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_text(PYRAMID.replace("0.75", number))
    with pytest.warns(SceneWarning, match=r"left out: vertices that are not finite \(1\), faces .* \(4\)\.$"):
        scene = glpath.load_scene(tmp_path / "pyramid.off")
    assert scene.areas.sum() == pytest.approx(1)


@pytest.mark.parametrize(
    "text",
    [
        PYRAMID.replace("OFF\n5 5 0", "OFF 5 5 0"),
        PYRAMID.replace("5 5 0", "5 5"),
        PYRAMID.replace("\n", "\n\n \t\n# 7 7 7\n"),
        PYRAMID.replace("\n", "\r\n"),
        PYRAMID.replace("OFF", "off"),
    ],
    ids=["counts behind the keyword", "no edges", "blank lines and comments", "ends of lines of DOS", "lower case"],
)
def test_spellings(text: str, tmp_path: Path) -> None:
    (tmp_path / "pyramid.off").write_bytes(text.encode())
    assert len(glpath.load_scene(tmp_path / "pyramid.off").triangles) == 6


@pytest.mark.parametrize("more", ["", " 9", " 9 8 7", " 255 0 0 255"])
def test_extra_values_of_a_vertex_shift_no_other(more: str, tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(f"OFF\n4 1 0\n0 0 0{more}\n1 0 0{more}\n1 1 0\n0 1 0{more}\n4 0 1 2 3\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = glpath.load_scene(tmp_path / "a.off")
    assert sorted(map(tuple, scene.shapes[0].geometry.vertices.tolist())) == [
        (0, 0, 0),
        (0, 1, 0),
        (1, 0, 0),
        (1, 1, 0),
    ]
    assert any("Colours" in str(each.message) for each in caught) == bool(more)


@pytest.mark.parametrize(
    ("keyword", "values", "uv", "normals"),
    [
        ("NOFF", "0 0 2", None, [0, 0, 1]),
        ("STOFF", "0.25 0.5", [0.25, 0.5], None),
        ("STNOFF", "0 0 2 0.25 0.5", [0.25, 0.5], [0, 0, 1]),
        ("STCOFF", "255 0 0 255 0.25 0.5", [0.25, 0.5], None),
    ],
)
@pytest.mark.filterwarnings("ignore:.*Colours")
def test_normals_and_texture_coordinates_are_those_of_the_vertices(
    keyword: str, values: str, uv: list[float] | None, normals: list[float] | None, tmp_path: Path
) -> None:
    rows = "".join(f"{x} {y} 0 {values}\n" for x, y in ((0, 0), (1, 0), (0, 1)))
    (tmp_path / "a.off").write_text(f"{keyword}\n3 1 0\n{rows}3 0 1 2\n")
    mesh = glpath.load_scene(tmp_path / "a.off").shapes[0].geometry
    assert (None if mesh.uv is None else mesh.uv.tolist()) == (None if uv is None else [uv] * 3)
    assert (None if mesh.normals is None else mesh.normals.tolist()) == (None if normals is None else [normals] * 3)


def test_normals_beside_colours_are_not_read_and_lines_behind_the_last_face_are_counted(tmp_path: Path) -> None:
    rows = "".join(f"{x} {y} 0 0 0 1 9 9 9\n" for x, y in ((0, 0), (1, 0), (0, 1)))
    (tmp_path / "a.off").write_text(f"CNOFF\n3 1 0\n{rows}3 0 1 2\n3 2 1 0\n")
    with pytest.warns(SceneWarning) as caught:
        scene = glpath.load_scene(tmp_path / "a.off")
    told = [str(each.message) for each in caught]
    assert any("its normals are not read" in text for text in told)
    assert any("1 lines behind the last face are not read" in text for text in told)
    assert len(scene.triangles) == 1
