"""Form factors by casting rays, against closed forms and against every pair of points tested by hand."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.radiosity import Occluders, Visibility
from glpath.radiosity.form_factors.form_factor import KINDS, FormFactors, triangle_factor
from glpath.radiosity.mesh.mesh import Elements, Mesh, divisions_of_size, surfaces
from glpath.radiosity.mesh.sides import Sides, Solids, in_the_open, sub_triangles
from tests.reference.closed_forms import (
    corner_form_factor,
    facing_rectangles_form_factor,
    perpendicular_rectangles_form_factor,
    polygon_irradiance,
    tilted_rectangles_form_factor,
)
from tests.support.rooms import cuboid, part, rectangle, room
from tests.support.visibility import visible_by_all


def matrix(scene, size, **options):
    """(R, R) form factors between all sides of all elements, their areas, and the shape of each."""
    surface = surfaces(scene)
    mesh = Mesh.uniform(scene, divisions_of_size(scene, surface, size), surface)
    sides = Sides.of(scene, mesh.patches)
    visibility = Visibility(Occluders.of_scene(scene), threads=1)
    found = FormFactors(scene, visibility, mesh.patches, sides, together=16, **options)
    at = found.receivers(mesh.elements, sides)
    factors = np.empty((len(sides), len(sides)))
    for batch, (columns, _) in zip(found.batches, found.of_batches(range(len(found.batches)), at), strict=True):
        factors[:, batch] = columns.T
    shape = scene.triangle_shape[mesh.elements.triangle][sides.element]
    return factors, mesh.areas[sides.element] * at.open, shape


def between(scene, size, **options):
    """Form factors between the scene's two shapes, F12 and F21, and the areas."""
    factors, areas, shape = matrix(scene, size, **options)
    a, b = shape == 0, shape == 1
    f12 = areas[a] @ factors[np.ix_(a, b)].sum(axis=1) / areas[a].sum()
    f21 = areas[b] @ factors[np.ix_(b, a)].sum(axis=1) / areas[b].sum()
    return f12, f21, areas[a].sum(), areas[b].sum()


def test_the_closed_forms_agree_with_each_other():
    assert tilted_rectangles_form_factor(0.7, 1.2, 2.0, np.pi / 2) == pytest.approx(
        perpendicular_rectangles_form_factor(0.7, 1.2, 2.0), rel=1e-9
    )
    # By quadrature over the first rectangle of Lambert's formula for the second.
    x, weight = (np.polynomial.legendre.leggauss(24)[0] + 1) / 2, np.polynomial.legendre.leggauss(24)[1] / 2
    up = 0.8 * np.array([np.cos(2), 0, np.sin(2)])
    corners = np.array([(0, 0, 0), (0, 2, 0), np.add((0, 2, 0), up), up])
    total = 0.0
    for i, u in enumerate(x):
        for j, v in enumerate(x):  # u squared: more points near the common edge
            found = polygon_irradiance((1.3 * u * u, 2 * v, 0), (0, 0, 1), corners, 1 / np.pi)
            total += found * 2 * u * weight[i] * weight[j]
    assert total == pytest.approx(tilted_rectangles_form_factor(1.3, 0.8, 2.0, 2.0), rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gap", [0.5, 1.0, 3.0])
def test_parallel_rectangles(kind, gap):
    scene = room(
        part(rectangle((0, 0, 0), (1, 0, 0), (0, 1.5, 0))),
        part(rectangle((0, 0, gap), (0, 1.5, 0), (1, 0, 0))),
    )
    f12, f21, _, _ = between(scene, 0.4, kind=kind)
    assert f12 == pytest.approx(facing_rectangles_form_factor(1, 1.5, gap), rel=0.01)
    assert f21 == pytest.approx(f12, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degrees", [45, 90, 135])
def test_rectangles_that_meet_at_an_angle(kind, degrees):
    angle = np.radians(degrees)
    up = np.array([0.8 * np.cos(angle), 0, 0.8 * np.sin(angle)])
    scene = room(part(rectangle((0, 0, 0), (1.3, 0, 0), (0, 2, 0))), part(rectangle((0, 0, 0), (0, 2, 0), up)))
    f12, f21, a1, a2 = between(scene, 0.25, kind=kind)
    expected = tilted_rectangles_form_factor(1.3, 0.8, 2.0, angle)
    allowed = 0.01 if kind == "polygon" else 0.02  # discs are poor where surfaces touch
    assert f12 == pytest.approx(expected, rel=allowed)
    assert f21 == pytest.approx(expected * a1 / a2, rel=allowed)  # reciprocity


def test_a_point_sees_a_triangle_by_lamberts_formula():
    rng = np.random.default_rng(2)
    for _ in range(50):
        corners = rng.normal((0, 0, 4), 1.0, (3, 3))
        expected = max(polygon_irradiance((0, 0, 0), (0, 0, 1), c, 1 / np.pi) for c in (corners, corners[::-1]))
        assert triangle_factor(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, corners) == pytest.approx(expected, rel=1e-9)


def test_what_is_below_the_horizon_does_not_count():
    # A rectangle that goes on below gives what its upper part gives, a corner on the horizon.
    whole = rectangle((1, -1, -2), (0, 2, 0), (0, 0, 3))
    upper = rectangle((1, -1, 0), (0, 2, 0), (0, 0, 1))
    seen, expected = (sum(triangle_factor(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, t) for t in q) for q in (whole, upper))
    assert seen == pytest.approx(expected, rel=1e-12)
    assert triangle_factor(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, whole[0] - [0, 0, 5]) == 0


def test_discs_need_samples_near_by_and_one_is_enough_five_sizes_away():
    def error(gap, max_samples):
        # A square above a point, of which four corner rectangles are known.
        scene = room(
            part(rectangle((-0.5, -0.5, gap), (0, 1, 0), (1, 0, 0)), emission=1.0),
            part(rectangle((-1e-4, -1e-4, 0), (2e-4, 0, 0), (0, 2e-4, 0))),
        )
        factors, _, shape = matrix(scene, 2.0, kind="disc", max_samples=max_samples)
        seen = factors[np.ix_(shape == 1, shape == 0)].sum(axis=1)
        return np.abs(seen / (4 * corner_form_factor(0.5, 0.5, gap)) - 1).max()

    assert error(1.0, 25) < 0.001 < 0.03 < error(1.0, 1)
    assert error(7.5, 25) == error(7.5, 1) < 0.002


def test_the_rows_of_a_closed_room_add_up_to_one():
    scene = room(part(cuboid((-1, -1, -1), (1, 2, 1.5), inside=True)))
    factors, areas, _ = matrix(scene, 1.0)
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=1e-6)
    # What leaves an emitter arrives as exactly as the points of the receivers allow; reciprocity as well.
    coarse, fine = (_arrival(*matrix(scene, 1.0, points=n)[:2]) for n in (4, 16))
    assert fine[0] < 0.03 < coarse[0] < 0.08
    assert fine[1] < 0.012 < coarse[1] < 0.035
    assert areas @ (areas @ factors / areas) / areas.sum() == pytest.approx(1.0, abs=1e-6)


def _arrival(factors, areas):
    """How far the columns are from 1 at most, and pairs from reciprocity in the mean."""
    flow = areas[:, None] * factors
    return np.abs(areas @ factors / areas - 1).max(), np.abs(flow - flow.T).sum() / flow.sum()


def test_with_a_box_in_it_the_rows_still_add_up_to_one():
    scene = room(
        part(cuboid((-1, -1, -1), (1, 1, 1), inside=True)), part(cuboid((-0.4, -1, -0.5), (0.3, 0.2, 0.4)))
    )
    factors, areas, shape = matrix(scene, 0.8)
    rows = factors.sum(axis=1)
    # The box stands on the floor: its bottom sees nothing, and what it covers does not count as floor.
    bottom = np.count_nonzero(rows < 0.5)
    dark = (areas == 0) | ((shape == 1) & (rows == 0))
    assert 0 < np.count_nonzero(dark) < 16
    assert areas[shape == 0].sum() == pytest.approx(24 - 0.7 * 0.9, rel=0.01)
    np.testing.assert_allclose(rows[~dark], 1.0, atol=0.01)
    assert bottom == np.count_nonzero(dark)


def test_a_point_under_a_box_is_buried():
    floor = rectangle((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    scene = room(part(floor), part(cuboid((-0.5, 0, -0.5), (0.5, 0.7, 0.5))))
    occluders = Occluders.of_scene(scene)
    solid = np.repeat([False, True], [2, 12])
    points = np.array([(0.0, 0, 0), (0.4, 0, -0.3), (0.6, 0, 0), (-0.9, 0, 0.9)])
    up = np.tile([0.0, 1, 0], (4, 1))
    assert in_the_open(scene, solid, points, up).tolist() == [False, False, True, True]
    # Inside of a room that is a box itself nothing is buried.
    walls = room(part(cuboid((-2, -2, -2), (2, 2, 2), inside=True)), part(floor))
    assert in_the_open(walls, np.repeat([True, False], [12, 2]), points, up).all()
    assert occluders.solid.any()


@pytest.mark.parametrize("joined", [False, True])
def test_rooms_are_no_solids_if_one_shape_holds_the_lamps_of_all(joined):
    """Walls of closed boxes with fronts outwards, whose insides are lit by the lamp inside."""
    walls = [part(cuboid((x, 0, 0), (x + 2, 2, 2)), two_sided=True) for x in (0, 5)]
    lamps = [rectangle((x, 1, 0.8), (size, 0, 0), (0, 0, size)) for x, size in ((0.9, 0.2), (5.8, 0.4))]
    lamps = [np.concatenate(lamps)] if joined else lamps
    block = part(cuboid((0.5, 0, 0.5), (0.7, 0.3, 0.7)))
    scene = room(*walls, *(part(lamp, emission=1.0) for lamp in lamps), block)
    solids = Solids.of(scene, np.isin(scene.triangle_shape, [0, 1, scene.triangle_shape[-1]]))
    assert np.unique(scene.triangle_shape[solids.solid]).tolist() == [len(lamps) + 2]


def test_a_room_is_lit_by_a_lamp_of_a_shape_with_a_much_larger_one():
    walls = part(cuboid((0, 0, 0), (5, 5, 3)), two_sided=True)
    lamp, panel = rectangle((2, 2, 2.9), (1, 0, 0), (0, 1, 0)), rectangle((50, 0, 9), (50, 0, 0), (0, 50, 0))
    scene = room(walls, part(np.concatenate([lamp, panel]), emission=1.0))
    assert not Solids.of(scene, scene.triangle_shape == 0).solid.any()


def test_a_pin_of_a_lamp_makes_no_room_of_the_block_that_it_ends_in():
    block = part(cuboid((0, 0, 0), (1, 1, 1)))
    lamp = np.concatenate(
        [rectangle((0, 2, 0), (1, 0, 0), (0, 0, 1)), 0.5 + rectangle((0, 0, 0), (0.01, 0, 0), (0, 0, 0.01))]
    )
    degenerate = np.full((1, 3, 3), 0.5)
    for corners in (lamp, np.concatenate([lamp[:2], degenerate])):
        scene = room(block, part(corners, emission=1.0))
        assert Solids.of(scene, scene.triangle_shape == 0).solid.any()


def test_a_penumbra_is_that_of_every_pair_of_points():
    scene = room(
        part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0))),
        part(rectangle((-0.7, -0.7, 2), (0, 1.4, 0), (1.4, 0, 0)), emission=1.0),
        part(rectangle((-0.5, -0.2, 1), (0.8, 0, 0), (0, 0.8, 0)), 0.0),
    )
    factors, areas, shape = matrix(scene, 0.3, points=1)
    floor = np.flatnonzero(shape == 0)
    found = factors[np.ix_(floor, shape == 1)].sum(axis=1)
    # By hand: many points of the lamp, and the plain test of every segment against every polygon.
    u = (np.arange(40) + 0.5) / 40
    lamp = np.stack(np.meshgrid(-0.7 + 1.4 * u, -0.7 + 1.4 * u, [2.0]), axis=-1).reshape(-1, 3)
    surface = surfaces(scene)
    mesh = Mesh.uniform(scene, divisions_of_size(scene, surface, 0.3), surface)
    points = mesh.elements.points(scene, sub_triangles(1))[:, 0][: len(floor)]
    occluders = Occluders.of_scene(scene)
    none = np.full(len(points), 0, np.int32), np.full(len(lamp), 1, np.int32)
    visible = visible_by_all(occluders.polygons(False), points, lamp, *none)
    d = lamp[None] - points[:, None]
    square = np.sum(d**2, axis=2)
    expected = (visible * d[..., 2] ** 2 / (np.pi * square**2)).sum(axis=1) * 1.4**2 / len(lamp)
    # One sample for each of 50 patches of the lamp, which are five sizes away.
    np.testing.assert_allclose(found, expected, atol=0.1 * expected.max())
    assert np.abs(found - expected).mean() < 0.06 * expected.mean()
    assert np.mean(found - expected) == pytest.approx(0.0, abs=0.005 * expected.mean())
    assert areas[floor].sum() == pytest.approx(4)


@pytest.mark.parametrize("together", [1, 7, 64])
def test_emitters_of_a_batch_get_what_they_get_alone(together):
    scene = room(
        part(cuboid((-1, -1, -1), (1, 1, 1), inside=True)), part(cuboid((-0.3, -0.9, -0.3), (0.3, 0.2, 0.4)))
    )
    surface = surfaces(scene)
    mesh = Mesh.uniform(scene, divisions_of_size(scene, surface, 1.0), surface)
    sides = Sides.of(scene, mesh.patches)
    visibility = Visibility(Occluders.of_scene(scene), threads=1)
    found = FormFactors(scene, visibility, mesh.patches, sides, together=together)
    at = found.receivers(mesh.elements, sides)
    alone = FormFactors(scene, visibility, mesh.patches, sides, together=1)
    assert sorted(np.concatenate(found.batches).tolist()) == list(range(len(sides)))
    assert max(map(len, found.batches)) <= together
    for batch in (0, len(found.batches) // 2):
        columns, _ = found.of_batch(batch, at)
        for emitter, column in zip(found.batches[batch], columns, strict=True):
            expected, _ = alone.of_batch(int(alone.batch_of[emitter]), at)
            np.testing.assert_array_equal(column, expected[0])


def test_both_sides_of_a_two_sided_plate_and_one_of_a_one_sided():
    plate = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    one, two = room(part(plate)), room(part(plate, two_sided=True))
    elements = Elements.of_lattices(np.array([2, 2]))
    assert len(Sides.of(one, elements)) == 8
    sides = Sides.of(two, elements)
    assert (sides.back == np.repeat([0, 1], 8)).all()
    np.testing.assert_array_equal(sides.normal[:, 2], np.repeat([1.0, -1.0], 8))
    lamp = room(part(plate, 0.0, 1.0, emission_two_sided=True))
    np.testing.assert_allclose(Sides.of(lamp, elements).emission, np.pi)
    assert len(Sides.of(room(part(plate, 0.0)), elements)) == 0
