"""What goes to an index: contents of wheel and sdist, their metadata, and types that check who uses them."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

from tests.support.repository import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PYTHONS = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]


def called(*command: object, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        cwd=folder,
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


BAD = 'import glpath\n\nglpath.render("cornell-box", ssp=4)\n'
#: What each says of the misspelt option.
CHECKERS = {
    "mypy": 'Unexpected keyword argument "ssp" for "render"',
    "pyright": 'No parameter named "ssp"',
}


@pytest.fixture(scope="module")
def python_with_the_wheel(built: tuple[Path, Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python that has the wheel as pip installs it, and all else from the environment of the tests."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder)
    python = folder / "bin" / "python"
    site = Path(called(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip())
    got = called(sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", site, built[2])
    assert got.returncode == 0, got.stderr
    # Of a folder that a .pth names, no further .pth is read: the checkout itself stays out.
    (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    imported = called(python, "-I", "-c", "import glpath, numpy; print(glpath.__file__)")
    assert Path(imported.stdout.strip()) == site / "glpath" / "__init__.py", imported.stderr
    return python


@pytest.mark.evidence
@pytest.mark.parametrize("checker", CHECKERS)
def test_a_type_checker_takes_a_program_and_finds_a_misspelt_option(
    checker: str, built: tuple[Path, Path, Path], python_with_the_wheel: Path, tmp_path: Path
) -> None:
    """Against the installed wheel, whose `py.typed` it has to find."""
    environment = {"PYTHONPATH": ""}  # nor is the checkout found by it, or from the folder that is current
    if checker == "mypy":
        check: tuple[object, ...] = ("--strict", "--config-file=", "--cache-dir", tmp_path / "cache")
        check = (*check, "--python-executable", python_with_the_wheel)
    else:
        # Its package brings the program by npm when it is first called.
        got = called(sys.executable, "-m", "pip", "install", "-q", "--target", tmp_path / "tools", "pyright")
        environment = {"PYTHONPATH": f"{tmp_path}/tools", "PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}
        if got.returncode or called(sys.executable, "-m", "pyright", "--version", **environment).returncode:
            pytest.skip("needs pyright, which could not be installed by pip and npm")
        check = ("--pythonpath", python_with_the_wheel)
    (tmp_path / "good.py").write_text(PROGRAM)
    (tmp_path / "bad.py").write_text(BAD)
    good, bad = (
        called(sys.executable, "-m", checker, *check, f"{name}.py", folder=tmp_path, **environment)
        for name in ("good", "bad")
    )
    assert good.returncode == 0, good.stdout
    (told,) = [line for line in good.stdout.splitlines() if "good.py" in line and "RadiositySolution" in line]
    assert "Any" not in told
    assert bad.returncode == 1, bad.stdout
    (wrong,) = [line for line in bad.stdout.splitlines() if "error:" in line]
    assert CHECKERS[checker] in wrong


def test_the_policy_names_the_numbers_of_formats_as_they_are() -> None:
    from glpath.apps.daylight import coefficients
    from glpath.apps.view_factors import result
    from glpath.compare import picture
    from glpath.film import npz_file
    from glpath.radiosity import solution
    from glpath.rendering import job

    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    rows = [line.split("|")[1:5] for line in text.splitlines() if line.startswith("|") and "`" in line]
    numbers = {where.split("`")[1]: now.split(",")[0].strip() for _, where, now, _ in rows}
    assert numbers == {
        "film_format": str(npz_file.FORMAT),
        "version": str(job._VERSION),
        "radiosity_format": str(solution.FORMAT),
        "glpath_view_factors": str(result.FORMAT),
        "glpath_daylight": str(coefficients.FORMAT),
        "glpath.baseline": picture._VERSION,
    }
