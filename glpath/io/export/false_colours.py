"""Flat faces with values, written in false colours for glTF viewers (.glb), alone or inside their model.

Colours are those of `glpath.film.charts.false_colours`, unlit, visible from both sides. glTF has no legend, so the
file's `extras` hold the quantity and the values of the first and the last colour.

Cost:   36 bytes a corner in .glb, as faces do not share vertices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.film.charts import COLOUR_MAP, colour_range, false_colours
from glpath.io.export import gltf_json
from glpath.io.export.glb import Glb, y_up_from
from glpath.io.vtk import VtkMesh
from glpath.scene.camera import framing
from glpath.scene.model import Float64, Material, Mesh, Scene, Shape, Shapes
from glpath.system.colour import decode_srgb

# Resolution of the camera, pixels.
_RESOLUTION = (1200, 900)


@dataclass(frozen=True, eq=False)
class Facets:
    """Flat faces in space, each coloured by its value.

    corners  : (F, 4, 3) float64, in order around the face; a triangle repeats its last corner
    quantity : name of the quantity, such as illuminance
    values   : (F,) float64; NaN for no value
    unit     : unit of the values
    """

    corners: Float64
    quantity: str
    values: Float64
    unit: str

    def __post_init__(self) -> None:
        if np.shape(self.values) != (len(self.corners),):
            raise UsageError(
                f"{self.quantity}: of shape {np.shape(self.values)}, but there are {len(self.corners):,} faces."
            )

    @property
    def ends(self) -> tuple[float, float]:
        """Values of the first and the last colour. Raises UsageError for infinite values."""
        return colour_range(self.values)

    @property
    def _triangular(self) -> NDArray[np.bool_]:
        return np.asarray((self.corners[:, 2] == self.corners[:, 3]).all(axis=1))

    def to_vtk(self, data: Mapping[str, Any] | None = None) -> VtkMesh:
        """Return the polygons with their own values, or with `data`: arrays by name, each (F,) or (F, k)."""
        numbers = [
            [first, first + 1, first + 2] if three else [first, first + 1, first + 2, first + 3]
            for first, three in zip(range(0, 4 * len(self.corners), 4), self._triangular.tolist(), strict=True)
        ]
        shown = {self.quantity: self.values} if data is None else data
        return VtkMesh(self.corners.reshape(-1, 3), numbers, cell_data=shown)

    def add_to(self, file: Glb, origin: Float64) -> None:
        """Add the faces to a file whose coordinates are relative to an origin (3,)."""
        colours = decode_srgb(false_colours(self.values, self.ends))
        position = (self.corners - origin).reshape(-1, 3).astype(np.float32)
        first = 4 * np.arange(len(self.corners))[:, None]
        halves = np.array([[0, 1, 2]]), np.array([[0, 2, 3]])
        faces = np.concatenate([first + halves[0], first[~self._triangular] + halves[1]])
        file.materials.append(
            gltf_json.Material(
                name="false colours",
                pbr_metallic_roughness=gltf_json.PbrMetallicRoughness(metallic_factor=0.0),
                extensions={file.use("KHR_materials_unlit"): {}},
                double_sided=True,
            )
        )
        primitive = gltf_json.Primitive(
            attributes={
                "POSITION": file.add_array(position, bounds=True),
                "COLOR_0": file.add_array(np.repeat(colours, 4, axis=0).astype(np.float32)),
            },
            indices=file.add_array(faces.astype(np.uint32).ravel(), indices=True),
            material=len(file.materials) - 1,
        )
        bottom, top = self.ends
        name = f"{self.quantity}, {bottom:.4g} to {top:.4g} {self.unit}"
        file.add_node(name, mesh=file.add_mesh(name, [primitive]))

    @property
    def legend(self) -> dict[str, object]:
        """Description of the colours for the extras of a .glb."""
        bottom, top = self.ends
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "colour_map": COLOUR_MAP,
            "first_colour": bottom,
            "last_colour": top,
        }


def write_facets(facets: Facets, up: Float64, path: Path) -> None:
    """Write the faces alone as .glb, with a camera that shows all of them.

    `write_gltf` writes them inside a scene.

    up : (3,), near an axis, which becomes y

    Raises ImageError, and GlpathError without matplotlib.
    """
    turned = replace(facets, corners=facets.corners @ y_up_from(up).T)
    points = turned.corners.reshape(-1, 3)
    camera = framing(points, _RESOLUTION)
    # `Glb` takes its bounds and its origin from a scene.
    mesh = Mesh(points, np.arange(len(points), dtype=np.int32).reshape(-1, 4)[:, :3])
    scene = Scene(facets.quantity, camera, Shapes([Shape("faces", mesh, 0)]), (Material("faces", np.ones(3)),))
    file = Glb(scene.centred)
    turned.add_to(file, scene.centred.origin)
    file.save(path, **facets.legend)


def cells(
    extent: tuple[float, float, float, float], shape: tuple[int, int], axes: tuple[int, int, int], height: float
) -> NDArray[np.float64]:
    """Return the (rows * columns, 4, 3) corners of grid cells, row by row, in a plane perpendicular to an axis.

    extent : start and end of the grid along the first axis in the plane, then along the second
    shape  : (rows, columns)
    axes   : indices of the axis along which columns advance, of that along which rows advance, and of the
             perpendicular axis
    height : coordinate along the perpendicular axis
    """
    rows, columns = shape
    u, v = np.linspace(*extent[:2], columns + 1), np.linspace(*extent[2:], rows + 1)
    left, low = np.tile(u[:-1], rows), np.repeat(v[:-1], columns)
    right, high = np.tile(u[1:], rows), np.repeat(v[1:], columns)
    found = np.empty((rows * columns, 4, 3))
    found[..., axes[2]] = height
    found[..., axes[0]] = np.stack([left, right, right, left], axis=1)
    found[..., axes[1]] = np.stack([low, low, high, high], axis=1)
    return found
