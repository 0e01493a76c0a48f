"""Shapes as triangles: closed, outward, as large as the shape, and still so after any transform."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glpath.io import scene_from_dict
from glpath.scene.tessellate import Int32, box, quad, sphere, subdivide

Float64 = np.ndarray


def volume(corners: Float64) -> float:
    """Enclosed volume of a closed surface, above 0 when its fronts are outward; corners: (T, 3, 3)."""
    return float(np.sum(np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]) / 6)


def area(corners: Float64) -> float:
    return float(
        0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    )


def is_closed(faces: Int32) -> bool:
    """Each edge is passed exactly once in each direction."""
    passes = Counter((int(a), int(b)) for a, b in faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
    return all(count == 1 and passes[b, a] == 1 for (a, b), count in passes.items())


def corners_of(shape: dict) -> Float64:
    """Triangles (T, 3, 3) of a shape in a scene."""
    camera = {"position": [0, 0, 50], "target": [0, 0, 0]}
    return scene_from_dict({"camera": camera, "shapes": [shape]}).triangles


def test_a_box_is_closed_and_encloses_its_volume():
    vertices, faces = box((-1, 2, 3), (1, 5, 7))
    assert is_closed(faces)
    assert len(faces) == 12
    assert volume(vertices[faces]) == pytest.approx(2 * 3 * 4)
    assert area(vertices[faces]) == pytest.approx(2 * (6 + 8 + 12))


def test_a_quad_faces_whoever_sees_its_corners_counter_clockwise():
    vertices, faces = quad([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]])
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert area(corners) == pytest.approx(6)


@pytest.mark.parametrize("subdivisions", range(5))
def test_a_sphere_is_closed_outward_and_on_the_sphere(subdivisions: int):
    vertices, faces = sphere((1, 2, 3), 2, subdivisions)
    assert len(faces) == 20 * 4**subdivisions
    assert is_closed(faces)
    corners = vertices[faces] - (1, 2, 3)
    assert np.allclose(np.linalg.norm(corners, axis=2), 2)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(normals * corners.mean(axis=1), axis=1) > 0).all()


def test_the_area_and_volume_of_a_sphere_converge_by_four_with_each_subdivision():
    missing = []
    for subdivisions in range(1, 6):
        vertices, faces = sphere((0, 0, 0), 1, subdivisions)
        corners = vertices[faces]
        missing.append((1 - area(corners) / (4 * np.pi), 1 - volume(corners) / (4 / 3 * np.pi)))
    ratios = np.array(missing[:-1]) / np.array(missing[1:])
    assert np.all((ratios > 3.5) & (ratios < 4.2))
    area_4, volume_4 = missing[3]  # what the docstring of `sphere` promises
    assert area_4 == pytest.approx(0.0012, rel=0.05)
    assert volume_4 == pytest.approx(0.0022, rel=0.05)


def test_splitting_changes_neither_area_nor_closedness():
    vertices, faces = subdivide(*box((0, 0, 0), (1, 1, 1)))
    assert is_closed(faces)
    assert len(faces) == 48
    assert len(vertices) == 8 + 18  # one new vertex on each of the 12 edges and 6 diagonals
    assert volume(vertices[faces]) == pytest.approx(1)


number = st.floats(-3, 3)
factor = st.floats(0.1, 3).flatmap(lambda size: st.sampled_from([size, -size]))
vector = st.tuples(number, number, number)
axis = vector.filter(lambda v: np.linalg.norm(v) > 0.1)
step = st.one_of(
    st.builds(lambda v: {"translate": v}, vector),
    st.builds(lambda v, angle: {"rotate": {"axis": v, "angle": angle}}, axis, st.floats(-360, 360)),
    st.builds(lambda v: {"scale": v}, factor),
    st.builds(lambda v: {"scale": v}, st.tuples(factor, factor, factor)),
)


def linear_part(step: dict) -> Float64:
    """(3, 3): what a step does to a direction, by formulas of its own (Rodrigues for the rotation)."""
    if "rotate" in step:
        x, y, z = np.array(step["rotate"]["axis"]) / np.linalg.norm(step["rotate"]["axis"])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = np.radians(step["rotate"]["angle"])
        return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.diag(np.broadcast_to(step.get("scale", 1.0), 3)).astype(float)


@settings(deadline=None)
@given(st.lists(step, max_size=4))
def test_any_transform_moves_the_points_and_keeps_the_fronts_outward(steps: list[dict]):
    corners = corners_of({"type": "box", "min": [0, 0, 0], "max": [1, 2, 3], "transform": steps})
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], float)
    linear = np.eye(3)
    for each in steps:
        points = points @ linear_part(each).T + each.get("translate", 0.0)
        linear = linear_part(each) @ linear
    moved = np.unique(corners.reshape(-1, 3).round(6), axis=0)
    assert np.allclose(np.sort(moved, axis=0), np.sort(points, axis=0), atol=1e-5)
    # the volume keeps its sign even where the transform mirrors
    assert volume(corners - corners[0, 0]) == pytest.approx(
        6 * abs(np.cross(linear[0], linear[1]) @ linear[2]), rel=1e-6
    )


def test_steps_apply_in_the_order_in_which_they_are_listed():
    turn = {"rotate": {"axis": [0, 0, 1], "angle": 90}}
    shift = {"translate": [10, 0, 0]}
    cube = {"type": "box", "center": [0, 0, 0], "size": [2, 2, 2]}
    assert np.allclose(corners_of({**cube, "transform": [shift, turn]}).mean(axis=(0, 1)), [0, 10, 0])
    assert np.allclose(corners_of({**cube, "transform": [turn, shift]}).mean(axis=(0, 1)), [10, 0, 0])


def test_a_matrix_is_for_column_vectors():
    matrix = [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
    corners = corners_of({"type": "box", "min": [0, 0, 0], "max": [1, 2, 3], "transform": [{"matrix": matrix}]})
    assert corners.reshape(-1, 3).min(axis=0).tolist() == [3, 6, 7]
    assert corners.reshape(-1, 3).max(axis=0).tolist() == [5, 7, 10]


def test_flipped_normals_turn_a_box_into_a_room():
    corners = corners_of({"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "flip_normals": True})
    assert volume(corners) == pytest.approx(-1)
