"""Flat faces with values, in false colours for viewers of glTF (.glb): alone, or inside of their model.

Colours are those of `glpath.film.charts.false_colours`, unlit, seen from both sides. glTF has no legend: the file
says in its `extras` what the values are and which of them the ends of the colours are.

Cost:   36 bytes a corner in .glb, as faces do not share vertices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.film.charts import COLOUR_MAP, false_colours
from glpath.film.image import decode_srgb
from glpath.io.export import gltf_json
from glpath.io.export.glb import Glb
from glpath.io.vtk import VtkMesh
from glpath.scene.model import Float64, Scene


@dataclass(frozen=True, eq=False)
class Facets:
    """Flat faces in space, each with a value, which colours it.

    corners  : (F, K, 3) float64, of triangles (K = 3) or quadrilaterals (4), around
    quantity : what the values are of, such as illuminance
    values   : (F,) float64; NaN where there is none
    unit     : of the values
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
    def top(self) -> float:
        """The value of the last colour; the first is of 0."""
        return float(np.nanmax(self.values)) if np.isfinite(self.values).any() else 0.0

    def to_vtk(self, data: Mapping[str, Any] | None = None) -> VtkMesh:
        """Polygons with values on them: their own, or others by name, each (F,) or (F, k)."""
        count, sides, _ = self.corners.shape
        numbers = np.arange(count * sides).reshape(count, sides).tolist()
        shown = {self.quantity: self.values} if data is None else data
        return VtkMesh(self.corners.reshape(-1, 3), numbers, cell_data=shown)

    def add_to(self, file: Glb, origin: Float64) -> None:
        """Put them into a file whose coordinates are relative to an origin (3,)."""
        count, sides, _ = self.corners.shape
        colours = decode_srgb(false_colours(self.values, self.top))
        position = (self.corners - origin).reshape(-1, 3).astype(np.float32)
        first = sides * np.arange(count)[:, None]
        faces = np.stack([first + np.array([0, i, i + 1]) for i in range(1, sides - 1)], axis=1)
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
                "COLOR_0": file.add_array(np.repeat(colours, sides, axis=0).astype(np.float32)),
            },
            indices=file.add_array(faces.astype(np.uint32).ravel(), indices=True),
            material=len(file.materials) - 1,
        )
        name = f"{self.quantity}, 0 to {self.top:.4g} {self.unit}"
        file.add_node(name, mesh=file.add_mesh(name, [primitive]))

    @property
    def legend(self) -> dict[str, object]:
        """What a .glb says of its colours."""
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "colour_map": COLOUR_MAP,
            "first_colour": 0.0,
            "last_colour": self.top,
        }


def write_facets(facets: Facets, scene: Scene, path: Path) -> None:
    """Write the faces alone, as .glb, seen by the scene's camera; `write_gltf` writes them inside of the scene.

    Raises ImageError, and GlpathError without matplotlib.
    """
    centred = scene.centred
    file = Glb(centred)
    facets.add_to(file, centred.origin)
    file.save(path, **facets.legend)


def cells(
    extent: tuple[float, float, float, float], shape: tuple[int, int], axes: tuple[int, int, int], height: float
) -> NDArray[np.float64]:
    """(rows * columns, 4, 3): corners of the cells of a grid in a plane across an axis, row by row.

    extent : where cells begin and end along the first axis in the plane, then along the second
    shape  : (rows, columns)
    axes   : numbers of the two axes in the plane, columns along the first, and of the axis across it
    height : along that
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
