"""CIE 171:2006, analytical test cases: results of `glpath.irradiance` compared with exact values.

A value passes within 1 % of the exact value, or within three of its standard errors if these are at most 1 %. Paths
are added to a case until its largest standard error is 0.2 %, or up to a maximum. By chance, some of the 3,229
values are off by more than three standard errors; these must be fewer than 1 %. `measured`:

    values        : number of values
    missed        : number of values that do not pass
    off           : largest relative error
    error         : largest relative standard error
    off_in_errors : largest error in standard errors, among values that are off by more than 0.1 %

Below scale 1, three of the sixteen skies are measured, with a target error of 1 %.
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
#: Skies of the quick run: overcast, clear, and the one brightest around the sun.
_FEW = (1, 12, 15)
_TARGET, _QUICK_TARGET = 0.002, 0.01
#: Relative error below which an error is due to the scene's float32, not to chance.
_BEYOND_CHANCE = 1e-3


def cases(folder: Path, which: tuple[int, ...] = skies.SKIES) -> Iterator[Case]:
    """Yield all cases under the skies `which`; photometric files are written to `folder`."""
    yield from electric.cases(folder)
    yield from daylight.cases(which)


def bench_cie171(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    scale : below 1, three skies and larger errors
    say   : function that gets messages about the progress
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
    """Return the report of the measured cases."""
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
    """Return the numbers of all cases together."""
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
