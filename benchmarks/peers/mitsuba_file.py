"""Renders a Mitsuba file with Mitsuba in a separate process: python -m benchmarks.peers.mitsuba_file.

Standard input is a JSON object with the keyword arguments of `render_file`; the pictures go into `output` as .npy.
Film, pixel filter, sampler and integrator are replaced, so that both programs estimate the same pixels.
"""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.mitsuba import load_mitsuba

#: Plugin of Sionna.
RADIO_MATERIAL = "itu-radio-material"
# File of Sionna's repository with the colours of that plugin, and their name in it.
_RADIO_FILE, _RADIO_COLOURS = Path("src/sionna/rt/radio_materials/itu_material.py"), "ITU_MATERIAL_COLORS"


def render_file(
    path: str,
    output: str,
    parameters: dict[str, str],
    size: tuple[int, int],
    camera: dict[str, Any],
    samples: int,
    batches: int,
    depth: int,
    first_seed: int,
    variant: str,
) -> None:
    """Write (batches, H, W, 3) float64 radiance; each batch has another seed.

    camera  : for a file without a sensor: position, target, up, and fov, vertical, in degrees
    samples : samples per pixel of each batch
    depth   : largest number of bounces; 1 is direct light only
    variant : Mitsuba's variant; scalar_rgb darkens masks, so llvm_ad_rgb is better
    """
    mi = load_mitsuba(variant)
    config = mi.parser.ParserConfig(variant)
    config.unused_parameters = config.unused_properties = mi.LogLevel.Debug
    state = mi.parser.parse_file(config, path, **parameters)
    mi.file_resolver().prepend(str(Path(path).parent))
    mi.parser.transform_all(config, state)
    hides, has_medium = False, False
    for node in state.nodes:
        kind = node.props.plugin_name()
        if node.type == mi.ObjectType.Film:
            node.props["width"], node.props["height"] = size
        elif node.type == mi.ObjectType.ReconstructionFilter:
            node.props.set_plugin_name("box")
        elif node.type == mi.ObjectType.Integrator:
            hides |= bool(node.props.get("hide_emitters", False))
            node.props.set_plugin_name("path")  # a plugin that every variant has; the picture uses another one
        elif node.type == mi.ObjectType.Medium:
            has_medium = True
        elif kind == RADIO_MATERIAL:
            _preview(mi, node.props, Path(path))
    scene = mi.parser.instantiate(config, state)
    scene = scene[0] if isinstance(scene, list | tuple) else scene
    extra: dict[str, Any] = {}
    if not scene.emitters():
        extra["sky"] = {"type": "constant"}
    if extra:
        shapes = {f"shape{number}": shape for number, shape in enumerate(scene.shapes())}
        sensors = {f"sensor{number}": sensor for number, sensor in enumerate(scene.sensors())}
        scene = mi.load_dict({"type": "scene", **shapes, **sensors, **extra})
    sensor = scene.sensors()[0] if scene.sensors() else _sensor(mi, camera, size)
    integrator = mi.load_dict(
        {
            "type": "volpath" if has_medium else "path",
            "max_depth": depth + 1,
            "hide_emitters": hides,
        }
    )
    pictures = [
        np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=first_seed + batch))
        for batch in range(batches)
    ]
    np.save(output, np.stack(pictures).astype(np.float64)[..., :3])


def _preview(mi: Any, properties: Any, path: Path) -> None:
    """Replace a radio material by the diffuse surface that Sionna shows."""
    kind = str(properties["type"])
    colour = properties["color"] if "color" in properties else radio_colours(path)[kind]
    for key in list(properties.keys()):
        del properties[key]
    reflectance = {"type": "rgb", "value": [float(each) for each in colour]}
    properties.set_plugin_name("twosided")
    properties["shown"] = mi.load_dict({"type": "diffuse", "reflectance": reflectance})


def radio_colours(path: Path) -> dict[str, tuple[float, float, float]]:
    """Return Sionna's colours by material, from the source of the checkout that a scene lies in."""
    source = next(folder / _RADIO_FILE for folder in path.parents if (folder / _RADIO_FILE).is_file())
    for node in ast.walk(ast.parse(source.read_text("utf-8"))):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == _RADIO_COLOURS:
            colours: dict[str, tuple[float, float, float]] = ast.literal_eval(node.value)
            return colours
    raise ValueError(f"{source}: has no {_RADIO_COLOURS}")


def _sensor(mi: Any, camera: dict[str, Any], size: tuple[int, int]) -> Any:
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    look_at = mi.ScalarTransform4f().look_at(camera["position"], camera["target"], camera["up"])
    return mi.load_dict(
        {
            "type": "perspective",
            "to_world": look_at,
            "fov": camera["fov"],
            "fov_axis": "y",
            "film": film,
        }
    )


if __name__ == "__main__":
    render_file(**json.load(sys.stdin))
