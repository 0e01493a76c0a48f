"""Light samples and the sky as the uniforms of `shaders/direct.glsl`, `path_rays.frag` and `sky.glsl`."""

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


def light_defines(sky: Sky | None, lighting: Lighting) -> dict[str, object]:
    """What `shaders/light_sample.glsl` asks for: which kinds of light there are."""
    has = {
        "HAS_POSITIONAL_LIGHTS": lighting.positional,
        "HAS_DISTANT_LIGHTS": lighting.infinite,
        "HAS_SKY": sky is not None,
    }
    return {name: 1 for name, there in has.items() if there}


#: Of a light sample in `light_table`.
LIGHT_ROWS = 4


def light_rows(light: LightSample) -> list[tuple[float, ...]]:
    """A light sample as rows of vec4 for `light_table` in `shaders/path_rays.frag`."""
    return [
        (*map(float, light.position), float(LIGHT_KINDS.index(light.kind))),
        (*map(float, light.direction), light.density),
        (*map(float, light.radiance), float(light.quadratic)),
        (*light.cone, 0.0, 0.0),
    ]
