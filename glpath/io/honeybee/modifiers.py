"""Radiance's modifiers as materials, and the modifier of each object.

Source: Ward & Shakespeare 1998, Rendering with Radiance, and its reference manual for the formulas of plastic,
metal, trans and glass; the defaults are those of honeybee-standards 2.0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct

from glpath.errors import warn
from glpath.io.convert import convert
from glpath.io.honeybee.model import Aperture, Door, Face, ModelRadiance, ModifierSet
from glpath.scene.geometry import Float64
from glpath.scene.model import Material
from glpath.scene.source_location import SourceLocation
from glpath.system.vectors import LARGEST

_Share = Annotated[float, Meta(ge=0, le=1)]
_Emittance = Annotated[float, Meta(ge=0, le=LARGEST)]
# Maximum index of refraction of a material.
_MAX_IOR = 10.0


class _Reflecting(Struct):
    r_reflectance: _Share = 0.0
    g_reflectance: _Share = 0.0
    b_reflectance: _Share = 0.0

    @property
    def reflectance(self) -> Float64:
        return np.array([self.r_reflectance, self.g_reflectance, self.b_reflectance])


class _Plastic(_Reflecting):
    specularity: _Share = 0.0
    roughness: _Share = 0.0


class _Metal(_Plastic):
    specularity: _Share = 0.9


class _Trans(_Plastic):
    transmitted_diff: _Share = 0.0
    transmitted_spec: _Share = 0.0


class _Mirror(_Reflecting):
    r_reflectance: _Share = 1.0
    g_reflectance: _Share = 1.0
    b_reflectance: _Share = 1.0
    alternate_material: _Alternate | None = None


class _Alternate(Struct):
    type: str = ""


class _Glass(Struct):
    r_transmissivity: _Share = 0.0
    g_transmissivity: _Share = 0.0
    b_transmissivity: _Share = 0.0
    refraction_index: Annotated[float, Meta(ge=1, le=_MAX_IOR)] | None = None

    @property
    def transmissivity(self) -> Float64:
        return np.array([self.r_transmissivity, self.g_transmissivity, self.b_transmissivity])


class _Light(Struct):
    r_emittance: _Emittance = 0.0
    g_emittance: _Emittance = 0.0
    b_emittance: _Emittance = 0.0

    @property
    def emittance(self) -> Float64:
        return np.array([self.r_emittance, self.g_emittance, self.b_emittance])


class _Glow(_Light):
    """Light that a negative max_radius excludes from illumination."""

    max_radius: float = 0.0


_KINDS: dict[str, type[Struct]] = {
    "Plastic": _Plastic,
    "Metal": _Metal,
    "Trans": _Trans,
    "Mirror": _Mirror,
    "Glass": _Glass,
    "Light": _Light,
    "Glow": _Glow,
}


def _grey(reflectance: float) -> dict[str, Any]:
    return {"type": "Plastic"} | {f"{channel}_reflectance": reflectance for channel in "rgb"}


def _glazing(transmissivity: float) -> dict[str, Any]:
    return {"type": "Glass"} | {f"{channel}_transmissivity": transmissivity for channel in "rgb"}


# Modifiers that a honeybee file may name without defining them.
_STANDARD: dict[str, dict[str, Any]] = {
    "generic_floor_0.20": _grey(0.2),
    "generic_wall_0.50": _grey(0.5),
    "generic_ceiling_0.80": _grey(0.8),
    "generic_opaque_door_0.50": _grey(0.5),
    "generic_interior_shade_0.50": _grey(0.5),
    "generic_exterior_shade_0.35": _grey(0.35),
    "generic_context_0.20": _grey(0.2),
    "generic_interior_window_vis_0.88": _glazing(0.9584154328610596),
    "generic_exterior_window_vis_0.64": _glazing(0.6975761815384331),
    "generic_exterior_screened_window_vis_0.32": _glazing(0.34901895091031854),
    "generic_interior_window_sol_0.77": _glazing(0.8389405447251757),
    "generic_exterior_window_sol_0.37": _glazing(0.4035231572885182),
    "generic_exterior_screened_window_sol_0.19": _glazing(0.2072595906234098),
    "generic_floor_exterior_side_0.50": _grey(0.5),
    "generic_wall_exterior_side_0.35": _grey(0.35),
    "generic_ceiling_exterior_side_0.35": _grey(0.35),
    "air_boundary": {"type": "Void"},  # in Radiance a trans that transmits all light
    "black": _grey(0.0),
    "white_glow": {"type": "Glow", "r_emittance": 1.0, "g_emittance": 1.0, "b_emittance": 1.0},
}

_BOTH = ("interior_modifier", "exterior_modifier")
# Honeybee's default set, Generic_Interior_Visible_Modifier_Set.
_GENERIC: dict[str, dict[str, str]] = {
    "wall_set": dict.fromkeys(_BOTH, "generic_wall_0.50"),
    "floor_set": dict.fromkeys(_BOTH, "generic_floor_0.20"),
    "roof_ceiling_set": dict.fromkeys(_BOTH, "generic_ceiling_0.80"),
    "aperture_set": {
        "interior_modifier": "generic_interior_window_vis_0.88",
        "window_modifier": "generic_exterior_window_vis_0.64",
        "skylight_modifier": "generic_exterior_window_vis_0.64",
        "operable_modifier": "generic_exterior_window_vis_0.64",
    },
    "door_set": {
        **dict.fromkeys((*_BOTH, "overhead_modifier"), "generic_opaque_door_0.50"),
        "interior_glass_modifier": "generic_interior_window_vis_0.88",
        "exterior_glass_modifier": "generic_exterior_window_vis_0.64",
    },
    "shade_set": {
        "interior_modifier": "generic_interior_shade_0.50",
        "exterior_modifier": "generic_exterior_shade_0.35",
    },
}
_FACE_SETS = {"Wall": "wall_set", "Floor": "floor_set", "RoofCeiling": "roof_ceiling_set"}
#: Modifier of a shade that belongs to no object, such as a neighbouring building.
CONTEXT = "generic_context_0.20"


@dataclass
class Modifiers:
    """Modifiers of a file, and honeybee's defaults, as materials.

    materials : materials in the order of their first use
    emission  : (3,) radiance of each material, W sr^-1 m^-2
    """

    location: SourceLocation
    radiance: ModelRadiance
    materials: list[Material] = field(default_factory=list)
    emission: list[Float64] = field(default_factory=list)
    _numbers: dict[str, int | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given = self.radiance.modifiers or []
        self._known = _STANDARD | {str(each.get("identifier")): each for each in given}
        self._sets = {each.identifier: each for each in self.radiance.modifier_sets or []}

    def number(self, name: str, user: str) -> int | None:
        """Return the index into `materials` of a modifier; None for an invisible modifier.

        user : name of the object with the modifier, for errors

        Raises SceneError for a modifier that is not in the file or not supported.
        """
        if name not in self._numbers:
            self._numbers[name] = self._added(name, user)
        return self._numbers[name]

    def of_face(self, face: Face, room_set: str | None) -> str:
        """Return the name of a face's modifier: its own, otherwise the room set's for its type and boundary."""
        if face.modifier is not None:
            return face.modifier
        if face.face_type == "AirBoundary":
            return self._set(room_set, face.identifier).air_boundary_modifier or "air_boundary"
        outdoors = face.boundary_condition.type == "Outdoors"
        side = "exterior_modifier" if outdoors else "interior_modifier"
        return self._from_set(room_set, _FACE_SETS[face.face_type], side, face.identifier)

    def of_aperture(self, aperture: Aperture, room_set: str | None, face_type: str) -> str:
        """Return the name of an aperture's modifier. face_type: type of the face that contains it."""
        if aperture.modifier is not None:
            return aperture.modifier
        key = "window" if face_type == "Wall" else "skylight"
        key = "operable" if aperture.is_operable else key
        key = key if aperture.boundary_condition.type == "Outdoors" else "interior"
        return self._from_set(room_set, "aperture_set", f"{key}_modifier", aperture.identifier)

    def of_door(self, door: Door, room_set: str | None, face_type: str) -> str:
        """Return the name of a door's modifier. face_type: type of the face that contains it."""
        if door.modifier is not None:
            return door.modifier
        outdoors = door.boundary_condition.type == "Outdoors"
        if door.is_glass:
            key = "exterior_glass" if outdoors else "interior_glass"
        else:
            key = ("exterior" if face_type == "Wall" else "overhead") if outdoors else "interior"
        return self._from_set(room_set, "door_set", f"{key}_modifier", door.identifier)

    def of_shade(self, room_set: str | None, *, indoors: bool, user: str) -> str:
        """Return the name of the default modifier (material) for a shading surface that has none."""
        return self._from_set(room_set, "shade_set", _BOTH[not indoors], user)

    def _set(self, name: str | None, user: str) -> ModifierSet:
        default = self.radiance.global_modifier_set
        if name is None and isinstance(default, str) and default in self._sets:
            name = default
        if name is None or name == "Generic_Interior_Visible_Modifier_Set":
            return ModifierSet("")
        if name not in self._sets:
            raise self.location.error(
                f'"{user}" has the modifier set "{name}", which is not in the file.',
                "Write the file by honeybee, which puts the sets in that it uses.",
            )
        return self._sets[name]

    def _from_set(self, name: str | None, part: str, key: str, user: str) -> str:
        given = getattr(self._set(name, user), part) or {}
        return str(given.get(key) or _GENERIC[part][key])

    def _added(self, name: str, user: str) -> int | None:
        if name not in self._known:
            raise self.location.error(
                f'"{user}" has the modifier "{name}", which is neither in the file nor of honeybee\'s own.',
                "Add it to properties.radiance.modifiers.",
            )
        table = self._known[name]
        given = str(table.get("type"))
        kind = given.capitalize()  # files of older releases are in lower case
        if kind == "Void":
            return None
        if kind not in _KINDS:
            raise self.location.error(
                f'"{user}" has the modifier "{name}" of the type {given}. Allowed: {", ".join(_KINDS)}, Void.',
                "Put a Glass or a Trans of the same transmittance instead of it.",
            )
        try:
            read = convert(table, _KINDS[kind])
        except msgspec.ValidationError as error:
            raise self.location.error(f'the modifier "{name}" cannot be used: {error}.') from error
        if isinstance(read, _Trans) and _lets_all_through(read):
            return None
        if isinstance(read, _Mirror) and read.alternate_material is not None:
            # Radiance shows the alternate material, and reflects light sources only.
            if read.alternate_material.type.capitalize() == "Void":
                return None
            warn(f'{self.location}: the alternate material of the mirror "{name}" is not used.')
        light = read.emittance if isinstance(read, _Light) else np.zeros(3)
        if isinstance(read, _Glow) and read.max_radius < 0:
            warn(
                f'{self.location}: the glow "{name}" has the max_radius {read.max_radius:g}, so it lights nothing; '
                "it is black. Give it a max_radius of 0 or more to make it a light."
            )
            light = np.zeros(3)
        self.materials.append(_material(name, read))
        self.emission.append(light)
        return len(self.materials) - 1


def _lets_all_through(trans: _Trans) -> bool:
    return bool(
        trans.reflectance.min() == 1 and trans.specularity == 0
        and trans.transmitted_diff == 1 and trans.transmitted_spec == 1
    )  # fmt: skip


def _material(name: str, read: Struct) -> Material:
    if isinstance(read, _Glass):
        return _glass(name, read)
    if isinstance(read, _Mirror):
        return Material(name, read.reflectance, roughness=0.0, metallic=1.0)
    if isinstance(read, _Metal):
        return Material(
            name, read.reflectance, roughness=float(np.sqrt(read.roughness)), metallic=read.specularity,
            specular_weight=0.0,
        )  # fmt: skip
    if isinstance(read, _Trans):
        return _trans(name, read)
    if isinstance(read, _Plastic):
        if read.specularity == 0:
            return Material(name, read.reflectance)
        return Material(
            name, read.reflectance, roughness=float(np.sqrt(read.roughness)), ior=_ior_of(read.specularity)
        )
    return Material(name, np.zeros(3))  # a light reflects nothing


def _trans(name: str, read: _Trans) -> Material:
    """Return a translucent material.

    Of the light that is not reflected specularly, a fraction is transmitted. Of the transmitted light, a fraction
    is not scattered.
    """
    straight = read.transmitted_diff * read.transmitted_spec
    scattered = read.transmitted_diff - straight
    return Material(
        name,
        read.reflectance,
        roughness=float(np.sqrt(read.roughness)),
        ior=_ior_of(read.specularity),
        transmission=straight,
        diffuse_transmission=scattered / (1.0 - straight) if straight < 1 else 0.0,
        diffuse_transmission_colour=read.reflectance,
        thin=True,
    )


def _glass(name: str, read: _Glass) -> Material:
    """Return thin glass that equals Radiance's at normal incidence, with all internal reflections."""
    index = read.refraction_index or 1.52
    f = ((1.0 - index) / (1.0 + index)) ** 2
    t = read.transmissivity
    inside = 1.0 - (t * f) ** 2
    transmittance = t * (1.0 - f) ** 2 / inside
    reflected = float(np.mean(f * (1.0 + (1.0 - 2.0 * f) * t**2) / inside))
    colour = np.minimum(transmittance / (1.0 - reflected), 1.0)
    return Material(name, colour, roughness=0.0, ior=_ior_of(reflected), transmission=1.0, thin=True)


def _ior_of(reflected: float) -> float:
    """Return the index of refraction with a given reflectance at normal incidence."""
    root = float(np.sqrt(reflected))
    return min((1.0 + root) / (1.0 - root), _MAX_IOR) if root < 1 else _MAX_IOR
