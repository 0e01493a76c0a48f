"""A `Scene` on the device, for every engine: geometry, materials, textures and lights, in one layout.

`scene_texels` defines the texels and the numbering of primitives. Floats lie in one texture, integers in another,
in sections (`texel_store`).

Cost:     32 bytes a triangle and 16 a vertex; 16 more for texture coordinates and for smooth normals, if the scene
          has any. The path-buffer's engines need 12 a triangle more, as an index buffer. A sphere takes 64 to 112
          bytes, a texel of an environment map 16. Textures have 4 bytes a texel, or 16 if they hold floats; vertex
          colours take 16 bytes a vertex.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property, partial

import moderngl
import numpy as np

from glpath.errors import SceneError
from glpath.gl.geometry_stream import GeometryStream
from glpath.gl.instance_numbers import InstanceNumbers
from glpath.gl.material_texels import material_variants
from glpath.gl.memory import MODERNGL
from glpath.gl.moving import MovingScene
from glpath.gl.owner import Owner
from glpath.gl.passes import TriangleIndices
from glpath.gl.scene_texels import (
    FLOAT_LAYOUT,
    UINT_LAYOUT,
    facets,
    float_tables,
    number_primitives,
    primitive_boxes,
    scene_glsl,
    triangle_densities,
    uint_tables,
)
from glpath.gl.texel_store import FLOATS, UINTS, StoreRows, make_store
from glpath.gl.texture_images import TextureImages
from glpath.gl.variants import defined
from glpath.lights.lighting import Lighting, max_radiance
from glpath.lights.samples import profiled_lights
from glpath.scene.appearance import has_colours
from glpath.scene.instances import InstancedScene
from glpath.scene.model import Environment, Float64, Scene
from glpath.system.arguments import checked
from glpath.system.digest import digest_of

#: Maximum of a primitive's number + 1. Of 32 bits, the T-buffer uses two for the certainty of an entry.
MAX_PRIMITIVES = 2**30 - 2


class DeviceScene(Owner):
    """All data of a scene that shaders read.

    given     : the scene as given
    scene     : resident part of the scene: triangles and other primitives, without instances; at the middle of the
                shutter time if shapes move
    instances : instances of the scene; None if all geometry is in `scene`
    numbering : assignment of numbers to primitives
    count     : number of all primitives
    triangle_count : number of triangles; in a scene of triangles only, their numbers are the primitives' numbers
    stream    : stream of triangles, numbered after all other primitives; None if the scene streams none
    lighting  : sampling of all lights
    max_radiance : see `glpath.lights.lighting`
    lights    : punctual lights: first those with a position, then the directional ones
    textures  : textures for a `Pass`, by their names in GLSL
    uniforms  : first texels of the sections, and counts of primitives and lights
    generated, defines : inputs of `load_program`; programs leave out the kinds that the scene lacks
    centre, radius : a sphere around all triangles and spheres, scene units
    box       : (8, 3) corners of the bounding box, relative to the centre
    moving    : the moving shapes of a scene of triangles while the shutter is open; `scene` is then its state at
                the middle of that time, and `move_to` changes the state on the device. None if no shape moves

    Raises SceneError if the device cannot hold the scene.
    """

    @partial(checked, namespace=MODERNGL)
    def __init__(
        self,
        gl: moderngl.Context,
        scene: Scene | InstancedScene,
        geometry_budget: int | None = None,
        lighting: Lighting | None = None,
        deviations: Sequence[float] | None = None,
    ) -> None:
        """Put a scene on the device.

        geometry_budget : MiB for streamed triangles, for engines that support streaming
        lighting   : gives the emitting triangles their sampling densities; None: made from the scene
        deviations : deviation of each shape from the original, scene units, if the scene is simplified
        """
        self.gl = gl
        self.instances: InstanceNumbers | None = None
        if isinstance(scene, InstancedScene):
            self.instances = InstanceNumbers.of(scene)
            self.given, scene = scene.given, scene.resident
        else:
            self.given = scene
        self.moving: MovingScene | None = MovingScene(scene) if scene.moving_shapes else None
        self.scene = scene = self.moving.middle if self.moving else scene
        self.numbering = numbers = number_primitives(scene)
        self.count = numbers.count
        self.triangle_count = numbers.first_plane - numbers.first_triangle
        source = scene.source or scene.name
        streamed = scene.shapes.total("stream")
        assert not streamed or geometry_budget is not None, "streams for an engine that does not know them"
        numbered = self.count + streamed if self.instances is None else self.instances.end
        if numbered > MAX_PRIMITIVES:
            raise SceneError(
                f"{source}: {numbered:,} primitives; a buffer's entries tell {MAX_PRIMITIVES:,} apart.",
                "Simplify the meshes.",
            )
        self.lighting = lighting or Lighting.of(scene)
        self.max_radiance = max_radiance(scene)
        self.lights = lights = tuple(sorted(scene.lights, key=lambda light: light.kind == "directional"))
        self.generated = {"SCENE": scene_glsl()}
        self.defines = defined(
            **{f"HAS_{kind.upper()}S": len(of) > 0 for kind, of in numbers.kinds.items()},
            **material_variants(scene.materials),
            HAS_ENVIRONMENT=isinstance(scene.sky, Environment),
            HAS_SUN=isinstance(scene.sky, Environment) and scene.sky.sun is not None,
            HAS_BACKGROUND=scene.background is not None,
            HAS_DIRECTIONAL_LIGHTS=any(light.kind == "directional" for light in lights),
            HAS_PROFILES=bool(profiled_lights(scene)),
            HAS_INSTANCES=self.instances is not None,
        )

        self.stream = (
            GeometryStream(gl, scene, self.count, geometry_budget)
            if streamed and geometry_budget is not None
            else None
        )
        images = TextureImages(gl, scene)
        self.defines |= images.defines
        densities = triangle_densities(scene, self.lighting)
        coloured = any(has_colours(shape) for shape in scene.shapes)
        smooth = bool(np.any(scene.shapes.vertex_normals))
        self.defines |= defined(
            HAS_VERTEX_COLOURS=coloured,
            HAS_UV=bool(np.any(scene.shapes.vertex_uv))
            or not {"HAS_TEXTURES", "HAS_ANISOTROPY"}.isdisjoint(self.defines),
            HAS_NORMALS=smooth,
            HAS_VERTEX_NORMALS=smooth,
            HAS_TRIANGLE_DENSITIES=len(densities) > 0,
            HAS_COLOURED_LIGHT=coloured
            and any(scene.materials[shape.material].unlit and shape.emits for shape in scene.shapes),
            HAS_ALPHA=any(scene.materials[shape.material].lets_light_through for shape in scene.shapes),
            HAS_CULLING=any(scene.materials[shape.material].culled for shape in scene.shapes),
        )
        floats, bases = make_store(
            gl,
            FLOATS,
            FLOAT_LAYOUT,
            float_tables(scene, numbers, images, self.lighting, lights, densities, self.defines, self.instances),
            source,
        )
        uints, uint_bases = make_store(
            gl, UINTS, UINT_LAYOUT, uint_tables(scene, numbers, images, lights, deviations, self.instances), source
        )
        self.textures = {"scene_floats": floats, "scene_uints": uints, "texture_bytes": images.bytes_on_device()}
        self.uniforms: dict[str, object] = {
            "first_ellipsoid": numbers.first_ellipsoid,
            "first_triangle": numbers.first_triangle,
            "first_plane": numbers.first_plane,
            "primitive_count": numbers.count,
            "first_instanced": self.triangle_count,
            "instance_shift": 0 if self.instances is None else self.instances.shift,
            "light_count": len(lights),
            "opacity_seed": 0,  # a render may set its own seed, and the number of its path set
            "opacity_set": 0,
            **bases,
            **uint_bases,
        }
        low, high = self.moving.bounds if self.moving else self.given.bounds
        self.centre = 0.5 * (low + high)
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, 8).T
        self.box = signs * (high - low)
        by_box = self.moving or self.instances
        self.radius = 0.5 * float(np.linalg.norm(high - low)) if by_box else _radius(scene, self.centre)
        if self.stream is not None:
            self.defines["STREAMED"] = 1
            self.uniforms |= {"first_streamed": self.count, "stream_count": len(scene.shapes.streams)}
            self.radius = max(self.radius, self.stream.radius_about(self.centre))

    def move_to(self, time: float) -> None:
        """Move the moving shapes on the device to their positions at a time in seconds."""
        moving, bases = self.moving, self.uniforms
        assert moving is not None, "nothing moves"
        sections = ("vertex_base", "shading_base", "facet_base")
        vertex, shading, facet = (int(bases[name]) for name in sections)  # type: ignore[call-overload]
        moving.move_to(time)
        pose, rows = moving.pose, self._float_rows
        rows.put(vertex + moving.vertices, pose.vertices.astype(np.float32))
        if "HAS_VERTEX_NORMALS" in self.defines:
            rows.put(shading + moving.vertices, pose.vertex_normals)
        rows.put(facet + moving.triangles, facets(pose.triangles))
        rows.write()

    @cached_property
    def _float_rows(self) -> StoreRows:
        return StoreRows(self.textures["scene_floats"], FLOATS)

    def look_as(self, other: DeviceScene) -> None:
        """Take the centre of another scene, and enlarge box and radius to contain both.

        Both scenes are then visible in one frame.
        """
        low, high = self.scene.bounds
        half = np.maximum(np.abs(np.stack([low, high]) - other.centre).max(axis=0), other.box.max(axis=0))
        self.centre = other.centre
        self.box = np.sign(other.box) * half
        self.radius = other.radius = max(other.radius, _radius(self.scene, other.centre))

    @property
    def positional_lights(self) -> int:
        """Number of punctual lights with a position; these come first in `lights`."""
        return sum(light.kind != "directional" for light in self.lights)

    @cached_property
    def triangles(self) -> TriangleIndices:
        """Index buffer for rasterisation; created at the first use, because the ray tracers need none."""
        return TriangleIndices(self.gl, self.scene.shapes.faces.astype(np.uint32))

    @cached_property
    def boxes(self) -> tuple[Float64, Float64]:
        """Lower and upper corners (count, 3) of the boxes around the primitives, infinite for planes."""
        return primitive_boxes(self.scene, self.numbering)

    @cached_property
    def geometry_digest(self) -> str:
        """SHA-256 (hex) of all occluders: the primitives, and the shape of each."""
        scene = self.scene
        h = hashlib.sha256()
        for array in (scene.spheres, scene.triangles, scene.planes):
            h.update(np.ascontiguousarray(array, "<f8").tobytes())
            h.update(str(array.shape).encode())
        h.update(self.numbering.shape.astype("<i4").tobytes())
        for shape, stream in scene.shapes.streams:
            h.update(f"{shape} {stream.digest}".encode())
        if "HAS_ALPHA" in self.defines:  # only then do textures change shadows
            h.update(digest_of(scene.shapes, scene.materials, scene.textures).encode())
        return h.hexdigest()

    @property
    def nbytes(self) -> int:
        """Bytes on the device, without the textures of materials."""
        stores = (self.textures["scene_floats"], self.textures["scene_uints"])
        rasterised = self.triangles.nbytes if "triangles" in self.__dict__ else 0
        streamed = self.stream.nbytes if self.stream is not None else 0
        return sum(16 * t.width * t.height for t in stores) + rasterised + streamed


def _radius(scene: Scene, centre: Float64) -> float:
    half = np.linalg.norm(scene.shapes.used_vertices - centre, axis=1).max(initial=0.0)
    if len(scene.spheres):
        extent = np.linalg.norm(scene.spheres[:, :, :3], axis=(1, 2))
        half = max(half, float((np.linalg.norm(scene.spheres[:, :, 3] - centre, axis=1) + extent).max()))
    return max(float(half), 1e-30)
