"""Words of visibility on disk while they are found: each is appended as it comes, so that nothing computed is lost.

The file is a line that names the work, then records of equal size, in order: a word for each point, and the shares
of its 32 directions where glass has some. What a killed process has left of a record is cut off. Within a `with`
block no other process has the file.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from glpath.errors import ImageError
from glpath.gl.parallel_rays import WORD, Seen
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import reason_of

_HEAD = "glpath daylight 1 {}\n"


class KeptWords(CheckpointFile):
    """The file of one computation."""

    holder = "daylight coefficients that resume from it"
    work = "the computation"

    def read(self, key: str, points: int, transmits: bool) -> list[Seen]:
        """What there is of the work that `key` (SHA-256, hex) names, and begin to append; [] where there is none.

        Raises ImageError for a file of other work, and where it cannot be written.
        """
        head = _HEAD.format(key).encode()
        size = points * (4 + (2 * WORD if transmits else 0))
        try:
            if not self.found():
                self.path.write_bytes(head)
                return []
            with open(self.path, "r+b") as file:
                if file.read(len(head)) != head:
                    raise ImageError(
                        f"{self.path}: holds the words of other sensors or directions, or of another scene.",
                        "Remove it to begin anew.",
                    )
                whole = (os.path.getsize(self.path) - len(head)) // size
                found = [_record(file.read(size), points, transmits) for _ in range(whole)]
                file.truncate(len(head) + whole * size)
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        return found

    def append(self, seen: Seen) -> None:
        """Add a record. Raises ImageError where the disk has no room."""
        try:
            with open(self.path, "ab") as file:
                file.write(np.ascontiguousarray(seen.word, "<u4").tobytes())
                if seen.share is not None:
                    file.write(np.ascontiguousarray(seen.share, "<f2").tobytes())
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be written: {reason_of(error)}.") from error


def _record(content: bytes, points: int, transmits: bool) -> Seen:
    word = np.frombuffer(content, "<u4", points)
    share = np.frombuffer(content, "<f2", offset=4 * points).reshape(WORD, points) if transmits else None
    return Seen(word, share)


def kept_beside(out: Path) -> Path:
    """Where the words of an output are kept."""
    return out.with_name(out.name + ".part")
