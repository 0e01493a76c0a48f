"""Visibility: every way of looking for occluders finds what testing every segment against every polygon finds."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import glpath
from glpath.errors import UsageError
from glpath.io import load_scene
from glpath.radiosity import PAPER, Emitter, Occluders, Receivers, ShaftOptions, Visibility, facing, visible
from glpath.radiosity.shafts import points as shaft_points
from glpath.radiosity.shafts.occluders import closed_shapes
from glpath.radiosity.shafts.options import ORDERS, STRATEGIES
from tests.support.visibility import visible_by_all

# A small grid makes polygons that touch, coincide, lie in a plane with points, or have no area; others are slivers.
grid = st.integers(-3, 3).map(float)
places = st.one_of(grid, st.floats(-3, 3, allow_subnormal=False))
booleans = st.booleans()

options = st.builds(
    ShaftOptions,
    strategy=st.sampled_from(list(STRATEGIES)),
    ratio=st.sampled_from([0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
    order=st.sampled_from(list(ORDERS)),
    min_cut=st.sampled_from([None, 0.0, 0.1]),
    clump=st.sampled_from([0, 1, 3, 8]),
    group=st.sampled_from([0, 9]),
    no_shaft_below=st.sampled_from([0, 12]),
    keep_closed_below=st.sampled_from([0, 30]),
    longest=st.sampled_from([0, 2, 1500]),
    solids=booleans,
    **{
        name: booleans for name, kind in ShaftOptions.__annotations__.items() if kind == "bool" and name != "solids"
    },
)


@st.composite
def occluders(draw: st.DrawFn, most: int = 24) -> Occluders:
    """Triangles and parallelograms, some slivers, some marked as parts of solids."""
    n = draw(st.integers(0, most))
    corners = draw(hnp.arrays(float, (n, 3, 3), elements=places))
    if n and draw(booleans):
        thin = draw(st.sampled_from([0.0, 1e-12, 1e-7, 1e-4]))
        corners[0, 2] = corners[0, 0] + (corners[0, 1] - corners[0, 0]) * 0.5 + thin * corners[0, 2]
    flags = draw(hnp.arrays(bool, (2, n)))
    return Occluders(corners, flags[0], flags[1], np.zeros(n, np.int32))


@st.composite
def ends(draw: st.DrawFn, of: Occluders) -> tuple[Emitter, Receivers]:
    """Points anywhere, or on the polygons; with normals or without; receivers of one point and of many."""
    samples = draw(hnp.arrays(float, (draw(st.integers(1, 4)), 3), elements=places))
    points = draw(hnp.arrays(float, (draw(st.integers(1, 12)), 3), elements=places))
    count = len(points)
    receiver = np.sort(draw(hnp.arrays(np.int32, count, elements=st.integers(0, 4))))
    polygons = None
    own = -1
    if len(of) and draw(booleans):
        own = draw(st.integers(0, len(of) - 1))
        samples = on_polygon(of, own, draw(hnp.arrays(float, (3, 2), elements=st.sampled_from([0, 0.25, 0.5]))))
        polygons = (receiver % len(of)).astype(np.int32)
        inside = draw(hnp.arrays(float, (count, 2), elements=st.sampled_from([0, 0.25, 0.5])))
        points = np.stack([on_polygon(of, int(p), uv[None])[0] for p, uv in zip(polygons, inside, strict=True)])
    normal = None
    normals = None
    if draw(booleans):
        normal = of.normals[own] if own >= 0 else np.array([0.0, 0.0, 1.0])
        normal = normal if np.linalg.norm(normal) > 0.5 else np.array([0.0, 1.0, 0.0])
    if draw(booleans):
        normals = np.eye(3)[receiver % 3]
    return Emitter(samples, normal, own), Receivers(points, receiver, normals, polygons)


def on_polygon(of: Occluders, i: int, uv: np.ndarray) -> np.ndarray:
    a, b, c = of.corners[i]
    return np.asarray(a + uv[:, :1] * (b - a) + uv[:, 1:] * (c - a))


def brute_force(of: Occluders, emitter: Emitter, receivers: Receivers, solids: bool) -> np.ndarray:
    own = receivers.polygons if receivers.polygons is not None else np.full(len(receivers.points), -1, np.int32)
    own_a = np.full(len(emitter.points), emitter.polygon, np.int32)
    seen = visible_by_all(of.polygons(solids), emitter.points, receivers.points, own_a, own)
    return np.asarray(seen.T & facing(emitter, receivers))


random_cases = given(st.data(), occluders(), options, st.sampled_from(["areas", "clusters"]))


@settings(max_examples=125)
@random_cases
def test_every_option_finds_what_brute_force_finds(
    data: st.DataObject, of: Occluders, chosen: ShaftOptions, bvh: str
) -> None:
    check_against_brute_force(data, of, chosen, bvh)


@pytest.mark.evidence
@settings(max_examples=2000)
@random_cases
def test_every_option_finds_what_brute_force_finds_in_thousands_of_scenes(
    data: st.DataObject, of: Occluders, chosen: ShaftOptions, bvh: str
) -> None:
    check_against_brute_force(data, of, chosen, bvh)


def check_against_brute_force(data: st.DataObject, of: Occluders, chosen: ShaftOptions, bvh: str) -> None:
    assume(of.size > 0.01 or not len(of))  # of occluders that are all next to nothing, points are too far
    emitter, receivers = data.draw(ends(of))
    visibility = Visibility(of, chosen, bvh, threads=1)  # type: ignore[arg-type]
    seen, counts = visibility.step(emitter, receivers)
    np.testing.assert_array_equal(seen, brute_force(of, emitter, receivers, chosen.solids))
    faces = facing(emitter, receivers)
    assert counts.rays == faces.sum()
    assert counts.blocked == faces.sum() - seen.sum()


def soup(n: int, size: float, seed: int) -> Occluders:
    rng = np.random.default_rng(seed)
    return Occluders.of_triangles(rng.random((n, 1, 3)) + size * (rng.random((n, 3, 3)) - 0.5))


@pytest.mark.parametrize(("n", "size"), [(400, 0.1), (60, 0.6), (2000, 0.03)])
def test_all_strategies_agree_in_larger_scenes(n: int, size: float) -> None:
    of = soup(n, size, n)
    rng = np.random.default_rng(7)
    a, b = rng.random((5, 3)) * [0.2, 1, 1], rng.random((40, 3)) * [0.2, 1, 1] + [0.8, 0, 0]
    own = np.full(40, -1, np.int32)
    expected = visible_by_all(of.polygons(False), a, b, own[:5], own)
    assert 0.02 < expected.mean() < 0.98
    for strategy, together, clump, group in product(STRATEGIES, (False, True), (0, 4), (0, 16)):
        chosen = ShaftOptions(strategy=strategy, together=together, clump=clump, group=group)
        np.testing.assert_array_equal(visible(of, a, b, chosen), expected)


def test_threads_find_the_same() -> None:
    of = soup(300, 0.2, 3)
    rng = np.random.default_rng(1)
    receivers = Receivers(rng.random((200, 3)), np.repeat(np.arange(50, dtype=np.int32), 4))
    emitter = Emitter(rng.random((6, 3)))
    one, counts = Visibility(of, threads=1).step(emitter, receivers)
    two, others = Visibility(of, threads=3).step(emitter, receivers)
    np.testing.assert_array_equal(one, two)
    assert counts.rays == others.rays


@pytest.fixture(scope="module")
def office() -> tuple[Occluders, Emitter, Receivers]:
    """The office, a ceiling light with four samples, and the middle of every polygon and a corner of it."""
    scene = load_scene("office")
    of = Occluders.of_scene(scene)
    light = next(i for i in range(len(of)) if scene.shapes[of.shape[i]].emits)
    uv = np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])
    points = np.concatenate([on_polygon(of, i, np.array([[0.5, 0.5], [0.02, 0.03]])) for i in range(len(of))])
    number = np.repeat(np.arange(len(of), dtype=np.int32), 2)
    return (
        of,
        Emitter(on_polygon(of, light, uv), of.normals[light], light),
        Receivers(points, number, of.normals[number], number),
    )


def test_the_office_has_the_papers_counts(office: tuple[Occluders, Emitter, Receivers]) -> None:
    assert len(office[0]) == 906
    premesh = load_scene("office-premesh")
    assert len(Occluders.of_scene(premesh)) == 2563
    assert sum(s.emits for s in premesh.shapes) == 10


@pytest.mark.parametrize("chosen", [ShaftOptions(), PAPER, replace(PAPER, strategy="no shaft")])
def test_the_office_is_seen_alike(office: tuple[Occluders, Emitter, Receivers], chosen: ShaftOptions) -> None:
    seen, _ = Visibility(office[0], chosen).step(*office[1:])
    np.testing.assert_array_equal(seen, brute_force(*office, False))


def test_solids_hide_the_same_without_their_backs(office: tuple[Occluders, Emitter, Receivers]) -> None:
    """Not by the same test, but in the same office: none of these rays grazes an edge."""
    seen, counts = Visibility(office[0], ShaftOptions(solids=True)).step(*office[1:])
    _, both_sides = Visibility(office[0], ShaftOptions()).step(*office[1:])
    np.testing.assert_array_equal(seen, brute_force(*office, False))
    assert counts.candidates < 0.8 * both_sides.candidates


def test_shafts_save_tests_and_empty_ones_all_of_them(office: tuple[Occluders, Emitter, Receivers]) -> None:
    none = Visibility(office[0], replace(PAPER, strategy="no shaft")).step(*office[1:])[1]
    paper = Visibility(office[0], PAPER, "clusters").step(*office[1:])[1]
    fine = Visibility(office[0], ShaftOptions(together=False, clump=2)).step(*office[1:])[1]
    assert paper.tests < 0.6 * none.tests
    assert fine.tests < 0.3 * none.tests
    assert fine.free > 0.1 * fine.rays


def test_shafts_within_shafts_start_from_shorter_lists(office: tuple[Occluders, Emitter, Receivers]) -> None:
    of = office[0]
    keep = ShaftOptions(strategy="ratio open", clump=1, group=0, nested=False)
    alone = Visibility(of, keep).step(*office[1:])[1]
    nested = Visibility(of, replace(keep, group=64, nested=True)).step(*office[1:])[1]
    assert nested.shaft_tests / nested.shafts < 0.7 * alone.shaft_tests / alone.shafts


def test_the_emitter_list_is_the_same_from_below_and_from_above(
    office: tuple[Occluders, Emitter, Receivers],
) -> None:
    of, emitter, _ = office
    visibility = Visibility(of, ShaftOptions(behind_emitter=False, tolerance=False))
    tree = visibility.tree
    nodes, flags = visibility.emitter_list(emitter)
    above, _ = visibility.emitter_list(replace(emitter, polygon=-1))
    leaf = next(n for n in range(len(tree)) if tree.count[n] and tree.items(n)[0] == emitter.polygon)
    assert set(nodes.tolist()) == set(above.tolist()) - {leaf}
    box = np.concatenate([emitter.points.min(axis=0), emitter.points.max(axis=0)])
    for node, flag in zip(nodes, flags, strict=True):
        overlap = np.all(tree.lower[node] <= box[3:]) and np.all(box[:3] <= tree.upper[node])
        enclosing = np.all(tree.lower[node] <= box[:3]) and np.all(box[3:] <= tree.upper[node])
        assert flag == (-1 if enclosing else int(overlap))
        assert not (enclosing and tree.count[node] == 0)
    found = np.concatenate([tree.items(n) for n in nodes])
    assert sorted(found.tolist()) == [i for i in range(len(of)) if i != emitter.polygon]


def test_what_is_behind_the_emitter_is_gone(office: tuple[Occluders, Emitter, Receivers]) -> None:
    of, emitter, _ = office
    visibility = Visibility(of)
    nodes, _ = visibility.emitter_list(emitter)
    found = set(np.concatenate([visibility.tree.items(n) for n in nodes]).tolist())
    ceiling = next(i for i in range(len(of)) if np.all(of.corners[i, :, 1] == 3.0))
    assert ceiling not in found
    in_front = np.flatnonzero(of.corners[:, :, 1].min(axis=1) < 2.9)
    assert set(in_front.tolist()) <= found


def test_two_triangles_of_a_parallelogram_are_one_occluder() -> None:
    room = load_scene("cornell-box")
    of = Occluders.of_scene(room)
    assert len(of) < len(room.triangles)
    np.testing.assert_allclose(of.areas.sum(), room.areas.sum(), rtol=1e-12)
    furnace = Occluders.of_scene(load_scene("furnace", {"subdivisions": "0"}))
    assert len(furnace) == 6
    assert furnace.parallelogram.all()
    assert furnace.solid.all()


def closed_by_counting(triangles: np.ndarray) -> bool:
    """Whether each edge of triangles (N, 3, 3) occurs once in each direction, by a slow, obvious count."""
    edges = Counter((tuple(t[k] + 0.0), tuple(t[(k + 1) % 3] + 0.0)) for t in triangles for k in range(3))
    return all(count == 1 and edges[stop, start] == 1 for (start, stop), count in list(edges.items()))


def test_a_shape_is_closed_if_every_edge_occurs_once_in_each_direction() -> None:
    room = load_scene("room")
    expected = [closed_by_counting(room.triangles[part]) for part in room.shapes.ranges]
    assert closed_shapes(room).tolist() == expected
    assert any(expected)
    assert not all(expected)


def test_points_far_beyond_the_occluders_are_refused() -> None:
    with pytest.raises(UsageError, match="another unit"):
        visible(soup(3, 1, 1), [[0, 0, 0]], [[1e7, 0, 0]])
    with pytest.raises(UsageError, match="must be"):
        visible(soup(3, 1, 1), [[0, 0]], [[1, 0, 0]])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"strategy": "open"}, "strategy is 'open'"),
        ({"strategy": ["ratio open"]}, "strategy: "),
        ({"order": []}, "order: "),
        ({"ratio": 2}, "ratio is 2"),
        ({"ratio": "x"}, "ratio: 'x'"),
        ({"clump": -1}, "clump is -1"),
        ({"clump": float("nan")}, "clump: nan"),
        ({"clump": 1.5}, "clump: 1.5"),
        ({"clump": 2**63}, "clump is 9223372036854775808"),
        ({"clump": 10**400}, "clump: an integer of 401 digits"),
        ({"group": None}, "group: None"),
        ({"longest": "5"}, "longest: '5'"),
        ({"nested": "no"}, "nested: 'no'"),
        ({"min_cut": "x"}, "min_cut: 'x'"),
        ({"min_cut": float("nan")}, "min_cut is nan"),
        ({"min_cut": -0.1}, "min_cut is -0.1"),
    ],
)
def test_wrong_options_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        ShaftOptions(**wrong)
    with pytest.raises(UsageError, match=message):
        replace(PAPER, **wrong)


def test_options_take_numbers_of_numpy_and_an_infinite_minimum_cut() -> None:
    options = ShaftOptions(clump=np.int64(3), nested=np.bool_(False))  # type: ignore[arg-type]
    assert options == ShaftOptions(clump=3, nested=False)
    assert ShaftOptions.of_words(["min_cut=inf"]).min_cut == np.inf
    with pytest.raises(UsageError, match="min_cut is nan"):
        ShaftOptions.of_words(["min_cut=nan"])


def test_nobody_and_nothing() -> None:
    nothing = Occluders.of_triangles(np.zeros((0, 3, 3)))
    assert visible(nothing, [[0, 0, 0]], [[1, 0, 0], [2, 0, 0]]).tolist() == [[True, True]]
    assert visible(soup(3, 1, 1), np.zeros((0, 3)), [[1, 0, 0]]).shape == (0, 1)
    assert visible(soup(3, 1, 1), [[1, 0, 0]], np.zeros((0, 3))).shape == (1, 0)


# As options of a radiosity solution.


@pytest.mark.parametrize(
    "words",
    [["paper"], ["strategy=no shaft", "order=largest first"], ["clump=8", "nested=no", "min_cut=none"]],
    ids=" ".join,
)
def test_options_of_shafts_change_the_time_of_a_solution_and_nothing_else(words):
    by_default = glpath.solve_radiosity("cornell-box-36", patches=60, method="matrix")
    chosen = glpath.solve_radiosity(
        "cornell-box-36", patches=60, method="matrix", shafts=ShaftOptions.of_words(words)
    )
    np.testing.assert_array_equal(chosen.elements, by_default.elements)
    assert chosen.statistics["shafts"] != by_default.statistics["shafts"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["clumb=8"], "Is clump meant"),
        (["clump"], "Write NAME=VALUE"),
        (["clump=eight"], "must be a whole number"),
        (["clump=1_0"], "must be a whole number"),
        (["ratio=\u0660"], "must be a number"),
        (["nested=maybe"], "must be yes or no"),
        (["strategy=best"], "allowed are no shaft, keep closed"),
        (["ratio=2"], "allowed are 0 to 1"),
    ],
    ids=str,
)
def test_an_option_of_shafts_that_there_is_not_is_answered(words, message):
    with pytest.raises(UsageError, match=message):
        ShaftOptions.of_words(words)


def test_particles_know_no_shafts():
    with pytest.raises(UsageError, match="particles are traced one by one"):
        glpath.solve_radiosity("cornell-box-36", method="monte-carlo", shafts=ShaftOptions())


@pytest.mark.parametrize("options", [ShaftOptions(), ShaftOptions(nested=True), PAPER])
def test_groups_made_in_many_calls_are_those_of_one(options: ShaftOptions, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    receivers = Receivers(rng.random((400, 3)), np.repeat(np.arange(50, dtype=np.int32), 8))
    prepare = Visibility(Occluders.of_scene(load_scene("cornell-box")), options).prepare
    whole = prepare(receivers).groups
    monkeypatch.setattr(shaft_points, "_VISITS", 1)
    parts = prepare(receivers).groups
    assert parts.levels == whole.levels
    for ours, theirs in zip(parts[:-1], whole[:-1], strict=True):  # all arrays
        np.testing.assert_array_equal(ours, theirs)
