"""What all engines of path sets have: a window of the image, what the eye sees of it, and exact sums."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.camera import eye_centre, eye_uniforms
from glpath.gl.constants import DROPPED_SHIFT
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass, Stopwatch
from glpath.gl.program import load_program
from glpath.gl.sums import PixelSums
from glpath.integrators.aovs import EyeAovs, light_aovs
from glpath.integrators.settings import PathSetSettings
from glpath.lighting import Lighting
from glpath.sampling import counter_hash
from glpath.sensors import CameraSensor

Uniforms = dict[str, object]


class PathSetEngine(ABC):
    """The path sets of one window of the image; whoever derives from it writes `trace_path_set`.

    Parameters
    ----------
    window    : (x, y, width, height) in pixels of the whole image, y from the top; at most 2**20 pixels
    max_radiance : what a path may bring home besides emission, for the quantum of the sums
    lighting  : what path sets are lit by; the scene's, where it is not given
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathSetSettings,
        window: tuple[int, int, int, int],
        *,
        max_radiance: float,
        lighting: Lighting | None = None,
        hardware: bool,
        timings: bool = False,
    ) -> None:
        self.gl = gl
        self.scene = scene
        self._settings = settings
        self.sensor = CameraSensor.of(scene.scene.camera)
        self.window = window
        self.lighting = lighting or scene.lighting
        self.stopwatch = Stopwatch(gl, hardware, timings)
        self._counts = np.zeros(3, np.int64)  # rays cast, lost, samples dropped
        self._size = size = window[2:]
        self._sum = 0  # which of the two sets of sums holds the present ones
        self._sums = PixelSums(gl, size, max(scene.max_radiance, max_radiance), split=settings.splits_light)
        self._taken_aovs: dict[str, NDArray[Any]] = {}
        self._eye_buffer = self._texture(size, 1, "u4")
        self._eye_of: object = None  # sensor and window of `_eye`, what is told of the camera for all path sets
        self._eye: Uniforms = {}
        self._eye_constant: Uniforms = scene.uniforms
        self._eye_pass = Pass(
            "eye",
            gl,
            load_program(
                gl, vertex="eye.vert", fragment="eye.frag", generated=scene.generated, defines=scene.defines
            ),
            gl.framebuffer([self._eye_buffer], gl.depth_texture(size)),
            triangles=scene.triangles,
            depth=True,
            clear=(0.0, 0.0, 0.0, 0.0),
            textures=scene.textures,
        )
        self._aovs = EyeAovs.of(gl, scene, settings.aovs, size, self._eye_buffer)
        self._prepare()

    @abstractmethod
    def _prepare(self) -> None:
        """Make what the engine needs besides, at the end of the constructor."""

    @abstractmethod
    def trace_path_set(self, index: int) -> None:
        """One path for every pixel; which, the index says alone."""

    def look_at(self, window: tuple[int, int, int, int]) -> None:
        """Go on with another window of the same size."""
        assert window[2:] == self._size, f"a window of {window[2:]}, made for {self._size}"
        self.window = window

    def look_from(self, sensor: CameraSensor) -> None:
        """Start paths at another sensor of the same resolution."""
        assert sensor.resolution == self.sensor.resolution, f"a sensor of {sensor.resolution} pixels"
        self.sensor = sensor

    def forget_statistics(self) -> None:
        """Begin to count anew."""
        self._counts[:] = 0
        self.stopwatch.milliseconds.clear()

    def take(self) -> NDArray[np.float64]:
        """The sum of radiance over the path sets since the last call, (h, w, 3), row 0 at the top.

        Multiples of one power of two, so that float64 adds them without rounding.
        """
        taken = self._sums.take(self._sum)
        lost, dropped = taken.high & ((1 << DROPPED_SHIFT) - 1), taken.high >> DROPPED_SHIFT
        self._taken_aovs = light_aovs(self._settings, self._sums, dropped)
        self._counts += np.array([taken.low.sum(), lost.sum(), dropped.sum()], dtype=np.int64)
        return taken.radiance

    def take_aovs(self) -> dict[str, NDArray[Any]]:
        """What `Film.add` takes of the AOVs that the settings ask for, over the path sets of the last `take`."""
        return self._taken_aovs if self._aovs is None else self._taken_aovs | self._aovs.take()

    def seen(self) -> NDArray[np.int64]:
        """(h, w) number of the triangle that each pixel sees in the last path set, -1 for none; row 0: top."""
        width, height = self._size
        numbers = np.frombuffer(self._eye_buffer.read(), np.uint32).reshape(height, width)
        return numbers[::-1].astype(np.int64) - 1

    def statistics(self) -> dict[str, object]:
        """What was counted in the path sets taken so far.

        paths_cast      : rays of paths, those to lights not counted
        paths_lost      : of these, how many lost the collision in their cell of the path-buffer
        dropped_samples : not finite, and counted as 0
        stage_ms        : milliseconds by stage, where timed
        """
        names = ("paths_cast", "paths_lost", "dropped_samples")
        counts: dict[str, object] = {name: int(n) for name, n in zip(names, self._counts, strict=True)}
        if self.stopwatch.enabled:
            counts["stage_ms"] = dict(self.stopwatch.milliseconds)
        return counts

    # What the frame is made of.

    def _end_path_set(self) -> None:
        """After the last pass of a path set, which wrote the sums."""
        self._sum = 1 - self._sum
        self._sums.add_direct()

    def _see(self, eye: Uniforms) -> None:
        """Which triangle every pixel of the window sees, and the AOVs of what it sees."""
        with self.stopwatch.stage("eye"):
            self._look(eye)
        if self._aovs is not None:
            with self.stopwatch.stage("AOVs"):
                self._aovs.add(eye)

    def _look(self, eye: Uniforms) -> None:
        self._eye_pass.run(self._eye_constant | eye)

    def _eye_uniforms(self, pixel: NDArray[np.float64], index: int = 0) -> Uniforms:
        """What the eye's rays need: their place in each pixel, and of which path set they are."""
        of = (self.sensor, self.window)
        if self._eye_of != of:
            camera = self.sensor.camera
            extent = float(np.linalg.norm(self.scene.centre - camera.position)) + self.scene.radius
            depths = (1e-5 * self.scene.radius, 1.01 * extent)
            self._eye_of, self._eye = of, eye_uniforms(camera, self.window) | {"eye_range": depths}
        return self._eye | {
            "eye_centre": eye_centre(self.sensor.resolution, (float(pixel[0]), float(pixel[1]))),
            "opacity_seed": counter_hash(self._settings.seed, index, 0, 12),
        }

    def _image_window(self) -> tuple[int, int, int, int]:
        """x, y of the window's lower left pixel in the image, and the image's size."""
        width, height = self.sensor.resolution
        x, y, _, h = self.window
        return x, height - y - h, width, height

    def _texture(self, size: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
        texture = self.gl.texture(size, components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture
