"""Textures of all lights, from which paths on the device draw their own light samples (`lights/light_draw.glsl`).

The samples and their density are defined in `glpath.lights.lighting`, as are the samples that a path set shares.
The lights are divided into pieces: a side of an emitting triangle, a punctual light, the sky. A range of numbers in
[0, 2^32) selects each piece. With a light tree (`glpath.lights.tree`), the tree selects among the lights with a
position, and such ranges select the others. An environment map has tables of its rows and columns as well.

Cost:     16 bytes for each side of an emitting triangle, 80 with a tree; 4 for each texel of an environment map. A
          path's sample costs a search among the pieces or a descent of the tree, and reads a triangle's corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.texel_store import UINTS, Layout, make_store, store_glsl
from glpath.lights.lighting import Lighting
from glpath.lights.rectangles import LampRectangles
from glpath.lights.samples import LIGHT_KINDS, indices_by_id
from glpath.lights.tree import Emitters, LightTree, others, positional
from glpath.scene.model import Environment, Float64, Light

UInt32 = NDArray[np.uint32]

_LAYOUT: Layout = {
    "light_piece": {
        "CHOICE": "the number from which on it is chosen, or its trail in the tree; of a triangle or punctual "
        "light; density per area, or probability, as the bits of a float, by a tree once it is chosen; its kind, "
        "and 8 for the back of a triangle"
    },
    "light_node": {
        f"{child}_{texel}": what
        for child in ("LEFT", "RIGHT")
        for texel, what in (
            ("BALL", "of a node's child, as the bits of floats: centre and radius of a ball about its lights"),
            ("CONE", "axis, octahedral; cosines of inner and outer; strength, as the bits of a float; its number"),
        )
    },
    "light_shape": {"FIRST": "of a shape that emits: its first triangle; the piece of its front; of its back"},
    "sky_half": {
        "CHOICE": "of a row's upper or lower half: the number from which on it is chosen; which half; its mass as "
        "the bits of a float"
    },
    "sky_column": {"CHOICES": "of four texels of a row of the map: the numbers from which on each is chosen"},
}
_BACK = 8
_ALL = 2.0**32
_NONE = np.zeros((0, 1, 4), np.uint32)
_SNORM = 32767


def light_draw_glsl() -> str:
    """Return the layout of the tables as GLSL, for `#include <LIGHT_DRAWS>`."""
    return store_glsl("light_draws", UINTS, _LAYOUT)


class LightDraws:
    """Tables on the device for sampling the lights.

    lighting : lighting of a scene of triangles
    lights   : punctual lights, in the order of `DeviceScene.lights`
    edges    : (parts + 1,) numbers in [0, 1] that divide the lights into parts; a path draws a sample from each
               part
    samples  : number of tree samples for each vertex, if a tree selects the lights with a position; then `edges`
               are those of `glpath.lights.tree.others`
    rectangles : emitting rectangles that are sampled by solid angle

    textures, uniforms, generated, defines : inputs of programs that include light_draw.glsl

    Raises SceneError if the tables exceed the device's limit.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        lighting: Lighting,
        lights: Sequence[Light],
        edges: Float64,
        samples: int = 0,
        rectangles: LampRectangles | None = None,
    ) -> None:
        scene = lighting.scene
        begin, pieces = _pieces(others(lighting) if samples else lighting, lights)
        nodes, leaves, shapes = _tree_tables(lighting, lights) if samples else (_NONE, _NONE, _NONE)
        halves, columns = _sky_tables(lighting)
        tables = {
            "light_piece": np.concatenate([leaves, pieces]),
            "light_node": nodes.reshape(-1, 4, 4),
            "light_shape": shapes,
            "sky_half": halves,
            "sky_column": columns,
        }
        texture, bases = make_store(gl, UINTS, _LAYOUT, tables, scene.source or scene.name)
        self.textures = {"light_draws": texture}
        self.generated = {"LIGHT_DRAWS": light_draw_glsl()}
        self.defines: dict[str, object] = {"OWN_LIGHT_SAMPLES": 1}
        if samples:
            self.defines["LIGHT_TREE"] = samples
        if by_portals(lighting):
            self.defines["PORTALS"] = len(scene.portals)
        if rectangles:
            self.defines["LAMP_RECTANGLES"] = len(rectangles)
        ends = _numbers(edges)
        first = np.searchsorted(begin, ends[:-1], side="right") - 1
        last = np.searchsorted(begin, ends[1:], side="left") - 1
        ranges = len(leaves) + np.stack([first, np.maximum(first, last)], axis=1)
        parts = np.concatenate([np.stack([ends[:-1], np.diff(ends)], axis=1), ranges], axis=1)
        self.uniforms: dict[str, object] = {
            **bases,
            "light_parts": parts.astype(np.uint32).tobytes(),
            "sky_halves": len(halves),
            "sun_share": lighting.sky.sun_share if isinstance(lighting.sky, Environment) else 0.0,
            **_portal_uniforms(others(lighting) if samples else lighting),
            **_rectangle_uniforms(rectangles),
        }


def by_portals(lighting: Lighting) -> bool:
    """Return True if light samples of the sky are drawn through portals."""
    return lighting.sky is not None and len(lighting.scene.portals) > 0


def _portal_uniforms(lighting: Lighting) -> dict[str, object]:
    if not by_portals(lighting):
        return {}
    portals = np.concatenate([portal.corner_and_edges for portal in lighting.scene.portals])
    return {"portals": portals.astype(np.float32).tobytes(), "sky_chance": lighting.sky_chance}


def _rectangle_uniforms(rectangles: LampRectangles | None) -> dict[str, object]:
    if not rectangles:
        return {}
    return {
        "lamp_rectangles": rectangles.edges.astype(np.float32).tobytes(),
        "lamp_triangles": rectangles.first.astype(np.int32).tobytes(),
    }


def _numbers(cdf: Float64) -> NDArray[np.int64]:
    """Return cumulative probabilities as integers below 2^32."""
    return np.minimum(np.rint(cdf * _ALL), _ALL - 1).astype(np.int64)


def _pieces(lighting: Lighting, lights: Sequence[Light]) -> tuple[NDArray[np.int64], UInt32]:
    """Return (P,) the 32-bit number at which the range of each piece begins, and the table of pieces.

    A last entry of the table marks the end of the last range.
    """
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
    first, index = len(lighting.sides), indices_by_id(lights)
    for number, light in enumerate(lighting.punctual, first):
        begin.append(cdf[number : number + 1])
        which.append(np.array([index[id(light)]]))
        weight.append(np.diff(cdf[number : number + 2]))
        kinds.append(np.array([LIGHT_KINDS.index(light.kind)]))
    if lighting.sky is not None:
        begin.append(cdf[-2:-1])
        which.append(np.zeros(1, np.int64))
        weight.append(np.zeros(1))
        kinds.append(np.array([LIGHT_KINDS.index("sky")]))
    if not begin:  # a scene without light: a black triangle represents it, as in `LightSamples.dark`
        begin, which, weight, kinds = [np.zeros(1)], [np.zeros(1, np.int64)], [np.ones(1)], [np.zeros(1, np.int64)]
    starts = _numbers(np.concatenate(begin))
    table = np.zeros((len(starts) + 1, 1, 4), np.uint32)
    table[:-1, 0, 0] = starts
    table[-1, 0, 0] = 0xFFFFFFFF
    table[:-1, 0, 1] = np.concatenate(which)
    table[:-1, 0, 2] = np.concatenate(weight).astype(np.float32).view(np.uint32)
    table[:-1, 0, 3] = np.concatenate(kinds)
    return starts, table


def _tree_tables(lighting: Lighting, lights: Sequence[Light]) -> tuple[UInt32, UInt32, UInt32]:
    """Return the tree's nodes (M, 1, 16), its leaves (the pieces), and the position of each shape's pieces."""
    tree, scene = LightTree.over(Emitters.of(lighting)), lighting.scene
    leaves = np.zeros((len(tree.trail), 1, 4), np.uint32)
    leaves[:, 0, 0] = tree.trail
    shapes = np.zeros((len(scene.shapes), 1, 4), np.uint32)
    areas, piece = scene.areas, 0
    for side in lighting.sides:
        triangles = side.first + np.arange(len(side.cdf) - 1)
        part = leaves[piece : piece + len(triangles), 0]
        part[:, 1] = triangles
        part[:, 2] = _bits(1.0 / areas[triangles])
        part[:, 3] = LIGHT_KINDS.index("area") + _BACK * (side.sign < 0)
        shapes[side.shape, 0, 0] = side.first
        shapes[side.shape, 0, 1 if side.sign > 0 else 2] = piece
        piece += len(triangles)
    index = indices_by_id(lights)
    for light, part in zip(positional(lighting), leaves[piece:, 0], strict=True):
        part[1] = index[id(light)]
        part[2] = _bits(np.ones(1))[0]
        part[3] = LIGHT_KINDS.index(light.kind)
    return _nodes(tree), leaves, shapes


def _nodes(tree: LightTree) -> UInt32:
    """Return (M, 1, 16) nodes in the format of `light_tree.glsl`; balls and cones are enlarged against rounding."""
    nodes = np.zeros((len(tree.child), 2, 8), np.uint32)
    nodes[:, :, :3] = _bits(tree.centre)
    padding = 1e-5 * tree.radius + 1e-6 * np.abs(tree.centre).max(axis=2)
    nodes[:, :, 3] = _bits(np.where(tree.radius > 0, tree.radius + padding, 0.0))
    octahedral, axis = _octahedral(tree.axis)
    turned = np.arccos(np.clip(np.sum(axis * tree.axis, axis=2), -1.0, 1.0))
    inner, outer = np.minimum(tree.inner + turned, np.pi), tree.outer
    nodes[:, :, 4] = _pair(octahedral)
    nodes[:, :, 5] = _pair(np.floor(np.cos(np.stack([inner, outer], axis=2)) * _SNORM).astype(np.int64))
    nodes[:, :, 6] = _bits(tree.strength)
    nodes[:, :, 7] = tree.child.astype(np.int32).view(np.uint32)
    return nodes.reshape(-1, 1, 16)


def _octahedral(axis: Float64) -> tuple[NDArray[np.int64], Float64]:
    """Return octahedral codes (..., 2) of unit vectors (..., 3) in steps of 1 / 32767, and the decoded vectors.

    Source:   Cigolle et al. 2014, A survey of efficient representations for independent unit vectors.
    """
    scaled = axis / np.abs(axis).sum(axis=-1, keepdims=True)
    turned = np.where(scaled[..., :2] < 0, -1.0, 1.0)
    folded = np.where(scaled[..., 2:] < 0, (1 - np.abs(scaled[..., 1::-1])) * turned, scaled[..., :2])
    steps = np.rint(folded * _SNORM).astype(np.int64)
    xy = steps / _SNORM
    z = 1 - np.abs(xy).sum(axis=-1, keepdims=True)
    xy = xy + np.where(xy < 0, 1.0, -1.0) * np.maximum(-z, 0.0)
    found = np.concatenate([xy, z], axis=-1)
    return steps, found / np.linalg.norm(found, axis=-1, keepdims=True)


def _pair(steps: NDArray[np.int64]) -> UInt32:
    """Pack two 16-bit integers into one 32-bit integer."""
    return ((steps[..., 0] & 0xFFFF) | ((steps[..., 1] & 0xFFFF) << 16)).astype(np.uint32)


def _bits(numbers: Float64) -> UInt32:
    return numbers.astype(np.float32).view(np.uint32)


def _sky_tables(lighting: Lighting) -> tuple[UInt32, UInt32]:
    """Return the tables of an environment map: halves of its rows, and each row's texels; empty without a map."""
    sky = lighting.sky
    if not isinstance(sky, Environment):
        return np.zeros((0, 1, 4), np.uint32), np.zeros((0, 1, 4), np.uint32)
    rows, order, mass, columns = sky.choices
    halves = np.zeros((len(order), 1, 4), np.uint32)
    halves[:, 0, 0], halves[:, 0, 1] = _numbers(rows[:-1]), order
    halves[:, 0, 2] = mass[order].astype(np.float32).view(np.uint32)
    return halves, _in_fours(_numbers(columns[:, :-1]))


def _in_fours(numbers: NDArray[np.int64]) -> UInt32:
    """Return N integers as (ceil(N / 4), 1, 4) texels; unused components are 0xFFFFFFFF."""
    table = np.full(-(-numbers.size // 4) * 4, 0xFFFFFFFF, np.uint32)
    table[: numbers.size] = numbers.ravel()
    return table.reshape(-1, 1, 4)
