"""The whole scene file and its JSON schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from glpath.io.description.camera import AnyCamera, Film
from glpath.io.description.lights import AnyLight, Sky
from glpath.io.description.materials import AnyMaterial, AnyTexture
from glpath.io.description.shapes import AnyShape, Asset
from glpath.io.description.vector import Vector
from glpath.system.units import Unit


class SceneFile(Struct, forbid_unknown_fields=True, kw_only=True):
    """Scene of glpath."""

    name: Annotated[str, Meta(description="Name of the scene; the name of the file without it.")] | UnsetType = (
        UNSET
    )
    description: Annotated[str, Meta(description="What the scene shows, in one line.")] = ""
    unit: (
        Annotated[
            Unit,
            Meta(
                description="Of all light in the file that names none: radiometric (W, W sr^-1, W m^-2, "
                "W sr^-1 m^-2) or photometric (lm, cd, lx, cd m^-2); a watt is 179 lumens. Radiometric without it; "
                "then numbers of glTF assets beside an environment map are taken as its radiance."
            ),
        ]
        | UnsetType
    ) = UNSET
    camera: Annotated[
        AnyCamera,
        Meta(
            description="The camera: perspective (a pinhole or a lens), orthographic or panorama. Without it, the "
            "whole scene is in view."
        ),
    ]
    film: Annotated[Film, Meta(description="The picture: resolution, exposure.")] = msgspec.field(
        default_factory=Film
    )
    textures: Annotated[dict[str, AnyTexture], Meta(description="Textures by name.")] = {}
    materials: Annotated[dict[str, AnyMaterial], Meta(description="Materials by name.")] = {}
    shapes: Annotated[
        list[AnyShape], Meta(description="The shapes; those with an emission are lights with an extent.")
    ] = []
    assets: Annotated[
        list[Asset], Meta(description="Model files with materials of their own; a scene needs one, or a shape.")
    ] = []
    lights: Annotated[list[AnyLight], Meta(description="Punctual lights: point, spot, directional.")] = []
    ambient: Annotated[
        float | Vector,
        Meta(
            description="Radiance in W sr^-1 m^-2, or cd m^-2 where photometric, that reaches every surface from "
            "everywhere, 0 or more: one number or [r, g, b]."
        ),
    ] = 0.0
    sky: Annotated[Sky, Meta(description="What rays see that hit nothing; black without it.")] | UnsetType = UNSET


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the scene format, with which editors check and complete TOML."""
    schema = msgspec.json.schema(SceneFile)
    defined = schema["$defs"]
    share, positive = {"minimum": 0, "maximum": 1}, {"minimum": 0}
    for table, field, limits in (
        ("Diffuse", "reflectance", share),
        ("Phong", "reflectance", share),
        ("Phong", "specular", positive),
        ("Phong", "mirror", share),
        ("Principled", "reflectance", share),
        ("Principled", "specular_color", positive),
        ("Glazing", "transmittance", share),
        ("Principled", "attenuation", positive),
        ("Principled", "diffuse_transmission_color", share),
        ("Principled", "sheen", share),
        ("Emission", "radiance", positive),
        ("Emission", "flux", positive),
        ("PointLight", "intensity", positive),
        ("PointLight", "flux", positive),
        ("SpotLight", "intensity", positive),
        ("SpotLight", "flux", positive),
        ("DirectionalLight", "irradiance", positive),
        ("Sky", "zenith", positive),
        ("Sky", "horizon", positive),
        ("SceneFile", "ambient", positive),
    ):
        defined[table]["properties"][field]["anyOf"] = _number_or_list(3, limits)
    colors = defined["Checker"]["properties"]["colors"]
    colors["prefixItems"] = [{"anyOf": _number_or_list(3, share)}] * 2
    for table in ("Checker", "Image"):
        defined[table]["properties"]["scale"]["anyOf"] = _number_or_list(2, {"exclusiveMinimum": 0})
    angle = {"type": "number", "minimum": 0, "maximum": 180}
    defined["SpotLight"]["properties"]["cone"]["prefixItems"] = [angle] * 2
    # Fields of all materials that glazing cannot have, or with one value only.
    glazing = defined["Glazing"]["properties"]
    del glazing["reflectance"]
    glazing["two_sided"]["const"], glazing["culled"]["const"] = True, False
    # The reader of scene files adds a missing camera before msgspec decodes them.
    del defined["SceneFile"]["required"]
    for has_a_default_type in ("Camera", "Diffuse"):
        defined[has_a_default_type]["required"].remove("type")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "glpath scene"}


def _number_or_list(length: int, limits: Mapping[str, float]) -> list[dict[str, Any]]:
    number = {"type": "number", **limits}
    return [number, {"type": "array", "minItems": length, "maxItems": length, "items": number}]
