"""Options of the gather from a radiosity solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, TypedDict

from msgspec import Meta

from glpath.errors import UsageError, argument
from glpath.integrators.settings import (
    DEEPEST,
    GEOMETRY_BUDGET,
    GUIDES,
    ROULETTE_OF_GATHER,
    DirectLight,
    GeometryBudget,
    Guide,
    Lookup,
    PathSetSettings,
    Remedy,
    Rgb,
    SharedDirections,
)
from glpath.system.arguments import short_repr

if TYPE_CHECKING:
    from glpath.scene.model import Scene

Cast = Literal["bvh", "path-buffer"]

_ALL_OF_A_GATHER = "A gather has light of all bounces; lookup_depth says at which vertex it looks up the solution."
# Options that apply to only one method of casting rays.
_OF_BVH = ("guide", "branches")
_OF_PATH_BUFFER = (
    "directions",
    "light_resolution",
    "interleave",
    "cell_share",
    "cosine_roulette",
    "geometry_budget",
)
# Options that are not recorded as given. A digest of the solution replaces the first two, `refined` is recorded
# only if it is True, and the others do not affect the image.
_NOT_RECORDED = ("radiosity", "radiosity_lookup", "geometry_budget", "or_path", "refined")


class Solution(Protocol):
    """Interface of `glpath.RadiositySolution`. It is declared here, because importing that class is slow."""

    def check_scene(self, scene: Scene) -> None:
        """Raise SceneError if the solution belongs to another scene."""


@dataclass(frozen=True)
class GatherSettings(SharedDirections, PathSetSettings):
    """Options of a gather [PB 4], whose paths end with a look-up of a radiosity solution.

    With cast "path-buffer", the gather is the paper's local pass. Its `directions` are a setting for experiments.

    or_path : True if "path" replaces the gather when its measured bias is too large; set by the integrator "auto"
    refined : True if the solution has finer elements than by default, because the default ones caused too much bias
    """

    integrator = "gather"
    default_spp = 64
    biased = True
    remedies: ClassVar[Mapping[str, Remedy]] = {
        **dict.fromkeys(("max_depth", "roulette"), lambda: _ALL_OF_A_GATHER),
        "ambient": lambda: "A gather has light of all bounces from its solution: none is left to assume.",
        "directions": lambda: (
            f"With {argument('cast', 'path-buffer')} all paths of a set share directions, each takes the better of "
            "two."
        ),
    }

    # A gather does not have these options, because its solution is for the unsimplified scene and has light of all
    # bounces.
    bounce_lod: ClassVar[None] = None
    ambient: ClassVar[Rgb] = (0.0, 0.0, 0.0)

    lookup_depth: Annotated[
        int,
        Meta(
            ge=2,
            le=DEEPEST,
            description="the vertex at which the solution is looked up; more than 2, the paper's, where the coarse "
            "solution shows in corners",
        ),
    ] = 2
    cast: Annotated[
        Cast,
        Meta(
            description='how rays are cast: by a "bvh" in the shader, along directions of each path\'s own; or by '
            'scans of the "path-buffer", along directions that all paths of a set share, as in the paper'
        ),
    ] = "bvh"
    radiosity: Annotated[
        Solution | Path | None,
        Meta(
            description="a file of `glpath radiosity`, or in Python a `RadiositySolution`, of the scene (whatever "
            "its camera); without, the scene is solved first, coarsely, by particles",
            extra={"metavar": "FILE"},
        ),
    ] = None
    radiosity_lookup: Annotated[
        Lookup,
        Meta(description='"interpolated" between the vertices of an element, or "constant" over it'),
    ] = "interpolated"
    direct_light: Annotated[
        DirectLight,
        Meta(
            description='light straight from lamps where the solution is looked up: "traced", with shadows of its '
            'own, or from the "solution", as in the paper'
        ),
    ] = "traced"
    lookup_distance: Annotated[
        float,
        Meta(
            ge=0,
            le=1000,
            description="a path shorter than a random share of so many widths of an element continues to a further "
            "vertex, instead of a look-up of the solution; 0: none does, as in the paper",
            extra={"metavar": "WIDTHS"},
        ),
    ] = 1.0
    guide: Annotated[Guide, Meta(description=GUIDES)] = "solution"
    branches: Annotated[
        int,
        Meta(
            ge=1,
            le=4,
            description='of cast "bvh": how many directions a path takes from its first vertex, sharing what the '
            "eye sees and its light; where few path sets are for a denoiser, 1 is quicker",
        ),
    ] = 2

    geometry_budget: GeometryBudget = GEOMETRY_BUDGET
    or_path: bool = False
    refined: bool = False

    @property
    def path_length(self) -> int:
        return self.lookup_depth

    @property
    def by_path_buffer(self) -> bool:
        return self.cast == "path-buffer"

    @property
    def guided(self) -> bool:
        return self.guide == "solution" and self.cast == "bvh"

    @property
    def looks_up(self) -> bool:
        return True

    def roulette_from(self, mirrored: bool) -> int | None:
        """Return the vertex from which on roulette may end a path that has not yet ended with a look-up.

        Such a path went through mirrors or glass, or between surfaces that are close to each other.
        """
        return ROULETTE_OF_GATHER

    def lookup_uniforms(self) -> dict[str, object]:
        """Return the uniforms of path/path_rays.glsl that control the look-up of the solution."""
        return {"lookup_depth": self.lookup_depth - 1, "lookup_distance": self.lookup_distance}

    def recorded(self) -> dict[str, Any]:
        """Return the options that affect the image, without the solution, whose digest is recorded separately."""
        unused = _OF_BVH if self.by_path_buffer else _OF_PATH_BUFFER
        if not self.interleaved:
            unused = (*unused, "interleave")
        recorded = {k: v for k, v in super().recorded().items() if k not in (*_NOT_RECORDED, *unused)}
        return recorded | ({"refined": True} if self.refined else {})

    def check_together(self, given: Mapping[str, Any]) -> None:
        cast = given.get("cast", self.cast)
        if not isinstance(cast, str):
            return  # the check of each value raises the error
        other, names = ("bvh", _OF_BVH) if cast == "path-buffer" else ("path-buffer", _OF_PATH_BUFFER)
        for name in names:
            if name in given:
                raise UsageError(
                    f'{name}: {short_repr(given[name])} with cast "{cast}"; it is an option of cast "{other}"',
                    f"Take {argument('cast', other)}, or leave it out.",
                )


class GatherKeywords(TypedDict, total=False):
    """Options that only "gather" has, as keyword arguments for type checkers; None means not given."""

    lookup_depth: int | None
    cast: Cast | None
    radiosity: str | Solution | Path | None
    radiosity_lookup: Lookup | None
    direct_light: DirectLight | None
    lookup_distance: float | None
    branches: int | None
