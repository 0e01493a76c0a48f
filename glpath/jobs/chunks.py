"""Scheduler of path sets for workers of unknown speed, which decides on the next chunk and its size.

It only does arithmetic; `cluster` talks to the workers. A chunk is a range of path sets of a job. Films of chunks
merge into the job's film, bit for bit, for any division into chunks.

A chunk should take `seconds` of a worker's time, estimated from earlier chunks. Near the end, or the time limit,
chunks shrink, so that workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987). A failed chunk
is handed out again, up to `ATTEMPTS` times; then it is set aside, and the others continue. Its last attempt is made
alone, after all others, because it may have failed only because another chunk ended its worker. When nothing is
left to hand out, a late chunk may be given to a second worker (`straggler`), and the first result counts.
"""

from __future__ import annotations

import statistics
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from glpath.errors import GlpathError
from glpath.film.batches import BLOCK, blocks
from glpath.film.film import Film
from glpath.system.time_limit import seconds_left

#: Maximum number of attempts for a chunk.
ATTEMPTS = 3
# A chunk that takes longer than this multiple of the usual time is a straggler.
_LATE = 2.0
# Maximum size of a chunk, as a fraction of the remaining path sets per worker.
_SHARE = 0.5
# Maximum time of a chunk, as a fraction of the time left. A worker first renders the chunk before it, so a larger
# fraction ends after the limit.
_TIME_SHARE = 0.25

Range = tuple[int, int]


class ChunksFailedError(GlpathError):
    """Error for path sets that no worker could render; `film` holds all others."""

    def __init__(self, message: str, remedy: str, film: Film) -> None:
        super().__init__(message, remedy)
        self.film = film


@dataclass(eq=False)
class Chunk:
    """Range of path sets that is handed out together.

    path_sets : (start, stop), half-open
    attempts  : number of failed attempts
    copies    : number of workers that have the chunk now
    since     : `time.monotonic()` of the last handing out
    """

    path_sets: Range
    attempts: int = 0
    copies: int = 0
    since: float = 0.0

    @property
    def count(self) -> int:
        """Number of path sets."""
        return self.path_sets[1] - self.path_sets[0]


@dataclass
class Chunks:
    """Path sets of a job that are not yet handed out, chunks that are handed out, and failed chunks.

    missing : ranges of path sets to render, in order
    seconds : minimum time of a chunk, which is raised if merging cannot keep up with many workers
    cut_at  : function that returns True if a chunk must end at this number of path sets of the job, because a stop
              rule checks the film there
    held    : number of finished path sets at the start, which count for `cut_at`
    first   : size of chunks until the time of a path set is known
    """

    missing: Iterable[Range]
    seconds: float
    cut_at: Callable[[int], bool] = lambda count: False
    held: int = 0
    first: int = BLOCK
    out: list[Chunk] = field(default_factory=list)
    failed: list[Chunk] = field(default_factory=list)
    _left: deque[Range] = field(default_factory=deque)
    _again: deque[Chunk] = field(default_factory=deque)
    _suspects: deque[Chunk] = field(default_factory=deque)
    _seconds_each: list[float] = field(default_factory=list)
    _costs: list[float] = field(default_factory=list)
    _took: list[float] = field(default_factory=list)
    _handed: int = 0

    def __post_init__(self) -> None:
        self._left.extend((start, stop) for start, stop in self.missing if start < stop)
        self._handed = self.held

    @property
    def left(self) -> int:
        """Number of path sets that were never handed out."""
        return sum(stop - start for start, stop in self._left)

    def next(self, workers: int) -> Chunk | None:
        """Return the next chunk to hand out; None if there is none."""
        if self._again:
            chunk = self._again.popleft()
        elif self._left:
            chunk = Chunk(self._cut(self._size(workers)))
        elif self._suspects and not self.out:
            chunk = self._suspects.popleft()
        else:
            return None
        chunk.copies += 1
        chunk.since = time.monotonic()
        self.out.append(chunk)
        return chunk

    def take_cost(self, seconds: float) -> None:
        """Record the seconds that merging one film took in the process that collects all films."""
        self._costs = [*self._costs[-15:], seconds]

    def _size(self, workers: int) -> int:
        if not self._seconds_each:
            return self.first
        # Chunks are longer with more workers, so that merging takes at most half of this process's time.
        cost = statistics.median(self._costs) if self._costs else 0.0
        target = min(max(self.seconds, 2.0 * workers * cost), _TIME_SHARE * seconds_left())
        fitting = target / max(statistics.median(self._seconds_each), 1e-9)
        fair = self.left * _SHARE / max(workers, 1)
        size = int(max(1.0, min(fitting, fair, 1e9)))
        # Use whole blocks if possible, because each block is a batch of the film to transfer.
        return size // BLOCK * BLOCK if size >= BLOCK else 1 << (size.bit_length() - 1)

    def _cut(self, size: int) -> Range:
        start, stop = self._left.popleft()
        # End the chunk at the end of a block, or within the present block if that is farther than the size.
        whole = (start + size) // BLOCK * BLOCK
        end = min(stop, whole if whole > start else start + size)
        for _, upto in blocks(start, end):
            if self.cut_at(self._handed + upto - start):
                end = upto
                break
        if end < stop:
            self._left.appendleft((end, stop))
        self._handed += end - start
        return start, end

    def done(self, chunk: Chunk, seconds: float) -> bool:
        """Record a finished copy of a chunk and its time. Returns True if no other copy finished before."""
        if chunk not in self.out:
            return False
        self.out.remove(chunk)
        self._seconds_each = [*self._seconds_each[-15:], seconds / chunk.count]
        self._took = [*self._took[-15:], time.monotonic() - chunk.since]
        return True

    def fail(self, chunk: Chunk) -> None:
        """Record that a copy of a chunk failed or was lost with its worker."""
        chunk.copies -= 1
        if chunk not in self.out or chunk.copies > 0:
            return
        self.out.remove(chunk)
        chunk.attempts += 1
        if chunk.attempts >= ATTEMPTS:
            self.failed.append(chunk)
        else:
            (self._suspects if chunk.attempts == ATTEMPTS - 1 else self._again).append(chunk)

    def straggler(self) -> Chunk | None:
        """Return a late chunk to hand out again if nothing else is left; None if there is none."""
        if self._left or self._again or self._suspects or not self.out or not self._took:
            return None
        late = _LATE * max(statistics.median(self._took), 1.0)
        alone = [c for c in self.out if c.copies == 1 and time.monotonic() - c.since > late]
        if not alone:
            return None
        chunk = min(alone, key=lambda c: c.since)
        chunk.copies += 1
        return chunk

    @property
    def over(self) -> bool:
        """True if nothing is left to hand out and no worker has a chunk."""
        return not (self.out or self._left or self._again or self._suspects)
