"""Tables [[shapes]] and [[assets]] of a scene file: objects, their transforms and their motion."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, Meta, Struct, UnsetType

from glpath.io.description.lights import MaintenanceFactor
from glpath.io.description.vector import Vector
from glpath.io.meshes import NAMES
from glpath.io.up_axis import Axis
from glpath.system.units import Unit

Row = tuple[float, float, float, float]

MAX_SUBDIVISIONS = 8

Radiance = Annotated[
    float | Vector,
    Meta(
        description="Emitted radiance in W sr^-1 m^-2, or cd m^-2 where photometric, 0 or more: one number or "
        "[r, g, b], linear Rec. 709."
    ),
]


class Emission(Struct, forbid_unknown_fields=True, kw_only=True):
    """Diffuse emission that makes a shape a light, uniform over the shape; set `radiance` or `flux`."""

    radiance: Radiance | UnsetType = UNSET
    flux: (
        Annotated[
            float | Vector,
            Meta(
                description="All that the shape sends, in W, or lm where photometric, instead of the radiance: "
                "one number or [r, g, b]; of a material of one opacity, without an emission_texture."
            ),
        ]
        | UnsetType
    ) = UNSET
    two_sided: Annotated[bool, Meta(description="true: both sides emit; otherwise the front only.")] = False
    unit: (
        Annotated[
            Unit,
            Meta(
                description="Of this light alone: radiometric (W, W sr^-1 m^-2) or photometric (lm, cd m^-2); "
                "that of the file without it."
            ),
        ]
        | UnsetType
    ) = UNSET
    maintenance_factor: MaintenanceFactor = UNSET


class Rotation(Struct, forbid_unknown_fields=True, kw_only=True):
    """Rotation about an axis through the origin, counter-clockwise if the axis points at the viewer."""

    axis: Annotated[Vector, Meta(description="Axis of rotation, [x, y, z], of any length but zero.")]
    angle: Annotated[float, Meta(description="Angle in degrees.")]


class Step(Struct, forbid_unknown_fields=True, kw_only=True):
    """Step of a transform: exactly one of translate, rotate, scale and matrix."""

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


_Steps = list[Annotated[Step, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]]


class Key(Struct, forbid_unknown_fields=True, kw_only=True):
    """Keyframe of a moving object."""

    time: Annotated[float, Meta(description="Seconds, later than the key before.")]
    transform: Annotated[
        _Steps, Meta(description="Steps that take it from where its own transform puts it, the first one first.")
    ] = []


_Motion = Annotated[
    list[Key],
    Meta(
        description="Keys where it moves, { time, transform }, for the camera's shutter. Between them it turns the "
        "shorter arc and moves on a line; it is held before the first and after the last."
    ),
]


class Shape(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """Fields that all shapes have."""

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
        _Steps,
        Meta(description="Steps that take the shape to the world, the first one first."),
    ] = []
    motion: _Motion = []
    flip_normals: Annotated[
        bool, Meta(description="true turns the fronts to the other side, e.g. of a box seen from within.")
    ] = False


class Quad(Shape, tag="quad", kw_only=True):
    """Planar convex quadrilateral."""

    corners: Annotated[
        tuple[Vector, Vector, Vector, Vector],
        Meta(description="Four corners [x, y, z], counter-clockwise seen from the front."),
    ]


class Box(Shape, tag="box", kw_only=True):
    """Axis-aligned box with its fronts outward, given by `min` and `max` or by `center` and `size`."""

    min: Annotated[Vector, Meta(description="Corner of the box with the smallest coordinates.")] | UnsetType = UNSET
    max: Annotated[Vector, Meta(description="Corner of the box with the largest coordinates.")] | UnsetType = UNSET
    center: Annotated[Vector, Meta(description="Centre of the box.")] | UnsetType = UNSET
    size: Annotated[Vector, Meta(description="Edge lengths of the box, each above 0.")] | UnsetType = UNSET


class Sphere(Shape, tag="sphere", kw_only=True):
    """Sphere, or an ellipsoid after a non-uniform scale; its front is outward, its poles lie on its z axis."""

    center: Annotated[Vector, Meta(description="Centre of the sphere.")] = (0.0, 0.0, 0.0)
    radius: Annotated[float, Meta(gt=0, description="Radius in scene units, above 0.")]
    subdivisions: Annotated[
        int,
        Meta(
            ge=0,
            le=MAX_SUBDIVISIONS,
            description="For path tracing, which needs triangles: how often each of an icosahedron's is split in "
            "four; 20 * 4^n triangles.",
        ),
    ] = 4


class Plane(Shape, tag="plane", kw_only=True):
    """Infinite plane, for the integrators classic and t-buffer."""

    point: Annotated[Vector, Meta(description="A point of the plane, where the texture coordinates are 0.")] = (
        0.0,
        0.0,
        0.0,
    )
    normal: Annotated[Vector, Meta(description="Direction out of the front, of any length but zero.")]
    u: (
        Annotated[
            Vector,
            Meta(
                description="Direction in which the texture coordinate u grows, as far as it lies in the plane; u "
                "and v grow by 1 over its length. Without it the x axis, or y where x is about the normal. The "
                "texture keeps its right angles under every transform."
            ),
        ]
        | UnsetType
    ) = UNSET


class Mesh(Shape, tag="mesh", kw_only=True):
    """Triangle mesh, given by `vertices` and `faces` or by a `file`."""

    vertices: Annotated[list[Vector], Meta(description="Vertices [x, y, z].")] | UnsetType = UNSET
    faces: (
        Annotated[
            list[Annotated[list[int], Meta(min_length=3)]],
            Meta(
                description="Faces of three or more vertices, counter-clockwise seen from the front. "
                "Indices count from 0. Concave faces are allowed."
            ),
        ]
        | UnsetType
    ) = UNSET
    file: (
        Annotated[str, Meta(description=f"{NAMES} file; a relative path starts at the folder of the scene file.")]
        | UnsetType
    ) = UNSET
    uv: (
        Annotated[
            list[tuple[float, float]],
            Meta(
                description="Texture coordinates [u, v], one pair for each of `vertices`. Without them, and where "
                "a file has none, each triangle is seen along the axis nearest to its normal, and the longest side "
                "of the mesh's box is 1."
            ),
        ]
        | UnsetType
    ) = UNSET


class Displacement(Struct, forbid_unknown_fields=True, kw_only=True):
    """Displacement of a surface along its normal by the red channel of a texture."""

    texture: Annotated[str, Meta(description="Name of a texture of this file; of colours, their linear values.")]
    scale: Annotated[float, Meta(description="Scene units from black to white.")] = 1.0
    offset: Annotated[float, Meta(description="Scene units that black is moved by.")] = 0.0


class Patches(Shape, tag="patches", kw_only=True):
    """Surface of bicubic patches: Bézier `points` and `patches`, or the `net` of a uniform B-spline.

    It is divided into triangles without cracks when it is loaded. All renders of it use these triangles.
    """

    points: Annotated[list[Vector], Meta(description="Control points [x, y, z] of Bézier patches.")] | UnsetType = (
        UNSET
    )
    patches: (
        Annotated[
            list[Annotated[list[int], Meta(min_length=16, max_length=16)]],
            Meta(
                description="Of each patch the numbers of 16 `points`, four rows of four, counted from 0; the "
                "front is where the rows follow each other to the right and the columns upwards."
            ),
        ]
        | UnsetType
    ) = UNSET
    net: (
        Annotated[
            list[Annotated[list[Vector], Meta(min_length=4)]],
            Meta(min_length=4, description="Control points of a B-spline, rows of equal length, 4 x 4 at least."),
        ]
        | UnsetType
    ) = UNSET
    closed: Annotated[
        tuple[bool, bool],
        Meta(description="Of a net: is the last row followed by the first, and the last column?"),
    ] = (False, False)
    level: (
        Annotated[
            int,
            Meta(ge=1, le=256, description="Segments along the edges of a patch; 8 without it and `pixels`."),
        ]
        | UnsetType
    ) = UNSET
    pixels: (
        Annotated[
            float,
            Meta(
                gt=0,
                description="Instead of a level: how long segments may be in the picture of this file's camera. "
                "Powers of two, up to 256 a patch.",
            ),
        ]
        | UnsetType
    ) = UNSET
    displacement: (
        Annotated[Displacement, Meta(description="A height map: { texture = NAME, scale = 0.1 }.")] | UnsetType
    ) = UNSET
    streamed: Annotated[
        bool,
        Meta(
            description="true: triangles are made whenever they are needed, not kept, as those of the type stream, "
            "and shaded flat."
        ),
    ] = False


class Stream(Shape, tag="stream", kw_only=True):
    """Triangles that are read in chunks each time they are needed, so that they may exceed the memory.

    Only the integrator path-buffer can render them, by scan conversion. They cannot emit. Their material has no
    textures and no transparency.
    """

    file: (
        Annotated[
            str,
            Meta(
                description="A .npy file of an array (T, 3, 3), float32 or float64: the corners of T triangles, "
                "best with neighbours near each other; a relative path starts at the folder of the scene file. In "
                "Python `stream` may be an object with chunk(i) and len() instead."
            ),
        ]
        | UnsetType
    ) = UNSET


class Asset(Struct, forbid_unknown_fields=True, kw_only=True):
    """Model file placed in the scene, with its shapes, materials and lights."""

    file: Annotated[
        str,
        Meta(
            description=f"glTF (.glb, .gltf), {NAMES} file; a relative path starts at the folder of the scene file."
        ),
    ]
    name: (
        Annotated[str, Meta(description="Begins the names of its shapes; that of the file without it.")] | UnsetType
    ) = UNSET
    transform: Annotated[
        _Steps,
        Meta(description="Steps that take the model to the world, the first one first; glTF's y axis is up."),
    ] = []
    up: (
        Annotated[
            Axis,
            Meta(
                description="The axis of the model that is up, y without it. The model is turned to have y up "
                "before all steps. Of an OBJ, PLY, STL or OFF: glTF has y up by its specification."
            ),
        ]
        | UnsetType
    ) = UNSET
    materials: Annotated[
        dict[str, str],
        Meta(
            description="Names of the model's materials, each with the name of a material of this file that "
            "stands in for it; light that it sends goes with it."
        ),
    ] = {}
    lights: Annotated[
        bool, Meta(description="false leaves the model's punctual lights out. Their intensity knows no scale.")
    ] = True
    unit: (
        Annotated[
            Unit,
            Meta(
                description="Of the model's lights and emission; glTF is photometric (cd, lx, cd m^-2) without it, "
                "an OBJ has the unit of the scene file."
            ),
        ]
        | UnsetType
    ) = UNSET
    motion: _Motion = []
    time: (
        Annotated[
            float,
            Meta(
                ge=0,
                description="Seconds into the first animation of a glTF file at time 0 of the camera's shutter; at "
                "rest without it.",
            ),
        ]
        | UnsetType
    ) = UNSET


AnyShape = Quad | Box | Sphere | Plane | Mesh | Patches | Stream
