"""Small scenes of quads with textures, for the tests of what textures do."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes, Texture

BLACK = Material("black", np.zeros(3))
GREY = Material("grey", np.full(3, 0.5))


def camera(position: ArrayLike, target: ArrayLike = (0, 0, 0), fov: float = 40.0, pixels: int = 32) -> Camera:
    up = np.array([0.0, 0, 1] if position[0] == target[0] and position[2] == target[2] else [0.0, 1, 0])  # type: ignore[index]
    return Camera(
        position=np.array(position, float),
        target=np.array(target, float),
        up=up,
        fov=fov,
        resolution=(pixels, pixels),
    )


def quad(corners: ArrayLike, parts: int = 1, **more: Float64) -> Mesh:
    """A parallelogram of (4, 3) corners around its outline, u along the first edge, in parts x parts squares."""
    a, b, _, d = np.array(corners, float)
    u, v = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0, 1, parts + 1)] * 2))
    i = (np.arange(parts) + (parts + 1) * np.arange(parts)[:, None]).ravel()
    faces = [[i, i + 1, i + parts + 2], [i, i + parts + 2, i + parts + 1]]
    return Mesh(
        a + u[:, None] * (b - a) + v[:, None] * (d - a),
        np.array(faces).transpose(2, 0, 1).reshape(-1, 3).astype(np.int32),
        uv=np.stack([u, v], axis=1),
        **more,
    )


def level(height: float, size: float = 1.0, down: bool = False, parts: int = 1) -> Mesh:
    """A horizontal square about the y axis, front up."""
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]) * size + np.array([0, height, 0])
    return quad(corners[[1, 0, 3, 2]] if down else corners, parts)


def scene_of(
    shapes: list[Shape], materials: list[Material], view: Camera, textures: tuple[Texture, ...] = (), **more: object
) -> Scene:
    return Scene("test", view, Shapes(shapes), tuple(materials), textures=textures, **more)  # type: ignore[arg-type]


def lamp(mesh: Mesh, material: int = 0, radiance: ArrayLike = (5.0, 5.0, 5.0)) -> Shape:
    return Shape("lamp", mesh, material, emission=np.array(radiance, float))


def squares(n: int, channels: int = 4) -> Texture:
    """White; where i + j is odd, light passes."""
    i, j = np.mgrid[:n, :n]
    image = np.full((n, n, channels), 255, np.uint8)
    image[..., -1] = np.where((i + j) % 2, 0, 255)
    return Texture("squares", image, filter="nearest", srgb=True)
