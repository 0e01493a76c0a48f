"""Scene format: the contents of a TOML scene file as typed data [msgspec].

A file holds a camera, a film, named textures and materials, a list of shapes and a list of lights. Each kind of
table has its own module: `camera`, `materials`, `shapes`, `lights`. `scene_file` has the whole file and its JSON
schema. Shapes with an `emission` are area lights; `lights` are punctual. Lengths are in scene units, angles in
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

The range of a plain number is declared as a constraint. The range of a `float | tuple` (a number or a list of
three) is added to the schema by hand and checked in `build.py`. The reason: for a union of a constrained number and
a fixed-length tuple, msgspec 0.22 reads past its own table and may crash.
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
