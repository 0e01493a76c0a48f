"""How long Cycles takes to an error, between its pictures."""

from __future__ import annotations

import pytest

from benchmarks.benches.defaults import ByCycles, seconds_to

PICTURES = [ByCycles(0.01, 80.0, 1e-4), ByCycles(0.03, 40.0, 2e-4), ByCycles(0.1, 10.0, 8e-4)]


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (4e-4, (20.0, 4e-4)),  # halfway by logarithms
        (2e-4, (40.0, 2e-4)),
        (1e-3, (10.0, 8e-4)),  # all are as good
        (1e-5, (80.0, 1e-4)),  # none is
    ],
)
def test_seconds_to_an_error_lie_between_those_of_pictures(error: float, expected: tuple[float, float]) -> None:
    assert seconds_to(PICTURES, error) == pytest.approx(expected)
