"""Detection of notebooks, in which glpath has to behave differently than in a program."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


def in_notebook() -> bool:
    """Return True in a notebook kernel, which can show images, and whose exit would lose the user's data."""
    return _kernel() is not None


def in_cell() -> bool:
    """Return True if a notebook cell runs in this thread. A widget's callback may run between cells."""
    return running_cell() is not None


def running_cell() -> str | None:
    """Return the id of the cell that runs in this thread; None if no cell runs."""
    kernel = _kernel()
    header = {} if kernel is None else (kernel.get_parent() or {}).get("header", {})
    return header.get("msg_id") if header.get("msg_type") == "execute_request" else None


def around_cells(before: Callable[[], None], after: Callable[[], None]) -> None:
    """Register functions to call before and after each notebook cell; the current cell gets only `after`."""
    from IPython.core.getipython import get_ipython

    events: Any = get_ipython().events  # type: ignore[union-attr]
    events.register("pre_execute", before)
    events.register("post_execute", after)


def _kernel() -> Any:
    if "ipykernel" not in sys.modules:
        return None
    from IPython.core.getipython import get_ipython

    return getattr(get_ipython(), "kernel", None)
