"""BVH over the lights of a scene, which selects one for a position by a bound of its contribution.

A node stores a ball about its lights, a cone of their axes, the angle beyond that cone in which they emit, and
their strength. At a node, a child is selected by an upper bound of its irradiance at the position. The bound is
strength over squared distance, times two cosines: of the smallest angle to an axis, and to the position's normal.
Lights that cannot reach the position are never selected. `shaders/lights/light_tree.glsl` does the same on the
device.

The tree contains lights with a position: each side of an emitting triangle, points and spots, also those with a
profile. It excludes distant lights and lights without falloff.

Cost:     64 bytes a light on the device; the build takes some 50 microseconds a light.
Poor at:  occluded lights, because the tree ignores shadows.
Source:   Conty Estevez & Kulla 2018, Importance sampling of many lights with adaptive tree splitting; Pharr, Jakob
          & Humphreys 2023, Physically based rendering, 12.6.3, for the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.scene.model import Float64, Light
from glpath.scene.spot_cone import spot_fade

Int64 = NDArray[np.int64]

# Number of bins along an axis, into which lights are sorted by centroid to find the cheapest split.
_BINS = 12
# Number of upper levels at which nodes are split by cost. Below, they are split in halves, so that a trail has at
# most 32 bits.
_SPLIT_BY_COST = 11
#: Maximum number of levels.
MAX_DEPTH = 32
# Padding in radians of the angles of spots and profiles, which are sampled in steps of a quarter of a degree.
_MARGIN = np.radians(1.0)


@dataclass(frozen=True)
class Emitters:
    """N lights with a position.

    corners  : (N, 3, 3) corners of a triangle; three times the position of a point
    axis     : (N, 3) unit
    inner    : (N,) radians: angle from the axis up to which a light may have its full strength
    outer    : (N,) radians, at most a right angle: range beyond `inner` in which a cosine bounds the light; no
               light beyond
    strength : (N,) maximum W sr^-1, mean of the channels, > 0
    """

    corners: Float64
    axis: Float64
    inner: Float64
    outer: Float64
    strength: Float64

    def __len__(self) -> int:
        return len(self.strength)

    @classmethod
    def of(cls, lighting: Lighting) -> Emitters:
        """Collect the triangles of `lighting.sides`, in their order, then the punctual lights of `positional`."""
        scene, sides, points = lighting.scene, lighting.sides, positional(lighting)
        triangles = [side.first + np.arange(len(side.cdf) - 1) for side in sides]
        cones = [_cone(light) for light in points]
        count = sum(len(each) for each in triangles)
        normals = scene.normals
        return cls(
            corners=np.concatenate(
                [
                    *(scene.triangles[each] for each in triangles),
                    np.repeat([light.position for light in points], 3, axis=0).reshape(-1, 3, 3),
                ]
            ),
            axis=np.concatenate(
                [
                    *(normals[each] * side.sign for each, side in zip(triangles, sides, strict=True)),
                    np.reshape([light.direction for light in points], (-1, 3)),
                ]
            ),
            inner=np.concatenate([np.zeros(count), [inner for inner, _ in cones]]),
            outer=np.concatenate([np.full(count, 0.5 * np.pi), [outer for _, outer in cones]]),
            strength=np.concatenate(
                [
                    *(side.area * side.radiance.mean() * np.diff(side.cdf) for side in sides),
                    [_peak(light) for light in points],
                ]
            ),
        )


def positional(lighting: Lighting) -> tuple[Light, ...]:
    """Return the punctual lights of a tree: those with a position and falloff."""
    return tuple(x for x in lighting.punctual if x.kind != "directional" and x.falloff == "quadratic")


def others(lighting: Lighting) -> Lighting:
    """Return the lights outside a tree: directional ones, those without falloff, and the sky."""
    in_tree = {id(x) for x in positional(lighting)}
    chances = np.diff(lighting.cdf)[len(lighting.sides) :]
    kept = [i for i, x in enumerate(lighting.punctual) if id(x) not in in_tree]
    rest = tuple(lighting.punctual[i] for i in kept)
    kept += [] if lighting.sky is None else [len(lighting.punctual)]
    cdf = np.concatenate([[0.0], np.cumsum(chances[kept])])
    return replace(lighting, sides=(), punctual=rest, cdf=cdf / cdf[-1] if kept else cdf)


def _peak(light: Light) -> float:
    return float(light.intensity.mean()) * (1.0 if light.profile is None else light.profile.max)


def _cone(light: Light) -> tuple[float, float]:
    """Return `inner` and `outer` of a punctual light: beyond `inner` a cosine bounds its light."""
    gamma = np.radians(np.linspace(0.0, 180.0, 721))
    if light.profile is not None:
        first, last = np.radians(light.profile.gamma)
        rows = np.arange(0.0, 360.0, 360.0 / len(light.profile.candela))
        each = [light.profile.at(np.full_like(gamma, c), np.degrees(gamma)) for c in rows]
        sent = np.max(each, axis=0) / light.profile.max
        sent[(gamma < first - _MARGIN) | (gamma > last + _MARGIN)] = 0.0
    elif light.kind == "spot":
        full, end = np.cos(np.radians(light.cone))
        sent = spot_fade(np.cos(gamma), full, end)
    else:
        return np.pi, 0.5 * np.pi
    shining = np.flatnonzero(sent > 0)
    last = min(np.pi, float(gamma[shining[-1]]) + _MARGIN)
    inner = float(np.max(gamma[shining] - np.arccos(np.minimum(sent[shining], 1.0)))) + _MARGIN
    inner = min(max(inner, last - 0.5 * np.pi, 0.0), np.pi)
    return inner, min(max(last - inner, 0.0), 0.5 * np.pi)


@dataclass(frozen=True)
class LightTree:
    """Tree of M = N - 1 nodes over N emitters, the root first; arrays (M, 2, ...) describe both children.

    centre, radius : (M, 2, 3), (M, 2), ball about a child's lights
    axis           : (M, 2, 3) unit, axis of the cone that contains their axes
    inner, outer   : (M, 2) radians, as in `Emitters`
    strength       : (M, 2) sum over the child's lights
    child          : (M, 2) int: number of a node, or of an emitter as -1 - number
    trail          : (N,) int: bit i selects the child that leads to an emitter at level i
    """

    centre: Float64
    radius: Float64
    axis: Float64
    inner: Float64
    outer: Float64
    strength: Float64
    child: Int64
    trail: Int64

    @classmethod
    def over(cls, emitters: Emitters) -> LightTree:
        """Build the tree level by level, from the top; requires at least two emitters."""
        n = len(emitters)
        assert n >= 2, "something to choose from"
        items, counts = np.arange(n), np.array([n])
        trail = np.zeros(n, np.int64)
        levels: list[tuple[NDArray[Any], ...]] = []
        nodes = 1
        for level in range(MAX_DEPTH):
            begins = np.cumsum(counts) - counts
            segment = np.repeat(np.arange(len(counts)), counts)
            left = _left(emitters, items, segment, begins, counts, by_cost=level < _SPLIT_BY_COST)
            items = items[np.lexsort((~left, segment))]
            lefts = np.bincount(segment, left, len(counts)).astype(np.int64)
            sizes = np.stack([lefts, counts - lefts], axis=1).ravel()
            right = np.repeat(np.arange(len(sizes)) & 1, sizes)
            trail[items] |= right << level
            starts = np.cumsum(sizes) - sizes
            inner_nodes = sizes > 1
            child = np.where(inner_nodes, nodes + np.cumsum(inner_nodes) - 1, -1 - items[starts])
            levels.append((*_bounds(emitters, items, starts, sizes), child))
            nodes += int(inner_nodes.sum())
            items, counts = items[np.repeat(inner_nodes, sizes)], sizes[inner_nodes]
            if not len(counts):
                break
        assert not len(counts), "more lights than a trail has bits for"
        whole = [np.concatenate(each) for each in zip(*levels, strict=True)]
        centre, radius, axis, inner, outer, strength, child = (x.reshape(-1, 2, *x.shape[1:]) for x in whole)
        return cls(centre, radius, axis, inner, outer, strength, child.astype(np.int64), trail)

    def chances(self, position: Float64, normal: Float64) -> Float64:
        """Return (N,) probabilities of selecting each emitter for a position (3,) with a unit normal (3,)."""
        reached = np.zeros(len(self.child))
        reached[0] = 1.0
        found = np.zeros(len(self.trail))
        for node in range(len(self.child)):  # parents come before their children
            each = self.importance(node, position, normal)
            total = each.sum()
            for child, chance in zip(self.child[node], each / total if total > 0 else each, strict=True):
                if child >= 0:
                    reached[child] = reached[node] * chance
                else:
                    found[-1 - child] = reached[node] * chance
        return found

    def importance(self, node: int, position: Float64, normal: Float64) -> Float64:
        """Return (2,) irradiance bounds of a node's children for a position (3,) with a unit normal (3,)."""
        away = position - self.centre[node]
        distance = np.linalg.norm(away, axis=1)
        radius = self.radius[node]
        unit = away / np.maximum(distance, np.finfo(float).tiny)[:, None]
        ball = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, 1e-300), 1.0)), np.pi)
        turned = _angle(np.einsum("ij,ij->i", self.axis[node], unit)) - self.inner[node] - ball
        faces = _angle(-unit @ normal) - ball
        bound = np.cos(np.maximum(turned, 0.0)) * np.maximum(np.cos(np.clip(faces, 0.0, np.pi)), 0.0)
        bound /= np.maximum(np.maximum(distance, radius) ** 2, np.finfo(float).tiny)
        return np.asarray(np.where(turned < self.outer[node], np.maximum(bound, 0.0) * self.strength[node], 0.0))


def _angle(cosine: Float64) -> Float64:
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _bounds(emitters: Emitters, items: Int64, starts: Int64, sizes: Int64) -> tuple[Float64, ...]:
    """Return centre, radius, axis, inner, outer and strength of each group of lights, as in `LightTree`.

    items         : (n,) indices of the lights, group after group
    starts, sizes : index in `items` of each group's first light, and the group's number of lights
    """
    corners, axes = emitters.corners[items], emitters.axis[items]
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    high = np.maximum.reduceat(corners.max(axis=1), starts)
    centre = 0.5 * (low + high)
    away = np.linalg.norm(corners - np.repeat(centre, sizes, axis=0)[:, None], axis=2).max(axis=1)
    axis = np.add.reduceat(axes, starts)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    # Axes that cancel give no mean axis: any axis is valid, because the cone covers all directions.
    axis = np.where(length > 1e-9, axis / np.maximum(length, 1e-9), axes[starts])
    apart = _angle(np.einsum("ij,ij->i", axes, np.repeat(axis, sizes, axis=0))) + emitters.inner[items]
    return (
        centre,
        np.maximum.reduceat(away, starts),
        axis,
        np.minimum(np.maximum.reduceat(apart, starts), np.pi),
        np.maximum.reduceat(emitters.outer[items], starts),
        np.add.reduceat(emitters.strength[items], starts),
    )


def _left(
    emitters: Emitters, items: Int64, segment: Int64, begins: Int64, counts: Int64, by_cost: bool
) -> NDArray[np.bool_]:
    """Return (n,) bool: True for items that go to the first child of their node.

    segment        : (n,) index of each item's node on this level
    begins, counts : index of the first item of each node, and number of its items
    """
    low, high = emitters.corners[items].min(axis=1), emitters.corners[items].max(axis=1)
    centroid = 0.5 * (low + high)
    first = np.minimum.reduceat(centroid, begins)
    extent = np.maximum.reduceat(centroid, begins) - first
    # Fallback: halves in the order along the longest axis, if no plane is better.
    longest = extent.argmax(axis=1)
    order = np.lexsort((centroid[np.arange(len(items)), longest[segment]], segment))
    rank = np.empty(len(items), np.int64)
    rank[order] = np.arange(len(items))
    left = rank - begins[segment] < (counts // 2)[segment]
    if not by_cost:
        return np.asarray(left)
    scaled = (centroid - first[segment]) * (_BINS / np.maximum(extent, 1e-30))[segment]
    bins = np.clip(scaled, 0, _BINS - 1).astype(np.int64)
    costs = np.stack(
        [_costs(emitters, items, segment, bins[:, a], low, high, len(counts)) for a in range(3)], axis=1
    )
    # Planes along short axes get a penalty, because long boxes should be divided along their length.
    scale = extent.max(axis=1, keepdims=True) / np.maximum(extent, 1e-30)
    costs = np.where(extent[:, :, None] > 0, costs * np.maximum(scale, 1.0)[:, :, None], np.inf)
    flat = costs.reshape(len(counts), -1)
    best = flat.argmin(axis=1)
    axis, plane = np.divmod(best, _BINS - 1)
    useful = np.isfinite(flat[np.arange(len(counts)), best])
    by_plane = bins[np.arange(len(items)), axis[segment]] <= plane[segment]
    return np.asarray(np.where(useful[segment], by_plane, left))


def _costs(
    emitters: Emitters, items: Int64, segment: Int64, bins: Int64, low: Float64, high: Float64, segments: int
) -> Float64:
    """Return (segments, _BINS - 1) costs of the planes between bins.

    The cost is strength times squared extent times angular spread, summed over both sides of a plane.
    """
    cell, shape = segment * _BINS + bins, (segments, _BINS)
    size = segments * _BINS

    def sums(values: Float64 | None = None) -> Float64:
        return np.bincount(cell, values, size).astype(np.float64).reshape(shape)

    lower, upper = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)
    np.minimum.at(lower, cell, low)
    np.maximum.at(upper, cell, high)
    # The mean vector of a uniform cone has this length, so the length of a sum of cones measures their width.
    mean = emitters.axis[items] * (0.5 + 0.5 * np.cos(emitters.inner[items]))[:, None]
    count, strength = sums(), sums(emitters.strength[items])
    vector = np.stack([sums(mean[:, k]) for k in range(3)], axis=-1)
    box = (lower.reshape(*shape, 3), upper.reshape(*shape, 3))
    before = _cost_up_to(count, strength, vector, *box)[:, :-1]
    turned = (x[:, ::-1] for x in (count, strength, vector, *box))
    return before + _cost_up_to(*turned)[:, ::-1][:, 1:]


def _cost_up_to(count: Float64, strength: Float64, vector: Float64, low: Float64, high: Float64) -> Float64:
    """Return (segments, bins) costs of the items in each bin and all earlier ones; infinite without items."""
    n = np.cumsum(count, axis=1)
    extent = np.maximum.accumulate(high, axis=1) - np.minimum.accumulate(low, axis=1)
    square = np.sum(np.where(n[:, :, None] > 0, extent, 0.0) ** 2, axis=2)
    length = np.linalg.norm(np.cumsum(vector, axis=1), axis=2) / np.maximum(n, 1.0)
    cosine = np.clip(2.0 * length - 1.0, -1.0, 1.0)
    inner = np.arccos(cosine)
    sine, end = np.sin(inner), np.minimum(inner + 0.5 * np.pi, np.pi)
    spread = 2 * np.pi * (1 - cosine)
    spread += 0.5 * np.pi * (2 * end * sine - np.cos(inner - 2 * end) - 2 * inner * sine + cosine)
    return np.asarray(np.where(n > 0, np.cumsum(strength, axis=1) * square * spread, np.inf))
