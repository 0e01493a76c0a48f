"""Quantised boxes and triangle flags of the BVH for rays, for all code that builds it: see `glpath.gl.ray_bvh`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Scene

#: Flag of an item with a triangle that has an opacity.
ITEM_ALPHA = 1
#: Flag of an item with a triangle that is a thin dielectric.
ITEM_THIN_DIELECTRIC = 2
_STEPS = 65535


@dataclass(frozen=True)
class Grid:
    """Quantisation grid of boxes.

    lower : (3,) origin, scene units
    step  : (3,) size of a step, scene units
    pad   : (3,) number of steps by which boxes are padded against rounding
    """

    lower: NDArray[np.float64]
    step: NDArray[np.float64]
    pad: NDArray[np.float64]

    @classmethod
    def around(cls, lower: NDArray[np.float64], upper: NDArray[np.float64], far: float) -> Grid:
        """Return the grid over a box between two corners (3,). far: largest |coordinate| of a ray's start."""
        far = max(far, 1e-30)
        extent = np.maximum(upper - lower, max(1e-6 * float((upper - lower).max()), 1e-9 * far))
        # A ray's start is a 32-bit float; far from the origin, its rounding error exceeds a step.
        pad = 1.0 + np.minimum(np.ceil(4 * 2.0**-24 * far * _STEPS / extent), _STEPS // 8)
        step = extent / (_STEPS - 2 * pad - 2)
        return cls(lower - (pad + 1) * step, step, pad)

    def steps(self, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Return boxes (M, 3) in steps, rounded outwards: lower corners in the low 16 bits, upper ones above."""
        low = np.clip(np.floor((lower - self.lower) / self.step - self.pad), 0, _STEPS).astype(np.uint32)
        high = np.clip(np.ceil((upper - self.lower) / self.step + self.pad), 0, _STEPS).astype(np.uint32)
        return np.asarray(low | high << np.uint32(16))


def triangle_flags(scene: Scene) -> NDArray[np.uint8]:
    """Return (T,) flags of the triangles: ITEM_ALPHA and ITEM_THIN_DIELECTRIC."""
    materials = [scene.materials[shape.material] for shape in scene.shapes]
    of_shape = [ITEM_ALPHA * m.lets_light_through + ITEM_THIN_DIELECTRIC * m.is_thin_dielectric for m in materials]
    return np.array(of_shape, np.uint8)[scene.triangle_shape]
