"""Reports and models of a measurement: what stands in them, read back."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath.apps.measure.files import save_glb, save_vtp
from glpath.apps.measure.measured import Measured
from glpath.apps.measure.points import Points, plane_grid
from glpath.apps.measure.report import save_report
from glpath.cli.main import app
from glpath.errors import GlpathError, SceneWarning
from glpath.scene.maintenance import maintained
from glpath.scene.summary import light_of
from glpath.system.colour import encode_srgb
from tests.io.test_vtk import arrays

pytest.importorskip("matplotlib")

CANDELA = 500.0
ROOM: dict[str, Any] = {
    "unit": "photometric",
    "camera": {"position": [0, -3, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 40},
    "materials": {"black": {"reflectance": 0}},
    "shapes": [
        {"type": "quad", "corners": [[-3, -2, 0], [3, -2, 0], [3, 2, 0], [-3, 2, 0]], "material": "black"},
        {"type": "box", "min": [1, 1, 0], "max": [2, 2, 1.5], "material": "black"},
    ],
    "lights": [{"type": "point", "name": "lamp <1>", "position": [0, 0, 2], "intensity": CANDELA}],
}


def lux(points: np.ndarray) -> np.ndarray:
    """0.8 of it, below the lamp."""
    to_lamp = np.array([0, 0, 2]) - points
    return np.asarray(0.8 * CANDELA * to_lamp[:, 2] / np.linalg.norm(to_lamp, axis=1) ** 3)


@pytest.fixture(scope="module")
def measured() -> Measured:
    scene = maintained(glpath.load_scene(ROOM), 0.8)
    at = plane_grid(scene, "z=0.5", spacing=1)
    found = glpath.irradiance(scene, at.points, at.normals, spp=16, max_depth=1)
    return Measured(at, found, scene, "Illuminance")


class Page(HTMLParser):
    """Cells of all tables, row by row; what a page loads; and whether its tags are paired."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.sources: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data


def test_a_report_has_the_figures_the_lamps_and_the_values_on_the_plan(measured: Measured, tmp_path: Path) -> None:
    save_report(tmp_path / "lux.html", measured)
    text = (tmp_path / "lux.html").read_text(encoding="utf-8")
    page = Page(text)
    assert not page.open
    # It needs nothing beside it.
    assert [source.partition(",")[0] for source in page.sources] == ["data:image/png;base64"]
    assert "http" not in re.sub(r"base64,[^\"]*", "", text)
    told = {row[0]: row[1] for row in page.rows if len(row) == 2}
    points = measured.at.points
    inside = (np.abs(points - [1.5, 1.5, 0.5]) < 0.5).all(axis=1)
    assert inside.sum() == 1
    expected = lux(points)
    # A point behind the box as the lamp sees it has no light either.
    lit = measured.found.illuminance() > 0
    assert (~lit[inside]).all()
    assert float(told["mean Ē"].split()[0]) == pytest.approx(expected[lit].mean(), rel=1e-3)
    assert float(told["maximum"].split()[0]) == pytest.approx(expected[lit].max(), rel=1e-3)
    low, mean, high = expected[lit].min(), expected[lit].mean(), expected[lit].max()
    assert told["uniformity U0 = minimum / mean"] == f"{low / mean:.3f}"
    assert told["uniformity Ud = minimum / maximum"] == f"{low / high:.3f}"
    assert told["grid"] == "6 x 4 points, 1 apart"
    assert told["EN 12464-1"] == "9 x 6 points or more for 6 x 4 m; this grid has fewer"
    assert told["light"] == "1 punctual light (maintenance factor 0.8)"
    (lamp,) = (row for row in page.rows if row and row[0] == "lamp <1>")
    assert lamp[1:] == ["point", "0, 0, 2", f"{4 * np.pi * 0.8 * CANDELA:,.0f}", "0.8"]
    # The plan: its first row is the grid's last.
    rows = [row for row in page.rows if row and row[0].startswith("y ")]
    assert [row[0] for row in rows] == ["y 1.5", "y 0.5", "y -0.5", "y -1.5"]
    values = np.array([[float(cell) for cell in row[1:]] for row in rows])[::-1]
    np.testing.assert_allclose(values.ravel(), np.where(lit, expected, 0), atol=0.51)


def test_a_scene_lit_by_the_sun_alone_is_described_without_maintenance_factors() -> None:
    sun = [{"type": "directional", "direction": [0, 0, -1], "irradiance": 1.0}]
    assert light_of(glpath.load_scene(ROOM | {"lights": sun})) == "light: 1 punctual light"


def test_a_report_of_points_has_them_in_a_table(measured: Measured, tmp_path: Path) -> None:
    alone = Measured(Points(measured.at.points, measured.at.normals), measured.found, measured.scene, "Illuminance")
    save_report(tmp_path / "lux.html", alone)
    page = Page((tmp_path / "lux.html").read_text(encoding="utf-8"))
    assert not page.sources
    titles, *rows = (row for row in page.rows if len(row) == 8)
    assert titles == ["x", "y", "z", "nx", "ny", "nz", "E, lx", "standard error, lx"]
    np.testing.assert_allclose(np.array(rows, float)[:, :3], measured.at.points)
    np.testing.assert_allclose(np.array(rows, float)[:, 6], measured.found.illuminance(), rtol=1e-3)


@pytest.mark.parametrize("away", [[500_000.0, 5_800_000.0, 0.0], [4_000.0, 1_200.0, 0.0]])
def test_a_report_of_a_georeferenced_model_has_its_coordinates(
    measured: Measured, away: list[float], tmp_path: Path
) -> None:
    grid = measured.at.grid
    assert grid is not None
    at = replace(measured.at, points=measured.at.points + away)
    x, y, _ = away
    at = replace(at, grid=replace(grid, first=(grid.first[0] + x, grid.first[1] + y)))
    lamp = replace(measured.scene.lights[0], position=measured.scene.lights[0].position + away)
    moved = replace(measured, at=at, scene=replace(measured.scene, lights=(lamp,)))
    save_report(tmp_path / "lux.html", moved)
    rows = Page((tmp_path / "lux.html").read_text(encoding="utf-8")).rows
    labels = [float(row[0].split()[1]) for row in rows if row and row[0].startswith("y ")]
    assert labels == [y + 1.5, y + 0.5, y - 0.5, y - 1.5]
    assert [float(cell) for cell in rows[-1][1:]] == [x - 2.5, x - 1.5, x - 0.5, x + 0.5, x + 1.5, x + 2.5]
    (area,) = (row[1] for row in rows if row and row[0] == "area")
    assert [float(part) for part in re.findall(r"-?[0-9.]+", area)] == [x - 3, x + 3, y - 2, y + 2]
    (place,) = (row[2] for row in rows if row and row[0] == "lamp <1>")
    assert [float(part) for part in place.split(",")] == [x, y, 2]
    save_report(tmp_path / "points.html", replace(moved, at=replace(at, grid=None)))
    table = [row for row in Page((tmp_path / "points.html").read_text(encoding="utf-8")).rows if len(row) == 8][1:]
    assert np.array_equal(np.array(table, float)[:, :3], at.points)


def test_large_grids_are_thinned_on_the_plan(tmp_path: Path) -> None:
    scene = glpath.load_scene(ROOM)
    at = plane_grid(scene, "z=0.5", spacing=0.05)
    found = glpath.irradiance(scene, at.points, at.normals, spp=1, max_depth=1)
    save_report(tmp_path / "lux.html", Measured(at, found, scene, "Illuminance"))
    text = (tmp_path / "lux.html").read_text(encoding="utf-8")
    assert "One of 3 points along both axes." in text
    assert text.count("<td style") + text.count('<td class="dark"') == 40 * 27


def test_cells_of_a_grid_lie_around_its_points(measured: Measured, tmp_path: Path) -> None:
    save_vtp(tmp_path / "lux.vtp", measured)
    found = arrays(tmp_path / "lux.vtp")
    corners = found["Points/Points"].reshape(-1, 4, 3)
    np.testing.assert_allclose(corners.mean(axis=1), measured.at.points, atol=1e-12)
    np.testing.assert_allclose(np.ptp(corners, axis=1), np.broadcast_to([1, 1, 0], (24, 3)), atol=1e-12)
    edges = np.diff(corners, axis=1, append=corners[:, :1])
    assert np.abs(edges).sum(axis=2).max() == pytest.approx(1)  # around, not across
    np.testing.assert_array_equal(found["CellData/illuminance"], measured.found.illuminance())
    np.testing.assert_array_equal(found["CellData/irradiance"], measured.found.values)
    alone = Measured(Points(measured.at.points, measured.at.normals), measured.found, measured.scene, "Illuminance")
    save_vtp(tmp_path / "points.vtp", alone)
    found = arrays(tmp_path / "points.vtp")
    np.testing.assert_array_equal(found["Points/Points"], measured.at.points)
    np.testing.assert_array_equal(found["PointData/illuminance"], measured.found.illuminance())


def test_a_model_has_the_scene_and_the_plane_in_its_colours(measured: Measured, tmp_path: Path) -> None:
    from matplotlib import colormaps

    trimesh = pytest.importorskip("trimesh")
    save_glb(tmp_path / "lux.glb", measured)
    model = trimesh.load(tmp_path / "lux.glb", force="scene")
    top = measured.found.illuminance().max()
    (name,) = (each for each in model.geometry if each.startswith("illuminance, 0 to"))
    assert name == f"illuminance, 0 to {top:.4g} lx"
    assert len(model.geometry) == 3
    plane = model.geometry[name]
    assert (len(plane.vertices), len(plane.faces)) == (4 * 24, 2 * 24)
    assert plane.area == pytest.approx(24)
    # Linear colours, in which viewers compute, of what the colour map has on the screen.
    shown = encode_srgb(np.asarray(plane.visual.vertex_attributes["color"], float)[::4, :3])
    values = measured.values
    expected = colormaps["viridis"](values / top)[:, :3]
    lit = ~np.isnan(values)
    assert np.abs(shown - expected)[lit].max() < 0.05
    assert np.ptp(shown[~lit]) < 0.02  # grey
    content = (tmp_path / "lux.glb").read_bytes()
    told = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])["extras"]
    assert told["last_colour"] == pytest.approx(top)
    assert (told["unit"], told["colour_map"]) == ("lx", "viridis")
    # The plane of the file's z = 0.5 is at y = 0.5 of a glTF file.
    world = model.graph.get(name)[0]
    np.testing.assert_allclose((plane.vertices @ world[:3, :3].T + world[:3, 3])[:, 1], 0.5, atol=1e-6)


def test_a_model_says_what_it_leaves_out(tmp_path: Path) -> None:
    scene = glpath.load_scene({**ROOM, "sky": {"zenith": [1, 1, 1]}})
    at = plane_grid(scene, "z=0.5", spacing=2)
    found = glpath.irradiance(scene, at.points, at.normals, spp=1, max_depth=1)
    with pytest.warns(SceneWarning, match="the sky is left out"):
        save_glb(tmp_path / "lux.glb", Measured(at, found, scene, "Illuminance"))


def test_a_factor_is_of_the_lamps_that_have_none_and_of_no_sky() -> None:
    """Closed forms: candela over the distance squared; a small panel far away; a sky of radiance 1."""
    base = {**ROOM, "shapes": ROOM["shapes"][:1]}
    other = {"type": "point", "position": [0, 0, 4], "intensity": 1600, "maintenance_factor": 0.5}
    panel = {
        "type": "quad",
        "corners": [[-0.05, 0.05, 10], [0.05, 0.05, 10], [0.05, -0.05, 10], [-0.05, -0.05, 10]],
        "emission": {"radiance": 1e6},
        "material": "black",
    }
    at: dict[str, Any] = {"points": [[0, 0, 0]], "normals": [0, 0, 1], "max_depth": 1, "spp": 16}
    scene = {**base, "lights": [*ROOM["lights"], other]}
    (one,) = glpath.irradiance(scene, maintenance_factor=0.8, **at).illuminance()
    assert one == pytest.approx(0.8 * CANDELA / 4 + 0.5 * 1600 / 16, rel=1e-4)
    (plain,) = glpath.irradiance(scene, **at).illuminance()
    assert plain == pytest.approx(CANDELA / 4 + 0.5 * 1600 / 16, rel=1e-4)
    bright = {**base, "shapes": [*base["shapes"], panel], "lights": []}
    (shape,) = glpath.irradiance(bright, maintenance_factor=0.8, **at).illuminance()
    assert shape == pytest.approx(0.8 * 1e6 * 0.01 / 100, rel=1e-3)
    own = {**panel, "emission": {"radiance": 1e6, "maintenance_factor": 0.5}}
    bright["shapes"] = [*base["shapes"], own]
    (shape,) = glpath.irradiance(bright, maintenance_factor=0.8, **at).illuminance()
    assert shape == pytest.approx(0.5 * 1e6 * 0.01 / 100, rel=1e-3)
    sky = {**base, "lights": [], "sky": {"zenith": 1}}
    (open_ground,) = glpath.irradiance(sky, maintenance_factor=0.8, **{**at, "spp": 256}).illuminance()
    assert open_ground == pytest.approx(np.pi, rel=0.02)


@pytest.mark.parametrize("factor", [0, 1.2, -1, float("nan")])
def test_a_factor_is_a_share(factor: float) -> None:
    with pytest.raises(GlpathError, match=r"maintenance_factor=\S+: must be above 0, up to 1"):
        maintained(glpath.load_scene(ROOM), factor)
    lamp = {"type": "point", "position": [0, 0, 2], "intensity": 1, "maintenance_factor": factor}
    if not np.isnan(factor):
        with pytest.raises(GlpathError, match="maintenance_factor"):
            glpath.load_scene({**ROOM, "lights": [lamp]})


OVERCAST = """
unit = "photometric"
ambient = {ambient}
[[shapes]]
type = "quad"
corners = [[-3, -2, 0], [3, -2, 0], [3, 2, 0], [-3, 2, 0]]
[sky]
type = "cie"
cie_type = 1
illuminance = {lux}
up = [0, 0, 1]
{more}
"""


def told_of_factor(folder: Path, lux: float, more: str = "", *options: str, ambient: float = 0) -> Any:
    (folder / "a.toml").write_text(OVERCAST.format(lux=lux, more=more, ambient=ambient))
    out = str(folder / "a.csv")
    words = [str(folder / "a.toml"), "-o", out, "--plane", "z=0.5", "--spacing", "2", "--spp", "32", *options]
    return CliRunner().invoke(app, ["measure", *words, "--daylight-factor"])


def test_a_daylight_factor_on_open_ground_is_100_per_cent(tmp_path: Path) -> None:
    told = told_of_factor(tmp_path, 100)
    assert told.exit_code == 0, told.output
    (line,) = (line for line in told.stderr.splitlines() if "daylight factor:" in line)
    assert float(line.split("mean")[1].split()[0]) == pytest.approx(100, abs=3)
    assert "%" in line
    assert " lx" not in told.stderr


@pytest.mark.parametrize(
    ("lux", "more", "message"),
    [
        (1000, "", "makes 1000 lx on open ground"),
        (100, '[[lights]]\ntype = "point"\nposition = [0, 0, 1]\nintensity = 1', "has lamps besides its sky"),
    ],
)
def test_what_is_no_daylight_factor_is_refused(tmp_path: Path, lux: float, more: str, message: str) -> None:
    told = told_of_factor(tmp_path, lux, more)
    assert (told.exit_code, message in told.stderr) == (2, True), told.output


def test_ambient_light_is_no_daylight(tmp_path: Path) -> None:
    """Ambient light has its own share on open ground, so lux would be above 100 there."""
    told = told_of_factor(tmp_path, 100, ambient=5)
    assert (told.exit_code, "has ambient light" in told.stderr) == (2, True), told.output
    told = told_of_factor(tmp_path, 100, "", "--ambient", "5")
    assert (told.exit_code, "has ambient light" in told.stderr) == (2, True), told.output
    told = told_of_factor(tmp_path, 100, "", "--ambient", "0", ambient=5)
    assert told.exit_code == 0, told.output


def test_pictures_and_reports_of_a_daylight_factor_have_its_name(measured: Measured, tmp_path: Path) -> None:
    factor = replace(measured, quantity="Daylight factor", unit="%")
    save_report(tmp_path / "a.html", factor)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "Daylight factor in" in text
    assert "Illuminance" not in text
    assert " lx" not in re.sub(r"\d lm", "", text)
