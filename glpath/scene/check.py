"""What is wrong with a scene although its file can be read: `check_camera` raises, `check_scene` warns.

Loading does not warn by itself: a scene is often loaded to be changed. Rendering and `glpath validate` ask here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Camera, Float64, Scene
from glpath.scene.place import Place, shown

MAX_PIXELS = 2**28

# Sine of the angle between `up` and the view below which there is no telling what is up.
_PARALLEL = 1e-6
# Of the size of the scene: nearer than this, the camera stands in the surface.
_TOUCHING = 1e-6


def check_camera(camera: Camera, source: str) -> None:
    """Raise SceneError for a camera that cannot see: no direction, no up, no angle, no pixels.

    Also for cameras changed by hand (`Scene.with_camera`, `--camera-up`); `source` names the scene in the message.
    """
    place = Place(source, "camera")
    for name in ("position", "target", "up"):
        vector = np.asarray(getattr(camera, name), np.float64)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise place.field(name).wrong(vector, "three finite numbers")
    if not 0 < camera.fov < 180:
        raise place.field("fov").wrong(
            float(camera.fov), "above 0 and below 180 degrees", "It is the vertical field of view."
        )
    width, height = camera.resolution
    if not (width >= 1 and height >= 1 and width * height <= MAX_PIXELS):
        raise Place(source, "film.resolution").wrong(
            [width, height], f"at least 1 x 1 and at most {MAX_PIXELS:,} pixels", "Choose a smaller resolution."
        )
    view = camera.target - camera.position
    distance = np.linalg.norm(view)
    if not distance > 1e-12 * np.linalg.norm(camera.position):
        raise place.field("target").error(
            "is the same point as camera.position, so that the camera looks nowhere.", "Move one of them."
        )
    length = np.linalg.norm(camera.up)
    if not length > 0:
        raise place.field("up").wrong(camera.up, "a vector of any length but zero", "For example up = [0, 1, 0].")
    if np.linalg.norm(np.cross(view / distance, camera.up / length)) < _PARALLEL:
        across = np.eye(3, dtype=int)[np.argmin(np.abs(view))].tolist()
        raise place.field("up").error(
            f"is {shown(camera.up)}, parallel to the view from position to target, which leaves the picture no up.",
            f"Choose another, such as up = {across}.",
        )


def check_scene(scene: Scene) -> list[str]:
    """Warnings, each a sentence or two, about a scene which renders but hardly as meant. Empty when all is well."""
    found = []
    if not any(shape.emits for shape in scene.shapes):
        found.append(
            "No shape emits light: the picture will be black. "
            "Give a shape an emission, e.g. emission = { radiance = [10, 10, 10] }."
        )
    if not sees_anything(scene.camera, scene.triangles):
        lower, upper = scene.bounds
        found.append(
            "The camera sees nothing: no triangle is in view. "
            f"It stands at {_point(scene.camera.position)} and looks at {_point(scene.camera.target)}; "
            f"the scene reaches from {_point(lower)} to {_point(upper)}."
        )
    touching = _touched(scene)
    if touching is not None:
        shape = scene.shapes[scene.triangle_shape[touching]]
        found.append(
            f'The camera stands exactly on a surface, of the shape "{shape.name}": '
            "half of the picture may be that surface. Move it a little."
        )
    used = {shape.material for shape in scene.shapes}
    for index in sorted(used):
        material = scene.materials[index]
        if np.all(material.reflectance >= 1):
            found.append(
                f'The material "{material.name}" reflects all light (reflectance 1): '
                "no real surface does, and between such surfaces light never dies out."
            )
    return found


def sees_anything(camera: Camera, triangles: Float64) -> bool:
    """Whether any triangle reaches into the pyramid of view, whatever hides it. triangles: (T, 3, 3).

    The pyramid has no near and no far end. Exact up to rounding: a triangle reaches into it when one of its edges
    does, or when it is so large that an edge of the pyramid goes through its inside.
    """
    right, up, forward = camera.frame()
    tan_up = np.tan(np.radians(camera.fov) / 2)
    tan_right = tan_up * camera.resolution[0] / camera.resolution[1]
    points = triangles - camera.position
    x, y, z = points @ right, points @ up, points @ forward
    # (T, 3 corners, 4 sides), above 0 inside; together they imply z >= 0
    inside = np.stack([tan_right * z - x, tan_right * z + x, tan_up * z - y, tan_up * z + y], axis=2)
    if (inside > 0).all(axis=2).any():
        return True
    near = ~np.any((inside < 0).all(axis=1), axis=1)  # the rest lie wholly beyond one side
    if not near.any():
        return False
    start = inside[near]
    change = np.roll(start, -1, axis=1) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -start / change
    enters = np.where(change > 0, crossing, np.where(start >= 0, -np.inf, np.inf)).max(axis=2)
    leaves = np.where(change < 0, crossing, np.inf).min(axis=2)
    if np.any(np.maximum(enters, 0) <= np.minimum(leaves, 1)):
        return True
    rays = [forward + a * tan_right * right + b * tan_up * up for a in (-1, 1) for b in (-1, 1)]
    return any(bool(_pierced(ray, points[near]).any()) for ray in rays)


def _pierced(ray: Float64, points: Float64) -> NDArray[np.bool_]:
    """(T,) bool: the ray from the origin goes through the triangle; Möller and Trumbore 1997."""
    origin, a, b = points[:, 0], points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    p = np.cross(ray, b)
    determinant = np.sum(a * p, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.sum(-origin * p, axis=1) / determinant
        q = np.cross(-origin, a)
        v = q @ ray / determinant
        t = np.sum(b * q, axis=1) / determinant
    return np.asarray((determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0))


def _touched(scene: Scene) -> int | None:
    """The first triangle that the camera stands on."""
    lower, upper = scene.bounds
    reach = _TOUCHING * float(np.linalg.norm(upper - lower))
    corners = scene.triangles - scene.camera.position
    about = np.flatnonzero(((corners.min(axis=1) <= reach) & (corners.max(axis=1) >= -reach)).all(axis=1))
    corners = corners[about]
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    height = np.abs(np.sum(corners[:, 0] * normals, axis=1))
    # how far the camera, which is the origin here, lies within each edge
    within = np.sum(np.cross(edges, -corners) * normals[:, None], axis=2)
    within /= np.maximum(np.linalg.norm(edges, axis=2), np.finfo(float).tiny)
    hits = about[(height <= reach) & (within >= -reach).all(axis=1)]
    return int(hits[0]) if len(hits) else None


def _point(point: Float64) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
