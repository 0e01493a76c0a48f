"""Vectors of three numbers: checks, unit vectors and perpendicular vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.system.arguments import short_repr

Float64 = NDArray[np.float64]

#: Largest allowed number in a scene: its square, even multiplied by 1e8, is finite in 32 bits.
LARGEST = 1e15


def vector(name: str, given: ArrayLike, low: float = -LARGEST, high: float = LARGEST) -> Float64:
    """Return three numbers as a vector (3,) float64. Raises SceneError for anything else, such as NaN.

    low, high : smallest and largest allowed number
    """
    if type(given) is np.ndarray and given.dtype == np.float64 and given.shape == (3,):
        x, y, z = given.tolist()
        if low <= x <= high and low <= y <= high and low <= z <= high:
            return given
    try:
        found = np.asarray(given)
        fits = found.shape == (3,) and found.dtype.kind in "fiub"
        plain = found.astype(np.float64) if fits else np.zeros(0)
    except (TypeError, ValueError):
        plain = np.zeros(0)
    if not len(plain) or not ((plain >= low) & (plain <= high)).all():
        allowed = f"three finite numbers from {low:g} to {high:g}"
        raise SceneError(f"{name}: {short_repr(given)}, but must be {allowed}.")
    return plain


def unit_normals(normals: Float64) -> Float64:
    """Return (N, 3) normals scaled to length 1; zero ones stay zero, and those that are not finite become NaN."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        extreme = ~((length > 1e-100) & (length < 1e100))
        if extreme.any():
            # Scale extreme vectors first, because squares of the smallest are 0 and of the largest infinite.
            longest = np.abs(normals).max(axis=1, keepdims=True)
            normals = normals / np.where(extreme & (longest > 0), longest, 1.0)
            length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.where(length > 0, length, 1.0))


def perpendicular(axis: Float64) -> Float64:
    """Return a (3,) unit vector perpendicular to a unit axis. The same axis always gives the same vector."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return np.asarray(across / np.linalg.norm(across))
