"""Shadow-buffers: what a light point sees, looked up instead of shooting shadow rays [PB 3.3].

`HemicubeShadowBuffer` is for a point on a surface: a hemicube above it (Cohen & Greenberg 1985), five faces in one
atlas, filled by one instanced draw. It holds triangle numbers. `shaders/direct.glsl` looks them up and meets the
triangle's plane, so no depth bias is needed, and at a silhouette meets the next texel's triangle exactly. What is
left is the error where three surfaces meet within a texel, which averages out as the light point and the hemicube's
roll change from set to set.

Cost:     five vertices' worth of the scene per corner, and 3 R^2 texels.
Poor at:  scenes where detail finer than a texel (90 degrees / R near a face's middle) throws shadows.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.buffers.frame import frame_about
from glpath.gl.gpu_scene import GpuScene, triangle_glsl
from glpath.gl.passes import Pass
from glpath.gl.program import load_program


class HemicubeShadowBuffer:
    """The triangles that a light point sees.

    Parameters
    ----------
    resolution : R, texels along a side of the top face; the atlas is 2 R x 1.5 R. Even.

    Attributes
    ----------
    texture : R32F, triangle number + 1, 0 for none
    """

    def __init__(self, gl: moderngl.Context, scene: GpuScene, resolution: int) -> None:
        self.scene = scene
        self.resolution = resolution
        size = (2 * resolution, 3 * resolution // 2)
        self.texture = gl.texture(size, 1, dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        program = load_program(
            gl, vertex="hemicube.vert", fragment="hemicube.frag", generated={"TRIANGLE": triangle_glsl()}
        )
        self._pass = Pass(
            "shadow-buffer",
            gl,
            program,
            gl.framebuffer([self.texture], gl.depth_texture(size)),
            vertices=3 * scene.count,
            instances=5,
            depth=True,
            clip_distances=4,
            clear=(0.0, 0.0, 0.0, 0.0),
            textures={"triangles": scene.texture},
        )

    def frame(self, position: NDArray[np.float64], normal: NDArray[np.float64], roll: float) -> dict[str, object]:
        """The uniforms of `hemicube.glsl` for a light point; `roll` (radians) turns the cube about the normal."""
        tangent, bitangent = frame_about(normal, roll)
        reach = float(np.linalg.norm(position - self.scene.centre)) + self.scene.radius
        return {
            "light_position": tuple(position),
            "light_normal": tuple(normal),
            "light_tangent": tuple(tangent),
            "light_bitangent": tuple(bitangent),
            "light_resolution": float(self.resolution),
            "light_range": (1e-6 * self.scene.radius, 1.01 * reach),
        }

    def scan(self, uniforms: dict[str, object]) -> None:
        """Scan convert the scene as the light point sees it."""
        self._pass.run(uniforms)
