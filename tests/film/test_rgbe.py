"""Radiance's pictures: every way of writing lines, orders of rows and columns, and files that are damaged."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.film.image import read_image
from glpath.film.rgbe import read_rgbe
from tests.support.rgbe_files import colours, run_lengths

HEAD = b"#?RADIANCE\n# made by a test\nFORMAT=32-bit_rle_rgbe\n"


def pixels(height: int = 5, width: int = 40) -> NDArray[np.uint8]:
    """Noise, and runs of all lengths."""
    rng = np.random.default_rng(height * width)
    noise = rng.integers(0, 256, (height, width, 4), np.uint8)
    held = np.repeat(noise, rng.integers(1, 300, width), axis=1)[:, :width]
    return np.where(rng.random((height, 1, 4)) < 0.5, noise, held)


def repeats(rgbe: NDArray[np.uint8]) -> bytes:
    """Whole pixels, equal ones counted by (1, 1, 1, n), in bytes from the lowest on."""
    out = bytearray()
    for line in rgbe:
        at = 0
        while at < len(line):
            same = 1
            while at + same < len(line) and np.array_equal(line[at + same], line[at]):
                same += 1
            out += bytes(line[at])
            count = same - 1
            while count:
                out += bytes([1, 1, 1, count & 255])
                count >>= 8
            at += same
    return bytes(out)


@pytest.mark.parametrize("write", [np.ndarray.tobytes, run_lengths, repeats])
@pytest.mark.parametrize("size", [(1, 1), (3, 7), (4, 8), (5, 40), (2, 1000)])
def test_every_way_of_writing_lines_is_read(tmp_path: Path, write, size: tuple[int, int]) -> None:
    rgbe = pixels(*size)
    rgbe[(rgbe[..., :3] == 1).all(axis=2) | (rgbe[..., :2] == 2).all(axis=2)] = 7  # mean something else
    if write is run_lengths and size[1] < 8:
        pytest.skip("such lines are not encoded")
    path = tmp_path / "a.hdr"
    path.write_bytes(HEAD + b"\n-Y %d +X %d\n" % size + write(rgbe))
    assert np.array_equal(read_image(path), colours(rgbe).astype(np.float32))


def test_one_is_one_and_a_dark_exponent_is_black(tmp_path: Path) -> None:
    path = tmp_path / "a.hdr"
    path.write_bytes(HEAD + b"\n-Y 1 +X 3\n" + bytes([128, 64, 0, 129, 255, 255, 255, 0, 200, 0, 0, 140]))
    np.testing.assert_array_equal(read_rgbe(path)[0], [[[1, 0.5, 0], [0, 0, 0], [3200, 0, 0]]])


@pytest.mark.parametrize(("order", "turned"), [(b"-Y 5 -X 40", np.s_[:, ::-1]), (b"+Y 5 +X 40", np.s_[::-1])])
def test_rows_and_columns_go_as_the_header_says(tmp_path: Path, order: bytes, turned) -> None:
    rgbe = pixels()
    (tmp_path / "a.hdr").write_bytes(HEAD + b"\n" + order + b"\n" + run_lengths(rgbe))
    assert np.array_equal(read_rgbe(tmp_path / "a.hdr")[0], colours(rgbe)[turned].astype(np.float32))


def test_the_exposures_of_the_header_are_undone(tmp_path: Path) -> None:
    rgbe = pixels()
    text = HEAD + b"EXPOSURE=4\nEXPOSURE= 0.5\n\n-Y 5 +X 40\n"
    (tmp_path / "a.hdr").write_bytes(text + run_lengths(rgbe))
    np.testing.assert_allclose(read_rgbe(tmp_path / "a.hdr")[0], colours(rgbe) / 2, rtol=1e-6)


def test_the_colour_corrections_of_the_header_are_undone(tmp_path: Path) -> None:
    rgbe = pixels()
    text = HEAD + b"EXPOSURE=2\nCOLORCORR= 2 0.5 1\nCOLORCORR= 1 1 4\n\n-Y 5 +X 40\n"
    (tmp_path / "a.hdr").write_bytes(text + run_lengths(rgbe))
    np.testing.assert_allclose(read_image(tmp_path / "a.hdr"), colours(rgbe) / [4, 1, 8], rtol=1e-6)


def test_the_primaries_of_the_header_are_converted(tmp_path: Path) -> None:
    """Red of Display P3 is (1.2249, -0.0420, -0.0196) of Rec. 709, and white is white."""
    text = HEAD + b"PRIMARIES= 0.680 0.320 0.265 0.690 0.150 0.060 0.3127 0.3290\n\n-Y 1 +X 2\n"
    (tmp_path / "a.hdr").write_bytes(text + bytes([128, 0, 0, 129, 128, 128, 128, 129]))
    np.testing.assert_allclose(
        read_image(tmp_path / "a.hdr")[0], [[1.2249, -0.0420, -0.0196], [1, 1, 1]], atol=1e-4
    )
    np.testing.assert_array_equal(read_image(tmp_path / "a.hdr", colours=False)[0, 0], [1, 0, 0])


@pytest.mark.parametrize("value", [b"0 0 0 0 0 0 0 0", b"0.64 0.33", b"unknown"])
def test_primaries_that_are_not_stated_are_those_of_rec_709(value: bytes, tmp_path: Path) -> None:
    """Photoshop and ImageMagick write eight zeros."""
    pixels = b"\n-Y 1 +X 1\n" + bytes([128, 64, 0, 129])
    (tmp_path / "a.hdr").write_bytes(HEAD + b"PRIMARIES=" + value + b"\n" + pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.hdr")[0, 0], [1, 0.5, 0])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"P6 3 4", "does not begin with #[?]RADIANCE"),
        (HEAD.replace(b"rgbe", b"xyze") + b"\n-Y 1 +X 1\n" + bytes(4), "FORMAT is 32-bit_rle_xyze"),
        (HEAD + b"EXPOSURE=0\n\n-Y 1 +X 1\n" + bytes(4), "EXPOSURE times COLORCORR is 0"),
        (HEAD + b"EXPOSURE=bright\n\n-Y 1 +X 1\n" + bytes(4), "EXPOSURE=bright has not 1 finite"),
        (HEAD + b"\n+X 4 -Y 3\n" + bytes(48), "size is '[+]X 4 -Y 3'"),
        (HEAD + b"\n-Y 0 +X 1\n", "1 x 0 pixels"),
        (HEAD + b"\n-Y 99999999 +X 99999999\n" + bytes(99), "unfold"),
        (HEAD + b"x" * 100_000, "no end|size is"),
        (HEAD + b"\n-Y 5 +X 40\n" + bytes(4 * 5 * 40 - 1), "cut off"),
        (HEAD + b"\n-Y 5 +X 40\n" + run_lengths(pixels())[:-1], "cut off"),
        (HEAD + b"\n-Y 5 +X 40\n" + run_lengths(pixels())[:300], "cut off"),
        (HEAD + b"\n-Y 1 +X 40\n" + bytes([2, 2, 0, 41, 168, 1]), "41 pixels long, expected 40"),
        (HEAD + b"\n-Y 1 +X 40\n" + bytes([2, 2, 0, 40, 169, 1, 0, 0]), "beyond its line"),
        (HEAD + b"\n-Y 1 +X 40\n" + bytes([2, 2, 0, 40, 0, 1]), "no length"),
        (HEAD + b"\n-Y 1 +X 9\n" + bytes([9, 9, 9, 9, 1, 1, 1, 9]), "beyond its line"),
        (HEAD + b"\n-Y 1 +X 9\n" + bytes([1, 1, 1, 9]), "repeats nothing"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, content: bytes, expected: str) -> None:
    (tmp_path / "a.hdr").write_bytes(content)
    with pytest.raises(ImageError, match=rf"a.hdr: cannot be read as .hdr: .*({expected})"):
        read_image(tmp_path / "a.hdr")


@pytest.mark.parametrize("repeated", [False, True])
def test_many_narrow_lines_are_read_in_a_moment(repeated: bool, tmp_path: Path) -> None:
    """The last line of the second picture repeats a pixel."""
    rgbe = np.full((200_000, 2, 4), 7, np.uint8)
    rgbe[:, 0, 0] = np.arange(len(rgbe)) % 251
    content = rgbe.tobytes()
    if repeated:
        content = content[:-4] + bytes([1, 1, 1, 1])
        rgbe[-1, 1] = rgbe[-1, 0]
    (tmp_path / "a.hdr").write_bytes(HEAD + b"\n-Y 200000 +X 2\n" + content)
    start = time.process_time()
    found = read_rgbe(tmp_path / "a.hdr")[0]
    assert time.process_time() - start < 0.7
    np.testing.assert_array_equal(found, np.ldexp(rgbe[..., :3].astype(np.float32), 7 - 136))


def test_a_flat_line_may_stand_beside_encoded_ones(tmp_path: Path) -> None:
    rgbe = pixels(4, 40)
    rgbe[(rgbe[..., :3] == 1).all(axis=2) | (rgbe[..., :2] == 2).all(axis=2)] = 7
    lines = [rgbe[:2].tobytes(), run_lengths(rgbe[2:3]), repeats(rgbe[3:])]
    (tmp_path / "a.hdr").write_bytes(HEAD + b"\n-Y 4 +X 40\n" + b"".join(lines) + bytes(640))
    np.testing.assert_array_equal(read_rgbe(tmp_path / "a.hdr")[0], colours(rgbe).astype(np.float32))
