"""Images as plain arrays: reading files of all formats, and writing PNG and JPEG."""

from __future__ import annotations

import base64
import html
import io
import json
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError, UsageError, warning_filter
from glpath.film.exr import exr_header, read_exr, window_of
from glpath.film.rgbe import read_header, read_rgbe
from glpath.system.arguments import check_texts, checked
from glpath.system.colour import decode_levels, decode_srgb, matrix_to_rec709
from glpath.system.files import check_file, reading, whole_file
from glpath.system.npz import FLOAT_PIXEL, check_unfolded, open_npz, read_npy

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = ["encode_png", "read_image", "write_png"]

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

# Maximum number of pixels along a side of a JPEG.
_MAX_JPEG = 65_535
# Maximum number of bytes of a comment in a JPEG.
_MAX_COMMENT = 65_000
# Quality of JPEGs, out of 100.
_JPEG_QUALITY = 95
# JPEG: pattern of markers other than restart markers; code of the end of the image; code of the start of a scan.
_JPEG_MARKER, _END_OF_IMAGE, _START_OF_SCAN = re.compile(rb"\xff([\x02-\xcf\xd8-\xfe])"), b"\xd9", b"\xda"
# JPEG: maximum number of scans. A scan of a few bytes may cover all pixels, so many scans are slow to decode.
# libtiff has this limit, too.
_MAX_SCANS = 100
# TIFF tags of the width and height of tiles, and number of pixels up to which any tile is read.
_TILE_WIDTH, _TILE_HEIGHT, _LARGE_TILE = 322, 323, 1 << 22
# Maximum number of pixels of a BMP whose pixels are stored as run lengths.
_RUN_LENGTH_PIXELS = 1 << 22
#: Number of bytes at the start of a WebP file that hold its size.
WEBP_HEAD = 30
# Bytes of memory for a pixel that is decoded to 8 bits per channel.
_BYTE_PIXEL = 4
# Shapes of the channels of an image that is encoded as a PNG: grey, grey with alpha, colours, colours with alpha.
_CHANNELS = ((), (2,), (3,), (4,))
READABLE = (".png", ".jpg", ".jpeg", ".exr", ".hdr", ".npz", ".npy")


@checked
def encode_png(picture: UInt8, metadata: Mapping[str, str] | None = None) -> bytes:
    """Encode (H, W, 3) uint8 sRGB, or (H, W, 4) with alpha, as the bytes of a PNG.

    metadata : written as text chunks

    Raises ImageError for an array of another shape or type.
    """
    # Pillow is used directly, because imageio first loads all of Pillow's formats. For a small image, loading takes
    # a tenth of the total time.
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture = np.asarray(picture)
    allowed = _CHANNELS if picture.dtype == np.uint8 else ((),) if picture.dtype == np.bool_ else ()
    if picture.ndim < 2 or picture.shape[2:] not in allowed or not picture.size:
        raise ImageError(
            f"image: found an array of shape {picture.shape} of {picture.dtype}, expected (H, W, 3) of uint8.",
            "glpath.film.tonemap.tonemap makes an 8-bit image of radiance.",
        )
    check_texts(metadata)
    text, encoded = PngInfo(), io.BytesIO()
    for key, value in (metadata or {}).items():
        text.add_text(key, value)
    Image.fromarray(picture).save(encoded, "PNG", pnginfo=text)
    return encoded.getvalue()


def png_html(png: bytes, alt: str) -> str:
    """Return a PNG as HTML with a text alternative, because JupyterLab shows none for a plain PNG."""
    data = base64.b64encode(png).decode()
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}" style="max-width: 100%">'


@checked
def write_png(path: str | Path, picture: UInt8, metadata: Mapping[str, str] | None = None) -> None:
    """Write (H, W, 3) uint8 sRGB, or (H, W, 4) with alpha, row 0 at the top, as a PNG. Raises ImageError."""
    with whole_file(path) as temporary:
        temporary.write_bytes(encode_png(picture, metadata))


def over_white(picture: UInt8) -> UInt8:
    """Return an 8-bit image (H, W, 3); transparent pixels of (H, W, 4) become white."""
    if picture.shape[2] == 3:
        return picture
    opacity = picture[..., 3:] / 255.0
    return np.round(opacity * picture[..., :3] + 255.0 * (1.0 - opacity)).astype(np.uint8)


def write_jpeg(path: str | Path, picture: UInt8, metadata: Mapping[str, str] | None = None) -> None:
    """Write (H, W, 3) uint8 sRGB, row 0 at the top, as a JPEG. Transparent pixels of (H, W, 4) become white.

    metadata : written as JSON into the comment, or left out if it is too long for a comment

    Raises ImageError if the file cannot be written, and UsageError if the image is too large for a JPEG.
    """
    from PIL import Image

    height, width = picture.shape[:2]
    if max(height, width) > _MAX_JPEG:
        raise UsageError(
            f"{path}: {width} x {height} pixels; a JPEG has {_MAX_JPEG:,} along a side at most.", "Write a .png."
        )
    comment = json.dumps(dict(metadata or {})).encode()
    if len(comment) > _MAX_COMMENT:
        comment = b""
    with whole_file(path) as temporary:
        Image.fromarray(over_white(picture)).save(
            temporary,
            "JPEG",
            quality=_JPEG_QUALITY,
            subsampling=0,
            comment=comment,
        )


@checked
def read_image(path: str | Path, colours: bool = True) -> Float64:
    """Read an image file that is not a film; `glpath.film.film.read_image` lists the formats and the result.

    colours : True to convert an .exr or .hdr with other primaries to Rec. 709; False for data that are not
              colours, such as normals
    """
    return _read(path, colours).astype(np.float64, copy=False)


def read_environment(path: str | Path, display: bool = True) -> NDArray[np.float32]:
    """Read an image file as (H, W, 3) float32. For an .hdr, this needs less memory than `read_image`.

    display : True to crop an .exr, or to pad it with zeros, to its display window
    """
    with np.errstate(over="ignore"):  # values that float32 cannot hold become infinite
        return _read(path, True, display=display).astype(np.float32, copy=False)


@checked
def read_texture(path: str | Path, colours: bool = True, alpha: bool = False) -> Float64:
    """Read an image file as `read_image` does, but an .exr cropped, or padded with zeros, to its display window.

    alpha : True to return (H, W, 4) for an .exr with alpha
    """
    return _read(path, colours, display=True, alpha=alpha).astype(np.float64, copy=False)


def _read(path: str | Path, colours: bool, display: bool = False, alpha: bool = False) -> NDArray[Any]:
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise ImageError(
            f"{path}: cannot read a {suffix or 'file without a suffix'}. Allowed: {', '.join(READABLE)}."
        )
    with reading(path, suffix):
        check_file(path)
        if suffix == ".exr":
            return _three_channels(read_exr(path, colours, display, alpha), alpha)
        if suffix == ".hdr":
            return _three_channels(_read_hdr(path, colours))
        return _three_channels(_READERS[suffix](path))


def read_eight_bits(path: str | Path) -> UInt8 | None:
    """Read the 8-bit pixels of a .png or .jpg as (H, W, 3), or (H, W, 4) with alpha, row 0 at the top.

    Returns None for other formats, and for images that Pillow opens with more than 8 bits per channel. Raises
    ImageError if the file cannot be read.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        return None
    with reading(path, suffix):
        check_file(path)
        _check_pillow(path, suffix, _BYTE_PIXEL)
        with png_or_jpeg(path) as opened:
            if opened.mode.startswith(("I", "F")):
                return None
            alpha = "A" in opened.getbands() or "transparency" in opened.info
            return np.asarray(opened.convert("RGBA" if alpha else "RGB"), np.uint8)


class PictureSize(NamedTuple):
    """Size of a picture, read from the header of its file.

    width, height : pixels
    channels      : number of channels
    channel_bytes : bytes per pixel and channel, uncompressed
    """

    width: int
    height: int
    channels: int
    channel_bytes: int


def picture_size(path: str | Path, display: bool = False) -> PictureSize:
    """Read the size of a .png, .jpg, .exr or .hdr from its header. Raises ImageError.

    display : True for the larger of the data window and the display window of an .exr, False for the data window
    """
    path = Path(path)
    suffix = path.suffix.lower()
    with reading(path, suffix):
        check_file(path)
        if suffix == ".exr":
            (height, width), header = exr_header(path)
            if display:
                (left, top), (right, bottom) = window_of(header, "displayWindow")
                width, height = max(width, right - left + 1), max(height, bottom - top + 1)
            return PictureSize(width, height, len(header["channels"]), 4)
        if suffix == ".hdr":
            with path.open("rb") as file:
                return PictureSize(*read_header(file).size, 4, 1)
        return PictureSize(*_pillow_header(path), 1)


def png_or_jpeg(path: Path) -> ImageFile:
    """Return an open PNG or JPEG file, by its suffix, of which only the header is read.

    `Image.open` is avoided: it rejects images above a limit of its own, without reporting their size.
    """
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    return (PngImageFile if path.suffix.lower() == ".png" else JpegImageFile)(path)


def _pillow_header(path: Path) -> tuple[int, int, int]:
    with png_or_jpeg(path) as opened:
        return *opened.size, len(opened.getbands())


def _check_pillow(path: Path, suffix: str, pixel_bytes: int) -> None:
    """Raise ValueError if the file is too small for its pixels, or if it is a JPEG with too many scans."""
    width, height, channels = _pillow_header(path)
    check_unfolded(width * height * channels, path.stat().st_size, width * height * pixel_bytes)
    if suffix != ".png":
        check_scans(path.read_bytes())


@contextmanager
def without_size_warnings() -> Iterator[None]:
    """Context without Pillow's warnings of many pixels, because `check_unfolded` limits them."""
    from PIL import Image

    with warning_filter("ignore", Image.DecompressionBombWarning):
        yield


def webp_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height from the first chunk of a WebP file [RFC 9649]; None for other formats.

    Pillow would allocate all pixels to read the size. Raises ValueError for a broken file.

    data : the first WEBP_HEAD bytes of the file, or more
    """
    if data[:4] != b"RIFF" or data[8:12] != b"WEBP":
        return None
    if len(data) < WEBP_HEAD:
        raise ValueError("it is cut off")
    chunk = data[12:16]
    if chunk == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if chunk == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if chunk == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    raise ValueError(f"its first chunk is {chunk!r}")


def check_scans(data: bytes) -> None:
    """Raise ValueError for a JPEG with implausibly many scans (passes over the image); other formats are accepted.

    Source: ITU-T T.81, annex B.
    """
    scans = position = 0
    while data.startswith(b"\xff\xd8") and (marker := _JPEG_MARKER.search(data, max(position, 2))):
        if marker[1] == _END_OF_IMAGE:
            break
        scans += marker[1] == _START_OF_SCAN
        if scans > _MAX_SCANS:
            raise ValueError(f"it is a JPEG of more than {_MAX_SCANS} scans")
        position = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2])


def check_decoding(opened: Any) -> None:
    """Raise ImageError for a picture without pixels, or one that takes much more memory or time than its pixels."""
    pixels = opened.width * opened.height
    if not pixels:
        raise ImageError(f"it has {opened.width} x {opened.height} pixels", "Write it anew.")
    if opened.format == "TIFF":
        width, height = (int(opened.tag_v2.get(tag, 0)) for tag in (_TILE_WIDTH, _TILE_HEIGHT))
        if width * height > max(_LARGE_TILE, 4 * pixels):  # a tile is decoded as a whole
            raise ImageError(
                f"its tiles of {width:,} x {height:,} pixels are larger than the picture of {pixels:,}",
                "Write it anew.",
            )
    run_lengths = any(tile[0] == "bmp_rle" for tile in getattr(opened, "tile", ()))
    if run_lengths and pixels > _RUN_LENGTH_PIXELS:  # Pillow's decoder takes 0.1 us per pixel
        raise ImageError(f"it is a BMP of run lengths with {pixels:,} pixels", "Write it without compression.")


def _read_png(path: Path) -> Float64:
    import imageio.v3 as iio

    _check_pillow(path, ".png", FLOAT_PIXEL)
    with without_size_warnings():
        stored = iio.imread(path, plugin="pillow", index=0)  # the first frame of an animation
    if stored.dtype == np.bool_:  # images of one bit
        stored = stored * np.uint8(255)
    return decode_levels(stored) if stored.dtype == np.uint8 else decode_srgb(stored / np.iinfo(stored.dtype).max)


def _read_jpeg(path: Path) -> Float64:
    import imageio.v3 as iio

    _check_pillow(path, ".jpg", FLOAT_PIXEL)
    with without_size_warnings():
        # Converted, as a JPEG may be CMYK. The first picture, as the format MPO holds several.
        return decode_levels(iio.imread(path, plugin="pillow", index=0, mode="RGB"))


def _read_hdr(path: Path, convert: bool = True) -> NDArray[np.float32]:
    colours, primaries = read_rgbe(path)
    matrix = None if primaries is None or not convert else matrix_to_rec709(primaries)
    return colours if matrix is None else colours @ matrix.T.astype(np.float32)


def _read_npz(path: Path) -> Float64:
    with open_npz(path, ".npz") as stored:
        if "radiance" in stored:
            return stored.read("radiance", "biuf", decoded_bytes=8).astype(np.float64)
        raise ValueError(f"found {', '.join(stored.names) or 'nothing'}, expected `radiance`, or a film's sums")


def _read_npy(path: Path) -> Float64:
    return read_npy(path).astype(np.float64)


_READERS: dict[str, Callable[[Path], Float64 | NDArray[np.float32]]] = {
    ".png": _read_png,
    ".jpg": _read_jpeg,
    ".jpeg": _read_jpeg,
    ".exr": read_exr,
    ".hdr": _read_hdr,
    ".npz": _read_npz,
    ".npy": _read_npy,
}


def _three_channels(image: NDArray[Any], alpha: bool = False) -> NDArray[Any]:
    """Return the image as (H, W, 3), or with alpha (H, W, 4). Grey is repeated in three channels.

    Raises ValueError for an array of another shape, and for pixels that are NaN or infinite.
    """
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4) or image.size == 0:
        raise ValueError(f"found an array of shape {image.shape}, expected (H, W, 3)")
    three = np.repeat(image[..., :1], 3, axis=2) if image.shape[2] < 3 else image[..., : 4 if alpha else 3]
    broken = np.count_nonzero(~np.isfinite(three).all(axis=-1))
    if broken:
        raise ValueError(f"{broken} of its {three.shape[0] * three.shape[1]} pixels are NaN or infinite")
    return three
