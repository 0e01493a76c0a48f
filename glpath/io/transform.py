"""Transform of a shape: its steps combined into one matrix [pyrr]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import UnsetType

from glpath.io.description import Step
from glpath.io.values import LARGEST, SMALLEST
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.pyrr_matrices import matrix44

# Minimum stretch of a transform along any axis: it makes the smallest object of the largest coordinates.
_SMALLEST_STRETCH = SMALLEST / LARGEST
# Minimum ratio of the smallest to the largest stretch of a transform, at the precision of 64-bit numbers.
_FLATTEST = 1e-15
# Ratio of the smallest to the largest stretch of a transform below which triangles may lose their area.
_FLAT = 1e-5


def world_from_shape(steps: Sequence[Step], location: SourceLocation) -> Float64:
    """Return the (4, 4) float64 product of all steps, for column vectors; the first step is applied first.

    location : location of the list of steps

    Raises SceneError for a step that is none or several of the allowed kinds, for a zero axis, and for a singular
    matrix or product.
    """
    matrix = np.identity(4)
    for index, step in enumerate(steps):
        matrix = _matrix_of_step(step, location.item(index)) @ matrix
    if len(steps) and np.isfinite(matrix).all():  # a matrix that is not finite fails the check of the extent
        stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if not stretch[2] > max(_FLATTEST * stretch[0], _SMALLEST_STRETCH):
            raise location.error(
                f"flattens the shape: its steps together stretch by {shown(stretch)} along their own axes.",
                f"Check its scales: each stretch must be above {_SMALLEST_STRETCH:g}, and above {_FLATTEST:g} of "
                "the largest.",
            )
    return matrix


def mirrors(matrix: Float64) -> bool:
    """Return True if a matrix reverses the order of a triangle's corners, so that its front becomes its back.

    The determinant is not that of LAPACK, which divides by pivots that a rotation may make very small.
    """
    x, y, z = matrix[:3, :3]
    return bool(np.cross(x, y) @ z < 0)


def flattens(matrix: Float64) -> bool:
    """Return True if a matrix may leave triangles of a mesh without an area."""
    stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return not stretch[2] > _FLAT * stretch[0]


def _matrix_of_step(step: Step, location: SourceLocation) -> Float64:
    named = [name for name in step.__struct_fields__ if not isinstance(getattr(step, name), UnsetType)]
    if len(named) != 1:
        raise location.error(
            f"has {' and '.join(named) or 'nothing'}, but a step is one of translate, rotate, scale and matrix.",
            "Write one table per step: transform = [{ scale = 2 }, { translate = [0, 1, 0] }].",
        )
    if not isinstance(step.translate, UnsetType):
        return _column_vector(matrix44.create_from_translation(np.array(step.translate)))
    if not isinstance(step.rotate, UnsetType):
        axis = np.array(step.rotate.axis)
        if not np.linalg.norm(axis) > 0:
            raise location.field("rotate").field("axis").wrong(axis, "a vector of any length but zero")
        return _column_vector(matrix44.create_from_axis_rotation(axis, np.radians(step.rotate.angle)))
    if not isinstance(step.scale, UnsetType):
        factors = np.broadcast_to(np.array(step.scale, np.float64), 3)
        if not np.all(factors):
            raise location.field("scale").wrong(step.scale, "without a zero", "A zero would flatten the shape.")
        return _column_vector(matrix44.create_from_scale(factors))
    return _checked_matrix(np.array(step.matrix, np.float64), location.field("matrix"))


def _column_vector(matrix: Float64) -> Float64:
    """Return the matrix for column vectors, given pyrr's matrix for row vectors."""
    return np.asarray(matrix, np.float64).T


def _checked_matrix(matrix: Float64, location: SourceLocation) -> Float64:
    if not np.allclose(matrix[3], [0, 0, 0, 1]):
        raise location.item(3).wrong(
            matrix[3],
            "[0, 0, 0, 1]",
            "The matrix is for column vectors: the translation is the last column, not the last row.",
        )
    stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretch[2] > 1e-9 * stretch[0]:
        raise location.error(
            "is singular, but must be invertible: it flattens the shape.",
            f"Its upper left 3 x 3 part stretches by {shown(stretch)} along its own axes; none may be zero.",
        )
    return matrix
