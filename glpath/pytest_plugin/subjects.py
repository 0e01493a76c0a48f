"""The subjects of `render_regression`, as pictures."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from glpath.compare import SUFFIXES, Picture, is_pillow, picture_from_bytes, picture_of_pillow, read_picture
from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.io import AnyScene
from glpath.io.from_python import is_made_in_python
from glpath.pytest_plugin.figures import FigureSettings
from glpath.scene import Scene

if TYPE_CHECKING:
    from PIL.Image import Image


class FigureLike(Protocol):
    """A figure of matplotlib."""

    def savefig(self, fname: Any, **options: Any) -> Any: ...


#: A scene, which is rendered; a film; an array; an image of Pillow; a figure; the path or the content of an image
#: file; or a function without parameters that returns one of these.
Subject: TypeAlias = "AnyScene | Film | ArrayLike | bytes | FigureLike | Image | Callable[[], Any]"


#: Objects with such a method are no picture, but have one.
_HINTS = {
    "get_figure": "Of matplotlib's Axes, hand in the figure: axes.figure.",
    "screenshot": "Of PyVista's Plotter, hand in its picture: Plotter(off_screen=True).screenshot().",
    "to_image": "Of Plotly's figure, hand in its picture: figure.to_image(format='png').",
}


def picture_of(
    subject: Any,
    folder: Path,
    device: Mapping[str, Any],
    options: Mapping[str, Any],
    figures: list[Any],
    settings: FigureSettings,
) -> Picture:
    """The picture that a test is about.

    folder  : of the test; files are looked for there, then where the process is
    device  : options of `glpath.render` that every test has
    options : the test's own ones
    figures : matplotlib's figures are added to it, for the caller to close
    settings : how figures are saved

    Raises GlpathError.
    """
    __tracebackhide__ = True
    while callable(subject):
        subject = subject()
    if isinstance(subject, str | Path):
        beside = folder / subject
        subject = beside if os.path.isfile(beside) else subject
    is_file = isinstance(subject, str | Path) and Path(subject).suffix.lower() in SUFFIXES
    if not is_file and (isinstance(subject, str | Path | Scene) or is_made_in_python(subject)):
        from glpath.rendering import render

        subject = render(subject, **{**device, **options})
    elif options:
        raise UsageError(
            f"render_regression: {', '.join(options)}: options of a render, but this is a picture already.",
            "Render with them, or hand in the scene.",
        )
    if isinstance(subject, Film):
        return Picture.of_film(subject)
    if is_file:
        return read_picture(subject)
    if isinstance(subject, io.BytesIO):
        subject = subject.getvalue()
    if isinstance(subject, bytes | bytearray):
        return picture_from_bytes(bytes(subject))
    if is_pillow(subject):
        return picture_of_pillow(subject)
    if callable(getattr(subject, "savefig", None)):
        figures.append(getattr(subject, "figure", subject))
        return picture_from_bytes(settings.saved(subject))  # of matplotlib, or what saves itself like one
    return Picture.of_array(_as_array(subject))


def close_figures(figures: list[Any]) -> None:
    """Close what pyplot would keep, and warn of after twenty tests."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        for figure in figures:
            pyplot.close(figure)
    figures.clear()


def _has(subject: object, name: str) -> bool:
    """Whether it has a method, or is several, as of plt.subplots(2, 2), of which the first has."""
    first = subject.flat[0] if isinstance(subject, np.ndarray) and subject.size else subject
    return callable(getattr(first, name, None))


def _as_array(subject: object) -> ArrayLike:
    try:
        array = np.asarray(subject)
    except (ValueError, TypeError):
        array = None
    if array is None or array.dtype.kind not in "biuf":
        raise UsageError(
            f"render_regression: found {type(subject).__name__}, expected a scene, a Film, an array, an image or "
            "its file, a figure, or a function that returns one of these.",
            next((hint for name, hint in _HINTS.items() if _has(subject, name)), ""),
        )
    return array
