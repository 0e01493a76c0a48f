"""One frame of the ray tracer, to look at, to time and to count: what the figures of TB compare."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath import rendering
from glpath.film import Film
from glpath.scene import Scene


@dataclass(frozen=True)
class Setup:
    """What is compared: the algorithm, where shadows come from, rows of the shadow-buffer, and the depth."""

    integrator: Literal["classic", "t-buffer"]
    shadows: Literal["rays", "sphere", "cube"] = "rays"
    rows: int = 400
    max_depth: int = 1


class WhittedFrame:
    """A scene rendered by one setup."""

    def __init__(self, scene: Scene, setup: Setup) -> None:
        self._scene, self._setup = scene, setup

    def _render(self, **more: Any) -> Film:
        s = self._setup
        return rendering.render(
            self._scene,
            spp=1,
            integrator=s.integrator,
            shadows=s.shadows,
            shadow_resolution=s.rows,
            max_depth=s.max_depth,
            **more,
        )

    @cached_property
    def _counted(self) -> Film:
        return self._render(count_tests=True)

    def image(self) -> NDArray[np.float64]:
        """Radiance (H, W, 3), one ray for each pixel."""
        return self._counted.mean

    def tests(self) -> dict[str, int]:
        """Intersection tests of a frame: primary, shadow_buffer (to fill it), shadow, secondary."""
        counts: dict[str, int] = self._counted.metadata.statistics["intersection_tests"]
        return counts

    def seconds(self) -> float:
        """Wall time of a frame, with the filling of its shadow-buffers."""
        start = time.perf_counter()
        self._render()
        return time.perf_counter() - start
