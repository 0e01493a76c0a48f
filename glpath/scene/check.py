"""Warnings about a scene that can be rendered, but probably not as intended.

Loading does not warn, because a scene is often loaded to be changed. Rendering and `glpath validate` do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Light, Mesh, Scene, Shape
from glpath.scene.sight import enclosing, enclosing_spheres, enclosing_with_cost, sees_anything, touched_shape
from glpath.scene.source_location import coordinates
from glpath.system.arguments import checked
from glpath.system.time_limit import check_time

# Opacity up to which a shape counts as invisible.
_MIN_OPACITY = 0.02
# Maximum cost of the tests whether shapes enclose lights, for all lights together; see `enclosing_with_cost`.
_MAX_COST = 1 << 24


@checked
def check_scene(scene: Scene, seen: bool = True) -> list[str]:
    """Return warnings about a scene that can be rendered, but probably not as intended; empty if none apply.

    seen : False to leave out the camera's position and view, for sensors made of points

    If many lights are inside many shapes, some lights are tested for enclosing spheres only. Warnings that need the
    other tests are then left out, so that the time is limited.
    """
    shining = [light for light in scene.lights if np.any(light.intensity > 0)]
    placed = [light for light in shining if light.kind != "directional"]
    around_camera = enclosing(scene, scene.camera.at().position)
    found = [] if shining else _about_darkness(scene)
    # A shape with a light inside is meant as a room, so a camera inside such a shape causes no warning.
    lit_inside = np.zeros(len(scene.shapes), np.bool_)
    cost = 0
    for light in placed:
        check_time()
        if cost < _MAX_COST:
            around, more = enclosing_with_cost(scene, light.position)
            cost += more
            lit_inside |= around != 0
        else:
            around = enclosing_spheres(scene, light.position)
            lit_inside[:] = True
        found += _about_what_encloses(light, scene, np.flatnonzero((around != 0) & (around_camera == 0)))
        found += _about_planes(light, scene) if seen else []
    if seen:
        found += _about_camera(scene, np.flatnonzero((around_camera > 0) & ~lit_inside))
    return found + _about_time(scene) + _about_materials(scene) + _about_opacity(scene)


def _about_time(scene: Scene) -> list[str]:
    """Return warnings about motion that a closed shutter does not record, and about panoramas that are not 2:1."""
    camera, found = scene.camera, []
    moving = [shape.name for shape in scene.shapes if shape.motion is not None and len(shape.motion.times) > 1]
    moving += ["the camera"] * (len(camera.motion) > 1)
    if moving and camera.shutter == (0.0, 0.0):
        found.append(
            f"There is motion ({', '.join(moving[:3])}), but the shutter opens for the moment 0 alone, so nothing "
            "is blurred. Say how long it is open: shutter = [0, 0.02]."
        )
    width, height = camera.resolution
    if camera.projection == "panorama" and abs(width - 2 * height) > 0.01 * width:
        found.append(
            f"The panorama has {width} x {height} pixels, which are wider or narrower than they are high: "
            "360 x 180 degrees are an image twice as wide as high."
        )
    return found


def _about_camera(scene: Scene, around: NDArray[np.intp]) -> list[str]:
    """Return warnings about the camera's position and view.

    around : indices of shapes that enclose the camera, have outward fronts, and have no light inside
    """
    touching = touched_shape(scene)
    if touching is not None:
        return [
            f'The camera stands exactly on a surface, of the shape "{touching.name}": '
            "half of the picture may be that surface. Move it a little."
        ]
    if not sees_anything(scene):
        camera, (lower, upper) = scene.camera.at(), scene.bounds
        return [
            "The camera sees nothing: no shape is in view. "
            f"It stands at {coordinates(camera.position)} and looks at {coordinates(camera.target)}; "
            f"the scene reaches from {coordinates(lower)} to {coordinates(upper)}."
        ]
    # Two kinds of shapes around the camera may be meant as a room, and cause no warning: a mesh whose backs are not
    # black, and a sphere that emits inwards.
    shapes = [scene.shapes[index] for index in around]
    found = [
        f'The camera stands inside the sphere "{shape.name}" and sees nothing but its inside. '
        "Move it out, or give the sphere flip_normals = true if it is meant as a room."
        for shape in shapes
        if shape.primitive == "sphere" and not (shape.emits and shape.emission_two_sided)
    ]
    black = [shape.name for shape in shapes if shape.primitive == "triangle" and _has_black_back(scene, shape)]
    if black:
        more = f" (and {len(black) - 1} more shapes)" if len(black) > 1 else ""
        found.append(
            f'The camera stands inside the shape "{black[0]}"{more}, whose material has one side, and sees its '
            "black back. Move the camera out, or give the material two sides: two_sided = true, or doubleSided in "
            "glTF."
        )
    return found


def _has_black_back(scene: Scene, shape: Shape) -> bool:
    material = scene.materials[shape.material]
    return not (material.two_sided or material.culled or material.alpha != "opaque" or material.transmission > 0)


def _about_darkness(scene: Scene) -> list[str]:
    sky = scene.sky is not None and scene.sky.max_radiance > 0
    if sky or np.any(scene.ambient > 0) or any(shape.emits for shape in scene.shapes):
        return []
    return [
        "No shape emits light, and there is no other light: the picture will be black. "
        "Give a shape an emission, e.g. emission = { radiance = [10, 10, 10] }, or add [[lights]]."
    ]


def _about_what_encloses(light: Light, scene: Scene, around: NDArray[np.intp]) -> list[str]:
    """Return a warning if shapes enclose a light and occlude it from everything outside.

    around : indices of shapes that enclose the light, but not the camera
    """
    if not len(around):
        return []
    return [
        f'The light "{light.name}" stands inside the shape "{scene.shapes[around[0]].name}"{_others(around)}, '
        "which keeps it from everything outside. Move the light out, or leave the shape away."
    ]


def _others(indices: NDArray[np.intp]) -> str:
    """Return the text for all shapes but the first; empty if there is only one."""
    return f" (and {len(indices) - 1:,} more shapes)" if len(indices) > 1 else ""


def _about_planes(light: Light, scene: Scene) -> list[str]:
    """Return a warning if planes are between a light and the camera."""
    # Signed distances, above 0 on the front side of each plane.
    eye, lamp = (
        np.sum(scene.planes[:, :, 2] * (point - scene.planes[:, :, 3]), axis=1)
        for point in (scene.camera.at().position, light.position)
    )
    between = np.flatnonzero(eye * lamp < 0)
    if not len(between):
        return []
    name = scene.shapes[scene.shapes.primitive_shape("plane")[between[0]]].name
    return [
        f'The light "{light.name}" and the camera are on different sides of the plane '
        f'"{name}"{_others(between)}, which keeps it from all that can be seen. Move one of them.'
    ]


def _about_materials(scene: Scene) -> list[str]:
    found = []
    with_colours = {
        s.material for s in scene.shapes if isinstance(s.geometry, Mesh) and s.geometry.colours is not None
    }
    for index in sorted({shape.material for shape in scene.shapes}):
        material = scene.materials[index]
        plain = material.texture is None and index not in with_colours
        if plain and not material.has_lobes and np.all(material.reflectance >= 1):
            found.append(
                f'The material "{material.name}" reflects all light (reflectance 1): '
                "no real surface does, and between such surfaces light never dies out."
            )
        max_reflectance = material.reflectance
        if material.texture is not None:
            max_reflectance = max_reflectance * scene.textures[material.texture.texture].max
        if np.any(material.mirror > 0) and np.any(max_reflectance + material.mirror > 1 + 1e-6):
            found.append(
                f'The material "{material.name}" reflects more light than it receives: '
                f"reflectance and mirror add up to {np.max(max_reflectance + material.mirror):.3g}. Lower one of "
                "them."
            )
    return found


def _about_opacity(scene: Scene) -> list[str]:
    """Return a warning if everything in the scene is transparent by its alpha."""
    if not scene.shapes or any(_max_opacity(scene, shape) > _MIN_OPACITY for shape in scene.shapes):
        return []
    highest = max(_max_opacity(scene, shape) for shape in scene.shapes)
    return [
        f"Nothing in the scene is opaque: the highest opacity is {highest:.3g}, so hardly anything can be seen. "
        "Raise the opacity (alpha of colours, textures or materials; d in MTL)."
    ]


def _max_opacity(scene: Scene, shape: Shape) -> float:
    """Return the maximum opacity of a shape: material opacity times maximum alpha of the texture and the colours.

    With an alpha mask, the result is 0 or 1.
    """
    material = scene.materials[shape.material]
    if material.alpha == "opaque":
        return 1.0
    opacity = material.opacity
    if isinstance(shape.geometry, Mesh) and shape.geometry.colours is not None and len(shape.geometry.faces):
        opacity *= float(shape.geometry.colours[shape.geometry.faces, 3].max())
    if material.texture is not None:
        image = scene.textures[material.texture.texture].image
        if image.shape[2] == 4:
            opacity *= float(image[..., 3].max()) / (255.0 if image.dtype == np.uint8 else 1.0)
    return float(opacity >= material.cutoff) if material.alpha == "mask" else opacity
