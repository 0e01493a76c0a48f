"""From the typed data of a scene file to the `Scene`: shapes become primitives, names become indices.

What the types cannot say is checked here, each with the place: materials that do not exist, quads that are not
planar, boxes turned inside out, triangles without area.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from msgspec import UnsetType

from glpath.scene import description, lights, materials, tessellate, transform
from glpath.scene.check import check_camera
from glpath.scene.description import AnyMaterial, AnyShape, SceneFile
from glpath.scene.meshes import inline_mesh, read_mesh
from glpath.scene.model import Camera, Float64, Primitive, Scene, Shape
from glpath.scene.place import Place, shown
from glpath.scene.tessellate import FLAT, Geometry, with_area
from glpath.scene.triangulate import turned
from glpath.scene.values import light, unit, unknown

# Of a quad's diameter; more than the rounding of coordinates written with three digits.
_PLANAR = 1e-3
# What a GPU can still square in 32 bits without overflow, and far from what anybody means.
LARGEST = 1e15
# And without underflow.
SMALLEST = 1e-15

DEFAULT_MATERIAL = "default"


def build(file: SceneFile, place: Place, folder: Path, name: str) -> Scene:
    """The scene that `file` describes. Raises SceneError; warns with SceneWarning of triangles without area.

    folder : where relative paths of mesh and picture files start
    name   : the name of the scene when the file does not say one
    """
    camera = _camera(file)
    check_camera(camera, place.source)
    if not file.shapes:
        raise place.error(
            "has no shapes, but a picture needs at least one.", 'Add a [[shapes]] table, e.g. type = "sphere".'
        )
    textures = materials.textures(file.textures, place.field("textures"), folder)
    texture_number = {texture.name: index for index, texture in enumerate(textures)}
    surfaces = materials.materials(_with_default(file), texture_number, place.field("materials"))
    number = {material.name: index for index, material in enumerate(surfaces)}

    shapes = []
    parts: dict[Primitive, list[Float64]] = {"triangle": [], "sphere": [], "plane": []}
    texture_places: list[Float64] = []
    count: dict[Primitive, int] = dict.fromkeys(parts, 0)
    for index, given in enumerate(file.shapes):
        here = place.field("shapes").item(index)
        kind = str(given.__struct_config__.tag)
        shape_name = f"{kind}-{index}" if isinstance(given.name, UnsetType) else given.name
        if given.material not in number:
            raise unknown(
                "material", given.material, list(number), here.field("material"), "reflectance = [r, g, b]"
            )
        radiance, two_sided = lights.emission(given.emission, here.field("emission"))
        shape = Shape(shape_name, kind, 0, 1, number[given.material], radiance, two_sided)
        primitives = parts[shape.primitive]
        if isinstance(given, description.Sphere):
            shape = replace(shape, subdivisions=given.subdivisions)
            primitives.append(_sphere(given, here)[None])
        elif isinstance(given, description.Plane):
            primitives.append(_plane(given, here)[None])
        else:
            corners, uv = with_area(*_triangles(given, here, folder), shape_name, here)
            primitives.append(corners)
            texture_places.append(uv)
        shapes.append(replace(shape, first=count[shape.primitive], count=len(primitives[-1])))
        count[shape.primitive] += len(primitives[-1])

    return Scene(
        name=name if isinstance(file.name, UnsetType) else file.name,
        camera=camera,
        triangles=_joined(parts["triangle"], (3, 3)),
        shapes=tuple(shapes),
        materials=surfaces,
        source=place.source,
        triangle_uv=_joined(texture_places, (3, 2)),
        spheres=_joined(parts["sphere"], (3, 4)),
        planes=_joined(parts["plane"], (3, 4)),
        textures=textures,
        lights=lights.lights(file.lights, place.field("lights")),
        ambient=light(file.ambient, place.field("ambient")),
        sky=lights.sky(file.sky, camera.up, place.field("sky")),
    )


def _joined(parts: list[Float64], shape: tuple[int, int]) -> Float64:
    return np.ascontiguousarray(np.concatenate([np.zeros((0, *shape)), *parts]))


def _camera(file: SceneFile) -> Camera:
    given = file.camera
    return Camera(
        position=np.array(given.position, np.float64),
        target=np.array(given.target, np.float64),
        up=np.array(given.up, np.float64),
        fov=float(given.fov),
        resolution=file.film.resolution,
    )


def _with_default(file: SceneFile) -> dict[str, AnyMaterial]:
    """The file's materials, and the grey default where a shape uses it and the file does not define it."""
    given = dict(file.materials)
    if any(shape.material == DEFAULT_MATERIAL for shape in file.shapes):
        given.setdefault(DEFAULT_MATERIAL, description.Diffuse())
    return given


def _world(given: AnyShape, place: Place) -> Float64:
    """(4, 4): world_from_shape."""
    return transform.world_from_shape(given.transform, place.field("transform"))


def _sphere(given: description.Sphere, place: Place) -> Float64:
    """(3, 4) world_from_unit, its determinant negative where the front is inside."""
    unit_to_shape = np.column_stack([given.radius * np.identity(3), given.center])
    matrix = unit_to_shape
    if given.transform:
        world = _world(given, place)
        matrix = world[:3, :3] @ unit_to_shape
        matrix[:, 3] += world[:3, 3]
    _check_extent(np.abs(matrix[:, 3]) + np.linalg.norm(matrix[:, :3], axis=1), place)
    thinnest = np.linalg.svd(matrix[:, :3], compute_uv=False)[2]
    if not thinnest >= SMALLEST:
        raise place.error(
            f"is only {thinnest:.3g} scene units thick, where 32 bit numbers end ({SMALLEST:g}).",
            "Check its radius and transform, or choose a smaller unit of length.",
        )
    return turned(matrix) if transform.mirrors(matrix) != given.flip_normals else matrix


def _plane(given: description.Plane, place: Place) -> Float64:
    """(3, 4) world_from_plane; u, v and the normal are right-handed, so that textures read well from the front."""
    normal = unit(given.normal, place.field("normal"), "normal = [0, 1, 0]")
    if isinstance(given.u, UnsetType):
        along = np.array([0.0, 1.0, 0.0] if abs(normal[0]) > 0.9 else [1.0, 0.0, 0.0])
        along = along - (along @ normal) * normal
        along /= np.linalg.norm(along)
    else:
        along = np.array(given.u, np.float64)
        length = np.linalg.norm(along)
        along = along - (along @ normal) * normal
        if not np.linalg.norm(along) > 1e-6 * length:
            raise place.field("u").wrong(
                given.u,
                f"a direction in the plane, not along its normal {shown(given.normal)}",
                "It is the way in which the texture coordinate u grows.",
            )
    across = np.cross(normal, along)
    world = _world(given, place)
    linear = world[:3, :3]
    point = linear @ given.point + world[:3, 3]
    _check_extent(np.abs(point), place)
    normal = np.linalg.inv(linear).T @ normal
    normal /= np.linalg.norm(normal)
    u, v = linear @ along, linear @ across
    u -= (u @ normal) * normal  # rounding
    v_length = np.linalg.norm(v - (v @ u) / (u @ u) * u)
    if given.flip_normals:
        normal = -normal
    v = v_length * np.cross(normal, u / np.linalg.norm(u))
    return np.column_stack([u, v, normal, point])


def _triangles(
    given: description.Quad | description.Box | description.Mesh, place: Place, folder: Path
) -> Geometry:
    """Corners (T, 3, 3) in world space and texture coordinates (T, 3, 2), with those triangles without area."""
    uv = None
    match given:
        case description.Quad():
            _check_quad(np.array(given.corners), place.field("corners"))
            vertices, faces = tessellate.quad(given.corners)
            uv = tessellate.quad_uv()
        case description.Box():
            vertices, faces = tessellate.box(*_box_corners(given, place))
            uv = tessellate.box_uv()
        case description.Mesh():
            vertices, faces, vertex_uv = _mesh(given, place, folder)
            uv = None if vertex_uv is None else vertex_uv[faces]
    corners = vertices[faces]
    if uv is None:
        uv = tessellate.projected_uv(corners)
    reverse = given.flip_normals
    if given.transform:
        matrix = _world(given, place)
        corners = transform.apply(matrix, corners)
        reverse ^= transform.mirrors(matrix)
    _check_extent(corners, place)
    return (corners[:, ::-1], uv[:, ::-1]) if reverse else (corners, uv)


def _check_extent(coordinates: Float64, place: Place) -> None:
    if not np.all(np.abs(coordinates) <= LARGEST):
        raise place.error(
            f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
            "Check its transform and coordinates, or choose a larger unit of length.",
        )


def _check_quad(corners: Float64, place: Place) -> None:
    """corners: (4, 3). Raises SceneError for one that is not planar or not convex."""
    edges = np.roll(corners, -1, axis=0) - corners
    diameter = max(np.linalg.norm(corners[2] - corners[0]), np.linalg.norm(corners[3] - corners[1]))
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    if not np.linalg.norm(normal) > FLAT * diameter**2:
        raise place.error(
            "has no area: its corners lie on a line, coincide, or are listed crosswise.",
            "List four corners around the outline.",
        )
    normal /= np.linalg.norm(normal)
    # The normal is perpendicular to both diagonals, so the two diagonals lie in parallel planes.
    height = abs(normal @ (corners[1] - corners[0]))
    if height > _PLANAR * diameter:
        raise place.error(
            f"is not planar: its diagonals pass each other at a distance of {height:.3g}.",
            "Mend a corner, or write two triangles as a mesh: vertices = [...], faces = [[0, 1, 2, 3]].",
        )
    turns = np.cross(np.roll(edges, 1, axis=0), edges) @ normal
    bad = np.flatnonzero(turns <= FLAT * diameter**2)
    if len(bad):
        raise place.error(
            f"is not convex: the outline does not turn the same way at corner {bad[0]} as at the others.",
            "List the corners around the outline, not crosswise; split an outline with a dent into several shapes.",
        )


def _box_corners(given: description.Box, place: Place) -> tuple[Float64, Float64]:
    fields = {"min": given.min, "max": given.max, "center": given.center, "size": given.size}
    pairs = {name: value for name, value in fields.items() if not isinstance(value, UnsetType)}
    if set(pairs) == {"min", "max"}:
        lower, upper = np.array(pairs["min"]), np.array(pairs["max"])
        for axis in range(3):
            if not lower[axis] < upper[axis]:
                raise (
                    place.field("min")
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
                raise place.field("size").item(axis).wrong(size[axis], "above 0", "For a flat shape take a quad.")
        return center - size / 2, center + size / 2
    raise place.error(
        f"has {', '.join(pairs) or 'no corners'}, but a box is `min` and `max`, or `center` and `size`.",
        "For example: min = [0, 0, 0], max = [1, 2, 1].",
    )


def _mesh(given: description.Mesh, place: Place, folder: Path) -> tuple[Float64, tessellate.Int64, Float64 | None]:
    """Vertices (V, 3), faces (F, 3), and texture coordinates (V, 2) where there are any."""
    inline = not isinstance(given.vertices, UnsetType) and not isinstance(given.faces, UnsetType)
    partly = any(not isinstance(each, UnsetType) for each in (given.vertices, given.faces, given.uv))
    if not isinstance(given.file, UnsetType) and not partly:
        return read_mesh(folder / given.file, place.field("file"))
    if isinstance(given.file, UnsetType) and inline:
        assert not isinstance(given.vertices, UnsetType)
        assert not isinstance(given.faces, UnsetType)
        return *inline_mesh(given.vertices, given.faces, place), _inline_uv(given, place)
    fields = ("vertices", "faces", "uv", "file")
    names = [name for name in fields if not isinstance(getattr(given, name), UnsetType)]
    raise place.error(
        f"has {' and '.join(names) or 'no geometry'}, but a mesh is `vertices` and `faces`, or `file`.",
        'For example: file = "bunny.obj".',
    )


def _inline_uv(given: description.Mesh, place: Place) -> Float64 | None:
    if isinstance(given.uv, UnsetType):
        return None
    assert not isinstance(given.vertices, UnsetType)
    if len(given.uv) != len(given.vertices):
        raise place.field("uv").error(
            f"has {len(given.uv)} pairs, but the mesh has {len(given.vertices)} vertices.",
            "List one pair [u, v] for each vertex, in the same order.",
        )
    return np.array(given.uv, np.float64)
