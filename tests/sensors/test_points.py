"""Paths that start at points: irradiance against closed forms, and films, jobs and refusals as of a camera."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.film import Film
from glpath.io import load_scene
from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS
from glpath.rendering import RenderJob, run
from glpath.scene import path_traceable
from glpath.sensors.sensor import PointSensor
from tests.reference.closed_forms import polygon_irradiance
from tests.support.engines import engine_options, gather_by
from tests.support.terrain import Hills

CAMERA = {"position": [0, -3, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 40}


def scene_of(**parts: Any) -> glpath.Scene:
    return load_scene({"camera": CAMERA, **parts})


#: A lamp of 1.2 x 0.8 that shines down from a height of 2, on a floor with a screen.
LAMP: dict[str, Any] = {
    "type": "quad",
    "corners": [[-0.6, 0.4, 2], [0.6, 0.4, 2], [0.6, -0.4, 2], [-0.6, -0.4, 2]],
    "emission": {"radiance": [10, 5, 2]},
    "material": "black",
}
BLACK = {"black": {"reflectance": 0}}
#: For scenes of nothing but light.
SPECK = {"type": "quad", "corners": [[0, 0, -50], [0.01, 0, -50], [0.01, 0.01, -50], [0, 0.01, -50]]}


def lamp_irradiance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of the lamp on points of the floor that face up, over its radiance."""
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    return polygon_irradiance(points, (0.0, 0.0, 1.0), LAMP["corners"])


def film_of(
    scene: glpath.Scene, positions: Any, normals: Any, spp: int = 64, independent: bool = False, **options: Any
) -> Film:
    """Of points in one row, or in rows."""
    positions = np.asarray(positions, float)
    positions = positions[None] if positions.ndim == 2 else positions
    facing = np.broadcast_to(np.asarray(normals, float), positions.shape)
    sensor = PointSensor.of(positions, facing, independent=independent)
    return run(RenderJob.of(scene, sensor=sensor, spp=spp, **options), scene=scene)


def irradiance_of(*arguments: Any, **options: Any) -> np.ndarray:
    return np.pi * film_of(*arguments, **options).mean


def grid(side: int, extent: float, z: float) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-extent, extent, side), np.linspace(-extent, extent, side))
    return np.stack([x, y, np.full_like(x, z)], axis=-1)


@pytest.mark.parametrize(("on_floor", "engine"), [(False, "path"), (True, "path"), (True, "pair")])
def test_under_a_lamp_it_is_the_form_factor(on_floor: bool, engine: str) -> None:
    floor = {"type": "quad", "corners": [[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], "material": "black"}
    scene = scene_of(materials=BLACK, shapes=[LAMP, floor] if on_floor else [LAMP])
    points = grid(7, 1.5, 0.0)
    found = irradiance_of(scene, points, [0, 0, 1], spp=256, max_depth=2, **engine_options(engine))
    expected = lamp_irradiance(points[..., 0], points[..., 1])[..., None] * [10, 5, 2]
    np.testing.assert_allclose(found, expected, rtol=0.01)
    # The other side of the same points sees nothing, and so does what faces the dark half of the world.
    assert not irradiance_of(scene, points, [0, 0, -1], spp=8, max_depth=2, **engine_options(engine)).any()


@pytest.mark.parametrize(
    ("options", "off"),
    [
        ({"max_depth": 16}, 0.003),  # 2^-17 of the light is lacking
        ({"integrator": "gather"}, 0.003),
        # All points have the error of the directions that they share.
        ({"max_depth": 16, "integrator": "path-buffer"}, 0.006),
        ({"integrator": gather_by("lattice")}, 0.006),
    ],
    ids=["path", "gather", "path-pair", "gather-lattice"],
)
def test_a_furnace_is_flat_on_walls_and_between_them(options: dict[str, Any], off: float) -> None:
    """A closed box of albedo 1/2 that emits 1/2: radiance is 1 everywhere, and E = pi."""
    box = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1], "flip_normals": True, "material": "grey"}
    scene = scene_of(
        camera=CAMERA | {"position": [0, -0.5, 0], "target": [0, 0, 0]},
        materials={"grey": {"reflectance": 0.5}},
        shapes=[box | {"emission": {"radiance": 0.5}}],
    )
    rng = np.random.default_rng(1)
    free = rng.uniform(-0.9, 0.9, (20, 3))
    facing = rng.normal(size=(20, 3))
    wall = np.concatenate([rng.uniform(-0.9, 0.9, (20, 2)), np.full((20, 1), -1.0)], axis=1)
    points = np.stack([free, wall])
    normals = np.stack([facing / np.linalg.norm(facing, axis=1, keepdims=True), np.tile([0.0, 0.0, 1.0], (20, 1))])
    found = irradiance_of(scene, points, normals, spp=256, **options)
    assert found.mean() == pytest.approx(np.pi, rel=off)
    np.testing.assert_allclose(found, np.pi, rtol=0.04)


def test_a_point_light_is_exact() -> None:
    light = {"type": "point", "position": [0.3, -0.2, 1.5], "intensity": [3, 2, 1]}
    floor = {"type": "quad", "corners": [[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], "material": "black"}
    scene = scene_of(materials=BLACK, shapes=[floor], lights=[light])
    points = grid(9, 2.0, 0.0)
    to = np.array(light["position"]) - points
    square = np.sum(to * to, axis=-1)
    expected = (to[..., 2] / square**1.5)[..., None] * light["intensity"]
    np.testing.assert_allclose(irradiance_of(scene, points, [0, 0, 1], spp=1, max_depth=1), expected, rtol=2e-5)


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_a_constant_sky_is_pi_however_a_point_is_turned(engine: str) -> None:
    scene = scene_of(sky={"zenith": [0.5, 1, 2], "horizon": [0.5, 1, 2]}, shapes=[SPECK])
    normals = np.array([[0, 0, 1], [1, 0, 0], [0, -1, 0], [0, 0, -1.0]])
    points, options = np.arange(12.0).reshape(1, 4, 3), {"max_depth": 2, **engine_options(engine)}
    found = irradiance_of(scene, points, normals[None], spp=256, **options)
    np.testing.assert_allclose(found[0], np.pi * np.tile([0.5, 1, 2], (4, 1)), rtol=0.02)


@pytest.mark.parametrize("engine", ["path", "pair", "lattice"])
def test_a_bounce_is_that_of_a_quadrature_in_numpy(engine: str) -> None:
    """A ceiling's irradiance by the floor that the lamp lights: the lamp's closed form, over the floor's area."""
    floor = {"type": "quad", "corners": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "material": "floor"}
    scene = scene_of(materials=BLACK | {"floor": {"reflectance": [0.8, 0.5, 0.2]}}, shapes=[LAMP, floor])
    points = np.array([[0.9, 0.3, 1.2], [0.0, -0.9, 0.5], [0.7, 0.7, 2.5]])
    side = 400
    at = (np.arange(side) + 0.5) * 2 / side - 1
    x, y = np.meshgrid(at, at)
    leaving = lamp_irradiance(x, y) / np.pi
    expected = []
    for point in points:
        square = (x - point[0]) ** 2 + (y - point[1]) ** 2 + point[2] ** 2
        expected.append(np.sum(leaving * point[2] ** 2 / square**2) * (2 / side) ** 2 * np.array([8, 2.5, 0.4]))
    # The third lies above the lamp, which hides part of the floor; without it, the two below see all of it.
    options: dict[str, Any] = {"max_depth": 2, **engine_options(engine)}
    found = irradiance_of(scene, points[:2], [0, 0, -1], spp=1024, **options)[0]
    np.testing.assert_allclose(found, expected[:2], rtol=0.03)
    hidden = irradiance_of(scene, [[0, 0, 2.001]], [0, 0, -1], spp=64, **options)[0, 0]
    assert not hidden.any()


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_a_surface_shadows_neither_itself_nor_lets_light_through(engine: str) -> None:
    """Under a white half of the sky, a card anywhere and however turned: pi times the share that its side sees."""
    options: dict[str, Any] = {"max_depth": 1, **engine_options(engine)}
    rng = np.random.default_rng(4)
    for offset in (np.zeros(3), np.array([300.0, -200.0, 100.0])):
        normal, along = rng.normal(size=(2, 3))
        normal /= np.linalg.norm(normal)
        along = np.cross(normal, along / np.linalg.norm(along))
        across = np.cross(normal, along)
        corners = [offset + a * along + b * across for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        card = {"type": "quad", "corners": [c.tolist() for c in corners], "material": "black"}
        lamp = {"type": "directional", "direction": (-normal).tolist(), "irradiance": 2}
        scene = scene_of(materials=BLACK, shapes=[card], lights=[lamp])
        u, v = rng.uniform(-1, 1, (2, 500, 1))
        points = offset + u * along + v * across
        lit = irradiance_of(scene, points, normal, spp=1, **options)
        # With shared directions a few lose their cell to others, which then weigh more.
        alone = np.isclose(lit, 2.0, rtol=1e-4)
        assert alone.mean() > 0.95 if engine == "pair" else alone.all()
        assert lit.mean() == pytest.approx(2.0, rel=0.005)
        # Its back, though the lamp's ray starts at the very surface.
        tilted = -0.999 * normal + np.sqrt(1 - 0.999**2) * along
        assert not irradiance_of(scene, points, -normal, spp=1, **options).any()
        assert not irradiance_of(scene, points, tilted, spp=1, **options).any()


def by_all_light_samples(scene: glpath.Scene, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(N, 3) W m^-2 with nothing between: the mean over samples that `Lighting` draws on the CPU."""
    lighting = Lighting.of(path_traceable(scene))
    u = np.random.default_rng(8).random((60_000, 3))
    u[:, 0] = (np.arange(len(u)) + u[:, 0]) / len(u)
    drawn = lighting.samples(u)
    area, sky = (drawn.kind == LIGHT_KINDS.index(kind) for kind in ("area", "sky"))
    found = lighting.irradiance(points, normals)
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        to = np.where(sky[:, None], -drawn.direction, drawn.position - point)
        distance = np.linalg.norm(to, axis=1)
        wi = to / np.maximum(distance, 1e-9)[:, None]
        lit = np.maximum(wi @ normal, 0.0) * (area | sky)
        lit[area] *= np.maximum(-np.sum(wi * drawn.direction, axis=1), 0.0)[area] / distance[area] ** 2
        found[i] += np.mean(drawn.radiance * (lit / drawn.density)[:, None], axis=0)
    return found


#: A map with a sun, of few texels.
SUNNY = np.random.default_rng(0).random((9, 16, 3)).astype(np.float32)
SUNNY[2, 5] = 60.0

#: Lights of which none stands in another's way, seen from the points below.
LIGHTINGS: dict[str, dict[str, Any]] = {
    "each-kind": {
        "textures": {"squares": {"type": "checker", "colors": [[0, 0, 0], [1, 0.5, 0.2]], "scale": 2}},
        "materials": {"sign": {"reflectance": 0.5, "emission_texture": "squares"}},
        "shapes": [
            {
                "type": "quad",
                "corners": [[-2, -1, 3], [-2, 0, 3], [-1, 0, 3], [-1, -1, 3]],
                "emission": {"radiance": [6, 3, 2]},
                "material": "sign",
            },
            {"type": "sphere", "center": [1.5, 0, 2], "radius": 0.4, "emission": {"radiance": [2, 3, 6]}},
            {
                "type": "quad",
                "corners": [[0, 2, 1], [1, 2, 1], [1, 2, 2], [0, 2, 2]],
                "emission": {"radiance": 4, "two_sided": True},
            },
        ],
        "lights": [
            {"type": "point", "position": [0.3, -0.2, 1.5], "intensity": [3, 2, 1]},
            {"type": "spot", "position": [1, 1, 2], "target": [0, 0, 0], "intensity": 9},
            {"type": "directional", "direction": [1, -1, -2], "irradiance": [1, 2, 0.5]},
        ],
    },
    # More than a vertex looks at one by one.
    "eleven": {
        "shapes": [
            {
                "type": "quad",
                "corners": [[i, 0.5, 2], [i + 0.5, 0.5, 2], [i + 0.5, 0, 2], [i, 0, 2]],
                "emission": {"radiance": [6 + i, 1, 6 - i]},
            }
            for i in range(-5, 6)
        ]
    },
    "dark-zenith": {"shapes": [SPECK], "sky": {"zenith": [0, 1, 0.2], "horizon": [1, 2, 3]}},
    "dark-horizon": {"shapes": [SPECK], "sky": {"zenith": [3, 2, 1], "horizon": 0.0}},
    "environment": {"shapes": [SPECK], "sky": {"zenith": 1}},
}


@pytest.mark.parametrize("name", LIGHTINGS)
def test_points_draw_the_light_samples_that_the_lighting_draws(name: str) -> None:
    scene = scene_of(**LIGHTINGS[name])
    if name == "environment":
        scene = replace(scene, sky=glpath.scene.Environment(SUNNY, rotation=25.0, scale=0.7))
    points = np.array([[0.0, 0, 0], [0.7, -0.4, 0.3], [-1.2, 0.6, 0.8], [0.2, 3.0, 0.2]])
    normals = np.array([[0.0, 0, 1], [0, 0.6, 0.8], [0.8, 0, 0.6], [0, -0.6, 0.8]])
    found = irradiance_of(scene, points, normals[None], spp=1024, max_depth=1, independent=True)[0]
    np.testing.assert_allclose(found, by_all_light_samples(scene, points, normals), rtol=0.04)


BOX = "cornell-box-36"


def box_sensor(side: int = 9, tables: int = 1) -> PointSensor:
    """Points across the box, at half of its height, that face up."""
    scene = load_scene(BOX)
    lower, upper = scene.bounds
    share = np.linspace(0.1, 0.9, side)
    x, z = np.meshgrid(lower[0] + share * (upper[0] - lower[0]), lower[2] + share * (upper[2] - lower[2]))
    points = np.stack([x, np.full_like(x, 0.5 * (lower[1] + upper[1])), z], axis=-1)
    moved = [points + 0.01 * k * (upper - lower) for k in range(tables)]
    return PointSensor.of(np.array(moved), np.broadcast_to([0.0, 1.0, 0.0], points.shape))


@pytest.mark.parametrize("engine", ["path", "lattice"])
def test_films_of_points_merge_go_on_and_come_back_from_json(engine: str) -> None:
    scene, sensor = load_scene(BOX), box_sensor(tables=4)
    options: dict[str, Any] = {"max_depth": 3, **engine_options(engine), "aovs": ("direct", "indirect")}
    job = RenderJob.of(BOX, sensor=sensor, spp=40, **options)
    text = job.to_json()
    assert len(text) < 2000
    assert sensor.sha256 in text
    again = RenderJob.from_json(text)
    assert again == job
    with pytest.raises(glpath.UsageError, match="Hand them in"):
        run(again)
    with pytest.raises(glpath.UsageError, match="made for points of SHA-256"):
        run(again, sensor=box_sensor())
    whole = run(again, sensor=box_sensor(tables=4))
    parts = [run(part, scene=scene) for part in job.split(3)]
    merged = parts[2].merge(parts[0]).merge(parts[1])
    np.testing.assert_array_equal(merged.radiance_sums, whole.radiance_sums)
    gone_on = run(job, film=parts[0])
    np.testing.assert_array_equal(gone_on.radiance_sums, whole.radiance_sums)
    np.testing.assert_allclose(whole.aov("direct") + whole.aov("indirect"), whole.mean, rtol=1e-12)
    assert whole.aov("direct").mean() > 0 < whole.aov("indirect").mean()
    assert whole.error_bound() > 0
    other = run(RenderJob.of(BOX, sensor=box_sensor(), spp=8, **options))
    with pytest.raises(glpath.UsageError, match="points"):
        whole.merge(other)


def test_a_crop_of_points_has_the_bits_of_the_whole() -> None:
    sensor = box_sensor()
    whole, part = (run(RenderJob.of(BOX, sensor=sensor, spp=4, crop=crop)) for crop in (None, (2, 3, 5, 4)))
    np.testing.assert_array_equal(part.mean, whole.mean[3:7, 2:7])


def test_path_sets_take_tables_evenly() -> None:
    """By a point light, which each place has exactly: the mean over the places."""
    scene = scene_of(shapes=[SPECK], lights=[{"type": "point", "position": [0, 0, 2], "intensity": 4}])
    places = np.random.default_rng(0).uniform(-1, 1, (8, 3, 5, 3))
    to = [0, 0, 2] - places
    expected = np.mean(4 * to[..., 2] / np.linalg.norm(to, axis=-1) ** 3, axis=0)
    sensor = PointSensor.of(places, np.broadcast_to([0.0, 0.0, 1.0], places.shape))
    found = np.pi * run(RenderJob.of(scene, sensor=sensor, spp=16, max_depth=1), scene=scene).mean
    np.testing.assert_allclose(found[..., 0], expected, rtol=1e-5)


def test_a_smooth_surface_weighs_light_by_its_own_normal() -> None:
    """As `shading_cosine` of the shaders does for what a camera sees."""
    scene = scene_of(shapes=[SPECK], lights=[{"type": "point", "position": [0, 0, 2], "intensity": 4}])
    smooth = np.array([[[np.sin(0.3), 0, np.cos(0.3)], [0, np.sin(-0.6), np.cos(0.6)]]])
    points, flat = np.zeros((1, 2, 3)), np.broadcast_to([0.0, 0.0, 1.0], (1, 2, 3))
    sensor = PointSensor.of(points, flat, shading_normals=smooth)
    found = np.pi * run(RenderJob.of(scene, sensor=sensor, spp=1, max_depth=1), scene=scene).mean
    np.testing.assert_allclose(found[0, :, 0], smooth[0, :, 2] * 2 / (1 + smooth[0, :, 2]), rtol=1e-5)


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_what_is_not_valid_is_black(engine: str) -> None:
    sensor = box_sensor()
    assert sensor.points is not None
    valid = np.random.default_rng(2).random((9, 9)) < 0.5
    points = np.where(valid[..., None], sensor.points.positions[0], np.nan)
    some = PointSensor.of(points, np.where(valid[..., None], [0.0, 1.0, 0.0], 0.0), valid)
    assert some.count == valid.sum()
    whole, part = (run(RenderJob.of(BOX, sensor=each, spp=4, **engine_options(engine))) for each in (sensor, some))
    assert not part.mean[~valid].any()
    if engine == "path":  # others may lose their cell to another point
        np.testing.assert_array_equal(part.mean[valid], whole.mean[valid])
    assert part.mean[valid].mean() == pytest.approx(whole.mean[valid].mean(), rel=0.05)


@pytest.mark.parametrize(
    ("position", "target", "up"),
    [((-0.4, -0.5, 0.7), (-0.4, -1, 0.7), (0, 0, 1)), ((-0.5, 0, 0.4), (-1, 0, 0.4), (0, 1, 0))],
    ids=["floor", "red-wall"],
)
def test_light_is_what_a_camera_sees_of_a_dull_surface(position: Any, target: Any, up: Any) -> None:
    """Its radiance is its reflectance over pi times its irradiance, at every depth: of a small patch of the box."""
    eye = {"type": "orthographic", "height": 0.04, "position": position, "target": target, "up": up}
    options: dict[str, Any] = {"spp": 256, "max_depth": 4}
    aovs = ("albedo", "normal", "position")
    seen = glpath.render(BOX, camera=eye, resolution=(8, 8), aovs=aovs, **options)
    normal, place, albedo = (seen.aov(name) for name in ("normal", "position", "albedo"))
    scene = load_scene(BOX)
    found = run(RenderJob.of(scene, sensor=PointSensor.of(place, normal), **options), scene=scene)
    expected = (albedo * found.mean).mean(axis=(0, 1))
    np.testing.assert_allclose(seen.mean.mean(axis=(0, 1)), expected, rtol=0.005)


HILLS = Hills(3, 9)
SKY_AND_LAMPS = {
    "sky": {"zenith": [0.2, 0.3, 0.6], "horizon": 0.5},
    "lights": [{"type": "point", "position": [1, 2, 1], "intensity": 5}],
}


def hills_scene(streamed: bool, **more: Any) -> glpath.Scene:
    """Hills of 1,458 triangles under a lamp, in chunks or in memory."""
    corners = np.concatenate([vertices[faces] for vertices, faces in map(HILLS.chunk, range(len(HILLS)))])
    mesh = {"vertices": corners.reshape(-1, 3).astype(float), "faces": np.arange(3 * len(corners)).reshape(-1, 3)}
    hills = {"type": "stream", "stream": HILLS} if streamed else mesh
    lamp = {
        "type": "quad",
        "corners": [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]],
        "emission": {"radiance": 9},
    }
    shapes = [lamp, {"type": "box", "min": [-0.4, 0.5, -0.3], "max": [0.3, 1.2, 0.3]}, hills]
    return scene_of(**{"shapes": shapes, **more})


@pytest.mark.parametrize("more", [{}, SKY_AND_LAMPS], ids=["lamp", "sky"])
def test_points_in_the_air_over_a_stream_have_the_bits_of_those_over_a_mesh(more: dict[str, Any]) -> None:
    points = grid(12, 2.5, 0.0)[..., [0, 2, 1]] + [0, 0.8, 0]
    options: dict[str, Any] = {"integrator": "path-buffer", "spp": 8, "max_depth": 3, "light_resolution": 64}
    films = [film_of(hills_scene(streamed, **more), points, [0, 1, 0], **options) for streamed in (True, False)]
    assert films[0].mean.any()
    np.testing.assert_array_equal(films[0].radiance_sums, films[1].radiance_sums)


def test_points_on_streamed_triangles_have_the_light_of_those_on_a_mesh() -> None:
    """They do not shadow themselves, though their triangles are not known."""
    corners = np.concatenate([vertices[faces] for vertices, faces in map(HILLS.chunk, range(len(HILLS)))])
    corners = corners[::11].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    options: dict[str, Any] = {"integrator": "path-buffer", "spp": 64, "max_depth": 3, "light_resolution": 64}
    streamed, meshed = (
        irradiance_of(hills_scene(each, **SKY_AND_LAMPS), corners.mean(axis=1), normals, **options)
        for each in (True, False)
    )
    np.testing.assert_allclose(streamed, meshed, rtol=0.02, atol=0.002 * meshed.max())


def test_a_scene_may_be_nothing_but_a_stream_under_a_sky() -> None:
    """Over open ground, whatever it reflects, a point that faces up sees the sky alone."""
    ground = np.array([[[-9, 0, -9], [-9, 0, 9], [9, 0, 9]], [[-9, 0, -9], [9, 0, 9], [9, 0, -9]]], float)
    scene = scene_of(shapes=[{"type": "stream", "stream": Chunks(ground)}], sky={"zenith": 1, "horizon": 1})
    found = irradiance_of(scene, [[0, 0, 0], [1, 0.5, 2]], [0, 1, 0], spp=64, integrator="path-buffer")
    np.testing.assert_allclose(found, np.pi, rtol=0.01)


class Chunks:
    """A stream of one chunk."""

    def __init__(self, corners: np.ndarray) -> None:
        self.corners = corners

    def __len__(self) -> int:
        return 1

    def chunk(self, index: int) -> np.ndarray:
        return self.corners


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"integrator": "t-buffer"}, 'integrator: "t-buffer" with a sensor of points'),
        ({"integrator": "classic"}, 'integrator: "classic" with a sensor of points'),
        ({"aovs": ("albedo", "direct")}, "aovs: albedo with a sensor of points"),
        ({"resolution": (4, 4)}, "resolution: has no meaning"),
        ({"camera": {"fov": 20}}, "camera: has no meaning"),
        ({"crop": (0, 0, 10, 1)}, "crop: 10 x 1 pixels"),
    ],
)
def test_what_points_do_not_have_is_refused_by_name(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.UsageError, match=words):
        RenderJob.of(BOX, sensor=box_sensor(), **options)


@pytest.mark.parametrize(
    ("positions", "normals", "valid", "words"),
    [
        (np.zeros((2, 3)), np.zeros((2, 3)), None, r"positions of shape \(2, 3\)"),
        (np.zeros((1, 0, 3)), np.zeros((1, 0, 3)), None, "in which there is none"),
        (np.zeros((1, 2, 3)), np.ones((1, 2, 3)), None, "not unit"),
        (np.zeros((1, 2, 3)), np.full((1, 2, 3), np.nan), None, "not unit"),
        (np.full((1, 2, 3), np.inf), np.tile([0, 0, 1.0], (1, 2, 1)), None, "not finite"),
        (np.zeros((1, 2, 3)), np.tile([0, 0, 1.0], (1, 3, 1)), None, "do not go with"),
        (np.zeros((1, 2, 3)), np.tile([0, 0, 1.0], (1, 2, 1)), np.zeros((1, 2)), "none of 2 x 1 is valid"),
        (np.zeros((1, 2, 3)), np.tile([0, 0, 1.0], (1, 2, 1)), np.ones((2, 2)), "valid has shape"),
        ("here", np.zeros((1, 2, 3)), None, "positions of shape"),
    ],
)
def test_points_that_are_none_are_refused(positions: Any, normals: Any, valid: Any, words: str) -> None:
    with pytest.raises(glpath.UsageError, match=words):
        PointSensor.of(positions, normals, valid)


def test_a_job_of_a_camera_takes_no_points() -> None:
    with pytest.raises(glpath.UsageError, match="start at a camera"):
        run(RenderJob.of(BOX, spp=1, resolution=(4, 4)), sensor=box_sensor())
