"""`python -m benchmarks bench`: which options go with which bench, and what is printed and written."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from benchmarks.__main__ import app
from benchmarks.bench_command import BENCHES
from benchmarks.benches import defaults, denoise, gather, jobs, path_buffer, shaft, start_up, t_buffer
from benchmarks.benches.equal_error import line_to_target, samples_to_target
from benchmarks.benches.start_up import bench_start_up
from benchmarks.peers import cycles as cycles_peer
from benchmarks.peers import embree as embree_peer
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.peers import other_python
from benchmarks.peers import radiance as radiance_peer
from benchmarks.verdict import Report
from glpath.compare import relative_mse
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.io import load_scene
from glpath.rendering import factory
from glpath.rendering import run as render_job


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """All benches, without their work; what they were asked for."""
    asked: list[tuple[object, ...]] = []

    def stand_in(name, holds):
        def measure(*arguments):
            *options, say = arguments
            say("measuring")
            asked.append((name, *options))
            rows = [{"kind": "sphere", "ms": 0.5}, {"kind": "triangle", "ms": 0.25, "peer_ms": float("nan")}]
            return Report(name, "fast (a >= 1)", {"a": 1.25}, holds, rows, {"renderer": "none"}, {"glpath": "0"})

        return measure

    monkeypatch.setattr(path_buffer, "bench_path_buffer", stand_in("path-buffer", True))
    monkeypatch.setattr(gather, "bench_gather", stand_in("gather", True))
    monkeypatch.setattr(t_buffer, "bench_t_buffer", stand_in("t-buffer", False))
    monkeypatch.setattr(shaft, "bench_shaft", stand_in("shaft", True))
    return asked


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["bench", *map(str, arguments)])


def test_list_names_every_bench() -> None:
    result = run("--list")
    assert [line.split()[0] for line in result.stdout.splitlines()] == list(BENCHES)
    assert list(BENCHES) == [
        "path-buffer",
        "path-sets",
        "gather",
        "denoise",
        "textures",
        "materials",
        "luminaires",
        "defaults",
        "t-buffer",
        "shaft",
        "shaft-options",
        "viewfactors",
        "measure",
        "parallel-rays",
        "daylight",
        "cie171",
        "height-field",
        "streamed-field",
        "lightmap",
        "leaky-rooms",
        "jobs",
        "standard-scenes",
        "image-tests",
        "start-up",
        "footprint",
    ]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["path-buffer"], ("path-buffer", 3, None, None)),
        (["path-buffer", "--seeds", "2", "--reference", "a.exr"], ("path-buffer", 2, Path("a.exr"), None)),
        (["gather"], ("gather", 3, None, 1.0, None)),
        (["gather", "--seeds", "2", "--scale", "0.5"], ("gather", 2, None, 0.5, None)),
        (["t-buffer"], ("t-buffer", 1.0, 7)),
        (["t-buffer", "--rounds", "3", "--scale", "0.5"], ("t-buffer", 0.5, 3)),
        (["shaft"], ("shaft", 1.0, 7)),
        (["shaft", "--rounds", "3", "--scale", "0.5"], ("shaft", 0.5, 3)),
    ],
)
def test_a_bench_gets_its_options_or_their_defaults(calls, arguments, expected) -> None:
    result = run(*arguments)
    assert (result.exit_code, calls) == (0, [expected])
    assert "measuring" in result.stderr


def test_a_bench_of_another_scene_or_size_gets_the_scene(calls) -> None:
    assert run("gather", "--scene", "office", "--resolution", "40x30").exit_code == 0
    assert run("path-buffer", "--resolution", "32x32").exit_code == 0
    (*_, office), (*_, box) = calls
    assert (office.name, office.camera.resolution) == ("office", (40, 30))
    assert (box.name, box.camera.resolution) == ("cornell-box-36", (32, 32))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            [],
            "no name; allowed are path-buffer, path-sets, gather, denoise, textures, materials, luminaires, "
            "defaults, t-buffer, shaft, shaft-options, viewfactors, measure, parallel-rays, daylight, cie171, "
            "height-field, streamed-field, lightmap, leaky-rooms, jobs, standard-scenes, image-tests, start-up, "
            "footprint",
        ),
        (
            ["z-buffer"],
            "'z-buffer'; allowed are path-buffer, path-sets, gather, denoise, textures, materials, luminaires",
        ),
        (["t-buffer", "--seeds", "2"], "--seeds does not apply to bench t-buffer; allowed are --rounds, --scale"),
        (["shaft", "--seeds", "2"], "--seeds does not apply to bench shaft; allowed are --rounds, --scale"),
        (["path-buffer", "--scale", "0.5"], "--scale does not apply to bench path-buffer"),
        (
            ["gather", "--rounds", "2"],
            "--rounds does not apply to bench gather; allowed are --scene,",
        ),
        (["t-buffer", "--scene", "room"], "--scene does not apply to bench t-buffer"),
        (["gather", "--resolution", "64"], "--resolution 64: expected WxH"),
        (["t-buffer", "--rounds", "0"], "--rounds 0: must be at least 1"),
        (["path-buffer", "--seeds", "0"], "--seeds 0: must be at least 1"),
        (["t-buffer", "--scale", "0"], "--scale 0: must be above 0 and at most 1"),
        (["standard-scenes"], "bench standard-scenes: needs a folder of scenes"),
        (["gather", "--folder", "a"], "--folder does not apply to bench gather"),
        (["denoise", "--target", "0"], "--target 0: must be above 0"),
        (["gather", "--target", "1e-3"], "--target does not apply to bench gather"),
    ],
)
def test_wrong_usage_says_what_is_allowed(calls, arguments, words) -> None:
    result = run(*arguments)
    assert (result.exit_code, calls) == (2, [])
    assert words in result.stderr


def test_the_verdict_is_said_and_the_json_is_strict(calls, tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    result = run("t-buffer", "--json", path)
    assert "fast (a >= 1): DOES NOT HOLD" in result.stdout
    assert "fast (a >= 1): holds" in run("path-buffer").stdout

    def refuse(word):
        raise AssertionError(word)

    written = json.loads(path.read_text(), parse_constant=refuse)
    assert (written["holds"], written["measured"]) == (False, {"a": 1.25})
    assert written["rows"][1]["peer_ms"] is None
    assert json.loads(run("t-buffer", "--json", "-").stdout) == written


def test_a_table_shows_what_is_written(monkeypatch) -> None:
    rows = [{"[kind]": "[red]x[/] :bell:"}]
    report = Report("gather", "", {"[a]": 1.0}, None, rows, {"renderer": "[b]"}, {"glpath": "0"}, ["[note]"])
    monkeypatch.setattr(gather, "bench_gather", lambda *_: report)
    shown = run("gather").stdout
    for text in ("[kind]", "[red]x[/] :bell:", "[a]", "[b]", "[note]"):
        assert text in shown


def test_programs_that_disagree_are_a_failure(monkeypatch, tmp_path: Path) -> None:
    faults = ["agreement >= 0.999 is not so: 0.5"]
    report = Report("gather", "fast", {"agreement": 0.5}, False, [], {}, {}, faults=faults)
    monkeypatch.setattr(gather, "bench_gather", lambda *_: report)
    result = run("gather", "--json", tmp_path / "a.json")
    assert result.exit_code == 1
    assert "fast: DOES NOT HOLD" in result.stdout
    assert "error: bench gather: the programs disagree" in result.stderr
    assert faults[0] in result.stderr
    written = json.loads((tmp_path / "a.json").read_text())
    assert (written["holds"], written["faults"]) == (False, faults)


def test_a_file_that_cannot_be_written_is_told_before_the_work(calls, tmp_path: Path) -> None:
    result = run("t-buffer", "--json", tmp_path)
    assert (result.exit_code, calls) == (1, [])


# What the bench of the T-buffer looks at


@pytest.mark.parametrize("kind", t_buffer.KINDS)
@pytest.mark.parametrize("count", [200, 20_000])
def test_a_crowd_shows_the_same_area_whatever_its_number(kind, count) -> None:
    scene = t_buffer.crowd(kind, count)
    assert len(scene.spheres) + len(scene.triangles) == count
    # A convex body shows a quarter of its surface on average [Cauchy]; a triangle's has two sides.
    shown = np.pi * scene.spheres[:, 0, 0] ** 2 if kind == "sphere" else scene.areas / 2
    assert shown.sum() == pytest.approx(8.0)  # twice the face of the cube
    low, high = (
        scene.bounds if kind == "triangle" else (scene.spheres[:, :, 3].min(0), scene.spheres[:, :, 3].max(0))
    )
    assert np.all(high - low > 1.9)


@pytest.mark.evidence  # needs the reference extra
@pytest.mark.parametrize("kind", t_buffer.KINDS)
def test_the_t_buffer_sees_what_embree_sees(kind) -> None:
    row = t_buffer._visibility(get_context(), t_buffer.crowd(kind, 300, (160, 96)), True, 1, lambda text: None)
    assert (row["kind"], row["objects"]) == (kind, 300)
    assert row["agreement"] > 0.999
    assert row["vs_embree"] == pytest.approx(row["embreex_ms"] / row["glpath_ms"])
    assert row["vs_embree_packets"] == pytest.approx(row["embree_packets_ms"] / row["glpath_ms"])
    assert min(v for k, v in row.items() if k.endswith("_ms")) > 0


@pytest.mark.evidence  # needs the reference extra
def test_a_small_bench_measures_what_it_promises() -> None:
    report = t_buffer.bench_t_buffer(scale=0.02, rounds=1)
    names = {f"vs_embree{way}_{n}" for way in ("", "_packets") for n in t_buffer.COUNTS}
    assert set(report.measured) == names | {"agreement", "frame_ms_first", "frame_ms_kept"}
    assert min(report.measured.values()) > 0
    assert report.measured["agreement"] > 0.99
    for n, count in zip(t_buffer.COUNTS, (20, 2_000, 20_000), strict=True):
        pair = [row for row in report.rows if row["objects"] == count]
        assert sorted(row["kind"] for row in pair) == ["sphere", "triangle"]
        assert report.measured[f"vs_embree_{n}"] == min(row["vs_embree"] for row in pair)
    fast = report.measured["vs_embree_1e3"] >= 1
    agree = report.measured["agreement"] >= 0.999
    assert report.holds is (agree and fast and report.measured["frame_ms_kept"] < report.measured["frame_ms_first"])
    assert bool(report.faults) is not agree
    assert any("do not mean" in note for note in report.notes)


def test_without_embree_the_rest_is_measured_and_nothing_is_claimed(monkeypatch) -> None:
    def absent():
        raise GlpathError("embreex cannot be imported.", "pip install")

    monkeypatch.setattr(embree_peer, "load_embreex", absent)
    report = t_buffer.bench_t_buffer(scale=0.01, rounds=1)
    assert (report.holds, set(report.measured)) == (None, {"frame_ms_first", "frame_ms_kept"})
    assert all(row["glpath_ms"] > 0 for row in report.rows)
    assert "embreex cannot be imported" in report.notes[0]


# Equal error


def test_the_samples_to_a_target_lie_on_the_line() -> None:
    samples = (16, 64, 256)
    errors = 0.064 / np.array(samples)
    slope, needed = line_to_target(samples, errors, 1e-3)
    assert (slope, needed) == (pytest.approx(-1.0), pytest.approx(64.0))
    assert line_to_target(samples, errors, 1e-5)[1] == pytest.approx(6400.0)


def test_the_samples_to_a_target_are_between_the_neighbours_that_were_measured() -> None:
    samples = (16, 64, 256)
    assert samples_to_target(samples, np.array([4e-3, 1e-3, 5e-4]), 2e-3) == pytest.approx(32.0)
    # A floor at 5e-4: a line through all three would promise less.
    assert np.isnan(samples_to_target(samples, np.array([4e-3, 1e-3, 5e-4]), 4e-4))
    assert samples_to_target(samples, np.array([4e-3, 1e-3, 5e-4]), 5e-3) == 16.0


def test_a_small_gather_bench_without_mitsuba_measures_and_claims_nothing(monkeypatch, tmp_path: Path) -> None:
    def absent(*_):
        raise GlpathError("Mitsuba 3 cannot be imported.", "pip install")

    monkeypatch.setattr(mitsuba_peer, "load_mitsuba", absent)
    monkeypatch.setattr(gather, "AGREEMENT", ())  # with the picture below, which lacks bounces
    monkeypatch.setattr(factory, "GATHER_PATCHES", 50)
    monkeypatch.setenv(other_python.PYTHON, sys.executable)
    for peer in (cycles_peer, radiance_peer):
        monkeypatch.setattr(peer.other_python, "find_package", absent)
    path = tmp_path / "reference.exr"
    glpath.render(gather.SCENE, spp=16, max_depth=3).save(path)
    report = gather.bench_gather(seeds=1, reference=path, scale=0.1)
    measured = report.measured
    assert (report.holds, measured["gather_relmse_13"] > 0) == (None, True)
    assert measured["gather_s"] > measured["solver_s"] > 0 or np.isnan(measured["gather_s"])
    assert {row["program"] for row in report.rows} == {"gather", "path"}
    assert "gather_ms_per_set.paths" in measured
    assert "Mitsuba 3 cannot be imported" in report.notes[0]
    assert "vs_mitsuba" not in measured


def test_a_small_bench_of_denoised_pictures_without_mitsuba_measures_and_claims_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("pyoidn", reason="needs the denoise extra")

    def absent(*_: object) -> None:
        raise GlpathError("Mitsuba 3 cannot be imported.", "pip install")

    monkeypatch.setattr(mitsuba_peer, "load_mitsuba", absent)
    monkeypatch.setattr(denoise, "AGREEMENT", ())  # with the picture below, which has noise
    monkeypatch.setattr(factory, "GATHER_PATCHES", 50)
    path = tmp_path / "reference.exr"
    scene = load_scene(gather.SCENE).with_camera(resolution=(64, 64))
    glpath.render(scene, integrator="path", spp=256).save(path)
    report = denoise.bench_denoise(seeds=1, reference=path, scene=scene, most=16, target=4e-4)
    measured = report.measured
    assert "relMSE 0.0004" in report.claim
    assert (report.holds, {row["program"] for row in report.rows}) == (None, {"gather", "path"})
    assert [row["samples"] for row in report.rows] == [4, 8, 16, 4, 8, 16]
    raw = glpath.render(scene, integrator="path", spp=16, seed=1)
    assert measured["path_relmse_16"] < 0.5 * relative_mse(raw.mean, glpath.read_image(path))
    first = report.rows[0]
    before = measured["denoise_s"] + measured["solver_s"] + measured["guide_s"]
    assert first["s"] == pytest.approx(before + 4e-3 * measured["gather_ms_per_set"])
    assert "vs_mitsuba" not in measured


def test_start_up_is_that_of_whole_processes_and_a_peer_that_fails_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(start_up, "_MITSUBA", "import sys; sys.exit('no such peer')")
    monkeypatch.setattr(start_up.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(start_up, "_COLD", {"cold_s": (16, 16)})
    report = bench_start_up(rounds=1)
    assert [row["program"] for row in report.rows] == ["python", "glpath", "default"]
    assert 0 < report.measured["python_s"] < report.measured["glpath_s"] < report.measured["cold_s"]
    assert report.notes == [f"left out: mitsuba {v}: no such peer" for v in ("scalar_rgb", "llvm_ad_rgb")]
    assert report.holds is (report.measured["glpath_s"] <= 1.2 and report.measured["cold_s"] <= 6)


def test_start_up_fails_where_glpath_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start_up, "_SIZE", 0)
    with pytest.raises(GlpathError, match="bench start-up: glpath render failed"):
        bench_start_up(rounds=1)


def test_jobs_by_workers_have_the_bits_of_one_process_and_their_cost_is_told(monkeypatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(jobs, "_WORKERS", (1, 2))
    report = jobs.bench_jobs(scale=0.01, rounds=1)
    assert report.faults == []
    assert [row["workers"] for row in report.rows] == [1, 2]
    assert report.measured["speedup_2"] == report.measured["workers_1_s"] / report.measured["workers_2_s"]
    assert report.measured["part_mb"] == pytest.approx(32 * 32 * 3 * 8 * 8 / 1e6, rel=0.1)


def test_films_of_workers_that_are_not_the_same_are_a_fault(monkeypatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(jobs, "_WORKERS", (1, 2))

    def of_other_path_sets(job, scene, options):
        film = render_job(replace(job, path_sets=(64, 192)))
        film.metadata.statistics.update(dict.fromkeys(("merge_s", "gather_s", "chunks", "worker_s"), 1.0))
        return film

    # No workers: what is wrong with their films shows whoever made them.
    workers = SimpleNamespace(render=of_other_path_sets)
    monkeypatch.setattr(jobs, "Cluster", lambda address: nullcontext(workers))
    assert any("other bits" in fault for fault in jobs.bench_jobs(scale=0.01, rounds=1).faults)


def test_the_error_beside_a_noisy_reference_is_the_pictures_own() -> None:
    """Two films of a seed each are twice as far apart as each is from the truth."""
    one, other = (
        glpath.render("cornell-box-36", resolution=(32, 32), integrator="path", spp=64, seed=seed)
        for seed in (1, 2)
    )
    own = one.variance_of_mean() / (other.mean**2 + 1e-2)
    assert defaults.error_beside(one.mean, other) == pytest.approx(own.mean(), rel=0.5)
    assert relative_mse(one.mean, other.mean) > 1.5 * own.mean()
