"""Reader of Mitsuba's BSDFs as materials.

Fresnel:  metals and dielectrics use Fresnel's equations, as in Mitsuba. The base of plastic and "principled" is
          Mitsuba's (`Material.layering`).
Sides:    black from behind, as in Mitsuba, unless "twosided".
Rough:    GGX or Beckmann microfacets with Mitsuba's alpha. Light that microfacets scatter twice is lost, as in
          Mitsuba.
Poor at:  BSDFs without a counterpart, which are refused by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from glpath.io.export.geometry import UniqueNames, tangent_axes
from glpath.io.mitsuba.document import error_of_kind
from glpath.io.mitsuba.optical_constants import INDICES, METALS, RADIO_COLOURS
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.mitsuba.textures import Look, Textures
from glpath.scene.directional_albedo import internal_reflectance
from glpath.scene.geometry import Float64
from glpath.scene.material import SMOOTH, Material, metal_reflectance
from glpath.scene.source_location import SourceLocation, shown

#: Fields of a `Material` by name.
Fields = dict[str, Any]
#: Fields that depend on the texture coordinates of the shape.
_OF_SHAPE = ("bump", "normal_map")
_ROUGH = {"multiple_scattering": False}
_ONE = 1.0 - 1e-9


@dataclass
class BsdfReader:
    """Materials that shapes use.

    notes : differences from Mitsuba, as sentences without a full stop
    """

    textures: Textures
    materials: list[Material] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    _known: dict[tuple[object, ...], int] = field(default_factory=dict)
    _made: dict[int, Fields] = field(default_factory=dict)
    _names: UniqueNames = field(default_factory=UniqueNames)
    _normal_maps: dict[int, tuple[Look, Float64, SourceLocation]] = field(default_factory=dict)
    _mirrored: dict[int, int] = field(default_factory=dict)

    def number(
        self,
        plugin: Plugin | None,
        interior: Plugin | None,
        emission: Look | None,
        name: str,
        *,
        emits: bool = False,
        one_side: bool = False,
        uv_lengths: tuple[float, float] = (1.0, 1.0),
        handedness: float = 1.0,
    ) -> int:
        """Return the index of a shape's material.

        plugin     : surface of the shape; None is Mitsuba's one-sided diffuse default: grey, or black if the shape
                     emits
        interior   : medium inside the shape
        emission   : image of its emission
        name       : name of the shape, for a material without an id
        emits      : True if the shape emits
        one_side   : True if the back is absent, because the other side has a separate material
        uv_lengths : scene units of one u and one v, for bump maps and normal maps
        handedness : see `uv_handedness`, for normal maps
        """
        bump = None if plugin is None else self._fields(plugin).get("bump")
        normal_map = None if plugin is None else self._fields(plugin).get("normal_map")
        turn = np.eye(2)
        if normal_map is not None:  # Mitsuba's green points along n x u; here it points along v
            turn = tangent_axes(normal_map[0].matrix, uv_lengths) * [1.0, handedness] + 0.0
        surface: object = ("default", emits) if plugin is None else id(plugin.element)
        key: tuple[object, ...] = (surface, interior and id(interior.element), emission and id(emission))
        key += (one_side, uv_lengths if bump else None, turn.tobytes())
        if key not in self._known:
            default = _diffuse(np.full(3, 0.0 if emits else 0.5))
            fields = dict(self._fields(plugin)) if plugin is not None else default
            if interior is not None:
                fields["attenuation"] = self._attenuation(interior, fields)
            if emission is not None:
                fields["emission_texture"] = self.textures.slot(emission)
            if one_side:
                fields |= {"two_sided": False, "culled": True}
            if bump is not None:
                look, scale, location = bump
                fields["normal_texture"] = self.textures.slot(self.textures.bent(look, scale, location, uv_lengths))
            if normal_map is not None:
                look, location = normal_map
                fields["normal_texture"] = self.textures.slot(self.textures.turned(look, turn, location))
                self._normal_maps[len(self.materials)] = look, turn, location
            for aside in ("vertex_colours", "reflects_alike", "back", "turned", "bump", "normal_map"):
                fields.pop(aside, None)
            self.materials.append(Material(self._names.of((plugin and plugin.id) or name), **fields))
            self._known[key] = len(self.materials) - 1
        return self._known[key]

    def mirrored(self, number: int) -> int:
        """Return the index of the material for mirrored instances, with the green of normal maps inverted."""
        if number not in self._normal_maps:
            return number
        if number not in self._mirrored:
            look, turn, location = self._normal_maps[number]
            slot = self.textures.slot(self.textures.turned(look, turn * [1.0, -1.0] + 0.0, location))
            material = self.materials[number]
            self.materials.append(replace(material, name=self._names.of(material.name), normal_texture=slot))
            self._mirrored[number] = len(self.materials) - 1
        return self._mirrored[number]

    def is_bumpy(self, plugin: Plugin | None) -> bool:
        """Return True if a surface has a bump map or normal map, which depends on the shape's coordinates."""
        return plugin is not None and not self._fields(plugin).keys().isdisjoint(_OF_SHAPE)

    def has_normal_map(self, plugin: Plugin | None) -> bool:
        """Return True if a surface has a normal map."""
        return plugin is not None and "normal_map" in self._fields(plugin)

    def colour_attribute(self, plugin: Plugin | None) -> str:
        """Return the mesh attribute that supplies a surface's colours, such as vertex_color; empty for none."""
        return "" if plugin is None else str(self._fields(plugin).get("vertex_colours", ""))

    def back(self, plugin: Plugin | None) -> Plugin | None:
        """Return the surface of the back; None if back and front have the same surface."""
        return None if plugin is None else self._fields(plugin).get("back")

    def is_turned(self, plugin: Plugin | None) -> bool:
        """Return True if the denser side of glass is outside, so that the shape must be turned inside out."""
        return plugin is not None and bool(self._fields(plugin).get("turned"))

    def _fields(self, plugin: Plugin) -> Fields:
        key = id(plugin.element)
        if key not in self._made:
            make = _KINDS.get(plugin.kind)
            if make is None:
                raise error_of_kind(plugin.element, "a surface", _KINDS)
            self._made[key] = make(self, plugin)
            plugin.check_all_read()
        return self._made[key]

    # --- colours and numbers, or textures ---

    def _base(self, plugin: Plugin, name: str, default: float) -> Fields:
        """Return the reflectance of the base, with its texture or the attribute of its vertex colours."""
        texture = plugin.texture(name)
        if texture is None:
            return {"reflectance": plugin.share(name, default)}
        if texture.kind == "mesh_attribute":
            of = texture.text("name")
            if not of.startswith(("vertex_", "face_")):
                raise texture.where("name").error(
                    f"is {shown(of)}, but must start with vertex_ or face_.", "For example vertex_color."
                )
            scale = texture.number("scale", 1.0, 0.0, 1.0)
            texture.check_all_read()
            return {"reflectance": np.full(3, scale), "vertex_colours": of}
        look = self.textures.look(texture)
        if look.image.dtype != np.uint8 and look.image.max(initial=0) > 1:
            raise texture.location.error(
                f"has colours up to {float(look.image.max()):.3g}, but a surface reflects at most 1.",
                "Scale them to 1.",
            )
        return {"reflectance": np.ones(3), "texture": self.textures.slot(look), "look": look}

    def _scalar(self, plugin: Plugin, name: str, default: float) -> float | Look:
        texture = plugin.texture(name)
        return plugin.fraction(name, default) if texture is None else self.textures.numbers(texture)

    def _rough(self, plugin: Plugin, default: float) -> Fields:
        """Return roughness, the square root of alpha, with anisotropy or a texture."""
        distribution = plugin.text("distribution", "beckmann", ("beckmann", "ggx"))
        common: Fields = {**_ROUGH, "distribution": distribution}
        if "sample_visible" in plugin:
            plugin.flag("sample_visible", True)
        alpha = self._scalar(plugin, "alpha", default)
        if isinstance(alpha, Look):
            roots = self.textures.baked(alpha, ("sqrt",), np.sqrt, plugin.location)
            return common | self._surface_texture(plugin, roots, None)
        alphas = [self._scalar(plugin, key, alpha) for key in ("alpha_u", "alpha_v")]
        if any(isinstance(each, Look) for each in alphas):
            return common | self._anisotropic_texture(plugin, *alphas)
        u, v = (float(each) for each in alphas if not isinstance(each, Look))
        along, across = max(u, v), min(u, v)
        if along - across < 1e-6:
            return {"roughness": float(np.sqrt(u)), **common}
        return {**_stretched(along, across), "anisotropy_angle": 0.0 if u > v else 90.0, **common}

    def _anisotropic_texture(self, plugin: Plugin, u: float | Look, v: float | Look) -> Fields:
        """Return roughness and anisotropy as textures, from alpha along u and along v."""
        looks = [each for each in (u, v) if isinstance(each, Look)]
        first = looks[0]
        if not all(each.looked_up_as(first) for each in looks):
            raise plugin.location.error(
                "has textures of other sizes or maps for `alpha_u` and `alpha_v`.",
                "Make both pictures as large, with one to_uv.",
            )
        shape = first.image.shape[:2]

        def made() -> tuple[Look, Look]:
            image, tangent = np.ones((*shape, 3), np.float32), np.empty((*shape, 3), np.float32)
            for rows in first.strips():
                alpha_u, alpha_v = (each.grey(rows) if isinstance(each, Look) else each for each in (u, v))
                along, across = np.maximum(alpha_u, alpha_v), np.minimum(alpha_u, alpha_v)
                image[rows, :, 1] = np.sqrt(across)
                # Red and green hold the tangent, from -1 to 1: along u, or along v.
                tangent[rows, :, 0] = 0.5 + 0.5 * (alpha_u >= alpha_v)
                tangent[rows, :, 1] = 1.0 - 0.5 * (alpha_u >= alpha_v)
                tangent[rows, :, 2] = np.sqrt((along - across) / np.maximum(1.0 - across, 1e-9))
            return first.with_image(first.name, image), first.with_image(first.name, tangent)

        key = ("anisotropic", *(id(each) if isinstance(each, Look) else each for each in (u, v)))
        image, tangent = self.textures.derived(key, 24 * shape[0] * shape[1], plugin.location, made)
        return {
            "roughness": 1.0,
            "surface_texture": self.textures.slot(image),
            "anisotropy": 1.0,
            "anisotropy_texture": self.textures.slot(tangent),
            **_ROUGH,
        }

    def _surface_texture(self, plugin: Plugin, rough: float | Look, metal: float | Look | None) -> Fields:
        """Return roughness and metallic as one texture, in green and blue as in glTF."""
        looks = [each if isinstance(each, Look) else None for each in (rough, metal)]
        first = next(filter(None, looks))
        shape = first.image.shape[:2]
        fields: Fields = {"roughness": 1.0, **_ROUGH}
        for name, value in (("roughness", rough), ("metallic", metal)):
            if value is not None:
                fields[name] = 1.0 if isinstance(value, Look) else value

        def made() -> tuple[Look]:
            image = np.ones((*shape, 3), np.float32)
            for channel, look in enumerate(looks, start=1):
                if look is not None:
                    for rows in look.strips():
                        image[rows, :, channel] = look.grey(rows)
            return (first.with_image(first.name, image),)

        key = ("surface", *(look and id(look) for look in looks))
        (packed,) = self.textures.derived(key, 12 * shape[0] * shape[1], plugin.location, made)
        return fields | {"surface_texture": self.textures.slot(packed)}

    def _ratio(self, plugin: Plugin, inside: str) -> float:
        """Return the refractive index inside divided by that outside. Raises SceneError for an unknown medium."""
        indices = []
        for name, default in (("int_ior", inside), ("ext_ior", "air")):
            if plugin.kind_of(name) == "string":
                medium = plugin.text(name)
                if medium not in INDICES:
                    raise plugin.where(name).error(
                        f"is {shown(medium)}, which is not known. Allowed: {', '.join(INDICES)}.", "Or a number."
                    )
                indices.append(INDICES[medium])
            else:
                indices.append(plugin.number(name, INDICES[default], 1e-3, 10.0))
        return indices[0] / indices[1]

    # --- surfaces ---

    def _diffuse(self, plugin: Plugin) -> Fields:
        return {**_diffuse(np.zeros(3)), **_without_look(self._base(plugin, "reflectance", 0.5))}

    def _two_sided(self, plugin: Plugin) -> Fields:
        parts = plugin.nested("bsdf")
        if len(parts) not in (1, 2):
            raise plugin.location.error(f"has {len(parts)} surfaces in it, but must have one or two.")
        for part in parts:
            if self._fields(part).get("transmission", 0.0) > 0:
                raise part.location.error(
                    'lets light through, but stands in "twosided", which is of opaque surfaces.',
                    "Take it out of it.",
                )
            self._check_one_surface(part, plugin)
        fields = {**self._fields(parts[0]), "two_sided": True}
        return fields if parts[0].element is parts[-1].element else {**fields, "back": parts[1]}

    def _conductor(self, plugin: Plugin) -> Fields:
        rough = self._rough(plugin, 0.1) if plugin.kind == "roughconductor" else {"roughness": 0.0}
        metal = plugin.text("material", "none")
        texture = plugin.texture("specular_reflectance")
        alike = metal == "none" and "eta" not in plugin and "k" not in plugin  # reflectance equal at all angles
        if alike and texture is None and plugin.kind == "conductor":  # a mirror that reflects equally at all angles
            return {**_diffuse(np.zeros(3)), "mirror": plugin.share("specular_reflectance", 1.0)}
        if metal == "none":
            index = np.stack([plugin.colour("eta", 0.0), plugin.colour("k", 1.0)])
        elif metal in METALS or metal.removesuffix("_palik") in METALS:
            index = np.array(METALS.get(metal) or METALS[metal.removesuffix("_palik")])
        else:
            raise plugin.where("material").error(
                f"is {shown(metal)}, which is not known. Allowed: {', '.join(METALS)}, none.", "Or give eta and k."
            )
        reflected = metal_reflectance(*index)
        fields: Fields = {"two_sided": False, "metallic": 1.0, "metal_index": index, **rough}
        if texture is None:
            colour = reflected * plugin.share("specular_reflectance", 1.0)
            if alike and "anisotropy" not in rough:
                fields["reflects_alike"] = colour
            return {**fields, "reflectance": colour}
        return {**fields, "reflectance": reflected, "texture": self.textures.slot(self.textures.look(texture))}

    def _plastic(self, plugin: Plugin) -> Fields:
        fields: Fields = {"roughness": 0.0, **_ROUGH, "distribution": "ggx"}
        if plugin.kind == "roughplastic":
            if plugin.texture("alpha") is not None:
                raise plugin.location.error("has a texture for `alpha`, but must have a number, as in Mitsuba.")
            fields = self._rough(plugin, 0.1)
        ratio = self._ratio(plugin, "polypropylene")
        if ratio < 1:
            raise plugin.where("int_ior").error(
                f"is {ratio:g} times the index outside, but a plastic's must be at least that.",
                "Exchange int_ior and ext_ior.",
            )
        reflected = plugin.share("specular_reflectance", 1.0)
        weight = float(reflected.max())
        fields |= {"two_sided": False, "ior": ratio, "specular_weight": weight, "layering": "plastic"}
        fields["specular_colour"] = reflected / weight if weight > 0 else np.ones(3)
        base = self._base(plugin, "diffuse_reflectance", 0.5)
        inside = internal_reflectance(ratio, fields["roughness"] ** 2, fields["distribution"])

        def scattered(colour: Float64) -> Float64:
            return np.asarray(colour * (1.0 - inside) / (1.0 - colour * inside))

        if not plugin.flag("nonlinear", False):
            pass
        elif "vertex_colours" in base:
            self.notes["the colours of vertices of a nonlinear plastic are taken as those of a linear one"] = None
        elif "look" in base:
            base["texture"] = self.textures.slot(
                self.textures.baked(base["look"], ("scattered", inside), scattered, plugin.location)
            )
        else:
            base["reflectance"] = scattered(base["reflectance"])
        return {**fields, **_without_look(base)}

    def _dielectric(self, plugin: Plugin) -> Fields:
        rough: Fields = {"roughness": 0.0}
        if plugin.kind == "roughdielectric":
            rough = self._rough(plugin, 0.1)
            if rough["roughness"] ** 2 < SMOOTH:
                rough = {"roughness": 0.0}
        if plugin.texture("specular_reflectance") is not None:
            raise plugin.location.error("has a texture for `specular_reflectance`, which is not read of glass.")
        reflected = plugin.share("specular_reflectance", 1.0)
        weight = float(reflected.max())
        if np.any(reflected != 1):
            rough["specular_weight"], rough["layering"] = weight, "plastic"
            rough["specular_colour"] = reflected / weight if weight > 0 else np.ones(3)
        base = _without_look(self._base(plugin, "specular_transmittance", 1.0))
        ratio = self._ratio(plugin, "bk7")
        is_thin = plugin.kind == "thindielectric"
        fields = {"two_sided": False, "transmission": 1.0, "thin": False, **rough, **base}
        if ratio < 1:
            # The sides are exchanged, so that the index is above 1. `turned` then turns the shape inside out.
            ratio = 1.0 / ratio
            fields["turned"] = not is_thin
            if is_thin:
                self.notes["a thin dielectric of a lower index than outside is one of the inverse index"] = None
        fields["ior"] = ratio
        if is_thin:
            fields |= {"thin": True, "two_sided": True, "layering": "plastic"}
        return fields

    def _principled(self, plugin: Plugin) -> Fields:
        for name in ("main_specular", "clearcoat", "diffuse_reflectance"):
            plugin.number(f"{name}_sampling_rate", 1.0)  # only affects sampling, not the picture
        for name in ("spec_tint", "sheen", "flatness"):
            plugin.refuse_unless(name, 0.0, "glpath's material has no such lobe")
        self._unused(plugin, "sheen_tint")  # has no effect, because sheen must be 0
        fields: Fields = {"two_sided": False, **_ROUGH, **_without_look(self._base(plugin, "base_color", 0.5))}
        fields["layering"] = "disney"
        rough, metal = self._scalar(plugin, "roughness", 0.5), self._scalar(plugin, "metallic", 0.0)
        if isinstance(rough, Look) or isinstance(metal, Look):
            if isinstance(rough, Look) and isinstance(metal, Look) and not rough.looked_up_as(metal):
                raise plugin.location.error(
                    "has textures of other sizes or maps for `roughness` and `metallic`.",
                    "Make both pictures as large, with one to_uv.",
                )
            fields |= self._surface_texture(plugin, rough, metal)
        else:
            fields |= {"roughness": rough, "metallic": metal}
        fields["anisotropy"] = anisotropic = plugin.fraction("anisotropic", 0.0)
        if isinstance(rough, float) and metal == 1.0:  # pure metal is as in glTF
            fields["layering"], aspect = "gltf", np.sqrt(1.0 - 0.9 * anisotropic)
            if anisotropic > 0:
                fields |= _stretched(max(SMOOTH, rough**2 / aspect), max(SMOOTH, rough**2 * aspect))
        if "eta" in plugin:
            fields["ior"] = plugin.number("eta", 1.5, 1.0, 10.0)
        else:
            specular = plugin.number("specular", 0.5, 0.0, 1.0)
            root = np.sqrt(0.08 * specular)
            fields["ior"] = float((1.0 + root) / (1.0 - root))
            if specular == 0:
                fields["specular_weight"] = 0.0
        through = plugin.fraction("spec_trans", 0.0)
        if through > 0:
            fields |= {"transmission": through, "thin": False}
        coat, gloss = plugin.fraction("clearcoat", 0.0), plugin.fraction("clearcoat_gloss", 0.0)
        if coat > 0:
            self.notes["the clearcoat of a principled surface is another lobe, and takes light from the base"] = (
                None
            )
            fields["clearcoat"] = 0.25 * coat
            fields["clearcoat_roughness"] = float(np.sqrt(0.1 - 0.099 * gloss))
        return fields

    def _unused(self, plugin: Plugin, name: str) -> None:
        """Read a number or texture that has no effect."""
        if plugin.texture(name) is None:
            plugin.number(name, 0.0)

    def _radio_material(self, plugin: Plugin) -> Fields:
        """Return Sionna's radio material as the diffuse surface that Sionna shows."""
        kind = plugin.text("type", "", tuple(RADIO_COLOURS))
        for name in ("thickness", "scattering_coefficient", "xpd_coefficient"):
            plugin.number(name, 0.0)
        colour = plugin.share("color", 0.0) if "color" in plugin else np.array(RADIO_COLOURS[kind])
        self.notes["radio materials are diffuse surfaces of the colours in which Sionna shows them"] = None
        return {**_diffuse(colour), "two_sided": True}

    def _normal_map(self, plugin: Plugin) -> Fields:
        texture = plugin.texture("normalmap")
        if texture is None:
            raise plugin.location.error("lacks the texture `normalmap`, which must be there.")
        look = self.textures.look(texture)
        if look.srgb:
            raise texture.location.error("is a normal map, but not raw.", '<boolean name="raw" value="true"/>')
        if float(np.ptp(look.image[..., :2])) > 0.01 * (255 if look.image.dtype == np.uint8 else 1):
            self.notes["where a normal map turns away from the camera it is not black, as in Mitsuba"] = None
        return {**self._without_bumps(plugin), "normal_map": (look, texture.location)}

    def _bump_map(self, plugin: Plugin) -> Fields:
        """Return a surface with a texture of heights.

        The texture is converted to a normal map later, when the size of the shape is known.
        """
        textures = plugin.nested("texture")
        if len(textures) != 1:
            raise plugin.location.error(f"has {len(textures)} textures in it, but must have one, of heights.")
        self.notes["a bump map is a normal map, made for the mean size of the texture on its shape"] = None
        bump = self.textures.look(textures[0]), plugin.number("scale", 1.0), plugin.location
        return {**self._without_bumps(plugin), "bump": bump}

    def _without_bumps(self, plugin: Plugin) -> Fields:
        """Return the surface inside a bump map or normal map. Raises SceneError if it has a map of its own."""
        for name in ("flip_invalid_normals", "use_shadowing_function"):
            if not plugin.flag(name, True):
                self.notes[f"`{name}` of bump maps and normal maps is not read"] = None
        fields = self._fields(self._one_inside(plugin))
        if not fields.keys().isdisjoint(_OF_SHAPE):
            raise plugin.location.error(
                "is around another bump map or normal map, but a surface here has one.", "Remove one of them."
            )
        return fields

    def _mask(self, plugin: Plugin) -> Fields:
        texture = plugin.texture("opacity")
        opacity = plugin.fraction("opacity", 0.5) if texture is None else 1.0
        inner = self._one_inside(plugin)
        fields = {**self._fields(inner), "alpha": "blend"}
        fields["opacity"] = opacity * fields.get("opacity", 1.0)
        if texture is None:
            return fields
        look = self.textures.numbers(texture)
        shape, slot = look.image.shape[:2], fields.get("texture")
        under = None if slot is None else self.textures.textures[slot.texture]
        if slot is not None and under is not None:
            same = under.image.shape[:2] == shape and np.array_equal(slot.uv_transform, look.matrix)
            if not same or (under.filter, under.wrap[0]) != (look.filter, look.wrap):
                raise texture.location.error(
                    "is of another size or map than the texture of the surface that it masks.",
                    "Make both pictures as large, with one to_uv and one wrap_mode.",
                )

        def made() -> tuple[Look]:
            image = np.ones((*shape, 4), np.float32)
            for rows in look.strips():
                if under is not None:
                    colours = replace(under, image=under.image[rows]).linear()
                    image[rows, :, : colours.shape[2]] = colours
                image[rows, :, 3] *= look.grey(rows)
            return (look.with_image(look.name, image),)

        key = ("mask", id(look), slot and slot.texture)
        (masked,) = self.textures.derived(key, 16 * shape[0] * shape[1], texture.location, made)
        return {**fields, "texture": self.textures.slot(masked)}

    def _blend(self, plugin: Plugin) -> Fields:
        """Return a blend of a diffuse surface and a mirror, or of an opaque surface and glass, as one material.

        Raises SceneError for other blends.
        """
        weight = self._scalar(plugin, "weight", 0.5)
        parts = plugin.nested("bsdf")
        if len(parts) != 2:
            raise plugin.location.error(f"has {len(parts)} surfaces in it, but must have two.")
        if isinstance(weight, Look):
            weight = self.textures.grey(weight, plugin.location)
        for part in parts:
            self._check_one_surface(part, plugin)
        first, second = (self._fields(part) for part in parts)
        if first.get("transmission") == 1.0 and not second.get("transmission"):
            first, second = second, first
            if isinstance(weight, Look):
                weight = self.textures.baked(weight, ("rest",), lambda share: 1.0 - share, plugin.location)
            else:
                weight = 1.0 - weight
        if any(np.any(each.get("mirror", 0.0)) or _is_clear_glass(each) for each in (first, second)):
            self.notes["Mitsuba 3.9 loses light where a blend has a mirror or clear glass; here it is kept"] = None
        # The front of the glass would face inwards.
        is_inside_out = second.get("turned") and not first.get("two_sided")
        is_glass = second.get("transmission") == 1.0 and not first.get("transmission") and not is_inside_out
        is_glass = is_glass and _same_base(first, second)
        for part in parts:
            held = self._fields(part)
            for name, adapter in (("alpha", "mask"), ("normal_map", "normalmap"), ("bump", "bumpmap")):
                if name not in held:
                    continue
                if name == "alpha" or held is second or not is_glass:
                    raise part.location.error(
                        f"has a {adapter}, but stands in a blend, whose parts here have none.",
                        f"Put the blend into a {adapter}.",
                    )
                self.notes[f"a {adapter} of a surface blended with glass is one of both"] = None
        if is_glass:
            if first.get("roughness") is None:
                own = ("reflectance", "two_sided", "texture", "vertex_colours", *_OF_SHAPE)
                ours: Fields = {key: first[key] for key in own if key in first}
                fields = {**second, **ours, "layering": "beside"}
            else:
                self.notes["a surface blended with glass is one surface of its own roughness"] = None
                fields = {**first, **{key: second[key] for key in ("ior", "thin", "turned") if key in second}}
            if isinstance(weight, Look):
                return {**fields, "transmission": 1.0, "transmission_texture": self.textures.slot(weight)}
            return {**fields, "transmission": weight}
        plain = [_without_microfacets(each) for each in (first, second)]
        if not isinstance(weight, Look) and all(plain) and _addable(*plain):
            if "reflects_alike" in first or "reflects_alike" in second:
                self.notes["microfacets in a blend are Phong's highlight of about the same width and albedo"] = None
            one, other = plain
            made: Fields = {**one, **other, "two_sided": bool(one["two_sided"] or other["two_sided"])}
            for key in ("reflectance", "mirror", "specular"):
                parts_of = ((1.0 - weight) * one.get(key, np.zeros(3)), weight * other.get(key, np.zeros(3)))
                made[key] = parts_of[0] + parts_of[1]
            return made
        raise plugin.location.error(
            f"blends {shown(parts[0].kind)} with {shown(parts[1].kind)}, which is no one material here.",
            "Allowed: diffuse surfaces and mirrors; an opaque surface, then glass of the same colour.",
        )

    def _check_one_surface(self, part: Plugin, outer: Plugin) -> None:
        """Raise SceneError if a surface inside another has different sides."""
        if "back" in self._fields(part):
            raise part.location.error(
                f"has two surfaces, but stands in {shown(outer.kind)}, which here has one.",
                "Give both of its sides the same surface.",
            )

    def _one_inside(self, plugin: Plugin) -> Plugin:
        parts = plugin.nested("bsdf")
        if len(parts) != 1:
            raise plugin.location.error(
                f"has {len(parts)} surfaces in it, but must have one.",
                "Two sides that differ stand in a twosided." if len(parts) == 2 else "",
            )
        self._check_one_surface(parts[0], plugin)
        return parts[0]

    def _attenuation(self, medium: Plugin, fields: Fields) -> Float64:
        """Return the (3,) absorption per scene unit of a homogeneous medium. Raises SceneError.

        The medium may only absorb.
        """
        if medium.kind != "homogeneous" or not fields.get("transmission") or fields.get("thin"):
            raise medium.location.error(
                f"is a medium of the type {shown(medium.kind)}, but only an absorbing one inside glass is read.",
                'Allowed: "homogeneous" with an albedo of 0, in a shape whose surface is a dielectric.',
            )
        why = "light is not scattered in a medium here"
        if "albedo" not in medium:
            raise medium.location.error(
                f"lacks `albedo`, which is 0.75 in Mitsuba, but only 0 is read: {why}.",
                '<float name="albedo" value="0"/>',
            )
        medium.refuse_unless("albedo", 0.0, why)
        # The phase function has no effect, because nothing is scattered. The flags only affect sampling.
        medium.nested("phase")
        for name in ("sample_emitters", "has_spectral_extinction"):
            medium.flag(name, True)
        sigma = medium.colour("sigma_t", 1.0) * medium.number("scale", 1.0, 0.0)
        medium.check_all_read()
        return sigma


def _diffuse(reflectance: Float64) -> Fields:
    return {"reflectance": reflectance, "two_sided": False, "roughness": None}


def _without_microfacets(fields: Fields) -> Fields:
    """Return the fields of a diffuse surface, a mirror or both; empty for any other surface.

    Microfacets with equal reflectance at all angles become a Phong highlight, the inverse of `glpath export`.
    """
    if fields.get("roughness") is None and not fields.get("transmission"):
        return fields
    colour = fields.get("reflects_alike")
    if colour is None:
        return {}
    alpha = max(fields["roughness"] ** 2, SMOOTH)
    exponent = max(2.0 / alpha**2 - 2.0, 1e-3)
    return {**_diffuse(np.zeros(3)), "specular": 0.5 * (exponent + 1.0) * colour, "exponent": exponent}


def _addable(one: Fields, other: Fields) -> bool:
    """Return True if two surfaces can be added to one.

    At most one may have a Phong highlight. Their diffuse bases must have no texture, or one base must be black.
    """
    textured = [bool(each.get("texture") or each.get("vertex_colours")) for each in (one, other)]
    black = [not each["reflectance"].any() for each in (one, other)]
    has_exponent = "exponent" in one and "exponent" in other
    return not has_exponent and (not any(textured) or any(black))


def _without_look(fields: Fields) -> Fields:
    return {key: value for key, value in fields.items() if key != "look"}


def _is_clear_glass(fields: Fields) -> bool:
    return fields.get("transmission", 0.0) > 0 and not fields.get("roughness")


def _same_base(first: Fields, second: Fields) -> bool:
    return (
        np.array_equal(first["reflectance"], second["reflectance"])
        and first.get("texture") is second.get("texture")
        and first.get("vertex_colours") == second.get("vertex_colours")
    )


def _stretched(along: float, across: float) -> Fields:
    """Return the roughness and anisotropy for the alphas along and across the tangent."""
    anisotropy = float(np.sqrt(max(along - across, 0.0) / (1.0 - across))) if across < _ONE else 0.0
    return {"roughness": float(np.sqrt(across)), "anisotropy": anisotropy}


_KINDS: dict[str, Callable[[BsdfReader, Plugin], Fields]] = {
    "diffuse": BsdfReader._diffuse,
    "twosided": BsdfReader._two_sided,
    "conductor": BsdfReader._conductor,
    "roughconductor": BsdfReader._conductor,
    "plastic": BsdfReader._plastic,
    "roughplastic": BsdfReader._plastic,
    "dielectric": BsdfReader._dielectric,
    "thindielectric": BsdfReader._dielectric,
    "roughdielectric": BsdfReader._dielectric,
    "principled": BsdfReader._principled,
    "itu-radio-material": BsdfReader._radio_material,
    "normalmap": BsdfReader._normal_map,
    "bumpmap": BsdfReader._bump_map,
    "mask": BsdfReader._mask,
    "blendbsdf": BsdfReader._blend,
}
