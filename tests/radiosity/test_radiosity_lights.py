"""Radiosity lit by point, spot and directional lights and the sky: closed forms, and path tracing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath import SceneError, solve_radiosity
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.solution import DIRECT, INDIRECT
from glpath.scene import path_traceable
from glpath.scene.model import Light, Scene, Sky
from tests.reference.closed_forms import polygon_irradiance
from tests.support.rooms import cuboid, part, rectangle, room

METHODS = ["progressive", "matrix", "monte-carlo"]
FLOOR = part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), (0.5, 0.2, 0.8))


def lit(*parts: dict[str, Any], lights: tuple[Light, ...] = (), sky: Sky | None = None) -> Scene:
    return replace(room(*parts), lights=lights, sky=sky)


def point(position: Any, intensity: Any = (3.0, 2.0, 1.0)) -> Light:
    return Light("bulb", "point", np.asarray(intensity, float), np.asarray(position, float))


def white_sky(radiance: float = 1.0) -> Sky:
    return Sky(np.full(3, radiance), np.full(3, radiance), np.array([0.0, 0, 1]))


def middles(scene: Scene, solution: glpath.RadiositySolution) -> Any:
    elements = Elements.of_lattices(solution.divisions.astype(np.int64))
    return elements.points(scene, np.full((1, 3), 1 / 3))[:, 0]


@pytest.mark.parametrize("method", METHODS)
def test_a_point_light_over_a_plane(method: Any) -> None:
    scene = lit(FLOOR, lights=(point((0.2, -0.1, 0.8)),))
    solution = solve_radiosity(scene, method=method, size=0.3, receiver_points=1, particles=20_000)
    to_light = np.array([0.2, -0.1, 0.8]) - middles(scene, solution)
    r = np.linalg.norm(to_light, axis=1)
    expected = (to_light[:, 2] / r**3)[:, None] * [3.0, 2.0, 1.0]
    # A particle solution takes the mean of four points of an element.
    tolerance = 0.03 if method == "monte-carlo" else 1e-6
    np.testing.assert_allclose(solution.elements[DIRECT, 0], expected, rtol=tolerance)
    np.testing.assert_array_equal(solution.elements[DIRECT, 1], 0)  # from below
    np.testing.assert_array_equal(solution.elements[INDIRECT], 0)  # a plane does not light itself


def test_a_plate_throws_the_shadow_of_each_kind_of_light() -> None:
    plate = part(rectangle((-0.25, -0.25, 0.5), (0.5, 0, 0), (0, 0.5, 0)), 0.0)
    down = np.array([0.0, 0, -1])
    slanting = np.array([0.6, 0, -0.8])
    kinds = {
        "point": (point((0, 0, 1.0)), lambda p: np.abs(p[:, :2]).max(axis=1) < 0.5),
        "directional": (
            Light("sun", "directional", np.ones(3), direction=slanting),
            lambda p: np.abs(p[:, :2] - [0.375, 0]).max(axis=1) < 0.25,
        ),
        "spot": (
            Light("spot", "spot", np.ones(3), np.array([0, 0, 1.0]), down, (40.0, 40.0)),
            lambda p: (np.abs(p[:, :2]).max(axis=1) < 0.5) | (np.hypot(p[:, 0], p[:, 1]) > np.tan(np.radians(40))),
        ),
    }
    for name, (light, dark) in kinds.items():
        scene = lit(FLOOR, plate, lights=(light,))
        solution = solve_radiosity(scene, size=0.1, receiver_points=1)
        count = int((solution.divisions[:2].astype(int) ** 2).sum())
        p = middles(scene, solution)[:count]
        found = solution.elements[DIRECT, 0, :count, 2]
        np.testing.assert_array_equal(found == 0, dark(p), err_msg=name)
        if name == "directional":
            np.testing.assert_allclose(found[found > 0], 0.8, rtol=1e-6)
        else:
            r = np.linalg.norm(p - [0, 0, 1.0], axis=1)
            np.testing.assert_allclose(found[found > 0], (1 / r**3)[found > 0], rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_furnace_of_a_white_sky(method: Any) -> None:
    """A convex object sees nothing but the sky: irradiance pi L everywhere, and no light of its own."""
    scene = lit(part(cuboid((-1, -1, -1), (1, 1, 1)), (0.3, 0.6, 0.9)), sky=white_sky(2.0))
    solution = solve_radiosity(scene, method=method, patches=50, particles=20_000)
    np.testing.assert_allclose(solution.elements[DIRECT, 0], 2 * np.pi, rtol=1e-6)
    np.testing.assert_allclose(solution.vertices[DIRECT, 0], 2 * np.pi, rtol=1e-6)
    np.testing.assert_allclose(solution.elements[INDIRECT], 0, atol=1e-9)


def test_a_plate_hides_its_form_factor_of_the_sky() -> None:
    corners = [(-0.5, -0.5, 0.4), (-0.5, 0.5, 0.4), (0.5, 0.5, 0.4), (0.5, -0.5, 0.4)]
    scene = lit(FLOOR, part(rectangle(corners[0], (0, 1, 0), (1, 0, 0)), 0.0), sky=white_sky())
    solution = solve_radiosity(scene, size=0.2, receiver_points=4)
    count = int((solution.divisions[:2].astype(int) ** 2).sum())
    p = middles(scene, solution)[:count]
    expected = np.pi - np.array([polygon_irradiance(x, (0, 0, 1), corners) for x in p])
    found = solution.elements[DIRECT, 0, :count, 1]
    assert found.mean() == pytest.approx(expected.mean(), rel=0.005)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.06


def test_a_sky_that_fades_to_the_horizon() -> None:
    """Radiance by the sine of the elevation, on what faces up: the integral of cos^2 over the hemisphere."""
    scene = lit(FLOOR, sky=Sky(np.ones(3), np.zeros(3), np.array([0.0, 0, 1])))
    solution = solve_radiosity(scene, size=0.3)
    np.testing.assert_allclose(solution.elements[DIRECT, 0], 2 * np.pi / 3, rtol=0.02)
    assert solution.elements[DIRECT, 0].mean() == pytest.approx(2 * np.pi / 3, rel=0.001)


@pytest.mark.parametrize("method", METHODS)
def test_a_bulb_in_a_closed_room_gives_all_its_light(method: Any) -> None:
    """4 pi I arrive, and a share rho of them again, and again."""
    rho, scene = (
        0.6,
        lit(part(cuboid((-1, -1, -1), (1, 1, 1), inside=True), 0.6), lights=(point((0.3, 0.1, -0.2)),)),
    )
    solution = solve_radiosity(scene, method=method, patches=400, unshot=1e-5, particles=200_000)
    areas = np.repeat(scene.areas / solution.divisions**2, solution.divisions**2)
    sent = 4 * np.pi * np.array([3.0, 2.0, 1.0])
    np.testing.assert_allclose(areas @ solution.elements[DIRECT, 0], sent, rtol=0.01)
    np.testing.assert_allclose(areas @ solution.elements[INDIRECT, 0], sent * rho / (1 - rho), rtol=0.015)


def test_elements_that_are_split_are_lit_too() -> None:
    plate = part(rectangle((-0.3, -0.3, 0.5), (0.6, 0, 0), (0, 0.6, 0)), 0.0)
    scene = lit(FLOOR, plate, lights=(point((0, 0, 2.0)),))
    coarse, fine = (solve_radiosity(scene, size=0.5, adaptive=n, threshold=0.2) for n in (0, 2))
    assert fine.statistics["elements"] > coarse.statistics["elements"]
    exact = solve_radiosity(scene, size=0.05, receiver_points=1)
    b = np.random.default_rng(1).dirichlet(np.ones(3), 2000)[:, 1:]
    t = np.random.default_rng(2).integers(0, 2, 2000)
    expected = exact.irradiance(t, b)
    off = [np.abs(s.irradiance(t, b) - expected).mean() for s in (coarse, fine)]
    assert off[1] < 0.5 * off[0]


def test_a_scene_that_nothing_lights_is_refused() -> None:
    with pytest.raises(SceneError, match=r"no shape with an emission, no other light and no sky"):
        solve_radiosity(lit(FLOOR, sky=white_sky(0.0)))
    with pytest.raises(SceneError, match="no shape that reflects"):
        solve_radiosity(lit(part(rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), 0.0), lights=(point((0, 0, 1)),)))


LIGHTS: dict[str, dict[str, Any]] = {
    "point": {"lights": (point((0.3, -0.2, 0.9), (2.0, 2.0, 1.0)),)},
    "directional": {
        "lights": (Light("sun", "directional", np.full(3, 2.0), direction=np.array([0.0, 0.6, -0.8])),)
    },
    "sky": {"sky": white_sky(1.0)},
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_the_gather_is_path_tracing(kind: str) -> None:
    """A corner of three walls, open above and to the front, with a box in it."""
    scene = lit(
        FLOOR,
        part(rectangle((-1, 1, 0), (2, 0, 0), (0, 0, 1.5)), 0.6),  # faces the camera
        part(rectangle((-1, -1, 0), (0, 2, 0), (0, 0, 1.5)), (0.7, 0.3, 0.3)),
        part(cuboid((-0.5, 0.0, 0.0), (0.1, 0.5, 0.6)), 0.5),
        **LIGHTS[kind],
    )
    scene = path_traceable(scene).with_camera(
        position=np.array([0.8, -3.0, 1.4]), target=np.array([0.0, 0.3, 0.4]), up=np.array([0.0, 0, 1]), fov=35.0,
        resolution=(24, 24),
    )  # fmt: skip
    solution = solve_radiosity(scene, patches=600, receiver_points=4)
    traced = glpath.render(scene, spp=256, max_depth=8)
    gathered = glpath.render(scene, integrator="gather", radiosity=solution, spp=256)
    assert gathered.mean.mean() == pytest.approx(traced.mean.mean(), rel=0.01)
    direct = glpath.render(scene, spp=128, max_depth=1)
    # Most of it is not what a picture of direct light alone has.
    assert direct.mean.mean() < 0.97 * gathered.mean.mean()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("lamp", ["point", "box"])
def test_a_room_is_as_bright_whichever_way_its_fronts_look(lamp: str, method: Any) -> None:
    """A closed surface that the camera and the light are in is a room, no solid."""
    shapes: list[dict[str, Any]] = [{"type": "box", "min": [-0.3, -1, -0.3], "max": [0.3, -0.4, 0.3]}]
    lights = [{"type": "point", "position": [0, 0.5, 0.8], "intensity": 0.1}]
    if lamp == "box":
        lights = []
        shapes.append({"type": "box", "min": [-0.2, 0.4, 0], "max": [0.2, 0.6, 0.4], "emission": {"radiance": 2}})
    found = []
    for flipped in (False, True):
        walls = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 3], "flip_normals": flipped}
        camera = {"position": [0, 0, 2.9], "target": [0, 0, 0]}
        grey = {"default": {"reflectance": 0.6}}
        scene = glpath.load_scene(
            {"camera": camera, "materials": grey, "shapes": [walls, *shapes], "lights": lights}
        )
        solution = solve_radiosity(scene, method=method, patches=200)
        inner = np.arange(12)
        at = np.full((12, 2), 1 / 3)
        # Only the side that looks in gets any light.
        found.append(sum(solution.irradiance(inner, at, side, "constant").mean() for side in (0, 1)))
    assert found[0] == pytest.approx(found[1], rel=0.03)
