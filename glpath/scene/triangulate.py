"""A scene for the path tracer, which knows triangles with Lambertian reflection, and light from their emission."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.errors import SceneError
from glpath.scene.model import Float64, Scene, Shape
from glpath.scene.place import Place
from glpath.scene.tessellate import unit_sphere, with_area

# A float on the GPU holds a triangle's number.
MOST_TRIANGLES = 2**24 - 1

_LISTED = 3


def path_traceable(scene: Scene) -> Scene:
    """The scene in triangles only, in the order of its shapes; `scene` itself where it has no spheres.

    Spheres become icospheres of their `subdivisions`. Raises SceneError for what path tracing with the path-buffer
    does not do, all of it at once: planes, lights without extent, textures, highlights and mirrors, ambient light
    and a sky. Warns with SceneWarning of triangles without area.
    """
    _check_known(scene)
    if not len(scene.spheres):
        return scene
    _check_number(scene)
    shapes: list[Shape] = []
    triangles: list[Float64] = []
    first = 0
    for index, shape in enumerate(scene.shapes):
        part = slice(shape.first, shape.first + shape.count)
        kind = shape.kind
        if shape.primitive == "sphere":
            place = Place(scene.source or scene.name, f"shapes[{index}]")
            corners = _tessellated(scene.spheres[part], shape.subdivisions)
            corners, _ = with_area(corners, np.zeros((len(corners), 3, 2)), shape.name, place)
            kind = "mesh"
        else:
            corners = scene.triangles[part]
        triangles.append(corners)
        shapes.append(replace(shape, kind=kind, first=first, count=len(corners)))
        first += len(corners)
    return replace(
        scene,
        triangles=np.ascontiguousarray(np.concatenate(triangles)),
        triangle_uv=np.zeros((first, 3, 2)),  # no texture is left that could look at them
        spheres=np.zeros((0, 3, 4)),
        shapes=tuple(shapes),
    )


def _tessellated(world_from_unit: Float64, subdivisions: int) -> Float64:
    """(S * T, 3, 3) corners of the triangles of spheres (S, 3, 4)."""
    vertices, faces = unit_sphere(subdivisions)
    inward = np.linalg.det(world_from_unit[:, :, :3]) < 0
    # Turned back, so that a room of a sphere has the triangles of the ball, wound the other way.
    outward = np.where(inward[:, None, None], turned(world_from_unit), world_from_unit)
    points = vertices @ outward[:, :, :3].swapaxes(1, 2) + outward[:, None, :, 3]
    corners = points[:, faces]
    corners[inward] = corners[inward][:, :, ::-1]
    return corners.reshape(-1, 3, 3)


def turned(world_from_unit: Float64) -> Float64:
    """Spheres (..., 3, 4) with their fronts on the other side; longitude runs the other way about them."""
    return np.asarray(world_from_unit * [1.0, -1.0, 1.0, 1.0])


def _check_known(scene: Scene) -> None:
    used = sorted({shape.material for shape in scene.shapes})
    shiny = [scene.materials[i].name for i in used if not scene.materials[i].lambertian]
    planes = [shape.name for shape in scene.shapes if shape.primitive == "plane"]
    found = [
        f"{what} ({', '.join(names[:_LISTED])}{', ...' if len(names) > _LISTED else ''})"
        for what, names in (
            ("planes", planes),
            ("lights without extent", [light.name for light in scene.lights]),
            ("textures, highlights and mirrors", shiny),
        )
        if names
    ]
    found += ["ambient light"] if np.any(scene.ambient > 0) else []
    found += ["a sky"] if scene.sky is not None else []
    if found:
        raise SceneError(
            f"{scene.source or scene.name}: has {', '.join(found)}, which the path tracer does not know.",
            "Render it with --integrator classic or t-buffer. The path tracer takes quads, boxes, spheres and "
            "meshes with diffuse materials of one colour, lit by shapes with an emission.",
        )


def _check_number(scene: Scene) -> None:
    """Before any is made: a few thousand spheres can be more triangles than fit into memory."""
    count = len(scene.triangles)
    for shape in scene.shapes:
        if shape.primitive == "sphere":
            count += shape.count * 20 * 4**shape.subdivisions
    if count > MOST_TRIANGLES:
        raise SceneError(
            f"{scene.source or scene.name}: {len(scene.spheres):,} spheres would be {count:,} triangles; the path "
            f"tracer takes at most {MOST_TRIANGLES:,}.",
            "Give the spheres fewer `subdivisions`, or render with --integrator classic or t-buffer.",
        )
