"""Openings through which the sky lights a room, declared so that light samples of the sky go through them.

A portal changes the noise of an image, but not its mean. Paths draw some light samples of the sky in the solid
angle of the portals that they face. The other samples follow the sky's radiance. Both are weighted by the sum of
the two densities, so light from elsewhere is found too, with more noise.

Cost:     the solid angle of each portal, for each vertex and each ray that reaches the sky.
Poor at:  portals through which no sky is visible, because samples are wasted on them; suns, which the sky's own
          density finds.
Source:   Urena, Fajardo & King 2013 for the directions; Veach 1997 for the weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.system.arguments import checked_fields

#: Maximum number of portals in a scene. Every vertex of a path computes the solid angles of all portals.
MAX_PORTALS = 16
# Maximum difference of opposite edges, relative to their length, and maximum cosine of a right angle. It allows
# coordinates that are rounded to four digits.
_TOLERANCE = 1e-3


@checked_fields
@dataclass(frozen=True, eq=False)
class Portal:
    """Rectangle through which the sky is visible.

    corners : (4, 3) float64, counter-clockwise seen from inside, the side that receives the light

    Raises SceneError if the corners form no rectangle.
    """

    corners: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", np.array(self.corners, np.float64))
        fault = portal_fault(self.corners)
        if fault is not None:
            raise SceneError(f"Portal.corners: {fault[0]}", fault[1])

    @property
    def corner_and_edges(self) -> NDArray[np.float64]:
        """First corner and the edges to the second and the last corner, the rows of a matrix (3, 3).

        The cross product of the edges points inwards.
        """
        a, b, _, d = self.corners
        return np.stack([a, b - a, d - a])


def portal_fault(corners: ArrayLike) -> tuple[str, str] | None:
    """Return an error text for the corners of a portal, and the remedy; None for a rectangle."""
    p = np.asarray(corners, np.float64)
    if p.shape != (4, 3) or not np.isfinite(p).all():
        return f"an array of shape {p.shape}, but must be four corners of three finite numbers.", ""
    edges = np.roll(p, -1, axis=0) - p
    lengths = np.linalg.norm(edges, axis=1)
    if not lengths.min() > 1e-9 * max(float(np.abs(p).max()), 1e-15):
        return "has an edge without length, but a portal is a rectangle.", "Give four corners, one after the other."
    cosine = max(abs(edges[i] @ edges[i - 1]) / (lengths[i] * lengths[i - 1]) for i in range(4))
    unequal = float(np.linalg.norm(edges[0] + edges[2]) / lengths[0])
    if max(cosine, unequal) > _TOLERANCE:
        what = (
            f"an angle of {90 + np.degrees(np.arcsin(min(cosine, 1.0))):.3g} degrees"
            if cosine > _TOLERANCE
            else "opposite edges that are not parallel and alike"
        )
        return (
            f"has {what}, but a portal is a rectangle.",
            "Of an opening of another form, give a rectangle around it: only what is seen of the sky counts.",
        )
    return None
