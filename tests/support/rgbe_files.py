"""Writes RGBE files for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def colours(rgbe: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Decode by the definition, pixel by pixel."""
    found = np.zeros((*rgbe.shape[:2], 3))
    for at in np.ndindex(rgbe.shape[:2]):
        *mantissas, exponent = (int(x) for x in rgbe[at])
        if exponent:
            found[at] = [m / 256 * 2.0 ** (exponent - 128) for m in mantissas]
    return found


def run_lengths(rgbe: NDArray[np.uint8]) -> bytes:
    """Encode each line channel by channel, in runs of one value or of several [Radiance's color.c]."""
    out = bytearray()
    for line in rgbe:
        out += bytes([2, 2, len(line) >> 8, len(line) & 255])
        for channel in line.T:
            at = 0
            while at < len(channel):
                same = 1
                while same < 127 and at + same < len(channel) and channel[at + same] == channel[at]:
                    same += 1
                if same > 2:
                    out += bytes([128 + same, channel[at]])
                    at += same
                    continue
                several = channel[at : at + 128]
                equal = np.flatnonzero((several[2:] == several[1:-1]) & (several[1:-1] == several[:-2]))
                several = several[: max(1, int(equal[0]))] if len(equal) else several
                out += bytes([len(several), *several])
                at += len(several)
    return bytes(out)
