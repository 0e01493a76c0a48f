"""Stop rules: a render ends by time or by noise with the bits of one of so many path sets, and says so honestly."""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from glpath.compare import relative_mse
from glpath.film.aovs import DENOISER_AOVS
from glpath.film.batches import BATCHES, BLOCK
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from glpath.film.noise import error_bound
from glpath.rendering.run_options import RunOptions
from glpath.rendering.stopping import looked_at
from tests.support.engines import with_depth
from tests.support.killing import SMALL

BOX = "cornell-box-36"
TINY: dict[str, Any] = {"resolution": (20, 16), "max_depth": 2}


def render(*arguments: object) -> Result:
    return CliRunner().invoke(glpath_app(), ["render", *map(str, (*SMALL, *arguments))])


def glpath_app() -> Any:
    from glpath.cli.main import app

    return app


@pytest.mark.parametrize("options", [{}, {"integrator": "path-buffer", "sampling": "random"}])
def test_by_noise_it_has_the_bits_of_as_many_path_sets(options: dict[str, Any]) -> None:
    film = glpath.render(BOX, noise=0.1, **TINY, **options)
    m = film.metadata
    assert m.stop_rule == "noise"
    assert m.error_bound == film.error_bound()
    assert m.error_bound is not None
    assert m.error_bound <= 0.1
    assert looked_at(RunOptions(noise=0.1), film.path_sets)
    whole = glpath.render(BOX, spp=film.path_sets, **TINY, **options)
    assert np.array_equal(film.radiance_sums, whole.radiance_sums)
    assert whole.metadata.stop_rule == "spp"
    assert whole.metadata.error_bound is None
    assert glpath.render(BOX, noise=0.1, **TINY, **options).path_sets == film.path_sets


def test_gone_on_with_it_ends_where_one_go_ends() -> None:
    whole = glpath.render(BOX, noise=0.08, **TINY)
    begun = glpath.render(BOX, spp=13, **TINY)
    film = glpath.render(BOX, noise=0.08, film=begun, **TINY)
    assert np.array_equal(film.radiance_sums, whole.radiance_sums)
    again = glpath.render(BOX, noise=0.08, film=film, **TINY)
    assert (again.path_sets, again.metadata.stop_rule) == (whole.path_sets, "noise")


def test_by_time_it_has_the_bits_of_as_many_path_sets() -> None:
    film = glpath.render(BOX, time_limit=0.5, **TINY)
    m = film.metadata
    assert m.stop_rule == "time limit"
    assert 0.5 <= m.elapsed_s < 20
    whole = glpath.render(BOX, spp=film.path_sets, **TINY)
    assert np.array_equal(film.radiance_sums, whole.radiance_sums)
    # The time before counts.
    again = glpath.render(BOX, time_limit=0.5, film=film, **TINY)
    assert again.path_sets == whole.path_sets


def test_whichever_comes_first() -> None:
    assert glpath.render(BOX, time_limit=1e-6, noise=1e-9, spp=64, **TINY).path_sets >= 1
    for rules, ended in (
        ({"time_limit": 1e-6, "noise": 1e-9}, "time limit"),
        ({"time_limit": 1e6, "noise": 1e-9}, "spp"),
        ({"time_limit": 1e6, "noise": 10.0}, "noise"),
    ):
        film = glpath.render(BOX, spp=64, **rules, **TINY)
        assert film.metadata.stop_rule == ended
    assert film.path_sets == 4 * BLOCK, "the first count that is looked at"


def test_the_total_that_is_told_is_what_the_rules_let_expect() -> None:
    seen: list[glpath.Progress] = []
    film = glpath.render(BOX, time_limit=1.5, on_progress=seen.append, **TINY)
    assert (seen[-1].done, seen[-1].total) == (film.path_sets, film.path_sets)
    assert all(progress.total < 10**6 for progress in seen if progress.done)
    assert all(progress.done < progress.total for progress in seen[:-1])


def test_looks_are_few_and_follow_from_the_count_alone() -> None:
    counts = range(BLOCK, 20_000, BLOCK)
    looks = [n for n in counts if looked_at(RunOptions(noise=0.1), n)]
    assert looks[:5] == [32, 40, 48, 56, 64]
    assert all(b - a <= max(BLOCK, a / 7) for a, b in pairwise(looks))
    assert len(looks) < 100
    # Each look denoises two halves.
    looks = [n for n in counts if looked_at(RunOptions(clean=0.1), n)]
    assert looks[:6] == [16, 24, 32, 48, 64, 96]
    assert all(b - a <= a / 2 for a, b in pairwise(looks))
    assert not any(looked_at(RunOptions(), n) for n in counts)


@pytest.mark.parametrize(
    "rules", [{"noise": 0.0}, {"noise": float("nan")}, {"noise": True}, {"clean": 0}, {"clean": "0.1"}]
)
def test_rules_that_cannot_be_are_refused(rules: dict[str, float]) -> None:
    with pytest.raises(glpath.UsageError, match="a number above 0 is needed"):
        RunOptions(**rules)


def test_the_command_line_says_what_ended_it_and_how_good_it_is(tmp_path: Path) -> None:
    result = render("-o", tmp_path / "a.npz", "--noise", "0.1", "--stats", tmp_path / "s.json")
    assert result.exit_code == 0, result.stderr
    film = Film.load(tmp_path / "a.npz")
    assert film.metadata.stop_rule == "noise"
    assert "at 95 % confidence it is below " in result.stderr
    assert "; so it ended" in result.stderr
    stats = json.loads((tmp_path / "s.json").read_text())
    assert (stats["stop_rule"], stats["error_bound"]) == ("noise", film.metadata.error_bound)
    result = render("-o", tmp_path / "b.npz", "--time-limit", "0.3s", "--progress", "json")
    done = json.loads(result.stderr.splitlines()[-1])
    assert (done["event"], done["stop_rule"]) == ("done", "time limit")


# Ended when it looks clean.


def test_a_picture_ends_when_it_looks_clean_with_the_bits_of_as_many_path_sets() -> None:
    pytest.importorskip("pyoidn", reason="needs the denoise extra")
    options: dict[str, Any] = {**TINY, "aovs": DENOISER_AOVS}
    film = glpath.render(BOX, clean=0.05, **options)
    m = film.metadata
    assert (m.stop_rule, m.error_bound) == ("clean", film.denoised_noise())
    assert m.error_bound is not None
    assert m.error_bound <= 0.05
    assert looked_at(RunOptions(clean=0.05), film.path_sets)
    assert film.path_sets > 2 * BLOCK, "else a look at one count is all that is tested"
    whole = glpath.render(BOX, spp=film.path_sets, **options)
    assert np.array_equal(film.radiance_sums, whole.radiance_sums)
    # Stopped before, it continues to the same end.
    begun = glpath.render(BOX, spp=13, **options)
    again = glpath.render(BOX, clean=0.05, film=begun, **options)
    assert np.array_equal(again.radiance_sums, whole.radiance_sums)
    # A look at any count before would have said otherwise.
    fewer = [n for n in range(BLOCK, film.path_sets, BLOCK) if looked_at(RunOptions(clean=0.05), n)]
    less = glpath.render(BOX, spp=fewer[-1], **options).denoised_noise()
    assert less is not None
    assert less > 0.05


def test_of_few_path_sets_no_picture_is_called_clean() -> None:
    """Of one block there are no two halves, and of few sets both halves may have the same blotches."""
    pytest.importorskip("pyoidn", reason="needs the denoise extra")
    film = glpath.render(BOX, clean=100.0, aovs=DENOISER_AOVS, **TINY)
    assert (film.path_sets, film.metadata.stop_rule) == (2 * BLOCK, "clean")
    assert glpath.render(BOX, clean=100.0, spp=9, aovs=DENOISER_AOVS, **TINY).metadata.stop_rule == "spp"


def test_what_cannot_be_denoised_cannot_end_when_it_is_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(glpath.UsageError, match="clean: of a film without the AOVs albedo and normal"):
        glpath.render(BOX, clean=0.05, **TINY)
    with pytest.raises(glpath.UsageError, match="clean beside noise"):
        glpath.render(BOX, clean=0.05, noise=0.05, aovs=DENOISER_AOVS, **TINY)
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(glpath.GlpathError, match=r'pip install "glpath\[denoise\]"'):
        glpath.render(BOX, clean=0.05, aovs=DENOISER_AOVS, **TINY)


def test_the_command_line_ends_when_it_looks_clean(tmp_path: Path) -> None:
    pytest.importorskip("pyoidn", reason="needs the denoise extra")
    result = render("-o", tmp_path / "a.png", "-o", tmp_path / "a.npz", "--clean", "0.2")
    assert result.exit_code == 0, result.stderr
    film = Film.load(tmp_path / "a.npz")
    assert film.metadata.stop_rule == "clean"
    assert "denoised by Open Image Denoise, then error about" in result.stderr
    assert ", which is clean" in result.stderr
    result = render("-o", tmp_path / "b.npz", "--clean", "0.2")
    assert result.exit_code == 0, result.stderr  # by what it would look like
    assert Film.load(tmp_path / "b.npz").path_sets == film.path_sets
    ray_traced = ("three-spheres", "-o", str(tmp_path / "a.png"), "--clean", "0.2")
    result = CliRunner().invoke(glpath_app(), ["render", *ray_traced])
    assert (result.exit_code, "--clean with --integrator t-buffer" in result.stderr) == (2, True)
    result = render("-o", tmp_path / "a.png", "--clean", "0.2", "--noise", "0.1")
    assert (result.exit_code, "clean beside noise" in result.stderr) == (2, True)
    result = render("-o", tmp_path / "a.png", "--clean", "0")
    assert (result.exit_code, "--clean 0: must be above 0" in result.stderr) == (2, True)


# How honest the bound is.


def synthetic(seed: int, independent: int, pixels: int = 300) -> tuple[float, float]:
    """The error of an image of path sets of known mean, and the bound; so many independent errors in it."""
    random = np.random.default_rng(seed)
    mean = random.uniform(0.5, 1.5, pixels)
    spread = random.normal(0, 0.3, (BATCHES * BLOCK, independent)) @ random.normal(0, 1, (independent, pixels))
    values = mean + spread / independent**0.5
    sums = values.reshape(BATCHES, BLOCK, pixels).sum(axis=1).reshape(BATCHES, 10, pixels // 30, 3)
    error = values.mean(axis=0) - mean
    true = float(np.sqrt(np.mean(error**2 / (mean**2 + 0.01))))
    return true, error_bound(sums, np.full(BATCHES, BLOCK), 0.95)


@pytest.mark.parametrize("independent", [1, 4, 300])
def test_the_bound_holds_whether_pixels_err_together_or_not(independent: int) -> None:
    found = np.array([synthetic(seed, independent) for seed in range(300)])
    within = (found[:, 0] <= found[:, 1]).mean()
    assert within >= 0.93
    # It is no wider than it has to be: one error alone is known to a factor, many are known well.
    assert np.median(found[:, 1] / found[:, 0]) < {1: 6, 4: 2.5, 300: 1.3}[independent]


def test_a_film_of_few_batches_has_no_bound_and_a_black_one_no_error() -> None:
    film = Film.empty(FilmMetadata("black", "0", "path", 0, 5, {}, (6, 4), (0, 0, 6, 4)))
    for i in range(4):
        assert film.error_bound() is None
        film.add(8 * i, 8 * i + 8, np.zeros((4, 6, 3)))
    assert film.error_bound() == 0


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("options", "noise"),
    [
        ({"sampling": "sobol"}, 0.06),
        ({"sampling": "random"}, 0.06),
        ({"sampling": "sobol", "integrator": "path-buffer"}, 0.08),
        ({"integrator": "gather"}, 0.04),
    ],
)
def test_in_95_of_100_renders_the_error_is_below_the_noise_asked_for(options: dict[str, Any], noise: float) -> None:
    options = with_depth({"resolution": (20, 16), **options}, 2)
    reference = glpath.render(BOX, spp=4096, seed=999, **options)
    off = reference.relative_error() or 0.0
    below_noise = below_bound = 0
    counts = []
    for seed in range(100):
        film = glpath.render(BOX, noise=noise, seed=seed, **options)
        error = relative_mse(film.mean, reference.mean) ** 0.5
        bound = film.metadata.error_bound
        assert bound is not None
        below_noise += error <= noise
        below_bound += error <= bound
        counts.append(film.path_sets)
    print(
        f"\n{options}: below {noise} in {below_noise} of 100 renders, below the bound in {below_bound}; "
        f"{min(counts)} to {max(counts)} path sets; the reference is off by {off:.2g}"
    )
    assert off < noise / 5
    # Of 100, 95 have a standard deviation of two.
    assert min(below_noise, below_bound) >= 93
