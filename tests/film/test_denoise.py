"""Denoised pictures: nearer to the truth, with an honest error, and never mistaken for what was rendered."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner, Result

import glpath
from benchmarks.references.stored import smaller, stored_reference
from glpath import compare
from glpath.cli.main import app
from glpath.compare import relative_mse
from glpath.errors import GlpathError, UsageError
from glpath.film.aovs import DENOISER_AOVS as AOVS
from glpath.film.denoise import denoised
from glpath.film.film import Film
from glpath.film.image import read_exr_channels, read_image
from glpath.rendering import RenderJob
from tests.conftest import MakeFilm
from tests.support.engines import with_depth

pytest.importorskip("pyoidn", reason="needs the denoise extra")

SIDE = 128
BOX = {"scene": "cornell-box-36", "max_depth": 3, "resolution": (SIDE, SIDE), "aovs": AOVS}
#: Between the error of a denoised picture and its estimate, as `Film.variance_of_denoised` says.
HONEST = 2.5


def cli(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def film() -> Film:
    """Of 32 path sets."""
    return glpath.render(spp=32, **BOX)


@pytest.mark.parametrize(("spp", "gain"), [(16, 6), (64, 4)])
def test_a_denoised_picture_is_nearer_to_the_converged_one_by_about_what_it_says(spp: int, gain: float) -> None:
    reference = smaller(stored_reference("cornell-box-36", 3), SIDE)
    film = glpath.render(spp=spp, **BOX)
    raw, better = relative_mse(film.mean, reference), relative_mse(film.denoised(), reference)
    assert better < raw / gain
    said = film.relative_error(denoised=True)
    assert said is not None
    assert 1 / HONEST < said / np.sqrt(better) < HONEST
    assert film.denoised().mean() == pytest.approx(film.mean.mean(), rel=0.03)


@pytest.mark.evidence
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("scene", "integrator"), [("cornell-box-36", "gather"), ("room", "gather"), ("room", "path")]
)
def test_the_error_of_denoised_pictures_is_honest(scene: str, integrator: str, seed: int) -> None:
    """After 16, 32, 64 and 128 path sets, each of which has those before it in it."""
    reference = smaller(stored_reference(scene, 64), SIDE)
    options = with_depth({"integrator": integrator}, 2 if integrator == "gather" else 8)
    film = None
    for first, spp in ((0, 16), (16, 32), (32, 64), (64, 128)):
        more = glpath.render(
            scene, spp=spp - first, first_path_set=first, seed=seed, resolution=(SIDE, SIDE), aovs=AOVS, **options
        )
        film = more if film is None else film.merge(more)
        assert film.path_sets == spp
        error, said = np.sqrt(relative_mse(film.denoised(), reference)), film.relative_error(denoised=True)
        assert error < np.sqrt(relative_mse(film.mean, reference))
        assert said is not None
        assert 1 / HONEST < said / error < HONEST, (spp, said, error)


def test_the_same_film_gives_the_same_bits_and_stays_as_it_was(film: Film, tmp_path: Path) -> None:
    before = film.radiance_sums.copy()
    first = film.denoised()
    assert first.dtype == np.float32
    assert first.shape == film.mean.shape
    film.save(tmp_path / "a.npz")
    again = Film.load(tmp_path / "a.npz").denoised()
    assert first.tobytes() == again.tobytes()
    assert np.array_equal(film.radiance_sums, before)
    first[:] = 0  # the caller's own
    assert np.array_equal(film.denoised(), again)


def test_more_path_sets_are_denoised_anew() -> None:
    film = glpath.render("cornell-box-36", spp=8, max_depth=1, resolution=(16, 16), aovs=AOVS)
    before = film.denoised()
    more = glpath.render("cornell-box-36", spp=8, first_path_set=8, max_depth=1, resolution=(16, 16), aovs=AOVS)
    film.add(8, 16, more.radiance_sums[1], more.aov_sums)
    assert not np.array_equal(film.denoised(), before)
    assert np.array_equal(film.denoised(), denoised(film.mean, film.aov("albedo"), film.aov("normal")))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (33, 7), (64, 64)])
def test_pictures_of_any_size_keep_their_borders(size: tuple[int, int]) -> None:
    flat = np.full((size[1], size[0], 3), 0.5)
    found = denoised(flat, flat, np.zeros_like(flat))
    assert found.shape == flat.shape
    assert found.flags.c_contiguous
    assert np.allclose(found, 0.5, rtol=0.05)


def test_the_error_is_that_of_two_halves_weighed_by_their_path_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a denoiser that changes nothing it is twice the variance of the mean."""
    monkeypatch.setattr(
        "glpath.film.denoise.denoised", lambda radiance, albedo, normal: radiance.astype(np.float32)
    )
    film = glpath.render("cornell-box-36", spp=24, max_depth=1, resolution=(16, 16), aovs=AOVS)
    means = [film.radiance_sums[:1].sum(axis=0) / 8, film.radiance_sums[1:3].sum(axis=0) / 16]
    expected = 2 * (8 / 24) * (16 / 24) * (means[0] - means[1]) ** 2
    assert np.allclose(film.variance_of_denoised(), expected, rtol=1e-4, atol=1e-9)


def test_one_batch_has_no_error(make_film: MakeFilm) -> None:
    film = glpath.render("cornell-box-36", spp=8, max_depth=1, resolution=(16, 16), aovs=AOVS)
    assert film.relative_error(denoised=True) is None
    with pytest.raises(UsageError, match="Render more than 8 path sets"):
        film.variance_of_denoised()


def test_a_film_without_aovs_is_not_denoised(make_film: MakeFilm) -> None:
    with pytest.raises(UsageError, match="holds no AOV 'albedo'") as caught:
        make_film().denoised()
    assert "aovs=('albedo', 'normal')" in str(caught.value)


def test_without_pyoidn_the_line_to_type_is_said(film: Film, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    fresh = Film(film.radiance_sums, film.batch_counts, film.ranges, film.metadata, film.aov_sums)
    with pytest.raises(GlpathError, match=r'pip install "glpath\[denoise\]"'):
        fresh.denoised()
    result = cli("render", "cornell-box-36", "--denoise", "--spp", 2**20, "-o", tmp_path / "a.png")
    assert result.exit_code == 1
    assert 'pip install "glpath[denoise]"' in result.stderr


def test_files_hold_the_denoised_picture_and_what_it_was_made_of(tmp_path: Path) -> None:
    out = [tmp_path / f"a.{suffix}" for suffix in ("png", "exr", "npz")]
    more = [word for path in out for word in ("-o", path)]
    result = cli("render", "cornell-box-36", "--denoise", "--spp", 16, "--resolution", "48x40", *more)
    assert result.exit_code == 0, result.stderr
    assert "denoised by Open Image Denoise, then error about" in result.stderr
    film = Film.load(out[2])
    plain = glpath.render("cornell-box-36", spp=16, resolution=(48, 40))
    assert film.radiance_sums.tobytes() == plain.radiance_sums.tobytes()
    assert np.array_equal(iio.imread(out[0]), film.to_srgb(denoise=True))
    assert not np.array_equal(film.to_srgb(denoise=True), film.to_srgb())
    channels, header = read_exr_channels(out[1])
    assert np.array_equal(read_image(out[1]), film.mean.astype(np.float32))
    layer = np.stack([channels[f"denoised.{colour}"] for colour in "RGB"], axis=2)
    assert np.array_equal(layer, film.denoised())
    assert {"albedo.R", "normal.Z"} <= channels.keys()
    assert "glpath.denoised" not in header  # its picture is none; the layer has the name
    assert iio.immeta(out[0])["glpath.denoised"].startswith("Open Image Denoise, pyoidn 2.")


def test_progress_in_json_says_the_error(tmp_path: Path) -> None:
    options = ("--denoise", "--spp", 16, "--resolution", "24x20", "--progress", "json", "-o", tmp_path / "a.npz")
    result = cli("render", "cornell-box-36", *options)
    done = json.loads(result.stderr.splitlines()[-1])
    assert done["event"] == "done"
    assert done["denoised_error"] == pytest.approx(Film.load(tmp_path / "a.npz").relative_error(denoised=True))


def test_a_job_is_denoised_where_it_has_the_aovs(tmp_path: Path) -> None:
    options = {"spp": 2, "max_depth": 1, "resolution": (12, 10)}
    RenderJob.of("cornell-box-36", **options).save(tmp_path / "plain.json")
    RenderJob.of("cornell-box-36", aovs=AOVS, **options).save(tmp_path / "aovs.json")
    result = cli("render", "--job", tmp_path / "plain.json", "--denoise", "-o", tmp_path / "a.png")
    assert result.exit_code == 2
    assert "asks for no AOVs albedo and normal" in result.stderr
    result = cli("render", "--job", tmp_path / "aovs.json", "--denoise", "-o", tmp_path / "a.png")
    assert result.exit_code == 0, result.stderr
    assert "glpath.denoised" in iio.immeta(tmp_path / "a.png")


def test_a_turntable_is_denoised(tmp_path: Path) -> None:
    options = ("--spp", 2, "--resolution", "12x10", "--turntable", 2, "--denoise", "-o", tmp_path / "a.exr")
    result = cli("render", "cornell-box-36", *options)
    assert result.exit_code == 0, result.stderr
    assert "denoised.R" in read_exr_channels(tmp_path / "a-1.exr")[0]


def test_ray_tracers_are_not_denoised(tmp_path: Path) -> None:
    result = cli("render", "three-spheres", "--integrator", "t-buffer", "--denoise", "-o", tmp_path / "a.png")
    assert result.exit_code == 2
    assert "--denoise with --integrator t-buffer" in result.stderr


def test_a_denoised_picture_is_never_compared_by_its_noise(film: Film, tmp_path: Path) -> None:
    """Its pixels agree with each other, not with the truth; its film's noise is no longer its own."""
    path = tmp_path / "a.png"
    film.save(path, denoise=True)
    film.save(tmp_path / "film.npz", denoise=True)
    film.save(tmp_path / "a.exr", denoise=True)
    picture = compare.read_picture(path)
    assert picture.denoised
    assert compare.compare(picture, picture).mode == "fuzzy"
    for pair in ((path, path), (path, tmp_path / "film.npz")):
        result = cli("diff", *pair, "--stat")
        assert result.exit_code == 2
        assert "is denoised: no noise is left" in result.stderr
    for name in ("film.npz", "a.exr"):  # they hold the picture as it is
        assert not compare.read_picture(tmp_path / name).denoised
