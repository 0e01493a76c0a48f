"""Speed of visibility by the T-buffer, compared with Embree, and the time that cached shadow-buffers save.

The scenes are 1e3, 1e5 and 1e6 spheres or triangles at random in a cube, 1280 x 720. Their size is inversely
proportional to the square root of their number, so about every second one is hidden. Each program starts with its
scene built, and ends with the nearest primitive and its t for every pixel in its own memory. They take turns, and
medians count. Embree is used in two modes (see `embree_peer`): like embreex, ray by ray on one thread (triangles by
embreex itself, spheres, which embreex lacks, by the same loop), and in packets of eight rays on all cores.
`measured`, each the worse of spheres and triangles:

    vs_embree_N         : time of embreex divided by ours
    vs_embree_packets_N : time of Embree in packets on all cores divided by ours
    agreement           : smallest fraction of pixels in which both see the same primitive
    frame_ms_first      : a frame of `stacked` with 1000 spheres that fills its shadow-buffer (1000 x 2000)
    frame_ms_kept       : a frame with a moved camera and the cached shadow-buffer, in a turn of 60 frames
"""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import embree as embree_peer
from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.buffers.t_buffer import TBuffer
from glpath.errors import GlpathError
from glpath.gl.camera import eye_uniforms
from glpath.gl.context import Context, get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.whitted import WhittedTracer
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.io import load_scene
from glpath.scene.model import Camera, Material, Mesh, Scene, Shape, Shapes
from glpath.sensors.sensor import CameraSensor
from glpath.system.machine import core_count
from glpath.system.versions import versions

COUNTS = {"1e3": 1_000, "1e5": 100_000, "1e6": 1_000_000}
KINDS = ("sphere", "triangle")
RESOLUTION = (1280, 720)
FRAMES = 60

CLAIM = "primary visibility of 1e3 objects as fast as by embreex, and kept shadow-buffers save time"
AGREEMENT = (Condition("agreement", ">=", 0.999),)
RULE = (*AGREEMENT, Condition("vs_embree_1e3", ">=", 1.0), Condition("frame_ms_kept", "<", "frame_ms_first"))

Say = Callable[[str], None]


def crowd(kind: str, count: int, resolution: tuple[int, int] = RESOLUTION, seed: int = 0) -> Scene:
    """Return `count` equal spheres or triangles at random in the cube from -1 to 1, with the camera outside.

    Their visible areas, without occlusion, add up to about twice the cube's face.
    """
    random = np.random.default_rng(seed)
    centres = random.uniform(-1, 1, (count, 3))
    radius = np.sqrt(8 / (np.pi * count))
    if kind == "sphere":
        spheres = np.concatenate([np.tile(radius * np.eye(3), (count, 1, 1)), centres[:, :, None]], axis=2)
        crowd = Shape("crowd", "sphere", 0, spheres)
    else:
        # Triangles in random orientations show half of their area on average, so their area is twice a sphere's
        # disc.
        corners = np.array([[0.0, 1.0], [-np.sqrt(0.75), -0.5], [np.sqrt(0.75), -0.5]])
        size = radius * np.sqrt(2 * np.pi / (1.5 * np.sqrt(0.75)))
        u, v = _frames(random, count)
        triangles = centres[:, None] + size * (corners[:, :1] * u[:, None] + corners[:, 1:] * v[:, None])
        crowd = Shape("crowd", Mesh.of_triangles(triangles), 0)
    return Scene(
        name=f"crowd of {count} {kind}s",
        camera=Camera(np.array([0.4, -3.6, 0.9]), np.zeros(3), np.array([0.0, 0.0, 1.0]), 40.0, resolution),
        shapes=Shapes((crowd,)),
        materials=(Material("grey", np.full(3, 0.5)),),
    )


def _frames(random: np.random.Generator, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two perpendicular unit vectors (N, 3) each, uniformly distributed over all directions."""
    n = random.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    other = random.normal(size=(count, 3))
    u = np.cross(n, other)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(n, u)


def bench_t_buffer(scale: float = 1.0, rounds: int = 7, say: Say = lambda text: None) -> Report:
    """Measure; takes about three minutes on two cores of llvmpipe.

    Parameters
    ----------
    scale  : below 1, fewer objects and pixels; the numbers keep their names
    rounds : turns of every program; the median counts
    say    : function that gets messages about the progress
    """
    context = get_context()
    notes: list[str] = []
    try:
        embree_peer.load_embreex()
        peer = True
    except GlpathError as error:
        notes.append(f"without Embree: {error}")
        peer = False
    if scale < 1:
        notes.append(f"at scale {scale:g} the numbers do not mean what they are named after")
    width, height = (8 * max(1, round(side * scale / 8)) for side in RESOLUTION)
    rows: list[dict[str, object]] = []
    measured: dict[str, float] = {}
    for name, count in COUNTS.items():
        found = [
            _visibility(context, crowd(kind, max(20, round(count * scale)), (width, height)), peer, rounds, say)
            for kind in KINDS
        ]
        for ratio in ("vs_embree", "vs_embree_packets") if peer else ():
            measured[f"{ratio}_{name}"] = min(row[ratio] for row in found)  # type: ignore[type-var, assignment]
        rows += found
    if peer:
        measured["agreement"] = min(float(row["agreement"]) for row in rows)  # type: ignore[arg-type]
    measured |= _frame_times(context, scale, say)
    claim, holds = judge(CLAIM, RULE, measured) if peer else (CLAIM, None)
    if peer:
        notes.append(f"embreex runs on one thread; packets of 8 rays on {core_count()}")
    return Report(
        name="t-buffer",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "embreex") | {"driver": context.info.driver},
        notes=notes,
        faults=faults(AGREEMENT, measured),
    )


def _visibility(context: Context, scene: Scene, peer: bool, rounds: int, say: Say) -> dict[str, object]:
    """Return a row with each program's milliseconds per picture of nearest primitives, and per scene build."""
    say(f"visibility of a {scene.name}")
    gl, camera = context.gl, scene.camera
    made: list[TBuffer] = []
    objects: list[DeviceScene] = []

    def build() -> None:
        objects.append(DeviceScene(gl, scene))
        made.append(TBuffer(gl, objects[0], camera.resolution))

    build_ms = 1e3 * seconds_of(build, gl.finish)
    t_buffer, eye = made[0], eye_uniforms(camera)
    t_buffer.fill(eye)  # compiles what is left to compile
    contestants = {"glpath": lambda: seconds_of(lambda: t_buffer.fill(eye), gl.finish)}
    kind = "sphere" if len(scene.spheres) else "triangle"
    row: dict[str, object] = {"kind": kind, "objects": len(scene.spheres) + len(scene.triangles)}
    if not peer:
        row |= {"glpath_ms": 1e3 * in_turns(contestants, rounds)["glpath"], "glpath_build_ms": build_ms}
        made.pop().close()
        objects.pop().close()
        return row

    natives: list[embree_peer.EmbreeScene] = []
    embree_build_ms = 1e3 * seconds_of(lambda: natives.append(_embree(scene)))
    with natives[0] as native:
        rays = embree_peer.camera_rays(camera)
        numbers, _ = native.nearest(*rays)
        seen, _ = t_buffer.read()
        agreement = float((numbers.reshape(seen.shape) == seen).mean())
        by_embreex = embree_peer.embreex_triangles(scene.triangles) if kind == "triangle" else None
        if by_embreex is not None:
            contestants["embreex"] = lambda: seconds_of(lambda: by_embreex(*rays))
        else:
            native.nearest(*rays, method="single", threads=1)  # compiles
            contestants["embreex"] = lambda: seconds_of(lambda: native.nearest(*rays, method="single", threads=1))
        contestants["packets"] = lambda: seconds_of(lambda: native.nearest(*rays))
        times = in_turns(contestants, rounds)
    made.pop().close()
    objects.pop().close()
    return row | {
        "glpath_ms": 1e3 * times["glpath"],
        "embreex_ms": 1e3 * times["embreex"],
        "embree_packets_ms": 1e3 * times["packets"],
        "vs_embree": times["embreex"] / times["glpath"],
        "vs_embree_packets": times["packets"] / times["glpath"],
        "agreement": agreement,
        "glpath_build_ms": build_ms,
        "embree_build_ms": embree_build_ms,
    }


def _embree(scene: Scene) -> embree_peer.EmbreeScene:
    if len(scene.triangles):
        return embree_peer.EmbreeScene.of_triangles(scene.triangles)
    return embree_peer.EmbreeScene.of_spheres(scene.spheres[:, :, 3], scene.spheres[:, 0, 0])


def _frame_times(context: Context, scale: float, say: Say) -> dict[str, float]:
    """Return milliseconds of a frame that fills the shadow-buffer, and of another view's that reuses it."""
    height = max(12, round(RESOLUTION[1] * scale))
    parameters = {"objects": max(20, round(1000 * scale)), "resolution": height, "aspect": 16 / 9}
    scene = load_scene("stacked", parameters)
    say(f"{FRAMES} frames around {parameters['objects']} spheres")
    settings = TBufferSettings(max_depth=1, shadows="sphere", shadow_resolution=max(20, round(1000 * scale)))
    window = (0, 0, *scene.camera.resolution)
    tracer = WhittedTracer(context.gl, DeviceScene(context.gl, scene), settings, window).prepare()
    tracer.trace_path_set(0)  # compiles what is left to compile
    assert tracer.shadow_buffer is not None, "the scene has a point light"

    def frame(camera: Camera) -> float:
        tracer.look_from(CameraSensor.of(camera))
        return 1e3 * seconds_of(lambda: tracer.trace_path_set(0), context.gl.finish)

    first, kept = [], []
    for i, camera in enumerate(scene.camera.turntable(FRAMES)):
        if i % (FRAMES // 6) == 0:
            tracer.shadow_buffer.forget()
            first.append(frame(camera))
        kept.append(frame(camera))
    return {"frame_ms_first": statistics.median(first), "frame_ms_kept": statistics.median(kept)}
