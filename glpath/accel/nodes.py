"""Nodes of a bounding volume hierarchy (BVH), from any builder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]


@dataclass(frozen=True)
class Bvh:
    """Tree of axis-aligned boxes over N items, as flat arrays of M nodes in depth-first order.

    lower, upper : (M, 3) float64, or float32 if the builder got such boxes: corners of each node's box; node 0 is
                   the root
    skip         : (M,) int32, the node after the node's whole subtree; M after the last
    first        : (M,) int32, start of the node's items in `order`
    count        : (M,) int32, number of items of a leaf; 0 for an inner node
    order        : (N,) int32, a permutation of the items: a leaf is order[first : first + count], and the items
                   below any node are order[first[node] : first[skip[node]]] (to the end if skip[node] is M)

    Without items there are no nodes. The children of an inner node are node + 1, skip[node + 1] and so on, while
    below skip[node]; the builders give two. A traversal needs no stack. It begins at 0, continues at node + 1 after
    a node whose box is hit, otherwise at skip[node], and ends at M. For a leaf, skip is node + 1.
    """

    lower: Float64
    upper: Float64
    skip: Int32
    first: Int32
    count: Int32
    order: Int32

    def __len__(self) -> int:
        return len(self.skip)

    @property
    def depth(self) -> int:
        """Number of levels: 1 for a single leaf, 0 without items.

        A traversal that postpones second children on a stack needs no more entries than this.
        """
        # Depth of a node: the number of subtrees that have begun, minus those that have ended.
        ended = np.cumsum(np.bincount(self.skip, minlength=len(self) + 1)[: len(self)])
        return int((np.arange(1, len(self) + 1) - ended).max(initial=0))

    def children(self, node: int) -> list[int]:
        """Return the child nodes of a node; none for a leaf."""
        found = []
        child = node + 1
        while child < self.skip[node]:
            found.append(child)
            child = int(self.skip[child])
        return found

    def items(self, node: int) -> Int32:
        """Return (n,) int32, all items below a node."""
        end = self.skip[node]
        return self.order[self.first[node] : self.first[end] if end < len(self) else len(self.order)]


class Tree(NamedTuple):
    """A `Bvh` for the kernels: boxes (M, 6), lower and upper corner, and its other arrays.

    items : `count` of the `Bvh`
    """

    boxes: Float64
    skip: Int32
    first: Int32
    items: Int32
    order: Int32

    @classmethod
    def of(cls, bvh: Bvh) -> Tree:
        boxes = np.concatenate([bvh.lower, bvh.upper], axis=1)
        return cls(boxes, bvh.skip, bvh.first, bvh.count, bvh.order)

    @classmethod
    def empty(cls, items: int, dtype: DTypeLike = np.float64) -> Tree:
        """Allocate enough nodes for `items` items, provided that each inner node has at least two children."""
        nodes = max(2 * items - 1, 0)
        skip, first, count = (np.empty(nodes, np.int32) for _ in range(3))
        return cls(np.empty((nodes, 6), dtype), skip, first, count, np.arange(items, dtype=np.int32))

    def bvh(self, size: int) -> Bvh:
        """Return a `Bvh` of the first `size` nodes: views of these arrays if `size` is all of them, or copies."""
        if size == len(self.skip):
            return Bvh(self.boxes[:, :3], self.boxes[:, 3:], self.skip, self.first, self.items, self.order)
        lower, upper = self.boxes[:size, :3].copy(), self.boxes[:size, 3:].copy()
        skip, first, items = (part[:size].copy() for part in (self.skip, self.first, self.items))
        return Bvh(lower, upper, skip, first, items, self.order)
