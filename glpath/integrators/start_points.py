"""Points where paths start, instead of what an eye sees: the first vertex of each is a white receiver there.

Points are uploaded for a window, and which triangle each lies on is found by a short ray, once where they stay:
rays from there do not meet it, and guides are those of its element. Streamed triangles are not looked for: a point
on one starts a rounding above it, by its own normal, as a point in the air does.

Cost:     a short ray for each point, whenever they change; with several tables, in each path set.
Poor at:  points in the edge between two surfaces, of which they lie on one only.
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
    """The points of one window of a sensor, on the device.

    size       : (width, height) of the window
    eye_buffer : where the triangles are written that they lie on, + 1, 0 for none

    textures, defines : for programs that include start_points.glsl
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
        self._of: object = None  # sensor, window and table of what is uploaded
        self._found = False  # the triangles, for these
        self.defines: dict[str, object] = {"START_POINTS": 1}
        names = ["start_positions", "start_normals"]
        if sensor.smooth:
            names.append("start_shading")
            # Also for scenes without any, where other code has made some.
            self.defines |= {"START_SHADING": 1, "HAS_NORMALS": 1}
        self.textures = {name: gl.texture(size, 4, dtype="f4") for name in names}
        for texture in self.textures.values():
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        # Triangles of a far part of the scene have the rounding of their own coordinates.
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
        """Take the points of a window, of the table that a number from 0 to 1 chooses; returns the uniforms."""
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
            # Row 0 of the device is at the bottom.
            texture.write(np.ascontiguousarray(texels[::-1]).tobytes())

    def find(self, start: Uniforms) -> None:
        """Which triangle each point lies on, where that is not known yet. start: what `at` has returned."""
        if self._found and self._scene.moving is None:
            return
        self._pass.run({**self._scene.uniforms, **self._bvh.uniforms, **start})
        self._found = True
