"""The ray tracer against a slow one in numpy, and its ways to find light against each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.gl import passes
from glpath.rendering import tiles
from glpath.sampling.points import pixel_sample
from glpath.scene.model import Float64, Light, Material, Scene, Sky, Texture, TextureSlot
from tests.reference import numpy_ray_tracer
from tests.support.objects import ball, camera, ground, rotation, scene_of


def unit(*v: float) -> Float64:
    return np.array(v) / np.linalg.norm(v)


def pictures() -> tuple[Texture, Texture]:
    rng = np.random.default_rng(3)
    checker = np.zeros((2, 2, 3), np.float32)
    checker[0, 0] = checker[1, 1] = 0.9
    checker[0, 1] = checker[1, 0] = (0.1, 0.2, 0.5)
    odd = rng.random((5, 7, 3)).astype(np.float32)
    return Texture("checker", checker, filter="nearest"), Texture("odd", odd, (4.0, 2.0))


POINT = Light("point", "point", np.array([60.0, 60, 50]), position=np.array([3.0, 5, 4]))
SPOT = Light(
    "spot",
    "spot",
    np.array([80.0, 20, 20]),
    position=np.array([-4.0, 4, 2]),
    direction=unit(0.7, -0.7, -0.3),
    cone=(15.0, 25.0),
)
SUN = Light("sun", "directional", np.array([0.3, 0.3, 0.5]), direction=unit(0.6, -0.7, -0.4))
SKY = Sky(np.array([0.2, 0.4, 0.9]), np.array([0.8, 0.85, 0.9]))


def everything(**changes: Any) -> Scene:
    """All kinds of objects and lights, textures, highlights and mirrors."""
    rng = np.random.default_rng(0)
    ellipsoid = np.concatenate([rotation(rng) @ np.diag([0.3, 0.8, 0.5]), [[1.3], [-1.2], [1.6]]], axis=1)
    triangles = [[[-3, -2, -2], [-1, -2, -3], [-2, 1.5, -2.5]], [[2, -2, -1], [3.5, -2, -2], [3, 2, -2]]]
    grey = np.full(3, 1.0)
    shiny = Material("shiny", np.array([0.6, 0.3, 0.2]), True, 0.4 * grey, 40.0, 0.3 * grey, TextureSlot(1))
    silver = Material("silver", 0.2 * grey, mirror=0.7 * grey)
    matt = Material("matt", np.array([0.2, 0.7, 0.3]), specular=0.2 * grey, exponent=10.0)
    one_sided = Material("one-sided", np.array([0.6, 0.6, 0.2]), two_sided=False)
    floor = Material("floor", 0.7 * grey, mirror=0.2 * grey, texture=TextureSlot(0))
    fields: dict[str, Any] = {
        "spheres": [
            ball((0, -1, 0), 1, rotation(rng)),
            ball((1.5, -0.3, -1.2), 0.9),
            ellipsoid,
            ball((-1.4, -1.6, 1), 0.4),
        ],
        "triangles": triangles,
        "planes": [ground(-2)],
        "materials": [shiny, silver, matt, matt, one_sided, floor],
        "triangle_uv": rng.random((2, 3, 2)),
        "textures": pictures(),
        "lights": (SUN, POINT, SPOT),
        "ambient": np.array([0.1, 0.1, 0.12]),
        "sky": SKY,
        "view": camera((0, 0.8, 7), (0, -0.5, 0), fov=45, resolution=(96, 72)),
    }
    return scene_of(**(fields | changes))


def assert_as_reference(scene: Scene, max_depth: int = 1, share: float = 0.004, **options: Any) -> None:
    """All but `share` of the pixels as the slow tracer has them; edges may fall a pixel aside."""
    ours = glpath.render(scene, spp=1, max_depth=max_depth, **({"integrator": "t-buffer"} | options)).mean
    theirs = numpy_ray_tracer.render(scene, max_depth)
    off = np.abs(ours - theirs).max(axis=-1) > 1e-4 * (0.1 + theirs.max(axis=-1))
    assert off.mean() <= share
    assert theirs.std() > 0.01


@pytest.mark.parametrize("integrator", ["classic", "t-buffer"])
@pytest.mark.parametrize("secondary", ["classic", "bvh"])
def test_everything_is_as_a_slow_tracer_has_it(integrator: str, secondary: str) -> None:
    assert_as_reference(everything(), 4, integrator=integrator, secondary=secondary)


@pytest.mark.parametrize("lights", [(), (POINT,), (SPOT,), (SUN,), (SPOT, SUN), (POINT, POINT, SPOT)])
def test_lights_of_all_kinds(lights: tuple[Light, ...]) -> None:
    assert_as_reference(everything(lights=lights), 1)


def test_a_light_without_falloff_and_a_spot_with_a_sharp_edge() -> None:
    plain = replace(POINT, falloff="none", intensity=np.array([2.0, 1.5, 1]))
    assert_as_reference(everything(lights=(plain, replace(SPOT, cone=(20.0, 20.0)))), 2)


def test_all_engines_draw_the_same_bits() -> None:
    films = [
        glpath.render(everything(), integrator=integrator, secondary=secondary, spp=2, max_depth=5).mean
        for integrator in ("classic", "t-buffer")
        for secondary in ("classic", "bvh")
    ]
    for film in films[1:]:
        np.testing.assert_array_equal(film, films[0])


@pytest.mark.parametrize("integrator", ["classic", "t-buffer"])
def test_a_picture_in_many_draws_is_that_in_one(monkeypatch: pytest.MonkeyPatch, integrator: str) -> None:
    """So that none runs into a watchdog."""
    options: dict[str, Any] = {"integrator": integrator, "secondary": "classic", "count_tests": True, "spp": 2}
    whole = glpath.render(everything(), **options)
    monkeypatch.setattr(passes, "TESTS_PER_DRAW", 20_000)
    parts = glpath.render(everything(), **options)
    np.testing.assert_array_equal(whole.radiance_sums, parts.radiance_sums)
    counted = [film.metadata.statistics["intersection_tests"] for film in (whole, parts)]
    assert counted[0] == counted[1]


@pytest.mark.parametrize(("size", "tests"), [((640, 480), 1), ((640, 480), 10**6), ((5, 3), 10**9), ((1, 1), 0)])
def test_no_draw_has_more_tests_than_is_stated(size: tuple[int, int], tests: int) -> None:
    areas = passes.draw_areas(size, tests)
    covered = np.zeros(size, int)
    for x, y, width, height in areas:
        assert width * height == 1 or width * height * tests <= passes.TESTS_PER_DRAW
        covered[x : x + width, y : y + height] += 1
    assert np.all(covered == 1)
    assert (len(areas) == 1) == (size[0] * size[1] * tests <= passes.TESTS_PER_DRAW)


@pytest.mark.parametrize("count", [1, 5, 400])
def test_the_bvh_changes_nothing_in_crowds(count: int) -> None:
    rng = np.random.default_rng(count)
    mirror = Material("mirror", np.full(3, 0.2), mirror=np.array([0.6, 0.7, 0.8]))
    scene = everything(
        spheres=[ball(rng.uniform(-2, 2, 3), rng.uniform(0.05, 0.4)) for _ in range(count)],
        triangles=rng.uniform(-2, 2, (count, 1, 3)) + 0.3 * rng.normal(size=(count, 3, 3)),
        triangle_uv=np.zeros((count, 3, 2)),
        materials=[mirror],
    )
    films = [
        glpath.render(scene, integrator="t-buffer", spp=1, max_depth=4, secondary=secondary, count_tests=True)
        for secondary in ("classic", "bvh")
    ]
    np.testing.assert_array_equal(films[0].mean, films[1].mean)
    tests = [film.metadata.statistics["intersection_tests"] for film in films]
    if count == 400:
        assert tests[1]["secondary"] < 0.05 * tests[0]["secondary"]
        assert tests[1]["shadow"] < 0.1 * tests[0]["shadow"]


def test_reflections_end_at_max_depth() -> None:
    """Between two parallel mirrors a ray gains the same light at every reflection."""
    mirror = Material("mirror", np.zeros(3), mirror=np.full(3, 0.5))
    walls = [np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, s, -3 * s]], float) for s in (1.0, -1.0)]
    scene = scene_of(planes=walls, materials=[mirror], view=camera((0, 0, 0), (0.1, 0.2, -1), resolution=(8, 8)))
    shapes = tuple(replace(shape, emission=np.ones(3)) for shape in scene.shapes)
    scene = replace(scene, shapes=shapes, ambient=np.full(3, 1e-9))
    for depth in (1, 2, 3, 6):
        film = glpath.render(scene, integrator="t-buffer", spp=1, max_depth=depth)
        np.testing.assert_allclose(film.mean, 2 - 0.5 ** (depth - 1), rtol=1e-5)


def test_inside_a_sphere_with_its_light() -> None:
    """A matt sphere about its light at the centre is lit alike everywhere: rho I / (pi r^2)."""
    light = Light("lamp", "point", np.array([10.0, 20, 30]))
    scene = scene_of(spheres=[ball((0, 0, 0), 2.0)], lights=(light,), view=camera((0.3, 0.2, 1)))
    for shadows in ("rays", "sphere", "cube"):
        film = glpath.render(scene, integrator="t-buffer", spp=1, max_depth=3, shadows=shadows)
        expected = np.broadcast_to(0.5 * light.intensity / (np.pi * 4), film.mean.shape)
        np.testing.assert_allclose(film.mean, expected, rtol=1e-5)


@pytest.mark.parametrize("scale", [2.0**-13, 1.0, 2.0**13])  # by which floats are not rounded
def test_a_huge_ground_and_any_unit_of_length(scale: float) -> None:
    """The sums of a film have bits for what is seen, whatever the size of the scene and the power of its lights."""
    lamp = replace(POINT, intensity=POINT.intensity * scale**2, position=scale * POINT.position)
    scene = scene_of(
        spheres=[ball((0, -1e5 * scale, 0), (1e5 - 1) * scale), ball((0, 0, 0), scale)],
        lights=(lamp,),
        view=camera((0, scale, 6 * scale)),
    )
    assert_as_reference(scene, 2)
    dim = replace(scene, lights=(replace(lamp, intensity=1e-6 * lamp.intensity),))
    films = [glpath.render(s, integrator="t-buffer", spp=1, max_depth=2).mean for s in (scene, dim)]
    np.testing.assert_allclose(films[1], 1e-6 * films[0], rtol=1e-5, atol=1e-6 * films[1].max())


def test_a_light_inside_an_object_lights_nothing_outside() -> None:
    scene = scene_of(
        spheres=[ball((0, 1, 0), 0.5)],
        planes=[ground(-1)],
        lights=(Light("hidden", "point", np.full(3, 50.0), position=np.array([0.1, 1, 0])),),
    )
    with pytest.warns(glpath.SceneWarning, match="hidden"):
        film = glpath.render(scene, integrator="t-buffer", spp=1)
    assert film.mean.max() == 0


def test_without_light_it_is_dark_and_said_so() -> None:
    scene = scene_of(spheres=[ball((0, 0, 0), 1)])
    with pytest.warns(glpath.SceneWarning, match="black"):
        assert glpath.render(scene, integrator="t-buffer", spp=1).mean.max() == 0
    lamp = replace(scene, shapes=(replace(scene.shapes[0], emission=np.ones(3)),))
    assert glpath.render(lamp, integrator="t-buffer", spp=1).mean.max() == pytest.approx(1)


def test_a_plane_that_emits_is_seen_and_said_to_light_nothing() -> None:
    scene = scene_of(planes=[ground(-1)])
    lamp = replace(scene, shapes=(replace(scene.shapes[0], emission=np.ones(3)),))
    with pytest.warns(glpath.SceneWarning, match="lights nothing"):
        assert glpath.render(lamp, integrator="t-buffer", spp=1).mean.max() == pytest.approx(1)


@pytest.mark.parametrize("shadows", ["sphere", "cube"])
def test_shadow_buffers_come_close_to_shadow_rays(shadows: str) -> None:
    scene = everything(lights=(SUN, POINT, SPOT))
    exact = glpath.render(scene, integrator="t-buffer", spp=1, max_depth=3).mean
    shares = []
    for resolution in (64, 256, 1024):
        film = glpath.render(
            scene,
            integrator="t-buffer",
            spp=1,
            max_depth=3,
            shadows=shadows,
            shadow_resolution=resolution,
            shadow_filter=1,
        )
        shares.append(np.mean(np.abs(film.mean - exact).max(axis=-1) > 0.01))
    assert shares[0] > shares[1] > shares[2]
    assert shares[2] < 0.006


def test_tiles_have_the_bits_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"integrator": "t-buffer", "spp": 3, "max_depth": 3, "count_tests": True}
    whole = glpath.render(everything(), **options)
    monkeypatch.setattr(tiles, "MAX_PATHS", 700)
    tiled = glpath.render(everything(), **options)
    np.testing.assert_array_equal(tiled.mean, whole.mean)


def test_a_film_goes_on_and_merges_bit_for_bit() -> None:
    options: dict[str, Any] = {"integrator": "t-buffer", "max_depth": 2, "shadows": "cube", "shadow_resolution": 64}
    whole = glpath.render(everything(), spp=24, **options)
    parts = [glpath.render(everything(), spp=12, first_path_set=start, **options) for start in (0, 12)]
    np.testing.assert_array_equal(parts[0].merge(parts[1]).mean, whole.mean)


def test_more_samples_smooth_the_edges() -> None:
    scene = scene_of(spheres=[ball((0, 0, 0), 1.5)], ambient=np.full(3, 2.0), sky=Sky(np.zeros(3), np.zeros(3)))
    films = [glpath.render(scene, integrator="t-buffer", spp=spp).mean for spp in (1, 4, 64, 256)]
    assert set(np.unique(films[0])) == {0.0, 1.0}
    errors = [np.sqrt(np.mean((film - films[-1]) ** 2)) for film in films[:-1]]
    assert errors[0] > 1.8 * errors[1]
    assert errors[1] > 4 * errors[2]


def test_the_places_in_the_pixel_fill_it_evenly() -> None:
    assert pixel_sample(0, 0) == (0.5, 0.5) == pixel_sample(7, 0)
    for seed in (0, 7):
        places = np.array([pixel_sample(seed, i) for i in range(4096 + 64)])
        assert places.min() >= 0
        assert places.max() < 1
        # Any 16 from a multiple of 16 on: one in each of 4 x 4 parts, and in each of 16 strips either way.
        for first in (0, 16, 256, 4096 - 16):
            some = places[first : first + 16]
            assert len({(int(4 * x), int(4 * y)) for x, y in some}) == 16
            for axis in (0, 1):
                assert len({int(16 * v) for v in some[:, axis]}) == 16
        assert abs(places.mean(axis=0) - 0.5).max() < 0.005
        assert np.ptp(places[4096:], axis=0).min() > 0.9
    assert pixel_sample(0, 5) != pixel_sample(7, 5)


def test_frames_keep_shadow_buffers_and_are_the_pictures_of_render() -> None:
    scene = everything()
    options: dict[str, Any] = {"integrator": "t-buffer", "shadows": "cube", "spp": 1, "shadow_resolution": 128}
    cameras = [{"position": (4 * np.sin(a), 0.8, 4 * np.cos(a))} for a in (0.0, 0.4, 0.8)]
    films = list(glpath.render_frames(scene, cameras, count_tests=True, **options))
    tests = [film.metadata.statistics["intersection_tests"] for film in films]
    assert tests[0]["shadow_buffer"] > 0
    assert [test["shadow_buffer"] for test in tests[1:]] == [0, 0]
    for film, view in zip(films, cameras, strict=True):
        np.testing.assert_array_equal(film.mean, glpath.render(scene, camera=view, **options).mean)
    assert len({film.metadata.scene_hash for film in films}) == 3


def test_frames_fill_again_what_has_moved() -> None:
    options: dict[str, Any] = {"integrator": "t-buffer", "shadows": "sphere", "spp": 1, "shadow_resolution": 64}
    moved_light = everything(lights=(SUN, POINT, replace(SPOT, position=np.array([-3.0, 4, 2]))))
    moved_ball = everything(planes=[ground(-2.2)])
    repainted = everything(ambient=np.array([0.3, 0.1, 0.1]))
    scenes = [everything(), repainted, moved_light, moved_light, moved_ball, everything(lights=(POINT,))]
    films = list(glpath.render_frames(scenes[0], scenes, count_tests=True, **options))
    filled = [film.metadata.statistics["intersection_tests"]["shadow_buffer"] for film in films]
    assert filled[1] == filled[3] == 0
    assert 0 < filled[2] < 0.8 * filled[0]  # one light of two
    assert filled[4] > filled[2]
    for film, scene in zip(films, scenes, strict=True):
        np.testing.assert_array_equal(film.mean, glpath.render(scene, **options).mean)


def test_tests_are_counted_exactly() -> None:
    """Of a lit plane and a ball out of the way, all counts are known."""
    mirror = Material("mirror", np.full(3, 0.5), mirror=np.full(3, 0.5))
    scene = scene_of(
        spheres=[ball((30, 2.5, 0), 0.1)],
        planes=[ground(-2)],
        materials=[mirror],
        lights=(POINT, SUN),
        view=camera((0, 4, 0.1), (0, -2, 0), fov=20, resolution=(32, 32)),
    )
    pixels = 32 * 32
    # Two primitives; a ray by the BVH misses the ball's box, and so does every ray that the T-buffer shoots.
    for integrator, secondary, primary_each, other_each in (
        ("classic", "classic", 2, 2),
        ("classic", "bvh", 2, 1),
        ("t-buffer", "classic", 1, 2),
        ("t-buffer", "bvh", 1, 1),
    ):
        film = glpath.render(
            scene, integrator=integrator, secondary=secondary, spp=2, max_depth=3, count_tests=True
        )
        assert film.metadata.statistics["intersection_tests"] == {
            "primary": 2 * primary_each * pixels,
            "shadow_buffer": 0,
            "shadow": 2 * 2 * other_each * pixels,
            "secondary": 2 * other_each * pixels,
        }
    film = glpath.render(
        scene, integrator="t-buffer", spp=1, shadows="cube", shadow_resolution=32, count_tests=True
    )
    tests = film.metadata.statistics["intersection_tests"]
    assert tests["shadow"] == other_each * pixels  # to the sun
    assert tests["shadow_buffer"] >= 3 * 32 * 32  # the lower half of the cube sees the plane


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"integrator": "rays"}, "path, path-buffer, gather, classic, t-buffer"),
        ({"integrator": "classic", "directions": "pair"}, "directions"),
        ({"integrator": "path", "shadows": "cube"}, "shadows"),
        ({"shadows": "pyramid"}, "rays, sphere, cube"),
        ({"shadow_resolution": 64}, "shadow-buffers"),
        ({"shadows": "cube", "shadow_resolution": 0}, "shadow_resolution"),
        ({"shadows": "cube", "shadow_filter": 99}, "shadow_filter"),
        ({"shadows": "cube", "shadow_test": "depth"}, "distance, identity"),
        ({"secondary": "octree"}, "classic, bvh"),
        ({"spp": 0}, "spp"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.UsageError) as caught:
        glpath.render(everything(), **({"integrator": "t-buffer"} | options))
    assert words in str(caught.value)


def test_textures_are_filtered_across_their_seams() -> None:
    """Over a plane much larger than its picture, seen from above: every texel, wrapped both ways."""
    odd = pictures()[1]
    plain = Material("plain", np.ones(3), texture=TextureSlot(0))
    one_texel, turned = replace(odd, image=odd.image[:1, :1]), replace(odd, scale=(0.3, -0.7))
    for picture in (odd, replace(odd, filter="nearest"), one_texel, turned):
        scene = scene_of(
            planes=[ground(0)],
            materials=[plain],
            textures=(picture,),
            ambient=np.ones(3),
            view=camera((0.3, 3, 0.2), (0.3, 0, 0.1), fov=60),
        )
        ours = glpath.render(scene, integrator="t-buffer", spp=1).mean
        theirs = numpy_ray_tracer.render(scene)
        assert np.mean(np.abs(ours - theirs).max(axis=-1) > 1e-3) < 0.002
        assert relative_mse(ours, theirs) < 1e-3
