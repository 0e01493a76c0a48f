"""Materials, colours and lights of trimesh objects. trimesh is not imported here, because the caller has done so.

Colours of materials, and vertex colours of a mesh with a material, are linear, as in glTF and MTL. Others are sRGB.
Missing fields of a `PBRMaterial` have the defaults of glTF, which are metallic and fully rough.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from glpath.errors import warn
from glpath.io import phong
from glpath.io.gltf.primitives import is_solid
from glpath.io.gltf.surfaces import Surface
from glpath.io.named_files import UnusableError
from glpath.io.pictures import pixels_of, unusable_if_damaged
from glpath.scene.model import Float64, Light, Material, Mesh, Texture, TextureSlot
from glpath.scene.source_location import SourceLocation
from glpath.system.colour import decode_srgb
from glpath.system.private_interfaces import given_trimesh_lights

_ALPHA: dict[str, Literal["opaque", "mask", "blend"]] = {"MASK": "mask", "BLEND": "blend"}
#: Default 8-bit colour of trimesh materials. A colour of this value counts as not stated.
_UNSAID = (102, 102, 102)


def coloured(mesh: Mesh, given: Any) -> Mesh:
    """Return `mesh` with the vertex or face colours of the trimesh mesh `given`; unchanged if `given` has none.

    mesh : mesh with the vertices and faces of `given`
    """
    kind = getattr(given.visual, "kind", None)
    if kind == "face" and len(given.visual.face_colors) == len(mesh.faces):
        apart = mesh.unshared()
        return replace(apart, colours=np.repeat(_rgba(given.visual.face_colors, srgb=True), 3, axis=0))
    colours: Any = given.visual.vertex_colors if kind == "vertex" else None
    if kind == "texture":
        colours = (getattr(given.visual, "vertex_attributes", None) or {}).get("color")
    if np.shape(colours) not in ((len(mesh.vertices), 3), (len(mesh.vertices), 4)):
        return mesh
    return replace(mesh, colours=_rgba(colours, srgb=kind == "vertex"))


def surface_of_colours(mesh: Mesh) -> tuple[Mesh, Surface]:
    """Return a mesh without a material, and a surface for its colours.

    If all colours are equal, the surface has the colour and the mesh loses its colours.
    """
    assert mesh.colours is not None
    first = mesh.colours[0]
    if np.all(mesh.colours == first):
        opacity = float(first[3])
        plain = Material("colour", first[:3].copy(), opacity=opacity, alpha="blend" if opacity < 1 else "opaque")
        return replace(mesh, colours=None), Surface(plain, np.zeros(3))
    alpha: Literal["blend", "opaque"] = "blend" if np.any(mesh.colours[:, 3] < 1) else "opaque"
    return mesh, Surface(Material("colours", np.ones(3), alpha=alpha), np.zeros(3))


def _rgba(colours: Any, *, srgb: bool) -> Float64:
    """Return (n, 4) linear Rec. 709 and alpha in [0, 1]. Integers are divided by the maximum of their type."""
    stored = np.asarray(colours)
    values = stored / np.iinfo(stored.dtype).max if stored.dtype.kind in "iu" else stored.astype(np.float64)
    values = phong.share(values)
    if srgb:
        values[:, :3] = decode_srgb(values[:, :3])
    return values if values.shape[1] == 4 else np.column_stack([values, np.ones(len(values))])


@dataclass
class TrimeshMaterials:
    """Surfaces and textures made from the materials of trimesh meshes, each only once."""

    textures: list[Texture] = field(default_factory=list)
    _surfaces: dict[tuple[int, bool, bool, bool], Surface] = field(default_factory=dict)
    _slots: dict[tuple[int, bool], TextureSlot | None] = field(default_factory=dict)
    _alive: list[Any] = field(default_factory=list)  # keeps objects alive, so that their ids stay unique

    def of(self, given: Any, mesh: Mesh, location: SourceLocation) -> tuple[Mesh, Surface | None]:
        """Return `mesh` with the colours of `given`, and its surface; None if there is neither material nor colour.

        given    : trimesh mesh from which `mesh` was made
        location : location of `given`, for errors

        Raises SceneError for a mesh with several materials, and for textures that are no Pillow images. Warns of
        pictures that cannot be read; the surface is then without them.
        """
        mesh = coloured(mesh, given)
        material = getattr(given.visual, "material", None) if given.visual.kind == "texture" else None
        if material is None:
            return (mesh, None) if mesh.colours is None else surface_of_colours(mesh)
        if hasattr(material, "materials"):
            raise location.error(
                f"has {len(material.materials)} materials, but a mesh has one.",
                "Load it with merge_primitives=False, or make a mesh for each material.",
            )
        is_pbr = hasattr(material, "baseColorFactor")
        closed = is_pbr and not material.doubleSided and is_solid(mesh)
        key = (id(material), mesh.uv is not None, mesh.colours is not None, closed)
        if key not in self._surfaces:
            self._alive.append(material)
            if is_pbr:
                surface = self._metallic_roughness(material, closed, location)
            else:
                surface = self._phong(material, mesh.colours is not None, location)
            if mesh.uv is None:
                plain = replace(surface.material, **dict.fromkeys(surface.material.slots))  # type: ignore[arg-type]
                surface = replace(surface, material=plain)
            self._surfaces[key] = surface
        return mesh, self._surfaces[key]

    def _metallic_roughness(self, given: Any, closed: bool, location: SourceLocation) -> Surface:
        """Return the surface of a `PBRMaterial`.

        closed : True if a one-sided mesh hides its backs. They are visible through its transparent parts only, and
                 are then lit, as in glTF files; those of other one-sided meshes are absent.
        """
        base = np.ones(4) if given.baseColorFactor is None else np.ravel(_rgba([given.baseColorFactor], srgb=False))
        emission = np.zeros(3) if given.emissiveFactor is None else np.maximum(given.emissiveFactor, 0.0)
        alpha = _ALPHA.get(str(given.alphaMode), "opaque")
        two_sided = bool(given.doubleSided) or (closed and alpha != "opaque")
        material = Material(
            str(given.name),
            base[:3],
            two_sided=two_sided,
            culled=not (two_sided or closed),
            texture=self._slot(given.baseColorTexture, location, srgb=True),
            roughness=_share(given.roughnessFactor),
            metallic=_share(given.metallicFactor),
            opacity=1.0 if alpha == "opaque" else float(base[3]),
            alpha=alpha,
            cutoff=0.5 if given.alphaCutoff is None else float(given.alphaCutoff),
            surface_texture=self._slot(given.metallicRoughnessTexture, location, srgb=False),
            normal_texture=self._slot(given.normalTexture, location, srgb=False),
            emission_texture=self._slot(given.emissiveTexture, location, srgb=True) if emission.any() else None,
        )
        return Surface(material, np.asarray(emission, np.float64)[:3])

    def _phong(self, given: Any, with_colours: bool, location: SourceLocation) -> Surface:
        """Return the surface of a `SimpleMaterial`, or of another trimesh material from its main colour."""
        texture = self._slot(getattr(given, "image", None), location, srgb=True)
        diffuse = getattr(given, "diffuse", given.main_color)
        opacity = float(diffuse[3] / 255)
        base = _stated(given, "kd", diffuse)
        if base is None:
            base = np.full(3, 1.0 if texture is not None or with_colours else 0.5)
        specular = _stated(given, "ks", getattr(given, "specular", _UNSAID))
        if specular is None:
            specular = np.zeros(3)
        material = Material(
            str(given.name),
            texture=texture,
            opacity=opacity,
            alpha="blend" if opacity < 1 else "opaque",
            **phong.layers(base, texture is not None, specular, getattr(given, "glossiness", 0.0)),
        )
        return Surface(material, np.zeros(3))

    def _slot(self, image: Any, location: SourceLocation, *, srgb: bool) -> TextureSlot | None:
        if image is None:
            return None
        key = (id(image), srgb)
        if key not in self._slots:
            import PIL.Image

            if not isinstance(image, PIL.Image.Image):
                raise location.error(f"has a texture of type {type(image).__name__}, but must have a PIL.Image.")
            self._alive.append(image)
            self._slots[key] = None
            number = len(self.textures)
            try:
                with unusable_if_damaged():
                    pixels = pixels_of(image)
            except UnusableError as error:
                warn(f"{location}: not used: A texture, {error}.")
            else:
                self.textures.append(Texture(f"texture-{number}", pixels if srgb else pixels[..., :3], srgb=srgb))
                self._slots[key] = TextureSlot(number)
        return self._slots[key]


def _stated(given: Any, keyword: str, colour: Any) -> Float64 | None:
    """Return a colour of a material as (3,) linear Rec. 709; None if it is trimesh's default.

    keyword : MTL keyword, under which trimesh keeps the colour, too, if an MTL file states it
    """
    if tuple(colour[:3]) == _UNSAID and keyword not in getattr(given, "kwargs", {}):
        return None
    return phong.share(np.asarray(colour)[:3] / 255)


def _share(value: Any) -> float:
    """Return `value` clamped to [0, 1]; 1, the default of glTF, if it is None."""
    return 1.0 if value is None else float(phong.share(value))


def lights(scene: Any) -> tuple[list[Light], list[str]]:
    """Return the lights of a `trimesh.Scene`, in cd and lx as in glTF, and the names of lights that are not used.

    Lights shine along -z of their nodes.
    """
    found, others = [], []
    for given in given_trimesh_lights(scene) or ():
        kind = {"PointLight": "point", "SpotLight": "spot", "DirectionalLight": "directional"}.get(
            type(given).__name__
        )
        if kind is None or given.name not in scene.graph:
            others.append(f"{type(given).__name__} {given.name}")
            continue
        world = np.asarray(scene.graph[given.name][0], np.float64)
        cone = (30.0, 40.0)
        if kind == "spot":
            cone = tuple(float(np.degrees(angle)) for angle in (given.innerConeAngle, given.outerConeAngle))  # type: ignore[assignment]
        found.append(
            Light(
                str(given.name),
                kind,  # type: ignore[arg-type]
                given.intensity * np.asarray(given.color, np.float64)[:3] / 255,
                world[:3, 3],
                -world[:3, 2] / np.linalg.norm(world[:3, 2]),
                cone,
            )
        )
    return found, others
