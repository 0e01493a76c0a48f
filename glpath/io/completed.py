"""Defaults of a scene without camera or light: a camera that sees everything, and a studio."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import Literal

import numpy as np

from glpath.errors import warn
from glpath.io.plain_background import with_plain_background
from glpath.scene.camera import framing
from glpath.scene.emitted import emitted_radiance
from glpath.scene.model import Camera, Scene, Shape, Sky
from glpath.scene.source_location import shown
from glpath.scene.studio import studio

#: Pixels, where nothing says how many.
RESOLUTION = (512, 512)
#: Stands in until a scene has its own.
NO_CAMERA = Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0, RESOLUTION)
# In diagonals of a model, how far below it the ground is: more than rounding.
_BELOW = 1e-4
# Mean radiance on a box around a model, beside 1 of the studio.
_LAMP = 0.01
#: Unused parts of a scene.
_ASIDE: ContextVar[frozenset[str]] = ContextVar("aside", default=frozenset())


@contextmanager
def aside(*parts: Literal["camera", "light", "picture"]) -> Iterator[None]:
    """Scenes that are loaded within need none of these parts: what stands in for them is no reason for a warning.

    Nor is a scene file without a camera one for an error. Without a picture a white sky stands in for light.
    """
    before = _ASIDE.set(_ASIDE.get() | set(parts))
    try:
        yield
    finally:
        _ASIDE.reset(before)


def is_aside(part: Literal["camera", "light", "picture"]) -> bool:
    """Within `aside` of this part."""
    return part in _ASIDE.get()


def uniform_sky(*, assumed: bool = False) -> Sky:
    """White, of radiance 1 from all around."""
    return Sky(np.ones(3), np.ones(3), assumed=assumed)


def completed(scene: Scene, *, has_camera: bool, glow_is_light: bool = True) -> Scene:
    """The scene with a camera and with light; a SceneWarning says what had to be added, and was not `aside`.

    has_camera    : False sets one that frames everything, of the resolution of the scene's
    glow_is_light : False takes a faint glow for a part of the look, by which the rest is not to be seen (`_glows`)
    """
    notes = []
    if not has_camera:
        scene = replace(scene, camera=framing(scene.framed_points, scene.camera.resolution))
    if not has_camera and not is_aside("camera"):
        c = scene.camera
        notes.append(
            f"no camera, so one was set that sees everything: position {shown(c.position.round(3))}, target "
            f"{shown(c.target.round(3))}, fov {c.fov:g}, for {c.resolution[0]} x {c.resolution[1]} pixels"
        )
    emitters = [shape for shape in scene.shapes if shape.emits]
    is_lit = bool(scene.lights or scene.sky or np.any(scene.ambient > 0))
    is_lit = is_lit or (bool(emitters) if glow_is_light else _lamps_light(scene))
    # A scene of unlit materials alone is seen without light, but a picture of it has a background as well. A camera
    # of its own stands where the baked surroundings were meant to be seen from, and is left alone.
    needs_light = not emitters or any(not scene.materials[shape.material].unlit for shape in scene.shapes)
    in_studio = not is_aside("picture")
    if not is_lit and not needs_light and not has_camera and in_studio:
        scene = _in_studio(scene, has_camera)
    elif not is_lit and needs_light:
        scene = _in_studio(scene, has_camera) if in_studio else replace(scene, sky=uniform_sky(assumed=True))
        what = "no light but what glows faintly" if emitters else "no light"
        if not is_aside("light"):
            stands_in = "a studio lights it" if in_studio else "a white sky shines from all around"
            notes.append(f"{what}, so {stands_in}")
    if notes:
        warn(f"{scene.source or scene.name}: has {', and '.join(notes)}.")
    return scene


def _in_studio(scene: Scene, has_camera: bool) -> Scene:
    """The scene in `studio`, before a plain background, on a ground at its lowest point.

    Up is the axis nearest to that of a camera of its own, or else y.
    """
    lower, upper = scene.bounds
    of_camera = scene.camera.up if has_camera else NO_CAMERA.up
    axis = int(np.argmax(np.abs(of_camera)))
    up = [0.0, 0.0, 0.0]
    up[axis] = float(np.sign(of_camera[axis]))
    ground = np.zeros(3)
    ground[axis] = (lower if up[axis] > 0 else upper)[axis]
    ground[axis] -= up[axis] * _BELOW * float(np.linalg.norm(upper - lower))
    return with_plain_background(replace(scene, sky=studio((up[0], up[1], up[2]))), ground)


def _lamps_light(scene: Scene) -> bool:
    """Whether what emits sends enough light to see the scene by: `_LAMP` of radiance, in the mean on a box around.

    A filament or a row of diodes does not; what is lit by nothing else would be a black picture.
    """
    return emitted_radiance(scene, lambda s: s.primitive == "triangle" and not _glows(scene, s)) > _LAMP


def _glows(scene: Scene, shape: Shape) -> bool:
    """It is unlit, or sends no more light than white sends on in a studio.

    Models that are to be lit by their surroundings have screens and small lamps, which in viewers light nothing.
    What is meant to light a scene sends more.
    """
    return scene.materials[shape.material].unlit or bool(np.all(shape.emission <= 1))
