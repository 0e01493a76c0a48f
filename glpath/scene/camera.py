"""Camera and projection: a pinhole, a thin lens, parallel rays, or a panorama. No other module projects.

Image positions are in pixels from the upper left corner, x to the right and y down. The centre of the first pixel
is (0.5, 0.5). Row 0 of an image is at the top.

A camera has a shutter, and keyframes (`CameraKey`) if it moves. An image is the mean over the time that the shutter
is open, because each accumulated path set is rendered at another time [PB 3.3; Haeberli & Akeley 1990].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glpath.errors import UsageError
from glpath.scene.choices import Projection
from glpath.scene.geometry import Float64
from glpath.system.arguments import check_count, checked, checked_fields, real_array, short_repr
from glpath.system.pyrr_matrices import matrix33

# Azimuths of the eye in `framing`, degrees from the front towards the right: for a box as wide as deep, and for a
# box much deeper than wide.
_AZIMUTH = (20.0, 75.0)
# Elevations of the eye in `framing`, degrees: for a box as high as wide, and for a flat box.
_ELEVATION = (18.0, 40.0)
# Ratio of width to depth below which the azimuth increases.
_DEEP = 0.8
# Ratio of height to horizontal extent below which the elevation increases.
_FLAT = 0.3
# Field of view of `framing`, degrees.
_FOV = 30.0
# Size of the image relative to the extent of the visible points in it.
_MARGIN = 1.15
# Minimum distance of the eye from the nearest of these points, in diagonals of the box around them.
_CLOSEST = 0.1
# Maximum number of frames of a turntable.
_MAX_FRAMES = 100_000


@checked_fields
@dataclass(frozen=True)
class CameraKey:
    """Pose of a camera at one time.

    time                 : seconds
    position, target, up : (3,) float64, as for `Camera`
    """

    time: float
    position: Float64
    target: Float64
    up: Float64

    def __post_init__(self) -> None:
        _hold_arrays(self)


@checked_fields
@dataclass(frozen=True)
class Camera:
    """Camera with its projection, lens, shutter and motion.

    Fields accept lists instead of arrays and tuples, so that a camera can be written by hand or read from JSON.
    Raises UsageError for fields of a wrong type or shape. `Scene` checks the numbers by `check_camera`.

    position, target, up : (3,) float64, scene units; `up` need not be perpendicular to the view
    fov                  : vertical field of view of the whole image in degrees, 0 < fov < 180, for "perspective"
    resolution           : (width, height) in pixels
    projection           : "perspective"; "orthographic", with parallel rays that start in the plane through
                           `position`; or "panorama", equirectangular: 360 degrees from left to right, 180 from top
                           to bottom, `target` in the middle
    height               : height of the whole image in scene units, for "orthographic"
    aperture_radius      : radius of a thin lens in scene units; 0 is a pinhole. Only for "perspective"
    focus_distance       : distance along the view to the plane in focus, scene units; None: distance to the target
    shutter              : opening and closing time in seconds; equal for a single moment
    motion               : keys that replace position, target and up. The pose is linear between keys, and constant
                           before the first and after the last. () if the camera does not move
    principal_point      : point of the image on the view axis, in image widths and heights from the upper left
                           corner. (0.5, 0.5) is the centre; a shifted lens has other values. Not for a panorama
    pixel_aspect         : width of a pixel divided by its height. Not for a panorama
    """

    position: Float64
    target: Float64
    up: Float64
    fov: float
    resolution: tuple[int, int]
    projection: Projection = "perspective"
    height: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    shutter: tuple[float, float] = (0.0, 0.0)
    motion: tuple[CameraKey, ...] = ()
    principal_point: tuple[float, float] = (0.5, 0.5)
    pixel_aspect: float = 1.0

    def __post_init__(self) -> None:
        _hold_arrays(self)
        if not isinstance(self.motion, list | tuple) or not all(isinstance(key, CameraKey) for key in self.motion):
            raise UsageError(f"motion: {short_repr(self.motion)} where a tuple of CameraKey is needed")
        object.__setattr__(self, "motion", tuple(self.motion))
        for name in ("resolution", "shutter", "principal_point"):
            object.__setattr__(self, name, tuple(map(_plain_number, getattr(self, name))))
        object.__setattr__(self, "resolution", tuple(int(n) if n % 1 == 0 else n for n in self.resolution))

    def frame(self) -> tuple[Float64, Float64, Float64]:
        """Return the unit vectors (right, up, forward), each (3,) float64. Row 0 of an image is towards `up`."""
        return self._frame

    @cached_property
    def _frame(self) -> tuple[Float64, Float64, Float64]:
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    @checked
    def turned(self, degrees: float) -> Camera:
        """Return the camera rotated about the axis `up` through its target, counter-clockwise seen from above.

        The result does not move; it starts from the pose at which the shutter opens.
        """
        if not np.isfinite(degrees):
            raise UsageError(f"degrees: {short_repr(degrees)} where a finite number is needed")
        camera = without_motion(self)
        arm = camera.position - camera.target
        rotation = matrix33.create_from_axis_rotation(np.asarray(camera.up, np.float64), np.radians(degrees))
        return replace(camera, position=camera.target + arm @ rotation)

    @checked
    def turntable(self, frames: int) -> list[Camera]:
        """Return `frames` cameras, at most 100,000, at equal angles around the target."""
        check_count("frames", frames, 0, _MAX_FRAMES)
        return [self.turned(360.0 * i / frames) for i in range(frames)]

    @property
    def moves(self) -> bool:
        """True if the camera moves while the shutter is open."""
        opened, closed = self.shutter
        return (
            len(self.motion) > 1
            and opened < self.motion[-1].time
            and closed > self.motion[0].time
            and opened < closed
        )

    @checked
    def at(self, time: float | None = None) -> Camera:
        """Return a camera without motion, with the pose at `time` and a shutter that opens and closes at `time`.

        time : seconds; None: the time at which the shutter opens
        """
        moment = self.shutter[0] if time is None else float(time)
        if not self.motion:
            return replace(self, shutter=(moment, moment))
        times = [key.time for key in self.motion]

        def held(name: str) -> Float64:
            values = np.array([getattr(key, name) for key in self.motion])
            return np.array([np.interp(moment, times, values[:, axis]) for axis in range(3)])

        return replace(
            self,
            position=held("position"),
            target=held("target"),
            up=held("up"),
            shutter=(moment, moment),
            motion=(),
        )

    @property
    def focal(self) -> float:
        """Focal length: height in pixels of one scene unit at distance 1, or at any distance for parallel rays."""
        if self.projection == "orthographic":
            return float(self.resolution[1] / self.height)
        return float(self.resolution[1] / (2.0 * np.tan(np.radians(self.fov) / 2.0)))

    @property
    def focal_lengths(self) -> tuple[float, float]:
        """Focal lengths in pixels along x and y: fx and fy of an intrinsic matrix."""
        return self.focal / self.pixel_aspect, self.focal

    @property
    def centre(self) -> tuple[float, float]:
        """Image position of the view axis in pixels: cx and cy of an intrinsic matrix."""
        (width, height), (across, down) = self.resolution, self.principal_point
        return width * across, height * down

    @property
    def focus(self) -> float:
        """Distance along the view to the plane in focus, scene units."""
        if self.focus_distance is not None:
            return float(self.focus_distance)
        return float(np.linalg.norm(self.target - self.position))

    @property
    def extent(self) -> tuple[float, float]:
        """Half width and half height of the image plane at distance 1, or of the whole image for parallel rays."""
        (width, height), (fx, fy) = self.resolution, self.focal_lengths
        return 0.5 * width / fx, 0.5 * height / fy

    @property
    def offset(self) -> tuple[float, float]:
        """Offset of the image centre from the view axis, to the right and up, in the units of `extent`."""
        (wide, high), (across, down) = self.extent, self.principal_point
        return wide * (1.0 - 2.0 * across), high * (2.0 * down - 1.0)

    def pixel_centres(self) -> Float64:
        """Return (H, W, 2) float64 image positions of the pixel centres."""
        width, height = self.resolution
        return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)

    @checked
    def rays(self, at: ArrayLike | None = None) -> Float64:
        """Return (..., 3) float64 unit directions of rays through image positions; they start at `origins`.

        The rays of a thin lens start at its centre.

        at : (..., 2) positions, inside or outside the image; None: the centres of all pixels, (H, W, 2)
        """
        x, y = self._from_middle(at)
        right, up, forward = (axis for axis in self.frame())
        if self.projection == "orthographic":
            return np.broadcast_to(forward, (*x.shape, 3)).copy()
        if self.projection == "panorama":
            width, height = self.resolution
            longitude, latitude = 2.0 * np.pi / width * x[..., None], np.pi / height * y[..., None]
            level = np.cos(longitude) * forward + np.sin(longitude) * right
            return np.asarray(np.cos(latitude) * level + np.sin(latitude) * up)
        fx, fy = self.focal_lengths
        across, above = x / fx, y / fy
        directions = forward + across[..., None] * right + above[..., None] * up
        return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))

    @checked
    def origins(self, at: ArrayLike | None = None) -> Float64:
        """Return (..., 3) float64 origins of `rays`.

        They are the camera's position, or points of the plane through it for parallel rays.
        """
        x, y = self._from_middle(at)
        if self.projection != "orthographic":
            return np.broadcast_to(np.asarray(self.position, np.float64), (*x.shape, 3)).copy()
        (right, up, _), (fx, fy) = self.frame(), self.focal_lengths
        return np.asarray(self.position + (x / fx)[..., None] * right + (y / fy)[..., None] * up)

    @checked
    def project(self, points: ArrayLike) -> tuple[Float64, Float64]:
        """Return the image positions (..., 2) of points (..., 3), and their depths (...) along the view direction.

        An image position has no meaning if its depth is 0 or below, because the point is behind the eye. For a
        panorama no point is behind the eye, and the depth is the distance.
        """
        right, up, forward = self.frame()
        seen = _vectors("points", points, 3) - self.position
        across, above, depth = seen @ right, seen @ up, seen @ forward
        (width, height), (fx, fy), (middle_x, middle_y) = self.resolution, self.focal_lengths, self.centre
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.projection == "panorama":
                longitude, latitude = np.arctan2(across, depth), np.arctan2(above, np.hypot(across, depth))
                x, y = width / (2 * np.pi) * longitude, height / np.pi * latitude
                depth = np.linalg.norm(seen, axis=-1)
            elif self.projection == "orthographic":
                x, y = fx * across, fy * above
            else:
                x, y = fx * across / depth, fy * above / depth
        return np.stack([middle_x + x, middle_y - y], axis=-1), depth

    def corner_rays(self) -> Float64:
        """Return (4, 3) float64 directions, not unit, through the corners of a perspective image, in ring order."""
        (right, up, forward), (wide, high), (across, above) = self.frame(), self.extent, self.offset
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([forward + (across + a * wide) * right + (above + b * high) * up for a, b in corners])

    def _from_middle(self, at: ArrayLike | None) -> tuple[Float64, Float64]:
        """Return pixel offsets from the view axis, to the right and up."""
        x, y = np.moveaxis(self.pixel_centres() if at is None else _vectors("at", at, 2), -1, 0)
        middle_x, middle_y = self.centre
        return x - middle_x, middle_y - y


def _hold_arrays(of: Camera | CameraKey) -> None:
    for name in ("position", "target", "up"):
        vector = getattr(of, name)
        if np.shape(vector) != (3,):
            raise UsageError(f"{name}: {short_repr(vector)} where three numbers are needed")
        object.__setattr__(of, name, real_array(name, vector))


def _plain_number(value: Any) -> int | float:
    """Return a real number as int or float; infinity if it does not fit into 64 bits."""
    if isinstance(value, int | float):
        return value
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def _vectors(name: str, given: ArrayLike, size: int) -> Float64:
    """Return an array (..., size). Raises UsageError for another shape."""
    found: Float64 = real_array(name, given, f"(..., {size})", lambda shape: shape[-1:] == (size,))
    return found


def without_motion(camera: Camera) -> Camera:
    """Return the camera fixed in the pose at which its shutter opens. Its shutter is unchanged."""
    return replace(camera.at(), shutter=camera.shutter)


def with_changes(camera: Camera, changes: Mapping[str, Any]) -> Camera:
    """Return the camera with new values of fields.

    changes : values by field name. A new position, target or up removes the motion, which would override it. The
              other two are then those at which the shutter opens
    """
    if changes.keys() & {"position", "target", "up"}:
        shutter = changes.get("shutter", camera.shutter)
        camera = without_motion(replace(camera, shutter=shutter))
    return replace(camera, **changes)


def framing(points: Float64, resolution: tuple[int, int], up: ArrayLike = (0.0, 1.0, 0.0)) -> Camera:
    """Return a camera whose image the points fill, seen from the front and slightly from above.

    points : (N, 3), at least one: all points that must be visible
    up     : (3,), any length but zero. The front of an object is +z if y is up, and -y if z is up

    Flat objects are seen more from above, and objects much deeper than wide more from their side.
    """
    if np.any(np.asarray(up) != (0.0, 1.0, 0.0)):
        upright = upright_from_world(up)
        camera = framing(points @ upright.T, resolution)
        return replace(
            camera,
            position=camera.position @ upright,
            target=camera.target @ upright,
            up=np.array(up, np.float64),
        )
    lower, upper = points.min(axis=0), points.max(axis=0)
    centre, extent = 0.5 * (lower + upper), upper - lower
    return framed(Camera(centre + _view(extent), centre, np.array([0.0, 1.0, 0.0]), _FOV, resolution), points)


def framed(camera: Camera, points: Float64) -> Camera:
    """Return the camera translated so that the points fill its image. An orthographic camera gets a new height."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    centre, extent = 0.5 * (lower + upper), upper - lower
    right, up, forward = camera.frame()
    wide, high = camera.extent
    local = points - centre
    if camera.projection == "orthographic":
        across, along = local @ right, local @ up
        size = max(float(np.ptp(along)), float(np.ptp(across)) * high / wide) * _MARGIN
        middle = centre + 0.5 * (across.min() + across.max()) * right + 0.5 * (along.min() + along.max()) * up
        away = max(float(np.linalg.norm(extent)), 1e-9)
        height = size if size > 0 else camera.height
        return replace(camera, position=middle - away * forward, target=middle, height=height, motion=())
    ahead = local @ forward
    nearest, position = float(ahead.min()), np.zeros(3)
    back = np.inf  # farthest forward position of the eye along the view that has all points in the image
    for axis, half in ((right, wide / _MARGIN), (up, high / _MARGIN)):
        beside = local @ axis
        one, other = float((beside - half * ahead).max()), float((-beside - half * ahead).max())
        back = min(back, -0.5 * (one + other) / half)
        position += 0.5 * (one - other) * axis
    size = float(np.linalg.norm(extent)) or 1.0
    back = min(back, nearest - _CLOSEST * size)
    position = centre + position + back * forward
    return replace(camera, position=position, target=position - back * forward, motion=())


def upright_from_world(up: ArrayLike) -> Float64:
    """Return the (3, 3) rotation that takes `up` to y and the front of objects to z.

    up : (3,), any length but zero. The front is -y if z is up, y if x is up, and z if y is up
    """
    axis = np.asarray(up, np.float64) / np.linalg.norm(up)
    nearest = int(np.argmax(np.abs(axis)))
    front = np.eye(3)[(nearest + 1) % 3] if nearest < 2 else np.array([0.0, -np.sign(axis[2]), 0.0])
    front = front - (front @ axis) * axis
    front /= np.linalg.norm(front)
    return np.stack([np.cross(axis, front), axis, front])


def _view(extent: Float64) -> Float64:
    """Return the (3,) direction from a box towards the eye.

    extent : (3,) width, height and depth of the box
    """
    wide, high, deep = extent
    level = float(np.hypot(wide, deep))
    flat = 1.0 - min(1.0, float(high) / (_FLAT * level)) if level > 0 else 0.0
    turned = 1.0 - min(1.0, float(wide) / (_DEEP * float(deep))) if deep > 0 else 0.0
    elevation = np.radians(_ELEVATION[0] + flat * (_ELEVATION[1] - _ELEVATION[0]))
    azimuth = np.radians(_AZIMUTH[0] + turned * (_AZIMUTH[1] - _AZIMUTH[0]))
    return np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])


def may_be_framing(camera: Camera) -> bool:
    """Return True if the camera may come from `framing`. Its position and target are not checked."""
    return camera.fov == _FOV and not camera.motion and camera.projection == "perspective"
