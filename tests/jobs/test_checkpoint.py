"""Nothing rendered is lost: checkpoints, resuming bit-identically, signals of schedulers, disks that fail."""

from __future__ import annotations

import ctypes
import errno
import json
import logging
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

import glpath
from glpath.film.film import Film
from glpath.gl.context import get_context
from glpath.gl.opening import CollectingContext
from glpath.jobs.checkpoint import Checkpoint, checkpoint_path
from glpath.rendering import interrupts
from glpath.system import files
from glpath.system.checkpoint import CheckpointFile
from glpath.system.signals import TERMINATING
from tests.support import killing
from tests.support.command_line import run
from tests.support.engines import with_depth
from tests.support.films import same

BOX = "cornell-box-36"
SMALL: dict[str, Any] = {"resolution": (24, 16), "max_depth": 2}


def render(*arguments: object) -> Result:
    return run("render", *killing.SMALL, *arguments)


# Going on.


@pytest.mark.parametrize("sets", [1, 8, 13])
@pytest.mark.parametrize(
    ("scene", "options"),
    [
        (BOX, {}),
        (BOX, {"aovs": ("albedo", "normal"), "sampling": "random"}),
        (BOX, {"integrator": "path-buffer"}),
        (BOX, {"guide": "solution"}),
        (BOX, {"integrator": "gather"}),
        ("three-spheres", {"integrator": "t-buffer", "shadows": "cube"}),
    ],
)
def test_a_film_that_is_gone_on_with_has_the_bits_of_one_go(
    scene: str, options: dict[str, Any], sets: int, tmp_path: Path
) -> None:
    options = with_depth({"resolution": (24, 16), **options}, 2)
    begun = glpath.render(scene, spp=sets, **options)
    begun.save(tmp_path / "a.npz")
    film = glpath.render(scene, spp=20, film=Film.load(tmp_path / "a.npz"), **options)
    whole = glpath.render(scene, spp=20, **options)
    assert same(film, whole)
    assert film.metadata.statistics["dropped_samples"] == 0
    for name, count in whole.metadata.statistics.items():
        if name.startswith("paths"):
            assert film.metadata.statistics[name] == count
    assert film.metadata.elapsed_s > begun.metadata.elapsed_s


def test_gaps_of_a_film_are_filled() -> None:
    parts = [glpath.render(BOX, first_path_set=a, spp=b - a, **SMALL) for a, b in ((3, 9), (17, 18))]
    film = glpath.render(BOX, spp=30, film=parts[0].merge(parts[1]), **SMALL)
    assert same(film, glpath.render(BOX, spp=30, **SMALL))


def test_a_film_of_another_render_is_refused_with_all_that_differs() -> None:
    film = glpath.render(BOX, spp=4, **SMALL)
    with pytest.raises(glpath.UsageError) as caught:
        glpath.render(BOX, spp=2, resolution=(8, 8), max_depth=3, sampling="random", film=film)
    for words in (
        "max_depth is 2 in it, 3 is asked for",
        "settings.sampling is sobol in it, random is asked for",
        "resolution is [24, 16] in it, [8, 8] is asked for",
        "range of path sets is 0:4 in it, 0:2 is asked for",
    ):
        assert words in str(caught.value)


@pytest.mark.filterwarnings("ignore:.*the bias of the gather:glpath.SceneWarning")
def test_the_film_of_a_gather_goes_by_its_solution() -> None:
    coarse, fine = (glpath.solve_radiosity(BOX, method="monte-carlo", particles=4096, patches=n) for n in (40, 80))
    film = glpath.render(BOX, integrator="gather", radiosity=coarse, spp=2, resolution=(24, 16))
    with pytest.raises(glpath.UsageError, match=r"settings\.radiosity is"):
        glpath.render(BOX, integrator="gather", radiosity=fine, spp=4, film=film, resolution=(24, 16))


# The command line.


def test_a_checkpoint_is_beside_the_first_output_or_is_the_film() -> None:
    for outputs, expected in (
        (["a.png"], "a.checkpoint.npz"),
        (["-", "out/a.b.exr", "c.png"], "out/a.b.checkpoint.npz"),
        (["a.png", "b.npz"], "b.npz"),
    ):
        assert checkpoint_path([Path(name) for name in outputs]) == Path(expected)
    with pytest.raises(glpath.UsageError, match="no output is a file"):
        checkpoint_path([Path("-")])


def test_a_checkpoint_is_removed_when_all_is_done_and_a_film_stays(tmp_path: Path) -> None:
    result = render("-o", tmp_path / "a.png", "--spp", 20, "--checkpoint", "4i", "--stats", tmp_path / "s.json")
    assert result.exit_code == 0, result.stderr
    assert sorted(os.listdir(tmp_path)) == ["a.png", "s.json"]
    stats = json.loads((tmp_path / "s.json").read_text())
    assert stats["checkpoint"]["written"] >= 3
    assert (stats["path_sets"], stats["stop_rule"], stats["counts"]["dropped_samples"]) == (20, "spp", 0)
    assert stats["stage_ms"]["paths"] > 0
    assert stats["memory"]["peak_resident_bytes"] > stats["memory"]["film_bytes"] > 0
    assert stats["device"] == get_context().info.renderer


def test_a_finished_render_says_so_and_writes_its_outputs_again(tmp_path: Path) -> None:
    asked = ("-o", tmp_path / "a.npz", "-o", tmp_path / "a.png", "--spp", 20, "--resume")
    assert render(*asked).exit_code == 0
    before = Film.load(tmp_path / "a.npz")
    (tmp_path / "a.png").unlink()
    result = render(*asked)
    assert result.exit_code == 0
    assert f"all 20 path sets were in {tmp_path / 'a.npz'} already" in result.stderr
    assert (tmp_path / "a.png").exists()
    assert same(Film.load(tmp_path / "a.npz"), before)
    assert render(*asked[:4], "--spp", 32, "--resume").exit_code == 0
    assert same(Film.load(tmp_path / "a.npz"), glpath.render(BOX, spp=32, **SMALL))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--max-depth", 3], "max_depth is 2 in it, 3 is asked for"),
        (["--seed", 1], "seed is 0 in it, 1 is asked for"),
        (["--resolution", "8x8"], "resolution is [24, 16] in it, [8, 8] is asked for"),
        (["--spp", 4], "range of path sets is 0:8 in it, 0:4 is asked for"),
        (["--camera-fov", 20], "scene is "),
    ],
)
def test_a_checkpoint_of_another_render_is_refused(tmp_path: Path, options: list[object], words: str) -> None:
    assert render("-o", tmp_path / "a.npz", "--spp", 8).exit_code == 0
    held = (tmp_path / "a.npz").read_bytes()
    result = render("-o", tmp_path / "a.npz", "--spp", 16, "--resume", *options)
    assert result.exit_code == 2
    assert f"{tmp_path / 'a.npz'}: cannot be resumed: " in result.stderr
    assert words in result.stderr
    assert (tmp_path / "a.npz").read_bytes() == held


def test_a_checkpoint_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert render("-o", tmp_path / "a.npz", "--spp", 8).exit_code == 0
    monkeypatch.setattr("glpath.rendering.session.versions", lambda *names: dict.fromkeys(names, "9.9"))
    result = render("-o", tmp_path / "a.npz", "--spp", 16, "--resume")
    assert (result.exit_code, "version of glpath is " in result.stderr) == (2, True)


def test_a_checkpoint_that_is_there_is_not_replaced_unasked(tmp_path: Path) -> None:
    assert render("-o", tmp_path / "a.npz", "--spp", 8).exit_code == 0
    result = render("-o", tmp_path / "a.npz", "--spp", 16, "--checkpoint", "60s")
    assert (result.exit_code, "--resume continues it" in result.stderr) == (2, True)
    assert Film.load(tmp_path / "a.npz").path_sets == 8


def test_a_file_that_is_no_checkpoint_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.checkpoint.npz").write_bytes(b"PK no film")
    result = render("-o", tmp_path / "a.png", "--spp", 8, "--resume")
    assert result.exit_code == 1
    assert "a.checkpoint.npz: cannot be read as a film" in result.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--checkpoint", "often"], "expected a time such as 60s or 5m, or steps such as 100i"),
        (["--checkpoint", "0i"], "at least one step"),
        (["--checkpoint", "0s"], "expected a time such as"),
        (["--time-limit", "-3"], "--time-limit -3: expected a time above 0"),
        (["--noise", "0"], "--noise 0: must be above 0"),
        (["--sample-range", "8:8"], "--sample-range 8:8: expected A:B"),
        (["--sample-range", "0:8", "--spp", "8"], "--spp beside --sample-range"),
        (["--hang-limit", "soon"], "--hang-limit soon"),
        (["--turntable", "3", "--checkpoint", "1i"], "--checkpoint beside --turntable"),
        (["--turntable", "3", "--stats", "s.json"], "--stats beside --turntable"),
    ],
)
def test_what_cannot_be_asked_for_is_named(tmp_path: Path, options: list[str], words: str) -> None:
    result = render("-o", tmp_path / "a.png", *options)
    assert (result.exit_code, words in result.stderr) == (2, True), result.stderr
    assert not list(tmp_path.iterdir())


def test_a_job_file_is_gone_on_with_too(tmp_path: Path) -> None:
    job = glpath.rendering.RenderJob.of(BOX, spp=20, **SMALL)
    job.save(tmp_path / "job.json")
    glpath.rendering.run(glpath.rendering.RenderJob.of(BOX, spp=5, **SMALL)).save(tmp_path / "a.npz")
    result = run("render", "--job", tmp_path / "job.json", "-o", tmp_path / "a.npz", "--resume", "-q")
    assert result.exit_code == 0, result.stderr
    assert same(Film.load(tmp_path / "a.npz"), glpath.rendering.run(job))


# Kills and signals.


def check_kills(folder: Path, times: int, seed: int) -> list[int]:
    out = folder / "a.npz"
    kept = killing.kill_again_and_again(out, times, seed)
    wanted = kept[-1] + 9
    result = render("-o", out, "--spp", wanted, "--resume", "-q")
    assert result.exit_code == 0, result.stderr
    assert same(Film.load(out), glpath.render(BOX, spp=wanted, **SMALL))
    assert os.listdir(folder) == ["a.npz"], "what killed writers have left is removed"
    return kept


def test_five_kills_lose_nothing_beyond_the_last_checkpoint(tmp_path: Path) -> None:
    kept = check_kills(tmp_path, 5, seed=0)
    assert 0 < kept[0] < kept[-1]


@pytest.mark.evidence
@pytest.mark.release
def test_fifty_kills_lose_nothing_beyond_the_last_checkpoint(tmp_path: Path) -> None:
    kept = check_kills(tmp_path, 50, seed=1)
    assert len({*kept}) > 20
    print(f"\npath sets in the checkpoint after each of 50 kills: {kept}")


@pytest.mark.parametrize("number", TERMINATING)
def test_a_scheduler_s_signal_leaves_a_checkpoint_and_exit_code_75(number: int, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    asked = ("-o", out, "--checkpoint", "1h", "--resume")
    code, told = killing.struck(number, *asked, "--spp", 10**6)
    assert code == 75, told
    checkpoint = tmp_path / "a.checkpoint.npz"
    begun = Film.load(checkpoint)
    assert os.listdir(tmp_path) == [checkpoint.name]
    assert f"{begun.path_sets} path sets are in {checkpoint}; the same command with --resume continues" in told
    assert begun.metadata.stop_rule == "interrupted"
    result = render(*asked, "-o", tmp_path / "b.npz", "--spp", begun.path_sets + 8)
    assert result.exit_code == 0, result.stderr


def test_ctrl_c_writes_the_picture_and_says_how_to_resume(tmp_path: Path) -> None:
    code, told = killing.struck(signal.SIGINT, "-o", tmp_path / "a.png", "--spp", 10**6, "--checkpoint", "1h")
    assert code == 130, told
    checkpoint = tmp_path / "a.checkpoint.npz"
    assert sorted(os.listdir(tmp_path)) == [checkpoint.name, "a.png"]
    assert f"of 1000000 path sets are in {tmp_path / 'a.png'}" in told
    assert f"the same command with --resume continues from {checkpoint}" in told
    begun = Film.load(checkpoint).path_sets
    result = render("-o", tmp_path / "a.png", "--spp", begun + 1, "--resume")
    assert (result.exit_code, os.listdir(tmp_path)) == (0, ["a.png"])


# All is rendered when the signal comes.
LATE = """
import os, signal
from glpath.cli.main import run
from glpath.rendering.session import Session

Session.remarks = lambda *_: os.kill(os.getpid(), signal.SIGTERM) or []
run()
"""


def test_a_scheduler_s_signal_after_the_end_leaves_nothing_to_be_done(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LATE, "render", *killing.SMALL, "--spp", "4", "--resume"]
    done = subprocess.run([*command, "-o", str(tmp_path / "a.png")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert os.listdir(tmp_path) == ["a.png"]


def test_a_signal_in_the_last_step_leaves_a_film_that_is_complete() -> None:
    def strike(film: Film) -> None:
        if film.path_sets == 8:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(glpath.RenderInterrupted) as caught:
        glpath.render(BOX, spp=8, on_step=strike, **SMALL)
    assert (caught.value.film.path_sets, caught.value.film.metadata.stop_rule) == (8, "spp")


def test_statistics_that_cannot_be_written_lose_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise glpath.ImageError("s.json: cannot be written: No space left on device.")

    monkeypatch.setattr("glpath.cli.outcome.write_bytes", full)
    result = render("-o", tmp_path / "a.npz", "--spp", 8, "--stats", tmp_path / "s.json")
    assert (result.exit_code, "s.json: cannot be written" in result.stderr) == (1, True)
    assert f"wrote {tmp_path / 'a.npz'}" in result.stderr


@pytest.mark.parametrize(("number", "code"), [*((number, 75) for number in TERMINATING), (signal.SIGINT, 130)])
def test_a_signal_before_anything_is_done_has_its_exit_code_too(
    number: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def struck(*_: object, **__: object) -> Film:
        signal.raise_signal(number)
        raise AssertionError("the signal ends it")

    monkeypatch.setattr("glpath.rendering.calls.run_job", struck)
    before = signal.signal(number, signal.default_int_handler)  # under nohup SIGHUP is ignored
    try:
        assert render("-o", tmp_path / "a.png", "--resume").exit_code == code
        assert render("-o", tmp_path / "a.png").exit_code == 130
    finally:
        signal.signal(number, before)
    assert not os.listdir(tmp_path)


def test_the_log_is_shown_when_asked_for(tmp_path: Path) -> None:
    options = ("--spp", 8, "--checkpoint", "1i", "--resume")
    assert "checkpoint: 8 path sets in" in render("-o", tmp_path / "a.npz", *options, "-v").stderr
    told = render("-o", tmp_path / "a.npz", "--spp", 9, "--resume", "-v").stderr
    assert f"resuming from 8 path sets of {tmp_path / 'a.npz'}" in told
    assert "checkpoint:" not in render("-o", tmp_path / "b.npz", *options).stderr
    assert logging.getLogger("glpath").level == logging.NOTSET


def test_the_help_names_every_exit_code() -> None:
    text = " ".join(run("render", "--help-all").stdout.split())
    for code in (
        "0 done",
        "1 failed",
        "2 wrong usage",
        "3 done but",
        "75 ended by",
        "130 interrupted",
        "134 ended",
    ):
        assert code in text
    assert " 75: ended by a signal (SIGTERM, SIGHUP" in " ".join(run("radiosity", "--help").stdout.split())


def test_a_path_set_that_takes_long_is_left_when_a_scheduler_wants_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(interrupts, "_GRACE", 0.1)
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        started = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            wait_through_a_signal(20)
        assert time.monotonic() - started < 10
        wait_through_a_signal(0)
        time.sleep(0.3)  # nobody is hurried any more
    finally:
        signal.signal(signal.SIGTERM, before)


def wait_through_a_signal(seconds: float) -> None:
    with interrupts.interrupt_as_flag() as flag:
        signal.raise_signal(signal.SIGTERM)
        assert (bool(flag), flag.signal) == (True, signal.SIGTERM)
        time.sleep(seconds)


# Disks.


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_is_told_once_and_rendering_goes_on(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    checkpoint = Checkpoint(tmp_path / "a.npz", steps=1)
    film = glpath.render(BOX, spp=8, on_step=checkpoint, **SMALL)
    whole = (tmp_path / "a.npz").read_bytes()
    monkeypatch.setattr(files.os, call, full)
    film = glpath.render(BOX, spp=32, film=film, on_step=checkpoint, **SMALL)
    monkeypatch.undo()
    assert film.path_sets == 32
    assert checkpoint.failure is not None
    lines = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert len(lines) == 1
    assert "a.npz: cannot be written: No space left on device; rendering continues" in lines[0]
    if call == "replace":
        assert (tmp_path / "a.npz").read_bytes() == whole
    assert os.listdir(tmp_path) == ["a.npz"]
    assert checkpoint.write(film)
    assert checkpoint.failure is None


def test_a_file_is_on_the_disk_before_it_has_its_name_and_the_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        order.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        fsync(descriptor)

    def replaced(source: Path, target: Path) -> None:
        order.append("name")
        replace(source, target)

    monkeypatch.setattr(files.os, "fsync", synced)
    monkeypatch.setattr(files.os, "replace", replaced)
    files.write_bytes(b"text", tmp_path / "a.txt")
    assert order == ["file", "name", "folder"]


def test_a_render_without_its_last_checkpoint_ends_with_3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.replace

    def full(source: object, target: object) -> None:
        if str(target).endswith("checkpoint.npz"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(source, target)  # type: ignore[arg-type]

    monkeypatch.setattr(files.os, "replace", full)
    result = render("-o", tmp_path / "a.png", "--spp", 32, "--checkpoint", "4i")
    assert result.exit_code == 3, result.stderr
    assert result.stderr.count("rendering continues") == 1
    assert "done, but the last checkpoint was not written" in result.stderr
    assert os.listdir(tmp_path) == ["a.png"]


def test_a_folder_that_vanishes_is_made_again(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    checkpoint = Checkpoint(folder / "a.npz", steps=4)

    def lose(film: Film) -> None:
        if film.path_sets < 12:
            shutil.rmtree(folder, ignore_errors=True)
        checkpoint(film)

    film = glpath.render(BOX, spp=32, on_step=lose, **SMALL)
    assert checkpoint.failure is None
    assert Film.load(folder / "a.npz").path_sets > 12
    assert film.path_sets == 32


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only to root")
def test_a_folder_that_becomes_read_only_leaves_the_old_checkpoint(tmp_path: Path) -> None:
    checkpoint = Checkpoint(tmp_path / "a.npz", steps=1)
    film = glpath.render(BOX, spp=8, on_step=checkpoint, **SMALL)
    tmp_path.chmod(0o500)
    try:
        glpath.render(BOX, spp=16, film=film, on_step=checkpoint, **SMALL)
    finally:
        tmp_path.chmod(0o700)
    assert "Permission denied" in str(checkpoint.failure)
    assert Film.load(tmp_path / "a.npz").path_sets == 8


def test_a_disk_that_is_really_full(tmp_path: Path) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs the right to mount")
    try:
        # Two films have no room at once: the second cannot replace the first.
        checkpoint = Checkpoint(folder / "a.npz", steps=1)
        film = glpath.render(BOX, spp=8, resolution=(64, 48), max_depth=1, on_step=checkpoint)
        glpath.render(BOX, spp=16, resolution=(64, 48), max_depth=1, film=film, on_step=checkpoint)
        assert "No space left on device" in str(checkpoint.failure)
        assert 0 < Film.load(folder / "a.npz").path_sets <= 8
        assert os.listdir(folder) == ["a.npz"]
    finally:
        subprocess.run(["umount", str(folder)], check=True)


# Devices.


@pytest.mark.parametrize(
    ("error", "remedy"), [("GL_OUT_OF_MEMORY", "--crop"), ("GL_CONTEXT_LOST", "what the driver says")]
)
def test_what_was_rendered_before_the_device_failed_is_kept(
    error: str, remedy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []

    def failing(self: CollectingContext) -> str:
        steps.append(1)
        return error if len(steps) > 4 else "GL_NO_ERROR"

    monkeypatch.setattr("glpath.rendering.loop._STEP_SECONDS", 0.0)
    monkeypatch.setattr(CollectingContext, "error", property(failing))
    monkeypatch.setattr("glpath.gl.memory._WORTH_ASKING", 1 << 40)
    result = render("-o", tmp_path / "a.png", "--spp", 64, "--checkpoint", "1h")
    monkeypatch.undo()
    assert result.exit_code == 1, result.stderr
    assert f"{error} while path sets were traced" in result.stderr
    assert remedy in result.stderr
    assert "the same command with --resume continues" in result.stderr
    assert Film.load(tmp_path / "a.checkpoint.npz").path_sets == 4
    result = render("-o", tmp_path / "a.npz", "-o", tmp_path / "b.png", "--spp", 16, "--resume")
    assert result.exit_code == 0


def test_what_the_device_has_no_memory_for_is_named_with_its_size() -> None:
    from glpath.gl.context import open_context

    with open_context() as context, pytest.raises(glpath.ContextError) as caught:
        context.gl.texture((16384, 16384), 4, dtype="f4")
    text = str(caught.value)
    assert "GL_OUT_OF_MEMORY for a texture of 16384 x 16384, 4,096 MiB, in test_what_the_device" in text
    assert "crop=(0, 0, 960, 540)" in text


def test_a_film_that_memory_has_no_room_for_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(metadata: object) -> Film:
        raise MemoryError("Unable to allocate 6.00 GiB for an array with shape (8, 8192, 4096, 3)")

    monkeypatch.setattr(Film, "empty", none)
    with pytest.raises(glpath.ContextError, match=r"film of 24 x 16 pixels: Unable to allocate 6.00 GiB"):
        glpath.render(BOX, spp=1, **SMALL)


# Many renders.


@pytest.mark.evidence
@pytest.mark.release
def test_a_thousand_renders_leave_memory_handles_and_objects_flat(tmp_path: Path) -> None:
    from glpath.gl.context import open_context

    def measured() -> dict[str, float]:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        with open_context() as context:
            context.gl.gc()
            highest = max(context.gl.texture((1, 1), 1).glo, context.gl.buffer(reserve=4).glo) + 100
            alive = 0
            for kind in ("Texture", "Buffer", "Framebuffer", "Program", "VertexArray"):
                address = context._opened.loader.load_opengl_function(f"glIs{kind}")
                known = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(address)
                alive += sum(bool(known(name)) for name in range(1, highest))
        return {
            "MiB": pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
            "handles": len(os.listdir("/proc/self/fd")),
            "threads": threading.active_count(),
            "objects": alive,
        }

    def some(first: int, count: int) -> dict[str, float]:
        for i in range(first, first + count):
            checkpoint = Checkpoint(tmp_path / "a.npz", steps=1)
            engine = ("path", "path-buffer")[i % 2]
            glpath.render(
                BOX, spp=2, seed=i, max_depth=2, integrator=engine, resolution=(32, 24), on_step=checkpoint
            )
        return measured()

    some(0, 100)  # caches and the allocator's arenas fill first
    before, after = some(100, 100), some(200, 900)
    print(f"\nafter 200 renders {before}, after 1100 {after}")
    assert after["MiB"] - before["MiB"] < 20
    for name in ("handles", "threads", "objects"):
        assert after[name] <= before[name] + 2, name
    assert os.listdir(tmp_path) == ["a.npz"]


def test_a_resumed_film_has_the_exposure_and_names_of_the_scene_as_it_is_now() -> None:
    """Path sets depend on neither, so the film is not refused."""
    options = {**SMALL, "aovs": ["object_id"]}
    scene = glpath.load_scene(BOX)
    film = glpath.render(scene, spp=2, **options)
    names = [f"renamed {shape.name}" for shape in scene.shapes]
    shapes = [replace(shape, name=name) for shape, name in zip(scene.shapes, names, strict=True)]
    changed = replace(scene, shapes=shapes, exposure=3.0)
    resumed = glpath.render(changed, spp=4, film=film, **options)
    new = glpath.render(changed, spp=4, **options)
    assert (resumed.metadata.exposure, resumed.metadata.shape_names) == (3.0, new.metadata.shape_names)


def test_a_checkpoint_for_which_memory_is_too_small_does_not_end_the_work(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def save(path: Path) -> None:
        raise MemoryError

    checkpoint = CheckpointFile(tmp_path / "a.npz", steps=1)
    assert not checkpoint.written_by(save, 1)
    assert "a.npz: cannot be written: too little memory; the work continues" in caplog.text
    assert not checkpoint.written_by(save, 2, last=True)
    assert checkpoint.rescue == "Nor could it be kept in a temporary folder."
