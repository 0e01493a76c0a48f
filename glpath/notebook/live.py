"""Image that converges and follows a moving camera; `view` has the widget that shows it.

While the camera moves, the image has a half or a quarter of the pixels along each side. As many path sets are
traced as fit into the time of a frame, but at least `_MOVING_SETS`, so that their separate shadows blend. When the
camera stops, the whole image is traced from its first path set. It replaces the coarse image when it has as many
path sets.
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

#: Seconds of work between two checks for events, while the camera moves and while it rests.
STEP_SECONDS = {"moving": 1 / 16, "still": 1 / 16}
#: Seconds between two images while the camera rests.
_STILL_SECONDS = 1 / 4
#: Seconds without motion after which a camera counts as resting.
_RESTS_AFTER = 0.25
#: Reduction factors for the sides of the image while the camera moves.
_REDUCTIONS = (1, 2, 4)
#: Minimum number of path sets while the camera moves: each has one light sample and one pair of directions for all
#: pixels.
_MOVING_SETS = 6


@dataclass
class _Level:
    """Image at one resolution.

    film    : film of `camera`; its metadata are those of the first camera
    seconds : estimated time of a path set
    origin  : (3,) origin of the engine's coordinates, in the camera's coordinates
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
        """Trace as many further path sets as fit into the time, at least `min_sets`, up to the number `stop`."""
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
    """Image of a job whose camera can be changed at any time.

    scene   : scene with the job's camera
    camera  : current camera
    stopped : True to freeze the image

    Not thread-safe. The context must be current in all methods except `look_from`. Raises the errors that
    `glpath.render` raises before it renders.
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
        self._enough = 1  # number of path sets with which the whole image is better than the displayed one
        self._level(1)

    @property
    def path_sets(self) -> int:
        """Number of path sets in the whole image."""
        level = self._level(1)
        return level.film.path_sets if level.camera is self.camera else 0

    @property
    def converged(self) -> bool:
        """True if all path sets of the job are in the image."""
        return self.path_sets >= self.job.spp

    @property
    def idle(self) -> bool:
        """True if nothing is left to do until the camera moves."""
        return (self.converged or self.stopped) and not self._moves

    @property
    def film(self) -> Film:
        """Film of the current camera."""
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
        """Change to another camera of the same resolution."""
        if not self._moves:
            self._reduction = self._quick_enough()
        self.camera = camera
        self._moved_at = time.perf_counter()

    def first(self, seconds: float) -> NDArray[np.float64]:
        """Return the (H, W, 3) radiance of the whole image; if it has no path set yet, trace for the given time."""
        level = self._level(1)
        if level.camera is not self.camera:
            level.look_from(self.camera)
        if not level.film.path_sets:
            level.trace(0.0, 1, self.job.spp)  # the first path set compiles the shaders
            level.trace(seconds, 1, self.job.spp)
        return level.film.mean

    def step(self) -> NDArray[np.float64] | None:
        """Trace for a short time, and return the (h, w, 3) radiance of a better image if there is one.

        The image is smaller while the camera moves.
        """
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
        # One path set suffices for ray tracers, whose samples differ only in their position inside the pixel.
        return min(_MOVING_SETS, self.job.spp) if self.job.integrator.noisy else 1

    def _quick_enough(self) -> int:
        """Return the smallest reduction whose frames fit into their time, by present estimates."""
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
