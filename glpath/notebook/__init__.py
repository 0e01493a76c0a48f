"""Notebook widgets: a scene that can be rotated with the mouse, and a viewer of shafts.

    from glpath.notebook import explore_shafts, view
    view("three-spheres")
    explore_shafts("office")  # and `ShaftScene`, which draws the same without widgets

Films and scenes show themselves without this module, and `glpath.render(..., progress=True)` shows an image while
it converges. This module needs the extra: `pip install "glpath[jupyter]"`.
"""

from __future__ import annotations

from glpath.errors import GlpathError

try:
    import ipywidgets  # noqa: F401
    import jupyter_rfb  # noqa: F401
except ImportError as missing:
    raise GlpathError(
        f"glpath.notebook: {missing.name} is not installed, and the browser is reached by it.",
        'pip install "glpath[jupyter]"',
    ) from None

from glpath.notebook.shaft_scene import ShaftExplorer, ShaftScene, explore_shafts
from glpath.notebook.view import View, view

__all__ = ["ShaftExplorer", "ShaftScene", "View", "explore_shafts", "view"]
