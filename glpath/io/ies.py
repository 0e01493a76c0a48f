"""Photometric files in IES LM-63 format of 1986, 1991, 1995, 2002 and 2019.

Only type C photometry is read; nearly all luminaires have it.

    IESNA:LM-63-2002
    [TEST] ...                 lines of text; in files before 1991 without brackets
    TILT=NONE
    1 1000 1.0 3 1 1 2 0 0 0   lamps, lumens, multiplier, numbers of gamma and C angles, type, unit, three lengths
    1.0 1.0 50                 ballast factor, ballast lamp factor (see below), watts
    0 45 90                    gamma angles
    0                          C angles: 0 alone, or 0 to 90, 180 or 360; symmetry gives the other planes
    1000 700 0                 candela for each C, one value per gamma

Intensity is the value times the multiplier, the ballast factor and, up to 1995, the ballast lamp factor. The 2002
format reserves that number, and in the 2019 format it is the file generation type, such as 1.10000. The size of the
luminaire is ignored, because it is treated as a point. Commas may separate numbers, and lines may break between any
two numbers.

Source:   ANSI/IESNA LM-63-02; ANSI/IES LM-63-19; Radiance's ies2rad for the variants that occur in practice.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from glpath.errors import warn
from glpath.io.c_planes import MAX_ANGLES, MAX_VALUES, all_around, on_regular_grid, scaled
from glpath.io.values import LARGEST
from glpath.scene.model import Float64
from glpath.scene.profile import LightProfile
from glpath.scene.source_location import SourceLocation
from glpath.system.numerals import real

# Starts of the line that names a format without ballast lamp factor.
_WITHOUT_LAMP_FACTOR = ("IESNA:LM-63-2002", "IES:LM-63-")
_TYPES = {"1": "C", "2": "B", "3": "A"}
# Allowed first and last C angles, degrees.
_SPANS = ((0.0, 90.0), (0.0, 180.0), (0.0, 360.0), (90.0, 270.0))

_WHOLE = "Take a whole file of the maker's, or open it in a viewer of photometric files."
_DECIMALS = "Commas separate numbers. If they are decimal commas here, write points instead."


def parse_ies(data: bytes, path: Path | str, location: SourceLocation) -> LightProfile:
    """Return the profile in the content `data` of a file.

    path     : name of the file in errors
    location : location in the scene file where the photometric file is named

    Raises SceneError, which gives the line. Warns of TILT factors other than 1 and of words after the last candela.
    """
    # DOS ends a text with ^Z, other systems pad it with NUL.
    text = data.decode("latin-1").partition("\x1a")[0].rstrip("\0 \r\n")
    return _Reader(text, path, location).profile()


class _Reader:
    """Reader of the numbers of a file, one after another, with the line of each number."""

    def __init__(self, text: str, path: Path | str, location: SourceLocation) -> None:
        self._path, self._location = path, location
        self._lines = text.splitlines()
        self._line = 0  # line of the last number, from 1
        self._numbers: list[tuple[str, int]] = []
        self._next = 0
        self._has_commas = False  # True if the text has a comma between two digits

    def profile(self) -> LightProfile:
        tilt = self._tilt()
        has_lamp_factor = not any(
            line.strip().upper().startswith(_WITHOUT_LAMP_FACTOR) for line in self._lines[: self._line]
        )
        for number, line in enumerate(self._lines[self._line :], self._line + 1):
            self._numbers += [(word, number) for word in line.replace(",", " ").split()]
            self._has_commas |= re.search(r"\d,\d", line) is not None
        if tilt == "INCLUDE":
            self._skip_tilt()
        self._number("the number of lamps")
        self._number("the lumens of a lamp")
        factor = self._factor("the candela multiplier")
        rows, columns = self._count("gamma (vertical)", 2), self._count("C (horizontal)", 1)
        if rows * columns > MAX_VALUES:
            self._wrong(f"{rows} x {columns} candela are more than {MAX_VALUES:,}")
        kind = self._word("the photometric type")
        if kind != "1":
            self._wrong(
                f"photometry of type {_TYPES[kind]}" if kind in _TYPES else f"a photometric type of {kind[:20]!r}",
                "Type C (1) is read; of A and B, programs for photometric files make one.",
            )
        if self._word("the unit") not in ("1", "2"):
            self._wrong("a unit that is neither 1, feet, nor 2, metres")
        for name in ("width", "length", "height"):
            self._number(f"the {name} of the luminaire")
        factor *= self._factor("the ballast factor")
        if has_lamp_factor:
            factor *= self._factor("the ballast lamp factor")
        else:
            self._number("the file generation type, or a reserved number")
        self._number("the input watts")
        gamma = self._angles("gamma", rows)
        if not (gamma[0] >= 0 and gamma[-1] <= 180):
            self._wrong(f"gamma from {gamma[0]:g} to {gamma[-1]:g}; type C has angles from 0 to 180")
        c = _with_last_plane(self._angles("C", columns))
        self._check_around(c)
        candela = np.array([self._number("candela", 0.0) for _ in range(rows * columns)]).reshape(columns, rows)
        self._check_end()
        candela = scaled(np.concatenate([candela, candela[: len(c) - columns]]), factor)
        if candela.max() > LARGEST:
            self._wrong(f"{candela.max():.3g} candela; at most {LARGEST:g} are taken")
        return on_regular_grid(*all_around(c, candela), gamma)

    # Methods that read parts of the file.

    def _tilt(self) -> str:
        tilt = ""
        for number, line in enumerate(self._lines, 1):
            self._line = number
            if line.strip().upper().startswith("TILT="):
                tilt = line.strip()[5:].strip().upper()
                break
        else:
            self._wrong("no line TILT=NONE or TILT=INCLUDE", "Is it an IES LM-63 file?")
        if tilt not in ("NONE", "INCLUDE"):
            self._wrong(f"TILT={tilt[:60]}", "TILT=NONE and TILT=INCLUDE are read, and no file besides.")
        return tilt

    def _skip_tilt(self) -> None:
        self._number("the lamp's position in the luminaire")
        count = self._count("tilt", 1)
        for _ in range(count):
            self._number("an angle of tilt")
        factors = [self._number("a factor of tilt", 0.0) for _ in range(count)]
        if any(factor != 1 for factor in factors):
            warn(
                f"{self._location}: the light of {self._path} depends on how its lamp is tilted (TILT=INCLUDE); "
                "it is taken as measured."
            )

    def _angles(self, what: str, count: int) -> Float64:
        found = np.array([self._number(f"an angle of {what}") for _ in range(count)])
        if np.any(np.diff(found) <= 0):
            self._wrong(f"angles of {what} that do not ascend")
        return found

    def _check_around(self, c: Float64) -> None:
        if len(c) == 1 and c[0] != 0:
            self._wrong(f"a single angle of C, {c[0]:g}; of a luminaire that is alike all around it is 0")
        if len(c) > 1 and (c[0], c[-1]) not in _SPANS:
            self._wrong(f"C from {c[0]:g} to {c[-1]:g}; expected 0 alone, 0 to 90, 180 or 360, or 90 to 270")

    def _check_end(self) -> None:
        """Warn of words after the last candela. Raises SceneError if they may come from decimal commas."""
        if self._next == len(self._numbers):
            return
        first, self._line = self._numbers[self._next]
        count = f"{len(self._numbers) - self._next} more words than its counts of angles promise"
        if self._has_commas:
            self._wrong(count)
        warn(f'{self._location}: {self._path} has {count}, from "{first[:20]}" in line {self._line}: not used.')

    # Methods that read single words and numbers.

    def _word(self, what: str) -> str:
        if self._next >= len(self._numbers):
            self._line = len(self._lines)
            self._wrong(f"the end of the file where {what} is expected")
        word, self._line = self._numbers[self._next]
        self._next += 1
        return word

    def _number(self, what: str, minimum: float = -math.inf) -> float:
        word = self._word(what)
        try:
            number = real(word)
        except ValueError:
            self._wrong(f"{word[:20]!r} where {what} is expected")
        if not math.isfinite(number) or number < minimum:
            self._wrong(f"{word[:20]} where {what} is expected{'' if minimum < 0 else ', 0 or more'}")
        return number

    def _factor(self, what: str) -> float:
        number = self._number(what, 0.0)
        if number == 0:
            self._wrong(f"0 as {what}: no light")
        return number

    def _count(self, what: str, minimum: int) -> int:
        number = self._number(f"the number of {what} angles")
        if not (number.is_integer() and minimum <= number <= MAX_ANGLES):
            self._wrong(f"{number:g} {what} angles; expected {minimum} to {MAX_ANGLES}")
        # Each angle is one word, so at least `number` words must follow.
        if number > len(self._numbers) - self._next:
            self._wrong(f"{number:g} {what} angles, but only {len(self._numbers) - self._next} words follow")
        return int(number)

    def _wrong(self, found: str, remedy: str = "") -> NoReturn:
        raise self._location.error(
            f"names {self._path}, which cannot be used: line {self._line} has {found}.",
            remedy or (_DECIMALS if self._has_commas else _WHOLE),
        )


def _with_last_plane(c: Float64) -> Float64:
    """Return C angles with 360 added, if they start at 0 and only the plane at 360 is missing.

    No other plane is missing if the gap from the last angle to 360 is as wide as the first or the last step.

    Source: Cycles, util/ies.cpp.
    """
    if len(c) < 3 or c[0] != 0 or not 180 < c[-1] < 360:
        return c
    fits = any(math.isclose(360 - c[-1], step) for step in (c[1] - c[0], c[-1] - c[-2]))
    return np.append(c, 360.0) if fits else c
