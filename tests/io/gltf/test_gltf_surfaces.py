"""Materials, textures, lights and cameras of glTF models."""

from __future__ import annotations

import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glpath.errors import SceneError, UsageError
from glpath.io.gltf import Model, load, read_gltf
from glpath.io.gltf.primitives import is_solid
from glpath.io.gltf.surfaces import metal_and_roughness
from glpath.scene.model import Material, Mesh, Texture, TextureSlot
from glpath.system.colour import decode_srgb
from tests.support.gltf_files import Gltf, encoded, ktx2_of_solid_blocks

#: Red and green above blue and white.
FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)


def read(file: Gltf, folder: Path, **options: Any) -> Model:
    return read_gltf(file.write(folder), **options)


def the_material(folder: Path, **material: Any) -> tuple[Material, Model]:
    model = read(Gltf().one_triangle(**material), folder)
    return model.materials[0], model


def extended(name: str, **fields: Any) -> dict[str, Any]:
    return {"extensions": {name: fields}}


def texel(texture: Texture, slot: TextureSlot, uv: Any) -> Any:
    """What a material shows at texture coordinates of ours, looked up by the model's own rules."""
    u, v = slot.uv_transform @ [*uv, 1.0]
    height, width = texture.image.shape[:2]
    column, row = int(np.floor(u % 1 * width)), int(np.floor((1 - v) % 1 * height))
    return texture.image[row, column]


def test_a_material_of_numbers(tmp_path: Path) -> None:
    pbr = {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.6}
    material, model = the_material(
        tmp_path, name="brass", pbrMetallicRoughness=pbr, doubleSided=True, emissiveFactor=[1, 0.5, 0],
        alphaMode="MASK", alphaCutoff=0.3, **extended("KHR_materials_emissive_strength", emissiveStrength=8),
    )  # fmt: skip
    np.testing.assert_allclose(material.reflectance, [0.1, 0.2, 0.3])
    assert (material.name, material.metallic, material.roughness) == ("brass", 0.5, 0.6)
    assert (material.alpha, material.opacity, material.cutoff, material.two_sided) == ("mask", 0.4, 0.3, True)
    np.testing.assert_allclose(model.shapes[0].emission, [8, 4, 0])
    assert model.shapes[0].emission_two_sided


def test_without_a_material_it_is_the_default_of_the_specification(tmp_path: Path) -> None:
    file = Gltf()
    file.node(mesh=file.mesh())
    (material,) = read(file, tmp_path).materials
    np.testing.assert_array_equal(material.reflectance, [1, 1, 1])
    assert (material.metallic, material.roughness, material.two_sided, material.alpha) == (1, 1, False, "opaque")


def test_layers_of_the_extensions(tmp_path: Path) -> None:
    material, _ = the_material(
        tmp_path,
        extensions={
            "KHR_materials_ior": {"ior": 1.7},
            "KHR_materials_specular": {"specularFactor": 0.4, "specularColorFactor": [1, 2, 0]},
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.9, "clearcoatRoughnessFactor": 0.1},
            "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.5, 1], "sheenRoughnessFactor": 0.25},
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": np.pi / 3},
            "KHR_materials_transmission": {"transmissionFactor": 0.8},
            "KHR_materials_volume": {
                "thicknessFactor": 1,
                "attenuationColor": [0.5, 1, 0.25],
                "attenuationDistance": 2,
            },
        },
    )
    assert (material.ior, material.specular_weight, material.transmission) == (1.7, 0.4, 0.8)
    np.testing.assert_allclose(material.specular_colour, [1, 2, 0])
    assert (material.clearcoat, material.clearcoat_roughness, material.anisotropy) == (0.9, 0.1, 0.6)
    np.testing.assert_array_equal(material.sheen, [0.1, 0.5, 1])
    assert material.sheen_roughness == 0.25
    assert material.anisotropy_angle == pytest.approx(60)
    assert not material.thin
    np.testing.assert_allclose(np.exp(-2 * material.attenuation), [0.5, 1, 0.25])  # Beer's law over the distance


def test_textures_of_the_layers(tmp_path: Path) -> None:
    file = Gltf()
    info = {"index": file.texture(FOUR)}
    file.one_triangle(
        extensions={
            "KHR_materials_specular": {"specularTexture": info, "specularColorTexture": info},
            "KHR_materials_clearcoat": {
                "clearcoatFactor": 0.9,
                "clearcoatTexture": info,
                "clearcoatRoughnessTexture": info,
                "clearcoatNormalTexture": info | {"scale": 0.5},
            },
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyTexture": info},
            "KHR_materials_sheen": {
                "sheenColorFactor": [1, 1, 1],
                "sheenColorTexture": info,
                "sheenRoughnessTexture": info,
            },
        },
    )
    model = read(file, tmp_path)
    (material,) = model.materials
    assert set(material.slots) == {
        "clearcoat_texture",
        "clearcoat_roughness_texture",
        "clearcoat_normal_texture",
        "anisotropy_texture",
        "specular_texture",
        "specular_colour_texture",
        "sheen_texture",
        "sheen_roughness_texture",
    }
    assert material.clearcoat_normal_scale == 0.5
    colours = {name for name, slot in material.slots.items() if model.textures[slot.texture].srgb}
    assert colours == {"specular_colour_texture", "sheen_texture"}
    assert not any("factor holds" in note for note in model.notes)


def test_textures_of_layers_that_are_not_there_are_not_read(tmp_path: Path) -> None:
    file = Gltf()
    info = {"index": file.texture(FOUR)}
    layers = {
        "KHR_materials_clearcoat": {"clearcoatTexture": info},
        "KHR_materials_anisotropy": {"anisotropyTexture": info},
    }
    model = read(file.one_triangle(extensions=layers), tmp_path)
    assert not model.materials[0].slots
    assert not model.textures


NO_REFLECTION = {"KHR_materials_specular": {"specularFactor": 0}}


def test_without_any_reflection_a_surface_is_diffuse(tmp_path: Path) -> None:
    """A dielectric over Lambert's base reflects nothing at any angle, so that its roughness changes nothing."""
    file = Gltf()
    texture = {"index": file.texture(FOUR)}
    pbr = {"baseColorFactor": [0.1, 0.2, 0.3, 1], "metallicFactor": 0, "roughnessFactor": 0.4}
    rough = {"metallicRoughnessTexture": texture, "baseColorTexture": texture}
    layers = NO_REFLECTION | {
        "KHR_materials_ior": {"ior": 2},
        "KHR_materials_anisotropy": {"anisotropyStrength": 1},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0, "clearcoatRoughnessFactor": 1},
        "KHR_materials_transmission": {"transmissionFactor": 0},
    }
    file.one_triangle(pbrMetallicRoughness=pbr | rough, normalTexture=texture, extensions=layers)
    material = read(file, tmp_path).materials[0]
    plain = Material("plain", np.array([0.1, 0.2, 0.3]), two_sided=False, culled=True)
    for each in fields(Material):
        if each.name not in ("name", "texture", "normal_texture"):
            np.testing.assert_array_equal(getattr(material, each.name), getattr(plain, each.name), each.name)
    assert set(material.slots) == {"texture", "normal_texture"}
    assert not material.has_lobes


@pytest.mark.parametrize(
    ("pbr", "extensions"),
    [
        ({"metallicFactor": 0.1}, NO_REFLECTION),
        ({}, NO_REFLECTION),  # all of metal, by default
        ({"metallicFactor": 0}, {}),
        ({"metallicFactor": 0}, {"KHR_materials_specular": {"specularFactor": 0.01}}),
        ({"metallicFactor": 0}, {"KHR_materials_specular": {"specularColorFactor": [0, 0, 0]}}),  # grazing is white
        ({"metallicFactor": 0}, NO_REFLECTION | {"KHR_materials_clearcoat": {"clearcoatFactor": 0.1}}),
        ({"metallicFactor": 0}, NO_REFLECTION | {"KHR_materials_sheen": {"sheenColorFactor": [0, 0.1, 0]}}),
        ({"metallicFactor": 0}, NO_REFLECTION | {"KHR_materials_transmission": {"transmissionFactor": 0.1}}),
    ],
)
def test_what_reflects_has_its_roughness(pbr: dict[str, Any], extensions: dict[str, Any], tmp_path: Path) -> None:
    factors = pbr | {"roughnessFactor": 0.4}
    material, _ = the_material(tmp_path, pbrMetallicRoughness=factors, extensions=extensions)
    assert material.roughness == 0.4


def test_a_pane_is_thin(tmp_path: Path) -> None:
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {}}
    material, _ = the_material(tmp_path, extensions=extensions)
    assert material.thin
    np.testing.assert_array_equal(material.attenuation, [0, 0, 0])


def test_specular_glossiness_reflects_its_colour_at_normal_incidence(tmp_path: Path) -> None:
    factors = {"diffuseFactor": [0.2, 0.3, 0.4, 1], "specularFactor": [0.5, 0.04, 0], "glossinessFactor": 0.75}
    material, _ = the_material(tmp_path, **extended("KHR_materials_pbrSpecularGlossiness", **factors))
    f0 = ((material.ior - 1) / (material.ior + 1)) ** 2 * material.specular_colour
    np.testing.assert_allclose(f0, [0.5, 0.04, 0])
    np.testing.assert_allclose(material.reflectance, [0.2, 0.3, 0.4])
    assert (material.roughness, material.metallic) == (0.25, 0)


def glossy(folder: Path, **fields: Any) -> tuple[Material, Model]:
    """A material of the older model, whose textures are of one row: gold, plastic, rubber and a mixture."""
    file = Gltf()
    diffuse = file.texture([[[0, 0, 0], [188, 124, 89], [60, 60, 60], [124, 99, 64]]])
    # Of 255, 56 is sRGB's 0.0395: as much as a dielectric reflects.
    shiny = file.texture([[[255, 226, 155, 204], [56, 56, 56, 128], [56, 56, 56, 0], [187, 165, 118, 255]]])
    table = {"diffuseTexture": {"index": diffuse}, "specularGlossinessTexture": {"index": shiny}, **fields}
    file.one_triangle(**extended("KHR_materials_pbrSpecularGlossiness", **table))
    model = read(file, folder)
    return model.materials[0], model


def test_textures_of_specular_glossiness_become_metal_and_roughness(tmp_path: Path) -> None:
    material, model = glossy(tmp_path)
    assert material.texture is not None
    assert material.surface_texture is not None
    base, surface = (model.textures[slot.texture] for slot in (material.texture, material.surface_texture))
    assert (base.srgb, surface.srgb) == (True, False)
    assert (material.reflectance.tolist(), material.roughness, material.metallic) == ([1, 1, 1], 1, 1)
    gold, plastic, rubber, half = base.image[0].astype(int)
    np.testing.assert_allclose(gold, [255, 226, 155], atol=1)
    np.testing.assert_allclose(plastic, [188, 124, 89], atol=1)
    np.testing.assert_allclose(rubber, [60, 60, 60], atol=1)
    metal = surface.image[0, :, 2] / 255
    np.testing.assert_allclose(metal[:3], [1, 0, 0], atol=0.01)
    assert 0.2 < metal[3] < 0.95
    assert half[0] > half[1] > half[2]
    np.testing.assert_allclose(surface.image[0, :, 1] / 255, [0.2, 0.498, 1, 0], atol=0.004)
    assert not any("Texture:" in note for note in model.notes)


def test_the_other_model_beside_specular_glossiness_has_no_effect(tmp_path: Path) -> None:
    """The glossiness texture alone sets the roughness; the core material is for other readers."""
    file = Gltf()
    shiny = {"index": file.texture([[[255, 255, 255, 128]]])}
    other = {"roughnessFactor": 0.5, "metallicFactor": 0.25}
    table = {"specularGlossinessTexture": shiny}
    file.one_triangle(pbrMetallicRoughness=other, **extended("KHR_materials_pbrSpecularGlossiness", **table))
    (material,) = read(file, tmp_path).materials
    assert (material.roughness, material.metallic) == (1, 1)


def test_specular_glossiness_keeps_the_sampler_of_each_material(tmp_path: Path) -> None:
    file = Gltf()
    image = file.image([[[255, 255, 255, 128]]])
    for sampler in ({"wrapS": 33071}, {"wrapS": 33648, "magFilter": 9728}):
        number = file.add("textures", source=image, sampler=file.add("samplers", **sampler))
        table = {"specularGlossinessTexture": {"index": number}}
        file.one_triangle(**extended("KHR_materials_pbrSpecularGlossiness", **table))
    model = read(file, tmp_path)
    slots = [material.surface_texture for material in model.materials]
    textures = [model.textures[slot.texture] for slot in slots if slot is not None]
    found = [(texture.wrap[0], texture.filter) for texture in textures]
    assert found == [("clamp", "linear"), ("mirror", "nearest")]


def test_specular_glossiness_is_converted_alike_in_strips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    found = []
    diffuse, shiny = rng.integers(0, 256, (7, 5, 3)), rng.integers(0, 256, (11, 3, 4))
    for pixels in (10**6, 10):
        monkeypatch.setattr("glpath.io.gltf.surfaces._STRIP_PIXELS", pixels)
        file = Gltf()
        table = {
            "diffuseTexture": {"index": file.texture(diffuse)},
            "specularGlossinessTexture": {"index": file.texture(shiny)},
        }
        file.one_triangle(**extended("KHR_materials_pbrSpecularGlossiness", **table))
        found.append([texture.image for texture in read(file, tmp_path).textures])
    assert [image.shape for image in found[0]] == [(11, 5, 3)] * 2
    np.testing.assert_array_equal(found[0], found[1])


def test_a_mixture_has_the_brightness_of_both_its_colours() -> None:
    """What the converted model reflects at normal incidence is as bright as what the older one says."""
    rng = np.random.default_rng(3)
    grey = rng.uniform(0.05, 0.9, (1, 64, 1))
    specular = np.repeat(rng.uniform(0.04, 1.0, (1, 64, 1)), 3, axis=2)
    diffuse = np.repeat(grey, 3, axis=2)
    base, surface = metal_and_roughness(diffuse, specular, np.zeros((1, 64)))
    colour, metal = decode_srgb(base / 255.0), surface[..., 2:] / 255.0
    inside = (metal > 0.02) & (metal < 0.98)
    assert inside.sum() > 20
    f0 = metal * colour + (1 - metal) * 0.04
    under = (1 - metal) * colour * (1 - 0.04)
    for ours, said in ((f0, specular), (under, diffuse * (1 - specular))):
        assert np.abs(ours - said)[np.repeat(inside, 3, axis=2)].max() < 0.16
        assert np.abs(ours - said)[np.repeat(inside, 3, axis=2)].mean() < 0.04


def test_textures_of_specular_glossiness_that_lie_otherwise_are_told(tmp_path: Path) -> None:
    shifted = {"index": 1, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}
    material, model = glossy(tmp_path, specularGlossinessTexture=shifted, glossinessFactor=0.75)
    assert (material.surface_texture, material.roughness) == (None, 0.25)
    assert any("specularGlossinessTexture" in note for note in model.notes)


def test_an_index_of_zero_leaves_the_reflection_to_its_colour(tmp_path: Path) -> None:
    extensions = {"KHR_materials_ior": {"ior": 0}, "KHR_materials_specular": {"specularColorFactor": [0.5, 1, 0]}}
    material, _ = the_material(tmp_path, extensions=extensions)
    np.testing.assert_allclose(0.04 * material.specular_colour, [0.5, 1, 0])


@pytest.mark.parametrize("index", [0, 0.4])
def test_a_film_has_an_index_of_at_least_1(index: float, tmp_path: Path) -> None:
    film = {"iridescenceFactor": 1, "iridescenceIor": index}
    with pytest.raises(SceneError, match=rf"iridescenceIor is {index:g}, but must be a number, at least 1"):
        the_material(tmp_path, extensions={"KHR_materials_iridescence": film})


def test_unlit_shows_its_colour_as_emission(tmp_path: Path) -> None:
    file = Gltf()
    texture = {"index": file.texture(FOUR)}
    file.one_triangle(
        pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.3, 1], "baseColorTexture": texture},
        **extended("KHR_materials_unlit"),
    )
    model = read(file, tmp_path)
    (material,) = model.materials
    assert material.unlit
    np.testing.assert_array_equal(material.reflectance, 0)
    np.testing.assert_allclose(model.shapes[0].emission, [0.1, 0.2, 0.3])
    assert material.emission_texture is not None
    assert material.texture is None


def test_what_is_not_used_is_noted_once(tmp_path: Path) -> None:
    file = Gltf()
    texture = {"index": file.texture(FOUR)}
    for _ in range(2):
        file.one_triangle(occlusionTexture=texture, **extended("KHR_materials_dispersion", dispersion=1))
    file.json["extensionsUsed"] = ["KHR_materials_dispersion", "ACME_glitter", "ACME_dust"]
    notes = read(file, tmp_path).notes
    assert sum("Occlusion" in note for note in notes) == 1
    assert sum("KHR_materials_dispersion" in note for note in notes) == 1
    assert [note for note in notes if "ACME" in note] == ["The extensions ACME_dust, ACME_glitter."]


@pytest.mark.parametrize(("transmission", "noted"), [(0, True), (1, False)])
def test_attenuation_of_what_is_no_glass_is_noted(transmission: float, noted: bool, tmp_path: Path) -> None:
    extensions = {
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5},
        "KHR_materials_transmission": {"transmissionFactor": transmission},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [1, 0.5, 0.5]},
    }
    _, model = the_material(tmp_path, extensions=extensions)
    assert any("ttenuation" in note for note in model.notes) == noted


def test_a_thickness_texture_is_nothing_lost(tmp_path: Path) -> None:
    """It is for readers that do not trace rays through the solid."""
    file = Gltf()
    volume = {"thicknessFactor": 1, "thicknessTexture": {"index": file.texture(FOUR)}}
    file.one_triangle(extensions={"KHR_materials_volume": volume})
    assert read(file, tmp_path).notes == ()


DDS = b"DDS " + bytes(124)
AVIF = b"\0\0\0\x20ftypavif" + bytes(20)


@pytest.mark.parametrize("data", [None, DDS, AVIF])
def test_a_texture_without_an_image_that_can_be_read_is_left_out(data: bytes | None, tmp_path: Path) -> None:
    file = Gltf()
    texture: dict[str, Any] = {"extensions": {"EXT_texture_avif": {"source": 0}}}
    if data is not None:
        texture = {"source": file.add("images", bufferView=file.view(data), mimeType="image/png")}
    info = {"index": file.add("textures", **texture)}
    shiny = extended("KHR_materials_pbrSpecularGlossiness", specularGlossinessTexture=info, glossinessFactor=0.75)
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info, "baseColorFactor": [1, 0, 0, 1]})
    file.one_triangle(**shiny)
    file.one_triangle(emissiveTexture=info, emissiveFactor=[1, 1, 1])
    model = read(file, tmp_path)
    red, older, _ = model.materials
    assert not any(material.slots for material in model.materials)
    assert (red.reflectance.tolist(), older.roughness) == ([1, 0, 0], 0.25)
    assert not any(np.any(shape.emission) for shape in model.shapes)
    (note,) = [note for note in model.notes if note.startswith("Textures ")]
    assert "PNG" in note


def test_extensions_that_change_no_image_may_be_required(tmp_path: Path) -> None:
    file = Gltf().one_triangle()
    file.json["extensionsRequired"] = ["KHR_xmp_json_ld", "EXT_mesh_features", "EXT_structural_metadata"]
    assert read(file, tmp_path).notes == ()


def test_open_meshes_that_are_not_double_sided_have_no_backs(tmp_path: Path) -> None:
    for both in (True, False):
        material, _ = the_material(tmp_path, doubleSided=both)
        assert material.culled == (not both)
        assert material.two_sided == both
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    material, _ = the_material(tmp_path, doubleSided=False, extensions=glass)
    assert not material.culled


@pytest.mark.parametrize("alpha", ["OPAQUE", "BLEND"])
def test_search_for_visible_backs_is_linear_in_materials(
    alpha: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, count, reads = Gltf(), 60, 0

    class CountingGroup(load._Group):
        def __getattribute__(self, name: str) -> Any:
            nonlocal reads
            reads += name == "surface"
            return super().__getattribute__(name)

    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    for _ in range(count):
        glass = {"baseColorFactor": [1, 1, 1, 0.5]}
        material = file.add("materials", pbrMetallicRoughness=glass, alphaMode=alpha)
        file.node(mesh=file.mesh(corners, [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3], material=material))
    monkeypatch.setattr(load, "_Group", CountingGroup)
    materials = read(file, tmp_path).materials
    assert [each.two_sided for each in materials] == [alpha == "BLEND"] * count
    assert reads <= 10 * count


@pytest.mark.parametrize("inward", [False, True])
def test_backs_of_solids_are_black_as_no_eye_outside_sees_them(inward: bool) -> None:
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    assert is_solid(Mesh(corners + 5, faces[:, ::-1].copy() if inward else faces)) != inward
    assert not is_solid(Mesh(corners, faces[:3]))


@pytest.mark.parametrize(
    ("extras", "black"), [({"backs": "black", "more": []}, True), ({"backs": "glass"}, False), (["backs"], False)]
)
def test_backs_that_were_black_are_kept(extras: Any, black: bool, tmp_path: Path) -> None:
    """As in a file of `glpath export`, which says so; extras of others are of any type."""
    file = Gltf().one_triangle(doubleSided=False)
    file.json["extras"] = extras
    assert read(file, tmp_path).materials[0].culled != black


def test_backs_of_a_material_that_were_black_are_kept(tmp_path: Path) -> None:
    file = Gltf().one_triangle(extras={"backs": "black"}).one_triangle()
    assert [material.culled for material in read(file, tmp_path).materials] == [False, True]


def test_the_first_row_of_an_image_is_at_the_top_and_so_is_v_of_1(tmp_path: Path) -> None:
    file = Gltf()
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": {"index": file.texture(FOUR)}})
    model = read(file, tmp_path)
    texture, slot = model.textures[0], model.materials[0].texture
    assert slot is not None
    mesh = model.shapes[0].geometry
    assert isinstance(mesh, Mesh)
    assert mesh.uv is not None
    # Texture coordinates of the file (0, 0), (1, 0) and (0, 1): red's corner, green's, blue's.
    inward = 0.9 * mesh.uv + 0.1 * np.array([0.5, 0.5])
    found = [texel(texture, slot, uv).tolist() for uv in inward]
    assert found == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
    assert texture.srgb


@pytest.mark.parametrize(
    ("transform", "uv", "looked_up"),
    [
        ({"offset": [0.25, 0.5]}, (0.1, 0.2), (0.35, 0.7)),
        ({"scale": [2, 3]}, (0.1, 0.2), (0.2, 0.6)),
        # A quarter turn counter-clockwise, v downwards: from u's axis to -v's.
        ({"rotation": np.pi / 2}, (0.5, 0), (0, -0.5)),
        ({"rotation": np.pi / 2, "scale": [2, 1], "offset": [0.5, 0]}, (0.5, 0), (0.5, -1)),
    ],
)
def test_texture_transforms_act_on_coordinates_as_the_file_has_them(
    tmp_path: Path, transform: dict[str, Any], uv: tuple[float, float], looked_up: tuple[float, float]
) -> None:
    file = Gltf()
    info = {
        "index": file.texture(FOUR),
        "texCoord": 1,
        **extended("KHR_texture_transform", texCoord=0, **transform),
    }
    slot = read(file.one_triangle(normalTexture=info), tmp_path).materials[0].normal_texture
    assert slot is not None
    assert slot.uv_set == 0
    u, v = slot.uv_transform @ [uv[0], 1 - uv[1], 1]
    np.testing.assert_allclose((u, 1 - v), looked_up, atol=1e-12)


def test_samplers_wrap_and_filter(tmp_path: Path) -> None:
    file = Gltf()
    number = file.texture(FOUR, wrapS=33071, wrapT=33648, magFilter=9728)
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": {"index": number}})
    (texture,) = read(file, tmp_path).textures
    assert (texture.wrap, texture.filter) == (("clamp", "mirror"), "nearest")


@pytest.mark.parametrize("given", [{"wrapS": 10496, "wrapT": 10496}, {"magFilter": 9987}])
def test_samplers_with_numbers_of_opengl_repeat_and_interpolate(given: dict[str, int], tmp_path: Path) -> None:
    """GL_CLAMP, and a filter for minification, which exporters write by mistake."""
    file = Gltf()
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": {"index": file.texture(FOUR, **given)}})
    model = read(file, tmp_path)
    assert (model.textures[0].wrap, model.textures[0].filter) == (("repeat", "repeat"), "linear")
    notes = [note for note in model.notes if "which glTF does not define" in note]
    assert len(notes) == len(given)


def test_one_image_for_colour_and_for_numbers_is_two_textures_of_the_same_pixels(tmp_path: Path) -> None:
    file = Gltf()
    info = {"index": file.texture(FOUR)}
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info, "metallicRoughnessTexture": info})
    colour, numbers = read(file, tmp_path).textures
    assert (colour.srgb, numbers.srgb) == (True, False)
    assert colour.image is numbers.image


@pytest.mark.parametrize(
    ("kind", "options"), [("PNG", {}), ("WEBP", {"lossless": True}), ("JPEG", {"quality": 95})]
)
def test_images_of_each_format(tmp_path: Path, kind: str, options: dict[str, Any]) -> None:
    pixels = np.repeat(np.repeat(FOUR, 8, axis=0), 8, axis=1)
    (tmp_path / "a b.img").write_bytes(encoded(pixels, kind, **options))
    file = Gltf()
    image = file.add("images", uri="a%20b.img")
    fields: dict[str, Any] = extended("EXT_texture_webp", source=image) if kind == "WEBP" else {"source": image}
    info = {"index": file.add("textures", **fields)}
    found = read(file.one_triangle(emissiveTexture=info, emissiveFactor=[1, 1, 1]), tmp_path).textures[0].image
    assert found.dtype == np.uint8
    np.testing.assert_allclose(found[4::8, 4::8].astype(int), FOUR, atol=8 if kind == "JPEG" else 0)


def test_alpha_is_kept_and_grey_becomes_three_alike(tmp_path: Path) -> None:
    for pixels, channels in ((np.dstack([FOUR, FOUR[..., 0]]), 4), (FOUR[..., 0], 3)):
        file = Gltf()
        info = {"index": file.texture(pixels)}
        (texture,) = read(file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info}), tmp_path).textures
        assert texture.image.shape == (2, 2, channels)
        np.testing.assert_array_equal(texture.image[..., -1], FOUR[..., 0])


def test_grey_of_16_bits_keeps_them(tmp_path: Path) -> None:
    file = Gltf()
    stored = np.array([[0, 1000], [30000, 65535]], np.uint16)
    info = {"index": file.texture(stored)}
    (texture,) = read(file.one_triangle(normalTexture=info), tmp_path).textures
    assert texture.image.dtype == np.float32
    np.testing.assert_allclose(texture.image[..., 1], stored / 65535, rtol=1e-6)


def test_ktx2_is_decoded_or_its_library_named(tmp_path: Path) -> None:
    colours = np.array([[[255, 0, 0, 255], [0, 255, 0, 128]], [[0, 0, 255, 255], [9, 8, 7, 0]]], np.uint8)
    (tmp_path / "a.ktx2").write_bytes(ktx2_of_solid_blocks(colours))
    file = Gltf()
    packed = file.add("images", uri="a.ktx2")
    info = {"index": file.add("textures", **extended("KHR_texture_basisu", source=packed))}
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info})
    if find_spec("opengl_basisu") is None:
        with pytest.raises(SceneError, match=r"glpath\[ktx2\]"):
            read(file, tmp_path)
        return
    (texture,) = read(file, tmp_path).textures
    np.testing.assert_array_equal(texture.image, np.repeat(np.repeat(colours, 4, axis=0), 4, axis=1))


def test_ktx2_of_another_kind_is_refused_by_its_kind(tmp_path: Path) -> None:
    pytest.importorskip("opengl_basisu", reason="needs the extra ktx2")
    content = bytearray(ktx2_of_solid_blocks(np.full((1, 1, 4), 9, np.uint8)))
    content[12:16] = (23).to_bytes(4, "little")  # VK_FORMAT_R8G8B8_UNORM
    (tmp_path / "a.ktx2").write_bytes(bytes(content))
    file = Gltf()
    info = {
        "index": file.add("textures", **extended("KHR_texture_basisu", source=file.add("images", uri="a.ktx2")))
    }
    with pytest.raises(SceneError, match=r"images\[0\] is a texture that KHR_texture_basisu does not allow.*23"):
        read(file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info}), tmp_path)


def test_a_plain_image_beside_one_of_ktx2_needs_no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    file = Gltf()
    packed = file.add("images", uri="not-there.ktx2")
    texture = {"source": file.image(FOUR), **extended("KHR_texture_basisu", source=packed)}
    info = {"index": file.add("textures", **texture)}
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info})
    np.testing.assert_array_equal(read(file, tmp_path).textures[0].image, FOUR)


def test_a_texture_without_coordinates_is_noted_and_has_some(tmp_path: Path) -> None:
    file = Gltf()
    info = {"index": file.texture(FOUR), "texCoord": 1}
    file.one_triangle(pbrMetallicRoughness={"baseColorTexture": info})
    model = read(file, tmp_path)
    mesh = model.shapes[0].geometry
    assert isinstance(mesh, Mesh)
    assert mesh.uv1 is not None
    assert any("without texture coordinates" in note for note in model.notes)


def lamp(**fields: Any) -> Gltf:
    file = Gltf()
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [fields]}}
    # A quarter turn about x: -z goes to +y.
    half = np.sqrt(0.5)
    file.node(rotation=[half, 0, 0, half], translation=[1, 2, 3], **extended("KHR_lights_punctual", light=0))
    return file


def test_candela_are_watts_per_steradian_and_lux_watts_per_square_metre(tmp_path: Path) -> None:
    for kind in ("point", "directional", "spot"):
        model = read(lamp(type=kind, intensity=10, color=[1, 0.5, 0]), tmp_path, light_factor=0.5)
        (light,) = model.lights
        assert (light.kind, light.falloff) == (kind, "quadratic")
        np.testing.assert_allclose(light.intensity, [5, 2.5, 0])
        if kind != "point":
            np.testing.assert_allclose(light.direction, [0, 1, 0], atol=1e-12)
        if kind != "directional":
            np.testing.assert_allclose(light.position, [1, 2, 3])


def test_spots_have_their_cone_in_degrees(tmp_path: Path) -> None:
    (light,) = read(lamp(type="spot", spot={"innerConeAngle": 0.25, "outerConeAngle": 0.5}), tmp_path).lights
    np.testing.assert_allclose(light.cone, np.degrees([0.25, 0.5]))
    (light,) = read(lamp(type="spot"), tmp_path).lights
    np.testing.assert_allclose(light.cone, (0, 45))


def test_the_range_of_a_light_is_noted(tmp_path: Path) -> None:
    assert any("range" in note for note in read(lamp(type="point", range=3), tmp_path).notes)


@pytest.mark.parametrize(("kind", "count"), [("point", 1), ("spot", 0), ("directional", 0)])
def test_a_light_that_is_scaled_to_nothing_needs_no_direction_or_is_left_out(
    kind: str, count: int, tmp_path: Path
) -> None:
    file = lamp(type=kind)
    file.json["nodes"][0]["scale"] = [0, 0, 0]
    model = read(file, tmp_path)
    assert len(model.lights) == count
    assert any("scaled to nothing" in note for note in model.notes) == (not count)


def test_a_camera_that_is_scaled_to_nothing_is_left_out(tmp_path: Path) -> None:
    file = two_cameras()
    file.json["nodes"][0]["scale"] = [0, 0, 0]
    model = read(file, tmp_path)
    assert [camera.name for camera in model.cameras] == ["narrow", "camera-2"]
    assert any("Cameras" in note for note in model.notes)
    with pytest.raises(UsageError, match="narrow"):
        read(file, tmp_path, camera="wide")


def test_a_camera_that_shrinks_to_nothing_has_the_poses_before(tmp_path: Path) -> None:
    file = two_cameras()
    sampler = {"input": file.accessor([0.0, 1.0]), "output": file.accessor([[1, 1, 1], [0, 0, 0]])}
    channels = [
        {"sampler": i, "target": {"node": 0, "path": path}} for i, path in enumerate(("scale", "translation"))
    ]
    moved = {"input": sampler["input"], "output": file.accessor([[0, 0, 0], [16, 0, 0]])}
    file.add("animations", samplers=[sampler, moved], channels=channels)
    motion = read(file, tmp_path, time=0.0, shutter=1.0).cameras[0].motion
    assert [key.time for key in motion] == (np.arange(16) / 16).tolist()
    np.testing.assert_allclose([key.position[0] for key in motion], np.arange(16))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mirrored_camera_is_noted(mirrored: bool, tmp_path: Path) -> None:
    file = two_cameras()
    file.json["nodes"][0]["scale"] = [-1 if mirrored else 1, 1, 1]
    assert any("mirror" in note for note in read(file, tmp_path).notes) == mirrored


def two_cameras() -> Gltf:
    file = Gltf()
    for name, fov in (("wide", 1.2), ("narrow", 0.3)):
        number = file.add("cameras", type="perspective", perspective={"yfov": fov, "znear": 0.1, "aspectRatio": 2})
        file.node(name=name, camera=number, translation=[0, 1, 5], scale=[3, 3, 3])
    file.node(
        camera=file.add("cameras", type="orthographic", orthographic={"xmag": 3, "ymag": 2, "zfar": 1, "znear": 0})
    )
    return file


def test_cameras_look_along_minus_z_with_y_up(tmp_path: Path) -> None:
    model = read(two_cameras(), tmp_path)
    first, second, parallel = model.cameras
    assert model.camera is first
    np.testing.assert_allclose(first.position, [0, 1, 5])
    np.testing.assert_allclose(first.target, [0, 1, 4])
    np.testing.assert_allclose(first.up, [0, 1, 0])
    assert (first.fov, first.aspect) == (pytest.approx(np.degrees(1.2)), 2)
    assert second.fov == pytest.approx(np.degrees(0.3))
    assert (parallel.projection, parallel.height, parallel.aspect) == ("orthographic", 4, 1.5)


def test_a_camera_is_chosen_by_name_or_number(tmp_path: Path) -> None:
    for wanted in ("narrow", 1):
        camera = read(two_cameras(), tmp_path, camera=wanted).camera
        assert camera is not None
        assert camera.name == "narrow"
    for wanted in ("other", 3, -1):
        with pytest.raises(UsageError, match="narrow"):
            read(two_cameras(), tmp_path, camera=wanted)
