"""A `Scene` as texels: numpy tables of the data that shaders read; `device_scene` puts them on the device.

The layout of both stores is declared only here and handed to GLSL as text (`#include <SCENE>`).
`shaders/scene/surface.glsl` and its neighbours use it. Triangles are three indices into a pool of vertices.

Primitives are numbered 0, 1, 2, ... in the order of their kinds: round spheres, ellipsoids, triangles, planes. Each
kind is then a range, and a loop over a kind fetches only the data of that kind. Engines that support only triangles
get a scene of triangles (`path_traceable`); their primitives' numbers are the triangles' numbers.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.gl.geometry_stream import facet_planes
from glpath.gl.instance_numbers import InstanceNumbers
from glpath.gl.material_texels import (
    MATERIAL_LAYOUT,
    albedo_cells,
    material_table,
    sheen_fits,
    sheen_glsl,
)
from glpath.gl.texel_store import FLOATS, UINTS, Rows, store_glsl
from glpath.gl.texture_images import ALPHAS, IMAGE_FLAGS, WRAPS, TextureImages
from glpath.lights.lighting import Lighting
from glpath.lights.samples import LIGHT_KINDS, indices_by_id, profiled_lights
from glpath.scene.directional_albedo import CELLS, escapes
from glpath.scene.model import Environment, Float64, Int32, Light, Scene, unit_normals

#: Contents of an entry's texels, in order, by section.
FLOAT_LAYOUT: dict[str, dict[str, str]] = {
    "vertex": {"POSITION": "world space"},
    "shading": {"NORMAL": "of a vertex, where the scene has smooth normals: unit, world space; 0 for none"},
    "uv": {"BOTH": "of a vertex, where the scene has texture coordinates: u, v; of the second set"},
    "colour": {"LINEAR": "of a vertex, where the scene has such: linear Rec. 709 and alpha"},
    "facet": {"PLANE": "of a triangle: unit normal out of the front, and its dot product with any of its points"},
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
    "plane": {
        "NORMAL": "unit, out of the front",
        "POINT": "where u = v = 0",
        "U": "its product with the vector from there is u",
        "V": "and this one's is v",
    },
    "emission": {"RADIANCE": "of a shape; the density per area of a light sample on it, 0 where none is drawn"},
    "emitter": {"DENSITIES": "the same of four triangles, where those of a shape differ"},
    "material": MATERIAL_LAYOUT,
    "albedo": {
        "CORNERS": "of a cell of a table of microfacets' albedo: this roughness and cosine, (this, next), (next, "
        "this), (next, next)"
    },
    "sheen_fit": {
        "LOW": "of steps of the fourth root of Charlie's alpha: as MATERIAL_SHEEN_ALBEDO0",
        "HIGH": "as MATERIAL_SHEEN_ALBEDO1",
    },
    "cover": {"OPACITY": "of a material: opacity; cutoff"},
    "slot_map": {
        "U": "of a texture slot: u is x u + y v + z of the texture coordinates; normal_scale",
        "V": "v is the same",
    },
    "image": {"COLOUR": "of the images of floats, row by row: linear Rec. 709 and alpha"},
    "light": {
        "POSITION": "of a punctual light, world space",
        "INTENSITY": "W sr^-1, or W m^-2 without falloff",
        "DIRECTION": "unit, in which the light goes",
        "CONE": "of a spot: cosines of the angles of full light and of its end",
    },
    "profile": {
        "AXIS": "of a light with a profile: towards gamma = 0; the first gamma, radians",
        "C0": "towards C = 0; cells of gamma a radian",
        "GRID": "its first cell; how many there are along gamma; along C",
    },
    "candela": {"CORNERS": "of a cell, W sr^-1: (C, gamma), (C, next), (next C, gamma), (next, next)"},
    "environment": {"RADIANCE": "of a texel of the environment map, row by row"},
    "instance": {
        "ROW0": "of an instance, after an identity: first row of world_from_mesh",
        "ROW1": "second row",
        "ROW2": "third row",
    },
}
UINT_LAYOUT: dict[str, dict[str, str]] = {
    "face": {"CORNERS": "of a triangle: numbers of its vertices; number of its shape"},
    "stream": {"FIRST": "of a shape that streams: number of its first triangle; number of the shape"},
    "solid": {"SHAPE": "of a sphere, ellipsoid or plane: number of its shape"},
    "shape": {
        "MATERIAL": "number of the material; 1 where both sides emit; 1 where light may pass through; how far a "
        "simpler shape deviates from the full one, scene units as the bits of a float"
    },
    "slots": {
        "FIRST": "of a material: 1 + number of its slot texture, surface_texture, normal_texture, emission_texture",
        "SECOND": "of transmission_texture; see ALPHA_OPAQUE ...; 1 where unlit; 1 where culled",
        "COAT": "of clearcoat_texture, clearcoat_roughness_texture, clearcoat_normal_texture, anisotropy_texture",
        "SPECULAR": "of specular_texture, specular_colour_texture, iridescence_texture and that of its thickness",
        "THROUGH": "of diffuse_transmission_texture, diffuse_transmission_colour_texture, sheen_texture, "
        "sheen_roughness_texture",
    },
    "slot": {"IMAGE": "its texture's first texel in the store of its kind; width; height; see IMAGE_FILTERED ..."},
    "instance_block": {
        "OF": "of a block of numbers of instances' triangles, after an entry for all others: 1 + number of the "
        "instance; 1 + number of its shape; what to subtract for the mesh's triangle"
    },
    "punctual": {"KIND": "of a light: see LIGHT_POINT ...; 1 for quadratic falloff; 1 + number of its profile"},
}
# Relative deviation of a sphere's transform from a similarity up to which the result counts as a round sphere. It
# is not 0, because rotations have rounding errors.
_ROUND = 1e-12


def scene_glsl() -> str:
    """Return the layout as GLSL, for `#include <SCENE>`."""
    lines = [store_glsl("scene_floats", FLOATS, FLOAT_LAYOUT), store_glsl("scene_uints", UINTS, UINT_LAYOUT)]
    lines += ["TEXELS(rgba8, texture_bytes);"]
    lines += [f"const uint IMAGE_{name} = {value}u;" for name, value in IMAGE_FLAGS.items()]
    lines += [f"const uint WRAP_{name.upper()} = {i}u;" for i, name in enumerate(WRAPS)]
    lines += [f"const uint ALPHA_{name.upper()} = {i}u;" for i, name in enumerate(ALPHAS)]
    lines += [f"uniform int {name};" for name in ("first_ellipsoid", "first_triangle", "first_plane")]
    lines += ["uniform int first_instanced;", "uniform int instance_shift;"]
    lines += ["uniform int primitive_count;", "uniform int light_count;"]
    # Primitives with a number of first_streamed or more are streamed triangles.
    lines += ["#ifdef STREAMED", "uniform int first_streamed;", "uniform int stream_count;", "#endif"]
    lines += [f"const uint LIGHT_{kind.upper()} = {i}u;" for i, kind in enumerate(LIGHT_KINDS)]
    lines += [f"const int ALBEDO_CELLS = {CELLS};", *sheen_glsl()]
    lines += [f"const float ESCAPES[5] = float[5]({', '.join(f'{c:.6f}' for c in escapes())});"]
    lines += ["vec3 vertex_position(uint number) { return vertex_texel(int(number), VERTEX_POSITION).xyz; }"]
    lines += [
        "int shape_of(int primitive)",
        "{",
        "#ifdef STREAMED",
        "    if (primitive >= first_streamed)",
        "    {",
        "        int which = 0;",
        "        for (int i = 1; i < stream_count; ++i)",
        "            if (int(stream_texel(i, STREAM_FIRST).x) <= primitive) which = i;",
        "        return int(stream_texel(which, STREAM_FIRST).y);",
        "    }",
        "#endif",
        "    if (primitive >= first_triangle && primitive < first_plane)",
        "        return int(face_texel(primitive - first_triangle, FACE_CORNERS).w);",
        "    int solid = primitive < first_triangle ? primitive : primitive - first_plane + first_triangle;",
        "    return int(solid_texel(solid, SOLID_SHAPE).x);",
        "}",
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Numbering:
    """Numbering of the scene's primitives on the device, kind by kind.

    spheres         : (S,) int, index into `Scene.spheres` for each number: round spheres first, then ellipsoids
    first_ellipsoid, first_triangle, first_plane, count : first number of each kind after round spheres, and the
                                                          count of all numbers
    shape           : (count,) int32, index into `Scene.shapes` for each number
    """

    spheres: NDArray[np.intp]
    first_ellipsoid: int
    first_triangle: int
    first_plane: int
    count: int
    shape: Int32

    @property
    def kinds(self) -> dict[str, range]:
        """Range of the primitive numbers of each kind."""
        ends = (0, self.first_ellipsoid, self.first_triangle, self.first_plane, self.count)
        names = ("sphere", "ellipsoid", "triangle", "plane")
        return {name: range(a, b) for name, a, b in zip(names, ends[:-1], ends[1:], strict=True)}


def number_primitives(scene: Scene) -> Numbering:
    """Number the primitives for `DeviceScene`: kind by kind, and within a kind in the scene's order."""
    round_ = is_round(scene.spheres)
    order = np.concatenate([np.flatnonzero(round_), np.flatnonzero(~round_)])
    spheres, triangles, planes = (scene.shapes.primitive_shape(kind) for kind in ("sphere", "triangle", "plane"))
    first_triangle = len(scene.spheres)
    first_plane = first_triangle + len(triangles)
    return Numbering(
        spheres=order,
        first_ellipsoid=int(round_.sum()),
        first_triangle=first_triangle,
        first_plane=first_plane,
        count=first_plane + len(scene.planes),
        shape=np.concatenate([spheres[order], triangles, planes]).astype(np.int32),
    )


def is_round(spheres: Float64) -> NDArray[np.bool_]:
    """Return (S,) bool for affine transforms (S, 3, 4): True if the transform keeps the unit sphere a sphere."""
    linear = spheres[:, :, :3]
    gram = np.einsum("nij,nik->njk", linear, linear)
    square = np.trace(gram, axis1=1, axis2=2) / 3
    return np.asarray(np.abs(gram - square[:, None, None] * np.eye(3)).max(axis=(1, 2)) <= _ROUND * square)


def primitive_boxes(scene: Scene, numbers: Numbering) -> tuple[Float64, Float64]:
    """Return (count, 3) lower and upper corners of the boxes around the primitives, infinite for planes."""
    spheres = scene.spheres[numbers.spheres]
    # The half extent of an ellipsoid along a world axis is the norm of that axis' row in its transform.
    extent, centre = np.linalg.norm(spheres[:, :, :3], axis=2), spheres[:, :, 3]
    infinite = np.full((len(scene.planes), 3), np.inf)
    lower = np.concatenate([centre - extent, scene.triangles.min(axis=1, initial=np.inf), -infinite])
    upper = np.concatenate([centre + extent, scene.triangles.max(axis=1, initial=-np.inf), infinite])
    return lower, upper


def float_tables(
    scene: Scene,
    numbers: Numbering,
    images: TextureImages,
    lighting: Lighting,
    lights: Sequence[Light],
    densities: Float64,
    has: Collection[str],
    instances: InstanceNumbers | None,
) -> dict[str, Rows]:
    """Return the sections of FLOAT_LAYOUT, each (n, texels, 4), for `make_store`.

    lighting  : lighting with the densities of emitting triangles
    lights    : punctual lights, in the order of `DeviceScene.lights`
    densities : result of `triangle_densities`
    has       : names that programs are compiled with: HAS_VERTEX_NORMALS, ...
    instances : instances whose resident part is `scene`; None if the scene has none
    """
    none, shapes = np.zeros((0, 4)), scene.shapes
    return {
        "vertex": _texel(shapes.vertices.astype(np.float32)),
        "shading": _texel(shapes.vertex_normals if "HAS_VERTEX_NORMALS" in has else none),
        "uv": _texel(_both_uv(scene) if "HAS_UV" in has else none),
        "colour": _texel(shapes.vertex_colours if "HAS_VERTEX_COLOURS" in has else none),
        "facet": _Facets(scene),
        "sphere": _spheres(scene, numbers),
        "unit": _units(scene, numbers),
        "ellipsoid": _ellipsoids(scene, numbers),
        "plane": _planes(scene),
        "emission": _emission(scene, lighting),
        "emitter": densities,
        "material": material_table(scene.materials),
        "albedo": albedo_cells(scene.materials),
        "sheen_fit": sheen_fits(scene.materials),
        "cover": _texel(np.array([(m.opacity, m.cutoff) for m in scene.materials]).reshape(-1, 2)),
        "slot_map": images.maps,
        "image": images.floats,
        "light": _lights(lights),
        **_profiles(scene),
        "environment": _environment(scene),
        "instance": np.zeros((0, 3, 4)) if instances is None else instances.maps(),
    }


def uint_tables(
    scene: Scene,
    numbers: Numbering,
    images: TextureImages,
    lights: Sequence[Light],
    deviations: Sequence[float] | None,
    instances: InstanceNumbers | None,
) -> dict[str, NDArray[Any]]:
    """Return the sections of UINT_LAYOUT, each (n, 1, 4) or (n, texels, 4), for `make_store`.

    lights     : punctual lights, in the order of `DeviceScene.lights`
    deviations : deviation of each shape from the original, scene units, if the scene is simplified
    instances  : instances whose resident part is `scene`; None if the scene has none
    """
    triangles = np.s_[numbers.first_triangle : numbers.first_plane]
    apart = np.array(deviations or np.zeros(len(scene.shapes)), np.float32).view(np.uint32)
    shapes = [
        (s.material, s.emission_two_sided, scene.materials[s.material].lets_light_through, int(deviation))
        for s, deviation in zip(scene.shapes, apart, strict=True)
    ]
    profiled = indices_by_id(profiled_lights(scene))
    punctual = [
        (
            LIGHT_KINDS.index(x.kind),
            x.falloff == "quadratic" and x.kind != "directional",
            1 + profiled.get(id(x), -1),
        )
        for x in lights
    ]
    return {
        "face": _texel(np.column_stack([scene.shapes.faces, numbers.shape[triangles]])),
        "stream": _texel(_streams(scene, numbers)),
        "solid": _texel(np.delete(numbers.shape, triangles)[:, None]),
        "shape": _texel(_integers(shapes, 4)),
        "slots": images.of_materials,
        "slot": images.slots,
        "instance_block": _texel(np.zeros((0, 3), np.int64) if instances is None else instances.block_table()),
        "punctual": _texel(_integers(punctual, 3)),
    }


def _texel(rows: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return texels (n, 1, 4) from rows (n, k), k <= 4."""
    table = np.zeros((len(rows), 1, 4), rows.dtype)
    table[:, 0, : rows.shape[1]] = rows
    return table


def _streams(scene: Scene, numbers: Numbering) -> NDArray[np.int64]:
    counts = np.array([stream.count for _, stream in scene.shapes.streams], np.int64)
    first = numbers.count + np.cumsum(counts) - counts
    return np.column_stack([first, [shape for shape, _ in scene.shapes.streams]]).astype(np.int64).reshape(-1, 2)


def _integers(rows: Sequence[tuple[int, ...]], columns: int) -> NDArray[np.int64]:
    return np.array(rows, np.int64).reshape(-1, columns)


def facets(triangles: Float64) -> Float64:
    """Return (T, 1, 4) planes of triangles (T, 3, 3)."""
    return facet_planes(triangles, unit_normals(triangles))[:, None, :]


class _Facets:
    """Facet planes of a scene, computed as they are written; all at once would take ten times their memory."""

    def __init__(self, scene: Scene) -> None:
        self._triangles = scene.triangles
        self.shape = (len(self._triangles), 1, 4)

    def __getitem__(self, which: slice) -> Float64:
        return facets(self._triangles[which])


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
    table = np.zeros((len(maps), 4, 4))
    table[:, :, :3] = np.stack(rows, axis=1)
    return table


def _emission(scene: Scene, lighting: Lighting) -> Float64:
    density = lighting.triangle_density
    rows = [
        [*shape.emission, density[part.start] if shape.primitive == "triangle" and shape.count else 0.0]
        for shape, part in zip(scene.shapes, scene.shapes.ranges, strict=True)
    ]
    return np.array(rows, np.float64).reshape(-1, 1, 4)


def triangle_densities(scene: Scene, lighting: Lighting) -> Float64:
    """Return (ceil(T / 4), 1, 4) light sample densities of all triangles; empty if each shape has one density."""
    density = lighting.triangle_density
    alike = all(
        shape.primitive != "triangle" or not shape.count or np.all(density[part] == density[part.start])
        for shape, part in zip(scene.shapes, scene.shapes.ranges, strict=True)
    )
    if alike:
        return np.zeros((0, 1, 4))
    table = np.zeros(-(-len(density) // 4) * 4)
    table[: len(density)] = density
    return table.reshape(-1, 1, 4)


def _both_uv(scene: Scene) -> Float64:
    return np.concatenate([scene.shapes.vertex_uv, scene.shapes.vertex_uv1], axis=1)


def _environment(scene: Scene) -> NDArray[np.float32]:
    sky = scene.sky
    if not isinstance(sky, Environment):
        return np.zeros((0, 1, 4), np.float32)
    table = np.zeros((sky.image.shape[0] * sky.image.shape[1], 1, 4), np.float32)
    np.multiply(sky.image.reshape(-1, 3), sky.scale, out=table[:, 0, :3], casting="same_kind")
    return table


def _profiles(scene: Scene) -> dict[str, Float64]:
    """Return the sections of the lights' profiles; lights with the same profile share its cells."""
    rows, cells, first = [], [np.zeros((0, 4))], 0
    starts: dict[int, int] = {}
    for light in profiled_lights(scene):
        profile = light.profile
        assert profile is not None, "profiled_lights has none without"
        if id(profile) not in starts:
            starts[id(profile)] = first
            cells.append(profile.cells())
            first += len(cells[-1])
        along, start = profile.candela.shape[1] - 1, np.radians(profile.gamma[0])
        rows.append(
            [
                [*light.direction, start],
                [*light.c0, 1.0 / np.radians(profile.step)],
                [starts[id(profile)], along, len(profile.candela), 0.0],
            ]
        )
    return {
        "profile": np.array(rows, np.float64).reshape(-1, 3, 4),
        "candela": np.concatenate(cells)[:, None, :],
    }


def _lights(lights: Sequence[Light]) -> Float64:
    rows = [
        [[*x.position, 0], [*x.intensity, 0], [*x.direction, 0], [*np.cos(np.radians(x.cone)), 0, 0]]
        for x in lights
    ]
    return np.array(rows, np.float64).reshape(-1, 4, 4)
