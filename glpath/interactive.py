"""Whether somebody explores here: what is right for a program can be wrong in a notebook."""

from __future__ import annotations

import sys


def in_notebook() -> bool:
    """Is this process the kernel of a notebook? It then shows pictures, and its death loses the user's work."""
    if "ipykernel" not in sys.modules:
        return False
    from IPython.core.getipython import get_ipython

    return getattr(get_ipython(), "kernel", None) is not None
