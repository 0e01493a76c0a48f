"""Merging of daylight coefficients: shards of one computation become one file, with each sensor once.

    found = merge_coefficients([Path("a.npz"), Path("b.npz")])

The files may be given in any order. The merged result is bit-identical to one uninterrupted computation if all
devices are of one kind. A file that is given twice, and a copy of a file, count once.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.indirect import Indirect
from glpath.apps.daylight.shard import Shard
from glpath.apps.daylight.texels import Texels
from glpath.errors import UsageError
from glpath.system.npz import open_npz


def merge_coefficients(paths: Iterable[Path]) -> tuple[DaylightCoefficients, list[Path]]:
    """Return the merged coefficients, and the files that were ignored because they repeat another file.

    Adjacent shards that do not cover all sensors give a larger shard. Raises UsageError with the names of the files
    if shards belong to different computations, if they share sensors, or if sensors between them are missing.
    Raises ImageError for a file without daylight coefficients.
    """
    found: dict[Path, DaylightCoefficients] = {}
    repeated: list[Path] = []
    real: set[str] = set()
    for path in paths:
        if os.path.realpath(path) in real:  # not `resolve`, which raises RuntimeError for a link to itself
            repeated.append(path)
            continue
        real.add(os.path.realpath(path))
        loaded = DaylightCoefficients.load(path)
        shard = loaded.shard
        if shard is None:
            raise UsageError(f"{path}: is no shard; it has all of its sensors.", "There is nothing to merge.")
        first, other = next(iter(found.items()), (path, loaded))
        if other.shard is not None and other.shard.work != shard.work:
            raise UsageError(
                f"{path}: is of another computation than {first}: {_difference(loaded, other)}.",
                "Merge shards of one computation.",
            )
        if any(_alike(loaded, each) for each in found.values()):
            repeated.append(path)
            continue
        found[path] = loaded
    if not found:
        raise UsageError("merge: no shard is named.", "Name the files of those that are to be put together.")
    parts = sorted(found, key=lambda path: _range(found[path])[0])
    for before, after in pairwise(parts):
        end, begin = _range(found[before])[1], _range(found[after])[0]
        if begin < end:
            raise UsageError(
                f"{after}: has sensors {begin} to {end - 1}, and {before} has them, too.",
                "Leave one of the two out.",
            )
        if begin > end:
            raise UsageError(
                f"merge: sensors {end} to {begin - 1}, between those of {before} and of {after}, are missing.",
                "Name the shard that has them.",
            )
    return together([found[path] for path in parts]), repeated


def is_coefficients(path: Path) -> bool:
    """Return True if an .npz file holds daylight coefficients, not a film. Raises ImageError for other files."""
    with open_npz(
        path, "film or daylight coefficients", "Name .npz of `glpath render` or `glpath daylight`."
    ) as of:
        return "glpath_daylight" in of


def _range(part: DaylightCoefficients) -> tuple[int, int]:
    assert part.shard is not None, "checked before"
    return part.shard.first, part.shard.first + len(part)


def _alike(one: DaylightCoefficients, other: DaylightCoefficients) -> bool:
    return _range(one) == _range(other) and np.array_equal(one.words, other.words)


def _difference(one: DaylightCoefficients, other: DaylightCoefficients) -> str:
    """Return a text with the options that differ between shards of two computations."""
    names = ("receiver", "subdivision", "samples", "latitude")
    seen = [
        f"{name} is {getattr(one, name)}, not {getattr(other, name)}"
        for name in names
        if str(getattr(one, name)) != str(getattr(other, name))
    ]
    if one.shard is not None and other.shard is not None and one.shard.total != other.shard.total:
        seen.append(f"it has {one.shard.total:,} sensors, not {other.shard.total:,}")
    return "; ".join(seen) or "of another scene, other sensors or settings"


def together(parts: list[DaylightCoefficients]) -> DaylightCoefficients:
    """Merge adjacent shards of one computation, given in the order of their sensors."""
    first = parts[0]
    assert first.shard is not None, "checked before"
    count = sum(map(len, parts))
    shares = [part.shares for part in parts if part.shares is not None]
    texels = [part.texels for part in parts if part.texels is not None]
    return replace(
        first,
        points=np.concatenate([part.points for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        words=np.concatenate([part.words for part in parts], axis=1),
        shares=np.concatenate(shares, axis=1) if shares else None,
        texels=Texels.joined(texels) if len(texels) == len(parts) else None,
        indirect=_reflected([part.indirect for part in parts if part.indirect is not None]),
        shard=None if count == first.shard.total else Shard(first.shard.first, first.shard.total, first.shard.work),
    )


def _reflected(parts: list[Indirect]) -> Indirect | None:
    from scipy import sparse

    if not parts:
        return None
    errors = np.concatenate([part.errors for part in parts])
    radiosity = parts[0].radiosity
    if all(np.array_equal(part.radiosity, radiosity) for part in parts[1:]):
        weights = sparse.vstack([part.weights for part in parts], format="csr")
        return Indirect(weights, radiosity, errors, parts[0].bias)
    # The parts have different radiosity matrices, so they have no common factors, and the product is stored. They
    # differ if a part stores the product already, or if machines round differently.
    rows: Any = np.concatenate([np.asarray(part.weights @ part.radiosity, np.float32) for part in parts])
    return Indirect(sparse.eye_array(len(rows), dtype=np.float32, format="csr"), rows, errors, parts[0].bias)
