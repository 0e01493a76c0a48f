"""Whose turn it is: a lock for what one thread at a time may use, given in the order of asking.

Python's own locks are not given in order: a thread that releases one and asks again at once, as a render does
between its steps, has it again before another wakes up.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable


class _Waiting:
    """A thread that asked and sleeps at its gate until it is its turn, or until it is refused."""

    def __init__(self, thread: int) -> None:
        self.thread = thread
        self.refused = False
        self.gate = threading.Lock()
        self.gate.acquire()


class Turns:
    """A reentrant lock. Its holder may `keep` it; others are refused then, as it may never come back.

    thread : identifier of the holder, None while it is free
    """

    def __init__(self, refusal: Callable[[int], Exception]) -> None:
        """refusal : the error for a request while the thread of that identifier keeps it"""
        self.thread: int | None = None
        self._refusal = refusal
        self._entered = 0
        self._kept = False
        self._waiting: deque[_Waiting] = deque()
        # Held for a few lines of Python at a time. C code takes and releases it, which no signal can come between.
        self._changing = threading.Lock()

    @property
    def mine(self) -> bool:
        """This thread has it."""
        return self.thread == threading.get_ident()

    @property
    def kept(self) -> bool:
        """Its thread keeps it beyond what it entered."""
        return self._kept

    @property
    def depth(self) -> int:
        """How often this thread entered and did not yet exit."""
        return self._entered if self.mine else 0

    def enter(self) -> None:
        """Wait for it, or enter once more. Raises the refusal."""
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
            # Ctrl-C while it waited; or just after it was its turn, which then is the next one's.
            with self._changing:
                if me in self._waiting:
                    self._waiting.remove(me)
                elif self.thread == me.thread:
                    self._pass_on()
            raise

    @property
    def last(self) -> bool:
        """What is left is one entry: `exit` will pass it on."""
        return self._entered == 1 and not self._kept

    def exit(self) -> None:
        """Leave what was entered last, and with the first of all pass it on."""
        with self._changing:
            self._entered -= 1
            if not self._entered and not self._kept:
                self._pass_on()

    def keep(self) -> None:
        """This thread, which has it, keeps it until `drop`; all who wait are refused."""
        with self._changing:
            self._kept = True
            for one in self._waiting:
                one.refused = True
                one.gate.release()
            self._waiting.clear()

    def drop(self) -> None:
        """No longer keep it; others have it once all that was entered is left."""
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
