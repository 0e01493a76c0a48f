"""The BVH finds exactly what looking at every box finds."""

from __future__ import annotations

import time
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from glpath.accel import bvh
from glpath.accel.bvh import BINS, build_bvh, build_in_threads
from glpath.accel.nodes import Bvh
from glpath.errors import TimeLimitError, UsageError
from glpath.system.time_limit import limited
from tests.support.box_trees import boxes, check, coordinates, random_boxes
from tests.support.clock import Clock


def overlapping(tree: Bvh, lower: np.ndarray, upper: np.ndarray, query: np.ndarray) -> list[int]:
    """Items whose boxes overlap a box, by the traversal without a stack."""
    found, node = [], 0
    while node < len(tree):
        hit = np.all(tree.lower[node] <= query[1]) and np.all(query[0] <= tree.upper[node])
        if hit and tree.count[node]:
            items = tree.items(node)
            inside = np.all((lower[items] <= query[1]) & (query[0] <= upper[items]), axis=1)
            found += items[inside].tolist()
        node = node + 1 if hit else int(tree.skip[node])
    return sorted(found)


@given(boxes(), st.integers(1, 5))
def test_it_keeps_its_promises(corners: tuple[np.ndarray, np.ndarray], leaf_size: int) -> None:
    check(build_bvh(*corners, leaf_size), *corners, leaf_size)


@given(boxes(), st.integers(1, 5), hnp.arrays(float, (2, 3), elements=coordinates))
def test_it_finds_what_brute_force_finds(
    corners: tuple[np.ndarray, np.ndarray], leaf_size: int, query: np.ndarray
) -> None:
    lower, upper = corners
    query = np.sort(query, axis=0)
    brute = np.flatnonzero(np.all((lower <= query[1]) & (query[0] <= upper), axis=1))
    assert overlapping(build_bvh(lower, upper, leaf_size), lower, upper, query) == brute.tolist()


def test_no_items_and_one_item() -> None:
    nothing = build_bvh(np.zeros((0, 3)), np.zeros((0, 3)))
    assert (len(nothing), nothing.depth) == (0, 0)
    one = build_bvh([[0, 0, 0]], [[1, 2, 3]])
    assert (len(one), one.depth, one.count.tolist(), one.skip.tolist()) == (1, 1, [1], [1])


@pytest.mark.parametrize("points", ["equal", "in a line", "ever denser", "two places"])
def test_boxes_without_extent_make_no_deep_tree(points: str) -> None:
    n = 4096
    x = {
        "equal": np.zeros(n),
        "in a line": np.linspace(0, 1, n),
        "ever denser": 2.0 ** -(np.arange(n) % 64),
        "two places": np.arange(n) % 2.0,
    }[points]
    corners = np.stack([x, 0 * x, 0 * x], axis=1)
    tree = build_bvh(corners, corners, 1)
    check(tree, corners, corners, 1)
    # Halving needs 13 levels; of points twice as near each time, one split tells at most log2(BINS) of 64 apart.
    assert tree.depth <= 13 + 64 // (np.log2(BINS) - 1)


def test_it_is_the_same_every_time() -> None:
    corners = random_boxes(3000)
    a, b = build_bvh(*corners), build_bvh(*corners)
    for name in ("lower", "upper", "skip", "first", "count", "order"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_threads_build_the_same_tree(monkeypatch: pytest.MonkeyPatch, threads: int, dtype: type) -> None:
    monkeypatch.setattr(bvh, "_ALONE", 50)  # or a single thread would build so few
    rng = np.random.default_rng(4)
    # On a grid many centroids coincide, and boxes without extent are among them.
    lower = np.concatenate([rng.random((3000, 3)), rng.integers(0, 3, (500, 3))])
    boxes = np.concatenate([lower, lower + rng.integers(0, 2, lower.shape)], axis=1).astype(dtype)
    found, wanted = build_in_threads(boxes.copy(), threads), build_bvh(boxes[:, :3], boxes[:, 3:], 1)
    check(found, boxes[:, :3], boxes[:, 3:], 1)
    assert found.lower.dtype == dtype
    for name in ("lower", "upper", "skip", "first", "count", "order"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))


@pytest.mark.parametrize("leaf_size", [1, 4])
def test_tree_does_not_depend_on_the_boxes_per_call(monkeypatch: pytest.MonkeyPatch, leaf_size: int) -> None:
    corners = random_boxes(3000)
    whole = build_bvh(*corners, leaf_size)
    monkeypatch.setattr(bvh, "_BOXES_PER_CALL", 100)
    monkeypatch.setattr(bvh, "_ALONE", 50)
    found = [build_bvh(*corners, leaf_size)]
    if leaf_size == 1:
        found.append(build_in_threads(np.concatenate(corners, axis=1), 2))
    for tree, name in product(found, ("lower", "upper", "skip", "first", "count", "order")):
        np.testing.assert_array_equal(getattr(tree, name), getattr(whole, name))


@pytest.mark.parametrize("threads", [0, 2])
def test_build_ends_at_a_time_limit(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    corners, clock = random_boxes(3000), Clock(monkeypatch)
    monkeypatch.setattr(bvh, "_BOXES_PER_CALL", 100)
    with limited(1.0):
        clock.ahead = 3.0
        with pytest.raises(TimeLimitError, match="time_limit=1: over while building the BVH"):
            build_in_threads(np.concatenate(corners, axis=1), threads) if threads else build_bvh(*corners)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_threads_build_trees_of_no_and_of_few_items(count: int) -> None:
    lower, upper = random_boxes(count)
    check(build_in_threads(np.concatenate([lower, upper], axis=1), 2), lower, upper, 1)


def test_it_visits_far_fewer_nodes_than_halving_in_the_given_order() -> None:
    """The heuristic's own measure, the sum of areas, against a tree that ignores the boxes."""
    lower, upper = random_boxes(2000)
    tree = build_bvh(lower, upper, 1)

    def area(low: np.ndarray, high: np.ndarray) -> float:
        x, y, z = high - low
        return x * y + y * z + z * x

    def halved(low: np.ndarray, high: np.ndarray) -> float:
        own = area(low.min(axis=0), high.max(axis=0))
        m = len(low) // 2
        return own + (halved(low[:m], high[:m]) + halved(low[m:], high[m:]) if m else 0)

    assert sum(map(area, tree.lower, tree.upper)) < 0.1 * halved(lower, upper)


def test_a_hundred_thousand_boxes_take_less_than_two_seconds() -> None:
    build_bvh(*random_boxes(2))  # compiled, or loaded from the cache
    corners = random_boxes(100_000)
    start = time.process_time()
    tree = build_bvh(*corners)
    assert time.process_time() - start < 2
    assert tree.depth < 40


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        ([[0, 0, 0], [0, 0, np.nan]], np.ones((2, 3)), r"boxes\[1\]"),
        ([[0, 0, 0]], [[1, np.inf, 1]], r"boxes\[0\].*keep it out"),
        ([[0, 0, 0]], [[1, -1, 1]], "in order"),
        (np.zeros((2, 3)), np.zeros((1, 3)), r"must be \(N, 3\)"),
    ],
)
def test_boxes_that_are_none_are_refused(lower: object, upper: object, words: str) -> None:
    with pytest.raises(UsageError, match=f"(?s){words}"):
        build_bvh(lower, upper)  # type: ignore[arg-type]


def test_an_empty_leaf_size_is_refused() -> None:
    with pytest.raises(UsageError, match="leaf_size is 0"):
        build_bvh(*random_boxes(3), leaf_size=0)
