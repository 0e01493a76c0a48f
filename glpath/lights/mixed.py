"""Light of many different punctual lights at many points; `samples.incident` is the version for a single light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.lights.samples import Incident
from glpath.scene.model import Float64, Light, LightProfile
from glpath.scene.spot_cone import spot_fade

Int64 = NDArray[np.int64]


class MixedLights(NamedTuple):
    """L punctual lights as arrays.

    position, direction, c0, intensity : (L, 3)
    distant, quadratic, spot : (L,) bool
    full, end : (L,) cosines of a spot's cone
    profile   : (L,) index in `profiles`, -1 for none
    """

    position: Float64
    direction: Float64
    c0: Float64
    intensity: Float64
    distant: NDArray[np.bool_]
    quadratic: NDArray[np.bool_]
    spot: NDArray[np.bool_]
    full: Float64
    end: Float64
    profile: Int64
    profiles: tuple[LightProfile, ...]

    @classmethod
    def of(cls, lights: Sequence[Light]) -> MixedLights:
        profiles = {id(light.profile): light.profile for light in lights if light.profile is not None}
        number = {key: i for i, key in enumerate(profiles)}
        cosines = np.cos(np.radians([light.cone for light in lights])).reshape(-1, 2)
        position, direction, c0, intensity = (
            np.array([getattr(light, name) for light in lights], np.float64).reshape(-1, 3)
            for name in ("position", "direction", "c0", "intensity")
        )
        return cls(
            position=position,
            direction=direction,
            c0=c0,
            intensity=intensity,
            distant=np.array([light.kind == "directional" for light in lights], bool),
            quadratic=np.array([light.falloff == "quadratic" for light in lights], bool),
            spot=np.array([light.kind == "spot" for light in lights], bool),
            full=cosines[:, 0],
            end=cosines[:, 1],
            profile=np.array([number.get(id(light.profile), -1) for light in lights], np.int64),
            profiles=tuple(profiles.values()),
        )

    def incident(self, lights: Int64, positions: Float64) -> Incident:
        """Return the incident light at positions (N, 3), each from the light with the index in lights (N,)."""
        direction, distant = self.direction[lights], self.distant[lights]
        to_light = self.position[lights] - positions
        distance = np.linalg.norm(to_light, axis=1)
        wi = to_light / np.maximum(distance, np.finfo(float).tiny)[:, None]
        strength = np.where(
            self.quadratic[lights], 1.0 / np.maximum(distance, np.finfo(float).tiny ** 0.5) ** 2, 1.0
        )
        for number, profile in enumerate(self.profiles):
            some = np.flatnonzero(self.profile[lights] == number)
            which, away = lights[some], -wi[some]
            axis, c0 = self.direction[which], self.c0[which]
            x, y, z = (np.einsum("ni,ni->n", away, along) for along in (c0, np.cross(c0, axis), axis))
            gamma = np.degrees(np.arctan2(np.hypot(x, y), z))
            strength[some] *= profile.at(np.degrees(np.arctan2(y, x)), gamma)
        if self.spot.any():
            full, end = self.full[lights], self.end[lights]
            cosine = -np.einsum("ni,ni->n", wi, direction)
            strength *= np.where(self.spot[lights], spot_fade(cosine, full, end), 1.0)
        if distant.any():
            wi[distant], distance[distant], strength[distant] = -direction[distant], np.inf, 1.0
        return Incident(wi, distance, strength[:, None] * self.intensity[lights])

    def bounds(self, positions: Float64, normals: Float64, radius: Float64) -> Float64:
        """Return (P, L) approximate upper bounds of the lights' mean irradiance on flat surfaces.

        Surfaces are given by positions (P, 3) and normals (P, 3); the mean is over a radius (P,). The directions of
        a profile and cones are ignored: a profile's maximum holds for all directions.
        """
        peak = self.intensity.mean(axis=1)
        with_profile = self.profile >= 0
        highest = np.array([profile.max for profile in self.profiles])
        peak[with_profile] *= highest[self.profile[with_profile]]
        to_light = self.position[None] - positions[:, None]
        distance = np.maximum(np.linalg.norm(to_light, axis=2), np.finfo(float).tiny ** 0.5)
        near = np.maximum(distance, radius[:, None])
        cosine = np.einsum("plc,pc->pl", to_light, normals) / distance
        found = peak * np.clip(cosine + radius[:, None] / near, 0.0, 1.0)
        found /= np.where(self.quadratic, near**2, 1.0)
        parallel = peak * np.maximum(-normals @ self.direction.T, 0.0)
        return np.asarray(np.where(self.distant, parallel, found))
