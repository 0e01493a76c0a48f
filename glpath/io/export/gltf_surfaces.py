"""Export of materials and textures to glTF 2.0, each once, for `glpath.io.export.gltf`.

A surface without microfacets is written with roughness 1 and without specular reflection (KHR_materials_specular),
so it is Lambertian.

Poor at:  textures with more than eight bits per channel.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.export import gltf_json
from glpath.io.export.geometry import Notes, map_downwards
from glpath.io.export.glb import Glb
from glpath.io.gltf.material_extensions import LAYERS
from glpath.io.gltf.surfaces import BLACK_BACKS
from glpath.scene.geometry import Float64, Shape
from glpath.scene.material import Material, TextureSlot
from glpath.scene.model import Scene
from glpath.system.colour import encode_srgb
from glpath.system.units import conversion

_WRAPS = {
    "repeat": gltf_json.REPEAT,
    "clamp": gltf_json.CLAMP_TO_EDGE,
    "mirror": gltf_json.MIRRORED_REPEAT,
}
_NEAREST = gltf_json.NEAREST, gltf_json.NEAREST
_SMOOTH = gltf_json.LINEAR, gltf_json.LINEAR_MIPMAP_LINEAR
# Reflectance at normal incidence for the index 1.5; the colour of KHR_materials_specular multiplies it.
_F0 = 0.04
#: Light map: an image (h, w, 3) uint8 of linear irradiance, looked up by the second texture coordinates; and the
#: irradiance for which 255 stands, in the scene's unit.
LightMap = tuple[NDArray[np.uint8], float]


class MaterialWriter:
    """Materials and textures that shapes use, each written once to a file.

    scene : scene in triangles
    file  : file that they are added to
    notes : differences between the file and the scene
    """

    def __init__(self, scene: Scene, file: Glb, notes: Notes) -> None:
        self.scene, self.file, self.notes = scene, file, notes
        self._materials: dict[tuple[object, ...], int] = {}
        self._names: set[str] = set()
        self._textures: dict[tuple[int, bool, bool, float], int] = {}
        self._light_textures: dict[int, int] = {}
        #: True if a material of a shape is culled from behind, so that backs are not all black.
        self.culls = any(scene.materials[shape.material].culled for shape in scene.shapes)

    def material(self, shape: Shape, light: LightMap | None) -> int:
        """Return the index of a shape's material, with its light map."""
        material = self.scene.materials[shape.material]
        # The back of a solid's surface is its inside, so a solid is never two-sided.
        two_sided = material.two_sided and (material.thin or material.transmission == 0)
        if shape.emits and shape.emission_two_sided != two_sided:
            two_sided = shape.emission_two_sided
            text = (
                "its back emits light, so its back also reflects"
                if two_sided
                else "it emits from its front alone, so its back is culled"
            )
            self.notes.add(text + ": both sides of a surface are alike in glTF", "shape", shape.name)
        key = (shape.material, tuple(shape.emission), two_sided, None if light is None else id(light[0]))
        if key not in self._materials:
            self._materials[key] = len(self.file.materials)
            self.file.materials.append(self._made(material, shape.emission, two_sided))
            if light is not None:
                self.file.materials[-1].extensions[self.file.use("MOZ_lightmap")] = self._light_map(light)
            if material.name in self._names:
                self.file.materials[-1].name += f" ({shape.name})"
            self._names.add(material.name)
        return self._materials[key]

    def _made(self, material: Material, emission: Float64, two_sided: bool) -> gltf_json.Material:
        made = gltf_json.Material(name=material.name, double_sided=two_sided, alpha_mode=material.alpha.upper())
        if self.culls and not two_sided and not material.culled:
            made.extras = BLACK_BACKS
        made.alpha_cutoff = material.cutoff if material.alpha == "mask" else None
        opacity = 1.0 if material.alpha == "opaque" else material.opacity
        if material.unlit:
            self._unlit(made, material, emission, opacity)
            return made
        base, roughness, metallic = material.reflectance, 1.0, 0.0
        if material.roughness is None:
            base, roughness, metallic = self._without_microfacets(made, material)
        else:
            roughness, metallic = material.roughness, material.metallic
            self._layers(made.extensions, material)
            if material.layering != "gltf" or material.metal_index is not None or material.distribution != "ggx":
                self._note(material, "its Fresnel reflection, base and microfacets (GGX) are those of glTF")
            if material.scatters_repeatedly and not material.multiple_scattering:
                self._note(material, "light that its microfacets scatter twice is lost here, not where it is read")
        made.pbr_metallic_roughness = gltf_json.PbrMetallicRoughness(
            base_color_factor=[*np.clip(base, 0.0, 1.0).tolist(), opacity],
            roughness_factor=roughness,
            metallic_factor=metallic,
            base_color_texture=self._slot(material.texture, srgb=True, alpha=material.alpha != "opaque"),
            metallic_roughness_texture=self._slot(material.surface_texture),
        )
        info = self._slot(material.normal_texture)
        if info is not None:
            made.normal_texture = gltf_json.NormalTextureInfo(
                index=info.index, tex_coord=info.tex_coord, extensions=info.extensions, scale=material.normal_scale
            )
        self._emission(made, material, emission)
        return made

    def _unlit(self, made: gltf_json.Material, material: Material, emission: Float64, opacity: float) -> None:
        if emission.max() > 1:
            self.notes.add("it is unlit, and limited to 1", "material", material.name)
        made.extensions[self.file.use("KHR_materials_unlit")] = {}
        made.pbr_metallic_roughness = gltf_json.PbrMetallicRoughness(
            base_color_factor=[*np.clip(emission, 0.0, 1.0).tolist(), opacity],
            roughness_factor=1.0,
            metallic_factor=0.0,
            base_color_texture=self._slot(material.emission_texture or material.texture, srgb=True, alpha=True),
        )

    def _without_microfacets(self, made: gltf_json.Material, material: Material) -> tuple[Float64, float, float]:
        """Return base colour, roughness and metallic. Adds the extension for specular reflection to `made`."""
        mirror, highlight = material.mirror, 2.0 * material.specular / (material.exponent + 1.0)
        if np.any(mirror > 0) and not np.any(highlight > 0) and not np.any(material.reflectance > 0):
            self._note(material, "its mirror is a smooth metal, which reflects all light at grazing angles")
            return mirror, 0.0, 1.0
        reflected, roughness = np.zeros(3), 1.0
        if np.any(mirror > 0):
            reflected, roughness = mirror, 0.0
            if np.any(highlight > 0):
                self._note(material, "Phong's highlight beside a mirror is left out")
        elif np.any(highlight > 0):
            self._note(material, "Phong's highlight is microfacets (GGX) of about the same width and albedo")
            # Equal width: exponent = 2 / alpha^2 - 2 [Walter et al. 2007], and roughness is the square root of
            # alpha.
            reflected, roughness = np.minimum(highlight, 1.0), (2.0 / (material.exponent + 2.0)) ** 0.25
        # The reflectance is F0 * colour * weight at normal incidence and `weight` at grazing incidence. glTF scales
        # the base by 1 - weight, so the base is divided by that.
        weight = float(reflected.max())
        extension: dict[str, Any] = {"specularFactor": weight}
        if weight > 0:
            extension["specularColorFactor"] = (reflected / (weight * _F0)).tolist()
        made.extensions[self.file.use("KHR_materials_specular")] = extension
        base = material.reflectance / max(1.0 - weight, 1e-9)
        if base.max() > 1 + 1e-9:
            self._note(material, "it reflects more light than it receives; the excess is cut")
        return base, roughness, 0.0

    def _layers(self, extensions: dict[str, Any], material: Material) -> None:
        """Add the extensions of microfacets whose values differ from their defaults."""
        use = self.file.use
        if material.ior != 1.5:
            extensions[use("KHR_materials_ior")] = {"ior": material.ior}
        if (
            material.specular_weight != 1
            or np.any(material.specular_colour != 1)
            or {"specular_texture", "specular_colour_texture"} & material.slots.keys()
        ):
            extensions[use("KHR_materials_specular")] = {
                "specularFactor": material.specular_weight,
                "specularColorFactor": material.specular_colour.tolist(),
                **self._info("specularTexture", material.specular_texture, alpha=True),
                **self._info("specularColorTexture", material.specular_colour_texture, srgb=True),
            }
        for extension, layer in LAYERS.items():
            if np.any(getattr(material, layer.strength) > 0):
                made = {
                    name: np.asarray(getattr(material, field)).tolist() for name, field in layer.factors.items()
                }
                made |= {name: getattr(material, at) for name, at in layer.numbers.items()}
                for name, into in layer.textures.items():
                    made |= self._info(name, getattr(material, into.field), srgb=into.srgb, alpha=into.alpha)
                    if into.scale is not None and name in made:
                        made[name]["scale"] = getattr(material, into.scale)
                extensions[use(extension)] = made
        if material.anisotropy > 0:
            extensions[use("KHR_materials_anisotropy")] = {
                "anisotropyStrength": material.anisotropy,
                "anisotropyRotation": math.radians(material.anisotropy_angle),
                **self._info("anisotropyTexture", material.anisotropy_texture),
            }
        if material.transmission > 0:
            extensions[use("KHR_materials_transmission")] = {
                "transmissionFactor": material.transmission,
                **self._info("transmissionTexture", material.transmission_texture),
            }
            if material.is_slab:
                self._note(material, "it reflects at both faces, but in glTF at one")
            if not material.thin:
                extensions[use("KHR_materials_volume")] = _volume(material)

    def _emission(self, made: gltf_json.Material, material: Material, emission: Float64) -> None:
        if not np.any(emission > 0):
            return
        slot = material.emission_texture
        if slot is not None:
            divisor = self._max_emission(slot.texture)
            made.emissive_texture = self._slot(slot, srgb=True, divisor=divisor)
            emission = emission * divisor
        emission = conversion(self.scene.unit, "photometric") * emission
        strength = max(float(emission.max()), 1.0)
        made.emissive_factor = (emission / strength).tolist()
        if strength > 1:
            made.extensions[self.file.use("KHR_materials_emissive_strength")] = {"emissiveStrength": strength}

    def _note(self, material: Material, text: str) -> None:
        self.notes.add(text, "material", material.name)

    def _light_map(self, light: LightMap) -> dict[str, Any]:
        picture, range_ = light
        if id(picture) not in self._light_textures:
            sampler = gltf_json.Sampler(
                mag_filter=gltf_json.LINEAR,
                min_filter=gltf_json.LINEAR,
                wrap_s=gltf_json.CLAMP_TO_EDGE,
                wrap_t=gltf_json.CLAMP_TO_EDGE,
            )
            self._light_textures[id(picture)] = len(self.file.textures)
            self.file.samplers.append(sampler)
            image = self.file.add_image("light", picture)
            self.file.textures.append(
                gltf_json.Texture(name="light", sampler=len(self.file.samplers) - 1, source=image)
            )
        return {"index": self._light_textures[id(picture)], "texCoord": 1, "intensity": range_}

    # Textures

    def _slot(
        self, slot: TextureSlot | None, *, srgb: bool = False, alpha: bool = False, divisor: float = 1.0
    ) -> gltf_json.TextureInfo | None:
        """Return the reference to a slot's texture, whose colours are divided by `divisor`; None if `slot` is."""
        if slot is None:
            return None
        texture = self.scene.textures[slot.texture]
        info = gltf_json.TextureInfo(index=self._texture(slot.texture, srgb, alpha, divisor), tex_coord=slot.uv_set)
        matrix = map_downwards(slot.uv_transform, texture.scale)
        if not np.array_equal(matrix, np.eye(3)):
            transform, exact = _uv_transform(matrix)
            if not exact:
                self.notes.add("the shear of its coordinates is left out", "texture", texture.name)
            info.extensions = {self.file.use("KHR_texture_transform"): transform}
        return info

    def _info(
        self, name: str, slot: TextureSlot | None, *, srgb: bool = False, alpha: bool = False
    ) -> dict[str, Any]:
        """Return the property `name` of an extension that holds a slot's texture; empty if there is no slot."""
        info = self._slot(slot, srgb=srgb, alpha=alpha)
        if info is None:
            return {}
        made = {"index": info.index, "texCoord": info.tex_coord}
        return {name: made | ({"extensions": info.extensions} if info.extensions else {})}

    def _texture(self, number: int, srgb: bool, alpha: bool, divisor: float) -> int:
        texture = self.scene.textures[number]
        key = (number, srgb, alpha and texture.image.shape[2] == 4, divisor)
        if key not in self._textures:
            filters = _NEAREST if texture.filter == "nearest" else _SMOOTH
            sampler = gltf_json.Sampler(
                mag_filter=filters[0],
                min_filter=filters[1],
                wrap_s=_WRAPS[texture.wrap[0]],
                wrap_t=_WRAPS[texture.wrap[1]],
            )
            if sampler not in self.file.samplers:
                self.file.samplers.append(sampler)
            self._textures[key] = len(self.file.textures)
            image = self.file.add_image(texture.name, self._image(number, srgb, divisor)[..., : 4 if key[2] else 3])
            self.file.textures.append(
                gltf_json.Texture(name=texture.name, sampler=self.file.samplers.index(sampler), source=image)
            )
        return self._textures[key]

    def _image(self, number: int, srgb: bool, divisor: float) -> NDArray[np.uint8]:
        """Return the image with eight bits per channel, its colours in sRGB if `srgb`, otherwise linear.

        Colours are divided by `divisor`, then limited to 1.
        """
        texture = self.scene.textures[number]
        if texture.image.dtype == np.uint8 and texture.srgb == srgb:
            return np.asarray(texture.image, np.uint8)
        values = texture.linear().astype(np.float64)
        values[..., :3] /= divisor
        if values.max() > 1:
            self.notes.add("its values above 1 are 1", "texture", texture.name)
        values = np.clip(values, 0.0, 1.0)
        if srgb:
            values[..., :3] = encode_srgb(values[..., :3])
        return np.asarray(np.round(255.0 * values), np.uint8)

    def _max_emission(self, number: int) -> float:
        """Return the divisor that scales an emission texture to at most 1."""
        image = self.scene.textures[number].image
        return 1.0 if image.dtype == np.uint8 else max(float(image[..., :3].max()), 1.0)


def _volume(material: Material) -> dict[str, Any]:
    """Return the volume extension of a solid.

    Rasterizers use the thickness, which is 1 scene unit; glpath only checks that it is not 0.
    """
    made: dict[str, Any] = {"thicknessFactor": 1.0}
    densest = float(material.attenuation.max())
    if densest > 0:
        made["attenuationDistance"] = 1.0 / densest
        made["attenuationColor"] = np.exp(-material.attenuation / densest).tolist()
    return made


def _uv_transform(matrix: Float64) -> tuple[dict[str, Any], bool]:
    """Return the fields of KHR_texture_transform for a matrix of texture coordinates, and True if they are exact.

    The extension has no shear, so they are not exact for a matrix with shear.

    matrix : (3, 3), for v downwards
    """
    across, down = matrix[:2, 0], matrix[:2, 1]
    angle = math.atan2(-across[1], across[0])
    c, s = math.cos(angle), math.sin(angle)
    scale = np.array([float(np.linalg.norm(across)), float(down @ (s, c))])
    rebuilt = np.array([[c, s], [-s, c]]) * scale
    made: dict[str, Any] = {"offset": matrix[:2, 2].tolist(), "scale": scale.tolist()}
    if angle != 0:
        made["rotation"] = angle
    return made, bool(np.allclose(rebuilt, matrix[:2, :2], rtol=1e-6, atol=1e-9))
