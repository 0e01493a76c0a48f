"""Hills: a B-spline surface displaced along its normals, with any number of triangles."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from glpath.io.load import scene_from_dict
from glpath.scene.model import Float64, Scene
from glpath.scene.patches import PatchChunks, Patches, diced

# Number of control points along a side of the net.
_NET = 19
# Half the approximate length of a side of the surface, scene units; the net is 15 % larger.
_HALF = 8.0
_DISPLACED = 1.1


def rocks(uv: Float64) -> Float64:
    """Return (N,) heights, 0 to about 1, at texture coordinates (N, 2).

    The heights are sharp ridges in five octaves [Musgrave 1994]. The higher an octave is at a point, the stronger
    the next octave is there, so valleys are smooth.
    """
    u, v = uv.T
    height, strength, weight, frequency = np.zeros(len(uv)), np.ones(len(uv)), 0.6, 4.0
    for octave in range(5):
        a, b = np.cos(1.9 * octave), np.sin(1.9 * octave)
        x, y = frequency * (a * u - b * v) + 0.37 * octave, frequency * (b * u + a * v)
        waves = np.sin(2 * np.pi * x + 1.3 * np.sin(2 * np.pi * 0.63 * y)) + np.sin(2 * np.pi * y + np.sin(4.1 * x))
        ridge = (1.0 - np.abs(0.5 * waves)) ** 2
        height += weight * strength * ridge
        strength, weight, frequency = np.clip(1.4 * ridge * strength, 0, 1), 0.5 * weight, 2.05 * frequency
    return height


def terrain(
    *,
    level: Annotated[
        int,
        Meta(
            ge=1,
            le=256,
            description="a whole number from 1 to 256, the segments along each edge of a patch; of these there are "
            "256, each with 2 level² triangles",
        ),
    ] = 12,
    streamed: Annotated[
        bool, Meta(description="true or false: triangles are made when they are needed, for scans")
    ] = False,
) -> Scene:
    """Hills under a sky with a sun, a displaced B-spline surface; streamed, of any number of triangles."""
    at = np.linspace(-1.15, 1.15, _NET) * _HALF
    x, z = np.meshgrid(at, -at, indexing="ij")
    y = 0.9 * np.sin(0.55 * x + 0.6) * np.cos(0.5 * z) + 0.3 * np.cos(1.3 * x - 0.9 * z)
    patches = Patches.bspline(np.stack([x, y, z], axis=-1))
    levels = patches.levels(level)
    ground: dict[str, Any] = {"name": "ground", "material": "ground"}
    if streamed:
        ground |= {"type": "stream", "stream": PatchChunks(patches, levels, _heights)}
    else:
        ground |= {"type": "mesh", "mesh": diced(patches, levels, _heights)}
    return scene_from_dict(
        {
            "camera": {"position": [0.5, 3.4, 9.5], "target": [0, 0.2, 0], "fov": 42},
            "film": {"resolution": [640, 360]},
            "materials": {"ground": {"reflectance": [0.42, 0.4, 0.3]}},
            "sky": {"zenith": [0.18, 0.3, 0.6], "horizon": [0.6, 0.65, 0.7]},
            "lights": [{"type": "directional", "direction": [-1, -0.5, -0.35], "irradiance": [4, 3.5, 2.7]}],
            "shapes": [ground],
        },
        source="terrain",
    )


def _heights(uv: Float64) -> Float64:
    return _DISPLACED * rocks(uv)
