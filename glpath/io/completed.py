"""Defaults of a scene without camera or light: a camera that sees everything, and light from all around."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import Literal

import numpy as np

from glpath.errors import warn
from glpath.scene.camera import framing
from glpath.scene.model import Camera, Scene, Shape, Sky
from glpath.scene.source_location import shown

#: Pixels, where nothing says how many.
RESOLUTION = (512, 512)
#: Stands in until a scene has its own.
NO_CAMERA = Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0, RESOLUTION)
#: Unused parts of a scene.
_ASIDE: ContextVar[frozenset[str]] = ContextVar("aside", default=frozenset())


@contextmanager
def aside(*parts: Literal["camera", "light"]) -> Iterator[None]:
    """Scenes that are loaded within need none of these parts: what stands in for them is no reason for a warning.

    Nor is a scene file without a camera one for an error.
    """
    before = _ASIDE.set(_ASIDE.get() | set(parts))
    try:
        yield
    finally:
        _ASIDE.reset(before)


def is_aside(part: Literal["camera", "light"]) -> bool:
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
        scene = replace(scene, camera=framing(*scene.bounds, scene.camera.resolution))
    if not has_camera and not is_aside("camera"):
        c = scene.camera
        notes.append(
            f"no camera, so one was set that sees everything: position {shown(c.position.round(3))}, target "
            f"{shown(c.target.round(3))}, fov {c.fov:g}, for {c.resolution[0]} x {c.resolution[1]} pixels"
        )
    emitters = [shape for shape in scene.shapes if shape.emits]
    lamps = emitters if glow_is_light else [shape for shape in emitters if not _glows(scene, shape)]
    is_lit = bool(scene.lights or scene.sky or np.any(scene.ambient > 0) or lamps)
    # A scene of unlit materials alone is seen without light.
    needs_light = not emitters or any(not scene.materials[shape.material].unlit for shape in scene.shapes)
    if needs_light and not is_lit:
        scene = replace(scene, sky=uniform_sky(assumed=True))
        what = "no light but what glows faintly" if emitters else "no light"
        if not is_aside("light"):
            notes.append(f"{what}, so a white sky shines from all around")
    if notes:
        warn(f"{scene.source or scene.name}: has {', and '.join(notes)}.")
    return scene


def _glows(scene: Scene, shape: Shape) -> bool:
    """It is unlit, or sends at most as much light as a white sky.

    Models that are to be lit by their surroundings have screens and small lamps, which in viewers light nothing.
    What is meant to light a scene sends more.
    """
    return scene.materials[shape.material].unlit or bool(np.all(shape.emission <= 1))
