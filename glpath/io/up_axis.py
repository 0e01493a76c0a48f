"""Guess the up axis of a scene whose format does not fix it, for the camera and the studio that are added.

The guess is z if there is evidence for it; otherwise y stays up. Evidence is a ground below everything else, a
surface that faces upwards nearly everywhere, a flat base, or a small extent. If y has the same evidence, it does
not count for z.

Poor at: boxes, and rooms, because their walls look like a ground as well. Cost: one pass over the triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from glpath.scene.model import Float64, Mesh, Scene

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
#: Parameter of all scenes whose format does not fix the up axis.
Up = Annotated[
    Literal["guess", "x", "y", "z", "-x", "-y", "-z"],
    Meta(
        description="x, y, z, -x, -y or -z, the axis that is up if the file has no camera, or guess: z with "
        "evidence such as a ground or a base, else y"
    ),
]
#: Suffixes of formats for prints and scans, whose objects more often lie flat than stand.
LYING = (".stl", ".ply")

# Faces within this distance of an end of the bounding box count as lying at that end. Fraction of the box's extent.
_END = 0.01
# A face counts as perpendicular to an axis if the absolute cosine between its normal and the axis is at least this.
_ACROSS = 0.98
# Minimum fraction of the footprint that a ground covers. The footprint is the bounding box seen along the axis.
_GROUND = 0.5
# Minimum fraction of the footprint that a base covers.
_BASE = 0.3
# Maximum fraction of the footprint that a ground or base along y covers if z is to be up.
_OTHER = 0.05
# Minimum fraction of the footprint that a ground with its front downwards covers. It is larger than `_GROUND`,
# because the base of a body faces downwards as well.
_WHOLE = 0.95
# A surface counts as facing upwards nearly everywhere if at least this fraction of its projected area faces
# upwards.
_UPWARDS = 0.9
# Ratio of height to width below which an object is flat.
_FLAT = 0.25
# Ratio of height to width below which everything lies in a plane, and either axis may be up.
_PLANE = 1e-6


def axis_vector(axis: Axis) -> Float64:
    """Return the (3,) unit vector of an axis."""
    return np.where(np.array(["x", "y", "z"]) == axis[-1], -1.0 if axis[0] == "-" else 1.0, 0.0)


@dataclass(frozen=True)
class _Faces:
    """Areas of faces projected along an axis, as fractions of the footprint along that axis.

    ground   : area at the lower end, with fronts upwards
    base     : area at the lower end, with fronts downwards
    top      : area at the upper end
    upwards  : fraction of the projected area whose fronts face upwards
    covered  : projected area of the whole surface
    """

    ground: float
    base: float
    top: float
    upwards: float
    covered: float


def evidence_for_z(scene: Scene, lying: bool) -> str | None:
    """Return the evidence that z is up, as the end of a sentence; None without evidence, or if y has it as well.

    lying : True if the format is one of `LYING`
    """
    lower, upper = scene.bounds
    wide, deep, high = upper - lower
    if not high > _PLANE * max(wide, deep) or not min(wide, deep) > 0:
        return None
    of_y, of_z = _faces(scene, lower, upper)
    sheet = of_z.base >= _WHOLE and of_y.base < _OTHER and of_z.top < _GROUND  # a sheet whose front faces downwards
    is_low = high <= min(wide, deep)
    if is_low and of_y.ground < _OTHER and (of_z.ground >= _GROUND or sheet):
        return f"a ground at z = {lower[2]:.4g} lies below all else"
    is_flat = high < _FLAT * min(wide, deep)
    if is_flat and of_z.upwards >= _UPWARDS and of_z.covered >= _GROUND and of_y.upwards < _UPWARDS:
        return "its surface faces z nearly everywhere"
    if (lying or is_flat) and of_z.base >= _BASE and of_y.base < _OTHER and 2 * of_z.top < of_z.base:
        return f"it stands on a flat base at z = {lower[2]:.4g}"
    if lying and is_flat:
        return f"it is {high:.4g} high along z, but {wide:.4g} x {deep:.4g} wide"
    return None


def _faces(scene: Scene, lower: Float64, upper: Float64) -> tuple[_Faces, _Faces]:
    """Return the areas of faces projected along y, and along z."""
    axes = (1, 2)
    near = _END * (upper - lower)
    sums = np.zeros((2, 5))
    for index, shape in enumerate(scene.shapes):
        for triangles in scene.shapes.triangles_of(index) if isinstance(shape.geometry, Mesh) else ():
            edges = triangles[:, 1:] - triangles[:, :1]
            normal = 0.5 * np.cross(edges[:, 0], edges[:, 1])
            across = _ACROSS * np.linalg.norm(normal, axis=1)
            for row, axis in enumerate(axes):
                ends = lower[axis] + near[axis], upper[axis] - near[axis]
                sums[row] += _areas(normal[:, axis], across, triangles[:, :, axis], *ends)
    y, z = (_fractions(row, np.delete(upper - lower, axis)) for row, axis in zip(sums, axes, strict=True))
    return y, z


def _areas(seen: Float64, across: Float64, heights: Float64, low: float, high: float) -> tuple[float, ...]:
    """Return the projected areas of ground, base and top, of all upward fronts, and of all downward fronts.

    seen    : (n,) areas of faces projected along an axis, negative if the front faces downwards
    across  : (n,) minimum projected area of a face that counts as perpendicular to the axis
    heights : (n, 3) coordinates of the corners along the axis
    low     : upper limit of the lower end
    high    : lower limit of the upper end
    """
    is_across = np.abs(seen) >= across
    at_low = is_across & (heights.max(axis=1) <= low)
    at_high = is_across & (heights.min(axis=1) >= high)
    return (
        seen[at_low & (seen > 0)].sum(),
        -seen[at_low & (seen < 0)].sum(),
        np.abs(seen[at_high]).sum(),
        seen[seen > 0].sum(),
        -seen[seen < 0].sum(),
    )


def _fractions(areas: Float64, sides: Float64) -> _Faces:
    """Return the areas of `_areas` as fractions of the footprint, a rectangle with these two sides."""
    footprint, total = float(np.prod(sides)) or 1.0, float(areas[3] + areas[4])
    ground, base, top = (float(area) / footprint for area in areas[:3])
    return _Faces(ground, base, top, float(areas[3]) / total if total else 0.0, total / footprint)
