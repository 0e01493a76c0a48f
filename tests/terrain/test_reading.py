"""Files of height fields and point clouds: what is read, and what is refused with a remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath import HeightField, horizon, load_height_field, load_point_cloud

HEIGHTS = np.arange(12.0).reshape(3, 4)
ASC = "ncols 4\nnrows 3\nxllcorner 10\nyllcorner 20\ncellsize 2\nNODATA_value -9999\n"


def ascii_grid(path: Path, heights: Any = HEIGHTS, header: str = ASC) -> Path:
    path.write_text(header + "\n".join(" ".join(f"{z:g}" for z in row) for row in heights) + "\n")
    return path


def test_an_ascii_grid_has_its_samples_in_the_middles_of_cells(tmp_path: Path) -> None:
    field = load_height_field(ascii_grid(tmp_path / "a.asc"))
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert (field.spacing, field.origin) == ((2.0, 2.0), (11.0, 25.0))
    x, y = field.coordinates()
    assert (x[-1], y[-1]) == (17.0, 21.0)


def test_the_corner_of_an_ascii_grid_may_be_a_centre(tmp_path: Path) -> None:
    header = ASC.replace("llcorner", "llcenter")
    assert load_height_field(ascii_grid(tmp_path / "a.asc", header=header)).origin == (10.0, 24.0)


def test_numpy_files(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", HEIGHTS)
    field = load_height_field(tmp_path / "a.npy", spacing=0.5, origin=(1.0, 2.0))
    assert (field.spacing, field.origin) == ((0.5, 0.5), (1.0, 2.0))
    mask = HEIGHTS > 0
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, spacing=(2.0, 3.0), origin=(1.0, 2.0), mask=mask)
    field = load_height_field(tmp_path / "a.npz", holes=True)
    assert (field.spacing, field.origin) == ((2.0, 3.0), (1.0, 2.0))
    np.testing.assert_array_equal(np.isnan(field.heights), ~mask)


def test_heights_between_samples_are_those_of_the_triangles() -> None:
    field = HeightField.of([[0.0, 1.0], [4.0, 9.0]])
    at = [[0, 0], [1, 0], [0, -1], [1, -1], [0.5, -0.5], [0.75, -0.25], [0.25, -0.75], [2, 0]]
    expected = [0, 1, 4, 9, 4.5, 0.75 + 0.25 * 8, 0.75 * 4 + 0.25 * 5, np.nan]
    np.testing.assert_allclose(field.heights_at(at), expected)
    vertices, faces = field.triangles()
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    assert (normals[:, 2] > 0).all()
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(field.normals_at([[0.75, -0.25], [0.25, -0.75]]), normals, atol=1e-6)


@pytest.mark.parametrize(
    ("heights", "options", "words"),
    [
        (np.zeros(4), {}, r"heights of shape \(4,\)"),
        (np.zeros((1, 4)), {}, "2 x 2 at least"),
        ([["a", "b"], ["c", "d"]], {}, "no array of numbers"),
        ([[0.0, np.nan], [0.0, 0.0]], {}, "1 of 4 heights are missing, the first at row 0, column 1"),
        (np.full((2, 2), np.nan), {"holes": True}, "no height at all"),
        ([[0.0, 3.4e38], [0.0, 0.0]], {}, "Does it stand for no data"),
        (np.zeros((2, 2)), {"spacing": 0.0}, "a spacing of 0.0"),
        (np.zeros((2, 2)), {"spacing": (1.0, -1.0)}, "needs one number above 0, or two"),
        (np.zeros((2, 2)), {"origin": (np.inf, 0.0)}, "two finite numbers"),
        (np.zeros((2, 2)), {"mask": np.ones((2, 3), bool)}, r"a mask of shape \(2, 3\)"),
    ],
)
def test_arrays_that_are_no_height_field(heights: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.SceneError, match=words):
        HeightField.of(heights, **options)


def test_files_that_are_no_height_field(tmp_path: Path) -> None:
    for name, text, words in (
        ("a.txt", "", "is no height field that can be read"),
        ("b.asc", "hello\n", "is no ESRI ASCII grid"),
        ("c.asc", ASC + "1 2 3\n", "has 3 heights where 3 x 4 are announced"),
        ("d.asc", ASC.replace("cellsize 2", "cellsize x") + "1 2 3\n", "cellsize is b'x'"),
        ("e.asc", ASC + "1 2 3 a\n", "a height that is no number"),
        ("f.npy", "no", "cannot be read as a height field"),
        ("g.npz", "no", "cannot be read as a height field"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(glpath.GlpathError, match=words):
            load_height_field(tmp_path / name)
    with pytest.raises(glpath.SceneError, match="no such file"):
        load_height_field(tmp_path / "none.asc")
    with pytest.raises(glpath.SceneError, match="has a spacing of its own"):
        load_height_field(ascii_grid(tmp_path / "h.asc"), spacing=2.0)
    gap = ascii_grid(tmp_path / "i.asc", np.where(HEIGHTS == 5, -9999, HEIGHTS))
    with pytest.raises(glpath.SceneError, match="holes=True"):
        load_height_field(gap)
    assert np.isnan(load_height_field(gap, holes=True).heights[1, 1])


def test_results_as_files(tmp_path: Path) -> None:
    found = horizon(HeightField.of(np.zeros((3, 4)), 2.0, (10.0, 20.0)))
    factors = found.sky_view_factor()
    for name in ("a.npy", "a.npz"):
        found.save(tmp_path / name, factors)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), factors)
    with np.load(tmp_path / "a.npz") as stored:
        np.testing.assert_array_equal(stored["y"], [20, 18, 16])
    points = horizon(np.zeros((3, 4)), [[1.0, -1.0], [2.0, -1.5]])
    points.save(tmp_path / "a.csv", points.sky_view_factor())
    assert (tmp_path / "a.csv").read_text().splitlines()[:2] == ["x,y,z,value", "1,-1,0,1"]
    with pytest.raises(glpath.ImageError, match="Results of points end in"):
        points.save(tmp_path / "a.tif", points.sky_view_factor())
    with pytest.raises(glpath.UsageError, match="values of shape"):
        found.save(tmp_path / "b.npy", np.zeros(3))


def test_data_sets() -> None:
    xarray = pytest.importorskip("xarray")
    found = horizon(HeightField.of(np.zeros((3, 4)), 2.0, (10.0, 20.0)))
    data = found.to_xarray(sky_view_factor=found.sky_view_factor())
    assert isinstance(data, xarray.Dataset)
    assert data.sky_view_factor.dims == ("y", "x")
    assert float(data.sky_view_factor.sel(x=12.0, y=18.0)) == pytest.approx(1.0)


def geotiff(path: Path, heights: Any = HEIGHTS, **more: Any) -> Path:
    rasterio = pytest.importorskip("rasterio")
    bands = heights if np.ndim(heights) == 3 else np.asarray(heights)[None]
    made: dict[str, Any] = {
        "transform": rasterio.Affine(2.0, 0, 500_000.0, 0, -2.0, 5_000_000.0),
        "crs": "EPSG:32632",
        "nodata": -9999.0,
        **more,
    }
    count, height, width = bands.shape
    with rasterio.open(
        path, "w", driver="GTiff", count=count, height=height, width=width, dtype="float32", **made
    ) as file:
        file.write(bands.astype(np.float32))
    return path


def test_a_geotiff_gives_its_georeference_to_results(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    field = load_height_field(geotiff(tmp_path / "dem.tif"))
    assert (field.spacing, field.origin) == ((2.0, 2.0), (500_001.0, 4_999_999.0))
    found = horizon(field)
    found.save(tmp_path / "svf.tif", found.sky_view_factor())
    with rasterio.open(tmp_path / "dem.tif") as dem, rasterio.open(tmp_path / "svf.tif") as made:
        assert made.transform == dem.transform
        assert made.crs == dem.crs
        np.testing.assert_array_equal(made.read(1), found.sky_view_factor())


def test_geotiffs_that_are_refused(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    degrees = {"crs": "EPSG:4326", "transform": rasterio.Affine(1e-4, 0, 9.0, 0, -1e-4, 47.0)}
    cases: list[tuple[dict[str, Any], str]] = [
        (degrees, "in degrees of longitude and latitude"),
        ({"transform": rasterio.Affine(2.0, 0.5, 0, 0.5, -2.0, 0)}, "is rotated"),
        ({"transform": rasterio.Affine(2.0, 0, 0, 0, 2.0, 0)}, "rows south"),
        ({"heights": np.zeros((3, 3, 4))}, "has 3 bands"),
        ({"heights": np.where(HEIGHTS == 5, -9999, HEIGHTS)}, "1 of 12 heights are missing"),
    ]
    for i, (more, words) in enumerate(cases):
        with pytest.raises(glpath.SceneError, match=words):
            load_height_field(geotiff(tmp_path / f"{i}.tif", **more))
    (tmp_path / "text.tif").write_text("no")
    with pytest.raises(glpath.SceneError, match="cannot be read"):
        load_height_field(tmp_path / "text.tif")


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_point_clouds(tmp_path: Path, suffix: str) -> None:
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(point_format=3, file_version="1.2")
    cloud.x, cloud.y, cloud.z = [1.0, 2.0, 3.0], [-1.0, -2.0, -1.5], [0.0, 0.5, 7.25]
    cloud.classification = [2, 6, 6]
    cloud.write(tmp_path / f"a.{suffix}")
    np.testing.assert_allclose(load_point_cloud(tmp_path / f"a.{suffix}")[2], [3, -1.5, 7.25])
    assert len(load_point_cloud(tmp_path / f"a.{suffix}", (6,))) == 2
    with pytest.raises(glpath.SceneError, match="no point of the classes"):
        load_point_cloud(tmp_path / f"a.{suffix}", (9,))


def test_without_the_extra_there_is_the_line_to_type(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(glpath.GlpathError, match=r"glpath\[terrain\]"):
        load_height_field(tmp_path / "dem.tif")
