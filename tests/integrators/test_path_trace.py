"""The path tracer is right: closed forms, and a small slow tracer in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath.compare import relative_mse
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_buffer import PathBufferTracer
from glpath.integrators.path_settings import PathBufferSettings
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Scene, path_traceable
from tests.reference.closed_forms import (
    facing_plates_radiance,
    furnace_radiance,
    polygon_irradiance,
    reflected_radiance,
)
from tests.reference.numpy_path_tracer import nearest_hits, path_trace
from tests.support.engines import engine_options
from tests.support.objects import flat

Float64 = NDArray[np.float64]


def scene_of(
    shapes: list[dict[str, Any]], position: Any, target: Any, up: Any = (0, 1, 0), fov: float = 40.0, size: int = 16
) -> Scene:
    scene = scene_from_dict(
        {
            "camera": {"type": "perspective", "position": position, "target": target, "up": up, "fov": fov},
            "film": {"resolution": [size, size]},
            "materials": {
                "black": {"type": "diffuse", "reflectance": 0.0},
                "half": {"type": "diffuse", "reflectance": 0.5},
                "red": {"type": "diffuse", "reflectance": [0.8, 0.2, 0.1]},
                "one-sided": {"type": "diffuse", "reflectance": 0.7, "two_sided": False},
            },
            "shapes": shapes,
        }
    )
    return path_traceable(scene)


def rectangle(x: float, y: float, z: float, *, up: bool, **more: Any) -> dict[str, Any]:
    """A horizontal rectangle around the y axis... of half widths x and z at height y."""
    corners = [[-x, y, z], [x, y, z], [x, y, -z], [-x, y, -z]]
    return {"type": "quad", "corners": corners if up else corners[::-1], "material": "half"} | more


def assert_mean_within_its_error(film: glpath.Film, truth: float) -> None:
    """The mean of the image, within its error as eight batches tell it (99.9 % of Student's t), and that small."""
    batches = film.radiance_sums.mean(axis=(1, 2, 3)) / film.batch_counts
    error = batches.std(ddof=1) / np.sqrt(len(batches))
    assert error < 0.03 * truth
    assert abs(film.mean.mean() - truth) < 5.4 * error + 1e-6


# Closed forms.


@pytest.mark.parametrize("depth", [1, 2, 3, 8])
@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_furnace_sums_the_geometric_series(shape: str, depth: int) -> None:
    film = glpath.render(
        "furnace", spp=256, max_depth=depth, resolution=(16, 16), parameters={"shape": shape, "reflectance": 0.6}
    )
    assert_mean_within_its_error(film, furnace_radiance(1.0, 0.6, depth))


def test_furnace_with_the_right_ambient_is_the_endless_series_at_any_depth() -> None:
    # Beyond the last vertex comes what is reflected: rho / (1 - rho), the emission having been counted.
    film = glpath.render("furnace", spp=256, max_depth=2, resolution=(16, 16), ambient=1.0)
    assert_mean_within_its_error(film, 2.0)


def test_ambient_is_a_colour() -> None:
    film = glpath.render("furnace", spp=16, max_depth=1, resolution=(16, 16), ambient=(0.0, 1.0, 2.0))
    r, g, b = film.mean.mean(axis=(0, 1))
    assert g - r == pytest.approx(0.5)
    assert b - r == pytest.approx(1.0)


def test_roulette_reaches_the_endless_series_without_bias() -> None:
    film = glpath.render("furnace", spp=256, max_depth=200, roulette=2, resolution=(16, 16))
    assert_mean_within_its_error(film, 2.0)


@pytest.fixture(scope="module")
def mean_of_the_box() -> float:
    return float(glpath.render("cornell-box-36", spp=1024, max_depth=3, resolution=(16, 16), seed=99).mean.mean())


@pytest.mark.parametrize(
    ("engine", "sampling"),
    [
        *((name, "sobol") for name in ("pair", "lattice", "hemisphere", "sphere")),
        ("pair", "random"),
        ("sphere", "random"),
    ],
)
def test_the_papers_estimator_and_ours_have_one_mean(sampling: Any, engine: Any, mean_of_the_box: float) -> None:
    film = glpath.render(
        "cornell-box-36", spp=256, max_depth=3, resolution=(16, 16), sampling=sampling, **engine_options(engine)
    )
    # 256 random directions that all pixels share leave 3 % in the mean of the picture.
    assert film.mean.mean() == pytest.approx(mean_of_the_box, rel=0.07 if sampling == "random" else 0.01)


@pytest.mark.parametrize("offset", [0.0, 0.8, 2.5])
def test_irradiance_under_a_rectangular_light_is_lamberts(offset: float) -> None:
    lamp = rectangle(1.0, 1.5, 0.6, up=False, emission={"radiance": 3.0}, material="black")
    floor = rectangle(20.0, 0.0, 20.0, up=True)
    scene = scene_of(
        [lamp, floor], position=(offset, 0.5, 0.01), target=(offset, 0, 0.01), up=(0, 0, 1), fov=1, size=8
    )
    film = glpath.render(scene, spp=512, max_depth=1)
    E = polygon_irradiance((offset, 0, 0.01), (0, 1, 0), lamp["corners"], 3.0)
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), reflected_radiance(E, 0.5), rtol=2e-3)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_two_facing_plates_light_each_other(depth: int) -> None:
    shapes = [
        rectangle(1.0, 0.0, 1.0, up=True, emission={"radiance": 1.0}),
        rectangle(1.0, 1.0, 1.0, up=False, emission={"radiance": 0.25}, material="one-sided"),
    ]
    scene = scene_of(shapes, position=(0, 0.5, 0), target=(0, 1, 0), up=(0, 0, 1), fov=4, size=8)
    film = glpath.render(scene, spp=512, max_depth=depth)
    _, upper = facing_plates_radiance(2, 2, 1, (1.0, 0.25), (0.5, 0.7), depth)
    assert film.mean.mean() == pytest.approx(upper, rel=0.01)


# Emitters and sides.


def test_a_one_sided_light_is_dark_from_behind_and_a_two_sided_one_is_not() -> None:
    lamp = rectangle(1.0, 0.0, 1.0, up=False, material="black")
    for two_sided, seen in ((False, 0.0), (True, 2.0)):
        emission = {"radiance": 2.0, "two_sided": two_sided}
        scene = scene_of([lamp | {"emission": emission}], (0, 3, 0), (0, 0, 0), up=(0, 0, 1), fov=10, size=4)
        assert np.all(glpath.render(scene, spp=8, max_depth=2).mean == seen)


def test_the_black_back_of_a_one_sided_surface_still_throws_a_shadow() -> None:
    lamp = rectangle(0.2, 3.0, 0.2, up=False, material="black", emission={"radiance": 9.0})
    shade = rectangle(1.0, 1.0, 1.0, up=False, material="one-sided")
    scene = scene_of([lamp, shade], (0, 2.0, 0), (0, 1, 0), up=(0, 0, 1), fov=10, size=4)
    assert np.all(glpath.render(scene, spp=8, max_depth=3).mean == 0.0)
    floor = rectangle(3.0, 0.0, 3.0, up=True)
    below = scene_of([lamp, shade, floor], (0, 0.5, 0), (0, 0, 0), up=(0, 0, 1), fov=10, size=4)
    assert np.all(glpath.render(below, spp=32, max_depth=1).mean == 0.0)


ROOM = [
    {"type": "box", "min": [-2, 0, -2], "max": [2, 3, 2], "flip_normals": True, "material": "half"},
    {"type": "box", "center": [0.7, 0.5, -0.4], "size": [0.8, 1.0, 0.6], "material": "red"},
]
LAMPS = [
    rectangle(0.5, 2.9, 0.3, up=False, material="black", emission={"radiance": [9.0, 8.0, 3.0]}),
    {
        "type": "quad",
        "corners": [[-1.2, 0.4, -1.0], [-0.6, 0.4, -1.3], [-0.6, 1.2, -1.3], [-1.2, 1.2, -1.0]],
        "material": "red",
        "emission": {"radiance": [1.0, 3.0, 6.0], "two_sided": True},
    },
    {
        "type": "sphere",
        "center": [-0.6, 0.3, 0.6],
        "radius": 0.2,
        "subdivisions": 1,
        "material": "half",
        "emission": {"radiance": [2.0, 0.5, 4.0]},
    },
]
OPEN = [
    rectangle(3.0, 0.0, 3.0, up=True, material="one-sided"),
    {"type": "sphere", "center": [0, 0.6, 0], "radius": 0.6, "subdivisions": 2, "material": "red"},
    rectangle(0.7, 2.0, 0.7, up=False, material="half", emission={"radiance": 5.0}),
]


@pytest.mark.parametrize(
    ("scene", "depth", "ambient"),
    [
        (load_scene("cornell-box-36").with_camera(resolution=(12, 12)), 3, 0.0),
        (scene_of(ROOM + LAMPS, (0.3, 1.4, 1.9), (-0.1, 1.0, -1.0), fov=75, size=12), 3, 0.0),
        (scene_of(OPEN, (1.5, 1.2, 3.0), (0, 0.5, 0), fov=45, size=12), 2, 0.3),
    ],
    ids=["cornell-box-36", "room with three lamps", "open, one-sided, a sphere"],
)
def test_a_small_slow_tracer_agrees(scene: Scene, depth: int, ambient: float) -> None:
    truth, variance = path_trace(scene, 400, depth, ambient=ambient, seed=1)
    film = glpath.render(scene, spp=512, max_depth=depth, ambient=ambient)
    difference = film.mean - truth
    spread = np.sqrt(variance + film.variance_of_mean() + 1e-12)
    # The whole picture: our paths share their directions, so their errors add up instead of averaging out.
    assert film.mean.mean() == pytest.approx(truth.mean(), rel=0.015)
    # Each pixel: as far off as the two errors say.
    z = difference / spread
    assert np.mean(z**2) < 1.6
    assert np.mean(np.abs(z) > 4) < 0.01


# Shadows: no acne, no leak.


def test_a_convex_shape_throws_no_shadow_on_itself() -> None:
    lamp = rectangle(1.5, 4.0, 1.5, up=False, material="black", emission={"radiance": 4.0})
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1.0, "subdivisions": 3, "material": "half"}
    scene = flat(scene_of([lamp, ball], (0, 3.0, 1.8), (0, 0.5, 0), fov=24, size=48))
    film = glpath.render(scene, spp=128, max_depth=1)
    checked = 0
    tracer_index = eye_triangles(scene)
    for (row, column), triangle in np.ndenumerate(tracer_index):
        # Only where neighbouring pixels show the same facet: antialiasing mixes at its edges.
        around = tracer_index[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        if triangle < 2 or np.any(around != triangle):
            continue
        centre, normal = scene.triangles[triangle].mean(axis=0), scene.normals[triangle]
        if min((np.asarray(lamp["corners"]) - centre) @ normal) <= 0.05:
            continue  # the facet's own plane cuts the lamp
        E = polygon_irradiance(centre, normal, lamp["corners"], 4.0)
        # The facet is a twelfth of the radius wide: irradiance differs by a few percent from its centre's.
        np.testing.assert_allclose(film.mean[row, column], reflected_radiance(E, 0.5), rtol=0.06)
        checked += 1
    assert checked > 100


def eye_triangles(scene: Scene) -> NDArray[np.int64]:
    """Which triangle the centre of each pixel shows, in numpy; -1 for none."""
    camera = scene.camera
    width, height = camera.resolution
    right, up, forward = camera.frame()
    tangent = np.tan(np.radians(camera.fov) / 2)
    x = (2 * (np.arange(width) + 0.5) / width - 1) * tangent * width / height
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * tangent
    d = (forward + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)
    index, _ = nearest_hits(scene.triangles, np.broadcast_to(camera.position, d.shape), d)
    return index.reshape(height, width)


def test_direct_light_around_a_contact_edge_is_the_brute_force_one() -> None:
    """Across the foot of a block, from its lit side through the block into its shadow."""
    lamp = rectangle(0.4, 3.0, 0.4, up=False, material="black", emission={"radiance": 20.0})
    lamp["transform"] = [{"translate": [-1.5, 0, 0]}]
    block = {"type": "box", "min": [-0.3, 0, -3], "max": [0.3, 0.7, 3], "material": "half"}
    scene = scene_of(
        [lamp, rectangle(6, 0, 6, up=True), block], (0.01, 12, 0), (0.01, 0, 0), up=(0, 0, 1), fov=14, size=64
    )
    film = glpath.render(scene, spp=512, max_depth=1)
    row = film.mean[28:36, :, 0].mean(axis=0)
    truth = brute_force_direct(scene, 32, light_points=16)
    np.testing.assert_allclose(row, truth, atol=0.015 * truth.max())


def brute_force_direct(scene: Scene, row: int, light_points: int) -> Float64:
    """(width,) reflected radiance along a row, with a grid of points on the first shape and in each pixel."""
    camera = scene.camera
    width, height = camera.resolution
    right, up, forward = camera.frame()
    tangent = np.tan(np.radians(camera.fov) / 2)
    sub = (np.arange(12) + 0.5) / 12
    x = (2 * (np.arange(width)[:, None] + sub) / width - 1).ravel() * tangent
    d = forward + x[:, None] * right + (1 - 2 * (row + 0.0) / height) * tangent * up
    index, t = nearest_hits(scene.triangles, np.broadcast_to(camera.position, d.shape), d)
    points, normals = camera.position + t[:, None] * d, scene.normals[index]
    corner, u, v = scene.triangles[0][1], *(scene.triangles[0][k] - scene.triangles[0][1] for k in (0, 2))
    area, n_lamp = np.linalg.norm(np.cross(u, v)), scene.normals[0]
    total = np.zeros(len(d))
    grid = (np.arange(light_points) + 0.5) / light_points
    for a in grid:
        for b in grid:
            w = corner + a * u + b * v - points
            r2 = np.sum(w * w, axis=1)
            hit, at = nearest_hits(scene.triangles, points + 1e-6 * normals, w)
            free = (hit < 2) | (at >= 1 - 1e-6)
            g = np.maximum(np.sum(normals * w, 1), 0) * np.maximum(-(w @ n_lamp), 0) / r2**2
            total += free * g * area
    radiance = scene.shapes[0].emission[0] * total / light_points**2 * 0.5 / np.pi
    return radiance.reshape(width, -1).mean(axis=1)


def test_a_closed_chest_in_a_lit_room_is_dark_inside() -> None:
    """But for single rays that pass within a texel of where three surfaces meet as the light sees them."""
    chest = {"type": "box", "min": [-0.3, 0, -0.3], "max": [0.3, 0.8, 0.3], "material": "half"}
    scene = scene_of([*ROOM[:1], *LAMPS, chest], (0.2, 0.3, 0.1), (-0.2, 0.2, -0.25), fov=100, size=48)
    inside = glpath.render(scene, spp=64, max_depth=1).mean
    assert np.mean(inside > 0) < 0.01
    without = scene_of([*ROOM[:1], *LAMPS], (0.2, 0.3, 0.1), (-0.2, 0.2, -0.25), fov=100, size=48)
    assert inside.mean() < 1e-4 * glpath.render(without, spp=64, max_depth=1).mean.mean()


# The film.


@pytest.mark.parametrize("split", [32, 5, 17])
def test_path_sets_0_to_64_are_those_of_two_renders_merged_bit_for_bit(split: int) -> None:
    size, depth = (40, 32), 3
    whole = glpath.render("cornell-box-36", spp=64, max_depth=depth, resolution=size)
    first = glpath.render("cornell-box-36", spp=split, max_depth=depth, resolution=size)
    second = glpath.render("cornell-box-36", spp=64 - split, first_path_set=split, max_depth=depth, resolution=size)
    np.testing.assert_array_equal(second.merge(first).mean, whole.mean)


def test_a_render_is_the_same_every_time_and_another_seed_is_another() -> None:
    def once(seed: int) -> Float64:
        return glpath.render("cornell-box-36", spp=4, max_depth=3, resolution=(32, 32), seed=seed).mean

    np.testing.assert_array_equal(once(3), once(3))
    assert not np.array_equal(once(3), once(4))


def test_a_scene_without_light_is_black_and_says_so() -> None:
    scene = scene_of(ROOM, (0.3, 1.4, 1.9), (0, 1, -1), size=8)
    with pytest.warns(glpath.SceneWarning, match="light"):
        film = glpath.render(scene, spp=4, max_depth=3)
    assert np.all(film.mean == 0.0)


def test_without_light_the_ambient_radiance_is_still_there() -> None:
    scene = scene_of(ROOM, (0.3, 1.4, 1.9), (0, 1, -1), size=8)
    with pytest.warns(glpath.SceneWarning, match="light"):
        film = glpath.render(scene, spp=4, max_depth=1, ambient=2.0)
    assert film.metadata.statistics["dropped_samples"] == 0
    assert film.mean.max() == pytest.approx(2.0 * 0.8)


@pytest.mark.parametrize("gap", [0.3, 1e-3])
def test_a_shade_right_below_a_lamp_throws_its_shadow_in_a_large_scene(gap: float) -> None:
    lamp = rectangle(0.2, 3.0, 0.2, up=False, material="black", emission={"radiance": 9.0})
    shade = rectangle(4.0, 3.0 - gap, 4.0, up=True)
    floor = rectangle(300.0, 0.0, 300.0, up=True)
    scene = scene_of([lamp, shade, floor], (0, 1.5, 0), (0, 0, 0), up=(0, 0, 1), fov=30, size=8)
    assert np.all(glpath.render(scene, spp=32, max_depth=1).mean == 0.0)


def test_a_sample_that_is_not_a_number_is_dropped_and_counted() -> None:
    scene = load_scene("furnace").with_camera(resolution=(8, 8))
    gl = get_context().gl
    settings = PathBufferSettings(max_depth=1, ambient=(0.0, float("nan"), 0.0))
    tracer = PathBufferTracer(gl, DeviceScene(gl, scene), settings, (0, 0, 8, 8)).prepare()
    tracer.trace_path_set(0)
    assert np.all(tracer.take() == 0.0)
    assert tracer.statistics()["dropped_samples"] == 64


def test_the_error_falls_at_least_in_proportion_to_the_path_sets() -> None:
    size = (24, 24)
    truth = glpath.render("cornell-box-36", spp=1024, max_depth=3, resolution=size, seed=1000).mean

    def error(spp: int) -> float:
        films = [glpath.render("cornell-box-36", spp=spp, max_depth=3, resolution=size, seed=s) for s in range(4)]
        return float(np.mean([relative_mse(f.mean, truth) for f in films]))

    slope = np.log(error(128) / error(16)) / np.log(8)
    # -1 is what random numbers give, and the roulette of crowded cells; Sobol points are better.
    assert -1.8 < slope < -0.95


def test_the_error_estimate_is_about_the_error() -> None:
    size = (32, 32)
    truth = glpath.render("cornell-box-36", spp=1024, max_depth=3, resolution=size, seed=1000).mean
    film = glpath.render("cornell-box-36", spp=128, max_depth=3, resolution=size)
    estimate = film.relative_error()
    assert estimate is not None
    # One Sobol sequence is better than its parts are to each other: the estimate is on the safe side.
    assert 0.8 < estimate / np.sqrt(relative_mse(film.mean, truth)) < 4.0
