"""Choice of the engine that traces the path sets of an integrator's settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import moderngl
import numpy as np

from glpath.errors import SceneError, argument
from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_buffer import PathBufferTracer
from glpath.integrators.path_buffer_gather import PathBufferGather
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.settings import PathSetSettings
from glpath.scene.model import Scene
from glpath.sensors.sensor import Sensor

# Minimum roughness of materials if paths share directions, because sharper highlights would be hit too seldom.
_SHARED_ROUGHNESS = 0.2

#: Engine class by (name of the integrator, True if scans of the path-buffer cast its rays).
ENGINES: Mapping[tuple[str, bool], Callable[..., PathSetEngine]] = {
    ("path", False): RayPathEngine,
    ("path-buffer", True): PathBufferTracer,
    ("gather", False): RayPathEngine,
    ("gather", True): PathBufferGather,
}


def path_engine(
    gl: moderngl.Context,
    scene: DeviceScene,
    settings: PathSetSettings,
    window: tuple[int, int, int, int],
    *,
    sensor: Sensor | None = None,
    radiosity: DeviceRadiosity | None = None,
    timings: bool = False,
    offset: tuple[int, int] | None = None,
) -> PathSetEngine:
    """Create the engine, not prepared yet; see `PathSetEngine` for the parameters.

    sensor    : start points of the paths; by default the scene's camera
    radiosity : solution for the scene's own triangles, for a gather and for guided paths
    offset    : offset of an engine for every second pixel, see `PathBufferStages`
    """
    assert (radiosity is not None) == settings.needs_solution, "a solution that the engine does not use, or none"
    if settings.by_path_buffer:
        check_shared(scene.scene)
    engine = ENGINES[settings.integrator, settings.by_path_buffer]
    given: dict[str, Any] = {} if radiosity is None else {"radiosity": radiosity}
    if offset is not None:
        given["offset"] = offset
    return engine(gl, scene, settings, window, sensor=sensor, timings=timings, **given)


def check_shared(scene: Scene) -> None:
    """Raise SceneError for materials that shared directions nearly always miss."""
    of_kinds: dict[str, list[str]] = {}
    for material in (scene.materials[i] for i in sorted({shape.material for shape in scene.shapes})):
        kinds = ["a mirror"] * bool(np.any(material.mirror > 0))
        if material.roughness is not None:
            kinds += ["glass"] * (material.transmission > 0)
            kinds += ["a diffuse transmission"] * (material.diffuse_transmission > 0)
            coat = material.clearcoat_roughness if material.clearcoat > 0 else 1.0
            kinds += [f"a roughness below {_SHARED_ROUGHNESS:g}"] * (
                min(material.roughness, coat) < _SHARED_ROUGHNESS
            )
        for kind in kinds:
            of_kinds.setdefault(kind, []).append(material.name)
    if of_kinds:
        found = " and ".join(
            f"{kind} ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
            for kind, names in of_kinds.items()
        )
        raise SceneError(
            f"{scene.source or scene.name}: has {found}, which paths that share their directions cannot follow.",
            f"Render it with {argument('integrator', 'path')}, or gather with {argument('cast', 'bvh')}.",
        )
