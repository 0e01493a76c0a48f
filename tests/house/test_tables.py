"""Tables of figures: they are made from results, and the build fails where a result is missing."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.code_blocks import PAGES
from tests.support.repository import ROOT

#: Tables that `.ci/tables.py` writes.
_WRITTEN = re.compile(r"<!-- (?P<name>[\w -]+): \.ci/tables\.py writes.*?<!-- end of (?P=name) -->", re.DOTALL)
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
_FIGURE = re.compile(r"[-~<]?\d[\d.,]*(e-?\d+)?( (and|to) [\d.,]+)?( ?(s|ms|µs|min|h|%|MB|GB|times))?")


def typed(text: str) -> Iterator[str]:
    """Rows of tables with two cells or more that are figures and that no program has written."""
    for line in _FENCE.sub("", _WRITTEN.sub("", text)).splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if sum(_FIGURE.fullmatch(cell) is not None for cell in cells) > 1:
            yield line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_table_of_figures_is_typed_by_hand(page: Path) -> None:
    """They come from `benchmarks/results`; what has no result goes to `benchmarks/experiments.md`."""
    assert list(typed(page.read_text("utf-8"))) == []


def test_a_row_of_figures_is_found() -> None:
    rows = ("| path | 0.57 | 1,024 |", "| box | 3 % | 1.5 s |", "| a | 128 and 66 | <2e-3 |")
    others = ("| 75 | ended |", "| `--size 2` | 3 |", "| notebook 02 | 1 % |", "| 256 x 256 | 1 |")
    assert list(typed("\n".join([*rows, *others]))) == list(rows)
    assert list(typed(f"```\n{rows[0]}\n```\n")) == []
    written = f"<!-- speed: .ci/tables.py writes this table -->\n{rows[0]}\n<!-- end of speed -->\n"
    assert list(typed(written + rows[1])) == [rows[1]]


def test_noise_is_never_shown_as_a_small_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file whose noise of 51 % could hide anything, and one that is decided."""
    tables = runpy.run_path(str(ROOT / ".ci" / "tables.py"))
    noisy = {"mean_ratio": 0.954, "mean_difference": 0.0, "mean_noise": 0.09, "worst_block": 0.0, "noise": 0.511}
    clear = {"mean_ratio": 1.003, "mean_difference": 0.001, "mean_noise": 0.002, "worst_block": 0.02, "noise": 0.01}
    both = {"loads": True, "warnings": [], "plugins": ["bsdf mask"]}
    rows = [
        {"file": "data/noisy.xml", "verdict": "unclear", **both, **noisy},
        {"file": "data/clear.xml", "verdict": "same", **both, **clear},
    ]
    stored = {"rows": rows, "holds": False, "measured": {"loaded": 2, "same": 1, "differs": 0}}
    for name in ("mitsuba_differences", "mitsuba_plugins", "mitsuba_rule"):
        monkeypatch.setitem(tables[name].__globals__, "result", lambda name: stored)
    of_files, of_plugins, rule = (
        tables[name]().splitlines() for name in ("mitsuba_differences", "mitsuba_plugins", "mitsuba_rule")
    )
    expected = "| noisy.xml | unclear | 0.954 | within noise of 9.0 % | within noise of 51.1 % |  |"
    assert of_files[2:] == [expected]
    assert of_plugins[2:] == ["| `bsdf mask` | 2 | 1 | 0 | 1 | 0.3 | 3.0 | 9.0 | 51.1 |"]
    assert rule[-1] == "| all of these | | **no** |"


def test_the_build_fails_where_a_result_is_missing(tmp_path: Path) -> None:
    (tmp_path / "conf.py").write_text("extensions = ['myst_parser', 'glpath_docs.results']\n")
    (tmp_path / "index.md").write_text("# A page\n\n```{results} nobody-has-measured-this\nglpath, s: s .2f\n```\n")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "text", str(tmp_path), str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "docs" / "_ext")])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 2, done.stderr
    assert "nobody-has-measured-this.json: is not in results/" in done.stderr
