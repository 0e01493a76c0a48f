"""The textured room that ships, and the patterns on its surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmarks.scenes import patterns
from benchmarks.scenes.parlour import ROOM
from glpath.io import load_scene
from glpath.scene import Scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("parlour")


def test_it_has_what_a_users_model_has(scene: Scene) -> None:
    materials = {material.name.removeprefix("parlour/"): material for material in scene.materials}
    assert scene.camera.resolution == (512, 384)
    assert 10_000 < len(scene.triangles) < 30_000
    for name in ("boards", "wallpaper", "walnut"):
        assert set(materials[name].slots) == {"texture", "normal_texture", "surface_texture"}
    assert "emission_texture" in materials["view"].slots
    assert (materials["brass"].metallic, materials["mirror"].roughness) == (1, 0)
    assert materials["pane"].is_thin_dielectric
    assert not materials["glass"].thin
    assert sum(shape.emits for shape in scene.shapes) == 4
    low, high = scene.bounds
    assert (low < -1).any(), "the view is outside"
    assert np.all(scene.camera.position < ROOM)
    assert np.all(scene.camera.position > 0)
    assert np.all(high > np.array(ROOM) - 1e-6)


def test_the_vase_is_closed_around_its_glass(scene: Scene) -> None:
    (vase,) = (shape.geometry for shape in scene.shapes if shape.name == "parlour/glass-vase")
    mesh = trimesh.Trimesh(vase.vertices, vase.faces).copy()
    mesh.merge_vertices(digits_vertex=7)
    assert mesh.is_watertight
    assert 1e-5 < mesh.volume < 1e-3, "a litre is a thousandth of a cubic metre"


@pytest.mark.parametrize(
    "make",
    [
        lambda seed: patterns.boards(seed),
        lambda seed: patterns.wood(seed, (0.1, 0.1, 0.1), (0.2, 0.2, 0.2)),
        lambda seed: patterns.wallpaper(seed, (0.1, 0.1, 0.1), (0.2, 0.2, 0.2)),
        lambda seed: patterns.plaster(seed),
        lambda seed: patterns.cloth(seed),
    ],
    ids=["boards", "wood", "wallpaper", "plaster", "cloth"],
)
def test_patterns_are_the_same_again_and_repeat_without_a_seam(make) -> None:
    one, again, other = make(1), make(1), make(2)
    assert np.array_equal(one.colour, again.colour)
    assert not np.array_equal(one.colour, other.colour)
    for image in (one.colour, one.bumps, one.finish):
        if image is None:
            continue
        for axis in (0, 1):
            steps = np.abs(np.diff(image.astype(float), axis=axis, append=np.take(image, [0], axis))).mean(
                axis=(1 - axis, 2)
            )
            # The last step is that from one repeat to the next.
            assert steps[-1] <= 1.5 * steps.max(initial=1.0, where=np.arange(len(steps)) < len(steps) - 1)


def test_a_normal_map_leans_away_from_where_it_rises() -> None:
    height = np.zeros((8, 8))
    height[:, 4] = 1.0  # a ridge along y
    bumps = patterns.normals(height)
    assert bumps[0, 3, 0] < 127 < bumps[0, 5, 0]
    assert np.all(bumps[..., 1] == 128)
    row = np.zeros((8, 8))
    row[4] = 1.0
    # v runs upwards, and the rows do not: above the ridge, in row 3, it leans upwards.
    assert patterns.normals(row)[3, 0, 1] > 128 > patterns.normals(row)[5, 0, 1]
