"""Point, spot and directional lights and the sky in the path tracer: closed forms, numpy, and the ray tracer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators import ray_paths
from glpath.integrators.path_buffer import PathBufferTracer
from glpath.integrators.path_settings import PathBufferSettings
from tests.reference.numpy_path_tracer import path_trace
from tests.support.engines import engine_options
from tests.support.lit_things import FLOOR, LAMP, POINT, RHO, THINGS, floor_from_above, scene_of

SPOT: dict[str, Any] = {
    "type": "spot",
    "position": [2.5, 2.5, 2.2],
    "target": [0, 0, 0],
    "intensity": [30.0, 30.0, 36.0],
    "cone": [10, 25],
}
SUN: dict[str, Any] = {"type": "directional", "direction": [0.6, -0.8, -0.3], "irradiance": [1.0, 0.9, 0.8]}
SKY: dict[str, Any] = {"zenith": [0.2, 0.4, 1.0], "horizon": [0.6, 0.5, 0.4], "up": [0, 1, 0]}


# Closed forms.

OVER_THE_FLOOR: dict[str, tuple[dict[str, Any], Any]] = {
    "point": ({"type": "point", "position": [-0.8, 2, 0.01], "intensity": 5.0}, 5 * 2 / 2.5**3),
    "point without falloff": (
        {"type": "point", "position": [-0.8, 2, 0.01], "intensity": 5.0, "falloff": "none"},
        5 * 2 / 2.5,
    ),
    "spot, within": (
        {"type": "spot", "position": [-0.8, 2, 0.01], "target": [0.7, 0, 0.01], "intensity": 5.0, "cone": [5, 10]},
        5 * 2 / 2.5**3,
    ),
    "spot, half way of the cosines": (
        {
            "type": "spot",
            "position": [-0.8, 2, 0.01],
            "target": [-0.8, 0, 0.01],
            "intensity": 5.0,
            "cone": [np.degrees(np.arccos(0.9)), np.degrees(np.arccos(0.7))],
        },
        0.5**2 * 5 * 2 / 2.5**3,
    ),
    "spot wider than a half space": (
        {
            "type": "spot",
            "position": [-0.8, 2, 0.01],
            "target": [-0.8, 3, 0.01],
            "intensity": 5.0,
            "cone": [150, 170],
        },
        5 * 2 / 2.5**3,
    ),
    "spot, beyond": (
        {"type": "spot", "position": [-0.8, 2, 0.01], "target": [-0.8, 0, 0.01], "intensity": 5.0, "cone": [5, 30]},
        0.0,
    ),
    "directional": ({"type": "directional", "direction": [0.6, -0.8, 0], "irradiance": 5.0}, 4.0),
    "from below": ({"type": "directional", "direction": [0.6, 0.8, 0], "irradiance": 5.0}, 0.0),
}


@pytest.mark.parametrize("light", OVER_THE_FLOOR)
@pytest.mark.parametrize("depth", [1, 3])
def test_a_punctual_light_over_a_floor(light: str, depth: int) -> None:
    given, E = OVER_THE_FLOOR[light]
    film = glpath.render(floor_from_above(lights=[given]), spp=16, max_depth=depth)
    # A pixel is a patch of the floor, over which the edge of a spot is not linear.
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), RHO / np.pi * E, rtol=2e-3, atol=1e-9)


def test_the_lights_of_a_scene_add_up() -> None:
    """A set has one of them, chosen by power: their shares of the sets are their probabilities."""
    names = ("point", "point without falloff", "spot wider than a half space", "directional")
    some, E = [OVER_THE_FLOOR[name][0] for name in names], sum(OVER_THE_FLOOR[name][1] for name in names)
    film = glpath.render(floor_from_above(lights=some), spp=256, max_depth=1, resolution=(2, 2))
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), RHO / np.pi * E, rtol=0.01)


@pytest.mark.parametrize(("depth", "engine"), [(1, "pair"), (2, "pair"), (2, "hemisphere"), (2, "sphere")])
def test_under_a_constant_sky_a_convex_body_shows_its_reflectance(depth: int, engine: Any) -> None:
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1.0, "subdivisions": 2, "material": "m"}
    scene = scene_of([ball], (0, 1, 4), (0, 0, 0), fov=15, size=(16, 16), sky={"zenith": 2.0})
    film = glpath.render(scene, spp=512, max_depth=depth, **engine_options(engine))
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), 2 * RHO, rtol=0.01)


@pytest.mark.filterwarnings("ignore:The camera sees nothing")
def test_eye_rays_that_hit_nothing_see_the_sky() -> None:
    scene = scene_of([FLOOR], (0, 3, 0.01), (0, 6, 0.02), fov=1, size=(4, 4), sky=SKY)
    np.testing.assert_allclose(glpath.render(scene, spp=2).mean[0, 0], SKY["zenith"], rtol=1e-3)
    below = scene_of([LAMP], (0, 3, 0.01), (5, 2.9, 0.02), fov=1, size=(4, 4), sky=SKY)
    np.testing.assert_allclose(glpath.render(below, spp=2).mean[0, 0], SKY["horizon"], rtol=1e-6)


@pytest.mark.parametrize(("depth", "engine"), [(1, "pair"), (2, "pair"), (2, "hemisphere"), (2, "sphere")])
def test_a_floor_under_a_sky_from_horizon_to_zenith(depth: int, engine: Any) -> None:
    """E = pi (horizon + 2/3 (zenith - horizon)), by the integral over the cosine."""
    film = glpath.render(floor_from_above(sky=SKY), spp=256, max_depth=depth, **engine_options(engine))
    horizon, zenith = np.array(SKY["horizon"]), np.array(SKY["zenith"])
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), RHO * (horizon + 2 / 3 * (zenith - horizon)), rtol=0.01)


def test_open_to_the_sky_a_furnace_is_a_furnace() -> None:
    """Where rho + Le = sky = 1, radiance is 1 everywhere, whatever stands before what."""
    radiance = {"radiance": 0.5, "two_sided": True}
    shapes = [shape | {"material": "grey", "emission": radiance} for shape in THINGS]
    scene = scene_of(shapes, size=(12, 12), sky={"zenith": 1.0})
    film = glpath.render(scene, spp=128, max_depth=9)
    assert film.mean.mean() == pytest.approx(1.0, rel=0.01)
    np.testing.assert_allclose(film.mean, 1.0, rtol=0.25)


# Other renderers.

EVERYTHING: dict[str, Any] = {"lights": [POINT, SPOT, SUN], "sky": SKY}


@pytest.mark.parametrize(
    ("lights", "depth", "engine"),
    [
        ({"lights": [SUN]}, 2, "pair"),
        ({"sky": SKY}, 3, "pair"),
        ({"sky": SKY}, 2, "hemisphere"),
        ({"sky": SKY}, 2, "sphere"),
        (EVERYTHING, 3, "pair"),
    ],
)
def test_a_small_slow_tracer_agrees(lights: dict[str, Any], depth: int, engine: Any) -> None:
    scene = scene_of([*THINGS[:-1], LAMP], size=(8, 6), **lights)
    truth, variance = path_trace(scene, 300, depth, seed=1)
    film = glpath.render(scene, spp=512, max_depth=depth, **engine_options(engine))
    assert film.mean.mean() == pytest.approx(truth.mean(), rel=0.02)
    z = (film.mean - truth) / np.sqrt(variance + film.variance_of_mean() + 1e-12)
    assert np.mean(z**2) < 1.8
    assert np.mean(np.abs(z) > 4) < 0.01


@pytest.mark.parametrize("light", [POINT, SPOT, SUN, POINT | {"falloff": "none", "intensity": 1.0}])
def test_direct_light_is_that_of_the_ray_tracer(light: dict[str, Any]) -> None:
    scene = scene_of(lights=[light], ambient=0.05, size=(80, 60))
    paths = glpath.render(scene, spp=128, max_depth=1)
    rays = glpath.render(scene, integrator="t-buffer", spp=128, max_depth=1)
    assert paths.mean.mean() == pytest.approx(rays.mean.mean(), rel=0.003)
    # What is left are the two engines' samples within the pixels of edges.
    assert relative_mse(paths.mean, rays.mean) < 1e-4
    assert np.abs(paths.mean - rays.mean).max() < 0.1 * rays.mean.max()


def test_a_light_in_a_room_reaches_every_wall() -> None:
    """All six faces of the cube about it, and each shadow."""
    room = {"type": "box", "min": [-2, -2, -2], "max": [2, 2, 2], "flip_normals": True, "material": "grey"}
    posts = [
        {"type": "box", "center": c, "size": [0.2, 0.2, 0.2], "material": "m"}
        for c in ([1, 0, 0.1], [-1, 0.3, 0], [0, 1, 0.2], [0.1, -1, 0], [0, 0.2, 1], [0.2, 0, -1])
    ]
    for target in ([2, 2, 2], [-2, -2, -2]):
        scene = scene_of(
            [room, *posts],
            (0.01, 0.02, 0.03),
            target,
            fov=130,
            size=(60, 60),
            lights=[POINT | {"position": [0.1, 0.2, 0.0]}],
        )
        paths = glpath.render(scene, spp=64, max_depth=1)
        rays = glpath.render(scene, integrator="t-buffer", spp=64, max_depth=1)
        assert paths.mean.mean() == pytest.approx(rays.mean.mean(), rel=0.003)
        assert relative_mse(paths.mean, rays.mean) < 3e-4


# The frame.


def test_path_sets_split_and_merge_bit_for_bit_under_all_lights() -> None:
    scene = scene_of([*THINGS, LAMP], lights=[POINT, SPOT, SUN], sky=SKY, size=(40, 32))
    whole = glpath.render(scene, spp=48, max_depth=3)
    first = glpath.render(scene, spp=17, max_depth=3)
    second = glpath.render(scene, spp=31, first_path_set=17, max_depth=3)
    np.testing.assert_array_equal(second.merge(first).mean, whole.mean)
    crop = glpath.render(scene, spp=48, max_depth=1, crop=(8, 8, 16, 16))
    assert crop.mean.shape == (16, 16, 3)


def test_paths_that_crowd_in_the_light_are_weighed_without_bias() -> None:
    scene = scene_of(lights=[SUN], size=(64, 48))
    gl = get_context().gl
    films = []
    for share in (1.25, 0.15):
        settings = PathBufferSettings(max_depth=1, cell_share=share)
        tracer = PathBufferTracer(gl, DeviceScene(gl, scene), settings, (0, 0, 64, 48)).prepare()
        for index in range(64):
            tracer.trace_path_set(index)
        films.append(tracer.take() / 64)
        statistics = tracer.statistics()
    assert int(str(statistics["paths_lost"])) > 0.5 * int(str(statistics["paths_cast"]))
    assert films[1].mean() == pytest.approx(films[0].mean(), rel=0.005)
    assert relative_mse(films[1], films[0]) < 0.2


def test_the_scenes_ambient_light_is_what_the_option_assumes() -> None:
    scene = scene_of(lights=[POINT], ambient=[0.1, 0.2, 0.3])
    without = replace(scene, ambient=np.zeros(3))
    by_scene = glpath.render(scene, spp=4, max_depth=2).mean
    np.testing.assert_array_equal(
        by_scene, glpath.render(without, spp=4, max_depth=2, ambient=(0.1, 0.2, 0.3)).mean
    )
    np.testing.assert_array_equal(
        glpath.render(scene, spp=4, max_depth=2, ambient=0).mean, glpath.render(without, spp=4, max_depth=2).mean
    )


def test_beyond_the_last_vertex_ambient_light_stands_for_the_sky_as_well() -> None:
    """As the ray tracer has it."""
    scene = scene_of(sky=SKY, ambient=0.2)
    paths, rays = (glpath.render(scene, integrator=engine, spp=256, max_depth=1) for engine in ("path", "t-buffer"))
    assert paths.mean.mean() == pytest.approx(rays.mean.mean(), rel=0.003)


@pytest.mark.parametrize("depth", [2, pytest.param(3, marks=pytest.mark.evidence)])
def test_ambient_light_and_the_sky_are_not_both_at_the_last_vertex(depth: int) -> None:
    scene = scene_of(sky=SKY, ambient=0.4)
    own, shared = (
        glpath.render(scene, spp=512, max_depth=depth, **engine_options(engine)) for engine in ("path", "pair")
    )
    assert own.mean.mean() == pytest.approx(shared.mean.mean(), rel=0.004)


def test_a_chest_is_dark_inside_whatever_shines_on_it() -> None:
    chest = {"type": "box", "min": [-0.3, 0.5, -0.3], "max": [0.3, 1.3, 0.3], "material": "grey"}
    tables: dict[str, Any] = {"lights": [POINT, SPOT, SUN], "sky": SKY}
    view: dict[str, Any] = {"position": (0.2, 0.8, 0.1), "target": (-0.2, 0.7, -0.25), "fov": 100, "size": (48, 48)}
    inside = glpath.render(scene_of([FLOOR, chest], **view, **tables), spp=64, max_depth=2).mean
    assert np.mean(inside > 0) < 0.01
    assert inside.mean() < 1e-4


def test_a_light_chosen_by_what_it_sends_changes_the_error_and_not_the_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Resampling [Talbot 2005] has no bias, whatever a light is said to send; here are lights of all kinds."""
    scene = scene_of([*THINGS, LAMP], lights=[POINT, SPOT, SUN], sky=SKY, size=(32, 24))
    means, errors = [], []
    for parts in (1, 8):
        monkeypatch.setattr(ray_paths, "_PARTS", parts)
        films = np.array([glpath.render(scene, max_depth=2, spp=64, seed=seed).mean for seed in range(8)])
        means.append(films.mean(axis=0))
        errors.append(films.var(axis=0, ddof=1))
    spread = np.sqrt(sum(errors) / 8).clip(1e-4)
    assert (abs(means[1] - means[0]) / spread).mean() < 1.2
    assert means[1].mean() == pytest.approx(means[0].mean(), rel=3e-3)
    weight = 1 / (means[0] ** 2 + 0.01)
    assert (errors[0] * weight).mean() > 1.5 * (errors[1] * weight).mean()
