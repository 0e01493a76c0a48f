"""Integrator "gather" with cast "path-buffer": the local pass of a two-pass method [PB 4, A.4].

A path equals that of `PathBufferTracer` up to its second vertex. The indirect light that arrives there is looked up
in the solution and reflected, instead of traced. So each path carries light of any number of bounces. A coarse mesh
is enough, because the visible light is an integral over it. Stages and sampling are those of `path_buffer_stages`,
with the same weights for direct light and emission.

Differences from the paper, which looks up all light there:

- Direct light at the second vertex uses the set's shadow-buffer, so that elements do not blur shadow edges. Close
  to an emitter, whose 1/r^2 has no bound, the solution's light is used (`glpath.radiosity.lookup`).
- A path shorter than an element's width would show the element itself, in corners and at contacts. It continues to
  a third vertex instead, with a probability that grows with proximity, so that no seam shows. (Casting them in one
  set of four, with four times the weight, has three times the variance.)

Cost:     a path set of depth three, plus the solver's time. A moving camera needs no new solution.
Poor at:  highlights, which shared directions seldom hit.
Source:   Rushmeier 1988, Realistic image synthesis for scenes with radiatively participating media; Reichert 1992,
          A two-pass radiosity method driven by lights and viewer position. The random distance is that of
          LuxCoreRender's PhotonGI cache.
"""

from __future__ import annotations

import moderngl

from glpath.buffers.path_buffer import Scan
from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.engine import Uniforms, Window
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_buffer_stages import PathBufferStages, SetLight
from glpath.sampling.points import PathSetSample
from glpath.sensors.sensor import Sensor


class PathBufferGather(PathBufferStages):
    """Engine that gathers path sets of one window of the image; see `PathBufferStages` for the other parameters.

    radiosity : solution for the scene's own triangles
    """

    settings: GatherSettings

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: GatherSettings,
        window: Window,
        *,
        sensor: Sensor | None = None,
        radiosity: DeviceRadiosity,
        timings: bool = False,
        offset: tuple[int, int] | None = None,
    ) -> None:
        assert settings.lookup_depth >= 2, f"a lookup at vertex {settings.lookup_depth}"
        super().__init__(
            gl,
            scene,
            settings,
            window,
            sensor=sensor,
            max_radiance=radiosity.max_radiance,
            timings=timings,
            offset=offset,
        )
        self._radiosity = radiosity
        # If False, all light is looked up, so no scan of the path-buffer is needed for the light sample's shadows.
        self._lit = settings.direct_light == "traced" or settings.lookup_distance > 0

    def _prepare_stages(self) -> None:
        super()._prepare_stages()
        settings, radiosity = self.settings, self._radiosity
        self._advance_passes = self._vertex_passes(
            "advance", "path_buffer/path_advance.frag", inner=settings.lookup_depth > 2, last=False
        )
        self._gather_passes = self._vertex_passes(
            "look up",
            "path/path_gather.frag",
            inner=settings.lookup_distance > 0,
            last=True,
            parts=radiosity,
            lit=self._lit,
        )

    def trace_path_set(self, index: int) -> None:
        """Trace one path for every pixel, ended by the solution [PB table 3, A.4]."""
        sample = self._sampler[index]
        light = self.light_from(index, sample.light)
        self.start_at_eye(index, sample, light)
        self.light_from_infinity(index, 0, light)
        for depth in range(1, self.settings.lookup_depth):
            scan = self.scan_positions(index, depth, sample)  # z0 of every live path: where its ray starts
            self.scan_scene(depth, scan)  # the nearest surface beyond z0
            if depth < self.settings.lookup_depth - 1:
                self.advance(index, depth, sample, light, scan, last=False)
                self.light_from_infinity(index, depth, light)
        again = depth < self._bounces()
        self.look_up(index, depth, sample, light, scan, last=not again)  # the solution's irradiance
        if again:  # for paths that were too short for the look-up
            scan = self.scan_positions(index, depth + 1, sample)
            self.scan_scene(depth + 1, scan)
            self.look_up(index, depth + 1, sample, light, scan, last=True)

    def look_up(
        self, index: int, depth: int, sample: PathSetSample, light: SetLight, scan: Scan, last: bool
    ) -> None:
        """Add direct light, emission, and reflected radiosity at the scanned vertex; then update the sums.

        last : True if the look-up ends all paths; False if those too short for it continue
        """
        goes_on = depth < self._bounces()
        uniforms = {
            **self._radiosity.uniforms,
            **light.uniforms,
            **scan.uniforms,
            "lookup_distance": self.settings.lookup_distance if goes_on else 0.0,
            "next_views": len(self._directions(sample, depth)) if goes_on else 0,
        }
        with self.stopwatch.stage("look up"):
            self._run_vertex(self._gather_passes, index, depth, sample, uniforms, last)
        if self._lit:
            self.light_from_infinity(index, depth, light, last)

    def _constant_uniforms(self) -> Uniforms:
        # Beyond the last vertex, the solution has all light, so no ambient light is assumed.
        return super()._constant_uniforms() | {"ambient": (0.0, 0.0, 0.0)}

    def _bounces(self) -> int:
        return self.settings.lookup_depth - (self.settings.lookup_distance == 0)
