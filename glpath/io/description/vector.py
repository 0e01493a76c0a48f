"""Types shared by several tables of a scene file."""

from __future__ import annotations

Vector = tuple[float, float, float]
