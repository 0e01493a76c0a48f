"""A recursive ray tracer in numpy: slow, obvious, and sharing nothing with the engines but the `Scene`.

Every ray meets every primitive by a formula from the textbook, in float64. Primitives are numbered in the order of
the scene's arrays: spheres, triangles, planes.

Cost:     rays x primitives.
Poor at:  anything but tiny pictures of few primitives.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64, Scene
from tests.reference.environment import sky_radiance

Int64 = NDArray[np.int64]
_STEP = 20_000  # rays at once


def camera_rays(scene: Scene, pixel: tuple[float, float] = (0.5, 0.5)) -> tuple[Float64, Float64]:
    """Origins and unit directions, (H * W, 3) each, through the same place of every pixel; row 0 at the top."""
    camera = scene.camera
    width, height = camera.resolution
    right, up, forward = camera.frame()
    row, column = np.divmod(np.arange(width * height), width)
    x, y = (column + pixel[0]) / width * 2 - 1, 1 - (row + pixel[1]) / height * 2
    tangent = np.tan(np.radians(camera.fov) / 2)
    d = forward + tangent * (x[:, None] * right * width / height + y[:, None] * up)
    return np.tile(camera.position, (len(d), 1)), d / np.linalg.norm(d, axis=1, keepdims=True)


def nearest(scene: Scene, origins: Float64, directions: Float64, tmin: float = 0.0) -> tuple[Int64, Float64]:
    """(N,) primitive that each ray meets first beyond tmin, -1 for none, and (N,) t, inf for none."""
    primitive, t = np.full(len(origins), -1), np.full(len(origins), np.inf)
    for first in range(0, len(origins), _STEP):
        rays = slice(first, first + _STEP)
        all_t = all_hits(scene, origins[rays], directions[rays], tmin)
        if not all_t.shape[1]:
            continue
        best = np.argmin(all_t, axis=1)
        t[rays] = all_t[np.arange(len(best)), best]
        primitive[rays] = np.where(np.isfinite(t[rays]), best, -1)
    return primitive, t


def all_hits(scene: Scene, o: Float64, d: Float64, tmin: float) -> Float64:
    """(N, primitives) t beyond tmin, inf where missed."""
    columns = []
    with np.errstate(divide="ignore", invalid="ignore"):
        for world_from_unit in scene.spheres:
            unit_from_world = np.linalg.inv(world_from_unit[:, :3])
            f, w = (o - world_from_unit[:, 3]) @ unit_from_world.T, d @ unit_from_world.T
            a, b, c = np.sum(w * w, axis=1), np.sum(f * w, axis=1), np.sum(f * f, axis=1) - 1
            root = np.sqrt(b * b - a * c)
            low, high = (-b - root) / a, (-b + root) / a
            columns.append(np.where(low > tmin, low, np.where(high > tmin, high, np.inf)))
        for v0, v1, v2 in scene.triangles:
            # Moeller & Trumbore 1997
            e1, e2 = v1 - v0, v2 - v0
            p, s = np.cross(d, e2), o - v0
            det = p @ e1
            q = np.cross(s, e1)
            u, v, t = np.sum(s * p, axis=1) / det, np.sum(d * q, axis=1) / det, q @ e2 / det
            columns.append(np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > tmin), t, np.inf))
        for plane in scene.planes:
            normal, point = plane[:, 2], plane[:, 3]
            t = (point - o) @ normal / (d @ normal)
            columns.append(np.where(t > tmin, t, np.inf))
    return np.nan_to_num(np.stack(columns, axis=1), nan=np.inf, posinf=np.inf) if columns else np.empty((len(o), 0))


def render(scene: Scene, max_depth: int = 1, pixel: tuple[float, float] = (0.5, 0.5)) -> Float64:
    """Radiance (H, W, 3) of one ray per pixel, with max_depth - 1 reflections; row 0 at the top."""
    width, height = scene.camera.resolution
    return trace(scene, *camera_rays(scene, pixel), max_depth).reshape(height, width, 3)


def trace(scene: Scene, origins: Float64, directions: Float64, max_depth: int, tmin: float = 0.0) -> Float64:
    """Radiance (N, 3) that arrives along rays [TB IV]."""
    L = sky_radiance(scene, directions)
    primitive, t = nearest(scene, origins, directions, tmin)
    hit = np.flatnonzero(primitive >= 0)
    if not len(hit):
        return L
    d, primitive = directions[hit], primitive[hit]
    position = origins[hit] + t[hit, None] * d
    n, uv = surface_of(scene, primitive, position)
    front = np.sum(n * d, axis=1) < 0
    n = np.where(front[:, None], n, -n)
    shape_of = shape_of_primitive(scene)[primitive]
    material_of = np.array([s.material for s in scene.shapes])[shape_of]
    lit = front | np.array([m.two_sided for m in scene.materials])[material_of]

    def of_material(name: str) -> Float64:
        values = np.array([getattr(m, name) for m in scene.materials])[material_of]
        return values * lit[:, None] if values.ndim == 2 else values

    rho, specular, mirror = (of_material(name) for name in ("reflectance", "specular", "mirror"))
    for number, material in enumerate(scene.materials):
        if material.texture is not None:
            own = material_of == number
            rho[own] *= texture_colour(scene, material.texture.texture, uv[own])
    shows = front | np.array([s.emission_two_sided for s in scene.shapes])[shape_of]
    emission = np.array([s.emission for s in scene.shapes])[shape_of] * shows[:, None]
    reflected = d - 2 * np.sum(d * n, axis=1, keepdims=True) * n

    size = _size(scene)
    sum_ = scene.ambient * rho + emission
    for light in scene.lights:
        if light.kind == "directional":
            to_light, distance = np.tile(-light.direction, (len(hit), 1)), np.full(len(hit), np.inf)
        else:
            to_light = light.position - position
            distance = np.linalg.norm(to_light, axis=1)
            to_light = to_light / distance[:, None]
        E = np.tile(light.intensity, (len(hit), 1))
        if light.kind != "directional" and light.falloff == "quadratic":
            E = E / distance[:, None] ** 2
        if light.kind == "spot":
            full, end = np.cos(np.radians(light.cone))
            cosine = -to_light @ light.direction
            with np.errstate(divide="ignore", invalid="ignore"):
                s = np.clip((cosine - end) / (full - end), 0, 1)
            s = np.where(full > end, s, cosine >= end)
            E = E * (s * s)[:, None]
        cosine = np.sum(n * to_light, axis=1)
        start = position + 1e-7 * size * n
        blocked = nearest(scene, start, to_light)[1] < distance * (1 - 1e-7)
        highlight = np.maximum(np.sum(reflected * to_light, axis=1), 0)[:, None] ** of_material("exponent")[:, None]
        shade = rho * cosine[:, None] + specular * highlight
        sum_ = sum_ + np.where((~blocked & (cosine > 0))[:, None], shade * E / np.pi, 0)
    if max_depth > 1 and np.any(mirror > 0):
        sum_ = sum_ + mirror * trace(scene, position + 1e-7 * size * n, reflected, max_depth - 1)
    L[hit] = sum_
    return L


def texture_colour(scene: Scene, texture: int, uv: Float64) -> Float64:
    """(N, 3) colour at texture coordinates (N, 2); v = 1 is the top row, texel centres at halves."""
    picture = scene.textures[texture]
    height, width = picture.image.shape[:2]
    x = uv[:, 0] * picture.scale[0] * width
    y = -uv[:, 1] * picture.scale[1] * height
    if picture.filter == "nearest":
        return picture.image[np.floor(y).astype(int) % height, np.floor(x).astype(int) % width].astype(float)
    x, y = x - 0.5, y - 0.5
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    colour = np.zeros((len(uv), 3))
    for di in (0, 1):
        for dj in (0, 1):
            weight = np.abs(1 - di - (y - i)) * np.abs(1 - dj - (x - j))
            colour += weight[:, None] * picture.image[(i + di) % height, (j + dj) % width]
    return colour


def surface_of(scene: Scene, primitive: Int64, position: Float64) -> tuple[Float64, Float64]:
    """Unit normals out of the front (N, 3), and texture coordinates (N, 2)."""
    n, uv = np.empty_like(position), np.zeros((len(position), 2))
    S, T = len(scene.spheres), len(scene.triangles)
    for number in np.unique(primitive):
        own = primitive == number
        p = position[own]
        if number < S:
            linear, centre = scene.spheres[number][:, :3], scene.spheres[number][:, 3]
            unit = (p - centre) @ np.linalg.inv(linear).T
            n[own] = unit @ np.linalg.inv(linear) * np.sign(np.linalg.det(linear))
            longitude = np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi) % 1.0
            uv[own] = np.stack([longitude, np.arcsin(np.clip(unit[:, 2], -1, 1)) / np.pi + 0.5], axis=1)
        elif number < S + T:
            a, b, c = scene.triangles[number - S]
            normal = np.cross(b - a, c - a)
            n[own] = normal
            area = normal @ normal
            beta, gamma = np.cross(p - a, c - a) @ normal / area, np.cross(b - a, p - a) @ normal / area
            weights = np.stack([1 - beta - gamma, beta, gamma], axis=1)
            uv[own] = weights @ scene.triangle_uv[number - S]
        else:
            u, v, normal, point = scene.planes[number - S - T].T
            n[own] = normal
            uv[own] = np.stack([(p - point) @ u / (u @ u), (p - point) @ v / (v @ v)], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True), uv


def shape_of_primitive(scene: Scene) -> Int64:
    first = {"sphere": 0, "triangle": len(scene.spheres), "plane": len(scene.spheres) + len(scene.triangles)}
    of = np.zeros(len(scene.spheres) + len(scene.triangles) + len(scene.planes), np.int64)
    for number, (shape, part) in enumerate(zip(scene.shapes, scene.shapes.ranges, strict=True)):
        start = first[shape.primitive]
        of[start + part.start : start + part.stop] = number
    return of


def _size(scene: Scene) -> float:
    points = np.concatenate(
        [scene.triangles.reshape(-1, 3), scene.spheres[:, :, 3], scene.planes[:, :, 3], scene.camera.position[None]]
    )
    return float(np.ptp(points, axis=0).max())
