"""`glpath horizon`: what it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glpath.cli.horizon import _table
from glpath.errors import SceneWarning, UsageError
from tests.support.command_line import run


@pytest.fixture
def ridge(tmp_path: Path) -> Path:
    """A ridge from west to east, 20 high."""
    field = np.zeros((41, 31))
    field[20] = 20.0
    np.save(tmp_path / "ridge.npy", field)
    return tmp_path / "ridge.npy"


def test_it_writes_sky_view_factors(ridge: Path) -> None:
    out = ridge.with_name("svf.npy")
    result = run("horizon", ridge, "-o", out, "-o", ridge.with_name("svf.npz"), "--azimuths", 16)
    assert result.exit_code == 0, result.output
    assert "1,271 samples: sky view factor" in result.output
    found = np.load(out)
    assert found.shape == (41, 31)
    assert found[20, 15] == 1.0
    assert 0.5 < found[21, 15] < 0.6


def test_it_writes_sun_hours_of_points(ridge: Path) -> None:
    suns, points = ridge.with_name("suns.csv"), ridge.with_name("points.csv")
    suns.write_text("azimuth,altitude,hours\n0,30,1\n180,30,2\n90,30,4\n")
    points.write_text("x,y\n15,-30\n15,-10\n")
    out = ridge.with_name("hours.csv")
    options = ("--quantity", "sun-hours", "--suns", suns, "--points", points, "--quiet")
    result = run("horizon", ridge, "-o", out, *options)
    assert result.exit_code == 0, result.output
    assert [line.split(",")[3] for line in out.read_text().splitlines()] == ["value", "6", "5"]


def test_its_picture_has_a_scale(ridge: Path) -> None:
    pytest.importorskip("matplotlib")
    out = ridge.with_name("svf.png")
    result = run("horizon", ridge, "-o", out, "--azimuths", 16, "--surface", "slope", "--quiet")
    assert result.exit_code == 0, result.output
    assert out.read_bytes()[:4] == b"\x89PNG"


HOURS = ("--quantity", "sun-hours", "--suns")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "a.exr"), "Results of a height field end in"),
        (("-o", "a.npy", "--quantity", "sun-hours"), "needs suns"),
        (("-o", "a.npy", "--suns", "suns.csv"), "have no part in sky view factors"),
        (("-o", "a.npy", "--classes", "2"), "--classes: belongs to"),
        (("-o", "a.npy", "--quantity", "irradiation", "--suns", "suns.csv"), "has no column energy"),
        (
            ("-o", "a.npy", "--quantity", "sun-hours", "--suns", "bad.csv"),
            "line 2: altitude is 'x', which is no",
        ),
        (("-o", "a.npy", "--points", "suns.csv"), "has no column x"),
        (("-o", "a.npy", "--points", "ridge.npy"), "no such points are read"),
        (("-o", "a.npy", *HOURS, "twice.csv"), "has two columns hours"),
        (("-o", "a.npy", *HOURS, "suns.csv", "--azimuths", "64"), "--azimuths: have no part in"),
        (("-o", "a.npy", "--spacing", "0"), "a spacing of 0"),
    ],
)
def test_what_it_refuses(
    arguments: tuple[str, ...], words: str, ridge: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ridge.parent)
    Path("suns.csv").write_text("azimuth,altitude\n0,30\n")
    Path("bad.csv").write_text("azimuth,altitude\n0,x\n")
    Path("twice.csv").write_text("azimuth,altitude,hours,hours\n0,30,1,2\n")
    result = run("horizon", "ridge.npy", *arguments)
    assert result.exit_code in (1, 2)
    text = result.output if result.exception is None else f"{result.output} {result.exception}"
    assert words in text


def test_a_table_with_an_open_quote_names_the_line(tmp_path: Path) -> None:
    """Without the quote, each of the 9,000 lines is a row; the quote would swallow all rows below its line."""
    path, rest = tmp_path / "table.csv", "180.25,45.125\n" * 8999
    path.write_text("azimuth,altitude\n180,45\n" + rest)
    assert len(_table(path, "--suns", ("azimuth", "altitude"), ())["azimuth"]) == 9000
    path.write_text('azimuth,altitude\n180,"45\n' + rest)
    with pytest.raises(UsageError, match="line 2: is no line of a table"):
        _table(path, "--suns", ("azimuth", "altitude"), ())


@pytest.mark.parametrize(
    ("table", "optional", "words"),
    [
        ("azimuth,altitude,Duration\n0,30,1\n", "hours", "each sun counts as 1 hour. Columns .*: duration"),
        ("azimuth,altitude,day,hour\n0,30,1,9\n", "hours", "each sun counts as 1 hour. Columns .*: day, hour"),
        ("x,y,height,nz\n0,30,1,1\n", "z", "the points lie on the surface. Columns .*: height, nz"),
    ],
)
def test_a_table_warns_of_columns_that_it_does_not_read(
    table: str, optional: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(table)
    first, second = table.split(",")[:2]
    with pytest.warns(SceneWarning, match=f"has no column {optional}, so {words}"):
        found = _table(path, "--suns", (first, second), (optional,))
    assert {name: values.tolist() for name, values in found.items()} == {first: [0.0], second: [30.0]}
