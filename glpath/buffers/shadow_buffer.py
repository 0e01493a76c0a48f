"""Shadow-buffers of punctual lights: visibility from a light, looked up instead of shooting shadow rays [TB III].

They cover every direction: `SphereShadowBuffer` by the sphere of latitude and longitude of TB, `CubeShadowBuffer`
by a cube, which wastes no cells at poles. An entry is the nearest primitive along the ray of its cell, its t, and
its tangent plane there. The buffer is filled object by object. The cells in which an object can be visible are
bounded (`light_bounds`). Each of their rays is intersected exactly, and the depth test keeps the nearest hit.
`shadow/point_shadow.glsl` looks the entries up. A spot is a point light with a cone. A directional light has no
such buffer: it has no origin of directions, and an orthographic buffer has no finite size in a scene with an
infinite ground. Its shadows take rays.

Cost:     an intersection test for each cell in an object's bound; 20 bytes a cell. A new view costs nothing.
Poor at:  shadows finer than a cell; more than some ten thousand objects that move each frame, because the CPU
          bounds them; several lights over streamed triangles, each of which reads them all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple, get_args

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.buffers.cube_bounds import (
    cube_rectangles_of_caps,
    cube_rectangles_of_planes,
    cube_rectangles_of_triangles,
)
from glpath.buffers.light_bounds import Caps, CellRectangles, Spheres, sphere_caps, spheres_around
from glpath.buffers.shadow_options import MAX_TAPS, ShadowTest
from glpath.buffers.sphere_bounds import (
    sphere_rectangles_of_caps,
    sphere_rectangles_of_planes,
    sphere_rectangles_of_triangles,
)
from glpath.errors import UsageError
from glpath.gl.clear import clear_integers
from glpath.gl.depth import DISTANCE_TO_DEPTH, float_depth_texture
from glpath.gl.device_scene import DeviceScene
from glpath.gl.geometry_stream import of_chunks
from glpath.gl.memory import MODERNGL
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass, largest_point
from glpath.gl.program import load_program
from glpath.scene.model import Float64
from glpath.system.arguments import check_count, check_word, checked, short_repr

#: Kinds of primitives, in the order in which `DeviceScene` numbers the primitives.
KINDS = ("sphere", "ellipsoid", "triangle", "plane")
_RECTANGLES_WIDTH = 4096
#: Maximum width and height, in cells, of rectangles drawn as points; less if the device's largest point is smaller.
_POINT = 8
#: Maximum number of streamed triangles bounded at the same time, because each needs a kilobyte of memory for that.
_TRIANGLES = 4096
_NEAREST = (moderngl.NEAREST, moderngl.NEAREST)


class Entries(NamedTuple):
    """Contents of a buffer: the hit of each cell's ray.

    primitive : (faces, rows, columns) int32, number of the primitive, -1 for none
    t         : (faces, rows, columns) float32, distance from the light, inf for none
    """

    primitive: NDArray[np.int32]
    t: NDArray[np.float32]


class PointShadowBuffer(Owner, ABC):
    """Nearest hits around punctual lights, in every direction; see `SphereShadowBuffer` and `CubeShadowBuffer`.

    All lights share one texture, with a tile for each, so that a shader can loop over them.

    Parameters
    ----------
    gl      : the context
    objects : scene that casts shadows
    cells   : (columns, rows) of a face
    faces   : (columns, rows) of faces in a tile
    lights  : maximum number of lights

    Attributes
    ----------
    objects            : scene that casts shadows; it may be replaced, for example after objects moved, and then all
                         lights must be filled again
    textures           : textures for a program that includes point_shadow.glsl
    intersection_tests : number of intersection tests of all fills so far
    """

    shape = ""

    def __init__(
        self,
        gl: moderngl.Context,
        objects: DeviceScene,
        cells: tuple[int, int],
        faces: tuple[int, int],
        lights: int,
    ) -> None:
        self.gl = gl
        self.objects = objects
        self.cells = cells
        self.faces = faces
        self.lights = lights
        self.tile = (cells[0] * faces[0], cells[1] * faces[1])
        max_size = int(gl.info["GL_MAX_TEXTURE_SIZE"])
        if min(cells) < 1 or lights < 1:
            raise UsageError(
                f"shadow-buffer of {cells[1]} x {cells[0]} cells for {lights} lights: there must be one of each",
                "Take at least one cell, and no buffer for a scene without point lights.",
            )
        self._across = min(lights, max(1, max_size // self.tile[0]))
        size = (self._across * self.tile[0], -(-lights // self._across) * self.tile[1])
        if max(size) > max_size:
            raise UsageError(
                f"shadow-buffer of {cells[1]} x {cells[0]} cells for {lights} lights: a texture of {size[0]} x "
                f"{size[1]} texels; this device allows {max_size} x {max_size}",
                "Take a lower shadow resolution, or shadow rays.",
            )
        self._entries = gl.texture(size, 4, dtype="u4")
        self._entries.filter = _NEAREST
        self._depth = float_depth_texture(gl, size)
        target = gl.framebuffer([self._entries], self._depth)
        clear_integers(target, (0, 0, *size))
        rows = -(-lights // self._across)
        self._positions = gl.texture((self._across, rows), 4, data=bytes(16 * self._across * rows), dtype="f4")
        self._positions.filter = _NEAREST
        self.textures = {"shadow_buffer": self._entries, "shadow_lights": self._positions}
        self._keys: list[tuple[object, ...] | None] = [None] * lights
        self._spheres: tuple[str, Spheres] | None = None  # digest of the geometry, and its bounding spheres
        self.intersection_tests = 0
        self._passes: list[Pass] = []  # two for each of KINDS: one draws rectangles, one draws points
        self._defines: dict[str, object] = {"SHADOW_CUBE": 1} if self.shape == "cube" else {}
        for kind in KINDS:
            self._passes += self._pair(kind, target, objects.defines)
        self._passes[0].clear = (0.0, 0.0, 0.0, 0.0)
        self._of_chunks: list[Pass] = []  # the same two passes, for streamed triangles
        if objects.stream is not None:
            self._of_chunks = self._pair("triangle", target, of_chunks(objects.defines))

    def _pair(self, kind: str, target: moderngl.Framebuffer, defines: Mapping[str, object]) -> list[Pass]:
        """Return the two passes of a kind: one draws rectangles, one points. `defines` are those of the scene."""
        program = load_program(
            self.gl,
            vertex="shadow/point_shadow_fill.vert",
            fragment="shadow/point_shadow_fill.frag",
            generated=self.objects.generated,
            defines={
                **defines,
                **self._defines,
                f"KIND_{kind.upper()}": 1,
                "RECTANGLES_WIDTH": _RECTANGLES_WIDTH,
                "DEPTH_SCALE": DISTANCE_TO_DEPTH,
            },
        )
        empty = self._table(np.zeros((0, 4), np.uint32))
        return [
            Pass(
                f"shadow-buffer: {kind}s",
                self.gl,
                program,
                target,
                depth=True,
                textures={**self.objects.textures, "rectangles": empty},
                points=points,
            )
            for points in (False, True)
        ]

    @abstractmethod
    def _of_caps(self, caps: Caps) -> CellRectangles: ...

    @abstractmethod
    def _of_triangles(self, triangles: Float64, light: Float64) -> CellRectangles: ...

    @abstractmethod
    def _of_planes(self, planes: Float64, light: Float64) -> CellRectangles: ...

    def _rectangles(self, light: Float64) -> list[CellRectangles]:
        """Return, for each of KINDS, the cells in which its primitives can be visible from a light (3,)."""
        scene, numbers = self.objects.scene, self.objects.numbering
        if self._spheres is None or self._spheres[0] != self.objects.geometry_digest:
            self._spheres = self.objects.geometry_digest, spheres_around(scene.spheres[numbers.spheres])
        caps = sphere_caps(self._spheres[1], light)
        some = numbers.first_ellipsoid
        return [
            self._of_caps(Caps(caps.axis[:some], caps.angle[:some])),
            self._of_caps(Caps(caps.axis[some:], caps.angle[some:])),
            self._of_triangles(scene.triangles, light),
            self._of_planes(scene.planes, light),
        ]

    def _table(self, rows: NDArray[np.uint32]) -> moderngl.Texture:
        height = max(1, -(-len(rows) // _RECTANGLES_WIDTH))
        table = np.zeros((height * _RECTANGLES_WIDTH, 4), np.uint32)
        table[: len(rows)] = rows
        texture = self.gl.texture((_RECTANGLES_WIDTH, height), 4, data=table.tobytes(), dtype="u4")
        texture.filter = _NEAREST
        return texture

    def key(self, light: int = 0) -> tuple[object, ...] | None:
        """Return a key of the state with which a light's buffer was filled; None before the first fill."""
        return self._keys[light]

    def forget(self) -> None:
        """Mark every light's buffer as unfilled, to measure the time of filling."""
        self._keys = [None] * len(self._keys)

    def _check_light(self, light: int) -> None:
        check_count("shadow-buffer: light", light, 0, self.lights - 1)

    @checked
    def fill(self, position: ArrayLike, light: int = 0) -> bool:
        """Fill the buffer of a light at `position` (3,) [TB III.E], unless its contents are current.

        Returns True if it was filled.
        """
        at = np.asarray(position, np.float64)
        if at.shape != (3,) or not np.isfinite(at).all():
            raise UsageError(
                f"shadow-buffer: position {short_repr(position)} where three finite numbers are needed"
            )
        self._check_light(light)
        key = (*at.tolist(), self.objects.geometry_digest)
        if self._keys[light] == key:
            return False
        # The device has the position in 32 bits, so the bounds must start at the rounded position.
        at = at.astype(np.float32).astype(np.float64)
        column, row = light % self._across, light // self._across
        self._positions.write(np.array([*at, 0.0], np.float32).tobytes(), viewport=(column, row, 1, 1))
        corner = (column * self.tile[0], row * self.tile[1])
        uniforms = self.objects.uniforms | {
            "shadow_cells": (float(self.cells[0]), float(self.cells[1])),
            "light_position": tuple(at.tolist()),
            "tile_faces": self.faces,
            "tile_corner": corner,
            "tile_size": self.tile,
        }
        numbers = self.objects.numbering.kinds
        for stage in self._passes + self._of_chunks:
            stage.area = (*corner, *self.tile)
        pairs = zip(self._passes[::2], self._passes[1::2], strict=True)
        for kind, pair, found in zip(KINDS, pairs, self._rectangles(at), strict=True):
            self._shoot(pair, found, numbers[kind].start, self.objects.textures, uniforms)
        self._shoot_at_chunks(at, uniforms)
        self._keys[light] = key
        return True

    def _shoot(
        self,
        pair: Sequence[Pass],
        found: CellRectangles,
        first: int,
        textures: Mapping[str, moderngl.Texture],
        uniforms: Mapping[str, object],
    ) -> None:
        """Intersect primitives with the rays of the cells found for them. first: number of the first primitive."""
        self.intersection_tests += found.cells
        rows = np.empty((len(found.primitive), 4), np.uint32)
        rows[:, 0] = found.first[:, 0] | found.first[:, 1] << 16
        rows[:, 1] = found.last[:, 0] | found.last[:, 1] << 16
        rows[:, 2] = found.primitive + first
        rows[:, 3] = found.face
        width, height = (found.last - found.first).T
        small = np.maximum(width, height) < min(_POINT, largest_point(self.gl), *self.cells)
        for stage, table in zip(pair, (rows[~small], rows[small]), strict=True):
            stage.vertices = len(table) if stage.points else 6 * len(table)
            if stage.vertices or stage.clear is not None:
                stage.textures = {**textures, "rectangles": self._table(table)}
                stage.run({**uniforms, "as_points": stage.points})

    def _shoot_at_chunks(self, light: Float64, uniforms: Mapping[str, object]) -> None:
        """Intersect all streamed triangles, chunk after chunk [TB VI], because a light covers all directions."""
        stream = self.objects.stream
        if stream is None:
            return
        for index, texture, own in stream.on_device(np.ones(len(stream.chunks), np.bool_)):
            first, textures = stream.chunks[index].first, {**self.objects.textures, "scene_floats": texture}
            triangles = stream.triangles(index)
            for start in range(0, len(triangles), _TRIANGLES):
                found = self._of_triangles(triangles[start : start + _TRIANGLES], light)
                self._shoot(self._of_chunks, found, first + start, textures, {**uniforms, **own})
            del triangles  # free it before the next chunk is read

    @property
    def uniforms(self) -> dict[str, object]:
        """Uniforms for a program that includes point_shadow.glsl."""
        return {
            "shadow_cells": (float(self.cells[0]), float(self.cells[1])),
            "shadow_tiles_across": self._across,
        }

    @checked
    def defines(self, test: ShadowTest = "distance", taps: int = 1) -> dict[str, object]:
        """Return the defines of a program that includes point_shadow.glsl: test, and filter width in cells."""
        check_word("shadow-buffer: test", test, get_args(ShadowTest))
        if not 1 <= taps <= min(MAX_TAPS, *self.cells):
            raise UsageError(
                f"shadow filter of {taps} taps in a buffer of {self.cells[1]} x {self.cells[0]} cells; "
                f"1 (none) to {min(MAX_TAPS, *self.cells)} are possible",
                "2 to 4 make smooth edges.",
            )
        chosen: dict[str, object] = {"SHADOW_TAPS": taps}
        return self._defines | chosen | ({"SHADOW_IDENTITY": 1} if test == "identity" else {})

    @checked
    def read(self, light: int = 0) -> Entries:
        """Return the entries of a light's buffer as arrays. Waits for the device."""
        self._check_light(light)
        columns, rows = self.cells
        across, up = self.faces
        x, y = light % self._across * self.tile[0], light // self._across * self.tile[1]

        def tile(texture: moderngl.Texture, components: int) -> NDArray[np.float32]:
            whole = np.frombuffer(texture.read(), np.float32).reshape(*texture.size[::-1], components)
            own = whole[y : y + self.tile[1], x : x + self.tile[0]]
            faces = own.reshape(up, rows, across, columns, components).swapaxes(1, 2)
            return faces.reshape(up * across, rows, columns, components)

        primitive = tile(self._entries, 4)[..., 3].view(np.int32) - 1
        t = tile(self._depth, 1)[..., 0] * np.float32(1 / DISTANCE_TO_DEPTH)
        return Entries(primitive, np.where(primitive < 0, np.float32(np.inf), t))

    @checked
    def visibility(
        self,
        light: int,
        positions: ArrayLike,
        normals: ArrayLike,
        objects: ArrayLike,
        test: ShadowTest = "distance",
        taps: int = 1,
    ) -> NDArray[np.float32]:
        """Return the fraction of a light that reaches each point on a surface, from arrays to arrays.

        positions : (N, 3) world space
        normals   : (N, 3) unit, on either side
        objects   : (N,) object of each point (index of the shape)

        Returns (N,) float32 in [0, 1].
        """
        self._check_light(light)
        if np.ndim(positions) != 2 or np.shape(positions)[1] != 3:
            raise UsageError(f"shadow-buffer: positions of shape {np.shape(positions)} where (N, 3) is needed")
        n = len(np.asarray(positions))
        for name, given, shape in (("normals", normals, (n, 3)), ("objects", objects, (n,))):
            if np.shape(given) not in (shape, shape[1:]):
                raise UsageError(f"shadow-buffer: {name} of shape {np.shape(given)} where {shape} is needed")
        width = min(1024, max(n, 1))
        height = max(1, -(-n // width))
        tables = np.zeros((2, height * width, 4), np.float32)
        tables[0, :n, :3], tables[0, :n, 3], tables[1, :n, :3] = positions, objects, normals
        starts, facing = (self.gl.texture((width, height), 4, data=t.tobytes(), dtype="f4") for t in tables)
        out = self.gl.texture((width, height), 1, dtype="f4")
        program = load_program(
            self.gl,
            vertex="gl/fullscreen.vert",
            fragment="shadow/point_shadow_report.frag",
            generated=self.objects.generated,
            defines=self.objects.defines | self.defines(test, taps),
        )
        textures = {**self.objects.textures, **self.textures, "points": starts, "normals": facing}
        stage = Pass("visibility", self.gl, program, self.gl.framebuffer([out]), textures=textures)
        stage.run(self.objects.uniforms | self.uniforms | {"light": light})
        return np.frombuffer(out.read(), np.float32)[:n].copy()


class SphereShadowBuffer(PointShadowBuffer):
    """Shadow-buffer of TB III.C: entries over latitude and longitude about the world's z axis.

    rows, columns : size in entries; each is pi / rows high; TB uses 400 x 800

    Poor at:  directions near the poles, where many cells cover a small solid angle.
    """

    shape = "sphere"

    @partial(checked, namespace=MODERNGL)
    def __init__(
        self, gl: moderngl.Context, objects: DeviceScene, rows: int, columns: int, lights: int = 1
    ) -> None:
        super().__init__(gl, objects, (columns, rows), (1, 1), lights)

    def _of_caps(self, caps: Caps) -> CellRectangles:
        return sphere_rectangles_of_caps(caps, self.cells[1], self.cells[0])

    def _of_triangles(self, triangles: Float64, light: Float64) -> CellRectangles:
        return sphere_rectangles_of_triangles(triangles, light, self.cells[1], self.cells[0])

    def _of_planes(self, planes: Float64, light: Float64) -> CellRectangles:
        return sphere_rectangles_of_planes(planes, light, self.cells[1], self.cells[0])


class CubeShadowBuffer(PointShadowBuffer):
    """Shadow-buffer of six faces about the light, side x side entries each, along the world's axes.

    Cells are equally spaced in angle across a face, so all have about the same size. Cells of `SphereShadowBuffer`
    have this size only near its equator. A cube needs 3/4 of a sphere's cells for the same maximum cell size.
    """

    shape = "cube"

    @partial(checked, namespace=MODERNGL)
    def __init__(self, gl: moderngl.Context, objects: DeviceScene, side: int, lights: int = 1) -> None:
        super().__init__(gl, objects, (side, side), (3, 2), lights)

    def _of_caps(self, caps: Caps) -> CellRectangles:
        return cube_rectangles_of_caps(caps, self.cells[0])

    def _of_triangles(self, triangles: Float64, light: Float64) -> CellRectangles:
        return cube_rectangles_of_triangles(triangles, light, self.cells[0])

    def _of_planes(self, planes: Float64, light: Float64) -> CellRectangles:
        return cube_rectangles_of_planes(planes, light, self.cells[0])
