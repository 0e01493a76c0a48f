"""Sobol points of up to 64 dimensions.

They are bit-identical to those of scipy, but importing `scipy.stats` takes a second, half of a small render's time.

Source: Bratley & Fox 1988, Algorithm 659; Joe & Kuo 2008, Constructing Sobol sequences with better two-dimensional
projections, whose direction numbers these are (new-joe-kuo-6, BSD licence).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

UInt32 = NDArray[np.uint32]

DIMENSIONS = 64
_BITS = 32

#: Primitive polynomial's coefficients as bits, and first direction numbers, for each dimension except the first.
_JOE_KUO = """
    3:1 7:1,3 11:1,3,1 13:1,1,1 19:1,1,3,3 25:1,3,5,13 37:1,1,5,5,17 41:1,1,5,5,5 47:1,1,7,11,19 55:1,1,5,1,1
    59:1,1,1,3,11 61:1,3,5,5,31 67:1,3,3,9,7,49 91:1,1,1,15,21,21 97:1,3,1,13,27,49 103:1,1,1,15,7,5
    109:1,3,1,15,13,25 115:1,1,5,5,19,61 131:1,3,7,11,23,15,103 137:1,3,7,13,13,15,69 143:1,1,3,13,7,35,63
    145:1,3,5,9,1,25,53 157:1,3,1,13,9,35,107 167:1,3,1,5,27,61,31 171:1,1,5,11,19,41,61 185:1,3,5,3,3,13,69
    191:1,1,7,13,1,19,1 193:1,3,7,5,13,19,59 203:1,1,3,9,25,29,41 211:1,3,5,13,23,1,55 213:1,3,7,3,13,59,17
    229:1,3,1,3,5,53,69 239:1,1,5,5,23,33,13 241:1,1,7,7,1,61,123 247:1,1,7,9,13,61,49 253:1,3,3,5,3,55,33
    285:1,3,1,15,31,13,49,245 299:1,3,5,15,31,59,63,97 301:1,3,1,11,11,11,77,249 333:1,3,1,11,27,43,71,9
    351:1,1,7,15,21,11,81,45 355:1,3,7,3,25,31,65,79 357:1,3,1,1,19,11,3,205 361:1,1,5,9,19,21,29,157
    369:1,3,7,11,1,33,89,185 391:1,3,3,3,15,9,79,71 397:1,3,7,11,15,39,119,27 425:1,1,3,1,11,31,97,225
    451:1,1,1,3,23,43,57,177 463:1,3,7,7,17,17,37,71 487:1,3,1,5,27,63,123,213 501:1,1,3,5,11,43,53,133
    529:1,3,5,5,29,17,47,173,479 539:1,3,3,11,3,1,109,9,69 545:1,1,1,5,17,39,23,5,343 557:1,3,1,5,25,15,31,103,499
    563:1,1,1,11,11,17,63,105,183 601:1,1,5,11,9,29,97,231,363 607:1,1,5,15,19,45,41,7,383
    617:1,3,7,7,31,19,83,137,221 623:1,1,1,3,23,15,111,223,83 631:1,1,5,13,31,15,55,25,161
    637:1,1,3,13,25,47,39,87,257
"""


def sobol_points(start: int, count: int, dimensions: int) -> UInt32:
    """Return (count, dimensions) uint32: points start, start + 1, ... in Gray code order, as multiples of 2**-32.

    start + count : at most 2**32
    dimensions    : at most `DIMENSIONS`
    """
    index = np.arange(start, start + count, dtype=np.uint64)
    return sobol_points_at(index ^ (index >> np.uint64(1)), dimensions)


def sobol_points_at(index: NDArray[np.uint64], dimensions: int) -> UInt32:
    """Return (N, dimensions) uint32: the points with indices (N,), in their natural order."""
    directions = _direction_numbers()[:, :dimensions]
    points = np.zeros((len(index), dimensions), np.uint32)
    for bit in range(int(index.max(initial=0)).bit_length()):
        points[(index >> np.uint64(bit)) & np.uint64(1) == 1] ^= directions[bit]
    return points


@lru_cache(maxsize=1)
def _direction_numbers() -> UInt32:
    """Return (32, 64), the bits of a point that each bit of its index flips, [index bit, dimension]."""
    numbers = np.empty((_BITS, DIMENSIONS), np.uint32)
    numbers[:, 0] = 1 << np.arange(_BITS - 1, -1, -1, dtype=np.uint64)
    for dimension, row in enumerate(_JOE_KUO.split(), start=1):
        polynomial, first = row.split(":")
        coefficients, m = int(polynomial), [int(x) for x in first.split(",")]
        degree = len(m)
        for k in range(degree, _BITS):
            value = m[k - degree]
            for j in range(1, degree + 1):
                if coefficients >> (degree - j) & 1:
                    value ^= m[k - j] << j
            m.append(value)
        numbers[:, dimension] = [x << (_BITS - 1 - k) for k, x in enumerate(m)]
    return numbers
