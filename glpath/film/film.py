"""The film: sums of radiance and how many path sets are in them.

Sums, never means, so that resuming a render and merging two are additions. What a path tracer hands in are
multiples of one power of two, small enough that float64 adds them without rounding: then path sets 0..64 equal
0..32 merged with 32..64, bit for bit, in whatever order they came.

Sums are kept apart in batches, since the paths of a set may share directions or points of a sequence: neighbouring
pixels err together, and the error of an image can only be seen between sets. Which batch a set belongs to follows
from its number, so any ranges merge.

Cost:     24 bytes per pixel and batch: 50 MB for 512 x 512.
Poor at:  the error of a render shorter than two blocks (16 path sets): there is nothing to compare.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glpath.errors import ImageError, UsageError
from glpath.film import denoise as open_image_denoise
from glpath.film import image
from glpath.film.aovs import (
    AOV_KINDS,
    AOVS,
    DENOISER_AOVS,
    FAR,
    ID_AOVS,
    SHAPES,
    add_aov,
    guides_denoiser,
    min_depths,
)
from glpath.film.batches import BATCHES, BLOCK, batch_of, united
from glpath.film.bias import UNBIASED, Bias, bias_of
from glpath.film.cryptomatte import RANKS, Cryptomatte, Kind, ShapeCounts, cryptomatte
from glpath.film.image import UInt8, check_exposure, encode_png, png_html, write_exr, write_png
from glpath.film.image import tonemap as tonemapped
from glpath.film.metadata import FilmMetadata, differences, joined, merged_values
from glpath.film.noise import MIN_BATCHES, error_bound
from glpath.film.npz_file import FilmParts, read_parts, write_parts
from glpath.system.files import is_stream
from glpath.system.npz import open_npz
from glpath.system.versions import versions

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


# The share of the pixels by which a picture looks clean or not.
_LOOKED_AT = 0.999
WRITABLE = (".png", ".exr", ".npz")


# Of the longer side of the image that a notebook shows.
_PREVIEW = 1024


@dataclass(eq=False, repr=False)
class Film:
    """Sums of radiance over path sets, in batches.

    radiance_sums : (BATCHES, H, W, 3) float64, in `metadata.unit`, W sr^-1 m^-2 or cd m^-2; linear Rec. 709, row 0
                    at the top
    batch_counts  : (BATCHES,) int64, path sets in each sum; one path set is one path for every pixel
    ranges        : path sets in the sums, as disjoint half-open (start, stop), in order, never touching
    metadata      : what made it
    aov_sums      : (H, W, n) float64 by name, over all path sets: what `metadata.aov_sums` names; see `aov`
    shape_counts  : how many samples of each pixel have hit which shape, where `metadata.counts_shapes`
    """

    radiance_sums: Float64
    batch_counts: NDArray[np.int64]
    ranges: tuple[tuple[int, int], ...]
    metadata: FilmMetadata
    aov_sums: dict[str, Float64] = field(default_factory=dict)
    shape_counts: ShapeCounts | None = None
    #: Called when a notebook is about to show the film, to remove a picture of it that stands there.
    before_shown: Callable[[], None] | None = field(default=None, init=False)
    # The result of `denoised`, and its path sets.
    _denoised: tuple[tuple[tuple[int, int], ...], Float32] | None = field(default=None, init=False)
    # The two halves that `variance_of_denoised` compares, and what `denoised` goes by, likewise.
    _halves: tuple[tuple[tuple[int, int], ...], tuple[float, list[Float64]]] | None = field(
        default=None, init=False
    )
    _guides: tuple[tuple[tuple[int, int], ...], open_image_denoise.Guides] | None = field(default=None, init=False)

    @classmethod
    def empty(cls, metadata: FilmMetadata) -> Film:
        """A film of the size of the metadata's window, without any path set."""
        return cls(*FilmParts.empty(metadata))

    def add(
        self,
        start: int,
        stop: int,
        radiance_sum: NDArray[np.floating[Any]],
        aov_sums: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    ) -> None:
        """Add the sum (H, W, 3) over the path sets start..stop (half-open), which lie in one block (see `blocks`).

        aov_sums : the same of each of the film's `aov_sums`; where it counts shapes, as "shapes"
                   (H, W, stop - start) the numbers + 1 of those that the samples have hit, 0 for none

        Raises UsageError for path sets that are already in the film.
        """
        assert 0 <= start < stop, f"an empty range of path sets, {start}..{stop}"
        assert start // BLOCK == (stop - 1) // BLOCK, f"path sets {start}..{stop} are not of one block"
        assert radiance_sum.shape == self.radiance_sums.shape[1:], f"a sum of shape {radiance_sum.shape}"
        assert np.isfinite(radiance_sum).all(), f"path sets {start}..{stop} hold a NaN or an infinity"
        held = self.aov_sums.keys() | ({SHAPES} if self.shape_counts is not None else set())
        assert aov_sums.keys() == held, f"AOVs {[*aov_sums]} for a film of {[*held]}"
        self.ranges = united(self.ranges, ((start, stop),))
        for name in self.aov_sums:
            add_aov(name, self.aov_sums[name], aov_sums[name])
        if self.shape_counts is not None:
            self.shape_counts += ShapeCounts.of(aov_sums[SHAPES])
        batch = batch_of(start)
        self.radiance_sums[batch] += radiance_sum
        self.batch_counts[batch] += stop - start

    @property
    def path_sets(self) -> int:
        """Path sets in the film: samples per pixel."""
        return int(self.batch_counts.sum())

    @property
    def nbytes(self) -> int:
        """Bytes of the sums in memory."""
        shapes = 0 if self.shape_counts is None else self.shape_counts.nbytes
        return self.radiance_sums.nbytes + sum(sums.nbytes for sums in self.aov_sums.values()) + shapes

    @property
    def mean(self) -> Float64:
        """(H, W, 3) float64, the image: W sr^-1 m^-2 or cd m^-2, linear Rec. 709, row 0 at the top.

        Raises UsageError when there is no path set in it.
        """
        if not self.path_sets:
            raise UsageError("film: holds no path set, so there is no image.", "Render at least one.")
        return _mean(self.radiance_sums, self.batch_counts)

    @property
    def alpha(self) -> Float64 | None:
        """(H, W) float64, the share of a pixel's samples that meet a surface; None of what has a background.

        `mean` is premultiplied by it: there is no light where nothing is.
        """
        if not self.metadata.transparent or not self.path_sets:
            return None
        return np.asarray(self.aov_sums["depth"][..., 1] / self.path_sets)

    def aov(self, name: str) -> NDArray[Any]:
        """An AOV of the film, row 0 at the top, antialiased as `mean` is; `glpath.film.aovs` describes each.

        Raises UsageError for one that was not rendered, or a film of no path set.
        """
        if name not in self.metadata.aovs:
            held = ", ".join(self.metadata.aovs) or "none"
            raise UsageError(
                f"film: holds no AOV {name!r}; those that it holds: {held}.",
                f"Render with aovs={DENOISER_AOVS if name in DENOISER_AOVS else (name,)!r}."
                if name in AOVS
                else f"There are {', '.join(AOVS)}.",
            )
        if not self.path_sets:
            raise UsageError("film: holds no path set, so there is no image.", "Render at least one.")
        if name in ID_AOVS:
            return self._ids(name)
        if name == "samples":
            return self.path_sets - self.aov_sums["dropped"][..., 0].astype(np.int64)
        if name == "indirect":
            # Exact before it is divided: both are multiples of one power of two.
            light = np.add.reduce(self.radiance_sums, axis=0) - self.aov_sums["direct"]
            return np.asarray(light / self.path_sets)
        sums = self.aov_sums[name]
        if name == "depth_min":
            return np.minimum(min_depths(sums[..., 0]), FAR)
        kind = AOV_KINDS[name]
        if kind.over == "samples":
            return np.asarray(sums / self.path_sets)
        value, hits = sums[..., :-1], sums[..., -1:]
        origin = self.metadata.position_origin if name == "position" else None
        mean = np.where(hits > 0, value / np.maximum(hits, 1) + (0.0 if origin is None else origin), kind.empty)
        return np.asarray(mean[..., 0] if mean.shape[2] == 1 else mean)

    def _layer(self, name: str) -> NDArray[Any]:
        near = name != "position" or self.metadata.position_origin is None
        return (self if near else replace(self, metadata=replace(self.metadata, position_origin=None))).aov(name)

    def _ids(self, name: str) -> NDArray[np.int64]:
        assert self.shape_counts is not None, "the metadata name an AOV that the film has not"
        of = self.metadata.shape_materials
        group = np.array(of if name == "material_id" else range(len(of)), np.int64)
        return np.asarray(self.shape_counts.ranked(group, 1)[0][..., 0] + 1)

    def cryptomatte(self, kind: Kind, ranks: int = RANKS) -> Cryptomatte:
        """Which objects, or materials, cover each pixel, and how much of it: what compositors make mattes of.

        kind  : "object" (shapes of one name are one) or "material"; the film needs the AOV "object_id" or
                "material_id"
        ranks : names that a pixel may have; of more, those that cover least are left out. The film itself counts
                all, whatever their number

        Raises UsageError as `aov` does, and for another kind.

        `film.cryptomatte("object").matte("floor")` is (H, W), from 0 to 1.
        """
        if kind not in ("object", "material"):
            raise UsageError(f"cryptomatte: {kind!r}; allowed are object, material")
        if ranks < 1:
            raise UsageError(f"cryptomatte: {ranks} ranks where one is needed at least")
        if self.shape_counts is None or not self.path_sets:
            self.aov(f"{kind}_id")  # which says why not
        assert self.shape_counts is not None, "refused just now"
        names = list(self.metadata.shape_names)
        if kind == "material":
            names = [self.metadata.material_names[i] for i in self.metadata.shape_materials]
        return cryptomatte(kind, self.shape_counts, names, self.path_sets, ranks)

    @property
    def is_shown_denoised(self) -> bool:
        """Whether a notebook shows `denoised`: of a film with noise, with the AOVs and the denoiser for it."""
        there = self.metadata.noisy and guides_denoiser(self.metadata.aovs)
        return there and self.path_sets > 0 and open_image_denoise.can_denoise()

    def denoised(self) -> Float32:
        """(H, W, 3) float32, `mean` without its noise, by Open Image Denoise: W sr^-1 m^-2, linear Rec. 709.

        The film stays as it is. Denoise what is merged and done: pictures that were denoised do not add up. See
        `glpath.film.denoise` for what it is poor at.

        Raises UsageError for a film without the AOVs albedo and normal (`aovs=("albedo", "normal")` of a render, or
        `glpath render --denoise`) or of no path set; GlpathError where pyoidn is missing.
        """
        if self._denoised is None or self._denoised[0] != self.ranges:
            self._denoised = self.ranges, self._denoise(self.mean)
        return self._denoised[1].copy()

    def _denoise(self, mean: Float64) -> Float32:
        if self._guides is None or self._guides[0] != self.ranges:
            found = open_image_denoise.Guides.of(self.aov("albedo"), self.aov("normal"))
            self._guides = self.ranges, found
        return open_image_denoise.denoised(mean, self._guides[1])

    def merge(self, other: Film) -> Film:
        """A film with the path sets of both, which must be different ones of the same render.

        Devices may differ; the metadata then names both, and the sum is no longer that of one device to the bit.
        Raises UsageError, which names what differs.
        """
        merged = replace(
            self,
            radiance_sums=self.radiance_sums.copy(),
            batch_counts=self.batch_counts.copy(),
            aov_sums={name: sums.copy() for name, sums in self.aov_sums.items()},
        )
        merged.include(other)
        return merged

    def include(self, other: Film) -> None:
        """Add the path sets of another film to this one, as `merge`, whose errors it raises before it adds any."""
        if found := differences(self.metadata, other.metadata):
            words = "; ".join(
                f"{what} is {theirs} in one film and {ours} in the other" for what, ours, theirs in found
            )
            raise UsageError(f"film: cannot merge: {words}.", "Only path sets of the same render can be added up.")
        self.ranges = united(self.ranges, other.ranges)
        for batch in np.flatnonzero(other.batch_counts):
            self.radiance_sums[batch] += other.radiance_sums[batch]
        self.batch_counts += other.batch_counts
        for name, sums in self.aov_sums.items():
            add_aov(name, sums, other.aov_sums[name])
        if self.shape_counts is not None and other.shape_counts is not None:
            self.shape_counts = self.shape_counts + other.shape_counts
        self.metadata = replace(
            self.metadata,
            device=joined(self.metadata.device, other.metadata.device),
            versions=merged_values(self.metadata.versions, other.metadata.versions),
            unit=self.metadata.unit or other.metadata.unit,
            elapsed_s=self.metadata.elapsed_s + other.metadata.elapsed_s,
            statistics=merged_values(self.metadata.statistics, other.metadata.statistics),
            stop_rule="",
            error_bound=None,
        )

    def __getstate__(self) -> dict[str, Any]:
        """For pickle, without the batches that hold nothing: eight path sets of a worker are in one of eight."""
        used = self.batch_counts > 0
        sums = self.radiance_sums if used.all() else self.radiance_sums[used]  # 400 MB need not be copied
        kept = dict.fromkeys(("_denoised", "_guides", "_halves", "before_shown"))
        return {**vars(self), "radiance_sums": sums, **kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        sums, used = state["radiance_sums"], self.batch_counts > 0
        if used.all() and sums.flags.writeable:
            return
        self.radiance_sums = np.zeros((BATCHES, *sums.shape[1:]))
        self.radiance_sums[used] = sums

    def variance_of_mean(self) -> Float64:
        """(H, W, 3) float64, the estimated variance of `mean`, from how much the batches differ.

            sum over batches of count (mean of batch - mean)^2 / (batches - 1) / path sets

        which has no bias for independent path sets, also when batches are of different size. Batches of one Sobol
        sequence are not independent: they complement each other, so that the true variance is smaller than this.

        Raises UsageError when fewer than two batches hold anything.
        """
        used = self._batches_to_compare()
        mean = self.mean
        spread = np.zeros_like(mean)
        for batch in used:
            count = self.batch_counts[batch]
            spread += count * (self.radiance_sums[batch] / count - mean) ** 2
        variance: Float64 = spread / ((len(used) - 1) * self.path_sets)
        return variance

    def denoised_noise(self) -> float | None:
        """The noise of `denoised`, as `relative_error` gives it, from two halves alone: a render that ends when it
        looks clean compares with it. `solution_error` is not in it, nor the worst thousandth of the pixels.

        Costs two calls of the denoiser. Raises what `denoised` raises. None where fewer than two batches hold
        anything.
        """
        if np.count_nonzero(self.batch_counts) < 2:
            return None
        share, (a, b) = self._denoised_halves()
        variance = 2 * share * (1 - share) * (a - b) ** 2
        of_pixels = np.mean(variance / ((share * a + (1 - share) * b) ** 2 + 0.01), axis=2).ravel()
        # A few bright pixels would speak for all.
        return float(np.sqrt(np.sort(of_pixels)[: math.ceil(_LOOKED_AT * of_pixels.size)].mean()))

    def variance_of_denoised(self) -> Float64:
        """(H, W, 3) float64, the estimated squared error of `denoised`, from two halves of the film denoised apart.

            2 n_a n_b / n² (half a denoised - half b denoised)²

        of halves of n_a and n_b path sets, about equal, each a contiguous run of the sequence up to 64 path sets.
        Were denoising linear, it would be twice the variance of `denoised`. What both halves have wrong alike, such
        as the denoiser's own bias, is not seen; the factor stands for that. The value of a pixel is a rough guess.
        The root of their mean has been within a factor of 2.5 of the error against converged pictures.

        Costs two more calls of the denoiser, and their pictures. Raises what `denoised` raises, and UsageError when
        fewer than two batches hold anything.
        """
        share, (a, b) = self._denoised_halves()
        variance: Float64 = 2 * share * (1 - share) * (a - b) ** 2
        return variance

    def _denoised_halves(self) -> tuple[float, list[Float64]]:
        """The share of the path sets in the first half, and both denoised, soon."""
        if self._halves is None or self._halves[0] != self.ranges:
            self._halves = self.ranges, self._denoise_halves()
        return self._halves[1]

    def _denoise_halves(self) -> tuple[float, list[Float64]]:
        used = self._batches_to_compare()
        ends = np.cumsum(self.batch_counts[used])
        middle = 1 + int(np.argmin(np.abs(2 * ends[:-1] - ends[-1])))
        means = (
            _mean(self.radiance_sums[half], self.batch_counts[half]) for half in (used[:middle], used[middle:])
        )
        albedo, normal = self.aov("albedo"), self.aov("normal")
        soon = open_image_denoise.soon_denoised
        return float(ends[middle - 1] / ends[-1]), [soon(mean, albedo, normal).astype(np.float64) for mean in means]

    def _batches_to_compare(self) -> NDArray[np.intp]:
        used = np.flatnonzero(self.batch_counts)
        if len(used) < 2:
            raise UsageError(
                f"film: {self.path_sets} path sets lie in one batch; an error is estimated between batches.",
                f"Render more than {BLOCK} path sets.",
            )
        return used

    def relative_error(self, denoised: bool = False) -> float | None:
        """The error to expect of the image: sqrt(mean over pixels and channels of variance / (mean² + 0.01)).

        denoised : of `denoised`, by `variance_of_denoised`, whose errors it raises

        Its square estimates `compare.relative_mse` against a converged image; 0.02 is noise of about 2 %. With
        Sobol samples (the default) it is too large rather than too small, see `variance_of_mean`. Of a gather that
        made its own radiosity solution, that one's error is in it, see `solution_error`. It does not see the bias
        of a buffer or of elements that are too coarse. None where fewer than two batches hold anything.
        """
        if np.count_nonzero(self.batch_counts) < 2:
            return None
        if denoised:
            shown = self.denoised().astype(np.float64)
            square = np.mean(self.variance_of_denoised() / (shown**2 + 0.01))
        else:
            square = np.mean(self.variance_of_mean() / (self.mean**2 + 0.01))
        return float(np.hypot(np.sqrt(square), self.solution_error() or 0.0))

    def bias(self) -> Bias | None:
        """The bias of a gather's picture, beside unbiased paths: see `glpath.film.bias`.

        None where it is not known: of engines without bias, of a crop, of points, and of a part that a cluster's
        worker has rendered.
        """
        unbiased = self.metadata.statistics.get(UNBIASED)
        return None if unbiased is None else bias_of(self.radiance_sums, self.batch_counts, unbiased)

    def solution_error(self) -> float | None:
        """The part of `relative_error` from a gather's radiosity solution: more path sets do not lower it.

        The standard error of the picture's mean over that mean (`FilmMetadata.solution_error`), taken to be the
        same in all pixels, each weighed as `relative_error` does. None where it is not known.
        """
        error, mean = self.metadata.solution_error, self.mean
        if error is None:
            return None
        whole = float(mean.mean())
        return error / whole * float(np.sqrt(np.mean(mean**2 / (mean**2 + 0.01)))) if whole > 0 else 0.0

    def error_bound(self, confidence: float = 0.95) -> float | None:
        """The bound of the image's error at a confidence, which a noise limit compares with.

        The error is the noise that `relative_error` estimates, without `solution_error`: sqrt(mean over pixels and
        channels of e² / (mean² + 0.01)), so that 0.01 is noise of 1 % where the image is not dark. Of 100 renders
        with other seeds, at least 95 have an error below their bound, by `confidence`. See `glpath.film.noise` for
        how. None where fewer than four batches hold anything, that is below 25 path sets.
        """
        used = np.flatnonzero(self.batch_counts)
        if len(used) < MIN_BATCHES:
            return None
        return error_bound(self.radiance_sums[used], self.batch_counts[used], confidence)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """`mean`, for `np.asarray(film)` and what takes arrays."""
        if copy is False:
            raise ValueError("a film holds sums, so that its image as an array is always a copy")
        return self.mean.astype(dtype or np.float64, copy=False)

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """The stops that an exposure means for this image.

        exposure : stops; "auto" as `image.auto_exposure` finds; None as the scene says, or else "auto"

        Raises UsageError for another one, or an image of no path set.
        """
        check_exposure(exposure)
        asked = self.metadata.exposure if exposure is None else exposure
        return image.auto_exposure(self.mean) if asked is None or asked == "auto" else float(asked)

    def to_srgb(
        self,
        *,
        exposure: float | Literal["auto"] | None = None,
        tonemap: str = "srgb",
        denoise: bool = False,
    ) -> UInt8:
        """(H, W, 3) uint8 sRGB, row 0 at the top: what `save` writes as .png; with `alpha` (H, W, 4).

        exposure : as of `exposure_stops`
        tonemap  : one of `image.TONEMAPS`
        denoise  : show `denoised`, with the same stops

        Raises UsageError for another exposure or operator, or an image of no path set; what `denoised` raises.
        """
        light, alpha = self.denoised() if denoise else self.mean, self.alpha
        if alpha is None:
            return tonemapped(light, self.exposure_stops(exposure), tonemap)
        colours = light / np.where(alpha > 0, alpha, 1.0)[..., None]  # a PNG's are not premultiplied
        opacity = (alpha * 255.0 + 0.5).astype(np.uint8)[..., None]
        return np.concatenate([tonemapped(colours, self.exposure_stops(exposure), tonemap), opacity], axis=2)

    def save(
        self,
        path: str | Path,
        *,
        exposure: float | Literal["auto"] | None = None,
        tonemap: str = "srgb",
        denoise: bool = False,
    ) -> None:
        """Write the film; the suffix says how. The file appears whole or not at all.

        .png : 8-bit sRGB, as `to_srgb` has it; its header says the stops
        .exr : float32 radiance, linear Rec. 709; a crop keeps its window in the whole image. AOVs that the film
               holds are layers, each of its own name: albedo.R, G, B, normal.X, Y, Z, depth.Z, object_id.X ..., see
               `image.layer_channels`; with ids, the Cryptomattes CryptoObject00 to 02 and CryptoMaterial00 to 02
        .npz : everything, exactly; `Film.load` reads it back, to be merged or resumed

        denoise : a .png holds `denoised`, and its header has glpath.denoised; an .exr has it as the layer
                  denoised.R, G, B, beside the picture as it is. An .npz is the same in any case

        A pipe or a device is written into; without a suffix, and at "-", standard output, it gets a PNG.

        All carry the metadata. Raises ImageError if it cannot be written, UsageError for another suffix, operator,
        or an image of no path set; what `denoised` raises.
        """
        path = check_suffix(path)
        suffix = path.suffix.lower() or ".png"
        if suffix == ".png":
            stops = self.exposure_stops(exposure)
            text = {"glpath.exposure_stops": f"{stops:g}", "glpath.tonemap": tonemap}
            picture = self.to_srgb(exposure=stops, tonemap=tonemap, denoise=denoise)
            write_png(path, picture, self.provenance(denoised=denoise) | text)
        elif suffix == ".exr":
            kinds: dict[str, Kind] = {"object_id": "object", "material_id": "material"}
            mattes = [self.cryptomatte(kind) for name, kind in kinds.items() if name in self.metadata.aovs]
            headers = [matte.header() for matte in mattes]
            write_exr(
                path,
                self.mean,
                self.provenance() | {key: text for header in headers for key, text in header.items()},
                window=self.metadata.window,
                full_resolution=self.metadata.full_resolution,
                layers=({"denoised": self.denoised()} if denoise else {})
                | {name: self._layer(name) for name in self.metadata.aovs},
                channels={name: pixels for matte in mattes for name, pixels in matte.channels().items()},
                alpha=self.alpha,
            )
        else:
            write_parts(
                path,
                FilmParts(
                    self.radiance_sums,
                    self.batch_counts,
                    self.ranges,
                    self.metadata,
                    self.aov_sums,
                    self.shape_counts,
                ),
            )

    @classmethod
    def load(cls, path: str | Path) -> Film:
        """Read a film written as .npz. Raises ImageError, also for one whose parts contradict each other."""
        return cls(*read_parts(path))

    def __repr__(self) -> str:
        m = self.metadata
        error = self.relative_error()
        noise = "" if error is None else f", error about {100 * error:.2g} %"
        depth = "light of all bounces" if m.max_depth is None else f"depth {m.max_depth}"
        return (
            f"<Film of {m.scene}: {m.window[2]} x {m.window[3]} pixels, {self.path_sets} path sets, "
            f"{depth}{noise}, {m.device or 'unknown device'}>"
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """Jupyter's view: the image, at most 1024 pixels long, as HTML and as PNG, and a line of text."""
        if self.before_shown is not None:
            self.before_shown()
        return self.shown()

    def shown(self) -> dict[str, object]:
        """The image by its MIME types, as `_repr_mimebundle_` gives it."""
        bundle: dict[str, object] = {"text/plain": repr(self)}
        if self.path_sets:
            seen = self.denoised().astype(np.float64) if self.is_shown_denoised else self.mean
            png = encode_png(tonemapped(_shrunk(seen, _PREVIEW), self.exposure_stops()))
            bundle |= {"image/png": png, "text/html": png_html(png, self.described())}
        return bundle

    def described(self) -> str:
        """The image in words, for those who do not see it: the scene, the integrator, path sets and size."""
        m = self.metadata
        width, height = m.window[2:]
        shown = ", denoised" if self.is_shown_denoised else ""
        return f"{m.scene}, by {m.integrator}, {self.path_sets} path sets, {width} x {height} pixels{shown}"

    def provenance(self, *, denoised: bool = False) -> dict[str, str]:
        """The provenance of the film, or of the picture that is `denoised`, and its path sets, as texts for a
        file's header."""
        return {
            "Software": f"glpath {self.metadata.versions.get('glpath', '')}".strip(),
            "glpath.path_sets": str(self.path_sets),
            "glpath.ranges": json.dumps(self.ranges),
            **self.metadata.as_strings(),
            **({"glpath.bias": json.dumps(vars(bias))} if (bias := self.bias()) is not None else {}),
            **(
                {"glpath.denoised": f"Open Image Denoise, pyoidn {versions('pyoidn').get('pyoidn', '')}"}
                if denoised
                else {}
            ),
        }


def read_image(path: str | Path) -> Float64:
    """Read an image, or the mean of a film, as (H, W, 3) float64, linear Rec. 709, row 0 at the top.

    .png : sRGB is undone; it holds what the tone map left, not radiance; .jpg as well
    .exr : channels R, G, B or Y; of a crop its own pixels only
    .npz : a film's mean, or the array `radiance`
    .npy : (H, W, 3) or (H, W)

    Raises ImageError for a file that is missing, broken, or of another kind.
    """
    if not holds_film(path):
        return image.read_image(path)
    film = Film.load(path)
    if not film.path_sets:
        raise ImageError(f"{path}: cannot be read as .npz: the film holds no path set.")
    return film.mean


def holds_film(path: str | Path) -> bool:
    """Whether a file holds a film, by the names in it. Raises ImageError where that can't be seen."""
    if Path(path).suffix.lower() != ".npz":
        return False
    with open_npz(path, ".npz") as stored:
        return "radiance_sums" in stored and "radiance" not in stored


def _mean(radiance_sums: Float64, batch_counts: NDArray[np.int64]) -> Float64:
    """(H, W, 3) float64, the mean of (B, H, W, 3) sums over batches of so many path sets each."""
    mean: Float64 = np.add.reduce(radiance_sums, axis=0) / batch_counts.sum()
    return mean


def check_suffix(path: str | Path) -> Path:
    """`path`, if a film can be written to a file of that name; else UsageError."""
    path = Path(path)
    if path.suffix.lower() not in WRITABLE and not (is_stream(path) and not path.suffix):
        found = f"the suffix {path.suffix}" if path.suffix else "no suffix"
        raise UsageError(f"{path}: an output cannot have {found}. Allowed: {', '.join(WRITABLE)}.")
    return path


def _shrunk(image: Float64, longest: int) -> Float64:
    """Averaged over whole blocks of pixels until no side is longer than `longest`."""
    n = -(-max(image.shape[:2]) // longest)
    height, width = (max(1, side // n) for side in image.shape[:2])
    rows, columns = min(n, image.shape[0]), min(n, image.shape[1])
    trimmed = image[: height * rows, : width * columns]
    shrunk: Float64 = trimmed.reshape(height, rows, width, columns, 3).mean(axis=(1, 3))
    return shrunk
