"""Base class of every integrator's engine: create, prepare, trace path sets into exact sums, and close."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.gl.constants import DROPPED_SHIFT
from glpath.gl.context import context_of
from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.passes import Stopwatch
from glpath.gl.sums import PixelSums, Readback
from glpath.integrators.aovs import EyeAovs, light_aovs
from glpath.integrators.settings import IntegratorSettings
from glpath.sampling.points import PathSetSampler
from glpath.sensors.sensor import Sensor

Uniforms = dict[str, object]
Window = tuple[int, int, int, int]


class Engine(Owner, ABC):
    """Base class of engines, which trace path sets of one window of the image.

    Constructors store their arguments; `prepare` allocates on the device, before all other calls. Subclasses define
    `prepare` and `trace_path_set`.

    Parameters
    ----------
    window   : (x, y, width, height) in pixels of the whole image, y from the top; at most 2**20 pixels
    sensor   : start points of the paths
    timings  : True to measure the time of each stage, which takes some time itself
    """

    _sampler: PathSetSampler  # `prepare` creates `_sampler`, `_sums` and `_aovs`
    _sums: PixelSums
    _aovs: EyeAovs | None

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: IntegratorSettings,
        window: Window,
        sensor: Sensor,
        timings: bool,
    ) -> None:
        self.gl = gl
        self.scene = scene
        self.settings = settings
        self.window = window
        self.sensor: Sensor = sensor
        self.stopwatch = Stopwatch(gl, context_of(gl).info.hardware, timings)
        self._size = window[2:]
        self._dropped = 0
        self._aov_sums: dict[str, NDArray[Any]] = {}

    @abstractmethod
    def prepare(self) -> Self:
        """Allocate on the device and return the engine. Raises SceneError if the device has no room."""

    @abstractmethod
    def trace_path_set(self, index: int) -> None:
        """Add one sample to every pixel, determined by the index alone."""

    def look_at(self, window: Window) -> None:
        """Switch to another window of the same size."""
        assert window[2:] == self.window[2:], f"a window of {window[2:]}, made for {self.window[2:]}"
        self.window = window

    def look_from(self, sensor: Sensor) -> None:
        """Start paths at another sensor of the same resolution. Raises UsageError if its `_kind_of` differs."""
        assert sensor.resolution == self.sensor.resolution, f"a sensor of {sensor.resolution} pixels"
        _check_same_kind(self._kind_of(self.sensor), self._kind_of(sensor))
        self.sensor = sensor

    def take(self) -> NDArray[np.float64]:
        """Return the sum of radiance over the path sets since the last call, (h, w, 3), row 0 at the top.

        Values are multiples of one power of two, so float64 adds them without rounding.
        """
        readback = self._sums.take()
        dropped = readback.high >> DROPPED_SHIFT
        self._dropped += int(dropped.sum())
        self._aov_sums = light_aovs(self.settings, self._sums, dropped)
        self._count(readback)
        return readback.radiance

    def take_aovs(self) -> dict[str, NDArray[Any]]:
        """Return the sums of the AOVs for `Film.add`, over the path sets of the last `take`."""
        return self._aov_sums if self._aovs is None else self._aov_sums | self._aovs.take()

    def statistics(self) -> dict[str, object]:
        """Return counts of the path sets taken so far.

        dropped_samples : number of samples that were not finite and count as 0
        stage_ms        : milliseconds by stage, if timed
        """
        counts: dict[str, object] = {"dropped_samples": self._dropped}
        if self.stopwatch.enabled:
            counts["stage_ms"] = dict(self.stopwatch.milliseconds)
        return counts

    def forget_statistics(self) -> None:
        """Reset the counts."""
        self._dropped = 0
        self.stopwatch.milliseconds.clear()

    # Helpers for subclasses.

    def _add_aovs(self, eye: Uniforms) -> None:
        if self._aovs is not None:
            with self.stopwatch.stage("AOVs"):
                self._aovs.add(eye)

    def _count(self, readback: Readback) -> None:
        """Add the counts that an engine's shaders sum together with radiance; by default there are none."""

    def _kind_of(self, sensor: Sensor) -> tuple[object, ...]:
        """Return the properties of a sensor for which programs and passes are made.

        A sensor of equal ones can use them.
        """
        return (*sensor.kind, None)


def _check_same_kind(made_for: tuple[object, ...], found: tuple[object, ...]) -> None:
    """Raise UsageError for a camera of another kind (projection, whether it has a lens, whether it moves)."""
    if made_for != found:
        raise UsageError(
            f"render_frames: a frame's camera is {_kind_in_words(found)}, after one that is "
            f"{_kind_in_words(made_for)}",
            "All frames have one kind of camera: render the others by themselves.",
        )


def _kind_in_words(kind: tuple[object, ...]) -> str:
    if kind[0] == "points":
        return "points"
    projection, lens, moves, shutter = kind
    text = f"{projection}{' with a lens' if lens else ''}{', moving' if moves else ''}"
    return text if shutter is None else f"{text}, with a shutter of {shutter}"
