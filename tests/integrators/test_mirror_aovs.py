"""Albedo and normal of mirrors and clear glass: those of what they show, where rays are cast."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.aovs import DENOISER_AOVS
from glpath.scene.background import Background

MIRROR_SCENE: dict[str, object] = {
    "camera": {"position": [0.0, 1.0, 3.0], "target": [0.0, 1.0, 0.0], "fov": 40},
    "materials": {
        "red": {"reflectance": [0.7, 0.2, 0.1]},
        "blue": {"reflectance": [0.1, 0.2, 0.6]},
    },
    "sky": {"zenith": 1.0, "horizon": 1.0},
    "shapes": [],
}


GOLD: dict[str, object] = {
    "type": "principled",
    "reflectance": [0.9, 0.8, 0.5],
    "roughness": 0.0,
    "metallic": 1.0,
}


def _wall(z: float, material: str, half: float, facing: int) -> dict[str, object]:
    """A square about the camera's height, at z, that faces +z or -z."""
    corners = [[-half, 1 - half, z], [half, 1 - half, z], [half, 1 + half, z], [-half, 1 + half, z]]
    return {"type": "quad", "corners": corners[::facing], "material": material}


def _in_the_middle(clear: dict[str, object], behind: list[dict[str, object]], **options: Any) -> tuple[Any, Any]:
    """Albedo and normal in the middle of a picture of a square of a clear material, and other squares."""
    materials = {**MIRROR_SCENE["materials"], "clear": clear}  # type: ignore[dict-item]
    scene = {**MIRROR_SCENE, "materials": materials, "shapes": [_wall(0.0, "clear", 1.0, 1), *behind]}
    film = glpath.render(scene, spp=1, resolution=(9, 9), aovs=DENOISER_AOVS, **{"integrator": "path", **options})
    return film.aov("albedo")[4, 4], film.aov("normal")[4, 4]


def test_a_mirror_has_the_albedo_and_normal_of_what_it_shows_by_its_share() -> None:
    red = _wall(5.0, "red", 4.0, -1)  # behind the eye
    albedo, normal = _in_the_middle(GOLD, [red])
    assert np.allclose(albedo, np.array([0.9, 0.8, 0.5]) * [0.7, 0.2, 0.1], atol=1e-4)
    assert np.allclose(normal, [0, 0, -1], atol=1e-5)
    # And of the sky, where it shows that.
    albedo, normal = _in_the_middle(GOLD, [])
    assert np.allclose(albedo, [0.9, 0.8, 0.5], atol=1e-4)
    assert np.allclose(normal, 0, atol=1e-5)
    # Two that face each other end where the rays are not followed any more.
    albedo, _ = _in_the_middle(GOLD, [_wall(5.0, "clear", 4.0, -1)])
    assert np.allclose(albedo, np.array([0.9, 0.8, 0.5]) ** 7, atol=1e-3)


def test_what_is_rough_or_shows_little_has_its_own_albedo() -> None:
    red = _wall(5.0, "red", 4.0, -1)
    for own in (
        {"type": "principled", "roughness": 0.3, "metallic": 1.0},
        {"type": "principled", "roughness": 0.0},
        {"type": "phong", "mirror": 0.2},
    ):
        albedo, normal = _in_the_middle({"reflectance": [0.6, 0.5, 0.4], **own}, [red])
        assert np.allclose(normal, [0, 0, 1], atol=1e-5), own
        assert albedo[0] > 0.5, own


@pytest.mark.parametrize("thin", [True, False])
def test_behind_clear_glass_is_what_one_sees(thin: bool) -> None:
    glass: dict[str, object] = {
        "type": "principled",
        "reflectance": [1.0, 1.0, 1.0],
        "roughness": 0.0,
        "transmission": 1.0,
        "ior": 1.5,
        "thin": thin,
    }
    blue = _wall(-2.0, "blue", 4.0, 1)
    albedo, normal = _in_the_middle(glass, [blue, _wall(5.0, "red", 4.0, -1)])
    assert np.allclose(albedo, np.array([0.1, 0.2, 0.6]) * 0.96, atol=2e-3)
    assert np.allclose(normal, [0, 0, 1], atol=1e-5)


def test_phongs_mirror_is_one_too_and_the_t_buffer_has_the_mirrors_own() -> None:
    red = _wall(5.0, "red", 4.0, -1)
    albedo, _ = _in_the_middle({"type": "phong", "mirror": [0.9, 0.8, 0.5], "reflectance": 0.0}, [red])
    assert np.allclose(albedo, np.array([0.9, 0.8, 0.5]) * [0.7, 0.2, 0.1], atol=1e-4)
    own, facing = _in_the_middle(GOLD, [red], integrator="t-buffer")
    assert np.allclose(facing, [0, 0, 1], atol=1e-5)
    assert np.allclose(own, [0.9, 0.8, 0.5], atol=1e-4)


def test_a_mirror_shows_the_sky_and_glass_the_background() -> None:
    base = {**MIRROR_SCENE, "sky": {"zenith": 0.3, "horizon": 0.3}}
    pane = {"type": "principled", "reflectance": 1.0, "roughness": 0.0, "transmission": 1.0, "thin": True}
    seen = {}
    for name, clear in (("mirror", GOLD), ("pane", pane), ("solid", {**pane, "thin": False})):
        scene = {**base, "materials": {"clear": clear}, "shapes": [_wall(0.0, "clear", 1.0, 1)]}
        shown = replace(glpath.load_scene(scene), background=Background(np.array([0.1, 0.7, 0.2])))
        film = glpath.render(shown, integrator="path", spp=1, resolution=(9, 9), aovs=DENOISER_AOVS)
        seen[name] = film.aov("albedo")[4, 4]
    assert np.allclose(seen["mirror"], 0.3 * np.array([0.9, 0.8, 0.5]), atol=1e-4)
    assert np.allclose(seen["solid"], 0.3 * 0.96, atol=2e-3)
    assert np.allclose(seen["pane"], 0.96 * np.array([0.1, 0.7, 0.2]), atol=2e-3)


def test_what_is_masked_is_not_seen_in_a_mirror() -> None:
    masked = {"reflectance": [0.1, 0.9, 0.1], "alpha": "mask", "opacity": 0.2, "cutoff": 0.5}
    materials = {**MIRROR_SCENE["materials"], "clear": GOLD | {"reflectance": 1.0}, "masked": masked}  # type: ignore[dict-item]
    shapes = [_wall(0.0, "clear", 1.0, 1), _wall(4.0, "masked", 4.0, -1), _wall(5.0, "red", 4.0, -1)]
    scene = {**MIRROR_SCENE, "materials": materials, "shapes": shapes}
    film = glpath.render(scene, integrator="path", spp=1, resolution=(9, 9), aovs=DENOISER_AOVS)
    assert np.allclose(film.aov("albedo")[4, 4], [0.7, 0.2, 0.1], atol=1e-4)
