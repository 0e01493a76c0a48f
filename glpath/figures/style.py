"""How figures look: one page for all plots and picture panels, legible on a screen and in print.

A plot has one axis pair, names with units, and a caption of two or three lines: what the paper says, what is
measured here. Series differ in marker as well as in colour (Okabe and Ito 2008, safe for the colour-blind).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import GlpathError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UInt8 = NDArray[np.uint8]

BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
MARKERS = ("o", "s", "^", "D")
INK, GREY, PALE = "#222222", "#6E6E6E", "#E4E4E4"

DPI = 100
_CAPTION_SIZE, _CAPTION_LINE = 10.5, 19  # points, pixels
_MARGIN = 16


@dataclass(frozen=True)
class Series:
    """Points of one kind.

    line : "points" joined by a thin line, a "curve" without markers (a fit), or "guide", thin and dashed
    """

    label: str
    x: ArrayLike
    y: ArrayLike
    line: Literal["points", "curve", "guide"] = "points"


@dataclass(frozen=True)
class Axis:
    """label: with its unit; log: powers of ten; zero: begin at 0."""

    label: str
    log: bool = False
    zero: bool = False


def plot(
    title: str,
    caption: str,
    panels: Sequence[tuple[Axis, Axis, Sequence[Series]]],
    size: tuple[int, int] = (560, 400),
) -> UInt8:
    """A page with plots side by side: (x axis, y axis, series) each. Returns (H, W, 3) uint8.

    size : (width, height) of one plot with its axes, pixels
    """
    width = size[0] * len(panels)
    lines = _wrapped(caption, width)
    figure, bottom, height = _page(title, lines, width, size[1])
    for i, (x, y, series) in enumerate(panels):
        # Room for numbers and names of the axes: 78 pixels to the left, 56 below.
        left = (i * size[0] + 78) / width
        axes = figure.add_axes(
            (left, (bottom + 56) / height, (size[0] - 78 - _MARGIN) / width, (size[1] - 56 - 8) / height)
        )
        _draw(axes, x, y, series)
    return _rastered(figure)


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


def field(
    title: str,
    caption: str,
    values: NDArray[np.float64],
    extent: tuple[float, float, float, float],
    axes_of: tuple[Axis, Axis],
    unit: str,
    size: int = 480,
) -> UInt8:
    """A page with values (rows, columns) over a plane in false colours, with their scale and lines of equal values.

    values : NaN where there is none, which is grey
    extent : where the first and the last column begin and end, then rows, of which the first is the lowest
    size   : of the longer side of the map, pixels
    """
    require_matplotlib()
    from matplotlib.ticker import MaxNLocator

    left_of_map, right_of_map, below_map = 78, 110, 52
    wide, high = extent[1] - extent[0], extent[3] - extent[2]
    # A strip is drawn no thinner than it can be read.
    across, up = (max(160, round(size * side / max(wide, high))) for side in (wide, high))
    width = max(left_of_map + across + right_of_map, 420)
    figure, bottom, height = _page(title, _wrapped(caption, width), width, up + below_map + 8)
    below = (bottom + below_map) / height
    axes = figure.add_axes((left_of_map / width, below, across / width, up / height))
    top = float(np.nanmax(values))
    axes.set_facecolor(GREY)
    drawn = axes.imshow(
        values, origin="lower", extent=extent, cmap="viridis", vmin=0.0, vmax=top or 1.0, aspect="auto"
    )  # fmt: skip
    rows, columns = values.shape
    if min(rows, columns) >= 3 and np.nanmin(values) < top:
        x = extent[0] + (np.arange(columns) + 0.5) * wide / columns
        y = extent[2] + (np.arange(rows) + 0.5) * high / rows
        levels = MaxNLocator(6).tick_values(0.0, top)[1:-1]  # without that of 0
        lines = axes.contour(x, y, values, levels=levels, colors="white", linewidths=0.8)
        axes.clabel(lines, fontsize=8, fmt="%g")
    axes.set_xlabel(axes_of[0].label, color=INK, fontsize=11)
    axes.set_ylabel(axes_of[1].label, color=INK, fontsize=11)
    legend = figure.add_axes(((left_of_map + across + 16) / width, below, 16 / width, up / height))
    figure.colorbar(drawn, cax=legend)
    legend.set_ylabel(unit, color=INK, fontsize=11)
    for each in (axes, legend):
        each.tick_params(colors=INK, labelsize=10, length=4)
    return _rastered(figure)


def drawings(
    title: str,
    caption: str,
    panels: Sequence[tuple[str, Callable[[Any], None], bool]],
    columns: int,
    size: tuple[int, int] = (360, 320),
) -> UInt8:
    """A page with drawings without axes: (title, what draws into a pair or triple of axes, whether in 3D) each.

    size : (width, height) of one drawing, pixels
    """
    heading = 30
    rows = -(-len(panels) // columns)
    width = 2 * _MARGIN + columns * size[0]
    body = rows * (size[1] + heading)
    figure, bottom, height = _page(title, _wrapped(caption, width), width, body)
    for i, (name, draw, solid) in enumerate(panels):
        row, column = divmod(i, columns)
        left = _MARGIN + column * size[0]
        below = bottom + body - (row + 1) * (size[1] + heading)
        box = (left / width, below / height, size[0] / width, size[1] / height)
        if solid:
            axes: Any = figure.add_axes(box, projection="3d", proj_type="ortho", computed_zorder=False)
        else:
            axes = figure.add_axes(box, aspect="equal")
        axes.set_axis_off()
        draw(axes)
        figure.text(left / width, (below + size[1] + 8) / height, name, fontsize=11, color=INK, va="baseline")
    return _rastered(figure)


def table(title: str, caption: str, columns: Sequence[tuple[str, int]], lines: Sequence[Sequence[str]]) -> UInt8:
    """A page with a table. A line of one text is a heading within it.

    columns : (name, width in pixels) each; names may have two lines; the first column is set to the left
    """
    step, heading = 26, 56
    width = 2 * _MARGIN + sum(w for _, w in columns)
    body = heading + step * len(lines)
    figure, bottom, height = _page(title, _wrapped(caption, width), width, body)
    ends = _MARGIN + np.cumsum([w for _, w in columns])

    def write(texts: Sequence[str], level: int, bold: bool) -> None:
        for i, text in enumerate(texts):
            x, side = (_MARGIN, "left") if i == 0 else (int(ends[i]) - 10, "right")
            figure.text(
                x / width, level / height, text, fontsize=10.5, color=INK, ha=side, va="baseline",
                fontweight="bold" if bold else "normal", parse_math=False,
            )  # fmt: skip

    top = bottom + body
    write([name for name, _ in columns], top - heading + 16, True)
    _rule(figure, _MARGIN / width, 1 - _MARGIN / width, (top - heading + 7) / height)
    for i, line in enumerate(lines):
        level = top - heading - step * (i + 1) + 8
        write(line, level, len(line) == 1)
        _rule(figure, _MARGIN / width, 1 - _MARGIN / width, (level - 8) / height)
    return _rastered(figure)


def pictures(
    title: str,
    caption: str,
    panels: Sequence[tuple[str, UInt8]],
    columns: int,
    table: Sequence[tuple[str, str]] = (),
) -> UInt8:
    """A page with pictures (H, W, 3) uint8 of one size, pixel for pixel, each under its title.

    table : lines of two columns, to the right of the pictures
    """
    gap, heading, table_width = 12, 26, 300 if table else 0
    h, w = panels[0][1].shape[:2]
    assert all(p.shape == panels[0][1].shape for _, p in panels), "pictures of one size only"
    # A picture of a few pixels (a small scale) is shown with pixels as squares of this side.
    zoom = max(1, 240 // max(w, h))
    h, w = h * zoom, w * zoom
    rows = -(-len(panels) // columns)
    width = max(2 * _MARGIN + columns * w + (columns - 1) * gap + table_width, 480)
    body = rows * (h + heading) + (rows - 1) * gap
    figure, bottom, height = _page(title, _wrapped(caption, width), width, body)
    for i, (name, picture) in enumerate(panels):
        row, column = divmod(i, columns)
        left = _MARGIN + column * (w + gap)
        below = bottom + body - (row + 1) * (h + heading) - row * gap
        # Without axes, of which hundreds take minutes.
        figure.figimage(picture.repeat(zoom, axis=0).repeat(zoom, axis=1), left, below, origin="upper")
        figure.text(left / width, (below + h + 8) / height, name, fontsize=11, color=INK, va="baseline")
    if table:
        right = _MARGIN + columns * (w + gap) + 16
        for i, (feature, status) in enumerate(table):
            level = bottom + body - heading - 16 - 28 * i
            weight = "bold" if i == 0 else "normal"
            figure.text(right / width, level / height, feature, fontsize=11, color=INK, fontweight=weight)
            figure.text((right + 200) / width, level / height, status, fontsize=11, color=INK, fontweight=weight)
            _rule(figure, right / width, (right + 252) / width, (level - 9) / height)
    return _rastered(figure)


def _rule(figure: Figure, left: float, right: float, level: float) -> None:
    from matplotlib.lines import Line2D

    figure.add_artist(Line2D([left, right], [level, level], color=PALE, linewidth=1.0))


def _wrapped(caption: str, width: int) -> list[str]:
    """Lines of the caption as they fit into a page so many pixels wide."""
    require_matplotlib()
    from matplotlib.backends import backend_agg
    from matplotlib.font_manager import FontProperties

    agg: Any = backend_agg  # without types in matplotlib
    font, page = FontProperties(size=_CAPTION_SIZE), agg.RendererAgg(1, 1, DPI)
    room = width - 2 * _MARGIN

    def fits(line: str) -> bool:
        return bool(page.get_text_width_height_descent(line, font, ismath=False)[0] <= room)

    lines = []
    for paragraph in caption.splitlines():
        line = ""
        for word in paragraph.split():
            if line and not fits(f"{line} {word}"):
                lines.append(line)
                line = word
            else:
                line = f"{line} {word}".strip()
        lines.append(line)
    return lines


def _page(title: str, lines: Sequence[str], width: int, body: int) -> tuple[Figure, int, int]:
    """A white page with title and caption; where its body begins from below, and its height, in pixels."""
    require_matplotlib()
    from matplotlib.figure import Figure

    bottom = 2 * _MARGIN + _CAPTION_LINE * len(lines)
    height = bottom + body + 52
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    figure.text(_MARGIN / width, 1 - 28 / height, title, fontsize=13, fontweight="bold", color=INK)
    for i, line in enumerate(lines):
        level = (bottom - _MARGIN - _CAPTION_LINE * (i + 1) + 5) / height
        figure.text(_MARGIN / width, level, line, fontsize=_CAPTION_SIZE, color=INK, parse_math=False)
    return figure, bottom, height


def _rastered(figure: Figure) -> UInt8:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)  # without types in matplotlib
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def require_matplotlib() -> None:
    """GlpathError with the line to type where matplotlib is not installed: asked before the work, not after."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise GlpathError(
            f"matplotlib cannot be imported ({error}); figures are drawn with it.",
            "pip install 'glpath[figures]'",
        ) from error
