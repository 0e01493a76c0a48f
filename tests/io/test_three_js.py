"""What we export and bake, as three.js shows it in a browser: camera, places, base colours, light."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from benchmarks.figures.eye_hits import ShownHits
from glpath.errors import SceneWarning
from glpath.scene.model import Camera, Light, Material, Scene, Shape, Texture, TextureSlot
from tests.support import three_js
from tests.support.surfaces import quad, scene_of

pytestmark = three_js.marks()

WIDTH, HEIGHT = 80, 60


@pytest.fixture(scope="module")
def three() -> Iterator[three_js.Viewer]:
    with three_js.viewer() as viewer:
        yield viewer
        assert viewer.complaints() == []


def exported(scene: Scene, path: Path) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of the sky, and of lamps of one side
        glpath.export(scene, path)
    return path


# A bake


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, glpath.RadiositySolution, Path]:
    # Without backs, which path tracers, unlike viewers, see as well.
    scene = glpath.load_scene("cornell-box-36").with_camera(resolution=(64, 64))
    solution = glpath.solve_radiosity(scene, patches=150)
    path = tmp_path_factory.mktemp("baked") / "a.glb"
    solution.to_glb(scene, path, exposure=-6)  # so that the lamp is below 1, too
    return scene, solution, path


def test_a_bake_shows_the_solution(three: three_js.Viewer, baked: Any) -> None:
    scene, solution, path = baked
    seen = three.picture(path, 64, 64, samples=4) * 2.0**6
    expected = ShownHits.of(scene, 4).radiance(solution, "smooth")
    assert seen.mean() == pytest.approx(expected.mean(), rel=1e-3)
    assert np.quantile(np.abs(seen - expected) / expected.mean(), 0.98) < 0.01


def test_a_bake_is_rendered_as_three_js_shows_it(three: three_js.Viewer, baked: Any) -> None:
    path = baked[2]
    # The lamp, which is most of the light, has edges along rows of pixels: 4 x 4 places would be 2 % off.
    seen = three.picture(path, 64, 64, samples=12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of backs, which viewers leave out
        film = glpath.render(path, spp=32, max_depth=1, resolution=(64, 64))
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), seen.mean(axis=(0, 1)), rtol=0.01)


# An export: what is where, and of which colour


@pytest.mark.parametrize("name", ["parlour", "room"])
def test_a_room_has_its_camera_its_places_and_its_colours(
    three: three_js.Viewer, name: str, tmp_path: Path
) -> None:
    scene = glpath.load_scene(name).with_camera(resolution=(WIDTH, HEIGHT))
    path = exported(scene, tmp_path / "a.glb")
    expected = ShownHits.of(scene, 1).position[..., 0, :]
    place = three.picture(path, WIDTH, HEIGHT, show="position", samples=1)
    assert np.mean(np.isnan(place) != np.isnan(expected)) < 0.01
    # Half a pixel is 4e-3 of the room; at edges another surface is met.
    off = np.linalg.norm(place - expected, axis=-1) / (np.nanmax(expected) - np.nanmin(expected))
    assert np.nanmedian(off) < 1e-3
    assert np.nanquantile(off, 0.98) < 2.5e-3
    film = glpath.render(scene, spp=8, max_depth=1, aovs=("albedo",))
    base = three.picture(path, WIDTH, HEIGHT, show="base colour")
    # An albedo is 0.04 more than the base colour where there is a reflection on top, as in the parlour.
    off = np.abs(np.median(film.aov("albedo") - base, axis=(0, 1)))
    assert np.all(off < (0.05 if name == "parlour" else 2e-3)), off
    assert np.quantile(np.abs(film.aov("albedo") - base), 0.9) < 0.07


# An export: direct light


def corner(camera: str) -> Scene:
    """A floor and two walls, seen from within, so that nothing is in the shade: a checker, coloured vertices."""
    rng = np.random.default_rng(1)
    floor = quad([[0, 0, 0], [0, 0, 3], [3, 0, 3], [3, 0, 0]])
    left = quad([[0, 0, 0], [0, 3, 0], [0, 3, 3], [0, 0, 3]])
    back = quad([[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0]])
    coloured = replace(left, colours=np.concatenate([rng.uniform(0.2, 1, (4, 3)), np.ones((4, 1))], axis=1))
    checker = Texture("checker", rng.integers(30, 256, (6, 6, 3), np.uint8), srgb=True)
    view = Camera(
        np.array([2.6, 2.2, 2.4]), np.array([0.3, 0.7, 0.4]), np.array([0.0, 1.0, 0.0]), 55.0, (WIDTH, HEIGHT)
    )
    if camera == "orthographic":
        view = replace(view, projection="orthographic", height=2.4)
    lights = (
        Light("bulb", "point", np.array([3.0, 2.0, 1.0]), np.array([1.2, 1.5, 0.9])),
        Light("sun", "directional", np.array([0.2, 0.5, 1.0]), direction=np.array([-1.0, -2.0, -1.5]) / 7.25**0.5),
        Light(
            "lamp", "spot", np.array([0.0, 9.0, 3.0]), np.array([2.0, 2.0, 2.0]),
            direction=-np.ones(3) / 3**0.5, cone=(34.99, 35.0),  # three.js fades by smoothstep
        ),
    )  # fmt: skip
    materials = [
        Material("checker", np.full(3, 0.9), texture=TextureSlot(0)),
        Material("coloured", np.full(3, 0.8)),
        Material("green", np.array([0.2, 0.6, 0.3])),
    ]
    shapes = [Shape("floor", floor, 0), Shape("left", coloured, 1), Shape("back", back, 2)]
    # In candela, as three.js takes what is exported.
    return scene_of(shapes, materials, view, (checker,), lights=lights, unit="photometric")


@pytest.mark.parametrize("camera", ["perspective", "orthographic"])
def test_direct_light_in_a_corner_is_ours(three: three_js.Viewer, camera: str, tmp_path: Path) -> None:
    scene = corner(camera)
    seen = three.picture(exported(scene, tmp_path / "a.glb"), WIDTH, HEIGHT)
    film = glpath.render(scene, spp=32, max_depth=1)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), film.mean.mean(axis=(0, 1)), rtol=2e-3)
    # Of each pixel's light; the checker's edges are elsewhere in a pixel's places.
    off = np.abs(seen - film.mean) / film.mean.mean()
    assert np.quantile(off, 0.9) < 0.04
