"""Denoising by Open Image Denoise (Afra 2019 to 2025), which is optional: `pip install "glpath[denoise]"`.

A network trained on path-traced images removes noise and keeps edges, textures and shadows. Albedo and normals show
it which edges belong to surfaces.

Cost:     0.2 s on one core for 256 x 256 pixels, and another 0.2 s if albedo and normals are noisy; about 600 bytes
          of memory per pixel.
Poor at:  noise correlated between pixels, such as that of paths with shared directions. It remains, because it
          looks like texture. Details lost in noise are invented. Energy is not kept to the last percent, especially
          at the edges of lamps.
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

# Width in pixels of the border added around images, with mirrored or repeated pixels. Without the border, the
# network would see black outside and darken the image's edges. With it, the squared error at the edges of `room` is
# halved.
_BEYOND = 16
# Memory limit of the network in MiB for rendered images; an image that needs more is processed in tiles. Without
# tiles, 1920 x 1080 pixels need 1.6 GiB. As two tiles they take the same time.
_PICTURE_MIB = 1024
# Memory limit of the network in MiB for pages of lightmaps. It is lower, because a bake needs much other memory.
# Pages of 2048 x 2048 then take 1.5 times as long as without tiles, and a sixth of the memory.
_PAGE_MIB = 256
# A pixel of a guide (albedo or normal) counts as noise if it is above or below all four neighbours by more than
# this. Smaller noise is harmless.
_NOISE = 0.004
# Maximum fraction of noise pixels in a tile of a guide without noise, because corners and thin lines look like
# noise.
_LINES = 0.15
# Width in pixels of the tiles in which noise pixels are counted.
_TILE = 16
# Options for denoising albedo and normals. The smaller network is as good as the large one, in half the time.
_SOON: Flags = {"quality": "OIDN_QUALITY_BALANCED"}
# Options for denoising two halves of the path sets that are only compared. The smallest network halves the time
# again. The difference between the halves is then 5 % smaller.
_SOONEST: Flags = {"quality": "OIDN_QUALITY_FAST"}


def require_denoiser() -> Any:
    """Return the module `pyoidn`, or raise GlpathError with the install command; call it before the work starts."""
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
    """Return True if the denoiser is available."""
    try:
        require_denoiser()
    except GlpathError:
        return False
    return True


@dataclass(frozen=True)
class Guides:
    """Albedo and normals for the denoiser, usable for several images of one film.

    Each of the two has been denoised itself if it had noise, which textures, alpha, lenses and motion cause.
    """

    albedo: Float32
    normal: Float32

    @classmethod
    def of(cls, albedo: ArrayLike, normal: ArrayLike) -> Guides:
        """Return the guides, denoised if they have noise; `denoised` documents the parameters and errors."""
        oidn = require_denoiser()
        made = (
            np.asarray(values, np.float32)
            if is_free_of_noise(values)
            else _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, {image: values}, "symmetric", _SOON, _PICTURE_MIB)
            for image, values in ((oidn.OIDN_IMAGE_ALBEDO, albedo), (oidn.OIDN_IMAGE_NORMAL, normal))
        )
        return cls(*made)


def is_free_of_noise(guide: ArrayLike) -> bool:
    """Return True if a guide, albedo or normals (H, W, 3), has no noise, as with plain colours and sharp outlines.

    A noisy pixel is brighter or darker than all four neighbours in two of five cases, a pixel at an edge hardly
    ever. Guides without noise can be used directly: for `cornell-box` and `room`, the relMSE is as with denoised
    guides, in 0.8 and 0.5 of the time. Guides with noise from textures, lenses or alpha must be denoised:
    `benchmarks scene helmet` has a relMSE of 8.4e-4 with denoised guides, and of 9.0e-4 otherwise.
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
    """Return radiance denoised by the smallest network with unprocessed guides, for comparisons only.

    It takes a quarter of the time of `denoised`.
    """
    oidn = require_denoiser()
    images = {
        oidn.OIDN_IMAGE_COLOR: radiance,
        oidn.OIDN_IMAGE_ALBEDO: albedo,
        oidn.OIDN_IMAGE_NORMAL: normal,
    }
    return _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, images, "symmetric", _SOONEST | {"hdr": True}, _PICTURE_MIB)


def denoised(radiance: ArrayLike, guides: Guides) -> Float32:
    """Return radiance without noise, as far as the denoiser recognizes it.

    Runs on the CPU, with one thread for each core available to the process, or OIDN_NUM_THREADS threads. The same
    input gives the same bits on one machine, with any number of threads; another processor may round differently.

    Parameters
    ----------
    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709, not negative
    guides   : albedo (H, W, 3), 0 to 1, and normal (H, W, 3), -1 to 1, in the world's or the eye's frame, as from
               `Film.aov`; antialiased like the radiance

    Returns (H, W, 3) float32. Raises GlpathError if pyoidn is missing or Open Image Denoise fails.
    """
    oidn = require_denoiser()
    images = {
        oidn.OIDN_IMAGE_COLOR: radiance,
        oidn.OIDN_IMAGE_ALBEDO: guides.albedo,
        oidn.OIDN_IMAGE_NORMAL: guides.normal,
    }
    # The guides are free of noise here; this flag reports that, and Open Image Denoise then uses a larger network.
    flags: Flags = {"hdr": True, "cleanAux": True}
    return _filtered(oidn, oidn.OIDN_FILTER_TYPE_RT, images, "symmetric", flags, _PICTURE_MIB)


def denoised_lightmap(irradiance: ArrayLike) -> Float32:
    """Return a page of a lightmap without noise, using the lightmap filter, which takes no guides.

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
    """Return the output of a filter of Open Image Denoise.

    memory : approximate memory limit in MiB; a larger image is processed in tiles, with the same bits
    """
    beyond = (_BEYOND, _BEYOND), (_BEYOND, _BEYOND), (0, 0)
    arrays = {name: np.pad(np.asarray(image, np.float32), beyond, mode) for name, image in images.items()}
    shapes = {array.shape for array in arrays.values()}
    assert len(shapes) == 1, f"images of shapes {shapes}"
    output = arrays[oidn.OIDN_IMAGE_OUTPUT] = np.empty(shapes.pop(), np.float32)
    with oidn.Device(oidn.OIDN_DEVICE_TYPE_CPU) as device:
        device.set_bool("setAffinity", False)  # do not bind OIDN's threads to cores that other processes may use
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
