"""Spoiled files of every format give a well-formed result or one clear error, soon, and never a traceback."""

from __future__ import annotations

import contextlib
import shutil
import signal
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings

from glpath.errors import GlpathError, SceneWarning
from glpath.system.machine import peak_resident_bytes
from tests.support.mutated_files import NAMES, Edit, Seed, edits, seeds, spoiled

# Of each format; more by hand find little more.
EXAMPLES = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Seed]:
    return seeds(tmp_path_factory.mktemp("seeds"))


@contextmanager
def in_time() -> Iterator[None]:
    """Fail after a second of processor time, and stop what waits for ever."""

    def late(*_: object) -> None:
        raise TimeoutError("a reader took more than 20 s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    began = time.process_time()
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize("name", NAMES)
def test_a_spoiled_file_gives_a_result_or_an_error(name: str, whole: dict[str, Seed], tmp_path: Path) -> None:
    if name not in whole:
        pytest.skip("the extra `terrain` is not installed")
    seed, folder = whole[name], tmp_path / "files"

    def read(content: bytes) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        seed.write(folder, content)
        with in_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            seed.read(folder)

    read(seed.content)  # a whole file is read, or nothing is shown by a spoiled one
    before = peak_resident_bytes() or 0

    @settings(max_examples=EXAMPLES, database=None, derandomize=True, deadline=None)
    @given(edits(seed.text))
    def read_spoiled(made: list[Edit]) -> None:
        with contextlib.suppress(GlpathError):
            read(spoiled(seed.content, made))

    read_spoiled()
    assert (peak_resident_bytes() or 0) - before < 1 << 29


def test_all_seeds_are_tried(whole: dict[str, Seed]) -> None:
    assert set(whole) == set(NAMES) or set(NAMES) - set(whole) == {"a.las", "a.laz", "heights.tif"}


def test_the_property_fails_for_a_reader_that_raises_something_else(whole: dict[str, Seed], tmp_path: Path) -> None:
    def wrong(folder: Path) -> None:
        if (folder / "a.toml").read_bytes() != whole["scene.toml"].content:
            raise RecursionError

    other = dict(whole) | {"scene.toml": replace(whole["scene.toml"], read=wrong)}
    with pytest.raises(RecursionError):
        test_a_spoiled_file_gives_a_result_or_an_error("scene.toml", other, tmp_path)
