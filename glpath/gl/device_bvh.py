"""BVH on the device, for rays that no buffer can serve: reflections and shadow rays [TB VI].

Boxes lie in a texture in depth-first order, each with the number of the node that follows its subtree, so a
traversal needs no stack. All values are integers; the corners of boxes are the bits of floats. Planes have no box;
every ray is tested against each plane.

Cost:     building it, seconds for a million primitives; a ray visits about as many nodes as the logarithm of the
          primitive count.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import build_bvh
from glpath.gl.device_scene import DeviceScene
from glpath.gl.texel_store import FLOATS, UINTS, WIDTH, make_store, store_glsl
from glpath.scene.model import Float64

#: Contents of the texels of a node and of a leaf.
LAYOUT: dict[str, dict[str, str]] = {
    "node": {
        "LOWER": "bits of a corner of the box; the node after this one's subtree",
        "UPPER": "bits of the other corner; number of the leaf + 1, 0 for an inner node",
    },
    "leaf": {"PRIMITIVES": "numbers + 1 of up to four primitives, 0 for none"},
}
OCCLUDER_LAYOUT: dict[str, dict[str, str]] = {
    "occluder": {
        "A": "of a streamed triangle: a corner; its number's lowest 16 bits",
        "B": "a corner; the number's other bits",
        "C": "a corner",
    },
}
_LEAF = 4
# Padding of a box as a fraction of its maximum absolute coordinate; it exceeds the rounding error of the primitives
# inside.
_PAD = 2e-6


def bvh_glsl() -> str:
    """Return the BVH layout as GLSL, for `#include <BVH>`."""
    return "uniform int node_count;\n" + store_glsl("bvh", UINTS, LAYOUT)


class DeviceBvh:
    """BVH over the primitives of a `DeviceScene`, except planes.

    textures, uniforms : inputs of programs that include object_bvh.glsl, with `bvh_glsl()` as <BVH>
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene) -> None:
        count = scene.numbering.first_plane
        lower, upper = scene.boxes
        self._put(gl, lower[:count], upper[:count], scene.scene.source or scene.scene.name)

    def _put(self, gl: moderngl.Context, lower: Float64, upper: Float64, source: str) -> None:
        """Build the BVH over boxes (N, 3)."""
        count = len(lower)
        tree = build_bvh(lower, upper, leaf_size=_LEAF)
        nodes = len(tree)
        leaves = np.flatnonzero(tree.count)
        pad = _PAD * (np.maximum(np.abs(tree.lower), np.abs(tree.upper)).max(axis=1, initial=0.0))[:, None]
        node_table = np.zeros((nodes, 2, 4), np.uint32)
        node_table[:, 0, :3] = (tree.lower - pad).astype(np.float32).view(np.uint32)
        node_table[:, 1, :3] = (tree.upper + pad).astype(np.float32).view(np.uint32)
        node_table[:, 0, 3] = tree.skip
        node_table[leaves, 1, 3] = np.arange(1, len(leaves) + 1)
        position = tree.first[leaves, None] + np.arange(_LEAF)
        primitives = np.where(
            np.arange(_LEAF) < tree.count[leaves, None], tree.order[np.minimum(position, max(count - 1, 0))] + 1, 0
        )
        tables = {"node": node_table, "leaf": primitives[:, None, :]}
        texture, bases = make_store(gl, UINTS, LAYOUT, tables, source)
        self.textures = {"bvh": texture}
        self.uniforms: dict[str, object] = {"node_count": nodes, **bases}


def occluders_glsl() -> str:
    """Return the layout of the triangles of `StreamedBvh` as GLSL, for `#include <OCCLUDERS>`."""
    return store_glsl("occluders", FLOATS, OCCLUDER_LAYOUT)


class StreamedBvh(DeviceBvh):
    """BVH over part of the streamed triangles, which no `DeviceScene` contains, together with their corners.

    corners : (T, 3, 3) float32
    number  : (T,) index of each triangle among all streamed triangles
    source  : scene name for error messages

    textures, uniforms : inputs of programs that include stream_bvh.glsl, with `bvh_glsl()` as <BVH> and
                         `occluders_glsl()` as <OCCLUDERS>
    """

    def __init__(
        self, gl: moderngl.Context, corners: NDArray[np.float32], number: NDArray[np.int64], source: str
    ) -> None:
        self._put(gl, corners.min(axis=1).astype(np.float64), corners.max(axis=1).astype(np.float64), source)
        texture, bases = make_store(gl, FLOATS, OCCLUDER_LAYOUT, {"occluder": _Occluders(corners, number)}, source)
        self.textures["occluders"] = texture
        self.uniforms |= bases

    @staticmethod
    def max_count(gl: moderngl.Context) -> int:
        """Return the maximum number of triangles that a texture of the device holds."""
        return int(gl.info["GL_MAX_TEXTURE_SIZE"]) * WIDTH // 3


class _Occluders:
    """Table of triangles whose rows are computed as they are written to the device."""

    def __init__(self, corners: NDArray[np.float32], number: NDArray[np.int64]) -> None:
        self._corners, self._number = corners, number
        self.shape = (len(corners), 3, 4)

    def __getitem__(self, which: slice) -> NDArray[Any]:
        corners, number = self._corners[which], self._number[which]
        table = np.zeros((len(corners), 3, 4), np.float32)
        table[:, :, :3] = corners
        # Both parts are integers that 32-bit floats represent exactly.
        table[:, 0, 3], table[:, 1, 3] = number & 0xFFFF, number >> 16
        return table
