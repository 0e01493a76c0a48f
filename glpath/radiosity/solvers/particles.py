"""Batch of particles: their starts, the surfaces that they hit, and their paths, which one kernel traces.

Particles of the solver leave lamps or lit surfaces; those of a camera leave its eye and estimate importance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.form_factors.lights import BINS
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.glass import Glass, at_glass
from glpath.radiosity.mesh.mesh import Int64
from glpath.radiosity.shafts.rays import Rays, nearest
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64
from glpath.system.kernels import inner_kernel, kernel, kernel_part

#: Number of particles of a batch. Between batches, signals are handled. Each batch has its own random numbers.
BATCH = 1 << 14
#: Value of `max_reflections` for particles whose number of reflections is not limited.
ENDLESS = 1 << 62
#: Maximum number of successive surfaces that transmit or mirror a particle.
_MAX_THROUGH = 64


class ParticleSurfaces(NamedTuple):
    """Surfaces that particles hit: ray queries, normals, reflectance (2, T, 3), opacity (T,), glass, and lattices.

    reflectance   : diffuse reflectance; for glass without the mirror reflection of its surface
    transmittance : (2, T, 3) transmittance of the diffuse base from a side to the other; reversed for particles
                    from an eye
    culled        : (T,) bool, True if the back is culled
    from_eye      : True if particles travel as rays from an eye, which pass culled backs. Particles of light hit
                    the front of such a triangle, and also the surfaces behind it, which see the light through the
                    back
    begin         : index of the first element of each lattice
    """

    rays: Rays
    normals: Float64
    reflectance: Float64
    opacity: Float64
    is_glass: NDArray[np.bool_]
    glass: Glass
    transmittance: Float64
    culled: NDArray[np.bool_]
    from_eye: bool
    divisions: Int64
    begin: Int64

    @classmethod
    def of(cls, scene: Scene, rays: Rays, divisions: Int64, *, from_eye: bool = False) -> ParticleSurfaces:
        glass, appearance = Glass.of_scene(scene), Appearance(scene)
        through = appearance.side_transmittance()
        return cls(
            rays,
            scene.normals,
            _beside_glass(scene.side_reflectance, glass),
            appearance.mean_opacity(),
            np.asarray(glass.clear.any(axis=1)),
            glass,
            np.ascontiguousarray(through[::-1]) if from_eye else through,
            appearance.culled,
            from_eye,
            divisions,
            lattice.starts(lattice.element_count(divisions)),
        )

    def on_lattices(self, divisions: Int64) -> ParticleSurfaces:
        """Return the same surfaces with other lattices, of (T,) divisions."""
        return self._replace(divisions=divisions, begin=lattice.starts(lattice.element_count(divisions)))


class Lamps(NamedTuple):
    """Starts of particles on lamps, with cumulative probabilities `cdf` (L,), and `energy` (L, 3) of a particle.

    corners  : (L, 9), corner 0 and the edges to corners 1 and 2
    triangle : (L,) index of the scene's triangle; `back` is its side
    """

    corners: Float64
    triangle: Int64
    back: Int64
    cdf: Float64
    energy: Float64


class Starts(NamedTuple):
    """Starts of particles outside lamps: position (K, 3), energy (K, 3), triangle and side (K,).

    triangle  : -1 for particles from an eye
    direction : (K, 3) unit; 0 for particles that leave a surface in a cosine-weighted direction
    """

    position: Float64
    energy: Float64
    triangle: Int64
    back: Int64
    direction: Float64


class Arrivals(NamedTuple):
    """Sums to which a batch adds.

    flux   : (2, 2, E, 3) energy, by part, side, element and channel
    square : (2, E) sums of the squared energy of each arrival, mean of the channels; (2, 0) if not needed
    came   : (2, E, BINS) energy that arrives after a reflection, by the bin of its direction; (2, 0, BINS) if not
             needed
    """

    flux: Float64
    square: Float64
    came: Float64


def _beside_glass(reflectance: Float64, glass: Glass) -> Float64:
    """Return (2, T, 3), reflectance without the mirror reflection of glass."""
    _, _, layered, coat, mean = glass.layer.T
    coat = coat * (0.04 + 0.96 / 21.0)
    mirrored = coat + (1.0 - coat) * layered * mean
    mirrored = np.where(glass.slab > 0, 1.0, mirrored)  # a slab mirrors all light that it does not transmit
    return np.asarray(np.maximum(reflectance - np.where(glass.clear.any(axis=1), mirrored, 0.0)[:, None], 0.0))


@inner_kernel
def next_random(state):  # type: ignore[no-untyped-def]
    """Return the state and the next random number in [0, 1), by splitmix64 (Steele et al. 2014)."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return state, float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def shoot_batch(number, seed, surfaces, lamps, starts, max_reflections, arrivals, work):  # type: ignore[no-untyped-def]
    """Shoot one batch of particles; return the number of hits. `work` is (4, 3).

    max_reflections : number of reflections after which a particle ends at its next hit
    """
    corners, normals, reflectance, glass = lamps.corners, surfaces.normals, surfaces.reflectance, surfaces.glass
    flux, square, came = arrivals
    hits = 0
    if len(lamps.cdf) == 0 and len(starts.triangle) == 0:
        return hits
    o, d, w, found = work[0], work[1], work[2], work[3]
    state, _ = next_random(np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(number))
    state, _ = next_random(state ^ (np.uint64(number) << np.uint64(32)))
    for particle in range(BATCH):
        if particle < len(starts.triangle):
            triangle, back = starts.triangle[particle], starts.back[particle]
            for k in range(3):
                o[k], w[k], d[k] = (
                    starts.position[particle, k],
                    starts.energy[particle, k],
                    starts.direction[particle, k],
                )
            if max(w[0], w[1], w[2]) <= 0:
                continue  # the start gets no light, so no particle leaves it
            part = 0 if triangle < 0 else 1
            leaves = d[0] == 0 and d[1] == 0 and d[2] == 0
        else:
            state, u = next_random(state)
            which = min(_above(lamps.cdf, u), len(lamps.cdf) - 1)
            triangle, back, part = lamps.triangle[which], lamps.back[which], 0  # part 0: direct
            state, u = next_random(state)
            state, v = next_random(state)
            root = np.sqrt(u)
            for k in range(3):
                o[k] = corners[which, k] + root * ((1 - v) * corners[which, 3 + k] + v * corners[which, 6 + k])
                w[k] = lamps.energy[which, k]
            leaves = True
        passed, reflections = 0, 0
        while True:
            if leaves:
                state = _leave(state, normals[triangle], back, d)
            hit = nearest(surfaces.rays, o, d, triangle, found)
            if hit < 0:
                break
            hits += 1
            triangle = hit
            along = 0.0
            for k in range(3):
                along += normals[triangle, k] * d[k]
                o[k] += found[0] * d[k]
            back = 1 if along > 0 else 0
            is_glass = surfaces.is_glass[triangle]
            if is_glass and back == 1 and glass.ior[triangle] > 0:
                for k in range(3):
                    w[k] *= np.exp(-glass.attenuation[triangle, k] * found[0])
            n = surfaces.divisions[triangle]
            x, y = n * found[1], n * found[2]
            i = min(int(x), n - 1)
            j = max(0, min(int(y), n - 1 - i))
            upper = 1 if (x - i + y - j > 1 and i + j < n - 1) else 0
            at = surfaces.begin[triangle] + j * (2 * n - j) + 2 * i + upper
            is_culled = surfaces.culled[triangle]
            if is_culled and surfaces.from_eye and back == 1:
                passed += 1
                if passed > _MAX_THROUGH:
                    break
                leaves = False
                continue
            if part == 1 and came.shape[1] > 0:
                came[back, at, _bin(normals[triangle], d)] += (w[0] + w[1] + w[2]) / 3
            if square.shape[1] > 0:
                square[back, at] += ((w[0] + w[1] + w[2]) / 3) ** 2
            survival, reflected, across = 0.0, 0.0, 0.0
            for k in range(3):
                flux[part, back, at, k] += w[k]
                through = surfaces.transmittance[back, triangle, k]
                survival = max(survival, reflectance[back, triangle, k] + through)
                reflected = max(reflected, reflectance[back, triangle, k])
                across = max(across, through)
            state, u = next_random(state)
            chance, hit_surface = survival, u < surfaces.opacity[triangle]
            if is_glass and hit_surface:
                # The particle is mirrored, transmitted, or continues with the diffuse base, as in the shaders.
                inside = back == 1 and glass.ior[triangle] > 0
                mirrored, left = at_glass(glass, triangle, abs(along), inside)
                clear = max(glass.clear[triangle, 0], glass.clear[triangle, 1], glass.clear[triangle, 2])
                through = clear * left
                state, u = next_random(state)
                if u < mirrored + through:
                    passed += 1
                    if passed > _MAX_THROUGH:
                        break
                    leaves = False
                    scale, bends = 1.0, -2 * along
                    if u >= mirrored:
                        bends = 0.0
                        index = glass.ior[triangle]
                        if index > 0:
                            scale = index if inside else 1 / index
                            far = np.sqrt(max(0.0, 1 - scale * scale * (1 - along * along)))
                            bends = (far if along > 0 else -far) - scale * along
                        for k in range(3):
                            w[k] *= glass.clear[triangle, k] / clear
                    if u < mirrored or not glass.thin[triangle]:
                        part = 1  # counted as indirect, because shadow rays do not find this light
                    for k in range(3):
                        d[k] = scale * d[k] + bends * normals[triangle, k]
                    length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                    for k in range(3):
                        d[k] /= length
                    continue
                rest = max(1 - mirrored - through, 1e-9)
                u = (u - mirrored - through) / rest
                chance = survival / (rest * surfaces.opacity[triangle])
            if is_culled and not surfaces.from_eye and back == 0:
                # The particle is reflected, and also passes to light the surfaces behind. One of the two is chosen
                # at random, and gets the energy of both.
                state, u = next_random(state)
                for k in range(3):
                    w[k] *= 1 + chance
                if u * (1 + chance) >= chance:
                    passed += 1
                    if passed > _MAX_THROUGH:
                        break
                    leaves = False
                    continue
                u = 0.0
            passed = 0
            leaves = u < chance
            if leaves:
                reflections += 1
                if reflections > max_reflections:
                    break
                part = 1
                if across > 0:
                    share = across / (reflected + across)
                    state, u = next_random(state)
                    if u < share:
                        for k in range(3):
                            w[k] *= surfaces.transmittance[back, triangle, k] / (survival * share)
                        back = 1 - back
                        continue
                    survival *= 1 - share
                for k in range(3):
                    w[k] *= reflectance[back, triangle, k] / survival
            elif hit_surface:
                break  # absorbed; a particle that misses the opaque part passes unchanged
    return hits


@kernel_part
def _above(cdf, u):  # type: ignore[no-untyped-def]
    """Return the index of the first value of `cdf`, which ascends, above u; the length of `cdf` if none is."""
    low, high = 0, len(cdf)
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@kernel_part
def _bin(normal, d):  # type: ignore[no-untyped-def]
    """Return the bin of -d, the direction from which a particle arrives, by the mapping that `_leave` uses."""
    c = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]
    sign = -1.0 if c > 0 else 1.0
    x = 2 * abs(c) * -d[0] - sign * normal[0]
    y = 2 * abs(c) * -d[1] - sign * normal[1]
    z = 2 * abs(c) * -d[2] - sign * normal[2]
    turn = np.arctan2(y, x) / (2 * np.pi)
    side = int(np.sqrt(BINS))
    i = min(max(int((1 - z) / 2 * side), 0), side - 1)
    j = min(max(int((turn + (1 if turn < 0 else 0)) * side), 0), side - 1)
    return i * side + j


@kernel_part
def _leave(state, normal, back, d):  # type: ignore[no-untyped-def]
    """Fill d with a cosine-weighted direction about a side's normal.

    It leads to a random point of the unit sphere around the normal's tip.
    """
    state, u = next_random(state)
    state, v = next_random(state)
    z = 1 - 2 * u
    r = np.sqrt(max(0.0, 1 - z * z))
    sign = -1.0 if back else 1.0
    d[0] = sign * normal[0] + r * np.cos(2 * np.pi * v)
    d[1] = sign * normal[1] + r * np.sin(2 * np.pi * v)
    d[2] = sign * normal[2] + z
    length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for k in range(3):
        d[k] = d[k] / length if length > 1e-9 else sign * normal[k]
    return state
