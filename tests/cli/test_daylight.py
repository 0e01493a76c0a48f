"""`glpath daylight`: the file it writes, what it prints, and wrong usage."""

from __future__ import annotations

import errno
import gc
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.cli.daylight_shown import OF_YEARS
from glpath.cli.main import app
from glpath.cli.scene import read_scene
from tests.io.test_vtk import arrays
from tests.support.weather_files import write_epw

# Few elements are enough here.
pytestmark = pytest.mark.filterwarnings("ignore:.*bias of the reflected light")


@pytest.fixture(scope="module")
def coefficients() -> DaylightCoefficients:
    """Coefficients of the points of `sensors`, with the sun positions of the weather that tests write."""
    at = [[0.0, 0, 0], [0.3, 0.1, 0.2]]
    return glpath.daylight_coefficients(
        "cornell-box", at, [0.0, 1, 0], samples=2, suns=30, max_depth=1, latitude=47.5
    )


@pytest.fixture
def computations(monkeypatch: pytest.MonkeyPatch, coefficients: DaylightCoefficients) -> list[DaylightCoefficients]:
    """Replace the computation by a result, and return the list of results that the command has got."""
    results: list[DaylightCoefficients] = []

    def compute(*_: object, **options: object) -> DaylightCoefficients:
        results.append(replace(coefficients))
        return results[-1]

    monkeypatch.setattr("glpath.apps.daylight.compute.daylight_coefficients", compute)
    return results


@pytest.fixture
def sensors(tmp_path: Path) -> Path:
    path = tmp_path / "sensors.csv"
    path.write_text("x,y,z,nx,ny,nz\n0,0,0,0,1,0\n0.3,0.1,0.2,0,1,0\n")
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["daylight", *map(str, arguments)])


def test_the_command_writes_what_the_call_returns(tmp_path: Path, sensors: Path) -> None:
    out = tmp_path / "dc.npz"
    options = ("--samples", 2, "--latitude", 40, "--suns", 30, "--north", "1,0,0", "--resume")
    options += ("--elements", 60, "--gather-rays", 256)
    done = run("cornell-box", "-o", out, "--points", sensors, *options)
    assert done.exit_code == 0, done.output
    assert "2 sensors, 145 patches of the sky and the ground, " in done.output
    assert "sky view factor: mean" in done.output
    found = glpath.DaylightCoefficients.load(out)
    at, up = [[0.0, 0, 0], [0.3, 0.1, 0.2]], [0.0, 1, 0]
    expected = glpath.daylight_coefficients(
        "cornell-box", at, up, samples=2, latitude=40.0, suns=30, north=[1, 0, 0], elements=60, gather_rays=256
    )
    assert np.array_equal(found.words, expected.words)
    assert np.allclose(found.sky(), expected.sky())
    assert "of the light under a uniform sky is reflected" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dc.npz", "sensors.csv"]


def test_shards_merge_to_the_file_of_one_run(tmp_path: Path, sensors: Path) -> None:
    parts = [tmp_path / f"{k}.npz" for k in (1, 2)]
    options = ("--points", sensors, "--samples", 2, "--max-depth", 1)
    for k, part in enumerate(parts, start=1):
        done = run("cornell-box", "-o", part, "--shard", f"{k}/2", *options)
        assert done.exit_code == 0, done.output
    out = tmp_path / "dc.npz"
    done = CliRunner().invoke(app, ["merge", *map(str, parts), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "2 sensors of 2 shards" in done.output
    at = [[0.0, 0, 0], [0.3, 0.1, 0.2]]
    expected = glpath.daylight_coefficients("cornell-box", at, [0.0, 1, 0], samples=2, max_depth=1)
    assert np.array_equal(glpath.DaylightCoefficients.load(out).words, expected.words)
    for wrong, text in (
        (["merge", parts[0], "-o", tmp_path / "dc.png"], "no picture"),
        (["merge", parts[0], "-o", out, "--exposure", 1], "no picture"),
        (["daylight", "cornell-box", "-o", out, "--shard", "3/2", *options], "K/N"),
        (
            ["daylight", parts[0], "-o", tmp_path / "y.csv", "--weather", write_epw(tmp_path / "a.epw")],
            "is a shard",
        ),
    ):
        done = CliRunner().invoke(app, list(map(str, wrong)))
        assert done.exit_code != 0
        assert text in done.output, done.output


def test_wrong_usage_is_refused_before_anything_is_computed(tmp_path: Path, sensors: Path) -> None:
    for wrong, text in (
        (("-o", tmp_path / "dc.csv", "--points", sensors), ".npz"),
        (("-o", tmp_path / "dc.npz", "--points", sensors, "--receiver", "cube"), "cube"),
        (("-o", tmp_path / "dc.npz", "--points", sensors, "--subdivision", 3), "577 patches"),
        (("-o", tmp_path / "dc.npz", "--points", sensors, "--latitude", 95), "from -90 to 90"),
        (("-o", tmp_path / "dc.npz", "--points", tmp_path / "none.csv"), "none.csv"),
    ):
        done = run("cornell-box", *wrong)
        assert done.exit_code != 0
        assert text in done.output, done.output
    assert not (tmp_path / "dc.npz").exists()


def test_a_year_from_the_scene_and_from_its_coefficients(tmp_path: Path, sensors: Path) -> None:
    """Files of both are alike, and blinds of the same scene change nothing but the name."""
    epw = write_epw(tmp_path / "nowhere.epw")
    dc, csv, again = tmp_path / "dc.npz", tmp_path / "year.csv", tmp_path / "again.csv"
    options = ("--points", sensors, "--samples", 2, "--suns", 30, "--max-depth", 1)
    done = run("cornell-box", "-o", csv, "-o", dc, "--weather", epw, "--occupied", "9-17", *options)
    assert done.exit_code == 0, done.output
    assert "2,920 occupied hours" in done.output
    assert "sDA counts with blinds" in done.output
    done = run(dc, "-o", again, "--weather", epw, "--occupied", "9-17", "--blinds", dc)
    assert done.exit_code == 0, done.output
    assert "sDA300/50%: " in done.output
    assert again.read_bytes() == csv.read_bytes()
    assert "has coefficients already" in run(dc, "-o", tmp_path / "other.npz").output
    assert csv.read_text().startswith("x,y,z,nx,ny,nz,daylight_autonomy,")


def test_wrong_usage_of_a_year_is_refused_before_anything_is_computed(tmp_path: Path, sensors: Path) -> None:
    epw = write_epw(tmp_path / "nowhere.epw")
    year = ("cornell-box", "-o", tmp_path / "year.nc", "--points", sensors)
    for wrong, text in (
        (year, "--weather"),
        ((*year, "--weather", tmp_path / "none.epw"), "none.epw"),
        ((*year, "--weather", epw, "--latitude", 40), "--latitude"),
        ((*year, "--weather", epw, "--occupied", "8"), "8-18"),
        ((*year, "--weather", epw, "--threshold", "inf"), "a finite number above 0"),
        ((*year[:3], "--weather", epw), "No --points"),
        (("cornell-box", "-o", tmp_path / "dc.npz", "--points", sensors, "--blinds", "office"), "--weather"),
        *(
            ((*year[:2], tmp_path / "dc.npz", "--points", sensors, *typed), f"{typed[0]}: is of a year")
            for typed in (("--occupied", "garbage"), ("--threshold", -5), ("--ground", 7))
        ),
        ((*year[:2], tmp_path / "dc.npz", "--points", sensors, "--no-hours"), "--hours/--no-hours: is of a year"),
        ((tmp_path / "none.npz", "-o", tmp_path / "other.npz"), "there is no such file"),
        (("cornell-box", "-o", tmp_path / "year.txt", "--points", sensors, "--weather", epw), ".nc or .csv"),
    ):
        done = run(*wrong)
        assert done.exit_code != 0
        assert text in done.output, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["nowhere.epw", "sensors.csv"]


def _until_february(row: int, fields: list[str]) -> list[str] | None:
    return fields if row < 59 * 24 else None


def test_wrong_blinds_and_hours_of_a_year_are_refused_before_anything_is_computed(
    tmp_path: Path, sensors: Path, computations: list[DaylightCoefficients]
) -> None:
    epw = write_epw(tmp_path / "nowhere.epw")
    part = write_epw(tmp_path / "part.epw", change=_until_february)
    part.write_text(part.read_text().replace(" 1/ 1,12/31", " 1/ 1, 2/28"))
    start = ("cornell-box", "-o", tmp_path / "dc.npz", "-o", tmp_path / "year.csv", "--points", sensors)
    for wrong, text in (
        (("--weather", epw, "--blinds", tmp_path / "none.toml"), "none.toml"),
        (("--weather", epw, "--blinds", tmp_path / "none.npz"), "none.npz"),
        (("--weather", epw, "--occupied", "8.2-8.9"), "lies from 8.2 to 8.9"),
        (("--weather", part, "--strict"), "has 1,416 of the 8,760 hours of a year"),
    ):
        done = run(*start, *wrong)
        assert done.exit_code != 0
        assert text in done.output, done.output
    assert not computations


def test_one_scene_at_a_time_is_in_memory_while_daylight_is_computed(
    tmp_path: Path, sensors: Path, coefficients: DaylightCoefficients, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes: list[weakref.ref[glpath.Scene]] = []
    counts: list[int] = []

    def read(*arguments: Any) -> glpath.Scene:
        scene = replace(read_scene(*arguments))
        scenes.append(weakref.ref(scene))
        return scene

    def compute(*_: object, **options: object) -> DaylightCoefficients:
        gc.collect()
        counts.append(sum(scene() is not None for scene in scenes))
        return replace(coefficients)

    monkeypatch.setattr("glpath.cli.daylight.read_scene", read)
    monkeypatch.setattr("glpath.apps.daylight.compute.daylight_coefficients", compute)
    blinds = tmp_path / "closed.obj"
    blinds.write_text("mtllib none.mtl\nv -1 -1 -1\nv 1 -1 -1\nv 1 1 1\nf 1 2 3\n")
    start = ("cornell-box", "-o", tmp_path / "year.csv", "--points", sensors)
    epw = write_epw(tmp_path / "nowhere.epw")
    done = run(*start, "--weather", epw, "--blinds", blinds, "--blinds", "cornell-box")
    assert done.exit_code == 0, done.output
    assert counts == [1, 1, 1]
    assert done.output.count("none.mtl") == 1, "the warnings of a scene that is read again are not repeated"


def _interrupt(*_: object, **options: object) -> None:
    raise KeyboardInterrupt


def _lack_memory(*_: object, **options: object) -> None:
    raise MemoryError


@pytest.mark.parametrize("is_output", [True, False], ids=["output", "rescue"])
@pytest.mark.parametrize("fault", ["interrupt", "memory", "other sensors"])
def test_computed_coefficients_survive_a_failure_of_the_year(
    fault: str,
    is_output: bool,
    tmp_path: Path,
    sensors: Path,
    coefficients: DaylightCoefficients,
    computations: list[DaylightCoefficients],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    others = tmp_path / "others.npz"
    glpath.daylight_coefficients("cornell-box", [[0.0, 0, 0]], [0.0, 1, 0], samples=2, max_depth=1).save(others)
    if fault == "interrupt":
        monkeypatch.setattr("glpath.apps.daylight.year.metrics.blinds_closed", _interrupt)
    elif fault == "memory":
        monkeypatch.setattr("glpath.apps.daylight.year._count", _lack_memory)
    blinds = others if fault == "other sensors" else "cornell-box"
    outputs = ["-o", tmp_path / "year.csv", *(["-o", tmp_path / "dc.npz"] if is_output else [])]
    epw = write_epw(tmp_path / "nowhere.epw")
    done = run("cornell-box", *outputs, "--points", sensors, "--weather", epw, "--blinds", blinds)
    assert done.exit_code == (130 if fault == "interrupt" else 2 if fault == "other sensors" else 1), done.output
    kept = [tmp_path / "dc.npz"] if is_output else [*tmp_path.glob("glpath-*/year.npz")]
    kept += [*tmp_path.glob("glpath-*/*.blinds.npz")]
    assert len(kept) == len(computations)
    for path in kept:
        assert np.array_equal(glpath.DaylightCoefficients.load(path).words, coefficients.words)
        assert str(path) in done.output
    assert not (tmp_path / "year.csv").exists()


@pytest.mark.parametrize("is_output", [True, False], ids=["output", "rescue"])
def test_computed_coefficients_survive_a_year_that_cannot_be_written(
    is_output: bool,
    tmp_path: Path,
    sensors: Path,
    coefficients: DaylightCoefficients,
    computations: list[DaylightCoefficients],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("numpy.savetxt", full)
    outputs = ["-o", tmp_path / "year.csv", "-o", tmp_path / ("dc.npz" if is_output else "year.nc")]
    epw = write_epw(tmp_path / "nowhere.epw")
    done = run("cornell-box", *outputs, "--points", sensors, "--weather", epw, "--blinds", "cornell-box")
    assert done.exit_code == 1, done.output
    assert "No space left on device" in done.output
    names = ["dc.npz", "dc.blinds.npz"] if is_output else ["year.npz", "year.blinds.npz"]
    kept = [*tmp_path.glob("*.npz"), *tmp_path.glob("glpath-*/*.npz")]
    assert sorted(path.name for path in kept) == sorted(names)
    for path in kept:
        assert np.array_equal(glpath.DaylightCoefficients.load(path).words, coefficients.words)
        assert str(path) in done.output


def _once(result: DaylightCoefficients) -> Callable[..., DaylightCoefficients]:
    """Return a computation that has a result, and that Ctrl-C ends when it is called again."""
    results = [result]

    def compute(*_: object, **options: object) -> DaylightCoefficients:
        if not results:
            raise KeyboardInterrupt
        return results.pop()

    return compute


def test_an_interrupt_while_blinds_are_computed_writes_the_coefficients(
    tmp_path: Path,
    sensors: Path,
    coefficients: DaylightCoefficients,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("glpath.apps.daylight.compute.daylight_coefficients", _once(coefficients))
    out, epw = tmp_path / "dc.npz", write_epw(tmp_path / "nowhere.epw")
    done = run("cornell-box", "-o", out, "--points", sensors, "--weather", epw, "--blinds", "cornell-box")
    assert done.exit_code == 130, done.output
    assert "nothing is kept of the closed blinds" in done.output
    assert f"The coefficients are kept in {out}." in done.output
    assert np.array_equal(glpath.DaylightCoefficients.load(out).words, coefficients.words)


def test_checkpoint_of_one_process_does_not_count_as_coefficients_because_it_has_no_reflected_light(
    tmp_path: Path,
    sensors: Path,
    coefficients: DaylightCoefficients,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("glpath.apps.daylight.compute.daylight_coefficients", _once(coefficients))
    start = ("cornell-box", "-o", tmp_path / "year.csv", "--points", sensors, "--resume")
    done = run(*start, "--weather", write_epw(tmp_path / "nowhere.epw"), "--blinds", "cornell-box")
    assert done.exit_code == 130, done.output
    (kept,) = tmp_path.glob("glpath-*/year.npz")
    assert f"The coefficients are kept in {kept}." in done.output
    assert np.array_equal(glpath.DaylightCoefficients.load(kept).words, coefficients.words)


def test_texels_are_sensors_and_show_the_year(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    trimesh = pytest.importorskip("trimesh")
    epw = write_epw(tmp_path / "nowhere.epw")
    dc, vtp, glb, again = (tmp_path / name for name in ("dc.npz", "year.vtp", "year.glb", "again.vtp"))
    asked = ("--receiver", "texels", "--texel-size", 150, "--texel-shape", "short*", "--texel-shape", "floor")
    options = ("--samples", 2, "--suns", 30, "--max-depth", 1, "--weather", epw)
    done = run("cornell-box", *(f"-o{path}" for path in (dc, vtp, glb, tmp_path / "year.csv")), *asked, *options)
    assert done.exit_code == 0, done.output
    expected = glpath.texels("cornell-box", 150, shapes=["short*", "floor"])
    assert f"{len(expected)} sensors" in done.output
    found = arrays(vtp)
    np.testing.assert_array_equal(found["Points/Points"].reshape(-1, 4, 3), expected.corners)
    kept = glpath.DaylightCoefficients.load(dc)
    np.testing.assert_array_equal(found["CellData/sky_view_factor"], kept.sky_view)
    table = np.genfromtxt(tmp_path / "year.csv", delimiter=",", names=True)
    np.testing.assert_allclose(kept.points[:, 1], table["y"], rtol=1e-5, atol=1e-5)
    for value in OF_YEARS:
        np.testing.assert_allclose(found[f"CellData/{value}"], table[value], rtol=1e-6)
    assert {name for name in found if name.startswith("CellData")} == {
        f"CellData/{name}" for name in (*OF_YEARS, "area", "shape")
    }
    (name,) = trimesh.load(glb, force="scene").geometry
    assert name == f"irradiation_year, 0 to {table['irradiation_year'].max():.4g} kWh m-2"
    # The file of coefficients has the faces, and needs no weather for the sky view factor.
    done = run(dc, "-o", again, "-o", glb, "--show", "sky_view_factor")
    assert done.exit_code == 0, done.output
    assert set(arrays(again)) >= {"CellData/sky_view_factor", "CellData/area"}
    (name,) = trimesh.load(glb, force="scene").geometry
    assert name.startswith("sky_view_factor, 0 to")


def test_points_are_shown_as_points(tmp_path: Path, sensors: Path) -> None:
    done = run("cornell-box", "-o", tmp_path / "a.vtp", "--points", sensors, "--samples", 2, "--max-depth", 1)
    assert done.exit_code == 0, done.output
    found = arrays(tmp_path / "a.vtp")
    np.testing.assert_array_equal(found["Points/Points"], [[0, 0, 0], [0.3, 0.1, 0.2]])
    assert found["PointData/sky_view_factor"].shape == (2,)


def test_wrong_usage_of_texels_is_refused_before_anything_is_computed(tmp_path: Path, sensors: Path) -> None:
    start = ("cornell-box", "-o", tmp_path / "a.glb")
    of_texels = (*start, "--receiver", "texels")
    for wrong, text in (
        (of_texels, "Give --texel-size"),
        ((*of_texels, "--texel-size", 0), "must be from 1e-15 to 1e+15"),
        ((*of_texels, "--texel-size", 1e-6), "at most 4,000,000"),
        ((*of_texels, "--texel-size", 100, "--texel-shape", "roof"), "no shape is called 'roof'"),
        ((*of_texels, "--texel-size", 1, "--points", sensors), "--points: beside --receiver texels"),
        ((*of_texels, "--texel-size", 1, "--normal", "0,1,0"), "--normal: beside --receiver texels"),
        ((*of_texels, "--texel-size", 1, "--show", "lux"), "There is sky_view_factor; with --weather others"),
        ((*start, "--points", sensors), "the sensors are points"),
        (
            (*start[:2], "a.vtp", "--points", sensors, "--texel-size", 0),
            "--texel-size: belongs to --receiver texels",
        ),
        ((*start, "--points", sensors, "--texel-size", 1), "--texel-size: belongs to --receiver texels"),
        (("cornell-box", "-o", tmp_path / "a.vtp", "--points", sensors, "--show", "x"), "--show: is what colours"),
    ):
        done = run(*wrong)
        assert done.exit_code != 0
        assert text in done.output, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sensors.csv"]


def test_options_of_the_computation_are_refused_beside_a_file_of_coefficients(tmp_path: Path) -> None:
    epw = tmp_path / "none.epw"
    start = ("dc.npz", "-o", tmp_path / "year.csv", "--weather", epw)
    options = ("--points", "a.csv", "--subdivision", 2, "--max-depth", 1, "--north", "1,0,0")
    options += ("--seed", 0, "-D", "a=1")
    done = run(*start, *options)
    assert done.exit_code == 2
    assert "--points, --subdivision, --max-depth, --north, --seed, -D: not used, because dc.npz" in done.output
    # A scene with closed blinds is computed with these options.
    done = run(*start, "--blinds", "closed.toml", *options)
    assert "none.epw" in done.output
    assert "not used" not in done.output
