"""Ping-pong: a pass reads one of two objects and writes the other, then they are swapped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
P = TypeVar("P")


class PingPong(Generic[T]):
    """Two objects of the same type, one to read and one to write, until `swap`."""

    def __init__(self, read: T, write: T) -> None:
        self._both = (read, write)
        self._turn = 0

    @property
    def read(self) -> T:
        return self._both[self._turn]

    @property
    def write(self) -> T:
        return self._both[1 - self._turn]

    def swap(self) -> None:
        """Swap both objects: the one that was written is read from now on."""
        self._turn = 1 - self._turn

    def each(self, make: Callable[[T, T], P]) -> InTurn[P]:
        """Return a pair of objects for both states, each made by `make(read, write)`."""
        first, second = self._both if self._turn == 0 else self._both[::-1]
        made = make(first, second), make(second, first)
        return InTurn(self, made if self._turn == 0 else made[::-1])


class InTurn(Generic[P]):
    """Pair of objects, selected by the current state of a PingPong."""

    def __init__(self, pair: PingPong[T], made: tuple[P, P]) -> None:
        self._pair, self._made = pair, made

    @property
    def now(self) -> P:
        return self._made[self._pair._turn]
