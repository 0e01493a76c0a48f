"""Daylight coefficients: response of sensors to each patch of the sky and each position of the sun.

Direct light is stored as a visibility bit for each sensor and direction, with the geometry from which the
coefficients follow. That is lossless and 32 to 128 times smaller than the matrix in floats. Reflected light is a
product of two smaller matrices. Rows of floats are made in blocks on demand.

Source:   Tregenza & Waters 1983, Daylight coefficients; McNeil & Lee 2013, A validation of the Radiance three-phase
          simulation method.
"""

from __future__ import annotations

from collections.abc import Iterator, Sized
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.daylight.compass import Compass
from glpath.apps.daylight.indirect import Indirect
from glpath.apps.daylight.receivers import RECEIVERS, Receiver, response
from glpath.apps.daylight.shard import Shard
from glpath.apps.daylight.sky_patches import SUBDIVISIONS, SkyPatches
from glpath.apps.daylight.texels import Texels
from glpath.errors import ImageError, UsageError
from glpath.gl.parallel_rays import WORD
from glpath.system.arguments import check_array, check_count, check_word, checked, short_repr
from glpath.system.files import whole_file
from glpath.system.npz import Arrays, open_npz
from glpath.system.vectors import LARGEST

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Number of the file format, see CONTRIBUTING.md; format 1, without reflected light, is read too.
FORMAT = 2
# Maximum number of floats in a block of rows (64 MiB).
_BLOCK = 1 << 24
# Maximum deviation of the length of a unit vector from 1.
_UNIT = 1e-3
# Files with more than this many bytes of visibility words are written without compression.
_PLAIN = 1 << 27


@checked
@dataclass(frozen=True, eq=False)
class DaylightCoefficients:
    """Daylight coefficients of N sensors.

    points, normals : (N, 3) float64, scene units; unit normals, or axes of cylinders
    receiver    : "plane", "cylinder" or "sphere"
    subdivision : subdivision of the sky: 1, 2 or 4; see `SkyPatches`
    up, north   : (3,) unit vectors
    latitude    : latitude of the sun positions, degrees; NaN without suns
    samples     : number of directions per patch
    directions  : (D, 3) unit vectors towards the ground, the sky's patches, then the suns
    column : (D,) matrix column to which a direction belongs: 0 is the ground, then the sky's patches, then the suns
    weight      : (D,) solid angle of a direction, steradians; 1 for a sun
    words       : (ceil(D / 32), N) uint32; bit k of word w is 1 if direction 32 w + k is visible
    shares      : (32 ceil(D / 32), N) float16 transmittance of thin glass along each direction; None without glass
    indirect    : reflected light; None if only direct light is computed
    texels      : faces of the scene to which the sensors belong; None for other sensors
    shard       : range of the sensors; None for all

    Raises UsageError for arrays of other shapes, and for values out of range.
    """

    points: Float64
    normals: Float64
    receiver: Receiver
    subdivision: int
    up: Float64
    north: Float64
    latitude: float
    samples: int
    directions: Float64
    column: NDArray[np.intp]
    weight: Float64
    words: NDArray[np.uint32]
    shares: NDArray[np.float16] | None = None
    indirect: Indirect | None = None
    texels: Texels | None = None
    shard: Shard | None = None

    def __post_init__(self) -> None:
        check_word("receiver", self.receiver, RECEIVERS)
        check_count("subdivision", self.subdivision, 1, max(SUBDIVISIONS))
        points = check_array("points", self.points, (None, 3), (-LARGEST, LARGEST))
        if not len(points):
            raise UsageError("points: none where one sensor at least is needed")
        directions = _unit_vectors("directions", self.directions, (None, 3))
        d, n = len(directions), len(points)
        check_count("samples", self.samples, 1, max(1, d))
        column = check_array("column", self.column, (d,), (0, d), whole=True)
        found = {
            "points": points,
            "normals": _unit_vectors("normals", self.normals, (n, 3)),
            "up": _unit_vectors("up", self.up, (3,)),
            "north": _unit_vectors("north", self.north, (3,)),
            "directions": directions,
            "column": column,
            "weight": check_array("weight", self.weight, (d,), (0.0, 4 * np.pi)),
        }
        self._check_columns(column)
        words = -(-d // WORD)
        _check_type("words", self.words, "uint32", (words, n))
        if self.shares is not None:
            _check_type("shares", self.shares, "float16", (WORD * words, n))
        if self.indirect is not None:
            parts = self.indirect.weights.shape[:1], self.indirect.radiosity.shape[1:], self.indirect.errors.shape
            if parts != ((n,), (int(column[-1]) + 1,), (n,)):
                raise UsageError("indirect: of other sensors or directions than the rest")
        if self.texels is not None and len(self.texels) != n:
            raise UsageError(f"texels: {len(self.texels):,} where one for each of {n:,} sensors is needed")
        if self.shard is not None and not 0 <= self.shard.first <= self.shard.total - n:
            raise UsageError(f"shard: {self.shard} does not contain {n:,} sensors")
        for name, values in found.items():
            object.__setattr__(self, name, values)

    def _check_columns(self, column: NDArray[np.int64]) -> None:
        """Raise UsageError unless each patch has directions, in ascending order, and each sun has one."""
        patches, steps = len(self.patches), np.diff(column, prepend=-1)
        of_suns = column >= patches
        ascending = (steps == 1) | ((steps == 0) & ~of_suns)
        if not (len(column) and ascending.all() and column[-1] >= patches - 1):
            raise UsageError(
                f"column: of other directions than those of the ground, {patches - 1:,} patches and the suns, in "
                "ascending order"
            )
        counts = np.bincount(column[~of_suns])
        # Standard errors come from pairs of directions.
        paired = self.samples < 4 or (counts[0] >= 4 and counts[0] % 2 == 0 and self.samples % 2 == 0)
        if not (paired and (counts[1:] == self.samples).all()):
            raise UsageError(
                f"column: {counts.min():,} to {counts.max():,} directions per patch where samples is {self.samples}"
            )
        if of_suns.any() and not (isinstance(self.latitude, int | float) and abs(self.latitude) <= 90):
            raise UsageError(f"latitude: {short_repr(self.latitude)} of suns where -90 to 90 degrees are needed")

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def patches(self) -> SkyPatches:
        """Patches of the sky; column i of `sky` belongs to patch i."""
        return SkyPatches(self.subdivision)

    @cached_property
    def compass(self) -> Compass:
        """Orientation of up and north."""
        (ux, uy, uz), (nx, ny, nz) = self.up.tolist(), self.north.tolist()
        return Compass((ux, uy, uz), (nx, ny, nz))

    @property
    def suns(self) -> Float64:
        """Unit vectors (S, 3) to the positions of the sun."""
        return self.directions[self._in_sky :]

    def sky(self, rows: slice = slice(None)) -> Float32:
        """Return (n, P) float32 irradiance of some sensors for unit radiance of the ground and each patch."""
        return self._with_indirect(self.direct_sky(rows), rows, slice(0, len(self.patches)))

    def sun(self, rows: slice = slice(None)) -> Float32:
        """Return (n, S) float32 irradiance of some sensors for unit irradiance normal to each sun's direction."""
        return self._with_indirect(self.direct_sun(rows), rows, slice(len(self.patches), None))

    def direct_sky(self, rows: slice = slice(None)) -> Float32:
        """Return (n, P) float32 coefficients of `sky` without reflected light."""
        chosen = rows_of(self, rows)
        found = np.empty((len(chosen), len(self.patches)), np.float32)
        for first, last in self._blocks(len(chosen)):
            found[first:last] = self._summed(self._light(chosen[first:last], slice(0, self._in_sky)))
        return found

    def direct_sun(self, rows: slice = slice(None)) -> Float32:
        """Return (n, S) float32 coefficients of `sun` without reflected light."""
        return self._light(rows_of(self, rows), slice(self._in_sky, len(self.directions)))

    def sunlight(self, rows: slice = slice(None)) -> Float32:
        """Return (n, S) float32 transmittance towards each sun position, without the cosine of incidence.

        It is 0 for positions behind a plane.
        """
        return self._arrives(rows_of(self, rows), slice(self._in_sky, len(self.directions)))

    def indirect_sun(self, rows: slice = slice(None)) -> Float32:
        """Return (n, S) float32 coefficients of `sun`, reflected light only."""
        nothing = np.zeros((len(rows_of(self, rows)), len(self.suns)), np.float32)
        return self._with_indirect(nothing, rows, slice(len(self.patches), None))

    def irradiance(self, sky: ArrayLike, sun: ArrayLike | None = None) -> Float64:
        """Return (N, T) float64 irradiance of all sensors at T times.

        sky : (P, T) or (P,) radiance of the ground and the patches
        sun : (S, T) or (S,) irradiance normal to the sun's direction for each position; default: no sun
        """
        radiance = _times("sky", sky, len(self.patches))
        normal = None if sun is None else _times("sun", sun, len(self.suns))
        times = radiance.shape[1]
        if normal is not None and normal.shape[1] != times:
            raise UsageError(f"irradiance: sky has {times} times, sun {normal.shape[1]}.", "Give both alike.")
        found = np.empty((len(self), times))
        for first, last in self._blocks(len(self)):
            rows = slice(first, last)
            found[rows] = self.sky(rows) @ radiance.astype(np.float32)
            if normal is not None:
                found[rows] += self.sun(rows) @ normal.astype(np.float32)
        return found

    def sparse(self) -> Any:
        """Return the coefficients of ground, sky and suns as a `scipy.sparse.csr_array` (N, P + S) float32."""
        from scipy import sparse

        blocks = [
            sparse.csr_array(np.concatenate([self.sky(slice(a, b)), self.sun(slice(a, b))], axis=1))
            for a, b in self._blocks(len(self))
        ]
        return sparse.vstack(blocks, format="csr")

    @cached_property
    def sky_sums(self) -> Float64:
        """Irradiance (N,) float64 under a ground and a sky of unit radiance."""
        return self._sums[0]

    @cached_property
    def standard_errors(self) -> Float64:
        """Standard errors (N,) float64 of `sky_sums`.

        They follow from the spread of pairs of directions in each patch, and of the rays that gather reflected
        light.

        Directions form a lattice, so the estimate is rather too large. All sensors have the same directions, so
        errors of neighbours are correlated. Errors of the elements' solution are not included. NaN below four
        samples per patch.
        """
        return self._sums[1]

    @cached_property
    def sensor_weights(self) -> Float64:
        """Weights (N,) of the sensors in means and fractions of the area: areas of texels; 1 without texels."""
        return np.ones(len(self)) if self.texels is None else self.texels.areas

    @cached_property
    def sky_view(self) -> Float64:
        """Sky view factors (N,) float64: irradiance under a white sky and black ground, relative to open ground."""
        return np.concatenate(
            [
                self.direct_sky(slice(a, b))[:, 1:].sum(axis=1, dtype=np.float64) / np.pi
                for a, b in self._blocks(len(self))
            ]
        )

    @cached_property
    def dark(self) -> int:
        """Number of sensors without any visible direction, which are inside solids or below the ground."""
        return int(np.count_nonzero(~self.words.any(axis=0)))

    # Parts of the coefficient matrix.

    @cached_property
    def _in_sky(self) -> int:
        """Number of directions that belong to the ground or a sky patch; the others belong to suns."""
        return int(np.count_nonzero(self.column < len(self.patches)))

    @cached_property
    def _starts(self) -> NDArray[np.intp]:
        """Index of the first direction of each matrix column of the ground and sky."""
        return np.searchsorted(self.column[: self._in_sky], np.arange(len(self.patches)))

    @cached_property
    def _sums(self) -> tuple[Float64, Float64]:
        sums, errors = np.empty(len(self)), np.full(len(self), np.nan)
        pairs = np.diff(np.append(self._starts, self._in_sky)) // 2
        per_patch = self.weight[self._starts] * 2 * pairs
        for first, last in self._blocks(len(self)):
            light = self._light(range(first, last), slice(0, self._in_sky))
            sums[first:last] = light.astype(np.float64) @ self.weight[: self._in_sky]
            if self.samples < 4:
                continue
            paired = 0.5 * (light[:, 0::2] + light[:, 1::2]).astype(np.float64)
            total = np.add.reduceat(paired, self._starts // 2, axis=1)
            squares = np.add.reduceat(paired**2, self._starts // 2, axis=1)
            variance = np.maximum(squares - total**2 / pairs, 0.0) / (pairs - 1)
            errors[first:last] = np.sqrt((variance / pairs) @ per_patch**2)
        if self.indirect is not None:
            in_sky = slice(0, len(self.patches))
            of_sides = self.indirect.radiosity[:, in_sky].sum(axis=1, dtype=np.float64)
            sums += self.indirect.weights @ of_sides
            errors = np.hypot(errors, self.indirect.errors)
        return sums, errors

    def _with_indirect(self, direct: Float32, rows: slice, columns: slice) -> Float32:
        if self.indirect is not None:
            direct += self.indirect.rows(np.arange(len(self))[rows], columns)
        return direct

    def _summed(self, light: Float32) -> Float32:
        weighted = light * self.weight[: self._in_sky].astype(np.float32)
        return np.asarray(np.add.reduceat(weighted, self._starts, axis=1), np.float32)

    def _light(self, rows: range, which: slice) -> Float32:
        """Return (n, d) irradiance of sensors for unit light from some directions; 0 if the light is occluded."""
        light = self._arrives(rows, which)
        light *= response(self.receiver, self.normals[np.array(rows, np.intp)], self.directions[which])
        return light

    def _arrives(self, rows: range, which: slice) -> Float32:
        """Return (n, d) fraction of the light from some directions that reaches the sensors, without the cosine."""
        of = np.array(rows, np.intp)
        first, last = which.start // WORD, -(-which.stop // WORD)
        words = self.words[first:last][:, of]
        bits = np.unpackbits(np.ascontiguousarray(words.T).astype("<u4").view(np.uint8), axis=1, bitorder="little")
        inside = slice(which.start - WORD * first, which.stop - WORD * first)
        found = bits[:, inside].astype(np.float32)
        if self.shares is not None:
            found *= self.shares[which][:, of].T
        return found

    def _blocks(self, count: int) -> Iterator[tuple[int, int]]:
        step = max(1, _BLOCK // max(1, len(self.directions)))
        for first in range(0, count, step):
            yield first, min(first + step, count)

    # File format.

    def save(self, path: str | Path) -> None:
        """Write all fields and the format number as .npz. Raises ImageError if the file cannot be written."""
        arrays: dict[str, Any] = {
            "glpath_daylight": FORMAT,
            **{name: getattr(self, name) for name in (*_ARRAYS, "receiver", "subdivision", "latitude", "samples")},
        }
        if self.shares is not None:
            arrays["shares"] = self.shares
        if self.indirect is not None:
            arrays |= self.indirect.arrays()
        if self.texels is not None:
            arrays |= self.texels.arrays()
        if self.shard is not None:
            arrays |= {"shard": [self.shard.first, self.shard.total], "shard_work": self.shard.work}
        # Compressed zeros of a large file would expand beyond the limit of the reader.
        write = np.savez if self.words.nbytes > _PLAIN else np.savez_compressed
        with whole_file(path) as part, open(part, "wb") as file:
            write(file, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> DaylightCoefficients:
        """Read a file written by `save`. Raises ImageError for other files and formats."""
        remedy = "`glpath daylight` writes such a file."
        with open_npz(path, "daylight coefficients", remedy) as arrays:
            found = int(arrays.read("glpath_daylight", "i", ()))
            if not 1 <= found <= FORMAT:
                raise ImageError(
                    f"{path}: has daylight coefficients of format {found}; this version reads 1 to {FORMAT}.",
                    "Compute them anew.",
                )
            receiver = str(arrays.read("receiver", "U", ()))
            if receiver not in RECEIVERS:
                raise ValueError(f"its receiver is {receiver!r}, expected one of {', '.join(RECEIVERS)}")
            directions = arrays.read("directions", "f", (None, 3))
            points = arrays.read("points", "f", (None, 3))
            d, n = len(directions), len(points)
            words = -(-d // WORD)
            try:
                fields: dict[str, Any] = dict(
                    points=points,
                    normals=arrays.read("normals", "f", (n, 3)),
                    receiver=receiver,
                    subdivision=int(arrays.read("subdivision", "i", ())),
                    up=arrays.read("up", "f", (3,)),
                    north=arrays.read("north", "f", (3,)),
                    latitude=float(arrays.read("latitude", "f", ())),
                    samples=int(arrays.read("samples", "i", ())),
                    directions=directions,
                    column=arrays.read("column", "i", (d,)),
                    weight=arrays.read("weight", "f", (d,)),
                    words=arrays.read("words", "u", (words, n)),
                    shares=arrays.read("shares", "f", (WORD * words, n)) if "shares" in arrays else None,
                    indirect=Indirect.read(arrays, n) if "radiosity" in arrays else None,
                    texels=Texels.read(arrays, n) if "texel_corners" in arrays else None,
                    shard=_shard(arrays) if "shard" in arrays else None,
                )
                return cls(**fields)
            except UsageError as error:
                raise ValueError(error.message) from error


def rows_of(sensors: Sized, rows: slice) -> range:
    """Return the indices of some sensors. Raises UsageError for a slice of other values than whole numbers."""
    try:
        return range(len(sensors))[rows]
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"rows: {short_repr(rows)} where a slice of whole numbers is needed", "slice(0, 9) has the first nine."
        ) from error


def _shard(arrays: Arrays) -> Shard:
    first, total = arrays.read("shard", "i", (2,)).tolist()
    return Shard(first, total, str(arrays.read("shard_work", "U", ())))


_ARRAYS = ("points", "normals", "up", "north", "directions", "column", "weight", "words")


def _unit_vectors(name: str, values: Any, shape: tuple[int | None, ...]) -> Float64:
    """Return unit vectors as float64. Raises UsageError for arrays of another shape and for other vectors."""
    found: Float64 = check_array(name, values, shape, (-2.0, 2.0))
    lengths = np.atleast_1d(np.linalg.norm(found, axis=-1))
    if (wrong := np.abs(lengths - 1.0) > _UNIT).any():
        raise UsageError(f"{name}: a vector of length {lengths[wrong][0]:g} where unit vectors are needed")
    return found


def _check_type(name: str, values: Any, kind: str, shape: tuple[int, ...]) -> None:
    """Raise UsageError unless `values` is an array of this type and shape."""
    if not isinstance(values, np.ndarray) or values.dtype.name != kind or values.shape != shape:
        is_array = isinstance(values, np.ndarray)
        found = f"an array {values.shape} of {values.dtype}" if is_array else short_repr(values)
        raise UsageError(f"{name}: {found} where an array {shape} of {kind} is needed")


def _times(name: str, values: ArrayLike, rows: int) -> Float64:
    """Return `values` as an array (rows, T). Raises UsageError."""
    found = np.asarray(values, np.float64)
    if found.ndim == 1:
        found = found[:, None]
    if found.ndim != 2 or len(found) != rows:
        raise UsageError(f"{name}: of shape {np.shape(values)} where ({rows},) or ({rows}, times) is needed")
    return found
