"""The transform of a shape: its steps as one matrix [pyrr]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import UnsetType

from glpath.io.description import Step
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.pyrr_matrices import matrix44


def world_from_shape(steps: Sequence[Step], location: SourceLocation) -> Float64:
    """(4, 4) float64 for column vectors: the product of all steps, the first one applied first.

    Raises SceneError at `location` of the list: for a step that is none or several, a zero axis, a singular matrix.
    """
    matrix = np.identity(4)
    for index, step in enumerate(steps):
        matrix = _matrix_of_step(step, location.item(index)) @ matrix
    return matrix


def mirrors(matrix: Float64) -> bool:
    """Whether it reverses the order of a triangle's corners, so that its front would be its back.

    Not by LAPACK, which divides by pivots however small a rotation makes them.
    """
    x, y, z = matrix[:3, :3]
    return bool(np.cross(x, y) @ z < 0)


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
    """pyrr multiplies row vectors from the left; we multiply column vectors from the right."""
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
