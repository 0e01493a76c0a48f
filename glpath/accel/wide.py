"""Tree of up to four children a node, made from a binary one: a ray tests four boxes at a time.

Dynamic programming from the leaves up selects the nodes of the binary tree that remain. They have the minimum sum
of areas, so that a random ray visits as few nodes as possible. All nodes of a level are processed at once, so no
compiled code is needed.

Cost:     about a second for a million boxes.
Poor at:  trees as deep as their number of leaves, whose levels have one node each.
Source:   Wald, Benthin & Boulos 2008, Getting rid of packets; Ylitie, Karras & Laine 2017, Efficient incoherent ray
          traversal on GPUs through compressed wide BVHs, for the minimum cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
Integers = NDArray[np.int64] | NDArray[np.int32]

#: Maximum number of children of a node.
WIDTH = 4


@dataclass(frozen=True)
class WideBvh:
    """Remaining nodes of a binary tree, and their children.

    tree     : the binary tree, one item a leaf
    children : (W, 4) int64, binary nodes that are the children of each wide node, -1 for none; depth first, so that
               parents come before their children. The first is the root; if the tree is a single leaf, the root has
               this leaf as its child. Empty without items
    roots    : (W,) binary node of each wide node
    stack    : number of stack entries that a ray needs, one for each group of siblings that it visits later. It is
               the maximum, over nodes with inner children, of their ancestors with at least two inner children
    """

    tree: Bvh
    children: Integers
    roots: Integers
    stack: int

    def __len__(self) -> int:
        return len(self.children)

    @cached_property
    def is_leaf(self) -> NDArray[np.bool_]:
        """Flags (W, 4) of the children, True for leaves."""
        return self.present & (self.tree.count[self.children] > 0)

    @cached_property
    def is_inner(self) -> NDArray[np.bool_]:
        """Flags (W, 4) of the children, True for wide nodes."""
        return self.present & ~self.is_leaf

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Flags (W, 4), True if the child exists."""
        return np.asarray(self.children >= 0)

    @cached_property
    def number(self) -> NDArray[np.int32]:
        """Wide node (M,) of each binary node, -1 if it has none."""
        number = np.full(len(self.tree), -1, np.int32)
        number[self.roots] = np.arange(len(self), dtype=np.int32)
        return number

    def order(self, octant: int) -> Int64:
        """Return (W, 4), the numbers 0 to 3 of each node's children in the order in which a ray hits them.

        octant : bit k is set if the ray's direction is negative along axis k
        """
        order = depth_first(self.tree, octant)
        return np.argsort(np.where(self.present, order[self.children], len(self.tree)), axis=1, kind="stable")


def collapse(tree: Bvh) -> WideBvh:
    """Return the wide tree of a binary one with one item a leaf."""
    if not len(tree):
        return WideBvh(tree, np.zeros((0, WIDTH), np.int64), np.zeros(0, np.int64), 0)
    inner = tree.count == 0
    if not inner[0]:
        return WideBvh(tree, np.array([[0] + [-1] * (WIDTH - 1)]), np.zeros(1, np.int64), 0)
    parts = _min_cost_parts(tree)
    # Lanes are the four slots of a wide node's children. A subtree owns as many successive lanes as it may have
    # parts.
    roots, later = [np.zeros(1, np.int64)], np.zeros(1, np.int64)
    found = []
    stack = 0
    while len(roots[-1]):
        check_time("building the BVH")
        lanes = _divided(tree, roots[-1], parts)
        found.append(lanes)
        inner_lanes = (lanes >= 0) & inner[lanes]
        stack = max(stack, int(later[inner_lanes.any(axis=1)].max(initial=0)))
        forks = inner_lanes.sum(axis=1) > 1
        later = np.repeat(later + forks, inner_lanes.sum(axis=1))
        roots.append(lanes[inner_lanes])
    node = np.concatenate(roots)
    order = np.argsort(node)
    return WideBvh(tree, np.concatenate(found)[order], node[order], stack)


def _min_cost_parts(tree: Bvh) -> NDArray[np.int8]:
    """Return (M, 5) minimum-cost divisions of nodes, as the count of subtrees that come from the left child.

    Column 0 is for a node that remains and has up to four children. Columns k = 2 to 4 are for a node that up to k
    subtrees replace, -1 if k subtrees are no better than k - 1.
    """
    extent = tree.upper - tree.lower
    area = extent[:, 0] * extent[:, 1] + extent[:, 1] * extent[:, 2] + extent[:, 2] * extent[:, 0]
    # Minimum area of the remaining nodes of a subtree, if it is replaced by up to 1, 2, 3, 4 subtrees.
    min_cost = np.zeros((len(tree), WIDTH))
    parts = np.zeros((len(tree), WIDTH + 1), np.int8)
    for level in reversed(_levels(tree)):
        check_time("building the BVH")
        left, right = min_cost[level + 1], min_cost[tree.skip[level + 1]]
        # Costs for k = 2, 3, 4 parts, each an array [parts of the left child - 1, node].
        splits = [
            np.stack([left[:, i - 1] + right[:, k - i - 1] for i in range(1, k)]) for k in range(2, WIDTH + 1)
        ]
        chosen = [1 + np.argmin(split, axis=0) for split in splits]
        costs = [split.min(axis=0) for split in splits]
        best = area[level] + costs[-1]
        min_cost[level, 0], parts[level, 0] = best, chosen[-1]
        for k, cost, part in zip(range(2, WIDTH + 1), costs, chosen, strict=True):
            parts[level, k] = np.where(cost < best, part, -1)
            best = np.minimum(best, cost)
            min_cost[level, k - 1] = best
    return parts


def _divided(tree: Bvh, roots: Int64, parts: NDArray[np.int8]) -> Int64:
    """Return (n, 4) subtrees that are the children of the wide nodes `roots`, -1 if no further child pays."""
    node = np.full((len(roots), WIDTH), -1, np.int64)
    budget = np.zeros((len(roots), WIDTH), np.int64)
    row = np.arange(len(roots))

    def divide(rows: Int64, lane: Int64, of: Int64, first: Int64, count: Int64) -> None:
        node[rows, lane], budget[rows, lane] = of + 1, first
        node[rows, lane + first], budget[rows, lane + first] = tree.skip[of + 1], count - first

    divide(row, np.zeros(len(roots), np.int64), roots, parts[roots, 0].astype(np.int64), np.full(len(roots), WIDTH))
    for _ in range(WIDTH - 2):
        # Reduce the budget to the smallest number of subtrees with the same cost.
        for _ in range(WIDTH - 1):
            inner = (node >= 0) & (budget > 1)
            budget[inner & (tree.count[node] > 0)] = 1
            inner &= tree.count[node] == 0
            budget -= inner & (parts[node, budget] < 0)
        rows, lane = np.nonzero((node >= 0) & (budget > 1))
        of, count = node[rows, lane], budget[rows, lane]
        divide(rows, lane, of, parts[of, count].astype(np.int64), count)
    return node


def _levels(tree: Bvh) -> list[Int64]:
    """Return the inner nodes of each level, from the root down."""
    levels = []
    level = np.flatnonzero(tree.count[:1] == 0)
    while len(level):
        levels.append(level)
        children = np.concatenate([level + 1, tree.skip[level + 1].astype(np.int64)])
        level = children[tree.count[children] == 0]
    return levels


def depth_first(tree: Bvh, octant: int) -> Int64:
    """Return (M,), the number of each node in a depth-first traversal in the order in which a ray hits children.

    The order of two children is that of their centres, along the axis on which these are farthest apart.

    octant : bit k is set if component k of the direction is negative
    """
    number = np.zeros(len(tree), np.int64)
    size = tree.skip.astype(np.int64) - np.arange(len(tree))
    sign = np.array([-1.0 if octant >> k & 1 else 1.0 for k in range(3)])
    middle = 0.5 * (tree.lower + tree.upper)
    for level in _levels(tree):
        left = level + 1
        right = tree.skip[left].astype(np.int64)
        apart = middle[right] - middle[left]
        axis = np.argmax(np.abs(apart), axis=1)
        swapped = np.take_along_axis(apart * sign, axis[:, None], axis=1)[:, 0] < 0
        first, second = np.where(swapped, right, left), np.where(swapped, left, right)
        number[first] = number[level] + 1
        number[second] = number[first] + size[first]
    return number
