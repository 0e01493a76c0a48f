"""The light of a scene file: punctual lights, emission, ambient light, the sky and environment maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import UnsetType

from glpath.errors import warn
from glpath.image import read_image
from glpath.scene.formats import description
from glpath.scene.formats.description import MAX_ENVIRONMENT_PIXELS, AnyLight, Emission
from glpath.scene.formats.ies import read_ies
from glpath.scene.formats.scene_pictures import stored_picture
from glpath.scene.formats.values import LARGEST, light, unit
from glpath.scene.model import Environment, Float64, Light, LightProfile, Sky
from glpath.scene.place import Place

MAPS = (".exr", ".hdr", ".png", ".jpg", ".jpeg")


def lights(given: Sequence[AnyLight], place: Place, folder: Path, camera_up: Float64) -> tuple[Light, ...]:
    """Those of the file; `place` is their list's, `folder` where relative paths start. Raises SceneError."""
    profiles: dict[Path, LightProfile] = {}
    return tuple(
        _light(each, index, place.item(index), folder, camera_up, profiles) for index, each in enumerate(given)
    )


def _light(
    given: AnyLight,
    index: int,
    place: Place,
    folder: Path,
    camera_up: Float64,
    profiles: dict[Path, LightProfile],
) -> Light:
    name = f"{given.__struct_config__.tag}-{index}" if isinstance(given.name, UnsetType) else given.name
    match given:
        case description.PointLight():
            position = np.array(given.position, np.float64)
            if isinstance(given.profile, UnsetType):
                return Light(
                    name, "point", _plain_intensity(given, place), position=position, falloff=given.falloff
                )
            path = folder / given.profile
            if path not in profiles:  # a file is read once, however many lamps it is of
                profiles[path] = read_ies(path, place.field("profile"))
            direction, c0 = _orientation(given, camera_up, place)
            factor = 1.0 if isinstance(given.intensity, UnsetType) else given.intensity
            return Light(
                name,
                "point",
                light(factor, place.field("intensity")),
                position=position,
                direction=direction,
                falloff=given.falloff,
                profile=profiles[path],
                c0=c0,
            )
        case description.SpotLight():
            position, target = np.array(given.position, np.float64), np.array(given.target, np.float64)
            axis = target - position
            length = np.linalg.norm(axis)
            if not length > 1e-12 * np.linalg.norm(position):
                raise place.field("target").error(
                    "is the same point as position, so that the light shines nowhere.", "Move one of them."
                )
            return Light(
                name,
                "spot",
                light(given.intensity, place.field("intensity")),
                position=position,
                direction=axis / length,
                cone=_cone(given.cone, place.field("cone")),
                falloff=given.falloff,
            )
        case description.DirectionalLight():
            return Light(
                name,
                "directional",
                light(given.irradiance, place.field("irradiance")),
                direction=unit(given.direction, place.field("direction"), "direction = [0, -1, 0]"),
            )


def _plain_intensity(given: description.PointLight, place: Place) -> Float64:
    """(3,) of a light without a profile."""
    for name in ("direction", "c0"):
        if not isinstance(getattr(given, name), UnsetType):
            raise place.field(name).error(
                "turns a profile, which the light does not have.", 'Add profile = "lamp.ies", or leave it out.'
            )
    if isinstance(given.intensity, UnsetType):
        raise place.error(
            "lacks the field `intensity`, which a light without a `profile` must have.",
            "Radiant intensity in W sr^-1, one number or [r, g, b]; for example intensity = 10.",
        )
    return light(given.intensity, place.field("intensity"))


def _orientation(given: description.PointLight, camera_up: Float64, place: Place) -> tuple[Float64, Float64]:
    """Where gamma is 0, and C at gamma 90: (3,) each, unit and perpendicular."""
    down = -camera_up if isinstance(given.direction, UnsetType) else given.direction
    direction = unit(down, place.field("direction"), "direction = [0, -1, 0]")
    if isinstance(given.c0, UnsetType):
        # Not the axis that the light goes along.
        towards = np.array([0.0, 0.0, 1.0] if abs(direction[0]) > 0.999 else [1.0, 0.0, 0.0])
    else:
        towards = unit(given.c0, place.field("c0"), "c0 = [1, 0, 0]")
    across = towards - (towards @ direction) * direction
    length = float(np.linalg.norm(across))
    if length < 1e-6:
        raise place.field("c0").error("goes along `direction`, so that C = 0 is nowhere.", "Turn it away from it.")
    return direction, across / length


def _cone(cone: tuple[float, float], place: Place) -> tuple[float, float]:
    full, end = cone
    if not (0 <= full <= end <= 180 and end > 0):
        raise place.wrong(
            list(cone),
            "two angles from 0 to 180 degrees, the first not above the second, the second not 0",
            "Half angles: full light within the first, none beyond the second. For example cone = [30, 40].",
        )
    return full, end


def emission(given: Emission | UnsetType, place: Place) -> tuple[Float64, bool]:
    """(3,) radiance of a shape, and whether it leaves both sides. Raises SceneError."""
    if isinstance(given, UnsetType):
        return np.zeros(3), False
    return light(given.radiance, place.field("radiance")), given.two_sided


def sky(
    given: description.Sky | UnsetType, camera_up: Float64, place: Place, folder: Path
) -> Sky | Environment | None:
    """The sky, or None where the file has none; `folder` is where relative paths start. Raises SceneError."""
    if isinstance(given, UnsetType):
        return None
    up = unit(camera_up if isinstance(given.up, UnsetType) else given.up, place.field("up"), "up = [0, 1, 0]")
    others = ("scale", "rotation") if isinstance(given.file, UnsetType) else ("zenith", "horizon")
    found = [name for name in others if not isinstance(getattr(given, name), UnsetType)]
    if not isinstance(given.file, UnsetType) and not found:
        scale = 1.0 if isinstance(given.scale, UnsetType) else given.scale
        rotation = 0.0 if isinstance(given.rotation, UnsetType) else given.rotation
        return _environment(folder / given.file, scale, rotation, up, place)
    if isinstance(given.zenith, UnsetType) or found:
        names = ("zenith", "horizon", "file", "scale", "rotation")
        has = [name for name in names if not isinstance(getattr(given, name), UnsetType)]
        raise place.error(
            f"has {' and '.join(has) or 'no radiance'}, but a sky is `zenith`, perhaps with `horizon`, or `file`, "
            "perhaps with `scale` and `rotation`.",
            'For example: zenith = [0.3, 0.5, 1.0], or file = "sky.hdr".',
        )
    zenith = light(given.zenith, place.field("zenith"))
    horizon = zenith if isinstance(given.horizon, UnsetType) else light(given.horizon, place.field("horizon"))
    return Sky(zenith, horizon, up)


def _environment(path: Path, scale: float, rotation: float, up: Float64, place: Place) -> Environment:
    """The environment map of a file. Raises SceneError; warns of what it clips."""
    place, sky = place.field("file"), place
    stored = stored_picture(path, "an environment map", MAPS, MAX_ENVIRONMENT_PIXELS, place, read_image)
    negative = np.count_nonzero(stored < 0)
    if negative:
        warn(
            f"{place}: {negative} of {stored.size} values of {path} are below 0, down to {stored.min():.3g}; "
            "they were taken for 0, as light cannot be negative."
        )
    if stored.max() * scale > LARGEST:
        raise sky.error(f"has radiance up to {stored.max() * scale:.3g}, but allowed is at most {LARGEST:g}.")
    return Environment(np.maximum(stored, 0.0).astype(np.float32), up, rotation, scale)
