"""Transmission of glass: thin dielectrics do not bend light, solids refract it; both lose what they reflect.

The solvers treat all surfaces as diffuse, except that light passes through glass and continues behind it. The
fraction depends on the angle of incidence as in `shaders/bsdf/bsdf.glsl`. It follows Fresnel's equations for
solids, slabs and all layerings except glTF's, and Schlick's formula otherwise.

Poor at:  rough transmission, which is treated as clear; coloured slabs, because all channels depend on the angle
          as the clearest channel does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh.lattice import Int64
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.directional_albedo import boundary_reflectance
from glpath.scene.material import Material, averaged
from glpath.scene.model import Float64
from glpath.system.kernels import inner_kernel


class Glass(NamedTuple):
    """Optical properties of the glass triangles of a scene.

    clear : (T, 3) transmittance of one crossing for light that the surface does not reflect; 0 for opaque materials
    layer : (T, 5) reflectance at normal and at grazing incidence, fraction of the surface under this dielectric
            layer, weight of the clearcoat, and cosine-weighted mean reflectance
    fresnel : (T, 2) refractive index for Fresnel's equations, or 0 for Schlick's formula; and a factor that
              multiplies the reflectance
    ior   : (T,) refractive index of solids; 0 for thin materials
    slab  : (T,) refractive index of slabs; 0 for others
    thin  : (T,) bool, True for thin smooth materials, which shadow rays pass through
    attenuation : (T, 3) attenuation inside solids, per scene unit
    """

    clear: Float64
    layer: Float64
    fresnel: Float64
    ior: Float64
    slab: Float64
    thin: NDArray[np.bool_]
    attenuation: Float64

    @classmethod
    def of_scene(cls, scene: Scene) -> Glass:
        materials = [averaged(scene.materials[shape.material], scene.textures) for shape in scene.shapes]
        shape: Int64 = scene.triangle_shape.astype(np.int64)

        def of_shapes(values: list[object], width: int) -> Float64:
            return np.array(values, np.float64).reshape(len(materials), width)[shape]

        return cls(
            Appearance(scene).mean_clear(),
            of_shapes([_layer(m) for m in materials], 5),
            of_shapes([_fresnel(m) for m in materials], 2),
            of_shapes([0.0 if m.thin else m.ior for m in materials], 1)[:, 0],
            of_shapes([m.ior if m.is_slab else 0.0 for m in materials], 1)[:, 0],
            np.array([m.is_thin_dielectric for m in materials], bool)[shape],
            of_shapes([m.attenuation for m in materials], 3),
        )


def _layer(material: Material) -> tuple[float, ...]:
    f0, f90 = material.dielectric
    mean0, mean90 = material.schlick
    share = (1.0 - material.metallic) * material.layer_share
    mean = mean0.max() + (mean90 - mean0.max()) / 21.0
    return f0.max(), f90, share, material.clearcoat, mean


def _fresnel(material: Material) -> tuple[float, float]:
    if material.layering == "gltf":
        return (0.0 if material.thin else material.ior), 1.0
    normal, _ = boundary_reflectance(material.ior, material.is_thin_dielectric)
    return material.ior, material.dielectric[0].max() / max(normal, 1e-9)


@inner_kernel
def at_glass(glass, triangle, cosine, inside):  # type: ignore[no-untyped-def]
    """Return the fraction of light that the glass mirrors, and the factor of `clear` that gives the transmittance.

    cosine : cosine of the angle between light and normal, positive
    inside : True if the light comes from inside a solid
    """
    index = glass.slab[triangle]
    if index > 0:
        inside_once = max(glass.clear[triangle, 0], glass.clear[triangle, 1], glass.clear[triangle, 2])
        cosine = max(cosine, 1e-4)
        within = np.sqrt(1 - (1 - cosine * cosine) / (index * index))
        once = inside_once ** (1 / within)
        across = (cosine - index * within) / (cosine + index * within)
        along = (index * cosine - within) / (index * cosine + within)
        mirrored, passed = 0.0, 0.0
        for f in (across * across, along * along):
            between = 1 / max(1 - f * f * once * once, 1e-12)
            passed += 0.5 * (1 - f) * (1 - f) * once * between
            mirrored += 0.5 * f * (1 + (1 - 2 * f) * once * once) * between
        return mirrored, passed / max(inside_once, 1e-12)
    index, tint = glass.fresnel[triangle]
    grazing = 1 - min(cosine, 1.0)
    schlick = grazing * grazing * grazing * grazing * grazing
    f0, f90 = glass.layer[triangle, 0], glass.layer[triangle, 1]
    reflected = f0 + (f90 - f0) * schlick
    if index > 0:
        eta = 1 / index if inside else index
        sine2 = (1 - cosine * cosine) / (eta * eta)
        reflected = 1.0
        if sine2 < 1:
            far = np.sqrt(1 - sine2)
            across = (cosine - eta * far) / (cosine + eta * far)
            along = (eta * cosine - far) / (eta * cosine + far)
            reflected = 0.5 * (across * across + along * along)
        if glass.thin[triangle]:
            reflected = 2 * reflected / (1 + reflected)
    coat = glass.layer[triangle, 3] * (0.04 + 0.96 * schlick)
    return coat + (1 - coat) * glass.layer[triangle, 2] * tint * reflected, (1 - coat) * (1 - reflected)
