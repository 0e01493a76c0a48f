"""Style of figures: one page for plots and panels of pictures, legible on a screen and in print.

A plot has one pair of axes, names with units, and a caption of two or three lines: the claim of the paper, and the
measurement here. Series differ in marker and in colour (Okabe and Ito 2008, safe for the colour-blind).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from glpath.film.charts import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MARGIN,
    ORANGE,
    PALE,
    PURPLE,
    UInt8,
    page,
    rastered,
    wrapped,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
MARKERS = ("o", "s", "^", "D")


@dataclass(frozen=True)
class Axis:
    """label: name with unit; log: powers of ten; zero: begin at 0."""

    label: str
    log: bool = False
    zero: bool = False


@dataclass(frozen=True)
class Series:
    """Points of one series.

    line : "points": joined by a thin line; "curve": no markers (a fit); "guide": thin and dashed
    """

    label: str
    x: ArrayLike
    y: ArrayLike
    line: Literal["points", "curve", "guide"] = "points"


def rule(figure: Figure, left: float, right: float, level: float) -> None:
    from matplotlib.lines import Line2D

    figure.add_artist(Line2D([left, right], [level, level], color=PALE, linewidth=1.0))


def plot(
    title: str,
    caption: str,
    panels: Sequence[tuple[Axis, Axis, Sequence[Series]]],
    size: tuple[int, int] = (560, 400),
) -> UInt8:
    """Return a page with plots side by side, (H, W, 3) uint8; each panel is (x axis, y axis, series).

    size : (width, height) of one plot with its axes, in pixels
    """
    width = size[0] * len(panels)
    lines = wrapped(caption, width)
    figure, bottom, height = page(title, lines, width, size[1])
    for i, (x, y, series) in enumerate(panels):
        # Leave 78 pixels to the left and 56 below for the axes' numbers and names.
        left = (i * size[0] + 78) / width
        axes = figure.add_axes(
            (left, (bottom + 56) / height, (size[0] - 78 - MARGIN) / width, (size[1] - 56 - 8) / height)
        )
        _draw(axes, x, y, series)
    return rastered(figure)


def _draw(axes: Axes, x: Axis, y: Axis, series: Sequence[Series]) -> None:
    marked = 0
    for s in series:
        xs, ys = np.asarray(s.x, float), np.asarray(s.y, float)
        if s.line == "guide":
            axes.plot(xs, ys, color=GREY, linewidth=1.0, linestyle=(0, (5, 4)), label=s.label, zorder=1)
            continue
        colour, marker = COLOURS[marked % len(COLOURS)], MARKERS[marked % len(MARKERS)]
        marked += 1
        if s.line == "curve":
            axes.plot(xs, ys, color=colour, linewidth=1.6, label=s.label, zorder=2)
        else:
            axes.plot(
                xs, ys, color=colour, linewidth=1.2, marker=marker, markersize=6, label=s.label, zorder=3,
                markeredgecolor="white", markeredgewidth=0.8, clip_on=False,
            )  # fmt: skip
    for name, axis in (("x", x), ("y", y)):
        if axis.log:
            getattr(axes, f"set_{name}scale")("log")
        elif axis.zero:
            getattr(axes, f"set_{name}lim")(**{"left" if name == "x" else "bottom": 0})
    axes.set_xlabel(x.label, color=INK, fontsize=11)
    axes.set_ylabel(y.label, color=INK, fontsize=11)
    axes.tick_params(colors=INK, labelsize=10, length=4)
    axes.tick_params(which="minor", length=2)
    axes.grid(True, color=PALE, linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(GREY)
    if len(series) > 1:
        axes.legend(frameon=True, framealpha=0.9, edgecolor="none", fontsize=10, labelcolor=INK)


def drawings(
    title: str,
    caption: str,
    panels: Sequence[tuple[str, Callable[[Any], None], bool]],
    columns: int,
    size: tuple[int, int] = (360, 320),
) -> UInt8:
    """Return a page of drawings without axes; each panel is (title, function that draws into axes, whether in 3D).

    size : (width, height) of one drawing, in pixels
    """
    heading = 30
    rows = -(-len(panels) // columns)
    width = 2 * MARGIN + columns * size[0]
    body = rows * (size[1] + heading)
    figure, bottom, height = page(title, wrapped(caption, width), width, body)
    for i, (name, draw, solid) in enumerate(panels):
        row, column = divmod(i, columns)
        left = MARGIN + column * size[0]
        below = bottom + body - (row + 1) * (size[1] + heading)
        box = (left / width, below / height, size[0] / width, size[1] / height)
        if solid:
            axes: Any = figure.add_axes(box, projection="3d", proj_type="ortho", computed_zorder=False)
        else:
            axes = figure.add_axes(box, aspect="equal")
        axes.set_axis_off()
        draw(axes)
        figure.text(left / width, (below + size[1] + 8) / height, name, fontsize=11, color=INK, va="baseline")
    return rastered(figure)


def table(title: str, caption: str, columns: Sequence[tuple[str, int]], lines: Sequence[Sequence[str]]) -> UInt8:
    """Return a page with a table. A line of one text is a heading within it.

    columns : (name, width in pixels) of each; names may have two lines; the first column is left-aligned
    """
    step, heading = 26, 56
    width = 2 * MARGIN + sum(w for _, w in columns)
    body = heading + step * len(lines)
    figure, bottom, height = page(title, wrapped(caption, width), width, body)
    ends = MARGIN + np.cumsum([w for _, w in columns])

    def write(texts: Sequence[str], level: int, bold: bool) -> None:
        for i, text in enumerate(texts):
            x, side = (MARGIN, "left") if i == 0 else (int(ends[i]) - 10, "right")
            figure.text(
                x / width, level / height, text, fontsize=10.5, color=INK, ha=side, va="baseline",
                fontweight="bold" if bold else "normal", parse_math=False,
            )  # fmt: skip

    top = bottom + body
    write([name for name, _ in columns], top - heading + 16, True)
    rule(figure, MARGIN / width, 1 - MARGIN / width, (top - heading + 7) / height)
    for i, line in enumerate(lines):
        level = top - heading - step * (i + 1) + 8
        write(line, level, len(line) == 1)
        rule(figure, MARGIN / width, 1 - MARGIN / width, (level - 8) / height)
    return rastered(figure)


def pictures(
    title: str,
    caption: str,
    panels: Sequence[tuple[str, UInt8]],
    columns: int,
    table: Sequence[tuple[str, str]] = (),
) -> UInt8:
    """Return a page of pictures, (H, W, 3) uint8 of equal size, at their original pixels, each under its title.

    table : lines of two columns, to the right of the pictures
    """
    gap, heading, table_width = 12, 26, 300 if table else 0
    h, w = panels[0][1].shape[:2]
    assert all(p.shape == panels[0][1].shape for _, p in panels), "pictures of one size only"
    # Show each pixel of a small picture (small scale) as a square of this side.
    zoom = max(1, 240 // max(w, h))
    h, w = h * zoom, w * zoom
    rows = -(-len(panels) // columns)
    width = max(2 * MARGIN + columns * w + (columns - 1) * gap + table_width, 480)
    body = rows * (h + heading) + (rows - 1) * gap
    figure, bottom, height = page(title, wrapped(caption, width), width, body)
    for i, (name, picture) in enumerate(panels):
        row, column = divmod(i, columns)
        left = MARGIN + column * (w + gap)
        below = bottom + body - (row + 1) * (h + heading) - row * gap
        # Draw without axes, because hundreds of axes take minutes.
        figure.figimage(picture.repeat(zoom, axis=0).repeat(zoom, axis=1), left, below, origin="upper")
        figure.text(left / width, (below + h + 8) / height, name, fontsize=11, color=INK, va="baseline")
    if table:
        right = MARGIN + columns * (w + gap) + 16
        for i, (feature, status) in enumerate(table):
            level = bottom + body - heading - 16 - 28 * i
            weight = "bold" if i == 0 else "normal"
            figure.text(right / width, level / height, feature, fontsize=11, color=INK, fontweight=weight)
            figure.text((right + 200) / width, level / height, status, fontsize=11, color=INK, fontweight=weight)
            rule(figure, right / width, (right + 252) / width, (level - 9) / height)
    return rastered(figure)
