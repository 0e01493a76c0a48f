"""Emission of a scene's own surfaces, for comparison with its surroundings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from glpath.system.colour import luminance

if TYPE_CHECKING:
    from glpath.scene.model import Scene, Shape


def emitted_radiance(scene: Scene, counts: Callable[[Shape], bool] = lambda shape: True) -> float:
    """Return the radiance in W m^-2 sr^-1 of a white diffuse box around the scene that receives all emitted light.

    It is the shapes' emitted power, divided by pi and by the box's area. Only shapes for which `counts` is true are
    included. The result is infinite if one of these emits and has no triangles. Emission textures are represented
    by their mean.
    """
    lower, upper = scene.bounds
    x, y, z = upper - lower
    power = 0.0  # power divided by pi
    for number, shape in enumerate(scene.shapes):
        if not shape.emits or not counts(shape):
            continue
        if shape.primitive != "triangle":
            return math.inf
        emission, slot = shape.emission, scene.materials[shape.material].emission_texture
        if slot is not None:
            emission = emission * scene.textures[slot.texture].mean
        sides = 2 if shape.emission_two_sided else 1
        power += sides * float(luminance(emission)) * float(scene.areas[scene.shapes.ranges[number]].sum())
    return power / (2 * float(x * y + y * z + z * x)) if power else 0.0
