"""The scene format: what a TOML file may say, as typed data [msgspec].

A file holds a camera, a film, named textures and materials, a list of shapes and a list of lights, each kind of
table in a room of its own: `camera`, `materials`, `shapes`, `lights`; `scene_file` is the whole, and its JSON
schema. Shapes with an `emission` are lights with an extent; `lights` are punctual. Lengths are scene units, angles
degrees, colours linear Rec. 709. The descriptions are also the remedy lines of error messages and the texts of the
JSON schema (`glpath schema`), so they are written for users.

    [camera]
    type = "perspective"
    position = [0, 0, 3.9]
    target = [0, 0, 0]
    fov = 39.3077

    [materials.red]
    type = "diffuse"
    reflectance = [0.57, 0.04, 0.04]

    [[shapes]]
    type = "sphere"
    center = [0, 1, 0]
    radius = 0.5
    material = "red"
    transform = [{ scale = [1, 2, 1] }, { rotate = { axis = [0, 0, 1], angle = 30 } }]

    [[lights]]
    type = "point"
    position = [0, 3, 2]
    intensity = 20

Ranges of a number alone are declared as constraints. Ranges within `float | tuple` (a number or a list of three)
are put into the schema by hand and checked in `build.py`: msgspec 0.22 reads past its own table when a constrained
number meets a tuple of fixed length in one union, and may crash.
"""

from __future__ import annotations

from glpath.io.description.camera import CameraKey, Orthographic, Panorama, View
from glpath.io.description.lights import (
    MAX_ENVIRONMENT_PIXELS,
    AnyLight,
    DirectionalLight,
    PointLight,
    Sky,
    SpotLight,
)
from glpath.io.description.materials import (
    MAX_TEXTURE_PIXELS,
    MAX_TEXTURE_SIDE,
    AnyMaterial,
    AnyTexture,
    Diffuse,
    Glazing,
    Image,
    Phong,
    Principled,
)
from glpath.io.description.scene_file import SceneFile, scene_schema
from glpath.io.description.shapes import (
    AnyShape,
    Asset,
    Box,
    Emission,
    Key,
    Mesh,
    Patches,
    Plane,
    Quad,
    Sphere,
    Step,
    Stream,
)

__all__ = [
    "MAX_ENVIRONMENT_PIXELS",
    "MAX_TEXTURE_PIXELS",
    "MAX_TEXTURE_SIDE",
    "AnyLight",
    "AnyMaterial",
    "AnyShape",
    "AnyTexture",
    "Asset",
    "Box",
    "CameraKey",
    "Diffuse",
    "DirectionalLight",
    "Emission",
    "Glazing",
    "Image",
    "Key",
    "Mesh",
    "Orthographic",
    "Panorama",
    "Patches",
    "Phong",
    "Plane",
    "PointLight",
    "Principled",
    "Quad",
    "SceneFile",
    "Sky",
    "Sphere",
    "SpotLight",
    "Step",
    "Stream",
    "View",
    "scene_schema",
]
