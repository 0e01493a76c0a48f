"""Daylight coefficients by a cluster: the bits of one process, whatever is lost, and what is refused."""

from __future__ import annotations

import queue
import signal
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from glpath.apps.daylight import cluster as by_workers
from glpath.apps.daylight.checkpoint import DaylightCheckpoint
from glpath.apps.daylight.cluster import DaylightWork
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import DaylightProgress, daylight_coefficients
from glpath.apps.daylight.kept_shards import KeptShards
from glpath.errors import ContextError, ImageError, SceneWarning, UsageError, warn
from glpath.jobs import worker
from glpath.jobs.cluster import Cluster
from tests.apps.daylight.test_merging import AT, QUICK, UP, assert_same, shards_of, veiled
from tests.support.command_line import run

# Few elements are enough here.
pytestmark = pytest.mark.filterwarnings("ignore:.*bias of the reflected light")

pytest.importorskip("distributed")
pytest.importorskip("cryptography")


@pytest.fixture(scope="module")
def workers():
    with Cluster("local:2") as cluster:
        yield cluster


def test_workers_find_the_bits_of_one_process_and_go_on_with_what_is_kept(workers: Cluster, tmp_path: Path) -> None:
    whole = daylight_coefficients(veiled(), AT, UP, **QUICK)
    told: list[DaylightProgress] = []
    found = daylight_coefficients(veiled(), AT, UP, **QUICK, cluster=workers, on_progress=told.append)
    assert found.shard is None
    assert_same(found, whole)
    assert [(each.done, each.total) for each in told if each.stage == "shards"] == [(k, 4) for k in range(5)]

    folder = tmp_path / "dc.npz.part"
    folder.mkdir()
    kept = shards_of(folder, veiled(), 3)
    kept[1].unlink()
    told.clear()
    resumed = daylight_coefficients(
        veiled(), AT, UP, **QUICK, cluster=workers, resume=folder, on_progress=told.append
    )
    assert_same(resumed, whole)
    assert [(each.done, each.total) for each in told] == [(2, 3), (3, 3)]
    assert not folder.exists()


def test_kept_shards_of_other_work_are_refused(workers: Cluster, tmp_path: Path) -> None:
    shards_of(tmp_path, veiled(), 3)
    with pytest.raises(ImageError, match="of another scene, other sensors or settings"):
        daylight_coefficients(veiled(), AT, UP, **QUICK | {"seed": 1}, cluster=workers, resume=tmp_path)
    file = tmp_path / "words"
    file.write_bytes(b"words")
    with pytest.raises(ImageError, match="where a cluster keeps a folder of shards"):
        daylight_coefficients(veiled(), AT, UP, **QUICK, cluster=workers, resume=file)
    with pytest.raises(UsageError, match="cluster: makes shards itself"):
        daylight_coefficients(veiled(), AT, UP, **QUICK, cluster=workers, shard=(1, 2))


def test_the_command_shares_sensors_out(tmp_path: Path) -> None:
    rows = "\n".join(",".join(f"{value:.6f}" for value in (*at, 0, 0, 1)) for at in AT)
    (tmp_path / "at.csv").write_text(f"x,y,z,nx,ny,nz\n{rows}\n")
    args = ["daylight", "cornell-box", "--points", str(tmp_path / "at.csv"), "--max-depth", "1", "--samples", "4"]
    for name, more in (("one.npz", []), ("all.npz", ["--cluster", "local:2", "--resume"])):
        done = run(*args, "-o", str(tmp_path / name), *more)
        assert done.exit_code == 0, done.stderr
    one, shared = (DaylightCoefficients.load(tmp_path / name) for name in ("one.npz", "all.npz"))
    assert_same(shared, one)
    assert not (tmp_path / "all.npz.part").exists()
    refused = run(*args, "-o", str(tmp_path / "a.npz"), "--cluster", "local:2", "--shard", "1/2")
    assert refused.exit_code == 2
    assert "--cluster: makes shards itself" in refused.stderr


class KilledWorker(Exception):  # noqa: N818  # Dask's name
    pass


class Played:
    """Stands for a cluster without processes: what comes of each try of each shard."""

    address = "played"

    def __init__(self, outcomes: dict[int, list[Any]]) -> None:
        self.outcomes = outcomes
        self.client = SimpleNamespace(submit=self.submit, cancel=lambda *_, **__: None)

    def submit(self, _: Any, token: str, shard: tuple[int, int], **__: Any) -> Any:
        outcome = self.outcomes[shard[0]].pop(0)

        return Finished(outcome)

    def workers(self) -> list[str]:
        return ["a"]

    def share(self, shared: DaylightWork) -> None:
        pass

    def forget(self, shared: DaylightWork) -> None:
        pass

    def check(self) -> None:
        pass


class Finished:
    """Stands for a future."""

    def __init__(self, outcome: Any) -> None:
        self._outcome = outcome

    def add_done_callback(self, call: Any) -> None:
        call(self)

    def result(self, timeout: float) -> Any:
        if isinstance(self._outcome, Exception):
            raise self._outcome
        return self._outcome if isinstance(self._outcome, tuple) else (self._outcome, [])


def played(outcomes: dict[int, list[Any]], resume: Path | None = None) -> DaylightCoefficients:
    scene: Any = None
    return by_workers.computed_by(
        Played(outcomes),  # type: ignore[arg-type]
        DaylightWork(scene, AT, np.broadcast_to(UP, AT.shape), {}, daylight_coefficients),
        "work",
        None if resume is None else DaylightCheckpoint(resume),
        lambda done, count: None,
    )


def test_a_shard_that_is_lost_is_computed_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    one, two = map(DaylightCoefficients.load, shards_of(tmp_path, veiled(), 2))
    found = played(
        {1: [KilledWorker("x" * 300), one], 2: [ContextError("no device"), ContextError("no device"), two]}
    )
    assert_same(found, daylight_coefficients(veiled(), AT, UP, **QUICK))
    assert "shard 1 of 2: its worker was lost" in caplog.text
    assert "shard 2 of 2: no device" in caplog.text


def test_warnings_of_shards_reach_the_process_that_asks_once(tmp_path: Path) -> None:
    one, two = map(DaylightCoefficients.load, shards_of(tmp_path, veiled(), 2))
    with pytest.warns(SceneWarning, match="odd in a shard") as told:
        played({1: [(one, ["odd in a shard"])], 2: [(two, ["odd in a shard"])]})
    assert len(told) == 1


@pytest.mark.filterwarnings("error::glpath.errors.SceneWarning")
def test_shard_warning_that_a_filter_raises_leaves_the_coefficients(monkeypatch: pytest.MonkeyPatch) -> None:
    def computed(*_: Any) -> str:
        warn("odd in a shard", late=True)
        return "coefficients"

    monkeypatch.setattr(by_workers, "computed_by", computed)
    with pytest.raises(SceneWarning, match="odd in a shard") as caught:
        daylight_coefficients(veiled(), AT, UP, **QUICK, cluster=Cluster.__new__(Cluster))
    assert caught.value.result == "coefficients"


def test_a_worker_collects_the_warnings_of_its_shard() -> None:
    def compute(*_: Any, **__: Any) -> Any:
        warn("odd in a shard")
        warnings.warn("of a library", RuntimeWarning, stacklevel=1)
        return "coefficients"

    scene: Any = None
    worker.hold(DaylightWork(scene, AT, np.broadcast_to(UP, AT.shape), {}, compute, "token"))
    try:
        with pytest.warns(RuntimeWarning, match="of a library"):
            assert by_workers.compute_shard("token", (1, 2)) == ("coefficients", ["odd in a shard"])
    finally:
        worker.let_go("token")


def test_what_fails_everywhere_ends_it_and_the_rest_is_kept(tmp_path: Path) -> None:
    one, _ = map(DaylightCoefficients.load, shards_of(tmp_path, veiled(), 2))
    with pytest.raises(ContextError, match="shard 2 of 2 failed 3 times: no device"):
        played({1: [one], 2: [ContextError("no device")] * 3}, tmp_path / "kept")
    assert one.shard is not None
    kept = KeptShards(tmp_path / "kept", one.shard.work, 7, 9)
    assert kept.count == 2
    assert list(kept.read()) == [1]
    with pytest.raises(UsageError, match="a mistake"):
        played({1: [UsageError("a mistake")], 2: [one]})


def test_shard_that_a_full_disk_refuses_does_not_end_the_computation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise ImageError("a shard: cannot be written: No space left on device.")

    one, two = map(DaylightCoefficients.load, shards_of(tmp_path, veiled(), 2))
    save = DaylightCoefficients.save
    monkeypatch.setattr(DaylightCoefficients, "save", full)
    found = played({1: [one], 2: [two]}, tmp_path / "kept")
    assert found.shard is None
    assert caplog.text.count("No space left on device; the computation continues") == 1

    def only_elsewhere(part: DaylightCoefficients, path: Path) -> None:
        save(part, path) if tmp_path / "kept" not in path.parents else full()

    monkeypatch.setattr(DaylightCoefficients, "save", only_elsewhere)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ContextError):
        played({1: [one], 2: [ContextError("no device")] * 3}, tmp_path / "kept")
    (rescued,) = tmp_path.glob("glpath-*/1-of-2.npz")
    assert f"What is done is kept in {rescued}; move it to the checkpoint's path to resume." in caplog.text
    assert DaylightCoefficients.load(rescued).shard == one.shard


def test_signal_during_the_last_shard_ends_the_computation() -> None:
    cluster: Any = Played({1: [DaylightCoefficients.__new__(DaylightCoefficients)]})
    shared: Any = SimpleNamespace(token="0" * 8)
    shards = by_workers._Shards(cluster, shared, 1, [1]).come()
    assert next(shards)[0] == 1
    signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        next(shards)


def test_no_worker_for_long_is_told(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(by_workers, "_SILENCE_S", 0.0)
    cluster = Played({1: [None]})
    cluster.workers = list  # type: ignore[method-assign]
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    shards = by_workers._Shards(cluster, SimpleNamespace(token="0" * 8), 1, [])  # type: ignore[arg-type]
    shards._running, shards._done = {object(): 1}, done
    cluster.check = lambda: None if not caplog.text else (_ for _ in ()).throw(ContextError("over"))  # type: ignore[method-assign]
    with pytest.raises(ContextError, match="over"):
        next(shards.come())
    assert "no worker is there; waiting for one" in caplog.text
