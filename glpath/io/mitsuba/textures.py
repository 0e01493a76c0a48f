"""Reader of Mitsuba's textures: bitmaps, checkerboards and constants, each read once.

Mitsuba's v runs downwards, so the first row of an image is at v = 0. In glpath that row is at v = 1.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from glpath.errors import encodable, warn_at
from glpath.film.image import read_eight_bits, read_image
from glpath.io.description import MAX_TEXTURE_PIXELS
from glpath.io.export.geometry import map_downwards, tangent_axes
from glpath.io.mitsuba.plugin import Plugin, of_kind
from glpath.io.named_files import NamedFiles, UnusableError
from glpath.io.pictures import Pictures
from glpath.io.scene_pictures import stored_picture
from glpath.scene.geometry import Float64
from glpath.scene.material import Texture, TextureSlot, Wrap
from glpath.scene.source_location import SourceLocation
from glpath.system.colour import luminance
from glpath.system.npz import UnfoldedPictures
from glpath.system.time_limit import check_time

_KINDS = ("bitmap", "checkerboard", "rawconstant", "uniform", "srgb")
# Factor by which `baked` enlarges the width and height of an image before it changes the colours.
_FINER = 5
# Approximate number of texels that are converted at once.
_STRIP_TEXELS = 2**18
# Maximum number of texels of an image that `baked` enlarges; larger images keep their size.
_MAX_INTERPOLATED = 65536
FORMATS = (".png", ".jpg", ".jpeg", ".exr", ".hdr")
# Bytes of a texel of three floats.
_FLOAT_TEXEL = 12
# sRGB byte whose reflectance is nearest to 0.5.
_GREY = 188


@dataclass(frozen=True, eq=False)
class Look:
    """Image with the parameters of its texture lookup.

    image  : (h, w, 3), row 0 at the top; uint8, where 255 stands for 1, or float32, linear Rec. 709
    srgb   : True if uint8 values are sRGB; False if they are linear
    matrix : (2, 3) affine map applied to texture coordinates before the lookup
    """

    name: str
    image: NDArray[np.uint8] | NDArray[np.float32]
    srgb: bool
    filter: Literal["linear", "nearest"] = "linear"
    wrap: Wrap = "repeat"
    matrix: Float64 = field(default_factory=lambda: np.eye(2, 3))

    def linear(self, rows: slice = slice(None)) -> NDArray[np.float32]:
        """Return the linear colours (rows, w, 3) of some rows, by default of all."""
        return Texture(self.name, self.image[rows], srgb=self.srgb).linear()[..., :3]

    def grey(self, rows: slice) -> Float64:
        """Return the luminance (rows, w) of some rows."""
        return np.asarray(luminance(self.linear(rows).astype(np.float64)))

    def strips(self) -> Iterator[slice]:
        """Yield the rows in strips, because floats of all rows would take several times the memory of the image."""
        height, width = self.image.shape[:2]
        step = max(1, _STRIP_TEXELS // width)
        for top in range(0, height, step):
            yield slice(top, min(top + step, height))

    def looked_up_as(self, other: Look) -> bool:
        """Return True if both images have the same size and lookup, so that they can be channels of one image."""
        return (
            self.image.shape[:2] == other.image.shape[:2]
            and (self.filter, self.wrap) == (other.filter, other.wrap)
            and np.array_equal(self.matrix, other.matrix)
        )

    def with_image(self, name: str, image: NDArray[np.uint8] | NDArray[np.float32], *, srgb: bool = False) -> Look:
        """Return a `Look` of another image that keeps this one's filter, wrap mode and matrix."""
        return Look(name, image, srgb, self.filter, self.wrap, self.matrix)


class Textures:
    """Textures of a scene. Each image is added to `textures` when `slot` is first called for it.

    files : search for missing image files, which records those found elsewhere
    """

    def __init__(self) -> None:
        self.files = NamedFiles()
        self.textures: list[Texture] = []
        self._looks: dict[int, Look] = {}
        self._slots: dict[int, TextureSlot] = {}
        self._bitmaps: dict[tuple[object, ...], Look] = {}
        self._derived: dict[tuple[object, ...], tuple[Look, ...]] = {}
        self._files: dict[tuple[Path, bool], NDArray[np.uint8] | NDArray[np.float32]] = {}
        self._unfolded = UnfoldedPictures()

    def numbers(self, plugin: Plugin) -> Look:
        """Return the image of a texture plugin that supplies numbers, such as roughness, instead of colours.

        The result differs from `look` only for a checkerboard of numbers, whose two values Mitsuba exchanges
        (3.9.1, Checkerboard.eval_1).
        """
        look = self.look(plugin)
        if plugin.kind != "checkerboard":
            return look
        key = -id(plugin.element)
        if key not in self._looks:
            self._looks[key] = look.with_image(look.name, np.ascontiguousarray(look.image[::-1], np.float32))
        return self._looks[key]

    def look(self, plugin: Plugin) -> Look:
        """Return the image of a texture plugin, read once. Raises SceneError."""
        key = id(plugin.element)
        if key not in self._looks:
            of_kind(plugin, dict.fromkeys(_KINDS), "a texture")
            if plugin.kind == "bitmap":
                made = self._bitmap(plugin)
            else:
                made = _checkerboard(plugin) if plugin.kind == "checkerboard" else _constant(plugin)
            plugin.check_all_read()
            self._looks[key] = made
        return self._looks[key]

    def slot(self, look: Look) -> TextureSlot:
        """Return the texture slot of an image; the image is added to the textures once."""
        if id(look) not in self._slots:
            self._looks[id(look)] = look  # kept alive, so that no other object gets its id
            wrap = (look.wrap, look.wrap)
            self.textures.append(Texture(look.name, look.image, filter=look.filter, srgb=look.srgb, wrap=wrap))
            self._slots[id(look)] = TextureSlot(len(self.textures) - 1, 0, look.matrix)
        return self._slots[id(look)]

    def derived(
        self, key: tuple[object, ...], size: int, location: SourceLocation, make: Callable[[], tuple[Look, ...]]
    ) -> tuple[Look, ...]:
        """Return images that are computed from others, made once for each `key`.

        size : bytes of the images

        Raises SceneError if all such images become too large for the pictures of the scene.
        """
        if key not in self._derived:
            check_time()
            try:
                self._unfolded.add_derived(size)
            except ValueError as error:
                raise location.error(f"has a picture that cannot be used, because {error}.") from error
            self._derived[key] = make()
        return self._derived[key]

    def baked(
        self, look: Look, name: tuple[object, ...], change: Callable[[Float64], Float64], location: SourceLocation
    ) -> Look:
        """Return an image with `change` applied to its linear colours. Raises SceneError as `derived` does.

        name : key of `change`, the same for equal functions
        """
        size = _FLOAT_TEXEL * look.image.shape[0] * look.image.shape[1] * (_FINER**2 if _is_enlarged(look) else 1)
        key = ("baked", id(look), *name)
        return self.derived(key, size, location, lambda: (_baked(look, change),))[0]

    def bent(self, look: Look, scale: float, location: SourceLocation, uv_lengths: tuple[float, float]) -> Look:
        """Return an image of heights as a normal map, see `_bent`. Raises SceneError as `derived` does."""
        size = _FLOAT_TEXEL * look.image.shape[0] * look.image.shape[1]
        key = ("bent", id(look), scale, uv_lengths)
        return self.derived(key, size, location, lambda: (_bent(look, scale, uv_lengths),))[0]

    def turned(self, look: Look, turn: Float64, location: SourceLocation) -> Look:
        """Return a normal map with red and green multiplied by `turn` (2, 2). Raises SceneError."""
        if np.array_equal(turn, np.eye(2)):
            return look
        made = partial(_turned_normals, look.image, turn)
        key = ("turned", id(look), turn.tobytes())
        return self.derived(key, look.image.nbytes, location, lambda: (look.with_image(look.name, made()),))[0]

    def grey(self, look: Look, location: SourceLocation) -> Look:
        """Return an image whose three channels are the luminance of `look`. Raises SceneError as `derived` does."""
        if not np.ptp(look.image, axis=2).any():
            return look
        height, width = look.image.shape[:2]

        def made() -> tuple[Look]:
            image = np.empty((height, width, 3), np.float32)
            for rows in look.strips():
                image[rows] = look.grey(rows)[..., None]
            return (look.with_image(look.name, image),)

        return self.derived(("grey", id(look)), _FLOAT_TEXEL * height * width, location, made)[0]

    def _elsewhere(self, plugin: Plugin, name: str) -> Path | None:
        """Search for a missing image file under other spellings and in subfolders; return None if not found."""
        for folder in (plugin.element.folder, *plugin.element.searched.folders):
            with suppress(UnusableError):
                return self.files.find(folder, name)
        return None

    def _bitmap(self, plugin: Plugin) -> Look:
        name = plugin.text("filename")
        if not name:
            raise plugin.location.error("lacks the parameter `filename`, which must be there.")
        raw = plugin.flag("raw", False)
        plugin.text("format", "auto", ("auto", "variant", "fp16", "fp32"))  # Mitsuba's storage format, unused here
        filter_type = plugin.text("filter_type", "bilinear", ("bilinear", "nearest"))
        wrap = plugin.text("wrap_mode", "repeat", ("repeat", "clamp", "mirror"))
        path, where = plugin.element.file(name), plugin.where("filename")
        if not os.path.exists(path):
            path = self._elsewhere(plugin, name) or path
        key = (path, raw)
        if key not in self._files:
            self._files[key] = _picture(path, where, raw, self._unfolded)
        image = self._files[key]
        if raw and image.dtype != np.uint8 and path.suffix.lower() == ".png":
            raise where.error(
                f"names {path}, which has 16 bits a channel, for what is no colour.",
                "Convert it to 8 bits, or EXR.",
            )
        matrix = _to_uv(plugin)
        same = (*key, filter_type, wrap, matrix.tobytes())
        if same not in self._bitmaps:
            self._bitmaps[same] = Look(
                plugin.id or encodable(path.stem),
                image,
                srgb=image.dtype == np.uint8 and not raw,
                filter="nearest" if filter_type == "nearest" else "linear",
                wrap=cast(Wrap, wrap),
                matrix=matrix,
            )
        return self._bitmaps[same]


def _picture(
    path: Path, location: SourceLocation, raw: bool, unfolded: UnfoldedPictures
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return the (h, w, 3) image of a file; grey, with a warning, if the file is missing. Raises SceneError."""
    if not os.path.exists(path):
        text = f"{location} names the picture {path}, which does not exist: grey stands in for it."
        warn_at(str(location), {"pictures that do not exist, for which grey stands in,": 1}, text)
        return np.full((1, 1, 3), _GREY, np.uint8)
    if path.suffix.lower() not in FORMATS:
        pictures = Pictures(path.parent, unfolded=unfolded)
        try:
            return np.ascontiguousarray(np.maximum(pictures.read(path.name)[..., :3], 0))
        except UnusableError as error:
            raise location.error(f"names the picture {path}, {error}.", "Convert it to PNG.") from error
    return stored_picture(
        path, "a texture", FORMATS, MAX_TEXTURE_PIXELS, location, partial(_stored, colours=not raw), unfolded
    )


def _stored(path: Path, colours: bool) -> NDArray[np.uint8] | NDArray[np.float32]:
    eight_bits = read_eight_bits(path)
    if eight_bits is not None:
        return np.ascontiguousarray(eight_bits[..., :3])
    return np.ascontiguousarray(np.maximum(read_image(path, colours)[..., :3], 0.0), np.float32)


def _checkerboard(plugin: Plugin) -> Look:
    first, second = plugin.colour("color0", 0.4), plugin.colour("color1", 0.2)
    image = np.array([[first, second], [second, first]], np.float32)
    return Look(plugin.id or "checkerboard", image, False, "nearest", "repeat", _to_uv(plugin))


def _constant(plugin: Plugin) -> Look:
    """Return an image of one colour for a texture without a pattern."""
    name = "color" if plugin.kind == "srgb" else "value"
    colour = plugin.vector(name) if plugin.kind_of(name) in ("point", "vector") else plugin.colour(name, 1.0)
    return Look(plugin.id or plugin.kind, np.array([[colour]], np.float32), False, "nearest")


def _to_uv(plugin: Plugin) -> Float64:
    """Return Mitsuba's `to_uv` as a (2, 3) affine map, converted from its v downwards to v upwards."""
    given = plugin.transform("to_uv")
    scale = np.diag([plugin.number("uscale", 1.0), plugin.number("vscale", 1.0), 1.0])
    # Mitsuba scales the offsets as well.
    scale[:2, 2] = scale[:2, :2] @ [plugin.number("uoffset", 0.0), plugin.number("voffset", 0.0)]
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = given[:2, :2], given[:2, 3]
    return map_downwards((scale @ matrix)[:2], (1.0, 1.0))[:2]


def _is_enlarged(look: Look) -> bool:
    return look.filter == "linear" and look.image.shape[0] * look.image.shape[1] <= _MAX_INTERPOLATED


def _baked(look: Look, change: Callable[[Float64], Float64]) -> Look:
    """Return an image with `change` applied to its linear colours.

    Small images are first enlarged by interpolation, because Mitsuba changes colours after interpolation. The
    factor is odd, so the centre of an original texel stays the centre of a texel and keeps its value.
    """
    if _is_enlarged(look):
        linear = look.linear().astype(np.float64)
        for axis in (0, 1):
            linear = _interpolated(linear, axis, look.wrap)
        return look.with_image(look.name, change(linear).astype(np.float32))
    image = np.empty((*look.image.shape[:2], 3), np.float32)
    for rows in look.strips():
        image[rows] = change(look.linear(rows).astype(np.float64))
    return look.with_image(look.name, image)


def _interpolated(image: Float64, axis: int, wrap: Wrap) -> Float64:
    """Enlarge an image by the factor _FINER along an axis, with linear interpolation between texel centres."""
    size = image.shape[axis]
    at = (np.arange(_FINER * size) + 0.5) / _FINER - 0.5
    below = np.floor(at).astype(np.intp)
    part = (at - below).reshape([-1 if each == axis else 1 for each in range(image.ndim)])
    ends = [each % size if wrap == "repeat" else np.clip(each, 0, size - 1) for each in (below, below + 1)]
    first, second = (image.take(each, axis) for each in ends)
    return np.asarray(first * (1.0 - part) + second * part)


def _turned_normals(
    image: NDArray[np.uint8] | NDArray[np.float32], turn: Float64
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return a normal map (h, w, 3) whose red and green, as distances from 0.5, are multiplied by `turn` (2, 2)."""
    is_bytes = image.dtype == np.uint8
    middle = 127.5 if is_bytes else 0.5
    turned = image.copy()
    for row, stored in zip(turned, image, strict=True):
        plane = middle + (stored[:, :2] - middle) @ turn.T
        row[:, :2] = np.clip(np.rint(plane), 0.0, 255.0) if is_bytes else plane
    return turned


def _bent(look: Look, scale: float, uv_lengths: tuple[float, float]) -> Look:
    """Convert an image of heights to a normal map.

    scale      : height of the image value 1, scene units
    uv_lengths : length of one unit of u, and of one unit of v, scene units
    """
    rows_count, columns = look.image.shape[:2]
    heights = np.empty((rows_count, columns))
    for rows in look.strips():
        heights[rows] = scale * look.grey(rows)
    image = np.empty((rows_count, columns, 3), np.float32)
    for rows in look.strips():
        own = heights[rows]
        above, below = (
            heights.take(range(rows.start + step, rows.stop + step), axis=0, mode="wrap") for step in (-1, 1)
        )
        # Derivatives of the height by the lookup coordinates: the first grows along each row, the second from the
        # last row to the first.
        across = 0.5 * columns * (np.roll(own, -1, axis=1) - np.roll(own, 1, axis=1))
        upwards = 0.5 * rows_count * (above - below)
        slopes = np.einsum("kij,kl->ijl", np.stack([across, upwards]), look.matrix[:, :2]) / uv_lengths
        slopes = slopes @ tangent_axes(look.matrix, uv_lengths).T
        normals = np.concatenate([-slopes, np.ones((*own.shape, 1))], axis=2)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        image[rows] = 0.5 + 0.5 * normals
    return look.with_image(f"{look.name}-normals", image)
