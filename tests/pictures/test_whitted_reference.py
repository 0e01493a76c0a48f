"""The ray tracer beside Mitsuba: direct light and mirrors have one answer, whoever computes it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.scene.model import Float64, Light, Material, Scene
from tests.support.objects import ball, camera, ground, scene_of

SPP = 64

RED = Material("red", np.array([0.7, 0.2, 0.1]))
GREEN = Material("green", np.array([0.1, 0.6, 0.2]))
SILVER = Material("silver", np.zeros(3), mirror=np.array([0.9, 0.8, 0.7]))
FLOOR = Material("floor", np.array([0.6, 0.6, 0.5]))
LAMPS = (
    Light("left", "point", np.array([50.0, 45, 40]), position=np.array([-3.0, 4, 3])),
    Light("right", "point", np.array([10.0, 15, 30]), position=np.array([4.0, 1, 2])),
    Light("sun", "directional", np.array([0.8, 0.7, 0.5]), direction=np.array([0.6, -0.8, 0])),
)


def scene() -> Scene:
    return scene_of(
        spheres=[ball((-1.1, -1, 0), 1), ball((0.6, -1.6, 1.6), 0.4), ball((1.3, -0.8, -0.5), 1.2)],
        triangles=[[[-3, -2, -2.5], [3, -2, -2.5], [0, 2.5, -2.5]]],
        planes=[ground(-2)],
        materials=[RED, GREEN, SILVER, GREEN, FLOOR],
        lights=LAMPS,
        view=camera((0, 1, 7), (0, -0.7, 0), fov=40, resolution=(96, 72)),
    )


def as_mitsuba(mitsuba: Any, scene: Scene) -> Any:
    """The scene as a dictionary for Mitsuba; its ground is a large square."""

    def transform(matrix: np.ndarray) -> Any:
        return mitsuba.ScalarTransform4f(np.concatenate([matrix, [[0, 0, 0, 1]]]))

    def bsdf(material: Material) -> dict[str, Any]:
        rgb = {"type": "rgb", "value": material.mirror.tolist()}
        if np.any(material.mirror > 0):
            return {"type": "conductor", "material": "none", "specular_reflectance": rgb}
        return {
            "type": "twosided",
            "bsdf": {"type": "diffuse", "reflectance": rgb | {"value": material.reflectance.tolist()}},
        }

    c = scene.camera
    parts: dict[str, Any] = {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": c.fov,
            "fov_axis": "y",
            "to_world": mitsuba.ScalarTransform4f().look_at(c.position.tolist(), c.target.tolist(), c.up.tolist()),
            "film": {
                "type": "hdrfilm",
                "width": c.resolution[0],
                "height": c.resolution[1],
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
            "sampler": {"type": "multijitter", "sample_count": SPP},
        },
    }
    for shape, part in zip(scene.shapes, scene.shapes.ranges, strict=True):
        material = bsdf(scene.materials[shape.material])
        if shape.primitive == "sphere":
            one = {"type": "sphere", "to_world": transform(scene.spheres[part.start]), "bsdf": material}
        elif shape.primitive == "plane":
            u, v, normal, point = scene.planes[part.start].T
            large = np.stack([1e3 * u, 1e3 * v, normal, point], axis=1)
            one = {"type": "rectangle", "to_world": transform(large), "bsdf": material}
        else:
            a, b, d = scene.triangles[part.start]
            mesh = mitsuba.Mesh("triangle", 3, 1, props=_with_bsdf(mitsuba, material))
            parameters = mitsuba.traverse(mesh)
            parameters["vertex_positions"] = np.concatenate([a, b, d]).astype(np.float32)
            parameters["faces"] = np.arange(3, dtype=np.uint32)
            parameters.update()
            one = mesh
        parts[shape.name] = one
    for light in scene.lights:
        rgb = {"type": "rgb", "value": light.intensity.tolist()}
        if light.kind == "point":
            parts[light.name] = {"type": "point", "position": light.position.tolist(), "intensity": rgb}
        else:
            parts[light.name] = {"type": "directional", "direction": light.direction.tolist(), "irradiance": rgb}
    return parts


def _with_bsdf(mitsuba: Any, material: dict[str, Any]) -> Any:
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(material)
    return properties


@pytest.fixture
def mitsuba() -> Any:
    module = pytest.importorskip("mitsuba", reason="needs the reference extra")
    module.set_variant("scalar_rgb")
    return module


def by_mitsuba(mitsuba: Any, scene: Scene, integrator: dict[str, Any]) -> Float64:
    parts = as_mitsuba(mitsuba, scene) | {"integrator": integrator}
    return np.array(mitsuba.render(mitsuba.load_dict(parts), spp=SPP, seed=1), np.float64)


def assert_alike(ours: Float64, theirs: Float64) -> None:
    ours, theirs = ours.reshape(1, -1, 3), theirs.reshape(1, -1, 3)
    assert theirs.std() > 0.04
    # What is left are edges, which both sample.
    assert np.median(np.abs(ours - theirs) / (theirs + 0.01)) < 5e-3
    assert relative_mse(ours, theirs) < 2e-3
    np.testing.assert_allclose(ours[0].mean(axis=0), theirs[0].mean(axis=0), rtol=3e-3)


@pytest.mark.evidence
def test_direct_light_is_that_of_mitsuba(mitsuba: Any) -> None:
    matt = tuple(
        replace(m, mirror=np.zeros(3), reflectance=np.maximum(m.reflectance, 0.05)) for m in scene().materials
    )
    plain = replace(scene(), materials=matt)
    # Light by light, as Mitsuba would choose one of several by chance.
    one_by_one = [replace(plain, lights=(light,)) for light in plain.lights]
    theirs = sum(by_mitsuba(mitsuba, one, {"type": "path", "max_depth": 2}) for one in one_by_one)
    for shadows in ("rays", "cube"):
        ours = glpath.render(plain, integrator="t-buffer", spp=SPP, max_depth=1, shadows=shadows).mean
        assert_alike(ours, theirs)


@pytest.mark.evidence
def test_mirrors_are_those_of_mitsuba(mitsuba: Any) -> None:
    """Where the eye sees a mirror; elsewhere Mitsuba adds light that comes by way of matt surfaces."""
    ours = glpath.render(scene(), integrator="t-buffer", spp=SPP, max_depth=2).mean
    theirs = by_mitsuba(mitsuba, scene(), {"type": "path", "max_depth": 3})
    lit = replace(scene(), ambient=np.ones(3), lights=())
    mirror = glpath.render(lit, integrator="t-buffer", spp=SPP, max_depth=1).mean.max(axis=-1) == 0
    assert 0.05 < mirror.mean() < 0.3
    assert_alike(ours[mirror], theirs[mirror])
