"""The film: sums of radiance and how many path sets are in them.

Sums, never means, so that going on with a render and merging two are additions. What a path tracer hands in are
multiples of one power of two, small enough that float64 adds them without rounding: then path sets 0..64 equal
0..32 merged with 32..64, bit for bit, in whatever order they came.

Sums are kept apart in batches, since the paths of a set share their directions: neighbouring pixels err together,
and the error of an image can only be seen between sets. Which batch a set belongs to follows from its number,
so any ranges merge.

Cost:     24 bytes per pixel and batch: 50 MB for 512 x 512.
Poor at:  the error of a render shorter than two blocks (16 path sets): there is nothing to compare.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glpath import image
from glpath.errors import ImageError, UsageError
from glpath.files import is_stream, whole_file
from glpath.film_metadata import FilmMetadata, joined, merged_values, metadata_of, shown
from glpath.image import UInt8, check_exposure, encode_png, write_exr, write_png
from glpath.image import tonemap as tonemapped
from glpath.npz import open_npz

Float64 = NDArray[np.float64]

# Path set i belongs to batch (i // BLOCK) % BATCHES. A block of 8 keeps neighbouring points of a Sobol sequence
# together, which stratify each other; 8 batches give the standard error to about a quarter.
BLOCK = 8
BATCHES = 8

WRITABLE = (".png", ".exr", ".npz")

# The end of all path sets of a file, far beyond what can be rendered: counts of them do not overflow.
_LAST_PATH_SET = 1 << 48

# Of the longer side of the image that a notebook shows.
_PREVIEW = 1024


def batch_of(path_set: int) -> int:
    """The batch that a path set is summed in."""
    return path_set // BLOCK % BATCHES


def blocks(start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split the path sets start..stop (half-open) where the batch changes: the ranges that `Film.add` takes."""
    while start < stop:
        end = min(stop, (start // BLOCK + 1) * BLOCK)
        yield start, end
        start = end


# What must be equal to merge, in the words of a message.
_DECIDES = {
    "scene_hash": "scene",
    "integrator": "integrator",
    "seed": "seed",
    "max_depth": "max_depth",
    "settings": "settings",
    "full_resolution": "resolution",
    "window": "crop",
}


@dataclass(eq=False, repr=False)
class Film:
    """Sums of radiance over path sets, in batches.

    radiance_sums : (BATCHES, H, W, 3) float64, W sr^-1 m^-2, linear Rec. 709, row 0 at the top
    batch_counts  : (BATCHES,) int64, path sets in each sum; one path set is one path for every pixel
    ranges        : path sets in the sums, as disjoint half-open (start, stop), in order, never touching
    metadata      : what made it
    """

    radiance_sums: Float64
    batch_counts: NDArray[np.int64]
    ranges: tuple[tuple[int, int], ...]
    metadata: FilmMetadata

    @classmethod
    def empty(cls, metadata: FilmMetadata) -> Film:
        """A film of the size of the metadata's window, without any path set."""
        _, _, width, height = metadata.window
        return cls(np.zeros((BATCHES, height, width, 3)), np.zeros(BATCHES, np.int64), (), metadata)

    def add(self, start: int, stop: int, radiance_sum: NDArray[np.floating[Any]]) -> None:
        """Add the sum (H, W, 3) over the path sets start..stop (half-open), which lie in one block (see `blocks`).

        Raises UsageError for path sets that are already in the film.
        """
        assert 0 <= start < stop, f"an empty range of path sets, {start}..{stop}"
        assert start // BLOCK == (stop - 1) // BLOCK, f"path sets {start}..{stop} are not of one block"
        assert radiance_sum.shape == self.radiance_sums.shape[1:], f"a sum of shape {radiance_sum.shape}"
        assert np.isfinite(radiance_sum).all(), f"path sets {start}..{stop} hold a NaN or an infinity"
        self.ranges = _united(self.ranges, ((start, stop),))
        batch = batch_of(start)
        self.radiance_sums[batch] += radiance_sum
        self.batch_counts[batch] += stop - start

    @property
    def path_sets(self) -> int:
        """Path sets in the film: samples per pixel."""
        return int(self.batch_counts.sum())

    @property
    def mean(self) -> Float64:
        """(H, W, 3) float64, the image: W sr^-1 m^-2, linear Rec. 709, row 0 at the top.

        Raises UsageError when there is no path set in it.
        """
        if not self.path_sets:
            raise UsageError("film: holds no path set, so there is no image.", "Render at least one.")
        return _mean(self.radiance_sums, self.batch_counts)

    def merge(self, other: Film) -> Film:
        """A film with the path sets of both, which must be different ones of the same render.

        Devices may differ; the metadata then names both, and the sum is no longer that of one device to the bit.
        Raises UsageError, which names what differs.
        """
        for name, word in _DECIDES.items():
            ours, theirs = getattr(self.metadata, name), getattr(other.metadata, name)
            if ours != theirs:
                raise UsageError(
                    f"film: cannot merge: {word} is {shown(theirs)} in one film and {shown(ours)} in the other.",
                    "Only path sets of the same render can be added up.",
                )
        return Film(
            self.radiance_sums + other.radiance_sums,
            self.batch_counts + other.batch_counts,
            _united(self.ranges, other.ranges),
            replace(
                self.metadata,
                device=joined(self.metadata.device, other.metadata.device),
                versions=merged_values(self.metadata.versions, other.metadata.versions),
                elapsed_s=self.metadata.elapsed_s + other.metadata.elapsed_s,
                statistics=merged_values(self.metadata.statistics, other.metadata.statistics),
            ),
        )

    def variance_of_mean(self) -> Float64:
        """(H, W, 3) float64, the estimated variance of `mean`, from how much the batches differ.

            sum over batches of count (mean of batch - mean)^2 / (batches - 1) / path sets

        which has no bias for independent path sets, also when batches are of different size. Batches of one Sobol
        sequence are not independent: they complement each other, so that the true variance is smaller than this.

        Raises UsageError when fewer than two batches hold anything.
        """
        used = np.flatnonzero(self.batch_counts)
        if len(used) < 2:
            raise UsageError(
                f"film: {self.path_sets} path sets lie in one batch; an error is estimated between batches.",
                f"Render more than {BLOCK} path sets.",
            )
        mean = self.mean
        spread = np.zeros_like(mean)
        for batch in used:
            count = self.batch_counts[batch]
            spread += count * (self.radiance_sums[batch] / count - mean) ** 2
        variance: Float64 = spread / ((len(used) - 1) * self.path_sets)
        return variance

    def relative_error(self) -> float | None:
        """The error to expect of the image: sqrt(mean over pixels and channels of variance / (mean² + 0.01)).

        Its square estimates `compare.relative_mse` against a converged image; 0.02 is noise of about 2 %. With
        Sobol samples (the default) it is too large rather than too small, see `variance_of_mean`. It sees noise
        only, not the bias of a buffer that is too coarse. None where fewer than two batches hold anything.
        """
        if np.count_nonzero(self.batch_counts) < 2:
            return None
        return float(np.sqrt(np.mean(self.variance_of_mean() / (self.mean**2 + 0.01))))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """`mean`, for `np.asarray(film)` and what takes arrays."""
        if copy is False:
            raise ValueError("a film holds sums, so that its image as an array is always a copy")
        return self.mean.astype(dtype or np.float64, copy=False)

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """The stops that an exposure means for this image.

        exposure : stops; "auto" as `image.auto_exposure` finds; None as the scene says, or else "auto"

        Raises UsageError for another one, or an image of no path set.
        """
        check_exposure(exposure)
        asked = self.metadata.exposure if exposure is None else exposure
        return image.auto_exposure(self.mean) if asked is None or asked == "auto" else float(asked)

    def to_srgb(self, *, exposure: float | Literal["auto"] | None = None, tonemap: str = "srgb") -> UInt8:
        """(H, W, 3) uint8 sRGB, row 0 at the top: what `save` writes as .png.

        exposure : as of `exposure_stops`
        tonemap  : one of `image.TONEMAPS`

        Raises UsageError for another exposure or operator, or an image of no path set.
        """
        return tonemapped(self.mean, self.exposure_stops(exposure), tonemap)

    def save(
        self, path: str | Path, *, exposure: float | Literal["auto"] | None = None, tonemap: str = "srgb"
    ) -> None:
        """Write the film; the suffix says how. The file appears whole or not at all.

        .png : 8-bit sRGB, as `to_srgb` has it; its header says the stops
        .exr : float32 radiance, linear Rec. 709; a crop keeps its place in the whole image
        .npz : everything, exactly; `Film.load` reads it back, to be merged or gone on with

        A pipe or a device is written into; without a suffix, and at "-", standard output, it gets a PNG.

        All carry the metadata. Raises ImageError if it cannot be written, UsageError for another suffix, operator,
        or an image of no path set.
        """
        path = check_suffix(path)
        suffix = path.suffix.lower() or ".png"
        if suffix == ".png":
            stops = self.exposure_stops(exposure)
            text = {"glpath.exposure_stops": f"{stops:g}", "glpath.tonemap": tonemap}
            write_png(path, self.to_srgb(exposure=stops, tonemap=tonemap), self.provenance() | text)
        elif suffix == ".exr":
            window, full_resolution = self.metadata.window, self.metadata.full_resolution
            write_exr(path, self.mean, self.provenance(), window=window, full_resolution=full_resolution)
        else:
            self._save_npz(path)

    def _save_npz(self, path: Path) -> None:
        used = self.batch_counts > 0
        with whole_file(path) as temporary, temporary.open("wb") as file:
            np.savez(
                file,
                radiance_sums=self.radiance_sums[used],  # a batch without path sets need not be stored
                batch_counts=self.batch_counts,
                ranges=np.array(self.ranges, np.int64).reshape(-1, 2),
                block=np.int64(BLOCK),
                metadata=np.array(json.dumps(asdict(self.metadata))),
            )

    @classmethod
    def load(cls, path: str | Path) -> Film:
        """Read a film written as .npz. Raises ImageError, also for one whose parts contradict each other."""
        with open_npz(path, "a film", "A film is what -o NAME.npz writes.") as stored:
            metadata = metadata_of(str(stored.read("metadata", "U", ())))
            counts = stored.read("batch_counts", "iu", (None,))
            block = int(stored.read("block", "iu", ()))
            if (len(counts), block) != (BATCHES, BLOCK):
                raise ValueError(
                    f"its batches are {len(counts)} of blocks of {block} path sets, this version of glpath has "
                    f"{BATCHES} of {BLOCK}"
                )
            ranges = stored.read("ranges", "iu", (None, 2)).astype(np.int64)
            if not _disjoint(ranges) or not np.array_equal(_counts_of(ranges), counts):
                raise ValueError("its ranges of path sets overlap, or are not what its batches count")
            film = cls.empty(metadata)
            used = counts > 0
            sums = stored.read("radiance_sums", "f", (int(used.sum()), *film.radiance_sums.shape[1:]))
            if not np.isfinite(sums).all():
                raise ValueError("it holds sums that are NaN or infinite")
            film.radiance_sums[used] = sums
            film.batch_counts[:] = counts
            film.ranges = tuple((int(start), int(stop)) for start, stop in ranges)
        return film

    def __repr__(self) -> str:
        m = self.metadata
        error = self.relative_error()
        noise = "" if error is None else f", error about {100 * error:.2g} %"
        return (
            f"<Film of {m.scene}: {m.window[2]} x {m.window[3]} pixels, {self.path_sets} path sets, "
            f"depth {m.max_depth}{noise}, {m.device or 'unknown device'}>"
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """What Jupyter shows: the image, at most 1024 pixels long, and a line of text."""
        bundle: dict[str, object] = {"text/plain": repr(self)}
        if self.path_sets:
            bundle["image/png"] = encode_png(tonemapped(_shrunk(self.mean, _PREVIEW), self.exposure_stops()))
        return bundle

    def provenance(self) -> dict[str, str]:
        """What made the film, and which path sets are in it, as texts for a file's header."""
        versions = self.metadata.versions
        return {
            "Software": f"glpath {versions.get('glpath', '')}".strip(),
            "glpath.path_sets": str(self.path_sets),
            "glpath.ranges": json.dumps(self.ranges),
            **self.metadata.as_strings(),
        }


def read_image(path: str | Path) -> Float64:
    """Read an image, or the mean of a film, as (H, W, 3) float64, linear Rec. 709, row 0 at the top.

    .png : sRGB is undone; it holds what the tone map left, not radiance; .jpg as well
    .exr : channels R, G, B or Y; of a crop its own pixels only
    .npz : a film's mean, or the array `radiance`
    .npy : (H, W, 3) or (H, W)

    Raises ImageError for a file that is missing, broken, or of another kind.
    """
    if not holds_film(path):
        return image.read_image(path)
    film = Film.load(path)
    if not film.path_sets:
        raise ImageError(f"{path}: cannot be read as .npz: the film holds no path set.")
    return film.mean


def holds_film(path: str | Path) -> bool:
    """Whether a file holds a film, by the names in it. Raises ImageError where that can't be seen."""
    if Path(path).suffix.lower() != ".npz":
        return False
    with open_npz(path, ".npz") as stored:
        return "radiance_sums" in stored and "radiance" not in stored


def _mean(radiance_sums: Float64, batch_counts: NDArray[np.int64]) -> Float64:
    """(H, W, 3) float64, the mean of (B, H, W, 3) sums over batches of so many path sets each."""
    mean: Float64 = np.add.reduce(radiance_sums, axis=0) / batch_counts.sum()
    return mean


def check_suffix(path: str | Path) -> Path:
    """`path`, if a film can be written to a file of that name; else UsageError."""
    path = Path(path)
    if path.suffix.lower() not in WRITABLE and not (is_stream(path) and not path.suffix):
        found = f"the suffix {path.suffix}" if path.suffix else "no suffix"
        raise UsageError(f"{path}: an output cannot have {found}. Allowed: {', '.join(WRITABLE)}.")
    return path


def _united(ours: tuple[tuple[int, int], ...], theirs: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """All ranges in order, those that touch made one. Raises UsageError where they overlap."""
    united: list[tuple[int, int]] = []
    for start, stop in sorted(ours + theirs):
        if united and start < united[-1][1]:
            raise UsageError(
                f"film: path sets {start} to {min(stop, united[-1][1]) - 1} would be in it twice.",
                "Give every part path sets of its own.",
            )
        if united and start == united[-1][1]:
            united[-1] = (united[-1][0], stop)
        else:
            united.append((start, stop))
    return tuple(united)


def _disjoint(ranges: NDArray[np.int64]) -> bool:
    """Whether (R, 2) ranges are as a film has them: none empty, in order, none touching the next."""
    starts, stops = ranges.T
    in_order = bool((starts < stops).all() and (stops[:-1] < starts[1:]).all())
    return in_order and (not len(ranges) or (starts[0] >= 0 and stops[-1] <= _LAST_PATH_SET))


def _counts_of(ranges: NDArray[np.int64]) -> NDArray[np.int64]:
    """(BATCHES,) how many path sets of (R, 2) ranges belong to each batch."""
    cycles, rest = np.divmod(ranges, BLOCK * BATCHES)
    below = cycles[..., None] * BLOCK + np.clip(rest[..., None] - BLOCK * np.arange(BATCHES), 0, BLOCK)
    counts: NDArray[np.int64] = (below[:, 1] - below[:, 0]).sum(axis=0)
    return counts


def _shrunk(image: Float64, longest: int) -> Float64:
    """Averaged over whole blocks of pixels until no side is longer than `longest`."""
    n = -(-max(image.shape[:2]) // longest)
    height, width = (max(1, side // n) for side in image.shape[:2])
    rows, columns = min(n, image.shape[0]), min(n, image.shape[1])
    trimmed = image[: height * rows, : width * columns]
    shrunk: Float64 = trimmed.reshape(height, rows, width, columns, 3).mean(axis=(1, 3))
    return shrunk
