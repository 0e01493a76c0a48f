"""Masks of image parts that a comparison ignores, such as clocks and versions, which change from run to run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.compare.picture import BLOCK_SIDE, Noise, Picture, block_pixels, spread_blocks
from glpath.compare.reading import read_picture
from glpath.errors import UsageError

#: Ignored parts of an image: rectangles (x, y, width, height) in pixels, y from the top; or a mask, as an image or
#: an image file, that is white in the ignored parts.
Ignore = Sequence[tuple[int, int, int, int]] | ArrayLike | str | Path


def mask_of(ignore: Ignore, shape: tuple[int, ...], folder: Path | None = None) -> NDArray[np.bool_]:
    """Return the (H, W) bool mask of an image of shape (H, W, ...): True for ignored pixels.

    folder : base of relative file names

    Raises UsageError for rectangles outside the image, and for a mask of another size.
    """
    height, width = shape[:2]
    if isinstance(ignore, str | Path):
        return _of_image(read_picture((folder or Path()) / ignore).mean.mean(axis=2) > 0.2, (height, width))
    given = _array(ignore)
    # Integers of other types come from lists; their white is 1.
    white = {"uint8": 255, "uint16": 65535}.get(given.dtype.name, 1)
    if given.ndim == 2 and given.shape[1] == 4 and given.dtype.kind in "iuf" and given.shape != (height, width):
        found = np.zeros((height, width), np.bool_)
        for number, (x, y, w, h) in enumerate(given.tolist()):
            if not (x >= 0 and y >= 0 and w > 0 and h > 0 and x + w <= width and y + h <= height):
                raise UsageError(
                    f"ignore[{number}]: ({x}, {y}, {w}, {h}) is not inside of the picture of {width} x {height}.",
                    "Give x, y, width and height in pixels, y from the top.",
                )
            found[int(y) : int(y + h), int(x) : int(x + w)] = True
        return found
    if given.ndim == 3:
        given = given[..., :3].mean(axis=2)
    return _of_image(given > 0.5 * white, (height, width))


def masked(picture: Picture, mask: NDArray[np.bool_]) -> Picture:
    """Return the image, black and opaque where the mask is True.

    Noise is known in blocks of 16 x 16 pixels. In an image with noise, each block that touches the mask is masked
    completely. Raises UsageError if nothing of the image would be left.
    """
    noise = picture.noise
    if noise is not None:
        rows, columns = (np.arange(0, side, BLOCK_SIDE) for side in mask.shape)
        touched = np.logical_or.reduceat(np.logical_or.reduceat(mask, rows, axis=0), columns, axis=1)
        mask = spread_blocks(touched, mask.shape).astype(np.bool_)
        noise = Noise(
            np.where(mask[..., None], 0.0, noise.variance),
            np.where(touched[None, ..., None], 0.0, noise.block_batches),
            noise.batch_counts,
        )
        assert touched.shape == block_pixels(mask.shape).shape
    if mask.all():
        blocks = "" if noise is None else f", in blocks of {BLOCK_SIDE} x {BLOCK_SIDE} pixels, as noise is stored"
        raise UsageError(
            f"ignore: takes all {mask.size:,} pixels of the picture{blocks}, so that nothing is compared.",
            "Ignore a smaller part, or leave out the comparison.",
        )
    alpha = None if picture.alpha is None else np.where(mask, 1.0, picture.alpha)
    return replace(picture, mean=np.where(mask[..., None], 0.0, picture.mean), noise=noise, alpha=alpha)


def padded(picture: Picture, shape: tuple[int, int]) -> Picture:
    """Return the image enlarged to (height, width), black to the right and below, without noise and alpha."""
    height, width = picture.mean.shape[:2]
    more = ((0, shape[0] - height), (0, shape[1] - width), (0, 0))
    return replace(picture, mean=np.pad(picture.mean, more), noise=None, alpha=None)


def _array(ignore: Any) -> NDArray[Any]:
    try:
        found = np.asarray(ignore)
    except ValueError:
        found = np.empty(0)
    if found.dtype.kind not in "biuf" or found.ndim not in (2, 3) or not found.size:
        raise UsageError(
            "ignore: expected rectangles [(x, y, width, height), ...], a picture (H, W) or the file of one.",
            "For example ignore=[(0, 0, 64, 16)].",
        )
    return found


def _of_image(mask: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.bool_]:
    if mask.shape != size:
        raise UsageError(
            f"ignore: a picture of {mask.shape[1]} x {mask.shape[0]}, but that compared has {size[1]} x {size[0]}.",
            "Make it as large, white where nothing is compared.",
        )
    return mask
