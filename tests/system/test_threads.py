"""Worker threads end their work early when an exception or the time limit ends its block."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

import glpath
from glpath.system.threads import Stop, StoppedError, in_threads, worker_threads
from glpath.system.time_limit import limited, named_work


@pytest.fixture
def stop() -> Stop:
    return np.zeros(1, np.int64)


def until_stopped(stop: Stop) -> bool:
    """Work until the flag is set, for 10 s at most; return whether it was set."""
    ends = time.monotonic() + 10.0
    while not stop[0] and time.monotonic() < ends:
        time.sleep(0.001)
    return bool(stop[0])


def test_an_exception_stops_running_work_and_the_flag_is_cleared(stop: Stop) -> None:
    results = []

    def interrupted() -> None:
        with worker_threads(stop) as pool:
            pool.submit(lambda: results.append(until_stopped(stop)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (results, stop[0]) == ([True], 0)


def test_a_time_limit_stops_running_work(stop: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    with (
        limited(0.05),
        pytest.raises(glpath.TimeLimitError, match="over while casting rays"),
        worker_threads(stop, doing="casting rays") as pool,
    ):
        assert pool.submit(until_stopped, stop).result()
    assert stop[0] == 0


def test_work_in_python_that_a_time_limit_stopped_is_a_time_limit_error(
    stop: Stop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)

    def work() -> None:
        until_stopped(stop)
        raise StoppedError

    with (
        limited(0.05),
        pytest.raises(glpath.TimeLimitError, match="over while casting rays"),
        worker_threads(stop, doing="casting rays") as pool,
    ):
        pool.submit(work).result()


def test_work_does_not_begin_after_the_time_limit(stop: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    with limited(0.001):
        time.sleep(0.01)
        with pytest.raises(glpath.TimeLimitError), worker_threads(stop, doing="casting rays"):
            pytest.fail("the block was entered")


def test_a_wait_that_ends_too_early_does_not_stop_work(stop: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    monkeypatch.setattr("glpath.system.threads.seconds_to_error", lambda doing: 0.0)
    with limited(60.0), worker_threads(stop, doing="casting rays") as pool:
        pool.submit(time.sleep, 0.05).result()
        assert stop[0] == 0


def test_work_without_a_name_has_no_time_limit(stop: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    threads = threading.active_count()
    with limited(0.01), worker_threads(stop) as pool:
        pool.submit(time.sleep, 0.05).result()
        assert stop[0] == 0
    assert threading.active_count() == threads


@pytest.mark.parametrize("count", [1, 5])
def test_ranges_stop_with_the_time_limit(count: int, stop: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    with (
        limited(0.05),
        pytest.raises(glpath.TimeLimitError, match="over while casting rays"),
        named_work("casting rays"),
    ):
        in_threads(count, 2, lambda begin, end: until_stopped(stop), stop)


def test_ranges_cover_everything_once(stop: Stop) -> None:
    counts = np.zeros(7, np.int64)

    def work(begin: int, end: int) -> None:
        counts[begin:end] += 1

    in_threads(7, 3, work, stop)
    in_threads(7, 3, work)
    in_threads(7, 9, work)
    in_threads(0, 9, work, stop)
    assert counts.tolist() == [3] * 7
