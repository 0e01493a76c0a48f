"""Rectangular emitters that subtend a large solid angle, for samples that are uniform in solid angle.

The contribution of a sample uniform by area varies with the squared distance. Close to an emitter most samples
contribute very little, and few contribute a lot. Samples uniform in solid angle contribute about equally. They cost
a tenth of a path set's time. So they are used only if emitters subtend large solid angles at the surfaces that they
light.

Cost:     the solid angle of each rectangle at some hundred surface points: a millisecond.
Poor at:  scenes whose surfaces close to an emitter are not visible, because occlusion is unknown here.
Source:   Urena, Fajardo & King 2013, An area-preserving parametrization for spherical rectangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.scene.model import Float64, Scene, unit_normals

# Maximum number of rectangles, because at every path vertex the triangle that was hit is compared with each.
_MAX = 8
# Minimum solid angle of the emitters in steradians: mean over surface points, weighted by their light. Below it,
# samples are uniform by area (benchmarks/experiments.md).
_MIN_SOLID_ANGLE = 0.5
# Minimum fraction of all lights' power that the rectangles must send.
_MIN_SHARE = 0.5
_POINTS = 512
# Relative rounding tolerance of edges and right angles.
_TOLERANCE = 1e-4


@dataclass(frozen=True)
class LampRectangles:
    """K rectangles, each of two consecutive triangles of the scene.

    first : (K,) number of the first triangle
    edges : (K, 3, 3) a corner and two edges, whose cross product points out of the front
    """

    first: NDArray[np.intp]
    edges: Float64

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def that_pay(cls, lighting: Lighting) -> LampRectangles:
        """Return the rectangular emitters, or none if they send too little light, or if few surfaces are close."""
        scene, rectangular = lighting.scene, 0.0
        found: dict[int, Float64] = {}
        for number, side in enumerate(lighting.sides):
            chance = lighting.cdf[number + 1] - lighting.cdf[number]
            # Textured light is not uniform, and its triangles' probabilities are not proportional to area.
            corner = None if lighting.varies(side.shape) or len(side.cdf) != 3 else _rectangle(scene, side.first)
            if corner is not None:
                found[side.first] = corner
                rectangular += chance
        none = cls(np.zeros(0, np.intp), np.zeros((0, 3, 3)))
        if not 0 < len(found) <= _MAX or rectangular < _MIN_SHARE * float(lighting.cdf[-1]):
            return none
        lamps = cls(np.array(list(found)), np.array(list(found.values())))
        return lamps if lamps._solid_angle(lighting) >= _MIN_SOLID_ANGLE else none

    def _solid_angle(self, lighting: Lighting) -> float:
        """Return the mean solid angle of the emitters, in steradians, at points of the other surfaces.

        The mean is weighted by the unoccluded light at the points.
        """
        scene = lighting.scene
        area = scene.areas.copy()
        for side in lighting.sides:
            area[side.first : side.first + len(side.cdf) - 1] = 0.0
        if not area.sum() > 0:
            return 0.0
        rng = np.random.default_rng(1)
        chosen = scene.triangles[rng.choice(len(area), _POINTS, p=area / area.sum())]
        u = rng.random((_POINTS, 2, 1))
        root = np.sqrt(u[:, 0])
        x = (1 - root) * chosen[:, 0] + root * ((1 - u[:, 1]) * chosen[:, 1] + u[:, 1] * chosen[:, 2])
        normal = unit_normals(chosen)
        weighed = total = 0.0
        radiance = {side.first: side.radiance.mean() for side in lighting.sides}
        two_sided = {side.first for side in lighting.sides if side.sign < 0}
        steps = (np.arange(4) + 0.5) / 4
        for first, (corner, across, up) in zip(self.first, self.edges, strict=True):
            out = np.cross(across, up)
            lamp_area = float(np.linalg.norm(out))
            points = (corner + steps[:, None, None] * across + steps[:, None] * up).reshape(-1, 3)
            w = points - x[:, None]
            r2 = np.maximum(np.sum(w * w, axis=2), 1e-30)
            cosine = -(w @ (out / lamp_area)) / np.sqrt(r2)
            cosine = np.abs(cosine) if first in two_sided else np.maximum(cosine, 0.0)
            seen = np.minimum((cosine / r2).mean(axis=1) * lamp_area, 2 * np.pi)
            facing = np.abs(np.einsum("nkx,nx->nk", w, normal)) / np.sqrt(r2)
            light = np.minimum((cosine * facing / r2).mean(axis=1) * lamp_area, np.pi) * radiance[first]
            weighed += float(light @ seen)
            total += float(light.sum())
        return weighed / total if total > 0 else 0.0


def _rectangle(scene: Scene, first: int) -> Float64 | None:
    """Return (3, 3) a corner and two edges of the rectangle that two triangles form, or None."""
    one, other = scene.triangles[first : first + 2]
    for a, b, c in (np.roll(one, -k, axis=0) for k in range(3)):
        across, up = b - a, c - a
        sizes = float(np.linalg.norm(across)), float(np.linalg.norm(up))
        tolerance = _TOLERANCE * min(sizes)
        right_angled = abs(across @ up) <= tolerance * max(sizes)
        # The other triangle has the far corner, and both ends of the diagonal.
        rest = [np.linalg.norm(other - point, axis=1).min() for point in (b, c, b + up)]
        if right_angled and max(rest) <= tolerance:
            return np.stack([a, across, up])
    return None
