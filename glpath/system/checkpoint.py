"""A file that keeps the state of unfinished work, so that whatever ends the process loses no more than a little.

It is replaced in one step, and is on the disk after that, so that there is a whole one at any moment. A state that
cannot be written leaves the one before, and a line in the log, and the work continues. Within a `with` block no
other process has it (`locks`).
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from glpath.errors import ImageError
from glpath.system.files import reason_of, remove_parts
from glpath.system.locks import Lock, Locked

log = logging.getLogger("glpath")


@dataclass
class CheckpointFile(Locked):
    """Where it is, and how often it is written; who has work to keep says when a step is done.

    As a `with` block it keeps other processes from the file, or raises GlpathError, which names who has it.

    path    : of the file
    seconds : between two; None: not by time
    steps   : between two; None: not by number
    written : how often it was
    failure : why it could not be, the last time; None where it could
    took    : seconds that the last one took
    """

    #: What has it, in the words of the message; and what continues where it cannot be written.
    holder: ClassVar[str] = "work that resumes from it"
    work: ClassVar[str] = "the work"

    path: Path
    seconds: float | None = None
    steps: int | None = None
    written: int = 0
    failure: str | None = None
    took: float = 0.0
    _last_time: float = field(default_factory=time.monotonic)
    _last_step: int = 0
    _reasons: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        self._lock = Lock(self.path, self.holder)

    def found(self) -> bool:
        """Whether there is one to resume from; what a killed process has left half-written is removed."""
        remove_parts(self.path)
        return os.path.exists(self.path)

    def due(self, step: int) -> bool:
        """Whether it is time to write it, after so many steps."""
        by_time = self.seconds is not None and time.monotonic() - self._last_time >= self.seconds
        return by_time or (self.steps is not None and step - self._last_step >= self.steps)

    def written_by(self, save: Callable[[Path], None], step: int) -> bool:
        """Write it now; whether that went well. Failures are reported in the log, each reason once."""
        started = time.monotonic()
        try:
            save(self.path)
        except ImageError as error:
            self.failure = error.message
            reason = reason_of(error.__cause__ or error)
            if reason not in self._reasons:
                self._reasons.add(reason)
                log.warning("checkpoint: %s; %s continues", error.message.rstrip("."), self.work)
        else:
            self.failure = None
            self.written += 1
        # Of the end, so that a slow disk is not all that the time goes into.
        self._last_time, self._last_step = time.monotonic(), step
        self.took = self._last_time - started
        return self.failure is None

    def remove(self) -> None:
        """Remove the file, where there is one. Raises ImageError."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise ImageError(f"{self.path}: cannot be removed: {reason_of(error)}.") from error
