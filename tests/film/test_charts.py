"""Charts are the same whatever matplotlib's settings are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import glpath
from glpath.errors import UsageError
from glpath.film.charts import colour_range, false_colours, field


def test_settings_of_the_current_folder_do_not_change_a_chart() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    arguments = ("Lux", "of a floor", np.arange(12.0).reshape(3, 4), (0.0, 4.0, 0.0, 3.0), ("x", "y"), "lx")
    expected = field(*arguments)
    with matplotlib.rc_context({"text.usetex": True, "font.size": 40, "axes.grid": True}):
        np.testing.assert_array_equal(field(*arguments), expected)
        assert matplotlib.rcParams["font.size"] == 40


def test_false_colours_span_all_values_and_zero() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    viridis = matplotlib.colormaps["viridis"]
    values = np.array([-2.0, 0.0, 6.0, np.nan])
    assert colour_range(values) == (-2.0, 6.0)
    found = false_colours(values, colour_range(values))
    np.testing.assert_array_equal(found[:3], viridis(np.array([0.0, 0.25, 1.0]))[:, :3])
    assert np.ptp(found[3]) == 0  # grey
    assert colour_range(np.array([3.0, 5.0])) == (0.0, 5.0)
    assert colour_range(np.array([-3.0, -5.0])) == (-5.0, 0.0)
    assert colour_range(np.array([np.nan])) == (0.0, 0.0)
    with pytest.raises(UsageError, match="1 of 2 values are infinite"):
        colour_range(np.array([1.0, np.inf]))


SETTINGS = """
import os, sys
from glpath.film.charts import require_matplotlib
from glpath.system.time_limit import command_clock

with command_clock():
    require_matplotlib()
import matplotlib
print(matplotlib.rcParams["font.size"], os.environ["MPLBACKEND"], os.path.exists("matplotlibrc"))
"""


@pytest.mark.parametrize("content", [b"\xff\xfe\x80: 1\n", b"font.size: 50\n", None])
def test_commands_ignore_matplotlib_s_settings_of_the_current_folder(content: bytes | None, tmp_path: Path) -> None:
    if content is None:
        os.mkfifo(tmp_path / "matplotlibrc")
    else:
        (tmp_path / "matplotlibrc").write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-P", "-c", SETTINGS],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "bogus", "PYTHONPATH": str(Path(glpath.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout == "10.0 bogus True\n", done.stderr
