"""One surface under a sky of radiance one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.io.load import scene_from_dict
from glpath.scene.model import Material, Scene


def plane_under_the_sky(material: Material, cosine: float) -> Scene:
    """A large square, all of the picture, seen at an angle to its normal, under a sky of radiance one."""
    sine = np.sqrt(1.0 - cosine**2)
    scene = scene_from_dict(
        {
            "camera": {"position": [50 * sine, 0, 50 * cosine], "target": [0, 0, 0], "fov": 1.0, "up": [0, 1, 0]},
            "film": {"resolution": [16, 16]},
            "shapes": [{"type": "quad", "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]}],
            "sky": {"zenith": 1.0},
        }
    )
    return replace(scene, materials=(material,))


def furnace(material: Material, resolution: int = 32) -> Scene:
    """A ball under a sky of radiance one."""
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 40},
            "film": {"resolution": [resolution, resolution]},
            "shapes": [{"type": "sphere", "radius": 1.0, "subdivisions": 4}],
            "sky": {"zenith": 1.0},
        }
    )
    return replace(scene, materials=(material,))
