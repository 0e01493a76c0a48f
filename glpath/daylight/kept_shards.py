"""Folder with the finished shards (ranges of sensors) of a computation, from which another call resumes."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from glpath.daylight.coefficients import DaylightCoefficients
from glpath.errors import ImageError

_NAME = re.compile(r"([0-9]+)-of-([0-9]+)\.npz")


class KeptShards:
    """Folder with the finished shards (ranges of sensors) of a computation.

    work  : identifier of the computation, as in `Shard`; shards of another computation have a different one
    count : number of shards; if the folder already has shards, the number in their names replaces it

    Raises ImageError if the path is not a folder.
    """

    def __init__(self, folder: Path, work: str, count: int) -> None:
        if os.path.exists(folder) and not os.path.isdir(folder):
            raise ImageError(
                f"{folder}: is a file, where a cluster keeps a folder of shards.",
                "It may be of a computation by one process: resume that one, or remove the file.",
            )
        self._folder, self._work = folder, work
        self._files: dict[int, Path] = {}
        for path in sorted(folder.glob("*.npz")) if os.path.isdir(folder) else []:
            match = _NAME.fullmatch(path.name)
            if match is not None:
                number, count = map(int, match.groups())
                self._files[number] = path
        #: Number of shards into which the computation is divided.
        self.count = count

    def read(self) -> dict[int, DaylightCoefficients]:
        """Return the finished shards by number. Raises ImageError for shards of another computation."""
        found = {}
        for number, path in self._files.items():
            part = DaylightCoefficients.load(path)
            if part.shard is None or part.shard.work != self._work:
                raise ImageError(
                    f"{path}: is of another scene, other sensors or settings.",
                    f"Remove the folder {self._folder} to begin anew, or give what it was begun with.",
                )
            found[number] = part
        return found

    def keep(self, number: int, part: DaylightCoefficients) -> None:
        """Write a finished shard. Raises ImageError if the file cannot be written."""
        self._folder.mkdir(parents=True, exist_ok=True)
        part.save(self._folder / f"{number}-of-{self.count}.npz")

    def remove(self) -> None:
        """Delete the folder; called when the whole computation is complete."""
        shutil.rmtree(self._folder, ignore_errors=True)
