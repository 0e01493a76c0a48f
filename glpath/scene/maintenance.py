"""Maintenance factors: what is left of a lamp's light after years, as lighting is designed for.

A factor multiplies the light of a lamp, and of no sky: lamps age and fail, and dust settles on them and on the
walls of the room. CIE 97 and EN 12464-1 have it as a product of factors for each. Its American name is light loss
factor.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from glpath.errors import UsageError
from glpath.scene.geometry import Shape, Shapes
from glpath.scene.model import Light, Scene

_Lamp = TypeVar("_Lamp", Light, Shape)


def with_factor(lamp: _Lamp, factor: float | None) -> _Lamp:
    """The lamp with its light times a factor, which it remembers; itself for None."""
    if factor is None:
        return lamp
    if isinstance(lamp, Light):
        return replace(lamp, intensity=lamp.intensity * factor, maintenance_factor=factor)
    return replace(lamp, emission=lamp.emission * factor, maintenance_factor=factor)


def maintained(scene: Scene, factor: float | None) -> Scene:
    """The scene with a factor for all lamps that have none of their own: punctual lights and shapes that emit.

    Directional lights are the sun, and stay. Raises UsageError for a factor that is not above 0, up to 1.
    """
    if factor is None:
        return scene
    if not 0 < factor <= 1:
        raise UsageError(
            f"maintenance_factor={factor:g}: must be above 0, up to 1.",
            "0.8, say, where lamps are cleaned every year.",
        )
    lights = tuple(
        light if light.kind == "directional" or light.maintenance_factor else with_factor(light, factor)
        for light in scene.lights
    )
    shapes = Shapes(
        shape if not shape.emits or shape.maintenance_factor else with_factor(shape, factor)
        for shape in scene.shapes
    )
    return replace(scene, lights=lights, shapes=shapes)


def factors_of(scene: Scene) -> list[float]:
    """Those of all lamps, 1 where none was given, in the order of punctual lights, then shapes that emit."""
    lamps: list[Light | Shape] = [light for light in scene.lights if light.kind != "directional"]
    lamps += [shape for shape in scene.shapes if shape.emits]
    return [1.0 if lamp.maintenance_factor is None else lamp.maintenance_factor for lamp in lamps]
