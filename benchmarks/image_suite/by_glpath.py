"""The suite by glpath. The style is that of pytest-mpl, so that both compare the same pictures."""

from __future__ import annotations

import pytest

from benchmarks.image_suite.figures import CASES, figure_of


@pytest.mark.render_regression(style="classic", backend="agg")
@pytest.mark.parametrize(("change", "copy"), CASES)
def test_figure(render_regression, change: str, copy: int) -> None:
    render_regression(figure_of(change, copy))
