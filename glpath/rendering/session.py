"""An engine that stays on the device while jobs of one integrator and one resolution pass through it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from glpath.errors import ContextError, UsageError, warn
from glpath.film.aovs import ID_AOVS
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata, joined, merged_values
from glpath.gl.context import Context
from glpath.gl.memory import OUT_OF_MEMORY
from glpath.integrators.engine import Engine
from glpath.rendering.factory import Plan, plan_of, sensor_in
from glpath.rendering.going_on import check_same_render
from glpath.rendering.interrupts import RenderInterrupted
from glpath.rendering.job import RenderJob
from glpath.rendering.loop import Clock, trace
from glpath.rendering.progress import Progress
from glpath.rendering.stopping import StopRules
from glpath.rendering.tiles import Tile, cover
from glpath.scene import Scene, check_scene
from glpath.sensors.sensor import CameraSensor
from glpath.system.machine import return_memory
from glpath.system.versions import versions


class Session:
    """Renders jobs one after another. What one of them leaves on the device, shadow-buffers too, serves the next,
    until the end of `with session:`. Sessions in several threads take turns, job by job.

    Made from the first job and its scene, with its camera; what is wrong with them is found here, before there is a
    context. Raises SceneError for a scene that the engine does not know; warns SceneWarning of one that it hardly
    renders as it is meant.

    plan : of the job's integrator, where somebody has prepared it already
    """

    def __init__(self, job: RenderJob, scene: Scene, plan: Plan | None = None) -> None:
        self._job = job
        self._plan = plan_of(job.integrator) if plan is None else plan
        seen = isinstance(job.sensor, CameraSensor)
        for text in check_scene(scene, seen) + self._plan.warnings(scene):
            warn(text)
        self._traced = self._plan.traceable(scene)
        self._engine: Engine | None = None
        self._tiles: list[Tile] = []
        self._context: Context | None = None

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free what is on the device, and give its memory back. The next render begins with a new engine."""
        engine, self._engine = self._engine, None
        if engine is not None and self._context is not None:
            # Where another thread keeps the context, it will do so: no reason to lose a film.
            with suppress(ContextError), self._context:
                engine.close()
                del engine
                return_memory()

    def render(
        self,
        job: RenderJob,
        scene: Scene,
        context: Context,
        *,
        timings: bool = False,
        on_progress: Callable[[Progress], None] | None = None,
        started: float | None = None,
        rules: StopRules | None = None,
        film: Film | None = None,
        on_step: Callable[[Film], None] | None = None,
    ) -> Film:
        """The film of a job: the first one, then others of its integrator and resolution.

        scene   : of the job, with its camera
        started : `time.perf_counter()` when the job was begun; now
        rules, film, on_step : as of `glpath.rendering.run`

        Raises RenderInterrupted, and UsageError for another resolution or a film of another render; ContextError
        where the device fails.
        """
        started = time.perf_counter() if started is None else started
        context.check()
        self._context = context
        metadata = metadata_of(job, self._plan, scene, context)
        if film is None:
            film = empty_film(metadata)
        else:
            # The digest of a radiosity solution is known only after it is made.
            check_same_render(
                film, metadata, job.path_sets, {"settings.radiosity"} if self._engine is None else set()
            )
            film.metadata = replace(film.metadata, unit=metadata.unit)  # which older files do not say
        clock = Clock(
            film, job.spp, context.info.renderer, on_progress, rules or StopRules(), on_step, started=started
        )
        if clock.ended_before():
            return film
        if self._engine is None:
            self._plan = _prepared(self._plan, self._traced, clock)
            metadata = metadata_of(job, self._plan, scene, context)
            if film.path_sets:
                check_same_render(film, metadata, job.path_sets, set())
            film.metadata = replace(
                film.metadata, settings=metadata.settings, solution_error=metadata.solution_error
            )
        _name_both(film, metadata)
        with context.rendering():
            if self._engine is None:
                clock.report("compiling shaders")
                # Half, as the two views of a scan lie side by side.
                self._tiles = cover(job.window, context.gl.info["GL_MAX_TEXTURE_SIZE"] // 2)
                with context:
                    sensor = sensor_in(self._traced, job.sensor, scene)
                    window = self._tiles[0].window
                    engine = self._plan.engine(context, self._traced, sensor, window, timings)
                    self._engine = engine.prepare()
            else:
                with context:
                    self._go_on(self._engine, job, scene)
            self._job = job
            trace(self._engine, context, self._tiles, clock, job.path_sets)
        return film

    def follows(self, job: RenderJob, scene: Scene) -> bool:
        """Whether the engine can go on with this job, of the same integrator; the scene has its camera."""
        before = self._job
        same = before.sensor.kind == job.sensor.kind
        return same and (job.integrator.any_scene or not _differs(before, job, scene))

    def remarks(self, film: Film) -> list[str]:
        """What is to be said of a film that is done."""
        return self._plan.remarks(film)

    def _go_on(self, engine: Engine, job: RenderJob, scene: Scene) -> None:
        """The engine for a further job: another camera, or another scene."""
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


def _differs(before: RenderJob, job: RenderJob, scene: Scene) -> bool:
    """Whether a job shows something else than the one before, not only otherwise: what moves is elsewhere."""
    moved = before.sensor.shutter != job.sensor.shutter and any(shape.motion is not None for shape in scene.shapes)
    return moved or job.scene.sha256 != before.scene.sha256


def _name_both(film: Film, metadata: FilmMetadata) -> None:
    """A film that goes on here names what it was begun with, and what it goes on with."""
    held = film.metadata
    film.metadata = replace(
        held,
        device=joined(held.device, metadata.device),
        versions=merged_values(held.versions, metadata.versions),
    )


def empty_film(metadata: FilmMetadata) -> Film:
    """The film to begin with. Raises ContextError where there is no memory for it."""
    try:
        return Film.empty(metadata)
    except MemoryError as error:
        _, _, width, height = metadata.window
        raise ContextError(
            f"film of {width} x {height} pixels: {str(error).rstrip('.') or 'this machine has no memory for it'}.",
            OUT_OF_MEMORY,
        ) from error


def metadata_of(job: RenderJob, plan: Plan, scene: Scene, context: Context | None) -> FilmMetadata:
    """What a film of the job says of itself; the scene has the job's camera. None: others will render it."""
    return FilmMetadata(
        scene=scene.name,
        scene_hash=scene.digest(),
        integrator=job.integrator.integrator,
        seed=job.integrator.seed,
        max_depth=plan.recorded().get("max_depth"),
        settings=_recorded(job, plan),
        full_resolution=job.sensor.resolution,
        window=job.window,
        noisy=job.integrator.noisy,
        exposure=scene.exposure,
        unit=scene.unit,
        aovs=job.integrator.aovs,
        **_names(job, scene),
        **_position_origin(job, scene),
        # Known of the camera that the solution was made for; a gather at points has errors of their own.
        solution_error=plan.solution_error() if isinstance(job.sensor, CameraSensor) else None,
        device="" if context is None else context.info.renderer,
        versions=versions("glpath", "moderngl", "numpy", "scipy")
        | ({} if context is None else {"driver": context.info.driver}),
    )


def _names(job: RenderJob, scene: Scene) -> dict[str, Any]:
    """What shapes and materials are called, where the film has their ids."""
    if set(ID_AOVS).isdisjoint(job.integrator.aovs):
        return {}
    return {
        "shape_names": tuple(shape.name for shape in scene.shapes),
        "material_names": tuple(material.name for material in scene.materials),
        "shape_materials": tuple(int(shape.material) for shape in scene.shapes),
    }


def _position_origin(job: RenderJob, scene: Scene) -> dict[str, Any]:
    """What positions in the film are relative to, where that is not the world's origin."""
    if "position" not in job.integrator.aovs or not scene.centred.origin.any():
        return {}
    return {"position_origin": tuple(scene.centred.origin.tolist())}


def _recorded(job: RenderJob, plan: Plan) -> dict[str, Any]:
    """What decides the image, without what the metadata has fields of its own for."""
    return {k: v for k, v in (plan.recorded() | job.sensor.recorded()).items() if k not in ("seed", "max_depth")}


def _prepared(plan: Plan, scene: Scene, clock: Clock) -> Plan:
    """What takes long before the first path set, with word of it. Raises RenderInterrupted."""
    started = time.perf_counter()
    try:
        prepared = plan.prepared(scene, clock.report)
    except KeyboardInterrupt:
        raise RenderInterrupted(clock.film) from None
    if prepared is not plan:
        clock.statistics["radiosity_s"] = time.perf_counter() - started
    return prepared
