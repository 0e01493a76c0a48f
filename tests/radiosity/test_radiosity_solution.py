"""A radiosity solution as data: its lattice, the lookup, and the way to a file and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glpath import GlpathError, RadiositySolution, SceneError, UsageError, load_scene
from glpath.radiosity.mesh import lattice
from glpath.scene import path_traceable
from glpath.scene.geometry import Shapes

PARTS = np.array([0.25, 0.75])[:, None, None, None]


def solution_of(scene, divisions, front, back=lambda p: 0 * p):
    """A solution whose irradiance is a function of the position: a quarter of it direct."""
    triangles = path_traceable(scene)
    vertices, elements = [], []
    for corners, n in zip(triangles.triangles, divisions, strict=True):
        b = lattice.vertex_barycentrics(int(n))
        points = corners[0] + b @ (corners[1:] - corners[0])
        vertices.append(points)
        elements.append(points[lattice.element_vertices(int(n))].mean(axis=1))
    at_vertices, at_elements = np.concatenate(vertices), np.concatenate(elements)
    return RadiositySolution(
        triangles.digest(camera=False),
        np.asarray(divisions, np.int32),
        PARTS * np.stack([front(at_elements), back(at_elements)]),
        PARTS * np.stack([front(at_vertices), back(at_vertices)]),
        "made up",
        {"size": 0.5},
        {"steps": 3},
    )


def linear(points):
    return 5 + points @ np.array([[1.0, 0.2, 0.0], [0.5, -1.0, 0.3], [0.1, 0.4, -2.0]])


@pytest.fixture(scope="module")
def box():
    return load_scene("cornell-box-36")


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_the_lattice_counts_every_vertex_and_element_once(n):
    i, j = np.array([(i, j) for j in range(n + 1) for i in range(n + 1 - j)]).T
    assert lattice.vertex_index(n, i, j).tolist() == list(range(int(lattice.vertex_count(n))))
    cells = [(i, j, u) for j in range(n) for i in range(n - j) for u in (0, 1) if i + j + u < n]
    i, j, u = np.array(cells).T
    assert lattice.element_index(n, i, j, u).tolist() == list(range(int(lattice.element_count(n))))
    # The elements are alike, and together the triangle.
    corners = lattice.vertex_barycentrics(n)[lattice.element_vertices(n)]
    edges = corners[:, 1:] - corners[:, :1]
    np.testing.assert_allclose(np.linalg.det(edges), 1 / n**2, rtol=1e-12)


@pytest.mark.parametrize("divisions", [[], [2], [3, 1, 3, 2, 1]])
def test_tables_of_all_lattices_are_those_of_each_in_turn(divisions):
    found = lattice.of_all(np.array(divisions, np.int64), lattice.element_vertices)
    assert found.tolist() == [row for n in divisions for row in lattice.element_vertices(n).tolist()]


def test_vtk_of_a_georeferenced_scene_has_its_coordinates(box):
    away = np.array([500_000.0, 5_800_000.0, 30.0])
    shift = np.concatenate([np.zeros((3, 3)), away[:, None]], axis=1)
    shapes = Shapes(replace(s, world_from_object=s.world_from_object + shift) for s in box.shapes)
    moved = replace(box, shapes=shapes)
    points = solution_of(moved, [1] * len(path_traceable(moved).triangles), linear).to_vtk(moved).points
    assert points.min(axis=0) == pytest.approx(box.bounds[0] + away, abs=1e-6)
    assert points.max(axis=0) == pytest.approx(box.bounds[1] + away, abs=1e-6)


@given(
    st.integers(1, 40),
    st.floats(0, 1),
    st.floats(0, 1),
)
def test_a_point_lies_in_the_element_that_is_found(n, u, v):
    b1, b2 = (1 - u, 1 - v) if u + v > 1 else (u, v)
    i, j, upper, _, _ = (a[0] for a in lattice.locate([n], [b1], [b2]))
    corners = lattice.vertex_barycentrics(n)[lattice.element_vertices(n)[lattice.element_index(n, i, j, upper)]]
    weights = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [b1, b2, 1])
    assert weights.min() > -1e-9 * n


def test_interpolation_repeats_a_linear_function_on_both_sides(box):
    scene = path_traceable(box)
    rng = np.random.default_rng(1)
    solution = solution_of(box, rng.integers(1, 9, len(scene.triangles)), linear, lambda p: 2 * linear(p))
    t = rng.integers(0, len(scene.triangles), 2000)
    b = rng.random((2000, 2))
    b = np.where(b.sum(axis=1, keepdims=True) > 1, 1 - b, b)
    corners = scene.triangles[t]
    points = corners[:, 0] + np.einsum("pk,pkj->pj", b, corners[:, 1:] - corners[:, :1])
    np.testing.assert_allclose(solution.irradiance(t, b), linear(points), rtol=1e-5)
    np.testing.assert_allclose(solution.irradiance(t, b, 1), 2 * linear(points), rtol=1e-5)
    for mode in ("interpolated", "constant"):
        both = solution.irradiance(t, b, mode=mode)
        for light, share in (("direct", 0.25), ("indirect", 0.75)):
            found = solution.irradiance(t, b, mode=mode, light=light)
            np.testing.assert_allclose(found, share * both, rtol=1e-6)
    # What is reflected depends on the surface, and on the side that is seen.
    materials = [scene.materials[scene.shapes[s].material] for s in scene.triangle_shape[t]]
    back = np.arange(2000) % 2
    rho = np.array([m.reflectance * (m.two_sided or side == 0) for m, side in zip(materials, back, strict=True)])
    np.testing.assert_allclose(
        solution.lookup(box, t, b, back), rho * (1 + back[:, None]) * linear(points), rtol=1e-5, atol=1e-6
    )
    # Constant is the value at the element's middle, which is at most an edge away.
    assert np.abs(solution.irradiance(t, b, mode="constant") - linear(points)).max() < 6
    middles = solution.irradiance([0], [[1 / 3, 1 / 3]], mode="constant") if solution.divisions[0] == 1 else None
    assert middles is None or np.allclose(middles, linear(scene.triangles[0].mean(axis=0)), rtol=1e-5)


def test_a_solution_comes_back_from_its_file(box, tmp_path):
    solution = solution_of(box, np.full(36, 2), linear)
    solution.save(tmp_path / "s.npz")
    again = RadiositySolution.load(tmp_path / "s.npz", box)
    for name in ("divisions", "elements", "vertices"):
        np.testing.assert_array_equal(getattr(again, name), getattr(solution, name))
    assert (again.method, again.settings, again.statistics) == ("made up", {"size": 0.5}, {"steps": 3})
    assert [p.name for p in tmp_path.iterdir()] == ["s.npz"]


def test_another_camera_is_no_other_scene_but_another_material_is(box):
    solution = solution_of(box, np.full(36, 1), linear)
    solution.check_scene(box.with_camera(fov=20.0))
    materials = (replace(box.materials[0], reflectance=np.full(3, 0.1)), *box.materials[1:])
    with pytest.raises(SceneError, match=r"another scene.*\n.*Solve\n?.*anew"):
        solution.check_scene(replace(box, materials=materials))


def test_what_is_no_solution_is_refused(box, tmp_path):
    with pytest.raises(UsageError, match=r"\.npz"):
        solution_of(box, np.full(36, 1), linear).save(tmp_path / "s.png")
    with pytest.raises(GlpathError, match="no such file"):
        RadiositySolution.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(GlpathError, match="cannot be read"):
        RadiositySolution.load(tmp_path / "text.npz")
    np.savez(tmp_path / "film.npz", radiance=np.zeros((2, 2, 3)))
    with pytest.raises(GlpathError, match="not a radiosity solution"):
        RadiositySolution.load(tmp_path / "film.npz")
    np.savez(tmp_path / "new.npz", radiosity_format=99)
    with pytest.raises(GlpathError, match="format 99"):
        RadiositySolution.load(tmp_path / "new.npz")
    np.savez(tmp_path / "old.npz", radiosity_format=1, elements=np.zeros((2, 36, 3)))
    with pytest.raises(
        GlpathError, match=r"format 1, which holds what surfaces reflect[\s\S]*Solve the scene anew"
    ):
        RadiositySolution.load(tmp_path / "old.npz")
    made = dict(np.load(_saved(box, tmp_path)))
    np.savez(tmp_path / "short.npz", **made | {"elements": made["elements"][:, :, 1:]})
    with pytest.raises(GlpathError, match="divisions make it"):
        RadiositySolution.load(tmp_path / "short.npz")
    np.savez(tmp_path / "nan.npz", **made | {"vertices": made["vertices"] * np.nan})
    with pytest.raises(GlpathError, match="not finite"):
        RadiositySolution.load(tmp_path / "nan.npz")


def _saved(box, folder):
    solution_of(box, np.full(36, 2), linear).save(folder / "made.npz")
    return folder / "made.npz"


def test_lookup_says_what_it_cannot_do(box):
    solution = solution_of(box, np.full(36, 1), linear)
    with pytest.raises(UsageError, match="triangles 36, but whole numbers from 0 to 35"):
        solution.irradiance([36], [[0, 0]])
    with pytest.raises(UsageError, match="allowed are interpolated, constant"):
        solution.lookup(box, [0], [[0, 0]], mode="nearest")
    with pytest.raises(UsageError, match="allowed are both, direct, indirect"):
        solution.irradiance([0], [[0, 0]], light="ambient")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.nan, [[0.3, 0.3]]), "triangles nan"),
        ((2**63, [[0.3, 0.3]]), "triangles 9223372036854775808"),
        ((-1, [[0.3, 0.3]]), "triangles -1"),
        ((1.5, [[0.3, 0.3]]), "triangles 1.5"),
        (([[0, 1]], [[0.3, 0.3], [0.1, 0.1]]), "triangle of shape"),
        ((0, 0), "barycentric of shape"),
        ((0, [[np.nan, 0]]), "barycentric of shape"),
        (([0, 1, 2], [[0.3, 0.3], [0.1, 0.1]]), "barycentric of shape"),
        ((0, [[0.3, 0.3]], 10**6), "back 1000000"),
        ((0, [[0.3, 0.3]], -1), "back -1"),
        ((0, [[0.3, 0.3]], [0, 1]), "back of shape"),
    ],
)
def test_points_that_do_not_exist_are_refused(box, arguments, message):
    divisions = np.ones(len(path_traceable(box).triangles), np.int32)
    solution = solution_of(box, divisions, linear)
    with pytest.raises(UsageError, match=message):
        solution.irradiance(*arguments)
    with pytest.raises(UsageError, match=message):
        solution.lookup(box, *arguments)


def test_scene_with_another_number_of_triangles_is_refused(box):
    divisions = np.ones(len(path_traceable(box).triangles), np.int32)
    solution = solution_of(box, divisions, linear)
    other = box.add({"type": "sphere", "center": [0, 0, 0.5], "radius": 0.2})
    with pytest.raises(SceneError, match="another scene"):
        solution.lookup(other, 0, [[0.3, 0.3]])
    with pytest.raises(SceneError, match="another scene"):
        solution.reflected(other)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"scene_hash": 5}, "scene_hash is 5"),
        ({"divisions": None}, "divisions must be"),
        ({"divisions": [np.nan]}, "divisions must be"),
        ({"divisions": [1.5]}, "divisions must be"),
        ({"elements": "x"}, "could not convert"),
        ({"vertices": [[1, 2], [3]]}, "inhomogeneous"),
        ({"elements": -np.ones((2, 2, 1, 3))}, "elements holds values that are negative"),
        ({"settings": 5}, "not iterable"),
        ({"statistics": {"a": object()}}, "not JSON serializable"),
        ({"leaf_size": 5}, "has no len"),
        ({"leaf_size": [0]}, "leaf_size must be"),
    ],
)
def test_solution_of_wrong_arrays_is_refused(wrong, message):
    fields = {
        "scene_hash": "",
        "divisions": [1],
        "elements": np.zeros((2, 2, 1, 3)),
        "vertices": np.zeros((2, 2, 3, 3)),
    }
    assert RadiositySolution(**fields).element_count == 1
    with pytest.raises(UsageError, match=message):
        RadiositySolution(**{**fields, **wrong})
