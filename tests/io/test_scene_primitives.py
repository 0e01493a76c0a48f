"""Exact spheres and planes, and texture coordinates: where a file's shapes end up in the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glpath.io import scene_from_dict
from glpath.scene import Scene

CAMERA = {"position": [0, 0, 9], "target": [0, 0, 0]}
QUAD = {"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}
SQUARES = {"materials": {"squares": {"texture": "t"}}, "textures": {"t": {"type": "checker"}}}
BALL = {"type": "sphere", "radius": 1.0}
TURN = {"rotate": {"axis": [1, 2, -1], "angle": 50}}


def scene(*shapes: dict, **tables: object) -> Scene:
    return scene_from_dict({"camera": CAMERA, "shapes": list(shapes), **tables})


# --- spheres ---


def test_a_sphere_is_a_map_of_the_unit_sphere():
    (matrix,) = scene({"type": "sphere", "center": [1, 2, 3], "radius": 4}).spheres
    assert matrix.tolist() == [[4, 0, 0, 1], [0, 4, 0, 2], [0, 0, 4, 3]]


def test_transforms_move_a_sphere_as_they_move_points():
    steps = [{"scale": [1, 2, 3]}, TURN, {"translate": [5, 6, 7]}]
    (matrix,) = scene({"type": "sphere", "center": [1, 2, 3], "radius": 2, "transform": steps}).spheres
    for point in np.eye(3):
        # A triangle mesh of the same place goes through the triangles' path.
        corners = [(np.array([1, 2, 3]) + 2 * point).tolist(), [0, 0, 1], [0, 1, 0]]
        mesh = scene({"type": "mesh", "vertices": corners, "faces": [[0, 1, 2]], "transform": steps})
        assert np.allclose(matrix[:, :3] @ point + matrix[:, 3], mesh.triangles[0, 0])


@pytest.mark.parametrize("mirrors", [0, 1, 2, 3])
@pytest.mark.parametrize("flip", [False, True])
def test_only_flipped_normals_turn_the_front_of_a_sphere_inside(mirrors: int, flip: bool):
    factors = [-1.0] * mirrors + [2.0] * (3 - mirrors)
    (matrix,) = scene({**BALL, "flip_normals": flip, "transform": [{"scale": factors}, TURN]}).spheres
    assert (np.linalg.det(matrix[:, :3]) < 0) == flip
    # Turning the front changes no point of the surface.
    quadric = np.linalg.inv(matrix[:, :3] @ matrix[:, :3].T)
    (other,) = scene({**BALL, "flip_normals": not flip, "transform": [{"scale": factors}, TURN]}).spheres
    assert np.allclose(quadric, np.linalg.inv(other[:, :3] @ other[:, :3].T))


# --- planes ---


def plane(**fields: Any) -> np.ndarray:
    (matrix,) = scene({"type": "plane", "normal": [0, 1, 0], **fields}, BALL).planes
    return matrix


@pytest.mark.parametrize("normal", [[0, 3, 0], [0, 0, 1], [5, 0, 0], [-1, 0.1, 0], [1, 2, 3], [0, -1, 1e-3]])
def test_a_plane_has_a_right_handed_frame_of_unit_length(normal: list[float]):
    matrix = plane(normal=normal, point=[1, 2, 3])
    assert np.allclose(matrix[:, :3].T @ matrix[:, :3], np.eye(3))
    assert np.linalg.det(matrix[:, :3]) == pytest.approx(1)
    assert np.allclose(matrix[:, 2], normal / np.linalg.norm(normal))
    assert matrix[:, 3].tolist() == [1, 2, 3]


def test_u_of_a_plane_is_a_direction_and_a_length():
    matrix = plane(u=[3, 7, 4])  # the part along the normal does not count
    assert np.allclose(matrix, [[3, 4, 0, 0], [0, 0, 1, 0], [4, -3, 0, 0]])


def test_a_plane_is_transformed_as_its_points_are():
    steps = [{"scale": [2, 0.5, -3]}, TURN, {"translate": [1, 2, 3]}]
    quad = {"type": "quad", "corners": [[0, 1, 0], [0, 2, 1], [1, 2, 1], [1, 1, 0]], "transform": steps}
    triangles = scene(quad)
    moved = plane(point=[0, 1, 0], normal=[0, 1, -1], transform=steps)
    assert np.allclose((triangles.triangles - moved[:, 3]) @ moved[:, 2], 0)
    assert np.allclose(moved[:, 2], triangles.normals)


def test_the_texture_of_a_plane_scales_with_it_and_keeps_its_right_angles():
    stretched = plane(transform=[{"scale": [2, 5, 3]}])
    assert np.allclose(np.linalg.norm(stretched[:, :2], axis=0), [2, 3])
    skewed = plane(
        normal=[1, 1, 0], transform=[{"matrix": [[1, 0, 0.4, 0], [0, 1, 0, 0], [0, 0.3, 1, 0], [0, 0, 0, 1]]}]
    )
    gram = skewed[:, :3].T @ skewed[:, :3]
    assert np.allclose(gram, np.diag(np.diag(gram)))
    assert gram[2, 2] == pytest.approx(1)


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("steps", [[{"scale": 2}], [{"scale": [1, 3, 1]}], [{"scale": [2, 0.5, 3]}, TURN]])
def test_a_motion_moves_a_plane_as_a_transform_does(steps: list[dict[str, Any]], flip: bool):
    fields = {"normal": [0, 1, 1], "point": [1, 2, 3], "u": [1, 0.2, -0.2], "flip_normals": flip}
    expected = plane(**fields, transform=steps)
    assert np.allclose(plane(**fields, motion=[{"time": 0, "transform": steps}]), expected)
    still = scene(BALL)
    added = still.add({"type": "plane", **fields, "motion": [{"time": 0, "transform": steps}]})
    assert np.allclose(added.planes[0], expected)
    keys = [{"time": time, "transform": [{"scale": [1, size, 1]}]} for time, size in ((0, 1), (1, 5))]
    moving = scene({"type": "plane", **fields, "motion": keys}, BALL)
    assert np.allclose(moving.at(0.5).planes[0], plane(**fields, transform=[{"scale": [1, 3, 1]}]))


def test_flipped_normals_turn_a_plane_over():
    up, down = plane(point=[0, 2, 0]), plane(point=[0, 2, 0], flip_normals=True)
    assert np.allclose(down[:, 2], -up[:, 2])
    assert np.linalg.det(down[:, :3]) == pytest.approx(1)


# --- ranges and bounds ---


def test_every_kind_of_primitive_has_its_own_ranges():
    ground = {"type": "plane", "normal": [0, 1, 0]}
    mixed = scene(BALL, QUAD, ground, {"type": "box", "min": [0, 0, 0], "max": [1, 1, 1]}, BALL, ground)
    assert [
        (s.kind, s.primitive, part.start, s.count)
        for s, part in zip(mixed.shapes, mixed.shapes.ranges, strict=True)
    ] == [
        ("sphere", "sphere", 0, 1),
        ("quad", "triangle", 0, 2),
        ("plane", "plane", 0, 1),
        ("box", "triangle", 2, 12),
        ("sphere", "sphere", 1, 1),
        ("plane", "plane", 1, 1),
    ]
    assert mixed.triangle_shape.tolist() == [1] * 2 + [3] * 12
    assert mixed.shapes.primitive_shape("sphere").tolist() == [0, 4]
    assert mixed.shapes.primitive_shape("plane").tolist() == [2, 5]
    assert mixed.triangle_uv.shape == (14, 3, 2)


def test_the_bounds_hold_spheres_exactly_and_planes_not_at_all():
    tilted = {**BALL, "transform": [{"scale": [1, 2, 3]}, TURN, {"translate": [0, 0, 5]}]}
    both = scene(tilted, {"type": "plane", "normal": [0, 1, 0], "point": [0, -99, 0]})
    lower, upper = both.bounds
    directions = np.random.default_rng(0).normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions @ both.spheres[0, :, :3].T + both.spheres[0, :, 3]
    assert np.all(points >= lower)
    assert np.all(points <= upper)
    assert np.allclose(points.min(axis=0), lower, atol=1e-3)
    assert np.allclose(points.max(axis=0), upper, atol=1e-3)
    with_quad = scene(tilted, {**QUAD, "transform": [{"translate": [50, 0, 0]}]})
    assert with_quad.bounds[1][0] == 51
    alone = scene({"type": "plane", "normal": [0, 1, 0], "point": [1, 2, 3]})
    assert [corner.tolist() for corner in alone.bounds] == [[1, 2, 3], [1, 2, 3]]


# --- texture coordinates ---


def uv_at(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Texture coordinates (..., 2) of corners of the scene that lie at `points` (..., 3)."""
    corners, uv = scene.triangles.reshape(-1, 3), scene.triangle_uv.reshape(-1, 2)
    return np.array([uv[np.argmin(np.linalg.norm(corners - point, axis=1))] for point in points])


def test_the_corners_of_a_quad_are_those_of_the_texture():
    assert np.array_equal(scene(QUAD).triangle_uv, scene(QUAD).triangles[:, :, :2])


def test_corners_keep_their_texture_coordinates_where_a_transform_turns_the_winding():
    moved = scene({**QUAD, "transform": [{"scale": [-2, 3, 1]}, {"translate": [1, 2, 3]}]})
    assert np.allclose(moved.triangles[:, :, :2], moved.triangle_uv * [-2, 3] + [1, 2])
    assert np.allclose(moved.normals, [0, 0, 1])


def test_every_face_of_a_box_shows_the_whole_texture_upright():
    box = scene({"type": "box", "min": [-1, -2, -3], "max": [1, 2, 3]})
    corners = box.triangles.reshape(6, 6, 3)
    uv = box.triangle_uv.reshape(6, 6, 2)
    normals = box.normals[::2]
    for face in range(6):
        assert {tuple(each) for each in uv[face]} == {(0, 0), (0, 1), (1, 0), (1, 1)}
        # Least squares: position = origin + u * right + v * up.
        design = np.column_stack([uv[face], np.ones(6)])
        (right, up, _), *_ = np.linalg.lstsq(design, corners[face], rcond=None)
        assert np.allclose(np.cross(right, up) / np.linalg.norm(np.cross(right, up)), normals[face])
        if abs(normals[face][1]) < 0.5:
            assert np.allclose(up, [0, 4, 0])


def test_a_mesh_without_coordinates_is_seen_along_its_normals():
    vertices = [[0, 0, 0], [4, 0, 0], [4, 2, 0], [0, 2, 0], [0, 0, 1], [0, 2, 1]]
    faces = [[0, 1, 2, 3], [0, 3, 5, 4]]
    mesh = scene({"type": "mesh", "vertices": vertices, "faces": faces, "material": "squares"}, **SQUARES)
    assert mesh.triangle_uv[:2].reshape(-1, 2).max(axis=0).tolist() == [1, 0.5]
    assert mesh.triangle_uv[2:].reshape(-1, 2).max(axis=0).tolist() == [0.25, 0.5]
    assert uv_at(mesh, np.array([[4, 2, 0]])).tolist() == [[1, 0.5]]


def test_a_mesh_may_bring_its_coordinates():
    mesh = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "uv": [[0.5, 0], [3, 0], [0, -2]]}
    assert scene({**mesh, "faces": [[0, 1, 2]]}).triangle_uv.tolist() == [mesh["uv"]]
    assert scene({**mesh, "faces": [[0, 1, 2]], "flip_normals": True}).triangle_uv.tolist() == [mesh["uv"][::-1]]


FILES = {
    "a.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0\nvt 3 0\nvt 0 -2\nf 1/1 2/2 3/3\n",
    "a.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 0.5 0\n1 0 0 3 0\n0 1 0 0 -2\n3 0 1 2\n",
}


@pytest.mark.parametrize("name", FILES)
def test_a_mesh_file_brings_its_coordinates(tmp_path: Path, name: str):
    (tmp_path / name).write_text(FILES[name])
    data = {"camera": CAMERA, "shapes": [{"type": "mesh", "file": name}]}
    mesh = scene_from_dict(data, folder=tmp_path)
    assert uv_at(mesh, np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])).tolist() == [[0.5, 0], [3, 0], [0, -2]]


def test_dropped_triangles_take_their_coordinates_with_them():
    mesh = {
        "type": "mesh",
        "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]],
        "faces": [[0, 1, 3], [0, 1, 2]],
        "uv": [[0, 0], [1, 0], [0, 1], [9, 9]],
    }
    with pytest.warns(UserWarning, match="dropped 1 of 2"):
        assert scene(mesh).triangle_uv.tolist() == [[[0, 0], [1, 0], [0, 1]]]
