"""What each integrator renders: every cell of the table is asked of the code that refuses.

For each feature there is the smallest scene that has it. It is handed to the plan of each integrator, as a
render does before it opens a device. Nothing here says who supports what.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from glpath.errors import GlpathError, SceneError, UsageError
from glpath.film.aovs import AOVS
from glpath.integrators.by_name import INTEGRATORS
from glpath.integrators.path_engines import check_shared
from glpath.integrators.settings import IntegratorSettings
from glpath.io import load_scene
from glpath.rendering.factory import plan_of
from glpath.rendering.options import options, settings_of
from glpath.scene import Scene
from glpath_docs.markdown import code, table

_FLOOR = {"type": "quad", "corners": [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]}
_LAMP = {
    "type": "quad",
    "corners": [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]],
    "emission": {"radiance": 1},
}
_CAMERA = {"position": [0, 1, 3], "target": [0, 0, 0]}
_POINT = {"type": "point", "position": [0, 1, 0], "intensity": 1}
_UP = [{"time": 0, "transform": []}, {"time": 1, "transform": [{"translate": [0, 0.1, 0]}]}]


@dataclass(frozen=True)
class Feature:
    """Something that a scene or a call can have.

    name    : as the table has it
    shape   : keys of the floor's shape
    scene   : keys of the scene
    material : of the floor
    """

    name: str
    shape: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, Any] = field(default_factory=dict)
    material: Mapping[str, Any] = field(default_factory=dict)

    def made(self) -> Scene:
        """The smallest scene that has it."""
        floor = {**_FLOOR, **self.shape}
        if "type" in self.shape:
            floor = {**self.shape}
        described = {"camera": _CAMERA, **self.scene, "shapes": [_LAMP, floor]}
        if self.material:
            described["materials"] = {"it": self.material}
            floor["material"] = "it"
        return load_scene(described)


class _Chunks:
    """The smallest stream of triangles."""

    def __len__(self) -> int:
        return 1

    def chunk(self, index: int) -> Any:
        return np.array([[[-1, 0, 1], [1, 0, 1], [1, 0, -1]]], np.float64)


#: By the title of a table.
FEATURES: dict[str, tuple[Feature, ...]] = {
    "Shapes": (
        Feature("meshes, boxes and quads"),
        Feature("spheres", {"type": "sphere", "center": [0, 0, 0], "radius": 1}),
        Feature("endless planes", {"type": "plane", "point": [0, 0, 0], "normal": [0, 1, 0]}),
        Feature(
            "Bézier and B-spline patches",
            {"type": "patches", "net": [[[x, 0, -z] for x in range(4)] for z in range(4)]},
        ),
        Feature("streamed triangles", {"type": "stream", "stream": _Chunks()}),
        Feature(
            "shapes that move while the shutter is open",
            {"motion": _UP},
            {"camera": {**_CAMERA, "shutter": [0, 1]}},
        ),
    ),
    "Materials": (
        Feature("diffuse", material={"reflectance": 0.5}),
        Feature(
            "Phong's highlight", material={"type": "phong", "reflectance": 0.5, "specular": 0.3, "exponent": 20}
        ),
        Feature("Phong's mirror", material={"type": "phong", "reflectance": 0.5, "mirror": 0.3}),
        Feature("rough metal", material={"type": "principled", "metallic": 1, "roughness": 0.6}),
        Feature("polished metal", material={"type": "principled", "metallic": 1, "roughness": 0.05}),
        Feature("glass", material={"type": "principled", "transmission": 1, "roughness": 0}),
        Feature("window glass", material={"type": "glazing", "transmittance": 0.8}),
        Feature(
            "diffuse transmission", material={"type": "principled", "diffuse_transmission": 0.5, "roughness": 0.6}
        ),
        Feature("alpha, masked", material={"alpha": "mask", "opacity": 0.7}),
        Feature("alpha, blended", scene={"lights": [_POINT]}, material={"alpha": "blend", "opacity": 0.7}),
    ),
    "Light": (
        Feature("point lights", scene={"lights": [_POINT]}),
        Feature(
            "spot lights",
            scene={"lights": [{"type": "spot", "position": [0, 1, 0], "target": [0, 0, 0], "intensity": 1}]},
        ),
        Feature(
            "directional lights",
            scene={"lights": [{"type": "directional", "direction": [0, -1, 0], "irradiance": 1}]},
        ),
        Feature("ambient light", scene={"ambient": 0.1}),
        Feature("a sky of two colours", scene={"sky": {"zenith": 1, "horizon": 1}}),
        Feature("a sky of the CIE", scene={"sky": {"type": "cie", "cie_type": 1, "illuminance": 10000}}),
        Feature(
            "sky and sun of a day",
            scene={"sky": {"type": "perez", "direct": 800, "diffuse": 100, "sun": [1, 1, 1]}},
        ),
    ),
    "Cameras": (
        Feature("perspective"),
        Feature("with a lens", scene={"camera": {**_CAMERA, "aperture_radius": 0.1}}),
        Feature("orthographic", scene={"camera": {**_CAMERA, "type": "orthographic", "height": 2}}),
        Feature("panorama", scene={"camera": {**_CAMERA, "type": "panorama"}}),
    ),
}

#: Columns: the integrator and the options that make another engine of it.
ENGINES: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("path", {}),
    ("path-buffer", {}),
    ("gather", {}),
    ("gather", {"cast": "path-buffer"}),
    ("t-buffer", {}),
    ("t-buffer", {"shadows": "cube"}),
    ("classic", {}),
)


def title(name: str, given: Mapping[str, Any]) -> str:
    """Of a column."""
    return " ".join([code(name), *(code(f"--{key} {value}") for key, value in given.items())])


def refusal(scene: Scene, settings: IntegratorSettings) -> GlpathError | None:
    """Why an integrator does not render a scene; None: it does."""
    from glpath.integrators.whitted import check_shadows  # with numba, which is slow to import

    try:
        plan = plan_of(settings)
        traced = plan.traceable(scene)
        if getattr(settings, "by_path_buffer", False):
            check_shared(traced)
        if getattr(settings, "shadows", "rays") != "rays" and traced.lights:
            check_shadows(traced)
    except SceneError as error:
        return error
    return None


def pages() -> dict[str, str]:
    """The page of the integrators, by path."""
    reasons: dict[str, str] = {}
    text = [
        "# What each integrator renders\n",
        "A scene of each row was handed to each integrator when this page was made. A number is an error below. "
        "`auto` takes `path`, `gather` or `path-buffer`, whichever renders the scene.\n",
    ]
    columns = [(title(name, given), settings_of(name, given)) for name, given in ENGINES]
    for about, features in FEATURES.items():
        rows = []
        for feature in features:
            scene = feature.made()
            cells = []
            for _, settings in columns:
                error = refusal(scene, settings)
                cells.append("yes" if error is None else f"no\u00a0({_number(error, scene, reasons)})")
            rows.append([feature.name, *cells])
        text += [f"## {about}\n", table([about.lower(), *(name for name, _ in columns)], rows)]
    text += ["## Points instead of a camera\n", _points(columns), "## Errors\n"]
    text += [f"{number}. {reason}" for number, reason in enumerate(reasons.values(), 1)]
    text += ["", "## Options\n", _options(), "## Layers (AOVs)\n"]
    text.append(f"Every integrator has all of them: {', '.join(map(code, AOVS))}.\n")
    return {"reference/integrators.md": "\n".join(text)}


def _number(error: GlpathError, scene: Scene, reasons: dict[str, str]) -> int:
    message = error.message.removeprefix(f"{scene.source or scene.name}: ")
    shown = code(f"{message} {error.remedy}")
    reasons.setdefault(message, shown)
    return list(reasons).index(message) + 1


def _points(columns: list[tuple[str, IntegratorSettings]]) -> str:
    rows = []
    for name, settings in columns:
        try:
            settings.check_points()
            rows.append((name, "yes"))
        except UsageError as error:
            rows.append((name, f"no: {error.message}"))
    return table(("integrator", "`glpath measure`, `lightmap` and `probes`"), rows)


def _options() -> str:
    """Which integrator has which option, from the fields of their settings."""
    names = list(INTEGRATORS)
    rows = [
        [
            code(
                f"--{(option.first.meta.extra or {}).get('flag', name).removeprefix('--').replace('_', '-')}"
                if option.first.meta
                else name
            )
        ]
        + ["yes" if each in option.settings else "" for each in names]
        for name, option in options().items()
    ]
    return table(["option", *map(code, names)], rows)
