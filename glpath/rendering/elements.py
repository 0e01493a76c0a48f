"""Error of a gathered image due to the elements of its radiosity solution, estimated without a reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import TimeLimitError, UsageError
from glpath.film.batches import BLOCK
from glpath.film.film import Film
from glpath.integrators.gather_settings import Solution
from glpath.io import AnyScene
from glpath.rendering.calls import render
from glpath.system.arguments import checked

Float64 = NDArray[np.float64]

# Side of the blocks over which differences are averaged, pixels. Differences of smaller blocks would be mostly
# noise.
_BLOCK = 8


@checked
@dataclass(frozen=True)
class ElementError:
    """Error of a gather due to the elements of its solution.

    bias        : relative error of the image's mean; negative if it is too dark
    bias_error  : standard error of `bias`, from the noise of the path sets
    relmse      : relMSE of the means of 8 x 8 pixels, with noise subtracted; comparable to a film's relMSE
    blocks      : (h, w, 3) float64, mean excess radiance of each block, W sr^-1 m^-2, including noise
    """

    bias: float
    bias_error: float
    relmse: float
    blocks: Float64

    def recorded(self) -> dict[str, float]:
        """Return the numbers for JSON."""
        return {"bias": self.bias, "bias_error": self.bias_error, "relmse": self.relmse}

    def __str__(self) -> str:
        size = f"{100 * self.bias:+.2g} +- {100 * self.bias_error:.1g} % of the mean"
        return f"the elements change the picture by {size}, relMSE about {self.relmse:.1g}"


@checked
def element_error(
    scene: AnyScene, radiosity: Solution | None = None, *, spp: int = 64, lookup_depth: int = 2, **options: Any
) -> ElementError:
    """Estimate the error of a gathered image due to the elements of its radiosity solution.

    Two gathers of the same path sets are compared. One looks up the solution at vertex `lookup_depth`, as the image
    does. The other looks it up one vertex later, so its errors are reflected once more before they reach the
    camera. The difference is the error of the first gather minus the smaller error of the second. For Mitsuba's
    converged Cornell box, the estimated relMSE is between half and all of the true one.

    Parameters
    ----------
    scene        : any scene that `glpath.render` accepts
    radiosity    : solution; None: the scene is solved first
    spp          : path sets of each gather, at least 16, because an error needs more than one batch
    lookup_depth : `lookup_depth` of the image's gather
    options      : other options of `glpath.render` with `integrator="gather"`: camera, crop, lookup_distance ...
                   `film`, `time_limit`, `noise` and `clean` are refused, because both gathers need equal path sets

    Raises what `glpath.render` raises, and UsageError for too few path sets and for a black picture.

    Source: two estimates of one integral as in multilevel Monte Carlo (Giles 2015), used only for the bias.

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
    for name in ("film", "time_limit", "noise", "clean"):
        if options.get(name) is not None:
            raise UsageError(
                f"{name}: of a single render, but element_error compares two of the same path sets.", "Give spp."
            )
    films: list[Film] = []
    for depth in (lookup_depth, lookup_depth + 1):
        films.append(
            render(scene, integrator="gather", radiosity=radiosity, spp=spp, lookup_depth=depth, **options)
        )
        if films[-1].path_sets < spp:  # the limit of a command ended the gather
            raise TimeLimitError("element_error: the time limit ended a gather.", "Give it more time.")
    nearer, further = films
    level = further.mean.mean()
    if not level > 0:
        raise UsageError(
            "element_error: the picture is black, but its error is a fraction of its mean.",
            "Check the lights and the camera of the scene.",
        )
    difference = _batches(nearer) - _batches(further)
    count = len(difference)
    mean = difference.mean(axis=0)
    noise = difference.var(axis=0, ddof=1) / count
    reference = _in_blocks(further.mean)
    totals = difference.mean(axis=(1, 2, 3)) / level
    return ElementError(
        bias=float(totals.mean()),
        bias_error=float(totals.std(ddof=1) / np.sqrt(count)),
        relmse=max(0.0, float(np.mean((mean**2 - noise) / (reference**2 + 0.01)))),
        blocks=mean,
    )


def _batches(film: Film) -> Float64:
    """Return the blocks' mean radiances (batches, h, w, 3) in each batch."""
    used = np.flatnonzero(film.batch_counts)
    return np.stack([_in_blocks(film.radiance_sums[i] / film.batch_counts[i]) for i in used])


def _in_blocks(picture: Float64) -> Float64:
    """Return means (h, w, 3) over 8 x 8 pixels of (H, W, 3); blocks at the right and bottom may be smaller."""
    rows, columns = (np.arange(0, n, _BLOCK) for n in picture.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(picture, rows, axis=0), columns, axis=1)
    height, width = (np.diff(np.append(e, n)) for e, n in zip((rows, columns), picture.shape[:2], strict=True))
    return np.asarray(sums / (height[:, None] * width)[..., None])
