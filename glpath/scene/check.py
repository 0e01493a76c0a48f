"""What is wrong with a scene although its file can be read: `check_camera` raises, `check_scene` warns.

Loading does not warn by itself: a scene is often loaded to be changed. Rendering and `glpath validate` ask here.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from glpath.scene.camera import CameraKey, Projection
from glpath.scene.model import Camera, Float64, Light, Mesh, Primitive, Scene, Shape, Stream, sphere_extent
from glpath.scene.place import Place
from glpath.scene.tessellate import box

MAX_PIXELS = 2**28

# Sine of the angle between `up` and the view below which there is no telling what is up.
_PARALLEL = 1e-6
# Of the size of the scene: nearer than this, the camera stands in the surface.
_TOUCHING = 1e-6


def check_camera(camera: Camera, source: str | Place) -> None:
    """Raise SceneError for a camera that cannot see: no direction, no up, no angle, no pixels.

    Also for cameras changed by hand (`Scene.with_camera`, `--camera-up`); `source` names the scene in the message,
    or is its place.
    """
    scene = Place(source) if isinstance(source, str) else source
    place = scene.field("camera")
    for name in ("position", "target", "up"):
        vector = np.asarray(getattr(camera, name), np.float64)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise place.field(name).wrong(vector, "three finite numbers")
    if not 0 < camera.fov < 180:
        raise place.field("fov").wrong(
            float(camera.fov), "above 0 and below 180 degrees", "It is the vertical field of view."
        )
    _check_lens(camera, place)
    _check_motion(camera, place)
    width, height = camera.resolution
    if not (width >= 1 and height >= 1 and width * height <= MAX_PIXELS):
        raise (
            scene.field("film")
            .field("resolution")
            .wrong(
                [width, height], f"at least 1 x 1 and at most {MAX_PIXELS:,} pixels", "Choose a smaller resolution."
            )
        )
    _check_pose(camera, place)
    for index, key in enumerate(camera.motion):
        _check_pose(key, place.field("motion").item(index))


def _check_lens(camera: Camera, place: Place) -> None:
    """What a projection and a lens need, each by itself."""
    if camera.projection not in get_args(Projection):
        raise place.field("type").wrong(camera.projection, f"one of: {', '.join(get_args(Projection))}")
    for name, least in (("height", 0.0), ("aperture_radius", -1.0), ("focus_distance", 0.0)):
        value = getattr(camera, name)
        if value is not None and not (np.isfinite(value) and value > least and value >= 0):
            raise place.field(name).wrong(float(value), "0 or more" if least < 0 else "above 0")
    if camera.aperture_radius > 0 and camera.projection != "perspective":
        raise place.field("aperture_radius").error(
            f"is {camera.aperture_radius:g}, but a camera of type {camera.projection} has no lens.",
            'Leave it out, or take type = "perspective".',
        )


def _check_motion(camera: Camera, place: Place) -> None:
    """The shutter, and the order of the keys."""
    opened, closed = camera.shutter
    if not (np.isfinite([opened, closed]).all() and opened <= closed):
        raise place.field("shutter").wrong(
            [float(opened), float(closed)], "two finite numbers, the first at most the second"
        )
    for index, key in enumerate(camera.motion):
        here = place.field("motion").item(index)
        for name in ("position", "target", "up"):
            vector = np.asarray(getattr(key, name), np.float64)
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise here.field(name).wrong(vector, "three finite numbers")
        before = camera.motion[index - 1].time if index else -np.inf
        if not (np.isfinite(key.time) and key.time > before):
            raise here.field("time").wrong(
                float(key.time), f"above {before:g}, the key before" if index else "a finite number", "Sort them."
            )


def _check_pose(camera: Camera | CameraKey, place: Place) -> None:
    """Raise SceneError where there is no direction or no up."""
    view = camera.target - camera.position
    distance = np.linalg.norm(view)
    up = place.field("up")
    if not distance > 1e-12 * np.linalg.norm(camera.position):
        raise place.field("target").error(
            f"is the same point as {place.field('position').path}, so that the camera looks nowhere.",
            "Move one of them.",
        )
    length = np.linalg.norm(camera.up)
    if not length > 0:
        raise up.wrong(camera.up, "a vector of any length but zero", f"For example {up.setting([0, 1, 0])}.")
    if np.linalg.norm(np.cross(view / distance, camera.up / length)) < _PARALLEL:
        across = np.eye(3, dtype=int)[np.argmin(np.abs(view))].tolist()
        raise up.error(
            f"is {up.written(camera.up)}, parallel to the view from position to target, which leaves no up.",
            f"Choose another, such as {up.setting(across)}.",
        )


def check_scene(scene: Scene, seen: bool = True) -> list[str]:
    """Warnings, each a sentence or two, about a scene which renders but hardly as meant. Empty when all is well.

    seen : by its camera; else only what light does in it is asked for
    """
    shining = [light for light in scene.lights if np.any(light.intensity > 0)]
    placed = [light for light in shining if light.kind != "directional"]
    around_lights = [_enclosing(scene, light.position) for light in placed]
    around_camera = _enclosing(scene, scene.camera.position)
    found = [] if shining else _about_darkness(scene)
    for light, around in zip(placed, around_lights, strict=True):
        found += _about_what_hides(light, scene, np.flatnonzero((around != 0) & (around_camera == 0)))
    # A sphere with a light in it is meant as a room.
    lit_inside = np.any([np.zeros(len(scene.shapes)), *around_lights], axis=0)
    if seen:
        found += _about_camera(scene, np.flatnonzero((around_camera > 0) & ~lit_inside))
    return found + _about_time(scene) + _about_materials(scene)


def _about_time(scene: Scene) -> list[str]:
    """Motion that a shutter does not see, and panoramas of another shape."""
    camera, found = scene.camera, []
    moving = [shape.name for shape in scene.shapes if shape.motion is not None and len(shape.motion.times) > 1]
    moving += ["the camera"] * (len(camera.motion) > 1)
    if moving and camera.shutter == (0.0, 0.0):
        found.append(
            f"There is motion ({', '.join(moving[:3])}), but the shutter opens for the moment 0 alone, so nothing "
            "is blurred. Say how long it is open: shutter = [0, 0.02]."
        )
    width, height = camera.resolution
    if camera.projection == "panorama" and abs(width - 2 * height) > 0.01 * width:
        found.append(
            f"The panorama has {width} x {height} pixels, which are wider or narrower than they are high: "
            "360 x 180 degrees are an image twice as wide as high."
        )
    return found


def _about_camera(scene: Scene, around: NDArray[np.intp]) -> list[str]:
    """around: the shapes that enclose the camera, fronts outward, without a light inside."""
    touching = _touched(scene)
    if touching is not None:
        return [
            f'The camera stands exactly on a surface, of the shape "{touching.name}": '
            "half of the picture may be that surface. Move it a little."
        ]
    if not sees_anything(scene):
        lower, upper = scene.bounds
        return [
            "The camera sees nothing: no shape is in view. "
            f"It stands at {_point(scene.camera.position)} and looks at {_point(scene.camera.target)}; "
            f"the scene reaches from {_point(lower)} to {_point(upper)}."
        ]
    # A box may be meant as a room, and so may a sphere that shines to its inside.
    shapes = [scene.shapes[index] for index in around]
    return [
        f'The camera stands inside the sphere "{shape.name}" and sees nothing but its inside. '
        "Move it out, or give the sphere flip_normals = true if it is meant as a room."
        for shape in shapes
        if shape.primitive == "sphere" and not (shape.emits and shape.emission_two_sided)
    ]


def _about_darkness(scene: Scene) -> list[str]:
    sky = scene.sky is not None and scene.sky.max_radiance > 0
    if sky or np.any(scene.ambient > 0) or any(shape.emits for shape in scene.shapes):
        return []
    return [
        "No shape emits light, and there is no other light: the picture will be black. "
        "Give a shape an emission, e.g. emission = { radiance = [10, 10, 10] }, or add [[lights]]."
    ]


def _about_what_hides(light: Light, scene: Scene, around: NDArray[np.intp]) -> list[str]:
    """around: the shapes that enclose the light, but not the camera."""
    found = [
        f'The light "{light.name}" stands inside the shape "{scene.shapes[index].name}", which keeps it from '
        "everything outside. Move the light out, or leave the shape away."
        for index in around
    ]
    # Above 0 on the front side of each plane.
    eye, lamp = (
        np.sum(scene.planes[:, :, 2] * (point - scene.planes[:, :, 3]), axis=1)
        for point in (scene.camera.position, light.position)
    )
    shape_of_plane = scene.shapes.primitive_shape("plane")
    return found + [
        f'The light "{light.name}" and the camera are on different sides of the plane '
        f'"{scene.shapes[shape_of_plane[index]].name}", which keeps it from all that can be seen. Move one of them.'
        for index in np.flatnonzero(eye * lamp < 0)
    ]


def _about_materials(scene: Scene) -> list[str]:
    found = []
    with_colours = {
        s.material for s in scene.shapes if isinstance(s.geometry, Mesh) and s.geometry.colours is not None
    }
    for index in sorted({shape.material for shape in scene.shapes}):
        material = scene.materials[index]
        plain = material.texture is None and index not in with_colours
        if plain and not material.has_lobes and np.all(material.reflectance >= 1):
            found.append(
                f'The material "{material.name}" reflects all light (reflectance 1): '
                "no real surface does, and between such surfaces light never dies out."
            )
        max_reflectance = material.reflectance
        if material.texture is not None:
            texels = scene.textures[material.texture.texture].linear()
            max_reflectance = max_reflectance * texels[..., :3].max(axis=(0, 1))
        if np.any(material.mirror > 0) and np.any(max_reflectance + material.mirror > 1 + 1e-6):
            found.append(
                f'The material "{material.name}" reflects more light than it receives: '
                f"reflectance and mirror add up to {np.max(max_reflectance + material.mirror):.3g}. Lower one of "
                "them."
            )
    return found


def sees_anything(scene: Scene) -> bool:
    """Whether any shape reaches into the pyramid of view, whatever hides it; exact up to rounding.

    The pyramid has no near and no far end; parallel rays begin in the camera's plane, and bodies are to them the
    boxes around them, in the camera's axes. What moves is looked for when the shutter opens, in the middle of the
    time and when it closes.
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
        or sees_triangles(camera, scene.triangles)
        or any(_sees_boxes(camera, stream) for _, stream in scene.shapes.streams)
    )


def _seen_by_parallel_rays(camera: Camera, scene: Scene) -> bool:
    """Planes exactly, triangles and spheres by the boxes around them in the camera's axes."""
    axes = np.stack(camera.frame())
    wide, high = camera.extent
    centre, reach = scene.spheres[:, :, 3], np.linalg.norm(axes @ scene.spheres[:, :, :3], axis=2)
    spheres = (centre - camera.position) @ axes.T
    triangles = (scene.triangles - camera.position) @ axes.T
    lower = np.concatenate([triangles.min(axis=1), spheres - reach])
    upper = np.concatenate([triangles.max(axis=1), spheres + reach])
    limit = np.array([wide, high])
    within = (lower[:, :2] <= limit).all(axis=1) & (upper[:, :2] >= -limit).all(axis=1) & (upper[:, 2] >= 0)
    if within.any():
        return True
    # From the corners of the image: a plane is in front of one of them, or beside them all.
    corners = camera.origins([[0, 0], [camera.resolution[0], 0], [0, camera.resolution[1]], camera.resolution])
    normal = scene.planes[:, :, 2]
    towards = normal @ axes[2]
    height = np.einsum("pi,pki->pk", normal, corners[None] - scene.planes[:, None, :, 3])
    return bool(np.any((height * towards[:, None] < 0) & (towards[:, None] != 0)))


def _sees_boxes(camera: Camera, stream: Stream) -> bool:
    """Whether a box around a chunk reaches into the pyramid: what is in it is not asked for."""
    unit, faces = box((0, 0, 0), (1, 1, 1))
    corners = stream.lower[:, None] + unit * (stream.upper - stream.lower)[:, None]
    return sees_triangles(camera, corners[:, faces].reshape(-1, 3, 3))


def _sees_planes(camera: Camera, planes: Float64) -> bool:
    """planes: (P, 3, 4). Of all rays of the pyramid, one of its edges goes the most towards a plane."""
    normal = planes[:, :, 2]
    height = np.sum(normal * (camera.position - planes[:, :, 3]), axis=1)
    return bool(np.any(normal @ camera.corner_rays().T * height[:, None] < 0))


def _sees_spheres(camera: Camera, spheres: Float64) -> bool:
    """spheres: (S, 3, 4). In the space where one is the unit sphere: is the pyramid nearer than 1 to the origin?"""
    if not len(spheres):
        return False
    rays = camera.corner_rays()
    inward = np.cross(np.roll(rays, -1, axis=0), rays)
    inward *= np.sign(inward @ rays.mean(axis=0))[:, None]
    if np.all((spheres[:, :, 3] - camera.position) @ inward.T > 0, axis=1).any():
        return True  # the centre of one; what follows is slow for a million
    inverse = np.linalg.inv(spheres[:, :, :3])
    apex = np.einsum("nij,nj->ni", inverse, camera.position - spheres[:, :, 3])
    edges = np.einsum("nij,kj->nki", inverse, rays)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    following = np.roll(edges, -1, axis=1)
    # Out of each side; where the transform mirrors, the edges go around the other way.
    normals = np.cross(following, edges)
    normals *= -np.sign(np.sum(normals[:, 0] * edges[:, 2], axis=1))[:, None, None]
    outside = np.einsum("nki,ni->nk", normals, -apex)
    inside = (outside <= 0).all(axis=1)
    # Nearest to the origin is a point of an edge, or of the inside of a side.
    along = np.maximum(np.einsum("nki,ni->nk", edges, -apex), 0)
    on_edge = np.linalg.norm(apex[:, None] + along[:, :, None] * edges, axis=2).min(axis=1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    height = np.einsum("nki,ni->nk", normals, apex)
    foot = height[:, :, None] * normals - apex[:, None]  # from the apex
    turn = np.cross(edges, following)
    past_one = np.sum(np.cross(edges, foot) * turn, axis=2) >= 0
    before_other = np.sum(np.cross(foot, following) * turn, axis=2) >= 0
    on_side = np.where(past_one & before_other, np.abs(height), np.inf).min(axis=1)
    return bool(np.any(inside | (np.minimum(on_edge, on_side) < 1)))


def sees_triangles(camera: Camera, triangles: Float64) -> bool:
    """triangles: (T, 3, 3). One reaches into the pyramid when an edge of it does, or an edge of the pyramid goes
    through its inside.
    """
    right, up, forward = camera.frame()
    tan_right, tan_up = camera.extent
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
    return any(bool(_pierced(ray, points[near]).any()) for ray in camera.corner_rays())


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


def _touched(scene: Scene) -> Shape | None:
    """The first shape that the camera stands on: of planes, then of spheres, then of triangles."""

    def owner(primitive: Primitive, number: int) -> Shape:
        return scene.shapes[int(scene.shapes.primitive_shape(primitive)[number])]

    lower, upper = scene.bounds
    reach = _TOUCHING * float(np.linalg.norm(upper - lower))
    eye = scene.camera.position
    height = np.abs(np.sum(scene.planes[:, :, 2] * (eye - scene.planes[:, :, 3]), axis=1))
    # Of planes alone the bounds say nothing; the view has a length.
    view = _TOUCHING * float(np.linalg.norm(scene.camera.target - eye))
    if (hits := np.flatnonzero(height <= (reach or view))).size:
        return owner("plane", hits[0])
    about = np.flatnonzero(_near_spheres(scene.spheres, eye, reach))
    away, gradient = _from_surface(scene.spheres[about], eye)
    if (hits := about[np.abs(away) <= reach * gradient]).size:
        return owner("sphere", hits[0])
    if (hits := _touched_triangles(scene.triangles - eye, reach)).size:
        return owner("triangle", hits[0])
    return None


def _near_spheres(spheres: Float64, point: Float64, reach: float = 0.0) -> NDArray[np.bool_]:
    """(S,) bool: the point is in the box around the sphere."""
    return np.asarray((np.abs(point - spheres[:, :, 3]) <= sphere_extent(spheres) + reach).all(axis=1))


def _from_surface(spheres: Float64, point: Float64) -> tuple[Float64, Float64]:
    """(S,) how far the point is from each unit sphere's surface, negative inside, in the space where it is one, and
    (S,) how fast that grows in world space.
    """
    inverse = np.linalg.inv(spheres[:, :, :3])
    unit = np.einsum("nij,nj->ni", inverse, point - spheres[:, :, 3])
    distance = np.linalg.norm(unit, axis=1)
    direction = unit / np.maximum(distance, np.finfo(float).tiny)[:, None]
    return distance - 1, np.linalg.norm(np.einsum("nij,ni->nj", inverse, direction), axis=1)


def _enclosing(scene: Scene, point: Float64) -> NDArray[np.int64]:
    """(number of shapes,) int: 1 for a shape that is closed around the point, fronts outward, -1 inward, else 0.

    Of triangles it is the winding number: their solid angle over 4 pi [Van Oosterom and Strackee 1983].
    """
    around = np.zeros(len(scene.shapes), np.int64)
    about = np.flatnonzero(_near_spheres(scene.spheres, point))
    within = about[_from_surface(scene.spheres[about], point)[0] < 0]
    sign = np.sign(np.linalg.det(scene.spheres[within, :, :3])).astype(np.int64)
    around[scene.shapes.primitive_shape("sphere")[within]] = sign
    for index in _shapes_about(scene, point):
        turns = _solid_angle(scene.triangles[scene.shapes.ranges[index]] - point) / (4 * np.pi)
        around[index] = round(turns) if abs(turns - round(turns)) < 1e-3 else 0
    return around


def _shapes_about(scene: Scene, point: Float64) -> list[int]:
    """The shapes of triangles with the point in the box around them."""
    indices = [i for i, shape in enumerate(scene.shapes) if shape.primitive == "triangle" and shape.count]
    if not indices:
        return []
    first = [scene.shapes.ranges[i].start for i in indices]
    lower = np.minimum.reduceat(scene.triangles.min(axis=1), first)
    upper = np.maximum.reduceat(scene.triangles.max(axis=1), first)
    return [indices[i] for i in np.flatnonzero(((lower <= point) & (upper >= point)).all(axis=1))]


def _solid_angle(corners: Float64) -> float:
    """Of triangles (T, 3, 3) seen from the origin, their backs positive."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=1)
    ab, bc, ca = (np.sum(x * y, axis=1) for x, y in ((a, b), (b, c), (c, a)))
    return float(2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())


def _touched_triangles(corners: Float64, reach: float) -> NDArray[np.intp]:
    """Which triangles (T, 3, 3) the origin lies on."""
    about = np.flatnonzero(((corners.min(axis=1) <= reach) & (corners.max(axis=1) >= -reach)).all(axis=1))
    corners = corners[about]
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    height = np.abs(np.sum(corners[:, 0] * normals, axis=1))
    # how far the origin lies within each edge
    within = np.sum(np.cross(edges, -corners) * normals[:, None], axis=2)
    within /= np.maximum(np.linalg.norm(edges, axis=2), np.finfo(float).tiny)
    return np.asarray(about[(height <= reach) & (within >= -reach).all(axis=1)])


def _point(point: Float64) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
