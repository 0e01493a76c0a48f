"""The options of integrators: what all settings are, and the options that several have.

Each integrator's own are in `path_settings`, `gather_settings` and `whitted_settings`; `by_name` lists them all. An
option is written in one of these modules and nowhere else.

A field is an option where its type is `Annotated[type, Meta(description=...)]`: then `render` and `render_frames`
have a parameter of that name, `glpath render` has it as --name with the description as its help, values are checked
against the type and the bounds, a `RenderJob` writes it to JSON and a film's metadata names it. A field without a
description is a setting for experiments: only an instance of the class can have it otherwise than by default.

Literal types are words to choose from, a tuple of these any number of words, `Rgb` is one number or three.
`Meta.extra` may hold "metavar", what the help shows for a value, and "flag", its name on the command line. These
modules load nothing heavy, as the command line reads them before it knows what is asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Literal, Self, TypedDict

from msgspec import Meta

from glpath.errors import UsageError
from glpath.film.aovs import Aov, described
from glpath.sampling import Sampling

Directions = Literal["pair", "lattice", "hemisphere", "sphere"]
Lookup = Literal["interpolated", "constant"]
DirectLight = Literal["traced", "solution"]
Guide = Literal["solution", "cosine"]
Interleave = Literal["always", "never"]
Rgb = tuple[float, float, float]

#: A path counts its casts in eleven bits, up to two a vertex. As `max_depth` it stands for all bounces.
DEEPEST = 1000
#: Russian roulette ends paths by mirrors and glass from this vertex on, where others end sooner.
ROULETTE_OF_MIRRORED = 6
#: Russian roulette ends paths of a gather that do not come to a look-up from this vertex on.
ROULETTE_OF_GATHER = 4
#: Of integrators without a solution.
NO_LOOKUP = {"lookup_depth": "max_depth says how long paths are; only a gather looks up a solution."}

# AOVs of a film of points: those of light, not of the surfaces that an eye sees.
_POINT_AOVS = ("direct", "indirect", "samples")


@dataclass(frozen=True)
class IntegratorSettings(ABC):
    """The options that decide the image; each integrator has its own.

    integrator  : the name that users know it by
    default_spp : path sets by default
    noisy       : whether another seed is another image. Samples of a ray tracer differ only within their pixel
    biased      : whether more samples come to another picture than the light that there is
    any_scene   : whether an engine takes another scene; else another sensor alone
    remedies    : what to do instead of an option that another integrator has
    """

    integrator: ClassVar[str]
    default_spp: ClassVar[int]
    noisy: ClassVar[bool]
    biased: ClassVar[bool] = False
    any_scene: ClassVar[bool] = False
    remedies: ClassVar[Mapping[str, str]] = {}

    seed: Annotated[int, Meta(ge=0, le=2**63, description="another seed is another, independent render")] = 0
    aovs: Annotated[
        tuple[Aov, ...],
        Meta(
            description=f"what the film holds as well, for a denoiser or a compositor: {described()}; or all",
            extra={"flag": "--aov"},
        ),
    ] = ()

    def recorded(self) -> dict[str, Any]:
        """The settings by name, as a film's metadata has them: films merge where these are equal.

        Without the AOVs, which are not part of the image.
        """
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "aovs"}

    @property
    @abstractmethod
    def path_length(self) -> int:
        """How many vertices a path has at most."""

    @property
    def splits_light(self) -> bool:
        """Whether direct light is summed apart."""
        return "direct" in self.aovs or "indirect" in self.aovs

    def check_points(self) -> None:
        """Raise UsageError where paths cannot start at points, or what is asked for is not known there."""
        raise UsageError(
            f'integrator: "{self.integrator}" with a sensor of points; its rays start at a camera.',
            'Take integrator="path", "path-buffer" or "gather".',
        )

    def check_together(self, given: Mapping[str, Any]) -> None:  # noqa: B027 - few need it
        """Raise UsageError for options that mean nothing with others; `given` has what changes the settings."""

    def completed(self, solvable: Callable[[], bool]) -> Self:
        """With what was left open: an option that is None where that means "as the scene allows".

        solvable : whether the scene can have a radiosity solution, in time that is worth it
        """
        return self


# Options that several integrators have.
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
#: MiB; see `GeometryBudget`.
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
    """The options of all integrators with path sets: "path", "path-buffer" and "gather"."""

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
        """Are rays cast by scans of the path-buffer, along directions that all paths of a set share?"""
        return False

    @property
    def interleaved(self) -> bool:
        """Are four pictures of every second pixel made, each with shared directions of its own?"""
        return False

    @property
    def guided(self) -> bool:
        """Do paths choose directions by a radiosity solution?"""
        return False

    @property
    def endless(self) -> bool:
        """Does chance alone end paths? Then the largest max_depth is no end."""
        return False

    @property
    def looks_up(self) -> bool:
        """Do paths end by looking up a radiosity solution?"""
        return False

    @property
    def corrects(self) -> bool:
        """Is a radiosity solution a control variate of paths?"""
        return False

    @property
    def needs_solution(self) -> bool:
        """Does the engine have a radiosity solution, as a guide or to look it up?"""
        return self.guided or self.looks_up


@dataclass(frozen=True)
class SharedDirections:
    """Settings of scans of the path-buffer.

    directions      : see `PathBufferSettings`
    cell_share      : the root of the path-buffer's number of cells, in that of the window's pixels
    cosine_roulette : of bounces with one direction, paths whose cosine is below 1 / this are thinned
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
    """The options that several integrators have as keyword arguments, for type checkers; None is not given."""

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
