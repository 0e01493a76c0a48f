"""The BVH of path rays finds what looking at every triangle finds; the tree built by sweeps keeps its promises."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from glpath.accel.bvh import build_bvh
from glpath.accel.nodes import Bvh
from glpath.accel.sweep import sweep_bvh
from glpath.gl import program, ray_bvh, ray_bvh_kernels
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass
from glpath.gl.ray_bvh import RayBvh, _item_table, _items
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Scene, path_traceable
from tests.reference.numpy_path_tracer import nearest_hits
from tests.support.box_trees import boxes, check, random_boxes
from tests.support.repository import ROOT

Float64 = NDArray[np.float64]
SKY = {"zenith": 1.0, "horizon": 1.0}

SHADER = """
#include "gl/texels.glsl"
#include "scene/ray_bvh.glsl"
TEXELS(rgba32f, origins);
TEXELS(rgba32f, directions);
layout(location = 0) out vec4 found;
void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 o = texel(origins, at), d = texel(directions, at);
    int nearest = nearest_triangle(o.xyz, d.xyz, int(o.w));
    found = vec4(float(nearest), float(is_blocked(o.xyz, d.xyz, d.w, int(o.w))), 0.0, 0.0);
}
"""


@given(boxes())
def test_a_tree_built_by_sweeps_keeps_its_promises(corners: tuple[np.ndarray, np.ndarray]) -> None:
    check(sweep_bvh(*corners), *corners, leaf_size=1)


def test_sweeps_build_trees_as_good_as_bins() -> None:
    def cost(tree: Bvh) -> float:
        extent = tree.upper - tree.lower
        areas = extent[:, 0] * extent[:, 1] + extent[:, 1] * extent[:, 2] + extent[:, 2] * extent[:, 0]
        return float(areas.sum() / areas[0])

    corners = random_boxes(500)
    assert cost(sweep_bvh(*corners)) < 1.02 * cost(build_bvh(*corners, leaf_size=1))


def soup(count: int, seed: int = 3) -> Scene:
    """Triangles of many sizes, slivers and flat ones among them."""
    random = np.random.default_rng(seed)
    middle, size = random.uniform(-5, 5, (count, 1, 3)), 10 ** random.uniform(-3, 0.5, (count, 1, 1))
    corners = middle + size * random.normal(size=(count, 3, 3))
    corners[::7, :, 1] = corners[::7, :1, 1]
    corners[::11, 2] = 0.5 * corners[::11, 0] + 0.5 * corners[::11, 1] + 1e-3
    mesh = {"type": "mesh", "vertices": corners.reshape(-1, 3), "faces": np.arange(3 * count).reshape(-1, 3)}
    return scene_from_dict({"camera": {"position": [0, 0, 9], "target": [0, 0, 0]}, "shapes": [mesh], "sky": SKY})


def cast(
    monkeypatch: pytest.MonkeyPatch, folder: Path, scene: Scene, origins: Float64, directions: Float64, tmax: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Nearest triangle, -1 for none, and whether any is before tmax, by the shader."""
    shaders = folder / "shaders"
    shutil.copytree(program.shader_folder(), shaders)
    (shaders / "cast.frag").write_text(SHADER)
    monkeypatch.setattr(program, "shader_folder", lambda: shaders)
    gl = get_context().gl
    device = DeviceScene(gl, scene)
    bvh = RayBvh(gl, device)
    size = (len(origins), 1)
    textures: dict[str, Any] = {**bvh.textures}
    for name, values, last in (("origins", origins, -1.0), ("directions", directions, tmax)):
        rows = np.concatenate([values, np.full((len(values), 1), last)], axis=1).astype(np.float32)
        textures[name] = gl.texture(size, 4, rows.tobytes(), dtype="f4")
        textures[name].filter = (gl.NEAREST, gl.NEAREST)
    out = gl.texture(size, 4, dtype="f4")
    drawn = program.load_program(
        gl, vertex="gl/fullscreen.vert", fragment="cast.frag", generated=bvh.generated, defines=bvh.defines
    )
    Pass("cast", gl, drawn, gl.framebuffer([out]), textures=textures).run(bvh.uniforms)
    found = np.frombuffer(out.read(), np.float32).reshape(-1, 4)
    return found[:, 0].astype(np.int64), found[:, 1] > 0.5


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("far_nodes", [False, True])
@pytest.mark.parametrize("make", [lambda: soup(400), lambda: path_traceable(load_scene("cornell-box-36"))])
def test_rays_find_what_every_triangle_asked_finds(
    make: Any, far_nodes: bool, compiled: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if compiled:
        monkeypatch.setattr(ray_bvh, "_MANY", 0)
    if far_nodes:
        monkeypatch.setattr(ray_bvh, "_NEAR_GROUPS", 0)
    scene = path_traceable(make())
    random = np.random.default_rng(1)
    low, high = scene.bounds
    origins = random.uniform(low, high, (2000, 3))
    directions = random.normal(size=(2000, 3))
    directions[:300, :] = np.eye(3)[random.integers(3, size=300)] * random.choice([-1.0, 1.0], (300, 1))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tmax = 1.0
    triangle, blocked = cast(monkeypatch, tmp_path, scene, origins, directions, tmax)
    _, t = nearest_hits(scene.triangles, origins, directions)
    normal, corner = scene.normals[triangle], scene.triangles[triangle, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.sum(normal * (corner - origins), axis=1) / np.sum(normal * directions, axis=1)
    at = np.where(triangle < 0, np.inf, at)
    # Rays through an edge may be rounded either way.
    assert np.mean(~np.isclose(at, t, rtol=1e-4, atol=1e-5)) < 0.002
    assert np.mean(blocked != (t < tmax)) < 0.003


@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_no_ray_leaves_a_closed_room(away: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A finely tessellated sphere from within: not even through the edges and corners of its triangles."""
    centre = np.array([3.0, 1.0, -2.0]) + away
    sphere = {"type": "sphere", "center": centre.tolist(), "radius": 2.0, "subdivisions": 4}
    camera = {"position": centre.tolist(), "target": [*centre[:2], centre[2] + 2]}
    scene = path_traceable(scene_from_dict({"camera": camera, "shapes": [sphere], "sky": SKY}))
    corners = scene.triangles.reshape(-1, 3)
    middles = 0.5 * (scene.triangles + np.roll(scene.triangles, 1, axis=1)).reshape(-1, 3)
    aims = np.concatenate([corners, middles])[:8000]
    origins = np.broadcast_to(centre + np.array([0.1, -0.1, -0.2]), aims.shape)
    triangle, _ = cast(monkeypatch, tmp_path, scene, origins - scene.centred.origin, aims - origins, 1e9)
    assert (triangle >= 0).all()


@pytest.mark.parametrize("name", ["room", "parlour"])
def test_compiled_code_makes_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of scenes with pairs of triangles, with alpha and with thin dielectrics, from a tree of the same builder."""
    monkeypatch.setattr(ray_bvh, "SWEPT", 0)
    monkeypatch.setattr(ray_bvh_kernels, "_FILLING", 0)
    scene = DeviceScene(get_context().gl, path_traceable(load_scene(name)))
    paths = np.zeros(scene.triangle_count, np.int64)
    paths[::9] = 1  # those move apart from their neighbours
    plain, compiled = ray_bvh._interpreted(scene, paths), ray_bvh._compiled(scene, paths)
    np.testing.assert_array_equal(compiled.items, plain.items)
    np.testing.assert_array_equal(compiled.wide.tree.lower, plain.wide.tree.lower)
    assert compiled.table.shape == plain.table.shape
    half = len(plain.table[:]) // 8 * 4
    for part in (slice(0, half), slice(half, None)):
        np.testing.assert_array_equal(compiled.table[part], plain.table[part])


def test_what_moves_is_moved_in_the_compiled_tree_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_bvh, "SWEPT", 0)
    monkeypatch.setattr(ray_bvh_kernels, "_FILLING", 0)
    motion = [{"time": 0.0}, {"time": 1.0, "transform": [{"translate": [2, 0, 1]}]}]
    boxes = [{"type": "box", "min": [x, 0, 0], "max": [x + 1, 1, 1]} for x in (0, 3, 6)]
    boxes[1]["motion"] = motion
    camera = {"position": [0, 0, 9], "target": [0, 0, 0], "shutter": [0, 1]}
    scene = path_traceable(scene_from_dict({"camera": camera, "shapes": boxes, "sky": SKY}))
    contents = []
    for many in (0, 1000):
        monkeypatch.setattr(ray_bvh, "_MANY", many)
        device = DeviceScene(get_context().gl, scene)
        bvh = RayBvh(get_context().gl, device)
        before = bvh.textures["ray_bvh"].read()
        device.move_to(0.9)
        assert device.moving is not None
        bvh.move_to(device.moving.corners())
        contents.append((before, bvh.textures["ray_bvh"].read()))
    assert contents[0] == contents[1]
    assert contents[0][0] != contents[0][1]


BYTES = """
import numpy as np
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.ray_bvh import RayBvh
from glpath.io import load_scene
from glpath.scene.geometry import Mesh
from glpath.system.machine import peak_resident_bytes

def terrain(side):
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, side)], indexing="ij")
    z = np.random.default_rng(1).uniform(0, 1 / side, x.shape)
    i = np.add.outer(side * np.arange(side - 1), np.arange(side - 1)).ravel()
    faces = np.concatenate([[i, i + 1, i + side], [i + side + 1, i + side, i + 1]], axis=1).T
    return load_scene("cornell-box").add(Mesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces.astype(np.int32)))

def built(side):
    device = DeviceScene(get_context().gl, terrain(side))
    with open("/proc/self/statm") as statm:
        resident = int(statm.read().split()[1]) * 4096
    with open("/proc/self/clear_refs", "w") as peak:
        peak.write("5")  # begins again
    return RayBvh(get_context().gl, device), (peak_resident_bytes() - resident) / device.triangle_count

small, _ = built(330)  # what compiled code takes
large, each = built(710)
print(each, 16 * large.textures["ray_bvh"].width * large.textures["ray_bvh"].height / (2 * 709**2))
"""


def test_a_million_triangles_take_little_memory() -> None:
    """Bytes a triangle beside the scene and what the device has of it: the most, and those that stay."""
    if not os.access("/proc/self/clear_refs", os.W_OK):
        pytest.skip("needs Linux's /proc")
    result = subprocess.run([sys.executable, "-c", BYTES], cwd=ROOT, capture_output=True, text=True, check=True)
    peak, kept = map(float, result.stdout.split())
    assert kept < 100
    assert peak < 180


def test_parallelograms_are_pairs_of_triangles_and_no_others() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    pair = square[[[0, 1, 2], [0, 2, 3]]]
    kite = pair.copy()
    kite[1, 2] += [0.1, 0, 0]
    loose = square[[[0, 1, 2]]] + 5.0
    assert _items(pair).tolist() == [[0, 1, 1]]
    assert _items(np.concatenate([loose, pair, loose]))[:, :2].tolist() == [[0, -1], [1, 2], [3, -1]]
    # However small they are beside the scene.
    for scale in (1.0, 1e-7):
        assert _items(np.concatenate([1e-7 * pair, scale * kite]))[:, :2].tolist() == [[0, 1], [2, -1], [3, -1]]
    assert _items(np.zeros((0, 3, 3))).shape == (0, 3)


def test_numbers_of_triangles_are_integers() -> None:
    """A float would have lost the last digits from 2**24 on."""
    number = (1 << 24) + 1
    triangles = np.broadcast_to(np.eye(3), (number + 1, 3, 3))
    table = _item_table(triangles, np.array([[number, -1, 0]]), np.zeros(number + 1, np.uint8))
    assert table[0, 0, 3] == number
    assert table[0, 1, 3] == 0xFFFFFFFF
