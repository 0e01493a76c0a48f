"""Table 1 of the shaft paper [SC]: savings by shafts, for each strategy, in the two offices.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", Eurographics Workshop on Rendering,
1991.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from benchmarks.figures.outcome import Outcome, Say, judged
from benchmarks.figures.style import table
from benchmarks.office_table import OFFICES, savings_rows, table_1_rows
from benchmarks.verdict import Condition

_outcome = partial(judged, with_gl=False)


def table_1(scale: float, say: Say) -> Outcome:
    """Make table 1: tests and time per ray for all strategies, both sampling rates and both offices."""
    # Distance between points of a mesh, in metres, and number of the ten lights to use.
    spacing, lights = min(0.25 / scale, 2.0), max(1, round(10 * scale))
    rows = table_1_rows(spacing=spacing, rounds=max(1, round(5 * scale)), say=say, most_lights=lights)
    savings = savings_rows(spacing=spacing, most_lights=lights)
    names = dict(zip(OFFICES, ("office", "premesh"), strict=True))
    measured: dict[str, float] = {}
    for scene, short in names.items():
        of = {row["strategy"]: row for row in rows if row["scene"] == scene}
        ratios = [row for strategy, row in of.items() if strategy.startswith("ratio open")]
        base = of["baseline"]
        measured |= {
            f"tests_gain_{short}": base["tests/ray"] / min(row["tests/ray"] for row in ratios),
            f"time_gain_{short}": base["high µs"] / min(row["high µs"] for row in ratios),
            f"closed_tests_gain_{short}": base["tests/ray"] / of["keep closed"]["tests/ray"],
            f"always_open_tests_gain_{short}": base["tests/ray"] / of["always open"]["tests/ray"],
        }
    for row in savings:
        short = names[row["scene"]]
        measured |= {
            f"cache_saves_{short}": row["cache saves"],
            f"emitter_list_saves_{short}": row["emitter list saves"],
        }
    measured["wrong_rays"] = float(max(row["wrong rays"] for row in rows))
    rule = (
        Condition("wrong_rays", "<=", 0),
        Condition("tests_gain_office", ">=", 2.0),
        Condition("tests_gain_premesh", ">=", 3.8),
        Condition("time_gain_office", ">=", 1.6),
        Condition("time_gain_premesh", ">=", 2.2),
    )
    said = "ratio open divides the tests by 2.0 (standard) and 3.8 (premesh), the time by 1.6 and 2.2"
    here = (
        f"tests divided by {measured['tests_gain_office']:.2f} and {measured['tests_gain_premesh']:.2f}, "
        f"time at high sampling by {measured['time_gain_office']:.2f} and {measured['time_gain_premesh']:.2f}"
    )
    caption = (
        f"Paper: {said}. Its times are of an HP 9000/433.\nHere: {here}. One thread, shafts included; "
        "rays that the last occluder stopped are not counted. Low: 1 sample of each light, high: 4. Candidates, "
        "empty shafts and rays without a test (free): at high sampling. Walls and floor, with the "
        "most rays, have far more candidates than the mean."
    )
    columns = (
        ("Strategy", 150), ("tests/ray\nhere", 88), ("\npaper", 68), ("low µs\nhere", 78), ("\npaper", 68),
        ("high µs\nhere", 78), ("\npaper", 68), ("rays/shaft\nlow", 96), ("\nhigh", 68),
        ("candidates\nper shaft", 100), ("empty\nshafts", 78), ("free\nrays", 78),
    )  # fmt: skip
    lines: list[list[str]] = []
    for scene, saved in zip(OFFICES, savings, strict=True):
        lines.append([f"{'Premesh' if 'premesh' in scene else 'Standard'} ({scene})"])
        lines += [_line(row) for row in rows if row["scene"] == scene]
        lines.append([
            f"Savings in tests: shadow cache {_percent(saved['cache saves'])} (paper: 31 %), emitter list "
            f"{_percent(saved['emitter list saves'])} (paper: {100 * saved['paper emitter list saves']:.0f} %)"
        ])  # fmt: skip
    picture = table("Table 1: statistics for office databases", caption, columns, lines)
    notes = (
        [] if scale == 1 else [f"at scale {scale:g}, receiver points {spacing:g} m apart and {lights} of 10 lights"]
    )
    return _outcome("shaft-table-1", said, rule, measured, rows, picture, notes)


def _line(row: dict[str, Any]) -> list[str]:
    def number(name: str, form: str) -> str:
        return "–" if row[name] is None else format(row[name], form)

    return [
        row["strategy"], number("tests/ray", ".1f"), number("paper tests/ray", ".1f"), number("low µs", ".3f"),
        number("paper low µs", "d"), number("high µs", ".3f"), number("paper high µs", "d"),
        number("rays/shaft low", ".1f"), number("rays/shaft high", ".1f"), number("candidates/shaft", ".1f"),
        _percent(row["empty shafts"]), _percent(row["free rays"]),
    ]  # fmt: skip


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"


FIGURES = {
    "shaft-table-1": (table_1, "tests and time per ray of every strategy, beside the paper's"),
}
