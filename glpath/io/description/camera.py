"""Tables [camera] and [film] of a scene file."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, Meta, Struct, UnsetType

from glpath.io.description.vector import Vector

MAX_RESOLUTION = 32768


class CameraKey(Struct, forbid_unknown_fields=True, kw_only=True):
    """Keyframe of a camera; a field that is left out keeps the value of the camera."""

    time: Annotated[float, Meta(description="Seconds, later than the key before.")]
    position: Annotated[Vector, Meta(description="Where the eye is then, [x, y, z].")] | UnsetType = UNSET
    target: Annotated[Vector, Meta(description="What it looks at then, [x, y, z].")] | UnsetType = UNSET
    up: Annotated[Vector, Meta(description="What is up then.")] | UnsetType = UNSET


class View(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """Fields that all cameras have."""

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


class Plane(View, kw_only=True):
    """Fields of the cameras with a flat image plane."""

    principal_point: Annotated[
        tuple[float, float],
        Meta(
            description="Where the view goes through the picture, in its widths and heights from the upper left "
            "corner; a shifted lens has another than the middle."
        ),
    ] = (0.5, 0.5)
    pixel_aspect: Annotated[float, Meta(gt=0, description="Width of a pixel over its height.")] = 1.0


class Camera(Plane, tag="perspective", kw_only=True):
    """Pinhole or thin-lens camera; the default if a camera has no type."""

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


class Orthographic(Plane, tag="orthographic", kw_only=True):
    """Orthographic camera: parallel rays that start in the plane through the position."""

    height: Annotated[float, Meta(gt=0, description="Of the whole picture, scene units.")]


class Panorama(View, tag="panorama", kw_only=True):
    """Equirectangular panorama: 360 degrees wide, 180 degrees high, the target in the middle."""


AnyCamera = Camera | Orthographic | Panorama
_Pixels = Annotated[int, Meta(ge=1, le=MAX_RESOLUTION)]


class Film(Struct, forbid_unknown_fields=True, kw_only=True):
    """Resolution and exposure of the image."""

    resolution: Annotated[tuple[_Pixels, _Pixels], Meta(description="[width, height] in pixels.")] = (512, 512)
    exposure: (
        Annotated[
            float,
            Meta(
                ge=-100,
                le=100,
                description="Stops by which an 8-bit picture is brightened: 1 doubles it. Without it the picture "
                "decides (`glpath.film.tonemap.auto_exposure`).",
            ),
        ]
        | UnsetType
    ) = UNSET
