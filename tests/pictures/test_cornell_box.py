"""The Cornell box beside Mitsuba 3's converged picture of it, pixel by pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from benchmarks.benches import equal_error
from benchmarks.benches.gather import bench_gather
from benchmarks.benches.path_buffer import bench_path_buffer
from glpath.compare import mean_ratio, relative_mse
from glpath.errors import GlpathError
from glpath.film.film import read_image
from tests.support.engines import engine_options
from tests.support.repository import ROOT

REFERENCE = ROOT / "benchmarks" / "references" / "cornell-box-36-depth3.npz"
ALL_BOUNCES = REFERENCE.with_name("cornell-box-36-depth64.npz")


@pytest.fixture(scope="module")
def mitsuba() -> NDArray[np.float64]:
    return read_image(REFERENCE)


@pytest.mark.parametrize(
    ("engine", "error", "lost"),
    # Crowding is weighed up, but it costs: a change that loses more is a change for the worse.
    [("path", 6e-4, 0.0), ("pair", 1.2e-3, 0.04)],
)
def test_128_path_sets_are_near_mitsuba(
    engine: Any, error: float, lost: float, mitsuba: NDArray[np.float64]
) -> None:
    film = glpath.render("cornell-box-36", spp=128, max_depth=3, **engine_options(engine))
    assert relative_mse(film.mean, mitsuba) <= error
    assert mean_ratio(film.mean, mitsuba) == pytest.approx(1.0, abs=0.003)
    statistics = film.metadata.statistics  # which names what is lost where rays can lose their cell to others alone
    assert statistics.get("paths_lost", 0) <= lost * statistics["paths_cast"]


@pytest.mark.parametrize(
    ("patches", "sets", "error"),
    [
        (300, 128, 4e-4),
        *(pytest.param(*case, marks=pytest.mark.evidence) for case in ((300, 512, 1.5e-4), (1000, 128, 4e-4))),
    ],
)
def test_a_gather_from_a_coarse_solution_has_all_of_mitsubas_bounces(patches: int, sets: int, error: float) -> None:
    """The mean within 1 % is asked for; measured: 0.1 %. Looked up whole, 128 sets have 1.4e-3 and 9e-4."""
    solution = glpath.solve_radiosity("cornell-box-36", patches=patches)
    film = glpath.render("cornell-box-36", integrator="gather", radiosity=solution, spp=sets)
    truth = read_image(ALL_BOUNCES)
    assert relative_mse(film.mean, truth) <= error
    assert mean_ratio(film.mean, truth) == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    "crop",
    [
        pytest.param((112, 208, 80, 40), id="foot-of-the-short-block"),
        pytest.param((0, 0, 256, 256), id="all", marks=pytest.mark.evidence),
    ],
)
def test_no_block_of_a_gather_shows_its_elements(crop: tuple[int, int, int, int]) -> None:
    """Within 6 % is asked for, where light is more than 2 % of the mean; 11 % with one further vertex."""
    solution = glpath.solve_radiosity("cornell-box-36", patches=500)  # 394 elements
    film = glpath.render("cornell-box-36", integrator="gather", radiosity=solution, spp=1024, crop=crop)
    x, y, width, height = crop
    truth = read_image(ALL_BOUNCES)
    theirs = _block_means(truth[y : y + height, x : x + width])
    off = np.abs(_block_means(film.mean) / theirs - 1)
    assert off[theirs > 0.02 * truth.mean()].max() <= 0.06


def _block_means(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    height, width = picture.shape[:2]
    return np.asarray(picture.reshape(height // 8, 8, width // 8, 8, 3).mean(axis=(1, 3, 4)))


@pytest.mark.evidence
def test_1024_path_sets_are_within_1e_4_of_mitsuba(mitsuba: NDArray[np.float64]) -> None:
    film = glpath.render("cornell-box-36", spp=1024, max_depth=3)
    assert relative_mse(film.mean, mitsuba) <= 1e-4
    assert mean_ratio(film.mean, mitsuba) == pytest.approx(1.0, abs=0.003)


@pytest.fixture
def mitsuba_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other peer: Cycles and Radiance take two thirds of a bench, and `test_bench_peers.py` is about them."""

    def left_out(*_: object) -> None:
        raise GlpathError("not asked here")

    monkeypatch.setattr(equal_error, "cycles", left_out)
    monkeypatch.setattr(equal_error.radiance_peer, "render", left_out)


@pytest.mark.evidence
@pytest.mark.timed
@pytest.mark.usefixtures("mitsuba_alone")
def test_the_bench_compares_with_mitsuba_in_one_run() -> None:
    report = bench_path_buffer(seeds=2)
    assert report.holds is (report.measured["vs_mitsuba"] >= 0.5)
    # Measured: 0.25 to 0.64 on one machine, by how much of its caches others take: so it was for the tree before.
    # Below that something has become slower; the mark itself is the bench's to say.
    assert report.measured["vs_mitsuba"] > 0.2


@pytest.mark.evidence
@pytest.mark.timed
@pytest.mark.usefixtures("mitsuba_alone")
def test_the_gather_is_ahead_of_path_tracing_and_of_mitsuba() -> None:
    """Its solver included, to 1e-3 with all bounces. Measured: 7 and 5 times."""
    measured = (report := bench_gather(seeds=1)).measured
    assert report.holds
    assert measured["gather_s"] > measured["solver_s"]
    assert measured["vs_mitsuba"] == pytest.approx(measured["mitsuba_s"] / measured["gather_s"])
    assert measured["vs_path"] == pytest.approx(measured["path_s"] / measured["gather_s"])
