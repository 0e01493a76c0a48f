"""Path guiding by a radiosity solution: the distribution of incident light, known before a path is traced.

Nearly all of a gather's error comes from its first bounce, because most directions lead to dark walls, few to
bright ones. The solution contains that information. Neighbouring elements with a common normal share a guide. It
has 16 x 16 cells of directions, of equal cosine-weighted solid angle. Each cell holds the root mean square of the
incident radiance. A constant is added to all cells, so that no light unknown to the guide gets a low probability. A
path's two random numbers are warped down a tree of the cells, which keeps much of their uniformity. The path's
weight is divided by the density. Fronts of triangles have guides, backs have none.

Cost:     340 bytes a guide, at most 2048 guides; eight rays for each pixel of the image to build them, at least
          half a million. A choice reads five texels.
Poor at:  light that differs between the elements that share a guide, beside an emitter or behind a small opening.
Source:   Jensen 1995, Importance driven path tracing using the photon map; Clarberg et al. 2005, Wavelet importance
          sampling; Vorba et al. 2014, On-line learning of parametric mixture models for light transport simulation.
"""

from __future__ import annotations

import time

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass, draw_areas, run_in_areas
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.texel_store import BYTES, FLOATS, make_store, store_glsl
from glpath.scene.model import Float64, Scene

Int64 = NDArray[np.int64]

_LEVELS = 4
_MAX_GUIDES = 2048
_POINTS = 16  # number of start points of a guide's rays
# Minimum number of rays in a cell of directions. The maximum is one from each start point of the guide.
_MIN_RAYS = 2
# Minimum number of rays in all cells of all guides together.
_MIN_BUDGET = 1 << 19
# Number of rays in all cells together, per pixel of the image. They take as long as one or two path sets. With four
# times as many rays, the squared error falls by a tenth in `room`, where elements share guides, and by half that in
# the Cornell box. Four times as many guides with the same number of rays do not reduce it further.
_RAYS_A_PIXEL = 8
_TESTS_A_RAY = 100
# Fraction of the density given to plain cosine sampling. With a smaller fraction, hits in directions that no guide
# ray found get larger weights.
_UNGUIDED = 0.3

_LAYOUT = {
    "guide_of": {"ELEMENT": "of an element: the number of its guide, in three bytes"},
    "guide_node": {
        "SHARES": "of a cell: what its four quarters have, in 255ths of what the greatest has: left and right, "
        "then above"
    },
}
_POINTS_LAYOUT = {"guide_point": {"POSITION": "world space; number of its triangle"}}


def path_guide_glsl() -> str:
    """Return the layout as GLSL, for `#include <PATH_GUIDE>`."""
    return store_glsl("path_guide", BYTES, _LAYOUT)


class PathGuide:
    """Guides for the elements of a solution, on the device.

    radiosity : solution on the device, created with `all_light`
    pixels    : number of pixels of the whole image; more pixels justify more rays
    rays      : parts of the program that casts the rays, including the lights

    textures, uniforms, generated, defines : inputs of programs that include path_guide.glsl
    seconds : time to build the guides
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        radiosity: DeviceRadiosity,
        pixels: int,
        rays: ProgramParts,
    ) -> None:
        begun = time.perf_counter()
        budget = max(_MIN_BUDGET, _RAYS_A_PIXEL * pixels)
        guide_of, points = guide_points(scene.scene, radiosity.divisions, radiosity.leaf)
        count = len(points)
        table = points.reshape(-1, 1, 4)
        point_texture, bases = make_store(gl, FLOATS, _POINTS_LAYOUT, {"guide_point": table}, "path guides")
        side, across = 1 << _LEVELS, max(1, int(np.ceil(np.sqrt(count))))
        rays_each = _MIN_RAYS
        while rays_each < _POINTS and 2 * rays_each * side * side * count <= budget:
            rays_each *= 2
        size = (side * across, side * max(1, -(-count // across)))
        target = gl.texture(size, 1, dtype="f4")
        framebuffer = gl.framebuffer([target])
        program = load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="path/path_guide.frag",
            generated={**rays.generated, "GUIDE_POINTS_STORE": store_glsl("guide_points", FLOATS, _POINTS_LAYOUT)},
            defines={
                **rays.defines,
                "ALL_LIGHT": 1,
                "GUIDE_LEVELS": _LEVELS,
                "GUIDE_POINTS": _POINTS,
                "GUIDE_RAYS": rays_each,
            },
        )
        textures = {**rays.textures, "guide_points": point_texture}
        drawn = Pass("path guides", gl, program, framebuffer, textures=textures)
        known = {**rays.uniforms, **bases, "guide_count": count, "guides_across": across, "random_seed": 0}
        run_in_areas(drawn, draw_areas(size, rays_each * _TESTS_A_RAY), known)
        tiles = np.frombuffer(target.read(), np.float32).reshape(-1, side, across, side)
        light = tiles.swapaxes(1, 2).reshape(-1, side, side)[:count].astype(np.float64)

        bytes_of = np.stack([guide_of & 255, guide_of >> 8 & 255, guide_of >> 16, 0 * guide_of], axis=1)
        nodes = guide_nodes(light)
        tables = {"guide_of": bytes_of.astype(np.uint8)[:, None], "guide_node": nodes.reshape(-1, 1, 4)}
        texture, self.uniforms = make_store(gl, BYTES, _LAYOUT, tables, "path guides")
        self.textures = {"path_guide": texture}
        self.generated = {"PATH_GUIDE": path_guide_glsl()}
        self.defines: dict[str, object] = {"GUIDED": 1, "GUIDE_LEVELS": _LEVELS, "GUIDE_NODES": nodes.shape[1]}
        if len(guide_of) > count:
            self.defines["GUIDES_SHARED"] = 1
        self.seconds = time.perf_counter() - begun


def guide_nodes(light: Float64) -> NDArray[np.uint8]:
    """Return (G, N, 4) nodes of the guides' trees, level by level, row by row, from their cells (G, 2^k, 2^k).

    The second axis of the cells is the angle about the normal, the last axis the distance from the normal.
    """
    # Cells are smoothed with their neighbours, because each has few rays. The axis of angles wraps around.
    around = np.roll(light, 1, 1) + 2.0 * light + np.roll(light, -1, 1)
    edged = np.pad(around, ((0, 0), (0, 0), (1, 1)), mode="edge")
    smooth = edged[..., :-2] + 2.0 * around + edged[..., 2:]
    mean = smooth.mean(axis=(1, 2), keepdims=True)
    density = (1.0 - _UNGUIDED) * np.divide(smooth, mean, out=np.ones_like(smooth), where=mean > 0) + _UNGUIDED
    levels = []
    while density.shape[1] > 1:
        quarters = np.stack([density[:, j::2, i::2] for j in range(2) for i in range(2)], axis=-1)
        levels.append(quarters.reshape(len(density), -1, 4))
        density = quarters.mean(axis=-1)
    nodes = np.concatenate(levels[::-1], axis=1)
    # Shares are at least 1 of 255, because a cell with share 0 would never be sampled.
    shares = 255.0 * nodes / nodes.max(axis=-1, keepdims=True)
    return np.asarray(np.rint(shares).clip(1, 255), np.uint8)


def guide_points(scene: Scene, divisions: NDArray[np.int32], leaf: Int64) -> tuple[Int64, Float64]:
    """Return the guide of each element of the triangles' lattices (E,), and start points on each guide (G, P, 4).

    divisions : (T,) number of segments that each edge of a triangle is divided into
    leaf : (E,) index of the solver's element that contains each lattice element

    A point has its position, world space, and the index of its triangle. If the solver has few elements, each
    element has its own guide with the same index.
    """
    from glpath.radiosity.mesh.mesh import Elements

    elements = Elements.of_lattices(divisions.astype(np.int64))
    count = len(elements.triangle)
    corners = elements.points(scene, np.eye(3)) if count else np.zeros((0, 3, 3))
    guide_of = leaf if leaf.max(initial=-1) < _MAX_GUIDES else _groups(corners)
    guides = int(guide_of.max(initial=-1)) + 1
    # Points are placed at equal steps of cumulative area along each guide's elements.
    order = np.argsort(guide_of, kind="stable")
    along = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.maximum(np.linalg.norm(along, axis=1), 1e-300)[order]
    ends = np.cumsum(area)
    last = np.searchsorted(guide_of[order], np.arange(guides), side="right") - 1
    stop = ends[last]
    start = np.concatenate([[0.0], stop[:-1]])
    shares = (np.arange(_POINTS) + 0.5) / _POINTS
    at = start[:, None] + shares * (stop - start)[:, None]
    chosen = order[np.minimum(np.searchsorted(ends, at), max(0, count - 1))]
    # Points within an element follow a golden-ratio sequence; points beyond the diagonal are folded back.
    b = np.arange(1, chosen.size + 1)[:, None] * (0.7548776662466927, 0.5698402909980532) % 1.0
    b = np.where(b.sum(axis=1, keepdims=True) > 1.0, 1.0 - b, b).reshape(*chosen.shape, 2)
    of = corners[chosen]
    points = of[:, :, 0] + b[..., :1] * (of[:, :, 1] - of[:, :, 0]) + b[..., 1:] * (of[:, :, 2] - of[:, :, 0])
    return guide_of, np.concatenate([points, elements.triangle[chosen][..., None]], axis=2)


def _groups(corners: Float64) -> Int64:
    """Return (E,) indices of at most _MAX_GUIDES groups of elements (E, 3, 3) that are close and face alike."""
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    # The tangent axes of a normal (directions.glsl) jump where its z changes sign, so no group contains both signs.
    facing = np.concatenate([np.rint(1.5 * normal) + 2.0, normal[:, 2:].astype(np.float32) < 0], axis=1)
    facing_key = facing.astype(np.int64) @ (1, 5, 25, 125)
    lower, extent = middle.min(axis=0), float(np.ptp(middle, axis=0).max())
    unit = (middle - lower) / max(extent, 1e-300)
    best = np.zeros(len(corners), np.int64)
    # Group by cells of a grid, which shrink until there are too many groups.
    for steps in range(4 * 16):
        cell = np.floor(unit * 2.0 ** (steps / 4)).astype(np.int64)
        _, found = np.unique(cell @ (1, 1 << 18, 1 << 36) * 256 + facing_key, return_inverse=True)
        if found.max() >= _MAX_GUIDES:
            break
        best = found
    return best
