"""`solve_radiosity`: from a scene to a `RadiositySolution`, by progressive refinement, full matrix or Monte Carlo.

Everything that can be wrong with the scene and the options is found before the work begins (`checks`).
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
from glpath.film.choices import TIME_LIMIT
from glpath.io import AnyScene, load_scene
from glpath.lights.lighting import Lighting
from glpath.radiosity.form_factors.form_factor import Kind
from glpath.radiosity.form_factors.transport import FormFactorOptions, Transport
from glpath.radiosity.memory import available_bytes
from glpath.radiosity.mesh.mesh import Mesh, divisions_of_size, size_for_count, surfaces
from glpath.radiosity.mesh.quadtree import Detail
from glpath.radiosity.mesh.reconstruct import resample
from glpath.radiosity.shafts.options import ShaftOptions
from glpath.radiosity.solution import RadiositySolution
from glpath.radiosity.solvers import importance, matrix, monte_carlo
from glpath.radiosity.solvers.ahead import compile_ahead
from glpath.radiosity.solvers.checkpoint import SolverCheckpoint
from glpath.radiosity.solvers.checks import Method, check_memory, check_options, check_solvable
from glpath.radiosity.solvers.needed import kernels_of
from glpath.radiosity.solvers.particles import BATCH
from glpath.radiosity.solvers.progressive import Refinement
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Float64
from glpath.system.heartbeat import heartbeat
from glpath.system.kernels import announced, waiting
from glpath.system.time_limit import (
    check_time,
    count_earlier,
    counted_from,
    limited,
    time_is_up,
    without_limit,
)

#: Patches where neither their number nor their size is given.
DEFAULT_PATCHES = 1000
#: How many times elements may be split in four by "monte-carlo", where the number is not given: to a 64th of their
#: width.
DEFAULT_ADAPTIVE = 6
#: Share of the free memory that kept form factors may take, and how much of it at most.
_CACHE_SHARE, _CACHE_MAX = 0.25, 4 << 30
#: Under a sky light may come in by a small window: then as many particles again and again, up to so many batches,
#: until the standard error of what a gather finds for the camera is such a share of it.
_MAX_BATCHES, _VIEW_ERROR = 64, 0.003
#: What ended a solution, in its statistics, unless it was the time limit.
DONE = "done"
# What is done before the first step, for a time limit.
_MESHING = "meshing the scene for its radiosity"
#: Seconds between two reports.
_REPORT_INTERVAL = 0.05


@dataclass(frozen=True)
class RadiosityProgress:
    """How far a solution is; what `on_progress` is called with.

    stage       : "form factors", "shooting", "refining" or "particles", and before that, at first use,
                  "compiling kernels: cast_groups 3/12", when there are no elements yet
    steps       : patches that shot, or particles
    unshot      : share of all emitted energy that has not been sent; of a Monte Carlo solution the share of
                  particles yet to come; None of a matrix
    until       : the share at which it ends
    elements    : how many there are
    """

    stage: str
    steps: int
    unshot: float | None
    until: float
    elements: int
    elapsed_s: float


class RadiosityInterrupted(KeyboardInterrupt):
    """Ctrl-C interrupted a solution. `solution` is what there was; None before there was any."""

    def __init__(self, solution: RadiositySolution | None) -> None:
        kept = "" if solution is None else kept_in("RadiosityInterrupted", "solution", "render(radiosity=solution)")
        super().__init__(f"interrupted{kept or ' before anything was solved'}")
        self.solution = solution


Report = Callable[[RadiosityProgress], None]


@dataclass
class _Run:
    """What is solved, and since when."""

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
        """Seconds since it began, those before a checkpoint included."""
        return time.perf_counter() - self.started

    def resumed(self, checkpoint: SolverCheckpoint) -> None:
        """It began as much earlier as the checkpoint's solver had worked."""
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
    """The radiosity of a scene's surfaces, on the CPU.

        solution = glpath.solve_radiosity("cornell-box-36", patches=210)
        solution.save("cornell.npz")

    Parameters
    ----------
    scene      : a file, the name of a shipped scene, or a `Scene`; what path tracing takes: diffuse surfaces of one
                 colour; lit by shapes with an emission, by point, spot and directional lights and the sky.
                 `ambient` of the scene, which stands for bounces, is left out
    method     : "progressive" refinement (Cohen et al. 1988); "matrix", all at once, for small scenes;
                 "monte-carlo", stochastic shooting, for many elements
    patches    : about so many patches, which shoot; at least one per triangle. By default 1000. Of "monte-carlo"
                 triangles that are smaller than a patch count as the share of one that they are, and so leave
                 large walls theirs
    size       : instead: the longest edge of a patch, scene units
    splits     : each patch is split in four so many times, for elements, which receive
    adaptive   : how many times elements may be split in four where the radiosity changes fast; not of "matrix". By
                 default 6 with "monte-carlo", else 0
    threshold  : "fast" is a difference of more than this: with "progressive" between two corners of an element, as
                 a share of the scene's mean; with "monte-carlo" between a quarter of an element and the whole, as a
                 share of the irradiance there
    unshot     : ends when this share of the emitted energy has not been sent
    max_steps  : or when so many patches shot
    overshoot  : patches shoot some of what they will get later, too (Feda & Purgathofer 1992)
    ambient    : add what the unshot energy will amount to, spread evenly (Cohen et al. 1988): right in the mean
                 for a closed room, whose solution may then end early
    form_factors    : "polygon", exact where nothing occludes, or "disc" (Wallace et al. 1989)
    emitter_samples : 1, 4, 9, 16 or 25: the most of an emitter; the farther, the fewer
    receiver_points : 1, 4, 9, ...: per element
    particles  : of "monte-carlo", rounded up to whole batches of 16,384, and more if `adaptive` makes more
                 elements. With `for_camera` and a sky or punctual
                 lights as many again and again, up to 1,048,576, until what a gather of the camera's picture finds
                 has a standard error of 0.3 %; `statistics` have it, `view_mean` and `view_error`, W sr^-1 m^-2
    seed       : of "monte-carlo"
    for_camera : of "monte-carlo": elements are smaller, and reflected light of the sky and of punctual lights has
                 more particles, where the scene's camera sees its effect. For pictures from about there, of
                 scenes that are much larger than what is seen: a room under the sky
    shafts     : of "progressive" and "matrix": how occluders are found (Haines & Wallace 1991), which
                 changes the time alone; see `glpath.radiosity.ShaftOptions`
    time_limit : or after so many seconds from the call, those that a checkpoint has counted included; not of
                 "matrix"
    on_progress: called with a `RadiosityProgress` now and then
    checkpoint : where the solver's state is kept meanwhile, and from where it resumes, bit-identical; not of
                 "matrix"

    Raises TimeLimitError if the time limit is over more than a second before the first step is done;
    SceneError for a scene without emitters, with a triangle without area, with a reflectance of 1 or more,
    or of what path tracing does not know; UsageError for options out of range or a mesh that does not fit into
    memory; GlpathError for a checkpoint that another process has; RadiosityInterrupted, with what was solved, on
    Ctrl-C.

    Poor at: glossy surfaces, which it does not know; small or thin shadows on coarse elements; lamps that nearly
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
        triangles = path_traceable(load_scene(scene).still())
        check_solvable(triangles)
        surface = surfaces(triangles)
        if size is None:
            # To particles small triangles are nothing: they cost by their hits.
            by_size = method == "monte-carlo"
            size = size_for_count(triangles, surface, patches or DEFAULT_PATCHES, by_size=by_size)
        divisions = divisions_of_size(triangles, surface, size)
        lighting = Lighting.of(triangles)
        run = _Run(triangles, method, _settings(options, size), on_progress, counted_from())
        for_camera &= method == "monte-carlo"
        needed = kernels_of(triangles, lighting, method, near_lamps=for_camera and adaptive > 0)
        with (
            announced(waiting(needed), None if on_progress is None else run.compiling),
            checkpoint or nullcontext(),
        ):
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
                shooting = monte_carlo.Shooting(mesh, seed, for_camera, adaptive, threshold)
                return _monte_carlo(run, shooting, particles, checkpoint)
            cache = int(min(_CACHE_SHARE * available_bytes(), _CACHE_MAX))
            transport = Transport(
                mesh, FormFactorOptions(form_factors, emitter_samples, receiver_points), cache, shafts
            )
            if method == "matrix":
                return _matrix(run, transport)
            refinement = Refinement(transport, overshoot)
            wanted = _Wanted(unshot, max_steps, adaptive, threshold, ambient)
            return _progressive(run, refinement, wanted, per_element, checkpoint)


class _Wanted(NamedTuple):
    """Of progressive refinement, as of `solve_radiosity`."""

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
    if checkpoint is not None and checkpoint.begin(
        refinement, run.scene.digest(camera=False), run.method, run.settings
    ):
        run.resumed(checkpoint)

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

    def partial() -> RadiositySolution | None:
        """Keep the state, and return the solution so far, if any; while elements are split, that from before."""
        if checkpoint is not None:
            checkpoint.write(refinement, refinement.steps, run.elapsed_s)
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
        return _stopped(stop, partial())


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
    if checkpoint is not None and checkpoint.begin(
        shooting, run.scene.digest(camera=False), run.method, run.settings
    ):
        run.resumed(checkpoint)
    asked = -(-particles // BATCH)
    # Of a checkpoint that has more: up to where the next decision is.
    batches = max(asked, -(-(shooting.particles // BATCH) // asked) * asked)

    def report() -> None:
        if checkpoint is not None:
            checkpoint.step(shooting, shooting.particles // BATCH, run.elapsed_s)
        left = max(0.0, 1 - shooting.particles / (batches * BATCH))
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

    def partial() -> RadiositySolution | None:
        """Keep the state, and return the solution of the lattices that got the most particles, if any did."""
        if checkpoint is not None:
            checkpoint.write(shooting, shooting.particles // BATCH, run.elapsed_s)
        if coarser is not None and shooting.particles < coarser["counts"][0]:
            shooting.restore(coarser)
        return solution() if shooting.particles else None

    coarser: dict[str, NDArray[Any]] | None = None
    try:
        while True:
            shooting.shoot(batches - shooting.particles // BATCH, report)
            # As many particles for each element, however many elements there are.
            detail = shooting.detail()
            elements = sum(int(leaf.sum()) for leaf in detail.leaves)
            wanted = round(asked * elements / len(shooting.mesh.elements))
            if time_is_up():  # finer lattices would begin anew
                raise TimeLimitError("time_limit: over before the lattices are refined.")
            before = shooting.state()
            if shooting.deepen(detail):
                coarser = before
                batches = min(wanted, max(asked, _MAX_BATCHES))
                continue
            view = shooting.view_error()
            enough = not shooting.lit.any() or view is None or view[1] <= _VIEW_ERROR * view[0]
            if (enough and batches >= wanted) or batches + asked > max(asked, _MAX_BATCHES):
                return solution(detail)
            # At the same numbers, however many threads there are.
            batches += asked
    except (TimeLimitError, KeyboardInterrupt) as stop:
        return _stopped(stop, partial())


def _stopped(stop: BaseException, partial: RadiositySolution | None) -> RadiositySolution:
    """Return the partial solution, which the time limit ended.

    Raises RadiosityInterrupted if it was Ctrl-C, and TimeLimitError if there is no solution yet.
    """
    if isinstance(stop, KeyboardInterrupt):
        raise RadiosityInterrupted(partial) from stop
    if partial is None:
        raise stop
    return replace(partial, statistics={**partial.statistics, "stop_rule": TIME_LIMIT})


def _settings(options: dict[str, object], size: float) -> dict[str, object]:
    of = {
        "progressive": ("splits", "adaptive", "threshold", "unshot", "max_steps", "overshoot", "ambient",
                        "form_factors", "emitter_samples", "receiver_points"),
        "matrix": ("splits", "form_factors", "emitter_samples", "receiver_points"),
        "monte-carlo": ("splits", "adaptive", "threshold", "particles", "seed", "for_camera"),
    }  # fmt: skip
    return {"size": size} | {name: options[name] for name in of[str(options["method"])]}
