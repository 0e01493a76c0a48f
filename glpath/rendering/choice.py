"""Choose the integrator for "auto", which gives a clean image fastest, and the options that were not given.

"gather" is chosen if a radiosity solution is worth its time, all given options are supported, and the image is not
a thumbnail. Otherwise "path" is chosen. A gather whose measured bias is too large is replaced by paths later
(`glpath.rendering.bias`). Scenes with streamed triangles take the path-buffer, which has all their light without
bias. Scenes with infinite planes take the T-buffer, because no other integrator supports them. An option that only
one integrator has chooses that integrator.

Only the scene and the options decide, so a job is the same on every machine. Speed and installed packages have no
influence.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from glpath.errors import SceneError, SceneWarning, UsageError, warning_filter
from glpath.integrators.by_name import AUTO, INTEGRATORS
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.settings import IntegratorSettings
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.rendering.options import options, settings_of
from glpath.scene import Environment, Scene, path_traceable
from glpath.scene.emitted import emitted_radiance
from glpath.system.time_limit import preparing

#: Maximum number of triangles for a gather. For larger scenes, the radiosity solution takes longer than the image,
#: most of all under a sky, to which each element casts rays. Processor seconds until an image looks clean, by paths
#: and by a gather: 10 and 50 (`benchmarks scene helmet`, 512 x 512 under a sky), 6 and 14 (the room of 57,490
#: triangles, 256 x 256, lit by lamps).
MAX_TRIANGLES = 40_000
#: Maximum number of pixels of a thumbnail. Paths render such a small image before a solver is even loaded.
THUMBNAIL = 96 * 96
#: Emitters count as lamps if the mean radiance that they cause on the scene's bounding box exceeds this fraction of
#: the sky's mean radiance. Fainter emitters, such as a screen or a diode, hardly light the scene.
FAINT = 0.25
# Order of preference. The first integrator that has all given options is chosen.
_IN_THIS_ORDER = (GatherSettings, PathSettings, PathBufferSettings, TBufferSettings)
#: Default `max_depth` of paths in a scene with ambient light, which represents further bounces.
_DEPTH_WITH_AMBIENT = 5


@preparing()
def chosen(
    integrator: str | IntegratorSettings, given: Mapping[str, Any], scene: Scene, pixels: float = math.inf
) -> IntegratorSettings:
    """Return the settings of a render for an integrator given by name, as "auto", or as an instance.

    given  : options by name, without None values; they override those of an instance
    pixels : number of pixels of the camera's whole image

    Raises UsageError as `settings_of` does.
    """
    solvable = functools.cache(lambda: pixels > THUMBNAIL and not _stands_free(scene) and _solvable(scene))
    name = _engine(given, scene, solvable) if integrator == AUTO else integrator
    kind = INTEGRATORS.get(name) if isinstance(name, str) else None
    if kind in (PathSettings, PathBufferSettings) and "max_depth" not in given and _has_ambient(scene):
        given = {**given, "max_depth": _DEPTH_WITH_AMBIENT}
    if kind is GatherSettings and scene.shapes.streams and "cast" not in given:
        given = {**given, "cast": "path-buffer"}  # the default, a BVH, cannot contain streamed triangles
    settings = settings_of(name, given).completed(solvable)
    if integrator == AUTO and isinstance(settings, GatherSettings) and settings.cast == "bvh":
        return replace(settings, or_path=PathSettings in _owners(given))
    return settings


def for_measuring(given: Mapping[str, Any], scene: Scene) -> str:
    """Return the name of the "auto" integrator for light at points.

    given : options by name; None and False count as not given

    This integrator has no bias, unless an option that only the gather has is given. Scenes with streamed triangles
    take the path-buffer, as for an image.
    """
    asked = {name: value for name, value in given.items() if value is not None and value is not False}
    by_scan = bool(scene.shapes.streams)
    order = (PathBufferSettings, GatherSettings) if by_scan else (PathSettings, PathBufferSettings, GatherSettings)
    owners = _owners(asked)
    having = [kind for kind in order if kind in owners]
    # If no integrator accepts the options, the returned one raises the error.
    kinds = [kind for kind in having if _takes(kind, asked)] or having or order
    return kinds[0].integrator


def _owners(given: Mapping[str, Any]) -> list[type[IntegratorSettings]]:
    """Return the integrators that have all the options, in order of preference; False flags do not count."""
    known = options()
    owners = [known[name].settings for name, value in given.items() if value is not False and name in known]
    return [kind for kind in _IN_THIS_ORDER if all(kind.integrator in names for names in owners)]


def _engine(given: Mapping[str, Any], scene: Scene, solvable: Callable[[], bool]) -> str:
    if any(shape.primitive == "plane" for shape in scene.shapes):
        return TBufferSettings.integrator  # no other integrator supports planes
    if scene.shapes.streams:
        return PathBufferSettings.integrator
    asked = {name: value for name, value in given.items() if value is not False}  # False is an unset flag
    having = _owners(asked)
    # If no integrator accepts the options, the returned one raises the error.
    kinds = [kind for kind in having if _takes(kind, asked)] or having or [PathSettings]
    if kinds[0] is GatherSettings and len(kinds) > 1:
        solved = not (_has_ambient(scene) or scene.moving_shapes) and solvable()
        return kinds[0 if solved else 1].integrator
    return kinds[0].integrator


def _takes(kind: type[IntegratorSettings], given: Mapping[str, Any]) -> bool:
    """Return True if an integrator accepts the combination of options."""
    try:
        kind().check_together(given)
    except UsageError:
        return False
    return True


def _has_ambient(scene: Scene) -> bool:
    """Return True if the scene has ambient light, which replaces bounces that a radiosity solution contains."""
    return bool(np.any(scene.ambient > 0))


def _stands_free(scene: Scene) -> bool:
    """Return True if the scene is an object under a sky, seen from outside, without other strong light.

    Light reaches the object directly or after few bounces. A solution is then not worth its time, because each
    element casts many rays to the sky.
    """
    if scene.sky is None or scene.lights:
        return False
    if isinstance(scene.sky, Environment) and scene.sky.assumed:
        return True  # studio sky, added because the scene has little light
    if emitted_radiance(scene) > FAINT * scene.sky.mean_integral / (4 * math.pi):
        return False
    lower, upper = scene.bounds
    eye = scene.camera.at().position
    return bool(np.any((eye < lower) | (eye > upper)))


def _solvable(scene: Scene) -> bool:
    """Return True if the scene can have a radiosity solution that is worth its time."""
    try:
        with warning_filter("ignore", SceneWarning):  # the engine gives the warning later
            triangles = path_traceable(scene.still())
        if triangles.shapes.total("triangle") > MAX_TRIANGLES:
            return False
        from glpath.radiosity.solvers.checks import check_solvable  # slow to import, so only if needed

        check_solvable(triangles)
    except SceneError:
        return False
    return True
