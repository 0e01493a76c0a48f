"""Sample points of a path set, which depend only on a counter (seed, path set, use).

All paths of a set share their directions and their light sample [PB 3.1, 3.3]. So a set needs only few numbers,
which the CPU computes. By default these numbers are one point of an Owen-scrambled Sobol sequence. The error then
falls almost as 1/n instead of 1/sqrt(n). If the first bounce has only one direction, that direction can be a point
of an extensible lattice instead. With `sampling="random"` the numbers are independent and uniform, as in the paper.

Poor at: many dimensions. Later pairs of a Sobol sequence are no better than random for fewer than some thousand
sets.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glpath.sampling import Sampling
from glpath.sampling.sobol import DIMENSIONS, sobol_points, sobol_points_at

# Dimensions of the Sobol sequence for the first two bounces, each with two directions of two numbers. These bounces
# get the best dimensions of the sequence, because the image varies most with their directions. On the Cornell box
# at 128 sets, the error is a fifth less than if the directions come last.
_DIRECTIONS = ((0, 1, 4, 5), (2, 3, 6, 7))
_LIGHT = slice(8, 11)
_OWN_LIGHT = [8, 9, 10, 4]  # for sampling "random"; a Sobol sequence has other numbers, see `_make_lights`
_PIXEL = slice(11, 13)
_FURTHER_DIRECTIONS = slice(13, 61)
_SEQUENCE_BOUNCES = 14  # number of bounces whose directions are dimensions of the Sobol sequence


@dataclass(frozen=True)
class PathSetSample:
    """Numbers that the paths of one set share, each in [0, 1).

    pixel      : (2,) position in the pixel, x to the right and y down
    light      : (3,) selection of the emitter, and position on it, for a light sample that all paths share
    own_light  : (4,) for light samples that each path draws separately: selection of the emitter, position on it
                 (2 numbers), and selection among the samples. Each path shifts these numbers
    directions : (bounces, 2, 2): two points for each bounce, of two numbers each; at least `max_depth` - 1 bounces
    """

    pixel: NDArray[np.float64]
    light: NDArray[np.float64]
    own_light: NDArray[np.float64]
    directions: NDArray[np.float64]


class PathSetSampler:
    """Random numbers of a render. `sampler[i]` is the `PathSetSample` of path set i = 0, 1, 2, ...

    Parameters
    ----------
    seed      : integer >= 0; renders with different seeds are independent
    max_depth : maximum number of vertices of a path, without the eye and the light samples
    sampling  : "sobol" or "random"
    lattice   : True to take the first direction from a lattice; not with "random"
    """

    _CHUNK = 256

    def __init__(self, seed: int, max_depth: int, sampling: Sampling = "sobol", lattice: bool = False) -> None:
        self.seed = seed
        self.lattice = lattice and sampling == "sobol"
        bounces = max(max_depth - 1, 0)
        # Use all dimensions of the sequence even if fewer are needed, so that renders with different depths up to
        # 15 have the same numbers.
        self.dimensions = DIMENSIONS + 4 * max(bounces - _SEQUENCE_BOUNCES, 0)
        self.sampling = sampling
        self._chunk = -1
        self._points = np.empty((0, self.dimensions))
        self._light_points = np.empty((0, 4))
        self._eye_chunk = -1
        self._eye_points = np.empty((0, 3))

    def __getitem__(self, index: int) -> PathSetSample:
        if index // self._CHUNK != self._chunk:
            self._chunk = index // self._CHUNK
            self._points = self._make(self._chunk * self._CHUNK)
            self._light_points = self._make_lights(self._chunk * self._CHUNK)
        u = self._points[index % self._CHUNK]
        further = np.concatenate([u[_FURTHER_DIRECTIONS], u[DIMENSIONS:]]).reshape(-1, 4)
        directions = np.concatenate([u[np.array(_DIRECTIONS)], further]).reshape(-1, 2, 2)
        if self.lattice:
            directions[0, 0] = lattice_point(self.seed, index)
        return PathSetSample(u[_PIXEL], u[_LIGHT], self._light_points[index % self._CHUNK], directions)

    def time(self, index: int, shutter: tuple[float, float]) -> float:
        """Return the time in seconds that all paths of a set share [PB 3.3]."""
        opened, closed = shutter
        return opened if opened == closed else opened + (closed - opened) * float(self.eye(index)[2])

    def eye(self, index: int) -> NDArray[np.float64]:
        """Return (3,) numbers in [0, 1) for a path set's eye: position on the lens, and time within the shutter.

        The numbers of 2**k successive path sets are evenly distributed in time, over the lens, and over both. The
        first index must be a multiple of 2**k. The order of these numbers is shuffled, so they are independent of
        the set's other numbers.
        """
        if index // self._CHUNK != self._eye_chunk:
            self._eye_chunk = index // self._CHUNK
            start = self._eye_chunk * self._CHUNK
            if self.sampling == "random":
                bits = np.random.Philox(key=self.seed, counter=[0, 0, 1, start])
                self._eye_points = np.random.Generator(bits).random((self._CHUNK, 3))
            else:
                # The time gets the sequence's first dimension, because its first points are the most even.
                self._eye_points = self._shuffled(start, 9, 0)[:, [1, 2, 0]]
        return np.asarray(self._eye_points[index % self._CHUNK])

    def _make(self, start: int) -> NDArray[np.float64]:
        if self.sampling == "random":
            # A Philox stream per chunk, keyed by the seed, so chunks share no state.
            bits = np.random.Philox(key=self.seed, counter=[0, 0, 0, start])
            return np.random.Generator(bits).random((self._CHUNK, self.dimensions))
        points = sobol_points(start, self._CHUNK, DIMENSIONS)
        keys = np.random.default_rng(self.seed).integers(0, 2**32, DIMENSIONS, dtype=np.uint32)
        bounces = range(_SEQUENCE_BOUNCES, _SEQUENCE_BOUNCES + (self.dimensions - DIMENSIONS) // 4)
        return np.concatenate([owen_scrambled(points, keys), *(self._padding(start, b) for b in bounces)], axis=1)

    def _make_lights(self, start: int) -> NDArray[np.float64]:
        """Return (chunk, 4) numbers `PathSetSample.own_light`, for light samples that each path draws separately.

        These numbers have a shuffled sequence of their own, because dimensions 8 to 10 of the main sequence have
        uneven projections onto two dimensions. With those dimensions, the mean of an image under an environment map
        would scatter two to three times as much after 256 to 512 path sets.

        A light sample that all paths share has dimensions 8 to 10 nevertheless. The error of indirect light is half
        as large if shared light samples and shared directions come from the same sequence.
        """
        if self.sampling == "random":
            return self._points[:, _OWN_LIGHT]
        return self._shuffled(start, 16, 0)[:, [2, 0, 1, 3]]

    def _padding(self, start: int, bounce: int) -> NDArray[np.float64]:
        """Return (chunk, 4) numbers for a bounce for which the sequence has no more dimensions."""
        return self._shuffled(start, 8, bounce)

    def _shuffled(self, start: int, purpose: int, which: int) -> NDArray[np.float64]:
        """Return (chunk, 4) points of the sequence's first four dimensions, in a shuffled order.

        start : index of the first point, in the shuffled order

        The order is different for each pair of `purpose` and `which`.

        Source: Burley 2020, Practical Hash-based Owen Scrambling, section 4.
        """
        keys = np.array([counter_hash(self.seed, which, use, purpose) for use in range(5)], np.uint32)
        index = np.arange(start, start + self._CHUNK, dtype=np.uint64).astype(np.uint32)
        shuffled = _owen(index[:, None], keys[:1])[:, 0]
        return owen_scrambled(sobol_points_at(shuffled.astype(np.uint64), 4), keys[1:])


#: Ratio of the lattice's second coordinate to the first, the best odd number below 2**20 for 2**3 to 2**20 points.
#: For each of these counts, the lattice's shortest vector is at least 0.71 times as long as that of the best
#: lattice. No other ratio has a higher minimum.
_GENERATOR = 17939


def lattice_point(seed: int, index: int) -> NDArray[np.float64]:
    """Return (2,) in [0, 1): point `index` of an extensible rank-1 lattice, shifted by the seed.

    Successive points form a lattice if their number is 2**k and the first index is a multiple of 2**k.
    Source: Hickernell, Hong, L'Ecuyer & Lemieux 2000, Extensible Lattice Sequences for Quasi-Monte Carlo
    Quadrature.
    """
    shift = np.array([counter_hash(seed, axis, 7) for axis in range(2)], np.uint32)
    # Unsigned integers wrap at 2**32. After the division, the coordinates thus wrap at 1.
    point = _bits_reversed(np.array([index & 0xFFFFFFFF], np.uint32)) * np.array([1, _GENERATOR], np.uint32) + shift
    return np.asarray(point / 2.0**32)


def pixel_sample(seed: int, index: int) -> tuple[float, float]:
    """Return a path set's position in the pixel, for sets without shared directions or light samples.

    The position is x to the right and y down, each in [0, 1). The positions are a Sobol sequence, so 2**k of them
    fill a grid if the first index is a multiple of 2**k. They are Owen-scrambled, then shifted digit by digit so
    that position 0 is the pixel's centre.
    """
    ((x, y),) = pixel_samples(seed, index, 1)
    return float(x), float(y)


def pixel_samples(seed: int, first: int, count: int) -> NDArray[np.float64]:
    """Return (count, 2) positions in the pixel: results of `pixel_sample` for `count` indices from `first` on.

    count : power of two up to 4096 that divides `first`
    """
    block, index_in_block = divmod(first, _PIXEL_SAMPLES)
    found = _pixel_samples(seed)[index_in_block : index_in_block + count]
    if block:
        # Each later block repeats the positions of the first block, shifted by a hash of the block's index.
        found = (found + [counter_hash(seed, block, axis) / 2**32 for axis in range(2)]) % 1.0
    return found


_PIXEL_SAMPLES = 4096


@lru_cache(maxsize=4)
def _pixel_samples(seed: int) -> NDArray[np.float64]:
    """Return (4096, 2) positions in the pixel: the results of `pixel_sample` for the first 4096 indices."""
    keys = np.random.default_rng(seed).integers(0, 2**32, 2, dtype=np.uint32)
    scrambled = _owen(sobol_points(0, _PIXEL_SAMPLES, 2), keys)
    return np.asarray((scrambled ^ scrambled[0] ^ np.uint32(1 << 31)) / 2.0**32)


def owen_scrambled(points: NDArray[np.uint32], keys: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return (n, d) numbers in [0, 1) from (n, d) 32-bit net points, Owen-scrambled by one key (d,) per dimension.

    A hash of the bits above a bit decides whether the bit is flipped. On the Cornell box this scrambling has a
    twentieth less error than scipy's linear scrambling, and fewer bad seeds.
    Source: Laine & Karras 2011, Stratified Sampling for Stochastic Transparency; Burley 2020, Practical Hash-based
    Owen Scrambling; constants of Vegdahl 2021.
    """
    return _owen(points, keys) / 2.0**32


def _owen(points: NDArray[np.uint32], keys: NDArray[np.uint32]) -> NDArray[np.uint32]:
    x = _bits_reversed(points)
    with np.errstate(over="ignore"):  # overflow modulo 2**32 is intended
        x = x + keys
        for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
            x ^= x * np.uint32(factor)
    return _bits_reversed(x)


def _bits_reversed(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        m = np.uint32(mask)
        x = ((x >> np.uint32(shift)) & m) | ((x & m) << np.uint32(shift))
    return (x >> np.uint32(16)) | (x << np.uint32(16))


def radical_inverse(index: int) -> float:
    """Return the radical inverse of a number below 2**32 in base 2: van der Corput's sequence, in [0, 1)."""
    return int(f"{index:032b}"[::-1], 2) / 2.0**32


def counter_hash(*counter: int) -> int:
    """Return a 32-bit hash of integers, such as the seed for a shader's per-path hash."""
    text = ",".join(map(str, counter)).encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=4).digest(), "little")


def concentric_disk(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map u (2,), uniform in [0, 1), to a point (2,) that is uniform in the unit disk.

    Source: Shirley & Chiu 1997, A Low Distortion Map Between Disk and Square.
    """
    x, y = 2.0 * u - 1.0
    if x == 0.0 and y == 0.0:
        return np.zeros(2)
    radius, angle = (x, np.pi / 4 * y / x) if abs(x) > abs(y) else (y, np.pi / 4 * (2.0 - x / y))
    return np.array([radius * np.cos(angle), radius * np.sin(angle)])


def uniform_hemisphere(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map u (..., 2), uniform in [0, 1), to unit vectors (..., 3) with z >= 0 and density 1 / (2 pi)."""
    z = u[..., 0]
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    phi = 2.0 * np.pi * u[..., 1]
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


def uniform_sphere(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map u (..., 2), uniform in [0, 1), to unit vectors (..., 3) with density 1 / (4 pi) [PB A.2]."""
    z = 1.0 - 2.0 * u[..., 0]
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    phi = 2.0 * np.pi * u[..., 1]
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
