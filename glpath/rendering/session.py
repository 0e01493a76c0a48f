"""Session with an engine that stays on the device for several jobs of one integrator and resolution."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from glpath.errors import ContextError, TimeLimitError, UsageError, argument, warn
from glpath.film.aovs import DENOISER_AOVS, ID_AOVS, guides_denoiser
from glpath.film.bias import BIAS_PROBE, REJECTED_GATHER
from glpath.film.choices import TIME_LIMIT
from glpath.film.denoise import require_denoiser
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata, joined, merged_values
from glpath.gl.context import Context
from glpath.gl.memory import out_of_memory_remedy
from glpath.integrators.engine import Engine
from glpath.rendering.bias import BiasCheck, BiasProbe
from glpath.rendering.factory import UNGUIDED, Plan, plan_of, sensor_in
from glpath.rendering.interrupts import interrupt_as_flag
from glpath.rendering.job import RenderJob
from glpath.rendering.loop import Clock, trace
from glpath.rendering.resume import check_same_render
from glpath.rendering.run_options import RunOptions
from glpath.rendering.tiles import Tile, cover
from glpath.scene import Scene, check_scene
from glpath.sensors.sensor import CameraSensor
from glpath.system.machine import return_memory
from glpath.system.time_limit import count_earlier, counted_from, named_work, preparing
from glpath.system.versions import versions


class Session:
    """Renderer of several jobs, one after another, on one engine.

    Data on the device, such as shadow-buffers, are kept for the next job until the end of `with session:`. Sessions
    in several threads take turns, job by job.

    The constructor takes the first job and its scene, which must have the camera of the job. It finds errors in
    the job and the scene before it opens a device. Raises SceneError for a scene that the engine does not support,
    ContextError if no device is available. Warns SceneWarning of a scene that is not rendered as intended.

    options : run options; their device and `timings` apply to all jobs
    context : existing context; None: the session opens the device of `options`
    plan    : prepared plan of the job's integrator, whose bias was checked; None: the session makes a plan, and
              checks its bias
    """

    def __init__(
        self,
        job: RenderJob,
        scene: Scene,
        options: RunOptions,
        *,
        context: Context | None = None,
        plan: Plan | None = None,
    ) -> None:
        self._job = job
        self._plan = checked_plan(job, scene) if plan is None else plan
        self._checks_bias = plan is None  # the bias of a given plan was checked before
        self._probe: BiasProbe | None = None
        with preparing():
            self._traced = self._plan.traceable(scene)
        self._engine: Engine | None = None
        self._tiles: list[Tile] = []
        self._timings = options.timings
        self._context = context or options.context()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the engine's data on the device, and return freed memory to the system.

        The next render makes a new engine.
        """
        engine, self._engine, self._probe = self._engine, None, None
        if engine is not None:
            # If another thread keeps the context, entering the context raises ContextError, and that thread frees
            # the memory later. The error is suppressed, because it would discard a finished film.
            with suppress(ContextError), self._context:
                engine.close()
                del engine
                return_memory()

    def render(self, job: RenderJob, scene: Scene, options: RunOptions) -> Film:
        """Render a job and return its film.

        The first call renders the job of the constructor. Later jobs need the same integrator and resolution.

        scene : scene of the job, with the job's camera

        Raises RenderInterrupted after an interrupt, and UsageError for another resolution or a film of another
        render. Raises ContextError if the device fails, TimeLimitError if the time limit is over before the first
        path set.
        """
        context = self._context
        context.check()
        prepared = self._engine is not None
        if not prepared:
            self._plan = self._plan.resumed(options.film)
        clock = begin(job, self._plan, scene, options, context, prepared=prepared)
        if clock.ended_before():
            return clock.film
        try:
            if not prepared:
                self._plan = prepare(job, self._plan, scene, self._traced, clock)
            _name_both(clock.film, context)
            with context.rendering():
                trace(self._made_engine(job, scene, clock), context, self._tiles, clock, job.path_sets)
        except TimeLimitError:
            if not clock.film.path_sets:
                raise
            clock.end_as_begun(TIME_LIMIT)
        return clock.film

    def _made_engine(self, job: RenderJob, scene: Scene, clock: Clock) -> Engine:
        """Return the engine for a job: the existing one switched to the job, or a new one of the prepared plan.

        The bias of the engine is checked, see `_with_small_bias`.
        """
        began = time.perf_counter()
        if self._engine is None:
            clock.report("compiling shaders")
            # A tile is at most half as wide and high as the largest texture, because a scan of the path-buffer has
            # two views side by side.
            self._tiles = cover(job.window, self._context.gl.info["GL_MAX_TEXTURE_SIZE"] // 2)
            with self._context as context, named_work("making the engine"):
                sensor = sensor_in(self._traced, job.sensor, scene)
                window = self._tiles[0].window
                engine = self._plan.engine(context, self._traced, sensor, window, self._timings)
                self._engine = engine.prepare()
        else:
            with self._context:
                self._continue_with(self._engine, job, scene)
        self._job = job
        return self._with_small_bias(self._engine, clock, job, scene, time.perf_counter() - began)

    def _with_small_bias(
        self, engine: Engine, clock: Clock, job: RenderJob, scene: Scene, engine_s: float
    ) -> Engine:
        """Return the engine, or an engine of another plan if its bias is too large.

        The bias is not measured again if the film's statistics have it.

        engine_s : time to make the engine, seconds
        """
        known = {BIAS_PROBE, REJECTED_GATHER} & {*clock.film.metadata.statistics}
        if known or not (self._checks_bias and self._plan.settings.biased):
            return engine
        sensor = sensor_in(self._traced, job.sensor, scene)
        with interrupt_as_flag() as interrupted:
            check = BiasCheck(
                self._context,
                self._traced,
                sensor,
                self._tiles[0].window,
                self._timings,
                clock.report,
                interrupted,
                engine_s,
                probe=self._probe,
            )
            try:
                plan, settled = check.settle(self._plan, engine)
            except KeyboardInterrupt:
                raise clock.interruption(interrupted.signal) from None
            self._plan, self._engine, self._probe = plan, settled, check.probe
        if interrupted:  # the check does not test the flag while it replaces an engine
            raise clock.interruption(interrupted.signal)
        clock.statistics |= check.statistics or {}
        describe_plan(clock.film, metadata_of(job, plan, scene, None))
        return settled

    def follows(self, job: RenderJob, scene: Scene) -> bool:
        """Return True if the engine can also render `job`.

        scene : scene of the job, with the job's camera
        """
        before = self._job
        same = before.sensor.kind == job.sensor.kind and before.integrator == job.integrator
        return same and (job.integrator.any_scene or not _differs(before, job, scene))

    def warn_about(self, film: Film) -> None:
        """Give the warnings about a film that the session has rendered, see `warn_about`."""
        warn_about(film, self._plan)

    def _continue_with(self, engine: Engine, job: RenderJob, scene: Scene) -> None:
        """Switch the engine to a further job with another camera or scene."""
        before = self._job
        if job.sensor.resolution != before.sensor.resolution or job.window != before.window:
            raise UsageError(
                f"render_frames: a frame of {job.sensor.resolution} pixels after {before.sensor.resolution}",
                "All frames have one resolution.",
            )
        assert job.integrator == before.integrator, "another integrator needs another session"
        if _differs(before, job, scene):
            self._traced = self._plan.traceable(scene)
            self._plan.change_scene(engine, self._traced)
        else:
            engine.look_from(sensor_in(self._traced, job.sensor, scene))
        engine.forget_statistics()


def warn_about(film: Film, plan: Plan) -> None:
    """Give the warnings about a film, unless it has no path sets; those that are errors are raised at the end."""
    for text in remarks_of(plan, film) if film.path_sets else ():
        warn(text, late=True)


def remarks_of(plan: Plan, film: Film) -> list[str]:
    """Return the warnings about a rendered film: those of the plan, and one if samples were invalid."""
    dropped = film.metadata.statistics.get("dropped_samples", 0)
    text = f"{film.metadata.scene}: {dropped} samples were NaN or infinite and count as 0."
    return plan.remarks(film) + [text] * (dropped > 0)


def _differs(before: RenderJob, job: RenderJob, scene: Scene) -> bool:
    """Return True if a job has another scene than the job before, or moving shapes and other shutter times."""
    moved = before.sensor.shutter != job.sensor.shutter and any(shape.motion is not None for shape in scene.shapes)
    return moved or job.scene.sha256 != before.scene.sha256


def checked_plan(job: RenderJob, scene: Scene) -> Plan:
    """Return the plan of a job's integrator. Warns of a scene that is not rendered as intended."""
    plan = plan_of(job.integrator)
    with preparing():
        texts = check_scene(scene, isinstance(job.sensor, CameraSensor)) + plan.warnings(scene)
    for text in texts:
        warn(text)
    return plan


def begin(
    job: RenderJob,
    plan: Plan,
    scene: Scene,
    options: RunOptions,
    context: Context | None,
    *,
    prepared: bool,
) -> Clock:
    """Return the clock of a render that resumes the film in `options`, or begins a new film if that is None.

    context  : device context; None if workers render the job
    prepared : True if the plan is prepared. Otherwise the digest of its radiosity solution is not known yet, and is
               not compared with that of the film

    Raises AnotherRenderError if the film belongs to another render. Raises ContextError if memory for a film cannot
    be allocated.
    """
    if options.clean is not None:
        _check_denoisable(job)
    with preparing():
        metadata = metadata_of(job, plan, scene, context)
    film = options.film
    if film is None:
        film = empty_film(metadata)
    else:
        check_same_render(film, metadata, job.path_sets, set() if prepared else {"settings.radiosity"})
        # Path sets do not depend on these fields, which may have changed since the film was begun. The rule that
        # ended the earlier run must not count as the end of this one.
        film.metadata = replace(
            film.metadata,
            scene=metadata.scene,
            unit=metadata.unit,
            exposure=metadata.exposure,
            pixel_aspect=metadata.pixel_aspect,
            shape_names=metadata.shape_names,
            material_names=metadata.material_names,
            stop_rule="",
            error_bound=None,
        )
    count_earlier(film.metadata.elapsed_s)
    renderer = "" if context is None else context.info.renderer
    return Clock(film, job.spp, renderer, options, started=counted_from())


def _check_denoisable(job: RenderJob) -> None:
    """Raise UsageError for a film that cannot be denoised, GlpathError if the denoiser is missing."""
    if not guides_denoiser(job.integrator.aovs):
        raise UsageError(
            "clean: of a film without the AOVs albedo and normal, which the denoiser needs.",
            f"Render with {argument('aovs', DENOISER_AOVS)}, or end by `noise`.",
        )
    require_denoiser()


def prepare(job: RenderJob, plan: Plan, scene: Scene, traced: Scene, clock: Clock) -> Plan:
    """Prepare the plan, update the metadata of the clock's film, and return the prepared plan.

    The clock reports the work.

    Raises RenderInterrupted after an interrupt, and AnotherRenderError if the film belongs to another render.
    """
    started = time.perf_counter()
    try:
        prepared = plan.prepared(traced, clock.report)
    except KeyboardInterrupt:
        raise clock.interruption() from None
    if prepared is not plan:
        clock.statistics["radiosity_s"] = time.perf_counter() - started
    if getattr(plan.settings, "guided", False) and not getattr(prepared.settings, "guided", False):
        clock.statistics[UNGUIDED] = 1
    film, metadata = clock.film, metadata_of(job, prepared, scene, None)
    if film.path_sets:
        check_same_render(
            film,
            replace(metadata, device=film.metadata.device, versions=film.metadata.versions),
            job.path_sets,
            set(),
        )
    describe_plan(film, metadata)
    return prepared


def describe_plan(film: Film, metadata: FilmMetadata) -> None:
    """Copy the fields that a plan determines, such as the integrator, from `metadata` to a film's metadata."""
    film.metadata = replace(
        film.metadata,
        integrator=metadata.integrator,
        max_depth=metadata.max_depth,
        settings=metadata.settings,
        biased=metadata.biased,
        solution_error=metadata.solution_error,
    )


def _name_both(film: Film, context: Context) -> None:
    """Add this device, its driver and the versions of the libraries to the metadata of a resumed film."""
    held = film.metadata
    film.metadata = replace(
        held,
        device=joined(held.device, context.info.renderer),
        versions=merged_values(held.versions, _versions(context)),
    )


def _versions(context: Context | None) -> dict[str, str]:
    here = versions("glpath", "moderngl", "numpy", "scipy")
    return here if context is None else here | {"driver": context.info.driver}


def empty_film(metadata: FilmMetadata) -> Film:
    """Return an empty film. Raises ContextError if its memory cannot be allocated."""
    try:
        return Film.empty(metadata)
    except MemoryError as error:
        _, _, width, height = metadata.window
        raise ContextError(
            f"film of {width} x {height} pixels: {str(error).rstrip('.') or 'this machine has no memory for it'}.",
            out_of_memory_remedy(),
        ) from error


def metadata_of(job: RenderJob, plan: Plan, scene: Scene, context: Context | None) -> FilmMetadata:
    """Return the metadata of a job's film. The scene must have the job's camera.

    context : device context; None: without device and driver, such as for a render by workers
    """
    return FilmMetadata(
        scene=scene.name,
        scene_hash=scene.digest(),
        integrator=plan.settings.integrator,
        seed=plan.settings.seed,
        max_depth=plan.recorded().get("max_depth"),
        settings=_recorded(job, plan),
        full_resolution=job.sensor.resolution,
        window=job.window,
        pixel_aspect=job.sensor.pixel_aspect if isinstance(job.sensor, CameraSensor) else 1.0,
        noisy=plan.settings.noisy,
        biased=plan.settings.biased,
        exposure=scene.exposure,
        transparent=is_transparent(job, scene),
        unit=scene.unit,
        aovs=job.integrator.aovs,
        **_names(job, scene),
        **_position_origin(job, scene),
        # The solution's error was estimated for the image of the camera, so it does not apply to a gather at
        # points.
        solution_error=plan.solution_error() if isinstance(job.sensor, CameraSensor) else None,
        device="" if context is None else context.info.renderer,
        versions=_versions(context),
    )


def is_transparent(job: RenderJob, scene: Scene) -> bool:
    """Return True if the scene's background is transparent, and the job has the AOV depth that this needs."""
    wanted = scene.background is not None and scene.background.transparent
    return wanted and "depth" in job.integrator.aovs


def _names(job: RenderJob, scene: Scene) -> dict[str, Any]:
    """Return the metadata fields with names of shapes and materials; empty if the film has no AOV of ids."""
    if set(ID_AOVS).isdisjoint(job.integrator.aovs):
        return {}
    return {
        "shape_names": tuple(shape.name for shape in scene.shapes),
        "material_names": tuple(material.name for material in scene.materials),
        "shape_materials": tuple(int(shape.material) for shape in scene.shapes),
    }


def _position_origin(job: RenderJob, scene: Scene) -> dict[str, Any]:
    """Return the metadata field `position_origin`.

    The result is empty if the film has no AOV position, or its positions are relative to the world's origin.
    """
    if "position" not in job.integrator.aovs or not scene.centred.origin.any():
        return {}
    return {"position_origin": tuple(scene.centred.origin.tolist())}


def _recorded(job: RenderJob, plan: Plan) -> dict[str, Any]:
    """Return the settings that determine the image, without those in separate metadata fields."""
    return {k: v for k, v in (plan.recorded() | job.sensor.recorded()).items() if k not in ("seed", "max_depth")}
