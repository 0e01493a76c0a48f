"""Tangents that a glTF file has where readers may not make them: beside closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glpath.io.export.tangents import tangent_slot, with_tangents
from glpath.scene.geometry import Float64, Mesh
from glpath.scene.material import Material, TextureSlot
from tests.io.test_export import everything, quietly
from tests.support.gltf_files import ReadGlb

PLAIN = TextureSlot(0)


def cylinder(columns: int = 64, mirrored: bool = False) -> Mesh:
    """Of radius 1 about y, u once around, v upwards; mirrored: u goes back on the half with z < 0."""
    around = np.arange(columns + 1) / columns
    angle = 2 * np.pi * around
    u = np.minimum(around, 1 - around) if mirrored else around
    ring = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    vertices = np.concatenate([ring, ring + np.array([0.0, 1, 0])])
    uv = np.concatenate([np.stack([u, 0 * u], axis=1), np.stack([u, 0 * u + 1], axis=1)])
    a = np.arange(columns)
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).astype(np.int32)
    return Mesh(vertices, faces, uv=uv, normals=np.concatenate([ring, ring]))


def around(mesh: Mesh) -> Float64:
    """Where the angle grows."""
    assert mesh.normals is not None
    return np.cross([0.0, 1, 0], mesh.normals)


def test_tangents_go_where_u_grows() -> None:
    mesh, tangents = with_tangents(cylinder(), PLAIN)
    assert len(mesh.vertices) == len(cylinder().vertices)
    # At the seam a vertex has triangles on one side alone, half a step away.
    assert mesh.uv is not None
    inner = (mesh.uv[:, 0] > 0) & (mesh.uv[:, 0] < 1)
    np.testing.assert_allclose(tangents[inner, :3], around(mesh)[inner], atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1)
    up = tangents[:, 3:] * np.cross(mesh.normals, tangents[:, :3])
    np.testing.assert_allclose(up, np.tile([0.0, 1, 0], (len(up), 1)), atol=1e-9)


def test_a_slot_has_coordinates_of_its_own() -> None:
    """Turned by a right angle: u of the slot is v of the mesh."""
    turned = TextureSlot(0, uv_transform=np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    mesh, tangents = with_tangents(cylinder(), turned)
    np.testing.assert_allclose(tangents, np.tile([0.0, 1, 0, 1], (len(mesh.vertices), 1)), atol=1e-9)


def test_where_the_texture_is_mirrored_vertices_part() -> None:
    whole = cylinder(mirrored=True)
    mesh, tangents = with_tangents(whole, PLAIN)
    assert len(mesh.vertices) == len(whole.vertices) + 2  # those of the edge where u turns back
    np.testing.assert_allclose(mesh.vertices[mesh.faces], whole.vertices[whole.faces])
    away = np.abs(mesh.vertices[:, 0]) > 0.2
    np.testing.assert_allclose(tangents[away, :3], (tangents[:, 3:] * around(mesh))[away], atol=1e-3)
    assert {*tangents[mesh.vertices[:, 0] > 0.2, 3]} == {1.0}
    assert {*tangents[mesh.vertices[:, 0] < -0.2, 3]} == {-1.0}
    up = tangents[:, 3:] * np.cross(mesh.normals, tangents[:, :3])
    np.testing.assert_allclose(up[away], np.tile([0.0, 1, 0], (away.sum(), 1)), atol=1e-9)


@pytest.mark.parametrize("uv", ["none", "a point"])
def test_without_coordinates_a_tangent_is_any_along_the_surface(uv: str) -> None:
    plain = replace(cylinder(), normals=None, uv=None if uv == "none" else np.zeros((130, 2)))
    mesh, tangents = with_tangents(plain, PLAIN)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1)
    assert mesh.normals is not None  # those of the faces: without any a reader ignores tangents
    np.testing.assert_allclose(np.einsum("ij,ij->i", tangents[:, :3], mesh.normals), 0, atol=1e-12)


def test_materials_want_tangents_that_a_reader_cannot_make() -> None:
    bump = TextureSlot(0, uv_set=1)
    coat = Material("coat", np.ones(3), roughness=0.3, clearcoat=1.0, clearcoat_normal_texture=bump)
    brushed = Material("brushed", np.ones(3), roughness=0.3, metallic=1.0, anisotropy=0.5)
    assert tangent_slot(coat) is bump
    by_first = tangent_slot(brushed)
    assert by_first is not None
    assert by_first.uv_set == 0
    assert tangent_slot(replace(brushed, anisotropy_texture=bump)) is bump
    for each in (coat, brushed):
        assert tangent_slot(replace(each, normal_texture=bump)) is None
    assert tangent_slot(Material("plain", np.ones(3), roughness=0.3)) is None


def test_a_file_has_tangents_where_they_are_wanted_alone(tmp_path: Path) -> None:
    scene = everything()
    quietly(scene, tmp_path / "a.glb")
    document = ReadGlb.of(tmp_path / "a.glb").json
    with_some = {
        document["materials"][primitive["material"]]["name"]
        for mesh in document["meshes"]
        for primitive in mesh["primitives"]
        if "TANGENT" in primitive["attributes"]
    }
    assert with_some == {"lacquer", "satin"}
