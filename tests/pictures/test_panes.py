"""Rays to lights through panes of thin glass: each takes its share, however many there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import glpath
from glpath.scene.model import Float64, Material, Mesh, Shape, Texture, TextureSlot
from tests.support.surfaces import BLACK, GREY, camera, lamp, level, scene_of

#: It reflects nothing, so that its colour is all that a pane does.
PANE = Material("pane", np.array([0.9, 0.6, 0.3]), roughness=0.0, transmission=1.0, specular_weight=0.0)
_HALF = np.full((4, 4, 3), 0.5, np.float32)
_HALF[0, 0] = _HALF[-1, 0] = 0.0
#: Black where texture coordinates are 0, through which no light comes.
TEXTURE = Texture("half", _HALF, filter="nearest")
TILTED = np.array([0.3, 0.9, 0.1]) / np.linalg.norm([0.3, 0.9, 0.1])
PANES = {
    "plain": (PANE, 1.0),
    "textured": (replace(PANE, texture=TextureSlot(0)), 0.5),
    "with normals": (PANE, 1.0),
    "masked": (replace(PANE, alpha="mask", opacity=0.8), 1.0),
    "masked away": (replace(PANE, alpha="mask", opacity=0.2), None),
    "opaque paint": (BLACK, 0.0),
}


def floor_under(panes: list[Mesh], pane: Material) -> Float64:
    """(8, 8, 3): direct light of a floor under a lamp, with panes between the two."""
    shapes = [Shape("floor", level(0.0, 4.0), 0), lamp(level(2.0, 0.5, down=True), 1)]
    shapes += [Shape(f"pane {i}", mesh, 2) for i, mesh in enumerate(panes)]
    scene = scene_of(shapes, [GREY, BLACK, pane], camera([1.5, 0.3, 0], (0.8, 0, 0), fov=30, pixels=8), (TEXTURE,))
    return np.asarray(glpath.render(scene, integrator="path", guide="cosine", max_depth=1, spp=16).mean)


@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("name", PANES)
def test_panes_on_the_way_to_a_lamp_each_let_their_share_through(name: str, count: int) -> None:
    material, share = PANES[name]
    meshes = [level(0.8 + 0.1 * i, 3.0) for i in range(count)]
    if name == "with normals":
        meshes = [replace(mesh, normals=np.broadcast_to(TILTED, (4, 3)).copy()) for mesh in meshes]
    expected = np.ones(3) if share is None else (PANE.reflectance * share) ** count
    bare, found = floor_under([], material), floor_under(meshes, material)
    print(name, count, bare.mean(axis=(0, 1)), found.mean(axis=(0, 1)), expected)
    assert bare.min() > 0.01
    np.testing.assert_allclose(found, bare * expected, rtol=1e-4)
