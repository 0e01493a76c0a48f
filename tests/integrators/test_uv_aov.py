"""The AOV "uv": texture coordinates of what the eye sees, by every engine, with and without a texture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from tests.support.engines import coarse

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
SCENE: dict[str, Any] = {
    "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 40},
    "materials": {"grey": {"reflectance": 0.5}},
    "sky": {"zenith": [1, 1, 1], "horizon": 1},
    "shapes": [
        {
            "type": "mesh",
            "material": "grey",
            "vertices": SQUARE,
            "faces": np.array([[0, 1, 2], [0, 2, 3]]),
            # As of a tiled floor: far from 0, and negative.
            "uv": 100.0 * SQUARE[:, :2] + [1, -600],
        }
    ],
}
ENGINES = ["path", "path-buffer", "gather", "t-buffer", "classic"]


@pytest.mark.parametrize("integrator", ENGINES)
def test_coordinates_of_a_square_that_has_no_texture(integrator: str) -> None:
    options: dict[str, Any] = {"integrator": integrator}
    if integrator == "gather":
        options["radiosity"] = coarse(glpath.load_scene(SCENE))
    film = glpath.render(SCENE, spp=8, resolution=(40, 30), aovs=("uv", "position", "depth"), **options)
    uv, position = film.aov("uv"), film.aov("position")
    assert uv.shape == (30, 40, 2)
    assert uv.dtype == np.float64
    seen = film.aov("depth") < 1e9
    assert seen.sum() > 150
    assert uv[seen] == pytest.approx(100 * position[seen][:, :2] + [1, -600], abs=1e-4)
    assert not uv[~seen].any()


def test_coordinates_beyond_4096_are_clamped_as_documented() -> None:
    (square,) = SCENE["shapes"]
    far = {**SCENE, "shapes": [{**square, "uv": 0.0 * SQUARE[:, :2] + [5000, -5000]}]}
    film = glpath.render(far, integrator="path", guide="cosine", spp=1, resolution=(3, 3), aovs=("uv",))
    assert film.aov("uv")[1, 1] == pytest.approx([4096, -4096], abs=1e-3)


def test_coordinates_go_into_an_exr_and_parts_of_a_film_add_up(tmp_path: Any) -> None:
    import OpenEXR

    options: dict[str, Any] = {"resolution": (20, 15), "aovs": ("uv",), "integrator": "path"}
    whole = glpath.render(SCENE, spp=16, **options)
    whole.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = file.channels()
        found = np.stack([channels[f"uv.{letter}"].pixels for letter in "XY"], axis=-1)
    assert found == pytest.approx(whole.aov("uv"), rel=1e-6)
    parts = [glpath.render(SCENE, spp=8, first_path_set=first, **options) for first in (0, 8)]
    assert np.array_equal(parts[0].merge(parts[1]).aov("uv"), whole.aov("uv"))
