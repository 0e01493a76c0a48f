"""Denoising by Open Image Denoise (Afra 2019 to 2025), which is optional: `pip install "glpath[denoise]"`.

A network that was trained on path-traced pictures removes noise and keeps edges, textures and shadows;
albedo and normals show it which edges are the surfaces' own.

Cost:     0.2 s of one core for 256 x 256, and as much for albedo and normals with noise, once; some 600 bytes a
          pixel of memory.
Poor at:  noise that neighbours share, as paths with shared directions have: it stays, taken for texture. What is
          lost in noise is invented. Energy is not kept to the last percent, least at the edges of lamps.
Source:   https://www.openimagedenoise.org/documentation.html, the RT and RTLightmap filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import GlpathError

Float32 = NDArray[np.float32]
Flags = dict[str, bool | str]

# Pixels by which pictures are mirrored beyond their border, where the network would see black, and darken what is
# near: with them the squared error at the border of `room` is half of that without.
_BEYOND = 16
# MiB of the network, above which it takes tiles: 1920 x 1080 pixels take 1.6 GiB at once, and as long in two. A
# lightmap is denoised beside all else that a bake holds: 2048 x 2048 take half as long again, and a sixth.
_PICTURE_MIB, _PAGE_MIB = 1024, 256
# By how much a pixel of a guide has to stand out from its neighbours to be noise, of which less does no harm; the
# share of pixels of a tile, so many wide, that do so at small corners and thin lines alone.
_NOISE, _LINES, _TILE = 0.004, 0.15, 16
# The smaller network: of albedo and normals as good as the large one, in half the time.
_SOON: Flags = {"quality": "OIDN_QUALITY_BALANCED"}
# The smallest: of two halves that are only compared. Their difference is 5 % less, in half the time again.
_SOONEST: Flags = {"quality": "OIDN_QUALITY_FAST"}


def require_denoiser() -> Any:
    """The module `pyoidn`. Raises GlpathError with the line to type where it is missing: asked before the work."""
    try:
        import pyoidn
    except (ImportError, OSError) as error:
        raise GlpathError(
            f"pyoidn cannot be imported ({error}); pictures are denoised by Open Image Denoise, which is in it.",
            'pip install "glpath[denoise]"; it has wheels for Linux and Windows on x86-64, and for macOS.',
        ) from error
    if not pyoidn.Device.is_cpu_available():
        raise GlpathError("Open Image Denoise does not know this processor.", "It needs SSE 4.1.")
    return pyoidn


def can_denoise() -> bool:
    """Whether the denoiser is there."""
    try:
        require_denoiser()
    except GlpathError:
        return False
    return True


@dataclass(frozen=True)
class Guides:
    """Albedo and normals, of which each was denoised alone where it has noise to lose: textures, alpha, lenses and
    motion leave some in them, too.

    For several pictures of one film.
    """

    albedo: Float32
    normal: Float32

    @classmethod
    def of(cls, albedo: ArrayLike, normal: ArrayLike) -> Guides:
        """See `denoised` for the parameters and errors."""
        oidn = require_denoiser()
        made = (
            np.asarray(values, np.float32)
            if is_free_of_noise(values)
            else _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, {image: values}, "symmetric", _SOON, _PICTURE_MIB)
            for image, values in ((oidn.OIDN_IMAGE_ALBEDO, albedo), (oidn.OIDN_IMAGE_NORMAL, normal))
        )
        return cls(*made)


def is_free_of_noise(guide: ArrayLike) -> bool:
    """Whether no part of albedo or normals (H, W, 3) has noise: plain colours, and shapes of whatever outline.

    A pixel of noise is brighter or darker than all four neighbours in two of five cases, a pixel at an edge hardly
    ever. Without noise, the denoiser does as well with guides as they are (`cornell-box`, `room`: the same relMSE,
    in 0.8 and 0.5 of the time); it does worse where textures, lenses or alpha leave some (`benchmarks scene
    helmet`: 9.0e-4 instead of 8.4e-4).
    """
    values = np.asarray(guide, np.float32)
    if min(values.shape[:2]) < 3:
        return False
    inner = values[1:-1, 1:-1]
    beside = values[1:-1, :-2], values[1:-1, 2:], values[:-2, 1:-1], values[2:, 1:-1]
    upper, lower = np.maximum.reduce(beside), np.minimum.reduce(beside)
    stands_out = ((inner > upper + _NOISE) | (inner < lower - _NOISE)).any(axis=2).astype(np.int32)
    for axis, side in enumerate(stands_out.shape):
        stands_out = np.add.reduceat(stands_out, np.arange(0, side, _TILE), axis=axis)
    pixels = min(_TILE, inner.shape[0]) * min(_TILE, inner.shape[1])
    return bool(stands_out.max() <= _LINES * pixels)


def soon_denoised(radiance: ArrayLike, albedo: ArrayLike, normal: ArrayLike) -> Float32:
    """As `denoised`, by the smallest network and guides as they are: a quarter of the time, only to compare."""
    oidn = require_denoiser()
    images = {
        oidn.OIDN_IMAGE_COLOR: radiance,
        oidn.OIDN_IMAGE_ALBEDO: albedo,
        oidn.OIDN_IMAGE_NORMAL: normal,
    }
    return _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, images, "symmetric", _SOONEST | {"hdr": True}, _PICTURE_MIB)


def denoised(radiance: ArrayLike, guides: Guides) -> Float32:
    """Radiance without its noise, as far as the denoiser finds it.

    Runs on the CPU, with a thread for each core that the process may use; OIDN_NUM_THREADS says another number. The
    same input gives the same bits on one machine, whatever the threads; another processor may round otherwise.

    Parameters
    ----------
    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709, not negative
    guides   : of albedo (H, W, 3), 0 to 1, and normal (H, W, 3), -1 to 1, of the world or the eye, as of
               `Film.aov`; antialiased as the radiance is

    Returns (H, W, 3) float32. Raises GlpathError where pyoidn is missing, or Open Image Denoise fails.
    """
    oidn = require_denoiser()
    images = {
        oidn.OIDN_IMAGE_COLOR: radiance,
        oidn.OIDN_IMAGE_ALBEDO: guides.albedo,
        oidn.OIDN_IMAGE_NORMAL: guides.normal,
    }
    # Guides without noise have a larger network.
    flags: Flags = {"hdr": True, "cleanAux": True}
    return _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, images, "symmetric", flags, _PICTURE_MIB)


def denoised_lightmap(irradiance: ArrayLike) -> Float32:
    """A page of a lightmap without its noise: by the filter for lightmaps, which is given light alone.

    irradiance : (H, W, 3), linear Rec. 709, not negative; gutters between charts are filled

    Returns (H, W, 3) float32. Raises as `denoised`.
    """
    oidn = require_denoiser()
    images = {oidn.OIDN_IMAGE_COLOR: irradiance}
    return _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT_LIGHTMAP, images, "edge", {}, _PAGE_MIB)


def _filtered(
    oidn: Any,
    kind: str,
    images: dict[str, ArrayLike],
    mode: Literal["symmetric", "edge"],
    flags: Flags,
    memory: int,
) -> Float32:
    """memory : MiB that the network may take, about: a larger image is done in tiles, to the same bits."""
    beyond = (_BEYOND, _BEYOND), (_BEYOND, _BEYOND), (0, 0)
    arrays = {name: np.pad(np.asarray(image, np.float32), beyond, mode) for name, image in images.items()}
    shapes = {array.shape for array in arrays.values()}
    assert len(shapes) == 1, f"images of shapes {shapes}"
    output = arrays[oidn.OIDN_IMAGE_OUTPUT] = np.empty(shapes.pop(), np.float32)
    with oidn.Device(oidn.OIDN_DEVICE_TYPE_CPU) as device:
        device.set_bool("setAffinity", False)  # its threads are not tied to cores that others may be on
        device.commit()
        with oidn.Filter(device, kind) as made:
            for name, array in arrays.items():
                made.set_image(name, array, oidn.OIDN_FORMAT_FLOAT3)
            made.set_int("maxMemoryMB", memory)
            for name, value in flags.items():
                if isinstance(value, str):
                    made.set_int(name, int(getattr(oidn, value)))
                else:
                    made.set_bool(name, value)
            made.commit()
            made.execute()
        failure = device.get_error()
    if failure is not None:
        raise GlpathError(f"Open Image Denoise: {failure}.")
    return np.ascontiguousarray(output[_BEYOND:-_BEYOND, _BEYOND:-_BEYOND])
