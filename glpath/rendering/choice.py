"""What "auto" is: the integrator that shows a scene clean soonest, and its options that were left open.

The gather, where the scene can have a radiosity solution in time that is worth it, nothing is asked for that a
gather has not, and the picture is no thumbnail; else paths. A gather whose measured bias is too large is replaced
by paths later (`glpath.rendering.bias`). Streams of triangles, which fit into no memory, take the path-buffer,
which has all their light without bias, and planes without end the T-buffer, as no other knows them; so does an
option that no other has.

The scene and the options decide alone, so that a job is the same on every machine: never how fast that is, or what
is installed on it.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.integrators.by_name import AUTO, INTEGRATORS
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.settings import IntegratorSettings
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.rendering.options import options, settings_of
from glpath.scene import Environment, Scene, path_traceable
from glpath.scene.emitted import emitted_radiance

#: Solving a scene of more takes longer than a picture, under a sky most of all, as each side casts rays to it.
#: Processor seconds until a picture looks clean, by paths and by a gather: 10 and 50 (`benchmarks scene helmet`,
#: 512 x 512 under a sky), 6 and 14 (the room of 57,490 triangles, 256 x 256, by lamps).
MAX_TRIANGLES = 40_000
#: Pixels of a thumbnail: paths have it clean before a solver is loaded.
THUMBNAIL = 96 * 96
#: Of a sky's mean radiance: what emits less, on a box around the scene, is a part of its look (a screen, a diode).
FAINT = 0.25
# An option that one has, and those before it have not, chooses it.
_IN_THIS_ORDER = (GatherSettings, PathSettings, PathBufferSettings, TBufferSettings)
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
    solvable = functools.cache(lambda: pixels > THUMBNAIL and not _stands_free(scene) and _solvable(scene))
    name = _engine(given, scene, solvable) if integrator == AUTO else integrator
    kind = INTEGRATORS.get(name) if isinstance(name, str) else None
    if kind in (PathSettings, PathBufferSettings) and "max_depth" not in given and _has_ambient(scene):
        given = {**given, "max_depth": _DEPTH_WITH_AMBIENT}
    if kind is GatherSettings and scene.shapes.streams and "cast" not in given:
        given = {**given, "cast": "path-buffer"}  # no BVH has streamed triangles
    settings = settings_of(name, given).completed(solvable)
    if integrator == AUTO and isinstance(settings, GatherSettings) and settings.cast == "bvh":
        return replace(settings, or_path=PathSettings in _owners(given))
    return settings


def for_measuring(given: Mapping[str, Any], scene: Scene) -> str:
    """Return the integrator of "auto" for light at points: without bias, unless an option that only the gather has
    is given.

    given : options by name; those that are None or False do not count

    Streamed triangles take the path-buffer, as in a picture.
    """
    asked = {name: value for name, value in given.items() if value is not None and value is not False}
    by_scan = bool(scene.shapes.streams)
    order = (PathBufferSettings, GatherSettings) if by_scan else (PathSettings, PathBufferSettings, GatherSettings)
    owners = _owners(asked)
    having = [kind for kind in order if kind in owners]
    kinds = [kind for kind in having if _takes(kind, asked)] or having or order  # the first says what is wrong
    return kinds[0].integrator


def _owners(given: Mapping[str, Any]) -> list[type[IntegratorSettings]]:
    """The integrators that have all of the options, in the order of preference; unset flags do not count."""
    known = options()
    owners = [known[name].settings for name, value in given.items() if value is not False and name in known]
    return [kind for kind in _IN_THIS_ORDER if all(kind.integrator in names for names in owners)]


def _engine(given: Mapping[str, Any], scene: Scene, solvable: Callable[[], bool]) -> str:
    if any(shape.primitive == "plane" for shape in scene.shapes):
        return TBufferSettings.integrator  # no path meets one
    if scene.shapes.streams:
        return PathBufferSettings.integrator
    asked = {name: value for name, value in given.items() if value is not False}  # an unset flag says nothing
    having = _owners(asked)
    kinds = [kind for kind in having if _takes(kind, asked)] or having or [PathSettings]  # which says what is wrong
    if kinds[0] is GatherSettings and len(kinds) > 1:
        solved = not (_has_ambient(scene) or scene.moving_shapes) and solvable()
        return kinds[0 if solved else 1].integrator
    return kinds[0].integrator


def _takes(kind: type[IntegratorSettings], given: Mapping[str, Any]) -> bool:
    """Whether options that it has mean something together."""
    try:
        kind().check_together(given)
    except UsageError:
        return False
    return True


def _has_ambient(scene: Scene) -> bool:
    """Ambient light stands for bounces that are not traced, which a solution has."""
    return bool(np.any(scene.ambient > 0))


def _stands_free(scene: Scene) -> bool:
    """Whether a sky lights it, and nothing else by much, and it is seen from outside: light comes straight or by
    few bounces then.

    That is not worth a solution, to which each element under a sky casts many rays.
    """
    if scene.sky is None or scene.lights:
        return False
    if isinstance(scene.sky, Environment) and scene.sky.assumed:
        return True  # a studio, which stands in for light where nothing sends much
    if emitted_radiance(scene) > FAINT * scene.sky.mean_integral / (4 * math.pi):
        return False
    lower, upper = scene.bounds
    return bool(np.any((scene.camera.position < lower) | (scene.camera.position > upper)))


def _solvable(scene: Scene) -> bool:
    """Whether the scene can have a radiosity solution, in time that is worth it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # the engine says it
            triangles = path_traceable(scene.still())
        if triangles.shapes.total("triangle") > MAX_TRIANGLES:
            return False
        from glpath.radiosity.solvers.checks import check_solvable  # slow to import, for scenes that may be solved

        check_solvable(triangles)
    except SceneError:
        return False
    return True
