"""The image gather from a radiosity solution by the path-buffer: the local pass of a two-pass method [PB 4, A.4].

A path is that of the path tracer up to its second vertex; the light that arrives there is looked up in the
solution, and reflected, instead of traced. So each path carries light of any number of bounces, and a coarse mesh
will do: what the eye sees is an integral over it, and direct light is not from the solution at all. Stages and
sampling are the path tracer's, see `path_stages`; direct light and emission are weighed as there.

Cost:     a path set of depth two, less the direct light at the second vertex, plus the lookup; whatever the solver
          took. A camera that moves needs no new solution.
Poor at:  corners and contacts, nearer than an element is large: the light that an element smears over a shadow's
          edge comes back from so near by that it shows. In the Cornell box the foot of the block's dark side is
          three quarters too bright from 258 elements, 6 % from 3,970. `max_depth` 3 looks up one bounce later, at
          the cost of a scan, and is within 3 % from either. Materials that are not Lambertian.
Source:   Rushmeier 1988, Realistic image synthesis for scenes with radiatively participating media; Reichert 1992,
          A two-pass radiosity method driven by lights and viewer position.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_stages import PathStages, Uniforms
from glpath.integrators.settings import GatherSettings, Lookup
from glpath.scene.model import Scene

if TYPE_CHECKING:
    from glpath.radiosity.solution import RadiositySolution


def device_radiosity(
    gl: moderngl.Context, scene: Scene, solution: RadiositySolution, lookup: Lookup
) -> DeviceRadiosity:
    """The solution of a scene in triangles, on the device. Raises SceneError where that cannot hold it."""
    from glpath.radiosity.mesh import lattice  # with all of radiosity, which is slow to import
    from glpath.radiosity.mesh.sides import side_reflectance

    interpolated = lookup == "interpolated"
    count = lattice.vertex_count if interpolated else lattice.element_count
    return DeviceRadiosity(
        gl,
        scene.triangles,
        solution.divisions,
        (solution.vertices if interpolated else solution.elements).sum(axis=0),
        lattice.starts(count(solution.divisions))[:-1],
        side_reflectance(scene),
        interpolated=interpolated,
    )


def solution_digest(solution: RadiositySolution, lookup: Lookup) -> str:
    """SHA-256 (hex) of what is looked up: pictures add up only when it is the same."""
    h = hashlib.sha256(f"{solution.scene_hash} {lookup}".encode())
    h.update(np.ascontiguousarray(solution.divisions, "<i4").data)
    h.update(np.ascontiguousarray(solution.vertices if lookup == "interpolated" else solution.elements, "<f4").data)
    return h.hexdigest()


class GatherTracer(PathStages):
    """Gathers path sets of one window of the image; see `PathStages` for the other parameters.

    radiosity : the solution, of the scene's own triangles
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        radiosity: DeviceRadiosity,
        settings: GatherSettings,
        window: tuple[int, int, int, int],
        *,
        hardware: bool,
        timings: bool = False,
    ) -> None:
        assert settings.max_depth >= 2, f"a gather of depth {settings.max_depth}"
        self.settings = settings
        super().__init__(
            gl, scene, settings, window, max_radiance=radiosity.max_radiance, hardware=hardware, timings=timings
        )
        self._advance_passes = self._vertex_passes(
            "advance", "path_advance.frag", inner=settings.max_depth > 2, last=False
        )
        self._gather_passes = self._vertex_passes(
            "look up",
            "path_gather.frag",
            inner=False,
            last=True,
            textures=radiosity.textures,
            generated=radiosity.generated,
            defines=radiosity.defines,
            lit=False,
        )
        self._lookup = radiosity.uniforms

    def trace_path_set(self, index: int) -> None:
        """One path for every pixel, ended by the solution [PB table 3, A.4]."""
        sample = self._sampler[index]
        light = self.light_from(index, sample.light)
        self.start_at_eye(index, sample, light)
        self.light_from_infinity(index, 0, light)
        for depth in range(1, self.settings.max_depth):
            scan = self.scan_positions(index, depth, sample)  # z0 of every live path
            self.scan_scene(scan)  # the nearest surface beyond z0
            if depth < self.settings.max_depth - 1:
                self.advance(index, depth, sample, light | scan, last=False)
                self.light_from_infinity(index, depth, light)
            else:
                self.look_up(scan)  # what the solution says of the surface found

    def look_up(self, scan: Uniforms) -> None:
        """Emission found and radiosity reflected at the vertex that the scan found; then the sums."""
        with self.stopwatch.stage("look up"):
            self._end_paths(self._gather_passes, self._lookup | scan)
