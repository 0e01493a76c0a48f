"""Glass whose index is that of the air around it bends nothing, however rough it is, and is not black."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.io import load_scene
from glpath.scene import Scene
from tests.support.engines import coarse, with_depth


def ball(ior: float, roughness: float, thin: bool = False) -> Scene:
    """A ball of glass before a white sky with a dark stripe of a wall."""
    return load_scene(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 30},
            "film": {"resolution": [24, 24]},
            "materials": {
                "glass": {
                    "type": "principled",
                    "reflectance": [0.9, 0.8, 0.7],
                    "roughness": roughness,
                    "transmission": 1.0,
                    "ior": ior,
                    "thin": thin,
                },
                "grey": {"reflectance": 0.2},
            },
            "shapes": [
                {"type": "sphere", "center": [0, 0, 0], "radius": 0.8, "subdivisions": 3, "material": "glass"},
                {
                    "type": "quad",
                    "corners": [[-3, -3, -2], [0, -3, -2], [0, 3, -2], [-3, 3, -2]],
                    "material": "grey",
                },
            ],
            "sky": {"zenith": 1.0, "horizon": 1.0},
        }
    )


def mean(scene: Scene, **options: Any) -> Any:
    """Of 8 x 8 pixels in the ball, per side of the stripe's edge, where nothing is hidden by noise."""
    if options.get("integrator") == "gather":
        options["radiosity"] = coarse(scene)
    film = glpath.render(scene, spp=128, **with_depth(options, 12))
    inner = film.mean[8:16, 8:16]
    return np.stack([inner[:, :3].mean(axis=(0, 1)), inner[:, 5:].mean(axis=(0, 1))])


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("integrator", ["path", "gather"])
def test_rough_glass_of_index_one_is_the_limit_of_others(roughness: float, integrator: str) -> None:
    """Of 1.002 the lobes are evaluated, of 1 they are straight; what masks microfacets is the same."""
    options: dict[str, Any] = {"integrator": integrator} | ({"guide": "cosine"} if integrator == "gather" else {})
    one, near = (mean(ball(ior, roughness), **options) for ior in (1.0, 1.002))
    np.testing.assert_allclose(one, near, rtol=0.02)
    assert one.min() > 0.05


def test_smooth_glass_of_index_one_is_a_filter() -> None:
    """Straight through both sides: the base colour twice."""
    found = mean(ball(1.0, 0.0))
    np.testing.assert_allclose(found[1], np.array([0.9, 0.8, 0.7]) ** 2, rtol=1e-3)


@pytest.mark.parametrize("roughness", [0.3, 0.7])
def test_thin_rough_glass_of_index_one_is_the_limit_of_others(roughness: float) -> None:
    one, near = (mean(ball(ior, roughness, thin=True)) for ior in (1.0, 1.001))
    np.testing.assert_allclose(one, near, rtol=0.02)
