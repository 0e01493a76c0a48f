"""The path-buffer is a ray caster: every ray gets what a slow, obvious one says."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import glpath.buffers.path_buffer as path_buffer
from glpath.buffers.path_buffer import PathBuffer
from glpath.errors import ContextError, UsageError
from glpath.gl import program as program_module
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass
from glpath.io import load_scene
from glpath.scene.model import Camera, Material, Mesh, Scene, Shape, Shapes
from tests.reference.numpy_path_tracer import nearest_hits

Float64 = NDArray[np.float64]


def scene_of(triangles: Float64) -> Scene:
    camera = Camera(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 40.0, (8, 8))
    material = Material("grey", np.full(3, 0.5))
    return Scene("soup", camera, Shapes((Shape("soup", Mesh.of_triangles(triangles), 0),)), (material,))


def buffer_for(scene: Scene, cells: tuple[int, int], paths: tuple[int, int] = (128, 32)) -> PathBuffer:
    gl = get_context().gl
    return PathBuffer(gl, DeviceScene(gl, scene), paths, cells)


@pytest.fixture(params=["packed", "in two scans"])
def encoding(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Few triangles share a float with their depth; many need a scan for each. Both ways must say the same."""
    if request.param != "packed":
        monkeypatch.setattr(path_buffer, "MAX_PACKED_BITS", 0)
    return str(request.param)


@pytest.fixture(params=["drawn", "small in compute"])
def split(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Small triangles are taken by a compute shader, or the rasteriser takes all. Both ways must say the same."""
    monkeypatch.setattr(path_buffer, "SPLIT_CELLS", 0 if request.param == "drawn" else 10**9)
    return str(request.param)


def on_surfaces(scene: Scene, n: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], Float64]:
    triangle = rng.integers(0, len(scene.triangles), n)
    corners = scene.triangles[triangle]
    root, v = np.sqrt(rng.random((n, 1))), rng.random((n, 1))
    points = (1 - root) * corners[:, 0] + root * ((1 - v) * corners[:, 1] + v * corners[:, 2])
    # As the device has them: the question is what the ray meets, not how its start is rounded.
    return triangle, points.astype(np.float32).astype(np.float64)


def assert_same_hits(
    scene: Scene, buffer: PathBuffer, origins: Float64, d: Float64, way: Float64, share: float = 1e-3
) -> None:
    """Same distance for all but a share of rays, which pass an edge or start at one within rounding."""
    low, high = scene.bounds
    size = float(np.linalg.norm(high - low))
    hits = buffer.cast(origins, d, way)
    index, t = nearest_hits(scene.triangles, origins, d / np.linalg.norm(d) * way[:, None], t_min=1e-4 * size)
    with np.errstate(invalid="ignore"):
        same = np.abs(hits.t - t) <= 1e-4 * size
    same |= (hits.triangle < 0) & (index < 0)
    assert np.mean(~same) <= share, f"{np.sum(~same)} of {len(same)} rays differ along {d}"


@pytest.mark.parametrize("cells", [(96, 96), (7, 3), (1, 1)])
@pytest.mark.parametrize("name", ["cornell-box-36", "cornell-box"])
def test_every_ray_from_a_surface_hits_what_a_ray_caster_hits(
    name: str, cells: tuple[int, int], encoding: str
) -> None:
    scene, rng = load_scene(name), np.random.default_rng(5)
    # A single cell holds all rays, four a scan: fewer of them, or it takes a thousand scans.
    paths = (128, 32) if cells[0] > 1 else (16, 8)
    buffer = buffer_for(scene, cells, paths)
    for _ in range(4):
        triangle, origins = on_surfaces(scene, paths[0] * paths[1], rng)
        d = rng.standard_normal(3)
        way = np.where(scene.normals[triangle] @ d >= 0, 1.0, -1.0)
        assert_same_hits(scene, buffer, origins, d, way, share=2e-3 if cells[0] > 7 else 2e-2)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60))
@settings(max_examples=15, deadline=None)
def test_rays_through_a_soup_of_triangles_hit_the_nearest(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    # Of all sizes and shapes, slivers among them.
    triangles = rng.uniform(-1, 1, (count, 1, 3)) + rng.standard_normal((count, 3, 3)) * rng.exponential(
        0.5, (count, 1, 3)
    )
    scene = scene_of(triangles)
    origins = rng.uniform(-1.5, 1.5, (2000, 3)).astype(np.float32).astype(np.float64)
    way = rng.choice([-1.0, 1.0], 2000)
    assert_same_hits(scene, buffer_for(scene, (40, 24)), origins, rng.standard_normal(3), way, share=4e-3)


def test_nothing_leaks_out_of_a_closed_box(encoding: str, split: str) -> None:
    """Also along the axes, where walls are seen edge-on and every edge of two triangles is crossed."""
    scene = load_scene("furnace", {"subdivisions": 3})
    low, high = scene.bounds
    rng = np.random.default_rng(2)
    buffer = buffer_for(scene, (61, 59))
    for d in [*np.eye(3), *rng.standard_normal((6, 3)), np.array([1.0, 1.0, 0.0]), np.array([1.0, 1.0, 1.0])]:
        origins = low + (high - low) * rng.uniform(0.01, 0.99, (4096, 3))
        hits = buffer.cast(origins, d, rng.choice([-1.0, 1.0], 4096))
        assert np.all(hits.triangle >= 0)


def test_a_grid_of_rays_through_the_edges_of_a_mesh_meets_no_gap(split: str) -> None:
    """Origins that project exactly onto the vertices and edges of a tessellated plane."""
    n = 16
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    p = np.stack([x, y, 0 * x], -1)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, b, c], -2).reshape(-1, 3, 3), np.stack([a, c, d], -2).reshape(-1, 3, 3)]
    )
    s = np.linspace(-0.99, 0.99, 61)
    u, v = np.meshgrid(np.concatenate([s, x[0, 1:-1]]), np.concatenate([s[::3], x[0, 1:-1]]))
    origins = np.stack([u, v, np.full_like(u, 0.5)], -1).reshape(-1, 3)
    hits = buffer_for(scene_of(triangles), (33, 33)).cast(origins, (0, 0, -1))
    np.testing.assert_allclose(hits.t, 0.5, atol=1e-6)


def sheet(z: float, n: int) -> Float64:
    """(2 n^2, 3, 3) triangles of a square of side 2 about the z axis."""
    s = np.linspace(-1.0, 1.0, n + 1)
    p = np.stack([*np.meshgrid(s, s), np.full((n + 1, n + 1), z)], -1)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    halves = [np.stack(corners, -2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    return np.concatenate(halves)


@pytest.mark.parametrize("squares", [1, 65, 181], ids=["4", "16,900", "131,044"])
def test_of_two_surfaces_close_together_the_nearer_is_hit(squares: int) -> None:
    """The nearer is the last in the scene, which loses where both have one level of depth."""
    # The side that is looked at, and how far one is from the other, in diameters.
    for gap, height in ((2e-5, 0.05), (4e-5, 0.18), (8e-5, 0.42), (1.6e-4, 0.8)):
        for side in (1.0, -1.0):
            diameter = np.sqrt(8.0)
            scene = scene_of(np.concatenate([sheet(0.0, squares), sheet(side * gap * diameter, squares)]))
            rng = np.random.default_rng(6)
            heights = side * diameter * height * rng.uniform(0.5, 1.0, 1024)
            origins = np.column_stack([rng.uniform(-0.3, 0.3, (1024, 2)), heights])
            # Some of them see the sheets at a slant.
            for d in ((0.0, 0.0, -side), (0.1, 0.2, -side)):
                buffer = buffer_for(scene, (96, 96))
                assert buffer.packed
                hits = buffer.cast(origins, d)
                assert np.all(hits.triangle >= 2 * squares**2), f"gap {gap}, seen from {height}"


def test_a_soup_of_many_triangles_is_hit_as_a_ray_caster_hits_it(encoding: str, split: str) -> None:
    rng = np.random.default_rng(9)
    triangles = rng.uniform(-1, 1, (9000, 1, 3)) + rng.standard_normal((9000, 3, 3)) * rng.exponential(
        0.05, (9000, 1, 3)
    )
    scene, origins = scene_of(triangles), rng.uniform(-1, 1, (1000, 3)).astype(np.float32).astype(np.float64)
    way = rng.choice([-1.0, 1.0], 1000)
    assert_same_hits(scene, buffer_for(scene, (60, 40)), origins, rng.standard_normal(3), way, share=4e-3)


def test_one_scan_serves_both_hemispheres() -> None:
    plates = np.array([[[-9, -9, z], [9, -9, z], [0, 9, z]] for z in (-1.0, 2.0)])
    hits = buffer_for(scene_of(plates), (8, 8)).cast([[0, 0, 0], [0, 0, 0]], (0, 0, 1), [1, -1])
    np.testing.assert_array_equal(hits.triangle, [1, 0])
    np.testing.assert_allclose(hits.t, [2.0, 1.0])


def test_a_ray_of_no_way_is_not_cast() -> None:
    plate = np.array([[[-9, -9, 1], [9, -9, 1], [0, 9, 1.0]]])
    hits = buffer_for(scene_of(plate), (8, 8)).cast(np.zeros((2, 3)), (0, 0, 1), [0, 1])
    np.testing.assert_array_equal(hits.triangle, [-1, 0])


def test_scans_go_on_when_the_epochs_run_out() -> None:
    scene, rng = load_scene("cornell-box-36"), np.random.default_rng(1)
    buffer = buffer_for(scene, (8, 8), (32, 32))
    for epoch in (2, 1, 0, 0):
        if buffer._epoch > 2:
            buffer._epoch = epoch
        triangle, origins = on_surfaces(scene, 1024, rng)
        d = rng.standard_normal(3)
        assert_same_hits(scene, buffer, origins, d, np.sign(scene.normals[triangle] @ d), share=3e-3)


@pytest.mark.parametrize(("cells", "paths", "most"), [((5, 4), (64, 64), 80), ((1, 1), (200, 100), 4)])
def test_where_paths_crowd_the_survivors_stand_for_all(
    cells: tuple[int, int], paths: tuple[int, int], most: int
) -> None:
    """The sum of the survivors' weights in every cell is the number of paths in it, exactly."""
    scene = load_scene("cornell-box-36")
    buffer = buffer_for(scene, cells, paths)
    weight = path_weights(buffer, scene, np.random.default_rng(3))
    assert most / 4 <= np.count_nonzero(weight) <= most
    assert np.sum(weight) == paths[0] * paths[1]


def path_weights(buffer: PathBuffer, scene: Scene, rng: np.random.Generator) -> Float64:
    """(paths,) the weight of every path after one scan, 0 for those that lost."""
    gl = buffer.gl
    _, origins = on_surfaces(scene, buffer.paths[0] * buffer.paths[1], rng)
    state = np.concatenate([origins, np.ones((len(origins), 1))], 1).astype(np.float32)
    position = gl.texture(buffer.paths, 4, state.tobytes(), dtype="f4")
    scan = buffer.scan_positions(position, path_buffer.ScanView((np.array([0.36, 0.48, 0.8]),), seed=4))
    buffer.scan_scene(scan)
    answer = gl.texture(buffer.paths, 1, dtype="f4")
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        shaders = Path(folder) / "shaders"
        shutil.copytree(program_module.shader_folder(), shaders)
        report = shaders / "path_buffer/path_report.frag"
        text = report.read_text().replace("out int triangle", "out float triangle")
        found = "triangle = path_result(ivec2(gl_FragCoord.xy), weight)"
        assert found in text
        report.write_text(text.replace(found, f"{found} == PATH_LOST ? 0.0 : weight"))
        patch.setattr(program_module, "shader_folder", lambda: shaders)
        program = program_module.load_program(
            gl, vertex="gl/fullscreen.vert", fragment="path_buffer/path_report.frag", defines=buffer.defines
        )
    Pass("weights", gl, program, gl.framebuffer([answer]), textures=buffer.textures).run(scan.uniforms)
    return np.frombuffer(answer.read(), np.float32).astype(float)


def test_more_origins_than_the_buffer_holds_are_refused() -> None:
    buffer = buffer_for(load_scene("cornell-box-36"), (4, 4), (4, 4))
    with pytest.raises(UsageError, match="17 origins for a buffer of 4 x 4"):
        buffer.cast(np.zeros((17, 3)), (0, 0, 1))
    with pytest.raises(UsageError, match="direction"):
        buffer.cast(np.zeros((1, 3)), (0, 0, 0))
    with pytest.raises(UsageError, match="not finite"):
        buffer.cast([[0, np.nan, 0]], (0, 0, 1))


def test_a_buffer_for_occlusion_names_no_triangles() -> None:
    gl = get_context().gl
    buffer = PathBuffer(gl, DeviceScene(gl, load_scene("cornell-box-36")), (4, 4), occlusion=True)
    with pytest.raises(UsageError, match="only whether anything is hit"):
        buffer.cast(np.zeros((1, 3)), (0, 0, 1))


def test_a_buffer_for_more_paths_than_keys_is_refused() -> None:
    with pytest.raises(UsageError, match="at most 1048576"):
        buffer_for(load_scene("cornell-box-36"), (4, 4), (1025, 1024))


def test_a_scan_can_be_looked_at(encoding: str, split: str) -> None:
    """z0 of every ray, and beyond it what `cast` finds."""
    buffer = buffer_for(load_scene("cornell-box-36"), (40, 30))
    assert buffer.packed == (encoding == "packed")
    origins = np.random.default_rng(5).uniform(-0.9, 0.9, (200, 3))
    direction, way = np.array([0.3, 0.9, -0.2]), np.where(np.arange(200) % 3, 1, -1)
    hits = buffer.cast(origins, direction, way)
    cells = buffer.scan(origins, direction, way)
    assert cells.z0.shape == cells.triangle.shape == cells.t.shape == (30, 40, 4)
    rays = ~np.isnan(cells.z0)
    assert rays.sum() == 200
    assert not np.any(cells.triangle[~rays] >= 0)
    heights = (origins - buffer.scene.centre) @ (direction / np.linalg.norm(direction))
    order, own = np.argsort(cells.z0[rays]), np.argsort(heights)
    np.testing.assert_allclose(cells.z0[rays][order], heights[own], atol=1e-5)
    np.testing.assert_array_equal(cells.triangle[rays][order], hits.triangle[own])
    np.testing.assert_allclose(cells.t[rays][order], hits.t[own], rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cells": (10**9, 10**9)}, "cells: .* from 1 to"),
        ({"cells": (0, 0)}, "cells"),
        ({"cells": (-1, -1)}, "cells"),
        ({"cells": (2.5, 2)}, "cells"),
        ({"cells": 5}, "cells"),
        ({"paths": (0, 0)}, "paths"),
        ({"paths": (10**9, 10**9)}, "paths"),
        ({"paths": None}, "paths"),
        ({"views": 0}, "views"),
        ({"views": "x"}, "views"),
        ({"records": 5}, "records"),
        ({"scene": None}, "scene"),
        ({"gl": None}, "gl"),
    ],
)
def test_buffer_that_cannot_be_made_is_refused(arguments: dict[str, Any], message: str) -> None:
    gl = get_context().gl
    scene = DeviceScene(gl, load_scene("cornell-box-36"))
    with pytest.raises(UsageError, match=message):
        PathBuffer(**{"gl": gl, "scene": scene, "paths": (4, 4), **arguments})


@pytest.mark.parametrize("size", [(10**9, 10**9), (-1, 1)])
def test_texture_beyond_the_limits_of_the_device_is_refused(size: tuple[int, int]) -> None:
    gl = get_context().gl
    with pytest.raises(ContextError, match="this device allows"):
        gl.texture(size, 4)
    with pytest.raises(ContextError, match="this device allows"):
        gl.texture_array((*size, 1), 4)


@pytest.mark.parametrize(
    ("rays", "message"),
    [
        (([0, 0], (0, 1, 0)), "origins of shape"),
        (("x", (0, 1, 0)), "origins"),
        (([[0, 0, 0]], "x"), "direction"),
        (([[0, 0, 0]], (1e308, 1e308, 1e308)), "direction"),
        (([[0, 0, 0]], (0, 1, 0), [1, 2]), "sign of shape"),
        (([[0, 0, 0]], (0, 1, 0), [np.nan]), "sign of shape"),
        (([[0, 0, 0]], (0, 1, 0), 1), "sign of shape"),
    ],
)
def test_wrong_rays_are_refused(rays: tuple[Any, ...], message: str) -> None:
    buffer = buffer_for(load_scene("cornell-box-36"), (4, 4), (4, 4))
    for method in (buffer.cast, buffer.scan):
        with pytest.raises(UsageError, match=message):
            method(*rays)
