"""Checkpoints of visibility words, so that a killed process loses little work.

Without a stream, each word is appended when it is found. The file has a line that identifies the work, then records
of equal size in order. A record has a word for each point, and the transmittances of its 32 directions if the scene
has thin glass. It ends with a checksum (CRC-32), which starts from the record's number. The first record that is
incomplete or damaged is ignored and overwritten, with all that follow. A file that ends within its first line has
nothing of any work, and counts as missing. With a stream, words become final only at the end of the pass.
They are rewritten at intervals, with the number of chunks already traced and a checksum. Locks are those of
`DaylightCheckpoint`.
"""

from __future__ import annotations

import os
import stat
import time
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.gl.parallel_rays import WORD, Seen
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import check_writable, open_without_links, reason_of, short_name, whole_file

_HEAD = "glpath daylight 2 {}\n"
_STREAM_HEAD = "glpath daylight stream 2 {}\n"
#: Interval between checkpoints of a pass over a stream, seconds.
_PASS_SECONDS = 30.0
#: Minimum time between two flushes of appended records to the disk, seconds. A flush takes longer than most words.
_FLUSH_SECONDS = 1.0
#: Size of a checksum, bytes.
_CHECKSUM = 4


class KeptWords(CheckpointFile):
    """Checkpoint file of a computation without streams."""

    work = "the computation"

    def read(self, key: str, points: int, transmits: bool) -> list[Seen]:
        """Return the words stored for the work with hash `key` (SHA-256, hex).

        Raises ImageError if the file belongs to other work, cannot be read, or can never be written.
        """
        check_writable(self.path)
        self._head = _HEAD.format(key).encode()
        self._size = points * (4 + (2 * WORD if transmits else 0)) + _CHECKSUM
        self._records = 0
        self._flushed = 0.0
        if not self.found():
            return []
        found: list[Seen] = []
        try:
            with open(self.path, "rb") as file:
                if not _has_head(file, self._head, self.path):
                    return []
                while _is_whole(content := file.read(self._size), len(found)):
                    found.append(_record(content, points, transmits))
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        self._records = len(found)
        return found

    def keep(self, done: int, words: NDArray[np.uint32], shares: NDArray[np.float16] | None, last: bool) -> None:
        """Write the records that are not in the file yet.

        done   : number of words that are done
        words  : (W, N), of which the first `done` rows are written
        shares : (W, 32, N) transmittances; None if nothing transmits
        last   : as in `written_by`
        """
        self._latest = done, words, shares

        def write(file: BinaryIO, first: int) -> None:
            for k in range(first, done):
                content = np.ascontiguousarray(words[k], "<u4").tobytes()
                if shares is not None:
                    content += np.ascontiguousarray(shares[k], "<f2").tobytes()
                file.write(content + zlib.crc32(content, k).to_bytes(_CHECKSUM, "little"))

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
                    if last or time.monotonic() - self._flushed >= _FLUSH_SECONDS:
                        file.flush()
                        os.fsync(file.fileno())
                        self._flushed = time.monotonic()
            except OSError as error:
                raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error

        if self.written_by(save, done, last):
            self._records = done

    def keep_rest(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the words of the most recent `keep` with last=True if it failed and an exception ends the work.

        Parameters are those of `__exit__`, for `ExitStack.push`.
        """
        if kind is not None and self.failure is not None and not self.rescue:
            self.keep(*self._latest, last=True)


class KeptPass(CheckpointFile):
    """Checkpoint file of one pass over a stream.

    done : number of chunks that the words in the file include
    """

    work = KeptWords.work

    @classmethod
    def of(cls, path: Path) -> KeptPass:
        """Return a checkpoint that is due every half minute."""
        return cls(path, seconds=_PASS_SECONDS)

    def read(self, key: str, shape: tuple[int, int], chunks: int) -> tuple[int, NDArray[np.uint32] | None]:
        """Return the number of chunks already traced and the words (W, N) so far; 0 and None without a file.

        key    : SHA-256 (hex) of the work
        chunks : number of chunks of the stream

        Raises ImageError for a file of other work, and for a damaged file.
        """
        self._head, self._shape = _STREAM_HEAD.format(key).encode(), shape
        if not self.found():
            return 0, None
        try:
            with open(self.path, "rb") as file:
                if not _has_head(file, self._head, self.path):
                    return 0, None
                content = file.read()
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be resumed from: {reason_of(error)}.") from error
        if len(content) != 8 + 4 * shape[0] * shape[1] + _CHECKSUM:
            raise _of_other_work(self.path)
        done = int.from_bytes(content[:8], "little")
        if done > chunks or not _is_whole(content, 0):
            found = f"{done:,} chunks, of a stream of {chunks:,}" if done > chunks else "a wrong checksum"
            raise ImageError(f"{self.path}: is damaged: it has {found}.", "Remove it to begin anew.")
        self._last_step = done
        return done, np.frombuffer(content, "<u4", shape[0] * shape[1], 8).reshape(shape).astype(np.uint32)

    def keep(self, done: int, words: NDArray[np.uint32], last: bool) -> None:
        """Write the file now; `last` is as in `written_by`."""

        def save(path: Path) -> None:
            with whole_file(path) as part, open(part, "wb") as file:
                file.write(self._head)
                content = done.to_bytes(8, "little")
                checksum = zlib.crc32(content)
                file.write(content)
                for word in words:
                    content = np.ascontiguousarray(word, "<u4").tobytes()
                    checksum = zlib.crc32(content, checksum)
                    file.write(content)
                file.write(checksum.to_bytes(_CHECKSUM, "little"))

        self.written_by(save, done, last)


def _is_whole(content: bytes, number: int) -> bool:
    """Return True if the bytes end with the checksum of the record with this number."""
    checksum = zlib.crc32(memoryview(content)[:-_CHECKSUM], number)
    return len(content) > _CHECKSUM and content[-_CHECKSUM:] == checksum.to_bytes(_CHECKSUM, "little")


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
        f"{path}: holds the words of other sensors or directions, of another scene, or of another version of "
        "glpath.",
        "Remove it to begin anew.",
    )


def _record(content: bytes, points: int, transmits: bool) -> Seen:
    word = np.frombuffer(content, "<u4", points)
    share = np.frombuffer(content, "<f2", offset=4 * points).reshape(WORD, points) if transmits else None
    return Seen(word, share)


def kept_beside(out: Path) -> Path:
    """Return the path of an output's checkpoint."""
    return out.with_name(short_name("", out.name, ".part"))
