"""From the typed data of a scene file to the `Scene`: shapes become triangles, names become indices.

What the types cannot say is checked here, each with the place: materials that do not exist, quads that are not
planar, boxes turned inside out, triangles without area.
"""

from __future__ import annotations

import difflib
import warnings
from pathlib import Path

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray

from glpath.errors import SceneError, SceneWarning
from glpath.scene import description, tessellate, transform
from glpath.scene.check import check_camera
from glpath.scene.description import AnyShape, Emission, SceneFile
from glpath.scene.meshes import inline_mesh, read_mesh
from glpath.scene.model import Camera, Float64, Material, Scene, Shape
from glpath.scene.place import Place, shown
from glpath.scene.tessellate import Int64

# Of a quad's diameter; more than the rounding of coordinates written with three digits.
_PLANAR = 1e-3
# Height over longest edge below which a triangle has no area: corners are 32 bit numbers on the GPU.
_FLAT = 1e-7
# What a GPU can still square in 32 bits without overflow, and far from what anybody means.
LARGEST = 1e15

DEFAULT_MATERIAL = "default"


def build(file: SceneFile, place: Place, folder: Path, name: str) -> Scene:
    """The scene that `file` describes. Raises SceneError; warns with SceneWarning of triangles without area.

    folder : where relative paths of mesh files start
    name   : the name of the scene when the file does not say one
    """
    camera = _camera(file)
    check_camera(camera, place.source)
    if not file.shapes:
        raise place.error(
            "has no shapes, but a picture needs at least one.", 'Add a [[shapes]] table, e.g. type = "sphere".'
        )
    materials = _materials(file, place.field("materials"))
    number = {material.name: index for index, material in enumerate(materials)}

    shapes, triangles, first = [], [], 0
    for index, given in enumerate(file.shapes):
        here = place.field("shapes").item(index)
        kind = str(given.__struct_config__.tag)
        shape_name = f"{kind}-{index}" if isinstance(given.name, UnsetType) else given.name
        if given.material not in number:
            raise _no_such_material(given.material, list(number), here.field("material"))
        radiance, two_sided = _emission(given.emission, here.field("emission"))
        corners = _with_area(_triangles(given, here, folder), shape_name, here)
        triangles.append(corners)
        shapes.append(Shape(shape_name, kind, first, len(corners), number[given.material], radiance, two_sided))
        first += len(corners)

    return Scene(
        name=name if isinstance(file.name, UnsetType) else file.name,
        camera=camera,
        triangles=np.ascontiguousarray(np.concatenate(triangles)),
        shapes=tuple(shapes),
        materials=tuple(materials),
        source=place.source,
    )


def _camera(file: SceneFile) -> Camera:
    given = file.camera
    return Camera(
        position=np.array(given.position, np.float64),
        target=np.array(given.target, np.float64),
        up=np.array(given.up, np.float64),
        fov=float(given.fov),
        resolution=file.film.resolution,
    )


def _materials(file: SceneFile, place: Place) -> list[Material]:
    """Those of the file, and the grey default where a shape uses it and the file does not define it."""
    given = dict(file.materials)
    if any(shape.material == DEFAULT_MATERIAL for shape in file.shapes):
        given.setdefault(DEFAULT_MATERIAL, description.Material())
    materials = []
    for name, material in given.items():
        reflectance = _rgb(material.reflectance)
        if np.any((reflectance < 0) | (reflectance > 1)):
            raise (
                place.field(name)
                .field("reflectance")
                .wrong(
                    material.reflectance,
                    "between 0 and 1",
                    "A surface reflects at most what it receives; 0.8 is a white wall. Light is an emission.",
                )
            )
        materials.append(Material(name, reflectance, material.two_sided))
    return materials


def _no_such_material(name: str, known: list[str], place: Place) -> SceneError:
    near = difflib.get_close_matches(name, known, 1)
    listed = ", ".join(known) or "no materials"
    return place.error(
        f"names the material {shown(name)}, but the file defines {listed}.",
        f'Did you mean "{near[0]}"?' if near else f"Define it: [materials.{name}] with reflectance = [r, g, b].",
    )


def _emission(given: Emission | UnsetType, place: Place) -> tuple[Float64, bool]:
    if isinstance(given, UnsetType):
        return np.zeros(3), False
    radiance = _rgb(given.radiance)
    if np.any(radiance < 0):
        raise place.field("radiance").wrong(given.radiance, "0 or more", "Light cannot be negative.")
    return radiance, given.two_sided


def _rgb(value: float | description.Vector) -> Float64:
    return np.array(np.broadcast_to(np.asarray(value, np.float64), 3))


def _triangles(given: AnyShape, place: Place, folder: Path) -> Float64:
    """(T, 3, 3) float64 in world space, with those without area."""
    match given:
        case description.Quad():
            _check_quad(np.array(given.corners), place.field("corners"))
            vertices, faces = tessellate.quad(given.corners)
        case description.Box():
            vertices, faces = tessellate.box(*_box_corners(given, place))
        case description.Sphere():
            vertices, faces = tessellate.sphere(given.center, given.radius, given.subdivisions)
        case description.Mesh():
            vertices, faces = _mesh(given, place, folder)
    corners = vertices[faces]
    if given.transform:
        matrix = transform.world_from_shape(given.transform, place.field("transform"))
        corners = transform.apply(matrix, corners)
    if not np.all(np.abs(corners) <= LARGEST):
        raise place.error(
            f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
            "Check its transform and coordinates, or choose a larger unit of length.",
        )
    return corners[:, ::-1] if given.flip_normals else corners


def _check_quad(corners: Float64, place: Place) -> None:
    """corners: (4, 3). Raises SceneError for one that is not planar or not convex."""
    edges = np.roll(corners, -1, axis=0) - corners
    diameter = max(np.linalg.norm(corners[2] - corners[0]), np.linalg.norm(corners[3] - corners[1]))
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    if not np.linalg.norm(normal) > _FLAT * diameter**2:
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
    bad = np.flatnonzero(turns <= _FLAT * diameter**2)
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


def _mesh(given: description.Mesh, place: Place, folder: Path) -> tuple[Float64, Int64]:
    inline = not isinstance(given.vertices, UnsetType) and not isinstance(given.faces, UnsetType)
    partly = not isinstance(given.vertices, UnsetType) or not isinstance(given.faces, UnsetType)
    if not isinstance(given.file, UnsetType) and not partly:
        return read_mesh(folder / given.file, place.field("file"))
    if isinstance(given.file, UnsetType) and inline:
        assert not isinstance(given.vertices, UnsetType)
        assert not isinstance(given.faces, UnsetType)
        return inline_mesh(given.vertices, given.faces, place)
    names = [name for name in ("vertices", "faces", "file") if not isinstance(getattr(given, name), UnsetType)]
    raise place.error(
        f"has {' and '.join(names) or 'no geometry'}, but a mesh is `vertices` and `faces`, or `file`.",
        'For example: file = "bunny.obj".',
    )


def _with_area(corners: Float64, name: str, place: Place) -> Float64:
    """`corners` (T, 3, 3) without the triangles that have no area, which a SceneWarning counts."""
    flat = _without_area(corners)
    if not flat.any():
        return corners
    if flat.all():
        raise place.error(
            f'("{name}") has {len(flat)} triangles, none of which has an area.',
            "The corners of each coincide or lie on one line: check the coordinates and the transform.",
        )
    listed = np.flatnonzero(flat)
    warnings.warn(
        SceneWarning(
            f'{place} ("{name}"): dropped {len(listed)} of {len(flat)} triangles, which have no area: '
            f"{', '.join(str(i) for i in listed[:8])}{', ...' if len(listed) > 8 else ''} (counted from 0)."
        ),
        stacklevel=2,
    )
    return corners[~flat]


def _without_area(corners: Float64) -> NDArray[np.bool_]:
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= _FLAT * longest**2)
