"""Reader of Mitsuba's sensor and film. Its camera frame has y up, +z ahead and +x to the left of the image."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from glpath.io.description.camera import MAX_RESOLUTION
from glpath.io.mitsuba.document import error_of_kind
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.transform import mirrors
from glpath.scene.camera import Camera
from glpath.scene.model import Scene
from glpath.scene.sight import sees_nearer
from glpath.scene.source_location import shown

_KINDS = dict.fromkeys(("perspective", "thinlens", "orthographic"))
_FILMS = dict.fromkeys(("hdrfilm",))
_AXES = ("x", "y", "diagonal", "smaller", "larger")
_LENGTH = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*mm\s*")
# Diagonal of a 35 mm film frame, 24 x 36 mm, to which focal lengths refer.
_DIAGONAL = float(np.hypot(24.0, 36.0))
# Range of focal lengths, mm.
_FOCAL_LENGTHS = (1e-3, 1e6)
_RESOLUTION = (768, 576)
# Maximum depth of a near plane that counts as cutting off nothing, as a fraction of the scene's diagonal.
_NEGLIGIBLE = 1e-2


class Clips(NamedTuple):
    """Near and far clipping depths of Mitsuba's camera along the view axis, scene units."""

    near: float = 1e-2
    far: float = 1e4


def clipping_notes(clips: Clips, scene: Scene) -> list[str]:
    """Return notes on clipping planes that cut off a part of the scene in Mitsuba."""
    camera, (lower, upper) = scene.camera, scene.bounds
    corners = np.stack(np.meshgrid(*np.transpose([lower, upper]), indexing="ij"), axis=-1).reshape(-1, 3)
    axis = (camera.target - camera.position) / np.linalg.norm(camera.target - camera.position)
    depths = (corners - camera.position) @ axis
    notes = []
    reaches = clips.near > max(float(depths.min()), _NEGLIGIBLE * float(np.linalg.norm(upper - lower)))
    if reaches and (camera.projection != "perspective" or sees_nearer(scene, clips.near)):
        notes.append(f"`near_clip` is not read: what is nearer than {clips.near:g} is visible")
    if clips.far < depths.max():
        notes.append(f"`far_clip` is not read: what is farther than {clips.far:g} is visible")
    return notes


def camera_of(plugin: Plugin) -> tuple[Camera, Clips]:
    """Return the camera of a sensor, and its clipping depths, which a `Camera` lacks. Raises SceneError."""
    if plugin.kind not in _KINDS:
        raise error_of_kind(plugin.element, "a sensor", _KINDS)
    width, height = _film(plugin)
    world = plugin.transform("to_world")
    if mirrors(world):
        raise plugin.where("to_world").error(
            "mirrors the picture, which a camera here does not.",
            "Leave out the scale by -1, and mirror the picture when it is done.",
        )
    axes = world[:3, :3] / np.linalg.norm(world[:3, :3], axis=0)
    if not np.allclose(axes.T @ axes, np.eye(3), atol=1e-4):
        raise plugin.where("to_world").error(
            "shears the picture.", "Give a lookat, or rotations and a translation."
        )
    for name in ("shutter_open", "shutter_close"):
        plugin.number(name, 0.0, 0.0)  # has no effect, because nothing moves
    clips = Clips(*(plugin.number(f"{side}_clip", default, 0.0) for side, default in Clips()._asdict().items()))
    position, forward = world[:3, 3], axes[:, 2]
    camera = Camera(position, position + forward, axes[:, 1], 40.0, (width, height))
    if plugin.kind == "orthographic":  # Mitsuba's image is 2 wide before `to_world` scales it
        across, up = np.linalg.norm(world[:3, :2], axis=0).tolist()
        aspect = 1.0 if np.isclose(across, up, rtol=1e-9) else across / up
        camera = replace(camera, projection="orthographic", height=2.0 * up * height / width, pixel_aspect=aspect)
    else:
        offset = (plugin.number(f"principal_point_offset_{axis}", 0.0) for axis in "xy")
        across, down = (0.5 - each for each in offset)
        camera = replace(camera, fov=_vertical(plugin, width, height), principal_point=(across, down))
    if plugin.kind == "thinlens":
        if "aperture_radius" not in plugin:
            raise plugin.location.error("lacks the parameter `aperture_radius`, which must be there.")
        camera = replace(
            camera,
            aperture_radius=plugin.number("aperture_radius", 0.0, 0.0),
            focus_distance=plugin.number("focus_distance", clips.far, 1e-12),
        )
    else:
        plugin.number("focus_distance", 1.0)  # all of Mitsuba's cameras have this parameter; a pinhole ignores it
    if plugin.nested("sampler"):
        pass  # samples are options of `glpath render`
    plugin.check_all_read()
    return camera, clips


def _film(plugin: Plugin) -> tuple[int, int]:
    """Return (width, height). The film's filter, file and pixel format are not part of the scene."""
    films = plugin.nested("film")
    if not films:
        return _RESOLUTION
    film = films[0]
    if film.kind not in _FILMS:
        raise error_of_kind(film.element, "a film", _FILMS)
    size = film.whole("width", _RESOLUTION[0], 1), film.whole("height", _RESOLUTION[1], 1)
    for name, pixels in zip(("width", "height"), size, strict=True):
        if pixels > MAX_RESOLUTION:
            raise film.where(name).error(f"is {pixels}, but must be at most {MAX_RESOLUTION}.")
    for name in ("crop_offset_x", "crop_offset_y"):
        film.refuse_unless(name, 0.0, "the whole picture is rendered")
    for name, whole in zip(("crop_width", "crop_height"), size, strict=True):
        film.refuse_unless(name, float(whole), "the whole picture is rendered")
    film.nested("rfilter")
    for name in ("file_format", "pixel_format", "component_format"):
        film.text(name)
    for name in ("banner", "high_quality_edges", "sample_border", "compensate"):
        film.flag(name, False)
    film.number("gamma", 0.0)
    film.check_all_read()
    return size


def _vertical(plugin: Plugin, width: int, height: int) -> float:
    """Return the vertical field of view, degrees."""
    given = plugin.text("focal_length")
    axis = plugin.text("fov_axis", "x", _AXES)
    if given:
        found = _LENGTH.fullmatch(given)
        low, high = _FOCAL_LENGTHS
        if found is None or not low <= float(found[1]) <= high:
            raise plugin.where("focal_length").error(
                f"is {shown(given)}, but must be a length from {low:g}mm to {high:,.0f}mm, such as 50mm."
            )
        tangent, axis = 0.5 * _DIAGONAL / float(found[1]), "diagonal"
    elif "fov" in plugin:
        tangent = float(np.tan(np.radians(plugin.number("fov", 40.0, 1e-3, 179.99)) / 2))
    else:
        tangent, axis = 0.5 * _DIAGONAL / 50.0, "diagonal"
    sides = {"x": width, "y": height, "diagonal": float(np.hypot(width, height))}
    sides |= {"smaller": min(width, height), "larger": max(width, height)}
    return float(np.degrees(2 * np.arctan(tangent * height / sides[axis])))
