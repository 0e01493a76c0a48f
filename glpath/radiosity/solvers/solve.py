"""`solve_radiosity`: solve a scene by progressive refinement, full matrix or Monte Carlo.

All errors of the scene and the options are detected before the work begins (`checks`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.errors import TimeLimitError, UsageError, kept_in
from glpath.film.choices import INTERRUPTED_RULE, TIME_LIMIT
from glpath.io import AnyScene, load_scene
from glpath.lights.lighting import Lighting
from glpath.radiosity.form_factors.form_factor import Kind
from glpath.radiosity.form_factors.transport import FormFactorOptions, Transport
from glpath.radiosity.memory import available_bytes, enough_memory
from glpath.radiosity.mesh.mesh import Mesh, divisions_of_size, size_for_count, surfaces
from glpath.radiosity.mesh.quadtree import Detail
from glpath.radiosity.mesh.reconstruct import resample
from glpath.radiosity.shafts.options import ShaftOptions
from glpath.radiosity.solution import RadiositySolution
from glpath.radiosity.solvers import importance, matrix, monte_carlo
from glpath.radiosity.solvers.ahead import compile_ahead, kernels_of
from glpath.radiosity.solvers.checkpoint import Solver, SolverCheckpoint
from glpath.radiosity.solvers.checks import Method, check_memory, check_options, check_solvable
from glpath.radiosity.solvers.particles import BATCH
from glpath.radiosity.solvers.progressive import Refinement
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Float64
from glpath.system.arguments import checked
from glpath.system.heartbeat import heartbeat
from glpath.system.kernels import announced, waiting
from glpath.system.time_limit import (
    check_time,
    count_earlier,
    counted_from,
    limited,
    mark_resumed,
    named_work,
    preparing,
    time_is_up,
    without_limit,
    without_limit_if_resumed,
)

#: Default number of patches, if neither their number nor their size is given.
DEFAULT_PATCHES = 1000
#: Default number of times that "monte-carlo" may split elements in four, to a 64th of their width.
DEFAULT_ADAPTIVE = 6
#: Maximum size of cached form factors, as a fraction of free memory.
_CACHE_SHARE = 0.25
#: Maximum size of cached form factors, bytes.
_CACHE_MAX = 4 << 30
#: Maximum number of batches, including those added for smaller elements or a camera, unless the caller wants more.
_MAX_BATCHES = 64
#: Target relative error of the gathered light for a camera. Light of a sky may enter through a small window, so
#: particles are added until the standard error meets this target.
_VIEW_ERROR = 0.003
#: `stop_rule` in the statistics of a solution, unless the time limit or Ctrl-C ended it.
DONE = "done"
# Remedy for too little memory.
_LESS = (
    "Take a coarser mesh (fewer patches, fewer splits), or allow more memory (`ulimit -v`, the container's limit)."
)
# Names of the work before the first step, for the error message of a time limit.
_MESHING = "meshing the scene for its radiosity"
#: Seconds between two reports.
_REPORT_INTERVAL = 0.05


@dataclass(frozen=True)
class RadiosityProgress:
    """Progress of a solution, passed to `on_progress`.

    stage       : "form factors", "shooting", "refining" or "particles"; before that, at first use, "compiling
                  kernels: cast_groups 3/12", when there are no elements yet
    steps       : number of shots of patches, or of particles
    unshot      : fraction of emitted energy that has not been shot; for Monte Carlo the fraction of remaining
                  particles; None for a matrix
    until       : value of `unshot` at which the solution ends
    elements    : number of elements
    """

    stage: str
    steps: int
    unshot: float | None
    until: float
    elements: int
    elapsed_s: float


class RadiosityInterrupted(KeyboardInterrupt):
    """Ctrl-C interrupted a solution. `solution` is the partial solution; None if there is none."""

    def __init__(self, solution: RadiositySolution | None) -> None:
        kept = "" if solution is None else kept_in("RadiosityInterrupted", "solution", "render(radiosity=solution)")
        super().__init__(f"interrupted{kept or ' before anything was solved'}")
        self.solution = solution


Report = Callable[[RadiosityProgress], None]


@dataclass
class _Run:
    """One call of `solve_radiosity`: scene, settings and start time."""

    scene: Scene
    method: Method
    settings: dict[str, object]
    on_progress: Report | None
    started: float
    reported: float = -math.inf

    def report(self, stage: str, steps: int, unshot: float | None, until: float, elements: int) -> None:
        heartbeat.beat()
        now = self.elapsed_s
        last = unshot is not None and unshot <= until
        late = time_is_up()
        if self.on_progress is not None and (now >= self.reported + _REPORT_INTERVAL or last or late):
            self.reported = now
            self.on_progress(RadiosityProgress(stage, steps, unshot, until, elements, now))
        if late and not last:
            raise TimeLimitError(f"time_limit: over after {steps} steps of a radiosity solution.")

    @property
    def elapsed_s(self) -> float:
        """Seconds since the start, including those before a checkpoint."""
        return time.perf_counter() - self.started

    def resume(self, checkpoint: SolverCheckpoint | None, solver: Solver, scene_hash: str) -> None:
        """Restore the solver from its checkpoint, if there is one, and count the time that it had run."""
        if checkpoint is None:
            return
        with without_limit_if_resumed():
            resumes = checkpoint.begin(solver, scene_hash, self.method, self.settings)
        if resumes:
            self.started -= checkpoint.elapsed_s
            count_earlier(checkpoint.elapsed_s)

    def compiling(self, text: str) -> None:
        assert self.on_progress is not None
        heartbeat.beat()
        self.on_progress(RadiosityProgress(text, 0, None, 0.0, 0, self.elapsed_s))

    def solution(
        self,
        mesh: Mesh,
        irradiance: Float64,
        buried: NDArray[np.bool_] | None = None,
        **statistics: object,
    ) -> RadiositySolution:
        divisions, elements, vertices, leaf = resample(mesh, irradiance, buried)
        size = divisions[mesh.elements.triangle] // mesh.elements.n
        return RadiositySolution(
            scene_hash=self.scene.digest(camera=False),
            divisions=divisions.astype(np.int32),
            elements=elements.astype(np.float32),
            vertices=vertices.astype(np.float32),
            leaf_size=size[leaf].astype(np.uint16),
            method=self.method,
            settings=self.settings,
            statistics={
                "patches": len(mesh.patches),
                "elements": len(mesh.elements),
                **statistics,
                "stop_rule": DONE,
                "elapsed_s": round(self.elapsed_s, 4),
            },
        )


@checked
def solve_radiosity(
    scene: AnyScene,
    *,
    method: Method = "progressive",
    patches: int | None = None,
    size: float | None = None,
    splits: int = 0,
    adaptive: int | None = None,
    threshold: float = 0.25,
    unshot: float = 0.001,
    max_steps: int = 1_000_000,
    overshoot: bool = False,
    ambient: bool = False,
    form_factors: Kind = "polygon",
    emitter_samples: int = 25,
    receiver_points: int = 4,
    particles: int = 1_000_000,
    seed: int = 0,
    for_camera: bool = False,
    shafts: ShaftOptions | None = None,
    time_limit: float | None = None,
    on_progress: Report | None = None,
    checkpoint: SolverCheckpoint | None = None,
) -> RadiositySolution:
    """Solve the radiosity of a scene's surfaces, on the CPU.

        solution = glpath.solve_radiosity("cornell-box-36", patches=210)
        solution.save("cornell.npz")

    Parameters
    ----------
    scene      : a file, the name of a shipped scene, or a `Scene` that path tracing accepts, with diffuse surfaces
                 of one colour. Lights are shapes with an emission, point, spot and directional lights and the sky.
                 `ambient` of the scene, which replaces bounces, is ignored
    method     : "progressive" for refinement (Cohen et al. 1988); "matrix" for a direct solution of small scenes;
                 "monte-carlo" for stochastic shooting with many elements
    patches    : approximate number of patches, which shoot; at least one per triangle, by default 1000. With
                 "monte-carlo", a triangle smaller than a patch counts as a fraction of a patch, which leaves more
                 patches to large walls
    size       : longest edge of a patch in scene units, instead of `patches`
    splits     : number of times that each patch is split in four, to get the elements, which receive
    adaptive   : maximum number of times that elements are split in four if the radiosity changes fast; not for
                 "matrix". By default 6 with "monte-carlo", otherwise 0
    threshold  : minimum difference that counts as fast. "progressive": between two corners of an element, as a
                 fraction of the scene's mean. "monte-carlo": between a quarter of an element and the whole, as a
                 fraction of the irradiance there
    unshot     : fraction of the emitted energy that may stay unshot when the solution ends
    max_steps  : maximum number of shots
    overshoot  : True if patches also shoot a part of the light that they will receive later (Feda & Purgathofer
                 1992)
    ambient    : True to add the expected light of the unshot energy, spread evenly (Cohen et al. 1988). This is
                 correct in the mean for a closed room, whose solution may then end early
    form_factors    : "polygon", exact without occluders, or "disc" (Wallace et al. 1989)
    emitter_samples : maximum number of samples of an emitter: 1, 4, 9, 16 or 25; fewer at larger distances
    receiver_points : number of points per element: 1, 4, 9, ...
    particles  : number of particles for "monte-carlo", rounded up to whole batches of 16,384, and more if
                 `adaptive` makes more elements. With `for_camera` and a sky or punctual lights, particles are added
                 up to 1,048,576, until a gather of the camera's image has a standard error of 0.3 %. `statistics`
                 have `view_mean` and `view_error`, W sr^-1 m^-2
    seed       : random seed for "monte-carlo"
    for_camera : for "monte-carlo", True for smaller elements, and more particles of reflected light from the sky
                 and punctual lights, where the scene's camera sees their effect. Use it for images from near that
                 camera, of scenes much larger than the visible part, such as a room under the sky
    shafts     : options of the search for occluders with "progressive" and "matrix" (Haines & Wallace 1991), which
                 change only the time; see `glpath.radiosity.ShaftOptions`
    time_limit : maximum time in seconds since the call, including the time counted by a checkpoint; not for
                 "matrix"
    on_progress: function that is called with a `RadiosityProgress` now and then
    checkpoint : file of the solver's state, from which it resumes bit-identically; not for "matrix"

    Raises TimeLimitError if the first step is not finished within one second after the time limit. Raises
    SceneError for a scene without emitters, with a triangle without area, with a reflectance of 1 or more, or with
    content that path tracing does not support. Raises UsageError for options out of range or a mesh that does not
    fit into memory, and GlpathError for a checkpoint that another process uses. On Ctrl-C it raises
    RadiosityInterrupted with the partial solution.

    Poor at: glossy surfaces, which it does not support; small or thin shadows on coarse elements; lamps that nearly
    touch a surface.
    """
    if adaptive is None:
        adaptive = DEFAULT_ADAPTIVE if method == "monte-carlo" else 0
    options: dict[str, object] = {
        "method": method, "patches": patches, "size": size, "splits": splits, "adaptive": adaptive,
        "threshold": threshold, "unshot": unshot, "max_steps": max_steps, "overshoot": overshoot,
        "ambient": ambient, "form_factors": form_factors, "emitter_samples": emitter_samples,
        "receiver_points": receiver_points, "particles": particles, "seed": seed, "for_camera": for_camera,
    }  # fmt: skip
    check_options(options)
    if (checkpoint is not None or time_limit is not None) and method == "matrix":
        word = "checkpoint" if checkpoint is not None else "time_limit"
        raise UsageError(
            f'solve_radiosity: {word} with method "matrix", which has nothing between its beginning and its end.',
            'Take "progressive" or "monte-carlo", or leave it out.',
        )
    if shafts is not None and method == "monte-carlo":
        raise UsageError(
            'solve_radiosity: shafts with method "monte-carlo", whose particles are traced one by one.',
            'Take "progressive" or "matrix", or leave them out.',
        )
    with limited(time_limit):
        for_camera &= method == "monte-carlo"
        with named_work(_MESHING):
            triangles = path_traceable(load_scene(scene).still())
            check_solvable(triangles)
            surface = surfaces(triangles)
            if size is None:
                # Particles cost time by their hits, not by triangles. So triangles smaller than a patch do not use
                # up the number of patches.
                by_size = method == "monte-carlo"
                size = size_for_count(triangles, surface, patches or DEFAULT_PATCHES, by_size=by_size)
            divisions = divisions_of_size(triangles, surface, size)
            lighting = Lighting.of(triangles)
            needed = kernels_of(triangles, lighting, method, near_lamps=for_camera and adaptive > 0)
        run = _Run(triangles, method, _settings(options, size), on_progress, counted_from())
        with (
            announced(waiting(needed), None if on_progress is None else run.compiling),
            checkpoint or nullcontext(),
        ):
            if checkpoint is not None and checkpoint.found():
                mark_resumed()
            if for_camera and (lighting.punctual or lighting.sky is not None):
                count = patches or DEFAULT_PATCHES
                check_time(_MESHING)
                divisions = importance.divisions_for_camera(triangles, surface, size, count, seed)
            points = 0 if method == "monte-carlo" else receiver_points
            per_element = check_memory(triangles, divisions, size, splits, points, method)
            if method == "monte-carlo":
                divisions, splits = divisions * 2**splits, 0
            check_time(_MESHING)
            mesh = Mesh.uniform(triangles, divisions, surface, splits)
            compile_ahead(needed)
            if method == "monte-carlo":
                with preparing("the radiosity solver"), enough_memory("solve_radiosity", _LESS):
                    shooting = monte_carlo.Shooting(mesh, seed, for_camera, adaptive, threshold)
                return _monte_carlo(run, shooting, particles, checkpoint)
            cache = int(min(_CACHE_SHARE * available_bytes(), _CACHE_MAX))
            of_factors = FormFactorOptions(form_factors, emitter_samples, receiver_points)
            with preparing("the radiosity solver"), enough_memory("solve_radiosity", _LESS):
                transport = Transport(mesh, of_factors, cache, shafts)
            if method == "matrix":
                return _matrix(run, transport)
            with preparing("the radiosity solver"), enough_memory("solve_radiosity", _LESS):
                refinement = Refinement(transport, overshoot)
            wanted = _Wanted(unshot, max_steps, adaptive, threshold, ambient)
            return _progressive(run, refinement, wanted, per_element, checkpoint)


class _Wanted(NamedTuple):
    """Options of progressive refinement, see `solve_radiosity`."""

    unshot: float
    max_steps: int
    adaptive: int
    threshold: float
    ambient: bool


def _progressive(
    run: _Run,
    refinement: Refinement,
    wanted: _Wanted,
    per_element: float,
    checkpoint: SolverCheckpoint | None,
) -> RadiositySolution:
    until, max_steps, adaptive, threshold, ambient = wanted
    run.resume(checkpoint, refinement, run.scene.digest(camera=False))

    def report(share: float) -> None:
        if checkpoint is not None:
            checkpoint.step(refinement, refinement.steps, run.elapsed_s)
        run.report("shooting", refinement.steps, share, until, len(refinement.transport.mesh.elements))

    def solution() -> RadiositySolution:
        took = refinement.transport.statistics
        with without_limit():
            return run.solution(
                refinement.transport.mesh,
                refinement.result(ambient),
                steps=refinement.steps,
                unshot=refinement.unshot_share,
                ambient=refinement.ambient().tolist(),
                rays=took.rays,
                shafts=took.shafts,
                empty_shafts=took.empty_shafts,
            )

    def partial(stop: BaseException) -> RadiositySolution | None:
        """Store the state. Return the solution before the current splits, or that of the first steps, if any."""
        if checkpoint is not None:
            last = isinstance(stop, KeyboardInterrupt)  # after the time limit the solution itself is saved
            checkpoint.write(refinement, refinement.steps, run.elapsed_s, last)
        return before or (solution() if refinement.steps else None)

    before: RadiositySolution | None = None
    try:
        refinement.run(until, max_steps, report)
        for _ in range(len(refinement.splits), adaptive):
            before = solution()
            elements = len(refinement.transport.mesh.elements)
            run.report("refining", refinement.steps, None, until, elements)
            if not refinement.split(threshold, int(available_bytes() / (4 * per_element))):
                break
            before = None
            refinement.run(until, max_steps, report)
        return solution()
    except (TimeLimitError, KeyboardInterrupt) as stop:
        return _stopped(stop, partial(stop))


def _matrix(run: _Run, transport: Transport) -> RadiositySolution:
    count = len(transport.mesh.elements)
    run.report("form factors", 0, None, 0.0, count)
    try:
        irradiance = transport.on_sides(matrix.solve_matrix(transport))
    except KeyboardInterrupt as stop:
        raise RadiosityInterrupted(None) from stop
    took = transport.statistics
    return run.solution(
        transport.mesh,
        irradiance,
        rays=took.rays,
        shafts=took.shafts,
        empty_shafts=took.empty_shafts,
    )


def _monte_carlo(
    run: _Run, shooting: monte_carlo.Shooting, particles: int, checkpoint: SolverCheckpoint | None
) -> RadiositySolution:
    asked = shooting.goal = -(-particles // BATCH)
    # Particles and refinement depend on the camera if they start by their importance for it.
    run.resume(checkpoint, shooting, run.scene.digest(camera=shooting.for_camera))

    def report() -> None:
        if checkpoint is not None:
            checkpoint.step(shooting, shooting.particles // BATCH, run.elapsed_s)
        left = max(0.0, 1 - shooting.particles / (shooting.goal * BATCH))
        run.report("particles", shooting.particles, left, 0.0, len(shooting.tree.levels[-1]))

    def solution(detail: Detail | None = None) -> RadiositySolution:
        with without_limit():
            detail = shooting.detail() if detail is None else detail
            mesh, irradiance, buried = shooting.result(detail)
            view = shooting.view_error()
            return run.solution(
                mesh,
                irradiance,
                buried,
                particles=shooting.particles,
                hits=shooting.hits,
                error_of_mean=shooting.error_of_mean(),
                **({} if view is None else {"view_mean": view[0], "view_error": view[1]}),
            )

    def partial(stop: BaseException) -> RadiositySolution | None:
        """Store the state, and return the solution of the lattices that got the most particles, if any."""
        if checkpoint is not None:
            last = isinstance(stop, KeyboardInterrupt)
            checkpoint.write(shooting, shooting.particles // BATCH, run.elapsed_s, last)
        if coarser is not None and shooting.particles < coarser["counts"][0]:
            shooting.restore(coarser)
        return solution() if shooting.particles else None

    coarser: dict[str, NDArray[Any]] | None = None
    try:
        while True:
            shooting.shoot(shooting.goal - shooting.particles // BATCH, report)
            # Particles are added in proportion to elements, so that each element gets as many on average.
            detail = shooting.detail()
            elements = sum(int(leaf.sum()) for leaf in detail.leaves)
            wanted = round(asked * elements / len(shooting.mesh.elements))
            if time_is_up():  # refining discards all particles, and no time is left for new ones
                raise TimeLimitError("time_limit: over before the lattices are refined.")
            # Stored before `deepen`, because Ctrl-C may interrupt it after it has changed the state.
            coarser = shooting.state()
            if shooting.deepen(detail, min(wanted, max(asked, _MAX_BATCHES))):
                continue
            view = shooting.view_error()
            enough = not shooting.lit.any() or view is None or view[1] <= _VIEW_ERROR * view[0]
            if (enough and shooting.goal >= wanted) or shooting.goal + asked > max(asked, _MAX_BATCHES):
                return solution(detail)
            # The number of batches added does not depend on the number of threads, so neither does the result.
            shooting.goal += asked
    except (TimeLimitError, KeyboardInterrupt) as stop:
        return _stopped(stop, partial(stop))


def _stopped(stop: BaseException, partial: RadiositySolution | None) -> RadiositySolution:
    """Return the partial solution of a run that the time limit ended.

    Raises RadiosityInterrupted if Ctrl-C ended the run, and TimeLimitError if there is no solution yet.
    """
    is_interrupted = isinstance(stop, KeyboardInterrupt)
    if partial is not None:
        stop_rule = INTERRUPTED_RULE if is_interrupted else TIME_LIMIT
        partial = replace(partial, statistics={**partial.statistics, "stop_rule": stop_rule})
    if is_interrupted:
        raise RadiosityInterrupted(partial) from stop
    if partial is None:
        raise stop
    return partial


def _settings(options: dict[str, object], size: float) -> dict[str, object]:
    of = {
        "progressive": ("splits", "adaptive", "threshold", "unshot", "max_steps", "overshoot", "ambient",
                        "form_factors", "emitter_samples", "receiver_points"),
        "matrix": ("splits", "form_factors", "emitter_samples", "receiver_points"),
        "monte-carlo": ("splits", "adaptive", "threshold", "particles", "seed", "for_camera"),
    }  # fmt: skip
    return {"size": size} | {name: options[name] for name in of[str(options["method"])]}
