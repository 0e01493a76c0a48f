"""All figures by name: the function that makes each, and a line that describes it."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.figures import (
    model_room,
    models,
    path_buffer_box,
    path_buffer_room,
    scale,
    shaft,
    shaft_table,
    t_buffer_curves,
    t_buffer_pictures,
)
from benchmarks.figures.outcome import Outcome, Say

Make = Callable[[float, Say], Outcome]

FIGURES: dict[str, tuple[Make, str]] = {}
_T_BUFFER = t_buffer_pictures.FIGURES | t_buffer_curves.FIGURES
FIGURES |= {name: _T_BUFFER[name] for name in sorted(_T_BUFFER, key=lambda name: int(name.rsplit("-", 1)[1]))}
FIGURES |= shaft.FIGURES | shaft_table.FIGURES
FIGURES |= path_buffer_box.FIGURES
FIGURES |= path_buffer_room.FIGURES
FIGURES |= scale.FIGURES
FIGURES |= models.FIGURES | model_room.FIGURES
