"""Reflected light in daylight coefficients: closed forms, paths, and what is kept of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.daylight.bounces import ReflectingSides
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.errors import ImageError, SceneWarning, UsageError
from glpath.io import scene_from_dict
from glpath.radiosity.mesh.sides import random_in_parts, sub_triangles
from glpath.scene import path_traceable

# Few elements are enough here.
pytestmark = pytest.mark.filterwarnings("ignore:.*bias of the reflected light")

VIEW = {"position": [0, -1, 1], "target": [0, 0, 1], "up": [0, 0, 1]}
WHITE_SKY = {"zenith": [1, 1, 1], "horizon": [1, 1, 1], "up": [0, 0, 1]}
QUICK: dict[str, Any] = {"elements": 200, "gather_rays": 1024}


def scene(reflectance: float, *quads: Any, **more: Any) -> Any:
    shapes = [{"type": "quad", "corners": corners, "material": "wall"} for corners in quads]
    walls = {"wall": {"type": "diffuse", "reflectance": reflectance}}
    return scene_from_dict({"camera": VIEW, "shapes": shapes, "materials": walls, "sky": WHITE_SKY, **more})


def plate(side: float, height: float) -> Any:
    return [[-side, -side, height], [side, -side, height], [side, side, height], [-side, side, height]]


def box(*without: int) -> Any:
    """The faces of a cube of side 2 about (0, 0, 1): floor, ceiling, left, right, front, back."""
    faces = [
        plate(1, 0), plate(1, 2),
        [[-1, -1, 0], [-1, 1, 0], [-1, 1, 2], [-1, -1, 2]], [[1, -1, 0], [1, 1, 0], [1, 1, 2], [1, -1, 2]],
        [[-1, -1, 0], [1, -1, 0], [1, -1, 2], [-1, -1, 2]], [[-1, 1, 0], [1, 1, 0], [1, 1, 2], [-1, 1, 2]],
    ]  # fmt: skip
    return [face for number, face in enumerate(faces) if number not in without]


def test_a_sensor_over_wide_ground_has_its_share_of_the_light_of_the_ground():
    """The underside above endless ground of albedo rho below a white sky has rho pi, whatever its patches."""
    wide = scene(0.4, plate(1000, 0))
    found = daylight_coefficients(wide, [[0.0, 0, 1]], [0.0, 0, -1], samples=2, latitude=40.0, suns=12, **QUICK)
    assert found.direct_sky().sum() == pytest.approx(0.0, abs=1e-3)
    assert found.sky().sum() == pytest.approx(0.4 * np.pi, rel=0.01)
    assert found.sun()[0] == pytest.approx(0.4 * found.suns[:, 2], rel=0.01)


def test_a_box_with_an_open_lid_has_the_light_of_unbiased_paths():
    opened = scene(0.7, *box(1))
    at, up = [[0.0, 0, 0.0], [0.8, -0.5, 0.3]], [[0.0, 0, 1], [-1.0, 0, 0]]
    found = daylight_coefficients(opened, at, up, samples=16, **QUICK)
    paths = glpath.irradiance(opened, at, up, integrator="path", spp=2048)
    error = np.hypot(found.standard_errors, paths.standard_errors[:, 0])
    assert (found.sky_sums - found.direct_sky().sum(axis=1) > 0.3).all(), "most of it is reflected"
    assert (np.abs(found.sky_sums - paths.values[:, 0]) < 3 * error + 0.01 * paths.values[:, 0]).all()


def test_depths_add_up_to_all():
    opened = scene(0.5, *box(1))
    at, up = [[0.0, 0, 0.5]], [0.0, 0, 1]
    sums = [daylight_coefficients(opened, at, up, max_depth=n, **QUICK).sky_sums[0] for n in (1, 2, 3, 40, None)]
    assert np.diff(sums[:4]).min() > 0
    assert sums[3] == pytest.approx(sums[4], rel=1e-3)


def test_a_sparse_solution_is_the_dense_one(monkeypatch: pytest.MonkeyPatch):
    """In every column: a patch of the sky gives a hundredth of what a sun gives, and its series is as long."""
    opened = scene(0.8, *box(1))
    options = {"latitude": 40.0, "suns": 12, "subdivision": 2, **QUICK}
    dense = daylight_coefficients(opened, [[0.0, 0, 0.5]], [0.0, 0, 1], **options)
    monkeypatch.setattr("glpath.apps.daylight.bounces.DENSE", 0)
    sparse = daylight_coefficients(opened, [[0.0, 0, 0.5]], [0.0, 0, 1], **options)
    np.testing.assert_allclose(sparse.sky(), dense.sky(), rtol=2e-4, atol=1e-9)
    np.testing.assert_allclose(sparse.sun(), dense.sun(), rtol=2e-4, atol=1e-9)


@pytest.mark.parametrize("receiver", ["cylinder", "sphere"])
def test_other_receivers_have_a_uniform_field(receiver: Any):
    """In a box that sends the sky's own radiance the mean over all directions is a quarter of 4 pi, on any axis."""
    closed = scene(0.0, *box(1))
    direct = daylight_coefficients(
        closed, [[0.3, 0.2, 1.0]], [0.6, 0, 0.8], receiver=receiver, samples=64, max_depth=1
    )
    white = scene(0.9, *box(1))
    found = daylight_coefficients(white, [[0.3, 0.2, 1.0]], [0.6, 0, 0.8], receiver=receiver, samples=64, **QUICK)
    reflected = found.sky_sums - direct.sky_sums
    # The walls of a deep white box are 0.5 to 0.9 as bright as its sky, which the rest of all directions sees.
    assert 0.4 < reflected[0] / (np.pi - direct.sky_sums[0]) < 0.9


def test_what_is_kept_is_read_and_small_ones_are_kept_as_rows(tmp_path: Path):
    opened = scene(0.7, *box(1))
    many = np.stack([np.linspace(-0.9, 0.9, 4000), np.zeros(4000), np.full(4000, 0.5)], axis=1)
    few = daylight_coefficients(opened, many[:3], [0.0, 0, 1], **QUICK)
    assert few.indirect is not None
    assert few.indirect.radiosity.shape == (3, 146)
    found = daylight_coefficients(opened, many, [0.0, 0, 1], elements=60, gather_rays=128)
    assert found.indirect is not None
    assert len(found.indirect.radiosity) < 300
    for each, name in ((few, "few.npz"), (found, "many.npz")):
        each.save(tmp_path / name)
        read = glpath.DaylightCoefficients.load(tmp_path / name)
        np.testing.assert_array_equal(read.sky(slice(1, 3)), each.sky(slice(1, 3)))
        np.testing.assert_array_equal(read.standard_errors, each.standard_errors)
    bad = replace(found.indirect, radiosity=found.indirect.radiosity[:2])
    replace(found, indirect=bad).save(tmp_path / "bad.npz")
    with pytest.raises(ImageError, match="sides that there are not"):
        glpath.DaylightCoefficients.load(tmp_path / "bad.npz")


def test_the_same_call_gives_the_same_bits_whatever_the_threads(monkeypatch: pytest.MonkeyPatch):
    opened = scene(0.7, *box(1))
    found = [daylight_coefficients(opened, [[0.0, 0, 0.5]], [0.0, 0, 1], **QUICK)]
    monkeypatch.setattr("glpath.apps.daylight.hits.core_count", lambda: 1)
    found.append(daylight_coefficients(opened, [[0.0, 0, 0.5]], [0.0, 0, 1], **QUICK))
    np.testing.assert_array_equal(found[0].sky(), found[1].sky())


@pytest.mark.parametrize("max_depth", [None, 2])
def test_a_black_scene_reflects_nothing(max_depth: int | None):
    found = daylight_coefficients(scene(0.0, plate(1, 0)), [[0.0, 0, 1]], [0.0, 0, -1], max_depth=max_depth)
    assert found.sky_sums[0] == pytest.approx(found.direct_sky().sum())
    assert found.standard_errors[0] < 0.1


def test_light_that_comes_through_a_window_is_reflected_inside():
    """Clear glass in place of the lid lets all of it in but what it reflects."""
    pane = {"wall": {"type": "diffuse", "reflectance": 0.7}, "pane": {"type": "glazing", "transmittance": 0.9}}
    lid = {"type": "quad", "corners": plate(1, 2), "material": "pane"}
    shapes = [{"type": "quad", "corners": corners, "material": "wall"} for corners in box(1)]
    glazed = scene_from_dict({"camera": VIEW, "shapes": [*shapes, lid], "materials": pane, "sky": WHITE_SKY})
    at, up = [[0.0, 0, 0.0]], [0.0, 0, 1]
    found = daylight_coefficients(glazed, at, up, samples=16, **QUICK)
    paths = glpath.irradiance(glazed, at, up, integrator="path", spp=2048)
    error = np.hypot(found.standard_errors, paths.standard_errors[:, 0])
    assert abs(found.sky_sums - paths.values[:, 0]) < 3 * error + 0.015 * paths.values[:, 0]


def test_what_cannot_be_is_refused():
    for wrong, text in (
        ({"elements": 0}, "elements"),
        ({"gather_rays": 0.5}, "gather_rays"),
        ({"max_depth": 0}, "max_d"),
    ):
        with pytest.raises(UsageError, match=text):
            daylight_coefficients(scene(0.5, plate(1, 0)), [[0.0, 0, 1]], [0.0, 0, 1], **wrong)


def test_a_scene_with_a_stream_has_direct_light_and_says_so():
    with pytest.warns(SceneWarning, match="direct light alone"):
        found = daylight_coefficients(
            "terrain", [[0.0, 500.0, 0.0]], [0.0, 1, 0], samples=1, parameters={"streamed": True}
        )
    assert found.indirect is None


def test_points_of_sides_are_spread_over_all_of_them() -> None:
    """Of a sheet close behind a window the rim is in shade, and counts by its area, however large elements are."""
    sheet = path_traceable(scene(0.5, plate(1.2, 0.98)).still())
    window = [
        float((np.abs(ReflectingSides(sheet, 40, seed).points[:, :2]) < 1).all(axis=1).mean()) for seed in range(16)
    ]
    assert np.mean(window) == pytest.approx((2 / 2.4) ** 2, abs=4 * np.std(window) / 4)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_random_points_of_an_element_are_one_in_each_part_of_it(k: int) -> None:
    found = random_in_parts(k, 500, 1)
    assert found.sum(axis=2) == pytest.approx(1)
    assert (found > 0).all()
    # In a part the mean is its middle, and no coordinate is farther from that than two thirds of its size.
    off = found - sub_triangles(k)
    assert np.abs(off).max() < 2 / 3 / k
    assert np.abs(off.mean(axis=0)).max() < 5 * np.sqrt(1 / 18 / 500) / k
    cells = np.floor(found * k).astype(int)
    assert len(np.unique(cells.reshape(-1, 3), axis=0)) == k * k, "each of the parts, and no other"
