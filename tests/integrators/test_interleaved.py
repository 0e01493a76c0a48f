"""Pictures made as four of every second pixel: the pixels are right, and a denoiser has noise to remove."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.errors import UsageError
from glpath.film.aovs import DENOISER_AOVS
from glpath.gl.camera import eye_uniforms, of_every_second
from glpath.io import load_scene

BOX = load_scene("cornell-box-36").with_camera(resolution=(65, 47))


def slopes(eye: dict[str, object], pixel: tuple[int, int]) -> np.ndarray:
    """Right and up of the ray through a pixel, as shaders/camera/camera.glsl has it."""
    corner, centre = np.array(eye["eye_corner"]), np.array(eye["eye_centre"])
    return (np.array(pixel) + corner + 0.5 - centre) / eye["eye_focal"]


@pytest.mark.parametrize("offset", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_rays_of_every_second_pixel_are_those_of_the_window(offset: tuple[int, int]) -> None:
    whole = eye_uniforms(BOX.camera, (3, 5, 40, 31), (0.3, 0.8))
    part = of_every_second(whole, offset, (20, 15))
    for pixel in [(0, 0), (7, 4), (19, 14)]:
        beside = (2 * pixel[0] + offset[0], 2 * pixel[1] + offset[1])
        np.testing.assert_allclose(slopes(part, pixel), slopes(whole, beside), rtol=1e-12)


@pytest.mark.parametrize("given", [{"integrator": "path-buffer"}, {"integrator": "gather", "cast": "path-buffer"}])
def test_the_picture_is_that_of_all_pixels(given: dict[str, str]) -> None:
    """Of an odd size, where the four differ in theirs. What the eye sees has no noise but at edges."""
    plain, four = (
        glpath.render(BOX, spp=32, aovs=DENOISER_AOVS, interleave=how, **given) for how in ("never", "always")
    )
    same = np.abs(plain.aov("albedo") - four.aov("albedo")).max(axis=2) < 1e-3
    assert same.mean() > 0.8
    # Whole edges would differ if a quarter were a pixel off.
    assert np.abs(plain.aov("albedo") - four.aov("albedo")).mean() < 0.005
    assert four.mean.mean() == pytest.approx(plain.mean.mean(), rel=0.02)


@pytest.mark.parametrize("crop", [(20, 10, 1, 12), (20, 10, 12, 1), (20, 10, 1, 1)])
def test_windows_one_pixel_wide_are_columns_and_rows_of_the_picture(crop: tuple[int, int, int, int]) -> None:
    given: dict[str, Any] = {"integrator": "path-buffer", "max_depth": 1, "spp": 8, "aovs": ("albedo",)}
    x, y, width, height = crop
    part = glpath.render(BOX, crop=crop, interleave="always", **given).aov("albedo")
    plain = glpath.render(BOX, interleave="never", **given).aov("albedo")
    np.testing.assert_allclose(part, plain[y : y + height, x : x + width], atol=0.05)


def test_a_denoiser_removes_what_shared_directions_leave() -> None:
    pytest.importorskip("pyoidn", reason="needs the denoise extra")
    given = {"integrator": "path-buffer", "max_depth": 3, "aovs": DENOISER_AOVS}
    scene = BOX.with_camera(resolution=(128, 128))
    truth = glpath.render(scene, integrator="path", max_depth=3, spp=128, seed=9).mean
    plain, four = (
        relative_mse(glpath.render(scene, spp=16, interleave=how, **given).denoised(), truth)
        for how in ("never", "always")
    )
    assert four < 0.6 * plain


def test_path_sets_add_up_to_the_same_bits() -> None:
    given = {"integrator": "path-buffer", "max_depth": 2, "interleave": "always"}
    whole = glpath.render(BOX, spp=6, **given)
    first, rest = (glpath.render(BOX, spp=n, first_path_set=start, **given) for start, n in ((0, 2), (2, 4)))
    np.testing.assert_array_equal(first.merge(rest).radiance_sums, whole.radiance_sums)


def test_pictures_to_be_denoised_are_interleaved_by_default() -> None:
    def recorded(**given: object) -> object:
        film = glpath.render(BOX, integrator="path-buffer", max_depth=1, spp=1, **given)
        return film.metadata.settings.get("interleave")

    assert recorded(aovs=DENOISER_AOVS) == "always"
    assert recorded() is None
    assert recorded(aovs=DENOISER_AOVS, interleave="never") is None
    # 36 triangles are many beside 64 pixels.
    assert recorded(aovs=DENOISER_AOVS, resolution=(8, 8)) is None


def test_points_are_not_interleaved() -> None:
    with pytest.raises(UsageError, match=r"interleave.*points"):
        glpath.irradiance(BOX, [[0.0, 0.1, 0.0]], [0.0, 1.0, 0.0], integrator="path-buffer", interleave="always")
