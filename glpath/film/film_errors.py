"""The errors to expect of a film's image, as it is and denoised, from how much its batches differ.

Poor at:  the error of a render shorter than two blocks (16 path sets): there is nothing to compare.
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

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# The share of the pixels by which a picture looks clean or not.
_LOOKED_AT = 0.999


@dataclass(eq=False, repr=False)
class FilmErrors(FilmSums):
    """Sums whose image can be denoised, and what it and the denoised one err by."""

    # The result of `denoised`, and its path sets.
    _denoised: tuple[tuple[tuple[int, int], ...], Float32] | None = field(default=None, init=False)
    # The two halves that `variance_of_denoised` compares, and what `denoised` goes by, likewise.
    _halves: tuple[tuple[tuple[int, int], ...], tuple[float, list[Float64]]] | None = field(
        default=None, init=False
    )
    _guides: tuple[tuple[tuple[int, int], ...], open_image_denoise.Guides] | None = field(default=None, init=False)

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

    def bias(self) -> Bias | None:
        """Return the bias of a gather, measured before it was rendered: see `glpath.film.bias`.

        None if it is not known: the engine has no bias, or the device had no room for the measurement.
        """
        probe = self.metadata.statistics.get(BIAS_PROBE)
        return None if probe is None else bias_of(probe)

    def rejected_bias(self) -> Bias | None:
        """Return the bias of the gather that "path" replaced; None if no gather was rejected."""
        probe = self.metadata.statistics.get(REJECTED_GATHER)
        return None if probe is None else bias_of(probe)

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
            mean_of(self.radiance_sums[half], self.batch_counts[half]) for half in (used[:middle], used[middle:])
        )
        albedo, normal = self.aov("albedo"), self.aov("normal")
        soon = open_image_denoise.soon_denoised
        return float(ends[middle - 1] / ends[-1]), [soon(mean, albedo, normal).astype(np.float64) for mean in means]
