"""Phong materials as microfacet surfaces.

A Phong highlight of exponent n is as wide as a GGX highlight with alpha = sqrt(2 / (n + 2)) [Walter et al. 2007].
The specular colour scales the reflection of a dielectric. As in Blender, 0.5 means an index of 1.5, so that plastic
is no mirror. If nothing is reflected diffusely, a specular colour that no dielectric has is the colour of a metal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from glpath.scene.model import Float64

#: Reflectance of glass of index 1.5 at normal incidence, which `Material.specular_colour` multiplies.
F0 = 0.04
# Maximum specular colour, and maximum spread of its channels relative to that, of a dielectric without a diffuse
# base. Greys of 8 bits are a little above 0.5.
_MAX_DIELECTRIC, _MAX_SPREAD = 0.55, 0.1


def roughness_of(exponent: float) -> float:
    """Return `Material.roughness`, the square root of alpha, for the exponent of a Phong highlight."""
    return float((2.0 / (max(exponent, 0.0) + 2.0)) ** 0.25)


def layers(
    diffuse: Float64, textured: bool, specular: Float64, exponent: float, *, mirror: bool = False
) -> dict[str, Any]:
    """Return fields of a `Material`: `reflectance`, and gloss if the specular colour is not 0.

    diffuse, specular : (3,) in [0, 1], linear Rec. 709
    textured          : True if a texture also gives diffuse colours
    mirror            : True if, as in ray tracers, `specular` is the reflectance at normal incidence
    """
    if not specular.any():
        return {"reflectance": diffuse}
    roughness = roughness_of(exponent)
    is_metal = mirror or specular.max() > _MAX_DIELECTRIC or np.ptp(specular) > _MAX_SPREAD * specular.max()
    if is_metal and not (diffuse.any() or textured):
        return {"reflectance": specular, "metallic": 1.0, "roughness": roughness}
    scaled = specular / F0 if mirror else 2.0 * specular
    return {"reflectance": diffuse, "specular_colour": scaled, "roughness": roughness}


def share(values: Any) -> Float64:
    """Return values as reflectances: clamped to [0, 1], and 0 for NaN."""
    return np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
