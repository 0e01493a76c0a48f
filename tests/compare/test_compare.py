"""The numbers that compare pictures, against arithmetic done by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from glpath import compare
from glpath.errors import ImageError, UsageError

REFERENCE = np.full((2, 3, 3), 0.3)
IMAGE = REFERENCE + np.where(np.arange(3) == 0, 0.1, 0.0)  # red is 0.1 too bright


def test_the_measures_are_what_they_say() -> None:
    assert compare.mse(IMAGE, REFERENCE) == pytest.approx(0.01 / 3)
    assert compare.relative_mse(IMAGE, REFERENCE) == pytest.approx(0.01 / 3 / (0.09 + 0.01))
    assert compare.psnr(IMAGE, REFERENCE) == pytest.approx(10 * math.log10(0.09 / (0.01 / 3)))
    assert compare.psnr(IMAGE, REFERENCE, peak=1.0) == pytest.approx(10 * math.log10(300))
    assert compare.max_difference(REFERENCE, IMAGE) == pytest.approx(0.1)
    assert compare.mean_ratio(IMAGE, REFERENCE) == pytest.approx(1 / 0.9)


def test_equal_pictures_have_no_difference() -> None:
    assert compare.relative_mse(IMAGE, IMAGE) == 0
    assert compare.psnr(IMAGE, IMAGE) == math.inf
    assert compare.mean_ratio(IMAGE, IMAGE) == 1
    picture, scale = compare.difference_image(IMAGE, IMAGE)
    assert (picture == 247).all()
    assert scale > 0


def test_black_pictures_do_not_divide_by_zero() -> None:
    black = np.zeros((2, 3, 3))
    assert compare.relative_mse(black, black) == 0
    assert math.isnan(compare.mean_ratio(black, black))
    assert compare.mean_ratio(IMAGE, black) == math.inf
    assert compare.psnr(IMAGE, black) == -math.inf


def test_tiny_values_have_their_measures() -> None:
    """20 log10(peak / difference), although the squares of both are 0 in float64."""
    small, ones = np.full((2, 3, 3), 1e-200), np.ones((2, 3, 3))
    assert compare.psnr(2 * small, small) == pytest.approx(0.0, abs=1e-9)
    assert compare.psnr(ones, small) == pytest.approx(-4000.0)
    assert compare.psnr(ones, np.zeros((2, 3, 3)), peak=1e-170) == pytest.approx(-3400.0)
    assert compare.psnr(np.zeros((2, 3, 3)), small, peak=1.0) == pytest.approx(4000.0)
    for measure in (compare.relative_mse, lambda a, b, epsilon: compare.difference_image(a, b, epsilon=epsilon)):
        with pytest.raises(UsageError, match="epsilon: 0 where a number above 0 is needed, because the squares of"):
            measure(small, small, epsilon=0.0)


def test_too_bright_is_red_and_too_dark_is_blue() -> None:
    image = REFERENCE.copy()
    image[0, 0] += 0.1
    image[1, 1] -= 0.1
    picture, scale = compare.difference_image(image, REFERENCE, scale=0.05)
    assert scale == 0.05
    assert picture[0, 0].tolist() == [178, 24, 43]
    assert picture[1, 1].tolist() == [33, 102, 172]
    assert picture[0, 1].tolist() == [247, 247, 247]
    with pytest.raises(UsageError, match="above 0"):
        compare.difference_image(image, REFERENCE, scale=0)


@pytest.mark.parametrize("limit", [np.nan, np.inf, -1.0])
def test_a_limit_of_differences_is_a_finite_number_from_0(limit: float) -> None:
    assert compare.percent_beyond(IMAGE, IMAGE, 0.0) == 0.0
    with pytest.raises(UsageError, match=r"limit: .* where a finite number from 0"):
        compare.percent_beyond(IMAGE, REFERENCE, limit)


@pytest.mark.parametrize("measure", [compare.mse, compare.relative_mse, compare.psnr, compare.mean_ratio])
def test_pictures_of_two_sizes_or_with_nan_are_refused(measure) -> None:
    with pytest.raises(ImageError, match="the picture is 3 x 2 and the reference 2 x 3"):
        measure(IMAGE, REFERENCE.swapaxes(0, 1))
    broken = IMAGE.copy()
    broken[0, 0] = np.nan
    with pytest.raises(ImageError, match="1 pixels of the picture are NaN or infinite"):
        measure(broken, REFERENCE)
    broken[0, 0] = 1e200  # whose square is no float64
    with pytest.raises(ImageError, match=r"1 pixels of the picture are .* beyond 1e\+150"):
        measure(broken, REFERENCE)
    with pytest.raises(ImageError, match=r"expected \(H, W, 3\)"):
        measure(np.ones((2, 3)), np.ones((2, 3)))
