"""Scenes of spheres, triangles and planes for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.geometry import IDENTITY
from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes

GREY = Material("grey", np.full(3, 0.5))


def camera(
    position: ArrayLike = (0, 0, 6),
    target: ArrayLike = (0, 0, 0),
    *,
    fov: float = 50.0,
    resolution: tuple[int, int] = (96, 64),
) -> Camera:
    position, target = np.array(position, float), np.array(target, float)
    view = target - position
    up = np.array([0, 1.0, 0] if abs(view[1]) < 0.9 * np.linalg.norm(view) else [0, 0, 1.0])
    return Camera(position, target, up, fov, resolution)


def ball(centre: ArrayLike, radius: float, rotation: NDArray[np.float64] | None = None) -> Float64:
    """Return (3, 4) world_from_unit of a round sphere."""
    linear = radius * (np.eye(3) if rotation is None else rotation)
    return np.concatenate([linear, np.array(centre, float)[:, None]], axis=1)


def ground(height: float = -2.0) -> Float64:
    """Return (3, 4) world_from_plane of a horizontal plane with its front up."""
    return np.array([[1, 0, 0, 0], [0, 0, 1, height], [0, -1, 0, 0]], float)


def rotation(rng: np.random.Generator) -> Float64:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))


def scene_of(
    *,
    spheres: ArrayLike = (),
    triangles: ArrayLike = (),
    planes: ArrayLike = (),
    triangle_uv: ArrayLike | None = None,
    view: Camera | None = None,
    materials: Sequence[Material] = (GREY,),
    **fields: object,
) -> Scene:
    """Return a scene: one shape per sphere and plane, one of all triangles; shape i has material i, cyclically."""
    s = np.array(spheres, float).reshape(-1, 3, 4)
    t = np.array(triangles, float).reshape(-1, 3, 3)
    p = np.array(planes, float).reshape(-1, 3, 4)
    parts: list[tuple[Mesh | Literal["sphere", "plane"], Float64]] = [("sphere", each) for each in s]
    parts += [(Mesh.of_triangles(t, triangle_uv), IDENTITY)] * bool(len(t))
    parts += [("plane", each) for each in p]
    shapes = [Shape(f"shape-{i}", what, i % len(materials), where[None]) for i, (what, where) in enumerate(parts)]
    return Scene("test", view or camera(), Shapes(shapes), tuple(materials), **fields)  # type: ignore[arg-type]


def flat(scene: Scene) -> Scene:
    """Return a scene without vertex normals, as the references of the tests shade it."""
    shapes = [
        replace(s, geometry=replace(s.geometry, normals=None)) if isinstance(s.geometry, Mesh) else s
        for s in scene.shapes
    ]
    return replace(scene, shapes=Shapes(shapes))
