"""Combine four images into one; each has every second pixel across and down, and its own path sets.

The paths of a set share their directions and a light sample. The error of a set is therefore smooth over the image,
and a denoiser takes it for image content. If neighbouring pixels belong to different sets, the error becomes noise,
which a denoiser removes.

Cost:    each of the four engines scans the scene, so work per triangle is done four times, work per pixel once.
Source:  Keller & Heidrich 2001, Interleaved Sampling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.film.metadata import merged_values
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.engine import Engine, Window
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.settings import PathSetSettings
from glpath.sampling.points import counter_hash
from glpath.sensors.sensor import CameraSensor, Sensor

# Position of each image's first pixel in the window: pixels to the right, pixels down.
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))


class Interleaved(Engine):
    """Engine made of four engines, each for every second pixel across and down; see `Engine` for other parameters.

    make : constructor of an engine for every second pixel of a window, like `path_engine`
    """

    settings: PathSetSettings

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathSetSettings,
        window: Window,
        *,
        make: Callable[..., PathSetEngine],
        sensor: Sensor | None = None,
        timings: bool = False,
    ) -> None:
        super().__init__(gl, scene, settings, window, sensor or CameraSensor.of(scene.scene.camera), timings)
        self._parts = {
            offset: make(
                gl,
                scene,
                # The first engine keeps the film's seed.
                replace(settings, seed=counter_hash(settings.seed, number, 0, 15) if number else settings.seed),
                window,
                sensor=sensor,
                timings=timings,
                offset=offset,
            )
            for number, offset in enumerate(_OFFSETS)
            if offset[0] < window[2] and offset[1] < window[3]  # a window one pixel wide has no second column
        }

    def prepare(self) -> Self:
        first = self._parts[0, 0].prepare()
        for part in self._parts.values():
            if part is not first:
                part.share(first)
                part.prepare()
        return self

    def close(self) -> None:
        for part in self._parts.values():
            part.close()
        super().close()

    def trace_path_set(self, index: int) -> None:
        for part in self._parts.values():
            part.trace_path_set(index)

    def look_at(self, window: Window) -> None:
        super().look_at(window)
        for part in self._parts.values():
            part.look_at(window)

    def look_from(self, sensor: Sensor) -> None:
        super().look_from(sensor)
        for part in self._parts.values():
            part.look_from(sensor)

    def take(self) -> NDArray[np.float64]:
        return self._joined({offset: part.take() for offset, part in self._parts.items()})

    def take_aovs(self) -> dict[str, NDArray[Any]]:
        taken = {offset: part.take_aovs() for offset, part in self._parts.items()}
        names = next(iter(taken.values()))
        return {name: self._joined({offset: found[name] for offset, found in taken.items()}) for name in names}

    def statistics(self) -> dict[str, object]:
        first, *others = (part.statistics() for part in self._parts.values())
        for found in others:
            first = merged_values(first, found)
        return first

    def forget_statistics(self) -> None:
        for part in self._parts.values():
            part.forget_statistics()

    def _kind_of(self, sensor: Sensor) -> tuple[object, ...]:
        return self._parts[0, 0]._kind_of(sensor)

    def _joined(self, parts: dict[tuple[int, int], NDArray[Any]]) -> NDArray[Any]:
        """Combine arrays of every second pixel (h, w, K), row 0 at the top, into one array."""
        first = parts[0, 0]
        width, height = self._size
        whole = np.empty((height, width, *first.shape[2:]), first.dtype)
        for (right, down), array in parts.items():
            whole[down::2, right::2] = array
        return whole
