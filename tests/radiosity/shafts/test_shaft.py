"""Shafts: which boxes stand between two others, by the paper, by a linear program and by eye."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.optimize import linprog

from glpath.accel.bvh import build_bvh
from glpath.accel.nodes import Bvh
from glpath.errors import UsageError
from glpath.radiosity import Containment, Shaft, Strategy, candidate_list, cluster

# Small whole numbers: flat, equal, nested and touching boxes come by themselves, and all arithmetic is exact.
corners = hnp.arrays(np.int64, (2, 3), elements=st.integers(-4, 4)).map(lambda c: np.sort(c, axis=0).astype(float))


def corner_points(box: np.ndarray) -> np.ndarray:
    """(8, 3)"""
    bits = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.where(bits == 1, box[1], box[0])


def meets_hull(box: np.ndarray, box_a: np.ndarray, box_b: np.ndarray) -> bool:
    """Whether a box and the convex hull of two others have a point in common, as a linear program.

    Weights of the sixteen corners, from 0, that sum to 1 and whose mean lies in the box.
    """
    points = np.concatenate([corner_points(box_a), corner_points(box_b)])
    upper = np.concatenate([points.T, -points.T])
    result = linprog(
        np.zeros(16), upper, np.concatenate([box[1], -box[0]]), np.ones((1, 16)), [1.0], bounds=(0, None)
    )
    assert result.status in (0, 2), result.message
    return bool(result.status == 0)


def in_hull(box: np.ndarray, shaft: Shaft) -> bool:
    """Whether all corners lie in the shaft, by its planes."""
    points = corner_points(box)
    inside = np.all(points >= shaft.extent[:3]) and np.all(points <= shaft.extent[3:])
    return bool(inside and np.all(points @ shaft.planes[:, :3].T + shaft.planes[:, 3] <= 0))


def test_the_papers_example() -> None:
    """Figure 1, with depth: the receiver reaches farther down and to both sides, the emitter up."""
    receiver, emitter = [[0, 0, 0], [10, 1, 4]], [[2, 5, 0], [6, 7, 4]]
    shaft = Shaft.between(emitter, receiver)
    assert shaft.faces_a == ("MAX_Y",)
    assert shaft.faces_b == ("MIN_X", "MIN_Y", "MAX_X")  # both begin and end at the same depth
    np.testing.assert_array_equal(shaft.extent, [0, 0, 0, 10, 7, 4])
    # MAX_Y--MIN_X: direction (receiver.hi.y - emitter.hi.y, emitter.lo.x - receiver.lo.x, 0) [SC p. 4]
    np.testing.assert_array_equal(shaft.planes, [[1 - 7, 2 - 0, 0, -2], [7 - 1, 10 - 6, 0, -64]])
    for plane in shaft.planes:
        heights = corner_points(np.array(emitter)) @ plane[:3] + plane[3]
        assert heights.max() == 0
    np.testing.assert_array_equal(shaft.near[:, :2], [[3, 1], [0, 1]])
    np.testing.assert_array_equal(shaft.far, (shaft.near + 3) % 6)


def test_the_near_corner_of_the_papers_plane() -> None:
    """Normal [-3, 8, .]: far corner lo.x, hi.y; near corner hi.x, lo.y [SC p. 9]."""
    shaft = Shaft.between([[3, 0, 0], [9, 9, 9]], [[-5, -3, 0], [9, 6, 9]])
    plane = next(i for i, p in enumerate(shaft.planes) if p[0] < 0 < p[1])
    assert (shaft.far[plane, 0], shaft.far[plane, 1]) == (0, 4)
    assert (shaft.near[plane, 0], shaft.near[plane, 1]) == (3, 1)


def test_at_most_eight_planes_and_eight_there_are() -> None:
    """Figure 2."""
    crossed = Shaft.between([[-3, -1, 0], [3, 1, 0]], [[-1, -3, 5], [1, 3, 5]])
    larger = Shaft.between([[-3, -3, 0], [3, 3, 1]], [[-1, -1, 5], [1, 1, 6]])
    assert (len(crossed.planes), len(larger.planes)) == (8, 4)
    assert len(Shaft.between([[-2, -2, 0], [2, 2, 0]], [[-1, 3, 5], [1, 5, 7]]).planes) <= 8


@given(corners, corners)
def test_no_more_than_eight_planes(a: np.ndarray, b: np.ndarray) -> None:
    shaft = Shaft.between(a, b)
    assert len(shaft.planes) <= 8
    for plane in shaft.planes:  # each touches both boxes, and has both inside
        for box in (a, b):
            assert (corner_points(box) @ plane[:3] + plane[3]).max() == 0


@pytest.mark.parametrize("outer", [[[0, 0, 0], [4, 4, 4]], [[1, 1, 1], [2, 2, 2]]])
def test_one_box_inside_the_other_or_equal_needs_no_planes(outer: object) -> None:
    assert len(Shaft.between(outer, [[1, 1, 1], [2, 2, 2]]).planes) == 0


@settings(max_examples=400)
@given(corners, corners, corners)
def test_no_box_is_called_wrongly(a: np.ndarray, b: np.ndarray, box: np.ndarray) -> None:
    """The paper believes that boxes have no false positives, and they haven't."""
    shaft = Shaft.between(a, b)
    place = shaft.classify(box[None])[0]
    assert (place != Containment.OUTSIDE) == meets_hull(box, a, b)
    assert (place == Containment.INSIDE) == in_hull(box, shaft)


@given(corners, corners, corners, st.floats(0, 1))
def test_dropped_planes_only_make_the_shaft_larger(
    a: np.ndarray, b: np.ndarray, box: np.ndarray, min_cut: float
) -> None:
    full, fewer = Shaft.between(a, b), Shaft.between(a, b, min_cut=min_cut)
    assert {tuple(p) for p in fewer.planes} <= {tuple(p) for p in full.planes}
    assert fewer.classify(box[None])[0] >= min(full.classify(box[None])[0], Containment.OVERLAPPING)
    assert len(Shaft.between(a, b, min_cut=0).planes) == len(full.planes)


def test_planes_are_sorted_by_the_volume_they_cut() -> None:
    shaft = Shaft.between([[0, 0, 0], [1, 1, 9]], [[6, 1.5, 0], [9, 5, 9]], min_cut=0)
    rng = np.random.default_rng(1)
    points = shaft.extent[:3] + rng.random((20_000, 3)) * (shaft.extent[3:] - shaft.extent[:3])
    cut = (points @ shaft.planes[:, :3].T + shaft.planes[:, 3] > 0).mean(axis=0)
    assert len(cut) == 2
    assert cut[0] > cut[1] + 0.05
    few = Shaft.between(shaft.box_a, shaft.box_b, min_cut=cut.mean())
    np.testing.assert_array_equal(few.planes, shaft.planes[:1])


@given(corners, corners, hnp.arrays(float, 3, elements=st.floats(-6, 6)), st.floats(0, 4))
def test_no_sphere_that_touches_is_called_outside(
    a: np.ndarray, b: np.ndarray, centre: np.ndarray, radius: float
) -> None:
    shaft = Shaft.between(a, b)
    place = shaft.classify_spheres(centre[None], [radius])[0]
    directions = np.random.default_rng(3).normal(size=(40, 3))
    surface = centre + 0.999 * radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    in_shaft = shaft.classify(np.stack([surface, surface], axis=1)) != Containment.OUTSIDE
    if place == Containment.OUTSIDE:
        assert not in_shaft.any()
    if place == Containment.INSIDE:
        assert in_shaft.all()


def test_a_sphere_can_be_called_overlapping_though_it_is_outside() -> None:
    """Figure 4: near an edge of the shaft a sphere reaches over each of its planes, but not to where they meet."""
    shaft = Shaft.between([[0, 3, 0], [1, 4, 4]], [[6, 0, 0], [7, 9, 4]])
    # Just beyond the emitter's upper edge, between the directions of the plane's normal and of MIN_X.
    centre = np.array([0, 4, 2]) + 1.05 * np.array([-0.905, 0.425, 0])
    assert _distance_to(shaft, centre) > 1.04
    assert shaft.classify_spheres(centre[None], [1.0])[0] == Containment.OVERLAPPING
    rng = np.random.default_rng(5)
    centres = shaft.extent[:3] - 1 + rng.random((500, 3)) * (shaft.extent[3:] - shaft.extent[:3] + 2)
    overlapping = shaft.classify_spheres(centres, np.full(500, 1.0)) == Containment.OVERLAPPING
    false = [c for c in centres[overlapping] if _distance_to(shaft, c) > 1.001]
    assert 0 < len(false) < 0.1 * overlapping.sum()
    boxes = np.stack([np.array(false) - 1 / np.sqrt(3), np.array(false) + 1 / np.sqrt(3)], axis=1)
    assert not shaft.classify(boxes).any()  # the largest boxes in the same spheres are called right


def _distance_to(shaft: Shaft, point: np.ndarray) -> float:
    """From a point to the convex hull, by projecting onto its half-spaces in turn [Dykstra 1983]."""
    normals = np.concatenate([shaft.planes[:, :3], np.eye(3), -np.eye(3)])
    offsets = np.concatenate([shaft.planes[:, 3], -shaft.extent[3:], shaft.extent[:3]])
    scale = np.linalg.norm(normals, axis=1)
    normals, offsets = normals / scale[:, None], offsets / scale
    x, steps = point.copy(), np.zeros((len(normals), 3))
    for _ in range(60):
        for i, (n, d) in enumerate(zip(normals, offsets, strict=True)):
            y = x + steps[i]
            x = y - max(n @ y + d, 0.0) * n
            steps[i] = y - x
    return float(np.linalg.norm(point - x))


def figure_3() -> tuple[Bvh, Shaft]:
    """Six objects in two boxes: 0 outside; box A with 1 and 2 inside; box B with 3 and 4 overlapping, 5 outside."""
    lower = np.array([[0, 9, 0], [5, 4, 0.4], [6, 5, 0.4], [9.5, 4, 0.4], [9.5, 5.5, 0.4], [10.5, 9.5, 0.4]])
    size = np.array([[0.5, 0.5, 1], [0.5, 0.5, 0.2], [0.5, 0.5, 0.2], [1, 1, 0.2], [1, 1, 0.2], [0.3, 0.3, 0.2]])
    upper = lower + size
    nodes = [(0, 6), (0, 1), (1, 3), (1, 2), (2, 3), (3, 6), (3, 4), (4, 5), (5, 6)]
    return (
        Bvh(  # the root is around the reference boxes as well
            lower=np.array([[-1, -1, -1], *(lower[a:b].min(axis=0) for a, b in nodes[1:])]),
            upper=np.array([[12, 12, 2], *(upper[a:b].max(axis=0) for a, b in nodes[1:])]),
            skip=np.array([9, 2, 5, 4, 5, 9, 7, 8, 9], np.int32),
            first=np.array([a for a, _ in nodes], np.int32),
            count=np.array([0, 1, 0, 1, 1, 0, 1, 1, 1], np.int32),
            order=np.arange(6, dtype=np.int32),
        ),
        Shaft.between([[0, 2, 0], [1, 5, 1]], [[9, 1, 0], [10, 8, 1]]),
    )


def test_the_strategies_of_figure_3() -> None:
    tree, shaft = figure_3()
    box_a, box_b = 2, 5
    lists = {
        Strategy.ALWAYS_OPEN: [3, 4, 6, 7],
        Strategy.KEEP_CLOSED: [box_a, box_b],
        Strategy.OVERLAP_OPEN: [box_a, 6, 7],
        Strategy.RATIO_OPEN: [box_a, box_b],
    }
    for strategy, expected in lists.items():
        assert sorted(candidate_list(tree, shaft, strategy, ratio=0.4).tolist()) == expected, strategy
    assert sorted(candidate_list(tree, shaft, Strategy.RATIO_OPEN, ratio=0.7).tolist()) == [box_a, 6, 7]


def test_a_single_overlapping_child_replaces_its_parent() -> None:
    tree, _ = figure_3()
    shaft = Shaft.between([[0, 2, 0], [1, 5, 1]], [[9, 1, 0], [10, 4.5, 1]])
    assert sorted(candidate_list(tree, shaft, Strategy.RATIO_OPEN, ratio=0.0).tolist()) == [3, 6]


def test_items_that_enclose_a_reference_box_are_opened() -> None:
    tree, _ = figure_3()
    shaft = Shaft.between([[9.6, 4.1, 0.45], [9.8, 4.2, 0.5]], [[9.6, 5.6, 0.45], [9.8, 5.7, 0.5]])
    assert candidate_list(tree, shaft, Strategy.KEEP_CLOSED, open_enclosing=False).tolist() == [0]
    assert sorted(candidate_list(tree, shaft, Strategy.KEEP_CLOSED).tolist()) == [6, 7]


@pytest.mark.parametrize("build", [lambda *b: build_bvh(*b, 1), cluster])
@pytest.mark.parametrize("strategy", list(Strategy))
def test_a_list_leaves_out_only_what_is_outside(strategy: Strategy, build) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(11)
    lower = rng.random((400, 3)) * 10
    upper = lower + rng.random((400, 3))
    tree = build(lower, upper)
    for _ in range(20):
        a, b = (np.sort(rng.random((2, 3)) * 10, axis=0) * 0.3 + shift for shift in rng.random((2, 3)) * 6)
        shaft = Shaft.between(a, b)
        nodes = candidate_list(tree, shaft, strategy, ratio=0.5)
        below = np.concatenate([tree.items(n) for n in nodes]) if len(nodes) else np.zeros(0, int)
        assert len(set(below.tolist())) == len(below)
        needed = np.flatnonzero(shaft.classify(np.stack([lower, upper], axis=1)))
        assert set(needed.tolist()) <= set(below.tolist())
        if strategy == Strategy.ALWAYS_OPEN:
            assert sorted(below.tolist()) == needed.tolist()


def test_an_empty_bvh_has_no_candidates() -> None:
    nothing = build_bvh(np.zeros((0, 3)), np.zeros((0, 3)))
    shaft = Shaft.between([[0, 0, 0], [1, 1, 1]], [[2, 2, 2], [3, 3, 3]])
    assert candidate_list(nothing, shaft).tolist() == []


@pytest.mark.parametrize("box", [[[0, 0, 0], [1, -1, 1]], [[0, 0, 0], [1, np.nan, 1]], [0, 1]])
def test_what_is_no_box_is_refused(box: object) -> None:
    with pytest.raises(UsageError, match="box_b"):
        Shaft.between([[0, 0, 0], [1, 1, 1]], box)  # type: ignore[arg-type]


def test_clusters_hold_every_item_once_and_enclose_their_own() -> None:
    rng = np.random.default_rng(2)
    lower = rng.random((300, 3))
    upper = lower + 0.05 * rng.random((300, 3))
    tree = cluster(lower, upper)
    assert sorted(tree.order.tolist()) == list(range(300))
    assert tree.skip[0] == len(tree)
    for node in range(len(tree)):
        items, children = tree.items(node), tree.children(node)
        np.testing.assert_array_equal(tree.lower[node], lower[items].min(axis=0))
        np.testing.assert_array_equal(tree.upper[node], upper[items].max(axis=0))
        assert (len(items) == 1) if tree.count[node] else len(children) >= 2
    assert cluster(lower, upper).order.tolist() == tree.order.tolist()


def test_clusters_are_as_good_as_areas_within_a_third() -> None:
    """Goldsmith and Salmon's own measure: the area of each inner node times its children, over the root's area."""
    rng = np.random.default_rng(4)
    lower = rng.random((500, 3))
    upper = lower + 0.05

    def cost(tree: Bvh) -> float:
        x, y, z = (tree.upper - tree.lower).T
        area = x * y + y * z + z * x
        return float(sum(area[i] * len(tree.children(i)) for i in range(len(tree))) / area[0])

    assert cost(cluster(lower, upper)) < 1.33 * cost(build_bvh(lower, upper, 1))


def test_clusters_of_none_one_two_and_equal_items() -> None:
    for n, size in ((0, 0), (1, 1), (2, 3), (50, None)):
        zeros = np.zeros((n, 3))
        tree = cluster(zeros, zeros)
        assert sorted(tree.order.tolist()) == list(range(n))
        assert size is None or len(tree) == size
