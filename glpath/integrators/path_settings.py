"""Options of path tracing: "path", with per-path rays, and "path-buffer"."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self, TypedDict

from msgspec import Meta

from glpath.errors import argument
from glpath.integrators.settings import (
    DEEPEST,
    GEOMETRY_BUDGET,
    GUIDES,
    NO_LOOKUP,
    ROULETTE_OF_MIRRORED,
    Ambient,
    Directions,
    DirectLight,
    GeometryBudget,
    Guide,
    Lookup,
    MaxDepth,
    PathSetSettings,
    Remedy,
    Roulette,
    SharedDirections,
)

# Vertex at which roulette starts for paths that nothing else ends.
_ROULETTE = 4
# Number of diffuse bounces after which a path uses a radiosity solution as its control variate.
_CORRECTED_FROM = 2


def _path_buffer() -> str:
    return argument("integrator", "path-buffer")


@dataclass(frozen=True)
class PathSettings(PathSetSettings):
    """Path tracing: each path has its own directions, and a BVH in the shader casts its rays.

    The roulette is Arvo & Kirk's (1990).
    """

    integrator = "path"
    remedies: ClassVar[Mapping[str, Remedy]] = {
        **NO_LOOKUP,
        "directions": lambda: f"Each path has directions of its own; with {_path_buffer()} a set shares them.",
        "light_resolution": lambda: f"Shadows are rays; with {_path_buffer()} they are shadow-buffers.",
        "geometry_budget": lambda: f"Rays need all triangles in memory; take {_path_buffer()}, which streams them.",
        "bounce_lod": lambda: f"Rays have one BVH; {_path_buffer()} has a simpler scene for bounces.",
    }

    # Fixed for paths, because only a gather can choose these.
    radiosity_lookup: ClassVar[Lookup] = "interpolated"
    direct_light: ClassVar[DirectLight] = "traced"

    max_depth: MaxDepth = DEEPEST
    guide: Annotated[
        Guide | None,
        Meta(
            description=GUIDES,
            extra={
                "unset": '"solution" with a max-depth of 1000 where the scene can be solved soon, else "cosine"'
            },
        ),
    ] = None
    ambient: Ambient = None
    roulette: Roulette = None

    def completed(self, solvable: Callable[[], bool]) -> Self:
        return replace(self, **_completed(self), guide=self.guide or self._guide(solvable))

    def _guide(self, solvable: Callable[[], bool]) -> Guide:
        return "solution" if self.max_depth == DEEPEST and solvable() else "cosine"

    @property
    def path_length(self) -> int:
        return self.max_depth

    @property
    def guided(self) -> bool:
        return self.guide == "solution"

    @property
    def endless(self) -> bool:
        return self.roulette is not None and self.max_depth == DEEPEST

    @property
    def corrects(self) -> bool:
        return self.guided and self.endless

    @property
    def branches(self) -> int:
        """Number of directions that a path takes from its first vertex."""
        return 2 if self.corrects else 1

    def roulette_from(self, mirrored: bool) -> int | None:
        """Return the vertex from which on Russian roulette ends paths, or None.

        With a solution as control variate, roulette ends only paths by mirrors and glass.
        """
        if self.corrects:
            return ROULETTE_OF_MIRRORED if mirrored else None
        return self.roulette

    def lookup_uniforms(self) -> dict[str, object]:
        """Return the uniforms of path/path_rays.glsl for a radiosity solution as control variate."""
        return {"lookup_depth": _CORRECTED_FROM} if self.corrects else {}

    def recorded(self) -> dict[str, Any]:
        """Return the settings, without an unused guide, and without max_depth if only roulette ends paths."""
        unused = [name for name, used in (("guide", self.guided), ("max_depth", not self.endless)) if not used]
        return {k: v for k, v in super().recorded().items() if k not in unused}


def _completed(settings: PathSettings | PathBufferSettings) -> dict[str, Any]:
    """Return the default start of roulette as an option, if paths have all bounces and no start was given."""
    return {"roulette": _ROULETTE} if settings.max_depth == DEEPEST and settings.roulette is None else {}


@dataclass(frozen=True)
class PathBufferSettings(SharedDirections, PathSetSettings):
    """Path tracing with the path-buffer [PB 3]: all paths of a set share directions, one scan casts all their rays.

    Ambient light is that of PB A.2, the roulette Arvo & Kirk's (1990).
    """

    integrator = "path-buffer"
    remedies: ClassVar[Mapping[str, Remedy]] = {
        **NO_LOOKUP,
        "guide": lambda: (
            f"All paths of a set share their directions; paths of {argument('integrator', 'path')} choose them."
        ),
    }

    max_depth: MaxDepth = DEEPEST
    directions: Annotated[
        Directions,
        Meta(
            description='of a bounce, shared by all paths of a set: "pair", each path takes the better of two; '
            '"lattice", one of a lattice for the first bounce, then as "pair"; "hemisphere", one; "sphere", as in '
            "the paper"
        ),
    ] = "pair"
    ambient: Ambient = None
    roulette: Roulette = None
    geometry_budget: GeometryBudget = GEOMETRY_BUDGET
    bounce_lod: Annotated[
        float | None,
        Meta(
            ge=0.001,
            le=1,
            description="from their second vertex on, paths meet a simpler scene, of this share of the triangles "
            "of plain meshes; quicker in large scenes, not quite right. By default, never",
            extra={"metavar": "SHARE"},
        ),
    ] = None

    def completed(self, solvable: Callable[[], bool]) -> Self:
        return replace(self, **_completed(self))

    @property
    def path_length(self) -> int:
        return self.max_depth

    @property
    def endless(self) -> bool:
        return self.roulette is not None and self.max_depth == DEEPEST

    @property
    def by_path_buffer(self) -> bool:
        return True

    def recorded(self) -> dict[str, Any]:
        """Return the options that affect the image, so the memory budget is left out."""
        given = super().recorded()
        del given["geometry_budget"]
        if self.endless:
            del given["max_depth"]
        if self.bounce_lod is None:
            del given["bounce_lod"]
        if not self.interleaved:
            del given["interleave"]
        return given


class PathBufferKeywords(TypedDict, total=False):
    """Options of "path-buffer" alone; see `SharedKeywords`."""

    bounce_lod: float | None
