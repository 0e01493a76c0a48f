"""View-independent part of materials: diffuse reflection, emission and opacity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.appearance import Appearance, texture_at
from glpath.scene.material import averaged
from glpath.scene.model import Float64, Scene

Int64 = NDArray[np.int64]


def reflected(scene: Scene, triangle: Int64, side: Int64, b: Float64) -> Float64:
    """Return (N, 7) reflectance, emission and opacity of triangle sides (N,) at barycentric coordinates (N, 2).

    The base below microfacets reflects the light that the Fresnel layer transmits, averaged over all directions.
    Mirrors and metal, which have no diffuse reflection, count as diffuse surfaces of the same reflectance.
    """
    look = Appearance(scene)
    opacity = look.opacity(triangle, b)
    over = 1.0 / np.where(opacity > 0, opacity, 1.0)[:, None]
    found = np.concatenate(
        [look.reflectance(triangle, b) * over, look.emission(triangle, b) * over, opacity[:, None]], axis=1
    )
    shape_of = scene.triangle_shape[triangle]
    for number in np.unique(shape_of):
        own = np.flatnonzero(shape_of == number)
        shape = scene.shapes[number]
        material = averaged(scene.materials[shape.material], scene.textures)
        if material.roughness is not None:
            # Below, textures of metallic and transmission are looked up at the points, so their means are not used.
            untextured = scene.materials[shape.material]
            metallic = np.full(len(own), untextured.metallic)
            clear = np.full(len(own), untextured.transmission)
            for share, slot, channel in (
                (metallic, material.surface_texture, 2),
                (clear, material.transmission_texture, 0),
            ):
                if slot is not None:
                    share *= texture_at(scene.textures[slot.texture], look.slot_uv(slot, triangle[own], b[own]))[
                        :, channel
                    ]
            coat = material.clearcoat * (0.04 + 0.96 / 21.0)
            glass = (1 - metallic) * clear
            clear = clear + (1 - clear) * material.diffuse_transmission
            found[own, :3] *= ((1 - coat) * (metallic + material.base_share * (1 - metallic) * (1 - clear)))[
                :, None
            ]
            found[own, 6] *= 1 - glass
        else:
            found[own, :3] += material.mirror
        back = own[side[own] == 1]
        if not material.two_sided:
            found[back, :3] = 0.0
        if not shape.emission_two_sided:
            found[back, 3:6] = 0.0
    return found
