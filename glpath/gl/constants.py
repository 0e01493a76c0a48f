"""Constants that Python and GLSL share, declared here; every program gets them by `#include <CONSTANTS>`."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np

from glpath.scene.material import SMOOTH as SMOOTH
from glpath.scene.material import Layering
from glpath.scene.profile import ANGLE_ROUNDING as ANGLE_ROUNDING_DEGREES

#: Depth beyond all geometry.
INFINITE_DEPTH = 1e30
#: Bit pattern of the smallest normal float. From this pattern on, integers have the order of the floats with the
#: same bits, so blending keeps the order of integers.
MIN_NORMAL = np.uint32(0x00800000)

#: Distance from a path's start up to which packed depths have the smallest steps, in scene diameters; see
#: `shaders/path/scan_word.glsl`.
DEPTH_BASE = 1.0 / 16

#: Number of bits of a path's index in a scan of the path-buffer. The bits above hold the scan's epoch.
NUMBER_BITS = 20
#: Result of a scan of the path-buffer, instead of a triangle's number, if the ray hits nothing beyond its start.
PATH_MISSED = -1
#: Result of a scan of the path-buffer if the path lost the collision in its cell.
PATH_LOST = -2
#: Result of a scan of the path-buffer if the path was not launched.
PATH_DEAD = -3

#: Rounding error of a hit point, as a fraction of the ray's length and of the point's coordinates.
RAY_ROUNDING = 2e-6

#: Number of bits of a path's ray count. The float that holds the count has the number of lost rays in higher bits.
CAST_BITS = 11
#: First bit of the number of dropped samples in a sum of events; the bits below hold the number of lost rays.
DROPPED_SHIFT = 20
#: First bit of the number of hits in a sum of positions; the bits below hold the upper bits of the depth
#: (`shaders/film/aov.glsl`).
HITS_SHIFT = 16

#: Rounding tolerance of a direction at the edge of a photometric profile, radians.
ANGLE_ROUNDING = math.radians(ANGLE_ROUNDING_DEGREES)


def constants_glsl() -> str:
    """Return GLSL declarations of this module's constants, of pi, and of an index for each material layering."""
    found = {name: value for name, value in globals().items() if name.isupper()} | {"PI": math.pi}
    found |= {f"LAYERING_{name.upper()}": number for number, name in enumerate(get_args(Layering))}
    return "\n".join(_declaration(name, value) for name, value in found.items()) + "\n"


def _declaration(name: str, value: float | np.uint32) -> str:
    if isinstance(value, np.uint32):
        return f"const uint {name} = {int(value)}u;"
    return f"const {'int' if isinstance(value, int) else 'float'} {name} = {value!r};"
