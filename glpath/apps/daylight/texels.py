"""Division of a scene's surfaces into texels, small faces with one sensor each, to show results on the model.

Two triangles that form a parallelogram, such as a wall or roof, become a grid of cells. Other triangles are
bisected at their longest edge until no edge is longer than a texel. A sensor lies at the centre of its texel, on
the front of the surface. Backs have no sensors.

Cost:     128 bytes per texel, and the cost of a sensor.
Poor at:  surfaces whose fronts look inwards; light that changes within a texel.
Source:   Rivara 1984, for bisection of the longest edge, which keeps angles from becoming small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError, UsageError
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.io.export.false_colours import Facets, write_facets
from glpath.io.values import LARGEST, SMALLEST
from glpath.io.vtk import VtkMesh
from glpath.radiosity.shafts.occluders import Occluders
from glpath.scene import Scene
from glpath.scene.triangulate import path_traceable
from glpath.system.arguments import check_array, checked, short_repr
from glpath.system.suggestions import listed_names, name_fits

Float64 = NDArray[np.float64]

#: Maximum number of texels that `texels` makes; more raise UsageError.
MAX_TEXELS = 4_000_000


@checked
@dataclass(frozen=True, eq=False)
class Texels:
    """N texels: small faces of a scene's surfaces.

    corners     : (N, 4, 3) float64, scene units, counter-clockwise seen from the front; a triangle repeats its last
                  corner
    shape       : (N,) int32, index of the shape in the scene
    shape_names : names of all shapes of the scene

    Raises UsageError for arrays of other shapes, for values out of range, and for texels without an area.
    """

    corners: Float64
    shape: NDArray[np.int32]
    shape_names: tuple[str, ...]

    def __post_init__(self) -> None:
        names = self.shape_names
        if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
            raise UsageError(f"shape_names: {short_repr(names)} where a tuple of texts is needed")
        corners = check_array("corners", self.corners, (None, 4, 3), (-LARGEST, LARGEST))
        shape = check_array("shape", self.shape, (len(corners),), (0, len(names) - 1), whole=True)
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "shape", shape.astype(np.int32))
        object.__setattr__(self, "shape_names", tuple(names))
        if not self.areas.all():
            raise UsageError(
                f"corners[{int(np.argmin(self.areas))}]: a texel without an area, which has no normal",
                "Leave it out.",
            )

    def __len__(self) -> int:
        return len(self.corners)

    def __getitem__(self, which: slice) -> Texels:
        try:
            corners, shape = self.corners[which], self.shape[which]
        except (TypeError, ValueError, IndexError) as error:
            raise UsageError(
                f"texels: [{short_repr(which)}] where a slice of whole numbers is needed",
                "texels[0:9] has the first nine.",
            ) from error
        return Texels(corners, shape, self.shape_names)

    @classmethod
    def joined(cls, parts: Sequence[Texels]) -> Texels:
        """Return the texels of all parts in order. The parts must belong to one scene."""
        if not len(parts):
            raise UsageError("Texels.joined: no texels where one part at least is needed")
        corners = np.concatenate([part.corners for part in parts])
        return cls(corners, np.concatenate([part.shape for part in parts]), parts[0].shape_names)

    @cached_property
    def points(self) -> Float64:
        """Centres (N, 3) of the texels."""
        of_three, of_four = self.corners[:, :3].mean(axis=1), self.corners.mean(axis=1)
        return np.asarray(np.where(self._triangular[:, None], of_three, of_four))

    @cached_property
    def normals(self) -> Float64:
        """Unit normals (N, 3) on the front side of the texels."""
        across = self._across
        return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))

    @cached_property
    def areas(self) -> Float64:
        """Areas (N,) in scene units squared."""
        return np.asarray(np.linalg.norm(self._across, axis=1) * np.where(self._triangular, 0.5, 1.0))

    def mean(self, values: ArrayLike) -> Float64:
        """Return the area-weighted mean of values (N, ...) of the texels. Raises UsageError without texels."""
        given = np.asarray(values, np.float64)
        if given.shape[:1] != (len(self),):
            raise UsageError(f"mean: values of shape {given.shape}, but there are {len(self):,} texels.")
        self._require_texels("mean")
        return np.asarray(np.average(given, axis=0, weights=self.areas))

    def to_vtk(self, values: Mapping[str, ArrayLike]) -> VtkMesh:
        """Return a VTK mesh of the texels with the given values.

        `.save("city.vtp")` writes the mesh, and `.to_pyvista()` converts it.

        values : arrays (N,) or (N, k) by name; areas and shape indices of the texels are added

        Raises UsageError if an array has another length.
        """
        about = {"area": self.areas, "shape": self.shape}
        return Facets(self.corners, "area", self.areas, "").to_vtk({**values, **about})

    def to_glb(
        self, path: str | Path, values: ArrayLike, *, quantity: str, unit: str = "", up: ArrayLike = (0.0, 0.0, 1.0)
    ) -> None:
        """Write the texels as a .glb in false colours, with a camera that shows all texels.

        values         : (N,) numbers that the colours show
        quantity, unit : name and unit of the values, stored in the file because a .glb has no legend
        up             : (3,) up axis of the scene, near a coordinate axis; it becomes y, the up axis of glTF

        Raises UsageError for another suffix, another number of values, and without texels. Raises ImageError if the
        file cannot be written, and GlpathError if matplotlib is missing.
        """
        self._require_texels("to_glb")
        target = Path(path)
        if target.suffix.lower() != ".glb":
            raise UsageError(f"{path}: a model in false colours is written as .glb.", "For example city.glb.")
        axis = np.asarray(up, np.float64)
        if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
            raise UsageError(f"to_glb: up is {short_repr(up)}; three finite numbers, not all zero, are needed.")
        facets = Facets(self.corners, quantity, np.asarray(values, np.float64), unit)
        write_facets(facets, axis, target)

    def _require_texels(self, what: str) -> None:
        if not len(self):
            raise UsageError(f"{what}: there are no texels where one at least is needed.")

    def arrays(self) -> dict[str, Any]:
        """Return the arrays to store in a file; `read` is the inverse."""
        return {
            "texel_corners": self.corners,
            "texel_shape": self.shape,
            "texel_shape_names": np.array(self.shape_names, dtype=np.str_),
        }

    @classmethod
    def read(cls, arrays: Any, count: int) -> Texels:
        """Read `count` texels from the arrays of a file that `glpath.system.npz` has opened."""
        return cls(
            arrays.read("texel_corners", "f", (count, 4, 3)),
            arrays.read("texel_shape", "i", (count,)).astype(np.int32),
            tuple(arrays.read("texel_shape_names", "U", (None,)).tolist()),
        )

    @cached_property
    def _triangular(self) -> NDArray[np.bool_]:
        return np.asarray((self.corners[:, 2] == self.corners[:, 3]).all(axis=1))

    @cached_property
    def _across(self) -> Float64:
        """Cross product (N, 3) of the two edges at the first corner.

        Its length is the area of a parallelogram, or twice the area of a triangle.
        """
        a, b, d = self.corners[:, 0], self.corners[:, 1], self.corners[:, 3]
        return np.asarray(np.cross(b - a, d - a))


@checked
def texels(scene: AnyScene, size: float, *, shapes: str | Sequence[str] | None = None) -> Texels:
    """Return the surfaces of a scene, divided into texels.

    Parameters
    ----------
    scene  : any source that `load_scene` accepts
    size   : maximum edge length of a texel, scene units
    shapes : names of the shapes to divide, in which * stands for any letters, as in "roof*"; None for all shapes

    Raises UsageError for an invalid size, too many texels, and names that no shape has. Raises SceneError for
    infinite planes and streams, and if no triangle with an area is left.

    >>> found = texels("cornell-box", 100)
    >>> found.points.shape == found.normals.shape == (len(found), 3)
    True
    """
    if not SMALLEST <= size <= LARGEST:
        raise UsageError(
            f"texels: a size of {short_repr(size)}; must be from {SMALLEST:g} to {LARGEST:g} scene units."
        )
    with aside("camera", "light"):
        loaded = load_scene(scene)
    traced = path_traceable(loaded.still(), centred=False)
    faces = Occluders.of_scene(traced)
    chosen = _chosen(traced, shapes)[faces.shape]
    corners, four, shape = faces.corners[chosen], faces.parallelogram[chosen], faces.shape[chosen]
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) * np.where(four, 1.0, 0.5)
    there = areas > 0
    corners, edges, four, shape, areas = corners[there], edges[there], four[there], shape[there], areas[there]
    if not len(corners):
        raise SceneError(f"{loaded.source or loaded.name}: has no triangles to be texels.")
    lengths = np.linalg.norm(edges[four], axis=2)
    counts = np.maximum(np.ceil(lengths / size - 1e-9), 1.0)
    # Lower bound of the number of texels. Those of triangles are at most as large as an equilateral triangle with
    # sides of length `size`.
    fewest = counts.prod(axis=1).sum() + areas[~four].sum() / (0.25 * np.sqrt(3.0) * size**2)
    if fewest > MAX_TEXELS:
        raise UsageError(
            f"texels: {fewest:,.0f} or more of size {size:g}; at most {MAX_TEXELS:,} are allowed.",
            "Take larger ones, or some shapes alone.",
        )
    cells, of_cell = _grids(corners[four], shape[four], counts.astype(np.int64))
    halves, of_half = _halved(corners[~four], shape[~four], size, MAX_TEXELS - len(cells))
    names = tuple(each.name for each in traced.shapes)
    return Texels(np.concatenate([cells, halves]), np.concatenate([of_cell, of_half]).astype(np.int32), names)


def _chosen(scene: Scene, shapes: str | Sequence[str] | None) -> NDArray[np.bool_]:
    """Return (S,) bool, True for each shape that a name matches. Raises UsageError if a name matches none."""
    names = [each.name for each in scene.shapes]
    if shapes is None:
        return np.ones(len(names), np.bool_)
    found = np.zeros(len(names), np.bool_)
    for pattern in [shapes] if isinstance(shapes, str) else shapes:
        fits = [name_fits(name, pattern) for name in names]
        if not any(fits):
            raise UsageError(
                f"texels: no shape is called {short_repr(pattern)}.",
                f"The shapes are {listed_names(names)}.",
            )
        found |= fits
    return found


def _grids(
    corners: Float64, shape: NDArray[np.int32], counts: NDArray[np.int64]
) -> tuple[Float64, NDArray[np.int32]]:
    """Divide parallelograms into grids of cells.

    corners : (P, 3, 3), a corner of each parallelogram, then the two neighbouring corners
    shape   : (P,) shape index of each parallelogram
    counts  : (P, 2) number of cells along the edges to the two neighbouring corners

    Returns the corners (N, 4, 3) and shape indices (N,) of the cells.
    """
    parent = np.repeat(np.arange(len(corners)), counts.prod(axis=1))
    starts = np.concatenate([[0], np.cumsum(counts.prod(axis=1))[:-1]])
    number = np.arange(len(parent)) - starts[parent]
    i, j = number % counts[parent, 0], number // counts[parent, 0]
    first, along, up = (corners[parent, k] - (corners[parent, 0] if k else 0.0) for k in range(3))
    found = np.empty((len(parent), 4, 3))
    for k, (di, dj) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        s, t = ((index / counts[parent, axis])[:, None] for axis, index in enumerate((i + di, j + dj)))
        found[:, k] = first + s * along + t * up
    return found, shape[parent]


def _halved(
    triangles: Float64, shape: NDArray[np.int32], size: float, limit: int
) -> tuple[Float64, NDArray[np.int32]]:
    """Halve triangles (T, 3, 3) at their longest edge until no edge exceeds `size`.

    Returns the corners (N, 4, 3) of the pieces, with the last corner repeated, and their shape indices (N,). Raises
    UsageError for more than `limit` pieces.
    """
    done: list[Float64] = []
    of: list[NDArray[np.int32]] = []
    while len(triangles):
        lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long = lengths.max(axis=1) > size * (1 + 1e-9)
        done.append(triangles[~long])
        of.append(shape[~long])
        triangles, shape, lengths = triangles[long], shape[long], lengths[long]
        if sum(map(len, done)) + 2 * len(triangles) > limit:
            raise UsageError(
                f"texels: of size {size:g} there are more than {MAX_TEXELS:,}.", "Take larger ones, or some shapes."
            )
        # Rotate the corners so that the longest edge joins the first two.
        turn = (np.argmax(lengths, axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles, turn[:, :, None], axis=1).swapaxes(0, 1)
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        shape = np.concatenate([shape, shape])
    pieces = np.concatenate([*done, np.zeros((0, 3, 3))])
    return pieces[:, [0, 1, 2, 2]], np.concatenate([*of, np.zeros(0, np.int32)])
