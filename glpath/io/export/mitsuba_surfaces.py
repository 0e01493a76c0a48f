"""Export of materials as named BSDFs of Mitsuba, each once, for `glpath.io.export.mitsuba`.

Sides:    Mitsuba's surfaces are black from behind, like `Material.two_sided = False`, unless "twosided".
Poor at:  a dielectric over a diffuse base, which differs between all programs; the notes list the differences.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from glpath.io.export.geometry import Notes, UniqueNames, map_downwards, tangent_axes
from glpath.scene.geometry import Float64
from glpath.scene.material import SLOTS, SMOOTH, Material, Texture, TextureSlot, metal_reflectance
from glpath.scene.model import Scene
from glpath.scene.slab import clearest, slab

#: Plugin with its parameters, see `glpath.io.export.mitsuba`.
Plugin = dict[str, Any]

# Value of `specular` for which Mitsuba's principled surface equals glTF's: an index of 1.5.
_SPECULAR = 0.5
# Texture slots that surfaces in Mitsuba do not have.
_UNSAID = set(SLOTS) - {
    "texture",
    "surface_texture",
    "normal_texture",
    "emission_texture",
    "transmission_texture",
}


class Names:
    """Unique names that Mitsuba accepts, without dots."""

    def __init__(self) -> None:
        self._names = UniqueNames("type", "integrator", "sensor")

    def of(self, text: str) -> str:
        return self._names.of(re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-") or "unnamed")


def rgb(values: Float64) -> Plugin:
    """Return a colour plugin, linear Rec. 709."""
    return {"type": "rgb", "value": [float(v) for v in values]}


def _diffuse(reflectance: Plugin) -> Plugin:
    return {"type": "diffuse", "reflectance": reflectance}


@dataclass
class BsdfWriter:
    """Materials that shapes use, each once. plugins: their plugins by name."""

    scene: Scene
    notes: Notes
    names: Names
    plugins: Plugin = field(default_factory=dict)
    integrator: str = "path"
    _known: dict[tuple[int, bool, bool, float], str] = field(default_factory=dict)

    def reference(self, number: int, coloured: bool, side: bool | None = None, handedness: float = 1.0) -> Plugin:
        """Return a reference to a material for a shape.

        coloured   : True if the shape's vertices have colours
        side       : None: sides as in the material; True: one side that reflects; False: one black side
        handedness : see `uv_handedness`; only a material with a normal map depends on it
        """
        material = self.scene.materials[number]
        if side is False:
            material = Material(f"{material.name}-back", np.zeros(3), two_sided=False)
            coloured = False
        two_sided = side is None and material.two_sided and material.transmission == 0
        handedness = handedness if material.normal_texture is not None else 1.0
        key = (-1 if side is False else number, coloured, two_sided, handedness)
        if key not in self._known:
            name = self._known[key] = self.names.of(material.name)
            self.plugins[name] = _Surface(self, material, coloured, handedness).plugin(two_sided)
        return {"type": "ref", "id": self._known[key]}

    def medium(self, number: int) -> Plugin | None:
        """Return the absorbing medium inside a solid; None if there is none. Only volpath renders a medium."""
        material = self.scene.materials[number]
        if material.thin or not np.any(material.attenuation > 0) or material.transmission == 0:
            return None
        self.integrator = "volpath"
        # The attenuation is divided by its largest channel, because a colour is at most 1. Channels are at least
        # 1e-6, because volpath returns NaN for a channel without absorption.
        densest = float(material.attenuation.max())
        sigma_t = rgb(np.maximum(material.attenuation / densest, 1e-6))
        return {"type": "homogeneous", "albedo": 0.0, "sigma_t": sigma_t, "scale": densest}


@dataclass
class _Surface:
    owner: BsdfWriter
    material: Material
    coloured: bool
    handedness: float

    def plugin(self, two_sided: bool) -> Plugin:
        material = self.material
        made = self._opaque(two_sided) if material.transmission == 0 else self._with_glass()
        opacity = self._opacity()
        return made if opacity is None else {"type": "mask", "opacity": opacity, "bsdf": made}

    def _note(self, text: str) -> None:
        self.owner.notes.add(text, "material", self.material.name)

    def _opaque(self, two_sided: bool) -> Plugin:
        front = self._front()
        return {"type": "twosided", "bsdf": front} if two_sided else front

    def _front(self) -> Plugin:
        material = self.material
        if material.unlit:
            return _diffuse(rgb(np.zeros(3)))
        if np.any(material.sheen > 0):
            self._note("its sheen is left out: the sheen of Mitsuba's principled surface is another lobe")
        if material.diffuse_transmission > 0:
            self._note("the light that its diffuse base lets through is left out")
        if material.iridescence > 0:
            self._note("the thin film over it is left out")
        if material.culled:
            self._note("its back blocks light in Mitsuba")
        if material.multiple_scattering and material.scatters_repeatedly:
            self._note("Mitsuba loses what its microfacets scatter more than once, which is kept here")
        if material.slots.keys() & _UNSAID:
            self._note("textures of its layers, anisotropy and dielectric are left out")
        if material.roughness is None:
            made = self._without_microfacets()
        elif material.metallic == 0 and material.specular_weight == 0 and material.clearcoat == 0:
            made = _diffuse(self._colour())  # no specular reflection above the base
        elif material.layering == "plastic" and material.metallic == 0:
            made = self._plastic(material.roughness)
        elif material.metal_index is not None and material.metallic == 1:
            made = self._metal(material.roughness, *material.metal_index)
        else:
            made = self._microfacets(material.roughness)
        slot = material.normal_texture
        if slot is None:
            return made
        image = 2.0 * self._texture(slot).linear()[..., :3] - 1.0
        image = image * [material.normal_scale, material.normal_scale, 1.0]
        # Mitsuba's red points along u of the mesh, and its green along n x u.
        axes = tangent_axes(slot.uv_transform * np.array(self._texture(slot).scale)[:, None])
        image[..., :2] = image[..., :2] @ axes * [1.0, self.handedness]
        image /= np.maximum(np.linalg.norm(image, axis=2, keepdims=True), 1e-9)
        return {"type": "normalmap", "normalmap": self._bitmap(slot, 0.5 * image + 0.5, raw=True), "bsdf": made}

    def _without_microfacets(self) -> Plugin:
        material = self.material
        # Mitsuba blends lobes by weight and glpath adds them, so each lobe is divided by its weight.
        lobes: list[tuple[float, Callable[[float], Plugin]]] = []
        lobes.append((float(material.reflectance.max()), lambda scale: _diffuse(self._colour(scale))))
        if np.any(material.mirror > 0):
            lobes.append((float(material.mirror.max()), lambda scale: _mirror(material.mirror * scale)))
        if np.any(material.specular > 0):
            self._note("Phong's highlight is a lobe of microfacets (GGX) of about the same width and albedo")
            albedo = 2.0 * material.specular / (material.exponent + 1.0)
            alpha = float(np.sqrt(2.0 / (material.exponent + 2.0)))
            lobes.append((float(albedo.max()), lambda scale: _mirror(albedo * scale, alpha)))
        total = sum(weight for weight, _ in lobes)
        if total > 1 + 1e-9:
            self._note(f"it reflects up to {total:.3g} of the light, which Mitsuba limits to 1")
        limited = min(total, 1.0)
        return _blend([(weight, lobe(limited / weight)) for weight, lobe in lobes if weight > 0])

    def _microfacets(self, roughness: float) -> Plugin:
        """Return Mitsuba's principled surface for GGX over a base.

        Like glpath's surface, it has Schlick's Fresnel term and independent masking of both directions, and its
        metal is the same. A dielectric over a diffuse base differs between all programs.
        """
        material = self.material
        made: Plugin = {"type": "principled", "base_color": self._colour(), "specular": _SPECULAR}
        made["metallic"], made["roughness"] = material.metallic, roughness
        is_mitsubas = material.layering == "disney"
        if is_mitsubas:
            del made["specular"]
            made |= {"eta": material.ior, "spec_trans": material.transmission}
        slot = material.surface_texture
        if slot is not None:
            image = self._texture(slot).linear()
            made["roughness"] = self._bitmap(slot, roughness * image[..., 1:2], raw=True)
            made["metallic"] = self._bitmap(slot, material.metallic * image[..., 2:3], raw=True)
        if (material.metallic < 1 or slot is not None) and not is_mitsubas:
            self._note(
                "its base under microfacets is that of Mitsuba's principled surface, which loses nothing to what "
                "they reflect and is lighter at grazing angles than Lambert's: rooms are up to a fifth lighter"
            )
            reflected, _ = material.dielectric
            if reflected.mean() > 0.08:
                self._note(
                    f"of light from ahead it reflects 0.08, not {reflected.mean():.3g}, without becoming a metal"
                )
            made["specular"] = float(np.clip(reflected.mean() / 0.08, 0.0, 1.0))
        if material.anisotropy > 0 and is_mitsubas:
            made["anisotropic"] = material.anisotropy
        elif material.anisotropy > 0:
            self._note("brushed metal is about as rough along the tangent and across, at most ten to one")
            across = max(roughness**2, SMOOTH)
            along = across + (1.0 - across) * material.anisotropy**2
            made["anisotropic"] = float(min((1.0 - across / along) / 0.9, 1.0))
            made["roughness"] = float((along * across) ** 0.25)
            if material.anisotropy_angle % 180:
                self._note("the tangent goes along u, whatever its angle")
        if material.clearcoat > 0:
            self._note(
                "the clearcoat is that of Mitsuba's principled surface, a quarter as strong and of another lobe"
            )
            made["clearcoat"] = material.clearcoat
            made["clearcoat_gloss"] = float(np.clip((0.1 - material.clearcoat_roughness**2) / 0.099, 0.0, 1.0))
        return made

    def _plastic(self, roughness: float) -> Plugin:
        material = self.material
        made: Plugin = {"type": "plastic", "int_ior": material.ior, "ext_ior": 1.0}
        made["diffuse_reflectance"] = self._colour()
        made["specular_reflectance"] = rgb(material.specular_weight * material.specular_colour)
        return made if roughness**2 < SMOOTH else {**made, "type": "roughplastic", **self._alpha(roughness)}

    def _metal(self, roughness: float, n: Float64, k: Float64) -> Plugin:
        """Return a metal of complex index n + ik. Its colour is divided by its reflectance at normal incidence."""
        material = self.material
        over = 1.0 / np.maximum(metal_reflectance(n, k), 1e-9)
        made: Plugin = {"type": "conductor", "eta": rgb(n), "k": rgb(k), "specular_reflectance": self._colour(over)}
        return made if material.is_smooth else {**made, "type": "roughconductor", **self._alpha(roughness)}

    def _alpha(self, roughness: float) -> Plugin:
        """Return the distribution and the alpha parameters of microfacets."""
        material = self.material
        made: Plugin = {"distribution": material.distribution}
        across = roughness**2
        if material.surface_texture is not None:
            image = self._texture(material.surface_texture).linear()[..., 1:2]
            return made | {"alpha": self._bitmap(material.surface_texture, across * image**2, raw=True)}
        if material.anisotropy == 0:
            return made | {"alpha": across}
        across = max(across, SMOOTH)
        along = across + (1.0 - across) * material.anisotropy**2
        if material.anisotropy_angle % 90:
            self._note("the tangent goes along u, whatever its angle")
        turned = material.anisotropy_angle % 180 == 90
        return made | {"alpha_u": across if turned else along, "alpha_v": along if turned else across}

    def _with_glass(self) -> Plugin:
        material = self.material
        if material.layering == "disney" and not material.thin:
            return self._opaque(False)
        glass = self._glass()
        share = (1.0 - material.metallic) * material.transmission
        slot = material.transmission_texture
        if slot is None and share == 1:
            return glass
        weight: float | Plugin = share
        if slot is not None:
            weight = self._bitmap(slot, share * self._texture(slot).linear()[..., :1], raw=True)
        if material.layering == "beside":
            rest = _diffuse(self._colour())
            opaque = {"type": "twosided", "bsdf": rest} if material.two_sided else rest
            return {"type": "blendbsdf", "weight": weight, "a": opaque, "b": glass}
        self._note("glass and the rest of the surface are blended, reflections included")
        return {"type": "blendbsdf", "weight": weight, "a": self._opaque(material.two_sided), "b": glass}

    def _glass(self) -> Plugin:
        material = self.material
        alpha = (material.roughness or 0.0) ** 2
        made: Plugin = {"int_ior": material.ior, "ext_ior": 1.0, "specular_transmittance": self._colour()}
        if material.is_slab:
            # Mitsuba has the same formula, but its glass absorbs equally at all angles.
            if np.any(material.reflectance < 1):
                # The reflectance is the transmittance of one crossing; Mitsuba's factor is that of the whole sheet.
                reflected, through = slab(1.0, material.ior, material.reflectance)
                once, clear = np.maximum(material.reflectance, np.finfo(float).tiny), clearest(material.ior)
                made["specular_transmittance"] = self._colour(through / clear / once)
                made["specular_reflectance"] = rgb(reflected / max(1.0 - clear, np.finfo(float).tiny))
                self._note("its glass absorbs alike at all angles")
            return {"type": "thindielectric", **made}
        if material.layering in ("plastic", "beside"):
            made["specular_reflectance"] = rgb(material.specular_weight * material.specular_colour)
        if material.layering in ("plastic", "beside") and material.is_thin_dielectric:
            return {"type": "thindielectric", **made}
        if material.thin:
            # Mitsuba's thin dielectric reflects between its two sides, 2 F / (1 + F) in total; glpath's reflects F
            # once.
            reflected, grazing = material.dielectric
            root = np.sqrt(reflected.mean() / (2.0 - reflected.mean()))
            made["int_ior"] = float((1.0 + root) / (1.0 - root))
            if grazing > 0 or alpha >= SMOOTH:
                self._note(
                    "its thin dielectric reflects as ours at normal incidence, with an index for that, "
                    "and not as rough"
                )
            return {"type": "thindielectric", **made}
        if alpha < SMOOTH:
            return {"type": "dielectric", **made}
        return {"type": "roughdielectric", **self._alpha(material.roughness or 0.0), **made}

    def _opacity(self) -> float | Plugin | None:
        """Return the opacity; None for an opaque material."""
        material, slot = self.material, self.material.texture
        if material.alpha == "opaque":
            return None
        if self.coloured:
            self._note("the alpha of vertices is left out")
        alpha = np.full((1, 1, 1), material.opacity)
        if slot is not None and (image := self._texture(slot).linear()).shape[2] == 4:
            alpha = material.opacity * image[..., 3:]
        if material.alpha == "mask":
            alpha = np.where(alpha >= material.cutoff, 1.0, 0.0)
        if slot is None or alpha.size == 1:
            return None if alpha.item() == 1 else float(alpha.item())
        return self._bitmap(slot, alpha, raw=True)

    def _colour(self, scale: float | Float64 = 1.0) -> Plugin:
        """Return the reflectance times the texture or the vertex colours, times `scale`."""
        factor, slot = self.material.reflectance * scale, self.material.texture
        if slot is None:
            if self.coloured:  # vertex colours already include the reflectance
                return {"type": "mesh_attribute", "name": "vertex_color", "scale": float(np.mean(scale))}
            return rgb(factor)
        if self.coloured:
            self._note("the colours of vertices, which multiply its texture, are left out")
        texture = self._texture(slot)
        if texture.srgb and texture.image.dtype == np.uint8 and np.all(factor == 1):
            return self._bitmap(slot, texture.image[..., :3], raw=False)
        return self._bitmap(slot, texture.linear()[..., :3] * factor, raw=False)

    def _texture(self, slot: TextureSlot) -> Texture:
        return self.owner.scene.textures[slot.texture]

    def _bitmap(self, slot: TextureSlot, image: Any, *, raw: bool) -> Plugin:
        return bitmap(self._texture(slot), slot, image, raw=raw, note=self._note)


def bitmap(texture: Texture, slot: TextureSlot, image: Any, *, raw: bool, note: Callable[[str], None]) -> Plugin:
    """Return a bitmap plugin for an image, with the lookup of a texture slot.

    raw : True if the image holds data other than colours
    """
    image = image if image.dtype == np.uint8 else np.asarray(image, np.float32)
    made: Plugin = {"type": "bitmap", "image": np.ascontiguousarray(image), "name": texture.name, "raw": raw}
    if texture.filter == "nearest":
        made["filter_type"] = "nearest"
    if texture.wrap[0] != texture.wrap[1]:
        note(f'the texture "{texture.name}" is wrapped along v as along u: {texture.wrap[0]}')
    if texture.wrap[0] != "repeat":
        made["wrap_mode"] = texture.wrap[0]
    matrix = map_downwards(slot.uv_transform, texture.scale)
    if not np.array_equal(matrix, np.eye(3)):
        made["to_uv"] = np.eye(4)
        made["to_uv"][:2, :2], made["to_uv"][:2, 3] = matrix[:2, :2], matrix[:2, 2]
    return made


def _mirror(reflectance: Float64, alpha: float = 0.0) -> Plugin:
    made: Plugin = {"type": "conductor", "material": "none", "specular_reflectance": rgb(reflectance)}
    return made if alpha == 0 else made | {"type": "roughconductor", "distribution": "ggx", "alpha": alpha}


def _blend(parts: Sequence[tuple[float, Plugin]]) -> Plugin:
    """Return a plugin that blends plugins by their weights; a black surface if there are none."""
    if not parts:
        return _diffuse(rgb(np.zeros(3)))
    total, made = parts[0]
    for weight, plugin in parts[1:]:
        total += weight
        made = {"type": "blendbsdf", "weight": weight / total, "a": made, "b": plugin}
    return made
