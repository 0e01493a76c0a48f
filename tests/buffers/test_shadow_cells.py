"""Every direction has its own cell of a light's shadow-buffer, and every object is looked for where it is seen."""

from __future__ import annotations

import shutil
from pathlib import Path

import moderngl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import glpath.gl.program as program
from glpath.buffers import light_bounds
from glpath.buffers.cube_bounds import (
    cube_rectangles_of_caps,
    cube_rectangles_of_planes,
    cube_rectangles_of_triangles,
)
from glpath.buffers.light_bounds import CellRectangles, sphere_caps, spheres_around
from glpath.buffers.sphere_bounds import (
    sphere_rectangles_of_caps,
    sphere_rectangles_of_planes,
    sphere_rectangles_of_triangles,
)
from glpath.gl.context import get_context
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from tests.reference.shadow_cells import (
    cube_cell,
    cube_directions,
    sphere_cell,
    sphere_direction,
    sphere_directions,
)

Float64 = NDArray[np.float64]


def on_device(columns: int, rows: int, face: int, **defines: object) -> tuple[Float64, Float64]:
    """What the shader says: (rows, columns, 4) column, row, face and distance; (rows, columns, 3) direction."""
    gl = get_context().gl
    textures = [gl.texture((columns, rows), 4, dtype="f4") for _ in range(2)]
    drawn = load_program(
        gl, vertex="gl/fullscreen.vert", fragment="shadow/point_shadow_cells.frag", defines=defines
    )
    stage = Pass("cells", gl, drawn, gl.framebuffer(textures))
    stage.run({"shadow_cells": (float(columns), float(rows)), "face": face})
    found, direction = (np.frombuffer(t.read(), np.float32).reshape(rows, columns, 4) for t in textures)
    assert get_context().gl.error == "GL_NO_ERROR"
    return found.astype(float), direction[..., :3].astype(float)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 4), (5, 7), (200, 400), (333, 101), (1000, 2000)])
def test_every_direction_of_the_sphere_maps_to_its_own_cell_and_back(rows: int, columns: int) -> None:
    found, direction = on_device(columns, rows, 0)
    c, r = np.meshgrid(np.arange(columns), np.arange(rows))
    np.testing.assert_array_equal(found[..., 0], c)
    np.testing.assert_array_equal(found[..., 1], r)
    assert found[..., 3].max() < 2e-3
    # Far within what the objects' bounds are grown by.
    if rows * columns < 1e5:
        np.testing.assert_allclose(direction, sphere_directions(rows, columns), atol=0.1 * light_bounds.MARGIN)


@pytest.mark.parametrize("side", [1, 2, 7, 200, 1001])
def test_every_direction_of_the_cube_maps_to_its_own_cell_and_back(side: int) -> None:
    for face in range(6):
        found, direction = on_device(side, side, face, SHADOW_CUBE=1)
        c, r = np.meshgrid(np.arange(side), np.arange(side))
        np.testing.assert_array_equal(found[..., 0], c)
        np.testing.assert_array_equal(found[..., 1], r)
        np.testing.assert_array_equal(found[..., 2], face)
        assert found[..., 3].max() < 1e-3
        if side <= 7:
            np.testing.assert_allclose(direction, cube_directions(side)[face], atol=0.1 * light_bounds.MARGIN)


def test_angles_are_as_accurate_as_they_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Vulkan would allow 5e-4 for sin, cos and atan, which many an OpenGL stands on."""
    shaders = tmp_path / "shaders"
    shutil.copytree(program.shader_folder(), shaders)
    (shaders / "a.frag").write_text("""
        #include "sampling/angles.glsl"
        layout(location = 0) out vec4 o;
        void main()
        {
            float x = (gl_FragCoord.x - 1024.5) / 256.0 + gl_FragCoord.y / 65536.0;
            o = vec4(cosine_sine(x), arc_tangent(1.25 * sign(x) - x, x), arc_tangent(clamp(x, -1.0, 1.0)));
        }
    """)
    monkeypatch.setattr(program, "shader_folder", lambda: shaders)
    gl = get_context().gl
    texture = gl.texture((2048, 16), 4, dtype="f4")
    drawn = load_program(gl, vertex="gl/fullscreen.vert", fragment="a.frag")
    Pass("angles", gl, drawn, gl.framebuffer([texture])).run({})
    found = np.frombuffer(texture.read(), np.float32).reshape(16, 2048, 4).astype(float)
    x = (np.arange(2048) - 1024) / 256 + (np.arange(16)[:, None] + 0.5) / 65536
    y = (1.25 * np.sign(x) - x).astype(np.float32).astype(float)
    truth = [np.cos(x * np.pi / 2), np.sin(x * np.pi / 2), np.arctan2(y, x), np.arctan(np.clip(x, -1, 1))]
    np.testing.assert_allclose(found[..., :2], np.stack(truth[:2], axis=-1), rtol=0, atol=3e-7)
    np.testing.assert_allclose(found[..., 2:], np.stack(truth[2:], axis=-1), rtol=3e-7, atol=0)


def test_the_slow_reference_maps_back_too() -> None:
    for rows, columns in ((4, 8), (5, 7)):
        for r, row in enumerate(sphere_directions(rows, columns)):
            for c, d in enumerate(row):
                assert sphere_cell(d, rows, columns) == (r, c)
        assert sphere_cell(np.array([0.0, 0.0, 1.0]), rows, columns)[0] == rows - 1
        assert sphere_cell(np.array([0.0, 0.0, -1.0]), rows, columns)[0] == 0
    # The paper's arccos would find y and -y in one cell.
    assert sphere_cell(np.array([1.0, 1.0, 0.0]), 4, 8) != sphere_cell(np.array([1.0, -1.0, 0.0]), 4, 8)
    # Its (4) as printed addresses the upper half alone: the lowest of its latitudes is 0.
    assert sphere_direction(0, 0, 4, 8)[2] < -0.9
    for side in (3, 4):
        for face, plane in enumerate(cube_directions(side)):
            for r, row in enumerate(plane):
                for c, d in enumerate(row):
                    assert cube_cell(d, side) == (face, r, c)


# Where rays can meet an object.


def filled(rectangles: CellRectangles, shape: tuple[int, int, int], count: int) -> NDArray[np.int64]:
    """(count, faces, rows, columns): how often a cell is tested against a primitive."""
    out = np.zeros((count, *shape), np.int64)
    for primitive, face, (x0, y0), (x1, y1) in zip(*rectangles, strict=True):
        assert 0 <= x0 <= x1 < shape[2]
        assert 0 <= y0 <= y1 < shape[1]
        out[primitive, face, y0 : y1 + 1, x0 : x1 + 1] += 1
    assert out.sum() == rectangles.cells
    return out


def meets_triangle(triangle: Float64, light: Float64, d: Float64) -> NDArray[np.bool_]:
    a, b, c = triangle - light
    with np.errstate(all="ignore"):
        x = d @ np.linalg.inv(np.stack([a, b, c]))
    return np.asarray(np.all(x >= 0, axis=-1) & (x.sum(axis=-1) > 0))


def meets_ellipsoid(world_from_unit: Float64, light: Float64, d: Float64) -> NDArray[np.bool_]:
    inverse = np.linalg.inv(world_from_unit[:, :3])
    o = inverse @ (light - world_from_unit[:, 3])
    w = d @ inverse.T
    b, a, c = w @ o, np.einsum("...i,...i", w, w), o @ o - 1.0
    return np.asarray((b * b - a * c >= 0) & ((c <= 0) | (b < 0)))


def rays(shape: str, size: int) -> Float64:
    """(faces, rows, columns, 3)"""
    return sphere_directions(size, 2 * size)[None] if shape == "sphere" else cube_directions(size)


def rectangles(
    shape: str, size: int, light: Float64, triangles: Float64, spheres: Float64, planes: Float64
) -> tuple[CellRectangles, CellRectangles, CellRectangles]:
    """Of the triangles, the spheres and the planes."""
    caps = sphere_caps(spheres_around(spheres), light)
    if shape == "sphere":
        return (
            sphere_rectangles_of_triangles(triangles, light, size, 2 * size),
            sphere_rectangles_of_caps(caps, size, 2 * size),
            sphere_rectangles_of_planes(planes, light, size, 2 * size),
        )
    return (
        cube_rectangles_of_triangles(triangles, light, size),
        cube_rectangles_of_caps(caps, size),
        cube_rectangles_of_planes(planes, light, size),
    )


@pytest.mark.parametrize("shape", ["sphere", "cube"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_no_ray_that_meets_an_object_is_left_out(shape: str, seed: int) -> None:
    """Objects of all sizes: far, near, around the light, across the seam and the poles, slivers."""
    rng = np.random.default_rng(seed)
    size, count = (19, 12) if shape == "cube" else (34, 12)
    d = rays(shape, size)
    light = rng.normal(size=3) * 0.3
    size_of = rng.exponential(0.7, (count, 1, 1)) + 0.01
    triangles = rng.normal(size=(count, 1, 3)) + rng.normal(size=(count, 3, 3)) * size_of
    triangles[0] = triangles[0, 0] + np.outer([0.0, 1.0, 1.01], rng.normal(size=3))
    triangles[0, 2] += 0.01 * rng.normal(size=3)
    spheres = np.concatenate([rng.normal(size=(count, 3, 3)) * 0.3, rng.normal(size=(count, 3, 1)) * 1.5], axis=2)
    spheres[1::2, :, :3] = np.eye(3) * rng.exponential(0.5, (count // 2, 1, 1))
    planes = rng.normal(size=(count, 3, 4))
    planes[:3, :, 2] = np.eye(3)
    # Half of the time, even small rectangles are cut into bands.
    with pytest.MonkeyPatch.context() as patch:
        if seed % 2:
            patch.setattr(light_bounds, "_LARGE", 8)
            patch.setattr(light_bounds, "_BAND_CELLS", 4)
        of_triangles, of_spheres, of_planes = rectangles(shape, size, light, triangles, spheres, planes)
    faces = d.shape[:3]
    for i, tests in enumerate(filled(of_triangles, faces, count)):
        met = meets_triangle(triangles[i], light, d)
        assert np.all(tests[met] == 1), f"triangle {i}: {np.argwhere(met & (tests != 1))}"
        assert tests.max() <= 1
    for i, tests in enumerate(filled(of_spheres, faces, count)):
        met = meets_ellipsoid(spheres[i], light, d)
        assert np.all(tests[met] == 1), f"sphere {i}: {np.argwhere(met & (tests != 1))}"
    for i, tests in enumerate(filled(of_planes, faces, count)):
        height = planes[i, :, 2] @ (light - planes[i, :, 3])
        met = d @ planes[i, :, 2] * height < 0
        assert np.all(tests[met] == 1), f"plane {i}: {np.argwhere(met & (tests != 1))}"
        assert tests.sum() <= met.sum() + 4 * size, "a plane's rays are known exactly, but for those along it"


@pytest.mark.parametrize("shape", ["sphere", "cube"])
def test_few_rays_are_shot_in_vain(shape: str) -> None:
    """A disc fills pi / 4 of its rectangle, a triangle half or less; large ones are cut to their shape."""
    rng = np.random.default_rng(7)
    light = np.zeros(3)
    for size, radius, discs, thirds in ((64, 0.2, 1.9, 4.0), (150, 0.8, 1.2, 2.5)):
        d = rays(shape, size)
        n = 40
        way = rng.normal(size=(n, 3))
        spheres = np.zeros((n, 3, 4))
        spheres[:, :, :3] = radius * np.eye(3)
        spheres[:, :, 3] = 2.0 * way / np.linalg.norm(way, axis=1, keepdims=True)
        corners = spheres[:, None, :, 3] + radius * rng.normal(size=(n, 3, 3))
        of_triangles, of_spheres, _ = rectangles(shape, size, light, corners, spheres, np.zeros((0, 3, 4)))
        met = sum(int(meets_ellipsoid(s, light, d).sum()) for s in spheres)
        assert met <= of_spheres.cells <= discs * met
        met = sum(int(meets_triangle(t, light, d).sum()) for t in corners)
        assert met <= of_triangles.cells <= thirds * met


def test_a_light_inside_an_object_sees_it_everywhere() -> None:
    sphere = np.concatenate([2.0 * np.eye(3), np.array([[0.3], [0.0], [0.0]])], axis=1)[None]
    light = np.zeros(3)
    assert sphere_rectangles_of_caps(sphere_caps(spheres_around(sphere), light), 8, 16).cells == 8 * 16
    assert cube_rectangles_of_caps(sphere_caps(spheres_around(sphere), light), 8).cells == 6 * 64


def test_no_objects_no_rays() -> None:
    none = np.zeros((0, 3, 4))
    light = np.zeros(3)
    assert sphere_rectangles_of_caps(sphere_caps(spheres_around(none), light), 8, 16).cells == 0
    assert cube_rectangles_of_caps(sphere_caps(spheres_around(none), light), 8).cells == 0
    assert sphere_rectangles_of_planes(none, light, 8, 16).cells == 0
    assert cube_rectangles_of_planes(none, light, 8).cells == 0
    assert sphere_rectangles_of_triangles(np.zeros((0, 3, 3)), light, 8, 16).cells == 0
    assert cube_rectangles_of_triangles(np.zeros((0, 3, 3)), light, 8).cells == 0
    assert isinstance(get_context().gl, moderngl.Context)
