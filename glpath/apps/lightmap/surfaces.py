"""Surfaces of a scene that have texels in an atlas, before they are lit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.atlas import LARGEST_PAGE, MAX_SIZE, Atlas, PageTooSmallError, kept, packed
from glpath.apps.lightmap.outside import outside
from glpath.apps.lightmap.pages import pages_of
from glpath.apps.lightmap.texels import AtlasTexels, rasterised
from glpath.errors import SceneError, UsageError, warn
from glpath.film.film import Film
from glpath.integrators.settings import GEOMETRY_BUDGET
from glpath.io.export.geometry import listed
from glpath.radiosity.memory import require_memory
from glpath.rendering.below_stream import Covered, StreamedRays, in_memory
from glpath.rendering.sides import Sides
from glpath.scene import Scene
from glpath.scene.triangulate import path_traceable
from glpath.sensors.sensor import PointSensor
from glpath.system.arguments import check_word, short_repr
from glpath.system.time_limit import named_work

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]
Uv = Literal["make", "keep"]

DEFAULT_SIZE = 512
#: Minimum and maximum texels per scene unit. Beyond them, the square of the density times an area leaves the range
#: of floats.
DENSITIES = 1e-18, 1e18
#: Peak memory in bytes per texel, for samples, sensor tables, film sums and pages, measured with a million texels.
_BYTES = 1500
#: Minimum fraction of a page that texels fill, assumed by the memory estimate if charts are scaled to fit one page.
_FILLED = 0.5


@dataclass(frozen=True, eq=False)
class AtlasSurfaces:
    """Texels of a scene before they are lit.

    scene  : triangulated scene at shutter opening, without its streams, which have no texels
    atlas  : texture atlas of its surfaces
    texels : N texels; those inside other geometry are not rendered
    inside : (N,) bool, True for texels inside other geometry
    hidden : number of triangle sides without texels, because they are the inside of closed solids
    streamed : ray tracer for the scene's streams; None if the scene has no streams
    """

    scene: Scene
    atlas: Atlas
    texels: AtlasTexels
    inside: Bools
    hidden: int
    streamed: StreamedRays | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        texels: float | None = None,
        size: int | None = None,
        uv: Uv = "make",
        say: Callable[[str], None] | None = None,
        geometry_budget: int = GEOMETRY_BUDGET,
    ) -> AtlasSurfaces:
        """Return the texels of a scene.

        texels, size, uv : texel density, page size and source of texture coordinates, as for `lightmap`
        say              : called with an estimate of the time if the atlas takes more than some seconds
        geometry_budget  : memory for streamed triangles during the test for covered texels, MiB

        Raises UsageError for invalid parameters or too many texels, and SceneError if the scene cannot be baked.
        Issues a SceneWarning if the scene has streams, because they are not baked.
        """
        check_density(texels, size, uv)
        with named_work("finding the sides that get texels"):
            whole = path_traceable(scene.at(), streams=True)
            still = in_memory(whole)
            if not len(still.triangles):
                raise _without_surfaces(whole)
            _check_shines(still)
            streamed = StreamedRays(whole, geometry_budget) if whole.shapes.streams else None
            if streamed is not None:
                _warn_of_streams(whole)
            sides = Sides.of(still, streamed=streamed is not None)
            area = float((still.areas[:, None] * sides.density**2).sum())
        page = DEFAULT_SIZE if size is None and texels is None else size
        while True:
            require_memory(
                _BYTES * (_FILLED * (page or DEFAULT_SIZE) ** 2 if texels is None else area * float(texels) ** 2),
                "lightmap: so many texels",
                _fewer_texels(texels, size),
            )
            if uv == "keep":
                atlas = kept(still, sides.lit, int(page or DEFAULT_SIZE))
                break
            try:
                atlas = packed(still, sides.density, texels, None if page is None else int(page), say)
                break
            except PageTooSmallError:
                if size is not None or page is None or page >= LARGEST_PAGE:
                    raise
                page *= 2
        return cls.on(still, atlas, sides, streamed)

    @classmethod
    def on(cls, scene: Scene, atlas: Atlas, sides: Sides, streamed: StreamedRays | None = None) -> AtlasSurfaces:
        """Return the texels of an existing atlas. Raises SceneError if no surface is as large as a texel.

        scene    : triangulated scene without streams
        sides    : sides of the scene's triangles
        streamed : ray tracer for the streams; None if there are no streams
        """
        found = rasterised(atlas)
        if not len(found.row):
            raise SceneError(f"{scene.source or scene.name}: no surface is as large as a texel.")
        covered = None if streamed is None else Covered(streamed, sides)
        texels, inside = outside(scene, atlas, found, sides, covered)
        if streamed is not None:
            streamed.forget()  # free the tracer's memory, because the render uses the same budget
        return cls(scene, atlas, texels, inside, int(sides.hidden.sum()), streamed)

    @property
    def rendered(self) -> Scene:
        """Scene that lights the texels: `scene` with its streams, in the same coordinates."""
        return self.scene if self.streamed is None else self.streamed.scene

    def sensor(self) -> PointSensor:
        """Return a sensor with one point for each rendered texel, in rows of a grid that is nearly square.

        Points that fill up the last row are invalid. Raises SceneError if all texels are inside other geometry.
        """
        rendered = np.flatnonzero(~self.inside)
        if not len(rendered):
            raise SceneError(f"{self.scene.name}: all texels are inside other geometry.")
        width = int(np.ceil(np.sqrt(len(rendered))))
        height = -(-len(rendered) // width)
        samples = len(self.texels.face)
        positions, normals, shading = np.zeros((3, samples, height * width, 3), np.float32)
        for s in range(samples):
            positions[s, : len(rendered)] = self.texels.positions(self.scene, self.atlas, s)[rendered]
            normals[s, : len(rendered)] = self.texels.normals(self.scene, self.atlas, s, smooth=False)[rendered]
            shading[s, : len(rendered)] = self.texels.normals(self.scene, self.atlas, s)[rendered]
        valid = (np.arange(height * width) < len(rendered)).reshape(height, width)
        shape = (samples, height, width, 3)
        smooth = None if np.array_equal(normals, shading) else shading.reshape(shape)
        return PointSensor.of(positions.reshape(shape), normals.reshape(shape), valid, shading_normals=smooth)

    def pages(self, film: Film) -> tuple[Float32, Bools]:
        """Return irradiance (P, h, w, 3) from a film of the sensor, and a mask (P, h, w) of rendered texels."""
        values = np.zeros((len(self.inside), 3))
        rendered = ~self.inside
        values[rendered] = np.pi * film.mean.reshape(-1, 3)[: rendered.sum()]
        return pages_of(self.atlas, self.texels, values, self.inside)


def check_density(texels: float | None, size: int | None, uv: str) -> None:
    """Raise UsageError if texel density, page size or uv mode is invalid, or if they contradict each other."""
    check_word("uv", uv, get_args(Uv))
    low, high = DENSITIES
    if texels is not None and not (isinstance(texels, int | float | np.number) and low <= texels <= high):
        raise UsageError(
            f"texels is {short_repr(texels)}; must be a number above 0, texels per scene unit, from {low:g} to "
            f"{high:g}."
        )
    if size is not None and not (isinstance(size, int | np.integer) and 16 <= size <= MAX_SIZE):
        raise UsageError(f"size is {short_repr(size)}; must be a whole number from 16 to {MAX_SIZE}, texels.")
    if uv == "keep" and texels is not None:
        raise UsageError(
            "texels: has no meaning with kept coordinates, which already determine the sizes on the page.",
            "Give the size of the page.",
        )


def _check_shines(scene: Scene) -> None:
    if scene.sky is None and not (np.any(scene.ambient > 0) or scene.lights or any(s.emits for s in scene.shapes)):
        raise SceneError(
            f"{scene.source or scene.name}: has no light, so there is nothing to bake.",
            "Give the scene a light or a sky.",
        )


def _fewer_texels(texels: float | None, size: int | None) -> str:
    """Return the remedy for a page that takes too much memory."""
    if texels is not None:
        return "Give fewer texels per scene unit."
    return "Give a smaller size." if size is not None else "Give `texels`, or a model of fewer parts."


def _without_surfaces(scene: Scene) -> SceneError:
    name, count = scene.source or scene.name, scene.shapes.total("stream")
    if not count:
        return SceneError(f"{name}: has no surface to bake.")
    return SceneError(
        f"{name}: has no surface in memory to bake: its {count:,} triangles are streamed, and have no texels.",
        'Make the surfaces to bake meshes in memory, not shapes of the type "stream".',
    )


def _warn_of_streams(scene: Scene) -> None:
    names = listed([scene.shapes[index].name for index, _ in scene.shapes.streams])
    warn(
        f"{scene.source or scene.name}: {scene.shapes.total('stream'):,} streamed triangles ({names}) are not "
        "baked, and not in the file: they light and shade the other surfaces. To bake them, hold them in memory, "
        "as a mesh."
    )
