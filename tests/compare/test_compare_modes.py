"""Pictures with noise and provenance, and the modes exact, fuzzy and flip. `test_compare_stat` has the fourth."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glpath.compare import (
    BLOCK_SIDE,
    Picture,
    compare,
    default_mode,
    flip_map,
    flip_picture,
    max_difference_pair,
    measures,
    picture_from_bytes,
    picture_of_pillow,
    read_limits,
    read_picture,
)
from glpath.compare.statistical import _known_bias
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.film.exr import read_exr_channels
from glpath.film.image import read_image
from glpath.system.colour import decode_srgb
from tests.conftest import MakeFilm

GREY = np.full((20, 24, 3), 0.5)


def grey_but(x: int, y: int, value: float) -> Picture:
    image = GREY.copy()
    image[y, x] = value
    return Picture.of_array(image)


# ---- what a baseline holds


def test_a_picture_comes_back_from_its_file_with_its_noise(make_film: MakeFilm, tmp_path: Path) -> None:
    film = make_film([(0, 80)], (40, 18))
    picture = Picture.of_film(film)
    picture.save(tmp_path / "a.exr")
    back = Picture.load(tmp_path / "a.exr")
    assert np.array_equal(back.mean, film.mean.astype(np.float32))
    assert np.array_equal(back.noise.variance, film.variance_of_mean().astype(np.float32))
    assert back.noise.batch_counts.tolist() == film.batch_counts.tolist() == [16, 16] + [8] * 6
    assert np.array_equal(back.noise.block_batches, picture.noise.block_batches.astype(np.float32))
    assert back.provenance["glpath.scene"] == "cornell-box"
    assert back.provenance["glpath.path_sets"] == "80"
    assert np.array_equal(read_image(tmp_path / "a.exr"), back.mean)  # any viewer sees the mean
    assert compare(back, picture, "exact").passed
    assert compare(back, picture, "stat").measured["paired"]


def test_block_batches_are_means_over_blocks_also_at_the_borders(make_film: MakeFilm) -> None:
    film = make_film([(0, 64)], (40, 18))
    blocks = Picture.of_film(film).noise.block_batches
    assert blocks.shape == (8, 2, 3, 3)
    means = film.radiance_sums / film.batch_counts[:, None, None, None]
    for j in range(2):
        for i in range(3):
            y, x = j * BLOCK_SIDE, i * BLOCK_SIDE
            expected = means[:, y : y + BLOCK_SIDE, x : x + BLOCK_SIDE].mean(axis=(1, 2))
            assert np.allclose(blocks[:, j, i], expected, rtol=1e-13)


def test_arrays_of_several_forms() -> None:
    assert np.array_equal(Picture.of_array(np.full((2, 3), 0.25)).mean, np.full((2, 3, 3), 0.25))
    assert np.array_equal(Picture.of_array(np.ones((2, 3, 4), np.float32)).mean, np.ones((2, 3, 3)))
    assert Picture.of_array(np.full((2, 3, 3), 188, np.uint8)).mean == pytest.approx(0.5, abs=0.004)
    for wrong in (np.zeros((2, 3, 2)), np.zeros(3), np.zeros((0, 3, 3)), np.full((2, 2), "a")):
        with pytest.raises(ImageError, match="expected"):
            Picture.of_array(wrong)


def test_a_baseline_of_which_a_part_is_missing_is_refused(make_film: MakeFilm, tmp_path: Path) -> None:
    import OpenEXR

    Picture.of_film(make_film([(0, 64)])).save(tmp_path / "a.exr")
    channels, header = read_exr_channels(tmp_path / "a.exr")
    del channels["batch3.G"]
    OpenEXR.File(header, channels).write(str(tmp_path / "b.exr"))
    with pytest.raises(ImageError, match=r"b.exr: is a baseline of which something is missing: 'batch3.G'"):
        Picture.load(tmp_path / "b.exr")


def test_what_was_made_otherwise_is_named(make_film: MakeFilm) -> None:
    a = Picture.of_film(make_film([(0, 64)]))
    settings = {"sampling": "random", "ambient": (0.0, 0.0, 0.0)}
    b = Picture.of_film(make_film([(0, 64)], max_depth=3, scene_hash="other", settings=settings))
    assert a.differences_in_making(a) == []
    assert a.differences_in_making(b) == [
        "the scene's content (geometry, materials, lights or camera) is another one",
        "max_depth is 5 here and 3 in the reference",
        "sampling is sobol here and random in the reference",
    ]
    assert a.differences_in_making(Picture.of_array(a.mean))[0] == "kind is film here and array in the reference"


@pytest.mark.parametrize(
    "text",
    ["", "{", "3", "[]", "null", "[" * 100_000, "9" * 5000, '{"mean": 1}', '{"mean": "a", "mean_error": []}'],
)
def test_damaged_json_in_a_header_is_no_json(make_film: MakeFilm, text: str) -> None:
    right = Picture.of_film(make_film([(0, 64)]))
    header = {"glpath.settings": text, "glpath.bias": text, "glpath.biased": "true"}
    wrong = replace(right, provenance={**right.provenance, **header})
    assert wrong.bias == "has a bias, which was not measured"
    for one, other in ((right, wrong), (wrong, right)):
        assert all(isinstance(difference, str) for difference in one.differences_in_making(other))
    # Another program may write a bias without the name of its engine.
    nameless = {name: value for name, value in wrong.provenance.items() if name != "glpath.integrator"}
    unnamed = replace(wrong, provenance=nameless)
    expected = "; the picture, of a nameless engine, has a bias, which was not measured"
    assert _known_bias(unnamed, right) == expected


def test_the_mode_follows_from_the_picture(make_film: MakeFilm) -> None:
    traced = Picture.of_film(make_film([(0, 64)]))
    assert default_mode(traced, traced) == "stat"
    assert default_mode(traced, Picture.of_array(traced.mean)) == "fuzzy"
    whitted = Picture.of_film(make_film([(0, 64)], integrator="t-buffer", noisy=False))
    assert default_mode(whitted, whitted) == "fuzzy"


# ---- exact and fuzzy


def test_exact_names_the_pixel_the_device_and_the_seed(make_film: MakeFilm) -> None:
    assert compare(Picture.of_array(GREY), Picture.of_array(GREY), "exact").severity == 0
    verdict = compare(grey_but(7, 3, 0.5 + 1e-6), Picture.of_array(GREY), "exact")
    assert not verdict.passed
    assert verdict.measured["worst_at"] == [7, 3]
    assert "1 of 480 pixels (0.208 %) differ, the worst at (7, 3) by 1e-06" in verdict.summary
    a, b = Picture.of_film(make_film()), Picture.of_film(make_film([(8, 40)], device="other", seed=4))
    summary = compare(a, b, "exact").summary
    assert "another device rounds otherwise: llvmpipe here, other in the reference" in summary
    assert "the seed is 3 here and 4 in the reference" in summary


def test_fuzzy_counts_levels_and_pixels() -> None:
    reference = Picture.of_array(GREY)
    assert compare(grey_but(2, 2, 0.505), reference, "fuzzy").passed
    verdict = compare(grey_but(2, 2, 0.52), reference, "fuzzy")
    assert not verdict.passed
    assert verdict.measured["pixels"] == 1
    assert verdict.measured["worst_at"] == [2, 2]
    assert verdict.severity == pytest.approx(verdict.measured["worst_levels"] / 2)
    assert compare(grey_but(2, 2, 0.52), reference, "fuzzy", threshold=4).passed
    assert compare(grey_but(2, 2, 0.52), reference, "fuzzy", failpercent=0.3).passed
    assert not compare(grey_but(2, 2, 0.52), reference, "fuzzy", failpercent=0.2).passed


def test_fuzzy_sees_differences_above_white() -> None:
    bright = Picture.of_array(8 * GREY)
    assert not compare(Picture.of_array(8.8 * GREY), bright, "fuzzy").passed
    assert compare(Picture.of_array(8.04 * GREY), bright, "fuzzy").passed


def test_fuzzy_forgives_edges_but_not_an_edge_that_moved() -> None:
    def edge(at: float) -> Picture:
        coverage = np.clip(at - np.arange(24), 0, 1)
        return Picture.of_array(np.broadcast_to(0.2 + 0.6 * coverage[:, None], GREY.shape))

    assert compare(edge(10.1), edge(10.0), "fuzzy").passed
    assert not compare(edge(10.1), edge(10.0), "fuzzy", edge=0).passed
    assert not compare(edge(11.0), edge(10.0), "fuzzy").passed
    texture = np.random.default_rng(0).uniform(0.1, 0.9, GREY.shape)  # full of contrast
    assert not compare(Picture.of_array(1.1 * texture), Picture.of_array(texture), "fuzzy").passed


@pytest.mark.parametrize("mode", ["exact", "fuzzy", "stat", "flip"])
def test_pictures_of_two_sizes_or_with_nan_are_refused(mode: str) -> None:
    with pytest.raises(ImageError, match="the picture is 24 x 20 and the reference 20 x 24"):
        compare(Picture(GREY), Picture(GREY.swapaxes(0, 1)), mode)
    broken = GREY.copy()
    broken[0, 0] = np.nan
    with pytest.raises(ImageError, match="1 pixels of the picture are NaN"):
        compare(Picture(broken), Picture(GREY), mode)


def test_limits_are_checked() -> None:
    grey = Picture(GREY)
    for mode, limits, message in (
        ("exact", {"threshold": 1}, "mode exact: has no limit 'threshold'. Allowed: none."),
        ("fuzzy", {"threshold": -1}, "threshold: found -1"),
        ("fuzzy", {"edge": "a"}, "edge: found 'a', expected a number"),
        ("flip", {"mean": 2}, "mean: found 2"),
        ("flip", {"local": -1}, "local: found -1"),
        ("flip", {"ppd": 0}, "ppd: found 0"),
        ("flip", {"ppd": 1e308}, "ppd: found 1e+308, expected 1 to 1,000 pixels per degree"),
        ("best", {}, "there is no 'best'. Allowed: exact, fuzzy, stat, flip"),
    ):
        with pytest.raises(UsageError) as caught:
            compare(grey, grey, mode, **limits)
        assert message in str(caught.value)
    assert read_limits("stat", ["alpha=1e-3", "tolerance=0"]) == {"alpha": 1e-3, "tolerance": 0.0}
    for text in ("alpha", "alpha=1_0", "alpha=\u0661"):
        with pytest.raises(UsageError, match=f"limit {text}: expected NAME=NUMBER"):
            read_limits("stat", [text])


# ---- flip


def test_flip_is_small_for_what_cannot_be_seen() -> None:
    pytest.importorskip("flip_evaluator")
    reference = Picture.of_array(GREY)
    assert compare(reference, reference, "flip").measured["mean"] == 0
    assert compare(grey_but(2, 2, 0.51), reference, "flip").passed
    verdict = compare(Picture.of_array(0.5 * GREY), reference, "flip")
    assert not verdict.passed
    assert verdict.severity == pytest.approx(verdict.measured["mean"] / 0.01)
    assert compare(Picture.of_array(0.5 * GREY), reference, "flip", mean=0.9).passed
    found = flip_map(grey_but(5, 3, 2.0).mean, GREY)
    assert found.shape == (20, 24)
    assert np.unravel_index(found.argmax(), found.shape) == (3, 5)
    assert flip_picture(GREY, GREY).max() <= 4  # the dark end of its colours


@pytest.mark.parametrize(("side", "levels"), [(20, 8), (8, 8), (5, 16), (3, 32), (2, 127)])
def test_flip_misses_nothing_that_vanishes_from_a_large_picture(side: int, levels: int) -> None:
    pytest.importorskip("flip_evaluator")
    empty = np.full((256, 256, 3), 128, np.uint8)
    full = empty.copy()
    full[100 : 100 + side, 60 : 60 + side] -= np.uint8(levels)
    verdict = compare(Picture.of_array(empty), Picture.of_array(full), "flip")
    assert not verdict.passed
    assert verdict.measured["mean"] < 0.01  # which alone would let it pass
    x, y = verdict.measured["worst_at"]
    assert 58 <= x <= 61 + side
    assert 98 <= y <= 101 + side
    assert f"{verdict.measured['local']:.3g}, 0.1 allowed" in verdict.summary
    assert compare(Picture.of_array(empty), Picture.of_array(full), "flip", local=1).passed


def test_flip_lets_pass_what_is_not_a_change() -> None:
    """Rounding, noise, and edges a tenth of a pixel off: where the mean lets them pass, so does every spot."""
    pytest.importorskip("flip_evaluator")
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:128, :128]
    discs = sum(np.clip(r + 0.5 - np.hypot(x - a, y - b), 0, 1) for a, b, r in ((40, 50, 20), (90, 80, 12)))
    levels = (60 + 60 * discs + 0.4 * x)[..., None] * np.ones(3)
    moved = 0.9 * levels + 0.1 * np.roll(levels, 1, axis=1)
    moved[:, 0] = levels[:, 0]
    for name, other in (
        ("rounding", np.round(levels)),
        ("noise of 2 levels", levels + rng.normal(0, 2, levels.shape)),
        ("a tenth of a pixel", moved),
    ):
        a, b = (Picture.of_array(decode_srgb(side / 255)) for side in (other, levels))
        verdict = compare(a, b, "flip", mean=0.03)
        assert verdict.passed, f"{name}: {verdict.summary}"


def test_flip_neither_ends_the_process_nor_takes_its_standard_output(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Threads of the program may print while pictures are compared."""
    flip_evaluator = pytest.importorskip("flip_evaluator")

    def exits(*_: object, **__: object) -> None:
        print("The tonemapper is not to my liking.\nExiting.")
        sys.exit(1)

    monkeypatch.setattr(flip_evaluator, "evaluate", exits)
    with pytest.raises(ImageError, match=r"refused the pictures: it printed the reason\."):
        flip_map(0.5 * GREY, GREY)
    assert capsys.readouterr() == ("The tonemapper is not to my liking.\nExiting.\n", "")


@pytest.mark.parametrize("ppd", [20, 67, 90])
@pytest.mark.parametrize(("x", "y"), [(100, 80), (0, 0), (199, 150)])
def test_flip_of_a_small_change_is_that_of_the_whole_picture(x: int, y: int, ppd: float) -> None:
    """Only the rectangle around a change is evaluated: the package itself, given all of it, says the same."""
    evaluate = pytest.importorskip("flip_evaluator").evaluate
    rng = np.random.default_rng(0)
    reference = rng.uniform(0.1, 0.9, (151, 200, 3)).astype(np.float32)
    changed = reference.copy()
    changed[y : y + 4, x : x + 9] = 1.0
    for colours in (False, True):
        whole = evaluate(
            reference, changed, "LDR", applyMagma=colours, computeMeanError=False, parameters={"ppd": ppd}
        )[0]
        a, b = (decode_srgb(side.astype(np.float64)) for side in (changed, reference))
        if colours:
            found = flip_picture(a, b, ppd=ppd).astype(np.int64)
            assert np.abs(found - 255 * whole.reshape(found.shape)).max() <= 1.01
        else:
            np.testing.assert_allclose(flip_map(a, b, ppd=ppd), whole.reshape(151, 200), atol=2e-5)


def test_flip_says_which_package_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(GlpathError, match=r"flip-evaluator is not installed(.|\n)*glpath\[flip\]"):
        flip_map(GREY, GREY)


IMAGE, PICTURE = np.ones((4, 4, 3)), Picture.of_array(np.ones((4, 4, 3)))


@pytest.mark.parametrize(
    "call",
    [
        lambda: measures.mse("x", IMAGE),
        lambda: measures.mse(IMAGE, None),
        lambda: measures.psnr([[1, 2], [3]], IMAGE),
        lambda: measures.psnr(IMAGE, IMAGE, "x"),
        lambda: measures.psnr(IMAGE, IMAGE, 1e308),
        lambda: measures.percent_beyond(IMAGE, IMAGE, "x"),
        lambda: measures.mean_ratio(IMAGE, "x"),
        lambda: measures.max_difference({}, IMAGE),
        lambda: measures.difference_image(IMAGE, IMAGE, "x"),
        lambda: measures.difference_image(IMAGE, IMAGE, 1.0, -1.0),
        lambda: measures.difference_image(IMAGE, IMAGE, np.inf),
        lambda: compare(IMAGE, IMAGE),
        lambda: compare(PICTURE, PICTURE, mode=[]),
        lambda: compare(PICTURE, PICTURE, mode="fuzzy", threshold="x"),
        lambda: default_mode(PICTURE, None),
        lambda: max_difference_pair(IMAGE, PICTURE),
        lambda: read_limits("fuzzy", [5]),
        lambda: read_picture(None),
        lambda: picture_from_bytes("a.png"),
        lambda: picture_of_pillow(IMAGE),
        lambda: flip_map(IMAGE, IMAGE, ppd="x"),
        lambda: flip_picture(IMAGE, "x"),
        lambda: Picture.of_film(IMAGE),
        lambda: PICTURE.over("white"),
    ],
)
def test_wrong_arguments_of_comparisons_are_refused(call: Callable[[], object]) -> None:
    with pytest.raises(GlpathError):
        call()
