"""Maintenance factors: fraction of a lamp's light that remains after years, as used in lighting design.

A factor multiplies the light of lamps, not of skies: lamps age and fail, and dust settles on them and on the room's
walls. CIE 97 and EN 12464-1 define it as a product of factors for each cause. Its American name is light loss
factor.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from glpath.errors import UsageError, argument
from glpath.scene.geometry import Shape, Shapes
from glpath.scene.model import Light, Scene

_Lamp = TypeVar("_Lamp", Light, Shape)


def with_factor(lamp: _Lamp, factor: float | None) -> _Lamp:
    """Return the lamp with its light multiplied by a factor that it records; unchanged if the factor is None."""
    if factor is None:
        return lamp
    if isinstance(lamp, Light):
        return replace(lamp, intensity=lamp.intensity * factor, maintenance_factor=factor)
    return replace(lamp, emission=lamp.emission * factor, maintenance_factor=factor)


def maintained(scene: Scene, factor: float | None) -> Scene:
    """Return the scene with a factor applied to punctual lights and emitting shapes that have none of their own.

    Directional lights represent the sun and do not change. Raises UsageError unless the factor is above 0 and at
    most 1.
    """
    if factor is None:
        return scene
    if not 0 < factor <= 1:
        raise UsageError(
            f"{argument('maintenance_factor', factor)}: must be above 0, up to 1.",
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
    """Return the factors of punctual lights, then of emitting shapes; 1 for lamps without a factor."""
    lamps: list[Light | Shape] = [light for light in scene.lights if light.kind != "directional"]
    lamps += [shape for shape in scene.shapes if shape.emits]
    return [1.0 if lamp.maintenance_factor is None else lamp.maintenance_factor for lamp in lamps]
