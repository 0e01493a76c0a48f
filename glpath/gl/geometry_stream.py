"""Streamed triangles on the device: drawn chunk by chunk in every pass, within a memory budget.

A scan draws the resident triangles first, and then the visible chunks, in the order of their numbers, into the same
buffers. A z-buffer needs no scene in memory [PB 2.2], nor does a T-buffer [TB VI]. While a chunk is on the device,
shading data of triangles that a buffer now names are copied into records, one for each texel. If a later chunk
hides a triangle, its record is overwritten. So each scan reads each chunk once and looks up nothing afterwards.

Chunks stay on the device as far as the budget allows; the others share one more slot.

Cost:     64 bytes a triangle on the device, and a record of 64 bytes for each pixel and each texel of the
          shadow-buffer. Preparing and drawing a chunk takes some 1000 bytes a triangle. Each chunk costs a draw
          and, with records, a dispatch over the buffer's texels.
Poor at:  chunks of few triangles; triangles in random order, so that every view sees every chunk.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass, PixelDispatch
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.small_triangles import SmallTriangles, TriangleList
from glpath.gl.texel_store import WIDTH
from glpath.scene.model import Scene, unit_normals

Float64 = NDArray[np.float64]
Uniforms = dict[str, object]

_TEXEL = 16
#: Bytes a triangle while a chunk is prepared (corners, edges, normals, texels) and drawn by llvmpipe.
_IN_THE_MAKING = 1000


def facet_planes(triangles: Float64, normals: Float64) -> Float64:
    """Return planes (T, 4) of triangles (T, 3, 3): unit normals (T, 3), and each one's dot product with a point."""
    # The offset is computed from the rounded normal, because large coordinates would otherwise shift the plane.
    rounded = normals.astype(np.float32).astype(np.float64)
    offset = np.einsum("ij,ij->i", rounded, triangles.mean(axis=1))
    return np.column_stack([normals, offset])


class Chunk(NamedTuple):
    """Chunk of a scene's streamed triangles.

    stream, number : index into `Shapes.streams`, and index within the stream
    shape          : index of the shape
    first, size    : number of the chunk's first triangle, and number of its triangles
    """

    stream: int
    number: int
    shape: int
    first: int
    size: int


@dataclass
class _ChunkSlot:
    """Texture that holds a chunk: corners, three texels a triangle, then the planes from `facet_base` on."""

    texture: moderngl.Texture
    holds: int = -1  # index of the chunk in the texture, -1 for none


class GeometryStream(Owner):
    """Streamed triangles of a scene.

    Parameters
    ----------
    first  : number of the first streamed triangle, equal to the number of resident primitives
    budget : MiB for all streamed data, on the device and in main memory

    Attributes
    ----------
    chunks : list of chunks, in the order of their triangles' numbers
    lower, upper : (N, 3) corners of the chunks' bounding boxes, world space
    count  : number of all streamed triangles
    largest : number of triangles in the largest chunk
    """

    def __init__(self, gl: moderngl.Context, scene: Scene, first: int, budget: int) -> None:
        self.gl = gl
        self._scene = scene
        self._budget = budget
        self._streams = [stream for _, stream in scene.shapes.streams]
        self.chunks: list[Chunk] = []
        for which, (shape, stream) in enumerate(scene.shapes.streams):
            for number, count in enumerate(stream.counts.tolist()):
                self.chunks.append(Chunk(which, number, shape, first, count))
                first += count
        self.count = sum(chunk.size for chunk in self.chunks)
        self.lower = np.concatenate([stream.lower for stream in self._streams])
        self.upper = np.concatenate([stream.upper for stream in self._streams])
        self.largest = max(chunk.size for chunk in self.chunks)
        self._records: list[moderngl.Texture] = []
        self._slots: list[_ChunkSlot] = []
        self._others = (0, 0)  # bytes reserved for others, see `leave_room`
        self._read: tuple[int, Float64] | None = None  # index and triangles of the last chunk that was read
        corner_rows, plane_rows = (-(-texels // WIDTH) for texels in (3 * self.largest, self.largest))
        self._rows = corner_rows + plane_rows
        self._facet_base = corner_rows * WIDTH
        # Lists the triangles of a chunk that are drawn, if not all are; long enough for two views.
        self.listed = TriangleList(gl, 2 * self.largest)

    def records(self, size: tuple[int, int]) -> moderngl.Texture:
        """Create an empty table of records for a buffer of (columns, rows) texels; see `stream_records.glsl`."""
        limit = int(self.gl.info["GL_MAX_TEXTURE_SIZE"])
        if max(size[0], 4 * size[1]) > limit:
            raise UsageError(
                f"records of streamed triangles for a buffer of {size[0]} x {size[1]} texels; this device has "
                f"textures of at most {limit} rows, and a record takes four.",
                "Choose a lower light_resolution.",
            )
        texture = self.gl.texture((size[0], 4 * size[1]), 4, dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._records.append(texture)
        return texture

    def bits(self, size: tuple[int, int]) -> moderngl.Texture:
        """Create a texture of (columns, rows) R32UI texels; its bytes count towards the budget, like records."""
        texture = self.gl.texture(size, 1, dtype="u4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._records.append(texture)
        return texture

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return self._in_records + len(self._slots) * self._slot_bytes + self.listed.elements.size

    def radius_about(self, centre: Float64) -> float:
        """Return the distance from the centre to the farthest corner. Reads all chunks."""
        return max(
            float(np.linalg.norm(triangles.reshape(-1, 3) - centre, axis=1).max())
            for stream in self._streams
            for triangles in stream
        )

    @property
    def left(self) -> int:
        """Bytes of the budget that records and one chunk leave, for other representations of the triangles."""
        return (self._budget << 20) - self._in_records - self._slot_bytes

    @property
    def making(self) -> int:
        """Bytes for preparing a chunk."""
        return _IN_THE_MAKING * self.largest

    def leave_room(self, working: int, kept: int) -> None:
        """Reserve bytes of the budget for other uses: `working` while no chunk is prepared, `kept` permanently.

        Raises UsageError if the budget has no room for them.
        """
        self._others = working, kept
        self._check()

    def reserve(self) -> None:
        """Create the chunk slots, after all records. Raises UsageError if the budget has no room for them."""
        self._check()
        room = (self._budget << 20) - self._in_records - self._beside
        count = min(len(self.chunks), room // self._slot_bytes)
        for _ in range(count - len(self._slots)):
            texture = self.gl.texture((WIDTH, self._rows), 4, dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._slots.append(_ChunkSlot(texture))

    def on_device(self, seen: NDArray[np.bool_]) -> Iterator[tuple[int, moderngl.Texture, Uniforms]]:
        """Yield index, texture and uniforms of each chunk that `seen`, (N,) bool, selects, one after the other."""
        if not self._slots:
            self.reserve()
        for index in np.flatnonzero(seen):
            slot = self._slots[min(int(index), len(self._slots) - 1)]
            chunk = self.chunks[index]
            if slot.holds != index:
                self._fill(slot.texture, int(index))
                slot.holds = int(index)
            yield (
                int(index),
                slot.texture,
                {
                    "vertex_base": 0,
                    "facet_base": self._facet_base,
                    "chunk_first": chunk.first,
                    "chunk_count": chunk.size,
                    "chunk_shape": chunk.shape,
                },
            )
            # Wait for the draw, because a driver would otherwise hold the triangles of several chunks at a time. In
            # llvmpipe these are a hundred megabytes.
            self.gl.finish()
        self._read = None

    def triangles(self, index: int) -> Float64:
        """Return (F, 3, 3) float64 corners of the chunk that `on_device` yielded last.

        The chunk is read again unless its triangles are cached.
        """
        if self._read is not None and self._read[0] == index:
            return self._read[1]
        chunk = self.chunks[index]
        return self._streams[chunk.stream].triangles(chunk.number)

    @property
    def _in_records(self) -> int:
        return sum(4 * texture.components * texture.width * texture.height for texture in self._records)

    @property
    def _slot_bytes(self) -> int:
        return _TEXEL * WIDTH * self._rows

    @property
    def _beside(self) -> int:
        """Bytes needed beyond records and slots: the larger of two needs that never coincide.

        These are preparing a chunk, and the work of other users of the budget.
        """
        working, kept = self._others
        return max(self.making + kept, working)

    def _check(self) -> None:
        """Raise UsageError if the budget has no room for one chunk beyond the records and the reserved bytes."""
        records = self._in_records
        needed = records + self._beside + self._slot_bytes
        if needed > self._budget << 20:
            raise UsageError(
                f"geometry_budget: {self._budget} MiB, but {-(-needed // (1 << 20))} are needed at least: "
                f"{-(-records // (1 << 20))} for what pixels and the shadow-buffer's texels see, the rest for a "
                f"chunk of {self.largest:,} triangles.",
                "Give it more, stream smaller chunks, render fewer pixels, or with a lower light_resolution where "
                "that is an option.",
            )

    def _fill(self, texture: moderngl.Texture, index: int) -> None:
        self._read = None
        triangles = self.triangles(index)
        self._read = index, triangles
        for texels, row in (
            (triangles.reshape(-1, 3), 0),
            (facet_planes(triangles, unit_normals(triangles)), self._facet_base // WIDTH),
        ):
            rows = -(-len(texels) // WIDTH)
            table = np.zeros((rows * WIDTH, 4), np.float32)
            table[: len(texels), : texels.shape[1]] = texels
            texture.write(table, viewport=(0, row, WIDTH, rows))


class Kept(NamedTuple):
    """Destination of the records of the streamed triangles that a scan hits, for shading.

    records : table of records, from `stream.records`
    seen    : buffer of triangle numbers + 1 that selects the triangles; None if a scan of the path-buffer selects
              them for each path
    paths   : (columns, rows) of the paths of such a scan
    """

    records: moderngl.Texture
    seen: moderngl.Texture | None = None
    paths: tuple[int, int] | None = None


class RecordPass:
    """Pass that stores the records of a chunk's triangles while the chunk is on the device.

    name  : name of the pass that finds the triangles
    parts : includes of the program
    """

    def __init__(self, name: str, stream: GeometryStream, parts: ProgramParts, kept: Kept) -> None:
        of: dict[str, object] = {"OF_PATHS": 1}
        if kept.seen is not None:
            of = {"EYE_FORMAT": ("r32ui", "rg32ui")[kept.seen.components - 1]}
        program = load_program(
            stream.gl, compute="scene/stream_record.comp", generated=parts.generated, defines=parts.defines | of
        )
        self._textures = {**parts.textures, "kept_records": kept.records}
        if kept.seen is not None:
            self._textures["seen_buffer"] = kept.seen
        size = kept.paths if kept.seen is None else kept.seen.size
        assert size is not None, "either paths or what is seen"
        self._dispatch = PixelDispatch(
            f"{name}: records",
            stream.gl,
            program,
            self._textures,
            frozenset({"kept_records"}),
            area=(0, 0, *size),
        )

    def run(self, texture: moderngl.Texture, uniforms: Mapping[str, object]) -> None:
        """Store the records of the chunk in `texture`, with its uniforms from `GeometryStream.on_device`."""
        self._textures["scene_floats"] = texture
        self._dispatch.run(uniforms)


def of_chunks(defines: Mapping[str, object]) -> dict[str, object]:
    """Return the defines for programs that draw a scene's chunks.

    Streamed triangles are opaque, so the data of transparent geometry are left out.
    """
    return {name: value for name, value in defines.items() if name != "HAS_ALPHA"} | {"STREAMED_CHUNK": 1}


class StreamedScan:
    """Pass that draws the streamed triangles, after a pass over the resident ones.

    name, target, state : arguments of the `Pass` for a chunk, which clears nothing
    shaders  : vertex and fragment shader, compiled with STREAMED_CHUNK
    parts    : includes of the shaders
    kept     : destination of the records for shading; None to store none
    words    : buffer of a scan of the path-buffer with the paths' hits of small triangles; None if all triangles
               are drawn
    """

    def __init__(
        self,
        name: str,
        stream: GeometryStream,
        shaders: tuple[str, str],
        parts: ProgramParts,
        target: moderngl.Framebuffer,
        *,
        kept: Kept | None = None,
        words: moderngl.Buffer | None = None,
        **state: object,
    ) -> None:
        self._stream = stream
        self._small = None
        (vertex, fragment), generated = shaders, parts.generated
        plain = of_chunks(parts.defines)
        self._textures = dict(parts.textures)
        listed: dict[str, object] = {}
        if words is not None:
            small = ProgramParts(textures=self._textures, generated=generated, defines=plain)
            blend = str(state["blend"])
            self._small = SmallTriangles(name, stream.gl, small, target, words, stream.listed, blend=blend)
            state |= {"elements": stream.listed.elements, "indirect": stream.listed.command}
            listed = stream.listed.defines
        program = load_program(
            stream.gl, vertex=vertex, fragment=fragment, generated=generated, defines=plain | listed
        )
        self._pass = Pass(name, stream.gl, program, target, textures=self._textures, **state)  # type: ignore[arg-type]
        self._record = None
        if kept is not None:
            kept_parts = ProgramParts(textures=parts.textures, generated=generated, defines=plain)
            self._record = RecordPass(name, stream, kept_parts, kept)

    def run(
        self,
        uniforms: Mapping[str, object],
        seen: NDArray[np.bool_],
        *,
        instances: int = 1,
        faces: Sequence[NDArray[np.bool_]] | None = None,
    ) -> None:
        """Draw the chunks that `seen`, (N,) bool, selects, and store their records.

        faces : for a cube, the chunks that each face sees; each face is drawn separately
        """
        for index, texture, own in self._stream.on_device(seen):
            given = {**uniforms, **own}
            self._textures["scene_floats"] = texture
            size = self._stream.chunks[index].size
            self._pass.vertices = 3 * size
            if self._small is not None:
                self._small.run(given, size)
                given["listed_of"] = size
            if faces is None:
                self._pass.run(given, instances)
            else:
                for face, of_face in enumerate(faces):
                    if of_face[index]:
                        self._pass.run(given | {"cube_face": face})
            if self._record is not None:
                self._record.run(texture, given)


def before_planes(lower: Float64, upper: Float64, normals: Float64, offsets: Float64) -> NDArray[np.bool_]:
    """Return (N,) bool: True for a box that extends into the region normal . x > offset of every plane.

    Each plane is tested separately, so a box may pass that is outside the region common to all planes.

    lower, upper     : (N, 3) corners of the boxes
    normals, offsets : (P, 3) and (P,), the planes
    """
    centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    farthest = centre @ normals.T + half @ np.abs(normals).T
    return np.asarray((farthest > offsets).all(axis=1))
