"""Variants of programs whose rays cross thin dielectrics without a change of direction."""

from __future__ import annotations

import numpy as np

from glpath.gl.variants import defined
from glpath.scene.appearance import has_colours
from glpath.scene.model import Scene


def thin_dielectric_variants(scene: Scene) -> dict[str, object]:
    """Return the defines for a scene's thin dielectrics.

    If all of them are uniform, shadow rays read only their material.
    """
    shapes, thin = scene.shapes, [scene.materials[shape.material].is_thin_dielectric for shape in scene.shapes]
    varying = False
    for number in np.flatnonzero(thin):
        triangles = shapes.ranges[number]
        normals = shapes.vertex_normals[shapes.faces[triangles]]
        bent = np.any(normals, axis=2) & (np.einsum("tcx,tx->tc", normals, scene.normals[triangles]) < 1.0 - 1e-6)
        textured = bool(scene.materials[shapes[number].material].slots) or has_colours(shapes[number])
        varying = varying or textured or bool(bent.any())
    return defined(HAS_THIN_DIELECTRICS=any(thin), HAS_VARYING_THIN_DIELECTRICS=varying)
