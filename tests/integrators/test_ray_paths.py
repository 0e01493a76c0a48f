"""Paths with rays of their own: the fragment shader and the compute shader are one computation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import glpath
from glpath import solve_radiosity
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass, PixelDispatch
from glpath.integrators import ray_paths
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathSettings
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.solution_lookup import device_radiosity
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Scene, path_traceable
from glpath.sensors.sensor import CameraSensor

# No multiple of a work group's side.
WINDOW = (3, 2, 45, 29)


@pytest.mark.parametrize("name", ["cornell-box-36", "room", "gather"])
@pytest.mark.parametrize("tests", [200, 10**7], ids=["one area", "areas"])
def test_a_compute_shader_has_the_bits_of_the_fragment_shader(
    name: str, tests: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """llvmpipe takes the one, graphics cards the other; either runs both here."""
    monkeypatch.setattr(ray_paths, "_TESTS_A_VERTEX", tests)
    monkeypatch.setattr(RayPathEngine, "_look_by_rays", lambda *_: None)  # which graphics cards do not
    context = get_context()
    gl = context.gl
    scene = path_traceable(load_scene("cornell-box-36" if name == "gather" else name))
    scene = scene.with_camera(resolution=(50, 40))
    settings: PathSettings | GatherSettings = PathSettings(max_depth=3)
    radiosity = None
    if name == "gather":
        settings = GatherSettings()
        radiosity = device_radiosity(
            gl, scene, solve_radiosity(scene, patches=50), settings, CameraSensor.of(scene.camera)
        )
    taken, counts = [], []
    for hardware, kind in ((False, Pass), (True, PixelDispatch)):
        monkeypatch.setattr(context, "info", replace(context.info, hardware=hardware))
        engine = RayPathEngine(gl, DeviceScene(gl, scene), settings, WINDOW, radiosity=radiosity).prepare()
        assert type(engine._paths.now) is kind
        assert (len(engine._areas) > 1) is (hardware and tests > 1000)
        for index in range(3):
            engine.trace_path_set(index)
        taken.append(engine.take())
        counts.append(engine.statistics())
    assert taken[0].mean() > 0.01
    np.testing.assert_array_equal(taken[1], taken[0])
    assert counts[1] == counts[0]


LAMP = np.array([[-0.9, -0.5], [0.7, -0.8], [0.95, 0.4], [-0.6, 0.75]])
SCREEN = np.array([[-0.2, -2.0], [0.1, -2.0], [0.3, 2.0], [0.05, 2.0]])
SIDE = 24


def lamp_before_the_sky(behind: float = 2.0) -> Scene:
    """A slanted lamp of radiance 10, a black screen before a part of it, and a sky of 0.1 behind.

    The camera sees x and y from -1.2 to 1.2 of the plane z = 0.
    """

    def quad(corners: np.ndarray, z: float, scale: float, **fields: object) -> dict[str, object]:
        places = np.column_stack([scale * corners, np.full(4, z)])
        return {"type": "quad", "corners": places.tolist(), "material": "black", **fields}

    return path_traceable(
        scene_from_dict(
            {
                "camera": {
                    "position": [0, 0, 3],
                    "target": [0, 0, 0],
                    "up": [0, 1, 0],
                    "fov": float(2 * np.degrees(np.arctan(1.2 / 3))),
                },
                "film": {"resolution": [SIDE, SIDE]},
                "materials": {"black": {"reflectance": 0.0}},
                "sky": {"zenith": [0.1] * 3, "horizon": [0.1] * 3, "up": [0, 1, 0]},
                "shapes": [
                    quad(LAMP, -behind, 1 + behind / 3, emission={"radiance": [10.0] * 3}),
                    quad(SCREEN, 0.0, 1.0),
                ],
            }
        )
    )


def seen_through(places: np.ndarray) -> np.ndarray:
    """Radiance at places (..., 2) of the plane, by which side of each edge they are on."""

    def inside(corners: np.ndarray) -> np.ndarray:
        edges = np.roll(corners, -1, axis=0) - corners
        beside = places[..., None, :] - corners
        return np.all(edges[:, 0] * beside[..., 1] > edges[:, 1] * beside[..., 0], axis=-1)

    return np.where(inside(SCREEN), 0.0, np.where(inside(LAMP), 10.0, 0.1))


def exact_picture() -> np.ndarray:
    """(SIDE, SIDE): the mean over 64 x 64 places of each pixel."""
    along = -1.2 + 2.4 * (np.arange(64 * SIDE) + 0.5) / (64 * SIDE)
    x, y = np.meshgrid(along, -along)
    return seen_through(np.stack([x, y], axis=-1)).reshape(SIDE, 64, SIDE, 64).mean(axis=(1, 3))


@pytest.mark.parametrize("sampling", ["sobol", "random"])
def test_a_lamps_edge_is_what_eight_times_as_many_samples_make_of_it(sampling: str) -> None:
    """Against the exact picture; each sample by itself would be off by the root of coverage (1 - coverage) / n."""
    exact = exact_picture()
    edge = (exact > 0.5) & (exact < 9.9)
    assert edge.sum() > 60
    scene = lamp_before_the_sky()
    pictures = np.array(
        [glpath.render(scene, spp=16, max_depth=1, seed=seed, sampling=sampling).mean[..., 0] for seed in range(8)]
    )
    error = np.sqrt(np.mean((pictures - exact)[:, edge] ** 2))
    # With one place a set: 0.35 and 1.15.
    assert error < {"sobol": 0.1, "random": 0.45}[sampling]
    # It is right in the mean, of each pixel and of all.
    np.testing.assert_allclose(pictures.mean(axis=0), exact, atol={"sobol": 0.12, "random": 0.6}[sampling])
    assert pictures.mean() == pytest.approx(exact.mean(), rel=2e-3)


def test_a_picture_in_windows_has_the_lamps_edges_of_the_whole() -> None:
    context = get_context()
    scene, settings = lamp_before_the_sky(), PathSettings(max_depth=1)

    def take(engine: RayPathEngine) -> np.ndarray:
        for index in range(3):
            engine.trace_path_set(index)
        return engine.take()

    def engine_of(window: tuple[int, int, int, int]) -> RayPathEngine:
        return RayPathEngine(context.gl, DeviceScene(context.gl, scene), settings, window).prepare()

    whole = take(engine_of((0, 0, SIDE, SIDE)))
    engine = engine_of((0, 0, 8, 12))
    for x, y in ((0, 0), (8, 0), (16, 12), (0, 12)):
        engine.look_at((x, y, 8, 12))
        np.testing.assert_array_equal(take(engine), whole[y : y + 12, x : x + 8])


def test_another_sensor_has_lamps_edges_of_its_own() -> None:
    context = get_context()
    scene, settings = lamp_before_the_sky(), PathSettings(max_depth=1)
    turned = scene.with_camera(up=np.array([1.0, 0.0, 0.0]))

    def engine_of(scene: Scene) -> RayPathEngine:
        window = (0, 0, SIDE, SIDE)
        return RayPathEngine(context.gl, DeviceScene(context.gl, scene), settings, window).prepare()

    one, other = engine_of(scene), engine_of(turned)
    one.trace_path_set(0)
    first = one.take()
    one.look_from(other.sensor)
    for engine in (one, other):
        engine.trace_path_set(0)
    second = one.take()
    np.testing.assert_array_equal(second, other.take())
    assert not np.array_equal(first, second)


def test_a_scene_of_more_triangles_than_pixels_is_seen_by_rays() -> None:
    """What rays and scan conversion see differs on edges alone; the room has 14,920 triangles."""
    context = get_context()
    scene, window = path_traceable(load_scene("room")), (0, 0, 48, 36)
    seen = []
    for resolution in ((48, 36), (480, 360)):
        sensed = scene.with_camera(resolution=resolution)
        engine = RayPathEngine(context.gl, DeviceScene(context.gl, sensed), PathSettings(max_depth=1), window)
        engine.prepare()
        by_rays = not engine._eye_pass.depth
        assert by_rays is (resolution == (48, 36))
        # Both see the small image.
        engine.sensor = CameraSensor.of(scene.with_camera(resolution=(48, 36)).camera)
        engine.trace_path_set(0)
        seen.append(engine.seen())
    assert np.mean(seen[0] != seen[1]) < 0.01
    assert (seen[0] >= 0).all()
