"""Numbers that Python and GLSL share, declared here; every program has them by `#include <CONSTANTS>`."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np

from glpath.scene.material import SMOOTH as SMOOTH
from glpath.scene.material import Layering
from glpath.scene.profile import ANGLE_ROUNDING as ANGLE_ROUNDING_DEGREES

#: Depth behind everything.
INFINITE_DEPTH = 1e30
#: Bits of the least float that is not denormal: integers from here on are floats of the same order, which blending
#: keeps.
MIN_NORMAL = np.uint32(0x00800000)

#: Levels of a packed depth are finest up to this distance, in scene diameters (`shaders/path/scan_word.glsl`).
DEPTH_BASE = 1.0 / 16

#: Bits of a path's number in a scan; above it stands the scan's epoch.
NUMBER_BITS = 20
#: Results of a scan instead of a triangle: nothing beyond its start; it lost the collision in its cell;
#: it was not launched.
PATH_MISSED, PATH_LOST, PATH_DEAD = -1, -2, -3

#: A hit point is known to this share of the ray's length.
RAY_ROUNDING = 2e-6

#: Events of a path, in one float: rays cast, and from this bit on how many of them were lost.
CAST_BITS = 11
#: Sums of events: above the rays lost, the samples dropped.
DROPPED_SHIFT = 20
#: Sums of positions (`shaders/film/aov.glsl`): above the upper bits of depth's, the number of hits.
HITS_SHIFT = 16

#: Radians by which a direction may seem to miss the edge of a photometric profile.
ANGLE_ROUNDING = math.radians(ANGLE_ROUNDING_DEGREES)


def constants_glsl() -> str:
    """All of them as GLSL, pi, and the numbers of the materials' layerings."""
    found = {name: value for name, value in globals().items() if name.isupper()} | {"PI": math.pi}
    found |= {f"LAYERING_{name.upper()}": number for number, name in enumerate(get_args(Layering))}
    return "\n".join(_declaration(name, value) for name, value in found.items()) + "\n"


def _declaration(name: str, value: float | np.uint32) -> str:
    if isinstance(value, np.uint32):
        return f"const uint {name} = {int(value)}u;"
    return f"const {'int' if isinstance(value, int) else 'float'} {name} = {value!r};"
