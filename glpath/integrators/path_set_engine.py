"""What all engines of path sets have: a window of the image, where paths start in it, and exact sums."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.gl.camera import (
    CENTRE,
    ahead_of,
    camera_defines,
    eye_centre,
    eye_uniforms,
    lens_uniforms,
    view_volume,
)
from glpath.gl.constants import DROPPED_SHIFT
from glpath.gl.device_scene import DeviceScene
from glpath.gl.geometry_stream import StreamedScan, before_planes
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass, Stopwatch
from glpath.gl.program import load_program
from glpath.gl.ray_bvh import RayBvh, ray_bvh_glsl
from glpath.gl.sums import PixelSums
from glpath.integrators.aovs import EyeAovs, Seen, light_aovs
from glpath.integrators.settings import PathSetSettings
from glpath.integrators.start_points import StartPoints
from glpath.lights.lighting import Lighting
from glpath.sampling.points import PathSetSampler, counter_hash
from glpath.scene.model import Camera
from glpath.sensors.sensor import CameraSensor, PointSensor, Sensor

Uniforms = dict[str, object]


class PathSetEngine(Owner, ABC):
    """The path sets of one window of the image; whoever derives from it writes `trace_path_set`.

    Parameters
    ----------
    window    : (x, y, width, height) in pixels of the whole image, y from the top; at most 2**20 pixels
    sensor    : where paths start; the scene's camera, where it is not given
    max_radiance : what a path may bring home besides emission, for the quantum of the sums
    lighting  : what path sets are lit by; the scene's, where it is not given

    own_lens : of an engine: every pixel has a point of a camera's lens of its own, not one for all of a path set
    """

    own_lens: ClassVar[bool] = False
    _sampler: PathSetSampler  # set by the subclass

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathSetSettings,
        window: tuple[int, int, int, int],
        *,
        sensor: Sensor | None = None,
        max_radiance: float,
        lighting: Lighting | None = None,
        hardware: bool,
        timings: bool = False,
    ) -> None:
        self.gl = gl
        self.scene = scene
        self._settings = settings
        self.sensor: Sensor = sensor or CameraSensor.of(scene.scene.camera)
        self._kind = self._kind_of(self.sensor)
        self._eye_defines = camera_defines(scene.scene.camera, self.own_lens)
        self.window = window
        self.lighting = lighting or scene.lighting
        self.stopwatch = Stopwatch(gl, hardware, timings)
        self._counts = np.zeros(3, np.int64)  # rays cast, lost, samples dropped
        self._size = size = window[2:]
        self._sum = 0  # which of the two sets of sums holds the present ones
        self._sums = PixelSums(gl, size, max(scene.max_radiance, max_radiance), split=settings.splits_light)
        self._taken_aovs: dict[str, NDArray[Any]] = {}
        self._eye_buffer = self._texture(size, 1, "u4")
        self._bvh: RayBvh | None = None  # where rays are cast
        self._met: dict[str, moderngl.Texture] = {}  # records of streamed triangles, where the scene has such
        self._eye_of: object = None  # sensor and window of `_eye`, what is told of the camera for all path sets
        self._eye: Uniforms = {}
        self._camera = scene.scene.camera
        self._eye_constant: Uniforms = scene.uniforms
        self._points: StartPoints | None = None
        self._eye_stream: StreamedScan | None = None
        if isinstance(self.sensor, PointSensor):
            self._bvh = RayBvh(gl, scene)
            self._points = StartPoints(gl, scene, self.sensor, self._bvh, size, self._eye_buffer)
            self._eye_defines = self._points.defines
        else:
            self._see_by_scan()
        self._aovs = EyeAovs.of(settings.aovs, Seen(scene, self._eye_buffer, self._eye_defines, self._met))
        self._prepare()
        if scene.stream is not None:
            scene.stream.reserve()

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

    def look_from(self, sensor: Sensor) -> None:
        """Start paths at another sensor of the same resolution. Raises UsageError for one of another kind."""
        assert sensor.resolution == self.sensor.resolution, f"a sensor of {sensor.resolution} pixels"
        check_same_kind(self._kind, self._kind_of(sensor))
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
        """(h, w) number of the triangle that each pixel sees in the last path set, -1 for none; row 0: top.

        Of points, the triangle that each lies on.
        """
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

    def move_to(self, index: int) -> None:
        """Put what moves where it is at the time of a path set; the eye goes by its own uniforms."""
        moving = self.scene.moving
        if moving is None:
            return
        with self.stopwatch.stage("motion"):
            time = self._sampler.time(index, self.sensor.shutter)
            self.scene.move_to(time)
            if self._bvh is not None:
                self._bvh.move_to(moving.corners())
            if moving.lamps:
                # The chances of lights stay, or they would not be those that emission is weighed by.
                self.lighting = replace(self.lighting, scene=moving.at(time))

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
        if self._points is not None:
            self._points.find(eye)
            return
        self._eye_pass.run(self._eye_constant | eye)
        if self._eye_stream is not None:
            stream = self.scene.stream
            assert stream is not None, "who streams"
            normals, offsets = view_volume(self._camera, eye)
            seen = before_planes(stream.lower, stream.upper, normals, offsets)
            self._eye_stream.run(self._eye_constant | eye, seen)

    def _eye_uniforms(self, pixel: NDArray[np.float64], index: int = 0) -> Uniforms:
        """What the eye's rays, or points, need: their place in each pixel, and of which path set they are."""
        seed, place = self._settings.seed, (float(pixel[0]), float(pixel[1]))
        own = {"opacity_seed": counter_hash(seed, index, 0, 12)}
        if self._points is not None:
            assert isinstance(self.sensor, PointSensor), "of the same kind"
            return self._points.at(self.sensor, self.window, place[0]) | own
        assert isinstance(self.sensor, CameraSensor), "of the same kind"
        of = (self.sensor, self.window)
        if self._eye_of != of:
            self._eye_of, self._camera = of, self.sensor.camera
            self._eye = self._seen_by(self._camera.at())
        camera = self._camera
        if not (camera.moves or camera.aperture_radius > 0):
            return self._eye | own | {"eye_centre": eye_centre(self.sensor.resolution, place)}
        lens = self._sampler.eye(index)[:2]
        camera = camera.at(self._sampler.time(index, self.sensor.shutter))
        if self.own_lens:
            return self._seen_by(camera, place) | own | lens_uniforms(camera, lens, counter_hash(seed, 14))
        return self._seen_by(camera, place, lens) | own

    def _seen_by(
        self,
        camera: Camera,
        pixel: tuple[float, float] = CENTRE,
        lens: NDArray[np.float64] | None = None,
    ) -> Uniforms:
        ahead = ahead_of(camera, self.scene.centre, self.scene.radius)
        eye = eye_uniforms(camera, self.window, pixel, lens, ahead)
        position = np.asarray(eye["eye_position"])
        extent = float(np.linalg.norm(self.scene.centre - position)) + self.scene.radius
        return eye | {"eye_range": (1e-5 * self.scene.radius, 1.01 * extent)}

    def _kind_of(self, sensor: Sensor) -> tuple[object, ...]:
        """What programs and passes are made for."""
        moving = self.scene.moving is not None
        return (*sensor.kind, sensor.shutter if moving else None)

    def _see_by_scan(self) -> None:
        """See by a scan conversion of the scene."""
        gl, scene, size = self.gl, self.scene, self._size
        self._eye_pass = Pass(
            "eye",
            gl,
            load_program(
                gl,
                vertex="camera/eye.vert",
                fragment="camera/eye.frag",
                generated=scene.generated,
                defines=scene.defines | self._eye_defines,
            ),
            gl.framebuffer([self._eye_buffer], gl.depth_texture(size)),
            triangles=scene.triangles,
            depth=True,
            clear=(0.0, 0.0, 0.0, 0.0),
            textures=scene.textures,
        )
        if scene.stream is not None:
            # Of what eye rays and then paths have met.
            self._met_records = scene.stream.records(size)
            self._eye_stream = StreamedScan(
                "eye",
                scene.stream,
                vertex="camera/eye.vert",
                fragment="camera/eye.frag",
                generated=scene.generated,
                defines=scene.defines,
                textures=scene.textures,
                target=self._eye_pass.target,
                depth=True,
                records=self._met_records,
                seen=self._eye_buffer,
            )
            self._met = {"met_records": self._met_records}

    def _look_by_rays(self) -> None:
        """See by eye rays from now on, not by scan conversion, of one eye for all pixels and no panorama."""
        gl, scene = self.gl, self.scene
        bvh = self._bvh = self._bvh or RayBvh(gl, scene)
        program = load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="camera/eye_rays.frag",
            generated={**scene.generated, "RAY_BVH": ray_bvh_glsl()},
            defines=scene.defines | self._eye_defines,
        )
        target = gl.framebuffer([self._eye_buffer])
        self._eye_pass = Pass("eye", gl, program, target, textures={**scene.textures, **bvh.textures})
        self._eye_constant = {**scene.uniforms, **bvh.uniforms}

    def _image_window(self) -> tuple[int, int, int, int]:
        """x, y of the window's lower left pixel in the image, and the image's size."""
        width, height = self.sensor.resolution
        x, y, _, h = self.window
        return x, height - y - h, width, height

    def _texture(self, size: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
        texture = self.gl.texture(size, components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture


def check_same_kind(made_for: tuple[object, ...], found: tuple[object, ...]) -> None:
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
    told = f"{projection}{' with a lens' if lens else ''}{', moving' if moves else ''}"
    return told if shutter is None else f"{told}, with a shutter of {shutter}"
