"""Checkpoint of a film on disk during a render, so that little is lost if the process ends.

    with Checkpoint("a.checkpoint.npz", seconds=60) as checkpoint:
        film = glpath.render(scene, spp=4096, film=checkpoint.load(), on_step=checkpoint)

The file is an ordinary film (`Film.load`) of sums and counts, so a resumed render is bit-identical to an
uninterrupted one on the same device. A complete file exists at any time, and within the block it is locked against
other processes (`glpath.system.checkpoint`).

Cost:     24 bytes written per pixel and batch, 50 MB for 512 x 512, for each checkpoint; rendering waits for it.
Poor at:  two processes with one checkpoint outside of the block, because each replaces the other's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import is_stream, short_name
from glpath.system.log import log


@dataclass
class Checkpoint(CheckpointFile):
    """Checkpoint of a render; it is called with the film after every step.

    steps : number of path sets between two checkpoints; None: not by path sets
    film  : film of the last call
    """

    holder = "a render that resumes from it"
    work = "rendering"

    film: Film | None = None

    def load(self) -> Film | None:
        """Return the film to resume from, or None without a file. Raises ImageError for other files."""
        if not self.found():
            return None
        film = Film.load(self.path)
        self._last_step = film.path_sets
        return film

    def __call__(self, film: Film) -> None:
        """Write the film if a checkpoint is due."""
        self.film = film
        if self.due(film.path_sets):
            self.write(film)

    def write_missing(self, film: Film) -> None:
        """Write the film unless the file already has all of its path sets."""
        if self.failure is not None or self._last_step != film.path_sets:
            self.write(film)

    def write(self, film: Film, last: bool = False) -> bool:
        """Write the film now, and return True on success; `last` is as in `written_by`."""
        if well := self.written_by(film.save, film.path_sets, last):
            text = "checkpoint: %s path sets in %s, written in %.2f s"
            log.info(text, film.path_sets, self.path, self.took)
        return well


def checkpoint_path(outputs: Sequence[Path], films: bool = True) -> Path:
    """Return the path of a render's checkpoint. Raises UsageError if no output is a file.

    films : True if outputs that end in .npz are films

    It is the first output that is a film, a.npz; otherwise a file beside the first output, a.checkpoint.npz for
    a.png.
    """
    files = [path for path in outputs if not is_stream(path)]
    if not files:
        raise UsageError(
            "checkpoint: no output is a file, beside which it would be.", "Name one, for example -o film.npz."
        )
    of_films = [path for path in files if films and path.suffix.lower() == ".npz"]
    return of_films[0] if of_films else files[0].with_name(short_name("", files[0].stem, ".checkpoint.npz"))
