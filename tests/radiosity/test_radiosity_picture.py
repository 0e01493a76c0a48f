"""A solution as the eye sees it."""

from __future__ import annotations

import numpy as np
import pytest

import glpath
from glpath.radiosity.mesh import lattice
from glpath.radiosity.picture import picture_of
from glpath.radiosity.solution import RadiositySolution


def solution_of(scene: glpath.Scene, value: float) -> RadiositySolution:
    """What every front reflects, twice as much on every back; a third of it direct."""
    divisions = np.full(len(scene.triangles), 2, np.int32)
    sides = np.array([value, 2 * value])[:, None, None]
    white = np.array([scene.materials[s.material].reflectance for s in scene.shapes])[scene.triangle_shape]
    parts = np.array([1 / 3, 2 / 3])[:, None, None, None]
    values = [
        parts * np.repeat(sides / white, count, axis=1)
        for count in (lattice.element_count(divisions), lattice.vertex_count(divisions))
    ]
    return RadiositySolution(scene.digest(camera=False), divisions, *values, "test", {}, {})


@pytest.mark.parametrize("lookup", ["constant", "interpolated", "smooth"])
def test_fronts_show_radiosity_over_pi_and_lamps_their_emission(lookup: str) -> None:
    scene = glpath.load_scene("cornell-box-36").with_camera(resolution=(32, 32))
    image = picture_of(solution_of(scene, np.pi), scene, lookup)  # type: ignore[arg-type]
    assert image.shape == (32, 32, 3)
    values = np.unique(image[..., 0].round(4))
    lamp = max(s.emission[0] for s in scene.shapes) + 1
    assert set(values) <= {0.0, 1.0, 2.0, round(float(lamp), 4)}
    assert np.mean(np.isclose(image, 1.0)) > 0.8


def test_a_solution_of_another_scene_is_refused() -> None:
    scene = glpath.load_scene("cornell-box-36")
    with pytest.raises(glpath.SceneError):
        picture_of(solution_of(scene, 1.0), glpath.load_scene("cornell-box"))
