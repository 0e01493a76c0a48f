"""Recursive ray tracing: the classical algorithm, and the T-buffer's [TB].

One path set is one ray through every pixel, all at the same place of their pixels, and all that follows from it.
The frame is `WhittedTracer.trace_path_set`. Primary rays go by the classical algorithm or by the T-buffer, light to
a surface by shadow rays or by shadow-buffers, reflections by the classical algorithm, as in the paper, or by a
BVH, as its section VI hopes. The routines of intersection and shading are the same for all.

What the paper lacks: shapes that emit, and the sky where there is no ambient light, light a path set by some points
of theirs, shared by all pixels, as those of the path-buffer are [PB 3.3]; their shadows are rays.

Poor at: light that comes by way of other surfaces (it is one number, `ambient`); refraction; soft shadows from few
path sets, as they are sums of hard ones.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.shadow_buffer import CubeShadowBuffer, PointShadowBuffer, SphereShadowBuffer
from glpath.buffers.t_buffer import ClassicEye, EyeBuffer, TBuffer
from glpath.errors import SceneError
from glpath.film.metadata import SHAPES, add_aov
from glpath.gl.camera import ahead_of, camera_defines, eye_uniforms
from glpath.gl.constants import DROPPED_SHIFT
from glpath.gl.device_bvh import DeviceBvh, bvh_glsl
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import sky_uniforms
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass, Stopwatch, draw_areas, run_in_areas
from glpath.gl.program import load_program
from glpath.gl.sums import PixelSums
from glpath.gl.uniforms import vectors
from glpath.integrators.aovs import EyeAovs, Seen, light_aovs
from glpath.integrators.path_set_engine import check_same_kind
from glpath.integrators.settings import WhittedSettings
from glpath.lights.lighting import Lighting, max_radiance
from glpath.lights.samples import LIGHT_KINDS
from glpath.sampling.points import PathSetSampler, counter_hash, pixel_place
from glpath.scene.model import Scene
from glpath.sensors.sensor import CameraSensor, Sensor

Uniforms = dict[str, object]


class WhittedTracer(Owner):
    """Traces path sets of one window of the image.

    Parameters
    ----------
    window : (x, y, width, height) in pixels of the whole image, y from the top
    moving : the scene of the objects, where some of them move while the shutter is open: all is put on the device
             anew for each path set, whose rays have one time
    """

    def __init__(
        self,
        gl: moderngl.Context,
        objects: DeviceScene,
        settings: WhittedSettings,
        window: tuple[int, int, int, int],
        *,
        moving: Scene | None = None,
        hardware: bool,
        timings: bool = False,
    ) -> None:
        self.gl = gl
        self.settings = settings
        self.stopwatch = Stopwatch(gl, hardware, timings)
        self.count_tests = settings.count_tests
        self.sensor = CameraSensor.of(objects.scene.camera)
        self._size = window[2:]
        self._sum = 0  # which of the two sets of sums holds the present ones
        self._moving = moving
        self._brightest = max_radiance(objects.scene)
        self._held = np.zeros((*self._size[::-1], 3))  # of the path sets before the objects moved
        self._held_aovs: dict[str, NDArray[Any]] = {}
        self._taken_aovs: dict[str, NDArray[Any]] = {}
        self.forget_statistics()
        self._set_up(objects)
        self.look_at(window)

    def look_at(self, window: tuple[int, int, int, int]) -> None:
        """Go on with another window of the same size."""
        assert window[2:] == self._size, f"a window of {window[2:]}, made for {self._size}"
        self.window = window

    def look_from(self, sensor: Sensor) -> None:
        """Start rays at another sensor of the same resolution. Shadow-buffers stay as they are [TB III.D]."""
        assert sensor.resolution == self.sensor.resolution, "another resolution needs another tracer"
        check_same_kind(_kind_of(self.sensor), _kind_of(sensor))
        assert isinstance(sensor, CameraSensor), "of the same kind"
        self.sensor = sensor

    def change_scene(self, scene: Scene) -> None:
        """Go on with another scene. Shadow-buffers of lights that stay are kept where no primitive has changed."""
        self._count_shadow_buffer()
        same = self.objects.geometry_digest
        self._moving = scene if scene.moving_shapes else None
        self._brightest = max_radiance(scene)
        objects = DeviceScene(self.gl, scene.still())
        kept = self.shadow_buffer if objects.geometry_digest == same else None
        if kept is not None and kept.lights != objects.positional_lights:
            kept = None
        bvh = self.bvh if objects.geometry_digest == same else None
        self.take()
        self._set_up(objects, bvh, kept)

    # The frame.

    def trace_path_set(self, index: int) -> None:
        """One ray for every pixel, and what follows from it [TB IV]."""
        self.move_to(index)
        camera = self.sensor.camera
        lens = self._sampler.eye(index)[:2] if camera.aperture_radius > 0 else None
        camera = camera.at(self._sampler.time(index, self.sensor.shutter))
        objects, pixel = self.objects, pixel_place(self.settings.seed, index)
        # An endless plane may be nearer than what has a size.
        ahead = 0.0 if len(objects.scene.planes) else ahead_of(camera, objects.centre, objects.radius)
        eye = eye_uniforms(camera, self.window, pixel, lens, ahead)
        eye["opacity_seed"] = counter_hash(self.settings.seed, index, 0, 12)
        self.fill_shadow_buffers()
        # Rays that meet at the eye share what follows from it, see t_buffer/eye_hit.glsl.
        parallel = camera.projection == "orthographic"
        self.fill_eye_buffer(eye if parallel else eye | eye_uniforms(camera, self.window, pixel, lens))
        self.add_aovs(eye)
        self.shade(index, eye)

    def move_to(self, index: int) -> None:
        """Put all where it is at the time of a path set, where something moves."""
        if self._moving is None:
            return
        with self.stopwatch.stage("motion"):
            self._held += self._take()
            self._held_aovs = self._with_held()
            self._count_shadow_buffer()
            sensor = self.sensor
            self._set_up(DeviceScene(self.gl, self._moving.still(self._sampler.time(index, self.sensor.shutter))))
            self.sensor = sensor

    def fill_shadow_buffers(self) -> None:
        """What the lights see; nothing to do where it was filled before and neither light nor object has moved."""
        if self.shadow_buffer is None:
            return
        with self.stopwatch.stage("shadow-buffer"):
            for number in range(self.objects.positional_lights):
                self.shadow_buffer.fill(self.objects.lights[number].position, number)

    def fill_eye_buffer(self, eye: Uniforms) -> None:
        """(object, t) for every pixel: primary rays, by the T-buffer or one by one."""
        with self.stopwatch.stage("eye"):
            self.eye_buffer.fill(eye)

    def add_aovs(self, eye: Uniforms) -> None:
        """The surfaces that were found, where the film has AOVs of them."""
        if self._aovs is not None:
            with self.stopwatch.stage("AOVs"):
                self._aovs.add(eye)

    def shade(self, index: int, eye: Uniforms) -> None:
        """Light and shadow at what was found, and the path on by reflection."""
        uniforms = self._constant | self._light_samples(index) | eye
        if self.shadow_buffer is not None:
            uniforms |= self.shadow_buffer.uniforms
        shading = self._shade_passes[self._sum]
        with self.stopwatch.stage("shade"):
            run_in_areas(shading, self._areas, uniforms)
        self._sum = 1 - self._sum
        self._sums.add_direct()

    def take(self) -> NDArray[np.float64]:
        """The sum of radiance over the path sets since the last call, (h, w, 3), row 0 at the top.

        Multiples of one power of two, so that float64 adds them without rounding.
        """
        total = self._held + self._take() if self._moving else self._take()
        self._held[:] = 0.0
        return total

    def _take(self) -> NDArray[np.float64]:
        """What is on the device of it."""
        taken = self._sums.take(self._sum)
        dropped = taken.high >> DROPPED_SHIFT
        self._taken_aovs = light_aovs(self.settings, self._sums, dropped)
        self._dropped += int(dropped.sum())
        self._count()
        return taken.radiance

    def take_aovs(self) -> dict[str, NDArray[Any]]:
        """What `Film.add` takes of the AOVs that the settings ask for, over the path sets of the last `take`."""
        found, self._held_aovs = self._with_held(), {}
        return found

    def _with_held(self) -> dict[str, NDArray[Any]]:
        """What is on the device of them, and what was held when objects moved."""
        found = self._taken_aovs | ({} if self._aovs is None else self._aovs.take())
        for name, held in self._held_aovs.items():
            if name == SHAPES:  # a picture for each path set
                found[name] = np.concatenate([held, found[name]], axis=2)
            else:
                add_aov(name, found[name], held)
        return found

    def statistics(self) -> dict[str, object]:
        """What was counted in the path sets taken so far.

        dropped_samples    : not finite, and counted as 0
        intersection_tests : pairs of a ray and a primitive, by the ray's purpose, where counted: "primary" from the
                             eye, "shadow_buffer" to fill it, "shadow" rays, "secondary" for reflections
        stage_ms           : milliseconds by stage, where timed
        """
        counts: dict[str, object] = {"dropped_samples": self._dropped}
        if self.count_tests:
            counts["intersection_tests"] = dict(self._tests)
        if self.stopwatch.enabled:
            counts["stage_ms"] = dict(self.stopwatch.milliseconds)
        return counts

    def forget_statistics(self) -> None:
        """Count anew."""
        self._dropped = 0
        self._tests = {"primary": 0, "shadow_buffer": 0, "shadow": 0, "secondary": 0}
        self.stopwatch.milliseconds.clear()

    # What the frame is made of.

    def _light_samples(self, index: int) -> Uniforms:
        """The light points of a path set, which shaders/lights/light_samples.glsl reads."""
        lighting, n = self._area_lighting, self.settings.light_samples
        if lighting.dark:
            return {}
        drawn = lighting.samples([self._sampler[index * n + i].light for i in range(n)])
        sky = (drawn.kind == LIGHT_KINDS.index("sky"))[:, None]
        return {
            "sample_position": vectors(np.where(sky, -drawn.direction, drawn.position)),
            "sample_normal": vectors(np.append(drawn.direction, sky, axis=1)),
            "sample_radiance": vectors(drawn.radiance / (np.pi * drawn.density * n)[:, None]),
        }

    def _set_up(
        self,
        objects: DeviceScene,
        bvh: DeviceBvh | None = None,
        shadow_buffer: PointShadowBuffer | None = None,
    ) -> None:
        settings, gl = self.settings, self.gl
        self.objects: DeviceScene = objects
        self.sensor = CameraSensor.of(objects.scene.camera)
        make = TBuffer if settings.primary == "t-buffer" else ClassicEye
        self.eye_buffer: EyeBuffer = make(gl, objects, self._size, count_tests=self.count_tests)
        self._sum = 0
        self._sums: PixelSums = PixelSums(gl, self._size, self._brightest, split=settings.splits_light)
        eye = self.eye_buffer.texture
        self._aovs: EyeAovs | None = EyeAovs.of(
            settings.aovs, Seen(objects, eye, camera_defines(objects.scene.camera))
        )
        words = bytes(8 * self._size[0] * self._size[1])
        self._ray_tests: moderngl.Buffer | None = gl.buffer(data=words) if self.count_tests else None

        textures: dict[str, moderngl.Texture] = {**objects.textures, "eye_buffer": self.eye_buffer.texture}
        # Includes are put in place before #ifdef is looked at.
        generated, defines = {**objects.generated, "BVH": bvh_glsl()}, objects.defines | self._sums.defines
        defines |= camera_defines(objects.scene.camera)
        self._constant: Uniforms = {**objects.uniforms, **_air(objects.scene)}
        self._constant |= {"max_depth": settings.max_depth, "quanta": self._sums.quanta}
        # Ambient light stands for the sky's on surfaces; both would count it twice.
        self._area_lighting: Lighting = Lighting.of(
            objects.scene, punctual=False, sky=not np.any(objects.scene.ambient > 0)
        )
        self._sampler: PathSetSampler = PathSetSampler(settings.seed, settings.max_depth)
        if not self._area_lighting.dark:
            defines["LIGHT_SAMPLES"] = settings.light_samples
        self.bvh: DeviceBvh | None = bvh
        if settings.secondary == "bvh":
            self.bvh = self.bvh or DeviceBvh(gl, objects)
            textures |= self.bvh.textures
            self._constant |= self.bvh.uniforms
            defines["BY_BVH"] = 1
        self.shadow_buffer: PointShadowBuffer | None = shadow_buffer
        lights = objects.positional_lights
        if settings.shadows != "rays" and lights:
            _check_shadows(objects.scene)
            resolution = settings.shadow_resolution
            if self.shadow_buffer is not None:
                pass
            elif settings.shadows == "sphere":
                self.shadow_buffer = SphereShadowBuffer(gl, objects, resolution, 2 * resolution, lights)
            else:
                self.shadow_buffer = CubeShadowBuffer(gl, objects, resolution, lights)
            textures |= self.shadow_buffer.textures
            defines |= self.shadow_buffer.defines(settings.shadow_test, settings.shadow_filter)
            defines["SHADOW_BUFFERS"] = 1
        self._areas = draw_areas(self._size, self._rays_loop_over())
        self._counted: int = 0 if self.shadow_buffer is None else self.shadow_buffer.intersection_tests
        if settings.max_depth > 1 and any(material.has_lobes for material in objects.scene.materials):
            defines["REFLECTIONS"] = 1
        if self.count_tests:
            defines["COUNT_TESTS"] = 1
        program = load_program(
            gl, vertex="gl/fullscreen.vert", fragment="t_buffer/whitted.frag", generated=generated, defines=defines
        )
        self._shade_passes: list[Pass] = [
            Pass(
                "shade",
                gl,
                program,
                self._sums.targets[1 - i],
                textures=textures | self._sums.textures[i],
                buffers={0: self._ray_tests} if self._ray_tests else {},
            )
            for i in range(2)
        ]

    def _rays_loop_over(self) -> int:
        """Ray-primitive tests that the shading of a pixel may take, where they are a loop over all primitives."""
        settings, objects = self.settings, self.objects
        planes = objects.numbering.count - objects.numbering.first_plane
        loop = objects.count if settings.secondary == "classic" else planes
        shadow_rays = len(objects.lights)
        if settings.shadows != "rays":
            shadow_rays -= objects.positional_lights
        if not self._area_lighting.dark:
            shadow_rays += settings.light_samples
        return settings.max_depth * (1 + shadow_rays) * loop

    def _count(self) -> None:
        if not self.count_tests:
            return
        assert self._ray_tests is not None, "made where tests are counted"
        self._tests["primary"] += self.eye_buffer.take_tests()
        self.gl.memory_barrier()
        self.gl.finish()
        shadow, secondary = np.frombuffer(self._ray_tests.read(), np.uint32).reshape(-1, 2).sum(0, dtype=np.uint64)
        self._ray_tests.write(bytes(self._ray_tests.size))
        self._tests["shadow"] += int(shadow)
        self._tests["secondary"] += int(secondary)
        self._count_shadow_buffer()

    def _count_shadow_buffer(self) -> None:
        if self.shadow_buffer is not None:
            self._tests["shadow_buffer"] += self.shadow_buffer.intersection_tests - self._counted
            self._counted = self.shadow_buffer.intersection_tests


def _kind_of(sensor: Sensor) -> tuple[object, ...]:
    return (*sensor.kind, None)


def _check_shadows(scene: Scene) -> None:
    """Raise SceneError for what shadow-buffers cannot hold."""
    blended = sorted({m.name for m in (scene.materials[s.material] for s in scene.shapes) if m.alpha == "blend"})
    if blended:
        raise SceneError(
            f'{scene.source or scene.name}: the materials {", ".join(blended)} have alpha = "blend", which is '
            "there by chance; a shadow-buffer is filled once for all path sets.",
            'Take shadows "rays", or alpha = "mask".',
        )


def _air(scene: Scene) -> Uniforms:
    """What is there without any object: ambient light and the sky."""
    return {"ambient": tuple(scene.ambient), **sky_uniforms(scene.sky)}
