"""Checkpoints of visibility words, so that a killed process loses little work.

Without a stream, each word is appended when it is found. The file has a line that identifies the work, then records
of equal size in order. A record has a word for each point, and the transmittances of its 32 directions if the scene
has thin glass. An incomplete last record is ignored and overwritten. A file that ends within its first line has
nothing of any work, and counts as missing. With a stream, words become final only at the end of the pass.
They are rewritten at intervals, with the number of chunks already traced. Locks are those of `DaylightCheckpoint`.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.gl.parallel_rays import WORD, Seen
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import check_writable, open_without_links, reason_of, short_name, whole_file

_HEAD = "glpath daylight 1 {}\n"
_STREAM_HEAD = "glpath daylight stream 1 {}\n"
#: Interval between checkpoints of a pass over a stream, seconds.
_PASS_SECONDS = 30.0


class KeptWords(CheckpointFile):
    """Checkpoint file of a computation without streams."""

    work = "the computation"

    def read(self, key: str, points: int, transmits: bool) -> list[Seen]:
        """Return the words stored for the work with hash `key` (SHA-256, hex).

        Raises ImageError if the file belongs to other work, cannot be read, or can never be written.
        """
        check_writable(self.path)
        self._head = _HEAD.format(key).encode()
        self._size = points * (4 + (2 * WORD if transmits else 0))
        self._records = 0
        if not self.found():
            return []
        try:
            with open(self.path, "rb") as file:
                if not _has_head(file, self._head, self.path):
                    return []
                self._records = (os.path.getsize(self.path) - len(self._head)) // self._size
                return [_record(file.read(self._size), points, transmits) for _ in range(self._records)]
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error

    def keep(self, done: int, words: NDArray[np.uint32], shares: NDArray[np.float16] | None, last: bool) -> None:
        """Write the records that are not in the file yet.

        done   : number of words that are done
        words  : (W, N), of which the first `done` rows are written
        shares : (W, 32, N) transmittances; None if nothing transmits
        last   : as in `written_by`
        """

        def write(file: BinaryIO, first: int) -> None:
            for k in range(first, done):
                file.write(np.ascontiguousarray(words[k], "<u4").tobytes())
                if shares is not None:
                    file.write(np.ascontiguousarray(shares[k], "<f2").tobytes())

        def save(path: Path) -> None:
            end = len(self._head) + self._records * self._size
            if self._records == 0 or not _has_own_content(path, end):
                with whole_file(path) as part, open(part, "wb") as file:
                    file.write(self._head)
                    write(file, 0)
                return
            try:
                with open(path, "r+b", opener=open_without_links) as file:
                    file.seek(end)
                    write(file, self._records)
            except OSError as error:
                raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error

        if self.written_by(save, done, last):
            self._records = done


class KeptPass(CheckpointFile):
    """Checkpoint file of one pass over a stream.

    done : number of chunks that the words in the file include
    """

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
                if not _has_head(file, self._head, self.path):
                    return 0, None
                done = int.from_bytes(file.read(8), "little")
                content = file.read()
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        if len(content) != 4 * shape[0] * shape[1]:
            raise _of_other_work(self.path)
        self._last_step = done
        return done, np.frombuffer(content, "<u4").reshape(shape).astype(np.uint32)

    def keep(self, done: int, words: NDArray[np.uint32], last: bool) -> None:
        """Write the file now; `last` is as in `written_by`."""

        def save(path: Path) -> None:
            with whole_file(path) as part, open(part, "wb") as file:
                file.write(self._head + done.to_bytes(8, "little"))
                for word in words:
                    file.write(np.ascontiguousarray(word, "<u4").tobytes())

        self.written_by(save, done, last)


def _has_own_content(path: Path, size: int) -> bool:
    """Return True if the path is a file of at least `size` bytes that has no other name.

    Appending to a link would change the file to which it leads, and appending to a hard link a copy that the user
    has put aside.
    """
    try:
        status = os.lstat(path)
    except OSError:
        return False
    return stat.S_ISREG(status.st_mode) and status.st_nlink == 1 and status.st_size >= size


def _has_head(file: BinaryIO, head: bytes, path: Path) -> bool:
    """Read the first line, and return False if the file ends within it. Raises ImageError for another line."""
    found = file.read(len(head))
    if not head.startswith(found):
        raise _of_other_work(path)
    return found == head


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
