"""Cost of textures and smooth normals: a path set of 100,000 triangles plain, with either, and with both.

The scene is the Cornell box with twenty balls of 5,120 triangles each instead of its two boxes. "plain" balls are
flat and of one colour. "smooth" ones are shaded with vertex normals. "textured" surfaces have a picture with the
same mean colour, so that paths have the same length. The four take turns, one path set each, and the median counts.

measured:
    plain_ms, smooth_ms, textured_ms, both_ms : milliseconds of a path set
    smooth, textured, both : time of a set divided by that of the plain one in the same turn, median over turns
    mean_off : relative difference of the mean of the picture with both from that of the plain one
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.benches.equal_error import warm_up
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathSettings
from glpath.io import load_scene
from glpath.scene import Scene
from glpath.scene.model import Material, Mesh, Shape, Shapes, Texture, TextureSlot
from glpath.scene.tessellate import unit_sphere
from glpath.system.versions import versions

CLAIM = "a textured, smooth-shaded scene of 100,000 triangles takes no more than 1.3 times what it takes plain"
AGREEMENT = (Condition("mean_off", "<=", 0.02),)
RULE = (*AGREEMENT, Condition("both", "<=", 1.3))
SIDE = 256
DEPTH = 3
#: Number of times that the balls' triangles are split in four: 20 balls of 20 * 4^4 triangles.
FINENESS = 4
_COLOUR = 0.6
# Mean of the picture. Reflectances are divided by it, and the largest is 0.886; so none is above 1.
_MEAN = 0.888
_CENTRES = [
    (x, y, z)
    for y in (-0.78, -0.36, 0.06, 0.48)
    for x, z in ((-0.65, -0.55), (0.05, -0.7), (0.65, -0.4), (-0.35, 0.15), (0.4, 0.35))
]
_RADIUS = 0.2
_KINDS = ("plain", "smooth", "textured", "both")


def scene_of(kind: str, fineness: int = FINENESS, side: int = SIDE) -> Scene:
    """Return the scene of a variant: `plain`, `smooth`, `textured` or `both`."""
    box = load_scene("cornell-box-36").with_camera(resolution=(side, side))
    walls = [shape for shape in box.shapes if not shape.name.endswith("-box")]
    ball = unit_sphere(fineness)
    assert isinstance(ball, Mesh)
    materials = (*box.materials, Material("ball", np.full(3, _COLOUR)))
    textures: tuple[Texture, ...] = ()
    if kind in ("textured", "both"):
        ball = replace(ball, uv=ball.vertices[:, :2])
        walls = [replace(wall, geometry=_with_uv(wall)) for wall in walls]
        picture = np.random.default_rng(1).choice([0.78, 0.99], (64, 64, 3))
        picture *= _MEAN / picture.mean(axis=(0, 1))
        textures = (Texture("picture", np.rint(255 * picture).astype(np.uint8), (4.0, 4.0)),)
        materials = tuple(replace(m, reflectance=m.reflectance / _MEAN, texture=TextureSlot(0)) for m in materials)
    if kind not in ("smooth", "both"):
        ball = replace(ball, normals=None)
    maps = np.zeros((len(_CENTRES), 3, 4))
    maps[:, :, :3] = _RADIUS * np.eye(3)
    maps[:, :, 3] = _CENTRES
    balls = Shape("balls", ball, len(box.materials), maps)
    return replace(
        box,
        name=f"balls, {kind}",
        shapes=Shapes([*walls, balls]),
        materials=materials,
        textures=textures,
    )


def _with_uv(wall: Shape) -> Mesh:
    """Return the wall's mesh with the coordinates along its two longer axes as texture coordinates."""
    assert isinstance(wall.geometry, Mesh)
    long = np.sort(np.argsort(np.ptp(wall.geometry.vertices, axis=0))[1:])
    return replace(wall.geometry, uv=wall.geometry.vertices[:, long])


def bench_textures(
    scale: float = 1.0, rounds: int = 7, progress: Callable[[str], None] = lambda text: None
) -> Report:
    """Time the variants. scale: below 1, a smaller picture. rounds: turns of eight path sets of each."""
    context = get_context()
    side = max(32, round(SIDE * scale**0.5))
    engines: dict[str, PathSetEngine] = {}
    triangles = 0
    for kind in _KINDS:
        progress(f"{kind}: to the device")
        scene = scene_of(kind, side=side)
        triangles = len(scene.triangle_shape)
        engines[kind] = path_engine(
            context.gl,
            DeviceScene(context.gl, scene),
            PathSettings(max_depth=DEPTH),
            (0, 0, side, side),
        ).prepare()
        warm_up(engines[kind])
    times: dict[str, list[float]] = {kind: [] for kind in _KINDS}
    for turn in range(rounds):
        progress(f"turn {turn + 1} of {rounds}")
        for index in range(8 * turn + 1, 8 * turn + 9):
            for kind, engine in engines.items():
                context.gl.finish()
                start = time.perf_counter()
                engine.trace_path_set(index)
                context.gl.finish()
                times[kind].append(1e3 * (time.perf_counter() - start))
    means = {kind: float(engine.take().mean()) / (8 * rounds) for kind, engine in engines.items()}
    taken = {kind: np.array(each) for kind, each in times.items()}
    measured = {f"{kind}_ms": float(np.median(each)) for kind, each in taken.items()}
    measured |= {kind: float(np.median(taken[kind] / taken["plain"])) for kind in _KINDS[1:]}
    measured["mean_off"] = abs(means["both"] / means["plain"] - 1.0)
    claim, holds = judge(CLAIM, RULE, measured)
    return Report(
        "textures",
        claim,
        measured,
        holds,
        rows=[
            {"scene": kind, "ms": measured[f"{kind}_ms"], "to plain": measured.get(kind, 1.0), "mean": means[kind]}
            for kind in _KINDS
        ],
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy"),
        notes=[f"{triangles:,} triangles, {side} x {side}, depth {DEPTH}, {8 * rounds} path sets of each"],
        faults=faults(AGREEMENT, measured),
    )
