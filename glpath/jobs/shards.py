"""Merging of shards: films of ranges of path sets become one film, with each path set once.

    film = merge_shards([Path("a.npz"), Path("b.npz")])

Sums are exact, so the order is free. The merged film is bit-identical to one uninterrupted render if all devices
are of one kind. A file that is named twice, and a copy of a file, count once. So a job that was run twice by
mistake does no harm.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from glpath.errors import UsageError, argument
from glpath.film.aovs import DENOISER_AOVS, guides_denoiser
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata, differences

#: Reason why a film cannot be denoised, printed after its name.
WITHOUT_GUIDES = f"has no AOVs {' and '.join(DENOISER_AOVS)}, by which pictures are denoised"
# Metadata that differ between shards with and without the AOVs for a denoiser. The setting interleave is one of
# them, because a path-buffer is interleaved for the denoiser.
_OF_GUIDES = {"aovs", "settings.interleave"}


class UnguidedShardError(UsageError):
    """Error for two shards that do not merge because only one of them has the AOVs for a denoiser."""


def merge_shards(paths: Iterable[Path]) -> tuple[Film, list[Path]]:
    """Return the merged film, and the files that were ignored because they repeat another file.

    Memory holds two films at a time. Raises UsageError with the names of the files for shards of another render,
    with all differences, and for shards that share path sets. Raises ImageError for a file that is not a film.
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
            raise _another_render({first: merged.metadata, path: film.metadata}, found)
        batches = (film.radiance_sums[batch] for batch in np.flatnonzero(film.batch_counts))
        content = (film.ranges, *(hashlib.sha256(sums.data).digest() for sums in batches))
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


def _another_render(metadata: Mapping[Path, FilmMetadata], found: Sequence[tuple[str, str, str]]) -> UsageError:
    """Return the error for two films that do not merge.

    If only one of them lacks a denoiser's AOVs, name that film.

    metadata : metadata of both films, by file
    found    : `differences` of the two metadata
    """
    first, path = metadata
    words = "; ".join(f"{what} is {theirs}, in {first} {ours}" for what, ours, theirs in found)
    message = f"{path}: of another render than {first}: {words}."
    lacking = [file for file, each in metadata.items() if not guides_denoiser(each.aovs)]
    if len(lacking) == 1 and {what for what, _, _ in found} <= _OF_GUIDES:
        return UnguidedShardError(
            f"{message} {lacking[0]} {WITHOUT_GUIDES}.",
            f"Render every shard with {argument('aovs', DENOISER_AOVS)}.",
        )
    same_aovs = "" if metadata[first].aovs == metadata[path].aovs else ", all with the same AOVs"
    return UsageError(message, f"Merge shards of one render{same_aovs}.")


def _shared(ours: tuple[tuple[int, int], ...], theirs: tuple[tuple[int, int], ...]) -> tuple[int, int] | None:
    """Return the first range of path sets that both films contain, or None."""
    for a, b in ours:
        for c, d in theirs:
            if max(a, c) < min(b, d):
                return max(a, c), min(b, d)
    return None
