"""Whether somebody explores here: what is right for a program can be wrong in a notebook."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


def in_notebook() -> bool:
    """Is this process the kernel of a notebook? It then shows pictures, and its death loses the user's work."""
    return _kernel() is not None


def in_cell() -> bool:
    """Does a cell of a notebook run in this thread? A widget's callback may run between cells."""
    return running_cell() is not None


def running_cell() -> str | None:
    """The id of the running cell in this thread; None where none runs."""
    kernel = _kernel()
    header = {} if kernel is None else (kernel.get_parent() or {}).get("header", {})
    return header.get("msg_id") if header.get("msg_type") == "execute_request" else None


def around_cells(before: Callable[[], None], after: Callable[[], None]) -> None:
    """Call these before and after each cell from now on, `after` for the present one too; in a notebook."""
    from IPython.core.getipython import get_ipython

    events: Any = get_ipython().events  # type: ignore[union-attr]
    events.register("pre_execute", before)
    events.register("post_execute", after)


def _kernel() -> Any:
    if "ipykernel" not in sys.modules:
        return None
    from IPython.core.getipython import get_ipython

    return getattr(get_ipython(), "kernel", None)
