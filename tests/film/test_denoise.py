"""Denoised pictures: nearer to the truth, with an honest error, and never mistaken for what was rendered."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
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
from glpath.film import denoise
from glpath.film.aovs import DENOISER_AOVS as AOVS
from glpath.film.denoise import Guides, denoised, is_free_of_noise
from glpath.film.exr import read_exr_channels
from glpath.film.film import Film
from glpath.film.image import read_image
from glpath.rendering import RenderJob
from glpath.rendering.run_options import RunOptions
from glpath.sampling import MAX_SPP
from glpath.scene import Scene
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


@pytest.mark.parametrize(("spp", "gain"), [(16, 6), (64, 3.5)])
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
@pytest.mark.parametrize("seed", range(2))
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
        # After 128 sets what the denoiser loses is as much as the noise that it removes.
        assert error < 1.05 * np.sqrt(relative_mse(film.mean, reference))
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
    assert np.array_equal(film.denoised(), denoised(film.mean, Guides.of(film.aov("albedo"), film.aov("normal"))))


@pytest.mark.evidence
def test_tiles_change_no_bit_and_take_less_memory(tmp_path: Path) -> None:
    """In processes of their own, whose peaks they are."""
    program = """
import subprocess
import sys
import numpy as np
from glpath.film import denoise
from glpath.system.machine import peak_resident_bytes
page = np.random.default_rng(0).gamma(2.0, 0.5, (1024, 1024, 3)).astype(np.float32)
denoise._PAGE_MIB = int(sys.argv[1])
before = peak_resident_bytes()
np.save(sys.argv[2], denoise.denoised_lightmap(page))
print(peak_resident_bytes() - before)
"""
    peaks, pages = [], []
    for memory in (4096, denoise._PAGE_MIB):
        file = tmp_path / f"{memory}.npy"
        command = [sys.executable, "-c", program, str(memory), str(file)]
        peaks.append(int(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
        pages.append(np.load(file))
    assert np.array_equal(*pages)
    assert peaks[1] < 0.7 * peaks[0]


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (33, 7), (64, 64)])
def test_pictures_of_any_size_keep_their_borders(size: tuple[int, int]) -> None:
    flat = np.full((size[1], size[0], 3), 0.5)
    found = denoised(flat, Guides.of(flat, np.zeros_like(flat)))
    assert found.shape == flat.shape
    assert found.flags.c_contiguous
    assert np.allclose(found, 0.5, rtol=0.05)


def test_guides_of_plain_surfaces_are_taken_as_they_are_and_those_with_noise_are_denoised() -> None:
    row, column = np.mgrid[:64, :64]
    inside = (row - 32.0) ** 2 + (column - 32.0) ** 2 < 400
    plain = np.where(inside[..., None], [0.7, 0.2, 0.1], [0.4, 0.5, 0.6]).astype(np.float32)
    # A sphere of such a radius curves by less than noise is seen.
    x, y = (column - 32) / 80, (row - 32) / 80
    round_ = np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=2).astype(np.float32)
    guides = Guides.of(plain, round_)
    assert np.array_equal(guides.albedo, plain)
    assert np.array_equal(guides.normal, round_)
    noisy = plain + np.random.default_rng(0).normal(0, 0.02, plain.shape).astype(np.float32)
    guides = Guides.of(noisy, round_)
    assert np.abs(guides.albedo - plain)[4:-4, 4:-4].mean() < 0.5 * np.abs(noisy - plain)[4:-4, 4:-4].mean()
    assert np.array_equal(guides.normal, round_)


def test_noise_of_a_small_part_is_found_and_edges_are_none() -> None:
    """Of one vase of alpha among much else; and of leaves, whose outlines are everywhere."""
    rng = np.random.default_rng(1)
    vase = np.full((128, 160, 3), 0.5, np.float32)
    assert is_free_of_noise(vase)
    vase[40:72, 60:84] += rng.normal(0, 0.03, (32, 24, 3)).astype(np.float32)
    assert not is_free_of_noise(vase)
    rows, columns = np.mgrid[: 128 * 8, : 160 * 8]
    leaves = np.zeros(rows.shape, np.float32)
    for row, column, radius in rng.uniform((0, 0, 40), (1024, 1280, 120), (300, 3)):
        leaves[(rows - row) ** 2 + (columns - column) ** 2 < radius**2] = rng.uniform()
    pixels = leaves.reshape(128, 8, 160, 8).mean(axis=(1, 3))[..., None].repeat(3, axis=2)
    assert is_free_of_noise(pixels)


def test_without_noise_in_its_guides_a_box_is_denoised_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    reference = stored_reference("cornell-box-36", 3)
    film = glpath.render(**{**BOX, "resolution": reference.shape[1::-1]}, spp=16)
    assert is_free_of_noise(film.aov("albedo"))
    ours = film.denoised()
    monkeypatch.setattr(denoise, "is_free_of_noise", lambda guide: False)
    both = Guides.of(film.aov("albedo"), film.aov("normal"))
    assert not np.array_equal(both.albedo, film.aov("albedo"))
    assert relative_mse(ours, reference) < 1.05 * relative_mse(denoised(film.mean, both), reference)


def test_the_error_is_that_of_two_halves_weighed_by_their_path_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a denoiser that changes nothing it is twice the variance of the mean."""
    monkeypatch.setattr("glpath.film.denoise.soon_denoised", lambda radiance, *_: radiance.astype(np.float32))
    film = glpath.render("cornell-box-36", spp=24, max_depth=1, resolution=(16, 16), aovs=AOVS)
    means = [film.radiance_sums[:1].sum(axis=0) / 8, film.radiance_sums[1:3].sum(axis=0) / 16]
    expected = 2 * (8 / 24) * (16 / 24) * (means[0] - means[1]) ** 2
    assert np.allclose(film.variance_of_denoised(), expected, rtol=1e-4, atol=1e-9)


def test_a_few_pixels_do_not_say_that_a_picture_is_not_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    """The worst thousandth is left out: one of 1280 pixels here, which a spark has met in one half."""
    monkeypatch.setattr("glpath.film.denoise.soon_denoised", lambda radiance, *_: radiance.astype(np.float32))
    film = glpath.render("cornell-box-36", spp=16, max_depth=1, resolution=(40, 32), aovs=AOVS)
    clean, error = film.denoised_noise(), film.relative_error(denoised=True)
    assert clean is not None
    assert error is not None
    assert 0 < clean < error
    sparks = [film.radiance_sums.copy() for _ in range(2)]
    for sums in sparks:
        sums[0, 20, 11] += 1e3
    sparks[1][0, 20, 12] += 1e3
    one, two = (replace(film, radiance_sums=sums).denoised_noise() for sums in sparks)
    assert one == pytest.approx(clean, rel=0.1)
    assert (two or 0) > 1.2 * clean


def test_one_batch_has_no_error(make_film: MakeFilm) -> None:
    film = glpath.render("cornell-box-36", spp=8, max_depth=1, resolution=(16, 16), aovs=AOVS)
    assert film.relative_error(denoised=True) is None
    assert film.denoised_noise() is None
    with pytest.raises(UsageError, match="Render more than 8 path sets"):
        film.variance_of_denoised()


def test_a_film_without_aovs_is_not_denoised(make_film: MakeFilm) -> None:
    with pytest.raises(UsageError, match="holds no AOV 'albedo'") as caught:
        make_film().denoised()
    assert 'aovs=("albedo", "normal")' in str(caught.value)


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


@pytest.mark.parametrize(
    ("outputs", "options", "shown"),
    [
        (("a.png",), (), True),
        (("a.exr",), (), True),
        (("a.png", "a.npz"), (), True),
        (("a.npz",), (), False),
        (("a.npz",), ("--denoise",), True),
        (("a.png", "a.exr", "a.npz"), ("--no-denoise",), False),
    ],
)
def test_what_is_for_eyes_is_denoised_by_default(
    outputs: tuple[str, ...], options: tuple[str, ...], shown: bool, tmp_path: Path
) -> None:
    more = [word for name in outputs for word in ("-o", tmp_path / name)]
    result = cli("render", "cornell-box-36", "--spp", 2, "--max-depth", 1, "--resolution", "12x10", *options, *more)
    assert result.exit_code == 0, result.stderr
    assert ("denoised by Open Image Denoise" in result.stderr) is shown
    for name in outputs:
        path = tmp_path / name
        if path.suffix == ".png":
            assert ("glpath.denoised" in iio.immeta(path)) is shown
        elif path.suffix == ".exr":
            channels, _ = read_exr_channels(path)
            assert ("denoised.R" in channels) is shown
            assert ("albedo.R" in channels) is shown
        else:
            # Whether a film becomes a picture is decided later, by `glpath merge`.
            assert (Film.load(path).metadata.aovs == AOVS) is ("--no-denoise" not in options)


def test_without_the_denoiser_a_line_says_what_would_help(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("glpath.film.denoise.can_denoise", lambda: False)
    render = ("render", "cornell-box-36", "--spp", 2, "--max-depth", 1, "--resolution", "12x10")
    help_line = "  not denoised: with pip install 'glpath[denoise]' a picture is clean sooner"
    result = cli(*render, "-o", tmp_path / "a.png")
    assert result.exit_code == 0, result.stderr
    assert result.stderr.splitlines().count(help_line) == 1
    assert "glpath.denoised" not in iio.immeta(tmp_path / "a.png")
    for options in (("-o", tmp_path / "a.npz"), ("-o", tmp_path / "a.png", "--no-denoise")):
        assert "not denoised" not in cli(*render, *options).stderr
    ray_traced = cli("render", "three-spheres", "--spp", 1, "--resolution", "12x10", "-o", tmp_path / "a.png")
    assert (ray_traced.exit_code, "not denoised" in ray_traced.stderr) == (0, False), ray_traced.stderr


@pytest.mark.parametrize(("there", "rule"), [(True, {"clean": 0.05}), (False, {"noise": 0.02})])
def test_a_picture_without_options_ends_when_it_looks_clean(
    there: bool, rule: dict[str, float], film: Film, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[tuple[RenderJob, RunOptions]] = []

    def run_job(job: RenderJob, scene: Scene, options: RunOptions) -> Film:
        asked.append((job, options))
        return film

    monkeypatch.setattr("glpath.rendering.calls.run_job", run_job)
    monkeypatch.setattr("glpath.film.denoise.can_denoise", lambda: there)
    for options, ended_by, spp in (
        ((), rule, 64),
        (("--spp", 3), {}, 3),
        (("--time-limit", "9s"), {"time_limit": 9.0}, MAX_SPP),
        (("--noise", 0.5), {"noise": 0.5}, MAX_SPP),
    ):
        result = cli("render", "cornell-box-36", "-o", tmp_path / "a.png", *options)
        assert result.exit_code == 0, result.stderr
        job, run = asked.pop()
        found = {name: getattr(run, name) for name in ("clean", "noise", "time_limit")}
        assert {name: value for name, value in found.items() if value is not None} == ended_by
        assert job.spp == spp
        assert job.integrator.aovs == AOVS, "on every machine, so that any may resume it"
    # Nobody looks at an .npz, and a ray tracer has no noise.
    for arguments in (("cornell-box-36", "-o", tmp_path / "a.npz"), ("three-spheres", "-o", tmp_path / "a.png")):
        assert cli("render", *arguments).exit_code == 0
        _, run = asked.pop()
        assert (run.clean, run.noise) == (None, None)


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
