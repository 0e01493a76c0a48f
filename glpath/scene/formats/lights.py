"""The light of a scene file: punctual lights, emission, ambient light and the sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import UnsetType

from glpath.scene.formats import description
from glpath.scene.formats.description import AnyLight, Emission
from glpath.scene.formats.values import light, unit
from glpath.scene.model import Float64, Light, Sky
from glpath.scene.place import Place


def lights(given: Sequence[AnyLight], place: Place) -> tuple[Light, ...]:
    """Those of the file; `place` is their list's. Raises SceneError."""
    return tuple(_light(each, index, place.item(index)) for index, each in enumerate(given))


def _light(given: AnyLight, index: int, place: Place) -> Light:
    name = f"{given.__struct_config__.tag}-{index}" if isinstance(given.name, UnsetType) else given.name
    match given:
        case description.PointLight():
            return Light(
                name,
                "point",
                light(given.intensity, place.field("intensity")),
                position=np.array(given.position, np.float64),
                falloff=given.falloff,
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


def sky(given: description.Sky | UnsetType, camera_up: Float64, place: Place) -> Sky | None:
    """The sky, or None where the file has none. Raises SceneError."""
    if isinstance(given, UnsetType):
        return None
    zenith = light(given.zenith, place.field("zenith"))
    horizon = zenith if isinstance(given.horizon, UnsetType) else light(given.horizon, place.field("horizon"))
    up = camera_up if isinstance(given.up, UnsetType) else given.up
    return Sky(zenith, horizon, unit(up, place.field("up"), "up = [0, 1, 0]"))
