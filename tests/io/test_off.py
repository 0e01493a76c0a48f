"""OFF files [trimesh]: as other formats have it; a warning for colours, an error for what is broken."""

from __future__ import annotations

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
        (PYRAMID.replace("3 3 0 4", "3 3 0 9"), "vert"),  # 9 of 5, in the words of trimesh or of glpath
        (PYRAMID.replace("0.75", "high"), '"high" is not a number'),
        (PYRAMID.replace("3 3 0 4", "3 3 0"), "face 4 announces 3 corners and has 2"),
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
