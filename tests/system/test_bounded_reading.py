"""Reading ends with an error if it takes too much time or memory, whatever the parser does."""

from __future__ import annotations

import os
import threading
import time
import zipfile
from contextlib import suppress
from contextvars import ContextVar
from pathlib import Path

import numpy as np
import pytest

from glpath.apps.terrain.reading import load_height_field
from glpath.apps.view_factors.result import ViewFactors
from glpath.errors import ImageError, SceneError, TimeLimitError
from glpath.io import load_scene
from glpath.system import bounded_reading, files
from glpath.system.bounded_reading import (
    allow_unfolded,
    count_file,
    reading_file,
    reading_result,
    reading_scene,
    without_bounds,
)
from glpath.system.time_limit import limited

# Processor time after which a test gives up, seconds; the bounds end the work long before it.
_GIVE_UP_S = 20.0


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_reading, "SECONDS", 0.05)
    monkeypatch.setattr(bounded_reading, "_SAMPLE_S", 0.01)
    monkeypatch.setattr(bounded_reading, "_AGAIN_S", 0.05)


def _work(seconds: float = _GIVE_UP_S) -> None:
    """Use processor time in Python, as a parser in a loop does."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        sum(range(100))


def test_a_parser_that_runs_too_long_ends_with_an_error() -> None:
    begin = time.thread_time()
    with pytest.raises(SceneError, match=r"a\.obj: reading 0 bytes takes more than 0\.05 s"), reading_file("a.obj"):
        _work()
    assert time.thread_time() - begin < _GIVE_UP_S / 4


def test_a_parser_that_catches_everything_ends_too() -> None:
    caught = []

    def parse() -> None:
        while len(caught) < 3:
            try:
                _work()
                return
            except BaseException as error:
                caught.append(error)
        raise ValueError("damaged")

    with pytest.raises(SceneError, match="processor time"), reading_file("a.obj"):
        parse()
    assert len(caught) == 3


def test_processor_time_counts_and_waiting_does_not() -> None:
    with reading_file("a.obj"):
        time.sleep(0.15)


def test_a_parser_that_takes_too_much_memory_ends_with_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_reading, "SECONDS", _GIVE_UP_S)
    monkeypatch.setattr(bounded_reading, "MEMORY", 2**24)
    kept: list[np.ndarray] = []

    def parse() -> None:
        while len(kept) < 200:
            kept.append(np.ones(2**18))
            time.sleep(0.002)

    with (
        pytest.raises(SceneError, match=r"grew by more than 0\.0168 GB while 0 bytes"),
        reading_file("a.ply"),
    ):
        parse()
    assert 8 * 2**18 * len(kept) < 2**28


def test_unfolded_data_that_another_check_allowed_raise_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_reading, "MEMORY", 2**24)
    with reading_file("a.png"):
        allow_unfolded(2**25)
        pixels = np.ones(2**22)
        _work(0.5)
    assert pixels.all()


def test_large_files_may_take_longer(tmp_path: Path) -> None:
    large = tmp_path / "a.obj"
    large.write_bytes(bytes(50_000))
    with reading_file("a.obj"):
        descriptor = os.open(large, os.O_RDONLY)
        try:
            count_file(descriptor)  # 0.5 s more
        finally:
            os.close(descriptor)
        _work(0.2)


def test_a_file_that_is_read_again_counts_once(tmp_path: Path) -> None:
    small = tmp_path / "a.mtl"
    small.write_bytes(bytes(10_000))
    descriptor = os.open(small, os.O_RDONLY)

    def parse() -> None:
        for _ in range(10_000_000):
            count_file(descriptor)

    try:
        with pytest.raises(SceneError, match=r"reading 10,000 bytes"), reading_file("a.obj"):
            parse()
    finally:
        os.close(descriptor)


def test_a_time_limit_ends_reading_in_place_of_the_bound() -> None:
    with limited(0.2):
        with reading_file("a.obj"):
            _work(0.15)
        with (
            pytest.raises(TimeLimitError, match=r"time_limit=0.2: over while reading a.obj"),
            reading_file("a.obj"),
        ):
            _work()


def test_a_resumed_run_that_has_a_time_limit_has_no_bound_of_processor_time() -> None:
    with limited(10.0, resumes=True), reading_scene("a.toml"):
        _work(0.15)


def test_a_trusted_file_has_no_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_reading, "MEMORY", 2**20)
    monkeypatch.setenv("GLPATH_TRUST_FILES", "1")
    with reading_file("a.obj"):
        kept = np.ones(2**20)
        _work(0.15)
    assert kept.all()


def test_reading_a_result_is_bounded_without_a_time_limit() -> None:
    message = r"a\.npz: reading 0 bytes takes more"
    with limited(0.01), pytest.raises(ImageError, match=message), reading_result("a.npz"):
        _work()


def test_an_interrupt_at_the_start_leaves_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        start(thread)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt), reading_file("a.obj"):
        pass
    assert "glpath reading" not in {thread.name for thread in threading.enumerate()}
    _work(0.1)


def test_view_factors_of_half_floats_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in {
            "glpath_view_factors": np.array(2),
            "shape": np.array([1, 1]),
            "data": np.zeros(3, np.float16),
            "indices": np.zeros(3, np.int32),
        }.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, array)
    with pytest.raises(ImageError, match=r"not those of a matrix of float64"):
        ViewFactors.load(path)


def test_files_that_data_of_the_caller_name_have_bounds() -> None:
    with reading_scene("the scene", own_data=True):
        with pytest.raises(SceneError, match=r"a\.obj: reading 0 bytes"), reading_file("a.obj"):
            _work()
        _work(0.15)
    with limited(0.2), pytest.raises(TimeLimitError), reading_scene("the scene", own_data=True):
        _nested()


def _nested() -> None:
    with reading_file("a.obj"):
        _work()


@pytest.mark.parametrize("source", ["file", "pipe"])
def test_standard_input_counts(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = tmp_path / "a.csv"
    content.write_bytes(bytes(50_000))  # 0.5 s more
    if source == "file":
        descriptor = os.open(content, os.O_RDONLY)
    else:
        descriptor, writer = os.pipe()
        os.write(writer, content.read_bytes())
        os.close(writer)
    with os.fdopen(descriptor) as stream:
        monkeypatch.setattr("sys.stdin", stream)
        with reading_file("-"):
            assert len(files.read_standard_input()) == 50_000
            _work(0.2)


def test_data_of_the_caller_has_a_time_limit_alone() -> None:
    with reading_file("the scene", own_data=True):
        _work(0.15)
    with limited(0.1), pytest.raises(TimeLimitError), reading_file("the scene", own_data=True):
        _work()


def test_work_that_does_not_depend_on_the_file_is_free() -> None:
    with reading_file("a.obj"):
        with without_bounds():
            _work(0.15)
        _work(0.01)


def test_context_variables_have_their_earlier_values_after_the_error() -> None:
    variable: ContextVar[str] = ContextVar("variable", default="none")
    variable.set("outside")

    def parse() -> None:
        variable.set("inside")
        _work()

    with pytest.raises(SceneError), reading_file("a.obj"):
        parse()
    assert variable.get() == "outside"


def test_nothing_is_raised_after_the_end() -> None:
    for _ in range(20):
        with suppress(SceneError), reading_file("a.obj"):
            _work(0.055)  # ends at about the time of the exception
    _work(0.1)


@pytest.mark.parametrize("name", ["a.toml", "a.obj", "a.xml", "a.gltf", "a.asc"])
def test_every_reader_has_the_bounds(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / name
    file.write_text("v 0 0 0\n")
    monkeypatch.setattr(files, "count_file", lambda descriptor: _work())
    read = load_height_field if name.endswith(".asc") else load_scene
    with pytest.raises(SceneError, match=f"{name}: reading 0 bytes takes more than"):
        read(file)
