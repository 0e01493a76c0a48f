"""Uniforms of light samples and of the sky, for `shaders/lights/direct.glsl`, `path_direct.glsl` and `sky.glsl`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.gl.variants import defined
from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS, LightSample, LightSamples
from glpath.scene.model import Environment, Scene, Sky

Uniforms = dict[str, object]


def sample_uniforms(light: LightSample) -> Uniforms:
    """Return the uniforms of a path set's light sample, except its frame, which the shadow-buffer's include."""
    return {
        "light_kind": LIGHT_KINDS.index(light.kind),
        "light_radiance": tuple(light.radiance),
        "light_pdf": light.density,
        "light_cone": light.cone,
        "light_quadratic": light.quadratic,
        "light_profile": light.profile - 1,
    }


def sky_uniforms(sky: Sky | Environment | None, lighting: Lighting | None = None) -> Uniforms:
    """Return uniforms of the sky, black if `sky` is None; with `lighting`, also the sky's sampling density."""
    uniforms: Uniforms
    if isinstance(sky, Environment):
        middle, _, up = sky.frame
        uniforms = {"sky_size": sky.image.shape[1::-1], "sky_middle": tuple(middle), "sky_up": tuple(up)}
        uniforms["sky_rows_above"] = sky.rows_above
        if sky.sun is not None:
            uniforms |= {
                "sun_direction": tuple(sky.sun.direction),
                "sun_square_chord": sky.sun.square_chord,
                "sun_radiance": tuple(sky.sun.radiance_of_disc),
            }
    else:
        dark = np.zeros(3)
        uniforms = {
            "sky_zenith": tuple(sky.zenith if sky else dark),
            "sky_horizon": tuple(sky.horizon if sky else dark),
            "sky_up": tuple(sky.up if sky else dark),
        }
    return uniforms if lighting is None else uniforms | {"sky_pdf_scale": lighting.sky_pdf_scale}


def background_uniforms(scene: Scene) -> Uniforms:
    """Return uniforms of `shaders/lights/background.glsl`; none if the sky is the visible background."""
    return {} if scene.background is None else {"background": tuple(scene.background.radiance)}


def light_defines(sky: Sky | Environment | None, lighting: Lighting) -> dict[str, object]:
    """Return the defines of `shaders/lights/light_sample.glsl`: the kinds of light in the scene."""
    return defined(
        HAS_POSITIONAL_LIGHTS=lighting.positional, HAS_DISTANT_LIGHTS=lighting.infinite, HAS_SKY=sky is not None
    )


#: Number of rows of a light sample in `light_table`.
LIGHT_ROWS = 4


def light_rows(lights: LightSamples, share: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return light samples as (N, LIGHT_ROWS, 4) float32 rows of `light_table` in `shaders/path/path_direct.glsl`.

    share : (N,) fraction of all lights, by probability, that each sample represents
    """
    rows = np.zeros((len(lights), LIGHT_ROWS, 4), np.float32)
    rows[:, 0, :3], rows[:, 0, 3] = lights.position, lights.kind
    rows[:, 1, :3], rows[:, 1, 3] = lights.direction, lights.density
    rows[:, 2, :3], rows[:, 2, 3] = lights.radiance, lights.quadratic
    rows[:, 3, :2] = lights.cone
    rows[:, 3, 2], rows[:, 3, 3] = share, lights.profile - 1
    return rows
