"""Plain background, as bright as a ground of reflectance `PLAIN` in a scene's light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glpath.scene.background import Background
from glpath.scene.model import Environment, Scene, Sky
from glpath.system.colour import luminance

Float64 = NDArray[np.float64]

#: Radiance of a plain background as a fraction of that of a white ground in the scene's light.
PLAIN = 0.8
# Number of polar angles at which a sky's light is sampled, to integrate it over the upper hemisphere.
_ROWS = 64
# Number of azimuths at which a sky's light is sampled.
_COLUMNS = 128


def with_plain_background(scene: Scene, ground: Float64 | None = None) -> Scene:
    """Return the scene with a grey background, as bright as a ground of reflectance `PLAIN` under its sky.

    If the scene sets no exposure, it gets one, in quarter stops, that shows a white ground at about 1.

    ground : (3,) point of the ground that receives the shadow, see `Background`
    """
    white = _radiance_of_white_ground(scene.sky)
    exposure = scene.exposure
    if exposure is None and scene.sky is not None and white > 0:
        exposure = float(np.round(-4.0 * np.log2(white)) / 4.0) + 0.0
    up = np.array([0.0, 1.0, 0.0]) if scene.sky is None else scene.sky.up / np.linalg.norm(scene.sky.up)
    grey = np.full(3, PLAIN * (white if white > 0 else 1.0))
    return replace(scene, background=Background(grey, ground=ground, up=up), exposure=exposure)


def _radiance_of_white_ground(sky: Sky | Environment | None) -> float:
    """Return the luminance of a white, diffuse ground that only the sky lights."""
    if sky is None:
        return 0.0
    # Cosine-weighted directions: sin² of the polar angle is spaced evenly.
    sine2 = (np.arange(_ROWS) + 0.5)[:, None] / _ROWS
    phi = 2 * np.pi * (np.arange(_COLUMNS) + 0.5) / _COLUMNS
    up = sky.up / np.linalg.norm(sky.up)
    across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across /= np.linalg.norm(across)
    level = np.cos(phi)[:, None] * across + np.sin(phi)[:, None] * np.cross(up, across)
    directions = np.sqrt(sine2)[..., None] * level + np.sqrt(1 - sine2)[..., None] * up
    sun = sky.sun if isinstance(sky, Environment) else None
    if sun is None:
        return float(luminance(sky.radiance(directions)).mean())
    assert isinstance(sky, Environment), "it has a sun"
    # The sampled directions nearly always miss the sun, so its irradiance is added separately.
    of_map = replace(sky, sun=None).radiance(directions).mean(axis=(0, 1))
    return float(luminance(of_map + sun.irradiance * max(float(sun.direction @ up), 0.0) / np.pi))
