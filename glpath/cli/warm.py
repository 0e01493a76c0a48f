"""`glpath doctor --warm`: compile numba's kernels and the shaders before their first use.

A small scene is rendered with every engine and solved with every solver, so that the same variants are compiled.
"""

from __future__ import annotations

import time
import warnings
from typing import TYPE_CHECKING, Any

from glpath.errors import SceneWarning
from glpath.system.reporting import duration
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.radiosity import RadiositySolution
    from glpath.scene import Scene

#: Scene that every engine can render: a shape that emits, a solid, a sphere, a point light and a sky.
SCENE: dict[str, Any] = {
    "camera": {"position": [0, 1, 4], "target": [0, 0.5, 0]},
    "film": {"resolution": [32, 32]},
    "shapes": [
        {"type": "quad", "corners": [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]},
        {"type": "box", "min": [-1, 0, -1], "max": [0, 1, 0]},
        {"type": "sphere", "center": [1, 1, 0], "radius": 0.5, "subdivisions": 1},
        {"type": "box", "min": [-0.3, 2, -0.3], "max": [0.3, 2.05, 0.3], "emission": {"radiance": 12}},
    ],
    "lights": [{"type": "point", "position": [2, 3, 2], "intensity": 5}],
    "sky": {"zenith": 0.2},
}


def compile_all() -> None:
    """Compile all kernels and shaders that are not in the caches yet, and report each step."""
    from glpath.io import load_scene

    began = time.perf_counter()
    scene = load_scene(SCENE)
    solution = compile_kernels(scene)
    compile_shaders(scene, solution)
    compile_lightmap(scene, solution)
    say(f"All kernels and shaders are compiled, in {duration(time.perf_counter() - began)}.", err=True)


def compile_kernels(scene: Scene) -> RadiositySolution:
    """Compile the kernels of all radiosity methods and of view factors, and return a solution."""
    from glpath.apps.view_factors.compute import view_factors
    from glpath.radiosity.solvers.checks import METHODS
    from glpath.radiosity.solvers.solve import solve_radiosity

    for method in METHODS:
        say(f"radiosity, {method}", err=True)
        adaptive = 1 if method == "progressive" else 0
        solution = solve_radiosity(scene, method=method, patches=1, adaptive=adaptive, particles=1)
    say("view factors", err=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # hides the warning about the ground under the box
        view_factors(scene, groups="shapes")
    return solution


def compile_shaders(scene: Scene, solution: RadiositySolution) -> None:
    """Compile the shaders of all engines, and the kernels that prepare a scene for the engines."""
    from glpath.rendering import render

    renders: tuple[dict[str, Any], ...] = (
        {"integrator": "path"},
        {"integrator": "path-buffer"},
        {"integrator": "gather", "radiosity_lookup": "interpolated"},
        {"integrator": "gather", "radiosity_lookup": "constant"},
        {"integrator": "gather", "cast": "path-buffer"},
        {"integrator": "classic"},
        *({"integrator": "t-buffer", "shadows": shadows} for shadows in ("rays", "sphere", "cube")),
    )
    for options in renders:
        say(f"render, {', '.join(options.values())}", err=True)
        given: dict[str, Any] = {"radiosity": solution} if options["integrator"] == "gather" else {}
        render(scene, spp=2, **options, **given)


def compile_lightmap(scene: Scene, solution: RadiositySolution) -> None:
    """Compile the kernels of texels, and the shaders for paths that start at texels. Skipped without xatlas."""
    from glpath.apps.lightmap.atlas import require_xatlas
    from glpath.apps.lightmap.lightmap import lightmap
    from glpath.errors import GlpathError

    try:
        require_xatlas()
    except GlpathError as missing:
        say(f"without lightmaps: {missing}", err=True)
        return
    say("lightmap, path, gather", err=True)
    lightmap(scene, size=64, spp=1)
    lightmap(scene, size=64, spp=1, integrator="gather", radiosity=solution)
