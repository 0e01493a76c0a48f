"""Form factors by the hemicube: what a point sees, counted texel by texel on five faces.

A hemicube stands on the point, along its normal; the scene is drawn on it with hidden surfaces removed, and each
texel adds its own form factor to the triangle that it shows. The form factor of a texel is exact, so that a point
whose view is closed has a row that sums to 1. An alternative to the ray-cast form factors of
`glpath.radiosity`, and a check of these.

Cost:     a draw of the scene on five faces, 3 R^2 texels to read back and to count, for every point.
Poor at:  triangles that are small on the hemicube: the error of a form factor is about what the texels along the
          triangle's outline are worth, 0.5 % for one that is 50 texels wide, and one smaller than a texel may be
          missed. Surfaces that nearly touch: a row is that of its point alone, so take several on an element.
Source:   Cohen & Greenberg 1985, The hemi-cube: a radiosity solution for complex environments.
"""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.buffers.hemicube_shadow_buffer import HemicubeShadowBuffer
from glpath.errors import UsageError
from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.sampling.points import counter_hash
from glpath.scene.geometry import IDENTITY, Mesh, Shapes
from glpath.scene.model import Float64, Scene


class HemicubeFormFactors(Owner):
    """Form factors from points to the triangles of a scene, which are the elements (see `scene_of_elements`).

    Parameters
    ----------
    resolution : R, texels along a side of the top face; even
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene, resolution: int = 256) -> None:
        if resolution < 2 or resolution % 2:
            raise UsageError(f"hemicube: a resolution of {resolution}; an even number from 2 is needed")
        self.scene = scene
        self._buffer = HemicubeShadowBuffer(gl, scene, resolution)
        self._texels = atlas_form_factors(resolution).ravel()

    def rows(self, points: ArrayLike, normals: ArrayLike, seed: int = 0) -> Float64:
        """(N, T) float64: the form factor of each triangle, either side of it, seen from points (N, 3).

        normals : (N, 3) unit
        seed    : decides how each hemicube is turned about its normal

        The sum of a row is the share of the point's view that is not empty.
        """
        starts, axes = (np.asarray(v, np.float64).reshape(-1, 3) for v in (points, normals))
        found = np.zeros((len(starts), self.scene.triangle_count))
        for i, (point, normal) in enumerate(zip(starts, axes, strict=True)):
            # Another rotation for each: the errors at the texels' edges are then independent.
            roll = 2.0 * np.pi * counter_hash(seed, i) / 2**32
            self._buffer.scan(self._buffer.frame(point, normal, roll))
            seen = np.frombuffer(self._buffer.texture.read(), np.uint32).astype(np.intp)
            found[i] = np.bincount(seen, self._texels, self.scene.triangle_count + 1)[1:]
        return found

    def from_triangles(
        self, corners: ArrayLike, sides: ArrayLike = 1.0, samples: int = 4, seed: int = 0
    ) -> Float64:
        """(N, T) float64: form factors of triangles (N, 3, 3), the mean over `samples` points of each.

        sides   : (N,) or one: +1 for the front of a triangle, -1 for its back
        samples : 1, 4, 9, 16, ...: the centroids of as many equal parts

        Raises UsageError for another number of samples.
        """
        triangles = np.asarray(corners, np.float64).reshape(-1, 3, 3)
        parts = round(np.sqrt(samples))
        if parts < 1 or parts * parts != samples:
            raise UsageError(f"hemicube: {samples} samples of a triangle; 1, 4, 9, 16 and so on are possible")
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normal *= np.broadcast_to(np.asarray(sides, np.float64), len(triangles))[:, None]
        total = np.zeros((len(triangles), self.scene.triangle_count))
        for i, centroid in enumerate(_centroids(parts)):
            total += self.rows(np.einsum("k,tki->ti", centroid, triangles), normal, counter_hash(seed, i))
        return total / samples


def scene_of_elements(scene: Scene, divisions: NDArray[np.int32]) -> Scene:
    """The scene with the elements of each triangle instead of it, in the order of `glpath.radiosity.mesh.lattice`.

    divisions : (T,) in how many parts the edges of each triangle are
    """
    from glpath.radiosity.mesh import lattice  # with all of radiosity, which is slow to import

    elements = []
    for corners, n in zip(scene.triangles, divisions, strict=True):
        b = lattice.vertex_barycentrics(int(n))
        points = corners[0] + b @ (corners[1:] - corners[0])
        elements.append(points[lattice.element_vertices(int(n))])
    shapes = [
        replace(
            shape,
            kind="mesh",
            geometry=Mesh.of_triangles(np.concatenate(elements[part])),
            world_from_object=IDENTITY[None],
        )
        for shape, part in zip(scene.shapes, scene.shapes.ranges, strict=True)
    ]
    return replace(scene, shapes=Shapes(shapes))


def atlas_form_factors(resolution: int) -> Float64:
    """(1.5 R, 2 R) float64: the form factor of every texel of the atlas, row 0 first in memory; they sum to 1.

    Each is the integral of cos / (pi r^2) over the texel, in closed form: the paper's delta form factors are its
    value at the centre.
    """
    R = resolution
    edge = 2.0 * np.arange(R + 1) / R - 1.0
    x, y = np.meshgrid(edge, edge)
    rx, ry = np.sqrt(1.0 + x * x), np.sqrt(1.0 + y * y)
    top = _differences((x / rx * np.arctan(y / rx) + y / ry * np.arctan(x / ry)) / (2.0 * np.pi))
    z = np.arange(R // 2 + 1) * 2.0 / R
    across, up = np.meshgrid(edge, z)
    r = np.sqrt(1.0 + up * up)
    side = _differences(-np.arctan(across / r) / (2.0 * np.pi * r))
    # The rectangles of shaders/shadow/hemicube.glsl.
    return np.block([[top, np.concatenate([side, side])], [side, side]])


def _differences(corner: Float64) -> Float64:
    """The integral over each texel from that over the rectangle up to each corner."""
    return np.asarray(np.diff(np.diff(corner, axis=0), axis=1))


def _centroids(parts: int) -> Float64:
    """(parts^2, 3) weights of the corners: centroids of the equal parts of a triangle."""
    from glpath.radiosity.mesh import lattice  # with all of radiosity, which is slow to import

    b = lattice.vertex_barycentrics(parts)[lattice.element_vertices(parts)].mean(axis=1)
    return np.concatenate([1.0 - b.sum(axis=1, keepdims=True), b], axis=1)
