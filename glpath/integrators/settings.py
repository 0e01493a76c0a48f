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

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol

from msgspec import Meta

from glpath.buffers.shadow_test import MAX_TAPS, ShadowTest
from glpath.errors import UsageError
from glpath.film.metadata import Aov
from glpath.sampling.points import Sampling
from glpath.scene.model import Scene

Integrator = Literal["path", "gather", "classic", "t-buffer"]
Directions = Literal["own", "pair", "lattice", "hemisphere", "sphere"]
Lookup = Literal["interpolated", "constant"]
DirectLight = Literal["traced", "solution"]
Guide = Literal["solution", "cosine"]
Shadows = Literal["rays", "sphere", "cube"]
Primary = Literal["classic", "t-buffer"]
Secondary = Literal["classic", "bvh"]
Rgb = tuple[float, float, float]

#: A path counts its casts in eleven bits, up to two a vertex.
DEEPEST = 1000


class Solution(Protocol):
    """A `glpath.RadiositySolution`, named without loading it: all of radiosity is slow to import."""

    def check_scene(self, scene: Scene) -> None:
        """Raise SceneError for another scene than the solution's."""


@dataclass(frozen=True)
class IntegratorSettings:
    """What decides the image besides the scene, the sensor and the path sets; each integrator has its own.

    integrator  : the name that users know it by
    default_spp : path sets where it is not said how many
    noisy       : whether another seed is another image. Samples of a ray tracer differ only within their pixel
    """

    integrator: ClassVar[str]
    default_spp: ClassVar[int]
    noisy: ClassVar[bool]

    max_depth: Annotated[
        int,
        Meta(ge=1, le=DEEPEST, description="vertices of a path: 1 is direct light only, 3 two bounces"),
    ] = 5
    seed: Annotated[int, Meta(ge=0, le=2**63, description="another seed is another, independent render")] = 0
    aovs: Annotated[
        tuple[Aov, ...],
        Meta(
            description="what the film holds as well, for a denoiser or a compositor: of the surfaces that the eye "
            'sees, "albedo", "normal", "depth", "depth_min" (of the nearest, no mean), "position", "object_id" and '
            '"material_id" (one number a pixel; with their Cryptomatte); of the light, "direct" and "indirect"; '
            'how many "samples"; or "all"',
            extra={"flag": "--aov"},
        ),
    ] = ()

    def recorded(self) -> dict[str, Any]:
        """The settings by name, as a film's metadata has them: films merge where these are equal.

        Without the AOVs, which are beside the image.
        """
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "aovs"}

    @property
    def splits_light(self) -> bool:
        """Whether direct light is summed by itself."""
        return "direct" in self.aovs or "indirect" in self.aovs

    @classmethod
    def check_together(cls, given: Mapping[str, Any]) -> None:
        """Raise UsageError for options that mean nothing beside others; `given` has those that were set."""


# Two integrators have it, with another default each: a path tracer would be later with its first picture.
GuidedBy = Annotated[
    Guide,
    Meta(
        description='what directions "own" are chosen by: the light that a radiosity "solution" says comes from '
        'there (path tracing has a coarse one made first, and stays unbiased), or the "cosine" alone'
    ),
]


@dataclass(frozen=True)
class PathSetSettings(IntegratorSettings):
    """What "path" and "gather" have in common.

    cell_share      : the root of the path-buffer's number of cells, in that of the window's pixels
    cosine_roulette : of bounces with one direction, paths whose cosine is below 1 / this are thinned
    """

    default_spp = 256
    noisy = True

    sampling: Annotated[
        Sampling,
        Meta(description='where numbers come from: a "sobol" sequence, or "random" as in the paper'),
    ] = "sobol"
    directions: Annotated[
        Directions,
        Meta(
            description='of a bounce: "own", each path another, its ray cast by a BVH; or shared by all paths of a '
            'set and cast by a scan of the path-buffer: "pair", each path the better of two; "lattice", one of a '
            'lattice for the first bounce, then as "pair"; "hemisphere", one; "sphere", as in the paper'
        ),
    ] = "own"
    light_resolution: Annotated[
        int,
        Meta(
            ge=16,
            le=4096,
            multiple_of=2,
            description="of shared directions: texels along a side of the hemicube about a path set's light point, "
            "even; what is finer than one throws a wrong shadow",
        ),
    ] = 256
    guide: GuidedBy = "cosine"
    cell_share: float = 1.25
    cosine_roulette: float = 3.0

    @property
    def guided(self) -> bool:
        """Do paths go by a radiosity solution?"""
        return self.guide == "solution" and self.directions == "own"

    def recorded(self) -> dict[str, Any]:
        """Those that decide something: rays of one's own need no buffer."""
        given = super().recorded()
        if self.directions == "own":
            for name in _OF_PATH_BUFFERS:
                del given[name]
        else:
            del given["guide"]
        return given

    @classmethod
    def check_together(cls, given: Mapping[str, Any]) -> None:
        if given.get("directions", "own") == "own" and "light_resolution" in given:
            raise UsageError(
                f'light_resolution: {given["light_resolution"]!r} with directions "own"; it is an option of shared '
                "directions",
                'Take directions "pair", "lattice", "hemisphere" or "sphere".',
            )
        if given.get("directions", "own") != "own" and "guide" in given:
            raise UsageError(
                f'guide: "{given["guide"]}" with directions "{given["directions"]}", which a set\'s paths share',
                'Take directions "own".',
            )


@dataclass(frozen=True)
class PathTraceSettings(PathSetSettings):
    """Path tracing with the path-buffer [PB 3]: global illumination by every kind of light.

    Ambient light is that of PB A.2, the roulette Arvo & Kirk's (1990).
    """

    integrator = "path"

    ambient: Annotated[
        Rgb | None,
        Meta(
            ge=0,
            description="radiance assumed beyond the last vertex, W sr^-1 m^-2; one number or r, g, b; by itself, "
            "the scene's ambient light",
        ),
    ] = None
    roulette: Annotated[
        int | None,
        Meta(
            ge=1,
            le=DEEPEST,
            description="from this vertex on, paths end by chance, without bias. With a max-depth of 1000, the "
            'most, nothing else ends those of directions "own"',
            extra={"metavar": "DEPTH", "unset": "never"},
        ),
    ] = None
    geometry_budget: Annotated[
        int,
        Meta(
            ge=1,
            le=1 << 20,
            description="of shared directions: MiB of memory, the device's and the machine's together, for the "
            'triangles of shapes of type "stream"; more is quicker, as chunks then stay on the device',
            extra={"metavar": "MIB"},
        ),
    ] = 1024

    bounce_lod: Annotated[
        float | None,
        Meta(
            ge=0.001,
            le=1,
            description="of shared directions: from their second vertex on paths meet a simpler scene, of this "
            "share of the triangles of plain meshes; quicker in large scenes, not quite right. By itself, never",
            extra={"metavar": "SHARE"},
        ),
    ] = None

    def recorded(self) -> dict[str, Any]:
        """A film that is not guided is as those from before there were guides; memory decides nothing."""
        given = super().recorded()
        del given["geometry_budget"]
        if self.bounce_lod is None:
            del given["bounce_lod"]
        return {k: v for k, v in given.items() if k != "guide" or self.guided}

    @classmethod
    def check_together(cls, given: Mapping[str, Any]) -> None:
        super().check_together(given)
        if given.get("directions", "own") == "own" and "geometry_budget" in given:
            raise UsageError(
                f'geometry_budget: {given["geometry_budget"]!r} with directions "own", whose rays want all '
                "triangles in memory; it is an option of shared directions",
                'Take directions "pair", "lattice", "hemisphere" or "sphere".',
            )
        if given.get("directions", "own") == "own" and given.get("bounce_lod") is not None:
            raise UsageError(
                f'bounce_lod: {given["bounce_lod"]!r} with directions "own", whose rays have one tree of boxes; it '
                "is an option of shared directions",
                'Take directions "pair", "lattice", "hemisphere" or "sphere".',
            )


@dataclass(frozen=True)
class GatherSettings(PathSetSettings):
    """The image gathered from a radiosity solution [PB 4]: light of all bounces at what the eye sees."""

    integrator = "gather"

    max_depth: Annotated[
        int,
        Meta(
            ge=2,
            le=DEEPEST,
            description="the vertex at which the solution is looked up; more than 2, the paper's, where the coarse "
            "solution shows in corners",
        ),
    ] = 2
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
            "widths of an element goes on to a further vertex, with rays of its own to a second one where that is "
            "near as well; 0: none does, as in the paper",
            extra={"metavar": "WIDTHS"},
        ),
    ] = 1.0
    guide: GuidedBy = "solution"
    branches: Annotated[
        int,
        Meta(
            ge=1,
            le=4,
            description='of directions "own": how many a path takes from its first vertex, sharing what the eye '
            "sees and its light; where few path sets are for a denoiser, 1 is quicker",
        ),
    ] = 2

    def recorded(self) -> dict[str, Any]:
        """Without the solution: what is recorded of it is its digest, known when it is there."""
        given = super().recorded()
        del given["radiosity"], given["radiosity_lookup"]
        if self.directions != "own":
            del given["branches"]
        return given

    @classmethod
    def check_together(cls, given: Mapping[str, Any]) -> None:
        super().check_together(given)
        if given.get("directions", "own") != "own" and "branches" in given:
            raise UsageError(
                f'branches: {given["branches"]!r} with directions "{given["directions"]}", which paths share',
                'Take directions "own".',
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
    primary: ClassVar[Primary]

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

    @classmethod
    def check_together(cls, given: Mapping[str, Any]) -> None:
        if given.get("shadows", "rays") != "rays":
            return
        for name in _OF_SHADOW_BUFFERS:
            if name in given:
                raise UsageError(
                    f"{name}: {given[name]!r} with shadow rays; it is an option of shadow-buffers",
                    'Take shadows "sphere" or "cube".',
                )


_OF_PATH_BUFFERS = ("light_resolution", "cell_share", "cosine_roulette")
_OF_SHADOW_BUFFERS = ("shadow_resolution", "shadow_test", "shadow_filter")


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


#: By the names that users give. A new integrator is a line here, and a branch in `glpath.rendering.factory`.
INTEGRATORS: dict[str, type[IntegratorSettings]] = {
    settings.integrator: settings
    for settings in (PathTraceSettings, GatherSettings, ClassicSettings, TBufferSettings)
}
