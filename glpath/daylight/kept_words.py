"""Checkpoints of visibility words, so that a killed process loses little work.

Without a stream, each word is appended when it is found. The file has a line that identifies the work, then records
of equal size in order. A record has a word for each point, and the transmittances of its 32 directions if the scene
has thin glass. An incomplete last record is cut off. With a stream, words become final only at the end of the pass.
They are rewritten at intervals, with the number of chunks already traced. Within a `with` block, the file is locked
against other processes.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.gl.parallel_rays import WORD, Seen
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import reason_of, short_name, whole_file

_HEAD = "glpath daylight 1 {}\n"
_STREAM_HEAD = "glpath daylight stream 1 {}\n"
#: Interval between checkpoints of a pass over a stream, seconds.
_PASS_SECONDS = 30.0


class KeptWords(CheckpointFile):
    """Checkpoint file of a computation without streams."""

    holder = "daylight coefficients that resume from it"
    work = "the computation"

    def read(self, key: str, points: int, transmits: bool) -> list[Seen]:
        """Return the words stored for the work with hash `key` (SHA-256, hex); create the file if it is missing.

        Raises ImageError if the file belongs to other work or cannot be written.
        """
        head = _HEAD.format(key).encode()
        size = points * (4 + (2 * WORD if transmits else 0))
        try:
            if not self.found():
                with open(self.path, "xb") as file:  # "x" does not follow a dangling link
                    file.write(head)
                return []
            with open(self.path, "r+b") as file:
                if file.read(len(head)) != head:
                    raise _of_other_work(self.path)
                whole = (os.path.getsize(self.path) - len(head)) // size
                found = [_record(file.read(size), points, transmits) for _ in range(whole)]
                file.truncate(len(head) + whole * size)
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        return found

    def append(self, seen: Seen) -> None:
        """Append a record. Raises ImageError if it cannot be written."""
        try:
            with open(self.path, "ab") as file:
                file.write(np.ascontiguousarray(seen.word, "<u4").tobytes())
                if seen.share is not None:
                    file.write(np.ascontiguousarray(seen.share, "<f2").tobytes())
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be written: {reason_of(error)}.") from error


class KeptPass(CheckpointFile):
    """Checkpoint file of one pass over a stream.

    done : number of chunks that the words in the file include
    """

    holder = KeptWords.holder
    work = KeptWords.work

    @classmethod
    def of(cls, path: Path) -> KeptPass:
        """Return a checkpoint that is due every half minute."""
        return cls(path, seconds=_PASS_SECONDS)

    def read(self, key: str, shape: tuple[int, int]) -> tuple[int, NDArray[np.uint32] | None]:
        """Return the number of chunks already traced and the words (W, N) so far; 0 and None without a file.

        key : SHA-256 (hex) of the work

        Raises ImageError for a file of other work.
        """
        self._head, self._shape = _STREAM_HEAD.format(key).encode(), shape
        if not self.found():
            return 0, None
        try:
            with open(self.path, "rb") as file:
                if file.read(len(self._head)) != self._head:
                    raise _of_other_work(self.path)
                done = int.from_bytes(file.read(8), "little")
                content = file.read()
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        if len(content) != 4 * shape[0] * shape[1]:
            raise _of_other_work(self.path)
        self._last_step = done
        return done, np.frombuffer(content, "<u4").reshape(shape).astype(np.uint32)

    def keep(self, done: int, words: NDArray[np.uint32]) -> None:
        """Write the file now."""

        def save(path: Path) -> None:
            with whole_file(path) as part, open(part, "wb") as file:
                file.write(self._head + done.to_bytes(8, "little"))
                for word in words:
                    file.write(np.ascontiguousarray(word, "<u4").tobytes())

        self.written_by(save, done)


def _of_other_work(path: Path) -> ImageError:
    return ImageError(
        f"{path}: holds the words of other sensors or directions, or of another scene.",
        "Remove it to begin anew.",
    )


def _record(content: bytes, points: int, transmits: bool) -> Seen:
    word = np.frombuffer(content, "<u4", points)
    share = np.frombuffer(content, "<f2", offset=4 * points).reshape(WORD, points) if transmits else None
    return Seen(word, share)


def kept_beside(out: Path) -> Path:
    """Return the path of an output's checkpoint."""
    return out.with_name(short_name("", out.name, ".part"))
