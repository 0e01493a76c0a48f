"""Skies: a blend from horizon to zenith, or an environment map.

Both classes have the same methods: `radiance` in directions, its integral, and `directions` drawn in proportion to
the radiance.

Source:   Pharr, Jakob & Humphreys 2023, Physically based rendering, 12.5, for light from a map. Here each texel is
          a tent function, and bilinear filtering is the sum of tents. Directions drawn from the tents have exactly
          the density of the filtered map; tables of pbrt and Mitsuba have it only approximately.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.sky.sun import Sun
from glpath.system.arguments import checked_fields
from glpath.system.digest import digest_of
from glpath.system.vectors import LARGEST, perpendicular, vector

Float64 = NDArray[np.float64]

#: Default north, by the index of the coordinate axis nearest to `up`. If y or z is up, east is x, as on a map with
#: x to the right and north at the top.
NORTH = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)

# Maximum ratio of a sky's maximum radiance to its `typical_radiance`. The sums of an image can hold it, because
# they hold nearly 2**24 times the typical radiance (`glpath.gl.sums`).
_SUMS_HOLD = 2.0**20
# Ratio of a half row's power to the mean of all half rows, above which the half row counts as having a sun.
_SUN = 4.0
# Number of Newton steps in `_Halves.angles`. The first guess would be exact if the sine were constant.
_STEPS = 4


@checked_fields
@dataclass(frozen=True)
class Sky:
    """Sky that blends from horizon (and below) to zenith by the sine of the elevation.

    zenith, horizon : (3,) float64 radiance, linear Rec. 709
    up              : (3,) float64 unit
    assumed         : True if it substitutes for light that a file lacks: images use it, and measurements reject it

    Raises SceneError for vectors of another shape, negative radiance, and numbers that are not finite.
    """

    zenith: Float64
    horizon: Float64
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    assumed: bool = False

    def __post_init__(self) -> None:
        for name, low in (("zenith", 0.0), ("horizon", 0.0), ("up", -LARGEST)):
            object.__setattr__(self, name, vector(f"Sky.{name}", getattr(self, name), low))

    def radiance(self, directions: ArrayLike) -> Float64:
        """Return the (..., 3) radiance in W sr^-1 m^-2 in unit directions (..., 3)."""
        height = np.clip(np.asarray(directions, np.float64) @ self.up, 0.0, 1.0)[..., None]
        return np.asarray(self.horizon + (self.zenith - self.horizon) * height)

    @property
    def mean_integral(self) -> float:
        """Integral over all directions of the radiance, mean of the channels, in W m^-2."""
        return float(2 * np.pi * (self.horizon.mean() + 0.5 * (self.horizon + self.zenith).mean()))

    @property
    def max_radiance(self) -> float:
        """Maximum radiance of any channel."""
        return float(max(self.zenith.max(), self.horizon.max()))

    @property
    def typical_radiance(self) -> float:
        """Radiance of bright surfaces, as needed by `glpath.lights.lighting.max_radiance`."""
        return self.max_radiance

    def directions(self, u: Float64) -> Float64:
        """Return (N, 3) unit directions with a density proportional to the radiance.

        They are computed by inverting the integral below an elevation.

        u : (N, 3) numbers in [0, 1), of which the last two are used
        """
        horizon, zenith = float(self.horizon.mean()), float(self.zenith.mean())
        below, above = horizon, 0.5 * (horizon + zenith)
        part = u[:, 1] * (below + above)
        # Solution of horizon z + (zenith - horizon) z^2 / 2 = rest in a form without cancellation.
        rest = np.maximum(part - below, 0.0)
        root = horizon + np.sqrt(np.maximum(horizon**2 + 2 * (zenith - horizon) * rest, 0.0))
        z = np.where(part < below, part / max(below, 1e-30) - 1, 2 * rest / np.maximum(root, 1e-30))
        z = np.clip(z, -1.0, 1.0)[:, None]
        r, phi = np.sqrt(1 - z * z), 2 * np.pi * u[:, 2:]
        x = perpendicular(self.up)
        y = np.cross(self.up, x)
        return np.asarray(r * np.cos(phi) * x + r * np.sin(phi) * y + z * self.up)


@checked_fields
@dataclass(frozen=True, eq=False)
class Environment:
    """Environment map: the radiance of all directions as an image, filtered bilinearly.

    image    : (h, w, 3) float32 >= 0, equirectangular, linear Rec. 709. Row 0 is up; columns go once around, to the
               right as seen from inside
    up       : (3,) float64, any length but zero
    rotation : degrees, counter-clockwise seen from above
    scale    : factor that converts the image to W sr^-1 m^-2
    assumed  : True if it substitutes for missing light, as for `Sky`
    sun      : disc added to the map; rotation and scale do not change it
    solar    : True if its watts are of the whole solar spectrum, so that a watt is not 179 lumens
    cut      : True if rows above and below the horizon are not blended; needs an even number of rows. Meant for
               analytic skies with a ground, whose edge a blend would darken by half a row
    north    : (3,) float64, horizontal direction to the north from which the sun's azimuth counts; None if unknown

    Without a rotation, the centre of the image lies along the axis after the one nearest to `up`, in the order x,
    y, z, x. With y up, that is +z, as in Mitsuba; with z up, +x, as in Blender. three.js, and Blender's exports
    with y up, have the centre along +x, which is a rotation of 90.

    Cost:     16 bytes a texel on the device, 20 in main memory.
    Poor at:  suns much smaller than a texel, whose shadows are as soft as the texel is large: use `sun`.

    Raises SceneError for values that are not valid radiance.
    """

    image: NDArray[np.float32]
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    rotation: float = 0.0
    scale: float = 1.0
    assumed: bool = False
    sun: Sun | None = None
    solar: bool = False
    cut: bool = False
    north: Float64 | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", np.ascontiguousarray(self.image, np.float32))
        object.__setattr__(self, "up", vector("Environment.up", self.up))
        if self.north is not None:
            object.__setattr__(self, "north", vector("Environment.north", self.north))
        shape = self.image.shape
        if len(shape) != 3 or shape[2] != 3 or not self.image.size:
            raise SceneError(f"Environment.image: an array of shape {shape}, but must be (h, w, 3).")
        low, high = float(self.image.min()), float(self.image.max())
        if not (low >= 0 and 0 <= self.scale < np.inf and high * self.scale <= LARGEST):
            raise SceneError(
                f"Environment: values from {low:g} to {high:g} times {self.scale:g}, but radiance must be from 0 "
                f"to {LARGEST:g}.",
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
        """SHA-256 (hex) of everything that changes the image; see `glpath.system.digest`."""
        # `sun` and `cut` count only if they are set, so that older skies keep their digest.
        sun = () if self.sun is None else (self.sun,)
        return digest_of(self.image, self.up, self.rotation, self.scale, *sun, *(["cut"] if self.cut else []))

    @property
    def rows_above(self) -> int:
        """Number of image rows above the horizon if rows are not blended there (`cut`); otherwise 0."""
        return self.image.shape[0] // 2 if self.cut else 0

    @cached_property
    def frame(self) -> Float64:
        """Unit vectors to the centre of the image, to its left, and up, the rows of a matrix (3, 3)."""
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
        """Return the (..., 3) radiance in unit directions (..., 3), W sr^-1 m^-2.

        `lights/sky.glsl` is the GPU version.
        """
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
        """Integral (3,) of the radiance over all directions, W m^-2."""
        rows = self.image.sum(axis=1, dtype=np.float64)
        masses = self._halves.mass.reshape(-1, 2).sum(axis=1)
        of_map = self.scale * (masses @ rows) * (2 * np.pi / self.image.shape[1])
        return np.asarray(of_map if self.sun is None else of_map + self.sun.integral)

    @cached_property
    def sun_share(self) -> float:
        """Fraction of `mean_integral` that the sun's disc emits, and fraction of `directions` inside the disc."""
        if self.sun is None or not self.mean_integral > 0:
            return 0.0
        return float(self.sun.integral.mean()) / self.mean_integral

    @property
    def mean_integral(self) -> float:
        """Integral of the radiance over all directions, mean of the channels, W m^-2."""
        return float(self.integral.mean())

    @cached_property
    def max_radiance(self) -> float:
        """Maximum radiance of any channel."""
        of_map = self.scale * float(self.image.max())
        return of_map if self.sun is None else of_map + float(self.sun.radiance_of_disc.max())

    @property
    def typical_radiance(self) -> float:
        """Radiance of bright surfaces, as needed by `glpath.lights.lighting.max_radiance`.

        It is the radiance of a white surface that receives all light perpendicularly, but at most the sky's maximum
        radiance. A small sun is far brighter than all surfaces that it lights.
        """
        white = float(self.integral.max()) / np.pi
        return max(min(self.max_radiance, white), self.max_radiance / _SUMS_HOLD)

    def directions(self, u: Float64) -> Float64:
        """Return (N, 3) unit directions with a density proportional to the radiance, mean of the channels.

        u : (N, 3) numbers in [0, 1); the first one selects the row, or the sun if it is below `sun_share`
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
        """Value of u[:, 0] of `directions` that divides the sky into two lights.

        Smaller values select suns, larger values the rest of the sky. Without suns it is 0.5.
        """
        bright = self.sun_share or self._tables.bright
        return bright if 0 < bright < 1 else 0.5

    @property
    def choices(self) -> tuple[Float64, NDArray[np.intp], Float64, Float64]:
        """Tables of `directions`, without the sun, for shaders that do the same.

        Returns four tables:
        - (2 h + 1,) cumulative probability of half rows;
        - (2 h,) indices of these half rows: 2 i for the upper half of row i, 2 i + 1 for the lower;
        - (2 h,) integral over the angle, in rows, of each half's tent times the sine of the angle;
        - (h, w + 1) cumulative probability of each row's texels.
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
        # Rows without light are never chosen, but their sum of 0 must not be a divisor.
        rows /= max(rows[-1], np.finfo(float).tiny)
        columns /= np.maximum(columns[:, -1:], np.finfo(float).tiny)
        return _Tables(order, rows, columns, float(rows[np.count_nonzero(bright)]))


class _Tables(NamedTuple):
    """Tables for drawing directions.

    order : (2 h,) indices of half rows, as in `choices`; half rows with a sun come first
    rows    : (2 h + 1,) cumulative probability of the halves in this order
    columns : (h, w + 1) cumulative probability of each row's texels
    bright  : probability of the rows with a sun
    """

    order: NDArray[np.intp]
    rows: Float64
    columns: Float64
    bright: float


def _chosen(cdf: Float64, row: NDArray[np.intp], u: Float64) -> tuple[NDArray[np.intp], Float64]:
    """Return (N,) indices that u (N,) in [0, 1) selects in cumulative tables cdf (R, n + 1), and a new u.

    The new u is the position of u between its entry and the next one, from 0 to 1.

    row : (N,) index of the table for each u
    """
    low, high = np.zeros(len(u), np.intp), np.full(len(u), cdf.shape[1] - 1)
    # Find the last entry not above u, by bisection, because each u has its own table.
    for _ in range(int(cdf.shape[1] - 1).bit_length()):
        middle = (low + high) // 2
        below = cdf[row, middle] <= u
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    start, end = cdf[row, low], cdf[row, low + 1]
    return low, np.clip((u - start) / np.maximum(end - start, np.finfo(float).tiny), 0.0, np.nextafter(1.0, 0.0))


class _Halves(NamedTuple):
    """Upper and lower half of each row's tent weight, each a function of the angle from up times this angle's sine.

    A tent falls linearly from its row's centre to the centres of the adjacent rows. It is flat beyond the first and
    the last row's centre, and at the horizon of a map that is cut there.

    foot : (2 h,) angle at which the half begins: its zero, or for a flat half the pole or the horizon
    sign : (2 h,) +1 or -1, direction in which the half extends from there
    flat : (2 h,) bool: True if it is flat up to a pole
    even : (2 h,) bool: True if it is flat up to the horizon
    mass : (2 h,) its integral over the angle, in rows
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
        """Return (N,) angles from up inside halves (N,), from u (N,) in [0, 1)."""
        foot, sign = self.foot[half], self.sign[half]
        whole = self.mass[half] * step
        # Newton iteration on the square root of the cumulative fraction, which is nearly linear in w.
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
    """Return the integral of t sin(foot + sign t) for t from 0 to y, by series if the closed form cancels."""
    y2 = y * y
    small = y < 0.1
    even = np.where(small, y2 * (1 / 2 - y2 * (1 / 8 - y2 / 144)), np.cos(y) + y * np.sin(y) - 1)
    odd = np.where(small, y * y2 * (1 / 3 - y2 * (1 / 30 - y2 / 840)), np.sin(y) - y * np.cos(y))
    return np.asarray(np.sin(foot) * even + sign * np.cos(foot) * odd)
