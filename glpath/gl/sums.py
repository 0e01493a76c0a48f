"""Sums of samples for every pixel, exact in any order; the CPU's side of `shaders/accumulate.glsl`."""

from __future__ import annotations

from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

_NAMES = ("sum_low", "sum_high")


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

    Attributes
    ----------
    quanta   : the uniform, per unit of radiance
    targets  : two framebuffers
    textures : two mappings; a pass that draws to targets[1 - i] reads textures[i]
    """

    def __init__(self, gl: moderngl.Context, size: tuple[int, int], max_radiance: float) -> None:
        exponent = int(np.ceil(np.log2(max_radiance))) if 0.0 < max_radiance < np.inf else 0
        self.quanta = float(2.0 ** min(36 - exponent, 120))
        pairs = [[gl.texture(size, 4, dtype="u4") for _ in _NAMES] for _ in range(2)]
        for pair in pairs:
            for texture in pair:
                texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
                texture.write(bytes(16 * size[0] * size[1]))
        self.targets = [gl.framebuffer(pair) for pair in pairs]
        self.textures = [dict(zip(_NAMES, pair, strict=True)) for pair in pairs]
        self.size = size

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
