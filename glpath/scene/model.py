"""The scene as plain data: triangles, spheres, planes, materials, lights, a camera. No file format and no GL here.

Quads and boxes are meshes by the time they stand here; spheres and planes stay exact, for engines that intersect
them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError, UsageError
from glpath.film.units import Unit
from glpath.scene.background import Background
from glpath.scene.camera import Camera, framing, may_be_framing
from glpath.scene.digest import digest_of
from glpath.scene.geometry import Float64, Int32, Mesh, Primitive, Shape, Shapes, placed, sphere_extent
from glpath.scene.material import Material, Texture, TextureSlot, averaged, moved_textures
from glpath.scene.portal import MAX_PORTALS, Portal
from glpath.scene.profile import LightProfile
from glpath.scene.sky import Environment, Sky
from glpath.scene.stream import Stream
from glpath.scene.studio import ground_below, nearest_axis, studio
from glpath.system.terminal import encodable

__all__ = [
    "Camera",
    "Environment",
    "Float64",
    "Int32",
    "Light",
    "LightKind",
    "LightProfile",
    "Material",
    "Mesh",
    "Portal",
    "Primitive",
    "Scene",
    "Shape",
    "Shapes",
    "Sky",
    "Stream",
    "Texture",
    "TextureSlot",
    "moved_textures",
    "placed",
    "sphere_extent",
]

#: Of `Scene.add`: the scene, the shape, its material and more fields of its table, to a scene.
ShapeBuilder = Callable[["Scene", object, "str | Mapping[str, object] | None", Mapping[str, object]], "Scene"]
LightKind = Literal["point", "spot", "directional"]
_CHUNK = 1 << 14
_WORDS = {"stream": "streamed triangle"}


@dataclass(frozen=True)
class Light:
    """A punctual light. Shapes with an emission are lights too, but not here.

    kind      : "point", "spot" (a point with a cone) or "directional" (from infinitely far)
    intensity : (3,) float64, linear Rec. 709, in the unit of the scene: intensity W sr^-1 or cd (a spot's on its
                axis), or, with falloff "none" and for a directional light, the irradiance W m^-2 or lx on a surface
                that faces it. With a profile, what its candela are multiplied by: 1 in a photometric scene,
                1 / `glpath.film.units.EFFICACY` in a radiometric one
    position  : (3,) float64; of no meaning for a directional light
    direction : (3,) float64 unit, in which light travels; of a point light with a profile, where gamma is 0; of no
                meaning for one without
    cone      : half angles in degrees, of full light and of its end; between them it fades by `spot_fade`
    falloff   : "quadratic" (physical) or "none", as in ray tracers of the 1980s
    profile   : of a point light, how much it sends in which direction; None: in all alike
    c0        : (3,) float64 unit, perpendicular to `direction`: where C is 0 and gamma 90 degrees of the profile
    maintenance_factor : by which `intensity` is multiplied already; None where none was given
    """

    name: str
    kind: LightKind
    intensity: Float64
    position: Float64 = field(default_factory=lambda: np.zeros(3))
    direction: Float64 = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    cone: tuple[float, float] = (30.0, 40.0)
    falloff: Literal["quadratic", "none"] = "quadratic"
    profile: LightProfile | None = None
    c0: Float64 = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    maintenance_factor: float | None = None


@dataclass(frozen=True, repr=False)
class Scene:
    """Everything a renderer needs, as arrays. In Jupyter it shows a preview of itself, made without OpenGL.

    shapes       : meshes, exact spheres and planes, and where they stand
    lights       : punctual ones
    ambient      : (3,) float64 radiance that reaches every surface from everywhere [TB IV]; to path tracing,
                   what lies beyond a path's last vertex
    sky          : what rays see that hit nothing: a blend, an environment map, or None: black
    portals      : openings through which the sky lights what is inside, for fewer samples that see none of it
    background   : what the camera sees behind all shapes; None: the sky
    exposure     : stops by which 8-bit pictures are brightened; None: as `image.auto_exposure` finds
    centred_by   : (3,) float64, of a scene that was made by `centred`: see `origin`. None of one that may be far
                   from the origin
    unit         : of all its light: "radiometric" (W) or "photometric" (lm); see `glpath.film.units`
    """

    name: str
    camera: Camera
    shapes: Shapes
    materials: tuple[Material, ...]
    source: str = ""
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    ambient: Float64 = field(default_factory=lambda: np.zeros(3))
    sky: Sky | Environment | None = None
    exposure: float | None = None
    centred_by: Float64 | None = None
    unit: Unit = "radiometric"
    portals: tuple[Portal, ...] = ()
    background: Background | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", Shapes.of(self.shapes))
        for name in ("name", "source"):
            object.__setattr__(self, name, encodable(getattr(self, name)))
        if len(self.portals) > MAX_PORTALS:
            raise SceneError(
                f"{self.source or self.name}: {len(self.portals)} portals, but allowed are {MAX_PORTALS} at most.",
                "Give one rectangle around several openings that lie in a plane.",
            )
        for shape in self.shapes:
            if not isinstance(shape.geometry, Mesh) or not shape.count:
                continue
            material = self.materials[shape.material]
            for uv_set in {slot.uv_set for slot in material.slots.values()}:
                field_name = ("uv", "uv1")[uv_set]
                if getattr(shape.geometry, field_name) is None:
                    raise SceneError(
                        f'{self.source or self.name}: the shape "{shape.name}" has the material '
                        f'"{material.name}" with a texture, but its mesh has no texture coordinates '
                        f"`{field_name}`.",
                        f"Give the mesh `{field_name}`, one pair for each vertex, or the shape a material without "
                        "a texture.",
                    )

    @property
    def triangles(self) -> Float64:
        """(T, 3, 3) float64, corners in world space; counter-clockwise seen from the front. Not to be written to.

        Made from the meshes when first asked for; `shapes.vertices` and `shapes.faces` are the same, with shared
        vertices.
        """
        return self.shapes.triangles

    @property
    def triangle_uv(self) -> Float64:
        """(T, 3, 2) float64 texture coordinates of the corners; zeros where a mesh has none."""
        return self.shapes.triangle_uv

    @property
    def spheres(self) -> Float64:
        """(S, 3, 4) float64, world_from_unit of the unit sphere, last column the centre.

        Any affine map, so an ellipsoid as well. Its front is outside, or inside where the determinant is negative.
        u runs with the longitude about the unit sphere's z axis, v from its south pole (0) to its north (1).
        """
        return self.shapes.spheres

    @property
    def planes(self) -> Float64:
        """(P, 3, 4) float64, world_from_plane.

        Columns are the directions in which u and v grow by one (any length, perpendicular), the unit normal out of
        the front, and the point of u = v = 0.
        """
        return self.shapes.planes

    @property
    def triangle_shape(self) -> Int32:
        """(T,) int32, the index into `shapes` of each triangle."""
        return self.shapes.primitive_shape("triangle")

    @property
    def normals(self) -> Float64:
        """(T, 3) float64 unit normals, out of the front."""
        return unit_normals(self.triangles)

    @property
    def areas(self) -> Float64:
        """(T,) float64 triangle areas, scene units squared."""
        areas = np.empty(len(self.triangles))
        # Some at a time: intermediate results take as much memory as the triangles.
        for part in (slice(start, start + _CHUNK) for start in range(0, len(areas), _CHUNK)):
            areas[part] = triangle_areas(self.triangles[part])
        return areas

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(3,) lower and (3,) upper corner of the box around all triangles, streamed ones too, and spheres.

        Planes are unbounded and do not count; of a scene of planes alone it is the box around their points.
        """
        return self.shapes.bounds

    @property
    def framed_points(self) -> Float64:
        """(N, 3) what a camera that shows all of the scene has in its picture, see `framing`.

        The vertices of meshes, 26 points of each sphere, the corners of `bounds` of streams and of planes alone.
        """
        points = [
            self.shapes.used_vertices,
            (self.spheres[:, :, :3] @ _AROUND.T + self.spheres[:, :, 3:]).swapaxes(1, 2).reshape(-1, 3),
        ]
        if self.shapes.streams or not sum(map(len, points)):
            lower, upper = self.bounds
            points.append(np.where(_AROUND[np.abs(_AROUND).min(axis=1) > 0] > 0, upper, lower))
        return np.concatenate(points)

    @property
    def origin(self) -> Float64:
        """(3,) float64: what all coordinates are relative to, in those of the file; zeros but for `centred`."""
        return np.zeros(3) if self.centred_by is None else self.centred_by

    @cached_property
    def centred(self) -> Scene:
        """The scene relative to its `origin`, a whole number near its middle, as engines take it: in 32 bits, far
        from the world's origin, numbers are too far apart. Itself where its middle is near the origin: up to four
        diagonals of the box around its shapes. Found when first asked for.
        """
        from glpath.scene.centre import centred

        return centred(self)

    def mean_reflectance(self, material: Material, clear: float = 0.0) -> Float64:
        """(3,) float64: what one of the scene's materials reflects of light from everywhere, mirrors and glass too.

        Of a texture the mean; without the share of the base that is `clear`.
        """
        base = material.reflectance
        if material.texture is not None:
            base = base * self.textures[material.texture.texture].mean
        return averaged(material, self.textures).hemispherical_reflectance(base, clear)

    @cached_property
    def side_reflectance(self) -> Float64:
        """(2, T, 3) float64: the reflectance of each triangle's front and back; a one-sided one's back is black.

        Of textures and colours of vertices the mean over the triangle, times its opacity: light that a wall sends
        on does not know where on it a picture hangs. What glass lets through is none of it. Not to be written to.

        Found when first asked for, by solver, guides and gather alike: it takes seconds of a room with textures.
        """
        from glpath.scene.appearance import Appearance  # which brings what reads pictures

        found = Appearance(self).side_reflectance()
        found.flags.writeable = False
        return found

    def __getstate__(self) -> dict[str, object]:
        return {each.name: getattr(self, each.name) for each in fields(self)}  # without what was derived

    def preview(self, longest: int = 320) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 sRGB, a quick picture made on the CPU: no shadows, the light is at the eye.

        longest : pixels of the longer side

        Cost: under a second for a few thousand primitives, some seconds for a million.
        """
        from glpath.scene.preview import preview

        return preview(self, longest)

    def __repr__(self) -> str:
        parts = [
            f"{count:,} {word}{'s' * (count != 1)}"
            for count, word in (
                *((self.shapes.total(kind), _WORDS.get(kind, kind)) for kind in get_args(Primitive)),
                (len(self.shapes), "shape"),
                (len(self.materials), "material"),
                (len(self.lights) + sum(shape.emits for shape in self.shapes), "light"),
            )
            if count
        ]
        return f"<Scene {self.name}: {', '.join(parts)}, {self.camera.resolution[0]} x {self.camera.resolution[1]}>"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """Jupyter's view: a preview and tables, as far as there is room."""
        from glpath.scene.preview import mimebundle

        return mimebundle(self)

    def at(self, time: float | None = None) -> Scene:
        """The scene as it stands at a time, seconds: nothing moves, and the shutter is that moment.

        time : None: when the shutter opens
        """
        moment = self.camera.shutter[0] if time is None else time
        return replace(self.still(moment), camera=self.camera.at(moment))

    def still(self, time: float | None = None) -> Scene:
        """The scene with shapes that stand as they do at a time, and the camera as it is; itself where none moves.

        time : seconds; None: when the shutter opens
        """
        if all(shape.motion is None for shape in self.shapes):
            return self
        moment = self.camera.shutter[0] if time is None else time
        return replace(self, shapes=Shapes(shape.at(moment) for shape in self.shapes))

    @property
    def moving_shapes(self) -> tuple[int, ...]:
        """Indices of the shapes that move while the shutter is open."""
        return tuple(
            i for i, s in enumerate(self.shapes) if s.motion and s.motion.moves_within(*self.camera.shutter)
        )

    def with_camera(self, camera: Camera | None = None, **changes: object) -> Scene:
        """The same scene seen otherwise.

        camera  : instead of the scene's
        changes : of it, by the names of the fields of `Camera`; a new position, target or up ends its motion, which
                  would stand for them

        A camera that was set for a file without one, to see everything, sees everything at another resolution and
        with another up, too. A studio that stands in for light then turns with it.

        Raises UsageError for what is no camera, and for other names.
        """
        if not isinstance(camera, Camera | None):
            raise UsageError(
                f"camera: {type(camera).__name__} where a Camera is needed",
                "Make one, glpath.scene.Camera(...); or name what changes: with_camera(position=(0, 1, 5)).",
            )
        known = [field.name for field in fields(Camera)]
        for name in changes:
            if name not in known:
                raise UsageError(f"camera: no field is named {name!r}; allowed are {', '.join(known)}")
        if changes.keys() & {"position", "target", "up"}:
            changes = {"motion": ()} | changes
        seen: Camera = replace(camera or self.camera, **changes)  # type: ignore[arg-type]
        scene = self
        may_frame = changes.keys() == {"resolution"} or ("up" in changes and np.any(seen.up))
        if camera is None and may_frame and _is_framed(self):
            if not changes.keys() & {"position", "target"}:
                framed = framing(self.framed_points, seen.resolution, seen.up)
                seen = replace(seen, position=framed.position, target=framed.target)
            scene = _with_studio_turned(self, seen.up)
        return replace(scene, camera=seen)

    def add(self, shape: object, *, material: str | Mapping[str, object] | None = None, **fields: object) -> Scene:
        """A new scene with one shape more, the last one.

        shape    : a table of the scene format's [[shapes]] as a dictionary, a `Mesh` or a `trimesh.Trimesh`
        material : the name of one of the scene's materials, or a table for a new one; without it the mesh's own
                   colour, or grey
        fields   : more of the table, such as transform=[{"translate": [0, 1, 0]}] or name="lid"

        Raises SceneError, and UsageError for a material that the scene has not.

        >>> from glpath import load_scene
        >>> ball = {"type": "sphere", "center": [0.3, -0.2, 0.4], "radius": 0.2}
        >>> load_scene("cornell-box-36").add(ball, material={"reflectance": [0.2, 0.4, 0.8]})
        <Scene cornell-box-36: 36 triangles, 1 sphere, 9 shapes, 4 materials, 1 light, 256 x 256>
        """
        if _shape_builder is None:
            raise UsageError("Scene.add: nothing is loaded that builds shapes.", "Import glpath.io first.")
        return _shape_builder(self, shape, material, fields)

    def digest(self, camera: bool = True) -> str:
        """SHA-256 (hex) of all that changes the picture: geometry, materials, textures, lights and camera.

        Names do not. Derived from the fields of the model (`glpath.scene.digest`), so a box has another digest than
        the same triangles written as a mesh.

        camera : False leaves it out, and the background: what is left decides the light, wherever it is seen from
        """
        if camera:
            return digest_of(self)
        return digest_of(replace(self, camera=None, background=None))  # type: ignore[arg-type]


def _is_framed(scene: Scene) -> bool:
    """Return True if the camera is one of `framing`, as files without a camera get."""
    camera = scene.camera
    if not may_be_framing(camera):
        return False
    framed = framing(scene.framed_points, camera.resolution, camera.up)
    return digest_of(camera) == digest_of(replace(framed, shutter=camera.shutter))


def _with_studio_turned(scene: Scene, up: Float64) -> Scene:
    """The scene with the studio that stands in for its light, if there is one, turned so that `up` is up."""
    if not (isinstance(scene.sky, Environment) and scene.sky.assumed):
        return scene
    axis, background = nearest_axis(up), scene.background
    if np.array_equal(axis, scene.sky.up):
        return scene
    if background is not None:
        ground = None if background.ground is None else ground_below(*scene.bounds, axis)
        background = replace(background, ground=ground, up=axis)
    return replace(scene, sky=studio((axis[0], axis[1], axis[2])), background=background)


# (26, 3) unit directions: to the sides, edges and corners of a cube.
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], np.float64) - 1.0
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)
_shape_builder: ShapeBuilder | None = None


def shapes_are_built_by(builder: ShapeBuilder) -> None:
    """Hand in what `Scene.add` calls: readers know the formats of a shape, the model knows none."""
    global _shape_builder
    _shape_builder = builder


def unit_normals(triangles: Float64) -> Float64:
    """(T, 3) float64, out of the fronts of triangles (T, 3, 3)."""
    n = _area_vectors(triangles)
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny))


def triangle_areas(triangles: Float64) -> Float64:
    """(T,) float64, of triangles (T, 3, 3)."""
    return np.asarray(np.linalg.norm(_area_vectors(triangles), axis=1))


def _area_vectors(triangles: Float64) -> Float64:
    """(T, 3) float64: along each front normal, as long as the triangle is large."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(0.5 * np.cross(edges[:, 0], edges[:, 1]))
