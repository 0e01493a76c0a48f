"""All lights of a scene on the device, for paths that draw light samples of their own: `lights/light_draw.glsl`.

`glpath.lights.lighting` says what a sample is and how dense it is, as of the samples that a path set shares. The
lights are divided into pieces: a side of an emitting triangle, a punctual light, the sky. A range of the numbers in
[0, 2^32) chooses each. An environment map has tables of its rows and columns besides.

Cost:     16 bytes for each side of an emitting triangle; 4 a texel of an environment map. A path's sample takes a
          search among the pieces, and a triangle's corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.texel_store import UINTS, Layout, make_store, store_glsl
from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS
from glpath.scene.model import Environment, Float64, Light

UInt32 = NDArray[np.uint32]

_LAYOUT: Layout = {
    "light_piece": {
        "CHOICE": "the number from which on it is chosen; of a triangle or punctual light; density per area, or "
        "probability, as the bits of a float; its kind, and 8 for the back of a triangle"
    },
    "sky_half": {
        "CHOICE": "of a row's upper or lower half: the number from which on it is chosen; which half; its mass as "
        "the bits of a float"
    },
    "sky_column": {"CHOICES": "of four texels of a row of the map: the numbers from which on each is chosen"},
}
_BACK = 8
_ALL = 2.0**32


def light_draw_glsl() -> str:
    """The tables' texels, for `#include <LIGHT_DRAWS>`."""
    return store_glsl("light_draws", UINTS, _LAYOUT)


class LightDraws:
    """The tables of a lighting, on the device.

    lighting : of a scene in triangles
    lights   : the punctual ones, in the order of the device's
    edges    : (parts + 1,) of the numbers in [0, 1] that divide the lights into parts; a path draws from each

    textures, uniforms, generated, defines : for programs that include light_draw.glsl. Raises SceneError for more
    than the device holds.
    """

    def __init__(self, gl: moderngl.Context, lighting: Lighting, lights: Sequence[Light], edges: Float64) -> None:
        scene = lighting.scene
        begin, pieces = _pieces(lighting, lights)
        halves, columns = _sky_tables(lighting)
        tables = {"light_piece": pieces, "sky_half": halves, "sky_column": columns}
        texture, bases = make_store(gl, UINTS, _LAYOUT, tables, scene.source or scene.name)
        self.textures = {"light_draws": texture}
        self.generated = {"LIGHT_DRAWS": light_draw_glsl()}
        self.defines: dict[str, object] = {"OWN_LIGHT_SAMPLES": 1}
        ends = _numbers(edges)
        first = np.searchsorted(begin, ends[:-1], side="right") - 1
        last = np.searchsorted(begin, ends[1:], side="left") - 1
        parts = np.stack([ends[:-1], np.diff(ends), first, np.maximum(first, last)], axis=1)
        self.uniforms: dict[str, object] = {
            **bases,
            "light_parts": parts.astype(np.uint32).tobytes(),
            "sky_halves": len(halves),
        }


def _numbers(cdf: Float64) -> NDArray[np.int64]:
    """Cumulated probabilities as numbers below 2^32."""
    return np.minimum(np.rint(cdf * _ALL), _ALL - 1).astype(np.int64)


def _pieces(lighting: Lighting, lights: Sequence[Light]) -> tuple[NDArray[np.int64], UInt32]:
    """(P,) numbers at which pieces begin, and their table with one more entry, where the last one ends."""
    cdf = lighting.cdf
    begin: list[Float64] = []
    which: list[NDArray[np.integer]] = []
    weight: list[Float64] = []
    kinds: list[NDArray[np.integer]] = []
    for number, side in enumerate(lighting.sides):
        assert not side.spheres, "a scene in triangles"
        triangles = side.first + np.arange(len(side.cdf) - 1)
        begin.append(cdf[number] + (cdf[number + 1] - cdf[number]) * side.cdf[:-1])
        which.append(triangles)
        weight.append(lighting.triangle_density[triangles])
        kinds.append(np.full(len(triangles), LIGHT_KINDS.index("area") + _BACK * (side.sign < 0)))
    first = len(lighting.sides)
    for number, light in enumerate(lighting.punctual, first):
        begin.append(cdf[number : number + 1])
        which.append(np.array([next(i for i, other in enumerate(lights) if other is light)]))
        weight.append(np.diff(cdf[number : number + 2]))
        kinds.append(np.array([LIGHT_KINDS.index(light.kind)]))
    if lighting.sky is not None:
        begin.append(cdf[-2:-1])
        which.append(np.zeros(1, np.int64))
        weight.append(np.zeros(1))
        kinds.append(np.array([LIGHT_KINDS.index("sky")]))
    if not begin:  # a scene without light: a black triangle stands for it, as in `LightSamples.dark`
        begin, which, weight, kinds = [np.zeros(1)], [np.zeros(1, np.int64)], [np.ones(1)], [np.zeros(1, np.int64)]
    starts = _numbers(np.concatenate(begin))
    table = np.zeros((len(starts) + 1, 1, 4), np.uint32)
    table[:-1, 0, 0] = starts
    table[-1, 0, 0] = 0xFFFFFFFF
    table[:-1, 0, 1] = np.concatenate(which)
    table[:-1, 0, 2] = np.concatenate(weight).astype(np.float32).view(np.uint32)
    table[:-1, 0, 3] = np.concatenate(kinds)
    return starts, table


def _sky_tables(lighting: Lighting) -> tuple[UInt32, UInt32]:
    """The tables of an environment map, empty without one: halves of its rows, and the texels of each."""
    sky = lighting.sky
    if not isinstance(sky, Environment):
        return np.zeros((0, 1, 4), np.uint32), np.zeros((0, 1, 4), np.uint32)
    rows, order, mass, columns = sky.choices
    halves = np.zeros((len(order), 1, 4), np.uint32)
    halves[:, 0, 0], halves[:, 0, 1] = _numbers(rows[:-1]), order
    halves[:, 0, 2] = mass[order].astype(np.float32).view(np.uint32)
    return halves, _in_fours(_numbers(columns[:, :-1]))


def _in_fours(numbers: NDArray[np.int64]) -> UInt32:
    """(ceil(N / 4), 1, 4)."""
    table = np.full(-(-numbers.size // 4) * 4, 0xFFFFFFFF, np.uint32)
    table[: numbers.size] = numbers.ravel()
    return table.reshape(-1, 1, 4)
