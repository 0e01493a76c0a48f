"""`bench lightmap`: what it measures without Cycles, how it judges, and that Cycles bakes the same light."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.benches import lightmap
from benchmarks.benches.lightmap import LEVEL, Bakes, bench_lightmap, compared, weights
from benchmarks.peers import cycles as cycles_peer
from benchmarks.peers import other_python
from glpath.errors import GlpathError

pytest.importorskip("xatlas")


def played(level: float, noise: float, seconds_each: float, seed: int) -> Bakes:
    """A program that finds so much light everywhere, whose noise falls as that of Monte Carlo."""
    random = np.random.default_rng(seed)

    def draw(spp: int, _: int) -> tuple[float, np.ndarray]:
        page = level + noise / np.sqrt(spp) * random.standard_normal((64, 64, 1))
        return 1.0 + seconds_each * spp, np.repeat(page, 3, axis=2)

    bakes = Bakes((4, 16), draw)
    for turn in range(3):
        bakes.run(turn)
    return bakes


def test_times_are_to_an_error_that_is_the_same_for_all() -> None:
    where = np.ones((64, 64), bool)
    programs = {
        "path": played(2.0, 1.0, 0.1, 1),
        "gather": played(2.0, 0.5, 0.1, 2),
        "cycles": played(2.0, 1.0, 1.0, 3),
    }
    numbers, rows = compared(programs, where)
    # Relative to the light and a tenth of its mean; noise of one over the root of the samples.
    samples = (1 / 2.2 / LEVEL) ** 2
    assert numbers["cycles_s"] == pytest.approx(1 + samples, rel=0.05)
    assert numbers["path_s"] == pytest.approx(1 + 0.1 * samples, rel=0.05)
    assert numbers["gather_s"] == pytest.approx(1 + 0.025 * samples, rel=0.05)
    assert numbers["vs_cycles"] == pytest.approx((1 + samples) / (1 + 0.025 * samples), rel=0.05)
    assert rows[0]["noise"] == pytest.approx(0.25 / 2.2, rel=0.05)
    assert rows[2]["s to 20%"] == pytest.approx(1 + samples / 4, rel=0.05)
    assert [row["program"] for row in rows] == ["path", "gather", "cycles"]


def test_what_is_systematic_takes_longer_or_never_gets_there() -> None:
    where = np.ones((64, 64), bool)
    programs = {
        "path": played(2.0, 1.0, 0.1, 1),
        "gather": played(2.2, 0.1, 0.1, 2),
        "cycles": played(2.0, 1.0, 1.0, 3),
    }
    numbers, rows = compared(programs, where)
    assert rows[1]["systematic"] == pytest.approx(0.2 / 2.2, rel=0.1)
    assert numbers["gather_off"] == pytest.approx(0.1, rel=0.05)
    assert np.isfinite(numbers["gather_s"])
    programs["gather"] = played(3.0, 0.1, 0.1, 2)
    numbers, _ = compared(programs, where)
    assert np.isnan(numbers["gather_s"])
    assert numbers["vs_cycles"] == pytest.approx(numbers["cycles_s"] / numbers["path_s"]), "by path tracing alone"


def test_weights_make_errors_relative_and_leave_gutters_out() -> None:
    where = np.zeros((40, 40), bool)
    where[5:30, 5:30] = True
    page = np.where(where, 3.0, np.nan_to_num(1e6))
    assert np.sum(weights(page, where)) == pytest.approx(1 / 3.3**2)


def test_a_small_bench_without_cycles_measures_and_claims_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str, interpreter: str) -> tuple[str, str]:
        raise GlpathError(f"{name} is not installed for {interpreter}; it is needed only as a peer.")

    monkeypatch.setattr(other_python, "find_package", nothing)
    monkeypatch.setattr(lightmap, "SIZES", {512: {"path": (8, 32), "gather": (8, 32)}})
    report = bench_lightmap(0.125)
    assert report.holds is None
    assert report.faults == []
    assert report.measured["gather_off_512"] < 0.02
    assert report.measured["MiB_512"] > 0
    assert [row["program"] for row in report.rows] == ["path", "gather"]
    assert all(0 < row["noise"] < 1 for row in report.rows)
    assert any(note.startswith("without Cycles") for note in report.notes)


@pytest.mark.evidence
def test_cycles_bakes_the_same_light(monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        cycles_peer.version()
    except GlpathError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(lightmap, "SIZES", {1024: {"path": (4, 16), "gather": (4, 16), "cycles": (4, 64)}})
    report = bench_lightmap(0.125)
    assert report.measured["cycles_off_1024"] < 0.02
    (row,) = [row for row in report.rows if row["program"] == "cycles"]
    assert row["systematic"] < 0.05, "texel by texel, not only on average"
    assert report.measured["cycles_MiB_1024"] > 50
    assert np.isfinite(report.measured["vs_cycles_1024"])
