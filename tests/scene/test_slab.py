"""Window glass: the shares of a sheet against tables, sums of beams and Radiance's formula; and how it is read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError
from glpath.scene.slab import clearest, hemispherical, inside_of, slab


def beams(cosine: float, ior: float, inside: float) -> tuple[float, float]:
    """Ray by ray: what leaves a sheet on either side after up to 200 reflections inside."""
    within = np.sqrt(1 - (1 - cosine**2) / ior**2)
    reflected = passed = 0.0
    for r in ((cosine - ior * within) / (cosine + ior * within), (ior * cosine - within) / (ior * cosine + within)):
        f, once = r * r, inside ** (1 / within)
        reflected += 0.5 * f
        energy = 0.5 * (1 - f)
        for crossing in range(200):
            energy *= once
            if crossing % 2 == 0:
                passed += energy * (1 - f)
            else:
                reflected += energy * (1 - f)
            energy *= f
    return reflected, passed


@pytest.mark.parametrize("inside", [1.0, 0.9, 0.4])
@pytest.mark.parametrize("cosine", [1.0, 0.8, 0.5, 0.2, 0.05])
def test_shares_are_the_sum_of_all_beams(cosine: float, inside: float) -> None:
    found = slab(cosine, 1.52, inside)
    assert found == pytest.approx(beams(cosine, 1.52, inside), rel=1e-9)
    assert sum(found) == pytest.approx(1.0, abs=1e-12) if inside == 1 else sum(found) < 1


def test_transmittance_at_normal_incidence_is_the_one_that_is_given() -> None:
    for ior in (1.2, 1.52, 2.0):
        for wanted in (0.05, 0.5, clearest(ior)):
            assert slab(1.0, ior, inside_of(wanted, ior))[1] == pytest.approx(wanted, rel=1e-12)
    # Radiance's manual: tn = (sqrt(.8402528435+.0072522239*Tn*Tn)-.9166530661)/.0036261119/Tn, of the index 1.52.
    for wanted in (0.3, 0.6, 0.88):
        theirs = (np.sqrt(0.8402528435 + 0.0072522239 * wanted**2) - 0.9166530661) / 0.0036261119 / wanted
        assert inside_of(wanted, 1.52) == pytest.approx(theirs, rel=1e-6)


@pytest.mark.evidence  # needs the reference extra
def test_shares_of_clear_glass_beside_mitsuba() -> None:
    """Mitsuba's thindielectric, by the chances of its two directions.

    It takes the mean of both polarizations before it adds the beams up, where each goes on as it is: up to 3.5 %
    less light, and straight ahead the same.
    """
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    glass = mitsuba.load_dict({"type": "thindielectric", "int_ior": 1.52, "ext_ior": 1.0})
    for cosine in (1.0, 0.7, 0.4, 0.1):
        hit = mitsuba.SurfaceInteraction3f()
        hit.wi = mitsuba.Vector3f(float(np.sqrt(1 - cosine**2)), 0.0, cosine)
        sampled, _ = glass.sample(mitsuba.BSDFContext(), hit, 0.999999, mitsuba.Point2f(0.5, 0.5), True)
        assert sampled.wo.z < 0
        within = np.sqrt(1 - (1 - cosine**2) / 1.52**2)
        across = (cosine - 1.52 * within) / (cosine + 1.52 * within)
        along = (1.52 * cosine - within) / (1.52 * cosine + within)
        mixed = (across**2 + along**2) / 2
        assert float(sampled.pdf) == pytest.approx(1 - 2 * mixed / (1 + mixed), rel=1e-4)
        excess = float(slab(cosine, 1.52, 1.0)[1]) / float(sampled.pdf) - 1
        assert -1e-4 < excess < (1e-4 if cosine == 1 else 0.035)


def test_light_from_everywhere() -> None:
    """What is not let through is reflected, where the glass takes nothing."""
    reflected, passed = hemispherical(1.52, np.ones(3))
    np.testing.assert_allclose(reflected + passed, 1.0, atol=1e-9)
    cosine = (np.arange(20_000) + 0.5) / 20_000
    np.testing.assert_allclose(passed, 2 * np.mean(cosine * slab(cosine, 1.52, 1.0)[1]), rtol=1e-6)


def scene(**glass: Any) -> dict[str, Any]:
    """A pane, seen through at 60 degrees against a white sky, and nothing else."""
    corners = [[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]]
    return {
        "camera": {"position": [0, 1, np.sqrt(3)], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 1},
        "film": {"resolution": [4, 4]},
        "materials": {"pane": {"type": "glazing", **glass}},
        "shapes": [{"type": "quad", "corners": corners, "material": "pane"}],
        "sky": {"zenith": 0.0, "horizon": 2.0},
    }


@pytest.mark.parametrize("transmittance", [0.9, [0.3, 0.6, 0.8]])
def test_a_pane_reflects_and_lets_through_by_its_angle(transmittance: Any) -> None:
    """Below the horizon the sky is 2 everywhere; above it falls with the sine, and is 1 where the sheet mirrors."""
    made = glpath.load_scene(scene(transmittance=transmittance))
    film = glpath.render(made, integrator="path", spp=256)
    reflected, passed = slab(0.5, 1.52, inside_of(np.broadcast_to(transmittance, 3), 1.52))
    np.testing.assert_allclose(film.mean.mean(axis=(0, 1)), 1.0 * reflected + 2.0 * passed, rtol=0.01)


def window(pane: dict[str, Any], integrator: str, spp: int) -> tuple[Any, Any]:
    """Irradiance by a white sky at two points between a sheet and a black floor.

    The floor is as wide as the sheet, as the sheet reflects the sky below a smaller floor's edges.
    """
    up = [0.0, 1.0, 0.0]
    wide = [[-50, 0.5, 50], [50, 0.5, 50], [50, 0.5, -50], [-50, 0.5, -50]]
    floor = [[-50, -0.2, 50], [50, -0.2, 50], [50, -0.2, -50], [-50, -0.2, -50]]
    lit = {
        "materials": {"pane": pane, "black": {"reflectance": 0.0}},
        "shapes": [
            {"type": "quad", "corners": wide, "material": "pane"},
            {"type": "quad", "corners": floor, "material": "black"},
        ],
        "camera": {"position": [0, 3, 3], "target": [0, 0, 0]},
        "sky": {"zenith": 1.0},
    }
    found = glpath.irradiance(lit, [[0, 0.0, 0], [1, 0, 0]], up, integrator=integrator, spp=spp)
    return found.values, found.standard_errors


@pytest.mark.parametrize("integrator", ["path", "gather"])
def test_diffuse_transmittance_of_a_window(integrator: str) -> None:
    """Under a sheet that is seen almost everywhere: the closed form's light from everywhere."""
    values, errors = window({"type": "glazing", "transmittance": 0.8}, integrator, 1024)
    _, passed = hemispherical(1.52, inside_of(np.full(3, 0.8), 1.52))
    assert (np.abs(values / np.pi - passed) < 4 * errors / np.pi + 3e-3).all(), (values / np.pi, passed)


def test_gltf_panes_keep_their_formula() -> None:
    """One face, by Schlick's formula: light from everywhere passes by (1 - f0) (1 - 1/21)."""
    pane = {"type": "principled", "thin": True, "transmission": 1, "roughness": 0, "reflectance": 1, "ior": 1.52}
    values, errors = window(pane, "path", 1024)
    f0 = (0.52 / 2.52) ** 2
    expected = (1 - f0) * (1 - 1 / 21)
    assert (np.abs(values / np.pi - expected) < 4 * errors / np.pi + 3e-3).all()
    assert expected > 1.05 * hemispherical(1.52, np.ones(3))[1][0]


@pytest.mark.parametrize(
    ("glass", "message"),
    [
        ({"transmittance": 0.95}, "above 0 and at most 0.918, what two faces of the index 1.52 leave"),
        ({"transmittance": 0}, "above 0"),
        ({}, "transmittance"),
        ({"transmittance": 0.5, "reflectance": 0.1}, "is of glazing, which reflects by its index"),
        ({"transmittance": 0.5, "two_sided": False}, "two_sided.* is false of glazing, which lets light through"),
        ({"transmittance": 0.5, "ior": 1.0}, "ior"),
        ({"transmittance": 0.5, "culled": True, "two_sided": False}, "culled"),
    ],
)
def test_wrong_panes_are_refused(glass: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        glpath.load_scene(scene(**glass))
