"""What goes to an index: contents of wheel and sdist, their metadata, and types that check who uses them."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import glpath
from tests.support.repository import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PYTHONS = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]


def called(*command: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def tracked(*folders: str) -> set[str]:
    found = called("git", "ls-files", *folders)
    if found.returncode:
        pytest.skip("needs a git checkout")
    return set(found.stdout.split())


def test_the_tests_run_on_each_python_that_the_metadata_names() -> None:
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text("utf-8"))
    assert workflow["jobs"]["tests"]["strategy"]["matrix"]["python"] == PYTHONS == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["requires-python"] == f">={PYTHONS[0]}"


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert (citation["title"], citation["license"]) == (PROJECT["name"], PROJECT["license"])
    assert citation["version"] == PROJECT["version"]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A folder with hatchling and twine, the sdist, and the wheel that is made of it."""
    folder = tmp_path_factory.mktemp("built")
    got = called(sys.executable, "-m", "pip", "install", "-q", "--target", folder / "tools", "hatchling", "twine")
    if got.returncode:
        pytest.skip("needs hatchling and twine, which could not be installed")
    made = called(
        sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, PYTHONPATH=f"{folder}/tools"
    )
    assert made.returncode == 0, made.stderr
    (sdist,) = folder.glob("glpath-*.tar.gz")
    made = called(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, sdist)
    assert made.returncode == 0, made.stderr
    (wheel,) = folder.glob("glpath-*.whl")
    return folder / "tools", sdist, wheel


@pytest.mark.evidence
def test_the_wheel_holds_the_package_with_shaders_and_scenes_and_nothing_else(
    built: tuple[Path, Path, Path],
) -> None:
    wanted = tracked("glpath") | {f"glpath/{name}" for name in tracked("shaders", "scenes")}
    assert "glpath/py.typed" in wanted
    names = {name for name in zipfile.ZipFile(built[2]).namelist() if ".dist-info/" not in name}
    assert names == wanted


@pytest.mark.evidence
def test_the_sdist_holds_what_the_tests_need(built: tuple[Path, Path, Path]) -> None:
    with tarfile.open(built[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    ignored = {".gitignore", ".pre-commit-config.yaml"} | tracked(".github")
    assert names - {"PKG-INFO"} - {".gitignore"} == tracked() - ignored


@pytest.mark.evidence
def test_an_index_takes_both(built: tuple[Path, Path, Path]) -> None:
    checked = called(sys.executable, "-m", "twine", "check", "--strict", *built[1:], PYTHONPATH=str(built[0]))
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert checked.stdout.count("PASSED") == 2


PROGRAM = """
from pathlib import Path

import numpy as np

import glpath

film: glpath.Film = glpath.render("cornell-box", spp=4, integrator="path", max_depth=2, seed=1)
film.save(Path("a.png"), exposure=0.5)
mean = film.mean.astype(np.float64)
scene: glpath.Scene = glpath.load_scene("cornell-box")
solution = glpath.solve_radiosity(scene, patches=100)
reveal_type(solution)
"""


@pytest.mark.evidence
def test_a_type_checker_takes_a_program_and_finds_a_misspelt_option(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(PROGRAM)
    (tmp_path / "bad.py").write_text('import glpath\n\nglpath.render("cornell-box", ssp=4)\n')
    package = str(Path(glpath.__file__).parents[1])
    mypy = (sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir", tmp_path / "cache")
    # As of an installed package: what is wrong in it is not the program's.
    run = {name: called(*mypy, tmp_path / f"{name}.py", MYPYPATH=package) for name in ("good", "bad")}
    told = {name: [line for line in done.stdout.splitlines() if f"{name}.py" in line] for name, done in run.items()}
    assert told["good"] == [line for line in told["good"] if "note: Revealed type" in line], run["good"].stdout
    assert "RadiositySolution" in told["good"][0]
    (wrong,) = [line for line in told["bad"] if "error:" in line]
    assert 'Unexpected keyword argument "ssp" for "render"' in wrong


def test_the_policy_names_the_numbers_of_formats_as_they_are() -> None:
    from glpath.compare import picture
    from glpath.film import npz_file
    from glpath.radiosity import solution
    from glpath.radiosity.view_factors import result
    from glpath.rendering import job

    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    rows = [line.split("|")[1:5] for line in text.splitlines() if line.startswith("|") and "`" in line]
    numbers = {where.split("`")[1]: now.split(",")[0].strip() for _, where, now, _ in rows}
    assert numbers == {
        "film_format": str(npz_file.FORMAT),
        "version": str(job._VERSION),
        "radiosity_format": str(solution.FORMAT),
        "glpath_view_factors": str(result.FORMAT),
        "glpath.baseline": picture._VERSION,
    }
