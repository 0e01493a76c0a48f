"""A hierarchy of boxes on the device, for rays that no buffer can foresee: reflections and shadow rays [TB VI].

Boxes lie in a float texture in depth-first order, each with the number of the node that follows its subtree, so a
traversal needs no stack. Planes have no box; every ray is tested with them.

Cost:     building it, seconds for a million primitives; per ray about the logarithm of their number.
"""

from __future__ import annotations

import moderngl
import numpy as np

from glpath.gl.gpu_objects import GpuObjects, texel_store_glsl
from glpath.hierarchy import build_hierarchy

#: What a node's texels hold, and a leaf's.
LAYOUT: dict[str, dict[str, str]] = {
    "node": {
        "LOWER": "corner of the box; the node after this one's subtree",
        "UPPER": "corner; number of the leaf, -1 for an inner node",
    },
    "leaf": {"PRIMITIVES": "numbers of up to four primitives, -1 for none"},
}
_LEAF = 4
# Boxes are widened by this share of their place and size, more than rounding moves what lies in them.
_PAD = 2e-6


def hierarchy_glsl() -> str:
    """The layout as GLSL."""
    return "\n".join(["uniform int node_count;", *texel_store_glsl("hierarchy", LAYOUT)])


class GpuHierarchy:
    """The hierarchy over the primitives of `GpuObjects`, planes excepted.

    textures, uniforms : for programs that include object_hierarchy.glsl, with `hierarchy_glsl()` as <HIERARCHY>
    """

    def __init__(self, gl: moderngl.Context, objects: GpuObjects) -> None:
        count = objects.numbering.first_plane
        tree = build_hierarchy(objects.lower[:count], objects.upper[:count], leaf_size=_LEAF)
        nodes = len(tree)
        leaves = np.flatnonzero(tree.count)
        pad = _PAD * (np.maximum(np.abs(tree.lower), np.abs(tree.upper)).max(axis=1, initial=0.0))[:, None]
        node_table = np.full((nodes, 2, 4), -1.0)
        node_table[:, 0, :3] = tree.lower - pad
        node_table[:, 1, :3] = tree.upper + pad
        node_table[:, 0, 3] = tree.skip
        node_table[leaves, 1, 3] = np.arange(len(leaves))
        place = tree.first[leaves, None] + np.arange(_LEAF)
        primitives = np.where(
            np.arange(_LEAF) < tree.count[leaves, None], tree.order[np.minimum(place, max(count - 1, 0))], -1
        )
        texture, bases = objects.store({"node": node_table, "leaf": primitives[:, None, :]}, LAYOUT)
        self.textures = {"hierarchy": texture}
        self.uniforms: dict[str, object] = {"node_count": nodes, **bases}
