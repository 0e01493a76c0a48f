"""Files of height fields and point clouds: what is read, and what is refused with a remedy."""

from __future__ import annotations

import struct
import threading
import zlib
from contextlib import nullcontext
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
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
        ([[0.0, np.nan], [0.0, 0.0]], {}, "1 of 4 heights are missing, the first at row 0, column 1"),
        (np.full((2, 2), np.nan), {"holes": True}, "no height at all"),
        ([[0.0, 3.4e38], [0.0, 0.0]], {}, "Does it stand for no data"),
        (np.zeros((2, 2)), {"spacing": 0.0}, r"a spacing of 0.0"),
        (np.zeros((2, 2)), {"spacing": (1.0, -1.0)}, "needs one number above 0, or two"),
        (np.zeros((2, 2)), {"origin": (np.inf, 0.0)}, "two finite numbers"),
        (np.zeros((2, 2)), {"mask": np.ones((2, 3), bool)}, r"a mask of shape \(2, 3\)"),
    ],
)
def test_arrays_that_are_no_height_field(heights: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.SceneError, match=words):
        HeightField.of(heights, **options)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"heights": np.zeros(4)}, r"heights of shape \(4,\)"),
        ({"heights": "x"}, "heights: 'x'"),
        ({"heights": np.zeros((1, 4))}, "2 x 2 at least"),
        ({"heights": np.full((2, 2), np.nan)}, "no height at all"),
        ({"heights": np.full((2, 2), np.inf)}, "row 0, column 0 is inf"),
        ({"heights": np.full((2, 2), 1e300)}, "row 0, column 0 is inf"),
        ({"spacing": (0.0, 1.0)}, "a spacing of"),
        ({"spacing": (1.0,)}, "spacing: "),
        ({"spacing": (1.0, np.nan)}, "a spacing of"),
        ({"spacing": "x"}, "spacing: 'x'"),
        ({"origin": (np.inf, 0.0)}, "two finite numbers"),
        ({"source": 3}, "source: 3"),
        ({"crs": None}, "crs: None"),
    ],
)
def test_a_height_field_refuses_wrong_fields(values: dict[str, Any], words: str) -> None:
    right = {"heights": np.zeros((2, 2)), "spacing": (1.0, 1.0)}
    assert HeightField(**right).heights.dtype == np.float32
    with pytest.raises(glpath.GlpathError, match=words):
        HeightField(**{**right, **values})


def test_files_that_are_no_height_field(tmp_path: Path) -> None:
    for name, text, words in (
        ("a.txt", "", "is no height field that can be read"),
        ("b.asc", "hello\n", "is no ESRI ASCII grid"),
        ("c.asc", ASC + "1 2 3\n", "has 3 heights where 3 x 4 are announced"),
        ("d.asc", ASC.replace("cellsize 2", "cellsize x") + "1 2 3\n", 'cellsize is "x" where'),
        ("d.asc", ASC.replace("cellsize 2", "cellsize 1_0") + "1 2 3\n", 'cellsize is "1_0" where'),
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
    with pytest.raises(glpath.SceneError, match="has a spacing of its own"):
        horizon(HeightField.of(HEIGHTS), spacing=2.0)
    with pytest.raises(glpath.SceneError, match="has an origin of its own"):
        load_height_field(HeightField.of(HEIGHTS), origin=(0.0, 0.0))
    gap = ascii_grid(tmp_path / "i.asc", np.where(HEIGHTS == 5, -9999, HEIGHTS))
    with pytest.raises(glpath.SceneError, match="holes=True"):
        load_height_field(gap)
    assert np.isnan(load_height_field(gap, holes=True).heights[1, 1])


@pytest.mark.filterwarnings("error")
def test_the_lowest_number_of_64_bits_stands_for_no_data(tmp_path: Path) -> None:
    lowest = "-1.7976931348623157e+308"
    path = tmp_path / "a.asc"
    path.write_text(f"ncols 2\nnrows 2\ncellsize 2\nNODATA_value {lowest}\n1 2\n3 {lowest}\n")
    assert np.isnan(load_height_field(path, holes=True).heights).tolist() == [[False, False], [False, True]]


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


def test_a_coordinate_system_that_a_geotiff_cannot_store_gives_a_warning(tmp_path: Path) -> None:
    """GeoTIFF keys have no code for the projection Equal Earth. GDAL writes it to a file beside the raster."""
    rasterio = pytest.importorskip("rasterio")
    crs = rasterio.crs.CRS.from_string("+proj=eqearth +datum=WGS84").to_wkt().replace("unknown", "Equal Earth", 1)
    found = horizon(HeightField(heights=np.zeros((3, 4)), spacing=(1.0, 1.0), crs=crs))
    with pytest.warns(glpath.SceneWarning, match=r'a\.tif: .*"Equal Earth"'):
        found.save(tmp_path / "a.tif", np.zeros((3, 4)))
    assert [path.name for path in tmp_path.iterdir()] == ["a.tif"]


def test_a_coordinate_system_that_is_none_is_named(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    found = horizon(HeightField(heights=np.zeros((3, 4)), spacing=(1.0, 1.0), crs="nonsense"))
    with pytest.raises(glpath.ImageError, match=r"a.tif: cannot be written: "):
        found.save(tmp_path / "a.tif", np.zeros((3, 4)))
    assert not list(tmp_path.iterdir())


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


@pytest.mark.parametrize(
    "text",
    [
        "Projection    GEOGRAPHIC\nDatum WGS84\n",
        "Datum WGS84\r\nUnits DD\r\n",
        'GEOGCS["GCS_WGS_1984",DATUM["D"]]',
        '\ufeffGEOGCS["GCS_WGS_1984",DATUM["D"]]',
    ],
)
@pytest.mark.parametrize("name", ["a.prj", "a.PRJ"])
def test_an_ascii_grid_in_degrees_is_refused(tmp_path: Path, text: str, name: str) -> None:
    """ESRI: the .prj file beside a grid, as keywords of ARC/INFO or as WKT."""
    path = ascii_grid(tmp_path / "a.asc")
    (tmp_path / name).write_text(text)
    with pytest.raises(glpath.SceneError, match=r"a\.asc: is in degrees of longitude and latitude"):
        load_height_field(path)
    (tmp_path / name).write_text('PROJCS["WGS_1984_UTM_Zone_32N",GEOGCS["GCS_WGS_1984",DATUM["D"]]]')
    assert load_height_field(path).spacing == (2.0, 2.0)


def test_heights_that_seem_to_be_above_degrees_are_reported(tmp_path: Path) -> None:
    """Three arc seconds at 46 N, 8 E; then a scan of 4 cm by a laser, whose relief is below its width."""
    degrees = ASC.replace("xllcorner 10", "xllcorner 8").replace("yllcorner 20", "yllcorner 46")
    degrees = degrees.replace("cellsize 2", "cellsize 0.00083333")
    with pytest.warns(glpath.SceneWarning, match="x and y may be degrees of .*: samples are 0.000833 apart"):
        load_height_field(ascii_grid(tmp_path / "a.asc", header=degrees))
    rasterio = pytest.importorskip("rasterio")
    transform = rasterio.Affine(1 / 1200, 0, 8.0, 0, -1 / 1200, 46.0)
    with pytest.warns(glpath.SceneWarning, match="its x and y may be degrees"):
        load_height_field(geotiff(tmp_path / "a.tif", crs=None, transform=transform))
    load_height_field(ascii_grid(tmp_path / "b.asc", HEIGHTS / 200, ASC.replace("cellsize 2", "cellsize 0.04")))


@pytest.mark.parametrize(
    "text", [None, b"", b"EPSG:4326", b'BOUNDCRS[SOURCECRS[GEOGCRS["x"]]]', 'GEOGCS["x"]'.encode("utf-16")]
)
def test_prj_file_that_says_nothing_of_degrees_does_not_hide_them(tmp_path: Path, text: bytes | None) -> None:
    degrees = ASC.replace("cellsize 2", "cellsize 0.00083333")
    path = ascii_grid(tmp_path / "a.asc", header=degrees)
    if text is not None:
        (tmp_path / "a.prj").write_bytes(text)
    with pytest.warns(glpath.SceneWarning, match="its x and y may be degrees"):
        load_height_field(path)


@pytest.mark.parametrize("text", [b'PROJCS["UTM"]', b'LOCAL_CS["site"]', b"Projection UTM\nUnits METERS\n"])
def test_prj_file_of_metres_answers_for_small_samples(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "a.prj").write_bytes(text)
    load_height_field(ascii_grid(tmp_path / "a.asc", header=ASC.replace("cellsize 2", "cellsize 0.00083333")))


@pytest.mark.parametrize("linked", [True, False])
def test_prj_file_that_is_not_read_counts_as_absent(tmp_path: Path, linked: bool) -> None:
    """A link that leads out of the folder is not followed, and a file of 5,000 bytes is too large."""
    folder = tmp_path / "data"
    folder.mkdir()
    path = ascii_grid(folder / "a.asc")
    outside = tmp_path / "a.prj"
    outside.write_text('GEOGCS["GCS_WGS_1984"]' + " " * (0 if linked else 5000))
    if linked:
        (folder / "a.prj").symlink_to(outside)
    else:
        outside.rename(folder / "a.prj")
    np.testing.assert_array_equal(load_height_field(path).heights, HEIGHTS)


@pytest.mark.parametrize(("latitude", "stretch"), [(15.0, None), (60.0, "2"), (-45.0, "1.41")])
def test_web_mercator_away_from_the_equator_is_reported(
    tmp_path: Path, latitude: float, stretch: str | None
) -> None:
    """Snyder 1987, equations 7-2 and 7-3: y = R asinh(tan latitude), and the scale is 1 / cos latitude."""
    rasterio = pytest.importorskip("rasterio")
    north = 6_378_137 * np.arcsinh(np.tan(np.radians(latitude)))
    path = geotiff(tmp_path / "a.tif", crs="EPSG:3857", transform=rasterio.Affine(30, 0, 1e6, 0, -30, north))
    words = f"here {stretch} times as large as the ground"
    with nullcontext() if stretch is None else pytest.warns(glpath.SceneWarning, match=words):
        load_height_field(path)


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_point_clouds(tmp_path: Path, suffix: str) -> None:
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(point_format=3, file_version="1.2")
    cloud.x, cloud.y, cloud.z = [1.0, 2.0, 3.0], [-1.0, -2.0, -1.5], [0.0, 0.5, 7.25]
    cloud.classification = [2, 6, 6]
    cloud.write(tmp_path / f"a.{suffix}")
    np.testing.assert_allclose(load_point_cloud(tmp_path / f"a.{suffix}")[2], [3, -1.5, 7.25])
    for classes in ((6,), np.array([6, 7]), [6]):
        assert len(load_point_cloud(tmp_path / f"a.{suffix}", classes)) == 2
    for wrong in (np.zeros((1, 3)), "6", [2.5], [256], None):
        with pytest.raises(glpath.UsageError, match="classes"):
            load_point_cloud(tmp_path / f"a.{suffix}", wrong)  # type: ignore[arg-type]
    with pytest.raises(glpath.SceneError, match="no point of the classes"):
        load_point_cloud(tmp_path / f"a.{suffix}", (9,))


def test_without_the_extra_there_is_the_line_to_type(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(glpath.GlpathError, match=r"glpath\[terrain\]"):
        load_height_field(tmp_path / "dem.tif")


@pytest.fixture
def rasterio() -> Any:
    return pytest.importorskip("rasterio")


def tiff(rasterio: Any, path: Path, heights: Any = HEIGHTS, **more: Any) -> Path:
    """A TIFF of samples 2 apart, whose corner in the north-west is (10, 30)."""
    heights = np.asarray(heights, np.float32)
    size = {"height": heights.shape[0], "width": heights.shape[1], "count": 1, "dtype": "float32"}
    made = {"transform": rasterio.Affine(2, 0, 10, 0, -2, 30), **size, **more}
    with rasterio.open(path, "w", driver="GTiff", **made) as raster:
        raster.write(heights, 1)
    return path


VRT = (
    '<VRTDataset rasterXSize="4" rasterYSize="3"><GeoTransform>10,2,0,30,0,-2</GeoTransform>'
    '<Metadata><MDI key="INTERNAL_MASK_FLAGS_1">2</MDI></Metadata>'
    '<VRTRasterBand dataType="{}" band="1"><SimpleSource><SourceFilename relativeToVRT="0">{}</SourceFilename>'
    "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
)


def test_a_tiff_reaches_neither_network_nor_other_files(rasterio: Any, tmp_path: Path) -> None:
    """GDAL chooses the format by the content, and opens masks and overviews beside a file in any format."""
    requests: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def handle(self) -> None:
            requests.append(str(self.client_address))

    other = ascii_grid(tmp_path / "other.asc")
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        for source in (f"/vsicurl/http://127.0.0.1:{server.server_port}/x.tif", str(other)):
            (tmp_path / "a.tif").write_text(VRT.format("Float32", source))
            with pytest.raises(glpath.SceneError, match=r"a\.tif: cannot be read as a TIFF"):
                load_height_field(tmp_path / "a.tif")
            path = tiff(rasterio, tmp_path / f"b{len(source)}.tif")
            beside = path.with_name(f"{path.name}.msk")
            beside.write_text(VRT.format("Byte", source))
            with pytest.raises(glpath.SceneError, match=r"\.tif\.msk: cannot be read as a TIFF"):
                load_height_field(path, holes=True)
            beside.rename(path.with_suffix(".tif.ovr"))
            np.testing.assert_array_equal(load_height_field(path).heights, HEIGHTS)
        server.shutdown()
    assert requests == []


@pytest.mark.filterwarnings("ignore:.*(geotransform|identity)")
@pytest.mark.parametrize("suffix", [".tfw", ".TFW"])
def test_a_mask_and_a_world_file_beside_a_tiff_are_read_as_gdal_does(
    rasterio: Any, tmp_path: Path, suffix: str
) -> None:
    path = tiff(rasterio, tmp_path / "a.tif", transform=None)
    (tmp_path / f"a{suffix}").write_text("2\n0\n0\n-3\n11\n28.5\n")
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "r+") as raster:
        raster.write_mask(HEIGHTS > 4)
    assert (tmp_path / "a.tif.msk").exists()
    field = load_height_field(path, holes=True)
    with rasterio.open(path) as witness:
        np.testing.assert_array_equal(np.isnan(field.heights), np.ma.getmaskarray(witness.read(1, masked=True)))
        assert (field.spacing, field.origin) == ((witness.transform.a, -witness.transform.e), witness.xy(0, 0))
    assert np.isnan(field.heights).sum() == 5
    (tmp_path / f"a{suffix}").write_text("2\n0\n0\n")
    with pytest.raises(glpath.SceneError, match=rf"a\{suffix}: is no world file of six numbers"):
        load_height_field(path)


@pytest.mark.filterwarnings("ignore:.*(geotransform|identity)")
@pytest.mark.parametrize("name", ["a.tfw", "a.tif.msk"])
def test_a_link_beside_a_tiff_that_leads_out_of_its_folder_is_refused(
    name: str, rasterio: Any, tmp_path: Path
) -> None:
    """A link within the folder is followed, and an error does not quote the file."""
    folder = tmp_path / "data"
    folder.mkdir()
    path = tiff(rasterio, folder / "a.tif", **({"transform": None} if name == "a.tfw" else {}))
    for secret, message in ((tmp_path / "s.txt", "link to a file outside the folder"), (folder / "s.txt", name)):
        secret.write_text("hidden:x:0:0")
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(secret)
        with pytest.raises(glpath.SceneError, match=message) as caught:
            load_height_field(path)
        assert "hidden" not in str(caught.value)


def test_a_tiff_of_a_few_bytes_does_not_fill_the_memory(rasterio: Any, tmp_path: Path) -> None:
    made = {"width": 60_000, "height": 60_000, "count": 1, "dtype": "float32", "tiled": True}
    transform = rasterio.Affine(1, 0, 5, 0, -1, 5)
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", transform=transform, SPARSE_OK=True, **made):
        pass
    with pytest.raises(glpath.SceneError, match=r"unfold to 14\.4 GB"):
        load_height_field(tmp_path / "a.tif")


@pytest.mark.parametrize(("side", "block", "memory"), [(8000, 256, "0.768 GB"), (16, 20_000, "3.2 GB")])
def test_decoded_samples_and_blocks_of_a_small_tiff_count(
    rasterio: Any, side: int, block: int, memory: str, tmp_path: Path
) -> None:
    made = {"width": side, "height": side, "count": 1, "dtype": "float64", "compress": "deflate", "tiled": True}
    transform, blocks = rasterio.Affine(1, 0, 5, 0, -1, 5), {"blockxsize": block, "blockysize": block}
    path = tmp_path / "a.tif"
    with rasterio.open(path, "w", driver="GTiff", transform=transform, SPARSE_OK=True, **made, **blocks):
        pass
    with pytest.raises(glpath.SceneError, match=f"unfold to {memory}"):
        load_height_field(path)


def test_complex_heights_are_refused(rasterio: Any, tmp_path: Path) -> None:
    path = tiff(rasterio, tmp_path / "a.tif", dtype="complex64")
    with pytest.raises(glpath.SceneError, match="has values of the type complex64 where real numbers are needed"):
        load_height_field(path)


def test_small_archives_of_many_heights_or_long_spacings_are_refused(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", heights=np.zeros((24, 1 << 20), np.uint8))
    with pytest.raises(glpath.ImageError, match=r"bytes in it unfold to 0\.302 GB"):
        load_height_field(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", heights=HEIGHTS, spacing=np.ones(3))
    with pytest.raises(glpath.ImageError, match=r"`spacing` is an array \(3\), expected 2 values at most"):
        load_height_field(tmp_path / "b.npz")


@pytest.mark.parametrize(
    ("at", "kind", "value", "words"),
    [
        (100, "<I", 2**32 - 1, "4,294,967,295 records of its header do not fit"),
        (107, "<I", 2**32 - 1, "4,294,967,295 points of 20 bytes do not fit"),
        (104, "B", 99, "its points are of format 35, expected 0 to 10"),
        (96, "<I", 2**31, "records of its header do not fit"),
        (0, "<I", 0, "not of this format"),
    ],
)
def test_a_las_header_that_announces_too_much_is_refused(
    at: int, kind: str, value: int, words: str, tmp_path: Path
) -> None:
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(file_version="1.2", point_format=0)
    cloud.x, cloud.y, cloud.z = np.arange(9.0).reshape(3, 3)
    cloud.write(tmp_path / "a.las")
    np.testing.assert_allclose(load_point_cloud(tmp_path / "a.las")[:, 2], [6, 7, 8], atol=0.01)
    content = bytearray((tmp_path / "a.las").read_bytes())
    struct.pack_into(kind, content, at, value)
    (tmp_path / "a.las").write_bytes(content)
    with pytest.raises(glpath.SceneError, match=words):
        load_point_cloud(tmp_path / "a.las")


def test_record_behind_the_points_of_a_las_that_is_too_long_is_refused(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(file_version="1.4", point_format=6)
    cloud.x, cloud.y, cloud.z = np.arange(9.0).reshape(3, 3)
    cloud.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("glpath", 1, record_data=bytes(100))])
    cloud.write(tmp_path / "a.las")
    assert len(load_point_cloud(tmp_path / "a.las")) == 3
    content = bytearray((tmp_path / "a.las").read_bytes())
    at = struct.unpack_from("<Q", content, 235)[0]
    struct.pack_into("<Q", content, at + 20, 2**60)
    (tmp_path / "a.las").write_bytes(content)
    with pytest.raises(glpath.SceneError, match="record 0 behind its points is not in the file"):
        load_point_cloud(tmp_path / "a.las")


@pytest.mark.parametrize("chunk", [0, 1])
def test_layers_of_a_laz_chunk_are_in_its_file(chunk: int, tmp_path: Path) -> None:
    """A chunk has 50,000 points: its first point, a point count, the sizes of nine layers, and the layers."""
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(file_version="1.4", point_format=6)
    cloud.x = cloud.y = cloud.z = np.arange(50_001.0)
    cloud.write(tmp_path / "a.laz")
    assert load_point_cloud(tmp_path / "a.laz")[-1, 0] == pytest.approx(50_000)
    content = bytearray((tmp_path / "a.laz").read_bytes())
    at = struct.unpack_from("<I", content, 96)[0] + 8
    for _ in range(chunk):
        at += 30 + 4 + 36 + sum(struct.unpack_from("<9I", content, at + 34))
    struct.pack_into("<I", content, at + 34, 2**29)
    (tmp_path / "a.laz").write_bytes(content)
    with pytest.raises(glpath.SceneError, match=f"536,[0-9,]* bytes of its chunk {chunk} are not in it"):
        load_point_cloud(tmp_path / "a.laz")


def test_the_sizes_of_an_ascii_grid_are_whole_numbers(tmp_path: Path) -> None:
    for count in ("inf", "4.5", "nan", "1e400"):
        with pytest.raises(glpath.SceneError, match="ncols"):
            load_height_field(ascii_grid(tmp_path / "a.asc", header=ASC.replace("ncols 4", f"ncols {count}")))


@pytest.mark.parametrize("text", ["1 2 3 4\n", "1,0 2,0\n"])
def test_a_byte_order_mark_before_an_ascii_grid_is_left_out(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    path.write_bytes(b"\xef\xbb\xbf" + (ASC.replace("ncols 4\nnrows 3", "ncols 2\nnrows 2") + text).encode())
    if "," not in text:
        assert load_height_field(path).heights.tolist() == [[1, 2], [3, 4]]
        return
    with pytest.raises(glpath.SceneError, match='a height that is no number: "1,0"'):
        load_height_field(path)


def test_scale_and_offset_of_a_tiff_are_applied(rasterio: Any, tmp_path: Path) -> None:
    path = tiff(rasterio, tmp_path / "a.tif", np.int16(100 * HEIGHTS), nodata=500)
    with rasterio.open(path, "r+") as raster:
        raster.scales, raster.offsets = (0.01,), (1000.0,)
    expected = np.where(HEIGHTS == 5, np.nan, HEIGHTS + 1000.0)
    np.testing.assert_allclose(load_height_field(path, holes=True).heights, expected, rtol=1e-7)


@pytest.mark.parametrize(
    ("crs", "unit", "metres", "message"),
    [
        ("EPSG:26910+6360", None, 1200 / 3937, None),  # x and y in metres, NAVD88 heights in feet
        ("EPSG:26910+5703", None, 1.0, None),
        ("EPSG:32632", "ft", 0.3048, None),
        ("EPSG:2227", "metre", 3937 / 1200, None),  # x and y in feet
        ("EPSG:2227", None, 1.0, "x and y are in US survey foot. Its heights are taken to be so"),
        ("EPSG:32632", "parsec", 1.0, 'its heights are in "parsec", a unit that is not known'),
    ],
)
def test_heights_of_a_tiff_get_the_unit_of_x_and_y(
    rasterio: Any, tmp_path: Path, crs: str, unit: str | None, metres: float, message: str | None
) -> None:
    path = tiff(rasterio, tmp_path / "a.tif", np.float32(HEIGHTS), crs=crs)
    if unit is not None:
        with rasterio.open(path, "r+") as raster:
            raster.units = (unit,)
    with pytest.warns(glpath.SceneWarning, match=message) if message else nullcontext():
        found = load_height_field(path)
    np.testing.assert_allclose(found.heights, HEIGHTS * metres, rtol=1e-6)


def test_origin_and_spacing_may_be_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "heights.npy", np.eye(5))
    for source in (np.eye(5), tmp_path / "heights.npy"):
        field = load_height_field(source, origin=np.array([2, 3]), spacing=np.array([0.5, 1.0]))  # type: ignore[arg-type]
        assert (field.origin, field.spacing) == ((2.0, 3.0), (0.5, 1.0))


@pytest.mark.parametrize("origin", [np.zeros((2, 2)), np.array([1.0]), [], "x", [np.nan, 0.0]])
def test_origin_that_is_not_two_numbers_is_refused(origin: Any) -> None:
    with pytest.raises(glpath.GlpathError, match="origin"):
        load_height_field(np.eye(5), origin=origin)


def masked_tiff(side: int) -> bytes:
    """TIFF of 16 x 16 heights, with a mask of 16 x 16 bits in one compressed tile of (side, side)."""

    def image(start: int, bits: int, tile: int, data: bytes, is_mask: bool) -> bytes:
        tags = [(254, 4 * is_mask), (256, 16), (257, 16), (258, bits), (259, 8), (262, 4 if is_mask else 1)]
        tags += [(277, 1), (284, 1), (322, tile), (323, tile), (324, 0), (325, len(data))]
        end = start + 2 + 12 * (len(tags) + 2 * (not is_mask)) + 4
        entries = [struct.pack("<HHLL", tag, 4, 1, value) for tag, value in tags]
        place = b"" if is_mask else struct.pack("<9d", 1, 1, 0, 0, 0, 0, 100, 100, 0)
        entries[10] = struct.pack("<HHLL", 324, 4, 1, end + len(place))
        if place:
            entries += [struct.pack("<HHLL", 33550, 12, 3, end), struct.pack("<HHLL", 33922, 12, 6, end + 24)]
        following = 0 if is_mask else end + len(place) + len(data)
        return struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<L", following) + place + data

    heights = image(8, 8, 16, zlib.compress(bytes(range(256))), False)
    mask = image(8 + len(heights), 1, side, zlib.compress(b"\xff" * (side * side // 8)), True)
    return b"II*\0" + struct.pack("<L", 8) + heights + mask


def test_a_mask_whose_tile_unfolds_to_a_gigabyte_is_not_read(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    (tmp_path / "a.tif").write_bytes(masked_tiff(16))
    assert np.sort(load_height_field(tmp_path / "a.tif").heights, axis=None).tolist() == list(range(256))
    (tmp_path / "b.tif").write_bytes(masked_tiff(32768))
    with pytest.raises(glpath.SceneError, match=r"bytes in it unfold to 1\.07 GB"):
        load_height_field(tmp_path / "b.tif")
