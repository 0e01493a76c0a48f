"""Claims hold by their rule, and the contestants of a timing take turns."""

from __future__ import annotations

import math
import time

import pytest

from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition, judge, machine


@pytest.mark.parametrize(
    ("relation", "right", "expected"),
    [
        (">=", 2, True),
        (">", 2, False),
        ("<=", 2, True),
        ("<", 2, False),
        (">", "small", True),
        ("<", "large", True),
    ],
)
def test_a_condition_compares_with_a_number_or_with_another_measured_one(relation, right, expected) -> None:
    assert Condition("a", relation, right).holds({"a": 2.0, "small": 1.0, "large": 3.0}) is expected


@pytest.mark.parametrize("relation", [">=", "<=", ">", "<"])
def test_no_condition_holds_of_nan(relation) -> None:
    assert not Condition("a", relation, 1.0).holds({"a": math.nan})


def test_a_claim_states_its_rule_and_holds_only_when_all_of_it_does() -> None:
    rule = (Condition("a", ">=", 0.5), Condition("a", "<", "b"))
    assert judge("a is right", rule, {"a": 1.0, "b": 2.0}) == ("a is right (a >= 0.5, a < b)", True)
    assert judge("a is right", rule, {"a": 1.0, "b": 1.0})[1] is False
    assert judge("a is right", rule, {"a": 0.1, "b": 1.0})[1] is False


def test_contestants_take_turns_and_the_median_counts() -> None:
    calls: list[str] = []

    def contestant(name, times):
        def run() -> float:
            calls.append(name)
            return times[calls.count(name) - 1]

        return run

    medians = in_turns({"a": contestant("a", [9.0, 1.0, 2.0]), "b": contestant("b", [5.0, 4.0, 3.0])}, 3)
    assert medians == {"a": 2.0, "b": 4.0}
    assert calls == ["a", "b"] * 3


@pytest.mark.parametrize("least", [1, 3])
def test_no_round_starts_when_there_was_enough_but_the_least_number_does(least: int) -> None:
    calls = []
    in_turns({"a": lambda: calls.append(1) or 0.0}, 5, min_rounds=least, enough_s=0.0)
    assert len(calls) == least


def test_a_time_has_the_context_finished_before_and_after() -> None:
    order: list[str] = []
    seconds = seconds_of(lambda: order.append("work") or time.sleep(0.01), lambda: order.append("finish"))
    assert order == ["finish", "work", "finish"]
    assert 0.01 <= seconds < 1.0


def test_the_machine_is_named() -> None:
    found = machine("llvmpipe")
    assert found["renderer"] == "llvmpipe"
    assert found["cores"] >= 1
    assert isinstance(found["cpu"], str)
