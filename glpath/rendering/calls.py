"""`glpath.render` and `glpath.render_frames`."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glpath.buffers.shadow_buffer import ShadowTest
from glpath.errors import SceneWarning, UsageError
from glpath.film import Film, FilmMetadata
from glpath.gl.context import Context, get_context
from glpath.integrators.gather import Lookup
from glpath.integrators.path_stages import Directions, PathSetSettings
from glpath.integrators.whitted import Secondary, Shadows, WhittedSettings
from glpath.progress import Progress, Report, reporting
from glpath.rendering.factory import DEFAULT_SPP, Engine, Integrator, Plan, plan
from glpath.rendering.interrupts import RenderInterrupted
from glpath.rendering.loop import Clock, trace
from glpath.rendering.options import check_count, window_of, with_overrides
from glpath.rendering.tiles import cover
from glpath.sampling import Sampling
from glpath.scene import Camera, Scene, check_camera, check_scene, load_scene
from glpath.versions import versions

if TYPE_CHECKING:
    from glpath.radiosity.solution import RadiositySolution


def render(
    scene: str | Path | Scene,
    *,
    integrator: Integrator = "path",
    spp: int | None = None,
    first_path_set: int = 0,
    max_depth: int | None = None,
    seed: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | None = None,
    parameters: Mapping[str, object] | None = None,
    sampling: Sampling | None = None,
    directions: Directions | None = None,
    ambient: float | Sequence[float] | None = None,
    roulette: int | None = None,
    radiosity: RadiositySolution | str | Path | None = None,
    radiosity_lookup: Lookup | None = None,
    shadows: Shadows | None = None,
    shadow_resolution: int | None = None,
    shadow_test: ShadowTest | None = None,
    shadow_filter: int | None = None,
    secondary: Secondary | None = None,
    count_tests: bool = False,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
    progress: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> Film:
    """Render a scene: global illumination with the path-buffer, or ray tracing with lights without extent.

    Parameters
    ----------
    scene          : a file, the name of a shipped scene, or a `Scene`
    integrator     : "path", global illumination by shapes that emit light; "gather", the same from a radiosity
                     solution, whose light of all bounces is gathered at what the eye sees; "t-buffer", Whitted's
                     ray tracing with the T-buffer, for spheres, planes, point lights, textures and mirrors;
                     "classic", the same picture by the classical algorithm, every ray against every object
    spp            : path sets, that is samples per pixel; by default 256, and 16 of a ray tracer, whose samples
                     differ only in their place in the pixel: a single one goes through its centre
    first_path_set : number of the first one; a render of 32 from 32 on merges with one of 32 from 0 on, and is then
                     bit for bit the render of 64
    max_depth      : vertices of a path: 1 is direct light only, 3 two bounces (of a ray tracer: reflections); 5.
                     Of a gather, the vertex at which the solution is looked up; 2, and more where the coarse
                     solution shows in corners
    seed           : another seed is another, independent render
    resolution     : (width, height) in pixels instead of the scene's
    crop           : (x, y, width, height): only these pixels of the whole picture, y from the top
    camera         : what to replace of the camera: position, target, up, fov (vertical, degrees)
    parameters     : of a generated scene
    backend, device, require_gpu : see `glpath.gl.context.get_context`
    timings        : time each stage (`film.metadata.statistics["stage_ms"]`); slows the render down
    progress       : show how far it is: in a notebook the picture itself as it converges, else a line on stderr
    on_progress    : called about twice a second, with a `Progress`

    Of "path" and "gather" only:

    sampling       : "sobol", or "random" as in the paper
    directions     : "pair", each path the better of two; "hemisphere", one, quicker for meshes of very many
                     triangles; "sphere", as in the paper

    Of "path" only:

    ambient        : radiance, W sr^-1 m^-2, assumed beyond the last vertex; a number or (r, g, b)
    roulette       : from this vertex on, paths end by chance, without bias

    Of "gather" only:

    radiosity      : a `RadiositySolution` of the scene (whatever its camera), or the file of one; None: the scene
                     is solved first, see `solve_radiosity`; by Monte Carlo from 4000 triangles on
    radiosity_lookup : "interpolated" between the vertices of an element, or "constant" over it

    Of "t-buffer" and "classic" only:

    shadows        : "rays", exact; "sphere" or "cube", looked up in shadow-buffers, of the paper or on six faces
    shadow_resolution : of these: rows of a sphere's (twice as many columns), texels along a cube's side; 1024
    shadow_test    : "distance", or "identity" as in the paper, wrong where an object shadows itself
    shadow_filter  : cells across that a lookup asks, for smooth edges; 2, and 1 for the nearest alone, as in the
                     paper
    secondary      : reflections and shadow rays: by a "hierarchy" of boxes (of "t-buffer"), or every object in
                     turn, "classic", as in the paper (of "classic")
    count_tests    : count intersection tests (`film.metadata.statistics["intersection_tests"]`); slower

    Raises
    ------
    SceneError, UsageError, ContextError : before anything is rendered
    RenderInterrupted : on Ctrl-C, with the film so far

    Warns `SceneWarning` for a scene that can be rendered, but hardly as it is meant.

    Poor at: mirrors and caustics by "path" and "gather" (all paths share their directions); indirect light by the
    ray tracers.

    Example
    -------
    >>> import glpath
    >>> film = glpath.render("cornell-box", spp=4, max_depth=2, resolution=(96, 64))
    >>> film.mean.shape, film.path_sets
    ((64, 96, 3), 4)
    >>> film.save("cornell-box.png")
    """
    options = {
        "sampling": sampling,
        "directions": directions,
        "ambient": ambient,
        "roulette": roulette,
        "radiosity": radiosity,
        "radiosity_lookup": radiosity_lookup,
        "shadows": shadows,
        "shadow_resolution": shadow_resolution,
        "shadow_test": shadow_test,
        "shadow_filter": shadow_filter,
        "secondary": secondary,
        "count_tests": count_tests or None,
    }
    planned = plan(integrator, max_depth, seed, options)
    spp = DEFAULT_SPP[integrator] if spp is None else spp
    check_count("spp", spp, 1, 2**29 - 256)  # a Sobol sequence of 30 bits ends at 2**30
    check_count("first_path_set", first_path_set, 0, 2**29)
    loaded = with_overrides(load_scene(scene, parameters), resolution, camera)
    window = window_of(loaded, crop)
    for text in check_scene(loaded) + planned.warnings(loaded):
        warnings.warn(text, SceneWarning, stacklevel=2)
    traced = planned.traceable(loaded)
    context = get_context(backend, device, require_gpu)
    film = Film.empty(_metadata(loaded, integrator, planned.settings, window, context))
    with _reporting(progress, on_progress) as report:
        clock = Clock(film, spp, context.info.renderer, report)
        planned = _prepared(planned, traced, clock)
        film.metadata = _metadata(loaded, integrator, planned.settings, window, context)
        clock.report("compiling shaders")
        parts = cover(window, context.gl.info["GL_MAX_TEXTURE_SIZE"])
        engine = planned.engine(context, traced, parts[0].window, timings)
        trace(engine, parts, clock, first_path_set)
    for text in planned.remarks(film):
        warnings.warn(text, SceneWarning, stacklevel=2)
    return film


def render_frames(
    scene: str | Path | Scene,
    frames: Iterable[Mapping[str, Any] | Camera | Scene],
    *,
    integrator: Integrator = "t-buffer",
    spp: int | None = None,
    max_depth: int | None = None,
    seed: int = 0,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    sampling: Sampling | None = None,
    directions: Directions | None = None,
    ambient: float | Sequence[float] | None = None,
    roulette: int | None = None,
    radiosity: RadiositySolution | str | Path | None = None,
    radiosity_lookup: Lookup | None = None,
    shadows: Shadows | None = None,
    shadow_resolution: int | None = None,
    shadow_test: ShadowTest | None = None,
    shadow_filter: int | None = None,
    secondary: Secondary | None = None,
    count_tests: bool = False,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    timings: bool = False,
) -> Iterator[Film]:
    """Render a film of films: one scene from several cameras, or as its lights and objects move.

    Shaders, objects, shadow-buffers and a radiosity solution stay on the device from frame to frame. The ray
    tracers fill a shadow-buffer again only where its light or an object has moved [TB III.D]; a gather takes any
    number of views from one solution [PB 4].

    frames : of each, what to replace of the scene's camera, as a mapping as in `render` or a `Camera`; or a whole
             `Scene` with a camera of its own, which for "path" and "gather" is all that may be new in it. All have
             the resolution of the first

    The other parameters are those of `render`. Yields a `Film` a frame, with its own time and counts.

    Example
    -------
    >>> walk = [{"position": (x, -10.0, 3.0)} for x in (-1.0, 0.0, 1.0)]
    >>> films = render_frames("three-spheres", walk, shadows="cube", spp=1, resolution=(64, 48))
    >>> [film.mean.shape for film in films]
    [(48, 64, 3), (48, 64, 3), (48, 64, 3)]

    Raises what `render` raises.
    """
    options = {
        "sampling": sampling,
        "directions": directions,
        "ambient": ambient,
        "roulette": roulette,
        "radiosity": radiosity,
        "radiosity_lookup": radiosity_lookup,
        "shadows": shadows,
        "shadow_resolution": shadow_resolution,
        "shadow_test": shadow_test,
        "shadow_filter": shadow_filter,
        "secondary": secondary,
        "count_tests": count_tests or None,
    }
    planned = plan(integrator, max_depth, seed, options)
    spp = DEFAULT_SPP[integrator] if spp is None else spp
    check_count("spp", spp, 1, 2**29 - 256)
    base = with_overrides(load_scene(scene, parameters), resolution, None)
    context = get_context(backend, device, require_gpu)
    engine: Engine | None = None
    size = (0, 0)
    for frame in frames:
        started = time.perf_counter()
        shown = _frame_scene(base, frame)
        window = window_of(shown, None)
        parts = cover(window, context.gl.info["GL_MAX_TEXTURE_SIZE"])
        if engine is None:
            for text in check_scene(shown) + planned.warnings(shown):
                warnings.warn(text, SceneWarning, stacklevel=2)
            traced = planned.traceable(shown)
            planned = planned.prepared(traced, lambda text: None)
            engine, size = planned.engine(context, traced, parts[0].window, timings), shown.camera.resolution
        elif shown.camera.resolution != size:
            raise UsageError(
                f"render_frames: a frame of {shown.camera.resolution} pixels after {size}",
                "All frames have one resolution.",
            )
        elif isinstance(frame, Scene):
            planned.change_scene(engine, planned.traceable(shown))
        else:
            engine.move_camera(shown.camera)
        engine.forget_statistics()
        film = Film.empty(_metadata(shown, integrator, planned.settings, window, context))
        clock = Clock(film, spp, context.info.renderer, None, started=started)
        trace(engine, parts, clock, 0)
        yield film


@contextmanager
def _reporting(shown: bool, on_progress: Report | None) -> Iterator[Report | None]:
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


def _prepared(planned: Plan, scene: Scene, clock: Clock) -> Plan:
    """What takes long before the first path set, with word of it. Raises RenderInterrupted."""
    started = time.perf_counter()
    try:
        prepared = planned.prepared(scene, clock.report)
    except KeyboardInterrupt:
        raise RenderInterrupted(clock.film) from None
    if prepared is not planned:
        clock.statistics["radiosity_s"] = time.perf_counter() - started
    return prepared


def _frame_scene(base: Scene, frame: Mapping[str, Any] | Camera | Scene) -> Scene:
    if isinstance(frame, Scene):
        return frame
    if isinstance(frame, Camera):
        check_camera(frame, base.source or base.name)
        return replace(base, camera=frame)
    return with_overrides(base, None, frame)


def _metadata(
    scene: Scene,
    integrator: str,
    settings: PathSetSettings | WhittedSettings,
    window: tuple[int, int, int, int],
    context: Context,
) -> FilmMetadata:
    others: dict[str, Any] = settings.as_dict()
    return FilmMetadata(
        scene=scene.name,
        scene_hash=scene.digest(),
        integrator=integrator,
        seed=int(others.pop("seed")),
        max_depth=int(others.pop("max_depth")),
        settings=others,
        full_resolution=scene.camera.resolution,
        window=window,
        device=context.info.renderer,
        versions=versions("glpath", "moderngl", "numpy", "scipy") | {"driver": context.info.driver},
    )
