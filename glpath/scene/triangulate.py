"""Scenes for path tracing engines, which support only triangles, but every kind of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.errors import SceneError, argument
from glpath.scene.geometry import IDENTITY, Float64, Mesh, Shape, Shapes, ellipsoid_area
from glpath.scene.model import Scene, triangle_areas
from glpath.scene.source_location import SourceLocation
from glpath.scene.tessellate import unit_sphere, with_area, without_area
from glpath.system.arguments import checked
from glpath.system.time_limit import check_time

# Maximum number of triangles, about ten gigabytes on the device; more are probably a mistake.
MAX_TRIANGLES = 2**27

_LISTED = 3


@checked
def path_traceable(scene: Scene, streams: bool = False, *, centred: bool = True) -> Scene:
    """Return the scene in triangles only, in the order of its shapes, relative to its `origin` (`Scene.centred`).

    It returns `scene` itself if that has no spheres and is near the origin. Spheres become icospheres with their
    `subdivisions`. They keep their radiance, or their flux if that was given (`Shape.keeps_flux`).

    streams : True if the engine supports streamed triangles
    centred : False keeps the coordinates, for callers that use float64

    Raises SceneError for shapes that paths cannot hit: planes, and streams if all triangles must be in memory.
    Issues a SceneWarning for triangles without area.
    """
    _check_known(scene)
    if streams:
        check_streamable(scene)
    else:
        check_resident(scene)
    if centred:
        scene = scene.centred
    if not len(scene.spheres):
        return scene
    _check_number(scene)
    location, opened = SourceLocation(scene.source or scene.name), scene.camera.shutter[0]
    shapes = [
        _moving(shape, opened, scene.materials[shape.material].needs_uv, location.field("shapes").item(index))
        if shape.primitive == "sphere"
        else shape
        for index, shape in enumerate(scene.shapes)
    ]
    # Keep the origin that was chosen for the spheres. Their triangles have a slightly smaller box, and so perhaps
    # another origin.
    return replace(scene, shapes=Shapes(shapes), centred_by=scene.origin if centred else scene.centred_by)


def _moving(shape: Shape, opened: float, textured: bool, location: SourceLocation) -> Shape:
    """Return the result of `_tessellated` for a shape that may move, with the same motion.

    opened : time in seconds when the shutter opens
    """
    if shape.motion is None:
        return _tessellated(shape, textured, location)
    made = _tessellated(replace(shape, world_from_object=shape.motion.placed, motion=None), textured, location)
    motion = replace(shape.motion, placed=made.world_from_object)
    return replace(made, world_from_object=motion.at(opened), motion=motion)


def _tessellated(shape: Shape, textured: bool, location: SourceLocation) -> Shape:
    """Return the shape with instances of a shared icosphere instead of spheres."""
    check_time()
    mesh, matrices = unit_sphere(shape.subdivisions, with_uv=textured), shape.world_from_object
    if (np.linalg.det(matrices[:, :, :3]) < 0).all():
        # Mesh and maps are both mirrored, so that a sphere with its front inside has the same triangles as one with
        # its front outside.
        mesh, matrices = mesh.turned(), turned(matrices)
        if mesh.uv is not None:
            mesh = replace(mesh, uv=mesh.uv * [-1.0, 1.0])  # mirroring reverses the longitude, too
    instances = replace(shape, geometry=mesh, world_from_object=matrices, kind="mesh")
    alone = Shapes((instances,))
    if shape.keeps_flux:  # the triangles lie inside the sphere, so their area is smaller
        areas = (sum(map(ellipsoid_area, shape.world_from_object)), triangle_areas(alone.triangles).sum())
        instances = replace(instances, emission=shape.emission * (areas[0] / areas[1]), keeps_flux=False)
    if not any(without_area(part).any() for part in alone.triangles_of(0)):
        return instances
    # A very flat ellipsoid has triangles without area, and not the same ones in every instance.
    whole = Mesh(
        alone.vertices, alone.faces, uv=alone.vertex_uv if textured else None, normals=alone.vertex_normals
    )
    return replace(
        instances, geometry=with_area(whole, IDENTITY, shape.name, location), world_from_object=IDENTITY[None]
    )


def turned(world_from_unit: Float64) -> Float64:
    """Return spheres (..., 3, 4) with fronts and backs exchanged; longitude is reversed."""
    return np.asarray(world_from_unit * [1.0, -1.0, 1.0, 1.0])


def check_resident(scene: Scene) -> None:
    """Raise SceneError if the scene has streams, because their triangles are never in memory all at once."""
    _check_resident(
        scene,
        "scans alone can render: rays, a BVH and radiosity need them all in memory",
        f"Render it with {argument('integrator', 'path-buffer', 't-buffer')}, or with a gather and "
        f"{argument('cast', 'path-buffer')}.",
    )


def check_streamable(scene: Scene) -> None:
    """Raise SceneError if streams are combined with features that engines with streaming do not support."""
    if scene.moving_shapes:
        _check_resident(scene, "cannot be where other shapes move", "Close the shutter, or hold them in memory.")
    elif scene.camera.projection == "panorama":
        _check_resident(scene, "no panorama can see: its eye rays need a BVH", "Take another camera.")


def check_unmirrored(scene: Scene, max_depth: int) -> None:
    """Raise SceneError if reflections may show streamed triangles, for engines that cast rays for reflections.

    max_depth : maximum depth of paths; 1 is direct light only
    """
    used = [scene.materials[index] for index in sorted({shape.material for shape in scene.shapes})]
    mirrors = [material.name for material in used if material.has_lobes]
    if max_depth > 1 and mirrors:
        _check_resident(
            scene,
            f"no reflected ray can meet, and has materials that reflect ({_listed(mirrors)}); with max_depth "
            f"{max_depth}, only diffuse materials are allowed",
            f"Take {argument('max_depth', 1)}, which leaves reflections out, or "
            f"{argument('integrator', 'path-buffer')}.",
        )


def check_simplifiable(scene: Scene) -> None:
    """Raise SceneError for streams, and for moving shapes, if meshes are to be simplified."""
    remedy = "Leave out bounce_lod."
    _check_resident(scene, "bounce_lod cannot simplify: it wants them all in memory", remedy)
    if scene.moving_shapes:
        names = ", ".join(scene.shapes[index].name for index in scene.moving_shapes[:_LISTED])
        raise SceneError(
            f"{scene.source or scene.name}: has shapes that move ({names}), whose simpler ones would stand still.",
            remedy,
        )


def _check_resident(scene: Scene, which: str, remedy: str) -> None:
    streams = [scene.shapes[index].name for index, _ in scene.shapes.streams]
    if streams:
        raise SceneError(
            f"{scene.source or scene.name}: streams triangles ({_listed(streams)}), which {which}.",
            remedy,
        )


def _listed(names: list[str]) -> str:
    return f"{', '.join(names[:_LISTED])}{', ...' if len(names) > _LISTED else ''}"


def _check_known(scene: Scene) -> None:
    planes = [shape.name for shape in scene.shapes if shape.primitive == "plane"]
    if planes:
        raise SceneError(
            f"{scene.source or scene.name}: has planes ({_listed(planes)}), which path tracing cannot render: an "
            "endless plane has no triangles.",
            f"Render it with {argument('integrator', 'classic', 't-buffer')}, or make planes large quads.",
        )


def _check_number(scene: Scene) -> None:
    """Raise SceneError before spheres are tessellated if their triangles would not fit into memory."""
    count = scene.shapes.total("triangle")
    for shape in scene.shapes:
        if shape.primitive == "sphere":
            count += shape.count * 20 * 4**shape.subdivisions
    if count > MAX_TRIANGLES:
        raise SceneError(
            f"{scene.source or scene.name}: {len(scene.spheres):,} spheres would be {count:,} triangles; the path "
            f"tracer takes at most {MAX_TRIANGLES:,}.",
            "Give the spheres fewer `subdivisions`, or render with "
            f"{argument('integrator', 'classic', 't-buffer')}.",
        )
