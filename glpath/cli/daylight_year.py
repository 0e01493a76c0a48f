"""Annual results of `glpath daylight`: their options, files and printed summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glpath.errors import UsageError
from glpath.system.files import is_stream
from glpath.system.numerals import real
from glpath.system.outputs import Save

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from glpath.apps.daylight.coefficients import DaylightCoefficients
    from glpath.apps.daylight.year import DaylightYear
    from glpath.io.weather import Weather


@dataclass(frozen=True, eq=False)
class YearRequest:
    """Options of the annual calculation.

    weather   : weather of the site
    occupied  : (H,) bool, True for hours of the weather in the occupied part of the day
    threshold : illuminance from which on an hour counts for daylight autonomy, lx
    ground    : albedo of the ground
    hours     : True if the .nc file holds the values of each sensor in each hour
    """

    weather: Weather
    occupied: NDArray[np.bool_]
    threshold: float
    ground: float
    hours: bool

    def of(self, coefficients: DaylightCoefficients, blinds: Sequence[DaylightCoefficients]) -> DaylightYear:
        """Return annual results computed from the coefficients. Raises UsageError, as `daylight_year` does.

        blinds : coefficients of the scene with blinds closed, one for each group of windows
        """
        from glpath.apps.daylight.year import year_of

        return year_of(coefficients, self.weather, tuple(blinds), self.occupied, self.threshold, self.ground)

    def save_as(self, year: DaylightYear) -> Save:
        """Return a function that writes the annual results to a path."""
        return lambda path: year.save(path, self.hours)


def year_request(
    weather: Path | None,
    occupied: str,
    threshold: float,
    ground: float,
    hours: bool,
    out: Sequence[Path],
    latitude: float | None,
) -> YearRequest | None:
    """Return the request, or None without --weather. Raises UsageError if options or output files contradict it.

    Warns with SceneWarning if the weather is of a part of a year.
    """
    for path in out:
        suffix = path.suffix.lower()
        if suffix == ".npz" and not is_stream(path):
            continue
        if weather is None or is_stream(path):
            raise UsageError(
                f"{path}: daylight coefficients are written as .npz.",
                "Name the file dc.npz, say; .nc and .csv are of a year: give --weather.",
            )
        from glpath.apps.daylight.year import check_suffix

        check_suffix(path)
    if weather is None:
        return None
    if latitude is not None:
        raise UsageError("--latitude: says nothing beside --weather, whose site has one.", "Leave it out.")
    from glpath.apps.daylight.year import check_settings, occupied_hours
    from glpath.io.weather import read_weather

    period = _hours(occupied)
    check_settings(period, threshold, ground)
    found = read_weather(weather)
    return YearRequest(found, occupied_hours(found, period), threshold, ground, hours)


def year_summary(year: DaylightYear) -> Iterator[str]:
    """Yield the printed lines of the annual results."""
    from numpy import average

    def mean(values: NDArray[np.float64]) -> Any:
        return average(values, axis=0, weights=year.coefficients.sensor_weights)

    occupied = int(year.occupied.sum())
    yield f"{year.weather.site}: {occupied:,} occupied hours, {len(year.skies):,} hours of daylight"
    yield (
        f"  daylight autonomy ({year.threshold:g} lx): mean {100 * mean(year.autonomy):.1f} %, minimum "
        f"{100 * year.autonomy.min():.1f} %; mean illuminance {mean(year.mean):,.0f} lx"
    )
    low, middle, enough, high = 100 * mean(year.useful)
    yield (
        f"  useful daylight: {low:.1f} % of the time below 100 lx, {middle:.1f} % to 300, {enough:.1f} % to 3000, "
        f"{high:.1f} % above"
    )
    if year.sda is not None:
        closed = " and ".join(f"{hours:,}" for hours in (year.closed & year.occupied).sum(axis=1))
        yield f"  sDA{year.threshold:g}/50%: {100 * year.sda:.1f} % (blinds closed in {closed} occupied hours)"
    else:
        yield (
            f"  {100 * year.autonomous_share:.1f} % of the sensors have {year.threshold:g} lx in half of the time; "
            "sDA counts with blinds: --blinds"
        )
    yield f"  ASE1000,250h: {100 * year.ase:.1f} %"
    yield (
        f"  irradiation {mean(year.irradiation.sum(axis=1)):,.0f} kWh/m2, hours of sun "
        f"{mean(year.sun_hours.sum(axis=1)):,.0f}, in the mean"
    )


def _hours(text: str) -> tuple[float, float]:
    first, _, last = text.partition("-")
    try:
        return real(first), real(last)
    except ValueError:
        raise UsageError(f"--occupied {text}: two hours of the day are needed.", "For example 8-18.") from None
