"""Radiative exchange between grey, diffuse faces, from their view factors: net fluxes and Gebhart's factors.

Radiosities J solve J = e sigma T^4 + (1 - e) G, with the irradiance G = F J + F_s sigma T_s^4. A face of unknown
temperature has no net flux, so J = G.

Cost:    one sparse solution of N equations; Gebhart's factors are a dense matrix.
Poor at: mirrors, gases that absorb, and emissivities that differ between the wavelengths of sender and receiver.
Call it once for each band.
Sources: Hottel & Sarofim 1967; Gebhart 1961; Howell, Menguc, Daun & Siegel, Thermal radiation heat transfer, 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from glpath.errors import UsageError
from glpath.radiosity.memory import require_memory
from glpath.system.frames import data_frame

Float64 = NDArray[np.float64]

#: Stefan-Boltzmann constant, W m^-2 K^-4 (CODATA 2018).
SIGMA = 5.670374419e-8

# Maximum temperature, K, whose fourth power is finite.
_HOTTEST = 1e60
_RANGE = f"0 to {_HOTTEST:g} K"
# Opening of a row up to which surroundings do not determine its temperature, unless the row's error is larger.
_CLOSED = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class RadiativeExchange:
    """Radiative exchange of N faces in the steady state.

    temperature  : (N,) float64, K, as given; the equilibrium temperature for faces without a net flux
    emissivity   : (N,) float64
    areas        : (N,) float64
    radiosity    : (N,) float64, W m^-2, leaving each face, emitted and reflected
    arriving     : (N,) float64, W m^-2, irradiance of each face
    surroundings : temperature in K outside the faces; None for a closed room
    names        : names of the rows
    """

    temperature: Float64
    emissivity: Float64
    areas: Float64
    radiosity: Float64
    arriving: Float64
    matrix: Any
    surroundings: float | None
    names: tuple[str, ...] = ()

    @property
    def net_flux(self) -> Float64:
        """Net flux (N,) in W m^-2, radiosity minus irradiance; positive for faces that must be heated."""
        return np.asarray(self.radiosity - self.arriving)

    @property
    def net_power(self) -> Float64:
        """Net power (N,) in W, `net_flux` times areas in m^2. Its sum goes to the surroundings."""
        return np.asarray(self.net_flux * self.areas)

    @cached_property
    def gebhart(self) -> Float64:
        """Gebhart's factors (N, N) float64: B[i, j] is the fraction emitted by i that j absorbs after reflections.

        In a closed room the rows add up to 1. Raises UsageError if the matrix does not fit into memory.
        """
        n = len(self.areas)
        require_memory(24.0 * n * n, f"gebhart: a dense matrix of {n:,} rows", "Put faces together (groups).")
        reflected = self.matrix @ sparse.diags_array(1.0 - self.emissivity)
        absorbed = (self.matrix @ sparse.diags_array(self.emissivity)).toarray()
        return np.asarray(_factorised(sparse.eye_array(n) - reflected).solve(absorbed))

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each face. Raises GlpathError if pandas is missing."""
        columns = {
            name: getattr(self, name)
            for name in ("areas", "emissivity", "temperature", "radiosity", "arriving", "net_flux", "net_power")
        }
        return data_frame(columns, "face", list(self.names) or None, {"surroundings": self.surroundings})

    def __repr__(self) -> str:
        power = self.net_power
        if not len(power):
            return "<RadiativeExchange of no faces>"
        return (
            f"<RadiativeExchange of {len(power):,} faces: {self.temperature.min():.1f} to "
            f"{self.temperature.max():.1f} K, {power[power > 0].sum():.4g} W sent>"
        )


def exchange_of(
    found: Any, emissivity: ArrayLike, temperature: ArrayLike, surroundings: float | None
) -> RadiativeExchange:
    """Solve the radiative exchange, see `ViewFactors.exchange`."""
    n = len(found)
    e = _of_each("emissivity", emissivity, n)
    t = _of_each("temperature", temperature, n)
    _check("emissivity", e, ~((e >= 0) & (e <= 1)), "between 0 and 1")
    unknown = np.isnan(t)
    _check("temperature", t, ~unknown & ~((t >= 0) & (t <= _HOTTEST)), f"{_RANGE}, or NaN where no net flux leaves")
    outside = np.zeros(n)
    if surroundings is None:
        found.check_closed("exchange")
    elif not 0 <= surroundings <= _HOTTEST:
        raise UsageError(f"exchange: surroundings is {surroundings:g}, but must be {_RANGE}.")
    else:
        outside = np.clip(found.enclosure, 0.0, None) * SIGMA * surroundings**4
    emits = np.where(unknown, 0.0, e)
    own = np.where(unknown, 0.0, e * SIGMA * np.where(unknown, 0.0, t) ** 4)
    reflects = 1.0 - emits
    _check_emitters(found, emits > 0, surroundings)
    system = sparse.eye_array(n) - sparse.diags_array(reflects) @ found.matrix
    j = _factorised(system).solve(own + reflects * outside)
    arriving = found.matrix @ j + outside
    # A face without a net flux emits what it absorbs: e sigma T^4 = e G.
    reached = (np.clip(arriving, 0.0, None) / SIGMA) ** 0.25
    return RadiativeExchange(
        np.where(unknown, reached, t), e, found.areas, j, arriving, found.matrix, surroundings, found.names
    )


def _check_emitters(found: Any, emits: NDArray[np.bool_], surroundings: float | None) -> None:
    """Raise UsageError for a room in which no face emits. A room is a set of faces that see one another.

    Surroundings emit into a room that has an opening. Faces without an area see nothing and are not checked.
    """
    sees = sparse.csr_array(found.matrix, copy=True)
    sees.eliminate_zeros()
    if not sees.nnz:
        return
    lit = emits if surroundings is None else emits | (found.enclosure > np.maximum(_CLOSED, found.error))
    has_area = np.diff(sees.indptr) > 0
    room = connected_components(sees, directed=False)[1]
    dark = np.flatnonzero(has_area & (np.bincount(room, has_area & lit)[room] == 0))
    if dark.size:
        i = int(dark[0])
        name = f" ({found.names[i]})" if found.names else ""
        raise UsageError(
            f"exchange: no face emits in the room of row {i}{name}: temperatures are NaN or emissivities 0.",
            "Give one face of each room a temperature, and an emissivity above 0.",
        )


def _factorised(system: Any) -> Any:
    try:
        return splu(sparse.csc_array(system))
    except RuntimeError as error:  # singular, because some faces only reflect and see no absorbing face
        raise UsageError(
            "exchange: some faces reflect everything and see only such faces, so that their light has no end.",
            "Give them an emissivity above 0.",
        ) from error


def _of_each(name: str, given: ArrayLike, n: int) -> Float64:
    values = np.asarray(given, np.float64)
    if values.shape not in ((), (n,)):
        raise UsageError(
            f"exchange: {name} of shape {values.shape}, but there are {n:,} faces: one number, or {n:,}."
        )
    return np.array(np.broadcast_to(values, n))


def _check(name: str, values: Float64, wrong: NDArray[np.bool_], allowed: str) -> None:
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        raise UsageError(f"exchange: {name}[{i}] is {values[i]:g}, but must be {allowed}.")
