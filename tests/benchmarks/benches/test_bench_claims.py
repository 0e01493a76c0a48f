"""The verdicts of the benches: they hold of the engines, and a wrong one fails, however fast.

Mitsuba's part is played by its stored pictures with noise, and times are made up: what is tested is the verdict.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import office_table
from benchmarks.benches import equal_error, gather, path_buffer, shaft, t_buffer
from benchmarks.benches.equal_error import Contestant
from benchmarks.references.kept import Reference
from benchmarks.references.stored import smaller, stored_reference
from glpath.integrators.path_settings import PathSettings
from glpath.io import load_scene
from tests.conftest import Spoil

SIDE = 32
NOT_THE_NEAREST = ("scene/ray_bvh.glsl", "if (at < t)", "if (at < NO_HIT)")
NO_SHADOWS = ("scene/ray_bvh.glsl", "return blocked;", "return false;")
BRIGHT = ("lights/light_sample.glsl", "found.light = l.radiance *", "found.light = 2.0 * l.radiance *")
A_TENTH_BRIGHTER = ("lights/light_sample.glsl", "found.light = l.radiance *", "found.light = 1.1 * l.radiance *")
BLACK_LOOK_UP = (
    "path/path_rays.glsl",
    "path.L += path.beta * diffuse_reflectance(s.v.bsdf, dot(s.v.n, s.v.wo)) * found.rgb / PI;",
    "",
)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures; Mitsuba's are the stored ones with as much noise as it has, a second for each sample."""

    def peer_in_steps(peer, samples, depth, seed):
        truth, random = smaller(stored_reference("cornell-box-36", depth), SIDE), np.random.default_rng(seed)
        noisy = [truth * (1 + 0.3 / np.sqrt(n) * random.normal(size=truth.shape)) for n in samples]
        return [1000.0 for _ in samples], noisy

    for bench in (path_buffer, gather):
        monkeypatch.setattr(bench, "load_scene", lambda name: load_scene(name).with_camera(resolution=(SIDE, SIDE)))
        monkeypatch.setattr(bench, "render_peer_in_steps", peer_in_steps)
        monkeypatch.setattr(bench, "stage_times", lambda tracer: {})
        monkeypatch.setattr(bench, "TARGET", 5e-3)
        monkeypatch.setattr(bench, "other_peers", lambda *_: nullcontext({}))
    monkeypatch.setattr(equal_error, "mitsuba_scenes", lambda *_: lambda spp: None)
    monkeypatch.setattr(
        equal_error,
        "reference_picture",
        lambda given, scene, depth, *_: Reference(smaller(stored_reference(scene.name, depth), SIDE), 0.0, ""),
    )
    monkeypatch.setattr(Contestant, "grow", lambda *_: None)
    monkeypatch.setattr(gather, "radiance_row", lambda *_: ({}, []))
    in_steps = gather.trace_in_steps

    def timed(tracer, counts):
        ms = 1000.0 if isinstance(tracer.settings, PathSettings) else 10.0
        return [ms for _ in counts], in_steps(tracer, counts)[1]

    monkeypatch.setattr(gather, "trace_in_steps", timed)
    monkeypatch.setattr(path_buffer, "_SETS", (16, 32, 64))
    monkeypatch.setattr(gather, "_GATHER_SETS", (16, 32, 64))
    monkeypatch.setattr(gather, "_PATH_SETS", (32, 64))


@pytest.mark.usefixtures("small")
def test_the_bench_of_the_path_buffer_holds() -> None:
    report = path_buffer.bench_path_buffer(seeds=1)
    assert (report.holds, report.faults) == (True, []), report.measured
    assert report.claim.endswith("vs_mitsuba >= 0.5, last_relmse <= target)")


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("wrong", [NOT_THE_NEAREST, BRIGHT, A_TENTH_BRIGHTER])
def test_the_bench_of_the_path_buffer_fails_with_a_wrong_engine(wrong, spoil: Spoil) -> None:
    spoil(*wrong)
    report = path_buffer.bench_path_buffer(seeds=1)
    assert report.holds is False
    assert any("mean_off <= 0.01 is not so" in fault or "relmse_of_one_set" in fault for fault in report.faults)


@pytest.mark.usefixtures("small")
def test_the_bench_of_the_path_buffer_wants_the_error_to_get_to_the_target(monkeypatch) -> None:
    monkeypatch.setattr(path_buffer, "TARGET", 1e-5)
    report = path_buffer.bench_path_buffer(seeds=1)
    assert (report.holds, report.faults) == (False, [])


@pytest.mark.usefixtures("small")
def test_the_bench_of_the_gather_holds() -> None:
    report = gather.bench_gather(seeds=1)
    assert (report.holds, report.faults) == (True, []), report.measured


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("wrong", [NO_SHADOWS, BLACK_LOOK_UP, A_TENTH_BRIGHTER])
def test_the_bench_of_the_gather_fails_with_a_wrong_engine(wrong, spoil: Spoil) -> None:
    spoil(*wrong)
    report = gather.bench_gather(seeds=1)
    assert report.holds is False
    assert any("gather_mean_off" in fault for fault in report.faults)


def a_row(agreement: float) -> Callable[..., dict[str, object]]:
    return lambda *_: {"vs_embree": 5.0, "vs_embree_packets": 2.0, "agreement": agreement}


@pytest.mark.parametrize(("agreement", "holds"), [(1.0, True), (0.9, False)])
def test_the_bench_of_the_t_buffer_fails_where_embree_sees_something_else(agreement, holds, monkeypatch) -> None:
    monkeypatch.setattr(t_buffer.embree_peer, "load_embreex", lambda: None)
    monkeypatch.setattr(t_buffer, "_visibility", a_row(agreement))
    monkeypatch.setattr(t_buffer, "_frame_times", lambda *_: {"frame_ms_first": 2.0, "frame_ms_kept": 1.0})
    report = t_buffer.bench_t_buffer(scale=0.01)
    assert report.holds is holds
    assert report.faults == ([] if holds else ["agreement >= 0.999 is not so: 0.9"])


@pytest.mark.evidence  # needs the reference extra
@pytest.mark.parametrize(
    "wrong",
    [
        ("t_buffer/t_buffer.frag", "gl_FragDepth = t * DEPTH_SCALE;", "gl_FragDepth = 1.0 - t * DEPTH_SCALE;"),
        ("t_buffer/t_buffer.vert", "own_pixels = ivec4(begin, end);", "own_pixels = ivec4(begin + 1, end - 1);"),
    ],
)
def test_the_bench_of_the_t_buffer_fails_with_a_wrong_engine(wrong, spoil: Spoil) -> None:
    spoil(*wrong)
    report = t_buffer.bench_t_buffer(scale=0.02, rounds=1)
    assert report.holds is False
    assert report.faults


def lost(occluders, options, *more, **others):
    """Shafts that leave out what stands between."""
    if options.strategy != "no shaft":
        far = 1000.0 * (np.arange(len(occluders)) % 2)
        occluders = replace(occluders, corners=occluders.corners + far[:, None, None])
    return _visibility(occluders, options, *more, **others)


_visibility = office_table.Visibility


def test_the_benches_of_shafts_fail_where_shafts_lose_occluders(monkeypatch) -> None:
    def absent(where):
        raise shaft.GlpathError("embreex cannot be imported", "pip install")

    monkeypatch.setattr(shaft, "_EmbreeRays", absent)
    monkeypatch.setattr(shaft, "SIZES", ())
    right = shaft.bench_shaft(scale=0.1, rounds=1)
    assert right.faults == []
    monkeypatch.setattr(shaft, "Visibility", lost)
    wrong = shaft.bench_shaft(scale=0.1, rounds=1)
    assert any("blocked_off_ours <= 0.0001 is not so" in fault for fault in wrong.faults)


@pytest.mark.parametrize(("blocked", "faults"), [(0.25, 0), (0.2, 1)])
def test_the_bench_of_shaft_options_fails_where_they_see_differently(blocked, faults, monkeypatch) -> None:
    def rows(spacing, side, rounds, names):
        kinds = {"best": 0.25, "best, changed": blocked, "paper": 0.25}
        return [{"scene": names[0], "options": key, "time": 1.0, "blocked": b} for key, b in kinds.items()]

    monkeypatch.setattr(shaft, "option_rows", rows)
    assert len(shaft.bench_shaft_options().faults) == faults
