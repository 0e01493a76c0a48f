"""A film on disk while it grows, so that whatever ends the process loses no more than what came after.

    with Checkpoint("a.checkpoint.npz", seconds=60) as checkpoint:
        film = glpath.render(scene, spp=4096, film=checkpoint.load(), on_step=checkpoint)

The file is a film like any other (`Film.load`), of sums and counts: a render that resumes from it is bit-identical
to an uninterrupted one, on one device. There is a whole file at any moment, and within the block no other process
has it (`glpath.system.checkpoint`).

Cost:     a write of 24 bytes per pixel and batch, 50 MB for 512 x 512, each time; rendering waits for it.
Poor at:  two processes with one checkpoint without the block: each replaces the other's.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import is_stream, short_name

log = logging.getLogger("glpath")


@dataclass
class Checkpoint(CheckpointFile):
    """Where the film goes, and how often. To be called with the film after every step.

    steps : path sets
    film  : that it was called with last
    """

    holder = "a render that resumes from it"
    work = "rendering"

    film: Film | None = None

    def load(self) -> Film | None:
        """The film to resume from; None where there is none yet. Raises ImageError for a file that is no film."""
        if not self.found():
            return None
        film = Film.load(self.path)
        self._last_step = film.path_sets
        return film

    def __call__(self, film: Film) -> None:
        """Write the film if it is time for that."""
        self.film = film
        if self.due(film.path_sets):
            self.write(film)

    def write(self, film: Film) -> bool:
        """Write it now; whether that went well."""
        if well := self.written_by(film.save, film.path_sets):
            text = "checkpoint: %s path sets in %s, written in %.2f s"
            log.info(text, film.path_sets, self.path, self.took)
        return well


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
    return of_films[0] if of_films else files[0].with_name(short_name("", files[0].stem, ".checkpoint.npz"))
