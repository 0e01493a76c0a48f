"""The tests for glpath. They use the style of pytest-mpl, so that both compare the same pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks.image_suite.figures import CASES, figure_of

if TYPE_CHECKING:
    from glpath.apps.image_tests.regression import RenderRegression


@pytest.mark.render_regression(style="classic", backend="agg")
@pytest.mark.parametrize(("change", "copy"), CASES)
def test_figure(render_regression: RenderRegression, change: str, copy: int) -> None:
    render_regression(figure_of(change, copy))
