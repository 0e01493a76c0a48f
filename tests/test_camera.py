"""The pinhole: rays and projection against what a camera obscura does, by similar triangles."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.scene import Camera

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
