"""Irradiance at points, like the reading of a luxmeter, traced with the same paths as images.

Cost:     one path for each point and path set, as for a pixel.
Poor at:  caustics of mirrors and glass, and lamps seen through small openings, as for images.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError, UsageError, argument, warn
from glpath.film.film import Film
from glpath.film.noise import standard_error
from glpath.integrators.by_name import AUTO, Integrator
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside, uniform_sky
from glpath.io.values import LARGEST
from glpath.io.vtk import VtkMesh, points_with_values
from glpath.rendering.calls import run_job
from glpath.rendering.choice import for_measuring
from glpath.rendering.job import describe
from glpath.rendering.options import RenderKeywords, colour, with_options
from glpath.rendering.run_options import RunOptions
from glpath.rendering.uniformity import Spread, spread_of
from glpath.scene import Environment, Scene
from glpath.scene.maintenance import maintained
from glpath.sensors.sensor import PointSensor
from glpath.system.arguments import check_word, checked, real_array
from glpath.system.colour import luminance
from glpath.system.frames import data_frame, data_set
from glpath.system.time_limit import check_time, preparing
from glpath.system.units import Unit, conversion
from glpath.system.vectors import unit_normals

Float64 = NDArray[np.float64]

Receiver = Literal["plane", "cylinder"]

#: Number of directions around a cylinder. With 32, the mean over them has an error of at most 0.2 % for one lamp:
#: harmonic 32 of a clamped cosine is 2 / (32^2 - 1). The number is a power of two, so path sets use each direction
#: equally often.
_AROUND = 32
# Minimum time in seconds to prepare one direction of one point, for a time limit; 3.2e-7 were measured.
_SECONDS_PER_DIRECTION = 2.5e-7
# Maximum number of axes of a grid of points.
_MAX_AXES = 9


@checked
@dataclass(frozen=True, eq=False)
class Irradiance:
    """Irradiance at points.

    film  : film of the points' white receivers, in rows; irradiance is pi times its radiance. It can be saved,
            merged and resumed
    count : number of points; the rest of the film's last row repeats the last point
    """

    film: Film
    count: int

    @property
    def values(self) -> Float64:
        """Irradiance (N, 3) float64, linear Rec. 709, in the scene's unit: W m^-2, or lx if it is photometric."""
        return self._of_points(self.film.mean)

    @property
    def unit(self) -> Unit:
        """Unit of `values` and their errors: "radiometric" or "photometric", as in the scene."""
        return self.film.metadata.unit or "radiometric"

    @property
    def standard_errors(self) -> Float64:
        """Standard errors (N, 3) float64 of `values`, from the spread of independent batches of path sets.

        NaN below 16 path sets, which make only one batch. With eight batches, the estimated error is itself
        uncertain by about a quarter.
        """
        return self._of_points(standard_error(self.film.radiance_sums, self.film.batch_counts))

    def illuminance(self) -> Float64:
        """Return (N,) float64 illuminance in lux: luminance (0.2126, 0.7152, 0.0722) at 179 lumens per watt."""
        return conversion(self.unit, "photometric") * luminance(self.values)

    def illuminance_errors(self) -> Float64:
        """Return (N,) float64 standard errors of `illuminance` in lux."""
        of_light = standard_error(luminance(self.film.radiance_sums)[..., None], self.film.batch_counts)
        return conversion(self.unit, "photometric") * self._of_points(of_light)[:, 0]

    def spread(self, which: NDArray[np.bool_] | None = None) -> Spread:
        """Return mean, minimum, maximum and uniformities of `illuminance` in lux, each with its standard error.

        which : (N,) bool, True for points to use, at least one; None: all points

        `min(illuminance())` is too low, because noise affects the choice of the point.
        `glpath.rendering.uniformity` describes the estimate used instead, and its errors.
        """
        lux = luminance(self.film.radiance_sums).reshape(len(self.film.radiance_sums), -1)[:, : self.count]
        mask = np.ones(self.count, np.bool_) if which is None else np.asarray(which)
        if mask.shape != (self.count,) or mask.dtype != np.bool_:
            raise UsageError(
                f"spread: which of shape {mask.shape} and type {mask.dtype}, where ({self.count},) bool are needed"
            )
        chosen = lux if which is None else lux[:, mask]
        if not chosen.shape[1]:
            raise UsageError("spread: of no points at all.", "Give `which` one True at least.")
        return spread_of(conversion(self.unit, "photometric") * np.pi * chosen, self.film.batch_counts)

    def to_pandas(self, points: ArrayLike | None = None) -> Any:
        """Return a `pandas.DataFrame` with a row per point: red, green, blue and lux, each with its standard error.

        points : (N, 3) measured points, for columns x, y, z

        `DataFrame.attrs` has the unit and the path sets. Raises GlpathError if pandas is missing.
        """
        columns = {} if points is None else dict(zip("xyz", self._checked(points).T, strict=True))
        return data_frame(columns | self._columns(), "point", None, self._attributes())

    def to_xarray(self, points: ArrayLike | None = None, shape: tuple[int, ...] | None = None) -> Any:
        """Return an `xarray.Dataset` of `irradiance` (..., channel) and `illuminance` with their errors.

        points : (N, 3) measured points, for coordinates x, y, z
        shape  : shape of the grid of points, such as (rows, columns); None: (N,)

        Raises GlpathError if xarray is missing, UsageError for a shape of another number of points.
        """
        size: tuple[Any, ...] = (self.count,) if shape is None else tuple(shape)
        if not all(isinstance(each, int | np.integer) and each > 0 for each in size) or len(size) > _MAX_AXES:
            raise UsageError(
                f"to_xarray: a shape of {size} where 1 to {_MAX_AXES} whole numbers from 1 are needed",
                "For a grid of points, that is (rows, columns).",
            )
        if math.prod(size) != self.count:
            raise UsageError(f"to_xarray: a grid of {size} has {math.prod(size):,} points, not {self.count:,}.")
        at = (
            ("point",)
            if shape is None
            else ("row", "column", *(f"axis{i}" for i in range(2, _MAX_AXES)))[: len(size)]
        )
        coordinates: dict[str, Any] = {"channel": ["red", "green", "blue"]}
        if points is not None:
            columns = self._checked(points).T
            coordinates |= {name: (at, each.reshape(size)) for name, each in zip("xyz", columns, strict=True)}
        variables: dict[str, Any] = {
            "irradiance": ((*at, "channel"), self.values.reshape(*size, 3)),
            "irradiance_error": ((*at, "channel"), self.standard_errors.reshape(*size, 3)),
            "illuminance": (at, self.illuminance().reshape(size)),
            "illuminance_error": (at, self.illuminance_errors().reshape(size)),
        }
        return data_set(variables, coordinates, self._attributes())

    def to_vtk(self, points: ArrayLike, faces: Sequence[Sequence[int]] | None = None) -> VtkMesh:
        """Return the points with their values for ParaView and PyVista: `.save("desk.vtp")`, `.to_pyvista()`.

        points : (N, 3) that were measured
        faces  : indices of points that form polygons, such as the squares of a grid; None: points only
        """
        positions, data = self._checked(points), {"irradiance": self.values, **self._columns()}
        return points_with_values(positions, data) if faces is None else VtkMesh(positions, faces, point_data=data)

    def _columns(self) -> dict[str, Float64]:
        columns = dict(zip(("red", "green", "blue"), self.values.T, strict=True))
        errors = zip(("red_error", "green_error", "blue_error"), self.standard_errors.T, strict=True)
        columns |= {**dict(errors), "illuminance": self.illuminance()}
        return columns | {"illuminance_error": self.illuminance_errors()}

    def _attributes(self) -> dict[str, Any]:
        return {"unit": self.unit, "path_sets": self.film.path_sets}

    def _checked(self, points: ArrayLike) -> Float64:
        positions: Float64 = real_array(
            "points", points, f"({self.count}, 3), the number of measured points,", (self.count, 3).__eq__
        )
        return positions

    def _of_points(self, radiance: Float64) -> Float64:
        return np.pi * radiance.reshape(-1, radiance.shape[-1])[: self.count]


@with_options()
def irradiance(
    scene: AnyScene,
    points: ArrayLike,
    normals: ArrayLike,
    *,
    receiver: Receiver = "plane",
    integrator: Integrator | IntegratorSettings = AUTO,
    spp: int | None = None,
    first_path_set: int = 0,
    white_sky: bool = False,
    maintenance_factor: float | None = None,
    parameters: Mapping[str, object] | None = None,
    **options: Unpack[RenderKeywords],
) -> Irradiance:
    """Return the irradiance at points of a scene, on the side of their normals, with its standard error.

    Parameters
    ----------
    scene      : any source that `load_scene` accepts. It needs no camera; only the shutter times of its camera are
                 used. It needs light, because the studio light added to images of unlit models is not measured
    points     : (N, 3), scene units, free in space or on surfaces, which do not shadow their own points
    normals    : (N, 3), or (3,) for all, of any nonzero length; light from the hemisphere around the normal counts
    receiver   : "plane", or "cylinder" for a small cylinder with the normal as its axis, which measures the mean
                 irradiance over all directions across the axis. In lux that is cylindrical illuminance, which EN
                 12464-1 requires for the visibility of faces. It takes 768 bytes per point, and its error is at
                 most 0.2 % with a multiple of 32 paths
    integrator : "auto", "path", "path-buffer" or "gather". "auto" is the unbiased "path", or "path-buffer" for
                 streamed triangles, unless an option requires another integrator
    white_sky  : True to light a scene without light by a white sky of radiance 1 in all directions
    maintenance_factor : fraction of the lamps' light that is left after years, above 0, up to 1. It does not apply
                 to lamps with their own factor in the scene file, to skies, or to directional lights
    spp        : paths per point; default {default_spp}; unlimited with `time_limit` or `noise`
    noise      : end when the relative error over all points is below this with 95 % confidence, as in `render`. The
                 error is that of white surfaces' radiance; less than 0.3 W m^-2 counts as 0.3
    film       : `Irradiance.film` of an earlier, equal call, to resume from
    The other parameters are those of `render`.
    {options}

    By default, "path" and "path-buffer" have light of all bounces: with a `max_depth` of 1000, only Russian
    roulette ends paths. (1 is direct light from lamps and the sky.)

    Raises and warns as `render` does. Raises SceneError for a scene without light, UsageError for `white_sky` with
    light.

    Example
    -------
    >>> found = irradiance("cornell-box", [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0], spp=64)
    >>> found.values.shape, found.standard_errors.shape, found.illuminance().shape
    ((1, 3), (1, 3), (1,))
    """
    run_options, chosen = RunOptions.taken_from(options)
    check_word("receiver", receiver, get_args(Receiver))
    with preparing("the points"):
        positions, facing = checked_points(points, normals)
        if receiver == "cylinder":
            facing = _around(facing)
    with aside("camera", "light"):
        loaded = load_scene(scene, parameters)
    loaded = maintained(lit(loaded, white_sky, ambient=chosen.get("ambient")), maintenance_factor)
    with preparing("the points"):
        sensor = _in_rows(positions, facing, loaded)
    job, loaded = describe(
        loaded,
        integrator=for_measuring(chosen, loaded) if integrator == AUTO else integrator,
        spp=run_options.spp(spp),
        first_path_set=first_path_set,
        sensor=sensor,
        **chosen,
    )
    return Irradiance(run_job(job, loaded, run_options), len(positions))


def lit(scene: Scene, by_white_sky: bool, ambient: float | Sequence[float] | None = None) -> Scene:
    """Return the scene with the light to measure: its own light, or a white sky.

    ambient : ambient radiance that replaces the scene's

    Raises SceneError for a scene without light, and UsageError for a white sky in a scene with light. Warns
    SceneWarning if the studio sky of images is left out because surfaces emit.
    """
    source = scene.source or scene.name
    assumed = scene.sky is not None and scene.sky.assumed
    own = replace(scene, sky=None, background=None) if assumed else scene
    glows = any(shape.emits and not scene.materials[shape.material].unlit for shape in scene.shapes)
    sky = own.sky is not None and own.sky.mean_integral > 0
    has_light = glows or sky or any(np.any(light.intensity > 0) for light in own.lights)
    if by_white_sky:
        if has_light and not assumed:
            raise UsageError(
                f"{argument('white_sky', True)}: {source} has light of its own.",
                "Leave it out, or write a sky in its file.",
            )
        return replace(scene, sky=uniform_sky(), background=None)
    if isinstance(own.sky, Environment) and own.sky.solar:
        warn(
            f"{source}: the watts of its sky are of the whole spectrum of the sun: irradiance is right, and "
            "illuminance is not, which counts 179 lumens a watt."
        )
    if assumed and glows:
        text = f"{source}: what glows in it is its only light: measured without the studio that pictures have."
        warn(text)
    radiance = scene.ambient if ambient is None else colour("ambient", ambient)
    if not has_light and not np.any(np.asarray(radiance) > 0):
        raise SceneError(
            f"{source}: has no light to measure: no lamp, no surface that emits, no sky.",
            "Give it one: [[lights]], an emission or a [sky] in a TOML file, punctual lights in glTF.\n"
            f"A white sky of radiance 1 from all around is {argument('white_sky', True)}.",
        )
    return own


def checked_points(points: ArrayLike, normals: ArrayLike) -> tuple[Float64, Float64]:
    """Return points and unit normals (N, 3). Raises UsageError with the first invalid point."""
    positions: Float64 = real_array(
        "points", points, "(N, 3), N > 0,", lambda shape: len(shape) == 2 and shape[0] > 0 and shape[1] == 3
    )
    shapes = {positions.shape, (3,)}
    given = real_array("normals", normals, f"{positions.shape} or (3,)", shapes.__contains__)
    given = np.broadcast_to(given, positions.shape)
    check_time()
    facing = unit_normals(given)
    check_time()
    for what, found, wrong, allowed in (
        (
            "points",
            positions,
            ~(np.abs(positions) <= LARGEST).all(axis=1),
            f"finite numbers from {-LARGEST:g} to {LARGEST:g} are",
        ),
        ("normals", given, ~(np.abs(facing).max(axis=1) > 0), "a finite vector other than zero is"),
    ):
        if wrong.any():
            first = int(np.flatnonzero(wrong)[0])
            raise UsageError(f"{what}[{first}]: {found[first].tolist()} where {allowed} needed")
    return positions, facing


def _around(axes: Float64) -> Float64:
    """Return (S, N, 3): S unit directions perpendicular to each unit axis (N, 3), evenly spaced around the axis.

    Raises TimeLimitError.
    """
    check_time(estimate=_SECONDS_PER_DIRECTION * _AROUND * len(axes))
    beside = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)])
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    across = np.cross(axes, beside)
    found = np.empty((_AROUND, *axes.shape))
    for direction, angle in zip(found, 2 * np.pi * (np.arange(_AROUND) + 0.5) / _AROUND, strict=True):
        check_time()
        direction[:] = np.cos(angle) * beside + np.sin(angle) * across
    return found


def _in_rows(positions: Float64, facing: Float64, scene: Scene) -> PointSensor:
    """Return the sensor of points (N, 3) as a nearly square grid; the last point fills the rest of the last row.

    facing : (N, 3) normals, or (S, N, 3), one of which each path set uses
    """
    origin = scene.centred.origin - scene.origin
    positions = positions - origin
    width = math.isqrt(len(positions) - 1) + 1
    height = -(-len(positions) // width)
    more = ((0, 0), (0, width * height - len(positions)), (0, 0))
    facing = facing.reshape(-1, *positions.shape)
    positions = np.broadcast_to(positions, facing.shape)
    rows = []
    for each in (positions, facing):
        check_time()
        rows.append(np.pad(each, more, mode="edge").reshape(-1, height, width, 3))
    check_time()
    x, y, z = origin.tolist()
    return PointSensor.of(*rows, shutter=scene.camera.shutter, independent=True, origin=(x, y, z))
