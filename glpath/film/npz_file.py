"""Films as .npz files, which hold all sums exactly, so that a film can be merged and resumed.

Files may be damaged or hostile, so the consistency of their arrays is checked.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.film.batches import BATCHES, BLOCK, counts_of, disjoint
from glpath.film.cryptomatte import ShapeCounts
from glpath.film.metadata import FilmMetadata, metadata_of
from glpath.system.files import whole_file
from glpath.system.npz import check_unfolded, open_npz

#: Format number of the file; other formats are rejected. A film without a number has format 1.
FORMAT = 1
# Largest sum of radiance accepted from a file; the square of this sum is still finite.
_LARGEST_SUM = 1e150


class FilmParts(NamedTuple):
    """Fields of a film, in the order of `glpath.film.sums.FilmSums`."""

    radiance_sums: NDArray[np.float64]
    batch_counts: NDArray[np.int64]
    ranges: tuple[tuple[int, int], ...]
    metadata: FilmMetadata
    aov_sums: dict[str, NDArray[np.float64]]
    shape_counts: ShapeCounts | None

    @classmethod
    def empty(cls, metadata: FilmMetadata) -> FilmParts:
        """Return a film without path sets, for the metadata's window."""
        _, _, width, height = metadata.window
        sums = np.zeros((BATCHES, height, width, 3))
        aovs = {name: np.zeros((height, width, n)) for name, n in metadata.aov_sums.items()}
        shapes = ShapeCounts.empty((height, width)) if metadata.counts_shapes else None
        return cls(sums, np.zeros(BATCHES, np.int64), (), metadata, aovs, shapes)


def used_sums(radiance_sums: NDArray[np.float64], batch_counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the sums of the batches that have path sets. If all have, they are not copied: they may take 2 GB."""
    used = batch_counts > 0
    return radiance_sums if used.all() else radiance_sums[used]


def write_parts(path: Path, film: FilmParts) -> None:
    """Write a film to a file, which appears whole or not at all. Raises ImageError if writing fails."""
    with whole_file(path) as temporary, temporary.open("wb") as file:
        arrays: dict[str, Any] = {
            "radiance_sums": used_sums(film.radiance_sums, film.batch_counts),
            "batch_counts": film.batch_counts,
            "ranges": np.array(film.ranges, np.int64).reshape(-1, 2),
            "block": np.int64(BLOCK),
            "film_format": np.int64(FORMAT),
            "metadata": np.array(json.dumps(asdict(film.metadata))),
            **{_aov_key(name): sums for name, sums in film.aov_sums.items()},
        }
        if film.shape_counts is not None:
            arrays |= {"shape_keys": film.shape_counts.keys, "shape_counts": film.shape_counts.counts}
        np.savez(file, **arrays)


def read_parts(path: str | Path) -> FilmParts:
    """Read a film. Raises ImageError if the file cannot be read, or if its arrays contradict each other."""
    with open_npz(path, "a film", "A film is what -o NAME.npz writes.") as stored:
        found = int(stored.read("film_format", "iu", ())) if "film_format" in stored else 1
        if found != FORMAT:
            raise ImageError(
                f"{path}: is a film of format {found}; this version of glpath reads format {FORMAT}.",
                "Read it with the glpath that wrote it, or render it anew.",
            )
        metadata = metadata_of(stored.read_object("metadata", only_finite=True))
        counts = stored.read("batch_counts", "iu", (None,))
        block = int(stored.read("block", "iu", ()))
        if (len(counts), block) != (BATCHES, BLOCK):
            raise ValueError(
                f"its batches are {len(counts)} of blocks of {block} path sets, this version of glpath has "
                f"{BATCHES} of {BLOCK}"
            )
        ranges = stored.read("ranges", "iu", (None, 2)).astype(np.int64)
        if not disjoint(ranges) or not np.array_equal(counts_of(ranges), counts):
            raise ValueError("its ranges of path sets overlap, or are not what its batches count")
        used = counts > 0
        # Batches without path sets are not stored, but have zeros in memory.
        width, height = metadata.window[2:]
        numbers = 3 * BATCHES + sum(metadata.aov_sums.values())
        check_unfolded(8 * width * height * numbers, os.path.getsize(path))
        film = FilmParts.empty(metadata)
        sums = stored.read("radiance_sums", "f", (int(used.sum()), *film.radiance_sums.shape[1:]))
        if not (np.abs(sums) <= _LARGEST_SUM).all():
            raise ValueError(f"it holds sums that are NaN or infinite, or beyond {_LARGEST_SUM:g}")
        for name, n in metadata.aov_sums.items():
            film.aov_sums[name][:] = stored.read(_aov_key(name), "f", (*sums.shape[1:3], n))
        shapes = film.shape_counts
        if shapes is not None:
            keys = stored.read("shape_keys", "iu", (None,)).astype(np.int64)
            hits = stored.read("shape_counts", "iu", (len(keys),)).astype(np.int64)
            shapes = ShapeCounts(shapes.size, keys, hits)
            shapes.check(len(metadata.shape_names), int(counts.sum()))
        if not all(np.isfinite(aov).all() for aov in film.aov_sums.values()):
            raise ValueError("it holds sums of AOVs that are NaN or infinite")
        dropped = film.aov_sums.get("dropped", np.zeros(0))
        if np.any(dropped < 0) or np.any(dropped > counts.sum()):
            raise ValueError("its counts of dropped samples are not those of its path sets")
        film.radiance_sums[used] = sums
        film.batch_counts[:] = counts
    return film._replace(ranges=tuple((int(start), int(stop)) for start, stop in ranges), shape_counts=shapes)


def _aov_key(name: str) -> str:
    return f"{name}_sums"
