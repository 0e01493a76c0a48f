"""Sensors: the points where paths start, as plain data, for a `RenderJob` and for the first stage of an engine.

Two kinds exist: the pixels of a camera, and points with normals, either free or on the texels of a surface.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.scene.camera import CameraKey
from glpath.scene.centre import moved_camera, origin_of
from glpath.scene.choices import Projection
from glpath.scene.model import Camera, Scene
from glpath.system.time_limit import check_time
from glpath.system.vectors import LARGEST

Vector = tuple[float, float, float]
Float32 = NDArray[np.float32]

#: Maximum difference between the length of a normal and 1.
_UNIT = 1e-3
#: Size assumed for a single point, which has no extent, as a fraction of its largest coordinate.
_ALONE = 0.01


@dataclass(frozen=True)
class SensorKey:
    """Pose of a camera at a time; fields as in `glpath.scene.CameraKey`, with tuples instead of arrays."""

    time: float
    position: Vector
    target: Vector
    up: Vector


@dataclass(frozen=True)
class CameraSensor:
    """Pixels of a camera; fields as in `glpath.scene.Camera`, with tuples instead of arrays.

    position, target, up : scene units
    fov                  : vertical field of view of the whole image, degrees
    resolution           : (width, height) of the whole image, pixels
    """

    position: Vector
    target: Vector
    up: Vector
    fov: float
    resolution: tuple[int, int]
    projection: Projection = "perspective"
    height: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    shutter: tuple[float, float] = (0.0, 0.0)
    motion: tuple[SensorKey, ...] = ()
    principal_point: tuple[float, float] = (0.5, 0.5)
    pixel_aspect: float = 1.0

    @classmethod
    def of(cls, camera: Camera) -> CameraSensor:
        """Return the sensor of a camera."""
        width, height = camera.resolution
        focus = camera.focus_distance
        return cls(
            _plain(camera.position),
            _plain(camera.target),
            _plain(camera.up),
            fov=float(camera.fov),
            resolution=(int(width), int(height)),
            projection=camera.projection,
            height=float(camera.height),
            aperture_radius=float(camera.aperture_radius),
            focus_distance=None if focus is None else float(focus),
            shutter=(float(camera.shutter[0]), float(camera.shutter[1])),
            motion=tuple(
                SensorKey(float(k.time), _plain(k.position), _plain(k.target), _plain(k.up)) for k in camera.motion
            ),
            principal_point=(float(camera.principal_point[0]), float(camera.principal_point[1])),
            pixel_aspect=float(camera.pixel_aspect),
        )

    @property
    def camera(self) -> Camera:
        """The equivalent camera."""
        keys = tuple(CameraKey(**vars(key)) for key in self.motion)
        return Camera(**vars(self) | {"motion": keys})

    @property
    def kind(self) -> tuple[object, ...]:
        """Properties that an engine is built for: projection, lens, motion.

        A sensor of equal properties can reuse the engine.
        """
        return (self.projection, self.aperture_radius > 0, self.camera.moves)

    def moved(self, origin: NDArray[np.float64]) -> CameraSensor:
        """Return the sensor in coordinates relative to `origin` (3,), or unchanged if `origin` is zero."""
        return CameraSensor.of(moved_camera(self.camera, origin)) if origin.any() else self

    def seen(self, scene: Scene) -> Scene:
        """Return the scene with this sensor's camera."""
        return scene.with_camera(**vars(self.camera))

    def reduced(self, side: int) -> CameraSensor:
        """Return a sensor of the same view whose longer side has `side` pixels."""
        width, height = self.resolution
        scale = side / max(width, height)
        return replace(self, resolution=(max(1, round(scale * width)), max(1, round(scale * height))))

    def as_json(self) -> dict[str, Any]:
        """Return the fields for JSON, except defaults, so that a pinhole's JSON stays as in earlier versions."""
        changed = {f.name for f in fields(self) if getattr(self, f.name) != f.default}
        return {"type": "camera"} | {name: value for name, value in asdict(self).items() if name in changed}

    def recorded(self) -> dict[str, Any]:
        """Return what a film's settings record of the sensor: nothing, because the scene contains the camera."""
        return {}


@dataclass(frozen=True, eq=False, repr=False)
class PointTables:
    """Points and their normals, in rows and columns like the pixels of a film; row 0 is row 0 of the film.

    positions : (S, H, W, 3) float32, scene units, relative to `origin`; each path set takes one of the S tables
    normals   : (S, H, W, 3) float32, unit: light from the other side does not count
    valid     : (H, W) bool: paths start only at valid points; elsewhere the film is black
    shading   : (S, H, W, 3) float32, unit, or None: shading normals whose cosine weights light, as for a smooth
                surface of flat triangles; `normals` still define the space behind the surface
    origin    : origin of the positions, scene units
    """

    positions: Float32
    normals: Float32
    valid: NDArray[np.bool_]
    shading: Float32 | None = None
    origin: Vector = (0.0, 0.0, 0.0)

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of all fields."""
        h = hashlib.sha256()
        for name in ("positions", "normals", "valid", "shading"):
            array = getattr(self, name)
            if array is not None:
                check_time()
                h.update(f"{name} {array.dtype} {array.shape} ".encode())
                h.update(np.ascontiguousarray(array).data)
        if any(self.origin):
            h.update(f"origin {self.origin} ".encode())
        return h.hexdigest()


@dataclass(frozen=True)
class PointSensor:
    """Points with normals: each is a small white Lambertian receiver, lit from the side of its normal.

    A film of this sensor holds the radiance of these receivers; pi times the radiance is the irradiance. Points may
    lie on surfaces of the scene, which do not shadow themselves, or free in space. The first vertex of a path is
    the point:
    `max_depth` 1 is direct light.

    `PointSensor.of` creates it. A job's JSON has all fields but the points themselves, which their digest
    represents.

    resolution : (width, height) of the rows and columns of points
    sha256     : digest of the points, see `PointTables.digest`
    count      : number of valid points
    middle     : centre of the bounding box of the valid points, scene units
    tables     : number S of tables; each path set takes one, so a texel has the mean light of S points
    smooth     : True if the points have shading normals
    shutter    : opening and closing time, seconds, for moving objects
    independent : True if each point draws its own light samples, with integrators whose paths have their own
                  directions. Errors of points are then independent, so that means over many points are accurate.
                  Otherwise a set's few light samples serve all points, which takes 5 to 25 % less time
    points     : the points; None if they must be supplied
    """

    resolution: tuple[int, int]
    sha256: str
    count: int
    middle: Vector
    tables: int = 1
    smooth: bool = False
    shutter: tuple[float, float] = (0.0, 0.0)
    independent: bool = False
    points: PointTables | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(
        cls,
        positions: ArrayLike,
        normals: ArrayLike,
        valid: ArrayLike | None = None,
        *,
        shading_normals: ArrayLike | None = None,
        shutter: tuple[float, float] = (0.0, 0.0),
        origin: Vector | None = None,
        independent: bool = False,
    ) -> PointSensor:
        """Create a sensor from arrays of points.

        positions       : one table (H, W, 3), or S tables (S, H, W, 3). Each path set uses table int(u * S), where
                          u is the first of its two numbers that position a camera's rays in pixels. So the S
                          points of a texel are sampled evenly, independently of directions
        normals         : (H, W, 3) or (S, H, W, 3), unit
        valid           : (H, W) bool; by default all
        shading_normals : (H, W, 3) or (S, H, W, 3), unit; see `PointTables.shading`
        origin          : origin of the positions, scene units. None: positions are absolute; because they are
                          stored in 32 bits, distant ones are then stored relative to a point with integer
                          coordinates near them

        Invalid points may have any values. Raises UsageError for shapes that do not match, numbers that are not
        finite, normals that are not unit, or no valid point. Raises TimeLimitError.
        """
        if origin is None:
            positions, origin = _near_origin(positions, valid)
        check_time()
        position = _table("positions", positions)
        if 0 in position.shape:
            raise UsageError(f"points: an array of shape {position.shape}, in which there is none.")
        size, (count, height, width) = position.shape[1:3], position.shape[:3]
        inside = np.ones(size, bool) if valid is None else np.asarray(valid, bool)
        if inside.shape != size:
            raise UsageError(f"points: valid has shape {inside.shape}, where {size} is needed, that of the points.")
        if not inside.any():
            raise UsageError(f"points: none of {width} x {height} is valid.")
        directions = [_directions("normals", normals, position, inside)]
        if shading_normals is not None:
            directions.append(_directions("shading_normals", shading_normals, position, inside))
        check_time()
        # One table at a time, because there may be many tables.
        edges = np.array([(some.min(axis=0), some.max(axis=0)) for some in (table[inside] for table in position)])
        if not np.isfinite(edges).all():
            raise UsageError("points: a position is not finite.")
        check_time()
        low, high = edges[:, 0].min(axis=0).astype(np.float64), edges[:, 1].max(axis=0).astype(np.float64)
        position = np.where(inside[..., None], position, np.float32(0.0))
        x, y, z = map(float, origin)
        shading = directions[1] if len(directions) > 1 else None
        points = PointTables(position, directions[0], inside, shading, (x, y, z))
        return cls(
            resolution=(width, height),
            sha256=points.digest,
            count=int(inside.sum()),
            middle=_plain(0.5 * (low + high) + points.origin),
            tables=count,
            smooth=shading_normals is not None,
            shutter=(float(shutter[0]), float(shutter[1])),
            independent=independent,
            points=points,
        )

    @property
    def kind(self) -> tuple[object, ...]:
        """Properties that an engine is built for: more than one table, shading normals, independent points."""
        return ("points", self.tables > 1, self.smooth, self.independent)

    def moved(self, origin: NDArray[np.float64]) -> PointSensor:
        """Return the sensor relative to `origin` (3,), or unchanged if `origin` is zero. Keeps `sha256`."""
        if not origin.any():
            return self
        points = self.points
        if points is not None:
            points = replace(points, origin=_plain(np.array(points.origin) - origin))
        return replace(self, middle=_plain(np.array(self.middle) - origin), points=points)

    def reduced(self, side: int) -> PointSensor:
        """Return a sensor of side * side / 2 points, chosen evenly from the valid points; points may repeat.

        side : a multiple of 16. Neighbours lie in the same of 8 x 8 blocks, which `glpath.film.bias` compares.
        """
        points = self.given(None).points
        assert points is not None, "`given` has checked it"
        valid = np.flatnonzero(points.valid)
        count = side * side // 2
        blocks = valid[np.arange(count) * len(valid) // count].reshape(8, 8, side // 16, side // 8)
        chosen = blocks.transpose(0, 2, 1, 3).reshape(side // 2, side)

        def some(table: Float32) -> Float32:
            return np.ascontiguousarray(table.reshape(len(table), -1, 3)[:, chosen])

        few = PointTables(
            some(points.positions),
            some(points.normals),
            np.ones(chosen.shape, bool),
            None if points.shading is None else some(points.shading),
            points.origin,
        )
        return replace(self, resolution=(side, side // 2), sha256=few.digest, count=count, points=few)

    def seen(self, scene: Scene) -> Scene:
        """Return the scene with its camera replaced by one amid the points, which rendering does not use.

        Raises UsageError if the points must be supplied.
        """
        self.given(None)
        x, y, z = self.middle
        camera = Camera(
            np.array([x, y, z]),
            np.array([x + 1.0 + abs(x) if x < 0.4 * LARGEST else 0.0, y, z]),  # never beyond LARGEST
            np.array([0.0, 0.0, 1.0]),
            fov=90.0,
            resolution=self.resolution,
            shutter=self.shutter,
        )
        return replace(scene, camera=camera)

    def as_json(self) -> dict[str, Any]:
        """Return the fields for JSON, without the arrays of points."""
        return {"type": "points"} | {f.name: getattr(self, f.name) for f in fields(self) if f.name != "points"}

    def recorded(self) -> dict[str, Any]:
        """Return what a film's settings record of the sensor: films merge only if the points are the same."""
        return {"points": self.sha256}

    def given(self, points: PointTables | None) -> PointSensor:
        """Return the sensor with `points`; None: its own. Raises UsageError for other points, or if it has none."""
        points = self.points if points is None else points
        if points is None:
            raise UsageError(
                f"job: of {self.count} points, which a job does not hold.", "Hand them in: run(job, sensor=sensor)."
            )
        if points is not self.points and points.digest != self.sha256:
            raise UsageError(
                f"job: made for points of SHA-256 {self.sha256}, not for those of {points.digest}.",
                "Hand in the points that the job was made for.",
            )
        return replace(self, points=points)


Sensor = CameraSensor | PointSensor


def _table(name: str, given: ArrayLike) -> Float32:
    """Return `given` as float32 (S, H, W, 3); (H, W, 3) gets S = 1. Raises UsageError for any other shape."""
    try:
        array = np.asarray(given, np.float32)
    except (TypeError, ValueError):
        array = np.empty(0, np.float32)
    if array.ndim not in (3, 4) or array.shape[-1] != 3:
        raise UsageError(f"points: {name} of shape {np.shape(given)} where (H, W, 3) or (S, H, W, 3) is needed")
    return array if array.ndim == 4 else array[None]


def _near_origin(positions: ArrayLike, valid: ArrayLike | None) -> tuple[ArrayLike, Vector]:
    """Return positions relative to an origin near them, and this origin.

    Positions near zero, and invalid input, are returned unchanged, with a zero origin.
    """
    array = np.asarray(positions)
    if array.dtype != np.float64 or array.ndim not in (3, 4) or array.shape[-1] != 3 or 0 in array.shape:
        return positions, (0.0, 0.0, 0.0)
    inside = np.ones(array.shape[-3:-1], bool) if valid is None else np.asarray(valid, bool)
    if inside.shape != array.shape[-3:-1] or not inside.any():
        return positions, (0.0, 0.0, 0.0)
    among = array[..., inside, :].reshape(-1, 3)
    low, high = among.min(axis=0), among.max(axis=0)
    if not np.isfinite(low + high).all():
        return positions, (0.0, 0.0, 0.0)
    # A single point has no extent, so an extent is assumed, because `origin_of` compares distance with extent.
    size = 0.0 if np.any(high > low) else _ALONE * float(np.abs(low).max())
    origin = origin_of(low - size, high + size)
    return (array - origin if origin.any() else positions), _plain(origin)


def _directions(name: str, given: ArrayLike, positions: Float32, valid: NDArray[np.bool_]) -> Float32:
    """Return unit vectors in the shape of the positions; 0 at invalid points. Raises UsageError."""
    array = _table(name, given)
    if array.shape[1:] != positions.shape[1:] or array.shape[0] not in (1, positions.shape[0]):
        raise UsageError(f"points: {name} of shape {array.shape} do not go with positions of {positions.shape}.")
    unit = np.empty(array.shape, np.float32)
    for found, table in zip(unit, array, strict=True):  # one table at a time, because there may be many
        check_time()
        length = np.linalg.norm(table.astype(np.float64), axis=-1)
        # Do not test for any length that differs by more: a NaN would pass that test.
        if not (np.abs(length - 1.0) <= _UNIT)[valid].all():
            raise UsageError(
                f"points: {name} hold one that is not unit.", "Divide each by its length, which must not be zero."
            )
        found[:] = np.where(valid[..., None], table / np.where(length > 0, length, 1.0)[..., None], 0.0)
    return np.broadcast_to(unit, positions.shape)


def _plain(vector: Any) -> Vector:
    x, y, z = map(float, vector)
    return x, y, z
