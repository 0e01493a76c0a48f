"""What the elements of a radiosity solution do to a picture gathered from it, estimated without a reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.film.batches import BLOCK
from glpath.film.film import Film
from glpath.integrators.gather_settings import Solution
from glpath.io import AnyScene
from glpath.rendering.calls import render

Float64 = NDArray[np.float64]

# Pixels along a side of the blocks over which differences are taken: below that they are all noise.
_BLOCK = 8


@dataclass(frozen=True)
class ElementError:
    """How far a gather is off because its solution is made of elements.

    bias        : the picture's mean is too bright by this share of it, negative: too dark
    bias_error  : standard error of that, from the noise of the path sets
    relmse      : of the means of 8 x 8 pixels, with the noise taken off: comparable to a film's
    blocks      : (h, w, 3) float64, how much brighter each block is, W sr^-1 m^-2; with noise
    """

    bias: float
    bias_error: float
    relmse: float
    blocks: Float64

    def recorded(self) -> dict[str, float]:
        """The numbers, as JSON has values."""
        return {"bias": self.bias, "bias_error": self.bias_error, "relmse": self.relmse}

    def __str__(self) -> str:
        size = f"{100 * self.bias:+.2g} +- {100 * self.bias_error:.1g} % of the mean"
        return f"the elements change the picture by {size}, relMSE about {self.relmse:.1g}"


def element_error(
    scene: AnyScene, radiosity: Solution | None = None, *, spp: int = 64, lookup_depth: int = 2, **options: Any
) -> ElementError:
    """Estimate what the elements of a radiosity solution do to the picture that is gathered from it.

    Two gathers of the same path sets are compared: one looks the solution up at vertex `lookup_depth`, as the
    picture does, the other a vertex further on, where what is wrong with it is reflected once more before it is
    seen. The difference is the error of the first, less that of the second, which is a fraction of it: beside
    Mitsuba's converged Cornell box, the relMSE found is from half to all of the true one.

    Parameters
    ----------
    scene        : what `glpath.render` takes
    radiosity    : the solution; without, the scene is solved first
    spp          : path sets of each of the two; from 16 on, more than one batch being needed for an error
    lookup_depth : of the gather
    options      : what else `glpath.render` takes with `integrator="gather"`: camera, crop, lookup_distance ...

    Raises what `glpath.render` raises, and UsageError for too few path sets.

    Source: two estimates of one integral as in multilevel Monte Carlo (Giles 2015), used for the bias alone.

    Example
    -------
    >>> import glpath
    >>> solution = glpath.solve_radiosity("cornell-box-36", patches=210)
    >>> found = glpath.element_error("cornell-box-36", solution, spp=16, resolution=(64, 64))
    >>> found.blocks.shape
    (8, 8, 3)
    """
    if spp < 2 * BLOCK:
        raise UsageError(f"element_error: spp={spp}; noise and error are separable from {2 * BLOCK} path sets on.")
    nearer, further = (
        render(scene, integrator="gather", radiosity=radiosity, spp=spp, lookup_depth=depth, **options)
        for depth in (lookup_depth, lookup_depth + 1)
    )
    difference = _batches(nearer) - _batches(further)
    count = len(difference)
    mean = difference.mean(axis=0)
    noise = difference.var(axis=0, ddof=1) / count
    reference = _in_blocks(further.mean)
    level = further.mean.mean()
    totals = difference.mean(axis=(1, 2, 3)) / level
    return ElementError(
        bias=float(totals.mean()),
        bias_error=float(totals.std(ddof=1) / np.sqrt(count)),
        relmse=max(0.0, float(np.mean((mean**2 - noise) / (reference**2 + 0.01)))),
        blocks=mean,
    )


def _batches(film: Film) -> Float64:
    """(batches, h, w, 3): the blocks' means of radiance in each batch."""
    used = np.flatnonzero(film.batch_counts)
    return np.stack([_in_blocks(film.radiance_sums[i] / film.batch_counts[i]) for i in used])


def _in_blocks(picture: Float64) -> Float64:
    """(h, w, 3) means over 8 x 8 pixels of (H, W, 3), what is left at the right and below as smaller blocks."""
    rows, columns = (np.arange(0, n, _BLOCK) for n in picture.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(picture, rows, axis=0), columns, axis=1)
    height, width = (np.diff(np.append(e, n)) for e, n in zip((rows, columns), picture.shape[:2], strict=True))
    return np.asarray(sums / (height[:, None] * width)[..., None])
