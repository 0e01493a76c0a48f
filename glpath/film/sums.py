"""Sums of radiance and of AOVs over path sets, and the number of path sets in each sum.

A film has sums, not means, so that resuming a render and merging renders are additions. Sums of a path tracer are
multiples of one power of two, and small enough that float64 adds them without rounding. So path sets 0..64 equal
0..32 merged with 32..64, bit for bit, in any order.

Radiance is summed in separate batches (`glpath.film.batches`), because the error of an image is estimated from
differences between batches.

Cost:     24 bytes per pixel and batch: 50 MB for 512 x 512.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError, argument
from glpath.film.aovs import AOV_KINDS, AOVS, DENOISER_AOVS, FAR, ID_AOVS, SHAPES, add_aov, min_depths
from glpath.film.batches import BATCHES, BLOCK, batch_of, united
from glpath.film.cryptomatte import RANKS, Cryptomatte, Kind, ShapeCounts, cryptomatte
from glpath.film.metadata import FilmMetadata, differences, joined, merged_values
from glpath.film.npz_file import FilmParts, used_sums
from glpath.system.arguments import checked, short_repr

Float64 = NDArray[np.float64]


@checked
@dataclass(eq=False, repr=False)
class FilmSums:
    """Sums of radiance over path sets, in batches; `Film` documents the fields."""

    radiance_sums: Float64  # (BATCHES, H, W, 3)
    batch_counts: NDArray[np.int64]  # (BATCHES,)
    ranges: tuple[tuple[int, int], ...]
    metadata: FilmMetadata
    aov_sums: dict[str, Float64] = field(default_factory=dict)  # (H, W, n) each
    shape_counts: ShapeCounts | None = None

    @classmethod
    def empty(cls, metadata: FilmMetadata) -> Self:
        """Return a film for the metadata's window, without path sets."""
        return cls(*FilmParts.empty(metadata))

    def add(
        self,
        start: int,
        stop: int,
        radiance_sum: NDArray[np.floating[Any]],
        aov_sums: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    ) -> None:
        """Add the sum of radiance (H, W, 3) over path sets start..stop (half-open).

        The path sets must lie in one block, see `glpath.film.batches.blocks`.

        aov_sums : sums over the same path sets, for each name in the film's `aov_sums`. A film that counts shapes
                   also needs "shapes" (H, W, stop - start): index + 1 of the shape that a sample hits, 0 for none

        Raises UsageError if the film already has one of the path sets, and for sums that do not fit the film.
        """
        if not 0 <= start < stop:
            raise UsageError(f"film: path sets {start}..{stop} where a start from 0 and a later stop are needed.")
        if start // BLOCK != (stop - 1) // BLOCK:
            raise UsageError(
                f"film: path sets {start}..{stop} are not of one block of {BLOCK}.",
                "Add the path sets of each block by a call of their own.",
            )
        shapes = {name: sums.shape for name, sums in self.aov_sums.items()}
        if self.shape_counts is not None:
            shapes[SHAPES] = (*self.radiance_sums.shape[1:3], stop - start)
        if aov_sums.keys() != shapes.keys():
            raise UsageError(
                f"film: aov_sums has {[*aov_sums]} where {[*shapes]} are needed, the sums of the film."
            )
        shapes["radiance_sum"] = self.radiance_sums.shape[1:]
        for name, sums in {**aov_sums, "radiance_sum": radiance_sum}.items():
            if np.shape(sums) != shapes[name]:
                raise UsageError(f"film: {name} of shape {np.shape(sums)} where {shapes[name]} is needed.")
        if not np.isfinite(radiance_sum).all():
            raise UsageError(f"film: radiance_sum of path sets {start}..{stop} has a NaN or an infinity.")
        # Memory is allocated first, and the numbers of the path sets change last, so that the film stays readable
        # if memory runs out.
        ranges = united(self.ranges, ((start, stop),))
        shape_counts = self.shape_counts
        if shape_counts is not None:
            shape_counts = shape_counts + ShapeCounts.of(aov_sums[SHAPES])
        for name in self.aov_sums:
            add_aov(name, self.aov_sums[name], aov_sums[name])
        batch = batch_of(start)
        self.radiance_sums[batch] += radiance_sum
        self.batch_counts[batch] += stop - start
        self.ranges, self.shape_counts = ranges, shape_counts

    @property
    def path_sets(self) -> int:
        """Number of path sets in the film, which is the number of samples per pixel."""
        return int(self.batch_counts.sum())

    @property
    def nbytes(self) -> int:
        """Size of the sums in memory, in bytes."""
        shapes = 0 if self.shape_counts is None else self.shape_counts.nbytes
        return self.radiance_sums.nbytes + sum(sums.nbytes for sums in self.aov_sums.values()) + shapes

    @property
    def mean(self) -> Float64:
        """Mean radiance (H, W, 3) float64, W sr^-1 m^-2 or cd m^-2, linear Rec. 709, row 0 at the top.

        Raises UsageError if the film has no path sets.
        """
        if not self.path_sets:
            raise UsageError("film: holds no path set, so there is no image.", "Render at least one.")
        return mean_of(self.radiance_sums, self.batch_counts)

    @property
    def alpha(self) -> Float64 | None:
        """Fraction (H, W) float64 of a pixel's samples that hit a surface.

        None if the film is not transparent, or has no path sets. `mean` is premultiplied by this fraction, because
        samples that hit no surface have no light.
        """
        if not self.metadata.transparent or not self.path_sets:
            return None
        return np.asarray(self.aov_sums["depth"][..., 1] / self.path_sets)

    def aov(self, name: str) -> NDArray[Any]:
        """Return an AOV of the film, row 0 at the top, from the same samples as `mean`.

        `glpath.film.aovs` describes each AOV. Raises UsageError if the film lacks the AOV, or has no path sets.
        """
        if name not in self.metadata.aovs:
            held = ", ".join(self.metadata.aovs) or "none"
            raise UsageError(
                f"film: holds no AOV {name!r}; those that it holds: {held}.",
                f"Render with {argument('aovs', DENOISER_AOVS if name in DENOISER_AOVS else (name,))}."
                if name in AOVS
                else f"There are {', '.join(AOVS)}.",
            )
        if not self.path_sets:
            raise UsageError("film: holds no path set, so there is no image.", "Render at least one.")
        if name in ID_AOVS:
            return self._ids(name)
        if name == "samples":
            return self.path_sets - self.aov_sums["dropped"][..., 0].astype(np.int64)
        if name == "indirect":
            # The difference is exact before the division, because both are multiples of one power of two.
            light = np.add.reduce(self.radiance_sums, axis=0) - self.aov_sums["direct"]
            return np.asarray(light / self.path_sets)
        sums = self.aov_sums[name]
        if name == "depth_min":
            return np.minimum(min_depths(sums[..., 0]), FAR)
        kind = AOV_KINDS[name]
        if kind.over == "samples":
            return np.asarray(sums / self.path_sets)
        value, hits = sums[..., :-1], sums[..., -1:]
        origin = self.metadata.position_origin if name == "position" else None
        mean = np.where(hits > 0, value / np.maximum(hits, 1) + (0.0 if origin is None else origin), kind.empty)
        return np.asarray(mean[..., 0] if mean.shape[2] == 1 else mean)

    def _ids(self, name: str) -> NDArray[np.int64]:
        assert self.shape_counts is not None, "the metadata name an AOV that the film has not"
        of = self.metadata.shape_materials
        group = np.array(of if name == "material_id" else range(len(of)), np.int64)
        return np.asarray(self.shape_counts.ranked(group, 1)[0][..., 0] + 1)

    def cryptomatte(self, kind: Kind, ranks: int = RANKS) -> Cryptomatte:
        """Return the objects or materials that cover each pixel, and their coverage, for mattes in compositors.

        kind  : "object" (shapes of the same name are combined) or "material"; the film needs the AOV "object_id" or
                "material_id"
        ranks : maximum number of names per pixel; names with less coverage are left out. The film itself counts all
                shapes

        Raises UsageError for another kind, for fewer ranks than one, and if the film lacks the AOV or has no path
        sets.

        `film.cryptomatte("object").matte("floor")` is the fraction (H, W) of each pixel that "floor" covers.
        """
        if kind not in ("object", "material"):
            raise UsageError(f"cryptomatte: {short_repr(kind)}; allowed are object, material")
        if ranks < 1:
            raise UsageError(f"cryptomatte: {ranks} ranks where one is needed at least")
        if self.shape_counts is None or not self.path_sets:
            self.aov(f"{kind}_id")  # raises an error with the reason
        assert self.shape_counts is not None, "refused just now"
        names = list(self.metadata.shape_names)
        if kind == "material":
            names = [self.metadata.material_names[i] for i in self.metadata.shape_materials]
        return cryptomatte(kind, self.shape_counts, names, self.path_sets, ranks)

    def merge(self, other: FilmSums) -> Self:
        """Return a film with the path sets of both films, which must be different path sets of the same render.

        Devices may differ. The metadata then names both, and the sum is not bit-identical to that of one device.
        Raises UsageError if the renders differ, with the differences, or if both films have the same path set.
        """
        merged = replace(
            self,
            radiance_sums=self.radiance_sums.copy(),
            batch_counts=self.batch_counts.copy(),
            aov_sums={name: sums.copy() for name, sums in self.aov_sums.items()},
        )
        merged.include(other)
        return merged

    def include(self, other: FilmSums) -> None:
        """Add the path sets of another film to this film. Raises UsageError as `merge`, and then adds nothing."""
        if found := differences(self.metadata, other.metadata):
            words = "; ".join(
                f"{what} is {theirs} in one film and {ours} in the other" for what, ours, theirs in found
            )
            raise UsageError(f"film: cannot merge: {words}.", "Only path sets of the same render can be added up.")
        # The order is that of `add`.
        ranges = united(self.ranges, other.ranges)
        shape_counts = self.shape_counts
        if shape_counts is not None and other.shape_counts is not None:
            shape_counts = shape_counts + other.shape_counts
        for name, sums in self.aov_sums.items():
            add_aov(name, sums, other.aov_sums[name])
        for batch in np.flatnonzero(other.batch_counts):
            self.radiance_sums[batch] += other.radiance_sums[batch]
        self.batch_counts += other.batch_counts
        self.ranges, self.shape_counts = ranges, shape_counts
        self.metadata = replace(
            self.metadata,
            device=joined(self.metadata.device, other.metadata.device),
            versions=merged_values(self.metadata.versions, other.metadata.versions),
            unit=self.metadata.unit or other.metadata.unit,
            elapsed_s=self.metadata.elapsed_s + other.metadata.elapsed_s,
            statistics=merged_values(self.metadata.statistics, other.metadata.statistics),
            stop_rule="",
            error_bound=None,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickle without empty batches. A worker's film of few path sets fills one batch."""
        # Fields that are derived from others, or belong to this process, are not pickled.
        derived = {each.name: None for each in fields(self) if not each.init}
        return {**vars(self), "radiance_sums": used_sums(self.radiance_sums, self.batch_counts), **derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        sums, used = state["radiance_sums"], self.batch_counts > 0
        if used.all() and sums.flags.writeable:
            return
        self.radiance_sums = np.zeros((BATCHES, *sums.shape[1:]))
        self.radiance_sums[used] = sums


def mean_of(radiance_sums: Float64, batch_counts: NDArray[np.int64]) -> Float64:
    """Return the mean (H, W, 3) float64 over all path sets, from sums (B, H, W, 3) and counts (B,) of batches."""
    mean: Float64 = np.add.reduce(radiance_sums, axis=0) / batch_counts.sum()
    return mean
