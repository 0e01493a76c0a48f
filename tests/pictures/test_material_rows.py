"""Every kind of glTF's materials in every engine that has it: floors beside a wall of each.

The table of docs/howto/materials.md says what is tested here. Each cell is a white floor before a wall of one
material, under a lamp that reaches over the wall. Black partitions keep it apart from its neighbours. Paths are
the reference: each lobe has a closed form of its own elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import GlpathError
from glpath.io.gltf import read_gltf
from glpath.scene import Scene
from glpath.scene.geometry import Float64, Mesh, Shape
from glpath.scene.material import Material, Texture, TextureSlot
from glpath.scene.model import Camera, Shapes

GOLD = np.array([1.0, 0.8, 0.4])
HALF = TextureSlot(0)
BUMP = TextureSlot(1)


def of(name: str, colour: Any = (0.6, 0.6, 0.6), **fields: Any) -> Material:
    return Material(name, np.array(colour, float), **{"roughness": 0.5, **fields})


ROWS = {
    each.name: each
    for each in (
        of("plain"),
        of("sheen", 0.1 * np.ones(3), sheen=np.ones(3), sheen_roughness=0.5, sheen_texture=HALF),
        of(
            "clearcoat", 0.1 * np.ones(3), clearcoat=1.0, clearcoat_roughness=0.3, clearcoat_texture=HALF,
            clearcoat_normal_texture=BUMP,
        ),
        of("specular", 0.1 * np.ones(3), specular_colour=GOLD * 4, specular_colour_texture=HALF),
        of("anisotropy", GOLD, metallic=1.0, anisotropy=0.7, anisotropy_texture=HALF),
        of(
            "iridescence", GOLD, metallic=1.0, iridescence=1.0, iridescence_thickness=400.0,
            iridescence_texture=HALF,
        ),
        of("diffuse transmission", diffuse_transmission=0.8, diffuse_transmission_texture=HALF),
        of("rough metal", np.ones(3), metallic=1.0, roughness=0.8),
        of("rough glass", np.ones(3), transmission=1.0, roughness=0.4),
        of("culled", two_sided=False, culled=True),
        of("none", np.zeros(3), alpha="mask", opacity=0.0),
    )
}  # fmt: skip
NAMES = tuple(ROWS)


def quad(corners: Any, uv: bool = False) -> Mesh:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(np.array(corners, float), faces, uv=square if uv else None)


@cache
def cells() -> Scene:
    """Cell i is at x in (i, i + 1): a floor at y = 0, a wall at z = 0 that looks along +z, or -z if culled."""
    white, black = len(ROWS), len(ROWS) + 1
    shapes = []
    for i, material in enumerate(ROWS.values()):
        a, b = i + 0.02, i + 0.98
        shapes.append(Shape(f"floor {i}", quad([[a, 0, 1], [b, 0, 1], [b, 0, 0.01], [a, 0, 0.01]]), white))
        wall = [[a, 0, 0], [b, 0, 0], [b, 0.9, 0], [a, 0.9, 0]]
        if material.culled:
            wall = wall[1::-1] + wall[:1:-1]
        shapes.append(Shape(f"wall {i}", quad(wall, uv=True), i))
    for i in range(len(ROWS) + 1):
        sides = [[i, 0, 1.02], [i, 0, -0.8], [i, 1.5, -0.8], [i, 1.5, 1.02]]
        shapes.append(Shape(f"side {i}", quad(sides), black))
    n = len(ROWS)
    lamp = [[0.0, 1.4, -0.7], [n, 1.4, -0.7], [n, 1.4, 0.5], [0, 1.4, 0.5]]
    shapes.append(Shape("lamp", quad(lamp), black, emission=np.full(3, 5.0), emission_two_sided=False))
    materials = (
        *ROWS.values(),
        Material("white", np.full(3, 0.8)),
        Material("black", np.zeros(3)),
    )
    middle = np.array([0.5 * n, 0.0, 0.5])
    eye, up = middle + np.array([0, 1.3, 0]), np.array([0.0, 0, -1])
    camera = Camera(eye, middle, up, 40.0, (8 * n, 8), projection="orthographic", height=1.0)
    half = Texture("half", np.full((1, 1, 4), 128, np.uint8))
    bump = Texture("bump", np.array([[[150, 128, 250]]], np.uint8))
    return Scene("cells", camera, Shapes(shapes), materials, textures=(half, bump))


def of_cells(picture: Float64) -> Float64:
    """(rows, 3): the mean of each floor in a picture of them all."""
    inner = np.asarray(picture, float).reshape(8, len(ROWS), 8, 3)[1:-1, :, 1:-1]
    return np.asarray(inner.mean(axis=(0, 2)))


@cache
def by_paths() -> Float64:
    return of_cells(glpath.render(cells(), integrator="path", guide="cosine", spp=1024).mean)


@cache
def by_gather() -> Float64:
    solution = glpath.solve_radiosity(cells(), method="monte-carlo", patches=200, particles=1 << 17)
    return of_cells(glpath.render(cells(), integrator="gather", radiosity=solution, spp=256).mean)


def test_each_wall_sends_light_to_its_floor_and_that_which_is_not_there_none() -> None:
    found = dict(zip(NAMES, by_paths(), strict=True))
    for name in set(NAMES) - {"none", "culled"}:
        assert np.abs(found[name] / found["none"] - 1).max() > 0.02, name
    np.testing.assert_allclose(found["culled"], found["none"], rtol=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_a_gather_lights_its_floor_as_paths_do(name: str) -> None:
    """But for what its solution, to which all is diffuse, does not know of what comes after the first bounce."""
    i = NAMES.index(name)
    np.testing.assert_allclose(by_gather()[i], by_paths()[i], rtol=0.05)


SHARED = {"rough glass": "glass", "diffuse transmission": "a diffuse transmission"}


@pytest.mark.parametrize("name", NAMES)
def test_shared_directions_have_what_is_opaque_and_say_what_they_have_not(name: str) -> None:
    i = NAMES.index(name)
    middle = np.array([i + 0.5, 0.0, 0.5])
    alone = replace(cells(), shapes=Shapes([*cells().shapes[2 * i : 2 * i + 2], cells().shapes[-1]]))
    alone = alone.with_camera(resolution=(8, 8), position=middle + np.array([0, 1.3, 0]), target=middle)
    options: dict[str, Any] = {"max_depth": 2, "spp": 1}
    if name in SHARED:
        with pytest.raises(GlpathError, match=SHARED[name]):
            glpath.render(alone, integrator="path-buffer", **options)
    else:
        glpath.render(alone, integrator="path-buffer", **options)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
def test_a_gltf_file_takes_each_there_and_back(tmp_path: Path) -> None:
    from glpath.io.export.gltf import write_gltf

    write_gltf(cells(), tmp_path / "a.glb")
    found = {material.name: material for material in read_gltf(tmp_path / "a.glb").materials}
    for name, material in ROWS.items():
        back = found[name]
        for field in (
            "sheen", "clearcoat", "specular_colour", "anisotropy", "iridescence", "diffuse_transmission",
            "transmission", "metallic", "roughness", "culled",
        ):  # fmt: skip
            np.testing.assert_allclose(getattr(back, field), getattr(material, field), rtol=1e-6, err_msg=name)
        assert back.slots.keys() == material.slots.keys()
