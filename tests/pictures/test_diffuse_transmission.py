"""Diffuse surfaces that let light through [KHR_materials_diffuse_transmission]."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io.gltf import read_gltf
from glpath.scene import Background, Portal
from glpath.scene.geometry import Mesh, Shape
from glpath.scene.model import Float64, Material, Scene, Texture, TextureSlot
from tests.reference.closed_forms import polygon_irradiance
from tests.support.engines import coarse
from tests.support.gltf_files import Gltf
from tests.support.uniform_sky import furnace, plane_under_the_sky

GREEN = np.array([0.2, 0.8, 0.3])
SHEET = Material("m", np.full(3, 0.7), roughness=1.0, specular_weight=0.0, diffuse_transmission=0.6)
LAMBERT = Material("m", np.full(3, 0.7), roughness=1.0, specular_weight=0.0)


def lit_sheet(material: Material, behind: bool, *textures: Texture, lamp: bool = True) -> Scene:
    """A sheet seen along -z under a lamp or a point light, before it or behind."""
    z = -3.0 if behind else 3.0
    square = [[1, -1, z], [1, 1, z], [2, 1, z], [2, -1, z]]
    given: dict[str, Any] = {
        "camera": {"position": [0, 0, 9], "target": [0, 0, 0], "fov": 5},
        "film": {"resolution": [12, 12]},
        "materials": {"m": {"reflectance": 0.5}, "black": {"reflectance": 0}},
        "shapes": [
            {"type": "quad", "corners": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "material": "m"},
        ],
    }
    if lamp:
        light = {"radiance": 20.0, "two_sided": True}
        given["shapes"].append({"type": "quad", "corners": square, "material": "black", "emission": light})
    else:
        given["lights"] = [{"type": "point", "position": [1, 0, z], "intensity": 40}]
    scene = glpath.load_scene(given)
    return replace(scene, materials=(material, *scene.materials[1:]), textures=textures)


def seen(scene: Scene, **options: Any) -> Float64:
    options = {"spp": 512, "max_depth": 2, **options}
    return np.asarray(glpath.render(scene, **options).mean.mean(axis=(0, 1)))


@pytest.mark.parametrize("lamp", [True, False])
@pytest.mark.parametrize("guide", ["cosine", "solution"])
def test_light_from_behind_is_lamberts_on_the_other_side(lamp: bool, guide: str) -> None:
    """By light samples and by directions: as the mirrored scene with a diffuse sheet of that colour."""
    green = replace(SHEET, diffuse_transmission_colour=GREEN)
    through = seen(lit_sheet(green, True, lamp=lamp), guide=guide)
    expected = seen(lit_sheet(replace(LAMBERT, reflectance=0.6 * GREEN), False, lamp=lamp))
    np.testing.assert_allclose(through, expected, rtol=0.02)
    front = seen(lit_sheet(green, False, lamp=lamp), guide=guide)
    np.testing.assert_allclose(
        front, seen(lit_sheet(replace(LAMBERT, reflectance=np.full(3, 0.28)), False, lamp=lamp)), rtol=0.02
    )


@pytest.mark.filterwarnings("ignore:.*reflects all light")
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_white_paper_vanishes_in_a_furnace(share: float) -> None:
    paper = replace(SHEET, reflectance=np.ones(3), diffuse_transmission=share)
    np.testing.assert_allclose(seen(plane_under_the_sky(paper, 0.6)), 1.0, atol=0.01)
    film = glpath.render(furnace(paper, 16), spp=256, max_depth=40)
    np.testing.assert_allclose(np.asarray(film.mean)[5:11, 5:11].mean(), 1.0, atol=0.01)


def square(z: float) -> list[list[float]]:
    return [[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]]


def sheet_over(*others: dict[str, Any], **sections: Any) -> Scene:
    """A white sheet that transmits 0.6 diffusely, away from the origin; the picture shows its centre."""
    scene = glpath.load_scene({
        "camera": {"position": [0, 0, 6], "target": [0, 0, 0], "fov": 0.1},
        "film": {"resolution": [12, 12]},
        "materials": {"m": {"reflectance": 0.5}, "black": {"reflectance": 0}},
        "shapes": [{"type": "quad", "corners": square(2.0), "material": "m"}, *others],
        **sections,
    })  # fmt: skip
    white = replace(SHEET, reflectance=np.ones(3), diffuse_transmission_colour=np.ones(3))
    return replace(scene, materials=(white, *scene.materials[1:]))


def test_rectangular_lamp_behind_a_sheet_gives_the_irradiance_of_the_closed_form() -> None:
    lamp = {"type": "quad", "corners": square(1.5), "material": "black", "emission": {"radiance": 5.0}}
    expected = 0.6 / np.pi * polygon_irradiance([0, 0, 2], [0, 0, -1], square(1.5), 5.0)
    np.testing.assert_allclose(seen(sheet_over(lamp), spp=64, guide="cosine"), expected, rtol=0.02)


def test_white_sheet_vanishes_in_a_furnace_with_a_portal_behind() -> None:
    scene = replace(sheet_over(sky={"zenith": 1.0}), portals=(Portal(np.array(square(1.5))),))
    np.testing.assert_allclose(seen(scene, spp=64, guide="cosine"), 1.0, atol=0.01)


def test_sheet_beside_thin_glass_passes_light_of_the_sky_not_of_the_background() -> None:
    paper = replace(SHEET, reflectance=np.ones(3), diffuse_transmission=1.0)
    scene = replace(plane_under_the_sky(paper, 1.0), background=Background(np.zeros(3)))
    pane = Shape("pane", Mesh(np.array([[50.0, 0, 0], [51, 0, 0], [50, 1, 0]]), np.array([[0, 1, 2]])), 1)
    thin = Material("thin", np.ones(3), roughness=0.0, transmission=1.0, thin=True)
    scene = replace(scene, shapes=(*scene.shapes, pane), materials=(paper, thin))
    np.testing.assert_allclose(seen(scene, spp=16, guide="cosine"), 1.0, atol=0.01)


def test_under_a_dielectric_it_has_what_that_leaves() -> None:
    """Alike on both sides: of the base what a smooth layer lets through at the angle to the eye."""
    glazed = replace(SHEET, specular_weight=1.0, diffuse_transmission=1.0, roughness=0.0)
    bare = seen(lit_sheet(replace(glazed, specular_weight=0.0, specular_colour=np.zeros(3)), True))
    np.testing.assert_allclose(seen(lit_sheet(glazed, True)), 0.96 * bare, rtol=0.02)


def test_textures_of_share_and_colour() -> None:
    textured = replace(
        SHEET, diffuse_transmission=0.8, diffuse_transmission_texture=TextureSlot(0),
        diffuse_transmission_colour_texture=TextureSlot(1),
    )  # fmt: skip
    share = Texture("share", np.array([[[1, 1, 1, 0.5]]], np.float32))
    colour = Texture("colour", GREEN.astype(np.float32)[None, None])
    plain = replace(SHEET, diffuse_transmission=0.4, diffuse_transmission_colour=GREEN)
    for behind in (True, False):
        found = seen(lit_sheet(textured, behind, share, colour))
        np.testing.assert_allclose(found, seen(lit_sheet(plain, behind)), rtol=1e-4)


def lampshade(share: float) -> Scene:
    """A box around a lamp, over a floor that is lit through its walls alone."""
    shade = {"type": "principled", "reflectance": 0.6, "specular": 0, "diffuse_transmission": share}
    floor = [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]]
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0.5, 0], "fov": 35},
            "materials": {"shade": shade, "grey": {"reflectance": 0.5}, "black": {"reflectance": 0}},
            "shapes": [
                {"type": "box", "min": [-0.6, 0.4, -0.6], "max": [0.6, 1.6, 0.6], "material": "shade"},
                {"type": "quad", "corners": floor, "material": "grey"},
                {
                    "type": "box", "min": [-0.2, 0.9, -0.2], "max": [0.2, 1.1, 0.2], "material": "black",
                    "emission": {"radiance": 30},
                },
            ],
        }
    )  # fmt: skip


def test_a_gather_looks_up_both_sides_of_a_lampshade() -> None:
    scene = lampshade(0.5)
    options: dict[str, Any] = {"resolution": (32, 24)}
    path = glpath.render(scene, spp=512, max_depth=24, guide="cosine", aovs=("object_id",), **options)
    shade = path.aov("object_id") == 0
    gather = glpath.render(scene, spp=256, integrator="gather", radiosity=coarse(scene), **options).mean
    assert gather[shade].mean() == pytest.approx(path.mean[shade].mean(), rel=0.06)
    guided = glpath.render(scene, spp=256, guide="solution", radiosity=coarse(scene), **options).mean
    assert guided.mean() == pytest.approx(path.mean.mean(), rel=0.03)


@pytest.mark.parametrize("integrator", ["path-buffer", "t-buffer"])
def test_engines_that_have_none_refuse_it(integrator: str) -> None:
    with pytest.raises(GlpathError, match="diffuse transmission"):
        glpath.render(lampshade(0.5), spp=1, integrator=integrator)  # type: ignore[arg-type]


@pytest.mark.parametrize("colour", [[0.1, 0.2, 0.3], None])
def test_a_gltf_has_a_diffuse_transmission(tmp_path: Path, colour: list[float] | None) -> None:
    file = Gltf()
    info = {"index": file.texture(np.full((1, 1, 4), 255, np.uint8))}
    extension: dict[str, Any] = {
        "diffuseTransmissionFactor": 0.7,
        "diffuseTransmissionTexture": info,
        "diffuseTransmissionColorTexture": info,
    }
    if colour is not None:
        extension["diffuseTransmissionColorFactor"] = colour
    extensions = {
        "KHR_materials_specular": {"specularFactor": 0},
        "KHR_materials_diffuse_transmission": extension,
    }
    file.one_triangle(extensions=extensions, pbrMetallicRoughness={"metallicFactor": 0})
    model = read_gltf(file.write(tmp_path))
    (material,) = model.materials
    assert material.diffuse_transmission == 0.7
    np.testing.assert_array_equal(material.diffuse_transmission_colour, colour or [1, 1, 1])
    assert set(material.slots) == {"diffuse_transmission_texture", "diffuse_transmission_colour_texture"}
    assert not any("diffuse_transmission" in note for note in model.notes)


def test_without_it_programs_know_nothing_of_it() -> None:
    for material, there in ((LAMBERT, False), (SHEET, True)):
        with DeviceScene(get_context().gl, furnace(material)) as device:
            assert ("HAS_DIFFUSE_TRANSMISSION" in device.defines) == there
