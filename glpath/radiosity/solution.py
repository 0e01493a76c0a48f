"""Radiosity solution: irradiance of every element of a scene's surfaces, as arrays that can be saved and loaded.

Irradiance is smooth even if the reflectance of a surface is not, so the reflectance is applied at look-up. Direct
light, which comes straight from a lamp, and indirect light are separate, because some integrators sample direct
light better themselves. Emission is not included; callers find lamps by other means, and add pi * Le if needed.

Cost:     48 bytes per element and per vertex.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import ImageError, SceneError, UsageError
from glpath.io.vtk import VtkMesh
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.interpolation import interpolate, leaves, vertices_of_elements
from glpath.scene import Scene, path_traceable
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64, Int32
from glpath.system.arguments import checked, short_repr
from glpath.system.files import whole_file
from glpath.system.npz import open_npz

Float32 = NDArray[np.float32]
Lookup = Literal["interpolated", "constant"]
Mode = Literal["interpolated", "constant", "smooth"]
Part = Literal["both", "direct", "indirect"]

#: Format number of the file; it changes with the layout.
FORMAT = 2
# Maximum number of parts of a triangle's edge, so that int32 can count its elements.
_MAX_DIVISIONS = 1 << 15
#: Index of direct light in the arrays of a solution.
DIRECT = 0
#: Index of indirect light in the arrays of a solution.
INDIRECT = 1
_PARTS: dict[Part, tuple[int, ...]] = {"both": (DIRECT, INDIRECT), "direct": (DIRECT,), "indirect": (INDIRECT,)}


@checked
@dataclass(frozen=True, eq=False, repr=False)
class RadiositySolution:
    """Irradiance on the elements of a scene's surfaces.

    Each edge of triangle t is divided into n = divisions[t] equal parts. The triangle then has n * n elements and
    (n + 1)(n + 2) / 2 vertices. Both are stored triangle by triangle, in the order that
    `glpath.radiosity.mesh.lattice` defines.

    scene_hash : `Scene.digest(camera=False)` of the scene that `path_traceable` has converted to triangles
    divisions  : (T,) int32, n of each triangle
    elements   : (2, 2, E, 3) float32, irradiance H, W m^-2 (lx in a photometric scene), mean over each element,
                 linear Rec. 709. First axis: [DIRECT] straight from a lamp, [INDIRECT] after at least one
                 reflection; second axis: [0] front, [1] back. The irradiance of a side that neither reflects nor
                 emits is 0. An element that a solid covers has the mean of its neighbours
    vertices   : (2, 2, V, 3) float32, irradiance at the vertices, for interpolation; equal where triangles of one
                 surface meet, so that no seams appear
    method     : name of the solution method
    settings   : all other settings that affect the result, as JSON values
    statistics : cost of the solution, such as time, as JSON values
    leaf_size  : (E,) uint16, edge length of the solver's element that contains each element, counted in elements;
                 above 1 if the lattice is finer than the mesh of the solver. The default is 1 everywhere
    """

    scene_hash: str
    divisions: Int32
    elements: Float32
    vertices: Float32
    method: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    statistics: Mapping[str, Any] = field(default_factory=dict)
    leaf_size: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))

    def __post_init__(self) -> None:
        try:
            self._complete()
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(f"RadiositySolution: {error}.") from error

    def _complete(self) -> None:
        """Convert the fields to arrays. Raises TypeError, ValueError or OverflowError for wrong values."""
        put = object.__setattr__
        for name in ("scene_hash", "method"):
            if not isinstance(getattr(self, name), str):
                raise TypeError(f"{name} is {short_repr(getattr(self, name))}, where text is needed")
        divisions = np.asarray(self.divisions)
        if divisions.ndim != 1 or not np.all(
            (divisions >= 1) & (divisions <= _MAX_DIVISIONS) & (divisions % 1 == 0)
        ):
            raise ValueError(f"divisions must be (T,), each a whole number from 1 to {_MAX_DIVISIONS}")
        put(self, "divisions", np.ascontiguousarray(divisions, np.int32))
        for name in ("elements", "vertices"):
            put(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        sizes = np.asarray(self.leaf_size) if len(self.leaf_size) else np.ones(self.element_count, np.uint16)
        if sizes.shape != (self.element_count,) or not np.all((sizes >= 1) & (sizes <= _MAX_DIVISIONS)):
            raise ValueError(f"leaf_size must be ({self.element_count},), each from 1 to {_MAX_DIVISIONS}")
        put(self, "leaf_size", np.ascontiguousarray(sizes, np.uint16))
        for name in ("settings", "statistics"):
            put(self, name, json.loads(json.dumps(dict(getattr(self, name)))))
        for name, count in (("elements", self.first_element[-1]), ("vertices", self.first_vertex[-1])):
            found = getattr(self, name)
            if found.shape != (2, 2, count, 3):
                shape = (2, 2, int(count), 3)
                raise ValueError(f"{name} has the shape {found.shape}; its divisions make it {shape}")
            if not (np.isfinite(found).all() and (found >= 0).all()):
                raise ValueError(f"{name} holds values that are negative or not finite")

    @cached_property
    def first_element(self) -> NDArray[np.int64]:
        """Start indices (T + 1,) of each triangle's elements, followed by their total number."""
        return lattice.starts(lattice.element_count(self.divisions))

    @cached_property
    def first_vertex(self) -> NDArray[np.int64]:
        """Start indices (T + 1,) of each triangle's vertices, followed by their total number."""
        return lattice.starts(lattice.vertex_count(self.divisions))

    @cached_property
    def leaf(self) -> NDArray[np.int64]:
        """Index (E,) of the solver's element that each element is part of, from 0."""
        return leaves(self.divisions.astype(np.int64), self.leaf_size)

    @cached_property
    def _vertices_of(self) -> NDArray[np.int64]:
        """Indices (E, 3) of the vertices of each element."""
        return vertices_of_elements(self.divisions.astype(np.int64))

    @cached_property
    def _corners(self) -> Float64:
        """Irradiance (2, 2, E, 3, 3) at corners: direct or indirect, front or back, element, corner, channel."""
        parts = zip(self.vertices.astype(np.float64), self.elements.astype(np.float64), strict=True)
        return np.stack([interpolate(self._vertices_of, self.leaf, *part) for part in parts])

    @property
    def element_count(self) -> int:
        """Number of elements of all triangles; the two sides of an element count once."""
        return int(self.first_element[-1])

    def irradiance(
        self,
        triangle: ArrayLike,
        barycentric: ArrayLike,
        back: ArrayLike = 0,
        mode: Mode = "interpolated",
        light: Part = "both",
    ) -> Float64:
        """Return the irradiance (N, 3) at points of triangles, float64, W m^-2.

        triangle    : (N,) indices of the scene's triangles
        barycentric : (N, 2), weights b1, b2 of the point c0 + b1 (c1 - c0) + b2 (c2 - c0), with corners c0, c1, c2
        back        : (N,) or a scalar: 0 for the front, 1 for the back
        mode        : "interpolated", linear within each element, which keeps its mean; "constant" over each
                      element; or "smooth", without steps between elements, for display. With "smooth", light leaks
                      around edges
        light       : "direct", straight from a lamp; "indirect", after one reflection or more; or "both"

        Raises UsageError for another mode or light, or a triangle that does not exist.
        """
        t = np.atleast_1d(_whole_numbers("triangles", triangle, len(self.divisions)))
        b = np.asarray(barycentric, np.float64)
        side = _whole_numbers("back", back, 2)
        if t.ndim != 1 or side.shape not in ((), (1,), t.shape):
            raise UsageError(
                f"RadiositySolution: triangle of shape {t.shape} and back of shape {side.shape}, where (N,) each, "
                "or one number, are needed."
            )
        side = np.broadcast_to(side, t.shape)
        if b.size % 2 or np.isnan(b).any() or not (len(t) == 1 or b.size in (2, 2 * len(t))):
            raise UsageError(
                f"RadiositySolution: barycentric of shape {b.shape}, where ({len(t)}, 2) numbers, no NaN, are "
                "needed."
            )
        b = b.reshape(-1, 2)
        for name, value, allowed in (("mode", mode, get_args(Mode)), ("light", light, _PARTS)):
            if value not in allowed:
                raise UsageError(
                    f"RadiositySolution: {name} {short_repr(value)}; allowed are {', '.join(allowed)}."
                )
        n = self.divisions[t].astype(np.int64)
        i, j, upper, fx, fy = lattice.locate(n, b[:, 0], b[:, 1])
        element = self.first_element[t] + lattice.element_index(n, i, j, upper)
        if mode == "constant":
            found = [self.elements[part][side, element] for part in _PARTS[light]]
            return np.asarray(np.sum(found, axis=0, dtype=np.float64))
        weights = np.where(upper, (fx + fy - 1, 1 - fx, 1 - fy), (1 - fx - fy, fx, fy))
        if mode == "smooth":
            corners = sum(self.vertices[part][side[:, None], self._vertices_of[element]] for part in _PARTS[light])
        else:
            corners = sum(self._corners[part][side, element] for part in _PARTS[light])
        return np.asarray(np.einsum("kn,nkc->nc", weights, corners))

    def lookup(
        self,
        scene: Scene,
        triangle: ArrayLike,
        barycentric: ArrayLike,
        back: ArrayLike = 0,
        mode: Mode = "interpolated",
    ) -> Float64:
        """Return the radiosity (N, 3) at points of triangles, float64, W m^-2.

        The radiosity is the reflectance times the irradiance by direct and indirect light, plus light that a
        diffuse base transmits from the other side.

        scene : scene of this solution; only `check_scene` verifies this

        Other parameters and errors are those of `irradiance`.
        """
        arrived = self.irradiance(triangle, barycentric, back, mode)
        triangles = self._triangles_of(scene)
        t, side = np.atleast_1d(np.asarray(triangle, np.int64)), np.asarray(back, np.int64)
        found = triangles.side_reflectance[side, t] * arrived
        through = Appearance(triangles).side_transmittance()
        if through.any():
            found = found + through[1 - side, t] * self.irradiance(triangle, barycentric, 1 - side, mode)
        return np.asarray(found)

    def reflected(self, scene: Scene) -> Float64:
        """Return the radiosity (2, E, 3) of the elements' fronts and backs, float64, W m^-2, without emission.

        The radiosity is the reflectance times the irradiance by all light, plus light that a diffuse base transmits
        from the other side.

        scene : scene of this solution, which provides the reflectance; only `check_scene` verifies this
        """
        triangles = self._triangles_of(scene)
        count = self.divisions.astype(np.int64) ** 2
        arrived = self.elements.sum(axis=0)
        through = np.repeat(Appearance(triangles).side_transmittance(), count, axis=1) * arrived
        return np.asarray(np.repeat(triangles.side_reflectance, count, axis=1) * arrived + through[::-1])

    def _triangles_of(self, scene: Scene) -> Scene:
        """Return the triangles of a scene. Raises SceneError if they are not as many as those of this solution."""
        triangles = path_traceable(scene.still())
        if len(triangles.triangles) != len(self.divisions):
            self.check_scene(scene)
        return triangles

    def check_scene(self, scene: Scene) -> None:
        """Raise SceneError unless this is a solution of `scene`; the camera may differ."""
        triangles = path_traceable(scene.still())
        if triangles.digest(camera=False) != self.scene_hash or len(triangles.triangles) != len(self.divisions):
            raise SceneError(
                f"{scene.source or scene.name}: the radiosity solution belongs to another scene, or to this one "
                f"before it was changed: its hash is {self.scene_hash[:12]}..., the scene's "
                f"{triangles.digest(camera=False)[:12]}...",
                "Geometry, materials and lights must be those it was solved for; the camera may differ. Solve "
                "anew: glpath radiosity SCENE -o solution.npz.",
            )

    def save(self, path: str | Path) -> None:
        """Write the solution as .npz; an error leaves no partial file.

        Raises UsageError for another suffix, and ImageError if the file cannot be written.
        """
        check_suffix(path)
        plain = {
            "scene_hash": self.scene_hash,
            "method": self.method,
            "settings": self.settings,
            "statistics": self.statistics,
        }
        with whole_file(path) as temporary, temporary.open("wb") as file:
            np.savez(
                file,
                radiosity_format=np.int64(FORMAT),
                divisions=self.divisions,
                elements=self.elements,
                vertices=self.vertices,
                leaf_size=self.leaf_size,
                made_by=np.array(json.dumps(plain)),
            )

    def to_glb(self, scene: Scene, path: str | Path, *, exposure: float = 0.0) -> None:
        """Write the scene as unlit glTF 2.0 (.glb) with radiosity as vertex colours; errors leave no partial file.

        scene    : scene of this solution; its camera is written to the file
        exposure : exposure in stops, which the file stores as `extras.exposure_stops`. Colours are radiance
                   (emission plus reflected radiosity / pi) times 2^exposure, linear Rec. 709, clipped to [0, 1]

        Sides that neither reflect nor emit are left out. Raises SceneError for another scene, UsageError for
        another suffix, ImageError if the file cannot be written.
        """
        from glpath.radiosity.glb import VertexLight, write_glb  # late, because few solutions are exported

        self.check_scene(scene)
        light = VertexLight(self.divisions, self.vertices, self.first_vertex)
        write_glb(
            light, path_traceable(scene.still()), path, exposure, scene_hash=self.scene_hash, method=self.method
        )

    def to_vtk(self, scene: Scene) -> VtkMesh:
        """Return the elements as triangles, for ParaView and PyVista: `.save("room.vtp")`, `.to_pyvista()`.

        scene : scene of this solution

        Cell arrays: irradiance in `front` and `back` (E, 3), reflected light in `radiosity_front` and
        `radiosity_back`. Point arrays: irradiance in `front` and `back`, for smooth images. Raises SceneError for
        another scene.
        """
        self.check_scene(scene)
        corners = path_traceable(scene.still(), centred=False).triangles
        points, faces = [], []
        for number, n in enumerate(self.divisions.tolist()):
            b1, b2 = lattice.vertex_barycentrics(n).T[:, :, None]
            a, b, c = corners[number]
            points.append(a + b1 * (b - a) + b2 * (c - a))
            faces.append(lattice.element_vertices(n) + self.first_vertex[number])
        irradiance, smooth, sent = self.elements.sum(axis=0), self.vertices.sum(axis=0), self.reflected(scene)
        return VtkMesh(
            np.concatenate(points),
            np.concatenate(faces).tolist(),
            {"front": irradiance[0], "back": irradiance[1], "radiosity_front": sent[0], "radiosity_back": sent[1]},
            {"front": smooth[0], "back": smooth[1]},
        )

    @classmethod
    def load(cls, path: str | Path, scene: Scene | None = None) -> RadiositySolution:
        """Read a solution that `save` wrote.

        scene : scene to which the solution must belong, see `check_scene`; None for no check

        Raises ImageError for a file that is missing, broken or of another kind, SceneError for another scene.
        """
        remedy = "A radiosity solution is what `glpath radiosity SCENE -o NAME.npz` writes."
        with open_npz(path, "a radiosity solution", remedy) as stored:
            if (found := int(stored.read("radiosity_format", "iu", ()))) != FORMAT:
                holds = ", which holds what surfaces reflect," if found == 1 else ""
                raise ImageError(
                    f"{path}: is a radiosity solution of format {found}{holds}; this version of glpath reads "
                    f"format {FORMAT}: irradiance, direct and indirect apart.",
                    "Solve the scene anew: glpath radiosity SCENE -o NAME.npz.",
                )
            made_by = stored.read_object("made_by")
            names = {"scene_hash": str, "method": str, "settings": dict, "statistics": dict}
            if [type(made_by.get(name)) for name in names] != list(names.values()):
                raise ValueError(f"what made it is not {', '.join(names)}")
            sizes = stored.read("leaf_size", "u", (None,)) if "leaf_size" in stored else np.zeros(0, np.uint16)
            irradiance = {name: stored.read(name, "f", (2, 2, None, 3)) for name in ("elements", "vertices")}
            if any(values.dtype != np.float32 for values in irradiance.values()):
                raise ValueError("its irradiance is not float32")
            fields: dict[str, Any] = dict(
                divisions=stored.read("divisions", "iu", (None,)),
                **irradiance,
                leaf_size=sizes,
                **{name: made_by[name] for name in names},
            )
            try:
                solution = cls(**fields)
            except UsageError as error:
                raise ValueError(error.message) from error
        if scene is not None:
            solution.check_scene(scene)
        return solution

    def __repr__(self) -> str:
        return (
            f"<RadiositySolution of {len(self.divisions)} triangles: {self.element_count} elements, "
            f"{self.method or 'unknown method'}>"
        )


def _whole_numbers(name: str, given: ArrayLike, count: int) -> NDArray[np.int64]:
    """Return whole numbers as int64. Raises UsageError for other numbers, or if one is not from 0 to count - 1."""
    values = np.asarray(given)
    if values.dtype.kind not in "iufb" and values.size:
        raise UsageError(f"RadiositySolution: {name} of type {values.dtype}, where whole numbers are needed.")
    with np.errstate(invalid="ignore"):
        wrong = ~((values >= 0) & (values < count) & (values == np.floor(values)))
    if wrong.any():
        found = short_repr(values[wrong].flat[0].item())
        raise UsageError(f"RadiositySolution: {name} {found}, but whole numbers from 0 to {count - 1} are allowed.")
    return values.astype(np.int64)


def check_suffix(path: str | Path) -> Path:
    """Return `path` as a Path. Raises UsageError unless its suffix is .npz."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise UsageError(f"{path}: a radiosity solution is written as .npz.", "For example -o solution.npz.")
    return path
