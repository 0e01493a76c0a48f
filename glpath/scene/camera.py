"""The camera and its projection: a pinhole, a thin lens, parallel rays, or a panorama. No other module projects.

Positions in an image are in pixels from its upper left corner, x to the right and y down, so that the middle of the
first pixel is (0.5, 0.5). Row 0 of an image is at the top.

A camera has a shutter, and keys where it moves: a picture is the mean over the time that the shutter is open, by
accumulation of path sets, each of which has one time [PB 3.3; Haeberli & Akeley 1990].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from glpath.scene.choices import Projection
from glpath.scene.geometry import Float64
from glpath.system.pyrr_matrices import matrix33

# Of `framing`: degrees from the front to the right, and upwards, each of what is as wide and high as deep, and of
# what is thin or flat; below which share of width over depth, of height over width, it begins to be so.
_AZIMUTH, _ELEVATION = (20.0, 75.0), (18.0, 40.0)
_DEEP, _FLAT = 0.8, 0.3
_FOV = 30.0
# How much larger the picture is than what it shows, and in diagonals of that, how near the eye may be at the least.
_MARGIN = 1.15
_CLOSEST = 0.1


@dataclass(frozen=True)
class CameraKey:
    """Where a camera is at a time.

    time                 : seconds
    position, target, up : (3,) float64, as of `Camera`
    """

    time: float
    position: Float64
    target: Float64
    up: Float64

    def __post_init__(self) -> None:
        _hold_arrays(self)


@dataclass(frozen=True)
class Camera:
    """A camera. Lists do for arrays and tuples, so that one can be written by hand, or come out of JSON.

    position, target, up : (3,) float64, scene units; `up` need not be perpendicular to the view
    fov                  : of "perspective": vertical field of view of the whole image, degrees, 0 < fov < 180
    resolution           : (width, height) in pixels
    projection           : "perspective"; "orthographic", whose rays are parallel and start in the plane through
                           `position`; "panorama", equirectangular: 360 degrees from the left to the right, 180 from
                           the top to the bottom, `target` in the middle
    height               : of "orthographic": of the whole image, scene units
    aperture_radius      : of a thin lens, scene units; 0 is a pinhole. With "perspective"
    focus_distance       : along the view, to the plane that is sharp, scene units; None: to the target
    shutter              : when it opens and when it closes, seconds; equal for one moment
    motion               : where it moves: held before the first and after the last, linear between them; they stand
                           for position, target and up. () where it stands still
    principal_point      : where the view goes through the picture, in its widths and heights from the upper left
                           corner: (0.5, 0.5) is the middle, a shifted lens has others. Not of a panorama
    pixel_aspect         : width of a pixel over its height. Not of a panorama
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
        for name in ("resolution", "shutter", "motion", "principal_point"):
            object.__setattr__(self, name, tuple(getattr(self, name)))

    def frame(self) -> tuple[Float64, Float64, Float64]:
        """Unit vectors (right, up, forward), each (3,) float64. Row 0 of an image is towards `up`."""
        return self._frame

    @cached_property
    def _frame(self) -> tuple[Float64, Float64, Float64]:
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def turned(self, degrees: float) -> Camera:
        """The camera carried around its target, about the axis `up` through it, counter-clockwise from above.

        The result stands still where the camera's motion starts.
        """
        arm = self.position - self.target
        rotation = matrix33.create_from_axis_rotation(np.asarray(self.up, np.float64), np.radians(degrees))
        return replace(self, position=self.target + arm @ rotation, motion=())

    def turntable(self, frames: int) -> list[Camera]:
        """The camera at so many equal steps once around the target."""
        return [self.turned(360.0 * i / frames) for i in range(frames)]

    @property
    def moves(self) -> bool:
        """While the shutter is open."""
        opened, closed = self.shutter
        return (
            len(self.motion) > 1
            and opened < self.motion[-1].time
            and closed > self.motion[0].time
            and opened < closed
        )

    def at(self, time: float | None = None) -> Camera:
        """The camera as it stands at a time, seconds: without motion, and with a shutter of that moment.

        time : None: when the shutter opens
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
        """Pixels of what is one scene unit high: at distance 1, by parallel rays at any."""
        if self.projection == "orthographic":
            return float(self.resolution[1] / self.height)
        return float(self.resolution[1] / (2.0 * np.tan(np.radians(self.fov) / 2.0)))

    @property
    def focal_lengths(self) -> tuple[float, float]:
        """Pixels of what is one scene unit wide and high: fx and fy of an intrinsic matrix."""
        return self.focal / self.pixel_aspect, self.focal

    @property
    def centre(self) -> tuple[float, float]:
        """The position in the image that the view goes through: cx and cy of an intrinsic matrix."""
        (width, height), (across, down) = self.resolution, self.principal_point
        return width * across, height * down

    @property
    def focus(self) -> float:
        """Distance along the view of the plane that is sharp, scene units."""
        if self.focus_distance is not None:
            return float(self.focus_distance)
        return float(np.linalg.norm(self.target - self.position))

    @property
    def extent(self) -> tuple[float, float]:
        """Half the width and half the height of the image that lies at distance 1, or is seen by parallel rays."""
        (width, height), (fx, fy) = self.resolution, self.focal_lengths
        return 0.5 * width / fx, 0.5 * height / fy

    @property
    def offset(self) -> tuple[float, float]:
        """How far the middle of that image is to the right of the view, and above it."""
        (wide, high), (across, down) = self.extent, self.principal_point
        return wide * (1.0 - 2.0 * across), high * (2.0 * down - 1.0)

    def pixel_centres(self) -> Float64:
        """(H, W, 2) float64 positions in the image."""
        width, height = self.resolution
        return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)

    def rays(self, at: ArrayLike | None = None) -> Float64:
        """(..., 3) float64 unit directions through positions in the image, from `origins`; of a lens its middle's.

        at : (..., 2) positions, inside the image or beside it; the centres of all pixels, (H, W, 2), without it
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

    def origins(self, at: ArrayLike | None = None) -> Float64:
        """(..., 3) float64 where `rays` start: the position; of parallel rays points of the plane through it."""
        x, y = self._from_middle(at)
        if self.projection != "orthographic":
            return np.broadcast_to(np.asarray(self.position, np.float64), (*x.shape, 3)).copy()
        (right, up, _), (fx, fy) = self.frame(), self.focal_lengths
        return np.asarray(self.position + (x / fx)[..., None] * right + (y / fy)[..., None] * up)

    def project(self, points: ArrayLike) -> tuple[Float64, Float64]:
        """Where points (..., 3) appear: (..., 2) positions in the image, and (...) depth along the view.

        Of no meaning where the depth is not above 0: behind the eye. Of a panorama, which has nothing behind it,
        the depth is the distance.
        """
        right, up, forward = self.frame()
        seen = np.asarray(points, np.float64) - self.position
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
        """(4, 3) float64 directions through the corners of the image of a perspective, around it; not unit."""
        (right, up, forward), (wide, high), (across, above) = self.frame(), self.extent, self.offset
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([forward + (across + a * wide) * right + (above + b * high) * up for a, b in corners])

    def _from_middle(self, at: ArrayLike | None) -> tuple[Float64, Float64]:
        """Pixels to the right of where the view goes through the image, and above it."""
        x, y = np.moveaxis(self.pixel_centres() if at is None else np.asarray(at, np.float64), -1, 0)
        middle_x, middle_y = self.centre
        return x - middle_x, middle_y - y


def _hold_arrays(of: Camera | CameraKey) -> None:
    for name in ("position", "target", "up"):
        object.__setattr__(of, name, np.asarray(getattr(of, name), np.float64))


def framing(points: Float64, resolution: tuple[int, int], up: ArrayLike = (0.0, 1.0, 0.0)) -> Camera:
    """A camera that all of some points fill the picture of, seen from the front and somewhat above.

    points : (N, 3), one at least: of all that is to be seen
    up     : (3,) of any length but zero. The front of what has y up is +z, with z up it is -y

    What is flat is seen more from above; what is much deeper than wide more from its side.
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
    """Return the camera, moved without a turn, so that some points fill its picture; parallel rays get a height.

    points : (N, 3), one at least
    """
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
    back = np.inf  # along the view, where the eye may be: before all planes of the picture's edges
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
    """Return the (3, 3) rotation that takes `up` to y and the front of things to z.

    up : (3,) of any length but zero. The front is -y if z is up, y if x is up, and z if y is up
    """
    axis = np.asarray(up, np.float64) / np.linalg.norm(up)
    nearest = int(np.argmax(np.abs(axis)))
    front = np.eye(3)[(nearest + 1) % 3] if nearest < 2 else np.array([0.0, -np.sign(axis[2]), 0.0])
    front = front - (front @ axis) * axis
    front /= np.linalg.norm(front)
    return np.stack([np.cross(axis, front), axis, front])


def _view(extent: Float64) -> Float64:
    """(3,) from a box of an extent (3,) towards the eye."""
    wide, high, deep = extent
    level = float(np.hypot(wide, deep))
    flat = 1.0 - min(1.0, float(high) / (_FLAT * level)) if level > 0 else 0.0
    turned = 1.0 - min(1.0, float(wide) / (_DEEP * float(deep))) if deep > 0 else 0.0
    elevation = np.radians(_ELEVATION[0] + flat * (_ELEVATION[1] - _ELEVATION[0]))
    azimuth = np.radians(_AZIMUTH[0] + turned * (_AZIMUTH[1] - _AZIMUTH[0]))
    return np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])


def may_be_framing(camera: Camera) -> bool:
    """Whether a camera looks as those of `framing` do; which box it is of, its position says."""
    return camera.fov == _FOV and not camera.motion and camera.projection == "perspective"
