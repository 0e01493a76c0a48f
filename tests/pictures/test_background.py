"""A background of its own, in every engine: the eye sees it, mirrors and light do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.exr import read_exr_channels
from glpath.film.image import read_eight_bits
from glpath.scene import Background, Scene

ENGINES: list[dict[str, Any]] = [
    {"integrator": "path", "guide": "cosine"},
    {"integrator": "path-buffer"},
    {"integrator": "gather"},
    {"integrator": "t-buffer", "light_samples": 4},
    {"integrator": "classic", "light_samples": 4},
]
GREY = np.array([0.25, 0.5, 0.75])


def quad(**material: Any) -> Scene:
    """A quad in the middle of the picture, under a white sky."""
    corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    return glpath.load_scene({
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 40},
        "film": {"resolution": [16, 16]},
        "sky": {"zenith": [1.0, 1.0, 1.0], "up": [0, 1, 0]},
        "materials": {"quad": material},
        "shapes": [{"type": "mesh", "vertices": corners, "faces": [[0, 1, 2, 3]], "material": "quad"}],
    })  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: str(engine["integrator"]))
def test_the_eye_sees_it_and_light_does_not_change(engine: dict[str, Any]):
    own = quad(reflectance=[0.5, 0.5, 0.5])
    before = replace(own, background=Background(GREY))
    with_sky, seen = (glpath.render(scene, spp=8, seed=3, aovs=("albedo",), **engine) for scene in (own, before))
    assert seen.mean[0, 0] == pytest.approx(GREY, rel=1e-6)
    assert seen.aov("albedo")[0, 0] == pytest.approx(GREY, rel=1e-3)
    assert np.array_equal(seen.mean[6:10, 6:10], with_sky.mean[6:10, 6:10])
    assert seen.mean[8, 8].mean() > 0.1


def test_a_mirror_shows_the_sky_and_thin_glass_the_background():
    mirror = replace(
        quad(type="principled", reflectance=[1.0, 1.0, 1.0], metallic=1.0, roughness=0.0),
        background=Background(GREY),
    )
    film = glpath.render(mirror, integrator="path", guide="cosine", spp=2)
    assert film.mean[8, 8] == pytest.approx(1.0, rel=1e-3)
    glass = quad(type="principled", reflectance=[1.0, 1.0, 1.0], roughness=0.0, transmission=1.0, thin=True)
    film = glpath.render(replace(glass, background=Background(GREY)), integrator="path", guide="cosine", spp=256)
    # A pane reflects some of the sky and lets the rest of the background through.
    reflected = (film.mean[8, 8] - GREY) / (1.0 - GREY)
    assert 0.02 < reflected.mean() < 0.12


def test_a_transparent_one_is_an_alpha_channel(tmp_path: Path):
    film = glpath.render(quad(reflectance=[0.5] * 3), parameters={"background": "transparent"}, spp=4, seed=1)
    assert film.alpha is not None
    assert (film.alpha[0, 0], film.alpha[8, 8]) == (0.0, 1.0)
    assert not film.mean[0, 0].any()
    film.save(tmp_path / "a.png", exposure=0.0)
    film.save(tmp_path / "a.exr")
    film.save(tmp_path / "a.npz")
    picture = read_eight_bits(tmp_path / "a.png")
    assert picture is not None
    assert picture.shape == (16, 16, 4)
    assert (picture[0, 0, 3], picture[8, 8, 3]) == (0, 255)
    # On the edge of the quad, colours are those of what is there.
    edge = (film.alpha > 0.2) & (film.alpha < 0.8)
    assert edge.any()
    assert picture[edge][:, :3].mean() == pytest.approx(picture[8, 8, :3].mean(), rel=0.15)
    channels, _ = read_exr_channels(tmp_path / "a.exr")
    assert channels["A"] == pytest.approx(film.alpha)
    assert glpath.Film.load(tmp_path / "a.npz").alpha == pytest.approx(film.alpha)


def test_a_jpeg_without_an_alpha_channel_is_warned_of(tmp_path: Path):
    film = glpath.render(quad(reflectance=[0.5] * 3), parameters={"background": "transparent"}, spp=1, seed=1)
    with pytest.warns(glpath.SceneWarning, match="a JPEG has no alpha channel"):
        film.save(tmp_path / "a.jpg")
