"""Expected errors of a film's image, original and denoised, estimated from the differences between its batches.

Poor at:  short renders. Up to 8 path sets are in one batch, so there is nothing to compare.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.film import denoise as open_image_denoise
from glpath.film.batches import BLOCK
from glpath.film.bias import BIAS_PROBE, REJECTED_GATHER, Bias, bias_of
from glpath.film.noise import MIN_BATCHES, error_bound
from glpath.film.sums import FilmSums, mean_of
from glpath.system.arguments import checked

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Fraction of the pixels that `denoised_noise` measures; the noisiest 0.1 % are left out.
_LOOKED_AT = 0.999


@checked
@dataclass(eq=False, repr=False)
class FilmErrors(FilmSums):
    """Film sums, their denoised image, and the estimated errors of the image and of the denoised image."""

    # Cache: ranges of path sets, and the result of `denoised` for them.
    _denoised: tuple[tuple[tuple[int, int], ...], Float32] | None = field(default=None, init=False)
    # Cache: ranges of path sets, and the result of `_denoised_halves` for them.
    _halves: tuple[tuple[tuple[int, int], ...], tuple[float, list[Float64]]] | None = field(
        default=None, init=False
    )
    # Cache: ranges of path sets, and the guides of `denoised` for them.
    _guides: tuple[tuple[tuple[int, int], ...], open_image_denoise.Guides] | None = field(default=None, init=False)

    def denoised(self) -> Float32:
        """Return (H, W, 3) float32: `mean` without noise, by Open Image Denoise; W sr^-1 m^-2, linear Rec. 709.

        The film does not change. Denoise a film after it is merged and complete, because denoised images cannot be
        added. `glpath.film.denoise` lists weaknesses.

        Raises UsageError for a film without path sets, or without the AOVs albedo and normal (`aovs=("albedo",
        "normal")` of a render, or `glpath render --denoise`). Raises GlpathError if pyoidn is missing.
        """
        if self._denoised is None or self._denoised[0] != self.ranges:
            self._denoised = self.ranges, self._denoise(self.mean)
        return self._denoised[1].copy()

    def _denoise(self, mean: Float64) -> Float32:
        if self._guides is None or self._guides[0] != self.ranges:
            found = open_image_denoise.Guides.of(self.aov("albedo"), self.aov("normal"))
            self._guides = self.ranges, found
        return open_image_denoise.denoised(mean, self._guides[1])

    def variance_of_mean(self) -> Float64:
        """Return (H, W, 3) float64: the variance of `mean`, estimated from the differences between batches.

            sum over batches of count (mean of batch - mean)^2 / (batches - 1) / path sets

        The estimate is unbiased for independent path sets, even if batches differ in size. Batches of one Sobol
        sequence are not independent: they complement each other, so the true variance is smaller.

        Raises UsageError if fewer than two batches have path sets.
        """
        used = self._batches_to_compare()
        mean = self.mean
        spread = np.zeros_like(mean)
        for batch in used:
            count = self.batch_counts[batch]
            spread += count * (self.radiance_sums[batch] / count - mean) ** 2
        variance: Float64 = spread / ((len(used) - 1) * self.path_sets)
        return variance

    def _batches_to_compare(self) -> NDArray[np.intp]:
        used = np.flatnonzero(self.batch_counts)
        if len(used) < 2:
            raise UsageError(
                f"film: {self.path_sets} path sets lie in one batch; an error is estimated between batches.",
                f"Render more than {BLOCK} path sets.",
            )
        return used

    def relative_error(self, denoised: bool = False) -> float | None:
        """Return the expected error of the image: sqrt(mean over pixels and channels of variance / (mean² + 0.01)).

        denoised : True for the error of `denoised`, from `variance_of_denoised`, which may raise errors

        The square of the result estimates `compare.relative_mse` against a converged image; 0.02 is noise of about
        2 %. With Sobol samples (the default), the result tends to be too large, see `variance_of_mean`. It includes
        the error of a radiosity solution that the gather itself has computed, see `solution_error`. It does not
        include the bias of a buffer, or of elements that are too coarse. None if fewer than two batches have path
        sets.
        """
        if np.count_nonzero(self.batch_counts) < 2:
            return None
        if denoised:
            shown = self.denoised().astype(np.float64)
            square = np.mean(self.variance_of_denoised() / (shown**2 + 0.01))
        else:
            square = np.mean(self.variance_of_mean() / (self.mean**2 + 0.01))
        return float(np.hypot(np.sqrt(square), self.solution_error() or 0.0))

    def error_bound(self, confidence: float = 0.95) -> float | None:
        """Return an upper bound of the image's error at a given confidence; a noise limit is compared with it.

        The error is the noise that `relative_error` estimates, without `solution_error`: sqrt(mean over pixels and
        channels of e² / (mean² + 0.01)). So 0.01 is noise of 1 % if the image is not dark. With the default
        confidence, at least 95 of 100 renders with other seeds have an error below their bound. `glpath.film.noise`
        describes the method. None if fewer than four batches have path sets, that is below 25 path sets. Raises
        UsageError for a confidence that is not between 0 and 1.
        """
        if not 0 < confidence < 1:
            raise UsageError(f"confidence: {confidence:g} where a number above 0 and below 1 is needed")
        used = np.flatnonzero(self.batch_counts)
        if len(used) < MIN_BATCHES:
            return None
        return error_bound(self.radiance_sums[used], self.batch_counts[used], confidence)

    def solution_error(self) -> float | None:
        """Return the part of `relative_error` caused by a gather's radiosity solution.

        More path sets do not reduce it. It is computed from the standard error of the image's mean, divided by that
        mean (`FilmMetadata.solution_error`). It is assumed to be equal in all pixels, and weighted as in
        `relative_error`. None if it is not known.
        """
        error, mean = self.metadata.solution_error, self.mean
        if error is None:
            return None
        whole = float(mean.mean())
        return error / whole * float(np.sqrt(np.mean(mean**2 / (mean**2 + 0.01)))) if whole > 0 else 0.0

    def bias(self) -> Bias | None:
        """Return the bias of a gather, measured before it was rendered: see `glpath.film.bias`.

        None if it is not known, because the engine has no bias, or the device had no memory for the measurement.
        """
        probe = self.metadata.statistics.get(BIAS_PROBE)
        return None if probe is None else bias_of(probe)

    def rejected_bias(self) -> Bias | None:
        """Return the bias of a gather that was rejected for the integrator "path"; None if none was rejected."""
        probe = self.metadata.statistics.get(REJECTED_GATHER)
        return None if probe is None else bias_of(probe)

    def denoised_noise(self) -> float | None:
        """Return the noise of `denoised`, on the scale of `relative_error`, from two separately denoised halves.

        The stop rule "clean" compares this value with its limit. It excludes `solution_error`, and the noisiest
        thousandth of the pixels.

        Costs two calls of the denoiser. Raises the errors of `denoised`. None if fewer than two batches have path
        sets.
        """
        if np.count_nonzero(self.batch_counts) < 2:
            return None
        share, (a, b) = self._denoised_halves()
        variance = 2 * share * (1 - share) * (a - b) ** 2
        of_pixels = np.mean(variance / ((share * a + (1 - share) * b) ** 2 + 0.01), axis=2).ravel()
        # The worst pixels are left out, because a few bright ones would dominate the mean.
        return float(np.sqrt(np.sort(of_pixels)[: math.ceil(_LOOKED_AT * of_pixels.size)].mean()))

    def variance_of_denoised(self) -> Float64:
        """Return (H, W, 3) float64: the squared error of `denoised`, estimated from two separately denoised halves.

            2 n_a n_b / n² (half a denoised - half b denoised)²

        The halves have n_a and n_b path sets, about equal, each a contiguous part of the sequence up to 64 path
        sets. If denoising were linear, this would be twice the variance of `denoised`. The factor 2 makes up for
        errors common to both halves, such as the denoiser's own bias, which the difference does not show. The value
        of a single pixel is a rough estimate. The root of their mean was within a factor of 2.5 of the error
        against converged images.

        Costs two more calls of the denoiser, and memory for their images. Raises the errors of `denoised`, and
        UsageError if fewer than two batches have path sets.
        """
        share, (a, b) = self._denoised_halves()
        variance: Float64 = 2 * share * (1 - share) * (a - b) ** 2
        return variance

    def _denoised_halves(self) -> tuple[float, list[Float64]]:
        """Return the fraction of path sets in the first half, and both halves denoised by the smallest network."""
        if self._halves is None or self._halves[0] != self.ranges:
            self._halves = self.ranges, self._denoise_halves()
        return self._halves[1]

    def _denoise_halves(self) -> tuple[float, list[Float64]]:
        used = self._batches_to_compare()
        ends = np.cumsum(self.batch_counts[used])
        middle = 1 + int(np.argmin(np.abs(2 * ends[:-1] - ends[-1])))
        means = (
            mean_of(self.radiance_sums[half], self.batch_counts[half]) for half in (used[:middle], used[middle:])
        )
        albedo, normal = self.aov("albedo"), self.aov("normal")
        soon = open_image_denoise.soon_denoised
        return float(ends[middle - 1] / ends[-1]), [soon(mean, albedo, normal).astype(np.float64) for mean in means]
