"""Integrator "path-buffer": path tracing by scan conversion [PB 3, appendices A and B].

The frame is `PathBufferTracer.trace_path_set`; `path_buffer_stages` lists the differences from the paper.

Poor at: highlights (directions are shared, not chosen by the surface; sharp highlights are refused); scenes that
are lit only through small openings; paths at very different scales (a far horizon), which crowd into few cells.
Also emitters that nearly touch a surface: their 1/r^2 is unbounded at the last vertex, where no sampled direction
complements the light sample.
"""

from __future__ import annotations

import moderngl

from glpath.gl.device_scene import DeviceScene
from glpath.integrators.engine import Uniforms, Window
from glpath.integrators.path_buffer_stages import PathBufferStages
from glpath.integrators.path_settings import PathBufferSettings
from glpath.lights.lighting import Lighting
from glpath.sensors.sensor import Sensor


class PathBufferTracer(PathBufferStages):
    """Engine that traces path sets of one window of the image; see `PathBufferStages` for the parameters."""

    settings: PathBufferSettings

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathBufferSettings,
        window: Window,
        *,
        sensor: Sensor | None = None,
        timings: bool = False,
        offset: tuple[int, int] | None = None,
    ) -> None:
        self._ambient = tuple(scene.scene.ambient) if settings.ambient is None else settings.ambient
        # With path length 1, ambient radiance replaces the sky's light, so sampling the sky would waste path sets.
        ambient_alone = settings.max_depth == 1 and max(self._ambient) > 0
        super().__init__(
            gl,
            scene,
            settings,
            window,
            sensor=sensor,
            max_radiance=max(self._ambient),
            lighting=Lighting.of(scene.scene, sky=False) if ambient_alone else None,
            timings=timings,
            offset=offset,
        )

    def _prepare_stages(self) -> None:
        super()._prepare_stages()
        depth = self.settings.max_depth
        self._advance_passes = self._vertex_passes(
            "advance", "path_buffer/path_advance.frag", inner=depth > 2, last=depth > 1, deep=True
        )

    def trace_path_set(self, index: int) -> None:
        """Trace one path for every pixel [PB table 3]."""
        sample = self._sampler[index]
        self.move_to(index)  # moves objects to the time of the path set
        light = self.light_from(index, sample.light)
        self.start_at_eye(index, sample, light)
        self.light_from_infinity(index, 0, light, last=self.settings.max_depth == 1)
        for depth in range(1, self.settings.max_depth):
            scan = self.scan_positions(index, depth, sample)  # z0 of every live path: where its ray starts
            self.scan_scene(depth, scan)  # the nearest surface beyond z0
            last = depth == self.settings.max_depth - 1 or self._all_ended(depth)
            self.advance(index, depth, sample, light, scan, last)  # radiance, throughput, new positions
            self.light_from_infinity(index, depth, light, last)  # shadows of distant light, by a scan of their own
            if last:
                break

    def _plays_roulette(self, depth: int) -> bool:
        return self.settings.roulette is not None and depth >= self.settings.roulette

    def _all_ended(self, depth: int) -> bool:
        """Return True if roulette has ended all paths.

        The query stalls the CPU, so it runs only if it can save scans of the path-buffer.
        """
        return self._plays_roulette(depth) and not self.path_buffer.any_paths()

    def _constant_uniforms(self) -> Uniforms:
        return super()._constant_uniforms() | {"ambient": self._ambient}
