"""Photometric files in EULUMDAT format (.ldt): one value on each line, in a fixed order.

    line        value
    1           name of the maker
    2, 3        type; symmetry: 0 none, 1 about the axis, 2 about the plane C0-C180, 3 about C90-C270, 4 about both
    4, 5        number of C planes from 0 to 360 degrees, and their spacing
    6, 7        number of gamma angles, and their spacing
    8 to 21     names, and sizes in mm
    22, 23      downward flux fraction, and light output ratio of the luminaire, per cent
    24, 25      factor of all intensities, and tilt of the luminaire during the measurement
    26          number of lamp sets. Each set has six lines: number of lamps, type, lumens of all of them,
                colour, colour rendering, watts. A negative number of lamps means absolute photometry: the lumens
                are those of the luminaire
    then        ten direct ratios, all C angles, all gamma angles, and the intensities, cd per 1000 lm of the lamps.
                Intensities have one value per gamma for each stored plane. Symmetry omits planes: 0 to 180 are
                stored for 2, 270 to 360 and 0 to 90 for 3, 0 to 90 for 4

Intensity [cd] = value * line 24 * lumens of the lamp set / 1000. The values already include the light output ratio.
The sets are alternative lamps of the luminaire, and the first is used. The luminaire is treated as a point, so its
size is ignored.

Source:   Stockmar 1990, EULUMDAT, as Helios32 and DIAL describe it; Ashdown and DIAL, absolute photometry in
          EULUMDAT.
"""

from __future__ import annotations

import math
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

# Line (from 1) with the type.
_TYPE = 2
# Line with the symmetry.
_SYMMETRY = 3
# Line with the number of C planes.
_PLANES = 4
# Line with the number of gamma angles.
_GAMMAS = 6
# Line with the light output ratio.
_OUTPUT_RATIO = 23
# Line with the factor of all intensities.
_FACTOR = 24
# Line with the number of lamp sets.
_SETS = 26
_LINES_OF_A_SET, _DIRECT_RATIOS, _MAX_SETS = 6, 10, 20
# First and last stored C plane for each symmetry, degrees.
_SPANS = {2: (0.0, 180.0), 3: (270.0, 90.0), 4: (0.0, 90.0)}
# Maximum relative difference between the stated light output ratio and the ratio that the intensities give. Above
# it a warning is printed.
_RATIO_TOLERANCE = 0.1


def parse_eulumdat(data: bytes, path: Path | str, location: SourceLocation) -> LightProfile:
    """Return the profile in the content `data` of a file.

    path     : name of the file in errors
    location : location in the scene file where the photometric file is named

    Raises SceneError, which gives the line. A SceneWarning reports lamp sets of different lumens, and a light
    output ratio that contradicts the intensities.
    """
    return _Reader(data, path, location).profile()


class _Reader:
    """Reader of the lines of a file, which are numbered from 1."""

    def __init__(self, data: bytes, path: Path | str, location: SourceLocation) -> None:
        self._path, self._location = path, location
        # Split the bytes, not the text, because str.splitlines also splits at U+0085, an ellipsis in Windows-1252.
        self._lines = [line.decode("latin-1").strip() for line in data.removeprefix(b"\xef\xbb\xbf").splitlines()]
        while self._lines and self._lines[-1].strip("\x1a\0") == "":
            self._lines.pop()
        self._line = 0  # number of the line read last

    def profile(self) -> LightProfile:
        self._whole(_TYPE, "the type", 0, 3)  # some makers write 1, point source, beside any symmetry
        symmetry = self._whole(_SYMMETRY, "the symmetry", 0, 4)
        planes = self._whole(_PLANES, "the number of planes of C", 1, MAX_ANGLES)
        gammas = self._whole(_GAMMAS, "the number of angles gamma", 2, MAX_ANGLES)
        if planes * gammas > MAX_VALUES:
            self._wrong(f"{planes} x {gammas} intensities, more than {MAX_VALUES:,}")
        ratio = self._optional(_OUTPUT_RATIO, "the light output ratio")
        # An empty line or 0 means that the maker gives no factor.
        factor = self._optional(_FACTOR, "the factor of intensities") or 1.0
        lumens = self._lumens()
        self._line += _DIRECT_RATIOS
        c = self._stored(self._angles("C", planes, 360.0), symmetry)
        gamma = self._angles("gamma", gammas, 180.0)
        rest = len(self._lines) - self._line
        if rest != len(c) * gammas:
            self._line = len(self._lines)
            self._wrong(
                f"{rest:,} lines of intensities above it, where {len(c)} planes of {gammas} angles "
                f"have {len(c) * gammas:,}"
            )
        values = np.array([self._number("an intensity", 0.0) for _ in range(rest)]).reshape(len(c), gammas)
        candela = scaled(values, factor * lumens / 1000.0)
        if candela.max() > LARGEST:
            self._wrong(f"an intensity of up to {candela.max():.3g} cd; at most {LARGEST:g} are taken")
        if symmetry == 3:
            # Replace the stored planes by their mirror images, whose C angles ascend from 90 to 270.
            c, candela = 180.0 - np.where(c > 180, c - 360.0, c)[::-1], candela[::-1]
        elif symmetry == 0 and c[-1] != 360:
            c, candela = np.append(c, 360.0), np.concatenate([candela, candela[:1]])
        found = on_regular_grid(*all_around(c, candela), gamma)
        self._check_ratio(found.flux / lumens, ratio / 100.0)
        return found

    # Methods that read parts of the file.

    def _lumens(self) -> float:
        """Return the lumens of the first lamp set, and skip the other sets. Warns if the sets differ in lumens."""
        sets = self._whole(_SETS, "the number of sets of lamps", 1, _MAX_SETS)
        fluxes = []
        for i in range(sets):
            self._line = _SETS + _LINES_OF_A_SET * i
            self._whole(self._line + 1, "the number of lamps", -1_000_000, 1_000_000)
            self._line += 1  # skips the line with the lamps' type
            fluxes.append(self._number("the lumens of the lamps", 0.0))
            if fluxes[0] == 0:
                self._wrong("0 as the lumens of the lamps: no light")
        self._line = _SETS + _LINES_OF_A_SET * sets
        if any(flux != fluxes[0] for flux in fluxes):
            others = ", ".join(f"{flux:g} lm (intensity = {flux / fluxes[0]:.4g})" for flux in fluxes[1:])
            warn(
                f"{self._location}: {self._path} has {sets} sets of lamps, of which the first is taken, "
                f"{fluxes[0]:g} lm. The light's intensity chooses another: {others}."
            )
        return fluxes[0]

    def _angles(self, what: str, count: int, last: float) -> Float64:
        found = np.array([self._number(f"an angle {what}", 0.0) for _ in range(count)])
        if found[-1] > last:
            self._wrong(f"{found[-1]:g} as an angle {what}; at most {last:g} are possible")
        if np.any(np.diff(found) <= 0):
            self._wrong(f"angles {what} above it that do not ascend")
        return found

    def _stored(self, c: Float64, symmetry: int) -> Float64:
        """Return the C planes whose intensities are in the file, in the order of the file."""
        if c[0] != 0:
            self._wrong(f"angles above it of which the first of C is {c[0]:g}, not 0")
        if symmetry == 1:
            return c[:1]
        if symmetry == 0:
            return c
        first, last = _SPANS[symmetry]
        found = np.concatenate([c[c >= 270], c[c <= 90]]) if symmetry == 3 else c[c <= last]
        for end in (first, last):
            if end not in c:
                self._wrong(f"angles above it that lack C = {end:g}, which symmetry {symmetry} needs")
        return found[found < 360]

    def _check_ratio(self, found: float, written: float) -> None:
        if written > 0 and abs(found - written) > _RATIO_TOLERANCE * written:
            warn(
                f"{self._location}: the intensities of {self._path} sum up to {100 * found:.3g} % of its lamps' "
                f"lumens, and its light output ratio is {100 * written:.3g} %: the intensities are taken."
            )

    # Methods that read single lines.

    def _text(self, what: str) -> str:
        if self._line >= len(self._lines):
            self._line = len(self._lines)
            self._wrong(f"the end of the file above it, where {what} is expected")
        self._line += 1
        return self._lines[self._line - 1]

    def _number(self, what: str, minimum: float = -math.inf) -> float:
        text = self._text(what)
        try:
            number = real(text.replace(",", "."))
        except ValueError:
            self._wrong(f"{text[:20]!r} where {what} is expected")
        if not math.isfinite(number) or number < minimum:
            self._wrong(f"{text[:20]} where {what} is expected{'' if minimum < 0 else ', 0 or more'}")
        return number

    def _optional(self, line: int, what: str) -> float:
        """Return the number in a line, or 0 if the line is empty."""
        self._line = line - 1
        if self._line < len(self._lines) and not self._lines[self._line]:
            return 0.0
        return self._number(what, 0.0)

    def _whole(self, line: int, what: str, minimum: int, maximum: int) -> int:
        self._line = line - 1
        number = self._number(what)
        if not (number.is_integer() and minimum <= number <= maximum):
            self._wrong(f"{number:g} as {what}; expected {minimum} to {maximum}")
        return int(number)

    def _wrong(self, found: str) -> NoReturn:
        raise self._location.error(
            f"names {self._path}, which cannot be used: line {self._line} has {found}.",
            "Take a whole file of the maker's, or open it in a viewer of EULUMDAT files.",
        )
