"""Pixels that share random numbers are apart, and each pixel has its own sums, whatever the window."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.lanes import LANES, STRIDE, fragments_of_pixels
from glpath.integrators.ray_paths import RayPathEngine

TILE = (LANES[0] * STRIDE, LANES[1] * STRIDE)
# A white wall under a lamp on one side: all pixels have nearly the same light, but for noise.
WALL: dict[str, Any] = {
    "camera": {"position": [0, 0, 3], "target": [0, 0, 0], "fov": 20},
    "materials": {"white": {"reflectance": [0.7, 0.7, 0.7]}},
    "shapes": [
        {"type": "quad", "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], "material": "white"},
        {
            "type": "quad",
            "corners": [[-4, 5, 4], [4, 5, 4], [4, 5, 8], [-4, 5, 8]],
            "emission": {"radiance": [9, 9, 9]},
            "material": "white",
        },
    ],
}


@pytest.mark.parametrize("size", [TILE, (3 * TILE[0], 2 * TILE[1]), (77, 45), (5, 3), (1, 1)])
def test_every_pixel_is_traced_by_one_fragment(size: tuple[int, int]) -> None:
    fragments = fragments_of_pixels(size)
    assert fragments.shape == size[::-1]
    assert sorted(fragments.ravel().tolist()) == list(range(size[0] * size[1]))


def test_a_vector_of_lanes_traces_pixels_that_are_apart() -> None:
    fragments = fragments_of_pixels(TILE)
    vector = [y * TILE[0] + x for y in range(LANES[1]) for x in range(LANES[0])]
    y, x = np.nonzero(np.isin(fragments, vector))
    assert sorted(zip(x.tolist(), y.tolist(), strict=True)) == [
        (STRIDE * i, STRIDE * j) for i in range(LANES[0]) for j in range(LANES[1])
    ]


def test_neighbours_have_nothing_in_common_and_lanes_their_noise() -> None:
    width, height = 2 * TILE[0], 2 * TILE[1]
    film = glpath.render(WALL, resolution=(width, height), integrator="path", spp=1, max_depth=1)
    noise = film.mean[..., 0]
    noise = (noise - noise.mean()) / noise.std()

    def correlation(dx: int, dy: int) -> float:
        # Within a tile: pixels of two tiles share nothing.
        tiles = noise.reshape(2, TILE[1], 2, TILE[0]).transpose(0, 2, 1, 3)
        return float(np.mean(tiles[..., dy:, dx:] * tiles[..., : TILE[1] - dy, : TILE[0] - dx]))

    assert abs(correlation(1, 0)) < 0.15
    assert abs(correlation(0, 1)) < 0.15
    assert abs(correlation(STRIDE - 1, 0)) < 0.15
    assert correlation(STRIDE, 0) > 0.6
    assert correlation(0, STRIDE) > 0.6


@pytest.mark.parametrize("integrator", ["path", "gather"])
def test_a_crop_has_the_bits_of_the_whole_picture(integrator: str) -> None:
    options: dict[str, Any] = {"integrator": integrator, "resolution": (83, 51), "spp": 2, "aovs": ("direct",)}
    whole = glpath.render("cornell-box-36", **options)
    part = glpath.render("cornell-box-36", crop=(13, 9, 55, 37), **options)
    assert np.array_equal(part.mean, whole.mean[9:46, 13:68])
    assert np.array_equal(part.aov("direct"), whole.aov("direct")[9:46, 13:68])


def test_the_mean_of_a_picture_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"integrator": "path", "resolution": (64, 64), "spp": 64, "max_depth": 4}
    shared = glpath.render("cornell-box-36", **options)
    monkeypatch.setattr(RayPathEngine, "_shares_lanes", False)
    own = glpath.render("cornell-box-36", **options)
    blocks = [film.mean.reshape(8, 8, 8, 8, 3).mean(axis=(1, 3)) for film in (shared, own)]
    assert np.abs(blocks[0] / blocks[1] - 1).mean() < 0.02
    assert blocks[0].mean() == pytest.approx(blocks[1].mean(), rel=3e-3)
