"""What is counted of hours: by hand."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.apps.daylight import metrics

LUX = np.array([[0.0, 99.0, 100.0, 299.9], [300.0, 3000.0, 3000.1, 50.0]])


def test_autonomy_and_useful_daylight() -> None:
    assert metrics.daylight_autonomy(LUX).tolist() == [0.0, 0.75]
    assert metrics.daylight_autonomy(LUX, 100.0).tolist() == [0.5, 0.75]
    useful = metrics.useful_daylight(LUX)
    assert useful.tolist() == [[0.5, 0.5, 0.0, 0.0], [0.25, 0.0, 0.5, 0.25]]
    any_hours = np.random.default_rng(1).gamma(1.0, 900.0, (5, 99))
    assert metrics.useful_daylight(any_hours).sum(axis=1) == pytest.approx(np.ones(5))


def test_blinds_close_when_more_than_two_percent_of_the_sensors_are_in_sunlight() -> None:
    sunlight = np.zeros((100, 4))
    sunlight[:2, 1] = 1000.0  # two percent, no more
    sunlight[:3, 2] = 1000.0
    sunlight[:, 3] = 999.0
    assert metrics.sunlit_share(sunlight).tolist() == [0.0, 0.02, 0.03, 0.0]
    assert metrics.blinds_closed(metrics.sunlit_share(sunlight)).tolist() == [False, False, True, False]


def test_sda_asks_for_half_of_the_time_and_ase_for_more_than_250_hours() -> None:
    assert metrics.spatial_autonomy([0.5, 0.4999, 1.0, 0.0]) == 0.5
    assert metrics.sunlight_exposure([250.0, 251.0, 0.0, 4000.0]) == 0.5


def test_fractions_of_weighted_sensors_are_those_of_sensors_repeated_so_often() -> None:
    times = [3, 1, 2]
    lux, autonomy, hours = np.array([[0.0, 1e3], [1e3, 1e3], [1e3, 0.0]]), [0.6, 0.2, 0.5], [0.0, 300.0, 251.0]
    assert metrics.sunlit_share(lux, weights=times) == pytest.approx(metrics.sunlit_share(np.repeat(lux, times, 0)))
    for fraction, values in ((metrics.spatial_autonomy, autonomy), (metrics.sunlight_exposure, hours)):
        assert fraction(values, weights=times) == pytest.approx(fraction(np.repeat(values, times)))
