"""Radiosity solutions for engines: on the device for look-ups, and as a digest in a film's metadata."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathSettings
from glpath.integrators.settings import Lookup
from glpath.scene.model import Scene
from glpath.scene.proxy import Proxies
from glpath.sensors.sensor import PointSensor, Sensor

if TYPE_CHECKING:
    from glpath.radiosity.solution import RadiositySolution


def device_radiosity(
    gl: moderngl.Context,
    scene: Scene,
    solution: RadiositySolution,
    settings: GatherSettings | PathSettings,
    sensor: Sensor,
    proxies: Proxies | None = None,
) -> DeviceRadiosity:
    """Return the solution of a scene of triangles on the device. Raises SceneError if it does not fit.

    sensor  : start points of the paths
    proxies : simplified meshes of a scene with streams, for which the solution was computed
    """
    from glpath.radiosity.irradiance_volume import IrradianceVolume
    from glpath.radiosity.lookup import lookup_table  # late, because it imports all of radiosity

    traced, volume = settings.direct_light == "traced", None
    if proxies is not None:
        scene = proxies.scene
        volume = IrradianceVolume.of(scene, solution, proxies.first, traced=traced)
    table = lookup_table(
        scene, solution, settings.radiosity_lookup, traced=traced, in_gaps=isinstance(sensor, PointSensor)
    )
    return DeviceRadiosity(
        gl,
        scene.triangles,
        solution.divisions,
        solution.leaf,
        table,
        scene.side_reflectance,
        all_light=settings.guided,
        volume=volume,
    )


def solution_digest(solution: RadiositySolution, lookup: Lookup) -> str:
    """Return the SHA-256 (hex) of the looked-up data; films can be merged only if it is the same."""
    h = hashlib.sha256(f"{solution.scene_hash} {lookup}".encode())
    h.update(np.ascontiguousarray(solution.divisions, "<i4").data)
    h.update(np.ascontiguousarray(solution.leaf_size, "<u2").data)
    h.update(np.ascontiguousarray(solution.vertices if lookup == "interpolated" else solution.elements, "<f4").data)
    return h.hexdigest()
