"""A film on disk while it grows, so that whatever ends the process loses no more than what came after.

    with Checkpoint("a.checkpoint.npz", seconds=60) as checkpoint:
        film = glpath.render(scene, spp=4096, film=checkpoint.load(), on_step=checkpoint)

The file is a film like any other (`Film.load`), of sums and counts: what goes on from it has the bits of a render
in one go, on one device. It is replaced in one step, and is on the disk when that is over, so that there is a whole
one at any moment; what cannot be written leaves the one before. Within the block no other process has it (`locks`).

Cost:     a write of 24 bytes per pixel and batch, 50 MB for 512 x 512, each time; rendering waits for it.
Poor at:  two processes with one checkpoint without the block: each replaces the other's.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from glpath.errors import ImageError, UsageError
from glpath.film.film import Film
from glpath.system.files import is_stream, reason_of, remove_parts
from glpath.system.locks import Lock, Locked

log = logging.getLogger("glpath")


@dataclass
class Checkpoint(Locked):
    """Where the film goes, and how often. To be called with the film after every step.

    As a `with` block it keeps other processes from the file, or raises GlpathError, which names who has it.

    path      : .npz
    seconds   : between two; None: not by time
    path_sets : between two; None: not by number
    written   : how often it was
    failure   : why it could not be, the last time; None where it could
    film      : that it was called with last
    """

    path: Path
    seconds: float | None = None
    path_sets: int | None = None
    written: int = 0
    failure: str | None = None
    film: Film | None = None
    _last_time: float = field(default_factory=time.monotonic)
    _last_sets: int = 0
    _reasons: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        self._lock = Lock(self.path, "a render that goes on with it")

    def load(self) -> Film | None:
        """The film to go on with; None where there is none yet. Raises ImageError for a file that is no film."""
        remove_parts(self.path)
        if not self.path.exists():
            return None
        film = Film.load(self.path)
        self._last_sets = film.path_sets
        return film

    def __call__(self, film: Film) -> None:
        """Write the film if it is time for that."""
        self.film = film
        by_time = self.seconds is not None and time.monotonic() - self._last_time >= self.seconds
        by_sets = self.path_sets is not None and film.path_sets - self._last_sets >= self.path_sets
        if by_time or by_sets:
            self.write(film)

    def write(self, film: Film) -> bool:
        """Write it now; whether that went well. What goes wrong is told in the log, each reason once."""
        started = time.monotonic()
        try:
            film.save(self.path)
        except ImageError as error:
            self.failure = error.message
            reason = reason_of(error.__cause__ or error)
            if reason not in self._reasons:
                self._reasons.add(reason)
                log.warning("checkpoint: %s; rendering goes on", error.message.rstrip("."))
        else:
            self.failure = None
            self.written += 1
            took = time.monotonic() - started
            log.info("checkpoint: %s path sets in %s, written in %.2f s", film.path_sets, self.path, took)
        # Of the end, so that a slow disk is not all that the time goes into.
        self._last_time, self._last_sets = time.monotonic(), film.path_sets
        return self.failure is None

    def remove(self) -> None:
        """Remove the file, where there is one. Raises ImageError."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be removed: {reason_of(error)}.") from error


def checkpoint_path(outputs: Sequence[Path], films: bool = True) -> Path:
    """Where the checkpoint of a render is: the first output that is a film, a.npz; or else, beside the first one,
    a.checkpoint.npz for a.png. Raises UsageError where no output is a file.

    films : outputs that end in .npz are films
    """
    files = [path for path in outputs if not is_stream(path)]
    if not files:
        raise UsageError(
            "checkpoint: no output is a file, beside which it would be.", "Name one, for example -o film.npz."
        )
    of_films = [path for path in files if films and path.suffix.lower() == ".npz"]
    return of_films[0] if of_films else files[0].with_name(f"{files[0].stem}.checkpoint.npz")
