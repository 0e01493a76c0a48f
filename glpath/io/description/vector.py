"""What several tables of a scene file are made of."""

from __future__ import annotations

Vector = tuple[float, float, float]
