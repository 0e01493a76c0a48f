"""Streamed triangles: the bits of the same ones in memory, within a budget, and clear errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.buffers import path_buffer
from glpath.gl.camera import eye_uniforms, view_volume
from glpath.gl.geometry_stream import before_planes
from glpath.io.export import export
from glpath.scene.summary import summarize
from tests.support.engines import engine_options
from tests.support.streams import GRASS, LAMPS, SKY, TRIANGLE, Given, in_memory, scene_of
from tests.support.streams import streamed_corners as corners
from tests.support.terrain import Hills, Watched, memory_of

SCANS = {"integrator": "path-buffer", "spp": 3, "max_depth": 3, "light_resolution": 64}


# Few triangles are drawn, of many a compute shader takes the small ones.
@pytest.mark.parametrize("squares", [1, 17])
@pytest.mark.parametrize("light", [{}, SKY, LAMPS], ids=["lamp", "sky", "lamps"])
def test_a_streamed_scene_has_the_bits_of_one_in_memory(squares: int, light: dict[str, Any]):
    assert_bits_of_one_in_memory(Hills(4, squares), light)


@pytest.mark.parametrize("squares", [1, 8])
def test_so_it_has_in_two_scans(squares: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(path_buffer, "MAX_PACKED_BITS", 0)
    assert_bits_of_one_in_memory(Hills(4, squares), LAMPS)


def assert_bits_of_one_in_memory(hills: Hills, light: dict[str, Any]) -> None:
    options = {**SCANS, "aovs": ("albedo", "normal"), "interleave": "never"}
    whole = glpath.render(scene_of(in_memory(corners(hills)), **light), **options)
    scene = scene_of({"type": "stream", "stream": hills}, **light)
    # In the least budget chunks take turns in one place; in the other all stay.
    for budget in (3, 64):
        streamed = glpath.render(scene, **options, geometry_budget=budget)
        np.testing.assert_array_equal(streamed.mean, whole.mean)
        for name in options["aovs"]:
            np.testing.assert_array_equal(streamed.aov(name), whole.aov(name))
    assert (whole.mean > 0).mean() > 0.5


@pytest.mark.parametrize("engine", ["lattice", "hemisphere", "sphere"])
def test_so_it_has_whatever_directions_are_shared(engine: str):
    hills = Hills(2, 12)
    options = {**SCANS, **engine_options(engine)}
    whole = glpath.render(scene_of(in_memory(corners(hills)), **SKY), **options)
    streamed = glpath.render(scene_of({"type": "stream", "stream": hills}, **SKY), **options)
    np.testing.assert_array_equal(streamed.mean, whole.mean)


def test_a_file_is_streamed_through_a_transform_with_its_fronts_turned(tmp_path: Path):
    triangles = corners(Hills(2, 6))
    triangles[5, 2] = triangles[5, 1]  # no area: left out of both
    np.save(tmp_path / "hills.npy", triangles)
    shape = {
        "transform": [{"scale": [1, 1, -1]}, {"rotate": {"axis": [0, 1, 0], "angle": 20}}],
        "flip_normals": True,
    }
    (tmp_path / "scene.toml").write_text(
        """
        camera = { position = [0, 3, 6], target = [0, 0, 0] }
        film = { resolution = [40, 30] }
        sky = { zenith = [0.2, 0.3, 0.6], horizon = 0.5 }
        [materials]
        grass = { reflectance = 0.5, two_sided = false }
        [[shapes]]
        type = "stream"
        file = "hills.npy"
        material = "grass"
        transform = [{ scale = [1, 1, -1] }, { rotate = { axis = [0, 1, 0], angle = 20 } }]
        flip_normals = true
        """
    )
    with pytest.warns(glpath.SceneWarning, match="dropped 1 of"):
        whole = glpath.load_scene(
            {
                "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
                "film": {"resolution": [40, 30]},
                **SKY,
                "materials": {"grass": {"reflectance": 0.5, "two_sided": False}},
                "shapes": [in_memory(triangles, material="grass", **shape)],
            }
        )
    film = glpath.render(tmp_path / "scene.toml", **SCANS)
    np.testing.assert_array_equal(film.mean, glpath.render(whole, **SCANS).mean)
    assert film.mean.max() > 0.1


def test_what_a_view_cannot_see_is_not_asked_for():
    hills = Watched(4, 8)
    # From above the corner where x and z are least: some of the 16 tiles.
    camera = {"camera": {"position": [-2.9, 4, 2.9], "target": [-2.2, 0, 2.2], "fov": 25}}
    base = {**camera, **SKY, "film": {"resolution": [24, 24]}, "materials": GRASS}
    scene = glpath.load_scene({**base, "shapes": [{"type": "stream", "stream": hills, "material": "grass"}]})
    whole = glpath.load_scene({**base, "shapes": [in_memory(corners(hills), material="grass")]})
    options = {"integrator": "path-buffer", "spp": 1, "max_depth": 1, "light_resolution": 16}
    hills.asked.clear()
    film = glpath.render(scene, **options, geometry_budget=1)
    assert set(range(16)) == set(hills.asked[:16])  # how far the scene extends
    assert 0 < len(set(hills.asked[16:])) < 10
    np.testing.assert_array_equal(film.mean, glpath.render(whole, **options).mean)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_no_box_that_reaches_into_what_is_seen_is_left_out(projection):
    camera = {"projection": projection, **({"height": 3.0} if projection == "orthographic" else {})}
    scene = scene_of(in_memory(corners(Hills(1, 4)))).with_camera(**camera)
    window = (7, 3, 20, 11)
    normals, offsets = view_volume(scene.camera, eye_uniforms(scene.camera, window))
    rays, origins = scene.camera.rays(), np.broadcast_to(scene.camera.origins(), scene.camera.rays().shape)
    inside = np.s_[3:14, 7:27]
    random = np.random.default_rng(1)
    points = origins[inside] + rays[inside] * random.uniform(0.1, 20, (11, 20, 1))
    points = points.reshape(-1, 3)
    lower, upper = points - random.uniform(0, 0.2, points.shape), points + random.uniform(0, 0.2, points.shape)
    assert before_planes(lower, upper, normals, offsets).all()
    outside = np.s_[[[0], [16]], [*range(4), *range(30, 40)]]
    outside = (origins[outside] + rays[outside] * random.uniform(0.1, 20, (2, 14, 1))).reshape(-1, 3)
    assert not before_planes(outside, outside, normals, offsets).any()


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "path"},
        {"integrator": "gather", "cast": "bvh"},
        {"integrator": "classic"},
    ],
    ids=["path", "gather by rays", "classic"],
)
def test_engines_that_want_all_triangles_in_memory_say_so(options: Any):
    scene = scene_of({"type": "stream", "stream": Hills(1, 2), "name": "hills"})
    with pytest.raises(glpath.SceneError, match=r"streams triangles \(hills\)") as error:
        glpath.render(scene, spp=1, **options)
    assert 'integrator="path-buffer"' in error.value.remedy


def test_so_do_radiosity_and_export(tmp_path: Path):
    scene = scene_of({"type": "stream", "stream": Hills(1, 2)})
    with pytest.raises(glpath.SceneError, match="streams triangles"):
        glpath.solve_radiosity(scene)
    with pytest.raises(glpath.SceneError, match="streams triangles"):
        export(scene, tmp_path / "scene.xml")


def test_a_scene_tells_of_its_streams():
    scene = scene_of({"type": "stream", "stream": Hills(2, 3)})
    told = summarize(scene)
    assert told["triangles"] == 14 + 72
    assert (told["shapes"][-1]["triangles"], told["shapes"][-1]["area"]) == (72, None)
    assert told["warnings"] == []
    assert "14 triangles, 72 streamed triangles" in repr(scene)
    other = scene_of({"type": "stream", "stream": Hills(2, 4)})
    assert scene.digest() == scene_of({"type": "stream", "stream": Hills(2, 3)}).digest() != other.digest()
    lower, upper = scene.bounds
    assert lower[0] == -3
    assert upper[2] == 3


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"stream": Given()}, "must have chunk"),
        ({"stream": 3}, "must have chunk"),
        ({"stream": Given(TRIANGLE[:, :, :2])}, r"shape \(1, 3, 2\)"),
        ({"stream": Given(TRIANGLE, TRIANGLE * np.nan)}, "not finite"),
        ({"stream": Given((TRIANGLE[0], [[0, 1, 3]]))}, "no numbers of its 3 vertices"),
        ({"stream": Given(TRIANGLE[:, [0, 1, 1]])}, "no triangles with an area"),
        ({"stream": Given(TRIANGLE), "emission": {"radiance": 1}}, "makes a stream a light"),
        ({"stream": Given(TRIANGLE), "material": "seen"}, "which has textures"),
        ({"stream": Given(TRIANGLE), "file": "a.npy"}, "stream and file"),
        ({}, "lacks the field `file`"),
        ({"file": "none.npy"}, "no such file"),
        ({"file": "none.ply"}, r"a \.npy file"),
    ],
)
def test_what_is_no_stream_is_named(shape: dict[str, Any], message: str):
    data = {
        "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
        **SKY,
        "materials": {"seen": {"texture": "t"}},
        "textures": {"t": {"type": "checker"}},
        "shapes": [{"type": "stream", **shape}],
    }
    with pytest.raises(glpath.SceneError, match=message) as error:
        glpath.load_scene(data)
    assert "shapes" in error.value.message


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.zeros((4, 9)), r"shape \(4, 9\)"),
        (np.zeros((4, 3, 3), int), "type int64"),
        (np.asfortranarray(np.ones((4, 3, 3))), "Fortran"),
        (b"PK", "no .npy file"),
        ("cut", "ends after"),
    ],
)
def test_a_file_that_is_no_array_of_triangles_is_refused(tmp_path: Path, content: Any, message: str):
    path = tmp_path / "hills.npy"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, str):
        np.save(path, np.ones((10, 3, 3)))
        path.write_bytes(path.read_bytes()[:-8])
    else:
        np.save(path, content)
    with pytest.raises(glpath.SceneError, match=message):
        scene_of({"type": "stream", "file": str(path)})


@pytest.mark.parametrize("integrator", ["path-buffer", "t-buffer", "gather"])
def test_chunks_that_change_are_noticed(integrator: Any):
    chunks = Given(TRIANGLE, np.concatenate([TRIANGLE, TRIANGLE + 2]))
    scene = scene_of({"type": "stream", "stream": chunks}, **SKY)
    chunks.chunks = (TRIANGLE, TRIANGLE)
    with pytest.raises(glpath.SceneError, match="chunk 1 had 2 triangles when the scene was made, and now has 1"):
        glpath.render(scene, integrator=integrator, spp=1)


def test_a_budget_without_room_for_a_chunk_is_refused_with_what_is_needed():
    scene = scene_of({"type": "stream", "stream": Hills(1, 64)})
    with pytest.raises(glpath.UsageError, match=r"geometry_budget: 4 MiB, but \d+ are needed at least") as error:
        glpath.render(scene, integrator="path-buffer", spp=1, geometry_budget=4)
    needed = int(error.value.message.split("but ")[1].split()[0])
    glpath.render(scene, integrator="path-buffer", spp=1, geometry_budget=needed + 1)


def test_a_budget_is_an_option_of_engines_that_stream():
    with pytest.raises(glpath.UsageError, match="geometry_budget: 8 with the integrator"):
        glpath.render("cornell-box-36", integrator="path", spp=1, geometry_budget=8)


@pytest.mark.evidence
@pytest.mark.release
def test_twenty_million_triangles_take_256_mebibytes():
    small, large = (memory_of(tiles, 256) for tiles in (1, 25))  # of 32,768 triangles
    print(f"one tile {small}, 20,480,000 triangles {large}")
    assert large["peak"] - small["peak"] < 256
    assert large["device"] < 256
    # Another relief a tile is another picture, but not another light.
    assert large["lit"] > 0.3
    assert abs(large["mean"] / small["mean"] - 1) < 0.5


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"type": "panorama"}, "which no panorama can see"),
        ({"shutter": [0, 1]}, "which cannot be where other shapes move"),
    ],
)
def test_what_streams_cannot_be_with_is_said(change, said):
    keys = [{"time": 0, "transform": []}, {"time": 1, "transform": [{"translate": [1, 0, 0]}]}]
    keys = keys if "shutter" in change else []
    ball = {"type": "sphere", "center": [0, 1, 0], "radius": 0.2, "motion": keys}
    camera = {"position": [0, 2, 6], "target": [0, 0, 0], **change}
    shapes = [{"type": "stream", "stream": Hills(1, 2)}, ball]
    scene = glpath.load_scene({"camera": camera, "shapes": shapes, "sky": {"zenith": 1}})
    with pytest.raises(glpath.SceneError, match=said):
        glpath.render(scene, spp=1, integrator="path-buffer", resolution=(32, 16))
