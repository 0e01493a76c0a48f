"""Utah teapot: 32 bicubic Bézier patches [Newell 1975], as published by the University of Utah.

Ten patches are stored; the others are their reflections. Rim, body, lid and bottom are reflected in x and in y,
handle and spout in y only. z is up. The bottom was added later, so that the teapot can stand. The surface is not
closed between body and lid, and where handle and spout pass through the body.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from glpath.io.load import scene_from_dict
from glpath.scene.model import Float64, Scene

# Indices of 4 x 4 points per patch: rim, body (2), lid (2), bottom, handle (2), spout (2).
_PATCHES = """
102 103 104 105   4   5   6   7   8   9  10  11  12  13  14  15
 12  13  14  15  16  17  18  19  20  21  22  23  24  25  26  27
 24  25  26  27  29  30  31  32  33  34  35  36  37  38  39  40
 96  96  96  96  97  98  99 100 101 101 101 101   0   1   2   3
  0   1   2   3 106 107 108 109 110 111 112 113 114 115 116 117
118 118 118 118 124 122 119 121 123 126 125 120  40  39  38  37
 41  42  43  44  45  46  47  48  49  50  51  52  53  54  55  56
 53  54  55  56  57  58  59  60  61  62  63  64  28  65  66  67
 68  69  70  71  72  73  74  75  76  77  78  79  80  81  82  83
 80  81  82  83  84  85  86  87  88  89  90  91  92  93  94  95
"""
_TWICE_REFLECTED = 6  # number of first patches that are reflected in x and in y

_POINTS = """
.2 0 2.7  .2 -.112 2.7  .112 -.2 2.7  0 -.2 2.7
1.3375 0 2.53125  1.3375 -.749 2.53125  .749 -1.3375 2.53125  0 -1.3375 2.53125
1.4375 0 2.53125  1.4375 -.805 2.53125  .805 -1.4375 2.53125  0 -1.4375 2.53125
1.5 0 2.4  1.5 -.84 2.4  .84 -1.5 2.4  0 -1.5 2.4
1.75 0 1.875  1.75 -.98 1.875  .98 -1.75 1.875  0 -1.75 1.875
2 0 1.35  2 -1.12 1.35  1.12 -2 1.35  0 -2 1.35
2 0 .9  2 -1.12 .9  1.12 -2 .9  0 -2 .9
-2 0 .9
2 0 .45  2 -1.12 .45  1.12 -2 .45  0 -2 .45
1.5 0 .225  1.5 -.84 .225  .84 -1.5 .225  0 -1.5 .225
1.5 0 .15  1.5 -.84 .15  .84 -1.5 .15  0 -1.5 .15
-1.6 0 2.025  -1.6 -.3 2.025  -1.5 -.3 2.25  -1.5 0 2.25
-2.3 0 2.025  -2.3 -.3 2.025  -2.5 -.3 2.25  -2.5 0 2.25
-2.7 0 2.025  -2.7 -.3 2.025  -3 -.3 2.25  -3 0 2.25
-2.7 0 1.8  -2.7 -.3 1.8  -3 -.3 1.8  -3 0 1.8
-2.7 0 1.575  -2.7 -.3 1.575  -3 -.3 1.35  -3 0 1.35
-2.5 0 1.125  -2.5 -.3 1.125  -2.65 -.3 .9375  -2.65 0 .9375
-2 -.3 .9  -1.9 -.3 .6  -1.9 0 .6
1.7 0 1.425  1.7 -.66 1.425  1.7 -.66 .6  1.7 0 .6
2.6 0 1.425  2.6 -.66 1.425  3.1 -.66 .825  3.1 0 .825
2.3 0 2.1  2.3 -.25 2.1  2.4 -.25 2.025  2.4 0 2.025
2.7 0 2.4  2.7 -.25 2.4  3.3 -.25 2.4  3.3 0 2.4
2.8 0 2.475  2.8 -.25 2.475  3.525 -.25 2.49375  3.525 0 2.49375
2.9 0 2.475  2.9 -.15 2.475  3.45 -.15 2.5125  3.45 0 2.5125
2.8 0 2.4  2.8 -.15 2.4  3.2 -.15 2.4  3.2 0 2.4
0 0 3.15  .8 0 3.15  .8 -.45 3.15  .45 -.8 3.15  0 -.8 3.15
0 0 2.85
1.4 0 2.4  1.4 -.784 2.4  .784 -1.4 2.4  0 -1.4 2.4
.4 0 2.55  .4 -.224 2.55  .224 -.4 2.55  0 -.4 2.55
1.3 0 2.55  1.3 -.728 2.55  .728 -1.3 2.55  0 -1.3 2.55
1.3 0 2.4  1.3 -.728 2.4  .728 -1.3 2.4  0 -1.3 2.4
0 0 0  1.425 -.798 0  1.5 0 .075  1.425 0 0  .798 -1.425 0  0 -1.5 .075  0 -1.425 0  1.5 -.84 .075  .84 -1.5 .075
"""


def teapot_patches() -> Float64:
    """Return the (32, 4, 4, 3) control points, z up; fronts outward."""
    points = np.array(_POINTS.split(), np.float64).reshape(-1, 3)
    kept = points[np.array(_PATCHES.split(), int).reshape(-1, 4, 4)[:, :, ::-1]]

    def reflected(patches: Float64, axis: int) -> Float64:
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        return np.asarray(patches[:, :, ::-1] * sign + 0.0)  # order reversed, so that fronts stay outward

    around, upright = kept[:_TWICE_REFLECTED], reflected(kept, 1)
    return np.concatenate([kept, upright, reflected(around, 0), reflected(upright[:_TWICE_REFLECTED], 0)])


def teapot(
    *,
    level: Annotated[
        int, Meta(ge=1, le=64, description="a whole number from 1 to 64, the segments along each edge of a patch")
    ] = 8,
    streamed: Annotated[
        bool, Meta(description="true or false: triangles are made when they are needed, for scans")
    ] = False,
) -> Scene:
    """The Utah teapot, 32 Bézier patches, on a table under a lamp."""
    patches = teapot_patches()
    pot: dict[str, Any] = {
        "type": "patches",
        "name": "teapot",
        "material": "china",
        "points": patches.reshape(-1, 3),
        "patches": np.arange(16 * len(patches)).reshape(-1, 16),
        "level": level,
        "streamed": streamed,
    }
    return scene_from_dict(
        {
            "camera": {"position": [1.2, -8.6, 4.6], "target": [0.2, 0, 1.35], "up": [0, 0, 1], "fov": 38},
            "film": {"resolution": [512, 384]},
            "materials": {
                "china": {"reflectance": [0.75, 0.72, 0.66]},
                "table": {"reflectance": [0.42, 0.3, 0.2]},
            },
            "sky": {"zenith": [0.25, 0.33, 0.5], "horizon": [0.5, 0.5, 0.5], "up": [0, 0, 1]},
            "shapes": [
                {
                    "type": "quad",
                    "name": "table",
                    "material": "table",
                    "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]],
                },
                {
                    "type": "quad",
                    "name": "lamp",
                    "emission": {"radiance": 12},
                    "corners": [[-4, -3, 7], [-4, -1, 8], [-1, -1, 8], [-1, -3, 7]],
                },
                pot,
            ],
        },
        source="teapot",
    )
