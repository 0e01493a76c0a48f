"""Functions `glpath.render` and `render_frames`, which make jobs and run them, and `run` for an existing job."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, Unpack

from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.gl.context import Context
from glpath.integrators.by_name import Integrator
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene
from glpath.rendering.interrupts import RenderInterrupted
from glpath.rendering.job import RenderJob, SceneSource, describe, with_alpha, with_overrides
from glpath.rendering.options import RenderKeywords, with_late_warnings, with_options
from glpath.rendering.progress import Progress, reporting
from glpath.rendering.run_options import RunKeywords, RunOptions
from glpath.rendering.session import Session
from glpath.scene import Camera, Scene
from glpath.sensors.sensor import CameraSensor, PointSensor
from glpath.system.arguments import check_word
from glpath.system.reporting import MODES
from glpath.system.time_limit import limited


@with_options()
def render(
    scene: AnyScene,
    *,
    integrator: Integrator | IntegratorSettings = "auto",
    spp: int | None = None,
    first_path_set: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | Camera | None = None,
    parameters: Mapping[str, object] | None = None,
    **options: Unpack[RenderKeywords],
) -> Film:
    """Render a scene by paths, by a gather from a radiosity solution, or by Whitted's ray tracing.

    Parameters
    ----------
    scene          : any source that `load_scene` accepts: a file, the name of a shipped scene, a dictionary, a
                     trimesh mesh or scene, or a `Scene`
    integrator     : "auto" chooses the one of the next three that gives a clean image fastest, see
                     `glpath.rendering.choice`; "path", global illumination with all kinds of light, by paths whose
                     rays are traced through a BVH in the shader; "path-buffer", the same by paths that share
                     directions, so one scan of the scene traces all their rays; "gather", from a radiosity solution
                     with the light of all bounces, gathered at visible points; "t-buffer", Whitted's ray tracing
                     with the T-buffer, for spheres, planes, point lights, textures and mirrors; "classic", the same
                     image by the classical algorithm, which tests every ray against every object. Or an instance of
                     an integrator's settings from `glpath.integrators.by_name`
    spp            : path sets (samples per pixel);
                     default {default_spp}; unlimited with `time_limit` or `noise`.
                     Samples of a ray tracer differ only in their position in the pixel; a single sample is at the
                     pixel's centre
    first_path_set : number of the first path set; renders of sets 0 to 31 and 32 to 63 merge into a film that is
                     bit-identical to a render of 64
    resolution     : (width, height) in pixels; default: the scene's
    crop           : (x, y, width, height) of the pixels to render in the whole image, y from the top
    camera         : fields of the scene's camera to replace: look_at, the name of a shape that shall fill the
                     image; position, target, up, fov (vertical, degrees); type ("perspective", "orthographic" with
                     a height, "panorama"), aperture_radius and focus_distance of a lens, shutter (opens, closes;
                     seconds), principal_point, pixel_aspect. A new position ends the camera's motion. Or a
                     `glpath.scene.Camera`, which `glpath.camera` makes from matrices
    parameters     : parameters of a generated scene
    {run_options}
    {options}

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered; ContextError also if the device fails
    TimeLimitError : if the time limit is over more than a second before the first path set
    RenderInterrupted : on Ctrl-C, with the unfinished film

    Warns `SceneWarning` for a scene that cannot be rendered as intended.

    Poor at: caustics of mirrors and glass with "path", "path-buffer" and "gather"; indirect light with the ray
    tracers.

    Example
    -------
    >>> import glpath
    >>> film = glpath.render("cornell-box", spp=4, max_depth=2, resolution=(96, 64))
    >>> film.mean.shape, film.path_sets
    ((64, 96, 3), 4)
    >>> film.save("cornell-box.png")
    """
    run_options, chosen = RunOptions.taken_from(options)
    job, loaded = describe(
        scene,
        integrator=integrator,
        spp=run_options.spp(spp),
        first_path_set=first_path_set,
        resolution=resolution,
        crop=crop,
        camera=camera,
        parameters=parameters,
        **chosen,
    )
    return run_job(job, loaded, run_options)


@with_options(integrators=False)
def run(
    job: RenderJob,
    context: Context | None = None,
    *,
    scene: Scene | None = None,
    sensor: PointSensor | None = None,
    **options: Unpack[RunKeywords],
) -> Film:
    """Render a job. The film equals that of `render` for the job's arguments.

    Parameters
    ----------
    context : context to use instead of opening one by `backend` and `device`
    scene   : scene of the job, required if it was made in memory; avoids loading it again otherwise
    sensor  : points of a job of points that was read from JSON, which does not contain them
    The other parameters are those of `render`

    Raises and warns as `render` does, and raises SceneError for a scene whose content is not the job's.

    Example
    -------
    >>> from glpath.rendering import RenderJob, run
    >>> job = RenderJob.of("cornell-box", spp=16, max_depth=1, resolution=(32, 32))
    >>> parts = [run(part) for part in job.split(2)]
    >>> parts[0].merge(parts[1]).path_sets
    16
    """
    if sensor is not None:
        if not isinstance(job.sensor, PointSensor):
            raise UsageError("sensor: points were given, but the job's paths start at a camera.")
        job = replace(job, sensor=job.sensor.given(sensor.points))

    film: Film = with_late_warnings(
        lambda: run_job(job, job.seen(scene), RunOptions(**options), context), job.strict
    )
    return film


def run_job(
    job: RenderJob,
    scene: Scene,
    options: RunOptions,
    context: Context | None = None,
    pictured: Callable[[Film], Film] | None = None,
) -> Film:
    """Return the film of a job whose scene is loaded; all renders, including those of a cluster, call this.

    pictured : function that makes an image for `progress` from a film of points
    """
    with limited(options.time_limit):
        if options.cluster is not None:
            with reporting_to(options, pictured) as reported:
                return options.cluster.render(job, scene, replace(reported, cluster=None))
        with Session(job, scene, options, context=context) as session:
            return render_and_warn(session, job, scene, options, pictured)


def render_and_warn(
    session: Session,
    job: RenderJob,
    scene: Scene,
    options: RunOptions,
    pictured: Callable[[Film], Film] | None = None,
) -> Film:
    """Return the film of a job, after the warnings about it; those that are errors are raised at the end.

    Raises the errors of `Session.render`; a film that an interrupt ends also gets its warnings.
    """
    try:
        with reporting_to(options, pictured) as reported:
            film = session.render(job, scene, reported)
    except RenderInterrupted as stop:
        session.warn_about(stop.film)
        raise
    session.warn_about(film)
    return film


@with_options()
def render_frames(
    scene: AnyScene,
    frames: Iterable[Mapping[str, Any] | Camera | Scene],
    *,
    integrator: Integrator | IntegratorSettings = "auto",
    spp: int | None = None,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    **options: Unpack[RenderKeywords],
) -> Iterator[Film]:
    """Render several frames: one scene from several cameras, or with moving lights and objects.

    Shaders, objects, shadow-buffers and a radiosity solution stay on the device from frame to frame. The ray
    tracers fill a shadow-buffer again only if its light or an object has moved [TB III.D]. A gather renders any
    number of views from one solution [PB 4].

    frames : for each frame, fields of the camera to replace, as in `render`, or a `Camera`, or a `Scene` with its
             own camera. With "path", "path-buffer" and "gather", such scenes may differ only in the camera. All
             frames have the resolution of the first

    The other parameters are those of `render` and apply to each frame; each ends by its own `noise` or
    `time_limit`. Yields a `Film` for each frame, with its own time and counts.

    Example
    -------
    >>> walk = [{"position": (x, -10.0, 3.0)} for x in (-1.0, 0.0, 1.0)]
    >>> films = render_frames("three-spheres", walk, shadows="cube", spp=1, resolution=(64, 48))
    >>> [film.mean.shape for film in films]
    [(48, 64, 3), (48, 64, 3), (48, 64, 3)]

    Raises the errors of `render`.
    """
    run_options, chosen = RunOptions.taken_from(options)
    if run_options.film is not None:
        raise UsageError(
            "film: of a single render, but each frame has its own.", "Render the frames that are missing."
        )
    with limited(run_options.time_limit, anew=True):
        base_job, base = describe(
            scene,
            integrator=integrator,
            spp=run_options.spp(spp),
            resolution=resolution,
            parameters=parameters,
            **chosen,
        )
    workers = run_options.cluster
    if isinstance(frames, memoryview):  # one of several dimensions cannot be iterated
        raise UsageError("frames: bytes, where cameras, fields of a camera or scenes are needed.")
    left = iter(frames)
    with ExitStack() as until_done:
        session: Session | None = None
        while True:
            with limited(run_options.time_limit, anew=True):
                try:
                    frame = next(left)  # within the limit, because an iterator may read the scene of the frame
                except StopIteration:
                    return
                shown = _frame_scene(base, frame)
                job = replace(
                    base_job,
                    scene=SceneSource.of(frame, frame, None) if isinstance(frame, Scene) else base_job.scene,
                    integrator=with_alpha(base_job.integrator, shown),
                    sensor=CameraSensor.of(shown.camera),
                    window=(0, 0, *shown.camera.resolution),
                )
                if workers is None and (session is None or not session.follows(job, shown)):
                    until_done.close()  # frees the old session's data on the device, which this job cannot use
                    session = until_done.enter_context(Session(job, shown, run_options))
                if session is not None:
                    film = render_and_warn(session, job, shown, run_options)
                elif workers is not None:
                    with reporting_to(run_options) as reported:
                        film = workers.render(job, shown, replace(reported, cluster=None))
            yield film


def _frame_scene(base: Scene, frame: Mapping[str, Any] | Camera | Scene) -> Scene:
    if isinstance(frame, Scene):
        return frame
    if isinstance(frame, Camera):
        return replace(base, camera=frame)
    return with_overrides(base, None, frame)


@contextmanager
def reporting_to(options: RunOptions, pictured: Callable[[Film], Film] | None = None) -> Iterator[RunOptions]:
    """Context that yields the options; if `progress` is set, their `on_progress` also reports to the user."""
    if not options.progress:
        yield options
        return
    mode = "auto" if options.progress is True else options.progress
    check_word("progress", mode, MODES)
    with reporting(mode, sys.stderr) as show:

        def both(progress: Progress) -> None:
            if options.on_progress is not None:
                options.on_progress(progress)
            if show is not None:
                show(progress if pictured is None else replace(progress, film=pictured(progress.film)))

        yield replace(options, on_progress=both)
