"""Files of luminaires, written in tests."""

from __future__ import annotations

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
    """A file of type C; candela (C, gamma)."""
    path.write_text(
        f"{head}{tilt}\n1 -1 {factors[0]} {len(gamma)} {len(c)} 1 2 0 0 0\n{factors[1]} {factors[2]} 10\n"
        f"{written(gamma)}\n{written(c)}\n" + "".join(written(row) + "\n" for row in candela)
    )
    return path
