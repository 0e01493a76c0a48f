"""Images: PNG, JPEG, WebP, BMP, GIF and TIFF by Pillow, KTX 2 by a library of the extra `ktx2`.

The size is read from the header before anything is decoded. As glTF demands, colour profiles, gamma and rotation
tags are ignored. Pillow reads 16-bit PNG images with 8 bits per channel, except grey ones.
"""

from __future__ import annotations

import io
import struct
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.film.image import check_scans, webp_size
from glpath.io.gltf import compression
from glpath.io.gltf.document import Document
from glpath.io.gltf.limits import MAX_TEXTURE_PIXELS, MAX_TEXTURE_SIDE
from glpath.io.gltf.table import Table
from glpath.io.pictures import BYTE_PIXEL, DECODING_PIXEL, stored_pixels
from glpath.scene.source_location import SourceLocation
from glpath.system.time_limit import check_time

KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
_FORMATS = {b"\x89PNG\r\n\x1a\n": "PNG", b"\xff\xd8\xff": "JPEG", KTX2: "KTX2"}
# Formats that glTF does not allow, but that other programs read in glTF files.
_FORMATS |= {b"BM": "BMP", b"GIF8": "GIF", b"II*\0": "TIFF", b"MM\0*": "TIFF"}
# Prefix of the names of Pillow's plugin module and image class for each format.
_PLUGINS = {"PNG": "Png", "JPEG": "Jpeg", "WEBP": "WebP", "BMP": "Bmp", "GIF": "Gif", "TIFF": "Tiff"}
_OTHERS = {
    b"DDS ": "DDS",
    b"\x76\x2f\x31\x01": "EXR",
}


class UnknownFormatError(SceneError):
    """Error for an image of a format that is not read.

    found : what the image is, and what it must be
    """

    found = ""


def read_image(document: Document, index: int) -> NDArray[Any]:
    """Return the (h, w, 3) or, with alpha, (h, w, 4) uint8 pixels, row 0 at the top; uint16 for 16-bit grey images.

    An image is decoded once. Raises SceneError for an image that is missing, broken, too large, or of another
    format.
    """
    if index not in document.images:
        document.images[index] = _read_image(document, document.all("images")[index])
    return document.images[index]


def _read_image(document: Document, table: Table) -> NDArray[Any]:
    check_time()
    data = _stored(document, table)
    kind = _format(data)
    if kind is None:
        found = next((name for magic, name in _OTHERS.items() if data.startswith(magic)), "of no format known here")
        text = f"is {found}, but must be PNG, JPEG, WebP, BMP, GIF, TIFF or KTX 2"
        error = UnknownFormatError(f"{table.location} {text}.", "Convert it, and export the file anew.")
        error.found = text
        raise error
    try:
        width, height, channels = _size(data, kind)
    except Exception as error:  # Pillow's parsers raise all kinds of exceptions
        raise _broken(table.location, error) from error
    if not (
        0 < width <= MAX_TEXTURE_SIDE and 0 < height <= MAX_TEXTURE_SIDE and width * height <= MAX_TEXTURE_PIXELS
    ):
        raise table.location.error(
            f"has {width:,} x {height:,} pixels, but a texture has at most {MAX_TEXTURE_SIDE:,} a side and "
            f"{MAX_TEXTURE_PIXELS:,} in all.",
            "Make the image smaller.",
        )
    document.take(4 * width * height, table.location)
    try:
        decoding = DECODING_PIXEL.get(kind, BYTE_PIXEL) * width * height
        document.unfolded.add(channels * width * height, len(data), decoding)
    except ValueError as error:
        raise _broken(table.location, error) from error
    if kind == "KTX2":
        return compression.ktx2(data, table.location)
    try:
        pixels = _pixels(data, kind)
    except Exception as error:  # Pillow's decoders raise all kinds of exceptions
        raise _broken(table.location, error) from error
    document.take(max(0, pixels.nbytes - 4 * width * height), table.location)
    return pixels


def _stored(document: Document, table: Table) -> bytes:
    uri = table.text("uri")
    if uri is not None:
        return document.resolve(uri, table.location.field("uri"), is_picture=True)
    return bytes(document.view(table.required_index("bufferView", document.all("bufferViews"), "buffer views")))


def _format(data: bytes) -> str | None:
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WEBP"
    return next((name for magic, name in _FORMATS.items() if data.startswith(magic)), None)


def _size(data: bytes, kind: str) -> tuple[int, int, int]:
    """Return width, height and number of channels; for KTX 2, bytes per compressed pixel instead of channels."""
    if kind == "KTX2":
        return *struct.unpack_from("<II", data, 20), 1
    if (size := webp_size(data)) is not None:
        return *size, 3
    with _opened(data, kind) as opened:
        return int(opened.size[0]), int(opened.size[1]), len(opened.getbands())


def _pixels(data: bytes, kind: str) -> NDArray[Any]:
    check_scans(data)
    with _opened(data, kind) as opened:
        pixels = stored_pixels(opened)
    if pixels.dtype == np.float32:
        raise ValueError("its pixels are floats, but those of glTF are whole numbers")
    return pixels


def _opened(data: bytes, kind: str) -> Any:
    """Open an image with Pillow without reading its pixels."""
    # Image.open would refuse images beyond its own limit without reporting their size.
    plugin = import_module(f"PIL.{_PLUGINS[kind]}ImagePlugin")
    return getattr(plugin, f"{_PLUGINS[kind]}ImageFile")(io.BytesIO(data))


def _broken(location: SourceLocation, error: Exception) -> Exception:
    return location.error(
        f"is an image that cannot be read: {type(error).__name__}: {error}.",
        "Open it in another program to see whether it is whole, and write it anew.",
    )
