"""Checkpoint folder with the finished shards (ranges of sensors) of a computation."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.errors import ImageError
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import reason_of, remove_parts

# Shard files are named K-of-N.npz, with K from 1 to N, both without leading zeros.
_NUMBERS = r"[1-9][0-9]*-of-[1-9][0-9]*"
_NAME = re.compile(rf"({_NUMBERS})\.npz")
# Pattern of the temporary name of a shard file that is being written, see `glpath.system.files.new_file`.
_PART_NAME = re.compile(rf"\.({_NUMBERS})\.[0-9a-f]{{8}}\.part\.npz")


class _ShardFile(CheckpointFile):
    """File of a finished shard."""

    work = "the computation"


class KeptShards:
    """Checkpoint folder with the finished shards (ranges of sensors) of a computation.

    work    : identifier of the computation, as in `Shard`; shards of another computation have a different one
    count   : number of shards; ignored if the folder already has shards, because their names contain the number
    sensors : number of sensors of the computation, the maximum number of shards
    failure : reason why the most recent shard that failed could not be written; None if none failed
    rescue  : sentence that names the temporary file of that shard, if the work ended; otherwise ""

    Raises ImageError if the path is not a folder, or if the names of its shards give different numbers of shards.
    Raises ImageError, too, for more shards than sensors, and for a shard number that is not from 1 to their number.
    Other files in the folder raise ImageError, because the folder is removed when the computation ends.
    """

    def __init__(self, folder: Path, work: str, count: int, sensors: int) -> None:
        if os.path.exists(folder) and not os.path.isdir(folder):
            raise ImageError(
                f"{folder}: is a file, where a cluster keeps a folder of shards.",
                "It may be of a computation by one process: resume that one, or remove the file.",
            )
        self._folder, self._work = folder, work
        self._files: dict[int, Path] = {}
        self._reasons: set[str] = set()
        self.failure: str | None = None
        self.rescue = ""
        for path in _content(folder):
            if (part := _PART_NAME.fullmatch(path.name)) is not None:
                remove_parts(folder / f"{part[1]}.npz")
                continue
            match = _NAME.fullmatch(path.name)
            if match is None or (self._files and int(match[1].split("-of-")[1]) != count):
                wanted = f"K-of-{count}.npz" if self._files else "K-of-N.npz"
                raise ImageError(
                    f"{folder}: has {path.name}; the folder of a cluster's shards has only files {wanted}.",
                    "Move the file elsewhere, or name another output.",
                )
            number, count = map(int, match[1].split("-of-"))
            if number > count or count > sensors:
                raise ImageError(
                    f"{folder}: has {path.name}; a shard K-of-N.npz of {sensors:,} sensors has K from 1 to N, and "
                    f"N from 1 to {sensors}.",
                    "Move the file elsewhere, or name another output.",
                )
            self._files[number] = path
        #: Number of shards into which the computation is divided.
        self.count = count

    def read(self) -> dict[int, DaylightCoefficients]:
        """Return the coefficients of the finished shards, by shard number.

        Raises ImageError if a shard belongs to another computation.
        """
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

    def keep(self, parts: Mapping[int, DaylightCoefficients], last: bool = False) -> None:
        """Write the finished shards that have no file yet.

        parts : coefficients of the finished shards, by shard number
        last  : True if the work ends with this call; shards that cannot be written then go to a temporary folder
        """
        self.failure, self.rescue = None, ""
        for number, part in parts.items():
            if number not in self._files:
                file = _ShardFile(self._folder / f"{number}-of-{self.count}.npz", _reasons=self._reasons)
                if file.written_by(part.save, number, last):
                    self._files[number] = file.path
                else:
                    self.failure, self.rescue = file.failure, file.rescue


def remove_shards(folder: Path) -> None:
    """Delete the shards in a folder, and the folder if nothing else is in it.

    Raises ImageError if the system refuses to delete them.
    """
    try:
        for path in _content(folder):
            if _NAME.fullmatch(path.name) is not None:
                path.unlink(missing_ok=True)
        if not _content(folder):
            folder.rmdir()
    except OSError as error:
        raise ImageError(f"{folder}: cannot be removed: {reason_of(error)}.") from error


def _content(folder: Path) -> list[Path]:
    """Return the sorted paths of the files in a folder; an empty list if the folder does not exist."""
    with suppress(FileNotFoundError):
        return sorted(folder.iterdir())
    return []
