"""Computation of daylight coefficients: rays of all sensors along all directions, then reflected light."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.daylight.bias import bias_of_solution
from glpath.apps.daylight.bounces import (
    DEFAULT_ELEMENTS,
    GATHER_RAYS,
    GATHER_SEED,
    POINTS,
    ReflectingSides,
    Reflections,
    gathered,
)
from glpath.apps.daylight.checkpoint import DaylightCheckpoint
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compass import Compass
from glpath.apps.daylight.kept_words import KeptPass, KeptWords
from glpath.apps.daylight.receivers import RECEIVERS, Receiver
from glpath.apps.daylight.shard import Shard, shard_range
from glpath.apps.daylight.sky_patches import SkyPatches
from glpath.apps.daylight.sun_bins import MAX_BINS, MAX_SUNS, SunBins
from glpath.apps.daylight.visibility import GEOMETRY_BUDGET, PointVisibility, masked
from glpath.errors import SceneError, UsageError, argument, warn, warning_scope
from glpath.film.bias import Bias
from glpath.gl.context import open_context
from glpath.gl.parallel_rays import WORD
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.rendering.interrupts import interrupt_as_flag
from glpath.rendering.points import checked_points
from glpath.scene import Scene, path_traceable
from glpath.system.arguments import check_count, check_word, checked, short_repr

if TYPE_CHECKING:
    from glpath.jobs.connection import Connection

Float64 = NDArray[np.float64]
Words = NDArray[np.uint32]
Shares = NDArray[np.float16]

#: Maximum number of directions per patch.
MAX_SAMPLES = 256
#: Number of rays into the sky, of all sensors together, that the default of `samples` allows. They take some
#: seconds.
DEFAULT_RAYS = 100_000_000
#: Number of directions per sky patch for direct light on elements. A few are enough, because each sensor sees many
#: elements, whose errors average out.
ELEMENT_SAMPLES = 4
#: Number of directions to the ground, which is one patch, for direct light on elements.
ELEMENT_GROUND = 512
#: Maximum value of the option `elements`.
MAX_ELEMENTS = 10**7
#: Maximum value of the option `gather_rays`.
MAX_GATHER_RAYS = 10**7
#: Factor on the number of elements if the bias with `DEFAULT_ELEMENTS` is too large.
REFINED = 4


@dataclass(frozen=True)
class DaylightProgress:
    """Progress of a computation of daylight coefficients.

    stage     : name of the current work
    done, total : number of finished directions and of all directions, each traced from all sensors. In stage
                  "stream" numbers of chunks, in stage "shards" numbers of shards
    sensors   : number of sensors
    elapsed_s : time since the call, seconds
    """

    stage: str
    done: int
    total: int
    sensors: int
    elapsed_s: float


@checked
def daylight_coefficients(
    scene: AnyScene,
    points: ArrayLike,
    normals: ArrayLike | None = None,
    *,
    subdivision: int = 1,
    samples: int | None = None,
    latitude: float | None = None,
    suns: int = MAX_BINS,
    receiver: Receiver = "plane",
    max_depth: int | None = None,
    elements: int | None = None,
    gather_rays: int = GATHER_RAYS,
    geometry_budget: int = GEOMETRY_BUDGET,
    up: ArrayLike | None = None,
    north: ArrayLike | None = None,
    seed: int = 0,
    shard: tuple[int, int] | None = None,
    resume: str | Path | DaylightCheckpoint | None = None,
    cluster: Connection | None = None,
    on_progress: Callable[[DaylightProgress], None] | None = None,
    parameters: Mapping[str, object] | None = None,
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
) -> DaylightCoefficients:
    """Compute the light at sensors from each sky patch, from the ground and from each sun position.

    Thin glass transmits the fraction that its material defines. Surfaces with an opacity transmit rays at random.
    Reflected light comes from a radiosity solution, which takes all surfaces as diffuse, and is gathered by rays of
    each sensor; see `bounces` in this package. A scene with a stream has direct light only, with a SceneWarning
    unless max_depth is 1. One pass over the stream serves all sensors and directions.

    Parameters
    ----------
    scene       : any source that `load_scene` accepts; its camera and light are ignored
    points      : (N, 3), scene units, free in space or on surfaces, which do not shadow their own points
    normals     : (N, 3), or (3,) for all, of any nonzero length; optional for spheres
    subdivision : subdivision of the sky: 1, 2 or 4 for 145, 577 or 2,305 patches
    samples     : number of directions per patch: 1, its centre, or an even number; errors are estimated from 4 on.
                  The default is from 4 to 64, for up to a hundred million rays of all sensors
    latitude    : latitude for positions of the sun, degrees, positive in the north; None: no suns
    suns        : maximum number of sun positions
    receiver    : "plane", "cylinder" (the normal is its axis) or "sphere"; see `glpath.apps.daylight.receivers`
    max_depth   : maximum number of surfaces that light meets, including the sensor: 1 is direct light; None: no
                  limit
    elements    : approximate number of surface elements; a triangle has at least one. None: 2,000, or 8,000 if the
                  bias with 2,000 is too large
    gather_rays : number of rays per sensor for reflected light
    geometry_budget : memory budget for streamed triangles, on the device and on the host, MiB
    up, north   : (3,); default: the scene's up, and north that of its sky if that has the same up, otherwise y if
                  z is up, -z if y is up
    seed        : seed of the directions in the patches and of all other random numbers
    shard       : (k, n), the k-th of n shards from 1: a range of the sensors. `glpath merge` merges all shards
                  into a result that is bit-identical to one computation
    resume      : checkpoint file, from which another call with the same sensors and directions resumes. It is
                  written after each word of directions, or every half minute with a stream, and removed at the end.
                  With a cluster it is a folder of shards. If a `DaylightCheckpoint` is given, the caller removes it
    cluster     : workers that share the sensors (`glpath.jobs.cluster.Cluster`); the result is bit-identical
    on_progress : called after each word of 32 directions, or part of a stream, with a `DaylightProgress`
    backend, device, require_gpu : see `glpath.gl.context.open_context`

    The bias of reflected light is measured under a sky and a ground of radiance 1 (`indirect.bias`). A SceneWarning
    is issued if the bias exceeds 1 % of the light in the mean, or 3 % in a block of sensors.

    Raises UsageError for invalid options and points, SceneError for a scene in which no ray can be traced, and
    ImageError if the checkpoint belongs to other work. KeyboardInterrupt is raised between two words or parts.

    Cost:     0.05 to 0.2 microseconds of a core for each sensor and direction; 4 bytes for each sensor and word of
              32 directions. Reflected light: some seconds for the solution, a microsecond per gather ray, and 8
              bytes for each element that a sensor sees. Stream: a microsecond of a core for each triangle, once;
              and the cost of each ray again for each part of the stream that the ray may meet.
    Poor at:  patches seen through small openings, which need more samples.

    >>> found = daylight_coefficients("cornell-box", [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0], samples=2)
    >>> found.sky().shape
    (1, 146)
    """
    started = time.perf_counter()
    check_word("receiver", receiver, RECEIVERS)
    of_counts = (
        ("elements", elements, 1, MAX_ELEMENTS),
        ("gather_rays", gather_rays, 1, MAX_GATHER_RAYS),
        ("geometry_budget", geometry_budget, 1, 2**31),
        ("max_depth", max_depth, 1, 2**31),
        ("suns", suns, 1, MAX_SUNS),
        ("seed", seed, 0, 2**63 - 1),
    )
    for name, value, low, high in of_counts:
        if value is not None:  # None stands for a default that depends on the scene
            check_count(name, value, low, high)
    is_whole = isinstance(samples, int)
    if not (samples is None or (is_whole and (samples == 1 or (samples % 2 == 0 and 2 <= samples <= MAX_SAMPLES)))):
        raise UsageError(f"samples: {short_repr(samples)} where 1 or an even number up to {MAX_SAMPLES} is needed")
    if normals is None:
        if receiver != "sphere":
            raise UsageError(f"normals: none, but a {receiver} has one.", "Give them, or take receiver='sphere'.")
        normals = [0.0, 0.0, 1.0]
    positions, facing = checked_points(points, normals)
    patches = SkyPatches(subdivision)
    with aside("camera", "light"):
        loaded = load_scene(scene, parameters)
    reflects = max_depth != 1
    if reflects and loaded.shapes.streams:
        if max_depth is not None:
            raise SceneError(
                f"{loaded.source or loaded.name}: has a stream, from which no light is reflected: max_depth is "
                f"{max_depth}.",
                f"Take {argument('max_depth', 1)}, direct light, or hold the triangles in memory.",
            )
        warn(f"{loaded.source or loaded.name}: has a stream, so there is direct light alone.")
        reflects = False
    compass = Compass.of(loaded, up, north)
    if samples is None:
        samples = default_samples(len(positions), len(patches))
    sun = np.zeros((0, 3)) if latitude is None else SunBins.of(latitude, compass, suns).directions
    shared = _Shared.of(patches, compass, samples, seed, sun)
    directions = shared.directions
    checkpoint = DaylightCheckpoint(Path(resume)) if isinstance(resume, str | Path) else resume
    part, first_sensor, every_sensor = None, 0, (positions, facing)
    if shard is not None or cluster is not None:
        settings = (max_depth, elements, gather_rays, seed) if reflects else ()
        work = _key(f"{loaded.digest(camera=False)} {settings}", positions, facing, directions, receiver)
    if cluster is not None:
        if shard is not None:
            raise UsageError("cluster: makes shards itself; shard is one of them alone.", "Give one of the two.")
        from glpath.apps.daylight.cluster import (  # late, because it imports the package distributed
            DaylightWork,
            computed_by,
        )

        of_each = {
            "subdivision": subdivision,
            "samples": samples,
            "latitude": latitude,
            "suns": suns,
            "receiver": receiver,
            "max_depth": max_depth if reflects else 1,
            "elements": elements,
            "gather_rays": gather_rays,
            "geometry_budget": geometry_budget,
            "up": up,
            "north": north,
            "seed": seed,
            "backend": backend,
            "device": device,
            "require_gpu": require_gpu,
        }

        def shards_done(done: int, count: int) -> None:
            if on_progress is not None:
                since = time.perf_counter() - started
                on_progress(DaylightProgress("shards", done, count, len(positions), since))

        with warning_scope(strict=False) as scope, checkpoint or nullcontext():
            of_all = DaylightWork(loaded, positions, facing, of_each, daylight_coefficients)
            merged = computed_by(cluster, of_all, work, checkpoint, shards_done)
            if checkpoint is not None and checkpoint is not resume:
                checkpoint.remove()
        scope.raise_late(merged)
        return merged
    if shard is not None:
        first_sensor, end = shard_range(shard, len(positions))
        part = Shard(first_sensor, len(positions), work)
        positions, facing = positions[first_sensor:end], facing[first_sensor:end]
    count = len(positions)

    def report(stage: str, done: int) -> None:
        if on_progress is not None:
            passed = time.perf_counter() - started
            on_progress(DaylightProgress(stage, done, len(directions), count, passed))

    with warning_scope(strict=False) as scope, ExitStack() as held:
        kept: KeptWords | KeptPass | None = None
        if checkpoint is not None:
            held.enter_context(checkpoint)
            kept = KeptPass.of(checkpoint.path) if loaded.shapes.streams else KeptWords(checkpoint.path)
            held.callback(checkpoint.take_failure, kept)
            if isinstance(kept, KeptWords):
                held.push(kept.keep_rest)
        context = open_context(backend, device, require_gpu)
        held.enter_context(context.rendering())
        held.enter_context(context)
        report("building the BVH", 0)
        rays = held.enter_context(
            PointVisibility(context.gl, loaded, positions, facing, receiver, geometry_budget, first_sensor)
        )
        scene_and_number = f"{loaded.digest(camera=False)} {first_sensor}"
        key = "" if kept is None else _key(scene_and_number, positions, facing, directions, receiver)
        if rays.chunks:
            assert not isinstance(kept, KeptWords), "a pass is kept as a whole"

            def passed(done: int) -> None:
                if on_progress is not None:
                    since = time.perf_counter() - started
                    on_progress(DaylightProgress("stream", done, rays.chunks, count, since))

            found, shares = _words_of_pass(rays, directions, kept, key, passed)
        else:
            assert not isinstance(kept, KeptPass), "words are kept one by one"
            found, shares = _words(rays, directions, kept, key, partial(report, "rays"))
        direct = DaylightCoefficients(
            points=positions,
            normals=facing,
            receiver=receiver,
            subdivision=subdivision,
            up=np.array(compass.up),
            north=np.array(compass.north),
            latitude=float("nan") if latitude is None else float(latitude),
            samples=samples,
            directions=directions,
            column=shared.column,
            weight=shared.weight,
            words=found,
            shares=None if shares is None else shares.reshape(-1, count),
            shard=part,
        )
        if not reflects:
            total = direct
        else:
            report("elements", len(directions))
            scene_in_triangles = path_traceable(loaded.still())
            shift = scene_in_triangles.origin - loaded.origin
            few = _Shared.of(patches, compass, min(samples, ELEMENT_SAMPLES), seed, sun, ELEMENT_GROUND)
            # All shards measure the bias at the same sensors, so that they choose the same number of elements.
            watched = every_sensor[0] - shift, every_sensor[1], receiver
            sides, reflections, bias = _reflecting(scene_in_triangles, elements, max_depth, watched, seed)

            def gathering(done: int) -> None:
                report("gathering", len(directions))

            sensors = positions - shift, facing, receiver
            on_sides = _irradiance(context.gl, loaded, sides, few)
            indirect = gathered(
                sides, reflections, on_sides, few.columns, *sensors, gather_rays, seed, gathering, first_sensor
            )
            total = replace(direct, indirect=replace(indirect, bias=bias))
        if checkpoint is not None and checkpoint is not resume:
            checkpoint.remove()
    scope.raise_late(total)
    return total


def _reflecting(
    scene: Scene,
    elements: int | None,
    max_depth: int | None,
    receivers: tuple[Float64, Float64, Receiver],
    seed: int,
) -> tuple[ReflectingSides, Reflections, Bias]:
    """Return the reflecting sides of a triangulated scene, their reflections, and the bias of their light.

    elements  : number of elements; None: `DEFAULT_ELEMENTS`, or `REFINED` times as many if their bias is not small
    receivers : points (N, 3) and axes (N, 3) of the sensors at which the bias is measured, and their kind

    Issues a SceneWarning if the bias is too large.
    """
    for factor in (1, REFINED):
        sides = ReflectingSides(scene, DEFAULT_ELEMENTS * factor if elements is None else elements, seed)
        reflections = Reflections(sides, max_depth, seed)
        bias = bias_of_solution(sides, reflections, receivers, seed + GATHER_SEED)
        if bias.is_small() or elements is not None:
            break
    if bias.is_large():
        used = DEFAULT_ELEMENTS * factor if elements is None else elements
        warn(
            f"{scene.source or scene.name}: the bias of the reflected light is {bias}. "
            f"Give more than {used:,} elements.",
            late=True,
        )
    return sides, reflections, bias


@dataclass(frozen=True, eq=False)
class _Shared:
    """Directions that all sensors share.

    directions : (D, 3) unit vectors towards the ground, the sky's patches, then the suns
    column     : (D,) index of the matrix column to which a direction belongs
    weight     : (D,) solid angle of a direction, steradians; 1 for a sun
    """

    directions: Float64
    column: NDArray[np.intp]
    weight: Float64

    @property
    def columns(self) -> int:
        """Number of matrix columns: one for the ground, one for each patch and one for each sun."""
        return int(self.column[-1]) + 1

    @classmethod
    def of(
        cls,
        patches: SkyPatches,
        compass: Compass,
        samples: int,
        seed: int,
        suns: Float64,
        ground: int | None = None,
    ) -> _Shared:
        """Return directions to the ground, to the sky patches and to the suns.

        samples : number of directions per sky patch
        suns    : (S, 3) unit vectors
        ground  : number of directions to the ground; None: the default of `SkyPatches.directions`
        """
        sky = patches.directions(compass, samples, seed, ground)
        return cls(
            np.concatenate([sky.directions, suns]),
            np.concatenate([sky.patch, len(patches) + np.arange(len(suns))]),
            np.concatenate([sky.weight, np.ones(len(suns))]),
        )


def default_samples(sensors: int, patches: int) -> int:
    """Return the default directions per patch: 4, 8, 16, 32 or 64, as many as `DEFAULT_RAYS` allow."""
    allowed = DEFAULT_RAYS / max(1, sensors * patches)
    return next((count for count in (64, 32, 16, 8) if count <= allowed), 4)


def _words(
    rays: PointVisibility,
    directions: Float64,
    kept: KeptWords | None,
    key: str,
    report: Callable[[int], None],
) -> tuple[Words, Shares | None]:
    """Return visibility (W, N), a bit for each of 32 directions, and transmittances (W, 32, N) for (D, 3).

    kept : checkpoint; None: no checkpoint
    key  : hash of the work, which the checkpoint must have

    Transmittances are None if the scene has no thin dielectrics. Ctrl-C raises KeyboardInterrupt after the current
    word.
    """
    words = -(-len(directions) // WORD)
    found = np.empty((words, rays.count), np.uint32)
    shares = np.zeros((words, WORD, rays.count), np.float16) if rays.transmits else None
    done = 0
    if kept is not None:
        for seen in kept.read(key, rays.count, rays.transmits)[:words]:
            found[done] = seen.word
            if shares is not None and seen.share is not None:
                shares[done] = seen.share
            done += 1
    with interrupt_as_flag() as flag:
        for seen in rays.see_out(directions[WORD * done :], WORD * done):
            found[done] = seen.word
            if shares is not None and seen.share is not None:
                shares[done] = seen.share
            done += 1
            # A signal that comes after this line ends the computation after the next word.
            stops = bool(flag)
            if kept is not None:
                kept.keep(done, found, shares, last=stops)
            report(min(WORD * done, len(directions)))
            if stops:
                raise KeyboardInterrupt
    if flag:  # the signal came during the last word
        raise KeyboardInterrupt
    return found, shares


def _words_of_pass(
    rays: PointVisibility,
    directions: Float64,
    kept: KeptPass | None,
    key: str,
    report: Callable[[int], None],
) -> tuple[Words, Shares | None]:
    """Return visibility words (W, N) and transmittances (W, 32, N) of directions (D, 3), by one pass over a stream.

    kept : checkpoint; None: no checkpoint
    key  : hash of the work, which the checkpoint must have

    Transmittances are None if the scene has no thin dielectrics. Ctrl-C raises KeyboardInterrupt after the current
    part of the stream.
    """
    done, found, shares = 0, None, None
    if kept is not None:
        done, found = kept.read(key, (-(-len(directions) // WORD), rays.count), rays.chunks)
    if found is None or rays.transmits:
        resident, shares = rays.see_out_of_resident(directions)
        found = resident if found is None else found
    seen = done
    with interrupt_as_flag() as flag:
        for seen in rays.pass_over(directions, found, done):
            stops = bool(flag)
            if kept is not None and (stops or kept.due(seen)):
                kept.keep(seen, found, last=stops)
            report(seen)
            if stops:
                raise KeyboardInterrupt
    if flag:  # the signal came during the last part
        if kept is not None:
            kept.keep(seen, found, last=True)
        raise KeyboardInterrupt
    if shares is not None:
        for share, word in zip(shares, found, strict=True):
            share[:] = masked(share, word)
    return found, shares


def _irradiance(
    gl: moderngl.Context, scene: Scene, sides: ReflectingSides, like: _Shared
) -> Iterator[NDArray[np.float32]]:
    """Yield, for each column (ground, patch or sun) of `like`, the direct irradiance (R,) float32 of the sides."""
    if not len(sides):
        return
    shift = path_traceable(scene.still()).origin - scene.origin
    normals = sides.normals.astype(np.float32)
    # Sum up direction by direction, so that words and transmittances need not be stored. Directions of a column
    # are adjacent.
    of_column = np.zeros(len(sides), np.float32)
    with PointVisibility(gl, scene, sides.points + shift, sides.normals) as rays:
        for word, seen in enumerate(rays.see_out(like.directions)):
            some = slice(WORD * word, min(WORD * (word + 1), len(like.directions)))
            for k, direction in enumerate(like.directions[some].astype(np.float32)):
                light = np.maximum(normals @ direction, 0.0) * (seen.word >> np.uint32(k) & np.uint32(1))
                if seen.share is not None:
                    light *= seen.share[k]
                number = WORD * word + k
                mean = light.reshape(-1, POINTS).mean(axis=1, dtype=np.float32)
                of_column += np.float32(like.weight[number]) * mean
                if number + 1 == len(like.column) or like.column[number + 1] != like.column[number]:
                    yield of_column
                    of_column = np.zeros(len(sides), np.float32)


def _key(scene: str, points: Float64, normals: Float64, directions: Float64, receiver: str) -> str:
    """Return the SHA-256 (hex) of all inputs of the visibility words."""
    digest = hashlib.sha256(f"{scene} {receiver}".encode())
    for array in (points, normals, directions):
        digest.update(np.ascontiguousarray(array, "<f8").tobytes())
    return digest.hexdigest()
