"""Light probes: incident radiance at the points of a grid, as spherical harmonics.

    glpath.probes("office", grid=(8, 4, 8)).save("probes.json")

A probe holds the incident radiance in the nine real spherical harmonics of bands 0 to 2, with the order and signs
of three.js' SphericalHarmonics3. They follow from the irradiance for 50 normals, the points of Lebedev's rule of
degree 11; each normal has its own paths. Irradiance is radiance with band l multiplied by A_l (pi, 2 pi / 3,
pi / 4; zero for 3, 5, 7 ...), so a coefficient is the projection of irradiance divided by A_l.

The rule integrates the product of band 2 with bands up to 9 exactly, so bands 4, 6 and 8 of irradiance cause no
error. The first band that causes an error is 10. Its factor A_l is 1/55 of A_2.

Cost:     50 paths per probe and path set, and 64 rays per probe on the CPU.
Poor at:  lamps nearby, because nine numbers cannot hold sharp light. Light leaks through walls that are thinner
          than the grid spacing, because a probe does not know occluders between itself and lit objects.
Source:   Ramamoorthi & Hanrahan 2001, An efficient representation for irradiance environment maps. Lebedev 1976,
          Quadratures on a sphere.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError, UsageError
from glpath.film.film import Film
from glpath.film.noise import standard_error
from glpath.integrators.by_name import AUTO, Integrator
from glpath.integrators.settings import GEOMETRY_BUDGET, IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.rendering.below_stream import Covered, StreamedRays, budget_for, in_memory
from glpath.rendering.options import RenderKeywords, whole_numbers, with_options
from glpath.rendering.points import irradiance, lit
from glpath.rendering.run_options import RunOptions
from glpath.rendering.sides import Sides
from glpath.scene import Scene
from glpath.scene.triangulate import path_traceable
from glpath.system.arguments import check_array, checked
from glpath.system.files import write_bytes
from glpath.system.time_limit import check_time, named_work, without_limit_if_resumed
from glpath.system.units import Unit, symbol
from glpath.system.vectors import LARGEST

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Number of rays that test if a probe is inside a solid.
_LOOKS = 64
#: Maximum number of these rays between two checks of the time limit.
_RAYS_TOGETHER = 1 << 16
#: Fraction of a probe's rays. If more than this fraction hits unlit inner sides, the probe counts as inside.
_MOSTLY = 0.5
#: Maximum number of probes in a grid; the film of each takes 10 kB.
MAX_PROBES = 1 << 16
DEFAULT_GRID = (8, 4, 8)


def _lebedev_50() -> tuple[Float64, Float64]:
    """Return (50, 3) unit normals and (50,) weights with sum one, exact for polynomials of degree 11."""
    rows, weights = [], []
    for kind, weight in (
        ((1.0, 0.0, 0.0), 4 / 315),
        ((1.0, 1.0, 0.0), 64 / 2835),
        ((1.0, 1.0, 1.0), 27 / 1280),
        ((1.0, 1.0, 3.0), 14641 / 725760),
    ):
        signs = product((1.0, -1.0), repeat=3)
        signed = {
            tuple(a * b + 0.0 for a, b in zip(s, each, strict=True)) for s in signs for each in permutations(kind)
        }
        rows += sorted(signed)
        weights += [weight] * len(signed)
    normals = np.array(rows)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True), np.array(weights)


def harmonics(directions: ArrayLike) -> Float64:
    """Return (..., 9) real spherical harmonics of bands 0 to 2 for unit directions (..., 3), as in three.js."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    a, b, c = math.sqrt(0.25 / math.pi), math.sqrt(0.75 / math.pi), math.sqrt(3.75 / math.pi)
    band_2 = [c * x * y, c * y * z, c / math.sqrt(12) * (3 * z * z - 1), c * x * z, 0.5 * c * (x * x - y * y)]
    return np.stack([np.full_like(x, a), b * y, b * z, b * x, *band_2], axis=-1)


_NORMALS, _WEIGHTS = _lebedev_50()
#: Ratio of irradiance to radiance for each harmonic: A_l of its band.
_LOBE = np.array([math.pi, *[2 * math.pi / 3] * 3, *[math.pi / 4] * 5])
#: (9, 50) matrix that maps the irradiance for each normal to the coefficients of radiance.
_FROM_IRRADIANCE = 4 * math.pi * (_WEIGHTS[:, None] * harmonics(_NORMALS) / _LOBE).T


@dataclass(frozen=True, eq=False)
class ProbeGrid:
    """Positions of probes: centres of equal cells of a box, as in three.js' LightProbeGrid.

    lower, upper : (3,) corners of the box, scene units
    counts       : number of probes along x, y and z
    valid        : (N,) bool, False for probes inside solids; x varies fastest, then y, then z
    """

    lower: Float64
    upper: Float64
    counts: tuple[int, int, int]
    valid: Bools

    @classmethod
    @without_limit_if_resumed()
    @named_work("looking for probes inside solids")
    def of(
        cls,
        scene: Scene,
        counts: Any = DEFAULT_GRID,
        bounds: ArrayLike | None = None,
        geometry_budget: int = GEOMETRY_BUDGET,
    ) -> ProbeGrid:
        """Return the grid in a lit scene, with probes inside solids marked as invalid.

        counts : number of probes along x, y and z
        bounds : (2, 3) lower and upper corner; None: those of the scene
        geometry_budget : MiB for triangles of the scene's streams during the test for probes inside solids

        A probe is inside if most of its rays hit unlit back faces, unlit inner sides of closed solids, or backs of
        streamed triangles (see `glpath.rendering.below_stream`). Raises UsageError, and SceneError if all probes
        are inside.
        """
        nx, ny, nz = whole_numbers("grid", counts, 3)
        if min(nx, ny, nz) < 1 or nx * ny * nz > MAX_PROBES:
            raise UsageError(
                f"grid: {nx} x {ny} x {nz} where 1 or more each, and {MAX_PROBES} together at most, are needed"
            )
        still = path_traceable(scene.at(), streams=True)
        has_surfaces = still.shapes.total("triangle") + still.shapes.total("stream") > 0
        offset = still.origin - scene.origin
        if bounds is None:
            if not has_surfaces:
                raise UsageError("bounds: needed, because the scene has no surface.", "Give two corners of a box.")
            lower, upper = (np.asarray(corner, np.float64) + offset for corner in still.bounds)
        else:
            lower, upper = check_array("bounds", bounds, (2, 3), (-LARGEST, LARGEST))
        if not (lower <= upper).all():
            raise UsageError(
                f"bounds: from {lower.tolist()} to {upper.tolist()} where the lower corner comes first"
            )
        grid = cls(lower, upper, (nx, ny, nz), np.ones(nx * ny * nz, np.bool_))
        if not has_surfaces:
            return grid
        valid = ~_inside(still, grid.positions - offset, geometry_budget)
        if not valid.any():
            raise SceneError(
                f"{scene.source or scene.name}: all {len(valid)} probes see mostly the backs of surfaces.",
                "Give bounds within the room, or flip its surfaces.",
            )
        return cls(lower, upper, (nx, ny, nz), valid)

    @property
    def positions(self) -> Float64:
        """Positions (N, 3), scene units; x varies fastest, then y, then z."""
        x, y, z = (
            low + (np.arange(n) + 0.5) * (high - low) / n
            for low, high, n in zip(self.lower, self.upper, self.counts, strict=True)
        )
        z, y, x = np.meshgrid(z, y, x, indexing="ij")
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)

    def receivers(self) -> tuple[Float64, Float64]:
        """Points and normals (50 V, 3) at which the V valid probes are measured, probe by probe."""
        positions = self.positions[self.valid]
        return np.repeat(positions, len(_NORMALS), axis=0), np.tile(_NORMALS, (len(positions), 1))


@checked
@dataclass(frozen=True, eq=False)
class Probes:
    """Light probes of a grid.

    grid : positions and validity
    film : film of the measured points, see `ProbeGrid.receivers`; it can be saved and resumed
    """

    grid: ProbeGrid
    film: Film

    @property
    def unit(self) -> Unit:
        """Unit of the radiance: "radiometric" or "photometric", the same as the scene's."""
        return self.film.metadata.unit or "radiometric"

    @property
    def repaired(self) -> int:
        """Number of probes inside solids, which get the mean of their valid neighbours."""
        return int((~self.grid.valid).sum())

    @property
    def coefficients(self) -> Float64:
        """Coefficients (N, 9, 3) float64 of radiance, linear Rec. 709, W m^-2 sr^-1, or cd m^-2 if photometric."""
        found = np.zeros((len(self.grid.valid), 9, 3))
        found[self.grid.valid] = self._projected(self.film.mean[None])[0]
        return _repaired(found, self.grid)

    @property
    def standard_errors(self) -> Float64:
        """Standard errors (N, 9, 3) float64 of `coefficients`, from the spread of independent batches.

        NaN below 16 path sets, and for repaired probes.
        """
        found = np.full((len(self.grid.valid), 9, 3), np.nan)
        sums = self._projected(self.film.radiance_sums)
        found[self.grid.valid] = standard_error(sums, self.film.batch_counts)
        return found

    def as_json(self) -> dict[str, Any]:
        """Return the JSON that `save` writes; `sh.fromArray(json.coefficients[i])` makes a probe in three.js."""
        return {
            "quantity": "radiance",
            "unit": symbol(self.unit, "radiance"),
            "bounds": {"min": self.grid.lower.tolist(), "max": self.grid.upper.tolist()},
            "grid": list(self.grid.counts),
            "order": "x fastest, then y, then z; at the centres of cells",
            "valid": self.grid.valid.tolist(),
            "coefficients": [[float(f"{v:.7g}") for v in each.ravel()] for each in self.coefficients],
        }

    def save(self, path: str | Path) -> None:
        """Write the probes as JSON. Raises ImageError if the file cannot be written."""
        write_bytes((json.dumps(self.as_json()) + "\n").encode(), Path(path))

    def _projected(self, radiance: Float64) -> Float64:
        """Return coefficients (B, V, 9, 3) from films (B, H, W, 3) of white receivers."""
        count = int(self.grid.valid.sum()) * len(_NORMALS)
        measured = radiance.reshape(len(radiance), -1, 3)[:, :count].reshape(len(radiance), -1, len(_NORMALS), 3)
        return np.asarray(np.pi * np.einsum("ck,bvkr->bvcr", _FROM_IRRADIANCE, measured))


@with_options()
def probes(
    scene: AnyScene,
    grid: tuple[int, int, int] = DEFAULT_GRID,
    bounds: ArrayLike | None = None,
    *,
    integrator: Integrator | IntegratorSettings = AUTO,
    spp: int | None = None,
    white_sky: bool = False,
    parameters: Mapping[str, object] | None = None,
    **options: Unpack[RenderKeywords],
) -> Probes:
    """Compute light probes: second-order spherical harmonics of incident radiance at the points of a grid.

    Parameters
    ----------
    scene      : a scene as for `load_scene`; it needs light, but no camera
    grid       : number of probes along x, y and z, at the centres of equal cells
    bounds     : (2, 3) lower and upper corner of the grid's box; default: that of the scene
    integrator : see `irradiance`
    spp        : paths per normal (a probe has 50); default {default_spp}
    white_sky  : light a scene without lights by a white sky of radiance 1
    film       : `Probes.film` of an earlier, identical call, to resume
    The other parameters are those of `render`.
    {options}

    Probes inside solids get the mean of their valid neighbours (`Probes.repaired`, `ProbeGrid.valid`).

    Raises and warns as `irradiance` does; SceneError if all probes are inside solids.

    Example
    -------
    >>> found = probes("cornell-box", grid=(2, 2, 2), spp=16)
    >>> found.coefficients.shape
    (8, 9, 3)
    """
    with aside("camera", "light", "picture"):
        loaded = load_scene(scene, parameters)
    loaded = lit(loaded, white_sky, ambient=options.get("ambient"))
    where = ProbeGrid.of(loaded, grid, bounds, budget_for(loaded, integrator, _of_integrators(options)))
    measured = irradiance(loaded, *where.receivers(), integrator=integrator, spp=spp, **options)
    return Probes(where, measured.film)


def _of_integrators(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a call that belong to an integrator."""
    return RunOptions.taken_from(dict(given))[1]


def _inside(scene: Scene, positions: Float64, geometry_budget: int) -> Bools:
    """Return (N,) bool: True if most rays from a position (N, 3) hit unlit backs, or insides of solids."""
    streamed = StreamedRays(scene, geometry_budget) if scene.shapes.streams else None
    scene = in_memory(scene)
    if not len(scene.triangles):
        assert streamed is not None, "a scene without surfaces is not asked"
        return Covered(streamed, None).below(positions)
    sides = Sides.of(scene, streamed=streamed is not None)
    turn = np.pi * (3 - math.sqrt(5)) * np.arange(_LOOKS)  # the directions are a spherical Fibonacci lattice
    z = 1 - (2 * np.arange(_LOOKS) + 1) / _LOOKS
    r = np.sqrt(1 - z * z)
    around = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    origins = np.repeat(positions, _LOOKS, axis=0)
    directions = np.tile(around, (len(positions), 1))
    parts = []
    for first in range(0, len(origins), _RAYS_TOGETHER):
        check_time()
        part = slice(first, first + _RAYS_TOGETHER)
        parts.append(sides.cast(origins[part], directions[part], np.full(len(origins[part]), -1)))
    hit, side, distance = (np.concatenate(each) for each in zip(*parts, strict=True))
    dark = (hit >= 0) & ~sides.lit[hit, side] & ((side == 1) | sides.hidden[hit, side])
    if streamed is not None:
        covered = Covered(streamed, sides)
        below = covered.below(positions)
        some = np.repeat(below, _LOOKS)
        hits = streamed.cast(origins[some], directions[some])
        ground, _ = covered.ground(hits, directions[some], distance[some])
        dark[some] = (dark[some] & (distance[some] < hits.distance)) | ground
    return np.asarray(dark.reshape(-1, _LOOKS).mean(axis=1) > _MOSTLY)


def _repaired(coefficients: Float64, grid: ProbeGrid) -> Float64:
    """Return (N, 9, 3) coefficients with each invalid probe replaced by the mean of its up to 26 known neighbours.

    Probes beside valid probes come first, then their neighbours, until all probes are known.
    """
    nx, ny, nz = grid.counts
    values = coefficients.reshape(nz, ny, nx, 9, 3).copy()
    known = grid.valid.reshape(nz, ny, nx).copy()
    while not known.all():
        padded = np.pad(np.where(known[..., None, None], values, 0.0), ((1, 1),) * 3 + ((0, 0),) * 2)
        there = np.pad(known, 1)
        total, count = np.zeros_like(values), np.zeros(known.shape)
        for dz, dy, dx in product(range(3), repeat=3):
            window = slice(dz, dz + nz), slice(dy, dy + ny), slice(dx, dx + nx)
            total += padded[window]
            count += there[window]
        fresh = ~known & (count > 0)
        values[fresh] = total[fresh] / count[fresh][:, None, None]
        known |= fresh
    return values.reshape(-1, 9, 3)
