"""The engines that trace all kinds of light by paths, each by one word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import glpath
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.settings import Directions
from glpath.scene import path_traceable


def engine_options(name: str) -> dict[str, Any]:
    """Return options of `glpath.render` for "path", or for "path-buffer" with these directions, not interleaved."""
    if name == "path":
        return {"integrator": "path"}
    return {"integrator": "path-buffer", "directions": name, "interleave": "never"}


def gather_by(name: Directions | str) -> GatherSettings:
    """Return settings of a gather with cast "bvh", or by the path-buffer with these directions."""
    return GatherSettings() if name == "bvh" else GatherSettings(cast="path-buffer", directions=name)  # type: ignore[arg-type]


def with_depth(options: Mapping[str, Any], depth: int) -> dict[str, Any]:
    """Return the options with paths of this many vertices; those of a gather end there with a lookup."""
    return {"lookup_depth" if options.get("integrator") == "gather" else "max_depth": depth, **options}


_coarse: dict[str, glpath.RadiositySolution] = {}


def coarse(scene: Any) -> glpath.RadiositySolution:
    """Return a solution for a gather in tests that do not check the solution, from fewer particles than by default.

    Each scene is solved once per process, because a sky's light takes as long for few patches as for many.
    """
    solved = path_traceable(glpath.load_scene(scene) if not isinstance(scene, glpath.Scene) else scene)
    key = solved.digest(camera=False)
    if key not in _coarse:
        _coarse[key] = glpath.solve_radiosity(solved, method="monte-carlo", patches=100, particles=1 << 15)
    return _coarse[key]
