"""Rays and projection of every kind of camera, against similar triangles and angles, and when they look."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from glpath.errors import SceneError, UsageError
from glpath.io import load_scene
from glpath.sampling.points import PathSetSampler
from glpath.scene import Camera, check_camera
from glpath.scene.camera import CameraKey, Projection, framed

RNG = np.random.default_rng(8)


@pytest.fixture(params=[(40, 30), (7, 64)])
def camera(request: pytest.FixtureRequest) -> Camera:
    position, target = RNG.normal(size=(2, 3))
    return Camera(position, target, np.array([0.1, 1.0, 0.2]), 50.0, request.param)


def test_a_right_angle_is_as_high_as_twice_its_distance():
    square = Camera(np.zeros(3), np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), 90.0, (100, 100))
    assert square.focal == pytest.approx(50)
    assert square.extent == pytest.approx((1, 1))
    corners = [[0, 0], [100, 0], [100, 100], [0, 100], [50, 50]]
    expected = np.array([[-1, 1, -1], [1, 1, -1], [1, -1, -1], [-1, -1, -1], [0, 0, -1]], float)
    assert np.allclose(square.rays(corners), expected / np.linalg.norm(expected, axis=1, keepdims=True))
    at, depth = square.project([[3.0, 6.0, -12.0]])
    assert depth.tolist() == [12]
    assert at[0].tolist() == pytest.approx([50 + 50 * 3 / 12, 50 - 50 * 6 / 12])


def test_a_ray_projects_to_where_it_came_from(camera: Camera):
    at = RNG.uniform(-0.5, 1.5, (200, 2)) * camera.resolution
    rays = camera.rays(at)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    found, depth = camera.project(camera.position + RNG.uniform(0.1, 9, (200, 1)) * rays)
    assert (depth > 0).all()
    assert np.allclose(found, at)


def test_the_field_of_view_is_vertical_and_of_the_whole_image(camera: Camera):
    width, height = camera.resolution
    top, bottom = camera.rays([[width / 2, 0], [width / 2, height]])
    assert np.degrees(np.arccos(top @ bottom)) == pytest.approx(camera.fov)
    forward = (camera.target - camera.position) / np.linalg.norm(camera.target - camera.position)
    assert np.allclose(camera.rays([width / 2, height / 2]), forward)
    assert top @ camera.up > bottom @ camera.up


def test_rays_of_all_pixels_go_through_their_centres_from_the_top(camera: Camera):
    width, height = camera.resolution
    rays = camera.rays()
    assert rays.shape == (height, width, 3)
    at, _ = camera.project(camera.position + rays)
    assert np.allclose(at, camera.pixel_centres())
    assert np.allclose(at[0, 0], 0.5)
    assert np.allclose(at[-1, -1], [width - 0.5, height - 0.5])


def test_the_corner_rays_go_through_the_corners_of_the_image(camera: Camera):
    width, height = camera.resolution
    at, depth = camera.project(camera.position + camera.corner_rays())
    assert np.allclose(depth, 1)
    assert np.allclose(at, [[0, height], [width, height], [width, 0], [0, 0]])


def test_what_is_behind_the_eye_has_no_positive_depth(camera: Camera):
    assert (camera.project(camera.position - camera.rays())[1] < 0).all()


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 2.0), (1.0, 1.0, 0.0)])
def test_a_turned_camera_goes_around_its_target_at_its_height_and_distance(up: tuple[float, float, float]) -> None:
    camera = Camera(np.array([3.0, 1.0, 2.0]), np.array([0.5, 0.0, -1.0]), np.array(up), 40.0, (8, 6))
    axis = camera.up / np.linalg.norm(camera.up)
    around = camera
    for _ in range(8):
        around = around.turned(45.0)
        for measure in (np.linalg.norm, lambda arm: arm @ axis):
            assert measure(around.position - around.target) == pytest.approx(
                measure(camera.position - camera.target)
            )
    assert around.position == pytest.approx(camera.position)
    quarter = Camera(np.array([1.0, 0.5, 0.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0, (8, 6)).turned(90.0)
    assert quarter.position == pytest.approx([0.0, 0.5, -1.0]), "counter-clockwise seen from above"


def test_a_moving_camera_is_turned_from_where_it_is_when_the_shutter_opens() -> None:
    up, target = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    keys = tuple(CameraKey(t, np.array([1.0, 0.0, z]), target, up) for t, z in ((0.0, 8.0), (1.0, 10.0)))
    moving = Camera(np.array([0.0, 3.0, 4.0]), np.zeros(3), up, 40.0, (8, 6), shutter=(0.5, 2.0), motion=keys)
    still = Camera(np.array([1.0, 0.0, 9.0]), target, up, 40.0, (8, 6), shutter=(0.5, 2.0))
    for here, there in zip(moving.turntable(3), still.turntable(3), strict=True):
        assert (here.position.tolist(), here.target.tolist()) == (there.position.tolist(), there.target.tolist())
        assert (here.shutter, here.motion) == ((0.5, 2.0), ())


@pytest.mark.parametrize("resolution", [(40, 30), (7, 64)])
@pytest.mark.parametrize("projection", ["orthographic", "panorama"])
def test_every_projection_projects_to_where_a_ray_came_from(
    projection: Projection, resolution: tuple[int, int]
) -> None:
    position, target = RNG.normal(size=(2, 3))
    camera = Camera(position, target, np.array([0.1, 1.0, 0.2]), 50.0, resolution, projection, height=3.0)
    at = RNG.uniform(0, 1, (200, 2)) * resolution
    rays = camera.rays(at)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    found, depth = camera.project(camera.origins(at) + RNG.uniform(0.1, 9, (200, 1)) * rays)
    assert (depth > 0).all()
    assert np.allclose(found, at)
    assert camera.rays().shape == camera.origins().shape == (resolution[1], resolution[0], 3)


def test_parallel_rays_see_as_high_as_the_image_wherever_it_is() -> None:
    camera = Camera(np.zeros(3), np.array([0, 0, -2.0]), np.array([0, 1.0, 0]), 40.0, (20, 10), "orthographic", 3.0)
    assert camera.extent == pytest.approx((3.0, 1.5))
    for depth in (0.5, 40.0):
        at, found = camera.project([[3.0, 1.5, -depth], [-3.0, -1.5, -depth]])
        assert np.allclose(at, [[20, 0], [0, 10]])
        assert np.allclose(found, depth)


def test_a_panorama_has_its_target_in_the_middle_and_up_at_the_top() -> None:
    camera = Camera(np.zeros(3), np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), 40.0, (360, 180), "panorama")
    at, _ = camera.project([[0, 0, -2], [2, 0, 0], [0, 0, 2], [-2, 0, 0], [1, 2**0.5, -1]])
    assert np.allclose(at, [[180, 90], [270, 90], [360, 90], [90, 90], [225, 45]])
    assert np.allclose(camera.rays([[77, 0], [77, 180]]), [[0, 1, 0], [0, -1, 0]])


def test_keys_are_met_and_between_them_it_goes_straight() -> None:
    up, target = np.array([0.0, 1.0, 0.0]), np.zeros(3)
    keys = tuple(CameraKey(t, np.array([x, 0.0, 3.0]), target, up) for t, x in ((1.0, 0.0), (2.0, 4.0)))
    camera = Camera(np.ones(3), target, up, 40.0, (4, 4), shutter=(1.0, 2.0), motion=keys)
    assert camera.moves
    for time, x in ((0.0, 0.0), (1.0, 0.0), (1.25, 1.0), (2.0, 4.0), (9.0, 4.0)):
        still = camera.at(time)
        assert not still.moves
        assert np.allclose(still.position, [x, 0, 3])
    assert np.allclose(camera.at().position, [0, 0, 3])
    for shutter in ((0.0, 1.0), (2.0, 3.0), (1.5, 1.5)):
        assert not replace(camera, shutter=shutter).moves


def test_any_power_of_two_path_sets_are_even_over_lens_and_time() -> None:
    sampler = PathSetSampler(3, 3)
    for first, count in ((0, 16), (64, 64), (512, 256)):
        u = np.array([sampler.eye(i) for i in range(first, first + count)])
        assert sorted(np.floor(u[:, 2] * count)) == list(range(count))  # time: one in each part
        side = int(np.sqrt(count))
        cells = np.floor(u[:, :2] * side) @ [side, 1]
        assert len(np.unique(cells)) == count  # lens: one in each square
    # Nothing in common with what else a set draws: the correlation of all pairs is noise.
    others = np.array(
        [np.concatenate([(s := sampler[i]).pixel, s.light, s.directions.ravel()[:8]]) for i in range(512)]
    )
    own = np.array([sampler.eye(i) for i in range(512)])
    both = np.corrcoef(np.concatenate([own, others], axis=1).T)[:3, 3:]
    assert np.abs(both).max() < 4.5 / np.sqrt(512)


def test_what_a_camera_cannot_be_is_said() -> None:
    for changes, told in (
        ({"aperture_radius": -1.0}, "aperture_radius is -1, but must be 0 or more"),
        ({"focus_distance": 0.0}, "focus_distance is 0, but must be above 0"),
        ({"projection": "orthographic", "height": 0.0}, "height is 0, but must be above 0"),
        ({"projection": "panorama", "aperture_radius": 0.1}, "a camera of type panorama has no lens"),
        ({"shutter": (1.0, 0.0)}, "shutter is [1, 0], but must be two finite numbers, the first at most"),
        ({"projection": "fisheye"}, 'type is "fisheye", but must be one of'),
    ):
        camera = replace(Camera(np.zeros(3), np.ones(3), np.array([0, 1.0, 0]), 40.0, (4, 4)), **changes)
        with pytest.raises(SceneError) as error:
            check_camera(camera, "room")
        assert told in error.value.message
    keys = [CameraKey(t, np.zeros(3), np.ones(3), np.array([0, 1.0, 0])) for t in (1.0, 1.0)]
    camera = Camera(np.zeros(3), np.ones(3), np.array([0, 1.0, 0]), 40.0, (4, 4), motion=tuple(keys))
    with pytest.raises(SceneError, match=r"motion\[1\].time is 1, but must be above 1"):
        check_camera(camera, "room")
    keys[1] = replace(keys[1], time=2.0, target=np.zeros(3))
    with pytest.raises(SceneError, match=r"motion\[1\].target is the same point"):
        check_camera(replace(camera, motion=tuple(keys)), "room")


@pytest.mark.parametrize(
    ("first", "last", "up", "time"),
    [
        ((-4, 4, 0), (4, 4, 0), (0, 1, 0), 2.0),
        ((-1, 2, 1), (3, 4, -3), (0, 1, 0), 1.5),
        ((1, 1, 3), (1, 1, -7), (0, 1, 0), None),
        ((0, 0, 3), (0, 0, -7), (0, 1, 0), 1.6),
        ((1e-3, 0, 3), (1e-3, 0, -7), (0, 1, 0), None),
        ((-4, 4, 1e-3), (4, 4, 1e-3), (0, 1, 0), None),
    ],
    ids=["over", "aside", "past", "through", "beside", "nearly"],
)
def test_a_camera_that_has_no_view_between_two_keys_is_refused(
    first: tuple[float, ...], last: tuple[float, ...], up: tuple[float, ...], time: float | None
) -> None:
    """The way from 1 s to 3 s meets the axis `up` through the target at `time`: intercept theorem."""
    poses = ((0.0, first), (1.0, first), (3.0, last))
    for turn in (np.eye(3), np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]):
        keys = tuple(CameraKey(t, turn @ each, np.zeros(3), turn @ up) for t, each in poses)
        camera = Camera(keys[0].position, np.zeros(3), turn @ up, 40.0, (8, 6), shutter=(0, 3), motion=keys)
        if time is None:
            check_camera(camera, "room")
            continue
        message = rf"camera\.motion\[2\] is reached from camera\.motion\[1\] .* at time {time} "
        with pytest.raises(SceneError, match=message.replace(".0 ", " ")):
            check_camera(camera, "room")


@pytest.mark.parametrize(
    ("shutter", "has_view"),
    [
        ((0.0, 1.0), True),
        ((1.0, 1.59), True),
        ((1.5, 1.7), False),
        ((1.6, 1.6), False),
        ((1.61, 3.0), True),
        ((0.0, 9.0), False),
    ],
)
def test_motion_without_a_view_is_refused_only_while_the_shutter_is_open(
    shutter: tuple[float, float], has_view: bool
) -> None:
    """From 1 s to 3 s the camera flies from 3 before its target to 7 behind it, through the target at 1.6 s."""
    up = np.array([0.0, 1.0, 0.0])
    keys = tuple(CameraKey(t, np.array([0, 0, z]), np.zeros(3), up) for t, z in ((1.0, 3.0), (3.0, -7.0)))
    scene = load_scene("furnace").with_camera(Camera(keys[0].position, np.zeros(3), up, 40.0, (8, 6), motion=keys))
    with nullcontext() if has_view else pytest.raises(SceneError, match=r"at time 1\.6 "):
        scene.with_camera(shutter=shutter)


def test_an_up_vector_that_turns_into_the_view_is_refused() -> None:
    """Half way from x to -x + 2 z, up is z, along the view."""
    for last, is_lost in (((-1.0, 0.0, 2.0), True), ((0.0, 1.0, 2.0), False), ((-1.0, 0.2, 2.0), False)):
        ups = np.array([[1.0, 0.0, 0.0], last])
        keys = tuple(CameraKey(float(t), np.zeros(3), np.array([0, 0, 5.0]), up) for t, up in enumerate(ups))
        camera = Camera(np.zeros(3), np.array([0, 0, 5.0]), ups[0], 40.0, (8, 6), shutter=(0, 1), motion=keys)
        with np.errstate(invalid="ignore"):
            assert np.isnan(camera.at(0.5).frame()[0]).all() == is_lost
        with pytest.raises(SceneError, match=r"at time 0\.5 ") if is_lost else nullcontext():
            check_camera(camera, "room")


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_framed_points_fill_the_picture_of_a_camera_that_does_not_turn(camera: Camera, projection: Projection):
    before = replace(camera, projection=projection, height=3.0)
    points = RNG.normal(size=(50, 3)) * [2.0, 0.5, 1.0] + [30.0, -4.0, 9.0]
    after = framed(before, points)
    assert np.allclose(after.frame(), before.frame())
    at, depth = after.project(points)
    assert (depth > 0).all()
    share = (at.max(axis=0) - at.min(axis=0)) / after.resolution
    assert 0.75 < share.max() < 1.0
    assert (at > 0).all()
    assert (at < after.resolution).all()


POSE: dict[str, Any] = {
    "position": [0, 0, 3],
    "target": [0, 0, 0],
    "up": [0, 1, 0],
    "fov": 40,
    "resolution": (4, 4),
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("position", "x"),
        ("position", [10**400] * 3),
        ("position", [1, 2]),
        ("target", None),
        ("up", 5),
        ("fov", "x"),
        ("fov", None),
        ("resolution", None),
        ("resolution", 5),
        ("resolution", (4, 4, 4)),
        ("shutter", 1),
        ("motion", None),
        ("motion", [1]),
        ("projection", 5),
        ("pixel_aspect", "x"),
        ("principal_point", (1,)),
    ],
)
def test_a_camera_refuses_fields_of_other_types(name: str, value: Any) -> None:
    with pytest.raises(UsageError, match=rf"^{name}: "):
        Camera(**POSE | {name: value})


@pytest.mark.parametrize(
    ("method", "value"),
    [
        ("turntable", 10**400),
        ("turntable", 10**6),
        ("turntable", -1),
        ("turntable", "x"),
        ("turned", "x"),
        ("turned", math.inf),
        ("project", "x"),
        ("project", [1, 2]),
        ("rays", [1, 2, 3]),
        ("origins", "x"),
        ("at", "x"),
    ],
)
def test_a_camera_refuses_wrong_arguments(method: str, value: Any) -> None:
    with pytest.raises(UsageError):
        getattr(Camera(**POSE), method)(value)
