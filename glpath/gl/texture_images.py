"""Textures of a scene as tables for the device: slots of materials, and their images.

A texture lies on the device once, however many slots use it, and not at all if none does. Byte images lie in a byte
store and take a quarter of the space of float images. Both are decoded and filtered texel by texel in
`scene/texture.glsl`. Mipmaps are not needed: a pixel averages over the positions of its path sets, and paths
average over their directions.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.gl.texel_store import WIDTH
from glpath.gl.variants import defined
from glpath.scene.geometry import Mesh
from glpath.scene.material import SLOTS, Material, Texture, TextureSlot, Wrap
from glpath.scene.model import Scene

#: Bits of `slot_texel(n, SLOT_IMAGE).w`, and for each wrap mode the first of its two bits.
IMAGE_FLAGS = {"FILTERED": 1, "BYTES": 2, "SRGB": 4, "UV1": 8, "WRAP_U": 4, "WRAP_V": 6}
#: Component of the section "slots" that holds each texture slot of a material. Components 5 to 7 hold other values.
SLOT_COMPONENTS = {name: i if i < 5 else i + 3 for i, name in enumerate(SLOTS)}
SLOT_TEXELS = -(-(len(SLOTS) + 3) // 4)
#: Wrap modes in the order of their numbers in GLSL.
WRAPS: tuple[Wrap, ...] = ("repeat", "clamp", "mirror")
ALPHAS = ("opaque", "mask", "blend")
#: Maximum bytes of all textures on the device.
MAX_TEXTURE_BYTES = 2 << 30


class TextureImages:
    """Textures of a scene for shaders.

    of_materials : (materials, texels, 4) int64, section "slots"
    slots        : (slots, 1, 4) int64, section "slot"
    maps : (slots, 2, 4) float64 transforms of texture coordinates, section "slot_map"
    floats       : (texels, 1, 4) float32, section "image"
    defines      : defines for `load_program`

    Raises SceneError for more than MAX_TEXTURE_BYTES, and for `uv1` of exact spheres and planes.
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self._gl = gl
        _check_sets(scene)
        used = {shape.material for shape in scene.shapes}
        shown = [
            (number, name, slot)
            for number, material in enumerate(scene.materials)
            if number in used
            for name, slot in material.slots.items()
        ]
        numbers = list(dict.fromkeys(slot.texture for _, _, slot in shown))
        textures = {number: scene.textures[number] for number in numbers}
        _check_budget(scene, list(textures.values()))
        self._bytes = [t for t in textures.values() if t.image.dtype == np.uint8]
        self._width = self._wide_enough(scene)
        slots = {name for _, name, _ in shown}
        self.defines = defined(
            HAS_TEXTURES=bool(shown),
            HAS_SURFACE_TEXTURES="surface_texture" in slots,
            HAS_NORMAL_MAPS=bool(slots & _NORMAL_MAPS),
            HAS_NORMALS=bool(slots & _NORMAL_MAPS),
            HAS_COAT_NORMALS=any(_coat_has_normals(scene.materials[number]) for number in used),
            HAS_COAT_TEXTURES=bool(slots & {"clearcoat_texture", "clearcoat_roughness_texture"}),
            HAS_SPECULAR_TEXTURES=bool(slots & {"specular_texture", "specular_colour_texture"}),
            HAS_IRIDESCENCE_TEXTURES=bool(slots & {"iridescence_texture", "iridescence_thickness_texture"}),
            HAS_DIFFUSE_TRANSMISSION_TEXTURES=bool(slots & _DIFFUSE_TRANSMISSION),
            HAS_SHEEN_TEXTURES="sheen_texture" in slots,
            HAS_SHEEN_ROUGHNESS_TEXTURES="sheen_roughness_texture" in slots,
            HAS_ANISOTROPY_TEXTURES="anisotropy_texture" in slots,
            HAS_EMISSION_TEXTURES="emission_texture" in slots,
            HAS_TRANSMISSION_TEXTURES="transmission_texture" in slots,
            HAS_UV1=any(slot.uv_set == 1 for _, _, slot in shown),
            HAS_WRAPS=any(wrap != "repeat" for texture in textures.values() for wrap in texture.wrap),
            HAS_BYTE_IMAGES=bool(self._bytes),
            HAS_FLOAT_IMAGES=len(self._bytes) < len(textures),
            HAS_SRGB_NUMBERS=any(textures[slot.texture].srgb for _, name, slot in shown if name in _NUMBERS),
        )
        if self._bytes:
            self.defines["BYTES_SHIFT"] = self._width.bit_length() - 1
        first: dict[int, int] = {}
        rows = texels = 0
        for number, texture in textures.items():
            height, across = texture.image.shape[:2]
            if texture.image.dtype == np.uint8:
                first[number] = rows * self._width
                rows += _rows(texture, self._width)
            else:
                first[number] = texels
                texels += height * across
        self._rows = rows
        self.floats: NDArray[np.float32] = np.ones((texels, 1, 4), np.float32)
        for number, texture in textures.items():
            if texture.image.dtype != np.uint8:
                pixels = texture.image.reshape(-1, texture.image.shape[2])
                self.floats[first[number] : first[number] + len(pixels), 0, : pixels.shape[1]] = pixels

        self.of_materials = np.zeros((len(scene.materials), SLOT_TEXELS, 4), np.int64)
        for number, material in enumerate(scene.materials):
            self.of_materials[number, 1, 1:] = ALPHAS.index(material.alpha), material.unlit, material.culled
        self.slots = np.zeros((len(shown), 1, 4), np.int64)
        self.maps = np.zeros((len(shown), 2, 4))
        for i, (number, name, slot) in enumerate(shown):
            self.of_materials[number].flat[SLOT_COMPONENTS[name]] = i + 1
            texture = textures[slot.texture]
            height, width = texture.image.shape[:2]
            self.slots[i, 0] = first[slot.texture], width, height, _flags(texture, slot)
            self.maps[i, :, :3] = slot.uv_transform * np.array(texture.scale)[:, None]
            material = scene.materials[number]
            coat = name == "clearcoat_normal_texture"
            self.maps[i, 0, 3] = material.clearcoat_normal_scale if coat else material.normal_scale

    def bytes_on_device(self) -> moderngl.Texture:
        """Create the store of byte images, written one by one, because all together are large."""
        size = (self._width, self._rows) if self._bytes else (1, 1)
        store = self._gl.texture(size, 4, dtype="f1", alignment=1)
        store.filter = (moderngl.NEAREST, moderngl.NEAREST)
        row = 0
        for texture in self._bytes:
            pixels = texture.image.reshape(-1, texture.image.shape[2])
            rows = _rows(texture, self._width)
            texels = np.full((rows * self._width, 4), 255, np.uint8)
            texels[: len(pixels), : pixels.shape[1]] = pixels
            store.write(texels, viewport=(0, row, self._width, rows), alignment=1)
            row += rows
        return store

    def _wide_enough(self, scene: Scene) -> int:
        """Return the byte-store row width in texels, a power of two; each image starts a row."""
        max_size, width = int(self._gl.info["GL_MAX_TEXTURE_SIZE"]), WIDTH
        while sum(_rows(t, width) for t in self._bytes) > max_size:
            width *= 2
            if width > max_size:
                raise _too_much(scene, self._bytes, max_size * max_size * 4)
        return width


_DIFFUSE_TRANSMISSION = {"diffuse_transmission_texture", "diffuse_transmission_colour_texture"}
_NORMAL_MAPS = {"normal_texture", "clearcoat_normal_texture"}
_COLOURS = {
    "texture",
    "emission_texture",
    "specular_colour_texture",
    "diffuse_transmission_colour_texture",
    "sheen_texture",
}
# Slots of which only alpha is read; sRGB encoding does not change alpha.
_ALPHAS = {"specular_texture", "diffuse_transmission_texture", "sheen_roughness_texture"}
# Slots whose texels `scene/surface.glsl` reads as numbers: red, green or blue.
_NUMBERS = set(SLOTS) - _COLOURS - _ALPHAS


def _coat_has_normals(material: Material) -> bool:
    """Return True if the material's clearcoat and base have different normals."""
    return material.roughness is not None and material.clearcoat > 0 and bool(_NORMAL_MAPS & material.slots.keys())


def _rows(texture: Texture, width: int) -> int:
    height, across = texture.image.shape[:2]
    return int(-(-height * across // width))


def _flags(texture: Texture, slot: TextureSlot) -> int:
    flags = IMAGE_FLAGS
    bits = flags["FILTERED"] * (texture.filter == "linear") + flags["UV1"] * (slot.uv_set == 1)
    bits += flags["BYTES"] * (texture.image.dtype == np.uint8) + flags["SRGB"] * texture.srgb
    u, v = (WRAPS.index(wrap) for wrap in texture.wrap)
    return bits + (u << flags["WRAP_U"]) + (v << flags["WRAP_V"])


def texture_bytes(texture: Texture) -> int:
    """Return the bytes that a texture takes on the device."""
    height, width = texture.image.shape[:2]
    return int(height * width * (4 if texture.image.dtype == np.uint8 else 16))


def _check_sets(scene: Scene) -> None:
    for shape in scene.shapes:
        material = scene.materials[shape.material]
        if not isinstance(shape.geometry, Mesh) and any(slot.uv_set for slot in material.slots.values()):
            raise SceneError(
                f'{scene.source or scene.name}: the shape "{shape.name}" is an exact {shape.geometry}, which has '
                f'one set of texture coordinates; its material "{material.name}" looks a texture up by `uv1`.',
                "Take the first set, or a mesh.",
            )


def _check_budget(scene: Scene, textures: list[Texture]) -> None:
    if sum(map(texture_bytes, textures)) > MAX_TEXTURE_BYTES:
        raise _too_much(scene, textures, MAX_TEXTURE_BYTES)


def _too_much(scene: Scene, textures: list[Texture], allowed: int) -> SceneError:
    total, largest = sum(map(texture_bytes, textures)), max(textures, key=texture_bytes)
    height, width = largest.image.shape[:2]
    remedy = "Make the images smaller"
    if largest.image.dtype != np.uint8:
        remedy += ", or take images of 8 bits, which take a quarter"
    return SceneError(
        f"{scene.source or scene.name}: {len(textures)} textures of {total / 2**20:,.0f} MiB on the device, where "
        f'they may take {allowed / 2**20:,.0f}; the largest is "{largest.name}", {width:,} x {height:,} texels of '
        f"{texture_bytes(largest) / 2**20:,.0f} MiB.",
        remedy + ".",
    )
