"""Light samples of all kinds, and the light of punctual lights: result types of `lighting`.

Source:   PB 3.3 and A.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64, Light, Scene
from glpath.scene.spot_cone import spot_fade

Kind = Literal["point", "spot", "directional", "area", "sky"]
#: Kinds of light; their numbers in GLSL are their indices here.
LIGHT_KINDS: tuple[Kind, ...] = ("point", "spot", "directional", "area", "sky")


@dataclass(frozen=True)
class LightSample:
    """One light sample, drawn from all lights of a scene.

    kind      : kind of the light
    position  : (3,) position of an area light's point, a point light or a spot; undefined for the others
    direction : (3,) unit, direction in which light travels: normal of the emitting side, axis of a spot, or
                direction of a directional light or of this part of the sky; undefined for a point light
    radiance  : (3,) W sr^-1 m^-2 of area light and sky; otherwise `Light.intensity`, W sr^-1 or W m^-2
    density   : probability of the light, times the density per area of an area light's point, or per solid angle of
                the sky's direction
    cone      : cosines of the two angles from a spot's axis at which full light ends, and at which all light ends
    quadratic : True if light of a point or spot falls off with the squared distance
    profile   : 1 plus the index in `profiled_lights` of a light with a profile; otherwise 0
    """

    kind: Kind
    position: Float64
    direction: Float64
    radiance: Float64
    density: float
    cone: tuple[float, float] = (-1.0, -1.0)
    quadratic: bool = True
    profile: int = 0

    @property
    def distant(self) -> bool:
        """True if the light comes from infinitely far."""
        return self.kind in ("directional", "sky")

    @property
    def cube_faces(self) -> int:
        """Number of faces through which emission leaves a cube around the light source.

        The cube's top lies in the direction of the light's axis. The number is 1 for the top alone, 5 for top and
        sides, or 6.
        """
        if self.kind == "spot":
            return 1 if self.cone[1] >= np.sqrt(0.5) else 5 if self.cone[1] >= 0 else 6
        return 6 if self.kind == "point" else 5


@dataclass(frozen=True)
class LightSamples:
    """N light samples with the fields of `LightSample` as arrays; `samples[i]` is a single sample.

    kind                        : (N,) indices in LIGHT_KINDS
    position, direction, radiance : (N, 3) float64
    density                     : (N,) float64
    cone                        : (N, 2) float64
    quadratic                   : (N,) bool
    profile                     : (N,) int
    """

    kind: NDArray[np.intp]
    position: Float64
    direction: Float64
    radiance: Float64
    density: Float64
    cone: Float64
    quadratic: NDArray[np.bool_]
    profile: NDArray[np.intp]

    @classmethod
    def empty(cls, n: int) -> LightSamples:
        """Return samples to be filled, without cones, and with light that falls off."""
        position, direction, radiance = np.zeros((3, n, 3))
        cones, numbers = np.full((n, 2), -1.0), np.zeros((2, n), np.intp)
        return cls(numbers[0], position, direction, radiance, np.ones(n), cones, np.ones(n, bool), numbers[1])

    @classmethod
    def dark(cls, n: int) -> LightSamples:
        """Return n samples of area lights with zero radiance, for a scene without light."""
        samples = cls.empty(n)
        samples.kind[:] = LIGHT_KINDS.index("area")
        samples.direction[:] = (0.0, 0.0, 1.0)
        return samples

    def put_punctual(self, which: NDArray[np.intp], light: Light, chance: float, profile: int) -> None:
        """Set these samples to one punctual light. profile: as in `LightSample`."""
        self.kind[which] = LIGHT_KINDS.index(light.kind)
        self.position[which] = light.position
        self.direction[which] = light.direction
        self.radiance[which] = light.intensity
        self.density[which] = chance
        self.cone[which] = np.cos(np.radians(light.cone))
        self.quadratic[which] = light.falloff == "quadratic"
        self.profile[which] = profile

    def __len__(self) -> int:
        return len(self.kind)

    def __getitem__(self, i: int) -> LightSample:
        full, end = self.cone[i]
        return LightSample(
            kind=LIGHT_KINDS[self.kind[i]],
            position=self.position[i],
            direction=self.direction[i],
            radiance=self.radiance[i],
            density=float(self.density[i]),
            cone=(float(full), float(end)),
            quadratic=bool(self.quadratic[i]),
            profile=int(self.profile[i]),
        )


#: Sample of a scene without light, which is black.
NO_LIGHT = LightSamples.dark(1)[0]


class Incident(NamedTuple):
    """Unoccluded light of a punctual light at N positions.

    wi         : (N, 3) float64 unit, towards the light
    distance   : (N,) float64, infinite for a directional light
    irradiance : (N, 3) float64, W m^-2 on a surface that faces the light
    """

    wi: Float64
    distance: Float64
    irradiance: Float64


def indices_by_id(lights: Sequence[Light]) -> dict[int, int]:
    """Return the first index of each light by its `id`: lights with arrays cannot be keys of a dictionary."""
    return {id(light): i for i, light in reversed([*enumerate(lights)])}


def profiled_lights(scene: Scene) -> tuple[Light, ...]:
    """Return the lights with a profile, in the order in which the device stores their profiles."""
    return tuple(light for light in scene.lights if light.profile is not None)


def profile_number(scene: Scene, light: Light) -> int:
    """Return 1 plus a light's index in `profiled_lights`, or 0 for a light without a profile."""
    if light.profile is None:
        return 0
    return 1 + next(i for i, other in enumerate(profiled_lights(scene)) if other is light)


def incident(light: Light, positions: Float64) -> Incident:
    """Return the light of a punctual light at positions (N, 3), like `shaders/lights/punctual.glsl`."""
    n = len(positions)
    if light.kind == "directional":
        wi = np.broadcast_to(-light.direction, (n, 3))
        return Incident(wi, np.full(n, np.inf), np.broadcast_to(light.intensity, (n, 3)))
    to_light = light.position - positions
    distance = np.linalg.norm(to_light, axis=1)
    wi = to_light / np.maximum(distance, np.finfo(float).tiny)[:, None]
    strength = np.ones(n)
    if light.falloff == "quadratic":
        strength /= np.maximum(distance, np.finfo(float).tiny ** 0.5) ** 2
    if light.profile is not None:
        strength *= light.profile.intensity(-wi, light.direction, light.c0)
    if light.kind == "spot":
        full, end = np.cos(np.radians(light.cone))
        strength *= spot_fade(-(wi @ light.direction), full, end)
    return Incident(wi, distance, strength[:, None] * light.intensity)
