"""Sheen [KHR_materials_sheen], beside a slow evaluation of its formulas that is written here."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.device_scene import DeviceScene
from glpath.io.load import scene_from_dict
from glpath.scene.material import sheen_albedo_fit
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from tests.support.engines import coarse
from tests.support.uniform_sky import furnace, plane_under_the_sky

WHITE = np.ones(3)
BLACK = Material("m", np.zeros(3), roughness=1.0, specular_weight=0.0)


def charlie_lambda(x: Float64, alpha: float) -> Float64:
    """Estevez & Kulla 2017, eq. 3 and table 1."""
    t = (1 - alpha) ** 2
    first, second = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967), (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)
    a, b, c, d, e = (t * p + (1 - t) * q for p, q in zip(first, second, strict=True))

    def exponent(x: Float64) -> Float64:
        return np.asarray(a / (1 + b * x**c) + d * x + e)

    return np.where(x < 0.5, np.exp(exponent(x)), np.exp(2 * exponent(np.array(0.5)) - exponent(1 - x)))


def charlie(wo: Float64, wi: Float64, alpha: float) -> Float64:
    """(N,) of the BRDF, 1 / sr, of (N, 3) directions."""
    h = wo + wi
    h /= np.linalg.norm(h, axis=1)[:, None]
    D = (2 + 1 / alpha) * np.sqrt(np.maximum(1 - h[:, 2] ** 2, 0)) ** (1 / alpha) / (2 * np.pi)
    o, i = wo[:, 2], wi[:, 2]
    return np.asarray(D / ((1 + charlie_lambda(o, alpha) + charlie_lambda(i, alpha)) * 4 * o * i))


def albedo(cosine: float, alpha: float, n: int = 500) -> float:
    """By the midpoint rule over z and the azimuth."""
    z, phi = np.meshgrid(((np.arange(n) + 0.5) / n) ** 2, 2 * np.pi * (np.arange(n) + 0.5) / n, indexing="ij")
    r = np.sqrt(1 - z * z)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1).reshape(-1, 3)
    weight = (z * 2 * np.sqrt(z)).ravel() / n * (2 * np.pi / n)
    wo = np.broadcast_to([np.sqrt(1 - cosine**2), 0.0, cosine], wi.shape)
    return float((charlie(wo, wi, alpha) * weight).sum())


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.35, 0.5, 0.7, 1.0])
def test_the_fitted_albedo_is_that_of_quadrature(roughness: float) -> None:
    for cosine in (0.015, 0.03, 0.1, 0.2, 0.35, 0.6, 0.85, 1.0):
        exact = albedo(cosine, roughness**2)
        fitted = np.exp(np.polynomial.polynomial.polyval(np.sqrt(cosine), sheen_albedo_fit(roughness**2)))
        assert abs(fitted - exact) < 0.003 * max(exact, 1.0)


@pytest.mark.parametrize("engine", [{}, {"integrator": "path-buffer"}])
@pytest.mark.parametrize(("roughness", "cosine"), [(0.2, 0.15), (0.5, 0.3), (1.0, 0.8)])
def test_black_cloth_in_a_furnace_shows_the_albedo_of_its_sheen(
    engine: dict[str, str], roughness: float, cosine: float
) -> None:
    cloth = replace(BLACK, sheen=np.array([1.0, 0.5, 0.1]), sheen_roughness=roughness)
    film = glpath.render(plane_under_the_sky(cloth, cosine), spp=1024, max_depth=2, **engine)  # type: ignore[arg-type]
    found = film.mean.mean(axis=(0, 1))
    np.testing.assert_allclose(found, cloth.sheen * min(albedo(cosine, roughness**2), 1.0), rtol=0.03, atol=2e-3)


@pytest.mark.filterwarnings("ignore:.*reflects all light")
@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.6, 1.0])
def test_white_cloth_in_a_furnace_is_no_brighter_than_its_sky(roughness: float) -> None:
    """At all angles, grazing ones too, where the formulas alone send back up to twice the light."""
    cloth = replace(BLACK, reflectance=WHITE, sheen=WHITE, sheen_roughness=roughness)
    for cosine in (0.03, 0.1, 0.5, 1.0):
        scene = plane_under_the_sky(cloth, min(cosine, 0.9999))
        found = float(glpath.render(scene, spp=1024, max_depth=2).mean.mean())
        assert found == pytest.approx(1.0, abs=0.02)


def in_two_halves(left: float, right: float) -> tuple[Texture, ...]:
    """A texture whose alpha is another in the two halves of v; its colour, which is not read, is black."""
    alpha = np.zeros((2, 1, 4), np.float32)
    alpha[:, 0, 3] = left, right
    return (Texture("roughness", alpha, filter="nearest"),)


@pytest.mark.parametrize("roughness", [0.15, 0.45, 0.8, 0.97])
def test_a_texture_of_the_roughness_is_the_factor_that_it_multiplies(roughness: float) -> None:
    """On each half of the surface, by quadrature, and beside the material without a texture."""
    cloth = replace(BLACK, sheen=WHITE, sheen_roughness=1.0, sheen_roughness_texture=TextureSlot(0))
    plane = plane_under_the_sky(cloth, 0.4)
    quad = plane.shapes[0]
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    mesh = replace(quad.geometry, uv=uv)
    textured = replace(plane, shapes=[replace(quad, geometry=mesh)], textures=in_two_halves(roughness, roughness))
    found = float(glpath.render(textured, spp=1024, max_depth=2).mean.mean())
    assert found == pytest.approx(min(albedo(0.4, roughness**2), 1.0), rel=0.02)
    plain = replace(plane, materials=(replace(BLACK, sheen=WHITE, sheen_roughness=roughness),))
    assert found == pytest.approx(float(glpath.render(plain, spp=1024, max_depth=2).mean.mean()), rel=0.01)


@pytest.mark.filterwarnings("ignore:.*reflects all light")
def test_white_cloth_of_any_roughness_in_a_texture_keeps_the_furnace_flat() -> None:
    white = replace(BLACK, reflectance=WHITE, sheen=WHITE, sheen_roughness=1.0)
    scene = replace(
        furnace(replace(white, sheen_roughness_texture=TextureSlot(0)), 16), textures=in_two_halves(0.0, 1.0)
    )
    found = np.asarray(glpath.render(scene, spp=1024, max_depth=2).mean)
    upper, lower = found[3:8, 4:12].mean(), found[8:13, 4:12].mean()
    np.testing.assert_allclose([upper, lower], 1.0, atol=0.01)


def test_without_sheen_programs_know_nothing_of_it() -> None:
    from glpath.gl.context import get_context

    for sheen, there in ((np.zeros(3), False), (WHITE, True)):
        with DeviceScene(get_context().gl, furnace(Material("m", WHITE, roughness=1.0, sheen=sheen))) as device:
            assert ("HAS_SHEEN" in device.defines) == there


def test_radiosity_knows_the_sheens_albedo() -> None:
    black = replace(BLACK, sheen=WHITE, sheen_roughness=0.5)
    cosines = (np.arange(24) + 0.5) / 24
    mean = 2 * np.mean([cosine * min(albedo(cosine, 0.25, 200), 1.0) for cosine in cosines])
    np.testing.assert_allclose(black.hemispherical_reflectance(np.zeros(3)), mean, atol=0.005)
    grey = replace(black, reflectance=np.full(3, 0.5))
    np.testing.assert_allclose(grey.hemispherical_reflectance(np.full(3, 0.5)), mean + (1 - mean) * 0.5, atol=0.005)


def test_a_scene_file_has_sheen() -> None:
    surface = {"type": "principled", "sheen": [0.2, 0.4, 1.0], "sheen_roughness": 0.3}
    given = {
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 40},
        "film": {"resolution": [8, 8]},
        "materials": {"cloth": surface},
        "shapes": [{"type": "sphere", "radius": 1.0, "material": "cloth"}],
        "sky": {"zenith": 1.0},
    }
    (material,) = scene_from_dict(given).materials
    np.testing.assert_array_equal(material.sheen, [0.2, 0.4, 1.0])
    assert material.sheen_roughness == 0.3
    surface["sheen"] = 1.5
    with pytest.raises(glpath.SceneError, match="sheen"):
        scene_from_dict(given)


@pytest.mark.parametrize(
    ("options", "bound"), [({"cast": "bvh"}, 0.01), ({"cast": "path-buffer"}, 0.03)], ids=["bvh", "path-buffer"]
)
@pytest.mark.parametrize("sheen", [0.0, 0.9])
def test_a_gather_shows_rough_surfaces_as_paths_do(sheen: float, options: dict[str, str], bound: float) -> None:
    """What a dielectric and a sheen leave for the base holds where a solution is looked up, too."""
    cloth = {"type": "principled", "reflectance": 0.5, "roughness": 0.8, "sheen": sheen, "sheen_roughness": 0.4}
    ball = {"type": "sphere", "center": [0, 0.6, 0], "radius": 0.6, "material": "cloth", "subdivisions": 4}
    floor = {"type": "quad", "corners": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], "material": "grey"}
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 1.2, 4], "target": [0, 0.6, 0], "fov": 35},
            "materials": {"cloth": cloth, "grey": {"reflectance": 0.6}},
            "sky": {"zenith": [1, 1, 1], "horizon": 1},
            "shapes": [ball, floor],
        }
    )
    size: dict[str, Any] = {"resolution": (40, 30), "spp": 128}
    paths = glpath.render(scene, max_depth=32, aovs=("object_id",), **size)
    seen = paths.aov("object_id") == 1
    gathered = glpath.render(scene, integrator="gather", radiosity=coarse(scene), **options, **size).mean
    assert gathered[seen].mean() == pytest.approx(paths.mean[seen].mean(), rel=bound)
    assert gathered[~seen].mean() == pytest.approx(paths.mean[~seen].mean(), rel=bound)
