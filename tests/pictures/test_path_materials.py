"""The path-buffer shades as the ray tracers do: textures, highlights, smooth normals; beside their pictures."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.io import scene_from_dict
from glpath.scene import Scene
from glpath.system.files import shipped_folder

LAMP = {"type": "point", "position": [1.2, 2.5, 1.5], "intensity": 20.0}
FLOOR = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]


def scene_of(material: dict[str, Any], *shapes: dict[str, Any], **more: Any) -> Scene:
    """Shapes of one material on a floor of it, under a point light."""
    return scene_from_dict(
        {
            "camera": {"position": [0, 2.2, 4.5], "target": [0, 0.4, 0], "fov": 35},
            "film": {"resolution": [64, 48]},
            "textures": {"squares": {"type": "checker", "colors": [[0.8, 0.3, 0.2], [0.1, 0.2, 0.6]], "scale": 4}},
            "materials": {"it": material},
            "shapes": [{"type": "quad", "corners": FLOOR, "material": "it"}]
            + [{**shape, "material": "it"} for shape in shapes],
            "lights": [LAMP],
            **more,
        }
    )


BOX = {"type": "box", "min": [-0.9, 0.001, -0.5], "max": [0.1, 0.9, 0.4]}
BALL = {"type": "sphere", "center": [0.6, 0.5, 0.3], "radius": 0.5, "subdivisions": 5}
MATERIALS = {
    "textured": {"texture": "squares"},
    "highlight": {"type": "phong", "reflectance": [0.3, 0.2, 0.1], "specular": 0.6, "exponent": 40},
    "both, one-sided": {"type": "phong", "texture": "squares", "specular": 0.3, "exponent": 8, "two_sided": False},
}


@pytest.mark.parametrize("name", MATERIALS)
def test_direct_light_is_that_of_the_ray_tracer(name: str):
    """Both in one light, so that nothing is noise but where in the pixel the edges fall."""
    scene = scene_of(MATERIALS[name], BOX)
    path = glpath.render(scene, spp=64, max_depth=1).mean
    rays = glpath.render(scene, integrator="t-buffer", spp=64, max_depth=1).mean
    assert path.mean() == pytest.approx(rays.mean(), rel=0.003)
    assert relative_mse(path, rays) < 2e-4


@pytest.mark.parametrize("name", MATERIALS)
def test_a_tessellated_sphere_is_shaded_as_the_exact_one(name: str):
    scene = scene_of(MATERIALS[name], BALL)
    path = glpath.render(scene, spp=64, max_depth=1).mean
    rays = glpath.render(scene, integrator="t-buffer", spp=64, max_depth=1).mean
    assert path.mean() == pytest.approx(rays.mean(), rel=0.004)
    assert relative_mse(path, rays) < 6e-4


def test_three_spheres_without_mirrors_are_those_of_the_ray_tracer():
    """The T-buffer paper's scene, its endless ground a wide quad, which is what the path-buffer knows."""
    described = tomllib.loads((shipped_folder("scenes") / "three-spheres.toml").read_text())
    described["film"]["resolution"] = [96, 96]
    described["textures"]["tiles"]["scale"] = 64
    for material in described["materials"].values():
        material.pop("mirror", None)
    ground, *spheres = described["shapes"]
    del ground["normal"]
    ground |= {"type": "quad", "corners": [[-80, -80, 0], [80, -80, 0], [80, 80, 0], [-80, 80, 0]]}
    for sphere in spheres:
        sphere["subdivisions"] = 4
    scene = scene_from_dict(described)
    rays = [glpath.render(scene, integrator="t-buffer", spp=64, max_depth=1, seed=i).mean for i in (1, 2)]
    path = glpath.render(scene, spp=64, max_depth=1).mean
    assert path.mean() == pytest.approx(rays[0].mean(), rel=0.003)
    # Beside the noise of edges, which both have, facets and the shadow-buffer's texels are left.
    assert relative_mse(path, rays[0]) < 1e-3
    assert relative_mse(rays[1], rays[0]) < 1e-3


def test_facets_are_seen_without_smooth_normals():
    """What the test above would miss without them: a sphere of few triangles is flat in places."""
    ball = {**BALL, "subdivisions": 2}
    scene = scene_of(MATERIALS["highlight"], ball)
    exact = glpath.render(scene, integrator="t-buffer", spp=64, max_depth=1).mean
    triangles = glpath.scene.path_traceable(scene)
    flat = [
        replace(s, geometry=replace(s.geometry, normals=None)) if s.kind == "mesh" else s for s in triangles.shapes
    ]
    errors = [
        relative_mse(glpath.render(s, spp=32, max_depth=1).mean, exact)
        for s in (scene, replace(triangles, shapes=flat))
    ]
    assert errors[0] < 0.5 * errors[1]


def test_a_texture_of_one_colour_is_that_colour_on_every_bounce():
    """Bit for bit, also in the light that the textured walls send on."""
    plain = scene_of({"reflectance": [0.5, 0.25, 0.75]}, BOX)
    textures = {"one": {"type": "checker", "colors": [[0.5, 0.25, 0.75], [0.5, 0.25, 0.75]]}}
    textured = scene_of({"texture": "one"}, BOX, textures=textures)
    films = [glpath.render(scene, spp=8, max_depth=4) for scene in (plain, textured)]
    np.testing.assert_array_equal(films[0].radiance_sums, films[1].radiance_sums)


def test_a_mirror_is_refused_with_shared_directions_by_name():
    scene = scene_of({"type": "phong", "mirror": 0.5}, BOX)
    with pytest.raises(glpath.SceneError, match=r"a mirror \(it\)"):
        glpath.render(scene, spp=1, integrator="path-buffer")


def room_of(wall: dict[str, Any], **more: Any) -> Scene:
    """A closed room with a lamp below its ceiling."""
    return scene_from_dict(
        {
            "camera": {"position": [0, 0, 0.9], "target": [0, -0.3, -1], "fov": 70},
            "film": {"resolution": [32, 24]},
            "materials": {"wall": wall},
            "shapes": [
                {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1], "flip_normals": True, "material": "wall"},
                {
                    "type": "quad",
                    "corners": [[-0.3, 0.99, -0.3], [0.3, 0.99, -0.3], [0.3, 0.99, 0.3], [-0.3, 0.99, 0.3]],
                    "emission": {"radiance": 10},
                },
            ],
            **more,
        }
    )


def test_a_gather_takes_a_texture_of_one_colour_for_that_colour():
    colour = [0.5, 0.25, 0.75]
    textures = {"one": {"type": "checker", "colors": [colour, colour]}}
    films = [
        glpath.render(scene, integrator="gather", spp=4)
        for scene in (room_of({"reflectance": colour}), room_of({"texture": "one"}, textures=textures))
    ]
    np.testing.assert_allclose(films[0].mean, films[1].mean, rtol=1e-5)


def test_a_gather_shows_a_texture_as_sharp_as_path_tracing_does():
    textures = {"squares": {"type": "checker", "colors": [0.7, 0.1], "scale": 2}}
    scene = room_of({"texture": "squares"}, textures=textures)
    gather = glpath.render(scene, integrator="gather", spp=128).mean
    path = glpath.render(scene, spp=128, max_depth=9, seed=1).mean
    assert gather.mean() == pytest.approx(path.mean(), rel=0.02)
    assert relative_mse(gather, path) < 4e-3


def test_radiosity_refuses_a_highlight_by_name():
    with pytest.raises(glpath.SceneError, match=r"materials\.wall\.specular"):
        glpath.solve_radiosity(room_of({"type": "phong", "specular": 0.5}))
