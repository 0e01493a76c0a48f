"""Option types of shadow-buffer look-ups, for modules that handle options without importing the buffers."""

from __future__ import annotations

from typing import Literal

#: Shadow test: "distance" intersects the tangent plane of the entry. "identity", the paper's, compares the entry's
#: object with the object of the point [TB III].
ShadowTest = Literal["distance", "identity"]

#: Maximum width of a filtered look-up, in cells.
MAX_TAPS = 15
