"""Which engine traces the path sets of a path tracer's or a gather's settings."""

from __future__ import annotations

import moderngl
import numpy as np

from glpath.errors import SceneError
from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.gather import GatherTracer
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_trace import PathTracer
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.settings import GatherSettings, PathTraceSettings
from glpath.scene.model import Scene
from glpath.sensors.sensor import PointSensor, Sensor

# Highlights of a lower one are so small that few of the shared directions meet them.
_SHARED_ROUGHNESS = 0.2


def path_engine(
    gl: moderngl.Context,
    scene: DeviceScene,
    settings: PathTraceSettings | GatherSettings,
    window: tuple[int, int, int, int],
    *,
    sensor: Sensor | None = None,
    radiosity: DeviceRadiosity | None = None,
    hardware: bool,
    timings: bool = False,
) -> PathSetEngine:
    """The engine; see `PathSetEngine` for the parameters.

    sensor    : where paths start; the scene's camera, where it is not given
    radiosity : of a gather, and of a path tracer that is guided: the solution, of the scene's own triangles
    """
    needed = isinstance(settings, GatherSettings) or settings.guided
    assert (radiosity is not None) == needed, "a gather and guided paths have a solution, and none else"
    if settings.directions != "own":
        _check_shared(scene.scene)
        if isinstance(sensor, PointSensor) and scene.stream is not None:
            raise SceneError(
                f"{scene.scene.source or scene.scene.name}: has a stream, on whose triangles no point is found.",
                "Give the geometry as a mesh.",
            )
    common = {"hardware": hardware, "timings": timings}
    if settings.directions == "own":
        return RayPathEngine(gl, scene, settings, window, sensor=sensor, radiosity=radiosity, **common)
    if isinstance(settings, GatherSettings):
        assert radiosity is not None, "asked above"
        return GatherTracer(gl, scene, settings, window, sensor=sensor, radiosity=radiosity, **common)
    return PathTracer(gl, scene, settings, window, sensor=sensor, **common)


def _check_shared(scene: Scene) -> None:
    """Raise SceneError for materials that shared directions miss nearly always."""
    of_kinds: dict[str, list[str]] = {}
    for material in (scene.materials[i] for i in sorted({shape.material for shape in scene.shapes})):
        kinds = ["a mirror"] * bool(np.any(material.mirror > 0))
        if material.roughness is not None:
            kinds += ["glass"] * (material.transmission > 0)
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
            "Leave out directions: paths with directions of their own can.",
        )
