"""`glpath.render` and `render_frames`, which describe jobs and run them, and `run`, for a job that is there."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

from glpath.errors import UsageError, warn
from glpath.film.film import Film
from glpath.gl.context import Context, open_context
from glpath.integrators.settings import Integrator, IntegratorSettings
from glpath.io import AnyScene
from glpath.rendering.job import RenderJob, SceneSource, describe, with_overrides
from glpath.rendering.options import MAX_SPP, with_options
from glpath.rendering.progress import Progress, Report, reporting
from glpath.rendering.session import Session
from glpath.rendering.stopping import StopRules
from glpath.scene import Camera, Scene, check_camera
from glpath.sensors.sensor import CameraSensor, PointSensor
from glpath.system.interactive import in_notebook


@with_options
def render(
    scene: AnyScene,
    *,
    integrator: Integrator | IntegratorSettings = "path",
    spp: int | None = None,
    first_path_set: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | Camera | None = None,
    parameters: Mapping[str, object] | None = None,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    time_limit: float | None = None,
    noise: float | None = None,
    film: Film | None = None,
    on_step: Callable[[Film], None] | None = None,
    timings: bool = False,
    progress: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    **options: Any,
) -> Film:
    """Render a scene: global illumination by paths or from a radiosity solution, or Whitted's ray tracing.

    Parameters
    ----------
    scene          : a file, the name of a shipped scene, a dictionary, trimesh's mesh or scene, a `Scene`: what
                     `load_scene` takes
    integrator     : "path", global illumination by every kind of light, by paths whose rays a BVH in the shader
                     casts; "path-buffer", the same by paths that share directions, all rays of which one scan of
                     the scene casts; "gather", from a radiosity solution, whose light of all bounces is gathered
                     at what the eye sees; "t-buffer", Whitted's
                     ray tracing with the T-buffer, for spheres, planes, point lights, textures and mirrors;
                     "classic", the same image by the classical algorithm, every ray against every object. Or an
                     instance of its settings out of `glpath.integrators.settings`
    spp            : path sets, that is samples per pixel;
                     default {default_spp}; no end to them with `time_limit` or `noise`.
                     Samples of a ray tracer differ only in their position in the pixel: a single one goes through
                     its centre
    first_path_set : number of the first one; a render of 32 from 32 on merges with one of 32 from 0 on, and is then
                     bit for bit the render of 64
    resolution     : (width, height) in pixels instead of the scene's
    crop           : (x, y, width, height): only these pixels of the whole image, y from the top
    camera         : what to replace of the camera: position, target, up, fov (vertical, degrees); type
                     ("perspective", "orthographic" with a height, "panorama"), aperture_radius and
                     focus_distance of a lens, shutter (opens, closes; seconds). A new place ends its motion. Or a
                     whole `glpath.scene.Camera`, in place of the scene's
    parameters     : of a generated scene
    backend, device, require_gpu : see `glpath.gl.context.open_context`
    time_limit     : end after so many seconds, those of `film` included, and at least one path set
    noise          : end when the relative error of the image, sqrt(mean(e² / (mean² + 0.01))) over pixels and
                     channels, is below this with 95 % confidence: see `Film.error_bound`. 0.02 is a fair picture,
                     0.005 a clean one. `film.metadata.stop_rule` says what ended the render; by any rule the film
                     has the bits of one of that `spp`. Poor at rare, bright events: nobody misses what was never
                     seen
    film           : a film that this render had begun, to go on with: path sets that it holds are not rendered
                     again. It is changed, and returned
    on_step        : called with the film after each step, of up to half a second or one path set; to save it, say
    timings        : time each stage (`film.metadata.statistics["stage_ms"]`); slows the render down
    progress       : show how far it is: in a notebook the image itself as it converges, else a line on stderr
    on_progress    : called about twice a second, with a `Progress`
    {options}

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered; ContextError also where the device fails
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
    rules = StopRules(time_limit, noise)
    job, loaded = describe(
        scene,
        integrator=integrator,
        spp=MAX_SPP if spp is None and rules else spp,
        first_path_set=first_path_set,
        resolution=resolution,
        crop=crop,
        camera=camera,
        parameters=parameters,
        **options,
    )
    session = Session(job, loaded)
    context = open_context(backend, device, require_gpu, probe_first=in_notebook())
    with session, reporting_to(progress, on_progress) as report:
        film = session.render(
            job, loaded, context, timings=timings, on_progress=report, rules=rules, film=film, on_step=on_step
        )
    for text in session.remarks(film):
        warn(text)
    return film


def run(
    job: RenderJob,
    context: Context | None = None,
    *,
    scene: Scene | None = None,
    sensor: PointSensor | None = None,
    time_limit: float | None = None,
    noise: float | None = None,
    film: Film | None = None,
    on_step: Callable[[Film], None] | None = None,
    timings: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> Film:
    """The film of a job: what `render` gives for the arguments that the job was made of.

    Parameters
    ----------
    context : None: the one of this process, see `glpath.gl.context.open_context`
    scene   : what the job describes, where that was made in memory, or has been loaded already
    sensor  : the points of a job that is of points and has come from JSON, which holds none
    time_limit, noise, film, on_step, timings, on_progress : as of `render`

    Raises and warns as `render` does; SceneError for a scene whose content is not the job's.

    Example
    -------
    >>> from glpath.rendering import RenderJob, run
    >>> job = RenderJob.of("cornell-box", spp=16, max_depth=1, resolution=(32, 32))
    >>> parts = [run(part) for part in job.split(2)]
    >>> parts[0].merge(parts[1]).path_sets
    16
    """
    rules = StopRules(time_limit, noise)
    if sensor is not None:
        if not isinstance(job.sensor, PointSensor):
            raise UsageError("sensor: points for a job whose paths start at a camera.")
        job = replace(job, sensor=job.sensor.given(sensor.points))
    loaded = job.seen(scene)
    session = Session(job, loaded)
    context = open_context(probe_first=in_notebook()) if context is None else context
    with session:
        film = session.render(
            job, loaded, context, timings=timings, on_progress=on_progress, rules=rules, film=film, on_step=on_step
        )
    for text in session.remarks(film):
        warn(text)
    return film


@with_options
def render_frames(
    scene: AnyScene,
    frames: Iterable[Mapping[str, Any] | Camera | Scene],
    *,
    integrator: Integrator | IntegratorSettings = "t-buffer",
    spp: int | None = None,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
    **options: Any,
) -> Iterator[Film]:
    """Render a film of films: one scene from several cameras, or as its lights and objects move.

    Shaders, objects, shadow-buffers and a radiosity solution stay on the device from frame to frame. The ray
    tracers fill a shadow-buffer again only where its light or an object has moved [TB III.D]; a gather takes any
    number of views from one solution [PB 4].

    frames : of each, what to replace of the scene's camera, as a mapping as in `render` or a `Camera`; or a whole
             `Scene` with a camera of its own, which for "path", "path-buffer" and "gather" is all that may be new
             in it. All have the resolution of the first

    The other parameters are those of `render`. Yields a `Film` a frame, with its own time and counts.

    Example
    -------
    >>> walk = [{"position": (x, -10.0, 3.0)} for x in (-1.0, 0.0, 1.0)]
    >>> films = render_frames("three-spheres", walk, shadows="cube", spp=1, resolution=(64, 48))
    >>> [film.mean.shape for film in films]
    [(48, 64, 3), (48, 64, 3), (48, 64, 3)]

    Raises what `render` raises.
    """
    job, base = describe(
        scene, integrator=integrator, spp=spp, resolution=resolution, parameters=parameters, **options
    )
    context = open_context(backend, device, require_gpu, probe_first=in_notebook())
    with ExitStack() as until_done:
        session: Session | None = None
        for frame in frames:
            started = time.perf_counter()
            shown = _frame_scene(base, frame)
            job = replace(
                job,
                scene=SceneSource.of(frame, frame, None) if isinstance(frame, Scene) else job.scene,
                sensor=CameraSensor.of(shown.camera),
                window=(0, 0, *shown.camera.resolution),
            )
            if session is None or not session.follows(job, shown):
                until_done.close()  # what is on the device is of no use for another scene
                session = until_done.enter_context(Session(job, shown))
            yield session.render(job, shown, context, timings=timings, started=started)


def _frame_scene(base: Scene, frame: Mapping[str, Any] | Camera | Scene) -> Scene:
    if isinstance(frame, Scene):
        return frame
    if isinstance(frame, Camera):
        check_camera(frame, base.source or base.name)
        return replace(base, camera=frame)
    return with_overrides(base, None, frame)


@contextmanager
def reporting_to(shown: bool, on_progress: Report | None) -> Iterator[Report | None]:
    """Whom to tell of the progress: the user, a function, both or nobody."""
    if not shown:
        yield on_progress
        return
    with reporting("auto", sys.stderr) as show:

        def both(progress: Progress) -> None:
            show(progress)
            if on_progress is not None:
                on_progress(progress)

        yield both
