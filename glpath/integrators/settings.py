"""The options of every integrator, each written here and nowhere else.

A field is an option where its type is `Annotated[type, Meta(description=...)]`: then `render` and `render_frames`
have a parameter of that name, `glpath render` has it as --name with the description as its help, values are checked
against the type and the bounds, a `RenderJob` writes it to JSON and a film's metadata names it. A field without a
description is a setting for experiments: only an instance of the class can have it otherwise than by default.

Literal types are words to choose from, a tuple of these any number of words, `Rgb` is one number or three.
`Meta.extra` may hold "metavar", what the help shows for a value, and "flag", its name on the command line. This
module loads nothing heavy, as the command line reads it before it knows what is asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, TypedDict

from msgspec import Meta

from glpath.buffers.shadow_test import MAX_TAPS, ShadowTest
from glpath.errors import UsageError
from glpath.film.aovs import Aov, described
from glpath.sampling.points import Sampling
from glpath.scene.model import Scene

Integrator = Literal["auto", "path", "path-buffer", "gather", "classic", "t-buffer"]
Directions = Literal["pair", "lattice", "hemisphere", "sphere"]
Cast = Literal["bvh", "path-buffer"]
Lookup = Literal["interpolated", "constant"]
DirectLight = Literal["traced", "solution"]
Guide = Literal["solution", "cosine"]
Shadows = Literal["rays", "sphere", "cube"]
Primary = Literal["classic", "t-buffer"]
Secondary = Literal["classic", "bvh"]
Rgb = tuple[float, float, float]

#: The integrator that is chosen for a scene, see `glpath.rendering.choice`.
AUTO: Integrator = "auto"
#: A path counts its casts in eleven bits, up to two a vertex. As `max_depth` it stands for all bounces.
DEEPEST = 1000

# Of paths that nothing else ends.
_ROULETTE = 4
_NO_LOOKUP = {"lookup_depth": "max_depth says how long paths are; only a gather looks up a solution."}
_ALL_OF_A_GATHER = "A gather has light of all bounces; lookup_depth says at which vertex it looks up the solution."
# Russian roulette ends a gather's paths by mirrors and glass from this vertex on.
_MIRRORED = 6
# Diffuse bounces of a path before a radiosity solution is its control variate.
_CORRECTED_FROM = 2
# AOVs of a film of points: those of light, not of the surfaces that an eye sees.
_POINT_AOVS = ("direct", "indirect", "samples")
# Options of a gather, by how it casts rays.
_OF_BVH = ("guide", "branches")
_OF_PATH_BUFFER = ("directions", "light_resolution", "cell_share", "cosine_roulette")
_OF_SHADOW_BUFFERS = ("shadow_resolution", "shadow_test", "shadow_filter")


class Solution(Protocol):
    """A `glpath.RadiositySolution`, named without loading it: all of radiosity is slow to import."""

    def check_scene(self, scene: Scene) -> None:
        """Raise SceneError for another scene than the solution's."""


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
_DEPTH = (
    "vertices of a path: 1 is direct light only, 3 two bounces; 1000 is all bounces. With ambient light of the "
    "scene, which stands for further ones, 5 by default"
)
MaxDepth = Annotated[int, Meta(ge=1, le=DEEPEST, description=_DEPTH)]
Ambient = Annotated[
    Rgb | None,
    Meta(
        ge=0,
        description="radiance assumed beyond the last vertex, W sr^-1 m^-2; one number or r, g, b; by default, the "
        "scene's ambient light",
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
_GUIDES = (
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

    @property
    def by_path_buffer(self) -> bool:
        """Are rays cast by scans of the path-buffer, along directions that all paths of a set share?"""
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
    cell_share: float = 1.25
    cosine_roulette: float = 3.0


@dataclass(frozen=True)
class PathSettings(PathSetSettings):
    """Path tracing: each path has its own directions, and a BVH in the shader casts its rays.

    The roulette is Arvo & Kirk's (1990).
    """

    integrator = "path"
    remedies = _NO_LOOKUP | {
        "directions": 'Each path has directions of its own; with integrator="path-buffer" a set shares them.',
        "light_resolution": 'Shadows are rays; with integrator="path-buffer" they are shadow-buffers.',
        "geometry_budget": 'Rays need all triangles in memory; integrator="path-buffer" streams them.',
        "bounce_lod": 'Rays have one BVH; integrator="path-buffer" has a simpler scene for bounces.',
    }

    # Only a gather has this choice: its guides are of the solution that it looks up; a path has no branches.
    radiosity_lookup: ClassVar[Lookup] = "interpolated"
    direct_light: ClassVar[DirectLight] = "traced"

    max_depth: MaxDepth = DEEPEST
    guide: Annotated[
        Guide | None,
        Meta(
            description=_GUIDES,
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
        """Directions that a path takes from its first vertex."""
        return 2 if self.corrects else 1

    def roulette_from(self, mirrored: bool) -> int | None:
        """The vertex from which on Russian roulette ends paths; where a solution is a control variate, those by
        mirrors and glass alone."""
        if self.corrects:
            return _MIRRORED if mirrored else None
        return self.roulette

    def lookup_uniforms(self) -> dict[str, object]:
        """Of paths whose control variate is a radiosity solution."""
        return {"lookup_depth": _CORRECTED_FROM} if self.corrects else {}

    def recorded(self) -> dict[str, Any]:
        """Without a guide where there is none, and without a depth where that ends nothing."""
        unused = [name for name, used in (("guide", self.guided), ("max_depth", not self.endless)) if not used]
        return {k: v for k, v in super().recorded().items() if k not in unused}


def _completed(settings: PathSettings | PathBufferSettings) -> dict[str, Any]:
    """Of paths of all bounces, the vertex from which on chance ends them."""
    return {"roulette": _ROULETTE} if settings.max_depth == DEEPEST and settings.roulette is None else {}


@dataclass(frozen=True)
class PathBufferSettings(SharedDirections, PathSetSettings):
    """Path tracing with the path-buffer [PB 3]: all paths of a set share directions, one scan casts all their rays.

    Ambient light is that of PB A.2, the roulette Arvo & Kirk's (1990).
    """

    integrator = "path-buffer"
    remedies = _NO_LOOKUP | {
        "guide": 'All paths of a set share their directions; paths of integrator="path" choose them.',
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
    geometry_budget: Annotated[
        int,
        Meta(
            ge=1,
            le=1 << 20,
            description="MiB of memory, the device's and the machine's together, for the triangles of shapes of "
            'type "stream"; more is quicker, as chunks then stay on the device',
            extra={"metavar": "MIB"},
        ),
    ] = 1024
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
        """Those that decide something: memory does not."""
        given = super().recorded()
        del given["geometry_budget"]
        if self.endless:
            del given["max_depth"]
        if self.bounce_lod is None:
            del given["bounce_lod"]
        return given


@dataclass(frozen=True)
class GatherSettings(SharedDirections, PathSetSettings):
    """The image gathered from a radiosity solution [PB 4]: light of all bounces at what the eye sees.

    With cast "path-buffer" it is the paper's local pass; its `directions` are a setting for experiments.
    """

    integrator = "gather"
    default_spp = 64
    biased = True
    remedies: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("max_depth", "roulette"), _ALL_OF_A_GATHER),
        "ambient": "A gather has light of all bounces from its solution: none is left to assume.",
        "directions": 'With cast="path-buffer" all paths of a set share directions, each takes the better of two.',
    }

    # Not for a gather: its solution is of the scene itself, and has light of all bounces.
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
            description="a path that would look up nearer to where it came from than a random share of so many "
            "widths of an element continues to a further vertex, with rays of its own to a second one where that "
            "is near as well; 0: none does, as in the paper",
            extra={"metavar": "WIDTHS"},
        ),
    ] = 1.0
    guide: Annotated[Guide, Meta(description=_GUIDES)] = "solution"
    branches: Annotated[
        int,
        Meta(
            ge=1,
            le=4,
            description='of cast "bvh": how many directions a path takes from its first vertex, sharing what the '
            "eye sees and its light; where few path sets are for a denoiser, 1 is quicker",
        ),
    ] = 2

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
        """The vertex from which on roulette ends paths: those by mirrors and glass alone, as others are short."""
        return _MIRRORED if mirrored else None

    def lookup_uniforms(self) -> dict[str, object]:
        """Where the solution is looked up, as path/path_rays.glsl knows it."""
        return {"lookup_depth": self.lookup_depth - 1, "lookup_distance": self.lookup_distance}

    def recorded(self) -> dict[str, Any]:
        """Those that decide something. What is recorded of the solution is its digest, known when it is there."""
        unused = _OF_BVH if self.by_path_buffer else _OF_PATH_BUFFER
        return {k: v for k, v in super().recorded().items() if k not in ("radiosity", "radiosity_lookup", *unused)}

    def check_together(self, given: Mapping[str, Any]) -> None:
        cast = given.get("cast", self.cast)
        other, names = ("bvh", _OF_BVH) if cast == "path-buffer" else ("path-buffer", _OF_PATH_BUFFER)
        for name in names:
            if name in given:
                raise UsageError(
                    f'{name}: {given[name]!r} with cast "{cast}"; it is an option of cast "{other}"',
                    f'Take cast="{other}", or leave it out.',
                )


# Two integrators have it, with another default each.
SecondaryRays = Annotated[
    Secondary,
    Meta(
        description='reflections and shadow rays: by a "bvh", a tree of boxes, or "classic", every object in turn, '
        "as in the paper"
    ),
]


@dataclass(frozen=True)
class WhittedSettings(IntegratorSettings):
    """Whitted's ray tracing [TB IV]; `primary` says how what the eye sees is found."""

    default_spp = 16
    noisy = False
    any_scene = True
    primary: ClassVar[Primary]
    remedies = _NO_LOOKUP

    max_depth: Annotated[int, Meta(ge=1, le=DEEPEST, description=_DEPTH)] = 5
    shadows: Annotated[
        Shadows,
        Meta(description='"rays", exact; or shadow-buffers: the paper\'s "sphere", or a "cube" of six faces'),
    ] = "rays"
    shadow_resolution: Annotated[
        int,
        Meta(
            ge=1,
            le=1 << 15,
            description="rows of a sphere's shadow-buffer (twice as many columns), texels along a cube's side",
        ),
    ] = 1024
    shadow_test: Annotated[
        ShadowTest,
        Meta(
            description='a shadow-buffer\'s rule: "distance", or "identity" as in the paper, wrong where an object '
            "shadows itself"
        ),
    ] = "distance"
    shadow_filter: Annotated[
        int,
        Meta(
            ge=1,
            le=MAX_TAPS,
            description="cells across that a lookup in a shadow-buffer asks, for smooth edges (percentage-closer "
            "filtering); 1 for the nearest alone, as in the paper",
        ),
    ] = 2
    secondary: SecondaryRays = "bvh"
    light_samples: Annotated[
        int,
        Meta(
            ge=1,
            le=64,
            description="points of emitting shapes and directions of the sky that each path set is lit by; the sky "
            "lights surfaces where the scene has no ambient light, which stands for it",
        ),
    ] = 4
    count_tests: Annotated[
        bool,
        Meta(description='count intersection tests, `statistics["intersection_tests"]` of the film; slower'),
    ] = False

    def recorded(self) -> dict[str, Any]:
        """Those that decide something: counting does not, and shadow rays have no shadow-buffer."""
        given = super().recorded()
        del given["count_tests"]
        if self.shadows == "rays":
            for name in _OF_SHADOW_BUFFERS:
                del given[name]
        return given

    @property
    def path_length(self) -> int:
        return self.max_depth

    def check_together(self, given: Mapping[str, Any]) -> None:
        if given.get("shadows", self.shadows) != "rays":
            return
        for name in _OF_SHADOW_BUFFERS:
            if name in given:
                raise UsageError(
                    f"{name}: {given[name]!r} with shadow rays; it is an option of shadow-buffers",
                    'Take shadows "sphere" or "cube".',
                )


@dataclass(frozen=True)
class ClassicSettings(WhittedSettings):
    """Ray tracing by the classical algorithm: every ray against every object."""

    integrator = "classic"
    primary = "classic"

    secondary: SecondaryRays = "classic"


@dataclass(frozen=True)
class TBufferSettings(WhittedSettings):
    """Ray tracing with the T-buffer [TB III]: object by object, only the rays of its projection."""

    integrator = "t-buffer"
    primary = "t-buffer"


#: By the names that users give. A new integrator is a line here, and one in `glpath.rendering.factory.PLANS`.
INTEGRATORS: dict[str, type[IntegratorSettings]] = {
    settings.integrator: settings
    for settings in (PathSettings, PathBufferSettings, GatherSettings, ClassicSettings, TBufferSettings)
}


class IntegratorKeywords(TypedDict, total=False):
    """The options of all integrators as keyword arguments, for type checkers; None is not given."""

    seed: int
    aovs: str | tuple[Aov, ...]
    sampling: Sampling | None
    max_depth: int | None
    guide: Guide | None
    ambient: float | Rgb | None
    roulette: int | None
    directions: Directions | None
    light_resolution: int | None
    geometry_budget: int | None
    bounce_lod: float | None
    lookup_depth: int | None
    cast: Cast | None
    radiosity: str | Solution | Path | None
    radiosity_lookup: Lookup | None
    direct_light: DirectLight | None
    lookup_distance: float | None
    branches: int | None
    shadows: Shadows | None
    shadow_resolution: int | None
    shadow_test: ShadowTest | None
    shadow_filter: int | None
    secondary: Secondary | None
    light_samples: int | None
    count_tests: bool
