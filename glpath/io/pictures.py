"""Read the pictures of a model, which are files in its folder [Pillow, OpenEXR] or Pillow images in memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, ImageError, TimeLimitError, warning_filter
from glpath.film.image import WEBP_HEAD, check_decoding, check_scans, picture_size, read_texture, webp_size
from glpath.io.description import MAX_TEXTURE_PIXELS, MAX_TEXTURE_SIDE
from glpath.io.named_files import NamedFiles, UnusableError
from glpath.system.bounded_reading import reading_file
from glpath.system.files import check_file, reason_of
from glpath.system.npz import UnfoldedPictures

Image = NDArray[np.uint8] | NDArray[np.float32]
# Formats that are read, by Pillow's names. Others are seldom used for textures, and for some Pillow runs programs.
_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "TIFF", "WEBP", "GIF")
# TIFF tag BitsPerSample.
_BITS_TAG = 258
# TIFF tag PhotometricInterpretation.
_PHOTOMETRIC_TAG = 262
#: Bytes of memory for a pixel of 8 bits per channel while it is decoded, by Pillow's name of the format. Pillow's
#: decoder of WebP holds several copies of a picture.
DECODING_PIXEL = {"WEBP": 16}
#: The same for other formats.
BYTE_PIXEL = 4
# Number of pixels that are converted at once.
_STRIP_PIXELS = 1 << 20
#: Maximum memory of all pictures of a model together, in bytes.
MAX_BYTES = 2**33


@dataclass
class Pictures:
    """Pictures of one model; each is read once.

    files    : finder of the files, with notes on those that are not used
    unfolded : sizes of the pictures that were decoded
    """

    folder: Path
    files: NamedFiles = field(default_factory=NamedFiles)
    unfolded: UnfoldedPictures = field(default_factory=UnfoldedPictures)
    _known: dict[Path, Image | UnusableError] = field(default_factory=dict)
    _bytes: int = 0

    def picture(self, name: str) -> Image | None:
        """Return a picture as `read` does; None, with a note in `files`, if it cannot be used."""
        try:
            return self.read(name)
        except UnusableError as error:
            self.files.unusable[name] = str(error)
            return None

    def read(self, name: str) -> Image:
        """Return the pixels of a picture, (h, w, 3) or with alpha (h, w, 4).

        Pixels are uint8, or linear float32 in EXR and float TIFF files. Raises UnusableError.
        """
        path = self.files.find(self.folder, name)
        if path not in self._known:
            try:
                with reading_file(path.name):
                    self._known[path] = self._pixels(path)
            except UnusableError as error:
                self._known[path] = error
        found = self._known[path]
        if isinstance(found, UnusableError):
            raise found
        return found

    def _pixels(self, path: Path) -> Image:
        with unusable_if_damaged():
            check_file(path)
            if path.suffix.lower() == ".exr":
                size = picture_size(path, display=True)
                self._check(path, size.width, size.height, 4 * size.channels, 4 * BYTE_PIXEL)
                return read_texture(path, alpha=True).astype(np.float32)
            with path.open("rb") as file:
                webp = webp_size(file.read(WEBP_HEAD))
            if webp is not None:
                self._check(path, *webp, 3, DECODING_PIXEL["WEBP"])
            import PIL.Image

            # The filter hides warnings about odd tags, and about many pixels, which `_check` limits.
            with warning_filter("ignore"), PIL.Image.open(path, formats=_FORMATS) as opened:
                if opened.format in ("JPEG", "MPO"):
                    check_scans(path.read_bytes())
                bytes_each = 4 if opened.mode == "F" else 1
                if webp is None:
                    bands = len(opened.getbands())
                    self._check(path, *opened.size, bands * bytes_each, BYTE_PIXEL * bytes_each)
                return pixels_of(opened)

    def _check(self, path: Path, width: int, height: int, pixel: int, decoding_pixel: int) -> None:
        """Raise UnusableError or ValueError if a picture is too large.

        pixel          : bytes of a pixel as stored, but uncompressed
        decoding_pixel : bytes of memory for a pixel while it is decoded
        """
        decoded = decoding_pixel * width * height
        self._bytes += decoded
        if max(width, height) > MAX_TEXTURE_SIDE or width * height > MAX_TEXTURE_PIXELS:
            raise UnusableError(
                f"of {width:,} x {height:,} pixels, more than {MAX_TEXTURE_SIDE:,} a side or "
                f"{MAX_TEXTURE_PIXELS:,} in all"
            )
        if self._bytes > MAX_BYTES:
            raise UnusableError(f"which brings the pictures of the model beyond {MAX_BYTES:,} bytes")
        self.unfolded.add(pixel * width * height, path.stat().st_size, decoded)


@contextmanager
def unusable_if_damaged() -> Iterator[None]:
    """Context in which errors of reading a picture become UnusableError, except that of a time limit."""
    try:
        yield
    except (UnusableError, TimeLimitError):
        raise
    except GlpathError as error:
        raise UnusableError(f"which cannot be read: {error.message}") from error
    except Exception as error:  # Pillow's parsers may raise anything
        raise UnusableError(f"which cannot be read: {type(error).__name__}: {reason_of(error)}") from error


def pixels_of(opened: Any) -> Image:
    """Return the pixels of a Pillow image, (h, w, 3) or with alpha (h, w, 4).

    16-bit values become 8-bit values; floats are linear. Raises ImageError as `stored_pixels` does.
    """
    pixels = stored_pixels(opened)
    return (pixels >> 8).astype(np.uint8) if pixels.dtype == np.uint16 else pixels


def stored_pixels(opened: Any) -> NDArray[Any]:
    """Return the pixels of a Pillow image as stored, (h, w, 3) or with alpha (h, w, 4).

    Pixels are uint8; those of grey images may be uint16 or float32. Raises ImageError if there are none,
    if the number that means white is unknown, and for floats that are not finite.
    """
    check_decoding(opened)
    if opened.mode != "F" and not opened.mode.startswith("I"):
        alpha = opened.mode.endswith("A") or "transparency" in opened.info
        return _bytes_of(opened, "RGBA" if alpha else "RGB")
    grey = np.asarray(opened)
    _check_range(opened, grey)
    if opened.mode == "F":
        return np.repeat(grey.astype(np.float32)[..., None], 3, axis=2)
    channels = [grey.astype(np.uint16)] * 3
    if isinstance(transparent := opened.info.get("transparency"), int):
        channels.append(np.where(grey == transparent, 0, 65535).astype(np.uint16))
    return np.stack(channels, axis=2)


def _bytes_of(opened: Any, mode: str) -> NDArray[np.uint8]:
    """Return the pixels of a Pillow image in a mode, converted in strips, because Pillow makes several copies."""
    opened.load()
    pixels = np.empty((opened.height, opened.width, len(mode)), np.uint8)
    rows = max(1, _STRIP_PIXELS // opened.width)
    for top in range(0, opened.height, rows):
        strip = opened.crop((0, top, opened.width, min(top + rows, opened.height)))
        pixels[top : top + rows] = strip.convert(mode)
    return pixels


def _check_range(opened: Any, grey: NDArray[Any]) -> None:
    """Raise ImageError unless grey pixels are integers from 0, black, to 65535, white, or finite floats."""
    convert = "Convert it to grey of 8 or 16 bits, of which 0 is black."
    if opened.mode == "F" and not np.isfinite(grey).all():
        raise ImageError("some of its pixels are NaN or infinite", convert)
    if opened.format == "TIFF":
        bits, white_is_zero = opened.tag_v2.get(_BITS_TAG, (1,))[0], opened.tag_v2.get(_PHOTOMETRIC_TAG) == 0
        if white_is_zero or (opened.mode[:4], bits) not in (("F", 32), ("I;16", 16)):
            kind = "for which 0 is white" if white_is_zero else "for which it is not known which is white"
            raise ImageError(f"its pixels are numbers of {bits} bits {kind}", convert)
    elif opened.mode.startswith("I") and (grey.min() < 0 or grey.max() > 65535):
        raise ImageError(f"its pixels are from {grey.min():,} to {grey.max():,}, not from 0 to 65,535", convert)


def resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a grey image (h, w) scaled to another size (height, width)."""
    if image.shape == size:
        return image
    import PIL.Image

    return np.asarray(PIL.Image.fromarray(image).resize(size[::-1], PIL.Image.Resampling.BILINEAR), np.uint8)
