"""Summary of a scene as data for programs (`glpath info --json`), and of its lights as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from glpath.scene import Environment, Light, Material, Scene, Sky, check_scene
from glpath.scene.geometry import Shape, sphere_areas
from glpath.scene.maintenance import factors_of
from glpath.scene.model import triangle_areas

_OF_MICROFACETS = (
    "roughness",
    "metallic",
    "ior",
    "transmission",
    "thin",
    "clearcoat",
    "clearcoat_roughness",
    "anisotropy",
    "sheen",
    "sheen_roughness",
)


def summarize(scene: Scene) -> dict[str, Any]:
    """Return the report of `glpath info` as data for JSON.

    Power is flux in W or lm, by the unit of the scene, if its unit of length is a metre. It is pi * area * radiance
    for each side of a shape that emits, and 4 pi * intensity for a point light. It is null for spots, whose edge is
    soft, for directional lights and for lights without falloff, which have no total. The area of a plane and of a
    stream is also null; only triangles of a stream are counted.
    """
    lower, upper = scene.bounds
    camera = scene.camera
    areas = _areas(scene)
    shapes = []
    for shape, area in zip(scene.shapes, areas, strict=True):
        shapes.append(
            {
                "name": shape.name,
                "kind": shape.kind,
                "triangles": shape.count if shape.primitive in ("triangle", "stream") else 0,
                "spheres": shape.count if shape.primitive == "sphere" else 0,
                "area": area,
                "material": scene.materials[shape.material].name,
                "emission": shape.emission.tolist(),
                "moves": shape.motion is not None,
            }
        )
    return {
        "name": scene.name,
        "source": scene.source,
        "unit": scene.unit,
        "sha256": scene.digest(),
        "content_sha256": scene.digest(camera=False),
        "triangles": scene.shapes.total("triangle") + scene.shapes.total("stream"),
        "spheres": len(scene.spheres),
        "planes": len(scene.planes),
        "bounds": {"min": lower.tolist(), "max": upper.tolist()},
        "camera": {
            "position": camera.position.tolist(),
            "target": camera.target.tolist(),
            "up": camera.up.tolist(),
            "type": camera.projection,
            "fov": camera.fov if camera.projection == "perspective" else None,
            "height": camera.height if camera.projection == "orthographic" else None,
            "aperture_radius": camera.aperture_radius,
            "focus_distance": camera.focus if camera.aperture_radius > 0 else None,
            "shutter": list(camera.shutter),
            "moves": camera.moves,
            "resolution": list(camera.resolution),
            "principal_point": list(camera.principal_point),
            "pixel_aspect": camera.pixel_aspect,
        },
        "shapes": shapes,
        "materials": [_about_material(scene, material) for material in scene.materials],
        "textures": [
            {
                "name": texture.name,
                "size": list(texture.image.shape[1::-1]),
                "scale": list(texture.scale),
                "filter": texture.filter,
            }
            for texture in scene.textures
        ],
        "lights": about_lights(scene, areas),
        "ambient": scene.ambient.tolist(),
        "sky": _about_sky(scene.sky),
        "warnings": check_scene(scene),
    }


def about_lights(scene: Scene, areas: list[float | None] | None = None) -> list[dict[str, Any]]:
    """Return name, kind, power (see `summarize`) and other data of shapes that emit, then of punctual lights.

    areas : area of each shape, see `_areas`; None if they are not computed yet
    """
    found = []
    for shape, area in zip(scene.shapes, _areas(scene) if areas is None else areas, strict=True):
        if shape.emits:
            sides = 2 if shape.emission_two_sided else 1
            power = None if area is None else (np.pi * area * sides * shape.emission).tolist()
            about = {"name": shape.name, "kind": "shape", "power": power, "two_sided": shape.emission_two_sided}
            found.append(about | _maintenance(shape))
    return found + [_about_light(light) for light in scene.lights]


def _areas(scene: Scene) -> list[float | None]:
    """Return the area of each shape, scene units squared; None for planes and streams."""
    spheres, found = sphere_areas(scene.spheres), list[float | None]()
    for index, (shape, part) in enumerate(zip(scene.shapes, scene.shapes.ranges, strict=True)):
        if shape.primitive == "triangle":
            found.append(sum(float(triangle_areas(each).sum()) for each in scene.shapes.triangles_of(index)))
        else:
            found.append(float(spheres[part].sum()) if shape.primitive == "sphere" else None)
    return found


def _about_material(scene: Scene, material: Material) -> dict[str, Any]:
    return {
        "name": material.name,
        "reflectance": material.reflectance.tolist(),
        "texture": None if material.texture is None else scene.textures[material.texture.texture].name,
        "specular": material.specular.tolist(),
        "exponent": material.exponent,
        "mirror": material.mirror.tolist(),
        "two_sided": material.two_sided,
        "described": material.described(),
        **{name: _plain(getattr(material, name)) for name in _OF_MICROFACETS if material.roughness is not None},
    }


def _plain(value: Any) -> Any:
    """Return the value in a form that JSON can store: an array becomes a list."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def _about_sky(sky: Sky | Environment | None) -> dict[str, Any] | None:
    if isinstance(sky, Environment):
        size, up, integral = list(sky.image.shape[1::-1]), sky.up.tolist(), sky.integral.tolist()
        about = {"size": size, "scale": sky.scale, "rotation": sky.rotation, "up": up, "integral": integral}
        if sky.sun is not None:
            sun = sky.sun
            about["sun"] = {
                "direction": sun.direction.tolist(),
                "irradiance": sun.irradiance.tolist(),
                "diameter": sun.diameter,
            }
        return about
    return None if sky is None else {name: getattr(sky, name).tolist() for name in ("zenith", "horizon", "up")}


def _maintenance(lamp: Light | Shape) -> dict[str, float]:
    """Return the maintenance factor of a lamp, or nothing if it has none. The lamp's light already includes it."""
    return {} if lamp.maintenance_factor is None else {"maintenance_factor": lamp.maintenance_factor}


def _about_light(light: Light) -> dict[str, Any]:
    found: dict[str, Any] = {"name": light.name, "kind": light.kind, "intensity": light.intensity.tolist()}
    bound = light.kind != "directional" and light.falloff == "quadratic"
    flux = 4 * np.pi if light.profile is None else light.profile.flux
    found["power"] = (flux * light.intensity).tolist() if bound and light.kind == "point" else None
    found["falloff"] = light.falloff
    found |= _maintenance(light)
    if light.kind != "directional":
        found["position"] = light.position.tolist()
    if light.kind != "point" or light.profile is not None:
        found["direction"] = light.direction.tolist()
    if light.profile is not None:
        found |= {"profile": light.profile.candela.shape, "c0": light.c0.tolist()}
    if light.kind == "spot":
        found["cone"] = list(light.cone)
    return found


def light_of(scene: Scene) -> str:
    """Return a line on the lights of a scene, including a sky that was added because the scene had no light."""
    emitting = sum(shape.emits for shape in scene.shapes)
    shining = sum(bool(np.any(light.intensity > 0)) for light in scene.lights)
    parts = [
        f"{count:,} {word}{'s' * (count != 1)}"
        for count, word in ((emitting, "shape"), (shining, "punctual light"))
        if count
    ]
    if emitting:
        parts[0] += " that emit" + "s" * (emitting == 1)
    factors = sorted(set(factors_of(scene)))
    if factors and factors != [1.0]:  # `factors` is empty if the sun is the only light
        between = " to ".join(f"{factor:g}" for factor in dict.fromkeys((factors[0], factors[-1])))
        parts[-1] += f" (maintenance factor {between})"
    if isinstance(scene.sky, Environment):
        studio = "a studio, as the scene has no light of its own"
        parts.append(studio if scene.sky.assumed else "an environment map")
        parts += ["a sun"] * (scene.sky.sun is not None)
    elif scene.sky is not None:
        added = ", as the scene has no light of its own" if scene.sky.assumed else ""
        white = bool(np.all(scene.sky.zenith == 1) and np.all(scene.sky.horizon == 1))
        parts.append(f"a white sky of radiance 1 from all around{added}" if white else "a sky")
    if np.any(scene.ambient > 0):
        parts.append("ambient light")
    return f"light: {', '.join(parts) or 'none'}"
