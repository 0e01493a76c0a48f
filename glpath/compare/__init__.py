"""Comparison of images: measures, verdicts, and the data that an image must carry to be compared.

measures   relative_mse, psnr ...: distances as numbers, and the difference in false colours
picture    an image with its noise and its provenance, to and from one EXR
reading    images from files of any kind, and from Pillow
modes      exact, fuzzy, stat, flip: criteria by which two images count as the same
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
from glpath.compare.modes import MODES, Mode, compare, default_mode, max_difference_pair, read_limits
from glpath.compare.perceptual import flip_map, flip_picture
from glpath.compare.picture import BLOCK_SIDE, Noise, Picture
from glpath.compare.reading import SUFFIXES, is_pillow, picture_from_bytes, picture_of_pillow, read_picture
from glpath.compare.verdict import Verdict

__all__ = [
    "BLOCK_SIDE",
    "EPSILON",
    "MODES",
    "SUFFIXES",
    "Mode",
    "Noise",
    "Picture",
    "Verdict",
    "compare",
    "default_mode",
    "difference_image",
    "flip_map",
    "flip_picture",
    "is_pillow",
    "max_difference",
    "max_difference_pair",
    "mean_ratio",
    "mse",
    "percent_beyond",
    "picture_from_bytes",
    "picture_of_pillow",
    "psnr",
    "read_limits",
    "read_picture",
    "relative_mse",
]
