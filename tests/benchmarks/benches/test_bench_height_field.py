"""`bench height-field`: its field, its suns, and a small run."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.benches.height_field import LATITUDE, bench_height_field, hills, suns_of_a_year


def test_the_suns_are_up_for_half_of_the_year_and_stand_in_the_south_at_noon() -> None:
    azimuth, altitude, hours = suns_of_a_year()
    assert hours.sum() == pytest.approx(365 * 12, rel=0.01)
    assert altitude.max() == pytest.approx(90 - LATITUDE + 23.44, abs=0.3)
    assert abs(azimuth[altitude.argmax()] - 180) < 10
    assert 500 < len(hours) <= 650


def test_the_field_is_steep_but_no_wall() -> None:
    field = hills(129)
    steepness = np.degrees(np.arccos(field.normals()[..., 2]))
    assert 10 < np.median(steepness) < 40
    assert steepness.max() < 75


def test_a_small_bench_measures_all() -> None:
    said: list[str] = []
    report = bench_height_field(0.001, said.append)
    assert report.measured["triangles"] == 2 * 99**2
    assert report.measured["points"] == 1000
    assert {"points: sky view factors", "points: sun hours"} <= set(said)
    if "sky_off_rms" in report.measured:
        assert report.measured["sky_off_rms"] < 0.02  # few rays
        assert report.measured["sun_hours_off_most"] < 0.005
