"""An image that converges, and that follows a camera which moves; without a widget.

While the camera moves, path sets of an image of half or a quarter of the pixels along a side are traced, as many as
the time for a frame holds and never so few that single shadows show. When it rests the whole image is traced from
its first path set on, and replaces the coarse one when it has as many.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from glpath.film.batches import blocks
from glpath.film.film import Film
from glpath.gl.context import Context
from glpath.integrators.engine import Engine
from glpath.rendering.factory import plan_of
from glpath.rendering.job import RenderJob
from glpath.rendering.session import metadata_of
from glpath.scene import Camera, Scene
from glpath.sensors.sensor import CameraSensor

#: Seconds of work between two looks at the events: while the camera moves, and while it rests.
STEP_SECONDS = {"moving": 1 / 16, "still": 1 / 16}
#: Seconds between two images of a camera that rests.
_STILL_SECONDS = 1 / 4
#: A camera that has not moved for so many seconds rests.
_RESTS_AFTER = 0.25
#: By how much the sides of a moving image may be shorter.
_REDUCTIONS = (1, 2, 4)
#: Path sets of a moving image, at least: each has one light sample and one pair of directions for all pixels.
_MOVING_SETS = 6


@dataclass
class _Level:
    """The image at one resolution.

    film    : as `camera` sees it; its metadata are those of the first camera
    seconds : that a path set takes, as far as is known
    origin  : (3,) what the engine's coordinates are relative to, in the camera's
    """

    engine: Engine
    film: Film
    camera: Camera
    seconds: float
    origin: NDArray[np.float64]

    def look_from(self, camera: Camera) -> None:
        resolution = self.film.metadata.full_resolution
        self.engine.look_from(replace(CameraSensor.of(camera), resolution=resolution).moved(self.origin))
        self.engine.take()
        self.engine.take_aovs()
        self.engine.forget_statistics()
        self.film = Film.empty(self.film.metadata)
        self.camera = camera

    def trace(self, seconds: float, min_sets: int, stop: int) -> None:
        """As many path sets more as fit into the time, at least `min_sets`, up to the number `stop`."""
        done = self.film.path_sets
        count = max(1, min_sets - done, int(seconds / max(self.seconds, 1e-6)))
        begun, end = time.perf_counter(), min(done + count, stop)
        if end <= done:
            return
        for first, last in blocks(done, end):
            for index in range(first, last):
                self.engine.trace_path_set(index)
            self.film.add(first, last, self.engine.take(), self.engine.take_aovs())
        self.seconds = (time.perf_counter() - begun) / (end - done)


@dataclass
class LiveImage:
    """The image of a job that can be looked at from elsewhere at any time.

    scene   : with the job's camera
    camera  : the present one
    stopped : hold the image as it is

    Not for two threads at once. The context has to be current in all but `look_from`.
    Raises what `glpath.render` raises before it renders.
    """

    job: RenderJob
    scene: Scene
    context: Context
    camera: Camera = field(init=False)
    stopped: bool = False

    def __post_init__(self) -> None:
        plan = plan_of(self.job.integrator)
        self._traced = plan.traceable(self.scene)
        self._plan = plan.prepared(self._traced, lambda stage: None)
        self.camera = self.scene.camera
        self._levels: dict[int, _Level] = {}
        self._reduction = 1
        self._moved_at = self._shown_at = -np.inf
        self._enough = 1  # path sets that the whole image has to have to be better than the one that is shown
        self._level(1)

    @property
    def path_sets(self) -> int:
        """In the whole image."""
        level = self._level(1)
        return level.film.path_sets if level.camera is self.camera else 0

    @property
    def converged(self) -> bool:
        """All path sets of the job are in the image."""
        return self.path_sets >= self.job.spp

    @property
    def idle(self) -> bool:
        """Nothing is left to do until the camera moves."""
        return (self.converged or self.stopped) and not self._moves

    @property
    def film(self) -> Film:
        """The film from the present camera."""
        level = self._level(1)
        sensor = CameraSensor.of(self.camera)
        job = replace(self.job, sensor=sensor)
        metadata = metadata_of(job, self._plan, sensor.seen(self.scene), self.context)
        if level.camera is not self.camera:
            return Film.empty(metadata)
        metadata = replace(metadata, statistics=level.engine.statistics())
        film = level.film
        return Film(
            film.radiance_sums.copy(),
            film.batch_counts.copy(),
            film.ranges,
            metadata,
            {name: sums.copy() for name, sums in film.aov_sums.items()},
            film.shape_counts,
        )

    @property
    def _moves(self) -> bool:
        return time.perf_counter() - self._moved_at < _RESTS_AFTER

    def look_from(self, camera: Camera) -> None:
        """Look from another camera of the same resolution."""
        if not self._moves:
            self._reduction = self._quick_enough()
        self.camera = camera
        self._moved_at = time.perf_counter()

    def first(self, seconds: float) -> NDArray[np.float64]:
        """(H, W, 3) radiance of the whole image; where it has no path set yet, of what fits into the time."""
        level = self._level(1)
        if level.camera is not self.camera:
            level.look_from(self.camera)
        if not level.film.path_sets:
            level.trace(0.0, 1, self.job.spp)  # compiles
            level.trace(seconds, 1, self.job.spp)
        return level.film.mean

    def step(self) -> NDArray[np.float64] | None:
        """Trace for a moment. (h, w, 3) radiance where there is a better image to show, smaller while it moves."""
        if self._moves:
            return self._moving()
        level = self._level(1)
        if level.camera is not self.camera:
            if self.stopped:
                return None
            level.look_from(self.camera)
        if not self.stopped:
            level.trace(STEP_SECONDS["still"], 1, self.job.spp)
        now = time.perf_counter()
        better = level.film.path_sets >= min(self._enough, self.job.spp)
        if not self.idle and (not better or now - self._shown_at < _STILL_SECONDS):
            return None
        self._shown_at, self._enough = now, 1
        return level.film.mean

    def _moving(self) -> NDArray[np.float64]:
        level = self._level(self._reduction)
        if level.camera is not self.camera:
            level.look_from(self.camera)
        level.trace(STEP_SECONDS["moving"], self._moving_sets, self.job.spp)
        if level.seconds * self._moving_sets > 2 * STEP_SECONDS["moving"] and self._reduction != _REDUCTIONS[-1]:
            self._reduction *= 2
        self._enough = level.film.path_sets
        return level.film.mean

    @property
    def _moving_sets(self) -> int:
        # Samples of the ray tracers differ only in their position in the pixel.
        return min(_MOVING_SETS, self.job.spp) if self.job.integrator.noisy else 1

    def _quick_enough(self) -> int:
        """The least reduction whose frames fit into their time, as far as is known."""
        for reduction in _REDUCTIONS:
            level = self._levels.get(reduction)
            seconds = level.seconds if level else self._level(1).seconds / reduction**2
            if seconds * self._moving_sets <= STEP_SECONDS["moving"] * 1.5:
                return reduction
        return _REDUCTIONS[-1]

    def _level(self, reduction: int) -> _Level:
        if reduction not in self._levels:
            width, height = self.camera.resolution
            resolution = max(1, width // reduction), max(1, height // reduction)
            scene = self._traced.with_camera(resolution=resolution)
            engine = self._plan.engine(
                self.context, scene, CameraSensor.of(scene.camera), (0, 0, *resolution), False
            )
            window = (0, 0, *resolution)
            job = replace(self.job, sensor=CameraSensor.of(scene.camera), window=window)
            film = Film.empty(metadata_of(job, self._plan, scene, self.context))
            seconds = self._levels[1].seconds / reduction**2 if self._levels else STEP_SECONDS["still"]
            origin = self._traced.origin - self.scene.origin
            self._levels[reduction] = _Level(engine.prepare(), film, self.scene.camera, seconds, origin)
        return self._levels[reduction]
