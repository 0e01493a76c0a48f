"""A signal at a bad moment: the program ends as it says, and does not crash."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

import glpath
from glpath.cli import frames
from glpath.cli.signals import hold, interrupted, signals_wait_for_results
from glpath.film.film import Film
from glpath.jobs import cluster
from glpath.rendering import calls, interrupts, session
from glpath.rendering.interrupts import Flag, RenderInterrupted, interrupt_as_flag
from glpath.rendering.loop import Clock
from glpath.rendering.run_options import RunOptions
from glpath.system.checkpoint import CheckpointFile
from glpath.system.signals import REPEATED
from tests.conftest import MakeFilm
from tests.support.command_line import run
from tests.support.killing import SMALL, default_signals

INTERRUPTED = """
import os, signal, _moderngl
make = _moderngl.make_uniform
def broken_off(*given):
    os.kill(os.getpid(), signal.SIGINT)
    return make(*given)
_moderngl.make_uniform = broken_off
import glpath
try:
    glpath.render("cornell-box-36", resolution=(8, 8), spp=1)
except KeyboardInterrupt:
    print("interrupted")
"""

IN_CODE_FROM_TEXT = """
import sys
from glpath.cli import main, scenes
text = "import os, signal; os.kill(os.getpid(), signal.{name}); [None for _ in range(1000)]"
scenes.shipped_scenes = lambda: exec(text)
sys.argv = ["glpath", "scenes"]
main.run()
"""

WITH_A_RESULT = """
import os, signal, sys
from glpath.cli import main, scenes
from glpath.cli.signals import hold
def scenes_and_signals():
    hold()
    for _ in range(5):
        os.kill(os.getpid(), signal.{name})
    return {{}}
scenes.shipped_scenes = scenes_and_signals
sys.argv = ["glpath", "scenes"]
main.run()
"""


IN_A_FINALIZER = """
import os, signal, sys, time, weakref
from glpath.cli import main, scenes
def strike():
    os.kill(os.getpid(), signal.SIGHUP)
    time.sleep(1)
def compute():
    weakref.finalize(set(), strike)
    time.sleep(200)
    return {}
scenes.shipped_scenes = compute
sys.argv = ["glpath", "scenes"]
main.run()
"""


def test_signal_during_a_finalizer_ends_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IN_A_FINALIZER],
        capture_output=True,
        text=True,
        preexec_fn=default_signals,
        timeout=100,
    )
    assert (done.returncode, done.stderr) == (130, "glpath: interrupted\n")


def test_a_signal_waits_until_a_program_is_compiled() -> None:
    """moderngl's C code crashes where a function of Python that it calls is broken off."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_the_exit_code_is_ours_wherever_the_signal_came(name: str, tmp_path: Path) -> None:
    """That of `python -m` is Python's where a KeyboardInterrupt went through code from text, as of dataclasses."""
    (tmp_path / "broken_off.py").write_text(IN_CODE_FROM_TEXT.format(name=name))
    done = subprocess.run(
        [sys.executable, "-m", "broken_off"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        preexec_fn=default_signals,
    )
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("SIGHUP", "interrupted: all was done and is written"),  # of the kernel, and of the shell
        ("SIGXCPU", "interrupted: all was done and is written"),  # once a second
        ("SIGTERM", "interrupted"),
    ],
)
def test_signals_that_repeat_by_themselves_do_not_give_up_the_result(name: str, end: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_RESULT.format(name=name)],
        capture_output=True,
        text=True,
        preexec_fn=default_signals,
    )
    assert (done.returncode, done.stderr.splitlines()[-1]) == (130, f"glpath: {end}")


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT])
def test_signal_that_the_parent_ignores_stays_ignored(number: signal.Signals) -> None:
    """As nohup and a shell's background jobs rely on it."""
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_RESULT.format(name=number.name)],
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_IGN),
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


@pytest.mark.parametrize("number", REPEATED)
def test_second_hangup_does_not_break_into_a_path_set(number: signal.Signals) -> None:
    before = signal.signal(number, signal.default_int_handler)
    try:
        with interrupt_as_flag() as flag:
            for _ in range(3):
                signal.raise_signal(number)
            assert (bool(flag), flag.signal) == (True, number)
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", REPEATED)
def test_path_set_that_takes_long_is_left_after_a_hangup(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interrupts, "_GRACE", 0.1)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            wait_through(number)
    finally:
        signal.signal(number, before)


def wait_through(number: signal.Signals) -> None:
    with interrupt_as_flag():
        signal.raise_signal(number)
        time.sleep(20)


def test_handler_of_another_program_is_called_and_ends_no_render() -> None:
    """A server's SIGHUP may mean "read the configuration again"."""
    numbers: list[int] = []
    before = signal.signal(signal.SIGHUP, lambda number, frame: numbers.append(number))
    try:
        with interrupt_as_flag() as flag:
            signal.raise_signal(signal.SIGHUP)
            assert numbers == [signal.SIGHUP]
            with flag.whole():
                signal.raise_signal(signal.SIGHUP)
                assert len(numbers) == 1, "the handler waits while path sets are added"
            assert len(numbers) == 2
            with flag.whole():
                pass
        assert (len(numbers), bool(flag)) == (2, False)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_handler_of_ctrl_c_of_another_program_is_called_and_may_install_another() -> None:
    numbers: list[int] = []

    def once(number: int, frame: FrameType | None) -> None:
        numbers.append(number)
        signal.signal(number, signal.SIG_IGN)

    before = signal.signal(signal.SIGINT, once)
    try:
        with interrupt_as_flag() as flag:
            signal.raise_signal(signal.SIGINT)
        assert (numbers, bool(flag)) == ([signal.SIGINT], False)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_all_handlers_that_wait_are_called_even_if_one_raises() -> None:
    flag, called = Flag(), []

    def fail() -> None:
        raise KeyboardInterrupt

    def add() -> None:
        with flag.whole():
            flag.call(fail)
            flag.call(lambda: called.append("second"))

    with pytest.raises(KeyboardInterrupt):
        add()
    assert called == ["second"]


def test_first_ctrl_c_ends_a_render_within_asyncio() -> None:
    """The handler of `asyncio.run` cancels its task, which a render keeps from running."""

    async def render() -> tuple[bool, int]:
        with interrupt_as_flag() as flag:
            signal.raise_signal(signal.SIGINT)
            return bool(flag), flag.signal

    assert asyncio.run(render()) == (True, signal.SIGINT)


@pytest.fixture
def default_sigterm() -> Iterator[None]:
    """Handle SIGTERM during the test, whatever the parent process set."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("default_sigterm")
def test_second_signal_within_the_handler_of_the_first_interrupts() -> None:
    struck = []

    def strike(frame: FrameType, event: str, argument: object) -> None:
        caller = frame if event == "c_call" else frame.f_back
        if event in ("call", "c_call") and caller is not None and caller.f_code is Flag.signalled.__code__:
            sys.setprofile(None)
            struck.append(event)
            signal.raise_signal(signal.SIGTERM)

    with interrupt_as_flag() as flag:
        sys.setprofile(strike)
        try:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
        finally:
            sys.setprofile(None)
        assert (len(struck), bool(flag), flag.signal) == (1, True, signal.SIGTERM)


@pytest.mark.parametrize(("resume", "code"), [(["--resume"], 75), ([], 130)])
@pytest.mark.usefixtures("default_sigterm")
def test_daylight_that_a_scheduler_ends_has_its_exit_code(
    resume: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def struck(*given: Any) -> None:
        signal.raise_signal(signal.SIGTERM)
        raise AssertionError("the signal ends it")

    monkeypatch.setattr("glpath.apps.daylight.compute._words", struck)
    monkeypatch.chdir(tmp_path)
    Path("p.csv").write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    options = ["-o", "a b.npz", "--points", "p.csv", "--samples", 1, *resume]
    done = run("daylight", "cornell-box-36", *options)
    assert done.exit_code == code, done.stderr
    again = "to resume: glpath daylight cornell-box-36 -o 'a b.npz' --points p.csv --samples 1 --resume"
    assert (again in done.stderr) == bool(resume), done.stderr


@pytest.mark.parametrize(("resume", "code"), [(["--resume"], 75), ([], 130)])
@pytest.mark.usefixtures("default_sigterm")
def test_frames_that_a_scheduler_ends_have_its_exit_code(
    resume: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def struck(*given: Any, **options: Any) -> Iterator[Film]:
        with interrupt_as_flag() as flag:
            signal.raise_signal(signal.SIGTERM)
        raise RenderInterrupted(film, flag.signal)
        yield

    film = glpath.render("cornell-box-36", resolution=(4, 4), spp=1, integrator="path")
    monkeypatch.setattr("glpath.rendering.render_frames", struck)
    done = run("render", *SMALL, "-o", tmp_path / "t.npz", "--spp", 1, "--turntable", 2, *resume)
    assert done.exit_code == code, done.stderr


@pytest.mark.parametrize(("resume", "code"), [(["--resume"], 0), ([], 130)])
@pytest.mark.usefixtures("default_sigterm")
def test_scheduler_need_not_resume_what_is_saved_when_its_signal_comes(
    resume: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def save(path: Path) -> None:
        signal.raise_signal(signal.SIGTERM)
        path.touch()

    matrix = SimpleNamespace(save=save)
    monkeypatch.setattr("glpath.apps.view_factors.compute.view_factors", lambda *_, **__: matrix)
    done = run("viewfactors", "cornell-box-36", "-o", tmp_path / "F.npz", "-q", *resume)
    assert (done.exit_code, [path.name for path in tmp_path.iterdir()]) == (code, ["F.npz"]), done.stderr


@pytest.mark.usefixtures("default_sigterm")
def test_signal_after_the_last_check_of_a_flag_ends_the_next_computation() -> None:
    with signals_wait_for_results():
        with interrupt_as_flag():
            signal.raise_signal(signal.SIGTERM)
        with interrupt_as_flag() as flag:
            assert (bool(flag), flag.signal) == (True, signal.SIGTERM)


class Solution:
    """Solution that is saved as an empty file."""

    def save(self, path: Path) -> None:
        path.touch()


@pytest.mark.usefixtures("default_sigterm")
def test_solution_is_rescued_if_its_checkpoint_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def struck(scene: object, options: dict[str, Any], mode: str) -> tuple[Solution, bool]:
        def save(path: Path) -> None:
            if path == options["checkpoint"].path:
                raise glpath.ImageError(f"{path}: cannot be written: No space left on device.")
            path.write_text("the solver's state")

        interrupted(signal.SIGTERM)
        options["checkpoint"].written_by(save, 2, last=True)
        return Solution(), False

    monkeypatch.setattr("glpath.cli.radiosity._solve", struck)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = run("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "--checkpoint", "1h")
    (rescued,) = tmp_path.glob("glpath-*/*")
    assert rescued.name == "s.checkpoint.npz"
    assert (done.exit_code, f"is kept in {rescued};" in done.stderr) == (1, True), done.stderr
    assert f"glpath: error: {tmp_path / 's.checkpoint.npz'}: cannot be written: No space" in done.stderr


@pytest.mark.usefixtures("default_sigterm")
def test_solution_that_is_complete_when_a_signal_comes_is_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def save(solution: Solution, path: Path) -> None:
        signal.raise_signal(signal.SIGTERM)
        path.touch()

    monkeypatch.setattr("glpath.radiosity.solve_radiosity", lambda *_, **__: Solution())
    monkeypatch.setattr(Solution, "save", save)
    done = run("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "-q", "--resume")
    assert (done.exit_code, [path.name for path in tmp_path.iterdir()]) == (0, ["s.npz"]), done.stderr


@pytest.mark.parametrize(("resume", "code"), [(["--resume"], 75), ([], 130)])
@pytest.mark.usefixtures("default_sigterm")
def test_check_of_a_saved_solution_ends_at_a_signal(
    resume: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def solve(scene: object, options: dict[str, Any], mode: str) -> tuple[Solution, bool]:
        hold()
        if resume:
            options["checkpoint"].path.touch()
        return Solution(), True

    def struck(*_: object) -> None:
        signal.raise_signal(signal.SIGTERM)
        raise AssertionError("the signal ends it")

    monkeypatch.setattr("glpath.cli.radiosity._solve", solve)
    monkeypatch.setattr("glpath.rendering.element_error", struck)
    done = run("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "-q", "--check", *resume)
    assert (done.exit_code, "saving" in done.stderr) == (code, False), done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.checkpoint.npz"] * bool(resume) + ["s.npz"]


@pytest.mark.usefixtures("default_sigterm")
def test_signal_while_a_movie_is_encoded_says_how_to_make_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frames, "require_encoder", lambda path: None)
    monkeypatch.setattr(frames, "write_movie", lambda path, **_: signal.raise_signal(signal.SIGTERM))
    outputs = ["-o", tmp_path / "a.png", "-o", tmp_path / "a.mp4"]
    result = run(
        "render", "furnace", "--resolution", "8x8", "--spp", 1, "--turntable", 2, "--progress", "lines", *outputs
    )
    assert result.exit_code == 130
    assert "interrupted: 2 of 2 frames are written; the movie is not; --resume makes it" in result.stderr


def test_film_of_a_render_that_a_second_signal_ends_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make_film: MakeFilm
) -> None:
    film = make_film([(0, 2)])
    film.metadata = replace(film.metadata, stop_rule="")

    def run_job(job: object, scene: object, options: Any) -> Film:
        options.on_progress(glpath.Progress(2, 5, 1.0, None, film, "rendering", ""))
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("the signal interrupts")

    monkeypatch.setattr(calls, "run_job", run_job)
    result = run("render", "furnace", "--spp", 5, "-o", tmp_path / "a.npz")
    assert f"--resume continues from {tmp_path / 'a.npz'}" in result.stderr


@pytest.mark.parametrize("number", REPEATED)
def test_signal_that_repeats_does_not_break_into_cleaning_up(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # under nohup SIGHUP is ignored
    try:
        with signals_wait_for_results():
            with interrupt_as_flag() as flag:
                signal.raise_signal(number)
            assert flag
            for _ in range(5):
                signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_second_ctrl_c_does_not_break_into_cleaning_up(capfd: pytest.CaptureFixture[str]) -> None:
    with signals_wait_for_results():
        with interrupt_as_flag():
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    assert "to give that up, interrupt twice more" in capfd.readouterr().err


class StruckCheck:
    """Bias check during which Ctrl-C comes while it replaces an engine, so that only the flag is set."""

    probe, statistics = None, None

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def settle(self, plan: object, engine: object) -> tuple[object, object]:
        signal.raise_signal(signal.SIGINT)
        return plan, engine


@pytest.mark.parametrize("by_cluster", [False, True])
def test_ctrl_c_during_the_bias_check_interrupts(
    by_cluster: bool, monkeypatch: pytest.MonkeyPatch, make_film: MakeFilm
) -> None:
    clock, plan, job = Clock(make_film([(0, 2)]), 8, "", RunOptions()), MagicMock(), MagicMock()
    module = cluster if by_cluster else session
    monkeypatch.setattr(module, "BiasCheck", StruckCheck)
    monkeypatch.setattr(module, "sensor_in", MagicMock())
    of_gather = session.Session(job, MagicMock(), RunOptions(), context=MagicMock(), plan=plan)
    of_gather._checks_bias, of_gather._tiles = True, [MagicMock()]
    check: dict[bool, Callable[[], object]] = {
        True: lambda: cluster._with_small_bias(plan, job, MagicMock(), MagicMock(), MagicMock(), clock),
        False: lambda: of_gather._with_small_bias(MagicMock(), clock, job, MagicMock(), 0.0),
    }
    with pytest.raises(RenderInterrupted) as caught:
        check[by_cluster]()
    assert (caught.value.film, caught.value.film.metadata.stop_rule) == (clock.film, "interrupted")


@pytest.mark.parametrize(
    ("command", "function"),
    [
        (["viewfactors", "cornell-box-36", "-o", "F.npz"], "glpath.apps.view_factors.compute.view_factors"),
        (["daylight", "cornell-box-36", "-o", "D.npz", "--points", "p.csv"], "glpath.cli.daylight._computed"),
    ],
)
@pytest.mark.usefixtures("default_sigterm")
def test_scheduler_is_not_told_to_resume_what_could_not_be_kept(
    command: list[str], function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def struck(*given: Any, **options: Any) -> None:
        (checkpoint,) = (each for each in (*given, *options.values()) if isinstance(each, CheckpointFile))
        checkpoint.failure, checkpoint.rescue = "F: cannot be written: the disk is full.", "It is kept in T."
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(function, struck)
    monkeypatch.chdir(tmp_path)
    Path("p.csv").write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    done = run(*command, "--resume")
    assert done.exit_code == 1, done.stderr
    assert "glpath: error: F: cannot be written: the disk is full.\n  It is kept in T." in done.stderr
    assert "no row" not in done.stderr


class Signalling:
    """Descriptor that sends a signal while the class that has it is made, as an import may be interrupted."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __set_name__(self, owner: type, name: str) -> None:
        signal.raise_signal(self.number)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("resume", [False, True])
def test_signal_that_python_turns_into_another_error_interrupts(
    number: signal.Signals, resume: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python 3.11 raises RuntimeError from what leaves `__set_name__`."""

    def read(*_: object) -> object:
        return type("Imported", (), {"field": Signalling(number)})

    monkeypatch.setattr("glpath.cli.scene.read_scene", read)
    done = run("render", "furnace", "-o", tmp_path / "a.png", *["--resume"] * resume)
    assert done.exit_code == (75 if resume and number == signal.SIGTERM else 130), done.output
    assert "Traceback" not in done.output
    assert "glpath: interrupted" in done.stderr
