"""Options of shadow-buffer look-ups as words and numbers, for modules that only handle options."""

from __future__ import annotations

from typing import Literal

#: Shadow test: "distance" intersects the tangent plane of the entry; "identity", the paper's, compares objects [TB
#: III].
ShadowTest = Literal["distance", "identity"]

#: Maximum width of a filtered look-up, in cells.
MAX_TAPS = 15
