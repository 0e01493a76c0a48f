"""Path-buffer: z-buffer with a near value per pixel [PB 2].

One scan conversion of the scene along a direction finds, for every origin in the buffer, the nearest surface beyond
that origin. So one draw of the scene casts many parallel rays, from arbitrary origins.

Differences from the paper:

- *Sub-pixel positions.* The paper starts a ray at the centre of the nearest pixel. Here the fragment shader tests
  coverage and depth at the ray's own position in the cell, and triangles are enlarged to every cell they touch. The
  result equals that of a ray caster for any buffer size: no acne, no seams, no leaks at edges.
- *Both hemispheres.* A ray may look along the direction or against it; one scan serves both.
- *Small triangles.* If triangles touch few cells each, a compute shader scans them, see `gl.small_triangles`.
- *Four rays a cell.* Up to four rays of one cell use its four layers, the channels of a texel. Further rays are
  lost by collision. This causes no bias, because the four survivors represent all rays of the cell [PB appendix B].

Cost:     one draw of the scene per direction for any number of origins; a few passes over origins and cells.
Poor at:  few origins in a large scene; origins that crowd into few cells.
Limits:   2**20 origins a scan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.buffers.frame import tight_frame
from glpath.errors import UsageError
from glpath.gl.constants import DEPTH_BASE, INFINITE_DEPTH, MIN_NORMAL, NUMBER_BITS, PATH_LOST, PATH_MISSED
from glpath.gl.device_scene import DeviceScene
from glpath.gl.geometry_stream import Kept, StreamedScan, before_planes
from glpath.gl.memory import MODERNGL, check_texture_size
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass
from glpath.gl.program import Program, load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.small_triangles import SmallTriangles, TriangleList, empty_words
from glpath.gl.uniforms import vectors
from glpath.system.arguments import check_count, checked, short_repr

MAX_PATHS = 1 << NUMBER_BITS
#: Maximum bits of a triangle number that is packed with the depth into one 32-bit float. With more bits, the depth
#: would have too few levels; a first scan then finds the depth and a second the number.
MAX_PACKED_BITS = 17
# Possible numbers of bits for a triangle's number; a scene gets the smallest that suffices.
_ID_BITS = (8, 11, 14, 15, 16, MAX_PACKED_BITS)
#: Maximum ratio of cells to triangles at which a compute shader scans small triangles. At such ratios, most
#: triangles touch few cells.
SPLIT_CELLS = 16
_EPOCHS = (1 << 32 - NUMBER_BITS) - 1
_NEAREST = (moderngl.NEAREST, moderngl.NEAREST)


@dataclass(frozen=True)
class ScanView:
    """Directions of one scan, and its random values.

    directions : one or two (3,) unit directions, at most as many as the buffer has views; a path looks along one of
                 them or against it
    jitter    : (2,) in [0, 1), offset of the grid of cells, in cells
    seed      : seed that selects which rays survive in a crowded cell
    """

    directions: tuple[NDArray[np.float64], ...]
    jitter: tuple[float, float] = (0.5, 0.5)
    seed: int = 0


@dataclass(frozen=True)
class Scan:
    """Prepared scan: input of `scan_scene` and of the passes that read the scan's result.

    frames   : for each view, the unit axes u and v, each (3,), along its columns and rows
    uniforms : uniforms of shaders that include path_view.glsl, ray_record.glsl or path_result.glsl
    """

    frames: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]
    uniforms: dict[str, object]


class Hits(NamedTuple):
    """Hits of rays.

    triangle : (N,) int32, number of the triangle, -1 for a miss
    t        : (N,) float64, distance along the ray, inf for a miss
    """

    triangle: NDArray[np.int32]
    t: NDArray[np.float64]


class Cells(NamedTuple):
    """Contents of the buffer after a scan; up to four rays a cell, row 0 at the top.

    z0       : (rows, columns, 4) float32, start of each ray: scene units along the direction from the scene's
               centre; NaN for no ray
    triangle : (rows, columns, 4) int32, number of the triangle that the ray hit, -1 for none
    t        : (rows, columns, 4) float32, distance along the ray, inf for none
    """

    z0: NDArray[np.float32]
    triangle: NDArray[np.int32]
    t: NDArray[np.float32]


class _Stage(NamedTuple):
    """Passes that scan the scene once.

    small    : pass that scans the small triangles and lists the others; None if few triangles are small
    drawn    : draw of the listed triangles, or of all if there is no list
    streamed : pass for the streamed triangles, run after the others
    """

    small: SmallTriangles | None
    drawn: Pass
    streamed: StreamedScan | None


class PathBuffer(Owner):
    """Casts parallel rays by scan conversion.

    Parameters
    ----------
    gl    : OpenGL context
    scene : scene to scan
    paths : (columns, rows) of the path states; columns * rows <= 2**20
    cells : (columns, rows) of each view; by default, all views together have as many cells as paths
    views : 1, or 2: a scan may then have two directions, and each path takes one of them
    records : table for the streamed triangles that paths hit, see `GeometryStream.records`
    skips_near : True if paths ignore hits on simplified shapes near their start. The minimum distance of a hit is
                 the shape's deviation (`deviations` of `DeviceScene`) times `skipped_share` (of `scan_scene`)
    occlusion : True if scans find only whether a ray hits anything

    `cast` is the simple interface, from arrays to arrays. A caller with path states on the device calls
    `scan_positions` and `scan_scene`. It reads the result in its own shader that includes `path_result.glsl`, with
    `textures` and the uniforms of the scan that `scan_positions` returned.
    """

    @partial(checked, namespace=MODERNGL)
    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        paths: tuple[int, int],
        cells: tuple[int, int] | None = None,
        views: int = 1,
        records: moderngl.Texture | None = None,
        skips_near: bool = False,
        occlusion: bool = False,
    ) -> None:
        for name, size in (("paths", paths), ("cells", cells)):
            if size is not None:
                check_texture_size(gl, f"path-buffer: {name}", size)
        check_count("path-buffer: views", views, 1, 2)
        if paths[0] * paths[1] > MAX_PATHS:
            raise UsageError(
                f"path-buffer: {paths[0]} x {paths[1]} paths; one scan holds at most {MAX_PATHS}",
                "Cast them in several calls, or render the image in tiles.",
            )
        self.gl = gl
        self.scene = scene
        self.paths = paths
        share = views**-0.5
        cells = cells or (max(1, round(share * paths[0])), max(1, round(share * paths[1])))
        self.views = views
        # The views of a scan lie side by side in one buffer. A scan with one view uses the whole buffer.
        self.cells = cells = (views * cells[0], cells[1])
        count = cells[0] * cells[1]
        self._stream = scene.stream
        triangles = scene.triangle_count + (self._stream.count if self._stream is not None else 0)
        bits = (triangles - 1).bit_length()
        # The number of bits is rounded up in steps, so that most small scenes share their programs. Compiling a
        # program takes longer than running it.
        self.id_bits = next((step for step in _ID_BITS if step >= bits), bits)
        self.occlusion = occlusion
        self.packed = self.id_bits <= MAX_PACKED_BITS and not occlusion
        self.defines: dict[str, object] = {"NOTHING_FOUND": "3e38", "VIEWS": views}
        if skips_near:
            self.defines["SKIPS_NEAR"] = 1
        if occlusion:
            self.defines["OCCLUSION"] = 1
        elif self.packed:
            # So many depth levels that the largest packed word, as a float, stays below NOTHING_FOUND. 64 levels
            # stay unused, because the shader may round a level up.
            self.defines |= {
                "PACKED": 1,
                "ID_BITS": self.id_bits,
                "DEPTH_LEVELS": (0x7E000000 >> self.id_bits) - 64,
            }
        self._epoch = 0

        self._ray_records = self._texture(paths, "u4")
        self._heads = self._texture(cells, "u4", 1)
        self._slots = self._texture(cells, "u4")
        self._z0 = self._texture(cells, "f4")
        self._position = self._texture(cells, "u4")
        self._found = self._texture(cells, "f4")
        # The grid of bounds is wide and low, because llvmpipe distributes work to its threads in tiles of 64 x 64
        # texels.
        self._grid_size = (min(128, paths[0]), min(8, paths[1]))
        self._grids = [self._texture(self._grid_size, "f4") for _ in range(views)]
        self._bounds = self._texture((views, 1), "f4")

        self._textures = textures = {
            **scene.textures,
            "path_position": self._found,  # placeholder until the first scan
            "path_grid_0": self._grids[0],
            "path_grid_1": self._grids[-1],
            "path_bounds": self._bounds,
            "ray_records": self._ray_records,
            "cell_heads": self._heads,
            "cell_z0": self._z0,
            "cell_position": self._position,
            "cell_slots": self._slots,
        }
        self.textures = {
            "ray_records": self._ray_records,
            "cell_slots": self._slots,
            "cell_found": self._found,
        }
        self._report: tuple[Pass, moderngl.Texture] | None = None

        def program(fragment: str, vertex: str = "gl/fullscreen.vert", **defines: object) -> Program:
            return load_program(
                gl,
                vertex=vertex,
                fragment=fragment,
                generated=scene.generated,
                defines=scene.defines | self.defines | defines,
            )

        def target(*attachments: moderngl.Texture) -> moderngl.Framebuffer:
            return gl.framebuffer(list(attachments))

        bounds = program("path_buffer/path_bounds.frag", FROM_PATHS=1)
        self._position_passes = [
            Pass("bounds of the paths", gl, bounds, target(*self._grids), textures=textures),
            Pass(
                "bounds of the grid",
                gl,
                program("path_buffer/path_bounds.frag"),
                target(self._bounds),
                textures=textures,
            ),
            Pass(
                "launch",
                gl,
                program("path_buffer/path_launch.frag"),
                target(self._ray_records),
                textures=textures,
                written=frozenset({"cell_heads"}),
            ),
        ]
        self._cell_pass = Pass(
            "cells",
            gl,
            program("path_buffer/path_cells.frag"),
            target(self._z0, self._position, self._slots),
            textures=textures,
        )
        split = count <= SPLIT_CELLS * triangles
        self._words = empty_words(gl, cells) if split else None
        self._listed = TriangleList(gl, views * scene.triangle_count) if split else None
        self._stages = self._scan_stages(records)

    def _scan_stages(self, records: moderngl.Texture | None) -> list[_Stage]:
        if self.packed or self.occlusion:
            return [self._stage("scan scene", {}, self._found, "min", 3e38, records)]
        nearest = self._textures["cell_nearest"] = self._texture(self.cells, "f4")
        return [
            self._stage("scan depth", {"NEAREST": 1}, nearest, "min", 1e30),
            self._stage("scan triangle", {"AT_NEAREST": 1}, self._found, "max", 0.0, records),
        ]

    def _stage(
        self,
        name: str,
        defines: dict[str, object],
        found: moderngl.Texture,
        blend: str,
        empty: float,
        records: moderngl.Texture | None = None,
    ) -> _Stage:
        """Create the passes that scan all triangles into `found`, which each scan first clears to `empty`."""
        gl, scene, clear = self.gl, self.scene, (empty,) * 4
        shaders = "path_buffer/path_scan.vert", "path_buffer/path_scan.frag"
        parts = ProgramParts(
            textures=self._textures, generated=scene.generated, defines=scene.defines | self.defines | defines
        )
        target = gl.framebuffer([found])
        small = None
        if self._words is not None and self._listed is not None:
            small = SmallTriangles(name, gl, parts, target, self._words, self._listed, blend=blend, clear=clear)
        listed = self._listed if small is not None else None
        drawn = Pass(
            name,
            gl,
            load_program(
                gl,
                vertex=shaders[0],
                fragment=shaders[1],
                generated=parts.generated,
                defines=parts.defines | (listed.defines if listed else {}),
            ),
            target,
            vertices=3 * scene.triangle_count,
            blend=blend,
            clip_distances=2,
            clear=None if listed else clear,
            textures=parts.textures,
            elements=listed.elements if listed else None,
            indirect=listed.command if listed else None,
        )
        streamed = None
        if self._stream is not None:
            streamed = StreamedScan(
                name,
                self._stream,
                shaders,
                replace(parts, textures={**self._textures, **self.textures}),
                target,
                blend=blend,
                clip_distances=2,
                kept=None if records is None else Kept(records, paths=self.paths),
                words=self._words,
            )
        return _Stage(small, drawn, streamed)

    def _texture(self, size: tuple[int, int], dtype: str, components: int = 4) -> moderngl.Texture:
        texture = self.gl.texture(size, components, dtype=dtype)
        texture.filter = _NEAREST
        return texture

    def _begin(self, view: ScanView) -> Scan:
        views = len(view.directions)
        assert 1 <= views <= self.views, f"{views} directions for {self.views} views"
        frames = tuple(tight_frame(d, self.scene.box) for d in view.directions)
        if self._epoch == 0:
            # Each scan has its own epoch. The shaders ignore list heads with another epoch, so heads are cleared
            # only when all epochs have been used.
            self._epoch = _EPOCHS
            self._heads.write(bytes(4 * self.cells[0] * self.cells[1]))
        self._epoch -= 1
        uniforms: dict[str, object] = {
            **self.scene.uniforms,
            "path_u": vectors([u for u, _ in frames], self.views),
            "path_v": vectors([v for _, v in frames], self.views),
            "path_d": vectors(view.directions, self.views),
            "path_views": views,
            "scene_centre": tuple(self.scene.centre),
            "scene_diameter": 2.0 * self.scene.radius,
            "view_cells": self._view_cells(views),
            "cell_jitter": view.jitter,
            "scan_epoch": self._epoch + 1,
            "permutation_seed": view.seed & 0xFFFFFFFF,
            "path_columns": self.paths[0],
            "cell_columns": self.cells[0],
        }
        return Scan(frames, uniforms)

    def _view_cells(self, views: int) -> tuple[float, float]:
        return float(self.cells[0] // views), float(self.cells[1])

    def scan_positions(self, position: moderngl.Texture, view: ScanView) -> Scan:
        """Compute z0 of every live path, the depth where its ray starts: ScanConvertPositions [PB table 4].

        position : RGBA32F of `paths` texels: world space position; w is the direction code, see direction_code.glsl
        """
        scan = self._begin(view)
        uniforms = scan.uniforms
        self._textures["path_position"] = position
        columns, rows = self.paths
        grid = self._grid_size
        block = (-(-columns // grid[0]), -(-rows // grid[1]))
        self._position_passes[0].run(uniforms | {"source_size": self.paths, "block": block})
        self._position_passes[1].run(uniforms | {"source_size": grid})
        self._position_passes[2].run(uniforms)
        self._cell_pass.run(uniforms)
        return scan

    def any_paths(self) -> bool:
        """Return True if any path was alive in the last `scan_positions`. Waits for the device."""
        bounds = np.frombuffer(self._bounds.read(), np.float32).reshape(self.views, 4)
        return bool(np.any(bounds[:, 0] <= -bounds[:, 2]))

    def scan_scene(self, scan: Scan, skipped_share: float = 0.0) -> None:
        """Find the nearest surface beyond z0 of each path: ScanConvertScene [PB table 5].

        skipped_share : with `skips_near`, minimum distance of a hit on a simplified shape, as a multiple of the
                        shape's deviation
        """
        uniforms = scan.uniforms | {"skipped_share": skipped_share}
        views = len(scan.frames)
        seen = self._chunks_in_view(scan) if self._stream is not None else None
        for stage in self._stages:
            if stage.small is not None:
                stage.small.run(uniforms, self.scene.triangle_count)
            stage.drawn.run(uniforms | {"listed_of": self.scene.triangle_count}, instances=views)
            if stage.streamed is not None and seen is not None:
                stage.streamed.run(uniforms, seen, instances=views)

    def _chunks_in_view(self, scan: Scan) -> NDArray[np.bool_]:
        """Return (N,) bool: True for chunks that rays of any view may hit, with a margin of one cell."""
        assert self._stream is not None, "who streams"
        cells = np.array(self._view_cells(len(scan.frames)))
        bounds = np.frombuffer(self._bounds.read(), np.float32).reshape(self.views, 4).astype(np.float64)
        seen = np.zeros(len(self._stream.chunks), np.bool_)
        lower, upper = self._stream.lower - self.scene.centre, self._stream.upper - self.scene.centre
        for view, (u, v) in enumerate(scan.frames):
            low, high = bounds[view, :2], -bounds[view, 2:]
            if not (low <= high).all():
                continue  # no path uses this view of the scan
            margin = (high - low) / cells + 1e-5 * self.scene.radius
            planes = np.stack([u, v, -u, -v])
            offsets = np.concatenate([low - margin, -high - margin])
            seen |= before_planes(lower, upper, planes, offsets)
        return seen

    @checked
    def cast(self, origins: ArrayLike, direction: ArrayLike, sign: ArrayLike | None = None) -> Hits:
        """Return the exact nearest surface beyond each origin.

        Parameters
        ----------
        origins   : (N, 3), world space; N up to the buffer's number of paths
        direction : (3,), need not be unit
        sign      : (N,) +1 to look along the direction (default), -1 against it

        A cell holds up to four rays of one scan. Rays left out of a crowded cell are scanned again.

        A surface nearer than about 2e-6 of the scene's diameter counts as the surface where the ray starts. For a
        steep surface, this distance grows by the depth that the surface spans over 1e-4 of a cell.

        Example
        -------
        >>> from glpath.gl.context import get_context
        >>> from glpath.io import load_scene
        >>> gl = get_context().gl
        >>> buffer = PathBuffer(gl, DeviceScene(gl, load_scene("cornell-box-36")), paths=(16, 16))
        >>> hits = buffer.cast(origins=[[0, 0, 0.9], [0.5, 0.2, 0.9]], direction=(0, -1, 0))
        >>> hits.t.round(3).tolist()
        [1.0, 1.2]
        """
        if self.occlusion:
            raise UsageError(
                "path-buffer: cast names triangles, but this buffer finds only whether anything is hit",
                "Make it without occlusion, or call `blocked`.",
            )
        start, d, sign = self._rays("cast", origins, direction, sign)
        n = len(start)
        triangle = self._answers(start, d, sign)
        t = np.full(n, np.inf)
        hit = triangle >= 0
        which = triangle[hit]
        normals = self.scene.scene.normals[which]
        corner = self.scene.scene.triangles[which, 0]
        along = d * sign[hit, None]
        t[hit] = np.einsum("ij,ij->i", normals, corner - start[hit]) / np.einsum("ij,ij->i", normals, along)
        return Hits(triangle, t)

    @checked
    def blocked(self, origins: ArrayLike, direction: ArrayLike, sign: ArrayLike | None = None) -> NDArray[np.bool_]:
        """Return (N,) bool, True if any surface lies beyond the origin, for a buffer made with `occlusion`.

        The parameters are those of `cast`, which such a buffer does not have.
        """
        if not self.occlusion:
            raise UsageError(
                "path-buffer: blocked is of a buffer that finds only whether anything is hit",
                "Make it with occlusion=True.",
            )
        return np.asarray(self._answers(*self._rays("blocked", origins, direction, sign)) >= 0)

    def _answers(
        self, start: NDArray[np.float64], d: NDArray[np.float64], sign: NDArray[np.float64]
    ) -> NDArray[np.int32]:
        """Return (N,) int32: each ray's triangle, PATH_MISSED for a miss; with `self.occlusion`, 0 for any hit.

        A cell holds up to four rays of one scan. Rays left out of a crowded cell are scanned again.
        """
        n = len(start)
        triangle = np.full(n, PATH_MISSED, np.int32)
        open_ = np.flatnonzero(sign)
        columns, rows = self.paths
        state = np.zeros((rows * columns, 4), np.float32)
        state[:n, :3] = start
        position = self._texture(self.paths, "f4")
        round_ = 0
        while len(open_):
            state[:, 3] = 0
            state[open_, 3] = sign[open_]
            position.write(state.tobytes())
            scan = self.scan_positions(position, ScanView((d,), seed=round_))
            self.scan_scene(scan)
            answer = self._read_report(scan)[open_]
            done = answer != PATH_LOST
            triangle[open_[done]] = answer[done]
            open_ = open_[~done]
            round_ += 1
        return triangle

    @checked
    def scan(self, origins: ArrayLike, direction: ArrayLike, sign: ArrayLike | None = None) -> Cells:
        """Scan rays once, and return the contents of the buffer for inspection.

        The parameters are those of `cast`. A cell holds up to four rays. Rays left out of a crowded cell are
        missing.
        """
        if self.occlusion:
            raise UsageError(
                "path-buffer: scan names triangles, but this buffer finds only whether anything is hit",
                "Make it without occlusion.",
            )
        start, d, sign = self._rays("scan", origins, direction, sign)
        columns, rows = self.paths
        state = np.zeros((rows * columns, 4), np.float32)
        state[: len(start), :3], state[: len(start), 3] = start, sign
        position = self._texture(self.paths, "f4")
        position.write(state.tobytes())
        self.scan_scene(self.scan_positions(position, ScanView((d,))))
        z0, found = self._read_cells(self._z0), self._read_cells(self._found)
        diameter = np.float32(2.0 * self.scene.radius)
        empty = z0 >= INFINITE_DEPTH
        if self.packed:
            missed = found >= np.float32(3e38)
            word = np.where(missed, np.float32(1.0), found).view(np.uint32) - MIN_NORMAL
            triangle = (word & np.uint32((1 << self.id_bits) - 1)).astype(np.int32)
            depth = _depth_of_level(word >> np.uint32(self.id_bits), int(str(self.defines["DEPTH_LEVELS"])))
        else:
            missed = found == 0
            triangle = np.where(missed, 0, found.view(np.uint32) - MIN_NORMAL).astype(np.int32)
            depth = self._read_cells(self._textures["cell_nearest"])
        return Cells(
            np.where(empty, np.float32(np.nan), (z0 - np.float32(0.5)) * diameter),
            np.where(missed, np.int32(PATH_MISSED), triangle),
            np.where(missed, np.float32(np.inf), np.float32(diameter) * depth).astype(np.float32),
        )

    def _read_cells(self, texture: moderngl.Texture) -> NDArray[np.float32]:
        columns, rows = self.cells
        return np.frombuffer(texture.read(), np.float32).reshape(rows, columns, 4)[::-1].copy()

    def _rays(
        self, name: str, origins: ArrayLike, direction: ArrayLike, sign: ArrayLike | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return checked origins (N, 3), unit direction (3,) and signs (N,). Raises UsageError."""
        start = np.asarray(origins, np.float64)
        if start.size % 3:
            raise UsageError(f"path-buffer: origins of shape {start.shape} where (N, 3) is needed")
        start = start.reshape(-1, 3)
        n = len(start)
        columns, rows = self.paths
        if self.views != 1:
            raise UsageError(f"path-buffer: {name} has one direction, but this buffer {self.views} views")
        if n > columns * rows:
            raise UsageError(f"path-buffer: {n} origins for a buffer of {columns} x {rows} paths")
        d = np.asarray(direction, np.float64)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(d)
        if d.shape != (3,) or not 0 < length < np.inf:
            raise UsageError(
                f"path-buffer: direction {short_repr(d)}; three finite numbers, not all zero, are needed"
            )
        if not np.all(np.isfinite(start)):
            raise UsageError("path-buffer: an origin is not finite")
        sign = np.ones(n) if sign is None else np.sign(np.asarray(sign, np.float64))
        if sign.shape != (n,) or np.isnan(sign).any():
            raise UsageError(f"path-buffer: sign of shape {sign.shape} where ({n},) numbers, no NaN, are needed")
        return start, d / length, sign

    def _read_report(self, scan: Scan) -> NDArray[np.int32]:
        if self._report is None:
            texture = self.gl.texture(self.paths, 1, dtype="i4")
            texture.filter = _NEAREST
            program = load_program(
                self.gl, vertex="gl/fullscreen.vert", fragment="path_buffer/path_report.frag", defines=self.defines
            )
            stage = Pass(
                "report",
                self.gl,
                program,
                self.gl.framebuffer([texture]),
                textures=self.textures,
            )
            self._report = stage, texture
        stage, texture = self._report
        stage.run(scan.uniforms)
        return np.frombuffer(texture.read(), np.int32)


def _depth_of_level(level: NDArray[np.uint32], levels: int) -> NDArray[np.float32]:
    """Return the depth, in scene diameters, of levels encoded as in scan_word.glsl."""
    first, last = np.array([DEPTH_BASE, 1.0 + DEPTH_BASE], np.float32).view(np.uint32).astype(np.int64)
    bits = first + (level.astype(np.float64) + 0.5) * ((last - first) / levels)
    depth: NDArray[np.float32] = bits.astype(np.uint32).view(np.float32) - np.float32(DEPTH_BASE)
    return depth
