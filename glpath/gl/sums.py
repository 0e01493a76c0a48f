"""Sums of samples for every pixel, exact in any order; the CPU side of `shaders/film/accumulate.glsl`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.passes import Pass
from glpath.gl.ping_pong import PingPong
from glpath.gl.program import load_program

_NAMES = ("sum_low", "sum_high")


class Readback(NamedTuple):
    """Sums that were read back.

    radiance : (h, w, 3) float64, row 0 at the top; multiples of one power of two
    low, high : (h, w) uint32, event counts that are stored beside the sums, see accumulate.glsl
    """

    radiance: NDArray[np.float64]
    low: NDArray[np.uint32]
    high: NDArray[np.uint32]


@dataclass(frozen=True)
class Sums:
    """Set of sums on the device.

    target   : framebuffer of a pass that writes the sums
    textures : textures of a pass that reads the sums
    written  : textures of the target, by the names of the outputs
    """

    target: moderngl.Framebuffer
    textures: Mapping[str, moderngl.Texture]
    written: Mapping[str, moderngl.Texture]


class PixelSums:
    """Two sets of sums: a pass reads one set and writes the other, with its own samples added.

    max_radiance : radiance that has 36 bits in quanta; the sum may reach nearly 2**24 times this radiance
    split        : True to sum direct light separately as well: a pass writes the direct light of a sample in
                   quanta, and `path_set_added` adds it to the sums
    order        : (h, w) positions of the pixels' sums, as y * w + x, row 0 at the bottom; None if each sum is at
                   its pixel

    Attributes
    ----------
    quanta   : the uniform, quanta per unit of radiance
    sets     : the two sets
    defines  : defines of programs that include accumulate.glsl
    """

    def __init__(
        self,
        gl: moderngl.Context,
        size: tuple[int, int],
        max_radiance: float,
        *,
        split: bool = False,
        order: NDArray[np.int64] | None = None,
    ) -> None:
        exponent = int(np.ceil(np.log2(max_radiance))) if 0.0 < max_radiance < np.inf else 0
        self.quanta = float(2.0 ** min(36 - exponent, 120))
        self.defines: dict[str, object] = {"SPLIT_LIGHT": 1} if split else {}
        self.size = size
        self._order = order
        self._direct: PixelSums | None = None
        of_sample: dict[str, moderngl.Texture] = {}  # direct light of a sample, beside the sums
        if split:
            direct = gl.texture(size, 4, dtype="f4")
            direct.filter = (moderngl.NEAREST, moderngl.NEAREST)
            of_sample = {"direct": direct}
            sums = self._direct = PixelSums(gl, size, max_radiance, order=order)
            program = load_program(gl, vertex="gl/fullscreen.vert", fragment="film/direct_sums.frag")
            self._add_direct = sums.sets.each(
                lambda read, write: Pass(
                    "direct light", gl, program, write.target, textures={**read.textures, "direct_light": direct}
                )
            )
        self.sets: PingPong[Sums] = PingPong(*(_new_sums(gl, size, of_sample) for _ in range(2)))

    def path_set_added(self) -> None:
        """Swap the sets after the pass of a path set, which has written the sums, and add its direct light."""
        self.sets.swap()
        if self._direct is not None:
            self._add_direct.now.run({"quanta": 1.0})
            self._direct.sets.swap()

    def take_direct(self) -> NDArray[np.float64] | None:
        """Return the sums of direct light, like `Readback.radiance`, and clear them; None if light is not split."""
        return None if self._direct is None else self._direct.take().radiance

    def take(self) -> Readback:
        """Return the sums and clear them."""
        width, height = self.size
        textures = self.sets.read.textures
        read = (np.frombuffer(textures[name].read(), np.uint32).reshape(-1, 4) for name in _NAMES)
        if self._order is not None:
            read = (words[self._order.ravel()] for words in read)
        low, high = (words.reshape(height, width, 4)[::-1] for words in read)
        for texture in textures.values():
            texture.write(bytes(16 * width * height))
        quanta = high[..., :3].view(np.int32).astype(np.float64) * 2.0**32 + low[..., :3]
        return Readback(quanta / self.quanta, low[..., 3], high[..., 3])


def _new_sums(gl: moderngl.Context, size: tuple[int, int], of_sample: Mapping[str, moderngl.Texture]) -> Sums:
    pair = [gl.texture(size, 4, dtype="u4") for _ in _NAMES]
    for texture in pair:
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        texture.write(bytes(16 * size[0] * size[1]))
    written = {"low": pair[0], "high": pair[1], **of_sample}
    return Sums(gl.framebuffer([*written.values()]), dict(zip(_NAMES, pair, strict=True)), written)
