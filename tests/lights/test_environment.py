"""Environment maps: their directions, their density, and closed forms in every engine."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import glpath
from glpath import SceneError, solve_radiosity
from glpath.compare import relative_mse
from glpath.lights.lighting import Lighting, max_radiance
from glpath.radiosity.solution import DIRECT
from glpath.sampling.points import PathSetSampler, uniform_sphere
from glpath.scene import Environment, Scene, Sky
from glpath.scene.model import Float64, Light
from tests.reference.environment import environment_radiance
from tests.reference.numpy_path_tracer import path_trace
from tests.support.engines import coarse, engine_options, with_depth
from tests.support.lit_things import FLOOR, LAMP, POINT, RHO, THINGS, floor_from_above, scene_of

ENGINES: list[dict[str, Any]] = [
    {"integrator": "path"},
    {"integrator": "path-buffer"},
    {"integrator": "path-buffer", "directions": "hemisphere"},
    {"integrator": "path-buffer", "directions": "sphere"},
    {"integrator": "gather"},
    {"integrator": "t-buffer", "light_samples": 4},
    {"integrator": "classic", "light_samples": 4},
]
NAMES = [" ".join(map(str, engine.values())) for engine in ENGINES]


def noise(height: int, width: int, power: int = 3) -> Any:
    return (2 * np.random.default_rng(height * width).random((height, width, 3)) ** power).astype(np.float32)


def sun(height: int, width: int, row: int, column: int, radiance: Any, rest: Any = 0.0) -> Any:
    image = np.full((height, width, 3), rest, np.float32)
    image[row, column] = radiance
    return image


def centre(sky: Environment, row: int, column: int) -> Float64:
    """The direction of a texel's middle."""
    height, width = sky.image.shape[:2]
    theta, phi = np.pi * (row + 0.5) / height, 2 * np.pi * (0.5 - (column + 0.5) / width)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]) @ sky.frame


def picture(scene: Scene, engine: dict[str, Any], depth: int, spp: int) -> glpath.Film:
    """By paths of so many vertices; a gather's end at a coarse solution."""
    given = {"radiosity": coarse(scene)} if engine["integrator"] == "gather" else {}
    return glpath.render(scene, spp=spp, **with_depth({**engine, **given}, depth))


# What is where.


@pytest.mark.parametrize(
    ("up", "rotation", "middle", "left"),
    [
        ((0, 1, 0), 0, (0, 0, 1), (1, 0, 0)),  # Mitsuba
        ((0, 0, 1), 0, (1, 0, 0), (0, 1, 0)),  # Blender
        ((0, 1, 0), 90, (1, 0, 0), (0, 0, -1)),  # three.js
        ((1, 0, 0), 180, (0, -1, 0), (0, 0, -1)),
        ((0, -2, 0), 0, (0, 0, 1), (-1, 0, 0)),
    ],
)
def test_the_middle_and_the_left_of_a_map_are_where_it_is_said(up: Any, rotation: float, middle: Any, left: Any):
    """Of four columns and two rows, each texel's middle has its own colour alone."""
    image = np.zeros((2, 8, 3), np.float32)
    image[:, 3:5, 0], image[:, 1:3, 1], image[0, :, 2] = 1, 1, 1
    sky = Environment(image, np.array(up, float), rotation)
    np.testing.assert_allclose(sky.radiance([middle, left]), [[1, 0, 0.5], [0, 1, 0.5]], atol=1e-12)
    above = np.array(up) / np.linalg.norm(up)
    assert sky.radiance([above, -above])[:, 2].tolist() == [1, 0]


@pytest.mark.parametrize("size", [(1, 1), (1, 4), (2, 1), (3, 5), (16, 32)])
@pytest.mark.parametrize("up", np.eye(3))
def test_the_radiance_is_that_of_another_interpolation(size: tuple[int, int], up: Any):
    sky = Environment(noise(*size), up, 33.0, 2.5)
    d = uniform_sphere(np.random.default_rng(1).random((4000, 2)))
    d = np.concatenate([d, np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(sky.radiance(d), environment_radiance(sky, d), atol=1e-6)
    assert sky.radiance(d[0]).shape == (3,)


@pytest.mark.parametrize("size", [(2, 3), (8, 5)])
def test_a_map_that_is_cut_blends_no_row_with_one_beyond_the_horizon(size: tuple[int, int]):
    """Seen from above it is a map that repeats its last row above, and from below its first one below."""
    image, half = noise(*size), size[0] // 2
    sky = Environment(image, np.eye(3)[2], 33.0, 2.5, cut=True)
    upper, lower = image.copy(), image.copy()
    upper[half:], lower[:half] = image[half - 1], image[half]
    d = uniform_sphere(np.random.default_rng(1).random((4000, 2)))
    d = np.concatenate([d, d * [1, 1, 1e-6] / np.linalg.norm(d * [1, 1, 1e-6], axis=1, keepdims=True)])
    seen = [environment_radiance(Environment(each, sky.up, 33.0, 2.5), d) for each in (upper, lower)]
    np.testing.assert_allclose(sky.radiance(d), np.where(d[:, 2:] > 0, *seen), atol=1e-5)
    assert sky.digest != Environment(image, sky.up, 33.0, 2.5).digest


def test_a_sky_over_a_black_ground_has_a_sharp_edge():
    """Two rows, whose blend would be all of the map: pi on what faces up, half of it on what stands, none below."""
    image = np.array([[[1.0] * 3] * 4, [[0.0] * 3] * 4], np.float32)
    scene = replace(scene_of([FLOOR]), sky=Environment(image, np.array([0.0, 1, 0]), cut=True))
    points, normals = np.array([0.0, 9.0, 0.0]) + np.eye(3) * 1e-3, [[0, 1, 0], [1, 0, 0], [0, -1, 0]]
    found = glpath.irradiance(scene, points, normals, spp=1024, max_depth=1)
    assert (found.standard_errors < 0.03).all()
    np.testing.assert_allclose(found.values[:, 0], [np.pi, np.pi / 2, 0], atol=0.01)


@pytest.mark.filterwarnings("ignore:The camera sees nothing")
@pytest.mark.parametrize("engine", ENGINES, ids=NAMES)
@pytest.mark.parametrize("target", [(0.3, 0.1, 1), (0.01, 1, 0.02), (0.1, -1, 0.0), (0.0, 0.2, -1)])
def test_every_engine_shows_the_map_that_there_is(engine: dict[str, Any], target: Any):
    """By one sample a pixel; (0, 0, -1) is where the columns meet. No lamp is seen: its edges have own samples."""
    sky = Environment(noise(9, 20), np.array([0.02, 1, 0.05]), 77.0, 3.0)
    at = np.array([0, 900, 900])
    scene = replace(scene_of([LAMP], at, at + target, fov=70, size=(16, 12)), sky=sky)
    film = picture(scene, engine, 2, spp=1)
    camera = scene.camera
    traces_paths = engine.get("integrator") not in ("t-buffer", "classic")
    place = PathSetSampler(0, 1)[0].pixel if traces_paths else 0.5  # theirs begin with the centre
    expected = sky.radiance(camera.rays(camera.pixel_centres() - 0.5 + place))
    np.testing.assert_allclose(film.mean, expected, atol=3e-5)


# Density.


@pytest.mark.parametrize(
    ("size", "cut"),
    [((1, 1), 0), ((1, 3), 0), ((2, 4), 0), ((3, 1), 0), ((9, 16), 0), ((64, 128), 0), ((2, 4), 1), ((8, 16), 1)],
)
@pytest.mark.parametrize("brightest", [0.0, 300.0])
def test_directions_are_as_dense_as_the_radiance(size: tuple[int, int], cut: int, brightest: float):
    """By Pearson's test over cells of the sphere, against the density integrated in them."""
    image = noise(*size)
    image[size[0] // 3, size[1] // 2] += brightest
    sky = Environment(image, np.array([0.3, 1, -0.2]), 20.0, cut=bool(cut))
    rng = np.random.default_rng(5)
    drawn = sky.directions(rng.random((100_000, 3)))
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0)
    cells = (12, 17)

    def cell(d: Float64) -> Any:
        local = d @ sky.frame.T
        across = np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) % 1.0
        v = np.arccos(np.clip(local[:, 2], -1, 1)) / np.pi
        found = (np.minimum(v * cells[0], cells[0] - 1).astype(int)) * cells[1]
        return found + np.minimum(across * cells[1], cells[1] - 1).astype(int)

    # A grid of many points a cell, none on the borders of texels or cells.
    fine = [np.arange(each * 30) + 0.5 for each in cells]
    theta, phi = np.meshgrid(np.pi * fine[0] / len(fine[0]), 2 * np.pi * fine[1] / len(fine[1]), indexing="ij")
    local = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    d = local @ sky.frame
    area = (np.sin(theta) * (np.pi / len(fine[0])) * (2 * np.pi / len(fine[1]))).ravel()
    density = sky.radiance(d).mean(axis=1) / sky.mean_integral
    assert (density * area).sum() == pytest.approx(1.0, rel=2e-3)
    np.testing.assert_allclose((sky.radiance(d) * area[:, None]).sum(axis=0), sky.integral, rtol=2e-3)
    expected = np.bincount(cell(d), density * area, minlength=cells[0] * cells[1])
    found = np.bincount(cell(drawn), minlength=len(expected))
    many = expected * len(drawn) > 5
    assert found[~many].sum() <= 3 * expected[~many].sum() * len(drawn) + 9
    wanted = np.append(expected[many], expected[~many].sum() + 1e-9) * len(drawn)
    statistic = ((np.append(found[many], found[~many].sum()) - wanted) ** 2 / wanted).sum()
    assert stats.chi2.sf(statistic, len(wanted) - 1) > 1e-3


def test_light_samples_tell_the_density_that_they_have():
    """The mean of one over it is the sphere; beside a lamp, times the chance of the sky."""
    sky = Environment(noise(8, 16) + 0.1, scale=0.5)
    scene = replace(scene_of([FLOOR, LAMP], lights=[POINT]), sky=sky)
    lighting = Lighting.of(scene)
    samples = lighting.samples(np.random.default_rng(3).random((60_000, 3)))
    of_sky = samples.kind == 4
    wi = -samples.direction[of_sky]
    np.testing.assert_allclose(samples.density[of_sky], lighting.sky_density(wi))
    np.testing.assert_allclose(samples.radiance[of_sky], sky.radiance(wi))
    chance = lighting.cdf[-1] - lighting.cdf[-2]
    assert of_sky.mean() == pytest.approx(chance, rel=0.02)
    assert (1 / samples.density[of_sky]).sum() / len(of_sky) == pytest.approx(4 * np.pi, rel=0.03)


def test_a_number_just_below_one_is_a_direction_of_the_map():
    sky = Environment(sun(4, 8, 1, 7, 5.0))
    last = np.nextafter(1.0, 0.0)
    corners = np.array(np.meshgrid([0.0, 1.0, last], [0.0, last], [0.0, last])).reshape(3, -1).T
    assert (sky.radiance(sky.directions(corners)).mean(axis=1) >= 0).all()
    inside = sky.directions(np.clip(corners, 1e-9, 1 - 1e-9))
    assert (sky.radiance(inside) > 0).all()


# Closed forms.


@pytest.mark.parametrize("engine", ENGINES, ids=NAMES)
def test_a_map_of_one_colour_is_a_sky_of_one_colour(engine: dict[str, Any]):
    scene = scene_of([*THINGS, LAMP], size=(16, 12))
    sky, sky_map = Sky(np.full(3, 1.5), np.full(3, 1.5)), Environment(np.full((5, 8, 3), 0.5, np.float32), scale=3)
    a, b = (picture(replace(scene, sky=each), engine, 3, spp=200).mean for each in (sky, sky_map))
    noisy = engine.get("directions") == "sphere"
    assert a.mean() == pytest.approx(b.mean(), rel=6e-2 if noisy else 1.5e-2)
    assert relative_mse(a, b) < (0.3 if noisy else 1e-2)


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_open_to_a_map_of_one_a_furnace_is_a_furnace(engine: Any):
    radiance = {"radiance": 0.5, "two_sided": True}
    scene = scene_of([shape | {"material": "grey", "emission": radiance} for shape in THINGS], size=(12, 12))
    scene = replace(scene, sky=Environment(np.ones((6, 12, 3), np.float32)))
    film = glpath.render(scene, spp=128, max_depth=9, **engine_options(engine))
    assert film.mean.mean() == pytest.approx(1.0, rel=0.01)
    np.testing.assert_allclose(film.mean, 1.0, rtol=0.25)


@pytest.mark.parametrize("engine", [*ENGINES[:2], ENGINES[-2]], ids=[*NAMES[:2], NAMES[-2]])
def test_a_map_painted_with_a_gradient_is_that_sky(engine: dict[str, Any]):
    sky = Sky(np.array([0.2, 0.4, 1.0]), np.array([0.6, 0.5, 0.4]))
    theta = np.pi * (np.arange(128) + 0.5) / 128
    d = np.stack([np.sin(theta), np.cos(theta), 0 * theta], axis=1)
    painted = Environment(np.repeat(sky.radiance(d)[:, None], 4, axis=1))
    scene = scene_of([*THINGS, LAMP], size=(16, 12))
    a, b = (glpath.render(replace(scene, sky=each), spp=200, max_depth=3, **engine).mean for each in (sky, painted))
    assert a.mean() == pytest.approx(b.mean(), rel=1e-2)
    assert relative_mse(a, b) < 1e-2


def irradiance_of_texel(sky: Environment, row: int) -> Float64:
    """(3,) on what faces up: the tent of one texel, of which the integrals over angles have closed forms."""
    height, width = sky.image.shape[:2]
    step, theta = np.pi / height, np.pi * (row + 0.5) / height
    # The integral of (1 - |x| / step) sin(2 theta + 2 x) / 2.
    vertical = 0.5 * np.sin(2 * theta) * step * np.sinc(step / np.pi) ** 2
    return sky.scale * sky.image[row].max(axis=0) * vertical * 2 * np.pi / width


@pytest.mark.parametrize("engine", ENGINES, ids=NAMES)
def test_a_floor_under_one_bright_texel(engine: dict[str, Any]):
    sky = Environment(sun(32, 64, 9, 50, (1e4, 8e3, 5e3)), np.array([0.0, 1, 0]), 10.0, 0.5)
    scene = replace(floor_from_above(), sky=sky)
    film = picture(scene, engine, 2, spp=256)
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), RHO / np.pi * irradiance_of_texel(sky, 9), rtol=0.01)


def test_a_mirror_shows_the_map():
    """Of smooth metal: by the direction that the surface chooses alone, though the map is sampled as well."""
    sky = Environment(noise(8, 16) + sun(8, 16, 2, 4, 1e4), np.array([0.0, 1, 0]), 15.0)
    mirror = {"type": "principled", "reflectance": 1.0, "metallic": 1.0, "roughness": 0.0}
    scene = replace(scene_of([FLOOR], (0, 3, 0.5), (0, 0, 0), materials={"m": mirror}), sky=sky)
    film = glpath.render(scene, spp=1, max_depth=2)
    rays = scene.camera.rays(scene.camera.pixel_centres() - 0.5 + PathSetSampler(0, 1)[0].pixel)
    np.testing.assert_allclose(film.mean, sky.radiance(rays * [1, -1, 1]), rtol=1e-3, atol=1e-3)


def test_radiosity_has_the_light_of_one_bright_texel():
    """Of which not one ray in a thousand by the cosine would be found."""
    sky = Environment(sun(64, 128, 18, 50, 1e5))
    solution = solve_radiosity(replace(scene_of([FLOOR]), sky=sky), size=4.0)
    expected = irradiance_of_texel(sky, 18)[0]
    np.testing.assert_allclose(solution.elements[DIRECT, 0], expected, rtol=0.1)
    assert solution.elements[DIRECT, 0].mean() == pytest.approx(expected, rel=0.01)


# Other renderers, and the light of a sun.


@pytest.mark.parametrize(
    ("depth", "engine"),
    [
        (3, {"integrator": "path"}),
        (3, {"integrator": "path-buffer"}),
        (2, {"integrator": "path-buffer", "directions": "sphere"}),
        (2, ENGINES[4]),
    ],
)
def test_a_small_slow_tracer_agrees(depth: int, engine: dict[str, Any]):
    sky = Environment(noise(6, 9), np.array([0.0, 0, 1]), 40.0)
    scene = replace(scene_of([*THINGS[:-1], LAMP], size=(8, 6), lights=[POINT]), sky=sky)
    gathers = engine["integrator"] == "gather"
    truth, variance = path_trace(scene, 300, 6 if gathers else depth, seed=1)
    film = picture(scene, engine, depth, spp=512)
    assert film.mean.mean() == pytest.approx(truth.mean(), rel=0.03 if gathers else 0.02)
    if not gathers:
        z = (film.mean - truth) / np.sqrt(variance + film.variance_of_mean() + 1e-12)
        assert np.mean(z**2) < 1.8
        assert np.mean(np.abs(z) > 4) < 0.01


def sunny(size: tuple[int, int] = (32, 24)) -> tuple[Scene, Scene]:
    """Under a map of a blue sky with a sun in one texel, and under a directional light and a sky like it."""
    blue, row, column = np.array([0.2, 0.4, 1.0]), 256, 480
    sky = Environment(sun(1024, 2048, row, column, 2.56e6, blue))
    alone = Environment(sun(1024, 2048, row, column, 2.56e6 - blue))
    light = Light("sun", "directional", alone.integral, direction=-centre(sky, row, column))
    scene = scene_of(size=size)
    return replace(scene, sky=sky), replace(scene, sky=Sky(blue, blue), lights=(light,))


def under_a_map_with_a_sun() -> Scene:
    sky = Environment(noise(16, 32) + sun(16, 32, 4, 9, (400, 300, 200)), np.array([0.1, 1, 0.2]), 50.0)
    flat = [shape for shape in THINGS if shape["type"] != "sphere"]
    return replace(scene_of(flat, size=(32, 24)), sky=sky)


@functools.cache
def seen_by_mitsuba() -> Any:
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    from benchmarks.peers.mitsuba import render_mitsuba

    return render_mitsuba(under_a_map_with_a_sun(), 1024, 3)


@pytest.mark.evidence
@pytest.mark.parametrize("engine", ["path", "pair"])
def test_mitsuba_sees_the_same_under_a_map_with_a_sun(engine: Any):
    theirs = seen_by_mitsuba()
    ours = glpath.render(under_a_map_with_a_sun(), spp=1024, max_depth=3, **engine_options(engine)).mean
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.005)
    assert relative_mse(ours, theirs) < 2e-3


@pytest.mark.parametrize("depth", [1, 3])
def test_a_sun_in_a_map_is_as_good_as_a_directional_light_with_a_sky(depth: int):
    means, errors = [], []
    for scene in sunny():
        films = np.array([glpath.render(scene, max_depth=depth, spp=64, seed=seed).mean for seed in range(6)])
        means.append(films.mean())
        errors.append(films.var(axis=0, ddof=1).mean())
    assert means[0] == pytest.approx(means[1], rel=5e-3)
    assert errors[0] < 2.2 * errors[1]


@pytest.mark.filterwarnings("ignore:The camera sees nothing")
@pytest.mark.parametrize("engine", ENGINES[:2], ids=NAMES[:2])
def test_sums_hold_a_sun_and_what_is_dark_beside_it(engine: dict[str, Any]):
    """A million beside a thousandth, 300 path sets."""
    sky = Environment(sun(512, 1024, 100, 300, 1e6, 1e-3))
    assert max_radiance(replace(scene_of([LAMP]), sky=sky)) < 100
    at = np.array([0, 90, 0])
    lamp = [LAMP | {"emission": {"radiance": 1.0}}]
    for direction, expected in ((centre(sky, 100, 300), 1e6), (np.array([0.3, 0.2, 0.8]), 1e-3)):
        scene = replace(scene_of(lamp, at, at + direction, fov=0.0001, size=(4, 4)), sky=sky)
        film = glpath.render(scene, spp=300, max_depth=1, **engine)
        # The corners of the picture are not quite the middle of the texel.
        np.testing.assert_allclose(film.mean, expected, rtol=5e-3)
        assert film.metadata.statistics["dropped_samples"] == 0


@pytest.mark.parametrize("engine", ENGINES[:2], ids=NAMES[:2])
def test_path_sets_and_tiles_under_a_map_merge_bit_for_bit(engine: dict[str, Any]):
    scene = replace(scene_of([*THINGS, LAMP], lights=[POINT], size=(40, 32)), sky=Environment(noise(9, 16)))
    whole = glpath.render(scene, spp=24, max_depth=3, **engine)
    first = glpath.render(scene, spp=9, max_depth=3, **engine)
    second = glpath.render(scene, spp=15, first_path_set=9, max_depth=3, **engine)
    np.testing.assert_array_equal(second.merge(first).mean, whole.mean)
    if engine["integrator"] == "path":
        crop = glpath.render(scene, spp=24, max_depth=3, crop=(8, 4, 16, 20), **engine)
        np.testing.assert_array_equal(crop.mean, whole.mean[4:24, 8:24])


# What is no map.


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"image": np.ones((2, 4))}, r"shape \(2, 4\), but must be \(h, w, 3\)"),
        ({"image": np.ones((0, 4, 3))}, "shape"),
        ({"image": np.full((2, 4, 3), np.nan)}, "values from nan to nan"),
        ({"image": np.full((2, 4, 3), np.inf)}, "values from inf to inf"),
        ({"image": np.full((2, 4, 3), -1.0)}, "values from -1 to -1 times 1"),
        ({"scale": -1.0}, "times -1"),
        ({"scale": 1e20}, "from 0 to 1e[+]15"),
        ({"up": np.zeros(3)}, "any length but zero"),
        ({"rotation": np.nan}, "rotation nan"),
    ],
)
def test_what_is_no_radiance_is_refused(fields: dict[str, Any], expected: str):
    with pytest.raises(SceneError, match=expected):
        Environment(**({"image": np.ones((2, 4, 3), np.float32)} | fields))


def test_a_black_map_is_no_light():
    scene = replace(scene_of([FLOOR]), sky=Environment(np.zeros((2, 4, 3), np.float32)))
    assert Lighting.of(scene).dark
    with pytest.warns(glpath.SceneWarning, match="the picture will be black"):
        assert not glpath.render(scene, spp=2).mean.any()
