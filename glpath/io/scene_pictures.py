"""Read picture files that a scene file names, and check that they exist and are not too large."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from glpath.errors import ImageError
from glpath.film.image import picture_size
from glpath.io.description import MAX_TEXTURE_SIDE
from glpath.io.values import nearby_files
from glpath.scene.source_location import SourceLocation
from glpath.system.bounded_reading import reading_file
from glpath.system.files import absence_of, reading
from glpath.system.npz import UnfoldedPictures

_Picture = TypeVar("_Picture")
# Bytes of memory for a decoded pixel: RGBA of 8 bits, or RGB of floats.
_BYTE_PIXEL, _FLOAT_PIXEL = 4, 12


def stored_picture(
    path: Path,
    what: str,
    formats: Sequence[str],
    max_pixels: int,
    location: SourceLocation,
    read: Callable[[Path], _Picture],
    unfolded: UnfoldedPictures | None = None,
) -> _Picture:
    """Return a picture that a scene file names, as `read` returns it. Raises SceneError.

    what       : kind of picture for messages: "a texture", "an environment map"
    formats    : allowed suffixes
    max_pixels : maximum number of pixels
    read       : reader from `glpath.film.image`, which raises ImageError
    unfolded   : sizes of the other pictures of the scene, to which this one is added; None if it is the only one
    """
    if path.suffix.lower() not in formats:
        raise location.error(
            f"names {path}, but {what} is a file that ends in {', '.join(formats)}.", "Convert it, e.g. with GIMP."
        )
    if not os.path.isfile(path):  # Path.is_file may raise if the name is too long
        raise location.error(
            f"names the picture {path}, which {absence_of(path)}.",
            nearby_files("Pictures", path, formats),
        )
    try:
        width, height, channels, channel_bytes = picture_size(path, display=True)
        if max(width, height) > MAX_TEXTURE_SIDE or width * height > max_pixels:
            raise location.error(
                f"names the picture {path} of {width:,} x {height:,} pixels, but {what} has at most "
                f"{MAX_TEXTURE_SIDE:,} pixels a side and {max_pixels:,} in all.",
                "Make the picture smaller, or cut out what is needed.",
            )
        if unfolded is not None:
            pixel = _FLOAT_PIXEL if path.suffix.lower() in (".exr", ".hdr") else _BYTE_PIXEL
            with reading(path, what):
                bytes_ = channels * channel_bytes * width * height
                unfolded.add(bytes_, path.stat().st_size, pixel * width * height)
        with reading_file(path.name):
            return read(path)
    except ImageError as error:
        raise location.error(
            f"names a picture that cannot be used. {error}",
            "Open it in another program to see whether it is whole, and write it anew.",
        ) from error
