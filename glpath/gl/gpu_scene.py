"""A `Scene` on the device: triangles as texels, emitters as a table for sampling.

Triangles lie in a float texture rather than in a storage buffer: Mesa's llvmpipe fetches texels with vector
gathers, but loads from buffers lane by lane. The layout is declared once, here, and handed to GLSL as text.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from glpath.errors import SceneError
from glpath.scene.model import Float64, Scene

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


@dataclass(frozen=True)
class Emitters:
    """Light points by power [PB 3.3, A.3]: a shape by its share of the power, a point uniform by area.

    A shape that emits on both sides counts as two, one per side. Within a shape, a triangle is chosen by area with
    the same random number that then places the point, so that a quad keeps a two-dimensional stratification.
    """

    shape_cdf: Float64  # (E + 1,) over emitting sides
    side_first: np.ndarray  # (E,) index of the first emitting triangle of the shape
    side_sign: Float64  # (E,) +1 front, -1 back
    side_density: Float64  # (E,) per area, of a light point on that side
    side_cdf: tuple[Float64, ...]  # (E,) of (n + 1,) cumulated share of area
    corners: Float64  # (T, 3, 3) of the scene
    normals: Float64  # (T, 3)
    radiance: Float64  # (E, 3)

    def sample(self, u: Float64) -> tuple[Float64, Float64, Float64, float]:
        """A light point from u (3,) in [0, 1).

        Returns position (3,), normal (3,) of the side that emits, radiance (3,), density per area.
        """
        side = int(np.searchsorted(self.shape_cdf, u[0], side="right")) - 1
        side = min(side, len(self.side_first) - 1)
        cdf = self.side_cdf[side]
        k = min(int(np.searchsorted(cdf, u[1], side="right")) - 1, len(cdf) - 2)
        triangle = int(self.side_first[side]) + k
        s = (u[1] - cdf[k]) / (cdf[k + 1] - cdf[k])
        # Area-preserving: parallel lines to the edge opposite corner 0.
        root = np.sqrt(s)
        a, b, c = self.corners[triangle]
        position = (1 - root) * a + root * ((1 - u[2]) * b + u[2] * c)
        return (
            position,
            self.normals[triangle] * self.side_sign[side],
            self.radiance[side],
            float(self.side_density[side]),
        )


class GpuScene:
    """The triangles of a scene in a texture.

    texture  : RGBA float32, see TRIANGLE_LAYOUT
    emitters : None for a scene without light
    centre, radius : a sphere around everything, scene units
    corners  : (8, 3) of the box around everything, about the centre
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self.scene = scene
        self.count = len(scene.triangles)
        self.emitters, density = _emitters(scene)
        self.brightest = max((float(s.emission.max()) for s in scene.shapes), default=0.0)
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
            table[rows, 2, 3] = density[rows] * (-1 if shape.emission_two_sided else 1)
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


def _emitters(scene: Scene) -> tuple[Emitters | None, Float64]:
    """The table of emitting sides, and for every triangle the density of a light point on it (0: no light)."""
    areas = scene.areas
    density = np.zeros(len(areas))
    sides: list[tuple[int, float, float, Float64, Float64]] = []
    shape_of_side: list[int] = []
    for i, shape in enumerate(scene.shapes):
        if not shape.emits:
            continue
        own = areas[shape.first : shape.first + shape.count]
        cdf = np.concatenate([[0.0], np.cumsum(own) / own.sum()])
        for sign in (1.0, -1.0) if shape.emission_two_sided else (1.0,):
            sides.append((shape.first, sign, float(own.sum()), cdf, shape.emission))
            shape_of_side.append(i)
    if not sides:
        return None, density
    # Power up to the factor pi; the mean of the channels, so that no coloured light is starved.
    power = np.array([area * radiance.mean() for _, _, area, _, radiance in sides])
    share = power / power.sum()
    per_area = share / np.array([area for _, _, area, _, _ in sides])
    for i, value in zip(shape_of_side, per_area, strict=True):
        shape = scene.shapes[i]
        density[shape.first : shape.first + shape.count] = value
    return (
        Emitters(
            shape_cdf=np.concatenate([[0.0], np.cumsum(share)]),
            side_first=np.array([s[0] for s in sides]),
            side_sign=np.array([s[1] for s in sides]),
            side_density=per_area,
            side_cdf=tuple(s[3] for s in sides),
            corners=scene.triangles,
            normals=scene.normals,
            radiance=np.array([s[4] for s in sides]),
        ),
        density,
    )
