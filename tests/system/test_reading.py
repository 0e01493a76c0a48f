"""What is read must be a file: pipes into which nobody writes, and devices, are refused and not waited for."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import glpath
from glpath.errors import GlpathError, ImageError
from glpath.film import image
from glpath.film.film import Film
from glpath.jobs.checkpoint import Checkpoint
from glpath.rendering import RenderJob
from glpath.system import files
from tests.support.gltf_files import Gltf

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

    def late(*_: object) -> None:
        raise TimeoutError("it waits for ever")

    monkeypatch.setattr(files, "_PIPE_S", 0.2)
    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(("name", "read"), READERS, ids=lambda each: each if isinstance(each, str) else "")
def test_a_pipe_into_which_nobody_writes_is_refused(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    os.mkfifo(path := tmp_path / name)
    with pytest.raises(GlpathError, match=r"pipe|no such file|not a file"):
        read(path)


@pytest.mark.parametrize(("name", "read"), READERS, ids=lambda each: each if isinstance(each, str) else "")
def test_a_device_without_an_end_is_refused(name: str, read: Callable[[Path], object], tmp_path: Path) -> None:
    (path := tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(GlpathError, match=r"device|no such file|not a file"):
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
        with pytest.raises(GlpathError, match=r"wood\.png|part\.ply"):
            glpath.load_scene(tmp_path / "scene.toml")


def test_a_buffer_of_a_gltf_is_no_pipe_either(tmp_path: Path) -> None:
    file = Gltf()
    file.node(mesh=file.mesh())
    file.json["buffers"] = [{"byteLength": len(file.binary), "uri": "a.bin"}]
    os.mkfifo(tmp_path / "a.bin")
    with pytest.raises(GlpathError, match=r"a\.bin|pipe"):
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


def test_openexr_writes_nothing_beside_our_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    draw = np.random.default_rng(0)
    image.write_exr(tmp_path / "a.exr", draw.random((32, 32, 3)))
    whole = (tmp_path / "a.exr").read_bytes()
    for start in range(len(whole) // 4, len(whole), len(whole) // 8):
        broken = bytearray(whole)
        broken[start : start + 64] = b"\xff" * 64
        for content in (bytes(broken), whole[:start]):
            (tmp_path / "a.exr").write_bytes(content)
            with contextlib.suppress(ImageError):  # a broken pixel is read
                glpath.read_image(tmp_path / "a.exr")
    assert capfd.readouterr() == ("", "")


def test_lines_of_others_are_kept_meanwhile(capfd: pytest.CaptureFixture[str]) -> None:
    from glpath.system.c_output import without_lines

    with without_lines("of a library"):
        os.write(1, b"of a library: oh\n")
        os.write(2, b"of somebody else\n")
    assert capfd.readouterr() == ("", "of somebody else\n")
