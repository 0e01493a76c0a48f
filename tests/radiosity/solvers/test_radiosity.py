"""Radiosity: solvers against closed forms and each other, meshes, adaptivity, and what cannot be solved."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from glpath import RadiosityInterrupted, SceneError, UsageError, load_scene, solve_radiosity
from glpath.radiosity import memory
from glpath.radiosity.form_factors.transport import FormFactorOptions, Transport
from glpath.radiosity.mesh.mesh import Elements, Mesh, divisions_of_size, size_for_count, surfaces
from glpath.radiosity.mesh.reconstruct import resample
from glpath.radiosity.mesh.sides import sub_triangles
from glpath.radiosity.solution import DIRECT, INDIRECT
from glpath.radiosity.solvers import matrix
from glpath.radiosity.solvers.progressive import Refinement
from glpath.scene import path_traceable
from glpath.system.heartbeat import heartbeat
from tests.reference.closed_forms import facing_plates_radiance, polygon_irradiance
from tests.support.rooms import cuboid, part, rectangle, room, room_with_a_ball, with_triangles


@pytest.fixture(scope="module")
def lit_box():
    """A closed room with a box in it and a lamp under the ceiling; colours, so that no channel is another's."""
    return room(
        part(cuboid((-1, -1, -1), (1, 1, 1), inside=True), (0.7, 0.5, 0.3)),
        part(cuboid((-0.6, -1, -0.5), (0.1, 0.1, 0.3)), (0.2, 0.6, 0.4)),
        part(rectangle((-0.3, 0.8, -0.3), (0.6, 0, 0), (0, 0, 0.6)), 0.3, (10.0, 8.0, 5.0), two_sided=True),
    )


def areas_of(scene, solution):
    triangles = path_traceable(scene)
    return np.repeat(triangles.areas / solution.divisions**2, solution.divisions**2)


def refinement(scene, patches=200, splits=0, overshoot=False, points=4):
    surface = surfaces(scene)
    size = size_for_count(scene, surface, patches)
    mesh = Mesh.uniform(scene, divisions_of_size(scene, surface, size), surface, splits)
    return Refinement(Transport(mesh, FormFactorOptions(points=points), 1 << 30), overshoot)


# Closed forms.


@pytest.mark.parametrize("method", ["progressive", "matrix"])
@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_white_furnace(method, shape):
    # Every surface emits and reflects: H = pi Le (1 + rho + rho^2 ...) everywhere, of which the 1 is direct.
    rho = 0.6
    scene = load_scene("furnace", {"reflectance": rho, "radiance": 2.0, "shape": shape, "subdivisions": 1})
    solution = solve_radiosity(scene, method=method, patches=100, unshot=1e-5, receiver_points=1)
    scale = 1e-4 if method == "progressive" else 2e-6
    for light, expected in ((DIRECT, 2 * np.pi), (INDIRECT, 2 * np.pi * rho / (1 - rho))):
        np.testing.assert_allclose(solution.elements[light, 0], expected, rtol=scale)
        np.testing.assert_allclose(solution.vertices[light, 0], expected, rtol=scale)
    np.testing.assert_allclose(solution.reflected(scene)[0], rho * 2 * np.pi / (1 - rho), rtol=scale)
    np.testing.assert_array_equal(solution.elements[:, 1], 0)  # outside


def test_two_facing_plates_are_the_series():
    emission, reflectance = (3.0, 0.0), (0.4, 0.8)
    plates = room(
        part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), reflectance[0], emission[0]),
        part(rectangle((-1, -1, 1), (0, 2, 0), (2, 0, 0)), reflectance[1], emission[1]),
    )
    solution = solve_radiosity(plates, patches=256, unshot=1e-5)
    expected = facing_plates_radiance(2, 2, 1, emission, reflectance, 40)
    # The plates' middles lie on their diagonals.
    middle = [solution.lookup(plates, [t], [[0.0, 0.5]])[0] / np.pi for t in (0, 2)]
    np.testing.assert_allclose(middle[0] + emission[0], expected[0], rtol=0.005)
    np.testing.assert_allclose(middle[1], expected[1], rtol=0.01)
    # Only the lower one emits: what it gets is indirect, and what the upper one gets of the direct light too.
    lower, upper = (
        [solution.irradiance([t], [[0.0, 0.5]], light=light)[0, 0] for light in ("direct", "indirect")]
        for t in (0, 2)
    )
    direct = polygon_irradiance((0, 0, 0), (0, 0, 1), [(-1, -1, 1), (-1, 1, 1), (1, 1, 1), (1, -1, 1)], emission[0])
    assert lower[0] == 0
    assert lower[1] == pytest.approx((expected[0] - emission[0]) * np.pi / reflectance[0], rel=0.02)
    assert upper[0] == pytest.approx(direct, rel=0.01)
    assert upper[1] == pytest.approx(expected[1] * np.pi / reflectance[1] - direct, rel=0.02)


@pytest.mark.parametrize("method", ["progressive", "matrix", "monte-carlo"])
def test_direct_light_is_that_of_a_rectangle(method):
    corners = [(-0.4, -0.3, 1.2), (-0.4, 0.5, 1.2), (0.6, 0.5, 1.2), (0.6, -0.3, 1.2)]
    scene = room(
        part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), (0.5, 0.2, 0.9)),
        part(rectangle(corners[0], (0, 0.8, 0), (1, 0, 0)), 0.6, (3.0, 2.0, 1.0)),
    )
    solution = solve_radiosity(scene, method=method, size=0.3, receiver_points=1, unshot=1e-6, particles=2_000_000)
    elements = Elements.of_lattices(solution.divisions[:2].astype(np.int64))
    middles = elements.points(scene, np.full((1, 3), 1 / 3))[:, 0]
    expected = np.array([polygon_irradiance(p, (0, 0, 1), corners) for p in middles])[:, None] * [3.0, 2.0, 1.0]
    found = solution.elements[DIRECT, 0, : len(middles)]
    if method == "monte-carlo":
        error = found / expected - 1
        assert np.abs(error.mean()) < 0.005
        assert np.sqrt((error**2).mean()) < 0.05
    else:
        np.testing.assert_allclose(found, expected, rtol=2e-3)
    # The lamp gets from the floor alone, which reflects; and nothing arrives anywhere from behind.
    np.testing.assert_array_equal(solution.elements[DIRECT, 0, len(middles) :], 0)
    assert (solution.elements[INDIRECT, 0, len(middles) :] > 0).all()
    np.testing.assert_array_equal(solution.elements[:, 1], 0)


def test_one_shot_between_infinitely_many_is_seen_in_the_energy(lit_box):
    # In a closed room nothing gets lost: emitted = absorbed + unshot, after every step.
    solver = refinement(lit_box)
    t = solver.transport
    emitted = (t.sides.emission * t.areas[:, None]).sum(axis=0)
    arrived = []
    for _ in range(150):
        arrived.append(solver.step())
        areas = t.share[:, None] * t.areas[t.patch, None]
        absorbed = ((1 - t.elements.reflectance) * solver.irradiance.sum(axis=0) * areas).sum(axis=0)
        unshot = (solver.unshot * t.areas[:, None]).sum(axis=0)
        np.testing.assert_allclose(absorbed + unshot, emitted, rtol=0.01)
    np.testing.assert_allclose(arrived, 1.0, atol=0.1)
    assert np.mean(arrived) == pytest.approx(1.0, abs=0.01)


# The solvers agree.


def test_progressive_is_the_matrix_and_overshooting_too(lit_box):
    options = {"patches": 200, "receiver_points": 4}
    exact = solve_radiosity(lit_box, method="matrix", **options)
    steps = {}
    for overshoot in (False, True):
        found = solve_radiosity(lit_box, unshot=1e-5, overshoot=overshoot, **options)
        for here, there in zip(found.elements, exact.elements, strict=True):
            np.testing.assert_allclose(here, there, rtol=1e-3, atol=1e-4 * there.max())
        steps[overshoot] = found.statistics["steps"]
    assert steps[True] < steps[False]


def test_monte_carlo_is_progressive_within_its_error(lit_box):
    size = 0.5
    particles = solve_radiosity(lit_box, method="monte-carlo", size=size, particles=400_000, seed=3)
    again = solve_radiosity(lit_box, method="monte-carlo", size=size, particles=400_000, seed=3)
    np.testing.assert_array_equal(particles.elements, again.elements)
    exact = solve_radiosity(lit_box, size=size, unshot=1e-4, splits=1)
    # Point by point, but for the dark beneath the box.
    front, expected = (s.irradiance(*_middles(exact, 8)) for s in (particles, exact))
    seen = (expected > 0.02 * expected.max(axis=0)).all(axis=1)
    assert seen.mean() > 0.75
    np.testing.assert_allclose(front[seen].mean(axis=0), expected[seen].mean(axis=0), rtol=0.01)
    assert np.abs(front[seen] / expected[seen] - 1).mean() < 0.05
    # And what is direct of it: all in all, as the edges of shadows are as wide as elements.
    energy = [areas_of(lit_box, s) @ s.elements[DIRECT, 0] for s in (particles, exact)]
    np.testing.assert_allclose(*energy, rtol=0.01)
    assert 0 < particles.statistics["error_of_mean"] < 0.002


def _middles(solution, parts):
    """Triangles and barycentric coordinates of points that cover each triangle evenly."""
    places = sub_triangles(parts)[:, 1:]
    count = len(solution.divisions)
    return np.repeat(np.arange(count), len(places)), np.tile(places, (count, 1))


def test_monte_carlo_says_how_far_it_is_off():
    from glpath.radiosity.solvers.monte_carlo import Shooting
    from glpath.radiosity.solvers.particles import BATCH

    scene = load_scene("furnace", {"reflectance": 0.5, "subdivisions": 0})
    surface = surfaces(scene)
    shooting = Shooting(Mesh.uniform(scene, np.full(12, 2), surface), seed=1)
    shooting.shoot(32, lambda: None)
    assert shooting.particles == 32 * BATCH
    mesh, irradiance, _ = shooting.result(shooting.detail())
    error = np.sqrt(shooting.square[0]) / shooting.particles / mesh.areas
    off = (irradiance.sum(axis=0)[0] - 2 * np.pi) / error[:, None]
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    # Of equal numbers of hits; each survives by a half.
    assert shooting.hits == pytest.approx(2 * shooting.particles, rel=0.02)


def test_the_ambient_estimate_makes_an_early_end_right_in_the_mean(lit_box):
    exact, early, with_ambient = (
        solve_radiosity(lit_box, patches=100, receiver_points=1, **options)
        for options in ({"unshot": 1e-5}, {"unshot": 0.2}, {"unshot": 0.2, "ambient": True})
    )
    areas = areas_of(lit_box, exact)
    mean = [float((s.reflected(lit_box)[0] * areas[:, None]).sum()) for s in (exact, early, with_ambient)]
    assert mean[1] < 0.85 * mean[0]
    assert mean[2] == pytest.approx(mean[0], rel=0.05)
    np.testing.assert_array_equal(with_ambient.elements[DIRECT], early.elements[DIRECT])


# Sides.


def test_the_back_of_a_one_sided_plate_is_black_and_of_a_two_sided_not():
    def lit(two_sided):
        scene = room(
            part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), 0.5, two_sided=two_sided),
            part(rectangle((-1, -1, -1), (2, 0, 0), (0, 2, 0)), 0.0, 1.0),  # below it, shining up
            part(rectangle((-1, -1, 1), (0, 2, 0), (2, 0, 0)), 0.0, 2.0),  # above it, shining down
        )
        solution = solve_radiosity(scene, patches=64, unshot=1e-4)
        plate = slice(0, int(solution.divisions[0]) ** 2)
        return solution.reflected(scene)[:, plate]

    one, two = lit(False), lit(True)
    assert (one[1] == 0).all()
    assert (one[0] > 0).all()
    # The lamps are at the same distance on either side, one twice as bright.
    np.testing.assert_allclose(two[0], 2 * two[1], rtol=0.02)
    np.testing.assert_allclose(two[0], one[0], rtol=0.01)


def test_light_leaves_both_sides_of_a_lamp_that_emits_both_ways():
    lamp = rectangle((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
    walls = part(cuboid((-1, -1, -1), (1, 1, 1), inside=True), 0.5)
    one, two = (
        solve_radiosity(room(walls, part(lamp, 0.0, 1.0, emission_two_sided=both)), patches=100, unshot=1e-4)
        for both in (False, True)
    )
    triangles = room(walls, part(lamp)).triangles
    above = np.repeat(triangles.mean(axis=1)[:, 2] > 0.9, one.divisions**2)
    below = np.repeat(triangles.mean(axis=1)[:, 2] < -0.9, one.divisions**2)
    one, two = (solution.elements.sum(axis=0)[0] for solution in (one, two))
    assert one[below].mean() < 0.5 * one[above].mean()
    np.testing.assert_allclose(two[below].mean(), two[above].mean(), rtol=0.01)


# Meshes.


def test_the_mesh_has_about_as_many_patches_as_asked_for():
    scene = load_scene("cornell-box-36")
    surface = surfaces(scene)
    assert len(np.unique(surface)) == 18  # quads, and the sides of two boxes
    for count in (36, 210, 2000):
        size = size_for_count(scene, surface, count)
        found = int((divisions_of_size(scene, surface, size) ** 2).sum())
        assert 0.7 * count <= found <= count
    edges = np.linalg.norm(np.roll(scene.triangles, -1, axis=1) - scene.triangles, axis=2).max(axis=1)
    assert (edges / divisions_of_size(scene, surface, 0.3) <= 0.3 + 1e-9).all()


def test_patches_are_shared_out_by_size_where_a_small_object_has_most_triangles():
    """A ball of 5,120 triangles takes what one of 320 takes, and leaves the walls theirs."""
    walls = {}
    for subdivisions in (2, 4):
        scene = path_traceable(room_with_a_ball(subdivisions))
        surface = surfaces(scene)
        divisions = divisions_of_size(scene, surface, size_for_count(scene, surface, 500, by_size=True))
        walls[subdivisions] = int((divisions[:12] ** 2).sum())
        assert (divisions[12:] == 1).mean() > 0.95
    assert walls[4] == pytest.approx(walls[2], rel=0.1)
    assert 300 < walls[4] < 500
    # Nothing is smaller than a patch: it is the same.
    box = load_scene("cornell-box-36")
    sizes = [size_for_count(box, surfaces(box), 500, by_size=by_size) for by_size in (False, True)]
    assert sizes[0] == sizes[1]


def test_elements_of_a_split_cover_their_parent():
    scene = load_scene("cornell-box-36")
    mesh = Mesh.uniform(scene, np.full(36, 3), surfaces(scene))
    rng = np.random.default_rng(4)
    for _ in range(3):
        mesh = mesh.refine(rng.random(len(mesh.elements)) < 0.3)
    patch_areas = scene.areas[mesh.patches.triangle] / mesh.patches.n**2
    np.testing.assert_allclose(np.bincount(mesh.patch, mesh.areas), patch_areas, rtol=1e-12)
    corners = mesh.elements.points(scene, np.eye(3))
    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    np.testing.assert_allclose(0.5 * np.linalg.norm(normals, axis=1), mesh.areas, rtol=1e-9)
    assert (np.einsum("ij,ij->i", normals, scene.normals[mesh.elements.triangle]) > 0).all()
    # Elements lie in their patches: no corner is outside of the patch's triangle.
    places = mesh.elements.corners() / mesh.elements.n[:, None, None]
    patch = (mesh.patches.corners() / mesh.patches.n[:, None, None])[mesh.patch]
    assert (places.min(axis=1) >= patch.min(axis=1) - 1e-12).all()
    assert (places.max(axis=1) <= patch.max(axis=1) + 1e-12).all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_tears_where_small_elements_meet_large_ones(seed):
    # Triangles of uneven size, split at random: both sides of every edge have the same values along it.
    points = np.array([(0, 0), (4, 0), (4, 3), (0, 3), (1.2, 1.1), (3.1, 0.8)], float)
    faces = [(0, 1, 5), (0, 5, 4), (1, 2, 5), (5, 2, 4), (4, 2, 3), (0, 4, 3)]
    triangles = np.array([[(*points[i], 0.0) for i in face] for face in faces])
    scene = room(part(triangles, emission=1.0))
    rng = np.random.default_rng(seed)
    surface = surfaces(scene)
    assert len(np.unique(surface)) == 1
    mesh = Mesh.uniform(scene, divisions_of_size(scene, surface, 1.5), surface)
    for _ in range(3):
        mesh = mesh.refine(rng.random(len(mesh.elements)) < 0.25)
    values = rng.random((2, 2, len(mesh.elements), 3))
    divisions, elements, vertices, _ = resample(mesh, values)
    from glpath.radiosity.solution import RadiositySolution

    solution = RadiositySolution("", divisions, elements, vertices)
    along = np.linspace(0, 1, 101)
    edges = {}
    for t, face in enumerate(faces):
        for k in range(3):
            a, b = face[k], face[(k + 1) % 3]
            ends = np.array([(0, 0), (1, 0), (0, 1)], float)[[k, (k + 1) % 3]]
            places = ends[0] + along[:, None] * (ends[1] - ends[0])
            found = solution.irradiance(np.full(101, t), places, mode="smooth", light="indirect")
            edges.setdefault((min(a, b), max(a, b)), []).append(found if a < b else found[::-1])
    shared = [pair for pair in edges.values() if len(pair) == 2]
    assert len(shared) == 7
    for ours, theirs in shared:
        np.testing.assert_allclose(ours, theirs, atol=2e-6)
    # Inside a triangle the lookup has no steps either.
    places = np.column_stack([np.linspace(0, 0.6, 4001), np.full(4001, 0.3)])
    line = solution.irradiance(np.zeros(4001, int), places, mode="smooth", light="direct")
    assert np.abs(np.diff(line, axis=0)).max() < 0.02


def test_vertices_take_up_a_gradient_to_the_border():
    scene = room(part(rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), emission=1.0))
    mesh = Mesh.uniform(scene, np.full(2, 8), surfaces(scene))
    middles = mesh.elements.points(scene, np.full((1, 3), 1 / 3))[:, 0]
    slope = 1 + middles[:, [0, 0, 1]]
    _, _, vertices, _ = resample(mesh, np.stack([slope, slope]))
    from glpath.radiosity.mesh import lattice

    corners = scene.triangles
    b = lattice.vertex_barycentrics(8)
    places = np.concatenate([c[0] + b @ (c[1:] - c[0]) for c in corners])
    np.testing.assert_allclose(vertices[0], 1 + places[:, [0, 0, 1]], atol=0.04)


def test_adaptive_subdivision_goes_to_the_shadow_and_makes_it_right():
    # A floor, a small lamp, and a plate that throws a hard shadow.
    scene = room(
        part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), 0.5),
        part(rectangle((-0.1, -0.1, 2), (0, 0.2, 0), (0.2, 0, 0)), 0.0, 20.0),
        part(rectangle((-0.3, -0.3, 1), (0.6, 0, 0), (0, 0.6, 0)), 0.0),
    )
    coarse, adaptive, fine = (
        solve_radiosity(scene, size=0.6, unshot=1e-4, **options)
        for options in ({}, {"adaptive": 3, "threshold": 0.3}, {"splits": 4, "receiver_points": 1})
    )
    rng = np.random.default_rng(5)
    b = rng.random((4000, 2))
    b = np.where(b.sum(axis=1, keepdims=True) > 1, 1 - b, b)
    t = rng.integers(0, 2, 4000)
    expected, by_coarse, by_adaptive = (s.irradiance(t, b) for s in (fine, coarse, adaptive))
    off = [np.abs(found - expected).mean() / expected.mean() for found in (by_coarse, by_adaptive)]
    assert off[1] < 0.4 * off[0]
    assert coarse.statistics["elements"] < adaptive.statistics["elements"] < 0.5 * fine.statistics["elements"]


def test_splitting_elements_changes_nothing_in_a_furnace():
    solver = refinement(load_scene("furnace", {"subdivisions": 0, "reflectance": 0.5}), 48, points=1)
    solver.run(1e-6, 10_000, lambda share: None)
    t = solver.transport
    which = np.random.default_rng(0).random(len(t.mesh.elements)) < 0.4
    solver.irradiance = t.refine(which, solver.irradiance, solver.shot)
    np.testing.assert_allclose(solver.irradiance[:, t.elements.back == 0], np.pi, rtol=1e-5)
    # The columns that were kept are those that would be found anew.
    kept = t.column(5)
    fresh = Transport(t.mesh, FormFactorOptions(points=1), 1 << 30).column(5)
    np.testing.assert_allclose(kept, fresh, atol=1e-7)


def test_columns_are_forgotten_where_memory_is_short_and_found_again(lit_box):
    plenty = refinement(lit_box, 100, points=1)
    plenty.run(1e-3, 10_000, lambda share: None)
    surface = surfaces(lit_box)
    mesh = plenty.transport.mesh
    short = Refinement(
        Transport(Mesh.uniform(lit_box, _divisions(mesh), surface), FormFactorOptions(points=1), 9000)
    )
    short.run(1e-3, 10_000, lambda share: None)
    assert short.transport.statistics.rays > 1.5 * plenty.transport.statistics.rays
    np.testing.assert_allclose(short.irradiance, plenty.irradiance, rtol=1e-6)


def _divisions(mesh):
    found = np.ones(len(mesh.scene.triangles), np.int64)
    np.maximum.at(found, mesh.patches.triangle, mesh.patches.n)
    return found


# What cannot be solved.


def test_a_scene_without_light_is_refused(lit_box):
    dark = replace(lit_box, shapes=tuple(replace(s, emission=np.zeros(3)) for s in lit_box.shapes))
    with pytest.raises(SceneError, match=r"no shape with an emission.*\n.*emission = "):
        solve_radiosity(dark)


def test_a_reflectance_of_one_is_refused():
    with pytest.raises(SceneError, match=r"materials\.wall\.reflectance is \[1, 1, 1\], but must be below 1"):
        solve_radiosity(load_scene("furnace", {"reflectance": 1.0}))


def test_a_triangle_without_area_is_refused(lit_box):
    def flatten(triangles):
        triangles[1, 2] = triangles[1, 1]
        return triangles

    with pytest.raises(SceneError, match=r'1 triangles without area.*"part1": number 1 of its 12'):
        solve_radiosity(with_triangles(lit_box, "part1", flatten))


def test_what_the_path_tracer_does_not_know_is_refused():
    with pytest.raises(SceneError, match="cannot render"):
        solve_radiosity("three-spheres")


@pytest.mark.parametrize("options", [{"patches": 10**12}, {"size": 1e-7}, {"splits": 20}])
def test_a_mesh_that_does_not_fit_is_refused_before_it_is_made(lit_box, options):
    with pytest.raises(UsageError, match=r"would need about [\d.e+]+ GB of memory; there are"):
        solve_radiosity(lit_box, **options)


def test_watchdog_hears_of_a_matrix_while_it_is_solved(lit_box, monkeypatch):
    beats, heard = [], []
    exact = np.linalg.solve

    def solve(*given):
        before, until = len(beats), time.monotonic() + 1.0
        while len(beats) == before and time.monotonic() < until:
            time.sleep(0.001)
        heard.append(len(beats) > before)
        return exact(*given)

    monkeypatch.setattr(matrix, "_BEAT_INTERVAL", 0.01)
    monkeypatch.setattr(np.linalg, "solve", solve)
    monkeypatch.setattr(heartbeat, "listener", lambda paused: beats.append(1))
    solve_radiosity(lit_box, method="matrix", patches=12, receiver_points=1)
    assert heard == [True] * 3  # for each channel


def test_a_matrix_that_does_not_fit_is_refused(lit_box, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 100 << 20)
    with pytest.raises(UsageError, match=r"there are 104\.9 MB[\s\S]*progressive"):
        solve_radiosity(lit_box, method="matrix", patches=5000, receiver_points=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "hemicube"}, "allowed are progressive, matrix, monte-carlo"),
        ({"form_factors": "analytic"}, "allowed are polygon, disc"),
        ({"emitter_samples": 5}, "allowed are 1, 4, 9, 16, 25"),
        ({"receiver_points": 3}, "allowed are 1, 4, 9"),
        ({"receiver_points": 1_000_000}, "receiver_points: 1000000 where a whole number from 1 to 1024"),
        ({"splits": -1}, "whole number from 0"),
        ({"patches": 0}, "whole number from 1"),
        ({"patches": 10, "size": 1.0}, "contradict"),
        ({"size": 0.0}, "above 0"),
        ({"size": float("nan")}, "above 0"),
        ({"unshot": 1.0}, "below 1"),
        ({"particles": 0}, "whole number from 1"),
        ({"max_steps": 0}, "whole number from 1"),
        ({"method": "matrix", "adaptive": 1}, "progressive"),
    ],
)
def test_options_out_of_range_are_refused(lit_box, options, message):
    with pytest.raises(UsageError, match=message):
        solve_radiosity(lit_box, **options)


@pytest.mark.parametrize("method", ["progressive", "monte-carlo"])
def test_an_interrupt_keeps_what_was_solved(lit_box, method):
    seen = []

    def stop(progress):
        seen.append(progress)
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(RadiosityInterrupted) as caught:
        solve_radiosity(lit_box, method=method, patches=1000, particles=10**9, unshot=1e-7, on_progress=stop)
    solution = caught.value.solution
    assert solution is not None
    assert solution.elements.max() > 0
    assert solution.settings["size"] > 0
    assert seen[0].elements > 700
    assert seen[1].unshot <= seen[0].unshot


def test_an_interrupt_while_elements_are_split_keeps_those_from_before(lit_box, monkeypatch):
    def interrupted(self, *arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(Transport, "refine", interrupted)
    with pytest.raises(RadiosityInterrupted) as caught:
        solve_radiosity(lit_box, patches=100, adaptive=1, receiver_points=1)
    assert caught.value.solution.statistics["unshot"] < 0.001


def test_progress_ends_at_the_share_that_was_asked_for(lit_box):
    seen = []
    solution = solve_radiosity(lit_box, patches=100, unshot=0.01, on_progress=seen.append)
    assert seen[-1].unshot <= 0.01 < seen[0].unshot
    assert solution.statistics["unshot"] == pytest.approx(seen[-1].unshot)
    assert solve_radiosity(lit_box, patches=100, max_steps=7).statistics["steps"] == 7


def test_an_interrupt_does_not_wait_for_the_matrix_but_the_process_does():
    """A library that is in a call when its process ends may hang: OpenBLAS waits for its threads."""
    program = """
import signal, threading, time
from glpath.radiosity.solvers import matrix
from glpath.system.heartbeat import heartbeat
matrix._BEAT_INTERVAL = 0.01
heartbeat.listener = lambda paused: signal.raise_signal(signal.SIGINT)
try:
    matrix._run_with_beats(lambda: (time.sleep(0.5), print("the call has ended")))
except KeyboardInterrupt:
    print("interrupted")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("interrupted\nthe call has ended\n", 0), done.stderr
