"""Scalable scene: any number of equal objects, stacked until they fill the image [TB V.A, figure 12].

The more objects there are, the smaller they are, so that any number covers about the same fraction of the image.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from glpath.scene.model import Camera, Float64, Light, Material, Mesh, Scene, Shape, Shapes, Sky

Int64 = NDArray[np.int64]

_FOV = 40.0
# Distance of the camera from the plane z = 0 of the objects. At this distance, half the height of the view is 1.
_DISTANCE = 1 / np.tan(np.radians(_FOV) / 2)
_LIGHT = np.array([1.6, 3.0, 3.2])
_COLOURS = {
    "red": (0.75, 0.16, 0.12),
    "orange": (0.80, 0.42, 0.10),
    "yellow": (0.80, 0.68, 0.18),
    "green": (0.25, 0.60, 0.22),
    "teal": (0.12, 0.52, 0.55),
    "blue": (0.16, 0.28, 0.70),
    "violet": (0.48, 0.20, 0.60),
}
# Maximum number of objects for which each is a shape of its own. Making a million names and ranges would take
# longer than the rest of the scene.
_MAX_SHAPES = 10_000
# Lean of the triangles in degrees, alternately forwards and backwards; in one plane they would cast no shadows on
# each other.
_LEAN = 20.0
# Size of the triangles relative to their cells, so that no two triangles share an edge.
_INSET = 0.94
_ROW = np.sqrt(3)


def stacked(
    *,
    objects: Annotated[int, Meta(ge=1, le=1_000_000, description="a whole number from 1 to 1000000")] = 100,
    kind: Annotated[Literal["sphere", "triangle"], Meta(description="sphere or triangle")] = "sphere",
    ground: Annotated[bool, Meta(description="true or false, whether they stand on an infinite plane")] = False,
    resolution: Annotated[
        int, Meta(ge=1, le=8192, description="a whole number from 1 to 8192, the height in pixels")
    ] = 512,
    aspect: Annotated[
        float, Meta(ge=0.25, le=4, description="a number from 0.25 to 4, the width over the height")
    ] = 1.0,
) -> Scene:
    """Any number of spheres or triangles, stacked until they fill the picture.

    Spheres lie in the hollows of the row below; triangles form rows, alternately pointing up and down. Up to 10,000
    objects are separate shapes; more form seven shapes, one for each colour. The scene has a point light, ambient
    light and a sky. The ground, if present, is the first shape.
    """
    half_width = max(1, round(resolution * aspect)) / resolution
    if kind == "sphere":
        positions = _pile_of_spheres(objects, half_width)
        # Face of the bounding box nearest to the camera, which appears largest.
        front = np.array([positions.min(axis=0) - [1, 1, -1], positions.max(axis=0) + 1])
        middle, radius = _fit(front, half_width)
        centres = radius * (positions - middle)
        spheres = np.zeros((objects, 3, 4))
        spheres[:, range(3), range(3)] = radius
        spheres[:, :, 3] = centres
        shapes = _shapes(objects, "sphere", lambda part: {"geometry": "sphere", "world_from_object": spheres[part]})
        bottom = centres[:, 1].min() - radius
    else:
        triangles = _wall_of_triangles(objects, half_width)
        shapes = _shapes(objects, "triangle", lambda part: {"geometry": Mesh.of_triangles(triangles[part])})
        bottom = triangles[:, :, 1].min()
    materials = [
        Material(name, np.array(colour), specular=np.full(3, 0.3), exponent=40.0)
        for name, colour in _COLOURS.items()
    ]
    if ground:
        plane = np.array([[[1.0, 0, 0, 0], [0, 0, 1, bottom], [0, -1, 0, 0]]])
        shapes.insert(0, Shape("ground", "plane", len(materials), plane))
        materials.append(Material("ground", np.full(3, 0.6)))
    return Scene(
        name="stacked",
        camera=Camera(
            np.array([0.0, 0.0, _DISTANCE]),
            np.zeros(3),
            np.array([0.0, 1.0, 0.0]),
            _FOV,
            (max(1, round(resolution * aspect)), resolution),
        ),
        shapes=Shapes(shapes),
        materials=tuple(materials),
        source="stacked",
        # With this intensity, a surface at the origin that faces the light has a radiance equal to its reflectance.
        lights=(Light("lamp", "point", np.full(3, np.pi * _LIGHT @ _LIGHT), position=_LIGHT.copy()),),
        ambient=np.full(3, 0.1),
        sky=Sky(np.array([0.25, 0.35, 0.55]), np.array([0.55, 0.65, 0.80])),
    )


def _shapes(objects: int, kind: str, geometry_of: Callable[[slice], dict[str, Any]]) -> list[Shape]:
    colours = len(_COLOURS)
    if objects <= _MAX_SHAPES:
        return [
            Shape(f"{kind}-{i}", material=i % colours, subdivisions=2, **geometry_of(slice(i, i + 1)))
            for i in range(objects)
        ]
    ends = np.linspace(0, objects, colours + 1).astype(int).tolist()
    return [
        Shape(f"{kind}s-{i}", material=i, subdivisions=2, **geometry_of(slice(first, last)))
        for i, (first, last) in enumerate(pairwise(ends))
    ]


def _pile_of_spheres(objects: int, half_width: float) -> Float64:
    """Return the (N, 3) centres of spheres of radius 1, from the bottom row up.

    The number of columns c is the one at which the spheres appear largest. Rows alternate between c and c - 1
    spheres. Each row lies in the hollows of the row below, sqrt(3) higher.
    """
    columns = np.arange(2, max(objects, 2) + 1)
    rows = _row_and_column(np.array(objects - 1), columns)[0] + 1
    extent = np.maximum(2 * columns / half_width, 2 + _ROW * (rows - 1))
    column_count = int(columns[np.argmin(extent)])
    if max(2 * objects, 2 / half_width) <= extent.min():  # a single column, for a tall image
        return np.stack([np.zeros(objects), 2.0 * np.arange(objects), np.zeros(objects)], axis=1)
    row, column = _row_and_column(np.arange(objects), column_count)
    in_row = np.bincount(row)
    positions = column_count - row % 2
    # The top row is centred, as far as the hollows allow.
    shift = (positions - in_row[row]) // 2
    return np.stack([2.0 * (column + shift) + row % 2, _ROW * row, np.zeros(objects)], axis=1)


def _row_and_column(number: Int64, columns: Int64 | int) -> tuple[Int64, Int64]:
    """Return the row and the column of an object, in rows of alternately `columns` and `columns` - 1."""
    pair, rest = np.divmod(number, 2 * np.asarray(columns) - 1)
    odd = rest >= columns
    return 2 * pair + odd, rest - odd * np.asarray(columns)


def _wall_of_triangles(objects: int, half_width: float) -> Float64:
    """Return the (N, 3, 3) corners of equilateral triangles, in rows from the bottom up, fronts to the camera.

    Each row is a strip of triangles that alternately point up and down. The number of columns is the one at which
    the triangles appear largest.
    """
    columns = np.arange(1, objects + 1)
    extent = np.maximum((columns + 1) / 2 / half_width, _ROW / 2 * -(-objects // columns))
    column_count = int(columns[np.argmin(extent)])
    row, column = np.divmod(np.arange(objects), column_count)
    up = np.where(column % 2 == 0, 1.0, -1.0)
    height = _ROW / 2
    # Corners around the centroid of a triangle that points up; a rotation by 180 degrees points it down.
    corners = _INSET * np.array([[-0.5, -height / 3], [0.5, -height / 3], [0, 2 * height / 3]])
    centre = np.stack([(column + 1) / 2, height * (row + 0.5 - up / 6), np.zeros(objects)], axis=1)
    lean = np.radians(_LEAN)
    y = up[:, None] * corners[:, 1]
    # The lean alternates along rows and columns. By index alone, vertical neighbours in rows of even length would
    # lean alike.
    sign = np.where((column + row) % 2 == 0, 1.0, -1.0)[:, None]
    x = up[:, None] * corners[:, 0]  # rotated by 180 degrees, not mirrored: the corners stay counter-clockwise
    shape = np.stack([x, y * np.cos(lean), -sign * y * np.sin(lean)], axis=2)
    triangles = centre[:, None, :] + shape
    middle, size = _fit(triangles.reshape(-1, 3), half_width)
    return np.asarray(size * (triangles - middle))


def _fit(points: Float64, half_width: float) -> tuple[Float64, float]:
    """Return the centre of points (N, 3), and the largest scale at which all of them are in view."""
    middle = np.append((points.min(axis=0) + points.max(axis=0))[:2] / 2, 0.0)
    x, y = np.abs(points - middle).T[:2]
    # An object nearer by z appears larger: size * |x| <= half_width * (1 - size * z / distance).
    nearer = points[:, 2] / _DISTANCE
    return middle, float(1 / np.max([x / half_width + nearer, y + nearer]))
