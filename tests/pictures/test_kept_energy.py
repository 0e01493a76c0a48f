"""What microfacets scatter more than once, and what a dielectric leaves for its base [Turquin 2019]."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.scene.directional_albedo import CELLS, directional_albedo
from glpath.scene.material import Layering, averaged
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from tests.reference.microfacet_walk import metal_albedo
from tests.support.uniform_sky import furnace, plane_under_the_sky

WHITE = np.ones(3)
METAL = Material("m", WHITE, roughness=0.5, metallic=1.0)
PANE = Material("m", WHITE, roughness=0.5, transmission=1.0)
PLASTIC = Material("m", WHITE, roughness=0.5)
ENGINES: list[dict[str, Any]] = [{}, {"integrator": "path-buffer"}, {"integrator": "classic", "light_samples": 64}]


def seen(material: Material, cosine: float, **options: Any) -> Float64:
    options = {"spp": 1024, "max_depth": 2, **options}
    return np.asarray(glpath.render(plane_under_the_sky(material, cosine), **options).mean.mean(axis=(0, 1)))


def ggx_albedo(cosine: float, alpha: float, n: int = 1500) -> float:
    """By the midpoint rule over directions of light; by the formulas of glTF 2.0, B.3.2 with F = 1."""
    # Steps of the angle, as a narrow lobe about the normal has few steps of its cosine.
    theta, phi = np.meshgrid(
        0.5 * np.pi * (np.arange(n) + 0.5) / n, np.pi * (np.arange(n) + 0.5) / n, indexing="ij"
    )
    z, r, sine = np.cos(theta), np.sin(theta), np.sqrt(1 - cosine**2)
    h = np.stack([r * np.cos(phi) + sine, r * np.sin(phi), z + cosine])
    h /= np.linalg.norm(h, axis=0)
    D = alpha**2 / (np.pi * ((h[2] * alpha) ** 2 + 1 - h[2] ** 2) ** 2)

    def seen_from(w: Any) -> Any:
        return 1 / (w + np.sqrt(alpha**2 + (1 - alpha**2) * w * w))

    f = D * seen_from(z) * seen_from(np.array(cosine))
    return float((f * z * r).sum() * (0.5 * np.pi / n) * (2 * np.pi / n))


@pytest.mark.parametrize("roughness", [0.25, 0.5, 1.0])
def test_the_table_is_quadrature_over_the_light(roughness: float) -> None:
    table = directional_albedo(0.0)[round(roughness * CELLS)]
    for j in (4, 9, 15, 24):
        assert table[j] == pytest.approx(ggx_albedo((j / CELLS) ** 2, roughness**2), abs=0.004)


def test_a_boundary_that_sends_all_light_one_way_is_like_metal() -> None:
    """Of an index that reflects nearly all, the table of glass is that of metal."""
    np.testing.assert_allclose(directional_albedo(1e4), directional_albedo(0.0), atol=0.02)


@pytest.mark.filterwarnings("ignore:.*reflects all light")
@pytest.mark.parametrize("roughness", [0.05, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0])
@pytest.mark.parametrize("kind", ["metal", "pane", "glass", "plastic"])
def test_a_white_furnace_stays_white_at_all_roughnesses(kind: str, roughness: float) -> None:
    made = {"metal": METAL, "pane": PANE, "glass": replace(PANE, thin=False), "plastic": PLASTIC}[kind]
    film = glpath.render(furnace(replace(made, roughness=roughness), 16), spp=256, max_depth=60)
    np.testing.assert_allclose(np.asarray(film.mean)[5:11, 5:11].mean(), 1.0, atol=0.02)


@pytest.mark.parametrize("roughness", [0.4, 1.0])
def test_half_metal_half_pane_stays_white(roughness: float) -> None:
    np.testing.assert_allclose(
        seen(replace(PANE, metallic=0.5, specular_weight=0.0, roughness=roughness), 0.6), 1.0, atol=0.01
    )


@pytest.mark.parametrize("options", ENGINES, ids=["path", "path-buffer", "classic"])
@pytest.mark.parametrize("cosine", [0.2, 0.6, 0.95])
def test_every_engine_keeps_the_energy_of_metal(options: dict[str, Any], cosine: float) -> None:
    """Sampled, as of paths, or evaluated, as of the others."""
    np.testing.assert_allclose(seen(replace(METAL, roughness=0.8), cosine, **options), 1.0, atol=0.025)


@pytest.mark.parametrize("roughness", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("normal", [0.2, 0.5, 0.9])
def test_a_coloured_metal_takes_its_colour_at_each_scattering(roughness: float, normal: float) -> None:
    """Light that walks between microfacets is the witness. Of 0.5 at roughness 1 it sends back 0.30, and the two
    sources have 0.34 and 0.27."""
    found = seen(replace(METAL, reflectance=np.full(3, normal), roughness=roughness), 0.84)
    np.testing.assert_allclose(found, metal_albedo(0.84, roughness**2, normal), rtol=0.045)


@pytest.mark.parametrize("options", ENGINES, ids=["path", "path-buffer", "classic"])
@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
def test_a_base_has_what_the_dielectric_over_it_leaves(options: dict[str, Any], roughness: float) -> None:
    """Black, then of a reflectance of 0.6: what one reflects, the other has not."""
    layer, both = (
        seen(replace(PLASTIC, reflectance=np.full(3, base), roughness=roughness), 0.6, **options)
        for base in (0.0, 0.6)
    )
    np.testing.assert_allclose(both, layer + 0.6 * (1 - layer), rtol=0.01)


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize("material", [METAL, PLASTIC], ids=["metal", "plastic"])
@pytest.mark.parametrize("roughness", [0.3, 0.7, 1.0])
def test_solvers_have_the_mean_of_what_paths_see(material: Material, roughness: float, kept: bool) -> None:
    material = replace(material, reflectance=np.full(3, 0.5), roughness=roughness, multiple_scattering=kept)
    cosines = (np.arange(8) + 0.5) / 8
    sent = [seen(material, float(cosine), spp=256)[0] for cosine in cosines]
    # glTF's formula gives the base a little else than what the dielectric leaves.
    atol = 0.01 if kept or material.metallic > 0 else 0.02
    np.testing.assert_allclose(
        material.hemispherical_reflectance(material.reflectance), 2 * np.mean(cosines * sent), atol=atol
    )


LAYERS: list[dict[str, Any]] = [
    {"roughness": 0.1},
    {"roughness": 1.0},
    {"roughness": 0.5, "metallic": 0.5},
    {"roughness": 0.5, "specular_weight": 0.4},
    {"roughness": 0.3, "clearcoat": 1.0},
    {"roughness": 0.0, "transmission": 0.4},
    {"roughness": 0.0, "transmission": 0.4, "thin": False},
    {"roughness": 0.0, "transmission": 1.0},
]


@pytest.mark.parametrize("layering", ["plastic", "disney", "beside"])
@pytest.mark.parametrize("fields", LAYERS, ids=str)
def test_solvers_have_the_mean_of_what_paths_see_of_every_layering(
    layering: Layering, fields: dict[str, Any]
) -> None:
    material = Material("m", np.full(3, 0.5), layering=layering, multiple_scattering=False, **fields)
    cosines = (np.arange(8) + 0.5) / 8
    sent = [seen(material, float(cosine), spp=256)[0] for cosine in cosines]
    np.testing.assert_allclose(
        material.hemispherical_reflectance(material.reflectance), 2 * np.mean(cosines * sent), atol=0.006
    )


@pytest.mark.parametrize("layering", ["plastic", "disney", "beside"])
def test_solvers_have_transmission_of_a_texture_in_the_mean(layering: Layering) -> None:
    half, slot = Texture("half", np.full((2, 2, 3), 0.5)), TextureSlot(0)
    textured = Material(
        "m", np.full(3, 0.5), roughness=0.0, transmission=0.8, layering=layering, transmission_texture=slot
    )
    plain = replace(textured, transmission=0.4, transmission_texture=None)
    expected = plain.hemispherical_reflectance(plain.reflectance)
    found = averaged(textured, [half]).hemispherical_reflectance(textured.reflectance)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_solvers_have_roughness_and_metal_of_a_texture_in_the_mean() -> None:
    """The factors of most models are 1, and their textures say what they are."""
    picture = Texture("data", np.full((2, 2, 3), [0.0, 0.25, 0.5]))
    slot = TextureSlot(0)
    textured = replace(METAL, reflectance=np.full(3, 0.5), roughness=1.0, surface_texture=slot)
    plain = replace(textured, surface_texture=None, roughness=0.25, metallic=0.5)
    expected = plain.hemispherical_reflectance(plain.reflectance)
    found = averaged(textured, [picture]).hemispherical_reflectance(textured.reflectance)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert expected[0] > textured.hemispherical_reflectance(textured.reflectance)[0] + 0.15


def test_brushed_metal_keeps_about_all() -> None:
    brushed = replace(METAL, roughness=0.4, anisotropy=0.7)
    assert seen(brushed, 0.7).mean() == pytest.approx(1.0, abs=0.06)
    assert seen(replace(brushed, multiple_scattering=False), 0.7).mean() < 0.9


def test_where_nothing_is_kept_programs_know_nothing_of_it() -> None:
    mirror, pane = (replace(each, roughness=0.0) for each in (METAL, PANE))
    for material in (mirror, pane, *(replace(each, multiple_scattering=False) for each in (METAL, PLASTIC))):
        with DeviceScene(get_context().gl, furnace(material)) as device:
            assert "HAS_MULTIPLE_SCATTERING" not in device.defines
    with DeviceScene(get_context().gl, furnace(METAL)) as device:
        assert "HAS_MULTIPLE_SCATTERING" in device.defines
