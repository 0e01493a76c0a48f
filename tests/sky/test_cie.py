"""The fifteen skies of the CIE [ISO 15469]: their light on open ground against quadrature, and their form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import glpath
from glpath.errors import SceneError
from glpath.scene import Sky
from glpath.sky.cie import CIE_SKIES, has_sun, relative_luminance
from glpath.sky.maps import open_ground

ELEVATION = np.radians(35.0)
SUN = np.array([np.cos(ELEVATION), 0.0, np.sin(ELEVATION)])
UP = np.array([0.0, 0.0, 1.0])


def quadrature(number: int, normal: np.ndarray) -> float:
    """Irradiance of a surface under the open sky, over the zenith's radiance."""
    u, w = leggauss(300)
    z, w = (u + 1) / 2, w / 2
    phi = (np.arange(600) + 0.5) * (2 * np.pi / 600)
    r = np.sqrt(1 - z * z)[:, None]
    directions = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (300, 600))], axis=-1)
    seen = relative_luminance(number, directions[..., 2], directions @ SUN, SUN[2])
    return float(2 * np.pi * w @ (seen * np.maximum(directions @ normal, 0.0)).mean(axis=1))


def scene(**sky: Any) -> dict[str, Any]:
    shapes = [{"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "material": "black"}]
    return {
        "camera": {"position": [3, 3, 3], "target": [0, 0, 0], "up": [0, 0, 1]},
        "materials": {"black": {"reflectance": 0.0}},
        "shapes": shapes,
        "sky": {"type": "cie", "up": [0, 0, 1], **sky},
    }


@pytest.mark.parametrize("number", CIE_SKIES)
def test_light_on_open_ground_and_walls_over_the_zenith_s(number: int) -> None:
    """The ratio of the zenith's radiance to the horizontal irradiance is what tables of these skies have."""
    normals = np.array([UP, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.array([0.5, 0.5, 2.0]) + np.arange(4)[:, None] * [0.01, 0, 0]
    found = glpath.irradiance(
        scene(cie_type=number, zenith=1.0, sun=SUN.tolist()), points, normals, spp=512, max_depth=1
    )
    expected = [quadrature(number, normal) for normal in normals]
    values, errors = found.values[:, 0], found.standard_errors[:, 0]
    assert errors.max() < 0.03 * max(expected)
    assert (np.abs(values - expected) < 0.005 * np.array(expected) + 4 * errors).all(), (values, expected, errors)


@pytest.mark.parametrize("number", CIE_SKIES)
def test_an_illuminance_is_that_of_open_ground(number: int) -> None:
    made = glpath.load_scene(scene(cie_type=number, illuminance=20_000.0, sun=SUN.tolist())).sky
    assert made is not None
    # Around the zenith, as the nearest texels are 0.35 degrees from it.
    turns = np.arange(16) * np.pi / 8
    near = np.stack([0.006 * np.cos(turns), 0.006 * np.sin(turns), np.full(16, np.sqrt(1 - 0.006**2))], axis=1)
    assert made.radiance(near)[:, 0].mean() * quadrature(number, UP) == pytest.approx(20_000, rel=1e-3)
    # All of it comes from above.
    assert not made.radiance([0.3, 0.1, -0.5]).any()


def test_the_form_of_skies_with_closed_forms() -> None:
    heights = np.linspace(0.05, 1, 7)
    assert relative_luminance(5, heights, 0.0, 1.0) == pytest.approx(1.0)
    assert quadrature(5, UP) == pytest.approx(np.pi)
    # The older CIE overcast sky, a third as bright at the horizon, which the first of these replaced.
    high = np.linspace(0.4, 1, 7)
    assert relative_luminance(1, high, 0.0, 1.0) == pytest.approx((1 + 2 * high) / 3, abs=0.05)
    assert 1 / quadrature(1, UP) == pytest.approx(9 / (7 * np.pi), rel=0.01)
    # Clear skies are brightest around the sun, darkest at right angles to it.
    assert relative_luminance(12, SUN[2], 1.0, SUN[2]) > 5 * relative_luminance(12, SUN[2], 0.0, SUN[2])
    assert [number for number in CIE_SKIES if not has_sun(number)] == [1, 3, 5]


@pytest.mark.parametrize(
    ("sky", "found"),
    [
        ({"zenith": 1.0}, "without `cie_type`"),
        ({"cie_type": 16, "zenith": 1.0}, "16"),
        ({"cie_type": 1}, "neither `zenith` nor `illuminance`"),
        ({"cie_type": 1, "zenith": 1.0, "illuminance": 1.0}, "both"),
        ({"cie_type": 1, "zenith": [1.0, 0.5, 0.5]}, "white"),
        ({"cie_type": 12, "zenith": 1.0}, "depends on the sun"),
        ({"cie_type": 12, "zenith": 1.0, "sun": [1, 0, -0.1]}, "below the horizon"),
        ({"cie_type": 1, "zenith": 1.0, "horizon": 1.0}, "`horizon`"),
        ({"cie_type": 1, "zenith": 1.0, "rotation": 9.0}, "`rotation`"),
    ],
)
def test_what_is_wrong_is_named(sky: dict[str, Any], found: str) -> None:
    with pytest.raises(SceneError, match="sky") as caught:
        glpath.load_scene(scene(**sky))
    assert found in str(caught.value)


def test_other_skies_refuse_its_fields() -> None:
    wrong = scene() | {"sky": {"zenith": 1.0, "up": [0, 0, 1], "illuminance": 100.0}}
    with pytest.raises(SceneError, match=r"`illuminance`.*\n.*cie"):
        glpath.load_scene(wrong)


@pytest.mark.parametrize("up", [[0, 0, 1], [1, 2, -2]])
def test_open_ground_has_the_closed_form_of_a_sky_of_two_colours(up: list[float]) -> None:
    """The integral of (h + (z - h) s) s over the upper half, s the sine of the elevation: pi (h / 3 + 2 z / 3)."""
    zenith, horizon = np.array([3.0, 2.0, 1.0]), np.array([1.0, 0.5, 4.0])
    sky = Sky(zenith, horizon, np.array(up) / np.linalg.norm(up))
    assert open_ground(sky) == pytest.approx(np.pi * (horizon / 3 + 2 * zenith / 3), rel=1e-9)


@pytest.mark.parametrize("number", [1, 5, 12])
def test_open_ground_has_the_illuminance_that_a_sky_was_asked_for(number: int) -> None:
    made = glpath.load_scene(scene(cie_type=number, illuminance=20_000.0, sun=SUN.tolist())).sky
    assert open_ground(made).mean() == pytest.approx(20_000, rel=2e-3)
