"""Films of ranges of path sets, rendered anywhere, added up to one: each path set once.

    film = merge_shards([Path("a.npz"), Path("b.npz")])

Sums are exact, so they may come in any order. All of them together are bit-identical to one uninterrupted render
where they come from one kind of device. A file that is named twice, and a copy of one, count once; so a job that
was run twice by mistake does no harm.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.film.metadata import differences


def merge_shards(paths: Iterable[Path]) -> tuple[Film, list[Path]]:
    """The film of all, and the files that counted once with another.

    Holds two films at a time, however many there are. Raises UsageError, which names the files, for shards of
    another render, with all that differs, and for shards that share path sets; ImageError for a file that is no
    film.
    """
    merged: Film | None = None
    seen: dict[tuple[object, ...], Path] = {}
    ranges: dict[Path, tuple[tuple[int, int], ...]] = {}
    repeated: list[Path] = []
    real: set[str] = set()
    for path in paths:
        if os.path.realpath(path) in real:
            repeated.append(path)
            continue
        real.add(os.path.realpath(path))
        film = Film.load(path)
        if merged is not None and (found := differences(merged.metadata, film.metadata)):
            first = next(iter(ranges))
            words = "; ".join(f"{what} is {theirs}, in {first} {ours}" for what, ours, theirs in found)
            raise UsageError(f"{path}: of another render than {first}: {words}.", "Merge shards of one render.")
        content = (film.ranges, hashlib.sha256(np.ascontiguousarray(film.radiance_sums).data).digest())
        if content in seen:
            repeated.append(path)
            continue
        for other, held in ranges.items():
            if shared := _shared(held, film.ranges):
                raise UsageError(
                    f"{path}: holds path sets {shared[0]} to {shared[1] - 1}, and {other} does, too.",
                    "Leave one of the two out; a path set counts once.",
                )
        seen[content] = path
        ranges[path] = film.ranges
        if merged is None:
            merged = film
        else:
            merged.include(film)
    if merged is None:
        raise UsageError("merge: no film is named.", "Name the files of those that are to be added up.")
    return merged, repeated


def _shared(ours: tuple[tuple[int, int], ...], theirs: tuple[tuple[int, int], ...]) -> tuple[int, int] | None:
    """The first path sets that both have."""
    for a, b in ours:
        for c, d in theirs:
            if max(a, c) < min(b, d):
                return max(a, c), min(b, d)
    return None
