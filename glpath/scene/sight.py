"""Geometry tests for `check`: shapes inside a camera's view, hidden or not, and shapes that enclose a point.

All tests are exact up to rounding. They make a few numpy passes over the triangles, in chunks whose intermediate
results stay in the processor's cache.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glpath.scene.geometry import instance_boxes
from glpath.scene.model import Camera, Float64, Mesh, Primitive, Scene, Shape, Stream, sphere_extent
from glpath.scene.tessellate import box
from glpath.system.time_limit import check_time

_CHUNK = 1 << 14
# Number of triangles above which instances are not expanded all at once.
_MANY = 1 << 20
# Time of the test of a shape, expressed as a number of triangles, without the time of its triangles.
_SHAPE_COST = 1000
# Distance, as a fraction of the scene's size, below which the camera is on a surface.
_TOUCHING = 1e-6


def sees_anything(scene: Scene) -> bool:
    """Return True if any shape intersects the view pyramid, occluded or not; exact up to rounding.

    The pyramid has no near and no far end. Parallel rays start in the camera's plane; for them, bodies are replaced
    by boxes in the camera's axes. Moving shapes are tested when the shutter opens, at mid-time, and when it closes.
    """
    opened, closed = scene.camera.shutter
    moves = opened < closed and (scene.camera.moves or scene.moving_shapes)
    times = (opened, 0.5 * (opened + closed), closed) if moves else (opened,)
    return any(_sees_anything(scene.at(time)) for time in times)


def _sees_anything(scene: Scene) -> bool:
    camera = scene.camera
    if camera.projection != "perspective":
        return camera.projection == "panorama" or _seen_by_parallel_rays(camera, scene)
    return (
        _sees_planes(camera, scene.planes)
        or _sees_spheres(camera, scene.spheres)
        or any(sees_triangles(camera, part) for part in _triangles(scene))
        or any(_sees_boxes(camera, stream) for _, stream in scene.shapes.streams)
    )


def sees_nearer(scene: Scene, depth: float) -> bool:
    """Return True if the view pyramid contains a part of a surface that is nearer than `depth`.

    depth : along the view axis of a perspective camera

    Streams do not count.
    """
    camera = scene.camera
    height = np.einsum("pi,pi->p", scene.planes[:, :, 2], camera.position - scene.planes[:, :, 3])[:, None]
    if np.any(height * (height + depth * (scene.planes[:, :, 2] @ camera.corner_rays().T)) < 0):
        return True
    if any(_sees_nearer_spheres(camera, part, depth) for part in _chunks(scene.spheres)):
        return True
    forward = camera.frame()[2]
    return any(
        sees_triangles(camera, _nearer_parts(chunk, (chunk - camera.position) @ forward - depth))
        for part in _triangles(scene)
        for chunk in _chunks(part)
    )


def _sees_nearer_spheres(camera: Camera, spheres: Float64, depth: float) -> bool:
    """Return True if the surface of any sphere (S, 3, 4) is visible and nearer than `depth`.

    In the space of the unit sphere, it is if the tip of the view pyramid has a corner outside, and is nearer than 1
    to the origin.
    """
    forward, rays = camera.frame()[2], depth * camera.corner_rays()
    extent, middle = (
        np.linalg.norm(forward @ spheres[:, :, :3], axis=1),
        (spheres[:, :, 3] - camera.position) @ forward,
    )
    spheres = spheres[(middle - extent < depth) & (middle + extent > 0)]
    inverse = np.linalg.inv(spheres[:, :, :3])
    corners = np.concatenate([np.zeros((1, 3)), rays]) + (camera.position - spheres[:, None, :, 3])
    tip = np.einsum("nij,nkj->nki", inverse, corners)
    faces = tip[:, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 3, 2), (1, 4, 3)]]
    # All faces have the same orientation, so their volumes with an enclosed origin have the same sign.
    volumes = np.linalg.det(faces)
    encloses = (volumes > 0).all(axis=1) | (volumes < 0).all(axis=1)
    near = encloses | (_distances(faces) < 1).any(axis=1)
    return bool(np.any(near & (np.linalg.norm(tip, axis=2) > 1).any(axis=1)))


def _distances(triangles: Float64) -> Float64:
    """Return the (...) distances of the origin from triangles (..., 3, 3)."""
    edges = np.roll(triangles, -1, axis=-2) - triangles
    share = np.clip(-np.sum(triangles * edges, axis=-1) / np.sum(edges * edges, axis=-1), 0, 1)
    on_edge = np.linalg.norm(triangles + share[..., None] * edges, axis=-1).min(axis=-1)
    normal = np.cross(edges[..., 0, :], edges[..., 1, :])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    height = np.sum(triangles[..., 0, :] * normal, axis=-1)
    foot = height[..., None] * normal
    within = np.sum(np.cross(edges, foot[..., None, :] - triangles) * normal[..., None, :], axis=-1) >= 0
    return np.asarray(np.where(within.all(axis=-1), np.abs(height), on_edge))


def _nearer_parts(triangles: Float64, height: Float64) -> Float64:
    """Return triangles (N, 3, 3) that cover the parts of triangles (T, 3, 3) with negative heights.

    height : (T, 3) signed distance of each corner from a plane
    """
    order = np.argsort(height, axis=1)
    height = np.take_along_axis(height, order, axis=1)
    triangles = np.take_along_axis(triangles, order[:, :, None], axis=1)
    below = (height < 0).sum(axis=1)

    def crossing(which: NDArray[np.bool_], low: int, high: int) -> Float64:
        share = (height[which, low] / (height[which, low] - height[which, high]))[:, None]
        return np.asarray((1 - share) * triangles[which, low] + share * triangles[which, high])

    one, two = below == 1, below == 2
    a, b = triangles[two, 0], triangles[two, 1]
    across = crossing(two, 1, 2)
    return np.concatenate(
        [
            triangles[below == 3],
            np.stack([triangles[one, 0], crossing(one, 0, 1), crossing(one, 0, 2)], axis=1),
            np.stack([a, b, across], axis=1),
            np.stack([a, across, crossing(two, 0, 2)], axis=1),
        ]
    )


def _seen_by_parallel_rays(camera: Camera, scene: Scene) -> bool:
    """Return True if parallel rays hit a plane, or the box in camera axes around a triangle or sphere."""
    axes = np.stack(camera.frame())
    wide_high, middle = np.array(camera.extent), np.array(camera.offset)
    centre, extent = scene.spheres[:, :, 3], np.linalg.norm(axes @ scene.spheres[:, :, :3], axis=2)
    spheres = (centre - camera.position) @ axes.T

    def is_within(lower: Float64, upper: Float64) -> bool:
        within = (lower[:, :2] <= middle + wide_high).all(axis=1) & (upper[:, :2] >= middle - wide_high).all(axis=1)
        return bool((within & (upper[:, 2] >= 0)).any())

    if is_within(spheres - extent, spheres + extent):
        return True
    for part in _triangles(scene):
        triangles = (part - camera.position) @ axes.T
        if is_within(triangles.min(axis=1), triangles.max(axis=1)):
            return True
    # A plane is visible if it is in front of at least one corner of the image.
    corners = camera.origins([[0, 0], [camera.resolution[0], 0], [0, camera.resolution[1]], camera.resolution])
    normal = scene.planes[:, :, 2]
    towards = normal @ axes[2]
    height = np.einsum("pi,pki->pk", normal, corners[None] - scene.planes[:, None, :, 3])
    return bool(np.any((height * towards[:, None] < 0) & (towards[:, None] != 0)))


def _sees_boxes(camera: Camera, stream: Stream) -> bool:
    """Return True if the box around any chunk intersects the view pyramid. Chunks are not read."""
    unit, faces = box((0, 0, 0), (1, 1, 1))
    corners = stream.lower[:, None] + unit * (stream.upper - stream.lower)[:, None]
    return sees_triangles(camera, corners[:, faces].reshape(-1, 3, 3))


def _sees_planes(camera: Camera, planes: Float64) -> bool:
    """Return True if any plane (P, 3, 4) is visible.

    Only the edges of the view pyramid are tested, because one of them approaches a plane faster than all other
    rays.
    """
    normal = planes[:, :, 2]
    height = np.sum(normal * (camera.position - planes[:, :, 3]), axis=1)
    return bool(np.any(normal @ camera.corner_rays().T * height[:, None] < 0))


def _sees_spheres(camera: Camera, spheres: Float64) -> bool:
    """Return True if any sphere (S, 3, 4) is visible.

    A sphere is visible if the view pyramid, in the space of the unit sphere, is nearer than 1 to the origin.
    """
    if not len(spheres):
        return False
    rays = camera.corner_rays()
    inward = np.cross(np.roll(rays, -1, axis=0), rays)
    inward *= np.sign(inward @ rays.mean(axis=0))[:, None]
    if np.all((spheres[:, :, 3] - camera.position) @ inward.T > 0, axis=1).any():
        return True  # the centre of a sphere is in the pyramid; the exact test below takes longer
    inverse = np.linalg.inv(spheres[:, :, :3])
    apex = np.einsum("nij,nj->ni", inverse, camera.position - spheres[:, :, 3])
    edges = np.einsum("nij,kj->nki", inverse, rays)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    following = np.roll(edges, -1, axis=1)
    # Outward normals of the pyramid's sides. A mirroring transform reverses the order of the edges.
    normals = np.cross(following, edges)
    normals *= -np.sign(np.sum(normals[:, 0] * edges[:, 2], axis=1))[:, None, None]
    outside = np.einsum("nki,ni->nk", normals, -apex)
    inside = (outside <= 0).all(axis=1)
    # The nearest point to the origin is on an edge, or in the interior of a side.
    along = np.maximum(np.einsum("nki,ni->nk", edges, -apex), 0)
    on_edge = np.linalg.norm(apex[:, None] + along[:, :, None] * edges, axis=2).min(axis=1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    height = np.einsum("nki,ni->nk", normals, apex)
    foot = height[:, :, None] * normals - apex[:, None]  # relative to the apex
    turn = np.cross(edges, following)
    past_one = np.sum(np.cross(edges, foot) * turn, axis=2) >= 0
    before_other = np.sum(np.cross(foot, following) * turn, axis=2) >= 0
    on_side = np.where(past_one & before_other, np.abs(height), np.inf).min(axis=1)
    return bool(np.any(inside | (np.minimum(on_edge, on_side) < 1)))


def sees_triangles(camera: Camera, triangles: Float64) -> bool:
    """Return True if any triangle (T, 3, 3) is visible.

    A triangle intersects the view pyramid if one of its edges does, or if an edge of the pyramid passes through it.
    """
    return any(_sees_some(camera, part) for part in _chunks(triangles))


def _are_many(scene: Scene) -> bool:
    """Return True if there are many triangles, mostly from repeated instances of meshes."""
    total = scene.shapes.total("triangle")
    return total > _MANY and total > 2 * sum(len(mesh.faces) for mesh in scene.shapes.meshes)


def _triangles(scene: Scene) -> Iterator[Float64]:
    """Yield all triangles of a scene, (n, 3, 3) at a time. If there are many, they are not expanded all at once."""
    if not _are_many(scene):
        yield scene.triangles
    else:
        for index in range(len(scene.shapes)):
            yield from scene.shapes.triangles_of(index)


def _about(scene: Scene, point: Float64, margin: float = 0.0) -> Iterator[tuple[int, Iterator[Float64]]]:
    """Yield the index and the triangles, in chunks, of each shape whose box, widened by `margin`, contains a point.

    If the scene has many triangles, only those instances are included whose box contains the point. A point that
    only several instances together enclose may then be missed.
    """
    indices = _shapes_about(scene, point, margin).tolist()
    are_many = bool(indices) and _are_many(scene)
    for index in indices:
        yield index, _triangles_about(scene, index, are_many, point, margin)


def _triangles_about(scene: Scene, index: int, are_many: bool, point: Float64, margin: float) -> Iterator[Float64]:
    """Yield a shape's triangles in chunks; see `_about`."""
    shape = scene.shapes[index]
    if not are_many:
        yield from _chunks(scene.triangles[scene.shapes.ranges[index]])
    elif isinstance(shape.geometry, Mesh):
        lower, upper = instance_boxes(shape.geometry, shape.world_from_object)
        around = np.asarray(((lower - margin <= point) & (upper + margin >= point)).all(axis=1))
        for triangles in scene.shapes.triangles_of(index, around):
            yield from _chunks(triangles)


def _chunks(triangles: Float64) -> Iterator[Float64]:
    for first in range(0, len(triangles), _CHUNK):
        check_time()
        yield triangles[first : first + _CHUNK]


def _sees_some(camera: Camera, triangles: Float64) -> bool:
    right, up, forward = camera.frame()
    (tan_right, tan_up), (across, above) = camera.extent, camera.offset
    points = triangles - camera.position
    z = points @ forward
    x, y = points @ right - across * z, points @ up - above * z
    # (T, 3 corners, 4 sides), positive if a corner is inside a side; a corner inside all four has z >= 0
    inside = np.stack([tan_right * z - x, tan_right * z + x, tan_up * z - y, tan_up * z + y], axis=2)
    if (inside > 0).all(axis=2).any():
        return True
    near = ~np.any((inside < 0).all(axis=1), axis=1)  # all other triangles are outside one side
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
    return any(bool(_pierced(ray, points[near]).any()) for ray in camera.corner_rays())


def _pierced(ray: Float64, points: Float64) -> NDArray[np.bool_]:
    """Return (T,) bool: True if the ray from the origin passes through the triangle; Möller and Trumbore 1997."""
    origin, a, b = points[:, 0], points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    p = np.cross(ray, b)
    determinant = np.sum(a * p, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.sum(-origin * p, axis=1) / determinant
        q = np.cross(-origin, a)
        v = q @ ray / determinant
        t = np.sum(b * q, axis=1) / determinant
    return np.asarray((determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0))


def touched_shape(scene: Scene) -> Shape | None:
    """Return the first shape that the camera touches: planes first, then spheres, then triangles."""

    def owner(primitive: Primitive, number: int) -> Shape:
        return scene.shapes[int(scene.shapes.primitive_shape(primitive)[number])]

    lower, upper = scene.bounds
    margin = _TOUCHING * float(np.linalg.norm(upper - lower))
    camera = scene.camera.at()
    eye = camera.position
    height = np.abs(np.sum(scene.planes[:, :, 2] * (eye - scene.planes[:, :, 3]), axis=1))
    # The bounds of a scene of planes alone may have no size. The tolerance is then relative to the distance from
    # the eye to the target.
    view = _TOUCHING * float(np.linalg.norm(camera.target - eye))
    if (hits := np.flatnonzero(height <= (margin or view))).size:
        return owner("plane", hits[0])
    about = np.flatnonzero(_near_spheres(scene.spheres, eye, margin))
    away, gradient = _from_surface(scene.spheres[about], eye)
    if (hits := about[np.abs(away) <= margin * gradient]).size:
        return owner("sphere", hits[0])
    for index, triangles in _about(scene, eye, 2 * margin):
        if any(_touched_triangles(part - eye, margin).size for part in triangles):
            return scene.shapes[index]
    return None


def _near_spheres(spheres: Float64, point: Float64, margin: float = 0.0) -> NDArray[np.bool_]:
    """Return (S,) bool: True if the point is inside the box around the sphere, widened by `margin`."""
    return np.asarray((np.abs(point - spheres[:, :, 3]) <= sphere_extent(spheres) + margin).all(axis=1))


def _from_surface(spheres: Float64, point: Float64) -> tuple[Float64, Float64]:
    """Return (S,) signed distances from each sphere's surface, and their (S,) gradients in world space.

    Distances are in the space of the unit sphere, negative inside.
    """
    inverse = np.linalg.inv(spheres[:, :, :3])
    unit = np.einsum("nij,nj->ni", inverse, point - spheres[:, :, 3])
    distance = np.linalg.norm(unit, axis=1)
    direction = unit / np.maximum(distance, np.finfo(float).tiny)[:, None]
    return distance - 1, np.linalg.norm(np.einsum("nij,ni->nj", inverse, direction), axis=1)


def enclosing(scene: Scene, point: Float64) -> NDArray[np.int64]:
    """Return (number of shapes,) int: 1 or -1 for a shape that encloses the point, 0 for any other shape.

    It is 1 if the shape's fronts face outward, and -1 if they face inward.

    For triangles this is the winding number.
    """
    return enclosing_with_cost(scene, point)[0]


def enclosing_with_cost(scene: Scene, point: Float64) -> tuple[NDArray[np.int64], int]:
    """Return `enclosing` and its cost.

    The cost is the number of tested triangles and instances, plus `_SHAPE_COST` for each shape.
    """
    around, cost = enclosing_spheres(scene, point), 0
    for index, triangles in _about(scene, point):
        turns = 0.0
        cost += _SHAPE_COST + scene.shapes[index].world_from_object.shape[0]
        for part in triangles:
            turns += winding_number(part, point)
            cost += len(part)
        around[index] = round(turns) if abs(turns - round(turns)) < 1e-3 else 0
    return around, cost


def enclosing_spheres(scene: Scene, point: Float64) -> NDArray[np.int64]:
    """Return `enclosing` for spheres; 0 for shapes of triangles."""
    around = np.zeros(len(scene.shapes), np.int64)
    about = np.flatnonzero(_near_spheres(scene.spheres, point))
    within = about[_from_surface(scene.spheres[about], point)[0] < 0]
    if len(within):
        sign = np.sign(np.linalg.det(scene.spheres[within, :, :3])).astype(np.int64)
        around[scene.shapes.primitive_shape("sphere")[within]] = sign
    return around


def _shapes_about(scene: Scene, point: Float64, margin: float = 0.0) -> NDArray[np.intp]:
    """Return the triangle shapes whose boxes, widened by `margin`, contain a point."""
    lower, upper = scene.shapes.boxes
    return np.flatnonzero(((lower - margin <= point) & (upper + margin >= point)).all(axis=1))


def winding_number(triangles: Float64, point: Float64) -> float:
    """Return the winding number of triangles (T, 3, 3) around a point: their solid angle divided by 4 pi.

    A. van Oosterom, J. Strackee, "The solid angle of a plane triangle", 1983.
    """
    return sum(_solid_angle(part - point) for part in _chunks(triangles)) / (4 * np.pi)


def _solid_angle(corners: Float64) -> float:
    """Return the solid angle of triangles (T, 3, 3) seen from the origin; backs count as positive."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=1)
    ab, bc, ca = (np.sum(x * y, axis=1) for x, y in ((a, b), (b, c), (c, a)))
    return float(2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())


def _touched_triangles(corners: Float64, margin: float) -> NDArray[np.intp]:
    """Return the indices of triangles (T, 3, 3) on which the origin lies, within `margin`."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    lower, upper = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    about = np.flatnonzero(((lower <= margin) & (upper >= -margin)).all(axis=1))
    corners = corners[about]
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    height = np.abs(np.sum(corners[:, 0] * normals, axis=1))
    # Distance of the origin from each edge in the triangle's plane, positive inside.
    within = np.sum(np.cross(edges, -corners) * normals[:, None], axis=2)
    within /= np.maximum(np.linalg.norm(edges, axis=2), np.finfo(float).tiny)
    return np.asarray(about[(height <= margin) & (within >= -margin).all(axis=1)])
