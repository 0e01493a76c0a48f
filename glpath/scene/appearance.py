"""Reflectance, opacity and emission of materials with textures and vertex colours, evaluated on the CPU.

`shaders/scene/surface.glsl` computes the same on the device. The CPU version serves code that needs means or single
points: light samples, and the elements of radiosity.

Cost:     a look-up of N points is a dozen numpy calls. A mean over a triangle takes 16 to 4096 points of 0.2 us,
          more if it covers more texels. Scenes with many such triangles use fewer points for each.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.scene.geometry import Float64, Shape
from glpath.scene.material import Material, Texture, TextureSlot, averaged
from glpath.system.colour import decode_srgb

if TYPE_CHECKING:
    from glpath.scene.model import Scene

Int64 = NDArray[np.int64]

#: Barycentric coordinates b1, b2 of the corners of a whole triangle.
WHOLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
# Allowed numbers of parts along a triangle's edge, for the mean over a triangle. The number is chosen so that a
# part is about a texel large.
_PARTS = (4, 8, 16, 32, 64)
# Maximum total number of sample points for the means of all triangles. It is exceeded only if all triangles already
# have the fewest parts. In `parlour`, 256 points per triangle instead of 4096 change the mean of a triangle by 0.6
# %, and the mean of the room by 0.05 %. That is far less than the noise of a radiosity solution's particles.
_ALL_POINTS = 1 << 21
_TOGETHER = 1 << 16  # points looked up at once, so that their arrays fit into a cache


def texture_at(texture: Texture, uv: Float64) -> Float64:
    """Return (N, 4) float64: linear Rec. 709 colour and alpha of a texture at texture coordinates (N, 2).

    Alpha is 1 if the image has none.
    """
    height, width = texture.image.shape[:2]
    where = []
    for axis, size in enumerate((width, height)):
        x, wrap = uv[:, axis] * texture.scale[axis], texture.wrap[axis]
        if wrap == "repeat":
            x = x - np.floor(x)
        elif wrap == "mirror":
            x = 1.0 - np.abs(x % 2.0 - 1.0)
        # Row 0 is the top, where v = 1.
        position = (1.0 - x if axis else x) * size
        where.append(position if wrap == "repeat" else np.clip(position, 0.5, size - 0.5))
    x, y = where
    if texture.filter == "nearest":
        return _texels(texture, np.floor(y).astype(np.int64) % height, np.floor(x).astype(np.int64) % width)
    column, row = np.floor(x - 0.5), np.floor(y - 0.5)
    right, below = (x - 0.5 - column)[:, None], (y - 0.5 - row)[:, None]
    j, i = column.astype(np.int64), row.astype(np.int64)

    def rows(i: Int64) -> Float64:
        i = i % height
        left = (1 - right) * _texels(texture, i, j % width)
        return np.asarray(left + right * _texels(texture, i, (j + 1) % width))

    return np.asarray((1 - below) * rows(i) + below * rows(i + 1))


def _texels(texture: Texture, row: Int64, column: Int64) -> Float64:
    width, channels = texture.image.shape[1:]
    stored = texture.image.reshape(-1, channels).take(row * width + column, axis=0)
    values = np.empty((len(row), 4))
    if texture.image.dtype == np.uint8:
        values[:, :3] = (_SRGB if texture.srgb else _BYTES).take(stored[:, :3])
        values[:, 3] = _BYTES.take(stored[:, 3]) if channels == 4 else 1.0
    else:
        values[:, :channels] = stored
        values[:, channels:] = 1.0
    return values


_BYTES = np.arange(256) / 255.0
_SRGB = decode_srgb(_BYTES)


class Appearance:
    """Reflectance, opacity and emission of a scene's triangles.

    A point is given by its triangle's number (N,) and by the barycentric coordinates b1, b2 (N, 2) of corners 1 and
    2.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._materials = [scene.materials[shape.material] for shape in scene.shapes]

    # Values at points.

    def opacity(self, triangle: Int64, b: Float64) -> Float64:
        """Return the (N,) float64 opacity in [0, 1], the fraction of light that does not pass straight through.

        It is 0 or 1 for a material whose `alpha` is "mask".
        """
        return self._by_shape(triangle, b, self._opacity, 1, lambda shape, material: 1.0)[:, 0]

    def reflectance(self, triangle: Int64, b: Float64) -> Float64:
        """Return the (N, 3) float64 reflectance of the front, times the fraction of light that hits the surface."""
        return self._by_shape(triangle, b, self._reflectance, 3, lambda shape, material: material.reflectance)

    def emission(self, triangle: Int64, b: Float64) -> Float64:
        """Return the (N, 3) float64 emitted radiance in W sr^-1 m^-2, times the opacity."""
        return self._by_shape(triangle, b, self._emission, 3, lambda shape, material: shape.emission)

    def sphere_emission(self, shape: int, unit: Float64) -> Float64:
        """Return the (N, 3) float64 emitted radiance, times the opacity, of a shape that consists of spheres.

        shape : index of the shape
        unit  : (N, 3) points of the unit sphere
        """
        of, material = self.scene.shapes[shape], self._materials[shape]
        longitude = np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi) % 1.0
        uv = np.stack([longitude, 0.5 + np.arcsin(np.clip(unit[:, 2], -1, 1)) / np.pi], axis=1)

        def at(slot: TextureSlot | None) -> Float64:
            if slot is None:
                return np.ones((len(uv), 4))
            mapped = uv @ slot.uv_transform[:, :2].T + slot.uv_transform[:, 2]
            return texture_at(self.scene.textures[slot.texture], mapped)

        light = of.emission * at(material.emission_texture)[:, :3]
        return np.asarray(light * opacity_of(material, at(material.texture)[:, 3:]))

    def mean_sphere_emission(self, shape: int) -> Float64:
        """Return the (3,) float64 emitted radiance of a shape of spheres, averaged over the unit sphere."""
        return np.asarray(self.sphere_emission(shape, _sphere_points(4096)).mean(axis=0))

    # Means over parts of triangles.

    def mean_opacity(self) -> Float64:
        """Return the (T,) float64 mean opacity of each triangle."""
        return self._means(self.opacity, "opacity", self._all, WHOLE, 1)[:, 0]

    def mean_reflectance(self, triangle: Int64 | None = None, corners: Float64 = WHOLE) -> Float64:
        """Return the (P, 3) float64 mean reflectance of parts of triangles.

        triangle : (P,) indices of the triangles; None: all triangles
        corners  : (P, 3, 2) barycentric coordinates of each part's corners
        """
        return self._means(self.reflectance, "reflectance", triangle, corners, 3)

    def mean_emission(self, triangle: Int64 | None = None, corners: Float64 = WHOLE) -> Float64:
        """Return the (P, 3) float64 mean radiance in W sr^-1 m^-2 of parts of triangles.

        Parameters are those of `mean_reflectance`.
        """
        return self._means(self.emission, "emission", triangle, corners, 3)

    def side_reflectance(self) -> Float64:
        """Return the (2, T, 3) float64 reflectance of triangles' fronts and backs, see `Scene.side_reflectance`."""
        materials, shape = self._materials, self.scene.triangle_shape
        clear = self.clear_shares()
        front = np.array([self.scene.mean_reflectance(m, c) for m, c in zip(materials, clear, strict=True)])
        front = front.reshape(-1, 3)[shape]
        painted = np.flatnonzero(self.varies("reflectance")[shape])
        if len(painted):
            front[painted] = self.mean_reflectance(painted)
            opacity = self.mean_opacity()
            for number in np.unique(shape[painted]):
                own = painted[shape[painted] == number]
                # `front` contains the opacity. It is divided out before layers are added, and multiplied in again
                # afterwards, because holes have no layers either.
                there = opacity[own, None]
                base = front[own] / np.where(there > 0, there, 1.0)
                mean = averaged(materials[number], self.scene.textures)
                front[own] = there * mean.hemispherical_reflectance(base, clear[number])
        two_sided = np.array([m.two_sided for m in materials], float)[shape, None]
        return np.stack([front, front * two_sided])

    def side_transmittance(self) -> Float64:
        """Return the (2, T, 3) float64 diffuse transmittance for light on triangles' fronts and on their backs.

        This is the fraction that a diffuse base sends to the other side. It is the same for both sides, but 0 for a
        front whose back is culled. Textures contribute their mean, times the triangle's mean opacity.
        """
        of_shapes = np.zeros((len(self._materials), 3))
        for number, (material, clear) in enumerate(zip(self._materials, self.clear_shares(), strict=True)):
            if material.diffuse_transmission > 0:
                base = material.reflectance
                if material.texture is not None:
                    base = base * self.scene.textures[material.texture.texture].mean
                mean = averaged(material, self.scene.textures)
                of_shapes[number] = mean.hemispherical_transmittance(base, clear)
        found = of_shapes[self.scene.triangle_shape]
        through = np.flatnonzero(found.any(axis=1))
        if len(through):
            found[through] *= self.mean_opacity()[through, None]
        return np.stack([np.where(self.culled[:, None], 0.0, found), found])

    @property
    def culled(self) -> NDArray[np.bool_]:
        """Flags (T,), True for triangles with a culled back."""
        return np.array([material.culled for material in self._materials], bool)[self.scene.triangle_shape]

    def clear_shares(self) -> Float64:
        """Return the (shapes,) float64 fraction of each shape's base that is glass."""
        share = np.array([material.clear for material in self._materials], float)
        for number in np.flatnonzero(share):
            slot = self._materials[number].transmission_texture
            if slot is not None:
                share[number] *= self.scene.textures[slot.texture].linear()[..., 0].mean()
        return share

    def mean_clear(self) -> Float64:
        """Return the (T, 3) float64 mean transmittance of triangles for light that their surface does not reflect.

        It is the transmittance of the glass, times the fraction of the base that is glass.
        """
        of = self.clear_shares()[self.scene.triangle_shape]
        found = np.zeros((len(of), 3))
        glass = np.flatnonzero(of)
        if len(glass):
            opacity = self.mean_opacity()[glass, None]
            base = self.mean_reflectance(glass, np.broadcast_to(WHOLE, (len(glass), 3, 2)))
            base = base / np.where(opacity > 0, opacity, 1.0)
            found[glass] = of[glass, None] * self._glass_colour(glass, base)
        return found

    def _glass_colour(self, triangle: Int64, base: Float64) -> Float64:
        """Return the transmittance (N, 3) of the glass of triangles (N,) from their colours (N, 3)."""
        by_root = np.array([m.layering == "disney" for m in self._materials])[self.scene.triangle_shape[triangle]]
        return np.where(by_root[:, None], np.sqrt(base), base)

    @cached_property
    def _all(self) -> Int64:
        return np.arange(len(self.scene.triangle_shape))

    def varies(self, what: str) -> NDArray[np.bool_]:
        """Return (shapes,) bool: True if a property is not constant over the shape.

        what : "reflectance", "opacity" or "emission"
        """
        return np.array(
            [what in _varying(s, m) for s, m in zip(self.scene.shapes, self._materials, strict=True)], bool
        )

    def slot_uv(self, slot: TextureSlot, triangle: Int64, b: Float64) -> Float64:
        """Return the (N, 2) lookup coordinates of a texture slot at points.

        With K points b (N, K, 2) of each triangle, the result is (N, K, 2).
        """
        shapes = self.scene.shapes
        vertex_uv = shapes.vertex_uv1 if slot.uv_set else shapes.vertex_uv
        uv = vertex_uv.take(shapes.faces.take(triangle, axis=0), axis=0)
        if b.ndim == 3:
            uv = uv[:, :, None]
        at = uv[:, 0] + b[..., :1] * (uv[:, 1] - uv[:, 0]) + b[..., 1:] * (uv[:, 2] - uv[:, 0])
        return np.asarray(at @ slot.uv_transform[:, :2].T + slot.uv_transform[:, 2])

    def _at(self, slot: TextureSlot | None, triangle: Int64, b: Float64) -> Float64:
        if slot is None:
            return np.ones((len(triangle), 4))
        return texture_at(self.scene.textures[slot.texture], self.slot_uv(slot, triangle, b))

    def _colours(self, shape: Shape, triangle: Int64, b: Float64) -> Float64:
        if not has_colours(shape):
            return np.ones((len(triangle), 4))
        shapes = self.scene.shapes
        c = shapes.vertex_colours[shapes.faces[triangle]]
        return np.asarray(c[:, 0] + b[:, :1] * (c[:, 1] - c[:, 0]) + b[:, 1:] * (c[:, 2] - c[:, 0]))

    def _base(self, shape: Shape, material: Material, triangle: Int64, b: Float64) -> tuple[Float64, Float64]:
        """Return the colour (N, 3) that multiplies reflectance, and the opacity (N, 1)."""
        base = self._at(material.texture, triangle, b) * self._colours(shape, triangle, b)
        return base[:, :3], opacity_of(material, base[:, 3:])

    def _opacity(self, shape: Shape, material: Material, triangle: Int64, b: Float64) -> Float64:
        return self._base(shape, material, triangle, b)[1]

    def _reflectance(self, shape: Shape, material: Material, triangle: Int64, b: Float64) -> Float64:
        colour, opacity = self._base(shape, material, triangle, b)
        return material.reflectance * colour * opacity

    def _emission(self, shape: Shape, material: Material, triangle: Int64, b: Float64) -> Float64:
        light = shape.emission * self._at(material.emission_texture, triangle, b)[:, :3]
        if material.unlit:
            light = light * self._colours(shape, triangle, b)[:, :3]
        return light if material.alpha == "opaque" else light * self._opacity(shape, material, triangle, b)

    def _by_shape(
        self,
        triangle: Int64,
        b: Float64,
        of: Callable[[Shape, Material, Int64, Float64], Float64],
        width: int,
        constant: Callable[[Shape, Material], Float64 | float],
    ) -> Float64:
        what = of.__name__[1:]
        shape_of = self.scene.triangle_shape[triangle]
        constants = np.zeros((len(self._materials), width))
        for number, (shape, material) in enumerate(zip(self.scene.shapes, self._materials, strict=True)):
            if what != "reflectance" or not material.unlit:
                constants[number] = constant(shape, material)
        found = constants[shape_of]
        varying = self.varies(what)
        for number in np.unique(shape_of[varying[shape_of]]):
            own = np.flatnonzero(shape_of == number)
            found[own] = of(self.scene.shapes[number], self._materials[number], triangle[own], b[own])
        return found

    def _means(
        self,
        of: Callable[[Int64, Float64], Float64],
        what: str,
        triangle: Int64 | None,
        corners: Float64,
        width: int,
    ) -> Float64:
        triangle = self._all if triangle is None else triangle
        corners = np.broadcast_to(corners, (len(triangle), 3, 2))
        found = of(triangle, corners.mean(axis=1)).reshape(len(triangle), width)
        varying = np.flatnonzero(self.varies(what)[self.scene.triangle_shape[triangle]])
        parts = self._parts_of(triangle[varying], corners[varying])
        if what == "emission":
            # Emission textures are mostly black, and black parts need no samples.
            glows = self._may_glow(triangle[varying], corners[varying])
            varying, parts = varying[glows], parts[glows]
        for k in np.unique(parts):
            own = varying[parts == k]
            weights = _middles(int(k))
            for first in range(0, len(own), max(1, _TOGETHER // len(weights))):
                some = own[first : first + max(1, _TOGETHER // len(weights))]
                b = np.einsum("kc,pcx->pkx", weights, corners[some]).reshape(-1, 2)
                values = of(np.repeat(triangle[some], len(weights)), b)
                found[some] = values.reshape(len(some), len(weights), width).mean(axis=1)
        return found

    def _parts_of(self, triangle: Int64, corners: Float64) -> Int64:
        """Return the (P,) number of parts along an edge for each triangle; more texels need more parts."""
        texels = np.zeros(len(triangle))
        shape_of = self.scene.triangle_shape[triangle]
        for number in np.unique(shape_of):
            own = np.flatnonzero(shape_of == number)
            # Among texture slots with the same coordinates, the largest texture decides.
            finest: dict[tuple[int, bytes], tuple[TextureSlot, float]] = {}
            for slot in self._materials[number].slots.values():
                texture = self.scene.textures[slot.texture]
                size = float(np.prod(texture.scale) * texture.image.shape[0] * texture.image.shape[1])
                key = (slot.uv_set, np.asarray(slot.uv_transform, float).tobytes())
                if key not in finest or size > finest[key][1]:
                    finest[key] = slot, size
            for slot, size in finest.values():
                uv = self.slot_uv(slot, triangle[own], corners[own])
                (x0, y0), (x1, y1) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
                texels[own] = np.maximum(texels[own], 0.5 * np.abs(x0 * y1 - x1 * y0) * size)
        steps = np.array(_PARTS)
        found = np.minimum(np.searchsorted(steps**2, texels), len(steps) - 1)
        for largest in range(len(steps) - 1, 0, -1):
            below = np.minimum(found, largest)
            if (steps[below] ** 2).sum() <= _ALL_POINTS:
                return steps[below]
        return np.full(len(found), steps[0])

    def _may_glow(self, triangle: Int64, corners: Float64) -> NDArray[np.bool_]:
        """Return (P,) bool: False if the emission texture is black in the whole part."""
        found = np.ones(len(triangle), bool)
        shape_of = self.scene.triangle_shape[triangle]
        for number in np.unique(shape_of):
            slot = self._materials[number].emission_texture
            if slot is not None:
                own = np.flatnonzero(shape_of == number)
                uv = self.slot_uv(slot, triangle[own], corners[own])
                found[own] = _not_black(self.scene.textures[slot.texture], uv)
        return found


def _not_black(texture: Texture, uv: Float64) -> NDArray[np.bool_]:
    """Return (P,) bool: True if triangles (P, 3, 2) of texture coordinates may show a colour other than black.

    Triangles that reach beyond the image, into its repetitions, always count as coloured.
    """
    height, width = texture.image.shape[:2]
    coloured = texture.image[..., 0] != 0
    for channel in (1, 2):
        coloured |= texture.image[..., channel] != 0
    # Summed-area table: number of coloured texels above and to the left of each texel corner.
    before = np.zeros((height + 1, width + 1), np.int32)
    before[1:, 1:] = coloured.cumsum(axis=0, dtype=np.int32).cumsum(axis=1)
    x = uv[..., 0] * texture.scale[0] * width
    # Row 0 is the top, where v = 1.
    y = (1.0 - uv[..., 1] * texture.scale[1]) * height
    # Bilinear filtering reaches half a texel beyond the triangle; the rest of the margin is for rounding errors.
    left, right = np.floor(x.min(axis=1)) - 1, np.floor(x.max(axis=1)) + 2
    top, bottom = np.floor(y.min(axis=1)) - 1, np.floor(y.max(axis=1)) + 2
    inside = (left >= 0) & (top >= 0) & (right <= width) & (bottom <= height)
    a, b, c, d = (np.where(inside, edge, 0).astype(np.int64) for edge in (left, right, top, bottom))
    return np.asarray(~inside | (before[d, b] - before[d, a] - before[c, b] + before[c, a] > 0))


def has_colours(shape: Shape) -> bool:
    """Return True if the shape's vertices have colours."""
    return getattr(shape.geometry, "colours", None) is not None


def opacity_of(material: Material, alpha: Float64) -> Float64:
    """Return the opacity of a material for the alpha of its texture and vertices, an array of any shape."""
    if material.alpha == "opaque":
        return np.ones_like(alpha)
    opacity = material.opacity * alpha
    return (
        (opacity >= material.cutoff).astype(np.float64) if material.alpha == "mask" else np.clip(opacity, 0.0, 1.0)
    )


def _varying(shape: Shape, material: Material) -> set[str]:
    painted, coloured = material.texture is not None, has_colours(shape)
    found = set()
    if material.alpha != "opaque":
        found |= {"opacity", "reflectance"} | ({"emission"} if shape.emits else set())
    if painted or coloured:
        found.add("reflectance")
    if shape.emits and (material.emission_texture is not None or (material.unlit and coloured)):
        found.add("emission")
    return found - ({"reflectance"} if material.unlit else set())


def _sphere_points(n: int) -> Float64:
    """Return (n, 3) points spread evenly over the unit sphere by the golden ratio."""
    i = np.arange(n)
    z, phi = 1 - (2 * i + 1) / n, 2 * np.pi * (i * 0.6180339887498949 % 1.0)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def _middles(k: int) -> Float64:
    """Return (k * k, 3) barycentric coordinates of the centres of the k * k equal parts of a triangle."""
    j, i = np.divmod(np.arange(k * k), k)
    lower = i + j < k
    # Points beyond the diagonal are mirrored back into the triangle: they become the centres of the inverted parts.
    x, y = np.where(lower, i + 1 / 3, k - i - 1 / 3), np.where(lower, j + 1 / 3, k - j - 1 / 3)
    b1, b2 = x / k, y / k
    return np.stack([1 - b1 - b2, b1, b2], axis=1)
