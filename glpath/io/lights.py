"""Light of a scene file: punctual lights, emission, the sky, portals and environment maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from msgspec import UNSET, UnsetType

from glpath.errors import warn
from glpath.film.image import read_environment
from glpath.io import description
from glpath.io.day_sky import OF_DAYS, day_sky
from glpath.io.description import MAX_ENVIRONMENT_PIXELS, AnyLight, Emission
from glpath.io.photometry import read_profile
from glpath.io.scene_pictures import stored_picture
from glpath.io.values import LARGEST, light, unit
from glpath.scene.appearance import opacity_of
from glpath.scene.geometry import ellipsoid_area
from glpath.scene.maintenance import with_factor
from glpath.scene.model import (
    Environment,
    Float64,
    Light,
    LightProfile,
    Material,
    Mesh,
    Portal,
    Shape,
    Sky,
    Texture,
)
from glpath.scene.portal import MAX_PORTALS, portal_fault
from glpath.scene.source_location import SourceLocation, shown
from glpath.scene.spot_cone import spot_solid_angle
from glpath.sky.cie import cie_sky, has_sun
from glpath.system.time_limit import check_time
from glpath.system.units import Unit, conversion

MAPS = (".exr", ".hdr", ".png", ".jpg", ".jpeg")
# Fields that are errors in a sky of type "perez" or "sun", whose light is given as irradiances.
_NOT_OF_DAYS = ("cie_type", "illuminance", "zenith", "horizon", "file", "scale", "rotation", "unit")


def lights(
    given: Sequence[AnyLight], location: SourceLocation, folder: Path, camera_up: Float64, scene_unit: Unit
) -> tuple[Light, ...]:
    """Return the lights of the file, in the unit of the scene. Raises SceneError.

    location : location of the list of lights
    folder   : base folder of relative paths
    """
    profiles: dict[Path, LightProfile] = {}
    made = (
        _light(each, index, location.item(index), folder, camera_up, profiles) for index, each in enumerate(given)
    )
    found = []
    for i, (lamp, each) in enumerate(zip(made, given, strict=True)):
        check_time()
        factor = conversion(_unit_of(each, location.item(i), scene_unit), scene_unit)
        found.append(with_factor(replace(lamp, intensity=lamp.intensity * factor), _factor_of(each)))
    return tuple(found)


def _factor_of(given: AnyLight | Emission) -> float | None:
    """Return the maintenance factor of a light or emission; None if its table does not set one."""
    factor = getattr(given, "maintenance_factor", UNSET)
    return None if isinstance(factor, UnsetType) else float(factor)


def _unit_of(given: AnyLight, location: SourceLocation, scene_unit: Unit) -> Unit:
    """Return the unit of a light's numbers. Raises SceneError for a profile in watts."""
    if isinstance(given, description.PointLight) and not isinstance(given.profile, UnsetType):
        if given.unit == "radiometric":
            raise location.field("unit").error(
                "is radiometric, but the candela of a profile are photometric.",
                "Leave it out: the light is converted to the unit of the scene.",
            )
        return "photometric"
    return scene_unit if isinstance(given.unit, UnsetType) else given.unit


def _light(
    given: AnyLight,
    index: int,
    location: SourceLocation,
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
                    name, "point", _plain_intensity(given, location), position=position, falloff=given.falloff
                )
            path = folder / given.profile
            if path not in profiles:  # read each profile once, even if several lights name it
                profiles[path] = read_profile(path, location.field("profile"))
            direction, c0 = _orientation(given, camera_up, location)
            return Light(
                name,
                "point",
                _times_candela(given, profiles[path], location),
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
                raise location.field("target").error(
                    "is the same point as position, so that the light shines nowhere.", "Move one of them."
                )
            cone = _cone(given.cone, location.field("cone"))
            return Light(
                name,
                "spot",
                _intensity(given, spot_solid_angle(cone), location),
                position=position,
                direction=axis / length,
                cone=cone,
                falloff=given.falloff,
            )
        case description.DirectionalLight():
            return Light(
                name,
                "directional",
                light(given.irradiance, location.field("irradiance")),
                direction=unit(given.direction, location.field("direction"), "direction = [0, -1, 0]"),
            )


def _plain_intensity(given: description.PointLight, location: SourceLocation) -> Float64:
    """Return the (3,) intensity of a light without a profile. Raises SceneError."""
    for name in ("direction", "c0"):
        if not isinstance(getattr(given, name), UnsetType):
            raise location.field(name).error(
                "turns a profile, which the light does not have.", 'Add profile = "lamp.ies", or leave it out.'
            )
    return _intensity(given, 4 * np.pi, location)


def _intensity(
    given: description.PointLight | description.SpotLight, angle: float, location: SourceLocation
) -> Float64:
    """Return the (3,) intensity of a light without a profile, from its field `intensity` or `flux`.

    angle : flux divided by intensity, steradians

    Raises SceneError if both fields are set, or neither.
    """
    if not isinstance(given.flux, UnsetType):
        if not isinstance(given.intensity, UnsetType):
            raise location.error("has intensity and flux, but a light has one of them.", "Leave one away.")
        return _flux(given, location) / angle
    if isinstance(given.intensity, UnsetType):
        raise location.error(
            "lacks the field `intensity`, which a light without a `profile` must have, or `flux`.",
            "Intensity in W sr^-1, or cd where photometric, one number or [r, g, b]: intensity = 10.",
        )
    return light(given.intensity, location.field("intensity"))


def _times_candela(given: description.PointLight, profile: LightProfile, location: SourceLocation) -> Float64:
    """Return the (3,) factor by which the profile's candela are multiplied. Raises SceneError."""
    if isinstance(given.flux, UnsetType):
        return light(
            1.0 if isinstance(given.intensity, UnsetType) else given.intensity, location.field("intensity")
        )
    if not isinstance(given.intensity, UnsetType):
        raise location.error("has intensity and flux, but a light has one of them.", "Leave one away.")
    if not profile.flux > 0:
        raise location.field("flux").error("is of a profile that is dark.")
    return _flux(given, location) / profile.flux


def _flux(given: description.PointLight | description.SpotLight, location: SourceLocation) -> Float64:
    """Return the (3,) flux of a light, W or lm. Raises SceneError if its falloff is "none"."""
    if given.falloff == "none":
        raise location.field("flux").error(
            'is of a light whose falloff is "none", which has no flux.', "Give it an intensity."
        )
    return light(given.flux, location.field("flux"))  # type: ignore[arg-type]


def _orientation(
    given: description.PointLight, camera_up: Float64, location: SourceLocation
) -> tuple[Float64, Float64]:
    """Return the orientation of a photometric profile as two perpendicular (3,) unit vectors.

    The first vector is the direction of the profile's angle gamma = 0. The second is that of gamma = 90 degrees in
    the plane C = 0. Raises SceneError if `c0` is parallel to `direction`.
    """
    down = -camera_up if isinstance(given.direction, UnsetType) else given.direction
    direction = unit(down, location.field("direction"), "direction = [0, -1, 0]")
    if isinstance(given.c0, UnsetType):
        # Choose an axis that is not parallel to the light's direction.
        towards = np.array([0.0, 0.0, 1.0] if abs(direction[0]) > 0.999 else [1.0, 0.0, 0.0])
    else:
        towards = unit(given.c0, location.field("c0"), "c0 = [1, 0, 0]")
    across = towards - (towards @ direction) * direction
    length = float(np.linalg.norm(across))
    if length < 1e-6:
        raise location.field("c0").error(
            "goes along `direction`, so that C = 0 is nowhere.", "Choose another direction."
        )
    return direction, across / length


def _cone(cone: tuple[float, float], location: SourceLocation) -> tuple[float, float]:
    full, end = cone
    if not (0 <= full <= end <= 180 and end > 0):
        raise location.wrong(
            list(cone),
            "two angles from 0 to 180 degrees, the first not above the second, the second not 0",
            "Half angles: full light within the first, none beyond the second. For example cone = [30, 40].",
        )
    return full, end


def emission(
    given: Emission | UnsetType,
    location: SourceLocation,
    scene_unit: Unit,
    shape: Shape,
    material: Material,
    textures: Sequence[Texture],
) -> Shape:
    """Return `shape` with the emission of the table `given`, in the unit of the scene. Raises SceneError.

    textures : textures of the scene file, for the opacity of the material
    """
    if isinstance(given, UnsetType):
        return shape
    if given.two_sided and material.culled:
        raise location.field("two_sided").error(
            "is true of a shape whose material is culled, so that it has no back.", "Leave one of them away."
        )
    factor = 1.0 if isinstance(given.unit, UnsetType) else conversion(given.unit, scene_unit)
    if isinstance(given.flux, UnsetType) == isinstance(given.radiance, UnsetType):
        has = "lacks the field `radiance`" if isinstance(given.flux, UnsetType) else "has radiance and flux"
        raise location.error(
            f"{has}, but an emission is one of `radiance` and `flux`.", "For example radiance = 10."
        )
    if not isinstance(given.radiance, UnsetType):
        radiance = light(given.radiance, location.field("radiance"))
    elif material.emission_texture is not None or shape.primitive not in ("triangle", "sphere"):
        what = "a material with an emission_texture" if material.emission_texture else f"a {shape.primitive}"
        raise location.field("flux").error(f"is of {what}, for which it is not known.", "Give it a radiance.")
    else:
        # Emission is multiplied by the opacity.
        area = _area_of(shape) * (2 if given.two_sided else 1) * _opacity_of(shape, material, textures, location)
        radiance = light(given.flux, location.field("flux")) / (np.pi * area)  # type: ignore[arg-type]
    shining = replace(
        shape,
        emission=factor * radiance,
        emission_two_sided=given.two_sided,
        keeps_flux=shape.primitive == "sphere" and not isinstance(given.flux, UnsetType),
    )
    return with_factor(shining, _factor_of(given))


def _opacity_of(shape: Shape, material: Material, textures: Sequence[Texture], location: SourceLocation) -> float:
    """Return the opacity of an emitter. Raises SceneError if it is 0 or varies over the shape."""
    if material.alpha == "opaque":
        return 1.0
    low = high = 1.0
    if material.texture is not None:
        image = textures[material.texture.texture].image
        if image.shape[2] == 4:
            full = 255 if image.dtype == np.uint8 else 1
            low, high = float(image[..., 3].min()) / full, float(image[..., 3].max()) / full
    if isinstance(shape.geometry, Mesh) and shape.geometry.colours is not None:
        alpha = shape.geometry.colours[:, 3]
        low, high = low * float(alpha.min()), high * float(alpha.max())
    low, high = (float(opacity_of(material, np.array(alpha))) for alpha in (low, high))
    if low != high:
        raise location.field("flux").error(
            f"is of a material with alpha = {shown(material.alpha)}, whose opacity varies.", "Give it a radiance."
        )
    if not low > 0:
        raise location.field("flux").error("is of a material whose opacity is 0, so that nothing of it emits.")
    return low


def _area_of(shape: Shape) -> float:
    """Return the area of a mesh or of a sphere, which may be an ellipsoid, in scene units squared."""
    if isinstance(shape.geometry, Mesh):
        corners = shape.geometry.vertices[shape.geometry.faces]
        edges = (corners[:, 1:] - corners[:, :1]) @ shape.world_from_object[0, :, :3].T
        return float(0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum())
    return ellipsoid_area(shape.world_from_object[0])


def sky(
    given: description.Sky | UnsetType, camera_up: Float64, location: SourceLocation, folder: Path, scene_unit: Unit
) -> Sky | Environment | None:
    """Return the sky in the unit of the scene; None if the file has no sky. Raises SceneError.

    folder : base folder of relative paths
    """
    if isinstance(given, UnsetType):
        return None
    factor = 1.0 if isinstance(given.unit, UnsetType) else conversion(given.unit, scene_unit)
    up = unit(camera_up if isinstance(given.up, UnsetType) else given.up, location.field("up"), "up = [0, 1, 0]")
    if given.type in ("perez", "sun"):
        _check_names(given, _NOT_OF_DAYS, location, "Such a sky is of irradiances, W m^-2.")
        return day_sky(given, up, location, folder, scene_unit)
    _check_names(given, OF_DAYS, location, 'Of a sky with type = "perez" or "sun" there is one.')
    if given.type == "cie":
        return _cie_sky(given, up, factor, location)
    _check_names(
        given, ("cie_type", "sun", "illuminance", "ground"), location, 'Of a sky with type = "cie" there is one.'
    )
    others = ("scale", "rotation") if isinstance(given.file, UnsetType) else ("zenith", "horizon")
    found = [name for name in others if not isinstance(getattr(given, name), UnsetType)]
    if not isinstance(given.file, UnsetType) and not found:
        scale = 1.0 if isinstance(given.scale, UnsetType) else given.scale
        rotation = 0.0 if isinstance(given.rotation, UnsetType) else given.rotation
        return environment_map(folder / given.file, factor * scale, rotation, up, location.field("file"))
    if isinstance(given.zenith, UnsetType) or found:
        names = ("zenith", "horizon", "file", "scale", "rotation")
        has = [name for name in names if not isinstance(getattr(given, name), UnsetType)]
        raise location.error(
            f"has {' and '.join(has) or 'no radiance'}, but a sky is `zenith`, perhaps with `horizon`, or `file`, "
            "perhaps with `scale` and `rotation`.",
            'For example: zenith = [0.3, 0.5, 1.0], or file = "sky.hdr".',
        )
    zenith = light(given.zenith, location.field("zenith"))
    horizon = zenith if isinstance(given.horizon, UnsetType) else light(given.horizon, location.field("horizon"))
    return Sky(factor * zenith, factor * horizon, up)


def portals(given: description.Sky | UnsetType, location: SourceLocation) -> tuple[Portal, ...]:
    """Return the portals of a sky. Raises SceneError.

    location : location of the sky's table
    """
    if isinstance(given, UnsetType):
        return ()
    location = location.field("portals")
    if len(given.portals) > MAX_PORTALS:
        raise location.error(
            f"are {len(given.portals)}, but allowed are {MAX_PORTALS} at most.",
            "Give one rectangle around several openings that lie in a plane.",
        )
    for index, each in enumerate(given.portals):
        fault = portal_fault(each.corners)
        if fault is not None:
            raise location.item(index).field("corners").error(*fault)
    return tuple(Portal(np.array(each.corners, np.float64)) for each in given.portals)


def _cie_sky(given: description.Sky, up: Float64, factor: float, location: SourceLocation) -> Environment:
    """Return the environment of a CIE sky. Raises SceneError."""
    _check_names(given, ("horizon", "file", "scale", "rotation"), location, "A sky of the CIE has none.")
    if isinstance(given.cie_type, UnsetType):
        raise location.error(
            "is a sky of the CIE without `cie_type`.", "For example: cie_type = 1, the overcast sky."
        )
    amounts = [each for each in (given.zenith, given.illuminance) if not isinstance(each, UnsetType)]
    if len(amounts) != 1:
        raise location.error(
            f"has {'both `zenith` and' if amounts else 'neither `zenith` nor'} `illuminance`, but a sky of the CIE "
            "has one of them.",
            "For example: illuminance = 10000.",
        )
    if not isinstance(given.zenith, UnsetType | int | float):
        raise location.field("zenith").error("is a colour, but skies of the CIE are white.", "Give one number.")
    zenith, illuminance = (
        None if isinstance(each, UnsetType) else factor * float(each) for each in (given.zenith, given.illuminance)
    )
    sun = None if isinstance(given.sun, UnsetType) else unit(given.sun, location.field("sun"), "sun = [1, 1, 0]")
    if sun is None and has_sun(given.cie_type):
        raise location.error(
            f"is the sky {given.cie_type} of the CIE, which depends on the sun, without `sun`.",
            "For example: sun = [1, 1, 0], towards it.",
        )
    if sun is not None and sun @ up < 0:
        raise location.field("sun").error("lies below the horizon.", "Its elevation must be from 0 to 90 degrees.")
    ground = 0.0 if isinstance(given.ground, UnsetType) else given.ground
    return cie_sky(given.cie_type, up, sun, zenith=zenith, illuminance=illuminance, ground=ground)


def _check_names(given: description.Sky, names: tuple[str, ...], location: SourceLocation, remedy: str) -> None:
    """Raise SceneError if one of the fields `names` is set, because this type of sky has none of them."""
    for name in names:
        if not isinstance(getattr(given, name), UnsetType):
            raise location.error(f"has `{name}`, which is not a field of such a sky.", remedy)


def environment_map(
    path: Path, scale: float, rotation: float, up: Float64, location: SourceLocation
) -> Environment:
    """Return the environment map of a file that a scene names at `location`.

    Raises SceneError. Warns of negative values, which become 0.
    """
    stored = stored_picture(path, "an environment map", MAPS, MAX_ENVIRONMENT_PIXELS, location, read_environment)
    negative = np.count_nonzero(stored < 0)
    if negative:
        warn(
            f"{location}: {negative} of {stored.size} values of {path} are below 0, down to {stored.min():.3g}; "
            "they count as 0, because light cannot be negative."
        )
    if (radiance := float(stored.max()) * scale) > LARGEST:
        raise location.error(f"has radiance up to {radiance:.3g}, but allowed is at most {LARGEST:g}.")
    return Environment(np.maximum(stored, 0.0, out=stored), up, rotation, scale)
