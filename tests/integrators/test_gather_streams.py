"""The gather over streamed triangles: the picture of the same triangles in memory, but for a simpler solution."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.rendering import RenderJob, run
from glpath.sensors.sensor import PointSensor
from tests.support.streams import GRASS, LAMPS, SKY, Given, in_memory, scene_of, streamed_corners
from tests.support.terrain import Hills

OPTIONS: dict[str, Any] = {"integrator": "gather", "cast": "path-buffer", "light_resolution": 128, "spp": 16}


@pytest.mark.parametrize("light", [{}, SKY, LAMPS], ids=["lamp", "sky", "lamps"])
def test_a_stream_has_the_picture_of_a_mesh(light: dict[str, Any]):
    hills = Hills(2, 12)  # of which all triangles are solved
    streamed = glpath.render(scene_of({"type": "stream", "stream": hills}, **light), **OPTIONS)
    whole = glpath.render(scene_of(in_memory(streamed_corners(hills)), **light), **OPTIONS)
    np.testing.assert_allclose(streamed.mean.mean((0, 1)), whole.mean.mean((0, 1)), rtol=5e-3)
    # Pixel by pixel, as both have the same random numbers.
    assert np.abs(streamed.mean - whole.mean).mean() < 0.01 * whole.mean.mean()


def test_a_simpler_solution_lights_it_nearly_so():
    hills = Hills(2, 80)  # 51,200 triangles, a third of them solved
    scene = scene_of({"type": "stream", "stream": hills}, **SKY)
    gathered = glpath.render(scene, **OPTIONS)
    traced = glpath.render(scene, integrator="path-buffer", light_resolution=128, spp=32)
    np.testing.assert_allclose(gathered.mean.mean((0, 1)), traced.mean.mean((0, 1)), rtol=0.03)


def test_bounces_off_streamed_triangles_are_there():
    """A pit whose walls are streamed: most of its light has been reflected."""
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
    floor = corners[[[0, 3, 2], [0, 2, 1]]]
    walls = []
    for k in range(4):
        a, b = corners[k], corners[(k + 1) % 4]
        up = np.array([0, 2.0, 0])
        walls.append(np.array([[a, b + up, b], [a, a + up, b + up]]))
    pit = np.concatenate([floor, *walls])
    base = {
        "camera": {"position": [0, 1.9, 0.9], "target": [0, 0, -0.3], "fov": 60},
        "film": {"resolution": [24, 24]},
        "materials": {"white": {"reflectance": 0.8}},
        "lights": [{"type": "point", "position": [0, 1.5, 0], "intensity": 5}],
    }
    scene, mesh = (
        glpath.load_scene({**base, "shapes": [{"material": "white", **shape}]})
        for shape in ({"type": "stream", "stream": Given(pit)}, in_memory(pit))
    )
    found = glpath.render(scene, **OPTIONS | {"spp": 64})
    right = glpath.render(mesh, integrator="path", guide="cosine", spp=256)
    direct = glpath.render(mesh, integrator="path", max_depth=1, spp=16)
    assert right.mean.mean() > 1.5 * direct.mean.mean()
    assert found.mean.mean() == pytest.approx(right.mean.mean(), rel=0.02)


def test_a_gather_of_streams_needs_no_options():
    scene = scene_of({"type": "stream", "stream": Hills(1, 4)}, **SKY)
    film = glpath.render(scene, integrator="gather", spp=1)
    assert film.metadata.settings["cast"] == "path-buffer"
    assert "geometry_budget" not in film.metadata.settings
    assert glpath.render(scene, spp=1).metadata.integrator == "path-buffer"


def test_points_gather_over_a_stream():
    hills = Hills(2, 12)
    points = np.array([[[-1.0, 1.5, 0.5], [1.2, 1.5, -0.7], [0.4, 1.5, 1.5]]])
    options = OPTIONS | {"spp": 256}
    sensor = PointSensor.of(points, np.broadcast_to([0.0, -1.0, 0.0], points.shape))
    shapes = ({"type": "stream", "stream": hills}, in_memory(streamed_corners(hills)))
    found, right = (
        run(RenderJob.of(scene, sensor=sensor, **options), scene=scene)
        for scene in (scene_of(shape, **SKY) for shape in shapes)
    )
    assert found.mean.min() > 0.01
    np.testing.assert_allclose(found.mean, right.mean, rtol=0.02)


def test_triangles_too_scattered_for_a_simpler_mesh_are_refused():
    random = np.random.default_rng(3)
    leaves = random.uniform(-1, 1, (20_000, 1, 3)) + random.uniform(-1, 1, (20_000, 3, 3)) * 1e-4
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
            **SKY,
            "materials": GRASS,
            "shapes": [{"type": "stream", "stream": Given(leaves), "material": "grass"}],
        }
    )
    with pytest.raises(glpath.SceneError, match="too small and scattered") as error:
        glpath.render(scene, **OPTIONS)
    assert 'integrator="path-buffer"' in error.value.remedy


def test_a_budget_is_of_scans():
    with pytest.raises(glpath.UsageError, match='geometry_budget: 64 with cast "bvh"'):
        glpath.render("cornell-box-36", integrator="gather", geometry_budget=64)
