"""A gather's bias: block means, their sums in a film's metadata, and what is found of a known bias."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
import pytest

import glpath
from glpath.compare.picture import Picture
from glpath.compare.statistical import stat
from glpath.errors import ContextError, ImageError
from glpath.film.bias import BLOCKS, UNBIASED, bias_of, block_means, summed
from glpath.film.film import Film
from glpath.film.metadata import merged_values

GATHER = {"integrator": "gather", "spp": 16, "resolution": (40, 30)}


def test_block_means_are_those_of_the_pixels() -> None:
    picture = np.random.default_rng(1).random((24, 48, 3))
    whole = picture.reshape(BLOCKS, 3, BLOCKS, 6, 3).mean(axis=(1, 3, 4))
    assert np.allclose(block_means(picture), whole)
    assert np.allclose(block_means(picture, 0.5), picture[:, 12:36].reshape(8, 3, 8, 3, 3).mean(axis=(1, 3, 4)))
    ramp = np.broadcast_to((np.arange(10) + 0.5)[None, :, None], (7, 10, 3))
    fine = np.repeat(ramp[0, :, 0], 4).reshape(BLOCKS, 5).mean(axis=1)
    assert np.allclose(block_means(ramp)[0], fine), "a pixel in two blocks counts in both by its parts"


def test_a_known_bias_is_found_and_noise_is_none() -> None:
    random = np.random.default_rng(2)
    light = 0.5 + random.random((40, 40, 3))

    def noisy(count: int) -> np.ndarray:
        return count * light + np.sqrt(count) * 0.3 * random.standard_normal(light.shape)

    unbiased = summed([block_means(noisy(1)) for _ in range(32)], 1.0)
    counts = np.full(8, 8)
    sums = np.stack([noisy(8) for _ in counts])
    right = bias_of(sums, counts, unbiased)
    wrong = bias_of(1.05 * sums, counts, unbiased)
    assert right is not None
    assert wrong is not None
    assert abs(right.mean) < 4 * right.mean_error < 0.02
    assert right.blocks < 0.02
    assert wrong.mean == pytest.approx(0.05, abs=4 * wrong.mean_error)
    assert wrong.blocks == pytest.approx(0.05, rel=0.3)


def test_a_film_of_a_gather_keeps_what_unbiased_paths_found(tmp_path) -> None:
    film = glpath.render("cornell-box-36", **GATHER)
    bias = film.bias()
    assert bias is not None
    assert abs(bias.mean) < 4 * bias.mean_error
    assert bias.mean_error < 0.02
    film.save(tmp_path / "a.npz")
    assert Film.load(tmp_path / "a.npz").bias() == bias
    more = glpath.render("cornell-box-36", first_path_set=16, **GATHER)
    merged = film.merge(more)
    assert merged.metadata.statistics[UNBIASED]["sets"] == 32
    assert merged.bias().mean_error < bias.mean_error


def test_a_solution_that_is_wrong_is_a_bias() -> None:
    """Beside unbiased paths, which take it as their guide, and whose mean it does not move."""
    scene = glpath.load_scene("cornell-box-36")
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=200, particles=1 << 15)
    twice = replace(solution, elements=2.0 * solution.elements, vertices=2.0 * solution.vertices)
    bias = glpath.render(scene, radiosity=twice, **GATHER).bias()
    assert bias is not None
    assert bias.mean > 0.1 > 5 * bias.mean_error
    assert bias.blocks > 0.1


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "path", "max_depth": 3},
        {"integrator": "gather", "crop": (0, 0, 20, 30)},
        {"integrator": "gather", "cast": "path-buffer"},
        {"integrator": "gather", "spp": 8},
    ],
)
def test_where_there_is_none_or_it_is_not_known(options) -> None:
    assert glpath.render("cornell-box-36", **{**GATHER, **options}).bias() is None


def test_lists_of_statistics_add_up() -> None:
    assert merged_values({"a": [1, 2.5]}, {"a": [3, 4]}) == {"a": [4, 6.5]}


@pytest.mark.parametrize("wrong", [3, {"sets": 1}, {"sets": 2, "across_sum": 2, "sum": [1.0], "square": [1.0]}])
def test_a_file_with_another_description_is_refused(tmp_path, wrong) -> None:
    film = glpath.render("cornell-box-36", **GATHER)
    object.__setattr__(film.metadata, "statistics", {UNBIASED: wrong})
    film.save(tmp_path / "a.npz")
    with pytest.raises(ImageError, match="unbiased paths are"):
        Film.load(tmp_path / "a.npz")


def test_a_comparison_by_noise_names_the_bias_of_a_gather() -> None:
    """Two engines may differ by it alone; a failed comparison says how much that is."""
    scene = glpath.load_scene("cornell-box-36")
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=200, particles=1 << 15)
    twice = replace(solution, elements=2.0 * solution.elements, vertices=2.0 * solution.vertices)
    gathered = Picture.of_film(glpath.render(scene, radiosity=twice, **{**GATHER, "spp": 64}))
    traced = Picture.of_film(glpath.render(scene, **{**GATHER, "spp": 64, "integrator": "path"}))
    verdict = stat(gathered, traced)
    assert not verdict.passed
    assert "the picture, of a gather, has a bias of" in verdict.summary
    assert "has a bias" not in stat(traced, traced).summary


def test_an_interrupt_while_the_bias_is_measured_leaves_the_whole_film(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("glpath.rendering.bias.block_means", interrupted)
    with pytest.raises(glpath.rendering.RenderInterrupted) as caught:
        glpath.render("cornell-box-36", **GATHER)
    assert caught.value.film.path_sets == 16
    assert caught.value.film.bias() is None


def test_where_there_is_no_room_beside_the_film_its_bias_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise ContextError("no room")

    monkeypatch.setattr("glpath.rendering.bias.block_means", full)
    film = glpath.render("cornell-box-36", **GATHER)
    assert film.path_sets == 16
    assert film.bias() is None
