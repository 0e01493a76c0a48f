"""Comparing pictures: numbers, verdicts, and what a picture must carry to be compared.

measures   relative_mse, psnr ...: how far apart, as numbers; the difference in false colours
picture    a picture with its noise and its provenance, to and from one EXR
modes      exact, fuzzy, stat, flip: whether two pictures count as the same
"""

from __future__ import annotations

from glpath.compare.measures import (
    EPSILON,
    difference_image,
    max_difference,
    mean_ratio,
    mse,
    percent_beyond,
    psnr,
    relative_mse,
)
from glpath.compare.modes import MODES, Mode, compare, default_mode, read_limits
from glpath.compare.perceptual import flip_map, flip_picture
from glpath.compare.picture import BLOCK_SIDE, Noise, Picture
from glpath.compare.verdict import Verdict

__all__ = [
    "BLOCK_SIDE",
    "EPSILON",
    "MODES",
    "Mode",
    "Noise",
    "Picture",
    "Verdict",
    "compare",
    "default_mode",
    "difference_image",
    "flip_map",
    "flip_picture",
    "max_difference",
    "mean_ratio",
    "mse",
    "percent_beyond",
    "psnr",
    "read_limits",
    "relative_mse",
]
