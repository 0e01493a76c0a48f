"""Many views of one scene by camera matrices: pictures with depth, normals and segmentation, as arrays.

Cost:     the scene is loaded, prepared and compiled once; then each view takes what its path sets take.
Poor at:  lenses that distort, and pixels that are not square: undistort and rectify the pictures first.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.film.aovs import FAR, Aov
from glpath.film.film import Film
from glpath.integrators.by_name import Integrator
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.rendering.calls import reporting_to
from glpath.rendering.job import describe
from glpath.rendering.options import RenderKeywords, check_word, with_options
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import Session
from glpath.scene import Camera, check_camera
from glpath.sensors.sensor import CameraSensor

Float64 = NDArray[np.float64]
Convention = Literal["opengl", "opencv"]

_AOVS: tuple[Aov, ...] = ("depth_min", "normal", "object_id")
# How far, in pixels, a principal point may be off a half of one; and how far a rotation off one.
_HALF, _RIGID = 1e-6, 1e-4


@dataclass(frozen=True, eq=False)
class Views:
    """N views of H x W pixels, row 0 at the top.

    rgb          : (N, H, W, 3) float64, radiance, linear Rec. 709
    depth        : (N, H, W) float64, scene units along the view, of the nearest surface that a sample meets;
                   infinite where none does
    normal       : (N, H, W, 3) float64, in the world's frame, the mean of the samples; 0 where none meets a surface
    segmentation : (N, H, W) int64, the number, from 1, of the shape that most samples meet, in the scene's order; 0
                   where there is none
    names        : of the shapes, so that `names[segmentation - 1]` is one's name
    films        : of each view, with all that `Film` has
    """

    rgb: Float64
    depth: Float64
    normal: Float64
    segmentation: NDArray[np.int64]
    names: tuple[str, ...]
    films: tuple[Film, ...]

    def __len__(self) -> int:
        return len(self.films)


@with_options()
def render_views(
    scene: AnyScene,
    poses: ArrayLike,
    K: ArrayLike,
    *,
    resolution: tuple[int, int] | None = None,
    convention: Convention = "opengl",
    integrator: Integrator | IntegratorSettings = "auto",
    spp: int | None = None,
    parameters: Mapping[str, object] | None = None,
    **options: Unpack[RenderKeywords],
) -> Views:
    """Render one scene from many cameras that are given as matrices.

    Parameters
    ----------
    scene      : what `load_scene` takes; its own camera is not used
    poses      : (N, 4, 4), (N, 3, 4) or one of them: from the camera's frame to the world's, without scale
    K          : (3, 3) intrinsics [[f, 0, cx], [0, f, cy], [0, 0, 1]], pixels; the corner of the picture is (0, 0),
                 the middle of its first pixel (0.5, 0.5), as COLMAP and NeRFs have it. Add 0.5 to what OpenCV's
                 calibration finds, which counts from that middle
    resolution : (width, height); twice the principal point without it
    convention : "opengl", the camera looks along -z, and +y is up in the picture, as Blender and NeRFs have it;
                 "opencv", it looks along +z, and +y is down, as COLMAP has it
    spp        : path sets, that is samples per pixel, of each view
    The other parameters are those of `render`, of each view.
    {options}

    Raises UsageError for poses that are no rotation and translation, for pixels that are not square, and for a
    principal point that is not at a multiple of half a pixel; what `render` raises.

    Example
    -------
    >>> import numpy as np
    >>> K = [[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]]
    >>> pose = np.eye(4)
    >>> pose[2, 3] = 3.9
    >>> views = render_views("cornell-box-36", pose, K, spp=1, max_depth=1)
    >>> views.rgb.shape, views.depth.shape, views.segmentation.dtype
    ((1, 48, 64, 3), (1, 48, 64), dtype('int64'))
    """
    check_word("convention", convention, get_args(Convention))
    matrices = _poses(poses)
    focal, centre = _intrinsics(K)
    width, height = _size(resolution, centre)
    virtual, crop = _virtual(centre, (width, height))
    cameras = [_camera(each, focal, virtual, convention) for each in matrices]
    run_options, chosen = RunOptions.taken_from(options)
    for name in ("film", "cluster"):
        if getattr(run_options, name) is not None:
            raise UsageError(f"{name}: of a single render, but there are {len(cameras)} views.", "Leave it out.")
    chosen["aovs"] = (*_AOVS, *(name for name in chosen.get("aovs", ()) if name not in _AOVS))
    loaded = load_scene(scene, parameters)
    check_camera(cameras[0], "poses[0]")
    job, base = describe(
        loaded.with_camera(cameras[0]),
        integrator=integrator,
        spp=run_options.spp(spp),
        crop=crop,
        **chosen,
    )
    films = []
    with Session(job, base, run_options) as session:
        for camera in cameras:
            started = time.perf_counter()
            shown = replace(base, camera=camera)
            view = replace(job, sensor=CameraSensor.of(camera))
            with reporting_to(run_options) as reported:
                films.append(session.render(view, shown, reported, started))
    return _views(films, tuple(shape.name for shape in base.shapes))


def _views(films: list[Film], names: tuple[str, ...]) -> Views:
    depth = np.stack([film.aov("depth_min") for film in films])
    return Views(
        np.stack([film.mean for film in films]),
        np.where(depth >= FAR, np.inf, depth),
        np.stack([film.aov("normal") for film in films]),
        np.stack([film.aov("object_id") for film in films]),
        names,
        tuple(films),
    )


def _array(name: str, given: Any) -> Float64:
    """float64. Raises UsageError for what are no finite numbers."""
    try:
        found = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{name}: no array of numbers.", "Give a numpy array, or lists.") from error
    if not np.isfinite(found).all():
        raise UsageError(f"{name}: has numbers that are not finite.")
    return found


def _poses(given: ArrayLike) -> Float64:
    """(N, 3, 4), each a rotation and a translation. Raises UsageError."""
    found = _array("poses", given)
    found = found[None] if found.ndim == 2 else found
    if found.ndim != 3 or found.shape[1:] not in ((4, 4), (3, 4)) or not len(found):
        raise UsageError(f"poses: of shape {np.shape(given)} where (N, 4, 4) or (N, 3, 4) is needed.")
    for number, pose in enumerate(found):
        turn = pose[:3, :3]
        if found.shape[1] == 4 and not np.allclose(pose[3], [0, 0, 0, 1]):
            raise UsageError(
                f"poses[{number}]: ends in the row {pose[3].tolist()}, but must end in [0, 0, 0, 1].",
                "The translation is the last column.",
            )
        if not np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID) or np.linalg.det(turn) < 0:
            raise UsageError(
                f"poses[{number}]: its upper left 3 x 3 part is no rotation: it stretches or mirrors.",
                "Divide its columns by their lengths. A camera that mirrors is one of the other convention.",
            )
    return found[:, :3]


def _intrinsics(given: ArrayLike) -> tuple[float, tuple[float, float]]:
    """The focal length and the principal point, pixels. Raises UsageError."""
    K = _array("K", given)
    if K.shape != (3, 3):
        raise UsageError(f"K: of shape {K.shape} where (3, 3) is needed.")
    fx, fy = K[0, 0], K[1, 1]
    if not (fx > 0 and abs(fx - fy) <= 1e-6 * fx):
        raise UsageError(
            f"K: focal lengths {fx:g} and {fy:g}, but pixels here are square: both must be equal and above 0.",
            "Resample the pictures to square pixels. (A negative one is of the other convention.)",
        )
    if abs(K[0, 1]) > 1e-9 * fx or np.any(K[1, 0] != 0) or not np.allclose(K[2], [0, 0, 1]):
        raise UsageError("K: must be [[f, 0, cx], [0, f, cy], [0, 0, 1]], without skew.")
    for axis, at in (("x", K[0, 2]), ("y", K[1, 2])):
        near = round(2 * at) / 2
        if abs(near - at) > _HALF:
            raise UsageError(
                f"K: the principal point's {axis} is {at:g}, but must be a multiple of half a pixel.",
                f"Round it to {near:g}, which shifts the pictures by {abs(near - at):.2g} pixels.",
            )
    return float(fx), (round(2 * K[0, 2]) / 2, round(2 * K[1, 2]) / 2)


def _size(resolution: tuple[int, int] | None, centre: tuple[float, float]) -> tuple[int, int]:
    """(width, height). Raises UsageError."""
    size = tuple(round(2 * at) for at in centre) if resolution is None else tuple(resolution)
    if len(size) != 2 or any(int(pixels) != pixels or pixels < 1 for pixels in size):
        raise UsageError(f"resolution: {size} where two whole numbers, at least 1, are needed.")
    return int(size[0]), int(size[1])


def _virtual(
    centre: tuple[float, float], size: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int, int, int]]:
    """The picture whose middle is the principal point, and the part of it that is wanted, as a crop."""
    whole, first = [], []
    for at, pixels in zip(centre, size, strict=True):
        side = round(2 * max(at, pixels - at))  # what lies on the wider side of the point, twice
        whole.append(max(side, pixels))
        first.append(round(side / 2 - at))
    return (whole[0], whole[1]), (first[0], first[1], *size)


def _camera(pose: Float64, focal: float, resolution: tuple[int, int], convention: Convention) -> Camera:
    """The camera of a pose (3, 4)."""
    sign = -1.0 if convention == "opengl" else 1.0
    position, forward, up = pose[:, 3], sign * pose[:, 2], -sign * pose[:, 1]
    fov = float(np.degrees(2 * np.arctan(0.5 * resolution[1] / focal)))
    return Camera(position, position + forward, up, fov, resolution)
