"""The integrators that trace all kinds of light by paths, by one word each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import glpath
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.settings import Directions
from glpath.scene import path_traceable


def engine_options(name: str) -> dict[str, Any]:
    """What `glpath.render` takes for "path", or for "path-buffer" with these directions, not interleaved."""
    if name == "path":
        return {"integrator": "path"}
    return {"integrator": "path-buffer", "directions": name, "interleave": "never"}


def gather_by(name: Directions | str) -> GatherSettings:
    """A gather with cast "bvh", or by the path-buffer with these directions."""
    return GatherSettings() if name == "bvh" else GatherSettings(cast="path-buffer", directions=name)  # type: ignore[arg-type]


def with_depth(options: Mapping[str, Any], depth: int) -> dict[str, Any]:
    """The options with paths of so many vertices; a gather's end with a lookup there."""
    return {"lookup_depth" if options.get("integrator") == "gather" else "max_depth": depth, **options}


_coarse: dict[str, glpath.RadiositySolution] = {}


def coarse(scene: Any) -> glpath.RadiositySolution:
    """For a gather of whose solution a test says nothing: of fewer particles than it would send itself.

    A scene is solved once in a process, as a sky's light takes as long for few patches as for many.
    """
    solved = path_traceable(glpath.load_scene(scene) if not isinstance(scene, glpath.Scene) else scene)
    key = solved.digest(camera=False)
    if key not in _coarse:
        _coarse[key] = glpath.solve_radiosity(solved, method="monte-carlo", patches=100, particles=1 << 15)
    return _coarse[key]
