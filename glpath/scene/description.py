"""The scene format: what a TOML file may say, as typed data [msgspec].

A file holds a camera, a film, named materials and a list of shapes; shapes with an `emission` are the lights.
Lengths are scene units, angles degrees, colours linear Rec. 709. The descriptions below are also the remedy
lines of error messages and the texts of the JSON schema (`glpath schema`), so they are written for users.

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

Ranges of a number alone are declared as constraints. Ranges within `float | tuple` (a number or a list of three)
are put into the schema by hand and checked in `build.py`: msgspec 0.22 reads past its own table when a constrained
number meets a tuple of fixed length in one union, and may crash.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]

MAX_RESOLUTION = 32768
MAX_SUBDIVISIONS = 8


Reflectance = Annotated[
    float | Vector,
    Meta(description="Share of light reflected, 0 to 1: one number for grey or [r, g, b], linear Rec. 709."),
]
Radiance = Annotated[
    float | Vector,
    Meta(description="Emitted radiance in W sr^-1 m^-2, 0 or more: one number or [r, g, b], linear Rec. 709."),
]


class Camera(Struct, tag_field="type", tag="perspective", forbid_unknown_fields=True, kw_only=True):
    """A pinhole camera."""

    position: Annotated[Vector, Meta(description="Where the eye is, [x, y, z] in scene units.")]
    target: Annotated[Vector, Meta(description="A point in the middle of the picture, [x, y, z] in scene units.")]
    up: Annotated[Vector, Meta(description="What is up in the picture; need not be perpendicular to the view.")] = (
        0.0,
        1.0,
        0.0,
    )
    fov: Annotated[
        float, Meta(gt=0, lt=180, description="Vertical field of view of the whole picture, degrees.")
    ] = 40.0


_Pixels = Annotated[int, Meta(ge=1, le=MAX_RESOLUTION)]


class Film(Struct, forbid_unknown_fields=True, kw_only=True):
    """The picture."""

    resolution: Annotated[tuple[_Pixels, _Pixels], Meta(description="[width, height] in pixels.")] = (512, 512)


class Material(Struct, tag_field="type", tag="diffuse", forbid_unknown_fields=True, kw_only=True):
    """Lambertian reflection."""

    reflectance: Reflectance = 0.5
    two_sided: Annotated[bool, Meta(description="false makes the back black; it still blocks light.")] = True


class Emission(Struct, forbid_unknown_fields=True, kw_only=True):
    """Makes a shape a light: diffuse emission, the same over the whole shape."""

    radiance: Radiance
    two_sided: Annotated[bool, Meta(description="true: both sides emit; otherwise the front only.")] = False


class Rotation(Struct, forbid_unknown_fields=True, kw_only=True):
    """A rotation about an axis through the origin, counter-clockwise for who looks against the axis."""

    axis: Annotated[Vector, Meta(description="Axis of rotation, [x, y, z], of any length but zero.")]
    angle: Annotated[float, Meta(description="Angle in degrees.")]


class Step(Struct, forbid_unknown_fields=True, kw_only=True):
    """One step of a transform: exactly one of translate, rotate, scale and matrix."""

    translate: Annotated[Vector, Meta(description="Shift by [x, y, z] scene units.")] | UnsetType = UNSET
    rotate: (
        Annotated[Rotation, Meta(description="Rotation: { axis = [x, y, z], angle = degrees }.")] | UnsetType
    ) = UNSET
    scale: (
        Annotated[
            float | Vector,
            Meta(description="Scale about the origin: one factor, or [x, y, z]; none of them zero."),
        ]
        | UnsetType
    ) = UNSET
    matrix: (
        Annotated[
            tuple[Row, Row, Row, Row],
            Meta(description="Four rows of four, for column vectors: translation in the last column."),
        ]
        | UnsetType
    ) = UNSET


class Shape(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """What all shapes have in common."""

    name: Annotated[str, Meta(description="Name for messages and tables.")] | UnsetType = UNSET
    material: Annotated[
        str,
        Meta(
            description="Name of a material of this file. Without it the material `default`, which is diffuse grey "
            "of reflectance 0.5 where the file does not define it."
        ),
    ] = "default"
    emission: (
        Annotated[Emission, Meta(description="Makes the shape a light: { radiance = [r, g, b] }.")] | UnsetType
    ) = UNSET
    transform: Annotated[
        list[Annotated[Step, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]],
        Meta(description="Steps that take the shape to the world, the first one first."),
    ] = []
    flip_normals: Annotated[
        bool, Meta(description="true turns the fronts to the other side, e.g. of a box seen from within.")
    ] = False


class Quad(Shape, tag="quad", kw_only=True):
    """A planar convex quadrilateral."""

    corners: Annotated[
        tuple[Vector, Vector, Vector, Vector],
        Meta(description="Four corners [x, y, z], counter-clockwise seen from the front."),
    ]


class Box(Shape, tag="box", kw_only=True):
    """A box along the axes, fronts outward: `min` and `max`, or `center` and `size`."""

    min: Annotated[Vector, Meta(description="Corner of the box with the smallest coordinates.")] | UnsetType = UNSET
    max: Annotated[Vector, Meta(description="Corner of the box with the largest coordinates.")] | UnsetType = UNSET
    center: Annotated[Vector, Meta(description="Centre of the box.")] | UnsetType = UNSET
    size: Annotated[Vector, Meta(description="Edge lengths of the box, each above 0.")] | UnsetType = UNSET


class Sphere(Shape, tag="sphere", kw_only=True):
    """A sphere, tessellated: an icosahedron whose triangles are split in four, again and again. Fronts outward."""

    center: Annotated[Vector, Meta(description="Centre of the sphere.")] = (0.0, 0.0, 0.0)
    radius: Annotated[float, Meta(gt=0, description="Radius in scene units, above 0.")]
    subdivisions: Annotated[
        int, Meta(ge=0, le=MAX_SUBDIVISIONS, description="How often each triangle is split; 20 * 4^n triangles.")
    ] = 4


class Mesh(Shape, tag="mesh", kw_only=True):
    """Triangles: `vertices` and `faces`, or a `file`."""

    vertices: Annotated[list[Vector], Meta(description="Vertices [x, y, z].")] | UnsetType = UNSET
    faces: (
        Annotated[
            list[Annotated[list[int], Meta(min_length=3, max_length=4)]],
            Meta(
                description="Faces of three or four vertices, counter-clockwise seen from the front. "
                "Indices count from 0. Four are split along the line from the first to the third."
            ),
        ]
        | UnsetType
    ) = UNSET
    file: (
        Annotated[
            str, Meta(description="OBJ, PLY or STL file; a relative path starts at the folder of the scene file.")
        ]
        | UnsetType
    ) = UNSET


AnyShape = Quad | Box | Sphere | Mesh


class SceneFile(Struct, forbid_unknown_fields=True, kw_only=True):
    """A scene of glpath."""

    name: Annotated[str, Meta(description="Name of the scene; the name of the file without it.")] | UnsetType = (
        UNSET
    )
    description: Annotated[str, Meta(description="What the scene shows, in one line.")] = ""
    camera: Annotated[Camera, Meta(description="The camera: position, target, up, fov.")]
    film: Annotated[Film, Meta(description="The picture: resolution.")] = msgspec.field(default_factory=Film)
    materials: Annotated[dict[str, Material], Meta(description="Materials by name.")] = {}
    shapes: Annotated[list[AnyShape], Meta(description="The shapes; those with an emission are the lights.")] = []


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of the scene format, for editors that check and complete TOML."""
    schema = msgspec.json.schema(SceneFile)
    defined = schema["$defs"]
    defined["Material"]["properties"]["reflectance"]["anyOf"] = _number_or_three({"minimum": 0, "maximum": 1})
    defined["Emission"]["properties"]["radiance"]["anyOf"] = _number_or_three({"minimum": 0})
    for only_one_type in ("Camera", "Material"):
        defined[only_one_type]["required"].remove("type")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "glpath scene"}


def _number_or_three(limits: dict[str, float]) -> list[dict[str, Any]]:
    number = {"type": "number", **limits}
    return [number, {"type": "array", "minItems": 3, "maxItems": 3, "items": number}]
