"""Private interfaces of other packages are there, and are used in one module; a failure names what has changed."""

from __future__ import annotations

import re
import sys
import tomllib
from importlib.metadata import version
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from glpath.errors import GlpathError
from glpath.system import private_interfaces
from glpath.system.kernel_cache import KernelCache
from tests.support.repository import ROOT

# How each is written in a file that uses it.
WORDS = r"numba\.core|_pytest\b|\b_esm\b = .*RemoteFrameBuffer|\b_lights\"|mesh\._cache|\"_nrt\"|no_c\w+_wrapper"


def twice(x: float) -> float:
    return 2.0 * x


def test_a_cache_of_numba_has_what_ours_is_made_of() -> None:
    cache = KernelCache(twice)
    for name in ("_cache_path", "_impl", "_index_key", "_py_func"):
        assert hasattr(cache, name), f"numba {version('numba')}: FunctionCache.{name}"
    for name in ("filename_base", "check_cachable", "reduce", "rebuild"):
        assert hasattr(cache._impl, name), f"numba {version('numba')}: FunctionCache._impl.{name}"


def test_numba_takes_the_options_that_are_in_no_manual() -> None:
    import numba

    options = private_interfaces.NUMBA_OPTIONS | private_interfaces.NUMBA_WITHOUT_PYTHON
    made = numba.njit(**options)(twice)
    made.compile((numba.float64,))  # which refuses options that it does not know
    assert made.signatures
    private_interfaces.set_numba_cache(made, None)
    assert private_interfaces.numba_cache(made) is None


def test_normals_and_lights_are_those_that_trimesh_was_given() -> None:
    import trimesh

    box = trimesh.creation.box()
    assert private_interfaces.given_trimesh_normals(box) is None
    box = trimesh.Trimesh(box.vertices, box.faces, vertex_normals=np.tile([0.0, 0.0, 1.0], (8, 1)), process=False)
    assert private_interfaces.given_trimesh_normals(box).tolist() == [[0, 0, 1]] * 8
    scene = trimesh.Scene(box)
    assert private_interfaces.given_trimesh_lights(scene) is None
    light = trimesh.scene.lighting.PointLight(name="lamp")
    scene.lights = [light]
    assert private_interfaces.given_trimesh_lights(scene) == [light]


@pytest.mark.xfail(reason="it is what is_xfail is asked of", raises=AssertionError, strict=True)
def test_pytest_says_of_a_test_that_it_is_expected_to_fail(request: pytest.FixtureRequest) -> None:
    assert not private_interfaces.is_xfail(request.node)


def test_pytest_says_of_a_test_that_it_is_not_expected_to_fail(request: pytest.FixtureRequest) -> None:
    assert not private_interfaces.is_xfail(request.node)


@pytest.mark.skipif(find_spec("jupyter_rfb") is None, reason="needs the extra jupyter")
def test_a_remote_frame_buffer_has_a_page() -> None:
    script, style = private_interfaces.rfb_page()
    assert "render" in script
    assert "{" in style


def test_what_is_gone_is_named_with_the_releases_that_have_it() -> None:
    wanted = rf"trimesh {version('trimesh')} has no SimpleNamespace\._cache.* 4\.7 to"
    with pytest.raises(GlpathError, match=wanted):
        private_interfaces.given_trimesh_normals(SimpleNamespace())


def test_a_module_that_is_gone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba.core.caching", None)
    with pytest.raises(GlpathError, match=r"has no module numba\.core\.caching"):
        private_interfaces.numba_internals()


def test_no_other_module_uses_them() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted((ROOT / "glpath").rglob("*.py"))
        if path.name != "private_interfaces.py"
        for line in path.read_text().splitlines()
        if re.search(WORDS, line)
    ]
    assert found == []


def test_the_bounds_of_the_project_are_those_that_are_named() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [line for lines in project["optional-dependencies"].values() for line in lines]
    wanted = [*project["dependencies"], *extras]
    for package, releases in private_interfaces.SEEN.items():
        assert any(re.match(rf"{package}>={releases.first}\b", line) for line in wanted), package
    after = re.search(r'"numba>=0\.61,<0\.(\d+)"', (ROOT / "pyproject.toml").read_text())
    assert after
    assert private_interfaces.SEEN["numba"].last == f"0.{int(after[1]) - 1}"
