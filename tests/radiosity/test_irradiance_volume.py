"""Irradiance by position and normal: that of the elements around."""

from __future__ import annotations

import numpy as np
import pytest

import glpath
from glpath.radiosity.irradiance_volume import CELLS, IrradianceVolume
from glpath.radiosity.solution import RadiositySolution
from glpath.scene.model import Scene
from tests.support.streams import SKY

FRONT, BACK = 0, 1


def box(**more: object) -> Scene:
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
            **SKY,
            "shapes": [{"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1]}],
            **more,
        }
    )


def solution_of(scene: Scene, front: np.ndarray, back: float) -> RadiositySolution:
    """Of one element a triangle: irradiance of fronts (T,), in three colours, and of backs; all indirect."""
    triangles = len(scene.triangles)
    elements, vertices = np.zeros((2, 2, triangles, 3)), np.zeros((2, 2, 3 * triangles, 3))
    colours = [1.0, 2.0, 3.0]
    elements[1, FRONT], vertices[1, FRONT] = (np.outer(np.repeat(front, n), colours) for n in (1, 3))
    elements[1, BACK], vertices[1, BACK] = back, back
    return RadiositySolution(scene.digest(camera=False), np.ones(triangles, np.int32), elements, vertices)


def test_the_same_everywhere_is_the_same_everywhere():
    scene = box()
    found = IrradianceVolume.of(scene, solution_of(scene, np.full(12, 5.0), 0.25), 0, traced=False)
    assert found is not None
    np.testing.assert_allclose(found.values[:, FRONT], np.broadcast_to([5, 10, 15, 1], found.values[:, 0].shape))
    np.testing.assert_allclose(found.values[:, BACK, :, :3], 0.25)
    assert found.rows.max() == len(found.values) - 1
    assert found.rows.size == found.size.prod() <= CELLS


def test_each_direction_has_the_light_of_the_surfaces_that_face_it():
    scene = box()
    axis = np.abs(scene.normals).argmax(axis=1)
    direction = 2 * axis + (scene.normals[np.arange(12), axis] < 0)
    found = IrradianceVolume.of(scene, solution_of(scene, 1.0 + direction, 0.0), 0, traced=False)
    assert found is not None
    # At the middle of each face of the box, and at a corner, where three meet.
    for which in range(6):
        point = np.zeros(3)
        point[which // 2] = 1 - 2 * (which % 2)
        np.testing.assert_allclose(found.values[row_at(found, 0.999 * point), FRONT, which, 0], 1.0 + which)
    corner = found.values[row_at(found, np.full(3, -0.9999)), FRONT, :, 0]
    np.testing.assert_allclose(corner[[1, 3, 5]], [2, 4, 6])
    # What nothing there faces has the mean of what is there.
    assert corner[0] == corner[2] == corner[4]
    assert corner[0] == pytest.approx(4, abs=0.5)


def test_where_no_surface_is_the_nearest_one_has_a_say():
    scene = box()
    up = (scene.normals[:, 1] > 0.5).astype(float)
    found = IrradianceVolume.of(scene, solution_of(scene, 7.0 * up, 0.0), 0, traced=False)
    assert found is not None
    assert found.values[row_at(found, np.array([0.1, 0.4, 0.1])), FRONT, 2, 0] == pytest.approx(7)


def test_triangles_before_the_first_are_left_out():
    scene = box()
    front = np.where(np.arange(12) < 10, 100.0, 2.0)
    found = IrradianceVolume.of(scene, solution_of(scene, front, 0.0), 10, traced=False)
    assert found is not None
    assert found.values[:, FRONT, :, 0].max() == pytest.approx(2)
    assert IrradianceVolume.of(scene, solution_of(scene, front, 0.0), 12, traced=False) is None


def row_at(volume: IrradianceVolume, point: np.ndarray) -> int:
    x, y, z = np.clip((point - volume.lower) / volume.cell, 0, volume.size - 1).astype(int)
    return int(volume.rows[z, y, x])
