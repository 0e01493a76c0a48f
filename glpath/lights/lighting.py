"""Light samples of a scene with their probability densities, and the irradiance by its punctual lights.

Every engine draws its light samples here. The lights are emitting sides of shapes, punctual lights (point, spot,
directional) and the sky. The probability of a light is the mean of a uniform one and of one proportional to its
power towards the scene. Points on a shape are uniform by area, unless a texture modulates its emission. The density
of sky directions is proportional to their radiance.

Cost:     a search in a table of the lights for each sample, on the CPU, because a path set needs only one sample.
Poor at:  very many lights of which each part of the scene sees only a few, because the selection ignores position.
          Per-path rays then use `glpath.lights.tree`.
Source:   PB 3.3 and A.3; Shirley, Wang & Zimmerman 1996, Monte Carlo techniques for direct lighting calculations;
          Owen & Zhou 2000, Safe and effective importance sampling, for the mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.lights.samples import LIGHT_KINDS, LightSample, LightSamples, incident, profile_number
from glpath.sampling.points import uniform_sphere
from glpath.scene.appearance import Appearance
from glpath.scene.geometry import sphere_areas
from glpath.scene.model import Environment, Float64, Light, Scene, Shape, Sky, unit_normals
from glpath.scene.spot_cone import spot_solid_angle
from glpath.system.time_limit import check_time

# Probability of selecting a triangle by area alone, if a texture modulates the shape's emission.
_UNSEEN = 0.2


@dataclass(frozen=True)
class _Side:
    """Emitting side of a shape.

    shape     : index of the shape
    spheres   : True if the primitives of the shape are spheres, False if they are triangles
    first     : index of the shape's first triangle or sphere in the scene
    cdf       : (n + 1,) cumulative probability of the shape's n primitives: by area, or mostly by power if a
                texture modulates the emission
    area      : area of all primitives, scene units squared
    sign      : +1 front, -1 back
    radiance  : (3,) mean radiance over the side
    """

    shape: int
    spheres: bool
    first: int
    cdf: Float64
    area: float
    sign: float
    radiance: Float64


@dataclass(frozen=True)
class Lighting:
    """Lights of a scene as one table for selection. `Lighting.of` creates it.

    cdf              : (L + 1,) cumulative probability of the L lights, in the order emitting sides, punctual
                       lights, sky; (1,) for a scene without light
    triangle_density : (T,) density per area of light samples on an emitting side of each triangle; 0 if the
                       triangle does not emit
    centre, radius   : sphere about the scene; the power of a light is the part that it sends to this sphere
    """

    scene: Scene
    sides: tuple[_Side, ...]
    punctual: tuple[Light, ...]
    sky: Sky | Environment | None
    cdf: Float64
    triangle_density: Float64
    centre: Float64
    radius: float

    @classmethod
    def of(cls, scene: Scene, *, punctual: bool = True, sky: bool = True) -> Lighting:
        """Collect the lights of a scene.

        punctual : False to leave out point, spot and directional lights, for a caller that handles these one by one
        sky      : False to leave out the sky, if ambient light replaces it

        A shape that emits on both sides counts as two lights. Planes emit, but are not sampled, because no
        point of an infinite plane has a density by area.
        """
        centre, radius = _sphere_about(scene)
        sides = _emitting_sides(scene)
        shining = tuple(x for x in scene.lights if light_shines(x)) if punctual else ()
        shown = scene.sky if sky and scene.sky is not None and scene.sky.mean_integral > 0 else None
        # Power divided by pi: unweighted mean of the channels, so that no coloured light is undersampled.
        power = [side.area * side.radiance.mean() for side in sides]
        power += [_power(light, scene, centre, radius) for light in shining]
        power += [] if shown is None else [shown.mean_integral * radius**2]
        weights = np.array(power, np.float64)
        total = weights.sum()
        # Power towards the whole scene does not predict a light's contribution to the image. For example, a lamp
        # over a wide ground may send a hundredth of the sky's power, but light all that is visible. So each
        # probability is the mean of a uniform one and of one proportional to power.
        share = 0.5 * weights / total + 0.5 / len(weights) if len(weights) else weights
        density = np.zeros(len(scene.triangles))
        appearance = Appearance(scene)
        areas = scene.areas if appearance.varies("emission").any() else None
        for side, chance in zip(sides, share, strict=False):
            if not side.spheres:
                part = slice(side.first, side.first + len(side.cdf) - 1)
                if areas is None or not appearance.varies("emission")[side.shape]:
                    density[part] = chance / side.area
                else:
                    density[part] = chance * np.diff(side.cdf) / areas[part]
        return cls(
            scene=scene,
            sides=sides,
            punctual=shining,
            sky=shown,
            cdf=np.concatenate([[0.0], np.cumsum(share)]),
            triangle_density=density,
            centre=centre,
            radius=radius,
        )

    @property
    def count(self) -> int:
        """Number of lights to choose from: emitting sides of shapes, punctual lights and the sky."""
        return len(self.cdf) - 1

    @property
    def dark(self) -> bool:
        """True if the scene has no light to sample."""
        return len(self.cdf) == 1

    @property
    def infinite(self) -> bool:
        """True if some light is distant: a directional light, or the sky."""
        return self.sky is not None or any(light.kind == "directional" for light in self.punctual)

    @property
    def positional(self) -> bool:
        """True if some light is a point or a spot."""
        return any(light.kind != "directional" for light in self.punctual)

    @property
    def sky_chance(self) -> float:
        """Probability that a light sample belongs to the sky."""
        return 0.0 if self.sky is None else self._probability(len(self.cdf) - 2)

    @property
    def sky_pdf_scale(self) -> float:
        """Ratio of a sky sample's density per solid angle to the sum of the sky radiance's three channels."""
        if self.sky is None:
            return 0.0
        return self.sky_chance / (3 * self.sky.mean_integral)

    def sample(self, u: ArrayLike) -> LightSample:
        """Return one light sample for random numbers u (3,) in [0, 1); `samples` describes the use of each."""
        return self.samples(np.asarray(u, np.float64)[None])[0]

    def samples(self, u: ArrayLike) -> LightSamples:
        """Return N light samples for random numbers u (N, 3) in [0, 1).

        u[:, 0] selects the light, and u[:, 1:] selects the point on a shape or the direction of the sky. For a
        shape, u[:, 1] selects a primitive, and its rescaled remainder helps to position the point. Samples of a
        quad are thus stratified in two dimensions.
        """
        assert not self.dark, "no light to sample"
        u = np.asarray(u, np.float64)
        numbers = np.minimum(np.searchsorted(self.cdf, u[:, 0], side="right") - 1, len(self.cdf) - 2)
        samples = LightSamples.empty(len(u))
        for number in np.unique(numbers):
            which = np.flatnonzero(numbers == number)
            chance, punctual = self._probability(number), number - len(self.sides)
            if punctual < 0:
                self._on_side(samples, which, self.sides[number], chance, u[which, 1:])
            elif punctual < len(self.punctual):
                light = self.punctual[punctual]
                samples.put_punctual(which, light, chance, profile_number(self.scene, light))
            else:
                assert self.sky is not None, "the last light"
                # The quotient may round to 1 or more, so it is clipped to less than 1.
                left = np.clip((u[which, 0] - self.cdf[number]) / chance, 0.0, np.nextafter(1.0, 0.0))
                wi = self.sky.directions(np.column_stack([left, u[which, 1:]]))
                samples.kind[which] = LIGHT_KINDS.index("sky")
                samples.direction[which] = -wi
                radiance = samples.radiance[which] = sky_radiance(self.sky, wi)
                samples.density[which] = self._sky_density(radiance)
        return samples

    def sky_density(self, directions: ArrayLike) -> Float64:
        """Return the density (N,) per solid angle of sky samples in unit directions (N, 3).

        The density includes the probability of selecting the sky.
        """
        wi = np.asarray(directions, np.float64).reshape(-1, 3)
        return self._sky_density(sky_radiance(self.sky, wi))

    def _sky_density(self, radiance: Float64) -> Float64:
        return np.asarray(radiance.sum(axis=1) * self.sky_pdf_scale)

    def varies(self, shape: int) -> bool:
        """Return True if a shape's emission varies over its surface."""
        return bool(self._varies[shape])

    def irradiance(self, positions: ArrayLike, normals: ArrayLike) -> Float64:
        """Return the unoccluded irradiance (N, 3) by all punctual lights, in W m^-2.

        positions, normals : (N, 3) each; normals of unit length
        """
        x = np.asarray(positions, np.float64).reshape(-1, 3)
        n = np.asarray(normals, np.float64).reshape(-1, 3)
        total = np.zeros((len(x), 3))
        for light in self.punctual:
            found = incident(light, x)
            total += found.irradiance * np.maximum(np.einsum("ij,ij->i", n, found.wi), 0.0)[:, None]
        return total

    @cached_property
    def _appearance(self) -> Appearance:
        return Appearance(self.scene)

    @cached_property
    def _varies(self) -> NDArray[np.bool_]:
        """Flags (shapes,), True if the emission varies over the shape."""
        return self._appearance.varies("emission")

    def _probability(self, number: int) -> float:
        return float(self.cdf[number + 1] - self.cdf[number])

    def _on_side(
        self, samples: LightSamples, which: NDArray[np.intp], side: _Side, chance: float, u: Float64
    ) -> None:
        k = np.minimum(np.searchsorted(side.cdf, u[:, 0], side="right") - 1, len(side.cdf) - 2)
        share = side.cdf[k + 1] - side.cdf[k]
        s = (u[:, 0] - side.cdf[k]) / share
        radiance: Float64 = side.radiance
        if side.spheres:
            position, normal, density, unit = _on_spheres(
                self.scene.spheres[side.first + k], np.stack([s, u[:, 1]], axis=1)
            )
            density *= chance * share
            if self._varies[side.shape]:
                radiance = self._appearance.sphere_emission(side.shape, unit)
        else:
            # Area-preserving map: the square root selects a line parallel to the edge opposite corner 0.
            root, v = np.sqrt(s)[:, None], u[:, 1:]
            triangles = self.scene.triangles[side.first + k]
            a, b, c = triangles.swapaxes(0, 1)
            position = (1 - root) * a + root * ((1 - v) * b + v * c)
            normal = unit_normals(triangles)
            density = self.triangle_density[side.first + k]
            if self._varies[side.shape]:
                b = np.concatenate([root * (1 - v), root * v], axis=1)
                radiance = self._appearance.emission(side.first + k, b)
        samples.kind[which] = LIGHT_KINDS.index("area")
        samples.position[which] = position
        samples.direction[which] = normal * side.sign
        samples.radiance[which] = radiance
        samples.density[which] = density


def sky_radiance(sky: Sky | Environment | None, directions: ArrayLike) -> Float64:
    """Return the sky's radiance (..., 3) W sr^-1 m^-2 in unit directions (..., 3); black without a sky."""
    return np.zeros(np.shape(directions)) if sky is None else sky.radiance(directions)


def max_radiance(scene: Scene) -> float:
    """Return the maximum radiance among emitters, sky, and white surfaces at a typical distance from lights.

    For a sky with a small sun, its typical radiance counts instead of its maximum. The accumulation buffers derive
    their quantum from this value (`glpath.gl.sums`), and their sums can hold larger radiances too.
    """
    values = [0.0, *scene.ambient, *(_max_emission(scene, shape) for shape in scene.shapes)]
    if scene.sky is not None:
        values.append(scene.sky.typical_radiance)
    if scene.background is not None:
        values.extend(scene.background.radiance)
    distances = iter(_typical_distances(scene, [light.position for light in scene.lights if _fades(light)]))
    for light in scene.lights:
        square = next(distances) ** 2 if _fades(light) else 1.0
        peak = 1.0 if light.profile is None else light.profile.max
        values.append(peak * float(light.intensity.max()) / (np.pi * square))
    return float(max(values))


def _max_emission(scene: Scene, shape: Shape) -> float:
    slot = scene.materials[shape.material].emission_texture
    if slot is None:
        return float(shape.emission.max())
    return float((shape.emission * scene.textures[slot.texture].max).max())


def _fades(light: Light) -> bool:
    return light.kind != "directional" and light.falloff == "quadratic"


def _typical_distances(scene: Scene, positions: Sequence[Float64]) -> list[float]:
    """Return the median distance from each position to all planes and to the bounding boxes of all primitives.

    Planes through the position and boxes around it do not count. If nothing else exists, the distance is the radius
    of the scene.
    """
    if not positions:
        return []
    radius = _sphere_about(scene)[1]
    extent, centre = np.linalg.norm(scene.spheres[:, :, :3], axis=2), scene.spheres[:, :, 3]
    lower = np.concatenate([centre - extent, scene.triangles.min(axis=1, initial=np.inf)])
    upper = np.concatenate([centre + extent, scene.triangles.max(axis=1, initial=-np.inf)])
    typical = []
    for position in positions:
        check_time()
        outside = np.maximum(np.maximum(lower - position, position - upper), 0.0)
        heights = np.abs(np.sum((position - scene.planes[:, :, 3]) * scene.planes[:, :, 2], axis=1))
        distances = np.concatenate([np.linalg.norm(outside, axis=1), heights])
        distances = distances[distances > 0]
        typical.append(float(np.median(distances)) if len(distances) else radius)
    return typical


def _sphere_about(scene: Scene) -> tuple[Float64, float]:
    """Return the centre (3,) and the radius of a sphere about the scene.

    A scene with infinite planes counts as extending to the planes' origins, the camera, and all lights with a
    position.
    """
    points = list(scene.bounds)
    if len(scene.planes):
        points += [*scene.planes[:, :, 3], scene.camera.position]
        points += [light.position for light in scene.lights if light.kind != "directional"]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return 0.5 * (low + high), float(0.5 * np.linalg.norm(high - low)) or 1.0


def light_shines(light: Light) -> bool:
    """Return True if a punctual light sends any light."""
    return bool(np.any(light.intensity > 0)) and (light.profile is None or light.profile.max > 0)


def _power(light: Light, scene: Scene, centre: Float64, radius: float) -> float:
    """Return the power, divided by pi, that a punctual light sends to the scene's sphere; mean of the channels."""
    check_time()
    strength = float(light.intensity.mean())
    if light.profile is not None and light.falloff == "none":
        strength *= light.profile.flux / (4 * np.pi)
    if light.kind == "directional" or light.falloff == "none":
        return strength * radius**2
    angle = 4 * np.pi
    if light.kind == "spot":
        angle = spot_solid_angle(light.cone)
    distance = float(np.linalg.norm(light.position - centre))
    if distance > radius and not len(scene.planes):
        angle = min(angle, 2 * np.pi * (1 - np.sqrt(1 - (radius / distance) ** 2)))
    if light.profile is not None:
        return strength * min(light.profile.flux, light.profile.max * angle) / np.pi
    return strength * angle / np.pi


def _emitting_sides(scene: Scene) -> tuple[_Side, ...]:
    areas, appearance = scene.areas, Appearance(scene)
    varies = appearance.varies("emission")
    sides = []
    for number, (shape, part) in enumerate(zip(scene.shapes, scene.shapes.ranges, strict=True)):
        if not shape.emits or shape.primitive == "plane":
            continue
        check_time()
        spheres = shape.primitive == "sphere"
        own = sphere_areas(scene.spheres[part]) if spheres else areas[part]
        area, weights, radiance = float(own.sum()), own, shape.emission
        if varies[number]:
            each = (
                np.broadcast_to(appearance.mean_sphere_emission(number), (len(own), 3))
                if spheres
                else appearance.mean_emission(np.arange(part.start, part.stop))
            )
            radiance = np.asarray(own @ each / area)
            if not np.any(radiance > 0):
                continue
            # A texture may be bright between the sample points of these means, so a part of the probability is by
            # area alone.
            power = own * each.mean(axis=1)
            weights = (1 - _UNSEEN) * power / power.sum() + _UNSEEN * own / area
        cdf = np.concatenate([[0.0], np.cumsum(weights) / weights.sum()])
        for sign in (1.0, -1.0) if shape.emission_two_sided else (1.0,):
            sides.append(_Side(number, spheres, part.start, cdf, area, sign, radiance))
    return tuple(sides)


def _on_spheres(spheres: Float64, u: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """Sample one point on each sphere.

    spheres : (N, 3, 4) world_from_unit_sphere
    u       : (N, 2) random numbers in [0, 1)

    Returns positions, unit normals of the front, densities per area, and the same points on the unit sphere (N, 3).
    """
    linear = spheres[:, :, :3]
    unit = uniform_sphere(u)
    normal = np.einsum("nji,nj->ni", np.linalg.inv(linear), unit)
    length = np.linalg.norm(normal, axis=1)
    volume = np.linalg.det(linear)
    position = np.einsum("nij,nj->ni", linear, unit) + spheres[:, :, 3]
    front = normal / length[:, None] * np.sign(volume)[:, None]
    return position, front, 1.0 / (4 * np.pi * np.abs(volume) * length), unit
