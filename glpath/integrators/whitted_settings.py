"""Options of Whitted's ray tracing: "t-buffer" and "classic"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypedDict

from msgspec import Meta

from glpath.buffers.shadow_options import MAX_TAPS, ShadowTest
from glpath.errors import UsageError
from glpath.integrators.settings import (
    DEEPEST,
    DEPTH,
    GEOMETRY_BUDGET,
    NO_LOOKUP,
    GeometryBudget,
    IntegratorSettings,
)
from glpath.system.arguments import short_repr

Shadows = Literal["rays", "sphere", "cube"]
Primary = Literal["classic", "t-buffer"]
Secondary = Literal["classic", "bvh"]

_OF_SHADOW_BUFFERS = ("shadow_resolution", "shadow_test", "shadow_filter")

# Option of two integrators, which have different defaults.
SecondaryRays = Annotated[
    Secondary,
    Meta(
        description='reflections and shadow rays: by a "bvh", a tree of boxes, or "classic", every object in turn, '
        "as in the paper"
    ),
]


@dataclass(frozen=True)
class WhittedSettings(IntegratorSettings):
    """Options of Whitted's ray tracing [TB IV]; `primary` selects the algorithm of primary visibility."""

    default_spp = 16
    noisy = False
    any_scene = True
    primary: ClassVar[Primary]
    remedies = NO_LOOKUP

    max_depth: Annotated[int, Meta(ge=1, le=DEEPEST, description=DEPTH)] = 5
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
        """Return the options that affect the image, without `count_tests` and unused shadow-buffer options."""
        given = super().recorded()
        del given["count_tests"]
        if self.shadows == "rays":
            for name in _OF_SHADOW_BUFFERS:
                del given[name]
        return given

    @property
    def path_length(self) -> int:
        return self.max_depth

    @property
    def stream_budget(self) -> int | None:
        """MiB for streamed triangles; None if all triangles must be in memory."""
        return None

    def check_together(self, given: Mapping[str, Any]) -> None:
        shadows = given.get("shadows", self.shadows)
        if not isinstance(shadows, str) or shadows != "rays":
            return
        for name in _OF_SHADOW_BUFFERS:
            if name in given:
                raise UsageError(
                    f"{name}: {short_repr(given[name])} with shadow rays; it is an option of shadow-buffers",
                    'Take shadows "sphere" or "cube".',
                )


@dataclass(frozen=True)
class ClassicSettings(WhittedSettings):
    """Options of ray tracing by the classical algorithm, which tests every ray against every object."""

    integrator = "classic"
    primary = "classic"

    secondary: SecondaryRays = "classic"


@dataclass(frozen=True)
class TBufferSettings(WhittedSettings):
    """Options of the T-buffer [TB III]. Each object is tested only against the rays in its projection."""

    integrator = "t-buffer"
    primary = "t-buffer"

    geometry_budget: GeometryBudget = GEOMETRY_BUDGET

    def recorded(self) -> dict[str, Any]:
        """Return the options that affect the image, without the memory budget."""
        given = super().recorded()
        del given["geometry_budget"]
        return given

    @property
    def stream_budget(self) -> int | None:
        return self.geometry_budget


class WhittedKeywords(TypedDict, total=False):
    """Options that only "t-buffer" and "classic" have, as keyword arguments for type checkers."""

    shadows: Shadows | None
    shadow_resolution: int | None
    shadow_test: ShadowTest | None
    shadow_filter: int | None
    secondary: Secondary | None
    light_samples: int | None
    count_tests: bool
