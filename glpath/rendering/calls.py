"""`glpath.render` and `render_frames`, which describe jobs and run them, and `run`, for a job that is there."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, Unpack

from glpath.errors import UsageError, warn
from glpath.film.film import Film
from glpath.gl.context import Context
from glpath.integrators.by_name import Integrator
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene
from glpath.rendering.job import RenderJob, SceneSource, describe, with_overrides
from glpath.rendering.options import RenderKeywords, check_word, strictly, with_options
from glpath.rendering.progress import Progress, reporting
from glpath.rendering.run_options import RunKeywords, RunOptions
from glpath.rendering.session import Session
from glpath.scene import Camera, Scene, check_camera
from glpath.sensors.sensor import CameraSensor, PointSensor
from glpath.system.reporting import MODES
from glpath.system.time_limit import lift_limit, limited


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
    """Render a scene: global illumination by paths or from a radiosity solution, or Whitted's ray tracing.

    Parameters
    ----------
    scene          : a file, the name of a shipped scene, a dictionary, trimesh's mesh or scene, a `Scene`: what
                     `load_scene` takes
    integrator     : "auto", that of the next three which shows the scene clean soonest, see
                     `glpath.rendering.choice`; "path", global illumination by every kind of light, by paths whose
                     rays a BVH in the shader casts; "path-buffer", the same by paths that share directions, all
                     rays of which one scan of the scene casts; "gather", from a radiosity solution, whose light of
                     all bounces is gathered at what the eye sees; "t-buffer", Whitted's ray tracing with the
                     T-buffer, for spheres, planes, point lights, textures and mirrors; "classic", the same image
                     by the classical algorithm, every ray against every object. Or an instance of its settings out
                     of `glpath.integrators.by_name`
    spp            : path sets, that is samples per pixel;
                     default {default_spp}; no end to them with `time_limit` or `noise`.
                     Samples of a ray tracer differ only in their position in the pixel: a single one goes through
                     its centre
    first_path_set : number of the first one; a render of 32 from 32 on merges with one of 32 from 0 on, and is then
                     bit for bit the render of 64
    resolution     : (width, height) in pixels instead of the scene's
    crop           : (x, y, width, height): only these pixels of the whole image, y from the top
    camera         : what to replace of the camera: look_at, the name of a shape that is to fill the picture;
                     position, target, up, fov (vertical, degrees); type
                     ("perspective", "orthographic" with a height, "panorama"), aperture_radius and
                     focus_distance of a lens, shutter (opens, closes; seconds), principal_point, pixel_aspect. A
                     new position ends its motion. Or a whole `glpath.scene.Camera`, instead of the scene's, as
                     `glpath.camera` makes of matrices
    parameters     : of a generated scene
    {run_options}
    {options}

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered; ContextError also where the device fails
    TimeLimitError : if the time limit is over more than a second before the first path set
    RenderInterrupted : on Ctrl-C, with the film so far

    Warns `SceneWarning` for a scene that can be rendered, but hardly as it is meant.

    Poor at: caustics of mirrors and glass by "path", "path-buffer" and "gather"; indirect light by the ray
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
    """The film of a job: what `render` gives for the arguments that the job was made of.

    Parameters
    ----------
    context : instead of one of `backend` and `device`
    scene   : what the job describes, where that was made in memory, or has been loaded already
    sensor  : the points of a job that is of points and has come from JSON, which holds none
    The others are as of `render`

    Raises and warns as `render` does; SceneError for a scene whose content is not the job's.

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
            raise UsageError("sensor: points for a job whose paths start at a camera.")
        job = replace(job, sensor=job.sensor.given(sensor.points))

    def film() -> Film:
        return run_job(job, job.seen(scene), RunOptions(**options), context)

    return strictly(film) if job.strict else film()


def run_job(
    job: RenderJob,
    scene: Scene,
    options: RunOptions,
    context: Context | None = None,
    pictured: Callable[[Film], Film] | None = None,
) -> Film:
    """The film of a job whose scene is loaded: all renders come through here, those of a cluster too.

    pictured : what `progress` shows of a film that is no picture
    """
    with limited(options.time_limit):
        if options.cluster is not None:
            with reporting_to(options, pictured) as reported:
                film = options.cluster.render(job, scene, replace(reported, cluster=None))
            lift_limit()
            return film
        session = Session(job, scene, options, context=context)
        with session, reporting_to(options, pictured) as reported:
            film = session.render(job, scene, reported)
        lift_limit()
    warn_about(film, session)
    return film


def warn_about(film: Film, session: Session) -> None:
    """Warn of a film that the session has rendered; `strict` takes that for an error when the film is saved."""
    for text in session.remarks(film):
        warn(text, late=True)


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
    """Render a film of films: one scene from several cameras, or as its lights and objects move.

    Shaders, objects, shadow-buffers and a radiosity solution stay on the device from frame to frame. The ray
    tracers fill a shadow-buffer again only where its light or an object has moved [TB III.D]; a gather takes any
    number of views from one solution [PB 4].

    frames : of each, what to replace of the scene's camera, as a mapping as in `render` or a `Camera`; or a whole
             `Scene` with a camera of its own, which for "path", "path-buffer" and "gather" is all that may be new
             in it. All have the resolution of the first

    The other parameters are those of `render`, of each frame: each ends by its own `noise` or `time_limit`. Yields
    a `Film` a frame, with its own time and counts.

    Example
    -------
    >>> walk = [{"position": (x, -10.0, 3.0)} for x in (-1.0, 0.0, 1.0)]
    >>> films = render_frames("three-spheres", walk, shadows="cube", spp=1, resolution=(64, 48))
    >>> [film.mean.shape for film in films]
    [(48, 64, 3), (48, 64, 3), (48, 64, 3)]

    Raises what `render` raises.
    """
    run_options, chosen = RunOptions.taken_from(options)
    if run_options.film is not None:
        raise UsageError(
            "film: of a single render, but each frame has its own.", "Render the frames that are missing."
        )
    job, base = describe(
        scene,
        integrator=integrator,
        spp=run_options.spp(spp),
        resolution=resolution,
        parameters=parameters,
        **chosen,
    )
    workers = run_options.cluster
    with ExitStack() as until_done:
        session: Session | None = None
        for frame in frames:
            with limited(run_options.time_limit, anew=True), reporting_to(run_options) as reported:
                shown = _frame_scene(base, frame)
                job = replace(
                    job,
                    scene=SceneSource.of(frame, frame, None) if isinstance(frame, Scene) else job.scene,
                    sensor=CameraSensor.of(shown.camera),
                    window=(0, 0, *shown.camera.resolution),
                )
                if workers is None and (session is None or not session.follows(job, shown)):
                    until_done.close()  # what is on the device is of no use for another scene
                    session = until_done.enter_context(Session(job, shown, run_options))
                if session is not None:
                    film = session.render(job, shown, reported)
                    warn_about(film, session)
                elif workers is not None:
                    film = workers.render(job, shown, replace(reported, cluster=None))
            yield film


def _frame_scene(base: Scene, frame: Mapping[str, Any] | Camera | Scene) -> Scene:
    if isinstance(frame, Scene):
        return frame
    if isinstance(frame, Camera):
        check_camera(frame, base.source or base.name)
        return replace(base, camera=frame)
    return with_overrides(base, None, frame)


@contextmanager
def reporting_to(options: RunOptions, pictured: Callable[[Film], Film] | None = None) -> Iterator[RunOptions]:
    """The options, whose `on_progress` reports to the user, to the caller's function, to both or to nobody."""
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
