"""Comparison modes by name, and the default mode for two images."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from glpath.compare.measures import matching_pair
from glpath.compare.perceptual import flip
from glpath.compare.picture import Picture
from glpath.compare.pixels import exact, fuzzy
from glpath.compare.statistical import stat
from glpath.compare.verdict import Verdict
from glpath.errors import UsageError
from glpath.system.arguments import checked, short_repr
from glpath.system.numerals import real

Mode = Literal["exact", "fuzzy", "stat", "flip"]
MODES: tuple[str, ...] = get_args(Mode)

# Backgrounds over which images with alpha are compared: name in messages, and sRGB value.
_GROUNDS = {"over black": 0.0, "over white": 1.0}

_COMPARISONS: dict[str, Callable[..., Verdict]] = {"exact": exact, "fuzzy": fuzzy, "stat": stat, "flip": flip}


@checked
def compare(picture: Picture, reference: Picture, mode: str | None = None, **limits: float) -> Verdict:
    """Compare two images and return the verdict.

    mode   : "exact", "fuzzy", "stat" or "flip"; None: `default_mode` of the reference
    limits : limits of the mode, see the function with its name: `threshold`, `edge`, `failpercent` of fuzzy;
             `alpha`, `tolerance`, `sees` of stat; `mean`, `local`, `ppd` of flip

    If one of the images has alpha, `exact` compares alpha as well. `fuzzy` and `flip` compare the images over black
    and over white, and the worse result counts.

    Raises ImageError for images that cannot be compared (shapes, NaN); UsageError for an unknown mode or limit, or
    a mode that these images do not allow.
    """
    matching_pair(picture.mean, reference.mean)
    mode = default_mode(picture, reference) if mode is None else mode
    _check_limits(mode, limits)
    if picture.alpha is None and reference.alpha is None:
        return _COMPARISONS[mode](picture, reference, **limits)
    if mode == "exact":
        pairs = {"colour": (picture, reference), "alpha": (picture.opacity(), reference.opacity())}
    else:
        pairs = {name: (picture.over(ground), reference.over(ground)) for name, ground in _GROUNDS.items()}
    verdicts = {name: _COMPARISONS[mode](*pair, **limits) for name, pair in pairs.items()}
    worst = max(verdicts, key=lambda name: (not verdicts[name].passed, verdicts[name].severity))
    return replace(verdicts[worst], summary=f"{worst}: {verdicts[worst].summary}")


@checked
def max_difference_pair(picture: Picture, reference: Picture) -> tuple[Picture, Picture]:
    """Return both images without alpha, laid over black or over white, whichever gives the larger mean difference.

    Raises ImageError for shapes that differ.
    """
    matching_pair(picture.mean, reference.mean)
    if picture.alpha is None and reference.alpha is None:
        return picture, reference
    pairs = [(picture.over(ground), reference.over(ground)) for ground in _GROUNDS.values()]
    return max(pairs, key=lambda pair: float(np.abs(pair[0].mean - pair[1].mean).mean()))


@checked
def default_mode(picture: Picture, reference: Picture) -> Mode:
    """Return "stat" if the metadata of both images reports noise and neither is denoised; otherwise "fuzzy"."""
    noisy = [side.provenance.get("glpath.noisy") == "true" and not side.denoised for side in (picture, reference)]
    return "stat" if all(noisy) else "fuzzy"


@checked
def read_limits(mode: str, texts: Sequence[str]) -> dict[str, float]:
    """Return limits from texts of a command line, such as "threshold=4". Raises UsageError."""
    limits = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            limits[name.strip()] = real(value)
        except ValueError:
            raise UsageError(f"limit {text}: expected NAME=NUMBER.") from None
    _check_limits(mode, limits)
    return limits


def _check_limits(mode: str, limits: Mapping[str, Any]) -> None:
    """Raise UsageError for an unknown mode, and for a limit that is unknown or not a number."""
    if not isinstance(mode, str) or mode not in _COMPARISONS:
        raise UsageError(f"mode: there is no {short_repr(mode)}. Allowed: {', '.join(MODES)}.")
    known = [p.name for p in inspect.signature(_COMPARISONS[mode]).parameters.values() if p.kind == p.KEYWORD_ONLY]
    for name, value in limits.items():
        if name not in known:
            raise UsageError(
                f"mode {mode}: has no limit {short_repr(name)}. Allowed: {', '.join(known) or 'none'}.",
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UsageError(f"{name}: found {short_repr(value)}, expected a number.")
