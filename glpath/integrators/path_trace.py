"""Path tracing by scan conversion [PB 3, appendices A and B].

A path set is one path for every pixel. Its paths share their directions and one light point, so that a bounce is one
scan of the path-buffer and direct light one shadow-buffer. The frame is `PathTracer.trace_path_set`.

What is done otherwise than in the paper, and why:

- A direction serves both hemispheres, each path taking the side it can see: density 1/(2 pi) where the paper has
  1/(4 pi) and loses every other path. `directions="sphere"` is the paper's.
- Directions and light points come from a scrambled Sobol sequence; `sampling="random"` is the paper's.
- An emitter is found by the light sample and by the direction as well, weighed by the power heuristic (Veach 1997), so
  that light from near by, whose 1/r^2 has no bound, does not speckle. With the sphere it is the light sample alone, as
  in the paper's equation 5.
- A path that leaves its surface at a flat angle goes on with a chance of the cosine, else it would crowd the cells.

Poor at: sharp reflection (directions are shared, not chosen by the surface), and scenes that are lit only through
small openings.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.path_buffer import PathBuffer, ScanView
from glpath.buffers.shadow_buffer import HemicubeShadowBuffer
from glpath.gl.gpu_scene import GpuScene, triangle_glsl
from glpath.gl.passes import Pass, Stopwatch
from glpath.gl.program import Program, load_program
from glpath.sampling import PathSetSampler, Sampling, counter_hash, uniform_hemisphere, uniform_sphere

Directions = Literal["hemisphere", "sphere"]


@dataclass(frozen=True)
class PathTraceSettings:
    """What decides the picture besides the scene.

    max_depth  : vertices of a path; 1 is direct light only, 3 two bounces
    seed       : another seed is another, independent render
    sampling   : "sobol" or "random"
    directions : "hemisphere" (both, from one direction) or "sphere" (the paper's)
    ambient    : radiance (3,) assumed beyond the last vertex [PB A.2]
    roulette   : from this vertex on paths end by chance (Arvo & Kirk 1990); None: never
    light_resolution : texels along a hemicube's side
    cell_share : cells of the path-buffer along a side, in pixels of the window
    cosine_roulette  : paths whose cosine is below 1 / this are thinned; 0: none
    """

    max_depth: int = 5
    seed: int = 0
    sampling: Sampling = "sobol"
    directions: Directions = "hemisphere"
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roulette: int | None = None
    light_resolution: int = 384
    cell_share: float = 1.0
    cosine_roulette: float = 3.0

    def as_dict(self) -> dict[str, object]:
        return asdict(self)


class Sums(NamedTuple):
    """What path sets have added up to.

    radiance : (h, w, 3) float64, sum over path sets, row 0 at the top
    casts    : rays cast through the path-buffer
    lost     : of these, how many lost the roulette of their cell
    dropped  : samples that were not finite and count as 0
    """

    radiance: NDArray[np.float64]
    casts: int
    lost: int
    dropped: int


class PathTracer:
    """Traces path sets of one window of the image.

    Parameters
    ----------
    window : (x, y, width, height) in pixels of the whole image, y from the top; at most 2**20 pixels
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: GpuScene,
        settings: PathTraceSettings,
        window: tuple[int, int, int, int],
        *,
        hardware: bool,
    ) -> None:
        self.gl = gl
        self.scene = scene
        self.settings = settings
        self.window = window
        self.stopwatch = Stopwatch(gl, hardware)
        self._sampler = PathSetSampler(settings.seed, settings.max_depth, settings.sampling)
        size = window[2:]
        cells = tuple(max(1, round(n * settings.cell_share)) for n in size)
        self.path_buffer = PathBuffer(gl, scene, size, (cells[0], cells[1]))
        self.shadow_buffer = HemicubeShadowBuffer(gl, scene, settings.light_resolution)
        # The largest power of two such that radiance as bright as the lamp has 36 bits; see accumulate.frag.
        self._quanta = 2.0 ** (36 - int(np.ceil(np.log2(max(scene.brightest, 1e-30)))))
        self._constant = self._constant_uniforms()
        self._make_passes(size)

    # The frame.

    def trace_path_set(self, index: int) -> None:
        """One path for every pixel [PB table 3]."""
        sample = self._sampler[index]
        vertex = self.light_from(index, sample.light)
        vertex |= self.start_at_eye(index, sample.pixel, sample.directions, vertex)
        for depth in range(1, self.settings.max_depth):
            scan = self.scan_positions(index, depth, sample.directions)
            self.scan_scene(scan)
            self.advance(index, depth, sample.directions, vertex | scan)
        self.accumulate()

    def light_from(self, index: int, u: NDArray[np.float64]) -> dict[str, object]:
        """A light point and its shadow-buffer [PB 3.3]."""
        emitters = self.scene.emitters
        if emitters is None:
            frame = self.shadow_buffer.frame(self.scene.centre, np.array([0.0, 0.0, 1.0]), 0.0)
            return frame | {"light_radiance": (0.0, 0.0, 0.0), "light_density": 1.0}
        position, normal, radiance, density = emitters.sample(u)
        roll = 2.0 * np.pi * counter_hash(self.settings.seed, index, 0, 1) / 2**32
        frame = self.shadow_buffer.frame(position, normal, roll)
        with self.stopwatch.stage("shadow-buffer"):
            self.shadow_buffer.scan(frame)
        return frame | {"light_radiance": tuple(radiance), "light_density": density}

    def start_at_eye(
        self, index: int, pixel: NDArray[np.float64], directions: NDArray[np.float64], light: dict[str, object]
    ) -> dict[str, object]:
        """Primary hits, with a sub-pixel jitter that is the antialiasing, and direct light there."""
        eye = self._eye_uniforms(pixel)
        with self.stopwatch.stage("eye"):
            self._eye_pass.run(eye)
        with self.stopwatch.stage("first vertex"):
            self._start_pass.run(self._constant | eye | light | self._vertex_uniforms(index, 0, directions))
        self._current = 0
        return {}

    def scan_positions(self, index: int, depth: int, directions: NDArray[np.float64]) -> dict[str, object]:
        """z0 of every live path."""
        counter = [counter_hash(self.settings.seed, index, depth, use) for use in range(4)]
        view = ScanView(
            direction=self._direction(directions, depth - 1),
            roll=2.0 * np.pi * counter[0] / 2**32,
            jitter=(counter[1] / 2**32, counter[2] / 2**32),
            seed=counter[3],
        )
        with self.stopwatch.stage("scan positions"):
            return self.path_buffer.scan_positions(self._state[self._current][0], view)

    def scan_scene(self, scan: dict[str, object]) -> None:
        """The nearest surface beyond z0."""
        with self.stopwatch.stage("scan scene"):
            self.path_buffer.scan_scene(scan)

    def advance(
        self, index: int, depth: int, directions: NDArray[np.float64], uniforms: dict[str, object]
    ) -> None:
        """Radiance, throughput and new positions from what the scan found [PB table 6]."""
        with self.stopwatch.stage("advance"):
            self._advance_passes[self._current].run(
                self._constant | uniforms | self._vertex_uniforms(index, depth, directions)
            )
        self._current = 1 - self._current

    def accumulate(self) -> None:
        """Add the set to the sums."""
        with self.stopwatch.stage("accumulate"):
            self._accumulate_passes[self._current][self._sum].run({"quanta": self._quanta})
        self._sum = 1 - self._sum

    def take(self) -> Sums:
        """Read the sums back and start again from zero."""
        low, high = (
            np.frombuffer(t.read(), np.uint32).reshape(self.window[3], self.window[2], 4)[::-1]
            for t in self._sums[self._sum]
        )
        radiance = (high[..., :3] * 2.0**32 + low[..., :3]) / self._quanta
        for texture in self._sums[self._sum]:
            texture.write(bytes(16 * self.window[2] * self.window[3]))
        events = high[..., 3]
        return Sums(radiance, int(low[..., 3].sum()), int((events & 0xFFFFF).sum()), int((events >> 20).sum()))

    # What the frame is made of.

    def _direction(self, directions: NDArray[np.float64], bounce: int) -> NDArray[np.float64]:
        if self.settings.directions == "sphere":
            return uniform_sphere(directions[bounce])
        return uniform_hemisphere(directions[bounce])

    def _vertex_uniforms(self, index: int, depth: int, directions: NDArray[np.float64]) -> dict[str, object]:
        last = depth == self.settings.max_depth - 1
        direction = np.zeros(3) if last else self._direction(directions, depth)
        roulette = self.settings.roulette
        return {
            "next_direction": tuple(direction),
            "last_vertex": last,
            "roulette": roulette is not None and depth + 1 >= roulette,
            "random_seed": counter_hash(self.settings.seed, index, depth, 5),
        }

    def _constant_uniforms(self) -> dict[str, object]:
        sphere = self.settings.directions == "sphere"
        width, height = self.scene.scene.camera.resolution
        x, y, _, h = self.window
        return {
            "ambient": self.settings.ambient,
            "cosine_roulette": 0.0 if sphere else self.settings.cosine_roulette,
            "direction_density": 0.0 if sphere else 1.0 / (2.0 * np.pi),
            "image_window": (x, height - y - h, width, height),
        }

    def _eye_uniforms(self, pixel: NDArray[np.float64]) -> dict[str, object]:
        camera = self.scene.scene.camera
        right, up, forward = camera.frame()
        width, height = camera.resolution
        x, y, w, h = self.window
        tangent = np.tan(np.radians(camera.fov) / 2)
        # The point `pixel` of each pixel comes to lie on the centre of its fragment.
        jx, jy = pixel[0] - 0.5, 0.5 - pixel[1]
        reach = float(np.linalg.norm(self.scene.centre - camera.position)) + self.scene.radius
        return {
            "eye_position": tuple(camera.position),
            "eye_right": tuple(right),
            "eye_up": tuple(up),
            "eye_forward": tuple(forward),
            "eye_window": (
                height / (w * tangent),
                height / (h * tangent),
                (width - 2 * (x + jx)) / w - 1,
                (height - 2 * (height - y - h + jy)) / h - 1,
            ),
            "eye_size": (float(w), float(h)),
            "eye_range": (1e-5 * self.scene.radius, 1.01 * reach),
        }

    def _texture(self, size: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
        texture = self.gl.texture(size, components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def _make_passes(self, size: tuple[int, int]) -> None:
        gl = self.gl
        eye_buffer = self._texture(size, 1, "u4")
        # Position, beta and radiance of every path, twice: a pass reads the one and writes the other.
        self._state = [[self._texture(size, 4, "f4") for _ in range(3)] for _ in range(2)]
        self._current = 0
        self._sums = [[self._texture(size, 4, "u4") for _ in range(2)] for _ in range(2)]
        self._sum = 0
        for texture in self._sums[0]:
            texture.write(bytes(16 * size[0] * size[1]))
        targets = [gl.framebuffer(state) for state in self._state]
        defines = dict(self.path_buffer.defines)
        if self.settings.directions == "sphere":
            defines["WHOLE_SPHERE"] = 1

        def program(fragment: str, vertex: str = "fullscreen.vert") -> Program:
            return load_program(
                gl,
                vertex=vertex,
                fragment=fragment,
                generated={"TRIANGLE": triangle_glsl()},
                defines=defines,
            )

        textures = {
            "triangles": self.scene.texture,
            "light_buffer": self.shadow_buffer.texture,
            "eye_buffer": eye_buffer,
            **self.path_buffer.textures,
        }
        self._eye_pass = Pass(
            "eye",
            gl,
            program("eye.frag", "eye.vert"),
            gl.framebuffer([eye_buffer], gl.depth_texture(size)),
            vertices=3 * self.scene.count,
            depth=True,
            clear=(0.0, 0.0, 0.0, 0.0),
            textures=textures,
        )
        self._start_pass = Pass("first vertex", gl, program("path_start.frag"), targets[0], textures=textures)
        advance = program("path_advance.frag")
        accumulate = program("accumulate.frag")
        names = ("path_position", "path_beta", "path_radiance")
        self._advance_passes = [
            Pass(
                "advance",
                gl,
                advance,
                targets[1 - i],
                textures=textures | dict(zip(names, self._state[i], strict=True)),
                buffers=self.path_buffer.buffers,
            )
            for i in range(2)
        ]
        sums = [gl.framebuffer(pair) for pair in self._sums]
        self._accumulate_passes = [
            [
                Pass(
                    "accumulate",
                    gl,
                    accumulate,
                    sums[1 - j],
                    textures={
                        "path_radiance": self._state[i][2],
                        "sum_low": self._sums[j][0],
                        "sum_high": self._sums[j][1],
                    },
                )
                for j in range(2)
            ]
            for i in range(2)
        ]
