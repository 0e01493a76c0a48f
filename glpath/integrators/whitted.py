"""Recursive ray tracing: the classical algorithm, and the T-buffer's [TB].

One path set is one ray through every pixel, all at the same position in their pixels, and all secondary rays. The
frame is `WhittedTracer.trace_path_set`. Primary rays use the classical algorithm or the T-buffer; light uses shadow
rays or shadow-buffers. Reflections use the classical algorithm, as in the paper, or a BVH, which the paper's
section VI proposes. All share the routines of intersection and shading.

Additions to the paper: a path set has light samples of emitting shapes, and of the sky if there is no ambient
light. All pixels share them, as in the path-buffer [PB 3.3]. Their shadows are rays. Streamed triangles are visible
and cast shadows, but are not reflected, because a reflected ray needs all of them in memory.

Poor at: indirect light (one number, `ambient`); refraction; soft shadows from few path sets, which are sums of hard
shadows.
"""

from __future__ import annotations

from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.shadow_buffer import CubeShadowBuffer, PointShadowBuffer, SphereShadowBuffer
from glpath.buffers.t_buffer import ClassicEye, EyeBuffer, TBuffer
from glpath.errors import SceneError
from glpath.film.aovs import SHAPES, add_aov
from glpath.gl.camera import ahead_of, camera_defines, eye_uniforms
from glpath.gl.device_bvh import DeviceBvh, bvh_glsl
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import background_uniforms, sky_uniforms
from glpath.gl.passes import Pass, draw_areas, run_in_areas
from glpath.gl.ping_pong import InTurn
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.stream_occluders import StreamOccluders
from glpath.gl.sums import PixelSums, Readback
from glpath.gl.uniforms import vectors
from glpath.integrators.aovs import EyeAovs, Seen
from glpath.integrators.engine import Engine, Uniforms, Window
from glpath.integrators.ground import Ground
from glpath.integrators.stream_shadows import StreamShadows
from glpath.integrators.whitted_settings import WhittedSettings
from glpath.lights.lighting import Lighting, max_radiance
from glpath.lights.samples import LIGHT_KINDS
from glpath.sampling.points import PathSetSampler, counter_hash, pixel_sample
from glpath.scene.model import Scene
from glpath.sensors.sensor import CameraSensor


class WhittedTracer(Engine):
    """Engine that traces path sets of one window of the image; see `Engine` for the other parameters.

    moving : the scene, if some of its objects move while the shutter is open; the device scene is then created
             again for each path set, whose rays have one time
    """

    settings: WhittedSettings
    sensor: CameraSensor

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: WhittedSettings,
        window: Window,
        *,
        moving: Scene | None = None,
        timings: bool = False,
    ) -> None:
        super().__init__(gl, scene, settings, window, CameraSensor.of(scene.scene.camera), timings)
        self.count_tests = settings.count_tests
        self._moving = moving
        self._max_radiance = max_radiance(scene.scene)
        self._held = np.zeros((*self._size[::-1], 3))  # sums of the path sets before the objects moved
        self._held_aovs: dict[str, NDArray[Any]] = {}
        self._tests = _no_tests()
        self._occluders: StreamOccluders | None = None
        self._stream_shadows: StreamShadows | None = None

    def prepare(self) -> Self:
        self._set_up(self.scene)
        return self

    def change_scene(self, scene: Scene) -> None:
        """Take another scene. Shadow-buffers of unchanged lights are kept if no primitive has changed."""
        self._count_shadow_buffer()
        same = self.scene.geometry_digest
        self._moving = scene if scene.moving_shapes else None
        self._max_radiance = max_radiance(scene)
        objects = DeviceScene(self.gl, scene.still(), self.settings.stream_budget)
        kept = self.shadow_buffer if objects.geometry_digest == same else None
        if kept is not None and kept.lights != objects.positional_lights:
            kept = None
        if kept is not None:
            kept.objects = objects
        bvh = self.bvh if objects.geometry_digest == same else None
        if objects.geometry_digest != same:
            self._occluders = None
        self.take()
        self._set_up(objects, bvh, kept)

    # Frame.

    def trace_path_set(self, index: int) -> None:
        """Trace one ray through every pixel, and its secondary rays [TB IV]."""
        self.move_to(index)
        camera = self.sensor.camera
        lens = self._sampler.eye(index)[:2] if camera.aperture_radius > 0 else None
        camera = camera.at(self._sampler.time(index, self.sensor.shutter))
        objects, pixel = self.scene, pixel_sample(self.settings.seed, index)
        # Rays start ahead of the eye only if no infinite plane may be nearer than the bounded objects.
        ahead = 0.0 if len(objects.scene.planes) else ahead_of(camera, objects.centre, objects.radius)
        eye = eye_uniforms(camera, self.window, pixel, lens, ahead)
        eye |= {"opacity_seed": counter_hash(self.settings.seed, 0, 0, 12), "opacity_set": index}
        self.fill_shadow_buffers()
        # Rays that are not parallel start at the eye: their common origin saves computations, see
        # t_buffer/eye_hit.glsl.
        parallel = camera.projection == "orthographic"
        self.fill_eye_buffer(eye if parallel else eye | eye_uniforms(camera, self.window, pixel, lens))
        self._add_aovs(eye)
        uniforms = self._shading_uniforms(index, eye)
        self.ask_stream(uniforms)
        self.shade(uniforms)

    def move_to(self, index: int) -> None:
        """Move all objects to the time of a path set, unless the scene is static."""
        if self._moving is None:
            return
        with self.stopwatch.stage("motion"):
            self._held += super().take()
            self._held_aovs = self._with_held()
            self._count_shadow_buffer()
            sensor = self.sensor
            self._set_up(DeviceScene(self.gl, self._moving.still(self._sampler.time(index, self.sensor.shutter))))
            self.sensor = sensor

    def fill_shadow_buffers(self) -> None:
        """Fill the shadow-buffers that are not filled yet, or whose light or objects have moved."""
        if self.shadow_buffer is None:
            return
        with self.stopwatch.stage("shadow-buffer"):
            for number in range(self.scene.positional_lights):
                self.shadow_buffer.fill(self.scene.lights[number].position, number)

    def fill_eye_buffer(self, eye: Uniforms) -> None:
        """Find (object, t) for every pixel: primary rays, by the T-buffer or one by one."""
        with self.stopwatch.stage("eye"):
            self.eye_buffer.fill(eye)

    def ask_stream(self, uniforms: Uniforms) -> None:
        """Cast shadow rays from the primary hits, against part after part of the streamed triangles."""
        if self._stream_shadows is None:
            return
        with self.stopwatch.stage("streamed shadows"):
            self._stream_shadows.find(uniforms)
        shading = self._shading.now
        shading.textures = {**shading.textures, **self._stream_shadows.textures}

    def shade(self, uniforms: Uniforms) -> None:
        """Compute light and shadow at the primary hits, and follow reflections."""
        with self.stopwatch.stage("shade"):
            run_in_areas(self._shading.now, self._areas, uniforms)
        self._sums.path_set_added()

    def _shading_uniforms(self, index: int, eye: Uniforms) -> Uniforms:
        uniforms = self._constant | self._light_samples(index) | eye
        uniforms["random_seed"] = counter_hash(self.settings.seed, index, 0, 13)
        if self.shadow_buffer is not None:
            uniforms |= self.shadow_buffer.uniforms
        if self._ground is not None:
            uniforms |= self._ground.of_set(index)
        return uniforms

    def take(self) -> NDArray[np.float64]:
        readback = super().take()
        if self._moving is not None:
            readback = self._held + readback
            self._held[:] = 0.0
        return readback

    def take_aovs(self) -> dict[str, NDArray[Any]]:
        found, self._held_aovs = self._with_held(), {}
        return found

    def _with_held(self) -> dict[str, NDArray[Any]]:
        """Return the AOVs read from the device, merged with those saved before objects moved."""
        found = super().take_aovs()
        for name, held in self._held_aovs.items():
            if name == SHAPES:  # one image for each path set
                found[name] = np.concatenate([held, found[name]], axis=2)
            else:
                add_aov(name, found[name], held)
        return found

    def statistics(self) -> dict[str, object]:
        """Return the counts of every engine, and:

        intersection_tests : number of ray-primitive tests by the ray's purpose, if counted: "primary" from the eye,
                             "shadow_buffer" to fill it, "shadow" rays, "secondary" for reflections
        """
        counts = super().statistics()
        return {**counts, "intersection_tests": dict(self._tests)} if self.count_tests else counts

    def forget_statistics(self) -> None:
        super().forget_statistics()
        self._tests = _no_tests()

    # Parts of the frame.

    def _light_samples(self, index: int) -> Uniforms:
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
        self.scene = objects
        self.sensor = CameraSensor.of(objects.scene.camera)
        records: dict[str, moderngl.Texture] = {}
        if objects.stream is not None:
            records = {"hit_records": objects.stream.records(self._size)}
        self.eye_buffer: EyeBuffer = self._make_eye_buffer(records.get("hit_records"))
        self._sums = PixelSums(gl, self._size, self._max_radiance, split=settings.splits_light)
        eye = self.eye_buffer.texture
        self._aovs = EyeAovs.of(settings.aovs, Seen(objects, eye, camera_defines(objects.scene.camera), records))
        words = bytes(8 * self._size[0] * self._size[1])
        self._ray_tests: moderngl.Buffer | None = gl.buffer(data=words) if self.count_tests else None

        textures: dict[str, moderngl.Texture] = {**objects.textures, **records, "eye_buffer": eye}
        generated, defines = {**objects.generated}, objects.defines | self._sums.defines
        defines |= camera_defines(objects.scene.camera)
        self._constant: Uniforms = {**objects.uniforms, **_air(objects.scene)}
        self._constant |= {"max_depth": settings.max_depth, "quanta": self._sums.quanta}
        # Ambient light replaces the sky's light on surfaces; using both would count it twice.
        self._area_lighting: Lighting = Lighting.of(
            objects.scene, punctual=False, sky=not np.any(objects.scene.ambient > 0)
        )
        self._sampler = PathSetSampler(settings.seed, settings.max_depth)
        if not self._area_lighting.dark:
            defines["LIGHT_SAMPLES"] = settings.light_samples
        self._ground = Ground.of(objects.scene, settings.seed)
        if self._ground is not None:
            self._constant |= self._ground.uniforms
            defines |= self._ground.defines
        self.bvh: DeviceBvh | None = bvh
        if settings.secondary == "bvh":
            self.bvh = self.bvh or DeviceBvh(gl, objects)
            textures |= self.bvh.textures
            self._constant |= self.bvh.uniforms
            generated["BVH"] = bvh_glsl()
            defines["BY_BVH"] = 1
        self.shadow_buffer: PointShadowBuffer | None = shadow_buffer
        if settings.shadows != "rays" and objects.positional_lights:
            check_shadows(objects.scene)
            self.shadow_buffer = self.shadow_buffer or self._make_shadow_buffer()
            textures |= self.shadow_buffer.textures
            defines |= self.shadow_buffer.defines(settings.shadow_test, settings.shadow_filter)
            defines["SHADOW_BUFFERS"] = 1
        self._areas = draw_areas(self._size, self._rays_loop_over())
        self._counted: int = 0 if self.shadow_buffer is None else self.shadow_buffer.intersection_tests
        if self.count_tests:
            defines["COUNT_TESTS"] = 1
        self._stream_shadows = self._shadows_of_stream(ProgramParts(textures=textures, defines=defines))
        if self._stream_shadows is not None:
            self._constant |= self._stream_shadows.uniforms
            textures |= self._stream_shadows.textures
            defines |= self._stream_shadows.defines
        if objects.stream is not None:
            objects.stream.reserve()
        elif settings.max_depth > 1 and any(material.has_lobes for material in objects.scene.materials):
            defines["REFLECTIONS"] = 1
        self._shading = self._make_shading(ProgramParts(textures=textures, generated=generated, defines=defines))

    def _make_shading(self, parts: ProgramParts) -> InTurn[Pass]:
        program = load_program(
            self.gl,
            vertex="gl/fullscreen.vert",
            fragment="t_buffer/whitted.frag",
            generated=parts.generated,
            defines=parts.defines,
        )
        buffers = {0: self._ray_tests} if self._ray_tests else {}
        return self._sums.sets.each(
            lambda read, write: Pass(
                "shade",
                self.gl,
                program,
                write.target,
                textures={**parts.textures, **read.textures},
                buffers=buffers,
            )
        )

    def _make_eye_buffer(self, records: moderngl.Texture | None) -> EyeBuffer:
        if self.settings.primary == "classic":
            return ClassicEye(self.gl, self.scene, self._size, count_tests=self.count_tests)
        return TBuffer(self.gl, self.scene, self._size, count_tests=self.count_tests, records=records)

    def _make_shadow_buffer(self) -> PointShadowBuffer:
        objects, resolution = self.scene, self.settings.shadow_resolution
        if self.settings.shadows == "sphere":
            return SphereShadowBuffer(self.gl, objects, resolution, 2 * resolution, objects.positional_lights)
        return CubeShadowBuffer(self.gl, objects, resolution, objects.positional_lights)

    def _shadows_of_stream(self, parts: ProgramParts) -> StreamShadows | None:
        """Return the occlusion by streamed triangles; None if nothing is streamed or no shadow ray is cast."""
        objects, settings = self.scene, self.settings
        by_rays = len(objects.lights)
        if self.shadow_buffer is not None:
            by_rays -= objects.positional_lights
        samples = 0 if self._area_lighting.dark else settings.light_samples
        if objects.stream is None or not (by_rays or samples or self._ground is not None):
            return None
        self._occluders = self._occluders or StreamOccluders(self.gl, objects.scene)
        return StreamShadows(
            objects, self._occluders, self._size, len(objects.lights) + samples, parts, self._ray_tests
        )

    def _rays_loop_over(self) -> int:
        """Return the maximum number of ray-primitive tests that shading a pixel runs in loops over primitives."""
        settings, objects = self.settings, self.scene
        planes = objects.numbering.count - objects.numbering.first_plane
        loop = objects.count if settings.secondary == "classic" else planes
        shadow_rays = len(objects.lights)
        if settings.shadows != "rays":
            shadow_rays -= objects.positional_lights
        if not self._area_lighting.dark:
            shadow_rays += settings.light_samples
        return settings.max_depth * (1 + shadow_rays) * loop

    def _count(self, readback: Readback) -> None:
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


def _no_tests() -> dict[str, int]:
    return {"primary": 0, "shadow_buffer": 0, "shadow": 0, "secondary": 0}


def check_shadows(scene: Scene) -> None:
    """Raise SceneError for materials that shadow-buffers cannot represent."""
    blended = sorted({m.name for m in (scene.materials[s.material] for s in scene.shapes) if m.alpha == "blend"})
    if blended:
        raise SceneError(
            f'{scene.source or scene.name}: the materials {", ".join(blended)} have alpha = "blend", which is '
            "stochastic; a shadow-buffer is filled once for all path sets.",
            'Take shadows "rays", or alpha = "mask".',
        )


def _air(scene: Scene) -> Uniforms:
    """Return the uniforms of light that comes from no object: ambient light and the sky."""
    return {"ambient": tuple(scene.ambient), **sky_uniforms(scene.sky), **background_uniforms(scene)}
