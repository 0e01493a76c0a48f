"""What is read must be a file: pipes into which nobody writes, and devices, are refused and not waited for."""

from __future__ import annotations

import contextlib
import errno
import gzip
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

import glpath
from glpath.errors import GlpathError, ImageError
from glpath.film import image
from glpath.film.exr import write_exr
from glpath.film.film import Film
from glpath.jobs.checkpoint import Checkpoint
from glpath.rendering import RenderJob
from glpath.system import files
from glpath.system.time_limit import command_clock
from tests.support.gltf_files import Gltf
from tests.support.repository import ROOT
from tests.support.time_limit import time_limit

#: Why a path is refused. The folder of a test has its name, so "pipe" alone would be found in every message.
REFUSED = r"(it is a (pipe|device).*, not a file|is not a file|no such file)\."
SCENES = ("a.toml", "a.obj", "a.ply", "a.stl", "a.gltf", "a.glb")
PICTURES = ("a.png", "a.jpg", "a.exr", "a.hdr", "a.npz", "a.npy")
READERS: list[tuple[str, Callable[[Path], object]]] = [
    *((name, glpath.load_scene) for name in SCENES),
    *((name, glpath.read_image) for name in PICTURES),
    ("b.png", image.picture_size),
    ("b.exr", image.picture_size),
    ("film.npz", Film.load),
    ("checkpoint.npz", lambda path: Checkpoint(path).load()),
    ("solution.npz", glpath.RadiositySolution.load),
    ("job.json", RenderJob.load),
]


@pytest.fixture(autouse=True)
def in_time(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A reader that waits is a failure, not a test that never ends."""
    monkeypatch.setattr(files, "_WRITER_S", 0.2)
    with time_limit(120):
        yield


@pytest.mark.parametrize(("name", "read"), READERS, ids=lambda each: each if isinstance(each, str) else "")
def test_a_pipe_into_which_nobody_writes_is_refused(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    os.mkfifo(path := tmp_path / name)
    with pytest.raises(GlpathError, match=REFUSED):
        read(path)


@pytest.mark.parametrize(("name", "read"), READERS, ids=lambda each: each if isinstance(each, str) else "")
def test_a_device_without_an_end_is_refused(name: str, read: Callable[[Path], object], tmp_path: Path) -> None:
    (path := tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(GlpathError, match=REFUSED):
        read(path)


def test_what_a_scene_names_is_no_pipe_either(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "wood.png")
    os.mkfifo(tmp_path / "part.ply")
    view = "[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n"
    texture = '[textures]\nwood = { type = "image", file = "wood.png" }\n[materials]\na = { texture = "wood" }\n'
    quad = '[[shapes]]\ntype = "quad"\nmaterial = "a"\ncorners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\n'
    mesh = '[materials]\na = {}\n[[shapes]]\ntype = "mesh"\nmaterial = "a"\nfile = "part.ply"\n'
    for text in (texture + quad, mesh):
        (tmp_path / "scene.toml").write_text(view + text)
        with pytest.raises(GlpathError, match=r"(wood\.png|part\.ply), which is not a file"):
            glpath.load_scene(tmp_path / "scene.toml")


def test_a_buffer_of_a_gltf_is_no_pipe_either(tmp_path: Path) -> None:
    file = Gltf()
    file.node(mesh=file.mesh())
    file.json["buffers"] = [{"byteLength": len(file.binary), "uri": "a.bin"}]
    os.mkfifo(tmp_path / "a.bin")
    with pytest.raises(GlpathError, match=r'"a\.bin", which is not a file'):
        glpath.load_scene(file.write(tmp_path))


def test_points_are_no_device() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "glpath", "measure", "cornell-box-36", "--points", "/dev/zero", "-o", "-"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode != 0
    assert "/dev/zero" in done.stderr
    assert "device" in done.stderr


def test_openexr_writes_nothing_beside_the_error_of_a_command(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    draw = np.random.default_rng(0)
    write_exr(tmp_path / "a.exr", draw.random((32, 32, 3)))
    whole = (tmp_path / "a.exr").read_bytes()
    for start in range(len(whole) // 4, len(whole), len(whole) // 8):
        broken = bytearray(whole)
        broken[start : start + 64] = b"\xff" * 64
        for content in (bytes(broken), whole[:start]):
            (tmp_path / "a.exr").write_bytes(content)
            with command_clock(), contextlib.suppress(ImageError):  # a broken pixel is read
                glpath.read_image(tmp_path / "a.exr")
    assert capfd.readouterr() == ("", "")


def test_program_writes_to_its_standard_output_during_exr_files(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lines of other threads, here of OpenEXR itself, stay in their order and streams."""
    write_exr(tmp_path / "a.exr", np.ones((2, 2, 3)))
    original, stdout = OpenEXR.File, sys.stdout

    def print_and_open(*arguments: Any, **options: Any) -> Any:
        print("row", file=stdout, flush=True)
        subprocess.run(["echo", "row of a child process"], check=True)
        os.write(2, b"error\n")
        assert sys.stdout is stdout
        return original(*arguments, **options)

    monkeypatch.setattr(OpenEXR, "File", print_and_open)
    write_exr(tmp_path / "b.exr", np.ones((2, 2, 3)))
    assert capfd.readouterr() == ("row\nrow of a child process\n", "error\n")
    glpath.read_image(tmp_path / "a.exr")
    assert capfd.readouterr()[1] == "error\n" * 2  # of the header and the pixels


def test_lines_of_others_are_kept_meanwhile(capfd: pytest.CaptureFixture[str]) -> None:
    from glpath.film.exr import without_lines

    with without_lines("of a library"):
        os.write(1, b"of a library: oh\n")
        os.write(2, b"of somebody else\n")
    assert capfd.readouterr() == ("", "of somebody else\n")


def run(*arguments: str | Path, **how: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "glpath", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, **how)


def check_refused(done: subprocess.CompletedProcess[str], words: str) -> None:
    """One error block and nothing else."""
    assert done.returncode in (1, 2)
    assert done.stderr.startswith("glpath: error: ")
    assert "Traceback" not in done.stderr
    assert words in done.stderr


def test_standard_input_may_be_silent_while_somebody_holds_it_open() -> None:
    """A program before glpath may think for longer than any limit."""
    content = (ROOT / "scenes" / "cornell-box.toml").read_bytes()
    line = f"(printf '# slow\\n'; sleep 5; cat) | {sys.executable} -m glpath info -"
    done = subprocess.run(["bash", "-c", line], input=content, capture_output=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"triangles" in done.stdout


def test_standard_input_may_be_a_socket() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.sendall((ROOT / "scenes" / "cornell-box.toml").read_bytes())
        ours.shutdown(socket.SHUT_WR)
        done = run("info", "-", stdin=theirs)
    assert (done.returncode, done.stderr) == (0, "")
    assert "triangles" in done.stdout


def test_standard_input_may_be_set_not_to_wait() -> None:
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    late = threading.Timer(4.0, lambda: (os.write(writing, b"shapes = ["), os.close(writing)))
    late.start()
    done = run("info", "-", stdin=reading)
    late.join()
    os.close(reading)
    check_refused(done, "standard input: line 1")


def test_a_named_pipe_may_be_silent_while_somebody_holds_it_open(tmp_path: Path) -> None:
    """For longer than somebody may take to open it."""
    os.mkfifo(path := tmp_path / "a")
    writer = subprocess.Popen(["sh", "-c", f"exec > '{path}'; sleep 1; printf one; sleep 1; printf two"])
    with writer:
        assert files.read_bytes(path) == b"onetwo"


@pytest.mark.parametrize("command", ["info -", "measure cornell-box-36 --points - -o -"])
def test_standard_input_is_no_device(command: str) -> None:
    with open("/dev/zero", "rb") as zeros:
        check_refused(run(*command.split(), stdin=zeros), "it is a device")


def test_standard_input_that_is_closed_is_an_error() -> None:
    check_refused(run("info", "-", preexec_fn=lambda: os.close(0)), "standard input: cannot be read: it is closed")


@pytest.mark.parametrize(
    "line", ["zcat {} | {} info -", "(sleep 1; zcat {}) | {} info -", "{1} info <(sleep 5; zcat {0})"]
)
def test_a_scene_is_read_from_pipes_of_the_shell(line: str, tmp_path: Path) -> None:
    packed = tmp_path / "a.toml.gz"
    packed.write_bytes(gzip.compress((ROOT / "scenes" / "cornell-box.toml").read_bytes()))
    command = ["bash", "-c", line.format(packed, f"{sys.executable} -m glpath")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    assert "triangles" in done.stdout


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_weather_and_other_tables_are_no_pipes_without_a_writer_and_no_devices(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("pvlib")
    from glpath.io.weather import read_weather

    for name, read in (
        ("a.epw", read_weather),
        ("a.asc", glpath.load_height_field),
        ("a.hbjson", glpath.load_scene),
        ("a.xml", glpath.load_scene),
    ):
        if kind == "pipe":
            os.mkfifo(tmp_path / name)
        else:
            (tmp_path / name).symlink_to("/dev/zero")
        with pytest.raises(GlpathError, match=REFUSED):
            read(tmp_path / name)


def test_a_pipe_without_an_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_MAX_PIPE_BYTES", 1 << 20)
    monkeypatch.setattr(files, "_WRITER_S", 60.0)  # the writer may start late
    os.mkfifo(path := tmp_path / "a.toml")
    endless = subprocess.Popen(["sh", "-c", f"exec cat /dev/zero > '{path}'"])
    words = r"a\.toml: cannot be read: it has more than the 1,048,576 bytes"
    with endless, pytest.raises(GlpathError, match=words):
        glpath.load_scene(path)


@pytest.mark.skipif(not hasattr(os, "SEEK_DATA"), reason="this system cannot tell where the holes of a file are")
@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb", "a.toml", "a.hbjson", "a.png", "a.npy", "a.epw"])
def test_a_file_of_holes_is_refused(name: str, tmp_path: Path) -> None:
    """A file of 3 GB that has 64 kB on the disk."""
    path = tmp_path / name
    path.write_bytes(b"\n" * 65536)
    os.truncate(path, 3 << 30)
    read: Any = image.read_image if path.suffix in (".png", ".npy") else glpath.load_scene
    if path.suffix == ".epw":
        pytest.importorskip("pvlib")
        from glpath.io.weather import read_weather as read
    with pytest.raises(GlpathError, match=r"are holes|bytes that are read"):
        read(path)


def test_a_file_with_some_holes_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"a" * (2 << 20))
    os.truncate(path, 100 << 20)
    assert files.read_bytes(path).rstrip(b"\0") == b"a" * (2 << 20)
    with pytest.raises(OSError, match="more than the 1,000 bytes"):
        files.read_bytes(path, 1000)


def test_a_name_with_a_nul_is_no_traceback() -> None:
    with pytest.raises(OSError, match="Invalid argument"):
        files.read_bytes("a\0b")


@pytest.mark.parametrize("suffix", [".toml", ".glb", ".ply", ".obj", ".xml", ".tif", ".asc", ".las"])
def test_a_file_in_a_folder_that_may_not_be_entered_is_denied(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stat = os.stat

    def refuse(path: Any, *given: Any, **more: Any) -> os.stat_result:
        if "locked" in str(path):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return stat(path, *given, **more)

    monkeypatch.setattr(os, "stat", refuse)
    load = {".tif": glpath.load_height_field, ".asc": glpath.load_height_field, ".las": glpath.load_point_cloud}
    with pytest.raises(GlpathError, match="Permission denied"):
        load.get(suffix, glpath.load_scene)(tmp_path / "locked" / "in" / f"x{suffix}")
