"""Picture files that a scene file names: found, of a size that is meant, and read."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from glpath.errors import ImageError
from glpath.image import picture_size, read_image
from glpath.scene.formats.description import MAX_TEXTURE_SIDE
from glpath.scene.formats.values import nearby_files
from glpath.scene.model import Float64
from glpath.scene.place import Place


def stored_picture(path: Path, what: str, formats: Sequence[str], most_pixels: int, place: Place) -> Float64:
    """(h, w, 3) float64, linear Rec. 709, row 0 at the top, as the file has it. Raises SceneError.

    what        : "a texture", "an environment map"
    formats     : the suffixes that it may have
    most_pixels : in all
    """
    if path.suffix.lower() not in formats:
        raise place.error(
            f"names {path}, but {what} is a file that ends in {', '.join(formats)}.", "Convert it, e.g. with GIMP."
        )
    if not os.path.isfile(path):  # unlike Path.is_file, also where the name is too long
        raise place.error(
            f"names the picture {path}, which {'is not a file' if os.path.exists(path) else 'does not exist'}.",
            nearby_files("Pictures", path, formats),
        )
    try:
        width, height = picture_size(path)
        if max(width, height) > MAX_TEXTURE_SIDE or width * height > most_pixels:
            raise place.error(
                f"names the picture {path} of {width:,} x {height:,} pixels, but {what} has at most "
                f"{MAX_TEXTURE_SIDE:,} pixels a side and {most_pixels:,} in all.",
                "Make the picture smaller, or cut out what is needed.",
            )
        return read_image(path)
    except ImageError as error:
        raise place.error(
            f"names a picture that cannot be used. {error}",
            "Open it in another program to see whether it is whole, and write it anew.",
        ) from error
