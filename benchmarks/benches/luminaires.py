"""Time to an error under two hundred luminaires, compared with Mitsuba 3.

The scene is an office whose ten lamps are replaced by 200 points with a photometric profile, close below the
ceiling. In Mitsuba each is a projector whose image is the profile. Mitsuba chooses among all of them with equal
probability; glpath uses a tree. Each program's noise is relative to its own mean (`own_noise`).

measured: see `materials`
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.benches.gather import DEPTH
from benchmarks.benches.own_noise import compare
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.verdict import Condition, Report
from glpath.io import load_scene
from glpath.scene.model import Light, LightProfile, Scene, Shapes
from glpath.scene.triangulate import path_traceable
from glpath.system.units import EFFICACY

AGREEMENT = (Condition("mitsuba_mean_off", "<=", 0.02),)
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">=", 5.0))


def lit_office(side: int = 128) -> Scene:
    """Return the office, `side` pixels wide, under 20 x 10 luminaires that are brightest at 65 degrees."""
    gamma = np.linspace(0.0, 90.0, 19)
    profile = LightProfile(np.where(gamma < 70, 100.0 + 4.0 * gamma, 0.0)[None], (0.0, 90.0))
    down, intensity = np.array([0.0, -1.0, 0.0]), np.full(3, 1.0 / EFFICACY)
    hung = [np.array([0.3 + 0.6 * i, 2.9, 0.4 + 0.8 * j]) for i in range(20) for j in range(10)]
    lights = tuple(Light(f"lamp-{i}", "point", intensity, at, down, profile=profile) for i, at in enumerate(hung))
    office = load_scene("office", {"resolution": side})
    dark = Shapes(replace(shape, emission=np.zeros(3)) for shape in office.shapes)
    return path_traceable(replace(office, name="luminaires", shapes=dark, lights=lights))


def bench_luminaires(
    seeds: int = 3, scale: float = 1.0, progress: Callable[[str], None] = lambda text: None
) -> Report:
    """Measure the time to an error.

    seeds : pictures of each program, two at least
    scale : below 1, fewer samples for all programs
    Raises GlpathError if Mitsuba is missing.
    """
    scene = lit_office()
    peer = mitsuba_peer.to_mitsuba(scene, DEPTH)
    return compare("luminaires", scene, peer, (RULE, AGREEMENT), seeds, scale, progress)
