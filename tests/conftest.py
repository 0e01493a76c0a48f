"""What several test modules stand on."""

from __future__ import annotations

import contextlib
import gc
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import hypothesis
import numpy as np
import pytest

from glpath.film.batches import blocks
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from tests.support.repository import TESTS

# A project of its own; `test_plugin` of the image tests runs it.
collect_ignore = ["example_project"]

MakeFilm = Callable[..., Film]
Spoil = Callable[[str, str, str], None]


@pytest.fixture(autouse=True)
def no_gl_error() -> Iterator[None]:
    """A test that leaves a GL error behind fails, as moderngl looks for none itself."""
    yield
    # Most tests make no context; asking for one would cost more than they do.
    module = sys.modules.get("glpath.gl.context")
    context = module._context if module else None
    if context is None or context.pid != os.getpid():
        return
    with context:
        error = context.gl.error
    assert error == "GL_NO_ERROR", f"the test left {error} behind"


@pytest.fixture
def spoil(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Spoil:
    """An engine that is wrong on purpose: a claim that holds of it as well says nothing.

    `spoil(file, text, other)`: from now on a shader has `other` in place of `text`, which it must have just once.
    """
    from glpath.gl import program

    folder = tmp_path / "shaders"

    def spoiled(file: str, text: str, other: str) -> None:
        if not folder.exists():
            shutil.copytree(program.shader_folder(), folder)
            monkeypatch.setattr(program, "shader_folder", lambda: folder)
        written = (folder / file).read_text()
        assert written.count(text) == 1, f"shaders/{file} has {text!r} {written.count(text)} times"
        (folder / file).write_text(written.replace(text, other))

    return spoiled


@pytest.fixture
def make_film() -> MakeFilm:
    """A maker of films as a path tracer makes them: `make_film(ranges, size, **metadata)`.

    What a path set adds depends on its number alone, and is a multiple of 2**-36, below 1.
    """

    def make(
        ranges: Sequence[tuple[int, int]] = ((0, 32),), size: tuple[int, int] = (6, 4), **metadata: object
    ) -> Film:
        fields: dict[str, object] = {
            "scene": "cornell-box",
            "scene_hash": "0123abcd",
            "integrator": "path",
            "seed": 3,
            "max_depth": 5,
            "settings": {"sampling": "sobol", "ambient": (0.0, 0.0, 0.0)},
            "full_resolution": size,
            "window": (0, 0, *size),
            "device": "llvmpipe",
            "versions": {"glpath": "0.1.0"},
            "elapsed_s": 1.5,
            "statistics": {"paths_cast": 1000, "paths_lost": 20, "dropped_samples": 0, "stage_ms": {"eye": 2.0}},
        } | metadata
        film = Film.empty(FilmMetadata(**fields))  # type: ignore[arg-type]
        width, height = film.metadata.window[2:]
        for first, last in ranges:
            for start, stop in blocks(first, last):
                film.add(start, stop, sum(_path_set(i, height, width) for i in range(start, stop)))
        return film

    return make


def _path_set(index: int, height: int, width: int) -> np.ndarray:
    quanta = np.random.default_rng(index).integers(0, 2**36, (height, width, 3))
    return quanta * 2.0**-36


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of `slow.txt` as evidence. Evidence is compared with references, so it may warn of a bias."""
    slow = slow_tests()
    for item in items:
        if item.nodeid.removeprefix("tests/") in slow:
            item.add_marker(pytest.mark.evidence)
        if item.get_closest_marker("evidence"):
            item.add_marker(pytest.mark.filterwarnings("ignore:.*the bias of the"))


def slow_tests() -> frozenset[str]:
    """Node ids without `tests/`."""
    lines = (TESTS / "slow.txt").read_text().splitlines()
    return frozenset(line for line in lines if line and not line.startswith("#"))


def pytest_collection_finish() -> None:
    """What collecting made lives to the end: no full garbage collection need spend half a second on it."""
    gc.collect()
    gc.freeze()


# The same examples every time: a test suite that fails by chance is not believed. Explore with --hypothesis-seed.
hypothesis.settings.register_profile("glpath", derandomize=True, deadline=None)
hypothesis.settings.load_profile("glpath")

# Whoever starts the suite in the background of a script has SIGINT ignored, and so would have the programs that are
# tested here; a handler of one's own makes it a signal again, in them too.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(params=["pipe", "terminal"])
def unread_stream(request: pytest.FixtureRequest) -> Iterator[int]:
    """Descriptor of a full pipe or terminal that nobody reads."""
    read, write = os.pipe() if request.param == "pipe" else os.openpty()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    yield write
    os.close(read)
    os.close(write)
