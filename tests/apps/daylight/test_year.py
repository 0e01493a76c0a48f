"""A year of daylight: open ground beside the weather itself, hours beside the renderer, blinds, files, faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.daylight import metrics, year
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.apps.daylight.hourly_skies import HourlySkies, horizontal_weights
from glpath.apps.daylight.texels import Texels
from glpath.apps.daylight.year import DaylightYear, daylight_year
from glpath.cli.daylight import _summary
from glpath.cli.daylight_year import year_summary
from glpath.errors import SceneError, UsageError
from glpath.io import scene_from_dict
from glpath.io.weather import Weather, read_weather
from tests.support.weather_files import write_epw

LATITUDE = 47.5
GROUND = [[-30, -30, 0], [30, -30, 0], [30, 30, 0], [-30, 30, 0]]
#: Across the ground in the south of the origin.
WALL = [[-20, -4, 0], [20, -4, 0], [20, -4, 6], [-20, -4, 6]]
UP = [0.0, 0.0, 1.0]


def described(*quads: Any, **sky: Any) -> Any:
    return {
        "unit": "photometric",
        "camera": {"position": [0, -9, 2], "target": [0, 0, 0], "up": UP},
        "materials": {"grey": {"reflectance": 0.3}},
        "shapes": [{"type": "quad", "corners": corners, "material": "grey"} for corners in quads],
        **({"sky": sky} if sky else {}),
    }


@pytest.fixture(scope="module")
def epw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_epw(tmp_path_factory.mktemp("weather") / "nowhere.epw")


@pytest.fixture(scope="module")
def weather(epw: Path) -> Weather:
    return read_weather(epw)


def coefficients(*quads: Any, at: Any = ((0.0, 0.0, 0.0),), **options: Any) -> DaylightCoefficients:
    given = {"latitude": LATITUDE, "max_depth": 1, **options}
    return daylight_coefficients(scene_from_dict(described(*quads)), at, UP, **given)


@pytest.fixture(scope="module")
def open_ground() -> DaylightCoefficients:
    return coefficients(GROUND)


@pytest.fixture(scope="module")
def behind_wall() -> DaylightCoefficients:
    return coefficients(GROUND, WALL, at=[[0, 0, 0], [0, 12, 0], [0, -3.9, 0]])


@pytest.fixture(scope="module")
def of_open_ground(open_ground: DaylightCoefficients, weather: Weather) -> DaylightYear:
    return daylight_year(open_ground, weather)


def test_open_ground_has_the_light_that_the_weather_file_says(
    of_open_ground: DaylightYear, weather: Weather
) -> None:
    height = np.sin(np.radians(np.maximum(weather.sun.altitude, 0.0)))
    expected = weather.direct_normal * height + weather.diffuse_horizontal
    found = of_open_ground.light(quantity="irradiance")[0]
    # A low sun may be nearest to a position that counts as on the horizon.
    assert found == pytest.approx(expected, rel=2e-3, abs=0.2)
    month = weather.times.astype("datetime64[M]").astype(int) % 12
    by_month = np.bincount(month, expected, 12) / 1000
    assert of_open_ground.irradiation[0] == pytest.approx(by_month, rel=1e-3)
    sunny = np.bincount(month[weather.direct_normal >= 120], minlength=12)
    assert of_open_ground.sun_hours[0].tolist() == sunny.tolist()


def test_skies_give_the_diffuse_light_to_open_ground_exactly(
    open_ground: DaylightCoefficients, weather: Weather
) -> None:
    for subdivision in (1, 2):
        of = open_ground if subdivision == 1 else coefficients(GROUND, subdivision=2, samples=2)
        skies = HourlySkies.of(weather, of, 0.2)
        level = horizontal_weights(of.patches)
        assert level.sum() == pytest.approx(np.pi)
        assert level @ skies.sky("irradiance") == pytest.approx(skies.diffuse, rel=1e-4, abs=1e-6)
        assert (skies.sky("irradiance") >= 0).all()


@pytest.mark.parametrize("time", ["2021-07-02T09:00", "2021-03-03T14:00", "2021-06-03T12:00"])
def test_an_hour_has_what_the_renderer_finds_in_its_sky(
    time: str, behind_wall: DaylightCoefficients, weather: Weather, epw: Path
) -> None:
    """The wall hides a part of the sky, and the sun or not: lux by paths in the sky of that very hour."""
    hour = weather.hour_of(np.datetime64(time, "s"))
    sky = {"type": "perez", "weather": str(epw), "time": time, "ground": 0.2}
    points = behind_wall.points
    measured = glpath.irradiance(
        scene_from_dict(described(GROUND, WALL, **sky)), points, UP, spp=4096, max_depth=1
    ).illuminance()
    found = daylight_year(behind_wall, weather).light()[:, hour]
    assert found == pytest.approx(measured, rel=0.05)


def test_occupied_hours_without_light_have_none(open_ground: DaylightCoefficients, weather: Weather) -> None:
    night = daylight_year(open_ground, weather, occupied=(0, 3))
    assert night.autonomy.tolist() == night.mean.tolist() == night.sunlight_hours.tolist() == [0.0]
    assert night.useful.tolist() == [[1.0, 0.0, 0.0, 0.0]]
    assert night.autonomous_share == night.ase == 0.0


def box(window: bool, *, west: bool = False) -> list[Any]:
    """A room of 6 x 6 x 3 around the origin, whose south is open where it has a window, and its west likewise."""
    floor, ceiling = ([[-3, -3, z], [3, -3, z], [3, 3, z], [-3, 3, z]] for z in (0, 3))
    sides = [[[x, -3, 0], [x, 3, 0], [x, 3, top], [x, -3, top]] for x, top in ((-3, 1 if west else 3), (3, 3))]
    north = [[-3, 3, 0], [3, 3, 0], [3, 3, 3], [-3, 3, 3]]
    south = [[-3, -3, 0], [3, -3, 0], [3, -3, 3 if not window else 1], [-3, -3, 3 if not window else 1]]
    return [floor, ceiling, *sides, north, south]


def test_blinds_close_in_hours_of_sunlight_and_only_then(weather: Weather) -> None:
    at = [[x, y, 0.8] for x in (-2.0, 0.0, 2.0) for y in (-2.5, 0.0, 2.5)]
    bare, closed = (coefficients(*box(window), at=at, samples=2) for window in (True, False))
    without, shaded = daylight_year(bare, weather), daylight_year(bare, weather, blinds=closed)
    sunlight = np.zeros((9, len(weather.times)))
    skies = without.skies
    seen, lux = bare.direct_sun() > 0, skies.sun("illuminance")
    for k, hour in enumerate(skies.hours):
        sunlight[:, hour] = seen[:, skies.position[k]] * lux[k] * skies.to_sun[k, 2]
    # One of nine sensors is more than two percent.
    expected = (sunlight >= 1000).any(axis=0)
    assert 100 < expected.sum() < len(skies)
    assert np.array_equal(shaded.closed, expected[None])
    assert without.closed.shape == (0, len(expected))
    light, before = shaded.light(), without.light()
    assert not light[:, expected].any()
    # A product of some of the hours: on some processors its last bits are others than in one of all.
    np.testing.assert_allclose(light[:, ~expected], before[:, ~expected], rtol=1e-5)
    occupied = without.occupied
    assert occupied.sum() == 3650
    assert shaded.autonomy == pytest.approx((light[:, occupied] >= 300).mean(axis=1))
    assert without.autonomy == pytest.approx((before[:, occupied] >= 300).mean(axis=1))
    assert without.useful == pytest.approx(metrics.useful_daylight(before[:, occupied]), abs=1e-6)
    assert without.mean == pytest.approx(before[:, occupied].mean(axis=1), rel=1e-4)
    assert without.sunlight_hours.tolist() == (sunlight[:, occupied] >= 1000).sum(axis=1).tolist()
    assert without.sda is None
    assert shaded.sda == np.mean(shaded.autonomy >= 0.5)
    assert shaded.ase == without.ase == np.mean(without.sunlight_hours > 250)
    assert 0 < shaded.ase < 1


def test_each_group_of_blinds_keeps_the_sun_of_its_own_windows_away(weather: Weather, tmp_path: Path) -> None:
    at = [[x, y, 0.8] for x in (-2.5, 0.0, 2.5) for y in (-2.5, 0.0, 2.5)]

    def room(south: bool, west: bool) -> DaylightCoefficients:
        return coefficients(*box(south, west=west), at=at, samples=2)

    bare, no_south, no_west, none = room(True, True), room(False, True), room(True, False), room(False, False)
    found = daylight_year(bare, weather, blinds=[no_south, no_west])
    # The group is what a room with that window alone would close.
    for closed, alone in zip(found.closed, (no_west, no_south), strict=True):
        assert np.array_equal(closed, daylight_year(alone, weather, blinds=none).closed[0])
    south, west = found.closed
    assert (south & ~west).sum() > 50
    assert (west & ~south).sum() > 50
    assert (south & west).sum() > 50
    light = found.light()
    for hours, room_then in (
        (~south & ~west, bare),
        (south & ~west, no_south),
        (~south & west, no_west),
        (south & west, none),
    ):
        expected = daylight_year(room_then, weather).light()[:, hours]
        np.testing.assert_allclose(light[:, hours], expected, rtol=1e-4, atol=1e-2 + 1e-5 * light.max())
    assert found.attributes()["blinds_closed_hours"] == (found.closed & found.occupied).sum(axis=1).tolist()
    xarray = pytest.importorskip("xarray")
    found.save(tmp_path / "year.nc", hours=False)
    with xarray.open_dataset(tmp_path / "year.nc") as read:
        assert read.blinds_closed.dims == ("group", "time")
        assert read.blinds_closed.values.astype(bool).tolist() == found.closed.tolist()
    with pytest.raises(UsageError, match="group 2 of the blinds have other points"):
        daylight_year(bare, weather, blinds=[no_south, coefficients(GROUND)])


def test_texels_count_by_their_area(
    behind_wall: DaylightCoefficients, weather: Weather, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A texel of area 118 in the shade of the wall counts as 118 sensors at its centre."""
    monkeypatch.setattr(year, "_BLOCK", 100 * len(weather.times))
    lit = np.isin(np.arange(8760) % 24, [10, 14, 17])  # less to compute
    weather = replace(weather, direct_normal=weather.direct_normal * lit)
    weather = replace(weather, diffuse_horizontal=weather.diffuse_horizontal * lit)
    area = [1, 1, 118]
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    corners = behind_wall.points[:, None] + np.sqrt(area)[:, None, None] * square
    of_texels = replace(behind_wall, texels=Texels(corners, np.zeros(3, np.int32), ("ground",)))
    of_points = coefficients(GROUND, WALL, at=np.repeat(behind_wall.points, area, axis=0))
    found, expected = (daylight_year(of, weather, blinds=of, threshold=10_000) for of in (of_texels, of_points))
    assert np.array_equal(found.closed, expected.closed)
    assert 0 < (found.closed & found.occupied).sum() < found.sunlight_hours.max()
    for name in ("sda", "autonomous_share", "ase"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name)), name
    assert 0 < found.ase < 0.02
    assert list(year_summary(found)) == list(year_summary(expected))
    view, expected_view = (next(line for line in _summary(of) if "view" in line) for of in (of_texels, of_points))
    assert view == expected_view


def test_blocks_of_sensors_change_nothing(
    behind_wall: DaylightCoefficients, weather: Weather, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = daylight_year(behind_wall, weather)
    monkeypatch.setattr(year, "_BLOCK", 1)
    parted = daylight_year(behind_wall, weather)
    for name in ("autonomy", "useful", "mean", "sun_hours", "irradiation", "sunlight_hours"):
        assert getattr(parted, name) == pytest.approx(getattr(whole, name), rel=1e-5)
    assert parted.light(slice(2, 0, -1)) == pytest.approx(whole.light()[[2, 1]], rel=1e-5)
    assert parted.light(slice(None, None, -1)) == pytest.approx(whole.light()[::-1], rel=1e-5)
    with pytest.raises(UsageError, match=r"rows: slice.* where a slice of whole numbers"):
        parted.light(slice("a", None))


def test_files_have_what_the_year_has(of_open_ground: DaylightYear, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    of_open_ground.save(tmp_path / "year.nc")
    with xarray.open_dataset(tmp_path / "year.nc") as read:
        assert read.illuminance.shape == (1, 8760)
        assert read.illuminance.values == pytest.approx(of_open_ground.light())
        assert read.daylight_autonomy.values == pytest.approx(of_open_ground.autonomy)
        assert read.irradiation.sum().item() == pytest.approx(of_open_ground.irradiation.sum())
        assert read.attrs["ASE"] == of_open_ground.ase
        assert "sDA" not in read.attrs
        assert str(read.time.values[8]) == "2021-01-01T08:00:00.000000000"
    of_open_ground.save(tmp_path / "sums.nc", hours=False)
    with xarray.open_dataset(tmp_path / "sums.nc") as read:
        assert "illuminance" not in read
    of_open_ground.save(tmp_path / "year.csv")
    head, *rows = (tmp_path / "year.csv").read_text().splitlines()
    assert head.startswith("x,y,z,nx,ny,nz,daylight_autonomy,")
    row = dict(zip(head.split(","), map(float, rows[0].split(",")), strict=True))
    assert row["irradiation_07"] == pytest.approx(of_open_ground.irradiation[0, 6], rel=1e-6)
    with pytest.raises(UsageError, match=r"\.nc or \.csv"):
        of_open_ground.save(tmp_path / "year.txt")


def test_csv_has_georeferenced_sensors_where_they_are(of_open_ground: DaylightYear, tmp_path: Path) -> None:
    points = np.array([[500_000.25, 5_800_123.125, 1.5]])
    moved = replace(of_open_ground, coefficients=replace(of_open_ground.coefficients, points=points))
    moved.save(tmp_path / "year.csv")
    assert np.loadtxt(tmp_path / "year.csv", delimiter=",", skiprows=1)[:3].tolist() == points[0].tolist()


def test_more_hours_than_a_file_takes_are_refused() -> None:
    with pytest.raises(UsageError, match="hours=False"):
        year.check_hours("year.nc", 100_000, 8760, wanted=True)
    year.check_hours("year.nc", 100_000, 8760, wanted=False)


def test_what_does_not_fit_is_refused(
    open_ground: DaylightCoefficients, behind_wall: DaylightCoefficients, weather: Weather, tmp_path: Path
) -> None:
    for arguments, text in (
        ({"coefficients": coefficients(GROUND, latitude=None)}, "no positions of the sun"),
        ({"coefficients": coefficients(GROUND, latitude=-33.0)}, "of latitude -33"),
        ({"blinds": behind_wall}, "other points"),
        ({"occupied": (18, 8)}, "two hours"),
        ({"threshold": 0.0}, "a finite number above 0"),
        ({"threshold": np.inf}, "a finite number above 0"),
        ({"ground": 1.5}, "albedo"),
    ):
        given: dict[str, Any] = {"coefficients": open_ground, **arguments}
        with pytest.raises(UsageError, match=text):
            daylight_year(given.pop("coefficients"), weather, **given)
    with pytest.raises(SceneError, match=r"none\.epw"):
        daylight_year(open_ground, tmp_path / "none.epw")
    january = write_epw(
        tmp_path / "nights.epw", change=lambda _, row: row if row[1] == "1" and int(row[3]) < 4 else None
    )
    with pytest.warns(glpath.SceneWarning, match="missing"), pytest.raises(UsageError, match="no hour"):
        daylight_year(open_ground, january, occupied=(8.2, 8.9))


def test_a_year_of_one_data_period_is_reported(open_ground: DaylightCoefficients, weather: Weather) -> None:
    arrays = ("times", "direct_normal", "diffuse_horizontal", "dew_point")
    january = replace(weather, **{name: getattr(weather, name)[: 31 * 24] for name in arrays})
    with pytest.warns(glpath.SceneWarning, match=r"has 744 of the 8,760 hours of a year\. .*sDA, ASE"):
        found = daylight_year(open_ground, january)
    assert found.occupied.sum() == 310


def test_polar_nights_are_dark(tmp_path: Path) -> None:
    """Beyond the polar circle: no light in December, and the sun at midnight in June."""
    epw = write_epw(tmp_path / "polar.epw", latitude=75.0, longitude=20.0, zone=1.0)
    found = daylight_year(coefficients(GROUND, latitude=75.0, samples=2), epw)
    light = found.light()[0].reshape(365, 24)
    assert not light[340:360].any()
    assert light[170:175, 0].all()
