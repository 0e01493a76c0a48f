"""Points where paths start, instead of a camera: the first vertex of each path is a white receiver at a point.

Points are uploaded for a window. A short ray finds the triangle that a point lies on; if nothing moves, it is cast
only once. Path rays from the point ignore this triangle, and its element selects the path guide. Streamed triangles
are not searched: a point on one starts slightly above it, along the point's normal, like a point in the air.

Cost:     a short ray for each point, whenever they change; with several tables, in each path set.
Poor at:  points in the edge between two surfaces: only one is found.
"""

from __future__ import annotations

import moderngl
import numpy as np

from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.ray_bvh import RayBvh
from glpath.sensors.sensor import PointSensor

Uniforms = dict[str, object]


class StartPoints:
    """Points of one window of a sensor, on the device.

    size       : (width, height) of the window
    eye_buffer : target for the index + 1 of the triangle under each point, 0 for none

    textures, defines : inputs of programs that include start_points.glsl
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        sensor: PointSensor,
        bvh: RayBvh,
        size: tuple[int, int],
        eye_buffer: moderngl.Texture,
    ) -> None:
        self._scene, self._bvh = scene, bvh
        self._of: object = None  # sensor, window and table of the uploaded points
        self._found = False  # True if the triangles under the uploaded points are known
        self.defines: dict[str, object] = {"START_POINTS": 1}
        names = ["start_positions", "start_normals"]
        if sensor.smooth:
            names.append("start_shading")
            # HAS_NORMALS is needed also for scenes without shading normals, because the points have their own.
            self.defines |= {"START_SHADING": 1, "HAS_NORMALS": 1}
        self.textures = {name: gl.texture(size, 4, dtype="f4") for name in names}
        for texture in self.textures.values():
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        # Bound of the scene's coordinates, for the rounding error of positions far from the origin.
        self._uniforms: Uniforms = {"start_extent": float(np.linalg.norm(scene.centre) + scene.radius)}
        self._pass = Pass(
            "points",
            gl,
            load_program(
                gl,
                vertex="gl/fullscreen.vert",
                fragment="camera/start_points.frag",
                generated={**scene.generated, **bvh.generated},
                defines=scene.defines | bvh.defines | self.defines,
            ),
            gl.framebuffer([eye_buffer]),
            textures={**scene.textures, **bvh.textures, **self.textures},
        )

    def at(self, sensor: PointSensor, window: tuple[int, int, int, int], u: float) -> Uniforms:
        """Upload the points of a window, from the table that a number from 0 to 1 selects; return the uniforms."""
        table = min(int(u * sensor.tables), sensor.tables - 1)
        of = (sensor, window, table)
        if self._of != of:
            self._of, self._found = of, False
            self._upload(sensor, window, table)
        return self._uniforms

    def _upload(self, sensor: PointSensor, window: tuple[int, int, int, int], table: int) -> None:
        points = sensor.points
        assert points is not None, "a job's points were not asked for"
        x, y, w, h = window
        rows, columns = slice(y, y + h), slice(x, x + w)
        each = {
            "start_positions": points.positions,
            "start_normals": points.normals,
            "start_shading": points.shading,
        }
        for name, texture in self.textures.items():
            array = each[name]
            assert array is not None, "of the same kind"
            texels = np.empty((h, w, 4), np.float32)
            texels[..., :3] = array[table, rows, columns]
            if name == "start_positions" and any(points.origin):
                texels[..., :3] = array[table, rows, columns] + np.array(points.origin)
            texels[..., 3] = points.valid[rows, columns]
            # Row 0 on the device is at the bottom.
            texture.write(np.ascontiguousarray(texels[::-1]).tobytes())

    def find(self, start: Uniforms) -> None:
        """Find the triangle that each point lies on, unless it is known. start: result of `at`."""
        if self._found and self._scene.moving is None:
            return
        self._pass.run({**self._scene.uniforms, **self._bvh.uniforms, **start})
        self._found = True
