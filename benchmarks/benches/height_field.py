"""Sky view factors and sun hours of terrain: a million points of 20 million triangles, compared with ray tracing.

The field has hills of all sizes, interpolated from random lattices, with 10 m per sample and slopes up to about 45
degrees. The suns are those of a year at a latitude of 47 degrees, in steps of declination and hour angle.

Errors are measured on a part of the same field that is small enough for Embree: sky view factors by stratified
cosine-weighted rays, and sun hours by a ray to each sun.

Source: Dozier & Frew 1990; issue 43 for the limits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.embree import embreex_triangles
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.apps.terrain.height_field import HeightField
from glpath.apps.terrain.horizon import AZIMUTHS, Horizon, horizon
from glpath.errors import GlpathError
from glpath.system.machine import core_count, peak_resident_bytes
from glpath.system.versions import versions

Float64 = NDArray[np.float64]
Row = dict[str, Any]
Say = Callable[[str], None]

CLAIM = "a million points of 20 million triangles: sky view factors and sun hours in 10 minutes and 1 GiB"
COST = (Condition("points_s", "<=", 600.0), Condition("GiB_most", "<=", 1.0))
ERRORS = (Condition("sky_off_rms", "<=", 1e-3), Condition("sun_hours_off_rms", "<=", 1e-3))

SIDE, POINTS, SPACING = 3164, 1_000_000, 10.0
#: Samples along a side of the part, number of its points, and rays of each point along both axes of a square.
CUT, CUT_POINTS, CUT_RAYS = 257, 60, 400
LATITUDE = 47.0
#: Height of ray origins above the surface: a few rounding errors of coordinates.
OFFSET = 2e-3


def hills(side: int, seed: int = 43) -> HeightField:
    """Return a square field of hills of all sizes, made in strips to save memory."""
    rng = np.random.default_rng(seed)
    octaves = []
    size = 512.0
    while size >= 2.0:
        count = math.ceil(side / size) + 2
        octaves.append(
            (size, (0.2 * SPACING * size**0.85 * rng.standard_normal((count, count))).astype(np.float32))
        )
        size /= 2
    heights = np.zeros((side, side), np.float32)
    for begin in range(0, side, 128):
        rows = np.arange(begin, min(begin + 128, side))
        for size, lattice in octaves:
            (i, v), (j, u) = (_smooth(at / size) for at in (rows, np.arange(side)))
            below = lattice[i] * (1 - v)[:, None] + lattice[i + 1] * v[:, None]
            heights[rows] += below[:, j] * (1 - u) + below[:, j + 1] * u
    # The origin is in the middle, where Embree's 32-bit numbers are most precise.
    middle = 0.5 * SPACING * (side - 1)
    return HeightField.of(heights, SPACING, (-middle, middle))


def _smooth(at: Float64) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    whole = np.floor(at).astype(np.int64)
    part = (at - whole).astype(np.float32)
    return whole, part * part * (3 - 2 * part)


def suns_of_a_year(declinations: int = 25, minutes: int = 30) -> tuple[Float64, Float64, Float64]:
    """Return (S,) azimuths and altitudes in degrees, and hours, in even steps through year and day."""
    day = (
        2 * np.pi * (np.arange(declinations) + 0.5) / (2 * declinations)
    )  # half of a year; the other is its mirror
    declination = np.radians(23.44) * -np.cos(day)
    hour = np.radians(15.0) * (np.arange(0, 24, minutes / 60) + minutes / 120 - 12)
    d, h = (each.ravel() for each in np.meshgrid(declination, hour, indexing="ij"))
    latitude = math.radians(LATITUDE)
    altitude = np.arcsin(math.sin(latitude) * np.sin(d) + math.cos(latitude) * np.cos(d) * np.cos(h))
    east = -np.cos(d) * np.sin(h)
    north = math.cos(latitude) * np.sin(d) - math.sin(latitude) * np.cos(d) * np.cos(h)
    seen = altitude > 0
    hours = np.full(len(d), 365.0 / declinations * minutes / 60)
    return np.degrees(np.arctan2(east, north))[seen] % 360, np.degrees(altitude)[seen], hours[seen]


def points_on(field: HeightField, count: int, seed: int) -> Float64:
    """Return (N, 2) points away from triangles' edges, because comparison rays begin above the surface."""
    rng = np.random.default_rng(seed)
    rows, columns = field.shape
    cells = rng.integers([0, 0], [columns - 1, rows - 1], (count, 2))
    inside = np.where(rng.random((count, 1)) < 0.5, [[0.65, 0.35]], [[0.35, 0.65]]) + 0.2 * (
        rng.random((count, 2)) - 0.5
    )
    return np.asarray((cells + inside) * np.array(field.spacing) * [1, -1] + field.origin)


def cost_rows(field: HeightField, points: int, say: Say) -> list[Row]:
    """Return rows with wall and processor seconds for points and for all samples, and the peak memory so far."""
    suns = suns_of_a_year()
    at_points, at_samples = horizon(field, points_on(field, points, 1)), horizon(field)
    rows = []
    for name, found, work in (
        ("points: sky view factors", at_points, Horizon.sky_view_factor),
        ("points: sun hours", at_points, lambda found: found.sun_hours(*suns)),
        ("all samples: sky view factors", at_samples, Horizon.sky_view_factor),
    ):
        say(name)
        started, before = time.perf_counter(), time.process_time()
        values = work(found)
        seconds, core_seconds = time.perf_counter() - started, time.process_time() - before
        rows.append(
            {
                "what": name,
                "receivers": values.size,
                "directions": len(suns[0]) if "sun" in name.split(":")[1] else AZIMUTHS,
                "seconds": seconds,
                "core seconds": core_seconds,
                "receivers per second": values.size / seconds,
                "GiB, most": peak_resident_bytes() / 2**30,
                "mean": float(values.mean()),
            }
        )
    return rows


def error_rows(side: int, points: int, rays: int, say: Say) -> list[Row]:
    """Return rows with errors, against ray tracing, of sky view factors by azimuths, and of sun hours."""
    say("rays to compare with")
    field = hills(side)
    vertices, faces = field.triangles()
    cast = embreex_triangles(vertices[faces])
    rows: list[Row] = []
    at = points_on(field, points, 2)
    for surface in (None, "surface"):
        found = horizon(field, at, surface)
        assert found.points is not None, "given"
        normals = np.broadcast_to(found.normals, (points, 3)).astype(np.float64)
        expected = np.array([_open_sky(cast, p, n, rays) for p, n in zip(found.points, normals, strict=True)])
        for azimuths in (16, 32, AZIMUTHS, 128, 360):
            off = horizon(field, at, surface, azimuths=azimuths).sky_view_factor() - expected
            rows.append(
                {
                    "what": f"sky view factor, {'level' if surface is None else 'on slopes'}",
                    "azimuths": azimuths,
                    "off, rms": float(np.sqrt(np.mean(off**2))),
                    "off, most": float(np.abs(off).max()),
                    "off, mean": float(off.mean()),
                }
            )
    suns = suns_of_a_year()
    # Use the points at which rays begin; otherwise suns that graze the surface between both would differ.
    found = horizon(field, points_on(field, 20 * points, 3), height=OFFSET)
    assert found.points is not None, "given"
    expected = np.array([_sun_hours(cast, point, suns) for point in found.points])
    off = (found.sun_hours(*suns) - expected) / suns[2].sum()
    rows.append(
        {
            "what": "sun hours, as a share of the year's",
            "off, rms": float(np.sqrt(np.mean(off**2))),
            "off, most": float(np.abs(off).max()),
            "off, mean": float(off.mean()),
        }
    )
    return rows


def _toward(azimuth: Float64, altitude: Float64) -> Float64:
    across = np.cos(altitude)
    return np.stack([across * np.sin(azimuth), across * np.cos(azimuth), np.sin(altitude)], axis=1)


def _sees(cast: Any, origin: Float64, directions: Float64) -> NDArray[np.bool_]:
    origins = np.broadcast_to(origin, directions.shape).astype(np.float32)
    return np.asarray(cast(np.ascontiguousarray(origins), directions.astype(np.float32)) < 0)


def _open_sky(cast: Any, point: Float64, normal: Float64, rays: int) -> float:
    """Return the fraction of cosine-weighted rays, one in each cell of a square, that reach the sky."""
    rng = np.random.default_rng(5)
    i, j = np.divmod(np.arange(rays**2), rays)
    r, a = np.sqrt((i + rng.random(rays**2)) / rays), 2 * np.pi * (j + rng.random(rays**2)) / rays
    local = np.stack([r * np.cos(a), r * np.sin(a), np.sqrt(np.maximum(1 - r * r, 0.0))], axis=1)
    beside = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.6 else [0.0, 1.0, 0.0])
    beside /= np.linalg.norm(beside)
    toward = local @ np.stack([beside, np.cross(normal, beside), normal])
    return float((_sees(cast, point + OFFSET * normal, toward) & (toward[:, 2] > 0)).mean())


def _sun_hours(cast: Any, point: Float64, suns: tuple[Float64, Float64, Float64]) -> float:
    seen = _sees(cast, point, _toward(np.radians(suns[0]), np.radians(suns[1])))
    return float(suns[2][seen].sum())


def bench_height_field(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    The report's numbers: `points_s` and `points_core_s`, wall and core seconds for sky view factors and sun hours
    at all points; `samples_s`, seconds for sky view factors at all samples; `GiB_most`, peak memory of the process;
    `sky_off_rms`, `sky_off_most`, `sun_hours_off_rms` and `sun_hours_off_most`, differences from ray tracing. One
    of 600 suns is 1.7e-3 of the sun hours.

    Parameters
    ----------
    scale : below 1, a smaller field and fewer points
    say   : function that gets messages about the progress
    """
    share = math.sqrt(scale)
    field = hills(max(65, round(SIDE * share)))
    tiny = horizon(hills(33), [[50.0, -50.0]])  # compiles
    tiny.sky_view_factor(), tiny.sun_hours([180.0], [30.0]), horizon(hills(33)).sky_view_factor()
    rows = cost_rows(field, max(1000, round(POINTS * scale)), say)
    sky, sun, samples = rows
    numbers: dict[str, float] = {
        "triangles": field.triangle_count,
        "points": sky["receivers"],
        "suns": sun["directions"],
        "points_s": sky["seconds"] + sun["seconds"],
        "points_core_s": sky["core seconds"] + sun["core seconds"],
        "samples_s": samples["seconds"],
        "samples_core_s": samples["core seconds"],
        "GiB_most": max(row["GiB, most"] for row in rows),
    }
    notes = [f"{core_count()} cores"]
    rule: tuple[Condition, ...] = COST
    try:
        off = error_rows(max(65, round(CUT * share)), CUT_POINTS, max(40, round(CUT_RAYS * share)), say)
    except GlpathError as error:
        notes.append(f"without rays: {error}")
    else:
        rows += off
        at_default = [row for row in off if row.get("azimuths") == AZIMUTHS]
        numbers["sky_off_rms"] = max(row["off, rms"] for row in at_default)
        numbers["sky_off_most"] = max(row["off, most"] for row in at_default)
        numbers["sun_hours_off_rms"] = off[-1]["off, rms"]
        numbers["sun_hours_off_most"] = off[-1]["off, most"]
        rule = (*COST, *ERRORS)
    if scale != 1:
        notes.append(f"at scale {scale:g}")
    claim, holds = judge(CLAIM, rule, numbers)
    return Report(
        name="height-field",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=rows,
        machine=machine("none; on the CPU"),
        versions=versions("glpath", "numpy", "numba"),
        notes=notes,
    )
