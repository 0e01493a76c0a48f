"""Elements follow the light: the quadtree against sums and splits that are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.io import scene_from_dict
from glpath.radiosity.lookup import NEVER, lookup_table
from glpath.radiosity.mesh.interpolation import abrupt, interpolate, leaves, vertices_of_elements
from glpath.radiosity.mesh.mesh import Elements, Mesh, surfaces
from glpath.radiosity.mesh.quadtree import Detail, Quadtree
from glpath.scene import Scene, path_traceable


def square(*more: dict[str, object]) -> Scene:
    """A square of 2 x 2 on the ground, in two triangles; a lamp above it."""
    shapes = [
        {"type": "quad", "corners": [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], "material": "grey"},
        {
            "type": "quad",
            "corners": [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]],
            "emission": {"radiance": 1.0},
        },
        *more,
    ]
    camera = {"position": [0, 1, 4], "target": [0, 1, 0], "fov": 60}
    return path_traceable(
        scene_from_dict({"camera": camera, "materials": {"grey": {"reflectance": 0.5}}, "shapes": shapes})
    )


def test_parents_contain_their_parts() -> None:
    scene = square()
    tree = Quadtree(np.array([3, 1, 2, 2]), np.array([2, 3, 0, 1]))
    assert tree.height == 3
    for level, parent in enumerate(tree.parents):
        fine, coarse = tree.levels[level + 1], tree.levels[level]
        assert np.array_equal(np.unique(parent), np.arange(len(coarse)))
        assert np.array_equal(fine.triangle, coarse.triangle[parent])
        middles = fine.points(scene, np.full((1, 3), 1 / 3))[:, 0]
        corners = coarse.points(scene, np.eye(3))[parent]
        edges = corners[:, 1:] - corners[:, :1]
        b = np.stack(
            [np.linalg.lstsq(e.T, m - c[0], rcond=None)[0] for e, m, c in zip(edges, middles, corners, strict=True)]
        )
        assert (b > 0).all()
        assert (b.sum(axis=1) < 1).all()


def test_sums_keep_the_energy_on_every_level() -> None:
    tree = Quadtree(np.array([2, 1, 1, 1]), np.array([2, 1, 0, 0]))
    values = np.random.default_rng(1).random((2, 2, len(tree.levels[-1]), 3))
    levels = tree.sums(values)
    assert [level.shape[2] for level in levels] == [len(elements) for elements in tree.levels]
    for level in levels:
        np.testing.assert_allclose(level.sum(axis=2), values.sum(axis=2))


def step(tree: Quadtree, scene: Scene, edge: float, arrivals: int) -> Detail:
    """What is found if the irradiance is 10 left of x = edge, and 1 right of it, with Poisson noise."""
    elements = tree.levels[-1]
    points = elements.points(scene, np.full((1, 3), 1 / 3))[:, 0]
    areas = scene.areas[elements.triangle] / elements.n**2
    expected = np.where(points[:, 0] < edge, 10.0, 1.0) * areas
    counts = np.random.default_rng(2).poisson(arrivals * expected / expected.sum())
    each = expected.sum() / arrivals
    flux = np.stack([each * counts, 0.0 * counts])[..., None] * np.ones(3)
    square = np.stack([each**2 * counts, 0.0 * counts])
    return Detail.of(tree, flux, square, scene.areas, 0.25)


def test_elements_are_small_at_an_edge_and_large_elsewhere() -> None:
    scene = square()
    tree = Quadtree(np.array([2, 2, 1, 1]), np.array([3, 3, 0, 0]))
    detail = step(tree, scene, 0.3, 1_000_000)
    base = Mesh.uniform(scene, tree.coarse, surfaces(scene))
    mesh = detail.mesh(base)
    floor = mesh.elements.triangle < 2
    assert mesh.areas[floor].sum() == pytest.approx(4.0)
    corners = mesh.elements.points(scene, np.eye(3))[floor]
    crossed = (corners[..., 0].min(axis=1) < 0.3 - 1e-9) & (corners[..., 0].max(axis=1) > 0.3 + 1e-9)
    # An element may be crossed at a corner that has none of the middles of its parts.
    assert (mesh.elements.n[floor][crossed] >= 8).all()
    assert np.mean(mesh.elements.n[floor][crossed] == 16) > 0.6
    far = np.abs(corners[..., 0] - 0.3).min(axis=1) > 0.8
    assert (mesh.elements.n[floor][far] <= 4).all()


def test_noise_alone_splits_nothing() -> None:
    scene = square()
    tree = Quadtree(np.array([2, 2, 1, 1]), np.array([3, 3, 0, 0]))
    base = Mesh.uniform(scene, tree.coarse, surfaces(scene))
    for arrivals in (100, 3_000, 1_000_000):
        assert step(tree, scene, 5.0, arrivals).mesh(base) is base


def wall(x: float) -> dict[str, object]:
    """A black wall without thickness across the square, which keeps the light of the lamp on its left."""
    return {"type": "quad", "corners": [[x, 0, -1], [x, 0, 1], [x, 2, 1], [x, 2, -1]], "material": "black"}


def lit_on_the_left(x: float) -> Scene:
    shapes = [
        {"type": "quad", "corners": [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], "material": "grey"},
        {"type": "quad", "corners": [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]], "material": "grey"},
        {
            "type": "quad",
            "corners": [[-0.9, 1.9, -0.5], [-0.5, 1.9, -0.5], [-0.5, 1.9, 0.5], [-0.9, 1.9, 0.5]],
            "emission": {"radiance": 5.0},
        },
        wall(x),
    ]
    materials = {"grey": {"reflectance": 0.5}, "black": {"reflectance": 0.0}}
    camera = {"position": [0, 1, 4], "target": [0, 1, 0], "fov": 60}
    return path_traceable(scene_from_dict({"camera": camera, "materials": materials, "shapes": shapes}))


@pytest.mark.parametrize("x", [0.0, 0.13])
def test_light_does_not_leak_below_a_wall(x: float) -> None:
    """The wall stands on lines of the coarse elements, or between them. Its right side is in the dark."""
    scene = lit_on_the_left(x)
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=100, particles=1 << 18, adaptive=5)
    table = lookup_table(scene, solution, "interpolated", traced=False, in_gaps=True)
    elements = Elements.of_lattices(solution.divisions.astype(np.int64))
    corners = elements.points(scene, np.eye(3))
    floor = elements.triangle < 2
    dark = floor & (corners[..., 0].min(axis=1) >= x - 1e-9)
    straddling = floor & (corners[..., 0].min(axis=1) < x - 1e-9) & (corners[..., 0].max(axis=1) > x + 1e-9)
    light = table.corners[0, ..., :3].max(axis=(1, 2))
    lit = light[floor & ~dark & ~straddling].mean()
    assert lit > 0.1
    # Paths that end beside the wall continue, and the light of the left is not looked up on the right.
    beside = dark & (corners[..., 0].min(axis=1) <= x + 0.02)
    assert (table.min_distance[0, beside] == NEVER).all()
    assert light[dark & (table.min_distance[0] < NEVER)].max() < 0.05 * lit
    # Some are crossed at a corner alone.
    assert not straddling.any() or np.mean(table.min_distance[0, straddling] == NEVER) > 0.8


@pytest.mark.parametrize("x", [0.0, 0.13])
def test_interpolated_irradiance_is_dark_behind_a_wall(x: float) -> None:
    scene = lit_on_the_left(x)
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=100, particles=1 << 18, adaptive=5)
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(-0.9, 0.9, 500), np.zeros(500), rng.uniform(-0.9, 0.9, 500)])
    dark = places[:, 0] > x + 0.1
    lit = places[:, 0] < x - 0.1
    corners = scene.triangles[0]
    b = np.linalg.lstsq((corners[1:] - corners[0]).T, (places - corners[0]).T, rcond=None)[0].T
    outside = (b < 0).any(axis=1) | (b.sum(axis=1) > 1)
    other = scene.triangles[1]
    b[outside] = np.linalg.lstsq((other[1:] - other[0]).T, (places[outside] - other[0]).T, rcond=None)[0].T
    found = solution.irradiance(outside.astype(int), b).mean(axis=1)
    witness = glpath.irradiance(scene, places, [0.0, 1.0, 0.0], integrator="path", spp=256).values.mean(axis=1)
    assert np.abs(witness[dark]).max() < 1e-4 * witness[lit].mean()
    assert found[dark].max() < 0.02 * found[lit].mean()
    assert found[lit].mean() == pytest.approx(witness[lit].mean(), rel=0.02)


def test_interpolation_keeps_the_mean_of_each_element() -> None:
    rng = np.random.default_rng(3)
    divisions = np.array([4, 3])
    elements, vertices = rng.random((2, 25, 4)) ** 4, rng.random((2, 25, 4)) ** 4
    leaf = np.arange(25)
    elements[0, 7] = 0.0
    corners = interpolate(vertices_of_elements(divisions), leaf, vertices, elements)
    np.testing.assert_allclose(corners.mean(axis=2), elements)
    assert corners.min() >= -1e-12
    assert abrupt(vertices_of_elements(divisions), leaf, elements[..., 0])[0, 7]
    assert np.ptp(corners[0, 7]) == 0
    assert (np.ptp(corners, axis=2) > 0).any()
    # A large element, of which four are parts, keeps its mean as a whole.
    leaf = np.maximum(leaf - 3, 0)
    elements[:, :4] = elements[:, :1]
    corners = interpolate(vertices_of_elements(divisions), leaf, vertices, elements)
    np.testing.assert_allclose(corners[:, :4].mean(axis=(1, 2)), elements[:, 0])


def test_elements_below_a_solid_do_not_darken_their_neighbours() -> None:
    """Each part of the floor below a closed box has no light of its own."""
    corners = [[x, y, z] for y in (0.0, 0.2) for z in (-0.5, 0.5) for x in (-0.5, 0.5)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    scene = square({"type": "mesh", "vertices": corners, "faces": faces, "material": "grey"})
    options: Any = {"method": "monte-carlo", "size": 0.25, "particles": 1 << 18, "adaptive": 0}
    solution = glpath.solve_radiosity(scene, **options)
    middles = Elements.of_lattices(solution.divisions.astype(np.int64)).points(scene, np.full((1, 3), 1 / 3))[:, 0]
    light = solution.elements.sum(axis=0)[0].mean(axis=1)
    triangle = np.repeat(np.arange(len(solution.divisions)), solution.divisions**2)
    floor = triangle < 2
    at_edge = floor & (np.abs(middles[:, [0, 2]]).max(axis=1) < 0.5) & (np.abs(middles[:, 0]) > 0.4)
    assert light[at_edge].min() > 0.2 * light[floor].mean()
    beside = floor & (np.abs(middles[:, 2]) < 0.4) & (np.abs(middles[:, 0]) > 0.5) & (np.abs(middles[:, 0]) < 0.65)
    vertices = vertices_of_elements(solution.divisions.astype(np.int64))
    at_vertices = solution.vertices.sum(axis=0)[0].mean(axis=1)[vertices].mean(axis=1)
    assert set(triangle[beside]) == {0, 1}
    assert at_vertices[beside].mean() == pytest.approx(light[beside].mean(), rel=0.1)


def test_a_solution_keeps_its_leaves_in_a_file(tmp_path) -> None:
    scene = lit_on_the_left(0.13)
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=100, particles=1 << 16, adaptive=3)
    assert solution.leaf_size.max() > 1
    solution.save(tmp_path / "s.npz")
    again = glpath.RadiositySolution.load(tmp_path / "s.npz", scene)
    assert np.array_equal(again.leaf_size, solution.leaf_size)


def test_an_adaptive_solution_resumes_from_a_checkpoint_bit_for_bit(tmp_path) -> None:
    from glpath.radiosity.solvers.checkpoint import SolverCheckpoint

    scene = lit_on_the_left(0.13)
    options = {"method": "monte-carlo", "patches": 100, "particles": 1 << 17, "adaptive": 4}
    whole = glpath.solve_radiosity(scene, **options)
    path = tmp_path / "s.checkpoint.npz"
    interrupted = glpath.solve_radiosity(
        scene, time_limit=1e-9, checkpoint=SolverCheckpoint(path, seconds=1e-9), **options
    )
    assert interrupted.statistics["stop_rule"] == "time limit"
    resumed = glpath.solve_radiosity(scene, checkpoint=SolverCheckpoint(path, seconds=60), **options)
    assert np.array_equal(resumed.divisions, whole.divisions)
    assert np.array_equal(resumed.elements, whole.elements)


def test_undivided_elements_are_leaves_in_order() -> None:
    """A solver's element that is not divided has the number of its element in the lattices."""
    divisions = np.array([1, 3, 2, 4])
    count = int((divisions**2).sum())
    np.testing.assert_array_equal(leaves(divisions, np.ones(count, np.uint16)), np.arange(count))


def test_parts_of_a_large_element_have_its_number() -> None:
    """Parts lie on a finer lattice than the elements of the other triangle."""
    divisions = np.array([4, 8])
    elements = Elements.of_lattices(divisions)
    parts = Elements.of_lattices(np.array([2, 4])).split()
    size = np.where(elements.triangle == 0, 2, 1)
    number = leaves(divisions, size.astype(np.uint16))
    first = np.array([0, 16])[parts.triangle] + parts.index()
    for large in range(4):  # of the first triangle
        assert len(set(number[first[4 * large : 4 * large + 4]])) == 1
    assert len(set(number)) == 4 + 64
