"""Compiled version (numba) of `glpath.accel.wide` with identical results, for large numbers of boxes.

Cost:     a quarter of a second for a million boxes, on one core; 20 bytes a box beside the trees.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh
from glpath.accel.wide import WIDTH, WideBvh
from glpath.system.kernels import inner_kernel, kernel


class Nodes(NamedTuple):
    """Arrays of a `Bvh`, passed to kernels without copying; `glpath.accel.nodes.Tree` copies the boxes.

    items : `count` of the `Bvh`
    """

    lower: NDArray[Any]
    upper: NDArray[Any]
    skip: NDArray[np.int32]
    first: NDArray[np.int32]
    items: NDArray[np.int32]
    order: NDArray[np.int32]

    @classmethod
    def of(cls, tree: Bvh) -> Nodes:
        """Return the nodes of a tree."""
        return cls(tree.lower, tree.upper, tree.skip, tree.first, tree.count, tree.order)


def collapse_compiled(tree: Bvh, node_cost: float = 0.0) -> WideBvh:
    """Return the same wide tree as `glpath.accel.wide.collapse`, for at least two items, with 32-bit indices.

    node_cost : constant cost of each node in addition to its area, for fewer nodes with more children
    """
    items = len(tree.order)
    assert len(tree) == 2 * items - 1 > 1, "an item a leaf, and two"
    # These arrays may be larger than needed, because memory pages that are never written are never allocated.
    parts, roots = np.zeros((items, WIDTH + 1), np.int8), np.empty(items, np.int32)
    children = np.empty((items, WIDTH), np.int32)
    nodes = Nodes.of(tree)
    _min_cost_parts(nodes, node_cost, parts, np.empty((items + 1, WIDTH)))
    size, stack = _collapse(nodes, parts, np.empty((items, 2), np.int32), children, roots)
    return WideBvh(tree, children[:size], roots[:size], stack)


def octant_orders(wide: WideBvh) -> NDArray[np.uint8]:
    """Return (W, 8), `WideBvh.order` for each octant, packed into two bits per child, first child lowest."""
    orders, splits = np.empty((len(wide), 8), np.uint8), np.empty((WIDTH - 1, 4), np.int64)
    _octant_orders(Nodes.of(wide.tree), wide.children, wide.roots, orders, splits)
    return orders


@kernel
def _min_cost_parts(tree, node_cost, parts, costs):  # type: ignore[no-untyped-def]
    """Fill parts (N, 5) of the inner nodes. costs: stack of costs of subtrees whose parents are still to come."""
    lower, upper, skip, first, count = tree.lower, tree.upper, tree.skip, tree.first, tree.items
    top = 0
    for node in range(len(skip) - 1, -1, -1):
        if count[node]:
            for k in range(WIDTH):
                costs[top, k] = 0.0
            top += 1
            continue
        # The left subtree was pushed last.
        left, right = top - 1, top - 2
        inner = node - first[node]
        x = np.float64(upper[node, 0]) - lower[node, 0]
        y = np.float64(upper[node, 1]) - lower[node, 1]
        z = np.float64(upper[node, 2]) - lower[node, 2]
        area = x * y + y * z + z * x
        cost2 = costs[left, 0] + costs[right, 0]
        cost3, part3 = costs[left, 0] + costs[right, 1], 1
        other = costs[left, 1] + costs[right, 0]
        if other < cost3:
            cost3, part3 = other, 2
        cost4, part4 = costs[left, 0] + costs[right, 2], 1
        other = costs[left, 1] + costs[right, 1]
        if other < cost4:
            cost4, part4 = other, 2
        other = costs[left, 2] + costs[right, 0]
        if other < cost4:
            cost4, part4 = other, 3
        best = area + node_cost + cost4
        costs[right, 0] = best
        parts[inner, 0] = part4
        parts[inner, 2] = 1 if cost2 < best else -1
        best = min(best, cost2)
        costs[right, 1] = best
        parts[inner, 3] = part3 if cost3 < best else -1
        best = min(best, cost3)
        costs[right, 2] = best
        parts[inner, 4] = part4 if cost4 < best else -1
        costs[right, 3] = min(best, cost4)
        top -= 1


@kernel
def _collapse(tree, parts, pending, children, roots):  # type: ignore[no-untyped-def]
    """Fill children (W, 4) and roots (W,), depth first; return W and `WideBvh.stack`.

    pending : stack of nodes still to process, each with the number of groups that a ray has postponed at that node
    """
    skip, first, count = tree.skip, tree.first, tree.items
    pending[0, 0], pending[0, 1] = 0, 0
    waiting, wide, stack = 1, 0, 0
    while waiting:
        waiting -= 1
        root, later = pending[waiting, 0], pending[waiting, 1]
        roots[wide] = root
        for lane in range(WIDTH):
            children[wide, lane] = -1
        part = parts[root - first[root], 0]
        _assign(tree, parts, children, wide, root + 1, part, 0)
        _assign(tree, parts, children, wide, skip[root + 1], WIDTH - part, part)
        inner = 0
        for lane in range(WIDTH):
            child = children[wide, lane]
            inner += child >= 0 and count[child] == 0
        if inner:
            stack = max(stack, later)
        for lane in range(WIDTH - 1, -1, -1):
            child = children[wide, lane]
            if child >= 0 and count[child] == 0:
                pending[waiting, 0], pending[waiting, 1] = child, later + (inner > 1)
                waiting += 1
        wide += 1
    return wide, stack


@inner_kernel
def _assign(tree, parts, children, wide, node, budget, lane):  # type: ignore[no-untyped-def]
    """Put a subtree of a wide node, in up to `budget` parts, into its lanes from `lane` on."""
    skip, first, count = tree.skip, tree.first, tree.items
    # With at most three parts, one child at most is divided further. Each round stores the other child, and
    # continues with this one.
    for _ in range(WIDTH):
        if count[node]:
            budget = 1
        while budget > 1 and parts[node - first[node], budget] < 0:
            budget -= 1
        if budget == 1:
            children[wide, lane] = node
            return
        part = parts[node - first[node], budget]
        left, right = node + 1, skip[node + 1]
        if part == 1:
            children[wide, lane] = left
            node, budget, lane = right, budget - 1, lane + 1
        else:
            # Two of three parts belong to the left child; the right child is a single part.
            children[wide, lane + part] = right
            node, budget = left, part


@kernel
def _octant_orders(tree, children, roots, orders, splits):  # type: ignore[no-untyped-def]
    """Fill orders (W, 8), as described in `octant_orders`.

    roots  : (W,) binary node of each wide node
    splits : (3, 4) working memory for the nodes between a wide node and its children
    """
    lower, upper, skip = tree.lower, tree.upper, tree.skip
    for wide in range(len(roots)):
        # The words of all octants begin with the order of the binary tree. Then each binary node whose second child
        # is hit first exchanges the groups of wide children below its two children.
        word, found = 0, 0
        for lane in range(WIDTH):
            if children[wide, lane] >= 0:
                word |= lane << (2 * found)
                found += 1
        absent = found
        for lane in range(WIDTH):
            if children[wide, lane] < 0:
                word |= lane << (2 * absent)
                absent += 1
        # Each entry is a node with the range of children below it; parents come first.
        splits[0, 0], splits[0, 1], splits[0, 2] = roots[wide], 0, found
        count, i = 1, 0
        while i < count:
            node, begin, end = splits[i, 0], splits[i, 1], splits[i, 2]
            left, right = node + 1, skip[node + 1]
            middle = begin
            while children[wide, word >> (2 * middle) & 3] < right:
                middle += 1
            splits[i, 3] = middle
            if middle - begin > 1:
                splits[count, 0], splits[count, 1], splits[count, 2] = left, begin, middle
                count += 1
            if end - middle > 1:
                splits[count, 0], splits[count, 1], splits[count, 2] = right, middle, end
                count += 1
            i += 1
        for octant in range(8):
            orders[wide, octant] = word
        for i in range(count - 1, -1, -1):
            left = splits[i, 0] + 1
            axis, apart = _apart(lower, upper, left, skip[left])
            if apart != 0.0:
                _exchange(orders, wide, axis, apart < 0.0, splits[i, 1], splits[i, 3], splits[i, 2])


@inner_kernel
def _apart(lower, upper, left, right):  # type: ignore[no-untyped-def]
    """Return the axis along which two nodes' centres are farthest apart, and the second's offset from the first."""
    axis, far = 0, 0.0
    for k in range(3):
        apart = 0.5 * (np.float64(lower[right, k]) + upper[right, k])
        apart -= 0.5 * (np.float64(lower[left, k]) + upper[left, k])
        if abs(apart) > abs(far):
            axis, far = k, apart
    return axis, far


@inner_kernel
def _exchange(orders, wide, axis, negative, begin, middle, end):  # type: ignore[no-untyped-def]
    """Exchange children `begin` to `middle` with those up to `end`, for octants whose rays hit the latter first.

    negative : True if the second group has the smaller coordinate along the axis
    """
    first, second = 2 * (middle - begin), 2 * (end - middle)
    mask = (1 << first + second) - 1
    for octant in range(8):
        if (octant >> axis & 1) != negative:
            word = int(orders[wide, octant])
            both = word >> 2 * begin & mask
            turned = both >> first | (both << second & mask)
            orders[wide, octant] = word & ~(mask << 2 * begin) | turned << 2 * begin
