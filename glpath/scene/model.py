"""Scene as plain data: triangles, spheres, planes, materials, lights and a camera. No file format, no OpenGL.

Quads and boxes are already meshes here. Spheres and planes stay exact, for engines that intersect them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import NoneType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError, UsageError, encodable, warn
from glpath.scene.background import Background
from glpath.scene.camera import Camera, framing, may_be_framing, with_changes
from glpath.scene.camera_check import check_camera
from glpath.scene.geometry import Float64, Int32, Mesh, Primitive, Shape, Shapes, placed, sphere_extent
from glpath.scene.material import Material, Texture, TextureSlot, averaged, moved_textures
from glpath.scene.portal import MAX_PORTALS, Portal
from glpath.scene.profile import LightProfile
from glpath.scene.stream import Stream
from glpath.sky.sky import Environment, Sky
from glpath.sky.studio import ground_below, nearest_axis, studio
from glpath.system.arguments import check_word, checked, checked_fields, short_repr
from glpath.system.colour import check_exposure
from glpath.system.digest import digest_of
from glpath.system.time_limit import check_time
from glpath.system.units import UNITS, Unit
from glpath.system.vectors import LARGEST, vector

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

#: Function behind `Scene.add`: takes scene, shape, material and more fields of the shape's table; returns a scene.
ShapeBuilder = Callable[["Scene", object, "str | Mapping[str, object] | None", Mapping[str, object]], "Scene"]
LightKind = Literal["point", "spot", "directional"]
_CHUNK = 1 << 14
# Maximum rounding error of the length of a unit vector and of the dot product of perpendicular ones.
_ROUNDING = 1e-9
# Minimum sine of the angle between `direction` and `c0` of a light.
_PARALLEL = 1e-6
_WORDS = {"stream": "streamed triangle"}


@checked_fields
@dataclass(frozen=True)
class Light:
    """Punctual light. Shapes with an emission are lights too, but are not represented by this class.

    kind      : "point", "spot" (a point with a cone) or "directional" (infinitely far)
    intensity : (3,) float64, linear Rec. 709, in the unit of the scene. Point: intensity in W sr^-1 or cd. Spot:
                intensity along its axis. Directional, or falloff "none": irradiance in W m^-2 or lx on a surface
                that faces the light. Profile: factor of the profile's candela values, 1 in a photometric scene,
                1 / `glpath.system.units.EFFICACY` in a radiometric one
    position  : (3,) float64; without meaning for a directional light
    direction : (3,) float64, direction of light travel, normalized. For a point light with a profile, direction of
                gamma = 0; without meaning for a point light without a profile
    cone      : inner and outer half angle of a spot, degrees. Light is full within the inner angle, and fades to
                zero at the outer angle by `spot_fade`
    falloff   : "quadratic" (physical) or "none", as in ray tracers of the 1980s
    profile   : intensity of a point light in each direction; None: the same in all directions
    c0        : (3,) float64, direction of C = 0 and gamma = 90 degrees of the profile. It is made perpendicular to
                `direction`, and normalized
    maintenance_factor : maintenance factor that `intensity` already contains; None if the file gave none
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

    def __post_init__(self) -> None:
        where = f"light {short_repr(self.name)}: "
        for name, low in (("intensity", 0.0), ("position", -LARGEST), ("direction", -LARGEST), ("c0", -LARGEST)):
            object.__setattr__(self, name, vector(where + name, getattr(self, name), low))
        check_word(where + "kind", self.kind, get_args(LightKind))
        check_word(where + "falloff", self.falloff, ("quadratic", "none"))
        inner, outer = self.cone
        if not (0 <= inner <= outer <= 180 and outer > 0):
            raise SceneError(
                f"{where}cone: {short_repr(self.cone)}, but must be two angles up to 180 degrees, the inner one "
                "first, the outer one above 0."
            )
        if self.kind != "point" or self.profile is not None:
            direction = _normalized(where + "direction", self.direction)
            object.__setattr__(self, "direction", direction)
        if self.profile is not None:
            c0 = _normalized(where + "c0", self.c0)
            if abs(c0 @ direction) > _ROUNDING:
                c0 = c0 - (c0 @ direction) * direction
                if np.linalg.norm(c0) < _PARALLEL:
                    raise SceneError(
                        f"{where}c0: {short_repr(self.c0)}, but must not be along direction, which is "
                        f"{short_repr(self.direction)}."
                    )
            object.__setattr__(self, "c0", _normalized(where + "c0", c0))


def _normalized(name: str, given: Float64) -> Float64:
    """Return a vector with length 1; the same array if its length is 1 already. Raises SceneError for length 0."""
    length = float(np.linalg.norm(given))
    if not length > 0:
        raise SceneError(f"{name}: {short_repr(given)}, but must be a vector of any length but zero.")
    return given if abs(length - 1.0) <= _ROUNDING else given / length


@checked
@dataclass(frozen=True, repr=False)
class Scene:
    """Scene with everything that a renderer needs, as arrays.

    Jupyter shows a scene as a preview, made without OpenGL.

    shapes       : meshes, exact spheres and planes, and their positions
    lights       : punctual lights
    ambient      : (3,) float64 radiance that reaches every surface from all directions [TB IV]; in path tracing,
                   the radiance beyond a path's last vertex
    sky          : radiance of rays that hit nothing: a blend, an environment map, or None for black
    portals      : openings through which the sky lights an interior, so that fewer sky samples are blocked
    background   : background that the camera sees behind all shapes; None: the sky
    animation_times : first and last time, seconds, for which animations of glTF models were read; None if none runs
    exposure     : stops by which 8-bit images are brightened; None: result of `image.auto_exposure`
    centred_by   : (3,) float64 point that `centred` subtracted from all coordinates of this scene; None if the
                   coordinates are those of the file
    unit         : unit of all light in the scene, "radiometric" (W) or "photometric" (lm); `glpath.system.units`
                   describes both

    Raises UsageError for fields of a wrong type, and SceneError for numbers outside of their range and for a camera
    without a view.
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
    animation_times: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self._check_types()
        object.__setattr__(self, "shapes", Shapes.of(self.shapes))
        object.__setattr__(self, "ambient", vector("Scene.ambient", self.ambient, 0.0))
        if self.centred_by is not None:
            object.__setattr__(self, "centred_by", vector("Scene.centred_by", self.centred_by))
        for name in ("name", "source"):
            object.__setattr__(self, name, encodable(getattr(self, name)))
        if len(self.portals) > MAX_PORTALS:
            raise SceneError(
                f"{self.source or self.name}: {len(self.portals)} portals, but allowed are {MAX_PORTALS} at most.",
                "Give one rectangle around several openings that lie in a plane.",
            )
        check_camera(self.camera, self.source or self.name)
        self.shapes.check_maps()
        for shape in self.shapes:
            if not isinstance(shape.geometry, Mesh) or not shape.count:
                continue
            if not 0 <= shape.material < len(self.materials):
                raise SceneError(
                    f'{self.source or self.name}: the shape "{shape.name}" has the material {shape.material}, but '
                    f"the scene has {len(self.materials)} materials, counted from 0."
                )
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

    def _check_types(self) -> None:
        """Raise UsageError for fields of wrong types."""
        for name, kinds, allowed in _FIELDS:
            if not isinstance(getattr(self, name), kinds):
                raise UsageError(f"Scene.{name}: {short_repr(getattr(self, name))} where {allowed} is needed")
        check_exposure(None if self.exposure is None else float(self.exposure))
        check_word("Scene.unit", self.unit, UNITS)
        for name, kind in _ELEMENTS.items():
            values = getattr(self, name)
            # `Shapes` is passed on unchecked, because it may have a million elements.
            if isinstance(values, Shapes) or (isinstance(values, tuple | list) and _all_are(values, kind)):
                continue
            raise UsageError(f"Scene.{name}: {short_repr(values)} where a tuple of {kind.__name__} is needed")

    @property
    def triangles(self) -> Float64:
        """Corners (T, 3, 3) float64 of triangles in world space, counter-clockwise seen from the front. Read-only.

        They are computed from the meshes on first use. `shapes.vertices` and `shapes.faces` have the same triangles
        with shared vertices.
        """
        return self.shapes.triangles

    @property
    def triangle_uv(self) -> Float64:
        """Texture coordinates (T, 3, 2) float64 of the triangles' corners; zeros if a mesh has none."""
        return self.shapes.triangle_uv

    @property
    def spheres(self) -> Float64:
        """Affine maps world_from_unit (S, 3, 4) float64, each from the unit sphere to one of the scene's spheres.

        The last column is the centre.

        Any affine map is allowed, so a sphere may be an ellipsoid. The front is outside, or inside if the
        determinant is negative. u follows the longitude about the unit sphere's z axis; v goes from 0 at its south
        pole to 1 at its north pole.
        """
        return self.shapes.spheres

    @property
    def planes(self) -> Float64:
        """Affine maps world_from_plane (P, 3, 4) float64.

        The first two columns are perpendicular vectors of any length, along which u and v grow by one. The third is
        the unit normal on the front side, and the last is the point with u = v = 0.
        """
        return self.shapes.planes

    @property
    def triangle_shape(self) -> Int32:
        """Index (T,) int32 of each triangle's shape in `shapes`."""
        return self.shapes.primitive_shape("triangle")

    @property
    def normals(self) -> Float64:
        """Unit normals (T, 3) float64 of triangles, on the front side."""
        return unit_normals(self.triangles)

    @property
    def areas(self) -> Float64:
        """Areas (T,) float64 of triangles, scene units squared."""
        areas = np.empty(len(self.triangles))
        # Areas are computed in chunks, because intermediate results take as much memory as the triangles.
        for part in (slice(start, start + _CHUNK) for start in range(0, len(areas), _CHUNK)):
            check_time()
            areas[part] = triangle_areas(self.triangles[part])
        return areas

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """Lower corner (3,) and upper corner (3,) of the box around all spheres, triangles and streamed triangles.

        Planes are unbounded and do not count. If a scene has only planes, the box contains one point of each plane.
        """
        return self.shapes.bounds

    @property
    def framed_points(self) -> Float64:
        """Points (N, 3) that a camera for the whole scene must show, see `framing`.

        The points are the vertices of meshes and 26 points of each sphere. If the scene has streams, or nothing but
        planes, the corners of `bounds` are added.
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
        """Position (3,) float64 of this scene's origin in file coordinates; zeros unless `centred` made it."""
        return np.zeros(3) if self.centred_by is None else self.centred_by

    @cached_property
    def centred(self) -> Scene:
        """Scene with coordinates relative to a point near the scene's centre, for engines; see `origin`.

        Engines compute with 32-bit floats, which are too far apart at large coordinates. If the centre is within
        four diagonals of the scene's box from the origin, this is the scene itself. Computed on first use.
        """
        from glpath.scene.centre import centred

        return centred(self)

    def mean_reflectance(self, material: Material, clear: float = 0.0) -> Float64:
        """Return the (3,) float64 fraction of uniform illumination that a material reflects.

        Mirror reflection and light transmitted by glass are included. A texture contributes its mean.

        clear : fraction of the base whose transmitted light is not included
        """
        base = material.reflectance
        if material.texture is not None:
            base = base * self.textures[material.texture.texture].mean
        return averaged(material, self.textures).hemispherical_reflectance(base, clear)

    @cached_property
    def side_reflectance(self) -> Float64:
        """Reflectance (2, T, 3) float64 of each triangle's front and back. Read-only.

        The back of a one-sided triangle is black. Textures and vertex colours contribute their mean over the
        triangle, times its opacity. Reflected light therefore does not depend on the position within the triangle.
        Light transmitted by glass is not included.

        Computed on first use and shared by solver, guides and gathering, because it takes seconds for a textured
        room.
        """
        from glpath.scene.appearance import Appearance  # late, because it imports the image readers

        found = Appearance(self).side_reflectance()
        found.flags.writeable = False
        return found

    def __getstate__(self) -> dict[str, object]:
        return {each.name: getattr(self, each.name) for each in fields(self)}  # without cached, derived arrays

    def preview(self, longest: int = 320) -> NDArray[np.uint8]:
        """Return a quick (h, w, 3) uint8 sRGB image made on the CPU, without shadows, with the light at the eye.

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
        """Return Jupyter's view: a preview, and tables of limited length."""
        from glpath.scene.preview import mimebundle

        return mimebundle(self)

    def at(self, time: float | None = None) -> Scene:
        """Return the scene at `time`, without motion. Its shutter opens and closes at `time`.

        time : seconds; None: the time at which the shutter opens
        """
        moment = self.camera.shutter[0] if time is None else time
        opened, closed = self.camera.shutter
        if not opened <= moment <= closed:
            self._warn_of_animations(moment, moment)
        return replace(self.still(moment), camera=self.camera.at(moment))

    def still(self, time: float | None = None) -> Scene:
        """Return the scene with its shapes fixed at a time, and its camera unchanged.

        Returns the same scene if no shape moves.

        time : seconds; None: the time at which the shutter opens
        """
        if all(shape.motion is None for shape in self.shapes):
            return self
        moment = self.camera.shutter[0] if time is None else time
        return replace(self, shapes=Shapes(shape.at(moment) for shape in self.shapes))

    @property
    def moving_shapes(self) -> tuple[int, ...]:
        """Indices of shapes that move while the shutter is open."""
        return tuple(
            i for i, s in enumerate(self.shapes) if s.motion and s.motion.moves_within(*self.camera.shutter)
        )

    def _warn_of_animations(self, opened: float, closed: float) -> None:
        """Warn if animations of glTF models were not read for a time between `opened` and `closed`."""
        if self.animation_times is None:
            return
        first, last = self.animation_times
        if opened < first or closed > last:
            warn(
                f"{self.source or self.name}: animations of glTF models were read from {first:g} to {last:g} s. "
                f"They stand still before and after, but the shutter is now {opened:g} to {closed:g} s. Set it in "
                "the scene file, or by the parameters time and shutter of a glTF file."
            )

    def with_camera(self, camera: Camera | None = None, **changes: object) -> Scene:
        """Return the scene with another camera.

        camera  : new camera; None: the scene's own camera
        changes : new values of `Camera` fields by name. A new position, target or up removes the camera's motion,
                  because motion would override it. The other two are then those at which the shutter opens

        A camera that was created for a file without one shows the whole scene. If the resolution or `up` changes,
        that camera is fitted to the scene again. A studio light that substitutes for missing light is then rotated
        to the new `up`.

        Raises UsageError for unknown names, and if `camera` is not a `Camera`.
        """
        known = [field.name for field in fields(Camera)]
        for name in changes:
            if name not in known:
                raise UsageError(f"camera: no field is named {short_repr(name)}; allowed are {', '.join(known)}")
        seen = with_changes(camera or self.camera, changes)
        if "shutter" in changes or seen.shutter != (0.0, 0.0):
            self._warn_of_animations(*seen.shutter)
        scene = self
        may_frame = changes.keys() == {"resolution"} or ("up" in changes and np.any(seen.up))
        if camera is None and may_frame and _is_framed(self):
            if not changes.keys() & {"position", "target"}:
                check_camera(seen, self.source or self.name)  # because `framing` needs a valid resolution
                framed = framing(self.framed_points, seen.resolution, seen.up)
                seen = replace(seen, position=framed.position, target=framed.target)
            scene = _with_studio_turned(self, seen.up)
        return replace(scene, camera=seen)

    def add(self, shape: object, *, material: str | Mapping[str, object] | None = None, **fields: object) -> Scene:
        """Return a new scene with one more shape, the last one.

        shape    : table of the scene format's [[shapes]] as a dictionary, a `Mesh` or a `trimesh.Trimesh`
        material : name of one of the scene's materials, or a table for a new one; None: the mesh's own colour, or
                   grey
        fields   : further fields of the table, such as transform=[{"translate": [0, 1, 0]}] or name="lid"

        Raises SceneError, and UsageError for a material that the scene does not have.

        >>> from glpath import load_scene
        >>> ball = {"type": "sphere", "center": [0.3, -0.2, 0.4], "radius": 0.2}
        >>> load_scene("cornell-box-36").add(ball, material={"reflectance": [0.2, 0.4, 0.8]})
        <Scene cornell-box-36: 36 triangles, 1 sphere, 9 shapes, 4 materials, 1 light, 256 x 256>
        """
        if _shape_builder is None:
            raise UsageError("Scene.add: nothing is loaded that builds shapes.", "Import glpath.io first.")
        return _shape_builder(self, shape, material, fields)

    def digest(self, camera: bool = True) -> str:
        """Return the SHA-256 (hex) of everything that changes the image.

        It covers geometry, materials, textures, lights and camera, but not names. The digest is derived from the
        model's fields (`glpath.system.digest`). So a box has another digest than the same triangles written as a
        mesh.

        camera : False leaves out camera and background; the rest determines the light, independent of the view
        """
        if camera:
            return digest_of(self)
        without = copy(self)  # `replace` would refuse a scene without a camera
        vars(without).update(camera=None, background=None)
        return digest_of(without)


# Types of fields of a scene, and their descriptions.
_FIELDS: tuple[tuple[str, tuple[type, ...], str], ...] = (
    ("name", (str,), "text"),
    ("source", (str,), "text"),
    ("camera", (Camera,), "a Camera"),
    ("sky", (Sky, Environment, NoneType), "a Sky, an Environment or None"),
    ("background", (Background, NoneType), "a Background or None"),
    ("exposure", (int, float, np.floating, NoneType), "a number or None"),
)
# Type of the elements of each field of a scene that is a tuple.
_ELEMENTS: dict[str, type] = {
    "shapes": Shape,
    "materials": Material,
    "textures": Texture,
    "lights": Light,
    "portals": Portal,
}


def _all_are(values: Iterable[object], kind: type) -> bool:
    return all(isinstance(each, kind) for each in values)


def _is_framed(scene: Scene) -> bool:
    """Return True if the camera comes from `framing`, as for files without a camera."""
    camera = scene.camera
    if not may_be_framing(camera):
        return False
    framed = framing(scene.framed_points, camera.resolution, camera.up)
    return digest_of(camera) == digest_of(replace(framed, shutter=camera.shutter))


def _with_studio_turned(scene: Scene, up: Float64) -> Scene:
    """Return the scene with its substitute studio light, if it has one, rotated so that `up` is up."""
    if not (isinstance(scene.sky, Environment) and scene.sky.assumed):
        return scene
    axis, background = nearest_axis(up), scene.background
    if np.array_equal(axis, scene.sky.up):
        return scene
    if background is not None:
        ground = None if background.ground is None else ground_below(*scene.bounds, axis)
        background = replace(background, ground=ground, up=axis)
    return replace(scene, sky=studio((axis[0], axis[1], axis[2])), background=background)


# (26, 3) unit directions from the centre of a cube to its faces, edges and corners.
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], np.float64) - 1.0
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)
_shape_builder: ShapeBuilder | None = None


def shapes_are_built_by(builder: ShapeBuilder) -> None:
    """Register the function that `Scene.add` calls. Readers know the formats of shapes; the model does not."""
    global _shape_builder
    _shape_builder = builder


def unit_normals(triangles: Float64) -> Float64:
    """Return (T, 3) float64 unit normals on the front sides of triangles (T, 3, 3)."""
    n = _area_vectors(triangles)
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny))


def triangle_areas(triangles: Float64) -> Float64:
    """Return (T,) float64 areas of triangles (T, 3, 3)."""
    return np.asarray(np.linalg.norm(_area_vectors(triangles), axis=1))


def _area_vectors(triangles: Float64) -> Float64:
    """Return (T, 3) float64 normals on the front sides; the length of each is the area of its triangle."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(0.5 * np.cross(edges[:, 0], edges[:, 1]))
