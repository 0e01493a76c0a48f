"""A frame of the ray tracer for the figures of [TB]: its picture, time and counts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import seconds_of
from glpath.film.tonemap import tonemap
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.whitted import WhittedTracer
from glpath.integrators.whitted_settings import ClassicSettings, Shadows, TBufferSettings
from glpath.io import load_scene
from glpath.scene import Scene


@dataclass(frozen=True)
class Setup:
    """A configuration to compare: algorithm, source of shadows, rows of the shadow-buffer, and depth.

    Shadow-buffers are not filtered, and are looked up by the paper's rule, object identity, which is exact for
    spheres. Reflections and shadow rays use the classical algorithm, as in the paper.
    """

    primary: Literal["classic", "t-buffer"]
    shadows: Shadows = "rays"
    rows: int = 400
    max_depth: int = 1


CLASSIC = Setup("classic")
T_BUFFER = Setup("t-buffer")

# A pixel differs if a channel of its 8-bit sRGB value differs by more than this.
VISIBLE = 2


def scaled(number: int, scale: float, least: int) -> int:
    """Return a size at this scale, but at least `least`."""
    return max(least, round(number * scale))


def size_at(scale: float, of: tuple[int, int]) -> tuple[int, int]:
    """Return a viewport at this scale."""
    return scaled(of[0], scale, 16), scaled(of[1], scale, 12)


def stacked(objects: int, size: tuple[int, int]) -> Scene:
    """Return the scene of the paper's tests with this many spheres."""
    width, height = size
    parameters = {"objects": objects, "kind": "sphere", "resolution": height, "aspect": width / height}
    return load_scene("stacked", parameters)


def differing(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the fraction of pixels that look different in two pictures of radiance (H, W, 3)."""
    difference = np.abs(tonemap(a).astype(int) - tonemap(b).astype(int)).max(axis=-1)
    return float((difference > VISIBLE).mean())


class WhittedFrame:
    """A scene and a setup, rendered with one ray through the centre of each pixel."""

    def __init__(self, scene: Scene, setup: Setup) -> None:
        self._context = get_context()
        self._objects = DeviceScene(self._context.gl, scene)
        self._window = (0, 0, *scene.camera.resolution)
        kind = TBufferSettings if setup.primary == "t-buffer" else ClassicSettings
        self._settings = kind(
            max_depth=setup.max_depth,
            shadows=setup.shadows,
            shadow_resolution=setup.rows,
            shadow_test="identity",
            shadow_filter=1,
            secondary="classic",
        )

    def _tracer(self, count_tests: bool) -> WhittedTracer:
        return WhittedTracer(
            self._context.gl,
            self._objects,
            replace(self._settings, count_tests=count_tests),
            self._window,
        ).prepare()

    @cached_property
    def _counted(self) -> tuple[NDArray[np.float64], dict[str, int], NDArray[np.int32]]:
        tracer = self._tracer(count_tests=True)
        tracer.trace_path_set(0)
        radiance = tracer.take()
        tests = tracer.statistics()["intersection_tests"]
        assert isinstance(tests, dict)
        return radiance, tests, tracer.eye_buffer.read()[0]

    def image(self) -> NDArray[np.float64]:
        """Return (H, W, 3) radiance."""
        return self._counted[0]

    def nearest(self) -> NDArray[np.int32]:
        """Return (H, W) primitives that the pixels see, -1 for none."""
        return self._counted[2]

    def tests(self) -> dict[str, int]:
        """Return the intersection tests of a frame: primary, shadow_buffer (to fill it), shadow, secondary."""
        return self._counted[1]

    def shadow_entries(self) -> int:
        """Return the number of entries of the light's shadow-buffer that hold an object."""
        buffer = self._timed.shadow_buffer
        assert buffer is not None, "a setup without shadow-buffers"
        return int((buffer.read().primitive >= 0).sum())

    @cached_property
    def _timed(self) -> WhittedTracer:
        tracer = self._tracer(count_tests=False)
        tracer.trace_path_set(0)  # compiles the remaining shaders
        return tracer

    def seconds(self) -> float:
        """Return the wall time of a frame, including filling its shadow-buffers, without counters."""
        tracer = self._timed
        if tracer.shadow_buffer is not None:
            tracer.shadow_buffer.forget()
        return seconds_of(lambda: tracer.trace_path_set(0), self._context.gl.finish)
