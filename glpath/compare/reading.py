"""Pictures to compare from whatever holds them: files, the bytes of files, Pillow's images.

Nothing visible is left out: palettes become their colours, transparency alpha, and a file of
several frames is refused.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glpath.compare.picture import Picture, encode_bright_srgb, glpath_texts
from glpath.errors import ImageError
from glpath.film.film import Film, holds_film, read_image
from glpath.film.image import READABLE, decode_srgb, read_exr_channels
from glpath.system.files import read_bytes, reading
from glpath.system.npz import check_unfolded, read_npy

if TYPE_CHECKING:
    from PIL.Image import Image

Float64 = NDArray[np.float64]

#: Formats read by Pillow; the rest of READABLE is radiance.
_BY_PILLOW = (".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tif", ".tiff", ".webp")

# Pillow's names of them, and of others that hold nothing but pixels. Some of its formats run other programs.
_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TIFF", "WEBP", "PPM", "TGA")

SUFFIXES = tuple(dict.fromkeys((*READABLE, *_BY_PILLOW)))

# Alpha of light that hides nothing.
_GLOW_ALPHA = 1e-6
_EXR_MAGIC = b"\x76\x2f\x31\x01"


def read_picture(path: str | Path) -> Picture:
    """The picture of a file, by its suffix, one of `SUFFIXES`: with noise where it is a film (.npz) or a baseline
    (.exr), with alpha where it has some. Raises ImageError."""
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
        read_image(path)  # says what is wrong with it
        with reading(path, suffix):
            return Picture.of_array(read_npy(path))
    return Picture.of_array(read_image(path))


def _straight(light: Float64, alpha: Float64) -> Float64:
    """Return (H, W, 4) with colours that are not multiplied by alpha, of an EXR's, which are.

    An EXR has light where alpha is 0, too, which is added to what is behind it, such as a flame. There alpha
    becomes so small that nothing behind it is hidden, and the colour so bright that `Picture.over` adds this light.
    """
    glows = (alpha == 0) & (light > 0).any(axis=-1)
    colours = light / np.where(alpha > 0, alpha, 1.0)[..., None]
    colours[glows] = decode_srgb(encode_bright_srgb(light[glows]) / _GLOW_ALPHA)
    return np.dstack([colours, np.where(glows, _GLOW_ALPHA, alpha)])


def picture_from_bytes(data: bytes) -> Picture:
    """The picture of a file's content: .exr, or what Pillow reads. Raises ImageError."""
    if not data.startswith(_EXR_MAGIC):
        return _by_pillow(data, f"{len(data)} bytes")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bytes.exr"
        path.write_bytes(data)
        return read_picture(path)


def is_pillow(value: object) -> bool:
    """Whether it is an image of Pillow, which is not imported here: the caller has done so."""
    module = sys.modules.get("PIL.Image")
    return module is not None and isinstance(value, module.Image)


def picture_of_pillow(image: Image) -> Picture:
    """The image's present frame, palettes as their colours. Raises ImageError."""
    return Picture.of_array(_array_of_pillow(image, "the image"))


def _by_pillow(data: bytes, name: str) -> Picture:
    from PIL import Image, UnidentifiedImageError

    with reading(name, "a picture"):
        try:
            image = Image.open(io.BytesIO(data), formats=_FORMATS)
        except UnidentifiedImageError as error:  # its own text names an object in memory
            why = "it is cut off, or of an unknown format"
            raise ImageError(f"{name}: cannot be read as a picture: {why}.") from error
        frames = getattr(image, "n_frames", 1)
        if frames > 1:
            raise ImageError(f"{name}: holds {frames} frames.", "Compare them one by one, as Pillow's images.")
        check_unfolded(image.width * image.height * len(image.getbands()), len(data))
        image.load()
        array = _array_of_pillow(image, name)
        texts = glpath_texts({str(key): value for key, value in image.info.items()})
    return Picture.of_array(array, texts)


def _array_of_pillow(image: Image, name: str) -> Any:
    if image.mode == "F":
        return np.asarray(image)
    if image.mode.startswith("I"):  # 16 bits of grey; also as 32-bit integers
        values = np.asarray(image)
        if values.min() < 0 or values.max() > 65535:
            raise ImageError(f"{name}: found integers from {values.min()} to {values.max()}, expected 16 bits.")
        return values.astype(np.uint16)
    try:
        return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    except ValueError as error:
        raise ImageError(f"{name}: is in Pillow's mode {image.mode}, which cannot be converted to RGB.") from error
