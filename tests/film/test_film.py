"""Films add up: exactly, in any order, and only what belongs together."""

from __future__ import annotations

import io
import json
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import glpath
from glpath.errors import ImageError, UsageError
from glpath.film.batches import BATCHES, BLOCK, batch_of, blocks
from glpath.film.exr import write_exr
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata, metadata_of
from glpath.film.tonemap import auto_exposure, tonemap
from tests.conftest import MakeFilm

any_time = settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])


def same(a: Film, b: Film) -> bool:
    return (
        a.radiance_sums.tobytes() == b.radiance_sums.tobytes()
        and np.array_equal(a.batch_counts, b.batch_counts)
        and a.ranges == b.ranges
    )


@given(start=st.integers(0, 500), length=st.integers(0, 500))
def test_blocks_cover_a_range_once_and_stay_in_one_batch(start: int, length: int) -> None:
    parts = list(blocks(start, start + length))
    assert [i for a, b in parts for i in range(a, b)] == list(range(start, start + length))
    assert all(len({batch_of(i) for i in range(a, b)}) == 1 for a, b in parts)


def test_batches_take_turns_by_blocks() -> None:
    assert batch_of(0) == batch_of(BLOCK - 1) == 0
    assert batch_of(BLOCK) == 1
    assert batch_of(BLOCK * BATCHES) == 0


@any_time
@given(data=st.data())
def test_any_split_and_any_order_of_merging_give_the_same_film_to_the_bit(
    make_film: MakeFilm, data: st.DataObject
) -> None:
    total = data.draw(st.integers(1, 300))
    cuts = sorted(data.draw(st.sets(st.integers(0, total), max_size=5)) | {0, total})
    parts = [make_film([part]) for part in pairwise(cuts)]
    shuffled = data.draw(st.permutations(parts))
    merged = shuffled[0]
    for part in shuffled[1:]:
        merged = merged.merge(part)
    assert same(merged, make_film([(0, total)]))
    assert merged.ranges == ((0, total),)
    assert merged.path_sets == total


def test_the_mean_is_the_sum_by_the_count(make_film: MakeFilm) -> None:
    film = make_film([(0, 5), (100, 120)])
    np.testing.assert_allclose(film.mean, film.radiance_sums.sum(axis=0) / 25, rtol=1e-15)
    assert film.mean.shape == (4, 6, 3)
    assert film.path_sets == 25


def test_a_film_without_path_sets_has_no_picture_and_no_error(make_film: MakeFilm) -> None:
    film = make_film([])
    assert film.relative_error() is None
    with pytest.raises(UsageError, match="holds no path set"):
        film.mean  # noqa: B018
    assert "0 path sets" in film._repr_mimebundle_()["text/plain"]


def test_a_path_set_cannot_be_added_twice(make_film: MakeFilm) -> None:
    film = make_film([(0, 12)])
    before = film.radiance_sums.copy()
    with pytest.raises(UsageError, match="path sets 10 to 11 would be in it twice"):
        film.add(10, 14, np.ones((4, 6, 3)))
    assert np.array_equal(film.radiance_sums, before)
    assert film.ranges == ((0, 12),)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nothing_that_is_not_finite_gets_into_the_sums(make_film: MakeFilm, value: float) -> None:
    radiance = np.ones((4, 6, 3))
    radiance[1, 2, 0] = value
    with pytest.raises(UsageError, match="NaN or an infinity"):
        make_film([]).add(0, 1, radiance)


@pytest.mark.parametrize(
    ("start", "stop", "radiance", "aovs", "message"),
    [
        (BLOCK - 1, BLOCK + 1, np.ones((4, 6, 3)), {}, "one block"),
        (1, 1, np.ones((4, 6, 3)), {}, "path sets 1..1 where a start"),
        (-1, 1, np.ones((4, 6, 3)), {}, "path sets -1..1 where a start"),
        (1, 2, np.ones((4, 6, 4)), {}, r"radiance_sum of shape \(4, 6, 4\) where \(4, 6, 3\)"),
        (1, 2, 1.0, {}, r"radiance_sum of shape \(\)"),
        (1, 2, np.ones((4, 6, 3)), {"depth": np.ones((4, 6, 2))}, "aov_sums has"),
    ],
)
def test_sums_that_do_not_fit_are_refused(
    make_film: MakeFilm, start: int, stop: int, radiance: Any, aovs: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        make_film([]).add(start, stop, radiance, aovs)


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("scene_hash", "ffff", "scene is ffff in one film and 0123abcd in the other"),
        ("seed", 4, "seed is 4 .* 3"),
        ("max_depth", 2, "max_depth is 2 .* 5"),
        ("integrator", "gather", "integrator is gather"),
        ("settings", {"sampling": "random"}, "settings.ambient is absent .*; settings.sampling is random"),
        ("window", (1, 0, 6, 4), "crop is .1, 0, 6, 4."),
        ("full_resolution", (12, 8), "resolution is .12, 8."),
    ],
)
def test_films_of_different_renders_do_not_merge(make_film: MakeFilm, name: str, value: object, word: str) -> None:
    with pytest.raises(UsageError, match=f"cannot merge: {word}"):
        make_film([(0, 8)]).merge(make_film([(8, 16)], **{name: value}))


def test_films_that_share_path_sets_do_not_merge(make_film: MakeFilm) -> None:
    with pytest.raises(UsageError, match="path sets 16 to 31 would be in it twice"):
        make_film([(0, 32)]).merge(make_film([(16, 64)]))


def test_films_of_two_devices_merge_and_name_both(make_film: MakeFilm) -> None:
    merged = make_film([(0, 8)]).merge(make_film([(8, 16)], device="radeonsi", versions={"glpath": "0.2.0"}))
    assert merged.metadata.device == "llvmpipe + radeonsi"
    assert merged.metadata.versions == {"glpath": "0.1.0 + 0.2.0"}
    assert merged.metadata.elapsed_s == 3.0
    assert merged.metadata.statistics["paths_lost"] == 40
    assert merged.metadata.statistics["stage_ms"] == {"eye": 4.0}


def test_merging_leaves_both_films_as_they_were(make_film: MakeFilm) -> None:
    a, b = make_film([(0, 8)]), make_film([(8, 16)])
    a.merge(b)
    assert same(a, make_film([(0, 8)]))
    assert same(b, make_film([(8, 16)]))


@pytest.mark.parametrize("path_sets", [128, 131, 60, 17])
def test_the_variance_of_the_mean_is_without_bias_also_for_unequal_batches(path_sets: int) -> None:
    # Every pixel is an experiment of its own: independent paths of variance 4.
    rng = np.random.default_rng(path_sets)
    film = Film.empty(FilmMetadata("", "", "", 0, 1, {}, (200, 100), (0, 0, 200, 100)))
    for start, stop in blocks(0, path_sets):
        film.add(start, stop, rng.normal(5.0, 2.0, (stop - start, 100, 200, 3)).sum(axis=0))
    assert film.variance_of_mean().mean() == pytest.approx(4.0 / path_sets, rel=0.03)
    assert film.mean.var() == pytest.approx(4.0 / path_sets, rel=0.03)


def test_the_relative_error_is_the_error_that_there_is() -> None:
    rng = np.random.default_rng(1)
    film = Film.empty(FilmMetadata("", "", "", 0, 1, {}, (64, 64), (0, 0, 64, 64)))
    truth = rng.uniform(0.0, 2.0, (64, 64, 3))
    for start, stop in blocks(0, 256):
        film.add(start, stop, (truth + rng.normal(0.0, 1.0, (stop - start, 64, 64, 3))).sum(axis=0))
    error = np.sqrt(np.mean((film.mean - truth) ** 2 / (truth**2 + 0.01)))
    assert film.relative_error() == pytest.approx(error, rel=0.05)


def test_one_batch_has_no_error(make_film: MakeFilm) -> None:
    film = make_film([(0, BLOCK)])
    assert film.relative_error() is None
    with pytest.raises(UsageError, match="lie in one batch"):
        film.variance_of_mean()


def test_a_film_comes_back_from_npz_to_the_bit_and_still_merges(make_film: MakeFilm, tmp_path) -> None:
    film = make_film([(0, 20), (64, 70)])
    film.save(tmp_path / "part.npz")
    back = Film.load(tmp_path / "part.npz")
    assert same(back, film)
    assert back.metadata == film.metadata
    assert same(back.merge(make_film([(20, 64)])), make_film([(0, 70)]))
    back.add(20, 24, np.ones((4, 6, 3)))


def test_an_empty_film_comes_back_from_npz(make_film: MakeFilm, tmp_path) -> None:
    make_film([]).save(tmp_path / "empty.npz")
    assert same(Film.load(tmp_path / "empty.npz"), make_film([]))


def test_a_window_that_a_small_film_cannot_fill_is_refused(make_film: MakeFilm, tmp_path) -> None:
    """The sums of its eight batches take 1.1 GB in memory, although the file has none of them."""
    make_film([]).save(tmp_path / "a.npz")
    arrays = dict(np.load(tmp_path / "a.npz"))
    metadata = json.loads(str(arrays["metadata"])) | {"window": [0, 0, 2400, 2400], "full_resolution": [2400, 2400]}
    arrays |= {"metadata": json.dumps(metadata), "radiance_sums": np.zeros((0, 2400, 2400, 3))}
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ImageError, match=r"a\.npz: .* unfold to .* GB; no more than 64 times is read"):
        Film.load(tmp_path / "a.npz")


def test_a_film_that_needs_too_much_memory_is_not_said_to_be_no_film(
    make_film: MakeFilm, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_film([]).save(tmp_path / "a.npz")

    def fail(metadata: FilmMetadata) -> None:
        raise MemoryError("Unable to allocate 11.4 GiB")

    monkeypatch.setattr("glpath.film.npz_file.FilmParts.empty", fail)
    with pytest.raises(ImageError, match=r"a\.npz: needs more memory than is free: Unable to allocate 11\.4 GiB\."):
        Film.load(tmp_path / "a.npz")


def test_exr_and_png_hold_the_picture_and_how_it_was_made(make_film: MakeFilm, tmp_path) -> None:
    film = make_film([(0, 32)], (6, 4), full_resolution=(10, 9), window=(3, 5, 6, 4))
    film.save(tmp_path / "a.exr")
    header = OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).header()
    assert header["glpath.scene_hash"] == "0123abcd"
    assert header["glpath.path_sets"] == "32"
    assert json.loads(header["glpath.settings"])["sampling"] == "sobol"
    assert [corner.tolist() for corner in header["dataWindow"]] == [[3, 5], [8, 8]]
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [9, 8]]
    film.save(tmp_path / "a.png", exposure=-4)
    properties = iio.immeta(tmp_path / "a.png")
    assert properties["glpath.seed"] == "3"
    assert properties["Software"] == "glpath 0.1.0"
    assert not np.array_equal(iio.imread(tmp_path / "a.png"), iio.imread(_png(film)))


@pytest.mark.parametrize("aspect", [1.0, 2.0])
def test_exr_has_the_pixel_aspect_of_the_camera(aspect: float, tmp_path: Path) -> None:
    """OpenEXR: pixelAspectRatio is the width of a displayed pixel divided by its height, as in `Camera`."""
    camera = {"pixel_aspect": aspect}
    film = glpath.render("cornell-box-36", camera=camera, resolution=(4, 4), spp=1, max_depth=1, integrator="path")
    film.save(tmp_path / "a.npz")
    Film.load(tmp_path / "a.npz").save(tmp_path / "a.exr")
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert header["pixelAspectRatio"] == aspect
    assert ("glpath.pixel_aspect" in header) is (aspect != 1)


@pytest.mark.parametrize(("aspect", "written"), [(1e-7, 1e-6), (0.5, 0.5), (1e7, 1e6)])
def test_exr_has_the_pixel_aspect_nearest_to_a_camera_beyond_its_range(
    aspect: float, written: float, tmp_path: Path
) -> None:
    """OpenEXR refuses a pixelAspectRatio below 1e-6 or above 1e6, so that reading the file back is the witness."""
    write_exr(tmp_path / "a.exr", np.ones((2, 2, 3)), pixel_aspect=aspect)
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert header["pixelAspectRatio"] == pytest.approx(written)


@pytest.mark.parametrize("aspect", [0.0, -1.0, float("nan"), float("inf"), True, "2"])
def test_a_pixel_aspect_that_is_none_is_refused(aspect: object, make_film: MakeFilm) -> None:
    metadata = asdict(make_film().metadata)
    assert metadata_of({key: value for key, value in metadata.items() if key != "pixel_aspect"}).pixel_aspect == 1
    with pytest.raises(ValueError, match="pixel_aspect"):
        metadata_of(metadata | {"pixel_aspect": aspect})


def _png(film: Film) -> io.BytesIO:
    png = film._repr_mimebundle_()["image/png"]
    assert isinstance(png, bytes)
    return io.BytesIO(png)


def test_an_unknown_suffix_or_operator_is_refused(make_film: MakeFilm, tmp_path) -> None:
    with pytest.raises(UsageError, match=r"suffix .gif. Allowed: .png, .jpg, .jpeg, .exr, .npz"):
        make_film().save(tmp_path / "a.gif")
    with pytest.raises(UsageError, match="no suffix"):
        make_film().save(tmp_path / "a")
    with pytest.raises(UsageError, match="srgb, reinhard, aces"):
        make_film().save(tmp_path / "a.png", tonemap="filmic")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"", b"not a film", b"PK\x03\x04 cut off"])
def test_a_broken_film_is_named(tmp_path, content: bytes) -> None:
    path = tmp_path / "broken.npz"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=r"broken.npz: cannot be read as a film"):
        Film.load(path)


def test_a_cut_off_film_is_named(make_film: MakeFilm, tmp_path) -> None:
    path = tmp_path / "cut.npz"
    make_film().save(path)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(ImageError, match=r"cut.npz: cannot be read as a film"):
        Film.load(path)


def test_arrays_that_are_not_a_film_are_told_apart(tmp_path) -> None:
    np.savez(tmp_path / "other.npz", radiance=np.ones((2, 2, 3)))
    with pytest.raises(ImageError, match=r"other.npz: is not a film"):
        Film.load(tmp_path / "other.npz")
    with pytest.raises(ImageError, match="there is no such file"):
        Film.load(tmp_path / "missing.npz")


@pytest.mark.parametrize("number", [0, 2])
def test_a_film_of_another_format_is_refused_by_its_number(number: int, make_film: MakeFilm, tmp_path) -> None:
    make_film([(0, 8)]).save(tmp_path / "a.npz")
    arrays = dict(np.load(tmp_path / "a.npz"))
    assert arrays["film_format"] == 1
    np.savez(tmp_path / "b.npz", **arrays | {"film_format": number})
    with pytest.raises(ImageError, match=rf"b\.npz: is a film of format {number}; .* reads format 1"):
        Film.load(tmp_path / "b.npz")
    arrays.pop("film_format")
    np.savez(tmp_path / "c.npz", **arrays)
    assert Film.load(tmp_path / "c.npz").path_sets == 8, "the first films had no number"


@pytest.mark.parametrize(("size", "shown"), [((6, 4), (4, 6)), ((2000, 3), (1, 1000)), ((1500, 1100), (550, 750))])
def test_a_notebook_shows_at_most_1024_pixels(make_film: MakeFilm, size, shown) -> None:
    film = make_film([(0, 1)], size)
    assert iio.imread(_png(film)).shape == (*shown, 3)
    text = film._repr_mimebundle_()["text/plain"]
    assert text == f"<Film of cornell-box: {size[0]} x {size[1]} pixels, 1 path sets, depth 5, llvmpipe>"


def test_metadata_is_plain_from_the_start(make_film: MakeFilm) -> None:
    metadata = make_film([]).metadata
    assert metadata.settings["ambient"] == [0.0, 0.0, 0.0]
    assert replace(metadata, elapsed_s=2.0).settings == metadata.settings


@pytest.mark.parametrize("name", ["error_bound", "solution_error"])
@pytest.mark.parametrize("error", [-1.0, 10**400])
def test_an_error_that_is_none_is_refused(name: str, error: float, make_film: MakeFilm) -> None:
    text = json.dumps({**asdict(make_film([]).metadata), name: error})
    with pytest.raises(ValueError, match=name):
        metadata_of(json.loads(text))


@pytest.mark.parametrize("confidence", [95.0, 1.0, 0.0, -0.5, float("nan")])
def test_confidence_is_a_probability(confidence: float, make_film: MakeFilm) -> None:
    """Noise has no finite bound with probability 1, and a probability of 95 does not exist."""
    with pytest.raises(UsageError, match=r"confidence: .* above 0 and below 1"):
        make_film([(0, 64)]).error_bound(confidence)


@pytest.mark.parametrize("value", ["-1", "-0.001", "true", "NaN", "Infinity", "1e400", '"1"', "null"])
def test_a_time_that_is_none_is_refused(value: str, make_film: MakeFilm) -> None:
    text = json.dumps(asdict(make_film([]).metadata))
    assert '"elapsed_s": 1.5' in text
    with pytest.raises(ValueError, match="metadata"):
        metadata_of(json.loads(text.replace('"elapsed_s": 1.5', f'"elapsed_s": {value}')))


@pytest.mark.parametrize(
    "field",
    [
        {"seed": True},
        {"max_depth": True},
        {"error_bound": False},
        {"position_origin": [0, 0, True]},
        {"position_origin": [0, 0, 10**400]},
        *({"statistics": {"paths_cast": value}} for value in (-1, True, "1", [1])),
        *({"statistics": {"stage_ms": value}} for value in (1, {"paths": -1}, {"paths": "1"})),
    ],
)
def test_a_number_that_is_none_is_refused(field: dict[str, object], make_film: MakeFilm) -> None:
    metadata = asdict(make_film([]).metadata)
    metadata_of(metadata | {"statistics": {"paths_cast": 3, "stage_ms": {"paths": 0.5}}})
    with pytest.raises(ValueError, match=next(iter(field))):
        metadata_of(metadata | field)


def test_an_8_bit_picture_says_its_exposure_which_is_what_was_asked_or_the_scene_s_or_auto(
    make_film: MakeFilm, tmp_path
) -> None:
    film = make_film([(0, 32)])
    auto = auto_exposure(film.mean)
    set_by_scene = replace(film, metadata=replace(film.metadata, exposure=-1.5))
    for found, asked, stops in ((film, None, auto), (film, 1, 1.0), (set_by_scene, None, -1.5)):
        found.save(tmp_path / "a.png", exposure=asked)
        assert float(iio.immeta(tmp_path / "a.png")["glpath.exposure_stops"]) == stops
        expected = tonemap(film.mean, stops)
        assert np.array_equal(iio.imread(tmp_path / "a.png"), expected)
        assert np.array_equal(found.to_srgb(exposure=asked), expected)
    assert set_by_scene.exposure_stops("auto") == auto
    set_by_scene.save(tmp_path / "a.npz")
    assert Film.load(tmp_path / "a.npz").exposure_stops() == -1.5
    assert make_film([(32, 40)]).merge(set_by_scene).path_sets == 40, "it does not decide the image"
    for wrong in ("bright", float("nan"), 101, True):
        with pytest.raises(UsageError, match="exposure"):
            film.to_srgb(exposure=wrong)


def test_a_film_is_an_array_of_its_image(make_film: MakeFilm) -> None:
    film = make_film([(0, 32)])
    assert np.array_equal(np.asarray(film), film.mean)
    assert np.asarray(film, np.float32).dtype == np.float32
    assert np.allclose(film, film.mean)


@pytest.mark.parametrize("fails", ["ShapeCounts.of", "add_aov"])
def test_a_film_stays_readable_if_memory_runs_out_while_path_sets_are_added(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = glpath.render("cornell-box-36", spp=8, resolution=(8, 8), aovs=["albedo", "object_id"])

    def full(*_: object) -> None:
        raise MemoryError

    more: dict[str, Any] = {name: np.zeros_like(sums) for name, sums in film.aov_sums.items()}
    more["shapes"] = np.ones((8, 8, 4), np.int64)
    with monkeypatch.context() as patch:
        patch.setattr(f"glpath.film.sums.{fails}", full)
        with pytest.raises(MemoryError):
            film.add(8, 12, np.ones((8, 8, 3)), more)
    assert (film.path_sets, film.ranges) == (8, ((0, 8),))
    film.save(tmp_path / "a.npz")
    assert Film.load(tmp_path / "a.npz").path_sets == 8
