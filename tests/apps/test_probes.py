"""`glpath.probes` and `glpath probes`: spherical harmonics against closed forms and quadrature, and repairs."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath.apps.probes import ProbeGrid, harmonics
from glpath.cli.main import app
from glpath.errors import TimeLimitError
from glpath.io import load_scene
from glpath.rendering.sides import Sides
from glpath.system.time_limit import limited
from tests.support import npm
from tests.support.clock import Clock

#: Far below, for scenes of nothing but light.
CAMERA = {"position": [0, -3, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 40}
SPECK = {"type": "quad", "corners": [[0, 0, -500], [0.01, 0, -500], [0.01, 0.01, -500], [0, 0.01, -500]]}
AROUND_ZERO = [[-1, -1, -1], [1, 1, 1]]
#: Two triangles a side, outwards: a closed solid of side 2 about zero.
CUBE = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1]}


def sphere(nodes: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Directions and the solid angle of each, by a product rule."""
    z, weight = np.polynomial.legendre.leggauss(nodes)
    turn = 2 * np.pi * (np.arange(2 * nodes) + 0.5) / (2 * nodes)
    z, turn = np.meshgrid(z, turn, indexing="ij")
    r = np.sqrt(1 - z * z)
    angle = np.broadcast_to(weight[:, None] * np.pi / nodes, z.shape)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], -1).reshape(-1, 3), angle.ravel()


def agrees(found: glpath.Probes, expected: Any, probe: int = 0, within: float = 0.0) -> None:
    off = np.abs(found.coefficients[probe] - expected)
    assert (off <= 5 * found.standard_errors[probe] + within).all(), off / found.standard_errors[probe]


def test_the_harmonics_are_orthonormal() -> None:
    directions, angle = sphere()
    of = harmonics(directions)
    np.testing.assert_allclose(of.T @ (angle[:, None] * of), np.eye(9), atol=1e-12)


def test_a_uniform_sky_is_band_0() -> None:
    scene = {"shapes": [SPECK], "sky": {"zenith": [2.0, 1.0, 0.5]}}
    found = glpath.probes(scene, (1, 1, 1), AROUND_ZERO, spp=256, max_depth=2)
    expected = np.zeros((9, 3))
    expected[0] = np.sqrt(4 * np.pi) * np.array([2.0, 1.0, 0.5])
    agrees(found, expected)
    np.testing.assert_allclose(found.coefficients[0, 0], expected[0], rtol=0.005)
    assert found.unit == "radiometric"
    assert found.repaired == 0


def test_a_lamp_is_what_quadrature_says() -> None:
    half, height, radiance = 0.6, 1.5, np.array([10.0, 5.0, 2.0])
    corners = [[-half, half, height], [half, half, height], [half, -half, height], [-half, -half, height]]
    lamp = {"type": "quad", "corners": corners, "emission": {"radiance": radiance.tolist()}, "material": "black"}
    scene = {"shapes": [lamp], "materials": {"black": {"reflectance": 0}}}
    # The lamp shines down; the one probe is off its axis and below it.
    at = np.array([0.4, -0.3, 0.0])
    found = glpath.probes(scene, (1, 1, 1), [at - 0.5, at + 0.5], spp=256, max_depth=2)
    x, weight = np.polynomial.legendre.leggauss(64)
    x, y = np.meshgrid(half * x, half * x)
    towards = np.stack([x, y, np.full_like(x, height)], -1) - at
    distance = np.linalg.norm(towards, axis=-1)
    angle = half * half * np.outer(weight, weight) * towards[..., 2] / distance**3
    expected = np.einsum("ij,ijc->c", angle, harmonics(towards / distance[..., None]))[:, None] * radiance
    assert np.abs(expected[1:]).max() > 1.0
    # A lamp has bands above 9, of which the rule has a trace: 1/55 of what it has of band 2.
    agrees(found, expected, within=0.02 * float(expected.max()))


def test_a_sky_that_darkens_is_what_quadrature_says() -> None:
    zenith, horizon = 4.0, 1.0
    scene = load_scene(
        {"camera": CAMERA, "shapes": [SPECK], "sky": {"zenith": zenith, "horizon": horizon, "up": [0, 0, 1]}}
    )
    found = glpath.probes(scene, (1, 1, 1), AROUND_ZERO, spp=256, max_depth=2)
    directions, angle = sphere()
    light = horizon + (zenith - horizon) * np.maximum(directions[:, 2], 0.0)
    agrees(found, (angle * light @ harmonics(directions))[:, None] * np.ones(3), within=0.005)


def test_a_probe_inside_a_solid_is_repaired_and_flagged(tmp_path: Path) -> None:
    scene = {"shapes": [CUBE], "sky": {"zenith": 1.0}}
    bounds = [[-4.5, -4.5, -4.5], [4.5, 4.5, 4.5]]
    found = glpath.probes(scene, (3, 3, 3), bounds, spp=16)
    assert np.flatnonzero(~found.grid.valid).tolist() == [13]
    assert found.repaired == 1
    np.testing.assert_allclose(found.grid.positions[[0, 1, 3, 9, 13]],
                               [[-3, -3, -3], [0, -3, -3], [-3, 0, -3], [-3, -3, 0], [0, 0, 0]])  # fmt: skip
    others = np.delete(found.coefficients, 13, axis=0)
    assert others[:, 0].min() > 1.0
    np.testing.assert_allclose(found.coefficients[13], others.mean(axis=0))
    assert np.isnan(found.standard_errors[13]).all()
    found.save(tmp_path / "probes.json")
    written = json.loads((tmp_path / "probes.json").read_text())
    assert written["valid"] == [i != 13 for i in range(27)]
    assert written["grid"] == [3, 3, 3]
    assert written["bounds"] == {"min": bounds[0], "max": bounds[1]}
    assert written["unit"] == "W sr^-1 m^-2"
    np.testing.assert_allclose(written["coefficients"], found.coefficients.reshape(27, 27), rtol=1e-6, atol=1e-7)


def test_a_grid_has_to_be_one() -> None:
    scene = load_scene({"camera": CAMERA, "shapes": [CUBE], "sky": {"zenith": 1.0}})
    for counts, bounds, words in (
        ((0, 1, 1), None, "grid: 0 x 1 x 1"),
        ((100, 100, 100), None, "grid: 100 x 100 x 100"),
        ((1, 1, 1), [[1, 0, 0], [0, 1, 1]], "bounds: from"),
        ((1, 1, 1), [[0, 1], [2, 3], [4, 5]], r"bounds: of shape \(3, 2\) where \(2, 3\)"),
        ((1, 1, 1), [0, 0, 0, 1, 1, 1], r"bounds: of shape \(6,\) where \(2, 3\)"),
    ):
        with pytest.raises(glpath.UsageError, match=words):
            ProbeGrid.of(scene, counts, bounds)
    with pytest.raises(glpath.SceneError, match="all 1 probes see mostly the backs"):
        ProbeGrid.of(scene, (1, 1, 1))


def test_the_command_writes_and_tells(tmp_path: Path) -> None:
    scene = tmp_path / "cube.toml"
    scene.write_text(
        'unit = "photometric"\n[sky]\nzenith = 1.0\n[[shapes]]\ntype = "box"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\n'
    )
    out = tmp_path / "probes.json"
    typed = ["probes", str(scene), "--grid", "3x1x1", "--bounds=-3,-1,-1,3,1,1", "--spp", "16", "-o", str(out)]
    done = CliRunner().invoke(app, typed)
    assert done.exit_code == 0, done.stderr
    assert "3 x 1 x 1 probes, 16 paths for each of 50 normals" in done.output
    assert "1 probe inside solids: repaired" in done.output
    written = json.loads(out.read_text())
    assert written["unit"] == "cd m^-2"
    assert written["valid"] == [True, False, True]
    by_call = glpath.probes(scene, (3, 1, 1), [[-3, -1, -1], [3, 1, 1]], spp=16)
    np.testing.assert_allclose(written["coefficients"], by_call.coefficients.reshape(3, 27), rtol=1e-6, atol=1e-7)
    for wrong, words in (
        (("--grid", "3x1"), "--grid 3x1: expected NxNxN"),
        (("--grid", "axbxc"), "--grid axbxc: expected NxNxN"),
        (("--grid", "3x1x1", "--bounds=-3,-1,-1,3,1,1_0"), "1_0: expected X,Y,Z,X,Y,Z"),
    ):
        refused = CliRunner().invoke(app, ["probes", str(scene), *wrong, "-o", str(out)])
        assert refused.exit_code == 2
        assert words in refused.stderr


@pytest.mark.evidence
@pytest.mark.skipif(
    npm.package("three") is None or shutil.which("node") is None, reason="needs node and npm's three"
)
def test_three_js_has_the_irradiance_that_was_measured(tmp_path: Path) -> None:
    found = glpath.probes("cornell-box-36", (1, 1, 1), spp=64)
    found.save(tmp_path / "probes.json")
    three = npm.package("three")
    assert three is not None
    (tmp_path / "read.mjs").write_text(
        f"import * as THREE from {json.dumps(str(three / 'build' / 'three.module.js'))}\n"
        "import { readFileSync } from 'node:fs'\n"
        f"const json = JSON.parse(readFileSync({json.dumps(str(tmp_path / 'probes.json'))}))\n"
        "const probe = new THREE.LightProbe()\n"
        "probe.sh.fromArray(json.coefficients[0])\n"
        "const at = n => probe.sh.getIrradianceAt(new THREE.Vector3(...n), new THREE.Vector3()).toArray()\n"
        "console.log(JSON.stringify([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, -0.8]].map(at)))\n"
    )
    done = subprocess.run(["node", str(tmp_path / "read.mjs")], capture_output=True, text=True, check=True)
    normals = [[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, -0.8]]
    lobe = np.array([np.pi, *[2 * np.pi / 3] * 3, *[np.pi / 4] * 5])
    np.testing.assert_allclose(
        json.loads(done.stdout), (harmonics(normals) * lobe) @ found.coefficients[0], rtol=1e-4, atol=1e-4
    )
    # And bands 0 to 2 are nearly all of what is measured there.
    position = np.repeat(found.grid.positions, 4, axis=0)
    measured = glpath.irradiance("cornell-box-36", position, normals, spp=1024).values
    np.testing.assert_allclose(json.loads(done.stdout), measured, atol=0.1 * measured.max())


def test_search_for_probes_inside_solids_ends_at_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each probe casts 64 rays, so that three probes make two parts of at most 100."""
    scene = load_scene({"camera": CAMERA, "shapes": [CUBE], "sky": {"zenith": [1, 1, 1]}})
    clock, ahead, rays, cast = Clock(monkeypatch), 0.0, [], Sides.cast

    def later(sides: Sides, origins: np.ndarray, *others: np.ndarray) -> Any:
        clock.ahead = ahead
        rays.append(len(origins))
        return cast(sides, origins, *others)

    monkeypatch.setattr(Sides, "cast", later)
    monkeypatch.setattr("glpath.apps.probes._RAYS_TOGETHER", 100)
    box = [[-3, -1, -1], [3, 1, 1]]
    with limited(1.0):
        assert ProbeGrid.of(scene, (3, 1, 1), box).valid.tolist() == [True, False, True]
        assert rays == [100, 92]
        ahead = 2.5
        with pytest.raises(TimeLimitError, match="over while looking for probes inside solids, before"):
            ProbeGrid.of(scene, (3, 1, 1), box)
    assert rays == [100, 92, 100]
