"""The `path` engine as it is without options, beside Mitsuba with all bounces: whole rooms, and no bias in any.

What is compared is the mean of the picture and the means of its blocks, against what seeds say of their errors.
Materials that Mitsuba has not are glTF's formulas, written for it (tests/reference/gltf_in_mitsuba.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.io import load_scene, scene_from_dict
from glpath.io.export.mitsuba import MitsubaScene, described
from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene import Scene
from glpath.scene.material import Material
from glpath.scene.model import Float64, Mesh, Shape, Shapes
from glpath.scene.triangulate import path_traceable

SEEDS = 8
#: Vertices of Mitsuba's paths, which roulette ends.
ALL_LIGHT = 256
BLOCKS = 8
#: No lobe of the formulas written for Mitsuba is smooth.
DULLEST_MIRROR = 0.1


CAMERA = {"position": [0, 1, 2.8], "target": [0, 0.9, 0], "fov": 60}
WHITE = {"reflectance": [0.8, 0.75, 0.7]}
WALLS: list[dict[str, Any]] = [
    {"type": "quad", "corners": [[-2, 0, 3], [2, 0, 3], [2, 0, -2], [-2, 0, -2]], "material": "white"},
    {"type": "quad", "corners": [[-2, 0, -2], [2, 0, -2], [2, 2, -2], [-2, 2, -2]], "material": "white"},
    {"type": "quad", "corners": [[-2, 2, 3], [2, 2, 3], [2, 0, 3], [-2, 0, 3]], "material": "white"},
    {"type": "quad", "corners": [[-2, 0, 3], [-2, 0, -2], [-2, 2, -2], [-2, 2, 3]], "material": "white"},
    {"type": "quad", "corners": [[-2, 2, -2], [2, 2, -2], [2, 2, 3], [-2, 2, 3]], "material": "white"},
]
#: Lit by nothing but a blue sky, through a hole of a square metre in its right wall.
WINDOWED: dict[str, Any] = {
    "camera": CAMERA,
    "materials": {"white": WHITE, "red": {"reflectance": [0.7, 0.2, 0.1]}},
    "sky": {"zenith": [2.0, 3.0, 6.0], "horizon": [2.0, 3.0, 6.0]},
    "shapes": [
        *WALLS,
        {"type": "quad", "corners": [[2, 0, -2], [2, 0, 3], [2, 0.5, 3], [2, 0.5, -2]], "material": "white"},
        {"type": "quad", "corners": [[2, 1.5, -2], [2, 1.5, 3], [2, 2, 3], [2, 2, -2]], "material": "white"},
        {"type": "quad", "corners": [[2, 0.5, -2], [2, 0.5, -1], [2, 1.5, -1], [2, 1.5, -2]], "material": "white"},
        {"type": "quad", "corners": [[2, 0.5, 0], [2, 0.5, 3], [2, 1.5, 3], [2, 1.5, 0]], "material": "white"},
        {"type": "box", "min": [-0.9, 0, -1.0], "max": [-0.2, 0.9, -0.4], "material": "red"},
    ],
}
#: Rough metal and plastic, and a ball of glass, under a lamp.
GLOSSY: dict[str, Any] = {
    "camera": CAMERA,
    "materials": {
        "white": WHITE,
        "metal": {"type": "principled", "reflectance": [0.9, 0.7, 0.4], "metallic": 1.0, "roughness": 0.25},
        "plastic": {"type": "principled", "reflectance": [0.7, 0.2, 0.1], "roughness": 0.3},
        "polished": {"type": "principled", "reflectance": [0.4, 0.4, 0.45], "roughness": 0.15},
        "glass": {
            "type": "principled",
            "reflectance": [1, 1, 1],
            "roughness": 0.0,
            "transmission": 1.0,
            "thin": False,
        },
    },
    "shapes": [
        {**WALLS[0], "material": "polished"},
        *WALLS[1:],
        {"type": "quad", "corners": [[2, 0, -2], [2, 0, 3], [2, 2, 3], [2, 2, -2]], "material": "white"},
        {"type": "sphere", "center": [-0.9, 0.5, -0.6], "radius": 0.5, "subdivisions": 3, "material": "metal"},
        {"type": "sphere", "center": [0.9, 0.4, -0.4], "radius": 0.4, "subdivisions": 3, "material": "plastic"},
        {"type": "sphere", "center": [0.1, 0.3, 0.5], "radius": 0.3, "subdivisions": 3, "material": "glass"},
        {
            "type": "quad",
            "corners": [[-0.4, 1.95, -0.8], [0.4, 1.95, -0.8], [0.4, 1.95, -0.2], [-0.4, 1.95, -0.2]],
            "material": "white",
            "emission": {"radiance": [12, 11, 9]},
        },
    ],
}


def flat(shape: Shape) -> Shape:
    """Without smooth normals: glpath divides by the light that these lose, and Mitsuba does not."""
    assert isinstance(shape.geometry, Mesh)
    return replace(shape, geometry=replace(shape.geometry, normals=None))


def flattened(scene: Scene) -> Scene:
    """Flat, and with microfacets that scatter light once, as Mitsuba's do."""
    scene = path_traceable(scene)
    materials = tuple(replace(each, multiple_scattering=False) for each in scene.materials)
    return replace(scene, materials=materials, shapes=Shapes(flat(shape) for shape in scene.shapes))


def without_mirrors(material: Material) -> Material:
    if material.transmission == 0 and material.roughness is not None:
        material = replace(material, roughness=max(material.roughness, DULLEST_MIRROR))
    if material.clearcoat > 0:
        material = replace(material, clearcoat_roughness=max(material.clearcoat_roughness, DULLEST_MIRROR))
    return material


def parlour() -> Scene:
    """Without what bends normals, by which glpath's and Mitsuba's lobes lose light in different ways."""
    scene = flattened(load_scene("parlour"))
    materials = tuple(replace(without_mirrors(each), normal_texture=None) for each in scene.materials)
    return replace(scene, materials=materials)


def by_formula(plugin: Plugin, material: Material) -> Plugin:
    """A plugin of the export's, with glTF's lobes in place of Mitsuba's."""
    kind = plugin.get("type")
    if kind == "twosided":
        inner = by_formula(plugin["bsdf"], material)
        return inner if inner["type"] == "gltf" else {**plugin, "bsdf": inner}
    if kind == "principled":
        kept = {key: plugin[key] for key in ("base_color", "roughness", "metallic") if key in plugin}
        found: Plugin = {"type": "gltf", **kept, "ior": material.ior, "specular": material.specular_weight}
        if material.clearcoat > 0:
            found["clearcoat"] = material.clearcoat
            found["clearcoat_roughness"] = material.clearcoat_roughness
        return found
    if kind == "thindielectric":
        return {"type": "pane", "base_color": plugin["specular_transmittance"], "ior": material.ior}
    return plugin


def translated(scene: Scene) -> MitsubaScene:
    made = described(scene, ALL_LIGHT, instances=False)
    plugins = dict(made.plugins)
    for material in scene.materials:
        name = material.name.replace("/", "-")
        if name in plugins:
            plugins[name] = by_formula(plugins[name], material)
    return MitsubaScene(plugins, ())


def by_mitsuba(scene: Scene, spp: int) -> Float64:
    """(SEEDS, H, W, 3)"""
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    import drjit

    from benchmarks.peers import mitsuba as peer
    from tests.reference import gltf_in_mitsuba

    gltf_in_mitsuba.register(peer.load_mitsuba(), drjit)
    theirs = peer.in_memory(translated(scene))
    return np.stack([peer.render_peer(theirs, spp, seed) for seed in range(1, SEEDS + 1)])


def blocks(films: Float64) -> Float64:
    """(SEEDS, BLOCKS, BLOCKS, 3)"""
    seeds, height, width, _ = films.shape
    shape = seeds, BLOCKS, height // BLOCKS, BLOCKS, width // BLOCKS, 3
    return np.asarray(films.reshape(shape).mean(axis=(2, 4)))


#: Path sets and Mitsuba's samples of a seed, by which both means are known about as well. Sobol: powers of two.
ROOMS: dict[str, tuple[Any, int, int]] = {
    "box": (lambda: load_scene("cornell-box-36"), 64, 128),
    "room": (lambda: load_scene("room"), 64, 128),
    "windowed": (lambda: flattened(scene_from_dict(WINDOWED)), 512, 512),
    "glossy": (lambda: flattened(scene_from_dict(GLOSSY)), 128, 512),
    "parlour": (parlour, 64, 128),
}


@pytest.mark.evidence
@pytest.mark.parametrize("name", ROOMS)
def test_unbiased_paths_have_mitsubas_mean(name: str) -> None:
    """Within four errors of both in the whole picture, and in its blocks no more than their errors say."""
    make, spp, their_spp = ROOMS[name]
    scene = make()
    scene = replace(scene, camera=replace(scene.camera, resolution=(64, 64)))
    theirs = blocks(by_mitsuba(scene, their_spp))
    films = [glpath.render(scene, spp=spp, seed=seed, integrator="path") for seed in range(SEEDS)]
    assert all(film.metadata.statistics["dropped_samples"] == 0 for film in films)
    ours = blocks(np.stack([film.mean for film in films]))
    whole = [each.mean(axis=(1, 2, 3)) for each in (ours, theirs)]
    error = np.sqrt(sum(each.var(ddof=1) / SEEDS for each in whole))
    off = whole[0].mean() - whole[1].mean()
    errors = np.sqrt(sum(each.var(axis=0, ddof=1) / SEEDS for each in (ours, theirs)))
    z = (ours.mean(axis=0) - theirs.mean(axis=0)) / errors
    print(
        f"{name}: mean {off / whole[1].mean():+.3%}, error {error / whole[1].mean():.3%}, "
        f"blocks {np.sqrt(np.mean(z**2)):.2f} errors, the worst {np.abs(z).max():.1f}"
    )
    assert error < 0.003 * whole[1].mean()
    assert abs(off) < 4 * error
    # Errors known from eight seeds: Student's t of about 14 degrees of freedom, whose square has the mean 7 / 6.
    assert np.sqrt(np.mean(z**2)) < 1.25
