"""What "auto" is: the integrator that shows a scene clean soonest, and its options that were left open.

The gather, where the scene can have a radiosity solution in time that is worth it, nothing is asked for that a
gather has not, and the picture is no thumbnail; else paths. Streams of triangles, which fit into no memory, take
the path-buffer, and planes without end the T-buffer, as no other knows them. The scene and the options decide
alone, so that a job is the same on every machine: never how fast that is, or what is installed on it.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from glpath.errors import SceneError, SceneWarning
from glpath.integrators.settings import (
    AUTO,
    INTEGRATORS,
    GatherSettings,
    IntegratorSettings,
    PathBufferSettings,
    PathSettings,
    TBufferSettings,
)
from glpath.rendering.options import settings_fields, settings_of
from glpath.scene import Scene, path_traceable

#: Solving a scene of more takes longer than a picture: each side gets rays of its own to find its direct light.
MAX_TRIANGLES = 40_000
#: Pixels of a thumbnail: paths have it clean before a solver is loaded.
THUMBNAIL = 96 * 96
#: Of paths in a scene whose ambient light stands for further bounces.
_DEPTH_WITH_AMBIENT = 5


def chosen(
    integrator: str | IntegratorSettings, given: Mapping[str, Any], scene: Scene, pixels: float = math.inf
) -> IntegratorSettings:
    """The settings of a render: an integrator by its name, "auto", or an instance that `given` changes.

    given  : options by name, none of which is None
    pixels : of a camera's whole picture

    Raises UsageError, as `settings_of`.
    """
    solvable = functools.cache(lambda: pixels > THUMBNAIL and _solvable(scene))
    name = _engine(given, scene, solvable) if integrator == AUTO else integrator
    kind = INTEGRATORS.get(name) if isinstance(name, str) else None
    if kind in (PathSettings, PathBufferSettings) and "max_depth" not in given and _has_ambient(scene):
        given = {**given, "max_depth": _DEPTH_WITH_AMBIENT}
    return settings_of(name, given).completed(solvable)


def _engine(given: Mapping[str, Any], scene: Scene, solvable: Callable[[], bool]) -> str:
    if scene.shapes.streams:
        return PathBufferSettings.integrator
    path, gather = settings_fields(PathSettings), settings_fields(GatherSettings)
    if any(shape.primitive == "plane" for shape in scene.shapes):
        return TBufferSettings.integrator  # no path meets one
    asked = [name for name, value in given.items() if value is not False]  # a flag that is not set says nothing
    if any(name in gather and name not in path for name in asked):
        return GatherSettings.integrator
    if any(name not in gather for name in asked) or _has_ambient(scene) or scene.moving_shapes or not solvable():
        return PathSettings.integrator
    return GatherSettings.integrator


def _has_ambient(scene: Scene) -> bool:
    """Ambient light stands for bounces that are not traced, which a solution has."""
    return bool(np.any(scene.ambient > 0))


def _solvable(scene: Scene) -> bool:
    """Whether the scene can have a radiosity solution, in time that is worth it."""
    from glpath.radiosity.solvers.checks import check_solvable  # slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # the engine says it
            triangles = path_traceable(scene.still())
        if len(triangles.triangles) > MAX_TRIANGLES:
            return False
        check_solvable(triangles)
    except SceneError:
        return False
    return True
