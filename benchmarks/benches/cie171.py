"""CIE 171:2006, its analytical test cases: what `glpath.irradiance` finds beside exact values.

Each value passes within 1 % of what is true, or within three of its standard errors where these are 1 % at most.
Paths are added to a case until its largest standard error is 0.2 %, or until there are enough: of 3,229 values some
are off by three standard errors and more by chance, which must be less than 1 % then. `measured`:

    values        : how many
    missed        : of these, which do not pass
    off           : the largest relative error
    error         : the largest relative standard error
    off_in_errors : the largest error of a value, in its standard errors, of those that are off by more than 0.1 %

Below scale 1 three skies of the sixteen are taken, with an error of 1 %.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cie171 import daylight, electric, skies
from benchmarks.cie171.case import Case, Measured
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.gl.context import get_context
from glpath.system.versions import versions

Say = Callable[[str], None]

CLAIM = "CIE 171:2006: each value within 1 % of exact, or within three standard errors of 1 % at most"
RULE = (Condition("missed", "<=", 0),)
#: Of the quick run: overcast, clear, and the brightest around the sun.
_FEW = (1, 12, 15)
_TARGET, _QUICK_TARGET = 0.002, 0.01
#: Below that share an error is of the scene's float32, not of chance.
_BEYOND_CHANCE = 1e-3


def cases(folder: Path, which: tuple[int, ...] = skies.SKIES) -> Iterator[Case]:
    """All cases, under these skies; files of photometry are written into a folder."""
    yield from electric.cases(folder)
    yield from daylight.cases(which)


def bench_cie171(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    scale : below 1, three skies and larger errors
    say   : called with a line on what goes on
    """
    context = get_context()
    start = time.perf_counter()
    which, target = (skies.SKIES, _TARGET) if scale >= 1 else (_FEW, _QUICK_TARGET)
    found: list[Measured] = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder), which):
            found.append(case.measured(target))
            say(f"{case.name}: off by {100 * np.abs(found[-1].off).max():.2f} %")
    notes = [] if scale >= 1 else [f"at scale {scale:g}"]
    return report(found, machine(context.info.renderer), time.perf_counter() - start, notes)


def report(found: list[Measured], on: dict[str, Any], seconds: float, notes: list[str]) -> Report:
    """Of cases that were measured on a machine."""
    numbers = summary(found) | {"seconds": seconds}
    claim, holds = judge(CLAIM, RULE, numbers)
    return Report(
        name="cie171",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=[each.row() for each in found],
        machine=on,
        versions=versions("glpath", "moderngl", "numpy"),
        notes=notes,
    )


def summary(found: list[Measured]) -> dict[str, Any]:
    """The numbers of all cases together."""
    off = np.concatenate([np.abs(each.off) for each in found])
    errors = np.concatenate(
        [np.where(each.lit, each.errors / np.maximum(each.case.exact, 1e-30), 0) for each in found]
    )
    far = (off > _BEYOND_CHANCE) & (errors > 0)
    return {
        "values": len(off),
        "missed": int(sum(np.count_nonzero(~each.passes) for each in found)),
        "off": float(off.max()),
        "error": float(errors.max()),
        "off_in_errors": float((off[far] / errors[far]).max(initial=0.0)),
    }
