"""Base class of engines that trace one path per pixel: it starts paths at a camera's eye or at points."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar, Self

import moderngl
import numpy as np
from numpy.typing import NDArray

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
from glpath.gl.geometry_stream import Kept, StreamedScan, before_planes
from glpath.gl.lanes import fragments_of_pixels
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.sums import PixelSums, Readback
from glpath.integrators.aovs import EyeAovs, Seen
from glpath.integrators.engine import Engine, Uniforms, Window
from glpath.integrators.settings import PathSetSettings
from glpath.integrators.start_points import StartPoints
from glpath.lights.lighting import Lighting
from glpath.sampling.points import counter_hash
from glpath.scene.model import Camera
from glpath.sensors.sensor import CameraSensor, PointSensor, Sensor


class PathSetEngine(Engine):
    """Engine with one path for every pixel, or point, in each path set; see `Engine` for other parameters.

    sensor    : start points of the paths; by default the scene's camera
    max_radiance : maximum radiance of a path besides emission, for the quantum of the sums
    lighting  : lights of the path sets; by default the scene's

    own_lens : class attribute, True if each pixel has its own lens point, False if a path set shares one
    """

    own_lens: ClassVar[bool] = False
    settings: PathSetSettings

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathSetSettings,
        window: Window,
        *,
        sensor: Sensor | None,
        max_radiance: float,
        lighting: Lighting | None = None,
        timings: bool,
    ) -> None:
        super().__init__(gl, scene, settings, window, sensor or CameraSensor.of(scene.scene.camera), timings)
        self.lighting = lighting or scene.lighting
        self._max_radiance = max(scene.max_radiance, max_radiance)
        self._eye_defines = camera_defines(scene.scene.camera, self.own_lens)
        self._cast = self._lost = 0  # number of path rays, and of those lost by collision in a cell
        self._bvh: RayBvh | None = None  # None unless rays are cast
        self._hit_textures: dict[str, moderngl.Texture] = {}  # records of streamed triangles
        self._eye_of: object = None  # sensor and window for `_eye`, the camera's uniforms for all path sets
        self._eye: Uniforms = {}
        self._camera = scene.scene.camera
        self._eye_constant: Uniforms = scene.uniforms
        self._points: StartPoints | None = None
        self._eye_stream: StreamedScan | None = None

    def prepare(self) -> Self:
        gl, scene, settings, size = self.gl, self.scene, self.settings, self._size
        order = fragments_of_pixels(size) if self._shares_lanes else None
        self._sums = PixelSums(gl, size, self._max_radiance, split=settings.splits_light, order=order)
        self._eye_buffer = self._texture(size, 1, "u4")
        if isinstance(self.sensor, PointSensor):
            self._bvh = RayBvh(gl, scene)
            self._points = StartPoints(gl, scene, self.sensor, self._bvh, size, self._eye_buffer)
            self._eye_defines = self._points.defines
            if scene.stream is not None:
                self._keep_records()
        elif scene.instances is not None:
            self._look_by_rays()
        else:
            self._see_by_scan()
        seen = Seen(scene, self._eye_buffer, self._eye_defines, self._hit_textures, self._seen_in_mirrors())
        self._aovs = EyeAovs.of(settings.aovs, seen)
        self._prepare_stages()
        if scene.stream is not None:
            scene.stream.reserve()
        return self

    def share(self, other: PathSetEngine, *, solution: bool = True) -> None:
        """Take the BVH, and other data that do not depend on the view, from another engine of the same scene.

        Call it before `prepare`.

        solution : True if both engines have the same radiosity solution
        """
        self._bvh = other._bvh

    def _seen_in_mirrors(self) -> RayBvh | None:
        """Return the BVH for AOVs of surfaces seen in mirrors; None if AOVs describe the mirrors themselves."""
        return None

    @property
    def _shares_lanes(self) -> bool:
        """True if paths are traced in the order of `glpath.gl.lanes`."""
        return False

    @abstractmethod
    def _prepare_stages(self) -> None:
        """Create the resources of an engine's stages, except those of primary visibility."""

    def seen(self) -> NDArray[np.int64]:
        """Return (h, w) index of each pixel's visible triangle in the last path set, -1 for none; row 0 at the top.

        For points, return the triangle that each lies on.
        """
        width, height = self._size
        numbers = np.frombuffer(self._eye_buffer.read(), np.uint32).reshape(height, width)
        return numbers[::-1].astype(np.int64) - 1

    def statistics(self) -> dict[str, object]:
        """Return the counts of every engine, and:

        paths_cast : number of path rays, without shadow rays
        paths_lost : number of path rays that lost the collision in their cell of the path-buffer
        """
        return {"paths_cast": self._cast, "paths_lost": self._lost} | super().statistics()

    def forget_statistics(self) -> None:
        super().forget_statistics()
        self._cast = self._lost = 0

    def _count(self, readback: Readback) -> None:
        self._cast += int(readback.low.sum(dtype=np.int64))
        self._lost += int((readback.high & ((1 << DROPPED_SHIFT) - 1)).sum(dtype=np.int64))

    # Methods that subclasses call in their frames: motion, visible triangles and AOVs.

    def move_to(self, index: int) -> None:
        """Move objects to the time of a path set; the eye's motion is in its own uniforms."""
        moving = self.scene.moving
        if moving is None:
            return
        with self.stopwatch.stage("motion"):
            time = self._sampler.time(index, self.sensor.shutter)
            self.scene.move_to(time)
            if self._bvh is not None:
                self._bvh.move_to(moving.corners())
            if moving.lamps:
                # The probabilities that select lights must equal those that weight hits of emitters.
                self.lighting = replace(self.lighting, scene=moving.at(time))

    def _see(self, eye: Uniforms) -> None:
        """Find the visible triangle of every pixel of the window, and add the AOVs."""
        with self.stopwatch.stage("eye"):
            self._look(eye)
        self._add_aovs(eye)

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
        """Return the uniforms of a path set's eye rays or start points. pixel: position in every pixel, 0 to 1."""
        seed, sample = self.settings.seed, (float(pixel[0]), float(pixel[1]))
        own = {"opacity_seed": counter_hash(seed, 0, 0, 12), "opacity_set": index}
        if self._points is not None:
            assert isinstance(self.sensor, PointSensor), "of the same kind"
            return self._points.at(self.sensor, self.window, sample[0]) | own
        assert isinstance(self.sensor, CameraSensor), "of the same kind"
        of = (self.sensor, self.window)
        if self._eye_of != of:
            self._eye_of, self._camera = of, self.sensor.camera
            self._eye = self._seen_by(self._camera.at())
        camera = self._camera
        if not (camera.moves or camera.aperture_radius > 0):
            return self._eye | own | {"eye_centre": eye_centre(camera, sample)}
        lens = self._sampler.eye(index)[:2]
        camera = camera.at(self._sampler.time(index, self.sensor.shutter))
        if self.own_lens:
            return self._seen_by(camera, sample) | own | lens_uniforms(camera, lens, counter_hash(seed, 14))
        return self._seen_by(camera, sample, lens) | own

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
        """Return the properties of a sensor that programs and passes are made for."""
        moving = self.scene.moving is not None
        return (*sensor.kind, sensor.shutter if moving else None)

    def _see_by_scan(self) -> None:
        """Set up primary visibility by scan conversion."""
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
            self._keep_records()
            self._eye_stream = StreamedScan(
                "eye",
                scene.stream,
                ("camera/eye.vert", "camera/eye.frag"),
                ProgramParts.of(scene),
                self._eye_pass.target,
                depth=True,
                kept=Kept(self._hit_textures["hit_records"], self._eye_buffer),
            )

    def _keep_records(self) -> None:
        """Create the records of streamed triangles, for the hits of eye rays and then of paths."""
        assert self.scene.stream is not None, "who streams"
        self._hit_textures = {"hit_records": self.scene.stream.records(self._size)}

    def _look_by_rays(self) -> None:
        """Switch primary visibility to eye rays.

        Scan conversion needs one eye for all pixels, and no panorama.
        """
        gl, scene = self.gl, self.scene
        self._bvh = self._bvh or RayBvh(gl, scene)
        parts = ProgramParts.of(scene, self._bvh)
        program = load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="camera/eye_rays.frag",
            generated=parts.generated,
            defines=parts.defines | self._eye_defines,
        )
        target = gl.framebuffer([self._eye_buffer])
        self._eye_pass = Pass("eye", gl, program, target, textures=parts.textures)
        self._eye_constant = parts.uniforms

    def _image_window(self) -> tuple[int, int, int, int]:
        """Return x, y of the window's lower left pixel in the image, and the image's size."""
        width, height = self.sensor.resolution
        x, y, _, h = self.window
        return x, height - y - h, width, height

    def _texture(self, size: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
        texture = self.gl.texture(size, components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture
