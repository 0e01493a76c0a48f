"""The BVH on the device, for rays that no buffer can foresee: reflections and shadow rays [TB VI].

Boxes lie in a texture in depth-first order, each with the number of the node that follows its subtree, so a
traversal needs no stack. All are integers, a box's corners as the bits of floats. Planes have no box; every ray is
tested with them.

Cost:     building it, seconds for a million primitives; per ray about the logarithm of their number.
"""

from __future__ import annotations

import moderngl
import numpy as np

from glpath.accel.bvh import build_bvh
from glpath.gl.device_scene import DeviceScene
from glpath.gl.texel_store import UINTS, make_store, store_glsl

#: The contents of a node's texels, and a leaf's.
LAYOUT: dict[str, dict[str, str]] = {
    "node": {
        "LOWER": "bits of a corner of the box; the node after this one's subtree",
        "UPPER": "bits of the other corner; number of the leaf + 1, 0 for an inner node",
    },
    "leaf": {"PRIMITIVES": "numbers + 1 of up to four primitives, 0 for none"},
}
_LEAF = 4
# Boxes are widened by this share of their position and size, more than rounding moves what lies in them.
_PAD = 2e-6


def bvh_glsl() -> str:
    """The layout as GLSL, for `#include <BVH>`."""
    return "uniform int node_count;\n" + store_glsl("bvh", UINTS, LAYOUT)


class DeviceBvh:
    """The BVH over the primitives of a `DeviceScene`, planes excepted.

    textures, uniforms : for programs that include object_bvh.glsl, with `bvh_glsl()` as <BVH>
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene) -> None:
        count = scene.numbering.first_plane
        lower, upper = scene.boxes
        tree = build_bvh(lower[:count], upper[:count], leaf_size=_LEAF)
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
        source = scene.scene.source or scene.scene.name
        tables = {"node": node_table, "leaf": primitives[:, None, :]}
        texture, bases = make_store(gl, UINTS, LAYOUT, tables, source)
        self.textures = {"bvh": texture}
        self.uniforms: dict[str, object] = {"node_count": nodes, **bases}
