"""Pictures from files of all kinds and from Pillow, alpha, and what `glpath diff` makes of them."""

from __future__ import annotations

import io
import struct
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from glpath.cli.main import app
from glpath.compare import (
    Picture,
    compare,
    max_difference_pair,
    picture_from_bytes,
    picture_of_pillow,
    read_picture,
)
from glpath.compare.reading import check_sizes
from glpath.errors import ImageError
from glpath.film.exr import write_exr
from glpath.film.image import read_image
from glpath.system.colour import decode_srgb
from tests.conftest import MakeFilm
from tests.io.test_pictures import tiled_tiff, webp_of

rng = np.random.default_rng(0)
RGB = rng.integers(0, 256, (6, 5, 3), dtype=np.uint8)
RGBA = np.dstack([RGB, np.full((6, 5), 200, np.uint8)])


def faded(to: int) -> np.ndarray:
    changed = RGBA.copy()
    changed[2:5, 1:4, 3] = to
    return changed


def content(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    data = io.BytesIO()
    image.save(data, kind, **options)
    return data.getvalue()


# ---- alpha


@pytest.mark.parametrize("mode", ["exact", "fuzzy", "flip"])
def test_a_change_of_alpha_alone_is_seen(mode: str) -> None:
    if mode == "flip":
        pytest.importorskip("flip_evaluator")
    reference = Picture.of_array(RGBA)
    assert compare(reference, reference, mode).passed
    verdict = compare(Picture.of_array(faded(100)), reference, mode)
    assert not verdict.passed
    assert verdict.summary.startswith("alpha: " if mode == "exact" else "over ")
    opaque = Picture.of_array(RGB)
    assert not compare(opaque, reference, mode).passed
    assert compare(Picture.of_array(np.dstack([RGB, np.full((6, 5), 255, np.uint8)])), opaque, mode).passed


def test_alpha_off_by_a_level_is_rounding_to_fuzzy_alone() -> None:
    reference = Picture.of_array(RGBA)
    assert compare(Picture.of_array(faded(201)), reference, "fuzzy").passed
    assert not compare(Picture.of_array(faded(201)), reference, "exact").passed
    assert not compare(Picture.of_array(faded(206)), reference, "fuzzy", edge=0).passed


def test_colour_that_nobody_sees_counts_for_exact_alone() -> None:
    a, b = faded(0), faded(0)
    b[3, 2, :3] ^= 255
    assert compare(Picture.of_array(a), Picture.of_array(b), "fuzzy").passed
    assert not compare(Picture.of_array(a), Picture.of_array(b), "exact").passed


def test_over_a_ground_it_is_what_pillow_composes() -> None:
    for level in (0, 255):
        ground = Image.new("RGBA", (5, 6), (level,) * 3)
        expected = np.asarray(Image.alpha_composite(ground, Image.fromarray(RGBA)).convert("RGB"))
        found = Picture.of_array(RGBA).over(level / 255).mean
        assert np.abs(found - decode_srgb(expected / 255)).max() < 0.006


def test_alpha_that_cannot_be_is_refused() -> None:
    for value in (np.nan, 1.5, -0.1):
        image = np.ones((2, 2, 4))
        image[0, 0, 3] = value
        with pytest.raises(ImageError, match=r"alpha from|NaN"):
            Picture.of_array(image)


def test_alpha_survives_a_baseline(tmp_path: Path) -> None:
    picture = Picture.of_array(RGBA.astype(np.float64) / 255)
    picture.save(tmp_path / "a.exr")
    assert compare(Picture.load(tmp_path / "a.exr"), picture, "exact").passed
    eight_bit = Picture.of_array(RGBA)
    eight_bit.save_8_bit(tmp_path / "a.png")
    back = read_picture(tmp_path / "a.png")
    assert back.eight_bit
    assert Picture.is_baseline(back.provenance)
    assert compare(back, eight_bit, "exact").passed


# ---- files and Pillow


def test_a_palette_is_its_colours() -> None:
    indices = Image.fromarray(np.arange(4, dtype=np.uint8).reshape(2, 2)).convert("P")
    swapped = Image.fromarray(np.arange(4, dtype=np.uint8)[::-1].reshape(2, 2).copy()).convert("P")
    colours = [200, 0, 0, 0, 200, 0, 0, 0, 200, 90, 90, 90]
    indices.putpalette(colours)
    swapped.putpalette(np.reshape(colours, (4, 3))[::-1].ravel().tolist())
    assert np.array_equal(picture_of_pillow(indices).mean, picture_of_pillow(swapped).mean)
    other = indices.copy()
    other.putpalette(colours[::-1])
    assert not compare(picture_of_pillow(other), picture_of_pillow(indices), "fuzzy").passed
    assert np.array_equal(picture_from_bytes(content(indices)).mean, picture_of_pillow(indices).mean)
    seen_through = picture_from_bytes(content(indices, transparency=1))
    assert seen_through.alpha is not None
    assert seen_through.alpha.tolist() == [[1, 0], [1, 1]]


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr", "HSV", "I;16", "F"])
def test_every_mode_of_pillow_is_its_colours(mode: str) -> None:
    image = None if mode in ("I;16", "F") else Image.fromarray(RGBA if "A" in mode else RGB).convert(mode)
    if image is None:
        grey = np.asarray(Image.fromarray(RGB).convert("L"))
        image = Image.fromarray(grey.astype(np.uint16) * 257 if mode == "I;16" else grey / np.float32(255))
        assert image.mode == mode
    picture = picture_of_pillow(image)
    if mode == "F":
        assert np.array_equal(picture.mean[..., 0], np.asarray(image))
        return
    shown = np.asarray(image.convert("RGB")) if mode != "I;16" else np.dstack([grey] * 3)
    assert np.allclose(picture.mean, decode_srgb(shown / 255), atol=1e-12)
    assert picture.eight_bit == (mode != "I;16")
    assert (picture.alpha is not None) == (mode in ("LA", "RGBA"))


def test_files_are_what_they_hold(tmp_path: Path) -> None:
    Image.fromarray(RGBA).save(tmp_path / "a.png")
    Image.fromarray(RGB).save(tmp_path / "a.jpg", quality=100)
    Image.fromarray(RGB).save(tmp_path / "a.webp", lossless=True)
    alpha = RGBA[..., 3:] / 255
    write_exr(tmp_path / "a.exr", RGB / 255.0 * alpha, alpha=alpha[..., 0])
    np.save(tmp_path / "a.npy", RGBA / 255)
    reference = Picture.of_array(RGBA)
    assert compare(read_picture(tmp_path / "a.png"), reference, "exact").passed
    assert compare(picture_from_bytes((tmp_path / "a.png").read_bytes()), reference, "exact").passed
    assert compare(read_picture(tmp_path / "a.webp"), Picture.of_array(RGB), "exact").passed
    assert read_picture(tmp_path / "a.jpg").eight_bit
    linear = Picture.of_array(RGBA / 255)
    assert compare(read_picture(tmp_path / "a.npy"), linear, "exact").passed
    exr = read_picture(tmp_path / "a.exr")
    np.testing.assert_allclose(exr.mean, linear.mean, rtol=3e-7)
    np.testing.assert_allclose(exr.alpha, linear.alpha, rtol=1e-7)
    assert compare(picture_from_bytes((tmp_path / "a.exr").read_bytes()), exr, "exact").passed


def test_a_transparent_film_is_the_same_as_exr_and_as_png(make_film: MakeFilm, tmp_path: Path) -> None:
    film = make_film([], transparent=True, aovs=("depth",), exposure=0.0)
    hits = np.linspace(0.0, 8.0, 24).reshape(4, 6, 1)
    film.add(0, 8, 0.5 * hits * np.ones(3), {"depth": hits * np.ones(2)})
    for suffix in ("exr", "png"):
        film.save(tmp_path / f"a.{suffix}")
    exr, png = read_picture(tmp_path / "a.exr"), read_picture(tmp_path / "a.png")
    assert np.allclose(exr.mean[exr.alpha > 0], 0.5)
    assert compare(exr, png, "fuzzy").passed
    assert exr.differences_in_making(png) == []
    assert compare(exr, exr).mode == compare(png, png).mode == "fuzzy"  # neither holds the noise


def test_light_of_an_exr_where_alpha_is_0_is_added_to_the_ground(tmp_path: Path) -> None:
    for name, light in (("dark", 0.0), ("glow", 0.5)):
        write_exr(tmp_path / f"{name}.exr", np.full((6, 5, 3), light), alpha=np.zeros((6, 5)))
    dark, glow = (read_picture(tmp_path / f"{name}.exr") for name in ("dark", "glow"))
    assert np.allclose(glow.over(0.0).mean, 0.5)
    assert np.allclose(dark.over(1.0).mean, 1.0)
    for mode in ("exact", "fuzzy"):
        assert not compare(glow, dark, mode).passed


def test_films_keep_their_noise(make_film: MakeFilm, tmp_path: Path) -> None:
    film = make_film([(0, 64)])
    film.save(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", radiance=film.mean)
    Picture.of_film(film).save(tmp_path / "c.exr")
    for name, noisy in (("a.npz", True), ("b.npz", False), ("c.exr", True)):
        picture = read_picture(tmp_path / name)
        assert compare(picture, Picture.of_film(film), "exact").passed
        assert (picture.noise is not None) == noisy


def test_what_is_no_picture_says_so(tmp_path: Path) -> None:
    frames = [Image.fromarray(np.full((4, 4, 3), level, np.uint8)) for level in (0, 200)]
    frames[0].save(tmp_path / "a.gif", save_all=True, append_images=frames[1:])
    (tmp_path / "b.png").write_bytes(content(frames[0])[:40])
    (tmp_path / "c.png").write_text("not a picture")
    for name, message in (
        ("a.gif", "a.gif: holds several frames"),
        ("b.png", "b.png: cannot be read as a picture"),
        ("c.png", "c.png: cannot be read as a picture"),
        ("d.png", "d.png: there is no such file"),
        ("e.xyz", "cannot read a .xyz"),
    ):
        with pytest.raises(ImageError, match=message):
            read_picture(tmp_path / name)
    with pytest.raises(ImageError, match="9 bytes: cannot be read as a picture"):
        picture_from_bytes(b"some text")


def tiff_of(pages: int) -> bytes:
    """A TIFF of grey pages of one pixel, each a directory of five entries."""
    out = bytearray(b"II*\0" + struct.pack("<I", 8))
    for page in range(pages):
        entries = ((256, 1), (257, 1), (258, 8), (262, 1), (273, 8))
        after = len(out) + 2 + 12 * len(entries) + 4
        out += struct.pack("<H", len(entries))
        out += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries)
        out += struct.pack("<I", after if page + 1 < pages else 0)
    return bytes(out)


def test_a_tiff_of_very_many_pages_is_refused_quickly(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(tiff_of(10_000))
    start = time.process_time()
    with pytest.raises(ImageError, match=r"a\.tif: holds several frames"):
        read_picture(tmp_path / "a.tif")
    assert time.process_time() - start < 1
    Image.new("L", (1, 1)).save(tmp_path / "b.tif")
    assert read_picture(tmp_path / "b.tif").mean.shape == (1, 1, 3)


def test_a_tiff_with_tiles_larger_than_its_picture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(tiled_tiff(16, 16384))
    with pytest.raises(ImageError, match=r"its tiles of 16,384 x 16,384 pixels are larger than the picture of 256"):
        read_picture(path)


def test_the_size_of_a_webp_picture_is_checked_before_pillow_opens_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Image.new("RGB", (4, 3)).save(tmp_path / "b.webp", lossless=True)
    monkeypatch.setattr(Image, "open", None)
    (tmp_path / "a.webp").write_bytes(webp_of(8192))
    with pytest.raises(ImageError, match=r"unfold to 1\.61 GB"):
        read_picture(tmp_path / "a.webp")
    with pytest.raises(ImageError, match=r"8192 x 8192 .* 4 x 3"):
        check_sizes(tmp_path / "a.webp", tmp_path / "b.webp")


# ---- glpath diff


def test_diff_sees_alpha_and_palettes(tmp_path: Path) -> None:
    Image.fromarray(RGBA).save(tmp_path / "a.png")
    Image.fromarray(faded(100)).save(tmp_path / "b.png")
    runner = CliRunner()
    files = [str(tmp_path / name) for name in ("a.png", "b.png")]
    assert runner.invoke(app, ["diff", *files, "--fail", "1e-4"]).exit_code == 1
    assert runner.invoke(app, ["diff", files[0], files[0], "--fail", "0"]).exit_code == 0
    result = runner.invoke(app, ["diff", *files, "--mode", "fuzzy", "-o", str(tmp_path / "c.png")])
    assert result.exit_code == 1
    assert "not the same: over " in result.stdout
    a, b = max_difference_pair(read_picture(files[0]), read_picture(files[1]))
    assert np.abs(a.mean - b.mean).max() > 0.1
    assert (np.asarray(Image.open(tmp_path / "c.png")) != 247).any()


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".exr"])
def test_diff_compares_sizes_before_it_decodes(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [str(tmp_path / f"{name}{suffix}") for name in "ab"]
    for name, side in zip(names, (3, 4), strict=True):
        if suffix == ".exr":
            write_exr(name, np.ones((side, 5, 3)))
        else:
            Image.new("RGB", (5, side)).save(name)
    monkeypatch.setattr("glpath.compare.read_picture", None)
    result = CliRunner().invoke(app, ["diff", *names])
    assert isinstance(result.exception, ImageError) or result.exit_code == 1
    assert "the picture is 5 x 3 and the reference 5 x 4" in str(result.exception) + result.output


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("read", [read_picture, read_image, check_sizes])
def test_many_pixels_give_no_warning_of_pillow(
    suffix: str, read: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    Image.new("RGB", (6, 5)).save(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _ = read(path, path) if read is check_sizes else read(path)
