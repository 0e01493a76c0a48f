"""Textures of a surface's layers: clearcoat, anisotropy, the dielectric's reflection; the clearcoat's own normals.

A texture of one colour is the factor that it multiplies; a tilted normal map is the tilted surface.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io.load import scene_from_dict
from glpath.scene.model import Float64, Material, Scene, Texture, TextureSlot
from tests.support.uniform_sky import plane_under_the_sky

GOLD = np.array([1.0, 0.8, 0.4])
BLACK = Material("m", np.zeros(3), roughness=1.0, specular_weight=0.0)


def lit_square(material: Material, *textures: Float64) -> Scene:
    """A square across the sight under a lamp in a black room, with textures of one texel each."""
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    light = {"radiance": 5.0, "two_sided": True}
    lamp = [[1.5, 2, 4], [1.5, -2, 4], [4.5, -2, 2], [4.5, 2, 2]]
    square = {"type": "quad", "corners": corners}
    made = scene_from_dict(
        {
            "camera": {"position": [0, 0, 10], "target": [0, 0, 0], "fov": 4},
            "film": {"resolution": [12, 12]},
            "materials": {"m": {"reflectance": 0.5}, "black": {"reflectance": 0}},
            "shapes": [
                square | {"material": "m"},
                {
                    "type": "quad",
                    "corners": lamp,
                    "material": "black",
                    "emission": light,
                },
            ],
        }
    )
    stored = tuple(Texture(f"t{i}", np.full((1, 1, len(t)), t, np.float32)) for i, t in enumerate(textures))
    return replace(made, materials=(material, made.materials[1]), textures=stored)


def seen(scene: Scene, **options: Any) -> Float64:
    options = {"spp": 256, "max_depth": 2, **options}
    return np.asarray(glpath.render(scene, **options).mean.mean(axis=(0, 1)))


def slot(number: int = 0) -> TextureSlot:
    return TextureSlot(number)


FACTORS: dict[str, tuple[Material, list[float], dict[str, Any]]] = {
    "clearcoat": (
        replace(BLACK, clearcoat=0.9, clearcoat_roughness=0.6, clearcoat_texture=slot()),
        [0.5, 0, 0],
        {"clearcoat": 0.45},
    ),
    "clearcoat roughness": (
        replace(BLACK, clearcoat=0.9, clearcoat_roughness=0.9, clearcoat_roughness_texture=slot()),
        [0, 0.5, 0],
        {"clearcoat_roughness": 0.45},
    ),
    "specular": (
        replace(BLACK, specular_weight=0.8, roughness=0.5, specular_texture=slot()),
        [0, 0, 0, 0.25],
        {"specular_weight": 0.2},
    ),
    "specular colour": (
        replace(BLACK, specular_weight=0.8, roughness=0.5, specular_colour_texture=slot()),
        [0.9, 0.5, 0.1],
        {"specular_colour": np.array([0.9, 0.5, 0.1])},
    ),
    "specular colour, clipped after its texture": (
        replace(
            BLACK, roughness=0.5, specular_weight=1.0, specular_colour=np.full(3, 50.0),
            specular_colour_texture=slot(),
        ),
        [0.9, 0.4, 0.1],
        {"specular_colour": 50 * np.array([0.9, 0.4, 0.1])},
    ),
    "sheen": (
        replace(BLACK, sheen=GOLD, sheen_roughness=0.5, sheen_texture=slot()),
        [0.3, 0.5, 0.9],
        {"sheen": GOLD * [0.3, 0.5, 0.9]},
    ),
    "anisotropy": (
        replace(BLACK, reflectance=GOLD, metallic=1.0, roughness=0.4, anisotropy=0.8, anisotropy_texture=slot()),
        [1.0, 0.5, 0.5],
        {"anisotropy": 0.4},
    ),
    "the tangent": (
        replace(
            BLACK, reflectance=GOLD, metallic=1.0, roughness=0.4, anisotropy=0.8, anisotropy_angle=20.0,
            anisotropy_texture=slot(),
        ),
        [0.5, 1.0, 1.0],
        {"anisotropy_angle": 110.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FACTORS)
def test_a_texture_of_one_colour_is_the_factor_it_multiplies(name: str) -> None:
    textured, texel, factors = FACTORS[name]
    plain = replace(textured, **dict.fromkeys(textured.slots), **factors)  # type: ignore[arg-type]
    expected = seen(lit_square(plain))
    assert expected.max() > 1e-3
    np.testing.assert_allclose(seen(lit_square(textured, np.array(texel))), expected, rtol=1e-4)
    untextured = replace(textured, **dict.fromkeys(textured.slots))  # type: ignore[arg-type]
    assert np.abs(seen(lit_square(untextured)) / expected - 1).max() > 0.02


def test_a_brush_follows_the_coordinates_of_its_own_texture() -> None:
    """Coordinates that a texture transform turns by 90 degrees turn the brush by as much."""
    turned = TextureSlot(0, uv_transform=np.array([[0.0, 1, 0], [-1, 0, 0]]))
    plain, texel, _ = FACTORS["the tangent"]
    along = np.array([1.0, 0.5, texel[2]])
    found = seen(lit_square(replace(plain, anisotropy_texture=turned), along), spp=16)
    expected = seen(lit_square(replace(plain, anisotropy_angle=110.0), along), spp=16)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def stored_normal(tilt: float) -> Float64:
    return np.array([0.5 + 0.5 * np.sin(tilt), 0.5, 0.5 + 0.5 * np.cos(tilt)])


COAT = replace(BLACK, clearcoat=1.0, clearcoat_roughness=0.5)
ENGINES: list[dict[str, Any]] = [{}, {"integrator": "path-buffer"}, {"integrator": "classic", "light_samples": 16}]


@pytest.mark.parametrize("options", ENGINES, ids=["path", "path-buffer", "classic"])
def test_the_normal_map_of_the_base_does_not_bend_the_clearcoat(options: dict[str, Any]) -> None:
    flat = seen(lit_square(COAT), **options)
    bent = replace(COAT, normal_texture=slot())
    np.testing.assert_allclose(seen(lit_square(bent, stored_normal(0.4)), **options), flat, rtol=1e-3)
    own = replace(COAT, clearcoat_normal_texture=slot())
    assert np.abs(seen(lit_square(own, stored_normal(0.4)), **options) / flat - 1).min() > 0.1


def test_the_clearcoat_is_shaded_by_its_own_normal_map() -> None:
    """As the surface is whose normal map it has: a metal of what a clearcoat reflects, with the same roughness."""
    metal = replace(BLACK, reflectance=np.full(3, 0.04), metallic=1.0, roughness=0.5, normal_texture=slot())
    coat = replace(COAT, clearcoat_normal_texture=slot())
    stored = stored_normal(0.3)
    np.testing.assert_allclose(seen(lit_square(coat, stored)), seen(lit_square(metal, stored)), rtol=0.01)


def mirror_of_two_lamps(material: Material) -> Scene:
    """A square seen straight on, whose mirror direction has a red lamp; tilted by 0.3, a green one."""

    def lamp(angle: float, colour: list[float]) -> dict[str, Any]:
        at, across = np.array([np.sin(angle), 0, np.cos(angle)]), np.array([np.cos(angle), 0, -np.sin(angle)])
        up = np.array([0, 1.0, 0])
        corners = [6 * at + 0.8 * (i * across + j * up) for i, j in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
        return {
            "type": "quad", "corners": [c.tolist() for c in corners], "material": "black",
            "emission": {"radiance": colour, "two_sided": True},
        }  # fmt: skip

    made = scene_from_dict(
        {
            "camera": {"position": [0, 0, 3], "target": [0, 0, 0], "fov": 2},
            "film": {"resolution": [8, 8]},
            "materials": {"m": {"reflectance": 0.5}, "black": {"reflectance": 0}},
            "shapes": [
                {"type": "quad", "corners": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "material": "m"},
                lamp(0.0, [1, 0, 0]),
                lamp(0.6, [0, 1, 0]),
            ],
        }
    )
    stored = (Texture("t", np.full((1, 1, 3), stored_normal(0.3), np.float32)),)
    return replace(made, materials=(material, made.materials[1]), textures=stored)


@pytest.mark.parametrize("integrator", ["classic", "t-buffer", "path"])
def test_a_smooth_clearcoat_mirrors_by_its_own_normals(integrator: str) -> None:
    """A mirror under it by its own: of both the eye sees what each reflects, whichever is tilted."""
    metal = replace(BLACK, reflectance=np.full(3, 0.5), metallic=1.0, roughness=0.0, clearcoat=1.0)
    options: dict[str, Any] = {"integrator": integrator, "max_depth": 3, "spp": 512}
    coat = 0.04 + 0.96 * (1 - np.cos(0.3)) ** 5
    tilted = seen(mirror_of_two_lamps(replace(metal, clearcoat_normal_texture=slot())), **options)
    np.testing.assert_allclose(tilted[:2], [0.5 * (1 - coat), coat], rtol=0.05)
    bent = seen(mirror_of_two_lamps(replace(metal, normal_texture=slot())), **options)
    base = 0.5 + 0.5 * (1 - np.cos(0.3)) ** 5
    np.testing.assert_allclose(bent[:2], [0.04, 0.96 * base], rtol=0.05)


@pytest.mark.parametrize("smooth", [False, True])
def test_a_bent_clearcoat_takes_from_the_base_what_it_reflects(smooth: bool) -> None:
    """Under a uniform sky: the coat with a normal map over a bent base is as one that both have in common."""
    coat = Material(
        "m", np.full(3, 0.6), roughness=0.6, clearcoat=1.0, clearcoat_roughness=0.0 if smooth else 0.4,
        normal_texture=slot(), clearcoat_normal_texture=slot(1),
    )  # fmt: skip
    bump = np.full((1, 1, 3), stored_normal(0.2), np.float32)
    textures = (Texture("base", bump), Texture("coat", bump))
    both = replace(plane_under_the_sky(coat, 0.8), textures=textures)
    base = replace(plane_under_the_sky(replace(coat, clearcoat=0.0), 0.8), textures=textures)
    found, bare = seen(both, spp=1024), seen(base, spp=1024)
    # The tilt is towards the eye: of its normal, cos(acos(0.8) - 0.2).
    cosine = np.cos(np.arccos(0.8) - 0.2)
    taken = 0.04 + 0.96 * (1 - cosine) ** 5
    np.testing.assert_allclose(found, bare * (1 - taken) + taken, rtol=0.02)


def test_without_textures_programs_know_nothing_of_them() -> None:
    names = {"HAS_COAT_NORMALS", "HAS_COAT_TEXTURES", "HAS_SPECULAR_TEXTURES", "HAS_ANISOTROPY_TEXTURES"}
    with DeviceScene(get_context().gl, lit_square(COAT)) as device:
        assert not names & device.defines.keys()
    with DeviceScene(get_context().gl, lit_square(replace(COAT, normal_texture=slot()), GOLD)) as device:
        assert names & device.defines.keys() == {"HAS_COAT_NORMALS"}


def test_what_has_one_value_for_a_surface_has_the_mean_of_the_textures() -> None:
    textured, texel, factors = FACTORS["clearcoat"]
    scene = lit_square(textured, np.array(texel))
    plain = replace(textured, clearcoat_texture=None, **factors)
    np.testing.assert_allclose(scene.mean_reflectance(textured), scene.mean_reflectance(plain), rtol=1e-6)
