"""Positions of the sun: heights at noon by their closed form, and how near the bins are to any sun of the year."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.apps.daylight.compass import Compass
from glpath.apps.daylight.sun_bins import OBLIQUITY, SunBins, sun_angles
from glpath.errors import UsageError

COMPASS = Compass((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))


@pytest.mark.parametrize("latitude", [-35.0, 0.0, 51.5, 70.0])
def test_the_sun_is_highest_at_noon(latitude: float) -> None:
    declination = np.radians([-OBLIQUITY, 0.0, OBLIQUITY])
    _, sine = sun_angles(np.radians(latitude), declination, 0.0)
    expected = 90.0 - np.abs(latitude - np.degrees(declination))
    assert np.degrees(np.arcsin(sine)) == pytest.approx(expected, abs=1e-9)


def test_the_sun_rises_in_the_east_and_is_south_at_noon() -> None:
    azimuth, sine = sun_angles(np.radians(50.0), 0.0, np.radians([-90.0, 0.0, 90.0]))
    assert np.degrees(azimuth) % 360 == pytest.approx([90.0, 180.0, 270.0])
    assert sine == pytest.approx([0.0, np.cos(np.radians(50.0)), 0.0], abs=1e-12)


@pytest.mark.parametrize("latitude", [-90.0, -35.0, 0.0, 51.5, 68.0])
@pytest.mark.parametrize("count", [50, 600])
def test_every_sun_of_the_year_is_near_a_bin(latitude: float, count: int) -> None:
    bins = SunBins.of(latitude, COMPASS, count)
    assert 0.5 * count < len(bins.directions) <= count
    assert (bins.directions[:, 2] > 0).all()
    days, hours = np.meshgrid(np.linspace(-OBLIQUITY, OBLIQUITY, 60), np.linspace(-180, 180, 240))
    azimuth, sine = sun_angles(np.radians(latitude), np.radians(days.ravel()), np.radians(hours.ravel()))
    up = sine > 0
    suns = COMPASS.directions(azimuth[up], sine[up])
    nearest = bins.directions[bins.nearest(suns)]
    off = np.degrees(np.arccos(np.clip(np.sum(nearest * suns, axis=1), -1, 1)))
    assert off.max() < 0.9 * bins.spacing


def test_latitudes_that_are_none_are_refused() -> None:
    with pytest.raises(UsageError, match="from -90 to 90"):
        SunBins.of(91.0, COMPASS)
    with pytest.raises(UsageError, match="suns: 0 where a whole number from 1"):
        SunBins.of(0.0, COMPASS, 0)
    assert len(SunBins.of(50.0, COMPASS, 1).directions) == 1
