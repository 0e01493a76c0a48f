"""The state of a solver on disk while it works, so that it can resume where it was killed, bit-identical.

    checkpoint = SolverCheckpoint("s.checkpoint.npz", seconds=60)
    solution = solve_radiosity(scene, checkpoint=checkpoint)

Progressive refinement has irradiance and what is shot and unshot, of which all else follows: form factors are found
again, and elements that were split are split again. Monte Carlo has its sums. The matrix has nothing between its
beginning and its end; it is for small scenes. While it is solved no other process has the file (`locks`).

Cost:     a write of 48 bytes per element and 72 per patch, each time.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError, UsageError
from glpath.system.files import reason_of, remove_parts, whole_file
from glpath.system.locks import Lock, Locked
from glpath.system.npz import open_npz
from glpath.system.versions import versions

log = logging.getLogger("glpath")

_FORMAT = 1


class Solver(Protocol):
    """A solver with a state to keep."""

    whole: bool

    def state(self) -> dict[str, NDArray[Any]]:
        """All that the solution depends on."""

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from it."""


@dataclass
class SolverCheckpoint(Locked):
    """Where the state goes, and how often.

    As a `with` block it keeps other processes from the file, or raises GlpathError, which names the holder;
    `solve_radiosity` does so.

    path    : .npz
    seconds : between two; None: at a signal alone
    written : how often it was
    failure : why it could not be, the last time; None where it could
    """

    path: Path
    seconds: float | None = None
    written: int = 0
    failure: str | None = None
    _made_by: str = ""
    _last: float = field(default_factory=time.monotonic)
    _reasons: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        self._lock = Lock(self.path, "a solver that resumes from it")

    def begin(self, solver: Solver, scene_hash: str, method: str, settings: Mapping[str, object]) -> bool:
        """Resume from the file; whether there was one.

        Raises UsageError, with all that differs, for one of another scene, setting or version; ImageError for a
        file that is no checkpoint.
        """
        wanted = {
            "scene": scene_hash,
            "method": method,
            **{f"settings.{name}": value for name, value in settings.items()},
            "version of glpath": versions("glpath").get("glpath", "absent"),
        }
        self._made_by = json.dumps(wanted)
        asked = json.loads(self._made_by)
        remove_parts(self.path)
        if not self.path.exists():
            return False
        with open_npz(self.path, "a checkpoint of a radiosity solution", "Remove it to begin anew.") as stored:
            if (found := int(stored.read("solver_checkpoint", "iu", ()))) != _FORMAT:
                raise ValueError(f"it is of format {found}, this version of glpath has {_FORMAT}")
            held = json.loads(str(stored.read("made_by", "U", ())))
            names = sorted({*asked, *held})
            differ = [name for name in names if held.get(name) != asked.get(name)]
            if differ:
                words = [f"{name} is {held.get(name)} in it, {asked.get(name)} is asked for" for name in differ]
                raise UsageError(
                    f"{self.path}: cannot be resumed from: {'; '.join(words)}.",
                    "Ask for what it was made with; or remove it, and the solver begins anew.",
                )
            solver.restore({name: stored.read(name, "iufb") for name in solver.state()})
        return True

    def step(self, solver: Solver) -> None:
        """Write the state if it is time for that."""
        if self.seconds is not None and time.monotonic() - self._last >= self.seconds:
            self.write(solver)

    def write(self, solver: Solver) -> None:
        """Write it now, if it is whole. Failures are logged, each reason once."""
        if not solver.whole:
            return  # a signal came in the middle of a step; the file from before is good
        try:
            with whole_file(self.path) as temporary, temporary.open("wb") as file:
                arrays: dict[str, Any] = solver.state()
                np.savez(file, solver_checkpoint=np.int64(_FORMAT), made_by=np.array(self._made_by), **arrays)
        except ImageError as error:
            self.failure = error.message
            if (reason := reason_of(error.__cause__ or error)) not in self._reasons:
                self._reasons.add(reason)
                log.warning("checkpoint: %s; solving continues", error.message.rstrip("."))
        else:
            self.failure = None
            self.written += 1
        self._last = time.monotonic()
