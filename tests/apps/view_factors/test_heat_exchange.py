"""`ViewFactors.exchange` against closed forms, and the faces that files have beside those with an area."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import glpath
from glpath.apps.view_factors.heat_exchange import SIGMA
from glpath.apps.view_factors.result import ViewFactors
from glpath.errors import SceneWarning, UsageError
from glpath.scene.tessellate import box_mesh
from tests.support.command_line import run

CUBE = box_mesh((0, 0, 0), (1, 1, 1))
#: Floor to ceiling of a cube (Howell, C-11).
OPPOSITE = 0.199825


def known(matrix: list[list[float]], areas: list[float]) -> ViewFactors:
    return ViewFactors(sparse.csr_array(np.array(matrix)), np.array(areas), np.zeros(len(areas)))


def room() -> ViewFactors:
    """A cube whose inside its faces look at; rows are floor (y = 0), ceiling and walls, by name."""
    labels = ["wall" if abs(n[1]) < 0.5 else "ceiling" if n[1] > 0 else "floor" for n in _normals()]
    return glpath.view_factors((CUBE.vertices, CUBE.faces), groups=labels, flip=True, enforce=["closure"])


def _normals() -> np.ndarray:
    corners = CUBE.vertices[CUBE.faces]
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


@pytest.mark.parametrize("e1", [1.0, 0.8, 0.05])
@pytest.mark.parametrize("e2", [1.0, 0.3])
def test_concentric_spheres(e1: float, e2: float) -> None:
    a1, a2 = 1.0, 4.0
    found = known([[0, 1], [a1 / a2, 1 - a1 / a2]], [a1, a2]).exchange([e1, e2], [500.0, 300.0])
    expected = a1 * SIGMA * (500.0**4 - 300.0**4) / (1 / e1 + (a1 / a2) * (1 / e2 - 1))
    np.testing.assert_allclose(found.net_power, [expected, -expected], rtol=1e-10)


def test_wide_parallel_plates_and_a_shield_between_them() -> None:
    e1, e2, es = 0.8, 0.5, 0.1
    plates = known([[0, 1], [1, 0]], [1.0, 1.0]).exchange([e1, e2], [400.0, 300.0])
    across = SIGMA * (400.0**4 - 300.0**4)
    assert plates.net_flux[0] == pytest.approx(across / (1 / e1 + 1 / e2 - 1))
    # Gebhart's factor of two plates: what 2 absorbs of what 1 emits, after all reflections.
    assert plates.gebhart[0, 1] == pytest.approx(e2 / (1 - (1 - e1) * (1 - e2)))
    np.testing.assert_allclose(plates.gebhart.sum(axis=1), 1.0)
    # A shield has two sides, one temperature and no net flux in all; each side has half of the difference of T^4.
    two = known([[0, 1], [1, 0]], [1.0, 1.0])
    resistances = (1 / e1 + 1 / es - 1), (1 / es + 1 / e2 - 1)
    shield = (400.0**4 - (400.0**4 - 300.0**4) * resistances[0] / sum(resistances)) ** 0.25
    left, right = two.exchange([e1, es], [400.0, shield]), two.exchange([es, e2], [shield, 300.0])
    assert left.net_flux[0] == pytest.approx(across / sum(resistances))
    assert right.net_flux[0] == pytest.approx(left.net_flux[0])


def test_a_cube_with_insulated_walls() -> None:
    found = room()
    i, j, walls = (found.names.index(name) for name in ("floor", "ceiling", "wall"))
    temperature = np.zeros(3)
    temperature[[i, j, walls]] = 400.0, 300.0, np.nan
    done = found.exchange(1.0, temperature)
    # The walls carry on what they get: F12 + 1 / (1 / F1R + 1 / F2R), of which both are 1 - F12.
    through = OPPOSITE + 0.5 * (1 - OPPOSITE)
    expected = SIGMA * (400.0**4 - 300.0**4) * through
    np.testing.assert_allclose(done.net_power[[i, j, walls]], [expected, -expected, 0.0], rtol=1e-3, atol=1e-6)
    assert done.temperature[walls] == pytest.approx((0.5 * (400.0**4 + 300.0**4)) ** 0.25, rel=1e-3)


def test_all_at_one_temperature_exchange_nothing() -> None:
    done = room().exchange([0.2, 0.9, 0.5], 350.0)
    np.testing.assert_allclose(done.net_flux, 0.0, atol=1e-9)
    np.testing.assert_allclose(done.radiosity, SIGMA * 350.0**4)


def test_gebharts_factors_are_the_net_power() -> None:
    found = room()
    e, t = np.array([0.3, 0.7, 0.5]), np.array([300.0, 350.0, 450.0])
    done = found.exchange(e, t)
    emitted = e * found.areas * SIGMA * t**4
    np.testing.assert_allclose(emitted - done.gebhart.T @ emitted, done.net_power, rtol=1e-9, atol=1e-9)


def test_a_plate_under_the_sky_loses_what_the_sky_does_not_send() -> None:
    plate = known([[0.0]], [2.0]).exchange(0.9, 300.0, surroundings=250.0)
    assert plate.net_power[0] == pytest.approx(2.0 * 0.9 * SIGMA * (300.0**4 - 250.0**4))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.5, 1.2], 300.0), r"emissivity\[1\] is 1.2, but must be between 0 and 1"),
        (([0.5], 300.0), "one number, or 2"),
        ((0.5, [300.0, -1.0]), r"temperature\[1\] is -1"),
        ((0.5, np.nan), "no face emits"),
        ((0.0, 300.0), "no face emits"),
        ((0.5, 300.0, -3.0), "surroundings is -3"),
        ((0.5, 300.0, 1e308), r"surroundings is 1e\+308, but must be 0 to 1e\+60 K"),
        ((0.5, 300.0, np.nan), "surroundings is nan"),
        ((0.5, [300.0, 1e308]), r"temperature\[1\] is 1e\+308"),
    ],
)
def test_mistakes_are_explained(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        known([[0, 1], [1, 0]], [1.0, 1.0]).exchange(*arguments)  # type: ignore[arg-type]


def test_an_open_scene_needs_its_surroundings() -> None:
    with pytest.raises(UsageError, match="not a closed room"):
        known([[0.0, 0.2], [0.2, 0.0]], [1.0, 1.0]).exchange(0.5, 300.0)


def test_each_room_needs_a_face_that_emits() -> None:
    # Two pairs of plates that see each other; a face without an area sees nothing.
    pairs = [[0, 1, 0, 0, 0], [1, 0, 0, 0, 0], [0, 0, 0, 1, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 0]]
    rooms = known(pairs, [1.0, 1.0, 1.0, 1.0, 0.0])
    temperature = [300.0, np.nan, np.nan, np.nan, 300.0]
    with pytest.raises(UsageError, match="no face emits in the room of row 2:"):
        rooms.exchange(0.5, temperature)
    with pytest.raises(UsageError, match="no face emits in the room of row 2:"):
        rooms.exchange(0.5, temperature, surroundings=280.0)
    with pytest.raises(UsageError, match="no face emits in the room of row 0:"):
        rooms.exchange(0.5, [np.nan] * 4 + [300.0])
    # Faces without a net flux have the temperature of the only body that emits to them.
    temperature[2] = 400.0
    assert rooms.exchange(0.5, temperature).temperature[:4] == pytest.approx([300.0, 300.0, 400.0, 400.0])
    opened = known([[0, 0.9], [0.9, 0]], [1.0, 1.0]).exchange(0.5, np.nan, surroundings=280.0)
    assert opened.temperature == pytest.approx([280.0, 280.0])


# Faces without an area


def test_faces_without_area_are_rows_of_zeros(tmp_path: Path) -> None:
    flat = np.array([[0, 0, 0], [3, 3, 3]], np.int32)
    faces = np.insert(CUBE.faces, 4, flat[0], axis=0)
    faces = np.concatenate([faces, flat[1:]])
    with pytest.warns(SceneWarning, match=r"2 of 14 faces have no area \(4, 13\)"):
        found = glpath.view_factors((CUBE.vertices, faces), flip=True)
    whole = glpath.view_factors((CUBE.vertices, CUBE.faces), flip=True)
    dense = found.matrix.toarray()
    assert dense.shape == (14, 14)
    assert not dense[[4, 13]].any()
    assert not dense[:, [4, 13]].any()
    others = np.delete(np.arange(14), [4, 13])
    np.testing.assert_array_equal(dense[np.ix_(others, others)], whole.matrix.toarray())
    assert (found.areas[4], found.sky[4], found.error[13]) == (0.0, 0.0, 0.0)
    assert found.closure_error < 1e-3
    closed = found.enforced(closure=True)
    np.testing.assert_allclose(closed.row_sums[others], 1.0)
    assert not closed.row_sums[[4, 13]].any()
    found.save(tmp_path / "f.npz")
    assert (ViewFactors.load(tmp_path / "f.npz").matrix != found.matrix).nnz == 0
    done = found.exchange(0.5, 300.0)
    assert done.net_flux[others] == pytest.approx(np.zeros(12), abs=1e-2)


def test_rows_have_the_numbers_of_a_file(tmp_path: Path) -> None:
    """An STL as meshers write it, one triangle of which has lost its area."""
    corners = CUBE.vertices[CUBE.faces][:, ::-1].copy()
    corners[3] = corners[3, 0]
    text = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corner) for corner in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    )
    (tmp_path / "city.stl").write_text(f"solid it\n{text}endsolid it\n")
    with pytest.warns(SceneWarning, match=r"1 of 12 faces have no area \(3\)"):
        found = glpath.view_factors(tmp_path / "city.stl")
    assert len(found) == 12
    np.testing.assert_array_equal(np.flatnonzero(found.areas == 0), [3])


def test_facets_of_an_stl_keep_the_files_numbers(tmp_path: Path) -> None:
    """On the command line, of the file as it is: a facet in a line and one in a point are rows of zeros."""
    corners = CUBE.vertices[CUBE.faces[:, ::-1]]
    line = np.array([[[0, 0, 0], [0.5, 0, 0], [1, 0, 0]]])
    facets = np.concatenate([corners[:4], line, corners[4:], np.ones((1, 3, 3))]).astype("<f4")
    records = np.zeros(len(facets), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = facets
    path = tmp_path / "room.stl"
    path.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + records.tobytes())
    result = run("viewfactors", path, "-o", tmp_path / "f.npz")
    assert result.exit_code == 0, result.output
    assert "2 of 14 faces have no area (4, 13)" in result.output
    found = ViewFactors.load(tmp_path / "f.npz")
    dense = found.matrix.toarray()
    assert dense.shape == (14, 14)
    assert np.flatnonzero(~dense.any(axis=1)).tolist() == [4, 13]
    np.testing.assert_allclose(np.delete(found.areas, [4, 13]), 0.5)
    assert dense[5, 6] == 0  # the other half of its wall, four facets and a line before it
    np.testing.assert_allclose(np.delete(found.row_sums, [4, 13]), 1.0, atol=1e-3)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")  # of backs that are seen
def test_rows_of_an_obj_are_in_the_order_of_its_materials(tmp_path: Path) -> None:
    corners = [f"v {x} {y} {z}" for x, y, z in ((0, 0, 0), (3, 0, 0), (0, 2, 0), (0, 0, 1))]
    path = tmp_path / "a.obj"
    path.write_text(
        "\n".join([*corners, "usemtl red", "f 1 2 3", "usemtl blue", "f 1 2 4", "usemtl red", "f 2 3 4"])
    )
    found = glpath.view_factors(path)
    np.testing.assert_allclose(found.areas, [3.0, 3.5, 1.5])
    assert run("viewfactors", path, "-o", tmp_path / "f.npz").exit_code == 0
    np.testing.assert_array_equal(ViewFactors.load(tmp_path / "f.npz").areas, found.areas)


def test_no_rows_exchange_nothing() -> None:
    found = ViewFactors(sparse.csr_array((0, 0)), np.zeros(0), np.zeros(0)).exchange(0.5, 300.0)
    assert found.net_power.sum() == 0
    assert repr(found) == "<RadiativeExchange of no faces>"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"matrix": np.eye(2)}, "matrix: .* sparse matrix"),
        ({"matrix": sparse.csr_array((2, 3))}, r"matrix: of shape \(2, 3\) where \(2, 2\)"),
        ({"matrix": sparse.csr_array([[0.0, np.nan], [1.0, 0.0]])}, r"matrix\[0, 1\]: nan"),
        ({"matrix": sparse.csr_array([[0.0, 1.0], [-1.0, 0.0]])}, r"matrix\[1, 0\]: -1 where"),
        ({"matrix": sparse.csr_array([[0.0, 1e30], [1.0, 0.0]])}, r"matrix\[0, 1\]: 1e\+30"),
        ({"matrix": sparse.csr_array([[0.0, 1j], [1.0, 0.0]])}, "matrix: of type complex128"),
        ({"areas": [1.0, -1.0]}, r"areas\[1\]: -1"),
        ({"areas": [1.0, np.inf]}, r"areas\[1\]: inf"),
        ({"areas": "x"}, "areas: 'x'"),
        ({"error": np.zeros(3)}, r"error: of shape \(3,\) where \(2,\)"),
        ({"error": None}, "error: None"),
        ({"backs": [0.0, np.nan]}, r"backs\[1\]: nan"),
        ({"backs_error": [[0.0, 0.0]]}, r"backs_error: of shape \(1, 2\)"),
        ({"centroids": np.zeros(2)}, r"centroids: of shape \(2,\) where \(2, 3\)"),
        ({"normals": np.full((2, 3), np.inf)}, r"normals\[0, 0\]: inf"),
        ({"names": ("a",)}, "names: 1 where one for each of 2 rows"),
        ({"names": "ab"}, "names: 'ab'"),
        ({"statistics": 3}, "statistics: 3"),
    ],
)
def test_view_factors_refuse_wrong_fields(values: dict[str, Any], words: str) -> None:
    right = {"matrix": sparse.csr_array([[0.0, 1.0], [1.0, 0.0]]), "areas": np.ones(2), "error": np.zeros(2)}
    assert ViewFactors(**right).sky.tolist() == [0.0, 0.0]
    with pytest.raises(UsageError, match=words):
        ViewFactors(**{**right, **values})
