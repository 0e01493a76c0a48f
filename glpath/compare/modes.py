"""The modes by name, and which one suits which picture."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, get_args

from glpath.compare.measures import matching_pair
from glpath.compare.perceptual import flip
from glpath.compare.picture import Picture
from glpath.compare.pixels import exact, fuzzy
from glpath.compare.statistical import stat
from glpath.compare.verdict import Verdict
from glpath.errors import UsageError

Mode = Literal["exact", "fuzzy", "stat", "flip"]
MODES: tuple[str, ...] = get_args(Mode)

_COMPARISONS: dict[str, Callable[..., Verdict]] = {"exact": exact, "fuzzy": fuzzy, "stat": stat, "flip": flip}


def compare(picture: Picture, reference: Picture, mode: str | None = None, **limits: float) -> Verdict:
    """Whether two pictures count as the same.

    mode   : "exact", "fuzzy", "stat" or "flip"; None: `default_mode` of the reference
    limits : of the mode, see the function of its name: `threshold`, `edge`, `failpercent` of fuzzy; `alpha`,
             `tolerance`, `sees` of stat; `mean`, `ppd` of flip

    Raises ImageError for pictures that cannot be compared (shapes, NaN); UsageError for a mode or a limit that is
    not there, or a mode that this picture does not allow.
    """
    matching_pair(picture.mean, reference.mean)
    mode = default_mode(picture, reference) if mode is None else mode
    _check_limits(mode, limits)
    return _COMPARISONS[mode](picture, reference, **limits)


def default_mode(picture: Picture, reference: Picture) -> Mode:
    """ "stat" where both are films that have noise, as their metadata says, else "fuzzy"."""
    noisy = [side.provenance.get("glpath.noisy") == "true" for side in (picture, reference)]
    return "stat" if all(noisy) else "fuzzy"


def read_limits(mode: str, texts: Sequence[str]) -> dict[str, float]:
    """Limits as a command line has them, "threshold=4". Raises UsageError."""
    limits = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            limits[name.strip()] = float(value)
        except ValueError:
            raise UsageError(f"limit {text}: expected NAME=NUMBER.") from None
    _check_limits(mode, limits)
    return limits


def _check_limits(mode: str, limits: Mapping[str, Any]) -> None:
    """Raise UsageError for a mode, or a limit of it, that is not there or is no number."""
    if mode not in _COMPARISONS:
        raise UsageError(f"mode: there is no {mode!r}. Allowed: {', '.join(MODES)}.")
    known = [p.name for p in inspect.signature(_COMPARISONS[mode]).parameters.values() if p.kind == p.KEYWORD_ONLY]
    for name, value in limits.items():
        if name not in known:
            raise UsageError(
                f"mode {mode}: has no limit {name!r}. Allowed: {', '.join(known) or 'none'}.",
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UsageError(f"{name}: found {value!r}, expected a number.")
