"""Images of widgets for pages without a kernel, and display of errors that would be lost."""

from __future__ import annotations

import base64
import html
import traceback
from typing import Any

from glpath.errors import GlpathError
from glpath.film.image import png_html


def with_picture(bundle: Any, png: bytes, text: str) -> Any:
    """Return a widget's mimebundle (data, or data and metadata) with an image added for pages without a kernel."""
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    alt = text.strip("<>")
    data |= {"text/plain": text, "image/png": base64.b64encode(png).decode(), "text/html": png_html(png, alt)}
    return bundle


def message_html(*lines: str, wrong: bool = False) -> str:
    """Return lines of text for an `ipywidgets.HTML`, in the error colour if `wrong`."""
    colour = "; color: var(--jp-error-color1, #d32f2f)" if wrong else ""
    text = "<br>".join(html.escape(line) for line in lines if line)
    return f'<div style="white-space: pre-wrap; line-height: 1.3{colour}">{text}</div>'


def error_html(error: Exception) -> str:
    """Return the message and remedy of a user's error, or the traceback of an internal error."""
    if isinstance(error, GlpathError):
        return message_html(error.message, error.remedy, wrong=True)
    return message_html("".join(traceback.format_exception(error)), wrong=True)
