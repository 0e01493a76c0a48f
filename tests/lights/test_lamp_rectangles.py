"""Rectangular lamps close to surfaces: light samples by solid angle, with the light of closed forms, less noisy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.io import load_scene, scene_from_dict
from glpath.lights import rectangles
from glpath.lights.lighting import Lighting
from glpath.lights.rectangles import LampRectangles
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Float64
from tests.reference.closed_forms import furnace_radiance, polygon_irradiance

RHO = 0.6
RADIANCE = 2.0


def quad(corners: Any, **fields: Any) -> dict[str, Any]:
    return {"type": "quad", "corners": [list(map(float, each)) for each in corners], "material": "w", **fields}


def panel(height: float, extent: float = 1.0) -> list[list[float]]:
    """Corners of a panel that shines down."""
    e = extent
    return [[-e, height, -e], [e, height, -e], [e, height, e], [-e, height, e]]


def under(height: float, *others: dict[str, Any], two_sided: bool = False, **material: Any) -> Scene:
    """A floor and a wall, and a lamp of 2 x 2 above the floor."""
    emission = {"radiance": RADIANCE, "two_sided": two_sided}
    return scene_from_dict({
        "camera": {"position": [0, 0.9 * height, 4], "target": [0, 0, 0], "fov": 40},
        "film": {"resolution": [16, 12]},
        "materials": {"w": {"reflectance": RHO, **material}},
        "shapes": [
            quad(((-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3))),
            quad(((-3, 0, -1.5), (3, 0, -1.5), (3, 3, -1.5), (-3, 3, -1.5))),
            quad(panel(height), emission=emission),
            *others,
        ],
    })  # fmt: skip


def chosen(scene: Scene) -> LampRectangles:
    return LampRectangles.that_pay(Lighting.of(path_traceable(scene)))


def without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rectangles, "_MIN_SOLID_ANGLE", np.inf)


def means(scene: Scene, spp: int, sets: int = 8, **options: Any) -> Float64:
    return np.array([
        glpath.render(scene, integrator="path", spp=spp, seed=1 + i, **options).mean for i in range(sets)
    ])  # fmt: skip


# Which lamps.


def test_a_lamp_is_one_where_it_looks_large() -> None:
    assert len(chosen(under(0.5))) == 1
    assert len(chosen(under(8.0))) == 0
    assert len(chosen(load_scene("cornell-box"))) == 0


def test_the_edges_are_those_of_the_front() -> None:
    (corner, across, up), *_ = chosen(under(0.5)).edges
    assert np.cross(across, up)[1] == pytest.approx(-4.0)
    corners = [corner, corner + across, corner + across + up, corner + up]
    assert sorted(map(tuple, np.round(corners, 9))) == sorted(map(tuple, panel(0.5)))


def test_other_forms_and_textures_are_none() -> None:
    scene = under(0.5)
    e = 0.5
    for corners in (
        [[-1, e, -1], [1, e, -1], [1.5, e, 1], [-0.5, e, 1]],
        [[-1, e, -1], [1, e, -1], [1, e, 1], [-1, e, 0.5]],
    ):
        table = {"type": "quad", "corners": corners, "emission": {"radiance": 2.0}}
        other = scene.add(table, material="w")
        assert len(chosen(replace(other, shapes=[*other.shapes[:2], other.shapes[-1]]))) == 0


# Closed forms.


@pytest.mark.parametrize("height", [0.05, 0.3, 1.0])
def test_a_floor_under_a_lamp_has_the_irradiance_of_the_closed_form(height: float) -> None:
    points = np.array([[x, 0.0, z] for x in (-1.6, -0.9, 0.0, 0.97) for z in (-1.0, 0.2)])
    found = glpath.irradiance(under(height), points, (0, 1, 0), spp=256, max_depth=1).values[:, 0]
    np.testing.assert_allclose(found, polygon_irradiance(points, [0, 1, 0], panel(height), RADIANCE), rtol=0.02)


def test_cameras_see_the_same() -> None:
    scene = under(0.5).with_camera(position=(0.4, 0.4, 0.4), target=(0, 0, 0))
    film = glpath.render(scene, integrator="path", spp=256, max_depth=1)
    rays = scene.camera.rays()
    floor = scene.camera.position - scene.camera.position[1] / rays[..., 1:2] * rays
    seen = (rays[..., 1] < 0) & (floor[..., 2] > -1.4)
    expected = RHO / np.pi * polygon_irradiance(floor[seen], [0, 1, 0], panel(0.5), RADIANCE)
    np.testing.assert_allclose(film.mean[..., 0][seen], expected, rtol=0.02)


def test_both_sides_of_a_lamp_shine() -> None:
    scene = under(0.5, quad(((-3, 1, -3), (3, 1, -3), (3, 1, 3), (-3, 1, 3))), two_sided=True)
    points = np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.9]])
    below = glpath.irradiance(scene, points, (0, 1, 0), spp=256, max_depth=1).values[:, 0]
    above = glpath.irradiance(scene, points + np.array([0, 1, 0]), (0, -1, 0), spp=256, max_depth=1).values[:, 0]
    expected = polygon_irradiance(points, [0, 1, 0], panel(0.5), RADIANCE)
    np.testing.assert_allclose(below, expected, rtol=0.02)
    np.testing.assert_allclose(above, expected, rtol=0.02)


@pytest.mark.parametrize("depth", [1, 4])
def test_a_furnace_of_six_lamps_is_a_furnace(depth: int) -> None:
    """Points in corners see some lamps from their plane, where no side of them is known."""
    c = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    inwards = [f if np.cross(c[f[1]] - c[f[0]], c[f[3]] - c[f[0]]) @ c[f[0]] < 0 else f[::-1] for f in faces]
    scene = scene_from_dict({
        "camera": {"position": [0.5, 0.2, 0.8], "target": [-1, -0.7, -1], "fov": 60},
        "film": {"resolution": [12, 12]},
        "materials": {"w": {"reflectance": 0.5}},
        "shapes": [*(quad(c[list(f)], emission={"radiance": 0.5}) for f in inwards)],
    })  # fmt: skip
    # Of a surface that does not shine, which is what lamps are looked at from; behind the camera.
    tile = {"type": "quad", "corners": [[0.7, 0.7, 0.96], [0.7, 0.8, 0.96], [0.8, 0.8, 0.96], [0.8, 0.7, 0.96]]}
    scene = scene.add(tile, material={"reflectance": 0.5})
    assert len(chosen(scene)) == 6
    film = glpath.render(scene, integrator="path", spp=256, max_depth=depth)
    expected = furnace_radiance(0.5, 0.5, depth)
    assert film.mean.mean() == pytest.approx(expected, rel=3e-3)
    np.testing.assert_allclose(film.mean, expected, rtol=0.1)


# The same light, with less noise.


@pytest.mark.parametrize(
    ("depth", "material"),
    [
        (1, {}),
        (4, {}),
        (3, {"type": "principled", "roughness": 0.3, "reflectance": 0.6, "metallic": 1.0}),
    ],
)
def test_samples_by_area_bring_the_same_light(
    depth: int, material: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    by_angle = means(under(0.4, **material), 64, max_depth=depth)
    without(monkeypatch)
    assert not chosen(under(0.4))
    by_area = means(under(0.4, **material), 64, max_depth=depth)
    sets = [each.mean(axis=(1, 2, 3)) for each in (by_angle, by_area)]
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in sets))
    assert sets[0].mean() == pytest.approx(sets[1].mean(), abs=3 * error)
    less = 10.0 if depth == 1 else 1.1
    assert by_angle.var(axis=0).mean() < by_area.var(axis=0).mean() / less
