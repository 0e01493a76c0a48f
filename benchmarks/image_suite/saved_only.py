"""The tests without a comparison, to measure the time of drawing and saving alone."""

from __future__ import annotations

import io

import matplotlib.pyplot as plt
import matplotlib.style
import pytest

from benchmarks.image_suite.figures import CASES, figure_of


@pytest.mark.parametrize(("change", "copy"), CASES)
def test_figure(change: str, copy: int) -> None:
    with matplotlib.style.context("classic"):
        plt.switch_backend("agg")
        figure = figure_of(change, copy)
        figure.savefig(io.BytesIO(), format="png")
    plt.close(figure)
