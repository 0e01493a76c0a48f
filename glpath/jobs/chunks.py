"""Which path sets to hand out next, and how many at once: for workers whose speed nobody knows beforehand.

Plain numbers, no processes. A chunk is a range of path sets inside a job; films of chunks add up to the job's, bit
for bit, however they were cut.

Chunks are as long as `seconds` of a worker's time, by what the ones before took; near the end they shrink, so that
workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987). A chunk that failed is handed out
again, until it has been tried `ATTEMPTS` times; then it is set aside, and the others continue. The last time it is
alone, after all others: chunks on the same worker as one that ends it are not to blame. What is still out when
nothing is left to hand out may be given a second time (`straggler`): the first result counts.
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

#: How often a chunk is tried before it is set aside.
ATTEMPTS = 3
# A chunk that is out for so many times the usual is a straggler.
_LATE = 2.0
# Of what is left, a chunk has at most this share for each worker.
_SHARE = 0.5

Range = tuple[int, int]


class ChunksFailedError(GlpathError):
    """Some path sets could not be rendered by any worker. `film` holds all others."""

    def __init__(self, message: str, remedy: str, film: Film) -> None:
        super().__init__(message, remedy)
        self.film = film


@dataclass(eq=False)
class Chunk:
    """Path sets that are handed out together.

    path_sets : (start, stop), half-open
    attempts  : how often it was handed out because the time before had failed
    copies    : that are out now
    since     : `time.monotonic()` when it was handed out last
    """

    path_sets: Range
    attempts: int = 0
    copies: int = 0
    since: float = 0.0

    @property
    def count(self) -> int:
        """How many path sets."""
        return self.path_sets[1] - self.path_sets[0]


@dataclass
class Chunks:
    """What of a job is still to be handed out, is out, and has failed.

    missing : ranges of path sets to render, in order
    seconds : that a chunk should take, or more, where merging would be late with so many workers
    cut_at  : whether a chunk has to end at this path set count, counted from the beginning of the job: where a stop
              rule looks at the film
    held    : path sets that there are already, which count for `cut_at`
    """

    missing: Iterable[Range]
    seconds: float
    cut_at: Callable[[int], bool] = lambda count: False
    held: int = 0
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
        """Path sets that were never handed out."""
        return sum(stop - start for start, stop in self._left)

    def next(self, workers: int) -> Chunk | None:
        """The next one to hand out; None where there is none."""
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
        """What it cost the one process that all films come to, to have one of them merged."""
        self._costs = [*self._costs[-15:], seconds]

    def _size(self, workers: int) -> int:
        if not self._seconds_each:
            return BLOCK
        # The more workers, the longer chunks: merging shall take half of its time at most.
        cost = statistics.median(self._costs) if self._costs else 0.0
        fitting = max(self.seconds, 2.0 * workers * cost) / max(statistics.median(self._seconds_each), 1e-9)
        fair = self.left * _SHARE / max(workers, 1)
        size = int(max(1.0, min(fitting, fair, 1e9)))
        # Whole blocks where they fit, as each is a batch of the film, which has to travel.
        return size // BLOCK * BLOCK if size >= BLOCK else 1 << (size.bit_length() - 1)

    def _cut(self, size: int) -> Range:
        start, stop = self._left.popleft()
        # To the end of a block: of this one, for less than one.
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
        """A copy of it is there, and took its worker so long; whether it is the first."""
        if chunk not in self.out:
            return False
        self.out.remove(chunk)
        self._seconds_each = [*self._seconds_each[-15:], seconds / chunk.count]
        self._took = [*self._took[-15:], time.monotonic() - chunk.since]
        return True

    def fail(self, chunk: Chunk) -> None:
        """A copy of it has failed, or was lost with its worker."""
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
        """One to hand out a second time, as it is late and nothing else is left; None where there is none."""
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
        """Whether nothing is to be handed out, and nothing is out."""
        return not (self.out or self._left or self._again or self._suspects)
