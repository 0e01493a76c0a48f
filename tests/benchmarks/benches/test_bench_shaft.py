"""The measurements of shaft culling: small, but with the papers' findings in them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import office_table
from benchmarks.benches import shaft


@pytest.fixture(scope="module")
def table() -> dict[tuple[str, str], office_table.Row]:
    rows = office_table.table_1_rows(spacing=0.5, rounds=1, say=lambda _: None)
    assert len(rows) == 16
    return {(row["scene"], row["strategy"]): row for row in rows}


def test_table_1_has_the_papers_findings(table: dict[tuple[str, str], office_table.Row]) -> None:
    def tests(scene: str, strategy: str) -> float:
        return float(table[scene, strategy]["tests/ray"])

    for scene in office_table.OFFICES:
        assert tests(scene, "keep closed") < 0.7 * tests(scene, "baseline")  # always some gain
        assert tests(scene, "ratio open 0.4") <= tests(scene, "keep closed")
        assert tests(scene, "ratio open 0.4") < 0.6 * tests(scene, "baseline")  # the best in tests
    # Wide shafts lose by opening all boxes, narrow ones gain.
    assert tests("office", "always open") > tests("office", "baseline")
    assert tests("office-premesh", "always open") < 0.5 * tests("office-premesh", "baseline")
    for row in table.values():
        if row["strategy"] != "baseline":
            assert row["rays/shaft low"] < row["rays/shaft high"]
            assert row["low µs"] > 0


def test_the_papers_numbers_are_beside_ours(table: dict[tuple[str, str], office_table.Row]) -> None:
    assert table["office-premesh", "ratio open 0.8"]["paper tests/ray"] == 21.1


def test_the_cache_and_the_emitter_list_save_tests() -> None:
    for row in office_table.savings_rows(spacing=0.5):
        assert 0.1 < row["cache saves"] < 0.6
        assert 0.02 < row["emitter list saves"] < 0.4
        assert row["cached of blocked"] > 0.5


def test_every_option_is_measured_and_does_something() -> None:
    rows = shaft.option_rows(spacing=1.0, side=2, rounds=1, names=["office"])
    by_name = {row["options"]: row for row in rows}
    assert all(row["ns/ray"] > 0 for row in rows)
    work = ("tests/ray", "shafts", "tests/shaft", "candidates/list", "cached", "free")
    for name, row in by_name.items():
        reference = by_name["best" if name.startswith("best") else "paper"]
        # Sorted planes change no list, only how soon a box is found outside.
        if name not in (
            "best",
            "paper",
            "paper, planes sorted",
            "best, all planes",
            "best, lists of any length",
        ):
            assert any(row[key] != reference[key] for key in work), name
    assert np.ptp([row["blocked"] for row in rows]) < 1e-4, "none of them changes what is visible"


def test_the_report_of_the_options_names_the_quickest(monkeypatch: pytest.MonkeyPatch) -> None:
    def rows(spacing: float, side: int, rounds: int, names: list[str]) -> list[shaft.Row]:
        times = {"best": 1.0, "best, changed": 0.8, "paper": 1.0, "paper, changed": 1.25}
        return [{"scene": names[0], "options": key, "time": time, "blocked": 0.25} for key, time in times.items()]

    monkeypatch.setattr(shaft, "option_rows", rows)
    report = shaft.bench_shaft_options()
    assert report.faults == []
    assert report.measured["best_over_quickest_office"] == 1.25
    assert report.measured["paper_over_quickest_premesh"] == 1.0
    assert len(report.rows) == 8


def test_growth_is_below_proportional() -> None:
    small, large = shaft.growth_rows([1_000, 10_000])
    assert large["polygons"] == 10 * small["polygons"]
    assert 0.05 < small["blocked"] < 0.95
    assert large["tests/ray"] < 8 * small["tests/ray"]


@pytest.mark.evidence  # needs the reference extra
def test_embree_sees_the_same_and_marks_are_named() -> None:
    where = office_table.office("office", spacing=1.0, side=2)
    blocked = shaft._EmbreeRays(where)()
    counts = office_table.shoot(shaft.Visibility(where.occluders, shaft.BEST, threads=1), where)()
    assert abs(blocked - counts.blocked) < 2e-3 * counts.rays  # of 32 bits, other distances from the ends
    rows = [
        {"scene": "office", "program": p, "times ours": 2.0, "blocked": 0.25}
        for p in ("shafts, 1 thread", "baseline, 1 thread", "Embree, 1 thread", "Embree, 2 processes")
    ]
    marks = {"vs_baseline_office", "vs_embree_1_office", "vs_embree_all_office"}
    assert set(shaft.measured(rows)) == marks | {"blocked_off_ours", "blocked_off_embree"}


def test_a_small_bench_measures_what_it_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a stand-in for the peers, whose processes take long to start."""
    said: list[str] = []

    def peers(spacing: float, rounds: int, say: shaft.Say) -> list[shaft.Row]:
        say("embreex cannot be imported")
        programs = {"shafts, 1 thread": 1.0, "shafts, 2 threads": 0.5, "baseline, 1 thread": 3.0}
        if rounds == 2:
            programs |= {"Embree, 1 thread": 2.0, "Embree, 2 processes": 0.9}
        return [
            {"scene": scene, "program": program, "million/s": 1 / time, "times ours": time, "blocked": 0.25}
            for scene in office_table.OFFICES
            for program, time in programs.items()
        ]

    monkeypatch.setattr(shaft, "peer_rows", peers)
    alone = shaft.bench_shaft(scale=0.001, rounds=1, say=said.append)
    assert (alone.holds, alone.measured["vs_baseline_premesh"]) == (None, 3.0)
    assert alone.notes[0] == "without Embree: embreex cannot be imported"
    assert "growth: 1,000,000 polygons" in said
    report = shaft.bench_shaft(scale=0.001, rounds=2)
    assert report.holds is False  # for want of what is above 1 in all processes
    assert {f"growth_ns_{n}" for n in shaft.SIZES} < set(report.measured)
    assert {condition.left for condition in shaft.RULE} < set(report.measured)
    assert report.measured["million_samples_s_all_office"] == 2.0
    assert [row["polygons"] for row in report.rows[-4:]] == [100, 100, 100, 1000]
