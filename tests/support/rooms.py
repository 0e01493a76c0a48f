"""Diffuse rooms for tests of radiosity: quads and boxes with a reflectance and an emission."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glpath.io import load_scene
from glpath.scene.geometry import IDENTITY
from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes
from glpath.scene.tessellate import box, quad

CAMERA = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 40.0, (8, 8))


def rectangle(corner: ArrayLike, u: ArrayLike, v: ArrayLike) -> Float64:
    """Return (2, 3, 3) triangles of a rectangle; its front faces u x v."""
    a, u, v = (np.asarray(x, float) for x in (corner, u, v))
    vertices, faces = quad([a, a + u, a + u + v, a + v])
    return vertices[faces]


def cuboid(lower: ArrayLike, upper: ArrayLike, inside: bool = False) -> Float64:
    """Return (12, 3, 3) triangles of a box, with fronts outwards, or inwards as in a room."""
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
    """Return a shape for `room`."""
    return {
        "triangles": np.asarray(triangles, float),
        "material": {"reflectance": np.broadcast_to(np.asarray(reflectance, float), 3), "two_sided": two_sided},
        "shape": {
            "emission": np.broadcast_to(np.asarray(emission, float), 3),
            "emission_two_sided": emission_two_sided,
        },
    }


def room(*parts: dict[str, Any]) -> Scene:
    """Return a scene of `part`s."""
    shapes = [Shape(f"part{i}", Mesh.of_triangles(p["triangles"]), i, **p["shape"]) for i, p in enumerate(parts)]
    materials = tuple(Material(f"material{i}", **p["material"]) for i, p in enumerate(parts))
    return Scene("room", CAMERA, Shapes(shapes), materials)


def room_with_a_ball(subdivisions: int) -> Scene:
    """Return a closed grey room of 12 triangles with a point light and a ball of 20 * 4^subdivisions triangles."""
    return load_scene(
        {
            "camera": {"position": [0, 0, 2.9], "target": [0, 0, 0], "fov": 40},
            "materials": {"grey": {"reflectance": 0.6}},
            "shapes": [
                {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 3], "flip_normals": True, "material": "grey"},
                {
                    "type": "sphere",
                    "center": [0, -0.6, 0],
                    "radius": 0.3,
                    "subdivisions": subdivisions,
                    "material": "grey",
                },
            ],
            "lights": [{"type": "point", "position": [0, 0.5, 0.8], "intensity": 0.1}],
        }
    )


def with_triangles(scene: Scene, name: str, change: Callable[[Float64], Float64]) -> Scene:
    """Return the scene with the triangles (T, 3, 3) of one shape changed."""
    shapes = list(scene.shapes)
    i = next(i for i, shape in enumerate(shapes) if shape.name == name)
    mesh = Mesh.of_triangles(change(scene.triangles[scene.shapes.ranges[i]].copy()))
    shapes[i] = replace(shapes[i], geometry=mesh, world_from_object=IDENTITY[None])
    return replace(scene, shapes=Shapes(shapes))
