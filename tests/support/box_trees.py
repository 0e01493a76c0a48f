"""Boxes, and checks of a hierarchy over them."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from glpath.accel.nodes import Bvh

# Coordinates on a small grid make boxes that touch, coincide or have no extent; other coordinates make slivers.
coordinates = st.one_of(st.integers(-3, 3).map(float), st.floats(-1e6, 1e6, allow_subnormal=False))


@st.composite
def boxes(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    corners = draw(hnp.arrays(float, st.tuples(st.integers(0, 40), st.just(2), st.just(3)), elements=coordinates))
    return corners.min(axis=1), corners.max(axis=1)


def random_boxes(n: int, size: float = 0.02, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    centres, half = rng.random((n, 3)), size * rng.random((n, 3))
    return centres - half, centres + half


def check(tree: Bvh, lower: np.ndarray, upper: np.ndarray, leaf_size: int) -> None:
    """Check everything that the docstring of `Bvh` promises."""
    n, size = len(lower), len(tree)
    assert sorted(tree.order.tolist()) == list(range(n))
    assert [a.dtype for a in (tree.skip, tree.first, tree.count, tree.order)] == [np.int32] * 4
    leaves = np.flatnonzero(tree.count)
    assert tree.count.sum() == n
    assert tree.count.max(initial=0) <= leaf_size
    np.testing.assert_array_equal(np.cumsum(tree.count[leaves]) - tree.count[leaves], tree.first[leaves])
    for node in range(size):
        items = tree.items(node)
        np.testing.assert_array_equal(tree.lower[node], lower[items].min(axis=0))
        np.testing.assert_array_equal(tree.upper[node], upper[items].max(axis=0))
        children = tree.children(node)
        assert len(children) == (0 if tree.count[node] else 2)
        if children:
            np.testing.assert_array_equal(np.concatenate([tree.items(c) for c in children]), items)
        assert tree.skip[node] == (tree.skip[children[-1]] if children else node + 1)
    if size:
        assert tree.skip[0] == size
