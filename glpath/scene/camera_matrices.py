"""Cameras from matrices: a pose and the intrinsics K, as in computer vision [Hartley & Zisserman 2004, 6.1].

Poor at:  lens distortion, and pixels whose sides are not perpendicular: undistort the images first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from glpath.errors import UsageError
from glpath.scene.camera import Camera
from glpath.scene.camera_check import MAX_PIXELS, check_camera
from glpath.scene.geometry import Float64
from glpath.system.arguments import checked, real_array, short_repr

Convention = Literal["opengl", "opencv"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)

# Maximum difference of R R^T from the identity that counts as a rounding error of a rotation R.
_RIGID = 1e-4
# Maximum skew that counts as a rounding error, as a fraction of the focal length.
_SKEW = 1e-9


@checked
def camera(
    pose: ArrayLike,
    K: ArrayLike,
    *,
    resolution: tuple[int, int] | None = None,
    convention: Convention = "opengl",
) -> Camera:
    """Return the camera with a pose and intrinsics, for `render(..., camera=...)`.

    Parameters
    ----------
    pose       : (4, 4) or (3, 4): matrix from the camera's frame to the world's, without scale
    K          : (3, 3) intrinsics [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], in pixels. The image's corner is (0, 0)
                 and the centre of its first pixel (0.5, 0.5), as in COLMAP and NeRFs. OpenCV's calibration counts
                 from the centre of the first pixel, so add 0.5 to its cx and cy
    resolution : (width, height); None: twice the principal point, rounded
    convention : "opengl": the camera looks along -z, and +y is up in the image, as in Blender and NeRFs; "opencv":
                 it looks along +z, and +y is down, as in COLMAP

    Raises UsageError if the pose is not a rotation and a translation, or if the intrinsics have a skew, and
    SceneError if the camera has no view.

    Example
    -------
    >>> K = [[60.0, 0.0, 32.3], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
    >>> found = camera([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3.9]], K)
    >>> found.resolution, found.pixel_aspect
    ((65, 48), 0.8333333333333334)
    """
    if convention not in CONVENTIONS:
        raise UsageError(f"convention: {short_repr(convention)} where one of {', '.join(CONVENTIONS)} is needed.")
    matrix = _pose(_numbers("pose", pose, "(4, 4) or (3, 4)", {(4, 4), (3, 4)}.__contains__), "pose")
    return _camera(matrix, *_intrinsics(K, resolution), convention, "camera")


def cameras(
    poses: ArrayLike, K: ArrayLike, resolution: tuple[int, int] | None, convention: Convention
) -> list[Camera]:
    """Return the cameras of poses (N, 4, 4) or (N, 3, 4), or of a single pose; other parameters as for `camera`."""
    found = _numbers("poses", poses, "(N, 4, 4) or (N, 3, 4)", _fits_poses)
    found = found[None] if found.ndim == 2 else found
    matrices = [_pose(each, f"poses[{number}]") for number, each in enumerate(found)]
    intrinsics, size = _intrinsics(K, resolution)
    return [_camera(each, intrinsics, size, convention, f"poses[{number}]") for number, each in enumerate(matrices)]


def _camera(pose: Float64, K: Float64, resolution: tuple[int, int], convention: Convention, source: str) -> Camera:
    """Return the camera of checked matrices. Raises SceneError with `source` if the camera has no view."""
    sign = -1.0 if convention == "opengl" else 1.0
    position, forward, up = pose[:, 3], sign * pose[:, 2], -sign * pose[:, 1]
    (width, height), fx, fy = resolution, K[0, 0], K[1, 1]
    with np.errstate(over="ignore"):  # `check_camera` refuses what overflows
        made = Camera(
            position,
            position + forward,
            up,
            float(np.degrees(2 * np.arctan(0.5 * height / fy))),
            resolution,
            principal_point=(float(K[0, 2] / width), float(K[1, 2] / height)),
            pixel_aspect=float(fy / fx),
        )
    check_camera(made, source)
    return made


def _fits_poses(shape: tuple[int, ...]) -> bool:
    return len(shape) in (2, 3) and shape[-2:] in ((4, 4), (3, 4)) and 0 not in shape


def _numbers(name: str, given: Any, allowed: str, fits: Callable[[tuple[int, ...]], bool]) -> Float64:
    """Return `given` as a float64 array of finite numbers; see `real_array`. Raises UsageError."""
    found: Float64 = real_array(name, given, allowed, fits)
    if not np.isfinite(found).all():
        raise UsageError(f"{name}: has numbers that are not finite.")
    return found


def _pose(found: Float64, name: str) -> Float64:
    """Return the first three rows of a pose. Raises UsageError unless it is a rotation and a translation."""
    turn = found[:3, :3]
    if len(found) == 4 and not np.allclose(found[3], [0, 0, 0, 1]):
        raise UsageError(
            f"{name}: ends in the row {found[3].tolist()}, but must end in [0, 0, 0, 1].",
            "The translation is the last column.",
        )
    if not np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID) or np.linalg.det(turn) < 0:
        raise UsageError(
            f"{name}: its upper left 3 x 3 part is no rotation: it stretches or mirrors.",
            "Divide its columns by their lengths. A camera that mirrors is one of the other convention.",
        )
    return found[:3]


def _intrinsics(given: ArrayLike, resolution: tuple[int, int] | None) -> tuple[Float64, tuple[int, int]]:
    """Return the intrinsics (3, 3), and the image's (width, height). Raises UsageError for invalid values.

    resolution : (width, height); None: twice the principal point, rounded
    """
    K = _numbers("K", given, "(3, 3)", (3, 3).__eq__)
    fx, fy = K[0, 0], K[1, 1]
    if not (fx > 0 and fy > 0):
        raise UsageError(
            f"K: focal lengths {fx:g} and {fy:g}, but both must be above 0.",
            "A negative one is of the other convention.",
        )
    if abs(K[0, 1]) > _SKEW * fx or np.any(K[1, 0] != 0) or not np.allclose(K[2], [0, 0, 1]):
        raise UsageError("K: must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew.")
    middle = np.clip(K[:2, 2], -MAX_PIXELS, MAX_PIXELS)  # because infinity cannot be rounded
    size = tuple(round(2 * at) for at in middle) if resolution is None else tuple(resolution)
    if len(size) != 2 or not all(1 <= pixels <= MAX_PIXELS and pixels % 1 == 0 for pixels in size):
        what = "resolution" if resolution is not None else "K: a resolution of twice the principal point"
        raise UsageError(
            f"{what}: {short_repr(size)} where two whole numbers from 1 to {MAX_PIXELS:,} are needed.",
            "" if resolution is not None else "Give the resolution.",
        )
    return K, (int(size[0]), int(size[1]))
