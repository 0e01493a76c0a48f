"""Bias of the defaults in rooms whose light passes narrow gaps: pictures, the solution, lightmaps and probes.

Each is compared with unbiased paths at the same pixels, points, texels or probes. Differences are taken in blocks
of 16 x 16 pixels or texels, in a point, or in a probe. A difference is relative to the reference there; a block
darker than 2 % of the mean counts as that bright. Errors are one standard deviation of the noise of both, by the
spread between the batches of a film. Mitsuba's mean is a second witness of the reference.

Each row is for one room and one product: a picture by `auto` or `gather`, the solution's irradiance at points on
surfaces, a lightmap, or probes; in the part `lookups`, a gather with one of several methods to look up light.

    mean, mean_error      : relative difference of the means
    worst, worst_error    : difference of the block that is farthest off
    worst_beyond          : excess of the worst block's difference over three standard errors
    rms                   : root mean square over blocks, noise included
    reference_mean        : radiance, or irradiance over pi
    reference_error       : standard error of that mean, relative
    reference_block_error : the largest standard error of a block of the reference
    mitsuba, mitsuba_error : relative difference of Mitsuba's mean to the reference's

measured: for each product, the largest `mean_off` and `worst_off` of all rooms, less two and three standard errors.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import glpath
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.references.kept import reference_folder
from benchmarks.scenes.leaky_rooms import ROOMS, room
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.apps.lightmap.lightmap import Bake
from glpath.errors import GlpathError, SceneWarning, UsageError
from glpath.film.film import Film
from glpath.film.noise import standard_error
from glpath.gl.context import get_context
from glpath.io import load_scene
from glpath.rendering.run_options import RunOptions
from glpath.scene.model import Float64, Scene
from glpath.scene.triangulate import path_traceable
from glpath.system.versions import versions

Row = dict[str, Any]
Say = Callable[[str], None]
Ints = NDArray[np.int64]

PARTS = ("pictures", "lookups", "solution", "lightmap", "probes")
RESOLUTION = (128, 96)
#: Pixels or texels along a block's side.
BLOCK = 16
#: Blocks darker than this share of the mean are compared with this share.
FLOOR = 0.02
#: Path sets of the pictures that are measured.
SETS = 64
#: Path sets of a reference at first and at most; they are doubled until its errors meet `ENOUGH`.
FIRST_SETS, MAX_SETS = 512, 8192
#: Maximum standard errors of a reference: of its mean, and of its noisiest block.
ENOUGH = (0.0015, 0.01)
#: Samples per pixel of each of Mitsuba's pictures, how many pictures, and the length of their paths.
MITSUBA_SPP, MITSUBA_SEEDS, DEPTH = 256, 4, 64
#: Points on surfaces; path sets of the references of points, texels and probes.
POINTS, POINT_SETS = 300, 1024
#: Texels along the side of a lightmap. The charts of the books do not fit on a smaller page.
TEXELS = 256
GRID = (4, 2, 4)
#: Larger number of path sets, used if a block has more noise than the second value.
MANY_SETS, NOISY = 1024, 0.02
#: Numbers of standard errors that count as noise: for a mean, and for the worst of many blocks.
SIGMAS, BLOCK_SIGMAS = 2.0, 3.0

CLAIM = "defaults are within 1 % in the mean, and within 5 % in every block, in rooms that leak"
RULES = {
    "pictures": (Condition("auto_mean_off", "<=", 0.01), Condition("auto_worst_off", "<=", 0.05)),
    "lightmap": (Condition("lightmap_mean_off", "<=", 0.02), Condition("lightmap_worst_off", "<=", 0.08)),
}


@dataclass(frozen=True)
class Estimate:
    """Means of groups of pixels, and of all of them, each with its standard error.

    groups, errors   : (K,) radiance
    mean, mean_error : of all pixels
    """

    groups: Float64
    errors: Float64
    mean: float
    mean_error: float

    @classmethod
    def of(cls, film: Film, group: Ints) -> Estimate:
        """Estimate from a film whose first pixels, in rows, belong to the groups 0 to K - 1. group : (N,)"""
        sums = film.radiance_sums.mean(axis=-1).reshape(len(film.radiance_sums), -1)[:, : len(group)]
        sizes = np.bincount(group)
        of_groups = np.stack([np.bincount(group, each) / sizes for each in sums])
        whole, counts = sums.mean(axis=1), film.batch_counts
        return cls(
            of_groups.sum(axis=0) / counts.sum(),
            standard_error(of_groups, counts),
            float(whole.sum() / counts.sum()),
            float(standard_error(whole, counts)),
        )

    @property
    def scale(self) -> Float64:
        """Radiance (K,) to which differences of groups are relative, at least a fraction of the mean."""
        return np.maximum(self.groups, FLOOR * self.mean)


def compared(found: Estimate, reference: Estimate) -> Row:
    """Return the columns of a row that compare two estimates."""
    scale = reference.scale
    off = (found.groups - reference.groups) / scale
    error = np.hypot(found.errors, reference.errors) / scale
    beyond = np.maximum(np.abs(off) - BLOCK_SIGMAS * error, 0.0)
    worst = int(np.argmax(np.abs(off)))
    return {
        "mean": found.mean / reference.mean - 1.0,
        "mean_error": float(np.hypot(found.mean_error, reference.mean_error)) / reference.mean,
        "worst": float(off[worst]),
        "worst_error": float(error[worst]),
        "worst_beyond": float(beyond.max()),
        "rms": float(np.sqrt(np.mean(off**2))),
        "reference_mean": reference.mean,
        "reference_error": reference.mean_error / reference.mean,
        "reference_block_error": float(np.max(reference.errors / scale)),
    }


def blocks(width: int, height: int) -> Ints:
    """Return (height * width,) block numbers of a picture's pixels, in rows."""
    row, column = np.divmod(np.arange(width * height), width)
    return np.asarray(row // BLOCK * -(-width // BLOCK) + column // BLOCK)


def enough(estimate: Estimate) -> bool:
    """Return True if a reference is converged."""
    block = float(np.max(estimate.errors / estimate.scale))
    return estimate.mean_error <= ENOUGH[0] * estimate.mean and block <= ENOUGH[1]


# Pictures


def reference_film(scene: Scene, max_sets: int, say: Say) -> Film:
    """Return the picture by unbiased paths, of up to `max_sets` path sets, kept in the user's cache folder."""
    group = blocks(*RESOLUTION)
    path = reference_folder() / "leaky-rooms" / f"{scene.digest()[:24]}.npz"
    film = Film.load(path) if path.exists() else None
    sets = min(FIRST_SETS, max_sets)
    while film is None or (film.path_sets < max_sets and not enough(Estimate.of(film, group))):
        sets = sets if film is None else min(2 * film.path_sets, max_sets)
        film = glpath.render(scene, integrator="path", spp=sets, seed=1_000_000, film=film)
        path.parent.mkdir(parents=True, exist_ok=True)
        film.save(path)
        say(f"{scene.name}: reference of {film.path_sets} path sets")
    return film


def mitsuba_mean(scene: Scene) -> tuple[float, float]:
    """Return Mitsuba's mean radiance and its standard error; NaN without Mitsuba."""
    try:
        peer = mitsuba_peer.to_mitsuba(path_traceable(scene), DEPTH, spp=MITSUBA_SPP)
    except GlpathError:
        return float("nan"), float("nan")
    means = [mitsuba_peer.render_peer(peer, MITSUBA_SPP, seed).mean() for seed in range(MITSUBA_SEEDS)]
    return float(np.mean(means)), float(np.std(means, ddof=1) / np.sqrt(len(means)))


def picture_rows(scene: Scene, scale: float, say: Say) -> list[Row]:
    """Return a row for `auto` and a row for `gather`."""
    seen = scene.with_camera(resolution=RESOLUTION)
    group = blocks(*RESOLUTION)
    film = reference_film(seen, max(SETS, round(MAX_SETS * scale)), say)
    reference = Estimate.of(film, group)
    peer, peer_error = mitsuba_mean(seen)
    rows = []
    for integrator in ("auto", "gather"):
        started = time.perf_counter()
        picture = glpath.render(seen, integrator=integrator, spp=SETS, seed=1)
        seconds = time.perf_counter() - started
        estimate = Estimate.of(picture, group)
        if np.max(estimate.errors / reference.scale) > NOISY:
            picture = glpath.render(seen, integrator=integrator, spp=MANY_SETS, seed=1)
            estimate = Estimate.of(picture, group)
        bias = picture.bias()
        row: Row = {
            "room": scene.name,
            "product": integrator,
            "chosen": picture.metadata.integrator,
            "seconds": seconds,
            "sets": picture.path_sets,
        }
        row |= compared(estimate, reference)
        row |= {
            "reported_mean": None if bias is None else bias.mean,
            "reported_blocks": None if bias is None else bias.blocks,
            "reference_sets": film.path_sets,
            "mitsuba": peer / reference.mean - 1.0,
            "mitsuba_error": peer_error / reference.mean,
        }
        rows.append(row)
    return rows


#: Rooms of the part `lookups`.
LOOKUP_ROOMS = ("lamp-1cm", "cove", "thin-walls")
#: Methods to look up light without a leak: options of the solver, and of the gather.
LOOKUPS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "coarse elements": ({"patches": 500, "adaptive": 0}, {}),
    "8,000 equal elements": ({"patches": 8000, "adaptive": 0}, {}),
    "coarse, one vertex later": ({"patches": 500, "adaptive": 0}, {"lookup_depth": 3}),
    "split elements": ({"patches": 500, "adaptive": 6}, {}),
    "split elements, longer paths": ({"patches": 500, "adaptive": 6}, {"lookup_distance": 4}),
}


def lookup_rows(scene: Scene, scale: float, say: Say) -> list[Row]:
    """Return a row for each method to look up the light of a solution."""
    seen = scene.with_camera(resolution=RESOLUTION)
    group = blocks(*RESOLUTION)
    reference = Estimate.of(reference_film(seen, max(SETS, round(MAX_SETS * scale)), say), group)
    rows = []
    for name, (of_solver, of_gather) in LOOKUPS.items():
        started = time.perf_counter()
        solution = glpath.solve_radiosity(
            seen, method="monte-carlo", particles=1 << 16, for_camera=True, **of_solver
        )
        seconds = time.perf_counter() - started
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # the warning is about the bias, which is measured here
            film = glpath.render(seen, integrator="gather", radiosity=solution, spp=4 * SETS, seed=1, **of_gather)
        row: Row = {"room": scene.name, "product": name, "seconds": seconds, "elements": solution.element_count}
        rows.append(row | compared(Estimate.of(film, group), reference) | {"noise": film.relative_error()})
    return rows


# Points, texels and probes


def surface_points(scene: Scene, count: int, seed: int = 0) -> tuple[Ints, Float64, Ints]:
    """Return triangles (N,), barycentric coordinates (N, 2) and sides (N,) of points, spread evenly by area."""
    rng = np.random.default_rng(seed)
    triangle = rng.choice(len(scene.areas), count, p=scene.areas / scene.areas.sum())
    b = rng.random((count, 2))
    b = np.where(b.sum(axis=1, keepdims=True) > 1, 1 - b, b)
    return triangle, b, rng.integers(0, 2, count)


def solution_row(scene: Scene, scale: float) -> Row:
    """Return the row of a radiosity solution's irradiance at points, on sides that light gets to."""
    still = path_traceable(scene)
    triangle, b, back = surface_points(still, max(20, round(POINTS * scale)))
    corners = still.triangles[triangle]
    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1]) * (1 - 2 * back)[:, None]
    points = corners[:, 0] + np.einsum("ni,nij->nj", b, edges)
    sets = max(SETS, round(POINT_SETS * scale))
    measured = glpath.irradiance(scene, points, normals, integrator="path", spp=sets)
    started = time.perf_counter()
    solution = glpath.solve_radiosity(scene, method="monte-carlo")
    seconds = time.perf_counter() - started
    every = Estimate.of(measured.film, np.arange(measured.count))
    lit = every.groups > 0
    found = solution.irradiance(triangle, b, back).mean(axis=1)[lit] / np.pi
    # Points are spread evenly by area, so their plain mean is the area-weighted mean. An element's mean differs
    # from the light at one of its points, so the number of points limits the precision of the mean difference.
    errors = every.errors[lit]
    mean_error = float(np.sqrt(np.mean(errors**2) / lit.sum()))
    reference = Estimate(every.groups[lit], errors, float(every.groups[lit].mean()), mean_error)
    scatter = float(np.std(found - reference.groups) / np.sqrt(lit.sum()))
    estimate = Estimate(found, np.zeros(len(found)), float(found.mean()), scatter)
    return {"room": scene.name, "product": "solution", "seconds": seconds} | compared(estimate, reference)


def lightmap_row(scene: Scene, scale: float) -> Row:
    """Return the row of a lightmap of the defaults, not denoised, in blocks of its page."""
    sets = max(SETS, round(POINT_SETS * scale))
    started = time.perf_counter()
    bake = Bake.of(scene, size=TEXELS, spp=SETS, denoise=False)
    film = bake.film(RunOptions())
    seconds = time.perf_counter() - started
    truth = Bake.of(scene, size=TEXELS, spp=sets, denoise=False, integrator="path", seed=1_000_000)
    texels, rendered = bake.surfaces.texels, ~bake.surfaces.inside
    block = texels.row // BLOCK * (TEXELS // BLOCK) + texels.column // BLOCK
    group = np.unique(block[rendered], return_inverse=True)[1]
    reference, estimate = Estimate.of(truth.film(RunOptions()), group), Estimate.of(film, group)
    if np.max(estimate.errors / reference.scale) > NOISY:
        film = Bake.of(scene, size=TEXELS, spp=max(SETS, sets // 2), denoise=False).film(RunOptions())
        estimate = Estimate.of(film, group)
    row: Row = {"room": scene.name, "product": "lightmap", "chosen": film.metadata.integrator, "seconds": seconds}
    return row | {"sets": film.path_sets} | compared(estimate, reference)


def probes_row(scene: Scene, scale: float) -> Row:
    """Return the row of light probes by `gather`: the mean irradiance of each."""
    sets = max(SETS, round(POINT_SETS * scale))
    started = time.perf_counter()
    found = glpath.probes(scene, GRID, integrator="gather", spp=SETS)
    seconds = time.perf_counter() - started
    truth = glpath.probes(scene, GRID, integrator="path", spp=sets, seed=1_000_000)
    points = len(found.grid.receivers()[0])
    group = np.repeat(np.arange(int(found.grid.valid.sum())), points // int(found.grid.valid.sum()))
    row = {"room": scene.name, "product": "probes", "chosen": found.film.metadata.integrator, "seconds": seconds}
    return row | compared(Estimate.of(found.film, group), Estimate.of(truth.film, group))


# The bench


def worst_of(rows: Iterable[Row]) -> dict[str, float]:
    """Return the largest differences of all rooms for each product, minus the part that noise explains."""
    measured: dict[str, float] = {}
    for row in rows:
        product = row["product"]
        mean = max(abs(row["mean"]) - SIGMAS * row["mean_error"], 0.0)
        for name, value in (("mean_off", mean), ("worst_off", row["worst_beyond"])):
            key = f"{product}_{name}"
            measured[key] = max(measured.get(key, 0.0), value)
    return measured


def check_parts(parts: Sequence[str]) -> None:
    """Raise UsageError unless all parts exist."""
    unknown = [part for part in parts if part not in PARTS]
    if unknown or not parts:
        named = ", ".join(map(repr, unknown)) or "nothing"
        raise UsageError(f"--parts: {named}; allowed are {', '.join(PARTS)}")


def rows_of(scene: Scene, parts: Sequence[str], scale: float, say: Say) -> list[Row]:
    """Return the rows of a room."""
    rows = picture_rows(scene, scale, say) if "pictures" in parts else []
    if "lookups" in parts and scene.name in LOOKUP_ROOMS:
        rows += lookup_rows(scene, scale, say)
    if "solution" in parts:
        rows.append(solution_row(scene, scale))
    if "lightmap" in parts:
        rows.append(lightmap_row(scene, scale))
    if "probes" in parts:
        rows.append(probes_row(scene, scale))
    for row in rows:
        say(f"{row['room']} {row['product']}: mean {row['mean']:+.2%}, worst block {row['worst']:+.1%}")
    return rows


def bench_leaky_rooms(
    parts: Sequence[str] = PARTS,
    scale: float = 1.0,
    say: Say = lambda text: None,
    rooms: Sequence[str] = tuple(ROOMS),
) -> Report:
    """Measure the bias of the defaults in leaky rooms.

    Parameters
    ----------
    parts : names from `PARTS`
    scale : below 1, fewer path sets of the references, and fewer points
    say   : function that gets messages about the progress
    rooms : names of `ROOMS`

    Raises UsageError for an unknown part.
    """
    check_parts(parts)
    rows = [row for name in rooms for row in rows_of(load_scene(room(name)), parts, scale, say)]
    measured = worst_of(rows)
    rule = tuple(condition for part in parts for condition in RULES.get(part, ()))
    claim, holds = judge(CLAIM, rule, measured)
    return Report(
        "leaky-rooms",
        claim,
        measured,
        holds if rule else None,
        rows,
        machine(get_context().info.renderer),
        versions("glpath", "moderngl", "numpy", "mitsuba"),
    )
