"""BVH of Goldsmith and Salmon: items are inserted one by one, each at the node with the lowest cost.

The statistics in the paper on shafts [SC] use this BVH, whose inner nodes may have any number of children. It
serves for comparison. The trees of `glpath.accel.bvh.build_bvh` cost less by Goldsmith and Salmon's own measure.

Cost:     0.2 s for a hundred thousand items scattered in a cube.

[Goldsmith 1987] J. Goldsmith, J. Salmon, "Automatic creation of object hierarchies for ray tracing", IEEE Computer
Graphics and Applications 7(5), 14-20.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from glpath.accel.bvh import Float64, Int32, checked_boxes
from glpath.accel.nodes import Bvh, Tree
from glpath.system.kernels import inner_kernel, kernel, kernel_part


def cluster(lower: ArrayLike, upper: ArrayLike, seed: int = 1) -> Bvh:
    """Build a BVH whose leaves are single items, by insertion [Goldsmith 1987].

    Parameters
    ----------
    lower, upper : (N, 3) corners of the items' boxes, finite; boxes may be flat, points, or equal to each other
    seed         : seed of the random order of insertion; inserting neighbours in succession would make long chains

    Raises UsageError if boxes are not finite or have lower > upper.
    """
    low, high = checked_boxes(lower, upper)
    boxes = np.concatenate([low, high], axis=1)
    coming = np.random.default_rng(seed).permutation(len(boxes)).astype(np.int32)
    links = _Links.of(boxes)
    tree = Tree.empty(len(boxes))
    root = _insert_all(boxes, coming, links)
    return tree.bvh(_flatten(links, root, tree, np.empty(2 * len(tree.skip) + 1, np.int32)))


class _Links(NamedTuple):
    """Tree as links between nodes. Nodes below N are the items, the others are inner nodes; -1 is no node.

    boxes                  : (2 N, 6), boxes of nodes; the first N are those of the items
    child, sibling, parent : (2 N,), first child, next child of the same parent, and parent
    children               : (2 N,), number of children
    """

    boxes: Float64
    child: Int32
    sibling: Int32
    parent: Int32
    children: Int32

    @classmethod
    def of(cls, boxes: Float64) -> _Links:
        """Allocate a tree over the items' boxes."""
        child, sibling, parent = np.full((3, 2 * len(boxes)), -1, np.int32)
        return cls(np.concatenate([boxes, boxes]), child, sibling, parent, np.zeros(len(child), np.int32))


@kernel
def _insert_all(boxes, coming, links):  # type: ignore[no-untyped-def]
    """Link all items in the order of `coming`; return the root, or -1 without items."""
    nodes, child, sibling, parent, children = links
    n = len(boxes)
    size = n
    root = -1
    for i in range(n):
        item = coming[i]
        if root < 0:
            root = item
            continue
        # Descend along the smallest growth, and choose the cheapest parent among these nodes. Testing a node's
        # children costs its area times their number, so its growth costs the additional area times their number.
        node, inherited, best, chosen = root, 0.0, np.inf, -1
        while True:
            grown = _union_area(nodes, node, boxes, item)
            if node < n:  # the leaf is replaced by a pair
                cost = inherited + 2 * grown
            else:
                inherited += (grown - _area(nodes, node)) * children[node]
                cost = inherited + grown
            if cost < best:
                best, chosen = cost, node
            if node < n or inherited >= best:
                break
            below, min_growth, min_area = child[node], np.inf, np.inf
            while below >= 0:
                area = _area(nodes, below)
                growth = _union_area(nodes, below, boxes, item) - area
                if growth < min_growth or (growth == min_growth and area < min_area):
                    min_growth, min_area, node = growth, area, below
                below = sibling[below]
        if chosen < n:
            pair = size
            size += 1
            for k in range(6):
                nodes[pair, k] = nodes[chosen, k]
            _replace(root, chosen, pair, links)
            if chosen == root:
                root = pair
            child[pair], children[pair] = chosen, 1
            sibling[chosen], parent[chosen] = -1, pair
            chosen = pair
        sibling[item], parent[item] = child[chosen], chosen
        child[chosen] = item
        children[chosen] += 1
        while chosen >= 0:
            for k in range(3):
                nodes[chosen, k] = min(nodes[chosen, k], boxes[item, k])
                nodes[chosen, k + 3] = max(nodes[chosen, k + 3], boxes[item, k + 3])
            chosen = parent[chosen]
    return root


@kernel_part
def _replace(root, old, new, links):  # type: ignore[no-untyped-def]
    child, sibling, parent = links.child, links.sibling, links.parent
    above = parent[old]
    parent[new] = above
    sibling[new] = sibling[old]
    if old == root:
        return
    if child[above] == old:
        child[above] = new
        return
    before = child[above]
    while sibling[before] != old:
        before = sibling[before]
    sibling[before] = new


@kernel
def _flatten(links, root, tree, pending):  # type: ignore[no-untyped-def]
    """Convert the links to depth-first arrays; return the number of nodes.

    pending : working memory, a stack of links still to visit; the entry ~node marks the end of a node's subtree
    """
    linked, child, sibling = links.boxes, links.child, links.sibling
    nodes, skip, first, count, order = tree
    n = len(order)
    waiting, items, node = 0, 0, 0
    if root >= 0:
        pending[0] = root
        waiting = 1
    while waiting:
        waiting -= 1
        link = pending[waiting]
        if link < 0:
            skip[~link] = node
            continue
        for k in range(6):
            nodes[node, k] = linked[link, k]
        first[node] = items
        if link < n:
            order[items] = link
            items += 1
            count[node] = 1
            skip[node] = node + 1
        else:
            count[node] = 0
            pending[waiting] = ~node
            waiting += 1
            below = child[link]
            while below >= 0:
                pending[waiting] = below
                waiting += 1
                below = sibling[below]
        node += 1
    return node


@inner_kernel
def _area(boxes, i):  # type: ignore[no-untyped-def]
    x, y, z = boxes[i, 3] - boxes[i, 0], boxes[i, 4] - boxes[i, 1], boxes[i, 5] - boxes[i, 2]
    return x * y + y * z + z * x


@inner_kernel
def _union_area(a, i, b, j):  # type: ignore[no-untyped-def]
    x = max(a[i, 3], b[j, 3]) - min(a[i, 0], b[j, 0])
    y = max(a[i, 4], b[j, 4]) - min(a[i, 1], b[j, 1])
    z = max(a[i, 5], b[j, 5]) - min(a[i, 2], b[j, 2])
    return x * y + y * z + z * x
