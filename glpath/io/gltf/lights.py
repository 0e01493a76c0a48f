"""Punctual lights and cameras of nodes. Cameras look, and lights shine, along -z of their node.

Intensities stay in candela and lux, because glTF models are photometric, including their emitting surfaces.

Source: KHR_lights_punctual; EXT_lights_ies; glTF 2.0, 3.10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from glpath.io.gltf import profiles
from glpath.io.gltf.document import Document
from glpath.io.gltf.table import Table
from glpath.io.transform import mirrors
from glpath.io.values import LARGEST
from glpath.scene.camera import CameraKey
from glpath.scene.choices import Projection
from glpath.scene.model import Float64, Light, LightKind

_KINDS: dict[str, LightKind] = {"point": "point", "spot": "spot", "directional": "directional"}
_PROJECTIONS = {"perspective": True, "orthographic": False}
_SCALED_LIGHTS = "Lights of nodes that are scaled to nothing, except point lights: they have no direction."


@dataclass(frozen=True)
class ModelCamera:
    """Camera of a model, without a resolution.

    position, target, up : (3,) float64, scene units; the target is 1 unit from the position
    fov                  : vertical field of view of a perspective camera, degrees
    aspect               : width divided by height of the intended image; None if the file gives no aspect ratio
    projection, height, motion : fields of `glpath.scene.Camera`
    """

    name: str
    position: Float64
    target: Float64
    up: Float64
    fov: float
    aspect: float | None = None
    projection: Projection = "perspective"
    height: float = 1.0
    motion: tuple[CameraKey, ...] = ()

    def through(self, times: Float64, others: Sequence[ModelCamera]) -> ModelCamera:
        """Return the camera with keyframes at times (K,) in seconds; the same camera if all poses are equal.

        others : the camera at each of these times
        """
        first = others[0]
        if all(np.array_equal(first.position, c.position) and _looks_alike(first, c) for c in others):
            return self
        keys = zip(times, others, strict=True)
        return replace(self, motion=tuple(CameraKey(float(t), c.position, c.target, c.up) for t, c in keys))


def _looks_alike(a: ModelCamera, b: ModelCamera) -> bool:
    return np.array_equal(a.target, b.target) and np.array_equal(a.up, b.up)


def light_of(
    document: Document, node: Table, world: Float64, factor: float, webs: profiles.Profiles
) -> Light | None:
    """Return the light of a node; None if it has no light, or, with a note, if it lacks the direction it needs."""
    extension = node.extension("KHR_lights_punctual")
    profiled = node.extension(profiles.NAME)
    if profiled is not None:
        if extension is not None:
            document.notes.add(
                "KHR_lights_punctual of nodes with EXT_lights_ies: they are one lamp, which is the latter's."
            )
        return _profiled(document, node, profiled, world, factor, webs)
    if extension is None:
        return None
    every = (document.root.extension("KHR_lights_punctual") or Table({}, document.location)).tables("lights")
    table = every[extension.required_index("light", every, "lights")]
    kind = table.required_choice("type", _KINDS)
    name = node.name(table.name(f"light-{node.location.path.rpartition('[')[2].rstrip(']')}"))
    colour = table.numbers("color", (1, 1, 1), 0.0)
    intensity = factor * table.number("intensity", 1.0, 0.0) * colour
    position = world[:3, 3]
    if "range" in table:
        document.notes.add("The range of lights: light falls off with the square of the distance, without end.")
    if kind == "point":
        return Light(name, kind, intensity, position)
    direction = _along(world, 2)
    if direction is None:
        document.notes.add(_SCALED_LIGHTS)
        return None
    if kind == "directional":
        return Light(name, kind, intensity, direction=direction)
    cone = table.table("spot")
    inner, outer = (
        cone.number("innerConeAngle", 0.0, 0.0, np.pi),
        cone.number("outerConeAngle", np.pi / 4, 0.0, np.pi),
    )
    if not (inner <= outer and outer > 0):
        raise cone.location.error(
            f"has an innerConeAngle of {inner:g} and an outerConeAngle of {outer:g}, but the inner is at most the "
            "outer, which is above 0.",
            "Angles are in radians, from the axis.",
        )
    return Light(name, kind, intensity, position, direction, (float(np.degrees(inner)), float(np.degrees(outer))))


def _profiled(
    document: Document, node: Table, extension: Table, world: Float64, factor: float, webs: profiles.Profiles
) -> Light | None:
    direction, along_x = _along(world, 2), _along(world, 0)
    c0 = np.zeros(3)
    if direction is not None and along_x is not None:
        # Perpendicular to `direction` even if the node is sheared.
        c0 = (along_x @ direction) * direction - along_x
    if direction is None or not np.linalg.norm(c0) > 1e-9:
        document.notes.add(_SCALED_LIGHTS)
        return None
    number = node.location.path.rpartition("[")[2].rstrip("]")
    profile = webs.of(extension)
    return Light(
        node.name(f"light-{number}"),
        "point",
        factor * extension.number("multiplier", 1.0, 0.0) * extension.numbers("color", (1, 1, 1), 0.0),
        world[:3, 3],
        direction,
        profile=profile.mirrored if mirrors(world) else profile,
        c0=c0 / np.linalg.norm(c0),
    )


def camera_of(document: Document, node: Table, world: Float64) -> ModelCamera | None:
    """Return the camera of a node; None if it has no camera, or, with a note, if it has no direction."""
    cameras = document.all("cameras")
    index = node.index("camera", cameras, "cameras")
    if index is None:
        return None
    table = cameras[index]
    name, position = node.name(table.name(f"camera-{index}")), world[:3, 3]
    direction, down = _along(world, 2), _along(world, 1)
    if direction is None or down is None:
        document.notes.add("Cameras of nodes that are scaled to nothing: they have no direction.")
        return None
    if mirrors(world):
        document.notes.add("The mirroring of nodes with cameras: pictures are not mirrored.")
    frame = (position, position + direction, -down)
    if not table.required_choice("type", _PROJECTIONS):
        view = table.table("orthographic")
        x, y = (view.number(key, 0.0, -LARGEST, LARGEST) for key in ("xmag", "ymag"))
        if not (x and y):
            raise view.location.error(f"has an xmag of {x:g} and a ymag of {y:g}, but none may be 0.", "")
        aspect = abs(x / y)
        return ModelCamera(name, *frame, 40.0, aspect, "orthographic", 2.0 * abs(y))
    view = table.table("perspective")
    fov = float(np.degrees(view.number("yfov", 0.0)))
    if not 0 < fov < 180:
        raise view.location.field("yfov").wrong(
            view.values.get("yfov"), "above 0 and below pi", "It is in radians."
        )
    aspect = view.number("aspectRatio", 0.0, 0.0, LARGEST) if "aspectRatio" in view else None
    return ModelCamera(name, *frame, fov, aspect or None)


def _along(world: Float64, axis: int) -> Float64 | None:
    """Return the (3,) unit vector in world space opposite to a node's axis 0, 1 or 2 (x, y, z).

    Returns None if the node scales the axis to 0.
    """
    column = world[:3, axis]
    length = np.linalg.norm(column)
    return np.asarray(-column / length) if length > 0 else None
