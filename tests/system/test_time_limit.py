"""A time limit counts from the start of the command, and ends what it can before there is a result."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest

from glpath.errors import TimeLimitError
from glpath.system import time_limit
from glpath.system.time_limit import (
    GRACE,
    check_time,
    count_earlier,
    counted_from,
    lift_limit,
    limited,
    part_of_time,
    seconds_left,
    time_is_up,
    without_limit,
)
from tests.support.clock import Clock


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_without_a_limit_time_is_never_up(clock: Clock) -> None:
    clock.ahead = 1e9
    with limited(None):
        check_time("waiting")
        assert not time_is_up()
        assert seconds_left() == float("inf")


def test_what_must_be_done_has_a_second_more(clock: Clock) -> None:
    with limited(2.0):
        clock.ahead = 1.9
        assert not time_is_up()
        clock.ahead = 2.0 + 0.9 * GRACE
        assert time_is_up()
        check_time("building the BVH")
        clock.ahead = 2.0 + 1.1 * GRACE
        with pytest.raises(TimeLimitError, match="time_limit=2: over while building the BVH"):
            check_time("building the BVH")
    check_time("what comes later")


def test_a_single_call_that_ends_too_late_is_not_begun(clock: Clock) -> None:
    with limited(10.0):
        clock.ahead = 4.0
        check_time("reading a.png", 6.0 + 0.9 * GRACE)
        with pytest.raises(TimeLimitError, match=r"time_limit=10: reading a.png would take about 7.1 s, more than"):
            check_time("reading a.png", 6.0 + 1.1 * GRACE)
    check_time("reading a.png", 1e9)


def test_what_may_be_left_out_has_half_of_the_time_that_is_left(clock: Clock) -> None:
    with limited(10.0):
        clock.ahead = 2.0
        with part_of_time():
            assert seconds_left() == pytest.approx(4.0)
            clock.ahead = 6.1
            with pytest.raises(TimeLimitError):
                check_time("solving radiosity")
        assert seconds_left() == pytest.approx(3.9)
        check_time("compiling shaders")


def test_what_may_be_cut_short_alone_has_the_whole_time_to_begin(clock: Clock) -> None:
    with limited(10.0), part_of_time(required=True):
        clock.ahead = 5.1
        assert time_is_up()
        clock.ahead = 10.9
        check_time("solving radiosity")
        clock.ahead = 11.1
        with pytest.raises(TimeLimitError):
            check_time("solving radiosity")


def test_the_outermost_limit_holds_but_for_a_frame_s_own(clock: Clock) -> None:
    with limited(10.0):
        clock.ahead = 4.0
        with limited(100.0):
            assert seconds_left() == pytest.approx(6.0)
        with limited(100.0, anew=True):
            assert seconds_left() == pytest.approx(100.0)


@pytest.mark.parametrize("seconds", [None, 100.0])
def test_time_counts_from_the_call_with_a_limit_and_without(clock: Clock, seconds: float | None) -> None:
    with limited(seconds):
        clock.ahead = 3.0
        with limited(seconds):
            assert counted_from() == pytest.approx(clock.stopped)
        with limited(seconds, anew=True):
            assert counted_from() == pytest.approx(clock.stopped + 3.0)
    assert counted_from() == pytest.approx(clock.stopped + 3.0)


def test_a_limit_holds_within_a_call_without_one(clock: Clock) -> None:
    with limited(None), limited(10.0):
        assert seconds_left() == pytest.approx(10.0)


def test_inner_call_lifts_and_shortens_the_limit_only_for_itself(clock: Clock) -> None:
    with limited(10.0):
        with limited(None):
            lift_limit()
            assert seconds_left() == float("inf")
        with limited(5.0):
            count_earlier(7.0)
            assert seconds_left() == pytest.approx(3.0)
        assert seconds_left() == pytest.approx(10.0)


def test_the_time_of_earlier_runs_counts(clock: Clock) -> None:
    with limited(10.0):
        count_earlier(7.0)
        assert seconds_left() == pytest.approx(3.0)


def test_what_follows_a_result_has_no_limit(clock: Clock) -> None:
    with limited(1.0):
        clock.ahead = 9.0
        with without_limit():
            check_time("making the solution of what was solved")
        lift_limit()
        check_time("denoising")


def test_a_part_of_endless_time_is_endless(clock: Clock) -> None:
    with limited(1.0):
        lift_limit()
        with part_of_time():
            clock.ahead = 1e9
            assert seconds_left() == float("inf")
            check_time("measuring the bias")


def test_a_thread_begins_without_the_limit_of_another(clock: Clock) -> None:
    found: list[float] = []
    with limited(1.0):
        thread = threading.Thread(target=lambda: found.append(seconds_left()))
        thread.start()
        thread.join()
    assert found == [float("inf")]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell when a process began")
def test_a_command_s_limit_counts_from_the_start_of_its_process() -> None:
    code = (
        "import time; time.sleep(0.6)\n"
        "from glpath.system.time_limit import command_clock, limited, seconds_left\n"
        "with command_clock(), limited(100): print(seconds_left())"
    )
    left = float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout)
    assert 0 < left < 99.45


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell when a process began")
def test_waiting_of_a_shell_before_exec_is_not_counted() -> None:
    code = (
        "from glpath.system.time_limit import command_clock, limited, seconds_left\n"
        "with command_clock(), limited(100): print(seconds_left())"
    )
    command = ["bash", "-c", 'sleep 5; exec "$@"', "bash", sys.executable, "-c", code]
    left = float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert 95 < left < 100


def test_a_compilation_ends_between_its_passes(clock: Clock) -> None:
    numba = pytest.importorskip("numba")
    import glpath.system.kernels  # noqa: F401, registers what looks at the time

    made = numba.njit(lambda x: x + 1)
    with limited(1.0):
        clock.ahead = 3.0
        with pytest.raises(TimeLimitError, match="over while compiling kernels"):
            made(1)
    assert made(1) == 2


def test_a_program_s_clock_starts_with_it(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    monkeypatch.setattr(time_limit, "_command_began", clock.stopped - 5.0)
    with limited(7.0):
        assert seconds_left() == pytest.approx(2.0)
