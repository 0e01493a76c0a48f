"""A scene as Mitsuba 3 knows it: plugins by name with their parameters, nested, before any file or any Mitsuba.

`described` makes the one translation that there is: `mitsuba_xml` writes it to files, tests and benches hand it to
Mitsuba in memory. Values are what Mitsuba's own dictionaries have (`mitsuba.load_dict`), but for:

    {"type": "mesh", "mesh": Mesh, ...}          triangles, v of texture coordinates downwards
    {"type": "bitmap", "image": (h, w, c) ...}   a texture, uint8 or float32; so has an "envmap" its image
    (4, 4) float64                               a transform

Depth:    Mitsuba counts the camera segment, PB does not: ours d is theirs d + 1. Russian roulette is on from
          Mitsuba's default vertex, as its users have it; at depth 3 there is none.
Pixels:   a box filter: one sample falls in exactly one pixel. `Camera.fov` is vertical: fov_axis "y".
Sides:    Mitsuba's surfaces are black from behind, as `Material.two_sided = False`, unless "twosided". Its area
          lights shine from the front alone; a two-sided one becomes two meshes a hundred-thousandth of the diagonal
          apart.
Poor at:  what has no counterpart, which `MitsubaScene.differences` lists. Smooth normals are handed on, but the
          light that they lose is not divided out, as it is here.
Source:   Jakob et al. 2022, Mitsuba 3 renderer, https://mitsuba-renderer.org
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from glpath.scene.export.geometry import (
    Notes,
    at_opening,
    face_normals,
    in_triangles,
    in_world,
    map_downwards,
    mirrors,
    v_downwards,
    with_all_normals,
)
from glpath.scene.geometry import Float64, Mesh, Shape
from glpath.scene.material import SMOOTH, Material, Texture, TextureSlot
from glpath.scene.model import Environment, Light, Scene, Sky

Sampler = Literal["independent", "multijitter"]
Plugin = dict[str, Any]

#: The two sides of a two-sided light stand apart by this share of the scene's diagonal, so that a ray from either
#: side meets the side that faces it first.
SIDE_OFFSET = 1e-5
# Rows of the environment map that a sky with a gradient becomes.
_SKY_ROWS = 1025
# Mitsuba's principled surface is as glTF's where its `specular` is this: an index of 1.5.
_SPECULAR = 0.5


@dataclass(frozen=True)
class MitsubaScene:
    """A scene for Mitsuba.

    plugins     : {"type": "scene", ...}, see the module
    differences : what it says otherwise than the scene, a sentence each, without a full stop
    """

    plugins: Plugin
    differences: tuple[str, ...]


def described(
    scene: Scene, max_depth: int, *, sampler: Sampler = "multijitter", spp: int = 64, instances: bool = True
) -> MitsubaScene:
    """The scene in Mitsuba's plugins, in triangles.

    instances : a mesh that stands in several places is kept once; False makes triangles of all, which take more
                memory and less time to trace

    Raises SceneError for what `path_traceable` refuses.
    """
    notes = Notes()
    scene = at_opening(scene, notes)
    low, high = scene.bounds  # of what is not endless
    scene = in_triangles(scene, notes)
    if np.any(scene.ambient > 0):
        notes.add("ambient light is left out")
    names = _Names()
    surfaces = _Surfaces(scene, notes, names)
    shapes: Plugin = {}
    for shape in scene.shapes:
        shapes |= _shapes(scene, shape, surfaces, names, instances, SIDE_OFFSET * float(np.linalg.norm(high - low)))
    emitters = {names.of(light.name): _emitter(light, 0.5 * (low + high), notes) for light in scene.lights}
    if scene.sky is not None:
        emitters[names.of("sky")] = _sky(scene.sky)
    plugins = {
        "type": "scene",
        "integrator": integrator(max_depth, surfaces.integrator),
        "sensor": _sensor(scene, float(np.linalg.norm(high - low)), sampler, spp, notes),
    }
    return MitsubaScene(plugins | surfaces.plugins | shapes | emitters, notes.texts)


class _Names:
    """Names that Mitsuba takes: no dots, none twice."""

    def __init__(self) -> None:
        self._used = {"type", "integrator", "sensor"}

    def of(self, text: str) -> str:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-") or "unnamed"
        name, number = plain, 1
        while name in self._used:
            number += 1
            name = f"{plain}-{number}"
        self._used.add(name)
        return name


def integrator(max_depth: int, plugin: str = "path") -> Plugin:
    """Of paths with so many vertices."""
    return {"type": plugin, "max_depth": max_depth + 1, "rr_depth": 5}


def rgb(values: Float64) -> Plugin:
    """A colour, linear Rec. 709."""
    return {"type": "rgb", "value": [float(v) for v in values]}


def _diffuse(reflectance: Plugin) -> Plugin:
    return {"type": "diffuse", "reflectance": reflectance}


@dataclass
class _Surfaces:
    """The materials that shapes use, each once. plugins: by name."""

    scene: Scene
    notes: Notes
    names: _Names
    plugins: Plugin = field(default_factory=dict)
    integrator: str = "path"
    _known: dict[tuple[int, bool, bool], str] = field(default_factory=dict)

    def reference(self, number: int, coloured: bool, side: bool | None = None) -> Plugin:
        """A reference to a material as a shape has it.

        coloured : by the shape's vertices
        side     : None: as the material says; else of one side alone, True that which reflects
        """
        material = self.scene.materials[number]
        if side is False:
            material = Material(f"{material.name}-back", np.zeros(3), two_sided=False)
            coloured = False
        two_sided = side is None and material.two_sided and material.transmission == 0
        key = (-1 if side is False else number, coloured, two_sided)
        if key not in self._known:
            name = self._known[key] = self.names.of(material.name)
            self.plugins[name] = _Surface(self, material, coloured).plugin(two_sided)
        return {"type": "ref", "id": self._known[key]}

    def medium(self, number: int) -> Plugin | None:
        """What is inside of a solid that takes from light; only volpath knows of it."""
        material = self.scene.materials[number]
        if material.thin or not np.any(material.attenuation > 0) or material.transmission == 0:
            return None
        self.integrator = "volpath"
        # As a colour it is at most one; and of what is quite clear in one channel volpath makes NaN.
        densest = float(material.attenuation.max())
        sigma_t = rgb(np.maximum(material.attenuation / densest, 1e-6))
        return {"type": "homogeneous", "albedo": 0.0, "sigma_t": sigma_t, "scale": densest}


@dataclass
class _Surface:
    """One material."""

    owner: _Surfaces
    material: Material
    coloured: bool

    def plugin(self, two_sided: bool) -> Plugin:
        material = self.material
        made = self._opaque(two_sided) if material.transmission == 0 else self._with_glass()
        opacity = self._opacity()
        return made if opacity is None else {"type": "mask", "opacity": opacity, "bsdf": made}

    def _note(self, text: str) -> None:
        self.owner.notes.add(text, "material", self.material.name)

    def _opaque(self, two_sided: bool) -> Plugin:
        """All but glass."""
        front = self._front()
        return {"type": "twosided", "bsdf": front} if two_sided else front

    def _front(self) -> Plugin:
        material = self.material
        if material.unlit:
            return _diffuse(rgb(np.zeros(3)))
        if material.roughness is None:
            made = self._without_microfacets()
        elif material.metallic == 0 and material.specular_weight == 0 and material.clearcoat == 0:
            made = _diffuse(self._colour())  # nothing reflects over the base
        else:
            made = self._microfacets(material.roughness)
        slot = material.normal_texture
        if slot is None:
            return made
        image = 2.0 * self._texture(slot).linear()[..., :3] - 1.0
        image = image * [material.normal_scale, material.normal_scale, 1.0]
        image /= np.maximum(np.linalg.norm(image, axis=2, keepdims=True), 1e-9)
        return {"type": "normalmap", "normalmap": self._bitmap(slot, 0.5 * image + 0.5, raw=True), "bsdf": made}

    def _without_microfacets(self) -> Plugin:
        material = self.material
        # Mitsuba blends where ours are added, so that each is divided by its share.
        lobes: list[tuple[float, Callable[[float], Plugin]]] = []
        lobes.append((float(material.reflectance.max()), lambda scale: _diffuse(self._colour(scale))))
        if np.any(material.mirror > 0):
            lobes.append((float(material.mirror.max()), lambda scale: _mirror(material.mirror * scale)))
        if np.any(material.specular > 0):
            self._note("Phong's highlight is a lobe of microfacets (GGX) of about the same width and albedo")
            albedo = 2.0 * material.specular / (material.exponent + 1.0)
            alpha = float(np.sqrt(2.0 / (material.exponent + 2.0)))
            lobes.append((float(albedo.max()), lambda scale: _mirror(albedo * scale, alpha)))
        total = sum(weight for weight, _ in lobes)
        if total > 1 + 1e-9:
            self._note(f"it sends back up to {total:.3g} of the light; Mitsuba does not allow that, and has 1")
        limited = min(total, 1.0)
        return _blend([(weight, lobe(limited / weight)) for weight, lobe in lobes if weight > 0])

    def _microfacets(self, roughness: float) -> Plugin:
        """GGX over a base: Mitsuba's principled surface, which has Schlick's Fresnel and independent masking, too.

        Its metal is the same. A dielectric over a diffuse base is another thing in every program.
        """
        material = self.material
        made: Plugin = {"type": "principled", "base_color": self._colour(), "specular": _SPECULAR}
        made["metallic"], made["roughness"] = material.metallic, roughness
        slot = material.surface_texture
        if slot is not None:
            image = self._texture(slot).linear()
            made["roughness"] = self._bitmap(slot, roughness * image[..., 1:2], raw=True)
            made["metallic"] = self._bitmap(slot, material.metallic * image[..., 2:3], raw=True)
        if material.metallic < 1 or slot is not None:
            self._note(
                "its base under microfacets is that of Mitsuba's principled surface, which loses nothing to what "
                "they reflect and is lighter at grazing angles than Lambert's: rooms are up to a fifth lighter"
            )
            reflected, _ = material.dielectric
            if reflected.mean() > 0.08:
                self._note(
                    f"of light from ahead it reflects 0.08, not {reflected.mean():.3g}, without becoming a metal"
                )
            made["specular"] = float(np.clip(reflected.mean() / 0.08, 0.0, 1.0))
        if material.anisotropy > 0:
            self._note("brushed metal is about as rough along the brush and across, at most ten to one")
            across = max(roughness**2, SMOOTH)
            along = across + (1.0 - across) * material.anisotropy**2
            made["anisotropic"] = float(min((1.0 - across / along) / 0.9, 1.0))
            made["roughness"] = float((along * across) ** 0.25)
            if material.anisotropy_angle % 180:
                self._note("the brush goes along u, whatever its angle")
        if material.clearcoat > 0:
            self._note(
                "the varnish is that of Mitsuba's principled surface, a quarter as strong and of another lobe"
            )
            made["clearcoat"] = material.clearcoat
            made["clearcoat_gloss"] = float(np.clip((0.1 - material.clearcoat_roughness**2) / 0.099, 0.0, 1.0))
        return made

    def _with_glass(self) -> Plugin:
        material = self.material
        glass = self._glass()
        share = (1.0 - material.metallic) * material.transmission
        slot = material.transmission_texture
        if slot is None and share == 1:
            return glass
        weight: float | Plugin = share
        if slot is not None:
            weight = self._bitmap(slot, share * self._texture(slot).linear()[..., :1], raw=True)
        self._note("glass and the rest of the surface are blended, reflections included")
        return {"type": "blendbsdf", "weight": weight, "a": self._opaque(material.two_sided), "b": glass}

    def _glass(self) -> Plugin:
        material = self.material
        alpha = (material.roughness or 0.0) ** 2
        made: Plugin = {"int_ior": material.ior, "ext_ior": 1.0, "specular_transmittance": self._colour()}
        if material.thin:
            # A pane of Mitsuba's reflects between its two sides, 2 F / (1 + F) in all, where ours reflects F once.
            reflected, grazing = material.dielectric
            root = np.sqrt(reflected.mean() / (2.0 - reflected.mean()))
            made["int_ior"] = float((1.0 + root) / (1.0 - root))
            if grazing > 0 or alpha >= SMOOTH:
                self._note(
                    "its pane reflects as ours at normal incidence, with an index for that, and not as rough"
                )
            return {"type": "thindielectric", **made}
        if alpha < SMOOTH:
            return {"type": "dielectric", **made}
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, **made}

    def _opacity(self) -> float | Plugin | None:
        """None for what is opaque."""
        material, slot = self.material, self.material.texture
        if material.alpha == "opaque":
            return None
        if self.coloured:
            self._note("the alpha of vertices is left out")
        alpha = np.full((1, 1, 1), material.opacity)
        if slot is not None and (image := self._texture(slot).linear()).shape[2] == 4:
            alpha = material.opacity * image[..., 3:]
        if material.alpha == "mask":
            alpha = np.where(alpha >= material.cutoff, 1.0, 0.0)
        if slot is None or alpha.size == 1:
            return None if alpha.item() == 1 else float(alpha.item())
        return self._bitmap(slot, alpha, raw=True)

    def _colour(self, scale: float = 1.0) -> Plugin:
        """Reflectance times the texture, or the vertices' colours; times `scale`."""
        factor, slot = self.material.reflectance * scale, self.material.texture
        if slot is None:
            if self.coloured:  # the mesh has them with the reflectance
                return {"type": "mesh_attribute", "name": "vertex_color", "scale": scale}
            return rgb(factor)
        if self.coloured:
            self._note("the colours of vertices, which multiply its texture, are left out")
        texture = self._texture(slot)
        if texture.srgb and texture.image.dtype == np.uint8 and np.all(factor == 1):
            return self._bitmap(slot, texture.image[..., :3], raw=False)
        return self._bitmap(slot, texture.linear()[..., :3] * factor, raw=False)

    def _texture(self, slot: TextureSlot) -> Texture:
        return self.owner.scene.textures[slot.texture]

    def _bitmap(self, slot: TextureSlot, image: Any, *, raw: bool) -> Plugin:
        return bitmap(self._texture(slot), slot, image, raw=raw, note=self._note)


def bitmap(texture: Texture, slot: TextureSlot, image: Any, *, raw: bool, note: Callable[[str], None]) -> Plugin:
    """An image where a slot looks up that of `texture`. raw: it is no colour."""
    image = image if image.dtype == np.uint8 else np.asarray(image, np.float32)
    made: Plugin = {"type": "bitmap", "image": np.ascontiguousarray(image), "name": texture.name, "raw": raw}
    if texture.filter == "nearest":
        made["filter_type"] = "nearest"
    if texture.wrap[0] != texture.wrap[1]:
        note(f'the texture "{texture.name}" goes on along v as along u: {texture.wrap[0]}')
    if texture.wrap[0] != "repeat":
        made["wrap_mode"] = texture.wrap[0]
    matrix = map_downwards(slot.uv_transform, texture.scale)
    if not np.array_equal(matrix, np.eye(3)):
        made["to_uv"] = np.eye(4)
        made["to_uv"][:2, :2], made["to_uv"][:2, 3] = matrix[:2, :2], matrix[:2, 2]
    return made


def _mirror(reflectance: Float64, alpha: float = 0.0) -> Plugin:
    made: Plugin = {"type": "conductor", "material": "none", "specular_reflectance": rgb(reflectance)}
    return made if alpha == 0 else made | {"type": "roughconductor", "distribution": "ggx", "alpha": alpha}


def _blend(parts: Sequence[tuple[float, Plugin]]) -> Plugin:
    """By their weights; black without any."""
    if not parts:
        return _diffuse(rgb(np.zeros(3)))
    total, made = parts[0]
    for weight, plugin in parts[1:]:
        total += weight
        made = {"type": "blendbsdf", "weight": weight / total, "a": made, "b": plugin}
    return made


def _shapes(
    scene: Scene, shape: Shape, surfaces: _Surfaces, names: _Names, instances: bool, offset: float
) -> Plugin:
    assert isinstance(shape.geometry, Mesh)
    material = scene.materials[shape.material]
    coloured = shape.geometry.colours is not None
    if shape.emits and _opacity_everywhere(scene, shape) is None:
        surfaces.notes.add("it shines all over, whatever its alpha", "material", material.name)
    if shape.emits and shape.emission_two_sided:
        apart = in_world(shape).unshared()
        step = offset * np.repeat(face_normals(apart), 3, axis=0)
        front = replace(apart, vertices=apart.vertices + step)
        back = replace(apart, vertices=apart.vertices - step).turned()
        sides = (("front", front, True), ("back", back, material.two_sided))
        return {
            names.of(f"{shape.name}-{side}"): _mesh(
                scene, shape, mesh, surfaces, surfaces.reference(shape.material, coloured, reflects)
            )
            for side, mesh, reflects in sides
        }
    bsdf = surfaces.reference(shape.material, coloured)
    # Mitsuba's instances cannot shine.
    if not instances or shape.emits or len(shape.world_from_object) == 1:
        return {names.of(shape.name): _mesh(scene, shape, in_world(shape), surfaces, bsdf)}
    made: Plugin = {}
    for mirrored in (False, True):
        maps = [m for m in shape.world_from_object if mirrors(m) == mirrored]
        if not maps:
            continue
        mesh = shape.geometry.turned() if mirrored else shape.geometry
        group = names.of(f"{shape.name}-group")
        made[group] = {"type": "shapegroup", "shape": _mesh(scene, shape, mesh, surfaces, bsdf)}
        for m in maps:
            to_world = np.concatenate([m, [[0.0, 0.0, 0.0, 1.0]]])
            reference = {"type": "ref", "id": group}
            made[names.of(shape.name)] = {"type": "instance", "shapegroup": reference, "to_world": to_world}
    return made


def _mesh(scene: Scene, shape: Shape, mesh: Mesh, surfaces: _Surfaces, bsdf: Plugin) -> Plugin:
    material = scene.materials[shape.material]
    mesh = with_all_normals(mesh)
    slots = material.slots
    second = {slot.uv_set for slot in slots.values()}
    if second == {1}:
        mesh = replace(mesh, uv=mesh.uv1)
    elif 1 in second:
        surfaces.notes.add("all its textures have the first texture coordinates", "material", material.name)
    if mesh.uv is not None:
        mesh = replace(mesh, uv=v_downwards(mesh.uv) if material.needs_uv else None)
    if mesh.colours is not None:
        mesh = replace(mesh, colours=mesh.colours * [*material.reflectance, 1.0])
    made: Plugin = {"type": "mesh", "name": shape.name, "mesh": mesh, "bsdf": bsdf}
    if mesh.normals is None:
        made["face_normals"] = True
    interior = surfaces.medium(shape.material)
    if interior is not None:
        made["interior"] = interior
    if shape.emits:
        made["emitter"] = {"type": "area", "radiance": _radiance(scene, shape, surfaces.notes)}
    return made


def _radiance(scene: Scene, shape: Shape, notes: Notes) -> Plugin:
    slot = scene.materials[shape.material].emission_texture
    opacity = _opacity_everywhere(scene, shape)
    # Of what a mask lets through, Mitsuba takes the light all the same.
    emission = shape.emission if opacity is None else shape.emission * opacity
    if slot is None:
        return rgb(emission)
    texture = scene.textures[slot.texture]
    return bitmap(texture, slot, texture.linear()[..., :3] * emission, raw=False, note=notes.add)


def _opacity_everywhere(scene: Scene, shape: Shape) -> float | None:
    """The opacity that a shape has all over; None where it differs from place to place."""
    material = scene.materials[shape.material]
    if material.alpha == "opaque":
        return 1.0
    slot = material.texture
    assert isinstance(shape.geometry, Mesh)
    colours = shape.geometry.colours
    if slot is not None and scene.textures[slot.texture].linear().shape[2] == 4:
        return None
    if colours is not None and np.any(colours[:, 3] != 1):
        return None
    return float(material.opacity >= material.cutoff) if material.alpha == "mask" else material.opacity


def _emitter(light: Light, middle: Float64, notes: Notes) -> Plugin:
    if light.kind == "directional":
        return {"type": "directional", "direction": light.direction.tolist(), "irradiance": rgb(light.intensity)}
    intensity = light.intensity
    if light.falloff == "none":
        distance = float(np.linalg.norm(light.position - middle))
        notes.add(
            "it falls off with the square of the distance, and is as bright in the middle of the scene",
            "light",
            light.name,
        )
        intensity = intensity * distance**2
    if light.profile is not None:
        notes.add("its profile is left out: it sends its mean in all directions", "light", light.name)
        intensity = intensity * (light.profile.flux / (4 * np.pi))
    if light.kind == "point":
        return {"type": "point", "position": light.position.tolist(), "intensity": rgb(intensity)}
    full, end = light.cone
    if full < end:
        notes.add("between its two cones it fades with the angle, not smoothly", "light", light.name)
    if end >= 90:
        notes.add("its cone ends at 89 degrees", "light", light.name)
        end = 89.0
    made = {"type": "spot", "intensity": rgb(intensity), "cutoff_angle": end, "beam_width": min(full, end * 0.9999)}
    axis = light.direction
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across = across / np.linalg.norm(across)
    return made | {"to_world": _frame(across, np.cross(axis, across), axis, light.position)}


def _sky(sky: Sky | Environment) -> Plugin:
    if isinstance(sky, Environment):
        middle, left, up = sky.frame
        height, width = sky.image.shape[:2]
        return _envmap(sky, (left, up, middle), (2 * height + 1, width))
    if np.array_equal(sky.zenith, sky.horizon):
        return {"type": "constant", "radiance": rgb(sky.zenith)}
    across = np.cross(sky.up, np.eye(3)[np.argmin(np.abs(sky.up))])
    across = across / np.linalg.norm(across)
    return _envmap(sky, (across, sky.up, np.cross(across, sky.up)), (_SKY_ROWS, 4))


def _envmap(sky: Sky | Environment, axes: tuple[Float64, Float64, Float64], size: tuple[int, int]) -> Plugin:
    """The radiance in Mitsuba's directions: x, y up and z of `axes`.

    Its first row is exactly above and its last exactly below, while columns have their middles in directions: of a
    map of h rows, 2 h + 1 interpolate as its own do.
    """
    theta = np.linspace(0.0, np.pi, size[0])[:, None, None]
    phi = 2.0 * np.pi * (np.arange(size[1]) + 0.5)[:, None] / size[1]
    x, y, z = axes
    directions = np.sin(theta) * (np.sin(phi) * x - np.cos(phi) * z) + np.cos(theta) * y
    image = sky.radiance(directions).astype(np.float32)
    return {"type": "envmap", "image": image, "name": "sky", "to_world": _frame(x, y, z, np.zeros(3))}


def _frame(x: Float64, y: Float64, z: Float64, origin: Float64) -> Float64:
    """(4, 4): world from a frame of these axes."""
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, y, z, origin], axis=1)
    return matrix


def _sensor(scene: Scene, size: float, sampler: Sampler, spp: int, notes: Notes) -> Plugin:
    camera = scene.camera.at()
    low, high = scene.bounds
    far = float(np.linalg.norm(camera.position - 0.5 * (low + high)) + np.linalg.norm(high - low))
    width, height = camera.resolution
    right, up, forward = camera.frame()
    # Mitsuba's camera has its x to the left of the picture: row 0 is towards `up`, column 0 away from `right`.
    view: Plugin = {"type": "perspective", "fov_axis": "y", "fov": float(camera.fov)}
    scale = 1.0
    if camera.projection == "orthographic":
        view, scale = {"type": "orthographic"}, camera.extent[0]  # of an image that is 2 wide
    elif camera.projection == "panorama":
        notes.add("Mitsuba has no panorama: the camera is a perspective one of 90 degrees")
        view["fov"] = 90.0
    elif camera.aperture_radius > 0:
        view |= {
            "type": "thinlens",
            "aperture_radius": float(camera.aperture_radius),
            "focus_distance": camera.focus,
        }
    return view | {
        "near_clip": 1e-4 * size,
        "far_clip": far,
        "to_world": _frame(-scale * right, scale * up, forward, camera.position),
        "sampler": {"type": sampler, "sample_count": spp},
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
    }
