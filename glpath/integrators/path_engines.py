"""Which engine traces the path sets of a path tracer's or a gather's settings."""

from __future__ import annotations

import moderngl

from glpath.errors import SceneError
from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.gather import GatherTracer
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_trace import PathTracer
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.settings import GatherSettings, PathTraceSettings
from glpath.scene.model import Scene


def path_engine(
    gl: moderngl.Context,
    scene: DeviceScene,
    settings: PathTraceSettings | GatherSettings,
    window: tuple[int, int, int, int],
    *,
    radiosity: DeviceRadiosity | None = None,
    hardware: bool,
    timings: bool = False,
) -> PathSetEngine:
    """The engine; see `PathSetEngine` for the parameters.

    radiosity : of a gather, and of a path tracer that is guided: the solution, of the scene's own triangles
    """
    needed = isinstance(settings, GatherSettings) or settings.guided
    assert (radiosity is not None) == needed, "a gather and guided paths have a solution, and none else"
    if settings.directions != "own":
        _check_dull(scene.scene)
    common = {"hardware": hardware, "timings": timings}
    if settings.directions == "own":
        return RayPathEngine(gl, scene, settings, window, radiosity=radiosity, **common)
    if isinstance(settings, GatherSettings):
        assert radiosity is not None, "asked above"
        return GatherTracer(gl, scene, settings, window, radiosity=radiosity, **common)
    return PathTracer(gl, scene, settings, window, **common)


def _check_dull(scene: Scene) -> None:
    """Raise SceneError for materials that shared directions miss nearly always."""
    names = [
        m.name for m in (scene.materials[i] for i in sorted({s.material for s in scene.shapes})) if m.has_lobes
    ]
    if names:
        raise SceneError(
            f"{scene.source or scene.name}: has materials with a roughness or a mirror ({', '.join(names[:3])}"
            f"{', ...' if len(names) > 3 else ''}), which paths that share their directions cannot follow.",
            "Leave --directions away: paths with directions of their own can.",
        )
