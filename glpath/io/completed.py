"""Add a default camera to a scene without a camera, and studio light to a scene without light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import replace
from typing import Literal

import numpy as np

from glpath.errors import warn
from glpath.io.plain_background import with_plain_background
from glpath.io.up_axis import Up, axis_vector, evidence_for_z
from glpath.scene.camera import framing, upright_from_world
from glpath.scene.emitted import emitted_radiance
from glpath.scene.model import Camera, Float64, Scene, Shape, Sky
from glpath.scene.sight import enclosing_spheres, winding_number
from glpath.scene.source_location import shown
from glpath.sky.studio import ground_below, nearest_axis, studio

#: Default image width and height in pixels.
RESOLUTION = (512, 512)
#: Placeholder camera while a scene without a camera is built.
NO_CAMERA = Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0, RESOLUTION)
# Minimum mean radiance that a model's lamps cause on its bounding box. Below it they do not count as light, and a
# studio is added. White in a studio has radiance 1.
_LAMP = 0.01
# Height of the eye of a camera in a room, as a fraction of the room's height.
_EYE = 0.6
# Height of the target of a camera in a room, as a fraction of the room's height.
_TARGET = 0.45
# Horizontal offset of the eye from the middle of the room along each axis, as a fraction of the half extent.
_FROM_MIDDLE = 0.85
# Field of view of a camera in a room, degrees.
_FOV = 70.0
# Minimum fraction of directions from the eye in which a room has a wall. Below it the scene is no room.
_CLOSED = 0.9
# Scenes with more triangles are not tested for being a room.
_MAX_ROOM_TRIANGLES = 2**21
# Maximum radiance of a surface that glows but does not count as a lamp. White in the studio has this radiance.
_FAINT = 1.0
#: Parts of a scene that a caller can declare unneeded, see `aside`.
Part = Literal["camera", "view", "light", "picture", "sky"]
#: Parts that the surrounding `aside` contexts declare unneeded.
_ASIDE: ContextVar[frozenset[str]] = ContextVar("aside", default=frozenset())


@contextmanager
def aside(*parts: Part) -> Iterator[None]:
    """Context for loading scenes for a caller that does not need these parts.

    "camera"  : no warning of an added camera
    "view"    : no warning of an added camera either, because the caller replaces its pose
    "light"   : no warning of added light
    "picture" : missing light is replaced by a white sky instead of a studio
    "sky"     : the caller replaces the sky by an environment map
    """
    before = _ASIDE.set(_ASIDE.get() | set(parts))
    try:
        yield
    finally:
        _ASIDE.reset(before)


def is_aside(part: Part) -> bool:
    """Return True inside an `aside` context of this part."""
    return part in _ASIDE.get()


def uniform_sky(*, assumed: bool = False) -> Sky:
    """Return a white sky of radiance 1 in all directions."""
    return Sky(np.ones(3), np.ones(3), assumed=assumed)


def camera_replaced(camera: object) -> AbstractContextManager[None]:
    """Return the context for loading a scene whose camera the caller replaces by `camera`.

    camera : replacement for the whole camera, or a dictionary of some of its fields; None keeps the camera or field
    """
    replaced = (
        camera is not None if not isinstance(camera, Mapping) else any(v is not None for v in camera.values())
    )
    return aside("view") if replaced else nullcontext()


def completed(
    scene: Scene,
    *,
    has_camera: bool,
    glow_is_light: bool = True,
    up: Up | Float64 = "y",
    up_remedy: str = "-D up=y",
    lying: bool = False,
) -> Scene:
    """Return the scene with a camera and light. A SceneWarning names each added part, unless it is `aside`.

    has_camera    : False adds a camera inside a room, or else one that frames everything; the resolution is that of
                    the scene's camera
    up            : up axis of an added camera: (3,) vector, name, or "guess"; see `glpath.io.up_axis`
    up_remedy     : what the caller writes if y is up although the guess is z
    lying         : True if flat objects lie rather than stand, see `evidence_for_z`
    glow_is_light : False if a faint glow only decorates the model and does not light the scene, see `_glows`
    """
    notes, evidence, inside = [], None, None
    if not has_camera:
        if isinstance(up, str) and up == "guess":
            evidence = evidence_for_z(scene, lying)
            up = "z" if evidence else "y"
        axis = axis_vector(up) if isinstance(up, str) else up
        inside = _camera_inside(scene, axis)
        camera = inside or framing(scene.framed_points, scene.camera.resolution, axis)
        scene = replace(scene, camera=replace(camera, shutter=scene.camera.shutter))
    if not has_camera and not is_aside("camera") and not is_aside("view"):
        c = scene.camera
        guess = f" with z up (a guess, as {evidence}; {up_remedy} if y is up)" if evidence else ""
        where = "that shows everything" if inside is None else "inside, as its walls face inwards"
        notes.append(
            f"no camera, so one was set {where}{guess}: position {shown(c.position.round(3))}, target "
            f"{shown(c.target.round(3))}, fov {c.fov:g}, for {c.resolution[0]} x {c.resolution[1]} pixels"
        )
    emitters = [shape for shape in scene.shapes if shape.emits]
    is_lit = bool(scene.lights or scene.sky or np.any(scene.ambient > 0))
    is_lit = is_lit or (bool(emitters) if glow_is_light else _lamps_light(scene))
    # A scene whose materials are all unlit is visible without light, so it gets only the background of a studio. A
    # scene with its own camera gets no background, because that camera already shows the baked surroundings.
    needs_light = not emitters or any(not scene.materials[shape.material].unlit for shape in scene.shapes)
    in_studio = not is_aside("picture")
    if not is_lit and not needs_light and not has_camera and in_studio:
        scene = _in_studio(scene)
    elif not is_lit and needs_light:
        scene = _in_studio(scene) if in_studio else replace(scene, sky=uniform_sky(assumed=True))
        what = f"no light but what glows faintly{_remedy(scene, emitters)}" if emitters else "no light"
        if not is_aside("light"):
            stands_in = "a studio lights it" if in_studio else "a white sky shines from all around"
            notes.append(f"{what}, so {stands_in}")
    if notes:
        warn(f"{scene.source or scene.name}: has {', and '.join(notes)}.")
    return scene


def _camera_inside(scene: Scene, up: Float64) -> Camera | None:
    """Return a camera that looks across a room from one corner; None if the scene is not a room.

    In a room, at least 90 % of all directions from the eye meet a wall that faces inwards. Rooms with thick walls
    are not found, because the outer faces of a wall cancel the inner ones in the winding number.
    """
    if scene.shapes.total("triangle") > _MAX_ROOM_TRIANGLES or scene.shapes.streams:
        return None
    upright = upright_from_world(up)
    points = scene.framed_points @ upright.T
    lower, upper = points.min(axis=0), points.max(axis=0)
    height = lower[1] + _EYE * (upper - lower)[1]
    middle = 0.5 * (lower + upper)
    for corner in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        eye = middle + 0.5 * _FROM_MIDDLE * np.array([corner[0], 0.0, corner[1]]) * (upper - lower)
        eye[1] = height
        at = eye @ upright
        around = float(enclosing_spheres(scene, at)[scene.shapes.primitive_shape("sphere")].sum())
        if around + winding_number(scene.triangles, at) <= -_CLOSED:
            target = np.array([middle[0], lower[1] + _TARGET * (upper - lower)[1], middle[2]])
            return replace(scene.camera, position=at, target=target @ upright, up=up, fov=_FOV)
    return None


def _in_studio(scene: Scene) -> Scene:
    """Return the scene in `studio` light, with a plain background and a ground at its lowest point.

    The up axis is the coordinate axis nearest to the camera's up vector.
    """
    axis = nearest_axis(scene.camera.up)
    ground = ground_below(*scene.bounds, axis)
    return with_plain_background(replace(scene, sky=studio((axis[0], axis[1], axis[2]))), ground)


def _lamps_light(scene: Scene) -> bool:
    """Return True if lamps light the scene, that is, if their `emitted_radiance` is above `_LAMP`.

    A filament or a row of diodes alone is too weak, because the image would be black.
    """
    return emitted_radiance(scene, lambda s: s.primitive == "triangle" and not _glows(scene, s)) > _LAMP


def _remedy(scene: Scene, emitters: Sequence[Shape]) -> str:
    """Return a hint in brackets that explains when a glow counts as light; empty if all emitters are unlit."""
    lit = [shape for shape in emitters if not scene.materials[shape.material].unlit]
    if not lit:
        return ""
    max_emission = max(float(shape.emission.max()) for shape in lit)
    how = "in glTF by KHR_materials_emissive_strength, in MTL by Ke"
    if max_emission <= _FAINT:
        return f" (emission {max_emission:.3g} at most; a lamp has more than {_FAINT:g}, {how})"
    return f" (on a box around all the radiance is below {_LAMP:g} in the mean; a lamp sends more, {how})"


def _glows(scene: Scene, shape: Shape) -> bool:
    """Return True if the shape is unlit, or emits no more light than white reflects in a studio.

    Many models have glowing screens and small lamps, but are meant to be lit by their surroundings, because in
    model viewers a glow lights nothing. A shape that is meant to light a scene emits more.
    """
    return scene.materials[shape.material].unlit or bool(np.all(shape.emission <= _FAINT))
