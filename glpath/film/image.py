"""Images as plain arrays: tone mapping, and reading and writing PNG, EXR and other formats.

Sources: IEC 61966-2-1 (sRGB); Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images"; Narkowicz
         2015, "ACES Filmic Tone Mapping Curve".
"""

from __future__ import annotations

import base64
import html
import io
import json
import mmap
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import ImageError, UsageError, warning_filter
from glpath.film.aovs import AOV_KINDS
from glpath.film.rgbe import read_header, read_rgbe
from glpath.system.arguments import checked, short_repr
from glpath.system.c_output import without_lines
from glpath.system.files import check_file, reading, whole_file
from glpath.system.npz import check_unfolded, open_npz, read_npy
from glpath.system.time_limit import in_command

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = [
    "auto_exposure",
    "decode_srgb",
    "encode_png",
    "encode_srgb",
    "luminance",
    "read_image",
    "tonemap",
    "write_exr",
    "write_png",
]

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
# Bytes of memory for a pixel that is decoded to three float64.
FLOAT_PIXEL = 24
# Bytes of memory for a pixel that is decoded to 8 bits per channel.
_BYTE_PIXEL = 4
# OpenEXR: maximum number of attributes and channels in all parts of a file together.
_MAX_EXR_ENTRIES = 4096
# OpenEXR: maximum size of a position in a window, pixels.
_MAX_EXR_EDGE = 2**30
# OpenEXR: maximum aspect of a pixel, and of its reciprocal.
_MAX_EXR_ASPECT = 1e6
# OpenEXR: maximum length of a name or a type, bytes.
_MAX_EXR_NAME = 255
# OpenEXR: pattern of one entry of the channel list: a name, a zero byte, and 16 bytes of numbers.
_EXR_CHANNEL = re.compile(rb"[^\0]{1,255}\0.{16}", re.DOTALL)
# Shapes of the channels of an image that is encoded as a PNG: grey, grey with alpha, colours, colours with alpha.
_CHANNELS = ((), (2,), (3,), (4,))
READABLE = (".png", ".jpg", ".jpeg", ".exr", ".hdr", ".npz", ".npy")

# Weights of red, green and blue of linear Rec. 709 in the luminance Y.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Primaries and white point (D65) of Rec. 709 for an EXR header: x and y of red, green, blue and white.
REC709_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)

# Chromaticities (x or y) that differ by less than this count as equal, because other programs round them.
_SAME_CHROMATICITY = 1e-3
# Bradford's matrix from XYZ to cone responses.
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

# Luminance that Reinhard's operator maps to white. It is fixed and not the image's maximum, so that a crop and the
# frames of a series have the same brightness.
REINHARD_WHITE = 4.0


# Maximum size of an exposure, stops. 2 to the power of 1,000 is a finite float64.
_MAX_STOPS = 1000
# Log-average luminance, called middle grey, to which `auto_exposure` brings an image.
MIDDLE_GREY = 0.18


@checked
def luminance(radiance: Float64) -> Float64:
    """Return the relative luminance Y (...) of linear Rec. 709 colours (..., 3). Raises ImageError."""
    _check_colours(radiance)
    y: Float64 = radiance @ LUMINANCE
    return y


def _check_colours(colours: ArrayLike) -> None:
    """Raise ImageError unless the last axis of an array is red, green and blue."""
    if np.shape(colours)[-1:] != (3,):
        raise ImageError(
            f"image: found an array of shape {np.shape(colours)}, expected (..., 3): red, green and blue.",
            "np.repeat(grey[..., None], 3, axis=-1) makes colours of grey values.",
        )


def _numbers(values: ArrayLike) -> NDArray[Any]:
    """Return an array; objects become float64, and other types do not change."""
    array = np.asarray(values)
    return array.astype(np.float64) if array.dtype == np.object_ else array


@checked
def encode_srgb(linear: Float64) -> Float64:
    """Return linear values, clipped to [0, 1], as sRGB in [0, 1] (IEC 61966-2-1)."""
    x: Float64 = np.clip(_numbers(linear), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


@checked
def decode_srgb(encoded: Float64) -> Float64:
    """Return sRGB in [0, 1] as linear values in [0, 1]."""
    encoded = _numbers(encoded)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def decode_levels(levels: NDArray[np.uint8]) -> Float64:
    """Return 8-bit sRGB as linear values in [0, 1], from a table; bit-identical to `decode_srgb(levels / 255)`."""
    return _of_levels()[levels]


@cache
def _of_levels() -> Float64:
    return decode_srgb(np.arange(256) / 255)


def _reinhard(radiance: Float64) -> Float64:
    """Return radiance with Reinhard's equation 4 (2002) applied to its luminance; the colour does not change."""
    y = luminance(radiance)[..., None]
    return radiance * (1.0 + y / REINHARD_WHITE**2) / (1.0 + y)


def _aces(radiance: Float64) -> Float64:
    """Return Narkowicz's fit (2015) of the ACES reference curve for each channel, so that highlights turn white."""
    x = radiance
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


# Maximum radiance after exposure, so that no tone curve overflows; each is white long before.
_MAX_LIGHT = 1e30

# Tone curves by name (`choices.TONEMAP_NAMES`). Each maps radiance after exposure to linear display values, which
# are then clipped to [0, 1].
TONEMAPS: dict[str, Callable[[Float64], Float64]] = {
    "srgb": lambda radiance: radiance,
    "reinhard": _reinhard,
    "aces": _aces,
}


@checked
def tonemap(radiance: ArrayLike, exposure: float = 0.0, operator: str = "srgb") -> UInt8:
    """Return radiance as an image for a screen.

    Parameters
    ----------
    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709
    exposure : stops; 1 doubles the brightness
    operator : "srgb" clips, "reinhard" and "aces" compress bright values; the sRGB curve is applied afterwards

    Returns (H, W, 3) uint8, sRGB. Raises UsageError for another operator and for stops beyond 1,000 in size;
    ImageError for an array of another shape.

    Example
    -------
    >>> tonemap([[[0.0, 0.18, 1.0]]]).tolist()
    [[[0, 118, 255]]]
    """
    check_tonemap(operator)
    if not abs(exposure) <= _MAX_STOPS:
        raise UsageError(
            f"exposure: {short_repr(exposure)} where stops from -{_MAX_STOPS:,} to {_MAX_STOPS:,} are needed"
        )
    _check_colours(radiance)
    with np.errstate(over="ignore"):
        light = np.maximum(np.asarray(radiance, np.float64), 0.0) * np.exp2(exposure)
    light = np.minimum(light, _MAX_LIGHT)
    return (encode_srgb(TONEMAPS[operator](light)) * 255.0 + 0.5).astype(np.uint8)


@checked
def auto_exposure(radiance: ArrayLike) -> float:
    """Return the stops that bring the log-average luminance to middle grey, 0.18 [Reinhard et al. 2002].

    Equations 1 and 2 of the paper give the average. Black pixels are ignored, because black surroundings are no
    reason to brighten an object. Other pixels count as at least a thousandth of the median. An image is darkened
    only until its 99th percentile is white, so that a bright image stays bright. The stops are rounded to quarters,
    so that noise does not change them. They are 0 for a black image.

    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709

    >>> auto_exposure([[[0.09, 0.09, 0.09], [0, 0, 0]]]), auto_exposure([[[0.5, 0.5, 0.5]]])
    (1.0, 0.0)
    """
    y = luminance(np.asarray(radiance, np.float64))
    lit = y[y > 0.0]
    if not lit.size:
        return 0.0
    key = float(np.exp(np.mean(np.log(np.maximum(lit, 1e-3 * np.median(lit))))))
    white = max(float(np.percentile(y, 99)), 1e-300)  # the percentile is 0 if less than 1 % of the pixels are lit
    wanted, to_white = np.log2(MIDDLE_GREY / key), -np.log2(white)
    return float(np.round(4.0 * max(wanted, min(0.0, to_white))) / 4.0) + 0.0


def check_exposure(exposure: object) -> None:
    """Raise UsageError unless the exposure is None, "auto", or a number of stops from -100 to 100."""
    if exposure is None or exposure == "auto":
        return
    if isinstance(exposure, bool) or not isinstance(exposure, int | float) or not abs(exposure) <= 100:
        raise UsageError(
            f'exposure is {short_repr(exposure)}; must be a number of stops from -100 to 100, or "auto".'
        )


def check_tonemap(operator: str) -> None:
    """Raise UsageError if there is no tone curve with that name."""
    if not isinstance(operator, str) or operator not in TONEMAPS:
        raise UsageError(f"tonemap: there is no operator {short_repr(operator)}. Allowed: {', '.join(TONEMAPS)}.")


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
            "glpath.film.image.tonemap makes an 8-bit image of radiance.",
        )
    _check_texts(metadata)
    text, encoded = PngInfo(), io.BytesIO()
    for key, value in (metadata or {}).items():
        text.add_text(key, value)
    Image.fromarray(picture).save(encoded, "PNG", pnginfo=text)
    return encoded.getvalue()


def _check_texts(metadata: Mapping[str, str] | None) -> None:
    """Raise UsageError unless all metadata are text that UTF-8 can encode, with keys in Latin-1 as in a PNG."""
    for key, value in (metadata or {}).items():
        try:
            key.encode("latin-1")
            value.encode()
        except (AttributeError, UnicodeEncodeError):
            raise UsageError(
                f"metadata[{short_repr(key)}]: {short_repr(value)} where text is needed, with a key in Latin-1"
            ) from None


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
def write_exr(
    path: str | Path,
    radiance: ArrayLike,
    metadata: Mapping[str, str] | None = None,
    *,
    window: tuple[int, int, int, int] | None = None,
    full_resolution: tuple[int, int] | None = None,
    pixel_aspect: float = 1.0,
    layers: Mapping[str, NDArray[Any]] | None = None,
    channels: Mapping[str, NDArray[np.float32]] | None = None,
    alpha: Float64 | None = None,
) -> None:
    """Write (H, W, 3) radiance, linear Rec. 709, as float32 channels R, G and B of scan lines with ZIP compression.

    metadata        : string attributes of the header
    window          : (x, y, width, height) of these pixels in the whole image, y from the top; the data window
    full_resolution : (width, height) of the whole image; the display window
    pixel_aspect    : width of a displayed pixel divided by its height, clipped to OpenEXR's range of 1e-6 to 1e6
    layers          : further images (H, W) or (H, W, k) by name; `layer_channels` gives the channels of a name
    channels        : further channels (H, W) by their full names in the file
    alpha           : (H, W) opacity, written as channel A; the colours do not change

    Raises ImageError for a file that cannot be written, and for arrays of other shapes.
    """
    import OpenEXR

    _check_texts(metadata)
    pixels = np.ascontiguousarray(radiance, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
        raise ImageError(
            f"{path}: found an array of shape {pixels.shape}, expected (H, W, 3).",
            "np.repeat(grey[..., None], 3, axis=-1) makes colours of grey values.",
        )
    for name, edges in (("window", window), ("full_resolution", full_resolution)):
        if edges is not None and not all(abs(edge) <= _MAX_EXR_EDGE for edge in edges):
            raise UsageError(f"{name}: {short_repr(edges)} where numbers up to {_MAX_EXR_EDGE:,} are needed")
    further = {"alpha": alpha, **(channels or {}), **(layers or {})}
    for name, plane in further.items():
        if plane is not None and np.shape(plane)[:2] != pixels.shape[:2]:
            raise ImageError(
                f"{path}: {name} is an array of shape {np.shape(plane)} beside colours of shape {pixels.shape}.",
                "Give an array of the same height and width.",
            )
    x, y = window[:2] if window else (0, 0)
    height, width = pixels.shape[:2]
    full_width, full_height = full_resolution or (x + width, y + height)
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "chromaticities": REC709_CHROMATICITIES,
        "dataWindow": _box(x, y, width, height),
        "displayWindow": _box(0, 0, full_width, full_height),
        "pixelAspectRatio": float(np.clip(pixel_aspect, 1 / _MAX_EXR_ASPECT, _MAX_EXR_ASPECT)),
        **(metadata or {}),
    }
    written = {"RGB": pixels} | {
        name: np.ascontiguousarray(channel, np.float32) for name, channel in (channels or {}).items()
    }
    if alpha is not None:
        written["A"] = np.ascontiguousarray(alpha, np.float32)
    for name, layer in (layers or {}).items():
        planes = layer[..., None] if layer.ndim == 2 else layer
        for i, channel in enumerate(layer_channels(name)):
            written[channel] = np.ascontiguousarray(planes[..., i], np.float32)
    with whole_file(path) as temporary, _openexr(temporary, os.O_RDWR | os.O_CREAT) as name:
        OpenEXR.File(header, written).write(name)


def layer_channels(name: str) -> list[str]:
    """Return the full channel names of a layer in an EXR.

    A layer NAME has the channels NAME.R, .G, .B for colours, .X, .Y, .Z for vectors, .Z for depths, and .X for
    other numbers. Nuke uses depth.Z, like Z, as its own depth. Blender and Natron show each layer as a pass.
    Integers are stored as float32, as in files of Blender and Cycles, because some readers support only one type of
    channel. float32 is exact for integers up to 2**24.
    """
    # A layer that is no AOV, such as "denoised", has colours.
    letters = AOV_KINDS[name].letters if name in AOV_KINDS else "RGB"
    return [f"{name}.{letter}" for letter in letters]


def _box(x: int, y: int, width: int, height: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return a window in OpenEXR's form, which is (x, y) of the first pixel and (x, y) of the last pixel."""
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


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
            return _three_channels(_read_exr(path, colours, display, alpha), alpha)
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


def read_exr_channels(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]:
    """Read all channels of an EXR by full name, (H, W) float32, and the texts of its header. Raises ImageError."""
    with reading(path, ".exr"):
        check_file(path)
        channels, header = _exr(Path(path))
        texts = {key: value for key, value in header.items() if isinstance(value, str)}
        return {name: pixels.astype(np.float32) for name, pixels in channels.items()}, texts


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
            (height, width), header = _exr_header(path)
            if display:
                (left, top), (right, bottom) = _window(header, "displayWindow")
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
    matrix = None if primaries is None or not convert else _matrix_to_rec709(primaries)
    return colours if matrix is None else colours @ matrix.T.astype(np.float32)


def _read_exr(path: Path, convert: bool = True, display: bool = False, alpha: bool = False) -> Float64:
    channels, header = _exr(path)
    if not {"R", "G", "B"} <= channels.keys() and "Y" not in channels:
        raise ValueError(f"found the channels {', '.join(sorted(channels)) or 'none'}, expected R, G, B or Y")
    names = "RGB" if "R" in channels else "Y"
    colours = np.stack([channels[name] for name in names], axis=-1).astype(np.float64)
    matrix = _matrix_to_rec709(header["chromaticities"]) if "chromaticities" in header else None
    if convert and names == "RGB" and matrix is not None:
        colours = colours @ matrix.T
    if alpha and "A" in channels:
        colours = np.dstack([np.broadcast_to(colours, (*colours.shape[:2], 3)), channels["A"]])
    return _in_display_window(colours, header, path) if display else colours


def _in_display_window(pixels: Float64, header: dict[str, Any], path: Path) -> Float64:
    """Return the pixels (H, W, C) of the display window of an EXR; zeros outside the data window.

    Raises ValueError if the display window is implausibly large for the file.
    """
    (left, top), _ = data = _window(header, "dataWindow")
    (x, y), (right, bottom) = display = _window(header, "displayWindow")
    if display == data or right < x or bottom < y:
        return pixels
    width, height = right - x + 1, bottom - y + 1
    check_unfolded(4 * width * height * pixels.shape[2], path.stat().st_size, FLOAT_PIXEL * width * height)
    result = np.zeros((height, width, pixels.shape[2]))
    visible = pixels[max(y - top, 0) : max(bottom + 1 - top, 0), max(x - left, 0) : max(right + 1 - left, 0)]
    row, column = max(top - y, 0), max(left - x, 0)
    result[row : row + visible.shape[0], column : column + visible.shape[1]] = visible
    return result


def _window(header: dict[str, Any], name: str) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the (x, y) of the first and of the last pixel of a window of an EXR."""
    (left, top), (right, bottom) = (corner.astype(np.int64).tolist() for corner in header[name])
    return (left, top), (right, bottom)


def _matrix_to_rec709(chromaticities: ArrayLike) -> Float64 | None:
    """Return the matrix of `_rec709_from`; None if the primaries are those of Rec. 709."""
    given = np.array(chromaticities, np.float64)
    if np.allclose(given, REC709_CHROMATICITIES, rtol=0.0, atol=_SAME_CHROMATICITY):
        return None
    return _rec709_from(given)


def _rec709_from(chromaticities: Float64) -> Float64:
    """Return the (3, 3) matrix from RGB with other primaries to linear Rec. 709.

    The matrix maps the white of the other primaries to D65. Raises ValueError if the matrix is not finite.

    chromaticities : (8,) x and y of red, green, blue and white of the other primaries

    Sources: SMPTE RP 177-1993 (XYZ from RGB); Lam 1985, the Bradford adaptation, as of ICC.1:2022, annex E.
    """
    try:
        cone = [_BRADFORD @ _xyz_from_rgb(each) for each in (chromaticities, np.array(REC709_CHROMATICITIES))]
        theirs, ours = (each.sum(axis=1) for each in cone)  # cone responses of the two white points
        matrix = np.linalg.solve(cone[1], (ours / theirs)[:, None] * cone[0])
    except np.linalg.LinAlgError:
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        raise ValueError(f"its chromaticities {chromaticities.round(4).tolist()} are not those of colours")
    return matrix


def _xyz_from_rgb(chromaticities: Float64) -> Float64:
    x, y = chromaticities.reshape(4, 2).T
    xyz = np.stack([x, y, 1.0 - x - y])
    with np.errstate(divide="ignore", invalid="ignore"):
        return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3] / y[3])


def _exr(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the channels of an EXR by name, each (H, W), and the header."""
    import OpenEXR

    (height, width), header = _exr_header(path)
    with _openexr(path) as name:
        channels = OpenEXR.File(name, separate_channels=True).channels()
    pixels = {name: np.asarray(channel.pixels) for name, channel in channels.items()}
    for name, array in pixels.items():
        if array.shape != (height, width) or array.dtype.kind not in "fiu":
            raise ValueError(f"its channel {name} is an array {array.shape} of {array.dtype}")
    return pixels, header


def _exr_header(path: Path) -> tuple[tuple[int, int], dict[str, Any]]:
    """Read (height, width) and the header of the first part of an EXR.

    Raises ValueError if the file is too small for the pixels of all parts, because OpenEXR decodes all of them.
    """
    import OpenEXR

    with path.open("rb") as file:  # errors of the system are clearer than those of OpenEXR
        size = file.seek(0, 2)
        if size:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                _check_exr_entries(data)
    with _openexr(path) as name:
        headers = [part.header for part in OpenEXR.File(name, header_only=True).parts]
    sizes, unfolded, decoded = [], 0, 0
    for number, header in enumerate(headers, start=1):
        if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
            raise ValueError(f"its part {number} has deep pixels, but only flat pixels are read")
        first, last = (corner.astype(np.int64) for corner in header["dataWindow"])
        width, height = (last - first + 1).tolist()
        channels = len(header["channels"])
        sizes.append((height, width))
        unfolded += width * height * 4 * channels
        decoded += width * height * max(8 * channels, FLOAT_PIXEL)
    check_unfolded(unfolded, size, decoded)
    return sizes[0], headers[0]


def _check_exr_entries(data: mmap.mmap) -> None:
    """Raise ValueError for a header with too many entries, because OpenEXR needs quadratic time to read them.

    An invalid header ends the check, because OpenEXR rejects it.

    Source: Academy Software Foundation, "OpenEXR File Layout".
    """
    is_multipart = data[5:6] >= b"\x10"
    position, entries = 8, 0
    while entries <= _MAX_EXR_ENTRIES:
        if data[position : position + 1] == b"\0":  # a zero byte ends the header of a part
            if not is_multipart or data[position + 1 : position + 2] in (b"", b"\0"):
                return
            position += 1
        name_end = data.find(b"\0", position, position + _MAX_EXR_NAME + 1)
        type_end = data.find(b"\0", name_end + 1, name_end + _MAX_EXR_NAME + 2)
        if min(name_end, type_end) < 0:
            return
        value = type_end + 5
        position = value + int.from_bytes(data[type_end + 1 : value], "little")
        entries += 1
        if data[name_end + 1 : type_end] == b"chlist":
            max_bytes = (_MAX_EXR_ENTRIES + 1) * (_MAX_EXR_NAME + 17)
            entries += len(_EXR_CHANNEL.findall(data, value, min(position, value + max_bytes)))
    raise ValueError(f"its header has more than {_MAX_EXR_ENTRIES:,} attributes and channels")


@contextmanager
def _openexr(path: Path, flags: int = os.O_RDONLY) -> Iterator[str]:
    """Context that yields a UTF-8 name for `path`, because OpenEXR opens no file by another name.

    In a command, lines that OpenEXR prints on errors are suppressed. In Python they are not, because other threads
    and child processes of the program may use standard output meanwhile.
    """
    with ExitStack() as stack:
        name = str(path)
        if name.encode(errors="surrogateescape") != name.encode(errors="replace"):
            descriptor = os.open(path, flags, 0o666)
            stack.callback(os.close, descriptor)
            name = f"/proc/self/fd/{descriptor}"
        if in_command():
            stack.enter_context(without_lines(f"{name}: (EXR_", "Warning: Exception raised reading pixel data"))
        yield name


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
    ".exr": _read_exr,
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
