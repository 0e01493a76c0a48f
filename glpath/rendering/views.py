"""Many views of one scene by camera matrices: images with depth, normals and segmentation, as arrays.

Cost:     loading, preparation and compilation once, then the path sets of each view.
Poor at:  lenses with distortion; undistort the images first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.film.aovs import FAR, Aov
from glpath.film.film import Film
from glpath.integrators.by_name import Integrator
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import camera_replaced
from glpath.rendering.calls import render_and_warn
from glpath.rendering.job import describe
from glpath.rendering.options import RenderKeywords, settings_of, with_options
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import Session
from glpath.scene.camera_matrices import CONVENTIONS, Convention, cameras
from glpath.sensors.sensor import CameraSensor
from glpath.system.arguments import check_word
from glpath.system.time_limit import limited

Float64 = NDArray[np.float64]

_AOVS: tuple[Aov, ...] = ("depth_min", "normal", "object_id")


@dataclass(frozen=True, eq=False)
class Views:
    """N views of H x W pixels, row 0 at the top.

    rgb          : (N, H, W, 3) float64, radiance, linear Rec. 709
    depth        : (N, H, W) float64, depth of the nearest surface that a sample hits, scene units; infinite without
                   a hit
    normal       : (N, H, W, 3) float64, mean normal of the samples in the world's frame; 0 without a hit
    segmentation : (N, H, W) int64, index from 1 of the shape that most samples hit, in the scene's order; 0 without
                   a hit
    names        : names of the shapes; `names[segmentation - 1]` is the name of a pixel's shape
    films        : film of each view
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
    """Render one scene from many cameras, given as matrices.

    Parameters
    ----------
    scene      : any source that `load_scene` accepts; its own camera is not used
    poses      : (N, 4, 4) or (N, 3, 4) matrices, or one matrix, from the camera's frame to the world's, without
                 scale
    K          : (3, 3) intrinsics of all views in pixels, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    resolution : (width, height); default: twice the principal point, rounded
    convention : "opengl" or "opencv"; poses, K, resolution and convention are as in `glpath.camera`
    spp        : path sets (samples per pixel) of each view
    The other parameters are those of `render` and apply to each view; so does `time_limit`.
    {options}

    Raises the errors of `render`, and UsageError for intrinsics with a skew, or poses that are not a rotation and
    translation. An exception during the renders, such as that of Ctrl-C, has the films of the finished views in its
    attribute `films`, in the order of the poses.

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
    check_word("convention", convention, CONVENTIONS)
    seen_by = cameras(poses, K, resolution, convention)
    run_options, chosen = RunOptions.taken_from(options)
    for name in ("film", "cluster"):
        if getattr(run_options, name) is not None:
            raise UsageError(f"{name}: of a single render, but there are {len(seen_by)} views.", "Leave it out.")
    further = settings_of("path", {"aovs": chosen.get("aovs", ())}).aovs
    chosen["aovs"] = (*_AOVS, *(name for name in further if name not in _AOVS))
    with camera_replaced(seen_by[0]):
        loaded = load_scene(scene, parameters)
    job, base = describe(
        loaded.with_camera(seen_by[0]),
        integrator=integrator,
        spp=run_options.spp(spp),
        **chosen,
    )
    films: list[Film] = []
    try:
        with Session(job, base, run_options) as session:
            for camera in seen_by:
                shown = replace(base, camera=camera)
                view = replace(job, sensor=CameraSensor.of(camera))
                with limited(run_options.time_limit, anew=True):
                    films.append(render_and_warn(session, view, shown, run_options))
    except (Exception, KeyboardInterrupt) as error:
        error.films = tuple(films)  # type: ignore[union-attr]
        if films:
            done = f"{len(films)} of {len(seen_by)} views"
            error.add_note(f"render_views finished {done}; their films are in the exception's `films`.")
        raise
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
