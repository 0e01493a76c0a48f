"""Checkpoint file with the state of unfinished work, so that little is lost if the process ends.

The file is replaced atomically and flushed to disk, so a complete file exists at any time. If a state cannot be
written, the previous file stays, the log gets a line, and the work continues. Within a `with` block, the file is
locked against other processes (`locks`).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self

from glpath.errors import ImageError
from glpath.system.files import reason_of, remove_parts, replacing_links, special_kind
from glpath.system.heartbeat import heartbeat
from glpath.system.locks import Lock, Locked
from glpath.system.log import log
from glpath.system.outputs import rescued


@dataclass
class CheckpointFile(Locked):
    """Checkpoint file and its schedule. The computation calls `written_by` after each step for which `due` is True.

    A `with` block locks the file against other processes, or raises GlpathError with the name of the holder.

    path    : path of the file
    seconds : interval between two checkpoints; None: the schedule ignores the time
    steps   : number of steps between two checkpoints; None: the schedule ignores the steps
    written : number of checkpoints written
    failure : reason why the most recent checkpoint could not be written; None if it was written
    rescue  : sentence that names the temporary file with the final state, if its checkpoint could not be written;
              otherwise ""
    took    : seconds that the most recent checkpoint took
    is_output : True if the file is also an output of the command; an output may be a symbolic link
    """

    #: Phrases for messages: what holds the file's lock, and what continues after a failed checkpoint.
    holder: ClassVar[str] = "work that resumes from it"
    work: ClassVar[str] = "the work"

    path: Path
    seconds: float | None = None
    steps: int | None = None
    written: int = 0
    failure: str | None = None
    rescue: str = ""
    took: float = 0.0
    is_output: bool = False
    _last_time: float = field(default_factory=time.monotonic)
    _last_step: int = 0
    _reasons: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        self._lock = Lock(self.path, self.holder)

    def __enter__(self) -> Self:
        """Lock the file.

        Raises ImageError for a pipe, device or socket, and for a symbolic link that is no output of the command.
        """
        if kind := special_kind(self.path):
            raise ImageError(f"{self.path}: is {kind}, where a checkpoint must be a file.", "Name a file.")
        if os.path.islink(self.path) and not self.is_output:
            raise ImageError(
                f"{self.path}: is a symbolic link; a checkpoint is a file of its own, replaced and removed.",
                "Remove the link, or name an output in the folder to which it leads.",
            )
        return super().__enter__()

    def found(self) -> bool:
        """Remove half-written files of killed processes, and return True if a checkpoint exists."""
        remove_parts(self.path)
        return os.path.exists(self.path)

    def due(self, step: int) -> bool:
        """Return True if a checkpoint is due after `step` steps; also if the work has begun to count steps anew."""
        by_time = self.seconds is not None and time.monotonic() - self._last_time >= self.seconds
        return by_time or (self.steps is not None and not 0 <= step - self._last_step < self.steps)

    def written_by(self, save: Callable[[Path], None], step: int, last: bool = False) -> bool:
        """Write the file and return True on success. The log reports each reason of failure once.

        A link that replaced the file after `__enter__` is replaced by a file, unless the file is an output.

        save : function that writes the state to a path
        last : True if the work ends here; a state that cannot be written is then kept in a temporary folder
        """
        started = time.monotonic()
        try:
            with heartbeat.paused(), nullcontext() if self.is_output else replacing_links():
                save(self.path)
        except (ImageError, MemoryError) as error:
            if isinstance(error, ImageError):
                self.failure, reason = error.message, reason_of(error.__cause__ or error)
            else:
                self.failure, reason = f"{self.path}: cannot be written: too little memory.", "memory"
            text = self.failure.rstrip(".")
            if last:
                kept = "What is done is kept in {}; move it to the checkpoint's path to resume."
                self.rescue = rescued({self.path.name: save}, kept)
                log.warning("checkpoint: %s. %s", text, self.rescue)
            elif reason not in self._reasons:
                self._reasons.add(reason)
                log.warning("checkpoint: %s; %s continues", text, self.work)
        else:
            self.failure = None
            self.written += 1
        # Count the interval from the end of writing, so that a slow disk leaves time for the work.
        self._last_time, self._last_step = time.monotonic(), step
        self.took = self._last_time - started
        return self.failure is None

    def remove(self) -> None:
        """Remove the file or link if it exists. Raises ImageError if it is of another kind or cannot be removed."""
        if not os.path.islink(self.path) and (kind := special_kind(self.path)):
            raise ImageError(f"{self.path}: is {kind}, and is not removed.", "Name a file as the checkpoint.")
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be removed: {reason_of(error)}.") from error
