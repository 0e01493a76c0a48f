"""Primary visibility, as (object, t) for every pixel: by the classical algorithm, and by the T-buffer [TB II].

Both shoot the ray through every pixel with the same routines (`scene/object_intersect.glsl`), so their results are
bit-identical; they differ in the rays that they shoot. The T-buffer takes object by object and shoots the rays that
may hit it: those of the pixels in a conservative projection. Two methods find the pixels of an object:

- *Drawn*: the rasteriser finds the pixels, and the depth test implements t' < t. A round sphere is a point of
  several pixels, a large one several points. If vertices dominate the cost, as in llvmpipe, one vertex replaces
  six.
- *Small*: one invocation of a compute shader loops over an object's few pixels. Setting up a triangle costs a
  rasteriser as much as many rays, in Mesa's llvmpipe in one thread. A million small triangles are six times as fast
  with this method.

Streamed triangles follow all others, chunk after chunk, into the same buffers. An object is needed only while rays
are shot at it, so a scene need not fit into memory [TB VI].

Source of the second: Karis et al. 2021, A Deep Dive into Nanite Virtualized Geometry.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import partial

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.gl import passes
from glpath.gl.camera import camera_defines, eye_uniforms, view_volume
from glpath.gl.clear import clear_integers
from glpath.gl.depth import DISTANCE_TO_DEPTH, float_depth_texture
from glpath.gl.device_scene import DeviceScene
from glpath.gl.geometry_stream import Kept, RecordPass, before_planes, of_chunks
from glpath.gl.memory import MODERNGL, check_texture_size
from glpath.gl.owner import Owner
from glpath.gl.passes import Dispatch, Pass, largest_point
from glpath.gl.program import Program, load_program
from glpath.gl.program_parts import ProgramParts
from glpath.scene.model import Camera
from glpath.system.arguments import checked

Uniforms = Mapping[str, object]


# Minimum number of primitives for a separate method for small ones: its compute shader takes a few passes over all
# pixels.
SPLIT_FROM = 32768

_GROUP = 64  # group size of t_buffer_small.comp
_WIDEST = 1 << 15  # maximum number of groups in x, below every device's limit
# Maximum side in pixels of the points that spheres are drawn as. Larger points would test more pixels in vain.
_SQUARE = 32
# Spheres are drawn as points if the device's largest point has at least this many pixels across. With smaller
# points, rectangles cost less.
_SMALLEST_SQUARE = 8
# GLSL constants. The upper bits of a pixel's word show how reliably a small primitive is its nearest; less is
# better.
_SURENESS = """
#define GROUP {group}
const uint NUMBER = 0x3fffffffu;
const uint EXACT = 0u;                  // it has the least t, and of those it is the lowest
const uint NEARLY_EXACT = 0x40000000u;  // as nearly as programs agree
const uint HIT = 0x80000000u;           // the ray meets it
const uint NOTHING = 0xffffffffu;
"""
_SQUARES_WIDTH = 1024  # width of the table of squares, texels
_NEAREST = (moderngl.NEAREST, moderngl.NEAREST)


class EyeBuffer(Owner, ABC):
    """Buffer of (object, t) for every pixel of a window.

    Parameters
    ----------
    size        : (width, height) of the window, pixels
    count_tests : True to count intersection tests exactly; slower

    Attributes
    ----------
    texture : RG32UI, row 0 at the bottom. The first channel is the number of the nearest primitive + 1, 0 for none;
              the second has the bits of the primitive's t, scene units. At equal t the lowest number wins
    """

    @partial(checked, namespace=MODERNGL)
    def __init__(
        self, gl: moderngl.Context, objects: DeviceScene, size: tuple[int, int], *, count_tests: bool = False
    ) -> None:
        check_texture_size(gl, "size", size)
        self.gl = gl
        self.objects = objects
        self.size = size
        self.texture = self._pair_texture()
        self._tests = gl.buffer(data=bytes(4 * size[0] * size[1])) if count_tests else None
        self._buffers = {0: self._tests} if self._tests else {}
        self._defines = objects.defines | camera_defines(objects.scene.camera)
        if count_tests:
            self._defines["COUNT_TESTS"] = 1

    @abstractmethod
    def fill(self, eye: Uniforms) -> None:
        """Find the first hit of every ray; `eye` comes from `gl.camera.eye_uniforms`."""

    @checked
    def fill_from(self, camera: Camera) -> None:
        """Find the first hits of rays through a camera's pixel centres; its resolution must be the window's."""
        if camera.resolution != self.size:
            raise UsageError(
                f"buffer of {self.size[0]} x {self.size[1]} pixels: a camera of "
                f"{camera.resolution[0]} x {camera.resolution[1]}",
                "Make the buffer as large as the camera's resolution.",
            )
        self.fill(eye_uniforms(camera))

    def read(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return (h, w) int32 primitive, -1 for none, and (h, w) float32 t, inf for none; row 0 at the top."""
        width, height = self.size
        found = np.frombuffer(self.texture.read(), np.uint32).reshape(height, width, 2)[::-1]
        primitive = found[..., 0].astype(np.int32) - 1
        return primitive, np.where(primitive < 0, np.float32(np.inf), found[..., 1].view(np.float32))

    def take_tests(self) -> int:
        """Return the number of intersection tests (ray-primitive pairs) since the last call."""
        if self._tests is None:
            return 0
        self.gl.memory_barrier()
        self.gl.finish()
        count = int(np.frombuffer(self._tests.read(), np.uint32).sum(dtype=np.uint64))
        self._tests.write(bytes(self._tests.size))
        return count

    def _pair_texture(self) -> moderngl.Texture:
        texture = self.gl.texture(self.size, 2, dtype="u4")
        texture.filter = _NEAREST
        return texture

    def _program(
        self,
        defines: Uniforms,
        *,
        vertex: str = "",
        fragment: str = "",
        compute: str = "",
        streamed: bool = False,
    ) -> Program:
        """Load a program, with the defines of the scene and the camera added.

        streamed : True if the scene's float texture holds a chunk of streamed triangles
        """
        scene = of_chunks(self._defines) if streamed else self._defines
        return load_program(
            self.gl,
            vertex=vertex,
            fragment=fragment,
            compute=compute,
            generated=self.objects.generated | {"T_BUFFER": _SURENESS.format(group=_GROUP)},
            defines=scene | dict(defines),
        )


class ClassicEye(EyeBuffer):
    """Primary rays of the classical algorithm: every ray against every primitive [TB I].

    Cost:     pixels x primitives, in draws of at most `TESTS_PER_DRAW`.
    Poor at:  many primitives.
    """

    def __init__(
        self, gl: moderngl.Context, objects: DeviceScene, size: tuple[int, int], *, count_tests: bool = False
    ) -> None:
        super().__init__(gl, objects, size, count_tests=count_tests)
        self._pass = Pass(
            "primary rays",
            gl,
            self._program(
                {"DEPTH_SCALE": DISTANCE_TO_DEPTH},
                vertex="gl/fullscreen.vert",
                fragment="t_buffer/classic_eye.frag",
            ),
            gl.framebuffer([self.texture], float_depth_texture(gl, size)),
            depth=True,
            textures=objects.textures,
            buffers=self._buffers,
        )

    def fill(self, eye: Uniforms) -> None:
        uniforms = self.objects.uniforms | dict(eye)
        count, width, height = self.objects.count, *self.size
        share = max(1, passes.TESTS_PER_DRAW // (width * height))
        for begin in range(0, max(count, 1), share):
            # Primitives are tested in the order of their numbers, so that at equal t the lowest number wins.
            self._pass.clear = (0.0, 0.0, 0.0, 0.0) if begin == 0 else None
            self._pass.run(uniforms | {"begin": begin, "end": min(begin + share, count)})
            if share < count:
                self.gl.finish()  # because the device's watchdog would count unfinished draws as one task


class TBuffer(EyeBuffer):
    """T-buffer: every primitive against the rays that may hit it [TB II].

    Parameters
    ----------
    split_from : minimum number of primitives for which a compute shader shoots at the small ones
    records    : table for the streamed triangles that are visible in pixels, see `GeometryStream.records`

    Cost:     the pixels that primitives cover, including hidden ones; about 0.1 µs a small primitive in llvmpipe.
    Poor at:  many large primitives behind each other. A primitive that crosses the plane of the eye within the view
              takes a test in every pixel.
    """

    @partial(checked, namespace=MODERNGL)
    def __init__(
        self,
        gl: moderngl.Context,
        objects: DeviceScene,
        size: tuple[int, int],
        *,
        count_tests: bool = False,
        split_from: int = SPLIT_FROM,
        records: moderngl.Texture | None = None,
    ) -> None:
        super().__init__(gl, objects, size, count_tests=count_tests)
        stream = objects.stream
        split = max(objects.numbering.first_plane, stream.count if stream is not None else 0) >= split_from
        drawn = self._pair_texture() if split else self.texture
        self._target = target = gl.framebuffer([drawn], float_depth_texture(gl, size))
        self._small: _SmallPrimitives | None = _SmallPrimitives(self, drawn) if split else None
        self._squares: _Squares | None = None
        self._draws: list[tuple[Pass, Uniforms]] = []
        for kind, numbers in objects.numbering.kinds.items():
            if not numbers:
                continue
            corners = 6 if kind in ("sphere", "ellipsoid") else 3
            plane = kind == "plane"
            small = self._small.kinds.get(kind) if self._small else None
            listed = small.large if small else None
            points = kind == "sphere" and not listed and largest_point(gl) >= _SMALLEST_SQUARE
            squares = _Squares(objects, size) if points else None
            defines: dict[str, object] = {f"KIND_{kind.upper()}": 1, "DEPTH_SCALE": DISTANCE_TO_DEPTH}
            if squares:
                defines |= {"SQUARES": 1, "SQUARES_WIDTH": _SQUARES_WIDTH}
            draw = Pass(
                f"t-buffer: {kind}s",
                gl,
                self._program(defines, vertex="t_buffer/t_buffer.vert", fragment="t_buffer/t_buffer.frag"),
                target,
                vertices=corners if plane else corners * len(numbers),
                instances=len(numbers) if plane else 1,
                depth=True,
                clip_distances=1 if plane else 0,
                clear=None if self._draws else (0.0, 0.0, 0.0, 0.0),
                textures=objects.textures | ({"squares": squares.texture} if squares else {}),
                buffers=self._buffers,
                elements=listed.elements if listed else None,
                indirect=listed.command if listed else None,
                points=squares is not None,
            )
            if squares:
                self._squares = squares
            self._draws.append((draw, {"first": numbers.start}))
        self._streamed: _StreamedTriangles | None = None
        if stream is not None:
            self._streamed = _StreamedTriangles(self, target, self._small, records)

    def fill(self, eye: Uniforms) -> None:
        uniforms = self.objects.uniforms | dict(eye)
        if self._small:
            self._small.shoot(uniforms)
        if self._squares:
            self._squares.bound(eye)
            spheres = self._draws[0][0]  # spheres have the lowest numbers, so their draw is first
            spheres.vertices = self._squares.count
            spheres.textures = self.objects.textures | {"squares": self._squares.texture}
            uniforms["square_side"] = self._squares.side
        if not self._draws:
            clear_integers(self._target, (0, 0, *self.size))
        for draw, own in self._draws:
            draw.run(uniforms | dict(own))
        if self._small:
            self._small.merge(uniforms)
        if self._streamed:
            self._streamed.run(uniforms, eye)


class _Squares:
    """Round spheres as squares of pixels, in the order of their numbers, so that at equal t the lowest wins.

    The number of squares that cover a sphere is overestimated here. The vertex shader computes their positions, and
    discards empty ones.

    texture : RG32UI, see t_buffer.vert
    count   : number of squares
    side    : side of the largest square, pixels
    """

    def __init__(self, objects: DeviceScene, size: tuple[int, int]) -> None:
        scene, numbers = objects.scene, objects.numbering
        # Round spheres to 32 bits as on the device, so that the bounds computed here hold for the shader's squares.
        spheres = scene.spheres[numbers.spheres[: numbers.first_ellipsoid]].astype(np.float32).astype(np.float64)
        self._parallel = scene.camera.projection == "orthographic"
        self._centres = spheres[:, :, 3]
        self._radii = np.linalg.norm(spheres[:, :, 0], axis=1)
        self._gl = objects.gl
        self._size = size
        # OpenGL draws squares as points, and drops those with a centre outside the window. No square is wider than
        # the window, so that all centres are inside.
        self.side = min(_SQUARE, largest_point(objects.gl), *size)
        self.count = 0
        self.texture = self._table(len(spheres))

    def _table(self, entries: int) -> moderngl.Texture:
        texture = self._gl.texture((_SQUARES_WIDTH, max(1, -(-entries // _SQUARES_WIDTH))), 2, dtype="u4")
        texture.filter = _NEAREST
        return texture

    def bound(self, eye: Uniforms) -> None:
        """Cover the spheres with squares for this camera."""
        position, forward = (
            np.asarray(eye[key], np.float32).astype(float) for key in ("eye_position", "eye_forward")
        )
        to_centre, radius = self._centres - position, self._radii
        depth, focal = to_centre @ forward, max(eye["eye_focal"])  # type: ignore[call-overload]
        square = depth**2 - radius**2
        tangent = np.sqrt(np.maximum(np.einsum("ij,ij->i", to_centre, to_centre) - radius**2, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            extent = 2.0 * focal * radius * tangent / square
        # The image of a sphere near the plane of the eye is unbounded.
        bounded = depth > 1.01 * radius
        if self._parallel:
            extent, bounded = 2.0 * focal * radius, np.ones(len(radius), np.bool_)
        max_extent = np.where(bounded, np.minimum(1.01 * extent + 4.0, 1e6), 1e6)
        across, down = (
            np.ceil(np.minimum(max_extent, length) / self.side).astype(np.int64) for length in self._size
        )
        squares = np.where(depth + 1.01 * radius > 0.0, across * down, 0)
        items = np.repeat(np.arange(len(squares)), squares)
        number = np.arange(len(items)) - np.repeat(np.cumsum(squares) - squares, squares)
        self.count = len(items)
        if self.count > self.texture.width * self.texture.height:
            self.texture = self._table(self.count)
        rows = -(-self.count // _SQUARES_WIDTH)
        entries = np.zeros((rows * _SQUARES_WIDTH, 2), np.uint32)
        entries[: self.count, 0], entries[: self.count, 1] = items, number | across[items] << 20
        if rows:
            self.texture.write(entries.tobytes(), viewport=(0, 0, _SQUARES_WIDTH, rows))


class _LargePrimitives:
    """Buffers for the draw of the large primitives of one kind, in the order of their numbers.

    marks    : one bit for each primitive, set if it is large
    elements : vertex indices of the large primitives, for t_buffer.vert, which may read no storage buffer
    command  : indirect draw command for these vertices
    """

    def __init__(self, gl: moderngl.Context, count: int, vertices: int) -> None:
        self.vertices = vertices
        self.marks = gl.buffer(data=bytes(4 * -(-count // 32)))
        self.elements = gl.buffer(reserve=4 * count * vertices)
        self.command = gl.buffer(reserve=20)


class _SmallKind:
    """Compute passes for one kind of primitives: they shoot at the small ones, and list the large ones.

    count    : maximum number of primitives
    words    : two values for each pixel: minimum t, and lowest number among the primitives with that t
    streamed : True for triangles of a chunk, whose texture is then among `textures`
    """

    def __init__(
        self,
        buffer: TBuffer,
        kind: str,
        count: int,
        words: tuple[moderngl.Buffer, moderngl.Buffer],
        streamed: bool = False,
    ) -> None:
        gl = buffer.gl
        self.large = large = _LargePrimitives(gl, count, 3 if kind == "triangle" else 6)
        self.textures = dict(buffer.objects.textures)
        rectangles = gl.buffer(reserve=8 * count)
        buffers = buffer._buffers | dict(zip((2, 3, 4, 6), (*words, large.marks, rectangles), strict=True))

        def stage(name: str, **more: object) -> Dispatch:
            define = {f"KIND_{kind.upper()}": 1, **more}
            program = buffer._program(define, compute="t_buffer/t_buffer_small.comp", streamed=streamed)
            return Dispatch(f"t-buffer: small {kind}s, {name}", gl, program, self.textures, buffers)

        self._first, self._second = stage("min t"), stage("lowest number", SECOND=1)
        self._lister = Dispatch(
            f"t-buffer: large {kind}s",
            gl,
            buffer._program({}, compute="t_buffer/t_buffer_list.comp"),
            buffers={1: large.elements, 4: large.marks, 5: large.command},
        )

    def find_min_t(self, uniforms: Uniforms, numbers: range) -> None:
        """Find the minimum t of the small primitives in each pixel, and list the large primitives."""
        self._run(self._first, uniforms, numbers)
        words = -(-len(numbers) // 32)
        self._lister.run(dict(uniforms) | {"words": words, "vertices": self.large.vertices}, (1, 1))

    def find_number(self, uniforms: Uniforms, numbers: range) -> None:
        """Find, in each pixel, the lowest number among the small primitives with the minimum t."""
        self._run(self._second, uniforms, numbers)

    def _run(self, stage: Dispatch, uniforms: Uniforms, numbers: range) -> None:
        groups = -(-len(numbers) // _GROUP)
        grid = (min(groups, _WIDEST), -(-groups // _WIDEST))
        stage.run(dict(uniforms) | {"first": numbers.start, "count": len(numbers)}, grid)


class _SmallPrimitives:
    """Compute passes of a T-buffer, for the small primitives of all kinds.

    words : two values for each pixel: minimum t so far, and lowest number among the primitives with that t
    kinds : stages for the small primitives of each kind
    """

    def __init__(self, buffer: TBuffer, drawn: moderngl.Texture) -> None:
        gl, objects = buffer.gl, buffer.objects
        width, height = buffer.size
        self._empty = gl.buffer(data=b"\xff" * (4 * width * height))
        self.words = gl.buffer(reserve=4 * width * height), gl.buffer(reserve=4 * width * height)
        self._gl = gl
        self._numbers = {
            kind: numbers for kind, numbers in objects.numbering.kinds.items() if numbers and kind != "plane"
        }
        self.kinds = {
            kind: _SmallKind(buffer, kind, len(numbers), self.words) for kind, numbers in self._numbers.items()
        }
        self._merge = Pass(
            "t-buffer: merge",
            gl,
            buffer._program({}, vertex="gl/fullscreen.vert", fragment="t_buffer/t_buffer_merge.frag"),
            gl.framebuffer([buffer.texture]),
            textures={"drawn": drawn},
            buffers=dict(zip((2, 3), self.words, strict=True)),
        )

    def shoot(self, uniforms: Uniforms) -> None:
        """Shoot at the small primitives, and list the large ones."""
        for words in self.words:
            self._gl.copy_buffer(words, self._empty)
        for kind, numbers in self._numbers.items():
            self.kinds[kind].find_min_t(uniforms, numbers)
        for kind, numbers in self._numbers.items():
            self.kinds[kind].find_number(uniforms, numbers)

    def merge(self, uniforms: Uniforms) -> None:
        """Write the nearer of the drawn and the small primitive of each pixel into the buffer's texture."""
        self._merge.run(uniforms)


class _StreamedTriangles:
    """Pass of a T-buffer for streamed triangles: chunk after chunk, after all resident primitives [TB VI].

    target  : framebuffer of the draws
    small   : compute passes for small primitives; None if all primitives are drawn
    records : table for the triangles that pixels see; None for no records
    """

    def __init__(
        self,
        buffer: TBuffer,
        target: moderngl.Framebuffer,
        small: _SmallPrimitives | None,
        records: moderngl.Texture | None,
    ) -> None:
        gl, objects, stream = buffer.gl, buffer.objects, buffer.objects.stream
        assert stream is not None, "who streams"
        self._stream, self._camera, self._all_small = stream, objects.scene.camera, small
        self._textures = dict(objects.textures)
        self._small: _SmallKind | None = None
        if small is not None:
            self._small = _SmallKind(buffer, "triangle", stream.largest, small.words, streamed=True)
        listed = self._small.large if self._small is not None else None
        self._draw = Pass(
            "t-buffer: streamed triangles",
            gl,
            buffer._program(
                {"KIND_TRIANGLE": 1, "DEPTH_SCALE": DISTANCE_TO_DEPTH},
                vertex="t_buffer/t_buffer.vert",
                fragment="t_buffer/t_buffer.frag",
                streamed=True,
            ),
            target,
            depth=True,
            textures=self._textures,
            buffers=buffer._buffers,
            elements=listed.elements if listed else None,
            indirect=listed.command if listed else None,
        )
        self._record: RecordPass | None = None
        if records is not None:
            parts = ProgramParts(
                textures=dict(objects.textures), generated=objects.generated, defines=of_chunks(objects.defines)
            )
            self._record = RecordPass("t-buffer", stream, parts, Kept(records, buffer.texture))

    def run(self, uniforms: Uniforms, eye: Uniforms) -> None:
        """Draw the chunks that may be visible, in the order of their numbers, so the lowest wins at equal t."""
        normals, offsets = view_volume(self._camera, dict(eye))
        seen = before_planes(self._stream.lower, self._stream.upper, normals, offsets)
        for index, texture, own in self._stream.on_device(seen):
            chunk = self._stream.chunks[index]
            numbers = range(chunk.first, chunk.first + chunk.size)
            given = {**uniforms, **own, "first": chunk.first}
            self._textures["scene_floats"] = texture
            if self._small is not None:
                self._small.textures["scene_floats"] = texture
                self._small.find_min_t(given, numbers)
                self._small.find_number(given, numbers)
            self._draw.vertices = 3 * chunk.size
            self._draw.run(given)
            if self._all_small is not None:
                self._all_small.merge(given)
            if self._record is not None:
                self._record.run(texture, given)
