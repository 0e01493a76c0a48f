"""A path tracer in numpy: slow, obvious, and sharing nothing with the engines but the `Scene`.

Every pixel has paths of its own with random numbers of their own. Rays meet triangles by brute force in
float64. Directions are cosine-weighted about the normal, and each vertex is lit through one point on the
lights (PB A.3): emission counts where the eye sees it and where a light point is connected, nowhere else. All
punctual lights are added up at each vertex, and the sky is asked along one more direction there.

Cost:     rays x triangles; 10^5 paths of depth 3 against 36 triangles take about a second.
Poor at:  anything but tiny pictures of few triangles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Scene
from tests.reference.environment import sky_radiance

Float64 = NDArray[np.float64]

# Below this share of the scene's size a hit is the surface that the ray starts on; float64 rounds at 1e-16.
NEAR = 1e-9
# A ray through the edge of two triangles meets at least one of them in spite of rounding.
EDGE = 1e-12
# Rays x triangles held in memory at once.
CHUNK = 500_000
# Paths traced at once.
RAYS = 16_384


def nearest_hits(
    triangles: Float64, origins: Float64, directions: Float64, t_min: float | Float64 = 0.0
) -> tuple[NDArray[np.int64], Float64]:
    """What each ray meets first beyond `t_min`, of either side.

    triangles  : (T, 3, 3) corners; a degenerate one is never met
    origins    : (N, 3)
    directions : (N, 3), of any length: t counts in their lengths
    t_min      : one number, or (N,); a hit at exactly t_min does not count
    returns    : (N,) int64 triangle, -1 for none, and (N,) float64 t, inf for none
    """
    v0, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    n = np.cross(e1, e2)
    nn = np.where(np.any(n != 0, axis=1), np.sum(n * n, axis=1), np.inf)[:, None]
    # Barycentric coordinates of a point p in the plane: u = (p - v0) . U, v = (p - v0) . V.
    U, V = np.cross(e2, n) / nn, np.cross(n, e1) / nn
    t_min = np.broadcast_to(np.asarray(t_min, np.float64), len(origins))
    index, nearest = np.full(len(origins), -1), np.full(len(origins), np.inf)
    step = max(1, CHUNK // max(1, len(triangles)))
    for first in range(0, len(origins) if len(triangles) else 0, step):
        rays = slice(first, first + step)
        o, d = origins[rays], directions[rays]
        with np.errstate(divide="ignore", invalid="ignore"):  # parallel to the plane: inf or nan, which fails below
            t = (np.sum(v0 * n, axis=1) - o @ n.T) / (d @ n.T)
            u = o @ U.T - np.sum(v0 * U, axis=1) + t * (d @ U.T)
            v = o @ V.T - np.sum(v0 * V, axis=1) + t * (d @ V.T)
            met = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE) & (t > t_min[rays, None])
        t = np.where(met, t, np.inf)
        best = np.argmin(t, axis=1)
        nearest[rays] = t[np.arange(len(t)), best]
        index[rays] = np.where(np.isfinite(nearest[rays]), best, -1)
    return index, nearest


def path_trace(
    scene: Scene, paths: int, max_depth: int, *, ambient: float = 0.0, seed: int = 0
) -> tuple[Float64, Float64]:
    """Mean radiance of `paths` independent paths for each pixel, box filter.

    max_depth : at least 1; 1 is direct light only, 3 is two bounces (PB 5)
    ambient   : the reflected radiance that is assumed beyond the last vertex (PB A.2)
    returns   : mean (H, W, 3) and the variance of that mean (H, W, 3), row 0 at the top
    """
    width, height = scene.camera.resolution
    rng = np.random.default_rng(seed)
    total, squares = np.zeros((2, height * width, 3))
    together = max(1, RAYS // (height * width))
    for first in range(0, paths, together):
        L = _trace_paths(scene, min(together, paths - first), max_depth, ambient, rng)
        total, squares = total + L.sum(axis=0), squares + (L**2).sum(axis=0)
    mean = total / paths
    variance_of_mean = np.maximum(squares / paths - mean**2, 0) / max(1, paths - 1)
    return mean.reshape(height, width, 3), variance_of_mean.reshape(height, width, 3)


def _trace_paths(scene: Scene, paths: int, max_depth: int, ambient: float, rng: np.random.Generator) -> Float64:
    """Radiance (paths, H * W, 3) of so many paths for every pixel, in the order of the rows."""
    of_shape = scene.triangle_shape
    emission = np.array([s.emission for s in scene.shapes])[of_shape]
    emits_back = np.array([s.emission_two_sided for s in scene.shapes])[of_shape]
    of_material = np.array([s.material for s in scene.shapes])[of_shape]
    reflectance = np.array([m.reflectance for m in scene.materials])[of_material]
    reflects_back = np.array([m.two_sided for m in scene.materials])[of_material]
    normals, near = scene.normals, NEAR * float(np.max(np.ptp(scene.bounds, axis=0)))

    position, wi = _camera_rays(scene, paths, rng)
    L, beta = np.zeros_like(wi), np.ones_like(wi)
    path = np.arange(len(wi))  # those that are still alive
    for depth in range(1, max_depth + 1):
        triangle, t = nearest_hits(scene.triangles, position, wi, near)
        alive = triangle >= 0
        if depth == 1:
            L[path[~alive]] += sky_radiance(scene, wi[~alive])
        path, triangle, beta = path[alive], triangle[alive], beta[alive]
        position = position[alive] + t[alive, None] * wi[alive]
        front = np.sum(wi[alive] * normals[triangle], axis=1) < 0
        if depth == 1:
            L[path] += np.where((front | emits_back[triangle])[:, None], emission[triangle], 0)
        n = np.where(front[:, None], 1, -1) * normals[triangle]  # on the side that the path came from
        beta = beta * np.where((front | reflects_back[triangle])[:, None], reflectance[triangle], 0)
        L[path] += beta / np.pi * _irradiance_sample(scene, emission, emits_back, position, n, near, rng)
        L[path] += beta / np.pi * _punctual_irradiance(scene, position, n, near)
        if scene.sky is not None:
            up = _cosine_directions(n, rng)
            escapes = nearest_hits(scene.triangles, position, up, near)[0] < 0
            L[path] += beta * np.where(escapes[:, None], sky_radiance(scene, up), 0)
        wi = _cosine_directions(n, rng)
    L[path] += beta * ambient
    return L.reshape(paths, -1, 3)


def _camera_rays(scene: Scene, paths: int, rng: np.random.Generator) -> tuple[Float64, Float64]:
    """Origins and unit directions, (paths * H * W, 3) each, through a random place of every pixel."""
    camera = scene.camera
    (width, height), (right, up, forward) = camera.resolution, camera.frame()
    row, column = np.divmod(np.tile(np.arange(width * height), paths), width)
    x, y = (column + rng.random(len(row))) / width * 2 - 1, 1 - (row + rng.random(len(row))) / height * 2
    tangent = np.tan(np.radians(camera.fov) / 2)
    d = forward + tangent * (x[:, None] * right * width / height + y[:, None] * up)
    return np.tile(camera.position, (len(d), 1)), d / np.linalg.norm(d, axis=1, keepdims=True)


def _cosine_directions(n: Float64, rng: np.random.Generator) -> Float64:
    """Directions with density cos(theta) / pi: the normal plus a point on the unit sphere (Lambert)."""
    sphere = rng.standard_normal(n.shape)
    d = n + sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def _punctual_irradiance(scene: Scene, position: Float64, n: Float64, near: float) -> Float64:
    """(N, 3) from all point, spot and directional lights, with a shadow ray to each."""
    total = np.zeros_like(position)
    for light in scene.lights:
        parallel = light.kind == "directional"
        to_light = np.tile(-light.direction, (len(n), 1)) if parallel else light.position - position
        r = np.linalg.norm(to_light, axis=1)
        E = light.intensity * np.ones((len(n), 1))
        if not parallel and light.falloff == "quadratic":
            E = E / r[:, None] ** 2
        if light.kind == "spot":
            full, end = np.cos(np.radians(light.cone))
            x = np.clip((-to_light @ light.direction / r - end) / (full - end), 0, 1)
            E = E * (x**2)[:, None]
        met = nearest_hits(scene.triangles, position, to_light, near / r)[1]
        blocked = np.isfinite(met) if parallel else met < 1 - 1e-7
        cos = np.sum(n * to_light, axis=1) / r
        total += np.where(blocked | (cos <= 0), 0, cos)[:, None] * E
    return total


def _irradiance_sample(
    scene: Scene,
    emission: Float64,
    emits_back: NDArray[np.bool_],
    position: Float64,
    n: Float64,
    near: float,
    rng: np.random.Generator,
) -> Float64:
    """Le V cos cos' / (r^2 pdf), (N, 3), of one light point for each of N places with normals `n` (PB A.3)."""
    areas, normals = scene.areas, scene.normals
    power = areas * emission.sum(axis=1) * (1 + emits_back)
    if not np.any(power):
        return np.zeros_like(position)
    light = rng.choice(len(power), size=len(position), p=power / power.sum())
    pdf = (power / power.sum() / np.where(areas > 0, areas, 1))[light]
    # Uniform in a triangle: a point of the parallelogram, folded at the diagonal.
    a, b = rng.random((2, len(position), 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    v0, v1, v2 = np.moveaxis(scene.triangles[light], 1, 0)
    to_light = v0 + a * (v1 - v0) + b * (v2 - v0) - position
    r2 = np.maximum(np.sum(to_light**2, axis=1), near**2)
    cos = np.sum(n * to_light, axis=1) / np.sqrt(r2)
    cos_light = -np.sum(normals[light] * to_light, axis=1) / np.sqrt(r2)
    cos_light = np.where(emits_back[light], np.abs(cos_light), cos_light)
    # t counts in lengths of to_light: the light point stands at 1.
    blocked = nearest_hits(scene.triangles, position, to_light, near / np.sqrt(r2))[1] < 1 - 1e-7
    weight = np.where(blocked | (cos <= 0) | (cos_light <= 0), 0, cos * cos_light / (r2 * pdf))
    return weight[:, None] * emission[light]
