"""A light sample and the sky as the uniforms of `shaders/direct.glsl` and `shaders/sky.glsl`."""

from __future__ import annotations

import numpy as np

from glpath.lighting import LIGHT_KINDS, Lighting, LightSample
from glpath.scene.model import Sky

Uniforms = dict[str, object]


def sample_uniforms(light: LightSample) -> Uniforms:
    """The light sample of a path set; its frame is the shadow-buffer's."""
    return {
        "light_kind": LIGHT_KINDS.index(light.kind),
        "light_radiance": tuple(light.radiance),
        "light_density": light.density,
        "light_cone": light.cone,
        "light_quadratic": light.quadratic,
    }


def sky_uniforms(sky: Sky | None, lighting: Lighting | None = None) -> Uniforms:
    """What rays see that hit nothing, black without a sky; with its lighting, how densely it is sampled as well."""
    dark = np.zeros(3)
    uniforms: Uniforms = {
        "sky_zenith": tuple(sky.zenith if sky else dark),
        "sky_horizon": tuple(sky.horizon if sky else dark),
        "sky_up": tuple(sky.up if sky else dark),
    }
    return uniforms if lighting is None else uniforms | {"sky_density_scale": lighting.sky_density_scale}
