"""Solve the full matrix (Goral et al. 1984): all form factors and radiosities at once, to check other solvers.

C. Goral, K. Torrance, D. Greenberg, B. Battaile, "Modeling the interaction of light between diffuse surfaces",
1984.

Cost:     memory grows with the square of the number of patches, time for the solution with its cube.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, wait
from threading import Thread
from typing import Any

import numpy as np

from glpath.radiosity.form_factors.transport import Transport
from glpath.scene.model import Float64
from glpath.system.heartbeat import heartbeat

# Time between two reports to the watchdog during a call, seconds.
_BEAT_INTERVAL = 1.0


def solve_matrix(transport: Transport) -> Float64:
    """Return (2, R, 3) float64, direct and indirect irradiance of all elements, gathered from all patches."""
    t = transport
    factors = t.matrix()
    count = len(t.sides)
    between = np.zeros((count, count))
    _run_with_beats(np.add.at, between, t.patch, factors * t.share[:, None])
    lit = t.from_lights()
    first = t.sides.emission + t.sent_on(lit)
    radiosity = np.empty((count, 3))
    for c in range(3):
        system = np.eye(count) - t.sides.reflectance[:, c, None] * between
        if t.sides.transmittance.any():
            other = np.flatnonzero(t.behind >= 0)
            behind = t.behind[other]
            system[other] -= t.sides.transmittance[behind, c, None] * between[behind]
        radiosity[:, c] = _run_with_beats(np.linalg.solve, system, first[:, c])
    exact = factors.astype(np.float64)
    return np.stack([lit + exact @ t.sides.emission, exact @ (radiosity - t.sides.emission)])


def _run_with_beats(function: Callable[..., Any], *given: Any) -> Any:
    """Return the result of a call, which may take minutes, and report to the watchdog meanwhile.

    Ctrl-C does not wait for the call, but the process ends only after it: a library that is in a call when its
    process ends may hang.
    """
    running: Future[Any] = Future()

    def run() -> None:
        try:
            running.set_result(function(*given))
        except BaseException as error:
            running.set_exception(error)

    Thread(target=run).start()
    while wait([running], _BEAT_INTERVAL).not_done:
        heartbeat.beat()
    heartbeat.beat()
    return running.result()


def matrix_bytes(elements: int, patches: int) -> int:
    """Return the memory in bytes that `solve_matrix` takes for the sides of elements and patches."""
    return elements * patches * (4 + 8 + 8) + patches * patches * 8 * 4
