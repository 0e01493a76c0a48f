"""The scene format: what a TOML file may say, as typed data [msgspec].

A file holds a camera, a film, named textures and materials, a list of shapes and a list of lights. Shapes with an
`emission` are lights with an extent; `lights` are punctual. Lengths are scene units, angles
degrees, colours linear Rec. 709. The descriptions below are also the remedy lines of error messages and the texts
of the JSON schema (`glpath schema`), so they are written for users.

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

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]

MAX_RESOLUTION = 32768
MAX_SUBDIVISIONS = 8
MAX_TEXTURE_SIDE = 16384
MAX_TEXTURE_PIXELS = 2**26
MAX_ENVIRONMENT_PIXELS = 2**25

Reflectance = Annotated[
    float | Vector,
    Meta(description="Share of light reflected, 0 to 1: one number for grey or [r, g, b], linear Rec. 709."),
]
Radiance = Annotated[
    float | Vector,
    Meta(description="Emitted radiance in W sr^-1 m^-2, 0 or more: one number or [r, g, b], linear Rec. 709."),
]


class CameraKey(Struct, forbid_unknown_fields=True, kw_only=True):
    """Where a camera is at a time; what is left out is as of the camera."""

    time: Annotated[float, Meta(description="Seconds, later than the key before.")]
    position: Annotated[Vector, Meta(description="Where the eye is then, [x, y, z].")] | UnsetType = UNSET
    target: Annotated[Vector, Meta(description="What it looks at then, [x, y, z].")] | UnsetType = UNSET
    up: Annotated[Vector, Meta(description="What is up then.")] | UnsetType = UNSET


class View(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """What all cameras have in common."""

    position: Annotated[Vector, Meta(description="Where the eye is, [x, y, z] in scene units.")]
    target: Annotated[Vector, Meta(description="A point in the middle of the picture, [x, y, z] in scene units.")]
    up: Annotated[Vector, Meta(description="What is up in the picture; need not be perpendicular to the view.")] = (
        0.0,
        1.0,
        0.0,
    )
    shutter: Annotated[
        tuple[float, float],
        Meta(description="When it opens and closes, seconds: what moves is blurred. Both alike show that moment."),
    ] = (0.0, 0.0)
    motion: Annotated[
        list[CameraKey],
        Meta(
            description="Keys where the camera moves: { time, position, target, up }. Linear between them, held "
            "before the first and after the last."
        ),
    ] = []


class Camera(View, tag="perspective", kw_only=True):
    """A pinhole, or a thin lens. A camera without a type is of this one."""

    fov: Annotated[
        float, Meta(gt=0, lt=180, description="Vertical field of view of the whole picture, degrees.")
    ] = 40.0
    aperture_radius: Annotated[
        float, Meta(ge=0, description="Radius of the lens in scene units; 0 is a pinhole, where all is sharp.")
    ] = 0.0
    focus_distance: (
        Annotated[
            float,
            Meta(
                gt=0,
                description="Of the plane that is sharp, along the view, scene units; to the target without it.",
            ),
        ]
        | UnsetType
    ) = UNSET


class Orthographic(View, tag="orthographic", kw_only=True):
    """Parallel rays, which start in the plane through the position."""

    height: Annotated[float, Meta(gt=0, description="Of the whole picture, scene units.")]


class Panorama(View, tag="panorama", kw_only=True):
    """All around, equirectangular: 360 degrees wide, 180 high, the target in the middle."""


AnyCamera = Camera | Orthographic | Panorama
_Pixels = Annotated[int, Meta(ge=1, le=MAX_RESOLUTION)]


class Film(Struct, forbid_unknown_fields=True, kw_only=True):
    """The picture."""

    resolution: Annotated[tuple[_Pixels, _Pixels], Meta(description="[width, height] in pixels.")] = (512, 512)
    exposure: (
        Annotated[
            float,
            Meta(
                ge=-100,
                le=100,
                description="Stops by which an 8-bit picture is brightened: 1 doubles it. Without it the picture "
                "decides (`glpath.image.auto_exposure`).",
            ),
        ]
        | UnsetType
    ) = UNSET


class Surface(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """What all materials have in common."""

    reflectance: (
        Annotated[
            float | Vector,
            Meta(
                description="Share of light reflected diffusely, 0 to 1: one number for grey or [r, g, b], linear "
                "Rec. 709. Without it 0.5, or 1 where there is a texture, which it multiplies."
            ),
        ]
        | UnsetType
    ) = UNSET
    texture: (
        Annotated[str, Meta(description="Name of a texture of this file, [textures.NAME], for the reflectance.")]
        | UnsetType
    ) = UNSET
    two_sided: Annotated[bool, Meta(description="false makes the back black; it still blocks light.")] = True
    normal_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: a normal map, of tangent space.")]
        | UnsetType
    ) = UNSET
    normal_scale: Annotated[float, Meta(description="Strength of the normal map: its x and y are multiplied.")] = (
        1.0
    )
    emission_texture: (
        Annotated[
            str, Meta(description="Name of a texture of this file, which the emission of shapes is multiplied by.")
        ]
        | UnsetType
    ) = UNSET
    alpha: Annotated[
        Literal["opaque", "mask", "blend"],
        Meta(
            description="What opacity does: nothing; all or nothing, from `cutoff` on; a share of the light. "
            "Opacity is multiplied by the alpha of the texture."
        ),
    ] = "opaque"
    cutoff: Annotated[float, Meta(ge=0, le=1, description="Of a mask: opacity below it is a hole.")] = 0.5
    opacity: Annotated[float, Meta(ge=0, le=1, description="Share of light that the surface meets.")] = 1.0


class Diffuse(Surface, tag="diffuse", kw_only=True):
    """Lambertian reflection. A material without a type is of this one."""


class Phong(Surface, tag="phong", kw_only=True):
    """Lambertian reflection, Phong's highlight and a mirror, as of 1975."""

    specular: Annotated[
        float | Vector,
        Meta(description="Strength of Phong's highlight, 0 or more: one number or [r, g, b], linear Rec. 709."),
    ] = 0.5
    exponent: Annotated[
        float, Meta(gt=0, le=1e6, description="Phong's exponent: the larger, the smaller the highlight.")
    ] = 32.0
    mirror: Annotated[
        float | Vector,
        Meta(description="Share of light mirrored, 0 to 1: one number or [r, g, b], linear Rec. 709."),
    ] = 0.0


_Share = Annotated[float, Meta(ge=0, le=1)]


class Principled(Surface, tag="principled", kw_only=True):
    """Metal, plastic, varnish and glass: the metallic-roughness surface of glTF 2.0."""

    roughness: Annotated[
        _Share, Meta(description="0 is a mirror, 1 all dull: the alpha of GGX's microfacets is its square.")
    ] = 0.5
    metallic: Annotated[
        _Share, Meta(description="Share of metal, which has its reflectance for a colour and no diffuse base.")
    ] = 0.0
    anisotropy: Annotated[_Share, Meta(description="How much rougher it is along the brush than across.")] = 0.0
    anisotropy_angle: Annotated[
        float, Meta(description="Angle of the brush in degrees, from where u grows towards where v grows.")
    ] = 0.0
    ior: Annotated[
        float, Meta(ge=1, le=10, description="Index of refraction: 1.33 water, 1.5 glass and plastic, 2.4 diamond.")
    ] = 1.5
    specular: Annotated[
        _Share, Meta(description="Strength of what is not metal's reflection, 1 as its ior says.")
    ] = 1.0
    specular_color: Annotated[
        float | Vector,
        Meta(description="Its colour at normal incidence, 0 or more: one number or [r, g, b], linear Rec. 709."),
    ] = 1.0
    transmission: Annotated[
        _Share, Meta(description="Share that is glass instead of a diffuse base: 1 is clear glass.")
    ] = 0.0
    thin: Annotated[
        bool,
        Meta(
            description="true: glass is a pane, which does not refract. false: the surface of a solid that does, "
            "which should be closed, with its fronts outward."
        ),
    ] = False
    attenuation: Annotated[
        float | Vector,
        Meta(
            description="Of a solid of glass, per scene unit, 0 or more: exp(-attenuation) is left after one unit."
        ),
    ] = 0.0
    clearcoat: Annotated[_Share, Meta(description="Share that is under a varnish.")] = 0.0
    clearcoat_roughness: Annotated[_Share, Meta(description="The varnish's own roughness.")] = 0.0
    surface_texture: (
        Annotated[
            str,
            Meta(
                description="Name of a texture of this file: roughness is multiplied by its green, metallic by its "
                "blue."
            ),
        ]
        | UnsetType
    ) = UNSET
    transmission_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: transmission is multiplied by its red.")]
        | UnsetType
    ) = UNSET


AnyMaterial = Diffuse | Phong | Principled

Repeats = Annotated[
    float | tuple[float, float],
    Meta(description="Repeats per unit of the texture coordinates: one number above 0, or [u, v]."),
]


class Checker(Struct, tag_field="type", tag="checker", forbid_unknown_fields=True, kw_only=True):
    """Squares of two colours: one repeat is two by two of them."""

    colors: Annotated[
        tuple[float | Vector, float | Vector],
        Meta(description="Two colours, each from 0 to 1: a number for grey or [r, g, b], linear Rec. 709."),
    ] = (0.8, 0.2)
    scale: Repeats = 1.0


class Image(Struct, tag_field="type", tag="image", forbid_unknown_fields=True, kw_only=True):
    """A picture: PNG and JPEG as sRGB, EXR as linear Rec. 709; what is no colour, as of a normal map, as it is."""

    file: Annotated[
        str, Meta(description="PNG, JPEG or EXR file; a relative path starts at the folder of the scene file.")
    ]
    scale: Repeats = 1.0
    filter: Annotated[
        Literal["linear", "nearest"],
        Meta(description="linear blends neighbouring pixels where they are seen large, nearest shows squares."),
    ] = "linear"
    wrap: Annotated[
        Literal["repeat", "clamp", "mirror"],
        Meta(description="Beyond its edges: repeated, its last pixels, or mirrored."),
    ] = "repeat"


AnyTexture = Checker | Image


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


_Steps = Annotated[
    list[Annotated[Step, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]],
    Meta(description="Steps that take it from where its own transform puts it, the first one first."),
]


class Key(Struct, forbid_unknown_fields=True, kw_only=True):
    """Where something that moves is at a time."""

    time: Annotated[float, Meta(description="Seconds, later than the key before.")]
    transform: _Steps = []


_Motion = Annotated[
    list[Key],
    Meta(
        description="Keys where it moves, { time, transform }, for the camera's shutter. Between them it turns the "
        "shorter way and goes straight; it is held before the first and after the last."
    ),
]


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
    motion: _Motion = []
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
    """A sphere, or an ellipsoid by its transform; front outward, poles on its z axis."""

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
    """An infinite plane, for the integrators classic and t-buffer."""

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
    """Moves a surface along its normal, by the red of a texture."""

    texture: Annotated[str, Meta(description="Name of a texture of this file; of colours, their linear values.")]
    scale: Annotated[float, Meta(description="Scene units from black to white.")] = 1.0
    offset: Annotated[float, Meta(description="Scene units that black is moved by.")] = 0.0


class Patches(Shape, tag="patches", kw_only=True):
    """A surface of bicubic patches: Bézier `points` and `patches`, or the `net` of a uniform B-spline.

    Divided into triangles when it is loaded, without cracks, the same ones for all that is rendered.
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
    """Triangles that are read piece by piece whenever they are needed, so that they may be more than memory holds.

    Only scans can render them: the integrator path with shared directions. They cannot emit, and their material has
    no textures and no transparency.
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
    """A model file, placed in the scene with what it carries."""

    file: Annotated[
        str,
        Meta(
            description="glTF (.glb, .gltf), OBJ, PLY or STL file; a relative path starts at the folder of the "
            "scene file."
        ),
    ]
    name: (
        Annotated[str, Meta(description="Begins the names of its shapes; that of the file without it.")] | UnsetType
    ) = UNSET
    transform: Annotated[
        list[Annotated[Step, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]],
        Meta(description="Steps that take the model to the world, the first one first; glTF's y axis is up."),
    ] = []
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
    motion: _Motion = []
    time: (
        Annotated[
            float,
            Meta(
                ge=0,
                description="Seconds into the animations of a glTF file at time 0 of the camera's shutter; at rest "
                "without it.",
            ),
        ]
        | UnsetType
    ) = UNSET


AnyShape = Quad | Box | Sphere | Plane | Mesh | Patches | Stream

Intensity = Annotated[
    float | Vector,
    Meta(
        description="Radiant intensity in W sr^-1 (of a spot on its axis), 0 or more: one number or [r, g, b], "
        "linear Rec. 709; with falloff none the irradiance in W m^-2 at any distance."
    ),
]
Falloff = Annotated[
    Literal["quadratic", "none"],
    Meta(description="quadratic: by the square of the distance, as in nature; none: the same at any distance."),
]


class Light(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """What all punctual lights have in common: points and parallel light, without extent."""

    name: Annotated[str, Meta(description="Name for messages and tables.")] | UnsetType = UNSET


class PointLight(Light, tag="point", kw_only=True):
    """A point that shines in all directions alike, or as a photometric profile says."""

    position: Annotated[Vector, Meta(description="Where the light is.")]
    intensity: Intensity | UnsetType = UNSET
    falloff: Falloff = "quadratic"
    profile: (
        Annotated[
            str,
            Meta(
                description="A photometric web, an IES LM-63 file (.ies) of type C, relative to this file's "
                "folder: its candela are taken as W sr^-1, times `intensity`, which is then 1 by itself."
            ),
        ]
        | UnsetType
    ) = UNSET
    direction: (
        Annotated[
            Vector,
            Meta(
                description="Of a profile: where gamma is 0, of any length but zero; against the camera's `up` "
                "without it."
            ),
        ]
        | UnsetType
    ) = UNSET
    c0: (
        Annotated[
            Vector,
            Meta(
                description="Of a profile: towards C = 0, of any length, not along `direction`, to which it is "
                "made perpendicular; x without it, or z where the light goes along x."
            ),
        ]
        | UnsetType
    ) = UNSET


class SpotLight(Light, tag="spot", kw_only=True):
    """A point that shines into a cone."""

    position: Annotated[Vector, Meta(description="Where the light is.")]
    target: Annotated[Vector, Meta(description="A point on the axis of the cone.")]
    intensity: Intensity
    cone: Annotated[
        tuple[float, float],
        Meta(
            description="Two half angles in degrees, 0 to 180: full light within the first, none beyond the second."
        ),
    ] = (30.0, 40.0)
    falloff: Falloff = "quadratic"


class DirectionalLight(Light, tag="directional", kw_only=True):
    """Parallel light from infinitely far, like the sun's."""

    direction: Annotated[Vector, Meta(description="The way the light goes, of any length but zero.")]
    irradiance: Annotated[
        float | Vector,
        Meta(
            description="Irradiance in W m^-2 on a surface that faces the light, 0 or more: one number or "
            "[r, g, b], linear Rec. 709."
        ),
    ]


AnyLight = PointLight | SpotLight | DirectionalLight


class Sky(Struct, forbid_unknown_fields=True, kw_only=True):
    """What rays see that hit nothing: a blend from the horizon, and below, to the zenith; or an environment map."""

    zenith: (
        Annotated[
            float | Vector,
            Meta(description="Radiance overhead in W sr^-1 m^-2, 0 or more: one number or [r, g, b]."),
        ]
        | UnsetType
    ) = UNSET
    horizon: (
        Annotated[
            float | Vector,
            Meta(description="Radiance at the horizon and below, 0 or more; as at the zenith without it."),
        ]
        | UnsetType
    ) = UNSET
    up: (
        Annotated[
            Vector, Meta(description="Towards the zenith, of any length but zero; the camera's `up` without it.")
        ]
        | UnsetType
    ) = UNSET
    file: (
        Annotated[
            str,
            Meta(
                description="An environment map in place of zenith and horizon: an equirectangular picture, EXR, "
                "HDR, PNG or JPEG, its first row up; a relative path starts at the folder of the scene file."
            ),
        ]
        | UnsetType
    ) = UNSET
    scale: (
        Annotated[float, Meta(ge=0, description="Of the map: what makes its values W sr^-1 m^-2; 1 without it.")]
        | UnsetType
    ) = UNSET
    rotation: (
        Annotated[
            float,
            Meta(
                description="Of the map: degrees, counter-clockwise seen from above. At 0 its middle lies towards "
                "+z where y is up, towards +x where z is."
            ),
        ]
        | UnsetType
    ) = UNSET


class SceneFile(Struct, forbid_unknown_fields=True, kw_only=True):
    """A scene of glpath."""

    name: Annotated[str, Meta(description="Name of the scene; the name of the file without it.")] | UnsetType = (
        UNSET
    )
    description: Annotated[str, Meta(description="What the scene shows, in one line.")] = ""
    camera: Annotated[
        AnyCamera, Meta(description="The camera: perspective (a pinhole or a lens), orthographic or panorama.")
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
            description="Radiance in W sr^-1 m^-2 that reaches every surface from everywhere, 0 or more: one "
            "number or [r, g, b]."
        ),
    ] = 0.0
    sky: Annotated[Sky, Meta(description="What rays see that hit nothing; black without it.")] | UnsetType = UNSET


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of the scene format, for editors that check and complete TOML."""
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
        ("Principled", "attenuation", positive),
        ("Emission", "radiance", positive),
        ("PointLight", "intensity", positive),
        ("SpotLight", "intensity", positive),
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
    for has_a_default_type in ("Camera", "Diffuse"):
        defined[has_a_default_type]["required"].remove("type")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "glpath scene"}


def _number_or_list(length: int, limits: Mapping[str, float]) -> list[dict[str, Any]]:
    number = {"type": "number", **limits}
    return [number, {"type": "array", "minItems": length, "maxItems": length, "items": number}]
