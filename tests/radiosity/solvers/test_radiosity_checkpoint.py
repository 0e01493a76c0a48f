"""A solver that is killed resumes from its checkpoint, bit-identical."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from glpath import RadiositySolution, solve_radiosity
from glpath.cli.main import app
from glpath.radiosity import RadiosityInterrupted
from glpath.radiosity.form_factors.lights import DirectLight
from glpath.radiosity.form_factors.transport import Transport
from glpath.radiosity.solvers import progressive
from glpath.radiosity.solvers.checkpoint import SolverCheckpoint
from glpath.radiosity.solvers.monte_carlo import Shooting
from glpath.radiosity.solvers.particles import ParticleSurfaces
from glpath.radiosity.solvers.progressive import Refinement
from glpath.scene.model import Light
from glpath.system import files
from tests.support.clock import Clock

BOX = "cornell-box-36"
METHODS: list[dict[str, Any]] = [
    {"method": "progressive", "patches": 60, "receiver_points": 1},
    {"method": "progressive", "patches": 60, "receiver_points": 1, "adaptive": 2, "overshoot": True},
    {"method": "monte-carlo", "patches": 60, "particles": 10 << 14},
]


class KilledError(Exception):
    """The process ends here."""


def same(ours: RadiositySolution, theirs: RadiositySolution) -> bool:
    return np.array_equal(ours.elements, theirs.elements) and np.array_equal(ours.vertices, theirs.vertices)


def killed_at(step: int, checkpoint: SolverCheckpoint, options: dict[str, Any]) -> None:
    """Solve until so many reports were made, as far as the file says."""
    reports = []

    def kill(progress: glpath.RadiosityProgress) -> None:
        reports.append(progress)
        if len(reports) == step:
            raise KilledError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("glpath.radiosity.solvers.solve._REPORT_INTERVAL", 0.0)
        with pytest.raises(KilledError):
            solve_radiosity(BOX, on_progress=kill, checkpoint=checkpoint, **options)


@pytest.mark.parametrize("options", METHODS)
def test_a_solution_that_is_gone_on_with_has_the_bits_of_one_go(options: dict[str, Any], tmp_path: Path) -> None:
    whole = solve_radiosity(BOX, **options)
    path = tmp_path / "s.checkpoint.npz"
    steps = whole.statistics.get("steps", 10)
    for step in (2, 5, steps // 2) if options["method"] == "progressive" else (1, 2):
        killed_at(step, SolverCheckpoint(path, seconds=0.0), options)
    assert path.exists()
    again = solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **options)
    assert same(again, whole)
    for name in ("steps", "particles", "hits"):
        assert again.statistics.get(name) == whole.statistics.get(name)


def test_it_goes_on_between_two_splits(tmp_path: Path) -> None:
    options = METHODS[1]
    whole = solve_radiosity(BOX, **options)
    path = tmp_path / "s.checkpoint.npz"
    before = len(whole.divisions)
    killed_at(whole.statistics["steps"] - 2, SolverCheckpoint(path, seconds=0.0), options)
    with np.load(path) as stored:
        assert len(stored["split_sizes"]) > 0, "it was killed after elements were split"
    assert same(solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **options), whole)
    assert before == len(whole.divisions)


def test_a_checkpoint_of_another_solution_is_refused_with_all_that_differs(tmp_path: Path) -> None:
    path = tmp_path / "s.checkpoint.npz"
    killed_at(2, SolverCheckpoint(path, seconds=0.0), METHODS[2])
    with pytest.raises(glpath.UsageError) as caught:
        solve_radiosity("cornell-box", method="monte-carlo", patches=60, seed=3, checkpoint=SolverCheckpoint(path))
    for words in ("scene is ", "settings.seed is 0 in it, 3 is asked for", "settings.particles is 163840"):
        assert words in str(caught.value)
    path.write_bytes(b"no checkpoint")
    with pytest.raises(glpath.ImageError, match="cannot be read as a checkpoint"):
        solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **METHODS[2])
    with pytest.raises(glpath.UsageError, match="checkpoint with method"):
        solve_radiosity(BOX, method="matrix", checkpoint=SolverCheckpoint(path))


#: A run of Monte Carlo that refines its lattices once, after 8 batches.
REFINING: dict[str, Any] = {"method": "monte-carlo", "patches": 60, "particles": 8 << 14, "adaptive": 4}


@pytest.mark.parametrize("batch", [3, 9])
def test_a_run_that_is_killed_after_a_refinement_resumes_with_the_same_bits(batch: int, tmp_path: Path) -> None:
    """`particles` is the number in the second pass, which 8 batches do not divide."""
    whole = solve_radiosity(BOX, **REFINING)
    assert whole.statistics["particles"] % REFINING["particles"], "another goal than `asked`"
    checkpoint = SolverCheckpoint(tmp_path / "s.npz", steps=1)
    passes = []

    def kill(progress: glpath.RadiosityProgress) -> None:
        if progress.stage == "particles":
            passes.append(progress.steps)
            if len(passes) > 8 and progress.steps >= batch << 14:
                raise KilledError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("glpath.radiosity.solvers.solve._REPORT_INTERVAL", 0.0)
        patch.setattr("glpath.radiosity.solvers.monte_carlo.core_count", lambda: 1)
        with pytest.raises(KilledError):
            solve_radiosity(BOX, on_progress=kill, checkpoint=checkpoint, **REFINING)
    assert passes[-1] < sum(passes)
    again = solve_radiosity(BOX, checkpoint=SolverCheckpoint(tmp_path / "s.npz"), **REFINING)
    assert same(again, whole)
    assert again.statistics["particles"] == whole.statistics["particles"]


def test_a_finished_run_resumes_to_the_same_end(tmp_path: Path) -> None:
    checkpoint = SolverCheckpoint(tmp_path / "s.npz", steps=1)
    whole = solve_radiosity(BOX, checkpoint=checkpoint, **REFINING)
    again = solve_radiosity(BOX, checkpoint=SolverCheckpoint(tmp_path / "s.npz"), **REFINING)
    assert same(again, whole)
    assert again.statistics["particles"] == whole.statistics["particles"]


def test_checkpoints_are_due_again_if_the_work_counts_its_steps_anew() -> None:
    checkpoint = SolverCheckpoint("s.npz", steps=4)
    checkpoint._last_step = 60
    assert checkpoint.due(1)
    checkpoint._last_step = 1
    assert [checkpoint.due(step) for step in range(1, 8)] == [False] * 4 + [True] * 3


def test_the_checkpoint_of_another_camera_is_refused_if_the_solution_is_for_the_camera(tmp_path: Path) -> None:
    options = {**METHODS[2], "particles": 1 << 14, "adaptive": 0, "for_camera": True}
    scene = glpath.load_scene(BOX)
    solve_radiosity(scene, checkpoint=SolverCheckpoint(tmp_path / "s.npz", steps=1), **options)
    elsewhere = replace(scene, camera=replace(scene.camera, fov=scene.camera.fov / 2))
    with pytest.raises(glpath.UsageError, match="scene is"):
        solve_radiosity(elsewhere, checkpoint=SolverCheckpoint(tmp_path / "s.npz"), **options)


@pytest.mark.parametrize("options", [METHODS[0], {**METHODS[2], "adaptive": 0}])
def test_the_state_is_kept_every_so_many_steps(options: dict[str, Any], tmp_path: Path) -> None:
    checkpoint = SolverCheckpoint(tmp_path / "s.npz", steps=4)
    solution = solve_radiosity(BOX, checkpoint=checkpoint, **options)
    steps = solution.statistics.get("steps") or solution.statistics["particles"] >> 14
    assert 1 <= checkpoint.written <= steps // 4
    assert SolverCheckpoint(tmp_path / "s.npz").found()


ENDLESS: list[tuple[dict[str, Any], str, int]] = [
    ({"method": "progressive", "patches": 60, "receiver_points": 1, "unshot": 1e-300}, "max_steps", 1),
    ({"method": "monte-carlo", "patches": 60, "adaptive": 0, "particles": 1 << 40}, "particles", 1 << 14),
]


@pytest.mark.parametrize(("options", "count", "unit"), ENDLESS)
def test_a_time_limit_ends_it_with_what_so_many_steps_give(options: dict[str, Any], count: str, unit: int) -> None:
    solve_radiosity(BOX, **{**options, count: unit})  # its kernels are compiled then
    found = solve_radiosity(BOX, time_limit=0.05, **options)
    assert found.statistics["stop_rule"] == "time limit"
    assert found.statistics["elapsed_s"] >= 0.05
    steps = found.statistics["steps" if count == "max_steps" else "particles"]
    assert steps >= unit
    again = solve_radiosity(BOX, **{**options, count: steps})
    assert same(found, again)
    assert again.statistics["stop_rule"] == "done"


@pytest.mark.parametrize(("options", "count", "unit"), ENDLESS)
def test_the_time_before_a_checkpoint_counts(
    options: dict[str, Any], count: str, unit: int, tmp_path: Path
) -> None:
    name, path = "steps" if count == "max_steps" else "particles", tmp_path / "s.npz"
    solve_radiosity(BOX, **{**options, count: unit})  # its kernels are compiled then
    first = solve_radiosity(BOX, time_limit=0.05, checkpoint=SolverCheckpoint(path), **options)
    second = solve_radiosity(BOX, time_limit=0.04, checkpoint=SolverCheckpoint(path), **options)
    assert first.statistics[name] < second.statistics[name] <= first.statistics[name] + unit * 64
    assert second.statistics["elapsed_s"] > first.statistics["elapsed_s"]


def test_a_limit_that_ends_while_a_solver_is_restored_keeps_its_solution(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Direct light of elements is found anew, and may take longer than the limit."""
    box = glpath.load_scene(BOX)
    lamp = Light("lamp", "point", np.full(3, 1e5), np.array([278.0, 400.0, 280.0]))
    scene, path = replace(box, lights=(lamp,)), tmp_path / "s.npz"
    options: dict[str, Any] = {**METHODS[0], "patches": 40}

    def kill(progress: glpath.RadiosityProgress) -> None:
        if progress.steps == 4:
            raise KilledError

    with pytest.raises(KilledError):
        solve_radiosity(scene, on_progress=kill, checkpoint=SolverCheckpoint(path, seconds=0.0), **options)
    estimate = DirectLight.estimate

    def late(self: DirectLight, *given: Any, **by_name: Any) -> Any:
        clock.ahead = 1e6
        return estimate(self, *given, **by_name)

    monkeypatch.setattr(DirectLight, "estimate", late)
    found = solve_radiosity(scene, time_limit=100.0, checkpoint=SolverCheckpoint(path), **options)
    assert (clock.ahead, found.statistics["stop_rule"]) == (1e6, "time limit")


@pytest.mark.parametrize("elapsed_s", [-1.0, np.nan, np.inf])
def test_a_checkpoint_whose_time_is_none_is_refused(elapsed_s: float, tmp_path: Path) -> None:
    path = tmp_path / "s.npz"
    solve_radiosity(BOX, checkpoint=SolverCheckpoint(path, steps=1), **METHODS[0], max_steps=2)
    np.savez(path, **{**np.load(path), "elapsed_s": np.float64(elapsed_s)})
    with pytest.raises(glpath.GlpathError, match=r"s\.npz: cannot be read .*elapsed_s is"):
        solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **METHODS[0], max_steps=2)


def late_from(clock: Clock, stage: str, is_late: Callable[[glpath.RadiosityProgress], bool]) -> Any:
    """Report that moves the clock beyond all limits and their grace, if progress of the stage `is_late`."""

    def report(progress: glpath.RadiosityProgress) -> None:
        if progress.stage == stage and is_late(progress):
            clock.ahead = 1e6

    return report


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that stands still, and reports of every step."""
    monkeypatch.setattr("glpath.radiosity.solvers.solve._REPORT_INTERVAL", 0.0)
    monkeypatch.setattr("glpath.radiosity.solvers.monte_carlo.core_count", lambda: 1)
    return Clock(monkeypatch)


@pytest.mark.parametrize("adaptive", [0, 1])
def test_a_limit_that_ends_within_a_step_keeps_the_steps_before(clock: Clock, adaptive: int) -> None:
    options = {**METHODS[0], "adaptive": adaptive}
    stage = "refining" if adaptive else "shooting"
    report = late_from(clock, stage, lambda progress: progress.steps >= 7)
    found = solve_radiosity(BOX, time_limit=100.0, on_progress=report, **options)
    assert found.statistics["stop_rule"] == "time limit"
    steps = found.statistics["steps"]
    assert steps == 7 or adaptive
    assert same(found, solve_radiosity(BOX, **METHODS[0], max_steps=steps))


def test_a_limit_that_ends_before_the_first_step_is_an_error(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    class LateRefinement(Refinement):
        def __init__(self, *options: Any) -> None:
            super().__init__(*options)
            clock.ahead = 1e6

    monkeypatch.setattr("glpath.radiosity.solvers.solve.Refinement", LateRefinement)
    with pytest.raises(glpath.TimeLimitError, match="time_limit=100: over while preparing the radiosity solver"):
        solve_radiosity(BOX, time_limit=100.0, **METHODS[0])


def test_too_little_memory_for_the_preparation_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def prepare(*_: Any) -> None:
        raise MemoryError("Unable to allocate 1.21 GiB")

    monkeypatch.setattr("glpath.radiosity.solvers.solve.Transport", prepare)
    with pytest.raises(glpath.GlpathError, match=r"there is not enough memory\. Unable to allocate 1\.21 GiB"):
        solve_radiosity(BOX, **METHODS[0])


def test_a_limit_soon_after_finer_lattices_began_keeps_the_particles_of_the_coarser_ones(clock: Clock) -> None:
    """The particles of a pass are lost if lattices are refined after it."""
    options: dict[str, Any] = {"method": "monte-carlo", "patches": 100, "particles": 12 << 14, "adaptive": 4}
    counts: list[int] = []

    def report(progress: glpath.RadiosityProgress) -> None:
        begins_anew = bool(counts) and progress.steps < counts[-1]
        counts.append(progress.steps)
        if begins_anew:
            clock.ahead = 1e6

    found = solve_radiosity(BOX, time_limit=100.0, on_progress=report, **options)
    assert counts[-3:] == [12 << 14, 1 << 14, 2 << 14]
    assert found.statistics["particles"] == 12 << 14
    assert found.statistics["stop_rule"] == "time limit"
    late = late_from(clock, "particles", lambda progress: progress.steps == 12 << 14)
    clock.ahead = 0.0
    before = solve_radiosity(BOX, time_limit=100.0, on_progress=late, **options)
    assert same(found, before)


class StruckArray(np.ndarray):
    """Array at whose first use a signal comes."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return getattr(ufunc, method)(*map(np.asarray, inputs), **options)


def strike_batch(patch: pytest.MonkeyPatch) -> None:
    """Let a signal come while the fourth batch of particles is added."""

    def struck(shooting: Shooting, number: int) -> Any:
        arrivals, hits = batch(shooting, number)
        return arrivals._replace(square=arrivals.square.view(StruckArray)) if number == 3 else arrivals, hits

    batch = Shooting._batch
    patch.setattr(Shooting, "_batch", struck)


def strike_call(owner: Any, name: str, number: int) -> Callable[[pytest.MonkeyPatch], None]:
    """Let a signal come at the end of a function's call of this number."""

    def strike(patch: pytest.MonkeyPatch) -> None:
        function, left = getattr(owner, name), [number]

        def struck(*given: Any) -> Any:
            found = function(*given)
            left[0] -= 1
            if not left[0]:
                raise KeyboardInterrupt
            return found

        patch.setattr(owner, name, struck)

    return strike


@pytest.mark.parametrize(
    ("options", "strike", "name", "count"),
    [
        ({**METHODS[2], "adaptive": 0, "particles": 6 << 14}, strike_batch, "particles", 4 << 14),
        ({**METHODS[0], "unshot": 0.3}, strike_call(progressive, "_shoot", 3), "steps", 3),
        ({**METHODS[1], "unshot": 0.5, "adaptive": 1}, strike_call(Transport, "refine", 1), "steps", None),
    ],
    ids=["batch", "shot", "split"],
)
def test_a_signal_within_a_step_loses_nothing(
    options: dict[str, Any], strike: Any, name: str, count: int | None, tmp_path: Path
) -> None:
    """The checkpoint has no interval, as that of --resume alone."""
    whole, path = solve_radiosity(BOX, **options), tmp_path / "s.checkpoint.npz"
    with pytest.MonkeyPatch.context() as patch:
        strike(patch)
        with pytest.raises(RadiosityInterrupted) as stop:
            solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **options)
    assert stop.value.solution is not None
    if count is not None:
        assert stop.value.solution.statistics[name] == count
    assert same(solve_radiosity(BOX, checkpoint=SolverCheckpoint(path), **options), whole)
    assert path.exists(), "the last solution resumed from it"


@pytest.mark.parametrize(
    "strike",
    [strike_call(ParticleSurfaces, "on_lattices", 2), strike_call(Shooting, "deepen", 1)],
    ids=["within", "after"],
)
def test_a_signal_while_lattices_are_refined_keeps_the_particles_of_the_coarser_ones(
    strike: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, Any] = {"method": "monte-carlo", "patches": 100, "particles": 12 << 14, "adaptive": 4}

    def interrupt(progress: glpath.RadiosityProgress) -> None:
        if progress.steps == 12 << 14:
            raise KeyboardInterrupt

    monkeypatch.setattr("glpath.radiosity.solvers.solve._REPORT_INTERVAL", 0.0)
    with pytest.raises(RadiosityInterrupted) as first:
        solve_radiosity(BOX, on_progress=interrupt, **options)
    strike(monkeypatch)
    with pytest.raises(RadiosityInterrupted) as stop:
        solve_radiosity(BOX, **options)
    assert first.value.solution is not None
    assert stop.value.solution is not None
    assert stop.value.solution.statistics["particles"] == 12 << 14
    assert same(stop.value.solution, first.value.solution)


def test_a_time_limit_of_what_has_no_steps_is_refused() -> None:
    with pytest.raises(glpath.UsageError, match="time_limit with method"):
        solve_radiosity(BOX, method="matrix", time_limit=3)


def test_a_full_disk_is_told_once_and_solving_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, "replace", full)
    checkpoint = SolverCheckpoint(tmp_path / "s.npz", seconds=0.0)
    solution = solve_radiosity(BOX, checkpoint=checkpoint, **METHODS[0])
    assert solution.elements.max() > 0
    assert "No space left" in str(checkpoint.failure)
    assert sum("solving continues" in record.getMessage() for record in caplog.records) == 1


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["radiosity", BOX, *map(str, arguments)])


def test_the_command_resumes_after_a_scheduler_s_signal(tmp_path: Path) -> None:
    out, options = tmp_path / "s.npz", ["--method", "monte-carlo", "--patches", "60", "--particles"]
    command = [sys.executable, "-m", "glpath", "radiosity", BOX, "-o", str(out), *options, str(60_000 << 14)]
    command += ["--checkpoint", "1s", "--resume", "--progress", "json"]
    checkpoint = tmp_path / "s.checkpoint.npz"
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        until = time.monotonic() + 60
        while not checkpoint.exists() and time.monotonic() < until:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        told = process.stderr.read()
    assert process.returncode == 75, told
    assert f"--resume continues from {checkpoint}" in told
    assert os.listdir(tmp_path) == [checkpoint.name]
    refused = run("-o", out, *options, 60_000 << 14, "--checkpoint", "1s")
    assert (refused.exit_code, "--resume continues it" in refused.stderr) == (2, True)


def test_the_checkpoint_is_removed_when_all_is_done(tmp_path: Path) -> None:
    done = run("-o", tmp_path / "s.npz", "--patches", 60, "--receiver-points", 1, "--checkpoint", "0.001s", "-q")
    assert done.exit_code == 0, done.output
    assert os.listdir(tmp_path) == ["s.npz"]


def test_the_command_ends_by_its_time_limit_and_says_so(tmp_path: Path) -> None:
    done = run(
        *("-o", tmp_path / "s.npz", "--method", "monte-carlo", "--patches", 60, "--particles", 60_000 << 14),
        *("--checkpoint", "1s", "--time-limit", "0.5s"),
    )
    assert done.exit_code == 0, done.output
    assert "ended by the time limit" in done.stderr
    assert os.listdir(tmp_path) == ["s.npz"]
