"""Options of integrators: the base of all settings, and the options that several integrators have.

The options of single integrators are in `path_settings`, `gather_settings` and `whitted_settings`; `by_name` lists
them all. An option is declared in one of these modules and nowhere else.

A field is an option if its type is `Annotated[type, Meta(description=...)]`. Then `render` and `render_frames` have
a parameter of that name, and `glpath render` has --name with the description as its help. Values are checked
against the type and the bounds, a `RenderJob` writes the option to JSON, and a film's metadata contains it. A field
without a description is a setting for experiments: only an instance of the class can change its default.

Literal types are words to choose from, a tuple of these is any number of words, `Rgb` is one number or three.
`Meta.extra` may hold "metavar", the help's placeholder for a value, and "flag", the name on the command line. These
modules import nothing slow, because the command line reads them before it knows the command.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Literal, Self, TypedDict

from msgspec import Meta

from glpath.errors import UsageError, argument
from glpath.film.aovs import Aov, described
from glpath.sampling import Sampling

Directions = Literal["pair", "lattice", "hemisphere", "sphere"]
Lookup = Literal["interpolated", "constant"]
DirectLight = Literal["traced", "solution"]
Guide = Literal["solution", "cosine"]
Interleave = Literal["always", "never"]
Rgb = tuple[float, float, float]

#: Maximum of `max_depth`; this value means all bounces. A path counts its rays, up to two a vertex, in eleven bits.
DEEPEST = 1000
#: Vertex from which on Russian roulette ends paths by mirrors and glass, where other paths end sooner.
ROULETTE_OF_MIRRORED = 6
#: Vertex from which on Russian roulette ends those paths of a gather that end without a look-up.
ROULETTE_OF_GATHER = 4
#: Function that returns the text of a remedy.
Remedy = Callable[[], str]
#: Hints for users who give an option of look-ups to an integrator that looks up no solution.
NO_LOOKUP: Mapping[str, Remedy] = {
    "lookup_depth": lambda: "max_depth says how long paths are; only a gather looks up a solution."
}

# AOVs that a film of points can have: only those of light, because no camera sees a surface.
_POINT_AOVS = ("direct", "indirect", "samples")


@dataclass(frozen=True)
class IntegratorSettings(ABC):
    """Options that affect the image; each integrator has its own.

    integrator  : name for users
    default_spp : default number of path sets
    noisy       : True if another seed gives another image. Samples of a ray tracer differ only within their pixel
    biased      : True if the estimator is biased: more samples do not converge to the exact radiance
    any_scene   : True if an engine can change its scene; otherwise it can only change its sensor
    remedies    : alternatives to options that other integrators have, in the notation of the user's interface
    """

    integrator: ClassVar[str]
    default_spp: ClassVar[int]
    noisy: ClassVar[bool]
    biased: ClassVar[bool] = False
    any_scene: ClassVar[bool] = False
    remedies: ClassVar[Mapping[str, Remedy]] = {}

    seed: Annotated[int, Meta(ge=0, le=2**63, description="another seed is another, independent render")] = 0
    aovs: Annotated[
        tuple[Aov, ...],
        Meta(
            description=f"what the film holds as well, for a denoiser or a compositor: {described()}; or all",
            extra={"flag": "--aov"},
        ),
    ] = ()

    def recorded(self) -> dict[str, Any]:
        """Return the settings by name for a film's metadata; films can be merged only if these are equal.

        AOVs are left out, because they are not part of the image.
        """
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "aovs"}

    @property
    @abstractmethod
    def path_length(self) -> int:
        """Maximum number of vertices of a path."""

    @property
    def splits_light(self) -> bool:
        """True if direct light is summed separately."""
        return "direct" in self.aovs or "indirect" in self.aovs

    def check_points(self) -> None:
        """Raise UsageError if paths cannot start at points, or if an option does not apply there."""
        raise UsageError(
            f'integrator: "{self.integrator}" with a sensor of points; its rays start at a camera.',
            f"Take {argument('integrator', 'path', 'path-buffer', 'gather')}.",
        )

    def check_together(self, given: Mapping[str, Any]) -> None:  # noqa: B027 - few need it
        """Raise UsageError for options that conflict; `given` holds the options that change the settings."""

    def completed(self, solvable: Callable[[], bool]) -> Self:
        """Return the settings with all open options decided: those whose None means "as the scene allows".

        solvable : function that returns True if the scene can have a radiosity solution in reasonable time
        """
        return self


# Options that several integrators share.
DEPTH = (
    "vertices of a path: 1 is direct light only, 3 two bounces; 1000 is all bounces. With ambient light of the "
    "scene, which stands for further ones, 5 by default"
)
MaxDepth = Annotated[int, Meta(ge=1, le=DEEPEST, description=DEPTH)]
Ambient = Annotated[
    Rgb | None,
    Meta(
        ge=0,
        description="radiance assumed beyond the last vertex, W sr^-1 m^-2; one number or r, g, b; by default, the "
        "scene's ambient light",
    ),
]
#: Default of `GeometryBudget`, MiB.
GEOMETRY_BUDGET = 1024
GeometryBudget = Annotated[
    int,
    Meta(
        ge=1,
        le=1 << 20,
        description="MiB of memory, the device's and the machine's together, for the triangles of shapes of "
        'type "stream"; more is quicker, as chunks then stay on the device',
        extra={"metavar": "MIB"},
    ),
]
Roulette = Annotated[
    int | None,
    Meta(
        ge=1,
        le=DEEPEST,
        description="from this vertex on, Russian roulette ends paths, without bias. With a max-depth of 1000, the "
        'most, nothing else ends those of "path"',
        extra={"metavar": "DEPTH", "unset": "4 with a max-depth of 1000, else never"},
    ),
]
GUIDES = (
    'what directions are chosen by: the light that a radiosity "solution" says comes from there ("path" has a '
    'coarse one made first, and stays unbiased), or the "cosine" alone; of a gather, with cast "bvh"'
)
LightResolution = Annotated[
    int,
    Meta(
        ge=16,
        le=4096,
        multiple_of=2,
        description="texels along a side of the hemicube about a path set's light sample, even; what is finer than "
        'one throws a wrong shadow; of a gather with cast "path-buffer"',
    ),
]


@dataclass(frozen=True)
class PathSetSettings(IntegratorSettings):
    """Options of all integrators with path sets: "path", "path-buffer" and "gather"."""

    default_spp = 256
    noisy = True

    sampling: Annotated[
        Sampling,
        Meta(description='where numbers come from: a "sobol" sequence, or "random" as in the paper'),
    ] = "sobol"

    def check_points(self) -> None:
        seen = [name for name in self.aovs if name not in _POINT_AOVS]
        if seen:
            raise UsageError(
                f"aovs: {', '.join(seen)} with a sensor of points, from which no surface is seen.",
                f"Of points there are {', '.join(_POINT_AOVS)}.",
            )
        if self.interleaved:
            raise UsageError(
                'interleave: "always" with a sensor of points, which are not denoised.',
                'Leave it out, or take "never".',
            )

    @property
    def by_path_buffer(self) -> bool:
        """True if scans of the path-buffer cast the rays, along directions that all paths of a set share."""
        return False

    @property
    def interleaved(self) -> bool:
        """True if four images of every second pixel are made, each with its own shared directions."""
        return False

    @property
    def guided(self) -> bool:
        """True if a radiosity solution guides the directions of paths."""
        return False

    @property
    def endless(self) -> bool:
        """True if only roulette ends paths; then the largest max_depth is no limit."""
        return False

    @property
    def looks_up(self) -> bool:
        """True if paths end with a look-up of a radiosity solution."""
        return False

    @property
    def corrects(self) -> bool:
        """True if a radiosity solution is a control variate of paths."""
        return False

    @property
    def needs_solution(self) -> bool:
        """True if the engine needs a radiosity solution, as a guide or for look-ups."""
        return self.guided or self.looks_up


@dataclass(frozen=True)
class SharedDirections:
    """Settings of scans of the path-buffer.

    directions      : see `PathBufferSettings`
    cell_share      : square root of the ratio of path-buffer cells to window pixels
    cosine_roulette : for bounces with one direction, paths whose cosine is below 1 / this value are thinned
    """

    directions: Directions = "pair"
    light_resolution: LightResolution = 256
    interleave: Annotated[
        Interleave | None,
        Meta(
            description="whether every second pixel across and down has path sets of its own, four for a picture: "
            "what shared directions leave is then noise, which a denoiser removes. Work per triangle is done four "
            'times; of "path-buffer", and of a gather with cast "path-buffer"',
            extra={"unset": "always where a picture is to be denoised and triangles are few beside its pixels"},
        ),
    ] = None
    cell_share: float = 1.25
    cosine_roulette: float = 3.0

    @property
    def interleaved(self) -> bool:
        return self.interleave == "always"


class SharedKeywords(TypedDict, total=False):
    """Options of several integrators as keyword arguments, for type checkers; None means not given."""

    seed: int
    aovs: str | tuple[Aov, ...]
    sampling: Sampling | None
    max_depth: int | None
    guide: Guide | None
    ambient: float | Rgb | None
    roulette: int | None
    directions: Directions | None
    light_resolution: int | None
    interleave: Interleave | None
    geometry_budget: int | None
