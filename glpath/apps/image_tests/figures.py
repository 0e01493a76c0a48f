"""Figures of matplotlib: their style during a test, and how they are saved."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

from glpath.errors import UsageError
from glpath.system.arguments import short_repr


@dataclass(frozen=True)
class FigureSettings:
    """Settings for the figures of a test.

    style          : argument of `matplotlib.style.context`: a name, a dictionary, or a list of them; None:
                     unchanged
    backend        : backend of matplotlib while the test runs; None: unchanged
    savefig_kwargs : arguments of `Figure.savefig`
    remove_text    : True to remove titles and tick labels, which differ with other versions of fonts
    """

    style: Any = None
    backend: str | None = None
    savefig_kwargs: Mapping[str, Any] = field(default_factory=dict)
    remove_text: bool = False

    @contextmanager
    def around(self) -> Iterator[None]:
        """Context in which matplotlib uses the style and backend. Raises UsageError if they are not available."""
        if self.style is None and self.backend is None:
            yield
            return
        with ExitStack() as until_done:
            try:
                import matplotlib.pyplot as pyplot
                import matplotlib.style

                if self.backend is not None:
                    before = pyplot.get_backend()
                    until_done.callback(pyplot.switch_backend, before)
                    pyplot.switch_backend(self.backend)
                if self.style is not None:
                    until_done.enter_context(matplotlib.style.context(self.style))
            except (ImportError, OSError, ValueError, TypeError) as error:
                raise UsageError(
                    f"render_regression: style {self.style!r}, backend {self.backend!r}: {error}.",
                    "Give what matplotlib knows: matplotlib.style.available; agg, svg, pdf ...",
                ) from error
            yield

    def saved(self, figure: Any) -> bytes:
        """Return the content of an image file of the figure. With `remove_text`, the figure itself loses texts.

        Raises UsageError if matplotlib does not accept `savefig_kwargs`.
        """
        if self.remove_text:
            without_text(getattr(figure, "figure", figure))
        encoded = io.BytesIO()
        try:
            figure.savefig(encoded, **{"format": "png", **self.savefig_kwargs})
        except Exception as error:  # matplotlib raises any type for wrong arguments
            if not self.savefig_kwargs:
                raise
            raise UsageError(
                f"render_regression: savefig_kwargs {short_repr(dict(self.savefig_kwargs))}: {error}.",
                "Give arguments of matplotlib's Figure.savefig, such as dpi.",
            ) from error
        return encoded.getvalue()


def without_text(figure: Any) -> None:
    """Remove titles and tick labels from a figure of matplotlib."""
    from matplotlib.ticker import NullFormatter

    figure.suptitle("")
    for axes in figure.get_axes():
        axes.set_title("")
        for axis in filter(None, (getattr(axes, f"{letter}axis", None) for letter in "xyz")):
            axis.set_major_formatter(NullFormatter())
            axis.set_minor_formatter(NullFormatter())
