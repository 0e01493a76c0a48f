"""A `Scene` on the device as objects that rays are shot at: exact spheres, triangles, planes, and what shades them.

Primitives are numbered 0, 1, 2, ... in the order of their kinds: round spheres, ellipsoids, triangles, planes. A
kind is then a range, and a loop over a kind fetches only what that kind needs. Everything lies in one float
texture, in sections; llvmpipe fetches texels with vector gathers, but loads from buffers lane by lane. The layout
is declared once, here, and handed to GLSL as text (`#include <OBJECTS>`); `shaders/object_*.glsl` build upon it.

Cost:     16 to 80 bytes a primitive. Pictures have 16 bytes a texel, in rows of 4096 of their own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.lighting import LIGHT_KINDS
from glpath.scene.model import Float64, Int32, Light, Scene

#: What an entry's texels hold, in order, by section; each is an RGBA float32 texel.
LAYOUT: dict[str, dict[str, str]] = {
    "sphere": {"BALL": "centre; radius, negative where the front is inside"},
    "unit": {
        "ROW0": "of spheres and ellipsoids: first row of unit_from_world; x of the centre",
        "ROW1": "second row; y of the centre",
        "ROW2": "third row; z of the centre",
    },
    "ellipsoid": {
        "AXIS0": "a half axis: image of the unit sphere's x; x of the centre",
        "AXIS1": "of y; y of the centre",
        "AXIS2": "of z; z of the centre",
    },
    "triangle": {"VERTEX0": "corner, world space", "VERTEX1": "corner", "VERTEX2": "corner"},
    "plane": {
        "NORMAL": "unit, out of the front",
        "POINT": "where u = v = 0",
        "U": "its product with the way from there is u",
        "V": "and this one's is v",
    },
    "surface": {
        "FIRST": "of every primitive; a triangle's uv at corners 0 and 1",
        "LAST": "a triangle's uv at corner 2; number of the shape; number of the material",
    },
    "shape": {"EMISSION": "radiance; 1 where both sides emit"},
    "material": {
        "DIFFUSE": "reflectance, linear Rec. 709; 1 where the back reflects as well",
        "SPECULAR": "Phong's coefficient; Phong's exponent",
        "MIRROR": "share of the mirrored light; number of the texture, -1 for none",
    },
    "picture": {
        "IMAGE": "first row in picture_texels; width; height; 1 where it is filtered",
        "SCALE": "repeats per unit of u and of v",
    },
    "light": {
        "POSITION": "world space; kind, see LIGHT_POINT ...",
        "INTENSITY": "W sr^-1, or W m^-2 without falloff; 1 for quadratic falloff",
        "DIRECTION": "unit, the way the light goes",
        "CONE": "of a spot: cosines of the angles of full light and of its end",
    },
}
#: A program defines it that fetches in its fragment shader alone: texels.glsl then finds the quicker way.
STORES_ARE_TEXELS = "STORES_ARE_TEXELS"
STORE_WIDTH = 4096  # texels in a row
# A sphere's map may differ by this share from a similarity and still be round: rotations are rounded.
_ROUND = 1e-12


def store_glsl(sampler: str) -> list[str]:
    """Lines of GLSL for a texture that is read texel by texel; see `STORES_ARE_TEXELS`."""
    return [
        '#include "texels.glsl"',
        f"#ifdef {STORES_ARE_TEXELS}",
        f"TEXELS(rgba32f, {sampler});",
        f"vec4 fetch_{sampler}(ivec2 place) {{ return texel({sampler}, place); }}",
        "#else",
        f"uniform sampler2D {sampler};",
        f"vec4 fetch_{sampler}(ivec2 place) {{ return texelFetch({sampler}, place, 0); }}",
        "#endif",
    ]


def texel_store_glsl(sampler: str, layout: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Lines of GLSL for a texture with sections: constants, and the one way to fetch from each."""
    shift = STORE_WIDTH.bit_length() - 1
    lines = store_glsl(sampler)
    for section, texels in layout.items():
        lines.append(f"uniform int {section}_base;")
        for i, (name, what) in enumerate(texels.items()):
            lines.append(f"const int {section.upper()}_{name} = {i};  // {what}")
        lines += [
            f"vec4 {section}_texel(int {section}_number, int what)",
            "{",
            f"    int i = {section}_base + {section}_number * {len(texels)} + what;",
            f"    return fetch_{sampler}(ivec2(i & {STORE_WIDTH - 1}, i >> {shift}));",
            "}",
        ]
    return lines


def texel_store(
    gl: moderngl.Context, sections: Mapping[str, Float64], layout: Mapping[str, Mapping[str, str]]
) -> tuple[moderngl.Texture, dict[str, object]]:
    """A texture of all sections' tables (n, texels, 4), and the uniforms that say where each begins."""
    bases: dict[str, object] = {}
    total = 0
    for name, table in sections.items():
        assert table.shape[1:] == (len(layout[name]), 4), f"{name}: a table of {table.shape}"
        bases[f"{name}_base"] = total
        total += len(table) * len(layout[name])
    store = np.zeros((max(1, -(-total // STORE_WIDTH)), STORE_WIDTH, 4), np.float32)
    flat, start = store.reshape(-1, 4), 0
    for table in sections.values():
        stop = start + table.shape[0] * table.shape[1]
        flat[start:stop] = table.reshape(-1, 4)
        start = stop
    return _texture(gl, store), bases


def objects_glsl() -> str:
    """The layout as GLSL."""
    lines = texel_store_glsl("objects", LAYOUT)
    lines += [*store_glsl("picture_texels"), f"const int PICTURE_WIDTH = {STORE_WIDTH};"]
    lines += [f"uniform int {name};" for name in ("first_ellipsoid", "first_triangle", "first_plane")]
    lines += ["uniform int primitive_count;", "uniform int light_count;"]
    lines += [f"const int LIGHT_{kind.upper()} = {i};" for i, kind in enumerate(LIGHT_KINDS)]
    return "\n".join(lines)


@dataclass(frozen=True)
class Numbering:
    """Which primitive of the scene has which number on the device.

    spheres         : (S,) int, of each number, the index into `Scene.spheres`: round ones first, then ellipsoids
    first_ellipsoid, first_triangle, first_plane, count : where the kinds begin, and the end
    shape           : (count,) int32, index into `Scene.shapes` of each number
    """

    spheres: NDArray[np.intp]
    first_ellipsoid: int
    first_triangle: int
    first_plane: int
    count: int
    shape: Int32

    @property
    def kinds(self) -> dict[str, range]:
        """The numbers of each kind."""
        ends = (0, self.first_ellipsoid, self.first_triangle, self.first_plane, self.count)
        names = ("sphere", "ellipsoid", "triangle", "plane")
        return {name: range(a, b) for name, a, b in zip(names, ends[:-1], ends[1:], strict=True)}


def number_primitives(scene: Scene) -> Numbering:
    """The numbers that `GpuObjects` gives: kind by kind, within a kind in the scene's order."""
    round_ = is_round(scene.spheres)
    order = np.concatenate([np.flatnonzero(round_), np.flatnonzero(~round_)])
    of_kind = {
        "sphere": np.zeros(len(scene.spheres), np.int32),
        "triangle": np.zeros(len(scene.triangles), np.int32),
    }
    of_kind["plane"] = np.zeros(len(scene.planes), np.int32)
    for number, shape in enumerate(scene.shapes):
        of_kind[shape.primitive][shape.first : shape.first + shape.count] = number
    shape_of = np.concatenate([of_kind["sphere"][order], of_kind["triangle"], of_kind["plane"]])
    first_triangle = len(scene.spheres)
    first_plane = first_triangle + len(scene.triangles)
    return Numbering(
        spheres=order,
        first_ellipsoid=int(round_.sum()),
        first_triangle=first_triangle,
        first_plane=first_plane,
        count=first_plane + len(scene.planes),
        shape=shape_of.astype(np.int32),
    )


def is_round(spheres: Float64) -> NDArray[np.bool_]:
    """(S,) bool of (S, 3, 4) maps: those that keep the unit sphere a sphere."""
    linear = spheres[:, :, :3]
    gram = np.einsum("nij,nik->njk", linear, linear)
    square = np.trace(gram, axis1=1, axis2=2) / 3
    return np.asarray(np.abs(gram - square[:, None, None] * np.eye(3)).max(axis=(1, 2)) <= _ROUND * square)


class GpuObjects:
    """Primitives, materials, textures and lights of a scene on the device.

    numbering : which primitive has which number
    lights    : those with a position first, then the directional ones
    textures  : for a `Pass`, by the names in GLSL
    uniforms  : where the sections begin, and how many there are of what
    generated, defines : for `load_program`; kinds that the scene lacks are left out of the programs
    lower, upper : (count, 3) float64, boxes around the primitives; infinite for planes
    centre, radius : a sphere around all that is finite, scene units

    Raises SceneError for what the device cannot hold.
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self.gl = gl
        self.scene = scene
        self.numbering = numbers = number_primitives(scene)
        self.count = numbers.count
        self.lights = lights = tuple(sorted(scene.lights, key=lambda light: light.kind == "directional"))
        self.generated = {"OBJECTS": objects_glsl()}
        self.defines: dict[str, object] = {
            f"HAS_{kind.upper()}S": 1 for kind, of in numbers.kinds.items() if len(of)
        }
        if scene.textures:
            self.defines["HAS_TEXTURES"] = 1
        if any(light.kind == "directional" for light in lights):
            self.defines["HAS_DIRECTIONAL_LIGHTS"] = 1
        self.lower, self.upper = primitive_boxes(scene, numbers)
        self.centre, self.radius = self._extent()

        pictures, first_rows = self._picture_store()
        sections = {
            "sphere": _spheres(scene, numbers),
            "unit": _units(scene, numbers),
            "ellipsoid": _ellipsoids(scene, numbers),
            "triangle": _padded(scene.triangles),
            "plane": _planes(scene),
            "surface": _surfaces(scene, numbers),
            "shape": _shapes(scene),
            "material": _materials(scene),
            "picture": _pictures(scene, first_rows),
            "light": _lights(lights),
        }
        texture, bases = self.store(sections, LAYOUT)
        self.textures = {"objects": texture, "picture_texels": _texture(gl, pictures)}
        self.uniforms: dict[str, object] = {
            "first_ellipsoid": numbers.first_ellipsoid,
            "first_triangle": numbers.first_triangle,
            "first_plane": numbers.first_plane,
            "primitive_count": numbers.count,
            "light_count": len(lights),
            **bases,
        }

    def store(
        self, sections: Mapping[str, Float64], layout: Mapping[str, Mapping[str, str]]
    ) -> tuple[moderngl.Texture, dict[str, object]]:
        """A texture of all sections' tables (n, texels, 4), and the uniforms that say where each begins."""
        self._check_size(sum(table.shape[0] * table.shape[1] for table in sections.values()))
        return texel_store(self.gl, sections, layout)

    @property
    def positional_lights(self) -> int:
        """How many lights have a position: numbers 0 to this."""
        return sum(light.kind != "directional" for light in self.lights)

    @cached_property
    def geometry_digest(self) -> str:
        """SHA-256 (hex) of what throws shadows: all primitives, and which shape each is of."""
        scene = self.scene
        h = hashlib.sha256()
        for array in (scene.spheres, scene.triangles, scene.planes):
            h.update(np.ascontiguousarray(array, "<f8").tobytes())
            h.update(str(array.shape).encode())
        h.update(self.numbering.shape.astype("<i4").tobytes())
        return h.hexdigest()

    def release(self) -> None:
        for texture in self.textures.values():
            texture.release()

    def _extent(self) -> tuple[Float64, float]:
        finite = np.isfinite(self.lower).all(axis=1)
        points = [self.lower[finite], self.upper[finite], self.scene.planes[:, :, 3]]
        points.append(
            np.array([light.position for light in self.lights if light.kind != "directional"]).reshape(-1, 3)
        )
        everything = np.concatenate(points)
        centre = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
        return centre, max(float(np.linalg.norm(everything - centre, axis=1).max()), 1e-30)

    def _picture_store(self) -> tuple[NDArray[np.float32], list[int]]:
        """All pictures as rows of texels, each beginning a row, and those first rows."""
        first_rows, rows = [], 0
        for texture in self.scene.textures:
            first_rows.append(rows)
            height, width = texture.image.shape[:2]
            rows += -(-height * width // STORE_WIDTH)
        limit = int(self.gl.info["GL_MAX_TEXTURE_SIZE"])
        if rows > limit:
            raise SceneError(
                f"{self.scene.source or self.scene.name}: textures of {rows * STORE_WIDTH:,} texels in all; this "
                f"device holds at most {limit * STORE_WIDTH:,}",
                "Make the pictures smaller.",
            )
        store = np.zeros((max(rows, 1), STORE_WIDTH, 4), np.float32)
        for texture, first in zip(self.scene.textures, first_rows, strict=True):
            texels = texture.image.reshape(-1, 3)
            store[first:].reshape(-1, 4)[: len(texels), :3] = texels
        return store, first_rows

    def _check_size(self, texels: int) -> None:
        limit = int(self.gl.info["GL_MAX_TEXTURE_SIZE"]) * STORE_WIDTH
        # A float holds a primitive's number + 1.
        if texels > limit or self.count >= 1 << 24:
            raise SceneError(
                f"{self.scene.source or self.scene.name}: {self.count:,} primitives; this device holds at most "
                f"{min((1 << 24) - 1, limit * self.count // max(texels, 1)):,} of them",
                "Simplify the meshes, or render on a device with a larger texture limit.",
            )


def primitive_boxes(scene: Scene, numbers: Numbering) -> tuple[Float64, Float64]:
    """(count, 3) lower and upper corners of the boxes around the primitives, infinite for planes."""
    spheres = scene.spheres[numbers.spheres]
    # The extent of an ellipsoid along an axis is the length of that row of its map.
    extent, centre = np.linalg.norm(spheres[:, :, :3], axis=2), spheres[:, :, 3]
    infinite = np.full((len(scene.planes), 3), np.inf)
    lower = np.concatenate([centre - extent, scene.triangles.min(axis=1, initial=np.inf), -infinite])
    upper = np.concatenate([centre + extent, scene.triangles.max(axis=1, initial=-np.inf), infinite])
    return lower, upper


def _texture(gl: moderngl.Context, texels: NDArray[np.float32]) -> moderngl.Texture:
    height, width, _ = texels.shape
    texture = gl.texture((width, height), 4, data=texels.tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def _padded(vectors: Float64) -> Float64:
    """(..., 4) from (..., 3)."""
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 1))], axis=-1)


def _spheres(scene: Scene, numbers: Numbering) -> Float64:
    maps = scene.spheres[numbers.spheres[: numbers.first_ellipsoid]]
    volume = np.linalg.det(maps[:, :, :3])
    return np.concatenate([maps[:, :, 3], np.cbrt(volume)[:, None]], axis=1)[:, None, :]


def _units(scene: Scene, numbers: Numbering) -> Float64:
    maps = scene.spheres[numbers.spheres]
    table = np.empty((len(maps), 3, 4))
    table[:, :, :3] = np.linalg.inv(maps[:, :, :3])
    table[:, :, 3] = maps[:, :, 3]
    return table


def _ellipsoids(scene: Scene, numbers: Numbering) -> Float64:
    maps = scene.spheres[numbers.spheres[numbers.first_ellipsoid :]]
    return np.concatenate([maps[:, :, :3].transpose(0, 2, 1), maps[:, :, 3:]], axis=2)


def _planes(scene: Scene) -> Float64:
    maps = scene.planes
    u, v = maps[:, :, 0], maps[:, :, 1]
    rows = [maps[:, :, 2], maps[:, :, 3]]
    rows += [w / np.sum(w * w, axis=1, keepdims=True) for w in (u, v)]
    return _padded(np.stack(rows, axis=1))


def _surfaces(scene: Scene, numbers: Numbering) -> Float64:
    table = np.zeros((numbers.count, 2, 4))
    if len(scene.triangle_uv):
        rows = table[numbers.first_triangle : numbers.first_plane]
        rows[:, 0] = scene.triangle_uv[:, :2].reshape(-1, 4)
        rows[:, 1, :2] = scene.triangle_uv[:, 2]
    material = np.array([shape.material for shape in scene.shapes], np.int64)
    table[:, 1, 2] = numbers.shape
    table[:, 1, 3] = material[numbers.shape]
    return table


def _shapes(scene: Scene) -> Float64:
    rows = [[[*shape.emission, shape.emission_two_sided]] for shape in scene.shapes]
    return np.array(rows, np.float64).reshape(-1, 1, 4)


def _materials(scene: Scene) -> Float64:
    rows = [
        [
            [*m.reflectance, m.two_sided],
            [*m.specular, m.exponent],
            [*m.mirror, -1 if m.texture is None else m.texture],
        ]
        for m in scene.materials
    ]
    return np.array(rows, np.float64).reshape(-1, 3, 4)


def _pictures(scene: Scene, first_rows: list[int]) -> Float64:
    rows = [
        [[first, t.image.shape[1], t.image.shape[0], t.filter == "linear"], [*t.scale, 0, 0]]
        for t, first in zip(scene.textures, first_rows, strict=True)
    ]
    return np.array(rows, np.float64).reshape(-1, 2, 4)


def _lights(lights: tuple[Light, ...]) -> Float64:
    rows = [
        [
            [*light.position, LIGHT_KINDS.index(light.kind)],
            [*light.intensity, light.falloff == "quadratic" and light.kind != "directional"],
            [*light.direction, 0],
            [*np.cos(np.radians(light.cone)), 0, 0],
        ]
        for light in lights
    ]
    return np.array(rows, np.float64).reshape(-1, 4, 4)
