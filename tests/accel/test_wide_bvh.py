"""Trees of four children a node hold what the binary ones do, at the least cost; a ray's stack is high enough."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given

from glpath.accel.bvh import build_bvh
from glpath.accel.nodes import Bvh
from glpath.accel.sweep import sweep_bvh
from glpath.accel.wide import WIDTH, WideBvh, collapse, depth_first
from glpath.accel.wide_kernels import collapse_compiled, octant_orders
from tests.support.box_trees import boxes, random_boxes


def areas(tree: Bvh) -> np.ndarray:
    x, y, z = (tree.upper - tree.lower).T
    return np.asarray(x * y + y * z + z * x)


def roots(wide: WideBvh) -> np.ndarray:
    """The binary nodes that wide ones are."""
    return np.array([np.flatnonzero(wide.number == i)[0] for i in range(len(wide))], np.int64)


@given(boxes())
def test_the_children_of_a_node_hold_its_items_and_no_others(corners: tuple[np.ndarray, np.ndarray]) -> None:
    tree = sweep_bvh(*corners)
    wide = collapse(tree)
    assert (len(wide) == 0) == (len(tree) == 0)
    leaves = tree.order[tree.first[wide.children[wide.is_leaf]]]
    assert sorted(leaves.tolist()) == list(range(len(tree.order)))
    for node, children in zip(roots(wide), wide.children, strict=True):
        held = np.concatenate([tree.items(child) for child in children[children >= 0]])
        assert sorted(held.tolist()) == sorted(tree.items(node).tolist())


@given(boxes().filter(lambda corners: len(corners[0]) > 1))
def test_compiled_code_finds_the_same_nodes(corners: tuple[np.ndarray, np.ndarray]) -> None:
    same(sweep_bvh(*corners))


@pytest.mark.parametrize("size", [0.0, 0.02, 0.5])
def test_compiled_code_finds_the_same_nodes_of_a_large_tree(size: float) -> None:
    same(build_bvh(*random_boxes(5000, size), leaf_size=1))


def same(tree: Bvh) -> None:
    plain, compiled = collapse(tree), collapse_compiled(tree)
    np.testing.assert_array_equal(compiled.children, plain.children)
    np.testing.assert_array_equal(compiled.roots, plain.roots)
    assert compiled.stack == plain.stack
    orders = octant_orders(compiled)
    for octant in range(8):
        word = (plain.order(octant) << (2 * np.arange(WIDTH))).sum(axis=1)
        np.testing.assert_array_equal(orders[:, octant], word)


def test_fewer_nodes_where_each_costs_cost_rays_little() -> None:
    tree = build_bvh(*random_boxes(5000, 0.02), leaf_size=1)
    area, items = areas(tree), np.median(areas(tree)[tree.count > 0])
    plain, fuller = collapse_compiled(tree), collapse_compiled(tree, 4.0 * float(items))
    assert len(fuller) < 0.97 * len(plain)
    assert area[plain.roots].sum() < area[fuller.roots].sum() < 1.01 * area[plain.roots].sum()


@pytest.mark.parametrize("seed", range(6))
def test_no_other_choice_of_nodes_costs_less(seed: int) -> None:
    tree = sweep_bvh(*random_boxes(9, size=0.6, seed=seed))
    area = areas(tree)

    @cache
    def covers(node: int, count: int) -> frozenset[tuple[int, ...]]:
        """All ways to replace a node by up to so many subtrees."""
        found = {(node,)}
        for left in range(1, count) if not tree.count[node] else ():
            first, second = tree.children(node)
            found |= {a + b for a, b in product(covers(first, left), covers(second, count - left))}
        return frozenset(found)

    @cache
    def least(node: int) -> float:
        if tree.count[node]:
            return 0.0
        return float(area[node]) + min(
            sum(least(child) for child in children) for children in covers(node, WIDTH) if children != (node,)
        )

    assert area[roots(collapse(tree))].sum() == pytest.approx(least(0), rel=1e-12)


@pytest.mark.parametrize("count", [1, 2, 5, 40, 700])
def test_a_stack_is_as_high_as_a_ray_needs_at_most(count: int) -> None:
    wide = collapse(sweep_bvh(*random_boxes(count, size=0.3)))

    def highest(node: int) -> int:
        """Groups that are waiting at most, of a ray that meets everything, whichever child it visits first."""
        inner = [int(wide.number[child]) for child in wide.children[node][wide.is_inner[node]]]
        siblings = int(len(inner) > 1)
        return max((siblings + highest(child) for child in inner if wide.is_inner[child].any()), default=0)

    assert wide.stack == highest(0)


def test_children_are_met_in_the_order_of_the_direction() -> None:
    lower = np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0]])
    tree = sweep_bvh(lower, lower + 1)
    wide = collapse(tree)
    middle = 0.5 * (tree.lower + tree.upper)[wide.children[0], 0]
    assert np.array_equal(middle[wide.order(0)[0]], np.sort(middle))
    assert np.array_equal(middle[wide.order(1)[0]], np.sort(middle)[::-1])
    assert sorted(depth_first(tree, 5).tolist()) == list(range(len(tree)))
