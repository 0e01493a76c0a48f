"""Images for comparison from files, the bytes of files, and Pillow images.

Nothing visible is ignored: palettes become colours, transparency becomes alpha, and a file with several frames is
rejected.
"""

from __future__ import annotations

import io
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glpath.compare.measures import check_same_size
from glpath.compare.picture import Picture, encode_bright_srgb, glpath_texts
from glpath.errors import ImageError
from glpath.film.exr import read_exr_channels
from glpath.film.film import Film, holds_film, read_image
from glpath.film.image import (
    READABLE,
    WEBP_HEAD,
    check_decoding,
    check_scans,
    picture_size,
    webp_size,
    without_size_warnings,
)
from glpath.system.arguments import checked
from glpath.system.colour import decode_srgb
from glpath.system.files import read_bytes, reading
from glpath.system.npz import FLOAT_PIXEL, check_unfolded, read_npy

if TYPE_CHECKING:
    from PIL.Image import Image

Float64 = NDArray[np.float64]

#: Suffixes of the formats read by Pillow; all other formats in READABLE contain radiance.
_BY_PILLOW = (".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tif", ".tiff", ".webp")

# Pillow's names of the formats it may open: these and others that contain only pixels. Some formats that it knows
# run other programs.
_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TIFF", "WEBP", "PPM", "TGA")

SUFFIXES = tuple(dict.fromkeys((*READABLE, *_BY_PILLOW)))

# Alpha given to pixels of an EXR that add light but hide nothing behind them.
_GLOW_ALPHA = 1e-6
_EXR_MAGIC = b"\x76\x2f\x31\x01"


@checked
def read_picture(path: str | Path) -> Picture:
    """Read the image of a file by its suffix, one of `SUFFIXES`. Raises ImageError.

    The result has noise if the file is a film (.npz) or a baseline (.exr). It may have alpha for any format.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in _BY_PILLOW:
        with reading(path, "a picture"):
            return _by_pillow(read_bytes(path), str(path))
    if holds_film(path):
        return Picture.of_film(Film.load(path))
    if suffix == ".exr":
        channels, header = read_exr_channels(path)
        if Picture.is_baseline(header):
            return Picture.load(path)
        image = read_image(path)
        if "A" in channels:
            image = _straight(image, channels["A"].astype(np.float64))
        return Picture.of_array(image, glpath_texts(header))
    if suffix == ".npy":
        read_image(path)  # raises an error if the file is invalid
        with reading(path, suffix):
            return Picture.of_array(read_npy(path))
    return Picture.of_array(read_image(path))


@checked
def check_sizes(path: str | Path, reference: str | Path) -> None:
    """Raise ImageError if two files have pictures of different sizes, by their headers alone.

    Other files than .exr, .hdr and those of Pillow are accepted, and so are files that cannot be read.
    """
    size, wanted = (_stored_size(Path(each)) for each in (path, reference))
    if size is not None and wanted is not None:
        check_same_size((*size[::-1], 3), (*wanted[::-1], 3))


def _stored_size(path: Path) -> tuple[int, int] | None:
    """Return the width and height of a picture from its header; None if they are not known."""
    from PIL import Image

    suffix = path.suffix.lower()
    with suppress(Exception):  # of any class, for a damaged file; `read_picture` reports it later
        if path.is_file() and suffix in (".exr", ".hdr"):  # a pipe can be read only once
            size = picture_size(path)
            return size.width, size.height
        if path.is_file() and suffix in _BY_PILLOW:
            with path.open("rb") as file:
                webp = webp_size(file.read(WEBP_HEAD))
            if webp is not None:
                return webp
            with without_size_warnings(), Image.open(path, formats=_FORMATS) as image:
                return image.size
    return None


def _straight(light: Float64, alpha: Float64) -> Float64:
    """Return (H, W, 4) with colours not multiplied by alpha. In an EXR, `light` is multiplied by alpha.

    An EXR may have light where alpha is 0, such as a flame. This light is added to the background. There alpha
    becomes so small that it hides nothing, and the colour so bright that `Picture.over` adds this light.
    """
    glows = (alpha == 0) & (light > 0).any(axis=-1)
    colours = light / np.where(alpha > 0, alpha, 1.0)[..., None]
    colours[glows] = decode_srgb(encode_bright_srgb(light[glows]) / _GLOW_ALPHA)
    return np.dstack([colours, np.where(glows, _GLOW_ALPHA, alpha)])


@checked
def picture_from_bytes(data: bytes) -> Picture:
    """Return the image from a file's content: .exr, or a format of Pillow. Raises ImageError."""
    if not data.startswith(_EXR_MAGIC):
        return _by_pillow(data, f"{len(data)} bytes")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bytes.exr"
        path.write_bytes(data)
        return read_picture(path)


def is_pillow(value: object) -> bool:
    """Return True for a Pillow image. Pillow is not imported here, because the caller has imported it."""
    module = sys.modules.get("PIL.Image")
    return module is not None and isinstance(value, module.Image)


@checked
def picture_of_pillow(image: Image) -> Picture:
    """Return the current frame of a Pillow image, with palette indices replaced by colours. Raises ImageError."""
    return Picture.of_array(_array_of_pillow(image, "the image"))


def _by_pillow(data: bytes, name: str) -> Picture:
    from PIL import Image, UnidentifiedImageError

    with reading(name, "a picture"):
        if (size := webp_size(data)) is not None:
            pixels = size[0] * size[1]
            check_unfolded(3 * pixels, len(data), FLOAT_PIXEL * pixels)
        try:
            with without_size_warnings():
                image = Image.open(io.BytesIO(data), formats=_FORMATS)
        except UnidentifiedImageError as error:  # Pillow's message would only name an object in memory
            why = "it is cut off, or of an unknown format"
            raise ImageError(f"{name}: cannot be read as a picture: {why}.") from error
        # Not `n_frames`, which takes quadratic time to count those of a TIFF.
        if getattr(image, "is_animated", False):
            raise ImageError(f"{name}: holds several frames.", "Compare them one by one, as Pillow's images.")
        pixels = image.width * image.height
        check_unfolded(pixels * len(image.getbands()), len(data), pixels * FLOAT_PIXEL)
        check_scans(data)
        check_decoding(image)
        image.load()
        array = _array_of_pillow(image, name)
        texts = glpath_texts({str(key): value for key, value in image.info.items()})
    return Picture.of_array(array, texts)


def _array_of_pillow(image: Image, name: str) -> Any:
    if image.mode == "F":
        return np.asarray(image)
    if image.mode.startswith("I"):  # 16-bit grey, which Pillow may hold as 32-bit integers
        values = np.asarray(image)
        if values.min() < 0 or values.max() > 65535:
            raise ImageError(f"{name}: found integers from {values.min()} to {values.max()}, expected 16 bits.")
        return values.astype(np.uint16)
    try:
        return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    except ValueError as error:
        raise ImageError(f"{name}: is in Pillow's mode {image.mode}, which cannot be converted to RGB.") from error
