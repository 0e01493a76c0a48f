"""`python -m benchmarks figure`: the command, the files it writes, the look of a page."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from benchmarks.__main__ import app
from benchmarks.figures import style
from benchmarks.figures.catalogue import FIGURES
from benchmarks.figures.outcome import as_csv, write
from benchmarks.figures.style import Axis, Series
from glpath.errors import GlpathError
from glpath.film import charts
from tests.support.figure_commands import outcome

FIELDS = ["name", "claim", "measured", "holds", "rows", "machine", "versions", "notes", "faults", "date"]


@pytest.fixture
def scales(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Puts a figure of no cost into the catalogue; the scales that it was made at."""
    asked: list[float] = []

    def make(scale, say):
        asked.append(scale)
        say("working")
        return outcome(holds=len(asked) == 1)

    monkeypatch.setitem(FIGURES, "t-buffer-0", (make, "nothing in particular"))
    return asked


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["figure", *map(str, arguments)])


def test_list_names_every_figure_with_a_line() -> None:
    result = run("--list")
    assert result.exit_code == 0
    lines = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert list(lines) == list(FIGURES)
    assert {f"t-buffer-{i}" for i in range(9, 19)} <= set(lines)


def test_a_figure_is_a_picture_its_data_and_a_verdict(scales, tmp_path: Path) -> None:
    result = run("t-buffer-0", "--scale", 0.5, "-o", tmp_path / "new")
    assert result.exit_code == 0, result.output
    assert scales == [0.5]
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == [
        f"t-buffer-0.{s}" for s in ("csv", "json", "png")
    ]
    assert iio.imread(tmp_path / "new" / "t-buffer-0.png").shape == (4, 6, 3)
    assert list(json.loads((tmp_path / "new" / "t-buffer-0.json").read_text())) == FIELDS
    assert "working" in result.stderr
    assert "it is fast (gain > 1): holds" in result.stdout
    again = run("t-buffer-0", "-o", tmp_path / "new")
    assert (again.exit_code, scales) == (0, [0.5, 1.0])
    assert "it is fast (gain > 1): DOES NOT HOLD" in again.stdout


def test_without_a_folder_it_goes_to_out_figures(scales, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("t-buffer-0").exit_code == 0
    assert (tmp_path / "out" / "figures" / "t-buffer-0.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no name; allowed are t-buffer-9"),
        (["t-buffer-99"], "'t-buffer-99'; allowed are t-buffer-9"),
        (["t-buffer-9", "--scale", "0"], "--scale 0: must be above 0 and at most 1"),
        (["t-buffer-9", "--scale", "2"], "--scale 2: must be above 0"),
        (["t-buffer-9", "--scale", "nan"], "--scale nan: must be above 0"),
    ],
)
def test_wrong_usage_says_what_is_allowed(arguments, words) -> None:
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr


def test_a_folder_that_cannot_be_is_told_before_the_work(scales, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = run("t-buffer-0", "-o", tmp_path / "file")
    assert (result.exit_code, scales) == (1, [])


def test_without_matplotlib_the_error_is_the_line_to_type(scales, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    result = run("t-buffer-0", "-o", tmp_path)
    assert (result.exit_code, scales) == (1, [])
    assert "pip install 'glpath[figures]'" in result.stderr
    assert not list(tmp_path.iterdir())


def test_neither_the_help_nor_the_list_loads_matplotlib() -> None:
    code = (
        "import sys, benchmarks.figures.catalogue, benchmarks.figures.style, glpath.cli.main\n"
        "print([m for m in sys.modules if m.startswith('matplotlib')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "[]\n", done.stderr


def test_drawing_needs_no_display_and_leaves_matplotlib_as_it_was() -> None:
    # pyplot is what asks for a display and changes what other plots of the process look like.
    code = (
        "import sys, matplotlib; before = matplotlib.rcParams.copy()\n"
        "from benchmarks.figures.style import Axis, Series, plot\n"
        "plot('a', 'b', [(Axis('x'), Axis('y'), [Series('s', [1, 2], [3, 4])])])\n"
        "print('matplotlib.pyplot' in sys.modules, before == matplotlib.rcParams.copy())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False True\n", done.stderr


# Files


def test_json_is_strict_even_where_a_number_is_none() -> None:
    report = outcome(
        measured={"a": math.nan, "b": math.inf, "c": np.float32(0.5)}, rows=[{"x": np.int64(3)}]
    ).report

    def refuse(word):
        raise AssertionError(word)

    found = json.loads(report.as_json(), parse_constant=refuse)
    assert found["measured"] == {"a": None, "b": None, "c": 0.5}
    assert found["rows"] == [{"x": 3}]


def test_csv_has_every_column_of_every_row_and_can_be_read_back() -> None:
    rows = [{"n": 1, "what": 'a "b", c'}, {"n": 2, "more": 0.1}]
    back = list(csv.DictReader(as_csv(rows).splitlines()))
    assert back == [
        {"n": "1", "what": 'a "b", c', "more": ""},
        {"n": "2", "what": "", "more": "0.1"},
    ]


def test_without_rows_there_is_no_csv(tmp_path: Path) -> None:
    assert [p.suffix for p in write(outcome(rows=[]), tmp_path)] == [".png", ".json"]


def test_the_picture_carries_its_claim(tmp_path: Path) -> None:
    write(outcome(), tmp_path)
    assert iio.immeta(tmp_path / "t-buffer-0.png")["Description"] == "it is fast (gain > 1)"


# The page


def test_pictures_stand_pixel_for_pixel_on_their_page() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 260, 300, 3), dtype=np.uint8)
    page = style.pictures("Title", "Caption", [("one", noise[0]), ("two", noise[1])], 2)
    for picture in noise:
        # Found by its first row of pixels, then compared whole.
        windows = np.lib.stride_tricks.sliding_window_view(page, (1, 300, 3))[:, :, 0, 0]
        at = np.argwhere((windows == picture[0]).all(axis=(-1, -2)))
        assert len(at) == 1
        y, x = at[0]
        assert np.array_equal(page[y : y + 260, x : x + 300], picture)


def test_small_pictures_are_enlarged_by_whole_pixels() -> None:
    tiny = np.arange(16 * 12 * 3, dtype=np.uint8).reshape(12, 16, 3)
    page = style.pictures("Title", "Caption", [("one", tiny)], 1)
    large = np.kron(tiny, np.ones((15, 15, 1), np.uint8))
    x = charts.MARGIN
    y = next(y for y in range(len(page)) if np.array_equal(page[y, x : x + 240], large[0]))
    assert np.array_equal(page[y : y + 180, x : x + 240], large)


@pytest.mark.parametrize("panels", [1, 2])
def test_a_long_caption_keeps_within_its_page(panels: int) -> None:
    line = [(Axis("x", log=True), Axis("y", zero=True), [Series("s", [1, 10], [3, 4])])] * panels
    page = style.plot("Title", "Where gains grow, many words are made. " * 12, line)
    assert page.shape[1] == 560 * panels
    assert np.all(page[:, -6:] == 255), "text runs over the edge"
    assert np.all(page[-6:] == 255)
    assert np.any(page < 100)


def test_a_missing_matplotlib_is_a_glpath_error(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(GlpathError, match="pip install"):
        charts.require_matplotlib()
