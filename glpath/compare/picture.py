"""Image with its noise and provenance: the subject of comparisons, and the content of a baseline file.

Noise is stored to distinguish it from a change. It has two parts: the variance of every pixel between batches of
path sets, and the mean of every batch over blocks of 16 x 16 pixels. The second part is needed because paths of a
set may share directions, so that pixels err together. The variance of a block or of the whole image cannot be
computed from variances of pixels.

The file is one EXR that any viewer can open. R, G, B are the mean; `variance.R`, ... its variance. `batch0.R`, ...
are the batches, constant over each block, which compresses to almost nothing. All other data are in the header.

Cost:     about 25 bytes per pixel on disk with noise, at most 12 without.
Poor at:  pixels that err together within a block, because their batches are not stored separately.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.film.exr import read_exr_channels, write_exr
from glpath.film.film import Film
from glpath.film.image import write_png
from glpath.film.tonemap import tonemap
from glpath.system.arguments import checked
from glpath.system.colour import decode_levels, decode_srgb, encode_srgb

Float64 = NDArray[np.float64]

#: Side of a block in pixels.
BLOCK_SIDE = 16

# Relative tolerance when stored noise is checked: rounding to float32, with a large margin.
_ROUNDING = 1e-4

#: Header key of images that `Film.save` has denoised.
DENOISED = "glpath.denoised"

_FORMAT = "glpath.baseline"
_VERSION = "1"

# Header keys of settings that determine an image, with their names in messages. Seed, path sets and device are not
# included: two renders may differ in these and must still agree.
_DECIDES = {
    "glpath.kind": "kind",
    "glpath.scene": "scene",
    "glpath.scene_hash": "content of the scene",
    "glpath.integrator": "integrator",
    "glpath.max_depth": "max_depth",
    "glpath.settings": "settings",
    "glpath.full_resolution": "resolution",
    "glpath.window": "crop",
}


@dataclass(frozen=True, eq=False)
class Noise:
    """Variation of an image between batches.

    variance      : (H, W, 3) float64, variance of each pixel's mean, see `Film.variance_of_mean`
    block_batches : (B, h, w, 3) float64, mean of each batch over blocks of 16 x 16 pixels; blocks at the right and
                    lower border are smaller
    batch_counts  : (B,) int64, number of path sets in each batch
    """

    variance: Float64
    block_batches: Float64
    batch_counts: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Picture:
    """Image for comparison.

    mean       : (H, W, 3) float64, linear Rec. 709, row 0 at the top
    noise      : noise, or None if it is unknown: for arrays, and films of one batch
    provenance : origin of the image, name to text, as in the header of an EXR
    alpha      : (H, W) float64, opacity from 0 to 1; `mean` is not multiplied by it; None if all is opaque
    eight_bit  : True if the image was 8-bit sRGB, so that a PNG stores it without loss
    """

    mean: Float64
    noise: Noise | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    alpha: Float64 | None = None
    eight_bit: bool = False

    @classmethod
    @checked
    def of_film(cls, film: Film) -> Picture:
        """Return the film's mean, with noise if it has two batches or more. Raises UsageError for an empty film."""
        used = np.flatnonzero(film.batch_counts)
        noise = None
        if len(used) >= 2:
            counts = film.batch_counts[used]
            means = film.radiance_sums[used] / counts[:, None, None, None]
            noise = Noise(film.variance_of_mean(), np.stack([_over_blocks(mean) for mean in means]), counts)
        return cls(film.mean, noise, {"glpath.kind": "film", **film.provenance()})

    @classmethod
    @checked
    def of_array(cls, array: Any, provenance: Mapping[str, str] | None = None) -> Picture:
        """Return a picture of an array (H, W, 3), (H, W), or (H, W, 4) with alpha.

        Floats are radiance; uint8, uint16 and bool are sRGB. Raises ImageError.
        """
        try:
            given = np.asarray(array)
        except (TypeError, ValueError) as error:
            raise ImageError("picture: found lists of unequal lengths, expected numbers (H, W, 3).") from error
        if given.dtype.kind not in "biuf" or given.ndim not in (2, 3) or given.size == 0:
            raise ImageError(
                f"picture: found an array of shape {given.shape} of {given.dtype}, expected numbers (H, W, 3)."
            )
        if given.dtype.kind in "iu" and given.dtype.name not in ("uint8", "uint16"):
            raise ImageError(
                f"picture: found integers of {given.dtype}, {given.min()} to {given.max()}, which have no white: "
                "allowed are uint8 and uint16, sRGB, and floats, radiance.",
                "Convert it: .astype(np.uint8) where white is 255, np.uint16 where it is 65535, float of radiance.",
            )
        white = {"bool": 1, "uint8": 255, "uint16": 65535}.get(given.dtype.name)
        values = given.astype(np.float64) / (white or 1)
        if values.ndim == 2:
            values = values[..., None]
        if values.shape[2] not in (1, 3, 4):
            raise ImageError(f"picture: found an array of shape {given.shape}, expected (H, W, 3).")
        broken = int(np.count_nonzero(~np.isfinite(values).all(axis=-1)))
        if broken:
            raise ImageError(
                f"picture: {broken} of its {values.shape[0] * values.shape[1]} pixels are NaN or infinite."
            )
        alpha = values[..., 3] if values.shape[2] == 4 and (values[..., 3] != 1).any() else None
        if alpha is not None and not (alpha.min() >= 0 and alpha.max() <= 1):
            raise ImageError(
                f"picture: found alpha from {alpha.min():g} to {alpha.max():g}, expected 0 to 1.",
                "The fourth channel is opacity; leave out what is not.",
            )
        light = values[..., :3]
        if white == 255:
            light = decode_levels(given.reshape(values.shape)[..., :3])
        elif white:
            light = decode_srgb(light)
        return cls(
            np.repeat(light, 3, axis=2) if values.shape[2] == 1 else light,
            None,
            # The source of an array may be noisy, but its noise is unknown.
            {"glpath.kind": "array", **(provenance or {})} | {"glpath.noisy": "false"},
            alpha,
            eight_bit=white in (1, 255),
        )

    @property
    def denoised(self) -> bool:
        """True if the image was denoised, so that pixel differences do not show its noise."""
        return DENOISED in self.provenance

    @property
    def bias(self) -> str:
        """Text about the bias of the engine that made the image; empty if the engine has no bias."""
        if self.provenance.get("glpath.biased") != "true":
            return ""
        found = _json_object(self.provenance.get("glpath.bias", ""))
        mean, error = found.get("mean"), found.get("mean_error")
        if not (isinstance(mean, float) and isinstance(error, float)):
            return "has a bias, which was not measured"
        return f"has a bias of {100 * mean:.2g} %, plus or minus {100 * error:.2g} %"

    @checked
    def over(self, ground: float) -> Picture:
        """Return the image without alpha, laid over a grey background and mixed in sRGB as browsers do.

        ground : sRGB value of the background, 0 for black to 1 for white
        """
        if self.alpha is None:
            return replace(self, eight_bit=False)
        opacity = self.alpha[..., None]
        mixed = opacity * encode_bright_srgb(self.mean) + (1 - opacity) * ground
        return replace(
            self, mean=np.where(opacity == 1, self.mean, decode_srgb(mixed)), alpha=None, eight_bit=False
        )

    def opacity(self) -> Picture:
        """Return the image's alpha as a grey image; white if it has no alpha."""
        alpha = np.ones(self.mean.shape[:2]) if self.alpha is None else self.alpha
        return replace(self, mean=np.repeat(alpha[..., None], 3, axis=2), alpha=None, eight_bit=False)

    @checked
    def save(self, path: str | Path) -> None:
        """Write the image as a baseline, an EXR; the file appears whole or not at all. Raises ImageError."""
        layers: dict[str, Float64] = {}
        header = {_FORMAT: _VERSION, **self.provenance}
        if self.noise is not None:
            header["glpath.batch_counts"] = json.dumps(self.noise.batch_counts.tolist())
            layers["variance"] = self.noise.variance
            shape = self.mean.shape[:2]
            for i, blocks in enumerate(self.noise.block_batches):
                layers[f"batch{i}"] = spread_blocks(blocks, shape)
        write_exr(path, self.mean, header, layers=layers, alpha=self.alpha)

    def save_png(self, path: str | Path, metadata: Mapping[str, str] | None = None) -> None:
        """Write an 8-bit sRGB PNG with alpha; the file appears whole or not at all. Raises ImageError."""
        colour = tonemap(self.mean)
        if self.alpha is not None:
            colour = np.dstack([colour, np.round(255 * self.alpha).astype(np.uint8)])
        write_png(path, colour, metadata)

    def save_8_bit(self, path: str | Path) -> None:
        """Write an image that was 8-bit sRGB as a PNG, without loss. Raises ImageError."""
        assert self.eight_bit
        self.save_png(path, {_FORMAT: _VERSION, **self.provenance})

    @classmethod
    @checked
    def load(cls, path: str | Path) -> Picture:
        """Read an EXR written by `save`. Raises ImageError."""
        channels, header = read_exr_channels(path)
        if header.get(_FORMAT) != _VERSION:
            found = (
                f"version {header[_FORMAT]}" if _FORMAT in header else "another program's EXR, or a plain picture"
            )
            raise ImageError(
                f"{path}: is not a baseline of this version of glpath, but {found}.",
                "Make it again: pytest --glpath-update all.",
            )
        try:
            mean = _layer(channels, "")
            noise = None
            if "glpath.batch_counts" in header:
                counts = np.array(json.loads(header["glpath.batch_counts"]), np.int64)
                blocks = [_layer(channels, f"batch{i}.")[::BLOCK_SIDE, ::BLOCK_SIDE] for i in range(len(counts))]
                noise = Noise(_layer(channels, "variance."), np.stack(blocks), counts)
        except (KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise ImageError(f"{path}: is a baseline of which something is missing: {error}.") from error
        if not np.isfinite(mean).all():
            raise ImageError(f"{path}: holds pixels that are NaN or infinite.", "Make it again.")
        wrong = "" if noise is None else unusable_noise(mean, noise)
        if wrong:
            raise ImageError(f"{path}: its noise cannot be: {wrong}.", "Make it again.")
        alpha = channels["A"].astype(np.float64) if "A" in channels else None
        if alpha is not None and not (alpha.min() >= 0 and alpha.max() <= 1):
            raise ImageError(f"{path}: holds alpha that is not from 0 to 1.", "Make it again.")
        return cls(mean, noise, glpath_texts(header), alpha)

    @staticmethod
    def is_baseline(header: Mapping[str, str]) -> bool:
        """Return True if an EXR with this header was written by `save`, of any version."""
        return _FORMAT in header

    def shares_samples_with(self, other: Picture) -> bool:
        """Return True if both used the same random numbers, so that they can be compared batch by batch."""
        names = ("glpath.seed", "glpath.ranges")
        return (
            self.noise is not None
            and other.noise is not None
            and np.array_equal(self.noise.batch_counts, other.noise.batch_counts)
            and all(self.provenance.get(name, "") == other.provenance.get(name) for name in names)
        )

    def differences_in_making(self, reference: Picture) -> list[str]:
        """Return the settings in which the two renders differed, one sentence each.

        For example "max_depth is 4 here and 5 in the reference".
        """
        found = []
        for key, word in _DECIDES.items():
            ours, theirs = self.provenance.get(key), reference.provenance.get(key)
            if ours == theirs or not (self.provenance and reference.provenance):
                continue
            if key == "glpath.settings" and ours and theirs:
                found += _differing_settings(_json_object(ours), _json_object(theirs))
            elif key == "glpath.scene_hash" and ours and theirs:
                found.append("the scene's content (geometry, materials, lights or camera) is another one")
            else:
                found.append(f"{word} is {_stated(ours)} here and {_stated(theirs)} in the reference")
        return found


def encode_bright_srgb(linear: Float64) -> Float64:
    """Encode linear values as sRGB, with the curve continued above white (1) instead of clipped."""
    return encode_srgb(linear) + 1.055 * (np.maximum(linear, 1.0) ** (1 / 2.4) - 1.0)


def glpath_texts(header: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts of a file's header whose keys begin with "glpath."."""
    return {key: value for key, value in header.items() if key.startswith("glpath.") and isinstance(value, str)}


def _json_object(text: str) -> dict[str, Any]:
    """Return the JSON object in a text of a header, or {} for any other text, because files may be damaged."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _differing_settings(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    return [
        f"{name} is {_stated(ours.get(name))} here and {_stated(theirs.get(name))} in the reference"
        for name in names
    ]


def _stated(value: object) -> str:
    return "not stated" if value is None else str(value)


def _layer(channels: Mapping[str, NDArray[np.float32]], prefix: str) -> Float64:
    return np.stack([channels[f"{prefix}{colour}"] for colour in "RGB"], axis=-1).astype(np.float64)


def _over_blocks(image: Float64) -> Float64:
    """Return the (h, w, 3) means of an image (H, W, 3) over its blocks."""
    rows, columns = (np.arange(0, side, BLOCK_SIDE) for side in image.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)
    means: Float64 = sums / block_pixels(image.shape[:2])[..., None]
    return means


def unusable_noise(mean: Float64, noise: Noise) -> str:
    """Return the reason why `noise` cannot be the noise of an image with this mean; "" if it can be.

    Radiance is not negative. So the variance of a mean of batches is largest if a single batch has all the light.
    It is then mean² (1 - w) / w / (batches - 1), where w is that batch's fraction of the path sets. Larger values
    would hide every change.
    """
    counts, blocks = noise.batch_counts, noise.block_batches
    if counts.ndim != 1 or len(counts) < 2 or (counts <= 0).any():
        return f"its batches are of {counts.tolist()} path sets"
    if noise.variance.shape != mean.shape or blocks.shape != (len(counts), *block_pixels(mean.shape).shape, 3):
        return f"it is of another size than the picture ({mean.shape[1]} x {mean.shape[0]})"
    for name, values in (("variances", noise.variance), ("means of batches", blocks)):
        wrong = int(np.count_nonzero(~(np.isfinite(values) & (values >= 0))))
        if wrong:
            return f"{wrong} of {values.size} {name} are NaN, infinite or negative"
    share = counts / counts.sum()
    largest = mean**2 * (1 - share.min()) / share.min() / (len(counts) - 1)
    wrong = int(np.count_nonzero(noise.variance > largest * (1 + _ROUNDING) + np.finfo(np.float32).tiny))
    if wrong:
        return f"{wrong} of {mean.size} variances are larger than those of any radiance of this mean"
    whole = np.tensordot(share, blocks, axes=1)
    if not np.allclose(whole, _over_blocks(mean), rtol=_ROUNDING, atol=_ROUNDING * float(np.abs(mean).mean())):
        return "its batches are not those of the picture"
    return ""


def block_pixels(shape: tuple[int, ...]) -> Float64:
    """Return the (h, w) number of pixels in each block of an image of `shape` (H, W)."""
    sides = [np.minimum(BLOCK_SIDE, side - np.arange(0, side, BLOCK_SIDE)) for side in shape[:2]]
    counts: Float64 = np.multiply.outer(sides[0], sides[1]).astype(np.float64)
    return counts


def spread_blocks(blocks: Float64, shape: tuple[int, ...]) -> Float64:
    """Return (H, W, ...) with each value of (h, w, ...) repeated over its block."""
    height, width = shape[:2]
    return np.repeat(np.repeat(blocks, BLOCK_SIDE, axis=0), BLOCK_SIDE, axis=1)[:height, :width]
