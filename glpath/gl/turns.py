"""Fair lock for a resource that one thread uses at a time, granted in the order of requests.

Python's own locks are not granted in order. A thread that releases one and requests it again at once, as a render
does between its steps, gets it again before another wakes up.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable


class _Waiting:
    """Waiting thread, which sleeps at its gate until its turn, or until it is refused."""

    def __init__(self, thread: int) -> None:
        self.thread = thread
        self.refused = False
        self.gate = threading.Lock()
        self.gate.acquire()


class Turns:
    """Reentrant lock. Its holder may `keep` it; other threads are then refused, because it may never be released.

    thread : identifier of the holder, None while it is free
    """

    def __init__(self, refusal: Callable[[int], Exception]) -> None:
        """Create a free lock.

        refusal : function that returns the error for a request while the thread of that identifier keeps the lock
        """
        self.thread: int | None = None
        self._refusal = refusal
        self._entered = 0
        self._kept = False
        self._waiting: deque[_Waiting] = deque()
        # Held for a few lines of Python at a time. C code acquires and releases it, so no signal can come between.
        self._changing = threading.Lock()

    @property
    def mine(self) -> bool:
        """True if the calling thread has the lock."""
        return self.thread == threading.get_ident()

    @property
    def kept(self) -> bool:
        """True if a thread keeps the lock even after its last exit, see `keep`."""
        return self._kept

    @property
    def depth(self) -> int:
        """Number of the calling thread's entries that have no exit yet."""
        return self._entered if self.mine else 0

    def enter(self) -> None:
        """Wait for the lock, or enter once more. Raises the refusal if another thread keeps the lock."""
        if self.mine:
            self._entered += 1
            return
        me = _Waiting(threading.get_ident())
        try:
            with self._changing:
                if self._kept and self.thread is not None:
                    raise self._refusal(self.thread)
                if self.thread is None:
                    self.thread, self._entered = me.thread, 1
                    return
                self._waiting.append(me)
            me.gate.acquire()
            if me.refused:
                raise self._refusal(self.thread or 0)
        except BaseException:
            # Ctrl-C during the wait, or just after the lock was granted; then the next thread gets it.
            with self._changing:
                if me in self._waiting:
                    self._waiting.remove(me)
                elif self.thread == me.thread:
                    self._pass_on()
            raise

    @property
    def last(self) -> bool:
        """True if one entry is left, so that `exit` will pass the lock on."""
        return self._entered == 1 and not self._kept

    def exit(self) -> None:
        """Undo the last entry, and pass the lock on if no entry is left."""
        with self._changing:
            self._entered -= 1
            if not self._entered and not self._kept:
                self._pass_on()

    def keep(self) -> None:
        """Keep the lock in this thread, which must have it, until `drop`; all waiting threads are refused."""
        with self._changing:
            self._kept = True
            for one in self._waiting:
                one.refused = True
                one.gate.release()
            self._waiting.clear()

    def drop(self) -> None:
        """Stop keeping the lock; others get it once all entries have ended."""
        with self._changing:
            self._kept = False
            if not self._entered:
                self._pass_on()

    def _pass_on(self) -> None:
        self.thread, self._entered = None, 0
        if self._waiting:
            following = self._waiting.popleft()
            self.thread, self._entered = following.thread, 1
            following.gate.release()
