"""How a shadow-buffer is looked up, as words and numbers alone: for modules that only handle options."""

from __future__ import annotations

from typing import Literal

#: "distance" meets the tangent plane of what was seen; "identity", the paper's, asks for the same object [TB III].
ShadowTest = Literal["distance", "identity"]

#: Cells across that a filtered lookup may ask, at most.
MAX_TAPS = 15
