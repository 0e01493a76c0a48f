"""Exposure of a bake: that of the camera's picture, whatever a denoiser leaves on texels without light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.lightmap.lightmap import Lightmap
from glpath.apps.lightmap.seams import lit_texels
from glpath.film.denoise import can_denoise
from glpath.io import load_scene
from glpath.scene import Scene

pytest.importorskip("xatlas")

DENOISE = (
    False,
    pytest.param(True, marks=pytest.mark.skipif(not can_denoise(), reason="needs the extra denoise")),
)
IN_FRONT = {"position": [4.5, 4.0, 8.0], "target": [0, 1.3, 0], "fov": 40}
INSIDE = {"position": [0, 1.4, 2.2], "target": [0, 1.2, -2], "fov": 70}
OUTSIDE = {"position": [6, 3, 9], "target": [0, 1.3, 0], "fov": 40}


def box(low: list[float], high: list[float], **more: Any) -> dict[str, Any]:
    return {"type": "box", "min": low, "max": high, "material": "plaster", **more}


def room(camera: dict[str, Any], *, front: bool) -> Scene:
    """A room of thick walls with a ceiling lamp, whose light does not reach the outer sides of the walls."""
    walls = [
        box([-2, -0.1, -2.5], [2, 0, 2.5]),
        box([-2, 2.6, -2.5], [2, 2.7, 2.5]),
        box([-2.1, 0, -2.5], [-2, 2.6, 2.5]),
        box([2, 0, -2.5], [2.1, 2.6, 2.5]),
        box([-2, 0, -2.6], [2, 2.6, -2.5]),
        box([0.3, 0, -1.5], [1.1, 0.8, -0.7]),
    ]
    if front:
        walls.append(box([-2, 0, 2.5], [2, 2.6, 2.6]))
    lamp = box([-0.5, 2.55, -0.3], [0.5, 2.59, 0.3], emission={"radiance": 10})
    return load_scene(
        {
            "camera": camera,
            "film": {"resolution": [128, 96]},
            "materials": {"plaster": {"reflectance": 0.6}},
            "shapes": [*walls, lamp],
        }
    )


def bake(scene: Scene, denoise: bool) -> Lightmap:
    return glpath.lightmap(scene, size=256, spp=32, denoise=denoise, integrator="path")


@pytest.mark.parametrize("denoise", DENOISE)
@pytest.mark.parametrize(("camera", "front"), [(IN_FRONT, False), (INSIDE, True)])
def test_exposure_is_that_of_the_camera_s_picture(camera: dict[str, Any], front: bool, denoise: bool) -> None:
    scene = room(camera, front=front)
    picture = glpath.render(scene, spp=64, integrator="path")
    assert abs(bake(scene, denoise).exposure_stops() - picture.exposure_stops()) <= 0.1


@pytest.mark.parametrize("denoise", DENOISE)
def test_camera_without_light_in_view_leaves_the_exposure_to_the_lit_texels(denoise: bool) -> None:
    """A closed room seen from outside shows black walls alone, so its inside decides, and not 0 stops."""
    baked = bake(room(OUTSIDE, front=True), denoise)
    inside = glpath.render(room(INSIDE, front=True), spp=64, integrator="path")
    assert abs(baked.exposure_stops() - inside.exposure_stops()) <= 0.5


@pytest.mark.parametrize("denoise", DENOISE)
def test_texels_far_from_any_light_are_black(denoise: bool) -> None:
    """Texels of outer walls, and the gutters beside them, are exactly zero; texels with light stay as they are."""
    scene = room(IN_FRONT, front=True)
    baked = bake(scene, denoise)
    texels, atlas = baked.surfaces.texels, baked.atlas
    middle = len(texels.face) // 2
    positions = texels.positions(baked.scene, atlas, middle)
    height = positions[:, 1]
    outside = (np.abs(positions) > [2.05, 9, 2.55]).any(axis=1) | (height > 2.65) | (height < -0.05)
    page, row, column = (index[outside] for index in texels.index)
    assert len(row) > 1000
    for down, right in ((0, 0), (0, 1), (1, 0), (0, -1), (-1, 0)):
        beside = baked.irradiance[page, np.clip(row + down, 0, 255), np.clip(column + right, 0, 255)]
        assert (beside == 0).all(axis=-1).mean() > 0.99
    lit = baked.irradiance[baked.baked & baked.lit]
    assert (lit > 0).all(axis=-1).mean() > 0.99


@pytest.mark.skipif(not can_denoise(), reason="needs the extra denoise")
def test_denoiser_does_not_change_what_statistics_count() -> None:
    """The same texels count as lit, with nearly the same mean, so that steps are relative to the same light."""
    raw = bake(room(IN_FRONT, front=False), denoise=False)
    clean = Lightmap.of(raw.surfaces, raw.film, denoise=True)
    assert (raw.denoised, clean.denoised) == (False, True)
    counted = lit_texels(clean.lit, clean.baked)
    assert np.array_equal(counted, lit_texels(raw.lit, raw.baked))
    assert 0.2 < counted.sum() / clean.baked.sum() < 0.8
    assert clean.irradiance[counted].mean() == pytest.approx(raw.irradiance[counted].mean(), rel=0.02)
    assert not clean.lit_irradiance[clean.baked & ~counted].any()
