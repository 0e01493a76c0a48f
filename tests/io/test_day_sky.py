"""Skies of a day in a scene file: units, north, places and times, and what a wrong one is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import GlpathError, SceneError, SceneWarning
from glpath.scene.model import Environment
from glpath.sky.perez import PerezSky
from glpath.system.units import EFFICACY
from tests.support.weather_files import write_epw

NOON = {"latitude": 47.5, "longitude": 8.5, "time": "2024-06-21T12:30", "timezone": 1}
SUN = {"altitude": 30, "azimuth": 90}


def scene(unit: str = "radiometric", **sky: Any) -> dict[str, Any]:
    return {
        "unit": unit,
        "camera": {"position": [3, 3, 3], "target": [0, 0, 0], "up": [0, 0, 1]},
        "materials": {"black": {"reflectance": 0.0}},
        "shapes": [{"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "material": "black"}],
        "sky": {"type": "perez", "up": [0, 0, 1], **sky},
    }


def sky_of(unit: str = "radiometric", **sky: Any) -> Environment:
    made = glpath.load_scene(scene(unit, **sky)).sky
    assert isinstance(made, Environment)
    return made


@pytest.mark.parametrize(
    ("up", "north", "east"),
    [
        ([0, 0, 1], [0, 1, 0], [1, 0, 0]),
        ([0, 1, 0], [0, 0, -1], [1, 0, 0]),
        ([1, 0, 0], [0, 0, 1], [0, 1, 0]),
    ],
)
def test_where_north_is(up: list[int], north: list[int], east: list[int]) -> None:
    for azimuth, towards in ((0, north), (90, east), (180, [-x for x in north])):
        sun = sky_of(up=up, direct=500, diffuse=100, altitude=30, azimuth=azimuth).sun
        assert sun is not None
        np.testing.assert_allclose(sun.direction, 0.5 * np.array(up) + np.sqrt(0.75) * np.array(towards), atol=1e-9)
    level = {"altitude": 0, "azimuth": 0, "spectrum": "solar"}
    turned = sky_of(up=up, direct=500, diffuse=100, north=(np.array(east) + up).tolist(), **level).sun
    np.testing.assert_allclose(turned.direction, east, atol=1e-9)  # type: ignore[union-attr]


def test_light_is_in_lux_by_daylight_s_efficacy() -> None:
    model = PerezSky.of(600, 100, 30)
    lux, watts, solar = (
        sky_of(unit, direct=600, diffuse=100, **SUN, **more)
        for unit, more in (("photometric", {}), ("radiometric", {}), ("radiometric", {"spectrum": "solar"}))
    )
    assert lux.sun is not None
    assert watts.sun is not None
    assert solar.sun is not None
    assert lux.sun.irradiance[0] == pytest.approx(600 * model.direct_efficacy())
    assert watts.sun.irradiance[0] == pytest.approx(600 * model.direct_efficacy() / EFFICACY)
    assert solar.sun.irradiance[0] == pytest.approx(600)
    assert not lux.solar
    assert not watts.solar
    assert solar.solar
    overhead = [[0.1, 0.1, 0.99]]
    ratio = lux.radiance(overhead)[0, 0] / solar.radiance(overhead)[0, 0]
    assert ratio == pytest.approx(float(model.diffuse_efficacy()), rel=1e-5)


def test_measured_lux_are_the_same_in_either_unit() -> None:
    model = PerezSky.of(600, 100, 30)
    expected = 600 * 0.5 * model.direct_efficacy() + 100 * model.diffuse_efficacy()
    day = {"direct": 600, "diffuse": 100, **SUN}
    points = [[0.5, 0.5, 1]] * 16
    for unit in ("radiometric", "photometric"):
        found = glpath.irradiance(scene(unit, **day), points, [0, 0, 1], spp=64, max_depth=1)
        assert found.illuminance().mean() == pytest.approx(float(expected), rel=0.02)
    with pytest.warns(SceneWarning, match="illuminance is not"):
        found = glpath.irradiance(scene(spectrum="solar", **day), points, [0, 0, 1], spp=64, max_depth=1)
    assert found.values.mean() == pytest.approx(400, rel=0.02)


def test_parts_of_the_light() -> None:
    assert sky_of(direct=600, diffuse=100, sun_disc=False, **SUN).sun is None
    alone = sky_of(type="sun", direct=600, spectrum="solar", **SUN)
    assert alone.mean_integral == pytest.approx(600, rel=2e-5)
    overcast = sky_of(direct=0, diffuse=100, **SUN)
    assert overcast.sun is None
    ground = sky_of(direct=600, diffuse=100, spectrum="solar", ground=0.5, **SUN)
    assert ground.radiance([[0.1, 0.2, -0.3]])[0, 0] == pytest.approx(0.5 * 400 / np.pi, rel=1e-6)
    cie = sky_of(type="cie", cie_type=1, illuminance=100.0, ground=0.2)
    assert cie.radiance([[0.1, 0.2, -0.3]])[0, 0] == pytest.approx(20 / np.pi, rel=1e-3)


def test_of_a_site_and_time() -> None:
    pytest.importorskip("pvlib")
    clear = sky_of(spectrum="solar", **NOON).sun
    assert clear is not None
    assert 700 < clear.irradiance[0] < 1000
    assert np.degrees(np.arcsin(clear.direction[2])) == pytest.approx(90 - 47.5 + 23.44, abs=0.1)
    assert clear.direction[1] < 0  # in the south
    offset = sky_of(spectrum="solar", latitude=47.5, longitude=8.5, time="2024-06-21T13:30+02:00").sun
    np.testing.assert_allclose(offset.direction, clear.direction)  # type: ignore[union-attr]
    given = sky_of(spectrum="solar", direct=500, diffuse=100, **NOON).sun
    assert given.irradiance[0] == 500  # type: ignore[union-attr]


def test_of_an_hour_of_a_weather_file(tmp_path: Path) -> None:
    pytest.importorskip("pvlib")
    file = str(write_epw(tmp_path / "a.epw"))
    sun = sky_of(weather=file, time="2030-06-20T12:10", spectrum="solar").sun
    assert sun is not None
    assert sun.irradiance[0] > 500
    # The middle of the hour, whatever the minute.
    assert np.degrees(np.arcsin(sun.direction[2])) == pytest.approx(65.9, abs=0.2)
    assert sky_of(weather=file, time="2030-06-21T12:10", spectrum="solar").sun is None  # an overcast day
    for more, message in (
        ({"time": "2030-12-20T22:10"}, "degrees below the horizon"),
        ({"time": "2024-02-29T12:00"}, "has no hour at 02-29"),
        ({"time": "2024-06-21T12:00", "direct": 5}, "says nothing beside weather and time"),
        ({}, "lacks the field `time`"),
    ):
        with pytest.raises(SceneError, match=message):
            sky_of(weather=file, **more)


@pytest.mark.parametrize(
    ("sky", "message"),
    [
        ({}, "has no sun, but the position of the sun is given by one of"),
        ({"direct": 600, **SUN}, "lacks the field `diffuse`, which a sky of type perez needs"),
        ({"type": "sun", "direct": 600, **SUN}, "`diffuse`, which a sky of type sun needs to know the lumens"),
        ({"direct": 600, "diffuse": 100, "altitude": 30}, "lacks the field `azimuth`"),
        ({"direct": 600, "diffuse": 100, "sun": [0, 0, 1], "altitude": 30}, "has sun and altitude"),
        ({"direct": 600, "diffuse": 100, "altitude": -5, "azimuth": 0}, "puts the sun 5.0 degrees below the"),
        ({"direct": 600, "diffuse": 100, "altitude": 95, "azimuth": 0}, "from 0 to 90 degrees"),
        ({"direct": 60000, "diffuse": 100, **SUN}, "above the atmosphere the sun has 1367"),
        ({"direct": 0, "diffuse": 0, **SUN}, "is dark"),
        ({"direct": 600, "diffuse": 100, "sun": [1, 0, 1], "north": [0, 1, 0]}, "says nothing beside sun"),
        ({"direct": 600, "diffuse": 100, **SUN, "north": [0, 0, 2]}, "goes along `up`"),
        ({"direct": 600, "diffuse": 100, **SUN, "zenith": 3.0}, "has `zenith`, which is not a field of such a sky"),
        ({"type": "cie", "cie_type": 1, "zenith": 3.0, "direct": 5}, "has `direct`, which is not a field of such"),
        ({"type": "sun", "direct": 600, "diffuse": 10, **SUN, "sun_disc": False}, "is of the sun alone"),
        ({**NOON, "time": "noon"}, "a date and time by ISO 8601"),
        ({**NOON, "time": "2024-06-21T12:30Z"}, "has an offset, and the sky a `timezone`"),
        ({**NOON, "time": "2924-06-21T12:30"}, "of a year from 1678 to 2261"),
        ({**NOON, "time": "0001-01-01T00:00", "timezone": 14}, "of a year from 1678 to 2261"),
        ({**NOON, "time": "9999-12-31T23:00", "timezone": -14}, "of a year from 1678 to 2261"),
    ],
)
def test_wrong_skies_are_refused(sky: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        sky_of(**sky)


def test_solar_watts_are_no_lux() -> None:
    with pytest.raises(SceneError, match="is solar in a photometric scene"):
        sky_of("photometric", direct=600, diffuse=100, spectrum="solar", **SUN)


def test_without_pvlib_the_line_to_type_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pvlib", None)
    with pytest.raises(GlpathError, match=r'pip install "glpath\[sky\]"'):
        sky_of(**NOON)
