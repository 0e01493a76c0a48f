"""`glpath radiosity`: what it writes, what it says, and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from itertools import product

import numpy as np
import pytest
import trimesh

import glpath
from glpath import RadiositySolution, load_scene, solve_radiosity
from glpath.cli.warm import SCENE, compile_kernels
from glpath.radiosity import RadiosityInterrupted, RadiosityProgress
from glpath.radiosity.solvers import solve
from glpath.radiosity.solvers.checks import METHODS
from tests.support.command_line import run
from tests.support.gltf_files import ReadGlb
from tests.support.repository import ROOT


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    path = tmp_path_factory.mktemp("solved") / "s.npz"
    solution = solve_radiosity("cornell-box-36", patches=100, receiver_points=1)
    solution.save(path)
    return path, solution


def test_radiosity_writes_a_solution_and_says_what_it_took(tmp_path):
    out = tmp_path / "new" / "s.npz"
    done = run("radiosity", "cornell-box-36", "-o", out, "--patches", 100, "--receiver-points", 1)
    assert done.exit_code == 0, done.output
    assert "progressive" in done.output
    assert "of the energy unshot" in done.output
    assert f"wrote {out}" in done.output
    solution = RadiositySolution.load(out, load_scene("cornell-box-36"))
    assert solution.settings["receiver_points"] == 1
    expected = solve_radiosity("cornell-box-36", patches=100, receiver_points=1)
    np.testing.assert_array_equal(solution.elements, expected.elements)


def test_radiosity_says_what_its_elements_do_to_the_picture(tmp_path):
    box = tmp_path / "box.toml"
    shipped = (ROOT / "scenes/cornell-box-36.toml").read_text()
    box.write_text(re.sub(r"(?m)^resolution = .*$", "resolution = [64, 64]", shipped))
    mesh = ("--patches", 100, "--receiver-points", 1, "--check")
    done = run("radiosity", box, "-o", tmp_path / "s.npz", *mesh)
    assert done.exit_code == 0, done.output
    [line] = [line for line in done.output.splitlines() if "the elements change the picture" in line]
    assert re.search(r"by [+-]0\.\d+ \+- \d.* % of the mean, relMSE about \d", line)
    done = run("radiosity", box, "-o", tmp_path / "s.npz", *mesh, "--progress", "json")
    assert set(json.loads(done.output.splitlines()[-1])) == {"bias", "bias_error", "relmse"}


def test_options_reach_the_solver_and_a_generated_scene_its_parameters(tmp_path, monkeypatch):
    seen = {}

    def fake(scene, **options):
        seen.update(options, scene=scene)
        raise RadiosityInterrupted(None)

    monkeypatch.setattr("glpath.radiosity.solve_radiosity", fake)
    done = run(
        "radiosity", "furnace", "-D", "reflectance=0.25", "-o", tmp_path / "s.npz", "--method", "monte-carlo",
        "--size", 0.5, "--splits", 1, "--particles", 99, "--seed", 7, "--overshoot", "--ambient", "--unshot", 0.2,
    )  # fmt: skip
    assert done.exit_code == 130
    assert "nothing is written" in done.output
    assert not (tmp_path / "s.npz").exists()
    assert seen["scene"].materials[0].reflectance[0] == 0.25
    expected = {"method": "monte-carlo", "size": 0.5, "splits": 1, "particles": 99, "seed": 7, "overshoot": True,
                "ambient": True, "unshot": 0.2, "patches": None, "adaptive": None}  # fmt: skip
    assert {key: seen[key] for key in expected} == expected


def test_ctrl_c_keeps_what_was_solved(tmp_path):
    out = tmp_path / "s.npz"
    command = [sys.executable, "-m", "glpath", "radiosity", "cornell-box-36", "-o", str(out), "--progress", "json"]
    command += ["--method", "monte-carlo", "--particles", "100000000000", "--patches", "100"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        for line in process.stderr:
            if line.startswith("{") and json.loads(line)["steps"] > 0:
                break
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.stderr.close()
    assert "interrupted: what was solved is in" in rest
    solution = RadiositySolution.load(out, load_scene("cornell-box-36"))
    assert 0 < solution.statistics["particles"] < 10**11
    assert solution.elements.max() > 0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["radiosity", "cornell-box-36", "-o", "s.png"], 2, "written as .npz"),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--patches", "1000000000000"], 2, "of memory; there are"),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--size", "-1"], 2, "a finite number above 0"),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--method", "magic"], 2, "allowed are progressive"),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--progress", "loud"], 2, "no such choice"),
        (["radiosity", "furnace", "-D", "reflectance=1", "-o", "s.npz"], 1, "below 1 for radiosity"),
        (["radiosity", "furnace", "-D", "radiance=0", "-o", "s.npz"], 1, "no shape with an emission"),
        (["radiosity", "three-spheres", "-o", "s.npz"], 1, "cannot render"),
        (["radiosity", "cornell-box-36", "-o", "s.obj"], 2, "or as .glb with vertex colours"),
        (["radiosity", "cornell-box-36", "-o", "s.glb", "--exposure", "1e9"], 2, "-100 to 100"),
        (["radiosity", "cornell-box-36", "-o", "s.glb", "--radiosity", "none.npz"], 1, "no such file"),
        (["radiosity", "cornell-box-36", "-o", "s.glb", "--radiosity", "a.npz", "--size", "1"], 2, "contradict"),
        (
            ["radiosity", "cornell-box-36", "-o", "s.glb", "--radiosity", "a.npz", "--method", "matrix"],
            2,
            "--radiosity and --method contradict",
        ),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--exposure", "1"], 2, "a .npz holds the light itself"),
        (["radiosity", "cornell-box-36", "-o", "s.npz", "--shaft", "clumb=8"], 2, "Is clump meant?"),
    ],
)
def test_mistakes_are_explained_and_nothing_is_written(arguments, code, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert done.exit_code == code, done.output
    assert message in done.output
    assert "Traceback" not in done.output
    assert list(tmp_path.iterdir()) == []


def test_the_solution_of_another_scene_is_refused(solved, tmp_path):
    done = run("radiosity", "cornell-box", "-o", tmp_path / "b.glb", "--radiosity", solved[0])
    assert done.exit_code == 1
    assert "belongs to another scene" in done.output


@pytest.mark.parametrize("mode", ["bar", "lines", "json", "none"])
def test_progress_is_shown(mode, tmp_path, monkeypatch):
    def fake(scene, *, on_progress, **options):
        assert (on_progress is None) == (mode == "none")
        if on_progress is not None:
            on_progress(RadiosityProgress("shooting", 12, 0.25, 0.001, 300, 1.5))
            on_progress(RadiosityProgress("refining", 12, None, 0.001, 300, 1.6))
        raise RadiosityInterrupted(None)

    monkeypatch.setattr("glpath.radiosity.solve_radiosity", fake)
    done = run("radiosity", "cornell-box", "-o", tmp_path / "s.npz", "--progress", mode)
    *said, last = done.stderr.splitlines()
    assert last == "glpath: interrupted: nothing was solved yet; nothing is written"
    if mode == "lines":
        assert said == [
            "shooting: 12 steps, 25 % unshot, 300 elements after 1.5 s",
            "refining: 12 steps, 300 elements after 1.6 s",
        ]
    elif mode == "json":
        assert [json.loads(line)["unshot"] for line in said] == [0.25, None]
    elif mode == "none":
        assert said == []


# glTF.


def test_a_baked_scene_is_what_was_solved(solved, tmp_path):
    path, solution = solved
    out = tmp_path / "b.glb"
    done = run("radiosity", "cornell-box-36", "-o", out, "--radiosity", path, "--exposure", -1)
    assert done.exit_code == 0, done.output
    scene = load_scene("cornell-box-36")

    document = ReadGlb.of(out)
    assert document.json["extensionsUsed"] == ["KHR_materials_unlit"]
    assert document.json["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    assert document.json["extras"]["exposure_stops"] == -1
    assert document.json["extras"]["scene_hash"] == solution.scene_hash
    assert [m["name"] for m in document.json["meshes"]] == [s.name for s in scene.shapes]
    assert document.json["cameras"][0]["perspective"]["yfov"] == pytest.approx(np.radians(scene.camera.fov))
    # All backs are black here, and left out.
    assert [len(m["primitives"]) for m in document.json["meshes"]] == [1] * len(scene.shapes)

    for shape, part, mesh in zip(scene.shapes, scene.shapes.ranges, document.json["meshes"], strict=True):
        a = mesh["primitives"][0]["attributes"]
        position, colour = (document.values(a[name]) for name in ("POSITION", "COLOR_0"))
        faces = document.values(mesh["primitives"][0]["indices"]).reshape(-1, 3)
        assert len(faces) == (solution.divisions[part] ** 2).sum()
        first = int(solution.first_vertex[part.start])
        irradiance = solution.vertices[:, 0, first : first + len(position)].sum(axis=0)
        radiance = scene.materials[shape.material].reflectance * irradiance / np.pi + shape.emission
        np.testing.assert_allclose(colour, np.clip(radiance / 2, 0, 1), rtol=1e-6)
        # The triangles face as the scene's do, and cover them.
        corners = position[faces].astype(float)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        whole = scene.normals * scene.areas[:, None]
        expected = whole[part].sum(axis=0)
        np.testing.assert_allclose(normals.sum(axis=0), expected, atol=1e-5)
    lamp = document.values(document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"])
    np.testing.assert_array_equal(lamp, 1.0)


def test_another_program_reads_it(solved, tmp_path):
    out = tmp_path / "b.glb"
    scene = load_scene("cornell-box-36")
    solved[1].to_glb(scene, out)
    loaded = trimesh.load(out)
    assert isinstance(loaded, trimesh.Scene)
    np.testing.assert_allclose(loaded.bounds, np.stack(scene.bounds), atol=1e-6)
    whole = loaded.to_geometry() if hasattr(loaded, "to_geometry") else loaded.dump(concatenate=True)
    assert whole.area == pytest.approx(scene.areas.sum(), rel=1e-5)
    assert len(loaded.geometry) == len(scene.shapes)


def test_both_sides_of_a_two_sided_shape_are_there_and_up_is_up(tmp_path):
    from tests.support.rooms import part, rectangle, room

    scene = room(
        part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), 0.5, two_sided=True),
        part(rectangle((-1, -1, 1), (0, 2, 0), (2, 0, 0)), 0.0, 0.1),
    ).with_camera(up=np.array([0.0, 0.0, 1.0]), position=np.array([4.0, 0, 0.5]))
    solution = solve_radiosity(scene, patches=20)
    solution.to_glb(scene, tmp_path / "b.glb")
    document = ReadGlb.of(tmp_path / "b.glb")
    assert [len(m["primitives"]) for m in document.json["meshes"]] == [2, 1]
    both = document.json["meshes"][0]["primitives"]
    front, back = (document.values(p["attributes"]["COLOR_0"]) for p in both)
    assert front.min() > 0
    assert back.max() == 0
    faces = [document.values(p["indices"]).reshape(-1, 3) for p in both]
    np.testing.assert_array_equal(faces[1], faces[0][:, ::-1])
    bounds = trimesh.load(tmp_path / "b.glb").bounds
    np.testing.assert_allclose(bounds[1] - bounds[0], [2, 1, 2], atol=1e-4)  # its z is up, as glTF's y


def test_a_glb_is_written_by_every_method_beside_its_solution(tmp_path):
    for method in ("monte-carlo", "matrix"):
        out = tmp_path / f"{method}.glb"
        solution = out.with_suffix(".npz")
        options = ("--method", method, "--patches", 40, "--particles", 20_000, "-q")
        done = run("radiosity", "cornell-box-36", "-o", solution, "-o", out, *options)
        assert done.exit_code == 0, done.output
        again = tmp_path / "again.glb"
        assert run("radiosity", "cornell-box-36", "-o", again, "--radiosity", solution, "-q").exit_code == 0
        assert again.read_bytes() == out.read_bytes()


def test_a_glb_is_written_from_what_is_solved(tmp_path):
    out = tmp_path / "b.glb"
    done = run("radiosity", "cornell-box-36", "-o", out, "--patches", 60, "--adaptive", 1, "-q")
    assert done.exit_code == 0, done.output
    assert out.stat().st_size > 5000
    assert done.output == ""


def test_the_solver_is_a_public_name():
    assert glpath.solve_radiosity is solve.solve_radiosity


def test_what_is_compiled_in_advance_is_what_a_solution_needs(caplog):
    """`glpath doctor --warm`: afterwards nothing is left to compile, for scenes of other shapes and lights."""
    compile_kernels(load_scene(SCENE))
    caplog.clear()
    for name, method in product(("cornell-box", "furnace"), METHODS):
        glpath.solve_radiosity(name, method=method, patches=1, particles=1)
    assert "compiling kernels" not in caplog.text


@pytest.mark.evidence
@pytest.mark.parametrize("method", METHODS)
def test_the_kernels_that_are_counted_are_those_that_are_compiled(method, tmp_path):
    """A fresh installation: each is named, with its number, but for what another process has made by then, and the
    last one is the last."""
    done = subprocess.run(
        [sys.executable, "-m", "glpath", "radiosity", "cornell-box", "--method", method, "--patches", "1",
         "--particles", "1", "--progress", "lines", "-o", str(tmp_path / "s.npz")],
        capture_output=True, text=True, check=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
    )  # fmt: skip
    told = re.findall(r"(?:compiling kernels:|waiting for) (\w+) (\d+)/(\d+)", done.stderr)
    numbers = [int(number) for _, number, _ in told]
    assert len(told) > 2
    assert numbers == sorted(numbers)
    assert {int(total) for _, _, total in told} == {numbers[-1]}
