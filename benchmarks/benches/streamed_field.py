"""A height field as a stream of triangles: visibility of 145 sky patches from a million points, in 256 MiB.

The field is that of `height_field`; its triangles are a .npy file in tiles. `glpath.apps.daylight.visibility` finds
the visibility in one pass over the file: parts of the triangles, each as large as the budget allows, get a BVH one
after another.

A law is fitted to two smaller fields with as many points: core seconds for each triangle that is read and put into
a BVH, and for each point and direction, which grow by a power of the number of triangles. `measured`:

    seconds, core_s : wall and core seconds of the largest field, from the points to their visibility
    law_off         : core seconds divided by those that the law predicts
    budget_share    : peak memory divided by the budget, without points, results and the program's memory before
    resumed         : 1 if a run that is interrupted in the middle of a pass ends with the bits of one run
    off_memory      : fraction of points and directions for which the smallest field in memory gives another result

Source: issue 43 for the limits.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.benches.height_field import OFFSET, hills, points_on
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.apps.daylight.compute import DaylightProgress, daylight_coefficients
from glpath.apps.daylight.visibility import PointVisibility
from glpath.apps.terrain.height_field import HeightField
from glpath.gl.context import get_context
from glpath.gl.stream_parts import StreamParts
from glpath.io import scene_from_dict
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Float64
from glpath.system.machine import core_count, peak_resident_bytes, return_memory
from glpath.system.versions import versions

Row = dict[str, Any]
Say = Callable[[str], None]

CLAIM = "20 million streamed triangles, a million points, 145 patches: in 256 MiB, as the law predicts to 20 %"
EXACT = (Condition("off_memory", "<=", 1e-5), Condition("resumed", ">=", 1.0))
RULE = (
    Condition("budget_share", "<=", 1.0),
    Condition("law_off", "<=", 1.2),
    Condition("law_off", ">=", 1 / 1.2),
    *EXACT,
)

#: Tiles along the sides of the fields, samples along a tile's side, number of points, and budget in MiB.
TILES, TILE, POINTS, BUDGET = (4, 8, 25), 128, 1_000_000, 256
#: Tiles along the sides of the fields in a small run.
SMALL_TILES = (3, 4, 5)
_UP = np.array([0.0, 0.0, 1.0])


def tile_triangles(field: HeightField, row: int, column: int) -> Float64:
    """Return the triangles (2 TILE^2, 3, 3) of a tile of a field."""
    x, y = (at[TILE * k : TILE * (k + 1) + 1] for at, k in zip(field.coordinates(), (column, row), strict=True))
    z = field.heights[TILE * row : TILE * (row + 1) + 1, TILE * column : TILE * (column + 1) + 1]
    corner = np.stack([*np.meshgrid(x, y), z], axis=-1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.stack([np.stack([a, d, b], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)


def resident_bytes() -> int:
    """Return the resident memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def write_tiles(field: HeightField, tiles: int, path: Path) -> None:
    """Write all triangles of a field as .npy, tile by tile."""
    header = {"descr": "<f4", "fortran_order": False, "shape": (2 * (tiles * TILE) ** 2, 3, 3)}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for number in range(tiles**2):
            file.write(tile_triangles(field, *divmod(number, tiles)).astype("<f4").tobytes())


def streamed(path: Path) -> Scene:
    """Return the scene of a field's file."""
    view = {"position": [0, -9, 9], "target": [0, 0, 0], "up": [0, 0, 1]}
    return scene_from_dict({"camera": view, "shapes": [{"type": "stream", "file": str(path)}]})


def _row(scene: Scene, points: Float64, budget: int, alone: bool) -> Row:
    """Return a row with the seconds of one pass; with `alone`, also those of building the BVHs alone."""
    triangles = scene.shapes.total("stream")
    given: dict[str, Any] = {"samples": 1, "max_depth": 1, "geometry_budget": budget}
    row: Row = {"triangles": triangles, "points": len(points)}
    if alone:
        gl, before = get_context().gl, time.process_time()
        parts = StreamParts(path_traceable(scene, streams=True), budget)(gl, 1e5)
        while next(parts, None) is not None:
            pass  # no name refers to the part, so it is freed before the next one is built
        row["build_s"] = time.process_time() - before
    # Memory besides the parts: points, their textures, and visibility words, measured without any part.
    with PointVisibility(get_context().gl, scene, points, np.broadcast_to(_UP, points.shape), "plane", budget):
        return_memory()
        resident = resident_bytes()
    started, before = time.perf_counter(), time.process_time()
    found = daylight_coefficients(scene, points, _UP, **given)
    row["seconds"], row["core_s"] = time.perf_counter() - started, time.process_time() - before
    results = found.words.nbytes + found.points.nbytes + found.normals.nbytes
    row["MiB"] = (peak_resident_bytes() - resident - results) / 2**20
    row["directions"] = len(found.directions)
    row["seen"] = float(found.sky_view.mean())
    return row


def predicted(rows: list[Row], triangles: int) -> float:
    """Return core seconds for a larger field, predicted from two smaller ones with as many points.

    NaN if building the BVHs alone took no less than the whole, as in a small run with few rays.
    """
    small, large = rows
    of_rays = [row["core_s"] - row["build_s"] for row in rows]
    if min(of_rays) <= 0:
        return float("nan")
    power = np.log(of_rays[1] / of_rays[0]) / np.log(large["triangles"] / small["triangles"])
    share = triangles / large["triangles"]
    return float(large["build_s"] * share + of_rays[1] * share**power)


def resumes(scene: Scene, points: Float64, budget: int, folder: Path) -> bool:
    """Return True if a run that is interrupted in its second part has the bits of an uninterrupted run."""
    given: dict[str, Any] = {"samples": 1, "max_depth": 1, "geometry_budget": budget}
    whole = daylight_coefficients(scene, points, _UP, **given)
    seen = []

    def stop(progress: DaylightProgress) -> None:
        if progress.stage == "stream":
            seen.append(progress.done)
            if len(seen) == 2:
                raise KeyboardInterrupt

    from glpath.apps.daylight import kept_words

    seconds, kept_words._PASS_SECONDS = kept_words._PASS_SECONDS, 0.0
    try:
        daylight_coefficients(scene, points, _UP, **given, resume=folder / "part", on_progress=stop)
    except KeyboardInterrupt:
        again = daylight_coefficients(scene, points, _UP, **given, resume=folder / "part")
        return bool(np.array_equal(whole.words, again.words))
    finally:
        kept_words._PASS_SECONDS = seconds
    return False


def off_memory(field: HeightField, scene: Scene, points: Float64, budget: int) -> float:
    """Return the fraction of points and directions for which the same triangles in memory give another result."""
    vertices, faces = field.triangles()
    mesh = {"type": "mesh", "vertices": vertices, "faces": faces}
    memory = scene_from_dict({"camera": {"position": [0, -9, 9], "target": [0, 0, 0]}, "shapes": [mesh]})
    options: dict[str, Any] = {"samples": 1, "max_depth": 1, "up": _UP, "north": [0, 1, 0]}
    one = daylight_coefficients(memory, points, _UP, **options)
    other = daylight_coefficients(scene, points, _UP, **options, geometry_budget=budget)
    wrong = np.unpackbits((one.words ^ other.words).view(np.uint8)).sum()
    return float(wrong / (len(points) * len(one.directions)))


def bench_streamed_field(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores, and 0.8 GB of the folder for temporary files.

    scale : below 1, fewer points, and below a quarter smaller fields
    say   : function that gets messages about the progress
    """
    tiles = TILES if scale >= 0.25 else SMALL_TILES
    count, budget = max(256, round(POINTS * scale)), BUDGET if scale >= 0.25 else 32
    rows: list[Row] = []
    numbers: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for along in tiles:
            field = hills(TILE * along + 1)
            path = Path(folder, f"{along}.npy")
            write_tiles(field, along, path)
            at = points_on(field, count, 1)
            points = np.column_stack([at, field.heights_at(at) + OFFSET])
            scene = streamed(path)
            say(f"{scene.shapes.total('stream'):,} triangles")
            some = points[: max(256, count // 100)]
            if not rows:
                daylight_coefficients(scene, some, _UP, samples=1, max_depth=1)  # compiles
                numbers["off_memory"] = off_memory(field, scene, some, 32)
            if len(rows) == 1:
                numbers["resumed"] = float(resumes(scene, some, 32, Path(folder)))
            del field
            rows.append(_row(scene, points, budget, alone=along != tiles[-1]))
            path.unlink()
    last = rows[-1]
    numbers |= {
        "triangles": last["triangles"],
        "points": count,
        "seconds": last["seconds"],
        "core_s": last["core_s"],
        "predicted_core_s": predicted(rows[:-1], last["triangles"]),
        "budget_share": last["MiB"] / budget,
    }
    numbers["law_off"] = last["core_s"] / numbers["predicted_core_s"]
    claim, holds = judge(CLAIM, RULE, numbers)
    context = get_context()
    return Report(
        name="streamed-field",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "numba") | {"driver": context.info.driver},
        notes=[f"{core_count()} cores", *([] if scale >= 1 else [f"at scale {scale:g}"])],
        faults=faults(EXACT, numbers),
    )
