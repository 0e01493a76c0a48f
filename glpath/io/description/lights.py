"""Tables [[lights]] and [sky] of a scene file: light sources that have no surface."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from glpath.io.description.vector import Vector
from glpath.system.units import Unit

MAX_ENVIRONMENT_PIXELS = 2**25
Intensity = Annotated[
    float | Vector,
    Meta(
        description="Intensity in W sr^-1, or cd where photometric (of a spot on its axis), 0 or more: one number "
        "or [r, g, b], linear Rec. 709; with falloff none the irradiance in W m^-2 or lx at any distance."
    ),
]
Flux = (
    Annotated[
        float | Vector,
        Meta(
            description="All that the light sends, in W, or lm where photometric, instead of the intensity: one "
            "number or [r, g, b]; of a profile it then takes the form alone."
        ),
    ]
    | UnsetType
)
OwnUnit = (
    Annotated[
        Unit,
        Meta(
            description="Of this light alone: radiometric (W, W sr^-1, W m^-2) or photometric (lm, cd, lx, "
            "cd m^-2); that of the file without it. A light with a profile is photometric."
        ),
    ]
    | UnsetType
)
MaintenanceFactor = (
    Annotated[
        float,
        Meta(
            gt=0,
            le=1,
            description="What is left of the light after lamps have aged and dust has settled, by which it is "
            "multiplied; 1 without it.",
        ),
    ]
    | UnsetType
)
Falloff = Annotated[
    Literal["quadratic", "none"],
    Meta(description="quadratic: by the square of the distance, as in nature; none: the same at any distance."),
]


class Light(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """Fields that all punctual lights have: points, spots and directional lights."""

    name: Annotated[str, Meta(description="Name for messages and tables.")] | UnsetType = UNSET
    unit: OwnUnit = UNSET


class PointLight(Light, tag="point", kw_only=True):
    """Point light, equal in all directions or with a photometric profile."""

    position: Annotated[Vector, Meta(description="Where the light is.")]
    intensity: Intensity | UnsetType = UNSET
    flux: Flux = UNSET
    falloff: Falloff = "quadratic"
    maintenance_factor: MaintenanceFactor = UNSET
    profile: (
        Annotated[
            str,
            Meta(
                description="A photometric web, an IES LM-63 file (.ies) of type C or a EULUMDAT file (.ldt), "
                "relative to this file's folder: its candela are multiplied by `intensity`, 1 without it."
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
    """Spot light: a point that emits into a cone."""

    position: Annotated[Vector, Meta(description="Where the light is.")]
    target: Annotated[Vector, Meta(description="A point on the axis of the cone.")]
    intensity: Intensity | UnsetType = UNSET
    flux: Flux = UNSET
    cone: Annotated[
        tuple[float, float],
        Meta(
            description="Two half angles in degrees, 0 to 180: full light within the first, none beyond the "
            "second. Between them it fades as in glTF."
        ),
    ] = (30.0, 40.0)
    falloff: Falloff = "quadratic"
    maintenance_factor: MaintenanceFactor = UNSET


class DirectionalLight(Light, tag="directional", kw_only=True):
    """Directional light: parallel rays from infinitely far away, like sunlight."""

    direction: Annotated[Vector, Meta(description="The direction in which light travels, of any length but zero.")]
    irradiance: Annotated[
        float | Vector,
        Meta(
            description="Irradiance in W m^-2, or lx where photometric, on a surface that faces the light, 0 or "
            "more: one number or [r, g, b], linear Rec. 709."
        ),
    ]


AnyLight = PointLight | SpotLight | DirectionalLight


class Portal(Struct, forbid_unknown_fields=True, kw_only=True):
    """Portal: a rectangular opening through which the sky lights a room."""

    corners: Annotated[
        tuple[Vector, Vector, Vector, Vector],
        Meta(description="Four corners [x, y, z] of a rectangle, counter-clockwise seen from inside the room."),
    ]


class Sky(Struct, forbid_unknown_fields=True, kw_only=True):
    """Sky: the radiance of rays that hit nothing.

    It is a blend from horizon to zenith, an environment map, a CIE sky, or a sky with a sun. The latter is computed
    from irradiances, from a site and time, or from an hour of a weather file.
    """

    type: (
        Annotated[
            Literal["cie", "perez", "sun"],
            Meta(
                description="cie: one of the fifteen general skies of ISO 15469, given by `cie_type`, with "
                "`zenith` or `illuminance`, and `sun`; the sun itself is no part of it. perez: the all-weather sky "
                "and the sun's disc, of `direct` and `diffuse`, of `weather`, or of a clear day. sun: the disc "
                "alone."
            ),
        ]
        | UnsetType
    ) = UNSET
    cie_type: (
        Annotated[
            int,
            Meta(
                ge=1, le=15, description="Of a sky of the CIE: 1 overcast, 5 uniform, 12 clear, 13 clear, polluted."
            ),
        ]
        | UnsetType
    ) = UNSET
    sun: (
        Annotated[
            Vector,
            Meta(
                description="Towards the sun, of any length, not below the horizon. Of a sky of the CIE, whose "
                "types 1, 3 and 5 do without; of perez and sun instead of `altitude` and `azimuth`."
            ),
        ]
        | UnsetType
    ) = UNSET
    illuminance: (
        Annotated[
            float,
            Meta(
                ge=0,
                description="Of a sky of the CIE, instead of `zenith`: of a horizontal surface in the open, "
                "lx where photometric, or W m^-2.",
            ),
        ]
        | UnsetType
    ) = UNSET
    zenith: (
        Annotated[
            float | Vector,
            Meta(
                description="Radiance overhead in W sr^-1 m^-2, or cd m^-2 where photometric, 0 or more: one "
                "number or [r, g, b]."
            ),
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
                description="An environment map instead of zenith and horizon: an equirectangular picture, EXR, "
                "HDR, PNG or JPEG, its first row up; a relative path starts at the folder of the scene file."
            ),
        ]
        | UnsetType
    ) = UNSET
    scale: (
        Annotated[
            float,
            Meta(ge=0, description="Of the map: what makes its values W sr^-1 m^-2, or cd m^-2; 1 without it."),
        ]
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
    unit: OwnUnit = UNSET
    direct: (
        Annotated[
            float,
            Meta(ge=0, description="Of perez and sun: irradiance of a surface that faces the sun, W m^-2, solar."),
        ]
        | UnsetType
    ) = UNSET
    diffuse: (
        Annotated[
            float,
            Meta(
                ge=0,
                description="Of perez: irradiance of a horizontal surface by the sky alone, W m^-2, solar. Of sun "
                "it says how clear the sky is, on which the efficacy of its light depends.",
            ),
        ]
        | UnsetType
    ) = UNSET
    altitude: (
        Annotated[float, Meta(description="Of perez and sun: of the sun, degrees above the horizon, to 90.")]
        | UnsetType
    ) = UNSET
    azimuth: (
        Annotated[float, Meta(description="Of perez and sun: of the sun, degrees from north by east.")] | UnsetType
    ) = UNSET
    latitude: (
        Annotated[float, Meta(ge=-90, le=90, description="Of perez and sun: of the site, degrees, north.")]
        | UnsetType
    ) = UNSET
    longitude: (
        Annotated[float, Meta(ge=-180, le=180, description="Of perez and sun: of the site, degrees, east.")]
        | UnsetType
    ) = UNSET
    timezone: (
        Annotated[
            float, Meta(ge=-14, le=14, description="Of `time`: hours east of Greenwich, where it has no offset.")
        ]
        | UnsetType
    ) = UNSET
    time: (
        Annotated[
            str,
            Meta(
                description='Of perez and sun: "2024-06-21T12:00", local standard time, or with an offset, '
                '"2024-06-21T12:00+02:00". Of a weather file it chooses the hour.'
            ),
        ]
        | UnsetType
    ) = UNSET
    weather: (
        Annotated[
            str,
            Meta(
                description="Of perez and sun: a weather file, EPW (.epw) or TMY3 (.csv), relative to this file's "
                "folder. It has the site, its time zone and the irradiance of the hour of `time`."
            ),
        ]
        | UnsetType
    ) = UNSET
    north: (
        Annotated[
            Vector,
            Meta(
                description="Of azimuths: towards north, of any length, not along `up`. Without it +y where z is "
                "up, -z where y is, +z where x is: east is then +x, or +y where x is up."
            ),
        ]
        | UnsetType
    ) = UNSET
    ground: (
        Annotated[
            float,
            Meta(
                ge=0,
                le=1,
                description="Of perez, sun and cie: albedo of all that lies below the horizon, which has the "
                "radiance of a white ground in the open times it. 0.2 for perez, else 0.",
            ),
        ]
        | UnsetType
    ) = UNSET
    sun_disc: Annotated[bool, Meta(description="Of perez: the sun is part of it; true without it.")] | UnsetType = (
        UNSET
    )
    spectrum: (
        Annotated[
            Literal["visible", "solar"],
            Meta(
                description="Of perez and sun. visible, by default: light by Perez' luminous efficacy of daylight, "
                "lx where photometric, else watts of 179 lm. solar: W m^-2 of the whole spectrum, of which lux are "
                "not known; not where photometric."
            ),
        ]
        | UnsetType
    ) = UNSET
    portals: Annotated[
        list[Portal],
        Meta(
            description="Openings of rooms, for light samples of the sky; they change the noise of a picture, not "
            "its mean."
        ),
    ] = []
