"""Stages of a path set on the path-buffer, which engines call in the order of their frame [PB 3, appendix B].

A path set is one path for every pixel. Its paths share their directions and one light sample, so a bounce is one
scan of the path-buffer, and direct light is one shadow-buffer. `PathBufferTracer` and `PathBufferGather` are frames
made of these stages; they differ in the treatment of a path's last vertex.

Differences from the paper, and reasons:

- A set has two directions a bounce. Each serves both hemispheres, because a path reverses a direction that points
  behind its surface. A path takes the direction nearer to its normal, so the density is the cosine over pi:
  importance sampling by a single comparison. `directions="hemisphere"` has one direction, density 1/(2 pi).
  `"lattice"` has one for the first bounce, a point of an extensible lattice. Indirect light at the visible surfaces
  is mainly a smooth integral over the hemisphere, which a lattice samples best. `"sphere"` is the paper's,
  density 1/(4 pi), which loses every other path.
- Light samples and directions, except the lattice's, come from a scrambled Sobol sequence; `sampling="random"` is
  the paper's, for all of them.
- Both the light sample and the direction can find an emitter. They are weighted by the power heuristic (Veach
  1997), so that light from near emitters, whose 1/r^2 has no bound, does not cause fireflies. With the sphere only
  the light sample counts, as in the paper's equation 5.
- With one direction, a path that leaves at a grazing angle continues with the probability of the cosine; otherwise
  such paths would crowd the cells. The same holds for paths at surfaces that parallel light grazes.
- Point lights illuminate all directions, by a cube instead of a hemicube. The shadow of parallel light and of the
  sky is one scan of a path-buffer along its direction, for the vertices of all paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.hemicube_shadow_buffer import HemicubeShadowBuffer
from glpath.buffers.path_buffer import PathBuffer, Scan, ScanView
from glpath.gl.camera import of_every_second
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import background_uniforms, light_defines, sample_uniforms, sky_uniforms
from glpath.gl.passes import Pass
from glpath.gl.ping_pong import InTurn, PingPong
from glpath.gl.program import Program, load_program
from glpath.gl.program_parts import Part, ProgramParts
from glpath.gl.uniforms import vectors
from glpath.integrators.engine import Uniforms, Window
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathBufferSettings
from glpath.lights.samples import NO_LIGHT, LightSample
from glpath.sampling.points import (
    PathSetSample,
    PathSetSampler,
    counter_hash,
    uniform_hemisphere,
    uniform_sphere,
)
from glpath.scene.simplify import density_of, simplified

# A path from the visible surface ignores hits within this distance of its start. The unit is the simplified
# surface's deviation from the visible one. It is above 1 because paths may leave at a grazing angle.
_SKIPPED = 4.0

_STATE = ("path_position", "path_beta", "path_radiance")


@dataclass(frozen=True)
class PathStates:
    """Paths of a set after one of their vertices.

    position : world space, with the direction code in w; see path/path_state.glsl
    light    : textures of the light gathered by the paths: radiance, and direct light if it is summed separately
    target   : framebuffer of a pass that computes each path's next vertex
    textures : textures of a pass that reads the states
    """

    position: moderngl.Texture
    light: Mapping[str, moderngl.Texture]
    target: moderngl.Framebuffer
    textures: Mapping[str, moderngl.Texture]


@dataclass(frozen=True)
class VertexPasses:
    """Passes of one stage of the frame.

    inner : passes from path states to new path states; None if no path continues
    last  : passes from path states to the film's sums, by the current half of the pairs of states and of sums; None
            if no path ends
    unlit : True if the last passes write path states instead of sums, because light from infinity is added
            afterwards
    """

    inner: InTurn[Pass] | None
    last: InTurn[InTurn[Pass]] | None
    unlit: bool = False


@dataclass(frozen=True)
class SetLight:
    """Light of a path set: its sample, and the uniforms of lights/direct.glsl."""

    sample: LightSample
    uniforms: Uniforms

    @property
    def distant(self) -> bool:
        return self.sample.distant


class PathBufferStages(PathSetEngine):
    """Stages of path sets for one window of the image; subclasses define `trace_path_set`.

    offset : offset of the first pixel, right and down, if the engine computes only every second pixel across and
             down; see `interleaved`. `PathSetEngine` has the other parameters
    """

    settings: PathBufferSettings | GatherSettings
    _advance_passes: VertexPasses  # created by the subclass

    def __init__(self, *args: Any, offset: tuple[int, int] | None = None, **options: Any) -> None:
        super().__init__(*args, **options)
        self._offset: tuple[int, int] | None = None
        if offset is not None:
            # Texture rows are counted from the bottom.
            (right, down), (width, height) = offset, self._size
            self._size = (width - right + 1) // 2, (height - down + 1) // 2
            self._offset = right, height - 1 - down - 2 * (self._size[1] - 1)

    def _prepare_stages(self) -> None:
        gl, scene, settings, size = self.gl, self.scene, self.settings, self._size
        self._sampler = PathSetSampler(
            settings.seed, self._bounces() + 1, settings.sampling, lattice=settings.directions == "lattice"
        )
        if scene.scene.camera.projection == "panorama":
            self._look_by_rays()
        views = max((_views(settings, bounce) for bounce in range(self._bounces())), default=1)
        cells = _cells(settings.cell_share * views**-0.5, size)
        self._deep = deep = self._scene_of_bounces()
        simpler = deep is not scene
        self.path_buffer = PathBuffer(gl, deep, size, cells, views, self._hit_textures.get("hit_records"), simpler)
        lights = self.lighting
        self.shadow_buffer = HemicubeShadowBuffer(gl, scene, settings.light_resolution, full=lights.positional)
        self._deep_shadows = (
            HemicubeShadowBuffer(gl, deep, settings.light_resolution, full=lights.positional)
            if simpler
            else self.shadow_buffer
        )
        # All shadow rays to distant light have one direction, so their scan needs only one view.
        distant = _cells(settings.cell_share, size)
        self._distant_buffer = PathBuffer(gl, scene, size, distant, occlusion=True) if lights.infinite else None
        self._deep_distant = (
            PathBuffer(gl, deep, size, distant, occlusion=True)
            if simpler and lights.infinite
            else self._distant_buffer
        )
        self._distant_scan: Uniforms = {}
        self._make_states(size)
        self._constant = self._constant_uniforms()

    def look_at(self, window: Window) -> None:
        """Switch to another window of the same size."""
        super().look_at(window)
        self._constant = self._constant_uniforms()

    def _eye_uniforms(self, pixel: NDArray[np.float64], index: int = 0) -> Uniforms:
        eye = super()._eye_uniforms(pixel, index)
        return eye if self._offset is None else of_every_second(eye, self._offset, self._size)

    def _image_window(self) -> tuple[int, int, int, int]:
        x, y, width, height = super()._image_window()
        if self._offset is None:
            return x, y, width, height
        return (x + self._offset[0]) // 2, (y + self._offset[1]) // 2, (width + 1) // 2, (height + 1) // 2

    # Stages, in the order of a frame.

    def light_from(self, index: int, u: NDArray[np.float64]) -> SetLight:
        """Draw a light sample, and fill its shadow-buffer unless the light is at infinity [PB 3.3]."""
        light = NO_LIGHT if self.lighting.dark else self.lighting.sample(u)
        roll = 2.0 * np.pi * counter_hash(self.settings.seed, index, 0, 1) / 2**32
        uniforms = sample_uniforms(light)
        if light is NO_LIGHT or light.distant:
            frame = self.shadow_buffer.frame(self.scene.centre, light.direction, roll)
            return SetLight(light, uniforms | frame.uniforms)
        # A point light's cube is rotated for each set, so that texel edges average out.
        axis = uniform_sphere(u[1:]) if light.kind == "point" else light.direction
        frame = self.shadow_buffer.frame(light.position, axis, roll, one_sided=light.kind == "area")
        with self.stopwatch.stage("shadow-buffer"):
            chance = {"opacity_seed": counter_hash(self.settings.seed, index, 0, 13)}
            self.shadow_buffer.scan(frame, light.cube_faces, chance)
            if self._deep_shadows is not self.shadow_buffer:
                self._deep_shadows.scan(frame, light.cube_faces, chance)
        return SetLight(light, uniforms | frame.uniforms)

    def start_at_eye(self, index: int, sample: PathSetSample, light: SetLight) -> None:
        """Find primary hits, with a sub-pixel jitter for antialiasing, and their direct light."""
        eye = self._eye_uniforms(sample.pixel, index)
        self._see(eye)
        with self.stopwatch.stage("first vertex"):
            last = self.settings.path_length == 1
            self._run_vertex(self._start_passes, index, 0, sample, eye | light.uniforms, last)

    def scan_positions(self, index: int, depth: int, sample: PathSetSample) -> Scan:
        """Compute z0 of every live path, the depth where its ray starts."""
        counter = [counter_hash(self.settings.seed, index, depth, use) for use in range(3)]
        view = ScanView(
            directions=self._directions(sample, depth - 1),
            jitter=(counter[0] / 2**32, counter[1] / 2**32),
            seed=counter[2],
        )
        with self.stopwatch.stage("scan positions"):
            return self.path_buffer.scan_positions(self._states.read.position, view)

    def scan_scene(self, depth: int, scan: Scan) -> None:
        """Find the nearest surface beyond each path's z0."""
        # The simplified surface may lie in front of the visible one, where paths start, so near hits are skipped.
        skipped = _SKIPPED if depth == 1 else 0.0
        with self.stopwatch.stage("scan scene"):
            self.path_buffer.scan_scene(scan, skipped)

    def advance(
        self, index: int, depth: int, sample: PathSetSample, light: SetLight, scan: Scan, last: bool
    ) -> None:
        """Update radiance, throughput and positions from the scan [PB table 6]; at the last vertex, the sums."""
        with self.stopwatch.stage("advance"):
            uniforms = light.uniforms | scan.uniforms
            self._run_vertex(self._advance_passes, index, depth, sample, uniforms, last)

    def light_from_infinity(self, index: int, depth: int, light: SetLight, last: bool = False) -> None:
        """Add light from a directional light or the sky at the newest vertices, with one scan for shadows.

        Paths that ended at these vertices are lit as well. If the set's light is not distant, there is nothing to
        add before the last vertex. At the last vertex, this stage adds the light of the paths to the sums in any
        case.
        """
        if self._distant_buffer is None or not (light.distant or last):
            return
        buffer, passes = self._distant_buffer, self._light_passes
        if depth > 0 and self._deep_distant is not None:
            buffer, passes = self._deep_distant, self._deep_light_passes
        if light.distant:
            counter = [counter_hash(self.settings.seed, index, depth, use) for use in range(6, 9)]
            view = ScanView(
                directions=(-light.sample.direction,),
                jitter=(counter[0] / 2**32, counter[1] / 2**32),
                seed=counter[2],
            )
            with self.stopwatch.stage("light from infinity"):
                scan = buffer.scan_positions(self._pending[0], view)
                buffer.scan_scene(scan)
            self._distant_scan = scan.uniforms
        vertex = {"first_vertex": depth == 0}
        with self.stopwatch.stage("light from infinity"):
            if last:
                assert passes.last is not None, "made with every light from infinity"
                passes.last.now.now.run(self._constant | self._distant_scan | vertex)
                self._sums.path_set_added()
            else:
                assert passes.inner is not None, "made with every light from infinity"
                passes.inner.now.run(self._distant_scan | vertex)

    # Helpers of the stages.

    def _scene_of_bounces(self) -> DeviceScene:
        """Return the scene for paths from their second vertex on, which may be a simplified one [PB 6.1].

        The simplified scene is used for everything at those vertices: scans, shadows and surfaces.
        """
        full, share = self.scene, self.settings.bounce_lod
        if share is None or self._bounces() == 0:
            return full
        found = simplified(full.scene, share)
        density = density_of(full.scene, found.scene, self.lighting.triangle_density)
        lighting = replace(full.lighting, triangle_density=density)
        deep = DeviceScene(self.gl, found.scene, lighting=lighting, deviations=found.deviations)
        deep.look_as(full)
        return deep

    def _directions(self, sample: PathSetSample, bounce: int) -> tuple[NDArray[np.float64], ...]:
        u = sample.directions[bounce]
        if self.settings.directions == "sphere":
            return (uniform_sphere(u[0]),)
        return tuple(uniform_hemisphere(u[: _views(self.settings, bounce)]))

    def _bounces(self) -> int:
        """Return the maximum number of bounces of a path; each bounce needs a direction."""
        return self.settings.path_length - 1

    def _plays_roulette(self, depth: int) -> bool:
        """Return True if Russian roulette may end paths at vertex `depth`; the visible vertex is 0."""
        return False

    def _run_vertex(
        self,
        passes: VertexPasses,
        index: int,
        depth: int,
        sample: PathSetSample,
        uniforms: Uniforms,
        last: bool,
    ) -> None:
        """Run a vertex pass from the current path states into the other ones; at the last vertex, into the sums."""
        uniforms = uniforms | {
            "random_seed": counter_hash(self.settings.seed, index, depth, 5),
            "first_bounce": depth == 1,
        }
        if last:
            self._end_paths(passes, uniforms)
            return
        directions = self._directions(sample, depth)
        assert passes.inner is not None, "a stage after which paths continue"
        passes.inner.now.run(
            self._constant
            | uniforms
            | {
                "next_directions": vectors(directions, self.path_buffer.views),
                "next_views": len(directions),
                "roulette": self._plays_roulette(depth + 1),
            }
        )
        self._states.swap()

    def _end_paths(self, passes: VertexPasses, uniforms: Uniforms) -> None:
        assert passes.last is not None, "a stage in which paths end"
        passes.last.now.now.run(self._constant | uniforms)
        if passes.unlit:
            self._states.swap()
        else:
            self._sums.path_set_added()

    def _constant_uniforms(self) -> Uniforms:
        return {
            **self.scene.uniforms,
            **sky_uniforms(self.scene.scene.sky, self.lighting),
            **background_uniforms(self.scene.scene),
            "quanta": self._sums.quanta,
            "cosine_roulette": self.settings.cosine_roulette,
            "image_window": self._image_window(),
        }

    def _make_states(self, size: tuple[int, int]) -> None:
        # Start points and light of paths that wait for the scan along the direction of the set's distant light.
        self._pending = [self._texture(size, 4, "f4") for _ in range(2 if self._distant_buffer else 0)]
        self._states = PingPong(*(self._new_states(size) for _ in range(2)))
        self._textures = {
            **self.scene.textures,
            **self.shadow_buffer.textures,
            **self._hit_textures,
            "eye_buffer": self._eye_buffer,
            **self.path_buffer.textures,
            **(self._points.textures if self._points is not None else {}),
        }
        self._deep_textures = {**self._textures, **self._deep.textures, **self._deep_shadows.textures}
        depth = self.settings.path_length
        self._start_passes = self._vertex_passes(
            "first vertex", "path_buffer/path_start.frag", inner=depth > 1, last=depth == 1
        )
        if self._distant_buffer is not None:
            self._light_passes = self._deep_light_passes = self._distant_light_passes(self._distant_buffer)
            if self._deep_distant is not None and self._deep_distant is not self._distant_buffer:
                self._deep_light_passes = self._distant_light_passes(self._deep_distant)
            # Uniforms for passes that run before the first scan.
            self._distant_scan = {"permutation_seed": 0, "path_columns": size[0]}

    def _new_states(self, size: tuple[int, int]) -> PathStates:
        names = _STATE + (("path_direct",) if self.settings.splits_light else ())
        textures = {name: self._texture(size, 4, "f4") for name in names}
        position, beta, *light = textures.values()
        radiance, *direct = light
        target = self.gl.framebuffer([position, beta, radiance, *self._pending, *direct])
        return PathStates(position, dict(zip(names[2:], light, strict=True)), target, textures)

    def _program(self, fragment: str, beyond: ProgramParts, scene: DeviceScene) -> Program:
        sphere = {"WHOLE_SPHERE": 1} if self.settings.directions == "sphere" else {}
        return load_program(
            self.gl,
            vertex="gl/fullscreen.vert",
            fragment=fragment,
            generated=scene.generated | beyond.generated,
            defines={
                **scene.defines,
                **self._eye_defines,
                **self.path_buffer.defines,
                **self.shadow_buffer.defines,
                **sphere,
                **light_defines(self.scene.scene.sky, self.lighting),
                **self._sums.defines,
                **beyond.defines,
            },
        )

    def _vertex_passes(
        self,
        name: str,
        fragment: str,
        *,
        inner: bool,
        last: bool,
        parts: Part | None = None,
        lit: bool = True,
        deep: bool = False,
    ) -> VertexPasses:
        """Return the passes of a stage, only those that are needed.

        parts : program parts and textures in addition to those of the other stages
        lit  : True if the stage's vertices get light from the light sample
        deep : True if the stage's vertices are at least the second ones of their paths
        """
        scene, own = (self._deep, self._deep_textures) if deep else (self.scene, self._textures)
        unlit = lit and self._distant_buffer is not None
        beyond = ProgramParts() if parts is None else ProgramParts.of(parts)
        own = {**own, **beyond.textures}
        continuing: InTurn[Pass] | None = None
        ending: InTurn[InTurn[Pass]] | None = None
        if inner:
            program = self._program(fragment, beyond, scene)
            continuing = self._states.each(
                lambda read, write: Pass(name, self.gl, program, write.target, textures={**own, **read.textures})
            )
        if last:
            end = {"LAST_VERTEX": 1} | ({} if unlit else {"TO_SUMS": 1})
            ends = self._program(fragment, replace(beyond, defines=beyond.defines | end), scene)
            ending = self._states.each(
                lambda read, write: self._sums.sets.each(
                    lambda sums, new_sums: Pass(
                        name,
                        self.gl,
                        ends,
                        write.target if unlit else new_sums.target,
                        textures={**own, **read.textures, **sums.textures},
                    )
                )
            )
        return VertexPasses(continuing, ending, unlit)

    def _distant_light_passes(self, buffer: PathBuffer) -> VertexPasses:
        """Return the passes that add light from infinity, found by a scan, to the paths or to the sums."""
        name = "light from infinity"
        inner, last = (
            load_program(
                self.gl,
                vertex="gl/fullscreen.vert",
                fragment="path/path_light.frag",
                defines={**buffer.defines, **self._sums.defines, **end},
            )
            for end in ({}, {"LAST_VERTEX": 1})
        )
        start, light = self._pending
        textures = {**buffer.textures, "distant_start": start, "distant_light": light}
        return VertexPasses(
            self._states.each(
                lambda read, _: Pass(
                    name,
                    self.gl,
                    inner,
                    self.gl.framebuffer([*read.light.values()]),
                    blend="add",
                    textures=textures,
                )
            ),
            self._states.each(
                lambda read, _: self._sums.sets.each(
                    lambda sums, new_sums: Pass(
                        name, self.gl, last, new_sums.target, textures={**textures, **sums.textures, **read.light}
                    )
                )
            ),
        )


def _views(settings: PathBufferSettings | GatherSettings, bounce: int) -> int:
    """Return the number of shared directions from which each path selects one, for a bounce counted from 0."""
    return 2 if settings.directions == "pair" or (settings.directions == "lattice" and bounce > 0) else 1


def _cells(share: float, size: tuple[int, int]) -> tuple[int, int]:
    """Return (columns, rows) of a path-buffer view for a window of `size` pixels."""
    return max(1, round(share * size[0])), max(1, round(share * size[1]))
