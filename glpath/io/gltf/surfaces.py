"""Materials and their textures.

A glTF material whose `doubleSided` is false is culled from behind: its back is not drawn. Here, camera rays,
bounces and shadow rays also ignore the back (`Material.culled`), unless the caller asks for black backs that block
light. Emitted light in nits, glTF's unit, is taken one to one as W sr^-1 m^-2. Unlit surfaces emit their colour, so
they light other surfaces.

Source: glTF 2.0, 3.8, 3.9 and appendix B; the KHR_materials extensions; KHR_texture_transform.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf import compression
from glpath.io.gltf.document import Document
from glpath.io.gltf.images import UnknownFormatError, read_image
from glpath.io.gltf.material_extensions import LAYERS
from glpath.io.gltf.table import Choice, Table
from glpath.scene.material import Wrap
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from glpath.system.colour import decode_srgb, encode_srgb
from glpath.system.time_limit import check_time

#: Reflectance of a dielectric of index 1.5 at normal incidence.
F0 = 0.04
_TINY = 1e-6
_WRAPS: dict[Any, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_FILTERS: dict[Any, Literal["linear", "nearest"]] = {9728: "nearest", 9729: "linear"}
_ALPHA: dict[Any, Literal["opaque", "mask", "blend"]] = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}
_STRENGTH = "KHR_materials_emissive_strength"
#: Entry that `glpath export` adds to the extras of a file, or of a material, if one-sided backs are black.
BLACK_BACKS = {"backs": "black"}
# Number of pixels that are converted at once.
_STRIP_PIXELS = 1 << 18
# Material with defaults; its fields are numbers, or arrays for colours.
_PLAIN = Material("plain", np.ones(3))


@dataclass(frozen=True)
class Surface:
    """Material and its emission; in glpath the emission belongs to the shape.

    emission    : (3,) radiance W sr^-1 m^-2, of both sides if the material is two-sided
    black_backs : True if `glpath export` wrote the material for black backs
    """

    material: Material
    emission: Float64
    black_backs: bool = False


@dataclass(frozen=True)
class _LookUp:
    """Image of a texture and its lookup; see `Texture` and `TextureSlot`."""

    source: int
    wrap: tuple[Wrap, Wrap]
    filter: Literal["linear", "nearest"]
    uv_set: Literal[0, 1]
    matrix: Float64


@dataclass
class MaterialReader:
    """Materials of a document that shapes use, and their textures."""

    document: Document
    surfaces: list[Surface] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    _numbers: dict[int | None, int] = field(default_factory=dict)
    _texture_numbers: dict[tuple[object, ...], int] = field(default_factory=dict)
    _names: set[str] = field(default_factory=set)
    _unreadable: set[int] = field(default_factory=set)

    def number(self, index: int | None) -> int:
        """Return the index in `surfaces` of a material of the document; None is glTF's default material."""
        if index not in self._numbers:
            table = Table({}, self.document.location.field("materials"))
            if index is not None:
                table = self.document.all("materials")[index]
            name = table.name("default" if index is None else f"material-{index}")
            if name in self._names:
                name = f"{name}-{index}"
            self._names.add(name)
            self.surfaces.append(replace(self._surface(table, name), black_backs=has_black_backs(table)))
            self._numbers[index] = len(self.surfaces) - 1
        return self._numbers[index]

    def _surface(self, table: Table, name: str) -> Surface:
        pbr = table.table("pbrMetallicRoughness")
        base = self._shares(pbr, "baseColorFactor", (1, 1, 1, 1))
        alpha = table.choice("alphaMode", _ALPHA, "opaque")
        texture = self._slot(pbr, "baseColorTexture", srgb=True)
        two_sided = table.flag("doubleSided")
        common: dict[str, Any] = {
            "name": name,
            "two_sided": two_sided,
            "opacity": 1.0 if alpha == "opaque" else float(base[3]),
            "alpha": alpha,
            "cutoff": table.number("alphaCutoff", 0.5, 0.0),
            "roughness": 1.0,
        }
        if table.extension("KHR_materials_unlit") is not None:
            # The texture supplies the alpha; the unlit colour reflects no light.
            return Surface(
                Material(
                    reflectance=np.zeros(3),
                    unlit=True,
                    texture=None if alpha == "opaque" else texture,
                    emission_texture=texture,
                    **common,
                ),
                base[:3],
            )
        if "occlusionTexture" in table:
            self.document.notes.add("Occlusion textures: what they stand for is computed.")
        glossy = table.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None:
            return self._specular_glossiness(table, glossy, common)
        common["roughness"] = self._share(pbr, "roughnessFactor", 1.0)
        metallic, layers = self._share(pbr, "metallicFactor", 1.0), self._layers(table)
        if _is_diffuse(metallic, layers):
            common["roughness"] = None
        else:
            surface = self._slot(pbr, "metallicRoughnessTexture", srgb=False)
            common |= layers | {"metallic": metallic, "surface_texture": surface}
        material = Material(
            reflectance=base[:3],
            texture=texture,
            normal_texture=self._slot(table, "normalTexture", srgb=False),
            normal_scale=table.table("normalTexture").number("scale", 1.0),
            **self._emission_texture(table),
            **common,
        )
        return Surface(material, self._emission(table))

    def _specular_glossiness(self, table: Table, glossy: Table, common: dict[str, Any]) -> Surface:
        """Return the surface of a specular-glossiness material.

        This older model has a diffuse colour and a specular colour at normal incidence.
        """
        diffuse = self._shares(glossy, "diffuseFactor", (1, 1, 1, 1))
        specular = self._shares(glossy, "specularFactor", (1, 1, 1))
        gloss = self._share(glossy, "glossinessFactor", 1.0)
        common["opacity"] = 1.0 if common["alpha"] == "opaque" else float(diffuse[3])
        fields: dict[str, Any] | None = None
        if "specularGlossinessTexture" in glossy:
            fields = self._of_metal_and_roughness(glossy, diffuse[:3], specular, gloss)
            if fields is None:
                self._unused(glossy, "specularGlossinessTexture")
        if fields is None:
            common["roughness"] = 1.0 - gloss
            fields = {
                "reflectance": diffuse[:3],
                "texture": self._slot(glossy, "diffuseTexture", srgb=True),
                "specular_colour": specular / F0,
            }
        material = Material(
            normal_texture=self._slot(table, "normalTexture", srgb=False),
            normal_scale=table.table("normalTexture").number("scale", 1.0),
            **fields,
            **self._emission_texture(table),
            **common,
        )
        return Surface(material, self._emission(table))

    def _of_metal_and_roughness(
        self, glossy: Table, diffuse: Float64, specular: Float64, gloss: float
    ) -> dict[str, Any] | None:
        """Return the fields of a material whose specular-glossiness textures are converted texel by texel.

        Returns None if the two textures have different lookups, because their texels then do not correspond.
        """
        second = self._look_up(glossy, "specularGlossinessTexture")
        first = self._look_up(glossy, "diffuseTexture") if "diffuseTexture" in glossy else second
        if first is None or second is None:
            return None
        if (first.wrap, first.uv_set) != (second.wrap, second.uv_set) or np.any(first.matrix != second.matrix):
            return None
        lookup = first.source, second.source, first.wrap, first.filter
        key = ("glossiness", *lookup, *diffuse, *specular, gloss, "diffuseTexture" in glossy)
        if key not in self._texture_numbers:
            pictures = [read_image(self.document, source) for source in (first.source, second.source)]
            height, width = (max(each.shape[axis] for each in pictures) for axis in (0, 1))
            self.document.take(16 * height * width, glossy.location)
            strips = []
            rows = max(1, _STRIP_PIXELS // width)  # in strips, because intermediate results take 24 bytes a pixel
            for top in range(0, height, rows):
                check_time()
                part = range(top, min(top + rows, height))
                colour, shiny = (_linear(_nearest(each, part, height, width)) for each in pictures)
                if "diffuseTexture" not in glossy:
                    colour = np.ones_like(colour[..., :3])
                colour[..., :3] *= diffuse
                share = shiny[..., 3] if shiny.shape[2] == 4 else np.ones(shiny.shape[:2])
                strips.append(metal_and_roughness(colour, shiny[..., :3] * specular, gloss * share))
            name = self.document.all("images")[second.source].name(f"image-{second.source}")
            self._texture_numbers[key] = len(self.textures)
            for parts, srgb in zip(zip(*strips, strict=True), (True, False), strict=True):
                image = np.concatenate(parts)
                self.textures.append(Texture(name, image, (1.0, 1.0), first.filter, srgb, first.wrap))
        number = self._texture_numbers[key]
        return {
            "reflectance": np.ones(3),
            "metallic": 1.0,
            "texture": TextureSlot(number, first.uv_set, first.matrix),
            "surface_texture": TextureSlot(number + 1, first.uv_set, first.matrix),
        }

    def _emission(self, table: Table) -> Float64:
        """Return the (3,) emitted radiance of a material that is not unlit."""
        factor, stronger = table.numbers("emissiveFactor", (0, 0, 0), 0.0), table.extension(_STRENGTH)
        if factor.any() and "emissiveTexture" in table and self._look_up(table, "emissiveTexture") is None:
            return np.zeros(3)  # without its texture, the factor would make the whole surface emit
        return factor if stronger is None else factor * stronger.number("emissiveStrength", 1.0, 0.0)

    def _emission_texture(self, table: Table) -> dict[str, Any]:
        """Return the `emission_texture` field; empty if the emissive factor, which multiplies the texture, is 0."""
        if not table.numbers("emissiveFactor", (0, 0, 0), 0.0).any():
            return {}
        return {"emission_texture": self._slot(table, "emissiveTexture", srgb=True)}

    def _layers(self, table: Table) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        ior = table.extension("KHR_materials_ior")
        if ior is not None:
            index = ior.number("ior", 1.5, 0.0)
            if 0 < index < 1:
                raise ior.location.field("ior").wrong(index, "0 or at least 1", "Water has 1.33, window glass 1.5.")
            fields["ior"] = index or 1.5
        specular = table.extension("KHR_materials_specular")
        if specular is not None:
            fields["specular_weight"] = self._share(specular, "specularFactor", 1.0)
            fields["specular_colour"] = specular.numbers("specularColorFactor", (1, 1, 1), 0.0)
            if fields["specular_weight"] > 0:  # the textures have no effect if the weight is 0
                fields["specular_texture"] = self._slot(specular, "specularTexture", srgb=False)
                fields["specular_colour_texture"] = self._slot(specular, "specularColorTexture", srgb=True)
        if ior is not None and ior.number("ior", 1.5) == 0:
            # An index of 0 means that the specular colour alone sets the reflection.
            fields["specular_colour"] = fields.get("specular_colour", np.ones(3)) / F0
        for extension, layer in LAYERS.items():
            found = table.extension(extension)
            if found is not None:
                for name, target in layer.factors.items():
                    default = getattr(_PLAIN, target)
                    is_colour = np.ndim(default) > 0
                    fields[target] = (
                        self._shares(found, name, tuple(default))
                        if is_colour
                        else self._share(found, name, default)
                    )
                if np.any(fields[layer.strength]):
                    for name, target in layer.numbers.items():
                        low = 1.0 if target == "iridescence_ior" else 0.0
                        fields[target] = found.number(name, getattr(_PLAIN, target), low)
                    for name, into in layer.textures.items():
                        fields[into.field] = self._slot(found, name, srgb=into.srgb)
                        if into.scale is not None and name in found:
                            fields[into.scale] = found.table(name).number("scale", 1.0)
        anisotropic = table.extension("KHR_materials_anisotropy")
        if anisotropic is not None:
            fields["anisotropy"] = self._share(anisotropic, "anisotropyStrength", 0.0)
            # The angle is counter-clockwise from u to v if v points upwards, as it does here.
            fields["anisotropy_angle"] = float(np.degrees(anisotropic.number("anisotropyRotation", 0.0)))
            if fields["anisotropy"] > 0:
                fields["anisotropy_texture"] = self._slot(anisotropic, "anisotropyTexture", srgb=False)
        glass = table.extension("KHR_materials_transmission")
        if glass is not None:
            fields["transmission"] = self._share(glass, "transmissionFactor", 0.0)
            fields["transmission_texture"] = self._slot(glass, "transmissionTexture", srgb=False)
        volume = table.extension("KHR_materials_volume")
        if volume is not None and volume.number("thicknessFactor", 0.0, 0.0) > 0:
            fields["thin"] = False
            colour = self._shares(volume, "attenuationColor", (1, 1, 1))
            distance = volume.number("attenuationDistance", np.inf, 0.0, np.inf)
            if not distance > 0:
                raise volume.location.field("attenuationDistance").wrong(distance, "above 0")
            # At least 1e-300, because the logarithm of 0 is infinite; the transmitted light is equally black.
            fields["attenuation"] = -np.log(np.maximum(colour, 1e-300)) / distance + 0.0
            is_glass = fields.get("transmission", 0.0) > 0
            if not is_glass and fields.get("diffuse_transmission", 0.0) > 0 and fields["attenuation"].any():
                self.document.notes.add(
                    "Attenuation inside of surfaces with KHR_materials_diffuse_transmission: only glass attenuates."
                )
        return fields

    def _unused(self, table: Table, *names: str) -> None:
        for name in names:
            if name in table:
                self.document.notes.add(f"{name}: the factor holds for the whole surface.")

    def _share(self, table: Table, name: str, default: float) -> float:
        value = table.number(name, default)
        return value if 0 <= value <= 1 else float(self._clipped(np.array(value)))

    def _shares(self, table: Table, name: str, default: tuple[float, ...]) -> Float64:
        return self._clipped(table.numbers(name, default))

    def _clipped(self, values: Float64) -> Float64:
        # Most factors are in range. This comparison is several times faster than those of numpy for a few numbers.
        if all(0 <= value <= 1 for value in values.ravel().tolist()):
            return values
        self.document.notes.add("Factors of materials below 0 or above 1: they are clipped.")
        return np.clip(values, 0.0, 1.0)

    def _slot(self, owner: Table, name: str, *, srgb: bool) -> TextureSlot | None:
        found = self._look_up(owner, name) if name in owner else None
        return None if found is None else TextureSlot(self._texture(found, srgb), found.uv_set, found.matrix)

    def _look_up(self, owner: Table, name: str) -> _LookUp | None:
        """Return the image and the lookup of a texture; None if its coordinates or a readable image are missing."""
        info = owner.table(name)
        textures = self.document.all("textures")
        texture = textures[info.required_index("index", textures, "textures")]
        transform = info.extension("KHR_texture_transform")
        uv_set = info.integer("texCoord", 0)
        if transform is not None:
            uv_set = transform.integer("texCoord", uv_set)
        if uv_set not in (0, 1):
            self.document.notes.add("Textures whose texCoord is above 1.")
            return None
        samplers = self.document.all("samplers")
        index = texture.index("sampler", samplers, "samplers")
        sampler = Table({}, texture.location) if index is None else samplers[index]
        source = self._source(texture)
        if source is None or not self._has_picture(source):
            return None
        return _LookUp(
            source,
            (self._sampled(sampler, "wrapS", _WRAPS, "repeat"), self._sampled(sampler, "wrapT", _WRAPS, "repeat")),
            self._sampled(sampler, "magFilter", _FILTERS, "linear"),
            1 if uv_set else 0,
            np.eye(2, 3) if transform is None else _uv_transform(transform),
        )

    def _has_picture(self, source: int) -> bool:
        """Return True if an image exists and has a known format; the image is then decoded."""
        image = self.document.all("images")[source]
        uri = image.text("uri")
        if uri is not None and self.document.lacks_picture(uri, image.location.field("uri")):
            return False
        if source not in self._unreadable:
            try:
                read_image(self.document, source)
            except UnknownFormatError as error:
                self.document.notes.add(f"Textures of {image.location.path}, which {error.found}.")
                self._unreadable.add(source)
        return source not in self._unreadable

    def _sampled(self, sampler: Table, name: str, allowed: Mapping[Any, Choice], default: Choice) -> Choice:
        """Return a value of a sampler; the default, with a note, for a number that glTF does not define."""
        value = sampler.values.get(name)
        if type(value) is int and value not in allowed:
            self.document.notes.add(f"{name} {value} of samplers, which glTF does not define: {default} is taken.")
            return default
        return sampler.choice(name, allowed, default)

    def _texture(self, found: _LookUp, srgb: bool) -> int:
        """Return the index in `textures` of a texture in a given colour space."""
        key = (found.source, found.wrap, found.filter, srgb)
        if key not in self._texture_numbers:
            table = self.document.all("images")[found.source]
            image = read_image(self.document, found.source)
            if image.dtype == np.uint16:
                self.document.take(4 * image.size, table.location)
                levels = np.arange(65536) / 65535
                image = (decode_srgb(levels) if srgb else levels).astype(np.float32)[image]
            name = table.name(f"image-{found.source}")
            self.textures.append(Texture(name, image, (1.0, 1.0), found.filter, srgb, found.wrap))
            self._texture_numbers[key] = len(self.textures) - 1
        return self._texture_numbers[key]

    def _source(self, table: Table) -> int | None:
        """Return the image index of a texture: a compressed image if it can be read, otherwise the plain one.

        Returns None, with a note, if the texture has neither.
        """
        images = self.document.all("images")
        plain = table.index("source", images, "images")
        webp = table.extension("EXT_texture_webp")
        if webp is not None:
            return webp.required_index("source", images, "images")
        basisu = table.extension(compression.BASISU)
        if basisu is not None and (plain is None or compression.available("opengl_basisu")):
            return basisu.required_index("source", images, "images")
        if plain is None:
            self.document.notes.add("Textures without an image of PNG, JPEG, WebP or KTX 2.")
        return plain


def has_black_backs(table: Table) -> bool:
    """Return True if the extras of a file or a material say that `glpath export` wrote it for black backs."""
    extras = table.values.get("extras")  # extras may have any type
    return isinstance(extras, dict) and extras.items() >= BLACK_BACKS.items()


def _is_diffuse(metallic: float, layers: Mapping[str, Any]) -> bool:
    """Return True if a surface has only a Lambertian base.

    It then has no metal, no glass and no layer above, and KHR_materials_specular removes the dielectric reflection
    at all angles. Its roughness has no effect, so it is a material without microfacets. Textures only multiply
    these factors.
    """
    specular = layers.get("specular_weight", 1.0)
    layered = bool(layers) and any(np.any(layers.get(layer.strength, 0.0)) for layer in LAYERS.values())
    return not (metallic or specular or layered or layers.get("transmission"))


def _nearest(image: NDArray[Any], rows: range, height: int, width: int) -> NDArray[Any]:
    """Return rows of an image that is scaled to another size by nearest texels."""
    of_rows = np.asarray(rows) * image.shape[0] // height
    return np.asarray(image[of_rows][:, np.arange(width) * image.shape[1] // width])


def _linear(image: NDArray[Any]) -> Float64:
    """Return an sRGB image as linear numbers in [0, 1]."""
    stored = image / np.float64(np.iinfo(image.dtype).max)
    stored[..., :3] = decode_srgb(stored[..., :3])
    return stored


def _uv_transform(table: Table) -> Float64:
    """Return the (2, 3) affine map of texture coordinates for KHR_texture_transform, with v upwards.

    The extension's text rotates coordinates counter-clockwise on an image with v downwards, and so do viewers. Its
    GLSL rotates them clockwise [KhronosGroup/glTF issue 1563].
    """
    angle = table.number("rotation", 0.0)
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    matrix[:2, :2] = np.array([[c, s], [-s, c]]) * table.numbers("scale", (1, 1))
    matrix[:2, 2] = table.numbers("offset", (0, 0))
    over = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])  # replaces v by 1 - v; its own inverse
    return np.asarray((over @ matrix @ over)[:2])


def metal_and_roughness(
    diffuse: Float64, specular: Float64, glossiness: Float64
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the images of the metallic-roughness model for the older specular-glossiness model.

    A texel is taken as a mixture of a metal, which has the specular colour, and a dielectric that reflects 4 %. The
    metal fraction is chosen so that the mixture has the diffuse and the specular brightness of the texel.
    Dielectrics that reflect more than 4 % become part metal, and coloured reflections of dielectrics are lost.

    Source: Khronos Group, KHR_materials_pbrSpecularGlossiness, its converter between the two models (2016).

    The base colour is (h, w, 3 or 4), sRGB. The surface is (h, w, 3), with roughness in green and metal in blue.

    diffuse    : (h, w, 3) or, with alpha, (h, w, 4), linear, in [0, 1]
    specular   : (h, w, 3) reflectance at normal incidence, linear, in [0, 1]
    glossiness : (h, w) in [0, 1]
    """
    left = 1.0 - specular.max(axis=2, keepdims=True)
    under = diffuse[..., :3] * left / (1.0 - F0)
    metal = _metal(_brightness(diffuse[..., :3])[..., None] * left / (1.0 - F0), _brightness(specular)[..., None])
    of_diffuse = under / np.maximum(1.0 - metal, _TINY)
    of_specular = (specular - F0 * (1.0 - metal)) / np.maximum(metal, _TINY)
    colour = np.clip(of_diffuse + (of_specular - of_diffuse) * metal**2, 0.0, 1.0)
    base = np.concatenate([encode_srgb(colour), diffuse[..., 3:]], axis=2)
    surface = np.concatenate([np.ones_like(metal), 1.0 - glossiness[..., None], metal], axis=2)
    return _bytes(base), _bytes(surface)


def _metal(diffuse: Float64, specular: Float64) -> Float64:
    """Return the metal fraction m that solves two equations for m and a base colour c.

    The equations are (1 - m) c = diffuse and m c + (1 - m) F0 = specular.
    """
    b = diffuse + specular - 2.0 * F0
    root = np.sqrt(np.maximum(b**2 - 4.0 * F0 * (F0 - specular), 0.0))
    return np.where(specular < F0, 0.0, np.clip((root - b) / (2.0 * F0), 0.0, 1.0))


def _brightness(colour: Float64) -> Float64:
    """Return the perceived brightness of colours [http://alienryderflex.com/hsp.html]."""
    return np.asarray(np.sqrt(colour**2 @ [0.299, 0.587, 0.114]))


def _bytes(values: Float64) -> NDArray[np.uint8]:
    return np.asarray(np.round(255.0 * np.clip(values, 0.0, 1.0)), np.uint8)
