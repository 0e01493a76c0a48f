"""Reader of Mitsuba's emitters without a shape: points, spots, directional lights and environments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from glpath.film.image import read_environment
from glpath.io.description import MAX_ENVIRONMENT_PIXELS
from glpath.io.lights import MAPS
from glpath.io.mitsuba.document import error_of_kind
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.mitsuba.sunsky import sun_and_sky
from glpath.io.scene_pictures import stored_picture
from glpath.io.transform import mirrors
from glpath.io.values import unit
from glpath.scene.geometry import Float64
from glpath.scene.model import Environment, Light, Sky

_KINDS = dict.fromkeys(("point", "spot", "directional", "constant", "envmap", "sunsky"))
# Ratio of a spot's beam width to its cutoff angle below which a note reports the different falloff.
_SHARP = 0.999
# Minimum number of rows of an environment map for which a shift by half a row is invisible. The rows of such a map
# are not resampled.
_SMALL = 1100
# Number of rows of a stretched environment map that are computed at once, to save memory.
_ROWS_AT_ONCE = 64


@dataclass
class Emitters:
    """Lights of a scene, and its sky.

    notes : differences from Mitsuba, as sentences without a full stop
    """

    lights: list[Light] = field(default_factory=list)
    sky: Sky | Environment | None = None
    notes: dict[str, None] = field(default_factory=dict)

    def add(self, plugin: Plugin) -> None:
        """Add an emitter of the scene. Raises SceneError."""
        if plugin.kind not in _KINDS:
            remedy = "An area light stands in its shape." if plugin.kind == "area" else ""
            raise error_of_kind(plugin.element, "a light", _KINDS, remedy)
        if "sampling_weight" in plugin:
            plugin.number("sampling_weight", 1.0)
        name = plugin.id or f"{plugin.kind}-{len(self.lights)}"
        match plugin.kind:
            case "point":
                self.lights.append(Light(name, "point", _intensity(plugin), position=_position(plugin)))
            case "spot":
                self.lights.append(self._spot(plugin, name))
            case "directional":
                direction = plugin.transform("to_world")[:3, 2]
                if "direction" in plugin:
                    direction = plugin.vector("direction")
                direction = unit(direction, plugin.where("direction"), '<vector name="direction" z="-1"/>')
                irradiance = plugin.colour("irradiance", 1.0, light=True)
                self.lights.append(Light(name, "directional", irradiance, direction=direction))
            case _:
                if self.sky is not None:
                    raise plugin.location.error(
                        "shines from all around, as another emitter does.", "Leave one out."
                    )
                self.sky = _SKIES[plugin.kind](plugin)
                if plugin.kind == "sunsky" and _is_dark(self.sky):
                    self.notes["a sunsky is dark, because its sun is below the horizon or its scales are 0"] = None
                elif plugin.kind == "sunsky":
                    self.notes[
                        "a sunsky has the light of Mitsuba's on the ground, but Perez' pattern of the sky"
                    ] = None
        plugin.check_all_read()

    def _spot(self, plugin: Plugin, name: str) -> Light:
        end = plugin.number("cutoff_angle", 20.0, 1e-3, 180.0)
        full = plugin.number("beam_width", 0.75 * end, 0.0, end)
        if plugin.texture("texture") is not None:
            raise plugin.location.error("projects a picture, which is not read.", "Leave the texture out.")
        if full < _SHARP * end:
            self.notes["between its cones a spot fades by the square of the cosine, not with the angle"] = None
        world = plugin.transform("to_world")
        axis = world[:3, 2] / np.linalg.norm(world[:3, 2])
        return Light(name, "spot", _intensity(plugin), position=world[:3, 3], direction=axis, cone=(full, end))


def _is_dark(sky: Sky | Environment) -> bool:
    return isinstance(sky, Environment) and sky.sun is None and not sky.image.any()


def _intensity(plugin: Plugin) -> Float64:
    return plugin.colour("intensity", 1.0, light=True)


def _position(plugin: Plugin) -> Float64:
    if "position" in plugin:
        return plugin.vector("position")
    return plugin.transform("to_world")[:3, 3]


def _constant(plugin: Plugin) -> Sky:
    radiance = plugin.colour("radiance", 1.0, light=True)
    return Sky(radiance, radiance)


def _environment(plugin: Plugin) -> Environment:
    """Return an environment map. Mitsuba's frame has y up and the image centre towards +z."""
    where = plugin.where("filename")
    path = plugin.element.file(plugin.text("filename"))
    scale, world = plugin.number("scale", 1.0, 0.0), plugin.transform("to_world")
    # Mitsuba takes the data window of an EXR for the whole map.
    read = partial(read_environment, display=False)
    stored = stored_picture(path, "an environment map", MAPS, MAX_ENVIRONMENT_PIXELS, where, read)
    plugin.flag("mis_compensation", False)  # only affects sampling, not the radiance
    image = np.maximum(stored, 0.0, out=stored)
    map_from_world = plugin.inverse_transform("to_world")[:3, :3]
    if not np.allclose(map_from_world @ map_from_world.T, np.eye(3), atol=1e-5):
        return Environment(_stretched(image, map_from_world), scale=scale)
    image = _in_middles(image)
    if mirrors(world):
        image = image[:, ::-1]
    up, middle = (world[:3, axis] / np.linalg.norm(world[:3, axis]) for axis in (1, 2))
    front, left, _ = Environment(image[:1, :1], up).frame
    return Environment(image, up, float(np.degrees(np.arctan2(middle @ left, middle @ front))), scale)


_SKIES: dict[str, Callable[[Plugin], Sky | Environment]] = {
    "constant": _constant,
    "envmap": _environment,
    "sunsky": sun_and_sky,
}


def _in_middles(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an environment map resampled to rows at the centres of equal steps of the polar angle.

    In Mitsuba, the first row is exactly up and the last row exactly down. `glpath export` writes maps whose even
    rows are means of their neighbours, so such a map is read back unchanged. A small map gets enough rows that
    interpolation hardly changes it. A row of a large map is off by at most half a step, which is accepted.
    """
    height = image.shape[0]
    if height < 2 or height >= _SMALL:
        return image
    if height % 2 and np.allclose(image[2:-1:2], 0.5 * (image[1:-2:2] + image[3::2]), rtol=1e-3, atol=1e-6):
        return image[1::2]
    rows = height * (2 * _SMALL // height)
    at = (np.arange(rows) + 0.5) / rows * (height - 1)
    above = np.minimum(at.astype(np.intp), height - 2)
    below_share = (at - above)[:, None, None].astype(np.float32)
    return np.asarray(image[above] * (1 - below_share) + image[above + 1] * below_share)


def _stretched(image: NDArray[np.float32], map_from_world: Float64) -> NDArray[np.float32]:
    """Return the environment map as Mitsuba shows it if its transform (3, 3) is no rotation, in a frame with y up.

    Mitsuba transforms a direction to the map's frame, and takes the arc cosine of its y without normalising it.
    """
    height = image.shape[0]
    rows = max(height, min(2 * height, 2048), 512)
    angles = np.pi * (np.arange(rows) + 0.5) / rows
    parts = np.array_split(angles, rows // _ROWS_AT_ONCE)
    return np.concatenate([_stretched_rows(image, map_from_world, part[:, None], rows) for part in parts])


def _stretched_rows(
    image: NDArray[np.float32], map_from_world: Float64, theta: Float64, rows: int
) -> NDArray[np.float32]:
    """Return some rows of the result of `_stretched`.

    theta : (n, 1) polar angles of the rows, from up
    rows : number of rows of the whole result
    """
    height, width = image.shape[:2]
    phi = np.pi * (np.arange(2 * rows) + 0.5) / rows
    parts = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
    x, y, z = np.tensordot(map_from_world, np.stack(parts), axes=1)
    column = np.arctan2(x, -z) / (2 * np.pi) % 1.0 * width - 0.5
    row = np.arccos(np.clip(y, -1.0, 1.0)) / np.pi * (height - 1)
    left, above = np.floor(column).astype(np.intp), np.clip(row.astype(np.intp), 0, max(height - 2, 0))
    right_share, below_share = (each[..., None].astype(np.float32) for each in (column - left, row - above))
    upper, lower = (
        image[each, left % width] * (1 - right_share) + image[each, (left + 1) % width] * right_share
        for each in (above, np.minimum(above + 1, height - 1))
    )
    return np.asarray(upper * (1 - below_share) + lower * below_share)
