"""Small films of all engines, and hashes of their bits."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

import glpath
from glpath.film.aovs import AOVS
from glpath.film.film import Film
from tests.support.terrain import Hills

SMALL = {"resolution": (48, 36), "spp": 4}

#: The AOVs that existed when the hashes were stored: other tests cover `depth_min`.
OLDER_AOVS = tuple(name for name in AOVS if name not in ("depth_min", "uv"))

#: A scene with every kind of light, a texture, a highlight and a smooth sphere.
MIXED: dict[str, object] = {
    "camera": {"position": [0, 2.2, 4.5], "target": [0, 0.4, 0], "fov": 35},
    "textures": {"squares": {"type": "checker", "colors": [[0.8, 0.3, 0.2], [0.1, 0.2, 0.6]], "scale": 4}},
    "materials": {
        "floor": {"texture": "squares"},
        "ball": {"type": "phong", "reflectance": [0.3, 0.3, 0.1], "specular": 0.5, "exponent": 60},
    },
    "sky": {"zenith": [0.2, 0.3, 0.5], "horizon": 0.5},
    "shapes": [
        {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "material": "floor"},
        {"type": "sphere", "center": [0.6, 0.5, 0.3], "radius": 0.5, "material": "ball"},
        {"type": "box", "min": [-0.9, 2, -0.9], "max": [0.1, 2.1, -0.2], "emission": {"radiance": 3}},
    ],
    "lights": [
        {"type": "point", "position": [1.2, 2.5, 1.5], "intensity": 12},
        {"type": "spot", "position": [-2, 3, 2], "target": [0, 0, 0], "intensity": 30},
        {"type": "directional", "direction": [1, -1, -0.3], "irradiance": [0.8, 0.7, 0.5]},
    ],
}

#: A map with a sun, to replace the sky.
ENVIRONMENT = np.random.default_rng(0).random((9, 16, 3)).astype(np.float32)
ENVIRONMENT[2, 5] = 60.0

#: A scene with every lobe: rough and brushed metal, plastic, a coat, clear and frosted glass, a pane, a veil;
#: normal map.
LOBES: dict[str, object] = {
    "camera": {"position": [0, 1.6, 4.6], "target": [0, 0.5, 0], "fov": 38},
    "textures": {"squares": {"type": "checker", "colors": [[0.9, 0.6, 0.9], [0.5, 0.5, 1.0]], "scale": 6}},
    "materials": {
        "floor": {"reflectance": 0.6, "normal_texture": "squares"},
        "metal": {"type": "principled", "reflectance": [0.9, 0.6, 0.3], "metallic": 1, "roughness": 0.3},
        "brushed": {"type": "principled", "metallic": 1, "roughness": 0.5, "anisotropy": 0.8},
        "plastic": {"type": "principled", "reflectance": [0.1, 0.4, 0.2], "roughness": 0.2, "clearcoat": 0.7},
        "glass": {"type": "principled", "transmission": 1, "roughness": 0, "attenuation": [0.4, 0.1, 0.2]},
        "frosted": {"type": "principled", "transmission": 1, "roughness": 0.4, "ior": 1.33},
        "pane": {"type": "principled", "transmission": 1, "roughness": 0.2, "thin": True},
        "mirror": {"type": "principled", "reflectance": 0.95, "metallic": 1, "roughness": 0},
        "leaf": {"reflectance": [0.2, 0.5, 0.1], "alpha": "blend", "opacity": 0.6},
    },
    "sky": {"zenith": [0.2, 0.3, 0.5], "horizon": 0.5},
    "shapes": [
        {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "material": "floor"},
        {"type": "quad", "corners": [[-3, 0, -2], [3, 0, -2], [3, 2, -2], [-3, 2, -2]], "material": "mirror"},
        {
            "type": "quad",
            "corners": [[-1, 2.5, 1], [-1, 2.5, 0], [1, 2.5, 0], [1, 2.5, 1]],
            "emission": {"radiance": 6},
        },
        {
            "type": "quad",
            "corners": [[0.9, 0.1, 1.6], [1.9, 0.1, 1.2], [1.9, 1.1, 1.2], [0.9, 1.1, 1.6]],
            "material": "pane",
        },
        {
            "type": "quad",
            "corners": [[-1.9, 0.1, 1], [-1, 0.1, 1.6], [-1, 1, 1.6], [-1.9, 1, 1]],
            "material": "leaf",
        },
        *(
            {"type": "sphere", "center": [x, 0.4, z], "radius": 0.4, "material": name}
            for name, x, z in (
                ("metal", -1.6, 0.0),
                ("brushed", -0.8, -0.5),
                ("plastic", 0.0, -1.0),
                ("glass", 0.0, 0.8),
                ("frosted", 0.9, 0.3),
            )
        ),
    ],
    "lights": [{"type": "point", "position": [2, 2.5, 2], "intensity": 4}],
}

#: The part of it that paths with shared directions support: no smooth lobes, no glass.
ROUGH = LOBES | {
    "shapes": [
        shape
        for shape in LOBES["shapes"]  # type: ignore[attr-defined]
        if shape.get("material") not in {"plastic", "glass", "frosted", "pane", "mirror"}
    ],
    "materials": {
        name: surface
        for name, surface in LOBES["materials"].items()  # type: ignore[attr-defined]
        if name in {"floor", "metal", "brushed", "leaf"}
    },
}

LENS = {"aperture_radius": 0.15, "focus_distance": 4.0}

#: Streamed triangles, which are made on demand.
STREAM: dict[str, object] = {
    "camera": {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 45},
    "materials": {"grass": {"reflectance": [0.3, 0.6, 0.3]}},
    "sky": {"zenith": [0.2, 0.3, 0.6], "horizon": 0.5},
    "shapes": [
        {"type": "quad", "corners": [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]], "emission": {"radiance": 9}},
        {"type": "stream", "stream": Hills(2, 12), "material": "grass"},
    ],
}

#: A row of points on a table, and one that faces down.
POINTS = np.linspace([-1.0, 0.2, 1.5], [1.0, 0.6, 1.2], 12)

FACING = [[0.0, 1.0, 0.0]] * 11 + [[0.0, -1.0, 0.0]]

FILMS: dict[str, dict[str, object]] = {
    "path-buffer-mixed": {
        "scene": MIXED,
        "max_depth": 3,
        "integrator": "path-buffer",
        "resolution": (48, 36),
        "spp": 16,
    },
    "path-mixed": {"scene": MIXED, "max_depth": 3, "resolution": (48, 36), "spp": 16},
    "path-buffer-environment": {"scene": "environment", "max_depth": 5, "integrator": "path-buffer", **SMALL},
    "path-environment": {"scene": "environment", "max_depth": 5, **SMALL},
    "t-buffer-environment": {"scene": "environment", "integrator": "t-buffer", **SMALL},
    "t-buffer-mixed": {"scene": MIXED, "integrator": "t-buffer", **SMALL},
    "t-buffer-cornell-box": {"scene": "cornell-box", "integrator": "t-buffer", **SMALL},
    "path-buffer-cornell-box": {"scene": "cornell-box", "max_depth": 5, "integrator": "path-buffer", **SMALL},
    "path-cornell-box": {"scene": "cornell-box", "max_depth": 5, "roulette": 3, "seed": 2, **SMALL},
    "path-cornell-box-random": {
        "scene": "cornell-box",
        "max_depth": 5,
        "sampling": "random",
        "ambient": 0.1,
        **SMALL,
    },
    "path-buffer-cornell-box-36-depth-1": {
        "scene": "cornell-box-36",
        "max_depth": 1,
        "integrator": "path-buffer",
        **SMALL,
    },
    "path-buffer-cornell-box-36-lattice": {
        "scene": "cornell-box-36",
        "max_depth": 5,
        "integrator": "path-buffer",
        "directions": "lattice",
        **SMALL,
    },
    "path-buffer-cornell-box-36-hemisphere": {
        "scene": "cornell-box-36",
        "max_depth": 5,
        "integrator": "path-buffer",
        "directions": "hemisphere",
        "seed": 3,
        **SMALL,
    },
    "path-buffer-cornell-box-36-paper": {
        "scene": "cornell-box-36",
        "max_depth": 5,
        "integrator": "path-buffer",
        "directions": "sphere",
        "sampling": "random",
        "ambient": 0.1,
        **SMALL,
    },
    "path-buffer-cornell-box-36-crop": {
        "scene": "cornell-box-36",
        "max_depth": 5,
        "integrator": "path-buffer",
        "crop": (10, 5, 20, 18),
        "roulette": 2,
        **SMALL,
    },
    "path-cornell-box-36-crop": {"scene": "cornell-box-36", "crop": (10, 5, 20, 18), "max_depth": 1, **SMALL},
    "path-buffer-room": {"scene": "room", "max_depth": 3, "integrator": "path-buffer", **SMALL},
    "path-room": {"scene": "room", "max_depth": 3, **SMALL},
    "gather-path-buffer-cornell-box-36": {
        "scene": "cornell-box-36",
        "integrator": "gather",
        "cast": "path-buffer",
        **SMALL,
    },
    "gather-cornell-box-36": {"scene": "cornell-box-36", "integrator": "gather", **SMALL},
    "gather-path-buffer-cornell-box-36-constant": {
        "scene": "cornell-box-36",
        "integrator": "gather",
        "cast": "path-buffer",
        "radiosity_lookup": "constant",
        "direct_light": "solution",
        "lookup_distance": 0.0,
        "lookup_depth": 3,
        **SMALL,
    },
    "t-buffer-three-spheres": {"scene": "three-spheres", "integrator": "t-buffer", **SMALL},
    "t-buffer-three-spheres-cube": {
        "scene": "three-spheres",
        "integrator": "t-buffer",
        "shadows": "cube",
        "shadow_resolution": 128,
        **SMALL,
    },
    "classic-three-spheres-sphere": {
        "scene": "three-spheres",
        "integrator": "classic",
        "shadows": "sphere",
        "shadow_resolution": 128,
        "shadow_test": "identity",
        **SMALL,
    },
    "t-buffer-stacked-triangles": {
        "scene": "stacked",
        "parameters": {"kind": "triangle", "objects": 40000, "ground": True},
        "integrator": "t-buffer",
        **SMALL,
    },
    "classic-stacked-spheres": {
        "scene": "stacked",
        "parameters": {"objects": 50},
        "integrator": "classic",
        **SMALL,
    },
    "path-lobes": {"scene": LOBES, "max_depth": 4, "guide": "cosine", "resolution": (48, 36), "spp": 8},
    "path-buffer-lobes": {
        "scene": ROUGH,
        "max_depth": 4,
        "integrator": "path-buffer",
        "resolution": (48, 36),
        "spp": 8,
    },
    "gather-lobes": {"scene": LOBES, "integrator": "gather", **SMALL},
    "path-lens": {"scene": "cornell-box-36", "max_depth": 5, "camera": LENS, **SMALL},
    "path-buffer-lens": {
        "scene": "cornell-box-36",
        "max_depth": 5,
        "camera": LENS,
        "integrator": "path-buffer",
        **SMALL,
    },
    "path-orthographic": {
        "scene": "cornell-box",
        "max_depth": 5,
        "camera": {"type": "orthographic", "height": 2.0},
        **SMALL,
    },
    "path-panorama": {
        "scene": LOBES,
        "max_depth": 5,
        "camera": {"type": "panorama"},
        "resolution": (64, 32),
        "spp": 4,
    },
    "path-guided": {"scene": "cornell-box-36", "max_depth": 5, "guide": "solution", **SMALL},
    "path-aovs": {"scene": LOBES, "max_depth": 5, "aovs": OLDER_AOVS, **SMALL},
    "path-buffer-aovs": {"scene": ROUGH, "max_depth": 5, "aovs": OLDER_AOVS, "integrator": "path-buffer", **SMALL},
    "gather-aovs": {"scene": "cornell-box-36", "integrator": "gather", "aovs": OLDER_AOVS, **SMALL},
    "t-buffer-aovs": {"scene": MIXED, "integrator": "t-buffer", "aovs": ("albedo", "normal", "depth"), **SMALL},
    "path-buffer-stream": {
        "scene": STREAM,
        "max_depth": 3,
        "integrator": "path-buffer",
        "light_resolution": 64,
        **SMALL,
    },
    "path-points": {"scene": MIXED, "points": "plane", "spp": 16},
    "path-cylinders": {"scene": MIXED, "points": "cylinder", "spp": 32},
    "gather-points": {"scene": "cornell-box-36", "integrator": "gather", "points": "plane", "spp": 16},
}


def film_of(name: str, **changes: object) -> Film:
    options = FILMS[name] | changes
    if options["scene"] == "environment":
        scene = glpath.load_scene(MIXED)
        options["scene"] = replace(scene, sky=glpath.scene.Environment(ENVIRONMENT, rotation=25.0, scale=0.7))
    if options.get("integrator") == "gather":
        # Particles are the same on every machine, but quadrature depends on the number of threads.
        options["radiosity"] = glpath.solve_radiosity(
            options["scene"], method="monte-carlo", patches=200, particles=32768
        )
    if receiver := options.pop("points", None):
        scene = options.pop("scene")
        return glpath.irradiance(scene, POINTS, FACING, receiver=receiver, **options).film  # type: ignore[arg-type]
    return glpath.render(**options)  # type: ignore[arg-type]


def film_hash(film: Film) -> str:
    """Return the SHA-256 (hex) of the light's sums, and of the AOVs' sums in the order of their names."""
    found = hashlib.sha256(np.ascontiguousarray(film.radiance_sums, "<f8").tobytes())
    for name in sorted(film.aov_sums):
        found.update(np.ascontiguousarray(film.aov_sums[name], "<f8").tobytes())
    return found.hexdigest()
