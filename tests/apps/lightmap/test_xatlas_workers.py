"""Atlases are let go when their threads sleep."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from glpath.apps.lightmap import xatlas_workers
from glpath.apps.lightmap.xatlas_workers import atlas_of, until_asleep

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
TASKS = Path("/proc/self/task")
linux = pytest.mark.skipif(not TASKS.exists(), reason="threads are seen on Linux")


@linux
def test_an_atlas_is_let_go_when_its_threads_sleep() -> None:
    xatlas = pytest.importorskip("xatlas", reason="needs the extra bake")
    before = set(TASKS.iterdir())
    for _ in range(20):
        with atlas_of(xatlas) as atlas:
            atlas.add_mesh(CORNERS, FACES)
            atlas.generate()
            faces = atlas[0][1]
        own = set(TASKS.iterdir()) - before
        states = [(path / "stat").read_text().rpartition(")")[2].split()[0] for path in own]
        assert states
        assert set(states) == {"S"}
        assert faces.shape == (2, 3)
        del atlas


@linux
def test_a_thread_that_runs_is_waited_for_but_not_for_long() -> None:
    end = threading.Event()

    def runs() -> None:
        while not end.is_set():
            pass

    runner = threading.Thread(target=runs)
    runner.start()
    start = time.monotonic()
    until_asleep({str(runner.native_id)})
    took = time.monotonic() - start
    end.set()
    runner.join()
    assert took < 5
    start = time.monotonic()
    until_asleep({str(runner.native_id)})  # which is gone
    assert time.monotonic() - start < 0.2


def test_where_threads_cannot_be_seen_it_waits_a_little(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(xatlas_workers, "_TASKS", tmp_path / "none")
    start = time.monotonic()
    until_asleep(set())
    assert time.monotonic() - start >= 0.009
