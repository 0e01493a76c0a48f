"""The figures of TB, each made small: its files, its numbers, and that `holds` follows by the stated rule."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.figures.catalogue import FIGURES
from benchmarks.figures.t_buffer_curves import COUNTS, counts, fit
from benchmarks.figures.whitted_frame import differing
from tests.support.figure_reports import holds_by_its_rule


@pytest.mark.parametrize("name", [name for name in FIGURES if name.startswith("t-buffer")])
def test_a_small_figure_has_its_files_and_a_verdict_by_its_rule(name: str, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["figure", name, "--scale", "0.05", "-o", str(tmp_path)])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / f"{name}.json").read_text())
    assert report["name"] == name
    fields = ["name", "claim", "measured", "holds", "rows", "machine", "versions", "notes", "faults", "date"]
    assert list(report) == fields
    assert report["measured"]
    # Times of so small a figure may be fitted by nothing.
    assert all(isinstance(v, float) or (v is None and k.endswith("time")) for k, v in report["measured"].items())
    assert report["holds"] is holds_by_its_rule(report)
    assert set(report["machine"]) == {"renderer", "cpu", "cores"}
    assert {"glpath", "matplotlib", "driver"} <= set(report["versions"])
    picture = iio.imread(tmp_path / f"{name}.png")
    assert picture.shape[1] >= 480
    assert np.any(picture < 100)
    rows = list(csv.DictReader((tmp_path / f"{name}.csv").read_text().splitlines()))
    assert len(rows) == len(report["rows"]) >= 3
    assert list(rows[0]) == list(report["rows"][0])


def test_scale_shrinks_the_counts_and_keeps_them_apart() -> None:
    assert counts(1.0) == list(COUNTS)
    small = counts(0.001)
    assert len(small) >= 4
    assert max(small) < 20


def test_a_fit_finds_a_polynomial_and_says_how_much_it_explains() -> None:
    x = np.arange(10.0)
    coefficients, r2 = fit(x, 3 * x**2 - x + 2, 2)
    np.testing.assert_allclose(coefficients, [3, -1, 2], atol=1e-9)
    assert r2 == pytest.approx(1.0)
    # A straight line explains of y = x^2 on 0..9 the squared correlation of x and x^2.
    assert fit(x, x**2, 1)[1] == pytest.approx(np.corrcoef(x, x**2)[0, 1] ** 2)


def test_pictures_differ_where_an_eye_could_tell() -> None:
    a = np.full((10, 10, 3), 0.25)
    b = a.copy()
    b[0, :5] *= 1.5
    b[1] *= 1.0001
    assert differing(a, b) == 0.05
