"""Pictures go to files and come back; files are whole or not there."""

from __future__ import annotations

import json
import math
import os
import stat
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio.v3 as iio
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from glpath.compare import read_picture
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.film import image
from glpath.film.choices import TONEMAP_NAMES
from glpath.film.exr import read_exr_channels, write_exr
from glpath.film.film import read_image
from glpath.film.tonemap import REINHARD_WHITE, TONEMAPS, auto_exposure, tonemap
from glpath.io.named_files import UnusableError
from glpath.io.pictures import Pictures
from glpath.jobs.checkpoint import checkpoint_path
from glpath.system import files
from glpath.system.colour import REC709_CHROMATICITIES, decode_levels, decode_srgb, encode_srgb, luminance
from glpath.system.locks import Lock
from tests.conftest import MakeFilm
from tests.support.damaged import write_jpeg_of_scans

RAMP = np.linspace(0, 1, 256)


def test_the_srgb_curve_has_its_published_values() -> None:
    np.testing.assert_allclose(
        encode_srgb(np.array([0.0, 0.0031308, 0.214041, 1.0])), [0, 0.04045, 0.5, 1], atol=1e-5
    )
    np.testing.assert_allclose(decode_srgb(encode_srgb(RAMP)), RAMP, atol=1e-12)


def test_an_exposure_of_one_stop_doubles_the_light() -> None:
    radiance = np.random.default_rng(0).uniform(0, 0.4, (5, 7, 3))
    assert np.array_equal(tonemap(radiance, exposure=1.0), tonemap(2 * radiance))


def test_every_tone_curve_that_is_offered_is_there() -> None:
    assert tuple(TONEMAPS) == TONEMAP_NAMES


@pytest.mark.parametrize("operator", TONEMAPS)
def test_every_operator_keeps_black_and_order_and_ends_at_white(operator: str) -> None:
    radiance = np.repeat(np.geomspace(1e-4, 1e4, 400)[None, :, None], 3, axis=2)
    shown = tonemap(np.concatenate([np.zeros((1, 1, 3)), radiance], axis=1), operator=operator)
    assert shown.dtype == np.uint8
    assert shown[0, 0].tolist() == [0, 0, 0]
    assert (np.diff(shown[0, :, 0].astype(int)) >= 0).all()
    assert shown[0, -1].tolist() == [255, 255, 255]


@pytest.mark.parametrize("operator", TONEMAPS)
@pytest.mark.parametrize("stops", [500, 1000])
def test_every_operator_shows_white_at_most_stops(operator: str, stops: int) -> None:
    shown = tonemap([[[0.0, 0.0, 0.0], [0.5, 0.5, 0.5], [1e12, 1e12, 1e12]]], stops, operator)
    assert shown[0, :, 0].tolist() == [0, 255, 255]


def test_reinhard_takes_its_white_to_one_and_keeps_colour() -> None:
    white = np.full((1, 1, 3), REINHARD_WHITE)
    assert TONEMAPS["reinhard"](white) == pytest.approx(1.0)
    colour = np.array([[[0.9, 0.3, 0.1]]])
    ratio = TONEMAPS["reinhard"](colour) / colour
    assert ratio == pytest.approx(ratio[0, 0, 0])


def test_an_unknown_operator_is_refused_with_the_list() -> None:
    with pytest.raises(UsageError, match=r"no operator 'filmic'. Allowed: srgb, reinhard, aces"):
        tonemap(np.ones((1, 1, 3)), operator="filmic")


def test_exr_holds_float32_and_where_it_lies_and_what_it_means(tmp_path: Path) -> None:
    radiance = np.random.default_rng(1).uniform(0, 50, (4, 5, 3))
    path = tmp_path / "a.exr"
    write_exr(path, radiance, {"glpath.seed": "7"}, window=(2, 1, 5, 4), full_resolution=(9, 8))
    assert np.array_equal(image.read_image(path), radiance.astype(np.float32))
    header = OpenEXR.File(str(path)).header()
    assert header["glpath.seed"] == "7"
    assert header["chromaticities"] == pytest.approx(REC709_CHROMATICITIES)
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert [c.name for c in header["channels"]] == ["B", "G", "R"]


@pytest.mark.parametrize(
    ("window", "resolution", "expected"),
    [
        ((1, 1, 2, 1), (4, 3), [[0, 0, 0, 0], [0, 1, 2, 0], [0, 0, 0, 0]]),
        ((-1, 0, 2, 1), (2, 1), [[2, 0]]),
        ((0, 0, 2, 1), (2, 1), [[1, 2]]),
        ((9, 9, 2, 1), (2, 1), [[0, 0]]),
    ],
    ids=["trimmed", "overscan", "same", "apart"],
)
def test_textures_have_the_display_window_of_an_exr(
    tmp_path: Path, window: tuple[int, int, int, int], resolution: tuple[int, int], expected: list[list[int]]
) -> None:
    path = tmp_path / "a.exr"
    pixels = np.repeat(np.array([[[1.0], [2.0]]]), 3, axis=2)
    write_exr(path, pixels, window=window, full_resolution=resolution, alpha=np.ones((1, 2)))
    assert image.read_texture(path)[..., 0].tolist() == expected
    assert image.read_environment(path)[..., 2].tolist() == expected
    assert (image.read_texture(path, alpha=True)[..., 3] > 0).tolist() == (np.array(expected) > 0).tolist()
    assert image.read_image(path)[..., 0].tolist() == [[1, 2]]
    size = image.picture_size(path, display=True)
    assert (size.width, size.height) == (max(2, resolution[0]), resolution[1])


@pytest.mark.parametrize(
    ("chromaticities", "red"),
    [
        ((0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290), (1.6605, -0.1246, -0.0182)),  # ITU-R BT.2087
        ((0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290), (1.2249, -0.0420, -0.0196)),  # Display P3
        ((0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767), (1.70505, -0.13026, -0.02400)),  # ACEScg
    ],
)
def test_an_exr_of_other_primaries_is_converted(
    tmp_path: Path, chromaticities: tuple[float, ...], red: tuple[float, ...]
) -> None:
    path = tmp_path / "a.exr"
    pixels = np.array([[[1, 0, 0], [1, 1, 1]]], np.float32)
    header = {"type": OpenEXR.scanlineimage, "chromaticities": chromaticities}
    OpenEXR.File(header, {"RGB": pixels}).write(str(path))
    found = read_image(path)
    assert np.allclose(found[0, 0], red, atol=1e-4)
    assert np.allclose(found[0, 1], 1.0)
    assert np.array_equal(image.read_image(path, colours=False), pixels)


def test_chromaticities_that_are_no_colours_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    for broken in ((0.0,) * 8, (*REC709_CHROMATICITIES[:7], 0.0)):
        header = {"type": OpenEXR.scanlineimage, "chromaticities": broken}
        OpenEXR.File(header, {"RGB": np.ones((1, 1, 3), np.float32)}).write(str(path))
        with pytest.raises(ImageError, match=r"its chromaticities \[.*\] are not those of colours"):
            read_image(path)


def test_png_holds_the_picture_and_its_metadata(tmp_path: Path) -> None:
    picture = np.random.default_rng(2).integers(0, 256, (4, 5, 3), np.uint8)
    image.write_png(tmp_path / "a.png", picture, {"glpath.scene": "Kornell-Büchse"})
    assert np.array_equal(iio.imread(tmp_path / "a.png"), picture)
    assert iio.immeta(tmp_path / "a.png")["glpath.scene"] == "Kornell-Büchse"


def test_png_comes_back_as_linear_light(tmp_path: Path) -> None:
    grey = np.repeat(RAMP[None, :, None], 3, axis=2)
    image.write_png(tmp_path / "a.png", tonemap(grey))
    np.testing.assert_allclose(image.read_image(tmp_path / "a.png"), grey, atol=5e-3)


def test_grey_and_alpha_become_three_channels(tmp_path: Path) -> None:
    iio.imwrite(tmp_path / "grey.png", np.full((3, 4), 255, np.uint8))
    assert np.array_equal(image.read_image(tmp_path / "grey.png"), np.ones((3, 4, 3)))
    iio.imwrite(tmp_path / "alpha.png", np.full((3, 4, 4), 255, np.uint8))
    assert image.read_image(tmp_path / "alpha.png").shape == (3, 4, 3)
    OpenEXR.File({}, {"Y": np.ones((3, 4), np.float32)}).write(str(tmp_path / "grey.exr"))
    assert image.read_image(tmp_path / "grey.exr").shape == (3, 4, 3)
    np.save(tmp_path / "grey.npy", np.ones((3, 4)))
    assert image.read_image(tmp_path / "grey.npy").shape == (3, 4, 3)


def test_a_film_is_read_as_its_mean(make_film, tmp_path: Path) -> None:
    film = make_film([(0, 40)])
    film.save(tmp_path / "a.npz")
    assert np.array_equal(read_image(tmp_path / "a.npz"), film.mean)
    np.savez(tmp_path / "b.npz", radiance=film.mean)
    assert np.array_equal(read_image(tmp_path / "b.npz"), film.mean)
    make_film([]).save(tmp_path / "empty.npz")
    with pytest.raises(ImageError, match=r"empty.npz: .*no path set"):
        read_image(tmp_path / "empty.npz")


@pytest.mark.parametrize("suffix", image.READABLE)
@pytest.mark.parametrize("content", [b"", b"hello"])
def test_a_broken_file_is_named(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=rf"broken{suffix}: cannot be read as {suffix}: \S"):
        read_image(path)
    with pytest.raises(ImageError, match=rf"broken{suffix}: cannot be read as {suffix}: \S"):
        image.read_image(path)


@pytest.mark.parametrize(
    ("mode", "white"),
    [("1", 1), ("L", 255), ("LA", (255, 9)), ("I;16", 65535), ("RGBA", (255, 255, 255, 3))],
)
def test_white_is_one_in_every_kind_of_png(tmp_path: Path, mode: str, white: object) -> None:
    Image.new(mode, (3, 2), white).save(tmp_path / "a.png")
    assert np.array_equal(image.read_image(tmp_path / "a.png"), np.ones((2, 3, 3)))


def test_a_jpeg_is_read_as_srgb_whatever_its_colour_model(tmp_path: Path) -> None:
    for mode, colour in (("RGB", (200, 100, 50)), ("L", 128), ("CMYK", (55, 155, 205, 0))):
        Image.new(mode, (16, 8), colour).save(tmp_path / "a.jpg", quality=95)
        expected = np.array([200, 100, 50] if mode != "L" else [128] * 3) / 255
        found = image.read_image(tmp_path / "a.jpg")
        assert found.shape == (8, 16, 3)
        np.testing.assert_allclose(encode_srgb(found), np.broadcast_to(expected, found.shape), atol=0.02)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".exr", ".hdr"])
def test_the_size_of_a_picture_is_in_its_header(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix == ".exr":
        write_exr(path, np.ones((4, 6, 3)), window=(2, 1, 6, 4), full_resolution=(9, 8))
    elif suffix == ".hdr":
        path.write_bytes(b"#?RADIANCE\n\n-Y 4 +X 6\n" + bytes(4 * 6 * 4))
    else:
        iio.imwrite(path, np.zeros((4, 6, 3), np.uint8))
    assert image.picture_size(path)[:2] == (6, 4) == image.read_image(path).shape[1::-1]
    for broken in (b"", b"hello", path.read_bytes()[:12]):
        path.write_bytes(broken)
        with pytest.raises(ImageError, match=rf"a{suffix}: cannot be read as {suffix}: \S"):
            image.picture_size(path)
    with pytest.raises(ImageError, match="there is no such file"):
        image.picture_size(tmp_path / f"missing{suffix}")


@pytest.mark.parametrize("kept", [600, 10_000, -1])
def test_a_cut_off_exr_is_named(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "cut.exr"
    write_exr(path, np.random.default_rng(3).random((40, 40, 3)))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ImageError, match=r"cut.exr: cannot be read"):
        image.read_image(path)


def test_what_cannot_be_read_says_what_can(tmp_path: Path) -> None:
    with pytest.raises(
        ImageError, match=r"a.gif: cannot read a .gif. Allowed: .png, .jpg, .jpeg, .exr, .hdr, .npz, .npy"
    ):
        image.read_image(tmp_path / "a.gif")
    with pytest.raises(ImageError, match="there is no such file"):
        image.read_image(tmp_path / "a.exr")
    np.save(tmp_path / "a.npy", np.ones((2, 3, 4, 5)))
    with pytest.raises(ImageError, match=r"found an array of shape \(2, 3, 4, 5\)"):
        image.read_image(tmp_path / "a.npy")


def test_small_png_of_many_pixels_is_refused(tmp_path: Path) -> None:
    Image.new("L", (8000, 2000)).save(tmp_path / "a.png")
    with pytest.raises(ImageError, match=r"bytes in it unfold to 0\.384 GB"):
        image.read_image(tmp_path / "a.png")
    assert image.read_eight_bits(tmp_path / "a.png").shape == (2000, 8000, 3)


@pytest.mark.parametrize("read", [image.read_image, read_picture])
def test_memory_of_decoded_pixels_is_limited_however_few_bits_they_have(
    read: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comment of 300 bytes does not pay for 10,000 pixels of one bit, which take 24 bytes each."""
    Image.new("1", (100, 100)).save(tmp_path / "a.png", pnginfo=text_of(300))
    Image.new("1", (100, 100)).save(tmp_path / "b.png", pnginfo=text_of(600))
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 1 << 10)
    with pytest.raises(ImageError, match=r"unfold to 0\.00024 GB; no more than 512 times is read"):
        read(tmp_path / "a.png")
    read(tmp_path / "b.png")


def text_of(size: int) -> PngInfo:
    info = PngInfo()
    info.add_text("Comment", "x" * size)
    return info


def test_jpeg_of_many_scans_is_refused_and_of_few_is_read(tmp_path: Path) -> None:
    few, many = write_jpeg_of_scans(tmp_path / "a.jpg", 1), write_jpeg_of_scans(tmp_path / "b.jpg", 100)
    assert image.read_image(few).shape == Pictures(tmp_path).read("a.jpg").shape == (16, 16, 3)
    for read in (
        image.read_image,
        image.read_eight_bits,
        read_picture,
        lambda path: Pictures(path.parent).read("b.jpg"),
    ):
        with pytest.raises((ImageError, UnusableError), match="it is a JPEG of more than 100 scans"):
            read(many)


def test_exr_of_very_many_channels_or_attributes_is_refused(tmp_path: Path) -> None:
    path, radiance = tmp_path / "a.exr", np.zeros((2, 2, 3))
    write_exr(path, radiance, {f"a{i}": "b" for i in range(1000)})
    assert image.read_image(path).shape == (2, 2, 3)
    content = path.read_bytes()
    attribute = b"a\0string\0" + struct.pack("<I", 1) + b"b"
    channels = b"".join(b"c%d\0" % i + struct.pack("<iiii", 2, 0, 1, 1) for i in range(5000)) + b"\0"
    for added in (attribute * 5000, b"channels\0chlist\0" + struct.pack("<I", len(channels)) + channels):
        path.write_bytes(content[:8] + added + content[8:])
        with pytest.raises(ImageError, match="its header has more than 4,096 attributes and channels"):
            image.read_image(path)


@pytest.mark.parametrize("kind", [OpenEXR.deepscanline, OpenEXR.deeptile])
def test_deep_parts_of_an_exr_are_refused(
    kind: OpenEXR.Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_exr(tmp_path / "a.exr", np.zeros((2, 2, 3)))
    flat = OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).parts[0]
    deep = SimpleNamespace(header={**flat.header, "type": kind})
    monkeypatch.setattr(OpenEXR, "File", lambda *_, **__: SimpleNamespace(parts=[flat, deep]))
    for read in (image.read_image, image.picture_size, read_exr_channels):
        with pytest.raises(ImageError, match="its part 2 has deep pixels, but only flat pixels are read"):
            read(tmp_path / "a.exr")


def test_an_animated_png_is_its_first_frame(tmp_path: Path) -> None:
    frames = [Image.new("RGB", (3, 2), (level, 0, 0)) for level in (255, 0, 9)]
    frames[0].save(tmp_path / "a.png", save_all=True, append_images=frames[1:])
    np.testing.assert_array_equal(image.read_image(tmp_path / "a.png"), np.broadcast_to([1.0, 0, 0], (2, 3, 3)))


def test_later_parts_of_an_exr_count_against_the_limit_of_unfolded_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts, display = [], (np.zeros(2, np.int32), np.full(2, 255, np.int32))
    for name, side in (("a", 16), ("b", 256)):
        window = np.zeros(2, np.int32), np.full(2, side - 1, np.int32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        header |= {"dataWindow": window, "displayWindow": display}
        channels = {channel: np.zeros((side, side), np.float32) for channel in "RGB"}
        parts.append(OpenEXR.Part(header, channels, name))
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    assert image.read_image(tmp_path / "a.exr").shape == (16, 16, 3)
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 1 << 16)
    with pytest.raises(ImageError, match=r"a\.exr: .* unfold to .* GB; no more than 64 times is read"):
        image.read_image(tmp_path / "a.exr")


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path, stop: type[BaseException]) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    folders = []

    def write_half() -> None:
        with files.whole_file(path) as temporary:
            folders.append(temporary.parent)
            temporary.write_bytes(b"half")
            raise stop

    with pytest.raises(stop):
        write_half()
    assert folders == [tmp_path]
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.png"]


def test_a_written_file_has_the_usual_permissions_and_missing_folders_are_made(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.png"
    image.write_png(path, np.zeros((1, 1, 3), np.uint8))
    (tmp_path / "plain").touch()
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)
    assert os.listdir(path.parent) == ["a.png"]


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to(tmp_path / "real.png")
    image.write_png(tmp_path / "link.png", np.zeros((1, 1, 3), np.uint8))
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "real.png").is_file()


def test_whether_a_file_can_be_written_is_known_before(tmp_path: Path) -> None:
    files.check_writable(tmp_path / "new" / "folder" / "a.png")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(ImageError, match="is a file, but a folder of this name is needed"):
        files.check_writable(tmp_path / "file" / "a.png")
    with pytest.raises(ImageError, match="cannot be written"):
        write_exr(tmp_path / "file" / "a.exr", np.ones((1, 1, 3)))
    with pytest.raises(ImageError, match="is a folder"):
        files.check_writable(tmp_path)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder where not even root can write")
def test_a_folder_that_refuses_files_is_known_before() -> None:
    with pytest.raises(ImageError, match=r"/proc/self/a.png: the folder .* cannot be written to"):
        files.check_writable("/proc/self/a.png")


def test_auto_exposure_follows_its_rule() -> None:
    grey = np.full((8, 8, 3), 0.18 / 4)
    assert auto_exposure(grey) == 2.0
    framed = np.zeros((16, 16, 3))
    framed[4:12, 4:12] = grey
    assert auto_exposure(framed) == 2.0, "what has no light does not count"
    lamp = grey.copy()
    lamp[0, 0] = 1e4
    assert abs(auto_exposure(lamp) - 2.0) <= 0.25, "a lamp in view changes little"
    assert auto_exposure(np.full((4, 4, 3), 0.9)) == 0.0, "a bright picture stays bright"
    assert auto_exposure(np.full((4, 4, 3), 8.0)) == -3.0, "until its 99th percentile is white"
    assert auto_exposure(np.zeros((4, 4, 3))) == 0.0
    spark = np.zeros((16, 16, 3))
    spark[0, 0] = 0.18
    assert auto_exposure(spark) == 0.0, "less than a hundredth of it has light"


def test_auto_exposure_scales_with_the_light_and_hears_no_noise() -> None:
    rng = np.random.default_rng(1)
    radiance = rng.lognormal(-3, 1, (64, 64, 3))
    noisy = radiance * rng.uniform(0.9, 1.1, radiance.shape)
    assert auto_exposure(radiance / 8) == auto_exposure(radiance) + 3
    assert abs(auto_exposure(noisy) - auto_exposure(radiance)) <= 0.25


@pytest.mark.parametrize("name", ["a" * 251, "a" * 240, "\u00fc" * 125])
def test_a_name_of_the_longest_kind_is_written(name: str, tmp_path: Path) -> None:
    """Linux takes 255 bytes. Names of temporary files, locks and checkpoints, which are longer, are shortened."""
    path = tmp_path / f"{name}.png"
    files.check_writable(path)
    part = files.new_file(tmp_path, path)  # as a process leaves that is killed
    files.remove_parts(path)
    assert not part.exists()
    checkpoint = checkpoint_path([path])
    for file in (path, checkpoint):
        with Lock(file, "a test"), files.whole_file(file) as temporary:
            temporary.write_bytes(b"whole")
    assert {file.read_bytes() for file in tmp_path.iterdir() if file.suffix != ".lock"} == {b"whole"}
    assert len([file for file in tmp_path.iterdir() if file.suffix != ".lock"]) == 2
    assert checkpoint != checkpoint_path([tmp_path / f"{name[:-1]}b.png"])


def test_a_part_that_is_being_written_is_not_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    left = files.new_file(tmp_path, path)
    with files.whole_file(path) as temporary:
        code = "import sys; from glpath.system.files import remove_parts; remove_parts(sys.argv[1])"
        subprocess.run([sys.executable, "-c", code, str(path)], check=True)
        assert (left.exists(), temporary.exists()) == (False, True)
        temporary.write_bytes(b"whole")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == {"a.npz": b"whole"}


def test_a_relative_output_in_a_deleted_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "deleted"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    try:
        for use in (files.check_writable, lambda path: files.write_bytes(b"", path), lambda path: Lock(path, "it")):
            with pytest.raises(ImageError, match=r"a.png: the current folder was deleted"):
                use(Path("a.png"))
        files.write_bytes(b"", tmp_path / "a.png")
    finally:
        os.chdir(tmp_path)


@pytest.mark.parametrize("length", [252, 300, 5000])
def test_a_name_that_is_too_long_is_found_before_the_work(length: int, tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="File name too long"):
        files.check_writable(tmp_path / f"{'a' * length}.png")
    assert list(tmp_path.iterdir()) == []


def test_levels_are_looked_up_to_the_bit() -> None:
    levels = np.random.default_rng(0).integers(0, 256, (37, 41, 3), np.uint8)
    assert np.array_equal(decode_levels(levels), decode_srgb(levels / 255))


def test_a_jpeg_has_the_pixels_of_the_png_and_its_metadata(make_film: MakeFilm, tmp_path: Path) -> None:
    film = make_film(size=(64, 48))
    for name in ("a.png", "a.jpg", "b.jpeg"):
        film.save(tmp_path / name, exposure=0.0)
    jpeg = iio.imread(tmp_path / "a.jpg")
    assert jpeg.shape == (48, 64, 3)
    assert jpeg.mean(axis=(0, 1)) == pytest.approx(iio.imread(tmp_path / "a.png").mean(axis=(0, 1)), abs=1.0)
    assert (tmp_path / "a.jpg").read_bytes() == (tmp_path / "b.jpeg").read_bytes()
    with Image.open(tmp_path / "a.jpg") as opened, Image.open(tmp_path / "a.png") as other:
        assert opened.format == "JPEG"
        assert json.loads(opened.info["comment"]) == other.text


def test_a_smooth_picture_loses_hardly_anything_in_a_jpeg(tmp_path: Path) -> None:
    y, x = np.mgrid[0:64, 0:96]
    smooth = np.stack([2 * x, 3 * y, 255 - x - y], axis=2).astype(np.uint8)
    image.write_jpeg(tmp_path / "a.jpg", smooth)
    off = np.abs(iio.imread(tmp_path / "a.jpg").astype(int) - smooth)
    assert off.max() <= 6
    assert off.mean() < 1


def test_what_is_transparent_is_white_in_a_jpeg(tmp_path: Path) -> None:
    clear = np.zeros((16, 16, 4), np.uint8)
    clear[:, :8] = (200, 0, 0, 255)
    image.write_jpeg(tmp_path / "a.jpg", clear)
    seen = iio.imread(tmp_path / "a.jpg").astype(int)
    assert np.abs(seen[4, 12] - 255).max() <= 4
    assert np.abs(seen[4, 3] - [200, 0, 0]).max() <= 8


def test_a_picture_that_no_jpeg_can_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="65,535 along a side at most"):
        image.write_jpeg(tmp_path / "a.jpg", np.zeros((1, 65_536, 3), np.uint8))


COLOURS, LEVELS = np.ones((4, 4, 3)), np.zeros((4, 4, 3), np.uint8)


@pytest.mark.parametrize(
    "call",
    [
        lambda path: luminance("x"),
        lambda path: luminance(np.ones((4, 4))),
        lambda path: auto_exposure(np.ones((4, 4))),
        lambda path: decode_srgb("x"),
        lambda path: encode_srgb(None),
        lambda path: tonemap(COLOURS, "x"),
        lambda path: tonemap(COLOURS, math.nan),
        lambda path: tonemap(COLOURS, 0, ["srgb"]),
        lambda path: tonemap(np.ones((4, 4))),
        lambda path: image.encode_png(COLOURS),
        lambda path: image.encode_png(np.zeros((0, 0, 3), np.uint8)),
        lambda path: image.encode_png(LEVELS, {"a": 5}),
        lambda path: image.encode_png(LEVELS, {"a": "\ud800"}),
        lambda path: image.write_png(path / "a.png", COLOURS),
        lambda path: image.write_png(path / "a\0.png", LEVELS),
        lambda path: write_exr(None, COLOURS),
        lambda path: write_exr(path / "a.exr", np.ones((4, 4))),
        lambda path: write_exr(path / "a.exr", COLOURS, window=(2**62, 0, 4, 4)),
        lambda path: write_exr(path / "a.exr", COLOURS, alpha=np.ones((2, 2))),
        lambda path: image.read_image(path / "a\0.png"),
    ],
)
def test_wrong_arguments_of_image_functions_are_refused(call: Any, tmp_path: Path) -> None:
    with pytest.raises(GlpathError) as error:
        call(tmp_path)
    assert not isinstance(error.value.__cause__, TypeError)
    assert not list(tmp_path.iterdir())


def test_a_float_picture_as_a_png_has_a_remedy() -> None:
    with pytest.raises(ImageError, match=r"float64, expected \(H, W, 3\) of uint8.\n  .*tonemap"):
        image.encode_png(COLOURS)  # type: ignore[arg-type]


def test_srgb_functions_keep_the_type_of_arrays() -> None:
    assert decode_srgb(np.ones(3, np.float32)).dtype == np.float32
    assert encode_srgb([0.0, 1.0]).tolist() == pytest.approx([0.0, 1.0])  # type: ignore[arg-type]
