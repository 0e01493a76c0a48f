"""Sums of samples for every pixel, exact in any order; the CPU's side of `shaders/film/accumulate.glsl`."""

from __future__ import annotations

from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.passes import Pass
from glpath.gl.program import load_program

_NAMES = ("sum_low", "sum_high")
# What a sample has of direct light, beside the sums.
_DIRECT = "direct"


class Taken(NamedTuple):
    """What was summed.

    radiance : (h, w, 3) float64, row 0 at the top; multiples of one power of two
    low, high : (h, w) uint32, the events that were counted along
    """

    radiance: NDArray[np.float64]
    low: NDArray[np.uint32]
    high: NDArray[np.uint32]


class PixelSums:
    """Two sets of sums: a pass reads the one and writes the other, with what it adds.

    max_radiance : radiance that has 36 bits; a little of 2**24 times that may still be added
    split        : direct light is summed by itself as well: a pass writes what a sample has of it, in quanta, and
                   `add_direct` takes it to the sums

    Attributes
    ----------
    quanta   : the uniform, per unit of radiance
    targets  : two framebuffers
    textures : two mappings; a pass that draws to targets[1 - i] reads textures[i]
    written  : two mappings of what targets[i] are made of, by the names of the outputs
    defines  : for programs that include accumulate.glsl
    """

    def __init__(
        self, gl: moderngl.Context, size: tuple[int, int], max_radiance: float, *, split: bool = False
    ) -> None:
        exponent = int(np.ceil(np.log2(max_radiance))) if 0.0 < max_radiance < np.inf else 0
        self.quanta = float(2.0 ** min(36 - exponent, 120))
        pairs = [[gl.texture(size, 4, dtype="u4") for _ in _NAMES] for _ in range(2)]
        for pair in pairs:
            for texture in pair:
                texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
                texture.write(bytes(16 * size[0] * size[1]))
        self.textures = [dict(zip(_NAMES, pair, strict=True)) for pair in pairs]
        self.written = [{"low": pair[0], "high": pair[1]} for pair in pairs]
        self.defines: dict[str, object] = {"SPLIT_LIGHT": 1} if split else {}
        self.size = size
        self.targets: list[moderngl.Framebuffer] = []
        self._direct: PixelSums | None = None
        self._direct_passes: list[Pass] = []
        self._direct_sum = 0
        if split:
            direct = gl.texture(size, 4, dtype="f4")
            direct.filter = (moderngl.NEAREST, moderngl.NEAREST)
            for written in self.written:
                written[_DIRECT] = direct
            self._direct = PixelSums(gl, size, max_radiance)
            program = load_program(gl, vertex="gl/fullscreen.vert", fragment="film/direct_sums.frag")
            self._direct_passes = [
                Pass(
                    "direct light",
                    gl,
                    program,
                    self._direct.targets[1 - i],
                    textures={**self._direct.textures[i], "direct_light": direct},
                )
                for i in range(2)
            ]
        self.targets = [gl.framebuffer([*written.values()]) for written in self.written]

    def add_direct(self) -> None:
        """After each path set: what its samples have of direct light, to the sums of it."""
        if self._direct is not None:
            self._direct_passes[self._direct_sum].run({"quanta": 1.0})
            self._direct_sum = 1 - self._direct_sum

    def take_direct(self) -> NDArray[np.float64] | None:
        """The sums of direct light, which are then empty, as `Taken.radiance` is; None where it isn't split."""
        if self._direct is None:
            return None
        return self._direct.take(self._direct_sum).radiance

    def take(self, which: int) -> Taken:
        """The sums of one set, which is then empty."""
        width, height = self.size
        low, high = (
            np.frombuffer(self.textures[which][name].read(), np.uint32).reshape(height, width, 4)[::-1]
            for name in _NAMES
        )
        for texture in self.textures[which].values():
            texture.write(bytes(16 * width * height))
        quanta = high[..., :3].astype(np.float64) * 2.0**32 + low[..., :3]
        return Taken(quanta / self.quanta, low[..., 3], high[..., 3])
