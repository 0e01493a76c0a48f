"""Colours of mesh files as fractions of white: 8 and 16 bits, floats of unknown scale, and 16-bit words of STL."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.values import as_float64
from glpath.scene.geometry import Float64
from glpath.system.colour import decode_srgb

# If no float is above this, floats count as fractions; rounding or a bright light may raise fractions above 1.
_MAX_FRACTION = 2.0
_MAX_WORD = 31  # 5 bits
_HIGHEST_BIT = 1 << 15
# Names, in STL headers, of programs that set the highest bit of a facet's word if the facet has a colour.
_PROGRAMS = (b"viscam", b"solidview")
# Reflectance of facets without a colour, equal to that of meshes without colours.
_GREY = 0.5


def fractions(stored: NDArray[Any], kind: str) -> tuple[Float64, str]:
    """Return colours in [0, 1], and a note if their scale had to be guessed; the note is empty otherwise.

    The largest value in `stored` determines the number that means white: 1, 255, 65,535 or the largest number of
    the type. For bytes it is always 255. Values that are not finite become white, which does not change the
    material.

    stored : colour components of the whole file as stored, without alpha
    kind   : numpy code of the type that the file declares, such as "u2"
    """
    values = as_float64(stored)
    if kind[0] == "i":  # some programs store unsigned numbers in a signed type
        values = np.where(values < 0, values + 2.0 ** (8 * int(kind[1:])), values)
    finite = np.isfinite(values)
    highest = float(values.max(initial=0.0, where=finite))
    white, guessed = _white(highest, kind)
    scaled = np.clip(np.where(finite, values, white) / white, 0.0, 1.0)
    return (
        scaled,
        f"white is taken to be {white:,.10g}, as the largest number is {highest:,.10g}" if guessed else "",
    )


def _white(highest: float, kind: str) -> tuple[float, bool]:
    """Return the number that means white, and True if it is a guess."""
    if kind in ("u1", "i1"):
        return 255.0, False
    if kind[0] == "f" and highest <= 1.0:
        return 1.0, False
    if highest <= (_MAX_FRACTION if kind[0] == "f" else 1.0):
        return 1.0, highest > 0
    if highest <= 255.0:
        return 255.0, True
    if highest <= 65535.0:
        return 65535.0, kind not in ("u2", "i2")
    return (2.0**32 - 1 if kind[0] != "f" and highest < 2.0**32 else highest), True


def linear(rgb: Float64) -> Float64:
    """Convert sRGB fractions (n, 3) to (n, 4) linear Rec. 709 with an alpha of 1."""
    return np.column_stack([decode_srgb(rgb), np.ones(len(rgb))])


def colours_of_facets(words: NDArray[np.uint16], header: bytes) -> Float64 | None:
    """Return (F, 4) colours of the facets of a binary STL, linear Rec. 709 and alpha; None if it has none.

    Magics writes COLOR= and the RGBA of the object into the header. It writes red into the lowest five bits of a
    word, and sets the highest bit if the facet has the object's colour. VisCAM and SolidView write blue into the
    lowest five bits, and set the highest bit if the facet has its own colour. Other programs store other numbers.
    Words therefore count as colours only if the header names VisCAM or SolidView, or if words without the highest
    bit are 0.

    words  : (F,) 16 bits at the end of each facet
    header : first 80 bytes of the file
    """
    parts = linear(np.stack([words >> shift & _MAX_WORD for shift in (0, 5, 10)], axis=1) / _MAX_WORD)
    flagged = ((words & _HIGHEST_BIT) != 0)[:, None]
    at = header.find(b"COLOR=")
    if 0 <= at <= len(header) - 10:
        of_object = linear(np.frombuffer(header, np.uint8, 3, at + 6)[None] / 255.0)
        of_object[:, 3] = (header[at + 9] or 255) / 255.0  # an invisible object is never intended
        return np.where(~flagged, parts, of_object) if words.any() else np.repeat(of_object, len(words), axis=0)
    named = any(name in header.lower() for name in _PROGRAMS)
    if not flagged.any() or not (named or not words[~flagged[:, 0]].any()):
        return None
    return np.where(flagged, parts[:, [2, 1, 0, 3]], [_GREY, _GREY, _GREY, 1.0])
