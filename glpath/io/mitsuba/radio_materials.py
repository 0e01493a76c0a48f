"""Colours of Sionna's radio materials, which define no optical reflection.

Source: Sionna 1.0, `ITURadioMaterial`, the colours of its preview and renderer; the names are from ITU-R P.2040-3.
"""

from __future__ import annotations

#: Colour, linear Rec. 709, for each value of the parameter `type`.
RADIO_COLOURS = {
    "marble": (0.701, 0.644, 0.485),
    "concrete": (0.539, 0.539, 0.539),
    "wood": (0.266, 0.109, 0.060),
    "metal": (0.220, 0.220, 0.254),
    "brick": (0.402, 0.112, 0.087),
    "glass": (0.168, 0.139, 0.509),
    "floorboard": (0.539, 0.386, 0.025),
    "ceiling_board": (0.376, 0.539, 0.117),
    "chipboard": (0.509, 0.159, 0.323),
    "plasterboard": (0.051, 0.539, 0.133),
    "plywood": (0.136, 0.076, 0.539),
    "very_dry_ground": (0.539, 0.319, 0.223),
    "medium_dry_ground": (0.539, 0.181, 0.076),
    "wet_ground": (0.539, 0.027, 0.147),
}
