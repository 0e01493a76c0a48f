"""Cost of parallel light per point and direction: by rays with coherent lanes, and by occlusion scans.

The scenes are cities of boxes (`benchmarks.scenes.city`) with increasing numbers of triangles, and of points on
their ground and roofs. Both methods find the points that see out along the same directions. Rays traverse the wide
BVH, with points sorted by a Z curve; "unsorted" has the points in random order. A scan (`PathBuffer` with
`occlusion`) has as many cells as points. It is timed from positions on the device to the depths of its cells, once
for each direction. Times are processor times of all cores, so other programs do not count. `measured`:

    agreement      : smallest fraction of points for which a scan and the rays agree
    ray_s, scan_s  : seconds per point and direction for 1e5 triangles and 1e5 points, by the law
    ray_by_triangles, ray_by_points, scan_by_triangles, scan_by_points : the law's exponents
    ray_off, scan_off : largest factor between a row and its law
    rays_ahead     : smallest ratio of a scan's time to that of the rays, over the rows
    sorted_gain    : largest ratio of the time of unsorted points to that of sorted ones
    rays_per_core_s : rays per second and core, of the row nearest to 43,000 triangles and a million points

A law is a product of powers of triangles and points, fitted to the logarithms of the rows by least squares.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np

from benchmarks.scenes.city import City
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.buffers.path_buffer import PathBuffer, ScanView
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.parallel_rays import WORD, ParallelRays
from glpath.gl.ray_bvh import RayBvh
from glpath.scene.model import Float64
from glpath.system.versions import versions

CLAIM = "rays are sooner than scans wherever the triangles fit into memory"
AGREEMENT = (Condition("agreement", ">=", 0.999),)
RULE = (*AGREEMENT, Condition("rays_ahead", ">=", 1.0))

Say = Callable[[str], None]

TRIANGLES = (1_000, 10_000, 43_000, 100_000, 1_000_000)
POINTS = (10_000, 100_000, 1_000_000)
#: Number of directions for which scans are timed.
SCANS = 4
# Offset from the surfaces, in grid units.
_LIFT = 1e-4


def bench_parallel_rays(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    scale : below 1, fewer points, and the largest scenes are left out
    say   : function that gets messages about the progress
    """
    context = get_context()
    gl = context.gl
    directions = neighbouring(WORD)
    rows: list[dict[str, Any]] = []
    for triangles in TRIANGLES:
        if triangles > max(TRIANGLES) * scale and triangles > min(TRIANGLES):
            continue
        city = City.of(triangles)
        scene = DeviceScene(gl, city.scene)
        bvh = RayBvh(gl, scene)
        for points in POINTS:
            count = max(256, round(points * scale))
            say(f"{scene.triangle_count:,} triangles, {count:,} points")
            rows.append(_row(gl, scene, bvh, city.points(count), directions))
        scene.close()
        del scene, bvh
    numbers = {"agreement": min(row["agreement"] for row in rows), **laws(rows)}
    numbers["rays_ahead"] = min(row["scan_s"] / row["ray_s"] for row in rows)
    numbers["sorted_gain"] = max(row["unsorted_s"] / row["ray_s"] for row in rows)
    nearest = min(rows, key=lambda row: (abs(np.log(row["triangles"] / 43_000)), -row["points"]))
    numbers["rays_per_core_s"] = 1.0 / nearest["ray_s"]
    claim, holds = judge(CLAIM, RULE, numbers)
    return Report(
        name="parallel-rays",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy") | {"driver": context.info.driver},
        notes=[] if scale >= 1 else [f"at scale {scale:g}"],
        faults=faults(AGREEMENT, numbers),
    )


def neighbouring(count: int) -> Float64:
    """Return (D, 3) unit directions above the horizon at all heights, each next to the previous one."""
    k = (np.arange(count) + 0.5) / count
    across, around = np.sqrt(1.0 - k**2), 2.0 * np.pi * 3.0 * k
    return np.stack([across * np.cos(around), across * np.sin(around), k], axis=1)


def _row(
    gl: moderngl.Context, scene: DeviceScene, bvh: RayBvh, points: Float64, directions: Float64
) -> dict[str, Any]:
    """Return a row with processor seconds per point and direction."""
    count = len(points)
    lifted = points + np.array([0.0, 0.0, _LIFT])
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    row: dict[str, Any] = {"triangles": scene.triangle_count, "points": count}
    with ParallelRays(gl, scene, bvh, lifted, up) as rays:
        list(rays.see_out(directions[:1]))  # compiles
        row["ray_s"], seen = _seconds(gl, lambda: list(rays.see_out(directions)))
        row["ray_s"] /= count * len(directions)
    with ParallelRays(gl, scene, bvh, lifted, up, sort=False) as rays:
        unsorted_s, _ = _seconds(gl, lambda: list(rays.see_out(directions)))
        row["unsorted_s"] = unsorted_s / (count * len(directions))
    columns = int(np.ceil(count**0.5))
    paths = (columns, -(-count // columns))
    chosen = np.linspace(0, len(directions) - 1, SCANS).astype(int)
    with PathBuffer(gl, scene, paths, occlusion=True) as buffer:
        state = np.zeros((paths[0] * paths[1], 4), np.float32)
        state[:count, :3], state[:count, 3] = lifted, 1.0
        positions = gl.texture(paths, 4, state.tobytes(), dtype="f4")

        def scan() -> None:
            for k in chosen:
                buffer.scan_scene(buffer.scan_positions(positions, ScanView((directions[k],))))

        scan()  # compiles
        scan_s, _ = _seconds(gl, scan)
        row["scan_s"] = scan_s / (count * len(chosen))
        k = int(chosen[1])
        blocked = buffer.blocked(lifted, directions[k])
    seen = (seen[0].word >> np.uint32(k) & np.uint32(1)).astype(np.bool_)
    return row | {"seen": float(seen.mean()), "agreement": float((seen != blocked).mean())}


def _seconds(gl: moderngl.Context, work: Callable[[], Any]) -> tuple[float, Any]:
    gl.finish()
    start = time.process_time()
    made = work()
    gl.finish()
    return time.process_time() - start, made


def laws(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Fit seconds per point and direction of rays and scans: a product of powers of triangles and points."""
    factors = np.log([[row["triangles"] / 1e5, row["points"] / 1e5] for row in rows])
    terms = np.concatenate([np.ones((len(rows), 1)), factors], axis=1)
    found: dict[str, float] = {}
    for name in ("ray", "scan"):
        times = np.log([row[f"{name}_s"] for row in rows])
        law, *_ = np.linalg.lstsq(terms, times, rcond=None)
        off = float(np.exp(np.abs(terms @ law - times).max()))
        found |= {f"{name}_s": float(np.exp(law[0])), f"{name}_by_triangles": float(law[1])}
        found |= {f"{name}_by_points": float(law[2]), f"{name}_off": off}
    return found
