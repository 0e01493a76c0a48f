"""Streamed triangles in the T-buffer and its shadows: the bits of the same ones in memory, within a budget."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.buffers.t_buffer import TBuffer
from glpath.film.film import Film
from glpath.integrators import stream_shadows
from glpath.scene import Background
from tests.support.streams import LAMPS, SKY, Given, in_memory, scene_of
from tests.support.streams import streamed_corners as corners
from tests.support.terrain import Hills, Watched, memory_of

T_BUFFER: dict[str, Any] = {"integrator": "t-buffer", "spp": 2}
LOW_SUN = {"lights": [{"type": "directional", "direction": [1, -0.15, 0.2], "irradiance": 2}]}
MANY_LAMPS = {
    "lights": [
        {"type": "point", "position": [x, 0.4, z], "intensity": 0.1}
        for x in np.linspace(-2.5, 2.5, 7)
        for z in np.linspace(-2.5, 2.5, 6)
    ]
}
AOVS = ("albedo", "normal", "depth", "depth_min", "position", "uv", "object_id", "material_id", "direct")


def both(hills: Hills, **more: Any) -> tuple[glpath.Scene, glpath.Scene]:
    """The scene with hills as a stream, and in memory."""
    return scene_of({"type": "stream", "stream": hills}, **more), scene_of(in_memory(corners(hills)), **more)


def assert_bits_in_memory(
    scenes: tuple[glpath.Scene, glpath.Scene], budgets: Any = (4, 64), **options: Any
) -> Film:
    """In the least budget chunks take turns in one place; in the other all stay."""
    given = {**T_BUFFER, **options}
    whole = glpath.render(scenes[1], **given)
    for budget in budgets:
        streamed = glpath.render(scenes[0], **given, geometry_budget=budget)
        np.testing.assert_array_equal(streamed.mean, whole.mean)
        for name in options.get("aovs", ()):
            np.testing.assert_array_equal(streamed.aov(name), whole.aov(name), err_msg=name)
    assert (whole.mean > 0).mean() > 0.1
    return whole


@pytest.mark.parametrize("shadows", ["rays", "sphere", "cube"])
@pytest.mark.parametrize("light", [{}, SKY, LAMPS, LOW_SUN], ids=["lamp", "sky", "lamps", "low sun"])
def test_a_streamed_scene_has_the_bits_of_one_in_memory(light: dict[str, Any], shadows: str) -> None:
    coarse = {} if shadows == "rays" else {"shadow_resolution": 96}
    assert_bits_in_memory(both(Hills(4, 9), **light), shadows=shadows, **coarse)


@pytest.mark.parametrize("squares", [1, 40])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_so_it_has_where_a_compute_shader_takes_small_triangles(
    squares: int, projection: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(inspect.unwrap(TBuffer.__init__).__kwdefaults__, "split_from", 1)
    camera = {"projection": projection, **({"height": 4.0} if projection == "orthographic" else {})}
    scenes = both(Hills(3, squares), **LAMPS)
    assert_bits_in_memory((scenes[0].with_camera(**camera), scenes[1].with_camera(**camera)), aovs=AOVS)


@pytest.mark.parametrize(
    "camera",
    [
        {"position": [-2.8, 0.35, 2.5], "target": [3, 0.2, -3]},  # within a chunk, before and behind the eye
        {"projection": "orthographic", "height": 3.0},
        {"projection": "orthographic", "height": 3.0, "position": [0, 0.1, 0], "target": [0, 0, -3]},
        {"position": [0, 300, 600], "fov": 0.5},
        {"aperture_radius": 0.1, "focus_distance": 6.0},
    ],
    ids=["eye among hills", "orthographic", "eye's plane through hills", "distant", "lens"],
)
def test_so_it_has_whatever_looks(camera: dict[str, Any]) -> None:
    scenes = [scene.with_camera(**camera) for scene in both(Hills(4, 7), **LAMPS)]
    assert_bits_in_memory((scenes[0], scenes[1]), aovs=AOVS)


def test_so_it_has_where_rays_ask_every_resident_object_in_turn() -> None:
    assert_bits_in_memory(both(Hills(2, 6), **LAMPS), secondary="classic")


def test_so_it_has_with_rays_of_more_lights_than_a_word_has_bits() -> None:
    film = assert_bits_in_memory(both(Hills(3, 8), **MANY_LAMPS), budgets=(4,))
    # All of them count, also those of the second word.
    fewer = scene_of({"type": "stream", "stream": Hills(3, 8)}, lights=MANY_LAMPS["lights"][:32])
    assert film.mean.mean() > 1.05 * glpath.render(fewer, **T_BUFFER).mean.mean()


def test_so_it_has_beside_every_kind_of_primitive_and_blended_surfaces() -> None:
    shapes = [
        {"type": "sphere", "center": [-1.2, 0.8, 0.5], "radius": 0.4, "material": "clay"},
        {"type": "sphere", "radius": 1, "transform": [{"scale": [0.3, 0.6, 0.2]}, {"translate": [1.3, 0.8, 0]}]},
        {"type": "plane", "point": [0, -0.3, 0], "normal": [0, 1, 0]},
        {"type": "quad", "corners": [[-2, 1, 1], [2, 1, 1], [2, 1, 2], [-2, 1, 2]], "material": "veil"},
    ]
    materials = {"clay": {"reflectance": [0.7, 0.2, 0.2]}, "veil": {"alpha": "blend", "opacity": 0.5}}
    hills = Hills(2, 10)
    scenes = [
        glpath.load_scene(
            {
                "camera": {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 45},
                "film": {"resolution": [40, 30]},
                "materials": materials,
                "shapes": [*shapes, terrain],
                **LAMPS,
            }
        )
        for terrain in ({"type": "stream", "stream": hills}, in_memory(corners(hills)))
    ]
    assert_bits_in_memory((scenes[0], scenes[1]), spp=4, aovs=AOVS)


def test_two_streams_know_their_shapes() -> None:
    hills, high = Hills(2, 6), corners(Hills(1, 6)) * [0.2, 1, 0.2] + [0, 1.5, 0]
    chunks = Given(high[:30], high[30:])
    first, second = (
        glpath.load_scene(
            {
                "camera": {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 45},
                "film": {"resolution": [40, 30]},
                "materials": {"red": {"reflectance": [0.9, 0.1, 0.1]}},
                "shapes": [{"material": "red", **kite}, hilly],
                **LAMPS,
            }
        )
        for kite, hilly in (
            ({"type": "stream", "stream": chunks}, {"type": "stream", "stream": hills}),
            (in_memory(high), in_memory(corners(hills))),
        )
    )
    film = assert_bits_in_memory((first, second), aovs=AOVS)
    assert len(np.unique(film.aov("object_id"))) == 3
    # By the paper's rule, a shadow depends on the object that is seen.
    identity = {"shadows": "cube", "shadow_test": "identity", "shadow_filter": 1, "shadow_resolution": 128}
    assert_bits_in_memory((first, second), **identity)


def test_a_scene_of_a_stream_alone() -> None:
    hills = Hills(3, 8)
    base = {"camera": {"position": [0, 3, 6], "target": [0, 0, 0]}, "film": {"resolution": [32, 24]}, **LAMPS}
    streamed = glpath.load_scene({**base, "shapes": [{"type": "stream", "stream": hills}]})
    whole = glpath.load_scene({**base, "shapes": [in_memory(corners(hills))]})
    for shadows in ("rays", "cube"):
        assert_bits_in_memory((streamed, whole), shadows=shadows, aovs=AOVS)


def test_hills_throw_their_shadow_on_a_ground_that_only_the_eye_sees() -> None:
    base = {"camera": {"position": [0, 5, 12], "target": [0, 0, 0]}, "film": {"resolution": [48, 36]}, **SKY}
    background = Background(np.array([0.2, 0.4, 0.8]), ground=np.array([0.0, -1.0, 0.0]))
    hills = Hills(3, 8)
    streamed, whole = (
        replace(glpath.load_scene({**base, "shapes": [terrain]}), background=background)
        for terrain in ({"type": "stream", "stream": hills}, in_memory(corners(hills)))
    )
    film = assert_bits_in_memory((streamed, whole), spp=8)
    beside = film.mean[-6:, :, 2]
    assert beside.min() < 0.7 < beside.max(), "some of it is in shadow"


@pytest.mark.parametrize("light", [SKY, LOW_SUN, {}], ids=["sky", "low sun", "lamp"])
def test_light_comes_through_where_streamed_triangles_are_not_asked(
    light: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the tests above compare has shadows of streamed triangles in it."""
    scene, _ = both(Hills(4, 9), **light)
    # The lamp's are on the ground that hills hide from it: far from the middle, below its height.
    scene = scene if light else scene.with_camera(position=[0, 1, 6])
    film = glpath.render(scene, **T_BUFFER)
    monkeypatch.setattr(stream_shadows.StreamShadows, "find", _asks_nothing)
    bright = glpath.render(scene, **T_BUFFER)
    assert (bright.mean >= film.mean).all()
    assert (bright.mean > film.mean).mean() > 0.002


def _asks_nothing(shadows: stream_shadows.StreamShadows, uniforms: object) -> None:
    texture, _ = shadows._words.read
    texture.write(bytes(4 * texture.width * texture.height))


def test_intersections_that_a_raster_finds_are_those_of_triangles_in_memory() -> None:
    options = {**T_BUFFER, "shadows": "cube", "shadow_resolution": 64, "count_tests": True}
    streamed, whole = (
        glpath.render(scene, **options).metadata.statistics["intersection_tests"]
        for scene in both(Hills(2, 9), **LAMPS)
    )
    assert streamed["primary"] == whole["primary"] > 0
    assert streamed["shadow_buffer"] == whole["shadow_buffer"] > 0
    assert streamed["shadow"] > 0
    assert streamed["secondary"] == 0


def test_frames_of_a_moving_camera_are_those_of_a_still_one_and_keep_what_they_read() -> None:
    hills = Watched(3, 8)
    scene, _ = both(hills, **LAMPS)
    views = [{"position": (x, 3.0, 6.0)} for x in (-1.0, 0.5)]
    for shadows in ("rays", "cube"):
        options = {"integrator": "t-buffer", "spp": 1, "shadows": shadows}
        films = list(glpath.render_frames(scene, views, **options))
        for film, view in zip(films, views, strict=True):
            alone = glpath.render(scene.with_camera(**view), **options)
            np.testing.assert_array_equal(film.mean, alone.mean)


def test_a_large_budget_reads_chunks_once_and_a_small_one_for_each_path_set() -> None:
    hills = Watched(4, 24)
    scene, _ = both(hills, **LAMPS)
    reads = []
    for budget in (64, 4):
        hills.asked.clear()
        glpath.render(scene, integrator="t-buffer", spp=5, geometry_budget=budget)
        reads.append(len(hills.asked))
    # How far they reach; where they are drawn, those that are seen; and as occluders.
    assert reads[0] <= 3 * len(hills)
    assert reads[1] >= 5 * len(hills)


def test_what_the_view_cannot_see_is_not_drawn() -> None:
    hills = Watched(4, 8)
    # No light has rays, so that chunks are read for the eye alone.
    camera = {"position": [-2.9, 4, 2.9], "target": [-2.2, 0, 2.2], "fov": 25}
    base = {"camera": camera, "film": {"resolution": [24, 24]}, "ambient": 0.5}
    scene = glpath.load_scene({**base, "shapes": [{"type": "stream", "stream": hills}]})
    whole = glpath.load_scene({**base, "shapes": [in_memory(corners(hills))]})
    hills.asked.clear()
    film = glpath.render(scene, **T_BUFFER, geometry_budget=1)
    assert set(range(16)) == set(hills.asked[:16])  # how far the scene extends
    assert 0 < len(set(hills.asked[16:])) < 10
    np.testing.assert_array_equal(film.mean, glpath.render(whole, **T_BUFFER).mean)


@pytest.mark.parametrize("shadows", ["rays", "cube"])
def test_a_budget_without_room_for_a_chunk_is_refused_with_what_is_needed(shadows: str) -> None:
    scene, _ = both(Hills(1, 64), **LAMPS)
    options = {"integrator": "t-buffer", "spp": 1, "shadows": shadows}
    with pytest.raises(glpath.UsageError, match=r"geometry_budget: 4 MiB, but \d+ are needed at least") as error:
        glpath.render(scene, **options, geometry_budget=4)
    needed = int(error.value.message.split("but ")[1].split()[0])
    with pytest.raises(glpath.UsageError, match="are needed at least"):
        glpath.render(scene, **options, geometry_budget=needed - 1)
    glpath.render(scene, **options, geometry_budget=needed)


SHINY = {
    "materials": {
        "grass": {"reflectance": [0.3, 0.6, 0.3]},
        "clay": {"type": "principled", "reflectance": 0.5, "roughness": 0.4},
        "chrome": {"type": "phong", "mirror": 0.9},
    }
}


def test_reflections_of_streamed_triangles_are_refused_and_highlights_are_not() -> None:
    scenes = both(Hills(2, 6), **{**LAMPS, **SHINY})
    with pytest.raises(glpath.SceneError, match=r"materials that reflect \(clay\); with max_depth 5") as error:
        glpath.render(scenes[0], integrator="t-buffer", spp=1)
    assert "max_depth=1" in error.value.remedy
    assert 'integrator="path-buffer"' in error.value.remedy
    assert_bits_in_memory(scenes, max_depth=1)
    # What no shape has reflects nothing.
    unused = {"materials": {**SHINY["materials"], "clay": {"reflectance": [0.7, 0.2, 0.2]}}}
    assert_bits_in_memory(both(Hills(2, 6), **{**LAMPS, **unused}))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"type": "panorama"}, "which no panorama can see"),
        ({"shutter": [0, 1]}, "which cannot be where other shapes move"),
    ],
)
def test_what_streams_cannot_be_with_is_said(change: dict[str, Any], said: str) -> None:
    keys = [{"time": 0, "transform": []}, {"time": 1, "transform": [{"translate": [1, 0, 0]}]}]
    ball = {"type": "sphere", "center": [0, 1, 0], "radius": 0.2, "motion": keys if "shutter" in change else []}
    camera = {"position": [0, 2, 6], "target": [0, 0, 0], **change}
    shapes = [{"type": "stream", "stream": Hills(1, 2)}, ball]
    scene = glpath.load_scene({"camera": camera, "shapes": shapes, "sky": {"zenith": 1}})
    with pytest.raises(glpath.SceneError, match=said):
        glpath.render(scene, spp=1, integrator="t-buffer", resolution=(32, 16))


def test_the_budget_decides_nothing_of_the_picture() -> None:
    scene, _ = both(Hills(1, 4), **LAMPS)
    films = [glpath.render(scene, **T_BUFFER, geometry_budget=budget) for budget in (2, 64)]
    assert "geometry_budget" not in films[0].metadata.settings
    assert films[0].metadata.settings == films[1].metadata.settings


def test_three_hundred_thousand_triangles_stay_within_64_mebibytes() -> None:
    small, large = (memory_of(tiles, 64, "t-buffer") for tiles in (1, 3))  # of 32,768 triangles
    print(f"one tile {small}, 294,912 triangles {large}")
    # Eight tiles more: in memory they would take 200 MiB.
    assert large["peak"] - small["peak"] < 64
    assert large["lit"] > 0.3
