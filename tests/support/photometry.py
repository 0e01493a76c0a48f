"""Writes files of luminaires for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glpath.scene.model import Float64


def written(numbers: object) -> str:
    return " ".join(f"{x:.9g}" for x in np.ravel(np.asarray(numbers)))


def ies(
    path: Path,
    gamma: Float64,
    c: Float64,
    candela: Float64,
    *,
    head: str = "IESNA:LM-63-2002\n[TEST] made up\n[MANUFAC] nobody\n",
    tilt: str = "TILT=NONE",
    factors: tuple[float, float, float] = (1, 1, 1),
) -> Path:
    """Write an IES file of type C; candela (C, gamma)."""
    path.write_text(
        f"{head}{tilt}\n1 -1 {factors[0]} {len(gamma)} {len(c)} 1 2 0 0 0\n{factors[1]} {factors[2]} 10\n"
        f"{written(gamma)}\n{written(c)}\n" + "".join(written(row) + "\n" for row in candela)
    )
    return path


def eulumdat(
    path: Path,
    gamma: Float64,
    c: Float64,
    per_klm: Float64,
    *,
    symmetry: int = 0,
    sets: Sequence[tuple[int, float]] = ((1, 1000.0),),
    output_ratio: object = 0,
    factor: object = 1,
    end: str = "\r\n",
) -> Path:
    """A EULUMDAT file: all planes `c` from 0 to below 360, and intensities (stored planes, gamma), cd per 1000 lm.

    sets : for each set of lamps, their number and the lumens of all of them
    """
    head = ["nobody", 1 if symmetry == 1 else 3, symmetry, len(c), 0, len(gamma), 0, "", "made up", "", "a", "now"]
    sizes = [0] * 10
    lamps = [line for number, lumens in sets for line in (number, "lamp", lumens, "4000", "80", 10)]
    lines = [*head, *sizes, output_ratio, factor, 0, len(sets), *lamps, *[0.5] * 10]
    numbers = [f"{x:.9g}" for x in np.concatenate([c, gamma, np.ravel(per_klm)])]
    path.write_bytes((end.join([*map(str, lines), *numbers]) + end).encode("latin-1"))
    return path
