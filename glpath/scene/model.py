"""The scene as plain data: triangles, spheres, planes, materials, lights, a camera. No file format and no GL here.

Quads, boxes and meshes are triangles by the time they stand here; spheres and planes stay exact, for engines that
intersect them. Shapes keep their names and their range of primitives in `shapes`, so that messages and tables can
speak of them.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

Primitive = Literal["triangle", "sphere", "plane"]
LightKind = Literal["point", "spot", "directional"]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    position, target, up : (3,) float64, scene units; `up` need not be perpendicular to the view
    fov                  : vertical field of view of the whole image, degrees, 0 < fov < 180
    resolution           : (width, height) in pixels
    """

    position: Float64
    target: Float64
    up: Float64
    fov: float
    resolution: tuple[int, int]

    def frame(self) -> tuple[Float64, Float64, Float64]:
        """Unit vectors (right, up, forward), each (3,) float64. Row 0 of an image is towards `up`."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def rays(self) -> Float64:
        """(H, W, 3) float64 unit directions from `position` through the centres of all pixels, row 0 at the top."""
        width, height = self.resolution
        right, up, forward = self.frame()
        tangent = np.tan(np.radians(self.fov) / 2)
        x = (2 * np.arange(width) + 1 - width) / height * tangent
        y = (height - 1 - 2 * np.arange(height)) / height * tangent
        ways = forward + x[None, :, None] * right + y[:, None, None] * up
        return np.asarray(ways / np.linalg.norm(ways, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Texture:
    """A picture that colours surfaces, repeated endlessly. A checker is one of 2 x 2 texels, not filtered.

    image  : (h, w, 3) float32, linear Rec. 709, row 0 at the top, where v = 1
    scale  : repeats per unit of u and of v
    filter : "linear" or "nearest"
    """

    name: str
    image: NDArray[np.float32]
    scale: tuple[float, float] = (1.0, 1.0)
    filter: Literal["linear", "nearest"] = "linear"


@dataclass(frozen=True)
class Material:
    """Lambertian reflection, and with it what the ray tracer knows: Phong's highlight and a mirror [TB IV].

    reflectance : (3,) float64 in [0, 1], linear Rec. 709
    two_sided   : False makes the back black (it still blocks light)
    specular    : (3,) float64 >= 0, Phong's coefficient
    exponent    : Phong's, > 0
    mirror      : (3,) float64 in [0, 1], share of the light from the mirror direction
    texture     : index into `Scene.textures`, which the reflectance is multiplied by; None without
    """

    name: str
    reflectance: Float64
    two_sided: bool = True
    specular: Float64 = field(default_factory=lambda: np.zeros(3))
    exponent: float = 32.0
    mirror: Float64 = field(default_factory=lambda: np.zeros(3))
    texture: int | None = None

    @property
    def lambertian(self) -> bool:
        """Nothing but diffuse reflection of one colour, all that the path tracer knows."""
        return self.texture is None and not (np.any(self.specular > 0) or np.any(self.mirror > 0))


@dataclass(frozen=True)
class Light:
    """A light without extent. Shapes with an emission are lights too, but not here.

    kind      : "point", "spot" (a point with a cone) or "directional" (from infinitely far)
    intensity : (3,) float64, linear Rec. 709: radiant intensity W sr^-1 (a spot's on its axis), or, with
                falloff "none" and for a directional light, the irradiance W m^-2 on a surface that faces it
    position  : (3,) float64; of no meaning for a directional light
    direction : (3,) float64 unit, the way the light goes; of no meaning for a point light
    cone      : half angles in degrees, of full light and of its end; between them it fades smoothly
    falloff   : "quadratic" (physical) or "none", as in ray tracers of the 1980s
    """

    name: str
    kind: LightKind
    intensity: Float64
    position: Float64 = field(default_factory=lambda: np.zeros(3))
    direction: Float64 = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    cone: tuple[float, float] = (30.0, 40.0)
    falloff: Literal["quadratic", "none"] = "quadratic"


@dataclass(frozen=True)
class Sky:
    """What rays see that hit nothing: a blend from horizon (and below) to zenith by the sine of the elevation.

    zenith, horizon : (3,) float64 radiance, linear Rec. 709
    up              : (3,) float64 unit
    """

    zenith: Float64
    horizon: Float64
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))


@dataclass(frozen=True)
class Shape:
    """A named range of primitives with one material: an object, in the words of TB.

    kind               : of the scene file: quad, box, mesh (ranges of triangles), sphere or plane
    first, count       : range in `Scene.triangles`, `Scene.spheres` or `Scene.planes`, see `primitive`
    material           : index into `Scene.materials`
    emission           : (3,) float64 radiance W sr^-1 m^-2, linear Rec. 709; zeros for a shape that is not a light
    emission_two_sided : the light leaves both sides; otherwise only the side of the normal
    subdivisions       : of a sphere: how often its triangles are split where it has to be tessellated
    """

    name: str
    kind: str
    first: int
    count: int
    material: int
    emission: Float64 = field(default_factory=lambda: np.zeros(3))
    emission_two_sided: bool = False
    subdivisions: int = 4

    @property
    def primitive(self) -> Primitive:
        """What it consists of."""
        return self.kind if self.kind in ("sphere", "plane") else "triangle"  # type: ignore[return-value]

    @property
    def emits(self) -> bool:
        return bool(np.any(self.emission > 0))


@dataclass(frozen=True, repr=False)
class Scene:
    """Everything a renderer needs, as arrays. In Jupyter it shows a preview of itself, made without OpenGL.

    triangles    : (T, 3, 3) float64, corners in world space; counter-clockwise seen from the front
    shapes       : ranges that cover the triangles, the spheres and the planes, each in order and without gaps
    triangle_uv  : (T, 3, 2) float64 texture coordinates of the corners; (0, 3, 2) where no texture asks for them
    spheres      : (S, 3, 4) float64, world_from_unit of the unit sphere, last column the centre; any affine map,
                   so an ellipsoid as well. Its front is outside, or inside where the determinant is negative. u
                   runs with the longitude about the unit sphere's z axis, v from its south pole (0) to its north
                   (1)
    planes       : (P, 3, 4) float64, world_from_plane: columns are the directions in which u and v grow by one (any
                   length, perpendicular), the unit normal out of the front, and the point of u = v = 0
    lights       : without extent; the path tracer knows none of them
    ambient      : (3,) float64 radiance that reaches every surface from everywhere [TB IV]
    sky          : None: black
    """

    name: str
    camera: Camera
    triangles: Float64
    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    source: str = ""
    triangle_uv: Float64 = field(default_factory=lambda: np.zeros((0, 3, 2)))
    spheres: Float64 = field(default_factory=lambda: np.zeros((0, 3, 4)))
    planes: Float64 = field(default_factory=lambda: np.zeros((0, 3, 4)))
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    ambient: Float64 = field(default_factory=lambda: np.zeros(3))
    sky: Sky | None = None

    @property
    def triangle_shape(self) -> Int32:
        """(T,) int32, the index into `shapes` of each triangle."""
        return self.primitive_shape("triangle")

    def primitive_shape(self, primitive: Primitive) -> Int32:
        """(T,), (S,) or (P,) int32, the index into `shapes` of each triangle, sphere or plane."""
        counts = [s.count if s.primitive == primitive else 0 for s in self.shapes]
        return np.repeat(np.arange(len(self.shapes), dtype=np.int32), counts)

    @property
    def normals(self) -> Float64:
        """(T, 3) float64 unit normals, out of the front."""
        n = _area_vectors(self.triangles)
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny))

    @property
    def areas(self) -> Float64:
        """(T,) float64 triangle areas, scene units squared."""
        return np.asarray(np.linalg.norm(_area_vectors(self.triangles), axis=1))

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(3,) lower and (3,) upper corner of the box around all triangles and spheres.

        Planes are unbounded and do not count; of a scene of planes alone it is the box around their points.
        """
        reach, centre = sphere_extent(self.spheres), self.spheres[:, :, 3]
        points = np.concatenate([self.triangles.reshape(-1, 3), centre - reach, centre + reach])
        if not len(points):
            points = self.planes[:, :, 3]
        return points.min(axis=0), points.max(axis=0)

    def preview(self, longest: int = 320) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 sRGB, a quick picture made on the CPU: no shadows, the light is at the eye.

        longest : pixels of the longer side

        Cost: under a second for a few thousand primitives, some seconds for a million.
        """
        from glpath.scene.preview import preview  # which imports this module

        return preview(self, longest)

    def __repr__(self) -> str:
        parts = [
            f"{count:,} {word}{'s' * (count != 1)}"
            for count, word in (
                (len(self.triangles), "triangle"),
                (len(self.spheres), "sphere"),
                (len(self.planes), "plane"),
                (len(self.shapes), "shape"),
                (len(self.materials), "material"),
                (len(self.lights) + sum(shape.emits for shape in self.shapes), "light"),
            )
            if count
        ]
        return f"<Scene {self.name}: {', '.join(parts)}, {self.camera.resolution[0]} x {self.camera.resolution[1]}>"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """What Jupyter shows: a preview and tables, or what there is room for."""
        from glpath.scene.preview import mimebundle

        return mimebundle(self)

    def with_camera(self, **changes: object) -> Scene:
        """The same scene seen otherwise; keyword arguments are the fields of `Camera`."""
        return replace(self, camera=replace(self.camera, **changes))  # type: ignore[arg-type]

    def digest(self, camera: bool = True) -> str:
        """SHA-256 (hex) of all that changes the picture: geometry, materials, textures, lights and camera.

        Names do not, nor whether triangles were written as a box or as a mesh.

        camera : False leaves it out: what is left decides the light, wherever it is seen from
        """
        h = hashlib.sha256()

        def add(*values: ArrayLike) -> None:
            for value in values:
                array = np.asarray(value)
                array = array.astype("<i8") if array.dtype.kind in "bi" else array.astype("<f8", copy=False)
                h.update(f"{array.dtype}{array.shape}".encode())
                h.update(np.ascontiguousarray(array).data)

        if camera:
            c = self.camera
            add(c.position, c.target, c.up, c.fov, c.resolution)
        add(self.triangles, self.triangle_uv, self.spheres, self.planes)
        kinds = get_args(Primitive)
        add([[kinds.index(s.primitive), s.first, s.count, s.material, s.subdivisions] for s in self.shapes])
        add([s.emission for s in self.shapes], [s.emission_two_sided for s in self.shapes])
        for m in self.materials:
            add(
                m.reflectance, m.two_sided, m.specular, m.exponent, m.mirror, -1 if m.texture is None else m.texture
            )
        for t in self.textures:
            add(t.image, t.scale, t.filter == "nearest")
        for x in self.lights:
            add(
                get_args(LightKind).index(x.kind), x.intensity, x.position, x.direction, x.cone, x.falloff == "none"
            )
        add(self.ambient)
        if self.sky is not None:
            add(self.sky.zenith, self.sky.horizon, self.sky.up)
        return h.hexdigest()


def sphere_extent(spheres: Float64) -> Float64:
    """(S, 3) float64: how far spheres (S, 3, 4) reach from their centres along each axis.

    An ellipsoid reaches along an axis as far as that row of its map is long.
    """
    linear = spheres[:, :, :3]
    return np.asarray(np.sqrt(np.einsum("nij,nij->ni", linear, linear)))


def _area_vectors(triangles: Float64) -> Float64:
    """(T, 3) float64: along each front normal, as long as the triangle is large."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(0.5 * np.cross(edges[:, 0], edges[:, 1]))
