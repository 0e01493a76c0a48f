"""Build a `Scene` from the typed data of a scene file. Shapes become primitives, and names become indices.

This module makes the checks that types cannot express, and reports the location of each error. It finds materials
that do not exist, quads that are not planar, boxes turned inside out, and triangles without area.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import UNSET, UnsetType

from glpath.errors import warn
from glpath.io import description, lights, materials, motion, transform
from glpath.io.assets import Assets
from glpath.io.completed import is_aside
from glpath.io.description import AnyMaterial, AnyShape, SceneFile
from glpath.io.meshes import UV_GAPS, has_uv_gaps, inline_mesh, read_mesh, without_uv_gaps
from glpath.io.patches import patch_surface
from glpath.io.streams import Chunks, NpyTriangles, stream_of
from glpath.io.values import LARGEST, SMALLEST, light, unit, unknown
from glpath.scene import tessellate
from glpath.scene.camera_check import check_camera
from glpath.scene.geometry import IDENTITY
from glpath.scene.model import (
    Camera,
    Float64,
    Material,
    Mesh,
    Scene,
    Shape,
    Shapes,
    Stream,
    Texture,
    moved_textures,
    placed,
)
from glpath.scene.motion import moved_plane
from glpath.scene.source_location import SourceLocation, shown
from glpath.scene.tessellate import FLAT, with_area
from glpath.scene.triangulate import turned
from glpath.system.time_limit import check_time
from glpath.system.units import Unit

# Maximum distance between the two diagonals of a planar quad, as a fraction of the longer diagonal. Other quads are
# rejected. Coordinates rounded to three digits stay below the maximum.
_PLANAR = 1e-3
DEFAULT_MATERIAL = "default"
# Field of view, degrees, stored for panorama and orthographic cameras, which ignore it.
_FOV = 40.0


@dataclass(frozen=True)
class Supplied:
    """Parts of a scene that a caller supplies as objects instead of naming them in the file.

    materials : material by index of the shape in the file, with texture indices into `textures`
    textures  : textures of these materials, which follow those of the file
    camera    : camera of the scene; None: the camera of the file
    """

    materials: Mapping[int, Material] = field(default_factory=dict)
    textures: Sequence[Texture] = ()
    camera: Camera | None = None


def build(
    file: SceneFile,
    location: SourceLocation,
    folder: Path,
    name: str,
    meshes: Mapping[int, Mesh | Chunks],
    supplied: Supplied,
) -> Scene:
    """Return the scene that `file` describes. Raises SceneError. A SceneWarning reports triangles without area.

    folder   : base folder of relative paths of meshes and pictures
    name     : name of the scene if the file does not set one
    meshes   : meshes and streams that are already in memory, by index of the shape in `file.shapes`
    supplied : materials and camera that replace those of the file
    """
    camera = supplied.camera or _camera(file)
    check_camera(camera, location.source)
    scene_unit: Unit = "radiometric" if isinstance(file.unit, UnsetType) else file.unit
    if not (file.shapes or file.assets):
        raise location.error(
            "has no shapes, but a picture needs at least one.", 'Add a [[shapes]] table, e.g. type = "sphere".'
        )
    heights = {
        shape.displacement.texture
        for shape in file.shapes
        if isinstance(shape, description.Patches) and not isinstance(shape.displacement, UnsetType)
    }
    of_file = materials.textures(file.textures, file.materials, location.field("textures"), folder, heights)
    texture_number = {texture.name: index for index, texture in enumerate(of_file)}
    surfaces = list(materials.materials(_with_default(file, supplied), texture_number, location.field("materials")))
    number = {material.name: index for index, material in enumerate(surfaces)}
    unique = {id(material): material for material in supplied.materials.values()}
    supplied_number = {each: len(surfaces) + index for index, each in enumerate(unique)}
    surfaces += [moved_textures(material, len(of_file)) for material in unique.values()]
    textures = (*of_file, *supplied.textures)

    shapes = []
    known: dict[tuple[object, bool, bool], Mesh] = {}
    patch_triangles = 0
    for index, given in enumerate(file.shapes):
        check_time()
        here = location.field("shapes").item(index)
        kind = str(given.__struct_config__.tag)
        shape_name = f"{kind}-{index}" if isinstance(given.name, UnsetType) else given.name
        if index in supplied.materials:
            material = supplied_number[id(supplied.materials[index])]
        elif given.material in number:
            material = number[given.material]
        else:
            raise unknown(
                "material", given.material, list(number), here.field("material"), "reflectance = [r, g, b]"
            )
        geometry: Mesh | Stream | Literal["sphere", "plane"]
        subdivisions = 4
        match given:
            case description.Sphere():
                geometry, matrix, subdivisions = "sphere", _sphere(given, here), given.subdivisions
            case description.Plane():
                geometry, matrix = "plane", _plane(given, here)
            case description.Stream():
                matrix = IDENTITY
                geometry = _stream(given, here, folder, surfaces[material], meshes.get(index))
            case description.Patches(streamed=True):
                surface = patch_surface(given, here, camera, _world(given, here)[:3], of_file)
                matrix = IDENTITY
                geometry = _stream(given, here, folder, surfaces[material], surface)
            case description.Patches():
                matrix = _world(given, here)[:3]
                surface = patch_surface(given, here, camera, matrix, of_file)
                patch_triangles += surface.triangle_count
                mesh = surface.mesh(patch_triangles)
                geometry = _finished(mesh, False, given.flip_normals != transform.mirrors(matrix))
                _check_extent(placed(geometry.vertices, matrix), here)
                geometry = with_area(geometry, matrix, shape_name, here)
            case _:
                matrix = _world(given, here)[:3]
                textured = surfaces[material].needs_uv
                geometry = _mesh(
                    given, here, folder, textured, transform.mirrors(matrix), _mesh_of(meshes.get(index)), known
                )
                _check_extent(placed(geometry.vertices, matrix), here)
                geometry = with_area(geometry, matrix, shape_name, here)
        moved = motion.motion_of(given.motion, matrix[None], here.field("motion"))
        shape = Shape(
            shape_name, geometry, material, matrix[None], subdivisions=subdivisions, kind=kind, motion=moved
        )
        if moved is not None:
            shape = replace(shape, world_from_object=shape.at(camera.shutter[0]).world_from_object)
        shapes.append(
            lights.emission(given.emission, here.field("emission"), scene_unit, shape, surfaces[material], textures)
        )

    # In practice, environment maps and glTF emission have no physical unit, so 1 counts as equally bright in both.
    beside_map = isinstance(file.unit, UnsetType) and (is_aside("sky") or _has_map(file))
    assets = Assets(folder, number, surfaces, list(textures), camera.shutter, scene_unit, beside_map)
    assets.add(file.assets, location.field("assets"))
    if isinstance(file.unit, UnsetType) and assets.photometric and _has_light_in_watts(file):
        how = "as radiance of the environment map" if beside_map else "as cd and cd m^-2, 179 lm for a watt"
        warn(
            f"{location}: light is in two units. The numbers of {assets.photometric} are taken {how}, those of the "
            'file itself as watts. Name the unit of one: unit = "photometric" at the top of the file, or unit in '
            "[[assets]]."
        )
    return Scene(
        name=name if isinstance(file.name, UnsetType) else file.name,
        camera=camera,
        shapes=Shapes([*shapes, *assets.shapes]),
        materials=tuple(assets.materials),
        source=location.source,
        textures=tuple(assets.textures),
        lights=(
            *lights.lights(file.lights, location.field("lights"), folder, camera.up, scene_unit),
            *assets.lights,
        ),
        ambient=light(file.ambient, location.field("ambient")),
        sky=lights.sky(file.sky, camera.up, location.field("sky"), folder, scene_unit),
        exposure=None if isinstance(file.film.exposure, UnsetType) else float(file.film.exposure),
        unit=scene_unit,
        portals=lights.portals(file.sky, location.field("sky")),
        animation_times=camera.shutter if assets.animated else None,
    )


def _has_map(file: SceneFile) -> bool:
    """Return True if the sky is an environment map without a unit."""
    return (
        not isinstance(file.sky, UnsetType)
        and not isinstance(file.sky.file, UnsetType)
        and isinstance(file.sky.unit, UnsetType)
    )


def _has_light_in_watts(file: SceneFile) -> bool:
    """Return True if the file itself has a light or emission that names neither a unit nor a profile."""
    emissions = [shape.emission for shape in file.shapes if not isinstance(shape.emission, UnsetType)]
    lamps = [each for each in file.lights if isinstance(getattr(each, "profile", UNSET), UnsetType)]
    return any(isinstance(each.unit, UnsetType) for each in (*emissions, *lamps))


def _camera(file: SceneFile) -> Camera:
    given = file.camera
    camera = Camera(
        position=np.array(given.position, np.float64),
        target=np.array(given.target, np.float64),
        up=np.array(given.up, np.float64),
        fov=_FOV,
        resolution=file.film.resolution,
        shutter=given.shutter,
        motion=motion.camera_keys(given),
    )
    if isinstance(given, description.Panorama):
        return replace(camera, projection="panorama")
    camera = replace(camera, principal_point=given.principal_point, pixel_aspect=given.pixel_aspect)
    if isinstance(given, description.Orthographic):
        return replace(camera, projection="orthographic", height=given.height)
    focus = None if isinstance(given.focus_distance, UnsetType) else given.focus_distance
    return replace(camera, fov=float(given.fov), aperture_radius=given.aperture_radius, focus_distance=focus)


def _with_default(file: SceneFile, supplied: Supplied) -> dict[str, AnyMaterial]:
    """Return the file's materials, plus the grey default if a shape uses it and the file does not define it."""
    given = dict(file.materials)
    named = {shape.material for index, shape in enumerate(file.shapes) if index not in supplied.materials}
    if DEFAULT_MATERIAL in named:
        given.setdefault(DEFAULT_MATERIAL, description.Diffuse())
    return given


def _world(given: AnyShape, location: SourceLocation) -> Float64:
    """Return the (4, 4) matrix world_from_shape."""
    return transform.world_from_shape(given.transform, location.field("transform"))


def _sphere(given: description.Sphere, location: SourceLocation) -> Float64:
    """Return the (3, 4) matrix world_from_unit_sphere; its determinant is negative if the front faces inwards."""
    unit_to_shape = np.column_stack([given.radius * np.identity(3), given.center])
    matrix = unit_to_shape
    if given.transform:
        world = _world(given, location)
        matrix = world[:3, :3] @ unit_to_shape
        matrix[:, 3] += world[:3, 3]
    _check_extent(np.abs(matrix[:, 3]) + np.linalg.norm(matrix[:, :3], axis=1), location)
    thinnest = np.linalg.svd(matrix[:, :3], compute_uv=False)[2]
    if not thinnest >= SMALLEST:
        raise location.error(
            f"is only {thinnest:.3g} scene units thick, where 32 bit numbers end ({SMALLEST:g}).",
            "Check its radius and transform, or choose a smaller unit of length.",
        )
    return turned(matrix) if transform.mirrors(matrix) != given.flip_normals else matrix


def _plane(given: description.Plane, location: SourceLocation) -> Float64:
    """Return the (3, 4) matrix world_from_plane.

    Its columns are u, v, the normal and a point of the plane. u, v and the normal are right-handed, so that
    textures are not mirrored on the front.
    """
    normal = unit(given.normal, location.field("normal"), "normal = [0, 1, 0]")
    if isinstance(given.u, UnsetType):
        along = np.array([0.0, 1.0, 0.0] if abs(normal[0]) > 0.9 else [1.0, 0.0, 0.0])
        along = along - (along @ normal) * normal
        along /= np.linalg.norm(along)
    else:
        along = np.array(given.u, np.float64)
        length = np.linalg.norm(along)
        along = along - (along @ normal) * normal
        if not np.linalg.norm(along) > 1e-6 * length:
            raise location.field("u").wrong(
                given.u,
                f"a direction in the plane, not along its normal {shown(given.normal)}",
                "It is the direction in which the texture coordinate u grows.",
            )
    across = np.cross(normal, along)
    front = -normal if given.flip_normals else normal
    frame = moved_plane(np.column_stack([along, across, front, given.point]), _world(given, location)[:3])
    _check_extent(np.abs(frame[:, 3]), location)
    return frame


def _stream(
    given: description.Stream | description.Patches,
    location: SourceLocation,
    folder: Path,
    material: Material,
    ready: Mesh | Chunks | None,
) -> Stream:
    if not isinstance(given.emission, UnsetType):
        raise location.field("emission").error(
            "makes a stream a light, but light samples are drawn from triangles in memory.",
            "Make the parts that shine a mesh, or several.",
        )
    if material.needs_uv or material.lets_light_through:
        raise location.field("material").error(
            f'names "{material.name}", which has textures or an anisotropy, or lets light through; a stream\'s '
            "triangles have no texture coordinates.",
            "Give it a plain, opaque material.",
        )
    file = UNSET if isinstance(given, description.Patches) else given.file
    if ready is None and isinstance(file, UnsetType):
        raise location.error("lacks the field `file`, which must be there.", 'For example: file = "terrain.npy".')
    if ready is not None and not isinstance(file, UnsetType):
        raise location.error("has stream and file, but a stream is one of them.", "Leave one away.")
    chunks = NpyTriangles.open(folder / str(file), location.field("file")) if ready is None else ready
    matrix = _world(given, location)[:3]
    return stream_of(chunks, matrix, given.flip_normals != transform.mirrors(matrix), location)  # type: ignore[arg-type]


def _mesh_of(ready: Mesh | Chunks | None) -> Mesh | None:
    assert ready is None or isinstance(ready, Mesh), "a stream is a shape of its own type"
    return ready


def _mesh(
    given: description.Quad | description.Box | description.Mesh,
    location: SourceLocation,
    folder: Path,
    textured: bool,
    mirrored: bool,
    ready: Mesh | None,
    known: dict[tuple[object, bool, bool], Mesh],
) -> Mesh:
    """Return the mesh of a shape in object space.

    textured : True if the material needs texture coordinates; missing ones are then added by projection
    mirrored : True if the transform swaps fronts and backs
    ready    : mesh that is already in memory, or None
    known    : cache of meshes, so that shapes of one file share one mesh. A key is the path or the mesh object,
               `textured`, and True if the winding is flipped. The path as text stands for the mesh as read
    """
    reverse = given.flip_normals != mirrored
    match given:
        case description.Quad():
            _check_quad(np.array(given.corners), location.field("corners"))
            mesh = tessellate.quad_mesh(given.corners)
        case description.Box():
            mesh = tessellate.box_mesh(*_box_corners(given, location))
        case description.Mesh() if ready is not None:
            if (ready, textured, reverse) not in known:
                known[ready, textured, reverse] = _finished(ready, textured, reverse)
            return known[ready, textured, reverse]
        case description.Mesh(file=str(name)) if _only_a_file(given):
            path = folder / name
            if (str(path), False, False) not in known:  # read only once, so that warnings are given only once
                known[str(path), False, False] = read_mesh(path, location.field("file")).without_unused_vertices()
            if (path, textured, reverse) not in known:
                mesh = known[str(path), False, False]
                if textured and has_uv_gaps(mesh):
                    warn(f"{path}: not used: {UV_GAPS}")
                known[path, textured, reverse] = _finished(without_uv_gaps(mesh), textured, reverse)
            return known[path, textured, reverse]
        case _:
            mesh = _inline_mesh(given, location)
    return _finished(mesh, textured, reverse)


def _finished(mesh: Mesh, textured: bool, reverse: bool) -> Mesh:
    mesh = mesh.without_unused_vertices()
    if textured and mesh.uv is None:
        mesh = tessellate.with_projected_uv(mesh)
    return mesh.turned() if reverse else mesh


def _check_extent(coordinates: Float64, location: SourceLocation) -> None:
    if not np.all(np.abs(coordinates) <= LARGEST):
        raise location.error(
            f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
            "Check its transform and coordinates, or choose a larger unit of length.",
        )


def _check_quad(corners: Float64, location: SourceLocation) -> None:
    """Raise SceneError unless the quad of `corners` (4, 3) is planar and convex."""
    edges = np.roll(corners, -1, axis=0) - corners
    diameter = max(np.linalg.norm(corners[2] - corners[0]), np.linalg.norm(corners[3] - corners[1]))
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    if not np.linalg.norm(normal) > FLAT * diameter**2:
        raise location.error(
            "has no area: its corners lie on a line, coincide, or are listed crosswise.",
            "List four corners around the outline.",
        )
    normal /= np.linalg.norm(normal)
    # The diagonals lie in two planes perpendicular to the normal; `height` is the distance between these planes.
    height = abs(normal @ (corners[1] - corners[0]))
    if height > _PLANAR * diameter:
        raise location.error(
            f"is not planar: its diagonals pass each other at a distance of {height:.3g}.",
            "Mend a corner, or write two triangles as a mesh: vertices = [...], faces = [[0, 1, 2, 3]].",
        )
    turns = np.cross(np.roll(edges, 1, axis=0), edges) @ normal
    bad = np.flatnonzero(turns <= FLAT * diameter**2)
    if len(bad):
        raise location.error(
            f"is not convex: the outline does not turn in the same sense at corner {bad[0]} as at the others.",
            "List the corners around the outline, not crosswise; split an outline with a dent into several shapes.",
        )


def _box_corners(given: description.Box, location: SourceLocation) -> tuple[Float64, Float64]:
    fields = {"min": given.min, "max": given.max, "center": given.center, "size": given.size}
    pairs = {name: value for name, value in fields.items() if not isinstance(value, UnsetType)}
    if set(pairs) == {"min", "max"}:
        lower, upper = np.array(pairs["min"]), np.array(pairs["max"])
        for axis in range(3):
            if not lower[axis] < upper[axis]:
                raise (
                    location.field("min")
                    .item(axis)
                    .wrong(
                        lower[axis],
                        f"below max[{axis}], which is {upper[axis]:g}",
                        "Exchange min and max on this axis.",
                    )
                )
        return lower, upper
    if set(pairs) == {"center", "size"}:
        center, size = np.array(pairs["center"]), np.array(pairs["size"])
        for axis in range(3):
            if not size[axis] > 0:
                raise (
                    location.field("size").item(axis).wrong(size[axis], "above 0", "For a flat shape take a quad.")
                )
        return center - size / 2, center + size / 2
    raise location.error(
        f"has {', '.join(pairs) or 'no corners'}, but a box is `min` and `max`, or `center` and `size`.",
        "For example: min = [0, 0, 0], max = [1, 2, 1].",
    )


def _only_a_file(given: description.Mesh) -> bool:
    return all(isinstance(each, UnsetType) for each in (given.vertices, given.faces, given.uv))


def _inline_mesh(given: description.Mesh, location: SourceLocation) -> Mesh:
    if isinstance(given.file, UnsetType) and not (
        isinstance(given.vertices, UnsetType) or isinstance(given.faces, UnsetType)
    ):
        mesh = inline_mesh(given.vertices, given.faces, location)
        return mesh if isinstance(given.uv, UnsetType) else replace(mesh, uv=_inline_uv(given.uv, mesh, location))
    fields = ("vertices", "faces", "uv", "file")
    names = [name for name in fields if not isinstance(getattr(given, name), UnsetType)]
    raise location.error(
        f"has {' and '.join(names) or 'no geometry'}, but a mesh is `vertices` and `faces`, or `file`.",
        'For example: file = "bunny.obj".',
    )


def _inline_uv(given: list[tuple[float, float]], mesh: Mesh, location: SourceLocation) -> Float64:
    if len(given) != len(mesh.vertices):
        raise location.field("uv").error(
            f"has {len(given)} pairs, but the mesh has {len(mesh.vertices)} vertices.",
            "List one pair [u, v] for each vertex, in the same order.",
        )
    return np.array(given, np.float64)
