"""Visibility from points out of a scene along directions that all points share: any-hit rays, one bit each.

Points are sorted along a Z curve and stored so in squares of texels. The lanes of a vector are then neighbours and
have one direction, so their rays visit the same nodes of the BVH. The triangle that occluded the previous direction
is tested first, so neighbouring directions should follow each other.

Cost:     a ray for each point and direction in front of it; 36 bytes a point on the device.
Poor at:  scenes whose triangles do not fit into memory; see `glpath.gl.streamed_rays` for those.
Source:   Morton 1966, A computer oriented geodetic data base; Haines & Greenberg 1986, The light buffer, for
          testing the last occluder first.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.thin_dielectrics import thin_dielectric_variants

#: Number of directions in a word.
WORD = 32
# Maximum number of points along a square's side.
_MAX_SQUARE = 256
# Maximum number of words in one draw, one word for each point and 32 directions. A draw takes half a second on two
# cores.
_POINTS_A_DRAW = 1 << 17
# Number of nonzero integers that 32-bit floats distinguish.
_NUMBERS = (1 << 24) - 1


class Seen(NamedTuple):
    """Visibility of points along 32 directions.

    word  : (N,) uint32, bit k is set if light arrives along direction k
    share : (32, N) float16, fraction of the light that thin dielectrics transmit; None if the scene has none
    """

    word: NDArray[np.uint32]
    share: NDArray[np.float16] | None


class ParallelRays(Owner):
    """Points on the device, and the rays from them.

    gl        : the context
    scene     : scene of triangles
    bvh       : BVH over its triangles
    positions : (N, 3), in the space of the device's scene, already offset from the surfaces
    normals   : (N, 3) unit; directions behind a point's plane are not cast, and their bits are 0. Zero for a point
                without a normal
    transmits : True if the scene has thin dielectrics, which light crosses without a change of direction
    sort      : False if consecutive points are already neighbours
    first     : number of the first point, the seed for random decisions at blended surfaces
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        bvh: RayBvh,
        positions: NDArray[np.float64],
        normals: NDArray[np.float64],
        *,
        sort: bool = True,
        first: int = 0,
    ) -> None:
        self.count = len(positions)
        self._uniforms = {**scene.uniforms, **bvh.uniforms}
        side = 1 << max(0, (max(1, self.count) - 1).bit_length() + 1) // 2
        self._square = square = min(side, _MAX_SQUARE)
        fitting = gl.info["GL_MAX_TEXTURE_SIZE"] // (square * WORD)
        self._words = max(1, min(_POINTS_A_DRAW // square**2, fitting))
        order = along_z_curve(positions) if sort else np.arange(self.count)
        self._texels = across = z_curve_texels(square)
        thin = thin_dielectric_variants(scene.scene)
        self.transmits = bool(thin)
        program = load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="daylight/parallel_rays.frag",
            generated={**scene.generated, **bvh.generated},
            defines=scene.defines | bvh.defines | thin,
        )
        self._directions = texel_table(gl, (WORD, self._words), "f4", 4)
        rows = square * self._words
        self._seen = texel_table(gl, (square, rows * (WORD if thin else 1)), "f4" if thin else "u4", 1)
        target = gl.framebuffer([self._seen])
        self._squares: list[tuple[NDArray[np.intp], Pass]] = []
        numbers = 1 + (first + np.arange(self.count)) % _NUMBERS
        for begin in range(0, self.count, square**2):
            which = order[begin : begin + square**2]
            textures = {**scene.textures, **bvh.textures, "shared_directions": self._directions}
            for name, values in (("point_positions", positions), ("point_normals", normals)):
                texels = np.zeros((square**2, 4), np.float32)
                texels[across[: len(which)], :3] = values[which]
                texels[across[: len(which)], 3] = numbers[which]
                textures[name] = texel_table(gl, (square, square), "f4", 4)
                textures[name].write(texels.tobytes())
            self._squares.append((which, Pass("parallel rays", gl, program, target, textures=textures)))

    def see_out(self, directions: NDArray[np.float64], number: int = 0) -> Iterator[Seen]:
        """Yield the visibility along each word of 32 directions, from unit directions (D, 3).

        number : number of the first direction; with the point, it seeds the random decisions at blended surfaces
        """
        words = -(-len(directions) // WORD)
        given = np.zeros((words * WORD, 4), np.float32)
        given[: len(directions), :3], given[: len(directions), 3] = directions, 1.0
        texels: NDArray[np.float32] = given.reshape(words, WORD, 4)
        for first in range(0, words, self._words):
            part = texels[first : first + self._words]
            self._directions.write(part.tobytes(), viewport=(0, 0, WORD, len(part)))
            if self.transmits:
                shares = self._drawn(len(part) * WORD, number + WORD * first, np.float32)
                for share in shares.reshape(len(part), WORD, self.count):
                    bits = np.packbits(share > 0, axis=0, bitorder="little")  # (4, N) bytes
                    word = np.ascontiguousarray(bits.T).view("<u4")[:, 0].astype(np.uint32)
                    yield Seen(word, share.astype(np.float16))
            else:
                for word in self._drawn(len(part), number + WORD * first, np.uint32):
                    yield Seen(word, None)

    def _drawn(self, rows: int, first: int, dtype: type[np.generic]) -> NDArray[Any]:
        """Return (rows, N) results for all points; each row takes a square of texels."""
        texels = self._square**2
        found = np.empty((rows, self.count), dtype)
        for which, rays in self._squares:
            rays.area = (0, 0, self._square, self._square * rows)
            rays.run({**self._uniforms, "square": self._square, "first_direction": first})
            seen = np.frombuffer(self._seen.read(), dtype)[: rows * texels].reshape(rows, texels)
            found[:, which] = seen[:, self._texels[: len(which)]]
        return found


def along_z_curve(positions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return (N,) indices of points (N, 3) in the order of a Z curve through their bounding cube."""
    if not len(positions):
        return np.zeros(0, np.intp)
    low = positions.min(axis=0)
    scale = (1 << 20) / max(float(np.ptp(positions, axis=0).max()), 1e-300)
    cells = ((positions - low) * scale).astype(np.uint64)
    code = np.zeros(len(positions), np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis]) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _spread(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return 21 bits with two zeros inserted between neighbours."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


def z_curve_texels(square: int) -> NDArray[np.intp]:
    """Return (square^2,) the row-major texel index of each number along a Z curve."""
    number = np.arange(square * square)
    x, y = np.zeros_like(number), np.zeros_like(number)
    for bit in range(square.bit_length() - 1):
        x |= (number >> 2 * bit & 1) << bit
        y |= (number >> 2 * bit + 1 & 1) << bit
    return np.asarray(y * square + x)


def texel_table(gl: moderngl.Context, size: tuple[int, int], dtype: str, components: int) -> moderngl.Texture:
    """Create a texture that is read texel by texel, without filtering."""
    texture = gl.texture(size, components, dtype=dtype)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
