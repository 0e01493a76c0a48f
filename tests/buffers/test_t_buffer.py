"""The T-buffer and the classical algorithm see the same, bit for bit, and what a slow tracer sees."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

import glpath.gl.program as program
from glpath.buffers import t_buffer
from glpath.buffers.t_buffer import ClassicEye, EyeBuffer, TBuffer
from glpath.errors import UsageError
from glpath.gl import passes
from glpath.gl.camera import eye_uniforms
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io import load_scene
from glpath.scene.model import Scene
from tests.reference.numpy_ray_tracer import camera_rays, nearest
from tests.support.objects import ball, camera, ground, rotation, scene_of

Seen = tuple[NDArray[np.int32], NDArray[np.float32]]


@pytest.fixture
def gl() -> moderngl.Context:
    return get_context().gl


def see(gl: moderngl.Context, scene: Scene, window: tuple[int, int, int, int] | None = None) -> list[Seen]:
    """What the classical algorithm sees, the T-buffer that draws everything, and the one that splits."""
    objects = DeviceScene(gl, scene)
    size = window[2:] if window else scene.camera.resolution
    buffers: list[EyeBuffer] = [ClassicEye(gl, objects, size)]
    buffers += [TBuffer(gl, objects, size, split_from=least) for least in (10**9, 0)]
    seen = []
    for buffer in buffers:
        buffer.fill(eye_uniforms(scene.camera, window))
        seen.append(buffer.read())
    assert gl.error == "GL_NO_ERROR"
    return seen


def assert_all_equal(seen: list[Seen]) -> None:
    for primitive, t in seen[1:]:
        np.testing.assert_array_equal(primitive, seen[0][0])
        np.testing.assert_array_equal(t, seen[0][1])


def assert_agrees_with_reference(scene: Scene, seen: Seen, share: float = 0.002) -> None:
    """Primitive and t agree but for `share` of the pixels, where rounding moves an edge."""
    numbers = DeviceScene(get_context().gl, scene).numbering
    primitive, t = nearest(scene, *camera_rays(scene))
    to_scene = np.concatenate([numbers.spheres, np.arange(numbers.first_triangle, numbers.count), [-1]])
    ours, ours_t = to_scene[seen[0].ravel()], seen[1].ravel()
    same = ours == primitive
    assert np.mean(~same) <= share
    hit = same & (primitive >= 0)
    # At a grazing angle t is as uncertain as the cosine is small.
    assert np.mean(np.abs(ours_t[hit] / t[hit] - 1) > 1e-5) < 0.01
    np.testing.assert_allclose(ours_t[hit], t[hit], rtol=2e-3)


def soup(seed: int, camera_at: tuple[float, float, float] = (0, 0, 6), fov: float = 50.0) -> Scene:
    """Everything at random: round spheres, ellipsoids, triangles and planes, of all sizes."""
    rng = np.random.default_rng(seed)
    spheres = [ball(rng.uniform(-3, 3, 3), 10 ** rng.uniform(-3, 0.2), rotation(rng)) for _ in range(25)]
    for _ in range(15):
        linear = rotation(rng) @ np.diag(10 ** rng.uniform(-2, 0, 3)) @ rotation(rng)
        if rng.random() < 0.3:
            linear = -linear
        spheres.append(np.concatenate([linear, rng.uniform(-3, 3, (3, 1))], axis=1))
    order = rng.permutation(len(spheres))
    size = 10 ** rng.uniform(-3, 0.5, (60, 1, 1))
    triangles = rng.uniform(-3, 3, (60, 1, 3)) + size * rng.normal(size=(60, 3, 3))
    turned = rotation(rng)
    tilted = np.concatenate([turned, 6 * turned[:, 2:]], axis=1)
    return scene_of(
        spheres=np.array(spheres)[order],
        triangles=triangles,
        planes=[ground(-2.5), tilted],
        view=camera(camera_at, fov=fov),
    )


@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_are_seen_alike(gl: moderngl.Context, seed: int) -> None:
    scene = soup(seed)
    seen = see(gl, scene)
    assert len(np.unique(seen[0][0])) > 20
    assert_all_equal(seen)
    assert_agrees_with_reference(scene, seen[0])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("fov", [2.0, 90.0, 170.0])
def test_from_the_midst_of_everything(gl: moderngl.Context, seed: int, fov: float) -> None:
    """Objects behind the camera, around it, through the plane of the eye."""
    scene = soup(seed, camera_at=(0.3, 0.1, -0.2), fov=fov)
    assert_all_equal(see(gl, scene))


def test_inside_a_sphere(gl: moderngl.Context) -> None:
    scene = scene_of(spheres=[ball((0, 0, 6), 2), ball((0, 0, 5), 0.2)])
    seen = see(gl, scene)
    assert_all_equal(seen)
    assert set(np.unique(seen[0][0])) == {0, 1}
    assert_agrees_with_reference(scene, seen[0])


def test_inside_a_flat_ellipsoid(gl: moderngl.Context) -> None:
    flat = np.concatenate([np.diag([3.0, 0.01, 2.0]), [[0.5], [0.0], [6.0]]], axis=1)
    scene = scene_of(spheres=[flat])
    seen = see(gl, scene)
    assert_all_equal(seen)
    assert np.all(seen[0][0] == 0)
    assert_agrees_with_reference(scene, seen[0])


def on_grid(n: int, depth: float) -> NDArray[np.float64]:
    """(n, 3) places before the standard camera, through centres of pixels of 96 x 64 or between them."""
    rng = np.random.default_rng(7)
    half = np.tan(np.radians(25.0))
    x, y = rng.integers(0, 192, n) / 2 - 48, rng.integers(0, 128, n) / 2 - 32
    return np.stack([x * half * depth / 32, y * half * depth / 32, np.full(n, 6.0 - depth)], axis=1)


@pytest.mark.parametrize("radius", [1e-6, 1e-4, 3e-3, 0.02, 0.2])
def test_small_spheres_about_the_centres_of_pixels(gl: moderngl.Context, radius: float) -> None:
    scene = scene_of(spheres=[ball(place, radius) for place in on_grid(300, 5.0)])
    seen = see(gl, scene)
    assert np.any(seen[0][0] >= 0)
    assert_all_equal(seen)


@pytest.mark.parametrize("size", [1e-4, 0.003, 0.03, 0.3, 30.0])
def test_triangles_with_corners_on_the_centres_of_pixels(gl: moderngl.Context, size: float) -> None:
    rng = np.random.default_rng(3)
    corners = on_grid(150, 5.0)[:, None] + size * rng.uniform(-1, 1, (150, 3, 3)) * [[1], [1], [0]]
    slivers = on_grid(450, 4.0).reshape(150, 3, 3)
    slivers[:, 2] = slivers[:, 0] + (slivers[:, 1] - slivers[:, 0]) * rng.uniform(0, 1, (150, 1))
    seen = see(gl, scene_of(triangles=np.concatenate([corners, slivers])))
    assert np.any(seen[0][0] >= 0)
    assert_all_equal(seen)


def test_triangles_edge_on_are_seen_alike(gl: moderngl.Context) -> None:
    """Their planes hold the eye, nearly; rounding must not make them longer than they are."""
    rng = np.random.default_rng(5)
    eye = np.array([0, 0, 6.0])
    a, b = on_grid(200, 5.0), on_grid(200, 4.0)
    c = (
        eye
        + (a - eye) * rng.uniform(0.5, 2, (200, 1))
        + rng.normal(size=(200, 3)) * 10 ** rng.uniform(-9, -4, (200, 1))
    )
    assert_all_equal(see(gl, scene_of(triangles=np.stack([a, b, c], axis=1))))


def test_a_mesh_has_no_holes(gl: moderngl.Context) -> None:
    """Along the edges that triangles share, every ray meets one of them, also a corner that is a pixel's centre."""
    half = np.tan(np.radians(25.0)) * 8 / 32
    rng = np.random.default_rng(11)
    x, y = np.meshgrid(np.arange(-50, 51, 2) + 0.5, np.arange(-34, 35, 2) + 0.5)
    z = rng.uniform(-1, 1, x.shape) * 0.5
    scale = half * (8 - z) / 8
    points = np.stack([x * scale, y * scale, z - 2], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, b, c], -2).reshape(-1, 3, 3), np.stack([a, c, d], -2).reshape(-1, 3, 3)]
    )
    seen = see(gl, scene_of(triangles=triangles))
    assert_all_equal(seen)
    assert np.all(seen[0][0] >= 0)


def test_the_lowest_number_wins_where_objects_coincide(gl: moderngl.Context) -> None:
    wall = np.array([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], float)
    tiles = on_grid(60, 6.0)[:, None] + 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    spheres = [ball((0, 0, 0), 1.0)] * 3
    for triangles in (np.concatenate([tiles, wall[None]]), np.concatenate([wall[None], tiles, wall[None]])):
        assert_all_equal(see(gl, scene_of(triangles=triangles, spheres=spheres)))
    seen = see(gl, scene_of(triangles=[wall] * 4, spheres=spheres, planes=[np.eye(3, 4)] * 2))
    assert_all_equal(seen)
    assert set(np.unique(seen[0][0])) == {0, 3, 7}


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scenes_of_all_sizes(gl: moderngl.Context, scale: float) -> None:
    scene = soup(2)
    scaled = scene_of(
        spheres=scale * scene.spheres,
        triangles=scale * scene.triangles,
        planes=scene.planes * [1, 1, 1, scale],
        view=camera((0, 0, 6 * scale)),
    )
    seen = see(gl, scaled)
    assert_all_equal(seen)
    assert_agrees_with_reference(scaled, seen[0])


def test_far_and_huge(gl: moderngl.Context) -> None:
    scene = scene_of(
        spheres=[ball((0, -1e5, 0), 1e5 - 1), ball((3e4, 2e4, -1e5), 1e4), ball((0, 0, 0), 0.5)],
        triangles=[[[-1e6, -5, -1e6], [1e6, -5, -1e6], [0, 3e4, -2e5]]],
    )
    seen = see(gl, scene)
    assert_all_equal(seen)
    assert_agrees_with_reference(scene, seen[0], share=0.01)


@pytest.mark.parametrize("split_from", [0, 10**9])
def test_a_window_is_a_part_of_the_picture_bit_for_bit(gl: moderngl.Context, split_from: int) -> None:
    scene = soup(1)
    objects = DeviceScene(gl, scene)
    whole = TBuffer(gl, objects, (96, 64), split_from=split_from)
    whole.fill(eye_uniforms(scene.camera, pixel=(0.3, 0.9)))
    part = TBuffer(gl, objects, (33, 21), split_from=split_from)
    part.fill(eye_uniforms(scene.camera, (17, 29, 33, 21), (0.3, 0.9)))
    for ours, theirs in zip(part.read(), whole.read(), strict=True):
        np.testing.assert_array_equal(ours, theirs[29:50, 17:50])


def test_a_place_in_the_pixel_is_that_place(gl: moderngl.Context) -> None:
    scene = soup(4)
    buffer = ClassicEye(gl, DeviceScene(gl, scene), (96, 64))
    buffer.fill(eye_uniforms(scene.camera, pixel=(0.1, 0.8)))
    primitive, t = nearest(scene, *camera_rays(scene, (0.1, 0.8)))
    ours = buffer.read()
    assert np.mean((ours[0].ravel() >= 0) != (primitive >= 0)) < 0.002
    both = (ours[0].ravel() >= 0) & (primitive >= 0)
    assert np.mean(np.abs(ours[1].ravel()[both] / t[both] - 1) > 1e-4) < 0.003


@pytest.mark.parametrize("split_from", [0, 10**9])
def test_a_buffer_can_be_filled_again(gl: moderngl.Context, split_from: int) -> None:
    scene = soup(3)
    objects = DeviceScene(gl, scene)
    buffer = TBuffer(gl, objects, (96, 64), split_from=split_from)
    seen = []
    for at in ((0, 0, 6), (5, 3, 1), (0.1, 0.2, 0.3), (0, 0, 6)):
        buffer.fill(eye_uniforms(camera(at)))
        seen.append(buffer.read()[0])
    buffer.fill(eye_uniforms(camera((5, 3, 1))))
    buffer.fill(eye_uniforms(camera((0, 0, 6))))
    np.testing.assert_array_equal(buffer.read()[0], seen[0])
    np.testing.assert_array_equal(seen[3], seen[0])
    assert np.mean(seen[1] != seen[0]) > 0.2


@pytest.mark.parametrize("make", [ClassicEye, TBuffer])
def test_nothing_but_planes_and_nothing_at_all(gl: moderngl.Context, make: Callable[..., EyeBuffer]) -> None:
    buffer = make(gl, DeviceScene(gl, scene_of(planes=[ground()])), (96, 64))
    buffer.fill(eye_uniforms(camera()))
    primitive, t = buffer.read()
    assert np.all(primitive[:32] == -1)
    assert np.all(np.isinf(t[:32]))
    assert np.all(primitive[40:] == 0)


def test_intersection_tests_are_counted(gl: moderngl.Context) -> None:
    scene = soup(0)
    objects = DeviceScene(gl, scene)
    classic = ClassicEye(gl, objects, (96, 64), count_tests=True)
    classic.fill(eye_uniforms(scene.camera))
    assert classic.take_tests() == 96 * 64 * objects.count
    assert classic.take_tests() == 0
    counts = []
    for least in (0, 10**9):
        buffer = TBuffer(gl, objects, (96, 64), count_tests=True, split_from=least)
        for _ in range(2):
            buffer.fill(eye_uniforms(scene.camera))
        counts.append(buffer.take_tests())
    hits = 0
    for direction in np.split(camera_rays(scene)[1], 64):
        from tests.reference.numpy_ray_tracer import all_hits

        hits += int(np.isfinite(all_hits(scene, np.tile(scene.camera.position, (96, 1)), direction, 0.0)).sum())
    # Every hit is a test, and the tests are not many more: a rectangle is 4 / pi of its circle.
    for count in counts:
        assert 2 * hits <= count < 2 * 2.0 * hits


def test_a_sphere_is_shot_at_within_its_rectangle_only(gl: moderngl.Context) -> None:
    scene = scene_of(spheres=[ball((0.4, 0.3, 0), 0.8)])
    objects = DeviceScene(gl, scene)
    for least in (0, 10**9):
        buffer = TBuffer(gl, objects, (96, 64), count_tests=True, split_from=least)
        buffer.fill(eye_uniforms(scene.camera))
        rows, columns = np.nonzero(buffer.read()[0] == 0)
        assert buffer.take_tests() == (np.ptp(rows) + 1) * (np.ptp(columns) + 1)


@pytest.mark.parametrize("size", [(200, 3), (5, 90), (1, 1), (131, 67)])
def test_windows_narrower_than_a_square_of_pixels(gl: moderngl.Context, size: tuple[int, int]) -> None:
    """A sphere is drawn as squares; each pixel of its rectangle is in one of them, also at the window's edges."""
    spheres = [ball((0.1, 0, 0), 0.8), ball((0, -0.2, 4.9), 0.9), ball((3, 0.02, 0), 0.3), ball((0, 0, 6), 50)]
    scene = scene_of(spheres=spheres, view=camera(fov=60, resolution=size))
    assert_all_equal(see(gl, scene))
    seen = []
    for least in (0, 10**9):
        buffer = TBuffer(gl, DeviceScene(gl, scene), size, count_tests=True, split_from=least)
        buffer.fill(eye_uniforms(scene.camera))
        seen.append(buffer.take_tests())
    assert seen[0] == seen[1] >= size[0] * size[1]  # the eye is inside the last one


@pytest.mark.parametrize("largest", [1, 8, 9.5])
def test_points_are_as_large_as_the_device_draws(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, largest: float
) -> None:
    monkeypatch.setattr(t_buffer, "largest_point", lambda _: int(largest))
    spheres = [ball((0.1, 0, 0), 0.8), ball((0, -0.2, 4.9), 0.9), ball((3, 0.02, 0), 0.3), ball((0, 0, 6), 50)]
    assert_all_equal(see(gl, scene_of(spheres=spheres, view=camera(fov=60))))


SHOT = "float t = shoot(primitive, aim, pixel);"


@pytest.mark.parametrize(
    "otherwise",
    [
        "t = uintBitsToFloat(floatBitsToUint(t) + 1u);",
        "t = uintBitsToFloat(floatBitsToUint(t) + uint(2 * (pixel.x & 1) - 1));",
        "t = uintBitsToFloat(floatBitsToUint(t) + uint(300 * ((primitive & 2) - 1)));",
        "t = NO_HIT;",
    ],
)
def test_no_pixel_is_lost_where_programs_differ_in_the_last_bits(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, otherwise: str
) -> None:
    """The second look at small primitives is another program, which may round otherwise, or miss at an edge."""
    rng = np.random.default_rng(5)
    triangles = rng.uniform(-3, 3, (400, 1, 3)) + rng.normal(size=(400, 3, 3)) * 0.12
    scene = scene_of(triangles=triangles, spheres=[ball(at, 0.06) for at in rng.uniform(-2, 2, (100, 3))])
    (exact, t), *others = see(gl, scene)
    assert_all_equal([(exact, t), *others])
    shaders = tmp_path / "shaders"
    shutil.copytree(program.shader_folder(), shaders)
    text = (shaders / "t_buffer/t_buffer_small.comp").read_text()
    assert SHOT in text
    changed = text.replace(SHOT, f"{SHOT}\n#ifdef SECOND\n{otherwise}\n#endif\n")
    (shaders / "t_buffer/t_buffer_small.comp").write_text(changed)
    monkeypatch.setattr(program, "shader_folder", lambda: shaders)
    primitive, distance = see(gl, scene)[2]
    np.testing.assert_array_equal(distance, t)
    np.testing.assert_array_equal(primitive >= 0, exact >= 0)
    share = np.mean(primitive[exact >= 0] == exact[exact >= 0])
    # One of those that the ray meets stays where a device finds nothing again.
    assert share == 1.0 if "1u" in otherwise else share > 0.9


def test_the_classical_algorithm_in_many_draws_is_that_in_one(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that none runs into a watchdog; a picture is that of one draw, and no test is made twice."""
    scene = soup(2)
    objects = DeviceScene(gl, scene)
    seen, tests = [], []
    for primitives in (1000, 7, 1):
        monkeypatch.setattr(passes, "TESTS_PER_DRAW", primitives * 96 * 64)
        buffer = ClassicEye(gl, objects, (96, 64), count_tests=True)
        buffer.fill(eye_uniforms(scene.camera))
        seen.append(buffer.read())
        tests.append(buffer.take_tests())
    assert_all_equal(seen)
    assert tests == [96 * 64 * objects.count] * 3


@pytest.mark.parametrize("size", [(0, 0), (-1, -1), (10**9, 10**9), None, ("a", "b"), (2.5, 2)])
@pytest.mark.parametrize("kind", [ClassicEye, TBuffer])
def test_window_that_no_texture_can_hold_is_refused(gl: moderngl.Context, kind: Any, size: Any) -> None:
    with pytest.raises(UsageError, match="size: "):
        kind(gl, DeviceScene(gl, load_scene("cornell-box-36")), size)


@pytest.mark.parametrize("kind", [ClassicEye, TBuffer])
def test_buffer_refuses_what_is_no_scene_and_no_camera(gl: moderngl.Context, kind: Any) -> None:
    with pytest.raises(UsageError, match="objects: None"):
        kind(gl, None, (8, 6))
    with pytest.raises(UsageError, match="camera: None"):
        kind(gl, DeviceScene(gl, load_scene("cornell-box-36")), (8, 6)).fill_from(None)
    with pytest.raises(UsageError, match="scene: 'cornell-box-36'"):
        DeviceScene(gl, "cornell-box-36")  # type: ignore[arg-type]
