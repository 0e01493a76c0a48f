"""Bicubic patches of a scene file: checks of their control points, and their subdivision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray

from glpath.io import description
from glpath.io.values import unknown
from glpath.scene.appearance import texture_at
from glpath.scene.geometry import Float64, Mesh, placed
from glpath.scene.model import Camera, Texture
from glpath.scene.patches import Heights, PatchChunks, Patches, diced, triangle_counts
from glpath.scene.source_location import SourceLocation

DEFAULT_LEVEL = 8
#: Maximum number of triangles of a scene's patches that are kept in memory. To divide patches takes about 320 bytes
#: for each triangle, so a scene file of a few hundred bytes takes at most 0.7 GB.
MAX_TRIANGLES = 2**21


@dataclass(frozen=True)
class PatchSurface:
    """Patches and their subdivision, in object space. `chunk` makes one piece, `mesh` the whole surface."""

    chunks: PatchChunks
    location: SourceLocation

    def __len__(self) -> int:
        return len(self.chunks)

    def chunk(self, index: int) -> Float64:
        return self.chunks.chunk(index)

    @property
    def triangle_count(self) -> int:
        """Number of triangles of the whole surface, including those without an area."""
        return int(triangle_counts(self.chunks.levels).sum())

    def mesh(self, total: int = 0) -> Mesh:
        """Return the whole surface as a mesh.

        total : number of triangles of the scene's patches so far, with those of this surface

        Raises SceneError if there are too many triangles, or none with an area.
        """
        of, count = self.chunks, self.triangle_count
        total = max(count, total)
        if total > MAX_TRIANGLES:
            others = f", with those before them {total:,}" if total > count else ""
            raise self.location.error(
                f"would be {count:,} triangles{others}; at most {MAX_TRIANGLES:,} are kept in memory.",
                "Lower its level, or set streamed = true.",
            )
        mesh = diced(of.patches, of.levels, of.heights)
        if not len(mesh.faces):
            raise self.location.error("has no triangles with an area.", "Its control points coincide: check them.")
        return mesh


def patch_surface(
    given: description.Patches,
    location: SourceLocation,
    camera: Camera,
    world: Float64,
    textures: Sequence[Texture],
) -> PatchSurface:
    """Return the surface of a shape's table. Raises SceneError.

    camera : camera for which patches are subdivided if the table has `pixels`
    world  : (3, 4) world_from_shape
    """
    patches = _control(given, location)
    if not isinstance(given.level, UnsetType) and not isinstance(given.pixels, UnsetType):
        raise location.error("has level and pixels, but edges are divided by one of them.", "Leave one away.")
    if isinstance(given.pixels, UnsetType):
        levels = patches.levels(DEFAULT_LEVEL if isinstance(given.level, UnsetType) else given.level)
    else:
        seen = Patches(placed(patches.control, world), patches.uv)
        levels = seen.levels_seen(camera, given.pixels)
    return PatchSurface(PatchChunks(patches, levels, _heights(given, location, textures)), location)


def _control(given: description.Patches, location: SourceLocation) -> Patches:
    fields = {name: getattr(given, name) for name in ("points", "patches", "net")}
    named = {name: value for name, value in fields.items() if not isinstance(value, UnsetType)}
    if set(named) == {"net"}:
        rows: list[Any] = named["net"]
        for index, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise (
                    location.field("net")
                    .item(index)
                    .error(
                        f"has {len(row)} points, but the first row {len(rows[0])}.", "All rows are of one length."
                    )
                )
        return Patches.bspline(np.array(rows, np.float64), given.closed)
    if set(named) == {"points", "patches"}:
        count = len(named["points"])
        if not named["patches"]:
            raise location.field("patches").error("is empty, but a surface needs a patch.")
        for index, numbers in enumerate(named["patches"]):
            for number in numbers:
                if not 0 <= number < count:
                    raise (
                        location.field("patches")
                        .item(index)
                        .error(
                            f"names point {number}, but there are {count} (0 to {count - 1}).",
                            "Points are counted from 0.",
                        )
                    )
        if any(given.closed):
            raise location.field("closed").error("is for a net; Bézier patches close where their points do.")
        return Patches.bezier(named["points"], named["patches"])
    raise location.error(
        f"has {', '.join(named) or 'no control points'}, but patches are `points` and `patches`, or a `net`.",
        "For example: net = [[[0, 0, 0], ...], ...], rows of control points.",
    )


def _heights(given: description.Patches, location: SourceLocation, textures: Sequence[Texture]) -> Heights | None:
    if isinstance(given.displacement, UnsetType):
        return None
    displacement = given.displacement
    found = {texture.name: texture for texture in textures}
    if displacement.texture not in found:
        raise unknown(
            "texture",
            displacement.texture,
            list(found),
            location.field("displacement").field("texture"),
            'file = "height.png"',
        )
    return TextureHeights(found[displacement.texture], displacement.scale, displacement.offset)


@dataclass(frozen=True)
class TextureHeights:
    """Displacement heights from the red channel of a texture, in scene units."""

    texture: Texture
    scale: float
    offset: float

    def __call__(self, uv: Float64) -> NDArray[np.float64]:
        return np.asarray(self.offset + self.scale * texture_at(self.texture, uv)[:, 0])
