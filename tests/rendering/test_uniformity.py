"""Mean, minimum and maximum of noisy points: no bias that their errors do not cover, and errors that hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.rendering.uniformity import spread_of
from tests.reference.closed_forms import polygon_irradiance

COUNTS = np.full(8, 32)
X, Y = np.meshgrid(np.linspace(-1, 1, 24), np.linspace(-1, 1, 24))
FIELDS = {
    "even": np.ones(576),
    "slope": 0.9 + 0.5 * X.ravel(),
    "lamp": (1 + 1.2 * (X**2 + Y**2).ravel()) ** -2.0,
    "valley": 0.4 + (X**2 + Y**2).ravel(),
    "few": np.array([1, 0.9, 0.95, 0.8, 0.9, 0.7, 0.75, 0.85, 0.65]),
    "one point in shadow": np.append(np.ones(575), 0.3),
}


def noisy(field: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """(8, N) sums over batches, of points whose means have a noise of that share of the field's mean."""
    spread = noise * field.mean() * np.sqrt(COUNTS.sum())
    return np.random.default_rng(seed).normal(
        field * COUNTS[:, None], spread * np.sqrt(COUNTS)[:, None], (8, len(field))
    )


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_u0_is_within_its_error_where_the_plain_ratio_is_not(name: str, noise: float) -> None:
    field = FIELDS[name]
    found = [spread_of(noisy(field, noise, seed), COUNTS) for seed in range(40)]
    for value, truth in (("u0", field.min() / field.mean()), ("ud", field.min() / field.max())):
        each = [getattr(spread, value) for spread in found]
        off = np.array([(x.value - truth) / x.error for x in each])
        # Of a normal distribution 1; the error is a cautious one.
        assert np.sqrt(np.mean(off**2)) < 1.2, (value, off)
    truth = field.min() / field.mean()
    bias = np.mean([s.u0.value for s in found]) - truth
    plain = np.mean([s.minimum.plain / s.mean.value for s in found]) - truth
    if name in ("even", "slope", "lamp", "valley"):  # where many points are nearly the darkest
        assert plain < -noise
        assert abs(bias) < 0.4 * abs(plain)
    else:
        assert abs(bias) < 0.7 * noise


def test_the_mean_s_error_is_its_spread_over_seeds() -> None:
    field = FIELDS["lamp"]
    found = [spread_of(noisy(field, 0.3, seed), COUNTS).mean for seed in range(200)]
    spread = np.std([x.value for x in found])
    assert np.sqrt(np.mean([x.error**2 for x in found])) == pytest.approx(spread, rel=0.15)


def test_points_that_err_together_have_a_mean_that_errs_as_they_do() -> None:
    alike = np.repeat(noisy(np.ones(1), 0.1, 3), 1000, axis=1)
    one, many = (spread_of(sums, COUNTS).mean for sums in (alike[:, :1], alike))
    assert many.error == pytest.approx(one.error)


def test_noise_that_dominates_is_told_with_a_remedy() -> None:
    field = FIELDS["valley"]
    noisy_one = spread_of(noisy(field, 0.2, 0), COUNTS)
    wanted = noisy_one.asks_for(256)
    assert wanted is not None
    assert wanted > 1000
    calm = spread_of(noisy(field, 0.2 * np.sqrt(256 / wanted), 0), COUNTS)
    assert calm.asks_for(wanted) in (None, 2 * wanted)
    assert spread_of(noisy(field, 0.002, 0), COUNTS).asks_for(256) is None


def test_exact_values_have_their_own_minimum_and_no_error() -> None:
    field = FIELDS["few"]
    found = spread_of(field * COUNTS[:, None], COUNTS)
    assert (found.minimum.value, found.maximum.value) == pytest.approx((0.65, 1.0))
    assert found.u0.value == pytest.approx(0.65 / field.mean())
    assert found.u0.error < 1e-12
    one = spread_of(np.eye(8, 1) * field * 8, np.array([8] + [0] * 7))
    assert one.minimum.value == pytest.approx(0.65)
    assert np.isnan([one.minimum.error, one.mean.error, one.u0.error]).all()
    assert one.asks_for(8) is None


def lamp_scene(height: float) -> dict[str, Any]:
    """A lamp of 2 x 2 that faces down."""
    corners = [[-1, -1, height], [-1, 1, height], [1, 1, height], [1, -1, height]]
    lamp = {"type": "quad", "corners": corners, "emission": {"radiance": 10}, "material": "black"}
    camera = {"position": [0, -3, 1], "target": [0, 0, 0], "up": [0, 0, 1]}
    return {"camera": camera, "materials": {"black": {"reflectance": 0}}, "shapes": [lamp]}


def test_a_thousand_copies_of_a_point_have_a_mean_as_exact_as_they_are_many() -> None:
    """Near to a lamp, where the light of its points differs most: with light samples that all points share, the
    mean is fifteen of these errors off."""
    scene, point, up = lamp_scene(0.2), np.array([0.3, 0.2, 0.0]), np.array([0.0, 0, 1])
    truth = 10 * float(polygon_irradiance(point[None], (0.0, 0.0, 1.0), scene["shapes"][0]["corners"])[0])
    off = []
    for seed in range(10):
        found = glpath.irradiance(scene, np.tile(point, (1000, 1)), up, spp=64, max_depth=1, seed=seed)
        error = np.sqrt(np.mean(found.standard_errors[:, 0] ** 2) / 1000)
        off.append((found.values[:, 0].mean() - truth) / error)
    assert np.max(np.abs(off)) < 3, off


@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_the_uniformity_under_a_lamp_is_that_of_its_closed_form(sampling: str) -> None:
    """Of 400 points with few paths, U0 of the values as they are is far too low. Batches of a Sobol sequence are
    not independent: read off the other half as it is, the minimum would be above the mean."""
    scene = lamp_scene(1.0 if sampling == "random" else 0.6)
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 20), np.linspace(-1.2, 1.2, 20))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    truth = 10 * polygon_irradiance(points, (0.0, 0.0, 1.0), scene["shapes"][0]["corners"])
    u0, mean = truth.min() / truth.mean(), 179 * truth.mean()
    options: dict[str, Any] = {"spp": 64, "max_depth": 1, "sampling": sampling}
    found = [glpath.irradiance(scene, points, [0, 0, 1], seed=seed, **options).spread() for seed in range(16)]
    plain = np.mean([s.minimum.plain / s.mean.value for s in found])
    assert plain < u0 - (0.05 if sampling == "random" else 0.01)
    assert np.mean([s.u0.value for s in found]) == pytest.approx(u0, abs=0.2 * (u0 - plain) + 0.007)
    off = np.array([[(s.u0.value - u0) / s.u0.error, (s.mean.value - mean) / s.mean.error] for s in found])
    # The errors of means are of eight batches, so that these follow Student's t: its deviation is 1.18.
    assert (np.sqrt(np.mean(off**2, axis=0)) < [1.2, 1.7]).all(), off
    if sampling == "random":
        stated = np.sqrt(np.mean([s.mean.error**2 for s in found]))
        assert np.std([s.mean.value for s in found]) == pytest.approx(stated, rel=0.45)
