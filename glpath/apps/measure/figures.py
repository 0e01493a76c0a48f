"""Text of a measurement's summary: mean, minimum, maximum and uniformity, with standard errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from glpath.rendering.uniformity import Estimate, Spread


def figures(spread: Spread, digits: int = 4, unit: str = "lx") -> str:
    """Return mean, minimum, maximum, U0 (minimum / mean) and Ud (minimum / maximum) as text, with errors."""
    mean, minimum, maximum = (
        with_error(x, f"{x.value:.{digits}g}", shown)
        for x, shown in ((spread.mean, f" {unit}"), (spread.minimum, ""), (spread.maximum, ""))
    )
    text = f"mean {mean}, minimum {minimum}, maximum {maximum}"
    if not spread.mean.value > 0:
        return text
    u0, ud = (with_error(x, f"{x.value:.3f}") for x in (spread.u0, spread.ud))
    return f"{text}; U0 {u0}, Ud {ud}"


def with_error(of: Estimate, value: str, unit: str = "") -> str:
    """Append standard error and unit to a value's text; no error if it is unknown or at most 1e-4 of the value."""
    if not of.error > 1e-4 * abs(of.value):
        return f"{value}{unit}"
    return f"{value} ± {of.error:.2g}{unit}"
