"""Portals: light samples of the sky through openings, with the light that there is without them, and less noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError
from glpath.io import scene_from_dict
from glpath.scene import Environment, Portal, Scene
from glpath.scene.model import Float64
from tests.reference.closed_forms import polygon_irradiance
from tests.support.lit_things import THINGS, scene_of

WIDTH, HEIGHT, DEPTH = 5.0, 3.0, 4.0
# In the roof, counter-clockwise from below.
OPENING = [[2, HEIGHT, 1.5], [3, HEIGHT, 1.5], [3, HEIGHT, 2.5], [2, HEIGHT, 2.5]]
PORTAL = {"corners": OPENING}
BESIDE = {"corners": [[2.25, 2.9, 1.5], [3.4, 2.9, 1.5], [3.4, 2.9, 2.4], [2.25, 2.9, 2.4]]}
ON_A_WALL = {"corners": [[0, 1, 1], [0, 2, 1], [0, 2, 3], [0, 1, 3]]}
OUTWARDS = {"corners": OPENING[::-1]}
LAMP: dict[str, Any] = {
    "type": "quad",
    "corners": [[4, 2.5, 1], [4.5, 2.5, 1], [4.5, 2.5, 1.5], [4, 2.5, 1.5]],
    "emission": {"radiance": 2.0},
}


def quad(*corners: Any) -> dict[str, Any]:
    return {"type": "quad", "corners": [list(map(float, corner)) for corner in corners], "material": "w"}


def room(portals: Any = (), *others: dict[str, Any], size: tuple[int, int] = (12, 9), **material: Any) -> Scene:
    """A closed room with an opening of 1 x 1 m in its roof, under a sky."""
    w, h, d = WIDTH, HEIGHT, DEPTH
    shapes = [
        quad((0, 0, d), (w, 0, d), (w, 0, 0), (0, 0, 0)),
        quad((0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0)),
        quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d)),
        quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d)),
        quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0)),
    ]
    for x0, x1, z0, z1 in ((0, 2, 0, d), (3, w, 0, d), (2, 3, 0, 1.5), (2, 3, 2.5, d)):
        shapes.append(quad((x0, h, z0), (x1, h, z0), (x1, h, z1), (x0, h, z1)))
    return scene_from_dict({
        "camera": {"position": [2.5, 1.5, 3.9], "target": [2.5, 0.9, 0], "fov": 60},
        "film": {"resolution": list(size)},
        "materials": {"w": {"reflectance": 0.6, **material}},
        "shapes": [*shapes, *others],
        "sky": {"zenith": [3, 4, 6], "horizon": [5, 5, 4], "up": [0, 1, 0], "portals": list(portals)},
    })  # fmt: skip


def means(scene: Scene, spp: int, sets: int = 8, **options: Any) -> Float64:
    """(sets, h, w, 3): pictures of other random numbers."""
    return np.array([
        glpath.render(scene, integrator="path", spp=spp, seed=1 + i, **options).mean for i in range(sets)
    ])  # fmt: skip


def test_a_floor_under_an_opening_has_the_irradiance_of_the_closed_form() -> None:
    scene = room([PORTAL]).with_camera(position=(2.5, 2.9, 2.0), target=(2.5, 0, 2.0), up=(0, 0, -1), fov=50)
    scene = replace(scene, sky=replace(scene.sky, zenith=np.ones(3), horizon=np.ones(3)))  # type: ignore[type-var]
    film = glpath.render(scene, integrator="path", spp=256, max_depth=1)
    rays = scene.camera.rays()
    floor = scene.camera.position - scene.camera.position[1] / rays[..., 1:2] * rays
    expected = 0.6 / np.pi * polygon_irradiance(floor, [0, 1, 0], OPENING)
    np.testing.assert_allclose(film.mean[..., 0], expected, rtol=0.02)


@pytest.mark.parametrize(
    "portals",
    [[PORTAL], [PORTAL, BESIDE, ON_A_WALL], [ON_A_WALL], [OUTWARDS]],
    ids=["the opening", "several that overlap", "a blind wall", "outwards"],
)
def test_a_room_has_the_same_light_whatever_portals_it_has(portals: Any) -> None:
    plain, through = means(room((), LAMP), 64), means(room(portals, LAMP), 64)
    by_set = [each.mean(axis=(1, 2, 3)) for each in (plain, through)]
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in by_set))
    assert by_set[0].mean() == pytest.approx(by_set[1].mean(), abs=3 * error)
    blocks = [each.reshape(len(each), 3, 3, 4, 3, 3).mean(axis=(2, 4, 5)) for each in (plain, through)]
    errors = np.sqrt(sum(each.var(axis=0, ddof=1) / len(each) for each in blocks))
    apart = (blocks[0].mean(axis=0) - blocks[1].mean(axis=0)) / errors
    # Of twelve blocks, errors known by eight sets.
    assert np.sqrt(np.mean(apart**2)) < 2.0


def test_through_its_portal_a_room_has_a_twentieth_of_the_squared_error() -> None:
    plain, through = (means(room(portals), 64, max_depth=4) for portals in ((), [PORTAL]))
    assert through.var(axis=0).mean() < plain.var(axis=0).mean() / 20


@pytest.mark.parametrize(
    "material", [{}, {"type": "principled", "roughness": 0.3, "reflectance": 0.5, "metallic": 1.0}]
)
def test_shiny_walls_share_the_sky_between_directions_and_portals(material: dict[str, Any]) -> None:
    plain, through = (means(room(p, size=(6, 4), **material), 256, max_depth=3) for p in ((), [PORTAL]))
    by_set = [each.mean(axis=(1, 2, 3)) for each in (plain, through)]
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in by_set))
    assert by_set[0].mean() == pytest.approx(by_set[1].mean(), abs=3 * error)


@pytest.mark.parametrize("sky", ["gradient", "map"])
def test_open_to_the_sky_a_furnace_is_a_furnace(sky: str) -> None:
    """Where rho + Le = sky = 1, radiance is 1 everywhere, wherever portals are."""
    radiance = {"radiance": 0.5, "two_sided": True}
    shapes = [shape | {"material": "grey", "emission": radiance} for shape in THINGS]
    corners = ([[-2, 2, -2], [2, 2, -2], [2, 2, 2], [-2, 2, 2]], [[-1, 0, 2], [-1, 1, 2], [1, 1, 2], [1, 0, 2]])
    portals = [{"corners": each} for each in corners]
    scene = scene_of(shapes, size=(12, 12), sky={"zenith": 1.0, "portals": portals})
    if sky == "map":
        scene = replace(scene, sky=Environment(np.ones((8, 16, 3), np.float32)))
    film = glpath.render(scene, integrator="path", spp=128, max_depth=9)
    assert film.mean.mean() == pytest.approx(1.0, rel=0.01)
    np.testing.assert_allclose(film.mean, 1.0, rtol=0.25)


def test_a_small_sun_comes_through_a_portal_as_without() -> None:
    image = np.full((32, 64, 3), 0.5, np.float32)
    image[2, 40] = 2000.0
    sky = Environment(image)
    plain, through = (means(replace(room(p), sky=sky), 128, max_depth=2) for p in ((), [PORTAL]))
    by_set = [each.mean(axis=(1, 2, 3)) for each in (plain, through)]
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in by_set))
    assert by_set[0].mean() == pytest.approx(by_set[1].mean(), abs=3 * error)


def test_points_of_a_measurement_are_lit_through_portals() -> None:
    scene = room([PORTAL])
    scene = replace(scene, sky=replace(scene.sky, zenith=np.ones(3), horizon=np.ones(3)))  # type: ignore[type-var]
    points = np.array([[1.0, 0.001, 1.0], [2.5, 0.001, 2.0], [4.0, 0.001, 3.5]])
    found = glpath.irradiance(scene, points, (0, 1, 0), spp=256, max_depth=1).values
    expected = polygon_irradiance(points, [0, 1, 0], OPENING)
    np.testing.assert_allclose(found[:, 0], expected, rtol=0.02)


# What is no portal.


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ([[2, 3, 1], [3, 3, 1], [3.5, 3, 2], [2.5, 3, 2]], "angle of"),
        ([[2, 3, 1], [3, 3, 1], [3, 3, 2], [2, 3.5, 2]], "portal is a rectangle"),
        ([[2, 3, 1], [2, 3, 1], [3, 3, 2], [2, 3, 2]], "an edge without length"),
    ],
)
def test_corners_of_no_rectangle_are_refused(corners: Any, expected: str) -> None:
    with pytest.raises(SceneError, match=expected) as refused:
        room([PORTAL, {"corners": corners}])
    assert "sky.portals[1].corners" in str(refused.value)
    with pytest.raises(SceneError, match=expected):
        Portal(np.array(corners))


def test_three_corners_and_other_fields_are_refused() -> None:
    with pytest.raises(SceneError, match=r"portals\[0\]"):
        room([{"corners": OPENING[:3]}])
    with pytest.raises(SceneError, match=r"portals\[0\]"):
        room([PORTAL | {"radiance": 3}])
    with pytest.raises(SceneError, match="four corners"):
        Portal(np.array(OPENING[:3]))


def test_more_portals_than_there_may_be_are_refused() -> None:
    with pytest.raises(SceneError, match="17, but allowed are 16"):
        room([PORTAL] * 17)
    with pytest.raises(SceneError, match="17 portals, but allowed are 16"):
        replace(room(), portals=(Portal(np.array(OPENING)),) * 17)


def test_portals_count_in_the_digest_of_a_scene_that_has_some() -> None:
    assert room().digest() != room([PORTAL]).digest()
    assert room([PORTAL]).digest() == replace(room(), portals=(Portal(np.array(OPENING)),)).digest()


def test_portals_go_with_a_scene_that_is_far_from_the_origin() -> None:
    far = np.array([5_800_000.0, 0.0, 400_000.0])
    scene = room([PORTAL])
    there = replace(
        scene,
        shapes=[
            replace(
                s, world_from_object=s.world_from_object + np.concatenate([np.zeros((3, 3)), far[:, None]], axis=1)
            )
            for s in scene.shapes
        ],
        camera=replace(scene.camera, position=scene.camera.position + far, target=scene.camera.target + far),
        portals=(Portal(np.array(OPENING) + far),),
    )
    seen = there.centred
    np.testing.assert_allclose(seen.portals[0].corners + seen.origin, there.portals[0].corners)
    assert np.abs(seen.portals[0].corners).max() < 20
