"""Another driver than the one that this was written on: zink (OpenGL on Vulkan) on lavapipe (Vulkan on the CPU).

Structures pass their tests there. Engines show what they show here, sample by sample but for rounding, so that
tests of what is in their pictures need not run twice. Classical algorithm and T-buffer agree bit by bit there too,
and no GL error is left behind. And llvmpipe as if it were a graphics card: texels by `texelFetch`, with the same
bits.

Both are Mesa's. Needs Debian's mesa-vulkan-drivers, which `make evidence` installs; zink is in libgl1-mesa-dri.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from glpath.compare import Picture, compare, relative_mse
from glpath.film.film import Film
from tests.support.hashed_films import film_hash, film_of
from tests.support.repository import ROOT

pytestmark = pytest.mark.evidence

ZINK = {"MESA_LOADER_DRIVER_OVERRIDE": "zink", "GALLIUM_DRIVER": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}
FETCH = {"GLPATH_TEXELS": "fetch"}

#: The structures that draw, and what they stand on. Whole engines are held against their films instead.
STRUCTURES = [
    f"tests/{room}/test_{name}.py"
    for room, name in (
        ("gl", "program"),
        ("gl", "sums"),
        ("buffers", "path_buffer"),
        ("buffers", "t_buffer"),
        ("buffers", "shadow_cells"),
        ("buffers", "point_shadows"),
        ("integrators", "whitted"),
    )
]

PICTURES = (
    "path-buffer-cornell-box",
    "path-buffer-cornell-box-36-lattice",
    "path-buffer-cornell-box-36-hemisphere",
    "path-buffer-cornell-box-36-paper",
    "path-buffer-room",
    "path-buffer-mixed",
    "path-buffer-lobes",
    "path-buffer-lens",
    "path-buffer-stream",
    "path-mixed",
    "path-environment",
    "path-lobes",
    "path-lens",
    "path-panorama",
    "path-guided",
    "gather-cornell-box-36",
    "gather-path-buffer-cornell-box-36",
    "gather-path-buffer-cornell-box-36-constant",
    "t-buffer-mixed",
    "t-buffer-three-spheres",
    "classic-three-spheres",
    "t-buffer-three-spheres-cube",
    "classic-three-spheres-sphere",
    "t-buffer-stacked-triangles",
)

RENDER = """
import sys
from tests.gl.test_second_driver import render
from glpath.gl.context import get_context
for name in sys.argv[2:]:
    render(name).save(f"{sys.argv[1]}/{name}.npz")
error = get_context().gl.error
assert error == "GL_NO_ERROR", error
"""


def render(name: str) -> Film:
    changes = {"integrator": "classic"} if name == "classic-three-spheres" else {}
    spp = 64 if name == "path-buffer-mixed" else 32  # the noise of fewer hides too much to compare
    return film_of("t-buffer-three-spheres" if changes else name, spp=spp, **changes)


def run(code: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def zink() -> dict[str, str]:
    """The environment in which OpenGL is zink's."""
    ask = "from glpath.gl.context import get_context; print(get_context().info.renderer)"
    answer = run(ask, **ZINK)
    if "zink" not in answer.stdout:
        said = (answer.stderr.strip().splitlines() or ["another driver"])[-1]
        pytest.skip(f"zink does not run here ({said}): apt-get install mesa-vulkan-drivers")
    return ZINK


def assert_passes(suites: list[str], environment: dict[str, str]) -> None:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "-v",  # which process ran what, in which order: a driver's fault may depend on it
        "-n",
        "auto",
        "--dist",
        "loadfile",
        "-m",
        "not evidence",
        *suites,
    ]
    result = subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True)
    order = "\n".join(line for line in result.stdout.splitlines() if line.startswith("[gw"))
    assert result.returncode == 0, f"{order}\n{result.stdout[-8000:]}{result.stderr[-2000:]}"


def test_what_draws_passes_its_tests_on_zink(zink: dict[str, str]) -> None:
    """Classical algorithm and T-buffer agree bit by bit there too."""
    assert_passes(STRUCTURES, zink)


def test_what_draws_passes_its_tests_with_texels_read_as_graphics_cards_do() -> None:
    """Films of all engines have the bits that are stored of llvmpipe."""
    assert_passes(["tests/pictures/test_film_hashes.py", *STRUCTURES], FETCH)


def test_pictures_agree_across_drivers(zink: dict[str, str], tmp_path: Path) -> None:
    result = run(RENDER, str(tmp_path), *PICTURES, **zink)
    assert result.returncode == 0, result.stderr
    found = {}
    for name in PICTURES:
        ours, theirs = render(name), Film.load(tmp_path / f"{name}.npz")
        assert "zink" in theirs.metadata.device
        assert theirs.metadata.statistics["dropped_samples"] == 0
        # A path that passes an edge within rounding goes another way on another driver: a pixel in thousands.
        decided = np.abs(theirs.mean - ours.mean).max(axis=2) < 1e-3 * (ours.mean.max(axis=2) + ours.mean.mean())
        found[name] = relative_mse(np.where(decided[..., None], theirs.mean, ours.mean), ours.mean)
        limits = {"sees": 1} if ours.metadata.noisy else {}
        verdict = compare(Picture.of_film(theirs), Picture.of_film(ours), **limits)
        assert verdict.passed, f"{name}: {verdict.summary}"
        assert decided.mean() > 0.998, f"{name}: {(~decided).sum()} pixels are others"
        assert found[name] < 1e-9, f"{name}: the same samples, rounded otherwise, differ by {found[name]}"
    print(json.dumps(found, indent=2))
    same = [film_hash(Film.load(tmp_path / f"{engine}-three-spheres.npz")) for engine in ("classic", "t-buffer")]
    assert same[0] == same[1]
