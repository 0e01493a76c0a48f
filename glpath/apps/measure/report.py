"""Report of a measurement for lighting engineers, as one self-contained HTML file.

It has figures with standard errors, settings, lamps, and a plan in false colours with isolux lines and values. It
is laid out for printing.
"""

from __future__ import annotations

import base64
import datetime
import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from glpath.apps.measure.figures import with_error
from glpath.apps.measure.measured import Measured
from glpath.apps.measure.points import AXES, Grid, Points, coordinate
from glpath.film.charts import colour_range, false_colours, field
from glpath.film.image import encode_png
from glpath.scene.summary import about_lights, light_of
from glpath.system.colour import luminance
from glpath.system.files import write_bytes
from glpath.system.reporting import duration
from glpath.system.units import conversion
from glpath.system.versions import versions

if TYPE_CHECKING:
    from glpath.scene import Scene

#: Maximum number of columns of values on the plan.
_COLUMNS = 40
#: Maximum number of rows of values on the plan.
_ROWS = 60
#: Maximum number of rows in the table of points.
_POINT_ROWS = 1000
#: Maximum number of rows in the table of lamps.
_LAMP_ROWS = 100


def save_report(path: Path, measured: Measured) -> None:
    """Write the .html, whole or not at all. Raises ImageError, and GlpathError without matplotlib."""
    page = resources.files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    page = page.replace("<!--TITLE-->", escape(measured.title))
    write_bytes(page.replace("<!--BODY-->", "\n".join(_body(measured))).encode(), path)


def plan(measured: Measured, caption: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the grid in false colours as a picture, (H, W, 3) uint8."""
    grid = measured.at.grid
    assert grid is not None, "asked for before"
    return field(
        f"{measured.title}, {AXES[grid.axis]} = {_six_digits(grid.height)}",
        caption,
        measured.values.reshape(grid.shape),
        grid.extent,
        (AXES[grid.across[0]], AXES[grid.across[1]]),
        "lux" if measured.unit == "lx" else measured.unit,
    )


def _body(measured: Measured) -> Iterator[str]:
    made = measured.found.film.metadata
    now = datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    yield f"<h1>{escape(measured.title)}</h1>"
    yield f'<p class="quiet">{escape(now)}, glpath {escape(versions("glpath").get("glpath", ""))}</p>'
    yield "<h2>Result</h2>"
    yield _pairs(_result(measured), "pairs result")
    if measured.dark:
        yield (
            f"<p>Without {measured.dark:,} of {measured.found.count:,} points that have no light at all: inside of "
            "solids, perhaps.</p>"
        )
    yield "<h2>Points</h2>"
    yield _pairs(_where(measured.at), "pairs")
    yield "<h2>Calculation</h2>"
    scene = measured.scene
    error = float((measured.found.illuminance_errors() ** 2).mean() ** 0.5)
    yield _pairs(
        [
            ("scene", scene.source or scene.name),
            ("light", light_of(scene).removeprefix("light: ")),
            ("method", f"{made.integrator}, {measured.found.film.path_sets:,} paths of each point"),
            ("reflections", "all" if made.max_depth is None else f"paths of {made.max_depth} vertices at most"),
            ("standard error of a point", "not known" if math.isnan(error) else f"{error:.2g} {measured.unit}"),
            ("computed on", f"{made.device}, {duration(made.elapsed_s)}"),
            ("digest of the scene", made.scene_hash),
        ],
        "pairs",
    )
    yield from _lamps(scene)
    grid = measured.at.grid
    if grid is None:
        yield from _table_of_points(measured)
        return
    picture = base64.b64encode(encode_png(plan(measured, "Isolux lines in white."))).decode("ascii")
    yield "<h2>Plan</h2>"
    yield f'<img alt="{escape(measured.title)} in false colours" src="data:image/png;base64,{picture}">'
    yield from _values_on_the_plan(measured, grid)


def _result(measured: Measured) -> Iterator[tuple[str, str]]:
    spread = measured.spread
    for name, x in (("mean Ē", spread.mean), ("minimum", spread.minimum), ("maximum", spread.maximum)):
        yield name, with_error(x, f"{x.value:.4g}", f" {measured.unit}")
    if spread.mean.value > 0:
        yield "uniformity U0 = minimum / mean", with_error(spread.u0, f"{spread.u0.value:.3f}")
        yield "uniformity Ud = minimum / maximum", with_error(spread.ud, f"{spread.ud.value:.3f}")


def _where(at: Points) -> Iterator[tuple[str, str]]:
    grid = at.grid
    if grid is None:
        yield "points", f"{len(at.points):,} of a table"
        return
    u, v = (AXES[i] for i in grid.across)
    a, b, c, d = grid.extent
    facing = ", ".join(f"{x:g}" for x in at.normals[0])
    yield "plane", f"{AXES[grid.axis]} = {_six_digits(grid.height)}, facing {facing}"
    yield "area", f"{u} from {coordinate(a)} to {coordinate(b)}, {v} from {coordinate(c)} to {coordinate(d)}"
    yield "grid", f"{grid.shape[1]} x {grid.shape[0]} points, {grid.apart} apart"
    yield "EN 12464-1", grid.beside_en_12464


def _lamps(scene: Scene) -> Iterator[str]:
    """Yield a table of punctual lights and emitting shapes with their luminous flux."""
    lamps = about_lights(scene)
    if not lamps:
        return
    yield "<h2>Lamps</h2>"
    to_lumens, rows, total = conversion(scene.unit, "photometric"), [], 0.0
    for lamp in lamps:
        lumens = None if lamp["power"] is None else to_lumens * float(luminance(np.array(lamp["power"])))
        total += lumens or 0.0
        position = ", ".join(map(coordinate, lamp.get("position", ())))
        factor = lamp.get("maintenance_factor", 1.0)
        rows.append(
            (lamp["name"], lamp["kind"], position, "" if lumens is None else _lumens(lumens), f"{factor:g}")
        )
    yield _list(("name", "kind", "position", "lm, maintained", "maintenance factor"), rows[:_LAMP_ROWS], 3)
    more = f"the first {_LAMP_ROWS} of {len(rows):,}; " if len(rows) > _LAMP_ROWS else ""
    yield f'<p class="quiet">{more}all together {_lumens(total)} lm, as far as a flux is known.</p>'


def _values_on_the_plan(measured: Measured, grid: Grid) -> Iterator[str]:
    """Yield an HTML table of the values; the first row of the grid is at the bottom, as on the plan."""
    rows, columns = grid.shape
    every = max(1, math.ceil(columns / _COLUMNS), math.ceil(rows / _ROWS))
    values = measured.values.reshape(grid.shape)[::every, ::every]
    first, second = (grid.first[i] + grid.step[i] * np.arange(n)[::every] for i, n in ((0, columns), (1, rows)))
    backgrounds, inks = _colours(values, colour_range(measured.values))
    yield f"<h2>Values, {'lux' if measured.unit == 'lx' else measured.unit}</h2>"
    if every > 1:
        yield f'<p class="quiet">One of {every} points along both axes.</p>'
    yield '<div class="wide"><table class="values"><tbody>'
    for i in range(len(values) - 1, -1, -1):
        cells = (
            '<td class="dark">0</td>'
            if np.isnan(value)
            else f'<td style="background:{background};color:{ink}">{_lux(value)}</td>'
            for value, background, ink in zip(values[i], backgrounds[i], inks[i], strict=True)
        )
        yield f"<tr><th>{AXES[grid.across[1]]} {coordinate(second[i])}</th>{''.join(cells)}</tr>"
    ends = "".join(f"<th>{coordinate(x)}</th>" for x in first)
    yield f"</tbody><tfoot><tr><th>{AXES[grid.across[0]]}</th>{ends}</tr></tfoot></table></div>"


def _colours(values: np.ndarray[Any, Any], ends: tuple[float, float]) -> tuple[list[list[str]], list[list[str]]]:
    """Return the CSS colours of each value's background (false colours) and of its text."""
    colours = false_colours(values, ends)
    bright = luminance(colours) > 0.45
    named = [["#" + "".join(f"{round(255 * x):02x}" for x in colour) for colour in row] for row in colours.tolist()]
    return named, [["#222" if light else "#fff" for light in row] for row in bright.tolist()]


def _six_digits(x: float) -> str:
    """Return a coordinate as text: six significant digits, or two decimals from 1,000 units on."""
    return f"{x:g}" if abs(x) < 1e3 else coordinate(x)


def _lux(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _lumens(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.4g}"


def _table_of_points(measured: Measured) -> Iterator[str]:
    yield "<h2>Values</h2>"
    found, at = measured.found, measured.at
    lux, errors = found.illuminance(), found.illuminance_errors()
    rows = [
        (
            *map(_six_digits, at.points[i]),
            *(f"{x:.6g}" for x in at.normals[i]),
            f"{lux[i]:.4g}",
            f"{errors[i]:.2g}",
        )
        for i in range(min(len(lux), _POINT_ROWS))
    ]
    symbol = "E" if measured.unit == "lx" else "D"
    titles = (f"{symbol}, {measured.unit}", f"standard error, {measured.unit}")
    yield _list(("x", "y", "z", "nx", "ny", "nz", *titles), rows, 0)
    if len(lux) > _POINT_ROWS:
        yield f'<p class="quiet">The first {_POINT_ROWS:,} of {len(lux):,} points.</p>'


def _pairs(rows: Iterable[tuple[str, str]], kind: str) -> str:
    lines = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f'<table class="{kind}">{lines}</table>'


def _list(titles: Sequence[str], rows: Sequence[Sequence[str]], numbers_from: int) -> str:
    """Return an HTML table; columns from index `numbers_from` on hold numbers."""

    def line(cells: Sequence[str], tag: str) -> str:
        marks = [' class="number"' if i >= numbers_from else "" for i in range(len(cells))]
        return "".join(f"<{tag}{mark}>{escape(cell)}</{tag}>" for cell, mark in zip(cells, marks, strict=True))

    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    return f'<div class="wide"><table class="list"><tr>{line(titles, "th")}</tr>{body}</table></div>'
