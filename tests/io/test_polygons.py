"""Polygons with holes as triangles: the area is that of the rings, and each point is covered once."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.io.polygons import polygon_normal, triangulated


def turned(points: np.ndarray, seed: int) -> np.ndarray:
    """Points of a plane (N, 2), somewhere in space."""
    frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    frame *= np.linalg.det(frame)
    return np.column_stack([points, np.zeros(len(points))]) @ frame.T + [3, -2, 5]


def areas(vertices: np.ndarray, faces: np.ndarray, normal: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a) @ normal


@pytest.mark.parametrize("seed", range(8))
def test_stars_with_holes_keep_their_area_and_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 17))
    star = rng.uniform(2, 5, 17)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    square = np.array([[-0.4, -0.3], [0.5, -0.3], [0.5, 0.4], [-0.4, 0.4]])
    boundary, hole = turned(star, seed), turned(square[:: rng.choice([1, -1])], seed)
    vertices, faces, missing = triangulated(boundary, [hole])
    normal = polygon_normal(boundary)
    size = np.linalg.norm(normal)
    found = areas(vertices, faces, normal / size)
    assert found.min() > 0
    assert found.sum() == pytest.approx(0.5 * size - 0.63)
    assert missing == pytest.approx(0, abs=1e-9)


def test_holes_may_touch_the_edge_and_each_other() -> None:
    wall = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    door = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 2], [0, 0, 2.0]])
    window = np.array([[1, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2.0]])
    vertices, faces, missing = triangulated(wall, [door, window])
    found = areas(vertices, faces, np.array([0, -1, 0.0]))
    assert found.sum() == pytest.approx(12 - 2 - 2)
    assert missing == pytest.approx(0)
    middles = vertices[faces].mean(axis=1)
    assert not ((middles[:, 0] < 1) & (middles[:, 2] < 2)).any()


def test_a_hole_that_leaves_the_polygon_is_missed() -> None:
    wall = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    window = np.array([[3, 0, 1], [5, 0, 1], [5, 0, 2], [3, 0, 2.0]])
    assert abs(triangulated(wall, [window])[2]) > 0.5


def test_a_line_has_no_triangles() -> None:
    vertices, faces, missing = triangulated(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]))
    assert len(vertices) == len(faces) == missing == 0
