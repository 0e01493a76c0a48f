"""The tests for pytest-mpl, written as its documentation recommends."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from benchmarks.image_suite.figures import CASES, figure_of


@pytest.mark.mpl_image_compare
@pytest.mark.parametrize(("change", "copy"), CASES)
def test_figure(change: str, copy: int) -> Figure:
    return figure_of(change, copy)
