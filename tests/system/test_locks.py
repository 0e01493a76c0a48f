"""One process at a time has a checkpoint: the second is told who the first is, and a dead one keeps nobody out."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

import glpath
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.film.film import Film
from glpath.jobs.checkpoint import Checkpoint
from glpath.system.files import check_writable, whole_file
from glpath.system.locks import Lock, check_unlocked
from tests.support import killing
from tests.support.command_line import run

# Holds frames of a file until its standard input ends, or it is killed.
HOLDING = """
import sys
from pathlib import Path
from glpath.system.locks import Lock

with Lock(Path(sys.argv[1]), "a render", int(sys.argv[2]), int(sys.argv[3])):
    print("held", flush=True)
    sys.stdin.read()
"""


def holding(path: Path, first: int = 0, stop: int = 1) -> subprocess.Popen[str]:
    """A process that has the lock."""
    command = [sys.executable, "-c", HOLDING, str(path), str(first), str(stop)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def ended(process: subprocess.Popen[str], number: int | None = None) -> int:
    """Its exit code; by a signal, or in peace."""
    if number is not None:
        process.send_signal(number)
    process.communicate(timeout=60)
    return process.returncode


@pytest.mark.parametrize("command", ["merge keep.npz", "render furnace", "export furnace", "radiosity furnace"])
def test_output_that_another_process_has_locked_is_refused(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = Path("c.glb" if "export" in command else "c.npz")
    out.write_bytes(b"checkpoint")
    first = holding(out)
    result = run(*command.split(), "-o", str(out))
    assert result.exit_code == 1, result.output
    assert f"{out}: a render that resumes from it has it already: process {first.pid}" in result.output
    assert out.read_bytes() == b"checkpoint"
    assert ended(first, signal.SIGKILL) == -signal.SIGKILL
    check_unlocked(out)
    assert not Path(f".{out}.lock").exists(), "a lock file without a holder is removed"


def test_who_comes_second_is_told_who_is_first_and_has_it_after_him(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    first = holding(path)
    with pytest.raises(GlpathError) as caught, Lock(path, "a render"):
        pass
    said = str(caught.value)
    assert not isinstance(caught.value, UsageError)  # whose exit code tells schedulers not to try again
    assert f"{path}: a render has it already: process {first.pid} on {os.uname().nodename}, since 20" in said
    assert f"kill {first.pid}" in said
    assert ended(first) == 0
    assert os.listdir(tmp_path) == []
    with Lock(path, "a render"):
        assert os.listdir(tmp_path) == [".a.npz.lock"]
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_process_that_was_killed_keeps_nobody_out(number: int, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert ended(holding(path), number) == -number
    assert os.listdir(tmp_path) == [".a.npz.lock"], "a kill leaves the file, not the lock"
    with Lock(path, "a render"):
        holders = json.loads((tmp_path / ".a.npz.lock").read_text())
        assert [held["pid"] for held in holders] == [os.getpid()]
    assert os.listdir(tmp_path) == []


def test_processes_with_other_frames_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "frame_{:04}.png"
    killed, first = holding(path, 20, 30), holding(path, 0, 10)
    ended(killed, signal.SIGKILL)
    with Lock(path, "a render", 10, 25):
        with pytest.raises(GlpathError, match=f"process {first.pid} on"), Lock(path, "a render", 9, 10):
            pass
        assert ended(first) == 0
        assert os.listdir(tmp_path) == [".frame_{:04}.png.lock"], "somebody else is still in it"
    assert os.listdir(tmp_path) == []


def test_of_many_at_once_one_has_it_at_a_time(tmp_path: Path) -> None:
    """Locks of one process keep each other out as those of many do; the file comes and goes meanwhile."""
    path, inside, most, refused = tmp_path / "a.npz", [0], [0], [0]

    def come_and_go() -> None:
        for _ in range(200):
            try:
                with Lock(path, "a render"):
                    inside[0] += 1
                    most[0] = max(most[0], inside[0])
                    inside[0] -= 1
            except GlpathError:
                refused[0] += 1

    threads = [threading.Thread(target=come_and_go) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (most[0], os.listdir(tmp_path)) == (1, [])
    assert refused[0] < 800


def test_blocks_within_each_other_are_one_and_a_folder_may_go(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    with Lock(folder / "a.npz", "a render") as lock:
        with lock:
            pass
        assert [path.name for path in folder.iterdir()] == [".a.npz.lock"]
        (folder / ".a.npz.lock").unlink()
        folder.rmdir()
    assert not folder.exists()


@pytest.mark.parametrize(
    "text", ["", "no json", "[1]", "[" * 100_000, '{"pid": 1}', '[{"pid": 1, "range": "all"}]']
)
def test_what_stands_in_the_file_is_for_the_message_alone(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    first = holding(path)
    (tmp_path / ".a.npz.lock").write_text(text)
    with pytest.raises(GlpathError, match="has it already: another process"), Lock(path, "a render"):
        pass
    ended(first)
    (tmp_path / ".a.npz.lock").write_text(text)
    with Lock(path, "a render"):
        pass
    assert os.listdir(tmp_path) == []


def linked(kind: str, lock: Path, target: Path) -> None:
    """Make `lock` a link to `target`."""
    if kind == "symbolic":
        lock.symlink_to(target)
    else:
        os.link(target, lock)


LINKS = {"symbolic": "it is a symbolic link", "hard": "it is one of 2 names"}
# One command of each kind that has a lock: the name of its lock file, and its arguments.
LOCKED = {
    "render": (
        ".a.checkpoint.npz.lock",
        ("render", *killing.SMALL, "-o", "a.png", "--spp", 1, "--checkpoint", "1i"),
    ),
    "frames": (".f_{:02}.png.lock", ("render", *killing.SMALL, "-o", "f_{:02}.png", "--spp", 1, "--turntable", 2)),
    "radiosity": (
        ".s.checkpoint.npz.lock",
        ("radiosity", "cornell-box-36", "-o", "s.npz", "--patches", 60, "--resume"),
    ),
    "viewfactors": (
        ".F.npz.part.lock",
        ("viewfactors", "cornell-box-36", "-o", "F.npz", "--groups", "shapes", "--resume"),
    ),
    "daylight": (
        ".dc.npz.part.lock",
        ("daylight", "cornell-box-36", "-o", "dc.npz", "--points", "p.csv", "--samples", 1, "--resume"),
    ),
}


@pytest.mark.parametrize("kind", LINKS)
@pytest.mark.parametrize("command", LOCKED)
def test_lock_file_that_is_a_link_leaves_its_target_as_it_is(
    command: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.csv").write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    target = tmp_path / "precious"
    target.write_text("years of work")
    name, arguments = LOCKED[command]
    linked(kind, tmp_path / name, target)
    result = run(*arguments)
    assert (result.exit_code, target.read_text()) == (1, "years of work"), result.output
    assert LINKS[kind] in result.stderr
    assert name in result.stderr
    assert (tmp_path / name).lstat().st_nlink == (1 if kind == "symbolic" else 2), "nor is the link removed"


def test_lock_file_that_leads_to_nothing_makes_no_file_there(tmp_path: Path) -> None:
    (tmp_path / ".a.npz.lock").symlink_to(tmp_path / "new")
    with pytest.raises(ImageError, match="it is a symbolic link"), Lock(tmp_path / "a.npz", "a render"):
        pass
    assert os.listdir(tmp_path) == [".a.npz.lock"]


def test_pipe_in_place_of_a_lock_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / ".a.npz.lock")
    with pytest.raises(ImageError, match="it is a pipe"), Lock(tmp_path / "a.npz", "a render"):
        pass


def test_where_a_file_system_has_no_locks_it_is_said_and_nobody_is_kept_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def none(*_: object) -> bytes:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "fcntl", none)
    with Lock(tmp_path / "a.npz", "a render"), Lock(tmp_path / "a.npz", "a render"):
        pass
    assert "this file system has no locks" in caplog.text


# The commands.


def test_a_second_render_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    asked = ("-o", out, "--checkpoint", "1i", "--resume")
    with killing.start(*asked, "--spp", 10**6) as process:
        killing.until_rendering(process)
        refused = run("render", *killing.SMALL, *asked, "--spp", 8)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert refused.exit_code == 1, refused.output
    assert f"{out}: a render that resumes from it has it already: process {process.pid} on" in refused.stderr
    begun = Film.load(out).path_sets
    assert run("render", *killing.SMALL, *asked, "--spp", begun + 1, "-q").exit_code == 0
    assert os.listdir(tmp_path) == ["a.npz"]


def test_a_second_render_of_the_same_frames_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "t_{:02}.npz"
    first = holding(out, 2, 4)
    options = ("cornell-box-36", "--resolution", "8x8", "--spp", 1, "--max-depth", 1, "-o", out, "-q")
    refused = run("render", *options, "--turntable", 3)
    others = run("render", *options, "--turntable", 2)
    ended(first)
    assert refused.exit_code == 1, refused.output
    assert f"a render of these frames has it already: process {first.pid} on" in refused.stderr
    assert others.exit_code == 0, others.output
    assert sorted(os.listdir(tmp_path)) == ["t_00.npz", "t_01.npz"]


def test_a_second_solver_is_refused(tmp_path: Path) -> None:
    first = holding(tmp_path / "s.checkpoint.npz")
    result = run("radiosity", "cornell-box-36", "-o", tmp_path / "s.npz", "--resume", "--patches", 60)
    ended(first)
    assert result.exit_code == 1, result.output
    assert re.search(rf"s\.checkpoint\.npz: a solver .* process {first.pid} on", result.stderr)
    assert os.listdir(tmp_path) == []


def test_a_second_matrix_of_view_factors_is_refused_and_leaves_the_rows_of_the_first(tmp_path: Path) -> None:
    out = tmp_path / "F.npz"
    part = tmp_path / "F.npz.part"
    options = ("viewfactors", "cornell-box-36", "-o", out, "--groups", "shapes", "--error", 0.1, "--resume")
    first = holding(part)
    part.write_bytes(b"rows of the first")
    refused = run(*options)
    assert refused.exit_code == 1, refused.output
    assert (
        f"{part}: a matrix of view factors that resumes from it has it already: process {first.pid}"
        in refused.stderr
    )
    assert part.read_bytes() == b"rows of the first"
    assert ended(first, signal.SIGKILL) == -signal.SIGKILL
    part.unlink()
    assert run(*options).exit_code == 0
    assert os.listdir(tmp_path) == ["F.npz"]


def test_a_checkpoint_in_python_is_a_block(tmp_path: Path) -> None:
    with Checkpoint(tmp_path / "a.npz", steps=1) as checkpoint:
        glpath.render("cornell-box-36", spp=2, resolution=(8, 8), on_step=checkpoint)
        with pytest.raises(GlpathError, match=f"process {os.getpid()} on"), Checkpoint(tmp_path / "a.npz"):
            pass
    assert os.listdir(tmp_path) == ["a.npz"]


@pytest.mark.parametrize("path", ["/", "/tmp", "\ud800", "\ud800/a.npz"])
def test_path_at_which_no_file_can_be_is_refused(path: str) -> None:
    with pytest.raises(ImageError, match=r"is a folder|is no path"):
        check_writable(path)
    with pytest.raises(GlpathError, match=r"is a folder|a path without NUL characters and lone surrogates"):
        glpath.view_factors("cornell-box-36", resume=path)
    options: dict[str, Any] = {"samples": 1, "elements": 50, "gather_rays": 16, "resume": path}
    with pytest.raises(GlpathError, match=r"is a folder|a path without NUL characters and lone surrogates"):
        glpath.daylight_coefficients("cornell-box-36", [[0, 0, 0]], [[0, 1, 0]], **options)
    with pytest.raises(ImageError, match=r"is a folder|is no path|cannot be written"), whole_file(path):
        pass
