"""Clear glass: the transmittance of a pane with all reflections between its faces, and case 5.5.

The pane of 6 mm with index 1.52 transmits 0.88 at normal incidence: the ratio of the printed tables of 5.10 and
5.12 to those of 5.9 and 5.11 if the light arrives perpendicularly. The transmittances printed for 5.5, 0.96 at
normal incidence, are those of a single face, by Schlick's formula, and are not used.

Source: Fresnel's formulas for each polarization; the geometric series of a slab much thicker than a wavelength.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.cie171.case import Case
from benchmarks.cie171.exact import Float64, Rectangle
from benchmarks.cie171.rooms import UP, facing, quad, scene

NORMAL, INDEX = 0.88, 1.52
MATERIAL = {"type": "glazing", "transmittance": NORMAL}
ANGLES = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)


def transmittance(cosine: ArrayLike) -> Float64:
    """Return the transmittance for unpolarized light, given the cosine of the angle of incidence."""
    c = np.asarray(cosine, np.float64)
    inside = np.sqrt(1 - (1 - c * c) / INDEX**2)
    # The internal transmittance, perpendicular to the pane, from the pane's transmittance at normal incidence.
    r = ((INDEX - 1) / (INDEX + 1)) ** 2
    across = (np.sqrt((1 - r) ** 4 + 4 * r**2 * NORMAL**2) - (1 - r) ** 2) / (2 * r**2 * NORMAL)
    along = across ** (1 / inside)
    both = []
    for a, b in ((c, INDEX * inside), (inside, INDEX * c)):
        reflected = ((a - b) / np.maximum(a + b, 1e-300)) ** 2
        both.append((1 - reflected) ** 2 * along / (1 - (reflected * along) ** 2))
    return np.asarray(0.5 * (both[0] + both[1]))


def directional() -> Case:
    """Return case 5.5: a sun straight above panes that are turned by angles, and a point below each pane."""
    panes, points = [], []
    for k, angle in enumerate(ANGLES):
        across = np.array([0.0, np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        corner = np.array([3.0 * k, 0.0, 2.0]) - [0.5, 0, 0] - 0.5 * across
        panes.append(quad(Rectangle.of(corner, [np.array([1.0, 0.0, 0.0]), across]), "glass"))
        points.append([3.0 * k, 0.0, 0.0])
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": 100}
    there = scene(panes, [sun])
    there["materials"]["glass"] = MATERIAL
    exact = 100 * transmittance(np.cos(np.radians(ANGLES)))
    names = tuple(f"{angle:g} degrees" for angle in ANGLES)
    return Case("5.5", "turned panes", there, *facing((np.array(points), UP)), names, exact, "%", copies=4)
