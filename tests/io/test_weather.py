"""Weather files and the sun: hours, light and positions; and what a broken file, or one of elsewhere, is told."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pvlib = pytest.importorskip("pvlib")

from glpath.errors import SceneError, SceneWarning  # noqa: E402
from glpath.io.weather import Weather, _irradiance, read_weather  # noqa: E402
from glpath.sky.sun_position import clear_day, sun_of_hours, sun_positions  # noqa: E402
from tests.support.weather_files import Change, write_epw  # noqa: E402


@pytest.fixture(scope="module")
def epw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_epw(tmp_path_factory.mktemp("weather") / "zurich.epw")


@pytest.fixture(scope="module")
def weather(epw: Path) -> Weather:
    return read_weather(epw)


def changed(epw: Path, path: Path, change: Change, **head: str) -> Path:
    """The file with other rows, and another head."""
    lines = epw.read_text().splitlines(keepends=True)
    rows = [change(i, line.rstrip().split(",")) for i, line in enumerate(lines[8:])]
    site = lines[0].rstrip().split(",")
    for name, column in (("latitude", 6), ("longitude", 7), ("zone", 8)):
        site[column] = head.get(name, site[column])
    path.write_text(",".join(site) + "\n" + "".join(lines[1:8]) + "".join(",".join(r) + "\n" for r in rows if r))
    return path


def same(_: int, row: list[str]) -> list[str]:
    return row


def test_the_sun_of_nrel_s_example() -> None:
    """Reda & Andreas 2004, appendix A.5: Golden, Colorado, 17 October 2003, 12:30:30 at UTC-7."""
    found = sun_positions(np.array(["2003-10-17T19:30:30"], "datetime64[s]"), 39.742476, -105.1786, 1830.14)
    assert 90 - found.altitude[0] == pytest.approx(50.11162, abs=0.01)
    assert found.azimuth[0] == pytest.approx(194.34024, abs=0.001)


def test_a_sun_that_rises_is_looked_at_while_it_is_up() -> None:
    begin = np.arange(np.datetime64("2021-03-20T00"), np.datetime64("2021-03-22T00"), np.timedelta64(1, "h"))
    sun = sun_of_hours(begin, 47.5, 8.5)
    fine = sun_positions(
        begin[:, None].astype("datetime64[s]").repeat(60, 1).ravel()
        + np.tile((np.arange(60) * 60 + 30).astype("timedelta64[s]"), len(begin)),
        47.5,
        8.5,
    ).altitude.reshape(-1, 60)
    assert ((sun.altitude > 0) == (fine.max(axis=1) > 0)).all()
    partly = (fine.max(axis=1) > 0) & (fine.min(axis=1) < 0)
    assert partly.sum() == 4
    np.testing.assert_allclose(sun.altitude[partly], [row[row > 0].mean() for row in fine[partly]], atol=0.3)


def test_hours_of_a_year(weather: Weather) -> None:
    assert (len(weather.times), weather.missing, weather.after_dark) == (8760, 0, 0)
    assert (weather.site, weather.latitude, weather.time_zone) == ("Nowhere", 47.5, 1.0)
    noon = weather.hour_of(np.datetime64("2030-06-21T12:20"))
    assert str(weather.times[noon]) == "2021-06-21T12:00:00"
    assert weather.sun.altitude[noon] == pytest.approx(90 - 47.5 + 23.44, abs=0.2)
    assert weather.sun.azimuth[noon] == pytest.approx(181, abs=3)
    # All light is by day, and efficacies are daylight's.
    lit = weather.diffuse_horizontal > 0
    assert (weather.sun.altitude[lit] > 0).all()
    bright = weather.diffuse_horizontal > 20
    efficacy = weather.diffuse_illuminance[bright] / weather.diffuse_horizontal[bright]
    assert 100 < efficacy.min() < efficacy.max() < 180
    sunny = (weather.direct_normal > 300) & (weather.sun.altitude > 10)
    assert (weather.direct_illuminance[sunny] / weather.direct_normal[sunny]).min() > 70
    assert (weather.direct_illuminance[sunny] / weather.direct_normal[sunny]).max() < 115


def test_a_typical_year_of_several(epw: Path, tmp_path: Path) -> None:
    """The months of a typical year are of several: they become one."""
    years = {"2": "2007", "7": "1999"}
    found = read_weather(
        changed(epw, tmp_path / "typical.epw", lambda _, row: [years.get(row[1], row[0]), *row[1:]])
    )
    assert (np.diff(found.times).astype(int) == 3600).all()
    assert str(found.times[0]) == "2023-01-01T00:00:00"


def test_a_leap_year(tmp_path: Path, weather: Weather) -> None:
    found = read_weather(write_epw(tmp_path / "leap.epw", year=2024))
    assert len(found.times) == 8784
    assert str(found.times[found.hour_of(np.datetime64("2023-03-01T08"))]) == "2024-03-01T08:00:00"
    assert str(found.times[found.hour_of(np.datetime64("2020-02-29T08"))]) == "2024-02-29T08:00:00"
    with pytest.raises(SceneError, match="has no hour at 02-29 08:00"):
        weather.hour_of(np.datetime64("2024-02-29T08"))


def test_a_29_february_counts_if_the_head_says_so(tmp_path: Path) -> None:
    """EnergyPlus 24.1, WeatherManager.cc: such a day is skipped where the head has No."""
    with pytest.warns(SceneWarning, match="its 29 February is not used") as warned:
        found = read_weather(write_epw(tmp_path / "leap.epw", year=2024, head={"leap": "No"}))
    assert len(warned) == 1, "a year without 29 February lacks no hour"
    assert len(found.times) == 8760
    assert "2024-02-29" not in found.times.astype("datetime64[D]").astype(str)


@pytest.mark.parametrize("fields", [16, 32, 34, 35, 37])
def test_fields_that_are_missing_or_too_many_at_the_end_of_rows_do_not_matter(
    epw: Path, weather: Weather, tmp_path: Path, fields: int
) -> None:
    def cut(index: int, row: list[str]) -> list[str]:
        row = (row + ["1"] * fields)[:fields]
        return [*row, ""] if index % 2 else row

    found = read_weather(changed(epw, tmp_path / "cut.epw", cut))
    assert np.array_equal(found.times, weather.times)
    for name in ("direct_normal", "diffuse_horizontal", "dew_point"):
        assert np.array_equal(getattr(found, name), getattr(weather, name))


@pytest.mark.parametrize(
    "comment", ['COMMENTS 1,Rain gauge 8" diameter', 'COMMENTS 1,"5 and 6" floors, "roof', "COMMENTS 1,a\x85b"]
)
def test_comments_of_a_weather_file_are_not_read(epw: Path, weather: Weather, tmp_path: Path, comment: str) -> None:
    path = tmp_path / "comment.epw"
    path.write_bytes(epw.read_text().replace("COMMENTS 1,", f"{comment}\nCOMMENTS 3,").encode("latin-1"))
    assert np.array_equal(read_weather(path).direct_normal, weather.direct_normal)


def test_warnings_of_libraries_are_no_errors(epw: Path) -> None:
    """Only the own warnings of a program that runs with -W error should stop it."""
    code = "import sys; from glpath.io.weather import read_weather; read_weather(sys.argv[1]).sun; "
    code += "from glpath.sky.sun_position import clear_day; import numpy as np; "
    code += "clear_day(np.array(['2023-06-21T12'], 'datetime64[s]'), 47.5, 8.5)"
    subprocess.run([sys.executable, "-W", "error", "-c", code, str(epw)], check=True)


def test_polar_nights_are_dark(tmp_path: Path) -> None:
    found = read_weather(write_epw(tmp_path / "polar.epw", latitude=78.2, longitude=15.6))
    december = found.times.astype("datetime64[M]") == np.datetime64("2021-12")
    assert (found.sun.altitude[december] < 0).all()
    assert not found.direct_normal[december].any()
    june = found.times.astype("datetime64[M]") == np.datetime64("2021-06")
    assert (found.sun.altitude[june] > 0).all()


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (
            {"latitude": "-47.5"},
            r"the sun is not where it shone from. Check the latitude -47.5 \(south is negative\)",
        ),
        ({"zone": "5"}, r"and the time zone \+5"),
        ({"longitude": "-100"}, r"the time zone \+1 is 7.7 hours from the longitude -100"),
    ],
)
def test_weather_of_elsewhere_is_reported(epw: Path, tmp_path: Path, head: dict[str, str], message: str) -> None:
    with pytest.warns(SceneWarning) as warned:
        read_weather(changed(epw, tmp_path / "moved.epw", same, **head))
    assert any(re.search(message, str(each.message)) for each in warned), [str(each.message) for each in warned]


@pytest.mark.parametrize(("name", "value"), [("zone", "99999"), ("latitude", "91"), ("longitude", "-181")])
def test_sites_beyond_the_earth_are_refused(epw: Path, tmp_path: Path, name: str, value: str) -> None:
    with pytest.raises(SceneError, match=f"moved.epw: has the [a-z ]*{name} {value}, but allowed is from"):
        read_weather(changed(epw, tmp_path / "moved.epw", same, **{name: value}))


def test_marks_of_missing_irradiance_are_those_of_both_formats() -> None:
    """EPW has 9999, and TMY3 -9900."""
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"dni": [9999.0, -9900.0, -9999.0, 500.0, np.nan]})
    found = _irradiance(table, "dni", "a.csv")
    np.testing.assert_array_equal(found, [np.nan, np.nan, np.nan, 500.0, np.nan])


def _without(row: int, fields: list[str]) -> list[str] | None:
    return None if 100 <= row < 124 else fields


def _first_half(row: int, fields: list[str]) -> list[str] | None:
    return fields if row < 181 * 24 else None


def _from_4_o_clock(row: int, fields: list[str]) -> list[str] | None:
    return None if row < 4 else fields


def _unknown(row: int, fields: list[str]) -> list[str]:
    return [*fields[:14], "9999", *fields[15:]] if 4000 <= row < 4010 else fields


@pytest.mark.parametrize(
    ("change", "message", "hours", "missing"),
    [
        (_without, "24 of 8,760 hours are missing, the first at 01-05 04:00; they count as dark", 8760, 24),
        (_first_half, "4,416 of 8,760 hours are missing, the first at 07-01 00:00; they", 8760, 4416),
        (_from_4_o_clock, "4 of 8,760 hours are missing, the first at 01-01 00:00; they", 8760, 4),
        (_unknown, "10 of 8,760 hours have no irradiance; they count as dark", 8760, 10),
    ],
)
def test_missing_hours_are_counted(
    epw: Path, tmp_path: Path, change: Change, message: str, hours: int, missing: int
) -> None:
    with pytest.warns(SceneWarning, match=message):
        found = read_weather(changed(epw, tmp_path / "gaps.epw", change))
    assert (len(found.times), found.missing) == (hours, missing)


def test_hours_without_a_row_are_dark_hours(epw: Path, weather: Weather, tmp_path: Path) -> None:
    """A file that ends early or begins late had the weather of the rest of the year alone."""
    with pytest.warns(SceneWarning, match="are missing"):
        found = read_weather(changed(epw, tmp_path / "half.epw", _first_half))
    in_file = np.arange(8760) < 181 * 24
    assert np.array_equal(found.times, weather.times)
    assert np.array_equal(found.direct_normal, np.where(in_file, weather.direct_normal, 0))
    assert np.array_equal(found.diffuse_horizontal, np.where(in_file, weather.diffuse_horizontal, 0))


@pytest.mark.parametrize(
    ("period", "months", "hours"),
    [("2/1,2/28", "2", 672), (" 2/ 1/2021, 2/28/2021", "2", 672), ("12/1,1/31", "12 1", 1488)],
)
def test_a_file_has_the_hours_of_its_data_period(
    epw: Path, tmp_path: Path, period: str, months: str, hours: int
) -> None:
    """EnergyPlus 24.1, Auxiliary programs: start and end of DATA PERIODS are month/day, with or without a year."""
    year = starting_in_july(epw, tmp_path)
    path = changed(year, tmp_path / "a.epw", lambda _, row: row if row[1] in months.split() else None)
    with pytest.warns(SceneWarning, match="hours are missing, the first at"):
        assert len(read_weather(path).times) == 8760
    path.write_text(path.read_text().replace(" 1/ 1,12/31", period))
    assert len(read_weather(path).times) == hours


def test_no_hours_are_missing_between_data_periods(
    epw: Path, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    path = changed(epw, tmp_path / "two.epw", lambda _, row: row if row[1] in ("1", "7") else None)
    head = "DATA PERIODS,2,1,A,Sunday, 1/ 1, 1/31,B,Sunday, 7/ 1, 7/31"
    path.write_text(path.read_text().replace("DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31", head))
    found = read_weather(path)
    assert (len(found.times), found.missing) == (2 * 31 * 24, 0)
    assert not recwarn.list


@pytest.mark.parametrize("minutes", [(0, 0), (30, 30), (0, 30)])
def test_rows_off_the_full_hour_are_not_counted_as_missing(tmp_path: Path, minutes: tuple[int, int]) -> None:
    """Two days of a TMY3 file, whose rows are one in each hour: 8,712 hours of the year lack."""
    path = tmp_path / "a.csv"
    rows = "".join(f"01/{2 + i // 24:02}/2015,{i % 24:02}:{minutes[i % 2]:02},0,0,0\n" for i in range(48))
    path.write_text(
        "1,X,CA,1.0,50.0,10.0,100\nDate (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),DNI (W/m^2),DHI (W/m^2)\n" + rows
    )
    with pytest.warns(SceneWarning, match="8,712 of 8,760 hours are missing"):
        found = read_weather(path)
    assert np.unique(found.times.astype("datetime64[h]")).size == len(found.times) == 8760


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda i, row: [*row[:13], *(["-300"] * 3), *row[16:]] if i == 5 else row, "-300 W/m2 of dni in line 14,"),
        (
            lambda i, row: [*row[:3], "1", *row[4:]] if i == 1 else row,
            "its line 10 is of 01-01 00:00, but the hour before, in line 9,",
        ),
        (lambda i, row: [*row[:13], "?", "?", "?", *row[16:]] if i == 5 else row, r'has "\?" as dni in line 14,'),
        (lambda i, row: [*row[:14], "1_0", *row[15:]] if i == 5 else row, 'has "1_0" as dni in line 14,'),
        (lambda i, row: [*row[:7], "x", *row[8:]] if i == 5 else row, 'has "x" as temp_dew in line 14,'),
        (lambda i, row: ["x", *row[1:]] if i == 5 else row, 'line 14 has "x", "1", "1", "6" as year'),
        (lambda i, row: [row[0], "13", *row[2:]] if i == 5 else row, 'line 14 has "2021", "13", "1", "6" as year'),
        (lambda i, row: [*row[:2], "0", *row[3:]] if i == 5 else row, 'line 14 has "2021", "1", "0", "6" as year'),
        (
            lambda i, row: [*row[:3], "-1", *row[4:]] if i == 5 else row,
            'line 14 has "2021", "1", "1", "-1" as year',
        ),
        (lambda i, row: [*row[:3], "\u0661", *row[4:]] if i == 5 else row, "line 14 has .* as year"),
        (lambda i, row: [*row[:3], "0" if i else "1" * 5000, *row[4:]], "line 9 has .* as year"),
        (lambda i, row: ["2924", *row[1:]], "has the year 2924, but allowed is from 1678|is broken: OutOfBounds"),
        (lambda i, row: None, "has no hour|is broken"),
    ],
)
def test_broken_files_are_refused(epw: Path, tmp_path: Path, change: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        read_weather(changed(epw, tmp_path / "broken.epw", change))


def test_other_files_are_refused(epw: Path, tmp_path: Path) -> None:
    def told(name: str, text: str | None, head: dict[str, str] | None = None) -> str:
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        if head is not None:
            changed(epw, path, same, **head)
        with pytest.raises(SceneError) as caught:
            read_weather(path)
        return str(caught.value)

    assert "allowed are .epw, .csv" in told("a.wea", "")
    assert "cannot be read" in told("none.epw", None)
    assert "begins with LOCATION" in told("b.epw", "site Nowhere")
    assert "has no column Date (MM/DD/YYYY)" in told("c.csv", "a,b\n1,2\n")
    assert "has the latitude 147.5" in told("d.epw", None, {"latitude": "147.5"})
    assert 'has "4_7" in line 1' in told("e.epw", None, {"latitude": "4_7"})
    assert 'has "nan" in line 1' in told("e.epw", None, {"latitude": "nan"})
    assert "has 2 fields in line 1 where 10" in told("f.epw", "LOCATION,x\n2021,1,1,1\n")


def test_a_real_tmy3_file() -> None:
    """Sand Point, Alaska, which pvlib ships."""
    found = read_weather(Path(pvlib.__file__).parent / "data" / "703165TY.csv")
    assert (found.site, len(found.times), found.time_zone) == ("SAND POINT", 8760, -9.0)
    assert found.after_dark < 20
    # Its own global light: 836 kWh a year, about what maps of the Aleutians show.
    up = np.maximum(found.sun.altitude, 0)
    total = (found.direct_normal * np.sin(np.radians(up)) + found.diffuse_horizontal).sum() / 1000
    assert 700 < total < 1000


def test_a_clear_day() -> None:
    direct, diffuse = clear_day(np.array(["2024-06-21T11:30"], "datetime64[s]"), 47.5, 8.5)
    assert 700 < direct[0] < 1000
    assert 50 < diffuse[0] < 200


def test_a_february_of_a_leap_year_ends_on_the_28th(recwarn: pytest.WarningsRecorder) -> None:
    """This file's is of 1996, and pvlib has its last hour end in March, a day too late."""
    found = read_weather(Path(pvlib.__file__).parent / "data" / "723170TYA.CSV")
    assert (np.diff(found.times).astype(int) == 3600).all()
    assert found.times[[0, -1]].astype(str).tolist() == ["2023-01-01T00:00:00", "2023-12-31T23:00:00"]
    assert not recwarn.list


def test_small_negative_irradiance_is_noise_of_the_night(epw: Path, weather: Weather, tmp_path: Path) -> None:
    def at_night(_: int, row: list[str]) -> list[str]:
        return [*row[:15], "-3", *row[16:]] if float(row[15]) == 0 else row

    nights = int((weather.diffuse_horizontal == 0).sum())
    with pytest.warns(SceneWarning, match=rf"{nights:,} values of dhi are below 0, the lowest -3 W/m2"):
        found = read_weather(changed(epw, tmp_path / "noise.epw", at_night))
    assert np.array_equal(found.diffuse_horizontal, weather.diffuse_horizontal)


def test_hours_from_0_to_23_are_those_that_begin_then(epw: Path, weather: Weather, tmp_path: Path) -> None:
    def earlier(_: int, row: list[str]) -> list[str]:
        return [*row[:3], str(int(row[3]) - 1), *row[4:]]

    with pytest.warns(SceneWarning, match="hours are from 0 to 23"):
        found = read_weather(changed(epw, tmp_path / "zero.epw", earlier))
    assert np.array_equal(found.times, weather.times)
    assert np.array_equal(found.direct_normal, weather.direct_normal)


def starting_in_july(epw: Path, tmp_path: Path, years: tuple[str, str] = ("2021", "2022")) -> Path:
    path = changed(epw, tmp_path / "july.epw", same)
    lines = path.read_text().splitlines(keepends=True)
    rows = [line.split(",", 1) for line in lines[8:]]
    july = next(i for i, row in enumerate(rows) if row[1].startswith("7,"))
    moved = [f"{years[0]},{row[1]}" for row in rows[july:]] + [f"{years[1]},{row[1]}" for row in rows[:july]]
    path.write_text("".join(lines[:8] + moved))
    return path


@pytest.mark.parametrize("years", [("2021", "2022"), ("2021", "2021")])
def test_a_year_that_starts_in_july_has_the_hours_of_one_from_january(
    epw: Path, weather: Weather, tmp_path: Path, years: tuple[str, str]
) -> None:
    path = starting_in_july(epw, tmp_path, years)
    found = read_weather(path)
    assert np.array_equal(found.direct_normal, weather.direct_normal)
    assert (np.diff(found.times).astype(int) > 0).all()


@pytest.mark.parametrize("blanks", [0, 3])
def test_an_error_names_the_line_of_the_file(epw: Path, tmp_path: Path, blanks: int) -> None:
    """Also if the file starts in July and has blank lines."""
    path = starting_in_july(epw, tmp_path)
    lines = [*path.read_text().splitlines()[:8], *[""] * blanks, *path.read_text().splitlines()[8:]]
    fields = lines[6000].split(",")
    lines[6000] = ",".join([*fields[:14], "-300", *fields[15:]])
    path.write_text("\n".join(lines))
    with pytest.raises(SceneError, match="-300 W/m2 of dni in line 6001,"):
        read_weather(path)


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ("Dew-point (C)", "dni", 'has two columns of "dni"'),
        ("01/01/1988,03:00", ",03:00", "has no date in line 5"),
    ],
)
def test_a_damaged_tmy3_file_is_refused_with_its_line(replaced: str, by: str, message: str, tmp_path: Path) -> None:
    text = (Path(pvlib.__file__).parent / "data" / "703165TY.csv").read_text()
    lines = text.splitlines()[:30]
    first = lines[2].split(",")[0]
    damaged = "\n".join(lines).replace(replaced.replace("01/01/1988", first), by)
    assert damaged != "\n".join(lines)
    (tmp_path / "w.csv").write_text(damaged)
    with pytest.raises(SceneError, match=message):
        read_weather(tmp_path / "w.csv")
