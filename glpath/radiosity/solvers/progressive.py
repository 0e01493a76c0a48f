"""Progressive refinement (Cohen et al. 1988): the patch with the most unshot energy shoots, again and again.

    B_i = E_i + rho_i sum_j F_ij B_j

is solved one column at a time. At any time, the elements hold the irradiance from all radiosity shot so far.
Patches and elements follow Cohen et al. 1986: if the radiosity changes fast across elements, they are split, and
gather from all patches that shot.

M. Cohen, S. Chen, J. Wallace, D. Greenberg, "A progressive refinement approach to fast radiosity image generation",
1988. M. Feda, W. Purgathofer, "Accelerating radiosity by overshooting", 1992.

Cost:     a column of form factors per patch that shoots, cached for its next shot.
Poor at:  reflectances near 1, with which convergence is slow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.form_factors.transport import Transport
from glpath.radiosity.mesh.reconstruct import at_corners
from glpath.radiosity.shafts.options import Statistics
from glpath.scene.model import Float64
from glpath.system.kernels import kernel

#: Number of next patches whose form factor columns other cores may compute ahead.
_AHEAD = 64


class Refinement:
    """State of a progressive solution.

    irradiance : (2, R, 3) irradiance H of the elements' sides, W m^-2: [0] direct, from light that patches emit and
                 light of other sources, which is included from the start; [1] indirect, from light that patches
                 reflect
    shot       : (2, Q, 3) radiosity that the patches' sides have shot: [0] emitted, [1] reflected
    unshot     : (Q, 3) radiosity that they have not shot; below 0 after overshooting
    splits     : list with an (E,) bool for each refinement in order, True for the elements that were split
    """

    def __init__(self, transport: Transport, overshoot: bool = False) -> None:
        self.transport = transport
        self.overshoot = overshoot
        lit = transport.from_lights()
        self.irradiance: Float64 = np.stack([lit, np.zeros_like(lit)])
        first = transport.sent_on(lit)
        self.unshot: Float64 = transport.sides.emission + first
        self.shot: Float64 = np.zeros((2, *self.unshot.shape))
        self._steps = np.zeros(1, np.int64)
        self.splits: list[NDArray[np.bool_]] = []
        self._before_split: dict[str, NDArray[Any]] | None = None
        self._emitted = float((self.unshot.sum(axis=1) * transport.areas).sum())

    @property
    def steps(self) -> int:
        """Number of shots."""
        return int(self._steps[0])

    def _energy(self) -> Float64:
        """Return (Q,), the unshot energy of each patch's side, summed over the channels' absolute values."""
        energy = np.empty(len(self.unshot))
        _energy(self.unshot, self.transport.areas, energy)
        return energy

    @property
    def unshot_share(self) -> float:
        """Unshot energy as a fraction of the initial energy: emission, and the first reflection of other lights."""
        return float(self._energy().sum()) / self._emitted if self._emitted > 0 else 0.0

    def step(self, energy: Float64 | None = None) -> float:
        """Shoot the patch with the most unshot energy; return the fraction that is received, 1 in a closed room."""
        t = self.transport
        unshot = self._energy() if energy is None else energy
        side = int(np.argmax(unshot))
        column = t.column(side, lambda: np.argsort(-unshot)[:_AHEAD].tolist())
        sent = self.unshot[side].copy()
        if self.overshoot:
            # Add the light that this patch will reflect if the energy unshot by the others spreads evenly (Feda &
            # Purgathofer 1992).
            rest = (self.unshot * t.areas[:, None]).sum(axis=0) - sent * t.areas[side]
            sent += np.maximum(t.sides.reflectance[side] * rest / t.areas.sum(), 0.0)
        surfaces = _Surfaces(
            t.sides.emission, t.elements.reflectance, t.elements.transmittance, t.share, t.patch, t.behind, t.areas
        )
        light = _Light(self.irradiance, self.shot, self.unshot, self._steps)
        received = _shoot(side, sent, column, surfaces, light, np.empty((2, 3)))
        return float(received / t.areas[side])

    def run(self, until: float, max_count: int, on_step: Callable[[float], None]) -> None:
        """Shoot until the unshot fraction is at most `until`, or until `max_count` shots in all."""
        while self.steps < max_count:
            energy = self._energy()
            left = float(energy.sum())
            if left <= until * self._emitted:
                break
            self.step(energy)
            on_step(left / self._emitted)
        on_step(self.unshot_share)

    def ambient(self) -> Float64:
        """Return (3,), irradiance that the unshot energy will add if it spreads evenly [Cohen et al. 1988].

            sum dB A / sum A * (1 + rho + rho^2 + ...), rho the mean reflectance

        All energy is assumed to stay among the sides that reflect or emit, which is too much in an open scene.
        """
        t = self.transport
        total = t.areas.sum()
        mean = (self.unshot * t.areas[:, None]).sum(axis=0) / total
        reflectance = (t.sides.reflectance * t.areas[:, None]).sum(axis=0) / total
        return np.asarray(np.maximum(mean, 0.0) / (1 - reflectance))

    def split(self, threshold: float, max_count: int) -> int:
        """Split the elements across which the radiosity changes fast, the fastest first; return their number.

        threshold : minimum difference between two corners, as a fraction of the scene's mean radiosity
        max_count      : maximum number of elements to split
        """
        t = self.transport
        elements = t.elements
        reflected = np.zeros((2, len(t.mesh.elements), 3))
        reflected[elements.back, elements.element] = elements.reflectance * self.irradiance.sum(axis=0)
        change = np.ptp(at_corners(t.mesh, reflected), axis=2).max(axis=(0, 2))
        areas = t.mesh.areas[elements.element]
        mean = (reflected[elements.back, elements.element] * areas[:, None]).sum() / (3 * areas.sum())
        which = change > threshold * mean
        if which.sum() > max_count:
            which &= change >= np.sort(change[which])[-max_count] if max_count > 0 else False
        if not which.any():
            return 0
        self._before_split = self.state()
        self.irradiance = t.refine(which, self.irradiance, self.shot)
        self.unshot = t.sides.emission + t.sent_on(self.irradiance.sum(axis=0)) - self.shot.sum(axis=0)
        self.splits.append(which)
        self._before_split = None
        return int(which.sum())

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all data that the solution depends on, except form factors, for `restore`.

        If a split was interrupted, this is the state before it.
        """
        if self._before_split is not None:
            return self._before_split
        took = self.transport.statistics
        return {
            "irradiance": self.irradiance,
            "shot": self.shot,
            "unshot": self.unshot,
            "steps": np.int64(self.steps),  # type: ignore[dict-item]
            "took": np.array([took.rays, took.shafts, took.empty_shafts]),
            "split_sizes": np.array([len(which) for which in self.splits], np.int64),
            "splits": np.concatenate([*self.splits, np.zeros(0, bool)]),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state of the same scene and settings. Raises ValueError for a state of another mesh."""
        ends = np.cumsum(state["split_sizes"])
        for which in np.split(state["splits"], ends[:-1]) if len(ends) else []:
            # Passing 0 as the radiosity shot so far splits the elements without gathering.
            self.transport.refine(which, np.zeros_like(self.irradiance), np.zeros_like(self.shot))
            self.irradiance = np.zeros((2, len(self.transport.elements), 3))
            self.splits.append(which)
        for name in ("irradiance", "shot", "unshot"):
            if state[name].shape != getattr(self, name).shape:
                raise ValueError(
                    f"`{name}` is of another mesh: {state[name].shape}, {getattr(self, name).shape} here"
                )
            setattr(self, name, np.array(state[name]))
        self._steps[0] = state["steps"]
        rays, shafts, empty = map(int, state["took"])
        self.transport.statistics += Statistics(rays=rays, shafts=shafts, empty_shafts=empty)

    def result(self, ambient: bool = False) -> Float64:
        """Return irradiance (2, 2, E, 3) of `Transport.on_sides`; if `ambient`, add that of the unshot energy."""
        irradiance = self.irradiance.copy()
        if ambient:
            irradiance[1] += self.ambient()
        return self.transport.on_sides(irradiance)


@kernel
def _energy(unshot, areas, energy):  # type: ignore[no-untyped-def]
    for q in range(len(areas)):
        energy[q] = areas[q] * (abs(unshot[q, 0]) + abs(unshot[q, 1]) + abs(unshot[q, 2]))


class _Surfaces(NamedTuple):
    """Record of patches' and elements' sides for the kernels, see `Transport`.

    emission, areas, behind    : (Q, 3), (Q,) and (Q,) of the patches' sides
    reflectance, transmittance : (R, 3) of the elements' sides
    """

    emission: Float64
    reflectance: Float64
    transmittance: Float64
    share: Float64
    patch: NDArray[np.int64]
    behind: NDArray[np.int64]
    areas: Float64


class _Light(NamedTuple):
    """Arrays of `Refinement` for the kernels; `steps` is the (1,) number of shots."""

    irradiance: Float64
    shot: Float64
    unshot: Float64
    steps: NDArray[np.int64]


@kernel
def _shoot(side, sent, column, surfaces, light, parts):  # type: ignore[no-untyped-def]
    """Shoot the radiosity `sent` (3,) of a patch's side; return the sum over receivers of form factor times area.

    The emission is shot first, all of it in the patch's first shot. The rest of `sent` is reflected light. Signal
    handlers do not interrupt a kernel, so the light and the number of shots always agree.

    column : (R,) form factors from the elements to the patch's side

    parts : (2, 3) working memory
    """
    emission, reflectance, transmittance, share, patch, behind, areas = surfaces
    irradiance, shot, unshot, steps = light
    steps[0] += 1
    for c in range(3):
        parts[0, c] = emission[side, c] - shot[0, side, c]
        parts[1, c] = sent[c] - parts[0, c]
        unshot[side, c] -= sent[c]
    total = 0.0
    for part in range(2):
        if parts[part, 0] == 0 and parts[part, 1] == 0 and parts[part, 2] == 0:
            continue
        total = 0.0
        for c in range(3):
            shot[part, side, c] += parts[part, c]
        for r in range(len(column)):
            f = float(column[r])
            if f == 0:
                continue
            p = patch[r]
            total += f * share[r] * areas[p]
            for c in range(3):
                h = f * parts[part, c]
                irradiance[part, r, c] += h
                unshot[p, c] += h * reflectance[r, c] * share[r]
                if transmittance[r, c] > 0 and behind[p] >= 0:
                    unshot[behind[p], c] += h * transmittance[r, c] * share[r]
    return total
