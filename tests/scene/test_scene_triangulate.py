"""A scene for the path tracer: spheres become triangles, and what it cannot show is said at once."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.errors import SceneError
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Scene, path_traceable, tessellate

CAMERA = {"position": [0, 0, 9], "target": [0, 0, 0]}
QUAD = {"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}
LAMP = {**QUAD, "name": "lamp", "emission": {"radiance": 3}}


def scene(*shapes: dict, **tables: object) -> Scene:
    return scene_from_dict({"camera": CAMERA, "shapes": list(shapes), **tables})


@pytest.mark.parametrize("name", ["cornell-box", "cornell-box-36", "furnace"])
def test_a_scene_of_triangles_stays_as_it_is(name: str):
    loaded = load_scene(name)
    assert path_traceable(loaded) is loaded


@pytest.mark.parametrize("flip", [False, True])
def test_spheres_take_their_place_among_the_triangles_to_the_last_bit(flip: bool):
    center, radius = np.array([0.1, -2.3, 0.7]), 1.7
    ball = {"type": "sphere", "center": center, "radius": radius, "subdivisions": 2, "flip_normals": flip}
    exact = scene(QUAD, {**ball, "name": "ball"}, LAMP, {**ball, "subdivisions": 0})
    assert len(exact.triangles) == 4
    triangles = path_traceable(exact)
    vertices, faces = tessellate.sphere(center, radius, 2)
    expected = (center + radius * tessellate.unit_sphere(2).vertices)[faces]
    assert np.array_equal(vertices[faces], expected)
    assert np.array_equal(triangles.triangles[2:322], expected[:, ::-1] if flip else expected)
    assert np.array_equal(triangles.triangles[:2], exact.triangles[:2])
    assert np.array_equal(triangles.triangles[322:324], exact.triangles[2:])
    assert [
        (s.name, part.start, s.count, s.primitive)
        for s, part in zip(triangles.shapes, triangles.shapes.ranges, strict=True)
    ] == [
        ("quad-0", 0, 2, "triangle"),
        ("ball", 2, 320, "triangle"),
        ("lamp", 322, 2, "triangle"),
        ("sphere-3", 324, 20, "triangle"),
    ]
    assert triangles.shapes[2].emission.tolist() == [3, 3, 3]
    assert triangles.triangle_uv.shape == (344, 3, 2)
    assert len(triangles.spheres) == 0
    assert path_traceable(triangles) is triangles


def test_the_furnace_of_a_sphere_is_the_ball_turned_inside_out():
    room = path_traceable(load_scene("furnace", {"shape": "sphere", "subdivisions": 3}))
    vertices, faces = tessellate.sphere((0, 0, 0), 1.0, 3)
    assert np.array_equal(room.triangles, vertices[faces][:, ::-1])


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("flip", [False, True])
def test_the_triangles_of_an_ellipsoid_lie_on_it_and_face_as_it_does(mirror: int, flip: bool):
    steps = [{"scale": [mirror, 2, 3]}, {"rotate": {"axis": [1, 2, 3], "angle": 40}}, {"translate": [5, 6, 7]}]
    exact = scene({"type": "sphere", "radius": 0.5, "transform": steps, "flip_normals": flip})
    (matrix,) = exact.spheres
    assert (np.linalg.det(matrix[:, :3]) < 0) == flip
    corners = path_traceable(exact).triangles - [5, 6, 7]
    unit = corners @ np.linalg.inv(matrix[:, :3]).T
    assert np.allclose(np.linalg.norm(unit, axis=2), 1)
    volume = np.sum(np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]) / 6
    expected = 4 / 3 * np.pi * 0.5**3 * 6
    assert volume == pytest.approx(-expected if flip else expected, rel=0.003)


def test_planes_are_refused_by_name_with_a_remedy():
    grounds = [{"type": "plane", "normal": [0, 1, 0], "name": name} for name in "abcd"]
    with pytest.raises(SceneError, match=r"has planes \(a, b, c, \.\.\.\), which") as error:
        path_traceable(scene(*grounds))
    assert "large quads" in error.value.remedy


def test_textures_and_highlights_stay():
    textured = {"m": {"type": "phong", "texture": "t"}}
    loaded = scene({**QUAD, "material": "m"}, materials=textured, textures={"t": {"type": "checker"}})
    assert path_traceable(loaded) is loaded


@pytest.mark.parametrize("flip", [False, True])
def test_a_textured_sphere_has_the_texture_coordinates_of_the_exact_one(flip: bool):
    ball = {"type": "sphere", "radius": 2.0, "material": "m", "subdivisions": 3, "flip_normals": flip}
    exact = scene(ball, materials={"m": {"texture": "t"}}, textures={"t": {"type": "checker"}})
    triangles = path_traceable(exact)
    unit = triangles.triangles @ np.linalg.inv(exact.spheres[0, :, :3]).T
    uv = triangles.triangle_uv
    assert np.ptp(uv[..., 0], axis=1).max() < 0.51  # no triangle spans the seam
    away = np.hypot(unit[..., 0], unit[..., 1]) > 1e-6
    u = np.arctan2(unit[..., 1], unit[..., 0]) / (2 * np.pi)
    assert np.abs((uv[..., 0] - u + 0.5) % 1.0 - 0.5)[away].max() < 1e-9
    assert np.abs(uv[..., 1] - 0.5 - np.arcsin(np.clip(unit[..., 2], -1, 1)) / np.pi).max() < 1e-9


def test_every_kind_of_light_stays():
    lights = [{"type": "point", "position": [0, 0, 1], "intensity": 1}]
    loaded = scene(QUAD, lights=lights, ambient=0.1, sky={"zenith": 1})
    assert path_traceable(loaded) is loaded


def test_materials_that_no_shape_has_do_not_matter():
    loaded = scene(QUAD, materials={"m": {"type": "phong", "mirror": 0.5}})
    assert path_traceable(loaded) is loaded


def test_too_many_triangles_are_refused_before_they_are_made():
    balls = [{"type": "sphere", "radius": 1.0, "subdivisions": 8}] * 103
    with pytest.raises(SceneError, match=r"103 spheres would be 135,004,160 triangles.* at most 134,217,728"):
        path_traceable(scene(*balls))
