"""Words of visibility on disk while they are found, so that little is lost of what is computed.

Word by word each is appended as it comes: the file is a line that names the work, then records of equal size, in
order: a word for each point, and the shares of its 32 directions where glass has some. What a killed process has
left of a record is cut off. Words that become final all at once, in a pass over a stream, are written anew from
time to time, with the number of chunks that they have seen. Within a `with` block no other process has the file.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.gl.parallel_rays import WORD, Seen
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import reason_of, whole_file

_HEAD = "glpath daylight 1 {}\n"
_STREAM_HEAD = "glpath daylight stream 1 {}\n"
#: Seconds between two writes of a pass over a stream.
_PASS_SECONDS = 30.0


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
                with open(self.path, "xb") as file:  # never through a link that leads to nothing yet
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
        """Add a record. Raises ImageError where the disk has no room."""
        try:
            with open(self.path, "ab") as file:
                file.write(np.ascontiguousarray(seen.word, "<u4").tobytes())
                if seen.share is not None:
                    file.write(np.ascontiguousarray(seen.share, "<f2").tobytes())
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be written: {reason_of(error)}.") from error


class KeptPass(CheckpointFile):
    """The file of one pass over a stream.

    done : chunks that the words in the file have seen
    """

    holder = KeptWords.holder
    work = KeptWords.work

    @classmethod
    def of(cls, path: Path) -> KeptPass:
        """One that is written every half minute."""
        return cls(path, seconds=_PASS_SECONDS)

    def read(self, key: str, shape: tuple[int, int]) -> tuple[int, NDArray[np.uint32] | None]:
        """How many chunks the words (W, N) of the work that `key` (SHA-256, hex) names have seen, and these words;
        0 and None where there are none.

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
        """Write it now."""

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
    """Where the words of an output are kept."""
    return out.with_name(out.name + ".part")
