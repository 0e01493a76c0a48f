"""Spoiled files of every format give a well-formed result or one clear error, soon, and never a traceback."""

from __future__ import annotations

import shutil
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings

from glpath.errors import GlpathError, SceneWarning
from glpath.system.machine import peak_resident_bytes
from tests.support.mutated_files import NAMES, Edit, Seed, edits, seeds, spoiled
from tests.support.time_limit import time_limit

# Of each format; more by hand find little more.
EXAMPLES = 40
# Processor time that a reader may take, and attempts of which the fastest counts: another may compile or collect.
MAX_SECONDS, ATTEMPTS = 1.0, 3


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Seed]:
    return seeds(tmp_path_factory.mktemp("seeds"))


def error_in_time(read: Callable[[], object]) -> GlpathError | None:
    """Return the error of a reader, or None. Fails if every attempt takes too long, also if it ends in an error."""
    for _ in range(ATTEMPTS):
        error, began = None, time.process_time()
        try:
            with time_limit(20):
                read()
        except GlpathError as raised:
            error = raised
        if time.process_time() - began < MAX_SECONDS:
            return error
    pytest.fail(f"a reader took more than {MAX_SECONDS:g} s in each of {ATTEMPTS} attempts")


@pytest.mark.parametrize("name", NAMES)
def test_a_spoiled_file_gives_a_result_or_an_error(name: str, whole: dict[str, Seed], tmp_path: Path) -> None:
    if name not in whole:
        pytest.skip("the extra `terrain` is not installed")
    seed, folder = whole[name], tmp_path / "files"

    def error_of(content: bytes) -> GlpathError | None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        seed.write(folder, content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            return error_in_time(lambda: seed.read(folder))

    assert error_of(seed.content) is None  # a whole file is read, or nothing is shown by a spoiled one
    before = peak_resident_bytes() or 0

    @settings(max_examples=EXAMPLES, database=None, derandomize=True, deadline=None)
    @given(edits(seed.text))
    def read_spoiled(made: list[Edit]) -> None:
        error_of(spoiled(seed.content, made))

    read_spoiled()
    assert (peak_resident_bytes() or 0) - before < 1 << 29


@pytest.mark.parametrize("name", ["binary.ply", "binary.stl", "binary of a.glb", "stream of a.serialized"])
def test_a_signalling_nan_is_as_any_other(name: str, whole: dict[str, Seed], tmp_path: Path) -> None:
    """numpy warns of its conversion, and readers turn the warning into an error where warnings are errors."""
    seed = whole[name]
    for at in range(0, len(seed.content) - 3, 2):
        content = seed.content[:at] + b"\x01\x00\xa0\x7f" + seed.content[at + 4 :]
        seed.write(tmp_path, content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            assert "RuntimeWarning" not in str(error_in_time(lambda: seed.read(tmp_path)))


def test_all_seeds_are_tried(whole: dict[str, Seed]) -> None:
    assert set(whole) == set(NAMES) or set(NAMES) - set(whole) == {"a.las", "a.laz", "heights.tif"}


def test_the_property_fails_for_a_reader_that_raises_something_else(whole: dict[str, Seed], tmp_path: Path) -> None:
    def wrong(folder: Path) -> None:
        if (folder / "a.toml").read_bytes() != whole["scene.toml"].content:
            raise RecursionError

    other = dict(whole) | {"scene.toml": replace(whole["scene.toml"], read=wrong)}
    with pytest.raises(RecursionError):
        test_a_spoiled_file_gives_a_result_or_an_error("scene.toml", other, tmp_path)


@pytest.mark.parametrize("is_error", [False, True])
def test_the_property_fails_for_a_slow_reader(is_error: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also for one whose error comes too late."""
    monkeypatch.setattr(f"{__name__}.MAX_SECONDS", 0.02)

    def slow() -> None:
        began = time.process_time()
        while time.process_time() - began < 0.03:
            pass
        if is_error:
            raise GlpathError("a.toml: is empty.")

    with pytest.raises(pytest.fail.Exception, match="in each of 3 attempts"):
        error_in_time(slow)


def test_one_slow_attempt_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first may compile or import something."""
    monkeypatch.setattr(f"{__name__}.MAX_SECONDS", 0.02)
    seconds = iter([0.03, 0.0])

    def read() -> None:
        end = time.process_time() + next(seconds)
        while time.process_time() < end:
            pass

    assert error_in_time(read) is None


def test_a_reader_that_waits_fails_though_it_turns_errors_into_its_own() -> None:
    def waiting() -> None:
        try:
            time.sleep(30)
        except Exception as error:
            raise GlpathError("a.toml: cannot be read.") from error

    with pytest.raises(pytest.fail.Exception, match="did not end within 1 s"), time_limit(1):
        waiting()
