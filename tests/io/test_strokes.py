"""Clouds of points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glpath import SceneError, SceneWarning, load_scene
from glpath.io.strokes import ball_triangles, balls, point_radius, rod_triangles, rods
from glpath.scene.model import Mesh

CLOUD = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
0 0 0 255 0 0
1 0 0 0 255 0
0 1 0 0 0 255
"""


#: As MeshLab writes it.
_WITH_NO_FACE = CLOUD.replace("end_header", "element face 0\nproperty list uchar int vertex_indices\nend_header")


@pytest.mark.filterwarnings("ignore:.*no camera")
@pytest.mark.parametrize("cloud", [CLOUD, _WITH_NO_FACE], ids=["without faces", "element face 0"])
def test_a_ply_of_points_is_balls_of_their_colours(cloud: str, tmp_path: Path):
    path = tmp_path / "cloud.ply"
    path.write_text(cloud)
    with pytest.warns(SceneWarning, match=r"has no triangles, so its 3 points are drawn as balls of radius 0.0283"):
        scene = load_scene(path)
    (shape,) = scene.shapes
    assert isinstance(shape.geometry, Mesh)
    assert len(shape.geometry.faces) == 3 * 80
    assert shape.geometry.colours is not None
    colours = {tuple(np.round(c[:3], 3)) for c in shape.geometry.colours.tolist()}
    assert colours == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}


@pytest.mark.filterwarnings("ignore:.*(no camera|not finite)")
@pytest.mark.parametrize("format_name", ["ascii", "binary_little_endian"])
def test_a_ply_of_edges_is_rods(format_name: str, tmp_path: Path):
    path = tmp_path / "frame.ply"
    coordinates = "".join(f"property float {axis}\n" for axis in "xyz")
    header = (
        f"ply\nformat {format_name} 1.0\nelement vertex 4\n{coordinates}"
        "element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    )
    points = np.array([[np.nan, 0, 0], [0, 0, 0], [3, 0, 0], [3, 4, 0]], "<f4")
    edges = np.array([[1, 2], [3, 2]], "<i4")
    if format_name == "ascii":
        body = "".join(f"{' '.join(map(str, row))}\n" for row in (*points.tolist(), *edges.tolist())).encode()
    else:
        body = points.tobytes() + edges.tobytes()
    path.write_bytes(header.encode() + body)
    with pytest.warns(SceneWarning, match=r"has no triangles, so its 2 lines are drawn as rods of radius 0\.02\."):
        scene = load_scene(path)
    assert scene.bounds == (pytest.approx([-0.02] * 3, abs=2e-3), pytest.approx([3.02, 4.02, 0.02], abs=2e-3))
    path.write_bytes(header.encode() + body.replace(b"1 2\n3 2", b"1 9\n3 2"))
    if format_name == "ascii":
        with pytest.raises(SceneError, match=r"edge 0 names vertex 9, but the mesh has 4 vertices"):
            load_scene(path)


def test_as_the_bare_geometry_of_a_shape_it_has_no_triangles(tmp_path: Path):
    (tmp_path / "cloud.ply").write_text(CLOUD)
    scene = {"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "sky": {"zenith": 1.0}}
    with pytest.raises(SceneError, match="no triangles") as error:
        load_scene(scene | {"shapes": [{"type": "mesh", "file": str(tmp_path / "cloud.ply")}]})
    assert "In a file that is a model of its own" in error.value.remedy


def test_points_in_one_place_count_as_one():
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    three = np.concatenate([corners, corners, corners + 1e-6])
    assert point_radius(three) == pytest.approx(point_radius(corners), rel=1e-3)


def test_balls_touch_where_points_lie_in_a_grid():
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    assert point_radius(grid) == pytest.approx(0.5)
    vertices, faces, normals, of = balls(grid, 0.5)
    assert np.linalg.norm(vertices - grid[of], axis=1) == pytest.approx(0.5)
    assert np.allclose(0.5 * normals, vertices - grid[of])
    assert faces.max() == len(vertices) - 1


def test_many_points_and_lines_have_few_triangles_with_their_fronts_outside():
    points = np.column_stack([2.0 * np.arange(30_000), np.zeros((30_000, 2))])
    lines = np.column_stack([np.arange(29_999), np.arange(1, 30_000)])
    for vertices, faces, normals, _ in (balls(points, 0.5), rods(points, lines, 0.5)):
        corners = vertices[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.all(np.einsum("fi,fi->f", across, normals[faces].sum(axis=1)) > 0)
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert len(balls(points, 0.5)[1]) == ball_triangles(30_000) == 8 * 30_000
    assert rod_triangles(points, lines) == 8 * 29_999 + 8 * 30_000
    assert len(rods(points, lines, 0.5)[1]) == 8 * 29_999 + 8 * 30_000


@pytest.mark.filterwarnings("ignore:.*no camera")
def test_an_obj_of_lines_alone_is_rods(tmp_path: Path):
    path = tmp_path / "frame.obj"
    path.write_text("v 0 0 0\nv 3 0 0\nv 3 4 0\nv 9 9 9\nl 1 2 -2\n")
    with pytest.warns(SceneWarning, match=r"has no triangles, so its 2 lines are drawn as rods of radius 0\.02\."):
        scene = load_scene(path)
    assert scene.bounds == (pytest.approx([-0.02] * 3, abs=2e-3), pytest.approx([3.02, 4.02, 0.02], abs=2e-3))
    (shape,) = scene.shapes
    assert isinstance(shape.geometry, Mesh)
    assert len(shape.geometry.faces) == 2 * 16 + 3 * 80
    path.write_text("v 0 0 0\nl 1 7\n")
    with pytest.raises(SceneError, match=r"line 2 names vertex 7, but the file has 1 vertices"):
        load_scene(path)


@pytest.mark.filterwarnings("ignore:.*no camera")
@pytest.mark.parametrize("name", ["frame.obj", "frame.ply"])
def test_lines_that_a_file_repeats_are_drawn_once(name: str, tmp_path: Path):
    """With the bits of a file that does not repeat them, whatever their order and direction."""
    header = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element edge {}\nproperty int vertex1\nproperty int vertex2\nend_header\n0 0 0\n3 0 0\n3 4 0\n"
    )
    meshes = []
    for edges in ([(2, 1), (0, 1)], [(2, 1), (0, 1), (1, 2), (1, 0)] + 100 * [(0, 1)]):
        if name.endswith("obj"):
            text = "v 0 0 0\nv 3 0 0\nv 3 4 0\n" + "".join(f"l {a + 1} {b + 1}\n" for a, b in edges)
        else:
            text = header.format(len(edges)) + "".join(f"{a} {b}\n" for a, b in edges)
        (tmp_path / name).write_text(text)
        with pytest.warns(SceneWarning, match="so its 2 lines are drawn as rods"):
            (shape,) = load_scene(tmp_path / name).shapes
        assert isinstance(shape.geometry, Mesh)
        meshes.append(shape.geometry)
    assert np.array_equal(meshes[0].vertices, meshes[1].vertices)
    assert np.array_equal(meshes[0].faces, meshes[1].faces)


@pytest.mark.filterwarnings("ignore:.*no camera")
def test_an_obj_of_vertices_alone_is_balls_of_their_colours(tmp_path: Path):
    path = tmp_path / "cloud.obj"
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\n")
    with pytest.warns(SceneWarning, match=r"so its 3 points are drawn as balls"):
        scene = load_scene(path)
    (shape,) = scene.shapes
    assert isinstance(shape.geometry, Mesh)
    assert shape.geometry.colours is not None
    colours = {tuple(np.round(c[:3], 3)) for c in shape.geometry.colours.tolist()}
    assert colours == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
