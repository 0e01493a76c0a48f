"""The tree that chooses lights: its own chances, and pictures under many lights against closed forms."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.integrators import ray_paths
from glpath.io import load_scene
from glpath.lights.lighting import Lighting
from glpath.lights.tree import MAX_DEPTH, Emitters, LightTree, others, positional
from glpath.scene import Scene
from tests.support.photometry import ies

UP = [0.0, 1.0, 0.0]


def profile(folder: Path) -> Path:
    """Most of it sideways, and nothing from 70 degrees on."""
    gamma = np.linspace(0, 90, 19)
    candela = np.where(gamma < 70, 100 + 4 * gamma, 0.0)
    return ies(folder / "lamp.ies", gamma, np.array([0.0]), candela[None])


def lamps(folder: Path) -> list[dict[str, Any]]:
    """Points, spots and luminaires above a floor, 27 of them, and one that does not fall off."""
    rng = np.random.default_rng(4)
    found: list[dict[str, Any]] = []
    for kind in range(3):
        for x, y, z in rng.uniform([-4, 1, -3], [4, 4, 3], (9, 3)):
            lamp: dict[str, Any] = {
                "type": "point",
                "position": [x, y, z],
                "intensity": rng.uniform(1, 5, 3).tolist(),
            }
            if kind == 1:
                cone = [10 + 8 * abs(x), 30 + 20 * abs(z)]
                lamp |= {"type": "spot", "target": [x + 1, 0, z - 1], "cone": cone}
            if kind == 2:
                lamp |= {"profile": str(profile(folder)), "direction": [0.2 * x, -1, 0.1]}
            found.append(lamp)
    return [*found, {"type": "point", "position": [0, 3, 0], "intensity": 0.5, "falloff": "none"}]


def floor(lights: list[dict[str, Any]], *shapes: dict[str, Any], **tables: Any) -> Scene:
    """Seen from straight above, 8 x 6."""
    corners = [[-4, 0, 3], [4, 0, 3], [4, 0, -3], [-4, 0, -3]]
    return load_scene(
        {
            "camera": {
                "type": "orthographic",
                "position": [0, 9, 0],
                "target": [0, 0, 0],
                "up": [0, 0, -1],
                "height": 6,
            },
            "film": {"resolution": [24, 18]},
            "materials": {"floor": {"reflectance": 0.5}},
            "shapes": [{"type": "quad", "corners": corners, "material": "floor"}, *shapes],
            "lights": lights,
            **tables,
        }
    )


def positions() -> Any:
    x, z = np.meshgrid((np.arange(24) + 0.5) / 3 - 4, (np.arange(18) + 0.5) / 3 - 3)
    return np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)


def furnace(**material: Any) -> Scene:
    """A closed box of 54 walls that all emit: with a reflectance of one half the radiance is one."""
    shapes = []
    cuts = np.linspace(-1, 1, 4)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            for a, b in itertools.pairwise(cuts):
                for c, d in itertools.pairwise(cuts):
                    u, v = ((a, c), (b, c), (b, d), (a, d)), []
                    for p, q in u if sign < 0 else u[::-1]:
                        v.append(np.roll([sign, p, q], axis).tolist())
                    shapes.append({"type": "quad", "corners": v, "material": "wall", "emission": {"radiance": 0.5}})
    return load_scene(
        {
            "camera": {"position": [0.1, 0, 0.5], "target": [0, 0, -1], "fov": 70},
            "film": {"resolution": [32, 32]},
            "materials": {"wall": {"reflectance": 0.5, **material}},
            "shapes": shapes,
        }
    )


@pytest.mark.parametrize("count", [2, 3, 40, 3000])
def test_a_trail_leads_to_its_emitter(count: int) -> None:
    rng = np.random.default_rng(count)
    axis = rng.normal(size=(count, 3))
    emitters = Emitters(
        corners=rng.uniform(-5, 5, (count, 1, 3)) + rng.normal(scale=0.1, size=(count, 3, 3)),
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        inner=np.zeros(count),
        outer=np.full(count, 0.5 * np.pi),
        strength=rng.uniform(0.1, 3, count),
    )
    tree = LightTree.over(emitters)
    assert len(tree.child) == count - 1
    for number in range(count):
        node = 0
        for level in range(MAX_DEPTH):
            node = tree.child[node, tree.trail[number] >> level & 1]
            if node < 0:
                break
        assert node == -1 - number


def test_emitters_in_one_position_are_a_tree() -> None:
    count = 5000
    emitters = Emitters(
        corners=np.zeros((count, 3, 3)),
        axis=np.tile(UP, (count, 1)),
        inner=np.zeros(count),
        outer=np.full(count, 0.5 * np.pi),
        strength=np.ones(count),
    )
    chances = LightTree.over(emitters).chances(np.array([0.0, 2.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    np.testing.assert_allclose(chances, 1 / count, rtol=0.5)


def test_lights_outside_a_tree_are_found_in_linear_time() -> None:
    """6,000 lights took seconds, as each was compared with all others."""
    sun: dict[str, Any] = {"type": "directional", "direction": [0, -1, 0], "irradiance": 1.0}
    scene = floor([{"type": "point", "position": [0, 3, 0], "intensity": 1.0}, sun])
    lamp, above = scene.lights
    lighting = Lighting.of(replace(scene, lights=(*(replace(lamp, name=f"{i}") for i in range(6000)), above)))
    started = time.perf_counter()
    assert others(lighting).punctual == (above,)
    assert time.perf_counter() - started < 0.2


def test_every_light_that_arrives_can_be_chosen_and_no_bound_is_below_it(tmp_path: Path) -> None:
    lighting = Lighting.of(floor(lamps(tmp_path)))
    emitters = Emitters.of(lighting)
    tree, lights = LightTree.over(emitters), positional(lighting)
    assert len(lights) == len(emitters) == 27
    assert others(lighting).count == 1
    bounds: dict[int, float] = {}
    for position in positions()[::7]:
        chances = tree.chances(position, np.array(UP))
        assert chances.sum() <= 1 + 1e-12
        for node in range(len(tree.child)):
            each = tree.importance(node, position, np.array(UP))
            bounds |= {-1 - child: bound for child, bound in zip(tree.child[node], each, strict=True) if child < 0}
        for number, light in enumerate(lights):
            E = Lighting.of(replace(lighting.scene, lights=(light,))).irradiance(position, UP)[0].mean()
            assert (chances[number] > 0) >= (E > 0)
            assert 1.001 * bounds[number] + 1e-9 >= E


def test_a_floor_under_many_lights(tmp_path: Path) -> None:
    scene = floor(lamps(tmp_path))
    lighting = Lighting.of(scene)
    assert len(positional(lighting)) >= ray_paths._TREE_MIN
    E = lighting.irradiance(positions(), np.tile(UP, (18 * 24, 1))).reshape(18, 24, 3)
    film = glpath.render(scene, spp=2048, max_depth=1)
    ratio = film.mean / (E * 0.5 / np.pi)
    # A pixel is a patch, over which light that a cone ends is not linear.
    assert abs(ratio.mean() - 1) < 2e-3
    assert np.abs(np.median(ratio) - 1) < 2e-3
    assert np.abs(ratio - 1).mean() < 0.02


def test_points_under_many_lights(tmp_path: Path) -> None:
    scene, at = floor(lamps(tmp_path)), positions()[::5]
    E = Lighting.of(scene).irradiance(at, np.tile(UP, (len(at), 1)))
    found = glpath.irradiance(scene, at, UP, spp=512, max_depth=1).values
    assert abs((found / E).mean() - 1) < 5e-3


@pytest.mark.parametrize(
    "material",
    [{}, {"type": "principled", "roughness": 0.4, "reflectance": 0.5, "metallic": 0.0, "specular": 0.0}],
    ids=["diffuse", "lobes"],
)
def test_many_emitters_are_found_by_light_samples_and_by_directions_once(material: dict[str, Any]) -> None:
    """Shares with another density than the tree's would not sum to one."""
    film = glpath.render(furnace(**material), spp=256, max_depth=24)
    assert film.mean.mean() == pytest.approx(1.0, abs=2e-3)


def test_sets_under_many_lights_split_and_merge(tmp_path: Path) -> None:
    scene = floor(lamps(tmp_path))
    whole = glpath.render(scene, spp=6, max_depth=3)
    parts = [glpath.render(scene, spp=n, first_path_set=first, max_depth=3) for first, n in ((0, 2), (2, 4))]
    assert np.array_equal(whole.mean, parts[0].merge(parts[1]).mean)


@pytest.mark.parametrize("sky", [{"zenith": [0.2, 0.4, 1.0], "horizon": 0.5}, None])
def test_a_tree_finds_what_parts_of_all_lights_find(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sky: dict[str, Any] | None
) -> None:
    """Lamps of every kind, above and below a table, with and without a sky."""
    shapes: list[dict[str, Any]] = [
        {"type": "box", "min": [-1, 0.8, -1], "max": [1, 0.9, 1], "material": "floor"},
        {"type": "sphere", "center": [2, 1, 1], "radius": 0.3, "emission": {"radiance": 2}},
    ]
    for x in (-3, -1, 1, 3):
        corners = [[x, 2, 0], [x, 2, 1], [x - 0.5, 2.3, 1], [x - 0.5, 2.3, 0]]
        shapes.append({"type": "quad", "corners": corners, "emission": {"radiance": [3, 2, 1], "two_sided": True}})
    lights = [*lamps(tmp_path)[::3], {"type": "directional", "direction": [0.3, -1, 0.2], "irradiance": 1.0}]
    scene = floor(lights, *shapes, **({"sky": sky} if sky else {}))
    by_tree = glpath.render(scene, spp=512, max_depth=4).mean
    monkeypatch.setattr(ray_paths, "_TREE_MIN", 1 << 30)
    by_parts = glpath.render(scene, spp=512, max_depth=4).mean
    assert not np.array_equal(by_tree, by_parts)
    assert by_tree.mean() == pytest.approx(by_parts.mean(), rel=4e-3)


def test_more_triangles_than_a_tree_is_built_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = floor(lamps(tmp_path))
    by_tree = glpath.render(scene, spp=1, max_depth=1).mean
    monkeypatch.setattr(ray_paths, "_TREE_MAX", 26)
    few = glpath.render(scene, spp=1, max_depth=1).mean
    monkeypatch.setattr(ray_paths, "_TREE_MIN", 1 << 30)
    assert np.array_equal(few, glpath.render(scene, spp=1, max_depth=1).mean)
    assert not np.array_equal(few, by_tree)


def test_two_hundred_luminaires_in_an_office(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At as many sets, less than half the squared error of a look at eight parts of all lights."""
    path = str(profile(tmp_path))
    hung = [(0.3 + 0.6 * i, 2.9, 0.4 + 0.8 * j) for i in range(20) for j in range(10)]
    lights = [{"type": "point", "position": at, "profile": path} for at in hung]
    office = load_scene("office", {"resolution": 64})
    shapes = office.shapes.__class__(replace(shape, emission=np.zeros(3)) for shape in office.shapes)
    scene = replace(office, shapes=shapes, lights=floor(lights).lights)
    truth = glpath.render(scene, spp=256, first_path_set=1 << 16, max_depth=1).mean

    def error() -> float:
        return relative_mse(glpath.render(scene, spp=16, max_depth=1).mean, truth)

    by_tree = error()
    monkeypatch.setattr(ray_paths, "_TREE_MIN", 1 << 30)
    assert by_tree < 0.5 * error()
