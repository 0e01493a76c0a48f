"""Names that a user gives."""

from __future__ import annotations

import pytest

from glpath.system.suggestions import name_fits


@pytest.mark.parametrize(
    ("name", "pattern", "fits"),
    [
        ("lamp[0]", "lamp[0]", True),
        ("lamp0", "lamp[0]", False),
        ("what?", "what?", True),
        ("whats", "what?", False),
        ("wall.left", "wall*", True),
        ("the wall", "wall*", False),
        ("wall", "*", True),
        ("a]b", "a]b", True),
    ],
)
def test_only_asterisks_of_a_pattern_are_special(name: str, pattern: str, fits: bool) -> None:
    assert name_fits(name, pattern) == fits
