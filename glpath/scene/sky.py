"""The sky, from horizon to zenith, or an environment map.

Both answer the same: `radiance` seen in directions, its integral, and `directions` as dense as it is.

Source:   Pharr, Jakob & Humphreys 2023, Physically based rendering, 12.5, for light from a map. Here each texel is
          a tent, of which bilinear filtering is the sum: directions drawn from the tents have the very density of
          the filtered map, where pbrt's and Mitsuba's tables have nearly that.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.scene.digest import digest_of
from glpath.scene.geometry import perpendicular
from glpath.scene.sun import Sun

Float64 = NDArray[np.float64]

# A picture's sums have bits for so much more than `typical_radiance` (`glpath.gl.sums` has 2**24).
_SUMS_HOLD = 2.0**20
# What 32 bits can square; as in scene files.
_LARGEST = 1e15
# A row with so many times the power of the mean one has a sun.
_SUN = 4.0
# Newton's steps from a first guess that is exact where the sine is constant.
_STEPS = 4


@dataclass(frozen=True)
class Sky:
    """A sky: a blend from horizon (and below) to zenith by the sine of the elevation.

    zenith, horizon : (3,) float64 radiance, linear Rec. 709
    up              : (3,) float64 unit
    assumed         : it stands in for light that a file does not have: pictures have it, what measures refuses it
    """

    zenith: Float64
    horizon: Float64
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    assumed: bool = False

    def radiance(self, directions: ArrayLike) -> Float64:
        """(..., 3) W sr^-1 m^-2 seen in unit directions (..., 3)."""
        height = np.clip(np.asarray(directions, np.float64) @ self.up, 0.0, 1.0)[..., None]
        return np.asarray(self.horizon + (self.zenith - self.horizon) * height)

    @property
    def mean_integral(self) -> float:
        """The radiance, mean of the channels, over all directions: W m^-2."""
        return float(2 * np.pi * (self.horizon.mean() + 0.5 * (self.horizon + self.zenith).mean()))

    @property
    def max_radiance(self) -> float:
        """The greatest of any channel."""
        return float(max(self.zenith.max(), self.horizon.max()))

    @property
    def typical_radiance(self) -> float:
        """Of bright surfaces, as `glpath.lights.lighting.max_radiance` wants it."""
        return self.max_radiance

    def directions(self, u: Float64) -> Float64:
        """(N, 3) unit, as dense as the radiance, from u (N, 3), of which the last two are used.

        By the inverse of what lies below an elevation.
        """
        horizon, zenith = float(self.horizon.mean()), float(self.zenith.mean())
        below, above = horizon, 0.5 * (horizon + zenith)
        part = u[:, 1] * (below + above)
        # horizon z + (zenith - horizon) z^2 / 2 = rest, in the form that cancels nothing
        rest = np.maximum(part - below, 0.0)
        root = horizon + np.sqrt(np.maximum(horizon**2 + 2 * (zenith - horizon) * rest, 0.0))
        z = np.where(part < below, part / max(below, 1e-30) - 1, 2 * rest / np.maximum(root, 1e-30))
        z = np.clip(z, -1.0, 1.0)[:, None]
        r, phi = np.sqrt(1 - z * z), 2 * np.pi * u[:, 2:]
        x = perpendicular(self.up)
        y = np.cross(self.up, x)
        return np.asarray(r * np.cos(phi) * x + r * np.sin(phi) * y + z * self.up)


@dataclass(frozen=True, eq=False)
class Environment:
    """An environment map: the radiance of all directions as a picture, filtered bilinearly.

    image    : (h, w, 3) float32 >= 0, equirectangular, linear Rec. 709; row 0 is up, the columns go once around, to
               the right as seen from inside
    up       : (3,) float64, of any length but zero
    rotation : degrees, counter-clockwise seen from above
    scale    : multiplies the image, which is then W sr^-1 m^-2
    assumed  : as of `Sky`
    sun      : a disc besides; neither the rotation nor the scale changes it
    solar    : its watts are of the whole spectrum of the sun: they are not 179 lumens each
    cut      : at the horizon: rows above it and rows below are not blended, of an even number of rows; of a sky and
               a ground that are functions, whose edge a blend would darken by half of a row

    Without a rotation the middle of the picture lies along the axis that follows the one nearest to `up` in the
    order x, y, z, x: with y up along +z, as in Mitsuba, with z up along +x, as in Blender. What three.js, and
    Blender's exports, make of a map with y up, the middle along +x, is a rotation of 90.

    Cost:     16 bytes a texel on the device, 20 here.
    Poor at:  suns much smaller than a texel, whose shadows are as soft as the texel is large: give it a `sun`.

    Raises SceneError for values that are no radiance.
    """

    image: NDArray[np.float32]
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    rotation: float = 0.0
    scale: float = 1.0
    assumed: bool = False
    sun: Sun | None = None
    solar: bool = False
    cut: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", np.ascontiguousarray(self.image, np.float32))
        shape = self.image.shape
        if len(shape) != 3 or shape[2] != 3 or not self.image.size:
            raise SceneError(f"Environment.image: an array of shape {shape}, but must be (h, w, 3).")
        low, high = float(self.image.min()), float(self.image.max())
        if not (low >= 0 and 0 <= self.scale < np.inf and high * self.scale <= _LARGEST):
            raise SceneError(
                f"Environment: values from {low:g} to {high:g} times {self.scale:g}, but radiance must be from 0 "
                f"to {_LARGEST:g}.",
                "Clip the image: np.clip(image, 0, 65504).",
            )
        if not (np.isfinite(self.rotation) and np.isfinite(self.up).all() and np.linalg.norm(self.up) > 0):
            raise SceneError(
                f"Environment: rotation {self.rotation} about up {self.up}, but the one must be a number and the "
                "other a vector of any length but zero."
            )

        if self.cut and shape[0] % 2:
            raise SceneError(
                f"Environment.cut: {shape[0]} rows, of which the horizon would divide one; must be even."
            )

    @cached_property
    def digest(self) -> str:
        """Of all that changes the picture; see `glpath.scene.digest`."""
        # A sky without a sun has the digest that it had before there were suns, and one that is not cut as well.
        sun = () if self.sun is None else (self.sun,)
        return digest_of(self.image, self.up, self.rotation, self.scale, *sun, *(["cut"] if self.cut else []))

    @property
    def rows_above(self) -> int:
        """Rows above the horizon of a map that is cut there; 0 of others."""
        return self.image.shape[0] // 2 if self.cut else 0

    @cached_property
    def frame(self) -> Float64:
        """(3, 3) rows: unit vectors to the middle of the picture, to the left of it, and up."""
        up = self.up / np.linalg.norm(self.up)
        after = np.eye(3)[(int(np.argmax(np.abs(up))) + 1) % 3]
        middle = after - up * (after @ up)
        middle /= np.linalg.norm(middle)
        left = np.cross(up, middle)
        turn = np.radians(self.rotation)
        return np.stack([
            np.cos(turn) * middle + np.sin(turn) * left,
            np.cos(turn) * left - np.sin(turn) * middle,
            up,
        ])  # fmt: skip

    def radiance(self, directions: ArrayLike) -> Float64:
        """(..., 3) W sr^-1 m^-2 seen in unit directions (..., 3). `lights/sky.glsl` is the same for the GPU."""
        wi = np.asarray(directions, np.float64)
        x, y, z = np.moveaxis(wi.reshape(-1, 3) @ self.frame.T, 1, 0)
        height, width = self.image.shape[:2]
        column = (0.5 - np.arctan2(y, x) / (2 * np.pi)) * width - 0.5
        row = np.arctan2(np.hypot(x, y), z) / np.pi * height - 0.5
        left, above = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
        right_share, below_share = (column - left)[:, None], (row - above)[:, None]
        lowest = np.where((z > 0) & self.cut, self.rows_above - 1, height - 1)
        rows = np.clip([above, above + 1], np.where(z > 0, 0, self.rows_above), lowest)
        columns = np.mod([left, left + 1], width)
        upper, lower = (
            self.image[r, columns[0]] * (1 - right_share) + self.image[r, columns[1]] * right_share for r in rows
        )
        seen = (self.scale * (upper * (1 - below_share) + lower * below_share)).reshape(wi.shape)
        return np.asarray(seen if self.sun is None else seen + self.sun.radiance(wi))

    @cached_property
    def integral(self) -> Float64:
        """(3,) W m^-2, the radiance over all directions."""
        rows = self.image.sum(axis=1, dtype=np.float64)
        masses = self._halves.mass.reshape(-1, 2).sum(axis=1)
        of_map = self.scale * (masses @ rows) * (2 * np.pi / self.image.shape[1])
        return np.asarray(of_map if self.sun is None else of_map + self.sun.integral)

    @cached_property
    def sun_share(self) -> float:
        """Of `mean_integral`: so many of `directions` are within the sun."""
        if self.sun is None or not self.mean_integral > 0:
            return 0.0
        return float(self.sun.integral.mean()) / self.mean_integral

    @property
    def mean_integral(self) -> float:
        """The same, mean of the channels."""
        return float(self.integral.mean())

    @cached_property
    def max_radiance(self) -> float:
        """The greatest of any channel."""
        of_map = self.scale * float(self.image.max())
        return of_map if self.sun is None else of_map + float(self.sun.radiance_of_disc.max())

    @property
    def typical_radiance(self) -> float:
        """Of bright surfaces, as `glpath.lights.lighting.max_radiance` wants it.

        That of a white surface which all of the light falls on straight, where it is below that of the map: a small
        sun is far above all that it lights.
        """
        white = float(self.integral.max()) / np.pi
        return max(min(self.max_radiance, white), self.max_radiance / _SUMS_HOLD)

    def directions(self, u: Float64) -> Float64:
        """(N, 3) unit, as dense as the radiance, mean of the channels, from u (N, 3): the first chooses the row.

        The first numbers, `sun_share` of all, are of the sun.
        """
        share = self.sun_share
        if self.sun is None or share == 0:
            return self._directions_of_map(u)
        found = np.empty((len(u), 3))
        of_sun = u[:, 0] < share
        found[of_sun] = self.sun.directions(u[of_sun, 1:])
        rest = u[~of_sun]
        left = np.clip((rest[:, :1] - share) / max(1 - share, 1e-15), 0.0, np.nextafter(1.0, 0.0))
        found[~of_sun] = self._directions_of_map(np.concatenate([left, rest[:, 1:]], axis=1))
        return found

    def _directions_of_map(self, u: Float64) -> Float64:
        height, width = self.image.shape[:2]
        tables = self._tables
        half = tables.order[np.searchsorted(tables.rows[:-1], u[:, 0], side="right") - 1]
        theta = self._halves.angles(half, u[:, 1], np.pi / height)
        column, rest = _chosen(tables.columns, half // 2, u[:, 2])
        tent = np.where(rest < 0.5, np.sqrt(2 * rest) - 1, 1 - np.sqrt(np.maximum(2 - 2 * rest, 0.0)))
        phi = (0.5 - (column + 0.5 + tent) / width) * 2 * np.pi
        local = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
        return np.asarray(local @ self.frame)

    @property
    def split(self) -> float:
        """The first of `directions`' numbers that divides the map into two lights: suns and the rest, or halves."""
        bright = self.sun_share or self._tables.bright
        return bright if 0 < bright < 1 else 0.5

    @property
    def choices(self) -> tuple[Float64, NDArray[np.intp], Float64, Float64]:
        """The tables of `directions` but for the sun, for shaders that do the same.

        Returns (2 h + 1,) the cumulated probability of halves of rows, (2 h,) which halves these are (the upper one
        of row i is 2 i), (2 h,) the integral of each half's tent over the angle, sine included, in rows, and
        (h, w + 1) the cumulated probability of each row's texels.
        """
        tables = self._tables
        return tables.rows, tables.order, self._halves.mass, tables.columns

    @cached_property
    def _halves(self) -> _Halves:
        return _Halves.of(self.image.shape[0], self.cut)

    @cached_property
    def _tables(self) -> _Tables:
        mean = self.image.mean(axis=2, dtype=np.float64)
        columns = np.zeros((mean.shape[0], mean.shape[1] + 1))
        np.cumsum(mean, axis=1, out=columns[:, 1:])
        power = self._halves.mass * np.repeat(columns[:, -1], 2)
        bright = power > _SUN * power.mean()
        order = np.argsort(~bright, kind="stable")
        rows = np.concatenate([[0.0], np.cumsum(power[order])])
        # Rows without light are never chosen, but are divided.
        rows /= max(rows[-1], np.finfo(float).tiny)
        columns /= np.maximum(columns[:, -1:], np.finfo(float).tiny)
        return _Tables(order, rows, columns, float(rows[np.count_nonzero(bright)]))


class _Tables(NamedTuple):
    """Tables to draw directions by.

    order   : (2 h,) numbers of the upper and lower halves of rows: those with a sun first
    rows    : (2 h + 1,) their cumulated probability, in this order
    columns : (h, w + 1) the cumulated probability of each row's texels
    bright  : the probability of the rows with a sun
    """

    order: NDArray[np.intp]
    rows: Float64
    columns: Float64
    bright: float


def _chosen(cdf: Float64, row: NDArray[np.intp], u: Float64) -> tuple[NDArray[np.intp], Float64]:
    """Entries of tables cdf (R, n + 1), each of its row (N,), by u (N,) in [0, 1), and what is left of u."""
    low, high = np.zeros(len(u), np.intp), np.full(len(u), cdf.shape[1] - 1)
    # The last entry whose table value is not above u. By halving, as each number has a row of its own.
    for _ in range(int(cdf.shape[1] - 1).bit_length()):
        middle = (low + high) // 2
        below = cdf[row, middle] <= u
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    start, end = cdf[row, low], cdf[row, low + 1]
    return low, np.clip((u - start) / np.maximum(end - start, np.finfo(float).tiny), 0.0, np.nextafter(1.0, 0.0))


class _Halves(NamedTuple):
    """The upper and lower halves of the tents of h rows, as weights of the angle from up, sine included.

    A tent falls from its row's middle to those of the rows beside it; beyond the first and the last it is flat, and
    at the horizon of a map that is cut there.

    foot : (2 h,) the angle at which the half begins: where it is 0, or, of a flat one, the pole or the horizon
    sign : (2 h,) +1 or -1, in which sense it continues from there
    flat : (2 h,) bool: as far as a pole
    even : (2 h,) bool: flat as far as the horizon
    mass : (2 h,) its integral
    """

    foot: Float64
    sign: Float64
    flat: NDArray[np.bool_]
    even: NDArray[np.bool_]
    mass: Float64

    @classmethod
    def of(cls, height: int, cut: bool = False) -> _Halves:
        step = np.pi / height
        middle = (np.arange(height) + 0.5) * step
        foot = np.stack([middle - step, middle + step], axis=1).ravel()
        sign = np.tile([1.0, -1.0], height)
        flat = np.zeros(2 * height, bool)
        flat[[0, -1]] = True
        foot[0], foot[-1] = 0.0, np.pi
        mass = np.where(flat, 2 * np.sin(step / 4) ** 2, _tent_mass(foot, sign, np.full(2 * height, step)) / step)
        even = np.zeros(2 * height, bool)
        if cut:
            even[[height - 1, height]] = True
            foot[even], sign[[height - 1, height]] = np.pi / 2, [-1.0, 1.0]
            mass[even] = np.sin(step / 2)
        return cls(foot, sign, flat, even, mass)

    def angles(self, half: NDArray[np.intp], u: Float64, step: float) -> Float64:
        """(N,) angles from up in halves (N,), from u (N,) in [0, 1)."""
        foot, sign = self.foot[half], self.sign[half]
        whole = self.mass[half] * step
        # Newton's on the root of the share, which is nearly a straight line.
        wanted = np.sqrt(u)
        w = wanted.copy()
        for _ in range(_STEPS):
            share = np.sqrt(np.maximum(_tent_mass(foot, sign, step * w) / whole, 1e-300))
            slope = step * step * w * np.sin(foot + sign * step * w) / (2 * whole * share)
            w = np.clip(w - (share - wanted) / np.maximum(slope, 1e-300), 0.0, 1.0)
        mass = u * self.mass[half]
        polar, level = np.arccos(np.clip(1 - mass, -1.0, 1.0)), np.arcsin(np.clip(mass, 0.0, 1.0))
        flat = foot + sign * np.where(self.even[half], level, polar)
        return np.asarray(np.where(self.flat[half] | self.even[half], flat, foot + sign * step * w))


def _tent_mass(foot: Float64, sign: Float64, y: Float64) -> Float64:
    """The integral of t sin(foot + sign t) for t from 0 to y; by series where the closed form cancels."""
    y2 = y * y
    small = y < 0.1
    even = np.where(small, y2 * (1 / 2 - y2 * (1 / 8 - y2 / 144)), np.cos(y) + y * np.sin(y) - 1)
    odd = np.where(small, y * y2 * (1 / 3 - y2 * (1 / 30 - y2 / 840)), np.sin(y) - y * np.cos(y))
    return np.asarray(np.sin(foot) * even + sign * np.cos(foot) * odd)
