"""Checkpoint of a solver, from which it resumes bit-identically if its process was killed.

    checkpoint = SolverCheckpoint("s.checkpoint.npz", seconds=60)
    solution = solve_radiosity(scene, checkpoint=checkpoint)

Progressive refinement stores irradiance and the shot and unshot radiosity. Form factors are computed again, and
split elements are split again. Monte Carlo stores its sums. The matrix has no intermediate state; it is for small
scenes. While a solver runs, it locks the file against other processes (`locks`).

Cost:     48 bytes per element and 72 per patch for each write.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import whole_file
from glpath.system.npz import open_npz
from glpath.system.versions import versions

_FORMAT = 3


class Solver(Protocol):
    """Solver whose state can be stored."""

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all data that the solution depends on, complete even if a signal interrupted a step."""

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state."""


@dataclass
class SolverCheckpoint(CheckpointFile):
    """Checkpoint file of a solver, and the interval of its writes; `solve_radiosity` enters it as a `with` block.

    The steps that it counts are shots of a patch, or batches of particles.
    """

    holder = "a solver that resumes from it"
    work = "solving"

    _made_by: str = ""
    #: Seconds that the solver had run when it wrote the file.
    elapsed_s: float = 0.0

    def begin(self, solver: Solver, scene_hash: str, method: str, settings: Mapping[str, object]) -> bool:
        """Restore the solver from the file; return False if there is no file.

        Raises UsageError, with all differences, for a file of another scene, setting or version; ImageError for a
        file that is not a checkpoint.
        """
        wanted = {
            "scene": scene_hash,
            "method": method,
            **{f"settings.{name}": value for name, value in settings.items()},
            "version of glpath": versions("glpath").get("glpath", "absent"),
        }
        self._made_by = json.dumps(wanted)
        asked = json.loads(self._made_by)
        if not self.found():
            return False
        with open_npz(self.path, "a checkpoint of a radiosity solution", "Remove it to begin anew.") as stored:
            if (found := int(stored.read("solver_checkpoint", "iu", ()))) != _FORMAT:
                raise ValueError(f"it is of format {found}, this version of glpath has {_FORMAT}")
            held = stored.read_object("made_by")
            names = sorted({*asked, *held})
            differ = [name for name in names if held.get(name) != asked.get(name)]
            if differ:
                words = [f"{name} is {held.get(name)} in it, {asked.get(name)} is asked for" for name in differ]
                raise UsageError(
                    f"{self.path}: cannot be resumed from: {'; '.join(words)}.",
                    "Ask for what it was made with; or remove it, and the solver begins anew.",
                )
            elapsed_s = float(stored.read("elapsed_s", "f", ()))
            if not 0 <= elapsed_s < math.inf:
                raise ValueError(f"elapsed_s is {elapsed_s:g}, expected a finite number from 0 on")
            self.elapsed_s = elapsed_s
            solver.restore({name: stored.read(name, "iufb") for name in solver.state()})
        return True

    def step(self, solver: Solver, step: int, elapsed_s: float) -> None:
        """Write the state if it is due after `step` steps and `elapsed_s` seconds in all."""
        if self.due(step):
            self.write(solver, step, elapsed_s)

    def write(self, solver: Solver, step: int, elapsed_s: float, last: bool = False) -> None:
        """Write the state now; `last` is as in `written_by`."""

        def save(path: Path) -> None:
            with whole_file(path) as temporary, temporary.open("wb") as file:
                arrays: dict[str, Any] = solver.state()
                np.savez(
                    file,
                    solver_checkpoint=np.int64(_FORMAT),
                    made_by=np.array(self._made_by),
                    elapsed_s=np.float64(elapsed_s),
                    **arrays,
                )

        self.written_by(save, step, last)
