"""Patches of the sky against Tregenza's published solid angles, and directions in them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from glpath.apps.daylight.compass import Compass
from glpath.apps.daylight.receivers import response
from glpath.apps.daylight.sky_patches import SUBDIVISIONS, SkyPatches
from glpath.errors import UsageError
from glpath.io import load_scene
from glpath.io.completed import aside
from glpath.scene.model import Environment

COMPASS = Compass((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
#: Of a patch of each row, and the cap: Radiance's gendaymtx.c, after Tregenza 1987.
TREGENZA = (
    (30, 0.0435449227),
    (30, 0.0416418006),
    (24, 0.0473984151),
    (24, 0.0406730411),
    (18, 0.0428934136),
    (12, 0.0445221864),
    (6, 0.0455168385),
    (1, 0.0344199465),
)


def test_solid_angles_are_those_that_tregenza_published() -> None:
    expected = np.concatenate([np.full(count, angle) for count, angle in TREGENZA])
    assert np.abs(SkyPatches(1).solid_angles[1:] / expected - 1.0).max() < 1e-6


@pytest.mark.parametrize("subdivision", SUBDIVISIONS)
def test_patches_fill_the_sky(subdivision: int) -> None:
    patches = SkyPatches(subdivision)
    assert len(patches) == 1 + SUBDIVISIONS[subdivision] == len(patches.bounds)
    assert patches.solid_angles[1:].sum() == pytest.approx(2 * np.pi, rel=1e-12)
    assert patches.solid_angles[0] == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("samples", [1, 2, 8])
def test_directions_are_in_their_patches(samples: int) -> None:
    patches = SkyPatches(2)
    found = patches.directions(COMPASS, samples)
    assert np.allclose(np.linalg.norm(found.directions, axis=1), 1.0)
    assert (np.diff(found.patch) >= 0).all()
    assert np.allclose(np.bincount(found.patch, found.weight), patches.solid_angles)
    azimuth_from, azimuth_to, low, high = patches.bounds[found.patch].T
    sine = found.directions[:, 2]
    assert ((sine >= low - 1e-12) & (sine <= high + 1e-12)).all()
    azimuth = np.arctan2(found.directions[:, 0], found.directions[:, 1])
    middle = 0.5 * (azimuth_from + azimuth_to)
    off = np.abs((azimuth - middle + np.pi) % (2 * np.pi) - np.pi)
    cap = found.patch == len(patches) - 1
    assert (off <= 0.5 * (azimuth_to - azimuth_from) + 1e-12)[~cap].all()


@pytest.mark.parametrize("subdivision", SUBDIVISIONS)
def test_an_open_plane_has_pi(subdivision: int) -> None:
    found = SkyPatches(subdivision).directions(COMPASS, 4, seed=3)
    sky = found.patch > 0
    total = response("plane", np.array([[0.0, 0.0, 1.0]]), found.directions[sky]) @ found.weight[sky]
    assert total[0] == pytest.approx(np.pi, rel=2e-4)


def test_the_first_patch_is_in_the_north_and_the_next_east_of_it() -> None:
    first, second = SkyPatches(1).centres(COMPASS)[1:3]
    assert first == pytest.approx([0.0, np.cos(np.radians(6)), np.sin(np.radians(6))])
    assert second[0] > 0
    turned = SkyPatches(1).centres(Compass((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)))[1:3]
    assert turned[0] == pytest.approx([0.0, np.sin(np.radians(6)), -np.cos(np.radians(6))])
    assert turned[1][0] > 0


def test_other_subdivisions_are_refused() -> None:
    with pytest.raises(UsageError, match="2305 patches"):
        SkyPatches(3)


@pytest.mark.parametrize("subdivision", [1, 2, 4])
def test_directions_into_a_patch_are_contained_in_it(subdivision: int) -> None:
    compass = Compass((0.0, 1.0, 0.0), (0.6, 0.0, -0.8))
    into = SkyPatches(subdivision).directions(compass, 4)
    assert np.array_equal(SkyPatches(subdivision).containing(into.directions, compass), into.patch)


@pytest.mark.parametrize("sky", [{}, {"sky": {"zenith": 1}}, {"sky": {"type": "cie", "cie_type": 1, "zenith": 1}}])
@pytest.mark.parametrize(("up", "north"), [([0, 0, 1], (0, 1, 0)), ([0, 1, 0], (0, 0, -1))])
def test_up_is_the_scene_s_and_not_that_of_a_studio_that_stands_in_for_light(
    sky: dict[str, Any], up: list[int], north: tuple[int, ...]
) -> None:
    camera = {"position": [9, 9, 9], "target": [0, 0, 0], "up": up}
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1}
    with aside("light"):
        found = Compass.of(load_scene({"camera": camera, "shapes": [ball], **sky}))
    assert found.up == tuple(up)
    assert found.north == north


@pytest.mark.parametrize("up", [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
@pytest.mark.parametrize("north", [None, [3, 2, 1]])
def test_north_is_where_the_scene_s_own_sun_has_an_azimuth_of_0(up: list[int], north: list[int] | None) -> None:
    sky = {"type": "perez", "direct": 800, "diffuse": 100, "altitude": 30, "azimuth": 0, "up": up}
    shape = {"type": "box", "min": [0, 0, 0], "max": [1, 1, 1]}
    camera = {"position": [9, 9, 9], "target": [0, 0, 0], "up": up}
    scene = load_scene({"camera": camera, "shapes": [shape], "sky": sky | ({"north": north} if north else {})})
    assert isinstance(scene.sky, Environment)
    assert scene.sky.sun is not None
    level = scene.sky.sun.direction - 0.5 * np.array(up)
    assert Compass.of(scene).north == pytest.approx(level / np.linalg.norm(level))
    given = Compass.of(scene, north=-level)
    assert given.north == pytest.approx(-level / np.linalg.norm(level))


@pytest.mark.parametrize("north", [None, [3, 0, 1]])
def test_up_that_is_not_the_sky_s_has_its_default_north(north: list[int] | None) -> None:
    """The default north of z up is y, and of y up -z, as in the same scene without a sky."""
    sky = {"type": "perez", "direct": 800, "diffuse": 100, "altitude": 30, "azimuth": 0, "up": [0, 1, 0]}
    shape = {"type": "box", "min": [0, 0, 0], "max": [1, 1, 1]}
    camera = {"position": [9, 9, 9], "target": [0, 0, 0]}
    scene = load_scene({"camera": camera, "shapes": [shape], "sky": sky | ({"north": north} if north else {})})
    plain = replace(scene, sky=None)
    assert Compass.of(scene, up=[0, 0, 1]) == Compass.of(plain, up=[0, 0, 1]) == Compass((0, 0, 1), (0, 1, 0))
    assert Compass.of(scene, up=[0, 2, 0]) == Compass.of(scene)
