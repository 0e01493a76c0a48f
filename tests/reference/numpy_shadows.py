"""What a camera sees and which of it a point light reaches, ray by ray in float64: slow and obvious."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Camera, Scene

Float64 = NDArray[np.float64]


class Seen(NamedTuple):
    """hit (pixels,), row by row from the top; and of those that hit: position, normal (N, 3), object (N,)."""

    hit: NDArray[np.bool_]
    position: Float64
    normal: Float64
    object: NDArray[np.int64]


def objects_of(scene: Scene) -> dict[str, NDArray[np.int64]]:
    """The index of the shape of each primitive, by kind."""
    return {
        kind: np.repeat(
            [i for i, s in enumerate(scene.shapes) if s.primitive == kind],
            [s.count for s in scene.shapes if s.primitive == kind],
        ).astype(np.int64)
        for kind in ("sphere", "triangle", "plane")
    }


def nearest(
    scene: Scene, origin: Float64, d: Float64, tmin: float = 0.0
) -> tuple[Float64, Float64, NDArray[np.int64]]:
    """(N,) t, inf for none; (N, 3) normal; (N,) object, of rays from (N, 3) or (3,) along (N, 3)."""
    t, normal, which = np.full(len(d), np.inf), np.zeros((len(d), 3)), np.full(len(d), -1)
    origin = np.broadcast_to(origin, d.shape)
    owner = objects_of(scene)

    def take(found: Float64, n: Float64, number: int) -> None:
        with np.errstate(invalid="ignore"):
            better = (found > tmin) & (found < t)
        t[better], normal[better], which[better] = found[better], np.broadcast_to(n, d.shape)[better], number

    with np.errstate(divide="ignore", invalid="ignore"):
        for m, number in zip(scene.spheres, owner["sphere"], strict=True):
            inverse = np.linalg.inv(m[:, :3])
            o, w = (origin - m[:, 3]) @ inverse.T, d @ inverse.T
            a, b, c = np.sum(w * w, 1), np.sum(w * o, 1), np.sum(o * o, 1) - 1
            root = np.sqrt(b * b - a * c)
            for found in ((-b - root) / a, (-b + root) / a):
                n = (o + found[:, None] * w) @ inverse
                take(found, n / np.linalg.norm(n, axis=1, keepdims=True), int(number))
        for (p, q, r), number in zip(scene.triangles, owner["triangle"], strict=True):
            n = np.cross(q - p, r - p)
            found = (p - origin) @ n / (d @ n)
            x = origin + found[:, None] * d
            sides = [np.sum(np.cross(v - u, x - u) * n, 1) for u, v in ((p, q), (q, r), (r, p))]
            take(np.where(np.min(sides, axis=0) >= 0, found, np.inf), n / np.linalg.norm(n), int(number))
        for m, number in zip(scene.planes, owner["plane"], strict=True):
            found = (m[:, 3] - origin) @ m[:, 2] / (d @ m[:, 2])
            take(found, m[:, 2] / np.linalg.norm(m[:, 2]), int(number))
    return t, normal, which


def seen_by(scene: Scene, camera: Camera | None = None) -> Seen:
    """What the rays through the centres of all pixels hit."""
    camera = camera or scene.camera
    right, up, forward = camera.frame()
    width, height = camera.resolution
    y, x = np.mgrid[0:height, 0:width]
    half = np.tan(np.radians(camera.fov) / 2)
    d = (
        forward
        + ((x.ravel()[:, None] + 0.5) / width * 2 - 1) * half * width / height * right
        - ((y.ravel()[:, None] + 0.5) / height * 2 - 1) * half * up
    )
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    t, normal, which = nearest(scene, camera.position, d)
    hit = np.isfinite(t)
    position = camera.position + t[hit, None] * d[hit]
    return Seen(hit, position, normal[hit], which[hit])


def lit(scene: Scene, seen: Seen, light: Float64) -> NDArray[np.bool_]:
    """(N,) of the places seen: does a shadow ray reach the light?"""
    # From the light, so that rays to one surface meet it, up to rounding, at their ends.
    w = seen.position - light
    t, _, _ = nearest(scene, light, w)
    return np.asarray(t > 1 - 1e-7)


def faces_light(seen: Seen, eye: Float64, light: Float64) -> NDArray[np.bool_]:
    """(N,): does the side that the eye sees face the light? Elsewhere shadows change nothing."""
    towards_eye = np.sum(seen.normal * (eye - seen.position), 1)
    towards_light = np.sum(seen.normal * (light - seen.position), 1)
    return np.asarray(towards_eye * towards_light > 0)
