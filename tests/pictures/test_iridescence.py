"""Thin films [KHR_materials_iridescence], beside interference over the spectrum that is written here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io.gltf import read_gltf
from glpath.scene.iridescence import film_reflects
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from tests.support.gltf_files import Gltf
from tests.support.uniform_sky import furnace, plane_under_the_sky

BLACK = Material("m", np.zeros(3), roughness=0.0)
OILY = replace(BLACK, iridescence=1.0, iridescence_ior=1.8, iridescence_thickness=450.0)


def interference(cosine: float, thickness: float, ior: float, f0: float) -> Float64:
    """(3,) linear Rec. 709: Airy's sum of all orders over wave numbers, by the sensitivities of Belcour & Barla."""
    k = np.linspace(0.8e6, 3.2e6, 4000)
    inside = np.sqrt(1 - (1 - cosine**2) / ior**2)

    def schlick(at: float, c: float) -> float:
        return float(at + (1 - at) * (1 - c) ** 5)

    base = (1 + np.sqrt(f0)) / (1 - np.sqrt(f0))
    R12 = schlick(((ior - 1) / (ior + 1)) ** 2, cosine)
    R23 = schlick(((base - ior) / (base + ior)) ** 2, inside)
    phase = 2 * np.pi * k * 2e-9 * ior * thickness * inside + np.pi + (np.pi if base < ior else 0.0)
    level = R12 + (1 - R12) ** 2 * R23 / (1 - R12 * R23)
    wave = sum(2 * (level - 1) * np.sqrt(R12 * R23) ** m * np.cos(m * phase) for m in range(1, 30))
    gaussians = [
        [(5.4856e-13, 1.6810e6, 4.3278e9), (9.7470e-14, 2.2399e6, 4.5282e9)],
        [(4.4201e-13, 1.7953e6, 9.3046e9)],
        [(5.2481e-13, 2.2084e6, 6.6121e9)],
    ]
    xyz = [
        sum((v * np.exp(-((k - p) ** 2) / (4 * s)) * wave).sum() for v, p, s in each) * (k[1] - k[0])
        for each in gaussians
    ]
    rec709 = np.array(
        [
            [3.2404542, -1.5371385, -0.4985314],
            [-0.9692660, 1.8760108, 0.0415560],
            [0.0556434, -0.2040259, 1.0572252],
        ]
    )
    return np.asarray(level + rec709 @ np.array(xyz) / np.sqrt(2) / 1.0685e-7)


@pytest.mark.parametrize("cosine", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("thickness", [150.0, 300.0, 520.0])
@pytest.mark.parametrize("f0", [0.04, 0.3])
def test_a_film_reflects_what_interference_over_the_spectrum_says(
    cosine: float, thickness: float, f0: float
) -> None:
    found = film_reflects(np.array([cosine]), thickness, 1.8, np.full(3, f0))[0]
    np.testing.assert_allclose(found, np.clip(interference(cosine, thickness, 1.8, f0), 0, 1), atol=0.02)


def seen(material: Material, cosine: float, *textures: Texture, **options: Any) -> Float64:
    options = {"spp": 256, "max_depth": 2, **options}
    scene = replace(plane_under_the_sky(material, cosine), textures=textures)
    return np.asarray(glpath.render(scene, **options).mean.mean(axis=(0, 1)))


@pytest.mark.parametrize("cosine", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("kind", ["dielectric", "metal"])
@pytest.mark.parametrize("engine", ["path", "classic"])
def test_a_smooth_film_shows_its_colour_at_each_angle(engine: str, kind: str, cosine: float) -> None:
    gold = np.array([0.9, 0.6, 0.2])
    metal = replace(OILY, reflectance=gold, metallic=1.0)
    film = film_reflects(np.array([cosine]), 450.0, 1.8, gold if kind == "metal" else np.full(3, 0.04))[0]
    assert film.max() > 1.2 * film.min()
    found = seen(metal if kind == "metal" else OILY, cosine, integrator=engine)
    np.testing.assert_allclose(found, film, atol=0.005)


@pytest.mark.parametrize("engine", ["path", "path-buffer"])
def test_half_a_film_on_what_is_rough_is_between_both(engine: str) -> None:
    options: dict[str, Any] = {"integrator": engine, "spp": 2048}
    rough = replace(OILY, roughness=0.5, multiple_scattering=False)
    bare, whole, half = (seen(replace(rough, iridescence=s), 0.7, **options) for s in (0.0, 1.0, 0.5))
    np.testing.assert_allclose(half, 0.5 * (bare + whole), rtol=0.03)
    assert np.abs(whole - bare).max() > 0.05


def test_textures_of_a_film() -> None:
    plain = replace(OILY, iridescence=0.5, iridescence_thickness=250.0)
    textured = replace(
        OILY, iridescence_thickness_min=100.0, iridescence_thickness=400.0, iridescence_texture=TextureSlot(0),
        iridescence_thickness_texture=TextureSlot(0),
    )  # fmt: skip
    half = Texture("t", np.full((1, 1, 3), 0.5, np.float32))
    np.testing.assert_allclose(seen(textured, 0.7, half), seen(plain, 0.7), rtol=1e-4)


@pytest.mark.filterwarnings("ignore:.*reflects all light")
def test_a_film_over_white_takes_no_more_than_there_is() -> None:
    white = replace(OILY, reflectance=np.ones(3), roughness=0.6)
    for metallic in (0.0, 1.0):
        film = glpath.render(furnace(replace(white, metallic=metallic), 16), spp=128, max_depth=30)
        assert np.asarray(film.mean)[5:11, 5:11].mean() < 1.02


def test_radiosity_knows_what_a_film_reflects() -> None:
    cosine = (np.arange(200) + 0.5) / 200
    mean = 2 * np.mean(cosine[:, None] * film_reflects(cosine, 450.0, 1.8, np.full(3, 0.04)), axis=0)
    np.testing.assert_allclose(OILY.hemispherical_reflectance(np.zeros(3)), mean, atol=0.003)


def test_a_gltf_has_a_film(tmp_path: Path) -> None:
    film = {"iridescenceFactor": 0.7, "iridescenceIor": 1.6, "iridescenceThicknessMaximum": 550}
    file = Gltf()
    info = {"index": file.texture(np.full((1, 1, 3), 255, np.uint8))}
    film |= {"iridescenceTexture": info, "iridescenceThicknessTexture": info}
    model = read_gltf(file.one_triangle(extensions={"KHR_materials_iridescence": film}).write(tmp_path))
    (material,) = model.materials
    assert (material.iridescence, material.iridescence_ior) == (0.7, 1.6)
    assert (material.iridescence_thickness_min, material.iridescence_thickness) == (100, 550)
    assert set(material.slots) == {"iridescence_texture", "iridescence_thickness_texture"}
    assert not any("iridescence" in note for note in model.notes)


def test_without_a_film_programs_know_nothing_of_it() -> None:
    for material, there in ((BLACK, False), (OILY, True)):
        with DeviceScene(get_context().gl, furnace(material)) as device:
            assert ("HAS_IRIDESCENCE" in device.defines) == there
