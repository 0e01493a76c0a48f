"""Conversion of the subjects of `render_regression` to pictures."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from glpath.apps.image_tests.figures import FigureSettings
from glpath.compare import SUFFIXES, Picture, is_pillow, picture_from_bytes, picture_of_pillow, read_picture
from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.io import AnyScene
from glpath.io.from_python import is_made_in_python
from glpath.scene import Scene

if TYPE_CHECKING:
    from PIL.Image import Image


class FigureLike(Protocol):
    """Figure of matplotlib."""

    def savefig(self, fname: Any, **options: Any) -> Any: ...


#: Subject of a comparison: scene, which is rendered; film; array; Pillow image; figure; path or content of an image
#: file; or a function without parameters that returns one of these.
Subject: TypeAlias = "AnyScene | Film | ArrayLike | bytes | FigureLike | Image | Callable[[], Any]"


#: Hints for objects that are not images but can produce one, by name of a method.
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
    """Return the picture of a test's subject.

    folder   : folder of the test, searched for files first, then the current folder
    device   : options of `glpath.render` for every test
    options  : options of `glpath.render` for this test
    figures  : list to which matplotlib figures are added, for the caller to close
    settings : settings for saving figures

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
        return picture_from_bytes(settings.saved(subject))  # matplotlib, or an object with the same method
    return Picture.of_array(_as_array(subject))


def close_figures(figures: list[Any]) -> None:
    """Close figures, because pyplot would keep them and warn after twenty tests."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        for figure in figures:
            pyplot.close(figure)
    figures.clear()


def _has(subject: object, name: str) -> bool:
    """Return True if `subject` has a method `name`.

    For an array, such as from plt.subplots(2, 2), its first element decides.
    """
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
