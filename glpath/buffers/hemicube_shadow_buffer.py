"""Shadow-buffer of a path set's light sample [PB 3.3]: a hemicube above it (Cohen & Greenberg 1985).

The hemicube has five faces in one atlas, filled by one instanced draw. Lights that emit in all directions have a
full cube. A texel holds a triangle's number. `lights/direct.glsl` looks the number up and intersects the triangle's
plane, so no depth bias is needed. At a silhouette, the shader also intersects the triangle of the neighbouring
texel, exactly. The remaining error, where three surfaces fall into one texel, averages out because the light sample
and the hemicube's roll change from set to set.

Cost:     five transformations of each vertex of the scene, and 3 R^2 texels.
Poor at:  scenes in which details finer than a texel (90 degrees / R near a face's centre) cast shadows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.frame import frame_about
from glpath.gl.device_scene import DeviceScene
from glpath.gl.geometry_stream import Kept, StreamedScan, before_planes
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts


@dataclass(frozen=True)
class HemicubeFrame:
    """Position and orientation of a hemicube.

    position  : (3,) position of the light sample
    axes      : (3, 3) unit: tangent, bitangent and normal; the top face looks along the normal
    one_sided : True if the light sample emits only to the side of the normal, and may lie on a surface
    uniforms  : uniforms of hemicube.glsl
    """

    position: NDArray[np.float64]
    axes: NDArray[np.float64]
    one_sided: bool
    uniforms: dict[str, object]


class HemicubeShadowBuffer(Owner):
    """Buffer of the triangles that are visible from a light sample.

    Parameters
    ----------
    resolution : R, texels along a side of the top face; the atlas is 2 R x 1.5 R. Even.
    full       : True for six faces R x R, in an atlas of 3 R x 2 R, for points that emit in all directions

    Attributes
    ----------
    texture : R32UI, triangle number + 1, 0 for none
    textures : the texture, and records of streamed triangles, by their names in direct.glsl
    defines : defines for a program that includes hemicube.glsl
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene, resolution: int, full: bool = False) -> None:
        self.scene = scene
        self.resolution = resolution
        self.defines: dict[str, object] = {"FULL_CUBE": 1} if full else {}
        size = (3 * resolution, 2 * resolution) if full else (2 * resolution, 3 * resolution // 2)
        self.texture = gl.texture(size, 1, dtype="u4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        program = load_program(
            gl,
            vertex="shadow/hemicube.vert",
            fragment="shadow/hemicube.frag",
            generated=scene.generated,
            defines=scene.defines | self.defines,
        )
        self._pass = Pass(
            "shadow-buffer",
            gl,
            program,
            gl.framebuffer([self.texture], gl.depth_texture(size)),
            triangles=scene.triangles,
            textures=scene.textures,
            depth=True,
            clip_distances=5 if full else 4,
            clear=(0.0, 0.0, 0.0, 0.0),
        )
        self.textures = {"light_buffer": self.texture}
        self._streamed: StreamedScan | None = None
        if scene.stream is not None:
            self.textures["light_records"] = records = scene.stream.records(size)
            self._streamed = StreamedScan(
                "shadow-buffer",
                scene.stream,
                ("shadow/hemicube.vert", "shadow/hemicube.frag"),
                ProgramParts(
                    textures=scene.textures, generated=scene.generated, defines=scene.defines | self.defines
                ),
                self._pass.target,
                depth=True,
                clip_distances=5 if full else 4,
                kept=Kept(records, self.texture),
            )

    def frame(
        self, position: NDArray[np.float64], normal: NDArray[np.float64], roll: float, one_sided: bool = True
    ) -> HemicubeFrame:
        """Return the frame of a light sample at `position`; `roll` (radians) rotates the cube about the normal."""
        assert one_sided or self.defines, "a light to all sides takes a full cube"
        tangent, bitangent = frame_about(normal, roll)
        radius = float(np.linalg.norm(position - self.scene.centre)) + self.scene.radius
        uniforms: dict[str, object] = {
            "light_position": tuple(position),
            "light_normal": tuple(normal),
            "light_tangent": tuple(tangent),
            "light_bitangent": tuple(bitangent),
            "light_resolution": float(self.resolution),
            "light_range": (1e-6 * self.scene.radius, 1.01 * radius),
            "light_one_sided": one_sided,
        }
        return HemicubeFrame(position, np.stack([tangent, bitangent, normal]), one_sided, uniforms)

    def scan(
        self, frame: HemicubeFrame, faces: int | None = None, uniforms: Mapping[str, object] | None = None
    ) -> None:
        """Scan convert the scene from the light sample.

        faces    : number of faces to draw: 1 for the top, 5 with the sides; all faces by default
        uniforms : uniforms to add for stochastically transparent surfaces
        """
        count = faces or (6 if self.defines else 5)
        given = {**self.scene.uniforms, **frame.uniforms, **(uniforms or {})}
        self._pass.run(given, instances=count)
        if self._streamed is not None:
            of_faces = [self._sees(frame, face) for face in range(count)]
            seen = np.any(of_faces, axis=0)
            self._streamed.run(given, seen, faces=of_faces)

    def _sees(self, frame: HemicubeFrame, face: int) -> NDArray[np.bool_]:
        """Return (N,) bool: True for chunks of streamed triangles that may be visible from a face."""
        stream = self.scene.stream
        assert stream is not None, "who streams"
        t, b, n = frame.axes
        axis = (n, t, -t, b, -b, -n)[face]
        sides = [side for side in (t, b, n) if abs(side @ axis) < 0.5]
        # The planes span one degree more than the face's 90 degrees, because the device rounds.
        normals = [axis, *(1.02 * axis + sign * side for side in sides for sign in (1.0, -1.0))]
        if frame.one_sided:
            normals.append(n)
        planes = np.array(normals)
        return before_planes(stream.lower, stream.upper, planes, planes @ frame.position)
