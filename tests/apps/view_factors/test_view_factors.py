"""View factors: against closed forms, a Monte Carlo in numpy, and the sums that rows of closed rooms have."""

from __future__ import annotations

import errno
import importlib.util
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy import sparse
from typer.testing import CliRunner

import glpath
from benchmarks.view_factor_scenes import (
    CLOSED_FORMS,
    FaceList,
    ball_in_a_box,
    block_in_a_room,
    box_faces,
    city,
    closed_at_random,
    grid,
    joined,
    room_of_outline,
    slats,
)
from glpath.apps.view_factors import compute
from glpath.apps.view_factors.backs import back_shares
from glpath.apps.view_factors.formats import file_kind
from glpath.cli.main import app
from glpath.errors import GlpathError, ImageError, SceneError, UsageError

Float64 = NDArray[np.float64]
L_SHAPE = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
FLOOR = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
LAMP = [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]]


@pytest.mark.parametrize("case", CLOSED_FORMS, ids=lambda case: case.name)
def test_closed_forms(case) -> None:  # type: ignore[no-untyped-def]
    found = glpath.view_factors(case.faces, groups=case.groups)
    assert found.matrix[0, 1] == pytest.approx(case.factor, rel=0.005)


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("triangles", [False, True])
def test_rows_of_a_box_add_up_to_one(cells: int, triangles: bool) -> None:
    found = glpath.view_factors(box_faces([0, 0, 0], [3, 2, 1], cells, inward=True, triangles=triangles))
    assert found.closure_error < 1e-5
    assert found.statistics["partial_pairs"] == 0  # convex: no ray, no point


def test_rows_of_an_l_shaped_room_add_up_to_one() -> None:
    """Its floor is no convex polygon, and its corner hides walls from each other."""
    found = glpath.view_factors(room_of_outline(L_SHAPE, 1.0))
    assert found.statistics["partial_pairs"] > 0
    assert found.closure_error < 3e-4


@pytest.mark.parametrize("error", [1e-2, 1e-3, 1e-4, 1e-5])
def test_the_error_that_is_reported_follows_the_one_that_is_asked_for(error: float) -> None:
    """It was 0.02 at any, where rows were off by 4e-6."""
    found = glpath.view_factors(room_of_outline(L_SHAPE, 1.0), error=error)
    assert found.error.max() <= error
    assert found.statistics["rows_beyond_error"] == 0
    assert 1 < np.median(found.error / np.abs(found.enclosure)) < 30  # of 8 rows; of many it is below 10, see below


def test_rows_of_a_room_with_a_block_add_up_to_one_within_the_error() -> None:
    coarse, fine = (glpath.view_factors(block_in_a_room(6), error=e) for e in (1e-2, 1e-4))
    assert coarse.closure_error < 5e-3
    assert fine.closure_error < 5e-5
    for found in (coarse, fine):
        assert (np.abs(found.enclosure) <= found.error).mean() > 0.99


@pytest.mark.parametrize(("seed", "error", "off"), [(2002, 1e-3, 4e-3), (2002, 1e-4, 4e-4), (2003, 1e-4, 1e-4)])
def test_hard_rows_come_nearer_where_a_smaller_error_is_asked(seed: int, error: float, off: float) -> None:
    """Sheets that cut each other took all points that a polygon may have in one corner of it."""
    assert glpath.view_factors(closed_at_random(seed), error=error).closure_error < off


def off_and_stated(rooms: Iterable[FaceList], error: float) -> tuple[Float64, Float64]:
    """Of all rows of closed rooms: how far each is from 1, and its `error`."""
    found = [glpath.view_factors(room, error=error) for room in rooms]
    return np.concatenate([abs(f.enclosure) for f in found]), np.concatenate([f.error for f in found])


def check_errors(off: Float64, stated: Float64, error: float, beyond: float) -> None:
    """At most one row in a hundred misses what was asked for, and the errors that are reported are of the right
    size."""
    assert (off > error).mean() <= 0.01
    assert (stated > error).mean() <= 0.01
    assert (off > stated).mean() <= beyond
    assert 1 < np.median(stated / np.maximum(off, 1e-12)) < 10


def test_errors_of_random_rooms_are_of_the_size_that_is_reported() -> None:
    off, stated = off_and_stated(map(closed_at_random, range(1000, 1012)), 1e-2)
    assert len(off) > 400
    check_errors(off, stated, 1e-2, beyond=0.04)


@pytest.mark.evidence
@pytest.mark.parametrize(("error", "rooms"), [(0.1, 30), (1e-2, 50), (1e-3, 20), (1e-4, 6)])
def test_errors_of_many_random_rooms_are_of_the_size_that_is_reported(error: float, rooms: int) -> None:
    """Thousands of rows; what a closed room's row lacks of 1 is its error, by no method of ours."""
    off, stated = off_and_stated(map(closed_at_random, range(2000, 2000 + rooms)), error)
    assert len(off) > 40 * rooms
    check_errors(off, stated, error, beyond=0.04)


@pytest.mark.evidence
@pytest.mark.filterwarnings("ignore:.*see backs of faces")
def test_rows_of_furniture_are_not_too_large() -> None:
    """Chairs saw up to 1.9 hundredths too much of the ceiling: few points that missed what is near were enough."""
    found = glpath.view_factors("office", error=1e-2)
    assert found.row_sums.max() < 1.01
    assert found.statistics["rows_beyond_error"] == 0
    assert found.statistics["crowded_pairs"] == 0


def test_what_stands_on_a_face_takes_hardly_more_points_than_where_the_face_ends_there() -> None:
    """What a point sees leaps where it steps over the foot of a sheet, and points are slow at finding where."""
    foot, head = [[0.4, 0, 0], [0.55, 1, 0]], [[0.55, 1, 0.5], [0.4, 0, 0.5]]
    sheet = np.array([*foot, *head]), [[0, 1, 2, 3], [3, 2, 1, 0]]
    target = grid([1.2, 0, 0.1], [0, 0, 1], [0, 1, 0], 1, 1)
    whole = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), [[0, 1, 2, 3]]
    left = np.array([[0.0, 0, 0], foot[0], foot[1], [0, 1, 0]]), [[0, 1, 2, 3]]
    right = np.array([foot[0], [1.0, 0, 0], [1, 1, 0], foot[1]]), [[0, 1, 2, 3]]
    one, two = (joined(*floor, target, sheet) for floor in ([whole], [left, right]))
    found, apart = (
        glpath.view_factors(faces, groups=[0] * (len(faces[1]) - 3) + [1, 2, 2], error=1e-4) for faces in (one, two)
    )
    assert found.matrix[0, 1] == pytest.approx(apart.matrix[0, 1], abs=4e-5)
    assert 0.01 < found.matrix[0, 1] < 0.2
    assert found.statistics["points"] < 3 * apart.statistics["points"]


@pytest.mark.parametrize("make", [ball_in_a_box, slats], ids=["ball in a box", "slats"])
def test_rows_past_many_occluders_take_seconds(make: Callable[[], FaceList]) -> None:
    """Minutes where points were added until two quadratures agreed, however little that changed a row."""
    glpath.view_factors(np.array([FLOOR, LAMP], float))  # compiles
    before = time.process_time()
    off, stated = off_and_stated([make()], 1e-3)
    assert time.process_time() - before < 10  # 2 and 5
    check_errors(off, stated, 1e-3, beyond=0.15)


def test_a_pair_is_the_same_from_either_side() -> None:
    """Pairs are computed once, so the order of faces decides which of the two has the points."""
    vertices, faces = block_in_a_room(4)
    there = glpath.view_factors((vertices, faces)).matrix.toarray()
    back = glpath.view_factors((vertices[:, [1, 2, 0]] * 3.7 - 5, faces[::-1])).matrix.toarray()[::-1, ::-1]
    assert np.abs(there - back).max() < 1e-3
    assert np.abs(there - back).mean() < 1e-6


def seen_by_numbers(a: Float64, b: Float64, lower: Float64, upper: Float64, n: int) -> tuple[float, float]:
    """Between two parallelograms past a box: mean and standard error of n random pairs of points."""
    rng = np.random.default_rng(7)

    def points(q: Float64) -> Float64:
        u, v = rng.random((2, n, 1))
        return np.asarray(q[0] + u * (q[1] - q[0]) + v * (q[3] - q[0]))

    def normal(q: Float64) -> Float64:
        return np.cross(q[1] - q[0], q[3] - q[0])

    x, y = points(a), points(b)
    d = y - x
    square = (d * d).sum(axis=1)
    kernel = np.maximum(d @ normal(a), 0) * np.maximum(-d @ normal(b), 0) / (np.pi * square**2)
    kernel /= np.linalg.norm(normal(a))
    with np.errstate(divide="ignore", invalid="ignore"):
        t0, t1 = (lower - x) / d, (upper - x) / d
    hidden = np.maximum(np.minimum(t0, t1).max(axis=1), 0) < np.minimum(np.maximum(t0, t1).min(axis=1), 1)
    values = kernel * ~hidden
    return float(values.mean()), float(values.std() / np.sqrt(n))


@pytest.mark.parametrize(
    "target",
    [LAMP, [[2, 0, 0], [2, 0, 1], [2, 1, 1], [2, 1, 0]], [[0.2, 2, 0.5], [1, 2, 0.5], [1, 2.4, 2], [0.2, 2.4, 2]]],
    ids=["opposite", "beside", "askew"],
)
def test_occlusion_agrees_with_monte_carlo(target: list[list[float]]) -> None:
    lower, upper = np.array([0.4, 0.3, 0.2]), np.array([1.6, 1.4, 0.6])
    block_vertices, block = box_faces(lower, upper, 1, inward=False)
    a, b = np.array(FLOOR, float), np.array(target, float)
    faces = [[0, 1, 2, 3], [4, 5, 6, 7], *([v + 8 for v in face] for face in block)]
    found = glpath.view_factors((np.concatenate([a, b, block_vertices]), faces), error=1e-4).matrix[0, 1]
    expected, error = seen_by_numbers(a, b, lower, upper, 1_000_000)
    assert expected > 10 * error
    assert found == pytest.approx(expected, abs=4 * error)


@pytest.mark.filterwarnings("ignore:.*see backs of faces")  # of those whose planes cut each other
def test_what_points_find_is_within_the_error_that_is_reported() -> None:
    """Apart from each other it is points on both, as few as the error allows; the contour integral, which an error
    of 1e-7 asks for, knows better."""
    rng = np.random.default_rng(2)
    angles = np.sort(rng.random((40, 2, 4)) * 2 * np.pi, axis=2)
    worst = 0.0
    for turn, distance in zip(angles, rng.uniform(2.3, 9, 40), strict=True):
        one, two = (np.column_stack([np.cos(t), np.sin(t), rng.normal() * np.cos(t)]) for t in turn)
        faces = np.array([one, (two * [1, -1, 1] + [rng.normal(), 0, distance])])
        exact = glpath.view_factors(faces, error=1e-7)
        if exact.matrix.nnz == 0:
            continue
        for error in (0.1, 1e-3, 1e-5):
            found = glpath.view_factors(faces, error=error)
            off = abs(found.matrix[0, 1] - exact.matrix[0, 1])
            assert off <= found.error[0] + exact.error[0]
            assert found.error[0] <= error + 1e-4  # of edges as wide as rounding, and slivers have little else
            worst = max(worst, off / error)
    assert 1e-5 < worst < 0.05  # few points, and still a part of what is allowed


def test_a_street_canyon_sees_the_sky_of_the_crossed_strings() -> None:
    """Faces a thousand times as long as they are apart."""
    h, length = 4.0, 5000.0
    road = [[0, 0, 0], [1, 0, 0], [1, length, 0], [0, length, 0]]
    left = [[0, 0, 0], [0, length, 0], [0, length, h], [0, 0, h]]
    right = [[1, 0, 0], [1, 0, h], [1, length, h], [1, length, 0]]
    sky = glpath.view_factors(np.array([road, left, right])).enclosure
    across = np.hypot(1, h)
    assert sky == pytest.approx([across - h, *[(1 + h - across) / (2 * h)] * 2], rel=2e-3)


def test_groups_are_sums_of_faces() -> None:
    vertices, faces = box_faces([0, 0, 0], [1, 1, 1], 3, inward=True, triangles=True)
    each = glpath.view_factors((vertices, faces))
    planar = glpath.view_factors((vertices, faces), groups="planar")
    assert len(planar) == 6
    assert planar.statistics["facets"] == 6  # put together, not summed
    assert planar.matrix[0, 1] == pytest.approx(0.199825, abs=1e-5)
    labels = np.arange(len(faces)) // 18
    member = sparse.csr_array((each.areas, (labels, np.arange(len(faces)))))
    summed = (member @ each.matrix @ (member > 0).astype(float).T).toarray() / planar.areas[:, None]
    assert np.abs(summed - planar.matrix.toarray()).max() < 1e-5
    named = glpath.view_factors((vertices, faces), groups=np.where(labels < 2, "ends", "walls"))
    assert named.names == ("ends", "walls")
    assert named.row_sums == pytest.approx([1, 1], abs=1e-5)


@pytest.mark.parametrize("container", [np.array, list], ids=["array", "list"])
def test_faces_of_a_file_may_have_labels(container: Callable[[Any], Any], tmp_path: Path) -> None:
    """A label for each face, in the order of the file."""
    box = trimesh.creation.box([1.0, 1, 1])
    box.export(tmp_path / "box.stl")
    up = trimesh.load_mesh(tmp_path / "box.stl").face_normals[:, 2]
    labels = container(np.where(abs(up) > 0.5, "ends", "walls"))
    found = glpath.view_factors(tmp_path / "box.stl", groups=labels, flip=True)
    assert found.names == ("ends", "walls")
    assert found.matrix.toarray()[0] == pytest.approx([0.199825, 1 - 0.199825], abs=1e-4)


def test_a_scene_has_its_shapes_as_groups() -> None:
    with pytest.warns(glpath.SceneWarning, match="see backs of faces"):  # the blocks stand on an uncut floor
        found = glpath.view_factors("cornell-box-36", groups="shapes")
    assert len(set(found.names)) == len(found.names) == len(found)
    assert (found.enclosure > -1e-3).all()


def test_closure_is_enforced_without_losing_reciprocity_or_sign() -> None:
    found = glpath.view_factors(block_in_a_room(3), error=1e-2)
    exact = found.enforced(closure=True)
    assert exact.statistics["before"]["closure"] > 1e-6
    assert exact.closure_error < 1e-12
    assert exact.reciprocity_error < 1e-12
    assert exact.matrix.data.min() >= 0
    assert abs(exact.matrix - found.matrix).max() < 2e-3


def test_closure_of_what_is_open_is_refused() -> None:
    with pytest.raises(UsageError, match=r"row 0 adds up to 0\.1998.*not a closed room"):
        glpath.view_factors(np.array([FLOOR, LAMP], float), enforce=["closure"])


def ground_with_a_box(cut: bool, bottom: bool = True) -> FaceList:
    """50 x 50 x 25 m in the middle of a ground of 100 m, which reaches below it unless it is cut."""
    pieces = [(-50, -50, 100, 25), (-50, 25, 100, 25), (-50, -25, 25, 50), (25, -25, 25, 50)]
    if not cut:
        pieces = [(-50, -50, 100, 100)]
    ground = [grid([x, y, 0], [w, 0, 0], [0, h, 0], 1, 1) for x, y, w, h in pieces]
    return joined(*ground, box_faces([-25, -25, 0], [25, 25, 25], 1, inward=False, bottom=bottom))


@pytest.mark.parametrize("bottom", [True, False], ids=["closed box", "box without a bottom"])
def test_what_arrives_at_backs_is_no_sky(bottom: bool) -> None:
    """A quarter of the ground lies under the box, and sees it from inside. The rest sees what it sees when cut."""
    cut = glpath.view_factors(ground_with_a_box(cut=True, bottom=False), error=1e-4)
    assert not cut.backs.any()
    ground, areas = slice(0, 4), cut.areas[:4]
    expected = float(cut.sky[ground] @ areas) / 1e4
    assert 0.3 < expected < 0.74
    with pytest.warns(glpath.SceneWarning, match=r"1 of \d rows see backs of faces: .* of row 0 25 %"):
        found = glpath.view_factors(ground_with_a_box(cut=False, bottom=bottom), error=1e-3)
    assert found.backs[0] == pytest.approx(0.25, abs=1e-3)
    assert found.backs_error[0] < 2e-3
    assert not found.backs[1:].any()
    assert found.sky[0] == pytest.approx(expected, abs=1e-3)
    assert found.sky + found.row_sums + found.backs == pytest.approx(np.ones(len(found)))
    assert found.statistics["rows_that_see_backs"] == 1


def test_backs_are_seen_from_inside_of_what_has_its_fronts_outside() -> None:
    """A block, whose fronts are outside, in a room whose fronts are inside, sees none; turned, it shows them."""
    vertices, faces = block_in_a_room(2)
    assert not glpath.view_factors((vertices, faces)).backs.any()
    room = box_faces([0, 0, 0], [1, 1, 1], 2, inward=True)
    block = box_faces([0.3, 0.3, 0.3], [0.7, 0.7, 0.7], 1, inward=True)
    with pytest.warns(glpath.SceneWarning, match="24 of 30 rows see backs"):
        found = glpath.view_factors(joined(room, block), error=1e-3)
    assert found.backs[:24] == pytest.approx(1 - found.row_sums[:24], abs=2e-3)  # closed: no sky
    assert not found.backs[24:].any()  # inside of the block


def test_a_sheet_of_two_faces_has_no_back() -> None:
    sheet = [[0.2, 0.2, 0.5], [0.8, 0.2, 0.5], [0.8, 0.8, 0.5], [0.2, 0.8, 0.5]]
    vertices, faces = box_faces([0, 0, 0], [1, 1, 1], 1, inward=True)
    both = np.concatenate([vertices, sheet]), [*faces, [24, 25, 26, 27], [27, 26, 25, 24]]
    assert len(vertices) == 24
    assert not glpath.view_factors(both).backs.any()
    with pytest.warns(glpath.SceneWarning, match="see backs"):
        assert glpath.view_factors((both[0], both[1][:-1])).backs[0] > 0.1


def test_the_sky_sees_what_no_face_does() -> None:
    found = glpath.view_factors(city(2))
    assert (found.sky > -1e-3).all()
    assert not found.backs.any()
    assert found.sky.max() == 1  # a roof above all others


def test_back_faces_see_nothing() -> None:
    """Two faces back to back, behind each other's planes, and turned."""
    both = np.array([FLOOR, LAMP], float)
    assert glpath.view_factors(both[:, ::-1]).matrix.nnz == 0
    assert glpath.view_factors(both[:, ::-1], flip=True).matrix[0, 1] == pytest.approx(0.199825, abs=1e-5)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), r"faces\[0\] has no area, nor has any other"),
        (([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], [[0, 1, 2, 3]]), r"faces\[0\] is not flat"),
        (([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]]), r"vertex 2 is \[nan"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], []), "there are no faces"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 7]]), r"faces\[0\] names vertex 7"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1]]), r"faces\[0\] has 2 corners"),
        (np.zeros((3, 2, 3)), r"shape \(3, 2, 3\)"),
        (None, "found NoneType, where a scene is needed"),
        ([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0]]], "faces are no array of numbers"),
        (np.zeros((2, 3, 3), complex), "faces are no array of numbers"),
        (([[0, 0, 0], [1, 0]], [[0, 1, 0]]), "vertices are no array of numbers"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [0, 1, 2]), "faces are no lists of numbers"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1.4, 2]]), r"faces\[0\] names vertex 1.4; allowed are whole"),
        (
            {
                "camera": {"position": [0, 0, 3], "target": [0, 0, 0]},
                "shapes": [{"type": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}],
            },
            "plane",
        ),
    ],
    ids=[
        "no area",
        "bent",
        "nan",
        "empty",
        "no vertex",
        "two corners",
        "array",
        "none",
        "ragged",
        "complex",
        "ragged vertices",
        "flat list",
        "no whole number",
        "endless",
    ],
)
def test_wrong_faces_are_explained(faces, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(GlpathError, match=message):
        glpath.view_factors(faces)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (
            np.eye(3),
            np.array([[0, 1, 2**64 - 1]], np.uint64),
            r"faces\[0\] names vertex 18446744073709551615; a",
        ),
        (np.eye(3), [[0, 1, 2], [2**63, 0, 1]], r"faces\[1\] names vertex 9223372036854775808; a face"),
        (np.eye(3), [[0, 1, 2], [0, 1]], r"faces\[1\] has 2 corners"),
        (np.eye(3), [3, 0, 1, 2], "faces are no lists of numbers"),
        (np.eye(3), [[0.9, 1.2, 2]], r"faces\[0\] names vertex 0.9; allowed are whole"),
        (np.eye(3), None, "faces are no lists of numbers"),
        (np.zeros((3, 2)), [[0, 1, 2]], r"vertices of shape \(3, 2\)"),
        (np.zeros(3), [[0, 1, 2]], r"vertices of shape \(3,\)"),
        ("x", [[0, 1, 2]], "vertices are no array of numbers"),
    ],
)
def test_wrong_faces_of_tuples_and_meshes_are_explained_alike(vertices: Any, faces: Any, message: str) -> None:
    for given in (vertices, faces), SimpleNamespace(vertices=vertices, faces=faces):
        with pytest.raises(GlpathError, match=message):
            glpath.view_factors(given)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"error": 0.0}, "error is 0"),
        ({"groups": "walls"}, "groups is 'walls'"),
        ({"groups": [1, 2, 3]}, "a label for each"),
        ({"groups": "shapes"}, "arrays and meshes have none"),
        ({"enforce": ["beauty"]}, "enforce 'beauty'"),
        ({"threads": 0}, "threads is 0"),
        ({"threads": 1.5}, "threads: 1.5 where a whole number"),
        ({"error": "1e-3"}, "error: '1e-3' where a number"),
        ({"enforce": None}, "enforce: None where a list"),
        ({"groups": [[1], [1, 2]]}, "a label for each"),
    ],
)
def test_wrong_options_are_explained(options, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UsageError, match=message):
        glpath.view_factors(np.array([FLOOR, LAMP], float), **options)


def test_faces_that_are_there_twice_are_told_of() -> None:
    vertices, faces = box_faces([0, 0, 0], [1, 1, 1], 1, inward=True)
    with pytest.warns(glpath.SceneWarning, match=r"5 of 7 rows add up to more than 1, row [1-5] to 1\.2"):
        found = glpath.view_factors((vertices, [*faces, faces[0]]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(glpath.SceneWarning, match="5 of 7 rows") as caught:
            glpath.view_factors((vertices, [*faces, faces[0]]))
    assert np.array_equal(caught.value.result.matrix.toarray(), found.matrix.toarray())


def test_labels_may_be_of_any_kind() -> None:
    assert glpath.view_factors(np.array([FLOOR, LAMP], float), groups=[None, 3]).names == ("3", "None")


def test_what_does_not_fit_into_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.radiosity.memory.available_bytes", lambda: 100_000)
    monkeypatch.setattr("glpath.apps.view_factors.compute._ASKED", 0)
    with pytest.raises(UsageError, match=r"a matrix of about .* factors would need about"):
        glpath.view_factors(box_faces([0, 0, 0], [1, 1, 1], 6, inward=True))


def test_an_interrupted_matrix_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.apps.view_factors.compute._REPORT_INTERVAL", 0.0)
    faces, part = block_in_a_room(5), tmp_path / "rows.part"
    whole = glpath.view_factors(faces)

    class StopError(Exception):
        pass

    def stop(progress: glpath.ViewFactorProgress) -> None:
        if progress.done > 100:  # of which those of two tasks may be lost
            raise StopError

    with pytest.raises(StopError):
        glpath.view_factors(faces, resume=part, on_progress=stop)
    assert part.exists()
    seen = []
    resumed = glpath.view_factors(faces, resume=part, on_progress=lambda p: seen.append((p.stage, p.done)))
    assert next(done for stage, done in seen if stage == "rows") >= 32
    assert not part.exists()
    assert np.array_equal(resumed.matrix.toarray(), whole.matrix.toarray())
    with pytest.raises(StopError):
        glpath.view_factors(faces, resume=part, on_progress=stop)
    with pytest.raises(GlpathError, match="rows of other faces"):
        glpath.view_factors(box_faces([0, 0, 0], [1, 1, 1], 6, inward=True), resume=part)


def test_rows_are_saved_if_the_matrix_will_not_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A larger machine then resumes from them, as the error advises."""
    faces, part = block_in_a_room(5), tmp_path / "rows.part"

    def refuse(*_: object) -> None:
        raise GlpathError("too large", "take a larger machine")

    with monkeypatch.context() as patch:
        patch.setattr("glpath.apps.view_factors.compute._ASKED", 0)
        patch.setattr("glpath.apps.view_factors.compute.require_memory", refuse)
        with pytest.raises(GlpathError, match="too large"):
            glpath.view_factors(faces, resume=part)
    with np.load(part) as stored:
        assert len(stored["tasks"]) > 0
    assert np.array_equal(
        glpath.view_factors(faces, resume=part).matrix.toarray(), glpath.view_factors(faces).matrix.toarray()
    )


def test_all_rows_are_saved_before_backs_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Backs may take minutes, in which the process may be killed. The last periodic save lacks some rows."""
    faces, part = box_faces([0, 0, 0], [1, 1, 1], 2, inward=True), tmp_path / "rows.part"

    def killed(*_: object) -> None:
        with np.load(part) as saved:
            assert sorted(saved["tasks"]) == list(range(6))  # of 4 rows each
        raise KeyboardInterrupt

    monkeypatch.setattr(compute, "back_shares", killed)
    with pytest.raises(KeyboardInterrupt):
        glpath.view_factors(faces, resume=part)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("i", [2], "`i` has 2 to 2, expected 0 to 1"),
        ("j", [-1], "`j` has -1 to -1, expected 0 to 1"),
        ("tasks", [1], "`tasks` has 1 to 1, expected 0 to 0"),
        ("tasks", [0, 0], "`tasks` has a number twice"),
        ("exchange", [-0.2], "`exchange` has values that are negative or not finite"),
        ("exchange", [math.inf], "`exchange` has values that are negative or not finite"),
    ],
)
def test_saved_rows_that_no_call_writes_are_refused(
    name: str, values: list[float], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faces, part = np.array([FLOOR, LAMP], float), tmp_path / "rows.part"
    with compute.ViewFactorCheckpoint(part) as checkpoint:
        glpath.view_factors(faces, resume=checkpoint)
    saved = dict(np.load(part))
    np.savez(tmp_path / "wrong.npz", **{**saved, name: np.array(values, saved[name].dtype)})
    (tmp_path / "wrong.npz").rename(part)
    with pytest.raises(
        ImageError, match=f"rows.part: cannot be read as view factors to resume: {message}"
    ) as error:
        glpath.view_factors(faces, resume=part)
    assert "Remove it to begin anew." in str(error.value)


def test_a_matrix_continues_where_its_rows_cannot_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    whole = glpath.view_factors(block_in_a_room(3))
    monkeypatch.setattr("glpath.apps.view_factors.compute._SAVE_INTERVAL", 0.0)
    monkeypatch.setattr("glpath.apps.view_factors.compute._SAVE_SHARE", math.inf)
    monkeypatch.setattr(os, "replace", full)
    found = glpath.view_factors(block_in_a_room(3), resume=tmp_path / "rows.part")
    assert np.array_equal(found.matrix.toarray(), whole.matrix.toarray())
    assert sum("the matrix continues" in record.getMessage() for record in caplog.records) == 1


def test_an_interruption_waits_for_no_row(tmp_path: Path) -> None:
    """One of `office` takes many seconds at this error. What is ended within a row is computed anew: see above."""
    scene = glpath.load_scene("office")
    glpath.view_factors(np.array([FLOOR, LAMP], float))  # compiles

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    start = time.monotonic()
    try:
        signal.setitimer(signal.ITIMER_REAL, 1.0)
        with pytest.raises(KeyboardInterrupt):
            glpath.view_factors(scene, error=1e-6, resume=tmp_path / "rows.part")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - start < 4


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("svf.inputs.npz", "npz"),
        ("svf.inp.npz", "npz"),
        ("vfsparse.input.csv", "csv"),
        ("vfsparse.inp", "vfsparse.inp"),
        ("VF.NC.INP.0042", "vf.nc.inp"),
        ("svf.inputs", None),
        ("svf.inp.txt", None),
    ],
)
def test_the_whole_name_of_a_file_says_its_format(name: str, kind: str | None) -> None:
    if kind is not None:
        assert file_kind(name) == kind
        return
    with pytest.raises(UsageError, match="is no name of a file of view factors"):
        file_kind(name)


def test_files(tmp_path: Path) -> None:
    found = glpath.view_factors(np.array([FLOOR, LAMP], float))
    for name in ("f.npz", "f.csv", "vfsparse.inp.001", "svf.inp.001"):
        found.save(tmp_path / name)
    assert sparse.load_npz(tmp_path / "f.npz").toarray() == pytest.approx(found.matrix.toarray())
    again = glpath.ViewFactors.load(tmp_path / "f.npz")
    assert np.array_equal(again.matrix.toarray(), found.matrix.toarray())
    assert again.statistics["facets"] == 2
    assert (tmp_path / "f.csv").read_text().splitlines() == ["i,j,F", "0,1,0.199824896", "1,0,0.199824896"]
    assert (tmp_path / "svf.inp.001").read_text().split() == [
        "#", "sky", "view", "factors", "0.800175104", "0.800175104",
    ]  # fmt: skip
    assert (tmp_path / "vfsparse.inp.001").read_text().splitlines() == ["1 2 0.199824896", "2 1 0.199824896"]
    with pytest.raises(UsageError, match=r"allowed are \.npz, \.csv, \.idf, vfsparse"):
        found.save(tmp_path / "f.txt")
    (tmp_path / "g.npz").write_bytes((tmp_path / "f.npz").read_bytes()[:300])
    with pytest.raises(GlpathError, match="cannot be read as view factors"):
        glpath.ViewFactors.load(tmp_path / "g.npz")


def test_files_that_hold_factors_hold_what_arrives_at_backs(tmp_path: Path) -> None:
    """Or what a row lacks of 1 would count as sky."""
    from scipy.io import netcdf_file

    with pytest.warns(glpath.SceneWarning, match="see backs"):
        found = glpath.view_factors(ground_with_a_box(cut=False), error=1e-2)
    for name in ("f.npz", "f.csv", "svf.inp.001", "vf.nc.inp.001"):
        found.save(tmp_path / name)
    again = glpath.ViewFactors.load(tmp_path / "f.npz")
    assert np.array_equal(again.backs, found.backs)
    assert np.array_equal(again.sky, found.sky)
    assert again.statistics["backs_max"] == found.backs[0]
    assert (tmp_path / "f.csv").read_text().splitlines()[-1] == f"0,backs,{found.backs[0]:.9g}"
    assert float((tmp_path / "svf.inp.001").read_text().splitlines()[1]) == pytest.approx(found.sky[0])
    with netcdf_file(tmp_path / "vf.nc.inp.001", mmap=False) as file:
        assert file.variables["backs"].data == pytest.approx(found.backs, rel=1e-6)


def read_idf(path: Path) -> tuple[str, list[str]]:
    """The first object of EnergyPlus's text: its class and its fields."""
    plain = "".join(line.split("!")[0] for line in path.read_text().splitlines())
    kind, *fields = (field.strip() for field in plain.split(";")[0].split(","))
    return kind, fields


def test_energyplus_has_a_factor_for_each_pair_of_surfaces(tmp_path: Path) -> None:
    """A room with a large floor, so that the direction of a factor shows."""
    names = ["Floor", "Ceiling", "West", "East", "South", "North"]
    found = glpath.view_factors(box_faces([0, 0, 0], [4, 3, 1], 1, inward=True), groups=names)
    found.save(tmp_path / "Zone One.idf")
    kind, (zone, *fields) = read_idf(tmp_path / "Zone One.idf")
    assert (kind, zone) == ("ZoneProperty:UserViewFactors:BySurfaceName", "Zone One")
    factors = {(a, b): float(f) for a, b, f in zip(fields[::3], fields[1::3], fields[2::3], strict=True)}
    assert len(factors) == len(fields) / 3 == 36
    at = {name: i for i, name in enumerate(found.names)}
    assert all(value == pytest.approx(found.matrix[at[a], at[b]], abs=1e-8) for (a, b), value in factors.items())
    assert factors["West", "Floor"] == pytest.approx(4 * factors["Floor", "West"])
    for name in names:
        assert sum(value for (a, _), value in factors.items() if a == name) == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize(
    ("groups", "name", "message"),
    [
        ("faces", "a.idf", "knows surfaces by their names"),
        (["a;", "b", "c", "d", "e", "f"], "a.idf", "'a;' cannot be a name"),
        (["a", "A", "c", "d", "e", "f"], "a.idf", "'A' and 'a' are one name"),
        (list("abcdef"), "living, east.idf", "'living, east' cannot be a name"),
    ],
    ids=["faces", "mark", "case", "zone"],
)
def test_what_energyplus_cannot_read_is_refused(groups, name: str, message: str, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    found = glpath.view_factors(box_faces([0, 0, 0], [1, 1, 1], 1, inward=True), groups=groups)
    with pytest.raises(UsageError, match=message):
        found.save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_energyplus_takes_closed_zones_alone(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"EnergyPlus: row 0 \(floor\) adds up to 0\.1998.*not a closed room"):
        glpath.view_factors(np.array([FLOOR, LAMP], float), groups=["floor", "lamp"]).save(tmp_path / "a.idf")


def test_udales_reads_the_dense_matrix_as_the_sparse_one(tmp_path: Path) -> None:
    """Fortran's vf(i, j) lies where the order of C has [j, i]."""
    from scipy.io import netcdf_file

    faces = np.array([[[0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0]], LAMP], float)
    found = glpath.view_factors(faces)
    for name in ("vf.nc.inp.007", "facetarea.inp.007"):
        found.save(tmp_path / name)
    with netcdf_file(tmp_path / "vf.nc.inp.007", mmap=False) as file:
        held = file.variables["view factor"]
        assert (held.dimensions, held.data.dtype.itemsize) == (("rows", "columns"), 4)
        assert pytest.approx(found.matrix.toarray(), rel=1e-6) == held.data.T
    assert found.matrix[1, 0] == pytest.approx(3 * found.matrix[0, 1])
    assert (tmp_path / "facetarea.inp.007").read_text().splitlines() == ["# area of facets", "3", "1"]


def stl(path: Path) -> Path:
    vertices, faces = box_faces([0, 0, 0], [1, 1, 1], 1, inward=False, triangles=True)
    lines = ["solid box"]
    for face in faces:
        corners = "".join("vertex {} {} {}\n".format(*vertices[v]) for v in face)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid box\n"]))
    return path


def test_the_command_writes_the_inside_of_a_model(tmp_path: Path) -> None:
    model, out = stl(tmp_path / "model.stl"), tmp_path / "F.npz"
    options = ["--groups", "planar", "--flip", "--enforce", "reciprocity,closure", "--resume"]
    done = CliRunner().invoke(app, ["viewfactors", str(model), "-o", str(out), *options])
    assert done.exit_code == 0, done.stderr
    assert "6 groups, 30 factors" in done.stderr
    assert "closure: off by" in done.stderr
    assert "each pair is computed once" not in done.stderr  # what was enforced is told instead
    assert "warning" not in done.stderr  # a model needs neither light nor camera
    assert glpath.ViewFactors.load(out).row_sums == pytest.approx(np.ones(6))
    assert not (tmp_path / "F.npz.part").exists()


def test_the_command_reports_backs_and_rows_that_miss_the_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.apps.view_factors.compute._CAUTION", 250.0)
    done = CliRunner().invoke(
        app, ["viewfactors", "cornell-box-36", "-o", str(tmp_path / "F.npz"), "--error", "1e-2"]
    )
    assert done.exit_code == 0, done.stderr
    assert re.search(r"backs of faces: seen by \d+ faces, [\d.]+ % of a row at most", done.stderr)
    assert re.search(r"\d+ of 36 rows \([\d.]+ %\) miss the error of 0.01 that is wanted", done.stderr)


@pytest.mark.parametrize("resume", [True, False])
def test_an_interrupted_command_names_what_is_kept_and_how_to_resume(
    resume: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **given: Any) -> None:
        if given["resume"]:
            given["resume"].path.touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("glpath.apps.view_factors.compute.view_factors", interrupted)
    out = tmp_path / "a b.npz"
    command = ["viewfactors", "cornell-box-36", "-o", str(out), "--error", "1e-2", "--flip"]
    done = CliRunner().invoke(app, [*command, *["--resume"] * resume])
    assert done.exit_code == 130
    if resume:
        assert f"interrupted: the rows that are done are in {out}.part" in done.stderr
        again = done.stderr.split("to resume: ")[1].strip()
        assert shlex.split(again) == ["glpath", *command, "--resume"]
    else:
        assert "interrupted: nothing is kept; --resume keeps the rows that are done" in done.stderr


def test_sigterm_ends_the_command_within_a_row(tmp_path: Path) -> None:
    """Rows of `office` take seconds at this error, and are told of while they do."""
    out = tmp_path / "F.npz"
    command = [sys.executable, "-m", "glpath", "viewfactors", "office", "-o", str(out), "--error", "1e-6"]
    glpath.view_factors(np.array([FLOOR, LAMP], float))  # compiles
    running = subprocess.Popen([*command, "--resume", "--progress", "json"], stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    for line in running.stderr:
        if '"rows"' in line:
            break
    time.sleep(1)
    running.terminate()
    start = time.monotonic()
    _, said = running.communicate(timeout=60)
    assert time.monotonic() - start < 20  # of which the most is to load what ends it, on a machine that is busy
    assert running.returncode == 75
    assert "to resume: glpath viewfactors office" in said


@pytest.mark.parametrize("step", ["enforced", "save"])
def test_rows_stay_until_the_command_has_saved_the_matrix(
    step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, part = stl(tmp_path / "model.stl"), tmp_path / "F.csv.part"
    command = ["viewfactors", str(model), "-o", str(tmp_path / "F.csv"), "--flip", "--resume"]
    command += ["--enforce", "closure,reciprocity"]

    def fail(*_: object, **__: object) -> None:
        with pytest.raises(GlpathError, match="has it already"), compute.ViewFactorCheckpoint(part):
            pass
        raise MemoryError

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(glpath.ViewFactors, step, fail)
        assert CliRunner().invoke(app, command).exit_code == 1
    with np.load(part) as saved:
        assert sorted(saved["tasks"]) == [0, 1, 2]  # of 4 of the 12 rows each
    assert len(list(tmp_path.glob("glpath-*/viewfactors.npz"))) == (step == "enforced")
    with monkeypatch.context() as patch:
        patch.setattr(compute, "_task", fail)  # no row is computed again
        assert CliRunner().invoke(app, command).exit_code == 0
    assert (part.exists(), (tmp_path / "F.csv").exists()) == (False, True)


def test_a_matrix_that_cannot_be_closed_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That the model is open is known only when all rows are there."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    model, out = stl(tmp_path / "model.stl"), tmp_path / "F.npz"
    done = CliRunner().invoke(app, ["viewfactors", str(model), "-o", str(out), "--enforce", "closure"])
    assert done.exit_code == 2
    assert "this is not a closed room" in done.stderr
    (kept,) = tmp_path.glob("glpath-*/viewfactors.npz")
    assert f"The matrix is kept in {kept}." in " ".join(done.stderr.split())
    assert len(glpath.ViewFactors.load(kept)) == 12
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "f.txt"], "allowed are .npz, .csv, .idf, vfsparse"),
        (["-o", "f.npz", "--groups", "walls"], "--groups walls: there is no such choice"),
        (["-o", "f.npz", "--enforce", "beauty"], "--enforce beauty: there is no such choice"),
        (["-o", "zone.idf"], "knows surfaces by their names"),
        (["-o", "f.npz", "--error", "2"], "--error 2: must be from 1e-7 to 0.1"),
    ],
)
def test_wrong_usage_is_one_block(arguments: list[str], message: str) -> None:
    done = CliRunner().invoke(app, ["viewfactors", "cornell-box", *arguments])
    assert done.exit_code == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_without_faces_it_is_a_scene_error() -> None:
    with pytest.raises(SceneError):
        glpath.view_factors((np.zeros((0, 3)), []))


def test_importing_glpath_imports_no_scipy() -> None:
    code = "import sys, glpath; glpath.__all__; assert 'scipy' not in sys.modules and 'numba' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_rows_have_their_centroids_and_normals(tmp_path: Path) -> None:
    """Of an L, whose parts of 2 x 1 and 1 x 1 say where its centroid is, and of a square above it."""
    ell = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]]
    above = [[0, 0, 3], [0, 2, 3], [2, 2, 3], [2, 0, 3]]
    found = glpath.view_factors((np.array([*ell, *above], float), [[0, 1, 2, 3, 4, 5], [6, 7, 8, 9]]))
    assert found.centroids == pytest.approx(np.array([[(2 * 1 + 0.5) / 3, (2 * 0.5 + 1.5) / 3, 0], [1, 1, 3]]))
    assert found.normals.tolist() == [[0, 0, 1], [0, 0, -1]]
    found.save(tmp_path / "a.npz")
    again = glpath.ViewFactors.load(tmp_path / "a.npz")
    assert np.array_equal(again.centroids, found.centroids)
    rows = found.to_pandas() if importlib.util.find_spec("pandas") else None
    if rows is not None:
        assert rows["normal_z"].tolist() == [1, -1]
        assert rows["centroid_z"].tolist() == [0, 3]


def test_a_plane_of_several_faces_has_one_normal_and_a_closed_group_none() -> None:
    cube = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]
    triangles = [t for a, b, c, d in WALLS for t in ([a, b, c], [a, c, d])]
    planes = glpath.view_factors((np.array(cube, float), triangles), groups="planar")
    axes = sorted(map(tuple, np.abs(planes.normals).tolist()))
    assert axes == [(0, 0, 1)] * 2 + [(0, 1, 0)] * 2 + [(1, 0, 0)] * 2
    assert np.allclose(planes.centroids - planes.normals * -0.5, 0.5)
    whole = glpath.view_factors((np.array(cube, float), triangles), groups=[0] * len(triangles))
    assert np.isnan(whole.normals).all()
    assert whole.centroids == pytest.approx(np.full((1, 3), 0.5))


WALLS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_threads_are_at_most_one_per_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compute, "core_count", lambda: 2)
    started: list[int] = []
    monkeypatch.setattr(compute, "back_shares", lambda *given: started.append(given[3]) or back_shares(*given))
    glpath.view_factors(box_faces([0, 0, 0], [3, 2, 1], 1, inward=True), threads=100_000)
    assert started == [2]
