"""Translation of a scene to nested plugins of Mitsuba 3 in memory. Mitsuba need not be installed.

`described` translates the scene; `mitsuba_surfaces` translates its materials. `mitsuba_xml` writes the result to
files; tests and benchmarks pass it to Mitsuba in memory. Values are those of Mitsuba's dictionaries
(`mitsuba.load_dict`), except:

    {"type": "mesh", "mesh": Mesh, ...}            triangles, with v of texture coordinates downwards
    {"type": "bitmap", "image": (h, w, c), ...}    texture, uint8 or float32; an "envmap" also has an "image"
    (4, 4) float64                                 transform

Depth:    Mitsuba counts the camera segment, the paper PB and glpath do not, so depth d here is d + 1 in Mitsuba.
          Russian roulette starts at Mitsuba's default vertex; at depth 3 there is none.
Pixels:   a box filter: one sample falls in exactly one pixel. `Camera.fov` is vertical: fov_axis "y".
Sides:    Mitsuba's surfaces are black from behind, like `Material.two_sided = False`, unless "twosided". Its area
          lights emit from the front only. A two-sided light becomes two meshes, each offset by a hundred-thousandth
          of the diagonal.
Units: light values are those of the scene, so that images are equal: W for a radiometric scene, cd and cd m^-2 for
       a photometric scene. Mitsuba's RGB modes have no unit.
Poor at:  features without a counterpart, which `MitsubaScene.differences` lists. Smooth normals are exported, but
          unlike glpath, Mitsuba does not compensate for the light that they lose.
Source:   Jakob et al. 2022, Mitsuba 3 renderer, https://mitsuba-renderer.org
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from glpath.io.export.geometry import (
    Notes,
    at_opening,
    face_normals,
    in_triangles,
    in_world,
    mirrors,
    near_plane,
    scene_size,
    uv_handedness,
    v_downwards,
    with_all_normals,
)
from glpath.io.export.mitsuba_surfaces import BsdfWriter, Names, Plugin, bitmap, rgb
from glpath.scene.geometry import Float64, Mesh, Shape
from glpath.scene.material import Material
from glpath.scene.model import Environment, Light, Scene, Sky
from glpath.scene.profile import LightProfile
from glpath.scene.source_location import shown
from glpath.sky.sun import Sun
from glpath.system.vectors import perpendicular

Sampler = Literal["independent", "multijitter"]

#: Offset of each side of a two-sided light, as a fraction of the scene's diagonal. A ray from either side then hits
#: the side that faces the ray before it hits the other side.
SIDE_OFFSET = 1e-5
# Number of rows of the environment map that is exported for a sky with a gradient.
_SKY_ROWS = 1025


@dataclass(frozen=True)
class MitsubaScene:
    """Scene for Mitsuba.

    plugins     : {"type": "scene", ...}, see the module, relative to `origin`
    differences : differences from the scene, a sentence each, without a full stop
    """

    plugins: Plugin
    differences: tuple[str, ...]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)


def described(
    scene: Scene, max_depth: int, *, sampler: Sampler = "multijitter", spp: int = 64, instances: bool = True
) -> MitsubaScene:
    """Return the scene as Mitsuba's plugins, in triangles.

    instances : True stores a mesh with several instances once. False expands all instances to triangles, which
                takes more memory and less time to trace

    Raises SceneError for scenes that `path_traceable` refuses.
    """
    notes = Notes()
    scene = at_opening(scene, notes).centred
    x, y, z = scene.origin.tolist()
    if scene.origin.any():  # Mitsuba's transforms are 32-bit floats, too, so they cannot hold the origin
        notes.add(f"all is relative to {shown(scene.origin)}, as the scene is far from the origin")
    low, high = scene.bounds  # without infinite planes
    size = scene_size(scene)
    near = near_plane(scene, 1e-4 * size)
    scene = in_triangles(scene, notes)
    if np.any(scene.ambient > 0):
        notes.add("ambient light is left out")
    names = Names()
    surfaces = BsdfWriter(scene, notes, names)
    shapes: Plugin = {}
    for shape in scene.shapes:
        shapes |= _shapes(scene, shape, surfaces, names, instances, SIDE_OFFSET * size)
    middle = 0.5 * (low + high)
    emitters = {names.of(light.name): each for light in scene.lights for each in _emitters(light, middle, notes)}
    if scene.sky is not None:
        emitters[names.of("sky")] = _sky(scene.sky)
        if isinstance(scene.sky, Environment) and scene.sky.sun is not None:
            emitters[names.of("sun")] = _sun(scene.sky.sun, notes)
    plugins = {
        "type": "scene",
        "integrator": integrator(max_depth, surfaces.integrator) | _hidden_sky(scene, notes),
        "sensor": _sensor(scene, near, sampler, spp, notes),
    }
    return MitsubaScene(plugins | surfaces.plugins | shapes | emitters, notes.texts, (x, y, z))


def integrator(max_depth: int, plugin: str = "path") -> Plugin:
    """Return the integrator for paths with at most `max_depth` vertices."""
    return {"type": plugin, "max_depth": max_depth + 1, "rr_depth": 5}


def _hidden_sky(scene: Scene, notes: Notes) -> Plugin:
    """Return the integrator's parameter for a transparent background. Add notes on what Mitsuba lacks."""
    background = scene.background
    if background is None:
        return {}
    if not background.transparent:
        notes.add(f"the background {'is' if background.ground is None else 'and its shadow are'} left out")
        return {}
    if scene.sky is None:
        return {}
    if any(shape.emits for shape in scene.shapes):
        notes.add("the camera does not see shapes that emit, as it does not see the sky")
    return {"hide_emitters": True}


def _shapes(
    scene: Scene, shape: Shape, surfaces: BsdfWriter, names: Names, instances: bool, offset: float
) -> Plugin:
    assert isinstance(shape.geometry, Mesh)
    material = scene.materials[shape.material]
    coloured = shape.geometry.colours is not None
    if shape.emits and _opacity_everywhere(scene, shape) is None:
        surfaces.notes.add("it emits everywhere, whatever its alpha", "material", material.name)
    if shape.emits and shape.emission_two_sided:
        apart = in_world(shape).unshared()
        handedness = _handedness(shape, material, surfaces.notes)
        step = offset * np.repeat(face_normals(apart), 3, axis=0)
        front = replace(apart, vertices=apart.vertices + step)
        back = replace(apart, vertices=apart.vertices - step).turned()
        sides = (("front", front, True, handedness), ("back", back, material.two_sided, -handedness))
        return {
            names.of(f"{shape.name}-{side}"): _mesh(
                scene, shape, mesh, surfaces, surfaces.reference(shape.material, coloured, reflects, turn)
            )
            for side, mesh, reflects, turn in sides
        }
    bsdf = surfaces.reference(shape.material, coloured, handedness=_handedness(shape, material, surfaces.notes))
    # Mitsuba's instances cannot emit.
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


def _handedness(shape: Shape, material: Material, notes: Notes) -> float:
    """Return the handedness of the texture coordinates of a normal map; 1 for a material without one."""
    mesh = shape.geometry
    assert isinstance(mesh, Mesh)
    uv = mesh.uv1 if {slot.uv_set for slot in material.slots.values()} == {1} else mesh.uv
    if material.normal_texture is None or uv is None:
        return 1.0
    handedness, differs = uv_handedness(uv, mesh.faces)
    if differs:
        notes.add(
            "its normal map is inverted along green where texture coordinates are mirrored", "shape", shape.name
        )
    return handedness


def _mesh(scene: Scene, shape: Shape, mesh: Mesh, surfaces: BsdfWriter, bsdf: Plugin) -> Plugin:
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
    # Mitsuba does not reduce the emission of a masked surface by its opacity.
    emission = shape.emission if opacity is None else shape.emission * opacity
    if slot is None:
        return rgb(emission)
    texture = scene.textures[slot.texture]
    return bitmap(texture, slot, texture.linear()[..., :3] * emission, raw=False, note=notes.add)


def _opacity_everywhere(scene: Scene, shape: Shape) -> float | None:
    """Return the uniform opacity of a shape; None if its opacity varies."""
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


def _emitters(light: Light, middle: Float64, notes: Notes) -> Iterator[Plugin]:
    if light.kind == "directional":
        yield {"type": "directional", "direction": light.direction.tolist(), "irradiance": rgb(light.intensity)}
        return
    intensity = light.intensity
    if light.falloff == "none":
        distance = float(np.linalg.norm(light.position - middle))
        notes.add(
            "it falls off with the square of the distance; at the scene's centre its brightness stays",
            "light",
            light.name,
        )
        intensity = intensity * distance**2
    if light.profile is not None:
        for made in projectors(light.name, light.profile, light.direction, light.c0, intensity):
            x, y, z = made.pop("axes")
            yield made | {"to_world": _frame(x, y, z, light.position)}
        return
    if light.kind == "point":
        yield {"type": "point", "position": light.position.tolist(), "intensity": rgb(intensity)}
        return
    full, end = light.cone
    if full < end:
        notes.add("between its two cones it fades with the angle, not with the squared cosine", "light", light.name)
    if end >= 90:
        notes.add("its cone ends at 89 degrees", "light", light.name)
        end = 89.0
    made = {"type": "spot", "intensity": rgb(intensity), "cutoff_angle": end, "beam_width": min(full, end * 0.9999)}
    axis = light.direction
    across = perpendicular(axis)
    yield made | {"to_world": _frame(across, np.cross(axis, across), axis, light.position)}


def _sun(sun: Sun, notes: Notes) -> Plugin:
    notes.add("the sun has no disc: its light is parallel, and the camera does not see it")
    return {"type": "directional", "direction": (-sun.direction).tolist(), "irradiance": rgb(sun.irradiance)}


def _sky(sky: Sky | Environment) -> Plugin:
    if isinstance(sky, Environment):
        sky = replace(sky, sun=None)
        middle, left, up = sky.frame
        height, width = sky.image.shape[:2]
        return _envmap(sky, (left, up, middle), (2 * height + 1, width))
    if np.array_equal(sky.zenith, sky.horizon):
        return {"type": "constant", "radiance": rgb(sky.zenith)}
    across = perpendicular(sky.up)
    return _envmap(sky, (across, sky.up, np.cross(across, sky.up)), (_SKY_ROWS, 4))


def _envmap(sky: Sky | Environment, axes: tuple[Float64, Float64, Float64], size: tuple[int, int]) -> Plugin:
    """Return a Mitsuba environment map whose texels hold the radiance of `sky` in their directions.

    Mitsuba's first row lies exactly at the upper pole and its last row at the lower pole. Its columns lie at the
    centres of equal steps of the azimuth. A map of h rows is written as 2 h + 1 rows, which interpolate like the
    original.

    axes : unit x, y (up) and z axes of Mitsuba's frame
    size : (rows, columns) of the result
    """
    theta = np.linspace(0.0, np.pi, size[0])[:, None, None]
    phi = 2.0 * np.pi * (np.arange(size[1]) + 0.5)[:, None] / size[1]
    x, y, z = axes
    directions = np.sin(theta) * (np.sin(phi) * x - np.cos(phi) * z) + np.cos(theta) * y
    image = sky.radiance(directions).astype(np.float32)
    return {"type": "envmap", "image": image, "name": "sky", "to_world": _frame(x, y, z, np.zeros(3))}


def _frame(x: Float64, y: Float64, z: Float64, origin: Float64) -> Float64:
    """Return the (4, 4) transform to world space from a frame with these axes and this origin."""
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, y, z, origin], axis=1)
    return matrix


def _sensor(scene: Scene, near: float, sampler: Sampler, spp: int, notes: Notes) -> Plugin:
    camera, background = scene.camera.at(), scene.background
    low, high = scene.bounds
    far = float(np.linalg.norm(camera.position - 0.5 * (low + high)) + np.linalg.norm(high - low))
    width, height = camera.resolution
    right, up, forward = camera.frame()
    # The x axis of Mitsuba's camera points to the left of the image. Row 0 is towards `up`, column 0 away from
    # `right`.
    view: Plugin = {"type": "perspective", "fov_axis": "y", "fov": float(camera.fov)}
    scale = 1.0
    if camera.projection == "orthographic":
        view, scale = {"type": "orthographic"}, camera.extent[0]  # Mitsuba's orthographic image is 2 wide
    elif camera.projection == "panorama":
        notes.add("Mitsuba has no panorama: the camera is a perspective one of 90 degrees")
        view["fov"] = 90.0
    elif camera.aperture_radius > 0:
        view |= {
            "type": "thinlens",
            "aperture_radius": float(camera.aperture_radius),
            "focus_distance": camera.focus,
        }
    if camera.pixel_aspect != 1:
        notes.add("Mitsuba has square pixels: the camera's pixels become square, with the same height")
    across, down = camera.principal_point
    if (across, down) != (0.5, 0.5):
        if view["type"] == "perspective":
            view |= {"principal_point_offset_x": 0.5 - across, "principal_point_offset_y": 0.5 - down}
        else:
            notes.add("the camera's principal point is left out: the view is to the middle of the picture")
    return view | {
        "near_clip": near,
        "far_clip": far,
        "to_world": _frame(-scale * right, scale * up, forward, camera.position),
        "sampler": {"type": sampler, "sample_count": spp},
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgba" if background is not None and background.transparent else "rgb",
            "component_format": "float32",
        },
    }


#: Maximum angle from its axis that one projector covers, degrees.
WIDEST = 75.0


# Number of texels along a side of an image. On a cube face a texel is 0.7 degrees wide, finer than usual
# measurements.
_SIDE = 128


def projectors(
    name: str, profile: LightProfile, axis: Float64, c0: Float64, intensity: Float64
) -> Iterator[Plugin]:
    """Yield the projectors that emit the light of a profile, each with its axes x, y and direction as "axes".

    The image of Mitsuba's projector is the irradiance of a plane one unit away, divided by pi. That irradiance is
    the intensity times the cubed cosine of the angle to the axis. One projector suffices for a profile that ends
    within `WIDEST` degrees of its axis. Other profiles need a projector for each lit face of a surrounding cube,
    because a projector cannot emit sideways.

    axis, c0  : (3,) unit, as in `LightProfile.intensity`
    intensity : (3,) factor by which the profile's candela values are multiplied, as `Light.intensity`
    """
    across = np.cross(axis, c0)
    last = _last_angle(profile)
    if last <= WIDEST:
        faces, half = [(c0, across, axis)], max(last, 1.0)
    else:
        half = 45.0
        faces = [(c0, across, axis), (c0, -across, -axis)]
        faces += [(axis, np.cross(side, axis), side) for side in (c0, -c0, across, -across)]
    for x, y, z in faces:
        sideways = np.tan(np.radians(half)) * (1.0 - (np.arange(_SIDE) + 0.5) * (2.0 / _SIDE))
        # Mitsuba's first column is towards +x and its first row towards +y.
        towards = z + sideways[None, :, None] * x + sideways[:, None, None] * y
        cosine = 1.0 / np.linalg.norm(towards, axis=2)
        candela = profile.intensity((towards * cosine[..., None]).reshape(-1, 3), axis, c0).reshape(_SIDE, _SIDE)
        if not candela.any():
            continue
        image = (candela * cosine**3 / np.pi)[..., None] * intensity
        yield {
            "type": "projector",
            "fov": 2.0 * half,
            "irradiance": {"type": "bitmap", "image": image.astype(np.float32), "name": name, "wrap_mode": "clamp"},
            "axes": (x, y, z),
        }


def _last_angle(profile: LightProfile) -> float:
    """Return the angle from the axis, in degrees, that contains all light of a profile; 0 for a dark profile."""
    sent = np.flatnonzero(profile.candela.any(axis=0))
    if not len(sent):
        return 0.0
    # There is also light between a lit column and the dark one after it.
    return float(profile.gamma[0] + profile.step * min(int(sent[-1]) + 1, profile.candela.shape[1] - 1))
