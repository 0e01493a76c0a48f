"""Materials of Phong's time as surfaces of microfacets.

A highlight of exponent n is as wide as one of GGX's with alpha = sqrt(2 / (n + 2)) [Walter et al. 2007]. The
specular colour scales the reflection of a dielectric: 0.5 is that of index 1.5, as Blender writes and reads it, so
that plastic is no mirror; where nothing is reflected diffusely it is the colour of a metal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from glpath.scene.model import Float64

#: Reflectance of glass of index 1.5 at normal incidence, which `Material.specular_colour` multiplies.
F0 = 0.04


def roughness_of(exponent: float) -> float:
    """`Material.roughness`, the square root of alpha, of a highlight of Phong's."""
    return float((2.0 / (max(exponent, 0.0) + 2.0)) ** 0.25)


def layers(diffuse: Float64, textured: bool, specular: Float64, exponent: float) -> dict[str, Any]:
    """Fields of a `Material`: `reflectance`, and the gloss where there is one.

    diffuse, specular : (3,) in [0, 1], linear Rec. 709
    textured          : the diffuse colour is a texture's as well
    """
    if not specular.any():
        return {"reflectance": diffuse}
    roughness = roughness_of(exponent)
    if not (diffuse.any() or textured):
        return {"reflectance": specular, "metallic": 1.0, "roughness": roughness}
    return {"reflectance": diffuse, "specular_colour": 2.0 * specular, "roughness": roughness}


def mirroring(fields: dict[str, Any], specular: Float64) -> dict[str, Any]:
    """The same where the specular colour is what a mirror sends back, as ray tracers have it."""
    return {**fields, "specular_colour": specular / F0} if "specular_colour" in fields else fields


def share(values: Any) -> Float64:
    """As reflectances can be."""
    return np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
