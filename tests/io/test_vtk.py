"""Values on faces and points as VTK's files, read back by their own rules, and data frames of results."""

from __future__ import annotations

import base64
import struct
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import glpath
from glpath.errors import GlpathError, UsageError
from glpath.io.vtk import VtkMesh, points_with_values
from glpath.scene.tessellate import box_mesh

TYPES = {"Float64": "<f8", "Float32": "<f4", "Int64": "<i8", "Int32": "<i4", "UInt8": "u1"}
CUBE = box_mesh((0, 0, 0), (1, 1, 1))
#: Of its inside.
ROOM = {"faces": (CUBE.vertices, CUBE.faces), "groups": [f"wall {i // 2}" for i in range(12)], "flip": True}
DESK = np.array([[x, 0.0, z] for z in (-0.5, 0.5) for x in (-0.5, 0.0, 0.5)])


def arrays(path: Path) -> dict[str, Any]:
    """All arrays of a file by section and name, and the sizes that it announces."""
    root = ElementTree.parse(path).getroot()
    (grid,) = root
    (piece,) = grid
    found: dict[str, Any] = {"type": root.attrib["type"], **piece.attrib}
    for section in piece:
        for each in section:
            content = base64.b64decode(each.text or "")
            (size,) = struct.unpack("<Q", content[:8])
            assert size == len(content) - 8
            values = np.frombuffer(content[8:], TYPES[each.attrib["type"]])
            columns = int(each.attrib.get("NumberOfComponents", 1))
            found[f"{section.tag}/{each.attrib['Name']}"] = values.reshape(-1, columns) if columns > 1 else values
    return found


@pytest.mark.parametrize("suffix", [".vtp", ".vtu"])
def test_a_mesh_is_written_as_it_is(suffix: str, tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0.0]], float)
    mesh = VtkMesh(points, [[0, 1, 2, 3], [1, 4, 2]], {"flux & <more>": np.array([1.5, -2.0])}, {"rgb": points})
    mesh.save(tmp_path / f"a{suffix}")
    found = arrays(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(found["Points/Points"], points)
    cells = "Cells" if suffix == ".vtu" else "Polys"
    np.testing.assert_array_equal(found[f"{cells}/connectivity"], [0, 1, 2, 3, 1, 4, 2])
    np.testing.assert_array_equal(found[f"{cells}/offsets"], [4, 7])
    np.testing.assert_array_equal(found["CellData/flux & <more>"], [1.5, -2.0])
    np.testing.assert_array_equal(found["PointData/rgb"], points)
    if suffix == ".vtu":
        np.testing.assert_array_equal(found["Cells/types"], [9, 5])
        assert (found["type"], found["NumberOfCells"]) == ("UnstructuredGrid", "2")
    else:
        assert (found["type"], found["NumberOfPolys"], found["NumberOfPoints"]) == ("PolyData", "2", "5")


def test_view_factors_are_on_their_faces(tmp_path: Path) -> None:
    found = glpath.view_factors(**ROOM)
    flux = found.exchange(0.5, [300.0, 310.0, 320.0, 330.0, 340.0, 350.0]).net_flux
    mesh = found.to_vtk(**ROOM, values={"net_flux": flux})
    mesh.save(tmp_path / "a.vtp")
    read = arrays(tmp_path / "a.vtp")
    rows = read["CellData/row"]
    assert len(rows) == 12
    np.testing.assert_array_equal(read["CellData/net_flux"], flux[rows])
    np.testing.assert_array_equal(read["CellData/sky"], found.sky[rows])
    with pytest.raises(UsageError, match="Give the faces and groups"):
        found.to_vtk(CUBE)
    with pytest.raises(UsageError, match="net_flux of shape"):
        found.to_vtk(**ROOM, values={"net_flux": flux[:3]})
    with pytest.raises(UsageError, match=r"to_vtk: net_flux is .* where an array of real numbers is needed"):
        found.to_vtk(**ROOM, values={"net_flux": [[1], [1, 2]]})


def test_a_radiosity_solution_is_on_its_elements(tmp_path: Path) -> None:
    scene = glpath.load_scene("cornell-box-36")
    solution = glpath.solve_radiosity(scene, patches=60)
    mesh = solution.to_vtk(scene)
    mesh.save(tmp_path / "a.vtu")
    read = arrays(tmp_path / "a.vtu")
    assert len(read["CellData/front"]) == solution.element_count
    np.testing.assert_allclose(read["CellData/front"], solution.elements.sum(axis=0)[0])
    # The triangles of all elements have the areas of the scene's.
    corners = read["Points/Points"][read["Cells/connectivity"].reshape(-1, 3)]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert areas.sum() == pytest.approx(scene.areas.sum())


def test_irradiance_is_on_its_points(tmp_path: Path) -> None:
    found = glpath.irradiance("cornell-box", DESK, [0.0, 1.0, 0.0], spp=16)
    found.to_vtk(DESK).save(tmp_path / "a.vtp")
    read = arrays(tmp_path / "a.vtp")
    np.testing.assert_array_equal(read["PointData/irradiance"], found.values)
    np.testing.assert_array_equal(read["Verts/connectivity"], np.arange(6))
    found.to_vtk(DESK, [[0, 1, 4, 3], [1, 2, 5, 4]]).save(tmp_path / "b.vtp")
    assert len(arrays(tmp_path / "b.vtp")["Polys/offsets"]) == 2
    with pytest.raises(UsageError, match=r"where \(6, 3\), the number of measured points"):
        found.to_vtk(DESK[:4])


def test_mistakes_are_explained(tmp_path: Path) -> None:
    mesh = points_with_values(DESK, {})
    with pytest.raises(UsageError, match=r"written as .vtp or .vtu"):
        mesh.save(tmp_path / "a.vtk")
    with pytest.raises(UsageError, match="there are 1 cells"):
        VtkMesh(DESK, [[0, 1, 2]], {"a": np.zeros(2)})


def test_names_in_any_language_are_written(tmp_path: Path) -> None:
    name = "Beleuchtungsstärke 照度"
    points_with_values(DESK, {name: np.arange(6.0)}).save(tmp_path / "a.vtp")
    np.testing.assert_array_equal(arrays(tmp_path / "a.vtp")[f"PointData/{name}"], np.arange(6.0))


@pytest.mark.parametrize(
    ("polygons", "values", "words"),
    [
        ([[0, 999]], {}, r"polygons\[0\]: names point 999, but there are 6 points"),
        ([[0, 1], [2, 3, -1]], {}, r"polygons\[1\]: names point -1"),
        ([[0, 1], []], {}, "polygons: one has no points"),
        ([1, 2], {}, r"polygons: \[1, 2\] where lists of numbers of points"),
        ([[0, 1.5]], {}, "lists of numbers of points"),
        ([[0, np.nan]], {}, "lists of numbers of points"),
        ([["a"]], {}, "lists of numbers of points"),
        ([[0, 1]], {"a\x01": np.zeros(6)}, "control characters"),
        ([[0, 1]], {"a\ud800": np.zeros(6)}, "control characters"),
        ([[0, 1]], {3: np.zeros(6)}, "3: is no name of values"),
        ([[0, 1]], {"a": ["x"] * 6}, "a: .* an array of real numbers"),
        ([[0, 1]], {"a": np.zeros(6, complex)}, "an array of real numbers"),
        ([[0, 1]], {"a": [[0], [1, 2]] * 3}, "an array of real numbers"),
    ],
)
def test_a_mesh_refuses_what_no_reader_takes(polygons: Any, values: Any, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        VtkMesh(DESK, polygons, point_data=values)


def test_a_missing_package_is_named_with_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    for name in ("pandas", "xarray", "pyvista"):
        monkeypatch.setitem(sys.modules, name, None)
    found = glpath.view_factors((np.eye(3), [[0, 1, 2]]))
    for call, extra in (
        (found.to_pandas, "frames"),
        (found.to_xarray, "frames"),
        (points_with_values(DESK, {}).to_pyvista, "mesh"),
    ):
        with pytest.raises(GlpathError, match=rf'pip install "glpath\[{extra}\]"'):
            call()


def test_view_factors_as_data_frames() -> None:
    pytest.importorskip("pandas", reason="needs the extra frames")
    found = glpath.view_factors(**ROOM)
    rows, factors = found.to_pandas(), found.to_pandas("factors")
    assert rows.index.tolist() == list(found.names)
    np.testing.assert_array_equal(rows["sky"], found.sky)
    assert len(factors) == found.matrix.nnz
    assert factors["factor"].sum() == pytest.approx(found.row_sums.sum())
    power = found.exchange(0.5, [300.0, 310.0, 320.0, 330.0, 340.0, 350.0]).to_pandas()["net_power"]
    assert power.index.tolist() == list(found.names)


def test_view_factors_as_a_data_set() -> None:
    pytest.importorskip("xarray", reason="needs the extra frames")
    found = glpath.view_factors(**ROOM)
    data = found.to_xarray()
    one, other = found.names[:2]
    assert float(data["factor"].sel({"from": one, "to": other})) == found.matrix[0, 1]


def test_irradiance_as_a_data_frame_and_a_data_set() -> None:
    pytest.importorskip("pandas", reason="needs the extra frames")
    pytest.importorskip("xarray", reason="needs the extra frames")
    found = glpath.irradiance("cornell-box", DESK, [0.0, 1.0, 0.0], spp=16)
    frame = found.to_pandas(DESK)
    np.testing.assert_array_equal(frame["x"], DESK[:, 0])
    np.testing.assert_array_equal(frame["illuminance"], found.illuminance())
    assert frame.attrs["path_sets"] == 16
    data = found.to_xarray(DESK, (2, 3))
    assert data["irradiance"].dims == ("row", "column", "channel")
    np.testing.assert_array_equal(data["x"], DESK[:, 0].reshape(2, 3))


@pytest.mark.evidence
def test_pyvista_has_the_same_mesh() -> None:
    pytest.importorskip("pyvista", reason="needs the extra mesh")
    found = glpath.view_factors(**ROOM)
    mesh = found.to_vtk(**ROOM).to_pyvista()
    assert mesh.area == pytest.approx(found.areas.sum())


@pytest.mark.evidence
@pytest.mark.parametrize("suffix", [".vtp", ".vtu"])
def test_vtk_itself_reads_what_was_written(suffix: str, tmp_path: Path) -> None:
    """Points, cells of every kind, areas and values by the readers that ParaView has."""
    pytest.importorskip("vtkmodules", reason="needs the extra mesh")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersVerdict import vtkMeshQuality
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    points = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [3, 0.5, 0], [1, 2, 0]], float)
    polygons = [[0, 1, 2, 3], [1, 4, 2], [0, 1, 4, 2, 5]]
    values = {"front & <back>": np.array([1.5, -2.0, 4.0]), "row": np.arange(3)}
    VtkMesh(points, polygons, values, {"rgb": points}).save(tmp_path / f"a{suffix}")
    reader = vtkXMLUnstructuredGridReader() if suffix == ".vtu" else vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / f"a{suffix}"))
    reader.Update()
    mesh = reader.GetOutput()
    assert reader.GetErrorCode() == 0
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPoints().GetData()), points)
    assert [mesh.GetCellType(cell) for cell in range(mesh.GetNumberOfCells())] == [9, 5, 7]
    for cell, polygon in enumerate(polygons):
        ids = mesh.GetCell(cell).GetPointIds()
        assert [ids.GetId(i) for i in range(ids.GetNumberOfIds())] == polygon
    assert [vtkMeshQuality.QuadArea(mesh.GetCell(0)), vtkMeshQuality.TriangleArea(mesh.GetCell(1))] == [2.0, 0.5]
    for name, wanted in values.items():
        read = vtk_to_numpy(mesh.GetCellData().GetArray(name))
        np.testing.assert_array_equal(read, wanted)
        assert read.dtype == wanted.dtype
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPointData().GetArray("rgb")), points)


@pytest.mark.evidence
def test_vtk_itself_reads_points_alone_and_an_irradiance(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules", reason="needs the extra mesh")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    values = np.arange(18.0).reshape(6, 3)
    points_with_values(DESK, {"irradiance": values}).save(tmp_path / "a.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "a.vtp"))
    reader.Update()
    mesh = reader.GetOutput()
    assert (mesh.GetNumberOfVerts(), mesh.GetNumberOfPolys()) == (6, 0)
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPoints().GetData()), DESK)
    data = [mesh.GetPointData().GetArray("irradiance"), mesh.GetCellData().GetArray("irradiance")]
    np.testing.assert_array_equal(vtk_to_numpy(next(each for each in data if each is not None)), values)
