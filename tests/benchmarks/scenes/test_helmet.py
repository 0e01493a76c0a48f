"""The helmet of the benches is what a user's model may be: closed, textured, of a material that glows a little."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from benchmarks.scenes.helmet import COLUMNS, ROWS, helmet
from glpath import export
from glpath.errors import SceneWarning
from glpath.io import load_scene


def test_it_is_closed_and_its_file_has_all_of_it(tmp_path: Path) -> None:
    made = helmet(side=32, columns=24, rows=13)
    assert 2 * COLUMNS * (ROWS - 1) == 70_000
    assert len(made.triangles) == 2 * 24 * 12
    (shell,) = (shape.geometry for shape in made.shapes)
    mesh = trimesh.Trimesh(shell.vertices, shell.faces)
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=7)
    assert mesh.is_watertight
    assert mesh.volume > 0
    export(made, tmp_path / "helmet.glb")
    with pytest.warns(SceneWarning, match="a studio lights it"):
        read = load_scene(tmp_path / "helmet.glb")
    assert np.allclose(read.triangles, made.triangles, atol=1e-6)
    assert set(read.materials[0].slots) == {"texture", "surface_texture", "normal_texture", "emission_texture"}
    for ours, theirs in zip(made.textures, read.textures, strict=True):
        assert np.array_equal(theirs.image, ours.image), ours.name
