"""Types that several tables of a scene file use."""

from __future__ import annotations

Vector = tuple[float, float, float]
