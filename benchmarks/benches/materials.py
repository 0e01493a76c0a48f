"""Time to an error in a room with textures, glass and metal, compared with Mitsuba 3 and its nearest materials.

Mitsuba's formulas of metal, plastic and thin glass differ from glTF's, so the pictures differ slightly. Each
program's noise is therefore relative to its own mean (`own_noise`).

measured, for `gather`, `path` and `mitsuba`:
    NAME_ms_per_sample : milliseconds of a path set, or of a sample of all pixels
    NAME_relmse        : noise of a picture of NAME_samples
    gather_bias_relmse : relMSE of the gather's mean against the paths'
    solver_s           : seconds of the radiosity solution, which count for the gather and for the paths
    NAME_s             : seconds to the target
    vs_mitsuba, path_vs_mitsuba : Mitsuba's seconds divided by the gather's, and by the paths'
    mitsuba_mean_off   : relative difference of Mitsuba's mean from the paths'
"""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.benches.equal_error import mitsuba_scenes
from benchmarks.benches.gather import DEPTH
from benchmarks.benches.own_noise import compare
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.verdict import Condition, Report
from glpath.errors import GlpathError
from glpath.io import load_scene
from glpath.io.export.mitsuba import MitsubaScene, described
from glpath.scene.triangulate import path_traceable

SCENE, RESOLUTION = "parlour", (128, 96)
AGREEMENT = (Condition("mitsuba_mean_off", "<=", 0.05),)
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">=", 5.0), Condition("path_vs_mitsuba", ">=", 2.0))


def bench_materials(
    seeds: int = 3, scale: float = 1.0, progress: Callable[[str], None] = lambda text: None
) -> Report:
    """Measure the time to an error.

    seeds : pictures of each program besides the first, at least two
    scale : below 1, fewer samples for all programs
    Raises GlpathError if Mitsuba is missing.
    """
    notes: list[str] = []
    scene = path_traceable(load_scene(SCENE).with_camera(resolution=RESOLUTION))
    translated = described(scene, DEPTH, instances=False)
    if mitsuba_scenes(scene, DEPTH, notes) is None:
        raise GlpathError(f"bench materials: {notes[-1]}", "Install the extra reference.")
    notes += [f"Mitsuba's own: {difference}" for difference in translated.differences]
    peer = mitsuba_peer.in_memory(MitsubaScene(translated.plugins, ()))
    return compare("materials", scene, peer, (RULE, AGREEMENT), seeds, scale, progress, notes)
