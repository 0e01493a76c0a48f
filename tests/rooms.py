"""Diffuse rooms for tests of radiosity: quads and boxes with a reflectance and an emission."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glpath.scene.model import Camera, Float64, Material, Scene, Shape
from glpath.scene.tessellate import box, quad

CAMERA = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 40.0, (8, 8))


def rectangle(corner: ArrayLike, u: ArrayLike, v: ArrayLike) -> Float64:
    """(2, 3, 3): two triangles; the front is towards u x v."""
    a, u, v = (np.asarray(x, float) for x in (corner, u, v))
    vertices, faces = quad([a, a + u, a + u + v, a + v])
    return vertices[faces]


def cuboid(lower: ArrayLike, upper: ArrayLike, inside: bool = False) -> Float64:
    """(12, 3, 3): a box, fronts outward, or inward as of a room."""
    vertices, faces = box(lower, upper)
    return vertices[faces[:, ::-1] if inside else faces]


def part(
    triangles: Float64,
    reflectance: ArrayLike = 0.5,
    emission: ArrayLike = 0.0,
    *,
    two_sided: bool = False,
    emission_two_sided: bool = False,
) -> dict[str, Any]:
    """A shape for `room`."""
    return {
        "triangles": np.asarray(triangles, float),
        "material": {"reflectance": np.broadcast_to(np.asarray(reflectance, float), 3), "two_sided": two_sided},
        "shape": {
            "emission": np.broadcast_to(np.asarray(emission, float), 3),
            "emission_two_sided": emission_two_sided,
        },
    }


def room(*parts: dict[str, Any]) -> Scene:
    """A scene of `part`s."""
    shapes, first = [], 0
    for i, p in enumerate(parts):
        count = len(p["triangles"])
        shapes.append(Shape(f"part{i}", "mesh", first, count, i, **p["shape"]))
        first += count
    materials = tuple(Material(f"material{i}", **p["material"]) for i, p in enumerate(parts))
    return Scene("room", CAMERA, np.concatenate([p["triangles"] for p in parts]), tuple(shapes), materials)
