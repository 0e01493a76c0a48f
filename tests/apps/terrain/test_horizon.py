"""Horizons, sky view factors and sun hours of height fields: closed forms, and marches along rays in numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath import HeightField, UsageError, horizon
from glpath.apps.terrain.horizon import AZIMUTHS, Horizon
from glpath.apps.terrain.sweep import horizon_tangents, lattice_directions
from tests.support.terrain_witness import march, rough

FLAT = np.zeros((21, 21))


def test_an_open_plane_sees_all_of_the_sky() -> None:
    np.testing.assert_allclose(horizon(FLAT).sky_view_factor(), 1.0, rtol=1e-6)
    np.testing.assert_allclose(horizon(FLAT, [[3.3, -4.1]]).sky_view_factor(), 1.0, rtol=1e-6)


@pytest.mark.parametrize("tilt", [10.0, 35.0, 70.0])
def test_a_tilted_plane_sees_half_of_one_plus_its_cosine(tilt: float) -> None:
    """Of an even sky above the horizontal: (1 + cos s) / 2; a level receiver there loses what the slope hides."""
    slope = math.tan(math.radians(tilt))
    field = np.tile(np.arange(61.0) * slope, (61, 1))
    expected = 0.5 * (1 + math.cos(math.radians(tilt)))
    found = horizon(field, normals="surface").sky_view_factor()
    assert found[30, 30] == pytest.approx(expected, abs=2e-4)
    # The uphill horizon of azimuth a has the tangent s cos(a).
    a = 2 * np.pi * (np.arange(720) + 0.5) / 720
    level = np.mean(1 / (1 + np.maximum(slope * np.cos(a), 0) ** 2))
    assert horizon(field).sky_view_factor()[30, 30] == pytest.approx(level, abs=5e-4)


@pytest.mark.parametrize("length", [1e-320, 1e-200, 1.0, 1e200])
def test_normals_of_any_length_face_alike(length: float) -> None:
    """A receiver on open ground sees (1 + cos s) / 2 of the sky, whatever the length of its normal."""
    found = horizon(FLAT, [[3.3, -4.1]], normals=[0.6 * length, 0.0, 0.8 * length]).sky_view_factor()
    assert found[0] == pytest.approx(0.9, abs=2e-3)
    for normal in ([0.0, 0.0, 0.0], [0.0, 0.0, np.inf], [np.nan, 0.0, 1.0]):
        with pytest.raises(UsageError, match=r"normals\[0\]: .* looks nowhere"):
            horizon(FLAT, normals=normal)


def test_on_the_foot_of_a_high_wall_half_of_the_sky_is_left() -> None:
    wall = np.tile(np.where(np.arange(40) < 20, 0.0, 9e4), (4000, 1))
    found = horizon(wall, [[18.999, -2000.0]], azimuths=720).sky_view_factor()
    assert found[0] == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(("height", "away"), [(5.0, 3.0), (2.0, 8.0)])
def test_a_long_wall_leaves_half_of_one_plus_a_cosine(height: float, away: float) -> None:
    """Of a wall that is endless along and h high at the distance d: (1 + cos(atan(h / d))) / 2."""
    spacing = 0.25
    columns = np.arange(-80, 81)
    wall = np.tile(np.where(columns == 0, height, 0.0), (2401, 1))
    x = 80 * spacing - away
    found = horizon(wall, [[x, -1200 * spacing]], spacing=spacing, azimuths=360).sky_view_factor()
    # It stands from one sample to the next, so the crest alone counts.
    assert found[0] == pytest.approx(0.5 * (1 + math.cos(math.atan2(height, away))), abs=1e-3)


def test_in_the_bottom_of_a_v_shaped_valley_the_sky_is_what_both_slopes_leave() -> None:
    """Endless slopes of an angle s on both sides leave cos s to a receiver in the middle that is level."""
    slope = math.radians(40)
    field = np.tile(np.abs(np.arange(-20, 21)) * math.tan(slope), (41, 1))
    # Towards the ends the horizon of azimuth a has the tangent of the slope times sin a.
    assert horizon(field, azimuths=128).sky_view_factor()[20, 20] == pytest.approx(math.cos(slope), abs=1e-3)


def test_the_bottom_of_a_bowl_sees_the_sky_within_its_rim() -> None:
    """In a bowl with its rim at the angle b above the bottom, the bottom sees cos^2 b."""
    radius, rim = 50.0, 35.0
    y, x = np.mgrid[-60:61, -60:61].astype(float)
    r = np.hypot(x, y)
    depth = np.where(r < rim, -np.sqrt(np.maximum(radius**2 - r**2, 0)), -math.sqrt(radius**2 - rim**2))
    b = math.atan2(radius - math.sqrt(radius**2 - rim**2), rim)
    assert horizon(depth).sky_view_factor()[60, 60] == pytest.approx(math.cos(b) ** 2, abs=4e-3)  # by samples


def test_a_single_tower_stands_at_its_angle() -> None:
    field = np.zeros((101, 101))
    field[50, 50] = 30.0
    found = horizon(field, [[50.0, -90.0], [20.0, -50.0], [50.0, -20.0]])
    np.testing.assert_allclose(found.angles(0.0), [math.degrees(math.atan(30 / 40)), 0, 0], atol=1e-4)
    np.testing.assert_allclose(found.angles(90.0), [0, 45.0, 0], atol=1e-4)
    np.testing.assert_allclose(found.angles(180.0), [0, 0, 45.0], atol=1e-4)


@pytest.mark.parametrize("spacing", [(1.0, 1.0), (2.0, 0.7)])
def test_sweep_and_rays_agree_with_a_march_along_the_line(spacing: tuple[float, float]) -> None:
    field = HeightField.of(rough(23, 31), spacing)
    tangents = np.empty(field.shape, np.float32)
    rng = np.random.default_rng(3)
    for direction in lattice_directions(24, spacing):
        horizon_tangents(field.heights, spacing, direction, tangents)
        by_rays = np.tan(np.radians(horizon(field).angles(math.degrees(direction.azimuth))))
        np.testing.assert_allclose(tangents, by_rays, rtol=2e-5, atol=2e-6)
        for _ in range(6):
            r, c = int(rng.integers(23)), int(rng.integers(31))
            assert tangents[r, c] == pytest.approx(march(field, c, r, direction.azimuth), rel=1e-5, abs=1e-6)


def test_rays_from_points_above_ground_agree_with_a_march() -> None:
    field = HeightField.of(rough(23, 31), 2.0, (100.0, 50.0))
    rng = np.random.default_rng(5)
    at = np.column_stack([100 + 60 * rng.random(40), 50 - 44 * rng.random(40)])
    points = np.column_stack([at, field.heights_at(at) + 0.5])
    for azimuth in (0.0, 17.3, 90.0, 211.0, 359.5):
        found = np.tan(np.radians(horizon(field, points).angles(azimuth)))
        for point, tangent in zip(points, found, strict=True):
            column, row = field.grid_positions(point[None])[0]
            expected = march(field, column, row, math.radians(azimuth), point[2])
            assert tangent == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_sky_view_factors_of_samples_and_of_points_there_agree() -> None:
    field = HeightField.of(rough(25, 25))
    x, y = np.meshgrid(*field.coordinates())
    points = np.column_stack([x.ravel(), y.ravel()])
    by_sweep = horizon(field, azimuths=180).sky_view_factor()
    by_rays = horizon(field, points, azimuths=180).sky_view_factor()
    np.testing.assert_allclose(by_sweep.ravel(), by_rays, atol=4e-3)


def test_any_normal_sees_its_half_of_the_sky() -> None:
    """Over an open plane: (1 + cos s) / 2 for all tilts; a wall sees a half, a ceiling nothing."""
    tilt = np.radians([0, 30, 60, 90, 120, 150, 180])
    normals = np.column_stack([np.sin(tilt) * 0.6, np.sin(tilt) * 0.8, np.cos(tilt)])
    points = np.tile([10.0, -10.0, 1.0], (len(tilt), 1))
    found = horizon(FLAT, points, normals).sky_view_factor()
    np.testing.assert_allclose(found, 0.5 * (1 + np.cos(tilt)), atol=1e-3)


def test_suns_are_seen_above_the_horizon_alone() -> None:
    field = np.zeros((101, 101))
    field[50, :] = 30.0  # a ridge from west to east
    at = [[50.0, -80.0], [50.0, -20.0]]  # south and north of it; it stands at 45 degrees
    azimuth, altitude = [0, 0, 180, 180, 180, 90], [44, 46, 44, 46, -5, 10]
    found = horizon(field, at).sun_hours(azimuth, altitude, [1, 2, 4, 8, 16, 32])
    np.testing.assert_array_equal(found, [2 + 4 + 8 + 32, 1 + 2 + 8 + 32])


def test_sun_hours_are_those_of_a_march_for_each_sun() -> None:
    field = HeightField.of(rough(23, 31))
    rng = np.random.default_rng(11)
    azimuth, altitude = 360 * rng.random(30), 60 * rng.random(30)
    azimuth[10:20] = azimuth[10]  # suns that share a ray
    found = horizon(field).sun_hours(azimuth, altitude)
    for r, c in ((0, 0), (5, 7), (11, 30), (22, 14)):
        tangents = np.array([march(field, c, r, math.radians(each)) for each in azimuth])
        assert found[r, c] == np.count_nonzero(np.tan(np.radians(altitude)) > tangents)


@pytest.mark.parametrize(("suns", "largest"), [(10, 1024), (64, 1024), (1024, 512), (50_000, 64)])
def test_a_task_is_short_whatever_the_number_of_suns(
    suns: int, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ray takes a microsecond, and an interruption waits for a task: 2^19 rays at most, or 64 points."""
    sizes: list[int] = []
    monkeypatch.setattr("glpath.apps.terrain.horizon.add_suns", lambda *given: sizes.append(len(given[-3])))
    horizon(np.zeros((32, 32))).sun_hours(np.linspace(0, 360, suns), np.full(suns, 30.0))
    assert (sum(sizes), max(sizes)) == (32 * 32, largest)


def test_a_task_is_short_whatever_the_number_of_azimuths(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    monkeypatch.setattr("glpath.apps.terrain.horizon.tangents_at", lambda *given: sizes.append(len(given[-3])))
    monkeypatch.setattr("glpath.apps.terrain.horizon.add_sky", lambda *_: None)
    horizon(np.zeros((32, 32)), height=1.0, azimuths=720).sky_view_factor()
    assert (sum(sizes), max(sizes)) == (720 * 32 * 32, 728)  # 728 points have 2^19 rays of 720 azimuths


def test_direct_irradiation_has_the_cosine_to_the_surface() -> None:
    level, slope = horizon(FLAT, [[5.0, -5.0]]), horizon(FLAT, [[5.0, -5.0, 1.0]], [0.0, -1.0, 1.0])
    # North, and south in front of a surface that faces half up, half south.
    assert level.direct_irradiation([180.0], [30.0], [800.0])[0] == pytest.approx(400.0)
    expected = 800 * math.cos(math.radians(15))
    assert slope.direct_irradiation([180.0], [30.0], [800.0])[0] == pytest.approx(expected)
    assert slope.direct_irradiation([0.0], [30.0], [800.0])[0] == 0.0
    assert slope.sun_hours([0.0, 180.0], [30.0, 30.0])[0] == 1.0


def test_holes_shadow_nothing_and_have_no_result() -> None:
    field = np.zeros((31, 31))
    field[15, 15] = 20.0
    there = np.ones_like(field, bool)
    there[15, 15] = False
    found = horizon(HeightField.of(field, mask=there, holes=True))
    factors = found.sky_view_factor()
    assert np.isnan(factors[15, 15])
    np.testing.assert_allclose(factors[there], 1.0, rtol=1e-6)
    assert np.isnan(found.sun_hours([180.0], [5.0])[15, 15])
    np.testing.assert_array_equal(found.sun_hours([180.0], [5.0])[there], 1.0)


def test_points_below_ground_are_counted_and_those_just_below_are_lifted() -> None:
    with pytest.warns(glpath.SceneWarning, match="points: 1 of 3 are below ground"):
        found = horizon(FLAT, [[5.0, -5.0, -0.2], [5.0, -5.0, -3.0], [5.0, -5.0, 0.0]])
    np.testing.assert_array_equal(np.isnan(found.sky_view_factor()), [False, True, False])


def test_receivers_may_stand_above_ground() -> None:
    field = np.zeros((61, 61))
    field[:, 30] = 2.0
    seen = horizon(field, height=1.9).sky_view_factor()
    assert seen.shape == field.shape
    assert seen[30, 20] > horizon(field).sky_view_factor()[30, 20] + 0.005


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"azimuths": 4}, "azimuths: 4, but 8 to 720"),
        ({"height": -1.0}, "height: -1.0"),
        ({"height": 1e39}, r"height: 1e\+39, but 0 to 1e\+15"),
        ({"points": [[1.0, 2.0, 3.0, 4.0]]}, r"points: of shape \(1, 4\)"),
        ({"points": [[1.0, math.nan]]}, r"points\[0\]: \[1.0, nan\]"),
        ({"points": [[50.0, -5.0]]}, "is outside height field, or in a hole"),
        ({"points": [[5e4, -5.0, 1.0]]}, "all are farther from height field than it is wide"),
        ({"points": [[5.0, -5.0, 1.0]], "height": 1.0}, "these have a z"),
        ({"normals": "up"}, 'normals: "up"'),
        ({"normals": [0.0, 0.0, 0.0]}, "looks nowhere"),
        ({"normals": [[0.0, 0.0, 1.0]] * 3}, r"normals: of shape \(3, 3\)"),
    ],
)
def test_what_is_wrong_with_receivers_is_reported(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.UsageError, match=words):
        horizon(FLAT, **options)


@pytest.mark.parametrize(
    ("suns", "words"),
    [
        (([1.0], [1.0, 2.0]), r"azimuth of shape \(1,\), altitude \(2,\)"),
        (([math.nan], [1.0]), r"azimuth\[0\] is nan"),
        (([10.0], [100.0]), "Are they in radians"),
        (([10.0], [10.0], [-1.0]), r"hours must be from 0 to 1e\+15"),
        (([10.0], [10.0], [1e16]), r"hours must be from 0 to 1e\+15"),
    ],
)
def test_what_is_wrong_with_suns_is_reported(suns: Any, words: str) -> None:
    with pytest.raises(glpath.UsageError, match=words):
        horizon(FLAT).sun_hours(*suns)


def test_azimuths_are_nearly_even_and_close_to_what_is_asked() -> None:
    for spacing in ((1.0, 1.0), (3.0, 1.0)):
        found = np.array([each.azimuth for each in lattice_directions(AZIMUTHS, spacing)])
        gaps = (np.roll(found, -1) - found) % (2 * np.pi)
        assert gaps.sum() == pytest.approx(2 * np.pi)
        assert gaps.max() < 1.51 * 2 * np.pi / AZIMUTHS


def cosine_rays(count: int, normal: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Directions with the density of the cosine to a normal, stratified."""
    rng = np.random.default_rng(seed)
    i, j = np.divmod(np.arange(count**2), count)
    r, a = np.sqrt((i + rng.random(count**2)) / count), 2 * np.pi * (j + rng.random(count**2)) / count
    local = np.stack([r * np.cos(a), r * np.sin(a), np.sqrt(1 - r * r)], axis=1)
    beside = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.6 else [0, 1.0, 0])
    beside /= np.linalg.norm(beside)
    return local @ np.stack([beside, np.cross(normal, beside), normal])


@pytest.mark.evidence
@pytest.mark.parametrize("surface", [None, "surface"])
def test_sky_view_factors_are_those_of_rays_to_the_triangles(surface: Any) -> None:
    """Embree's rays to the same triangles, 90,000 a point, within 1e-3.

    Rays begin a little above the surface, so the points lie off the edges of its triangles.
    """
    from benchmarks.peers.embree import embreex_triangles

    field = HeightField.of(rough(97, 89, 8.0), 5.0)
    vertices, faces = field.triangles()
    cast = embreex_triangles(vertices[faces])
    rng = np.random.default_rng(2)
    cells = rng.integers([1, 1], [87, 95], (20, 2))
    at = 5.0 * (cells + [0.65, 0.35] + 0.1 * rng.random((20, 2))) * [1, -1]
    found = horizon(field, at, surface, azimuths=360)
    factors = found.sky_view_factor()
    normals = np.broadcast_to(found.normals, (20, 3)).astype(float)
    assert found.points is not None
    for point, normal, factor in zip(found.points, normals, factors, strict=True):
        rays = cosine_rays(300, normal, 4)
        origins = np.tile(point + 1e-3 * normal, (len(rays), 1)).astype(np.float32)
        open_sky = (cast(origins, rays.astype(np.float32)) < 0) & (rays[:, 2] > 0)
        assert factor == pytest.approx(open_sky.mean(), abs=1e-3)


@pytest.mark.parametrize("points", [[0, 0], 5, [[0]], [[1, 2, 3, 4]], "x", None])
@pytest.mark.parametrize("method", ["heights_at", "normals_at", "grid_positions"])
def test_points_of_a_wrong_shape_are_refused(method: str, points: Any) -> None:
    with pytest.raises(UsageError, match="points: "):
        getattr(HeightField.of(FLAT), method)(points)


@pytest.mark.parametrize("azimuth", [math.inf, math.nan, "x"])
def test_azimuth_that_is_not_finite_is_refused(azimuth: Any) -> None:
    with pytest.raises(UsageError, match="azimuth: "):
        horizon(FLAT).angles(azimuth)


def test_results_that_are_no_array_are_refused() -> None:
    with pytest.raises(UsageError, match=r"hours is of shape \(2,\)"):
        horizon(FLAT).to_xarray(hours=[[1, 2], [3]])


POINT = np.array([[1.0, -1.0, 0.0]])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"field": 3}, "field: 3"),
        ({"points": [1.0, 2.0, 3.0]}, r"points: of shape \(3,\) where \(N, 3\)"),
        ({"points": POINT + np.inf}, r"points\[0, 0\]: inf"),
        ({"points": [[np.nan, 0.0, 0.0]]}, r"points\[0\]: .* finite x and y"),
        ({"points": "x"}, "points: 'x'"),
        ({"normals": [0.0, 0.0, 1.0]}, r"normals: of shape \(3,\)"),
        ({"normals": [[0.0, 0.0, 1.0]] * 2}, r"normals: of shape \(2, 3\) where \(1, 3\)"),
        ({"normals": [[0.0, 0.0, 0.5]]}, r"normals\[0\]: .* length 1"),
        ({"normals": [[0.0, 0.0, np.nan]]}, r"normals\[0, 2\]: nan"),
        ({"normals": None}, "normals: None"),
        ({"azimuths": 4}, "azimuths: 4"),
        ({"azimuths": 10**9}, "azimuths: 1000000000"),
        ({"height": -1.0}, "height: -1.0"),
        ({"height": np.nan}, "height: nan"),
        ({"report": 3}, "report: 3"),
    ],
)
def test_horizons_refuse_wrong_fields(values: dict[str, Any], words: str) -> None:
    right = {"field": HeightField.of(FLAT), "points": POINT, "normals": [[0.0, 0.0, 1.0]]}
    assert Horizon(**right).shape == (1,)
    with pytest.raises(UsageError, match=words):
        Horizon(**{**right, **values})
