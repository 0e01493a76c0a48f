"""The end of a command keeps its exit code, whatever happens to statistics and to the checkpoint."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer

import glpath
from glpath.cli import daylight, running
from glpath.cli.outcome import Outcome
from glpath.cli.run_request import RunRequest
from glpath.cli.signals import interrupted, signals_wait_for_results
from glpath.film.film import Film
from glpath.jobs.checkpoint import Checkpoint
from glpath.rendering import calls
from glpath.rendering.interrupts import RenderInterrupted
from glpath.system.time_limit import check_time, limited, seconds_left
from tests.conftest import MakeFilm
from tests.support.clock import Clock
from tests.support.command_line import run
from tests.support.time_limit import time_limit


def exit_code_of(outcome: Outcome) -> int:
    with pytest.raises(typer.Exit) as end:
        outcome.leave(lambda: ([], None), lambda _: [], lambda _: "")
    return end.value.exit_code


@pytest.fixture
def outcome_of_sigterm(tmp_path: Path, make_film: MakeFilm) -> Iterator[Outcome]:
    """Outcome of a render with a checkpoint that SIGTERM has ended after two path sets."""
    film = make_film([(0, 2)], stop_rule="interrupted")
    with signals_wait_for_results():
        interrupted(signal.SIGTERM)
        checkpoint = Checkpoint(tmp_path / "a.checkpoint.npz")
        yield Outcome(film, None, RunRequest(stats=tmp_path / "s" / "s.json"), checkpoint, 0)


def test_render_that_a_scheduler_ended_resumes_although_its_statistics_cannot_be_written(
    outcome_of_sigterm: Outcome, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "s").write_text("a file where a folder is needed")
    assert exit_code_of(outcome_of_sigterm) == 75
    assert Film.load(tmp_path / "a.checkpoint.npz").path_sets == 2
    assert "--stats: " in caplog.text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_render_that_a_scheduler_ended_does_not_wait_for_a_reader_of_its_statistics(
    outcome_of_sigterm: Outcome, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pipe = tmp_path / "s" / "s.json"
    pipe.parent.mkdir()
    os.mkfifo(pipe)
    with time_limit(5):
        assert exit_code_of(outcome_of_sigterm) == 75
    assert "cannot be written: nobody reads the pipe" in caplog.text
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert exit_code_of(outcome_of_sigterm) == 75
    assert json.loads(os.read(reader, 1 << 16))["path_sets"] == 2
    os.close(reader)


def test_checkpoint_that_cannot_be_removed_leaves_a_finished_render_with_its_statistics(
    tmp_path: Path, make_film: MakeFilm, capfd: pytest.CaptureFixture[str]
) -> None:
    checkpoint = Checkpoint(tmp_path / "a.checkpoint.npz")
    checkpoint.path.mkdir()  # `unlink` refuses a folder, also to root
    film, request = make_film([(0, 2)], stop_rule="spp"), RunRequest(stats=tmp_path / "s.json")
    assert exit_code_of(Outcome(film, None, request, checkpoint, 0)) == 3
    assert json.loads(request.stats.read_text())["path_sets"] == 2
    assert "done, but the checkpoint was not removed: " in capfd.readouterr().err


@pytest.mark.parametrize("stop_rule", ["spp", "interrupted"])
def test_checkpoint_has_all_path_sets_before_outputs_are_made(
    stop_rule: str, tmp_path: Path, make_film: MakeFilm
) -> None:
    film, checkpoint = make_film([(0, 2)], stop_rule=stop_rule), Checkpoint(tmp_path / "a.checkpoint.npz")

    def denoise() -> tuple[list[Path], None]:
        raise KeyboardInterrupt  # as SIGKILL: nothing after it runs

    with signals_wait_for_results(), pytest.raises(KeyboardInterrupt):
        Outcome(film, None, RunRequest(), checkpoint, 0).leave(denoise, lambda _: [], lambda _: "")
    assert Film.load(checkpoint.path).ranges == film.ranges


def test_checkpoint_with_all_path_sets_is_not_written_again(tmp_path: Path, make_film: MakeFilm) -> None:
    film, checkpoint = make_film([(0, 2)], stop_rule="interrupted"), Checkpoint(tmp_path / "a.checkpoint.npz")
    with signals_wait_for_results():
        Outcome(film, None, RunRequest(quiet=True), checkpoint, 0).leave(
            lambda: ([], None), lambda _: [], lambda _: ""
        )
    assert (checkpoint.written, Film.load(checkpoint.path).path_sets) == (1, 2)


class Saved:
    """Result that is saved as an empty file."""

    texels = None

    def save(self, path: Path) -> None:
        path.touch()


def test_checkpoint_that_cannot_be_removed_leaves_a_finished_solution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def solve(scene: object, options: dict[str, Any], mode: str) -> tuple[Saved, bool]:
        options["checkpoint"].path.mkdir()
        return Saved(), True

    monkeypatch.setattr("glpath.cli.radiosity._solve", solve)
    done = run("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "-q", "--checkpoint", "1h")
    assert (done.exit_code, "the checkpoint was not removed" in done.stderr) == (3, True), done.stderr
    assert (tmp_path / "s.npz").exists()


def test_check_of_a_solution_obeys_the_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watches: list[bool] = []

    @contextmanager
    def watched(*_: object) -> Iterator[None]:
        watches.append(True)
        yield
        watches.append(False)

    def check(*_: object) -> None:
        assert watches[-1]
        assert seconds_left() < 600
        raise glpath.TimeLimitError("ended")

    monkeypatch.setattr("glpath.cli.radiosity._solve", lambda *_: (Saved(), True))
    monkeypatch.setattr("glpath.cli.radiosity.watched", watched)
    monkeypatch.setattr("glpath.rendering.element_error", check)
    asked = ("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "-q", "--check", "--time-limit", "600")
    for strict, code in (((), 0), (("--strict",), 1)):
        done = run(*asked, *strict)
        assert (done.exit_code, (tmp_path / "s.npz").exists()) == (code, True), done.stderr
        assert "glpath: warning: --check: left out, because --time-limit is over" in done.stderr
        (tmp_path / "s.npz").unlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_checkpoint_that_cannot_be_removed_leaves_finished_daylight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compute(scene: object, at: object, options: object, checkpoint: Any, request: object) -> Saved:
        os.mkfifo(checkpoint.path)
        return Saved()

    monkeypatch.setattr(daylight, "_computed", compute)
    monkeypatch.setattr(daylight, "_summary", lambda found: [])
    (tmp_path / "p.csv").write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    options = ["--points", tmp_path / "p.csv", "-q", "--resume"]
    done = run("daylight", "cornell-box-36", "-o", tmp_path / "d.npz", *options)
    assert (done.exit_code, "the checkpoint was not removed" in done.stderr) == (3, True), done.stderr
    assert (tmp_path / "d.npz").exists()


def test_checkpoint_of_a_cluster_is_written_before_the_cluster_closes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make_film: MakeFilm
) -> None:
    film = make_film([(0, 2)], stop_rule="interrupted")
    found: list[int] = []

    @contextmanager
    def workers_of(address: str) -> Iterator[object]:
        try:
            yield SimpleNamespace()
        finally:  # a cluster takes longer to close than containers wait
            found.append(Film.load(tmp_path / "a.checkpoint.npz").path_sets)

    def run_job(*_: object) -> Film:
        raise RenderInterrupted(film, signal.SIGTERM)

    monkeypatch.setattr(running, "workers_of", workers_of)
    monkeypatch.setattr(calls, "run_job", run_job)
    options = ["--spp", 5, "--checkpoint", "1h", "--cluster", "local:2"]
    done = run("render", "furnace", "-o", tmp_path / "a.png", *options)
    assert (done.exit_code, found) == (75, [2]), done.stderr


def test_time_limit_ends_with_an_interrupted_render(monkeypatch: pytest.MonkeyPatch, make_film: MakeFilm) -> None:
    def start(options: object) -> Film:
        raise RenderInterrupted(make_film([(0, 2)], stop_rule="interrupted"))

    clock = Clock(monkeypatch)
    with signals_wait_for_results(), limited(1.0):
        running.outcome_of(start, RunRequest(hang_limit="0"), None, None)
        clock.ahead = 9.0
        check_time("packing the atlas that is written")


def test_film_that_a_signal_ends_before_its_first_new_path_set_is_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def prepared(*_: object) -> None:
        signal.raise_signal(signal.SIGTERM)
        raise AssertionError("the signal interrupts")

    box = ["cornell-box-36", "--resolution", "4x4", "--max-depth", 1, "-o", tmp_path / "a.npz", "--no-denoise"]
    assert run("render", *box, "--spp", 1).exit_code == 0
    assert Film.load(tmp_path / "a.npz").metadata.stop_rule == "spp"
    monkeypatch.setattr("glpath.rendering.factory._Paths.prepared", prepared)
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        done = run("render", *box, "--spp", 2, "--resume")
    finally:
        signal.signal(signal.SIGTERM, before)
    assert done.exit_code == 75, done.stderr
    film = Film.load(tmp_path / "a.npz")
    assert (film.path_sets, film.metadata.stop_rule) == (1, "interrupted")


def test_film_of_a_python_call_that_an_error_ends_is_incomplete() -> None:
    def fail(progress: glpath.Progress) -> None:
        raise ArithmeticError

    box: dict[str, Any] = {"resolution": (4, 4), "max_depth": 1, "integrator": "path"}
    film = glpath.render("cornell-box-36", spp=1, **box)
    with pytest.raises(ArithmeticError):
        glpath.render("cornell-box-36", spp=2, film=film, on_progress=fail, **box)
    assert (film.path_sets, film.metadata.stop_rule, film.metadata.error_bound) == (1, "", None)
