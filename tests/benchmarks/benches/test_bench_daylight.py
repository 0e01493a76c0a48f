"""The bench of daylight: its office for both programs, its skies, and a small run of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.benches import daylight
from benchmarks.peers import radiance
from benchmarks.scenes.daylit_office import CLOTH, TRANSMITTANCE, as_toml, office, sensors
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.apps.daylight.hourly_skies import horizontal_weights
from glpath.errors import GlpathError
from glpath.io import scene_from_dict
from glpath.io.weather import read_weather


def test_radiance_gets_glass_and_cloth_of_its_own() -> None:
    text = radiance.described(scene_from_dict(office(blinds=True)))
    glass = next(line for line in text.split("void ") if line.startswith("glass"))
    inside, index = float(glass.split()[5]), float(glass.split()[8])
    # Two faces of the index, with all reflections between them [Radiance's glass].
    r = ((1 - index) / (1 + index)) ** 2
    assert (1 - r) ** 2 * inside / (1 - (r * inside) ** 2) == pytest.approx(TRANSMITTANCE, rel=1e-6)
    cloth = next(line for line in text.split("void ") if line.startswith("trans")).split()
    both, share = float(cloth[5]), float(cloth[10])
    assert (both * share, both * (1 - share)) == pytest.approx((CLOTH, (1 - CLOTH) * 0.5))


def test_the_scene_file_is_the_description() -> None:
    import tomllib

    assert tomllib.loads(as_toml(office())) == office()
    assert len(sensors()) == 192


def test_the_sun_is_in_its_patch() -> None:
    weather = read_weather(daylight.real_year())
    ground = scene_from_dict({**office(), "shapes": office()["shapes"][:1]})
    found = daylight_coefficients(ground, [[4, 3, 0.5]], [0, 0, 1.0], samples=2, max_depth=1)
    hours = daylight.patches_alone(
        weather, daylight_coefficients(ground, [[4, 3, 0.5]], [0, 0, 1.0], samples=1, latitude=36.1, max_depth=1)
    )
    level = horizontal_weights(found.patches) @ hours
    expected = weather.diffuse_illuminance + weather.direct_illuminance * np.sin(
        np.radians(np.maximum(weather.sun.altitude, 0))
    )
    # The patch's height stands in for the sun's.
    assert level.sum() == pytest.approx(expected[weather.sun.altitude > 0].sum(), rel=0.02)


@pytest.mark.evidence
def test_a_small_bench_measures_what_it_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without Radiance it claims seconds alone."""

    def missing() -> str:
        raise GlpathError("pyradiance is not installed")

    monkeypatch.setattr(radiance, "version", missing)
    report = daylight.bench_daylight(1, 0.001)
    assert report.measured["city_sensors"] == 1000
    assert report.measured["office_s"] > 0
    assert report.measured["shard_sensors"] == 100
    assert report.measured["shard_GiB"] > 0
    assert any("sDA" in note for note in report.notes)
    assert report.faults == []
