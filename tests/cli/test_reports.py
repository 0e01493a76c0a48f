"""Reports that cannot be written end no command: its file is written, and its exit code is 0."""

from __future__ import annotations

import errno
import io
import logging
import os
import select
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import glpath
from glpath.cli import main
from glpath.cli.signals import RESUME_LATER
from glpath.errors import warn
from glpath.film.film import Film
from glpath.system import files
from glpath.system.log import log
from glpath.system.reporting import ProgressEvent, reporting
from glpath.system.terminal import report_stream
from tests.support.killing import default_signals
from tests.support.repository import ROOT

RENDER = "render cornell-box-36 --resolution 12x8 --max-depth 2 --spp 2"

# What a shell may do with standard error, by a name.
SHELLS = {
    "full": "{render} -o a.png 2>/dev/full; echo $? >code",
    "full, with a bar": "{render} -o a.png --progress bar 2>/dev/full; echo $? >code",
    "closed": "{render} -o a.png 2>&-; echo $? >code",
    "all closed": "{render} -o a.png <&- >&- 2>&-; echo $? >code",
    "a reader that ends": "({render} -o a.png --progress json; echo $? >code) 2>&1 | head -n 1",
    "closed, with the picture on standard output": "{render} -o - 2>&- >a.png; echo $? >code",
}

# One small use of each command that writes a file.
WRITERS = {
    "a.png": RENDER,
    "b.png": f"{RENDER} -v --progress json",
    "t_{:02}.png": f"{RENDER} --turntable 2",
    "e.glb": "export cornell-box-36",
    "s.npz": "radiosity cornell-box-36 --patches 60",
    "F.npz": "viewfactors cornell-box-36 --groups shapes --error 0.1",
    "m.csv": "measure cornell-box-36 --plane y=0.5 --spacing 0.5 --spp 4",
    "p.json": "probes cornell-box-36 --grid 1x1x1 --spp 4",
    "l.glb": "lightmap cornell-box-36 --size 32 --spp 4",
    "dc.npz": "daylight cornell-box-36 --points sensors.csv --samples 1 --elements 60 --gather-rays 64",
    "svf.npy": "horizon flat.npy --azimuths 8",
    "merged.npz": "merge film.npz",
    "difference.png": "diff film.npz film.npz",
}


class Full(io.StringIO):
    """A stream on a full disk."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def flush(self) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Foreign(io.StringIO):
    """A stream of another program, such as a notebook, whose methods raise an error of its own."""

    def write(self, text: str) -> int:
        raise RuntimeError("no write")

    def flush(self) -> None:
        raise RuntimeError("no flush")

    def isatty(self) -> bool:
        raise RuntimeError("no isatty")

    def fileno(self) -> int:
        raise RuntimeError("no fileno")


def closed() -> io.StringIO:
    stream = io.StringIO()
    stream.close()
    return stream


def _write_inputs(line: str) -> None:
    Path("sensors.csv").write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    np.save("flat.npy", np.zeros((5, 5)))
    if "film.npz" in line:
        glpath.render("cornell-box-36", spp=2, resolution=(8, 8), max_depth=2).save("film.npz")
    if "s.npz" in line:
        scene = glpath.load_scene("cornell-box-36")
        glpath.solve_radiosity(scene, patches=20, receiver_points=1).save("s.npz")


@pytest.mark.parametrize("out", WRITERS)
def test_a_full_log_ends_no_command(out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if out == "l.glb":
        pytest.importorskip("xatlas")
    monkeypatch.chdir(tmp_path)
    _write_inputs(WRITERS[out])
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(sys, "argv", ["glpath", *WRITERS[out].split(), "-o", out])
    monkeypatch.setattr(sys, "stderr", Full())
    with pytest.raises(SystemExit) as end:
        main.run()
    assert end.value.code == 0
    assert Path(out.format(0)).stat().st_size > 0


@pytest.mark.parametrize("out", [*WRITERS, "e.xml", "b.glb"])
def test_signal_while_writing_loses_no_result(out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of two outputs gets a signal before its first byte; both are written whole."""
    if out == "l.glb":
        pytest.importorskip("xatlas")
    monkeypatch.chdir(tmp_path)
    lines = WRITERS | {"e.xml": "export cornell-box-36", "b.glb": "radiosity cornell-box-36 --radiosity s.npz"}
    _write_inputs(lines[out])
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    second = [] if out in ("p.json", "l.glb", "difference.png") else ["-o", f"second-{out}"]
    monkeypatch.setattr(sys, "argv", ["glpath", *lines[out].split(), "-o", out, *second])
    real = files._locked

    def strike(path: Path) -> int | None:
        monkeypatch.setattr(files, "_locked", real)
        signal.raise_signal(signal.SIGINT)
        return real(path)

    monkeypatch.setattr(files, "_locked", strike)
    monkeypatch.setattr(main, "_end_with", sys.exit)  # which ends this process, too
    with pytest.raises(SystemExit) as end:
        main.run()
    assert end.value.code == 130
    for name in (out, *second[1:]):
        assert Path(name.format(0)).stat().st_size > 0


@pytest.mark.skipif(os.name == "nt", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("shell", SHELLS.values(), ids=SHELLS)
def test_a_shell_that_drops_reports_gets_the_picture(shell: str, tmp_path: Path) -> None:
    line = shell.format(render=f"{sys.executable} -m glpath {RENDER}")
    subprocess.run(["bash", "-c", line], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=300)
    assert (tmp_path / "code").read_text() == "0\n"
    assert iio.imread(tmp_path / "a.png").shape == (8, 12, 3)


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
@pytest.mark.parametrize("progress", ["lines", "json", "bar"])
def test_command_with_unread_standard_error_writes_its_picture(
    progress: str, unread_stream: int, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "glpath", *RENDER.split(), "-v", "--progress", progress, "-o", "a.png"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, stderr=unread_stream, timeout=100)
    assert done.returncode == 0
    assert iio.imread(tmp_path / "a.png").shape == (8, 12, 3)


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_command_with_unread_standard_error_fails_with_its_exit_code(unread_stream: int) -> None:
    for words, code in [(["render", "no-such-scene", "-o", "a.png"], 1), (["render", "--no-such-option"], 2)]:
        done = subprocess.run([sys.executable, "-m", "glpath", *words], stderr=unread_stream, timeout=60)
        assert done.returncode == code


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_signals_with_unread_standard_error_save_the_film(unread_stream: int, tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    words = [*RENDER.split()[:-1], "1000000", "--checkpoint", "1i", "--progress", "json", "-o", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "glpath", *words]
    with subprocess.Popen(command, env=environment, stderr=unread_stream, preexec_fn=default_signals) as process:
        until = time.monotonic() + 60
        while not out.exists() and time.monotonic() < until:
            time.sleep(0.05)
        before = Film.load(out).path_sets
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == RESUME_LATER
    assert Film.load(out).path_sets >= before > 0


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_report_stream_waits_for_a_slow_reader() -> None:
    read, write = os.pipe()
    text = "".join(f"line {i}: {'x' * 1000}\n" for i in range(300))  # more than a pipe holds
    parts: list[bytes] = []

    def read_slowly() -> None:
        while part := os.read(read, 1 << 15):
            parts.append(part)
            time.sleep(0.01)

    reader = threading.Thread(target=read_slowly)
    reader.start()
    with open(write, "w", encoding="utf-8") as file:
        print(text, end="", file=report_stream(file), flush=True)
    reader.join()
    os.close(read)
    assert b"".join(parts).decode() == text


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_report_stream_waits_once_and_writes_again_when_its_pipe_is_read() -> None:
    read, write = os.pipe()
    with open(write, "w", encoding="utf-8") as file:
        stream = report_stream(file)
        began = time.monotonic()
        for _ in range(1000):
            print("x" * 1000, file=stream, flush=True)
        assert time.monotonic() - began < 10
        while len(os.read(read, 1 << 16)) == 1 << 16:
            pass
        print("after", file=stream, flush=True)
    assert os.read(read, 1 << 16).endswith(b"after\n")
    os.close(read)


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
def test_report_stream_drops_text_while_its_terminal_is_suspended() -> None:
    master, terminal = os.openpty()
    with open(terminal, "w", encoding="utf-8") as file:
        stream = report_stream(file)
        os.write(master, b"\x13")  # Ctrl-S
        while select.select([], [terminal], [], 0)[1]:
            time.sleep(0.001)
        print("dropped", file=stream)
        os.write(master, b"\x11")  # Ctrl-Q
        select.select([], [terminal], [])
        print("x" * 1000, file=stream)
        print("progress", end="\r", file=stream, flush=True)
        text = b""
        while not text.endswith(b"\r"):
            text += os.read(master, 4096)
    assert text.decode() == "x" * 1000 + "\r\nprogress\r"
    os.close(master)


@pytest.mark.parametrize("mode", ["bar", "lines", "json"])
@pytest.mark.parametrize("stream", [Full(), closed(), None, Foreign()], ids=["full", "closed", "none", "foreign"])
def test_a_reporter_drops_reports_that_its_stream_refuses(
    mode: str, stream: io.StringIO | None, capsys: pytest.CaptureFixture[str]
) -> None:
    event = ProgressEvent(stage="rendering", elapsed_s=1.0, done=1, total=1, values={}, renderer="llvmpipe")
    with reporting(mode, stream, lambda each: each) as report:
        assert report is not None
        report(event)
    assert capsys.readouterr().out == "", "standard output belongs to results"


def test_handler_of_the_log_that_raises_does_not_end_the_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Broken(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            raise RuntimeError("broken")

    monkeypatch.setattr(logging.getLogger("glpath"), "handlers", [Broken()])
    log.warning("%d path sets\nkept", 3)
    assert "3 path sets\nkept" in capsys.readouterr().err


def test_warning_that_cannot_be_shown_does_not_end_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        monkeypatch.setattr(warnings, "showwarning", lambda *_, **__: Foreign().write(""))
        warn("the scene is dark")
        warnings.simplefilter("error")
        with pytest.raises(glpath.SceneWarning):
            warn("the scene is dark")


@pytest.mark.parametrize("stream", [closed(), Foreign()], ids=["closed", "foreign"])
def test_a_python_render_outlives_its_standard_error(stream: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    film = glpath.render("cornell-box-36", spp=1, resolution=(8, 8), max_depth=1, progress="lines")
    assert film.path_sets == 1
