"""Cost of a path set: wall and processor time of the path-buffer, of paths by rays, and of the gather.

The depth is 3 for the first two. The gather has all bounces, without the time of its solution. Engines take turns
of sixteen sets, and the median counts. Processor time is the sum over all threads.

measured, for each scene and size:
    SCENE-SIDE.ENGINE_ms, SCENE-SIDE.ENGINE_cpu_ms : milliseconds of a path set
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.benches.gather import compiled_engine, gather_engine, solve
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.gl.context import Context, get_context
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.io import load_scene
from glpath.scene.model import Scene
from glpath.scene.triangulate import path_traceable
from glpath.system.versions import versions

_DEPTH = 3
_SETS = 16
#: Scenes, sides of the picture, and limits in milliseconds of processor time for a path set of the path-buffer.
CASES = (("cornell-box-36", 256, 37.0), ("cornell-box-36", 1024, 350.0), ("room", 256, 90.0))
RULE = tuple(Condition(f"{name}-{side}.path-buffer_cpu_ms", "<=", most) for name, side, most in CASES)


def bench_path_sets(
    scale: float = 1.0, rounds: int = 7, progress: Callable[[str], None] = lambda text: None
) -> Report:
    """Time the path sets. scale: below 1, smaller pictures. rounds: turns of sixteen path sets of each engine."""
    context = get_context()
    measured: dict[str, float] = {}
    rows: list[dict[str, float | str]] = []
    for name, side, _ in CASES:
        progress(f"{name}, {side} x {side}")
        shown = max(16, round(side * scale**0.5))
        scene = path_traceable(load_scene(name).with_camera(resolution=(shown, shown)))
        engines = _engines(context, scene)
        taken: dict[str, list[tuple[float, float]]] = {engine: [] for engine in engines}
        for _turn in range(rounds):
            for engine, tracer in engines.items():
                taken[engine].append(_taken(tracer))
        for engine, every in taken.items():
            wall, cpu = np.median(np.array(every), axis=0)
            measured |= {f"{name}-{side}.{engine}_ms": float(wall), f"{name}-{side}.{engine}_cpu_ms": float(cpu)}
            rows.append({"scene": name, "side": side, "engine": engine, "ms": float(wall), "cpu_ms": float(cpu)})
    claim, holds = judge("a set of the path-buffer takes no more processor time than the aim", RULE, measured)
    return Report(
        name="path-sets",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy") | {"driver": context.info.driver},
    )


def _engines(context: Context, scene: Scene) -> dict[str, PathSetEngine]:
    _, solution = solve(scene)
    return {
        "path-buffer": compiled_engine(context, scene, None, PathBufferSettings(max_depth=_DEPTH)),
        "path": compiled_engine(context, scene, None, PathSettings(max_depth=_DEPTH)),
        "gather": gather_engine(context, scene, solution, 0),
    }


def _taken(tracer: PathSetEngine) -> tuple[float, float]:
    """Return milliseconds per path set: wall time, and processor time."""
    wall, cpu = time.perf_counter(), time.process_time()
    for index in range(_SETS):
        tracer.trace_path_set(index)
    tracer.take()
    return 1e3 * (time.perf_counter() - wall) / _SETS, 1e3 * (time.process_time() - cpu) / _SETS
