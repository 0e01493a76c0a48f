"""A pass: one draw or dispatch with all the state it depends on.

moderngl's scopes restore neither blend nor depth function nor viewport. Therefore `Pass.run` sets the whole state
every time and relies on no earlier state.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.clear import clear_integers, holds_integers
from glpath.gl.context import context_of
from glpath.gl.program import Program

BLENDS: dict[str, tuple[int, tuple[int, int]]] = {
    "min": (moderngl.MIN, (moderngl.ONE, moderngl.ONE)),
    "max": (moderngl.MAX, (moderngl.ONE, moderngl.ONE)),
    "add": (moderngl.FUNC_ADD, (moderngl.ONE, moderngl.ONE)),
}


#: Maximum number of ray-primitive tests in one draw of a shader that loops over primitives. They take some tenths
#: of a second on a slow graphics card. A system's watchdog ends a program whose draw takes longer than a few
#: seconds (Windows: two).
TESTS_PER_DRAW = 1 << 28


def draw_areas(size: tuple[int, int], tests_per_pixel: int) -> list[tuple[int, int, int, int]]:
    """Return areas (x, y, width, height) that cover a window.

    Each needs at most TESTS_PER_DRAW tests, or is one pixel.
    """
    width, height = size
    pixels = max(1, TESTS_PER_DRAW // max(1, tests_per_pixel))
    if width * height <= pixels:
        return [(0, 0, width, height)]
    side = 1 << (pixels.bit_length() - 1) // 2  # a power of two, because llvmpipe distributes work in such squares
    return [
        (x, y, min(side, width - x), min(side, height - y))
        for y in range(0, height, side)
        for x in range(0, width, side)
    ]


def largest_point(gl: moderngl.Context) -> int:
    """Return the maximum side of a point on this device in pixels; OpenGL guarantees one."""
    return int(gl.info["GL_POINT_SIZE_RANGE"][1])


def _check_textures(name: str, program: Program, textures: Mapping[str, moderngl.Texture]) -> None:
    """Check that each texture of the program is given; a family of passes may offer more than the program uses."""
    missing = (set(program.samplers) | set(program.images)) - set(textures)
    assert not missing, f"{name}: no texture for {sorted(missing)}"


def _bind(
    program: Program,
    textures: Mapping[str, moderngl.Texture],
    buffers: Mapping[int, moderngl.Buffer],
    written: Collection[str] = (),
) -> None:
    for name, unit in program.samplers.items():
        textures[name].use(unit)
    for name, unit in program.images.items():
        textures[name].bind_to_image(unit, read=True, write=name in written)
    for binding, buffer in buffers.items():
        buffer.bind_to_storage_buffer(binding)


class TriangleIndices:
    """Index buffer of triangles: a vertex is transformed once, however many triangles share it.

    The vertex shader finds the vertex in the scene's store by gl_VertexID; the fragment shader has the triangle's
    number in gl_PrimitiveID.

    faces : (T, 3) uint32, vertex indices
    """

    def __init__(self, gl: moderngl.Context, faces: NDArray[np.uint32]) -> None:
        self.count = len(faces)
        # An empty buffer is an error.
        self.buffer = gl.buffer(np.ascontiguousarray(faces).tobytes() or bytes(12))

    @property
    def nbytes(self) -> int:
        return self.buffer.size


@dataclass
class Pass:
    """One draw: a program and the target, blend, depth and viewport state it depends on.

    name     : name of the stage in the paper; used in timings, GL debug groups and errors
    target   : framebuffer drawn to
    area     : (x, y, width, height) of the target that is drawn to and cleared; None for the whole target
    vertices : number of vertices per instance; no vertex buffers exist, vertices are pulled by gl_VertexID
    triangles : triangles to draw by index: gl_VertexID is a vertex of the scene
    blend    : None, "min", "max" or "add", for all attachments
    depth    : True to test depth (a fragment passes if it is nearer) and to write it
    clear    : colour that floats are cleared to before the draw (integers to 0), or None to keep the contents
    elements : a buffer of uint32, the gl_VertexID of every vertex, instead of 0, 1, 2 ...
    indirect : a buffer whose first words, written on the device, define the draw, instead of `vertices`: five words
               with `elements`, otherwise four
    points   : draw squares of gl_PointSize pixels about the vertices, not triangles; see `largest_point`
    buffers  : storage buffers by their binding, only for the fragment shader, because OpenGL 4.3 guarantees none to
               a vertex shader; a barrier follows the draw, so the next pass may use them at once
    written  : images among the textures that its fragment shader also writes
    """

    name: str
    gl: moderngl.Context
    program: Program
    target: moderngl.Framebuffer
    vertices: int = 3
    instances: int = 1
    blend: str | None = None
    depth: bool = False
    clip_distances: int = 0
    clear: tuple[float, float, float, float] | None = None
    textures: Mapping[str, moderngl.Texture] = field(default_factory=dict)
    buffers: Mapping[int, moderngl.Buffer] = field(default_factory=dict)
    elements: moderngl.Buffer | None = None
    indirect: moderngl.Buffer | None = None
    area: tuple[int, int, int, int] | None = None
    points: bool = False
    triangles: TriangleIndices | None = None
    written: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if self.triangles is not None:
            self.elements, self.vertices = self.triangles.buffer, 3 * self.triangles.count
        self._vertex_array = self.gl.vertex_array(self.program.gl, [], self.elements)
        self._flags = (moderngl.BLEND if self.blend else 0) | (moderngl.DEPTH_TEST if self.depth else 0)
        self._flags |= moderngl.PROGRAM_POINT_SIZE if self.points else 0
        self._mode = moderngl.POINTS if self.points else moderngl.TRIANGLES
        _check_textures(self.name, self.program, self.textures)

    def run(self, uniforms: Mapping[str, object], instances: int | None = None) -> None:
        """Set the whole state and draw; `instances` replaces the number of instances of the pass."""
        gl = self.gl
        instances = self.instances if instances is None else instances
        target = self.target
        area = self.area or (0, 0, *target.size)
        target.viewport = area
        target.scissor = None  # type: ignore[assignment]
        target.use()
        gl.enable_only(self._flags)  # this also disables culling
        gl.wireframe = False
        gl.polygon_offset = (0.0, 0.0)
        for i in range(self.clip_distances):
            gl.enable_direct(0x3000 + i)  # GL_CLIP_DISTANCE0
        if self.blend:
            equation, function = BLENDS[self.blend]
            gl.blend_equation = equation  # type: ignore[assignment]
            gl.blend_func = function
        if self.depth:
            gl.depth_func = "<"
            target.depth_mask = True
        if self.clear is not None:
            if holds_integers(target):
                clear_integers(target, area)
            else:
                target.clear(*self.clear, viewport=area)
        _bind(self.program, self.textures, self.buffers, self.written)
        self.program.set(uniforms)
        with gl.debug_scope(self.name):
            if self.indirect is None:
                self._vertex_array.render(self._mode, vertices=self.vertices, instances=instances)
            else:
                self._vertex_array.render_indirect(self.indirect, self._mode, count=1)
        context_of(gl).drawn()
        for i in range(self.clip_distances):
            gl.disable_direct(0x3000 + i)
        if self.buffers or self.written:
            gl.memory_barrier()


@dataclass
class PixelDispatch:
    """A compute shader with an invocation for each pixel of an area, in groups of 8 x 8.

    written : images among the textures that it writes; it reads the others
    area    : (x, y, width, height), the uniform of that name
    """

    name: str
    gl: moderngl.Context
    program: Program
    textures: Mapping[str, moderngl.Texture]
    written: frozenset[str]
    area: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        _check_textures(self.name, self.program, self.textures)

    def run(self, uniforms: Mapping[str, object]) -> None:
        """Set the whole state and run."""
        _bind(self.program, self.textures, {}, self.written)
        self.program.set({**uniforms, "area": self.area})
        _, _, width, height = self.area
        with self.gl.debug_scope(self.name):
            self.program.gl.run(-(-width // 8), -(-height // 8))  # type: ignore[union-attr]
        context_of(self.gl).drawn()
        self.gl.memory_barrier()


def run_in_areas(
    drawn: Pass | PixelDispatch, areas: Sequence[tuple[int, int, int, int]], uniforms: Mapping[str, object]
) -> None:
    """Draw area by area, see `draw_areas`, and wait after each of several areas.

    The wait keeps the device's watchdog from counting all areas as one task.
    """
    for area in areas:
        drawn.area = area
        drawn.run(uniforms)
        if len(areas) > 1:
            drawn.gl.finish()


@dataclass
class Dispatch:
    """One run of a compute shader with its inputs and outputs.

    name    : name of the stage in the paper
    buffers : buffers by their binding; the next pass may read them at once
    """

    name: str
    gl: moderngl.Context
    program: Program
    textures: Mapping[str, moderngl.Texture] = field(default_factory=dict)
    buffers: Mapping[int, moderngl.Buffer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_textures(self.name, self.program, self.textures)

    def run(self, uniforms: Mapping[str, object], groups: tuple[int, int]) -> None:
        """Run the given number of work groups across and down."""
        _bind(self.program, self.textures, self.buffers)
        self.program.set(uniforms)
        with self.gl.debug_scope(self.name):
            self.program.gl.run(*groups)  # type: ignore[union-attr]
        context_of(self.gl).drawn()
        self.gl.memory_barrier()


class Stopwatch:
    """Timer of the stages of a frame, in milliseconds.

    Off by default because of its cost. On a hardware device each stage is a GL timer query. On a software device
    such a query measures only the submission, so the stage is finished before and after.
    """

    def __init__(self, gl: moderngl.Context, hardware: bool, enabled: bool = False) -> None:
        self.enabled = enabled
        self.milliseconds: dict[str, float] = {}
        self._gl = gl
        self._hardware = hardware

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        if not self.enabled:
            yield
            return
        if self._hardware:
            query = self._gl.query(time=True)
            with query:
                yield
            spent = query.elapsed * 1e-6
        else:
            self._gl.finish()
            start = time.perf_counter()
            yield
            self._gl.finish()
            spent = (time.perf_counter() - start) * 1e3
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + spent
