"""Charts as images: pages with title, map or plot, and caption; and values over a plane in false colours.

matplotlib is in the `figures` extra. It is imported only inside functions, with the Agg canvas, so that no display
is needed. The colours can be distinguished by colour-blind readers (Okabe and Ito 2008).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, UsageError
from glpath.system.private_interfaces import import_matplotlib_with_defaults
from glpath.system.time_limit import in_command, named_work

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UInt8 = NDArray[np.uint8]

BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
INK, GREY, PALE = "#222222", "#6E6E6E", "#E4E4E4"

#: Name of matplotlib's colour map for false colours.
COLOUR_MAP = "viridis"

DPI = 100
# Font size of captions, points.
_CAPTION_SIZE = 10.5
# Line height of captions, pixels.
_CAPTION_LINE = 19
MARGIN = 16
# Length of a map's longer side, pixels.
_LONGER = 480


@contextmanager
def _default_settings() -> Iterator[None]:
    """Context with matplotlib's defaults, so that a `matplotlibrc` in the current folder has no effect."""
    require_matplotlib()
    import matplotlib.style

    with matplotlib.style.context("default"):
        yield


@_default_settings()
def field(
    title: str,
    caption: str,
    values: NDArray[np.float64],
    extent: tuple[float, float, float, float],
    labels: tuple[str, str],
    unit: str,
) -> UInt8:
    """Return a page that shows values over a plane as a false-colour map, with colour scale and contour lines.

    values : (rows, columns), the lowest row first; NaN for missing values, which are drawn grey
    extent : left, right, lower and upper edge of the map, in the coordinates of the axes
    labels : labels of the horizontal and of the vertical axis
    unit   : unit of the values

    Colours are those of `colour_range`. Raises UsageError for infinite values.
    """
    from matplotlib.ticker import MaxNLocator

    first, last = colour_range(values)
    left_of_map, right_of_map, below_map = 78, 110, 52
    wide, high = extent[1] - extent[0], extent[3] - extent[2]
    # A narrow strip is drawn wide enough to be read.
    across, up = (max(160, round(_LONGER * side / max(wide, high))) for side in (wide, high))
    width = max(left_of_map + across + right_of_map, 420)
    figure, bottom, height = page(title, wrapped(caption, width), width, up + below_map + 8)
    below = (bottom + below_map) / height
    axes = figure.add_axes((left_of_map / width, below, across / width, up / height))
    axes.set_facecolor(GREY)
    drawn = axes.imshow(
        values, origin="lower", extent=extent, cmap=COLOUR_MAP, vmin=first, vmax=last if last > first else 1.0,
        aspect="auto",
    )  # fmt: skip
    rows, columns = values.shape
    given = values[~np.isnan(values)]
    if min(rows, columns) >= 3 and given.size and given.min() < given.max():
        x = extent[0] + (np.arange(columns) + 0.5) * wide / columns
        y = extent[2] + (np.arange(rows) + 0.5) * high / rows
        levels = MaxNLocator(6).tick_values(first, last)[1:-1]  # the outermost ones enclose all values
        lines = axes.contour(x, y, values, levels=levels, colors="white", linewidths=0.8)
        axes.clabel(lines, fontsize=8, fmt="%g")
    axes.set_xlabel(labels[0], color=INK, fontsize=11)
    axes.set_ylabel(labels[1], color=INK, fontsize=11)
    legend = figure.add_axes(((left_of_map + across + 16) / width, below, 16 / width, up / height))
    figure.colorbar(drawn, cax=legend)
    legend.set_ylabel(unit, color=INK, fontsize=11)
    for each in (axes, legend):
        each.tick_params(colors=INK, labelsize=10, length=4)
    return rastered(figure)


def colour_range(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the values of the first and the last false colour: the smallest range that has all values and 0.

    Raises UsageError for infinite values.
    """
    infinite = int(np.count_nonzero(np.isinf(values)))
    if infinite:
        raise UsageError(
            f"{infinite:,} of {np.size(values):,} values are infinite, and have no false colour.",
            "Replace them by NaN, which is grey.",
        )
    known = values[~np.isnan(values)]
    return float(known.min(initial=0.0)), float(known.max(initial=0.0))


def false_colours(values: NDArray[np.float64], ends: tuple[float, float]) -> NDArray[np.float64]:
    """Return (..., 3) display colours from 0 to 1 for values (...), with the colour map of `field`; NaN is grey.

    ends : values of the first and the last colour, see `colour_range`; equal values get the first colour
    """
    require_matplotlib()
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    bottom, top = ends
    shares = (np.nan_to_num(values, nan=bottom) - bottom) / (top - bottom or 1.0)
    colours = np.asarray(colormaps[COLOUR_MAP](shares), np.float64)[..., :3]
    return np.where(np.isnan(values)[..., None], to_rgb(GREY), colours)


def wrapped(caption: str, width: int) -> list[str]:
    """Split a caption into lines that fit on a page of `width` pixels."""
    require_matplotlib()
    from matplotlib.backends import backend_agg
    from matplotlib.font_manager import FontProperties

    agg: Any = backend_agg  # matplotlib has no type annotations for it
    font, canvas = FontProperties(size=_CAPTION_SIZE), agg.RendererAgg(1, 1, DPI)
    room = width - 2 * MARGIN

    def fits(line: str) -> bool:
        return bool(canvas.get_text_width_height_descent(line, font, ismath=False)[0] <= room)

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


def page(title: str, lines: Sequence[str], width: int, body: int) -> tuple[Figure, int, int]:
    """Return a white page with title and caption, the lower edge of its body, and its height (pixels)."""
    require_matplotlib()
    from matplotlib.figure import Figure

    bottom = 2 * MARGIN + _CAPTION_LINE * len(lines)
    height = bottom + body + 52
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    figure.text(MARGIN / width, 1 - 28 / height, title, fontsize=13, fontweight="bold", color=INK)
    for i, line in enumerate(lines):
        level = (bottom - MARGIN - _CAPTION_LINE * (i + 1) + 5) / height
        figure.text(MARGIN / width, level, line, fontsize=_CAPTION_SIZE, color=INK, parse_math=False)
    return figure, bottom, height


def rastered(figure: Figure) -> UInt8:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)  # matplotlib has no type annotations for it
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def require_matplotlib() -> None:
    """Raise GlpathError with the install command if matplotlib is missing; call it before the work starts.

    In the command, this function also imports matplotlib without settings files. A Python caller may want them for
    figures of his own.
    """
    try:
        with named_work("loading matplotlib"):
            if in_command():
                import_matplotlib_with_defaults()
            import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise GlpathError(
            f"matplotlib cannot be imported ({error}); figures are drawn with it.",
            "pip install 'glpath[figures]'",
        ) from error
