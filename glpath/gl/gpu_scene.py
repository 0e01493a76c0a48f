"""A `Scene` on the device: triangles as texels, and its lights to sample from.

Triangles lie in a float texture rather than in a storage buffer: Mesa's llvmpipe fetches texels with vector
gathers, but loads from buffers lane by lane. The layout is declared once, here, and handed to GLSL as text.
"""

from __future__ import annotations

import moderngl
import numpy as np

from glpath.errors import SceneError
from glpath.lighting import Lighting, max_radiance
from glpath.scene.model import Scene

#: What a triangle's texels hold, in order; each is an RGBA float32 texel.
TRIANGLE_LAYOUT = {
    "PLANE": "unit normal out of the front, and its dot product with any point of the plane",
    "REFLECTANCE": "linear Rec. 709 reflectance, and 1 where the back reflects as well",
    "EMISSION": "radiance; |w| the density per area of the light sample, < 0 where both sides emit",
    "VERTEX0": "corner, world space",
    "VERTEX1": "corner, world space",
    "VERTEX2": "corner, world space",
}
_WIDTH = 4096


def triangle_glsl() -> str:
    """The layout as GLSL: constants and the one way to fetch."""
    names = list(TRIANGLE_LAYOUT)
    lines = [f"const int TRIANGLE_{name} = {i};  // {TRIANGLE_LAYOUT[name]}" for i, name in enumerate(names)]
    lines += [
        '#include "texels.glsl"',
        "TEXELS(rgba32f, triangles);",
        "vec4 triangle_texel(int triangle, int what)",
        "{",
        f"    int i = triangle * {len(names)} + what;",
        f"    return texel(triangles, ivec2(i & {_WIDTH - 1}, i >> {_WIDTH.bit_length() - 1}));",
        "}",
    ]
    return "\n".join(lines)


class GpuScene:
    """The triangles of a scene in a texture.

    texture  : RGBA float32, see TRIANGLE_LAYOUT
    lighting : where light samples come from
    centre, radius : a sphere around everything, scene units
    corners  : (8, 3) of the box around everything, about the centre
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self.scene = scene
        self.count = len(scene.triangles)
        self.lighting = Lighting.of(scene)
        self.max_radiance = max_radiance(scene)
        low, high = scene.bounds
        self.centre = 0.5 * (low + high)
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, 8).T
        self.corners = signs * (high - low)
        self.radius = max(float(np.linalg.norm(scene.triangles.reshape(-1, 3) - self.centre, axis=1).max()), 1e-30)

        table = np.zeros((self.count, len(TRIANGLE_LAYOUT), 4), np.float32)
        normals = scene.normals
        table[:, 0, :3] = normals
        # The offset belongs to the rounded normal, or large coordinates would shift the plane.
        table[:, 0, 3] = np.einsum("ij,ij->i", table[:, 0, :3].astype(float), scene.triangles.mean(axis=1))
        for shape in scene.shapes:
            rows = slice(shape.first, shape.first + shape.count)
            material = scene.materials[shape.material]
            table[rows, 1, :3] = material.reflectance
            table[rows, 1, 3] = material.two_sided
            table[rows, 2, :3] = shape.emission
            table[rows, 2, 3] = self.lighting.triangle_density[rows] * (-1 if shape.emission_two_sided else 1)
        table[:, 3:6, :3] = scene.triangles
        height = -(-self.count * len(TRIANGLE_LAYOUT) // _WIDTH)
        # A float holds a triangle's number, 0 for none.
        most = min(gl.info["GL_MAX_TEXTURE_SIZE"] * _WIDTH // len(TRIANGLE_LAYOUT), (1 << 24) - 1)
        if self.count > most:
            raise SceneError(
                f"{scene.source or scene.name}: {self.count} triangles; this device holds at most {most}",
                "Simplify the meshes, or render on a device with a larger texture limit.",
            )
        padded = np.zeros((height * _WIDTH, 4), np.float32)
        padded[: self.count * len(TRIANGLE_LAYOUT)] = table.reshape(-1, 4)
        self.texture = gl.texture((_WIDTH, height), 4, data=padded.tobytes(), dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def release(self) -> None:
        self.texture.release()
