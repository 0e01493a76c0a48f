"""A plain background that is as bright as a ground in a scene's light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glpath.film.image import luminance
from glpath.scene.background import Background
from glpath.scene.model import Environment, Scene, Sky

Float64 = NDArray[np.float64]

#: Of a white ground in the scene's light, how bright a plain background is.
PLAIN = 0.8
# Directions of a half sphere, to sum the light of a sky.
_ROWS, _COLUMNS = 64, 128


def with_plain_background(scene: Scene, ground: Float64 | None = None) -> Scene:
    """The scene before a grey, as bright as a ground of reflectance `PLAIN` in the light of its sky.

    Pictures then have the exposure that shows it so, where the scene asks for none.

    ground : (3,) a point of the ground that catches the shadow, see `Background`
    """
    white = _radiance_of_white_ground(scene.sky)
    exposure = scene.exposure
    if exposure is None and scene.sky is not None and white > 0:
        exposure = float(np.round(-4.0 * np.log2(white)) / 4.0) + 0.0
    up = np.array([0.0, 1.0, 0.0]) if scene.sky is None else scene.sky.up / np.linalg.norm(scene.sky.up)
    grey = np.full(3, PLAIN * (white if white > 0 else 1.0))
    return replace(scene, background=Background(grey, ground=ground, up=up), exposure=exposure)


def _radiance_of_white_ground(sky: Sky | Environment | None) -> float:
    """Luminance of a white, diffuse ground that only the sky lights."""
    if sky is None:
        return 0.0
    # Strata of equal cosine: of sin² of the polar angle.
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
    # A stratum would hardly ever meet the sun.
    of_map = replace(sky, sun=None).radiance(directions).mean(axis=(0, 1))
    return float(luminance(of_map + sun.irradiance * max(float(sun.direction @ up), 0.0) / np.pi))
