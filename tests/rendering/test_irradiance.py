"""`glpath.irradiance` and `glpath measure`: numbers, their errors, files, and what is refused."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from glpath.apps.measure.points import en_12464_counts, plane_grid
from glpath.apps.measure.tables import read_points
from glpath.cli.main import app
from glpath.film.film import Film
from glpath.film.image import read_eight_bits
from glpath.film.noise import standard_error
from glpath.integrators.path_settings import PathSettings
from glpath.integrators.settings import DEEPEST
from glpath.io import load_scene
from glpath.rendering import RenderJob, run
from glpath.sensors.sensor import PointSensor
from tests.support import killing
from tests.support.terrain import Hills

BOX = "cornell-box-36"
POINTS = [[0.0, 0.5, 0.1], [0.2, 0.3, 0.2], [-0.3, 0.5, 0.0]]

LIT = """
[camera]
position = [0, -3, 1]
target = [0, 0, 1]
up = [0, 0, 1]
fov = 40

[[shapes]]
type = "quad"
corners = [[-3, -2, 0], [3, -2, 0], [3, 2, 0], [-3, 2, 0]]

[[lights]]
type = "point"
position = [0, 0, 2]
intensity = [3, 2, 1]
"""


def lux(x: Any, y: Any, height: float = 0.0) -> Any:
    """Of that scene, facing up: 179 times the luminance of the lamp, its cosine and its distance."""
    up = 2 - height
    return 179 * (0.2126 * 3 + 0.7152 * 2 + 0.0722) * up / (x**2 + y**2 + up**2) ** 1.5


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "lit.toml"
    path.write_text(LIT)
    return path


def test_it_has_values_errors_and_lux(scene: Path) -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, -1.5, 1], [2, 1, 0.5], [-2, 0.5, 0]])
    found = glpath.irradiance(scene, points, [0, 0, 3.0], spp=16, max_depth=1)
    expected = [lux(x, y, z) for x, y, z in points]
    np.testing.assert_allclose(found.illuminance(), expected, rtol=2e-5)
    np.testing.assert_allclose(found.values[0], np.array([3, 2, 1]) / 4, rtol=2e-5)
    assert found.values.shape == found.standard_errors.shape == (5, 3)
    # Light that is exact in every path set has no error.
    assert found.illuminance_errors().shape == (5,)
    assert found.illuminance_errors().max() < 1e-4 * found.illuminance().max()
    assert np.isnan(glpath.irradiance(scene, points, [0, 0, 1], spp=8, max_depth=1).standard_errors).all()


def test_it_goes_on_and_its_noise_is_asked_for() -> None:
    options: dict[str, Any] = {"max_depth": 3, "seed": 3}
    first = glpath.irradiance(BOX, POINTS, [0, 1, 0], spp=16, **options)
    whole = glpath.irradiance(BOX, POINTS, [0, 1, 0], spp=32, film=first.film, **options)
    straight = glpath.irradiance(BOX, POINTS, [0, 1, 0], spp=32, **options)
    np.testing.assert_array_equal(whole.values, straight.values)
    enough = glpath.irradiance(BOX, POINTS, [0, 1, 0], noise=0.3, **options)
    assert enough.film.metadata.stop_rule == "noise"
    with pytest.raises(glpath.UsageError, match="points"):
        glpath.irradiance(BOX, POINTS[:2], [0, 1, 0], spp=32, film=first.film, **options)


def test_errors_are_those_of_seeds() -> None:
    """The spread of means over independent seeds is the standard error that each tells, in the mean of squares."""
    rng = np.random.default_rng(5)
    counts = np.array([8, 8, 16, 8, 8, 8, 8, 0])
    sums = np.stack([rng.normal(2.0, 3.0, (n, 4000)).sum(axis=0) for n in counts])
    found = standard_error(sums, counts)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(3.0 / np.sqrt(counts.sum()), rel=0.02)
    assert np.isnan(standard_error(sums[:1], counts[:1])).all()


@pytest.mark.evidence
def test_a_points_error_covers_the_truth_as_often_as_it_should() -> None:
    points = np.array([0, 0.5, 0]) + np.random.default_rng(0).uniform(-0.4, 0.4, (40, 3))
    truth = glpath.irradiance(BOX, points, [0, 1, 0], spp=8192, seed=99).values
    inside = []
    for seed in range(6):
        found = glpath.irradiance(BOX, points, [0, 1, 0], spp=64, seed=seed)
        inside.append(np.abs(found.values - truth) <= 2 * found.standard_errors)
    assert np.mean(inside) > 0.85  # of a normal distribution 0.95; of so few batches' t 0.91


#: A meadow that sends nothing back, under the CIE standard overcast sky: a third as bright at the horizon as at the
#: zenith, by the sine of the elevation. On open ground it makes 100 lx, so that lux are per cent.
ZENITH = 100 * 9 / (7 * np.pi)
OVERCAST: dict[str, Any] = {
    "unit": "photometric",
    "camera": {"position": [0, -3, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 40},
    "materials": {"black": {"reflectance": 0}},
    "sky": {"zenith": [ZENITH] * 3, "horizon": [ZENITH / 3] * 3, "up": [0, 0, 1]},
    "shapes": [
        {
            "type": "quad",
            "corners": [[-900, -900, 0], [900, -900, 0], [900, 900, 0], [-900, 900, 0]],
            "material": "black",
        }
    ],
}


def test_daylight_factors_are_those_of_the_overcast_sky() -> None:
    """Out of doors 100 %; on what stands upright (BRE's vertical sky component) 39.6 %, by a formula
    (pi / 2 + 4 / 3) / (7 pi / 3); of a cylinder, which stands upright all around, the same."""
    up, across = [0, 0, 1.0], [0.6, -0.8, 0]
    upright = (np.pi / 2 + 4 / 3) / (7 * np.pi / 3)
    assert upright == pytest.approx(0.396, abs=5e-4)
    found = glpath.irradiance(OVERCAST, [[0, 0, 1]] * 2, [up, across], spp=1024)
    np.testing.assert_allclose(found.illuminance(), [100, 100 * upright], rtol=0.01)
    around = glpath.irradiance(OVERCAST, [[0, 0, 1]], up, receiver="cylinder", spp=4096)
    np.testing.assert_allclose(around.values, 100 * upright, rtol=0.02)


def test_a_cylinder_has_the_mean_of_all_directions_around_it(scene: Path, tmp_path: Path) -> None:
    """Of a lamp at a distance r, at an angle to the axis: I sin(angle) / (pi r^2), exactly but for 0.2 %."""
    points = np.array([[1.0, 0, 1], [0.3, -1.5, 1.2], [-2, 0.5, 0.1]])
    r = np.linalg.norm([0, 0, 2] - points, axis=1)
    sine = np.hypot(points[:, 0], points[:, 1]) / r
    expected = 179 * (0.2126 * 3 + 0.7152 * 2 + 0.0722) * sine / (np.pi * r**2)
    options: dict[str, Any] = {"receiver": "cylinder", "spp": 32, "max_depth": 1}
    for axis in ([0, 0, 1], [0, 0, -2]):
        found = glpath.irradiance(scene, points, axis, **options)
        np.testing.assert_allclose(found.illuminance(), expected, rtol=2.1e-3)
    table = tmp_path / "points.csv"
    table.write_text("\n".join(",".join(map(str, p)) for p in points))
    asked = ("--points", table, "--normal", "0,0,1", "--receiver", "cylinder")
    result = cli(scene, *asked, "--spp", 32, "--max-depth", 1, "-q", "-o", "-")
    rows = np.genfromtxt(result.stdout.splitlines(), delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[:, 12], expected, rtol=2.1e-3)
    with pytest.raises(glpath.UsageError, match="receiver"):
        glpath.irradiance(scene, points, [0, 0, 1], receiver="ball")  # type: ignore[arg-type]


def test_what_has_no_light_is_told_apart_from_the_rest(tmp_path: Path) -> None:
    """A box on the floor, with points inside."""
    path = tmp_path / "boxed.toml"
    path.write_text(LIT + '[[shapes]]\ntype = "box"\nmin = [0.6, 0.6, 0]\nmax = [2, 2, 1.5]\n')
    pytest.importorskip("matplotlib")
    out = tmp_path / "lux.csv"
    asked = (
        "--plane",
        "z=0.5",
        "--spacing",
        0.5,
        "--spp",
        16,
        "--max-depth",
        1,
        "-o",
        out,
        "-o",
        tmp_path / "lux.png",
    )
    result = cli(path, *asked)
    assert result.exit_code == 0, result.stderr
    table = np.genfromtxt(out, delimiter=",", skip_header=1)
    inside = (table[:, 0] > 0.6) & (table[:, 0] < 2) & (table[:, 1] > 0.6)
    lux = table[:, 12]
    assert (lux[inside] == 0).all()
    dark = (lux == 0).sum()
    assert f"  {dark} points have no light at all: inside of solids, perhaps. Without them:" in result.stderr
    assert inside.sum() == 9
    lit = lux[lux > 0]
    assert f"U0 {lit.min() / lit.mean():.3f}, Ud {lit.min() / lit.max():.3f}" in result.stderr
    assert "U0 0.000, Ud 0.000" in result.stderr


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        ([0, 0, 1], [0, 0, 1], r"points: of shape \(3,\)"),
        ([], [0, 0, 1], "points: of shape"),
        ([[0, 0, 1]], [0, 0], r"normals: of shape \(2,\)"),
        ([[0, 0, 1], [0, np.nan, 1]], [0, 0, 1], r"points\[1\]: .*finite numbers"),
        ([[0, 0, 1], [0, 0, 1]], [[0, 0, 1], [0, 0, 0]], r"normals\[1\]: .*other than zero"),
        ([[1e300, 0, 1]], [0, 0, 1], r"points\[0\]: \[1e\+300, 0.0, 1.0\] where finite numbers from"),
        ("here", [0, 0, 1], "points: 'here' where an array of numbers"),
        ([[0, 0, 1j]], [0, 0, 1], "an array of numbers"),
    ],
)
def test_what_are_no_points_is_told(points: Any, normals: Any, words: str) -> None:
    with pytest.raises(glpath.UsageError, match=words):
        glpath.irradiance(BOX, points, normals, spp=1)


def test_normals_are_of_any_length() -> None:
    values = [glpath.irradiance(BOX, POINTS, [0, z, 0], spp=1, max_depth=1).values for z in (1, 1e-200, 1e200)]
    assert np.array_equal(values[0], values[1])
    assert np.array_equal(values[0], values[2])


# The command.


def cli(*arguments: object, **more: Any) -> Result:
    return CliRunner().invoke(app, ["measure", *(str(a) for a in arguments)], **more)


def test_a_grid_is_measured_and_written(scene: Path, tmp_path: Path) -> None:
    out = [tmp_path / name for name in ("lux.csv", "lux.npz")]
    plane = ("--plane", "z=0", "--spacing", 1)
    result = cli(scene, *plane, "--spp", 16, "--max-depth", 1, *(f"-o{path}" for path in out))
    assert result.exit_code == 0, result.stderr
    table = np.genfromtxt(out[0], delimiter=",", skip_header=1)
    assert table.shape == (24, 14)
    np.testing.assert_allclose(table[:, 12], lux(table[:, 0], table[:, 1]), rtol=3e-5)
    with np.load(out[1]) as stored:
        assert stored["points"].shape == (4, 6, 3)
        assert stored["unit"] == "W m^-2"
        np.testing.assert_allclose(stored["illuminance"].ravel(), table[:, 12], rtol=1e-6)
        # Along x in columns, along y in rows, from the lower corner on.
        assert stored["points"][0, 0].tolist() == [-2.5, -1.5, 0]
        assert stored["points"][3, 5].tolist() == [2.5, 1.5, 0]
    mean, least = table[:, 12].mean(), table[:, 12].min()
    most = table[:, 12].max()
    assert f"mean {mean:.4g} lx, minimum {least:.4g}, maximum {most:.4g}" in result.stderr
    assert f"U0 {least / mean:.3f}, Ud {least / most:.3f}" in result.stderr
    assert "179 lm/W" in result.stderr


def test_points_of_a_table_are_measured(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text("# meters\nname;z;y;x;nx;ny;nz\ndesk;0;0.5;1;0;0;2\nfloor;0;0;0;0;0;1\n")
    result = cli(scene, "--points", table, "--spp", 1, "--max-depth", 1, "-q", "-o", "-")
    assert result.exit_code == 0, result.stderr
    rows = np.genfromtxt(result.stdout.splitlines(), delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[:, 12], lux(rows[:, 0], rows[:, 1]), rtol=3e-5)
    assert rows[:, :3].tolist() == [[1, 0.5, 0], [0, 0, 0]]


def test_a_picture_has_a_legend(scene: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    picture = tmp_path / "lux.png"
    result = cli(scene, "--plane", "z=0", "--spacing", 0.5, "--spp", 1, "--max-depth", 1, "-o", picture)
    assert result.exit_code == 0, result.stderr
    pixels = read_eight_bits(picture)
    assert pixels is not None
    assert min(pixels.shape[:2]) > 300


def test_grids_lie_where_they_are_asked_for() -> None:
    scene = load_scene(BOX)
    lower, upper = scene.bounds
    down = plane_grid(scene, "-y=0.4")
    assert (down.normals == [0, -1, 0]).all()
    assert (down.points[:, 1] == 0.4).all()
    assert down.grid is not None
    np.testing.assert_allclose(down.grid.extent, [lower[0], upper[0], lower[2], upper[2]], atol=down.grid.step[0])
    part = plane_grid(scene, "x=0", spacing=0.25, area=(0, 1, 1, 3))
    assert part.grid is not None
    assert part.grid.shape == (8, 4)
    assert part.points[[0, -1]].tolist() == [[0, 0.125, 1.125], [0, 0.875, 2.875]]
    # What is not a whole number of steps is left over evenly.
    assert plane_grid(scene, "x=0", spacing=0.4, area=(0, 0, 1, 1)).points[0].tolist() == pytest.approx(
        [0, 0.3, 0.3]
    )
    inner = plane_grid(scene, "x=0", spacing=0.5, area=[[0, 0], [3, 2]], margin=0.5, normal=(0, 0, 2))
    assert inner.points[[0, -1]].tolist() == [[0, 0.75, 0.75], [0, 2.25, 1.25]]
    assert (inner.normals == [0, 0, 2]).all()


def test_a_standard_s_grid_has_the_points_of_its_tables() -> None:
    """EN 12464-1, table A.1: lengths in metres and how many points there are along them at least; where the
    formula differs, by one. And what egrid (F. Rudawski) makes of 5 x 4 m."""
    for length, count in {1: 5, 2: 6, 5: 8, 10: 10, 25: 12, 50: 17, 100: 20}.items():
        assert abs(en_12464_counts(length, length)[0] - count) <= 1, length
    assert en_12464_counts(5, 4) == (8, 6)
    assert en_12464_counts(4, 5) == (6, 8)
    # A corridor's spacing is that of its width.
    assert en_12464_counts(20, 2) == (60, 6)
    assert en_12464_counts(1000, 1000) == (100, 100)
    found = plane_grid(load_scene(BOX), "y=1", spacing="en12464-1", area=(0, 0, 5, 4)).grid
    assert found is not None
    assert (found.shape, found.step) == ((6, 8), (5 / 8, 4 / 6))
    np.testing.assert_allclose(found.extent, [0, 5, 0, 4], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "neither"),
        (["--plane", "z=0", "--points", "a.csv"], "--plane beside --points"),
        (["--plane", "w=1"], "expected AXIS=HEIGHT"),
        (["--plane", "z"], "--plane z:"),
        (["--plane", "zz=1"], "expected AXIS=HEIGHT"),
        (["--plane", "z=0", "--spacing", "-1"], "--spacing -1: must be from 1e-15 to 1e+15"),
        (["--plane", "z=0", "--spacing", "en"], "in scene units, or en12464-1"),
        (["--plane", "z=0", "--margin", "2"], "--margin 2: leaves nothing of 6 x 4"),
        (["--plane", "z=0", "--margin", "-1"], "--margin -1: must be from 0"),
        (["--points", "a.csv", "--margin", "0"], "--margin: belongs to --plane"),
        (["--plane", "z=0", "--receiver", "sphere"], "Allowed: plane, cylinder"),
        (["--plane", "z=0", "--spacing", "1e-6"], "at most 4,000,000"),
        (["--plane", "z=0", "--area", "0,0,0,1"], "second corner must lie beyond"),
        (["--plane", "y=0", "--area=-1e308,-1e308,1e308,1e308"], "must be from -1e+15 to 1e+15"),
        (
            ["--plane", "y=0", "--area=-1e308,-1e308,1e308,1e308", "--spacing", "en12464-1"],
            "must be from -1e+15 to 1e+15",
        ),
        (["--plane", "y=0", "--area=-1e15,-1e15,1e15,1e15", "--spacing", "1e-15"], "at most 4,000,000"),
        (["--plane", "y=0", "--area=-1e15,0,1e15,1e-15", "--spacing", "en12464-1"], "at most 4,000,000"),
        (["--plane", "y=0", "--area", "0,0,1e-323,1e-323"], "second corner must lie beyond"),
        (["--plane", "y=1e300"], "--plane y=1e300: must be from -1e+15 to 1e+15"),
        (["--plane", "z=0", "--spacing", "1e-310"], "must be from 1e-15 to 1e+15"),
        (["--plane", "y=0", "--margin", "1e300"], "--margin 1e+300: must be from 0 to 1e+15"),
        (["--plane", "y=1_0"], "expected AXIS=HEIGHT in finite numbers"),
        (["--plane", "y=0", "--area", "0,0,1_0,\u0661"], "expected A,B,A,B in finite numbers"),
        (["--points", "a.csv", "--area", "0,0,1,1"], "--area: belongs to --plane"),
        (["--points", "nothing.csv"], "cannot be read"),
        (["--plane", "z=0", "--integrator", "t-buffer"], "Allowed: auto, path, path-buffer, gather"),
        (["--plane", "z=0", "--spp", "0"], "--spp 0"),
        (["--plane", "z=0", "-o", "lux.exr"], "Files end in .csv, .npz, .html, .png, .glb, .vtp"),
        (["--points", "a.csv", "-o", "lux.png"], "a picture is of a grid"),
        (["--points", "a.csv", "-o", "lux.glb"], "a picture is of a grid"),
        (["--plane", "z=0", "--maintenance-factor", "2"], "--maintenance-factor 2: must be above 0, up to 1"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_name(scene: Path, arguments: list[str], words: str) -> None:
    result = cli(scene, "-o", "-", *arguments)
    assert result.exit_code in (1, 2)
    assert words.lower() in result.stderr.lower()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no point"),
        ("x,y,z\n", "holds no point"),
        ("1,2\n", "line 1: 2 numbers where 3"),
        ("x,y\n1,2\n", "line 1: has no column z"),
        ("x,y,z,x\n", "line 1: has two columns x"),
        ("x,y,z,nx\n1,2,3,0\n", "line 1: has no column ny"),
        ("x,y,z\n1,2,3\n\n1,b,3\n", "line 4: y is 'b'"),
        ("1,2,3\n1,nan,3\n", "line 2: y is 'nan'"),
        ("1,2,3\n1,2\n", "line 2: 2 values where there are 3"),
        ("0,0,0,0,0,1\n0,0,0,0,0,0\n", "line 2: the normal is 0, 0, 0"),
        ("0,0,0\n", "has no normals"),
        ('1,2,"3\n1,2,3\n', "line 1: is no line of a table"),
    ],
)
def test_a_broken_table_is_told_by_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(glpath.UsageError) as caught:
        read_points(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbfx;y;z;nx;ny;nz\r\n0,5;1,25;-2;0;0;1\r\n;;;;;\r\n3;4e-1;5;0;0,5;0\r\n",  # a German Excel
        b'sep=;\r\n"x";"y";"z";"nx";"ny";"nz";\r\n0.5;1.25;-2;0;0;1;\r\n3;0.4;5;0;0.5;0;\r\n',
        "x\ty\tz\tnx\tny\tnz\r\n0,5\t1,25\t-2\t0\t0\t1\r\n3\t0,4\t5\t0\t0,5\t0\r\n".encode("utf-16"),
        b"0.5\t1.25\t-2\t0\t0\t1\t\n3\t.4\t5\t0\t0.5\t0\t\n",  # Radiance's rcalc
        b"0.5 1.25 -2\t0 0 1\n3 0.4 5\t0 0.5 0\n",
        b"  0.5   1.25  -2 0 0 1 \n 3 0.4 5  0 .5 0",
        b"0,5 1,25 -2 0 0 1\n3 0,4 5 0 0,5 0\n",
        b"x, y, z, nx, ny, nz, name\n0.5, 1.25, -2, 0, 0, 1, desk\n3, 0.4, 5, 0, 0.5, 0,\n",
    ],
    ids=["bom and commas", "sep", "utf-16", "tabs at ends", "tab between", "blanks", "blanks and commas", "names"],
)
def test_tables_are_read_as_programs_write_them(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(content)
    found = read_points(path)
    assert found.points.tolist() == [[0.5, 1.25, -2], [3, 0.4, 5]]
    assert found.normals.tolist() == [[0, 0, 1], [0, 0.5, 0]]


def test_what_a_comma_means_is_not_guessed(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x;y;z;nx;ny;nz\n1,250;2.5;0;0;0;1\n")
    with pytest.raises(glpath.UsageError, match="line 2: x is '1,250' where a finite number"):
        read_points(path)
    path.write_bytes("x,y,z,Höhe\n".encode("latin-1"))
    with pytest.raises(glpath.UsageError, match="not UTF-8 text"):
        read_points(path)


def test_a_normal_is_given_once(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("0,0,0\n1,2,3\n")
    assert read_points(path, (0.0, 1.0, 0.0)).normals.tolist() == [[0, 1, 0], [0, 1, 0]]
    with pytest.raises(glpath.UsageError, match=r"normal=\(0, 0, 0\): looks nowhere"):
        read_points(path, (0.0, 0.0, 0.0))
    path.write_text("0,0,0,0,0,1\n")
    with pytest.raises(glpath.UsageError, match="beside the normals"):
        read_points(path, (0.0, 1.0, 0.0))


#: A closed box of 4 x 2.7 x 5, y up, as modellers write it: no lamp, no camera.
ROOM_OBJ = """
v 0 0 0\nv 4 0 0\nv 4 2.7 0\nv 0 2.7 0\nv 0 0 5\nv 4 0 5\nv 4 2.7 5\nv 0 2.7 5
f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 4 3 7 8\nf 1 4 8 5\nf 2 6 7 3
"""


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / "room.obj"
    path.write_text(ROOM_OBJ)
    return path


def test_light_is_not_invented(room: Path, tmp_path: Path) -> None:
    """Pictures of a model without lamps have a studio; measuring refuses it, until it is asked for."""
    ground = tmp_path / "ground.obj"
    ground.write_text("v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 4 3 2 1\n")
    refused = cli(ground, "--plane", "y=0.75", "--spp", 1, "-o", "-")
    assert refused.exit_code == 1
    assert f"{ground}: has no light to measure" in refused.stderr
    assert "--white-sky" in refused.stderr
    assert refused.stdout == ""
    with pytest.raises(glpath.SceneError, match="has no light to measure"):
        glpath.irradiance(ground, [[0, 1, 0]], [0, 1, 0], spp=1)
    with pytest.warns(glpath.SceneWarning, match="so a studio lights it"):
        loaded = load_scene(ground)
    with pytest.raises(glpath.SceneError, match="white_sky=True"):
        glpath.irradiance(loaded, [[0, 1, 0]], [0, 1, 0], spp=1)
    asked = cli(ground, "--plane", "y=0.75", "--spp", 64, "--white-sky", "-o", "-")
    assert asked.exit_code == 0, asked.stderr
    assert "warning" not in asked.stderr  # neither of the camera nor of the sky
    assert "light: a white sky of radiance 1 from all around\n" in asked.stderr
    rows = np.genfromtxt(asked.stdout.splitlines(), delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[:, 6], np.pi, rtol=0.1)
    assert rows[:, 6].mean() == pytest.approx(np.pi, rel=0.005)
    dark = cli(room, "--plane", "y=0.75", "--spp", 1, "--white-sky", "-o", "-")
    assert "no light comes to any of the points: they are inside of solids, or in a closed room" in dark.stderr


def test_a_scene_with_light_is_lit_by_no_other(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(glpath.UsageError, match="has light of its own"):
        glpath.irradiance(scene, [[0, 0, 1]], [0, 0, 1], spp=1, white_sky=True)
    black = tmp_path / "black.toml"
    black.write_text(LIT[: LIT.index("[[lights]]")])
    with pytest.raises(glpath.SceneError, match="has no light to measure"):
        glpath.irradiance(black, [[0, 0, 1]], [0, 0, 1], spp=1)
    black.write_text("ambient = 0.5\n" + black.read_text())
    found = glpath.irradiance(black, [[0, 0, 1]], [0, 0, 1], spp=4, max_depth=1)
    np.testing.assert_allclose(found.values, 0.5 * np.pi, rtol=1e-5)


def test_what_glows_in_a_model_is_measured_without_the_sky_that_pictures_have(tmp_path: Path) -> None:
    """A panel of radiance 1 as a viewer's screen, one unit over a floor: Lambert's formula, and no sky besides."""
    trimesh = pytest.importorskip("trimesh")
    panel = trimesh.Trimesh([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]], [[0, 1, 2], [0, 2, 3]], process=False)
    panel.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((4, 2)),
        material=trimesh.visual.material.PBRMaterial(
            emissiveFactor=[1, 1, 1], baseColorFactor=[0, 0, 0, 255], doubleSided=True
        ),
    )
    path = tmp_path / "panel.glb"
    trimesh.Scene([panel]).export(path)
    with pytest.warns(glpath.SceneWarning, match="measured without the studio"):
        found = glpath.irradiance(path, [[0, 0, 0]], [0, 1, 0], spp=256, max_depth=1)
    half = np.arctan(1 / np.sqrt(2)) / np.sqrt(2)
    np.testing.assert_allclose(found.values[0], 4 * half, rtol=0.01)
    lit = glpath.irradiance(path, [[0, 0, 0]], [0, 1, 0], spp=64, max_depth=1, white_sky=True)
    assert lit.values.min() > 0.9 * np.pi


def test_planes_are_held_against_the_scene(room: Path, scene: Path) -> None:
    asked = ("--spp", 1, "--white-sky", "-o", "-")
    beyond = cli(room, "--plane", "z=5.75", *asked)
    assert beyond.exit_code == 0
    assert "--plane z=5.75: all points lie outside the scene, which reaches from z = 0 to 5" in beyond.stderr
    assert "A working plane is y=HEIGHT, if y is up" in beyond.stderr
    upright = cli(room, "--plane", "z=0.75", *asked)
    assert "warning" not in upright.stderr
    assert "plane: z = 0.75, x from 0 to 4, " in upright.stderr
    assert "it stands upright, if y is up: a working plane is y=HEIGHT" in upright.stderr
    assert "upright" not in cli(room, "--plane", "y=0.75", *asked).stderr
    metres = cli(room, "--plane", "y=750", *asked)
    assert metres.exit_code == 2
    assert "reaches from y = 0 to 2.7, and is 5 wide" in metres.stderr
    # Between a floor and its lamp, as lamps are in the scene.
    assert "warning" not in cli(scene, "--plane", "z=0.5", "--spp", 1, "-o", "-").stderr


def test_bakes_of_a_model_without_light_say_what_lights_them(room: Path, tmp_path: Path) -> None:
    """They are pictures, which have a studio; but of the camera nobody need hear."""
    bare = tmp_path / "bare.toml"
    bare.write_text(LIT[LIT.index("[[shapes]]") :])
    for scene, light in ((room, "a studio, as the scene has no light of its own"), (bare, "1 punctual light")):
        result = CliRunner().invoke(
            app, ["radiosity", str(scene), "--patches", "20", "-o", str(tmp_path / "a.npz")]
        )
        assert result.exit_code == 0, result.stderr
        assert f"light: {light}" in result.stderr
        assert ("has no light, so a studio lights it" in result.stderr) == (scene == room)
        assert "camera" not in result.stderr


def test_a_scene_file_needs_no_camera_to_be_measured(scene: Path, tmp_path: Path) -> None:
    path, table = tmp_path / "bare.toml", tmp_path / "points.csv"
    path.write_text(LIT[LIT.index("[[shapes]]") :])
    table.write_text("0.5,0,0.3,0,0,1\n")
    rows = []
    for each in (scene, path):
        result = cli(each, "--points", table, "--spp", 4, "-o", "-")
        assert result.exit_code == 0, result.stderr
        assert "camera" not in result.stderr
        rows.append(result.stdout)
    assert rows[0] == rows[1]
    found = glpath.irradiance(path, [[0.5, 0, 0.3]], [0, 0, 1], spp=1, max_depth=1)
    assert found.illuminance()[0] == pytest.approx(lux(0.5, 0, 0.3), rel=2e-5)
    sensor = PointSensor.of([[[0.5, 0, 0.3]]], [[[0.0, 0, 1]]])
    job = RenderJob.from_json(RenderJob.of(path, sensor=sensor, spp=1, max_depth=1).to_json())
    np.testing.assert_allclose(np.pi * run(job, sensor=sensor).mean[0], found.values, rtol=1e-6)
    # What goes by the camera's up has to say where it goes.
    path.write_text(path.read_text() + "[sky]\nzenith = 1\nhorizon = 0.3\n")
    with pytest.raises(glpath.SceneError, match=r"sky\.up is missing"):
        glpath.irradiance(path, [[0, 0, 1]], [0, 0, 1], spp=1)
    path.write_text(
        path.read_text().replace("[sky]", '[[lights]]\ntype = "point"\nprofile = "a.ies"\nposition = [0, 0, 2]')
    )
    with pytest.raises(glpath.SceneError, match=r"lights\[1\]\.direction is missing"):
        glpath.irradiance(path, [[0, 0, 1]], [0, 0, 1], spp=1)


#: Few points, and about a millisecond a path set.
MEASURE = ("measure", BOX, "--plane", "y=0.5", "--spacing", "0.1", "--max-depth", "2")


def test_what_was_measured_when_a_signal_comes_is_written(tmp_path: Path) -> None:
    """Ctrl-C, in a process of its own, once there are path sets."""
    code, told = killing.struck(
        signal.SIGINT, "--spp", 10**6, "--checkpoint", "1h", "-o", tmp_path / "lux.csv", command=MEASURE
    )
    assert code == 130
    assert "interrupted: what" in told
    kept = tmp_path / "lux.checkpoint.npz"
    assert f"the same command with --resume continues from {kept}" in told
    assert len((tmp_path / "lux.csv").read_text().splitlines()) > 100
    assert f"interrupted: what {Film.load(kept).path_sets} paths of each point" in told


def test_kills_lose_nothing_that_was_measured(tmp_path: Path) -> None:
    """An .npz of points is no film: its checkpoint is beside it, and measuring resumes from it, bit-identical."""
    out, kept = tmp_path / "lux.npz", tmp_path / "lux.checkpoint.npz"
    counts = killing.kill_again_and_again(out, 3, seed=4, command=MEASURE, checkpoint=kept)
    assert 0 < counts[0] < counts[-1]
    other = cli(*MEASURE[1:-1], 3, "-o", out, "--resume")
    assert (other.exit_code, f"{kept}: cannot be resumed: max_depth is 2 in it, 3" in other.stderr) == (
        2,
        True,
    )
    assert "there already" in cli(*MEASURE[1:], "-o", out, "--checkpoint", "1h").stderr
    wanted = counts[-1] + 9
    for path, more in ((out, ["--resume"]), (tmp_path / "straight.npz", [])):
        assert cli(*MEASURE[1:], "-o", path, "--spp", wanted, "-q", *more).exit_code == 0
    assert sorted(os.listdir(tmp_path)) == ["lux.npz", "straight.npz"]
    with np.load(out) as found, np.load(tmp_path / "straight.npz") as straight:
        np.testing.assert_array_equal(found["illuminance"], straight["illuminance"])
        np.testing.assert_array_equal(found["standard_errors"], straight["standard_errors"])


def test_a_scheduler_s_signal_leaves_the_checkpoint_and_exit_code_75(tmp_path: Path) -> None:
    code, told = killing.struck(
        signal.SIGTERM, "--spp", 10**6, "--resume", "-o", tmp_path / "lux.csv", command=MEASURE
    )
    assert code == 75, told
    assert os.listdir(tmp_path) == ["lux.checkpoint.npz"]


def test_a_measurement_tells_programs_what_a_render_tells_them(tmp_path: Path) -> None:
    out, stats = tmp_path / "lux.csv", tmp_path / "stats.json"
    done = cli(*MEASURE[1:], "-o", out, "--noise", 0.2, "--stats", stats, "--progress", "json")
    assert done.exit_code == 0, done.stderr
    events = [json.loads(line) for line in done.stderr.splitlines()]
    assert events[0]["event"] == "progress"
    assert (events[-1]["event"], events[-1]["stop_rule"]) == ("done", "noise")
    assert events[-1]["files"] == [str(out)]
    told = json.loads(stats.read_text())
    assert (told["stop_rule"], told["files"]) == ("noise", [str(out)])
    assert told["path_sets"] == events[-1]["path_sets"]
    assert sum(told["stage_ms"].values()) > 0


def test_all_bounces_are_measured_by_themselves() -> None:
    """Five vertices are not enough; what is asked for counts."""
    sensor = PointSensor.of(np.zeros((1, 1, 3)), np.array([[[0.0, 1.0, 0.0]]]))
    for asked, depth, roulette in (({}, DEEPEST, 4), ({"max_depth": 2}, 2, None)):
        settings = RenderJob.of(BOX, integrator="path", sensor=sensor, **asked).integrator
        assert isinstance(settings, PathSettings)
        assert (settings.max_depth, settings.roulette) == (depth, roulette)
    found = [glpath.irradiance(BOX, POINTS, [0.0, 1.0, 0.0], spp=2048, **a).values for a in ({}, {"max_depth": 5})]
    assert found[0].mean() > 1.003 * found[1].mean()


def test_points_beside_streamed_triangles_are_measured_by_default() -> None:
    materials = {"grey": {"type": "diffuse", "reflectance": 0.5}}
    shapes = [{"type": "stream", "stream": Hills(1, 2), "material": "grey"}]
    scene = {"materials": materials, "shapes": shapes, "sky": {"zenith": 1, "horizon": 1}}
    made = glpath.load_scene({**scene, "camera": {"position": [0, 9, 9], "target": [0, 0, 0]}})
    options: dict[str, Any] = {"spp": 256, "seed": 3}
    found = glpath.irradiance(made, [[0.0, 9.0, 0.0]], [0.0, 1.0, 0.0], **options)
    assert found.film.metadata.integrator == "path-buffer"
    asked = glpath.irradiance(made, [[0.0, 9.0, 0.0]], [0.0, 1.0, 0.0], integrator="path-buffer", **options)
    assert np.array_equal(found.values, asked.values)
    assert found.values[0] == pytest.approx(np.pi, rel=0.05), (
        "the whole sky, of radiance 1, by directions that all paths share"
    )


@pytest.mark.parametrize("which", [99, [0], [True, False], "x"])
def test_spread_of_points_that_are_not_one_flag_each_is_refused(which: Any) -> None:
    found = glpath.irradiance("cornell-box-36", [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0], spp=1)
    with pytest.raises(glpath.UsageError, match="which"):
        found.spread(which)


@pytest.mark.parametrize("shape", [(-1, -1), (1.0,), (1,) * 10, 5])
def test_grid_of_a_wrong_shape_is_refused(shape: Any) -> None:
    found = glpath.irradiance("cornell-box-36", [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0], spp=1)
    with pytest.raises(glpath.UsageError, match="shape"):
        found.to_xarray(shape=shape)
