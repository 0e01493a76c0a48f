"""Vertex tangents for programs that do not compute them from texture coordinates.

glTF requires them if a material has anisotropy or a clearcoat normal map, but no normal map of the base. Readers
compute tangents only for the base normal map.

Source: Mikkelsen 2008, Simulation of wrinkled surfaces revisited. As in MikkTSpace, corners are weighted by their
        angles, and a vertex is split if some of its triangles mirror the texture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.io.export.geometry import face_normals, with_all_normals
from glpath.scene.geometry import Float64, Mesh
from glpath.scene.material import Material, TextureSlot


def tangent_slot(material: Material) -> TextureSlot | None:
    """Return the texture slot whose coordinates define the tangents that glTF requires; None if none are needed."""
    if material.normal_texture is not None:
        return None
    if material.clearcoat > 0 and material.clearcoat_normal_texture is not None:
        return material.clearcoat_normal_texture
    return (material.anisotropy_texture or TextureSlot(0)) if material.anisotropy > 0 else None


def with_tangents(mesh: Mesh, slot: TextureSlot) -> tuple[Mesh, Float64]:
    """Return the mesh with normals at all vertices, and its (V, 4) unit tangents with a sign.

    The tangent is the direction in which u of the texture slot grows; v grows along sign * (normal x tangent).
    Without texture coordinates, tangents are arbitrary.
    """
    mesh = _with_normals(mesh)
    uv = mesh.uv1 if slot.uv_set else mesh.uv
    if uv is None:
        uv = np.zeros((len(mesh.vertices), 2))
    uv = uv @ slot.uv_transform[:, :2].T
    corners, at = mesh.vertices[mesh.faces], uv[mesh.faces]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    to_b, to_c = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    side = np.where(to_b[:, 0] * to_c[:, 1] < to_b[:, 1] * to_c[:, 0], -1.0, 1.0)
    along = side[:, None] * (to_c[:, 1:] * ab - to_b[:, 1:] * ac)
    keys, which = np.unique(2 * mesh.faces + (side < 0)[:, None], return_inverse=True)
    faces = np.asarray(which, np.int32).reshape(-1, 3)
    vertex = keys // 2
    found = {name: None if values is None else values[vertex] for name, values in mesh.of_vertices.items()}
    mesh = Mesh(mesh.vertices[vertex], faces, **found)
    assert mesh.normals is not None
    sums = np.zeros((len(keys), 3))
    for corner in range(3):
        n = mesh.normals[faces[:, corner]]
        there = corners[:, (corner + 1) % 3] - corners[:, corner], corners[:, (corner + 2) % 3] - corners[:, corner]
        first, second = (_unit(_across(edge, n)) for edge in there)
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0))
        np.add.at(sums, faces[:, corner], angle[:, None] * _unit(_across(along, n)))
    tangents = _unit(_across(sums, mesh.normals))
    lost = ~np.any(tangents, axis=1)
    axes = np.eye(3)[np.argmin(np.abs(mesh.normals[lost]), axis=1)]
    tangents[lost] = _unit(_across(axes, mesh.normals[lost]))
    return mesh, np.concatenate([tangents, np.where(keys % 2, -1.0, 1.0)[:, None]], axis=1)


def _with_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with normals; face normals if it has none."""
    mesh = with_all_normals(mesh)
    if mesh.normals is not None:
        return mesh
    return replace(mesh.unshared(), normals=np.repeat(face_normals(mesh), 3, axis=0)).welded()


def _across(vectors: Float64, normals: Float64) -> Float64:
    """Return the component of each vector perpendicular to its normal."""
    return np.asarray(vectors - np.einsum("ij,ij->i", vectors, normals)[:, None] * normals)


def _unit(vectors: Float64) -> Float64:
    """Return the vectors normalised; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))
