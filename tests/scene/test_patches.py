"""Bicubic patches: their surfaces by closed forms, without cracks, and the same to every engine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate

import glpath
from glpath.compare import relative_mse
from glpath.errors import SceneError
from glpath.io import scene_from_dict
from glpath.io.shipped.teapot import teapot_patches
from glpath.scene import patches as rooms
from glpath.scene.camera import Camera, CameraKey
from glpath.scene.model import Mesh
from glpath.scene.patches import PatchChunks, Patches, diced
from tests.support.engines import coarse, with_depth

Float64 = NDArray[np.float64]
CAMERA = Camera(np.array([4.0, 1.0, 2.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]), 40.0, (640, 480))


def paraboloid() -> Patches:
    """z = x² + y² over [-1, 1]², the front above."""
    line, square = np.linspace(-1, 1, 4), np.array([1, -1 / 3, -1 / 3, 1])  # control points of t and t²
    x, y = np.meshgrid(line, line, indexing="ij")
    control = np.stack([x, y, square[:, None] + square], axis=-1)
    return Patches.bezier(control.reshape(-1, 3), [range(16)])


def test_triangles_of_all_patches_of_a_scene_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    points = paraboloid().control.reshape(-1, 3)
    shape = {"type": "patches", "points": points, "patches": [list(range(16))], "level": 8}
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    monkeypatch.setattr("glpath.io.patches.MAX_TRIANGLES", 300)  # each has 2 x 8 x 8
    scene_from_dict({"camera": camera, "shapes": [shape] * 2})
    with pytest.raises(SceneError, match=r"2.* would be 128 triangles, with those before them 384; at most 300"):
        scene_from_dict({"camera": camera, "shapes": [shape] * 3})


def test_small_scene_file_cannot_ask_for_a_gigabyte_of_triangles() -> None:
    """A net of 6 x 12 points has 3 x 9 patches, each with 2 x 256 x 256 triangles, of 320 bytes each."""
    net = [[[i, j, 0] for j in range(12)] for i in range(6)]
    shape = {"type": "patches", "net": net, "level": 256}
    with pytest.raises(SceneError, match=r"would be 3,538,944 triangles; at most 2,097,152 are kept in memory"):
        scene_from_dict({"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "shapes": [shape]})


def ring() -> Patches:
    """A closed B-spline surface like a torus, 63 patches; the front outside."""
    a, b = (2 * np.pi * np.arange(n) / n for n in (7, 9))
    about = 2 + 0.8 * np.cos(b)
    net = [about * np.cos(a)[:, None], about * np.sin(a)[:, None], np.tile(0.8 * np.sin(b), (7, 1))]
    return Patches.bspline(np.stack(net, axis=-1), (True, True))


def bumps(uv: Float64) -> Float64:
    return np.asarray(0.1 * np.sin(40 * uv[:, 0]) * np.cos(31 * uv[:, 1]))


def volume(triangles: Float64) -> float:
    return float(np.linalg.det(triangles).sum() / 6)


@pytest.mark.parametrize("levels", [(16, 16, 16, 16), (3, 7, 2, 16), (1, 1, 1, 2)])
def test_points_and_normals_are_those_of_the_surface(levels: tuple[int, ...]):
    mesh = diced(paraboloid(), np.array([levels]))
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(z, x**2 + y**2, atol=1e-14)
    normals = np.stack([-2 * x, -2 * y, np.ones_like(x)], axis=1)
    np.testing.assert_allclose(mesh.normals, normals / np.linalg.norm(normals, axis=1, keepdims=True), atol=1e-14)
    np.testing.assert_allclose(mesh.uv, 0.5 + 0.5 * mesh.vertices[:, :2], atol=1e-14)


def test_the_area_converges_to_the_integral():
    exact, _ = integrate.dblquad(lambda y, x: np.sqrt(1 + 4 * x * x + 4 * y * y), -1, 1, -1, 1)
    errors = []
    for level in (4, 8, 16):
        mesh = diced(paraboloid(), paraboloid().levels(level))
        a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
        errors.append(exact - 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    assert 0 < errors[2] < 2e-3 * exact
    assert 3.5 < errors[0] / errors[1] < 4.5  # of second order
    assert 3.5 < errors[1] / errors[2] < 4.5


def test_a_flat_patch_has_its_exact_area_and_normal():
    u, v = np.meshgrid(np.arange(4) / 3, np.arange(4) / 3, indexing="ij")
    flat = np.stack([2 * u, 3 * v, np.full_like(u, 0.5)], axis=-1)
    mesh = diced(Patches.bezier(flat.reshape(-1, 3), [range(16)]), np.array([[3, 5, 2, 1]]))
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(6, rel=1e-12)
    np.testing.assert_allclose(mesh.normals, np.broadcast_to([0, 0, 1], mesh.normals.shape), atol=1e-15)


def test_a_b_spline_reproduces_squares():
    """The uniform cubic B-spline of t² is t² + 1/3."""
    t = np.arange(6.0)
    x, y = np.meshgrid(t, t, indexing="ij")
    surface = Patches.bspline(np.stack([x, y, x * x], axis=-1))
    assert len(surface.control) == 9
    vertices = diced(surface, surface.levels(5)).vertices
    np.testing.assert_allclose(vertices[:, 2], vertices[:, 0] ** 2 + 1 / 3, atol=1e-13)
    np.testing.assert_allclose([vertices[:, 1].min(), vertices[:, 1].max()], [1, 4])


def edges_of(triangles: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How often each edge is there, and of each how much oftener one way than the other."""
    _, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    ends = corner.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    return count, np.bincount(edge.ravel(), np.where(ends[:, 0] < ends[:, 1], 1, -1)).astype(np.int64)


@pytest.mark.parametrize("pixels", [100.0, 30.0, 10.0])
@pytest.mark.parametrize("heights", [None, bumps], ids=["smooth", "displaced"])
def test_a_closed_surface_has_no_crack_whatever_its_edges_are_divided_into(pixels: float, heights: Any):
    surface = ring()
    levels = surface.levels_seen(CAMERA, pixels)
    assert len(np.unique(levels)) > 3
    mesh = diced(surface, levels, heights)
    count, turns = edges_of(mesh.vertices[mesh.faces].astype(np.float32).astype(np.float64))
    assert (count == 2).all()
    assert (turns == 0).all()
    assert volume(mesh.vertices[mesh.faces]) > 0


def moving(*positions: list[float], shutter: tuple[float, float]) -> Camera:
    keys = [CameraKey(float(time), np.array(at), CAMERA.target, CAMERA.up) for time, at in enumerate(positions)]
    return replace(CAMERA, position=np.array([400.0, 0.0, 0.0]), motion=tuple(keys), shutter=shutter)


@pytest.mark.parametrize(
    ("camera", "time"),
    [
        (CAMERA, 0.0),
        (replace(CAMERA, projection="orthographic", height=6.0), 0.0),
        (replace(CAMERA, projection="orthographic", height=6.0, position=100 * CAMERA.position), 0.0),
        (replace(CAMERA, projection="panorama"), 0.0),
        (replace(CAMERA, projection="panorama", resolution=(960, 240)), 0.0),
        (moving([40.0, 10.0, 20.0], [4.0, 1.0, 2.0], shutter=(1.0, 1.0)), 1.0),
        (moving([4.0, -30.0, 2.0], [4.0, 32.0, 2.0], shutter=(0.2, 0.8)), 0.5),
    ],
)
def test_edges_are_as_long_in_the_picture_as_was_asked_for(camera: Camera, time: float):
    levels, curves = ring().levels_seen(camera, 12.0), ring().edges
    t = np.linspace(0, 1, 257)
    bernstein = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3])
    seen, _ = camera.at(time).project(np.einsum("kn,pekx->penx", bernstein, curves))
    longest = []
    for patch, of_patch in zip(seen, levels, strict=True):
        for edge, level in zip(patch, of_patch, strict=True):
            longest.append(np.linalg.norm(np.diff(edge[:: 256 // level], axis=0), axis=1).max())
    assert max(longest) < 1.5 * 12  # segments of equal steps are not equally long
    assert np.median(longest) > 12 / 4


@pytest.mark.parametrize("heights", [None, bumps], ids=["smooth", "displaced"])
def test_pieces_have_the_bits_of_the_whole(heights: Any, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rooms, "CHUNK", 300)
    surface = ring()
    levels = surface.levels_seen(CAMERA, 30.0)
    pieces = PatchChunks(surface, levels, heights)
    assert len(pieces) > 10
    found = np.concatenate([pieces.chunk(i) for i in range(len(pieces))])
    mesh = diced(surface, levels, heights)
    np.testing.assert_array_equal(found, mesh.vertices[mesh.faces])


def closed_in(surface: Patches, mesh: Mesh | None, levels: NDArray[np.int64], **more: Any) -> dict[str, Any]:
    """The inside of a closed surface that glows."""
    shape = (
        {"type": "stream", "stream": PatchChunks(surface, levels, bumps)}
        if mesh is None
        else {"vertices": mesh.vertices, "faces": mesh.faces}
    )
    return {
        "camera": {"position": [2, 0, 0], "target": [1.5, 1.5, 0.1], "fov": 80, "up": [0, 0, 1]},
        "film": {"resolution": [48, 48]},
        "sky": {"zenith": 1e6, "horizon": 1e6},
        "materials": {"wall": {"reflectance": 0.5}},
        "shapes": [{**shape, "material": "wall", "flip_normals": True, **more}],
    }


@pytest.mark.parametrize("streamed", [False, True])
def test_nothing_shines_through_a_closed_surface(streamed: bool):
    """Dark within, and outside a sky of a million. Rays find no crack; scans miss what is nearer to a path than
    their rounding, in a sphere of triangles too."""
    surface = ring()
    levels = surface.levels_seen(CAMERA, 25.0)
    scene = closed_in(surface, None if streamed else diced(surface, levels, bumps), levels)
    film = glpath.render(scene, integrator="path-buffer", spp=16, max_depth=2, light_resolution=64)
    assert film.mean.mean() < 1e-4 * 1e6
    assert np.median(film.mean) == 0
    if not streamed:
        assert glpath.render(scene, spp=16, max_depth=2).mean.max() == 0


def test_a_furnace_of_patches_sums_the_series():
    surface = ring()
    levels = surface.levels_seen(CAMERA, 25.0)
    scene = closed_in(surface, diced(surface, levels, bumps), levels, emission={"radiance": 0.5})
    del scene["sky"]
    for options in ({"integrator": "path-buffer", "light_resolution": 64}, {}):
        film = glpath.render(scene, spp=64, max_depth=3, **options)
        assert film.mean.mean() == pytest.approx(0.5 * (1 + 0.5 + 0.25 + 0.125), rel=0.005)


SKY = {"sky": {"zenith": [0.3, 0.4, 0.6], "horizon": 0.6}}


def net_scene(tmp_path: Path, **more: Any) -> dict[str, Any]:
    """Hills with a height map in a file."""
    height = np.random.default_rng(3).integers(0, 255, (16, 16), np.uint8)
    imageio.imwrite(tmp_path / "height.png", height)
    x, z = np.meshgrid(np.linspace(-2, 2, 6), np.linspace(2, -2, 6), indexing="ij")
    net = np.stack([x, 0.3 * np.sin(2 * x + z), z], axis=-1)
    return {
        "camera": {"position": [0, 2, 4], "target": [0, 0, 0], "fov": 35},
        "film": {"resolution": [40, 30]},
        **SKY,
        "textures": {"height": {"type": "image", "file": str(tmp_path / "height.png")}},
        "materials": {"m": {"reflectance": 0.5}},
        "shapes": [
            {
                "type": "patches",
                "net": net,
                "displacement": {"texture": "height", "scale": 0.2, "offset": -0.1},
                "material": "m",
                **more,
            }
        ],
    }


def test_a_displaced_surface_of_a_scene_is_the_same_to_every_engine(tmp_path: Path):
    scene = glpath.load_scene(net_scene(tmp_path, level=6))
    assert repr(scene).startswith("<Scene scene: 648 triangles, 1 shape")
    films = [
        glpath.render(scene, spp=128, **with_depth(options, 2))
        for options in (
            {},
            {"integrator": "path-buffer"},
            {"integrator": "gather", "radiosity": coarse(scene)},
        )
    ]
    for film in films[1:]:
        assert relative_mse(film.mean, films[0].mean) < 5e-3
        assert film.mean.mean() == pytest.approx(films[0].mean.mean(), rel=0.01)
    assert glpath.render(scene, integrator="t-buffer", spp=2).mean.max() > 0


def test_a_picture_converges_to_that_of_a_fine_mesh():
    """With the same numbers for each path, what is left is the surface's own error, of second order."""
    options: dict[str, Any] = {"resolution": (64, 48), "spp": 16, "max_depth": 2}
    fine = glpath.render("teapot", parameters={"level": 48}, **options).mean
    errors = [
        relative_mse(glpath.render("teapot", parameters={"level": level}, **options).mean, fine)
        for level in (2, 4, 12)
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 2e-3


def test_heights_are_those_of_the_map(tmp_path: Path):
    data = net_scene(tmp_path, level=4)
    data["shapes"][0]["net"] = [[[i, j, 0] for j in range(4)] for i in range(4)]  # one flat patch, [1, 2]²
    mesh = glpath.load_scene(data).shapes[0].geometry
    picture = imageio.imread(tmp_path / "height.png") / 255.0
    for (x, y, z), (u, v) in zip(mesh.vertices, mesh.uv, strict=True):
        column, row = 16 * u - 0.5, 16 * (1 - v) - 0.5
        j, i = int(np.floor(column)), int(np.floor(row))
        b, a = column - j, row - i
        corner = [picture[(i + k) % 16, (j + m) % 16] for k in (0, 1) for m in (0, 1)]
        height = (1 - a) * ((1 - b) * corner[0] + b * corner[1]) + a * ((1 - b) * corner[2] + b * corner[3])
        assert z == pytest.approx(0.2 * height - 0.1, abs=1e-12)
        assert (x - 1, y - 1) == pytest.approx((u, v))


def test_streamed_patches_are_the_same_triangles_shaded_flat(tmp_path: Path):
    kept, streamed = (glpath.load_scene(net_scene(tmp_path, level=6, streamed=s)) for s in (False, True))
    (mesh,) = kept.shapes.meshes
    flat = {"vertices": mesh.vertices, "faces": mesh.faces, "material": "m"}
    flat_scene = glpath.load_scene({**net_scene(tmp_path), "shapes": [flat]})
    options = {"integrator": "path-buffer", "spp": 4, "max_depth": 3, "light_resolution": 64}
    np.testing.assert_array_equal(
        glpath.render(streamed, **options).mean, glpath.render(flat_scene, **options).mean
    )
    with pytest.raises(glpath.SceneError, match="streams triangles"):
        glpath.render(streamed, integrator="path", spp=1)


def test_pixels_follow_the_camera_of_the_file(tmp_path: Path):
    near, far = net_scene(tmp_path, pixels=4.0), net_scene(tmp_path, pixels=4.0)
    far["camera"]["position"] = [0, 20, 40]
    counts = [len(glpath.load_scene(scene).triangles) for scene in (near, far)]
    assert counts[0] > 8 * counts[1] == 8 * 2 * 9


def test_the_teapot_is_the_teapot():
    """The volume of its patches, each with the cone to the origin, and its extent."""
    surface = Patches.bezier(teapot_patches().reshape(-1, 3), np.arange(512).reshape(-1, 16))
    mesh = diced(surface, surface.levels(16))
    triangles = mesh.vertices[mesh.faces]
    np.testing.assert_allclose(mesh.vertices.min(axis=0), [-3, -2, 0], atol=1e-12)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [3.434, 2, 3.15], atol=1e-3)
    assert volume(triangles) > 20
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (np.sum(normals[:, None] * mesh.normals[mesh.faces], axis=2) > 0).mean() > 0.999
    body = [i for i in range(32) if i % 10 in (1, 2) and i < 10]
    for patch in body:  # seen from its axis, all of the body faces away
        part = diced(surface.select(np.array([patch])), surface.levels(8)[:1])
        assert (np.sum(part.normals[:, :2] * part.vertices[:, :2], axis=1) > -1e-9).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "no control points"),
        ({"net": [[[0, 0, 0]] * 4] * 3}, "length of at least 4"),
        ({"net": [[[0, 0, 0]] * 4, [[0, 0, 0]] * 5, [[0, 0, 0]] * 4, [[0, 0, 0]] * 4]}, "has 5 points, but"),
        ({"points": [[0, 0, 0]], "patches": [[0] * 15 + [1]]}, "names point 1, but there are 1"),
        ({"points": [[0, 0, 0]], "patches": []}, "is empty"),
        ({"points": [[0, 0, 0]], "patches": [[0] * 16], "net": [[[0, 0, 0]] * 4] * 4}, "points, patches, net"),
        ({"points": [[0, 0, 0]], "patches": [[0] * 16]}, "no triangles with an area"),
        ({"points": [[0, 0, 0]], "patches": [[0] * 16], "streamed": True}, "no triangles with an area"),
        ({"net": [[[0, 0, 0]] * 4] * 4, "level": 3, "pixels": 4}, "has level and pixels"),
        (
            {"net": [[[i, j, 0] for j in range(4)] for i in range(4)], "displacement": {"texture": "x"}},
            "names the tex",
        ),
        ({"net": [[[i, j, 0] for j in range(90)] for i in range(90)], "level": 256}, "streamed = true"),
    ],
)
def test_what_is_no_surface_is_named(fields: dict[str, Any], message: str):
    data = {
        "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
        **SKY,
        "shapes": [{"type": "patches", **fields}],
    }
    with pytest.raises(glpath.SceneError, match=message) as error:
        glpath.load_scene(data)
    assert "shapes" in error.value.message
