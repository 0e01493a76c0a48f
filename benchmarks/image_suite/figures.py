"""Figures by matplotlib, each of which a change of the code may alter in a different way."""

from __future__ import annotations

import os
from collections.abc import Callable

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

#: If this environment variable is set, every figure has its change.
CHANGED = "IMAGE_SUITE_CHANGED"

#: Number of figures with different data for each change.
COPIES = 2


def _unchanged(figure: Figure) -> None:
    pass


def _curve_removed(figure: Figure) -> None:
    figure.axes[0].lines[1].remove()


def _colour(figure: Figure) -> None:
    figure.axes[0].lines[0].set_color("purple")


def _curve_moved(figure: Figure) -> None:
    line = figure.axes[0].lines[0]
    line.set_ydata(np.asarray(line.get_ydata()) + 0.02)  # two pixels


def _thicker(figure: Figure) -> None:
    figure.axes[0].lines[0].set_linewidth(1.5)


def _title(figure: Figure) -> None:
    figure.axes[0].set_title("amplitudes")


def _limits(figure: Figure) -> None:
    figure.axes[0].set_xlim(0, 6.4)


def _size(figure: Figure) -> None:
    figure.set_size_inches(6.4, 5.0)


def _marker_removed(figure: Figure) -> None:
    points = figure.axes[0].collections[0]
    points.set_offsets(np.asarray(points.get_offsets())[1:])


def _area_tinted(figure: Figure) -> None:
    figure.axes[0].axvspan(2.0, 3.0, color="grey", alpha=0.02, zorder=0)


def _one_level(figure: Figure) -> None:
    red, green, blue, opacity = to_rgba(figure.get_facecolor())
    level = 1 / 255
    figure.set_facecolor((red - level, green - level, blue - level, opacity))


#: Functions that make the changes, by name.
CHANGES: dict[str, Callable[[Figure], None]] = {
    "nothing": _unchanged,
    "background-by-one-level": _one_level,
    "curve-removed": _curve_removed,
    "colour-of-a-curve": _colour,
    "curve-moved-by-two-pixels": _curve_moved,
    "curve-half-thicker": _thicker,
    "title": _title,
    "limits-of-an-axis": _limits,
    "size": _size,
    "marker-removed": _marker_removed,
    "area-tinted": _area_tinted,
}

#: Invisible changes, with which a test should pass.
UNSEEN = ("nothing", "background-by-one-level")

#: Parameters of the tests.
CASES = [(change, copy) for change in CHANGES for copy in range(COPIES)]


def figure_of(change: str, copy: int) -> Figure:
    """Return a figure with two curves and some points, with its change if the environment asks for that."""
    rng = np.random.default_rng(copy)
    x = np.linspace(0, 6, 100)
    figure, axes = plt.subplots(figsize=(6.4, 4.8))
    axes.plot(x, np.sin(x + copy))
    axes.plot(x, 0.5 * np.cos(2 * x + copy))
    axes.scatter(rng.uniform(0, 6, 40), rng.uniform(-1, 1, 40), s=30, c="black")
    axes.set(title="amplitude", xlabel="time, s", xlim=(0, 6), ylim=(-1.2, 1.2))
    if CHANGED in os.environ:
        CHANGES[change](figure)
    return figure
