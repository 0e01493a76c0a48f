"""Cryptomattes: which objects and materials the samples of each pixel hit, and how many samples hit each.

`ShapeCounts` has the exact number of samples by pixel and shape, so path sets can be added in any order with the
same result. `Cryptomatte` is the form for compositors: for each pixel, the names that cover most of it, ranked.
Only this form, made when a file is written, limits the number of names.

Cost:     12 bytes for every shape visible in a pixel: an image of a few objects has little more than one each.
Poor at:  pixels with more visible shapes than ranks (distant leaves): the rarest are omitted, and their coverage is
          missing.
Source:   Friedman & Jones 2015, Fully Automatic ID Mattes with Support for Motion Blur and Transparency;
          Cryptomatte Specification 1.1.0, Psyop; Appleby, MurmurHash3_x86_32.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

Kind = Literal["object", "material"]

#: Number of names written for each pixel. A layer of four channels holds two, as the specification suggests.
RANKS = 6
#: Names of the layers, as in the specification's examples, Blender and Arnold.
LAYERS: dict[Kind, str] = {"object": "CryptoObject", "material": "CryptoMaterial"}

# The upper bits of a key are the pixel, the lower bits the shape.
_SHAPE_BITS = 32


@dataclass(frozen=True, eq=False)
class ShapeCounts:
    """Number of samples of each pixel that have hit each shape.

    size   : (height, width)
    keys   : (N,) int64, (row * width + column) << 32 | shape, ascending
    counts : (N,) int64, above 0
    """

    size: tuple[int, int]
    keys: Int64
    counts: Int64

    @classmethod
    def empty(cls, size: tuple[int, int]) -> ShapeCounts:
        """Return counts without samples."""
        return cls(size, np.zeros(0, np.int64), np.zeros(0, np.int64))

    @classmethod
    def of(cls, shapes: NDArray[np.unsignedinteger]) -> ShapeCounts:
        """Count the samples of each pixel that hit each shape.

        shapes : (H, W, samples), index + 1 of the shape that each sample has hit, 0 for none; row 0 at the top
        """
        height, width, samples = shapes.shape
        # Sorting within each pixel sorts all keys, because the upper bits of a key are its pixel.
        found = np.sort(shapes.reshape(height * width, samples), axis=1).astype(np.int64)
        keys = ((np.arange(height * width)[:, None] << _SHAPE_BITS) + found).ravel()
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        counts = np.diff(starts, append=len(keys))
        keys = keys[starts]
        hit = (keys & (1 << _SHAPE_BITS) - 1) > 0
        return cls((height, width), keys[hit] - 1, counts[hit])

    def __add__(self, other: ShapeCounts) -> ShapeCounts:
        assert self.size == other.size, f"counts of {self.size} and {other.size} pixels"
        keys, counts = np.concatenate([self.keys, other.keys]), np.concatenate([self.counts, other.counts])
        order = np.argsort(keys, kind="stable")  # linear time, because both parts are sorted
        return ShapeCounts(self.size, *_summed(keys[order], counts[order]))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ShapeCounts):
            return NotImplemented
        return (
            self.size == other.size
            and np.array_equal(self.keys, other.keys)
            and np.array_equal(self.counts, other.counts)
        )

    @property
    def nbytes(self) -> int:
        """Size in memory in bytes."""
        return self.keys.nbytes + self.counts.nbytes

    def hits(self) -> Int64:
        """Return the (H, W) int64 number of samples of each pixel that have hit anything."""
        pixel = self.keys >> _SHAPE_BITS
        found = np.bincount(pixel, self.counts, self.size[0] * self.size[1])
        return found.astype(np.int64).reshape(self.size)

    def ranked(self, group: Int64, ranks: int) -> tuple[Int64, Int64]:
        """Return, for each pixel, the groups of shapes that most samples hit, in descending order of hits.

        group : (shapes,) int64, group number of each shape; of groups with equal hits, the lower number comes first

        Returns (H, W, ranks) int64 groups, -1 for none, and their counts.
        """
        height, width = self.size
        of = group[self.keys & ((1 << _SHAPE_BITS) - 1)]
        keys = (self.keys >> _SHAPE_BITS << _SHAPE_BITS) + of
        order = np.argsort(keys, kind="stable")
        keys, counts = _summed(keys[order], self.counts[order])
        pixel, of = keys >> _SHAPE_BITS, keys & ((1 << _SHAPE_BITS) - 1)
        order = np.lexsort((of, -counts, pixel))
        pixel, of, counts = pixel[order], of[order], counts[order]
        first = np.flatnonzero(np.diff(pixel, prepend=-1))
        rank = np.arange(len(pixel)) - np.repeat(first, np.diff(first, append=len(pixel)))
        kept = rank < ranks
        groups = np.full((height * width, ranks), -1, np.int64)
        samples = np.zeros((height * width, ranks), np.int64)
        groups[pixel[kept], rank[kept]], samples[pixel[kept], rank[kept]] = of[kept], counts[kept]
        return groups.reshape(height, width, ranks), samples.reshape(height, width, ranks)

    def check(self, shapes: int, path_sets: int) -> None:
        """Raise ValueError if these counts are impossible for `shapes` and `path_sets`, as in a damaged file."""
        pixels = self.size[0] * self.size[1]
        in_order = bool(np.all(np.diff(self.keys, prepend=-1) > 0))
        within = not len(self.keys) or self.keys[-1] >> _SHAPE_BITS < pixels
        if not in_order or not within or np.any((self.keys & ((1 << _SHAPE_BITS) - 1)) >= shapes):
            raise ValueError("its counts of shapes are not in order, or of pixels or shapes that it has not")
        if np.any(self.counts <= 0) or np.any(self.counts > path_sets) or np.any(self.hits() > path_sets):
            raise ValueError("its counts of shapes are not those of its path sets")


@dataclass(frozen=True, eq=False)
class Cryptomatte:
    """Cryptomatte: for each pixel, the names that cover most of it.

    layer    : name of its layers, "CryptoObject" or "CryptoMaterial"
    ids      : (H, W, ranks) float32, hash of the name, 0 for none; row 0 at the top
    coverage : (H, W, ranks) float64, fraction of the pixel's samples, largest first. The sum over all ranks is the
               fraction that hits a surface, 1 if no sample misses
    manifest : hash of each name, in eight hexadecimal digits
    """

    layer: str
    ids: Float32
    coverage: Float64
    manifest: dict[str, str]

    def matte(self, *names: str) -> Float64:
        """Return the (H, W) float64 fraction of each pixel that objects or materials with these names cover."""
        wanted = np.array([hash_id(name) for name in names], np.float32)
        return np.asarray(np.where(np.isin(self.ids, wanted), self.coverage, 0.0).sum(axis=2))

    def channels(self) -> dict[str, Float32]:
        """Return (H, W) float32 channels by name: CryptoObject00.R is the first id, .G the coverage of that id."""
        found = {}
        for rank in range(self.ids.shape[2]):
            layer = f"{self.layer}{rank // 2:02}"
            found[f"{layer}.{'RB'[rank % 2]}"] = self.ids[..., rank]
            found[f"{layer}.{'GA'[rank % 2]}"] = self.coverage[..., rank].astype(np.float32)
        return found

    def header(self) -> dict[str, str]:
        """Return the header entries of a file that contains this Cryptomatte [Specification 1.1.0, Metadata]."""
        key = f"cryptomatte/{_hex(hash_id(self.layer))[:7]}"
        return {
            f"{key}/name": self.layer,
            f"{key}/hash": "MurmurHash3_32",
            f"{key}/conversion": "uint32_to_float32",
            f"{key}/manifest": json.dumps(self.manifest, ensure_ascii=False, separators=(",", ":")),
        }


def cryptomatte(
    kind: Kind, counts: ShapeCounts, names: Sequence[str], path_sets: int, ranks: int = RANKS
) -> Cryptomatte:
    """Return the Cryptomatte of counted samples; shapes with the same name are combined.

    names     : name of each shape, or of its material
    path_sets : number of samples of each pixel
    ranks     : maximum number of names of a pixel
    """
    distinct = list(dict.fromkeys(names))
    number = {name: i for i, name in enumerate(distinct)}
    group = np.array([number[name] for name in names], np.int64)
    groups, samples = counts.ranked(group, ranks)
    # Group -1, no shape, takes the last hash, 0.
    hashes = np.append(np.array([hash_id(name) for name in distinct], np.float32), np.float32(0.0))
    manifest = {name: _hex(hash_id(name)) for name in distinct}
    return Cryptomatte(LAYERS[kind], hashes[groups], samples / path_sets, manifest)


def hash_id(name: str) -> np.float32:
    """Return the hash of a name as a finite number [Cryptomatte Specification 1.1.0, ID Generation].

    >>> print(hash_id("hello"))
    6.070563e-17
    """
    bits = murmur3_32(name.encode())
    # Avoid denormal, infinite and NaN values, which filters would not preserve.
    exponent = min(max(bits >> 23 & 255, 1), 254)
    return np.uint32(bits & 0x807FFFFF | exponent << 23).view(np.float32)


def _hex(number: np.float32) -> str:
    return f"{int(number.view(np.uint32)):08x}"


def murmur3_32(data: bytes, seed: int = 0) -> int:
    """Return the hash MurmurHash3_x86_32 [Appleby].

    >>> hex(murmur3_32(b"hello"))
    '0x248bfa47'
    """
    mask, h = 0xFFFFFFFF, seed
    whole = len(data) & ~3
    for start in range(0, whole, 4):
        h ^= _scrambled(int.from_bytes(data[start : start + 4], "little"))
        h = ((h << 13 | h >> 19) & mask) * 5 + 0xE6546B64 & mask
    h ^= _scrambled(int.from_bytes(data[whole:], "little")) ^ len(data)
    h = (h ^ h >> 16) * 0x85EBCA6B & mask
    h = (h ^ h >> 13) * 0xC2B2AE35 & mask
    return h ^ h >> 16


def _scrambled(k: int) -> int:
    k = k * 0xCC9E2D51 & 0xFFFFFFFF
    return ((k << 15 | k >> 17) & 0xFFFFFFFF) * 0x1B873593 & 0xFFFFFFFF


def _summed(keys: Int64, counts: Int64) -> tuple[Int64, Int64]:
    if not len(keys):
        return keys, counts
    starts = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1))
    return keys[starts], np.add.reduceat(counts, starts)
