"""Conversion of specular-glossiness materials, the older model, to metallic-roughness, texel by texel.

A texel is taken as a mixture of a metal, which has the specular colour, and a dielectric that reflects 4 %. The
metal fraction is chosen so that the mixture has the diffuse and the specular brightness of the texel.

Poor at: dielectrics that reflect more than 4 % (they become part metal), coloured reflections of dielectrics.
Source:  Khronos Group, KHR_materials_pbrSpecularGlossiness, its converter between the two models (2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64
from glpath.system.colour import encode_srgb

#: Reflectance of a dielectric of index 1.5 at normal incidence.
F0 = 0.04
_TINY = 1e-6


def metal_and_roughness(
    diffuse: Float64, specular: Float64, glossiness: Float64
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the images of the metallic-roughness model: base colour and surface.

    The base colour is (h, w, 3 or 4), sRGB. The surface is (h, w, 3), with roughness in green and metal in blue.

    diffuse    : (h, w, 3) or, with alpha, (h, w, 4), linear, in [0, 1]
    specular   : (h, w, 3) reflectance at normal incidence, linear, in [0, 1]
    glossiness : (h, w) in [0, 1]
    """
    left = 1.0 - specular.max(axis=2, keepdims=True)
    under = diffuse[..., :3] * left / (1.0 - F0)
    metal = _metal(_brightness(diffuse[..., :3])[..., None] * left / (1.0 - F0), _brightness(specular)[..., None])
    of_diffuse = under / np.maximum(1.0 - metal, _TINY)
    of_specular = (specular - F0 * (1.0 - metal)) / np.maximum(metal, _TINY)
    colour = np.clip(of_diffuse + (of_specular - of_diffuse) * metal**2, 0.0, 1.0)
    base = np.concatenate([encode_srgb(colour), diffuse[..., 3:]], axis=2)
    surface = np.concatenate([np.ones_like(metal), 1.0 - glossiness[..., None], metal], axis=2)
    return _bytes(base), _bytes(surface)


def _metal(diffuse: Float64, specular: Float64) -> Float64:
    """Return the metal fraction m that solves two equations for m and a base colour c.

    The equations are (1 - m) c = diffuse and m c + (1 - m) F0 = specular.
    """
    b = diffuse + specular - 2.0 * F0
    root = np.sqrt(np.maximum(b**2 - 4.0 * F0 * (F0 - specular), 0.0))
    return np.where(specular < F0, 0.0, np.clip((root - b) / (2.0 * F0), 0.0, 1.0))


def _brightness(colour: Float64) -> Float64:
    """Return the perceived brightness of colours [http://alienryderflex.com/hsp.html]."""
    return np.asarray(np.sqrt(colour**2 @ [0.299, 0.587, 0.114]))


def _bytes(values: Float64) -> NDArray[np.uint8]:
    return np.asarray(np.round(255.0 * np.clip(values, 0.0, 1.0)), np.uint8)
