"""Charts are the same whatever matplotlib's settings are."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.film.charts import field


def test_settings_of_the_current_folder_do_not_change_a_chart() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    arguments = ("Lux", "of a floor", np.arange(12.0).reshape(3, 4), (0.0, 4.0, 0.0, 3.0), ("x", "y"), "lx")
    expected = field(*arguments)
    with matplotlib.rc_context({"text.usetex": True, "font.size": 40, "axes.grid": True}):
        np.testing.assert_array_equal(field(*arguments), expected)
        assert matplotlib.rcParams["font.size"] == 40
